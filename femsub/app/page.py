"""One page for a run, report.html: verdict, plots, the least stable mode in motion, tables, inputs. It needs no network.

Plotly (the extra `page`) is inlined. It is imported by nothing else in femsub.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from femsub.app.explain import toml
from femsub.app.figure_style import look
from femsub.app.inputs import RESULTS, results_of
from femsub.app.moving import MODE_FILE, Moving, read_mode
from femsub.app.page_plots import plots
from femsub.app.report import output_folder, put
from femsub.app.scene import OWN, SCENES
from femsub.app.verdict import Verdict, units_of, verdict
from femsub.checks import Array, package
from femsub.errors import FemsubError, InputError

PAGE_FILE = "report.html"
TEMPLATE = Path(__file__).with_name("page.html")
WHY = 'the page of a run is drawn by Plotly: pip install "femsub[page]"'
OPEN = 40  # rows of a table that is shown at once; longer ones are folded
ANSWERS = {"yes": "Yes", "no": "No", "in part": "In part", "open": "Not decided", "found": "Found"}
MODELS = ("method", "model")  # columns that name a model
TIMES = ("reduction_median_s", "solution_median_s")  # other times are in the files alone
SLIDERS = (("phase", "phase φ", 0, 360, 1, 0), ("speed", "periods per second", 0.1, 2, 0.1, 0.5),
           ("scale", "scale", 0, 3, 0.05, 1))  # name, label, least, most, step and value
CELLS_OF_LISTS = 6  # longest list that stands in a cell
#: names of tables, and of their columns: what stands at the head, and what it tells
TABLES = {"critical-slope": "Critical slopes", "size-sweep": "Critical slope over the model's size", "eigenvalues": "Eigenvalues",
          "error-time": "Error against run time", "modes": "Normal modes", "joined-interface": "Interface on springs",
          "unstable": "Unstable modes of the full model", "flutter": "Eigenvalues over mu", "losses": "Losses of stability",
          "cycles": "Limit cycles", "branches": "Branches, point by point", "transients": "Transients",
          "models": "Models in time", "meetings": "Where modes meet", "critical-value": "Critical values",
          "spectrum": "Peaks of the spectra",
          "spectrogram": "Strongest frequency over time", "growth": "Growth in time", "quality": "Quality under self-excitation",
          "parts": "Parts", "methods": "Methods, error against run time", "modes-per-part": "Modes of each part"}
COLUMNS = {
    "method": ("model", "the full model, or the method of reduction"),
    "model": ("model", "the full model, or the method of reduction"),
    "modes": ("modes", "modes kept in the basis"), "size": ("DOF", "degrees of freedom of the model"),
    "error_eigenvalue": ("err λ", "largest error of a complex eigenvalue, over its modulus"),
    "error_growth": ("err Re λ", "largest error of a growth rate, over the rates of damping and friction"),
    "error_critical": ("err critical", "relative error of the critical slope, or of another parameter"),
    "error_frequency": ("err ω", "largest relative error of an undamped frequency"),
    "error_force": ("err force", "relative error of the forces in the joints"),
    "missing": ("missing", "eigenvalues of the full model that the small one lacks"),
    "extra": ("extra", "eigenvalues of the small model that the full one lacks"),
    "mac": ("MAC", "least agreement of the shapes; 1: the same"), "memory": ("MB", "size of the model's matrices"),
    "stable": ("stable", "the verdict in the band; undecided within the error bars: no value"),
    "is_stable": ("stable", "the verdict in the band; undecided within the error bars: no value"),
    "pareto": ("front", "no other model is both as fast and as accurate in Re λ"),
    "reduction_median_s": ("reduce [s]", "time to reduce, median of the runs"),
    "solution_median_s": ("solve [s]", "time to solve, median of the runs"),
    "growth": ("Re λ", "largest growth rate; above 0 a motion grows"), "full_growth": ("Re λ, full", "that of the full model"),
    "omega": ("ω", "angular frequency"), "frequency_hz": ("f [Hz]", "frequency"), "hertz": ("f [Hz]", "frequency"),
    "up_to": ("up to ω", "end of the comparison: the band's, or the model's cut-off"),
    "cutoff": ("cut-off ω", "above it the reduced model's modes mean nothing"),
    "slope": ("slope dμ/dv", "critical slope, or the slope of the friction law"), "full": ("full", "the full model's value"),
    "error": ("rel. error", "error relative to the full model, or to the closed form"),
    "port_error": ("port error", "error of the static response at the contact, in the energy norm"),
    "error_bar": ("error bar", "bound of the error of Re λ from rounding"), "residual": ("residual", "relative residual"),
    "belt": ("belt", "number of the mass under the belt"), "reason": ("why not", "why there is no value"),
    "shape_error": ("shape error", "sine of the angle between the least stable shapes, in the norm of M"),
    "family": ("from ω", "frequency of the mode from which the cycle begins"), "rms": ("rms", "rms of the speed under the belt"),
    "peak": ("peak", "largest speed under the belt"), "sticking": ("sticking", "share of the period in which it sticks"),
    "harmonics": ("harmonics", "harmonics of the cycle"), "truncation": ("left out", "share of the harmonics that are left out"),
    "multiplier": ("multiplier", "largest Floquet multiplier; inside the unit circle: stable"),
    "missed": ("missed", "unstable modes of the full model that are stable in the small one"),
    "invented": ("invented", "unstable modes of the small model that are stable in the full one"),
    "critical": ("critical", "where stability is first lost: the slope, or another parameter"),
    "error_real": ("err Re λ, over |λ|", "largest error of Re λ, over |λ|"),
    "springs": ("springs", "stiffness of the springs over that of the interface"),
    "damping": ("equiv. damping", "-2 Re λ / |λ|"), "evidence": ("evidence", "how completeness was shown")}


def check_plotly() -> None:
    """Whether a page can be made.

    Raises
    ------
    MissingPackageError
        There is no Plotly.
    """
    package("plotly", WHY)


def show(folder: Path) -> Path:
    """Makes the page of a finished run from what is in its folder; nothing is computed.

    Raises
    ------
    InputError
        The folder holds no results of a run, or damaged ones; a run writes into it.
    """
    check_plotly()
    if not folder.is_dir():
        raise InputError(f"{folder} holds no results.json of a run; name the folder that was given by --out")
    with output_folder(str(folder)):
        path = folder / RESULTS
        told = results_of(path)
        kind = told["inputs"].get("scene") if told else None
        if told is None or not isinstance(kind, str) or not (kind in SCENES or kind.endswith(OWN)):
            raise InputError(f"{folder} holds no results.json of a run; name the folder that was given by --out")
        place = folder / MODE_FILE
        mode = read_mode(place) if place.is_file() else None
        names = [name.removesuffix(".csv") for name in told["written"] if str(name).endswith(".csv") and "/" not in name]
        content = io.BytesIO()
        try:
            write_page(told, names, mode, content)
        except FemsubError:
            raise
        except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged, or not of this version: {type(error).__name__}, {error!s:.100}. Run the scene "
                             "again") from error
        made, = put(folder, {PAGE_FILE: lambda file: file.write(content.getvalue())})
    return made


def write_page(told: Mapping[str, Any], tables: Sequence[str], mode: Moving | None, file: BinaryIO) -> None:
    """The page of results as results.json has them, with these of its tables, and with the mode to be shown if there is one."""
    script = package("plotly.offline", WHY).get_plotlyjs()
    parts = {"TITLE": escape(str(told["scene"])), "BODY": "\n".join(_body(told, tables, mode)),
             "DATA": _embedded({"plots": plots(told), "mode": None if mode is None else _sent(mode)}), "PLOTLY": script}
    text = TEMPLATE.read_text(encoding="utf-8")
    pieces = text.split("%%")  # text, name, text, name, ...: what is put in is not searched again
    pieces[1::2] = [parts[name] for name in pieces[1::2]]
    file.write("".join(pieces).encode())


def _embedded(data: Any) -> str:
    """JSON that may stand within a script element."""
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _sent(mode: Moving) -> dict[str, Any]:
    """A mode as the page's script takes it: places as float32, displacements as int16 of their largest."""
    def coded(array: Array, kind: str) -> str:
        return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode()

    top = max(float(np.abs(mode.u.real).max(initial=0)), float(np.abs(mode.u.imag).max(initial=0))) or 1.0
    return {"told": mode.told, "corners": mode.cells.shape[1], "unit": top / 32767, "points": coded(mode.points, "<f4"),
            "cells": coded(mode.cells, "<i4"), "real": coded(np.rint(mode.u.real / top * 32767), "<i2"),
            "imag": coded(np.rint(mode.u.imag / top * 32767), "<i2")}


