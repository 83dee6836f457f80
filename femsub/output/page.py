"""The HTML page of a run: verdict, plots, the least stable mode in motion, tables, inputs. It needs no network.

Plotly (the extra `page`) is inlined. No other module imports it.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from femsub.checks import Array, package
from femsub.output.tables import label
from femsub.output.units import Units
from femsub.output.verdicts import ANSWERS

MODE_FILE = "mode.npz"
TEMPLATE = Path(__file__).with_name("page.html")
WHY = "the page of a run is drawn by Plotly", "plotly"
TIMES = ("reduction_median_s", "solution_median_s")  # all other times are in the files only
SLIDERS = (("phase", "phase φ", 0, 360, 1, 0), ("speed", "periods per second", 0.1, 2, 0.1, 0.5),
           ("scale", "scale", 0, 3, 0.05, 1))  # name, label, least, most, step and value


class Moving(NamedTuple):
    """u(t) = Re(u e^(iφ)) at points (n, 3). `cells` has rows of point indices: lines (m, 2) or triangles (m, 3)."""

    facts: dict[str, Any]  #: title, eigenvalue, size of the mesh, and other facts that the page shows
    points: Array
    cells: Array
    u: Array


def check_plotly() -> None:
    """Checks that a page can be written.

    Raises
    ------
    MissingPackageError
        Plotly is not installed.
    """
    package("plotly", *WHY)


def write_page(data: Mapping[str, Any], inputs: str, mode: Moving | None, file: BinaryIO) -> None:
    """Writes the page of a run: `data` as in results.json, the text of its inputs, and the mode in motion unless it is None."""
    script = package("plotly.offline", *WHY).get_plotlyjs()
    drawn = json.dumps({"charts": data["charts"], "mode": None if mode is None else coded(mode)}, ensure_ascii=False,
                       separators=(",", ":")).replace("<", "\\u003c")  # JSON that may stand within a script element
    parts = {"TITLE": escape(str(data["scene"])), "BODY": "\n".join(_body(data, inputs, mode)),
             "DATA": drawn, "PLOTLY": script}
    text = TEMPLATE.read_text(encoding="utf-8")
    pieces = text.split("%%")  # text, name, text, name, ...: what is put in is not searched again
    pieces[1::2] = [parts[name] for name in pieces[1::2]]
    file.write("".join(pieces).encode())


def coded(mode: Moving) -> dict[str, Any]:
    """A mode as the page's script reads it: points as float32, displacements as int16 relative to the largest one."""
    def bytes_of(array: Array, kind: str) -> str:
        return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode()

    top = max(float(np.abs(mode.u.real).max(initial=0)), float(np.abs(mode.u.imag).max(initial=0))) or 1.0
    return {"facts": mode.facts, "corners": mode.cells.shape[1], "unit": top / 32767, "points": bytes_of(mode.points, "<f4"),
            "cells": bytes_of(mode.cells, "<i4"), "real": bytes_of(np.rint(mode.u.real / top * 32767), "<i2"),
            "imag": bytes_of(np.rint(mode.u.imag / top * 32767), "<i2")}


