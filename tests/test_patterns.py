"""No regular expression of femsub takes more than linear time: each is attacked by what its own repeats take, pumped."""

from __future__ import annotations

import ast
import importlib
import itertools
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from re import _constants as sre, _parser as parser  # type: ignore[attr-defined]  # the parsed form of a pattern
from types import SimpleNamespace
from typing import Any

import pytest

import femsub
import femsub as fs

ROOT = Path(femsub.__file__).parent
FUNCTIONS = ("compile", "match", "search", "split", "sub", "subn", "fullmatch", "findall", "finditer")
#: what local names in patterns may hold
LOCALS = {"family": "C3D|DC3D", "layout": "coordinate", "name": b"NumberOfPoints", "self": SimpleNamespace(section="Nodes")}
PASSED_ON = {"femsub/io/mesh_text.py: pattern"}  # of `Deck.whole`, whose callers' patterns are collected
SHORT, LONG, FLOOR = 2048, 8192, 0.02  # linear time at LONG is far below FLOOR, quadratic time far above
KINDS = {sre.CATEGORY_DIGIT: "1", sre.CATEGORY_SPACE: " \t\n", sre.CATEGORY_WORD: "a1", sre.CATEGORY_NOT_SPACE: "a1,",
         sre.CATEGORY_NOT_DIGIT: "a ", sre.CATEGORY_NOT_WORD: " ,"}
ANY = "a 1,.\t%'\"\n"


