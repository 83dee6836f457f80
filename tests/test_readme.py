"""Everything in the README and in the pages of docs/ runs and prints what it shows; links lead somewhere; sentences are short.

A page is one test: it runs from top to bottom, its ```python blocks in one namespace and in a folder of its own. A ```text block
that follows is their output, and is compared by the rules of benchmarks/pages.py: numbers to the digits shown, `…` stands for
anything. A block that prints must show what. `python -m benchmarks pages docs/x.md` does the same for one page, and `--write`
puts the output into it. A page of more than some 3 s has a comment `<!-- slow -->`.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest
import scipy.io

import femsub as fs
from benchmarks.pages import BLOCK, GIVEN, blocks_of, differences, run
from benchmarks.pictures import NUMBERS, PICTURES, SHOWN
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.app.kinds import FAMILIES, Kinds
from femsub.components import disc_pair
from femsub.io import parsed_toml

ROOT = Path(__file__).parent.parent
#: All pages but those that the site's build makes.
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(
    page for page in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in page.parts
    and (page.name == "index.md" or "reference" not in page.parts) and "scenes" not in page.parts)]
TEXTS = {page.relative_to(ROOT).with_suffix("").as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
BLOCKS = [(page, *found) for page, text in TEXTS.items() for found in BLOCK.findall(text)]


#: What the stored pictures show.
SHOWS: dict[str, Any] = json.loads((PICTURES / SHOWN).read_text(encoding="utf-8"))


def said(rows: list[dict[str, Any]]) -> str:
    """The panels of a figure and the names of what is drawn in them, without values: those of rounding differ by machine."""
    return "\n".join(" ".join(str(row[key]) for key in ("panel", "line", "field") if key in row) for row in rows)


def blocks(language: str) -> list[str]:
    return [text for _, kind, text in BLOCKS if kind == language]


def slow(page: str) -> Any:
    return pytest.mark.slow if "<!-- slow -->" in TEXTS[page] else ()


def prose(page: str) -> list[str]:
    """The paragraphs of a page and the items of its lists, without code, tables, headings and targets of links."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", TEXTS[page], flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "CODE", text))
    lines = ["" if line.startswith(("#", "|")) else re.sub(r"^- ", "\n", line) for line in text.splitlines()]
    return [" ".join(part.split()) for part in re.split(r"\n\s*\n", "\n".join(lines)) if part.strip()]


def test_all_kinds_of_blocks_are_known() -> None:
    assert {kind for _, kind, _ in BLOCKS} == {"sh", "python", "toml", "text", "math"}


def test_the_readme_can_be_read_to_its_end() -> None:
    assert len(TEXTS["README"].splitlines()) <= 120
    numbers = re.findall(r"(?<![\w.])\d[\d.,]*\w*", " ".join(prose("README")))
    assert len(numbers) <= 20, numbers


def test_sentences_are_short() -> None:
    assert not [(page, sentence) for page in TEXTS for paragraph in prose(page)
                for sentence in re.split(r"(?<=[.?!])\**\s", paragraph) if len(sentence.split()) > 30]


@pytest.mark.sampled(7, 1)
@pytest.mark.parametrize("page", [pytest.param(page, marks=slow(page)) for page, text in TEXTS.items() if blocks_of(text)])
def test_a_page_prints_what_it_shows(page: str, tmp_path: Path) -> None:
    if any(f"{name}/" in TEXTS[page] and not place.exists() for name, place in GIVEN.items()):
        pytest.skip("the data of others that the page needs are not there")
    found, printed, fault = run(TEXTS[page], tmp_path)
    assert not fault, fault
    assert len(printed) == len(found)
    for block, output in zip(found, printed, strict=True):
        told = differences(output, block.shown or "")
        assert not told, f"{block.text}\n{told}"
    kept = tmp_path / NUMBERS
    drawn = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    assert {f"tutorials/{name}" for name in drawn} == {block.picture for block in found if block.picture}
    for name, now in drawn.items():  # the picture that is stored has the lines that are drawn today
        then = SHOWS[f"tutorials/{name}"]["shows"]
        assert now and not differences(said(now), said(then)), name
    known = (*GIVEN, NUMBERS, "my.toml")
    assert all(path.name in TEXTS[page] or path.name in known for path in tmp_path.iterdir())  # only what it names


@pytest.mark.slow
def test_your_own_matrices_lose_their_stability_where_the_full_model_does() -> None:
    code = next(block for block in blocks("python") if "n = 2000" in block)
    names: dict[str, object] = {}
    exec(code, names)
    sub, rom, band = names["sub"], names["rom"], names["band"]
    exact, found = fs.critical_slope(sub, band=band), fs.critical_slope(rom, band=band)
    assert found.value == pytest.approx(exact.value, rel=1e-3) and round(found.value, 4) == -0.0235
    assert found.omega == pytest.approx(exact.omega, rel=1e-6) and round(found.omega) == 316
    with pytest.raises(ValueError, match="cut-off"):
        fs.critical_slope(fs.reduce(sub, fs.CraigChang(modes=20)), band=band)


