"""Reduced models: one file for each method.

In: a `Substructure`. Out: a `ReducedSubstructure`, which is a `Substructure` again.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
