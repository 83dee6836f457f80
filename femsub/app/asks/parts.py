"""A picture of the parts, each in its own colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Picture, Result, Table, column

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class PartsAsk(Ask):
    """The parts that have meshes: a table, a picture, and a VTU file with the number of the part at each node, counted from 1."""

    parts: bool = key(True, "names this analysis; the value has no effect")

    KIND: ClassVar[str] = "parts"

    def run(self, models: Models) -> Result:
        meshes, name = models.meshes, models.scene.name
        title = f"{name}: {models.full.size} DOF in {len(meshes)} part{'s' * (len(meshes) != 1)}"
        rows: list[dict[str, Any]] = [{"part": part, "nodes": len(mesh.points), "cells": len(mesh.cells), "kind": mesh.kind}
                                      for part, mesh in meshes.items()]
        columns = ("part", column("nodes", form="d"), column("cells", form="d"), column("kind", form="s"))
        if not rows:
            return Result({"parts": rows}, ["No part has a mesh: there is nothing to draw"])
        shown: list[Any] = [Table("parts", rows, columns, "Parts")]
        if len({mesh.kind for mesh in meshes.values()}) > 1 or next(iter(meshes.values())).dimension == 1:
            return Result({"parts": rows}, shown)
        whole, number = fs.components.joined_parts(meshes)
        return Result({"parts": rows}, [*shown, Picture("parts", lambda: fs.components.parts_figure(meshes, title))],
                      {"parts.vtu": fs.io.mesh_writer(whole, {"part": number})})
