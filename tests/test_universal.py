"""Meshes of universal files: each kind of element, groups, systems, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.io.universal import read_universal

#: corner, or middle between two corners, of each node in the order of universal files: around the bottom, up, around the top
ORDERS = {"tetra10": (118, "0 01 1 12 2 02 03 13 23 3"), "tetra": (111, "0 1 2 3"), "hexahedron": (115, "0 1 2 3 4 5 6 7"),
          "hexahedron20": (116, "0 01 1 12 2 23 3 03 04 15 26 37 4 45 5 56 6 67 7 47"),
          "wedge": (112, "0 1 2 3 4 5"), "wedge15": (113, "0 01 1 12 2 02 03 14 25 3 34 4 45 5 35")}
CORNERS = {"tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
           "wedge": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
           "hexahedron": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]}
#: the edges whose middles follow the corners in VTK's order, which is that of meshio
EDGES = {"tetra": "01 12 02 03 13 23", "wedge": "01 12 02 34 45 35 03 14 25", "hexahedron": "01 12 23 03 45 56 67 47 04 15 26 37"}
SYSTEM = """    -1
  2420
         1
Mesh
         7         0         0
CS
    1.0000000000000000E+0    0.0000000000000000E+0    0.0000000000000000E+0
    0.0000000000000000E+0    1.0000000000000000E+0    0.0000000000000000E+0
    0.0000000000000000E+0    0.0000000000000000E+0    1.0000000000000000E+0
    0.0000000000000000E+0    0.0000000000000000E+0    0.0000000000000000E+0
    -1
"""


def numbers(*values: int) -> str:
    return "".join(f"{value:10d}" for value in values) + "\n"


def universal(kind: str) -> tuple[str, np.ndarray]:
    """One element, whose nodes count from 11 in its order, with a group of it and its first node; and the nodes' places."""
    type_, order = ORDERS[kind]
    corners = np.array(CORNERS[kind.rstrip("0123456789")], dtype=float)
    places = np.array([corners[[int(digit) for digit in word]].mean(axis=0) for word in order.split()])
    nodes = "".join(numbers(11 + at, 7, 1, 11) + "".join(f"{value:25.16E}" for value in place).replace("E", "D") + "\n"
                    for at, place in enumerate(places))
    names = [11 + at for at in range(len(places))]
    lines = [numbers(*names[start:start + 8]) for start in range(0, len(names), 8)]
    element = numbers(5, type_, 1, 1, 7, len(names)) + "".join(lines)
    group = numbers(1, 0, 0, 0, 0, 0, 0, 2) + "rim\n" + numbers(7, 11, 0, 0, 8, 5, 0, 0)
    bodies = {2411: nodes, 2412: element, 2467: group, 164: "  1\n"}
    return SYSTEM + "".join(f"    -1\n{number:6d}\n{body}    -1\n" for number, body in bodies.items()), places


@pytest.mark.parametrize("kind", list(ORDERS))
def test_each_kind_of_element(tmp_path: Path, kind: str) -> None:
    text, places = universal(kind)
    (tmp_path / "part.unv").write_text(text)
    found, notes = read_universal(tmp_path / "part.unv")
    shape = kind.rstrip("0123456789")
    corners = np.array(CORNERS[shape], dtype=float)
    middles = [corners[[int(digit) for digit in edge]].mean(axis=0) for edge in EDGES[shape].split()]
    expected = corners if kind == shape else np.vstack([corners, middles])
    assert found.cells[0].type == kind and np.array_equal(found.points[found.cells[0].data[0]], expected)
    assert found.points_id.tolist() == list(range(11, 11 + len(places))) and notes == ["data set 164 skipped"]
    if shape == "wedge":
        return  # femsub has no such element
    mesh = fs.read_mesh(tmp_path / "part.unv")
    assert mesh.sets["rim"].tolist() == [0] and mesh.groups["rim"].tolist() == [0]
    moved = np.tile([1.0, 0.0, 0.0], len(places))
    volume = 1 / 6 if shape == "tetra" else 1.0
    assert float(moved @ (fs.solid(mesh, fs.Material(1.0, 0.3, 1.0)).M @ moved)) == pytest.approx(volume)


def test_the_content_tells_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "export.txt").write_text(universal("tetra")[0].rstrip("\n"))  # a last line -1 is whole
    assert fs.read_mesh(tmp_path / "export.txt").kind == "tetra"


@pytest.mark.parametrize(("old", "new", "message"), [
    ("1.0000000000000000E+0    0.0000000000000000E+0    0.0000000000000000E+0\n",
     "0.0000000000000000E+0    1.0000000000000000E+0    0.0000000000000000E+0\n", "coordinate system 7"),
    ("        12         7", "        11         7", "node 11 twice"),
    ("        12         7", "        x2         7", "whole number"),
    ("1.0000000000000000D+00", "1.0000000x00000000D+00", "not all numbers"),
    ("         5       111", "         5       115", "has not 8"),
    ("         4\n        11        12", "         5\n        11        12", "announces 5 nodes"),
    ("rim\n", "\n", "head of a group"),
    ("        11        12        13        14\n", "        11        12        13        15\n", "node 15"),
    ("  2467\n", "  58b\n", "number of a data set in text"), ("  1\n    -1\n", "", "without its end"),
    ("         2\nrim", "         3\nrim", "announces 3 members"), ("  2411\n", "  2499\n", "0 nodes")])
def test_faults_are_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    text, _ = universal("tetra")
    assert old in text
    (tmp_path / "part.unv").write_text(text.replace(old, new, 1))
    with pytest.raises(fs.InputError, match=message):
        fs.read_mesh(tmp_path / "part.unv")
