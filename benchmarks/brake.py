"""A large brake: seconds and memory of its reduction, of 100 values of mu, and of the full model at one.

    python -m benchmarks brake [--size METRES ...] [--model parts|full ...] [--mu N] [--out FILE]

parts  Each part is reduced by itself, in a process of its own, to its real modes on a contact with the ground and its
       responses to smooth tractions there. The joined parts are reduced to contact modes. No process holds more than one part.
full   The full brake is solved at mu = 0.5.

--size is the length of elements, --mu the number of values. Each measurement runs in a process of its own, so that the memory
told is its own. Elements of 0.025 m make 7,458 DOF, of 0.0085 50,000, of 0.0034 573,714. Rows of the file with the same size and
model are replaced. Beside a full model, the others of its size are compared with it. Seconds of the processor tell more than
those of the clock where other programs run. The number of threads is that of OMP_NUM_THREADS.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

import femsub as fs
from benchmarks.processes import fresh, machine, peak_mb, put
from femsub.app.scenes.brake import PADS, Brake, BrakeScene
from femsub.model.affine import Affine
from femsub.modes import match
from femsub.studies.losses import affine_over, first_loss
from femsub.studies.tables import table

MU = 0.5  # at which models are compared
OWN = 60  # real modes of each part
MODES = 100  # real modes of the brake
DEGREE = 6  # of the tractions on a patch

Row = dict[str, Any]


@contextmanager
def timed(row: Row, what: str) -> Iterator[None]:
    """Adds the seconds of a block, of the clock and of the processor."""
    start = time.perf_counter(), time.process_time()
    yield
    row[f"{what}_s"] = time.perf_counter() - start[0]
    row[f"{what}_cpu_s"] = time.process_time() - start[1]


def brake(size: float) -> Brake:
    """Its meshes; the parts and the system are made when they are asked for."""
    return Brake(BrakeScene(size=size), lambda _: None)


def contact_nodes(made: Brake) -> int:
    """Of the pads' faces."""
    return sum(len(made.meshes[name].sets["face"]) for name in PADS)


def part(size: float, name: str) -> tuple[fs.ReducedSubstructure, Row]:
    """A part reduced by itself. Of its basis only the rows of the interface are kept, since the others would be much to send."""
    row: Row = {}
    with timed(row, "build"):
        made = brake(size)
        sub = made.part(name)
    with timed(row, "reduce"):
        on = [fs.FrictionContact(key, "ground", made.meshes[name], made.scene.contact, 0.0, axis=np.array([0.0, 0.0, 1.0]))
              for key in sub.sets]
        ports = {f"patch-{contact.first}": contact.patch_loads(sub, DEGREE) for contact in on}
        sets = {key: sub.interface[places] for key, places in sub.sets.items()}
        loaded = fs.Substructure(sub.M, sub.K, sub.D, sets, {**sub.ports, **ports}, name, sub.dofs)
        model = fs.reduce(loaded, fs.ContactModes(OWN, contacts=on, friction=False), ports=True)
    rows = model.V[model.full_interface]
    small = replace(model, V=rows, full_interface=np.arange(len(rows)), full_dofs=model.interface_dofs,
                    ports={key: model.ports[key] for key in sub.ports})
    return small, row | {"dof": sub.size, "size": model.size, "peak_mb": peak_mb()}


def swept(row: Row, made: Brake, small: fs.Substructure, contacts: list[Any], points: int) -> Row:
    """The row of a reduced model, solved at so many values of mu."""
    band, unstable, affine = made.band, 0, affine_over(small, contacts, "mu", made.range)
    with timed(row, "sweep"):
        for mu in np.linspace(made.scene.mu[0], made.scene.mu[1], points):
            unstable = max(unstable, len(fs.complex_modes(affine.at(mu=float(mu)), band=band).unstable))
    critical, omega, _ = first_loss(small, contacts, "mu", made.range, band)
    return row | {"points": points, "critical_mu": critical, "critical_hz": omega / (2 * np.pi), "most_unstable": unstable,
                  **told_at(affine, (band[0], 1.05 * band[1])), "peak_mb": peak_mb()}


def told_at(affine: Affine, band: tuple[float, float]) -> Row:
    """The eigenvalues at MU and their error bars."""
    found = fs.complex_modes(affine.at(mu=MU), band=band)
    above = found.eigenvalues.imag > 0
    return {"eigenvalues": [[value.real, value.imag] for value in found.eigenvalues[above]],
            "error_bars": found.error_bar[above].tolist()}


@dataclass(frozen=True, eq=False)
class Gathered:
    """All contacts of a small system on one port, its coordinates: (at mu = 0, change over mu) of what is added to D and K.

    The parts' interfaces have more DOF than the system has coordinates, so that contact modes cannot keep them as sets.
    """

    damping: tuple[np.ndarray, np.ndarray]
    stiffness: tuple[np.ndarray, np.ndarray]
    mu: float = 0.0

    ports: ClassVar = ("coordinates",)
    affine: ClassVar = ("mu",)

    @classmethod
    def of(cls, system: fs.System, without: fs.Pencil, rubbing: fs.Pencil) -> Gathered:
        return cls((without.D - system.D, rubbing.D - without.D), (without.K - system.K, rubbing.K - without.K))

    def linearised(self, model: fs.Substructure) -> tuple[np.ndarray, np.ndarray]:
        return self.damping[0] + self.mu * self.damping[1], self.stiffness[0] + self.mu * self.stiffness[1]


