"""Files that others read for us: cut anywhere, they end in a refusal, and hold what their headers promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import femsub as fs

meshio = pytest.importorskip("meshio")

BRICKS = fs.block((2, 1, 1), (2, 1, 1), "hexahedron")


def written(path: Path, form: str, mesh: fs.Mesh = BRICKS, **options: object) -> bytes:
    meshio.write(path, meshio.Mesh(mesh.points, [(mesh.kind, mesh.cells)]), file_format=form, **options)
    return path.read_bytes()


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("form", "suffix", "options"), [
    ("vtk42", ".vtk", {"binary": True}), ("vtk42", ".vtk", {"binary": False}), ("vtk", ".vtk", {"binary": True}),
    ("vtk", ".vtk", {"binary": False}), ("su2", ".su2", {})])
def test_no_cut_loses_cells(form: str, suffix: str, options: dict, tmp_path: Path) -> None:
    path = tmp_path / f"m{suffix}"
    whole = written(path, form, **options)
    if suffix == ".su2":
        whole += b"NMARK= 1\nMARKER_TAG= 1\nMARKER_ELEMS= 2\n9 0 1 3 2\n9 1 2 0 3\n"
    for size in range(len(whole) - 1):
        path.write_bytes(whole[:size])
        try:
            mesh = fs.read_mesh(path)
        except fs.InputError as error:
            assert str(path) in str(error)
        else:  # what may be missing is behind the last number
            assert np.array_equal(mesh.cells, BRICKS.cells) and np.array_equal(mesh.points, BRICKS.points), size


@pytest.mark.slow
def test_cut_text_of_tetgen(tmp_path: Path) -> None:
    mesh = fs.block((1, 1, 1), (1, 1, 1), "tetra")
    written(tmp_path / "m.node", "tetgen", mesh)
    for name in ("m.node", "m.ele"):
        assert np.array_equal(fs.read_mesh(tmp_path / name).cells, mesh.cells)
        whole = (tmp_path / name).read_bytes()
        for size in range(len(whole) - 1):
            (tmp_path / name).write_bytes(whole[:size])
            with pytest.raises(fs.InputError, match=name):
                fs.read_mesh(tmp_path / name)
        (tmp_path / name).write_bytes(b"# cut")
        with pytest.raises(fs.InputError, match="begins with ''"):
            fs.read_mesh(tmp_path / name)
        (tmp_path / name).write_bytes(whole.replace(b"\n0 ", b"\n7 "))
        with pytest.raises(fs.InputError, match="not numbered one after the other"):
            fs.read_mesh(tmp_path / name)
        (tmp_path / name).write_bytes(whole)
    (tmp_path / "m.ele").write_bytes(whole.replace(b"\n0 0", b"\n0 99"))
    with pytest.raises(fs.InputError, match=r"m\.ele names nodes that m\.node does not give"):
        fs.read_mesh(tmp_path / "m.ele")
    (tmp_path / "m.ele").unlink()
    with pytest.raises(fs.InputError, match=r"there is no file .*m\.ele"):
        fs.read_mesh(tmp_path / "m.node")


def test_cut_files_of_ansys_end(tmp_path: Path) -> None:
    """In a child process, which is ended if it does not end by itself."""
    written(tmp_path / "whole.msh", "ansys", binary=True)
    code = ("import sys, femsub as fs\nfrom pathlib import Path\nwhole = Path(sys.argv[1]).read_bytes()\n"
            "for size in range(len(whole) // 3, len(whole), 7):\n"
            "    Path(sys.argv[2]).write_bytes(whole[:size])\n"
            "    try:\n        assert len(fs.read_mesh(sys.argv[2]).cells) == 2\n    except fs.InputError:\n        pass\n")
    assert len(fs.read_mesh(tmp_path / "whole.msh").cells) == 2
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "whole.msh"), str(tmp_path / "m.msh")], check=True, timeout=100)


def test_a_mesh_of_fluent_is_told_from_others(tmp_path: Path) -> None:
    """One triangle by its three edges, which would be read as a mesh of three lines."""
    path = tmp_path / "m.msh"
    path.write_text('(0 "a triangle")\n(2 2)\n(10 (0 1 3 0 2))\n(10 (1 1 3 1 2)\n(\n0 0\n1 0\n0 1\n))\n(12 (0 1 1 0))\n'
                    "(12 (2 1 1 1 1))\n(13 (0 1 3 0))\n(13 (3 1 3 3 2)(\n1 2 1 0\n2 3 1 0\n3 1 1 0\n))\n")
    with pytest.raises(fs.InputError, match=r"m\.msh is a mesh of Fluent"):
        fs.read_mesh(path)


def test_lines_that_do_not_belong_are_refused_at_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """meshio set a message of each in colours: 21,429 lines took seconds."""
    from meshio.su2 import _su2

    said, warn = list[str](), _su2.warn
    monkeypatch.setattr(_su2, "warn", lambda text: (said.append(text), warn(text)))
    path = tmp_path / "m.su2"
    path.write_bytes(written(path, "su2") + b"9 0 1 3 2\n" * 50)
    with pytest.raises(fs.InputError, match="lines that do not belong to what is above them"):
        fs.read_mesh(path)
    assert len(said) == 1


@pytest.mark.parametrize(("form", "suffix", "old", "new", "text"), [
    ("su2", ".su2", "NELEM= 2", "NELEM= 3", ""),
    ("su2", ".su2", "NELEM= 2", "NELEM= 1", "lines that do not belong to what is above them"),
    ("su2", ".su2", "NELEM= 2", "NELEM= 99999999999", "says NELEM= 99999999999, but has"),
    ("su2", ".su2", "NPOIN= 12", "NPOIN= 99999999999", "says NPOIN= 99999999999, but has"),
    ("vtk42", ".vtk", "CELLS 2 18", "CELLS 2 9", ""),
    ("vtk42", ".vtk", "CELL_TYPES 2", "CELL_TYPES 1", ""),
    ("vtk42", ".vtk", "POINTS 12", "POINTS 99999999999", "says POINTS 99999999999 double, but has"),
    ("vtk42", ".vtk", "POINTS 12 double\n0.0 ", "POINTS 12 double\n1e ", "has 1e where a number belongs"),
    ("su2", ".su2", "NELEM= 2\n12 0", "NELEM= 2\n12 0x10", "has 0x10 where a number belongs"),
    ("vtu", ".vtu", 'NumberOfCells="2"', 'NumberOfCells="3"', ""),
    ("vtu", ".vtu", 'NumberOfPoints="12"', 'NumberOfPoints="13"', ""),
])
def test_headers_that_promise_something_else(form: str, suffix: str, old: str, new: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / f"m{suffix}"
    whole = written(path, form, **({} if form == "su2" else {"binary": False}))
    assert whole.count(old.encode()) == 1
    path.write_bytes(whole.replace(old.encode(), new.encode()))
    with pytest.raises(fs.InputError, match=re.escape(text) or None):
        fs.read_mesh(path)
