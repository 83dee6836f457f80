"""Docstrings and messages as a reader meets them: every public name has an example that runs, and no sentence is long."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import femsub as fs

PACKAGE = Path(__file__).parent.parent / "femsub"
LONGEST = 36  # words of two letters or more in a sentence, or in a part of it up to a colon or semicolon
#: names without an example: the version, and errors and warnings, which nobody calls
WITHOUT = {name for name in fs.__all__ if name.startswith("__") or (
    isinstance(getattr(fs, name), type) and issubclass(getattr(fs, name), (Exception, Warning)))}


def failures(name: str, text: str) -> str:
    """What doctest says about the examples in a text; nothing if all print what they should."""
    told: list[str] = []
    examples = doctest.DocTestParser().get_doctest(text, {"fs": fs, "np": np}, name, None, None)
    with np.printoptions(legacy=False):  # pyyeti, which other tests import, sets that of NumPy 1.13
        doctest.DocTestRunner().run(examples, out=told.append)
    return "".join(told)


@pytest.mark.parametrize("name", sorted(set(fs.__all__) - WITHOUT))
def test_every_public_name_has_an_example_that_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # examples may write files
    text = inspect.getdoc(getattr(fs, name)) or ""
    assert re.search(r"^Examples\n--------\n(.*\n)*?>>> ", text, re.MULTILINE)
    assert not failures(name, text)


def test_an_example_that_prints_something_else_is_seen() -> None:
    assert "Expected:" in failures("x", ">>> 1 + 1\n3\n") and not failures("x", ">>> 1 + 1\n2\n")


def test_every_docstring_begins_with_a_plain_line() -> None:
    begins = {name: (inspect.getdoc(getattr(fs, name)) or "").split("\n") for name in set(fs.__all__) - {"__version__"}}
    assert not {name: first for name, (first, *rest) in begins.items()
                if not re.match(r"[A-Z][\w/'-]* [\w(]", first) or not first.endswith((".", ":")) or (rest and rest[0])}


def called(call: ast.Call) -> str:
    """The last name of what is called."""
    return str(getattr(call.func, "attr", getattr(call.func, "id", "")))


def messages(tree: ast.Module) -> Iterator[str]:
    """The texts of errors and warnings; a dot stands for each value in them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) or (isinstance(node, ast.Call) and called(node).endswith(("warn", "Error"))):
            for text in ast.walk(node):
                if isinstance(text, ast.JoinedStr):
                    yield "".join(str(part.value) if isinstance(part, ast.Constant) else "·" for part in text.values)
                elif isinstance(text, ast.Constant) and isinstance(text.value, str):
                    yield text.value


def docstrings(tree: ast.Module) -> Iterator[str]:
    """Their paragraphs: without tables, headings, references and examples."""
    nodes: list[ast.AST] = [tree]
    for node in nodes:  # it grows; definitions stand in statements alone, and expressions are most of a tree
        nodes += [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
            text = re.sub(r"^=+ +=[= ]*\n(.*\n)*?=+ +=[= ]*$", "", text, flags=re.MULTILINE)  # tables
            text = re.sub(r"^(References|Examples)\n-+\n(.*\n?)*?(?=^\w+\n-+$|\Z)", "", text, flags=re.MULTILINE)
            yield from re.split(r"\n\s*\n|\n-+\n|\n\s*(?=- |\d+\. )", text)


def long_sentences(text: str) -> list[str]:
    parts = (" ".join(part.split()) for part in re.split(r"(?<=[.:;?!])\s", text))
    return [part for part in parts if len(part) > 3 * LONGEST and len(re.findall(r"[^\W\d_][\w'-]+", part)) > LONGEST]


def test_no_sentence_is_long() -> None:
    # one tree after the other: all at once, half a million nodes, keep the garbage collector busy
    assert not [(str(path.relative_to(PACKAGE)), part) for path in sorted(PACKAGE.rglob("*.py"))
                for tree in [ast.parse(path.read_text(encoding="utf-8"))] for text in (*messages(tree), *docstrings(tree))
                for part in long_sentences(text)]


def test_a_long_sentence_is_seen() -> None:
    text = "word " * LONGEST
    assert not long_sentences(f"{text}; {text}.") and long_sentences(f"{text} and more.")
    tree = ast.parse(f'def f():\n    """Short.\n\n    {text} end.\n    """\n    raise ValueError(f"{{x}} {text} end")')
    assert all(map(long_sentences, messages(tree)))
    assert [bool(long_sentences(part)) for part in docstrings(tree)] == [False, True]
