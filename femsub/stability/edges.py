"""What comes into a band of frequencies over a parameter, or leaves it: the modes at its edges, at all values at once.

A mode that is in the band at no sample must have come in through an edge ω, and left again. At a frequency ω the parameter is an
eigenvalue: with the chord of the pencil over an interval around m,

    (P(iω; m) + t ΔP(iω)) x = 0,    -P(iω; m)⁻¹ ΔP(iω) x = x / t,

so that the t near the interval are the dominant eigenvalues of one operator. Block Arnoldi finds them: one factorisation, and
few solutions. If few DOF depend on the parameter, its basis ends with the rank of ΔP.

Where an eigenvalue passes the edge beside the axis, at λ = r + iω, t is complex. If the mode reaches the axis within a distance g
in p, its eigenvalue moves by r within g, and t is about as near to the interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from femsub.checks import EPS, Array
from femsub.model import Pencil
from femsub.modes.quadratic.correction import Inverse, solver_near
from femsub.stability.parameter import PencilOver


def factor_at(pencil: Pencil, value: complex) -> Inverse | None:
    """P(λ) factorised, or beside λ if it is singular there, also where λ = 0; None if it is singular there, too."""
    return solver_near(pencil.sparse(), value) or (None if value else solver_near(pencil.sparse(), 2**22 * EPS))


def modes_at(over: PencilOver, ends: Sequence[float], gap: float, lam: complex, most: int) -> tuple[Array, Array] | None:
    """t (k,), complex, and the shapes (n, k) of all modes that have the eigenvalue λ for p = t, up to `gap` beside the range.

    The pencil is close to its chords between the `ends`. None if a basis of `most` vectors is not enough, or P is singular.
    """
    places: list[Array] = []
    shapes: list[Array] = []
    for a, b in pairwise(ends):
        m, half = (a + b) / 2, (b - a) / 2
        first, last = (over(p).at(lam) for p in (a, b))
        factor = factor_at(over(m), lam)
        found = None if factor is None else _dominant(factor, (last - first) / (b - a), 1 / (half + gap), most)
        if found is None:
            return None
        near = np.abs(found[0] - np.clip(found[0].real, -half, half)) <= gap
        places.append(m + found[0][near])
        shapes.append(found[1][:, near])
    return np.concatenate(places), np.hstack(shapes)


def _dominant(factor: Inverse, change: Any, least: float, most: int) -> tuple[Array, Array] | None:
    """t and unit vectors x of (P + tC)x = 0 with |1/t| ≥ `least`; None if a basis of `most` vectors is not enough.

    They count as complete if they and the next one have converged, since those of largest |1/t| converge first.
    """
    n = change.shape[0]
    Q, image = np.zeros((2, n, 0), dtype=complex)
    new = factor.solve(change @ np.random.default_rng(n).standard_normal((n, min(8, n))))  # of a t of higher multiplicity not all
    while True:
        size = np.linalg.norm(new, axis=0)
        for _ in range(2):
            new = new - Q @ (Q.conj().T @ new)
        new = np.divide(new, size, out=np.zeros_like(new), where=size > 0)
        u, s, _ = np.linalg.svd(new, full_matrices=False)
        new = u[:, s > n * EPS]
        if not np.isfinite(size).all() or Q.shape[1] + new.shape[1] > most:
            return None
        ended = not new.shape[1]
        Q, image = np.hstack([Q, new]), np.hstack([image, new := -factor.solve(change @ new)]) if not ended else image
        inverse, small = np.linalg.eig(Q.conj().T @ image)
        order = np.argsort(-np.abs(inverse), kind="stable")
        wanted = int(np.count_nonzero(np.abs(inverse) >= least))
        order = order[:wanted + 1]
        x, size = Q @ small[:, order], np.abs(inverse[order])
        # rough shapes do: Newton's method on the full pencil mends those that matter
        poor = np.linalg.norm(image @ small[:, order] - x * inverse[order], axis=0) > size / 100
        if ended or (len(order) > wanted and not poor.any()):
            return 1 / inverse[order[:wanted]], x[:, :wanted] / np.linalg.norm(x[:, :wanted], axis=0)
