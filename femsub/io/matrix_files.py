"""`read_matrix`: a matrix from the files of MATLAB, SciPy, Nastran, Ansys, Abaqus, CalculiX and Matrix Market."""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, FemsubError, InputError, Matrix, parsing, path_of, shown, word
from femsub.io.abaqus_calculix import TextMatrix, read_text_matrix
from femsub.io.ansys import read_full
from femsub.io.damage import THROWN, check_extent, check_indices, check_room, existing, head_of, unreadable_refused
from femsub.io.dmig import read_dmig
from femsub.io.matlab import read_matlab
from femsub.io.matrix_market import read_market
from femsub.io.op2 import read_op2
from femsub.io.op4 import read_op4
from femsub.io.sierra import labelled_mfile

NUMBERS = "biufc"  # the kinds of NumPy's types that a matrix may have
TEXT = (".mtx", ".sti", ".mas", ".con", ".sph")  # of Abaqus; of CalculiX: stiffness, mass, conductivity, specific heat
ENDINGS = (".mtx (Matrix Market or Abaqus), .sti and .mas (CalculiX), .npz, .npy, .mat (MATLAB), .op4, .op2 and .pch (Nastran), "
           ".full (Ansys), .m (Sierra/SD); text of Matrix Market, Abaqus and CalculiX may have any ending")
PUNCHES = (".pch", ".bdf", ".nas", ".dmig")  # decks of Nastran; others are known by their DMIG cards
#: a line of Abaqus' or CalculiX' matrices: places, then the entry
_LINE = re.compile(rb"\s*(\d++[\s,]++\d++[\s,]++){1,2}[+-]?[\d.]++([eEdD][+-]?\d++|[+-]\d++)?\s*")


@unreadable_refused
def read_matrix(path: str | Path, variable: str | None = None) -> Matrix:
    """Read a matrix from a file of MATLAB, SciPy, Nastran, Ansys, Abaqus, CalculiX or Matrix Market.

    Parameters
    ----------
    path : str or Path
        .mtx (Matrix Market, or what Abaqus writes with `*MATRIX OUTPUT`: it uses the same ending), .sti and .mas (CalculiX,
        SOLVER=MATRIXSTORAGE); text of these with any other ending; .npz, .npy, .mat (MATLAB, also 7.3 where h5py is installed),
        .op4 (Nastran), .op2, .pch and other decks with DMIG cards (Nastran), .full (Ansys), X_Kaa.m and X_Maa.m
        (Sierra/SD).
    variable : str, optional
        The name of the matrix, if a .mat, .npz, .op4, .op2, .pch or .full file holds several.

    Returns
    -------
    ndarray or csr_array, shape (n, m)
        Dense or sparse as in the file. Abaqus numbers rows by node and DOF; they are in ascending order here, and
        `read_component` keeps their names.

    Notes
    -----
    Each reader's docstring lists what it reads, what it refuses and what it cannot detect:
    `femsub.io.matrix_market.read_market` (Matrix Market), `femsub.io.abaqus_calculix.read_text_matrix` (Abaqus, CalculiX),
    `femsub.io.matlab.read_matlab`, `femsub.io.op4.read_op4`, `femsub.io.op2.read_op2`,
    `femsub.io.dmig.read_dmig`, `femsub.io.ansys.read_full`, `femsub.io.sierra.labelled_mfile`. For files of NumPy and SciPy:

    ===================  =======================================================================================
    .npy, .npz read      real, integer, complex and logical arrays; all formats of `scipy.sparse.save_npz`;
                         repeated entries are added, as SciPy does
    they refuse          dates, text, records, objects; three and more dimensions; more or fewer bytes than
                         announced; sparse indices out of range; a wrong checksum of a .npz file
    they cannot know     whether a number of a .npy file is wrong: it has no checksum
    ===================  =======================================================================================

    Raises
    ------
    InputError
        No such file, an unknown suffix, a file that is cut short or not what its suffix says, several matrices and no `variable`.
    MissingPackageError
        MATLAB 7.3 without h5py.

    Examples
    --------
    >>> import femsub as fs
    >>> files = fs.write_matrices("model", fs.chain(10))
    >>> fs.read_matrix("model/K.mtx").shape
    (10, 10)
    """
    return read_labelled(path, variable).matrix


