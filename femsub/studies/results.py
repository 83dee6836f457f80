"""The results of a study: a row for each model, the recommendation, and the table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import choice, positive_number
from femsub.output import STABLE, Advice, Chart, Column, Displayed, Table, column, fitted, grouped, label, sentence, span
from femsub.studies.charts_errors import size_chart, study_chart

if TYPE_CHECKING:
    from femsub.model import Substructure
    from femsub.modes import ComplexModes

BRIEF = ("method", "size", "error_growth", "missed", "missing", "error_critical", "error_force", "error_held", "error_response",
         "reduction_median_s", "solution_median_s")  # columns of the short table
PHASES = ("factorisation", "basis", "certificate", "projection")  # phases of a reduction


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
    """One model of a study. Errors are relative to the full model: the largest in the band, at all values of the parameter.

    Attributes
    ----------
    method, modes, size : str, int, int
        The method's key; 'full' has size n.
    error_eigenvalue : float
        max |λ_reduced - λ_full| / |λ_full| over matched pairs.
    error_growth : float
        max |Re λ_reduced - Re λ_full| over the same pairs, relative to the sum of the rates at which the full model's damping
        dissipates energy and the belt supplies it (`turnover`). An error relative to Re λ itself would be unbounded
        at the stability border. Without a belt it is relative to |Re λ_full|.
    error_critical : float
        |p_reduced - p_full| / |p_full| of the critical value; NaN if there is none (see `reason`).
    missing : int
        Eigenvalues of the full model in the band without a counterpart within half of |λ|. The errors do not include them.
    critical : float
        The value of the parameter at which stability is first lost. If it never is: -inf for a belt's slope, inf for others.
    growth : float
        The largest Re λ in the band and below the cut-off.
    reduction, solution : Timing
        Seconds to reduce, and to compute the complex modes in the band at one value of the parameter.
    port_error : float
        Error of the static response at the contacts' ports, in the energy norm.
    cutoff : float
        Modes above this frequency must not decide about stability (inf for a complete basis and for the full model).
    extra : int
        Eigenvalues in the band and below the cut-off that have no counterpart in the full model.
    error_frequency : float
        max |Δω| / ω over the undamped frequencies in the band, with the stiffness of the contacts but without friction.
    mac : float
        The smallest MAC of the matched complex modes (of subspaces for clusters).
    phases : mapping of str to Timing
        The parts of `reduction`: factorisation; basis (modes and static shapes); certificate (the second factorisation
        that counts the modes of a large model); projection.
    memory : float
        MB of the model's matrices (M, D, K and V).
    pareto : bool
        No other reduced model is both as fast and as accurate (error_growth). A model is faster than another if even its slowest
        run (reduction and solution) beats the other's fastest run by 25 %. If not, or if models were reduced only once, the model
        with fewer DOF counts as faster, since differences of milliseconds are noise.
    stable : bool or None
        The verdict in the band: True, False at some value, or None if the error bars leave it undecided.
    reason : str
        Why there is no critical value.
    parts : mapping of str to int
        Of a system: the modes kept in each of its reduced parts.
    error_force : float
        Of a system: the error of the forces in the joints over the undamped modes in the band, relative to the largest
        (`force_error`); NaN where a mode has no counterpart.
    error_real : float
        max |Re λ_reduced - Re λ_full| / |λ_full|.
    missed, invented : int
        Modes in the band that grow only in the full model, and only in this one, at all values of the parameter.
    omega : float
        The frequency of the first loss.
    error_held : float
        max |Δω| / ω with the interface held at rest in both models; inf if the reduced one lacks a mode of the band, NaN if this
        was not asked for or is not known.
    error_response : float
        A bound of max |Δh| over the frequencies asked for, relative to the largest |h| of that entry of the receptance; NaN if
        this was not asked for.
    """

    method: str
    modes: int
    size: int
    error_eigenvalue: float
    error_growth: float
    error_critical: float
    missing: int
    critical: float
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
    stable: bool | None = None
    reason: str = ""
    parts: Mapping[str, int] = field(default_factory=dict)
    error_force: float = np.nan
    error_real: float = np.nan
    missed: int = 0
    invented: int = 0
    omega: float = np.nan
    error_held: float = np.nan
    error_response: float = np.nan

    @property
    def label(self) -> str:
        """The method's name in tables."""
        return label(self.method)

    @property
    def named(self) -> str:
        """'Rubin with 4 modes (9 DOF)'; for a system 'with 4 modes in each part (20 DOF in total)', or 'in disc, 2 in pad'."""
        if not self.parts:
            return f"{self.label} with {_modes(self.modes)} ({self.size} DOF)"
        counts = list(self.parts.values())
        each = f"{_modes(counts[0])} in each part" if len(set(counts)) == 1 else ", ".join(
            f"{count if at else _modes(count)} in {name}" for at, (name, count) in enumerate(self.parts.items()))
        return f"{self.label} with {each} ({self.size} DOF in total)"

    @property
    def whole(self) -> Timing:
        """Seconds to reduce and to solve."""
        return Timing(*(a + b for a, b in zip(astuple(self.reduction), astuple(self.solution), strict=True)))

    def quicker(self, other: Row) -> bool:
        """Whether even its slowest run (reduction and solution) beats the other's fastest run by 25 %.

        False if one of the two was reduced only once, since the spread of a single run is unknown.
        """
        if any(row.reduction.most == row.reduction.least for row in (self, other)):
            return False
        return 1.25 * self.whole.most < other.whole.least

    @property
    def sound(self) -> bool:
        """Whether no eigenvalue is missing and none is extra in the band."""
        return self.missing == self.extra == 0

    def flat(self) -> dict[str, Any]:
        """Plain columns, for CSV and JSON."""
        flat: dict[str, Any] = {}
        for key, value in asdict(self).items():
            if key == "parts":
                flat |= {f"modes_{name}": count for name, count in value.items()}
            elif key == "phases":
                flat |= {f"{name}_s": timing["median"] for name, timing in value.items()}
            elif isinstance(value, dict):
                flat |= {f"{key}_{name}_s": number for name, number in value.items()}
            else:
                flat[key] = value
        return flat


