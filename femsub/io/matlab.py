"""MATLAB's .mat files of versions 4, 5 to 7, and 7.3: their real and sparse matrices, each size checked before it is used.

SciPy's reader may crash the interpreter on damaged files (strings, cells, indices of sparse matrices). This one skips everything
but matrices, and checks every number of the file.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix, package
from femsub.errors import InputError
from femsub.io.damage import check_extent, check_room

HDF = b"\x89HDF\r\n"
#: number type of a data element (mi...) and of a numeric class (mx...), as NumPy calls them
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_SPARSE, _MATRIX, _PACKED = 5, 14, 15
_COMPLEX, _LOGICAL = 0x0800, 0x0200  # in the flags of an array
_OLD = ("f8", "f4", "i4", "i2", "u2", "u1")  # number types of version 4


class _Item(NamedTuple):
    kind: int
    data: memoryview


def read_matlab(path: Path) -> dict[str, Matrix]:
    """Name to matrix, shape (n, m), dense or sparse (CSR).

    ===================  =======================================================================================
    it reads             full and sparse matrices, real, complex, integer and logical, of every version from 4
                         to 7.3 (7.3 needs h5py), packed or not, of either byte order
    it passes over       texts, structs, cells, objects, functions, arrays of three and more dimensions
    it refuses           an element that ends behind the file or its own element; indices of a sparse matrix out
                         of range, not ascending or twice; a name twice; a wrong checksum of packed data
    it cannot know       whether a number of unpacked data is wrong: there are no checksums
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        Version 7.3 without h5py.
    """
    with open(path, "rb") as file:
        start = file.read(520)
    if HDF in (start[:6], start[512:518]):
        return _read_hdf(path)
    check_room(path, path.stat().st_size)
    content = path.read_bytes()
    pairs = _version_4(path, content) if 0 in content[:4] else _version_5(path, content)
    found: dict[str, Matrix] = {}
    for name, matrix in pairs:
        if name in found:
            raise InputError(f"{path} holds two matrices called {name!r}. Give them different names")
        found[name] = matrix
    return found


def compressed_columns(path: Path, name: str, values: Array, rows: Array, starts: Array, shape: tuple[int, int]) -> Matrix:
    """The CSR matrix of MATLAB's sparse storage: the entries `starts[j]` to `starts[j + 1]` are column j's, rows ascending."""
    starts, rows, values = starts.ravel().astype(np.int64), rows.ravel().astype(np.int64), values.ravel()
    count = int(starts[-1]) if len(starts) else 0
    if count > min(len(rows), len(values)):
        raise InputError(f"{path}: {name!r} has {min(len(rows), len(values))} of {count} entries; it is damaged or cut short")
    check_extent(path, shape, count)
    try:
        matrix = sp.csc_array((values[:count], rows[:count], starts), shape=shape)
        matrix.check_format(full_check=True)
    except ValueError as error:
        raise InputError(f"{path}: {name!r}, {shape[0]} x {shape[1]}, is damaged: {error}") from None
    if not matrix.has_canonical_format:
        raise InputError(f"{path}: the rows of {name!r} do not ascend in a column, or one is there twice; it is damaged")
    return sp.csr_array(matrix)


def _version_4(path: Path, content: bytes) -> Iterator[tuple[str, Matrix]]:
    place = 0
    while place < len(content):
        if place + 20 > len(content):
            raise InputError(f"{path} is cut short in the header of a matrix; write it again")
        order = "<" if 0 <= struct.unpack_from("<i", content, place)[0] <= 5000 else ">"
        code, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", content, place)
        machine, rest = divmod(code, 1000)
        zero, kind, what = rest // 100, rest // 10 % 10, rest % 10
        if machine != "<>".index(order) or zero or kind >= len(_OLD) or what > 2 or imaginary not in (0, 1) \
                or min(rows, columns) < 0 or length < 1:
            raise InputError(f"{path} is no MATLAB file, or damaged at byte {place}")
        numbers = np.dtype(order + _OLD[kind])
        size = rows * columns * numbers.itemsize
        place += 20 + length
        if place + size * (1 + imaginary) > len(content):
            raise InputError(f"{path} is cut short: a matrix of {rows} x {columns} ends behind the file; write it again")
        name = content[place - length:place].rstrip(b"\0").decode("latin-1")
        parts = [np.frombuffer(content, numbers, rows * columns, place + part * size).reshape((rows, columns), order="F")
                 for part in range(1 + imaginary)]
        place += size * (1 + imaginary)
        whole = parts[0].astype(numbers.newbyteorder("=")) if not imaginary else parts[0] + 1j * parts[1]
        if what == 0:
            yield name, whole
        elif what == 2:
            yield name, _sparse_4(path, name, whole)


def _sparse_4(path: Path, name: str, table: Array) -> Matrix:
    """Row, column and value (real, imaginary) a line, counted from 1; the last line tells the size."""
    if table.shape[1] not in (3, 4) or len(table) < 1 or np.iscomplexobj(table):
        raise InputError(f"{path}: the sparse matrix {name!r} has a table of {table.shape[0]} x {table.shape[1]}; it is damaged")
    places = table[:, :2]
    shape = tuple(places[-1].tolist())
    if not (np.isfinite(places).all() and (places == np.floor(places)).all()) or min(shape) < 0 or max(shape) > 2 ** 31 \
            or (places[:-1] < 1).any() or (places[:-1] > places[-1]).any():
        raise InputError(f"{path}: the sparse matrix {name!r} has entries outside its size; it is damaged")
    values = table[:-1, 2] if table.shape[1] == 3 else table[:-1, 2] + 1j * table[:-1, 3]
    rows, columns = places[:-1].T.astype(np.int64) - 1
    size = int(shape[0]), int(shape[1])
    check_extent(path, size, len(values))
    matrix = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=size))
    if matrix.nnz < len(values):
        raise InputError(f"{path}: the sparse matrix {name!r} lists an entry twice; it is damaged")
    return matrix


def _version_5(path: Path, content: bytes) -> Iterator[tuple[str, Matrix]]:
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")
    if not order or len(content) < 128 or content[125 if order == "<" else 124] != 1:
        raise InputError(f"{path} cannot be read as a matrix: it is no MATLAB file, or cut short; write it again")
    view, place = memoryview(content), 128
    while place < len(content):
        if not any(view[place:]) and len(content) - place < 8:
            return  # zeros that fill up the last word
        item, place = _element(path, view, place, order)
        if item.kind == _PACKED:
            item = _unpacked(path, item.data, order)
        if item.kind != _MATRIX:
            raise InputError(f"{path} holds an element of kind {item.kind} where a matrix should be; it is damaged")
        found = _array(path, item.data, order)
        if found is not None:
            yield found


def _element(path: Path, view: memoryview, place: int, order: str) -> tuple[_Item, int]:
    """The data element at a position, and the position of the next; up to four bytes of data may be in its header."""
    if place + 8 > len(view):
        raise InputError(f"{path} is cut short or damaged: an element has no head; write it again")
    kind, size = struct.unpack_from(f"{order}2I", view, place)
    if kind >> 16:
        kind, size, start, after = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if size > 4:
            raise InputError(f"{path} is damaged: {size} bytes in an element that holds four")
    else:
        start = place + 8
        after = start + size + (0 if kind == _PACKED else -size % 8)
    if start + size > len(view):
        raise InputError(f"{path} is cut short or damaged: an element ends {start + size - len(view)} bytes behind its end; "
                         "write it again")
    return _Item(kind, view[start:start + size]), min(after, len(view))


def _unpacked(path: Path, data: memoryview, order: str) -> _Item:
    """A compressed element, complete and with its checksum; only the beginning if it is not a matrix."""
    stream = zlib.decompressobj()
    try:
        head = stream.decompress(data, 64)
        if len(head) < 24:
            raise InputError(f"{path} is damaged: a packed element ends in its head")
        kind, size = struct.unpack_from(f"{order}2I", head)
        if kind != _MATRIX or not _wanted(head[8:], order):
            return _Item(kind, memoryview(head)[8:])
        check_room(path, size)
        body = head[8:] + (stream.decompress(stream.unconsumed_tail, size - len(head) + 8) if size > len(head) - 8 else b"")
        rest = stream.decompress(stream.unconsumed_tail, 64)
    except zlib.error as error:
        raise InputError(f"{path} is damaged: a packed matrix cannot be unpacked ({error}); write it again") from None
    if len(body) != size or rest.strip(b"\0") or not stream.eof:
        raise InputError(f"{path} is damaged: a packed matrix has another length than it announces; write it again")
    return _Item(kind, memoryview(body))


def _wanted(data: bytes | memoryview, order: str) -> bool:
    """Whether an array's flags, its first element, say that it is a full or sparse matrix."""
    kind, size, flags = struct.unpack_from(f"{order}3I", data)
    return kind == 6 and size == 8 and (flags & 0xFF == _SPARSE or flags & 0xFF in _CLASSES)


