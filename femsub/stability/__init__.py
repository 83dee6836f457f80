"""Loss of stability. In: a model and its contacts. Out: critical values of parameters, growth rates, borders, and maps."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
