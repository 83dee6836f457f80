"""The number of eigenvalues in a rectangle or disc, for damping and friction of any rank: projection on the undamped modes.

Brakes are often projected on their undamped modes, and the result is trusted. Here a bound of the truncation error shows whether
the projection has the right number of eigenvalues. All factors are real and positive definite, so models of any size can be
counted.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial, reduce
from operator import add
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import (
    BLOCK,
    LARGE,
    QUADRATIC,
    ROUNDING,
    SINGULAR,
    WIDE,
    Difference,
    Handle,
    SignsBeside,
    Sum,
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
    translations,
    without_signs,
)
from femsub.checks import (
    EPS,
    EQUAL,
    Array,
    FemsubError,
    Matrix,
    MissedModesError,
    NotConvergedError,
    NotEnoughMemoryError,
    SingularMatrixError,
)
from femsub.model import contact_matrix, costs
from femsub.modes.normal_modes import NormalModes, counted_beside, counted_early, lowest_modes, modes_below
from femsub.modes.quadratic.cells import CellBound, WholeTerm, images
from femsub.modes.quadratic.energy_basis import RIGHT, SAFE, Coupling, EnergyBasis, Term, Weights, complex_columns, few_at_a_time
from femsub.modes.quadratic.region import Contour, Count
from femsub.modes.shift_invert import ShiftInvert

if TYPE_CHECKING:
    from femsub.model import Carried, Pencil

log = logging.getLogger(__name__)

#: errors that `Projection` raises if there is no projection
UNCOUNTED = (SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError)

REACH = 2.5  # undamped modes are kept up to this multiple of the largest Im λ
LIFTS = (0.0, 0.2, 1.0, 2.0, 4.0, 8.0)  # of M, in units of the largest |λ|², that may make the stiffness positive definite
MOTION = 1e-9  # Rayleigh quotient, relative to the largest, up to which a shape is rigid motion or nearly rigid
STILL = 1e-12  # |Dz| relative to |D||z| below which damping does not act on rigid motion z
COLUMNS = 500  # largest memory, in columns of n numbers, while a process looks for strong damping
DAMPED = (0.2, 0.5)  # share of the stiffness that damping may reach outside the basis at the largest |Re λ|
CHANGED = 0.05  # the same share for changes by parameters


Ends = tuple[float, float]
Bounds = tuple[Array, Ends, float]  # shapes of strong damping, the range of damping outside, and g: see `Projection`


class Varied(NamedTuple):
    """A term θ s^power T that a parameter adds to a pencil, |θ| ≤ size.

    The pencil may already have the symmetric half of `held` T, without the skew half. Then the projection adds the skew half, as
    one term of the weight held + θ.
    """

    matrix: Matrix
    power: int
    size: float
    held: float = 0.0


class Projection(EnergyBasis):
    """The energy basis of P(s) = s²M + sD + K with A = (K + Kᵀ)/2 + μM, in which all constants are proved.

    Undamped rigid motion, P(s)z = s²Mz, is treated separately: its eigenvalues are 0. V contains all other undamped modes up to
    2.5 times the largest Im λ, counted by inertia, and all shapes of strong damping. So outside V, for s = a + ib,

        c = 1 - (b² + μ)/(ω² + μ) - |a|d - |b|g

    where ω is the first undamped frequency outside V, |xᴴ(D + Dᵀ)x| ≤ 2d and |xᴴ(D - Dᵀ)x| ≤ 2g, both relative to xᴴAx. Cholesky
    factors of dA ± (D + Dᵀ)/2, and of the real form of gA + i(D - Dᵀ)/2, prove both. For a < 0 positive damping reduces c, and
    for a > 0 negative damping: each has its own d.

    With `changes` θ_q s^q T_q by a parameter, `changed` gives the same projection for P(s) + Σ θ_q s^q T_q. For a T_q with few
    columns A⁻¹T_q joins V, so that T_q does not act outside V. Other T_q are bounded there in the same way as D. `kept` is as in
    `EnergyBasis`: it pays if residuals of many pairs are needed, as in corrections. A pencil given by a function, with its M, D
    and K as `sums`, is kept only until the modes are known, not beside V.

    Raises
    ------
    SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError
        There is no such A or V: M is unsymmetric, K far from definite, or damping so strong that V would have more than `most`
        columns. LAPACK finds all eigenvalues of VᵀPV, so the limit is the same as for models of which LAPACK finds all
        eigenvalues.
    """

    def __init__(self, pencil: Pencil | Callable[[], Pencil], outer: Contour, most: int = QUADRATIC,
                 changes: Sequence[Varied] = (), lowest: tuple[ShiftInvert, NormalModes] | None = None, kept: bool = True,
                 sums: Sequence[Sum] | None = None) -> None:
        pencil = pencil() if callable(pencil) else pencil
        if not pencil.symmetric[0]:
            raise SingularMatrixError("M is unsymmetric")
        self.outer, self.most, M = outer, most, pencil.M
        self.why = ""  #: why there is no count
        self.blamed = np.zeros(len(changes))  #: shares of the changes where a proof for all θ ± half failed
        none = sp.csr_array(M.shape)
        damping, gyroscopic = (pencil.D, none) if pencil.symmetric[1] else halves(pencil.D)
        stiffness, circulatory = (pencil.K, none) if pencil.symmetric[2] else (
            pencil.halves if pencil.K0 is pencil.K else halves(pencil.K))

        simple, turned = proportional(pencil, damping), few_columns(gyroscopic)
        own, carried, n = stiffness is pencil.K, pencil.rigid_motion, pencil.size
        whole = self.whole = bool(changes) and n <= WIDE  # V may become the whole space
        del pencil
        mass, damping, whole_stiffness = sums or (M, damping, stiffness)  # frees a damping that was formed

        others = [part for part in (damping, gyroscopic, circulatory, *(change.matrix for change in changes)) if part.nnz]

        @contextmanager
        def bounds(handle: ShiftInvert, lift: float) -> Iterator[Callable[[int], Bounds]]:
            self.factor, self.mu, self.unsure = handle.factor, lift - handle.sigma, bool(handle.note)
            # rigid motion is free if no other part of P acts on it, beyond rounding in the products; all other modes join V
            self.free, self.driven = handle.rigid.copy(), handle.rigid[:, :0]
            scale = [np.linalg.norm(Sum.of(part).sizes(self.free)) for part in others]  # 0 if there is no rigid motion
            moved = [(part @ self.free) / size for part, size in zip(others, scale, strict=True) if size]
            if moved:
                sizes, turn = la.svd(np.vstack(moved), full_matrices=False)[1:]
                self.free, self.driven = self.free @ turn[sizes < STILL].T, self.free @ turn[sizes >= STILL].T
            if self.driven.shape[1]:  # beside its own σ in A, other parts' action on it would be all that rounding leaves
                self.mu = min(LIFTS[1] * outer.size**2, handle.lowest)
                self.factor = shared_factor(stiffness, "definite", M, -self.mu)
            solve = self.factor.solve
            K = Sum.of(whole_stiffness)
            self.A = Sum([*K.terms, *((self.mu * theta, A) for theta, A in Sum.of(mass).terms)], K.unit)

            def found(modes: int) -> Bounds:
                first = looked()
                damped = none if simple is not None else damping
                return (*_strong(self.A, damped, solve, outer.re, first, modes, most, whole),
                        _bound(self.A, gyroscopic if turned is None else none, solve, -1.0))

            with _none_strong(self.A, Difference(stiffness, M, -self.mu), Sum.of(damping if simple is None else none),
                              outer.re, self.factor) as looked:
                yield found

        modes, lift, (strong, spread, g) = _undamped(stiffness, M, outer, own, carried, bounds, most, lowest)
        if others and self.unsure:
            raise SingularMatrixError("K shows rigid motion only within the rounding of its entries, as damping may")
        rest = np.hstack([self.driven, modes.shapes[:, modes.rigid:]])
        self.momenta = M @ self.free
        M, stiffness = mass, whole_stiffness  # frees matrices that were formed
        self.unit = self.A.unit  #: the unit in which the matrices of a family are scaled
        beyond = modes.counted[0] ** 2 - lift + self.mu
        if simple is not None:  # outside V, D is αM + βK = (α - βμ)M + βA
            alpha, beta = simple[:2]
            first = beta + (alpha - beta * self.mu) / beyond  # of the first mode outside V
            spread = min(beta, first), max(beta, first)
        given = (Term(M, (-self.mu, 0.0, 1.0), range=(0.0, 1 / beyond)),
                 Term(damping, (0.0, 1.0, 0.0), range=spread, modal=simple is not None,
                      spanned=simple is not None and not any(spread)),
                 Term(gyroscopic, (0.0, 1.0, 0.0), -1.0, (-g, g), spanned=turned is not None),
                 Term(circulatory, (1.0, 0.0, 0.0), -1.0))
        terms = [term for term in given if term.matrix is M or term.matrix.nnz]
        self.own_weights: list[tuple[int | None, Weights]] = [(None, term.weights) for term in terms]
        self.held = [0.0] * len(terms)  #: of each term: the number that is added to the θ of its change
        joining = [rest, strong]
        few = [W for W in (None if simple is None else simple[2], turned) if W is not None and W.shape[1]]
        if few:  # A⁻¹ of these columns joins V, without rigid motion, which V has already: A is nearly singular in it
            Q, size, _ = la.svd(np.hstack([W / np.linalg.norm(W, axis=0) for W in few]), full_matrices=False)
            Q = Q[:, size > SINGULAR * size[0]]
            rigid = modes.shapes[:, :modes.rigid]
            joining.append(self.factor.solve(Q - (M @ rigid) @ (rigid.T @ Q)))
        for place, (matrix, power, size, held) in enumerate(changes):
            side = max(-outer.re[0], outer.re[1])  # the change may have either sign
            for half, sign, more in zip(halves(matrix), (1.0, -1.0), (0.0, held), strict=True):
                weight = (size + abs(more)) * (1.0, side, max(side, outer.top)**2)[power]
                if not half.nnz or not weight:
                    continue
                columns, ends = few_columns(half), (0.0, 0.0)
                if columns is not None:
                    joining.append(self.factor.solve(columns))
                elif sign < 0 and not power:
                    ends = -np.inf, np.inf  # xᴴTx is imaginary
                else:
                    bound = _bound(self.A, half, self.factor.solve, sign, np.inf if sign < 0 else CHANGED / weight)
                    ends = -bound, bound
                    if not np.isfinite(bound):
                        known = signs(self.A, half, (CHANGED / weight, CHANGED / weight))
                        shapes, ends = _strong(self.A, half, self.factor.solve, (-weight, weight), known,
                                               sum(x.shape[1] for x in joining), most, whole, (CHANGED, *DAMPED))
                        joining.append(shapes)
                terms.append(Term(half, (0.0, 0.0, 0.0), sign, ends, spanned=columns is not None))
                self.own_weights.append((place, (float(power == 0), float(power == 1), float(power == 2))))
                self.held.append(more)
        super().__init__(self.A.__matmul__, partial(solved, self.factor), terms, n, kept=kept)
        self.counted: Coupling | None = None  # the last coupling, if the count was proved
        self.changes, self.theta, self.half = changes, np.zeros(len(changes)), np.zeros(len(changes))
        self._whole_terms: list[WholeTerm] = []
        self._images: tuple[Array, float] | None = None
        del modes, strong, rest  # each is freed when it has joined V
        self.add(joining.pop(0), modes=True)
        while joining:
            self.add(joining.pop(0))
        if not self.size:  # no mode is near the region, and any one shape shows that
            self.add(self.factor.solve(np.ones((n, 1)) - self.momenta @ self.free.sum(axis=0)[:, None]))

    def changed(self, theta: Sequence[float] | Array, half: Sequence[float] | Array = ()) -> Projection:
        """The projection for P(s) + Σ θ_q s^q T_q, with one θ for each of the `changes`; `on` counts for all θ ± `half` then."""
        found = self.at(self._weighted(theta))
        found.counted, found.why = None, ""
        found.theta, found.half = np.array(theta, dtype=float), np.array(half if len(half) else np.zeros(len(theta)), dtype=float)
        return found

    def _weighted(self, theta: Sequence[float] | Array, half: Sequence[float] | Array | None = None) -> list[Weights]:
        """The weights of all terms at θ; with `half` the largest weights for all θ ± half."""
        found = []
        for (place, own), held in zip(self.own_weights, self.held, strict=True):
            size = 1.0
            if place is not None:
                size = theta[place] + held
                size = size if half is None else abs(size) + half[place]
            found.append((size * own[0], size * own[1], size * own[2]))
        return found

    def coercivity(self, re: tuple[float, float], top: float) -> float:
        """c; 1 if V and rigid motion span the whole space."""
        return 1.0 if self.size + self.free.shape[1] == len(self.V) else super().coercivity(re, top)

    def damped_motion(self, pencil: Pencil) -> Array:
        """The rigid motions Z with KZ = 0 and ZᵀK = 0 on which other parts of this pencil act, (n, r): λ = 0 once for each."""
        found = self.driven
        for K in [pencil.K, pencil.K.T][:(2 - pencil.symmetric[2]) * bool(found.size)]:
            found = found[:, costs(K, found)[0] <= EQUAL]
        return found

    def completed(self) -> bool:
        """Extend V to the whole space, if the model is small enough for LAPACK; return whether V has grown."""
        if not self.whole:
            return False
        known = np.hstack([self.A @ self.V, self.momenta])
        return self.add(la.qr(known)[0][:, known.shape[1]:])

    @property
    def least(self) -> float:
        """c for all θ ± half."""
        return self.at(self._weighted(self.theta, self.half)).coercivity(self.outer.re, self.outer.top)

    def norm(self, term: Term) -> float:
        """g with |xᴴTx| ≤ g xᴴAx for all complex x."""
        return _bound(self.A, term.matrix, self.factor.solve, term.sign)

    def sizes(self, V: Array) -> Array:
        """|V|ᵀB|V| (p + 1, r, r) of V (n, r), for B = |K| + μ|M| of A = K + μM, and |T| of each term, of a sum Σ|θ_i||T_i|.

        Times EPS it bounds the effect of rounding in the entries on VᵀAV or VᵀTV.
        """
        blocks = [V[:, at] for at in few_at_a_time(V.shape[1], self.size // 2)]  # each has three images beside it

        def size(B: Sum) -> Array:
            columns = []
            for block in blocks:
                image = B.sizes(block)
                columns.append(np.vstack([np.abs(one).T @ image for one in blocks]))
            return np.hstack(columns)

        return np.array([size(self.A), *(size(Sum.of(term.matrix)) for term in self.terms)])

    def images_outside(self) -> tuple[Array, float]:
        """H (p, h, m) of all terms at their largest weights, and a bound of its error, see `images`."""
        if self._images is None:
            largest = self.at(self._weighted(np.zeros(len(self.changes)), [change.size for change in self.changes]))
            self._images = images(self, np.array([term.largest(self.outer.size) for term in largest.terms]))
        return self._images

    def add(self, new: Array, *, modes: bool = False, unit: bool = False) -> bool:
        """Append directions (n, k), from which free rigid motion is removed; return whether V has grown."""
        m, p = self.size, len(self.terms)
        held = (1 + self.kept * p / 2) * (m + new.shape[1])
        check_columns("the pencil", len(new), int(held) + new.shape[1] + 4 * BLOCK)
        check_room("the count by projection", 8.0 * (3 * p * p + 24) * (m + new.shape[1])**2)  # products, and the eigenproblem
        self._whole_terms, self._images = [], None
        return super().add(new - self.free @ (self.momenta.T @ new) if self.free.size else new, modes=modes, unit=unit)

    def on(self, choose: Callable[[Array, Array], Contour], rounds: int = 8) -> Count | None:
        """The proved count inside a contour that keeps clear of the eigenvalues of VᵀPV; None if it cannot be proved.

        `choose` makes the contour from the eigenvalues and from how far the changes move each of them. V is enriched until the
        count is proved, in at most `rounds` rounds. One is usual, and each makes the eigenproblem of VᵀPV larger.
        """
        self.why, self.blamed = "", np.zeros(len(self.changes))
        c = self.least
        if c <= 0 and self.changed(self.theta).least <= 0 and self.completed():  # else no part of the cell could be proved
            c = self.least
        if c <= 0:
            for q in np.flatnonzero(self.half):  # the loss of c by each change
                others = self.changed(self.theta, np.where(np.arange(len(self.half)) == q, 0.0, self.half))
                self.blamed[q] = others.least - c if np.isfinite(c) else np.isfinite(others.least)
            self.why = ("inertia, damping and gyroscopic forces of shapes outside the basis may reach "
                        f"{1 - c:.2g} times their stiffness")
            return None
        if not self.size:
            self.why = "it has no shape besides rigid motion"
            return None
        for _ in range(rounds):
            try:
                small = Coupling.of(self, self.outer.size)
                contour = choose(small.values, self._moved(small)[small.nu != 0])
            except la.LinAlgError as error:
                self.why = str(error)
                return None
            if not small.wrong < RIGHT:
                self.why = f"eigenpairs of the projection have errors of {small.wrong:.0e}"
                return None
            (margin, new), place = small.margin(contour, c), ""
            if margin < SAFE and self.half.any():
                if not self._whole_terms:
                    places = [place for place, _ in self.own_weights]
                    self._whole_terms = [WholeTerm.of(self, [i for i, place in enumerate(places) if place == q], change.power)
                                         for q, change in enumerate(self.changes)]
                changes = list(zip(self._whole_terms, self.half, strict=True))
                cell = CellBound(small, contour, c, changes, self.images_outside())
                margin, new, self.blamed[self.half > 0], s = cell.margin()
                place = f" at s = {s:.5g} for all values"
            if margin < SAFE:
                self.counted, small.contour = small, contour
                values = np.append(small.values, np.zeros(2 * self.free.shape[1]))
                return Count(contour, int(np.count_nonzero(contour.encloses(values))), values, self.size, margin)
            self.why = (f"with {self.size} shapes the bound of the truncation error is {margin:.2g}{place}, but it must be below "
                        f"{SAFE}")
            if self.size > self.most:
                self.why += f", and {self.most} shapes are the limit"
                break
            columns = np.hstack(new) if new else np.zeros((len(self.V), 0))
            new.clear()  # half of the memory
            if not self.add(columns):
                break
        return None

    def _moved(self, small: Coupling) -> Array:
        """How far the changes, θ ± half, move each eigenvalue to first order: Σ half_q |λ^k zᴴT_qx|, (2m,)."""
        found = np.zeros(len(small.nu))
        for place in np.flatnonzero(self.half):
            # both halves of a term together: their shares may cancel
            inside = self.inside[[of == place for of, _ in self.own_weights]].sum(axis=0)
            images = complex_columns(small.pairs.first, inside @ small.pairs.X)
            size = np.abs(np.einsum("ik,ik->k", small.z.conj(), images))
            with np.errstate(invalid="ignore"):
                found += self.half[place] * np.nan_to_num(np.abs(small.each)) ** self.changes[place].power * size
        return found


def few_columns(T: Matrix, most: int = 40) -> Array | None:
    """An orthonormal basis (n, k) of the range of a symmetric or skew T, k ≤ `most`, which a port has; None if it has more."""
    rows = np.flatnonzero(np.diff(T.indptr))
    if not len(rows) or len(rows) > WIDE:
        return None if len(rows) else np.zeros((T.shape[0], 0))
    Q, size, _ = np.linalg.svd(T[rows][:, rows].toarray())
    rank = int(np.count_nonzero(size > len(rows) * EPS * size[0]))
    if rank > most:
        return None
    found = np.zeros((T.shape[0], rank))
    found[rows] = Q[:, :rank]
    return found


def proportional(pencil: Pencil, damping: Matrix, most: int = 40) -> tuple[float, float, Array] | None:
    """α, β and W (n, k), k ≤ `most`, such that the symmetric damping is αM + βK on all x with Wᵀx = 0; else None.

    W has the columns of contacts and of dashpots. α and β are fitted to diagonals and row sums, without the half of these that
    fits worst, such as rows of dashpots.
    """
    M, K, W = pencil.M, pencil.symmetric_stiffness, [one for *_, one in pencil.contacts]
    rest = [(1.0, damping)] + [(-1.0, contact_matrix(one, C if isinstance(C, float) else (C + C.T) / 2))
                               for C, _, one in pencil.contacts]
    own = np.sqrt(np.abs(damping.diagonal()))
    alpha = beta = 0.0
    columns = _few_left(rest, own, most)
    if columns is None:
        mass, stiffness, d = (np.sum([weight * np.append(A.diagonal(), A @ np.ones(len(own))) for weight, A in several], axis=0)
                              for several in ([(1.0, M)], [(1.0, K)], rest))
        scale = np.array([mass.max(), stiffness.max()])
        unit = np.column_stack([mass, stiffness]) / scale
        off = np.zeros(len(d))
        for _ in range(3):
            keep = off <= np.median(off)
            fit = np.linalg.lstsq(unit[keep], d[keep], rcond=None)[0]
            fit[np.abs(fit) <= SINGULAR * np.abs(fit).max()] = 0.0  # M or K alone
            off = np.abs(d - unit @ fit)
        alpha, beta = (fit / scale).tolist()
        columns = _few_left([*rest, (-alpha, M), (-beta, K)], own, most)
    W = [*W, columns] if columns is not None else W
    return (alpha, beta, np.hstack(W)) if columns is not None and sum(one.shape[1] for one in W) <= most else None


def _few_left(parts: Sequence[tuple[float, Matrix]], own: Array, most: int) -> Array | None:
    """`few_columns` of Σ wA over pairs (w, A), without entries that are only rounding.

    Entries are rounding if they are tiny beside Σ |w||A| + √(d_ii d_jj), where √(d_ii d_jj) = `own`_i `own`_j is from D's
    diagonal. The latter counts because α is known only to the rounding of βK if αM is small beside βK. The sum is formed by slabs
    of rows, and ends at the first slab that shows that there are too many columns.
    """
    slabs, acting = [], 0
    for start in range(0, len(own), LARGE // 8):  # few rows: each takes ten times its own memory
        at = slice(start, start + LARGE // 8)
        rows = [(weight, A[at]) for weight, A in parts if weight]
        found = sp.coo_array(reduce(add, [weight * A for weight, A in rows]))
        size = sp.csr_array(reduce(add, [abs(weight) * without_signs(A) for weight, A in rows]))
        row, column = found.coords
        keep = np.abs(found.data) > ROUNDING * (np.asarray(size[row, column]).ravel() + own[at][row] * own[column])
        slabs.append(sp.csr_array((found.data[keep], (row[keep], column[keep])), shape=found.shape))
        acting += np.count_nonzero(np.diff(slabs[-1].indptr))
        if acting > WIDE:
            return None
    return few_columns(sp.csr_array(sp.vstack(slabs)), most)


def _undamped(K: Matrix, M: Matrix, outer: Contour, own: bool, carried: Carried,
              bounds: Callable[[ShiftInvert, float], AbstractContextManager[Callable[[int], Bounds]]], most: int,
              lowest: tuple[ShiftInvert, NormalModes] | None)  -> tuple[NormalModes, float, Bounds]:
    """All modes up to the reach of a positive semidefinite K + lift M; the lift; and the result of `bounds` by its factor.

    The pencil's own K needs no lift, and its factor exists already. The symmetric part of an unsymmetric K is often indefinite.
    The modes are counted in a separate process, if there is memory for it, while this process factorises. The slowest of the
    bounds is found in another process while the modes are computed (see `_none_strong`), the other bounds after that.
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
                    shared_factor(held, "definite")  # raises before rigid motion is looked for
                handle = lowest[0] if lowest and not lift else ShiftInvert(held, M, carried=None if lift else carried)
            handle.beside = beside
            with ExitStack() as stack:
                with counted_beside(handle, limit):
                    found = stack.enter_context(bounds(handle, lift))
                modes = modes_below(held, M, limit, handle, most, lowest[1] if lowest and not lift else None)
            if len(modes.eigenvalues) == modes.counted[1]:
                return modes, lift, found(len(modes.eigenvalues))
            last = MissedModesError("an undamped mode is missing")
        except (SingularMatrixError, MissedModesError) as error:
            last = error
    raise last


