"""Damaged scene files, results and modes end in one line or in a result; `scripts/fuzz-files` does this at length."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzzing import fuzz

pytest.importorskip("plotly", reason="the page of a run needs plotly")


@pytest.mark.slow
def test_damaged_scenes_and_results(tmp_path: Path) -> None:
    import fuzz_runs

    (tmp_path / "valid").mkdir()
    report = fuzz(fuzz_runs.subjects(tmp_path / "valid"), count=12, seed=1, folder=tmp_path / "damaged", seconds=30)
    assert not report.findings, str(report)
    endings = {ending for counter in report.counts.values() for ending in counter}
    assert report.total >= 200 and {"refused", "same", "meant"} <= endings
