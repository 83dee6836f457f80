"""`femsub doctor`, and `import femsub` from the folder above a clone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from femsub.algebra import installed
from femsub.app import cli
from femsub.checks import MissingPackageError

ROOT = Path(__file__).parent.parent


def test_it_prints_versions_packages_kernels_and_memory(capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = cli.main(["doctor"]), capsys.readouterr().out
    for word in ("femsub", "Python", "numpy", "scipy", "PETSc", "SLEPc", "MUMPS", "CHOLMOD", "BLAS", "memory"):
        assert any(line.startswith(word) for line in printed.splitlines()), word
    assert (status == 1) == ("WRONG" in printed)


def test_what_is_wrong_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def missing() -> dict[str, str]:
        raise MissingPackageError("slepc4py is not installed: scripts/setup installs it")

    monkeypatch.setattr("femsub.algebra.petsc.versions", missing)
    monkeypatch.setattr(installed, "available", lambda: 1e8)
    many = {"filepath": "libopenblas.so", "internal_api": "openblas", "version": "0.3.0", "num_threads": 10_000}
    monkeypatch.setattr(installed, "libraries", lambda: SimpleNamespace(info=lambda: [many]))
    assert cli.main(["doctor"]) == 1
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("WRONG")]
    assert len(told) == 3
    for words in ("scripts/setup installs it", "0.1 GB of memory", "10000 threads"):
        assert sum(words in line for line in told) == 1


def test_whatever_breaks_is_told_and_the_rest_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> float:
        raise OSError("no such file")

    monkeypatch.setattr(installed, "available", broken)
    found = installed.examine()
    assert any("OSError: no such file" in line for line in found.wrong) and len(found.lines) > 8


def test_a_wrong_count_of_the_inertia_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "inertia", lambda A: 0)
    assert any("negative eigenvalues is counted as 0" in line for line in installed.examine().wrong)


@pytest.mark.slow
def test_import_from_the_folder_above_a_clone(tmp_path: Path) -> None:
    """There `femsub` names the clone's folder too, which is no package: the one that is on the path is taken."""
    clone = tmp_path / "femsub"
    shutil.copytree(ROOT / "femsub", clone / "femsub", ignore=shutil.ignore_patterns("__pycache__"))
    code = ("import femsub as fs; import femsub.reduction.reduce; from femsub.components.chain import chain; "
            "print(fs.__file__, fs.__version__); assert chain is fs.chain; "
            "assert fs.read_mesh and fs.beam(1.0, 4, E=1.0, I=1.0, rho=1.0, A=1.0).size == 10")
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(clone)}, check=True, capture_output=True,
                           text=True)
    assert found.stdout.startswith(str(clone / "femsub" / "__init__.py"))
