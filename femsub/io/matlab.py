"""MATLAB's .mat files of versions 4, 5 to 7, and 7.3: their real and sparse matrices.

SciPy's reader crashes the interpreter on damaged files of version 5 (kinds of numbers that do not exist, strings, cells). So it
gets only the matrices of a file, after a check of all their parts.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from enum import IntEnum
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, Matrix, package
from femsub.io.damage import Cursor, check_extent, check_indices, check_room

HDF = b"\x89HDF\r\n"


class Mi(IntEnum):
    """Kinds of data elements in version 5, as MATLAB's MAT-File Format calls them."""

    INT8 = 1
    UINT8 = 2
    INT16 = 3
    UINT16 = 4
    INT32 = 5
    UINT32 = 6
    SINGLE = 7
    DOUBLE = 9
    INT64 = 12
    UINT64 = 13
    MATRIX = 14
    COMPRESSED = 15
    UTF8 = 16


class Flags(IntEnum):
    """Flags of an array: its class in the last byte, sparse or numbers from double to uint64, and the bit of a complex array."""

    SPARSE = 5
    DOUBLE = 6
    UINT64 = 15
    CLASS = 0xFF
    COMPLEX = 0x0800


_TEXT, _WHOLE = {Mi.INT8, Mi.UINT8, Mi.UTF8}, {Mi.INT32, Mi.UINT32}
_NUMBERS = {*Mi} - {Mi.MATRIX, Mi.COMPRESSED, Mi.UTF8}
_FLOATS = {"double": np.float64, "single": np.float32}


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
    from scipy.io import loadmat, whosmat

    with open(path, "rb") as file:
        start = file.read(520)
    if HDF in (start[:6], start[512:518]):
        return _read_hdf(path)
    check_room(path, path.stat().st_size)
    content = path.read_bytes()
    if len(content) < 20 or not any(content[:20]):
        raise InputError(f"{path} is no MATLAB file, or cut short; write it again")
    if 0 not in content[:4]:  # versions 5 to 7: matrices are unpacked and their parts checked, other elements left out
        order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")
        if not order or len(content) < 128 or content[125 if order == "<" else 124] != 1:
            raise InputError(f"{path} cannot be read as a matrix: it is no MATLAB file, or cut short; write it again")
        kept = [content[:128]]
        for kind, data in _elements(path, content, order, 128):
            # a compressed element, complete and with its checksum; only the beginning if it is no matrix of numbers
            if kind == Mi.COMPRESSED:
                stream = zlib.decompressobj()
                try:
                    head = stream.decompress(data, 24)
                    (kind, size), data = struct.unpack_from(f"{order}2I", head), head[8:]
                    if kind == Mi.MATRIX and _flags(path, data, order) is not None:
                        check_room(path, size)
                        data += stream.decompress(stream.unconsumed_tail, max(size - 16, 1))
                        rest = stream.decompress(stream.unconsumed_tail, 64)
                        if len(data) != size or rest.strip(b"\0") or not stream.eof:
                            raise InputError(f"{path} is damaged: a packed matrix has another length; write it again")
                except (zlib.error, struct.error) as error:
                    raise InputError(f"{path} is damaged: a packed matrix cannot be unpacked ({error}); write it again") from None
            if kind != Mi.MATRIX:
                raise InputError(f"{path} holds an element of kind {kind} where a matrix should be; it is damaged")
            flags = _flags(path, data, order)
            if flags is None:
                continue
            # its parts: size, name and numbers
            parts = [part for part, _ in _elements(path, data, order, 16)]
            wanted = [_WHOLE, _TEXT, *[_WHOLE] * (2 * (flags & Flags.CLASS == Flags.SPARSE)),
                      *[_NUMBERS] * (1 + bool(flags & Flags.COMPLEX))]
            if len(parts) != len(wanted) or any(part not in known for part, known in zip(parts, wanted, strict=True)):
                raise InputError(f"{path} is damaged: an array has parts of the kinds {parts}, not size, name and numbers")
            kept += [struct.pack(f"{order}2I", kind, len(data)), data]
        content = b"".join(kept)
    else:  # version 4: its heads must lead from one to the next up to the end, as NUL before a file of version 5 look like a head
        cursor = Cursor(str(path), content)
        while cursor.place < cursor.end:
            at, kind, order = cursor.place, 0, "<"
            for order in "<>":
                kind, rows, columns, imaginary, name = map(int, Cursor(str(path), content, at).take(f"{order}i4", 5))
                if 0 <= kind < 5000:
                    break
            size = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}.get(kind // 10 % 10, 0)
            if (kind // 1000, kind // 100 % 10) != ("<>".index(order), 0) or not size or kind % 10 > 2 or min(rows, columns) < 0 \
                    or imaginary not in (0, 1) or not 0 < name <= 64:
                raise InputError(f"{path} is no MATLAB file of version 4, or damaged: byte {at} begins no matrix. Write it again")
            cursor.skip(20 + name + rows * columns * size * (1 + imaginary))
    # SciPy reads the checked content
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SciPy 1.18 warns that the type of sparse matrices will change
        loaded = loadmat(BytesIO(content))
    found: dict[str, Matrix] = {}
    for name, _, kind in whosmat(BytesIO(content)):
        value = loaded.get(name)
        if name in found:
            raise InputError(f"{path} holds two matrices called {name!r}. Give them different names")
        if sp.issparse(value):
            found[name] = _checked(path, name, value)
        elif value is not None and value.ndim == 2 and value.dtype.kind in "biufc":  # whole doubles may be stored as bytes
            found[name] = value.astype(complex if value.dtype.kind == "c" else _FLOATS.get(kind, value.dtype))
    return found


def _checked(path: Path, name: str, matrix: Any) -> Matrix:
    """The sparse matrix as CSR; its entries must be within it, each once, and in each column (version 5) in ascending order."""
    check_extent(path, matrix.shape, matrix.nnz)
    if matrix.format == "csc":
        check_indices(matrix)
    whole = sp.csr_array(matrix, dtype=complex if matrix.dtype.kind == "c" else float)
    if whole.nnz < matrix.nnz or (matrix.format == "csc" and not matrix.has_canonical_format):
        raise InputError(f"{path}: the rows of {name!r} do not ascend in a column, or one is there twice; it is damaged")
    return whole


def _elements(path: Path, content: bytes, order: str, place: int) -> Iterator[tuple[int, bytes]]:
    """Kinds and data of the elements from a position on; up to four bytes of data may be in an element's head."""
    cursor = Cursor(str(path), content, place)
    while any(memoryview(content)[cursor.place:]):  # zeros may fill up the last word
        kind, size = cursor.take(f"{order}u4", 2).tolist()
        if kind >> 16:
            kind, size, cursor.place = kind & 0xFFFF, kind >> 16, cursor.place - 4
            data = cursor.take("u1", 4)[:size]
        else:
            data = cursor.take("u1", size)
            cursor.place += 0 if kind == Mi.COMPRESSED else -size % 8
        if len(data) < size:
            raise InputError(f"{path} is damaged: {size} bytes in an element that holds four")
        yield kind, data.tobytes()


def _flags(path: Path, data: bytes, order: str) -> int | None:
    """An array's flags, which are its first element, or None if it is neither a full nor a sparse matrix."""
    kind, size, flags = Cursor(str(path), data).take(f"{order}u4", 3).tolist()
    if (kind, size) != (Mi.UINT32, 8):
        raise InputError(f"{path} is damaged: an array does not begin with its flags")
    numbers = Flags.DOUBLE <= flags & Flags.CLASS <= Flags.UINT64
    return flags if numbers or flags & Flags.CLASS == Flags.SPARSE else None


def _read_hdf(path: Path) -> dict[str, Matrix]:
    """MATLAB 7.3: full matrices are datasets, sparse ones groups of 'data', 'ir' and 'jc'."""
    h5py = package("h5py", f"{path} is a MATLAB 7.3 file, which needs h5py", "h5py",
                   otherwise=" (or save it by save(..., '-v7') in MATLAB)")

    def numbers(name: str, item: Any) -> Array:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "biufV" or item.ndim > 2:
            raise InputError(f"{path}: {name!r} is not stored as numbers; it is damaged")
        # zlib packs a thousandfold at most; what was never written takes no place and reads as zeros
        if item.size * item.dtype.itemsize > 1100 * item.id.get_storage_size() + 1_000_000:
            raise InputError(f"{path}: {name!r} has {item.size} numbers in {item.id.get_storage_size()} bytes; it is damaged")
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
                parts = data.ravel(), index.ravel().astype(np.int64), starts.ravel().astype(np.int64)
                found[name] = _checked(path, name, sp.csc_array(parts, shape=shape))
            elif isinstance(item, h5py.Dataset) and item.ndim == 2 and not item.attrs.get("MATLAB_empty", 0) \
                    and (item.dtype.kind in "biuf" or item.dtype.names == ("real", "imag")) \
                    and item.attrs.get("MATLAB_class", b"double") not in (b"char", b"cell", "char", "cell"):
                found[name] = numbers(name, item).T  # MATLAB stores by columns
    return found
