"""The house rules that a machine can check: layers, one importer of PETSc, cheap imports."""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "femsub"

LAYERS = {
    "errors": -1, "checks": 0, "files": 0, "phases": 0, "heap": 0, "threads": 0, "evidence": 0,
    "pencil": 1, "studyresults": 1, "modelindex": 1,
    "graph": 2, "meshtext": 2, "bands": 2, "massless": 2,
    "friction": 3, "_slepc": 3, "dofs": 3, "elements": 3, "splitting": 3, "attractors": 3, "inpdecks": 3, "inpstore": 3,
    "gmshstore": 3, "multiplicity": 3,
    "memory": 4, "meshes": 4, "factor": 4, "dense_modes": 4, "substructure": 4, "bending": 4, "textmatrices": 4,
    "inpgenerate": 4,
    "blocks": 5, "fields": 5, "meshchecks": 5, "inpfiles": 5, "assembly": 5, "surfaces": 5, "shift_invert": 5, "chains": 5,
    "lanczos": 5, "condensed": 5, "nastranfiles": 5, "gmshfiles": 5, "foreignfiles": 5, "marketfiles": 5, "matlabfiles": 5,
    "op4files": 5,
    "matrixfiles": 6, "patches": 6, "contacts": 6, "meshfiles": 6, "eigen": 6, "doctor": 6, "singular_mass": 6,
    "estimates": 7, "counting": 7, "integrators": 7, "second_order": 7, "qep": 7, "dampers": 7,
    "modelfiles": 8, "transients": 8, "nested": 8, "pep": 8, "crossing": 8, "partition": 8, "contact_model": 8,
    "components": 9, "spectra": 9, "bases": 9, "beams": 9, "plates": 9, "solids": 9, "cea": 9, "compliance": 9,
    "bracketing": 9,
    "border": 10, "refinement": 10, "matching": 10, "balance": 10,
    "stability": 11, "floquet": 11, "starts": 11,
    "studies": 12, "cycles": 12,
    "quality": 13, "shooting": 13, "continuation": 13,
    "hopf": 14, "specials": 14,
    "branches": 15,
    "scene": 16,
    "figures": 17,
    "figures_modes": 18, "figures_cycles": 18, "figures_transient": 18, "report": 18,
    "scenes": 19,
    "cli": 20,
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
