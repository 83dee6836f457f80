"""Eigenpairs of a small model of second order in the time that its wanted ones take: Petrov-Galerkin projection of states.

A shape of the small model takes part as x and as λx, and right and left vectors share one basis: that makes four columns for an
eigenvalue. In first order, with a basis for right states and another one for left states,

    a (x, λx) = λ b (x, λx),   a = |  0   I |,   b = | I  0 |,   left states ((D + λM)ᴴz, z),
                                   | -K  -D |        | 0  M |

ZᵀaX and ZᵀbX are of about the size of the number of wanted eigenvalues, and affine in the factors of the model. Such a projection
is less stable: it has eigenvalues that belong to nothing, and vectors that are mixed with theirs. Pairs whose residuals need it
take a step of inverse iteration on P(λ), and the number of circles of error shows whether all are there. Two-sided
bases of states: A. Antoulas, Approximation of Large-Scale Dynamical Systems (2005), ch. 11.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array

if TYPE_CHECKING:
    from femsub.reduction.parameter_box import RadiiAt

Matrices = tuple[Array, Array, Array]
Inside = Callable[[Array], Array]


@dataclass(frozen=True)
class States:
    """ZᵀaX and ZᵀbX (q + 1, k, k), the first of them without a factor, the shapes in X and in Z, (d, k), and the unit of λ."""

    a: Array
    b: Array
    x: Array
    z: Array
    unit: float

    @classmethod
    def of(cls, terms: tuple[Sequence[Array], ...], X: Array, Z: Array, unit: float) -> States:
        """On right states X and left ones Z (2d, k), of M, D and K that are sums of these terms (d, d), in a unit of λ."""
        (x, dx), (dz, z) = (np.split(part, 2) for part in (X, Z))
        mass, damping, stiffness = ([-z.T @ A @ part for A in several] for several, part in zip(terms, (dx, dx, x), strict=True))
        none = np.zeros((X.shape[1], X.shape[1]))
        a = [dz.T @ dx, *(none for _ in mass), *damping, *stiffness]
        b = [dz.T @ x, *(-A for A in mass), *(none for _ in damping), *(none for _ in stiffness)]
        return cls(np.array(a), np.array(b), x, z, unit)

    def pairs(self, factors: Array, inside: Inside) -> tuple[Array, Array, Array]:
        """λ (k,) inside a contour with Im λ ≥ 0, x and z (d, k)."""
        a, b = ((np.append(1.0, factors) @ part.reshape(len(part), -1)).reshape(part.shape[1:]) for part in (self.a, self.b))
        solve = _solver(b)
        lam, y = np.linalg.eig(solve(a))
        lam = self.unit * lam.astype(complex)  # NumPy's are real where all are, and would be taken for frequencies
        at = np.flatnonzero(inside(lam) & (lam.imag >= 0))
        w = solve(np.linalg.inv(y)[at].T, 1).conj()
        w = np.where(lam[at].imag == 0, w.real, w)  # the inverse left them a rounding
        return lam[at], self.x @ y[:, at], self.z @ w


def _solver(A: Array) -> Callable[..., Array]:
    """(b, trans) to A⁻¹b, A⁻ᵀb or A⁻ᴴb. Where A is singular the result is not finite; there is no warning."""
    getrf, = la.get_lapack_funcs(("getrf",), (A,))
    lu, pivots, _ = getrf(A)

    def solve(b: Array, trans: int = 0) -> Array:
        getrs, = la.get_lapack_funcs(("getrs",), (lu, b))
        return np.asarray(getrs(lu, pivots, b, trans=trans)[0])

    return solve


def settled(matrices: Matrices, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array]:
    """λ by the quotient of x and z, which get |zᴴP'(λ)x| = 1 and equal lengths."""
    K, D, M = matrices
    damped, inert = D @ x, lam * (M @ x)
    quotient, slope = (np.einsum("ik,ik->k", z.conj(), part) for part in (K @ x + lam * (damped + inert), damped + 2 * inert))
    even = np.sqrt(np.linalg.norm(z, axis=0) / np.linalg.norm(x, axis=0) / np.abs(slope))
    return lam - quotient / slope, x * even, z / (even * slope.conj())


