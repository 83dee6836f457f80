"""`audit` checks a reduced model of any program, by itself or against the full one: what is right, wrong, cannot be known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import Array, Tally, choice, positive_number, truth
from femsub.output import IN_SI, Chart, Displayed, Level, Panel, Series, Table, Verdict, column, fitted, floored
from femsub.studies.audit_case import FAULT, GOOD, UNKNOWN, Case, Finding
from femsub.studies.audit_checks import findings

if TYPE_CHECKING:
    from femsub.model import Pencil, Substructure

TRUSTED = 0.01  # relative error up to which a frequency counts as trusted
NONE_FOUND = "no fault found"  # the best verdict without the full model, since only that shows missing modes


@dataclass(frozen=True, eq=False, repr=False)
class Audit(Displayed):
    """The result of an audit of a reduced model. See `audit`.

    Attributes
    ----------
    name : str
    size : int
        Coordinates of the reduced model.
    full_size : int
        DOF of the full model; 0 without one.
    findings : tuple of Finding
        One for each check, with `what`, `verdict` ('good', 'fault', 'unknown'), `said`, `figure`, `limit`, `todo`.
    omega : ndarray, shape (k,)
        Elastic frequencies of the reduced model in radians per unit of time.
    lower : ndarray, shape (k,)
        Frequencies of the full model; without it, lower bounds of its frequencies. NaN where neither is known.
    cutoff : float
        The frequency of the first mode that is left out, as counted, or as stated. NaN where it is not known.
    tally : Tally
        Numbers of modes below the cut-off, in the reduced model, and in the full one by the inertia of K - ω²M.

    Examples
    --------
    >>> import femsub as fs
    >>> full = fs.chain(30)
    >>> fs.audit(fs.reduce(full, fs.CraigBampton(8)), full)
    Audit of 'chain': good, 24 checks, 0 faults, 0 unknown, trusted up to 0.7579 rad/time, certified
    """

    name: str
    size: int
    full_size: int
    findings: tuple[Finding, ...]
    omega: Array = field(default_factory=lambda: np.zeros(0))
    lower: Array = field(default_factory=lambda: np.zeros(0))
    cutoff: float = np.nan
    tally: Tally = field(default=Tally(0))

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The findings that are faults."""
        return tuple(one for one in self.findings if one.verdict == FAULT)

    @property
    def unknown(self) -> tuple[Finding, ...]:
        """The findings that could not be decided."""
        return tuple(one for one in self.findings if one.verdict == UNKNOWN)

    @property
    def verdict(self) -> str:
        """'fault' if there is a fault; otherwise 'good' against the full model, or 'no fault found' without it."""
        return FAULT if self.faults else GOOD if self.full_size else NONE_FOUND

    @property
    def error(self) -> Array:
        """|omega/lower - 1|, shape (k,): the relative error of each frequency; without the full model, a bound of it."""
        safe = np.where(self.lower == 0, np.nan, self.lower)
        return np.where(self.lower == 0, np.inf, np.abs(self.omega / safe - 1))

    @property
    def trusted(self) -> float:
        """ω up to which the error of every frequency is at most 1 %, and the cut-off at most. NaN if no error is known."""
        known = self.error
        if not len(known) or np.isnan(known[0]):
            return np.nan
        right = int(np.argmin(np.append(known <= TRUSTED, False)))
        end = float(self.omega[right - 1]) if right else 0.0
        return min(end, self.cutoff) if np.isfinite(self.cutoff) else end

    @property
    def evidence(self) -> str:
        """'certified' if all modes below the cut-off were counted in the full model, and the reduced one has them."""
        return self.tally.evidence

    def __repr__(self) -> str:
        up_to = "" if np.isnan(self.trusted) else f", trusted up to {self.trusted:.4g} rad/time"
        if self.verdict == NONE_FOUND:
            counts = f"; {self._left}, {len(self.findings)} checks"
        else:
            counts = (f", {len(self.findings)} checks, {len(self.faults)} fault{'s' * (len(self.faults) != 1)}, "
                      f"{len(self.unknown)} unknown")
        return f"Audit of {self.name!r}: {self.verdict}{counts}{up_to}, {self.evidence}"

    @property
    def _left(self) -> str:
        """The number of checks that the small matrices alone do not decide, in words."""
        return f"{len(self.unknown)} thing{'s' * (len(self.unknown) != 1)} cannot be known"

    @property
    def answer(self) -> Verdict:
        """The verdict in sentences: what decides it, and what cannot be known."""
        against = f"against the full model of {self.full_size} DOF" if self.full_size else "by itself, without the full model"
        count, of_what = len(self.findings), f"{self.name} ({self.size} DOF)"
        if self.faults:
            names = "; ".join(dict.fromkeys(one.what for one in self.faults))
            headline = f"{len(self.faults)} of {count} checks of {of_what}, {against}, found a fault: {names}."
        elif not self.full_size:
            names = "; ".join(dict.fromkeys(one.what for one in self.unknown)) or "none of its checks needs it"
            headline = f"{self._left} of {of_what} without the full model: {names}."
        else:
            headline = f"{count - len(self.unknown)} checks of {of_what}, {against}, found no fault" + (
                f"; {len(self.unknown)} could not be decided." if self.unknown else ".")
        decides = [f"{one.what}: {one.said}. {one.todo}." for one in self.faults]
        unknown = [f"Not known: {one.what}: {one.said}." + (f" {one.todo}." if one.todo else "") for one in self.unknown]
        how = "by the full model's own" if self.full_size else (
            "by a bound from the small matrices, if the inside has fixed-interface modes and the cut-off is right")
        right = int(np.count_nonzero(self.omega <= self.trusted))
        trust = f"No elastic frequency is within {TRUSTED:.0%}, {how}."
        if right:
            trust = (f"Trusted: {right} elastic frequencies, up to {self.trusted:.6g} rad/time, are within "
                     f"{max(self.error[:right].max(), 1e-12):.1e}, {how}.")
        if np.isnan(self.trusted):
            trust = "Which frequencies may be trusted is not known without the full model" + (
                "." if np.isnan(self.cutoff) else f". None above the cut-off, {self.cutoff:.6g} rad/time.")
        answer = "no" if self.faults else "yes" if self.full_size else NONE_FOUND
        return Verdict([*decides, trust, *unknown], (), answer, headline, "Is the reduced model what it should be?")

    def tables(self) -> list[Table]:
        """The checks, and the frequencies with their errors or bounds."""
        rows = [{"check": one.what, **{key: getattr(one, key) for key in ("verdict", "figure", "limit", "said", "todo")}}
                for one in self.findings]
        values = [{"mode": at + 1, "omega": float(one), "full": None if np.isnan(low) else float(low),
                   "error": None if np.isnan(low) or np.isinf(error) else float(error)}
                  for at, (one, low, error) in enumerate(zip(self.omega, self.lower, self.error, strict=True))]
        head = "full model" if self.full_size else "not below"
        return [Table("checks", rows, [column("check", "check", "s"), column("verdict", "verdict", "s", cell=_word),
                                       column("figure", "figure", ".1e"), column("limit", "limit", ".0e")], "Checks"),
                Table("frequencies", values, ["mode", "omega", column("full", head, ".6g"), "error"] if values else (),
                      "Elastic frequencies, interface free", most=Case.few)]

    def chart(self, title: str = "") -> Chart:
        """Errors of the frequencies, or their bounds, up to the cut-off."""
        name = "error" if self.full_size else "bound of the error"
        levels = [Level(self.cutoff, "first mode left out")] if np.isfinite(self.cutoff) else []
        return Chart("frequencies", title or f"{self.name}: {name} of frequencies", [Panel(
            [Series(name, self.omega, floored(self.error))], "ω  [rad/time]", name, "", "y", levels, rounding=True)])

    @property
    def text(self) -> str:
        """One page: the verdict, what decides it, all checks, the frequencies, and what cannot be known."""
        said = self.answer
        return fitted("\n\n".join([said.text, *filter(None, (one.text() for one in self.tables())),
                                   "\n".join(f"- {line}" for line in said.decides)]))

    def record(self) -> dict[str, Any]:
        """The whole result as numbers, texts and lists, for JSON."""
        def plain(value: float | None) -> float | None:
            return None if value is None or not np.isfinite(value) else float(value)

        return {"verdict": self.verdict, "name": self.name, "size": self.size, "full_size": self.full_size,
                "checks": [{**row, "figure": plain(row["figure"]), "limit": plain(row["limit"])}
                           for row in self.tables()[0].rows],
                "omega": self.omega.tolist(), "full" if self.full_size else "lower": [plain(one) for one in self.lower],
                "cutoff": plain(self.cutoff), "trusted": plain(self.trusted), "evidence": self.evidence}


