"""Writes the reference's pages from the code: public names by what they are for, built-in scenes, and the keys of each kind.

It makes notebooks of the tutorials as well.
"""

from __future__ import annotations

import inspect
import re
from base64 import b64encode
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

import femsub as fs
from benchmarks.pages import blocks_of
from benchmarks.pictures import PICTURES
from femsub.app.explain import TABLES
from femsub.app.grammar import built_in, text_of
from femsub.app.kinds import Kinds
from femsub.io import Key, keys_of, spelt, toml, type_words

#: the pages of public names: title, one line, and the rooms or modules of femsub whose names stand there
NAMES = {
    "model": ("Models", "What all other functions take and give: matrices with an interface and ports.", ("model", "algebra")),
    "components": ("Components", "Functions that make a component, or read and cut a mesh.",
                   ("components", "coupling.cutting", "modes.damping", "modes.rotation")),
    "reduction": ("Reduction", "Methods, and what they make of a component.", ("reduction",)),
    "coupling": ("Coupling and contact", "Joints that make a system of parts, belts, friction laws and contacts.",
                 ("coupling", "model.contact")),
    "modes": ("Modes", "Normal and complex modes, their cards and effective masses, receptances.", ("modes",)),
    "stability": ("Stability", "Critical slopes and values, sweeps, maps, derivatives, changes that help.", ("stability",)),
    "motion": ("Motion", "Time integration, limit cycles, branches and signals.", ("motion",)),
    "io": ("Files", "Matrices, meshes and components from and to files.", ("io",)),
    "studies": ("Studies", "Full against reduced models: error and run time; scene files.", ("studies", "app")),
    "errors": ("Errors and warnings", "All of them are a `FemsubError` or a `FemsubWarning`.", ("checks",)),
}

#: families of kinds: title and one line
FAMILIES = {
    "part": ("Parts", "`[part.NAME]`: what is reduced and joined. The key that names the kind has the file, or what is made."),
    "joint": ("Joints", "`[[joint]]` or `[joint.NAME]`: what connects parts, or holds them."),
    "contact": ("Contacts", "`[contact.NAME]` or `[[contact]]`: friction, and other forces that are not reduced."),
    "ask": ("Asks", "`[[ask]]`: what is computed, in the order of the file."),
}
#: tables that have one kind, and what heads them
HEADINGS = {"scene": "Above all tables", "material": "material", "parameter": "parameter", "reduce": "reduce"}

WIDE = "---\nhtml_theme.sidebar_secondary.remove: true\n---"  # a page of wide tables


def names_by_page() -> dict[str, list[str]]:
    """The public names of each page, functions first; the most particular module decides."""
    found: dict[str, list[str]] = {page: [] for page in NAMES}
    for name in fs.__all__:
        if name.startswith("__"):
            continue
        home = getattr(fs, name).__module__.removeprefix("femsub.")
        fits = {module: page for page, (*_, modules) in NAMES.items() for module in modules
                if f"{home}.".startswith(f"{module}.")}
        found[fits[max(fits, key=len)]].append(name)
    return {page: sorted(names, key=lambda name: (isinstance(getattr(fs, name), type), name.lower()))
            for page, names in found.items()}


def first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0].removesuffix(":")


def place(name: str) -> str:
    """Where the page of a public name stands in its folder. `branch` and `Branch` are one file where case is ignored."""
    return f"classes/{name}" if isinstance(getattr(fs, name), type) else name


def names_page(page: str, names: list[str]) -> str:
    """A table of the names, each of which has a page of its own."""
    title, line, _ = NAMES[page]
    rows = "\n".join(f"| [{name}]({place(name)}.md) | {cell(first_line(getattr(fs, name)))} |" for name in names)
    return f"# {title}\n\n{line}\n\n| name | what it is |\n|---|---|\n{rows}\n"


def name_page(name: str) -> str:
    """All that the docstring of a public name says, with its example."""
    thing = getattr(fs, name)
    kind = "function" if not isinstance(thing, type) else "exception" if issubclass(thing, BaseException) else "class"
    return f"# {name}\n\n```{{eval-rst}}\n.. currentmodule:: femsub\n.. auto{kind}:: {name}\n```\n"


def scene_page(scene: str) -> str:
    """What a built-in scene is, and its file."""
    text = text_of(scene)
    comments = list(takewhile(lambda line: line.startswith("#"), text.splitlines()))
    about = [" ".join(part.split()) for part in "\n".join(line.lstrip("#") for line in comments).split("\n\n")]
    file = "\n".join(text.splitlines()[len(comments):])
    return "\n\n".join([f"# {scene}", *about,
                        f"`femsub run {scene} --out DIR` runs it. `femsub new {scene} > my.toml` makes a file of your own. "
                        f"A file that begins with `scene = \"{scene}\"` has these keys, and its own in place of some.",
                        "## Its file", f"```toml\n{file}\n```"]) + "\n"


def family_page(family: str) -> str:
    """All kinds of a family, each with its keys."""
    kinds = Kinds()
    text = [WIDE, f"# {FAMILIES[family][0]}", FAMILIES[family][1], kind_table(family)]
    for name in kinds.names(family):
        text += [f"## {name}", *table_text(kinds.kind(family, name), name)]
    return "\n\n".join(text) + "\n"


def tables_page() -> str:
    """The tables that have one kind each."""
    text = [WIDE, "# Tables of one kind", "The keys above all tables, and `[material.NAME]`, `[parameter.NAME]` and `[reduce]`."]
    for name, kind in TABLES.items():
        text += [f"## {HEADINGS[name]}", *table_text(kind, name)]
    return "\n\n".join(text) + "\n"


