"""Settings of the documentation's site, which `scripts/docs` builds: plain Markdown pages, and a reference made from the code.

Nothing is fetched: neither while it is built, nor when a page is read. The ```math blocks of pages become MathML, which a browser
draws without a script. Formulas in a text are Unicode, with the index of K_ii below the line.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.addnodes import desc_signature, pending_xref
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generate  # noqa: E402  of this folder

import femsub  # noqa: E402


def _repository() -> str:
    """The web address that this repository was cloned from, also by ssh; '' if there is none."""
    command = ["git", "-C", str(HERE), "config", "--get", "remote.origin.url"]
    address = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    found = re.fullmatch(r"(?:https?://|ssh://|)(?:\w+@)?([\w-]+(?:\.[\w-]+)+)[:/](?:\d+/)?(.+?)(?:\.git)?/?", address)
    return f"https://{found[1]}/{found[2]}" if found else ""


project = "femsub"
author = copyright = "The femsub developers"
release = version = femsub.__version__

#: where this clone comes from, if that is on the web
REPOSITORY = _repository()

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_design", "sphinx_copybutton"]
exclude_patterns = ["_build", "conf.py", "generate.py"]
nitpicky = True  # a name in a docstring that leads nowhere is a fault

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4  # as GitHub makes them
myst_fence_as_directive = ["math"]  # as git hosts write formulas
html_math_renderer = "mathml"
default_role = "code"
smartquotes = False  # --out is no dash
autodoc_typehints = "none"  # docstrings give types with their shapes and units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "pydata_sphinx_theme"
html_title = f"femsub {version}"
html_search_scorer = str(HERE / "_static" / "scorer.js")
html_static_path = ["_static"]
html_css_files = ["femsub.css"]
html_js_files = ["tables.js"]
html_sidebars = {page.stem: [] for page in HERE.glob("*.md")}  # beside pages without a folder there is nothing to list
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_end": ["theme-switcher", "navbar-icon-links"],
    "icon_links": [{"name": "Repository", "url": REPOSITORY, "icon": "fa-solid fa-code-branch"}] if REPOSITORY else [],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 7,
    "navigation_with_keys": False,
    "show_prev_next": True,
}
#: the first pages of all, and their names in the bar at the top; a folder stands for its index, or for its pages if it has none
FIRST = {"install": "Install", "tutorials": "Tutorials", "guide": "Guide", "methods": "Methods", "extend": "Extend",
         "gallery": "Gallery", "reference": "Reference", "how-sure": "How sure", "evidence": "Evidence", "performance": "Speed",
         "peers": "Peers", "benchmarks": "Benchmarks"}


def add_contents(app: Sphinx, document: str, text: list[str]) -> None:
    """Ends each index with a hidden list of contents: the pages in the order in which its text links to them, then the others.

    So the pages of a folder are plain Markdown, and a new one needs no entry anywhere.
    """
    folder, _, name = document.rpartition("/")
    if name != "index":
        return
    known = app.env.found_docs
    within = sorted(found[len(folder) + bool(folder):] for found in known if found.startswith(f"{folder}/") or not folder)
    pages = [found for found in within if found != "index" and _parent(found, within) == ""]
    if folder:
        linked = [found for found in re.findall(r"\]\(([\w./-]+)\.md\)", text[0]) if found in pages]
        entries = [*dict.fromkeys([*linked, *pages])]
    else:
        entries = [f"{name} <{page}>" if page in (part, f"{part}/index") else page for part, name in FIRST.items()
                   for page in pages if page == part or page.startswith(f"{part}/")]
        entries += [page for page in pages if page.partition("/")[0] not in FIRST]
    text[0] += "\n\n```{toctree}\n:hidden:\n\n" + "\n".join(entries) + "\n```\n"


def _parent(page: str, pages: list[str]) -> str:
    """The folder whose index lists a page: the nearest above that has one; '' is the uppermost."""
    folder = page.removesuffix("index").rstrip("/") if page.endswith("/index") else page
    while folder := folder.rpartition("/")[0]:
        if f"{folder}/index" in pages:
            return folder
    return ""


def link_reference(app: Sphinx, document: str, text: list[str]) -> None:
    """Links the reference's first page to those that are made from the code, which are not in the repository."""
    if document == "reference/index":
        for page, (title, *_) in generate.NAMES.items():
            text[0] = text[0].replace(f"| {title} |", f"| [{title}]({page}/index.md) |")
        text[0] += "\n" + generate.family_table("scenes/") + "\n## Built-in scenes\n\n" + generate.scene_table("scenes/")


def fill_in(app: Sphinx, document: str, text: list[str]) -> None:
    """The table of the gallery becomes pictures to choose from; the start page names the address to clone."""
    if document == "gallery/index":
        rows = re.compile(r"^\| \[([\w-]+)\]\(#\1\) \| (.*?) \| (.*?) \|\n", re.MULTILINE)
        cards = [f":::{{grid-item-card}} {name}\n:img-top: ../pictures/gallery/{name}.png\n:img-alt: \n:link: {name}-scene\n"
                 f":link-type: ref\n\n{line} ({seconds})\n:::\n" for name, line, seconds in rows.findall(text[0])]
        head = "| scene | what it does | run time |\n|---|---|---|\n"
        grid = f"::::{{grid}} 2 3 3 4\n:gutter: 2\n:class-container: thumbnails\n\n{''.join(cards)}::::\n"
        text[0] = rows.sub("", text[0]).replace(head, grid)
        text[0] = re.sub(r"^## ([\w-]+)$", r"(\1-scene)=\n## \1", text[0], flags=re.MULTILINE)
    elif document == "index" and REPOSITORY:
        text[0] = text[0].replace("git clone ADDRESS", f"git clone {REPOSITORY}")


