"""The verdict of a run in plain sentences: may a small model replace the full one, what decides it, what is not checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from femsub.checks import NOT_CHECKED
from femsub.output.tables import label, span

#: is_stable → words in a sentence
STABLE = {True: "stable", False: "unstable", None: "neither stable nor unstable beyond its error bars"}

#: limits of the verdict, for every scene that compares models: no run can decide this
NEVER = ("All errors are relative to the full model. The run does not show how well its mesh, its materials and its friction law "
         "describe the real part.")
LINEAR = ("The verdict is that of the linear model about steady sliding. Motion beyond the border was not computed: ask for "
          "motion or cycles.")
#: keys of answers → words that are printed
ANSWERS = {"yes": "Yes", "no": "No", "in part": "In part", "open": "Not decided", "found": "Found",
           "nowhere": "Nowhere", "no fault found": "No fault found"}
OUTSIDE = "Frequencies outside the band were not compared."


@dataclass(frozen=True)
class Remark:
    """Lines that one output adds to the verdict of a run: what decides it, and what is not checked."""

    decides: Sequence[str] = ()
    unchecked: Sequence[str] = ()

    @classmethod
    def of_completeness(cls, evidence: str, where: str = "") -> Remark:
        """The evidence that all eigenvalues of the full model in the band were found."""
        said = [f"Completeness of the full model's eigenvalues in the band{where}: {evidence}."]
        return cls(unchecked=said) if evidence == NOT_CHECKED else cls(said)

    @classmethod
    def of_stability(cls, models: Sequence[Mapping[str, Any]]) -> Remark:
        """Whether the full model is stable, and which models differ from it. Each model has `growth` and `is_stable`."""
        full = next(one for one in models if one["model"] == "full")
        if not math.isfinite(full["growth"]):
            return cls()
        others = [one for one in models if one["is_stable"] != full["is_stable"]]
        return cls([f"Steady sliding is {STABLE[full['is_stable']]}: the full model's largest Re λ is {full['growth']:.5g}.",
                    *(f"Mind: {named(one['model'], one['size'])} says {STABLE[one['is_stable']]}." for one in others)])


@dataclass(frozen=True)
class Verdict(Remark):
    """The verdict of a run: `answer`, a key of `ANSWERS`; `headline`, a sentence; what decides it; what is not checked."""

    answer: str = "open"
    headline: str = ("This run compares no models by their errors, so it does not decide whether a small model may replace the "
                     "full one.")
    question: str = "May a small model replace the full one?"
    condition: Sequence[str] = ()

    @property
    def decided(self) -> bool:
        """Whether the run has compared models, or has answered another question of its scene."""
        return self.headline != Verdict.headline

    @property
    def text(self) -> str:
        """The question, the answer, and the condition under which the answer holds."""
        return "\n".join([self.question, f"{ANSWERS[self.answer]}. {self.headline}",
                          *(f"Condition: {line}" for line in self.condition)])

    def said(self, words: Any) -> dict[str, Any]:
        """The verdict as results.json has it; the function `words` puts units into a text."""
        return {key: words(value) if isinstance(value, str) else [words(line) for line in dict.fromkeys(value)]
                for key, value in asdict(self).items()}


@dataclass(frozen=True)
class Advice(Remark):
    """The recommendation of one comparison: `model` in words with its `size`, or '' if no model is accurate enough.

    It holds in `band`, and for the values of varied keys in `where`. `row` is the model's row of the study, as plain columns.
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
    """The verdict of a run, from the advice, verdicts and remarks of its outputs."""
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
    """A recommendation as a sentence: with a capital letter and a full stop, after `start` and a colon if given."""
    text = f"{start}: {text}" if start else text
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
