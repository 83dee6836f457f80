"""The answer of a run in plain sentences: may a small model replace the full one, what decides it, what is not checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from femsub.checks import NOT_CHECKED
from femsub.output.tables import label, span

#: what is_stable means in a sentence
STABLE = {True: "stable", False: "unstable", None: "neither stable nor unstable beyond its error bars"}

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

    @classmethod
    def of_stability(cls, models: Sequence[Mapping[str, Any]]) -> Remark:
        """What the eigenvalues of the full model say, and which model says otherwise; `growth` and `is_stable` of each model."""
        full = next(one for one in models if one["model"] == "full")
        if not math.isfinite(full["growth"]):
            return cls()
        others = [one for one in models if one["is_stable"] != full["is_stable"]]
        return cls([f"Steady sliding is {STABLE[full['is_stable']]}: the full model's largest Re λ is {full['growth']:.5g}.",
                    *(f"Mind: {named(one['model'], one['size'])} says {STABLE[one['is_stable']]}." for one in others)])


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


def named(model: str, size: int) -> str:
    """'Craig-Bampton (11 DOF)'."""
    return f"{label(model)} ({size} DOF)"


def sentence(text: str, start: str = "") -> str:
    """A recommendation as a sentence of its own."""
    text = f"{start}: {text}" if start else text
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
