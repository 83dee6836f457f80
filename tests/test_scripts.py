"""The scripts that are not part of the package, on their smallest case."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_scaling(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "scaling.py"), "--largest", "10", "--repeats", "1", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"scaling.csv", "scaling.json", "scaling.png"}
    report = json.loads((tmp_path / "scaling.json").read_text())
    assert {row["step"] for row in report["rows"]} == {"assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC"}
    assert all(row["seconds"] > 0 and row["peak_mb"] > 0 for row in report["rows"])


def test_bench(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "bench.py"), "--quick", "--repeats", "1", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"bench.csv", "bench.json"}
    report = json.loads((tmp_path / "bench.json").read_text())
    assert not report["failed"]
    rows = {(row["part"], row["method"]): row for row in report["rows"]}
    assert {method for part, method in rows if part == "assembly"} == {"femsub", "scikit-fem"}
    assert {method for part, method in rows if part == "bases"} == {"femsub", "SciPy", "SLEPc, CHOLMOD", "SLEPc, MUMPS"}
    assert len([method for part, method in rows if part == "cea"]) == 2
    for row in rows.values():
        assert row["seconds"] > 0 and row["times"] > 0 and row["peak_mb"] > 0
    assert 0 < rows["assembly", "scikit-fem"]["error"] < 1e-12
    for method in ("SciPy", "SLEPc, CHOLMOD", "SLEPc, MUMPS"):
        assert all(0 < rows["bases", method][f"error_{part}"] < 1e-8 for part in ("values", "constraint", "M", "K"))
        assert rows["bases", method]["residual"] < 1e-10
    assert report["details"]["cea"]["chosen"]["growth_error"] < 1e-3
    agreements = [check for check in report["checks"] if not check["timed"]]
    assert len(agreements) == 8 and all(check["met"] for check in agreements)
    assert all(check["met"] is None for check in report["checks"] if check["timed"])  # such sizes say nothing of times