def _body(data: Mapping[str, Any], inputs: str, mode: Moving | None) -> Iterator[str]:
    by = f"femsub {data.get('versions', {}).get('femsub', '')}, {str(data.get('date', ''))[:16].replace('T', ' ')} UTC"
    yield f"<header><h1>{escape(str(data['scene']))}</h1><p>{escape(f'Run by {by}')}</p></header>"
    found = data["verdict"]
    yield f'<section id="verdict" class="{found["answer"].replace(" ", "-")}"><h2>{escape(found["question"])}</h2>'
    yield f'<p class="answer"><strong>{ANSWERS[found["answer"]]}.</strong> {escape(found["headline"])}</p>'
    yield from (f"<p><strong>Condition:</strong> {escape(line)}</p>" for line in found["condition"])
    for title, lines in (("What decides it", found["decides"]), ("What is not checked", found["unchecked"])):
        if lines:
            yield f"<h3>{title}</h3><ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"
    yield "</section>"
    if data.get("warnings"):
        lines = "".join(f"<li>{escape(str(line))}</li>" for line in data["warnings"])
        yield f'<section id="warnings"><h2>Warnings of the run</h2><ul>{lines}</ul></section>'
    if mode is not None:
        (growth, omega), said = mode.facts["eigenvalue"], str(mode.facts["title"])
        at = Units.of(data["inputs"].get("units", "")).said(f"{omega:.6g} rad/time")
        fewer = f" Drawn are {len(mode.points)} of {mode.facts['nodes']} nodes." if len(mode.points) < mode.facts["nodes"] else ""
        sliders = "".join(f'<label>{title} <input type="range" id="{name}" min="{low}" max="{high}" step="{step}" '
                          f'value="{value}"><output></output></label>' for name, title, low, high, step, value in SLIDERS)
        yield (f'<section id="mode"><h2>The mode in motion</h2><p>{escape(said[:1].upper() + said[1:])}: λ = {growth:.5g} '
               f'{"+" if omega >= 0 else "-"} {abs(omega):.6g}i. It {"grows" if growth > 0 else "decays"}, and oscillates at '
               f'{escape(at)}.</p><div id="motion"></div><div class="controls"><button id="play" type="button">Play</button>'
               f'{sliders}</div><p class="note">Shown is Re(u e<sup>iφ</sup>) without growth. Colour: amplitude of each place '
               f'over the largest.{fewer}</p></section>')
    yield ('<section id="plots"><h2>Plots</h2><p class="note">Point at a mark to read its numbers. Click a name in a legend to '
           'hide it. Drag to zoom; double-click to zoom out.</p><div class="plots"></div></section>')
    yield ('<section id="tables"><h2>Tables</h2><p class="note">Click a head to sort by its column. Point at it to read what it '
           'means.</p>')
    for name, table in data["tables"].items():
        yield from _table(name, table, rows_of(data, table))
    yield "</section>"
    yield ('<section id="inputs"><h2>Inputs</h2><p class="note">As a scene file. Places of files '
           f"are relative to the folder of the results.</p><pre>{escape(inputs)}</pre></section>")
    versions = {**data.get("versions", {}), **{f"machine: {key}": value for key, value in data.get("machine", {}).items()}}
    facts = [(key, ", ".join(map(str, value)) if isinstance(value, list) else value) for key, value in versions.items()]
    facts += [(str(item.get("path")), f"SHA-256 {item.get('sha256')}") for item in data.get("files", [])]
    facts.append(("run ended", data.get("date", "")))
    if mode is None:
        facts.append(("mode", f"{MODE_FILE} is not there. A run with page = true writes it, if complex-modes finds a mode"))
    lines = "".join(f"<tr><th scope=row>{escape(key)}</th><td>{escape(str(value))}</td></tr>" for key, value in facts)
    yield f'<section id="versions"><h2>Versions and machine</h2><div class="scroll"><table>{lines}</table></div></section>'


def rows_of(data: Mapping[str, Any], table: Mapping[str, Any], longest: int = 6) -> list[dict[str, Any]]:
    """The rows of a table, without values that no cell has room for: dicts, nested lists, lists longer than `longest`."""
    found: Any = table.get("rows", data)
    for key in table.get("place", ()):
        found = found[key]
    return [{key: value for key, value in row.items() if not (isinstance(value, dict) or (isinstance(value, list) and (
        len(value) > longest or any(isinstance(item, (list, dict)) for item in value))))} for row in found]


def _table(name: str, table: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], shown: int = 40) -> Iterator[str]:
    """HTML of a table. It is folded if it has more than `shown` rows."""
    columns = [one for one in table["columns"] if (one["key"] in TIMES or not one["key"].endswith("_s"))
               and any(row.get(one["key"]) not in (None, "", []) for row in rows)]
    if any(one["key"] == "frequency_hz" for one in columns):
        columns = [one for one in columns if one["key"] != "hertz"]
    if not columns:
        return
    known, count = table["title"] or name.replace("-", " ").capitalize(), f"{len(rows)} row{'s' * (len(rows) != 1)}"
    yield f"<details{' open' if len(rows) <= shown else ''}><summary>{escape(known)} <span>({count}, {escape(name)}.csv)</span>"
    yield '</summary><div class="scroll"><table><thead><tr>'
    for one in columns:
        values = [row.get(one["key"]) for row in rows]
        number = all(isinstance(value, (int, float, type(None))) and not isinstance(value, bool) for value in values)
        yield (f'<th scope="col"{" class=number" if number else ""}><button type="button" '
               f'title="{escape(one["meaning"] or one["key"])}">{escape(one["head"])}</button></th>')
    yield "</tr></thead><tbody>"
    for row in rows:
        yield "<tr>" + "".join(_cell(label(row[one["key"]]) if one["role"] == "model" and row.get(one["key"]) else
                                     row.get(one["key"])) for one in columns) + "</tr>"
    yield "</tbody></table></div></details>"


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
