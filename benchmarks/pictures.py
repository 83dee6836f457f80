"""The numbers that pictures show, stored beside the pictures, and their comparison with a new run."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import UsageError
from benchmarks.processes import put
from femsub.output import render

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
SHOWN = "data.json"  # of the pictures
NUMBERS = "numbers.json"  # in the folder of a script's pictures: what they show, by their names
MOST = 40  # largest number of values of a list that are kept, evenly chosen
DIGITS = 4
FACTOR = 3.0  # factor by which an error may differ
FLOOR = 1e-8  # smaller relative errors are not compared, since they contain rounding
ERRORS = ("error", "relative error")  # what a chart tells of its points


def commit() -> str:
    """The short hash of what is checked out, marked if it was changed (pages and data apart: what the report writes);
    'unknown' outside of a repository."""
    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    try:
        changed = git("status", "--porcelain", "-uno", "--", ".", ":!docs", ":!README.md", ":!benchmarks/data")
        return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def save(path: Path, draw: Callable[[], Any]) -> None:
    """Writes a picture, and its numbers into the file beside it; the folder is created."""
    path.parent.mkdir(parents=True, exist_ok=True)
    made: list[Any] = []

    def kept() -> Any:
        made.append(draw())
        return made[0]

    with open(path, "wb") as file:
        render(kept, file)
    known = path.with_name(NUMBERS)
    told = json.loads(known.read_text(encoding="utf-8")) if known.exists() else {}
    known.write_text(json.dumps(told | {path.name: list(lines(made[0]))}), encoding="utf-8")


def store(pictures: Path, figures: Mapping[str, bytes], told: Mapping[str, Mapping[str, Any]]) -> None:
    """Copies figures into the folder of pictures, and their entries into its index."""
    index = pictures / SHOWN
    known = {**(json.loads(index.read_text(encoding="utf-8")) if index.exists() else {}), **told}
    lines = ",\n".join(f" {json.dumps(place)}: {json.dumps(known[place], ensure_ascii=False)}" for place in sorted(known))
    put(pictures, {**figures, SHOWN: f"{{\n{lines}\n}}\n"})


def draw_all(figures: Mapping[str, Callable[[], Any]], names: Sequence[str], out: Path) -> None:
    """Draws the figures that are named, or all."""
    if strange := set(names) - set(figures):
        raise UsageError(f"unknown: {', '.join(sorted(strange))}; there are {', '.join(figures)}")
    for name in names or figures:
        save(out / f"{name}.png", figures[name])
        print(out / f"{name}.png")


def lines(figure: Any) -> Iterator[dict[str, Any]]:
    """The named lines of a figure, the range of each field, and the number of faces of each surface."""
    for at, axis in enumerate(figure.axes):
        panel = axis.get_title() or axis.get_ylabel() or f"panel {at + 1}"
        for line in axis.lines:
            if len(line.get_xdata()) and not str(line.get_label()).startswith("_"):
                yield {"panel": panel, "line": line.get_label(), "x": plain(line.get_xdata()), "y": plain(line.get_ydata())}
        for field in axis.collections:
            if field.get_array() is not None and np.isfinite(field.get_array()).any():
                values = np.asarray(field.get_array(), dtype=float)
                yield {"panel": panel, "field": list(values.shape), "range": plain([np.nanmin(values), np.nanmax(values)])}
            elif type(field).__name__ == "PolyCollection":  # the surface of a shape
                yield {"panel": panel, "faces": len(field.get_paths())}


def shown(results: Mapping[str, Any], figure: str) -> list[dict[str, Any]]:
    """What a figure of a run shows, from its results.json: errors over the DOF, else its lines, else the output of its name."""
    for chart in (one for one in results.get("charts", ()) if one["name"] == figure):
        panels = [panel for place in chart["places"] for panel in place["panels"]]
        every = [(panel["title"], one, dict(one["hover"])) for panel in panels for one in panel["series"]]
        errors = [{"panel": title, "model": one["name"], "DOF": told["DOF"], "error": told[key]} for title, one, told in every
                  for key in ERRORS if one["legend"] and "DOF" in told and key in told]
        return [row for at, row in enumerate(errors) if row not in errors[:at]] or [
            {"panel": title, "line": one["name"], "x": plain(one["x"]), "y": plain(one["y"])}
            for title, one, _ in every if one["legend"]][:MOST]
    found = results.get(figure, {})
    found = found.get("rows", found) if isinstance(found, Mapping) else found
    rows = [found] if isinstance(found, Mapping) else found
    return [{key: plain(value) for key, value in row.items() if not isinstance(value, Mapping)} for row in rows[:MOST] if row]


def plain(values: Any) -> Any:
    """Numbers to DIGITS, lists thinned to MOST values."""
    if isinstance(values, float):
        return float(f"{values:.{DIGITS}g}") if np.isfinite(values) else None
    if isinstance(values, (list, tuple, np.ndarray)):
        chosen = range(len(values)) if len(values) <= MOST else np.linspace(0, len(values) - 1, MOST).astype(int)
        return [plain(value.item() if isinstance(value, np.generic) else value) for value in (values[at] for at in chosen)]
    return values


def differences(then: Sequence[Mapping[str, Any]], now: Sequence[Mapping[str, Any]], factor: float = FACTOR) -> list[str]:
    """The errors of a picture that are not, within a factor, those of a run today; a model that the picture lacks is one, too."""
    kept = {(row["panel"], row["model"], size): error
            for row in then for size, error in zip(row["DOF"], row["error"], strict=True)}
    found = []
    for row in now:
        for size, error in zip(row["DOF"], row["error"], strict=True):
            where = f"{row['panel']}, {row['model']} with {size} DOF"
            drawn = kept.get((row["panel"], row["model"], size))
            if (drawn is None) != (error is None):
                found.append(f"{where}: {drawn} is drawn, {error} found")
            elif drawn is not None and error is not None:
                ratio = max(drawn, FLOOR) / max(error, FLOOR)
                if not 1 / factor <= ratio <= factor:
                    found.append(f"{where}: {drawn:.1e} is drawn, {error:.1e} found")
    return found
