"""Files of matrices, meshes and models. Every file is checked when it is read, and written completely or not at all.

In: a path. Out: matrices, a `Mesh` or a `Substructure`; and the reverse for writing. Tables of TOML files become objects of
classes that declare their keys (`declared`); all that is wrong in a file is listed with its lines.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
