"""Runs the blocks of a page of the documentation, and compares what they print with what the page shows.

    python -m benchmarks pages docs/guide/flutter.md            compares
    python -m benchmarks pages docs/guide/flutter.md --write    writes what is printed into the page, as ```text blocks, and
                                                                figures into docs/pictures

Replace by `…` what another run prints otherwise, and cut long numbers in the code: the page's test compares the rest.

A page runs from top to bottom in a folder of its own, all its ```python blocks in one namespace. A ```toml block is written to
`my.toml` there. A ```sh block runs if its output is shown. A ```text block that comes next after a ```python block with a print,
or after a ```sh block, is its output. An image of `pictures/tutorials/` that comes next after a ```python block, or after its
output, is drawn by this block: its last line is an expression whose value is the figure, as `modes.plot()`.

Output is compared word by word, however wide the columns are.

- `…` stands for anything: as a word for any words, within a word for any characters.
- Whole numbers are equal.
- Other numbers agree to the digits that are shown: relative 1e-6, and half a unit in the last digit of each.
- Numbers below 1e-12 are rounding, and all the same.
- A number before `ms` or `µs` is a run time, and matches any run time. A star at the begin of a line goes by run times: it is
  not compared.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.pictures import NUMBERS, PICTURES, commit, store

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
IMAGE = re.compile(r"\s*!\[[^\]]*\]\([^)\s]*\bpictures/(tutorials/[\w-]+\.png)\)\n?")
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.]*\w)|(?<=\d)[-+]\d+\.?\d*(?:[eE][-+]?\d+)?(?=j)")
#: Folders that a page finds beside it; the last one holds data of others, which may lie beside the repository.
GIVEN = {"meshes": ROOT / "meshes", "scripts": ROOT / "scripts", "5koref1": ROOT.parent / "shared" / "brake-m0"}
RELATIVE, NOISE = 1e-6, 1e-12
TIMES = ("ms", "µs")

#: Runs the blocks that come as JSON on stdin; prints as JSON what each printed, up to the first that fails. Figures are saved.
DRIVER = """
import ast, contextlib, io, json, pathlib, subprocess, sys, traceback
_told, _fault = [], ""
for _kind, _text, _picture in json.load(sys.stdin):
    _out, _name = io.StringIO(), f"<block {len(_told) + 1}>"
    try:
        if _kind == "python":
            with contextlib.redirect_stdout(_out):
                _tree = ast.parse(_text, _name)
                _drawn = _tree.body.pop() if _picture else None
                exec(compile(_tree, _name, "exec"), globals())
                if _picture:
                    from benchmarks.pictures import save as _save
                    _shown = isinstance(_drawn, ast.Expr) and ast.Expression(_drawn.value)
                    _figure = eval(compile(_shown, _name, "eval"), globals()) if _shown else None
                    if not any(axis.has_data() for axis in getattr(_figure, "axes", ())):
                        raise RuntimeError(f"{_name} must end with a figure, which has lines, marks or colours")
                    _save(pathlib.Path(_picture).resolve(), lambda: _figure)
        else:
            _done = subprocess.run(["bash", "-euc", _text], stdin=subprocess.DEVNULL, capture_output=True, text=True)
            _out.write(_done.stdout)
            if _done.returncode:
                raise RuntimeError(_done.stderr or _done.stdout)
    except BaseException:
        _fault = traceback.format_exc()
        break
    _told.append(_out.getvalue())