def improved(matrices: Matrices, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array]:
    """`settled` pairs of LAPACK, |zᴴP'(λ)x| = 1; a double λ, as 0 of rigid motion, has no such quotient and stays."""
    found = settled(matrices, lam, x, z)
    simple = np.abs(found[0] - lam) <= EPS**0.25 * np.abs(lam)
    even = np.sqrt(np.linalg.norm(z, axis=0) / np.linalg.norm(x, axis=0))
    value, right, left = (np.where(simple, *two) for two in zip(found, (lam, x * even, z / even), strict=True))
    return value, right, left


def iterated(matrices: Matrices, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array]:
    """`settled` after a step of inverse iteration on both sides, one factor for each pair."""
    K, D, M = matrices
    better = []
    for value, right, left in zip(lam, x.T, z.T, strict=True):
        value, right, left = (part.real if not value.imag else part for part in (value, right, left))
        solve = _solver(K + value * (D + value * M))
        better.append((solve(right), solve(left, 2)))
    return settled(matrices, lam, *(np.array(side, dtype=complex).T for side in zip(*better, strict=True)))


def seen(states: States, factors: Array, matrices: Matrices, inside: Inside, number: int, sizes: RadiiAt,
         tol: float) -> tuple[list[Array], Array, int]:
    """λ, x, z and `sizes` of the states; which of these count, see `listed`; and how many lack, with conjugates."""
    with np.errstate(all="ignore"):
        try:
            lam, x, z = settled(matrices, *states.pairs(factors, inside))
        except la.LinAlgError:
            lam, x, z = np.zeros(0, dtype=complex), *np.zeros((2, len(matrices[0]), 0), dtype=complex)
        size = sizes(lam, x, z)
        # half of the tolerance: radii may grow by what a new value shows
        return [lam, x, z, size], *_apart(lam, size, inside, tol / 2, number)


def listed(states: States, factors: Array, matrices: Matrices, inside: Inside, number: int,
           sizes: RadiiAt, tol: float, fine: bool = False) -> tuple[Array, ...] | None:
    """λ, x, z and `sizes` of the eigenpairs inside a contour with Im λ ≥ 0; `inside` says which λ are.

    Pairs whose circles are too large are iterated; if `fine`, all are.
    These count if as many circles of at most tol |λ| are apart from each other as there are eigenvalues, conjugates included.
    None otherwise: then the whole problem is to be solved.
    """
    (lam, x, z, size), at, missing = seen(states, factors, matrices, inside, number, sizes, tol)
    waiting = np.argsort(size)
    waiting = waiting[~np.isin(waiting, at)]  # most of them belong to nothing, and have the largest residuals
    better = np.append(at[:len(at) * fine], waiting[:max(missing, 0)])
    with np.errstate(all="ignore"):
        while len(better):
            lam[better], x[:, better], z[:, better] = iterated(matrices, lam[better], x[:, better], z[:, better])
            size[better] = sizes(lam[better], x[:, better], z[:, better])
            at, missing = _apart(lam, size, inside, tol, number)
            waiting = waiting[~np.isin(waiting, better)]
            better = waiting[:len(waiting) * (missing > 0)]
    return None if missing else (lam[at], x[:, at], z[:, at], size[at])


def _apart(lam: Array, size: Array, inside: Inside, tol: float, number: int) -> tuple[Array, int]:
    """Those of size ≤ tol |λ| whose circle is apart from all smaller ones, and how many lack, with conjugates."""
    at = np.argsort(size)
    apart = np.abs(lam[at, None] - lam[at]) > size[at, None] + size[at]
    apart[np.triu_indices(len(at))] = True
    at = at[(size <= tol * np.abs(lam))[at] & (inside(lam) & (lam.imag >= 0))[at] & apart.all(axis=1)]
    return at, number - len(at) - np.count_nonzero(lam[at].imag)