def _array(path: Path, data: memoryview, order: str) -> tuple[str, Matrix] | None:
    """Name and matrix of an array; None if it is not a matrix."""
    if len(data) < 16 or struct.unpack_from(f"{order}2I", data) != (6, 8):
        raise InputError(f"{path} is damaged: an array does not begin with its flags")
    if not _wanted(data, order):
        return None
    flags = struct.unpack_from(f"{order}I", data, 8)[0]
    items, place = [], 16
    while place < len(data):
        item, place = _element(path, data, place, order)
        items.append(item)
    is_complex = bool(flags & _COMPLEX)
    wanted = (5 if flags & 0xFF == _SPARSE else 3) + is_complex
    if len(items) != wanted or items[0].kind not in (5, 6) or items[1].kind not in (1, 2, 16):
        raise InputError(f"{path} is damaged: an array has {len(items)} parts, not {wanted}, or others than size, name, ...")
    dims = _numbers(path, items[0], order).tolist()
    name = bytes(items[1].data).decode("latin-1")
    if len(dims) != 2 or not name:  # MATLAB's own workspace of functions has no name
        return None
    if min(dims) < 0:
        raise InputError(f"{path} is damaged: {name!r} has the size {dims[0]} x {dims[1]}")
    shape = int(dims[0]), int(dims[1])
    first = items[-1 - is_complex]
    if flags & 0xFF == _SPARSE and flags & _LOGICAL and first.kind == 9:  # MATLAB calls them doubles, and writes bytes
        first = first._replace(kind=2)
    values = _numbers(path, first, order)
    if is_complex:
        imaginary = _numbers(path, items[-1], order)
        if len(imaginary) != len(values):
            raise InputError(f"{path} is damaged: {name!r} has {len(values)} real and {len(imaginary)} imaginary parts")
        values = values + 1j * imaginary
    if flags & 0xFF == _SPARSE:
        rows, starts = (_numbers(path, item, order) for item in items[2:4])
        return name, compressed_columns(path, name, values.astype(complex if is_complex else float), rows, starts, shape)
    if len(values) != shape[0] * shape[1]:
        raise InputError(f"{path} is damaged: {name!r} is {shape[0]} x {shape[1]}, but has {len(values)} numbers")
    kind = np.dtype(complex if is_complex else _CLASSES[flags & 0xFF])
    return name, values.astype(kind).reshape(shape, order="F")


