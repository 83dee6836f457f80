"""Nonlinear motion in time. In: a model and its belts. Out: transients, their signals, and criteria for reduced models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
