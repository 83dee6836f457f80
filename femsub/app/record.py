"""The record of a run in its results.json: all inputs, hashes of files, versions, machine, date and commit."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

from femsub.app.grammar import Scene
from femsub.app.report import run_on, write
from femsub.app.result import Progress, Result
from femsub.checks import FemsubWarning, InputError, first_few, hash_of, installed_by, is_there, resolved, warn
from femsub.io import RESULTS, Writer, remove, results_of, texts_read
from femsub.output import to_json

OURS = (".json", ".csv", ".png", ".vtu", ".pvd", ".html")  # endings of the files that scenes write


class Record:
    """A run whose results are written into a folder. It is created before the run begins.

    Raises
    ------
    InputError
        The folder holds the results of another scene, or a results.json that femsub did not write.
    """

    def __init__(self, scene: Scene, folder: Path) -> None:
        self.scene, self.folder = scene, folder
        if scene.figures and find_spec("matplotlib") is None:
            warn(f"no figures are drawn, they need matplotlib: {installed_by('matplotlib')}", FemsubWarning)
            self.scene = scene.without_figures()
        if scene.paged:
            from femsub.output import check_plotly

            check_plotly()  # now, not after hours of computing
        self.last: dict[str, Any] = {}  # the files that the last run of this scene wrote into the folder, with their hashes
        place = folder / RESULTS
        if is_there(place):
            known = results_of(place)
            if known is None:
                raise InputError(f"{place} was not written by femsub; choose another folder for --out")
            if known["scene"] != scene.name:
                others = [path.name for path in sorted(folder.iterdir()) if path.suffix in OURS]
                raise InputError(f"the output folder {folder} holds the results of another scene, {known['scene']!r} "
                                 f"({first_few(others)}); choose another folder for --out, or delete them")
            self.last = {name: known["sha256"].get(name) for name in known["written"] if isinstance(name, str)}
        self.inputs, self.files = deepcopy(scene.table), list[dict[str, Any]]()
        for table, name in scene.file_places(self.inputs):
            path, matrix = scene.folder / table[name], ""
            if not path.is_file() and ":" in path.name:  # 'model.mat:K' names the matrix K in a file
                file, _, matrix = path.name.rpartition(":")
                path, matrix = path.with_name(file), f":{matrix}"
            self.files += self._described([path])
            table[name] = self._place(path) + matrix

    def run(self, progress: Progress) -> Result:
        """Runs the scene, and records the text files that its files include."""
        with texts_read() as texts:
            result = self.scene.run(progress)
        known = {item["path"] for item in self.files}
        self.files += self._described(path for path in dict.fromkeys([*self.scene.texts, *texts]) if self._place(path) not
                                      in known)
        return result

    def write(self, result: Result, warned: Sequence[str] = ()) -> list[Path]:
        """Writes the results. Removes files that only the last run of this scene wrote, and warns of other result files."""
        data: dict[str, Any] = {
            "scene": self.scene.name, "date": datetime.now(UTC).isoformat(timespec="seconds"), **run_on(),
            "inputs": self.inputs, "files": self.files}
        if warned:
            data["warnings"] = list(warned)
        result = replace(result, data=data | result.record(self.scene.units))
        if self.scene.paged:
            result = replace(result, files=result.files | _page(result))
        written = write(result, self.folder, self.scene.figures, self.scene.units)
        names = {path.relative_to(self.folder).as_posix() for path in written}
        inputs = {item["path"] for item in self.files}
        remove(self.folder, {name: known for name, known in self.last.items() if name not in names | inputs})
        strange = sorted({path.name for path in self.folder.iterdir() if path.suffix in OURS} - names - inputs)
        if strange:
            warn(f"{self.folder} also holds files that are not of this run: {first_few(strange)}", FemsubWarning)
        return written

    def _place(self, path: Path) -> str:
        """The path of a file relative to the folder of the results, so that both can be moved together."""
        whole, folder = resolved(path.parent) / path.name, resolved(self.folder)
        shared = next(above for above in (folder, *folder.parents) if whole.is_relative_to(above))
        up = [".."] * len(folder.relative_to(shared).parts)
        return Path(*up, whole.relative_to(shared)).as_posix()

    def _described(self, paths: Iterable[Path]) -> list[dict[str, Any]]:
        """Path, hash and size of each file. An unreadable file is left out: the scene reports it."""
        found = []
        for path in paths:
            with suppress(PermissionError):
                if path.is_file():
                    found.append({"path": self._place(path), "sha256": hash_of(path), "bytes": path.stat().st_size})
        return found


def _page(result: Result) -> dict[str, Writer]:
    """The page of a run, from the data of its results.json, and from the mode's file if the scene has one."""
    from femsub.app.page import PAGE_FILE
    from femsub.io import read_mode, toml_text
    from femsub.output import MODE_FILE, write_page

    def page(file: BinaryIO) -> None:
        mode = None
        if MODE_FILE in result.files:
            content = io.BytesIO()
            result.files[MODE_FILE](content)
            mode = read_mode(Path(MODE_FILE), content)
        write_page(json.loads(to_json(result.data)), toml_text(result.data["inputs"]), mode, file)

    return {PAGE_FILE: page}