def read_labelled(path: str | Path, variable: str | None = None, usual: str = "") -> TextMatrix:
    """`read_matrix` with the (node, DOF) labels of the rows; from several matrices the one called `usual` is taken."""
    path, wanted = path_of("path", path), None if variable is None else word("variable", variable)
    if not path.is_file() and wanted is None and ":" in path.name:
        name, _, wanted = path.name.rpartition(":")
        path = path.with_name(name)
    found = _content(path)
    return found[_chosen(path, found, wanted, usual)]


def read_together(path: Path, names: Iterable[str | None]) -> list[Matrix]:
    """Several matrices of one file, which is read once. The name None stands for the only matrix of the file."""
    found = _content(path)
    return [found[_chosen(path, found, name, "")].matrix for name in names]


def _content(path: Path) -> dict[str, TextMatrix]:
    """All matrices of a file by name, '' where the format has none."""
    ending = existing(path).suffix.lower()
    reader = READERS.get(ending)
    if reader is None:
        head = head_of(path)
        lines = [line for line in head.splitlines() if line.strip() and not line.startswith(b"**")]
        if ending == ".sub":
            raise InputError(f"{path}: superelements of Ansys (.sub) are not read. Write their matrices there with *DMAT and "
                             "*EXPORT in the format MMF, and read these (.mtx)")
        if head[:14].lower() == b"%%matrixmarket":
            reader = read_market
        elif ending not in TEXT and (ending in PUNCHES or re.search(rb"(?mi)^[ \t]*DMIG[\s*,]", head)):
            reader = read_dmig
        elif ending in TEXT or (lines and _LINE.fullmatch(lines[0])):
            reader = read_text_matrix
        else:
            raise InputError(f"{path.name} has an unknown ending; known are {ENDINGS}")
    found = guarded(path, reader)
    return {name: item if isinstance(item, TextMatrix) else TextMatrix(sp.csr_array(item) if sp.issparse(item) else item)
            for name, item in (found if isinstance(found, Mapping) else {"": found}).items()}


def _chosen(path: Path, found: Mapping[str, TextMatrix], wanted: str | None, usual: str) -> str:
    if list(found) == [""]:
        if wanted is not None and path.suffix.lower() not in READERS:
            raise InputError(f"{path} holds one matrix without a name. Leave out its name or variable, {shown(wanted)}")
        return ""
    listed = ", ".join(f"{name} {item.matrix.shape[0]} x {item.matrix.shape[1]}" for name, item in found.items()) or "none"
    if wanted is not None:
        same = sorted((name for name in found if name.lower() == wanted.lower()), key=lambda name: name != wanted)
        if not same:
            raise InputError(f"{path} has no matrix {wanted!r}; it has: {listed}")
        return same[0]
    for name in found:
        if len(found) == 1 or (usual and name.lower() == usual.lower()):
            return name
    what = "no matrix" if not found else f"{len(found)} matrices"
    other = ", as a struct: save its fields as variables, by save('file.mat', '-struct', 'name') in MATLAB"
    raise InputError(f"{path} holds {what}: {listed}" + (
        "; name one, as in variable='K' or 'file.mat:K'" if found else
        f"; it may be cut short or hold something else{other * (path.suffix.lower() == '.mat')}"))


def guarded(path: Path, reader: Callable[[Path], Any]) -> Any:
    """The result of a reader. Its exceptions for a damaged file become an InputError."""
    try:
        return reader(path)
    except (FemsubError, PermissionError):  # the file itself may be whole
        raise
    except THROWN as error:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"{path} cannot be read ({reason:.160}); it may be cut short or damaged, write it again")\
            from None


def _npy(path: Path) -> Any:
    with open(path, "rb") as file:
        shape, kind, wanted = _array_header(path, path.name, file)
    if path.stat().st_size != wanted:
        raise InputError(f"{path} announces {wanted} bytes, but has {path.stat().st_size}; it is cut short or damaged")
    if kind.kind not in NUMBERS or not 1 <= len(shape) <= 2:
        sort = {"M": "dates", "m": "spans of time", "U": "text", "S": "text", "V": "records", "O": "Python objects"}.get(
            kind.kind, f"numbers ({kind})")
        raise InputError(f"{path} holds {sort} of the shape {shape}, not a matrix of numbers")
    check_room(path, wanted)
    with parsing():
        return np.load(path, allow_pickle=False)


