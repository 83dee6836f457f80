"""The scripts and benchmarks, which are not part of the package, on their smallest cases."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import femsub as fs
from benchmarks import over_a_range
from benchmarks.__main__ import COMMANDS, main
from benchmarks.attack import SUBJECTS
from benchmarks.attacks import boxes
from benchmarks.attacks.common import misfit, row_of_springs
from benchmarks.bases import NAMES, compared, measured_before, rows_of
from benchmarks.processes import StoppedError, Worker, together_mb
from femsub.model import in_band
from femsub.modes.quadratic.region import Contour

ROOT = Path(__file__).parent.parent


def run(*args: object) -> subprocess.CompletedProcess[str]:
    """A command of benchmarks/. What it starts takes this interpreter, and sets none up."""
    return subprocess.run([sys.executable, "-m", "benchmarks", *map(str, args)], cwd=ROOT, capture_output=True, text=True,
                          check=False, env=os.environ | {"FEMSUB_PYTHON": sys.executable})


@pytest.mark.parametrize("name", ["", "--help", "no-such-command"])
def test_the_commands_are_listed(name: str) -> None:
    done = run(*[name] if name else [])
    assert done.returncode == (2 if name == "no-such-command" else 0)
    listed = re.findall(r"^  ([a-z-]+)  +\S", done.stdout + done.stderr, re.MULTILINE)
    assert listed == sorted(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_each_command_has_help(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmarks", name, "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0 and capsys.readouterr().out.startswith(f"usage: python -m benchmarks {name}")


@pytest.mark.slow
def test_an_attack_runs_and_names_its_kinds(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # else the attack sets it, for all later tests
    monkeypatch.setattr(sys, "argv", ["benchmarks", "attack", "bars", "--cases", "3"])
    assert main() == 0
    printed = capsys.readouterr()
    assert "bars: 3 cases, 0 wrong" in printed.out, printed.out + printed.err
    monkeypatch.setattr(sys, "argv", ["benchmarks", "attack", "bars", "--kind", "none"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2 and "bars has " in capsys.readouterr().err


#: seeds of the attack on boxes: small families, as one of 400 DOF takes as long as these, and what it has found, from 32015 on
SMALL = {"light": (4,), "strong": (10,), "negative": (6,), "gyroscopic": (32015,), "circulatory": (33083, 34115),
         "mixed": (32017,)}


@pytest.mark.slow
@pytest.mark.parametrize("subject", ["cycles", "unheld", "audits", "cutoff", "counts", "boxes"])
def test_attacks_that_no_other_test_asks_find_nothing(subject: str) -> None:
    """One or two seeds of each kind; `python -m benchmarks attack SUBJECT` runs thousands."""
    kinds, attacked = SUBJECTS[subject]
    seeds = SMALL if subject == "boxes" else dict.fromkeys(kinds, range(2))
    assert not [found for kind in kinds for seed in seeds[kind] if (found := attacked(kind, seed)).startswith("wrong")]


@dataclass
class Faulty:
    """A model over a box that is the full one, with a fault where the λ, their radii or their number are given."""

    full: fs.Affine
    box: Any
    fault: str

    @property
    def cells(self) -> tuple[Any, ...]:
        hi = self.box.band[1]
        contour = Contour(sides=(-1.02 * hi, 1.01 * hi, 1.03 * hi))
        return (SimpleNamespace(holds=lambda point: True, contour=contour, number=self.counted, evidence="certified"),)

    def modes(self, **point: float) -> Any:
        exact = boxes.spectrum(self.full, point)
        found, hi = exact[in_band(exact, self.box.band, (-self.box.band[1], self.box.band[1]))], self.box.band[1]
        self.counted = int(np.count_nonzero(Contour(sides=(-1.02 * hi, 1.01 * hi, 1.03 * hi)).encloses(exact)))
        self.counted += 2 * (self.fault == "number")
        radius = np.full(len(found), 1e-6 * hi)
        found = found + radius * (2.0 if self.fault == "radius" else 0.5)
        found = found[1:] if self.fault == "missing" else found
        radius = radius[:len(found)]
        growth = np.stack([found.real - radius, found.real + radius], axis=1)
        stable = [None if low <= 0 <= high else bool(high < 0) for low, high in growth]
        verdict = False if False in stable else None if None in stable else True
        return SimpleNamespace(eigenvalues=found, error_bar=radius, full_growth=growth + 3e-6 * hi * (self.fault == "growth"),
                               stable=stable, is_stable=not verdict if self.fault == "verdict" else verdict)


@pytest.mark.parametrize(("fault", "said"), [
    ("", ""), ("radius", "is missing"), ("missing", "is missing"), ("growth", "that grows by"), ("verdict", "stable with"),
    ("number", "in the contour")])
def test_the_judge_of_models_over_a_box_sees_each_fault(fault: str, said: str) -> None:
    """`python -m benchmarks attack boxes`, without the reduction."""
    for seed in (6, 9, 10):  # of 64 to 88 DOF: two stable families, one that flutters
        full, ranges, band = boxes.family("circulatory", np.random.default_rng(seed))
        small = Faulty(full, SimpleNamespace(ranges=ranges, band=band, region=(-band[1], band[1], *band)), fault)
        point = boxes.at_random(ranges, np.random.default_rng(seed))
        found, counts, ratio = boxes.judged(full, small, point, boxes.spectrum(full, point))
        assert (bool(counts), bool(found)) == (fault == "number", fault not in ("", "number"))
        assert all(said in text for text in (found + counts)[:1]) and (fault or 0.4 < ratio[0] < 0.6)


BRAKE = ROOT.parent / "shared" / "brake-m0"


@pytest.mark.rare
@pytest.mark.skipif(not BRAKE.is_dir(), reason=f"the matrices of a brake are not in {BRAKE}")
def test_other_bases_of_the_public_brake_miss_what_grows_or_need_more_columns() -> None:
    """Of three speeds; docs/methods/over_a_range.md."""
    family = over_a_range.brake(BRAKE)
    speed = 4 * np.pi
    exact = fs.complex_modes(family.at(speed=speed), band=over_a_range.BAND).eigenvalues
    made = over_a_range.bases(family)
    errors = []
    for _ in range(3):
        _, _, V = next(made)
        found = boxes.spectrum(family.reduced(V, cutoff=np.inf), {"speed": speed})
        error = np.abs(found - exact[:, None]).min(axis=1) / np.abs(exact)
        errors.append((error[exact.real > over_a_range.NEAR].max(), error.max()))
    (near, all_of_near), (_, paper), (_, more) = errors
    assert near < 1e-6 < 1e-2 < all_of_near and paper > 1e-2 and 1e-8 < more < 1e-5


def scaling(folder: Path, *args: str) -> dict[str, Any]:
    done = run("scaling", *args, "--out", folder)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.name for path in folder.iterdir()} == {"scaling.csv", "scaling.json", "scaling.png", "numbers.json"}
    report = json.loads((folder / "scaling.json").read_text())
    assert all(row["seconds"] > 0 and row["peak_mb"] > 0 for row in report["rows"])
    return report


@pytest.mark.slow
def test_scaling_of_the_chain(tmp_path: Path) -> None:
    rows = {row["step"]: row for row in scaling(tmp_path, "--components", "chain", "--largest", "10")["rows"]}
    assert list(rows) == ["assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC"]
    assert all(row["n"] == row["dof"] == 10 and row["component"] == "chain" for row in rows.values())
    assert all(rows[step]["stable"] == "yes" for step in ("CEA full", "CEA HCB", "CEA CC"))


@pytest.mark.rare
def test_scaling_of_finite_elements(tmp_path: Path) -> None:
    args = ("--components", "beam", "plate", "solid", "--largest", "100", "--steps", "CC")
    rows = {(row["component"], row["dof"]): row for row in scaling(tmp_path, *args)["rows"]}
    assert set(rows) == {("beam", 10), ("beam", 100), ("plate", 80), ("solid", 990)}


def bench(folder: Path, *args: str) -> list[dict[str, Any]]:
    done = run("bases", "--quick", "--repeats", 1, "--out", folder, *args)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.name for path in folder.iterdir()} == {"bases.csv", "bases.json", "measured.jsonl", "reference"}
    report: dict[str, Any] = json.loads((folder / "bases.json").read_text())
    assert not report["failed"]
    rows: list[dict[str, Any]] = report["rows"]
    return rows


OTHERS = "SciPy", "SLEPc, CHOLMOD", "SLEPc, MUMPS"  # what is compared with wherever femsub runs


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, list[Any]]]:
    """The folder and the rows of a component's bases by every method."""
    @cache
    def found(component: str) -> tuple[Path, list[Any]]:
        folder = tmp_path_factory.mktemp(component)
        return folder, bench(folder, "--component", component)

    return found


