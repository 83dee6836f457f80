"""Error against run time: reduced models next to the full one, in one run, in alternating order."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femsub.bases import CraigBampton, CraigChang, reduce
from femsub.cea import ComplexModes, complex_modes, inside
from femsub.eigen import check_band
from femsub.errors import FemsubError, InputError, InputTypeError, PortWarning
from femsub.factor import QUADRATIC
from femsub.friction import Belt
from femsub.pencil import Array, whole_number
from femsub.stability import critical_slope
from femsub.substructure import Substructure

Progress = Callable[[str], None]
SHORT_RUNS = 3  # so often a reduced model is solved in each turn


@dataclass(frozen=True)
class Timing:
    """Seconds over repeated runs."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Timing:
        return cls(float(np.median(seconds)), float(np.min(seconds)), float(np.max(seconds)))


@dataclass(frozen=True)
class Row:
    """One model of a study; errors are relative to the full model and over the band.

    Attributes
    ----------
    method, modes, size : str, int, int
        'full' has size n.
    error_eigenvalue : float
        max |λ_reduced - λ_full| / |λ_full| over matched pairs.
    error_growth : float
        max |Re λ_reduced - Re λ_full| / |Re λ_full|, the same pairs.
    error_slope : float
        |c_reduced - c_full| / |c_full| of the critical slope.
    missing : int
        Eigenvalues of the full model in the band whose counterpart is more than half of |λ| away; they have no part in
        the errors.
    slope : float
        The critical slope.
    growth : float
        The largest Re λ in the band.
    reduction, solution : Timing
        Seconds to reduce, and to compute the complex modes in the band.
    port_error : float
        Static error at the port in the energy norm.
    cutoff : float
        Above this frequency the reduced model's modes decide nothing (inf for a complete one and for the full model).
    extra : int
        Eigenvalues in the band and below the cut-off that have no counterpart in the full model.
    """

    method: str
    modes: int
    size: int
    error_eigenvalue: float
    error_growth: float
    error_slope: float
    missing: int
    slope: float
    growth: float
    reduction: Timing
    solution: Timing
    port_error: float
    cutoff: float = np.inf
    extra: int = 0

    def flat(self) -> dict[str, Any]:
        """Plain columns, for CSV and JSON."""
        flat: dict[str, Any] = {}
        for key, value in asdict(self).items():
            if isinstance(value, dict):
                flat |= {f"{key}_{name}_s": number for name, number in value.items()}
            else:
                flat[key] = value
        return flat


@dataclass(frozen=True, repr=False)
class Study:
    """The full model's row and one for each reduced model."""

    name: str
    band: tuple[float, float]
    repeats: int
    full: Row
    rows: tuple[Row, ...]

    def __repr__(self) -> str:
        best = min(self.rows, key=lambda row: row.error_eigenvalue, default=None)
        told = "" if best is None else f"; smallest error {best.error_eigenvalue:.1e} by {best.method} with {best.size} DOF"
        return f"Study of {self.name!r}: {len(self.rows)} reduced models against {self.full.size} DOF{told}"

    def recommended(self, tolerance: float = 1e-3) -> Row | None:
        """The smallest reduced model that may stand in for the full one, or None.

        That is error_growth ≤ tolerance, nothing missing, nothing in the band that the full model has not, and the whole
        band below its cut-off (above it, modes decide nothing). Of these the fewest DOF: they are solved soonest, and
        that does not hang on the noise of the clock. Among equals the shortest reduction.
        """
        if not isinstance(tolerance, (int, float)) or not 0 < tolerance < np.inf:
            raise InputError(f"tolerance must be a positive number, such as 1e-3, not {tolerance!r}")
        fit = [row for row in self.rows if row.error_growth <= tolerance and row.missing == row.extra == 0
               and row.cutoff >= self.band[1]]
        return min(fit, key=lambda row: (row.size, row.reduction.median), default=None)

    def recommendation(self, tolerance: float = 1e-3) -> str:
        """`recommended` in words."""
        row = self.recommended(tolerance)
        where = f"{100 * tolerance:.3g} % of the growth rates from {self.band[0]:.4g} to {self.band[1]:.4g} rad/time"
        if row is None:
            whole = [row for row in self.rows if row.missing == row.extra == 0 and row.error_growth > tolerance]
            near = min(whole, key=lambda row: row.error_growth, default=None)
            nearest = "" if near is None else (f"; {near.method} with {near.modes} modes ({near.size} DOF) comes nearest with "
                                               f"{100 * near.error_growth:.2g} %")
            return f"for {where} none of these models will do{nearest}: keep more modes, or lower the band"
        faster = self.full.solution.median / row.solution.median if row.solution.median > 0 else np.inf
        return (f"for {where} take {row.method} with {row.modes} modes ({row.size} DOF): {_seconds(row.reduction.median)} to "
                f"reduce, {_seconds(row.solution.median)} to solve, {float(f'{faster:.2g}'):g} times faster than the full model")

    def __str__(self) -> str:
        head = f"{'method':<16}{'DOF':>7}{'err λ':>10}{'err Re λ':>10}{'err slope':>10}{'missing':>9}{'reduce':>11}{'solve':>11}"
        lines = [f"{self.name}: band {self.band[0]:g} to {self.band[1]:g} rad/time, medians of {self.repeats}", head]
        for row in (self.full, *self.rows):
            errors = "".join(f"{value:>10.1e}" for value in (row.error_eigenvalue, row.error_growth, row.error_slope))
            lines.append(f"{row.method:<16}{row.size:>7}{errors}{row.missing:>9}"
                         f"{_seconds(row.reduction.median):>11}{_seconds(row.solution.median):>11}")
        return "\n".join(lines)