@pytest.mark.sampled(3, 1)
@pytest.mark.parametrize("text", [pytest.param(text, marks=slow(page)) for page, kind, text in BLOCKS
                                  if kind == "toml" and not re.search(r"^use = ", text, re.MULTILINE)])  # tests/test_extend.py
def test_scene_files(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    sub = fs.chain(10)
    for name in "MK":
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", getattr(sub, name).tocoo())
    scipy.io.savemat(tmp_path / "brake.mat", disc_pair())
    (tmp_path / "meshes").symlink_to(ROOT / "meshes")
    for file in (ROOT / "meshes" / "nastran").iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["run", "my.toml", "--no-figures", "--out", "out"]) == 0, capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").exists()


def test_commands_exist_and_the_scenes_they_name() -> None:
    for line in "".join(blocks("sh")).splitlines():
        script, *words = line.split()
        if line.startswith(("git clone ", "cd ")):  # the shell's own, which bring the reader to this folder
            continue
        assert (ROOT / script).stat().st_mode & 0o111, f"{script} cannot be executed"
        if words[:1] == ["run"] and words[1] != "my.toml":  # that is the block before, which `test_scene_files` runs
            Scene.from_file(words[1])


def test_each_kind_is_used_in_a_scene_file_of_the_guide_and_the_page_on_scenes_names_it() -> None:
    kinds, used = Kinds(), set[tuple[str, str]]()
    for text in (text for page, kind, text in BLOCKS if kind == "toml"):
        table = parsed_toml(text, "a block")
        for family in FAMILIES:
            tables = table.get(family, {})
            for one in tables if isinstance(tables, list) else tables.values():
                used |= {(family, name) for name in kinds.names(family) if name in one}
    every = {(family, name) for family in FAMILIES for name in kinds.names(family)}
    assert used == every
    assert all(f"`{name}`" in TEXTS["docs/guide/scenes"] for _, name in every)


def test_the_page_on_scenes_fits_on_two_screens() -> None:
    assert len(TEXTS["docs/guide/scenes"].splitlines()) <= 100


def anchors(text: str) -> set[str]:
    """The places in a page that GitHub and the site let a link name."""
    found: list[str] = []
    for heading in re.findall(r"^#+ +(.+?) *$", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE):
        slug = re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()).replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{sum(other.startswith(slug) for other in found)}")
    return set(found)


def dead_links(page: Path) -> list[str]:
    """Links to files and headings that are not there, and addresses that are none; those of the network are not asked for."""
    text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    dead = []
    for target in re.findall(r"\]\(([^)]*)\)", text):
        if re.match(r"\w+:", target):
            fine = re.fullmatch(r"https?://[\w-]+(\.[\w-]+)+(/[^\s<>\"]*)?", target)
        else:
            name, _, place = target.partition("#")
            file = page.parent / name if name else page
            fine = file.exists() and (not place or place in anchors(file.read_text(encoding="utf-8")))
        dead += [] if fine else [target]
    return dead


def test_files_that_are_named_exist() -> None:
    for page in PAGES:
        for name in re.findall(r"`(scripts/[\w./-]+|\.ci/run|tests/[\w.]+)", page.read_text(encoding="utf-8")):
            assert (ROOT / name).exists(), name


def test_the_benchmarks_fit_a_screen_and_each_conclusion_links_to_its_data() -> None:
    page = TEXTS["docs/benchmarks"]
    assert len(page.splitlines()) <= 50
    data = {path.name for path in (ROOT / "benchmarks" / "data").glob("*.txt")}
    assert set(re.findall(r"\(\.\./benchmarks/data/([\w-]+\.txt)\)", page)) == data
    for name in data:
        _, command, seconds = (ROOT / "benchmarks" / "data" / name).read_text(encoding="utf-8").splitlines()[:3]
        assert re.match(r"# (env |python )", command) and re.match(r"# \d+ s, commit ", seconds), name


def test_links_lead_somewhere() -> None:
    assert not {str(page.relative_to(ROOT)): dead for page in PAGES if (dead := dead_links(page))}


def test_dead_links_are_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A b, c\n[x](#a-b-c) [x](#a-b) [x](page.md#a-b-c) [x](page.md#c) [x](other.md)\n```text\n[x](y)\n```\n"
                    "[x](https://a.org/b#c) [x](https://a b.org) [x](htp://a.org) `[x](z)`\n")
    assert dead_links(page) == ["#a-b", "page.md#c", "other.md", "https://a b.org", "htp://a.org"]