@pytest.mark.rare
@pytest.mark.cholmod
def test_bases_agree_with_those_of_others(bases: Callable[[str], tuple[Path, list[Any]]]) -> None:
    rows = {row["method"]: row for row in bases("slab")[1]}
    assert {"femsub", *OTHERS} <= set(rows)
    assert all(row["seconds"] > 0 and row["times"] > 0 and row["peak_mb"] > 0 for row in rows.values())
    for method in OTHERS:
        assert all(0 < rows[method][f"error_{part}"] < 1e-8 for part in ("values", "constraint", "M", "K"))
        assert rows[method]["residual"] < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("component", ["slab", "bulk"])
def test_bases_of_all_methods_agree_and_a_bench_goes_on_where_it_stopped(
        component: str, bases: Callable[[str], tuple[Path, list[Any]]], tmp_path: Path) -> None:
    folder, measured = bases(component)
    rows = {row["method"]: row for row in measured}
    assert {"femsub", "SciPy", "SLEPc, MUMPS"} <= set(rows) <= set(NAMES)
    for row in rows.values():
        assert row["component"] == component and row["interface"] == 18 and row["reference"] == "femsub" and not row["ended"]
        assert row["error"] < 1e-9 and row["missed"] == 0 and row["residual"] < 1e-9
    if component != "slab":
        return  # how a bench goes on is the same for all
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    journal = tmp_path / "measured.jsonl"
    lines = [line for line in journal.read_text().splitlines() if line]
    assert len(lines) == len(rows)
    journal.write_text("\n".join([*lines[:-1], lines[-1][:40]]))  # killed while it wrote the last line
    again = {row["method"]: row for row in bench(tmp_path, "--component", component)}
    method = json.loads(lines[-1])["method"]
    assert {name for name, row in rows.items() if row["seconds"] != again[name]["seconds"]} == {method}


