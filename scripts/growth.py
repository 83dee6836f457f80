#!/usr/bin/env python3
"""How each analysis grows with the DOF, the interface, the parts and the contacts: CPU seconds, and the exponent p of n^p.

    python scripts/growth.py [--over dof interface parts contacts] [--quick] [--out DIR]

Each row is one analysis over one number n, all else equal. `p` is the slope over the last three sizes beyond 0.05 s.
Models: plates, a plate in strips, and for contacts a plate of which each rubs at one node. One thread of BLAS. The seconds are
those of the processor, so that other programs disturb little.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.joined import strips
from femsub.algebra.factor import release
from femsub.algebra.processes.threads import one_thread
from femsub.studies.tables import table

SIZES = {"dof": (1_000, 4_000, 16_000, 64_000), "interface": (25, 50, 100, 200, 400), "parts": (2, 6, 20, 60, 200),
         "contacts": (1, 5, 20, 100, 500)}
QUICK = {"dof": (500, 1_000), "interface": (10, 20), "parts": (2, 4), "contacts": (1, 3)}
BAND, SLOPES = (0.0, 300.0), (-0.1, 0.0)
LEAST = 0.05  # seconds from which a slope says something


@cache
def plate(dof: int, interface: int = 8) -> fs.Substructure:
    """A square plate held at its left edge; its interface are nodes of the right half, a belt rubs in the middle."""
    cells = 2 * max(2, round((dof / 16) ** 0.5))
    mesh = fs.rectangle((1.0, 1.0), (cells, cells))
    inside = np.flatnonzero(mesh.points[:, 0] > 0.5)
    chosen = inside[np.linspace(0, len(inside) - 1, min(max(interface // 4, 1), len(inside))).astype(int)]
    return fs.plate(mesh.with_sets(joint=np.unique(chosen)), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, rayleigh=(1.0, 1e-6),
                    supports={"left": "clamped"}, interface=["joint"], ports={"belt": (0.5, 0.5)})


@cache
def parts(count: int) -> fs.System:
    """So many strips of a plate."""
    whole = strips(count, 4).system()
    assert isinstance(whole, fs.System)
    return whole


@cache
def rubbing(count: int) -> tuple[fs.Substructure, list[Any]]:
    """A plate of 2,500 DOF with so many contacts, each a falling friction characteristic at one node."""
    sub = plate(2_500)
    assert sub.dofs is not None
    lift = np.flatnonzero(sub.dofs.components == 0)
    at = lift[np.linspace(len(lift) // 3, len(lift) - 1, count).astype(int)]
    ports = {f"c{number}": np.eye(1, sub.size, row).ravel() for number, row in enumerate(at)}
    return (fs.Substructure(sub.M, sub.K, sub.D, sub.interface, ports, "plate"),
            [fs.Belt(port=name, slope=-0.01) for name in ports])


def reducing(make: Callable[[int], Any], method: Callable[[], Any]) -> Callable[[int], Callable[[], Any]]:
    def prepared(n: int) -> Callable[[], Any]:
        sub = make(n)
        release(sub)
        return lambda: fs.reduce(sub, method())
    return prepared


def of_parts(method: Callable[[], Any]) -> Callable[[int], Callable[[], Any]]:
    return lambda n: lambda: fs.reduce(parts(n), dict.fromkeys(parts(n).parts, method()))


def analysed(call: Callable[[fs.Substructure, list[Any]], Any]) -> Callable[[int], Callable[[], Any]]:
    """An analysis of the plate with contacts, reduced to 20 modes."""
    def prepared(n: int) -> Callable[[], Any]:
        sub, contacts = rubbing(n)
        rom = fs.reduce(sub, fs.CraigBampton(20), ports=n <= 100)
        return lambda: call(rom, contacts)
    return prepared


def on_full(call: Callable[[fs.Substructure], Any], make: Callable[[int], fs.Substructure]) -> Callable[[int], Callable[[], Any]]:
    def prepared(n: int) -> Callable[[], Any]:
        sub = make(n)
        release(sub)
        return lambda: call(sub)
    return prepared


def full_contacts(n: int) -> Callable[[], Any]:
    sub, contacts = rubbing(n)
    release(sub)
    return lambda: fs.complex_modes(sub, contacts, band=BAND)


ANALYSES: dict[str, dict[str, Callable[[int], Callable[[], Any]]]] = {
    "dof": {"normal_modes": on_full(lambda sub: fs.normal_modes(sub, 20), plate),
            "complex_modes": on_full(lambda sub: fs.complex_modes(sub, fs.Belt(slope=-0.01), band=BAND), plate),
            "critical_slope": on_full(lambda sub: fs.critical_slope(sub, band=BAND), plate),
            **{kind.__name__: reducing(plate, lambda kind=kind: kind(20)) for kind in (  # type: ignore[misc]
                fs.CraigBampton, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.Herting, fs.DualCraigBampton)}},
    "interface": {kind.__name__: reducing(lambda n: plate(6_000, n), lambda kind=kind: kind(20)) for kind in (  # type: ignore[misc]
        fs.CraigBampton, fs.Hurty, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.Herting, fs.DualCraigBampton)},
    "parts": {"couple, full": lambda n: lambda: fs.couple(parts(n).parts, parts(n).joints),
              "Craig-Bampton, 5 modes": of_parts(lambda: fs.CraigBampton(5)),
              "Craig-Chang, 5 modes": of_parts(lambda: fs.CraigChang(5)),
              "Dual Craig-Bampton, 5 modes": of_parts(lambda: fs.DualCraigBampton(5)),
              "Craig-Bampton, tolerance": of_parts(lambda: fs.CraigBampton(band=(0.0, 50.0), tol=1e-3)),
              "frequency_bounds": lambda n: (lambda small: lambda: fs.frequency_bounds(small, 10))(
                  fs.reduce(parts(n), dict.fromkeys(parts(n).parts, fs.CraigBampton(5))))},
    "contacts": {"complex_modes, full": full_contacts,
                 "complex_modes": analysed(lambda rom, contacts: fs.complex_modes(rom, contacts)),
                 "critical_value": analysed(lambda rom, contacts: fs.critical_value(rom, contacts, "slope", between=SLOPES,
                                                                                    band=BAND)),
                 "sweep, 20 values": analysed(lambda rom, contacts: fs.sweep(rom, contacts, "slope", np.linspace(*SLOPES, 20),
                                                                             band=BAND)),
                 "transient, 0.05 s": analysed(lambda rom, contacts: fs.transient(rom, moving(contacts), time=(0.0, 0.05)))}}


def moving(contacts: list[Any]) -> list[Any]:
    """The same belts with the paper's law, for motion."""
    return [fs.Belt(port=one.port, force=1.0, speed=0.1911, law=fs.StribeckArctan(eps=1e-2)) for one in contacts]


