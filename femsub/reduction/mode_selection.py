"""The number of modes that a basis needs for a band and a tolerance. One factorisation; modes are added, never recomputed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import check_columns
from femsub.checks import EPS, Array, Matrix
from femsub.errors import NotConvergedError
from femsub.model import SHARE, Estimate, in_band, within
from femsub.modes import NormalModes, all_modes, independent, lightest, lowest_modes, solve
from femsub.reduction.basis import Kept, in_blocks
from femsub.reduction.error_bounds import Nested
from femsub.reduction.rigid import RigidMotion, coordinates, free_first
from femsub.reduction.statics import Span, Statics

if TYPE_CHECKING:
    from femsub.algebra import Carried
    from femsub.model import Pencil

BEGIN = 10  # modes of the first search
MOST = 1000  # modes at which the search gives up in a larger model
DENSE = 3000  # DOF up to which all modes may be taken
TINY = float(np.finfo(float).tiny)
MANY = 300  # coordinates above which an estimate solves only for what may lie in the band or near it
BEYOND = 2.0  # times the end of the band: so far
FAINT = 1e-16  # directions with a smaller share of the squared residuals are dropped


class Search:
    """The modes found so far, and the static shapes without the modes' contribution. `top` is the end of the band."""

    def __init__(self, statics: Statics, pencil: Pencil | None, begin: int = BEGIN, top: float = np.inf) -> None:
        self.statics, self.pencil, self.limit = statics, pencil, BEYOND * top
        self.most = statics.handle.elastic
        self.found = lowest_modes(statics.handle, min(begin, self.most), evidence=False)
        self.loads = np.hstack([statics.forces, statics.inertia[statics.part.rows]])
        self.rest = statics.handle.elastic_solve(self.loads, self.found.shapes)

    @property
    def modes(self) -> int:
        return len(self.found.eigenvalues) - self.found.rigid

    @property
    def top(self) -> float:
        """The highest frequency found."""
        return float(self.found.frequencies[-1]) if self.modes else 0.0

    @property
    def complete(self) -> bool:
        return self.modes == self.most

    def grow(self, count: int) -> None:
        """Compute modes up to `count`, and remove their contribution from the static shapes (no further solve)."""
        handle, sub = self.statics.handle, self.statics.part.sub
        count = min(count, self.most)
        # columns needed: modes twice, Krylov vectors for the new modes, loads and static shapes (twice, for the residuals)
        check_columns(sub.name, sub.size, 5 * (count - self.modes) + 4 * count + 4 * self.loads.shape[1])
        self.replace(lowest_modes(handle, count, known=self.found, evidence=False))

    def replace(self, found: NormalModes) -> None:
        self.found = found
        self.rest = self.statics.handle.deflate(self.rest, found.shapes)

    def needed(self, limit: float) -> int:
        """Estimated number of modes below `limit`, extrapolated from the modes found so far."""
        omega = self.found.frequencies[self.found.rigid:]
        half = len(omega) // 2
        power = np.log(len(omega) / half) / max(np.log(omega[-1] / omega[half - 1]), 1e-3) if half else 1.0
        guess = len(omega) * (limit / omega[-1]) ** min(max(power, 0.5), 3.0)
        return int(np.clip(1.1 * guess + 4, 1.5 * len(omega) + 1, 4 * len(omega) + 4))

    def undamped(self) -> tuple[Nested, Span]:
        """M and K in U = [C Φ Ξ], and U."""
        return self._space(self.loads, self.rest)

    def damped(self, plain: Nested, span: Span, band: tuple[float, float]) -> Nested:
        """M, D and K, with Ξ extended by the static responses to the residuals of the complex modes in the band."""
        plain = self._with_damping(plain, span)
        loads = self._residuals(plain, span, band)
        return self._with_damping(*self.extended(loads)) if loads.shape[1] else plain

    def extended(self, loads: Array) -> tuple[Nested, Span]:
        """M and K in U, and U, with Ξ extended by the static responses to further loads."""
        rest = self.statics.handle.elastic_solve(loads, self.found.shapes)
        return self._space(np.hstack([self.loads, loads]), np.hstack([self.rest, rest]))

    def nested(self, band: tuple[float, float]) -> Nested:
        """The complete model for the estimate: damped if there is a pencil."""
        plain, span = self.undamped()
        return plain if self.pencil is None else self.damped(plain, span, band)

    def _with_damping(self, plain: Nested, span: Span) -> Nested:
        assert self.pencil is not None
        D, symmetric = span.projected(self.pencil.D), self.pencil.symmetric[1]
        return replace(plain, D=(D + D.T) / 2 if symmetric else D, symmetric=symmetric)

    def _space(self, loads: Array, rest: Array) -> tuple[Nested, Span]:
        statics, found = self.statics, self.found
        static, stiffness, mass, _ = independent(statics.handle, rest, loads, found.shapes, found.eigenvalues)
        span = Span(statics, found.shapes, static)
        M, K = in_blocks(statics.condensed, found.eigenvalues, stiffness, mass, span.dot(statics.inertia))
        inner = [statics.constraint[statics.part.rows], found.shapes, static]
        forces = np.concatenate([shapes.T @ statics.forces for shapes in inner])
        return Nested(M, K, None, len(statics.condensed), found.rigid, found.eigenvalues[found.rigid:], forces, statics.rounding,
                      lightest=lightest(statics.handle), limit=self.limit if len(M) > MANY else np.inf,
                      motion=self._motion(span, len(M))), span

    def _motion(self, span: Span, size: int) -> RigidMotion | None:
        """The rigid motion of the part in U. It is the part's D that says which of it is not damped."""
        q = coordinates(self.statics, self.found.rigid, size)
        return None if q is None else free_first(q, span.times(q), self.pencil)

    def _residuals(self, plain: Nested, span: Span, band: tuple[float, float]) -> Array:
        """The residuals of the largest model's complex modes, compressed; see `residual`."""
        sides = [self.residual(span, value, x, left) for value, x, left in sides_of(plain, band)]
        return compressed(np.hstack(sides), self.statics.handle.K.diagonal())

    def residual(self, span: Span, value: Array, x: Array, left: bool) -> Array:
        """Residuals (λ²MΞx + λDUx)/|λ|, real and imaginary parts (n_i, 2k); of the transposed pencil for `left` vectors.

        Their parts in MΦ, F and MC are left out: U already contains K⁻¹ times these.
        """
        assert self.pencil is not None
        D, size, blocks = self.pencil.D.T if left else self.pencil.D, np.abs(value), []
        for part in (np.real, np.imag):
            static = np.zeros(x.shape)
            static[span.rest] = part(x * (value**2 / size))[span.rest]
            residual = self.pencil.M @ span.times(static) + D @ span.times(part(x * (value / size)))
            blocks.append(residual[self.statics.part.rows])
        return np.hstack(blocks)


