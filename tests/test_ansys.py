"""Files of Ansys: archives; matrices and modes by PyAnsys' reader, where it is installed; what is said where it is not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from fuzz_ansys import examples, full_file
from test_universal import CORNERS, EDGES

import femsub as fs
from femsub.checks import installed_by
from femsub.io.ansys import _axes
from femsub.io.cdb import read_cdb

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


def test_superelements_of_ansys_are_refused_with_advice(tmp_path: Path) -> None:
    (tmp_path / "part.sub").write_bytes(b"")
    for read in (fs.read_component, fs.read_matrix):
        with pytest.raises(fs.InputError, match=r"\*EXPORT in the format MMF"):
            read(tmp_path / "part.sub")


def test_files_of_ansys_need_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.io.ansys.find_spec", lambda name: None)
    (tmp_path / "a.rst").write_bytes(b"")
    with pytest.raises(fs.MissingPackageError, match=re.escape(installed_by("ansys-mapdl-reader"))):
        fs.read_modes(tmp_path / "a.rst")


def model() -> dict[str, np.ndarray]:
    """Four nodes in a plane with a rotation, in no order; the first is held along x. Friction makes K unsymmetric."""
    rng, n = np.random.default_rng(3), 12
    B = np.tril(rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.4)) + 2 * np.eye(n)
    friction = np.zeros((n, n))
    friction[3, 7], friction[7, 3] = -0.3, 0.0
    held = np.tile([1, 2, 6], 4)
    held[0] = -1
    return {"K": B @ B.T, "friction": friction, "M": np.diag(np.arange(1.0, n + 1)) + 0.1 * (B + B.T), "held": held,
            "nodes": np.array([9, 4, 30, 2]), "kinds": np.array([1, 2, 6])}


def test_full_files_hold_one_triangle_or_all_of_a_matrix(tmp_path: Path) -> None:
    given = model()
    names = [(node, kind) for node in given["nodes"] for kind in given["kinds"]]
    order = sorted(set(range(12)) - {0}, key=names.__getitem__)
    kept = np.ix_(order, order)
    path = full_file(tmp_path / "a.full", given["K"], given["M"], given, False)
    part = fs.read_component(path, interface=["4:rz"])
    assert np.array_equal(part.K.toarray(), given["K"][kept]) and np.array_equal(part.M.toarray(), given["M"][kept])
    assert part.dofs is not None and part.dofs.name(2) == "rz at node 2" and part.interface.tolist() == [5]
    K = given["K"] + given["friction"]
    for mass in (False, True):  # the mass may stand there as a triangle
        path = full_file(tmp_path / "b.full", K, given["M"], given, True, mass)
        assert np.array_equal(fs.read_matrix(path, "K").toarray(), K[kept])
        assert np.array_equal(fs.read_matrix(path, "M").toarray(), given["M"][kept])
    with pytest.raises(fs.InputError, match=r"K is not symmetric.*Pencil\(M, D, K\)"):
        fs.read_component(path)
    pencil = fs.Pencil(fs.read_matrix(path, "M"), None, fs.read_matrix(path, "K"))
    port = np.eye(12)[order][:, [3, 7]]
    rubbing = fs.LinearContact("pair", stiffness=given["friction"][np.ix_([3, 7], [3, 7])])
    expected = fs.complex_modes(fs.Substructure(given["M"][kept], given["K"][kept], ports={"pair": port}), rubbing)
    assert np.sort_complex(fs.complex_modes(pencil).eigenvalues) == pytest.approx(np.sort_complex(expected.eigenvalues))


@pytest.mark.parametrize(("where", "change", "message"), [
    ("header 13", 1, "has one triangle of each"), ("header 10", 1, "lumped mass"), ("header 0", 4, "frontal solver"),
    ("header 8", 7, "entries, but 7 are announced"), ("header 1", 11, "do not fit|no record|are announced"),
    ("K 0", 3, "records of column 1 of K do not fit"), ("K 1", -2**31 + 8, "records of column 1 of K do not fit"),
    ("K 2", 13, "K has a row beyond its 12"), ("header 18", 10**6, "K ends within column 1"),
    ("header 33", 0, "holds no M"), ("header 35", 5, "no record of DOF for each node")])
def test_damage_of_full_files_is_told(tmp_path: Path, where: str, change: int, message: str) -> None:
    given = model()
    path = full_file(tmp_path / "a.full", given["K"], given["M"], given, False)
    words = np.fromfile(path, "<i4")
    name, at = where.split()
    words[105 + int(at) if name == "header" else words[105 + 18] + int(at)] = change
    words.tofile(path)
    with pytest.raises(fs.InputError, match=message):
        fs.read_matrix(path, "K")


def test_a_whole_matrix_needs_its_flag(tmp_path: Path) -> None:
    given = model()
    words = np.fromfile(full_file(tmp_path / "a.full", given["K"], given["M"], given, True), "<i4")
    words[105 + 13] = 0
    words.tofile(tmp_path / "a.full")
    with pytest.raises(fs.InputError, match=r"a symmetric K is one triangle, but has \d+ entries below"):
        fs.read_matrix(tmp_path / "a.full", "K")


#: element type, and which corner of the cell each of the element's is: some forms have corners that fall together
FORMS = {"hexahedron": (185, "01234567"), "hexahedron20": (186, "01234567"),
         "wedge": (185, "01223455"), "wedge15": (186, "01223455"),
         "pyramid": (185, "01234444"), "pyramid13": (186, "01234444"), "tetra": (185, "01223333"), "tetra10": (186, "01223333"),
         "quad": (181, "0123"), "quad8": (281, "0123"), "triangle": (182, "0122"), "triangle6": (183, "0122")}
ORDER = {8: "01 12 23 03 45 56 67 47 04 15 26 37", 4: "01 12 23 03"}  # edges of an element, whose middles follow the corners
SHAPES = CORNERS | {"pyramid": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]], "quad": CORNERS["hexahedron"][:4],
                    "triangle": CORNERS["tetra"][:3]}
ENDS = EDGES | {"pyramid": "01 12 23 03 04 14 24 34", "quad": "01 12 23 03", "triangle": "01 12 02"}


def archive(kind: int, places: list[list[float]], elements: list[list[int]], more: str = "") -> str:
    """An archive of these nodes, from 11, and elements, from 5 and each of a material of its own."""
    lines = ["/PREP7", f"ET,3,{kind}", "CSYS,0", f"NBLOCK,6,SOLID,99,{len(places)}", "(3i9,6e20.13)"]
    for number, place in enumerate(places):
        last = max((at for at in range(3) if place[at]), default=-1)  # Ansys leaves out zeros at the end
        lines.append(f"{11 + number:9d}{0:9d}{0:9d}" + "".join(f"{value:20.13E}" for value in place[:last + 1]))
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,99,{len(elements)}", "(19i9)"]
    for number, nodes in enumerate(elements):
        words = [1 + number, 3, 1, 1, 0, 0, 0, 0, len(nodes), 0, 5 + number, *nodes]
        lines += ["".join(f"{word:9d}" for word in part) for part in (words[:19], words[19:]) if part]
    return "\n".join([*lines, "       -1", more, "FINISH", ""])


@pytest.mark.parametrize("form", list(FORMS))
def test_each_form_of_element(tmp_path: Path, form: str) -> None:
    kind, corners = FORMS[form]
    shape = form.rstrip("0123456789")
    points = np.array(SHAPES[shape], dtype=float)
    own = [points[int(digit)] for digit in corners]
    if form != shape:
        own += [(own[int(one)] + own[int(other)]) / 2 for one, other in ORDER[len(corners)].split()]
    places = [list(place) for place in dict.fromkeys(map(tuple, own))]
    numbers = {tuple(place): 11 + at for at, place in enumerate(places)}
    (tmp_path / "a.cdb").write_text(archive(kind, places, [[numbers[tuple(place)] for place in own]]))
    found, notes = read_cdb(tmp_path / "a.cdb")
    middles = [points[[int(digit) for digit in edge]].mean(axis=0) for edge in ENDS[shape].split()] if form != shape else []
    assert found.cells[0].type == form and found.cells_id[0].tolist() == [5] and not notes
    assert np.array_equal(found.points[found.cells[0].data[0]], np.array([*points, *middles]))


LINE = [[float(x), y, z] for x in range(3) for y, z in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
BRICKS = [[11, 12, 13, 14, 15, 16, 17, 18], [15, 16, 17, 18, 19, 20, 21, 22]]
PARTS = "CMBLOCK,LEFT    ,NODE,       2  ! of a user\n(8i10)\n        11       -14\nCMBLOCK,ONE,ELEM,       1\n(8i10)\n         6"


def test_components_and_materials_are_sets(tmp_path: Path) -> None:
    (tmp_path / "bar.cdb").write_text(archive(185, LINE, BRICKS, PARTS))
    (tmp_path / "end.cdb").write_text((tmp_path / "bar.cdb").read_text().rstrip() + "\nFINISH")
    assert fs.read_mesh(tmp_path / "end.cdb").kind == "hexahedron"
    mesh = fs.read_mesh(tmp_path / "bar.cdb")
    assert mesh.numbers[mesh.sets["LEFT"]].tolist() == [11, 12, 13, 14]
    assert {name: rows.tolist() for name, rows in mesh.groups.items()} == {"ONE": [1], "material-1": [0], "material-2": [1]}
    moved = np.tile([1.0, 0.0, 0.0], len(LINE))
    assert float(moved @ (fs.solid(mesh, fs.Material(1.0, 0.3, 1.0)).M @ moved)) == pytest.approx(2.0)
    (tmp_path / "job.dat").write_text(archive(185, LINE, BRICKS).replace("ET,3,185", "et,3,SOLID185").replace("CSYS", "csys"))
    assert fs.read_mesh(tmp_path / "job.dat").kind == "hexahedron"


@pytest.mark.parametrize(("old", "new", "message"), [
    ("CSYS,0", "LOCAL,12,1", "coordinate system of LOCAL"), ("       12        0", "       11        0", "node 11"),
    ("       12        0", "      1.5        0", "whole number"), ("0000000E+00", "0000000x+00", "not all numbers"),
    ("        8        0        5", "        9        0        5", "announces 9 nodes"),
    ("N,R5.3,LOC,       -1,\n", "", None),
    ("SOLID,99,12", "SOLID,99,13", "NBLOCK announces 13"), ("SOLID,99,2\n", "SOLID,99,3\n", "EBLOCK announces 3"),
    ("ET,3,185", "ET,3,174", "no elements that are cells: 2 elements of type 174"), ("ET,3,185\n", "", "which no ET defines"),
    ("NODE,       2", "NODE,       3", "announces 3 numbers, but has 2"), ("       -14", "        -9", "goes from 11 to 9"),
    ("       -1\nCM", "CM", None), ("       16       17       18\n", "       16       17       99\n", "names node 99"),
    ("CMBLOCK,ONE,ELEM,       1\n", "", "command of its block is lost"),
    ("CMBLOCK,ONE,ELEM", "CSYS,,ONE,ELEM", "command of its block is lost"), ("CMBLOCK,ONE,ELEM", "ONE,CMBLOCK,ELEM", "is lost"),
    ("FINISH\n", "CMBL", "does not end"),
    ("(19i9)", "(19x9)", "is not the format"), ("        6        15", "        5        15", "element 5")])
def test_faults_of_archives_are_told(tmp_path: Path, old: str, new: str, message: str | None) -> None:
    text = archive(185, LINE, BRICKS, PARTS)
    if old not in text:
        old, new = old.replace("        15", "       15"), new.replace("        15", "       15")
    assert old in text
    (tmp_path / "bar.cdb").write_text(text.replace(old, new, 1))
    if message is None:  # a command ends a block as well
        assert fs.read_mesh(tmp_path / "bar.cdb").kind == "hexahedron"
        return
    with pytest.raises(fs.InputError, match=message):
        fs.read_mesh(tmp_path / "bar.cdb")


def test_an_element_that_lacks_a_node_in_the_middle(tmp_path: Path) -> None:
    nodes = [11, 12, 13, 14, 15, 16, 17, 18, *[0] * 11, 19]
    (tmp_path / "bar.cdb").write_text(archive(186, LINE, [nodes]))
    with pytest.raises(fs.InputError, match=r"element 5 lacks some of its nodes in the middle of edges; add them \(EMID\)"):
        fs.read_mesh(tmp_path / "bar.cdb")
    (tmp_path / "bar.cdb").write_text(archive(186, LINE, [nodes[:8] + [0] * 12]))
    assert fs.read_mesh(tmp_path / "bar.cdb").kind == "hexahedron"  # all edges are straight


def test_modes_of_ansys_are_those_of_its_mesh(folder: Path) -> None:
    """The free beam of titanium in the examples: our elements against Ansys' own, which have reduced integration."""
    beam = fs.solid(fs.read_mesh(folder / "HexBeam.cdb"), fs.Material(16.9e6, 0.31, 4.1408e-4))
    pairs = fs.read_modes(folder / "file.rst").compare(beam, fs.normal_modes(beam, count=6))
    assert pairs.mac.min() > 0.99998 and sorted(pairs.found.tolist()) == [6, 7, 8, 9, 10, 11] and pairs.dofs == 963
    assert np.abs(pairs.change) == pytest.approx([2.3e-4, 2.3e-4, 3.7e-3, 9.4e-4, 9.4e-4, 4.0e-6], rel=0.05)
