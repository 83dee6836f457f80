"""Damaged mesh files end in the right content or a refusal; `scripts/fuzz-files` looks longer."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("meshio")


@pytest.mark.slow
def test_damaged_mesh_files(tmp_path: Path) -> None:
    from fuzz_meshes import subjects
    from fuzzing import fuzz

    report = fuzz(subjects(tmp_path / "valid"), count=60, seed=1, folder=tmp_path / "damaged")
    assert report.total > 1000 and not report.findings, report