def joined(size: float, parts: dict[str, fs.ReducedSubstructure], points: int) -> Row:
    """The reduced parts, joined, reduced to contact modes, and solved."""
    row: Row = {}
    made = brake(size)
    with timed(row, "join"):
        system = made.joined(parts)
        rubbing = Gathered.of(system, *(system.linearised(made.contacts(mu)) for mu in (0.0, 1.0)))
        bare = fs.Substructure(system.M, system.K, system.D, ports={Gathered.ports[0]: np.eye(system.size)})
        small = fs.reduce(bare, fs.ContactModes(MODES, contacts=rubbing))
    return swept(row | {"size": small.size, "contact_nodes": contact_nodes(made)}, made, small, [rubbing], points)


def by_parts(size: float, points: int) -> Row:
    """The row of the model whose parts are reduced one by one."""
    found = {name: fresh(part, size, name) for name in ("disc", *PADS)}
    last = fresh(joined, size, {name: model for name, (model, _) in found.items()}, points)
    rows = {name: row for name, (_, row) in found.items()}
    total = {f"{what}_{unit}": sum(row[f"{what}_{unit}"] for row in rows.values()) for what in ("build", "reduce")
             for unit in ("s", "cpu_s")}
    return last | total | {"dof": sum(row["dof"] for row in rows.values()), "parts": rows, "join_peak_mb": last["peak_mb"],
                           "peak_mb": max(row["peak_mb"] for row in (*rows.values(), last))}


def full(size: float, _: int) -> Row:
    """The row of the full model at MU."""
    row: Row = {}
    with timed(row, "build"):
        made = brake(size)
        affine = affine_over(made.system, made.contacts(0.0), "mu", made.range)
    with timed(row, "solve"):
        found = told_at(affine, made.band)
    return row | {"dof": made.system.size, "contact_nodes": contact_nodes(made), **found, "peak_mb": peak_mb()}


def compared(row: Row, exact: Row) -> Row:
    """The largest error of λ relative to |λ|, that of unstable λ, and unstable modes of the full model that are missed."""
    ours, theirs = (np.array(one["eigenvalues"]) @ [1.0, 1j] for one in (exact, row))
    at, to = match(ours, theirs)
    error = np.abs(theirs[to] - ours[at]) / np.abs(ours[at])
    unstable = ours.real > np.array(exact["error_bars"])
    grows = unstable[at]
    return {"error": float(error.max()), "unstable_error": float(error[grows].max(initial=0.0)), "unstable": int(unstable.sum()),
            "missed": int((grows & (theirs[to].real <= 0)).sum() + unstable.sum() - grows.sum())}


def told(rows: list[Row]) -> str:
    """A table of all rows: nodes of the contact, seconds of the processor, errors of λ against the full model."""
    exact = {row["element"]: row for row in rows if row["model"] == "full"}
    cells = []
    for row in rows:
        beside = compared(row, exact[row["element"]]) if row["model"] != "full" and row["element"] in exact else {}
        cells.append([row["model"], row["element"], row["dof"], row["contact_nodes"], row.get("size"), row["build_cpu_s"],
                      row.get("reduce_cpu_s", 0.0) + row.get("join_cpu_s", 0.0) or None, row.get("sweep_cpu_s"),
                      row.get("solve_cpu_s"), row["peak_mb"] / 1e3, row.get("critical_mu"), beside.get("error"),
                      beside.get("unstable_error"), f"{beside['missed']} of {beside['unstable']}" if beside else None])
    return table(["model", "element", "DOF", "nodes", "small", "build", "reduce", "sweep", "full", "GB", "critical mu", "error λ",
                  "unstable", "missed"], cells,
                 ["s", "g", ",d", ",d", "d", ".0f", ".0f", ".0f", ".0f", ".1f", ".5f", ".1e", ".1e", "s"])


def main(*, size: tuple[float, ...] = (0.0085,), model: Annotated[tuple[str, ...], ("parts", "full")] = ("parts",), mu: int = 100,
         out: Path = Path("out/brake.json")) -> None:
    measures: dict[str, Callable[[float, int], Row]] = {"parts": by_parts, "full": partial(fresh, full)}
    host = fresh(machine)
    for element in size:
        for name in model:
            row = {"model": name, "element": element} | measures[name](element, mu)
            rows = json.loads(out.read_text(encoding="utf-8"))["rows"] if out.exists() else []
            rows = [one for one in rows if (one["model"], one["element"]) != (name, element)] + [row]
            rows.sort(key=lambda one: (-one["element"], one["model"]))
            text = json.dumps({"machine": host, "mu": MU, "rows": rows}, indent=1) + "\n"
            put(out.parent, {out.name: text})
            print(told([one for one in rows if one["element"] == element]), flush=True)