def study(sub: Substructure, methods: Sequence[CraigBampton | CraigChang], band: tuple[float, float], *,
          belt: Belt | None = None, port: str = "belt", ports: bool = False, repeats: int = 5,
          slopes: Sequence[float] | None = None, progress: Progress | None = None) -> Study:
    """Reduces `sub` by each method and compares complex modes and critical slope with the full model.

    Parameters
    ----------
    sub : Substructure
    methods : sequence of CraigBampton or CraigChang
        One entry per reduced model; list the same method with several numbers of modes to see convergence.
    band : (lo, hi)
        Where the errors count, in radians per unit of time.
    belt : Belt, optional
        The contact under which complex modes are compared; without one the models' own damping.
    port : str
        For the critical slope (the belt's port, if a belt is given).
    ports : bool
        Passed to `reduce`: static port columns join each basis.
    repeats : int
        Each time is a median over so many runs (solutions of reduced models: three times as many); models take turns, so
        that a slow spell hits all of them.
    slopes : sequence of float, optional
        The critical slopes of the full model and of each reduced one, where they are known already.
    progress : callable, optional
        Told in a few words what is being done.

    Returns
    -------
    Study
        The seconds of the full model are those of the eigensolver alone: where the number of its eigenvalues in the band
        is confirmed by a winding number (up to 2,000 DOF), that is done once and not timed.
    """
    if not isinstance(sub, Substructure):
        raise InputTypeError(f"study takes a Substructure, not {type(sub).__name__}")
    if belt is not None and not isinstance(belt, Belt):
        raise InputTypeError(f"belt must be a Belt, not {type(belt).__name__}")
    lo, hi = check_band(band)
    if not isinstance(methods, Sequence):
        raise InputTypeError(f"methods must be a list, e.g. [CraigBampton(modes=4)], not {methods!r}")
    if not methods:
        raise InputError("methods is empty: name at least one, e.g. [CraigBampton(modes=4), CraigChang(modes=4)]")
    if whole_number("repeats", repeats) < 1:
        raise InputError(f"repeats must be at least 1, not {repeats!r}")
    place, force = (belt.port, belt.force) if belt is not None else (port, 1.0)
    if sub.ports:  # without any there is no critical slope, and that is all
        sub.port(place)
    tell = progress or (lambda _: None)
    reducing: list[list[float]] = [[] for _ in methods]
    solving: list[list[float]] = [[] for _ in range(len(methods) + 1)]
    models: list[Any] = [None] * len(methods)
    spectra: list[Any] = [None] * (len(methods) + 1)
    tell(f"{sub.name}: complex modes of the full model")
    if sub.size <= QUADRATIC:
        spectra[0] = complex_modes(sub, belt, band=(lo, hi))
    for turn in range(repeats):
        for i, method in enumerate(methods):
            tell(f"{sub.name}: run {turn + 1} of {repeats}, {type(method).__name__} with {method.modes} modes")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PortWarning)  # the figure is in the row
                models[i], seconds = _timed(reduce, sub, method, ports=ports)
            reducing[i].append(seconds)
        tell(f"{sub.name}: run {turn + 1} of {repeats}, full model")
        found, seconds = _timed(complex_modes, sub, belt, band=(lo, hi), certify=False)
        spectra[0] = found if spectra[0] is None else spectra[0]
        solving[0].append(seconds)
        for i, model in enumerate(models, start=1):  # a reduced model is dense: all of it costs what the band would
            for _ in range(SHORT_RUNS):  # threads of BLAS that wake up, or wait for a core, cost as much as the work
                spectra[i], seconds = _timed(complex_modes, model, belt)
                solving[i].append(seconds)
    if slopes is None:
        tell(f"{sub.name}: critical slopes")
        slopes = [_slope(model, place, force, (lo, hi)) for model in (sub, *models)]
    elif len(slopes) != len(methods) + 1:
        raise InputError(f"slopes must be {len(methods) + 1}, of the full model and of each method, not {len(slopes)}")
    none = Timing(0.0, 0.0, 0.0)
    full = Row("full", 0, sub.size, 0.0, 0.0, 0.0, 0, slopes[0], _growth(spectra[0], hi), none, Timing.of(solving[0]), 0.0)
    rows = []
    for method, model, modes, slope, reduction, solution in zip(
            methods, models, spectra[1:], slopes[1:], reducing, solving[1:], strict=True):
        value, growth, missing = spectrum_errors(spectra[0], modes)
        rows.append(Row(type(method).__name__, method.modes, model.size, value, growth, relative_error(slope, slopes[0]), missing,
                        slope, _growth(modes, hi), Timing.of(reduction), Timing.of(solution), model.port_error.get(place, 0.0),
                        model.cutoff, _extra(spectra[0], modes, (lo, hi))))
    return Study(sub.name, (lo, hi), repeats, full, tuple(rows))


