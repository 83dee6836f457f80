"""Ansys' binary files: K and M of .full files, and modes of .rst files by PyAnsys' reader in a process of its own."""

from __future__ import annotations

import shutil
import sys
from contextlib import suppress
from functools import lru_cache
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import completed
from femsub.checks import Array, InputError, MissingPackageError, installed_by, parsing, warn
from femsub.io.abaqus_calculix import TextMatrix
from femsub.io.atomic import scratch
from femsub.io.damage import MOST, assembled, mirrored, run_rows

MODULE = "ansys.mapdl.reader"
INTEGERS = -2**31  # the flags of a record of whole numbers; 0 are those of double precision
WINDOWS, BITS = 2**28, 2**27  # further flags, of records that leave out entries that are 0
#: places in the standard header, the first record, in words of four bytes; the manual's item n is the word n + 1
HEADER = {"length of the record": 0, "file number": 2, "file length": 28, "file length, low": 98, "file length, high": 99,
          "next record": 103}
KINDS = {".full": 4, ".rst": 12}  # file numbers
ANALYSES = {"static": 0, "buckling": 1, "modal": 2, "harmonic": 3, "transient": 4}  # by KAN of a result file
NOTHING = 2.0 ** 100  # stands for a missing value
#: the process: its memory is limited, and it takes the reader's modules without their __init__, which loads VTK for some 5 s
BEGIN = f"""
import resource, sys, types
from importlib.util import find_spec
import numpy as np
path, target, most = sys.argv[1], sys.argv[2], int(sys.argv[3]) << 30
hard = resource.getrlimit(resource.RLIMIT_AS)[1]
resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
bare = types.ModuleType("{MODULE}")
bare.__path__ = list(find_spec("{MODULE}").submodule_search_locations)
sys.modules["{MODULE}"] = bare
"""
#: records of the result file as they are; `read_rst` interprets them
SETS = """
from ansys.mapdl.reader import _binary_reader, _rst_keys
from ansys.mapdl.reader.common import parse_header
def record(at, **more):
    return _binary_reader.c_read_record(path, int(at), **more)
head = parse_header(record(103), _rst_keys.result_header_keys)
geometry = parse_header(record(head["ptrGEO"]), _rst_keys.geometry_header_keys)
count, known = int(head["nsets"]), record(head["ptrNOD"])
pointers = record(head["ptrDSI"]).reshape(2, -1)[:, :count].astype(np.int64)
nodes, numbers = np.zeros((int(geometry["nnod"]), 6)), np.zeros(int(geometry["nnod"]), np.int32)
_binary_reader.load_nodes(path, int(geometry["ptrLOC"]), len(numbers), nodes, numbers)
found = {"analysis": head["kan"], "cyclic": head["nSector"], "at": record(head["ptrTIM"])[:count], "nodes": nodes,
         "numbers": numbers, "whole": head["Glbnnod"]}
for index, (low, high) in enumerate(pointers.T):
    start = int(low % 2**32 + (high << 32))
    one = parse_header(record(start), _rst_keys.solution_data_header_keys)
    width = int(one["numdof"] + one["nfldof"])
    values, size = record(start + one["ptrNSL"], return_bufsize=1)
    values = values.reshape(-1, width)[:int(one["nnod"])].astype(float)
    rows = np.arange(len(values)) if len(values) == one["nnod"] else record(start + one["ptrNSL"] + size) - 1
    found |= {f"complex{index}": one["kcmplx"], f"dofs{index}": np.array(one["DOFS"])[:width], f"values{index}": values,
              f"at{index}": known[rows]}
np.savez(target, **found)
"""


