#!/usr/bin/env python3
"""The benchmark report: one Markdown page with tables and figures, from scenes, benchmarks, scaling and extreme cases.

    python scripts/report.py [--steps NAME ...] [--work DIR] [--page FILE] [--fresh] [--quick]

Each step is a command of its own, run in a process of its own, one after the other. What it prints is kept in
DIR/NAME/printed.txt, its results beside it. A step that has ended well is not run again: a report that stopped goes on where
it was, and --steps with --fresh repeats what it names. The page is written anew each time, from all steps that are there; it says
for each the command, the commit and the seconds.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import femsub as fs
from femsub.app import report
from femsub.io.atomic import write_whole
from femsub.linalg.petsc import versions

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "scripts"


@dataclass(frozen=True)
class Step:
    """One section of the page: {out} in the command stands for the step's folder."""

    name: str
    title: str
    says: str
    command: tuple[str, ...]
    quick: tuple[str, ...] = ()  #: the same at sizes that show that all works; a step without is left out then
    figures: tuple[str, ...] = ()  #: of the files that it leaves, in this order


# For small dense models: the threads of NumPy's, SciPy's and PETSc's own BLAS wait for each other's core, for up to ten times
# as long as the work takes.
ONE_THREAD = ("env", "OMP_NUM_THREADS=1")


def scene(name: str, title: str, says: str, *figures: str, quick: str = "") -> Step:
    def run(what: str) -> tuple[str, ...]:
        return (*ONE_THREAD, str(SCRIPTS / "femsub"), "run", what, "--out", "{out}")
    small = run(quick) if quick else ()
    return Step(Path(name).stem, title, says, run(name), small, tuple(f"{figure}.png" for figure in figures))


def script(name: str, title: str, says: str, *options: str, figures: tuple[str, ...] = (), quick: tuple[str, ...] = (),
           step: str = "", writes: bool = True, before: tuple[str, ...] = ()) -> Step:
    run, out = (*before, sys.executable, str(SCRIPTS / f"{name}.py")), ("--out", "{out}") if writes else ()
    return Step(step or name, title, says, (*run, *options, *out), (*run, *quick, *out) if quick else (), figures)


STEPS = (
    scene("chain", "The paper's chain", "Ten masses on a belt: critical slopes, and error against run time.", "error-time",
          "size-sweep", quick="{tiny}"),
    scene("beam", "Beam", "A steel beam on a belt, 400 DOF.", "error-time"),
    scene("plate", "Plate", "A thin plate, 3,200 DOF.", "error-time"),
    scene("solid", "Solid", "A brake's disc, 7,920 DOF.", "error-time"),
    scene("scripts/long-chain.toml", "A chain of 100,000 masses", "Beyond its border of stability; the README's first figure.",
          "error-time"),
    scene("scripts/disc-transient.toml", "A disc in time", "10,800 DOF: what a simulated period costs, full and reduced.",
          "error-time"),
    script("bench", "Assembly, bases, sweeps", "Ratios against scikit-fem, SciPy, plain SLEPc and full PEPs, each in one run.",
           "--defaults", "--repeats", "1", quick=("--quick", "--repeats", "1", "--parts", "bases")),
    script("bench", "Bases of a bulky solid", "Quadratic hexahedra, where factors are dense.", "--parts", "bases", "--component",
           "bulk", "--defaults", "--repeats", "1", step="bench-bulk"),
    script("scaling", "Size: the chain", "Seconds, memory and error from 10 masses to a million.", "--components", "chain",
           "--cores", "2", step="scaling-chain", figures=("scaling.png",)),
    script("scaling", "Size: finite elements", "The same for a beam, a plate to 300,000 DOF and a solid to a million.",
           "--components", "beam", "plate", "solid", "--cores", "2", "--repeats", "1", figures=("scaling.png",)),
    script("extreme", "Stiff and extreme cases", "Each right within the bound that is stated for it, or refused with the reason.",
           figures=("extreme.png",)),
    script("effectivity", "Modes chosen to a tolerance", "The estimate against the true error over a gallery.",
           figures=("effectivity.png",)),
    script("certificates", "What certificates cost", "Seconds of the proof over seconds of the solution."),
    script("integrators", "Integrators", "Error against run time of integrators, at n = 10, 100 and 1000.", writes=False),
    script("cycle_cost", "Cost of a limit cycle", "Harmonic balance of finite-element ROMs against that of the chain.",
           "--repeats", "3", writes=False, before=ONE_THREAD),
    script("attractors", "Attractors", "Where seeded starts end, full and reduced.", figures=("attractors.png",)),
)


class Stopped(Exception):
    """A step ended with an error."""


