"""The stability of a model whose parameters scatter: its chart, and its tables of samples and of families of modes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.output import Chart, Level, Panel, Series, Table

if TYPE_CHECKING:
    from femsub.stability.scatter import Scatter

NOTES = ("Each mode that grows at a sample.", "The probability that a family of modes grows, with its interval.",
         "The probability of instability where one input is among its lowest or highest tenth.")
SYMBOLS = "os^Dv<>Ph*"


def scatter_chart(name: str, found: Scatter, title: str, labels: Mapping[str, str] | None = None, most: int = 2000) -> Chart:
    """The cloud of frequency over growth, the probability of each family of modes, and a tornado of the inputs.

    `labels` are the displayed names of the inputs, with units. At most `most` samples of each family are drawn.
    """
    cloud, bars = list[Series](), list[Series]()
    for k, one in enumerate(found.families):
        colour, marker, word = f"C{k % 10}", SYMBOLS[k % len(SYMBOLS)], f"{np.median(one.omega):.5g} rad/time"
        grows = np.flatnonzero(one.growth > 0)[:most]
        cloud.append(Series(word, one.growth[grows], one.omega[grows], marker=marker, colour=colour, size=2.5, hover={
            name: found.samples[one.at[grows], i] for i, name in enumerate(found.parameters)}))
        middle = float(np.median(one.omega))
        bars += [Series(word, [middle, middle], one.interval, line="solid", marker="_", colour=colour, size=9.0, legend=False),
                 Series(word, [middle], [one.probability], marker=marker, colour=colour, legend=False)]
    ends = found.tornado()
    order = np.argsort(-np.nan_to_num(np.abs(np.diff(ends, axis=1)[:, 0])), kind="stable")
    ranks, shown = np.arange(1, len(order) + 1), labels or {}
    tornado = [Series("", ends[i], [rank, rank], line="solid", marker="", colour="0.5", width=3.0, legend=False)
               for rank, i in zip(ranks, order, strict=True)]
    tornado += [Series(word, ends[order, side], ranks, marker=marker, colour=colour, size=7.0)
                for side, (word, marker, colour) in enumerate((("lowest tenth of an input", "v", "#2166ac"),
                                                               ("highest tenth of an input", "^", "#b2182b")))]
    tornado += [Series("", [np.mean(ends[i])], [rank - 0.3], marker="", colour="black", legend=False,
                       labels=[shown.get(found.parameters[i], found.parameters[i])])
                for rank, i in zip(ranks, order, strict=True)]
    lo, hi = found.interval
    shows, width, columns = (slice(None), 1.3, 4) if found.families else (slice(2, None), 0.6, 2)
    panels = [
        Panel(cloud, "Re λ  [1/time]", "Im λ  [rad/time]", "modes that grow", "x"),
        Panel(bars, "Im λ  [rad/time]", "probability that it grows  [-]", "families of modes", limits={"y": (-0.03, 1.03)}),
        Panel(tornado, "probability of instability  [-]", "rank of the input", "inputs", limits={
            "x": (-0.03, 1.03), "y": (len(order) + 0.5, 0.4)}, levels=[Level(found.probability, "all samples")], whole="y")]
    note = " ".join(NOTES[shows])
    return Chart(name, title, panels[shows], len(panels[shows]), note=note, height=3.2, width=width, columns=columns, about=(
        f"unstable with probability {found.probability:.3g} in [{lo:.3g}, {hi:.3g}] at {100 * found.confidence:g} %; "
        f"{100 * found.undecided:.2g} % undecided; {len(found.samples):,} samples"))


def scatter_tables(name: str, found: Scatter) -> list[Table]:
    """A row for each family of modes, one for each input, and one for each sample; no table without rows."""
    families: list[dict[str, Any]] = [
        {"family": k, "omega": float(np.median(one.omega)), "lowest": one.frequency[0], "highest": one.frequency[1],
         "probability": one.probability, "from": one.interval[0], "to": one.interval[1], "undecided": one.undecided,
         "growth": float(one.growth.max())} for k, one in enumerate(found.families, 1)]
    most, ends = found.importance, found.tornado()
    inputs = [{"input": one, "first": float(most.first[i]), "total": float(most.total[i]),
               "first_growth": float(most.first_growth[i]), "total_growth": float(most.total_growth[i]),
               "low": float(ends[i, 0]), "high": float(ends[i, 1])}
              for i, one in enumerate(found.parameters)]
    samples = [{**dict(zip(found.parameters, map(float, row), strict=True)), "verdict": int(verdict), "growth": float(growth),
                "omega": float(omega)}
               for row, verdict, growth, omega in zip(found.samples, found.verdict, found.growth, found.omega, strict=True)]
    return [table for table in (Table(f"{name}-families", families), Table(f"{name}-inputs", inputs), Table(name, samples))
            if table.rows]
