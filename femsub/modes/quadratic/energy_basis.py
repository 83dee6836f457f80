"""A basis that is orthonormal in an energy, and a bound of the part of a quadratic pencil outside it, which proves counts.

Let A (n, n) be symmetric positive definite, V (n, m) with VᵀAV = I, and

    P(s) = A + Σ_i w_i(s) T_i,     w_i(s) = c_0 + c_1 s + c_2 s²,

each T_i symmetric or skew. A, V and the images of the T_i do not depend on the weights, so one basis serves all values of a
parameter on which only weights depend (`EnergyBasis.at`). U is the span of V, and L its complement: VᵀAx = 0. P has the blocks
P_U, P_UL, P_LU and P_L. Norms on L are those of A and A⁻¹. If for all s in a region and all x in L

    Re xᴴP(s)x ≥ c xᴴAx,   c > 0,                                       (`EnergyBasis.coercivity`)

then ‖P_L⁻¹‖ ≤ 1/c, and P(s) is singular only if P_U - P_UL P_L⁻¹ P_LU is. So

    ‖P_LU P_U⁻¹ P_UL‖ < c                                               (`Coupling.margin`)

shows that s is no eigenvalue. If that holds on a closed curve in the region, P has as many eigenvalues inside as P_U = VᵀPV: no
eigenvalue crosses the curve while the coupling grows from 0 to its value (Rouché), and P_L alone has none inside. c follows from
a range of xᴴT_ix / xᴴAx in L for each term. If all ranges are proved, the count is proved.

With P_U⁻¹ = Σ_k x_k z_kᴴ / (λ_k - s), the norm is at most Σ_k ‖P_LU x_k‖ ‖z_kᴴP_UL‖ / |λ_k - s|. Lengths of images in L follow
from the Gram matrix of all A⁻¹T_iV outside V, which is a small matrix.

References: A. T. Patera, G. Rozza, Reduced Basis Approximation and A Posteriori Error Estimation (2007), ch. 4 (coercivity
constant, dual norms of residuals); F. Tisseur, Linear Algebra Appl. 309 (2000) 339 (left vectors).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
import scipy.linalg as la

from femsub.algebra import BLOCK, FEW, Room, by_threads, halves, one_thread, orthonormal, times
from femsub.checks import EPS, Array, Matrix
from femsub.modes.normal_modes import ACCEPTED
from femsub.modes.quadratic.region import Contour

SAFE = 0.9  # required margin on a contour; the theorem needs 1
AWAY = 1.3  # shift σ in units of the largest |λ|: P_U is regular there, but may be singular at 0
RIGHT = 1e-6  # largest accepted error of the sum over eigenpairs as the inverse of P_U
NEARBY = 0.1  # |s - λ|/|λ - σ| of eigenpairs that are bounded one by one
WIDER = 40  # residuals of each kind that enrich the basis at a time
PIECES = 20_000  # largest number of pieces of a contour
BATCH = 512  # pieces that are evaluated together

T = TypeVar("T")
log = logging.getLogger(__name__)

Weights = tuple[complex, float, float]  #: c_0, c_1, c_2 of c_0 + c_1 s + c_2 s²; c_0 may be complex if T is symmetric


@dataclass(frozen=True)
class Term:
    """T with its weight in P(s), and the range of xᴴTx / xᴴAx outside the basis, for a skew T of its imaginary part."""

    matrix: Matrix
    weights: Weights
    sign: float = 1.0  #: Tᵀ = sign T
    range: tuple[float, float] = (-np.inf, np.inf)
    modal: bool = False  #: whether A⁻¹T maps the modes of `EnergyBasis.add` into the basis, as a proportional damping does
    spanned: bool = False  #: whether A⁻¹T maps into the basis, as after its few columns have joined it; its range is 0 then

    @cached_property
    def rows(self) -> Array | slice:
        """The nonzero rows if they are few, as for a contact; else all rows."""
        found = np.flatnonzero(np.diff(self.matrix.indptr)) if hasattr(self.matrix, "indptr") else slice(None)
        return found if not isinstance(found, slice) and 3 * len(found) < self.matrix.shape[0] else slice(None)

    @cached_property
    def acting(self) -> Matrix:
        """The matrix in these `rows`."""
        return self.matrix if isinstance(self.rows, slice) else self.matrix[self.rows]

    def image(self, x: Array) -> Array:
        """Tx in these `rows`."""
        return times(self.acting, x)

    def weight(self, s: Array) -> Array:
        """w(s)."""
        constant, linear, square = self.weights
        return constant + s * (linear + s * square)

    def change(self, s: Array, reach: Array) -> Array:
        """A bound of |w(s') - w(s)| for all |s' - s| ≤ reach."""
        _, linear, square = self.weights
        return reach * (np.abs(linear + 2 * square * s) + abs(square) * reach)

    def largest(self, size: float) -> float:
        """A bound of |w(s)| for all |s| ≤ size."""
        return float(np.abs(self.weights) @ [1.0, size, size**2])

    def least(self, re: tuple[float, float], top: float) -> float:
        """A lower bound of Re w(s) xᴴTx / xᴴAx outside the basis, for Re s in `re`, which contains 0, and |Im s| ≤ top."""
        constant, linear, square = self.weights[0].real, *self.weights[1:]
        side = max(-re[0], re[1])
        if self.sign > 0:
            first, last = sorted(linear * end for end in re)
            real = (constant + first - max(square * top**2, -square * side**2),
                    constant + last + max(square * side**2, -square * top**2))
        else:  # xᴴTx is imaginary
            real = (-abs(linear) * top - 2 * abs(square) * side * top, abs(linear) * top + 2 * abs(square) * side * top)
        return min(w * share if w else 0.0 for w in real for share in self.range)


def terms_of(matrix: Matrix, weights: Weights) -> list[Term]:
    """The symmetric and the skew half of a matrix as terms; halves that are 0 are left out."""
    return [Term(half, weights, sign) for half, sign in zip(halves(matrix), (1.0, -1.0), strict=True) if abs(half).max()]


class EnergyBasis:
    """V with VᵀAV = I, VᵀT_iV, and the products of all A⁻¹T_iV outside V; see the module's docstring.

    Parameters
    ----------
    product, solve : callable
        X (n, k) to AX and to A⁻¹X.
    terms : sequence of Term
    size : int
        n.
    kept : bool
        Whether the part of A⁻¹T_iV outside V is kept in single precision, which takes up to p/2 times the memory of V. Then
        `residuals` need no solve.

    Attributes
    ----------
    V : ndarray, shape (n, m)
    energy : ndarray, shape (m, m)
        VᵀAV: the unit matrix up to rounding.
    inside : ndarray, shape (p, m, m)
        VᵀT_iV.
    """

    def __init__(self, product: Callable[[Array], Array], solve: Callable[[Array], Array], terms: Sequence[Term], size: int,
                 kept: bool = False) -> None:
        self.kept = kept
        self._outside: list[tuple[int, slice, float, Array]] = []  # term, columns of V, unit, A⁻¹T times these columns / unit
        self._seen = np.zeros(0, dtype=int)  # columns of V when these were made, and outside of which they lie
        self.product, self.solve, self.terms = product, solve, list(terms)
        p = len(self.terms)
        self.V, self.energy, self.inside = np.zeros((size, 0)), np.zeros((0, 0)), np.zeros((p, 0, 0))
        self._room = Room()
        self._lost, self._whole = np.zeros((p, 0, p, 0)), np.zeros((p, 0))
        self._known = np.zeros((p, 0), dtype=bool)  # images that lie in V: MΦ of modes, AΦ = MΦ(Ω² + μ)

    @property
    def size(self) -> int:
        """m."""
        return int(self.V.shape[1])

    def add(self, new: Array, *, modes: bool = False, unit: bool = False) -> bool:
        """Append directions (n, k), made orthonormal; return whether V has grown.

        With `modes` the directions span eigenvectors of A and the first term's matrix. With `unit` they are orthonormal already.
        """
        m = self.size
        for at in few_at_a_time(new.shape[1], m + new.shape[1]):
            self._append(new[:, at], modes, unit)
        return self.size > m

    def _append(self, new: Array, modes: bool, unit: bool) -> None:
        m = self.size
        new, Anew = (new, self.product(new)) if unit else orthonormal(np.ascontiguousarray(new), self.product, self.V)
        k = new.shape[1]
        if not k:
            return
        beside = self.V.T @ Anew
        own = new.T @ Anew
        self.energy = np.block([[self.energy, beside], [beside.T, (own + own.T) / 2]])
        del Anew
        self.V, self._room = self._room.joined(self.V, new)
        inside = np.zeros((len(self.terms), m + k, m + k))
        inside[:, :m, :m] = self.inside
        for own, term in zip(inside, self.terms, strict=True):
            own[:, m:] = self.V[term.rows].T @ term.image(new)
            own[m:, m:] = (own[m:, m:] + term.sign * own[m:, m:].T) / 2
            own[m:, :m] = term.sign * own[:m, m:].T
        self.inside = inside
        known = np.zeros((len(self.terms), k), dtype=bool)
        known[:1] = modes
        known[[term.modal for term in self.terms]] = modes
        known[[term.spanned for term in self.terms]] = True
        self._known = np.hstack([self._known, known])

    def at(self, weights: Sequence[Weights]) -> Self:
        """The same basis for a pencil whose terms have other weights; directions added to one of the two are not in the other."""
        found = copy(self)
        found.terms = [term if term.weights == given else replace(term, weights=given)
                       for term, given in zip(self.terms, weights, strict=True)]
        return found

    @property
    def lost(self) -> Array:
        """Products of the parts of A⁻¹T_iv_a and A⁻¹T_jv_b outside V, in the norm of A, shape (p, m, p, m).

        The parts in V are subtracted before the products are taken: differences of squares would lose digits.
        """
        p, m, old = len(self.terms), self.size, self._lost.shape[1]
        if old == m:
            return self._lost
        lost = np.zeros((p, m, p, m))
        grown = self.inside[:, old:, :old]
        for i, j in np.ndindex(p, p):
            lost[i, :old, j, :old] = self._lost[i, :, j] - grown[i].T @ grown[j]
        self._lost = lost  # frees the old array
        inside = np.einsum("aij,aij->aj", self.inside, self.inside)  # squares of all images; here their parts in V
        inside[:, :old] = self._whole
        step = max(1, BLOCK // max(p, 1))  # two processes share the solves, and few columns take memory beside V
        for start in range(old, m, step):
            at = slice(start, min(start + step, m))
            k, sought = at.stop - start, [i for i in range(p) if not self._known[i, at].all()]
            B = np.zeros((len(self.V), k * len(sought)))
            for turn, i in enumerate(sought):
                B[self.terms[i].rows, turn * k:(turn + 1) * k] = self.terms[i].image(self.V[:, at])
            within = np.hstack([np.zeros((m, 0)), *(self.inside[j][:, at] for j in sought)])
            images = self.solve(B) if sought else B
            del B
            images -= self.V @ within
            squares = np.einsum("ij,ij->j", within, within)
            for turn, j in enumerate(sought):
                own = slice(turn * k, (turn + 1) * k)
                inside[j, at], image = squares[own], images[:, own]
                if self.kept and image.any():
                    unit = float(max(image.max(), -image.min()))  # within the range of single precision
                    self._outside = [*self._outside, (j, at, unit, np.divide(image, unit, casting="same_kind", out=np.empty(
                        image.shape, dtype=np.float32)))]
            for i, term in enumerate(self.terms):
                for rows, js in ((slice(0, old), sought), (slice(old, m), [j for j in sought if j >= i])):  # others by symmetry
                    if js and rows.start < rows.stop:
                        products = term.sign * (self.V[term.rows, rows].T @ times(term.acting, images[:, -k * len(js):]))
                        lost[i, rows, js, at] = products.reshape(-1, len(js), k).transpose(1, 0, 2)
        for i, j in np.ndindex(p, p):
            lost[i, old:, j, :old] = lost[j, :old, i, old:].T
            if i > j:
                lost[i, old:, j, old:] = lost[j, old:, i, old:].T
            elif i == j:
                lost[i, old:, i, old:] = (lost[i, old:, i, old:] + lost[i, old:, i, old:].T) / 2
        where = np.nonzero(self._known)
        lost[where] = 0.0
        lost[(slice(None), slice(None), *where)] = 0.0
        inside[:, old:] += np.maximum(np.einsum("aiai->ai", lost[:, old:, :, old:]), 0.0)
        self._lost, self._whole, self._seen = lost, inside, np.append(self._seen, np.full(m - old, m))
        return lost

    @property
    def noise(self) -> Array:
        """Bounds (p, m) of the errors in the diagonal of `lost`, from rounding or residuals of modes; evaluate `lost` first.

        If V is orthonormal to fewer digits, squares of images in V have no more correct digits.
        """
        off = float(np.linalg.norm(self.energy - np.eye(self.size)))
        return np.where(self._known, ACCEPTED**2, max(16 * EPS, off)) * self._whole

    def coercivity(self, re: tuple[float, float], top: float) -> float:
        """c with Re xᴴP(s)x ≥ c xᴴAx for all x outside V, Re s in `re`, which contains 0, and |Im s| ≤ top."""
        return 1 + sum(term.least(re, top) for term in self.terms)

    @property
    def matrices(self) -> Array:
        """K, D and M of P_U = K + sD + s²M, shape (3, m, m), symmetric if those of P are."""
        found = np.einsum("ik,iab->kab", np.reshape([term.weights for term in self.terms], (-1, 3)), self.inside)
        found[0] += self.energy
        return found

    def products(self, s: complex) -> tuple[Array, Array]:
        """XᴴX for X = P_LU and for X = P_ULᴴ at s, in the norm on L, (m, m) each."""
        weights = np.array([complex(term.weight(np.array(s))) for term in self.terms])
        lost, signs = self.lost, [term.sign for term in self.terms]
        right, left = (own @ np.tensordot(own.conj(), lost, 1) + np.diag((np.abs(own) ** 2) @ self.noise)
                       for own in (weights, weights.conj() * signs))
        return right, left

    def image(self, i: int, x: Array) -> Array:
        """T_iVx, (n, k)."""
        found = np.zeros((len(self.V), x.shape[1]), dtype=x.dtype)
        found[self.terms[i].rows] = self.terms[i].image(self.V @ x)
        return found

    def forces(self, s: Array, x: Array, adjoint: bool = False) -> Array:
        """(P(s) - A)Vx, or with Pᴴ if `adjoint`, each column with its own s; real and imaginary parts alternate, (n, 2k)."""
        moved = self.V @ np.ascontiguousarray(x).view(float)
        found = np.zeros((len(moved), x.shape[1]), dtype=complex)
        for term in self.terms:
            weight = term.weight(s)
            found[term.rows] += term.image(moved).view(complex) * (term.sign * weight.conj() if adjoint else weight)
        return found.view(float)

    def coefficients(self, s: Array, x: Array, adjoint: bool = False) -> Array:
        """C (p, m, 2k) with (P(s) - A)Vx = Σ T_iVC_i, or with Pᴴ if `adjoint`; real and imaginary parts alternate."""
        weights = [term.weight(s) for term in self.terms]
        return np.stack([np.ascontiguousarray(x * (term.sign * weight.conj() if adjoint else weight)).view(float)
                         for term, weight in zip(self.terms, weights, strict=True)])

    def join(self, residuals: Sequence[Array], least: float) -> bool:
        """Extend V by combinations of residuals whose squares in the norm of A exceed `least`; return whether V has grown.

        Residuals are given by their `coefficients` C (p, m, l). Their products follow from `lost`, so only chosen directions take
        solves.
        """
        C, rows = np.concatenate(residuals, axis=2), len(self.terms) * self.size
        if not C.size:
            return False
        flat = C.reshape(rows, -1)
        size, mix = la.eigh(flat.T @ (self.lost.reshape(rows, rows) @ flat))
        keep = size > least
        log.info("%d of %d residuals, up to %.1e, join %d columns", keep.sum(), len(size), max(size[-1], 0.0)**0.5, self.size)
        if not keep.any():
            return False
        C = C @ (mix[:, keep] / np.sqrt(size[keep]))
        R = np.empty((len(self.V), C.shape[2]))
        for at in few_at_a_time(C.shape[2], self.size):
            R[:, at] = self._outside_of(C[..., at])
        return self.add(R)

    def residuals(self, s: Array, x: Array, adjoint: bool = False) -> Array:
        """The part of A⁻¹P(s)Vx outside V, or with Pᴴ if `adjoint`; real and imaginary parts of columns alternate, (n, 2k)."""
        if not self.kept:
            loads = self.forces(s, x, adjoint)
            return np.asarray(self.solve(loads) - self.V @ (self.V.T @ loads))
        return self._outside_of(self.coefficients(s, x, adjoint))

    def _outside_of(self, C: Array) -> Array:
        """The part of Σ A⁻¹T_iVC_i outside V, (n, l)."""
        if not self.kept:
            loads = np.zeros((len(self.V), C.shape[2]))
            for i, own in enumerate(C):
                loads[self.terms[i].rows] += self.terms[i].image(self.V @ own)
            found = np.asarray(self.solve(loads))
            found -= self.V @ (self.V.T @ loads)
            return found
        assert self.lost.size and self._seen.size == self.size
        sizes = [size * float(np.abs(C[i, at]).max(initial=0.0)) for i, at, size, _ in self._outside]
        unit = max(sizes, default=0.0) or 1.0
        total = np.zeros((len(self.V), C.shape[2]), dtype=np.float32)
        for i, at, size, block in self._outside:
            total += block @ (C[i, at] * (size / unit)).astype(np.float32)
        later = np.arange(self.size)[:, None] >= self._seen  # columns of V that were added since
        within = sum(np.where(later, own, 0.0) @ given for own, given in zip(self.inside, C, strict=True))
        return np.asarray(unit * total.astype(float) - self.V @ within)


class RealPairs(NamedTuple):
    """Sums Σ w_k x_k z_kᴴ over eigenpairs in the order of LAPACK, by products of real matrices.

    `first` are the first pairs of each two conjugate ones. For these two, X (m, 2m) and Zᵀ (2m, m) have real and imaginary parts.
    """

    first: Array
    X: Array
    ZT: Array

    @classmethod
    def of(cls, nu: Array, x: Array, z: Array) -> RealPairs:
        """Of x and z (m, 2m)."""
        first = np.flatnonzero(nu.imag > 0)
        return cls(first, real_columns(first, x), np.ascontiguousarray(real_columns(first, z).T))

    def sum(self, weights: Array) -> Array:
        """Σ w_k x_k z_kᴴ, (m, m), complex."""
        found, both = weights[:, None] * self.ZT, self.first + 1
        even, odd = weights[self.first] + weights[both], 1j * (weights[self.first] - weights[both])
        real, imag = self.ZT[self.first], self.ZT[both]
        found[self.first] = even[:, None] * real - odd[:, None] * imag
        found[both] = odd[:, None] * real + even[:, None] * imag
        return times(self.X, found)


def real_columns(first: Array, x: Array) -> Array:
    """x with real and imaginary parts of the columns `first` in place of these and the next columns, their conjugates."""
    found = x.real.copy()
    found[:, first + 1] = x[:, first].imag
    return found


def complex_columns(first: Array, real: Array) -> Array:
    """The inverse of `real_columns`."""
    found = real.astype(complex)
    found[:, first] += 1j * real[:, first + 1]
    found[:, first + 1] = found[:, first].conj()
    return found


class Coupling:
    """The eigenpairs of P_U = VᵀP(s)V and their coupling with the complement of V; see `energy_basis`.

    P_U⁻¹ = Σ x_k z_kᴴ ν_k / (1 - tν_k) with ν = 1/(λ - σ) and t = s - σ, which allows infinite λ: ν = 0.

    Parameters
    ----------
    basis : EnergyBasis
    shift : float
        σ, real.
    nu : ndarray, shape (2m,)
    x, z : ndarray, shape (m, 2m)
    unit : float
        The size of the region.
    """

    def __init__(self, basis: EnergyBasis, shift: float, nu: Array, x: Array, z: Array, unit: float) -> None:
        self.basis, self.shift, self.nu, self.x, self.z, self.unit = basis, shift, nu, x, z, unit
        self.lost, self.noise = basis.lost, basis.noise
        self.contour = Contour(unit)  #: in which eigenvalues are counted

    @classmethod
    def of(cls, basis: EnergyBasis, unit: float) -> Coupling:
        """By LAPACK on the companion form of P_U, shifted to σ = 1.3 times the largest |λ|, in coordinates with A + |s|²M = I.

        In these coordinates rigid motion does not swamp all other motion.
        """
        (shift, nu, x, z), inner, scaled = eigenpairs(basis.matrices, unit)
        found = cls(basis, shift, nu, x, z, unit)
        found.wrong = _wrong(inner, *scaled, found)
        return found

    @cached_property
    def wrong(self) -> float:
        """Estimate of the largest row of SP_U - I at some s, where the sum S stands for P_U⁻¹: LAPACK's own rounding."""
        return _wrong(tuple(self.basis.matrices), self.x, self.z, self)

    @cached_property
    def each(self) -> Array:
        """All λ in the order of their vectors; infinite λ are inf or NaN."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.shift + 1 / self.nu

    @cached_property
    def values(self) -> Array:
        """The finite λ."""
        return self.each[self.nu != 0]

    @cached_property
    def pairs(self) -> RealPairs:
        """For sums over all pairs."""
        return RealPairs.of(self.nu, self.x, self.z)

    @cached_property
    def both_products(self) -> tuple[Array, Array]:
        """`_products` of all right and all left vectors; those of conjugates are conjugate."""
        both, known = self.pairs.first + 1, self.nu.imag >= 0
        found = []
        for x in (self.x, self.z):
            found.append(np.empty((len(known), *2 * [len(self.basis.terms)]), dtype=complex))
            found[-1][known] = self._products(x[:, known])
            found[-1][both] = found[-1][both - 1].conj()
        return found[0], found[1]

    def margin(self, contour: Contour, c: float) -> tuple[float, list[Array]]:
        """Upper bound of ‖P_LU P_U⁻¹ P_UL‖ / c on the contour, by pieces; and directions that lower it if it is not below `SAFE`.

        Eigenpairs far from the contour (see `near`) are bounded together by the norms of their images: they are many, and each
        has a small share. Each eigenpair near the contour is bounded by its residual.
        """
        at, far, wide = self.near_and_far(contour, c)
        products = self._products(self.x[:, at]), self._products(self.z[:, at])
        room, worst, seen = SAFE - min(far, SAFE / 2), 0.0, 0
        most, where = np.zeros(len(at)), np.zeros(len(at), dtype=complex)
        start, stop = pieces(128)
        while len(start):
            s, reach = discs_on(contour, start, stop)
            total, seen = self._shares(s, reach, at, products).sum(axis=1) / c, seen + len(s)
            good = total < room
            worst = max(worst, float(total[good].max(initial=0.0)))
            start, stop, s = start[~good], stop[~good], s[~good]
            here = self._shares(s, np.zeros(len(s)), at, products) / c
            # where the middle itself is not excluded, or pieces are as small as rounding, halving does not help
            stuck = (here.sum(axis=1) >= room) | (stop - start < 1e6 * EPS) | (seen > PIECES)
            if stuck.any():
                worst, first = np.inf, here[stuck].argmax(axis=0)
                high = here[stuck].max(axis=0)
                where, most = np.where(high > most, s[stuck][first], where), np.maximum(high, most)
            middle = (start + stop)[~stuck] / 2
            start, stop = np.append(start[~stuck], middle), np.append(middle, stop[~stuck])
        if far + worst < SAFE:
            return far + worst, []
        both = 1 + any(term.sign < 0 for term in self.basis.terms)
        new = [self.basis.solve(self.basis.image(i, x)) for i, x in wide[:both]] if far > SAFE / 2 else []
        order = np.argsort(-most)[:int(np.count_nonzero(most > 0.2 * SAFE / max(1, len(at))))]
        order = order[self.nu[at[order]].imag <= 0][:WIDER]  # one of a conjugate pair is enough
        if len(order):
            s = where[order]
            new += [self.basis.residuals(s, x[:, at[order]], bool(i)) for i, x in enumerate((self.x, self.z)[:both])]
        return far + worst, new

    def near(self, contour: Contour, away: float = NEARBY) -> tuple[Array, Array]:
        """Which eigenpairs come within `away` of the contour and must be bounded one by one; and min |s - λ| / |λ - σ|."""
        s, reach = discs_on(contour, *pieces(BATCH))
        distance = (self._apart(s, slice(None)) - reach[:, None] * np.abs(self.nu)).min(axis=0)
        return distance <= away, distance

    def near_and_far(self, contour: Contour, c: float) -> tuple[Array, float, list[tuple[int, Array]]]:
        """The indices of eigenpairs near the contour, and the result of `_far` for the others."""
        near, distance = self.near(contour)
        return np.flatnonzero(near), *self._far(contour, c, np.flatnonzero(~near), distance[~near])

    def _far(self, contour: Contour, c: float, at: Array, near: Array) -> tuple[float, list[tuple[int, Array]]]:
        """Bound of the share of the eigenpairs `at`; and for P_LU and P_UL the term with the largest part, and its directions.

        On the contour |1 - tν| ≥ near. Σ |weight| ‖image of X‖ bounds ‖P_LU X‖. Conjugates have the same weights, so real and
        imaginary parts stand for them.
        """
        scale, bound, found = np.sqrt(np.abs(self.nu[at]) / near), 1 / c, []
        if not len(at):
            return 0.0, []
        for x in (self.x[:, at] * scale, self.z[:, at] * scale):
            real = np.where(self.nu[at].imag >= 0, x.real, x.imag) * np.where(self.nu[at].imag, np.sqrt(2), 1.0)
            root: Array = np.asarray(np.linalg.qr(real.T, mode="r"))  # the same XXᵀ, with at most m rows
            grams, last = [root @ (self.lost[i, :, i] @ root.T) for i in range(len(self.basis.terms))], len(root) - 1
            lengths = []
            for i, (term, gram) in enumerate(zip(self.basis.terms, grams, strict=True)):
                largest = float(la.eigvalsh(gram, subset_by_index=[last, last], check_finite=False)[0])
                rounding = float(self.noise[i] @ (real**2).sum(axis=1))
                lengths.append(term.largest(contour.size) * np.sqrt(max(largest, 0.0) + rounding))
            bound *= sum(lengths)
            most = int(np.argmax(lengths))
            values, vectors = la.eigh(grams[most], subset_by_index=[max(0, last + 1 - WIDER), last], check_finite=False)
            found.append((most, root.T @ vectors[:, values > 0.04 * values[-1]]))
        return bound, found

    def _products(self, x: Array) -> Array:
        """For each column of x (m, k) the products of its images by the terms, outside V, shape (k, p, p)."""
        p, (m, k) = len(self.basis.terms), x.shape
        real, products = np.ascontiguousarray(x, dtype=complex).view(float), np.zeros((k, p, p), dtype=complex)
        for a in range(p):
            images = (self.lost[a, :, a:].reshape(-1, m) @ real).view(complex).reshape(m, p - a, k)
            products[:, a, a:] = np.einsum("ik,ibk->kb", x.conj(), images)
            products[:, a:, a] = products[:, a, a:].conj()
        diagonal = np.arange(len(self.basis.terms))
        products[:, diagonal, diagonal] += np.einsum("am,mk->ka", self.noise, np.abs(x) ** 2)
        return products

    def _lengths(self, s: Array, reach: Array, products: tuple[Array, Array]) -> list[Array]:
        """Bounds (l, k) of ‖P_LU x_k‖ and ‖z_kᴴP_UL‖ for |s' - s| ≤ reach (l, 1), of x and z with these `_products`."""
        terms, found = self.basis.terms, []
        weights = np.stack([term.weight(s) for term in terms], axis=1)
        changes = np.hstack([term.change(s[:, None], reach) for term in terms])
        signs = np.array([term.sign for term in terms])
        for own, w in zip(products, (weights, signs * weights.conj()), strict=True):
            outer = (w.conj()[:, :, None] * w[:, None, :]).reshape(len(s), len(terms) ** 2)
            square = (outer @ own.reshape(len(own), len(terms) ** 2).T).real
            lengths = np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0))
            found.append(np.sqrt(np.maximum(square, 0.0)) + changes @ lengths)
        return found

    def _apart(self, s: Array, at: Array | slice) -> Array:
        """|s - λ| / |λ - σ| of these eigenpairs, shape (len(s), k); 1 of infinite λ."""
        nu = self.nu[at]
        with np.errstate(invalid="ignore"):
            return np.where(nu != 0, np.abs(s[:, None] - self.each[at]) * np.abs(nu), 1.0)

    def _shares(self, s: Array, reach: Array, at: Array | slice, products: tuple[Array, Array]) -> Array:
        """Bounds of ‖P_LU x_k‖ |ν_k/(1 - tν_k)| ‖z_kᴴP_UL‖ of these pairs for |s' - s| ≤ reach, shape (len(s), k)."""
        size = np.abs(self.nu[at])
        found = np.empty((len(s), len(size)))
        for first in range(0, len(s), BATCH):
            rows = slice(first, first + BATCH)
            here, far = s[rows], reach[rows, None]
            near = self._apart(here, at) - far * size
            right, left = self._lengths(here, far, products)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = size / np.where(near > 0, near, np.nan) * right * left
            found[rows] = np.where(np.isfinite(share), share, np.inf)
        return found


