"""The examples in docs/extend do what their pages say, against closed forms and full models, in under 30 lines each."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from extendpages import PAGES, blocks_of, lines_of, names_of

import femsub as fs
from femsub.app.cli import main
from femsub.app.scene import load
from femsub.coupling.contacts.belt import LAWS
from femsub.reduction.method import METHODS

STEEL = {"E": 2.1e11, "rho": 7850.0, "A": 1e-4}


@pytest.fixture(autouse=True)
def registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a page registers is gone after the test."""
    for registry in (LAWS, METHODS):
        for name in ("rational", "second-order"):
            monkeypatch.setitem(registry, name, None)  # type: ignore[call-overload]
            monkeypatch.delitem(registry, name)  # type: ignore[arg-type]


@pytest.mark.parametrize("page", ["component", "law", "method", "contact", "scene"])
def test_each_takes_less_than_30_lines(page: str) -> None:
    assert lines_of(blocks_of(page)[0]) < 30


def test_the_bar_has_the_frequencies_of_a_bar() -> None:
    bar = names_of("component", blocks=1)["bar"]
    k = np.arange(1, 7)
    exact = (2 * k - 1) * np.pi * np.sqrt(STEEL["E"] / STEEL["rho"]) / (2 * 0.7)
    coarse, fine = (fs.normal_modes(bar(0.7, n, **STEEL), count=6).frequencies / exact - 1 for n in (60, 120))
    assert np.allclose(coarse, ((2 * k - 1) * np.pi / 120) ** 2 / 24, rtol=0.02)  # (κh)²/24 of a consistent mass
    assert np.allclose(coarse / fine, 4, rtol=0.02)
    rod = bar(0.7, 60, **STEEL)
    assert abs(rod.M.sum() / (7850e-4 * 0.7) - 1) < 0.05 and list(rod.sets) == ["right"] and rod.dofs.points[-1, 0] == 0.7
    static = np.linalg.solve(rod.K.toarray(), rod.port("right"))
    assert static[-1] == pytest.approx(0.7 / (2.1e11 * 1e-4), rel=1e-9)  # L/EA


def test_the_slope_of_the_law_is_that_of_its_values() -> None:
    law = names_of("law", blocks=1)["Rational"](eps=0.02)
    for v in (-0.9, -0.05, 1e-3, np.sqrt(0.02), 0.2, 3.0):
        h = 1e-5 * abs(v)
        assert float(law.slope(v)) == pytest.approx((law.value(v + h) - law.value(v - h)) / (2 * h), rel=1e-6, abs=1e-6)
    assert abs(law.slope(np.sqrt(0.02))) < 1e-12 and law.value(-0.3) == -law.value(0.3)


@pytest.mark.slow
def test_the_chain_loses_its_stability_where_the_law_has_the_critical_slope() -> None:
    names = names_of("law", blocks=3)
    law, found, sub = names["law"], names["found"], names["sub"]
    critical = fs.critical_slope(sub).value
    for one in (found.losses[0], found.regains[-1]):
        assert law.slope(one.value) == pytest.approx(critical, rel=1e-6)
    belts = [fs.Belt(speed=found.regains[-1].value * factor, law=law) for factor in (0.999, 1.001)]
    assert [fs.complex_modes(sub, belt).is_stable for belt in belts] == [False, True]


