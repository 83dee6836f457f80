"""Matrix files that are wrong, odd or damaged: each is read as it is meant or refused, and none takes the interpreter down."""

from __future__ import annotations

import contextlib
import io
import struct
import subprocess
import sys
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrixhelp import same

import femsub as fs

REAL = "%%MatrixMarket matrix coordinate real general\n"
K3 = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])


def market(tmp_path: Path, text: str) -> Any:
    (tmp_path / "K.mtx").write_text(text)
    return fs.read_matrix(tmp_path / "K.mtx")


@pytest.mark.parametrize("word", ["2.5D+03", "2.5d+03", "2.5D03", "+2.5e3", "2500", "2500.", ".25E4", "2.5e+003", "2.5D3"])
def test_numbers_of_fortran_and_others(tmp_path: Path, word: str) -> None:
    for text in (f"2 2 2\n1 1 {word}\n2 2 -1.0\n", f"2 2 2\r\n 1\t1   {word} \r\n\r\n2 2 -1.0\r\n"):
        assert market(tmp_path, REAL + text).toarray().tolist() == [[2500.0, 0.0], [0.0, -1.0]]
    assert market(tmp_path, f"%%MatrixMarket matrix array real general\n% a\n1 2\n{word}\n1\n").tolist() == [[2500.0, 1.0]]
    (tmp_path / "K.sti").write_text(f"1 1 {word}\n2 2 -1.0\n")
    assert fs.read_matrix(tmp_path / "K.sti").toarray().tolist() == [[2500.0, 0.0], [0.0, -1.0]]


def test_fortran_leaves_the_letter_out_at_three_digits(tmp_path: Path) -> None:
    assert market(tmp_path, REAL + "1 2 2\n1 1 2.5+103\n1 2 -2.5-103\n").toarray().tolist() == [[2.5e103, -2.5e-103]]
    (tmp_path / "K.mtx").write_text("1,1, 1,1, 2.5+103\n")
    assert fs.read_matrix(tmp_path / "K.mtx").toarray().tolist() == [[2.5e103]]


@pytest.mark.parametrize("word", ["2,5", "2.5xyz", "0x10", "2.5+3", "1.2.3", "1e5e5", "1e5.5", "1e", "--1", "2.5 7", "1_0", "٣",
                                  "1e400", "", ".", "-", "2.5D", "#"])
def test_words_that_are_no_numbers(tmp_path: Path, word: str) -> None:
    """Each is refused, most with line and word; SciPy's reader takes the beginning of a word for the number."""
    with pytest.raises(fs.InputError, match=r"K\.mtx.*(data line 2|too large for a double)") as caught:
        market(tmp_path, REAL + f"2 2 2\n1 1 1.0\n2 2 {word}\n")
    assert word in ("1e400", "", "2.5 7") or repr(word) in str(caught.value)
    with pytest.raises(fs.InputError, match=r"K\.mtx"):
        market(tmp_path, f"%%MatrixMarket matrix array real general\n2 1\n1.0\n{word}\n")
    (tmp_path / "K.sti").write_text(f"1 1 1.0\n2 2 {word}\n", encoding="utf-8")
    with pytest.raises(fs.InputError, match=r"K\.sti"):
        fs.read_matrix(tmp_path / "K.sti")


@pytest.mark.parametrize("word", ["nan", "NaN", "inf", "-Inf"])
def test_nan_that_a_program_wrote(tmp_path: Path, word: str) -> None:
    """It is what the matrix holds, and no component."""
    assert not np.isfinite(market(tmp_path, REAL + f"2 2 2\n1 1 1.0\n2 2 {word}\n")[1, 1])
    with pytest.raises(fs.InputError, match="holds a NaN or Inf, first at row 1, column 1"):
        fs.read_component(tmp_path / "K.mtx", tmp_path / "K.mtx")


