"""Limit cycles of the full and the reduced models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column, label
from femsub.checks import InputError, NoCycleError

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class CyclesAsk(Ask):
    """Limit cycles that begin from modes of the band, by harmonic balance, with their stability.

    For a large full model, the iteration starts from a reduced model's cycles, and the cycles' stability is not computed.
    """

    cycles: int = key(4, "number of modes, in the order in which they become unstable, whose cycles are sought", least=1)
    near: float = key(0.05, "relative difference of frequencies up to which cycles of two models belong to one mode", above=0)

    KIND: ClassVar[str] = "cycles"
    NEEDS: ClassVar[tuple[str, ...]] = ("belt",)
    NONLINEAR: ClassVar[bool] = True

    @property
    def families(self) -> int:
        """The number of modes whose cycles are sought."""
        return self.cycles

    def largest(self, models: Models) -> dict[str, Any]:
        """The largest model of each method. Small models come first, since large ones start from their cycles."""
        found: dict[str, Any] = {}
        for one in models.every:
            if one.kind not in found or one.model.size >= found[one.kind].size:
                found[one.kind] = one.model
        return fs.motion.in_turn(found)

    def onsets(self, models: Models) -> tuple[list[float], float]:
        """Frequencies of the modes to follow, and F μ' at the Hopf point of the first mode, both of the first small model."""
        first, limits = next(iter(self.largest(models).values())), models.band_of(self.band)
        if not fs.motion.small(first):
            raise InputError("no model is small enough for its modes to be listed; give [reduce]")
        omega, c = models.kept(("onsets", id(first), limits, repr(models.contacts)),
                               lambda: fs.motion.onsets(fs.motion.sliding(first, models.contacts), limits))
        if not len(omega):
            raise NoCycleError(f"steady sliding is stable in the band {limits[0]:g} to {limits[1]:g}: no cycle begins; "
                               "raise the force, or change the speed")
        return [float(value) for value in np.sort(omega[:self.families])], float(c[0])

    def run(self, models: Models) -> Result:
        rows = [row for family in self.onsets(models)[0] for row in fs.motion.family_cycles(
            self.largest(models), models.contacts, family, self.near, models.say)]
        kept = [row for row in rows if "omega" in row]
        columns = ("model", "size", column("family", unit=""), "omega", column("omega_error", "error of ω", ".1e"), "rms",
                   column("rms_error", "error of rms", ".1e"), "peak", column("sticking", form=".0%"), "is_stable", "multiplier",
                   "harmonics", "truncation", column("seconds", form=".2f"))
        at = "at the values of the scene"
        branched = ["Branches are drawn and listed, not judged: the verdict is about the cycles at one value of the parameter."]
        return Result({"cycles": rows}, [
            "Limit cycles; v is the speed under the belt", Table("", kept, columns, keys=3),
            Table("cycles", rows, title="Limit cycles"),
            *["? and no multiplier: for large models the stability of cycles is not computed"] * any(
                row["is_stable"] is None for row in kept),
            *(f"{label(row['model'])} near ω = {row['family']:.4g}: {row['why']}" for row in rows if "why" in row),
            fs.motion.cycles_verdict(rows, at, branched if any(type(one).KIND == "branch" for one in models.scene.asks) else ())])