def read_full(path: Path) -> dict[str, TextMatrix]:
    """K and M of a .full file, shape (n, n), with (node, direction from 1) of each row, ascending.

    ===================  =======================================================================================
    it reads             stiffness and mass in .full files of Ansys (WRFULL, or a modal analysis): one triangle of symmetric
                         matrices; all columns of unsymmetric ones, as friction makes them
    it leaves out        DOF that a constraint holds
    it refuses           a lumped mass, compressed records of matrices, a file that is shorter than its header says,
                         records whose two lengths differ or that do not fit their neighbours, another number of entries than
                         announced, an entry twice
    it cannot know       whether a number is wrong: there is no checksum. Whether a program wrote the rows of an unsymmetric
                         matrix in place of its columns: the transposed pencil has the same λ
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    _check_header(path, ".full")
    stamp = path.stat()
    found = _matrices(path, stamp.st_mtime_ns, stamp.st_size)
    return {key: TextMatrix(item.matrix.copy(), item.labels) for key, item in found.items()}


class _Records:
    """The records of a file: their length in words of four bytes, a word of flags, the content, and the length again."""

    def __init__(self, path: Path) -> None:
        self.path, self.words = path, np.fromfile(path, "<i4")

    def damaged(self, what: str) -> InputError:
        return InputError(f"{self.path} cannot be read: {what}; it is damaged, or of a kind that is not known. Write it again")

    def integers(self, what: str, at: int, count: int | None = None) -> tuple[Array, int]:
        """The content of the record at a place, and the place of the next one."""
        words, length = self.words, int(self.words[at]) if 0 <= at < len(self.words) else -1
        stop = at + 2 + length
        flags = int(words[at + 1]) - INTEGERS if stop < len(words) and length >= 0 else -1
        content = None
        if flags in (0, WINDOWS, BITS) and words[stop] == length:
            content = _spread(words[at + 2:stop], flags) if flags else words[at + 2:stop]
        if content is None or count not in (None, len(content)):
            raise self.damaged(f"there is no record of {what} at the word {at}")
        return content, stop + 1

    def matrix(self, name: str, at: int, size: int, terms: int) -> Any:
        """Columns of a matrix (size, size): for each a record of rows, counted from 1, and one of their entries."""
        words, places = memoryview(self.words.data), np.zeros((size, 2), dtype=np.int64)
        try:
            for column in range(size):  # a chain: each record begins where the one before it ends
                count = words[at]
                middle, end = at + count + 3, at + 3 * count + 5
                if not 0 < count <= size or (words[at + 1], words[middle - 1], words[middle], words[middle + 1], words[end]) != (
                        INTEGERS, count, 2 * count, 0, 2 * count):
                    raise self.damaged(f"the records of column {column + 1} of {name} do not fit each other")
                places[column] = at + 2, count
                at = end + 1
        except IndexError:
            raise self.damaged(f"{name} ends within column {column + 1}") from None
        start, counts = places.T
        if counts.sum() != terms:
            raise self.damaged(f"{name} has {counts.sum()} entries, but {terms} are announced")
        places, zero = run_rows(start, counts), run_rows(np.zeros_like(start), counts)
        rows, low = self.words[places] - 1, places + zero + np.repeat(counts + 3, counts)
        values = np.ascontiguousarray(np.stack([self.words[low], self.words[low + 1]], axis=1)).view("<f8").ravel()
        if terms and not 0 <= rows.min() <= rows.max() < size:
            raise self.damaged(f"{name} has a row beyond its {size}")
        if not np.isfinite(values).all():
            raise InputError(f"{self.path} holds a NaN or Inf in {name}")
        return assembled(f"{self.path}: {name}", rows, np.repeat(np.arange(size), counts), values, (size, size))


def _spread(packed: Array, flags: int) -> Array | None:
    """The content of a compressed record of whole numbers, which has 0 where nothing is stored; None if it is damaged.

    The first word is the size of the content. For WINDOWS, their number follows, and then each window: place, length, entries. A
    positive place has one entry and no length; a negative place has a length. A negative length means that all entries of the
    window equal the one that follows. For BITS, bit n of the next word says whether entry n is stored. The stored entries follow.
    """
    words = packed.tolist()
    if len(words) < 2 or not 0 <= words[0] <= MOST:
        return None
    content, at = np.zeros(words[0], dtype=packed.dtype), 2
    if flags == BITS:
        places = [bit for bit in range(32) if words[1] >> bit & 1]
        if len(places) != len(words) - 2 or words[0] > 32 or (places and places[-1] >= words[0]):
            return None
        content[places] = words[2:]
        return content
    for _ in range(words[1]):
        alone = words[at] > 0 if at < len(words) else True
        head = words[at:at + (1 if alone else 2)]
        size = head[1] if len(head) == 2 else 1
        begin, stored = at + len(head), size if size > 0 else 1
        place, length = abs(head[0]) if head else 0, abs(size)
        if len(head) != (1 if alone else 2) or not size or begin + stored > len(words) or place + length > len(content):
            return None
        content[place:place + length] = words[begin:begin + stored]
        at = begin + stored
    return content if at == len(words) else None


@lru_cache(maxsize=1)  # K and M are read one after the other
def _matrices(path: Path, changed: int, size: int) -> dict[str, TextMatrix]:
    records = _Records(path)
    head, at = records.integers("its header", HEADER["next record"])
    if len(head) < 37 or head[0] >= 0 or head[10] or not head[1] > 0:
        raise InputError(f"{path} holds a lumped mass, or was written by a frontal solver. Take consistent masses "
                         "(LUMPM,OFF) and another solver (EQSLV,SPARSE)")
    count, unsymmetric = int(head[1]), bool(head[13])
    kinds, at = records.integers("the kinds of DOF", at)
    numbers, _ = records.integers("the numbers of nodes", at)
    widths, at = records.integers("DOF for each node", _long(head[35], head[36]), len(numbers))
    held, _ = records.integers("constraints", at, count)
    if widths.sum() != count or (len(widths) and not 0 <= widths.min() <= widths.max() <= len(kinds)):
        raise records.damaged(f"its {len(numbers)} nodes have {widths.sum()} DOF, but {count} are announced")
    nodes = np.repeat(numbers, widths).astype(np.int64)
    places = run_rows(np.ones_like(widths), widths)  # of a DOF at its node
    directions = kinds[places - 1].astype(np.int64)
    if len(strange := np.flatnonzero((np.abs(held) != directions) & (np.abs(held) != places))):
        one = int(strange[0])
        warn(f"{path}: the constraint of DOF {one + 1} is {held[one]}, where its direction {directions[one]} belongs, negative "
             "if it is held: is it damaged?")
    order = np.lexsort([directions, nodes])
    order = order[held[order] >= 0]
    labels = np.stack([nodes, directions], axis=1)[order]
    if not len(order) or labels.min() < 1 or len(np.unique(numbers)) < len(numbers) or len(np.unique(kinds)) < len(kinds):
        raise InputError(f"{path} holds no DOF, or some of them twice; it may be damaged, write it again")
    found, all_ = dict[str, TextMatrix](), False
    for name, place, terms in (("K", _long(head[18], head[19]), _long(head[8], head[9])),
                               ("M", _long(head[26], head[27]), _long(head[33], head[21]))):
        if not terms:
            raise InputError(f"{path} holds no {name}. Write it with a modal analysis (ANTYPE,MODAL and WRFULL,1)")
        matrix = records.matrix(name, place, count, terms)
        below, above = sp.tril(matrix, -1).nnz, sp.triu(matrix, 1).nnz
        if not below or not above:
            matrix = mirrored(matrix)
        elif unsymmetric:
            all_ = True
        else:
            raise records.damaged(f"a symmetric {name} is one triangle, but has {below} entries below and {above} above")
        found[name] = TextMatrix(sp.csr_array(matrix[order][:, order]), labels)
    if unsymmetric and not all_:
        raise records.damaged("it announces an unsymmetric matrix, but has one triangle of each")
    return found


def _long(low: Any, high: Any) -> int:
    return int(low) % 2**32 + (int(high) << 32)


def read_rst(path: Path, seconds: float = 600.0, gigabytes: int = 16) -> tuple[Array, Array, Array, Array, Array]:
    """λ (k,) and shapes (m, k) of a .rst file, node, direction (0 to 5) and place of each row.

    PyAnsys' reader runs in a process of its own, since a damaged file may crash it, keep it busy for ever or ask for all memory.
    The process is ended after `seconds`. Its address space is limited to `gigabytes`, more than any file of modes needed so far.

    ===================  =======================================================================================
    it reads             real modes of a modal analysis (ANTYPE,MODAL): motions of nodes, compressed or not
    it turns             motions in a frame of a node's own into those along the global axes
    it leaves out        temperatures, pressures and other DOF that are no motions; nodes without a solution
    it refuses           other analyses, complex modes, cyclic sectors, one of several files of a distributed run, a file that
                         is shorter than its header says, whatever the reader crashes at
    it cannot know       units
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        ansys-mapdl-reader is not installed.
    """
    package: ModuleSpec | None = None
    with suppress(ModuleNotFoundError):  # another package of Ansys, without this part
        package = find_spec(MODULE)
    if package is None:
        raise MissingPackageError(f"Ansys' .rst files need PyAnsys' reader: {installed_by('ansys-mapdl-reader')}")
    _check_header(path, ".rst")
    # the arrays that a script in a process of its own finds in the file
    with scratch(float(path.stat().st_size)) as folder:
        target = folder / "found.npz"
        command = [sys.executable, "-c", BEGIN + SETS, str(path.absolute()), str(target), str(gigabytes)]
        done = completed(command, seconds)
        if done is None:
            raise InputError(f"{path} was not read within {seconds:g} s; it may be damaged")
        if done.returncode or not target.is_file():
            last = (done.stderr.strip().splitlines() or [""])[-1]
            if last.startswith("ModuleNotFoundError"):
                raise MissingPackageError(f"Ansys' {path.suffix} files need PyAnsys' reader and all it needs ({last}): "
                                          f"{installed_by('ansys-mapdl-reader')}")
            if last.startswith("OSError") and not shutil.disk_usage(folder).free:
                raise OSError(last)
            reason = last if done.returncode > 0 and last else f"its reader stopped with status {done.returncode}"
            raise InputError(f"{path} cannot be read ({reason:.160}); it may be cut short or damaged, write it again")
        with parsing(), np.load(target) as arrays:
            found: dict[str, Array] = dict(arrays)
    # frequencies, nodes and their places
    at, nodes, numbers = found["at"].astype(float), found["nodes"], found["numbers"].astype(np.int64)
    if found["analysis"] != ANALYSES["modal"] or not len(at):
        raise InputError(f"{path} holds no modes: its analysis has the type {found['analysis']}, not {ANALYSES['modal']}")
    if found["cyclic"] > 1 or any(found[f"complex{mode}"] for mode in range(len(at))):
        raise InputError(f"{path} holds modes of a cyclic sector, or complex ones, which are not read: expand them (/EXPAND), or "
                         "solve for real modes of the whole")
    if found["whole"] > len(found["at0"]):
        raise InputError(f"{path} holds {len(found['at0'])} of {found['whole']} nodes, of a distributed run: COMBINE its files")
    if not (np.isfinite(at).all() and at.min() >= 0 and np.isfinite(nodes).all()) or len(np.unique(numbers)) < len(numbers):
        raise InputError(f"{path} has impossible frequencies, places or numbers of nodes; it may be damaged, write it again")
    place = {number: row for row, number in enumerate(numbers.tolist())}
    listed = found["at0"].tolist()
    if len(set(listed)) < len(listed) or not set(listed) <= place.keys():
        raise InputError(f"{path} gives a solution at nodes that it does not have, or twice; it may be damaged, write it again")
    # motions of nodes, along the global axes
    rows = np.array([place[number] for number in listed])
    motions = np.zeros((len(listed), 6, len(at)))
    for mode in range(len(at)):
        values, kinds = found[f"values{mode}"], found[f"dofs{mode}"]
        if not np.array_equal(found[f"at{mode}"], found["at0"]) or not np.isfinite(values).all():
            raise InputError(f"{path}: mode {mode + 1} has other nodes than the first, or a NaN; it may be damaged")
        for column in np.flatnonzero((kinds >= 1) & (kinds <= 6)):
            motions[:, kinds[column] - 1, mode] = np.where(values[:, column] == NOTHING, 0.0, values[:, column])
    axes = _axes(nodes[rows, 3:])
    for start in (0, 3):
        motions[:, start:start + 3] = axes @ motions[:, start:start + 3]
    return (2j * np.pi * at, motions.reshape(-1, len(at)), np.repeat(numbers[rows], 6), np.tile(np.arange(6), len(rows)),
            np.repeat(nodes[rows, :3], 6, axis=0))


def _axes(angles: Array) -> Array:
    """Axes of nodes as columns, shape (n, 3, 3), turned about z, then their own x, then their own y, by angles in degrees."""
    from scipy.spatial.transform import Rotation

    axes: Array = Rotation.from_euler("ZXY", angles, degrees=True).as_matrix()
    return axes


def _check_header(path: Path, ending: str) -> None:
    """Refuses a file that is not of this kind of Ansys, or shorter than its header says."""
    words = np.fromfile(path, "<i4", HEADER["next record"])
    head = {name: int(words[at]) for name, at in HEADER.items() if at < len(words)}
    if len(words) < HEADER["next record"] or head["length of the record"] != 100 or head["file number"] != KINDS[ending]:
        raise InputError(f"{path} is no {ending} file of Ansys, or one of a machine with the other order of bytes")
    size = max(head["file length"], _long(head["file length, low"], head["file length, high"]))
    if path.stat().st_size < 4 * size:
        raise InputError(f"{path} announces {4 * size} bytes, but has {path.stat().st_size}; it is cut short or damaged")