def run(step: Step, folder: Path, quick: bool) -> None:
    """Runs a step and notes that it ended well. What it left when it was stopped stays: some scripts go on from there."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [part.format(out=folder, tiny=SCRIPTS / "tiny-chain.toml") for part in (step.quick if quick else step.command)]
    report.progress(f"{step.name}: {shlex.join(command)}")
    start = time.perf_counter()
    with open(folder / "printed.txt", "wb") as printed:
        process = subprocess.Popen(command, stdout=printed, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        try:
            errors = process.communicate()[1]
        except BaseException:
            process.terminate()
            process.wait()
            raise
    if process.returncode:
        raise Stopped(f"{step.name} ended with status {process.returncode}: {errors.strip()[-500:]}\n"
                      f"  {shlex.join(command)}\n  what it printed is in {folder / 'printed.txt'}")
    shown = shlex.join([part.replace(sys.executable, "python").replace(str(folder), "out").replace(f"{ROOT}/", "")
                        for part in command])
    done = {"command": shown, "commit": commit(), "seconds": time.perf_counter() - start, "date": time.strftime("%Y-%m-%d"),
            "machine": report.machine() | report.versions() | versions(), "warnings": errors.strip().splitlines()}
    write_whole(folder, {"done.json": partial(_put, content=json.dumps(done, indent=1))})


def commit() -> str:
    """The short hash of what is checked out, marked if it was changed (docs apart: the page itself); 'unknown' outside of a
    repository."""
    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    try:
        changed = git("status", "--porcelain", "-uno", "--", ".", ":!docs")
        return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def section(step: Step, folder: Path, pictures: str) -> str:
    """What the page says about a step."""
    done = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    printed = (folder / "printed.txt").read_text(encoding="utf-8").rstrip()
    table = "\n".join(line.rstrip() for line in printed.splitlines() if not line.startswith("written to ")).rstrip()
    parts = [f"## {step.title}", step.says,
             f"`{done['command']}` · {done['seconds']:.0f} s · commit {done['commit']} · {done['date']}", f"```\n{table}\n```"]
    parts += [f"![{step.title}: {Path(name).stem}]({pictures}/{step.name}-{Path(name).name})"
              for name in step.figures if (folder / name).exists()]
    return "\n\n".join(parts)


def page(steps: list[Step], work: Path, target: Path) -> str:
    """The whole page, of all steps that have ended well."""
    found = [step for step in steps if (work / step.name / "done.json").exists()]
    machine = json.loads((work / found[-1].name / "done.json").read_text(encoding="utf-8"))["machine"]
    head = ("# Benchmarks\n\n"
            "Made by `python scripts/report.py`; a step that has ended well is not run again (`--fresh` does). Seconds belong to "
            f"this machine: {', '.join(f'{key} {value}' for key, value in machine.items())}; ratios belong to one run.")
    missing = [step.name for step in steps if step not in found]
    if missing:
        head += f"\n\nNot run yet: {', '.join(missing)}."
    return "\n\n".join([head, *(section(step, work / step.name, target.stem) for step in found)]) + "\n"


def write(steps: list[Step], work: Path, target: Path) -> None:
    """The page and its figures, each whole or not at all."""
    files: dict[str, Callable[[BinaryIO], Any]] = {target.name: partial(_put, content=page(steps, work, target))}
    for step in steps:
        for name in step.figures:
            figure = work / step.name / name
            if (work / step.name / "done.json").exists() and figure.exists():
                files[f"{target.stem}/{step.name}-{figure.name}"] = partial(_put, content=figure.read_bytes())
    write_whole(target.parent, files)


def _put(file: BinaryIO, content: str | bytes) -> None:
    file.write(content.encode() if isinstance(content, str) else content)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", nargs="+", choices=[step.name for step in STEPS], metavar="NAME",
                        help=f"of {', '.join(step.name for step in STEPS)} (default: all)")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "report", metavar="DIR", help="results (default out/report)")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "benchmarks.md", metavar="FILE",
                        help="the page; its figures go into a folder of that name (default docs/benchmarks.md)")
    parser.add_argument("--fresh", action="store_true", help="run again what has been run")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: shows that all works, times mean nothing")
    asked = parser.parse_args()
    for folder in (asked.work, asked.page.parent):
        try:
            report.check_folder(str(folder))
        except fs.InputError as error:
            parser.error(str(error))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the step that runs stays behind
    steps = [step for step in STEPS if step.quick or not asked.quick]
    failed: list[str] = []
    for step in steps:
        folder = asked.work.resolve() / step.name
        if asked.steps and step.name not in asked.steps:
            continue
        if (folder / "done.json").exists() and not asked.fresh:
            print(f"{step.name}: done before")
            continue
        if asked.fresh:
            shutil.rmtree(folder, ignore_errors=True)
        try:
            run(step, folder, asked.quick)
        except Stopped as error:
            failed.append(str(error))
            print(f"failed: {error}", file=sys.stderr)
            continue
        print(f"{step.name}: done")
    report.progress_done()
    if not any((asked.work / step.name / "done.json").exists() for step in steps):
        print("no step has ended well: there is nothing to write a page of", file=sys.stderr)
        return 1
    write(steps, asked.work, asked.page)
    print(f"written: {asked.page}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
