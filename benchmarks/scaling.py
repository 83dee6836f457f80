"""Seconds, memory and error over size: chain, beam, plate and solid from 10 to 10⁶ DOF.

    python -m benchmarks scaling [--components chain beam plate solid] [--steps STEP ...] [--largest N] [--repeats N]
                                 [--long SECONDS] [--out DIR]

Measured are the assembly (from the mesh on), HCB and CC, and the CEA of the full model by PEP (of a solid above 300,000 DOF
only where --steps asks for it) and of both reduced ones. Chain, beam and plate keep 20 modes and give the 20 eigenvalues
nearest to 0; the floating solid keeps 50 and gives 32, of which 12 belong to its rigid-body modes. What the components are
is in benchmarks/models.py. Beams end at 20,000 DOF: the condition of their K grows with n⁴, and at 10,000 rounding takes 1.5 % of
their lowest frequencies, full and reduced, at 20,000 that of HCB altogether (`fs.beam` warns from 6,300 on).

Each measurement has a process of its own, so that the peak of its resident memory is its own; packages are loaded, and a
tiny problem solved, before the clock starts. Medians over the repeats; what takes longer than --long is measured once. Written
are scaling.csv, scaling.json and scaling.png. The threads of BLAS are those of OMP_NUM_THREADS.

error     The largest relative one of the lowest frequencies. Chain: all 20 against the closed form, of HCB those with
          fixed interface. Beam and plate: 5 of the reduced or full model against the continuum, so that errors of the mesh,
          the reduction and the solver add up. Solid: 10 elastic ones against `normal_modes` of the full model, below
          100,000 DOF.
residual  The largest of the kept modes, ‖Kφ - ω²Mφ‖ / ‖(|K| + ω²|M|)|φ|‖, or the largest backward error of a CEA.
"""

from __future__ import annotations

import statistics
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Annotated, Any

import numpy as np

import femsub as fs
from benchmarks import UsageError, models
from benchmarks.pictures import save
from benchmarks.processes import Row, begin, fresh, machine, peak_mb, warm_up
from femsub.app import report
from femsub.app.figure_style import PAGE, legend_below, new_figure
from femsub.app.scene import Result
from femsub.studies import look
from femsub.studies.tables import Table, table

STEPS = ("assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC")
METHODS: dict[str, Any] = {"HCB": fs.CraigBampton, "CC": fs.CraigChang}
LARGE = 10_000  # below it fixed costs rule: exponents begin here
COLUMNS = {"component": "", "dof": ",d", "step": "", "seconds": ".3g", "least": ".3g", "most": ".3g", "runs": "d",
           "peak_mb": ".0f", "base_mb": ".0f", "error": ".1e", "residual": ".1e", "stable": ""}


def measure(kind: str, step: str, n: int, exact: np.ndarray | None, reduced: tuple[np.ndarray, ...] | None) -> Row:
    """One step at one size, in a fresh process; `reduced` is (M, K, D, w) of the model a CEA is asked of.

    Returns
    -------
    dict
        seconds; peak_mb, and base_mb before the model is built; dof; error and residual, see the top; for a reduction
        also its matrices, for the CEA of a chain its verdict.
    """
    def seen(model: fs.Substructure, since: float) -> Row:
        return {"seconds": time.perf_counter() - since, "peak_mb": peak_mb(), "dof": model.size}

    warm_up()
    of = models.KINDS[kind]
    fs.reduce(models.build(kind, of.sizes[0]), fs.CraigBampton(modes=3), ports=True)
    row: Row = {"base_mb": peak_mb()}
    start = time.perf_counter()
    model = models.build(kind, n) if reduced is None else fs.Substructure(
        reduced[0], reduced[1], reduced[2], ports={"belt": reduced[3]})
    if step == "assembly":
        return row | seen(model, start)
    if step in METHODS:
        method = METHODS[step](modes=min(of.modes, model.size - len(model.interface)))
        start = time.perf_counter()
        rom = fs.reduce(model, method, ports=kind != "chain")
        row |= seen(model, start) | modes_kept(kind, step, model, rom, exact)
        return row | {"reduced": (rom.M, rom.K, rom.D, rom.port("belt"))}
    start = time.perf_counter()
    modes = fs.complex_modes(model, fs.Belt(slope=models.slope(kind, n)), count=min(20 + 2 * of.rigid, 2 * model.size))
    row |= seen(model, start) | {"residual": float(modes.backward_error.max())}
    found = np.sort(modes.eigenvalues.imag[modes.eigenvalues.imag > 0])
    if kind == "chain":
        row["stable"] = {True: "yes", False: "NO", None: "undecided"}[modes.is_stable]  # within the error bars
        exact = fs.chain_frequencies(n, len(found)) if n >= LARGE else None  # there the dashpot moves them by 5e-12 at most
    elif exact is not None:
        found = found[found > exact[0] / 2][:of.compared]  # without rigid-body modes
    return row if exact is None else row | {"error": float(np.abs(found / exact[:len(found)] - 1).max(initial=0.0))}