def _body(told: Mapping[str, Any], tables: Sequence[str], mode: Moving | None) -> Iterator[str]:
    kind = told["inputs"]["scene"]
    by = f"femsub {told.get('versions', {}).get('femsub', '')}, {str(told.get('date', ''))[:16].replace('T', ' ')} UTC"
    yield f"<header><h1>{escape(str(told['scene']))}</h1><p>{escape(f'Scene {kind}, run by {by}')}</p></header>"
    yield from _verdict(verdict(told))
    yield from _warned(told)
    if mode is not None:
        yield from _mode(told, mode)
    yield ('<section id="plots"><h2>Plots</h2><p class="note">Point at a mark to read its numbers. Click a name in a legend to '
           'hide it. Drag to zoom; double-click to zoom out.</p><div class="plots"></div></section>')
    yield ('<section id="tables"><h2>Tables</h2><p class="note">Click a head to sort by its column. Point at it to read what it '
           'means.</p>')
    for name in tables:
        yield from _table(name, rows_of(told, name))
    yield "</section>"
    yield from _rests_on(told, mode)


def _verdict(found: Verdict) -> Iterator[str]:
    badge = found.answer.replace(" ", "-")
    yield f'<section id="verdict" class="{badge}"><h2>{escape(found.question)}</h2>'
    yield f'<p class="answer"><strong>{ANSWERS[found.answer]}.</strong> {escape(found.headline)}</p>'
    for title, lines in (("What decides it", found.decides), ("What is not checked", found.unchecked)):
        if lines:
            yield f"<h3>{title}</h3><ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"
    yield "</section>"


