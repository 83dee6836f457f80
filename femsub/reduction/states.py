"""Eigenpairs of a small second-order model, only those in a contour: projection on states that depend on the parameters p.

In first order, with right states (x, λx) and left states ((D + λM)ᴴz, z),

    a (x, λx) = λ b (x, λx),   a = |  0   I |,   b = | I  0 |.
                                   | -K  -D |        | 0  M |

No eigenvalue crosses the contour Γ of a proved cell. So Π(p) = (1/2πi) ∮ (sb - a)⁻¹b ds = X(ZᴴbX)⁻¹Zᴴb, with the right and
left states X and Z of the k eigenvalues inside, is analytic in the parameters p. So are the real bases Π(p)X_c of right and
(bΠ(p)b⁻¹)ᵀZ_c of left states, with the bases X_c and Z_c in the middle of the cell. Polynomials of low degree give these bases:

    X(p) = Σ_e T_e(p) X_e,   Z(p) = Σ_e T_e(p) Z_e,   T_e(p) = Π_i T_{e_i}(p_i),   e_1 + e_2 + … ≤ degree.

The pencil ZᵀaX - λ ZᵀbX of order k has exactly the eigenvalues inside Γ. Where two modes coalesce, their vectors have no
derivative, but Π has one.

Pairs with too large residuals are improved by inverse iteration on P(λ). The number of separate error circles shows whether all
pairs were found. The polynomials are exact at discrete Leja points: each degree adds new points to those of the degree before.

Sources: T. Kato, Perturbation Theory for Linear Operators (1966), ch. 2 (Π(p)); L. Bos, S. De Marchi, A. Sommariva, M. Vianello,
SIAM J. Numer. Anal. 48 (2010) 1984 (Leja points by an LU factor).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.polynomial.chebyshev import chebvander

from femsub.checks import EPS, Array

if TYPE_CHECKING:
    from femsub.reduction.parameter_box import RadiiAt

Matrices = tuple[Array, Array, Array]
Inside = Callable[[Array], Array]


@dataclass(frozen=True)
class Polynomials:
    """Products T_e of Chebyshev's polynomials over ranges of q parameters, e (m, q) in order of degree, and nodes (m, q).

    The first nodes are those of lower degrees; the very first is the middle of the ranges.
    """

    ranges: Mapping[str, tuple[float, float]]
    e: Array
    nodes: Array

    @classmethod
    def of(cls, ranges: Mapping[str, tuple[float, float]], most: int) -> Polynomials:
        """The products up to the highest degree for which there are at most `most` of them; at least one product."""
        q, degree = len(ranges), 0
        while comb(q + degree + 1, q) <= most:
            degree += 1
        e = np.array(sorted((np.bincount(one, minlength=q + 1)[1:].tolist()
                             for one in combinations_with_replacement(range(q + 1), degree)), key=sum)).reshape(-1, q)
        tried = np.vstack([np.zeros(q), np.cos(np.pi * spread(16 * len(e), q))])  # the middle is the first node
        lo, hi = np.transpose(list(ranges.values()))
        found = cls(ranges, e, (lo + hi) / 2 + tried * (hi - lo) / 2)
        order = np.arange(len(tried))
        for row, other in enumerate(la.lu_factor(found.weights(found.nodes))[1]):
            order[[row, other]] = order[[other, row]]
        return cls(ranges, e, found.nodes[order[:len(e)]])

    def weights(self, places: Array) -> Array:
        """T_e (j, m) at places (j, q)."""
        lo, hi = np.transpose(list(self.ranges.values()))
        each = chebvander((2 * places - lo - hi) / (hi - lo), int(self.e.max(initial=0)))  # (j, q, degree + 1)
        return np.asarray(np.take_along_axis(each, self.e.T[None], axis=2).prod(axis=1))

    @property
    def counts(self) -> list[int]:
        """The numbers of products of degree up to 0, 1, …"""
        return [int(count) for count in np.cumsum(np.bincount(self.e.sum(axis=1)))]


def spread(count: int, q: int) -> Array:
    """Points (count, q) that are evenly spread over the unit cube: k (1/g, 1/g², …) modulo 1 with g^(q + 1) = g + 1.

    SciPy's Sobol points would do as well, but loading `scipy.stats` takes longer than many a reduction.
    """
    g = float(np.roots([1.0, *np.zeros(q - 1), -1.0, -1.0]).real.max())
    return (0.5 + np.outer(np.arange(count), g ** -np.arange(1.0, q + 1))) % 1


class Spaces(NamedTuple):
    """Real bases of the right and of the left states of the eigenvalues inside a contour, (2d, k), in a unit of λ."""

    right: Array
    left: Array

    @classmethod
    def of(cls, matrices: Matrices, lam: Array, x: Array, z: Array, unit: float, middle: Spaces | None = None) -> Spaces:
        """The bases, from all eigenpairs inside, conjugates included; their vectors may have any lengths.

        If the bases of the middle are given, Π is applied to them. Otherwise the bases are principal directions, each as long as
        its singular value.
        """
        _, D, M = matrices
        X, Z = np.vstack([x, x * (lam / unit)]), np.vstack([unit * (D.T @ z + M.T @ (z * lam.conj())), z])
        d = len(M)

        def b(states: Array, mass: Array) -> Array:
            return np.vstack([states[:d], unit**2 * (mass @ states[d:])])

        if middle is None:
            found = (la.svd(np.hstack([side.real, side.imag]), full_matrices=False)[:2] for side in (X, Z))
            return cls(*((U * size)[:, :X.shape[1]] for U, size in found))
        G = Z.conj().T @ b(X, M)
        return cls((X @ np.linalg.solve(G, Z.conj().T @ b(middle.right, M))).real,
                   (Z @ np.linalg.solve(G.conj().T, X.conj().T @ b(middle.left, M.T))).real)


class Norms(NamedTuple):
    """Norms (j,) of an inverse at λ (j,). Any other λ gets the norm at the nearest of these λ, or 0 if there are none."""

    at: Array = np.zeros(0, dtype=complex)
    size: Array = np.zeros(0)

    def __call__(self, lam: Array) -> Array:
        if not len(self.at):
            return np.zeros(len(lam))
        return np.asarray(self.size[np.abs(lam[:, None] - self.at).argmin(axis=1)])

    def joined(self, other: Norms) -> Norms:
        """These norms and those at other values of the parameters: the larger norm at each λ."""
        sizes = np.maximum(self.size, other(self.at)), np.maximum(other.size, self(other.at))
        return Norms(np.append(self.at, other.at), np.concatenate(sizes))


@dataclass(frozen=True)
class States:
    """X_e and Z_e (m, 2d, k) for products T_e of the parameters, in a unit of λ. `given` holds parameters of fixed value."""

    over: Polynomials
    right: Array
    left: Array
    unit: float
    given: Mapping[str, float] = field(default_factory=dict)
    inverse: Norms = field(default_factory=Norms)  #: norms from `inverse_beside`, without the pairs inside

    @classmethod
    def of(cls, over: Polynomials, spaces: Sequence[Spaces], unit: float) -> States:
        """The interpolation of `spaces` at the first nodes; their number must be one of `Polynomials.counts`."""
        m = len(spaces)
        inverse = np.linalg.inv(over.weights(over.nodes[:m])[:, :m])
        right, left = (np.tensordot(inverse, np.array(side), 1) for side in zip(*spaces, strict=True))
        return cls(over, right, left, unit)

    def at(self, values: Mapping[str, float]) -> Spaces:
        """X and Z at values of the parameters."""
        every = {**self.given, **values}
        weights = self.over.weights(np.array([[every[name] for name in self.over.ranges]]))[0, :len(self.right)]
        return Spaces(*((weights @ part.reshape(len(part), -1)).reshape(part.shape[1:]) for part in (self.right, self.left)))

    def staying(self, values: Mapping[str, float]) -> States:
        """States with constant bases, which are those at `values`."""
        right, left = self.at(values)
        return replace(self, right=right[None], left=left[None])

    def pairs(self, values: Mapping[str, float], matrices: Matrices, inside: Inside) -> tuple[Array, Array, Array]:
        """λ (k,) inside a contour with Im λ ≥ 0, x and z (d, k), of K, D and M at these values."""
        K, D, M = matrices
        (x, dx), (dz, z) = (np.split(part, 2) for part in self.at(values))
        a = dz.T @ dx - z.T @ (K @ x + self.unit * (D @ dx))
        solve = _solver(dz.T @ x + self.unit**2 * (z.T @ (M @ dx)))
        lam, y = np.linalg.eig(solve(a))
        lam = self.unit * lam.astype(complex)  # NumPy returns a real array if all are real, which would be taken for frequencies
        at = np.flatnonzero(inside(lam) & (lam.imag >= 0))
        w = solve(np.linalg.inv(y)[at].T, 1).conj()
        w = np.where(lam[at].imag == 0, w.real, w)  # the inverse leaves rounding in the imaginary part
        return lam[at], x @ y[:, at], z @ w


def _solver(A: Array) -> Callable[..., Array]:
    """A function of (b, trans) that returns A⁻¹b, A⁻ᵀb or A⁻ᴴb. If A is singular, its result is not finite, without a warning."""
    getrf, = la.get_lapack_funcs(("getrf",), (A,))
    lu, pivots, _ = getrf(A)

    def solve(b: Array, trans: int = 0) -> Array:
        getrs, = la.get_lapack_funcs(("getrs",), (lu, b))
        return np.asarray(getrs(lu, pivots, b, trans=trans)[0])

    return solve


def settled(images: Array, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array, Array]:
    """λ corrected by the two-sided quotient zᴴP(λ)x / zᴴP'(λ)x; x and z scaled to |zᴴP'(λ)x| = 1 and equal lengths.

    `images` (3, d, k) are Kx, Dx and Mx. They are returned for the scaled x.
    """
    stiff, damped, inert = np.einsum("ik,jik->jk", z.conj(), images)
    slope = damped + 2 * lam * inert
    even = np.sqrt(np.linalg.norm(z, axis=0) / np.linalg.norm(x, axis=0) / np.abs(slope))
    return lam - (stiff + lam * (damped + lam * inert)) / slope, x * even, z / (even * slope.conj()), images * even


def improved(matrices: Matrices, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array]:
    """`settled` pairs of LAPACK, |zᴴP'(λ)x| = 1. A double λ, such as 0 of rigid motion, has no such quotient: it is kept."""
    found = settled(of_each(matrices, x), lam, x, z)
    simple = np.abs(found[0] - lam) <= EPS**0.25 * np.abs(lam)
    even = np.sqrt(np.linalg.norm(z, axis=0) / np.linalg.norm(x, axis=0))
    value, right, left = (np.where(simple, *two) for two in zip(found[:3], (lam, x * even, z / even), strict=True))
    return value, right, left


