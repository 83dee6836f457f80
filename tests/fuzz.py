"""Damages valid files at random and reads them in child processes (see tests/fuzzing.py): prints counts and findings.

    scripts/fuzz-files [--count N] [--seed S] [--only WORD] [--out DIR] [--kills N]

N mutants of each subject of tests/fuzz_*.py whose name holds WORD; those that are findings are kept in DIR. With --kills, writers
of models and runs of scenes are also killed N times each (see tests/killing.py). The exit status is 1 if there are findings.
"""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from fuzzing import fuzz

ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="mutants of each subject (200)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="subjects whose name holds this")
    parser.add_argument("--out", type=Path, help="where findings are kept (a temporary folder)")
    parser.add_argument("--kills", type=int, default=0, help="kills of a writer and of a run (0)")
    parser.add_argument("--silent", action="store_true", help="list mutants with other content, not only numbers, and no word")
    parser.add_argument("--undetectable", action="store_true", help="list those that a rule explains, for a second reader")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=10.0, help="what takes longer is a hang (10); more on a busy machine")
    options = parser.parse_args()
    out = options.out or Path(tempfile.mkdtemp(prefix="fuzz-files-"))
    total = 0
    for module in sorted(path.stem for path in (ROOT / "tests").glob("fuzz_*.py")):
        valid = out / "valid" / module
        valid.mkdir(parents=True, exist_ok=True)
        subjects = [one for one in importlib.import_module(module).subjects(valid) if options.only in one.name]
        report = fuzz(subjects, options.count, options.seed, out / module, jobs=options.jobs,
                      seconds=options.seconds)
        print("\n".join([str(report), *(report.silent if options.silent else []),
                         *(report.undetectable if options.undetectable else [])]), flush=True)
        total += len(report.findings)
    for what in ("write", "run") if options.kills else ():
        with tempfile.TemporaryDirectory(prefix="fuzz-files-") as folder:
            print(f"killed {what}:", end=" ", flush=True)
            place = str(Path(folder) / "out")
            command = [sys.executable, ROOT / "tests" / "killing.py", what, place, str(options.kills), str(options.seed)]
            total += subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False).returncode != 0
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
