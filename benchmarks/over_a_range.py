"""A brake over its speed: errors of other bases against certified solutions, and milliseconds for each speed.

    python -m benchmarks over-a-range FOLDER [--values FILE] [--out DIR]

FOLDER has the matrices of the public brake M0 (github.com/nae9on/BrakeSqueal0.1, data/5koref1), which are no part of femsub. FILE
keeps the certified eigenvalues at 50 speeds. It is made if it is not there, in some seven minutes.

The bases are those of Gräbner, Mehrmann, Quraishi, Schröder and von Wagner, ZAMM 96 (2016) 1388: the proper orthogonal
decomposition of real and imaginary parts of eigenvectors at three or five speeds, of the λ near the axis or of all in the band;
and real modes without friction, damping and gyroscopic forces. LAPACK solves their small models. Seconds
are those of the processor, with one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.io import loadmat

import femsub as fs
from benchmarks.attacks.boxes import spectrum
from benchmarks.pictures import save
from benchmarks.processes import begin
from femsub.checks import Array
from femsub.model import in_band
from femsub.output import Chart, Panel, Series, draw, table

SPEEDS = np.linspace(2 * np.pi, 8 * np.pi, 50)
BAND = (0.0, 2e4)
NEAR = -50.0  # Re λ of the eight λ near the axis
COLUMNS = {"model": "", "DOF": ",d", "seconds": ".1f", "ms per Ω": ".0f", "break-even": ".1f", "error near the axis": ".0e",
           "error in the band": ".0e", "λ in the band": "", "Ω with the growing λ": "d"}


def matrices(folder: Path) -> list[Any]:
    """M, D₁, D_G, D_R, D₄, K₁, K_R and K_geo of the public brake M0, each (4669, 4669)."""
    return [sp.csr_array(next(value for name, value in loadmat(folder / f"{file}.mat").items() if not name.startswith("_")))
            for file in ("BMLL", "BDLL", "BYLL", "BDIWLL", "BHLL", "BKLL", "BKQLL", "BWLL")]


def brake(folder: Path) -> fs.Affine:
    """D = D₁ + D_R/Ω + Ω D_G + D₄/1600 and K = K₁ + K_R + Ω² K_geo of 4,669 DOF."""
    M, D1, DG, DR, D4, K1, KR, KG = matrices(folder)
    return fs.Affine(M, [(1.0, D1), (lambda speed: 1 / speed, DR), ("speed", DG), (1 / 1600, D4)],
                     [(1.0, K1), (1.0, KR), (lambda speed: speed**2, KG)])


def certified(family: fs.Affine, file: Path) -> tuple[Array, float]:
    """λ in the band at each of SPEEDS (50, k), and the median seconds of a speed, kept in a file."""
    if not file.exists():
        values, seconds = list[Array](), list[float]()
        for speed in SPEEDS:
            start = time.process_time()
            found = fs.complex_modes(family.at(speed=speed), band=BAND)
            seconds.append(time.process_time() - start)
            values.append(found.eigenvalues)
            assert found.evidence == "certified"
        np.savez(file, values=np.array(values), seconds=seconds)
    with np.load(file) as kept:
        return np.asarray(kept["values"]), float(np.median(kept["seconds"]))


def bases(family: fs.Affine) -> Iterator[tuple[str, float, Array]]:
    """Name, seconds and V (n, r), by speeds, the λ whose eigenvectors are taken, and r: 40 and 75 are the paper's."""
    for speeds, paper, more in ((3, 40, 100), (5, 75, 150)):
        start = time.process_time()
        modes = [fs.complex_modes(family.at(speed=speed), band=BAND) for speed in np.linspace(SPEEDS[0], SPEEDS[-1], speeds)]
        for which, least, columns in (("near the axis", NEAR, paper), *(("in the band", -np.inf, one) for one in (paper, more))):
            X = np.hstack([one.shapes[:, one.eigenvalues.real > least] for one in modes])
            V = np.linalg.svd(np.hstack([X.real, X.imag]), full_matrices=False)[0]
            yield f"{columns} shapes of {speeds} speeds, λ {which}", time.process_time() - start, V[:, :columns]
    start, real = time.process_time(), fs.Substructure(family.M[0][1], family.K[0][1])
    V = np.linalg.qr(fs.normal_modes(real, count=75).shapes)[0]
    yield "75 real modes", time.process_time() - start, V