def match(reference: Array, values: Array, penalty: Array | float = 0.0) -> tuple[Array, Array]:
    """The one-to-one assignment of two spectra with the least sum of |Δλ| + penalty: indices into both, never by position."""
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(np.abs(reference[:, None] - values[None, :]) + penalty)


def spectrum_errors(full: ComplexModes, reduced: ComplexModes) -> tuple[float, float, int]:
    """Largest relative error of λ and of Re λ over matched eigenvalues, and how many have no counterpart."""
    reference, values = (modes.eigenvalues[~modes.rigid & (modes.eigenvalues.imag >= 0)] for modes in (full, reduced))
    if len(reference) == 0:
        return 0.0, 0.0, 0
    at, to = match(reference, values)
    error = np.abs(values[to] - reference[at]) / np.abs(reference[at])
    near = error <= 0.5
    missing = len(reference) - int(near.sum())
    if not near.any():
        return np.nan, np.nan, missing
    real = np.abs(reference[at].real)
    growth = np.abs(values[to].real - reference[at].real)
    growth = np.divide(growth, real, out=np.zeros_like(real), where=real > 0)
    return float(error[near].max()), float(growth[near].max()), missing


def _extra(full: ComplexModes, reduced: ComplexModes, band: tuple[float, float]) -> int:
    """Eigenvalues of a reduced model in the band, below its cut-off, that match none of the full model."""
    shown = ~reduced.rigid & (reduced.eigenvalues.imag >= 0)
    reference, values = full.eigenvalues[~full.rigid & (full.eigenvalues.imag >= 0)], reduced.eigenvalues[shown]
    counted = ~reduced.above_cutoff[shown] & inside(values, (-band[1], band[1], *band))
    counted[match(reference, values)[1]] = False
    return int(counted.sum())


def _growth(modes: ComplexModes, hi: float) -> float:
    within = ~modes.rigid & (modes.frequencies <= hi)
    return float(modes.eigenvalues.real[within].max(initial=-np.inf))


def _slope(model: Substructure, port: str, force: float, band: tuple[float, float]) -> float:
    if port not in model.ports or force == 0:
        return np.nan
    try:
        return float(critical_slope(model, port, force=force, band=band))
    except FemsubError:
        return np.nan


def relative_error(value: float, reference: float) -> float:
    """|value - reference| / |reference|; 0 where both are equal, infinite ones too."""
    if value == reference:
        return 0.0
    return float(abs(value - reference) / abs(reference)) if reference else np.nan


def _timed(call: Callable[..., Any], *arguments: Any, **options: Any) -> tuple[Any, float]:
    start = time.perf_counter()
    result = call(*arguments, **options)
    return result, time.perf_counter() - start


def _seconds(value: float) -> str:
    if value == 0:
        return "-"
    return f"{value * 1e3:.3g} ms" if value < 1 else f"{value:.3g} s"
