"""All pictures and tables of the docs: data and figures of scenes, benchmarks, scaling and extreme cases, and of the pages.

    python -m benchmarks report [NAME ...] [--list] [--work DIR] [--data DIR] [--pictures DIR] [--fresh]

Each step is a command of its own, run in a process of its own, one after the other; --list shows their names. What it prints is
kept in WORK/NAME/printed.txt, its results beside it. A step that has ended well is not run again: a report that stopped goes on
where it was, and --fresh repeats what is named. DATA/NAME.txt holds what a step has printed, below its command, its seconds, the
commit and the machine. PICTURES gets its figures, and PICTURES/data.json for each of them the step, the commit and the numbers
that are drawn: tests/test_pictures.py compares them with a run of that day. The pages with the conclusions are written by hand.
Two pictures were made by what is in the history: that of a run's page, report.png, by benchmarks/page_picture.py (commit
e0d65ca), and methods.png by benchmarks/compare_methods.py (commit ace8ad5). Those of docs/tutorials/ are drawn by their pages:
`python -m benchmarks pages PAGE --write`.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import UsageError
from benchmarks.pictures import NUMBERS, PICTURES, commit, plain, shown, store
from benchmarks.processes import begin, put
from femsub.algebra import machine, petsc
from femsub.app import report
from femsub.app.grammar import built_in

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Step:
    """One command: {out} in it stands for the step's folder, {work} for that of all steps."""

    name: str
    says: str
    command: str  #: of `python -m benchmarks`, or `femsub run ...`
    figures: tuple[str, ...] = ()  #: of the files that it leaves
    folder: str = ""  #: of the pictures, for a step that leaves many, all of which are taken
    table: bool = True  #: whether what it prints is kept

    def words(self, **places: Path) -> list[str]:
        """The command line. For the small dense models of scenes the BLAS of NumPy, SciPy and PETSc get one thread each: they
        would wait for each other's core up to ten times as long as the work takes.
        """
        words = [word.format(**places) for word in self.command.split()]
        if words[0] == "femsub":
            return ["env", "OMP_NUM_THREADS=1", str(ROOT / "scripts" / "femsub"), *words[1:], "--out", str(places["out"])]
        return [sys.executable, "-m", "benchmarks", *words]


def scene(name: str, says: str, *figures: str) -> Step:
    return Step(Path(name).stem, says, f"femsub run -v {name}", figures)


STEPS = (
    scene("chain", "The paper's chain. Ten masses on a belt: critical slopes, and error against run time.",
          "error-time", "friction-law", "growth", "size-sweep", "eigenvalues"),
    scene("beam", "Beam. A steel beam on a belt, 400 DOF.", "compare"),
    scene("plate", "Plate. A thin plate, 3,200 DOF.", "compare"),
    scene("solid", "Solid. A brake's disc, 7,920 DOF.", "compare"),
    scene("scripts/long-chain.toml", "A chain of 100,000 masses. Beyond its border of stability."),
    scene("scripts/disc-transient.toml", "A disc in time. 10,800 DOF: what a simulated period costs, full and reduced."),
    scene("brake", "A brake. Disc and two pads with friction between them: full and reduced.", "flutter", "compare"),
    Step("bases", "Bases of a slab. Ratios against SciPy and plain SLEPc, each in one run.", "bases --repeats 1 --out {out}"),
    Step("bases-bulk", "Bases of a bulky solid. Quadratic hexahedra, where factors are dense.",
         "bases --component bulk --repeats 1 --out {out}"),
    Step("users", "What users have today. Time and memory over femsub's, from benchmarks/data/users.json.",
         "users-picture --out {out}", ("users", "readme"), table=False),
    Step("scaling-chain", "Size: the chain. Seconds, memory and error from 10 masses to a million.",
         "scaling --components chain --repeats 5 --out {out}"),
    Step("scaling", "Size: finite elements. The same for a beam, a plate to 300,000 DOF and a solid to a million.",
         "scaling --components beam plate solid --out {out}", ("scaling",)),
    Step("extreme", "Stiff and extreme cases. Each right within the bound that is stated for it, or refused with the reason.",
         "extreme --out {out}"),
    Step("method-pictures", "What each method keeps. The shapes of its basis, for the pages of the methods.",
         "method-pictures --out {out}", folder="methods", table=False),
    *(Step(f"gallery-{name}", f"The gallery: {name}. {line}", f"gallery --run {name}", table=False)
      for name, line in built_in().items()),
)


