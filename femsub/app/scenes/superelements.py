"""Superelements of other programs, joined: what was read, an audit of each, the system's frequencies, and a further reduction."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from femsub import ReducedSubstructure, audit
from femsub.app.keys import key
from femsub.app.scene import Result
from femsub.app.scenes import own_parts
from femsub.app.scenes.joined_parts import JoinedRun
from femsub.app.scenes.own_parts import JointKeys, OwnPartsScene, PartKeys
from femsub.studies import Remark, Table, column

COLUMNS = ("part", "size", column("grids", "grids", "d"), "interface", "modes", "cutoff", column("recovered", "motions", "d"),
           column("own_frame", "own frame", "d"), column("trusted", "trusted ω", ".5g", unit="rad/time"),
           column("faults", "faults", "d"))


@dataclass(frozen=True)
class SuperelementsScene(OwnPartsScene):
    """Superelements of other programs, joined, beside parts from matrices and meshes. Each is checked, and reduced once more."""

    parts: list[PartKeys] = key([], "the parts", required=True, example=[
        PartKeys("in", file="inboard.asm", cutoff=314.0), PartKeys("out", file="outboard.asm", cutoff=314.0, port=["11:uy"])])
    joints: list[JointKeys] = key([], "the joints; an end is a grid, 'in.11', or a part's whole boundary, 'in'", required=True,
                                  example=[JointKeys(["in", "out"])])
    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin"])
    modes: list[int] = field(default_factory=lambda: [4, 8, 12])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "modes", "methods")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ()


SCENE = SuperelementsScene


class SuperelementsRun(JoinedRun):
    """The outputs of superelements that are joined."""

    def parts(self) -> Result:
        """What was read of each part that is a reduced model, and the audit's statements."""
        rows: list[dict[str, Any]] = []
        checks: list[dict[str, Any]] = []
        masses: list[str] = []
        faults: list[str] = []
        unknown: list[str] = []
        for name, part in self.system.parts.items():
            if not isinstance(part, ReducedSubstructure):
                continue
            self.say(f"checking {name}")
            found = audit(part, units=self.scene.units)
            dofs, full = part.interface_dofs, part.full_dofs
            frames = [at for at, label in enumerate(full.labels) if "@" in label] if full else []  # which the files do not say
            rows.append({"part": name, "size": part.size, "interface": len(part.interface_numbers), "modes": part.modes,
                         "cutoff": part.cutoff, "recovered": len(part.V), "grids": len(np.unique(dofs.nodes)) if dofs else None,
                         "own_frame": int(np.isin(full.components, frames).sum()) if full else None, "trusted": found.trusted,
                         "faults": len(found.faults), "unknown": len(found.unknown)})
            checks += [{"part": name, **row} for row in found.tables[0].rows]
            masses += [f"{name}: {one.said}" for one in found.findings if one.what == "mass and inertia"]
            faults += [f"{name}: {one.what}: {one.said}. {one.todo}." for one in found.faults]
            unknown += [f"{name}: {one.what}: {one.said}." for one in found.unknown]
        table = Table("superelements", rows, COLUMNS, "Superelements")
        return Result({"superelements": rows, "checks": checks}, [
            "Superelements as they were read, and checked by themselves:", table, *masses,
            Table("checks", checks, (), "Checks of superelements"), Remark(faults, unknown)])


run = partial(own_parts.run, kind=SuperelementsRun)
