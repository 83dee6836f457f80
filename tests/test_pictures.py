"""The pictures of the docs show what a run of today shows, and say of which commit they are."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import users_picture as users
from benchmarks.extreme import CASES
from benchmarks.pictures import FACTOR, differences, lines, plain, shown
from femsub.app.cli import main
from femsub.app.grammar import built_in

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
DATA = json.loads((PICTURES / "data.json").read_text(encoding="utf-8"))
RUNS = json.loads((ROOT / "docs" / "gallery" / "runs.json").read_text(encoding="utf-8"))


def test_every_picture_has_its_commit_and_its_numbers() -> None:
    drawn = {path.relative_to(PICTURES).as_posix() for path in PICTURES.rglob("*.png")}
    assert drawn == {*DATA, *(f"gallery/{name}.png" for name in RUNS)}
    assert list(RUNS) == list(built_in())
    for name, one in {**DATA, **RUNS}.items():
        assert re.fullmatch(r"[0-9a-f]{7,40}", one["commit"]), (name, one["commit"])  # none that was changed
        assert one["shows"], name


def today(folder: Path, scene: str, keys: str) -> list[dict[str, Any]]:
    """What the figure of error against run time would show."""
    (folder / "scene.toml").write_text(f'scene = "{scene}"\nfigures = false\n{keys}', encoding="utf-8")
    assert main(["run", str(folder / "scene.toml"), "--quiet", "--out", str(folder / "out")]) == 0
    return shown(json.loads((folder / "out" / "results.json").read_text(encoding="utf-8")), "compare")


COMPARED = "reduce.repeats = 1\n[[ask]]\ncompare = ['growth', 'critical']\n"


@pytest.mark.parametrize(("scene", "keys"), [
    ("chain", "reduce.repeats = 1\n[[ask]]\ncompare = ['growth', 'critical']\n"
     "vary = {'part.chain.interface' = [[1], [1, 'belt']], 'reduce.sizes' = [[4, 5, 9]]}\n"),
    ("beam", f"reduce.modes = [8, 20]\n{COMPARED}"),
    pytest.param("plate", f"reduce.modes = [8, 20]\n{COMPARED}", marks=pytest.mark.slow),
    pytest.param("solid", f"reduce.modes = [10, 40]\n{COMPARED}", marks=pytest.mark.slow),
    # one value of mu, and a narrow range about the loss: a third of the time of three values and a wide range, the same errors
    pytest.param("brake", "reduce.methods = [['craig-bampton', 'contact-modes'], 'contact-modes']\nreduce.modes = [60]\n[[ask]]\n"
                 "compare = ['growth', 'critical']\nparameter = 'mu'\nvalues = [0.6]\nbetween = [0.217, 0.226]\n",
                 marks=pytest.mark.rare)])
def test_a_picture_shows_the_errors_of_today(scene: str, keys: str, tmp_path: Path) -> None:
    """Over the size: seconds are those of one machine."""
    found = today(tmp_path, scene, keys)
    assert sum(len(row["DOF"]) for row in found) >= 4
    drawn = "chain-error-time" if scene == "chain" else f"{scene}-compare"
    assert not differences(DATA[f"{drawn}.png"]["shows"], found)


def test_a_picture_older_than_the_code_is_noticed() -> None:
    """The README once showed 0.85 for Craig-Bampton with 20 DOF of the disc, where a run gave 6.5e-2."""
    row = {"panel": "growth rates Re λ", "model": "Craig-Bampton", "DOF": [20, 30], "error": [6.5e-2, 2.9e-3]}
    old = row | {"error": [0.85, 6.1e-2]}
    assert len(differences([old], [row])) == 2 and "20 DOF: 8.5e-01 is drawn, 6.5e-02 found" in differences([old], [row])[0]
    assert not differences([row], [row | {"error": [6.5e-2 * 0.99 * FACTOR, 2.9e-3 * 1.01 / FACTOR]}])
    assert not differences([row | {"error": [1e-16, 1e-9]}], [row | {"error": [1e-9, 1e-13]}])  # rounding
    assert differences([row | {"DOF": [20, 31]}], [row])  # a model that the picture lacks
    assert differences([row | {"error": [None, 2.9e-3]}], [row])


def test_numbers_are_kept_to_four_digits_and_long_lines_are_thinned() -> None:
    kept = plain({"a": 1}["a"]), plain(0.123456), plain(float("nan")), plain([1.23456, None, "x"])
    assert kept == (1, 0.1235, None, [1.235, None, "x"])
    thin = plain(list(range(1000)))
    assert len(thin) == 40 and thin[0] == 0 and thin[-1] == 999


def test_extreme_cases_are_counted_once() -> None:
    """All texts tell the number that the last report's table has, and it is that of the cases there are."""
    printed = (ROOT / "benchmarks" / "data" / "extreme.txt").read_text(encoding="utf-8")
    count, right, refused, wrong = re.findall(r"(\d+) cases in .*: (\d+) right .* (\d+) refused .* (\d+) wrong", printed)[0]
    assert int(count) == len(CASES) == int(right) + int(refused) and wrong == "0"
    told = {page: (ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("evidence.md", "benchmarks.md")}
    assert re.findall(r"runs (\d+) stiff and extreme cases", told["evidence.md"]) == [count]
    assert re.findall(r"Of (\d+) cases (\d+) are right within their bounds. (\d+) are refused", told["benchmarks.md"]) == [
        (count, right, refused)]


def test_the_first_pages_begin_with_the_public_brake() -> None:
    """Its numbers are tested in test_public_brake.py."""
    for page, folder in (("README.md", "docs/pictures/"), ("docs/index.md", "pictures/")):
        first = re.search(r"!\[[^\]]+\]\(([^)]+)\)", (ROOT / page).read_text(encoding="utf-8"))
        assert first and first[1] == f"{folder}public-brake.png"


def test_pictures_and_pages_tell_of_other_programs_what_was_measured() -> None:
    rows = json.loads(users.DATA.read_text(encoding="utf-8"))["rows"]
    assert {row["component"] for row in rows} == set(users.COMPONENTS)
    for name, chosen in (("users.png", rows), ("users-readme.png", users.fullest(rows))):
        assert DATA[name]["shows"] == json.loads(json.dumps(list(lines(users.figure(chosen)))))
    for page, make in users.PAGES.items():
        assert users.between((ROOT / page).read_text(encoding="utf-8")) == make(rows)