@pytest.mark.parametrize(("printed", "shown"), [
    ("1.2345e-03 (4 of 5)", "1.23e-03 (4 of 5)"),  # digits cut
    ("1.2344 -0.5", "1.2345 -0.5"),  # rounded the other way on another machine
    ("0.021186178704024648", "0.02118617870402"),
    ("a | b\n----- | -----", "a  |  b\n-- | --------"),  # columns as wide as they like
    ("3.1e-16 and 0.0", "2e-15 and 4e-17"),
    ("took 3.1 ms, 5 kept", "took 12.7 ms, 5 kept"),
    ("took 1.25 s", "took 12.7 ms"),
    ("  a  1\n* b  2", "* a  1\n  b  2"),  # which model is best goes by run times
    ("error 2e-15, 3 modes", "error …, 3 modes"),
    ("error 2e-15; sure", "error 2e-…; sure"),
    ("a b c\nd e", "a … e"),
    ("a b", "a b …"),
    ("(0.1000001+2.5j)", "(0.1+2.5j)"),
])
def test_an_output_that_agrees_is_taken(printed: str, shown: str) -> None:
    assert not differences(printed, shown)


@pytest.mark.parametrize(("printed", "shown", "told"), [
    ("10 DOF", "11 DOF", "[11] DOF"),
    ("10000000 DOF", "10000001 DOF", "[10000001]"),
    ("1.2345e-03", "1.24e-03", "[1.24e-03]"),
    ("1.2345", "1.2347", "[1.2347]"),
    ("1e-11", "2e-13", "[2e-13]"),
    ("a b", "a b c", "[c]"),
    ("a b c", "a b", "goes on: c"),
    ("a b c d", "a … c", "goes on: d"),
    ("3.1 Hz", "12.7 Hz", "[12.7]"),
    ("2.1 MB", "2.3 MB", "[2.3]"),
    ("(0.1+2.5j)", "(0.1+2.7j)", "[(0.1+2.7j)]"),
    ("x = -1.5", "x = 1.5", "[1.5]"),
    ("unstable", "stable", "[stable]"),
])
def test_an_output_that_differs_is_seen(printed: str, shown: str, told: str) -> None:
    assert told in differences(printed, shown)


def test_a_page_runs_in_one_namespace_and_a_fault_tells_its_block(tmp_path: Path) -> None:
    page = ("```python\nx = 2\n```\n```text\nno output of x = 2\n```\n```python\nprint(x)\n```\nprose\n```text\n2\n```\n"
            "```sh\nls m*\n```\n```text\nmeshes …\n```\n```sh\nrm -r /\n```\n```python\n1 / 0\n```\n")
    found, printed, fault = run(page, tmp_path)
    assert [block.shown for block in found] == [None, "2\n", "meshes …\n", None] and printed[:2] == ["", "2\n"]
    assert len(printed) == 3 and "ZeroDivisionError" in fault and "<block 4>" in fault


FIGURE = "import matplotlib.pyplot as plt\nfigure, axis = plt.subplots()\naxis.plot([1, 2], [3, 4], label='a line')\n"


def drawing(code: str, image: str = "![x](../pictures/tutorials/some-lines.png)\n") -> str:
    return f"```python\n{FIGURE}{code}\n```\n\n{image}"


@pytest.mark.slow
def test_a_figure_is_saved_by_the_block_before_its_image(tmp_path: Path) -> None:
    found, printed, fault = run(drawing("print(1)\nfigure", "```text\n1\n```\n\n![x](../pictures/tutorials/some-lines.png)\n"),
                                tmp_path)
    assert not fault and printed == ["1\n"] and found[0].picture == "tutorials/some-lines.png"
    assert (tmp_path / "some-lines.png").read_bytes().startswith(b"\x89PNG")
    shows = json.loads((tmp_path / NUMBERS).read_text())["some-lines.png"]
    assert [row["line"] for row in shows] == ["a line"] and shows[0]["y"] == [3, 4]
    assert not blocks_of(drawing("figure", "text\n\n![x](../pictures/tutorials/some-lines.png)\n"))[0].picture
    assert not blocks_of(drawing("figure", "![x](../pictures/chain-growth.png)\n"))[0].picture


@pytest.mark.parametrize("code", ["drawn = figure", "plt.figure()", "print(figure)"])
def test_a_block_before_an_image_that_draws_nothing_is_a_fault(code: str, tmp_path: Path) -> None:
    _, _, fault = run(drawing(code), tmp_path)
    assert "<block 1>" in fault and not (tmp_path / "some-lines.png").exists()


@pytest.mark.slow
def test_the_output_of_a_page_is_written_into_it(tmp_path: Path) -> None:
    def run_page(*options: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "benchmarks", "pages", str(page), *options], capture_output=True,
                              text=True, check=False, env=os.environ | {"PYTHONPATH": str(ROOT)})

    page = tmp_path / "page.md"
    page.write_text("# A\n\n```python\nprint(1.25)\n```\n\nB.\n\n```python\nprint('x', 3)\n```\n\n```text\nx …\n```\n\n"
                    "```python\ny = 1\n```\n")
    assert run_page().returncode == 1 and run_page("--write").returncode == 0
    text = page.read_text()
    assert "print(1.25)\n```\n\n```text\n1.25\n```\n\nB.\n" in text and "x …" in text and text.count("```text") == 2
    assert run_page().returncode == 0
    page.write_text(text.replace("1.25\n```\n\nB", "1.35\n```\n\nB"))
    told = run_page()
    assert told.returncode == 1 and "[1.35]" in told.stdout and "[1.25]" in told.stdout