def eigenpairs(matrices: Array, unit: float) -> tuple[tuple[float, Array, Array, Array], tuple[Array, ...], tuple[Array, Array]]:
    """σ, ν = 1/(λ - σ) (2m,), X and Z (m, 2m) of K + sD + s²M, see `Coupling`; K, D, M and X, Z in inner coordinates.

    `matrices` are K, D and M (3, m, m). In the inner coordinates I + unit²M is the unit matrix.
    """
    m = len(matrices[0])
    K, D, M = matrices
    with one_thread(m < FEW):
        one, T = np.eye(m), la.inv(la.cholesky(np.eye(m) + unit**2 * (M + M.T) / 2))
        K, D, M = T.T @ K @ T, T.T @ D @ T, T.T @ M @ T
        shift = AWAY * unit
        P, slope = K + shift * D + shift**2 * M, D + 2 * shift * M
        companion = np.block([[-np.linalg.solve(P, np.hstack([unit * slope, unit**2 * M]))], [one, np.zeros((m, m))]])
        nu, right = np.linalg.eig(companion)  # SciPy's eig holds the lock of Python
        del companion  # two threads may be here, each with arrays of (2m)²
        nu = nu.astype(complex)
        # for multiple λ LAPACK's own left vectors are not dual to the right ones. Real and imaginary parts span the same space
        first = np.flatnonzero(nu.imag > 0)
        real = real_columns(first, right)
        del right
        x, z = real[m:].copy(), np.linalg.solve(P.T, np.linalg.inv(real)[:, :m].T) * unit
        del real
        z[:, np.append(first, first + 1)] /= 2
        length = [np.square(part).sum(axis=0) for part in (z, x)]
        for own in length:
            own[first] = own[first + 1] = own[first] + own[first + 1]
        even = (length[0] / length[1]) ** 0.25
        x *= even
        z /= even
        X, Z = (complex_columns(first, T @ part) for part in (x, z))
        return (shift, nu / unit, X, Z), (K, D, M), (complex_columns(first, x), complex_columns(first, z))