def _numbers(path: Path, item: _Item, order: str) -> Array:
    if item.kind not in _STORED:
        raise InputError(f"{path} is damaged: kind {item.kind} of numbers is unknown")
    numbers = np.dtype(order + _STORED[item.kind])
    if len(item.data) % numbers.itemsize:
        raise InputError(f"{path} is damaged: {len(item.data)} bytes are no whole count of numbers")
    return np.frombuffer(item.data, numbers).astype(numbers.newbyteorder("="), copy=False)


def _read_hdf(path: Path) -> dict[str, Matrix]:
    """MATLAB 7.3: full matrices are datasets, sparse ones groups of 'data', 'ir' and 'jc'."""
    h5py = package("h5py", f"{path} is a MATLAB 7.3 file, which needs h5py: pip install h5py, or in MATLAB save(..., '-v7')")

    def numbers(name: str, item: Any) -> Array:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "biufV" or item.ndim > 2:
            raise InputError(f"{path}: {name!r} is not stored as numbers; it is damaged")
        # zlib packs a thousandfold at most; what was never written takes no place and reads as zeros
        if item.size * item.dtype.itemsize > 1100 * item.id.get_storage_size() + 1_000_000:
            raise InputError(f"{path}: {name!r} announces {item.size} numbers, but only {item.id.get_storage_size()} bytes are "
                             "stored; it is damaged")
        check_room(path, item.size * item.dtype.itemsize)
        array: Array = item[()]
        if array.dtype.kind == "V":
            if array.dtype.names != ("real", "imag"):
                raise InputError(f"{path}: {name!r} holds records {array.dtype.names}, not numbers")
            return array["real"] + 1j * array["imag"]
        return array

    found: dict[str, Matrix] = {}
    with h5py.File(path, "r") as file:
        for name, item in file.items():
            rows = item.attrs.get("MATLAB_sparse")
            if rows is not None:
                if not isinstance(item, h5py.Group) or "jc" not in item or np.size(rows) != 1 \
                        or ("data" in item) != ("ir" in item):
                    raise InputError(f"{path}: the sparse matrix {name!r} lacks some of its parts; it is damaged")
                starts = numbers(name, item["jc"])
                data, index = (numbers(name, item[part]) if part in item else np.zeros(0) for part in ("data", "ir"))
                shape = int(np.ravel(rows)[0]), starts.size - 1
                found[name] = compressed_columns(path, name, data, index, starts, shape)
            elif isinstance(item, h5py.Dataset) and item.ndim == 2 and not item.attrs.get("MATLAB_empty", 0) \
                    and (item.dtype.kind in "biuf" or item.dtype.names == ("real", "imag")) \
                    and item.attrs.get("MATLAB_class", b"double") not in (b"char", b"cell", "char", "cell"):
                found[name] = numbers(name, item).T  # MATLAB stores by columns
    return found
