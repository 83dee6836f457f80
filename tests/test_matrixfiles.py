"""Matrices from elsewhere and back: each format read from what another hand wrote, and every way a file can be wrong."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from conftest import lattice

import femsub as fs

NX, NY = 4, 3


@pytest.fixture
def sub() -> fs.Substructure:
    """The held lattice with unsymmetric D, a second port of two columns, names and places of its DOF."""
    base = lattice(NX, NY, held=True)
    n, rng = base.size, np.random.default_rng(3)
    dofs = fs.DofMap(np.repeat(np.arange(n // 2) * 7 + 3, 2), np.tile([0, 1], n // 2), points=rng.standard_normal((n, 2)))
    damping = sp.random(n, n, 0.1, random_state=5, format="csr")
    ports = {"pad": rng.standard_normal((n, 2)), "belt": base.port("belt")}
    return fs.Substructure(base.M, base.K, damping, base.interface, ports, "lättice", dofs)


def same(first: Any, second: Any) -> None:
    """Equal to the last digit, sparse where it was sparse."""
    assert sp.issparse(first) == sp.issparse(second) and first.shape == second.shape
    assert abs(first - second).max() == 0


def same_map(first: fs.DofMap, second: fs.DofMap) -> None:
    assert first.labels == second.labels
    assert np.array_equal(first.nodes, second.nodes) and np.array_equal(first.components, second.components)
    assert (first.points is None) == (second.points is None)
    assert first.points is None or np.array_equal(first.points, second.points)


def abaqus(path: Path, matrix: Any, dofs: fs.DofMap, triangle: Callable[..., Any] | None = sp.tril) -> Path:
    """As *MATRIX OUTPUT, FORMAT=MATRIX INPUT writes it."""
    entries = sp.coo_array(triangle(matrix) if triangle else matrix)
    text = "".join(f"{dofs.nodes[i]},{dofs.components[i] + 1}, {dofs.nodes[j]},{dofs.components[j] + 1}, {value:.17e}\n"
                   for i, j, value in zip(entries.row, entries.col, entries.data, strict=True))
    path.write_text(text, encoding="ascii")
    return path


def numbered(path: Path, matrix: Any, triangle: Callable[..., Any] | None, form: str = "%.17e") -> Path:
    """As FORMAT=COORDINATE and CalculiX' matrixstorage.c ('%d %d %20.13e') write it."""
    entries = sp.coo_array(triangle(matrix) if triangle else matrix)
    order = np.lexsort((entries.row, entries.col))
    lines = (f"{entries.row[k] + 1} {entries.col[k] + 1} {form % entries.data[k]}\n" for k in order)
    path.write_text("".join(lines), encoding="ascii")
    return path


@pytest.mark.parametrize("kind", ["mtx", "mtx-array", "npz", "npz-named", "npy", "mat", "mat-dense", "op4", "op4-text",
                                  "abaqus-lower", "abaqus-upper", "abaqus-full", "coordinate-full", "coordinate-lower",
                                  "calculix"])
def test_read_matrix(tmp_path: Path, sub: fs.Substructure, kind: str) -> None:
    K, path = sp.coo_matrix(sub.K), tmp_path / f"K.{kind.split('-')[0]}"
    tolerance, dense = 0.0, False
    if kind == "mtx":
        scipy.io.mmwrite(path, K, precision=17)
    elif kind == "mtx-array":
        scipy.io.mmwrite(path, K.toarray(), precision=17)
        dense = True
    elif kind == "npz":
        sp.save_npz(path, K)
    elif kind == "npz-named":
        np.savez(path, K=K.toarray())
        dense = True
    elif kind == "npy":
        np.save(path, K.toarray())
        dense = True
    elif kind.startswith("mat"):
        dense = kind == "mat-dense"
        scipy.io.savemat(path, {"K": K.toarray() if dense else K.tocsc(), "text": "hello"})
    elif kind.startswith("op4"):
        op4 = pytest.importorskip("pyyeti.nastran.op4")
        op4.write(str(path), {"k": K}, binary=kind == "op4", digits=17)
    elif kind.startswith("abaqus"):
        path = abaqus(tmp_path / "job_STIF1.mtx", K, sub.dofs, {"lower": sp.tril, "upper": sp.triu, "full": None}[kind[7:]])
    elif kind.startswith("coordinate"):
        path = numbered(tmp_path / "job_STIF1.mtx", K, None if kind.endswith("full") else sp.tril)
    else:
        path, tolerance = numbered(tmp_path / "job.sti", K, sp.triu, "%20.13e"), 1e-13
    read = fs.read_matrix(path)
    assert sp.issparse(read) != dense
    assert abs(read - K).max() <= tolerance * abs(K).max()


