"""Motions told apart by their lines, shares of attractors, and the script that follows many starts."""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import spearmanr

import femsub as fs
from benchmarks import attractor_runs as runs
from benchmarks.attractor_states import (
    Motion,
    bootstrap,
    chance,
    motion,
    overlap,
    rank_correlation,
    same_state,
    settled,
    shares,
    states,
    total_variation,
)

ROOT = Path(__file__).parent.parent

STEP = 0.25
T = STEP * np.arange(8000)
QUICK = runs.Settings(window=500.0, earliest=3000.0, latest=4000.0)


def seen(v: np.ndarray) -> Motion:
    return motion(v, STEP, speed=1.0, slip=0.01)


def cycle(omega: float, size: float = 1.0) -> np.ndarray:
    return size * (np.sin(omega * T) + 0.3 * np.sin(2 * omega * T + 1) + 0.1 * np.cos(5 * omega * T))


def test_a_periodic_motion() -> None:
    found = seen(2.0 + cycle(0.7245))
    assert found.periodic and found.omega == pytest.approx(0.7245, abs=2e-5)
    assert found.rms == pytest.approx(np.sqrt((1 + 0.09 + 0.01) / 2), rel=1e-3)
    lines = np.array([[0.7245, 1.0], [1.449, 0.09], [3.6225, 0.01]])
    assert np.array(found.lines) == pytest.approx(lines / [1.0, 1.1], abs=2e-4)
    assert found.sticking == np.mean(np.abs(1 - 2 - cycle(0.7245)) <= 0.01)
    assert repr(found).startswith("Motion: periodic, ω = 0.7245, rms 0.741")
    assert Motion.of(json.loads(json.dumps(found.flat()))) == found


def test_a_subharmonic_motion_is_periodic_and_two_tones_are_not() -> None:
    assert seen(np.sin(1.2 * T) + 0.5 * np.sin(0.4 * T)).periodic
    assert seen(np.sin(1.2 * T) + 0.5 * np.sin(0.9 * T)).periodic  # 4 : 3
    two = seen(np.sin(0.1484 * T) + 0.8 * np.sin(1.7908 * T))
    assert not two.periodic and two.omega == pytest.approx(0.1484, abs=1e-4)
    assert not seen(np.sin(1.2 * T) + 0.5 * np.sin(1.2 * np.sqrt(0.5) * T)).periodic
    assert not seen(np.random.default_rng(1).standard_normal(len(T))).periodic


def test_rest_is_no_motion() -> None:
    still = seen(0.3 + 1e-8 * np.sin(T))
    assert still.omega == 0 and still.lines == () and "nothing moves" in repr(still)
    assert same_state(still, seen(np.zeros(len(T)))) and not same_state(still, seen(cycle(0.7)))
    assert settled(still, still)
    for bad in (np.zeros(10), np.zeros((100, 2)), np.full(100, np.nan)):
        with pytest.raises(fs.InputError, match="at least 64 finite speeds"):
            seen(bad)


def test_the_same_state_within_the_tolerances_and_not_beyond() -> None:
    one = seen(cycle(0.7245))
    assert overlap(one, one) == pytest.approx(1.0) and overlap(one, seen(np.sin(1.1 * T))) == 0
    assert same_state(one, seen(cycle(0.7245 * 1.01))) and not same_state(one, seen(cycle(0.7245 * 1.04)))
    assert same_state(one, seen(cycle(0.7245, 1.08))) and not same_state(one, seen(cycle(0.7245, 1.15)))
    other = seen(np.sin(0.7245 * T) + np.sin(0.2 * np.sqrt(2) * T))  # half of its power elsewhere
    assert overlap(one, other) == overlap(other, one) == pytest.approx(0.5, abs=0.01)
    weak = seen(cycle(0.7245) + 0.3 * np.sin(0.31 * T))
    assert overlap(one, weak) > 0.9 and not same_state(one, weak)  # but it is no longer periodic
    assert settled(one, seen(cycle(0.7245, 1.005))) and not settled(one, seen(cycle(0.7245, 1.02)))
    assert not settled(seen(np.sin(0.5 * T)), seen(np.sin(0.5 * T + 0.2 * np.sin(0.61 * T)) + 0.5 * np.sin(0.87 * T)))