def _warned(told: Mapping[str, Any]) -> Iterator[str]:
    if told.get("warnings"):
        lines = "".join(f"<li>{escape(str(line))}</li>" for line in told["warnings"])
        yield f'<section id="warnings"><h2>Warnings of the run</h2><ul>{lines}</ul></section>'


def _mode(told: Mapping[str, Any], mode: Moving) -> Iterator[str]:
    (growth, omega), said = mode.told["eigenvalue"], str(mode.told["title"])
    verb = "grows" if growth > 0 else "decays"
    at = units_of(told).said(f"{omega:.6g} rad/time")
    fewer = f" Drawn are {len(mode.points)} of {mode.told['nodes']} nodes." if len(mode.points) < mode.told["nodes"] else ""
    sliders = "".join(
        f'<label>{title} <input type="range" id="{name}" min="{low}" max="{high}" step="{step}" value="{value}"><output></output>'
        "</label>" for name, title, low, high, step, value in SLIDERS)
    yield (f'<section id="mode"><h2>The mode in motion</h2><p>{escape(said[:1].upper() + said[1:])}: λ = {growth:.5g} '
           f'{"+" if omega >= 0 else "-"} {abs(omega):.6g}i. It {verb}, and oscillates at {escape(at)}.</p>'
           f'<div id="motion"></div><div class="controls"><button id="play" type="button">Play</button>{sliders}</div>'
           '<p class="note">Shown is Re(u e<sup>iφ</sup>) without growth. Colour: amplitude of each place over the largest.'
           f'{fewer}</p></section>')


