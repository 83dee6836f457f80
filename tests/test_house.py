"""The house rules that a machine can check: layers, one importer of PETSc, cheap imports, short modules."""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "femsub"

LAYERS = {
    "errors": 0, "files": 0, "phases": 0, "heap": 0,
    "pencil": 1, "graph": 2, "memory": 3, "friction": 2, "_slepc": 2, "dofs": 2, "elements": 2, "meshes": 3,
    "factor": 3, "dense_modes": 3, "substructure": 3, "bending": 3, "textmatrices": 3,
    "blocks": 4, "fields": 4, "meshchecks": 4, "inpfiles": 4, "assembly": 4, "surfaces": 4, "matrixfiles": 4,
    "shift_invert": 4, "counting": 4, "chains": 4, "lanczos": 4, "contacts": 5,
    "integrators": 6, "second_order": 6, "transients": 7, "spectra": 8,
    "meshfiles": 5, "modelfiles": 5, "components": 6,
    "eigen": 5,
    "qep": 6, "dampers": 6, "estimates": 6, "splitting": 2, "condensed": 4,
    "nested": 7, "bases": 8, "pep": 7, "crossing": 7, "partition": 7,
    "beams": 8, "plates": 8, "solids": 8, "cea": 8, "border": 9, "refinement": 9, "stability": 10,
    "matching": 9, "studyresults": 1, "studies": 11, "quality": 12, "attractors": 2,
    "compliance": 8, "balance": 9, "floquet": 10, "starts": 10, "cycles": 11, "shooting": 12,
    "continuation": 12, "hopf": 13, "specials": 13, "branches": 14,
    "scene": 15, "figures": 16, "figures_modes": 17, "figures_cycles": 17, "figures_transient": 17,
    "report": 17, "scenes": 18, "cli": 19,
}


def modules() -> list[Path]:
    return [path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py"]


def layer_name(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> set[str]:
    """Modules of femsub that a file imports at run time (not under TYPE_CHECKING)."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {id(node) for test in ast.walk(tree) if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.dump(test.test)
               for child in test.body for node in ast.walk(child)}
    names = set()
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("femsub"):
            names.add(node.module or "")
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_down(path: Path) -> None:
    here = layer_name(path)
    assert here in LAYERS, f"{here} has no layer: add it to the table"
    for name in imported(path):
        if name.startswith("femsub."):
            other = name.split(".")[1]
            assert other == here or LAYERS[other] < LAYERS[here], f"{here} imports {other}, which is not below it"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_one_importer_of_petsc_and_one_of_matplotlib(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if path.name != "_slepc.py":
        assert "import petsc4py" not in text and "from petsc4py" not in text and "slepc4py" not in imported(path)
    if path.name not in ("figures.py", "figures_modes.py", "figures_cycles.py", "figures_transient.py"):
        assert "import matplotlib" not in text and "from matplotlib" not in text


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_modules_stay_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


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
    # a submodule of the same name would hide the function once it is imported
    assert not {path.stem for path in PACKAGE.glob("*.py")} & set(fs.__all__)
    with pytest.raises(AttributeError, match="no attribute 'missing'"):
        fs.missing  # noqa: B018
