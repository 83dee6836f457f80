"""Comparisons of models: error against run time, and audits. In: models. Out: tables."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