def test_the_lines_that_have_least_choice_are_served() -> None:
    def only(*lines: tuple[float, float]) -> Motion:
        return Motion(1.0, 1.0, 0.0, False, lines, 1e-9)

    # 1.000 can go to either, 1.012 to the upper one only
    assert overlap(only((1.0, 0.5), (1.012, 0.5)), only((0.99, 0.5), (1.01, 0.5))) == pytest.approx(1.0)
    assert overlap(only((1.0, 1.0)), only((0.99, 0.5), (1.01, 0.5))) == pytest.approx(1.0)
    assert overlap(only((1.0, 0.5), (1.1, 0.5)), only((1.0, 0.2), (1.1, 0.8))) == pytest.approx(0.7)


def test_four_fifths_of_the_power_make_a_state() -> None:
    def two(share: float, omega: float) -> Motion:
        return Motion(1.0, 1.0, 0.0, False, ((1.0, share), (omega, 1 - share)), 1e-9)

    assert same_state(two(0.85, 2.3), two(0.85, 3.1)) and not same_state(two(0.75, 2.3), two(0.75, 3.1))


def test_no_chain_of_small_steps_makes_one_state() -> None:
    found = states([seen(cycle(0.7 * 1.012**k)) for k in range(4)])
    assert found == [0, 0, 1, 1]


def test_the_nearest_leader_counts_even_if_it_comes_later() -> None:
    def only(*lines: tuple[float, float]) -> Motion:
        return Motion(1.0, 1.0, 0.0, False, lines, 1e-9)

    found = states([only((1.0, 0.75), (2.0, 0.25)), only((1.0, 0.95), (2.0, 0.05)), only((1.0, 1.0))])
    assert found == [0, 1, 1]  # the middle one could go to the first as well: 0.8 on common lines


def test_distance_of_shares_and_what_chance_does() -> None:
    one, other = [0] * 24 + [1] * 8, [0] * 16 + [2] * 16
    assert shares(one, 3) == pytest.approx([0.75, 0.25, 0])
    distance = total_variation(shares(one, 3), shares(other, 3))
    assert distance == pytest.approx(0.5)
    low, high = bootstrap(one, other, 3)
    assert low < distance < high and low > 0.25 and high < 0.75
    assert bootstrap(one, one, 3) == (0.0, 0.0)  # the same starts with the same ends
    # Two coins, 32 throws each: |difference| of the shares has the standard deviation sqrt(2 / 4 / 32) = 0.125.
    assert chance([0, 1] * 2000, 2, 32) == pytest.approx(1.96 * 0.125, abs=0.03)
    certain = chance([0] * 64, 1, 32)
    assert 0 < certain < 0.1 and chance([0] * 8, 1, 32) > certain  # what was always seen may still not be all there is


@pytest.fixture(scope="module")
def small() -> list[runs.Task]:
    return [runs.Task("craig-bampton", 4, (1,), family, 0) for family in ("impulse", "rest", "random")]


def test_a_small_model_has_two_motions(small: list[runs.Task]) -> None:
    impulse, rest = (runs.follow(QUICK, task) for task in small[:2])
    assert impulse["settled"] and rest["settled"] and impulse["end"] == 3000
    one, other = Motion.of(impulse["motion"]), Motion.of(rest["motion"])
    assert one.periodic and one.omega == pytest.approx(0.7302, abs=5e-4) and one.rms == pytest.approx(0.1468, abs=5e-4)
    assert other.periodic and other.omega == pytest.approx(0.4383, abs=5e-4) and other.rms == pytest.approx(0.1659, abs=5e-4)
    assert states([one, other]) == [0, 1] and 0.05 < one.sticking < other.sticking < 0.3


