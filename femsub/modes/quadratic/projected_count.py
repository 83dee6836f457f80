"""The number of eigenvalues in a rectangle or disc, for damping and friction of any rank: projection on the undamped modes.

A brake is often projected on its undamped modes, and the result trusted. Here a bound of what the projection leaves out tells
whether the number of its eigenvalues is right. All factors are real and positive definite, so any size can be counted.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import (
    FEW,
    QUADRATIC,
    Carried,
    Difference,
    Handle,
    SignsBeside,
    are_definite,
    check_columns,
    check_room,
    halves,
    inertia,
    one_thread,
    orthonormal,
    shared_factor,
    signs,
    smooth_shape,
    solved,
    times,
    translations,
)
from femsub.checks import EPS, Array, Matrix, Tally
from femsub.errors import FemsubError, MissedModesError, NotConvergedError, SingularMatrixError
from femsub.modes.block_lanczos import block_lanczos
from femsub.modes.normal_modes import NormalModes, counted_beside, counted_early, modes_below
from femsub.modes.quadratic.region import Contour, listed
from femsub.modes.shift_invert import ShiftInvert

if TYPE_CHECKING:
    from femsub.model import Pencil

log = logging.getLogger(__name__)

REACH = 2.5  # undamped modes are kept up to so many times the largest Im λ
LIFTS = (0.0, 0.2, 1.0, 8.0)  # of M, in units of the largest |λ|², that may make the stiffness positive definite
MORE, ROUGH, FEW_RESTARTS = 4, 1e-4, 4  # modes beyond half of the eigenvalues, tolerance of θ and restarts for a radius
MOTION = 1e-9  # quotient relative to the largest up to which a shape is rigid motion, or nearly
STILL = 1e-12  # |Dz| relative to |D||z| below which damping does not act on rigid motion z
COLUMNS = 500  # of n numbers that are needed at most while a process looks for strong damping
DAMPED = (0.2, 0.5)  # share of the stiffness that damping may reach outside the basis at the largest |Re λ|
SAFE = 0.9  # required margin; the theorem needs 1
AWAY = 1.3  # σ, in units of the largest |λ|
FAR = 0.1  # |s - λ| / |λ - σ| on all of the contour above which an eigenvalue is far from it
POINTS, RIGHT = 5, 1e-6  # at which the sum over eigenpairs is compared with the inverse, and its largest error
ROUNDS = 8  # of enrichment
WIDER = 40  # residuals of each kind that enrich the basis in one round
PIECES = 20_000  # of the contour at most
FEW_ROWS = 0.3  # share of the rows up to which the others are left out of products
SHORT = 1e-10  # of the contour: a piece that is not halved again
BATCH = 512  # pieces looked at together


Bounds = tuple[Array, float, float]  # shapes of strong damping, d and g: see `Projection`


@dataclass(frozen=True)
class Count:
    """`number` eigenvalues lie inside the contour, conjugates included; `values` are those of the projection, nearly the same."""

    contour: Contour
    number: int
    values: Array = field(repr=False)
    size: int  #: of the projection
    margin: float  #: 1 is the limit of the theorem

    @property
    def where(self) -> str:
        """The region, for messages."""
        return self.contour.where

    @property
    def disc(self) -> tuple[float, int] | None:
        """The radius of a disc, and the number."""
        return (self.contour.radius, self.number) if self.contour.sides is None else None

    def tally(self, values: Array) -> Tally:
        """What a search has found inside, by λ with Im λ ≥ 0, against the number."""
        return Tally(listed(values[self.contour.encloses(values)]), self.number)


@dataclass(frozen=True)
class Part:
    """A term of P(s): a matrix and its weight; in Pᴴ the weight is conj(weight) times `sign`, which is -1 of a skew matrix."""

    matrix: Matrix
    weight: Callable[[Array], Array]
    sign: float = 1.0
    linear: bool = False  #: whether the weight is s itself

    @cached_property
    def rows(self) -> Array | slice:
        """The rows that are not 0, where they are few, as those of a contact."""
        found = np.flatnonzero(np.diff(self.matrix.indptr))
        return found if len(found) < FEW_ROWS * self.matrix.shape[0] else slice(None)

    @cached_property
    def acting(self) -> Matrix:
        """These rows of the matrix."""
        return self.matrix if isinstance(self.rows, slice) else self.matrix[self.rows]


class Projection:
    """P(s) = s²M + sD + K on a basis V (n, m), VᵀAV = I with A = (K + Kᵀ)/2 + μM, and a bound of what V leaves out.

    Rigid motion that nothing damps, P(s)z = s²Mz, stands apart: its eigenvalues are 0. V holds all other undamped modes up to
    2.5 times the largest Im λ, by their inertia count, and all shapes of strong damping. So for every x outside, VᵀAx = 0 and
    xᴴAx = 1, and for every s = a + ib inside the contour

        Re xᴴP(s)x ≥ c = 1 - (b² + μ)/(ω² + μ) - |a|d - |b|g

    with the first mode ω that is left out, |xᴴ(D + Dᵀ)x| ≤ 2d and |xᴴ(D - Dᵀ)x| ≤ 2g; Cholesky factors of dA ± (D + Dᵀ)/2 prove
    both. If c > 0 and

        ‖R (VᵀPV)⁻¹ L‖ < c on the contour,   R = P V and L = Vᵀ P as far as they lie outside V, in the norms of A and A⁻¹,

    then P has as many eigenvalues inside as VᵀPV has: none is outside alone, and none crosses the contour while the coupling
    grows from 0 to its value. The norms come from A⁻¹[M, D, K]V, for all s at once.

    Raises
    ------
    SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError
        There is no such A or V: M is unsymmetric, K far from definite, or damping so strong that V would have more than `most`
        columns. LAPACK finds all eigenvalues of VᵀPV, so that it is no larger than a model may be of which it finds all.
    """

    def __init__(self, pencil: Pencil, outer: Contour, most: int = QUADRATIC) -> None:
        if not pencil.symmetric[0]:
            raise SingularMatrixError("M is unsymmetric")
        self.outer, self.most, M, n = outer, most, pencil.M, pencil.size
        self.why = ""  #: there is no count
        none = sp.csr_array(M.shape)
        damping, gyroscopic = (pencil.D, none) if pencil.symmetric[1] else halves(pencil.D)
        stiffness, circulatory = (pencil.K, none) if pencil.symmetric[2] else (
            pencil.halves if pencil.K0 is pencil.K else halves(pencil.K))

        @contextmanager
        def bounds(handle: ShiftInvert, lift: float) -> Iterator[Callable[[int], Bounds]]:
            self.factor, self.mu = handle.factor, lift - handle.sigma
            solve = self.factor.solve
            self.A = Difference(stiffness, M, -self.mu)

            def found(modes: int) -> Bounds:
                none = looked()
                return *_strong(self.A, damping, solve, outer.side, none, modes, most), _bound_of_skew(self.A, gyroscopic, solve)

            with _none_strong(self.A, damping, outer.side, handle.factor) as looked:
                yield found

        modes, lift, (strong, d, g) = _undamped(stiffness, M, outer, stiffness is pencil.K, pencil.rigid_motion, bounds, most)
        self.free, rest = _free(modes, [damping, gyroscopic, circulatory])
        self.momenta = M @ self.free
        beyond = modes.counted[0] ** 2 - lift + self.mu
        self.least = 1 - (outer.top**2 + self.mu) / beyond - outer.side * d - outer.top * g
        given = (Part(M, lambda s: s * s - self.mu), Part(damping, np.array, linear=True),
                 Part(gyroscopic, np.array, -1.0, linear=True), Part(circulatory, np.ones_like, -1.0))
        self.parts = [part for part in given if part.matrix is M or part.matrix.nnz]
        self.V, self.energy = np.zeros((n, 0)), np.zeros((0, 0))  # VᵀAV: the unit matrix but for rounding
        # of V, in blocks of columns: images in the parts' rows, and A⁻¹ times them outside V in single precision, with a unit
        self.images: list[list[Array]] = [[] for _ in self.parts]
        self.outside: list[list[tuple[float, Array]]] = [[] for _ in self.parts]
        self.inside = np.zeros((len(self.parts), 0, 0))  # Vᵀ times the images
        self.gram = np.zeros((len(self.parts), 0, len(self.parts), 0))  # of A⁻¹ times the images
        self.counted: Coupling | None = None  # the last one, if the count was proved
        still = np.zeros(rest.shape[1] - len(modes.eigenvalues) + modes.rigid)
        self.add(rest, np.append(still, modes.eigenvalues[modes.rigid:]) - lift + self.mu)
        if strong.shape[1]:
            self.add(strong)

    @property
    def size(self) -> int:
        return int(self.V.shape[1])

    def solve(self, B: Array) -> Array:
        """A⁻¹B."""
        return solved(self.factor, B)

    def add(self, new: Array, values: Array | None = None) -> bool:
        """Append directions, made orthonormal; whether there were any. Modes have `values`: Ax = Mx value, xᵀMx = 1."""
        m, p = self.size, len(self.parts)
        check_columns("the pencil", len(new), int((1.5 * p + 2) * (m + 2 * new.shape[1])))
        check_room("the count by projection", 8.0 * (3 * p * p + 24) * (m + new.shape[1])**2)  # products, and the eigenproblem
        given = new = new - self.free @ (self.momenta.T @ new)
        new, Anew = orthonormal(np.array(new, order="C"), self.A.__matmul__, self.V)
        k = new.shape[1]
        if not k:
            return False
        beside = self.V.T @ Anew
        self.energy = np.block([[self.energy, beside], [beside.T, new.T @ Anew]])
        self.V = np.hstack([self.V, new]) if m else new
        fresh = [times(part.acting, new) for part in self.parts]
        inside = np.zeros((p, m + k, m + k))
        inside[:, :m, :m] = self.inside
        for i, (part, image, blocks) in enumerate(zip(self.parts, fresh, self.images, strict=True)):
            inside[i, :, m:] = self.V[part.rows].T @ image
            inside[i, m:, :m] = part.sign * inside[i, :m, m:].T
            blocks.append(image)
        self.inside = inside
        known = [] if values is None else [given @ ((given.T @ fresh[0]) / values[:, None])]  # A⁻¹M of modes needs no solve
        inverse = known + self._inverses(range(len(known), p), fresh)
        gram = np.zeros((p, m + k, p, m + k))
        gram[:, :m, :, :m] = self.gram
        for i, (part, blocks) in enumerate(zip(self.parts, self.images, strict=True)):
            for j, solution in enumerate(inverse):
                acting = solution[part.rows]
                gram[i, :, j, m:] = np.vstack([block.T @ acting for block in blocks])
            gram[:, m:, i, :m] = gram[i, :m, :, m:].transpose(1, 2, 0)
        self.gram = gram
        self._leave_outside(m, inverse)
        return True

    def _leave_outside(self, m: int, inverse: list[Array]) -> None:
        """What the new A⁻¹ images (n, k), and those of the first m columns of V, have outside V."""
        size = float(np.abs(self.V[:, m:]).max())  # within the range of single precision, whatever the units of the pencil
        new = (self.V[:, m:] / size).astype(np.float32)
        for blocks, solution, inside in zip(self.outside, inverse, self.inside, strict=True):
            at = 0
            for unit, block in blocks:
                block -= new @ (inside[m:, at:(at := at + block.shape[1])] * (size / unit)).astype(np.float32)
            rest = self.V @ inside[:, m:]
            np.subtract(solution, rest, out=rest)
            unit = float(max(rest.max(), -rest.min())) or 1.0
            blocks.append((unit, np.divide(rest, unit, out=np.empty(rest.shape, dtype=np.float32), casting="same_kind")))

    def _inverses(self, which: range, images: list[Array]) -> list[Array]:
        """A⁻¹ times these images, solved for together."""
        if not which:
            return []
        k = images[0].shape[1]
        B = np.zeros((len(self.V), k * len(which)))
        for at, i in enumerate(which):
            B[self.parts[i].rows, at * k:(at + 1) * k] = images[i]
        return np.split(self.solve(B), len(which), axis=1)

    def image(self, i: int, x: Array) -> Array:
        """A part times Vx, (n, k)."""
        found = np.zeros((len(self.V), x.shape[1]), dtype=x.dtype)
        ends = np.cumsum([block.shape[1] for block in self.images[i]])
        for block, own in zip(self.images[i], np.split(x, ends[:-1]), strict=True):
            found[self.parts[i].rows] += block @ own
        return found

    def residuals(self, s: Array, x: Array, adjoint: bool = False) -> tuple[Array, float]:
        """A⁻¹P(s)Vx outside V column by column, or of Pᴴ, by a unit: real and imaginary parts by turns, (n, 2k). And the unit."""
        terms = []
        for part, blocks in zip(self.parts, self.outside, strict=True):
            weight = part.weight(s)
            weighted = np.ascontiguousarray(x * (part.sign * weight.conj() if adjoint else weight)).view(float)
            ends = np.cumsum([block.shape[1] for _, block in blocks])
            terms += [(block, own * size) for (size, block), own in zip(blocks, np.split(weighted, ends[:-1]), strict=True)]
        unit = max(float(np.abs(own).max(initial=0.0)) for _, own in terms) or 1.0
        total = np.zeros((len(self.V), 2 * x.shape[1]), dtype=np.float32)
        for block, own in terms:
            total += block @ (own / unit).astype(np.float32)
        return total, unit

    def on(self, choose: Callable[[Array], Contour]) -> Count | None:
        """The count inside a contour that keeps clear of the eigenvalues of VᵀPV; V grows until it is proved. None without."""
        self.why = ""
        if self.least <= 0:
            self.why = f"damping or gyroscopic forces may outweigh the stiffness of other shapes by {1 - self.least:.2g}"
            return None
        if not self.size:
            self.why = "it has no shape besides rigid motion"
            return None
        for _ in range(ROUNDS):
            try:
                small = Coupling(self, choose)
            except la.LinAlgError as error:
                self.why = str(error)
                return None
            if not small.wrong < RIGHT:
                self.why = f"eigenpairs of the projection have errors of {small.wrong:.0e}"
                return None
            margin, new = small.margin()
            if margin < SAFE:
                self.counted = small
                values = np.append(small.values, np.zeros(2 * self.free.shape[1]))
                return Count(small.contour, int(np.count_nonzero(small.contour.encloses(values))), values, self.size, margin)
            self.why = f"on {self.size} shapes the bound of what they leave out is {margin:.2g}, but must be below {SAFE}"
            if self.size > self.most:
                self.why += f", and {self.most} shapes are the limit"
                break
            if not new or not self.add(np.hstack(new)):
                break
        return None


class Coupling:
    """The eigenpairs of VᵀP(s)V, (VᵀPV)⁻¹ = Σ x_k z_kᴴ ν_k / (1 - tν_k), and their coupling with the outside.

    ν = 1/(λ - σ) and t = s - σ, with a real σ at which P is regular, as it need not be at 0.

    `wrong` is what this sum times VᵀPV differs from the unit matrix, at some s: LAPACK's own rounding.
    """

    def __init__(self, whole: Projection, choose: Callable[[Array], Contour]) -> None:
        self.whole = whole
        m, unit = whole.size, whole.outer.size
        inside = whole.inside
        # in coordinates in which A + |s|²M is the unit matrix, rigid motion does not swamp the rest
        T = la.inv(la.cholesky(np.eye(m) + unit**2 * (inside[0] + inside[0].T) / 2))
        own, D, one = T.T @ inside @ T, np.zeros((m, m)), np.eye(m)
        K = T.T @ whole.energy @ T - whole.mu * own[0]
        for part, matrix in zip(whole.parts[1:], own[1:], strict=True):
            if part.linear:
                D += matrix
            else:
                K += matrix
        self.shift = AWAY * unit
        P = K + self.shift * D + self.shift**2 * own[0]
        slope = D + 2 * self.shift * own[0]
        companion = np.block([[-np.linalg.solve(P, np.hstack([unit * slope, unit**2 * own[0]]))],
                              [one, np.zeros((m, m))]])
        with one_thread(m < FEW):
            nu, right = la.eig(companion, check_finite=False)
            right = right.astype(complex)  # LAPACK's are real where all λ are
            left = np.linalg.inv(right)[:, :m].conj().T  # LAPACK's own do not belong together where λ is multiple
        self.nu = nu / unit
        x, z = right[m:], np.linalg.solve(P.T, left) * unit
        even = np.sqrt(np.linalg.norm(z, axis=0) / np.linalg.norm(x, axis=0))
        x, z = x * even, z / even
        self.x, self.z = T @ x, T @ z
        self.wrong = 0.0
        for s in unit * np.exp(1j * np.linspace(0.1, 3.0, POINTS)):
            inverse = (x * (self.nu / (1 - (s - self.shift) * self.nu))) @ z.conj().T
            self.wrong = max(self.wrong, float(np.abs(inverse @ (K + s * D + s**2 * own[0]) - one).max()))
        self.contour = choose(self.values)
        self.outside = whole.gram - np.einsum("aij,bik->ajbk", inside, inside, optimize=True)
        self.noise = 16 * EPS * np.abs(np.einsum("aiai->ai", whole.gram))  # of these differences

    @cached_property
    def each(self) -> Array:
        """All λ in the order of their vectors; infinite ones are so or NaN."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.shift + 1 / self.nu

    @cached_property
    def values(self) -> Array:
        """The finite λ."""
        return self.each[self.nu != 0]

    def margin(self) -> tuple[float, list[Array]]:
        """‖R(VᵀPV)⁻¹L‖ / c, bounded on pieces that cover the contour; and directions that lower it if it is not safe.

        Eigenpairs far from the contour count together, by the norms of their images. Each near one counts by its residual.
        """
        s, reach = _discs(self.contour, *_pieces(BATCH))
        near = (np.abs(1 - (s - self.shift)[:, None] * self.nu) - reach[:, None] * np.abs(self.nu)).min(axis=0)
        far, wide = self._far(np.flatnonzero(near > FAR), near[near > FAR])
        at = np.flatnonzero(near <= FAR)
        products = self._products(self.x[:, at]), self._products(self.z[:, at])
        room, worst, seen = SAFE - min(far, SAFE / 2), 0.0, 0
        most, where = np.zeros(len(at)), np.zeros(len(at), dtype=complex)
        start, stop = _pieces(128)
        while len(start):
            s, reach = _discs(self.contour, start, stop)
            total, seen = self._shares(s, reach, at, products).sum(axis=1), seen + len(s)
            good = total < room
            worst = max(worst, float(total[good].max(initial=0.0)))
            start, stop, s = start[~good], stop[~good], s[~good]
            here = self._shares(s, np.zeros(len(s)), at, products)
            stuck = (here.sum(axis=1) >= room) | (stop - start < SHORT) | (seen > PIECES)
            if stuck.any():
                worst, first = np.inf, here[stuck].argmax(axis=0)
                high = here[stuck].max(axis=0)
                where, most = np.where(high > most, s[stuck][first], where), np.maximum(high, most)
            middle = (start + stop)[~stuck] / 2
            start, stop = np.append(start[~stuck], middle), np.append(middle, stop[~stuck])
        if far + worst < SAFE:
            return far + worst, []
        both = 1 + any(part.sign < 0 for part in self.whole.parts)
        new = [self.whole.solve(self.whole.image(i, x)) for i, x in wide[:both]] if far > SAFE / 2 else []
        order = np.argsort(-most)[:int(np.count_nonzero(most > 0.2 * SAFE / max(1, len(at))))]
        order = order[self.nu[at[order]].imag <= 0][:WIDER]  # of a pair one is enough
        if len(order):
            s = where[order]
            new += [self.whole.residuals(s, x[:, at[order]], bool(i))[0] for i, x in enumerate((self.x, self.z)[:both])]
        return far + worst, new

    def _far(self, at: Array, near: Array) -> tuple[float, list[tuple[int, Array]]]:
        """The share of the eigenpairs `at`, |1 - tν| ≥ near on the contour; for R and L the part that has most, and directions.

        Σ |weight| ‖image of X‖ bounds ‖RX‖. Conjugates have the same weights, so real and imaginary parts stand for them.
        """
        scale, bound, found = np.sqrt(np.abs(self.nu[at]) / near), 1 / self.whole.least, []
        if not len(at):
            return 0.0, []
        largest = [self.contour.size if part.linear else float(np.abs(part.weight(np.array([1j * self.contour.size])))[0])
                   for part in self.whole.parts]
        for x in (self.x[:, at] * scale, self.z[:, at] * scale):
            real = np.where(self.nu[at].imag >= 0, x.real, x.imag) * np.where(self.nu[at].imag, np.sqrt(2), 1.0)
            lengths, directions = [], []
            for i, weight in enumerate(largest):
                gram = real.T @ (self.outside[i, :, i] @ real)
                values, vectors = la.eigh(gram, subset_by_index=[max(0, len(at) - WIDER), len(at) - 1], check_finite=False)
                lost = float(self.noise[i] @ (real**2).sum(axis=1))
                lengths.append(weight * np.sqrt(max(float(values[-1]), 0.0) + lost))
                directions.append(real @ vectors[:, values > 0.04 * values[-1]])
            bound *= sum(lengths)
            found.append((int(np.argmax(lengths)), directions[int(np.argmax(lengths))]))
        return bound, found

    def _products(self, x: Array) -> Array:
        """Products of the parts' images of each x (m, k) outside V, shape (k, p, p)."""
        images = np.einsum("aibj,jk->aibk", self.outside, x, optimize=True)
        products = np.einsum("ik,aibk->kab", x.conj(), images, optimize=True)
        diagonal = np.arange(len(self.whole.parts))
        products[:, diagonal, diagonal] += np.einsum("am,mk->ka", self.noise, np.abs(x) ** 2)
        return products

    def _shares(self, s: Array, reach: Array, at: Array, products: tuple[Array, Array]) -> Array:
        """Bounds of ‖R x_k‖ |ν_k/(1 - tν_k)| ‖z_kᴴL‖ / c for |s' - s| ≤ reach, shape (len(s), k)."""
        found = np.empty((len(s), len(at)))
        parts, nu = self.whole.parts, self.nu[at]
        for first in range(0, len(s), BATCH):
            rows = slice(first, first + BATCH)
            here, far = s[rows], reach[rows, None]
            near = np.abs(1 - (here - self.shift)[:, None] * nu) - far * np.abs(nu)
            share = np.abs(nu) / self.whole.least / np.where(near > 0, near, np.nan)
            weights = np.stack([part.weight(here) for part in parts], axis=1)
            signs = np.array([part.sign for part in parts])
            for own, w in zip(products, (weights, signs * weights.conj()), strict=True):
                square = np.einsum("sa,kab,sb->sk", w.conj(), own, w, optimize=True).real
                lengths = np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0))
                change = (2 * np.abs(here)[:, None] + far) * lengths[0] + sum(
                    length for part, length in zip(parts, lengths, strict=True) if part.linear)
                share = share * (np.sqrt(np.maximum(square, 0.0)) + far * change)
            found[rows] = np.where(np.isfinite(share), share, np.inf)
        return found


