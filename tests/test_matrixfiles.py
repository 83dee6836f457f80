"""Single matrix files: each format read from what another hand wrote, which of several matrices, files cut short."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrixhelp import abaqus, numbered, same

import femsub as fs
from femsub.checks import installed_by


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
    (tmp_path / "model.mat").write_bytes(b"MATLAB 7.3".ljust(512) + b"\x89HDF\r\n")
    for module in ("pyyeti.nastran.op4", "pyyeti.nastran", "pyyeti", "h5py"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(fs.MissingPackageError, match="-v7"):
        fs.read_matrix(tmp_path / "model.mat")
    with pytest.raises(fs.MissingPackageError, match=re.escape(installed_by("pyyeti"))):
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
    with pytest.raises(fs.InputError, match=r"M: .*M.mtx|M is .*M.sti|are not in M"):
        fs.read_component(*paths)


@pytest.mark.parametrize(("first", "second"), [("beam.sti", "beam.mas"), ("K.mtx", "M.mtx"),
                                               ("part_stiffness.mtx", "part-mass.mtx")])
def test_files_in_each_others_place_are_told_by_their_names(tmp_path: Path, first: str, second: str) -> None:
    full = fs.chain(10)
    for name, matrix in ((first, full.K), (second, full.M)):
        file = sp.coo_array(sp.tril(matrix))
        if name.endswith("mtx"):
            scipy.io.mmwrite(tmp_path / name, sp.coo_matrix(matrix), precision=17)
        else:
            (tmp_path / name).write_text("".join(f"{i + 1} {j + 1} {value!r}\n" for i, j, value in
                                                 zip(file.row.tolist(), file.col.tolist(), file.data.tolist(), strict=True)))
    with pytest.raises(fs.InputError, match=r"which by its name holds a stiffness matrix.*The mass comes first"):
        fs.read_component(tmp_path / first, tmp_path / second)
    assert np.array_equal(fs.read_component(tmp_path / second, tmp_path / first).K.toarray(), full.K.toarray())


def test_files_in_each_others_place_are_told_by_what_is_in_them(tmp_path: Path) -> None:
    full = fs.chain(10)
    for name, matrix in (("one.mtx", full.K), ("two.mtx", full.M)):
        scipy.io.mmwrite(tmp_path / name, sp.coo_matrix(matrix), precision=17)
    with pytest.warns(fs.FemsubWarning, match="M and K of 'two' seem to be in each other's place"):
        fs.read_component(tmp_path / "one.mtx", tmp_path / "two.mtx")
    fs.read_component(tmp_path / "two.mtx", tmp_path / "one.mtx")  # a warning would be an error


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("count", [1, 4, 8, 20, 128])
def test_nul_bytes_before_a_file_of_matlab_are_no_matrix(count: int, old: bool, tmp_path: Path) -> None:
    """The text of a head, shifted, was read as the size of a matrix: (0, 1280590157)."""
    path = tmp_path / "K.mat"
    scipy.io.savemat(path, {"K": np.eye(3), "L": np.eye(2)}, format="4" if old else "5")
    assert fs.read_matrix(path, "L").shape == (2, 2)
    path.write_bytes(bytes(count) + path.read_bytes())
    with pytest.raises(fs.InputError, match=r"K\.mat"):
        fs.read_matrix(path, "K")
    with pytest.raises(fs.InputError, match=r"K\.mat"):
        fs.read_matrix(path)


def test_an_empty_name_is_no_file(tmp_path: Path) -> None:
    """K = '' ended in a KeyError; D = '' means that there is none."""
    fs.write_matrices(tmp_path, fs.chain(3))
    with pytest.raises(fs.InputError, match="K: there is no file"):
        fs.read_component(tmp_path / "M.mtx", "")
    assert not fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx", "").D.nnz


def test_a_struct_of_matlab_has_a_remedy(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "model.mat", {"sys": {"M": np.eye(2), "K": np.eye(2)}})
    with pytest.raises(fs.InputError, match=r"holds no matrix.*save\('file.mat', '-struct', 'name'\)"):
        fs.read_matrix(tmp_path / "model.mat")
    scipy.io.savemat(tmp_path / "model.mat", {"M": np.eye(2), "K": np.eye(2)})  # as the remedy writes it
    assert np.array_equal(fs.read_matrix(tmp_path / "model.mat", "K"), np.eye(2))
