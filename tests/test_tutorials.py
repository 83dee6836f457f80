"""The tutorials show the files and the pictures that they speak of; what their blocks print is in test_readme.py."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from benchmarks import tutorial_figures

ROOT = Path(__file__).parent.parent
TUTORIALS = ROOT / "docs" / "tutorials"


def test_the_page_on_a_disc_shows_the_geometry_of_its_mesh() -> None:
    text = (TUTORIALS / "disc.md").read_text(encoding="utf-8")
    shown = next(block for block in re.findall(r"```text\n(.*?)```", text, flags=re.DOTALL) if "Physical" in block)
    assert shown == (ROOT / "meshes" / "disc-with-pad.geo").read_text(encoding="utf-8")
    mesh = fs.read_mesh(ROOT / "meshes" / "disc-with-pad.msh")
    assert set(mesh.sets) == set(re.findall(r'Physical \w+\("(\w+)"\)', shown))
    radius = np.hypot(*mesh.points[:, :2].T)
    numbers = [float(word) for word in re.findall(r"0\.012, (\d\.\d+)}", shown)]  # of the two cylinders
    assert (radius.max(), radius.min()) == pytest.approx(numbers)


def test_the_beam_of_calculix_has_the_frequencies_that_calculix_prints() -> None:
    files = ROOT / "meshes" / "calculix" / "beam"
    beam = fs.read_component(f"{files}.mas", f"{files}.sti", dofs=f"{files}.dof")
    printed = re.search(r"CalculiX prints ([\d., and]+) Hz", (TUTORIALS / "matrices.md").read_text(encoding="utf-8"))
    assert printed is not None
    hertz = [float(word) for word in re.findall(r"\d+\.\d+", printed[1])]
    assert fs.normal_modes(beam, count=4).frequencies / 2 / np.pi == pytest.approx(hertz, abs=6e-4)


def test_each_picture_is_drawn_by_the_script_and_shown_on_a_page() -> None:
    stored = {path.stem for path in (ROOT / "docs" / "pictures" / "tutorials").glob("*.png")}
    assert stored == set(tutorial_figures.FIGURES)
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*/*.md"))
    assert stored == set(re.findall(r"pictures/tutorials/([\w-]+)\.png", pages))


def test_the_script_draws(tmp_path: Path) -> None:
    tutorial_figures.main(("matrices",), out=tmp_path / "new")
    assert [path.name for path in tmp_path.rglob("*.png")] == ["matrices.png"]
    assert (tmp_path / "new" / "matrices.png").read_bytes().startswith(b"\x89PNG")


def test_each_tutorial_begins_with_what_one_knows_at_its_end() -> None:
    pages = [page for page in TUTORIALS.glob("*.md") if page.stem != "index"]
    assert len(pages) >= 6
    for page in pages:
        text = page.read_text(encoding="utf-8")
        begin = text.split("\n## ")[0]
        assert "At the end you know:" in " ".join(begin.split()), page
        assert begin.count("\n- ") == 3, page
        assert "\n## What next\n" in text and "](../pictures/" in text, page
        assert 80 <= len(text.splitlines()) <= 160, page