@pytest.mark.parametrize(("text", "words"), [
    (REAL + "2 2 1\n1 1.5 2\n", "'1.5' in data line 1 is not a whole number"),
    (REAL + "2 2 1\n1.0 1 2\n", "'1.0' in data line 1 is not a whole number"),
    (REAL + "2 2 1\n1 1e0 2\n", "'1e0' in data line 1 is not a whole number"),
    (REAL + "2 2 2\n1 1\n2 2 2 2\n", "data line 1 has 2 values, not 3"),
    (REAL + "2 2 2\n1 1 1 1\n2 2 2\n", "data line 1 has 4 values, not 3"),
    (REAL + "2 2 2\n1 1 1\n3 2 2\n", "out of bounds"),
    (REAL + "2 2 2\n1 1 1\n0 2 2\n", "out of bounds"),
    (REAL + "2 2 2\n1 1 1\n1 1 2\n", "lists an entry twice: row 1, column 1"),
    (REAL + "2 2 1\n1 1 1\n2 2 2\n", "announces 2 x 2 with 1 entries, but has 2"),
    (REAL + "2 2 3\n1 1 1\n2 2 2.00\n", "announces 2 x 2 with 3 entries, but"),
    (REAL + "2 2 2 2\n1 1 1\n2 2 2\n", "must have rows, columns and entries, but is '2 2 2 2'"),
    (REAL + "2 2.0 2\n1 1 1\n2 2 2\n", "must have rows, columns and entries, but is '2 2.0 2'"),
    (REAL + "4000000000 4000000000 1\n1 1 1.0\n", "4000000000 x 4000000000, but holds 1 entries"),
    (REAL + "2 2 4000000000\n1 1 1.0\n", "with 4000000000 entries, but only"),
    (REAL.replace("coordinate", "array") + "4000000000 4000000000\n1.0\n", "4000000000 x 4000000000 with"),
    (REAL.replace("general", "symmetric") + "2 2 3\n1 1 2\n1 2 -1\n2 1 -1\n", "of a symmetric matrix one triangle only"),
    (REAL.replace("general", "symmetric") + "2 3 1\n1 1 2\n", "is symmetric, but has 2 rows and 3 columns"),
    (REAL.replace("general", "skew-symmetric") + "2 2 2\n1 1 2\n2 1 -1\n", "has entries on the diagonal, first in row 1"),
    (REAL.replace("general", "symetric") + "2 2 1\n1 1 2\n", "unknown symmetry 'symetric'; did you mean 'symmetric'"),
    (REAL.replace("real", "reel") + "2 2 1\n1 1 2\n", "unknown field 'reel'; did you mean 'real'"),
    (REAL.replace("real", "pattern") + "2 2 1\n1 1\n", "is a pattern"),
    (REAL.replace("real", "integer") + "2 2 1\n1 1 2.7\n", "'2.7' in data line 1 is not a whole number"),
    (REAL.replace("general", "general too") + "2 2 1\n1 1 2\n", "first line must be"),
    (REAL.replace("real", "complex") + "2 2 1\n1 1 2 3x\n", "'3x' in data line 1 is not a number"),
])
def test_matrix_market_that_is_wrong(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(fs.InputError) as caught:
        market(tmp_path, text)
    assert words in str(caught.value) and "K.mtx" in str(caught.value) and "\n" not in str(caught.value)


def test_a_wrong_word_far_into_a_large_file(tmp_path: Path) -> None:
    """It does not matter how far, nor do Fortran's exponents before it."""
    rows = [f"{row} {row} {row}.25e+00\n" for row in range(1, 201)]
    rows[150] = rows[150].replace("e+00", "D+00")
    same(market(tmp_path, REAL + "200 200 200\n" + "".join(rows)), sp.csr_array(sp.diags_array(np.arange(1, 201) + 0.25)))
    rows[180] = "181 181 2,5\n"
    with pytest.raises(fs.InputError, match="'2,5' in data line 181 is not a number"):
        market(tmp_path, REAL + "200 200 200\n" + "".join(rows))


@pytest.mark.parametrize(("symmetry", "body", "expected"), [
    ("symmetric", "1 1 2\n2 1 -1\n", [[2, -1], [-1, 0]]), ("symmetric", "1 1 2\n1 2 -1\n", [[2, -1], [-1, 0]]),
    ("skew-symmetric", "2 1 -1\n", [[0, 1], [-1, 0]]), ("general", "2 1 -1\n", [[0, 0], [-1, 0]])])
def test_one_triangle_is_mirrored(tmp_path: Path, symmetry: str, body: str, expected: list[list[float]]) -> None:
    header = REAL.replace("general", symmetry) + f"2 2 {len(body.splitlines())}\n"
    assert market(tmp_path, header + body).toarray().tolist() == expected


@pytest.mark.parametrize("sizes", ["coordinate real general\n3 2 0", "array real general\n0 1", "array real symmetric\n0 0"])
def test_no_entries_at_all(tmp_path: Path, sizes: str) -> None:
    """SciPy 1.17's reader crashes on an array of 0 x 1."""
    assert not abs(market(tmp_path, f"%%MatrixMarket matrix {sizes}\n")).sum()


@pytest.mark.parametrize("line", ["2 2 5.0 * 3.0", "2 2 5.0*", "* 2 2 5.0"])
def test_a_star_begins_no_comment_within_a_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "K.sti").write_text(f"** a comment\n1 1 2.0\n** another\n{line}\n")
    with pytest.raises(fs.InputError, match=r"K\.sti"):
        fs.read_matrix(tmp_path / "K.sti")
    (tmp_path / "K.sti").write_text("** a comment\n1 1 2.0\n** another\n2 2 5.0\n")
    assert fs.read_matrix(tmp_path / "K.sti").toarray().tolist() == [[2.0, 0.0], [0.0, 5.0]]