def _free(modes: NormalModes, others: list[Matrix]) -> tuple[Array, Array]:
    """Rigid motion on which no other part of P acts, and the rest of the modes; by rounding in the products."""
    Z, rest = modes.shapes[:, :modes.rigid], modes.shapes[:, modes.rigid:]
    acting = [part for part in others if part.nnz]
    if not Z.shape[1] or not acting:
        return Z, rest
    scale = [np.linalg.norm(abs(part) @ abs(Z)) for part in acting]
    moved = [(part @ Z) / size for part, size in zip(acting, scale, strict=True) if size]
    if not moved:
        return Z, rest
    sizes, turn = la.svd(np.vstack(moved), full_matrices=False)[1:]
    still = sizes < STILL
    return Z @ turn[still].T, np.hstack([Z @ turn[~still].T, rest])


def _undamped(K: Matrix, M: Matrix, outer: Contour, own: bool, carried: Carried,
              bounds: Callable[[ShiftInvert, float], AbstractContextManager[Callable[[int], Bounds]]], most: int
              ) -> tuple[NormalModes, float, Bounds]:
    """The modes of K + lift M, positive semidefinite, all up to the reach; the lift; and `bounds` by its factor.

    The pencil's own K needs no lift, and its factor is there. The symmetric part of an unsymmetric K is often indefinite. The
    modes are counted in a process of its own, where there is room for it, while this one makes its factor. What takes longest of
    the bounds is found in another one while the modes are sought (see `_none_strong`), and the rest after them.
    """
    last: FemsubError = SingularMatrixError("K is far from definite")
    for share in LIFTS[0 if own else 1:]:
        lift = share * outer.size**2
        held = sp.csr_array(K + lift * M) if lift else K
        limit = float(np.sqrt((REACH * outer.top) ** 2 + lift))
        beside = counted_early(held, M, limit)
        try:
            with one_thread(beside is not None):
                if lift:
                    shared_factor(held, "definite")  # or an error, before rigid motion is looked for
                handle = ShiftInvert(held, M, carried=None if lift else carried)
            handle.beside = beside
            with ExitStack() as stack:
                with counted_beside(handle, limit):
                    found = stack.enter_context(bounds(handle, lift))
                modes = modes_below(held, M, limit, handle, most)
            if len(modes.eigenvalues) == modes.counted[1]:
                return modes, lift, found(len(modes.eigenvalues))
            last = MissedModesError("an undamped mode is missing")
        except (SingularMatrixError, MissedModesError) as error:
            last = error
    raise last