def modes_kept(kind: str, step: str, model: fs.Substructure, rom: fs.ReducedSubstructure, exact: np.ndarray | None) -> Row:
    """Error of the reduced model's frequencies, and the largest residual of the modes it keeps."""
    import scipy.linalg

    from femsub.modes.normal_modes import relative_residual

    at = np.array([i for i, name in enumerate(rom.kinds) if name in ("fixed-interface", "free")])
    rows = model.interior if step == "HCB" else np.arange(model.size)
    residual = relative_residual(model.K[rows][:, rows], model.M[rows][:, rows], rom.K[at, at], rom.V[np.ix_(rows, at)])
    squares, rigid = rom.K[at, at], 0
    if kind == "chain":  # with m1 held, n - 1 masses vibrate
        exact = fs.chain_frequencies(model.size - 1 if step == "HCB" else model.size, len(at))
    elif exact is not None:
        exact, rigid = exact[:model.size // 2], models.KINDS[kind].rigid
        squares = scipy.linalg.eigh(rom.K, rom.M, eigvals_only=True)[rigid:rigid + len(exact)]
    row = {"residual": float(residual.max())}
    return row if exact is None else row | {"error": float(np.abs(np.sqrt(np.maximum(squares, 0)) / exact - 1).max())}


def run(kind: str, n: int, steps: list[str], repeats: int, long: float, failed: list[str]) -> list[Row]:
    """A row for each step: medians over the runs, the spread of its seconds, its largest errors."""
    exact = fresh(models.lowest, kind, n)
    reduced: dict[str, tuple[np.ndarray, ...]] = {}
    rows = []
    for step in steps:
        model, runs = reduced.get(step.removeprefix("CEA ")), list[Row]()
        if step in ("CEA HCB", "CEA CC") and model is None:
            continue  # its reduction has failed, or was not asked for
        while len(runs) < (1 if runs and runs[0]["seconds"] > long else repeats):
            report.progress(f"{kind}, n = {n:,}, {step}, run {len(runs) + 1}")
            try:
                runs.append(fresh(measure, kind, step, n, exact, model))
            except (fs.FemsubError, MemoryError, BrokenProcessPool, ArithmeticError, np.linalg.LinAlgError) as error:
                failed.append(f"{kind}, n = {n:,}, {step}: {type(error).__name__}: {error}")
                break
            if "reduced" in runs[-1]:
                reduced[step] = runs[-1].pop("reduced")
        if runs:
            seconds = [one["seconds"] for one in runs]
            rows.append({"component": kind, "n": n, "dof": n, "step": step, "least": min(seconds), "most": max(seconds),
                         "runs": len(runs), "stable": runs[-1].get("stable")}
                        | {key: statistics.median(one[key] for one in runs) for key in ("seconds", "peak_mb", "base_mb")}
                        | {key: max((one[key] for one in runs if key in one), default=None) for key in ("error", "residual")})
            if not step.startswith("CEA"):
                rows[0]["dof"] = runs[0]["dof"]
    return [row | {"dof": rows[0]["dof"]} for row in rows]


def exponents(rows: list[Row]) -> dict[str, float]:
    """p of seconds ~ nᵖ from LARGE on, by least squares in logarithms, of 'component, step'."""
    found = {}
    for kind, step in dict.fromkeys((row["component"], row["step"]) for row in rows):
        points = [(row["dof"], row["seconds"]) for row in rows if (row["component"], row["step"]) == (kind, step)
                  and row["n"] >= LARGE]
        if len(points) > 1:
            n, seconds = np.log(np.array(points)).T
            found[f"{kind}, {step}"] = float(np.polyfit(n, seconds, 1)[0])
    return found


def draw(rows: list[Row]) -> Any:
    """Seconds (least to most as bars) above, peak memory below, one column for each component, all axes logarithmic."""
    hcb, cc = (look(key) for key in ("craig-bampton", "craig-chang"))
    looks = {"assembly": ("0.55", "v", "-", "assembly"), "HCB": (hcb.colour, hcb.marker, "-", f"reduce: {hcb.label}"),
             "CC": (cc.colour, cc.marker, "-", f"reduce: {cc.label}"), "CEA full": ("black", "o", "-", "solve: full model"),
             "CEA HCB": (hcb.colour, "x", ":", f"solve: {hcb.label}"), "CEA CC": (cc.colour, "+", ":", f"solve: {cc.label}")}
    kinds = list(dict.fromkeys(row["component"] for row in rows))
    figure = new_figure(PAGE if len(kinds) > 1 else 0.7 * PAGE, 7.0)
    panels = figure.subplots(2, len(kinds), sharex=True, sharey="row", squeeze=False)
    for (times, memory), kind in zip(panels.T, kinds, strict=True):
        for step, (colour, marker, line, label) in looks.items():
            mine = [row for row in rows if (row["component"], row["step"]) == (kind, step)]
            if mine:
                dof, least, middle, most, peak = np.array([[row[key] for key in ("dof", "least", "seconds", "most", "peak_mb")]
                                                           for row in mine]).T
                style = {"color": colour, "marker": marker, "markersize": 5, "lw": 1.3, "linestyle": line}
                times.errorbar(dof, middle, [middle - least, most - middle], capsize=2, **style)[0].set_label(label)
                memory.plot(dof, peak, label=label, **style)
        times.set(xscale="log", yscale="log", title=kind)
        memory.set(yscale="log", xlabel="DOF n  [-]")
        for panel in (times, memory):
            panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel("run time, median; bars: least to most  [s]")
    panels[1, 0].set_ylabel("peak resident memory  [MB]")
    legend_below(figure, panels[0, :1], 3)
    return figure


def main(*, components: Annotated[tuple[str, ...], models.KINDS] = tuple(models.KINDS), largest: int = 0, repeats: int = 1,
         steps: Annotated[tuple[str, ...], STEPS] = (), long: float = 60.0, out: Path = Path("out/scaling")) -> int:
    if repeats < 1 or 0 < largest < 10:
        raise UsageError("--largest must be at least 10, --repeats at least 1")
    begin(out)
    rows: list[Row] = []
    failed: list[str] = []
    for kind in components:
        of = models.KINDS[kind]
        top = of.sizes[-1] if not largest else max(of.sizes[0], min(largest, of.most))
        for n in [*(n for n in of.sizes if n < top), int(top)]:
            some = [step for step in STEPS if (step in steps or f"CEA {step}" in steps if steps
                                               else step != "CEA full" or n <= of.pep)]
            rows += run(kind, n, some, repeats, long, failed)
    report.progress_done()
    powers = exponents(rows)
    text = table([key.replace("_", " ") for key in COLUMNS], [[row[key] for key in COLUMNS] for row in rows],
                 list(COLUMNS.values()), keys=3, none="not measured, or not known")
    data = {"machine": fresh(machine), "rows": rows, "exponents": powers, "failed": failed}
    result = Result(data, [text, Table("scaling", rows)])
    print(result.text(), *(f"{name}: seconds ~ n^{power:.2f} from n = {LARGE:,} on" for name, power in powers.items()),
          *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, out, figures=False, name="scaling")
    if rows:
        save(out / "scaling.png", lambda: draw(rows))
    return 1 if failed else 0
