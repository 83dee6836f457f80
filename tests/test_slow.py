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
        "import pytest\n\ndef test_quick():\n    pass\n\n@pytest.mark.slow\ndef test_slow():\n    pass\n\n"
        "@pytest.mark.sampled(3, 2)\n@pytest.mark.parametrize('at', range(7))\ndef test_of(at):\n    pass\n\n"
        "@pytest.mark.sampled(3, 9)\n@pytest.mark.parametrize('b', 'xyz')\n@pytest.mark.parametrize('a', 'uvw')\n"
        "def test_pair(a, b):\n    pass\n")
    return root


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("args", "ran"), [
    ((), "quick 0 3 6"),
    (("tests",), "quick 0 3 6"),
    (("-m", "slow"), "slow 2 5"),
    (("--slow",), "quick slow 0 2 3 5 6"),
    (("tests/test_two.py",), "quick slow 0 1 2 3 4 5 6"),
    (("tests/test_two.py::test_slow",), "slow"),
    (("tests/test_two.py", "-m", "not slow"), "quick 0 3 6"),
    (("-k", "slow"), "slow 2 5"),
    (("--every",), "quick slow 0 1 2 3 4 5 6"),
    (("-m", "rare"), "1 4"),
], ids=lambda words: words if isinstance(words, str) else " ".join(words))
def test_slow_tests_run_when_they_are_asked_for(suite: Path, args: tuple[str, ...], ran: str) -> None:
    done = subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider", *args], cwd=suite,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = re.findall(r"::test_(?:of\[)?(\w+)\]?$", done.stdout, re.MULTILINE)
    assert set(found) == set(ran.split()), done.stdout
    if args in [("--slow",), ("--every",)]:  # each value of each parameter is in a case that is not rare
        pairs = re.findall(r"::test_pair\[(\w)-(\w)\]$", done.stdout, re.MULTILINE)
        assert {*"".join(map("".join, pairs))} == {*"uvwxyz"} and (len(pairs) < 9) == (args == ("--slow",))