def about_radius(pencil: Pencil, number: int) -> float:
    """About the radius of a disc around 0 with so many eigenvalues: that of the undamped modes of K + lift M, roughly found.

    The lift is the lowest Rayleigh quotient of a uniform motion or a smooth shape that is not rounding. It has the size of the
    lowest ω², so that K + lift M is usually definite in spite of friction, and few steps of block Lanczos are enough.

    Raises
    ------
    SingularMatrixError, NotConvergedError
        K is far from definite, or no such shape is low enough.
    """
    K, M = pencil.symmetric_stiffness, pencil.M
    shapes = np.column_stack([translations(pencil.size), smooth_shape(K)])
    energy, mass = (np.abs(np.einsum("ij,ij->j", shapes, A @ shapes)) for A in (K, M))
    quotients = energy[mass > 0] / mass[mass > 0]
    lift = float(quotients[quotients > MOTION * quotients.max(initial=0.0)].min(initial=np.inf))
    if not np.isfinite(lift):
        raise SingularMatrixError("no motion has both stiffness and mass")
    factor = shared_factor(sp.csr_array(K + lift * M), "definite")
    values = block_lanczos(factor, M, 0.0, number // 2 + MORE, tol=ROUGH, restarts=FEW_RESTARTS)[0]
    return float(np.sqrt(max(values[-1] - lift, lift / 16)))


@contextmanager
def _none_strong(A: Difference, D: Matrix, side: float, factor: Handle) -> Iterator[Callable[[], tuple[bool, bool]]]:
    """Whether dA - D and dA + D are positive definite for the first d that is tried, by a process beside what is done inside.

    Where there is no room for one, it is found before. The process has one of the cores.
    """
    if not D.nnz:
        yield lambda: (True, True)
        return
    d = DAMPED[0] / side
    beside = SignsBeside.started(A, D, d, factor, COLUMNS)
    if beside is None:
        known = signs(A.formed(), D, d)
        yield lambda: known
        return
    with one_thread(True):
        yield lambda: beside.answer() or signs(A.formed(), D, d)


def _strong(A: Difference, D: Matrix, solve: Callable[[Array], Array], side: float, first: tuple[bool, bool],
            modes: int, most: int) -> tuple[Array, float]:
    """Shapes U (n, k) such that |xᵀDx| ≤ d xᵀAx wherever UᵀAx = 0, and d; D symmetric; `first` is what `_none_strong` found.

    Raises
    ------
    NotConvergedError, NotEnoughMemoryError
        Beside so many `modes` there are too many for `most` columns, or some are missed.
    """
    none = np.zeros((A.shape[0], 0))
    if not D.nnz:
        return none, 0.0
    for tried, d in enumerate(share / side for share in DAMPED):
        definite = signs(A.formed(), D, d) if tried else first  # half of the time of an inertia
        if all(definite):
            return none, d
        both = d * A.formed() - D, d * A.formed() + D
        number = sum(inertia(sp.csr_array(one)) for one, known in zip(both, definite, strict=True) if not known)
        if not number:
            return none, d
        if modes + number <= most:
            break
    else:
        raise NotConvergedError(f"the basis needs {modes + number} shapes, {number} of them strongly damped, and the limit is "
                                f"{most}")
    log.info("the count by projection takes %d shapes, of which %d are strongly damped", modes + number, number)
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    check_columns("the pencil", A.shape[0], 2 * number + 1)
    start = np.random.default_rng(3).standard_normal(A.shape[0])
    try:
        values, shapes = eigsh(D, number, M=A.formed(), Minv=LinearOperator(A.shape, matvec=solve, dtype=float), which="LM",
                               tol=1e-12, v0=start)
    except ArpackNoConvergence as error:
        raise NotConvergedError(f"of {number} strongly damped shapes {len(error.eigenvalues)} were found") from None
    if np.abs(values).min() < d * (1 - 1e-9):
        raise NotConvergedError(f"of {number} strongly damped shapes some were missed")
    return shapes, d


def _bound_of_skew(A: Difference, G: Matrix, solve: Callable[[Array], Array]) -> float:
    """g with |xᴴGx| ≤ g xᴴAx: gA + iG is positive definite, by a Cholesky factor of its real form.

    Raises
    ------
    NotConvergedError
        None was found.
    """
    if not G.nnz:
        return 0.0
    x = np.random.default_rng(4).standard_normal((A.shape[0], 4))
    for _ in range(6):
        x = orthonormal(solve(G @ x), A.__matmul__)[0]
    image, matrix = G @ x, A.formed()
    estimate = float(np.sqrt(la.norm(image.T @ solve(image), 2)))
    for g in (1.2 * estimate, 2 * estimate, 4 * estimate):
        if all(are_definite([sp.csr_array(sp.block_array([[g * matrix, -G], [G, g * matrix]]))])):
            return g
    raise NotConvergedError("the gyroscopic part is not bounded by the stiffness")


def _pieces(number: int) -> tuple[Array, Array]:
    ends = np.linspace(0.0, 1.0, number + 1)
    return ends[:-1], ends[1:]


def _discs(contour: Contour, start: Array, stop: Array) -> tuple[Array, Array]:
    """Middles and radii of discs that cover pieces of the contour."""
    s = contour.at((start + stop) / 2)
    return s, np.maximum(np.abs(contour.at(start) - s), np.abs(contour.at(stop) - s))