@pytest.mark.parametrize("line", ["99999999999 99999999999 1.0", "1e300 1 1.0"])
def test_row_numbers_far_beyond_the_entries(tmp_path: Path, line: str) -> None:
    (tmp_path / "K.sti").write_text(f"1 1 2.0\n{line}\n")
    with pytest.raises(fs.InputError, match=r"K\.sti"):
        fs.read_matrix(tmp_path / "K.sti")


# --- NumPy and SciPy ------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize(("array", "words"), [
    (np.array([["2026-01-01"]], dtype="M8[D]"), "dates"), (np.array([[5]], dtype="m8[s]"), "spans of time"),
    (np.array([["1.0"]]), "text"), (np.array([[b"1.0"]]), "text"), (np.zeros((2, 2), dtype=[("a", float)]), "records"),
    (np.zeros((2, 2, 2)), r"the shape \(2, 2, 2\)"), (np.array(1.0), r"the shape \(\)")])
def test_npy_that_is_no_matrix(tmp_path: Path, array: Any, words: str) -> None:
    np.save(tmp_path / "K.npy", array)
    with pytest.raises(fs.InputError, match=words):
        fs.read_matrix(tmp_path / "K.npy")


def test_npy_of_another_length(tmp_path: Path) -> None:
    np.save(tmp_path / "K.npy", K3)
    content = (tmp_path / "K.npy").read_bytes()
    for damaged in (content + b"\0", content[:-1], content.replace(b"(3, 3)", b"(3, 2)"),
                    content.replace(b"(3, 3), }    ", b"(3, 40000), }")):
        (tmp_path / "K.npy").write_bytes(damaged)
        with pytest.raises(fs.InputError, match=r"K\.npy"):
            fs.read_matrix(tmp_path / "K.npy")


def saved(path: Path, **parts: Any) -> Path:
    np.savez(path, **parts)
    return path


CSR = {"format": "csr", "shape": (3, 3), "data": np.ones(2), "indices": np.array([0, 1]), "indptr": np.array([0, 1, 2, 2])}


def refused_in_one_process(paths: list[Path]) -> None:
    """In a process of its own: converting such a matrix writes where it may not. Each file is refused, and named."""
    code = ("import sys\nimport femsub as fs\nfor path in sys.argv[1:]:\n"
            "    try: fs.read_matrix(path)\n    except fs.InputError as error: print(repr(str(error)), flush=True)\n"
            "    else: print(path, 'was read', flush=True)")
    done = subprocess.run([sys.executable, "-c", code, *map(str, paths)], capture_output=True, text=True, check=False)
    said = done.stdout.splitlines()
    assert done.returncode == 0 and len(said) == len(paths), (said[-1:], done.stderr)
    assert not [line for path, line in zip(paths, said, strict=True) if path.name not in line or line.endswith("was read")]


