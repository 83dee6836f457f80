#!/usr/bin/env python3
"""The benchmarks: data and figures behind docs/benchmarks.md, from scenes, benchmarks, scaling and extreme cases.

    python scripts/report.py [--steps NAME ...] [--work DIR] [--data DIR] [--pictures DIR] [--fresh] [--quick]

Each step is a command of its own, run in a process of its own, one after the other. What it prints is kept in
WORK/NAME/printed.txt, its results beside it. A step that has ended well is not run again: a report that stopped goes on where
it was, and --steps with --fresh repeats what it names. DATA/NAME.txt holds what a step has printed, below its command, its
seconds, the commit and the machine. PICTURES gets its figures. The page with the conclusions is written by hand.
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
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import femsub as fs
from femsub.algebra.petsc import versions
from femsub.app import report
from femsub.io.atomic import write_whole

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "scripts"


@dataclass(frozen=True)
class Step:
    """One command: {out} in it stands for the step's folder."""

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


def module(name: str, title: str, says: str, *options: str, step: str = "") -> Step:
    return Step(step or name, title, says, (sys.executable, "-m", f"benchmarks.{name}", *options))


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
    scene("brake", "A brake", "Disc and two pads with friction between them: full and reduced.", "flutter", "error-time"),
    script("brake_convergence", "A brake over three meshes", "Frequency, growth and critical friction over element length.",
           step="brake-convergence", figures=("brake-convergence.png",)),
    module("brake", "A large brake", "Seconds and memory for 100 values of the friction.", step="brake-size"),
    script("attack", "Critical values", "Against exact counts, closed forms and dense scans, on 700 random models.",
           "critical_values", "--cases", "700", writes=False, step="critical-values"),
    script("random_brakes", "Friction to a tolerance", "Random small brakes against dense solutions of their full models.",
           "--brakes", "200", step="random-brakes"),
    script("system_effectivity", "Systems of parts to a tolerance", "The estimate against the true error over random systems.",
           step="system-effectivity"),
    script("workers", "Parts side by side", "One process against two.", writes=False),
    module("assembly", "A million DOF in parts", "As one part, part by part, and by two processes."),
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
    """The short hash of what is checked out, marked if it was changed (docs and data apart: what this script writes);
    'unknown' outside of a repository."""
    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    try:
        changed = git("status", "--porcelain", "-uno", "--", ".", ":!docs", ":!benchmarks/data")
        return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def text(step: Step, folder: Path) -> str:
    """What a step has printed, below what belongs to it."""
    done = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    printed = (folder / "printed.txt").read_text(encoding="utf-8").rstrip()
    table = "\n".join(line.rstrip() for line in printed.splitlines() if not line.startswith("written to ")).rstrip()
    machine = ", ".join(f"{key} {value}" for key, value in done["machine"].items())
    return (f"# {step.title}. {step.says}\n# {done['command']}\n# {done['seconds']:.0f} s, commit {done['commit']}, "
            f"{done['date']}; {machine}\n\n{table}\n")


def picture(step: Step, figure: str) -> str:
    """The file of a figure in the folder of pictures."""
    stem = Path(figure).stem
    return f"{step.name}.png" if stem in step.name else f"{step.name}-{stem}.png"


def write(steps: list[Step], work: Path, data: Path, pictures: Path) -> list[str]:
    """The texts and figures of the steps that have ended well, each folder whole or not at all; their names."""
    ended = [step for step in steps if (work / step.name / "done.json").exists()]
    figures = {picture(step, name): work / step.name / name for step in ended for name in step.figures}
    write_whole(data, {f"{step.name}.txt": partial(_put, content=text(step, work / step.name)) for step in ended})
    write_whole(pictures, {name: partial(_put, content=path.read_bytes()) for name, path in figures.items() if path.exists()})
    return [step.name for step in ended]


def _put(file: BinaryIO, content: str | bytes) -> None:
    file.write(content.encode() if isinstance(content, str) else content)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", nargs="+", choices=[step.name for step in STEPS], metavar="NAME",
                        help=f"of {', '.join(step.name for step in STEPS)} (default: all)")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "report", metavar="DIR", help="results (default out/report)")
    parser.add_argument("--data", type=Path, default=ROOT / "benchmarks" / "data", metavar="DIR",
                        help="what the steps print (default benchmarks/data)")
    parser.add_argument("--pictures", type=Path, default=ROOT / "docs" / "pictures", metavar="DIR",
                        help="figures (default docs/pictures)")
    parser.add_argument("--fresh", action="store_true", help="run again what has been run")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: shows that all works, times mean nothing")
    asked = parser.parse_args()
    for folder in (asked.work, asked.data, asked.pictures):
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
    written = write(steps, asked.work, asked.data, asked.pictures)
    print(f"written to {asked.data}: {', '.join(written) or 'nothing, since no step has ended well'}")
    return 0 if written and not failed else 1


if __name__ == "__main__":
    sys.exit(main())