def run(step: Step, folder: Path) -> str:
    """Runs a step and records its success, or returns the failure.

    The files of a stopped step are kept, since some scripts continue from them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = step.words(out=folder, work=folder.parent)
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
        return (f"{step.name} ended with status {process.returncode}: {errors.strip()[-500:]}\n"
                f"  {shlex.join(command)}\n  what it printed is in {folder / 'printed.txt'}")
    shown = shlex.join([part.replace(sys.executable, "python").replace(str(folder), "out").replace(f"{ROOT}/", "")
                        for part in command])
    done = {"command": shown, "commit": commit(), "seconds": time.perf_counter() - start, "date": time.strftime("%Y-%m-%d"),
            "machine": machine() | report.versions() | petsc.versions(), "warnings": errors.strip().splitlines()}
    put(folder, {"done.json": json.dumps(done, indent=1)})
    return ""


def text(step: Step, folder: Path) -> str:
    """The printed output of a step, below a head with its command, seconds, commit and machine."""
    done = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    printed = (folder / "printed.txt").read_text(encoding="utf-8").rstrip()
    table = "\n".join(line.rstrip() for line in printed.partition("\nwritten to ")[0].splitlines()).rstrip()
    machine = ", ".join(f"{key} {value}" for key, value in done["machine"].items())
    return (f"# {step.says}\n# {done['command']}\n# {done['seconds']:.0f} s, commit {done['commit']}, "
            f"{done['date']}; {machine}\n\n{table}\n")


def pictures_of(step: Step, folder: Path) -> dict[str, Path]:
    """The files of a step's figures, by their places in the folder of pictures."""
    if step.folder:
        return {f"{step.folder}/{path.name}": path for path in sorted(folder.glob("*.png"))}
    return {f"{step.name}.png" if stem in step.name else f"{step.name}-{stem}.png": folder / f"{stem}.png"
            for stem in step.figures if (folder / f"{stem}.png").exists()}


def numbers(step: Step, folder: Path) -> dict[str, dict[str, Any]]:
    """What each picture of a step shows, with the step and the commit, by its place."""
    done = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    noted = folder / NUMBERS
    told = json.loads(noted.read_text(encoding="utf-8")) if noted.exists() else {}
    places = [path for path in (folder / "results.json", folder / f"{step.name}.json") if path.exists()]
    results = json.loads(places[0].read_text(encoding="utf-8")) if places else {}
    found = {}
    for place, path in pictures_of(step, folder).items():
        rows = told[path.name] if path.name in told else shown(results, path.stem) or plain(results.get("summary"))
        found[place] = {"step": step.name, "commit": done["commit"], "date": done["date"], "shows": rows}
    return found


def write(steps: Sequence[Step], work: Path, data: Path, pictures: Path) -> list[str]:
    """The texts and figures of the steps that have ended well, each folder whole or not at all; their names."""
    ended = [step for step in steps if (work / step.name / "done.json").exists()]
    put(data, {f"{step.name}.txt": text(step, work / step.name) for step in ended if step.table})
    store(pictures, {place: path.read_bytes() for step in ended for place, path in pictures_of(step, work / step.name).items()},
          {place: one for step in ended for place, one in numbers(step, work / step.name).items()})
    return [step.name for step in ended]


def main(steps: tuple[str, ...] = (), *, list: bool = False, work: Path = ROOT / "out" / "report",
         data: Path = ROOT / "benchmarks" / "data", pictures: Path = PICTURES, fresh: bool = False
         ) -> int:
    if list:
        print(*(f"{step.name:22} {step.says}" for step in STEPS), sep="\n")
        return 0
    if strange := set(steps) - {step.name for step in STEPS}:
        raise UsageError(f"unknown: {', '.join(sorted(strange))}; there are {', '.join(step.name for step in STEPS)}")
    begin(work, data, pictures)
    failed = []
    for step in STEPS:
        folder = work.resolve() / step.name
        if steps and step.name not in steps:
            continue
        if (folder / "done.json").exists() and not fresh:
            print(f"{step.name}: done before")
            continue
        if fresh:
            shutil.rmtree(folder, ignore_errors=True)
        fault = run(step, folder)
        failed += [fault] * bool(fault)
        print(f"failed: {fault}" if fault else f"{step.name}: done", file=sys.stderr if fault else sys.stdout)
    report.progress_done()
    written = write(STEPS, work, data, pictures)
    print(f"written to {data}: {', '.join(written) or 'nothing, since no step has ended well'}")
    return 0 if written and not failed else 1
