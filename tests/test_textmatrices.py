"""Components from the text of Abaqus and CalculiX and their DOF maps, and every way such text can be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from matrixhelp import abaqus, numbered, same

import femsub as fs

K3 = "1 1 2.0\n2 1 -1.0\n2 2 2.0\n3 2 -1.0\n3 3 1.0\n"
N3 = "1,1, 1,1, 2.0\n2,1, 1,1, -1.0\n2,1, 2,1, 2.0\n3,1, 2,1, -1.0\n3,1, 3,1, 1.0\n"
M3 = "1,1, 1,1, 1.0\n2,1, 2,1, 1.0\n3,1, 3,1, 1.0\n"


def test_abaqus_component(tmp_path: Path, sub: fs.Substructure) -> None:
    D = sp.csr_array(sub.D + sub.D.T + sp.eye_array(24))
    paths = [abaqus(tmp_path / f"job_{name}1.mtx", matrix, sub.dofs, None if name == "DMPV" else sp.tril)
             for name, matrix in (("MASS", sub.M), ("STIF", sub.K), ("DMPV", D))]
    read = fs.read_component(*paths, interface=["3:ux", "3.2", (80, "ux"), (80, 2)], name="job",
                             ports={"belt": "45:ux", "both": ["3:*"], "tilted": {"10:ux": 0.6, "10:uy": 0.8},
                                    "column": np.ones(24)})
    for name, part in (("M", sub.M), ("K", sub.K), ("D", D)):
        same(getattr(read, name), sp.csr_array(part))
    assert np.array_equal(read.dofs.nodes, sub.dofs.nodes) and np.array_equal(read.dofs.components, sub.dofs.components)
    assert list(read.interface) == [0, 1, 22, 23] and read.name == "job"
    assert np.array_equal(read.port("belt"), sub.port("belt")) and list(np.flatnonzero(read.port("both"))) == [0, 1]
    assert list(read.port("tilted")[[2, 3]]) == [0.6, 0.8] and read.port("column").sum() == 24


def test_abaqus_order_of_rows_is_its_own_business(tmp_path: Path, sub: fs.Substructure) -> None:
    """One triangle in Abaqus' order of rows is neither triangle in the order of the node numbers."""
    shuffled = fs.DofMap(np.random.default_rng(2).permutation(sub.size) + 1, np.zeros(sub.size, dtype=int))
    read = fs.read_matrix(abaqus(tmp_path / "a.mtx", sub.K, shuffled))
    place = shuffled.nodes - 1
    assert abs(read[place][:, place] - sub.K).max() == 0


def test_held_and_massless_dof_of_abaqus(tmp_path: Path, sub: fs.Substructure) -> None:
    K = sp.lil_array(sub.K)
    K[2, 2] = K[7, 7] = 1e36
    M = sub.M.diagonal()
    M[5] = 0.0
    paths = abaqus(tmp_path / "M.mtx", sp.csr_array(sp.diags_array(M)), sub.dofs), abaqus(tmp_path / "K.mtx", K, sub.dofs)
    lines = paths[0].read_text().splitlines(keepends=True)
    paths[0].write_text("".join(line for line in lines if float(line.split(",")[-1])))
    with pytest.raises(fs.InputError, match=r"K has 1 DOF that are not in M, first DOF 2 of node 17 .*give massless=True"):
        fs.read_component(*paths)
    read = fs.read_component(*paths, massless=True)
    kept = np.setdiff1d(np.arange(sub.size), [2, 7])
    same(read.K, sp.csr_array(sub.K[kept][:, kept]))
    assert np.array_equal(read.M.diagonal(), M[kept]) and np.array_equal(read.dofs.nodes, sub.dofs.nodes[kept])
    with pytest.raises(fs.InputError, match="interface: there is no ux at node 10 in the DOF map"):
        fs.read_component(*paths, massless=True, interface=["10:ux"])


