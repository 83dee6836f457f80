"""Normal modes (K - ω²M)φ = 0 with their certificates: a residual for each, and an independent count.

Elastic modes come from Krylov-Schur on a `ShiftInvert` handle, or from LAPACK if the model is small or most of its
modes are wanted. The inertia of K - ω²M confirms their number (the inertia count). Missing modes are computed afterwards.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from math import isclose
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import (
    BLOCK,
    SMALL,
    Difference,
    columns_left,
    give_back_cores,
    inertia,
    kept_free,
    massless_apart,
    negative_eigenvalues,
    one_thread,
    phase,
    reused_memory,
    search_columns,
    shared,
    times,
    without_signs,
)
from femsub.checks import (
    DENSE,
    EPS,
    EQUAL,
    Array,
    ConditionWarning,
    FemsubError,
    InputError,
    InputTypeError,
    Matrix,
    MissedModesError,
    NotConvergedError,
    SingularMatrixError,
    Tally,
    shown,
    warn,
    whole_number,
)
from femsub.model import DOUBLE, MOTIONS, TRANSLATIONS, Substructure, in_band, usable_band, widened
from femsub.modes.charts import frequencies_chart
from femsub.modes.dense import dense_modes, orthonormalise, refined, scaled_errors
from femsub.modes.shaped import Shaped
from femsub.modes.shift_invert import IN_PARTS, ShiftInvert
from femsub.output import Chart, Table

if TYPE_CHECKING:
    from femsub.algebra import CountBeside
    from femsub.model import Carried

log = logging.getLogger(__name__)

ACCEPTED = 1e-10  # the largest relative residual of a mode that is returned
GOOD = 64 * EPS  # scaled residual above which a mode is refined, if any mode is poor
HEAVY = 100  # nonzeros of the factor per row from which block solves are faster
BEYOND = (0.0, 3e-6, 1e-5, 3e-5)  # relative shifts of a limit, tried in turn until no mode lies at the limit


@dataclass(frozen=True, eq=False, repr=False)
class NormalModes(Shaped):
    """Undamped modes of a model, made by `normal_modes`: KΦ = MΦΩ², ΦᵀMΦ = I.

    Rigid-body modes come first, then elastic modes by frequency.

    Attributes
    ----------
    eigenvalues : ndarray, shape (k,)
        ω², exactly 0 for rigid-body modes.
    shapes : ndarray, shape (n, k)
    rigid : int
        The number of rigid-body modes.
    residual : ndarray, shape (k,)
        ‖Kφ - ω²Mφ‖ / ‖(|K| + ω²|M|)|φ|‖, dimensionless; 0 for rigid motion that the model carries from its full parts.
    counted : tuple (limit, count)
        The inertia count: `count` modes lie below the frequency `limit`, rigid-body modes included, and all were found. The limit
        lies above the modes listed. If the list ends inside a cluster, the limit lies just below the cluster.
    unlisted : int
        Modes that were found but not listed, since they lie outside the requested band.
    tally : Tally
        The number of modes found below the limit, and their number by the inertia count, if that has been made; see
        `count_deferred`.
    factorisations : int
        Factorisations made for the modes, without the one for the count; 0 if an earlier call had made the factor.
    rounding : ndarray, shape (k,)
        u |φ|ᵀ(|K| + ω²|M|)|φ| / ω²: the relative change of ω² if each entry of K and M changes by one rounding (0 for rigid-body
        modes). u is eps, or more if K was written with fewer digits (`rounding_of`). Modes of little energy are corrected with K
        Z = 0 if the rigid motion Z is known exactly, from parts of a system or as translations. For these modes it is the error
        after the correction.
    directions : tuple of str, length d
        Directions of rigid accelerations that move mass: 'ux', 'uy', 'uz', and 'rx', 'ry', 'rz' about the origin. Empty if the
        rigid motion of the model is not known by directions.
    coupling : ndarray, shape (k, d)
        L = ΦᵀP with the forces P of these accelerations; L² are the effective masses. See `effective_masses` for their sums.
    mass : ndarray, shape (d,)
        The whole mass, or moment of inertia, in each direction.

    Examples
    --------
    >>> import femsub as fs
    >>> modes = fs.normal_modes(fs.chain(10), count=2)
    >>> modes.rigid, modes.shapes.shape, modes.evidence
    (0, (10, 2), 'certified')
    """

    eigenvalues: Array
    shapes: Array
    rigid: int
    residual: Array
    counted: tuple[float, int]
    factorisations: int = 1
    tally: Tally = field(default=Tally(0))
    rounding: Array = field(default_factory=lambda: np.zeros(0))
    unlisted: int = 0
    directions: tuple[str, ...] = ()
    coupling: Array = field(default_factory=lambda: np.zeros((0, 0)))
    mass: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def mass_shares(self) -> Array:
        """The effective masses relative to the whole mass, L² / m for each mode and direction, (k, d)."""
        return self.coupling**2 / self.mass

    @property
    def evidence(self) -> str:
        """'certified' if the inertia count proves that no mode is missing; see `femsub.checks`."""
        return self.tally.evidence

    @property
    def frequencies(self) -> Array:
        """ω in radians per unit of time, shape (k,)."""
        return np.sqrt(self.eigenvalues)

    @property
    def elastic(self) -> Array:
        """The frequencies of the elastic modes, without rigid motion."""
        return self.frequencies[self.rigid:]

    @property
    def frequencies_hz(self) -> Array:
        """ω / 2π, shape (k,); Hz where the unit of time is the second."""
        return self.frequencies / (2 * np.pi)

    @property
    def count_words(self) -> str:
        """How the number of modes is known, in words."""
        limit, count = self.counted
        words = f"the inertia of K - ω²M counts {count} below {limit:.6g}" if np.isfinite(limit) else "all were computed"
        return words + f", {self.unlisted} of them outside the band" * bool(self.unlisted)

    def rows(self) -> list[dict[str, Any]]:
        """A row for each mode."""
        return [{"mode": i, "omega": float(omega), "rigid": i <= self.rigid, "residual": float(residual)}
                for i, (omega, residual) in enumerate(zip(self.frequencies, self.residual, strict=True), 1)]

    def elastic_band(self, count: int, beside: float = 0.02) -> tuple[float, float]:
        """The band from 0 to a share `beside` above the first `count` elastic modes; closely following modes are included."""
        omega = self.elastic
        last = min(count, len(omega)) - 1
        while last + 1 < len(omega) and omega[last + 1] < (1 + 2 * beside) * omega[last]:
            last += 1
        return 0.0, float((1 + beside) * omega[last])

    def tables(self) -> list[Table]:
        """A row for each mode."""
        rows = self.rows()
        return [Table("modes", rows, ["mode", "omega", "residual"], "Normal modes")] if rows else []

    def chart(self, title: str = "Normal modes") -> Chart:
        """The chart of the frequencies over the mode number."""
        return frequencies_chart(self, title)

    def drawn_first(self) -> list[int]:
        """Indices of the elastic modes."""
        return list(range(self.rigid, len(self.eigenvalues)))

    def title_of(self, i: int) -> str:
        """The title of a picture of shape i: mode number and frequency."""
        return f"mode {i + 1}: ω = {self.frequencies[i]:.5g} rad/time"

    def __repr__(self) -> str:
        elastic = self.elastic
        span = f", ω {elastic[0]:.5g} to {elastic[-1]:.5g} rad/time" if len(elastic) else ""
        worst = f"{self.residual.max():.0e}" if len(self.residual) else "none"
        beside = f", {self.unlisted} of them outside the band" if self.unlisted else ""
        return (f"NormalModes: {self.rigid} rigid and {len(elastic)} elastic{span}; largest residual {worst}; "
                f"{self.counted[1]} counted below {self.counted[0]:.5g}{beside}{moved(self.directions, self.mass_shares)}")


def moved(directions: Sequence[str], shares: Array) -> str:
    """The effective masses (k, d) in directions of translation, in words to end a sentence; '' if there are none."""
    sums = [f"{share:.1%} of {name}".replace("%", " %") for name, share in zip(directions, shares.sum(axis=0), strict=True)
            if name in TRANSLATIONS]
    return f"; they move {', '.join(sums)}" if sums else ""


def lowest_modes(handle: ShiftInvert, count: int, defer: bool = False, known: NormalModes | None = None,
                 evidence: bool = True, fewer: bool = False) -> NormalModes:
    """The rigid-body modes and the `count` lowest elastic modes, certified by an inertia count.

    With `defer`, the inertia count of a large model is left to `count_deferred`: it needs a second factorisation, and the first
    one may have to be freed before. `known` modes are deflated instead of computed again. Without `evidence` there is no count.
    With `fewer`, a `count` above the number of modes returns all of them, unless they are too many in a large model.
    """
    n, rigid = handle.K.shape[0], handle.rigid.shape[1]
    whole = fewer and count >= handle.elastic and (n <= DENSE or handle.elastic <= 0.3 * n)
    count = handle.elastic if whole else count
    if not 0 <= count <= handle.elastic:
        raise InputError(f"{count} elastic modes were asked for, but there are {handle.elastic}"
                         + (f" (and {rigid} rigid-body modes)" if rigid else ""))
    if n <= SMALL or not sp.issparse(handle.K) or (count > 0.3 * n and n <= DENSE):
        return _dense(handle, None if whole else count)
    with reused_memory(n):
        return _sparse(handle, count, defer, known, evidence)


def all_modes(K: Matrix, M: Matrix, accepted: float = ACCEPTED, carried: Carried = None) -> NormalModes:
    """All modes, by LAPACK. A DOF without mass adds no mode. `accepted` is the largest relative residual of a mode."""
    return _dense(ShiftInvert(K, M, carried=carried), None, accepted)


def _dense(handle: ShiftInvert, count: int | None, accepted: float = ACCEPTED) -> NormalModes:
    """All modes by LAPACK. Massless DOF are condensed.

    K + MΦ(λ₁/4 - Ω²)ΦᵀM shifts the rigid-body modes, and elastic modes of which K holds no digits, to ω² = λ₁/4. λ₁ is the lowest
    ω² of the other modes, which do not change.
    """
    import scipy.linalg as la

    K, M = (part.toarray() if sp.issparse(part) else part for part in (handle.K, handle.M))
    rigid = handle.rigid.shape[1]
    own, soft = np.zeros(0), handle.rigid[:, :0]
    if rigid:
        own, soft, lowest = handle.soft()
        held = M @ np.hstack([handle.rigid, soft])
        lift = 0.25 * (lowest if np.isfinite(lowest) else float(np.trace(K) / np.trace(M)))
        K = K + (held * (lift - np.append(np.zeros(rigid), own))) @ held.T
    lifted = rigid + len(own)
    turn = None
    if handle.finite < np.count_nonzero(M.diagonal()):  # M is singular, but not because of single massless DOF
        turn, M = massless_apart(M, handle.finite, K.diagonal())
        K = turn.T @ K @ turn
    massive, bare = np.flatnonzero(M.diagonal()), np.flatnonzero(M.diagonal() == 0)
    bound = np.zeros((0, len(massive)))
    if len(bare):
        try:
            bound = -la.solve(K[np.ix_(bare, bare)], K[np.ix_(bare, massive)], assume_a="pos", check_finite=False)
        except la.LinAlgError:
            raise SingularMatrixError(f"{len(bare)} coordinates have no mass, and some motion of them has no stiffness either. "
                                      "Hold them, or, of MacNeal's parts, keep fewer modes or take Rubin") from None
        K, M = K[np.ix_(massive, massive)] + K[np.ix_(massive, bare)] @ bound, M[np.ix_(massive, massive)]
    K = (K + K.T) / 2
    values, moving = dense_modes(K, M) if len(massive) else (np.zeros(0), np.zeros((0, 0)))
    count = len(values) - rigid if count is None else count
    if len(values) < rigid + count:  # fewer finite eigenvalues than the rank of M
        raise InputError(f"{count} elastic modes were asked for, but only {len(values) - rigid} have a clearly finite frequency")
    tally = Tally(0, 0)
    if len(values):
        # with all modes the limit lies far above them: if M is nearly singular, the highest mode loses digits first
        least = min(lifted + count, len(values))
        edge, below = _limit(values, least) if least < len(values) else (2 * float(values[-1]), len(values))
        counted = negative_eigenvalues(K - edge * M)
        _check_count(counted, below, edge)
        tally = Tally(below, counted)
    keep = slice(lifted, lifted + count)
    shapes = np.zeros((handle.K.shape[0], len(values[keep])))
    shapes[massive], shapes[bare] = moving[:, keep], bound @ moving[:, keep]
    shapes = shapes if turn is None else turn @ shapes
    values, shapes = np.append(own, values[keep]), np.hstack([soft, shapes])
    order = np.argsort(values, kind="stable")[:count]  # K may hold digits of a mode below others of which it holds none
    shapes = handle.deflate(shapes[:, order])
    shapes /= np.sqrt(np.einsum("ij,ij->j", shapes, handle.M @ shapes))
    return _result(handle, values[order], shapes, (np.inf, moving.shape[1]), tally, accepted)


def _sparse(handle: ShiftInvert, count: int, defer: bool, known: NormalModes | None, evidence: bool) -> NormalModes:
    from femsub.algebra import SparseFactor, symmetric_modes
    from femsub.modes.block_lanczos import block_lanczos

    assert isinstance(handle.factor, SparseFactor)
    rigid, finite = handle.rigid.shape[1], handle.finite
    values, shapes = np.zeros(0), np.zeros((handle.K.shape[0], 0))
    if known is not None:
        values, shapes = known.eigenvalues[rigid:], known.shapes[:, rigid:]
    # two more than requested show where a cluster ends
    tol = ACCEPTED / 100  # of Krylov-Schur, relative to the eigenvalue of the shift-inverted problem
    ask = min(count + 2 if evidence and known is None else count, finite - rigid) - len(values)
    nonzeros = handle.factor.fill * handle.factor.size
    heavy = handle.factor.fill > HEAVY and finite > 20 * max(count, 1)
    converged = len(values) + max(ask, 0)
    if ask > 0:
        beside = np.hstack([handle.rigid, shapes])
        if heavy:
            counts = evidence and known is None
            converged = min(count, ask) if counts else converged
            with ExitStack() as stack:
                # block Lanczos ends with a step of inverse iteration, which brings residuals to 1e-13 to 1e-11
                more = block_lanczos(handle.factor, handle.M, handle.sigma, ask, tol=10 * ACCEPTED, known=beside,
                                     seen=_counted_beside(handle, nonzeros, count, stack) if counts else None)
        else:
            more = symmetric_modes(handle.factor, handle.K, handle.M, handle.sigma, ask, tol=tol, known=beside)
        values, shapes = np.append(values, more[0]), np.hstack([shapes, more[1]]) if len(values) else more[1]
    if len(values) == 0:
        return _result(handle, values, shapes, (0.0, 0), Tally(0, 0))
    if not evidence:
        order = np.argsort(values, kind="stable")[:count]
        return _result(handle, values[order], shapes[:, order], (0.0, 0), Tally(0))
    for attempt in range(4):
        if (np.diff(values) < 0).any():  # a copy of many shapes takes a while
            order = np.argsort(values, kind="stable")
            values, shapes = values[order], shapes[:, order]
        made = [handle.beside.value] if handle.beside is not None and handle.beside.value is not None else []
        made += [reach for reach, *_ in _counted(handle.K, handle.M)]
        limit, below = _limit(values, min(count, len(values)), made)
        uncounted = (float(np.sqrt(limit)), below + rigid), Tally(below + rigid)
        if heavy and defer:
            return _result(handle, values[:count], shapes[:, :count], *uncounted)
        checked = None
        if handle.is_counting:  # another process counts: residuals are computed meanwhile
            with handle.sharing:
                checked = _result(handle, values[:count], shapes[:, :count], *uncounted)
        counted = _count(handle, limit, handle.make_room if heavy else None)
        missed = counted - below - rigid
        if missed == 0:
            found = checked or _result(handle, values[:count], shapes[:, :count], *uncounted)
            found = _with_tally(found, Tally(below + rigid, counted))
            _remember(handle.K, handle.M, limit, found)
            return found
        if missed < 0 or attempt == 3:
            break
        if converged < len(values):
            missed += below - min(below, converged)
            values, shapes = values[:converged], shapes[:, :converged]
        if missed > 0.3 * finite:  # a large cluster: Krylov-Schur would need too many vectors, LAPACK does not
            if handle.K.shape[0] > DENSE:
                break
            return _dense(handle, count)
        extra = symmetric_modes(handle.factor, handle.K, handle.M, handle.sigma, missed, tol=tol, seed=17 + attempt,
                                known=np.hstack([handle.rigid, shapes]))
        values, shapes = np.append(values, extra[0]), np.hstack([shapes, extra[1]])
        converged = len(values)
    raise _missed(counted, below + rigid, limit)


@phase("certificate")
def count_deferred(handle: ShiftInvert, modes: NormalModes) -> NormalModes:
    """Make the inertia count that `lowest_modes` deferred; the handle may have been released.

    Raises
    ------
    MissedModesError
        The inertia of K - ω²M gives another number of modes.
    """
    if modes.tally.counted is not None:
        return modes
    limit, expected = modes.counted
    counted = _count(handle, limit**2)
    _check_count(counted, expected, limit**2)
    _remember(handle.K, handle.M, limit**2, modes)
    return _with_tally(modes, Tally(expected, counted))


def _with_tally(modes: NormalModes, tally: Tally) -> NormalModes:
    """The modes with this tally; without the count, if within rounding one of the modes may be rigid motion."""
    return replace(modes, tally=tally if modes.rounding.max(initial=0.0) <= 1 else replace(tally, counted=None))


def counted_early(K: Matrix, M: Matrix, limit: float) -> CountBeside | None:
    """A process that counts the modes with ω < limit while this process factorises K; None if it may not pay."""
    from femsub.algebra import BLOCKS, CountBeside

    beside = None if _is_counted(K, M, limit) else CountBeside.early(K, M, BLOCKS)
    if beside is not None:
        beside.ask(limit**2)
    return beside


@contextmanager
def counted_beside(handle: ShiftInvert, limit: float) -> Iterator[None]:
    """A context in which another process counts the modes with ω < limit, for `modes_below` with the same handle and limit.

    This process keeps one core. If there is no memory for another process, or the count is known, nothing is counted.
    """
    from femsub.algebra import BLOCKS, CountBeside, SparseFactor

    if handle.beside is None and isinstance(handle.factor, SparseFactor) and not _is_counted(handle.K, handle.M, limit):
        handle.beside = CountBeside.started(handle.K, handle.M, handle.factor.fill * handle.factor.size, BLOCKS)
        if handle.beside is not None:
            handle.beside.ask(limit**2)
    with handle.sharing:
        yield


def _counted_beside(handle: ShiftInvert, nonzeros: float, count: int,
                    stack: ExitStack) -> Callable[[Array, Array], int]:
    """A function of approximate ω² (k,) and their relative errors that starts the count once the ω² show its limit.

    It returns how many ω² have to converge: those above the wanted modes only show the limit. Meanwhile this process keeps one
    core; the stack gives the other back.
    """
    from femsub.algebra import CountBeside

    if handle.beside is None:
        handle.beside = CountBeside.started(handle.K, handle.M, nonzeros, search_columns(count) + columns_left())
    beside = handle.beside

    def seen(values: Array, error: Array) -> int:
        give_back_cores()
        limit = _limit(values, count)[0]
        # The residual bounds the error of ω². So does its square over the distance to the next modes, about `apart`.
        apart = max(values[-1] / values[count - 1] - 1, EPS) if count else EPS
        far = 3 * error * values  # bounds the distance to some mode, the intended one or a neighbour
        near = far * np.minimum(1.0, error / apart)
        clear = bool((np.abs(values - limit) > far).all())
        if beside is not None and beside.value is None and (np.abs(values - limit) > near).all():
            beside.ask(limit)
            stack.enter_context(one_thread(True))
        elif beside is not None and not beside.busy:
            stack.close()
        # modes that are not listed only show where a limit may lie: their error, the square, must be far smaller than a gap
        return count if clear and error.max() ** 2 < DOUBLE / 100 else len(values)

    return seen


def _count(handle: ShiftInvert, limit: float, make_room: Callable[[], None] | None = None) -> int:
    """The number of ω² below the limit, from the counting process if that counts up to this limit, else by `modes_under`."""
    beside, handle.beside = handle.beside, None
    counted = beside.answer() if beside is not None and isclose(limit, beside.value or 0.0, rel_tol=4 * EPS) else None
    return modes_under(handle.K, handle.M, limit, make_room) if counted is None else counted


def _check_count(counted: int, found: int, limit: float) -> None:
    if counted != found:
        raise _missed(counted, found, limit)


def _missed(counted: int, found: int, limit: float) -> MissedModesError:
    return MissedModesError(f"{found} modes were found below ω = {np.sqrt(limit):.6g}, but the inertia of K - ω²M counts "
                            f"{counted}. There may be a cluster of frequencies. Ask for a few modes more or fewer")


def _result(handle: ShiftInvert, values: Array, shapes: Array, counted: tuple[float, int], tally: Tally,
            accepted: float = ACCEPTED) -> NormalModes:
    values = np.concatenate([np.zeros(handle.rigid.shape[1]), values])
    shapes = np.hstack([handle.rigid, shapes])
    orthonormalise(shapes, handle.M)
    residual, rounding = _certificates(handle.K, handle.M, values, shapes, handle.unit, handle.rigid)
    blurred, own = np.zeros(0, dtype=int), np.full(len(values), np.inf)
    if handle.floating:
        values, shapes, blurred, *known = handle.cleared(values, shapes, rounding)
        rounding[blurred], residual[blurred] = known
    if len(shapes) <= DENSE:
        scaled, doubt = scaled_errors(handle.K, handle.M, values, shapes)
        poor = (residual > accepted) | (doubt > np.maximum(EPS**0.5, 100 * rounding))  # far above the effect of rounding in K
        elastic = values > 0
        elastic[blurred] = False
        if poor[elastic].any():
            which = np.flatnonzero((poor | (scaled > GOOD)) & elastic)
            values, shapes = refined(handle.K, handle.M, values, shapes, which, DOUBLE)
            residual, rounding = _certificates(handle.K, handle.M, values, shapes, handle.unit, handle.rigid)
            if len(blurred):
                rounding[blurred], residual[blurred] = known
            scaled, doubt = scaled_errors(handle.K, handle.M, values, shapes)
            own[elastic] = np.maximum(scaled, doubt**2)[elastic]  # ω² is a Rayleigh quotient, whose error is of second order
    if (values[handle.rigid.shape[1]:] <= 0).any():
        raise SingularMatrixError(f"rounding in the entries of K hides an elastic mode: its ω² comes out as {values.min():.3g}. "
                                  f"{IN_PARTS}")
    residual[:handle.surely_rigid] = 0.0  # K may have nothing but rounding in these coordinates
    # forces and modal coordinates have no common unit: a mode is also good if it is good with each DOF in its own unit
    beyond = np.minimum(residual, own)
    beyond /= np.where(values > 0, accepted, max(accepted, handle.unit))  # rigid motion: within K's own rounding
    beyond[blurred] = 0.0  # in such a mode the forces that remain are rounding of those that cancel; the error of its ω² is known
    if not beyond.max(initial=0.0) <= 1:
        at = int(beyond.argmax())
        raise NotConvergedError(f"mode {at + 1} has a relative residual of {residual[at]:.1e}, but "
                                f"at most {accepted:g} is accepted. Check the scaling of K and M")
    if rounding.max(initial=0.0) > 0.1:  # ω, its root, keeps one digit
        worst = float(rounding.max())
        warn(f"rounding in the entries of K may change ω² of mode {int(rounding.argmax()) + 1} by a relative {worst:.0e}: its "
             f"energy is {handle.unit / worst:.0e} of the terms that cancel in it. "
             + ("Make softly connected pieces the parts of a system (couple, Spring), use larger elements, or stiffer "
                "supports" if handle.unit == EPS
                else f"The entries are known to about {handle.unit:.0e} of each: write K with all digits (17)"),
             ConditionWarning)
    found = NormalModes(values, shapes, handle.rigid.shape[1], residual, counted, handle.factorisations, tally, rounding)
    return _with_tally(found, tally)


def normal_modes(model: Substructure, count: int | None = None, band: tuple[float, float] | None = None) -> NormalModes:
    """The lowest undamped modes of a full or reduced substructure, without contact: (K - ω²M)φ = 0.

    Parameters
    ----------
    model : Substructure
    count : int, optional
        Number of elastic modes; the rigid-body modes of a floating part are added. If the model has fewer elastic modes, all of
        them are returned, and a warning gives their number.
    band : (lo, hi), optional
        Instead of `count`: all modes with lo ≤ ω ≤ hi in radians per unit of time, rigid-body modes included if lo = 0.
        The edges belong to the band, with a tolerance of 1e-9 ω for rounding (`bands.in_band`).

    Returns
    -------
    NormalModes
        ω, Φ, the residual of each mode, the inertia count, and the coupling to rigid accelerations.

    Warns
    -----
    FemsubWarning
        The model has fewer elastic modes than `count`; rounding in K blurs a mode.

    Raises
    ------
    InputError
        Neither or both of `count` and `band`; more modes than a large model has; a band that reaches above the cut-off of a
        reduced model.
    SingularMatrixError
        K is not positive semidefinite.
    NotConvergedError, MissedModesError
        The solver has not converged, or the inertia of K - ω²M shows that modes are missing.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.normal_modes(fs.chain(10), count=2).frequencies.round(6)
    array([0.14946 , 0.445042])
    """
    if not hasattr(model, "K") or not hasattr(model, "M"):
        raise InputTypeError(f"normal_modes takes a Substructure, not {shown(model)}")
    if (count is None) == (band is None):
        raise InputError("give either count, the number of elastic modes, or band=(lo, hi) in rad per unit of time")
    if isinstance(model, Substructure):
        model.refuse_empty()
    if count is not None:
        with kept_free(8.0 * model.K.shape[0] * search_columns(whole_number("count", count))):
            modes = lowest_modes(ShiftInvert(model.K, model.M, carried=model.rigid_motion, seeks=count), count, fewer=True)
        if (found := len(modes.eigenvalues) - modes.rigid) < count:
            name = getattr(model, "name", "the model")
            warn(f"count={count} elastic modes of {name!r} were asked for, but it has {found} of finite frequency"
                 + (f" beside {modes.rigid} rigid-body modes" if modes.rigid else "") + ". All of them are returned")
    else:
        lo, hi = usable_band(model, band)
        modes = modes_below(model.K, model.M, widened(hi), ShiftInvert(model.K, model.M, carried=model.rigid_motion))
        inside = in_band(modes.frequencies, (lo, hi))
        modes = replace(modes, eigenvalues=modes.eigenvalues[inside], shapes=modes.shapes[:, inside],
                        rigid=int(inside[:modes.rigid].sum()), residual=modes.residual[inside], rounding=modes.rounding[inside],
                        unlisted=int(np.count_nonzero(~inside)))
    # the coupling to rigid accelerations, if the model knows its rigid motion
    if isinstance(model, Substructure) and (rigid := model.rigid_inertia()) is not None:
        some = rigid.acting
        modes = replace(modes, directions=tuple(MOTIONS[at] for at in some), coupling=modes.shapes.T @ rigid.forces[:, some],
                        mass=rigid.mass.diagonal()[some])
    log.info("%r", modes)
    return modes


def modes_below(K: Matrix, M: Matrix, limit: float, handle: ShiftInvert | None = None, most: float = np.inf,
                known: NormalModes | None = None) -> NormalModes:
    """All modes with ω < limit. The inertia of K - limit² M gives their number before the search, and proves completeness.

    If a mode lies at the limit within rounding, the limit is raised slightly. More than `most` modes raise a NotConvergedError.
    `known` are lowest modes that the factor of the same handle has found before.
    """
    handle = handle or ShiftInvert(K, M)
    for beyond in BEYOND:
        reach = limit * (1 + beyond)
        try:
            below = _count(handle, reach**2, handle.make_room)
        except SingularMatrixError as error:
            last: FemsubError = error
            continue
        give_back_cores()
        if below > most:
            raise NotConvergedError(f"{below} undamped modes lie below ω = {reach:.6g}, and the limit is {most:.0f}")
        count = below - handle.rigid.shape[1]
        if count > handle.elastic:
            last = MissedModesError(f"{below} modes were counted below ω = {reach:.9g}, but the model has only "
                                    f"{handle.elastic + handle.rigid.shape[1]}. K or M is indefinite, or has few correct digits")
            continue
        modes = lowest_modes(handle, max(0, count), known=known, evidence=False)
        if count > 0 and modes.frequencies[-1] > reach:  # a mode was missed, or lies on the edge: a second count decides
            modes = lowest_modes(handle, count, known=modes)
        highest = float(modes.frequencies.max(initial=0.0))
        if count >= 0 and highest < reach * (1 - EQUAL):
            modes = replace(modes, counted=(reach, below), tally=Tally(len(modes.eigenvalues), below))
            _remember(K, M, reach**2, modes)
            return modes
        last = MissedModesError(f"{below} modes were counted below ω = {reach:.9g}, but the last of those found is at "
                                f"{highest:.9g}. Move the end of the band a little")
    raise last


@phase("certificate")
def modes_under(K: Matrix, M: Matrix, value: float, make_room: Callable[[], None] | None = None) -> int:
    """The number of ω² below `value`: the inertia of K - value M, by a separate factorisation; `make_room` is called before it.

    No factorisation is needed if all modes up to a higher limit are known and counted, and none of them lies at `value`.
    """
    def counted() -> int:
        if make_room is not None:
            make_room()
        return inertia(Difference(K, M, value))

    for reach, values, doubt in _counted(K, M):
        if value <= reach and (np.abs(values - value) > doubt).all():
            return int(np.count_nonzero(values < value))
    return shared((K, M), ("count below", value), counted)


def _counted(K: Matrix, M: Matrix) -> list[tuple[float, Array, Array]]:
    """The highest ω² up to which all modes are counted and found; their ω²; the distance that a new limit must keep from each."""
    return shared((K, M), "modes counted", list)


def _is_counted(K: Matrix, M: Matrix, limit: float) -> bool:
    """Whether all modes with ω < limit are counted and found."""
    return any(limit**2 <= reach for reach, *_ in _counted(K, M))


def _remember(K: Matrix, M: Matrix, limit: float, modes: NormalModes) -> None:
    """Remember that these are all modes with ω² below the limit, so that no lower limit needs another inertia count."""
    known = _counted(K, M)
    if np.count_nonzero(modes.eigenvalues < limit) == len(modes.eigenvalues) == modes.counted[1] and (
            not known or limit > known[0][0]):
        known[:] = [(limit, modes.eigenvalues, (DOUBLE + modes.rounding) * modes.eigenvalues)]


def relative_residual(K: Matrix, M: Matrix, values: Array, shapes: Array) -> Array:
    """‖Kφ - λMφ‖ / ‖(|K| + |λ||M|)|φ|‖ column by column, shape (k,)."""
    return _certificates(K, M, values, shapes)[0]


def _certificates(K: Matrix, M: Matrix, values: Array, shapes: Array, unit: float = EPS,
                  rigid: Array | None = None) -> tuple[Array, Array]:
    """The relative residuals and `NormalModes.rounding`, (k,) each; some modes at a time, since each takes four columns.

    Rounding lets K resist the `rigid` motion a little. Elastic modes belong to a K without this resistance, so inertia forces of
    rigid motion are removed from their residuals.
    """
    residual, scale, weight = np.zeros((3, shapes.shape[1]))
    held = None if rigid is None or not rigid.shape[1] else (times(M, rigid), rigid.T)
    sizes = tuple(without_signs(A) for A in (K, M))

    def lengths(A: Array) -> Array:
        return np.sqrt(np.einsum("ij,ij->j", A, A))

    at_once = BLOCK // 4  # each takes four columns, and fresh memory takes longer than the products
    for start in range(0, shapes.shape[1], at_once):
        part = slice(start, start + at_once)
        x, value = np.array(shapes[:, part], order="C"), values[part]  # the order that sparse products need
        inertial = times(M, x)
        inertial *= value
        wrong = times(K, x)
        wrong -= inertial
        if held is not None and value.any():
            wrong[:, value > 0] -= held[0] @ (held[1] @ wrong[:, value > 0])
        residual[part] = lengths(wrong)
        del wrong, inertial  # frees memory for the next arrays
        size = np.abs(x, out=x)
        doubt, inertial = times(sizes[0], size), times(sizes[1], size)
        inertial *= np.abs(value)
        doubt += inertial
        scale[part], weight[part] = lengths(doubt), unit * np.einsum("ij,ij->j", size, doubt)
        del x, size, doubt, inertial
    return (np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0),
            np.divide(weight, values, out=np.zeros_like(weight), where=values > 0))


def _limit(values: Array, count: int, made: Sequence[float] = ()) -> tuple[float, int]:
    """The limit for the inertia count, and the number of the values (ascending) below it.

    The limit lies in the widest gap above the `count` wanted values. Neighbours within DOUBLE are a cluster, inside which no
    inertia is counted. If the wanted values end inside a cluster, the limit lies just below the cluster. Then no lower mode is
    missing, and any member of the cluster may be listed. If the limit of a count `made` already, or under way, lies in such a
    gap, it is taken: modes that are computed again differ by rounding, and a new limit would differ as well.
    """
    for limit in made:
        within = int(np.count_nonzero(values < limit))
        if count <= within < len(values) and (np.abs(values - limit) > DOUBLE / 4 * values).all():
            return limit, within
    if len(values) > count:
        tail = values[count - 1:] if count else np.append(0.0, values)
        gaps = np.diff(tail) / tail[1:]
        at = int(np.argmax(gaps))
        if gaps[at] > DOUBLE:
            return float((tail[at] + tail[at + 1]) / 2), at + count
    below = np.flatnonzero(np.diff(values[:count]) > DOUBLE * values[1:count])
    first = int(below[-1]) + 1 if len(below) else 0
    return float(values[first] * (1 - DOUBLE / 2)), first