def rows_of(told: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    """The rows of a table by its name, which is that of its CSV file."""
    key = max((key for key in told if name == key or name.startswith(f"{key}-")), key=len, default="")
    found: Any = told.get(key, [])
    if isinstance(found, dict):
        inner = name[len(key) + 1:]
        found = found.get(inner) if inner else next((found[word] for word in ("rows", "strongest", "parts") if word in found), [])
    rows = found if isinstance(found, list) else []
    if any("points" in row for row in rows):  # of a branch of limit cycles
        rows = [{"model": item["model"], "family": item["family"], **point} for item in rows for point in item.get("points", [])]
    return [{key: value for key, value in row.items() if not (isinstance(value, dict) or (isinstance(value, list) and (
        len(value) > CELLS_OF_LISTS or any(isinstance(item, (list, dict)) for item in value))))} for row in rows]


def _table(name: str, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    keys = dict.fromkeys(key for row in rows for key in row if key in TIMES or not key.endswith("_s"))
    if "frequency_hz" in keys:
        keys.pop("hertz", None)
    columns = [key for key in keys if any(row.get(key) not in (None, "", []) for row in rows)]
    if not columns:
        return
    known, count = TABLES.get(name, name.replace("-", " ").capitalize()), f"{len(rows)} row{'s' * (len(rows) != 1)}"
    yield f"<details{' open' if len(rows) <= OPEN else ''}><summary>{escape(known)} <span>({count}, {escape(name)}.csv)</span>"
    yield '</summary><div class="scroll"><table><thead><tr>'
    for key in columns:
        label, told = _head(key)
        number = all(isinstance(row.get(key), (int, float, type(None))) and not isinstance(row.get(key), bool) for row in rows)
        yield (f'<th scope="col"{" class=number" if number else ""}><button type="button" title="{escape(told or key)}">'
               f'{escape(label)}</button></th>')
    yield "</tr></thead><tbody>"
    for row in rows:
        yield "<tr>" + "".join(_cell(look(str(row[key])).label if key in MODELS and row.get(key) else row.get(key))
                               for key in columns) + "</tr>"
    yield "</tbody></table></div></details>"


def _head(key: str) -> tuple[str, str]:
    """What stands at the head of a column, and what it tells."""
    if key in COLUMNS or not key.endswith("_hz"):
        return COLUMNS.get(key, (key.replace("_", " "), ""))
    label, told = _head(key.removesuffix("_hz"))
    return f"{label.removesuffix(' ω')} [Hz]", told


def _cell(value: Any) -> str:
    if value is None or value == "":
        return '<td class="none">–</td>'
    if isinstance(value, bool):
        return f"<td>{'yes' if value else 'no'}</td>"
    if isinstance(value, (int, float)) or value in ("inf", "-inf"):
        number = float(value)
        shown = f"{value}" if isinstance(value, int) else f"{number:.6g}".replace("inf", "∞")
        return f'<td class="number" data-v="{number!r}">{shown}</td>'
    if isinstance(value, list):
        return f"<td>{escape(', '.join(f'{item:.6g}' if isinstance(item, float) else str(item) for item in value))}</td>"
    return f"<td>{escape(str(value))}</td>"


def inputs_toml(inputs: Mapping[str, Any]) -> str:
    """The inputs as a scene file: keys first, then tables."""
    return "\n".join(_toml_lines(inputs, "")) + "\n"


def _toml_lines(table: Mapping[str, Any], header: str) -> Iterator[str]:
    known = {key: value for key, value in table.items() if value not in (None, "", [], {})}
    tables = {key: value for key, value in known.items()
              if isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))}
    yield from (f"{key} = {toml(value)}" for key, value in known.items() if key not in tables)
    for key, value in tables.items():
        for item in value if isinstance(value, list) else [value]:
            yield f"\n{'[[' if isinstance(value, list) else '['}{header}{key}{']]' if isinstance(value, list) else ']'}"
            yield from _toml_lines(item, f"{header}{key}.")


def _rests_on(told: Mapping[str, Any], mode: Moving | None) -> Iterator[str]:
    """Inputs, files, versions and the machine."""
    yield ('<section id="inputs"><h2>Inputs</h2><p class="note">As a scene file, with every key as it was used. Places of files '
           f"are relative to the folder of the results.</p><pre>{escape(inputs_toml(told['inputs']))}</pre></section>")
    versions = {**told.get("versions", {}), **{f"machine: {key}": value for key, value in told.get("machine", {}).items()}}
    facts = [(key, ", ".join(map(str, value)) if isinstance(value, list) else value) for key, value in versions.items()]
    facts += [(str(item.get("path")), f"SHA-256 {item.get('sha256')}") for item in told.get("files", [])]
    facts.append(("run ended", told.get("date", "")))
    if mode is None:
        facts.append(("mode", f"{MODE_FILE} is not there. A run with the output page writes it, if the scene finds a mode"))
    lines = "".join(f"<tr><th scope=row>{escape(key)}</th><td>{escape(str(value))}</td></tr>" for key, value in facts)
    yield f'<section id="versions"><h2>Versions and machine</h2><div class="scroll"><table>{lines}</table></div></section>'
