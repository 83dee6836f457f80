"""Valid matrix files and model folders for `fuzzing`, how they are read, and what damaged text honestly means."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
from fuzzing import Subject
from matrixhelp import Op2Writer, abaqus, numbered, sierra_netcdf, sierra_text, superelement_op2

import femsub as fs


def read_matrix(path: Path) -> Any:
    return fs.read_matrix(path)


def read_superelement(path: Path) -> Any:
    """A punch file, or the folder of an external superelement of Nastran."""
    return read_component(path / "arm.asm" if path.is_dir() else path, cutoff=1e4)


def read_component(path: Path, **more: Any) -> Any:
    """All that a model folder tells."""
    model = fs.read_component(path, **more)
    content = {"type": type(model).__name__, "M": model.M, "D": model.D, "K": model.K, "interface": model.interface,
               "ports": dict(model.ports), "name": model.name}
    reduced = isinstance(model, fs.ReducedSubstructure)
    dofs = model.full_dofs if reduced else model.dofs
    if dofs is not None:
        content["dofs"] = [dofs.nodes, dofs.components, dofs.labels, dofs.points]
    if reduced:
        content |= {key: getattr(model, key) for key in ("V", "kinds", "full_interface", "cutoff", "method", "dropped",
                                                         "port_error", "factorisations", "modes", "noise")}
    if reduced and (path / "model.json").is_file():  # elsewhere they follow from the matrices
        content |= {key: None if (one := getattr(model, key)) is None else one.record() for key in ("estimate", "origin")}
        content["rigid motion"] = model.rigid_motion.record() if hasattr(model.rigid_motion, "record") else None
    content |= {"H": model.H, "sets": {name: np.asarray(places) for name, places in model.sets.items()}}
    return content


NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?(?:\d+\.\d*|\.\d+)[+-]\d{3}", re.ASCII)
WHOLE = re.compile(r"[+-]?\d+", re.ASCII)
LARGEST = 1e6  # rows: a reader may refuse what is larger, and the harness need not build it


def _value(word: str, spelled: bool = False) -> float:
    if spelled and re.fullmatch(r"(?i)[+-]?(nan|inf)", word):
        return float(word)
    if not NUMBER.fullmatch(word):
        raise ValueError(word)
    value = float(re.sub(r"(?<=[\d.])([+-]\d{3})$", r"e\1", re.sub("[dD]", "e", word)))
    if not math.isfinite(value):
        raise ValueError(word)
    return value


def _entries(lines: list[list[str]], shape: tuple[int, int], mirror: float, spelled: bool = True) -> Any:
    """A sparse matrix of [row, column, value]; mirror is the factor of the other triangle, 0 for none."""
    dense, seen = {}, set()
    for words in lines:
        row, column, value = int(words[0]), int(words[1]), _value(words[2], spelled)
        places = {(row, column): value} if not mirror or row == column else {(row, column): value, (column, row): mirror * value}
        if seen & set(places) or not (1 <= row <= shape[0] and 1 <= column <= shape[1]):
            raise ValueError(words)
        seen |= set(places)
        dense |= places
    rows, columns = (np.array([place[axis] - 1 for place in dense], dtype=int) for axis in (0, 1))
    return sp.csr_array((np.array(list(dense.values()), dtype=float), (rows, columns)), shape=shape)


def honest_market(path: Path) -> Any:
    """What a Matrix Market file says, word by word; None if it says nothing."""
    try:
        first, *rest = path.read_bytes().decode("utf-8", "replace").replace("\r\n", "\n").split("\n")
        words = first.lower().split()
        kind, field, symmetry = words[2:]
        mirror = {"general": 0, "symmetric": 1, "hermitian": 1, "skew-symmetric": -1}[symmetry]
        if words[:2] != ["%%matrixmarket", "matrix"] or field not in ("real", "integer"):
            return None
        while rest[0].startswith("%") or not rest[0].split():
            rest.pop(0)
        sizes = [int(word) for word in rest.pop(0).split() if WHOLE.fullmatch(word) or int("x")]
        lines = [line.split() for line in rest if line.split()]
        if field == "integer" and not all(WHOLE.fullmatch(words[-1]) for words in lines):
            return None
        if (mirror and sizes[0] != sizes[1]) or {len(words) for words in lines} != {3 if kind == "coordinate" else 1}:
            return None
        if max(sizes[:2]) > LARGEST:
            return None
        if kind == "coordinate":
            if len(lines) != sizes[2] or not all(WHOLE.fullmatch(word) for words in lines for word in words[:2]):
                return None
            found = _entries(lines, (sizes[0], sizes[1]), mirror)
            return None if mirror < 0 and found.diagonal().any() else found
        if sizes[0] * sizes[1] > 1e5:
            return None
        places = [(row + 1, column + 1) for column in range(sizes[1]) for row in
                  range(0 if not mirror else column + (mirror < 0), sizes[0])]
        whole = [[str(row), str(column), *words] for (row, column), words in zip(places, lines, strict=True)]
        return _entries(whole, (sizes[0], sizes[1]), mirror).toarray() if kind == "array" else None
    except (ValueError, KeyError, IndexError):
        return None


def honest_text(path: Path) -> Any:
    """What a file of Abaqus or CalculiX says, of one triangle or both; None if it says nothing."""
    try:
        text = path.read_bytes().decode("utf-8", "replace").replace("\r\n", "\n")
        lines = [re.split(r"\s*,\s*|\s+", line.strip()) for line in text.split("\n") if line.split() and line[:2] != "**"]
        if {len(words) for words in lines} not in ({3}, {5}):
            return None
        names: list[Any] = [[(_value(a), _value(b)) for a, b in zip(words[:-1:2], words[1:-1:2], strict=True)] if len(words) == 5
                            else [_value(words[0]), _value(words[1])] for words in lines]
        order = sorted({name for pair in names for name in pair})
        if len(lines[0]) == 3 and max(order) > 1e5:
            return None
        if len(lines[0]) == 3:
            order = list(range(1, int(max(order)) + 1))
        place = {name: str(number) for number, name in enumerate(order, 1)}
        whole = [[place[row], place[column], words[-1]] for (row, column), words in zip(names, lines, strict=True)]
        one = _entries(whole, (len(order), len(order)), 0, False)
        pairs = {(row, column) for row, column, _ in whole if row != column}
        return one if pairs and all((column, row) in pairs for row, column in pairs) else _entries(whole, one.shape, 1, False)
    except (ValueError, KeyError, IndexError):
        return None


DMIG = (b"DMIG", b"DMIG*", b"KAAX", b"MAAX", b"GRID*", b"SPOINT", b"THRU", b"QSET1", b"DTI", b"TUG1", b"EXTRN", b"SECONCT",
        b"BEGIN SUPER", b"ENDDATA", b"CORD2R", b"INCLUDE", b"$", b"*", b"MUG1T")


def read_op2(path: Path) -> Any:
    return {name: fs.read_matrix(path, name) for name in "KM"}


def read_dmig(path: Path) -> Any:
    return fs.read_matrix(path, "KAAX")


def entries_of_dmig(data: bytes) -> list[tuple[int, int]]:
    """Places and values of entries of K."""
    start, stop = data.index(b"DMIG    KAAX"), data.index(b"DMIG    MAAX")
    found = re.finditer(rb"(?<=[ ])[\d.+-]+D?[+-]?\d*(?=\s)", data[:stop])
    return [word.span() for word in found if word.start() > start + 72]


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
    market = {"vocabulary": words, "header": 60, "honest": honest_market}
    made = []

    def add(name: str, file: str, **how: Any) -> Path:
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        made.append(Subject(name, path, **{"reader": read, **how}))
        return path

    scipy.io.mmwrite(add("mtx", "a/K.mtx", **market), K, precision=17, symmetry="general")
    scipy.io.mmwrite(add("mtx-symmetric", "b/K.mtx", **market), K, precision=17, symmetry="symmetric")
    scipy.io.mmwrite(add("mtx-array", "c/K.mtx", **market), K.toarray(), precision=17)
    scipy.io.mmwrite(add("mtx-integer", "d/K.mtx", **market), sp.coo_array((10 * K).astype(int)))
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
    abaqus(add("abaqus", "j/K.mtx", honest=honest_text), K, dofs)
    numbered(add("calculix", "j/K.sti", honest=honest_text), K, sp.triu, "%20.13e")
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
    arm = fs.solid(fs.block((1.0, 0.1, 0.1), (3, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"],
                   name="arm")
    super_ = fs.reduce(arm, fs.CraigBampton(modes=3))
    reader = "fuzz_matrices:read_superelement"
    cards: dict[str, Any] = {"vocabulary": DMIG, "strict": frozenset({"word", "comma", "nul"}), "words": entries_of_dmig}
    fs.write_superelement(folder / "m", super_, "dmig", recover="all")
    made.append(Subject("dmig", folder / "m" / "arm.pch", reader, **cards))
    old = folder / "foreign" / "arm.pch"  # as other programs write it, without a count and a sum of lines
    old.parent.mkdir()
    old.write_text(re.sub(", by femsub.*", "", (folder / "m" / "arm.pch").read_text(), count=1))
    made.append(Subject("dmig-foreign", old, reader, units=lambda data: data.split(b"\n"), **cards))
    made.append(Subject("dmig-matrix", folder / "m" / "arm.pch", "fuzz_matrices:read_dmig", **cards))
    if any(subject.name == "op4" for subject in made):
        fs.write_superelement(folder / "n", super_, "nastran", recover="all")
        (folder / "n" / "validity.json").unlink()
        made.append(Subject("superelement", folder / "n", reader, vocabulary=DMIG, strict=frozenset({"comma", "nul"}),
                            text_file=lambda name: name.endswith((".asm", ".pch"))))
    (folder / "o").mkdir()
    made.append(Subject("op2", Op2Writer().matrix("K", K).matrix("M", K).write(folder / "o" / "K.op2"), "fuzz_matrices:read_op2",
                        header=400, **binary))
    made.append(Subject("op2-superelement", superelement_op2(folder / "o" / "arm.op2", super_), reader, header=400, **binary))
    made.append(Subject("sierra", sierra_text(folder / "o", "arm", arm)[1], read, units=lambda data: data.split(b"\n")))
    made.append(Subject("sierra-netcdf", sierra_netcdf(folder / "o" / "arm.nc", super_), reader, header=400, **binary))
    rom = fs.reduce(part, fs.CraigBampton(modes=5), ports=True)
    for form in ("mtx", "npz", "mat"):
        for name, whole in (("model", part), ("reduced", rom)):
            fs.write_matrices(folder / f"{name}-{form}", whole, form)
            made.append(Subject(f"{name}-{form}", folder / f"{name}-{form}", "fuzz_matrices:read_component",
                                strict=frozenset({"cut", "word", "bytes", "bits", "field", "block", "line", "swap", "delete",
                                                  "comma", "nul"})))
    return made
