"""The scenes of limit cycles: tables, branches, figure; and what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.app.asks.branch import BranchAsk
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.motion.cycles import families
from femsub.motion.cycles.branch import Branch
from femsub.motion.cycles.branch_chart import bifurcation_chart
from femsub.motion.cycles.continuation import with_parameter
from femsub.motion.cycles.families import along, family_branches, family_cycles
from femsub.motion.signals import period_near
from femsub.output import draw


def scene_file(folder: Path, text: str) -> str:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.slow
def test_cycles_and_branches_of_the_chain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ('scene = "chain-limit-cycle"\nband = [0.6, 0.9]\n[[ask]]\ncycles = 1\n[[ask]]\nbranch = "slope"\nfamilies = 1\n'
            'dots = 1\nperiods = 150\nharmonics = 50\npoints = 30\n')
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "results.json", "cycles.csv", "branch.csv", "branch-transients.csv", "branch.png"}
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    found = {row["model"]: row for row in data["cycles"]}
    assert found["craig-bampton"]["omega"] == pytest.approx(0.7245, rel=1e-4) and found["craig-bampton"]["is_stable"] is True
    assert found["craig-chang"]["omega"] == pytest.approx(0.7227, rel=1e-4) and found["craig-chang"]["is_stable"] is True
    assert found["full"]["is_stable"] is False
    assert {item["model"] for item in data["branch"]} == {"full", "craig-bampton", "craig-chang"}
    for item in data["branch"]:
        assert item["hopf"]["error"] < 1e-6 and item["hopf"]["supercritical"] is True
    # where a transient ends on the cycle, it lies on the branch
    dots = {dot["model"]: dot for dot in data["branch-transients"]}
    branch = next(item for item in data["branch"] if item["model"] == "craig-chang")
    near = min(branch["points"], key=lambda point: abs(point["slope"] - dots["craig-chang"]["value"]))
    assert dots["craig-chang"]["omega"] == pytest.approx(near["omega"], rel=5e-3)
    assert dots["craig-chang"]["rms"] == pytest.approx(near["rms"], rel=0.05)
    assert "Branches over the slope" in capsys.readouterr().out


@pytest.mark.slow
def test_full_plate_and_its_reduced_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ('scene = "plate-limit-cycle"\nfigures = false\n[part.plate]\nplate = {lengths = [0.4, 0.3], elements = [4, 3]}\n'
            '[reduce]\nmodes = [8]\n[[ask]]\ncycles = 1\n')
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    rows = {row["model"]: row for row in json.loads((tmp_path / "out" / "results.json").read_text())["cycles"]}
    assert rows["craig-chang"]["omega_error"] < 1e-4 and rows["craig-bampton"]["rms_error"] < 1e-2
    assert "Limit cycles; v is" in capsys.readouterr().out


@pytest.mark.parametrize(("text", "words"), [
    ('[[ask]]\nbranch = "speeed"', "did you mean 'speed'"), ("[contact.belt]\nslope = -0.2", "needs a friction law"),
    ('[[ask]]\nbranch = "slope"\nfamilies = 0', "at least 1"), ("[[ask]]\ncycles = 0", "at least 1"),
    ('[[ask]]\nbranch = "slope"\nbetween = [1.0]', "ask 1.between: it must be [lo, hi]"),
    ('[[ask]]\nbranch = "slope"\ndots = -1', "at least 0"),
    ('[[ask]]\nbranch = "slope"\ndots_from = "rest"', "ask 1.dots_from: unknown dots_from 'rest'"),
    ("[contact.belt]\nforce = 0.001", "no cycle begins"),
])
def test_a_bad_scene_ends_in_a_line_or_two(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    scene = scene_file(tmp_path, f'scene = "chain-limit-cycle"\n{text}\n')
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert words in printed.err and printed.err.count("\n") <= 3 and not (tmp_path / "out").exists()


# ---- what is made of a branch: cycles of a model too large for its modes, dots of transients, markers

SCENE = Scene({"scene": "chain-limit-cycle", "contact": {"belt": {"speed": 1.0, "eps": 0.02}}})
RUBBING = SCENE.models.contacts[0]
SPEED = BranchAsk(branch="speed", dots=2, periods=10, dots_from="cycle")


@pytest.fixture(scope="module")
def oscillator() -> tuple[fs.Substructure, Branch]:
    """A branch that begins at a Hopf point in the middle of the range, turns at a fold above it and ends at the low end."""
    model = fs.Substructure([[1.0]], [[1.0]], [[0.05]], ports={"belt": [1.0]})
    return model, fs.branch(model, RUBBING, "speed", (0.2, 4.0))


def large(model: fs.Substructure, guide: Branch) -> tuple[Branch, list[dict[str, Any]]]:
    return along(guide, model, RUBBING, SPEED.dots)


@pytest.mark.slow
def test_a_large_model_follows_the_reduced_one_s_branch_to_its_end(oscillator: tuple[fs.Substructure, Branch]) -> None:
    model, guide = oscillator
    found, missed = large(model, guide)
    assert missed == [] and found.ended.startswith("3 of 3 cycles")
    assert guide.hopf is not None and guide.values[-1] == found.values[-1] == 0.2
    np.testing.assert_allclose(found.values, np.linspace(guide.hopf.value, 0.2, 4)[1:], atol=0.1)
    for value, point in zip(found.values, found.points, strict=True):
        exact = guide.points[guide.values.tolist().index(value)]
        assert point.contact.belts[0].speed == value
        assert (point.omega, point.rms) == pytest.approx((exact.omega, exact.rms), rel=1e-3)


def test_without_a_small_model_a_large_one_has_neither_cycle_nor_branch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.motion.cycles.families.small", lambda model: False)
    model = {"full": fs.chain(5, belt=2)}
    row, = family_cycles(model, [RUBBING], 1.0)
    branch, = family_branches(model, [RUBBING], "speed", (0.2, 1.0), [1.0])
    assert row["why"] == "no reduced model gave a cycle to start from" and branch["why"] == "no reduced model has this branch"


def failing(monkeypatch: pytest.MonkeyPatch, fails: Any) -> None:
    plain = families.harmonic_balance

    def balance(model: fs.Substructure, acting: Any, **options: Any) -> fs.LimitCycle:
        if fails(acting[0] if isinstance(acting, list) else acting):
            raise fs.NotConvergedError("no luck here")
        return plain(model, acting, **options)

    monkeypatch.setattr(families, "harmonic_balance", balance)


@pytest.mark.slow
@pytest.mark.sampled(3)
@pytest.mark.parametrize("lost", range(3))
def test_a_cycle_that_does_not_converge_is_told_and_the_others_are_kept(oscillator: tuple[fs.Substructure, Branch], lost: int,
                                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    model, guide = oscillator
    wanted = large(model, guide)[0].values
    with monkeypatch.context() as patch:
        failing(patch, lambda belt: belt.speed == wanted[lost])
        found, missed = large(model, guide)
    np.testing.assert_allclose(found.values, np.delete(wanted, lost))
    assert missed == [{"speed": wanted[lost], "why": "no luck here"}] and found.ended.startswith("2 of 3 cycles")
    failing(monkeypatch, lambda belt: True)
    with pytest.raises(fs.NotConvergedError, match="none of 3 cycles; the first: no luck here"):
        large(model, guide)


@pytest.mark.slow
def test_the_scene_tells_which_cycles_of_the_large_model_are_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, lambda belt: belt.slope < -0.059)
    monkeypatch.setattr(families, "small", lambda model: model.size < 50)  # the full model of 60 DOF is large
    monkeypatch.setattr("femsub.motion.cycles.compliance.QUADRATIC", 50)
    text = ('scene = "chain-limit-cycle"\nband = [0.0, 0.1]\n[part.chain]\nchain = 60\n[contact.belt]\neps = 0.02\n'
            '[[ask]]\nbranch = "slope"\nfamilies = 1\nbetween = [-0.06, -0.01]\ndots = 0\n')
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [item["model"] for item in data["branch"]] == ["craig-bampton", "craig-chang", "full"]
    full = data["branch"][2]
    assert len(full["points"]) == 2 and [point["is_stable"] for point in full["points"]] == [None, None]
    assert [gap["why"] for gap in full["missed"]] == ["no luck here"] and full["missed"][0]["slope"] == pytest.approx(-0.06)
    said = capsys.readouterr().out
    assert "no cycle at slope = -0.06: no luck here" in said and "2 of 3 cycles" in said


@pytest.mark.slow
def test_dots_from_a_cycle_lie_on_the_branch_and_only_where_it_is_stable(oscillator: tuple[fs.Substructure, Branch],
                                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    model, guide = oscillator
    starts: list[fs.State] = []
    plain = fs.transient
    monkeypatch.setattr(families, "transient", lambda *args, start, **options: starts.append(start) or
                        plain(*args, start=start, **options))
    dots = families.settled_over(model, RUBBING, "speed", (0.45, 1.85), 3, SPEED.periods * 2 * np.pi, [guide])
    values = [0.8, 1.15, 1.5]  # one cycle, a stable one above an unstable one, none
    assert len(guide.at(values[1])) == 2 and guide.values.max() < values[2]
    assert [dot["value"] for dot in dots] == pytest.approx(values[:2])
    for dot, start in zip(dots, starts, strict=True):
        stable, = [cycle for cycle in guide.at(dot["value"]) if cycle.is_stable]
        np.testing.assert_allclose(start.velocity, 1.05 * stable.state().velocity)
        exact = fs.harmonic_balance(model, with_parameter(RUBBING, "speed", dot["value"]), start=stable)
        assert dot["omega"] == pytest.approx(exact.omega, rel=1e-3) and dot["rms"] == pytest.approx(exact.rms, rel=2e-2)


@pytest.mark.parametrize("guess", [0.975, 1.0, 1.025])
def test_the_period_of_a_few_periods_is_found(guess: float) -> None:
    t = np.linspace(3.0, 20.0, 4096)
    v = np.cos(1.3 * t) + 0.4 * np.sin(3.9 * t)
    assert period_near(t, v, guess * 2 * np.pi / 1.3) == pytest.approx(2 * np.pi / 1.3, rel=1e-4)


@pytest.mark.slow
def test_dots_from_a_blow_reach_the_cycle(oscillator: tuple[fs.Substructure, Branch]) -> None:
    model, guide = oscillator
    dot, = families.settled_over(model, RUBBING, "speed", (0.7, 0.9), 1, 60 * 2 * np.pi)
    exact = fs.harmonic_balance(model, with_parameter(RUBBING, "speed", 0.8), start=guide.at(0.8)[0])
    assert (dot["omega"], dot["rms"]) == pytest.approx((exact.omega, exact.rms), rel=2e-2)


def test_points_whose_stability_was_not_computed_are_marked_by_an_x(oscillator: tuple[fs.Substructure, Branch]) -> None:
    _, guide = oscillator
    silent = replace(guide, points=tuple(replace(point, stability=False) for point in guide.points[::9]),
                     values=guide.values[::9], special=(), hopf=None)
    items = [{"model": "craig-chang", "family": 1.0, "branch": guide}, {"model": "full", "family": 1.0, "branch": silent}]
    figure = draw(bifurcation_chart(items, [], "speed", [1.0], 1.0, "oscillator"))
    for axis, values in zip(figure.axes, (silent.rms, silent.omega), strict=True):
        crosses = [line for line in axis.lines if line.get_marker() == "x"]
        assert len(crosses) == 1 and crosses[0].get_linestyle() == "None"
        np.testing.assert_array_equal(crosses[0].get_xydata(), np.column_stack([silent.values, values]))
        styles = [line.get_linestyle() for line in axis.lines if line.get_color() == crosses[0].get_color()]
        assert styles == ["None"]  # no line of it that would pass for stable or unstable
        assert {"-", "--"} <= {line.get_linestyle() for line in axis.lines}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "full (stability not computed)" in labels and "Craig-Chang" in labels
    assert not any("not computed" in text.get_text() for text in
                   draw(bifurcation_chart(items[:1], [], "speed", [1.0], 1.0, "oscillator")).legends[0].get_texts())
