"""Normal modes (K - ω²M)φ = 0 with their certificates: a residual for each, and an independent count.

The matrices are factorised once, as K - σM; the handle (`ShiftInvert`) serves modes and static solves alike. σ is 0
for a component that is held, and a small negative number for one that floats: there the rigid-body modes are found
first, by subspace iteration with the same factor, and kept out of the search for the elastic ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.errors import InputError, MissedModesError, NotConvergedError, SingularMatrixError
from femsub.factor import SMALL, Handle, factorise
from femsub.pencil import EPS, Array, Matrix

if TYPE_CHECKING:
    from femsub.substructure import Substructure

TOLERANCE = 1e-12  # asked of Krylov-Schur, relative to the shifted and inverted eigenvalue
ACCEPTED = 1e-10  # the largest relative residual of a mode that is returned
RIGID = 1e-13  # ‖Kφ‖ ≤ RIGID ‖|K||φ|‖ is rounding: a rigid-body mode in any system of units
DENSE = 3000  # up to so many DOF LAPACK takes over where a large part of all modes is wanted
GAP = 1e-2  # rigid-body modes lie at least so much below the first elastic one (as ω², which is rounding for them)
SEEDS = 14  # vectors of the first search for rigid-body modes: six, room for a mechanism, and a guard


@dataclass(frozen=True, eq=False, repr=False)
class NormalModes:
    """Φ with KΦ = MΦΩ², ΦᵀMΦ = I; rigid-body modes first, then elastic ones by frequency.

    Attributes
    ----------
    eigenvalues : ndarray, shape (k,)
        ω², exactly 0 for rigid-body modes.
    shapes : ndarray, shape (n, k)
    rigid : int
        The number of rigid-body modes.
    residual : ndarray, shape (k,)
        ‖Kφ - ω²Mφ‖ / ‖(|K| + ω²|M|)|φ|‖, free of units.
    counted : tuple (limit, count)
        An independent count: so many modes lie below the frequency `limit`, and all are here.
    factorisations : int
        Made for the modes (the one for the count comes on top).
    """

    eigenvalues: Array
    shapes: Array
    rigid: int
    residual: Array
    counted: tuple[float, int]
    factorisations: int = 1

    @property
    def frequencies(self) -> Array:
        """ω in radians per unit of time, shape (k,)."""
        return np.sqrt(self.eigenvalues)

    def __repr__(self) -> str:
        elastic = self.frequencies[self.rigid:]
        span = f", ω {elastic[0]:.5g} to {elastic[-1]:.5g} rad/time" if len(elastic) else ""
        worst = f"{self.residual.max():.0e}" if len(self.residual) else "none"
        return (f"NormalModes: {self.rigid} rigid and {len(elastic)} elastic{span}; largest residual {worst}; "
                f"{self.counted[1]} counted below {self.counted[0]:.5g}")


class ShiftInvert:
    """(K - σM)⁻¹ factorised once, with the rigid-body modes Φ_r (n, n_r), M-orthonormal, that K turned out to have."""

    def __init__(self, K: Matrix, M: Matrix) -> None:
        self.K, self.M, self.sigma, self.factorisations = K, M, 0.0, 0
        self.rigid: Array = np.zeros((K.shape[0], 0))
        self.lowest = np.inf  # ω² of the first elastic mode, about; known where rigid-body modes had to be sought
        if not _annihilates_a_translation(K):
            try:
                self._factorise(0.0)
            except SingularMatrixError:
                pass
            else:
                if not self._nearly_singular():
                    return
        self._float()
        if not self.floating:
            self._factorise(0.0)  # held after all, by little

    def _factorise(self, sigma: float) -> None:
        shifted = self.K if sigma == 0 else self.K - sigma * self.M
        self.factorisations += 1
        self.factor: Handle = factorise(shifted, "definite")
        self.sigma = sigma

    def _nearly_singular(self) -> bool:
        # A Cholesky factorisation may survive a singular K by rounding; its inverse then blows up one shape.
        x = _normalised(self.factor.solve(np.random.default_rng(2).standard_normal((self.K.shape[0], 2))), None)
        for _ in range(2):
            x = _normalised(self.factor.solve(x), None)
        return bool((_rounding_ratio(self.K, x) < RIGID).any())

    def _float(self) -> None:
        mass, stiffness = self.M.diagonal(), self.K.diagonal()
        loaded = (mass > 0) & (stiffness > 0)
        if not loaded.any():
            raise SingularMatrixError("K has no stiffness on any DOF with mass: there is nothing to vibrate")
        ratio = stiffness[loaded] / mass[loaded]
        # Rayleigh: no lower than the lowest frequencies, and no higher than the highest, whose rounding is the floor.
        floor = 16 * EPS * float(ratio.max())
        self._shift(max(1e-7 * float(ratio.min()), floor))
        elastic = self._find_rigid()
        if elastic <= 10 * -self.sigma and -self.sigma > floor:
            # A very soft component: the shift must stay below its first elastic mode.
            self._shift(max(1e-3 * elastic, floor))
            self._find_rigid()

    def _shift(self, size: float) -> None:
        """Factorises K - σM at σ = -size, or somewhat further down where rounding leaves K too indefinite for that."""
        for sigma in (-size, -1e2 * size, -1e4 * size):
            try:
                return self._factorise(_short(sigma))
            except SingularMatrixError as error:
                last = error
        raise SingularMatrixError(
            f"K - σM is not positive definite for σ = {sigma:.3g}: K has a negative eigenvalue, or M is not "
            f"positive semidefinite, or a DOF has neither mass nor stiffness ({last})")

    def _find_rigid(self) -> float:
        """Subspace iteration contracts elastic shapes by |σ|/(λ + |σ|); returns the lowest elastic Ritz value.

        It goes on until the lower half of the Ritz values stands still. Rigid are those that cost no more energy than
        rounding and lie well below the next: the first bending mode of a long beam may be within rounding, too, but
        the second is at most 40 times higher.
        """
        n, block = self.K.shape[0], SEEDS
        while True:
            x = np.random.default_rng(3).standard_normal((n, min(block, n)))
            before = np.full(x.shape[1], np.inf)
            for _ in range(20):
                x = _normalised(self.factor.solve(self.M @ x), self.M)
                values, rotation = np.linalg.eigh(x.T @ (self.K @ x))
                x = x @ rotation
                noise = 1e-14 * np.einsum("ij,ij->j", abs(x), abs(self.K) @ abs(x))
                half = slice(0, (len(values) + 1) // 2)
                still = np.abs(values - before[:len(values)]) <= 0.1 * np.abs(values) + noise
                if still[half].all():
                    break
                before = values
            # Ritz vectors of rigid motion still hold rounding of the stiff ones: one more solve cleans each.
            cleaned = _normalised(self.factor.solve(self.M @ x), self.M, mix=False)
            order = np.argsort(np.abs(values), kind="stable")
            values, cleaned, noise = np.abs(values[order]) * np.sign(values[order]), cleaned[:, order], noise[order]
            elastic = _rounding_ratio(self.K, cleaned) >= RIGID
            count = int(np.argmax(elastic)) if elastic.any() else len(values)
            while 0 < count < len(values) and abs(values[count - 1]) > GAP * abs(values[count]):
                count -= 1
            if count < len(values) or block >= n:
                break
            block *= 2
        self.rigid = _normalised(cleaned[:, :count], self.M)
        self.lowest, rest = float(values[count:].min(initial=np.inf)), values[count:]
        if (rest < -noise[count:]).any():
            raise SingularMatrixError(f"K has a negative eigenvalue, ω² = {rest.min():.3g}, too large for rounding: "
                                      "is it the stiffness of a stable component, written with all its digits?")
        return self.lowest

    @property
    def floating(self) -> bool:
        return self.rigid.shape[1] > 0

    def deflate(self, x: Array, shapes: Array | None = None) -> Array:
        """(I - ΦΦᵀM)x, by default with the rigid-body modes: what is left is M-orthogonal to them."""
        basis = self.rigid if shapes is None else shapes
        return x - basis @ (basis.T @ (self.M @ x))

    def elastic_solve(self, B: Array, kept: Array | None = None) -> Array:
        """X = (I - ΦΦᵀM) K⁺ (I - MΦΦᵀ) B, shape (n, k): the response to B without the share of the modes Φ.

        Φ is the rigid-body modes, or `kept` (n, m) which must include them: then X is the residual flexibility
        (Craig and Kurdila, Fundamentals of Structural Dynamics, 2006, ch. 17). With σ = 0 one solve does it; with
        σ < 0 the correction x ← x + (K - σM)⁻¹(b - Kx) contracts by |σ|/(λ + |σ|) with the lowest λ not in Φ.
        """
        basis = self.rigid if kept is None else kept
        b = B - self.M @ (basis @ (basis.T @ B))
        x = self.deflate(self.factor.solve(b), basis)
        if self.sigma == 0:
            return x
        size = np.linalg.norm(x, axis=0)
        for _ in range(30):
            change = self.deflate(self.factor.solve(b - self.K @ x), basis)
            x = x + change
            step = np.linalg.norm(change, axis=0)
            if (step <= 1e-14 * size).all():
                break
        return self.deflate(x, basis)

    def modes(self, count: int) -> NormalModes:
        """The rigid-body modes and the `count` lowest elastic ones, certified."""
        n, rigid = self.K.shape[0], self.rigid.shape[1]
        finite = int(np.count_nonzero(self.M.diagonal())) if _is_diagonal(self.M) else n
        if count < 0 or count + rigid > finite:
            raise InputError(f"{count} elastic modes were asked for, but there are {finite - rigid}"
                             + (f" (and {rigid} rigid-body modes)" if rigid else ""))
        if n <= SMALL or not sp.issparse(self.K) or (count > 0.3 * n and n <= DENSE):
            return self._dense(count)
        return self._sparse(count, finite)

    def _dense(self, count: int) -> NormalModes:
        """All by LAPACK. Massless DOF are condensed; rigid-body modes are moved to ω² = λ₁/4, by K + ω² MΦ_rΦ_rᵀM,
        which leaves the elastic ones where they are.
        """
        import scipy.linalg as la

        K, M = (part.toarray() if sp.issparse(part) else part for part in (self.K, self.M))
        rigid = self.rigid.shape[1]
        if rigid:
            held = M @ self.rigid
            K = K + 0.25 * min(self.lowest, float(np.trace(K))) * (held @ held.T)
        massive, bare = np.flatnonzero(M.diagonal()), np.flatnonzero(M.diagonal() == 0)
        lift = np.zeros((0, len(massive)))
        if len(bare):
            lift = -la.solve(K[np.ix_(bare, bare)], K[np.ix_(bare, massive)], assume_a="pos", check_finite=False)
            K, M = K[np.ix_(massive, massive)] + K[np.ix_(massive, bare)] @ lift, M[np.ix_(massive, massive)]
        values, moving = _from_both_ends((K + K.T) / 2, M)
        if len(values) < rigid + count:
            raise InputError(f"{count} elastic modes were asked for, but there are {len(values) - rigid}")
        keep = slice(rigid, rigid + count)
        shapes = np.zeros((self.K.shape[0], count))
        shapes[massive], shapes[bare] = moving[:, keep], lift @ moving[:, keep]
        shapes = self.deflate(shapes)
        gram = shapes.T @ (self.M @ shapes)
        shapes = 1.5 * shapes - 0.5 * (shapes @ gram)  # one step of Newton and Schulz towards ΦᵀMΦ = I
        return self._result(values[keep], shapes, (np.inf, len(values)))

    def _sparse(self, count: int, finite: int) -> NormalModes:
        from femsub._slepc import Factor, symmetric_modes

        assert isinstance(self.factor, Factor)
        rigid = self.rigid.shape[1]
        ask = min(count + 2, finite - rigid)
        if ask == 0:
            return self._result(np.zeros(0), np.zeros((self.K.shape[0], 0)), (0.0, 0))
        values, shapes = symmetric_modes(self.factor, self.K, self.M, self.sigma, ask, tol=TOLERANCE, known=self.rigid)
        for attempt in range(4):
            order = np.argsort(values, kind="stable")
            values, shapes = values[order], shapes[:, order]
            limit, below = _limit(values, min(count, len(values)))
            counted = factorise(self.K - limit * self.M, "symmetric").negative_pivots
            missed = counted - below - rigid
            if missed == 0:
                return self._result(values[:count], shapes[:, :count], (float(np.sqrt(limit)), counted))
            if missed < 0 or attempt == 3:
                break
            extra = symmetric_modes(self.factor, self.K, self.M, self.sigma, missed, tol=TOLERANCE, seed=17 + attempt,
                                    known=np.hstack([self.rigid, shapes]))
            values, shapes = np.append(values, extra[0]), np.hstack([shapes, extra[1]])
        raise MissedModesError(f"{below + rigid} modes were found below ω = {np.sqrt(limit):.6g}, but the inertia of "
                               f"K - ω²M counts {counted}; ask for a few modes more or fewer, to leave the cluster")

    def _result(self, values: Array, shapes: Array, counted: tuple[float, int]) -> NormalModes:
        values = np.concatenate([np.zeros(self.rigid.shape[1]), values])
        shapes = np.hstack([self.rigid, shapes])
        residual = relative_residual(self.K, self.M, values, shapes)
        if residual.max(initial=0.0) > ACCEPTED:
            raise NotConvergedError(f"mode {int(residual.argmax()) + 1} has a relative residual of {residual.max():.1e}, and "
                                    f"{ACCEPTED:g} is the most that is accepted; check the scaling of K and M")
        return NormalModes(values, shapes, self.rigid.shape[1], residual, counted, self.factorisations)


def normal_modes(model: Substructure, count: int | None = None, band: tuple[float, float] | None = None) -> NormalModes:
    """(K - ω²M)φ = 0: the lowest modes of a substructure, full or reduced, undamped and without contact.

    Parameters
    ----------
    model : Substructure
    count : int, optional
        Elastic modes wanted; the rigid-body modes of a floating part come on top.
    band : (lo, hi), optional
        All modes with lo ≤ ω ≤ hi in radians per unit of time instead, rigid-body modes included if lo = 0.

    Raises
    ------
    InputError
        Neither or both of `count` and `band`; more modes than there are.
    SingularMatrixError
        K is not positive semidefinite.
    NotConvergedError, MissedModesError
        The solver gave up, or an independent count (the inertia of K - ω²M) contradicts what was found.
    """
    if (count is None) == (band is None):
        raise InputError("give either count (elastic modes) or band=(lo, hi) in rad per unit of time")
    if count is not None:
        return ShiftInvert(model.K, model.M).modes(int(count))
    lo, hi = check_band(band)
    modes = modes_below(model.K, model.M, hi)
    inside = modes.frequencies >= lo
    return NormalModes(modes.eigenvalues[inside], modes.shapes[:, inside], int(inside[:modes.rigid].sum()),
                       modes.residual[inside], modes.counted, modes.factorisations)


def modes_below(K: Matrix, M: Matrix, limit: float) -> NormalModes:
    """All modes with ω < limit; their number is the inertia of K - limit² M, known before the search begins."""
    handle = ShiftInvert(K, M)
    below = factorise(K - limit**2 * M, "symmetric").negative_pivots
    modes = handle.modes(max(0, below - handle.rigid.shape[1]))
    if len(modes.eigenvalues) and modes.frequencies[-1] > limit:
        raise MissedModesError(f"{below} modes were counted below ω = {limit:.6g}, but the last of as many that were found "
                               f"is at {modes.frequencies[-1]:.6g}: a mode was missed, or lies on the edge of the band")
    return NormalModes(modes.eigenvalues, modes.shapes, modes.rigid, modes.residual, (limit, below), modes.factorisations)


def check_band(band: object) -> tuple[float, float]:
    """A band (lo, hi) with 0 ≤ lo < hi, in radians per unit of time."""
    try:
        lo, hi = (float(edge) for edge in band)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(f"band must be a pair (lo, hi) in rad per unit of time, not {band!r}") from None
    if not (0 <= lo < hi < np.inf):
        raise InputError(f"band must satisfy 0 <= lo < hi < inf, but is ({lo!r}, {hi!r})")
    return lo, hi


def relative_residual(K: Matrix, M: Matrix, values: Array, shapes: Array) -> Array:
    """‖Kφ - λMφ‖ / ‖(|K| + |λ||M|)|φ|‖ column by column, shape (k,)."""
    residual = np.linalg.norm(K @ shapes - (M @ shapes) * values, axis=0)
    scale = np.linalg.norm(abs(K) @ abs(shapes) + (abs(M) @ abs(shapes)) * abs(values), axis=0)
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def _from_both_ends(K: Array, M: Array) -> tuple[Array, Array]:
    """All finite λ (k,) and φ (n, k) of dense Kφ = λMφ, K definite: the lower half (on a logarithmic scale) from
    Mφ = θKφ, the upper from Kφ = λMφ, since each loses digits towards its far end.
    """
    import scipy.linalg as la

    theta, x = la.eigh(M, K, check_finite=False)
    theta, x = theta[::-1], x[:, ::-1]
    low = int(np.count_nonzero(theta > 1e-15 * theta[0]))
    try:
        values, upper = la.eigh(K, M, check_finite=False)
    except la.LinAlgError:  # M is only semidefinite
        values, upper = np.zeros(low), np.zeros((len(K), low))
    else:
        low = int(np.count_nonzero(theta > np.sqrt(theta[0] / values[-1])))
    values[:low], upper[:, :low] = 1 / theta[:low], x[:, :low] / np.sqrt(theta[:low])
    return values, upper


def _limit(values: Array, count: int) -> tuple[float, int]:
    """The widest gap behind the `count` wanted ones, and how many lie below it: the inertia is counted there.

    Where all of the rest is one cluster that is cut off, the limit is just above it: what the cluster still hides will
    be counted, and fetched.
    """
    if len(values) > count:
        tail = values[count - 1:] if count else np.append(0.0, values)
        gaps = np.diff(tail) / tail[1:]
        at = int(np.argmax(gaps))
        if gaps[at] > 1e-6:
            return float((tail[at] + tail[at + 1]) / 2), at + count
    return float(values[-1] * (1 + 1e-6)), len(values)


def _short(x: float) -> float:
    """The power of two next to x: where K and M are round numbers, K - σM is then exact."""
    return float(np.copysign(2.0 ** np.round(np.log2(abs(x))), x))


def _annihilates_a_translation(K: Matrix) -> bool:
    """Whether a uniform motion of every s-th DOF costs no energy: a cheap sign of a floating component."""
    n = K.shape[0]
    probes = [np.where(np.arange(n) % stride == 0, 1.0, 0.0) for stride in (1, 2, 3, 6) if n % stride == 0]
    return bool((_rounding_ratio(K, np.stack(probes, axis=1)) < RIGID).any())


def _rounding_ratio(K: Matrix, x: Array) -> Array:
    scale = np.linalg.norm(abs(K) @ abs(x), axis=0)
    return np.divide(np.linalg.norm(K @ x, axis=0), scale, out=np.zeros(x.shape[1]), where=scale > 0)


def _normalised(x: Array, M: Matrix | None, mix: bool = True) -> Array:
    """Columns made orthonormal (in M where given); with mix=False only scaled to unit length."""
    if not mix:
        return x / np.linalg.norm(x, axis=0)
    if M is None:
        return np.linalg.qr(x)[0]
    for _ in range(2):  # the second pass gives back what DOF of mixed units cost the first
        x = x / np.sqrt(np.einsum("ij,ij->j", x, M @ x))
        gram = x.T @ (M @ x)
        values, vectors = np.linalg.eigh((gram + gram.T) / 2)
        keep = values > 1e-14 * values[-1:]
        x = x @ (vectors[:, keep] / np.sqrt(values[keep]))
    return x


def _is_diagonal(M: Matrix) -> bool:
    return bool(sp.issparse(M) and M.nnz <= M.shape[0] and (M - sp.diags_array(M.diagonal())).nnz == 0)