def test_empty_dof_of_abaqus(tmp_path: Path) -> None:
    """Trusses along x, whose motions along y have zeros in K and in M, or nothing in M at all."""
    (tmp_path / "K.mtx").write_text(N3 + "".join(f"{node},2, {node},2, 0.0\n" for node in (1, 2, 3)))
    (tmp_path / "M.mtx").write_text(M3 + "".join(f"{node},2, {node},2, 0.0\n" for node in (1, 2, 3)))
    (tmp_path / "short.mtx").write_text(M3)
    (tmp_path / "cut.mtx").write_text(M3[:M3.index("3,1")])
    said = "3 DOF have neither mass nor stiffness: uy at node 1, uy at node 2, uy at node 3"
    with pytest.warns(fs.FemsubWarning, match=f"{said}.*drop_empty=True"):
        whole = fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx", interface=["2:*"])
    assert whole.size == 6
    with pytest.raises(fs.SingularMatrixError, match=said):
        fs.normal_modes(whole, count=1)
    exact = np.sqrt(np.linalg.eigvalsh([[2, -1, 0], [-1, 2, -1], [0, -1, 1]]))
    for mass in ("M.mtx", "short.mtx"):
        part = fs.read_component(tmp_path / mass, tmp_path / "K.mtx", interface=["3:ux"], ports={"end": {(2, "ux"): 2.0}},
                                 drop_empty=True)
        assert part.dofs is not None and [part.dofs.name(row) for row in range(part.size)] == [
            "ux at node 1", "ux at node 2", "ux at node 3"]
        assert part.interface.tolist() == [2] and part.port("end").tolist() == [0.0, 2.0, 0.0]
        assert fs.normal_modes(part, count=3).frequencies == pytest.approx(exact)
    for bad, message in (({"interface": ["2:*"]}, "interface of 'K': 1 DOF has neither mass nor stiffness: uy at node 2"),
                         ({"ports": {"p": "1:uy"}}, "port 'p' of 'K': 1 DOF has neither .*: uy at node 1")):
        with pytest.raises(fs.InputError, match=message):
            fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx", drop_empty=True, **bad)
    with pytest.raises(fs.InputError, match=r"3 DOF that are not in M.*zeros of K say, leave them out by drop_empty=True"):
        fs.read_component(tmp_path / "short.mtx", tmp_path / "K.mtx")
    with pytest.raises(fs.InputError, match="1 DOF that are not in M, first DOF 1 of node 3"):
        fs.read_component(tmp_path / "cut.mtx", tmp_path / "K.mtx", drop_empty=True)


def test_lagrange_multipliers_of_abaqus_have_no_diagonal(tmp_path: Path) -> None:
    (tmp_path / "K.mtx").write_text("** a comment\n\n" + N3 + "3,1, -2,1, 5.0\n")
    (tmp_path / "M.mtx").write_text(M3)
    read = fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx", massless=True, interface=["-2:ux"])
    assert read.dofs.nodes.tolist() == [-2, 1, 2, 3] and list(read.interface) == [0]
    assert read.K.toarray()[0].tolist() == [0, 0, 0, 5] and read.M.diagonal().tolist() == [0, 1, 1, 1]


def test_calculix_component(tmp_path: Path, sub: fs.Substructure) -> None:
    numbered(tmp_path / "job.sti", sub.K, sp.triu, "%20.13e")
    numbered(tmp_path / "job.mas", sub.M, sp.triu, "%20.13e")
    (tmp_path / "job.dof").write_text("".join(f"{node}.{part + 1}\n" for node, part in zip(sub.dofs.nodes, sub.dofs.components,
                                                                                      strict=True)))
    read = fs.read_component(tmp_path / "job.mas", tmp_path / "job.sti", dofs=tmp_path / "job.dof", interface=["3.1", "3.2"],
                             ports={"belt": ["45.1"]})
    assert abs(read.K - sub.K).max() < 1e-12 and abs(read.M - sub.M).max() < 1e-12
    assert read.dofs.name(23) == "uy at node 80" and list(read.interface) == [0, 1] and read.port("belt")[12] == 1


@pytest.mark.parametrize(("text", "name", "label"), [
    ("3,ux\n3,uy\n4,ux\n", "ux at node 4", "ux"), ("node,component,x\n3,1,0.5\n3,2,0.5\n4,6,1.5\n", "rz at node 4", "rz"),
    ("3,ux\n3,rx\n4,rz\n", "rz at node 4", "rz"),
    ('7,w\n7,"w,x"\n8,w\n', "w at node 8", "w"), ("7,1\n7,11\n8,8\n", "dof8 at node 8", "dof8"),
])
def test_dof_map_as_text(tmp_path: Path, text: str, name: str, label: str) -> None:
    (tmp_path / "map.csv").write_text(text)
    np.save(tmp_path / "A.npy", np.eye(3))
    read = fs.read_component(tmp_path / "A.npy", tmp_path / "A.npy", dofs=tmp_path / "map.csv", interface=[f"{name[-1]}:{label}"])
    assert read.dofs.name(2) == name and list(read.interface) == [2]
    assert (read.dofs.points is None) != ("0.5" in text)