def _wrong(matrices: Sequence[Array], x: Array, z: Array, small: Coupling, number: int = 20) -> float:
    """See `Coupling.wrong`, from products with random vectors; the matrices K, D, M and the vectors in any coordinates.

    With this `number` of vectors, a row 1000 times as large as found has a probability below 10⁻⁵⁰.
    """
    K, D, M = matrices
    w, found = np.random.default_rng(0).standard_normal((len(K), number)), 0.0
    for s in small.unit * np.exp(1j * np.linspace(0.1, 3.0, 5)):  # five points of the upper half plane, of the region's size
        with np.errstate(all="ignore"):
            weights = small.nu / (1 - (s - small.shift) * small.nu)
            off = (x * weights) @ (z.conj().T @ (K @ w + s * (D @ w) + s**2 * (M @ w))) - w
            # of a row r, the mean of |rw|² is ‖r‖²
            found = np.fmax(found, np.linalg.norm(off, axis=1).max(initial=0.0) / number**0.5)
            found = found if np.isfinite(off).all() else np.inf
    return float(found)


def few_at_a_time(columns: int, size: int) -> list[slice]:
    """Slices of this number of columns, each of which takes little memory beside a basis of `size` columns."""
    step = min(BLOCK, max(BLOCK // 4, size // 8))
    return [slice(at, min(at + step, columns)) for at in range(0, columns, step)]


def pieces(number: int) -> tuple[Array, Array]:
    """Starts and ends of `number` equal pieces of a contour, from 0 to 1."""
    ends = np.linspace(0.0, 1.0, number + 1)
    return ends[:-1], ends[1:]


def of_pieces(of_one: Callable[..., Array], *columns: Array) -> Array:
    """The results of a function for each piece, stacked, by threads."""
    return np.array(each_of(of_one, *columns))


def each_of(of_one: Callable[..., T], *columns: Any) -> list[T]:
    """The results of a function for each set of arguments, by threads."""
    return list(by_threads(of_one, *columns))


def discs_on(contour: Contour, start: Array, stop: Array) -> tuple[Array, Array]:
    """Middles and radii of discs that cover pieces of the contour."""
    s = contour.at((start + stop) / 2)
    return s, np.maximum(np.abs(contour.at(start) - s), np.abs(contour.at(stop) - s))