def test_what_has_not_settled_says_so(small: list[runs.Task]) -> None:
    early = replace(QUICK, window=100.0, earliest=200.0, latest=300.0)
    found = runs.follow(early, small[0])
    assert not found["settled"] and found["settled_at"] is None and found["end"] == 300


def test_starts_are_the_same_for_all_models_and_differ_from_each_other() -> None:
    full = runs.full_model(QUICK, (1,))
    contact = runs.sliding(full, QUICK.contact())
    task = runs.Task("full", 10, (1,), "random", 3)
    state = runs.start(QUICK, task)
    u, v = runs.random_start(QUICK, "random", 3)
    assert state.displacement == pytest.approx(contact.equilibrium + u) and state.velocity == pytest.approx(v)
    for method in ("craig-bampton", "craig-chang"):
        whole = runs.model(QUICK, method, 10, (1,))
        same = runs.start(QUICK, replace(task, method=method))
        assert whole.expand(same.displacement) == pytest.approx(state.displacement)
        small = runs.model(QUICK, method, 4, (1,))
        left = v - small.expand(runs.start(QUICK, replace(task, method=method, size=4)).velocity)
        assert small.V.T @ (full.M @ left) == pytest.approx(np.zeros(4), abs=1e-12)  # M-orthogonal
    kicks = [np.hypot(v[1], 0) for _, v in (runs.random_start(QUICK, "random", number) for number in range(200))]
    assert np.quantile(kicks, 0.1) < 5e-3 and np.quantile(kicks, 0.9) > 0.15  # from small ones to sticking
    assert not np.allclose(v, runs.random_start(QUICK, "again", 3)[1])


def test_what_the_full_model_ends_in_is_carried_over() -> None:
    short = replace(QUICK, window=100.0, earliest=200.0, latest=200.0)
    wanted = runs.tasks(short, [4, 10], [(1,), (1, 2)], 2)
    assert len(wanted) == 9 * 4 + 2 and len(runs.carried(wanted, [1])) == 8
    begin = runs.start(short, runs.Task("full", 10, (1,), "random", 1))
    run = fs.transient(runs.full_model(short, (1,)), short.contact(), (0, 200), start=begin, tol=1e-8)
    whole = runs.Task("craig-chang", 10, (1, 2), "carried", 1)
    begun = runs.start(short, whole)
    rom = runs.model(short, *whole.key[:3])
    assert rom.expand(begun.displacement) == pytest.approx(run.final.displacement, abs=1e-4)
    assert rom.expand(begun.velocity) == pytest.approx(run.final.velocity, abs=1e-4)


def test_an_interrupted_run_goes_on(tmp_path: Path, small: list[runs.Task], monkeypatch: pytest.MonkeyPatch,
                                    capsys: pytest.CaptureFixture[str]) -> None:
    quick = replace(QUICK, window=100.0, earliest=200.0, latest=200.0)
    whole = runs.run(tmp_path / "whole.jsonl", quick, small, 1, lambda _: None)
    path, followed, original = tmp_path / "cut.jsonl", [], runs.follow

    def stopped(settings: runs.Settings, task: runs.Task) -> dict[str, Any]:
        if len(followed) == 2:
            raise KeyboardInterrupt
        followed.append(task)
        return original(settings, task)

    monkeypatch.setattr(runs, "follow", stopped)
    with pytest.raises(KeyboardInterrupt):
        runs.run(path, quick, small, 1, lambda _: None)
    with path.open("a") as file:
        file.write('{"method": "craig-ba')  # killed in the middle of a line
    monkeypatch.setattr(runs, "follow", lambda settings, task: followed.append(task) or original(settings, task))
    told: list[str] = []
    again = runs.run(path, quick, small, 1, told.append)
    assert followed == small and told == ["3 of 3 trajectories: craig-bampton, 4 DOF"]
    assert [line | {"seconds": 0} for line in again] == [line | {"seconds": 0} for line in whole]
    assert len(path.read_text().splitlines()) == 4
    runs.run(path, quick, small, 1, told.append)
    assert len(followed) == 3 and len(told) == 1
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], lines[2].replace('"end": ', '"end": 1'), lines[3], ""]))  # a digit more
    again = runs.run(path, quick, small, 1, told.append)
    assert followed == [*small, small[1]]
    assert [line | {"seconds": 0} for line in again] == [line | {"seconds": 0} for line in whole]
    assert "a line is damaged" in capsys.readouterr().err
    with pytest.raises(fs.InputError, match="results of other settings"):
        runs.run(path, replace(quick, seed=2), small, 1, told.append)


