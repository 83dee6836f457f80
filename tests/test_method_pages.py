"""The tables in docs/methods are what `benchmarks/method_pictures.py` measures, and every method has its page and picture."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import femsub as fs
from benchmarks import method_pictures
from femsub.reduction.reduce import METHODS

ROOT = Path(__file__).parent.parent
PAGES = ROOT / "docs" / "methods"
HEAD = re.compile(r"\| (k / k₀[^|]*|μ) \|(.+)\|\n\|[-|]+\|\n((?:\|.+\|\n)+)")
NOISE = 2e-10  # of ω: rounding in the full model
ROWS = ["0.01", "1", "10", "100", "1e4", "held"]


def words(row: str) -> list[str]:
    return [cell.strip().strip("`") for cell in row.strip().strip("|").split("|")]


def measured(head: str, column: str, row: str) -> float:
    """The error that belongs into a cell: of a method on springs, or of contact modes over μ."""
    if head == "μ":
        modes, plain = re.fullmatch(r"ContactModes\((\d+)(, friction=False)?\)", column).groups()  # type: ignore[union-attr]
        return float(method_pictures.flutter_error(int(modes), not plain, float(row)))
    method = eval(f"fs.{column}", {"fs": fs})
    ratio, count = float(row.replace("held", "inf")), 1 if "1 frequency" in head else 5
    if isinstance(method, fs.InterfaceModes):
        return float(method_pictures.error(fs.CraigBampton(6), ratio, count, method))
    return float(method_pictures.error(method, ratio, count))


def shown(value: float) -> str:
    """One digit, '3e-4'; rounding as '< 1e-9'."""
    if value < 1e-9:
        return "< 1e-9"
    return f"{value:.0e}".replace("e-0", "e-") if value < 1 else f"{value:.0f}"


TABLES = [(page.stem, *found) for page in sorted(PAGES.glob("*.md")) for found in HEAD.findall(page.read_text(encoding="utf-8"))]


@pytest.mark.sampled(12, 1)
@pytest.mark.filterwarnings("ignore::femsub.FemsubWarning")
@pytest.mark.parametrize(("page", "head", "columns", "rows"), TABLES, ids=[page for page, *_ in TABLES])
def test_tables_are_what_the_methods_do(page: str, head: str, columns: str, rows: str) -> None:
    names = words(columns)
    for row in rows.splitlines():
        label, *cells = words(row)
        for column, cell in zip(names, cells, strict=True):
            if cell == "-":
                continue
            found = measured(head, column, label)
            if cell.startswith("<"):
                assert found < float(cell[1:]), (page, column, label)
            else:
                unit = 10.0 ** int(f"{float(cell):e}".split("e")[1])
                assert abs(found - float(cell)) <= 0.505 * unit + NOISE, (page, column, label, found)


def test_every_method_has_its_page_and_its_picture() -> None:
    told = {page.stem: page.read_text(encoding="utf-8") for page in PAGES.glob("*.md")}
    pages = method_pictures.FIGURES
    assert {page for page, *_ in TABLES} == {"index", *pages}
    for page in pages:
        assert f"../pictures/methods/{page}.png" in told[page] and f"({page}.md)" in told["index"]
        assert "## Source" in told[page] and 40 <= len(told[page].splitlines()) <= 90
    for key in METHODS:
        assert f"`{key}`" in told["index"]


@pytest.mark.slow
def test_the_pictures_are_drawn_from_the_bases(tmp_path: Path) -> None:
    method_pictures.main(out=tmp_path)
    assert {file.name for file in tmp_path.glob("*.png")} == {file.name for file in (ROOT / "docs/pictures/methods").iterdir()}
    assert all(5_000 < file.stat().st_size < 150_000 for file in tmp_path.glob("*.png"))