@dataclass(frozen=True, repr=False)
class Study(Displayed):
    """The results of `study`: a row for the full model and one for each reduced model; `print` shows them as a table.

    Attributes
    ----------
    band, repeats, parameter, values, between
        The arguments of `study`; `parameter` is '' if there is none.
    full, rows : Row, tuple of Row
    assembly : float
        Seconds for building the full model, if known.
    left_out : tuple of str
        The methods that could not reduce the model, and why.
    models : tuple of ReducedSubstructure or System
        The reduced models, row by row.
    spectra : tuple of ComplexModes
        The full model's modes, at each value of the parameter.
    interface : int
        The number of interface DOF.
    steps : tuple
        The steps of reduction of each of `models`.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.study(fs.chain(10, belt=1), [fs.CraigChang(4)], band=(0.0, 0.5), repeats=1)
    >>> found.rows[0].size, found.rows[0].error_eigenvalue < 1e-3
    (5, True)
    """

    name: str
    band: tuple[float, float]
    repeats: int
    full: Row
    rows: tuple[Row, ...]
    assembly: float = np.nan
    parameter: str = ""
    values: tuple[float, ...] = ()
    between: tuple[float, float] | None = None
    left_out: tuple[str, ...] = ()
    models: tuple[Substructure, ...] = field(default=(), compare=False)
    spectra: tuple[ComplexModes, ...] = field(default=(), compare=False)
    interface: int = 0
    steps: tuple[Any, ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        best = min(self.rows, key=lambda row: row.error_eigenvalue, default=None)
        text = "" if best is None else f"; smallest error {best.error_eigenvalue:.1e} by {best.label} with {best.size} DOF"
        return f"Study of {self.name!r}: {len(self.rows)} reduced models against {self.full.size} DOF{text}"

    def tables(self) -> list[Table]:
        """A row for the full model and one for each reduced model."""
        return [Table("compare", self.flat, self._columns(), f"Errors and run times of {self.name}", keys=2)]

    def chart(self, title: str = "", over: str = "time") -> Chart:
        """Errors against run time, or over the DOF of the models with `over="size"`."""
        if choice("over", over, ("time", "size")) == "size":
            return size_chart(self, title or self.name)
        return study_chart(self, title or self.name)

    @property
    def flat(self) -> list[dict[str, Any]]:
        """The rows in plain columns, that of the full model first."""
        return [row.flat() for row in (self.full, *self.rows)]

    def recommended(self, tol: float = 1e-3, held: bool = False) -> Row | None:
        """The smallest reduced model that may replace the full one, or None; with `held` also where its interface is held.

        It has fewer DOF than the full model. Over a range of the parameter, it misses no unstable mode, and error_critical is at
        most `tol`. Without a range, error_growth (error_frequency if nothing is damped) is at most `tol`, no eigenvalue in the
        band is missing or spurious, and the whole band is below the cut-off. With `held`, error_held is at most `tol` too.

        Of these models, the smallest is chosen: it is solved fastest, and the choice does not depend on timing noise. Of models
        of equal size, the most accurate one is chosen, unless even the slowest run of another one is faster by 25 %.
        """
        positive_number("tol", tol)
        return self._best([row for row in self.rows if not held or row.error_held <= tol], tol)

    def _best(self, rows: Iterable[Row], tol: float) -> Row | None:
        """The recommended one of these rows, or None."""
        fit = [row for row in rows if row.size < self.full.size and self._error(row) <= tol and self._sound(row)]
        least = min((row.size for row in fit), default=0)
        fit = [row for row in fit if row.size == least]
        return min((row for row in fit if not any(other.quicker(row) for other in fit)), key=self._error, default=None)

    def _error(self, row: Row) -> float:
        """The decisive error of a row."""
        return float(getattr(row, self.decisive))

    @property
    def decisive(self) -> str:
        """The key of the error that decides: of growth rates; over a range, of the critical value; undamped, of frequencies."""
        if self.between is not None:
            return "error_critical"
        return "error_growth" if any(row.error_growth != 0 for row in self.rows) else "error_frequency"

    def _sound(self, row: Row) -> bool:
        """Whether a model has no wrong modes, whatever its error: none is missing or extra, or over a range none is missed."""
        return row.sound and row.cutoff >= self.band[1] if self.between is None else not row.missed

    @property
    def symbol(self) -> str:
        """The parameter as it is written in texts: μ for 'mu'."""
        return "μ" if self.parameter == "mu" else self.parameter

    def recommendation(self, tol: float = 1e-3) -> str:
        """`recommended` in words."""
        row = self.recommended(tol)
        what = {"error_growth": "the rates of damping and growth", "error_frequency": "the undamped frequencies",
                "error_critical": f"the critical {self.symbol} of the full model"}[self.decisive]
        where = f"{100 * tol:.3g} % of {what} from {span(self.band)}"
        if row is not None:
            return f"for {where} take {row.named}: {'; '.join(self.worth(row))}"
        whole = [row for row in self.rows if (row.sound if self.between is None else not row.missed) and self._error(row) > tol]
        near = min(whole, key=self._error, default=None)
        nearest = "" if near is None else f"; {near.named} comes nearest with {100 * self._error(near):.2g} %"
        return f"for {where} no smaller model is accurate enough{nearest}. Keep more modes, or lower the band"

    def worth(self, row: Row) -> list[str]:
        """Sentences on a model's run time, forces in the joints, modes that grow, and stability."""
        small, large = row.solution.median, self.full.solution.median
        faster = large / small if small > 0 else np.inf
        ratio = f"{float(f'{faster if faster >= 1 else 1 / faster:.2g}'):g} times {'faster' if faster >= 1 else 'slower'}"
        said = [f"it takes {seconds(row.reduction.median)} to reduce and {seconds(small)} to solve, {ratio} than the full model"]
        if not np.isnan(row.error_force):
            # forces with an error above 10 % are of no use for a design
            within = "are within" if row.error_force <= 0.1 else "are not to be trusted, they are off by up to"
            said.append(f"the forces in the joints {within} {100 * row.error_force:.2g} %")
        if self.between is not None:
            said.append("no unstable mode of the full model is missed"
                        + (f", but {row.invented} invented" if row.invented else " and none is invented"))
        elif row.stable == self.full.stable:
            said.append(f"in the band both models are {STABLE[row.stable]}")
        else:
            said.append(f"mind: in the band the full model is {STABLE[self.full.stable]} and the small one {STABLE[row.stable]}, "
                        "the border is nearer than the error")
        if large > small:
            count = int(np.ceil(row.reduction.median / (large - small)))
            said.append("the reduction pays off at once" if count <= 1 else f"the reduction pays off from {count} solutions")
        return said

    def advice(self, tol: float = 1e-3, where: str = "") -> Advice:
        """The recommendation of a study, and the figures that decide it."""
        row = self.recommended(tol)
        at = ", ".join(f"{value:g}" for value in self.values)
        choice = Advice(unchecked=[f"The full model was solved at {self.symbol} = {at} alone."] if at else (), where=where,
                        sentence=self.recommendation(tol), full=self.full.size, band=self.band, brief=self.brief(tol))
        if row is None:
            return choice
        # the condition under which the recommendation holds, and errors with the interface held at rest
        free = "the interface is free, as in this run."
        off = "Held at rest, this model " + ("lacks a mode of the band" if math.isinf(row.error_held) else
                                             f"has frequencies that are off by {row.error_held:.1e}")
        if self.between:
            holds = f"{self.symbol} lies between {self.between[0]:g} and {self.between[1]:g}."
        elif not self.interface:
            holds = "the model has no interface. Its accuracy when joined to others is unknown."
        elif math.isnan(row.error_held):
            holds = f"{free} A held interface was not compared."
        elif row.error_held <= tol:
            holds = f"the interface is free, as in this run, or held at rest. {off}."
        else:
            other = self.recommended(tol, held=True)
            then = "no model of this run is accurate enough"
            if other is not None:
                then = f"take {other.named}, which is off by {other.error_held:.1e}"
            holds = f"{free} {off}; there {then}."
        # the figures that decide
        error = {"error_growth": "the growth rates in the band are within {} of the rates of damping and friction",
                 "error_frequency": "the undamped frequencies in the band are within {}, and nothing is damped",
                 "error_critical": f"the critical {self.symbol} is within {{}} of the full model's"}[self.decisive]
        decides = [f"{row.named}: {error.format(format(getattr(row, self.decisive), '.1e'))}; the tolerance is {tol:g}."]
        if self.between:
            errors = ["unknown" if math.isnan(one) else f"{one:.1e}" for one in (row.error_eigenvalue, row.error_real)]
            decides.append(f"Its eigenvalues are within {errors[0]} of their modulus, its growth rates within {errors[1]}.")
        else:
            decides.append("No eigenvalue of the band is missing and none is extra. The band ends below the model's cut-off.")
        if row.critical == -math.inf and row.error_critical == 0:
            decides.append("At no slope does it lose its stability in the band, and neither does the full model.")
        elif not self.between and math.isfinite(row.error_critical):
            decides.append(f"Its critical slope is {row.critical:.5g}, within {row.error_critical:.1e} of the full model's.")
        return replace(choice, model=row.named, size=row.size, row=row.flat(), condition=[holds],
                       decides=[*decides, *map(sentence, self.worth(row))])

    def brief(self, tol: float = 1e-3) -> str:
        """The short table: the full model, the recommended or else the best model of each method, and the methods left out."""
        best, rows = self.recommended(tol), [self.full]
        for own in grouped(self.rows, "method").values():
            rows.append(best if best is not None and best in own else self._best(own, tol) or min(
                own, key=lambda row: (not self._sound(row), np.nan_to_num(self._error(row), nan=np.inf))))
        kept = [one for one in self._columns() if one.key in (*BRIEF, self.decisive)
                and (one.key != "missing" or any(row.missing for row in rows))]
        first = replace(kept[0], cell=lambda row: f"{'>' if row['recommended'] else ' '} {label(row['method'])}")
        text = Table("", [row.flat() | {"recommended": row is best} for row in rows], [first, *kept[1:]], keys=2).text()
        return "\n".join([text, *(["> recommended"] if best else []), *map(fitted, self.left_out)])

    @property
    def _forces(self) -> bool:
        """Whether the forces in the joints are compared."""
        return self.full.error_force == 0 and (self.between is None or any(row.error_force >= 0 for row in self.rows))

    def _columns(self) -> list[Column]:
        """The columns of the table; `missing` and `stable` only if a model differs there from the full one."""
        forces, over = self._forces, bool(self.values) or self.between is not None
        apart = [] if over else [key for key in ("missing", "stable")
                                 if any(getattr(row, key) != getattr(self.full, key) for row in self.rows)]
        # for systems the forces in the joints replace λ, since ω and Re λ already show its error
        return [column(one) if isinstance(one, str) else one for one in (
            column("method", "  method", cell=lambda row: f"{'*' if row['pareto'] else ' '} {label(row['method'])}"), "size",
            *([] if over else ["error_frequency"]),
            *(["error_held"] if any(row.error_held >= 0 for row in self.rows) else []),
            *(["error_response"] if any(row.error_response >= 0 for row in self.rows) else []),
            *([] if forces else ["error_eigenvalue"]),
            *([column("error_real", "err Re λ"), "missed", "invented"] if over else ["error_growth"]),
            *([] if self.between is None else [column("critical", f"critical {self.symbol}", ".5f", cell=lambda row: (
                "none" if row["critical"] == np.inf else row["critical"]))]),
            *([column("error_critical", f"err {self.symbol}", cell=lambda row: (
                None if row["error_critical"] == np.inf else row["error_critical"]))] if self.parameter else []),
            *(["error_force"] if forces else []), *apart,
            column("reduction_median_s", "reduce", "s", cell=lambda row: seconds(row["reduction_median_s"])),
            column("solution_median_s", "solve", "s", cell=lambda row: seconds(row["solution_median_s"])))]

    def __str__(self) -> str:
        built = "" if np.isnan(self.assembly) else f", assembled in {seconds(self.assembly)}"
        over = bool(self.values) or self.between is not None
        at = f", {self.symbol} = {', '.join(f'{value:g}' for value in self.values)}" if self.values else ""
        lines = [f"{self.name}: band {span(self.band)}{at}, medians of {self.repeats}{built}",
                 Table("", self.flat, self._columns(), keys=2).text()]
        if any(row.pareto for row in self.rows):
            lines.append("* no other is both as fast (or as small, where the runs' times overlap) and as accurate in Re λ")
        if over:
            lines.append("err Re λ: relative to |λ|; missed: modes that grow in the full model alone; invented: in the small one "
                         "alone")
        what = f"no critical {self.symbol}"
        short = [row for row in self.rows if row.cutoff < self.band[1] and np.isnan(row.critical)]
        if short and self.parameter:
            lines.append(f"{what} where the band reaches above the cut-off: {reaching(short)}")
        without = [row for row in (self.full, *self.rows) if row.reason and row not in short]
        for (name, reason), those in grouped(without, "label", "reason").items():
            lines.append(f"{what} of {name} with {', '.join(str(row.size) for row in those)} DOF: {reason}")
        if any(np.isnan(row.error_force) for row in self.rows) and self._forces:
            lines.append("no error of the forces where a mode of the full system has no counterpart")
        return fitted("\n".join([*lines, *self.left_out]))


def reaching(rows: Sequence[Row]) -> str:
    """'Craig-Bampton with 2, 3 DOF (cut-off 0.49, 0.8)', method by method."""
    return "; ".join(f"{method} with {', '.join(str(row.size) for row in those)} DOF (cut-off "
                     f"{', '.join(f'{row.cutoff:.4g}' for row in those)})" for method, those in grouped(rows, "label").items())


def with_front(rows: Sequence[Row], hi: float = 0.0) -> tuple[Row, ...]:
    """The rows; `pareto` is set in those that no other row beats in time (or size) and in error.

    Only rows without missing or extra eigenvalues, and with a cut-off of at least `hi`, the band's upper end, are considered.
    """
    fit = [row for row in rows if row.sound and row.cutoff >= hi]
    found = []
    for row in rows:
        beaten = False
        for other in fit:
            quicker, slower = other.quicker(row), row.quicker(other)
            as_quick = quicker or (not slower and other.size <= row.size)
            better = quicker or (not slower and other.size < row.size) or other.error_growth < row.error_growth
            beaten |= as_quick and other.error_growth <= row.error_growth and better
        found.append(replace(row, pareto=row in fit and not beaten))
    return tuple(found)


def _modes(count: int) -> str:
    return f"{count} mode{'s' * (count != 1)}"


def seconds(value: float) -> str:
    """'3.1 ms', '2.4 s'."""
    if value == 0:
        return "-"
    digits = float(f"{value:.2g}")  # a run time has no more significant digits
    return f"{digits * 1e3:g} ms" if digits < 1 else f"{digits:g} s"