def about_radius(pencil: Pencil, number: int) -> tuple[float, tuple[ShiftInvert, NormalModes] | None]:
    """The approximate radius of a disc around 0 with `number` eigenvalues, from undamped modes of K, or of K + lift M.

    K's factor and modes are returned as well, since the projection uses them. If friction or prestress makes K indefinite, the
    lift is the lowest Rayleigh quotient above rounding among uniform motions and a smooth shape. It has the size of the lowest
    ω².

    Raises
    ------
    SingularMatrixError, NotConvergedError
        K is far from definite, or no such shape is low enough.
    """
    K, M = pencil.symmetric_stiffness, pencil.M
    lift = 0.0
    try:
        handle = ShiftInvert(K, M, carried=pencil.rigid_motion)
    except SingularMatrixError:
        shapes = np.column_stack([translations(pencil.size), smooth_shape(K)])
        energy, mass = (np.abs(np.einsum("ij,ij->j", shapes, A @ shapes)) for A in (K, M))
        quotients = energy[mass > 0] / mass[mass > 0]
        lift = float(quotients[quotients > MOTION * quotients.max(initial=0.0)].min(initial=np.inf))
        if not np.isfinite(lift):
            raise SingularMatrixError("no motion has both stiffness and mass") from None
        handle = ShiftInvert(sp.csr_array(K + lift * M), M)
    # a few modes more than half of the eigenvalues, because the radius may grow
    modes = lowest_modes(handle, min(number // 2 + 4, handle.elastic), evidence=False)
    return float(np.sqrt(max(modes.eigenvalues[-1] - lift, lift / 16))), None if lift else (handle, modes)


@contextmanager
def _none_strong(A: Sum, formed: Difference, D: Sum, re: Ends, factor: Handle) -> Iterator[Callable[[], tuple[bool, bool]]]:
    """The result of `signs` for the first d, from a process that runs beside the body of the ``with`` statement.

    If there is no memory for a process, the result is computed before the body. The process uses one of the cores.
    """
    if not D.nnz:
        yield lambda: (True, True)
        return
    d = _allowed(DAMPED[0], re)
    beside = SignsBeside.started(formed, D.formed, d, factor, COLUMNS)
    if beside is None:
        known = signs(A, D, d)
        yield lambda: known
        return
    with one_thread(True):
        yield lambda: beside.answer() or signs(A, D, d)


def _allowed(share: float, re: Ends) -> Ends:
    """d₀ and d₁ with -d₁ ≤ xᵀDx / xᵀAx ≤ d₀, such that Re s xᵀDx ≥ -share xᵀAx for Re s in `re`."""
    left, right = (share / abs(end) if end else np.inf for end in re)
    return left, right


def _strong(A: Sum, D: Matrix | Sum, solve: Callable[[Array], Array], re: Ends, first: tuple[bool, bool],
            modes: int, most: int, whole: bool, shares: Sequence[float] = DAMPED) -> tuple[Array, Ends]:
    """Shapes U (n, k) of strong damping, and the range of xᵀDx / xᵀAx for all x with UᵀAx = 0; D is symmetric.

    `first` is the result of `_none_strong`. If there are too many shapes, and the basis may become the `whole` space, U is empty
    and the range infinite.

    Raises
    ------
    NotConvergedError, NotEnoughMemoryError
        Together with the `modes` the shapes are more than `most`, or some shapes are missed.
    """
    none = np.zeros((A.shape[0], 0))
    if not D.nnz:
        return none, (0.0, 0.0)
    for tried, d in enumerate(_allowed(share, re) for share in shares):
        definite = signs(A, D, d) if tried else first  # takes half of the time of an inertia
        each = [0 if known else inertia(sp.csr_array(A.plus(sign / one, D)))
                for one, sign, known in zip(d, (-1, 1), definite, strict=True)]
        number, ends = sum(each), (-d[1], d[0])
        if not number:
            return none, ends
        if modes + number <= most:
            break
    else:
        if whole:
            return none, (-np.inf, np.inf)
        raise NotConvergedError(f"the basis needs {modes + number} shapes, {number} of them strongly damped, and the limit is "
                                f"{most}")
    log.info("the count by projection takes %d shapes, of which %d are strongly damped", modes + number, number)
    D = Sum.of(D)
    rows = np.flatnonzero(np.sum([np.diff(T.indptr) for theta, T in D.terms if theta], axis=0))
    if len(rows) <= min(10 * number, QUADRATIC):  # Lanczos takes some six solves for each shape, one after the other
        check_columns("the pencil", A.shape[0], 2 * (number + BLOCK))
        # with G = EᵀA⁻¹E = LLᵀ of the rows' unit loads E, D = ESEᵀ and LᵀSLw = λw, Dx = λAx has x = A⁻¹ESLw / λ. A stiff joint
        # between two rows makes G singular within rounding. All columns of A⁻¹E would take more memory than the basis
        flexibility = np.empty((len(rows), len(rows)))
        for at in (slice(start, start + BLOCK) for start in range(0, len(rows), BLOCK)):
            load = np.zeros((A.shape[0], len(rows[at])))
            load[rows[at], np.arange(load.shape[1])] = 1.0
            flexibility[:, at] = solve(load)[rows]
        size, turn = la.eigh(flexibility)
        S, L = D.formed()[rows][:, rows], turn * np.sqrt(np.maximum(size, 0.0))
        values, w = la.eigh(L.T @ (S @ L))
        keep = (values >= d[0]) | (values <= -d[1])
        if keep.sum() < number:
            raise NotConvergedError(f"of {number} strongly damped shapes {keep.sum()} were found")
        load = np.zeros((A.shape[0], int(keep.sum())))
        load[rows] = S @ (L @ w[:, keep]) / values[keep]
        return solve(load), ends
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    check_columns("the pencil", A.shape[0], 2 * number + 1)
    start, by = np.random.default_rng(3).standard_normal(A.shape[0]), partial(LinearOperator, A.shape, dtype=float)
    found = []
    for wanted, least, which in zip(each, d, ("LA", "SA"), strict=True):
        if not wanted:
            continue
        try:
            values, shapes = eigsh(by(D.__matmul__), wanted, M=by(A.__matmul__), Minv=by(solve), which=which, tol=1e-12, v0=start)
        except ArpackNoConvergence as error:
            raise NotConvergedError(f"of {number} strongly damped shapes {len(error.eigenvalues)} were found") from None
        if np.abs(values).min() < least * (1 - 1e-9):
            raise NotConvergedError(f"of {number} strongly damped shapes some were missed")
        found.append(shapes)
    return np.hstack(found), ends


def _bound(A: Sum, T: Matrix, solve: Callable[[Array], Array], sign: float, most: float = np.inf) -> float:
    """g with |xᴴTx| ≤ g xᴴAx of a symmetric or skew T, by Cholesky factors of gA ± T, or of the real form of gA + iT.

    Infinite if it is larger than `most`.

    Raises
    ------
    NotConvergedError
        No such g was found.
    """
    if not T.nnz:
        return 0.0
    x = np.random.default_rng(4).standard_normal((A.shape[0], 4))
    for _ in range(6):
        x = orthonormal(solve(T @ x), A.__matmul__)[0]
    image = T @ x
    estimate = float(np.sqrt(la.norm(image.T @ solve(image), 2)))
    for g in (1.2 * estimate, 2 * estimate, 4 * estimate):
        if g > most:
            return np.inf
        if all(signs(A, T, (g, g)) if sign > 0 else are_definite(
                [sp.csr_array(sp.block_array([[g * A.formed(), -T], [T, g * A.formed()]]))])):
            return g
    raise NotConvergedError("a gyroscopic part, or the change that a parameter makes, is not bounded by the stiffness")