def test_a_measurement_that_takes_too_long_is_reported(tmp_path: Path) -> None:
    row = {"component": "slab", "modes": 3, "method": "SciPy", "round": 0, "ended": "longer than 0.1 s"}
    (tmp_path / "measured.jsonl").write_text(f"\n{json.dumps(row)}\n", encoding="utf-8")
    (found,) = rows_of(measured_before(tmp_path / "measured.jsonl"))
    assert found["method"] == "SciPy" and found["ended"] == "longer than 0.1 s" and not found["runs"]


def test_a_worker_is_replaced_when_it_crashes_or_hangs() -> None:
    worker = Worker()
    with pytest.raises(StoppedError, match="its process crashed"):
        worker(os._exit, 1)
    with pytest.raises(StoppedError, match=re.escape("longer than 0.5 s")):
        worker(time.sleep, 30.0, limit=0.5)
    assert worker(abs, -1) == 1
    worker.close()


def test_springs_and_the_pairing_with_bars_that_attacks_share() -> None:
    springs = np.array([2.0, 3.0, 5.0, 0.0])
    assert np.array_equal(row_of_springs(springs), fs.chain(3, springs=springs[:3], damping=0.0).K.toarray())
    found, bars = np.array([1.0, 1.0 + 1e-9, 2j]), np.array([1e-12, 1e-8, np.inf])
    assert not misfit(found, bars, [1.0, 1.0, 7.0])
    assert "λ = 1+0j, exactly 1+0j, bar 1.0e-12" in misfit(found, bars, [1.0 + 1e-8, 1.0 + 1e-9, 7.0])


@pytest.mark.skipif(not all(Path("/proc/self", name).exists() for name in ("smaps_rollup", f"task/{os.getpid()}/children")),
                    reason="the memory of other processes is told by Linux")
def test_what_a_fork_shares_is_counted_once() -> None:
    """Both touch 100 MB of one array, the fork alone 50 MB of its own."""
    script = ("import os, time; held = bytearray(b'x') * 10**8; fork = os.fork() == 0; "
              "own = bytearray(b'x') * (fork * 5 * 10**7); sum(held[::4096]); print('ready', flush=True); time.sleep(60)")
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, process_group=0) as process:
        try:
            assert process.stdout is not None
            assert [process.stdout.readline() for _ in range(2)] == ["ready\n"] * 2
            assert 150 < together_mb(process.pid) < 190
        finally:
            os.killpg(process.pid, signal.SIGKILL)
    assert together_mb(process.pid) == 0


def test_missed_modes_are_counted() -> None:
    certified = np.array([1.0, 2.0, 2.001, 3.0])
    assert compared(certified, certified) == (0.0, 0)
    assert compared(certified, [1.0, 2.001, 3.0, 4.0]) == (pytest.approx(0.0), 1)  # the lower of two that lie close together
    error, missed = compared(certified, 1.003 * certified)
    assert error == pytest.approx(3e-3, rel=0.2) and missed == 0
    assert compared(certified, [1.0, 2.0]) == (0.0, 2)
    assert compared(certified, 1.02 * certified)[1] == 4