def link_notebook(app: Sphinx, document: str, text: list[str]) -> None:
    """Each tutorial has a link to its notebook, which `notebooks` makes, below its title."""
    folder, _, name = document.rpartition("/")
    if folder == "tutorials" and name != "index" and app.builder.format == "html":
        link = f'<a class="notebook" href="{name}.ipynb" download>Open as a notebook</a>'
        text[0] = re.sub(r"^(# .*\n)", rf"\1\n{link}\n", text[0], count=1, flags=re.MULTILINE)


def notebooks(app: Sphinx, fault: Exception | None) -> None:
    """Makes the notebooks beside the pages of the tutorials."""
    if fault is None and app.builder.format == "html":
        generate.write_notebooks(HERE / "tutorials", Path(app.outdir) / "tutorials")


def outside(app: Sphinx, document: str, text: list[str]) -> None:
    """Links to pages in the folder above: the README is the first page here, and others are named without a link."""
    def replaced(found: re.Match[str]) -> str:
        words, target = found[1], (Path(app.env.doc2path(document)).parent / found[2]).resolve()
        if target.is_relative_to(HERE) or not target.exists():
            return found[0]
        if target.name == "README.md":
            return f"[{words}](/index.md)"
        return f"{words} (`{target.relative_to(HERE.parent)}`)"

    text[0] = re.sub(r"(?<!!)\[([^\]]*)\]\(((?:\.\./)+[^)#\s]+(?:\.md|/))\)", replaced, text[0])


def escape_bars(app: Sphinx, kind: str, name: str, thing: object, options: Any, lines: list[str]) -> None:
    """|λ| in a docstring is a modulus, and no substitution; what stands in examples and between backticks stays."""
    example = False
    for place, line in enumerate(lines):
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        if not example:
            parts = re.split(r"(`+[^`]*`+)", line)
            parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
            lines[place] = "".join(parts)


def link_names(app: Sphinx, tree: nodes.document) -> None:
    """A public name in a page, as `fs.chain` or `fs.chain(10)`, leads to its place in the reference; there, `chain` as well."""
    pattern = r"(?:fs\.)?(\w+)(?=\W|$)(?![.=])" if app.env.docname.startswith("reference/") else r"fs\.(\w+)"
    for code in list(tree.findall(nodes.literal)):
        found = re.match(pattern, code.astext())
        if found and found[1] in femsub.__all__ and not isinstance(code.parent, (nodes.reference, pending_xref)):
            link = pending_xref("", refdomain="py", reftype="obj", reftarget=f"femsub.{found[1]}", refdoc=app.env.docname,
                                refexplicit=True)
            code.replace_self(link)
            link += code


#: how far the second and the third part of a formula's element are lifted
SCRIPTS = {"msub": ("-0.25em",), "msup": ("0.4em",), "msubsup": ("-0.25em", "0.4em")}
#: a name of one letter with an index
INDEXED = re.compile(r"((?<![a-zA-Z0-9_.])[a-zA-Z]|[Α-ω])_([a-zA-Z0-9ψ]{1,2}(?![a-zA-Z0-9_])|\{[^{}]+\})")


def lower_indices(app: Sphinx, tree: nodes.document) -> None:
    """K_ii in a text has its index below the line; code and the names of parameters stay."""
    kept = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.term, nodes.raw, desc_signature)
    for text in list(tree.findall(nodes.Text)):
        above = text.parent
        while above is not None and not isinstance(above, kept):
            above = above.parent
        if above is None and len(parts := INDEXED.split(text.astext())) > 1:
            made: list[nodes.Node] = []
            for plain, letter, index in zip(parts[::3], [*parts[1::3], ""], [*parts[2::3], ""], strict=True):
                made += [nodes.Text(plain + letter), *([nodes.subscript("", index.strip("{}"))] if index else [])]
            text.parent.replace(text, made)


def put_formula(page: Any, node: nodes.Element) -> None:
    """A ```math block as MathML."""
    page.body.append(f'<div class="formula">{mathml(node.astext(), True)}</div>\n')
    raise nodes.SkipNode


def put_inline_formula(page: Any, node: nodes.Element) -> None:
    page.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def mathml(formula: str, block: bool = False) -> str:
    """A formula in LaTeX as MathML. Its indices and exponents are small and moved by hand: a browser without a font for formulas
    leaves indices on the line."""
    made = latex2mathml.tex2mathml(formula, as_block=block).replace("&ApplyFunction;", "\u2061")
    tree = ElementTree.fromstring(made.replace(' xmlns="http://www.w3.org/1998/Math/MathML"', ""))
    for node in list(tree.iter()):
        for at, lift in enumerate(SCRIPTS.get(node.tag, ()), 1):
            moved = ElementTree.Element("mpadded", voffset=lift)
            ElementTree.SubElement(moved, "mrow", style="font-size: 0.75em").append(node[at])
            node[at] = moved
        node.tag = "mrow" if node.tag in SCRIPTS else node.tag
    return ElementTree.tostring(tree, encoding="unicode", short_empty_elements=False)


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", lambda _: generate.write(HERE / "reference"), priority=100)
    app.connect("source-read", link_reference)
    app.connect("source-read", fill_in)
    app.connect("source-read", outside)
    app.connect("source-read", link_notebook)
    app.connect("build-finished", notebooks)
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-docstring", escape_bars, priority=900)  # after numpydoc
    app.connect("doctree-read", link_names)
    app.connect("doctree-read", lower_indices)
    app.add_html_math_renderer("mathml", (put_inline_formula, None), (put_formula, None))
    return {"parallel_read_safe": True}
