"""Valid matrix files and model folders for `fuzzing`, how they are read, and what damaged text honestly means."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
from fuzzing import Subject
from matrixhelp import abaqus, numbered

import femsub as fs


def read_matrix(path: Path) -> Any:
    return fs.read_matrix(path)


def read_component(path: Path) -> Any:
    """All that a model folder tells."""
    model = fs.read_component(path)
    content = {"type": type(model).__name__, "M": model.M, "D": model.D, "K": model.K, "interface": model.interface,
               "ports": dict(model.ports), "name": model.name}
    reduced = isinstance(model, fs.ReducedSubstructure)
    dofs = model.full_dofs if reduced else model.dofs
    if dofs is not None:
        content["dofs"] = [dofs.nodes, dofs.components, dofs.labels, dofs.points]
    if reduced:
        content |= {key: getattr(model, key) for key in ("V", "kinds", "full_interface", "cutoff", "method", "dropped",
                                                         "port_error", "factorisations")}
    return content


def model() -> fs.Substructure:
    """24 DOF with unsymmetric D, two ports, names and places of its DOF."""
    n, rng = 24, np.random.default_rng(3)
    K = sp.diags_array([-np.ones(n - 2), 2.5 * np.ones(n) + rng.random(n), -np.ones(n - 2)], offsets=[-2, 0, 2])
    D = sp.random(n, n, 0.1, random_state=5, format="csr")
    dofs = fs.DofMap(np.repeat(np.arange(n // 2) * 7 + 3, 2), np.tile([0, 1], n // 2), points=rng.standard_normal((n, 2)))
    return fs.Substructure(sp.diags_array(1 + rng.random(n)), K, D, [0, 1, 22, 23],
                           {"pad": rng.standard_normal((n, 2)), "belt": np.eye(n)[12]}, "lättice", dofs)


def subjects(folder: Path) -> list[Subject]:
    part = model()
    K, dofs = sp.csc_array(part.K), part.dofs
    assert dofs is not None
    read, words = "fuzz_matrices:read_matrix", (b"%%MatrixMarket", b"matrix", b"coordinate", b"array", b"real", b"complex",
                                                b"integer", b"pattern", b"general", b"symmetric", b"skew-symmetric", b"hermitian")
    made = []

    def add(name: str, file: str, **how: Any) -> Path:
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        made.append(Subject(name, path, **{"reader": read, **how}))
        return path

    scipy.io.mmwrite(add("mtx", "a/K.mtx", vocabulary=words, header=60), K, precision=17, symmetry="general")
    scipy.io.mmwrite(add("mtx-symmetric", "b/K.mtx", vocabulary=words, header=60), K, precision=17, symmetry="symmetric")
    scipy.io.mmwrite(add("mtx-array", "c/K.mtx", vocabulary=words, header=60), K.toarray(), precision=17)
    scipy.io.mmwrite(add("mtx-integer", "d/K.mtx", vocabulary=words, header=60), sp.coo_array((10 * K).astype(int)))
    binary = {"text": False, "strict": frozenset({"cut"})}
    sums = {"text": False, "strict": frozenset({"cut", "bytes", "bits"})}
    sp.save_npz(add("npz", "e/K.npz", **sums), K)
    sp.save_npz(add("npz-raw", "e/K-raw.npz", **sums), sp.coo_array(K), compressed=False)
    np.savez(add("npz-dense", "f/K.npz", **sums), K=K.toarray())
    np.save(add("npy", "g/K.npy", **binary), K.toarray())
    for name, content in (("mat", K), ("mat-dense", K.toarray())):
        scipy.io.savemat(add(name, f"h/{name}.mat", **binary), {"K": content})
        scipy.io.savemat(add(f"{name}-packed", f"h/{name}-packed.mat", **sums), {"K": content}, do_compression=True)
        scipy.io.savemat(add(f"{name}-4", f"h/{name}-4.mat", **binary), {"K": content}, format="4")
    scipy.io.savemat(add("mat-mixed", "h/mixed.mat", **binary), {"K": K, "text": "hello", "s": {"a": 1.0, "b": [1, 2]},
                                                                 "c": np.array(["x", "yz"], dtype=object)})
    abaqus(add("abaqus", "j/K.mtx"), K, dofs)
    numbered(add("calculix", "j/K.sti"), K, sp.triu, "%20.13e")
    try:
        from pyyeti.nastran import op4

        op4.write(str(add("op4", "k/K.op4", **binary)), {"k": K})
        op4.write(str(add("op4-text", "k/K-text.op4")), {"k": K}, binary=False, digits=17)
    except ImportError:
        pass
    try:
        import h5py

        with h5py.File(add("mat-7.3", "l/K.mat", **binary), "w", userblock_size=512) as file:
            group = file.create_group("K")
            group.attrs["MATLAB_sparse"] = np.uint64(K.shape[0])
            for name, values in (("data", K.data), ("ir", K.indices.astype(np.uint64)), ("jc", K.indptr.astype(np.uint64))):
                group[name] = values
    except ImportError:
        pass
    rom = fs.reduce(part, fs.CraigBampton(modes=5), ports=True)
    for form in ("mtx", "npz", "mat"):
        for name, whole in (("model", part), ("reduced", rom)):
            fs.write_matrices(folder / f"{name}-{form}", whole, form)
            made.append(Subject(f"{name}-{form}", folder / f"{name}-{form}", "fuzz_matrices:read_component",
                                strict=frozenset({"cut", "word", "bytes", "bits", "field", "block", "line", "swap", "delete"})))
    return made