def _array_header(path: Path, name: str, file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Shape and type from the header of a .npy file, and the number of bytes the file must have."""
    version = np.lib.format.read_magic(file)
    if version == (3, 0):  # only for records with names in Unicode
        raise InputError(f"{path}: {name} holds records, not a matrix of numbers")
    if version not in ((1, 0), (2, 0)):
        raise InputError(f"{path}: {name} has the unknown version {version}")
    with parsing():
        shape, _, kind = (np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0)(file)
    if any(part < 0 for part in shape):
        raise InputError(f"{path}: {name} announces the shape {shape}; it is damaged")
    return shape, kind, file.tell() + int(np.prod(shape, dtype=object)) * kind.itemsize


def _npz(path: Path) -> Any:
    kinds = _array_kinds(path, path)
    with parsing(), np.load(path, allow_pickle=False) as file:
        if not {"format", "shape", "data"} <= set(kinds):
            return {name: value for name in kinds if kinds[name].kind in NUMBERS and (value := file[name]).ndim == 2}
        # a matrix of `scipy.sparse.save_npz`: SciPy checks few of the indices, and converting wrong ones crashes
        expected = {"format": "SU", "data": NUMBERS, "_is_array": "b"}
        wrong = [name for name, kind in kinds.items() if kind.kind not in expected.get(name, "iu")]
        shape = file["shape"] if not wrong else np.zeros(0)
        if wrong or shape.shape != (2,) or shape.min() < 0:
            raise InputError(f"{path} is damaged: {wrong[0] if wrong else 'shape'} of its sparse matrix is not what it should be")
        check_extent(path, (int(shape[0]), int(shape[1])), file["data"].size)
    with parsing():
        found = sp.load_npz(path)
    if found.format in ("csr", "csc", "bsr"):
        check_indices(found)
    return found


def read_arrays(path: Path, content: BinaryIO | None, most: int) -> dict[str, Array]:
    """All arrays of a .npz file, or of its content if that is given, by name.

    Raises
    ------
    InputError
        The file is damaged or cut short, an array is not as long as it announces, or all together exceed `most` bytes.
    """
    def read(place: Path) -> dict[str, Array]:
        kinds = _array_kinds(path, content or place, most)
        if content is not None:
            content.seek(0)
        with parsing(), np.load(content or place, allow_pickle=False) as file:
            return {name: file[name] for name in kinds}

    found: dict[str, Array] = guarded(path, read)
    return found


def _array_kinds(path: Path, content: Path | BinaryIO, most: float = math.inf) -> dict[str, np.dtype[Any]]:
    """The types of the arrays in a .npz file; an error if one is not as long as it announces, or all exceed `most` bytes."""
    if not zipfile.is_zipfile(content):
        raise InputError(f"{path} is not a whole .npz file; it may be cut short, write it again")
    kinds: dict[str, np.dtype[Any]] = {}
    with zipfile.ZipFile(content) as archive:
        entries = archive.infolist()
        size = sum(entry.file_size for entry in entries)
        if size > most:
            raise InputError(f"{path} announces {size} bytes; there are at most {most:.0f} in such a file")
        check_room(path, size)
        for entry in entries:
            name = entry.filename.removesuffix(".npy")
            if name in kinds or name == entry.filename:
                raise InputError(f"{path} is damaged: {entry.filename!r} is in it twice, or is no .npy file")
            with archive.open(entry) as file:
                _, kinds[name], wanted = _array_header(path, entry.filename, file)
            if kinds[name].kind != "O" and wanted != entry.file_size:
                raise InputError(f"{path} is damaged: {entry.filename} announces {wanted} bytes, but has {entry.file_size}")
    return kinds


#: by ending: readers of one matrix, or of several by name, with node and direction of the rows where the file has them
READERS: dict[str, Callable[[Path], Any]] = {
    ".npz": _npz, ".npy": _npy, ".mat": read_matlab, ".op4": read_op4, ".m": labelled_mfile, ".full": read_full,
    ".op2": lambda path: read_op2(path)[0]}  # its matrices without the cards
