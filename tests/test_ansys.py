"""Files of Ansys: matrices and modes by PyAnsys' reader, where it is installed; what is said where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzz_ansys import examples

import femsub as fs
from femsub.io.ansys import _axes

BEAM = [1283.20036921, 1283.20036921, 5781.97486169, 6919.39887714]  # Hz, in the examples.py of the reader


@pytest.fixture
def folder() -> Path:
    found = examples()
    if found is None:
        pytest.skip("ansys-mapdl-reader is not installed")
    return found


def test_a_full_file_has_the_frequencies_of_pyansys(tmp_path: Path, folder: Path) -> None:
    """The beam in the reader's examples. A damaged file ends no process of ours."""
    beam = fs.read_component(folder / "file.full", interface=["200:*"])
    assert (beam.size, len(beam.interface)) == (900, 3)  # 963 with those that are held
    assert fs.normal_modes(beam, count=4).frequencies / (2 * np.pi) == pytest.approx(BEAM, rel=1e-11)
    content = (folder / "file.full").read_bytes()
    for data, message in ((content[:600_000], "announces 801596 bytes, but has 600000"), (b"", "is no .full file of Ansys"),
                          ((folder / "file.rst").read_bytes(), "is no .full file of Ansys"),
                          (content[:412] + b"\xff" * 1000 + content[1412:], "cannot be read")):
        (tmp_path / "cut.full").write_bytes(data)
        with pytest.raises(fs.InputError, match=message):
            fs.read_component(tmp_path / "cut.full")


def test_modes_of_a_result_file(tmp_path: Path, folder: Path) -> None:
    """The beam of the example, free: its frequencies as the reader prints them, its shapes orthogonal to the rigid motions."""
    found = fs.read_modes(folder / "file.rst")
    assert repr(found) == "ModeSet: 6 modes at 963 DOF, ω 46285 to 1.2653e+05 rad/time"
    assert found.frequencies[:4] / (2 * np.pi) == pytest.approx([7366.49503969, 7366.49503969, 11504.89523664, 17285.70459456])
    with pytest.raises(fs.InputError, match=r"is no \.rst file of Ansys"):
        (tmp_path / "a.rst").write_bytes((folder / "file.full").read_bytes())
        fs.read_modes(tmp_path / "a.rst")


def test_frames_of_nodes() -> None:
    """Turned about z, then about their own x, then about their own y (command N of Ansys)."""
    axes = _axes(np.array([[90.0, 0.0, 0.0], [0.0, 90.0, 0.0], [0.0, 0.0, 90.0], [90.0, 90.0, 0.0]]))
    x, y, z = np.eye(3)
    for found, columns in zip(axes, ([y, -x, z], [x, z, -y], [-z, y, x], [y, z, x]), strict=True):
        assert found == pytest.approx(np.array(columns).T, abs=1e-15)


def test_files_of_ansys_need_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.io.ansys.find_spec", lambda name: None)
    for name, read in (("a.full", lambda path: fs.read_matrix(path, "K")), ("a.rst", fs.read_modes)):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(fs.MissingPackageError, match="pip install ansys-mapdl-reader"):
            read(tmp_path / name)
