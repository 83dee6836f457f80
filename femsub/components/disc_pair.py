"""A pair of waves of a disc that turns under a pad, the smallest model with all matrices of a turning brake."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array


def disc_pair() -> dict[str, Array]:
    """The matrices M, D1, DR, DG, K1, KR and Kgeo, (2, 2) each, of q̈ + (D1 + μ DR/Ω + Ω DG) q̇ + (K1 + μ KR + Ω² Kgeo) q = 0.

    The deflection w = q₁ cos mθ + q₂ sin mθ has m = 3 nodal diameters in a fixed frame. The material flows through it at the
    speed Ω, which gives DG = 2m [[0, 1], [-1, 0]] and Kgeo = -m² I. Without the pad the frequencies are ω₀ ∓ mΩ, and ω₀ = 1.
    Springs of the pad press on both faces of the disc at θ = 0, with k = 0.1 in all: K1 = diag(1 + k, 1). A face at the
    distance h/2 moves by -h/2 ∂w/∂θ along the circumference, where friction acts on it. So KR = -k (h m / 2) [[0, 0], [1, 0]]
    with h = 0.1. Where the direction of sliding turns, friction damps: DR = diag(c, 0). D1 = d I is damping from outside. The
    radius of the pad, the modal mass and ω₀ are the units.
    """
    m, k, h, c, d = 3, 0.1, 0.1, 1e-4, 2e-3
    return {"M": np.eye(2), "D1": d * np.eye(2), "DR": np.diag([c, 0.0]), "DG": 2 * m * np.array([[0.0, 1.0], [-1.0, 0.0]]),
            "K1": np.diag([1 + k, 1.0]), "KR": -k * h * m / 2 * np.array([[0.0, 0.0], [1.0, 0.0]]), "Kgeo": -m**2 * np.eye(2)}