def _word(row: Mapping[str, Any]) -> str:
    """The verdict, with a fault in capitals. It is no lambda, so that the tables of two equal audits compare as equal."""
    return "FAULT" if row["verdict"] == FAULT else row["verdict"]


def audit(reduced: Substructure | Pencil | Mapping[str, Any], full: Substructure | None = None, *, mass: float | None = None,
          cutoff: float | None = None, floating: bool | None = None, gyroscopic: bool = False, units: str = "") -> Audit:
    """Check a reduced model from any source: M, D, K of shape (r, r), by itself or against the full one, (n, n).

    Without the full model the checks are: symmetry, definiteness, orthonormal modes, rigid motion without strain energy, the mass
    matrix of a rigid body, and the number of digits. Against the full model each statement is an equation, a count or a bound:

        M = VᵀMV, K = VᵀKV, D = VᵀDV,   XᵀKX = K_bb - K_bi K_ii⁻¹ K_ib,   XᵀMX = CᵀMC,   ω ≥ ω_full,

    with X (r, n_b) and C (n, n_b) the static responses of both models to motions of the interface. The modes below the cut-off
    are counted by the inertia of K - ω²M. Only the first three equations need V.

    Parameters
    ----------
    reduced : ReducedSubstructure, Substructure, Pencil or mapping
        A mapping has the matrices as given, with any faults: M, K, and optionally D and V (n, r). Further entries are interface
        (coordinates that are interface DOF, from 0), full_interface (the same DOF as rows of the full model), cutoff and name.
        The entry kinds has a word for each coordinate, as of `ReducedSubstructure`, and dofs the `DofMap` of the interface with
        points.
    full : Substructure, optional
        The full model. Its interface is in the order of the reduced model's interface.
    mass : float, optional
        The mass that the part should have, to 1 %.
    cutoff : float, optional
        The cut-off that the author states: all modes below it are kept. Default: the cut-off of the model itself.
    floating : bool, optional
        Whether the part is unsupported. With the full model this is known.
    gyroscopic : bool
        Whether the part turns, so that D may be unsymmetric.
    units : str
        'SI' or 'mm-t-s'. If given, mass, lengths and frequencies are checked against those of possible solids.

    Returns
    -------
    Audit
        ``print(fs.audit(...).text)`` is one page.

    Raises
    ------
    InputError, InputTypeError
        M or K is missing; the mapping has an unknown entry; the full model is no `Substructure`.

    Examples
    --------
    >>> import femsub as fs
    >>> full = fs.chain(30)
    >>> rom = fs.reduce(full, fs.CraigBampton(8))
    >>> found = fs.audit({"M": rom.M, "K": 1000 * rom.K, "interface": rom.interface, "cutoff": rom.cutoff}, full)
    >>> found.verdict, found.faults[0].what
    ('fault', 'static interface response')
    """
    stated: dict[str, Any] = {
        "mass": None if mass is None else positive_number("mass", mass), "turning": truth("gyroscopic", gyroscopic),
        "floating": None if floating is None else truth("floating", floating),
        "units": "" if isinstance(units, str) and not units else choice("units", units, IN_SI)}
    if cutoff is not None:
        stated["cutoff"] = positive_number("cutoff", cutoff)
    case = Case.of(reduced, full=full, **stated)
    head = case.name, case.size, 0 if full is None else full.size, findings(case)
    if case.stopped:
        return Audit(*head)
    first, tally = case.cutoff, Tally(0)
    if full is not None:
        first, tally = (np.nan, tally) if isinstance(case.kept, Finding) else (case.kept.first, case.kept.tally)
    omega = case.elastic_frequencies[:case.few]
    omega, lower = (omega, np.full(len(omega), np.nan)) if isinstance(case.frequencies, Finding) else case.frequencies
    return Audit(*head, omega, lower, first, tally)