def test_rank_correlation_is_spearmans() -> None:
    generator = np.random.default_rng(3)
    rows = [{"a": x, "b": x**3, "c": generator.normal(), "e": 1.0} for x in generator.normal(size=12)]
    rows[4]["c"] = rows[7]["c"]  # a tie
    rows.append({"a": np.nan, "b": 0.0, "c": 0.0, "e": 1.0})
    found = rank_correlation(rows, ["a", "e"], ["b", "c"])
    assert found[0]["criterion"] == "a" and found[0]["b"] == pytest.approx(1.0)
    assert found[0]["c"] == pytest.approx(spearmanr([row["a"] for row in rows[:-1]], [row["c"] for row in rows[:-1]]).statistic)
    assert np.isnan(found[1]["b"])
    models = [{"x": 1.0, "y": 3.0, "measured": 0.07}, {"x": 2.0, "y": 2.0, "measured": 0.36}]
    assert [line["measured"] for line in rank_correlation(models, ["x", "y"], ["measured"])] == pytest.approx([1.0, -1.0])


@pytest.mark.slow
def test_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "attractors.py"), "--starts", "2", "--sizes", "4", "10",
               "--interfaces", "1", "--window", "200", "--earliest", "400", "--latest", "400", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stdout + done.stderr
    names = {"attractors.csv", "attractors.json", "attractors.png", "numbers.json", "trajectories.jsonl"}
    assert {path.name for path in tmp_path.iterdir()} == names
    found = json.loads((tmp_path / "attractors.json").read_text())
    rows = {(row["method"], row["size"]): row for row in found["rows"]}
    assert list(rows) == [("full", 10), ("craig-bampton", 10), ("craig-chang", 10), ("craig-bampton", 4), ("craig-chang", 4)]
    for row in rows.values():
        assert sum(row["shares"].values()) == pytest.approx(1)
        assert {*row["shares"], row["impulse"], row["rest"]} <= {state["state"] for state in found["states"]} | {"not settled"}
    for method in ("craig-bampton", "craig-chang"):  # a complete basis is the full model
        assert rows[method, 10]["distance"] == 0 and rows[method, 10]["growth_distance"] < 1e-9
        assert rows[method, 4]["missing"] == 5 and rows[method, 10]["holds"] == rows["full", 10]["holds"]
    assert {line["criterion"] for line in found["correlations"]} > {"growth_distance", "missing_share"}
    main = runpy.run_path(command[1])["main"]
    for extra, what in ((["--sizes", "11"], "between 2 and 10"), (["--seed", "9"], "results of other settings")):
        monkeypatch.setattr(sys, "argv", [*command[1:], *extra])
        with pytest.raises(SystemExit, match="2"):
            main()
        assert what in capsys.readouterr().err
    monkeypatch.setattr(runs, "follow", lambda *_: pytest.fail("it has everything"))
    monkeypatch.setattr(sys, "argv", command[1:])
    assert main() == 0 and capsys.readouterr().out == done.stdout
