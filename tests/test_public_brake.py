"""The public brake M0: eigenvalues that its authors' program printed, and the picture that shows them.

Source: BrakeSqueal 0.1 (github.com/nae9on/BrakeSqueal0.1, commit 04726db), the output in model_reduction.ipynb. The matrices are
not part of femsub.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from benchmarks.over_a_range import BAND
from benchmarks.public_brake_picture import TURN, brake, printed
from femsub.checks import Array
from femsub.output import damping_percent

ROOT = Path(__file__).resolve().parents[1]
M0 = ROOT.parent / "shared" / "brake-m0"
SHOWN = json.loads((ROOT / "docs" / "pictures" / "data.json").read_text(encoding="utf-8"))["public-brake.png"]["shows"]


def unlike(found: Array, theirs: Array, radius: Array | float = 0.0) -> list[complex]:
    """λ of each list that the other lacks: a part differs by more than a unit in the fourth digit and `radius`."""
    def digits(value: Array) -> Array:
        return 10.0 ** (np.floor(np.log10(np.abs(value))) - 3)

    apart, radii = found[:, None] - theirs, np.broadcast_to(radius, found.shape)[:, None]
    alike = (np.abs(apart.real) <= digits(theirs.real) + radii) & (np.abs(apart.imag) <= digits(theirs.imag) + radii)
    return [*found[~alike.any(axis=1)], *theirs[~alike.any(axis=0)]]


def test_lists_that_differ_by_a_digit_or_a_mode_are_seen() -> None:
    theirs = printed()[1.0]
    assert not unlike(theirs, theirs) and not unlike(theirs[::-1] * (1 + 4e-5), theirs)
    assert unlike(theirs[:-1], theirs) == [theirs[-1]] == unlike(theirs, theirs[:-1])
    wrong = np.where(np.arange(len(theirs)) == 5, theirs.conj() * -1, theirs)  # the sign of Re λ = -2.4e-5
    assert set(unlike(wrong, theirs)) == {wrong[5], theirs[5]}
    assert not unlike(wrong, theirs, radius=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("turns", [pytest.param(1.0, marks=pytest.mark.rare), 7.5])
@pytest.mark.skipif(not M0.exists(), reason="the matrices of others are not there")
def test_eigenvalues_are_those_that_the_authors_program_printed(turns: float) -> None:
    modes, theirs = fs.complex_modes(brake(M0).at(speed=TURN * turns), band=BAND), printed()[turns]
    assert modes.evidence == "certified"
    assert not unlike(modes.eigenvalues[modes.eigenvalues.real > -10], theirs)
    assert len(modes.unstable) == (theirs.real > 0).sum()


def test_the_picture_shows_what_was_printed_on_lines_of_a_certified_model() -> None:
    panels = {"frequencies": lambda values: values.imag / TURN, "damping: a mode grows where it is below zero": damping_percent}
    for panel, of in panels.items():
        here = [row for row in SHOWN if row["panel"] == panel]
        printed_by = [row for row in here if row["line"].startswith("printed by")]
        circles = [(x, y) for row in printed_by for x, y in zip(row["x"], row["y"], strict=True)]
        theirs = [(turns, y) for turns, values in printed().items() for y in of(values)]
        assert np.array(sorted(circles)) == pytest.approx(np.array(sorted(theirs)), rel=6e-4)  # of four digits
        # each circle lies on a line, but for what drawing between kept speeds and four digits cost
        lines = [row for row in here if row["line"] == "small model, certified"]
        at = np.array([[np.interp(x, row["x"], row["y"]) for row in lines] for x, _ in circles])
        apart = np.abs(at - np.array([[y] for _, y in circles])).min(axis=1)
        assert apart.max() < 2e-3 * np.abs(at).max()


def test_the_picture_names_each_mode_that_grows_and_leaves_one_open() -> None:
    names = [row["line"] for row in SHOWN if row["panel"] == "frequencies"]
    grow = {int(re.sub(r"\D", "", name.split(" Hz")[0])): name for name in names if ", grows " in name}
    theirs = printed()
    for hertz, name in grow.items():
        signs = {turns: values[np.abs(values.imag / TURN / hertz - 1).argmin()].real > 0 for turns, values in theirs.items()}
        since = re.search(r"from ([\d.]+) turns", name)
        assert signs == {turns: turns > (float(since[1]) if since else 0.0) for turns in theirs}, name
    assert len(grow) == 4 and sum("undecided" in name for name in names) == 1
