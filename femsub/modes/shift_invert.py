"""K - σM factorised once, for modes and static solves, of held and floating components.

σ is 0 for a held component, and a small negative number for a floating one. For the latter the rigid-body modes are found
first, by subspace iteration with the same factor, so that elastic solutions can be made orthogonal to them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import (
    BLOCK,
    LARGE,
    ROUNDING,
    SINGULAR,
    SUMS,
    Difference,
    Handle,
    factorise,
    factors_made,
    forget_factor,
    has_room_to_count,
    one_thread,
    orthonormal,
    phase,
    rank_of_mass,
    search_columns,
    shared,
    shared_factor,
    smooth_shape,
    translations,
    unit_length,
)
from femsub.checks import DENSE, EPS, Array, ConditionWarning, Matrix, SingularMatrixError, warn
from femsub.model import (
    MIXED,
    SOFT,
    Carried,
    RigidMotion,
    annihilates_a_translation,
    bare,
    costs,
    costs_nothing,
    elastic_forces,
    found,
    is_rigid,
    pieces,
    rigid_count,
    rounding,
    soft_springs,
    units,
)

if TYPE_CHECKING:
    from femsub.algebra import CountBeside
    from femsub.model import Pencil, Substructure

BLURRED = 1e-3  # relative change of ω² by rounding in K above which K alone gives no ω², but K Z = 0 may
BY_MULTIPLIERS = "joints are assembled by multipliers (assembly='primal' has the same modes)"
IN_PARTS = ("Make softly connected pieces the parts of a system (couple, Spring), which knows their rigid motion, or "
            "support each piece. Likely causes are also elements too thin or too small for a slender part")
NOT_DEFINITE = ("K is not positive definite, though joints and springs leave no rigid motion. Likely causes: a mount so soft "
                f"that it is rounding beside the parts' stiffness, or {BY_MULTIPLIERS}")


class ShiftInvert:
    """The factor of K - σM, and the M-orthonormal rigid-body modes Φ_r (n, n_r) of K.

    Both are shared by all handles on the same K and M, or on the same `rows` of them. `factorisations` counts those made for this
    handle; it may be 0. `unit` is the relative rounding of the entries of K, see `rounding_of`. A model that carries its rigid
    motion provides it, and no other is searched. If `seeks` modes will be searched, a process prepares their count.

    Warns
    -----
    ConditionWarning
        Modes are taken as rigid motion although they have an energy in K, within the rounding of its entries.
    """

    def __init__(self, K: Matrix, M: Matrix, rows: Array | slice = slice(None), carried: Carried = None, seeks: int = 0) -> None:
        self.K, self.M, self.factorisations = _block(K, rows), _block(M, rows), 0
        self.blurred = False  # whether K holds few digits of the lowest elastic mode
        self.beside: CountBeside | None = None  # counts the modes while they are sought
        if seeks:
            from femsub.algebra import CountBeside

            self.beside = CountBeside.early(self.K, self.M, search_columns(seeks))
        motion = motion_of(carried) if isinstance(rows, slice) else None
        self._given = None if motion is None else motion.shapes
        key = (self.K, self.M), ("shift and rigid-body modes", motion is None)
        self.sigma: float
        self.rigid: Array
        self.lowest: float  # approximate ω² of the first elastic mode; inf if no search for rigid-body modes was needed
        self.unit: float
        self.note: str  # the warning about modes that are rigid only within the rounding of K's entries
        self.exact: int  # number of rigid-body modes, the first ones, that are known without rounding
        self.doubt: float  # the relative change of the lowest elastic ω² by one rounding in each entry of K; 0 if not searched
        (self.sigma, self.rigid, self.lowest, self.unit, self.note, self.exact, self.doubt) = shared(
            *key, self._found, lambda found: found[1].nbytes)
        if self.note:
            warn(self.note, ConditionWarning)
        if "factor" not in vars(self):
            self._factorise(self.sigma)

    @cached_property
    def factor(self) -> Handle:
        """The factor of K - σM. A factor that was released is made again."""
        self._factorise(self.sigma)
        return self.factor

    @property
    def sharing(self) -> AbstractContextManager[None]:
        """A context with one core if a process counts the modes of this part now: with both, the two would wait for each other.
        """
        return one_thread(self.is_counting)

    @property
    def is_counting(self) -> bool:
        """Whether a process counts modes beside this one now."""
        return self.beside is not None and self.beside.busy

    def _found(self) -> tuple[float, Array, float, float, str, int, float]:
        self.rigid, self.lowest, self.unit, self.note, self.exact = np.zeros((self.K.shape[0], 0)), np.inf, EPS, "", 0
        self.doubt = 0.0
        Z = self._given
        if Z is not None and Z.shape[1]:  # only the shift and the lowest elastic ω² are missing
            R = np.linalg.qr(np.sqrt(self.M.diagonal())[:, None] * Z)[1]
            if R.diagonal().all():
                self.rigid = orthonormal(np.linalg.solve(R.T, Z.T).T, self.M.__matmul__)[0]
            if self.rigid.shape[1] < Z.shape[1]:
                raise SingularMatrixError(f"{Z.shape[1] - self.rigid.shape[1]} rigid motions move no mass, so that their "
                                          "coordinates have neither mass nor stiffness. Hold them, or leave them out")
            self.exact = self.rigid.shape[1]
            self._float(self._lowest_given)
        elif Z is not None:
            try:
                self._factorise(0.0)
            except SingularMatrixError as error:
                raise SingularMatrixError(f"{NOT_DEFINITE} ({error})") from None
        else:
            self.unit = rounding(self.K)
            if not self._is_held():
                self._float(self._find_rigid)
                if not self.floating:
                    try:
                        self._factorise(0.0)  # held after all, but softly
                    except SingularMatrixError as error:
                        few = ", ".join(f"{share:.0e}" for share in self.shares[:7])
                        raise SingularMatrixError(
                            "K is numerically singular, but no rigid-body modes were found. The energies of its softest motions, "
                            f"relative to the terms that cancel in them, are {few}. The rounding of K is {self.unit:.0e}, and no "
                            f"gap shows which motions are rigid. {IN_PARTS} ({error})") from None
        return self.sigma, self.rigid, self.lowest, self.unit, self.note, self.exact, self.doubt

    def _lowest_given(self) -> float:
        """ω² of the first elastic mode of a model with given rigid motions."""
        if self.elastic <= 0:
            self.lowest = np.inf
            return self.lowest
        lowest = self.lowest_elastic()
        if lowest < 0:
            why = ("Check that K belongs to a stable component, and that its file holds all digits" if self.doubt < 1 else
                   "Rounding in the entries of K hides an elastic mode")
            raise SingularMatrixError(f"K has a negative eigenvalue, ω² = {lowest:.3g}, beside its rigid motion. {why}")
        return lowest

    @phase("factorisation")
    def _factorise(self, sigma: float) -> None:
        if "factor" in vars(self):
            self.release()
            forget_factor(self.K, "definite", self.M, self.sigma)  # two large factors may not fit in memory
        before = factors_made()
        try:
            self.factor = shared_factor(self.K, "definite", self.M, sigma)
        finally:  # a factorisation that broke down counts, too
            self.factorisations += factors_made() - before
        self.sigma = sigma

    def _is_held(self) -> bool:
        """Whether K is clearly definite. If so, its factor has been made."""
        if annihilates_a_translation(self.K, self.unit):
            return False
        try:
            self._factorise(0.0)
        except SingularMatrixError:
            return False
        # Rounding may let a Cholesky factorisation of a singular K succeed; its inverse then amplifies one shape.
        # DOF are scaled by their stiffness: otherwise QR gives rotations the rounding errors of deflections.
        unit = units(self.K)[:, None]
        x = np.random.default_rng(2).standard_normal((self.K.shape[0], 3))
        for _ in range(3):
            x = unit * np.linalg.qr(self.factor.solve(x / unit) / unit)[0]
            force, energy = costs(self.K, x)
            if (energy > self.unit**0.5).all():  # a solve brings out shapes without energy
                return True
        return not is_rigid(force, energy, self.unit).any()

    def _float(self, search: Callable[[], float]) -> None:
        mass, stiffness = self.M.diagonal(), self.K.diagonal()
        loaded = (mass > 0) & (stiffness > 0)
        if not loaded.any():
            raise SingularMatrixError("no DOF has both stiffness and mass, so nothing can vibrate. Check K and M")
        ratio = stiffness[loaded] / mass[loaded]
        # Rayleigh quotients of single DOF: not below the lowest ω², not above the highest, whose rounding is the floor.
        floor = 16 * EPS * float(ratio.max())
        guess = 1e-7 * float(ratio.min())
        if self.K.shape[0] > LARGE and sp.issparse(self.K) and self.K.nnz > 10 * self.K.shape[0]:
            # In a fine mesh each DOF alone is far stiffer than the component, and a second factorisation takes minutes.
            wave = smooth_shape(self.K)
            guess = min(guess, 1e-6 * float(wave @ (self.K @ wave)) / float(wave @ (self.M @ wave)))
        self._shift(max(guess, floor))
        elastic, before = search(), np.inf
        while elastic <= 10 * -self.sigma and 2 * floor < -self.sigma < before:
            # A very soft component: the shift must stay below its first elastic mode, which a far larger shift hides.
            before = -self.sigma
            self._shift(max(1e-3 * elastic, floor))
            elastic = search()

    def _shift(self, size: float) -> None:
        """Factorise K - σM at σ = -size, or at a larger shift if rounding makes that indefinite."""
        for sigma in (-size, -1e2 * size, -1e4 * size):
            try:
                # rounded to a power of two: for entries that are round numbers, K - σM is then exact
                return self._factorise(-(2.0 ** float(np.round(np.log2(-sigma)))))
            except SingularMatrixError as error:
                last = error
        count = np.count_nonzero(bare(self.K) & (self.M.diagonal() == 0))
        empty = f"{count} DOF have" if count > 1 else "a DOF has"
        raise SingularMatrixError(
            f"K - σM is not positive definite for σ = {sigma:.3g}. Likely causes: K has a negative eigenvalue, M is not "
            f"positive semidefinite, {empty} neither mass nor stiffness, or {BY_MULTIPLIERS} ({last})")

    def _find_rigid(self) -> float:
        """Subspace iteration, which contracts elastic shapes by |σ|/(λ + |σ|); returns the lowest elastic Ritz value.

        It stops when the lower half of the Ritz values has converged. A mode is rigid if its energy is only rounding and its
        ω² lies well below the next, see `rigid_count`.

        Each DOF without stiffness has a rigid motion of its own (as in reduced models). It causes no forces with which rounding
        could be compared, so the other motions are searched in its complement.
        """
        loose = self.loose
        n, block = self.K.shape[0], 6 + 6 + 2  # motions of a rigid body, room for motions of a mechanism, and a guard
        own = np.zeros((n, len(loose)))
        own[loose, np.arange(len(loose))] = 1.0
        own = orthonormal(own, self.M.__matmul__)[0]
        while True:
            x = self._start(3, min(block, n - len(loose)))
            x -= own @ (own.T @ (self.M @ x))  # else a solve would enlarge this part until all others are rounding
            before = np.full(x.shape[1], np.inf)
            for _ in range(20):
                x = orthonormal(self.factor.solve(self.M @ x), self.M.__matmul__, own)[0]
                values, rotation = np.linalg.eigh(x.T @ (self.K @ x))
                x = x @ rotation
                noise = 1e-14 * np.einsum("ij,ij->j", abs(x), abs(self.K) @ abs(x))
                half = slice(0, (len(values) + 1) // 2)
                still = np.abs(values - before[:len(values)]) <= 0.1 * np.abs(values) + noise
                if still[half].all():
                    break
                before = values
            # Ritz vectors of rigid motion still contain rounding of stiff modes: one more solve removes it.
            cleaned = unit_length(self.factor.solve(self.M @ x))
            cleaned[loose] = 0.0  # such a DOF causes no force, and `own` spans its motion
            # Near a soft spring the error of a solve is the rounding of stiff springs over the soft stiffness. It mixes rigid
            # motion and soft modes. So shapes of little energy are rotated among themselves once more.
            values, low = values.copy(), np.flatnonzero(np.abs(costs(self.K, cleaned)[1]) < SOFT)
            y = orthonormal(cleaned[:, low], self.M.__matmul__)[0]
            if y.shape[1] == len(low):
                energy = y.T @ (self.K @ y)
                values[low], turn = np.linalg.eigh((energy + energy.T) / 2)
                cleaned[:, low] = unit_length(y @ turn)
            order = np.argsort(np.abs(values), kind="stable")
            values, cleaned, noise = values[order], cleaned[:, order], noise[order]
            cost = costs(self.K, cleaned)
            count, self.shares = rigid_count(self.K, values, cleaned, cost, self.unit), np.abs(cost[1])
            if count < len(values) or block >= n - len(loose):
                break
            block *= 2
        self.rigid, self.exact = orthonormal(cleaned[:, :count], self.M.__matmul__, own)[0], own.shape[1]
        if count and not len(loose):  # rotated so that translations, which are known without rounding, come first
            t = translations(n)
            t = t[:, costs_nothing(self.K, t)]
            beyond = np.linalg.norm(self.M @ self.deflate(t), axis=0) / np.linalg.norm(self.M @ t, axis=0)
            t = orthonormal(t[:, beyond <= MIXED], self.M.__matmul__)[0]
            others = self.deflate(self.rigid, t)
            turn = np.linalg.eigh(others.T @ (self.M @ others))[1][:, t.shape[1]:]
            self.rigid = np.hstack([t, orthonormal(others @ turn, self.M.__matmul__, t)[0]])
            self.exact = t.shape[1]
        self.rigid = np.hstack([own, self.rigid])
        rest = values[count:]
        if (rest < -noise[count:]).any():
            share = -cost[1][count + int(rest.argmin())]
            why = f"too large for rounding{_known(self.unit)}" if share > self.unit else \
                f"as rounding{_known(self.unit)} may make it, but the next modes are too near to show which are rigid motion"
            raise SingularMatrixError(
                f"K has a negative eigenvalue, ω² = {rest.min():.3g}: its energy is {share:.1e} of the terms that cancel in "
                f"it, {why}. Check that K belongs to a stable component, and that its file holds all digits (17)")
        self.doubt = self.unit / float(self.shares[count]) if count < len(values) and self.shares[count] else 0.0
        self.note = self._warning(values, count)
        if not len(rest) and self.elastic > 0:
            return self.lowest_elastic()
        self.lowest = float(rest.min(initial=np.inf))
        return self.lowest

    def _warning(self, values: Array, count: int) -> str:
        """The warning if rigid motion has more energy than one rounding, or if the next mode has so little that another one may
        be within rounding; else ''.

        In 700 free beams, plates and solids of up to 5,000 elements, rigid motion had an energy of at most one rounding. If
        pieces are softly connected, their springs show which modes are elastic.
        """
        share, softly = self.shares[:count], soft_springs(self.K, self.unit).nnz > 0
        cost = share.max(initial=0.0)
        seen = np.abs(values[:count]) > self.doubt * np.abs(values[count:count + 1]).max(initial=0.0)  # ω² itself, and its vector
        # in a term x_i k_ij x_j the entry and two products are rounded, by EPS/2 each
        costly = (share > SUMS) | (share > (EPS if softly else 1.5 * EPS)) & (softly | seen)
        # ω² of two modes of a beam may be 81 apart, and translations are known without rounding
        hidden = self.doubt > MIXED**2 and count > self.exact and not softly
        if not costly.any() and not hidden:
            return ""
        omega = np.sqrt(np.abs(values[:count + 1]))
        beyond = f"the next mode lies at ω = {omega[count]:.5g}" if count < len(omega) else "no other mode is known so far"
        return (f"{count} modes are taken as rigid-body motion, although K gives them ω up to {omega[:count].max():.3g} rad/time "
                f"(ω² of either sign: {values[:count].min():.2g} to {values[:count].max():.2g}). Their energy is at most "
                f"{cost:.0e} of the terms that cancel in it, within rounding{_known(self.unit)}, "
                f"and {beyond}. Use fewer elements, or write K with all digits (17), to be sure; a support as soft "
                "as that looks like rounding")

    def lowest_elastic(self) -> float:
        """ω² of the first elastic mode by subspace iteration with the rigid-body modes deflated.

        The search for rigid motion gives only a rough value: if |σ| is far below the elastic ω² of a small component, one solve
        reduces elastic modes below rounding. The value is found once for all handles on the same K and M.
        """
        def found() -> tuple[float, float, bool]:
            x = self._lowest(min(2, self.elastic))
            values, turn = np.linalg.eigh(x.T @ (self.K @ x))
            x, lowest = x @ turn, float(values[0])
            doubt = float(self._blur(x[:, :1], lowest)[0])
            blurred = self.exact == self.rigid.shape[1] and doubt > BLURRED
            if self.exact < self.rigid.shape[1] and doubt > 1 and self.unit == EPS:
                raise SingularMatrixError(f"rounding in the entries of K may change ω² = {lowest:.3g} of the first elastic mode "
                                          f"by {doubt:.1g} times as much, so it may be rigid motion. {IN_PARTS}")
            if blurred:
                lowest, doubt = (float(each[0]) for each in self.sharpened(x, self.rigid[:, :0])[0:3:2])
            return lowest, doubt, blurred

        key = "lowest elastic mode", self._given is None, self.sigma
        self.lowest, self.doubt, self.blurred = shared((self.K, self.M), key, found)
        return self.lowest

    def _lowest(self, count: int, basis: Array | None = None) -> Array:
        """M-orthonormal shapes (n, count) near the lowest elastic modes, M-orthogonal to `basis` (by default rigid modes)."""
        x = self.deflate(self._start(5, count), basis)  # else a solve would enlarge rigid motion until others are rounding
        for _ in range(10):
            x = orthonormal(self.deflate(self.factor.solve(self.M @ x), basis), self.M.__matmul__)[0]
        return x

    def _start(self, seed: int, count: int) -> Array:
        """Random shapes (n, count), each DOF in the unit of its own mass."""
        mass = self.M.diagonal()
        unit = np.where(mass > 0, mass, 1.0) ** -0.5
        return unit[:, None] * np.random.default_rng(seed).standard_normal((len(mass), count))

    def _blur(self, x: Array, values: Array | float) -> Array:
        """The relative change of ω² (k,) of modes (n, k) if each entry of K changes by one rounding."""
        return self.unit * np.einsum("ij,ij->j", np.abs(x), abs(self.K) @ np.abs(x)) / np.abs(values)

    def soft(self) -> tuple[Array, Array, float]:
        """ω² (k,) and modes (n, k) that K holds no digits of, found with K Z = 0; and the next ω², inf if there is none."""
        values, x = np.zeros(0), self.rigid[:, :0]
        lowest = self.lowest_elastic() if self.elastic else np.inf
        blurred, count = np.full(1, self.blurred), 1
        while blurred.any() and len(values) < self.elastic:
            count = min(2 * count, self.elastic - len(values))
            found, more, *_ = self.sharpened(self._lowest(count, np.hstack([self.rigid, x])), x)
            blurred = self._blur(more, found) > BLURRED
            values, x = np.append(values, found[blurred]), np.hstack([x, more[:, blurred]])
            lowest = float(found[~blurred & (found > 0)].min(initial=np.inf))  # DOF without mass give values of either sign
        order = np.argsort(values, kind="stable")
        return values[order], x[:, order], lowest

    @cached_property
    def finite(self) -> int:
        """The number of finite ω²: the rank of M.

        It is the number of DOF with mass, unless several DOF share one mass. Then M, scaled to a unit diagonal, has
        eigenvalues at 0; these are computed up to `DENSE` DOF.
        """
        def rank() -> int:
            massive = np.flatnonzero(self.M.diagonal())
            M = self.M[massive][:, massive] if len(massive) < self.M.shape[0] else self.M
            is_diagonal = np.count_nonzero(M.data if sp.issparse(M) else M) == np.count_nonzero(M.diagonal())
            if is_diagonal or len(massive) > DENSE:
                return len(massive)
            scale = sp.diags_array(M.diagonal(), format="csr") if sp.issparse(M) else np.diag(M.diagonal())
            try:
                factorise(Difference(M, scale, SINGULAR), "definite").close()
            except SingularMatrixError:
                return rank_of_mass(M)
            return len(massive)

        return shared((self.M,), "rank", rank)

    @cached_property
    def loose(self) -> Array:
        """DOF with mass and without stiffness, up to rounding beside a zero diagonal of K.

        The diagonal must be exactly 0, since a soft mount in other units looks like rounding.
        """
        few = np.flatnonzero((self.K.diagonal() == 0) & (self.M.diagonal() > 0))
        return few[bare(self.K, few)]

    @property
    def surely_rigid(self) -> int:
        """The number of rigid-body modes, the first ones, that are carried or due to single DOF: K may have rounding there."""
        return self.rigid.shape[1] if self._given is not None else min(len(self.loose), self.rigid.shape[1])

    @property
    def elastic(self) -> int:
        """The number of elastic modes."""
        return self.finite - self.rigid.shape[1]

    def motion(self, D: Matrix) -> RigidMotion:
        """The rigid-body modes; motions that D does not damp come first."""
        return RigidMotion.of(self.rigid, D, units(self.M))

    @property
    def floating(self) -> bool:
        return self.rigid.shape[1] > 0

    def cleared(self, values: Array, shapes: Array, blur: Array | None = None) -> tuple[Array, Array, Array, Array, Array]:
        """ω² (k,) and modes (n, k), sharpened where K alone holds few digits; which these are, their errors and residuals.

        `blur` (k,) is the relative change of ω² by rounding in K, if it is known.
        """
        which = np.zeros(0, dtype=int)
        if self.exact == self.rigid.shape[1] > 0:
            blur = self._blur(shapes, np.where(values > 0, values, 1.0)) if blur is None else blur
            which = np.flatnonzero((values > 0) & (blur > SOFT))
        if not len(which):
            return values, shapes, which, np.zeros(0), np.zeros(0)
        values, shapes = values.copy(), shapes.copy()
        values[which], shapes[:, which], error, residual = self.sharpened(shapes[:, which])
        return values, shapes, which, error, residual

    def sharpened(self, X: Array, beside: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """ω² (k,) and modes (n, k) near the span of X, the relative error of ω² by rounding in K, and the relative residual.

        With modes `beside` these are excluded, and the result is the lowest modes found.

        K Z = 0 replaces the digits that row sums of K have lost beside a soft spring. The factor has lost these digits, too. So
        modes are corrected by (K - σM)⁻¹ times their residual, until corrections no longer help.
        """
        basis = self.rigid if beside is None else np.hstack([self.rigid, beside])

        def elastic(A: Array, V: Array | None = None) -> Array:
            return orthonormal(self.deflate(orthonormal(A, self.M.__matmul__, V)[0], basis), self.M.__matmul__, V)[0]

        V = X = elastic(self.deflate(X, basis))
        error = np.full(X.shape[1], np.inf)
        while True:
            values, V, forces, _ = self._ritz(V)
            inside = np.linalg.norm(X.T @ (self.M @ V), axis=0) if beside is None else -values
            at = np.sort(np.argsort(-inside, kind="stable")[:X.shape[1]])
            values, X = values[at], V[:, at]
            residual = forces[:, at] - self.M @ X * values
            more = step = self.deflate(self.factor.solve(residual), basis)
            # the gain by further steps; each step has |σ| M too much stiffness
            before, error = error, np.abs(np.einsum("ij,ij->j", residual, step) / values) * (1 - self.sigma / np.abs(values))
            if error.max(initial=0.0) < 64 * EPS or not (error < before / 2).any():
                break
            for _ in range(2):  # a stiff part of the step is rounding, which would reach all ω²: a solve removes it
                more = elastic(more, V)
                soft = np.einsum("ij,ij->j", more, self.K @ more) * EPS < SOFT * np.abs(values).min()
                more = more if soft.all() else self.factor.solve(self.M @ more)
            if not soft.any():
                break
            V = np.hstack([V, elastic(more[:, soft], V)])
        if error.max(initial=0.0) < SOFT:
            X = X - step  # gives the digits of stiff DOF, which do not affect ω²
        values, X, forces, size = self._ritz(X)
        error = np.maximum(error, self.unit * np.einsum("ij,ij->j", np.abs(X), size) / np.abs(values))
        residual, size = forces - self.M @ X * values, abs(self.K) @ np.abs(X) + abs(self.M) @ np.abs(X) * np.abs(values)
        return values, X, error, np.linalg.norm(residual, axis=0) / np.linalg.norm(size, axis=0)

    def _ritz(self, V: Array) -> tuple[Array, Array, Array, Array]:
        """ω² (k,) and modes (n, k) in the span of V, VᵀMV = I, with K Z = 0; their forces, and the sizes of terms that cancel
        there.

        In a mixed basis the rounding of stiff modes enters the energy of soft modes. The first rotation separates them. The
        second uses the energy of each alone.
        """
        for _ in range(2):
            forces, size = elastic_forces(self.K, V, self.rigid, pieces(self.K))
            turn = np.linalg.eigh((V.T @ forces + forces.T @ V) / 2)[1]
            V = V @ turn
        forces, size = forces @ turn, size @ np.abs(turn)
        return np.einsum("ij,ij->j", V, forces) / np.einsum("ij,ij->j", V, self.M @ V), V, forces, size

    def release(self) -> None:
        """Drop the factor, which other handles may share. All methods that need no solve still work."""
        vars(self).pop("factor", None)

    def make_room(self) -> None:
        """Drop the factor if a count of the modes would not fit into memory beside it."""
        from femsub.algebra import SparseFactor

        factor = vars(self).get("factor")
        if isinstance(factor, SparseFactor) and not has_room_to_count(self.K, factor.fill * factor.size):
            self.release()

    def deflate(self, x: Array, shapes: Array | None = None) -> Array:
        """(I - ΦΦᵀM)x, M-orthogonal to the modes Φ; by default the rigid-body modes."""
        basis = self.rigid if shapes is None else shapes
        return x - basis @ (basis.T @ (self.M @ x))

    def elastic_solve(self, B: Array, kept: Array | None = None) -> Array:
        """X = (I - ΦΦᵀM) K⁺ (I - MΦΦᵀ) B, shape (n, k): the static response to B without the contribution of the modes Φ.

        Φ are the rigid-body modes, or `kept` (n, m), which must include them. X is then the residual flexibility
        (Craig and Kurdila, Fundamentals of Structural Dynamics, 2006, ch. 17). With σ = 0 one solve is enough. With
        σ < 0 the correction x ← x + (K - σM)⁻¹(b - Kx) contracts by |σ|/(λ + |σ|) with the lowest λ not in Φ. This rate
        gives the number of corrections beforehand: one or two.
        """
        basis = self.rigid if kept is None else kept
        lowest = self.lowest  # no mode outside Φ (ascending) is lower
        if basis.shape[1] > self.rigid.shape[1]:
            lowest = float(basis[:, -1] @ (self.K @ basis[:, -1]))
        X = np.empty(B.shape, order="F")
        for start in range(0, B.shape[1], BLOCK):
            part = slice(start, start + BLOCK)
            b = B[:, part] - self.M @ (basis @ (basis.T @ B[:, part]))
            x = self.deflate(self.factor.solve(b), basis)
            if self.sigma:
                rate = -self.sigma / (lowest - self.sigma)
                size, step = np.linalg.norm(x, axis=0), np.ones(x.shape[1])
                going = size > 0
                while going.any():
                    change = self.deflate(self.factor.solve(b - self.K @ x), basis)
                    x = x + change
                    before, step = step, np.linalg.norm(change, axis=0) / np.where(size > 0, size, 1.0)
                    going &= step < before / 2  # a correction that does not contract is rounding
                    rate = max(rate, float((step[going] / before[going]).max(initial=0.0)))
                    going &= rate * step > ROUNDING  # the change that the next correction may make
                x = self.deflate(x, basis)
            X[:, part] = x
        return X


def motion_of(carried: Carried) -> RigidMotion | None:
    """The rigid motion that a model carries; None if it carries none, or if rounding does not let it be decided."""
    return found(carried, of_full)


def of_full(part: Substructure | Pencil) -> RigidMotion | None:
    """The rigid motion of a part that carries none, from its own K; None for a large part, or if it is not clear."""
    if part.size > DENSE:
        return None
    if not (part.K.nnz if sp.issparse(part.K) else part.K.any()):  # masses that springs join to others
        return RigidMotion.of(np.eye(part.size), part.D, units(part.M))
    try:
        return ShiftInvert(part.K, part.M).motion(part.D)
    except SingularMatrixError:
        return None


def _block(matrix: Matrix, rows: Array | slice) -> Matrix:
    """The matrix, or its submatrix of these rows and columns, which is made once and kept as long as the matrix."""
    if isinstance(rows, slice):
        return matrix

    def made() -> Matrix:
        return sp.csr_array(matrix[rows][:, rows]) if sp.issparse(matrix) else matrix[np.ix_(rows, rows)]

    return shared((matrix,), ("block", rows.tobytes()), made, lambda it: 12.0 * it.nnz if sp.issparse(it) else it.nbytes)


def _known(unit: float) -> str:
    """The rounding of K's entries as words in a message; '' if it is eps."""
    return f" of K's entries (about {unit:.0e} of each)" if unit > EPS else ""
