"""For the tests of matrix files: text as Abaqus and CalculiX write it, and matrices equal to the last digit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs


def same(first: Any, second: Any) -> None:
    """Equal to the last digit, sparse where it was sparse."""
    assert sp.issparse(first) == sp.issparse(second) and first.shape == second.shape
    assert abs(first - second).max() == 0


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


class Op2Writer:
    """Writes .op2 files record by record, as Nastran does: each record between two copies of its length."""

    def __init__(self, order: str = "<", word: int = 4) -> None:
        self.order, self.word, self.bytes = order, word, b""
        self.keys(3).record(self.words(11, 25, 26)).keys(7).record(b"NASTRAN FORT TAPE ID CODE - ".ljust(7 * word))
        self.keys(2).record(b"XXXXXXXX".ljust(2 * word)).keys(-1, 0)

    def words(self, *numbers: int) -> bytes:
        return np.array(numbers).astype(f"{self.order}i{self.word}").tobytes()

    def record(self, data: bytes) -> Op2Writer:
        length = np.array([len(data)]).astype(f"{self.order}i4").tobytes()
        self.bytes += length + data + length
        return self

    def keys(self, *numbers: int) -> Op2Writer:
        for number in numbers:
            self.record(self.words(number))
        return self

    def block(self, name: str, trailer: Sequence[int], kind: int) -> Op2Writer:
        label = name.ljust(8).encode().ljust(2 * self.word)
        self.keys(2).record(label).keys(-1, 7).record(self.words(*trailer)).keys(-2, 1, 0, 2).record(label).keys(-3, 1, kind)
        return self

    def matrix(self, name: str, matrix: Any, kind: int = 2) -> Op2Writer:
        """Column by column, strings of entries that are not 0; kind 1, 2 real, 3, 4 complex, of single and double precision."""
        A = matrix.toarray() if sp.issparse(matrix) else np.asarray(matrix)
        size = (self.word if kind % 2 else 8) * (1 if kind < 3 else 2)
        form = 6 if A.shape[0] == A.shape[1] and (A == A.T).all() else 2
        self.block(name, (101, A.shape[1], A.shape[0], form, kind, 0, 0), 1)
        for j, column in enumerate(A.T):
            starts = [i for i in np.flatnonzero(column) if i == 0 or not column[i - 1]]
            for i in starts:
                rest = np.flatnonzero(column[i:] == 0)
                values = column[i:i + rest[0]] if len(rest) else column[i:]
                data = values.astype(f"{self.order}{'f' if kind < 3 else 'c'}{size}").tobytes()
                self.keys(len(data) // self.word).record(self.words(i + 1) + data)
            self.keys(-4 - j, 1, int(j + 1 < A.shape[1]))
        return self.keys(0)

    def table(self, name: str, *records: bytes) -> Op2Writer:
        self.block(name, (101, 0, 0, 0, 0, 0, 0), 0)
        for j, data in enumerate(records):
            self.keys(len(data) // self.word).record(data).keys(-4 - j, 1, 0)
        return self.keys(0)

    def dmig(self, name: str, rows: Sequence[tuple[int, int]], matrix: Any) -> Op2Writer:
        """A symmetric DMIG table of double precision; columns of scalar points have direction 1, their rows 0."""
        data = self.words(114, 1, 120, 0, 0, 0, 6, 2, 2, 0, 0, len(rows))
        for j, (node, direction) in enumerate(rows):
            data += self.words(node, direction or 1)
            for i in [i for i in np.flatnonzero(matrix[:, j]) if i <= j]:
                data += self.words(*rows[i]) + np.array([matrix[i, j]]).astype(f"{self.order}f8").tobytes()
            data += self.words(-1, -1)
        return self.table(name, data, self.words(65535, 65535, 65535))

    def write(self, path: Path) -> Path:
        path.write_bytes(self.keys(0).bytes)
        return path


def superelement_op2(path: Path, part: fs.ReducedSubstructure) -> Path:
    """As EXTSEOUT(DMIGOP2) of Simcenter Nastran writes it: a table of contents, EXTRN, GRID, SPOINT, MATK, MATM, TUG1, MUG1."""
    file, dofs, full = Op2Writer(), part.interface_dofs, part.full_dofs
    assert dofs is not None and dofs.points is not None and full is not None
    names = ("PVT0", "GEOM1EX", "GEOM2EX", "MATK", "MATM", "TUG1", "MUG1")
    file.table("XSOP2DIR", *(name.ljust(8).encode() for name in names)).table("PVTS", file.words(1, 2, 3))
    nodes, first = np.unique(dofs.nodes, return_index=True)
    scalar = [900 + at for at in range(part.modes)]
    extrn = [word for node in nodes for word in (node, int("".join(str(k + 1) for k in dofs.components[dofs.nodes == node])))]
    grids = b"".join(file.words(node, 0) + place.astype("<f8").tobytes() + file.words(0, 0, 0)
                     for node, place in zip(nodes, dofs.points[first], strict=True))
    file.table("EXTDB", file.words(1627, 16, 463, *extrn, *(word for one in scalar for word in (one, 1)), -1, -1),
               file.words(4501, 45, 1120001) + grids, file.words(65535, 65535, 25535))
    file.table("EXTDB", file.words(5551, 49, 105, *scalar))
    rows = [*zip(dofs.nodes.tolist(), (dofs.components + 1).tolist(), strict=True), *((one, 0) for one in scalar)]
    order = sorted(range(len(rows)), key=lambda at: rows[at])  # `part` has its boundary in another order
    rows, square = [rows[at] for at in order], np.ix_(order, order)
    file.dmig("EXTDB", rows, part.K[square]).dmig("EXTDB", rows, part.M[square])
    inner, index = np.unique(full.nodes, return_inverse=True)
    table = np.zeros((6 * len(inner), part.size))
    table[6 * index + full.components] = part.V[:, order]
    tug1 = [word for at, node in enumerate(inner) for word in (1, node, 6, 6 * at + 1, 0)]
    file.table("EXTDB", file.words(1, 0), file.words(*[0] * 10, *tug1))
    return file.matrix("EXTDB", table).write(path)


def sierra_text(folder: Path, name: str, part: fs.Substructure) -> tuple[Path, Path]:
    """NAME_Maa.m, NAME_Kaa.m, NAME_gid.m and NAME_ASetMap.m as Sierra/SD writes them; the first two."""
    assert part.dofs is not None
    for key, matrix in (("Maa", part.M), ("Kaa", part.K)):
        half = sp.coo_array(sp.tril(matrix))
        lines = "".join(f"{i + 1} {j + 1} {value:.17g};\n" for i, j, value in zip(half.row, half.col, half.data, strict=True))
        n = part.size
        (folder / f"{name}_{key}.m").write_text(
            f"function a={key}()\nNumRows = {n};\na=[\n{lines}];\na=sparse(a(:,1),a(:,2),a(:,3),{n},{n});\n"
            f"disp('This Matrix is in a Symmetric Sparse Format (Lower Triangular)')\n%% matrix written from lmatrix {key}\n")
    nodes = np.unique(part.dofs.nodes)[::-1]  # not in ascending order
    place = 9 * (len(nodes) - 1 - np.searchsorted(nodes[::-1], part.dofs.nodes)) + part.dofs.components
    for key, size, pairs in (("gid", len(nodes), enumerate(nodes.tolist())),
                             ("ASetMap", 9 * len(nodes), sorted(zip(place.tolist(), range(1, part.size + 1), strict=True)))):
        text = "".join(f"x({at + 1}) = {value};\n" for at, value in pairs)
        (folder / f"{name}_{key}.m").write_text(f"function x = {name}()\n% vector output\nx = zeros({size}, 1);\n{text}")
    return folder / f"{name}_Maa.m", folder / f"{name}_Kaa.m"


def sierra_netcdf(path: Path, part: fs.ReducedSubstructure, without: str = "") -> Path:
    """A Craig-Bampton model as Sierra/SD writes it with format = netcdf: its modes come first."""
    from scipy.io import netcdf_file

    dofs = part.interface_dofs
    assert dofs is not None and dofs.points is not None
    order = [*np.setdiff1d(np.arange(part.size), part.interface), *part.interface]
    nodes, first = np.unique(dofs.nodes, return_index=True)
    rows = np.zeros((part.size, 2), dtype=np.int32)
    rows[part.modes:] = np.stack([dofs.nodes, dofs.components + 1], axis=1)
    square = np.ix_(order, order)
    with netcdf_file(path, "w", version=2) as file:
        for name, size in (("NumDof", part.size), ("two", 2), ("num_nodes", len(nodes))):
            file.createDimension(name, size)
        for name, values in {"Kr": part.K[square], "Mr": part.M[square], "Cr": part.D[square], "cbmap": rows,
                             "node_num_map": nodes.astype(np.int32),
                             **{f"coord{'xyz'[k]}": dofs.points[first, k] for k in range(3)}}.items():
            if name != without:
                sizes = ("num_nodes",) if values.ndim == 1 else ("NumDof", "two" if name == "cbmap" else "NumDof")
                file.createVariable(name, values.dtype.char, sizes)[:] = values
    return path
