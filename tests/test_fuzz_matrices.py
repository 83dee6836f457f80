"""Damaged matrix files and model folders end in the right content or a FemsubError; `scripts/fuzz-files` does this at length."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import fuzz_matrices
import pytest
from fuzzing import Subject, fuzz

import femsub as fs


@pytest.mark.slow
def test_damaged_matrices_and_models(tmp_path: Path) -> None:
    report = fuzz(fuzz_matrices.subjects(tmp_path / "valid"), count=12, seed=1, folder=tmp_path / "damaged", seconds=30)
    assert not report.findings, str(report)
    endings = {ending for counter in report.counts.values() for ending in counter}
    assert report.total >= 250 and {"refused", "same", "meant"} <= endings


def read_badly(path: Path) -> object:
    """A reader with every fault there is."""
    text = path.read_text(errors="replace")
    if text == "1 2 3\n4 5 6\n":
        return text
    if "x" in text:
        raise KeyError("x")
    if "?" in text:
        import os

        os.abort()
    if "99999999999" in text:
        return bytearray(64 << 30)
    if "4000000000" in text:
        while True:
            pass
    if len(text) < 12:
        return "less"
    raise fs.InputError("refused")


@pytest.mark.slow
def test_the_harness_finds_each_kind_of_fault(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2 3\n4 5 6\n")
    subject = Subject("bad", tmp_path / "a.txt", "test_fuzz_matrices:read_badly")
    report = fuzz([subject], count=90, seed=8, folder=tmp_path / "damaged", seconds=2)
    assert {"raised", "crash", "memory", "hang", "wrong content", "refused"} <= set(report.counts["bad"])
    kept = list((tmp_path / "damaged").glob("bad-*"))
    fine = sum(report.counts["bad"][key] for key in report.counts["bad"] if key.startswith(("refused", "same", "other, ")))
    assert len(kept) == len(report.findings) == report.total - fine


@pytest.mark.parametrize(("what", "count"), [("write", 3), pytest.param("write", 30, marks=pytest.mark.slow),
                                               pytest.param("run", 10, marks=pytest.mark.slow)])
def test_killed_while_it_writes(tmp_path: Path, what: str, count: int) -> None:
    """What is read back is one model or the other, and the next write leaves no hidden file."""
    script = Path(__file__).with_name("killing.py")
    done = subprocess.run([sys.executable, str(script), what, str(tmp_path / "out"), str(count), "1"], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert sum(found.values()) == count and set(found) <= {"model 0", "model 1"}
