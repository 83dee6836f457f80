"""Processes that are killed at random moments while they write; run as a script, so that the forks are of a small process.

    killing.py write|run FOLDER COUNT SEED

writes model after model into FOLDER, or runs scenes into it, kills that after a random time COUNT times, reads what is left, and
prints how often it was which model. One that cannot be read, or a file that is left over, ends in a traceback.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuzz_matrices
from fuzzing import fingerprint

import femsub as fs
from femsub.app.cli import main

SCENE = ('scene = "matrices"\nband = [0.0, 0.9]\n[part.part]\nmatrices = {{M = "M.mtx", K = "K.mtx"}}\ninterface = [0, 7]\n'
         'ports = {{belt = [3]}}\n[reduce]\nmodes = [3]\n[[ask]]\nmatrices = "{}"\n')


def models(count: int) -> list[fs.Substructure]:
    """Models of one shape: no part of one tells that it is not another's."""
    part = fuzz_matrices.model()
    return [fs.Substructure(part.M, (1 + number) * part.K, part.D, part.interface, part.ports, f"model {number}", part.dofs)
            for number in range(count)]


def write_models(folder: Path) -> tuple[Callable[[int], Any], Callable[[], Any]]:
    """One that writes model i, and one that reads."""
    written = models(2)
    formats = ("mtx", "npz", "mat")
    return (lambda step: fs.write_matrices(folder, written[step % 2], formats[step // 2 % 3])), \
        lambda: fingerprint(fuzz_matrices.read_component(folder))


def run_scenes(folder: Path) -> tuple[Callable[[int], Any], Callable[[], Any]]:
    """The same with scenes, whose reduced models are read."""
    scenes = []
    for number, part in enumerate(models(2)):
        place = folder.parent / f"scene-{number}"
        fs.write_matrices(place, part)
        (place / "scene.toml").write_text(SCENE.format("npz"))
        scenes.append(str(place / "scene.toml"))

    def run(step: int) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            assert main(["run", scenes[step % 2], "--out", str(folder)]) == 0

    def read() -> Any:
        json.loads((folder / "results.json").read_text())
        content = fuzz_matrices.read_component(folder / "craig-bampton-3")
        content["factorisations"] = 0
        return fingerprint(content)

    return run, read


def hidden(folder: Path) -> list[Path]:
    """Files and folders that a writer hides while it writes."""
    return [path for path in folder.rglob("*") if path.name.startswith(".")]


def killed(folder: Path, act: Callable[[int], Any], read: Callable[[], Any], count: int, seed: int) -> Counter[str]:
    """How often what is read behind a kill was model 0 or model 1."""
    rng, known, seconds = random.Random(seed), {}, []
    for step in (0, 1):
        start = time.perf_counter()
        act(step)
        seconds.append(time.perf_counter() - start)
        known[read()] = f"model {step}"
    assert len(known) == 2
    found: Counter[str] = Counter()
    for kill in range(count):
        start_at = rng.randrange(6)
        process = os.fork()
        if not process:
            with contextlib.suppress(BaseException):
                for step in range(start_at, 1000):
                    act(step)
            os._exit(1)  # it was to be killed
        time.sleep(rng.uniform(0, 2.5 * max(seconds)))
        os.kill(process, signal.SIGKILL)
        status = os.waitpid(process, 0)[1]
        assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL, "the writer ended by itself"
        found[known[read()]] += 1
        if not kill % 10:  # the next write leaves nothing behind
            act(start_at)
            assert read() in known and not hidden(folder), hidden(folder)
    return found


if __name__ == "__main__":
    what, place, number, start_seed = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    print(json.dumps(killed(place, *{"write": write_models, "run": run_scenes}[what](place), number, start_seed)))