def of_each(matrices: Matrices, x: Array) -> Array:
    """The products of each matrix with x (d, k), (3, d, k)."""
    k, real = x.shape[1], np.hstack([x.real, x.imag])  # NumPy would make a complex copy of each matrix
    return np.stack([image[:, :k] + 1j * image[:, k:] for image in (A @ real for A in matrices)])


def lengths(images: Array, lam: Array) -> Array:
    """‖P(λ)x‖ of each pair (k,), from Kx, Dx and Mx (3, d, k)."""
    return np.linalg.norm(images[0] + lam * (images[1] + lam * images[2]), axis=0)


def inverse_beside(at: Array, lam: Array, x: Array, z: Array, steps: int = 20) -> Norms:
    """‖Σ x_j z_jᴴ / (λ_j - λ)‖ for each λ in `at`, by power iteration: the norm of P(λ)⁻¹ without the pairs inside a contour.

    The sum is over the pairs outside, λ_j = `lam` (k,), x and z (d, k) with |zᴴP'(λ)x| = 1. It is analytic inside.
    """
    weights, square = 1 / (lam[:, None] - at), np.ones(len(at))
    y: Array = np.random.default_rng(0).standard_normal((len(x), len(at)))
    for _ in range(steps):
        image = x @ (weights * (z.conj().T @ (y / np.where(square > 0, square, 1.0))))
        y = z @ (weights.conj() * (x.conj().T @ image))
        square = np.linalg.norm(y, axis=0)
    return Norms(at, np.sqrt(square))


