"""A superelement of another program, or a folder that femsub has written."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import femsub as fs
from femsub.app.ends import End
from femsub.app.kinds import key
from femsub.app.parts import Made, Part, PartSite, from_file
from femsub.app.parts.matrices import DOF

MODEL = "model.json"  # the index of a folder of write_matrices


@dataclass(frozen=True)
class SuperelementPart(Part):
    """A superelement, given by any of its files. A joint names its whole boundary, 'wing', or one grid of it, 'wing.11'."""

    superelement: str = key("", "its file (.asm, .pch, .op4, .op2, .nc), a .full file, or the model.json of a folder of "
                            "write_matrices", required=True, example="wing.asm", file=True)
    cutoff: float = key(0.0, "the frequency up to which its author kept all modes", unit="rad/time", least=0,
                        otherwise="the frequency of its highest mode, with a warning")
    ports: dict[str, Any] = key({}, f"places by their names: lists of DOF, {DOF}", otherwise="none", example={"tip": ["11:uy"]})

    KIND: ClassVar[str] = "superelement"

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        path = from_file(site, self.superelement)
        given: dict[str, Any] = {"interface": self.interface, "ports": self.ports, "cutoff": self.cutoff}
        return self.one(site, fs.read_component(path.parent if path.name == MODEL else path, name=site.name, **{
            name: value for name, value in given.items() if value}))

    def needed(self, end: End) -> list[Any]:
        return []  # a superelement has a fixed boundary

    def end(self, words: str, sets: Iterable[str] | None) -> Any:
        return words

    def check_port(self, name: str, port: str) -> None:
        if Path(self.superelement).name != MODEL:  # a folder of write_matrices has ports of its own
            super().check_port(name, port)