def measured(prepare: Callable[[int], Callable[[], Any]], sizes: tuple[int, ...], most: float) -> list[float | None]:
    """CPU seconds at each size, or None once one has taken more than `most`, or was refused."""
    found: list[float | None] = []
    for n in sizes:
        if found and (found[-1] is None or found[-1] > most):
            found.append(None)
            continue
        try:
            call = prepare(n)
            start = time.process_time()
            call()
            found.append(time.process_time() - start)
        except (fs.FemsubError, MemoryError) as error:
            print(f"n = {n}: {type(error).__name__}: {error}"[:300])
            found.append(None)
    return found


def exponent(sizes: tuple[int, ...], seconds: list[float | None]) -> float | None:
    """p of n^p over the last three sizes that say something."""
    known = [(n, value) for n, value in zip(sizes, seconds, strict=True) if value is not None and value > LEAST][-3:]
    return float(np.polyfit(*np.log(np.array(known).T), 1)[0]) if len(known) > 1 else None


def main() -> int:
    import warnings

    warnings.simplefilter("ignore", fs.FemsubWarning)  # ports on the inside, cut-offs: not what this is about
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--over", nargs="+", choices=list(ANALYSES), default=list(ANALYSES))
    parser.add_argument("--quick", action="store_true", help="tiny sizes: shows that all works")
    parser.add_argument("--most", type=float, default=60.0, help="seconds beyond which no larger size is tried")
    parser.add_argument("--out", type=Path, default=Path("growth"))
    given = parser.parse_args()
    told = {}
    for over in given.over:
        sizes = (QUICK if given.quick else SIZES)[over]
        rows = {}
        with one_thread(True):
            for name, prepare in ANALYSES[over].items():
                rows[name] = measured(prepare, sizes, given.most)
        slopes = {name: exponent(sizes, row) for name, row in rows.items()}
        told[over] = {"sizes": sizes, "seconds": rows, "exponents": slopes}
        print(table([over, *(f"{n:,}" for n in sizes), "p"], [[name, *row, slopes[name]] for name, row in rows.items()],
                    ["", *[".3g"] * len(sizes), ".2f"]), flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "growth.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
