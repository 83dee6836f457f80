"""`write_matrices`: a model, full or reduced, into files that MATLAB, SciPy, Nastran and others read, and back."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from femsub.errors import InputError, unknown_name
from femsub.files import Writer, write_whole
from femsub.matrixfiles import read_matrix
from femsub.op4files import op4_module
from femsub.pencil import Matrix
from femsub.substructure import ReducedSubstructure, Substructure
from femsub.textmatrices import read_dofs, write_dofs

INDEX = "model.json"  # what a folder of `write_matrices` says of itself
FORMATS = ("mtx", "npz", "mat", "op4")


def write_matrices(folder: str | Path, model: Substructure, format: str = "mtx") -> list[Path]:
    """M, D, K, shape (n, n), and of a reduced model V, shape (n_full, r), into files; returns what was written.

    Parameters
    ----------
    folder : str or Path
        It is made if it is not there.
    model : Substructure
        Full or reduced.
    format : str
        'mtx' (Matrix Market, 17 digits) and 'npz' (SciPy; .npy for dense ones) have a file for each matrix; 'mat' (MATLAB)
        has M, D, K, V, ports and interface (counted from 1) in model.mat, 'op4' (Nastran) M, D, K, V and ports in model.op4.

    Beside them stand model.json (interface from 0, names of ports and their number of columns, the kind of each column
    of V, cut-off, ...) and, where the model knows it, dofs.csv with node, component, x, y, z of each DOF: of a reduced
    model those of the rows of V. `read_component(folder)` gives the model back to the last digit.

    Raises
    ------
    InputError
        An unknown format, or a folder that cannot be written. Each file is written whole or not at all.
    MissingPackageError
        'op4' without pyyeti.
    """
    try:
        return write_whole(Path(folder), matrix_files(model, format))
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be written: {error.strerror or error}") from None


def matrix_files(model: Substructure, format: str = "mtx") -> dict[str, Writer]:
    """The files of `write_matrices`: name to a function that writes the content."""
    if format not in FORMATS:
        raise unknown_name("format", format, FORMATS)
    parts: dict[str, Matrix] = {"M": model.M, "D": model.D, "K": model.K}
    about: dict[str, Any] = {"femsub": 1, "name": model.name, "interface": model.interface.tolist(),
                             "ports": {port: 0 if w.ndim == 1 else w.shape[1] for port, w in model.ports.items()}}
    dofs = model.dofs
    if isinstance(model, ReducedSubstructure):
        parts["V"], dofs = model.V, model.full_dofs
        about["reduced"] = {"interface": model.full_interface.tolist(), "kinds": model.kinds, "method": model.method,
                            "dropped": model.dropped,
                            "cutoff": None if np.isinf(model.cutoff) else model.cutoff,
                            "port_error": {port: float(error) for port, error in model.port_error.items()},
                            "factorisations": model.factorisations}
    if model.ports:
        parts["ports"] = np.column_stack(list(model.ports.values()))
    if dofs is not None:
        about["labels"] = dofs.labels
    writers: dict[str, Writer] = {}
    if format in ("mat", "op4"):
        target = f"model.{format}"
        about["files"] = {key: f"{target}:{key}" for key in parts}
        writers[target] = _matlab_writer(model, parts) if format == "mat" else _op4_writer(parts)
    else:
        about["files"] = {key: f"{key}.{'npy' if format == 'npz' and not sp.issparse(part) else format}"
                          for key, part in parts.items()}
        writers |= {file: _single_writer(parts[key], file) for key, file in about["files"].items()}
    if dofs is not None:
        about["dofs"], known = "dofs.csv", dofs
        writers["dofs.csv"] = lambda file: write_dofs(file, known)
    text = json.dumps(about, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    writers[INDEX] = lambda file: file.write(text.encode())
    return writers


def _single_writer(part: Matrix, file_name: str) -> Writer:
    def write(file: BinaryIO) -> None:
        if file_name.endswith(".npz"):
            sp.save_npz(file, part)
        elif file_name.endswith(".npy"):
            np.save(file, part, allow_pickle=False)
        else:
            from scipy.io import mmwrite

            mmwrite(file, part, precision=17)

    return write


def _matlab_writer(model: Substructure, parts: Mapping[str, Matrix]) -> Writer:
    def write(file: BinaryIO) -> None:
        from scipy.io import savemat

        names = np.array(list(model.ports), dtype=object)
        savemat(file, {**parts, "interface": (model.interface + 1).astype(float), "port_names": names, "name": model.name},
                do_compression=False, oned_as="column")

    return write


def _op4_writer(parts: Mapping[str, Matrix]) -> Writer:
    op4 = op4_module()  # before anything is written

    def write(file: BinaryIO) -> None:
        with tempfile.TemporaryDirectory() as folder:  # pyyeti wants a name, and closes what it opens
            path = os.path.join(folder, "model.op4")
            op4.write(path, dict(parts))
            with open(path, "rb") as whole:
                while block := whole.read(1 << 24):
                    file.write(block)

    return write


def read_model(folder: Path) -> Substructure:
    """What `write_matrices` wrote into a folder; no such folder, or a damaged one, is an InputError."""
    path = folder / INDEX
    if not path.is_file():
        raise InputError(f"K is missing: name its file (and {folder} is no folder of write_matrices: it holds no {INDEX})")
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        files, widths, reduced = about["files"], about["ports"], about.get("reduced")
        part = {key: read_matrix(folder / file) for key, file in files.items()}
        found = read_dofs(folder / about["dofs"], tuple(about["labels"])) if "dofs" in about else None
        columns, start = {}, 0
        for port, width in widths.items():
            columns[port] = part["ports"][:, start] if width == 0 else part["ports"][:, start:start + width]
            start += max(width, 1)
        if reduced is None:
            return Substructure(part["M"], part["K"], part["D"], about["interface"], columns, about["name"], found)
        return ReducedSubstructure(
            part["M"], part["K"], part["D"], columns, about["name"], V=np.array(part["V"]), kinds=reduced["kinds"],
            full_interface=np.array(reduced["interface"], dtype=np.intp),
            cutoff=np.inf if reduced["cutoff"] is None else reduced["cutoff"], method=reduced["method"],
            dropped=reduced["dropped"], port_error=reduced["port_error"], factorisations=reduced["factorisations"],
            full_dofs=found)
    except (KeyError, TypeError, IndexError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is damaged ({type(error).__name__}: {error}); write the model again") from None
