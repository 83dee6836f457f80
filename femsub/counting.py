"""Has an eigenvalue been missed? The winding number of det P around a rectangle, computed without any eigensolver."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from femsub.errors import NotConvergedError
from femsub.pencil import Array, Matrix, Pencil

SPLIT = 0.382
MOST = 600  # contour points after which the phase is called untraceable


def missed_eigenvalues(pencil: Pencil, box: tuple[float, float, float, float], known: Array, reference: Matrix,
                       undamped: Array) -> int:
    """How many eigenvalues of P lie in a rectangle (re_lo, re_hi, im_lo, im_hi) and are not among the known ones.

    The number is (1/2π) Δ arg g(z) around it, by the argument principle, with

        g(z) = det P(z) / det P0(z) · Π (z² + ω_k²) / Π (z - λ_j),   P0(z) = z²M + K0,

    for the known λ_j and the frequencies ω_k of a symmetric reference K0 close to K, whose number the inertia has
    confirmed, both in one disc around the rectangle. Dividing by what is known leaves a function whose phase hardly
    turns, so that some thirty points will do where det P alone needs one for every eigenvalue. The phases come from
    sparse LU factors. With im_lo = 0 the rectangle is mirrored at the real axis and half of the contour is walked,
    since g(z̄) is the conjugate of g(z).

    Raises
    ------
    NotConvergedError
        An eigenvalue lies on the contour.
    """
    a, b, lo, hi = box
    corners = [b + 0j, b + 1j * hi, a + 1j * hi, a + 0j] if lo == 0 else \
        [b + 1j * lo, b + 1j * hi, a + 1j * hi, a + 1j * lo, b + 1j * lo]
    poles = np.concatenate([1j * undamped, -1j * undamped])
    phases: dict[complex, float] = {}

    def phase(z: complex) -> float:
        if z not in phases:
            if len(phases) >= MOST:
                raise NotConvergedError(f"the phase of det P could not be traced with {MOST} points: an eigenvalue lies on "
                                        "the edge of the band; move the edge a little, or give certify=False")
            phases[z] = (_phase(pencil.at(z)) - _phase(z * z * pencil.M + reference)
                         + float(np.angle(z - poles).sum() - np.angle(z - known).sum()))
        return phases[z]

    turn = 0.0
    for start, end in zip(corners[:-1], corners[1:], strict=True):
        points = [start + (end - start) * t for t in np.linspace(0, 1, 9)]
        stack = list(zip(points[:-1], points[1:], strict=True))[::-1]
        while stack:
            left, right = stack.pop()
            # Unequal parts: a phase that turns by whole circles over both would pass for one that stands still.
            middle = left + SPLIT * (right - left)
            first, second = (_wrapped(phase(q) - phase(p)) for p, q in ((left, middle), (middle, right)))
            steady = abs(first / SPLIT - second / (1 - SPLIT)) < np.pi / 2
            if (max(abs(first), abs(second)) < np.pi / 4 and steady) or abs(right - left) < 1e-12 * abs(end - start):
                turn += first + second
            else:
                stack += [(middle, right), (left, middle)]
    return round(turn / np.pi) if lo == 0 else round(turn / (2 * np.pi))


def _phase(matrix: Matrix) -> float:
    """arg det of a complex sparse matrix: the phases of U's diagonal, and π for each odd permutation."""
    try:
        lu = splu(sp.csc_array(matrix, dtype=complex))
    except RuntimeError:  # exactly singular: an eigenvalue on the contour, which the step control will run into
        return 0.0
    return float(np.angle(lu.U.diagonal()).sum()) + np.pi * (_odd(lu.perm_r) + _odd(lu.perm_c))


def _odd(permutation: Array) -> int:
    cycles, _ = sp.csgraph.connected_components(
        sp.csr_array((np.ones(len(permutation)), (np.arange(len(permutation)), permutation))), directed=False)
    return (len(permutation) - cycles) % 2


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