@np.errstate(all="ignore")  # P(λ) may be singular: the result is not finite then
def iterated(matrices: Matrices, lam: Array, x: Array, z: Array) -> tuple[Array, Array, Array]:
    """`settled` after a step of inverse iteration on both sides, one factor for each pair."""
    K, D, M = matrices
    better = []
    for value, right, left in zip(lam, x.T, z.T, strict=True):
        value, right, left = (part.real if not value.imag else part for part in (value, right, left))
        solve = _solver(K + value * (D + value * M))
        better.append((solve(right), solve(left, 2)))
    x, z = (np.array(side, dtype=complex).T for side in zip(*better, strict=True))
    return settled(of_each(matrices, x), lam, x, z)[:3]


def seen(states: States, values: Mapping[str, float], matrices: Matrices, inside: Inside, number: int, sizes: RadiiAt,
         tol: float) -> tuple[list[Array], Array, int, Array]:
    """Pairs from the states: λ, x, z, `sizes`; the indices of those that count, see `listed`; how many are missing; raw λ."""
    with np.errstate(all="ignore"):
        try:
            found = states.pairs(values, matrices, inside)
        except la.LinAlgError:
            found = np.zeros(0, dtype=complex), *np.zeros((2, len(matrices[0]), 0), dtype=complex)
        lam, x, z, images = settled(of_each(matrices, found[1]), *found)
        K, D, M = matrices
        rest = lengths(images, lam) * lengths(of_each((K.T, D.T, M.T), z), lam.conj())
        size = sizes(lam, x, z) + states.inverse(lam) * rest
        # half of the tolerance, since `least` may be corrected later, and the radii then grow
        return [lam, x, z, size], *_apart(lam, size, inside, tol / 2, number), found[0]