def test_matlab_7_3(tmp_path: Path, sub: fs.Substructure) -> None:
    h5py = pytest.importorskip("h5py")
    K, V = sp.csc_array(sub.K), np.random.default_rng(0).standard_normal((5, 3))
    with h5py.File(tmp_path / "model.mat", "w", userblock_size=512) as file:
        group = file.create_group("K")
        group.attrs["MATLAB_sparse"] = np.uint64(K.shape[0])
        for name, part in (("data", K.data), ("ir", K.indices.astype(np.uint64)), ("jc", K.indptr.astype(np.uint64))):
            group[name] = part
        file["V"] = V.T
    same(fs.read_matrix(tmp_path / "model.mat", "K"), sub.K)
    assert np.array_equal(fs.read_matrix(tmp_path / "model.mat", "V"), V)


def test_packages_that_are_missing(tmp_path: Path, sub: fs.Substructure, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "model.op4").write_bytes(b"0" * 64)
    (tmp_path / "model.mat").write_bytes(b"MATLAB 7.3".ljust(512) + b"\x89HDF\r\n")
    for module in ("pyyeti.nastran", "pyyeti", "h5py"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(fs.MissingPackageError, match="pip install femsub\\[nastran\\]"):
        fs.read_matrix(tmp_path / "model.op4")
    with pytest.raises(fs.MissingPackageError, match="-v7"):
        fs.read_matrix(tmp_path / "model.mat")
    with pytest.raises(fs.MissingPackageError):
        fs.write_matrices(tmp_path / "out", sub, "op4")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("ending", ["mat", "npz", "op4"])
def test_which_of_several(tmp_path: Path, sub: fs.Substructure, ending: str) -> None:
    path = tmp_path / f"model.{ending}"
    parts = {"M": sub.M.toarray(), "K": sub.K.toarray(), "Kff": 2 * sub.K.toarray()}
    if ending == "op4":
        pytest.importorskip("pyyeti.nastran.op4").write(str(path), parts)
    else:
        {"mat": scipy.io.savemat, "npz": lambda name, content: np.savez(name, **content)}[ending](path, parts)
    assert abs(fs.read_component(path, path).K - sub.K).max() == 0
    assert abs(fs.read_component(path, f"{path}:Kff").K - 2 * sub.K).max() == 0
    with pytest.raises(fs.InputError, match=r"(?i)holds 3 matrices: M 24 x 24, K 24 x 24, Kff 24 x 24; name one"):
        fs.read_matrix(path)
    with pytest.raises(fs.InputError, match=r"(?i)no matrix 'Kgg'; it has: M"):
        fs.read_matrix(path, "Kgg")


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
    with pytest.raises(fs.InputError, match=r"K has 1 DOF that M has not, first DOF 2 of node 17 .*say massless=True"):
        fs.read_component(*paths)
    read = fs.read_component(*paths, massless=True)
    kept = np.setdiff1d(np.arange(sub.size), [2, 7])
    same(read.K, sp.csr_array(sub.K[kept][:, kept]))
    assert np.array_equal(read.M.diagonal(), M[kept]) and np.array_equal(read.dofs.nodes, sub.dofs.nodes[kept])
    with pytest.raises(fs.InputError, match="interface: there is no ux at node 10 in the DOF map \\(it may be held\\)"):
        fs.read_component(*paths, massless=True, interface=["10:ux"])


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


@pytest.mark.parametrize("format", ["mtx", "npz", "mat", "op4"])
@pytest.mark.parametrize("kind", ["full", "bare", "CraigBampton", "CraigChang"])
def test_round_trip(tmp_path: Path, sub: fs.Substructure, format: str, kind: str) -> None:
    if format == "op4":
        pytest.importorskip("pyyeti.nastran.op4")
    model = {"full": lambda: sub, "bare": lambda: fs.Substructure(sub.M, sub.K),
             "CraigBampton": lambda: fs.reduce(sub, fs.CraigBampton(modes=5), ports=True),
             "CraigChang": lambda: fs.reduce(sub, fs.CraigChang(modes=5), ports=True)}[kind]()
    written = fs.write_matrices(tmp_path / "deep" / "out", model, format)
    assert {path.name for path in written} == set(os.listdir(tmp_path / "deep" / "out"))
    read = fs.read_component(tmp_path / "deep" / "out")
    assert type(read) is type(model) and repr(read) == repr(model)
    for part in "MDK":
        same(getattr(model, part), getattr(read, part))
    assert list(read.interface) == list(model.interface) and list(read.ports) == list(model.ports)
    assert all(np.array_equal(w, read.ports[port]) for port, w in model.ports.items())
    if isinstance(model, fs.ReducedSubstructure):
        same(read.V, model.V)
        same_map(read.full_dofs, model.full_dofs)
        assert np.array_equal(read.interface_rows, model.interface_rows)
        for key in ("kinds", "cutoff", "method", "dropped", "factorisations", "port_error"):
            assert getattr(read, key) == getattr(model, key)
    elif model.dofs:
        same_map(read.dofs, model.dofs)


def test_matlab_counts_from_1(tmp_path: Path, sub: fs.Substructure) -> None:
    rom = fs.reduce(sub, fs.CraigBampton(modes=3), ports=True)
    fs.write_matrices(tmp_path, rom, "mat")
    content = scipy.io.loadmat(tmp_path / "model.mat")
    assert content["interface"].ravel().tolist() == (rom.interface + 1).tolist()
    assert [str(name[0]) for name in content["port_names"].ravel()] == ["pad", "belt"] and content["ports"].shape == (rom.size, 3)


def cut(path: Path, part: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:int(len(content) * part)])