def lowest(statics: Statics, count: int) -> Kept:
    """The `count` lowest modes, and one more for the cut-off if there is one. In a large model `count_deferred` must still
    run."""
    more = count < statics.handle.elastic
    found = lowest_modes(statics.handle, count + more, defer=True)
    return Kept(found, count, float(found.frequencies[-1]) if more else np.inf)


def chosen(statics: Statics, band: Any, tol: Any, pencil: Pencil | None) -> Kept:
    """The modes and the estimate of the smallest basis that meets `tol` in the band and has hi below 0.7 of its cut-off.

    Parameters
    ----------
    pencil : Pencil, optional
        With the damping whose complex eigenvalues must be within `tol`, too.

    Raises
    ------
    NotConvergedError
        No basis meets it, even with all modes or 1000 of them.
    """
    hi = band[1]
    search, counted = Search(statics, pencil, top=hi), False
    while True:
        if not search.complete and SHARE * search.top <= hi:
            search.grow(search.needed(hi / SHARE))
            continue
        nested, span = search.undamped()
        best = _smallest(nested, band, tol, search.complete)
        if best.met and pencil is not None:
            nested = search.damped(nested, span, band)
            best = _smallest(nested, band, tol, search.complete, best.modes)
        if not best.met:
            search.grow(_further(nested, best, search, statics.part.sub.name))
            continue
        if counted or search.found.tally.counted is not None:
            return Kept(search.found, best.modes, best.cutoff, best)
        # the inertia count must cover the modes kept and the one that gives the cut-off
        least = min(best.modes + 1, search.most)
        found = lowest_modes(statics.handle, least, known=search.found, defer=True)
        if np.array_equal(found.eigenvalues, search.found.eigenvalues[:len(found.eigenvalues)]):
            return Kept(found, best.modes, best.cutoff, best)
        counted = True  # the inertia count has found a mode that had been missed
        search.replace(lowest_modes(statics.handle, search.modes, known=found, evidence=False))