WRONG_CSR: list[dict[str, Any]] = [
    {"indices": np.array([0, 3])}, {"indices": np.array([0, -1])}, {"indices": np.array([0, 10 ** 9])},
    {"indptr": np.array([0, 9, 2, 2])}, {"indptr": np.array([0, 2 ** 30, 0, 0])},
    {"indptr": np.array([0, 1, 2, 3])}, {"indptr": np.array([5, 1, 2, 2])},
    {"format": "csc", "indices": np.array([0, 10 ** 9])},
    {"shape": (2, 3)}, {"shape": (-3, 3)}, {"shape": (3, 3, 3)}, {"shape": (4_000_000_000, 3)}, {"shape": (3, 4_000_000_000)},
    {"format": "xyz"}, {"format": 5}, {"data": np.array(["a", "b"])}, {"indices": np.array([0.0, 1.0])},
    {"format": "bsr", "data": np.ones((2, 1, 1)), "indices": np.array([0, 10 ** 9])},
    {"format": "coo", "row": np.array([0, 10 ** 9]), "col": np.array([0, 1])},
    {"format": "coo", "row": np.array([0, -1]), "col": np.array([0, 1])}]


def test_npz_with_wrong_indices(tmp_path: Path) -> None:
    refused_in_one_process([saved(tmp_path / f"K{at}.npz", **(CSR | change)) for at, change in enumerate(WRONG_CSR)])


@pytest.mark.parametrize("format", ["csr", "csc", "coo", "bsr", "dia"])
def test_npz_of_each_format(tmp_path: Path, format: str) -> None:
    sp.save_npz(tmp_path / "K.npz", getattr(sp, f"{format}_array")(K3))
    same(fs.read_matrix(tmp_path / "K.npz"), sp.csr_array(K3))


def test_npz_whose_members_are_wrong(tmp_path: Path) -> None:
    file = io.BytesIO()
    np.save(file, np.zeros((4, 4)))
    huge = file.getvalue().replace(b"(4, 4), }", b"(400000, 400000), }"[:9].ljust(9))
    for name, content in (("K.npy", file.getvalue()[:-8]), ("K.txt", b"1 2"), ("K.npy", huge)):
        with zipfile.ZipFile(tmp_path / "K.npz", "w") as archive:
            archive.writestr(name, content)
        with pytest.raises(fs.InputError, match=r"K\.npz"):
            fs.read_matrix(tmp_path / "K.npz")


# --- MATLAB ---------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("format", ["4", "5", "5-packed"])
def test_matlab_of_every_kind(tmp_path: Path, format: str) -> None:
    """Numbers of each kind as SciPy reads them; what is no matrix is passed over."""
    rng = np.random.default_rng(0)
    parts = {"K": K3, "S": sp.csc_array(K3), "C": K3 + 2j * K3.T, "SC": sp.csc_array(K3 + 2j * K3.T),
             "row": np.arange(4.0)[None], "empty": sp.csc_array((3, 3)), "none": np.zeros((0, 0)),
             "wide": sp.csc_array(rng.random((3, 90)) * (rng.random((3, 90)) < 0.3)),
             "i4": np.arange(6, dtype=np.int32).reshape(2, 3), "f4": K3.astype(np.float32), "text": "hello"}
    if format != "4":
        parts |= {"u1": np.eye(3, dtype=np.uint8), "i8": np.array([[2 ** 40]]), "bool": np.eye(2, dtype=bool),
                  "record": {"a": 1.0}, "cells": np.array(["x", 1.0], dtype=object), "cube": np.zeros((2, 2, 2)),
                  "B": sp.csc_array(np.eye(3, dtype=bool))}
    scipy.io.savemat(tmp_path / "m.mat", parts, format=format[0], do_compression="packed" in format)
    for name, value in parts.items():
        if name in ("text", "record", "cells", "cube"):
            with pytest.raises(fs.InputError, match="has no matrix"):
                fs.read_matrix(tmp_path / "m.mat", name)
        else:
            read = fs.read_matrix(tmp_path / "m.mat", name)
            assert sp.issparse(read) == sp.issparse(value) and read.shape == value.shape
            assert np.array_equal(*(part.toarray() if sp.issparse(part) else part for part in (read, value)))


def big_endian() -> bytes:
    """Two matrices as a machine of the other byte order writes them, the sparse one packed."""
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(">2I", kind, len(data)) + data + bytes(-len(data) % 8)

    def array(flags: int, name: bytes, *parts: bytes) -> bytes:
        return element(14, element(6, struct.pack(">2I", flags, 9)) + element(5, struct.pack(">2i", 3, 3)) + element(1, name)
                       + b"".join(parts))

    K = sp.csc_array(K3)
    full = array(6, b"K", element(9, K3.T.astype(">f8").tobytes()))
    sparse = array(5, b"S", element(5, K.indices.astype(">i4").tobytes()), element(5, K.indptr.astype(">i4").tobytes()),
                   element(9, K.data.astype(">f8").tobytes()))
    packed = zlib.compress(sparse)
    return b"MATLAB 5.0".ljust(124) + b"\1\0MI" + full + struct.pack(">2I", 15, len(packed)) + packed


