"""The answer of a run in plain sentences: may a small model replace the full one, what decides it, what is not checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from femsub.checks import NOT_CHECKED
from femsub.output import label, span
from femsub.studies.results import STABLE, Study

#: what no run can decide, for every scene that compares models
NEVER = ("All errors are relative to the full model. The run does not show how well its mesh, its materials and its friction law "
         "describe the real part.")
LINEAR = ("The verdict is that of the linear model about steady sliding. Motion beyond the border was not computed: ask for "
          "motion or cycles.")
#: answers, as a reader meets them
ANSWERS = {"yes": "Yes", "no": "No", "in part": "In part", "open": "Not decided", "found": "Found",
           "nowhere": "Nowhere", "no fault found": "No fault found"}
OUTSIDE = "Frequencies outside the band were not compared."


@dataclass(frozen=True)
class Remark:
    """What one output adds to the answer of a run: lines of what decides it, and of what is not checked."""

    decides: Sequence[str] = ()
    unchecked: Sequence[str] = ()

    @classmethod
    def of_completeness(cls, evidence: str, where: str = "") -> Remark:
        """Whether all eigenvalues of the full model in the band were found."""
        said = [f"Completeness of the full model's eigenvalues in the band{where}: {evidence}."]
        return cls(unchecked=said) if evidence == NOT_CHECKED else cls(said)


@dataclass(frozen=True)
class Verdict(Remark):
    """A key of `ANSWERS`; the answer in a sentence; what decides it; what is not checked."""

    answer: str = "open"
    headline: str = ("This run compares no models by their errors, so it does not decide whether a small model may replace the "
                     "full one.")
    question: str = "May a small model replace the full one?"
    condition: Sequence[str] = ()

    @property
    def decided(self) -> bool:
        """Whether the run has compared models, or found what its scene asks for."""
        return self.headline != Verdict.headline

    @property
    def text(self) -> str:
        """The question, the answer, and the condition that it rests on."""
        return "\n".join([self.question, f"{ANSWERS[self.answer]}. {self.headline}",
                          *(f"Condition: {line}" for line in self.condition)])

    def said(self, words: Any) -> dict[str, Any]:
        """As it stands in results.json; `words` puts units into a text."""
        return {key: words(value) if isinstance(value, str) else [words(line) for line in dict.fromkeys(value)]
                for key, value in asdict(self).items()}


@dataclass(frozen=True)
class Advice(Remark):
    """What one comparison recommends: `model` in words with its `size`, or '' if none will do, and for what it holds.

    `row` is that of the model in a study, in plain columns.
    """

    sentence: str = ""
    model: str = ""
    size: int = 0
    full: int = 0
    band: tuple[float, float] = (0.0, 0.0)
    where: str = ""
    condition: Sequence[str] = ()
    brief: str = ""
    row: Mapping[str, Any] | None = None


def answer(found: Iterable[Any]) -> Verdict:
    """The verdict of a run from the choices, verdicts and remarks of its outputs."""
    known = [one for one in found if isinstance(one, Remark)]
    choices = [one for one in known if isinstance(one, Advice)]
    base = next((one for one in known if isinstance(one, Verdict)), Verdict())
    fit = [one for one in choices if one.model]
    band = f"in the band {span(choices[0].band)}" if choices else ""
    if fit:
        best = min(fit, key=lambda one: one.size)
        decides: list[str] = []
        for one in choices:
            said = one.decides if one.model else [sentence(one.sentence)]
            several = one.where and len(choices) > 1
            decides += [f"{one.where.capitalize()}: {' '.join(said)}"] if several else said
        where = f" ({best.where})" if best.where else ""
        base = Verdict(decides, [OUTSIDE, *best.unchecked, NEVER, LINEAR], "yes" if len(fit) == len(choices) else "in part",
                       f"{best.model} may replace the full model of {best.full} DOF {band}{where}.", condition=best.condition)
    elif choices:
        base = Verdict([sentence(one.sentence, one.where) for one in choices], [NEVER, LINEAR], "no",
                       f"No small model of this run may replace the full one {band}.")
    others = [one for one in known if not isinstance(one, (Advice, Verdict))]
    return replace(base, decides=[*base.decides, *(line for one in others for line in one.decides)],
                   unchecked=[*base.unchecked, *(line for one in others for line in one.unchecked)])


def study_choice(found: Study, tol: float = 1e-3, where: str = "") -> Advice:
    """What a study recommends, and what makes that model fit, figure by figure."""
    row = found.recommended(tol)
    at = ", ".join(f"{value:g}" for value in found.values)
    choice = Advice(unchecked=[f"The full model was solved at {found.symbol} = {at} alone."] if at else (), where=where,
                    sentence=found.recommendation(tol), full=found.full.size, band=found.band, brief=found.brief(tol))
    if row is None:
        return choice
    # for what the recommendation holds, and what it is worth with the interface held at rest
    free = "the interface is free, as in this run."
    off = "Held at rest, this model " + ("lacks a mode of the band" if math.isinf(row.error_held) else
                                         f"has frequencies that are off by {row.error_held:.1e}")
    if found.between:
        holds = f"{found.symbol} lies between {found.between[0]:g} and {found.between[1]:g}."
    elif not found.interface:
        holds = "the model has no interface. Nothing is known of it joined to others."
    elif math.isnan(row.error_held):
        holds = f"{free} A held interface was not compared."
    elif row.error_held <= tol:
        holds = f"the interface is free, as in this run, or held at rest. {off}."
    else:
        other = found.recommended(tol, held=True)
        then = "no model of this run is accurate enough"
        if other is not None:
            then = f"take {other.named}, which is off by {other.error_held:.1e}"
        holds = f"{free} {off}; there {then}."
    # what makes it fit
    error = {"error_growth": "the growth rates in the band are within {} of the rates of damping and friction",
             "error_frequency": "the undamped frequencies in the band are within {}, and nothing is damped",
             "error_critical": f"the critical {found.symbol} is within {{}} of the full model's"}[found.decisive]
    decides = [f"{row.named}: {error.format(format(getattr(row, found.decisive), '.1e'))}; the tolerance is {tol:g}."]
    if found.between:
        errors = ["unknown" if math.isnan(one) else f"{one:.1e}" for one in (row.error_eigenvalue, row.error_real)]
        decides.append(f"Its eigenvalues are within {errors[0]} of their modulus, its growth rates within {errors[1]}.")
    else:
        decides.append("No eigenvalue of the band is missing and none is extra. The band ends below the model's cut-off.")
    if row.critical == -math.inf and row.error_critical == 0:
        decides.append("At no slope does it lose its stability in the band, and neither does the full model.")
    elif not found.between and math.isfinite(row.error_critical):
        decides.append(f"Its critical slope is {row.critical:.5g}, within {row.error_critical:.1e} of the full model's.")
    return replace(choice, model=row.named, size=row.size, row=row.flat(), condition=[holds],
                   decides=[*decides, *map(sentence, found.worth(row))])


def stability_remark(models: Sequence[Mapping[str, Any]]) -> Remark:
    """What the eigenvalues of the full model say, and which model says otherwise; `growth` and `is_stable` of each model."""
    full = next(one for one in models if one["model"] == "full")
    if not math.isfinite(full["growth"]):
        return Remark()
    return Remark([f"Steady sliding is {STABLE[full['is_stable']]}: the full model's largest Re λ is {full['growth']:.5g}.",
                   *(f"Mind: {named(one['model'], one['size'])} says {STABLE[one['is_stable']]}." for one in models
                     if one["is_stable"] != full["is_stable"])])


def cycles_verdict(rows: Sequence[Mapping[str, Any]], where: str, unchecked: Sequence[str] = ()) -> Verdict:
    """Limit cycles: whether each reduced model has those of the full one, with the same stability."""
    known = [row for row in rows if "omega" in row]
    full = {row["family"]: row for row in known if row["model"] == "full"}
    names = {row["model"]: row["size"] for row in rows if row["model"] != "full"}
    decides, good = [], []
    for name, size in names.items() if full else ():
        own = {row["family"]: row for row in known if row["model"] == name}
        both = [family for family in full if family in own]
        other = [family for family in both if own[family]["is_stable"] != full[family]["is_stable"]]
        said = f"{named(name, size)} has {len(both)} of the {len(full)} cycles of the full model"
        if both:
            said += (f", with frequencies within {max(own[at]['omega_error'] for at in both):.1e} and amplitudes (rms) within "
                     f"{max(own[at]['rms_error'] for at in both):.1e}")
        decides.append(f"{said}.")
        decides += [f"{named(name, size)}: the cycle near ω = {at:.4g} is {STABLE[own[at]['is_stable']]}, but "
                    f"{STABLE[full[at]['is_stable']]} in the full model." for at in other]
        if len(both) == len(full) and not other:
            good.append(named(name, size))
    if not full:
        end = "open", "The full model's limit cycles are not among the results. Nothing is decided."
    elif not names:
        end = "open", f"The full model has {len(full)} limit cycles. No small model was compared."
    elif good:
        end = "yes" if len(good) == len(names) else "in part", (
            f"{' and '.join(good)} may replace the full model for its limit cycles {where}, if the errors shown here are "
            "acceptable. The same cycles exist and are stable alike.")
    else:
        end = "no", f"No small model has all limit cycles of the full model {where} with the same stability."
    sought = "Cycles that begin from no mode of the band were not sought. Motions that are no cycle were not either."
    return Verdict(decides, [NEVER, sought, *unchecked], *end)


def named(model: str, size: int) -> str:
    """'Craig-Bampton (11 DOF)'."""
    return f"{label(model)} ({size} DOF)"


def sentence(text: str, start: str = "") -> str:
    """A recommendation as a sentence of its own."""
    text = f"{start}: {text}" if start else text
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
