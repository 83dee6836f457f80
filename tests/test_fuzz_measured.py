"""Damaged files of test benches and of Ansys end in the right content or a refusal; `scripts/fuzz-files` looks longer."""

from __future__ import annotations

from pathlib import Path

import fuzz_ansys
import fuzz_measured
import pytest
from fuzzing import fuzz


def test_damaged_universal_files(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    report = fuzz(fuzz_measured.subjects(tmp_path / "valid"), count=20, seed=1, folder=tmp_path / "damaged")
    assert report.total == 100 and not report.findings, report


@pytest.mark.slow
def test_damaged_files_of_ansys(tmp_path: Path) -> None:
    subjects = fuzz_ansys.subjects(tmp_path / "valid")
    if not subjects:
        pytest.skip("ansys-mapdl-reader is not installed")
    report = fuzz(subjects, count=6, seed=1, folder=tmp_path / "damaged", seconds=30)
    assert report.total >= 12 and not report.findings, report