def test_matlab_of_the_other_byte_order(tmp_path: Path) -> None:
    (tmp_path / "m.mat").write_bytes(big_endian())
    same(fs.read_matrix(tmp_path / "m.mat", "K"), K3)
    same(fs.read_matrix(tmp_path / "m.mat", "S"), sp.csr_array(K3))
    assert np.array_equal(scipy.io.loadmat(tmp_path / "m.mat")["K"], K3)


def sparse_mat(path: Path, rows: Any, starts: Any) -> Path:
    K = sp.csc_array(K3)
    K.indices, K.indptr = np.array(rows, dtype=np.int32), np.array(starts, dtype=np.int32)
    whole = io.BytesIO()
    scipy.io.savemat(whole, {"K": sp.csc_array(K3)})
    good = sp.csc_array(K3)
    content = whole.getvalue().replace(good.indices.astype("<i4").tobytes(), K.indices.tobytes())
    path.write_bytes(content.replace(good.indptr.astype("<i4").tobytes(), K.indptr.tobytes()))
    return path


WRONG_CSC = [
    ([0, 1, 0, 1, 2, 1, 10 ** 9], [0, 2, 5, 7]), ([0, 1, 0, 1, 2, 1, -5], [0, 2, 5, 7]), ([0, 1, 0, 1, 2, 1, 3], [0, 2, 5, 7]),
    ([0, 1, 0, 1, 2, 1, 2], [0, 2, 5, 10 ** 9]), ([0, 1, 0, 1, 2, 1, 2], [0, 5, 2, 7]),
    ([0, 1, 0, 1, 2, 1, 2], [0, 2 ** 30, 5, 0]), ([0, 1, 0, 1, 2, 1, 2], [-1, 2, 5, 7]),
    ([0, 1, 0, 1, 1, 1, 2], [0, 2, 5, 7]), ([0, 1, 1, 0, 2, 1, 2], [0, 2, 5, 7])]


def test_matlab_with_wrong_indices(tmp_path: Path) -> None:
    refused_in_one_process([sparse_mat(tmp_path / f"K{at}.mat", *wrong) for at, wrong in enumerate(WRONG_CSC)])
    same(fs.read_matrix(sparse_mat(tmp_path / "K.mat", [0, 1, 0, 1, 2, 1, 2], [0, 2, 5, 7])), sp.csr_array(K3))