def collected() -> tuple[dict[tuple[str | bytes, int, str], str], set[str]]:
    """Every pattern of femsub with its flags and how it is used, and where it is; and what cannot be evaluated."""
    found, unknown = dict[tuple[str | bytes, int, str], str](), set[str]()
    for path in sorted(ROOT.rglob("*.py")):
        where = str(path.relative_to(ROOT.parent))
        if not re.search(r"\bre\.\w|\.whole\(", text := path.read_text()):
            continue
        tree, module = ast.parse(text), None
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute) or not node.args:
                continue
            of_re = isinstance(node.func.value, ast.Name) and node.func.value.id == "re" and node.func.attr in FUNCTIONS
            if not of_re and (node.func.attr != "whole" or not where.startswith("femsub/io")):
                continue
            module = module or importlib.import_module(where.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
            flags = next((word.value for word in node.keywords if word.arg == "flags"),
                         node.args[-1] if of_re and re.search(r"\bre\.[A-Z]", ast.unparse(node.args[-1])) else ast.Constant(0))
            try:
                pattern, flag = (eval(ast.unparse(part), vars(module) | {"re": re}, LOCALS) for part in (node.args[0], flags))
            except NameError:
                unknown.add(f"{where}: {ast.unparse(node.args[0])}")
                continue
            if isinstance(pattern, (str, bytes)):
                for how in used(tree, node) if of_re else ("split",):
                    found[pattern, int(flag) | (0 if of_re else re.MULTILINE | re.IGNORECASE), how] = f"{where}:{node.lineno}"
    return found, unknown


def used(tree: ast.AST, call: ast.Call) -> set[str]:
    """How a pattern is used: the function itself, or the methods of what `compile` gave."""
    name = call.func.attr  # type: ignore[attr-defined]
    if name != "compile":
        return {name}
    text = ast.unparse(call)
    bound = next((one.targets[0].id for one in ast.walk(tree) if isinstance(one, ast.Assign) and ast.unparse(one.value) == text
                  and isinstance(one.targets[0], ast.Name)), None)
    return {one.attr for one in ast.walk(tree) if isinstance(one, ast.Attribute) and one.attr in FUNCTIONS
            and ast.unparse(one.value) in (bound, text)} or {"search"}


def taken(node: Any) -> list[str]:
    """A few texts that a parsed pattern takes."""
    what, given = node
    if what is sre.LITERAL:
        return [chr(given)]
    if what is sre.ANY:
        return list(ANY.replace("\n", ""))
    if what is sre.NOT_LITERAL:
        return [sign for sign in ANY if sign != chr(given)]
    if what is sre.IN:
        signs = dict.fromkeys(sign for one in given for sign in member(one))
        return [sign for sign in dict.fromkeys(ANY + "bx") if sign not in signs] if given[0][0] is sre.NEGATE else list(signs)
    if what is sre.BRANCH:
        return [text for one in given[1] for text in sequence(one)][:8]
    if what is sre.SUBPATTERN:
        return sequence(given[3])
    if what is sre.ATOMIC_GROUP:
        return sequence(given)
    if what in (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT):
        times, texts = max(1, min(given[0], 30)), sequence(given[2])
        return [text * times for text in texts[:6]] + [""] * (given[0] == 0)
    return [""]  # a place, or what is ahead or behind


def member(one: Any) -> str:
    what, given = one
    if what is sre.LITERAL:
        return chr(given)
    if what is sre.RANGE:
        return chr(given[0]) + chr(given[1])
    return KINDS.get(given, "a") if what is sre.CATEGORY else ""


def sequence(nodes: Any) -> list[str]:
    """The first text of each part but one, for each text of that one."""
    parts = [taken(node) or [""] for node in nodes]
    first = [part[0] for part in parts]
    found = ["".join(first)]
    for at, part in enumerate(parts):
        found += ["".join([*first[:at], text, *first[at + 1:]]) for text in part[1:]]
    return list(dict.fromkeys(found))[:12]


def repeats(nodes: Any, before: str = "") -> Iterator[tuple[str, list[str]]]:
    """What stands before each repeat, and what it takes."""
    for node in nodes:
        what, given = node
        if what in (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT):
            if given[1] == sre.MAXREPEAT:
                yield before, sequence(given[2])
            yield from repeats(given[2], before)
        elif what is sre.BRANCH:
            for one in given[1]:
                yield from repeats(one, before)
        elif what in (sre.SUBPATTERN, sre.ASSERT, sre.ASSERT_NOT, sre.ATOMIC_GROUP):
            yield from repeats(given[3] if what is sre.SUBPATTERN else given if what is sre.ATOMIC_GROUP else given[1], before)
        before += (taken(node) or [""])[0]


def attacks(pattern: str | bytes, flags: int) -> list[tuple[str, str, str]]:
    """(prefix, unit, suffix) of texts that are long for one of the pattern's repeats, and then fail."""
    tree, whole = parser.parse(pattern, flags), list[tuple[str, str, str]]()
    for before, units in repeats(tree):
        signs = [unit for unit in units if unit]
        pairs = [a + b for a, b in itertools.permutations(signs[:4], 2)]
        longer = [*(before[-1:] + sign for sign in signs[:4]), before, before + "".join(signs[:1])]
        for unit in filter(None, dict.fromkeys([*signs, *pairs, *longer])):
            whole += [(start, unit, end) for start in dict.fromkeys([before, ""]) for end in ("", "\x01", "\n!")]
    whole += [("", text, "\x01") for text in sequence(tree) if text]
    return list(dict.fromkeys(whole))


class _Slow(BaseException):
    pass


def cpu(act: Callable[[Any], object], text: Any, limit: float = 10 * FLOOR) -> float:
    """Seconds of this thread; infinite if it takes longer than the limit."""
    def stop(*_: object) -> None:
        raise _Slow

    before, start = signal.signal(signal.SIGVTALRM, stop), time.thread_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        act(text)
        return time.thread_time() - start
    except _Slow:
        return float("inf")
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def slow(pattern: str | bytes, flags: int, how: str) -> str:
    """The text for which the time grows faster than its length, or ''."""
    compiled = re.compile(pattern, flags)
    act: Callable[[Any], object] = getattr(compiled, how) if how in ("match", "fullmatch", "search") else (
        lambda text: sum(1 for _ in compiled.finditer(text)))

    for prefix, unit, suffix in attacks(pattern, flags):
        def text(length: int, parts: tuple[str, str, str] = (prefix, unit, suffix)) -> str | bytes:
            whole = parts[0] + parts[1] * (length // len(parts[1])) + parts[2]
            return whole.encode("latin-1", "replace") if isinstance(pattern, bytes) else whole

        for length in (32, 64, SHORT // 4, SHORT, LONG):
            if (long := cpu(act, text(length))) > FLOOR:  # a second time, since something else may have taken it
                endless = long == float("inf") and cpu(act, text(length)) == float("inf")
                long, short = (0.0, 0.0) if endless else (min(cpu(act, text(size)) for _ in range(3))
                                                          for size in (length, length // 4))
                if endless or (long > FLOOR and long > 8 * short):
                    return f"{prefix!r} + {length // len(unit)} * {unit!r} + {suffix!r}"
    return ""


PATTERNS, UNKNOWN = collected()


def test_every_pattern_is_found() -> None:
    assert UNKNOWN <= PASSED_ON
    assert len(PATTERNS) > 80


def test_only_single_signs_are_possessive() -> None:
    """Python before 3.11.5 matches wrongly where a possessive group gives something back inside (python/cpython#106052)."""
    def checked(nodes: Any) -> None:
        for what, given in nodes:
            assert what is not sre.ATOMIC_GROUP
            if what is sre.POSSESSIVE_REPEAT:
                assert len(given[2]) == 1 and given[2][0][0] in (sre.LITERAL, sre.NOT_LITERAL, sre.IN, sre.ANY)
            elif what in (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.SUBPATTERN):
                checked(given[-1])
            elif what is sre.BRANCH:
                [checked(one) for one in given[1]]

    for pattern, flags, _ in PATTERNS:
        checked(parser.parse(pattern, flags))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("pattern", [
    rb"\s*(?:%[^\n]*\s+)*x", r",[, \t]*(?=\n|\Z)", r"(\d+\.?\d*|\.\d+)+x", r"""INCLUDE[ \t]*('[^']*'?|[^\n$]*)[^\n]*\n?x""",
    rb"<Data\b([^>]*)>"])
def test_the_attack_finds_patterns_that_grow(pattern: str | bytes) -> None:
    assert slow(pattern, 0, "search")


@pytest.mark.parametrize(("pattern", "flags", "how"), PATTERNS, ids=PATTERNS.values())
def test_no_pattern_takes_more_than_linear_time(pattern: str | bytes, flags: int, how: str) -> None:
    assert not slow(pattern, flags, how)


HEXAHEDRON = """*NODE
1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1
*ELEMENT, TYPE=C3D8
1,1,2,3,4,5,6,7,8"""
VTK = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1 double\n"
#: name of a file, and its text of about so many bytes
TEXTS: dict[str, tuple[str, Callable[[int], str]]] = {
    "comments of a map": ("a_gid.m", lambda n: "function x = gid()\n" + "% " * n + "\n"),
    "values of Sierra": ("a_Kaa.m", lambda n: "function a=Kaa()\nNumRows = 1;\na=[\n1 1 1" + "1" * n),
    "lines of Sierra": ("a_Kaa.m", lambda n: "function a=Kaa()\nNumRows = 1;\na=[\n" + "1 1 11.11;\n" * (n // 10)),
    "free DMIG": ("a.pch", lambda n: "DMIG,K,0,6,1,0\nDMIG,K,1,1,,1,1," + "1" * n + "x\n"),
    "points in a list": ("a.pch", lambda n: "DMIG,K,0,6,1,0\nBSET1,1" + ",1\n*" * n + "\n"),
    "DataArray": ("a.vtu", lambda n: "<VTKFile>" + "<DataArray " * (n // 10)),
    "commas": ("a.inp", lambda n: HEXAHEDRON + "," * n + "x\n"),
    "lines of options": ("a.inp", lambda n: HEXAHEDRON.replace("*NODE", "*NODE" + ",\nA=1" * n) + "x\n"),
    "blanks in INCLUDE": ("a.bdf", lambda n: "INCLUDE '" + " " * n + "x\n"),
    "repeats of a format": ("a.cdb", lambda n: f"NBLOCK,6,SOLID,1,1\n({'9' * n}i9,6e20.13)\n        1\n"),
    "widths of a format": ("a.cdb", lambda n: f"NBLOCK,6,SOLID,1,1\n(3i{'9' * n},6e20.13)\n        1\n"),
    "digits of a format": ("a.cdb", lambda n: f"NBLOCK,6,SOLID,1,1\n({'9' * n})\n        1\n"),
    "count of a block": ("a.cdb", lambda n: f"NBLOCK,6,SOLID,1,{'9' * n}\n(3i9,6e20.13)\n        1        0        0\n-1\n"),
    "digits of VTK": ("a.vtk", lambda n: VTK + "1" * n + "x\n"),
    "words of VTK": ("a.vtk", lambda n: VTK + "SCALARS" + " 1a" * n + "\n"),
    "count of VTK": ("a.vtk", lambda n: VTK.replace(" 1 ", f" {'1' * n} ")),
    "empty lines before Fluent": ("a.msh", lambda n: "(" + "\n" * n),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_reader_takes_no_more_than_linear_time(name: str, tmp_path: Path) -> None:
    """And it refuses the file in words, whatever number of digits it has."""
    file, text = TEXTS[name]
    path = tmp_path / file
    if file.endswith("gid.m"):
        (tmp_path / "a_Kaa.m").write_text(
            "function a=Kaa()\nNumRows = 1;\na=[\n1 1 1;\n];\na=sparse(a(:,1),a(:,2),a(:,3),1,1);\n"
            "disp('This Matrix is in a Symmetric Sparse Format (Lower Triangular)')\n")
        (tmp_path / "a_ASetMap.m").write_text("function x = ASetMap()\nx = zeros(9,1);\nx(1) = 1;\n")

    def read(given: str) -> None:
        path.write_text(given)
        with pytest.raises(fs.FemsubError):
            fs.read_matrix(tmp_path / "a_Kaa.m" if file.endswith("gid.m") else path) if file.endswith((".m", ".pch")) else (
                fs.read_mesh(path))

    read(text(8))  # imports what it needs
    short, long = (cpu(read, text(size), limit=15.0) for size in (5_000, 20_000))
    assert long < 1.0 or (long < float("inf") and long < 8 * short)
