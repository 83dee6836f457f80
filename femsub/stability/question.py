"""The question at which values stability is lost, and its answer, in the form that all solvers share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from femsub.checks import NOT_CHECKED, Array, Tally, until
from femsub.output import Chart, Displayed, Table, column
from femsub.stability.charts import crossings_chart
from femsub.stability.crossings import Crossing, shown_value
from femsub.stability.parameter import PencilOver, pencil_over

if TYPE_CHECKING:
    from femsub.model import Affine, Contacts, Substructure


@dataclass(frozen=True, eq=False)
class LossQuestion:
    """A pencil over a range of a parameter, begin < end, and the band in which crossings count.

    `limited`: the band was given. `falls`: the given range falls, and `over` takes the parameter with the other sign.
    `floats`: the model is known to have rigid motion over the range, driven by friction or not.
    """

    model: Substructure | Affine
    contacts: Contacts
    parameter: str
    over: PencilOver
    between: tuple[float, float]
    band: tuple[float, float]
    limited: bool = True
    falls: bool = False
    floats: bool = False

    @property
    def cutoff(self) -> float:
        """The cut-off of the model if it ends the band or is not known (NaN); inf if a band was given."""
        return np.inf if self.limited and not np.isnan(self.model.cutoff) else self.model.cutoff

    def of(self, model: Substructure) -> LossQuestion:
        """The same question for another model."""
        return replace(self, model=model, over=replace(pencil_over(model, self.contacts, self.parameter), sign=self.over.sign))


@dataclass(frozen=True, eq=False, repr=False)
class CriticalValue(Displayed):
    """The values of a parameter at which stability is lost, made by `critical_value`; ``float(...)`` gives the first.

    "First" and "beyond" follow the search from the start of the range to its end, which may be below it.

    Attributes
    ----------
    parameter : str
    value : float
        The first loss. The start of the range if a mode grows there already. If stability is never lost, inf, or -inf in a range
        that falls. If it is first lost at an unknown place in an open interval: the start of the part that is not settled. If
        the model was followed, and a growing mode enters the band: the value where it enters.
    losses, regains : tuple of Crossing
        Where modes begin and cease to grow, in the order of the search. A loss at either end of the range counts: the mode
        grows, or would grow, just beyond. A regain counts at the end, but not at the start. So the number of losses minus regains
        (a pair counts twice) is the number of growing eigenvalues just beyond the end minus that at the start. The port's root
        finds the first loss only.
    searched : (start, end)
        The range of the parameter.
    band : (lo, hi)
        The band in which crossings count; for a reduced model it ends at the cut-off.
    growing : int
        Number of eigenvalues in the band that grow at the start of the range (a pair counts twice).
    fastest : complex
        The eigenvalue of largest growth among these; NaN if none grows.
    open : tuple of (float, float)
        Intervals in which a crossing, or a crossing there and back, was not excluded. Causes: eigenvalues pass each other on the
        axis or touch it, rounding hides which of them grow, or the limit of work was reached. A window is also open if the modes
        found to cross do not explain the change in the number of growing eigenvalues. In a wide interval only crossings that
        could be verified are listed.
    tally : Tally
        The number of eigenvalues of all losses minus that of all regains, and the change in the number of growing eigenvalues
        over the range.
    evidence : str
        'certified': discs around the eigenvalues, or sweeps around all growing λ in the band, exclude each crossing outside these
        points (with solver='followed' only if the parameter acts through few columns).
        'confirmed' has three meanings. Discs exclude other crossings, but the pencil is not declared affine in the parameter
        (`Contact`). It was sampled in each interval, and its coefficients at 2,048 values of the range (256 for contacts of more
        than 8 columns). A factor that is a function counts as not affine. Or the model was followed: the crossings, and the
        growing modes that pass an edge of the band, explain the numbers of growing eigenvalues at values whose modes are
        complete. Modes that come to an edge anywhere in the range are followed as well. Or, for a port's root, the number of
        growing eigenvalues just beyond it is explained.
        'not checked': some intervals are open, or nothing was counted.
    method : str
        'discs', 'followed', 'scalar function' or 'bracketing'.
    solved : int
        Number of eigenproblems.
    cutoff : float
        The cut-off of a reduced model if no band was given: the band ends there. Otherwise inf. If the cut-off of a basis is not
        known (NaN), the evidence is 'not checked'.

    Examples
    --------
    >>> import femsub as fs
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], None, [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]])])
    >>> fs.critical_value(two_mode, None, "mu", between=(0.0, 1.0))
    CriticalValue: mu = 0.75 (flutter at ω = 1.41421 rad/time) of 1 loss and 0 regains from 0 to 1; certified
    """

    parameter: str
    value: float
    losses: tuple[Crossing, ...]
    regains: tuple[Crossing, ...]
    searched: tuple[float, float]
    band: tuple[float, float]
    growing: int
    open: tuple[tuple[float, float], ...]
    tally: Tally
    solved: int
    fastest: complex
    method: str
    cutoff: float = np.inf

    @classmethod
    def of(cls, question: LossQuestion, losses: Iterable[Crossing], regains: Iterable[Crossing], tally: Tally, *, method: str,
           growing: int = 0, fastest: complex = complex(np.nan, np.nan), lost: Iterable[float] = (),
           open: Iterable[tuple[float, float]] = (), solved: int = 0) -> Self:
        """The answer to a question. `lost`: values beyond which stability is lost at a place that is not known."""
        losses, regains = tuple(losses), tuple(regains)
        value = question.between[0] if growing else min([np.inf, *(one.value for one in losses), *lost])
        found = cls(question.parameter, value, losses, regains, question.between, question.band, growing, tuple(open), tally,
                    solved, fastest, method, question.cutoff)
        if not question.falls:
            return found
        losses, regains = (tuple(replace(one, value=0.0 - one.value) for one in several) for several in (losses, regains))
        return replace(found, value=0.0 - value, losses=losses, regains=regains,
                       searched=(0.0 - question.between[0], 0.0 - question.between[1]),
                       open=tuple((0.0 - hi, 0.0 - lo) for lo, hi in reversed(found.open)))

    @property
    def first(self) -> tuple[Crossing, ...]:
        """All modes that begin to grow together at the first loss; empty if there is no loss, or its place is not known."""
        return tuple(one for one in self.losses
                     if abs(one.value - self.value) <= max(one.width, self.losses[0].width)) if self.losses else ()

    @property
    def omega(self) -> float:
        """The (lowest) frequency at the first loss, in radians per unit of time; 0 for divergence, NaN without a loss."""
        return self.first[0].omega if self.first else np.nan

    @property
    def shape(self) -> Array:
        """The shape of the mode of `omega`, in the model's coordinates; empty without a loss."""
        return self.first[0].shape if self.first else np.zeros(0)

    @property
    def crossing(self) -> Array:
        """The frequencies of all modes that begin to grow together at the first loss, ascending."""
        return np.array([one.omega for one in self.first])

    @property
    def growth(self) -> tuple[float, float]:
        """Re λ of the mode of `omega` before and beyond the value."""
        return self.first[0].growth if self.first else (np.nan, np.nan)

    @property
    def evidence(self) -> str:
        return NOT_CHECKED if np.isnan(self.cutoff) else self.tally.evidence

    def __float__(self) -> float:
        return float(self.value)

    def rows(self) -> list[dict[str, Any]]:
        """A row for each loss and regain. One row without a value if stability is never lost, or lost at an unknown place."""
        several: list[tuple[str, Any]] = [*(("lost", one) for one in self.losses), *(("regained", one) for one in self.regains)]
        if self.growing or not (self.first or (self.regains and np.isinf(self.value))):
            where = "never lost" if np.isinf(self.value) else "lost at a place not known"
            several.insert(0, ("lost at the start" if self.growing else where, None))
        return [{"stability": what, "value": one and one.value, "kind": one.kind if one else "", "omega": one and one.omega,
                 "width": one and one.width, "evidence": self.evidence}
                for what, one in several]

    def beside(self, known: float | None) -> list[dict[str, Any]]:
        """`rows` with a `known` value as the reference of the first loss, or of a row without a value, and the loss's error."""
        rows = self.rows()
        first = next((row for row in rows if row["value"] == self.value), None)
        return [row | {"reference": known if row is first or row["value"] is None else None,
                       "error": abs(row["value"] - known) if row is first and known is not None else None} for row in rows]

    def tables(self) -> list[Table]:
        """A row for each loss and regain of stability."""
        columns = [column("stability", form="s"), column("value", self.parameter, ".8g"), column("kind", form="s"), "omega",
                   "evidence"]
        return [Table("critical", self.rows(), columns, f"Losses and regains of stability over {self.parameter}")]

    def chart(self, title: str = "Losses and regains of stability") -> Chart:
        """Frequencies of losses and regains over the parameter, and the intervals in which more crossings were not excluded."""
        return crossings_chart(self, title)

    def __repr__(self) -> str:
        counts = [f"{len(several)} {name}{ending * (len(several) != 1)}"
                  for several, name, ending in ((self.losses, "loss", "es"), (self.regains, "regain", "s"))]
        where = f"{' and '.join(counts)} from {self.searched[0]:g} to {self.searched[1]:g}{until(self.cutoff)}; {self.evidence}"
        where += f", {len(self.open)} intervals open" if self.open else ""
        if self.growing:
            what = f": {self.growing} eigenvalues grow from the start;"
        elif not np.isfinite(self.value):
            what = ": stability is never lost;"
        elif not self.first:
            what = f": lost beyond {self.value:.9g}, at a place not known;" if self.open else \
                f": a growing mode enters the band at {self.value:.9g};"
        else:
            one, more = self.first[0], len(self.first) - 1
            what = f" = {shown_value(one.value, one.width)} ({one.place}{f', {more} more cross with it' if more else ''}) of"
        return f"CriticalValue: {self.parameter}{what} {where}"


def fastest(values: Array) -> complex:
    """The eigenvalue of largest growth among growing ones, with Im λ ≥ 0; NaN if there is none."""
    top = max(values.tolist(), key=lambda value: value.real, default=complex(np.nan, np.nan))
    return complex(top.real, abs(top.imag))
