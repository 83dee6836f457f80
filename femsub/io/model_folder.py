"""`write_matrices`: write a full or reduced model to files that MATLAB, SciPy, Nastran and others can read; and read it back."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from femsub.checks import InputError, Matrix, as_word, choice, instance, path_of, unlike
from femsub.io.abaqus_calculix import read_dofs, write_dofs
from femsub.io.atomic import HASHES, Writer, content_sum, newest, scratch, with_index, write_or_refuse
from femsub.io.matrix_files import read_together
from femsub.io.op4 import op4_module
from femsub.model import Estimate, Inertia, Origin, ReducedSubstructure, RigidMotion, Substructure

FORMATS = ("mtx", "npz", "mat", "op4")
INDEX = "model.json"
VERSION = 1


def write_matrices(folder: str | Path, model: Substructure, format: str = "mtx") -> list[Path]:
    """Write a model to files: M, D, K of shape (n, n), and for a reduced model V of shape (n_full, r).

    Parameters
    ----------
    folder : str or Path
        Created if it does not exist.
    model : Substructure
        Full or reduced.
    format : str
        'mtx' (Matrix Market, 17 digits) and 'npz' (SciPy; .npy if dense) have a file for each matrix; 'mat' (MATLAB)
        has M, D, K, V, ports and interface (counted from 1) in model.mat, 'op4' (Nastran) M, D, K, V and ports in model.op4.

    Returns
    -------
    list of Path
        The files written. model.json holds the interface (counted from 0) and its named sets, names of ports and their number
        of columns, the kind of each column of V, cut-off, a hash of each file, etc. If the model has a DOF map, dofs.csv
        holds node, component, x, y, z of each DOF (for a reduced model: of each row of V). `read_component(folder)` restores
        the model exactly.

    Raises
    ------
    InputError
        An unknown format; a folder that cannot be written, or into which another process writes. If the process is killed,
        the folder holds the old model or the new one, as `read_component` reads it. Its next write puts the files in order.
    MissingPackageError
        'op4' without pyyeti.

    Examples
    --------
    >>> import femsub as fs
    >>> rom = fs.reduce(fs.chain(10, belt=1), fs.CraigBampton(3))
    >>> sorted(path.name for path in fs.write_matrices("model", rom))
    ['D.mtx', 'K.mtx', 'M.mtx', 'V.mtx', 'model.json', 'ports.mtx']
    """
    target = path_of("folder", folder)
    return write_or_refuse(f"the folder {folder}", target, model_files(instance("model", model, Substructure), format))


def model_files(model: Substructure, format: str = "mtx") -> dict[str, Writer]:
    """The files of `write_matrices`: name to a function that writes the content."""
    choice("format", format, FORMATS)
    parts: dict[str, Matrix] = {"M": model.M, "D": model.D, "K": model.K}
    about: dict[str, Any] = {"femsub": VERSION, "name": model.name, "interface": model.interface.tolist(),
                             "ports": {port: 0 if w.ndim == 1 else w.shape[1] for port, w in model.ports.items()}}
    if model.H is not None:
        parts["H"] = model.H
    dofs = model.dofs
    if isinstance(model, ReducedSubstructure):
        parts["V"], dofs = model.V, model.full_dofs
        about["reduced"] = {"interface": model.full_interface.tolist(), "kinds": model.kinds, "modes": model.modes,
                            "method": model.method, "dropped": model.dropped,
                            "cutoff": None if np.isinf(model.cutoff) else model.cutoff,
                            "port_error": {port: float(error) if np.isfinite(error) else None
                                           for port, error in model.port_error.items()},
                            "factorisations": model.factorisations,
                            "estimate": None if model.estimate is None else model.estimate.record(),
                            "rigid_motion": motion.record() if isinstance(motion := model.rigid_motion, RigidMotion) else None,
                            "noise": model.noise.tolist(),
                            "origin": None if model.origin is None else model.origin.record(),
                            "inertia": None if model.inertia is None else model.inertia.record()}
    if model.sets and (isinstance(model, ReducedSubstructure) or len(model.interface)):
        about["sets"] = {key: places.tolist() for key, places in model.sets.items()}
    if model.ports:
        parts["ports"] = np.column_stack(list(model.ports.values()))
    if dofs is not None:
        about["labels"] = dofs.labels
    writers: dict[str, Writer] = {}
    if format in ("mat", "op4"):
        target = f"model.{format}"
        about["files"] = {key: f"{target}:{key}" for key in parts}
        writers[target] = (partial(_write_matlab, model=model, parts=parts) if format == "mat" else
                           partial(write_op4, op4=op4_module(), parts=parts))
    else:
        about["files"] = {key: f"{key}.{'npy' if format == 'npz' and not sp.issparse(part) else format}"
                          for key, part in parts.items()}
        writers |= {file: partial(write_single, part=parts[key], name=file) for key, file in about["files"].items()}
    if dofs is not None:
        about["dofs"] = "dofs.csv"
        writers["dofs.csv"] = partial(write_dofs, dofs=dofs)
    return with_index(writers, INDEX, about)


def write_single(file: BinaryIO, part: Matrix, name: str) -> None:
    if name.endswith(".npz"):
        sp.save_npz(file, part)
    elif name.endswith(".npy"):
        np.save(file, part, allow_pickle=False)
    else:
        from scipy.io import mmwrite

        mmwrite(file, part, precision=17)


def _write_matlab(file: BinaryIO, model: Substructure, parts: Mapping[str, Matrix]) -> None:
    from scipy.io import savemat

    names = np.array(list(model.ports), dtype=object)
    savemat(file, {**parts, "interface": (model.interface + 1).astype(float), "port_names": names, "name": model.name},
            do_compression=False, oned_as="column")


def write_op4(file: BinaryIO, op4: Any, parts: Mapping[str, Matrix]) -> None:
    need = sum((24.0 if sp.issparse(part) else 8.0) * part.size for part in parts.values())
    with scratch(need) as folder:  # pyyeti needs a file name, and closes the file
        path = folder / "model.op4"
        op4.write(str(path), dict(parts))
        whole = path.open("rb")
    with whole:  # the file can be read although its name is gone; errors now come from the target
        shutil.copyfileobj(whole, file)


def read_model(folder: Path) -> Substructure:
    """Read a model that `write_matrices` wrote, exactly.

    ===================  =======================================================================================
    it reads             folders of this version, in each of the four formats, full and reduced models
    it refuses           model.json with another content than femsub wrote (its sum is among the hashes); a
                         file that is not the one it was written with (each has its hash there): damaged,
                         changed, or of another model; a file outside the folder; entries of model.json that are
                         missing, of another kind, or do not fit the matrices; another version, or one without hashes
    it cannot know       whether an entry of model.json was changed, if femsub wrote it before it had a sum of its own
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table; no such folder.
    """
    path = newest(folder, INDEX)
    if not path.is_file():
        raise InputError(f"K is missing: name its file. {folder} is not a folder of write_matrices, since it has no {INDEX}")
    about = _index(path, folder)
    # matrices: each file is read once; V and ports are tables of real, finite numbers
    files: dict[str, dict[str, str | None]] = {}
    for key, place in about["files"].items():
        file, _, name = place.partition(":")
        files.setdefault(file, {})[key] = name or None
    part: dict[str, Matrix] = {}
    for file, names in files.items():
        part |= dict(zip(names, read_together(newest(folder, file), names.values()), strict=True))
    for key in part.keys() & {"V", "ports"}:
        table = part[key]
        if sp.issparse(table) or table.ndim != 2 or table.dtype.kind not in "biuf" or not np.isfinite(table).all():
            raise InputError(f"{folder / about['files'][key]} is no table of finite numbers for {key}; write the model again")
    # DOF map and ports
    found = read_dofs(newest(folder, about["dofs"]), tuple(about["labels"])) if "dofs" in about else None
    columns, start, width = {}, 0, sum(max(width, 1) for width in about["ports"].values())
    if width and part["ports"].shape[1] != width:
        raise _damaged(path, f"its ports have {width} columns, but there are {part['ports'].shape[1]}")
    for port, width in about["ports"].items():
        columns[port] = part["ports"][:, start] if width == 0 else part["ports"][:, start:start + width]
        start += max(width, 1)
    # a full model
    reduced = about.get("reduced")
    if reduced is None:
        return Substructure(part["M"], part["K"], part["D"], about["interface"], columns, about["name"], found,
                            about.get("sets"), part.get("H"))
    # what a reduced model keeps of the full one
    V = np.array(part["V"])
    interface = np.array(reduced["interface"], dtype=np.intp)
    # older folders have no count
    modes = reduced.get("modes", sum(kind in ("fixed-interface", "free") for kind in reduced["kinds"]))
    if V.shape[1] != part["M"].shape[0] or len(reduced["kinds"]) != V.shape[1] or (found and found.size != V.shape[0]):
        raise _damaged(path, f"V is {V.shape[0]} x {V.shape[1]}, but M has {part['M'].shape[0]} rows, "
                             f"{len(reduced['kinds'])} kinds are listed"
                             + (f", and the DOF map has {found.size}" if found else ""))
    if interface.max(initial=-1) >= V.shape[0] or len(set(reduced["interface"])) < len(interface) \
            or not set(reduced["port_error"]) <= set(columns) or modes > V.shape[1]:
        raise _damaged(path, "its interface, its modes or its errors of ports are not the model's")
    with _fitting(path, "the rounding of its matrices"):
        noise = np.array(reduced.get("noise", []), dtype=float).reshape(V.shape[1], -1)
    with _fitting(path, "its rigid motion"):
        record, motion = reduced.get("rigid_motion"), None
        if record is not None:
            shapes = np.array(record["shapes"], dtype=float).reshape(V.shape[1], -1)
            if not (np.isfinite(shapes).all() and 0 <= record["free"] <= shapes.shape[1]):
                raise ValueError
            motion = RigidMotion(shapes, int(record["free"]))
    with _fitting(path, "its estimate"):
        estimate = None if (record := reduced.get("estimate")) is None else Estimate.of_record(record)
    with _fitting(path, "its origin"):
        origin = None if (record := reduced.get("origin")) is None else Origin.of_record(record)
    with _fitting(path, "its inertia"):
        inertia = None if (record := reduced.get("inertia")) is None else Inertia.of_record(record, V.shape[1])
    model = ReducedSubstructure(
        part["M"], part["K"], part["D"], columns, about["name"], V=V, kinds=reduced["kinds"], full_interface=interface,
        modes=modes, cutoff=np.inf if reduced["cutoff"] is None else reduced["cutoff"], method=reduced["method"],
        dropped=reduced["dropped"], port_error={port: np.inf if error is None else error
                                                for port, error in reduced["port_error"].items()},
        factorisations=reduced["factorisations"], full_dofs=found, sets=about.get("sets") or {}, estimate=estimate,
        rigid_motion=motion, noise=noise, H=part.get("H"), origin=origin, inertia=inertia)
    if model.interface.tolist() != about["interface"]:
        raise _damaged(path, f"its interface {about['interface']} is not that of V")
    return model


@contextmanager
def _fitting(path: Path, what: str) -> Iterator[None]:
    """Refuses an entry of model.json from which its object cannot be made."""
    try:
        yield
    except InputError as error:
        raise _damaged(path, error) from None
    except (ArithmeticError, KeyError, TypeError, ValueError):
        raise _damaged(path, f"{what} does not fit its matrices") from None


def _damaged(path: Path, why: object) -> InputError:
    return InputError(f"{path} is damaged: {why}; write the model again")


# ---- model.json, checked entry by entry and against the files

def _index(path: Path, folder: Path) -> dict[str, Any]:
    """The content of model.json. The type of every entry is checked, and the hash of every file.

    Raises
    ------
    InputError
        An entry that is missing, repeated or of the wrong type; another version; a file outside the folder, missing, or
        changed.
    """
    try:
        about = json.loads(path.read_bytes().decode("utf-8"), object_pairs_hook=_once, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, f"{error!s:.100}") from None
    # its version
    if not isinstance(about, dict):
        raise _damaged(path, "it holds no table of names")
    version = about.get("femsub")
    if type(version) is not int or version != VERSION:
        raise InputError(f"{path} has the version {version!r} ('femsub'), but this femsub reads {VERSION}; write the model "
                         "with this version, or read its matrices one by one")
    if HASHES not in about:
        raise InputError(f"{path} has no hashes of its files, since an older femsub wrote it. Write the model again, or read its "
                         "matrices one by one, read_component('M.mtx', 'K.mtx')")
    # its entries
    _check_entries(path, "", about, CHECKS + MAP * ("dofs" in about) + SETS * ("sets" in about))
    reduced = about.get("reduced")
    if reduced is not None:
        if not isinstance(reduced, dict):
            raise _damaged(path, f"'reduced' must be a table, not {reduced!r:.40}")
        _check_entries(path, "reduced: ", {"modes": 0} | reduced, REDUCED)
    wanted = {"M", "D", "K"} | ({"H"} & set(about["files"])) | ({"V"} if reduced is not None else set())
    wanted |= {"ports"} if about["ports"] else set()
    if set(about["files"]) != wanted:
        raise _damaged(path, f"'files' must name {', '.join(sorted(wanted))}, but names "
                             f"{', '.join(sorted(about['files'])) or 'none'}")
    # the files it names
    named = {place.partition(":")[0] for place in about["files"].values()} | ({about["dofs"]} if "dofs" in about else set())
    expected_of = {name: known for name, known in about[HASHES].items() if name != INDEX}  # the index has `content_sum`
    if named != set(expected_of):
        raise _damaged(path, f"it has hashes of {', '.join(sorted(expected_of)) or 'no file'}, but names "
                             f"{', '.join(sorted(named))}")
    for name, expected in expected_of.items():
        file = newest(folder, name)
        if not file.is_file():
            raise InputError(f"there is no file {file}, which {path.name} names; write the model again")
        if why := unlike(file, expected):
            raise InputError(f"{file} is not the file that {path.name} was written with ({why}). Either a write was stopped, or "
                             "the file was changed. Write the model again, or read a file that you changed yourself by its own "
                             "name")
    if (known := about[HASHES].get(INDEX)) is not None and known != content_sum(INDEX, about):  # older folders have none
        raise _damaged(path, "it has another content than femsub wrote, by its own sum (if you changed it, take "
                             f"{INDEX!r} out of its {HASHES!r} instead)")
    return dict(about)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2 ** 62


def _is_size(value: Any) -> bool:  # JSON's 1e400 is infinite
    return type(value) in (int, float) and 0 <= value < math.inf


def _is_list(of: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(map(of, value))


def _is_table(of: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(map(of, value.values()))


def _is_file(value: Any) -> bool:
    """A name in this folder, and no path to somewhere else."""
    return _is_text(value) and value not in ("", ".", "..") and not set(value) & set("/\\:\0")


def _is_place(value: Any) -> bool:
    """A file, or one of its matrices: 'model.mat:K'."""
    return _is_text(value) and _is_file(value.partition(":")[0]) and not value.endswith(":")


Check = tuple[str, Callable[[Any], bool], str]
CHECKS: tuple[Check, ...] = (
    ("name", lambda value: _is_text(value) and as_word(value) == value, "a text of printable characters"),
    ("interface", _is_list(_is_count), "a list of DOF counted from 0"),
    ("ports", _is_table(_is_count), "the number of columns of each port"),
    ("files", _is_table(_is_place), "a file in this folder for each matrix"),
    (HASHES, _is_table(_is_text), "the hash of each file"))
REDUCED: tuple[Check, ...] = (
    ("interface", _is_list(_is_count), "a list of DOF counted from 0"), ("kinds", _is_list(_is_text), "a list of texts"),
    ("modes", _is_count, "a count"), ("method", _is_text, "a text"), ("dropped", _is_count, "a count"),
    ("factorisations", _is_count, "a count"),
    ("cutoff", lambda value: value is None or (_is_size(value) and value > 0), "a positive number or null"),
    ("port_error", _is_table(lambda value: value is None or _is_size(value)), "a number for each port"))

SETS: tuple[Check, ...] = (("sets", _is_table(_is_list(_is_count)), "places in the interface for each of its sets"),)
MAP: tuple[Check, ...] = (("dofs", _is_file, "a file in this folder"), ("labels", _is_list(_is_text), "a list of texts"))


def _check_entries(path: Path, where: str, table: Mapping[str, Any], checks: tuple[Check, ...]) -> None:
    for key, test, what in checks:
        if key not in table:
            raise _damaged(path, f"{where}{key!r} is missing")
        if not test(table[key]):
            raise _damaged(path, f"{where}{key!r} must be {what}, not {table[key]!r:.80}")
