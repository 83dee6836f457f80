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
