"""Which tests run when: all but the slow ones, unless they are asked for."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A repository of two tests, one of them slow, with this one's settings."""
    root = tmp_path_factory.mktemp("suite")
    (root / "tests").mkdir()
    shutil.copy(ROOT / "pyproject.toml", root)
    shutil.copy(ROOT / "tests" / "conftest.py", root / "tests")
    (root / "tests" / "test_two.py").write_text(
        "import pytest\n\ndef test_quick():\n    pass\n\n@pytest.mark.slow\ndef test_slow():\n    pass\n")
    return root


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("args", "ran"), [
    ((), ("test_quick",)),
    (("tests",), ("test_quick",)),
    (("-m", "slow"), ("test_slow",)),
    (("--slow",), ("test_quick", "test_slow")),
    (("tests/test_two.py",), ("test_quick", "test_slow")),
    (("tests/test_two.py::test_slow",), ("test_slow",)),
    (("tests/test_two.py", "-m", "not slow"), ("test_quick",)),
    (("-k", "slow"), ("test_slow",)),
], ids=" ".join)
def test_slow_tests_run_when_they_are_asked_for(suite: Path, args: tuple[str, ...], ran: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider", *args], cwd=suite,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert set(re.findall(r"::(\w+)$", done.stdout, re.MULTILINE)) == {*ran}, done.stdout
