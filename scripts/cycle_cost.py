#!/usr/bin/env python3
"""Seconds of harmonic balance for the chain of 10 masses and for reduced models of the plate and the disc, of 109 DOF and more.

    python scripts/cycle_cost.py [--modes N] [--repeats N] [--harmonics N] [--out FILE]

Each model's cycle is that of the mode which grows most, from no other start. `cold` takes in the decomposition of the model,
which is kept for all later cycles of it; `warm` is a second cycle of the same model. `step` is the time of one Newton step of
the warm one with --harmonics harmonics, the same number for all models, from the cycle itself. Medians; order alternates.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
import warnings

import femsub as fs
from femsub.algebra.factor import release
from femsub.app.report import machine, to_json, versions
from femsub.app.scene import load
from femsub.io.atomic import write_whole
from femsub.motion.cycles import compliance
from femsub.motion.cycles.balance import Balance
from femsub.motion.nonlinear_model import sliding
from femsub.studies.tables import table


def models(modes: int) -> dict[str, tuple[fs.Substructure, fs.Belt]]:
    """The chain, and HCB and CC of plate and disc, under belts that make them unstable."""
    law = fs.StribeckArctan(eps=1e-3)
    found = {"chain": (fs.chain(10, belt=2), fs.Belt(speed=0.19113, law=law))}
    for name, scale in (("plate", 2.0), ("solid", 1.0)):
        scene, _ = load(name)
        sub, _ = scene.component()
        for short, method in (("HCB", fs.CraigBampton(modes)), ("CC", fs.CraigChang(modes))):
            belt = fs.Belt(force=scale * scene.force, speed=0.19113, law=law)
            found[f"{name} {short}"] = (fs.reduce(sub, method, ports=True), belt)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modes", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--harmonics", type=int, default=200)
    parser.add_argument("--out")
    options = parser.parse_args()
    warnings.simplefilter("ignore", fs.FemsubWarning)
    chosen = models(options.modes)
    times: dict[str, dict[str, list[float]]] = {name: {"cold": [], "warm": [], "step": []} for name in chosen}
    cycles: dict[str, fs.LimitCycle] = {}
    for turn in range(options.repeats):
        for name in list(chosen)[:: 1 if turn % 2 else -1]:
            model, belt = chosen[name]
            compliance._KNOWN.clear()
            release(model)
            for kind in ("cold", "warm"):
                begun = time.perf_counter()
                cycles[name] = fs.harmonic_balance(model, belt)
                times[name][kind].append(time.perf_counter() - begun)
            balance = Balance(sliding(model, belt), cycles[name].flexibility)
            orbit = cycles[name].orbit.with_harmonics(options.harmonics)
            begun = time.perf_counter()
            steps = balance.solve(orbit)[2]
            times[name]["step"].append((time.perf_counter() - begun) / steps)
    rows = []
    for name, (model, _) in chosen.items():
        middle = {kind: statistics.median(values) for kind, values in times[name].items()}
        first = {kind: statistics.median(values) for kind, values in times["chain"].items()}
        cycle = cycles[name]
        rows.append({"model": name, "size": model.size, "unknowns": cycle.orbit.vector.size, "newton": cycle.newton,
                     "omega": cycle.omega, **middle, **{f"{kind}_ratio": middle[kind] / first[kind] for kind in middle}})
    print(table(["model", "DOF", "unknowns", "Newton", "ω", "cold s", "warm s", "step s", "cold/chain", "warm/chain",
                 "step/chain"],
                [list(row.values()) for row in rows],
                ["s", "d", "d", "d", ".6g", ".3f", ".3f", ".5f", ".2f", ".2f", ".2f"]))
    if options.out:
        from pathlib import Path

        path = Path(options.out)
        text = to_json({"machine": machine() | versions(), "harmonics_of_step": options.harmonics, "rows": rows})
        assert json.loads(text)
        write_whole(path.parent, {path.name: lambda file: file.write(text.encode())})


if __name__ == "__main__":
    main()