@pytest.mark.parametrize("part", [0.0, 0.03, 0.5, 0.97, 0.9999])
@pytest.mark.parametrize("kind", ["mtx", "mtx-array", "npz", "npy", "mat", "op4", "abaqus", "calculix"])
def test_a_file_cut_short(tmp_path: Path, sub: fs.Substructure, kind: str, part: float) -> None:
    for name, matrix in (("M", sub.M), ("K", sub.K)):
        if kind == "abaqus":
            abaqus(tmp_path / f"{name}.mtx", matrix, sub.dofs)
        elif kind == "calculix":
            numbered(tmp_path / f"{name}.sti", matrix, sp.triu)
        elif kind == "npy":
            np.save(tmp_path / f"{name}.npy", matrix.toarray())
        elif kind == "npz":
            sp.save_npz(tmp_path / f"{name}.npz", matrix)
        elif kind == "mat":
            scipy.io.savemat(tmp_path / f"{name}.mat", {name: matrix})
        elif kind == "op4":
            pytest.importorskip("pyyeti.nastran.op4").write(str(tmp_path / f"{name}.op4"), {name: matrix})
        else:
            scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix.toarray() if kind == "mtx-array" else sp.coo_matrix(matrix))
    ending = {"abaqus": "mtx", "mtx-array": "mtx", "calculix": "sti"}.get(kind, kind)
    paths = tmp_path / f"M.{ending}", tmp_path / f"K.{ending}"
    fs.read_component(*paths)
    cut(paths[1], part)
    with pytest.raises(fs.InputError) as caught:
        fs.read_component(*paths)
    assert "K." in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("line", range(1, 5))
@pytest.mark.parametrize("kind", ["mtx", "mtx-array", "abaqus", "calculix"])
def test_lines_that_are_missing_at_the_end(tmp_path: Path, sub: fs.Substructure, kind: str, line: int) -> None:
    paths = []
    for name, matrix in (("M", sub.M), ("K", sub.K)):
        if kind.startswith("mtx"):
            paths.append(tmp_path / f"{name}.mtx")
            scipy.io.mmwrite(paths[-1], sp.coo_matrix(matrix) if kind == "mtx" else matrix.toarray())
        else:
            paths.append(abaqus(tmp_path / f"{name}.mtx", matrix, sub.dofs) if kind == "abaqus" else
                         numbered(tmp_path / f"{name}.sti", matrix, sp.triu))
    for path in paths if kind.startswith("mtx") else paths[:1]:
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:-line]))
    with pytest.raises(fs.InputError, match=r"M: .*M.mtx|M is .*M.sti|M has not"):
        fs.read_component(*paths)


K3 = "1 1 2.0\n2 1 -1.0\n2 2 2.0\n3 2 -1.0\n3 3 1.0\n"
N3 = "1,1, 1,1, 2.0\n2,1, 1,1, -1.0\n2,1, 2,1, 2.0\n3,1, 2,1, -1.0\n3,1, 3,1, 1.0\n"
M3 = "1,1, 1,1, 1.0\n2,1, 2,1, 1.0\n3,1, 3,1, 1.0\n"


