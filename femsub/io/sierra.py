"""Sierra/SD: the text files of its full matrices (Kaa, Maa, gid, ASetMap), and its Craig-Bampton models in netCDF."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, warn
from femsub.io.abaqus_calculix import TextMatrix
from femsub.io.damage import assembled, check_extent, check_room

# ++ does not backtrack, so that text that does not fit is refused in linear time
NUMBER = rb"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
MATRIX = re.compile(rb"\s*function a=(\w+)\(\)\s+NumRows = (\d{1,15});\s+a=\[\s+((?:\d{1,15} \d{1,15} " + NUMBER + rb";\s++)+)\]"
                    rb";?\s+a=sparse\(a\(:,1\),a\(:,2\),a\(:,3\),(\d{1,15}),(\d{1,15})\);\s+"
                    rb"disp\('This Matrix is in a Symmetric Sparse Format \(Lower Triangular\)'\)\s")
MAP = re.compile(rb"\s*function x = \w+\(\)\s+(?:%[^\n]*+\s++)*x = zeros\((\d{1,15}), ?1\);\s+"
                 rb"((?:x\(\d{1,15}\) = \d{1,15};\s++)*)\Z")


def labelled_mfile(path: Path) -> dict[str, TextMatrix]:
    """The matrix of X_Kaa.m or X_Maa.m, shape (n, n); with node and direction of its rows, if X_gid.m and X_ASetMap.m are there.

    ===================  =======================================================================================
    it reads             the lower triangle of a symmetric matrix, as Sierra/SD writes it (KAA, MAA, MFILE)
    it refuses           all other text, an entry twice or outside, a file without its end, maps of another size
    it cannot know       whether lines or digits are missing: the format counts nothing
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    found = MATRIX.match(path.read_bytes())
    if not found:
        raise InputError(f"{path} is no matrix of Sierra/SD, 'function a=Kaa()' to 'Symmetric Sparse Format': is it cut short?")
    sizes = {int(found[at]) for at in (2, 4, 5)}
    table = np.array(found[3].replace(b";", b" ").split(), dtype=float).reshape(-1, 3)
    i, j = (table[:, at].astype(np.int64) - 1 for at in (0, 1))
    size = sizes.pop()
    if sizes or j.min() < 0 or (j > i).any() or i.max() >= size:
        raise InputError(f"{path} is damaged: it has an entry above the diagonal or beyond {size} rows, or two numbers of rows")
    check_extent(path, (size, size), len(table))
    if re.search(rb"\n\s*?\n", found[3].rstrip()):
        warn(f"{path} has an empty line among its entries, which Sierra/SD does not write: is an entry lost?")
    if not np.isfinite(table[:, 2]).all():
        raise InputError(f"{path} has a number beyond all limits in row {int(i[~np.isfinite(table[:, 2])][0]) + 1}")
    matrix = assembled(str(path), i, j, table[:, 2], (size, size), np.positive)
    if len(bare := np.flatnonzero((matrix.diagonal() == 0) & (abs(matrix).sum(axis=1) > 0))):
        warn(f"{path} has no entry on the diagonal of {len(bare)} rows that have other entries, first in row {bare[0] + 1}: a "
             "stiffness or mass has lost an entry")
    # node and direction of the rows, by the maps beside the file if they are there
    name = found[1].decode().lower()
    gid, places = (path.with_name(f"{path.stem.rpartition('_')[0]}_{what}.m") for what in ("gid", "ASetMap"))
    if not gid.is_file() or not places.is_file():
        return {name: TextMatrix(matrix)}
    nodes, rows = _map(gid), _map(places)
    at = np.flatnonzero(rows)
    per_node = 9  # places in ASetMap: three translations, three rotations, and three of other physics
    if len(rows) != per_node * len(nodes) or not np.array_equal(np.sort(rows[at]), np.arange(1, size + 1)):
        raise InputError(f"{places} and {gid} do not fit {path}: they name {len(at)} DOF of {len(nodes)} nodes, and the matrix "
                         f"has {size} rows")
    labels = np.zeros((size, 2), dtype=np.int64)
    labels[rows[at] - 1] = np.stack([nodes[at // per_node], at % per_node + 1], axis=1)
    order = np.lexsort((labels[:, 1], labels[:, 0]))
    return {name: TextMatrix(sp.csr_array(matrix[order][:, order]), labels[order])}


def _map(path: Path) -> Array:
    """The vector of a map's file; 0 in places that the file does not list."""
    found = MAP.match(path.read_bytes())
    if not found:
        raise InputError(f"{path} is no map of Sierra/SD, 'x = zeros(n, 1)' and lines 'x(1) = 26;'; it may be cut short")
    size, pairs = int(found[1]), np.array(re.findall(rb"\d+", found[2]), dtype=np.int64).reshape(-1, 2)
    check_extent(path, (size, 1), len(pairs))
    if len(pairs) and (pairs[:, 0].min() < 1 or pairs[:, 0].max() > size or len(np.unique(pairs[:, 0])) < len(pairs)):
        raise InputError(f"{path} names a place beyond its {size}, or one twice; it is damaged")
    vector = np.zeros(size, dtype=np.int64)
    vector[pairs[:, 0] - 1] = pairs[:, 1]
    return vector


def read_cbr(path: Path) -> tuple[list[Array], Array, dict[int, list[float]]]:
    """M, K and D of a Craig-Bampton model of Sierra/SD (CBMODEL, format = netcdf); (node, direction) of each row; nodes' places.

    Modes are rows of the node 0.

    ===================  =======================================================================================
    it reads             Kr, Mr, Cr, cbmap and the nodes' places from a file of netCDF 3
    it refuses           netCDF 4, variables that are missing or of another size, nodes without a place
    it cannot know       whether a number is wrong; up to which frequency modes were kept
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    from scipy.io import netcdf_file

    check_room(path, 2 * path.stat().st_size)
    content = path.read_bytes()
    if content[:4] == b"\x89HDF":
        raise InputError(f"{path} is of netCDF 4. Convert it: nccopy -k classic {path.name} new.nc")
    if content[:3] != b"CDF":
        raise InputError(f"{path} is no netCDF file")
    with netcdf_file(io.BytesIO(content), mmap=False) as found:  # from a file, SciPy would allocate any wrong size
        needed = ("Kr", "Mr", "cbmap", "node_num_map", "coordx", "coordy", "coordz")
        if missing := [name for name in needed if name not in found.variables]:
            raise InputError(f"{path} is no Craig-Bampton model of Sierra/SD: it has no {', '.join(missing)}")
        K, M, rows, nodes, *where = (np.array(found.variables[name][:]) for name in needed)
        parts = [np.asarray(one.data).tobytes() for one in found.variables.values() if not one.isrec]
        records = any(one.isrec for one in found.variables.values())
        D = np.array(found.variables["Cr"][:]) if "Cr" in found.variables else np.zeros_like(K)
    # values are filled up to a multiple of four bytes
    if not records and not any(part and content.endswith(part + bytes(-len(part) % 4)) for part in parts):
        warn(f"{path} does not end with the values of its last variable: bytes are missing or too many, and its numbers may be "
             "wrong. Write it again")
    n = len(K)
    if {A.shape for A in (K, M, D)} != {(n, n)} or rows.shape != (n, 2) or len({len(nodes), *map(len, where)}) != 1:
        raise InputError(f"{path} is damaged: Kr, Mr, Cr and cbmap, or nodes and places, are of different sizes")
    points = {int(node): [float(one) for one in place] for node, *place in zip(nodes, *where, strict=True)}
    if strange := sorted({int(node) for node in rows[:, 0] if node} - points.keys()):
        raise InputError(f"{path} has no place of node {strange[0]}, which cbmap names")
    return [np.asarray(A, dtype=float) for A in (M, K, D)], rows.astype(np.int64), points
