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
from femsub.app.grammar import Scene
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
    assert lines_of(blocks_of(page)[0]) < 30 and (page != "scene" or lines_of(blocks_of(page)[1]) < 30)


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
    (tmp_path / "my.toml").write_text('use = ["rational.py"]\nscene = "chain"\n[part.chain]\nchain = 5\n[contact.belt]\n'
                                      'law = "rational"\neps = 0.02\n[reduce]\nsizes = [3]\n[[ask]]\ncomplex-modes = "all"\n')
    assert main(["run", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
    told = json.loads((tmp_path / "out" / "results.json").read_text())
    assert ", rational, ε = 0.02" in told["contacts"][0] and told["inputs"]["use"] == ["../rational.py"]
    LAWS.pop("rational")
    again = ["run", str(tmp_path / "out" / "results.json"), "--trust", str(tmp_path / "rational.py")]
    assert main([*again, "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "results.json").read_text())["contacts"] == told["contacts"]


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
    (tmp_path / "second.py").write_text(blocks_of("method")[0], encoding="utf-8")
    (tmp_path / "my.toml").write_text('use = ["second.py"]\nscene = "chain"\n[part.chain]\nchain = 8\n[reduce]\nsizes = [5]\n'
                                      'methods = ["craig-chang", "second-order"]\n[[ask]]\ncomplex-modes = "all"\n')
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


@pytest.mark.slow
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
    """A folder with the files of the page on kinds."""
    (tmp_path / "places.py").write_text(blocks_of("scene")[0], encoding="utf-8")
    (tmp_path / "bar.py").write_text(blocks_of("scene")[1], encoding="utf-8")
    (tmp_path / "rod.toml").write_text(blocks_of("scene", "toml")[0], encoding="utf-8")
    text = blocks_of("scene", "text")[0]
    (tmp_path / "my.toml").write_text(text[text.index("use ="):text.index("$ femsub run my.toml")], encoding="utf-8")
    return tmp_path


def femsub(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "femsub", *words], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_an_ask_of_ones_own_is_run_by_the_command(places: Path) -> None:
    done = femsub(places, "run", "my.toml", "--out", "out")
    shown = blocks_of("scene", "text")[0].split("--out out\n")[1]
    assert done.returncode == 0 and done.stdout.split("\nwritten")[0].split() == shown.split(), done.stderr
    told = json.loads((places / "out" / "results.json").read_text())
    rows = {(row["belt"], row["model"]): row["slope"] for row in told["places"]}
    for mass in (1, 2, 3, 4):
        assert rows[mass, "full"] == pytest.approx(fs.critical_slope(fs.chain(4, belt=mass)).value, rel=1e-9)
    assert told["inputs"]["use"] == ["../places.py"] and told["inputs"]["ask"] == [{"places": [1, 2, 3, 4]}]
    assert [file["path"] for file in told["files"]] == ["../places.py"]
    assert {path.name for path in (places / "out").iterdir()} == {"results.json", "places.csv"}
    refused = femsub(places, "run", "out/results.json")
    assert refused.returncode == 2 and "--trust out/../places.py" in refused.stderr
    again = femsub(places, "run", "out/results.json", "--out", "out", "--trust", "places.py")
    assert again.returncode == 0 and again.stdout.split("\nwritten")[0] == done.stdout.split("\nwritten")[0]
    (places / "places.py").write_text(blocks_of("scene")[0] + "\n# changed\n", encoding="utf-8")
    changed = femsub(places, "run", "out/results.json", "--trust", "places.py")
    assert changed.returncode == 2 and "has changed since the run" in changed.stderr


def test_a_part_of_ones_own_has_the_frequencies_of_its_masses_and_springs(places: Path) -> None:
    scene = Scene.from_file(places / "rod.toml")
    k, c = np.arange(1, 4), np.sqrt(2.1e11 / 7850.0)
    exact = 2 * c * 20 / 0.7 * np.sin((2 * k - 1) * np.pi / 80)  # of 20 lumped masses, held and free
    assert fs.normal_modes(scene.models.full, count=3).frequencies == pytest.approx(exact, rel=1e-9)
    assert main(["run", str(places / "rod.toml"), "--no-figures", "--out", str(places / "out")]) == 0
    told = json.loads((places / "out" / "results.json").read_text())
    assert [row["omega"] for row in told["modes"]["rows"]][:3] == pytest.approx(exact, rel=1e-9)


def test_a_part_and_an_ask_of_ones_own_stand_with_those_of_femsub(places: Path) -> None:
    text = (places / "rod.toml").read_text(encoding="utf-8").replace('use = ["bar.py"]', 'use = ["bar.py", "places.py"]')
    text = text.replace("[[ask]]\nmodes = 3", '[contact.rub]\nbelt = "rod.belt"\n[reduce]\nmethods = ["CC"]\nmodes = [4]\n'
                                              '[[ask]]\ncritical = "slope"\nvary = {"part.rod.elements" = [10, 20]}\n')
    (places / "both.toml").write_text(text, encoding="utf-8")
    scene = Scene.from_file(places / "both.toml")
    assert main(["run", "-q", str(places / "both.toml"), "--no-figures", "--out", str(places / "out")]) == 0
    rows = json.loads((places / "out" / "results.json").read_text())["critical"]
    assert [row["elements"] for row in rows] == [10, 10, 20, 20] and {row["size"] for row in rows} == {10, 20, 5}
    assert scene.kinds.names("part").count("bar") == scene.kinds.names("ask").count("places") == 1


def test_its_run_has_a_page(places: Path) -> None:
    pytest.importorskip("plotly", reason="the page of a run needs plotly")
    text = (places / "my.toml").read_text(encoding="utf-8")
    (places / "my.toml").write_text(f"page = true\n{text}", encoding="utf-8")
    assert main(["run", str(places / "my.toml"), "--out", str(places / "out")]) == 0
    page = places / "out" / "report.html"
    first = page.read_text(encoding="utf-8")
    assert "-0.0283" in first and "places.py" in first
    page.unlink()
    assert main(["show", str(places / "out")]) == 0 and "-0.0283" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(("file", "old", "new", "reason"), [
    ("my.toml", "places = [1,", "plases = [1,", "line 11: ask 1: unknown kind of ask: none of its keys names one, as 'plases'; "
                                                "did you "
                                                "mean 'places'"),
    ("my.toml", "places = [1,", "places = [0,", "line 12: ask 1.places: it must be at least 1, but is 0"),
    ("my.toml", "places = [1,", "every = true\nplaces = [1,", "line 12: ask 1.every: unknown key 'every'"),
    ("rod.toml", "bar = 0.7", "bar = -0.7", "line 8: part.rod.bar: it must be positive"),
    ("rod.toml", "bar = 0.7", "bar = 0.7\nelemants = 3", "line 9: part.rod.elemants: unknown key 'elemants'; did you mean "
                                                         "'elements'"),
    ("rod.toml", "bar = 0.7", "bar = 0.7\nports = {a = 3}", "part.rod.ports: there is no such key here: a bar has one port, "
                                                            "'belt'"),
    ("rod.toml", "bar = 0.7", "", "part.rod: unknown kind of part"),
    ("rod.toml", "[[ask]]", "[contact.rub]\nbelt = 'rod.bolt'\n[[ask]]", "unknown port of 'rod' 'bolt'; did you mean 'belt'")])
def test_its_keys_are_checked(places: Path, file: str, old: str, new: str, reason: str) -> None:
    text = (places / file).read_text(encoding="utf-8")
    assert text.count(old) == 1
    (places / file).write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(fs.InputError) as caught:
        Scene.from_file(places / file)
    assert reason in str(caught.value)


@pytest.mark.parametrize(("text", "reason"), [
    ("x = ", "SyntaxError"), ("1 / 0", "ZeroDivisionError"), ("import nothing_like_it", "No module named")])
def test_a_file_that_cannot_be_read_is_told(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(text)
    for name, said in (("wrong.py", reason), ("absent.py", "there is no file")):
        (tmp_path / "my.toml").write_text(f'use = ["{name}"]\nscene = "chain"\n')
        with pytest.raises(fs.InputError, match=f"line 1: use: .*{said}"):
            Scene.from_file(tmp_path / "my.toml")


def test_a_file_is_run_once_for_all_variants_of_a_scene(places: Path) -> None:
    """Else its kinds were other classes in each of them, and what it enters in a list was there already."""
    with (places / "places.py").open("a", encoding="utf-8") as file:
        file.write('\nwith open(__file__ + ".log", "a") as log: log.write("run\\n")\n')
    assert main(["run", "-q", str(places / "my.toml")]) == 0
    assert (places / "places.py.log").read_text() == "run\n"


def test_every_page_is_listed() -> None:
    listed = (PAGES / "index.md").read_text(encoding="utf-8")
    assert all(f"({page.name})" in listed for page in PAGES.glob("*.md") if page.stem != "index")


def test_a_kind_of_femsub_is_a_file_in_its_folder(places: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    """With its page and its test this is the only file that it touches: every command knows it."""
    from femsub.app import asks, kinds

    (tmp_path / "folder").mkdir()
    (places / "places.py").rename(tmp_path / "folder" / "places.py")
    monkeypatch.setattr(asks, "__path__", [*asks.__path__, str(tmp_path / "folder")])
    clear = kinds._packaged.cache_clear
    clear()
    file = tmp_path / "my.toml"
    try:
        file.write_text(file.read_text(encoding="utf-8").replace('use = ["places.py"]', ""), encoding="utf-8")
        assert main(["run", str(file), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
        assert main(["run", str(tmp_path / "out" / "results.json")]) == 0
        printed = {}
        capsys.readouterr()
        for words in (["keys"], ["keys", "places"], ["schema"]):
            assert main(words) == 0
            printed[" ".join(words)] = capsys.readouterr().out
    finally:
        sys.modules.pop("femsub.app.asks.places", None)
        monkeypatch.undo()
        clear()
    assert "  places          The critical slope of a chain over the place" in printed["keys"]
    assert "masses under the belt" in printed["keys places"] and "a list of whole numbers at least 1; required" in \
        " ".join(printed["keys places"].split())
    schema = json.loads(printed["schema"])["properties"]["ask"]["items"]
    assert schema["properties"]["places"]["description"] == "masses under the belt"
    told = json.loads((tmp_path / "out" / "results.json").read_text())
    assert not told["files"] and len(told["places"]) == 8 and told["tables"]["places"]["columns"]