@pytest.mark.parametrize(("ending", "text", "words"), [
    ("sti", K3.replace("-1.0\n3 3", "nan\n3 3"), "holds a NaN or Inf, first in data line 4"),
    ("sti", K3.replace("3 2 -1.0", "3 2 x"), "'x' in data line 4 is not a number"),
    ("sti", K3.replace("3 2 -1.0", "3 2"), "data line 4 has 2 values, not 3"),
    ("sti", K3 + "3 2 -1.0\n", "lists an entry twice: row 3, column 2"),
    ("sti", K3.replace("2 1", "1 2"), "neither one triangle nor a full matrix: 1 entries below the diagonal and 1 above"),
    ("sti", K3.replace("1 1 2.0\n", "0 1 2.0\n"), "count from 1, but data line 1 has 0"),
    ("sti", K3.replace("1 1 2.0\n", "1.5 1 2.0\n"), "must be whole numbers, but data line 1 has 1.5, 1"),
    ("sti", "1 2 3 4\n", "has 4 numbers a line"),
    ("sti", "1 1 1 2 1 5.0\n", "ELEMENT BY ELEMENT"),
    ("sti", "", "is empty"),
    ("sti", "\n\n", "is empty"),
    ("sti", K3[:-1], "its last line, '3 3 1.0', does not end"),
    ("sti", K3.replace("3 3", "4 4"), "has entries, but none on the diagonal, for 1 of 4 DOF, first row 3"),
    ("sti", K3 + "4 4 1.0\n", "K is 4 x 4, but"),
    ("mtx", N3 + "3,1, 2,1, -1.0\n", "lists an entry twice: node 3, DOF 1 with node 2, DOF 1"),
    ("mtx", N3 + "1,1, 2,1, -1.0\n", "1 above, 1 of them without the transposed entry"),
    ("mtx", N3.replace("3,1", "4,1"), "M has 1 DOF that are not in K, first DOF 1 of node 3"),
    ("mtx", N3 + "4,1, 4,1, 1.0\n", "K has 1 DOF that are not in M, first DOF 1 of node 4"),
    ("mtx", N3.replace(",1, 1,1,", ",1, 1,-1,"), "must be DOF such as 1 to 6"),
    ("mtx", "*MATRIX,TYPE=STIFFNESS\n1.0,\n", "holds keywords (*MATRIX,TYPE=STIFFNESS)"),
    ("mtx", K3, "do not go together: one has node and DOF of each entry, the other only row numbers"),
    ("mtx", N3 + "1,1, 2,1, -3.0\n2,1, 3,1, -1.0\n", "K is not symmetric: K[0, 1] = -3"),
    ("mtx", "%%MatrixMarket matrix coordinate real general\n3 3 2\n1 1 1.0\n2 2 1.0e", "does not end"),
    ("mtx", "%%MatrixMarket matrix coordinate real general\n3 3 3\n1 1 1.0\n2 2 1.0\n", "Truncated file"),
    ("mtx", "%%MatrixMarket matrix array real general\n2 3\n1\n1\n1\n1\n1\n1\n", "K must be square, but its shape is (2, 3)"),
    ("dat", "1\n", "unknown ending; known are .mtx (Matrix Market or Abaqus)"),
    ("npz", "no zip\n", "not a whole .npz file"),
    ("mat", "no mat\n", "is no MATLAB file, or cut short"),
])
def test_bad_text(tmp_path: Path, ending: str, text: str, words: str) -> None:
    names = {"sti": "M.mas", "mtx": "M.mtx"}
    mass = tmp_path / names.get(ending, "M.mas")
    mass.write_text(M3 if mass.suffix == ".mtx" and not text.startswith("%%") else "1 1 1.0\n2 2 1.0\n3 3 1.0\n")
    path = tmp_path / f"K.{ending}"
    path.write_text(text)
    with pytest.raises(fs.InputError) as caught:
        fs.read_component(mass, path)
    assert (words in str(caught.value) and str(path) in str(caught.value)) or "unknown ending" in words
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "text"), [
    ("K.stiff", N3), ("K.txt", N3), ("K.stiff", f"** of a superelement\n{N3}".replace(",", ", ")), ("K", K3), ("K.stiff", K3),
    ("K.txt", "%%MatrixMarket matrix coordinate real symmetric\n% of Ansys\n3 3 5\n" + K3),
    ("K.mmf", "%%MatrixMarket matrix coordinate real symmetric\n3 3 5\n" + K3.replace("2.0", "2.0D+00"))])
