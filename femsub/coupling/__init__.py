"""Connections between parts: joints, ties and rigid links, cuts through a model, and sliding contacts.

In: substructures and joints. Out: a `System`, which is a `Substructure` again.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