json.dump([_told, _fault], sys.__stdout__)
"""


@dataclass(frozen=True)
class Block:
    """A block that runs: its language, its text, the output shown on the page (None if none), and the place of the output.

    `picture` is the place in docs/pictures of the figure that the block draws, '' for none. `made_at` contains the places of the
    output's fence and of the image, which a run of the block makes anew.
    """

    kind: str
    text: str
    shown: str | None
    end: int
    shown_at: tuple[int, int] | None = None
    picture: str = ""
    made_at: tuple[int, int] = (0, 0)


def blocks_of(page: str) -> list[Block]:
    """The blocks of a page that run."""
    found = list(BLOCK.finditer(page))
    made = []
    for place, one in enumerate(found):
        prints = one[1] == "sh" or "print(" in one[2]
        output = next((after for after in found[place + 1:place + 2] if prints and after[1] == "text"), None)
        if one[1] == "python" or (one[1] == "sh" and output):
            end = (output or one).end()
            image = IMAGE.match(page, end) if one[1] == "python" else None
            made.append(Block(one[1], one[2], output and output[2], one.end(), output and output.span(2),
                              image[1] if image else "", (one.end(), image.end() if image else end)))
    return made


def run(page: str, folder: Path) -> tuple[list[Block], list[str], str]:
    """The blocks of a page, what each printed in this folder, and the error of the one that failed, if any."""
    for name, place in GIVEN.items():
        (folder / name).symlink_to(place)
    for one in BLOCK.finditer(page):
        if one[1] == "toml":
            (folder / "my.toml").write_text(one[2], encoding="utf-8")
    blocks = blocks_of(page)
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run([sys.executable, "-W", "error", "-c", DRIVER], cwd=folder, capture_output=True, text=True, check=False,
                          input=json.dumps([(one.kind, one.text, Path(one.picture).name) for one in blocks]),
                          env=os.environ | {"PYTHONPATH": path, "FEMSUB_PYTHON": sys.executable, "PYTHONWARNINGS": "error"})
    if done.returncode:
        return blocks, [], done.stderr
    printed, fault = json.loads(done.stdout)
    return blocks, printed, fault


def differences(printed: str, shown: str) -> str:
    """The first word of the output that differs from the page, with its neighbours; '' if all words agree."""
    found, expected = (re.sub(r"^\* ", "", text, flags=re.MULTILINE).split() for text in (printed, shown))
    reach = {0}  # how many words of the output may stand for those of the page so far: several behind a …
    for i, word in enumerate(expected):
        if word == "…":
            after = set(range(min(reach), len(found) + 1))
        else:
            after = {j + 1 for j in reach if j < len(found) and _same(found, j, expected, i)}
        if not after:
            j = max(reach)
            return f"the page shows {_around(expected, i)}\nthe output is  {_around(found, j)}"
        reach = after
    return "" if len(found) in reach else f"the output goes on: {' '.join(found[max(reach):][:12])}"


def _around(words: list[str], place: int) -> str:
    """A word in brackets, between three before and three after."""
    before, word, after = words[max(place - 3, 0):place], words[place:place + 1], words[place + 1:place + 4]
    return " ".join([*before, f"[{' '.join(word)}]", *after])


def _same(found: list[str], j: int, expected: list[str], i: int) -> bool:
    """Whether a word of the output agrees with one of the page."""
    here, there = found[j], expected[i]
    if here == there or (set(here) == set(there) == {"-"}):  # a rule of a table is as wide as its columns
        return True
    if "…" in there:
        return re.fullmatch(".*".join(map(re.escape, there.split("…"))), here) is not None
    unit, other = (" ".join(words[place + 1:place + 2]).strip(".,;:()") for words, place in ((found, j), (expected, i)))
    if other in TIMES and unit in (*TIMES, "s"):
        return True
    if there in (*TIMES, "s") and here in (*TIMES, "s"):
        return _is_number(expected[i - 1]) and _is_number(found[j - 1])
    numbers, others = NUMBER.findall(here), NUMBER.findall(there)
    return NUMBER.sub("#", here) == NUMBER.sub("#", there) and all(map(_close, numbers, others))


def _is_number(word: str) -> bool:
    return NUMBER.fullmatch(word.strip(".,;:()")) is not None


def _close(here: str, there: str) -> bool:
    """Whether two numbers agree to the digits that are shown."""
    if here.lstrip("+-").isdigit() and there.lstrip("+-").isdigit():
        return here == there
    one, other = float(here), float(there)
    room = RELATIVE * abs(other) + (_unit(here) + _unit(there)) / 2
    return abs(one - other) <= room * (1 + 1e-9) or max(abs(one), abs(other)) < NOISE


def _unit(number: str) -> float:
    """One in the last digit: 0.01 of 1.25, 1e-5 of 1.2e-4, 0 of a whole number."""
    digits, _, power = number.lower().partition("e")
    places = len(digits.partition(".")[2])
    return 10.0 ** (int(power or 0) - places) if "." in digits or power else 0.0


def main(page: Path, *, write: bool = False) -> int:
    text, begun = page.read_text(encoding="utf-8"), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        blocks, printed, fault = run(text, Path(folder))
        if write and (numbers := Path(folder) / NUMBERS).exists():
            shows, drawn = json.loads(numbers.read_text(encoding="utf-8")), [one.picture for one in blocks if one.picture]
            of_all = {"step": f"pages {page.resolve().relative_to(ROOT.resolve())}", "commit": commit(),
                      "date": time.strftime("%Y-%m-%d")}
            store(PICTURES, {place: (Path(folder) / Path(place).name).read_bytes() for place in drawn},
                  {place: of_all | {"shows": shows[Path(place).name]} for place in drawn})
    wrong = False
    for block, output in reversed(list(zip(blocks, printed, strict=False))):
        told = differences(output, block.shown or "")
        if told and write:
            start, end = block.shown_at or (block.end, block.end)
            text = text[:start] + (output if block.shown_at else f"\n\n```text\n{output}```") + text[end:]
        elif told:
            wrong = True
            print(f"after\n{block.text}\n{told}\n")
    if write:
        page.write_text(text, encoding="utf-8")
    print(fault or f"{len(blocks)} blocks, {time.perf_counter() - begun:.1f} s")
    return 1 if wrong or fault else 0
