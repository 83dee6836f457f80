"""The house rules that a machine can check: rooms in the order of the method, one importer of PETSc, cheap imports."""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "femsub"

#: The vocabulary, then the rooms in the order of the method. Rooms of one line do not know each other.
ORDER = (("errors", "checks", "timing"), ("model",), ("linalg",), ("modes",), ("quadratic",),
         ("components", "reduction", "stability"), ("io", "motion"), ("studies",), ("app",))
LEVEL = {room: level for level, rooms in enumerate(ORDER) for room in rooms}
ACROSS = 270  # imports from one room into another, vocabulary apart: it may only fall
DRAWERS = ("figures.py", "figures_modes.py", "figures_cycles.py", "figures_transient.py")  # import matplotlib


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path != PACKAGE / "__init__.py"]


def room(module: str) -> str:
    """'modes' of 'femsub.modes.normal_modes'."""
    return module.split(".")[1]


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> set[str]:
    """Modules of femsub that a file imports at run time (not under TYPE_CHECKING), in any spelling of an import."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {id(node) for test in ast.walk(tree) if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.dump(test.test)
               for child in test.body for node in ast.walk(child)}
    package = name_of(path).split(".")
    package = package if path.name == "__init__.py" else package[:-1]
    names = set()
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.ImportFrom):
            base = ".".join([*package[:len(package) - node.level + 1], *([node.module] if node.module else [])]) if node.level \
                else node.module or ""
            for alias in node.names:  # a name may be a module
                whole = f"{base}.{alias.name}".replace(".", "/")
                inside = (PACKAGE.parent / f"{whole}.py").exists() or (PACKAGE.parent / whole).is_dir()
                names.add(f"{base}.{alias.name}" if inside else base)
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name for name in names if name.startswith("femsub.")}


def external(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {(alias.name if isinstance(node, ast.Import) else node.module or "").split(".")[0]
            for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom)) for alias in node.names}


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_to_rooms_before(path: Path) -> None:
    here = room(name_of(path))
    for name in imported(path):
        other = room(name)
        assert other == here or LEVEL[other] < LEVEL[here] or (LEVEL[here] == 0 and LEVEL[other] == 0), \
            f"{here} imports {name}: that room does not come before it"


def test_imports_across_rooms_are_few() -> None:
    pairs = Counter((room(name_of(path)), room(name)) for path in modules() for name in imported(path)
                    if room(name) != room(name_of(path)) and LEVEL[room(name)] > 0)
    print(f"{sum(pairs.values())} imports across rooms:", *(f"{here} → {there} {count}" for (here, there), count in
                                                             sorted(pairs.items())), sep="\n  ")
    assert sum(pairs.values()) <= ACROSS


def test_the_rooms_are_few_and_each_says_what_it_is() -> None:
    inside = {path.name.removesuffix(".py") for path in PACKAGE.iterdir() if path.name not in ("__init__.py", "__pycache__")}
    assert inside == set(LEVEL) and len(inside) <= 15
    for path in PACKAGE.rglob("__init__.py"):
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), f"{path} has no docstring"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_one_importer_of_petsc_and_one_of_matplotlib(path: Path) -> None:
    if path != PACKAGE / "linalg" / "petsc.py":
        assert not external(path) & {"petsc4py", "slepc4py"}
    if path.name not in DRAWERS:
        assert "matplotlib" not in external(path)


def seconds(code: str) -> float:
    runs = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        runs.append(time.perf_counter() - start)
    return min(runs)


def test_import_is_cheap() -> None:
    assert seconds("import femsub") < 1.5 * seconds("import numpy, scipy.sparse")


def test_every_name_of_the_front_door_exists() -> None:
    import femsub as fs

    for name in fs.__all__:
        assert getattr(fs, name) is not None
    # a room of the same name would hide the function once it is imported
    assert not {path.stem for path in PACKAGE.iterdir()} & set(fs.__all__)
    with pytest.raises(AttributeError, match="no attribute 'missing'"):
        fs.missing  # noqa: B018