def listed(states: States, values: Mapping[str, float], matrices: Matrices, inside: Inside, number: int,
           sizes: RadiiAt, tol: float, fine: bool = False, steps: int = 6) -> tuple[Array, ...] | None:
    """λ, x, z and `sizes` of the eigenpairs inside a contour with Im λ ≥ 0; `inside` says which λ are.

    Pairs whose circles are too large are iterated; with `fine`, all pairs are. A pair that still moves by more than its circle
    after `steps` iterations does not count. The pairs are returned if `number` circles of radius up to tol |λ|, conjugates
    included, are apart from each other. Otherwise None is returned, and the whole eigenproblem must be solved.
    """
    (lam, x, z, size), at, missing, _ = seen(states, values, matrices, inside, number, sizes, tol)
    waiting = np.argsort(size)
    waiting = waiting[~np.isin(waiting, at)]  # most are spurious, and have the largest residuals
    better = np.append(at[:len(at) * fine], waiting[:max(missing, 0)])
    with np.errstate(all="ignore"):
        while len(better):
            again = better
            for _ in range(steps):
                before = lam[again]
                lam[again], x[:, again], z[:, again] = iterated(matrices, before, x[:, again], z[:, again])
                size[again] = sizes(lam[again], x[:, again], z[:, again])
                # the error left in the basis is about the square of the change, over the distance of the next λ
                again = again[np.abs(lam[again] - before) > np.maximum(size[again], EPS**0.75 * np.abs(lam[again]))]
                if not len(again):
                    break
            size[again] = np.inf
            at, missing = _apart(lam, size, inside, tol, number)
            waiting = waiting[~np.isin(waiting, better)]
            better = waiting[:len(waiting) * (missing > 0)]
    return None if missing else (lam[at], x[:, at], z[:, at], size[at])


def _apart(lam: Array, size: Array, inside: Inside, tol: float, number: int) -> tuple[Array, int]:
    """Indices of λ with size ≤ tol |λ| whose circle is apart from all smaller circles; how many are missing, with conjugates."""
    at = np.argsort(size)
    apart = np.abs(lam[at, None] - lam[at]) > size[at, None] + size[at]
    apart[np.triu_indices(len(at))] = True
    at = at[(size <= tol * np.abs(lam))[at] & (inside(lam) & (lam.imag >= 0))[at] & apart.all(axis=1)]
    return at, number - len(at) - np.count_nonzero(lam[at].imag)
