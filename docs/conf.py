"""Settings of the documentation's site, which `scripts/docs` builds: plain Markdown pages, and a reference made from the code.

Nothing is fetched: neither while it is built, nor when a page is read. Formulas are Unicode, so that no script must draw them.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generate  # noqa: E402  of this folder

import femsub  # noqa: E402

project = "femsub"
author = copyright = "The femsub developers"
release = version = femsub.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_design", "sphinx_copybutton"]
exclude_patterns = ["_build", "conf.py", "generate.py"]
nitpicky = True  # a name in a docstring that leads nowhere is a fault

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4  # as GitHub makes them
default_role = "code"
autodoc_typehints = "none"  # docstrings tell types with their shapes and units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "pydata_sphinx_theme"
html_title = "femsub"
html_static_path = ["_static"]
html_css_files = ["femsub.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 8,
    "navigation_with_keys": False,
    "show_prev_next": True,
}
#: the first pages of all, in the order of the bar at the top; a folder stands for its index, or for its pages where it has none
ORDER = ["install", "tutorials", "guide", "methods", "extend", "gallery", "reference", "evidence", "performance", "peers",
         "benchmarks"]


def add_contents(app: Sphinx, document: str, text: list[str]) -> None:
    """Ends each index with a hidden list of contents: the pages in the order in which its text links to them, then the others.

    So the pages of a folder are plain Markdown, and a new one needs no entry anywhere.
    """
    folder, _, name = document.rpartition("/")
    if name != "index":
        return
    known = sorted(app.env.found_docs)
    within = [found[len(folder) + bool(folder):] for found in known if found.startswith(f"{folder}/") or not folder]
    pages = [found for found in within if found != "index" and (
        "/" not in found or found.endswith("/index") or f"{folder}/{found.rpartition('/')[0]}/index".lstrip("/") not in known)]
    linked = ORDER if not folder else re.findall(r"\]\(([\w./-]+)\.md\)", text[0])
    ordered = [page for link in linked for page in pages if page == link or page.startswith(f"{link}/")]
    text[0] += "\n\n```{toctree}\n:hidden:\n\n" + "\n".join(dict.fromkeys([*ordered, *pages])) + "\n```\n"


def outside(app: Sphinx, document: str, text: list[str]) -> None:
    """Links to the folder above: the README is the first page here, and other files are named without a link."""
    def replaced(found: re.Match[str]) -> str:
        words, target = found[1], (Path(app.env.doc2path(document)).parent / found[2]).resolve()
        if target.is_relative_to(HERE) or not target.exists():
            return found[0]
        if target.name == "README.md":
            return f"[{words}](/index.md)"
        return f"{words} (`{target.relative_to(HERE.parent)}`)"

    text[0] = re.sub(r"(?<!!)\[([^\]]*)\]\(((?:\.\./)+[^)#\s]+)\)", replaced, text[0])


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


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", lambda _: generate.write(HERE / "reference"), priority=100)
    app.connect("source-read", outside)
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-docstring", escape_bars, priority=900)  # after numpydoc
    app.connect("doctree-read", link_names)
    return {"parallel_read_safe": True}
