"""The friction law of docs/extend/law.md goes everywhere by its key, with nothing said about it in the package."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extendpages import names_of

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.coupling import friction_chart
from femsub.coupling.contacts.belt import LAWS, FrictionLaw
from femsub.output import draw

Rational: Any = names_of("law", blocks=1)["Rational"]  # rises within ε, then falls; only what the protocol asks for


class Bare:
    """The same without an ε that anybody could see."""

    def __init__(self, eps: float) -> None:
        law = Rational(eps)
        self.value, self.slope = law.value, law.slope


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LAWS, "rational", Rational)
    monkeypatch.setitem(LAWS, "bare", Bare)


SUB = fs.chain(6, belt=2, damping=0.1)


def belt(key: str = "rational", eps: float = 0.02) -> fs.Belt:
    law: FrictionLaw = LAWS[key](eps=eps)
    return fs.Belt(speed=0.2, law=law)


def test_it_runs_through_study_transient_and_cycle() -> None:
    rubbing = belt()
    assert rubbing.slope == Rational(0.02).slope(0.2) and replace(rubbing, speed=0.3).slope == Rational(0.02).slope(0.3)
    table = fs.study(SUB, [fs.CraigBampton(4)], (0.0, 1.0), contacts=rubbing, repeats=1)
    assert np.isfinite(table.rows[0].error_growth) and "Craig-Bampton" in str(table)
    found = fs.harmonic_balance(SUB, rubbing, harmonics=60)
    run = fs.transient(SUB, rubbing, (0.0, 4 * found.period), start=found.state(), step=found.period / 400)
    assert run.energy.residual < 1e-6
    assert run.velocity("belt").std() == pytest.approx(found.rms, rel=1e-2)
    assert fs.sticking(run) == pytest.approx(found.sticking, abs=5e-3) and 0.05 < found.sticking < 0.9
    assert not np.isnan(found.sticking) and found.residual < 1e-9


def test_without_an_eps_the_cycle_is_the_same_and_sticking_unknown() -> None:
    one, two = (fs.harmonic_balance(SUB, belt(key), harmonics=30) for key in ("rational", "bare"))
    assert two.omega == pytest.approx(one.omega, rel=1e-8) and two.rms == pytest.approx(one.rms, rel=1e-8)
    assert np.isnan(two.sticking)
    with pytest.raises(fs.InputError, match="no with_slope"):
        fs.branch(SUB, belt(), "slope")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("law", ["rational", "bare"])
def test_scenes_take_it_by_its_key(law: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shared = (f'[contact.belt]\nlaw = "{law}"\neps = 0.02\nspeed = 0.2\n[part.chain]\nchain = 6\ndamping = 0.1\n'
              '[reduce]\nmethods = ["craig-bampton"]\nrepeats = 1\nsizes = [4]\n')
    asks = {"chain": ("friction-law = [0.1]", 'complex-modes = "all"', 'compare = ["growth"]'),
            "chain-transient": ('motion = [0, 200]\nwindow = [100, 200]\nshow = ["signals", "spectrum"]',),
            "chain-limit-cycle": ("cycles = 1",)}
    for name, asked in asks.items():
        file, out = tmp_path / f"{name}.toml", tmp_path / f"{name}-out"
        file.write_text(f'scene = "{name}"\n{shared}' + "".join(f"[[ask]]\n{ask}\n" for ask in asked))
        assert main(["run", "-v", str(file), "--out", str(out), "--no-figures"]) == 0
        data = json.loads((out / "results.json").read_text())
        slope = float(Rational(0.02).slope(0.2))
        assert f"{law}, ε = 0.02, v0 = 0.2: μ' = {slope:.6g}" in " ".join(capsys.readouterr().out.split())
        if name == "chain":
            assert {curve["law"] for curve in data["friction-law"]["curves"]} == set(LAWS)
        if name == "chain-transient":
            assert [model["sticking"] is None for model in data["motion"]["models"]] == [law == "bare"] * 2
        if name == "chain-limit-cycle":
            assert any("omega" in row for row in data["cycles"])


def test_figures_have_a_panel_for_it() -> None:
    speeds = np.linspace(-1, 1, 9)
    curves = [{"law": key, "eps": 0.1, "value": law(eps=0.1).value(speeds)} for key, law in LAWS.items()]
    figure = draw(friction_chart(speeds, curves, {key: getattr(law, "label", key) for key, law in LAWS.items()}, 0.2, -0.1))
    assert [axis.get_title() for axis in figure.axes] == ["as printed, eq. (7)", "odd variant", "rational", "bare"]


def test_an_unknown_key_is_told_with_those_there_are(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text('scene = "chain"\n[contact.belt]\nlaw = "rationall"\n')
    with pytest.raises(fs.InputError, match=r"'rationall'; did you mean 'rational'\? Valid: bare, rational, stribeck"):
        Scene.from_file(file)


def test_a_slope_that_is_not_that_of_the_values_is_refused() -> None:
    class Wrong(Rational):  # type: ignore[misc]
        def slope(self, v: Any) -> Any:
            return -super().slope(v)

    with pytest.raises(fs.InputError, match="the friction law contradicts itself"):
        fs.Belt(speed=0.2, law=Wrong())
