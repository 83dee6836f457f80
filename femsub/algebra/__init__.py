"""Linear algebra that knows no model: factors, orderings, elimination, null spaces, memory and threads.

In: matrices. Out: factors, which solve and count negative eigenvalues. `petsc.py` alone imports petsc4py and slepc4py.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
