"""Damaged files of test benches and of Ansys end in the right content or a refusal; `scripts/fuzz-files` looks longer."""

from __future__ import annotations

from pathlib import Path

import fuzz_ansys
import fuzz_measured
import numpy as np
import pytest
from fuzzing import fuzz

import femsub as fs


@pytest.mark.parametrize("binary", [False, True])
def test_functions_in_text_and_binary(tmp_path: Path, binary: bool) -> None:
    """Accelerations over force, from 1 Hz in steps of 0.5 Hz, of the nodes 2 and 3 to a load at node 5."""
    h = np.random.default_rng(4).standard_normal((2, 16)).view(complex)
    (tmp_path / "a.uff").write_bytes(b"".join(fuzz_measured.function(2 + row, h[row], binary) for row in (0, 1)))
    found, omega = fs.read_response(tmp_path / "a.uff"), 2 * np.pi * (1 + 0.5 * np.arange(8))
    assert found.responses == ("2:uz", "3:uz") and found.loads == ("5:ux",) and found.omega == pytest.approx(omega)
    assert found.receptance[:, :, 0] == pytest.approx(-h.T / omega[:, None] ** 2, rel=1e-9)


@pytest.mark.slow
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
