"""Components: chain, beam, plate, solid, and their meshes. In: geometry and material. Out: a `Substructure`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