def over(solve: Callable[[float], Array], exact: Array) -> tuple[dict[str, Any], Array]:
    """What the table has of a small model that gives λ at a speed, and the relative error of each λ at each speed."""
    start = time.process_time()
    found = [solve(float(speed)) for speed in SPEEDS]
    each = 1e3 * (time.process_time() - start) / len(SPEEDS)
    error = np.array([(np.abs(values - there[:, None]) / np.abs(there)[:, None]).min(axis=1)
                      for values, there in zip(found, exact, strict=True)])
    inside = [values[in_band(values, BAND, (-BAND[1], BAND[1]))] for values in found]
    number = sorted({len(values) for values in inside})
    return {"ms per Ω": each, "error near the axis": error[exact.real > NEAR].max(), "error in the band": error.max(),
            "λ in the band": " to ".join(str(one) for one in dict.fromkeys((number[0], number[-1]))),
            "Ω with the growing λ": sum(bool((values.real > 0).any()) for values in inside)}, error


def figure(errors: dict[str, Array], exact: Array) -> Any:
    """The largest error of a λ at each speed: left of those near the axis, right of all in the band."""
    panels = []
    for which, where in ((exact.real > NEAR, f"with Re λ > {NEAR:g} rad/s"), (np.isfinite(exact), "in the band")):
        series = [Series(name, SPEEDS, np.where(which, error, 0.0).max(axis=1), line=("solid", "dash", "dot")[at % 3], marker="",
                         colour="black" if at == len(errors) - 1 else f"C{at // 3}")
                  for at, (name, error) in enumerate(errors.items())]
        panels.append(Panel(series, "speed Ω  [rad/s]", "largest relative error of a λ  [-]", f"{which[0].sum()} λ {where}", "y",
                            share={"y": "error"}))
    return draw(Chart("over-a-range", "Error of small models of a brake over its speed", panels, 2, height=3.2, columns=3))


def main(folder: Path, *, values: Path = Path("out/over-a-range.npz"), out: Path = Path("out/over-a-range")) -> int:
    begin(out)
    out.mkdir(parents=True, exist_ok=True)
    family = brake(folder)
    exact, seconds = certified(family, values)
    rows: list[dict[str, Any]] = [{"model": "full, certified", "DOF": family.size, "ms per Ω": 1e3 * seconds}]
    errors = dict[str, Array]()
    for name, made, V in bases(family):
        small = family.reduced(V, cutoff=np.inf)
        row, errors[name] = over(lambda speed, small=small: spectrum(small, {"speed": speed}), exact)  # type: ignore[misc]
        rows.append({"model": name, "DOF": small.size, "seconds": made, **row})
    start = time.process_time()
    ours = fs.reduce(family, fs.ParameterBox({"speed": (SPEEDS[0], SPEEDS[-1])}, band=BAND))
    made = time.process_time() - start
    row, errors["over the box, proved"] = over(lambda speed: ours.modes(speed=speed).eigenvalues, exact)
    rows.append({"model": f"over the box, {ours.evidence}", "DOF": ours.size, "seconds": made, **row})
    for row in rows[1:]:  # so many full solutions take as long as this model and as many of its values
        row["break-even"] = row["seconds"] / (seconds - row["ms per Ω"] / 1e3)
    print(table(list(COLUMNS), [[row.get(key) for key in COLUMNS] for row in rows], list(COLUMNS.values())))
    save(out / "over-a-range.png", lambda: figure(errors, exact))
    return 0
