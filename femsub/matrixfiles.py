"""`read_matrix`: a matrix from the files of MATLAB, SciPy, Nastran, Abaqus, CalculiX and Matrix Market."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.errors import InputError, MissingPackageError
from femsub.pencil import Matrix
from femsub.textmatrices import TextMatrix, check_end, read_text_matrix

TEXT = (".sti", ".mas", ".con", ".sph")  # CalculiX: stiffness, mass, conductivity, specific heat
ENDINGS = ".mtx (Matrix Market or Abaqus), .sti and .mas (CalculiX), .npz, .npy, .mat (MATLAB) and .op4 (Nastran)"


def read_matrix(path: str | Path, variable: str | None = None) -> Matrix:
    """A, shape (n, m), sparse (CSR) or dense as its file holds it.

    Parameters
    ----------
    path : str or Path
        .mtx (Matrix Market, or what Abaqus writes with *MATRIX OUTPUT: it uses the same ending), .sti and .mas (CalculiX,
        SOLVER=MATRIXSTORAGE), .npz, .npy, .mat (MATLAB, also 7.3 where h5py is installed), .op4 (Nastran, needs pyyeti).
    variable : str, optional
        Which one, where a .mat, .npz or .op4 file holds several matrices.

    Abaqus numbers rows by node and DOF: they are in ascending order here. `read_component` keeps their names.

    Raises
    ------
    InputError
        No such file, an unknown ending, a file that is cut short or not what its ending says, several matrices and none named.
    MissingPackageError
        .op4 without pyyeti, MATLAB 7.3 without h5py.
    """
    return read_labelled(path, variable).matrix


def read_labelled(path: str | Path, variable: str | None = None, usual: str = "") -> TextMatrix:
    """`read_matrix` with the (node, DOF) labels of the rows; of several matrices the one called `usual` is taken."""
    path, wanted = Path(path), variable
    if not path.is_file() and wanted is None and ":" in path.name:
        name, _, wanted = path.name.rpartition(":")
        path = path.with_name(name)
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    ending = path.suffix.lower()
    if ending in (*TEXT, ".mtx"):
        if wanted is not None:
            raise InputError(f"{path} holds one matrix and no names; leave {wanted!r} out")
        if ending in TEXT or not _starts(path, b"%%matrixmarket"):
            return read_text_matrix(path)
        check_end(path)
        return TextMatrix(_as_csr(_guarded(path, _matrix_market)), None)
    readers: dict[str, Callable[[Path], Any]] = {".npz": _npz, ".npy": _npy, ".mat": _matlab, ".op4": _op4}
    if ending not in readers:
        raise InputError(f"{path.name} has an unknown ending; known are {ENDINGS}")
    found = _guarded(path, readers[ending])
    if not isinstance(found, Mapping):
        return TextMatrix(_as_csr(found), None)
    return TextMatrix(_as_csr(found[_chosen(path, found, wanted, usual)]), None)


def _chosen(path: Path, found: Mapping[str, Any], wanted: str | None, usual: str) -> str:
    listed = ", ".join(f"{name} {value.shape[0]} x {value.shape[1]}" for name, value in found.items()) or "none"
    if wanted is not None:
        name = next((name for name in found if name == wanted), None) or \
            next((name for name in found if name.lower() == wanted.lower()), None)
        if name is None:
            raise InputError(f"{path} has no matrix {wanted!r}; it has: {listed}")
        return name
    if len(found) == 1:
        return next(iter(found))
    for name in found:
        if usual and name.lower() == usual.lower():
            return name
    what = "no matrix" if not found else f"{len(found)} matrices"
    raise InputError(f"{path} holds {what}: {listed}" + ("; name one, as in variable='K' or 'file.mat:K'" if found else
                                                         "; it may be cut short or hold something else"))


def _guarded(path: Path, reader: Callable[[Path], Any]) -> Any:
    try:
        return reader(path)
    except (InputError, MissingPackageError):
        raise
    except Exception as error:  # what a reader meets in a damaged file can be anything: struct.error, zlib.error, ...
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"{path} cannot be read as a matrix ({reason:.160}); it may be cut short or damaged, write it again")\
            from None


def _as_csr(value: Any) -> Matrix:
    return sp.csr_array(value) if sp.issparse(value) else np.asarray(value)


def _starts(path: Path, banner: bytes) -> bool:
    with open(path, "rb") as file:
        return file.read(len(banner)).lower() == banner


def _matrix_market(path: Path) -> Any:
    from scipy.io import mminfo, mmread

    rows, columns, _, layout, _, symmetry = mminfo(path)
    if layout == "array":  # SciPy (1.17) counts the entries of sparse matrices, but fills up dense ones with zeros
        half = rows * (rows + 1) // 2 - (rows if symmetry == "skew-symmetric" else 0)
        wanted = rows * columns if symmetry == "general" else half
        found = _lines_of_data(path) - 1  # the first tells the shape
        if found < wanted:
            raise InputError(f"{path} is cut short: it announces {rows} x {columns}, so {wanted} entries, but has {found}; "
                             "write it again")
    return mmread(path)


def _lines_of_data(path: Path) -> int:
    count = 0
    with open(path, "rb") as file:
        while (line := file.readline()).startswith(b"%") or not line.strip():
            if not line:
                return 0
        while block := file.read(1 << 24):
            count += block.count(b"\n") - block.count(b"\n\n")
    return count + 1


def _npz(path: Path) -> Any:
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path} is not a whole .npz file; it may be cut short, write it again")
    with np.load(path, allow_pickle=False) as file:
        if {"format", "shape", "data"} <= set(file.files):
            return sp.load_npz(path)
        return {name: file[name] for name in file.files if file[name].ndim == 2 and file[name].dtype.kind in "biufc"}


def _npy(path: Path) -> Any:
    return np.load(path, allow_pickle=False)


def _matlab(path: Path) -> Any:
    with open(path, "rb") as file:
        start = file.read(520)
    if b"\x89HDF\r\n" in (start[:6], start[512:518]):
        return _matlab_hdf(path)
    from scipy.io import loadmat

    return {name: value for name, value in loadmat(path).items() if not name.startswith("__") and value_is_matrix(value)}


def value_is_matrix(value: Any) -> bool:
    """A sparse matrix or a table of numbers: MATLAB's texts, structs and cells are something else."""
    return sp.issparse(value) or (isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biufc")


def _matlab_hdf(path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError as error:
        raise MissingPackageError(f"{path} is a MATLAB 7.3 file, which needs h5py: pip install h5py, or in MATLAB "
                                  "save(..., '-v7')") from error
    found: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        for name, item in file.items():
            rows = item.attrs.get("MATLAB_sparse")
            if rows is not None:
                starts = item["jc"][()].astype(np.int64)
                data = item["data"][()] if "data" in item else np.zeros(0)
                index = item["ir"][()].astype(np.int64) if "ir" in item else np.zeros(0, dtype=np.int64)
                found[name] = sp.csc_array((data, index, starts), shape=(int(rows), len(starts) - 1))
            elif isinstance(item, h5py.Dataset) and item.ndim == 2 and item.dtype.kind in "biuf" \
                    and item.attrs.get("MATLAB_class", b"double") not in (b"char", b"cell", "char", "cell"):
                found[name] = item[()].T  # MATLAB stores by columns
    return found


def _op4(path: Path) -> dict[str, Any]:
    import warnings

    with warnings.catch_warnings():
        # a premature end is only a warning there; a name that is no identifier is harmless
        warnings.filterwarnings("error", "Premature end-of-file")
        warnings.filterwarnings("ignore", "Output4 file has matrix name")
        names, matrices, *_ = op4_module().load(str(path), into="list", sparse=None)
    found: dict[str, Any] = {}
    for name, matrix in zip(names, matrices, strict=True):
        if name in found:
            raise InputError(f"{path} holds two matrices called {name!r}; give each a name of its own")
        found[name] = matrix
    return found


def op4_module() -> Any:
    """pyyeti's module for OP4 files."""
    try:
        from pyyeti.nastran import op4
    except ImportError as error:
        raise MissingPackageError("Nastran OP4 files need pyyeti: pip install femsub[nastran]") from error
    return op4