def test_matlab_7_3_with_wrong_indices(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    for rows, starts, shape in (([0, 1, 0, 1, 2, 1, 10 ** 9], [0, 2, 5, 7], 3), ([0, 1, 0, 1, 2, 1, 2], [0, 2, 5, 9], 3),
                                ([0, 1, 0, 1, 2, 1, 2], [0, 2, 5, 7], 4 * 10 ** 9)):
        with h5py.File(tmp_path / "K.mat", "w", userblock_size=512) as file:
            group = file.create_group("K")
            group.attrs["MATLAB_sparse"] = np.uint64(shape)
            for name, part in (("data", sp.csc_array(K3).data), ("ir", rows), ("jc", starts)):
                group[name] = part if name == "data" else np.array(part, np.uint64)
        with pytest.raises(fs.InputError, match=r"K\.mat"):
            fs.read_matrix(tmp_path / "K.mat")


def matlabs_own() -> list[Path]:
    """What MATLAB itself wrote, of every version, in SciPy's tests (which not every package of it brings along)."""
    return sorted((Path(scipy.io.__file__).parent / "matlab" / "tests" / "data").glob("*.mat"))


@pytest.mark.parametrize("path", matlabs_own(), ids=lambda path: path.name)
def test_files_of_matlab_itself(path: Path) -> None:
    """Where SciPy reads a file, the same numbers; where it refuses one, nothing but a refusal or what h5py reads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            content = scipy.io.loadmat(path)
        except Exception:
            content = {}
    wanted = {name: value for name, value in content.items() if not name.startswith("__") and (
        sp.issparse(value) or (isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biufc"))}
    for name, value in wanted.items():
        read, value = (part.toarray() if sp.issparse(part) else part for part in (fs.read_matrix(path, name), value))
        assert np.array_equal(read, value, equal_nan=True)
    if not wanted:
        with contextlib.suppress(fs.FemsubError):
            fs.read_matrix(path)


# --- OP4 ------------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("content", ["dense", "sparse", "bigmat", "nonbigmat", "complex", "several"])
@pytest.mark.parametrize("binary", [True, False])
def test_op4_of_every_kind(tmp_path: Path, content: str, binary: bool) -> None:
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    how = {"sparse": content} if content in ("bigmat", "nonbigmat") else {}
    K = K3 if content == "dense" else K3 + 1j * K3 if content == "complex" else sp.csc_matrix(K3)
    parts = {"k": K}
    if content == "several":
        parts |= {"m": np.eye(3), "zero": np.zeros((3, 2)), "nothing": sp.csc_matrix((4, 3))}
    for endian in "<>" if binary else " ":
        how |= {"endian": endian} if binary else {}
        op4.write(str(tmp_path / "K.op4"), parts, binary=binary, digits=17, **how)
        for name, value in parts.items():
            read = fs.read_matrix(tmp_path / "K.op4", name)
            assert np.array_equal(*(part.toarray() if sp.issparse(part) else part for part in (read, value)))


@pytest.mark.parametrize(("old", "new"), [(b"2.0000", b"2.0_00"), (b"2.0000", b"2.0.00"), (b"     3     ", b"     x     "),
                                          (b"2.0000", "2.00٣".encode()), (b"E+00", b"E+0x")])
def test_op4_text_with_words_that_are_no_numbers(tmp_path: Path, old: bytes, new: bytes) -> None:
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    op4.write(str(tmp_path / "K.op4"), {"k": K3}, binary=False, digits=17)
    content = (tmp_path / "K.op4").read_bytes()
    assert old in content
    (tmp_path / "K.op4").write_bytes(content.replace(old, new, 1))
    with pytest.raises(fs.InputError, match=r"K\.op4"):
        fs.read_matrix(tmp_path / "K.op4")


# --- DOF maps -------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("text", ["1_0,ux\n", "٣,ux\n", "1,ux,nan\n", "99999999999999999999,ux\n", "1,\n", "1.5,ux\n", "1,ux,x\n",
                                  "1.1 2.1\n3.1 4.1\n", "1_0.1\n", "1,ux,0,0,0,0\n", "1,ux", "1.1"])
def test_dof_maps_that_are_wrong(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.csv").write_text(text, encoding="utf-8")
    np.save(tmp_path / "A.npy", np.eye(1))
    with pytest.raises(fs.InputError, match=r"map\.csv"):
        fs.read_component(tmp_path / "A.npy", tmp_path / "A.npy", dofs=tmp_path / "map.csv")


def test_long_names_of_motions_and_many_of_them(tmp_path: Path) -> None:
    """No name is cut, and no index of a motion wraps around."""
    labels = [f"a rather long name of motion number {number}" for number in range(300)]
    model = fs.Substructure(np.eye(300), np.eye(300), dofs=fs.DofMap(np.ones(300, dtype=int), np.arange(300), labels))
    assert model.dofs is not None and model.dofs.name(299) == f"{labels[299]} at node 1"
    fs.write_matrices(tmp_path / "out", model)
    assert fs.read_component(tmp_path / "out").dofs.name(299) == model.dofs.name(299)


@pytest.mark.parametrize(("nodes", "points", "words"), [
    ([1, 2 ** 62], None, "must be below"), (np.array([1, 2 ** 63], dtype=np.uint64), None, "must be below"),
    ([1, 2], [[0.0], [np.nan]], r"first at index \(1, 0\)"), ([1, 2], [[0.0], [1j]], "must be real numbers"),
    ([1, 2], [["0"], ["1"]], "must be real numbers"), ([1, 2], [[0.0], [1.0, 2.0]], "must be rows of the same length"),
    ([1, 2], [0.0, 1.0], "their shape is")])
def test_dof_maps_made_by_hand(nodes: Any, points: Any, words: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        fs.DofMap(nodes, [0, 0], points=points)
