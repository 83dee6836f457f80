"""The tutorials show the files and the pictures that they speak of; what their blocks print is in test_readme.py."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from benchmarks.pages import BLOCK, blocks_of

ROOT = Path(__file__).parent.parent
TUTORIALS = ROOT / "docs" / "tutorials"
PAGES = [page for page in sorted(TUTORIALS.glob("*.md")) if page.stem != "index"]


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


def test_each_picture_of_a_tutorial_is_drawn_by_its_page_which_else_says_how() -> None:
    drawn: list[str] = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        own = [block.picture for block in blocks_of(text) if block.picture]
        shown = re.findall(r"!\[[^\]]+\]\(\.\./pictures/([^)]+)\)", text)
        assert own, f"{page.name} draws no figure"
        assert own == [place for place in shown if place.startswith("tutorials/")], page
        for place in set(shown) - set(own):  # of a scene or of a benchmark, which other pages show as well
            name = Path(place).stem
            assert re.search(rf"`(femsub run {name}|python -m benchmarks\s{name}) ", text) or \
                re.search(rf"`femsub run {name.partition('-')[0]} ", text), f"{page.name} does not say how {place} is drawn"
        drawn += own
    assert sorted(drawn) == sorted(f"tutorials/{path.name}" for path in (ROOT / "docs" / "pictures" / "tutorials").glob("*.png"))


def test_the_brake_engineer_s_hour_fits_in_80_lines_and_each_step_has_a_figure() -> None:
    text = (TUTORIALS / "your-brake.md").read_text(encoding="utf-8")
    blocks = blocks_of(text)
    assert sum(bool(line.strip()) for block in blocks for line in block.text.splitlines()) <= 80
    assert all(block.picture for block in blocks[1:]) and len(blocks) >= 8  # the first one reads the meshes
    for name in ("disc", "pad"):  # the meshes of the page, whose places the page names
        mesh, geo = ROOT / "meshes" / f"brake-{name}.msh", (ROOT / "meshes" / f"brake-{name}.geo").read_text(encoding="utf-8")
        assert mesh.stat().st_size < 400e3
        assert set(fs.read_mesh(mesh).sets) == set(re.findall(r'Physical \w+\("(\w+)"\)', geo))
    shown = re.findall(r"^Physical .*$", text, re.MULTILINE)
    assert shown and all(line in (ROOT / "meshes" / "brake-disc.geo").read_text(encoding="utf-8") for line in shown)


def test_each_tutorial_begins_with_what_one_knows_at_its_end() -> None:
    assert len(PAGES) >= 6
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        begin = text.split("\n## ")[0]
        assert "At the end you know:" in " ".join(begin.split()), page
        assert begin.count("\n- ") == 3, page
        assert "\n## What next\n" in text and "](../pictures/" in text, page
        own = BLOCK.sub(lambda block: "" if block[1] == "text" else block[0], text)  # without what its blocks print
        assert 80 <= len(own.splitlines()) <= 160, page
