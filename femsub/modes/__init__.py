"""Modes: undamped (K - ω²M)φ = 0 and, in `quadratic`, complex (λ²M + λD + K)x = 0; damping and rotation, which use modes.

In: a model. Out: frequencies and shapes, each with its residual, and the number of modes by an independent count (inertia).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