def report(folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    return run("report", "--work", folder / "work", "--data", folder / "data", "--pictures", folder / "pictures",
               *args)


@pytest.mark.rare
def test_a_report_goes_on_where_it_stopped(tmp_path: Path) -> None:
    first = report(tmp_path, "chain")
    assert first.returncode == 0, first.stdout + first.stderr
    text = (tmp_path / "data" / "chain.txt").read_text()
    assert "femsub run -v chain" in text and " s, commit " in text and "* Craig-Chang" in text
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["chain.txt"]
    assert (tmp_path / "pictures" / "chain-error-time.png").exists()
    # what was run and stopped half-way has no done.json: it is begun anew, and what had ended is left alone
    kept = (tmp_path / "work" / "chain" / "done.json").stat().st_mtime_ns
    half = tmp_path / "work" / "method-pictures"
    half.mkdir()
    (half / "printed.txt").write_text("half a table")
    second = report(tmp_path, "chain", "method-pictures")
    assert second.returncode == 0, second.stdout + second.stderr
    assert "chain: done before" in second.stdout and "method-pictures: done\n" in second.stdout
    assert (tmp_path / "work" / "chain" / "done.json").stat().st_mtime_ns == kept
    assert "half a table" not in (half / "printed.txt").read_text()
    assert (tmp_path / "pictures" / "methods" / "guyan.png").exists()


def test_what_a_change_must_pass_runs_without_the_variables_of_a_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script, told = tmp_path / ".ci" / "run", tmp_path / "told"
    for path in (script, *(tmp_path / name for name in ("scripts/test", "scripts/setup", "scripts/docs", ".venv/bin/python"))):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/usr/bin/env bash\nenv >>{told}\n")
        path.chmod(0o755)
    script.write_bytes((ROOT / ".ci" / "run").read_bytes())
    for name in ("PYTHONDONTWRITEBYTECODE", "OPENBLAS_CORETYPE", "PIP_FIND_LINKS"):
        monkeypatch.setenv(name, "1")
    subprocess.run([str(script)], capture_output=True, check=True)
    own = {"PWD", "SHLVL", "_"}  # of bash itself
    given = {line for line in told.read_text().splitlines() if line.partition("=")[0] not in own}
    assert {line.partition("=")[0] for line in given if line != "OPENBLAS_CORETYPE=Prescott"} == {"PATH", "HOME", "LANG"}


def test_the_set_up_leaves_an_environment_of_another_folder_alone(tmp_path: Path) -> None:
    """A linked .venv was emptied, that of another clone."""
    mine, others = tmp_path / "mine", tmp_path / "others"
    for folder in (mine / "scripts", others / ".setup"):
        folder.mkdir(parents=True)
    for name in ("pyproject.toml", "scripts/setup", "scripts/setup-common.bash"):
        shutil.copy(ROOT / name, mine / name)
    for name, text in (("pyvenv.cfg", "home = /usr/bin"), (".setup/root", str(others))):
        (others / name).write_text(text, encoding="utf-8")
    (mine / ".venv").symlink_to(others)
    done = subprocess.run([mine / "scripts" / "setup"], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and f".venv is a link to {others}" in done.stderr, done.stderr
    assert (others / "pyvenv.cfg").exists() and (others / ".setup" / "root").exists() and (mine / ".venv").is_symlink()


def test_programs_that_import_petsc_do_not_hold_the_lock_of_the_set_up(tmp_path: Path) -> None:
    """Open MPI starts a daemon for them, which may outlive the set-up."""
    (tmp_path / "scripts").mkdir()
    for name in ("pyproject.toml", "scripts/setup-common.bash"):
        shutil.copy(ROOT / name, tmp_path / name)
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\n[ -e /proc/self/fd/9 ] && echo held || echo free\n")
    python.chmod(0o755)
    script = ". scripts/setup-common.bash dev; lock; solvers_numpy; run failed solvers_numpy; tail -n 1 $log; $python"
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["free", "free", "held"]


def test_the_readmes_test_command_is_what_a_change_must_pass() -> None:
    command = "scripts/test"
    assert f"\n{command}\n" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"\nstep {command}\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.parametrize(("given", "passed"), [
    ([], "-m pytest -n 2 --dist loadfile"), (["-q", "tests/test_x.py"], "-m pytest -q tests/test_x.py")])
def test_all_tests_run_in_two_processes_and_named_ones_as_asked(given: list[str], passed: str, tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\necho "$@"\n')
    python.chmod(0o755)
    done = subprocess.run([str(ROOT / "scripts" / "test"), *given], env={**os.environ, "FEMSUB_PYTHON": str(python)},
                          capture_output=True, text=True, check=True)
    assert done.stdout.split() == passed.split()