def test_scene_files_know_the_law(tmp_path: Path) -> None:
    first, *_, last = blocks_of("law")
    (tmp_path / "rational.py").write_text(first + last, encoding="utf-8")
    (tmp_path / "my.toml").write_text('scene = "rational.py"\nlaw = "rational"\neps = 0.02\noutputs = ["eigenvalues"]\n'
                                      'n = 5\nsizes = [3]\nbelts = [2]\n')
    assert main(["run", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
    told = json.loads((tmp_path / "out" / "results.json").read_text())
    assert told["law"] == "rational" and told["inputs"]["scene"] == "../rational.py"
    LAWS.pop("rational")
    again = ["run", str(tmp_path / "out" / "results.json"), "--trust", str(tmp_path / "rational.py")]
    assert main([*again, "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "results.json").read_text())["slope"] == told["slope"]


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("fixed", [True, False])
def test_the_method_with_all_modes_is_the_full_model(fixed: bool) -> None:
    method = names_of("method", blocks=1)["SecondOrder"]
    sub = fs.chain(14, belt=5, damping=0.3, interface=[1, 9], fixed=fixed)
    elastic = 14 if fixed else 13
    whole = fs.reduce(sub, method(elastic))
    full, found = (fs.normal_modes(model, count=elastic).frequencies[-elastic:] for model in (sub, whole))
    assert whole.size == 14 and whole.dropped == 4 and np.abs(found / full - 1).max() < 1e-9
    one, other = (fs.complex_modes(model, fs.Belt(slope=-0.2)).eigenvalues for model in (sub, whole))
    assert np.abs(one[:, None] - other).min(axis=0).max() < 1e-7
    few = fs.reduce(sub, method(4))  # Ritz: from above, and better with each mode
    more = fs.reduce(sub, method(5))
    lowest = [fs.normal_modes(model, count=4).frequencies[-4:] for model in (sub, more, few)]
    assert (lowest[0] <= lowest[1] * (1 + 1e-9)).all() and (lowest[1] <= lowest[2] * (1 + 1e-9)).all()


def test_scene_files_know_the_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = 'from femsub.app.scene import scene_of\nSCENE, run = scene_of("chain")\n'
    (tmp_path / "second.py").write_text(blocks_of("method")[0] + own, encoding="utf-8")
    (tmp_path / "my.toml").write_text('scene = "second.py"\nmethods = ["craig-chang", "second-order"]\n'
                                      'outputs = ["eigenvalues"]\nn = 8\nsizes = [5]\nbelts = [2]\n')
    assert main(["run", str(tmp_path / "my.toml"), "--no-figures"]) == 0
    assert "Second order" in capsys.readouterr().out


def test_one_step_replaced_keeps_the_modes_below_a_frequency() -> None:
    method, sub = names_of("method")["Below"], fs.chain(50, interface=[1, 20])
    few = fs.reduce(sub, method(20, limit=0.3))
    same = fs.reduce(sub, fs.CraigBampton(few.modes))
    assert 0 < few.modes < 20 and few.cutoff >= 0.3 and few.cutoff == pytest.approx(same.cutoff, rel=1e-12)
    assert np.allclose(few.K, same.K, rtol=1e-10, atol=1e-12) and few.K.diagonal()[2:].max() < 0.3**2
    assert fs.reduce(sub, method(5)).modes == fs.reduce(sub, method(5, limit=1.9)).modes == 5


@pytest.mark.parametrize("k", [1.0, 2.0, 5.0])
def test_the_contact_flutters_where_the_closed_form_says(k: float) -> None:
    names = names_of("contact", blocks=2)
    found = fs.critical_value(names["sub"], names["Rubbing"](k=k), "mu", between=(0.0, 4.0))
    assert float(found) == pytest.approx(1 / k + k / 4, abs=1e-6) and found.losses[0].kind == "flutter"


def test_the_contact_in_motion_has_its_own_tangents() -> None:
    contact = names_of("contact")["Hardening"](mu=0.7)
    u, v, h = np.array([0.3, -0.2]), np.array([0.1, 0.4]), 1e-6
    for at, tangent in enumerate(contact.tangents(u, v)):
        for j in range(2):
            step = h * np.eye(2)[j]
            moved = [contact.exerted(u + sign * step * (at == 0), v + sign * step * (at == 1)) for sign in (1, -1)]
            np.testing.assert_allclose(tangent[:, j], (moved[0] - moved[1]) / (2 * h), atol=1e-7)
    damping, stiffness = contact.linearised(None)
    assert damping is None and np.array_equal(contact.tangents(0 * u, v)[0], -stiffness)


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """A folder with the files of the page on scenes."""
    (tmp_path / "places.py").write_text(blocks_of("scene")[0], encoding="utf-8")
    text = blocks_of("scene", "text")[0]
    (tmp_path / "my.toml").write_text(text[text.index("scene ="):text.index("$ femsub run my.toml")], encoding="utf-8")
    return tmp_path


def femsub(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "femsub", *words], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_scene_is_run_by_the_command(places: Path) -> None:
    done = femsub(places, "run", "my.toml", "--out", "out")
    shown = blocks_of("scene", "text")[0].split("--out out\n")[1]
    assert done.returncode == 0 and done.stdout.split("\nwritten")[0].split() == shown.split(), done.stderr
    told = json.loads((places / "out" / "results.json").read_text())
    rows = {(row["belt"], row["model"]): row["slope"] for row in told["places"]}
    assert rows[2, "full"] == pytest.approx(fs.critical_slope(fs.chain(4, belt=2)).value, rel=1e-9)
    assert told["inputs"] | {"scene": "../places.py", "n": 4, "modes": 1} == told["inputs"]
    assert [file["path"] for file in told["files"]] == ["../places.py"]
    assert {path.name for path in (places / "out").iterdir()} == {"results.json", "places.csv"}
    refused = femsub(places, "run", "out/results.json")
    assert refused.returncode == 2 and "--trust out/../places.py" in refused.stderr
    again = femsub(places, "run", "out/results.json", "--out", "out", "--trust", "places.py")
    assert again.returncode == 0 and again.stdout.split("\nwritten")[0] == done.stdout.split("\nwritten")[0]
    (places / "places.py").write_text(blocks_of("scene")[0] + "\n# changed\n", encoding="utf-8")
    changed = femsub(places, "run", "out/results.json", "--trust", "places.py")
    assert changed.returncode == 2 and "has changed since the run" in changed.stderr


def test_its_run_has_a_page(places: Path) -> None:
    pytest.importorskip("plotly", reason="the page of a run needs plotly")
    text = (places / "my.toml").read_text(encoding="utf-8")
    (places / "my.toml").write_text(text + 'outputs = ["places", "page"]\n', encoding="utf-8")
    assert main(["run", str(places / "my.toml"), "--out", str(places / "out")]) == 0
    made = places / "out" / "report.html"
    first = made.read_text(encoding="utf-8")
    assert "-0.0283" in first and "places.py" in first
    made.unlink()
    assert main(["show", str(places / "out")]) == 0 and "-0.0283" in made.read_text(encoding="utf-8")


def test_its_keys_are_listed_begun_and_checked(places: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = str(places / "places.py")
    assert main(["keys", source]) == 0
    told = capsys.readouterr().out
    assert "number of masses" in told and "a whole number at least 2 and at most 1,000" in told
    assert main(["new", source]) == 0
    begun = capsys.readouterr().out
    assert '#name = "places"' in begun
    (places / "new.toml").write_text(begun, encoding="utf-8")
    assert load(str(places / "new.toml"))[0].modes == 4  # type: ignore[attr-defined]
    assert main(["schema", source]) == 0
    assert json.loads(capsys.readouterr().out)["properties"]["n"]["minimum"] == 2
    for line, reason in (("modess = 3", "did you mean 'modes'"), ("n = 1", "at least 2")):
        (places / "wrong.toml").write_text(f'scene = "places.py"\n{line}\n', encoding="utf-8")
        with pytest.raises(fs.InputError, match=reason):
            load(str(places / "wrong.toml"))


def test_its_results_are_not_those_of_another(places: Path) -> None:
    assert main(["run", str(places / "my.toml"), "--out", str(places / "out")]) == 0
    (places / "others.py").write_text(blocks_of("scene")[0], encoding="utf-8")
    assert main(["run", str(places / "others.py"), "--out", str(places / "out")]) == 2


@pytest.mark.parametrize(("text", "reason"), [
    ("x = 1", "is no scene: it needs SCENE"), ("SCENE = 3\nrun = print", "is no scene"),
    ("SCENE = int\nrun = print", "is no scene"), ("x = ", "SyntaxError"),
    ("1 / 0", "ZeroDivisionError"), ("import nothing_like_it", "No module named")])
def test_what_is_no_scene_is_told(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(text)
    with pytest.raises(fs.InputError, match=reason):
        load(str(tmp_path / "wrong.py"))
    with pytest.raises(fs.InputError, match="there is no scene file"):
        load(str(tmp_path / "absent.py"))


def test_every_page_is_listed() -> None:
    listed = (PAGES / "index.md").read_text(encoding="utf-8")
    assert all(f"({page.name})" in listed for page in PAGES.glob("*.md") if page.stem != "index")


def test_a_built_in_scene_is_a_module_and_a_line_of_the_list(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                             capsys: pytest.CaptureFixture[str]) -> None:
    """With its page and its test these are all the files that it touches: every command and the reference know it."""
    import test_site

    from femsub.app import scenes
    from femsub.app.scene import SCENES

    (tmp_path / "places.py").write_text(blocks_of("scene")[0], encoding="utf-8")
    monkeypatch.setattr(scenes, "__path__", [*scenes.__path__, str(tmp_path)])
    monkeypatch.setitem(SCENES, "belt-places", ("places", "the critical slope over the place of the belt"))
    file = tmp_path / "my.toml"
    try:
        printed = {}
        for words in (["scenes"], ["keys", "belt-places"], ["new", "belt-places"], ["schema"], ["schema", "belt-places"]):
            assert main(words) == 0
            printed[" ".join(words)] = capsys.readouterr().out
        file.write_text(printed["new belt-places"] + "\nn = 4\nmodes = 1\n", encoding="utf-8")
        assert main(["run", str(file), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
        assert main(["run", str(tmp_path / "out" / "results.json")]) == 0
        pages = test_site.generate.pages()
        with pytest.raises(fs.InputError, match="did you mean 'modes'"):
            file.write_text('scene = "belt-places"\nmodess = 3\n', encoding="utf-8")
            load(str(file))
    finally:
        sys.modules.pop("femsub.app.scenes.places", None)
    assert any(line.startswith("belt-places ") and line.endswith("place of the belt") for line in printed["scenes"].splitlines())
    assert "number of masses" in printed["keys belt-places"]
    every = json.loads(printed["schema"])["allOf"]
    assert "belt-places" in every[0]["properties"]["scene"]["anyOf"][0]["enum"]
    assert [case for case in every[1:] if case["if"]["properties"]["scene"] == {"const": "belt-places"}]
    assert json.loads(printed["schema belt-places"])["properties"]["n"]["minimum"] == 2
    told = json.loads((tmp_path / "out" / "results.json").read_text())
    assert told["inputs"]["scene"] == "belt-places" and len(told["places"]) == 12 and told["tables"]["places"]["columns"]
    assert "number of masses" in pages["scenes/belt-places.md"] and "(belt-places.md)" in pages["scenes/index.md"]