def kind_table(family: str) -> str:
    kinds = Kinds()
    rows = "\n".join(f"| [{name}](#{name}) | {cell(first_line(kinds.kind(family, name)))} |" for name in kinds.names(family))
    return f"| kind | what it is |\n|---|---|\n{rows}"


def table_text(kind: type, name: str) -> Iterator[str]:
    """What a table of a scene file is, and all its keys, also those of the tables within it."""
    yield from (" ".join(part.split()) for part in inspect.cleandoc(kind.__doc__ or "").split("\n\n"))
    yield key_table(kind)
    yield from inner_tables(kind, f"{name}." if name in TABLES else "")


def inner_tables(kind: type, where: str) -> Iterator[str]:
    for name, one in keys_of(kind).items():
        for table in one.tables:
            heading = f"Keys of {where}{spelt(kind, name)}" + f", {first_line(table).rstrip('.')}" * (len(one.tables) > 1)
            yield f"### {heading}\n\n{key_table(table)}"
            yield from inner_tables(table, f"{where}{spelt(kind, name)}.")


def key_table(kind: type) -> str:
    rows = [[f"`{spelt(kind, name)}`", type_of(one, kind), default_of(one), one.meaning, one.unit]
            for name, one in keys_of(kind).items()]
    return "\n".join(["| key | type | default | meaning | unit |", "|---|---|---|---|---|",
                      *(f"| {' | '.join(map(cell, row))} |" for row in rows)])


def type_of(one: Key, owner: type) -> str:
    words = type_words(one.type).replace("a list of", f"`{one.form}`," if one.form else "a list of")
    words += f"; {one.bounds}" if one.bounds else ""
    return words + (": " + ", ".join(f"`{word}`" for word in one.choices(owner)) if one.choices else "")


def default_of(one: Key) -> str:
    if one.required:
        return "required"
    return one.otherwise or ("" if one.default in (None, "", [], {}) else f"`{toml(one.default)}`")


def cell(text: str) -> str:
    return text.replace("|", r"\|")


def family_table(folder: str = "") -> str:
    rows = "\n".join(f"| [{title}]({folder}kinds/{family}.md) | {line} |" for family, (title, line) in FAMILIES.items())
    return ("| page | contents |\n|---|---|\n"
            f"| [Tables of one kind]({folder}kinds/tables.md) | units, band, materials, parameters, reduction |\n{rows}\n")


def scene_table(folder: str = "") -> str:
    rows = "\n".join(f"| [{name}]({folder}{name}.md) | {line} |" for name, line in built_in().items())
    return f"| scene | what it does |\n|---|---|\n{rows}\n"


def pages() -> dict[str, str]:
    """All pages of the reference but its first, by their paths."""
    made: dict[str, str] = {}
    for page, names in names_by_page().items():
        made |= {f"{page}/index.md": names_page(page, names), **{f"{page}/{place(name)}.md": name_page(name) for name in names}}
    made |= {f"scenes/{scene}.md": scene_page(scene) for scene in built_in()}
    made |= {f"scenes/kinds/{family}.md": family_page(family) for family in FAMILIES}
    made["scenes/kinds/tables.md"] = tables_page()
    made["scenes/index.md"] = ("# Scene files\n\n[Scenes](../../guide/scenes.md) is the page to read first. These pages have "
                               f"every key of every table.\n\n{family_table()}\n## Built-in scenes\n\n{scene_table()}")
    return made


def write(folder: Path) -> None:
    """Writes the pages that have changed, so that only these are built anew, and removes those that are no more."""
    made = pages()
    for path in set(folder.rglob("*.md")) - {folder / name for name in (*made, "index.md")}:
        path.unlink()
    for name, text in made.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def notebook(page: str, name: str) -> Any:
    """The notebook of a tutorial: its ```python blocks are cells, without what they print and draw.

    Links lead to the site's pages. Pictures that no block draws are in the notebook itself.
    """
    import jupytext

    for block in reversed([one for one in blocks_of(page) if one.kind == "python"]):
        page = f"{page[:block.made_at[0]]}\n{page[block.made_at[1]:]}"
    page = re.sub(r"^<!--.*?-->\n", "", page)
    page = re.sub(r"^```sh\n(.*?)^```$", r"~~~sh\n\1~~~", page, flags=re.MULTILINE | re.DOTALL)  # no cell: it is not Python
    page = re.sub(r"^```math\n(.*?)^```$", r"$$\n\1$$", page, flags=re.MULTILINE | re.DOTALL)
    page = re.sub(r"\]\((?!\w+:)([\w./-]+)\.md(#[\w-]+)?\)", r"](\1.html\2)", page)
    where = (f"*The notebook of [this page]({name}.html). Files such as `meshes/...` are found if it lies in the folder of the "
             "clone, and Jupyter runs in the Python of femsub.*")
    made = jupytext.reads(page.replace("\n\n", f"\n\n{where}\n\n", 1), "md")
    made.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    for at, cell in enumerate(made.cells):
        cell.id, cell.metadata = f"{name}-{at}", {}  # the same each time
        shown = re.findall(r"\]\(\.\./pictures/([\w./-]+)\)", cell.source) if cell.cell_type == "markdown" else []
        for place in shown:
            cell.source = cell.source.replace(f"](../pictures/{place})", f"](attachment:{Path(place).name})")
            content = b64encode((PICTURES / place).read_bytes()).decode()
            cell.setdefault("attachments", {})[Path(place).name] = {"image/png": content}
    return made


def write_notebooks(tutorials: Path, folder: Path) -> None:
    """Writes the notebook of each page of a folder but its index."""
    import nbformat

    folder.mkdir(parents=True, exist_ok=True)
    for page in tutorials.glob("*.md"):
        if page.stem != "index":
            made = notebook(page.read_text(encoding="utf-8"), page.stem)
            nbformat.write(made, folder / f"{page.stem}.ipynb")
