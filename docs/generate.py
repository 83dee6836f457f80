"""Writes the reference's pages from the code: public names by what they are for, and the keys of each scene."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import femsub as fs
from femsub.app.explain import toml
from femsub.app.keys import Key, defaults_of, keys_of, type_words
from femsub.app.scene import SCENES, scene_of

#: the pages of public names: title, one line, and the rooms or modules of femsub whose names stand there
NAMES = {
    "model": ("Models", "What all other functions take and give: matrices with an interface and ports.", ("model", "algebra")),
    "components": ("Components", "Functions that make a component, or read and cut a mesh.",
                   ("components", "coupling.cutting", "modes.damping", "modes.rotation")),
    "reduction": ("Reduction", "Methods, and what they make of a component.", ("reduction",)),
    "coupling": ("Coupling and contact", "Joints that make a system of parts, belts, friction laws and contacts.",
                 ("coupling", "model.contact")),
    "stability": ("Modes and stability", "Normal and complex modes, critical slopes and values, sweeps and maps.",
                  ("modes", "stability")),
    "motion": ("Motion", "Time integration, limit cycles, branches and signals.", ("motion",)),
    "io": ("Files", "Matrices, meshes and components from and to files.", ("io",)),
    "studies": ("Studies", "Full against reduced models: error and run time.", ("studies",)),
    "errors": ("Errors and warnings", "All of them are a `FemsubError` or a `FemsubWarning`.", ("errors",)),
}


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
    """What a scene is, and its keys in a table."""
    kind, line = scene_of(scene)[0], SCENES[scene][1]
    text = [" ".join(part.split()) for part in inspect.cleandoc(kind.__doc__ or "").split("\n\n")]
    return "\n\n".join([WIDE, f"# {scene}", f"{line[0].upper()}{line[1:]}.", *text,
                        f"`femsub new {scene} > my.toml` begins a file with these keys.",
                        "## Keys", key_table(kind, defaults_of(kind, scene)), *inner_tables(kind, "")]) + "\n"


def inner_tables(kind: type, where: str) -> Iterator[str]:
    for name, one in keys_of(kind).items():
        if (table := one.table) is not None:
            yield f"## Keys of {where}{name}\n\n{key_table(table, defaults_of(table))}"
            yield from inner_tables(table, f"{where}{name}.")


def key_table(kind: type, defaults: Mapping[str, Any]) -> str:
    rows = [[f"`{name}`", type_of(one, kind), default_of(one, defaults[name]), one.meaning, one.unit]
            for name, one in keys_of(kind).items()]
    return "\n".join(["| key | type | default | meaning | unit |", "|---|---|---|---|---|",
                      *(f"| {' | '.join(map(cell, row))} |" for row in rows)])


def type_of(one: Key, owner: type) -> str:
    words = type_words(one.type).replace("a list of", f"`{one.form}`," if one.form else "a list of")
    words += f"; {one.bounds}" if one.bounds else ""
    return words + (": " + ", ".join(f"`{word}`" for word in one.choices(owner)) if one.choices else "")


def default_of(one: Key, default: Any) -> str:
    if one.required:
        return "required"
    return one.otherwise or ("" if default in (None, "", []) else f"`{toml(default)}`")


def cell(text: str) -> str:
    return text.replace("|", r"\|")


def scene_table(folder: str = "") -> str:
    rows = "\n".join(f"| [{name}]({folder}{name}.md) | {line} |" for name, (_, line) in SCENES.items())
    return f"| scene | what it does |\n|---|---|\n{rows}\n"


def pages() -> dict[str, str]:
    """All pages of the reference but its first, by their paths."""
    made: dict[str, str] = {}
    for page, names in names_by_page().items():
        made |= {f"{page}/index.md": names_page(page, names), **{f"{page}/{place(name)}.md": name_page(name) for name in names}}
    made |= {f"scenes/{scene}.md": scene_page(scene) for scene in SCENES}
    made["scenes/index.md"] = f"# Keys of scenes\n\nEvery key of every scene file.\n\n{scene_table()}"
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
