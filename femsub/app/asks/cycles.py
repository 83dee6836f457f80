"""Limit cycles of the full and the reduced models."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.keys import key
from femsub.app.result import Result, Table, column, label
from femsub.checks import InputError, NoCycleError, NotConvergedError

if TYPE_CHECKING:
    from femsub import Substructure
    from femsub.app.models import Known, Models


@dataclass(frozen=True)
class CyclesAsk(Ask):
    """Limit cycles that begin from modes of the band, by harmonic balance, with their stability.

    Those of a large full model start from those of a reduced one; their stability is not computed.
    """

    cycles: int = key(4, "modes, in the order in which they become unstable, whose cycles are sought", least=1)
    near: float = key(0.05, "relative difference of frequencies up to which cycles of two models belong to one mode", above=0)

    KIND: ClassVar[str] = "cycles"
    NEEDS: ClassVar[tuple[str, ...]] = ("belt",)
    NONLINEAR: ClassVar[bool] = True

    @property
    def families(self) -> int:
        """The number of modes."""
        return self.cycles

    def ordered(self, models: Models) -> list[Known]:
        """Small models first: large ones start from the others' cycles. Of each method the model with the most modes."""
        largest: dict[str, Known] = {}
        for one in models.every:
            if one.kind not in largest or one.model.size >= largest[one.kind].model.size:
                largest[one.kind] = one
        return sorted(largest.values(), key=lambda one: not small(one.model))

    def onsets(self, models: Models) -> tuple[list[float], float]:
        """Frequencies of the modes to follow, and F μ' at the first one's Hopf point: those of the first small model."""
        several, limits = [one.model for one in self.ordered(models) if small(one.model)], models.band_of(self.band)
        if not several:
            raise InputError("no model is small enough for its modes to be listed; give [reduce]")

        def sought() -> Any:
            return fs.motion.onsets(fs.motion.sliding(several[0], models.contacts), limits)

        omega, c = models.kept(("onsets", id(several[0]), limits, repr(models.contacts)), sought)
        if not len(omega):
            raise NoCycleError(f"steady sliding is stable in the band {limits[0]:g} to {limits[1]:g}: no cycle begins; "
                               "raise the force, or change the speed")
        return [float(value) for value in np.sort(omega[:self.families])], float(c[0])

    def run(self, models: Models) -> Result:
        rows, ordered = list[dict[str, Any]](), self.ordered(models)
        order = ["full", *dict.fromkeys(one.kind for one in models.reduced)]
        if not small(models.full):
            order = [*order[1:], "full"]
        for family in self.onsets(models)[0]:
            found: dict[str, fs.LimitCycle] = {}
            here: list[dict[str, Any]] = []
            for one in ordered:
                models.say(f"limit cycle of {label(one.kind)} near ω = {family:.4g}")
                begun = time.perf_counter()
                here.append({"family": family, "model": one.kind, "size": one.model.size})
                try:
                    start: Any = family if small(one.model) else next(reversed(found.values()), None)
                    if start is None:
                        raise NotConvergedError("no reduced model gave a cycle to start from")
                    cycle = fs.harmonic_balance(one.model, models.contacts, start=start)
                    if abs(cycle.omega / family - 1) > self.near:
                        raise NotConvergedError(f"only another cycle was found, at ω = {cycle.omega:.5g}")
                except (NotConvergedError, NoCycleError) as error:
                    here[-1]["why"] = str(error)
                    continue
                seconds, floquet = time.perf_counter() - begun, cycle.floquet
                found[one.kind] = cycle
                here[-1] |= cycle.row() | {"seconds": seconds,
                                           "multiplier": None if floquet is None else complex(floquet.values[0]),
                                           "trivial_error": None if floquet is None else floquet.error}
            full = found.get("full")
            for row in here:
                if full is not None and "omega" in row and row["model"] != "full":
                    row |= {"omega_error": abs(row["omega"] / full.omega - 1), "rms_error": abs(row["rms"] / full.rms - 1)}
            rows += sorted(here, key=lambda row: order.index(row["model"]))
        kept = [row for row in rows if "omega" in row]
        columns = ("model", "size", column("family", unit=""), "omega", column("omega_error", "error of ω", ".1e"), "rms",
                   column("rms_error", "error of rms", ".1e"), "peak", column("sticking", form=".0%"), "is_stable", "multiplier",
                   "harmonics", "truncation", column("seconds", form=".2f"))
        at = "at the values of the scene"
        branched = ["Branches are drawn and listed, not judged: the verdict is that of the cycles at one parameter."]
        return Result({"cycles": rows}, [
            "Limit cycles; v is the speed under the belt", Table("", kept, columns, keys=3),
            Table("cycles", rows, title="Limit cycles"),
            *["?, and no multiplier: of large models the stability of cycles is not computed"] * any(
                row["is_stable"] is None for row in kept),
            *(f"{label(row['model'])} near ω = {row['family']:.4g}: {row['why']}" for row in rows if "why" in row),
            fs.motion.cycles_verdict(rows, at, branched if any(type(one).KIND == "branch" for one in models.scene.asks) else ())])


def small(model: Substructure) -> bool:
    """Whether all modes of a model, and the stability of its cycles, are at hand."""
    return not model.pencil.is_sparse or model.size <= fs.algebra.QUADRATIC