@pytest.mark.parametrize(("ending", "text", "words"), [
    ("sti", K3.replace("-1.0\n3 3", "nan\n3 3"), "holds a NaN or Inf, first in data line 4"),
    ("sti", K3.replace("3 2 -1.0", "3 2 x"), "'x' in data line 4 is not a number"),
    ("sti", K3.replace("3 2 -1.0", "3 2"), "data line 4 has 2 values, those before have 3"),
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
    ("sti", K3 + "4 4 1.0\n", "but K is 4 x 4"),
    ("mtx", N3 + "3,1, 2,1, -1.0\n", "lists an entry twice: node 3, DOF 1 with node 2, DOF 1"),
    ("mtx", N3 + "1,1, 2,1, -1.0\n", "1 above, 1 of them without the entry across"),
    ("mtx", N3.replace("3,1", "4,1"), "M has 1 DOF that K has not, first DOF 1 of node 3"),
    ("mtx", N3 + "4,1, 4,1, 1.0\n", "K has 1 DOF that M has not, first DOF 1 of node 4"),
    ("mtx", N3.replace(",1, 1,1,", ",1, 1,-1,"), "must be DOF such as 1 to 6"),
    ("mtx", "*MATRIX,TYPE=STIFFNESS\n1.0,\n", "holds keywords (*MATRIX,TYPE=STIFFNESS)"),
    ("mtx", K3, "do not go together: one names node and DOF of each entry, the other counts rows"),
    ("mtx", N3 + "1,1, 2,1, -3.0\n2,1, 3,1, -1.0\n", "K is not symmetric: K[0, 1] = -3"),
    ("mtx", "%%MatrixMarket matrix coordinate real general\n3 3 2\n1 1 1.0\n2 2 1.0e", "does not end"),
    ("mtx", "%%MatrixMarket matrix coordinate real general\n3 3 3\n1 1 1.0\n2 2 1.0\n", "Truncated file"),
    ("mtx", "%%MatrixMarket matrix array real general\n2 3\n1\n1\n1\n1\n1\n1\n", "K must be square, but its shape is (2, 3)"),
    ("dat", "1\n", "unknown ending; known are .mtx (Matrix Market or Abaqus)"),
    ("npz", "no zip\n", "not a whole .npz file"),
    ("mat", "no mat\n", "cannot be read as a matrix"),
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


@pytest.mark.parametrize(("arguments", "words"), [
    ({"dofs": "1.1\n1.2\n"}, r"K\.dof has 2 DOF, but .*K\.sti has 3 rows"),
    ({"dofs": "1.1\n"}, "has 1 DOF, but"),
    ({"dofs": "1.1\n1.2\n1.2\n"}, "uy at node 1 is listed twice"),
    ({"dofs": "1.1\n1\n2.1\n"}, "'' is not a node or direction"),
    ({"dofs": "1,ux\n1,uy\n2\n"}, "data line 3 has 1 values, the first has 2"),
    ({"dofs": "a,ux\n1,uy\n2,ux\n"}, "'a' is not a node or direction"),
    ({"dofs": "node,component\n"}, "is empty"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2:uy"]}, "interface: there is no uy at node 2"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2:vy"]}, "interface: unknown motion 'vy'"),
    ({"dofs": "1.1\n1.2\n2.1\n", "interface": ["2"]}, "interface: '2' is no DOF; write a number from 0, or node and motion"),
    ({"dofs": "1.1\n1.2\n2.1\n", "ports": {"belt": (2, "uy")}}, "port 'belt': there is no uy at node 2"),
    ({"interface": ["2:uy"]}, "names a node, but there is no DOF map; give dofs"),
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


def test_what_was_written_and_then_damaged(tmp_path: Path, sub: fs.Substructure) -> None:
    fs.write_matrices(tmp_path / "out", sub, "mtx")
    with pytest.raises(fs.InputError, match="tells interface, ports and DOF map itself"):
        fs.read_component(tmp_path / "out", interface=[0])
    with pytest.raises(fs.InputError, match="K is missing: name its file"):
        fs.read_component(tmp_path)
    about = json.loads((tmp_path / "out" / "model.json").read_text())
    del about["interface"]
    (tmp_path / "out" / "model.json").write_text(json.dumps(about))
    with pytest.raises(fs.InputError, match=r"model\.json is damaged"):
        fs.read_component(tmp_path / "out")
    with pytest.raises(fs.InputError, match="unknown format 'mtz'; did you mean 'mtx'"):
        fs.write_matrices(tmp_path / "new", sub, "mtz")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("failing", ["fdopen", "replace"])
def test_nothing_is_written_when_the_disk_is_full(tmp_path: Path, sub: fs.Substructure, monkeypatch: pytest.MonkeyPatch,
                                                  failing: str) -> None:
    fs.write_matrices(tmp_path / "old", sub)
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}
    real, calls = getattr(os, failing), []

    def full_disk(*arguments: Any, **more: Any) -> Any:
        calls.append(arguments)
        if len(calls) == (3 if failing == "fdopen" else 1):
            raise OSError(28, "No space left on device")
        return real(*arguments, **more)

    for folder in ("old", "new"):
        calls.clear()
        with monkeypatch.context() as patch:
            patch.setattr(os, failing, full_disk)
            with pytest.raises(fs.InputError, match="cannot be written: No space left"):
                fs.write_matrices(tmp_path / folder, fs.Substructure(2 * sub.M, sub.K))
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    assert not (tmp_path / "new").exists()
