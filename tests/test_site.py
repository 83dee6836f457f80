"""What the site makes from the code: no public name, no key of a kind and no scene of the gallery is missing."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import femsub as fs
from benchmarks import gallery
from benchmarks.pages import blocks_of
from femsub.app.explain import TABLES
from femsub.app.grammar import Scene, built_in, text_of
from femsub.app.kinds import FAMILIES, Kinds
from femsub.io import keys_of, spelt

DOCS = Path(__file__).parent.parent / "docs"


def loaded(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


generate = loaded(DOCS / "generate.py")
PAGES: dict[str, str] = generate.pages()


def test_the_reference_has_every_public_name_once() -> None:
    found = {path: re.findall(r"^\.\. auto\w+:: (\w+)$", text, re.MULTILINE) for path, text in PAGES.items()}
    assert sorted(name for names in found.values() for name in names) == sorted(name for name in fs.__all__ if name[0] != "_")
    own = {path for path, names in found.items() if names}  # a page of its own, which a table leads to
    assert all(found[path] == [Path(path).stem] for path in own)
    rows = re.compile(r"^\| \[\w+\]\((\S+)\)", re.MULTILINE)
    assert own == {f"{page}/{target}" for page in generate.NAMES for target in rows.findall(PAGES[f"{page}/index.md"])}
    assert len({path.lower() for path in PAGES}) == len(PAGES)  # for file systems that do not tell case apart


def test_every_public_function_and_class_has_an_example() -> None:
    without = [name for name in fs.__all__ if ">>>" not in (getattr(fs, name).__doc__ or "")]
    assert not [name for name in without if not name.startswith("__") and not issubclass(getattr(fs, name), (Exception, Warning))]


def test_no_page_of_the_reference_is_a_drawer() -> None:
    assert all(2 <= len(names) <= 30 for names in generate.names_by_page().values())


def test_the_reference_s_first_page_names_all_pages() -> None:
    text = (DOCS / "reference" / "index.md").read_text(encoding="utf-8")
    assert [title for title, *_ in generate.NAMES.values()] == re.findall(r"^\| (.+?) \|", text, re.MULTILINE)[1:]


ALL_KINDS = [*(("tables", name, kind) for name, kind in TABLES.items()), *(
    (family, name, Kinds().kind(family, name)) for family in FAMILIES for name in Kinds().names(family))]


@pytest.mark.parametrize(("page", "name", "kind"), ALL_KINDS, ids=[f"{page}-{name}" for page, name, _ in ALL_KINDS])
def test_the_reference_has_every_key_of_a_kind(page: str, name: str, kind: Any) -> None:
    def expected(kind: Any) -> list[tuple[str, Any]]:
        own = [(spelt(kind, field), one) for field, one in keys_of(kind).items()]
        return own + [pair for _, one in own for table in one.tables for pair in expected(table)]

    heading = generate.HEADINGS.get(name, name) if page == "tables" else name
    text = PAGES[f"scenes/kinds/{page}.md"].split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `([\w-]+)` \|(.*)\|$", text, re.MULTILINE)
    assert [key for key, _ in rows] == [key for key, _ in expected(kind)]
    for (_, row), (_, one) in zip(rows, expected(kind), strict=True):
        type_, default, meaning, unit = (cell.strip() for cell in re.split(r"(?<!\\)\|", row))
        assert meaning.replace(r"\|", "|") == one.meaning and unit == one.unit and type_
        assert (default == "required") == one.required


@pytest.mark.parametrize("scene", built_in())
def test_the_reference_has_the_file_of_a_scene(scene: str) -> None:
    text = PAGES[f"scenes/{scene}.md"]
    file = text.split("```toml\n")[1].split("```")[0]
    assert file.strip() and tomllib.loads(file) == tomllib.loads(text_of(scene))
    assert built_in()[scene] in text and f"({scene}.md)" in PAGES["scenes/index.md"]


# the gallery

RAN: dict[str, Any] = json.loads(gallery.RUNS.read_text(encoding="utf-8"))


def test_the_gallery_shows_every_scene() -> None:
    assert list(built_in()) == list(RAN) and set(gallery.GALLERY) == set(built_in())
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.page(RAN), "python -m benchmarks gallery"
    assert set(built_in()) == set(re.findall(r"\]\(\.\./pictures/gallery/([\w-]+)\.png\)", gallery.page(RAN)))


@pytest.mark.parametrize("scene", built_in())
def test_a_scene_of_the_gallery_has_a_small_picture_and_two_sentences(scene: str) -> None:
    shown = gallery.GALLERY[scene]
    assert (gallery.PICTURES / f"{scene}.png").stat().st_size < 150e3
    assert len(re.findall(r"\.(?= |$)", shown.teaches)) == 2 and len(shown.alt.split()) > 3
    assert RAN[scene]["seconds"] > 0


@pytest.mark.parametrize("scene", [name for name, shown in gallery.GALLERY.items() if shown.text])
def test_a_scene_file_of_the_gallery_is_a_scene_s(scene: str, tmp_path: Path) -> None:
    found, own = Scene.from_file(gallery.scene_file(scene, tmp_path)), tomllib.loads(text_of(scene))
    assert found.name == scene and set(found.parts) == set(own["part"])
    assert {ask.KIND for ask in found.asks} <= {next(iter(ask)) for ask in own["ask"]} and gallery.GALLERY[scene].figure


# formulas

METHODS_PAGES = sorted((DOCS / "methods").glob("*.md"))


def test_formulas_of_the_methods_are_blocks_that_are_rendered() -> None:
    found = {path.stem: re.findall(r"^```(\w*)\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
             for path in METHODS_PAGES}
    assert not [name for name, blocks in found.items() if any(kind == "text" and "⁻¹" in text for kind, text in blocks)]
    without = {name for name, blocks in found.items() if not any(kind == "math" for kind, _ in blocks)}
    assert without == {"index", "choice", "published"}


def test_a_formula_becomes_mathml_with_its_indices_below_the_line() -> None:
    pytest.importorskip("sphinx")
    conf = loaded(DOCS / "conf.py")
    assert '<mpadded voffset="-0.25em">' in conf.mathml("K_{ii}^{-1}") and "msub" not in conf.mathml("K_{ii}^{-1} M_b")
    for path in METHODS_PAGES:
        for formula in re.findall(r"^```math\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            assert "merror" not in conf.mathml(formula, True), path.name
    texts = {"G⁻¹Φ_b, K_ii⁻¹ K_biΨ": "G⁻¹Φ<b>, K<ii>⁻¹ K<bi>Ψ", "m_{j-1} to m_j": "m<{j-1}> to m<j>",
             "test_site.py, mode_n, read_x_y": "test_site.py, mode_n, read_x_y"}
    assert {text: conf.INDEXED.sub(r"\1<\2>", text) for text in texts} == texts


# notebooks

TUTORIALS = [page for page in sorted((DOCS / "tutorials").glob("*.md")) if page.stem != "index"]


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_is_a_notebook_of_its_blocks(page: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("jupytext")
    text = page.read_text(encoding="utf-8")
    made = generate.notebook(text, page.stem)
    nbformat.validate(made)
    blocks = [block for block in blocks_of(text) if block.kind == "python"]
    assert [cell.source for cell in made.cells if cell.cell_type == "code"] == [block.text.rstrip("\n") for block in blocks]
    words = "\n".join(cell.source for cell in made.cells if cell.cell_type == "markdown")
    assert words.startswith("# ") and "folder of the clone" in words and ".md" not in re.sub(r"`[^`]*`", "", words)
    assert not [block.shown for block in blocks if block.shown and block.shown in words]  # running makes it anew
    assert not [block.picture for block in blocks if block.picture and Path(block.picture).name in words]
    shown = re.findall(r"\]\(attachment:([\w.-]+)\)", words)
    assert shown == [name for cell in made.cells for name in cell.get("attachments", {})] and "](../pictures" not in words


@pytest.mark.slow
def test_a_notebook_runs_and_shows_its_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient, jupytext = pytest.importorskip("nbclient"), pytest.importorskip("jupytext")
    pytest.importorskip("ipykernel")
    (tmp_path / "meshes").symlink_to(DOCS.parent / "meshes")
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    made = generate.notebook((DOCS / "tutorials" / "matrices.md").read_text(encoding="utf-8"), "matrices")
    nbclient.NotebookClient(made, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [one for cell in made.cells if cell.cell_type == "code" for one in cell.outputs]
    assert "Substructure 'beam': 144 DOF" in "".join(one.text for one in outputs if one.output_type == "stream")
    assert sum("image/png" in one.get("data", {}) for one in outputs) == 1
    jupytext.write(made, tmp_path / "matrices.ipynb")
    assert jupytext.read(tmp_path / "matrices.ipynb").cells[0].source.startswith("# Matrices")


def test_the_command_of_the_index_makes_a_notebook(tmp_path: Path) -> None:
    jupytext = pytest.importorskip("jupytext.cli")
    words = (DOCS / "tutorials" / "index.md").read_text(encoding="utf-8")
    command = re.search(r"`jupytext (--to ipynb) --output (\S+) (\S+)`", words)
    assert command is not None
    page, made = DOCS.parent / command[3], tmp_path / command[2]
    jupytext.jupytext([*command[1].split(), "--output", str(made), str(page)])
    cells = json.loads(made.read_text(encoding="utf-8"))["cells"]
    assert sum(cell["cell_type"] == "code" for cell in cells) == len(blocks_of(page.read_text(encoding="utf-8")))


# search

@pytest.mark.parametrize(("asked", "page"), [
    ("sensitivity", "guide/what-helps"), ("effective mass", "guide/mode-cards"), ("map", "guide/stability-maps"),
    ("damping", "guide/components")])
def test_the_search_finds_a_heading_of_the_guide(asked: str, page: str) -> None:
    """The site's search stems words; titles and headings come before text."""
    pytest.importorskip("sphinx")
    from sphinx.search.en import SearchEnglish

    stem = SearchEnglish({}).stem
    headings = re.findall(r"^#+ (.+)$", (DOCS / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE)
    stems = [{stem(word) for word in re.findall(r"\w+", heading.lower())} for heading in headings]
    assert any({stem(word) for word in asked.split()} <= found for found in stems), headings
