"""The reduction method of docs/extend/method.md works by its key in studies, tables, figures and scenes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extendpages import names_of

import femsub as fs
from femsub.app.cli import main
from femsub.output import draw
from femsub.reduction.method import METHODS, Method
from femsub.stability import critical_chart
from femsub.studies.charts_errors import error_time_chart

KEY, LABEL, COLOUR = "second-order", "Second order", "#2a7f3f"
SCENE = f"""
scene = "chain"
[part.chain]
chain = 7
interface = [2]
[reduce]
methods = ["craig-bampton", "{KEY}"]
sizes = [4, 6]
repeats = 1
[[ask]]
critical = "slope"
[[ask]]
complex-modes = "all"
every = true
"""


@pytest.fixture
def second() -> Iterator[Any]:
    """Free modes, and two static responses for each interface DOF."""
    yield names_of("method", blocks=1)["SecondOrder"]
    del METHODS[KEY]


def test_a_new_method_is_its_steps_alone(second: Any, tmp_path: Path) -> None:
    sub = fs.chain(30, belt=4, masses=np.linspace(1.0, 2.0, 30))
    with pytest.warns(fs.PortWarning, match="with Second order with 5 free modes"):
        rom = fs.reduce(sub, second(5))
    modes = fs.normal_modes(sub, count=6)
    assert rom.modes == 5 and rom.kinds == ("free",) * 5 + ("static response",) * 2
    assert rom.cutoff == pytest.approx(modes.frequencies[5]) and second(5).static_columns(sub) == 2
    M, K = sub.M.toarray(), sub.K.toarray()
    assert np.allclose(np.abs(rom.V[:, :5].T @ M @ modes.shapes[:, :5]), np.eye(5), atol=1e-9)
    assert np.allclose(rom.K[:5, :5], np.diag(modes.eigenvalues[:5]), rtol=1e-12, atol=1e-15) and np.allclose(rom.M, np.eye(7))
    first = np.linalg.solve(K, np.eye(30)[0])
    for response in (first, np.linalg.solve(K, M @ first)):
        assert np.abs(response - rom.V @ (rom.V.T @ M @ response)).max() < 1e-9 * np.abs(response).max()
    w = sub.ports["belt"]  # the energy that the basis does not hold, of what all hold
    held = ((w @ rom.V) ** 2 / rom.K.diagonal()).sum()
    assert rom.port_error["belt"] == pytest.approx(np.sqrt(1 - held / (w @ np.linalg.solve(K, w))), rel=1e-6)
    fs.write_matrices(tmp_path, rom)
    read = fs.read_component(tmp_path)
    assert read.modes == 5 and repr(read) == repr(rom)


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_its_modes_are_found_to_a_tolerance(second: Any) -> None:
    rom = fs.reduce(fs.chain(60, damping=0.0), second(band=(0.0, 0.2), tol=1e-3))
    assert rom.estimate is not None and rom.estimate.met and rom.estimate.modes == rom.modes == rom.size - 2
    assert 0.2 < 0.7 * rom.cutoff < 0.3


def test_study_table_and_figures_name_it(second: Any) -> None:
    methods = [kind(modes) for kind in (fs.CraigChang, second) for modes in (3, 5)]
    told: list[str] = []
    found = fs.study(fs.chain(10, belt=2), methods, band=(0.0, 0.3), repeats=1, progress=told.append)
    assert [row.method for row in found.rows] == ["craig-chang", "craig-chang", KEY, KEY]
    assert [row.size for row in found.rows[2:]] == [5, 7]
    assert found.rows[2].error_eigenvalue < found.rows[0].error_eigenvalue
    assert f" {LABEL} " in str(found) and "Craig-Chang" in str(found)
    assert any(f"{LABEL} with 5 modes" in text for text in told)
    figure = draw(error_time_chart([("{m1}", found)]))
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == ["Craig-Chang", LABEL]
    assert any((line.get_color(), line.get_marker()) == (COLOUR, "D") for line in figure.axes[0].lines)
    rows = [{"model": KEY, "modes": size - 2, "size": size, "value": -0.1, "error": error}
            for size, error in ((3, 0.1), (4, 0.01))]
    line = draw(critical_chart(rows, (), "slope", "chain")).axes[0].lines[0]
    assert (line.get_label(), line.get_color(), line.get_marker()) == (LABEL, COLOUR, "D")


@pytest.mark.slow
def test_scene_files_take_it_by_its_key(second: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "toy.toml").write_text(SCENE)
    assert main(["run", "-v", str(tmp_path / "toy.toml"), "--out", str(tmp_path / "out")]) == 0
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    for rows in (data["critical"], data["complex-modes"]["models"]):
        assert [(row["model"], row["size"]) for row in rows] == [
            ("full", 7), *((method, size) for method in ("craig-bampton", KEY) for size in (4, 6))]
    assert all((tmp_path / "out" / f"{name}.png").stat().st_size > 10_000 for name in ("critical", "complex-modes"))
    text = capsys.readouterr().out
    assert f" {LABEL} " in text and KEY not in text


def test_scenes_of_components_take_it_too(second: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "toy.toml").write_text(f'scene = "beam"\n[part.beam]\nelements = 20\n[reduce]\nmodes = [6]\nmethods = ["{KEY}"]\n'
                                       'ports = false\nrepeats = 1\n[[ask]]\ncritical = "slope"\n[[ask]]\n'
                                       'compare = ["growth", "critical"]\n[[ask]]\nsprings = [1.0]\n')
    assert main(["run", "-v", str(tmp_path / "toy.toml"), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert {row["model"] for row in data["critical"]} == {"full", KEY} == {row["method"] for row in data["compare"]["rows"]}
    assert f"{LABEL} with 6 modes" in " ".join(capsys.readouterr().out.split())


def test_unknown_keys_name_those_that_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert KEY not in METHODS  # no other test sees the one above
    (tmp_path / "toy.toml").write_text(SCENE)
    assert main(["run", str(tmp_path / "toy.toml")]) == 2
    told = capsys.readouterr().err
    assert f"unknown method '{KEY}'" in told and "alid: box, contact-modes, craig-bampton, craig-chang, " in told


def test_a_method_says_all_of_what_it_is() -> None:
    with pytest.raises(fs.InputError, match="the key 'craig-chang' of Impostor is that of CraigChang"):
        type("Impostor", (Method,), {"key": "craig-chang"})
    with pytest.raises(fs.InputError, match="the reduction method Colourless has no colour"):
        type("Colourless", (Method,), {"key": "colourless", "label": "Colourless"})
    assert not {"impostor", "colourless"} & set(METHODS) and METHODS["craig-chang"] is fs.CraigChang
    nameless = type("Nameless", (fs.CraigChang,), {})  # what methods share may have a class of its own
    assert nameless not in METHODS.values()
