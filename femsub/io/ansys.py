"""Ansys' .full files, K and M with node and direction of each row, read by PyAnsys' reader in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from femsub.checks import installed_by
from femsub.errors import InputError, MissingPackageError
from femsub.io.abaqus_calculix import TextMatrix

MODULE = "ansys.mapdl.reader"
SECONDS = 600  # for a file; PyAnsys needs 5 to start
MEMORY = 16  # GB of addresses that reading may take
#: reads the file that is named first into arrays in the second; the reader's compiled part aborts at files that are cut short
READ = """
import resource, sys
import numpy as np
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]) << 30,) * 2)
from ansys.mapdl.reader.full import FullFile
dofs, K, M = FullFile(sys.argv[1]).load_km(sort=True)
K, M = K.tocoo(), M.tocoo()
np.savez(sys.argv[2], dofs=dofs, K=K.data, K_row=K.row, K_col=K.col, M=M.data, M_row=M.row, M_col=M.col)
"""


def read_full(path: Path) -> dict[str, TextMatrix]:
    """K and M of a .full file, shape (n, n), with (node, direction from 1) of each row, ascending.

    ===================  =======================================================================================
    it reads             symmetric stiffness and mass in .full files of Ansys (WRFULL, or a modal analysis)
    it leaves out        DOF that a constraint holds
    it refuses           a lumped mass, unsymmetric matrices, whatever the reader refuses or crashes at
    it cannot know       whether a number is wrong: there is no checksum
    ===================  =======================================================================================

    The reader's compiled part crashes at files that are cut short, so it runs in a process of its own.

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        ansys-mapdl-reader is not installed.
    """
    if find_spec("ansys") is None or find_spec(MODULE) is None:
        raise MissingPackageError(f"Ansys' .full files need PyAnsys' reader: {installed_by('ansys-mapdl-reader')}")
    stamp = path.stat()
    found = _read(path, stamp.st_mtime_ns, stamp.st_size)
    return {key: TextMatrix(item.matrix.copy(), item.labels) for key, item in found.items()}


@lru_cache(maxsize=1)  # K and M are asked for one after the other
def _read(path: Path, changed: int, size: int) -> dict[str, TextMatrix]:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "matrices.npz"
        try:
            command = [sys.executable, "-c", READ, str(path.absolute()), str(target), str(MEMORY)]
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=SECONDS, errors="replace")
        except subprocess.TimeoutExpired:
            raise InputError(f"{path} was not read within {SECONDS} s; it may be damaged") from None
        if done.returncode or not target.is_file():
            last = (done.stderr.strip().splitlines() or [""])[-1]
            if last.startswith("ModuleNotFoundError"):
                raise MissingPackageError(f"Ansys' .full files need PyAnsys' reader and all it needs ({last}): "
                                          f"{installed_by('ansys-mapdl-reader')}")
            reason = last if done.returncode > 0 and last else f"its reader stopped with status {done.returncode}"
            raise InputError(f"{path} cannot be read ({reason:.160}); it may be cut short or damaged, write it again")
        with np.load(target) as found:
            dofs = found["dofs"].astype(np.int64)
            part = {key: sp.coo_array((found[key], (found[f"{key}_row"], found[f"{key}_col"])), shape=(len(dofs), len(dofs)))
                    for key in "KM"}
    whole = {key: sp.csr_array(matrix + sp.triu(matrix, 1).T + sp.tril(matrix, -1).T) for key, matrix in part.items()}
    if not all(np.isfinite(matrix.data).all() for matrix in whole.values()):
        raise InputError(f"{path} holds a NaN or Inf")
    used = np.flatnonzero((abs(whole["K"]) + abs(whole["M"])).sum(axis=0))
    labels = np.stack([dofs[used, 0], dofs[used, 1] + 1], axis=1)
    if not len(used) or len(np.unique(labels, axis=0)) < len(labels) or labels.min() < 1:
        raise InputError(f"{path} holds no DOF, or some of them twice; it may be damaged, write it again")
    return {key: TextMatrix(sp.csr_array(matrix[used][:, used]), labels) for key, matrix in whole.items()}
