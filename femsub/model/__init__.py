"""Models of components: matrices, DOF, ports, the pencil λ²M + λD + K, and the protocol of contacts.

In: arrays and numbers. Out: checked, frozen objects.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
