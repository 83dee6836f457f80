"""Damaged matrix files and model folders end in the right content or a FemsubError; `scripts/fuzz-files` does this at length."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import fuzz_matrices
import pytest
from fuzzing import Subject, fuzz, only_numbers

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
    sound = ("refused", "same", "other, ", "undetectable", "silent")
    fine = sum(count for key, count in report.counts["bad"].items() if key.startswith(sound))
    assert len(kept) == len(report.findings) == report.total - fine


def read_around(path: Path) -> object:
    """Content that depends on where the file is, and a real number."""
    words = [*path.read_text(errors="replace").split(), "0", "0"]
    try:
        return {"where": path.parent.parent.name, "number": float(words[0]), "index": int(words[1])}
    except ValueError:
        raise fs.InputError(f"{words}") from None


def test_the_harness_sorts_other_content(tmp_path: Path) -> None:
    """Only a real number that became another one is undetectable; where the copies are read makes no difference."""
    (tmp_path / "a.txt").write_text("1.5 2\n")
    report = fuzz([Subject("plain", tmp_path / "a.txt", "test_fuzz_matrices:read_around", strict=frozenset())], count=60, seed=2,
                  folder=tmp_path / "damaged")
    assert report.counts["plain"]["undetectable (value)"] and report.counts["plain"]["same"] and report.silent
    assert only_numbers(b"a 1.5 2", b"a 7 2") and not only_numbers(b"a 1.5", b"b 1.5") and not only_numbers(b"1 x", b"1 1 x")
    assert only_numbers(b"\0" * 9, b"\0" + b"\1" * 8) and not only_numbers(b"\0" * 9, b"\1" * 9)


@pytest.mark.parametrize(("what", "count"), [("write", 3), pytest.param("write", 12, marks=pytest.mark.slow),
                                               pytest.param("run", 5, marks=pytest.mark.slow)])
def test_killed_while_it_writes(tmp_path: Path, what: str, count: int) -> None:
    """What is read back is one model or the other, and the next write leaves no hidden file."""
    script = Path(__file__).with_name("killing.py")
    done = subprocess.run([sys.executable, str(script), what, str(tmp_path / "out"), str(count), "1"], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert sum(found.values()) == count and set(found) <= {"model 0", "model 1"}
