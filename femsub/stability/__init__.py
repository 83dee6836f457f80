"""Where friction takes the stability away. In: a model and a port. Out: the critical slope, and growth rates over the slope."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