def _smallest(nested: Nested, band: tuple[float, float], tol: float, complete: bool, least: int = 0) -> Estimate:
    """The estimate of the smallest basis (at least `least` modes) that meets `tol`, by bisection; else of the largest."""
    most = nested.modes if complete else nested.modes - 1
    cutoffs = np.array([nested.cutoff(count) for count in range(most + 1)])
    low = int(np.searchsorted(SHARE * cutoffs, band[1], side="right"))  # the fewest with the band below 0.7 of the cut-off
    low, best = max(low, least), nested.estimate(most, band, tol)
    if not best.met:
        return best
    while low < best.modes:
        middle = (low + best.modes) // 2
        other = nested.estimate(middle, band, tol)
        if other.met:
            best = other
        else:
            low = middle + 1
    return best


def _further(nested: Nested, best: Estimate, search: Search, name: str) -> int:
    """The number of modes to try next, extrapolated from the decrease of the error.

    Raises
    ------
    NotConvergedError
        There are no more modes; a large model has used 1000 of them; or rounding alone exceeds the tolerance.
    """
    count, size = search.modes, search.statics.handle.K.shape[0]
    floor = nested.floor(best.band)
    if search.complete or floor > best.tol or (count >= MOST and size > DENSE):
        where = "all modes" if search.complete else f"{best.modes} modes"
        rounding = f". Rounding alone causes {floor:.1e}" if floor > best.tol else ""
        massless = search.statics.handle.finite < size
        bare = ", and those with damping but no mass," if search.complete and search.pencil is not None and massless else ""
        raise NotConvergedError(f"{name!r} cannot be reduced to a relative error of {best.tol:g} from {best.band[0]:.5g} to "
                                f"{best.band[1]:.5g} rad/time. With {where}: {best!r}{rounding}. Lower the band, raise tol, put "
                                f"the belt's DOF{bare} into the interface, or call reduce(..., ports=True)")
    half = nested.estimate(best.modes // 2, best.band, best.tol, damped=False) if best.modes > 1 else best
    factor = 1.5
    if not best.unmatched and np.isfinite(best.worst):
        slope = np.log(max(half.worst, best.worst) / best.worst) / np.log(2.0) if np.isfinite(half.worst) else 4.0
        factor = (best.worst / best.tol) ** (1 / max(slope, 0.5))
    return int(count * np.clip(1.1 * factor, 1.5, 3.0)) + 1


def sides_of(nested: Nested, band: tuple[float, float]) -> list[tuple[Array, Array, bool]]:
    """λ and vectors in U of the largest reduced model about the band, of equal energy; the left ones if D is unsymmetric."""
    values, _, X, Y, _ = nested.damped(nested.most)
    wanted = (values.imag <= 1.1 * band[1]) & (np.abs(values) <= 2 * band[1])
    sides = []
    for value, x, left in ((values, X, False), (values.conj(), Y, True))[:2 - nested.symmetric]:
        value, x = value[wanted], x[:, wanted]
        # kinetic plus elastic energy; scaled by mass alone, a shape without mass would dominate
        kinetic, elastic = (np.abs(np.einsum("ij,ij->j", x.conj(), part @ x)) for part in (nested.M, nested.K))
        sides.append((value, x / np.sqrt(kinetic + elastic / np.abs(value) ** 2), left))
    return sides


def compressed(columns: Array, stiffness: Array) -> Array:
    """A basis of the columns, orthonormal after scaling each row by sqrt(K_ii); negligible directions are left out."""
    unit = np.where(stiffness > 0, stiffness, 1.0)[:, None] ** -0.5
    scaled = unit * columns
    share, vectors = np.linalg.eigh(scaled.T @ scaled)
    keep = share > FAINT * float(share.max(initial=TINY))
    return columns @ (vectors[:, keep] / np.sqrt(share[keep]))


def unreduced(K: Matrix, M: Matrix, band: Any, tol: Any, pencil: Pencil | None, carried: Carried) -> Estimate:
    """The estimate of a model that keeps all of its DOF: nothing is left out."""
    modes = all_modes(K, M, carried=carried)
    omega = modes.frequencies[modes.rigid:]
    omega = omega[in_band(omega, band)]
    values = np.zeros(0, dtype=complex)
    if pencil is not None:
        values = solve(pencil.dense())[0]
        values = values[within(values, band) & (values != 0)]
    return Estimate(band, tol, 0, np.inf, omega, np.full(len(omega), 4 * EPS), values, np.full(len(values), 4 * EPS))
