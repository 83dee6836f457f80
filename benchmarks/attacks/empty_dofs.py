"""DOF with neither mass nor stiffness: each analysis refuses them in the same words, and a reader leaves them out."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, dense, heard
from femsub.checks import Array

KINDS = ("refused", "dropped", "with dashpots", "joined")
WAYS = ("ux", "uy", "uz", "rx", "ry", "rz")


class Model:
    """A chain with further springs, held or floating, and the same with empty DOF between its own."""

    def __init__(self, rng: Random) -> None:
        self.rng, n = rng, int(rng.integers(4, 14))
        self.own, self.size = n, n + int(rng.integers(1, 9))
        self.rows = np.sort(rng.permutation(self.size)[:n])
        self.empty = np.setdiff1d(np.arange(self.size), self.rows)
        C = np.vstack([np.diff(np.eye(n), axis=0), rng.permuted(np.eye(n)[:2] - np.eye(n)[2:4], axis=1), np.eye(n)[:1]])
        C = C[:len(C) - int(rng.random() < 0.3)]
        scale = 10.0 ** rng.uniform(-3, 9)
        k, m = scale * rng.uniform(0.5, 2.0, len(C)), 10.0 ** rng.uniform(-3, 3) * rng.uniform(0.5, 2.0, n)
        self.K, self.M = C.T @ (k[:, None] * C), np.diag(m)
        self.D = float(rng.choice([0.0, 1e-3])) * np.sqrt(m.max() / scale) * self.K
        self.dense = bool(rng.integers(2))
        self.ends = np.sort(rng.permutation(n)[:int(rng.integers(1, 3))])
        self.at = int(rng.integers(n))
        width = int(rng.choice([1, 3, 6]))
        kinds = np.arange(self.size) % width
        self.dofs = fs.DofMap(10 + np.arange(self.size) // width, kinds, WAYS) if rng.random() < 0.7 else None

    def part(self, empty: bool = True, **other: Any) -> fs.Substructure:
        """The model with its empty DOF or without them."""
        rows, size, dofs = (self.rows, self.size, self.dofs) if empty else (
            np.arange(self.own), self.own, self.dofs and self.dofs.kept(self.rows))
        given: dict[str, Any] = {"interface": rows[self.ends], "ports": {"belt": np.eye(size)[rows[self.at]]}, "name": "part",
                                 "dofs": dofs}
        for key, A in (("M", self.M), ("K", self.K), ("D", self.D)):
            found = np.zeros((size, size))
            found[np.ix_(rows, rows)] = A
            given[key] = found if self.dense else sp.csr_array(found)
        return fs.Substructure(**(given | other))

    def name(self, row: int) -> str:
        return f"DOF {row}" if self.dofs is None else self.dofs.name(row)

    def words(self, rows: Array, model: str = "part") -> str:
        first = ", ".join(self.name(row) for row in rows[:3].tolist())
        more = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
        return f"{model!r}: {len(rows)} DOF {'have' if len(rows) > 1 else 'has'} neither mass nor stiffness: {first}{more}"


def analyses(part: fs.Substructure) -> dict[str, Callable[[], Any]]:
    belt, law = fs.Belt(slope=-0.01), fs.Belt(law=fs.StribeckArctan(), speed=1.0)
    return {
        "normal modes": lambda: fs.normal_modes(part, count=1), "a band": lambda: fs.normal_modes(part, band=(0.0, 1.0)),
        "complex modes": lambda: fs.complex_modes(part, count=2), "friction": lambda: fs.complex_modes(part, belt),
        "Craig-Bampton": lambda: fs.reduce(part, fs.CraigBampton(1)), "Craig-Chang": lambda: fs.reduce(part, fs.CraigChang(1)),
        "Guyan": lambda: fs.reduce(part, fs.Guyan()), "Rubin": lambda: fs.reduce(part, fs.Rubin(1)),
        "tolerance": lambda: fs.reduce(part, fs.CraigBampton(band=(0.0, 1.0), tol=1e-2)),
        "responses": lambda: fs.frequency_response(part, at=[1.0, 2.0], loads="belt"),
        "transient": lambda: fs.transient(part, law, time=(0.0, 1.0)), "balance": lambda: fs.harmonic_balance(part, law),
        "critical slope": lambda: fs.critical_slope(part, "belt"),
        "sweep": lambda: fs.sweep(part, fs.Belt(slope=0.0), "slope", values=[0.0, -0.1]),
        "couple": lambda: fs.couple({"part": part, "end": fs.chain(3, fixed=False, interface=[1])},
                                    [fs.Rigid(("part", part.interface[:1].tolist()), ("end", [0]))])}


def refusal(ask: Callable[..., Any], *args: Any, **options: Any) -> str:
    """What a call says when it refuses, without the remedy; nothing if it answers."""
    error = heard(ask, *args, **options)[1]
    kind = "" if error is None or isinstance(error, fs.SingularMatrixError) else f"{type(error).__name__}: "
    return "" if error is None else f"{kind}{error}".split(". Leave")[0]


def refused(model: Model) -> str:
    for name, ask in analyses(model.part()).items():
        if (said := refusal(ask)) != model.words(model.empty):
            return f"wrong: {name}: {said}"
    return "refused: in the same words"


def dropped(model: Model) -> str:
    """Read from files with and without `drop_empty`, as plain matrices with a map or as Abaqus writes them."""
    part, alone, rng = model.part(), model.part(empty=False), model.rng
    with tempfile.TemporaryDirectory() as folder:
        if model.dofs is not None and rng.random() < 0.5:
            files: dict[str, Any] = {}
            for key, A in (("M", part.M), ("K", part.K)):
                files[key] = Path(folder) / f"{key}.mtx"
                A = dense(A)
                labels = np.stack([model.dofs.nodes, model.dofs.components + 1], axis=1)
                files[key].write_text("".join(f"{labels[i, 0]},{labels[i, 1]}, {labels[j, 0]},{labels[j, 1]}, {A[i, j]:.17e}\n"
                                              for i in range(len(A)) for j in range(i + 1) if A[i, j] or i == j))
            alone = alone.with_damping(None)
        else:
            fs.write_matrices(folder, part, format=str(rng.choice(["mtx", "npz"])))
            files = {path.stem: path for path in Path(folder).iterdir() if path.stem in "MKD" and path.suffix != ".json"}
            files["dofs"] = model.dofs
        given = {"interface": model.rows[model.ends].tolist(), "ports": {"belt": [int(model.rows[model.at])]}, "name": "part"}
        told = heard(fs.read_component, **files, **given)[2]
        if [str(one).split(". Analyses")[0] for one in told] != [model.words(model.empty)]:
            return f"wrong: the warning is {[str(one) for one in told]}"
        found, error, told = heard(fs.read_component, **files, **given, drop_empty=True)
        if error or told:
            return f"wrong: {error}, {told}"
        for what, row, bad in (("interface", model.empty[0], {"interface": [int(model.empty[0])]}),
                               ("port", model.empty[-1], {"ports": {"p": [int(model.empty[-1])]}})):
            error = heard(fs.read_component, **files, **(given | bad), drop_empty=True)[1]
            if not isinstance(error, fs.InputError) or model.name(int(row)) not in str(error) or what not in str(error):
                return f"wrong: an empty {what}: {error}"
    for name in "MKD":
        A, B = (dense(getattr(one, name)) for one in (found, alone))
        if not np.array_equal(A, B):
            return f"wrong: {name} differs"
    names = [None if one.dofs is None else [one.dofs.name(row) for row in range(one.size)] for one in (found, alone)]
    if names[0] != names[1] or found.interface.tolist() != alone.interface.tolist():
        return "wrong: map or interface differ"
    if not np.array_equal(found.port("belt"), alone.port("belt")):
        return "wrong: the port differs"
    a, b = (fs.normal_modes(one, count=2).frequencies for one in (found, alone))
    return "certified" if np.allclose(a, b, rtol=1e-9) else f"wrong: {a}, {b}"


def dashed(model: Model) -> str:
    """A dashpot alone acts on empty DOF: they have real λ, and a response, but no undamped modes."""
    d = np.zeros((model.size, 1))
    d[[model.empty[0], model.rows[0]], 0] = 1.0, -1.0
    D = dense(model.part().D) + d @ d.T * np.sqrt(model.K[0, 0] * model.M[0, 0])
    ask, left = analyses(model.part(D=D if model.dense else sp.csr_array(D))), model.empty[1:]
    for name in ("normal modes", "complex modes", "responses", "couple"):
        said = refusal(ask[name])
        undamped = name == "normal modes"
        if said != model.words(model.empty if undamped else left) and (said or undamped or len(left)):
            return f"wrong: {name}: {said}"
    return "refused: in the same words"


def joined(model: Model) -> str:
    """An interface DOF without anything of its own is joined to a part that has both; nothing else may be empty."""
    only = model.empty[:1]
    keep = np.setdiff1d(np.arange(model.size), model.empty[1:])
    full = model.part()
    M, K, D = (A[keep][:, keep] for A in (full.M, full.K, full.D))
    at = int(np.searchsorted(keep, only[0]))
    first = int(np.searchsorted(keep, model.rows[0]))
    dofs = None if model.dofs is None else model.dofs.kept(keep)
    part = fs.Substructure(M, K, D, [at, first], dofs=dofs)
    end = fs.chain(3, masses=model.M[0, 0], springs=model.K[0, 0], damping=0.0, interface=[1])
    name = f"DOF {at}" if dofs is None else dofs.name(at)
    whole = fs.couple({"a": part, "b": end}, [fs.Rigid(("a", [at]), ("b", [0]))])
    loose = fs.couple({"a": part, "b": end}, [fs.Rigid(("a", [first]), ("b", [0]))])
    for system, where in ((part, ""), (loose, "a: ")):
        said = refusal(fs.normal_modes, system, count=1)
        if f"1 DOF has neither mass nor stiffness: {where}{name}" not in said:
            return f"wrong: {said}"
    fixed = fs.couple({"a": fs.reduce(part, fs.CraigBampton(model.own - 1)), "b": end}, [fs.Rigid(("a", [at]), ("b", [0]))])
    own = np.concatenate([np.linalg.eigvals(np.linalg.solve(model.M, model.K)).real, fs.normal_modes(end, count=3).eigenvalues])
    for system in (whole, fixed):
        found = fs.normal_modes(system, count=system.size - fs.normal_modes(system, count=1).rigid)
        if not np.allclose(np.sort(found.eigenvalues), np.sort(own), rtol=1e-7, atol=1e-9 * own.max()):
            return f"wrong: ω² {found.eigenvalues} for {np.sort(own)}"
    return "certified"


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    model = Model(rng)
    return {"refused": refused, "dropped": dropped, "with dashpots": dashed, "joined": joined}[kind](model)