def test_the_content_tells_a_matrix_whatever_its_file_is_called(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    same(sp.csr_array(fs.read_matrix(tmp_path / name)), sp.csr_array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]))


@pytest.mark.parametrize("text", ["2.0 -1.0 0.0\n-1.0 2.0 -1.0\n0.0 -1.0 1.0\n", "Dear reader\n", "", "1 2\n", "1 1 2.0 3.0\n"])
def test_a_text_that_is_no_matrix_by_its_entries(text: str, tmp_path: Path) -> None:
    (tmp_path / "K.txt").write_text(text)
    with pytest.raises(fs.InputError, match="unknown ending"):
        fs.read_matrix(tmp_path / "K.txt")


@pytest.mark.parametrize(("arguments", "words"), [
    ({"dofs": "1.1\n1.2\n"}, r"K\.dof has 2 DOF, but .*K\.sti has 3 rows"),
    ({"dofs": "1.1\n"}, "has 1 DOF, but"),
    ({"dofs": "1.1\n1.2\n1.2\n"}, "uy at node 1 is listed twice"),
    ({"dofs": "1.1\n1\n2.1\n"}, "'' is not a node or direction"),
    ({"dofs": "1,ux\n1,uy\n2\n"}, "data line 3 has 1 values, not 2"),
    ({"dofs": "a,ux\n1,uy\n2,ux\n"}, "'a' is not a node or direction"),
    ({"dofs": "node,component\n"}, "is empty"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2:uy"]}, "interface: there is no uy at node 2"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2:vy"]}, "interface: unknown motion 'vy'"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2"]}, "interface: '2' is not a DOF. Give a number from 0, or node and motion"),
    ({"dofs": "1.1\n1.2\n2.1\n", "ports": {"belt": (2, "uy")}}, "port 'belt': there is no uy at node 2"),
    ({"interface": ["2:uy"]}, "names a node, but there is no DOF map. Give dofs"),
    ({"interface": [3]}, "interface: there is no DOF 3; the model has 3"),
    ({"ports": {"belt": -1}}, "port 'belt': there is no DOF -1"),
])
def test_bad_map_and_names(tmp_path: Path, arguments: dict[str, Any], words: str) -> None:
    numbered(tmp_path / "K.sti", sp.eye_array(3), sp.triu)
    if "dofs" in arguments:
        (tmp_path / "K.dof").write_text(arguments["dofs"])
        arguments = arguments | {"dofs": tmp_path / "K.dof"}
    with pytest.raises(fs.InputError, match=words) as caught:
        fs.read_component(tmp_path / "K.sti", tmp_path / "K.sti", **arguments)
    assert "\n" not in str(caught.value)


def test_swapped_abaqus_matrices_are_told_by_what_holds_a_dof(tmp_path: Path) -> None:
    for name, rows in (("K", "1,1,1,1,1e36\n1,1,2,1,0.0\n2,1,2,1,2.0\n"), ("M", "1,1,1,1,1.0\n2,1,2,1,1.0\n")):
        (tmp_path / f"{name}.mtx").write_text(rows, encoding="utf-8")
    assert fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx").size == 1
    with pytest.raises(fs.InputError, match="swapped"):
        fs.read_component(tmp_path / "K.mtx", tmp_path / "M.mtx")


def test_a_matrix_of_sierra_has_finite_numbers(tmp_path: Path) -> None:
    (tmp_path / "a_Kaa.m").write_text(
        "function a=Kaa()\nNumRows = 2;\na=[\n1 1 1;\n2 2 1e400;\n];\na=sparse(a(:,1),a(:,2),a(:,3),2,2);\n"
        "disp('This Matrix is in a Symmetric Sparse Format (Lower Triangular)')\n")
    with pytest.raises(fs.InputError, match="beyond all limits in row 2"):
        fs.read_matrix(tmp_path / "a_Kaa.m")


@pytest.mark.parametrize("empty", [[], (), range(0), np.array([], int)])
def test_an_empty_interface_of_any_kind_is_none(empty: Any, tmp_path: Path) -> None:
    fs.write_matrices(tmp_path / "part", fs.Substructure(np.eye(2), np.eye(2)))
    assert fs.read_component(tmp_path / "part", interface=empty).size == 2
