"""How parts meet: joints, ties and rigid links between them, cuts through them, and contacts that slide.

In: substructures and joints. Out: a `System`, which is a `Substructure` again.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
