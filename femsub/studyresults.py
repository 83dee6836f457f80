"""What a study has found: a row for each model, what may be recommended, and the table in which it is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from femsub.errors import InputError

PHASES = ("factorisation", "basis", "certificate", "projection")  # of a reduction


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
    error_frequency : float
        max |Δω| / ω over the undamped frequencies in the band.
    mac : float
        The smallest MAC of the matched complex modes (of subspaces, where they cluster).
    phases : mapping of str to Timing
        What `reduction` consists of: factorisation; basis (modes and static shapes); certificate (the second factorisation
        that counts the modes of a large model); projection.
    memory : float
        MB that the model's matrices take (M, D, K and V).
    pareto : bool
        No other reduced model is both as quick (reduction and solution) and as right (error_growth).
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
    error_frequency: float = 0.0
    mac: float = 1.0
    phases: Mapping[str, Timing] = field(default_factory=dict)
    memory: float = 0.0
    pareto: bool = False

    @property
    def seconds(self) -> float:
        """Reduction and solution together, medians."""
        return self.reduction.median + self.solution.median

    @property
    def sound(self) -> bool:
        """Nothing missing and nothing extra in the band."""
        return self.missing == self.extra == 0

    def flat(self) -> dict[str, Any]:
        """Plain columns, for CSV and JSON."""
        flat: dict[str, Any] = {}
        for key, value in asdict(self).items():
            if key == "phases":
                flat |= {f"{name}_s": timing["median"] for name, timing in value.items()}
            elif isinstance(value, dict):
                flat |= {f"{key}_{name}_s": number for name, number in value.items()}
            else:
                flat[key] = value
        return flat


@dataclass(frozen=True, repr=False)
class Study:
    """The full model's row and one for each reduced model; `assembly` is the seconds to build it, where they are known."""

    name: str
    band: tuple[float, float]
    repeats: int
    full: Row
    rows: tuple[Row, ...]
    assembly: float = np.nan

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
        fit = [row for row in self.rows if row.error_growth <= tolerance and row.sound and row.cutoff >= self.band[1]]
        return min(fit, key=lambda row: (row.size, row.reduction.median), default=None)

    def recommendation(self, tolerance: float = 1e-3) -> str:
        """`recommended` in words."""
        row = self.recommended(tolerance)
        where = f"{100 * tolerance:.3g} % of the growth rates from {self.band[0]:.4g} to {self.band[1]:.4g} rad/time"
        if row is None:
            whole = [row for row in self.rows if row.sound and row.error_growth > tolerance]
            near = min(whole, key=lambda row: row.error_growth, default=None)
            nearest = "" if near is None else (f"; {near.method} with {near.modes} modes ({near.size} DOF) comes nearest with "
                                               f"{100 * near.error_growth:.2g} %")
            return f"for {where} none of these models will do{nearest}: keep more modes, or lower the band"
        faster = self.full.solution.median / row.solution.median if row.solution.median > 0 else np.inf
        return (f"for {where} take {row.method} with {row.modes} modes ({row.size} DOF): {_seconds(row.reduction.median)} to "
                f"reduce, {_seconds(row.solution.median)} to solve, {float(f'{faster:.2g}'):g} times faster than the full model")

    def __str__(self) -> str:
        head = (f"  {'method':<14}{'DOF':>7}{'err ω':>9}{'err λ':>9}{'err Re λ':>10}{'err slope':>10}{'1 - MAC':>9}{'missing':>9}"
                f"{'reduce':>11}{'solve':>11}{'MB':>10}")
        built = "" if np.isnan(self.assembly) else f", assembled in {_seconds(self.assembly)}"
        lines = [f"{self.name}: band {self.band[0]:g} to {self.band[1]:g} rad/time, medians of {self.repeats}{built}", head]
        for row in (self.full, *self.rows):
            errors = "".join(f"{value:>{width}.1e}" for value, width in (
                (row.error_frequency, 9), (row.error_eigenvalue, 9), (row.error_growth, 10), (row.error_slope, 10),
                (1 - row.mac, 9)))
            lines.append(f"{'* ' if row.pareto else '  '}{row.method:<14}{row.size:>7}{errors}{row.missing:>9}"
                         f"{_seconds(row.reduction.median):>11}{_seconds(row.solution.median):>11}{row.memory:>10.3g}")
        if any(row.pareto for row in self.rows):
            lines.append("* no other is both as quick and as right in Re λ")
        return "\n".join(lines)


def with_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """The rows with `pareto` set: of those in which nothing is missing, the ones that no other beats in seconds and in error."""
    found = []
    for row in rows:
        better = [other for other in rows if other.sound and other.seconds <= row.seconds
                  and other.error_growth <= row.error_growth
                  and (other.seconds, other.error_growth) != (row.seconds, row.error_growth)]
        found.append(replace(row, pareto=row.sound and not better))
    return tuple(found)


def _seconds(value: float) -> str:
    if value == 0:
        return "-"
    return f"{value * 1e3:.3g} ms" if value < 1 else f"{value:.3g} s"
