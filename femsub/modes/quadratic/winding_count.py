"""The number of missed eigenvalues, by the winding number of det P around a rectangle, without any eigensolver."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.errors import MissedModesError, NotConvergedError, SingularMatrixError
from femsub.modes.normal_modes import modes_below

if TYPE_CHECKING:
    from femsub.model import Pencil
    from femsub.modes.quadratic.region import Box


def missed_eigenvalues(pencil: Pencil, box: Box, found: Array, reference: Matrix, undamped: Array, most: int = 600) -> int:
    """The number of eigenvalues of P in a rectangle (re_lo, re_hi, im_lo, im_hi) that are not among those found, Im λ ≥ 0.

    Its edges are moved out a little, to keep clear of those.

    By the argument principle it is (1/2π) Δ arg g(z) around the rectangle, with

        g(z) = det P(z) / det P0(z) · Π (z² + ω_k²) / Π (z - λ_j),   P0(z) = z²M + K0,

    for the known λ_j and the frequencies ω_k of a symmetric reference K0 close to K, confirmed by an inertia count. Both sets
    lie in one disc around the rectangle. After division by the known factors the phase hardly turns. So about thirty points
    are enough, while det P alone needs one per eigenvalue. The phases come from sparse LU factors. With im_lo = 0 the
    rectangle is mirrored at the real axis, and only half of the contour is needed, since g(z̄) is the conjugate of g(z). No more
    than `most` points are taken, twenty times as many as usual, since each takes two factorisations.

    Raises
    ------
    NotConvergedError
        An eigenvalue lies on the contour.
    """
    a, b, lo, hi = clear_of(found, box)
    known = np.append(found, found[found.imag != 0].conj())
    corners = [b + 0j, b + 1j * hi, a + 1j * hi, a + 0j] if lo == 0 else \
        [b + 1j * lo, b + 1j * hi, a + 1j * hi, a + 1j * lo, b + 1j * lo]
    poles = np.concatenate([1j * undamped, -1j * undamped])
    phases: dict[complex, float] = {}

    def phase(z: complex) -> float:
        if z not in phases:
            if len(phases) >= most:
                raise NotConvergedError(f"the phase of det P could not be traced with {most} points. Probably an eigenvalue lies "
                                        "on the edge of the band. Move the edge a little, or give evidence=False")
            phases[z] = (phase_of(pencil.at(z)) - phase_of(z * z * pencil.M + reference)
                         + float(np.angle(z - poles).sum() - np.angle(z - known).sum()))
        return phases[z]

    turn = sum(_turned(phase, start, end) for start, end in pairwise(corners))
    return round(turn / np.pi) if lo == 0 else round(turn / (2 * np.pi))


def clear_of(values: Array, box: Box) -> Box:
    """The rectangle with each edge moved out by up to 2 %, into the widest gap between known eigenvalues."""
    a, b, lo, hi = box
    moves = np.linspace(0.002, 0.02, 10) * hi

    def best(edges: Array, coordinates: Array) -> float:
        return float(edges[np.argmax(np.abs(edges[:, None] - coordinates).min(axis=1))])

    coordinates = values.imag
    low = max(best(lo - moves, coordinates), lo / 2) if lo > 0 else 0.0
    return best(a - moves, values.real), best(b + moves, values.real), low, best(hi + moves, coordinates)


def undamped_reference(pencil: Pencil, radius: float) -> tuple[Matrix, Array] | None:
    """The reference of the winding count: a symmetric K0 close to K with its frequencies below the radius.

    K0 is the symmetric part of K without contacts, plus a multiple of M if friction has made it indefinite. None if M is not
    symmetric positive semidefinite.
    """
    if not pencil.symmetric[0]:
        return None
    symmetric = pencil.symmetric_stiffness
    for lift in (0.0, 1e-3, 1e-2, 1e-1, 1.0):
        K = symmetric + lift * radius**2 * pencil.M if lift else symmetric
        with suppress(SingularMatrixError, MissedModesError):
            return K, modes_below(K, pencil.M, radius).frequencies
    return None


def _turned(phase: Callable[[complex], float], start: complex, end: complex, beside: float = 1e-7) -> float:
    """The change of the phase from start to end, which may exceed ±π.

    Modes outside the contour turn the phase evenly; with damping, by hundreds of radians. Slopes give the number of full
    turns between two points: differences over `beside` of the edge, in which the phase turns by far less than π. Intervals are
    halved until slopes and phases agree.
    """
    def at(t: float) -> float:
        return phase(start + (end - start) * t)

    @cache
    def slope(t: float) -> float:
        near = t + beside if t < 0.5 else t - beside
        return _wrapped(at(near) - at(t)) / (near - t)

    def step(a: float, b: float) -> tuple[float, float]:
        expected = (b - a) * (slope(a) + slope(b)) / 2
        surprise = _wrapped(at(b) - at(a) - expected)
        return expected + surprise, abs(surprise)

    turn, grid = 0.0, np.linspace(0, 1, 5)
    stack = list(pairwise(grid))
    while stack:
        a, b = stack.pop()
        middle = (a + b) / 2
        whole, first, second = step(a, b), step(a, middle), step(middle, b)
        agree = abs(whole[0] - first[0] - second[0]) < 1.0 and max(whole[1], first[1], second[1]) < np.pi / 3
        if agree or b - a < 1e-9:
            turn += first[0] + second[0]
        else:
            stack += [(a, middle), (middle, b)]
    return turn


def phase_of(matrix: Matrix) -> float:
    """arg det of a complex sparse matrix: the phases of U's diagonal, and π for each odd permutation."""
    from scipy.sparse.linalg import splu

    try:
        lu = splu(sp.csc_array(matrix, dtype=complex))
    except RuntimeError:  # exactly singular: an eigenvalue on the contour; the step control will report it
        return 0.0
    return float(np.angle(lu.U.diagonal()).sum()) + np.pi * (_odd(lu.perm_r) + _odd(lu.perm_c))


def _odd(permutation: Array) -> int:
    cycles, _ = sp.csgraph.connected_components(
        sp.csr_array((np.ones(len(permutation)), (np.arange(len(permutation)), permutation))), directed=False)
    return (len(permutation) - cycles) % 2


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
