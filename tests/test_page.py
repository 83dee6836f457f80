"""The page of a run: its sentences, tables and plots from the results alone; opened in a browser where there is one."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_results import CHAIN, SMALL, difference, results, scene_file

import femsub as fs
from femsub.app import page
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.app.result import Result
from femsub.checks import installed_by
from femsub.io import moving, read_mode, toml_text
from femsub.motion import cycles_verdict
from femsub.output import MODE_FILE, Remark, answer, to_json
from femsub.output.page import coded, rows_of
from femsub.reduction import METHODS
from femsub.stability import critical_chart
from femsub.studies import Study
from femsub.studies.charts_errors import error_time_chart, errors_chart

pytest.importorskip("plotly", reason="the page of a run is drawn by Plotly")

FOUR = ("chain", "solid", "chain-limit-cycle", pytest.param("brake", marks=pytest.mark.slow))
MORE = ("chain-parts", "chain-transient", "two-mode", "own-parts")  # other kinds of results, each made in a moment
LIMIT = 10_000_000  # bytes of a page
WORDS = 30  # of a sentence
PATIENCE = 120_000  # milliseconds, of a browser without a graphics card on a machine that others use


def asked(name: str) -> str:
    """A small scene with its page."""
    text = SMALL[name]
    if name == "brake":  # errors and the flutter diagram as well
        text = text.replace("modes = [8]", 'modes = [30]\nmethods = [["craig-bampton", "contact-modes"]]') + (
            '[[ask]]\ncompare = ["growth", "critical"]\nparameter = "mu"\nvalues = [0.5]\n[[ask]]\nflutter = "mu"\npoints = 5\n')
    if name == "chain":  # two interfaces side by side
        text += 'vary = {"part.chain.interface" = [[1], [1, "belt"]]}\n'
    return f"page = true\n{text}"


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of results by scene; each is made when it is first asked for."""
    class Made(dict[str, Path]):
        def __missing__(self, name: str) -> Path:
            folder = tmp_path_factory.mktemp(name)
            assert main(["run", "-q", scene_file(folder, name, asked(name)), "--no-figures", "--out", str(folder / "out")]) == 0
            self[name] = folder / "out"
            return self[name]

    return Made()


def test_a_scene_that_does_not_ask_loads_and_writes_nothing(tmp_path: Path) -> None:
    scene = scene_file(tmp_path, "chain", '[[ask]]\ncomplex-modes = "all"\n')
    code = ("import sys; from femsub.app.cli import main; status = main(sys.argv[1:]); "
            "sys.exit(status or any(name in sys.modules for name in ('plotly', 'femsub.app.page')))")
    subprocess.run([sys.executable, "-c", code, "run", "-q", scene, "--no-figures", "--out", str(tmp_path / "out")], check=True)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "results.json", "complex-modes.csv", "complex-modes-unstable.csv"}


@pytest.mark.slow
def test_the_page_changes_no_result(tmp_path: Path, folders: dict[str, Path]) -> None:
    scene = scene_file(tmp_path, "chain", asked("chain").replace("page = true\n", ""))
    assert main(["run", "-q", scene, "--no-figures", "--out", str(tmp_path / "out")]) == 0
    without, told = results(tmp_path / "out"), results(folders["chain"])
    assert set(told["written"]) - set(without["written"]) == {page.PAGE_FILE, MODE_FILE}
    assert told["inputs"] == {**without["inputs"], "page": True}
    for one in (without, told):
        del one["written"], one["inputs"]
    assert not difference(without, told)


@pytest.mark.slow
@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", FOUR)
def test_the_page_is_that_of_the_folder_alone(name: str, folders: dict[str, Path]) -> None:
    made = (folders[name] / page.PAGE_FILE).read_bytes()
    assert len(made) < LIMIT
    (folders[name] / page.PAGE_FILE).unlink()
    assert main(["show", str(folders[name])]) == 0
    assert (folders[name] / page.PAGE_FILE).read_bytes() == made
    assert (folders[name] / MODE_FILE).exists() == (name != "chain-limit-cycle")


def test_a_run_without_a_page_has_one_afterwards(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = scene_file(tmp_path, "chain", CHAIN), tmp_path / "out"
    assert main(["run", "-q", scene, "--out", str(out)]) == 0
    assert main(["show", str(out)]) == 0
    assert f"written: {out / page.PAGE_FILE}" in capsys.readouterr().out
    text = (out / page.PAGE_FILE).read_text(encoding="utf-8")
    assert '<section id="mode">' not in text and "mode.npz is not there" in text and '<section id="verdict"' in text
    assert main(["run", "-q", scene, "--out", str(out)]) == 0
    assert "files that are not of this run: report.html" in capsys.readouterr().err


@pytest.mark.slow
def test_wrong_folders_and_damaged_files_end_in_one_line(tmp_path: Path, folders: dict[str, Path],
                                                         capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "results.json").write_text('{"scene": "a"}')
    for folder in (tmp_path, tmp_path / "missing"):
        assert main(["show", str(folder)]) == 2
        said = capsys.readouterr().err
        assert "holds no results.json of a run" in said and said.count("\n") == 1
    copy = tmp_path / "copy"
    shutil.copytree(folders["chain"], copy)
    (copy / page.PAGE_FILE).unlink()
    whole = (copy / MODE_FILE).read_bytes()
    wrong = tmp_path / "wrong.npz"
    np.savez(wrong, facts=np.frombuffer(b"{}", np.uint8), points=np.zeros((2, 3)), cells=np.array([[0, 2]]),
             real=np.zeros((2, 3)), imag=np.zeros((2, 3)))
    results = json.loads((copy / "results.json").read_text())
    for words in ("mode.npz is not the file that results.json was written with", "does not hold a mode"):
        for content in (b"", b"no mode", whole[:len(whole) // 2], wrong.read_bytes()):
            (copy / MODE_FILE).write_bytes(content)
            assert main(["show", str(copy)]) == 2
            said = capsys.readouterr().err
            assert words in said and said.count("\n") == 1
        results["sha256"] = {}  # as results of an older version, without a hash
        (copy / "results.json").write_text(json.dumps(results))
    assert not (copy / page.PAGE_FILE).exists()


def test_a_missing_plotly_is_told_before_anything_is_computed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                              capsys: pytest.CaptureFixture[str]) -> None:
    from femsub.app import run

    scene = scene_file(tmp_path, "chain", asked("chain"))
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setattr(run, "run_all", lambda *_: pytest.fail("it was run"))
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 1
    assert installed_by("plotly") in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [*FOUR, *MORE])
def test_the_page_has_every_table_every_input_and_short_sentences(name: str, folders: dict[str, Path], tmp_path: Path) -> None:
    told, text = results(folders[name]), (folders[name] / page.PAGE_FILE).read_text(encoding="utf-8")
    tables = [file for file in told["written"] if file.endswith(".csv")]
    for file in tables:
        with (folders[name] / file).open(encoding="utf-8", newline="") as lines:
            rows = list(csv.DictReader(lines))
        shown = rows_of(told, told["tables"][file.removesuffix(".csv")])
        assert len(shown) == len(rows) and f"({len(rows)} row{'s' * (len(rows) != 1)}, {file})" in text
        for row, known in zip(rows, shown, strict=True):
            differ = {key: (row[key], value) for key, value in known.items() if isinstance(value, float) and key in row
                      and float(row[key]) != value}
            assert not differ
            assert {key for key, value in row.items() if len(value.split()) == 1} <= {*known, "eigenvalues", "multiplier"}
    assert tables and panels_of(told)
    # the inputs are a scene file of the same scene
    again = tmp_path / "again.toml"
    again.write_text(toml_text(told["inputs"]), encoding="utf-8")
    assert not difference(tomllib.loads(again.read_text(encoding="utf-8")), without_empty(told["inputs"]))
    if not told["files"]:
        one, other = (Scene.from_file(path) for path in (again, folders[name] / "results.json"))
        assert (one.parts, one.joints, one.contacts, one.reduce, one.asks) == (
            other.parts, other.joints, other.contacts, other.reduce, other.asks)
    found = told["verdict"]
    for line in (found["headline"], *found["decides"], *found["unchecked"]):
        for sentence in re.split(r"(?<=[.:;]) ", line):
            assert len(sentence.split()) <= WORDS, sentence
        assert line.endswith(".")


def places_of(told: dict[str, Any]) -> int:
    return sum(len(chart["places"]) for chart in told["charts"])


def panels_of(told: dict[str, Any]) -> list[dict[str, Any]]:
    return [panel for chart in told["charts"] for place in chart["places"] for panel in place["panels"]]


def without_empty(value: Any) -> Any:
    if isinstance(value, list):
        return [without_empty(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {key: without_empty(item) for key, item in value.items() if item not in (None, "", [])}


@pytest.fixture(scope="module")
def found() -> Study:
    """A study in which a reduced model may replace the full one."""
    study = fs.study(fs.chain(10, belt=2), [fs.CraigChang(4), fs.CraigBampton(2)], band=(0.0, 0.3), contacts=fs.Belt(slope=-0.1),
                     repeats=1)
    assert study.recommended() is not None
    return study


def with_rows(study: Study, **changes: Any) -> Study:
    return replace(study, rows=tuple(replace(row, **changes) for row in study.rows))


def test_the_verdict_follows_the_recommendation(found: Study) -> None:
    row = found.recommended()
    assert row is not None
    yes = answer([found.advice()])
    assert yes.answer == "yes" and f"({row.size} DOF)" in yes.headline and "of 10 DOF" in yes.headline
    assert "In the band both models are unstable." in yes.decides
    other = answer([with_rows(found, stable=True).advice()])
    assert any(line.startswith("Mind: in the band the full model is unstable and the small one stable") for line in other.decides)
    none = with_rows(found, error_growth=1.0).advice()
    assert answer([none]).answer == "no" and answer([none, found.advice(where="m1")]).answer == "in part"
    assert answer([]).answer == "open" and answer([Remark(unchecked=["this."])]).unchecked == ["this."]
    never = with_rows(found, critical=-np.inf, error_critical=0.0).advice()
    assert "At no slope does it lose its stability in the band, and neither does the full model." in never.decides
    far = with_rows(found, critical=-np.inf, error_critical=1.0).advice()
    assert any("critical slope is -inf, within 1.0e+00" in line for line in far.decides)


def test_the_verdict_over_a_range_is_that_of_the_critical_value(found: Study) -> None:
    over = replace(found, parameter="mu", values=(0.2, 0.5), between=(0.0, 0.6))
    fit = with_rows(over, error_critical=5e-3, error_growth=1.0, missed=0, invented=1).advice(1e-2)
    assert fit.model and "No unstable mode of the full model is missed, but 1 invented." in fit.decides
    assert fit.decides[0].endswith(": the critical μ is within 5.0e-03 of the full model's; the tolerance is 0.01.")
    assert "The full model was solved at μ = 0.2, 0.5 alone." in answer([fit]).unchecked
    for bad in ({"missed": 1, "error_critical": 0.0}, {"missed": 0, "error_critical": 0.02}):
        none = with_rows(over, **bad).advice(1e-2)
        assert not none.model and answer([none]).answer == "no"


@pytest.mark.slow
def test_the_page_says_what_the_study_recommends(folders: dict[str, Path]) -> None:
    told = results(folders["solid"])
    model = told["compare"]["recommended"][0]["model"]
    assert told["verdict"]["answer"] == "yes" and f"({model['size']} DOF)" in told["verdict"]["headline"]
    assert f"of {told['size']} DOF" in told["verdict"]["headline"]
    page_text = (folders["solid"] / page.PAGE_FILE).read_text(encoding="utf-8")
    assert all(escape(line) in page_text for line in (told["verdict"]["headline"], *told["verdict"]["decides"]))
    chain = results(folders["chain"])  # one interface has a model that is good enough, the other has none
    assert [bool(one["model"]) for one in chain["error-time"]["recommended"]] == [False, True]
    assert chain["verdict"]["answer"] == "in part"


def test_the_verdict_says_what_failed_and_that_it_was_interrupted() -> None:
    told = Result({"failed": {"modes": "too few"}, "complete": False}).record()["verdict"]
    assert len(told["unchecked"]) == 2
    for words in ("modes failed: too few", "interrupted"):
        assert any(words in line for line in told["unchecked"])


@pytest.mark.slow
def test_the_verdict_on_limit_cycles(folders: dict[str, Path]) -> None:
    told = results(folders["chain-limit-cycle"])["cycles"]
    full = {row["family"]: row["is_stable"] for row in told if row["model"] == "full"}
    for agrees, expected in ((True, "yes"), (False, "no")):
        rows = [row | {"is_stable": full[row["family"]] == agrees} for row in told if row["model"] != "full"]
        assert cycles_verdict([row for row in told if row["model"] == "full"] + rows, "here").answer == expected
    gone = [row if row["model"] == "full" else {key: row[key] for key in ("family", "model", "size")} | {"why": "none"}
            for row in told]
    assert cycles_verdict(gone, "here").answer == "no"
    assert cycles_verdict([row for row in told if row["model"] != "full"], "here").answer == "open"


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_infinite_or_unknown_are_told_and_not_drawn(value: float, found: Study) -> None:
    odd = with_rows(found, critical=value, error_critical=value, error_eigenvalue=value, error_force=value)
    assert odd.advice().decides
    slopes = [{"model": row.method, "modes": row.modes, "size": row.size, "value": row.critical, "error": row.error_critical}
              for row in (odd.full, *odd.rows)]
    for chart in (error_time_chart([("{m1}", odd)]), errors_chart(odd, "x", "methods"), critical_chart(slopes, [], "dμ/dv", "x")):
        told = json.loads(to_json(chart.plain()))
        assert told["places"]
        for series in (one for place in told["places"] for panel in place["panels"] for one in panel["series"]):
            for values in (series["x"], series["y"], *(values for _, values in series["hover"])):
                assert all(item is None or isinstance(item, (int, float)) for item in values)


OWN = """
import femsub as fs
from dataclasses import dataclass
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.output import Chart, Panel, Series, Table, column
from femsub.output import Verdict

@dataclass(frozen=True)
class Places(Ask):
    '''Places.'''
    places: int = key(3, "how many", least=1)
    KIND = "places"
    alone = True

    def run(self, models):
        return run()

def run():
    rows = [{"belt": belt, "method": "craig-chang", "width": 0.5 * belt, "omega": 2.0 * belt} for belt in (1, 2, 3)]
    columns = ["belt", "method", column("width", "the width", ".2f", meaning="how wide it is"), "omega"]
    series = Series("a", [1.0, 2.0, 3.0], [0.5, 1.0, 1.5], "craig-chang", hover={"omega [rad/time]": [2.0, 4.0, 6.0]})
    chart = Chart("widths", "Widths", [Panel([series], "belt  [-]", "width  [length]")])
    return Result({"places": {"rows": rows}}, ["Places", Table("places", rows, columns, "Widths of places"), chart,
                                               Verdict(["It is wide."], [], "yes", "Wide enough at 6 rad/time.", "Is it wide?")])
"""


def test_what_a_scene_gives_is_printed_filed_drawn_and_on_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No other file has to know of a scene, its columns, its charts or its verdict."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "my.toml").write_text('use = ["own.py"]\nunits = "SI"\npage = true\n[[ask]]\nplaces = 3\n')
    assert main(["run", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[:3] == ["Is it wide?", "Yes. Wide enough at 6 rad/s (0.9549 Hz).", ""]
    assert [line.split() for line in said[3:5]] == [["Places"], ["belt", "model", "the", "width", "ω", "Hz"]]
    assert said[6].split() == ["1", "Craig-Chang", "0.50", "2", "0.31831"]
    told = results(tmp_path / "out")
    with (tmp_path / "out" / "places.csv").open(encoding="utf-8", newline="") as lines:
        assert [list(row.values()) for row in csv.DictReader(lines)][2][:4] == ["3", "craig-chang", "1.5", "6.0"]
    assert told["tables"]["places"]["place"] == ["places", "rows"]
    assert told["tables"]["places"]["columns"][2] == {"key": "width", "head": "the width", "unit": "", "role": "",
                                                      "meaning": "how wide it is"}
    series, = told["charts"][0]["places"][0]["panels"][0]["series"]
    assert series["x"] == [1.0, 2.0, 3.0] and series["colour"] == METHODS["craig-chang"].colour
    assert [name for name, _ in series["hover"]] == ["omega [rad/s]", "f [Hz]"] and (tmp_path / "out" / "widths.png").exists()
    assert told["verdict"]["headline"] == "Wide enough at 6 rad/s (0.9549 Hz)."
    for run_again in (False, True):
        if run_again:
            assert main(["show", str(tmp_path / "out")]) == 0
        text = (tmp_path / "out" / page.PAGE_FILE).read_text(encoding="utf-8")
        for words in ('title="how wide it is">the width<', "Widths of places", "Is it wide?", "Wide enough at 6 rad/s",
                      ">Craig-Chang<"):
            assert words in text


def test_what_stands_in_results_cannot_break_the_page(tmp_path: Path, folders: dict[str, Path]) -> None:
    copy = tmp_path / "out"
    shutil.copytree(folders["chain"], copy)
    told = results(copy)
    evil = "</script><script>alert(1)</script>%%BODY%%"
    told |= {"scene": evil, "warnings": [evil]}
    told["sha256"].pop("results.json")
    told["charts"][0]["title"] = told["charts"][0]["places"][0]["panels"][0]["series"][0]["name"] = evil
    (copy / "results.json").write_text(json.dumps(told))
    assert main(["show", str(copy)]) == 0
    text = (copy / page.PAGE_FILE).read_text(encoding="utf-8")
    assert "<script>alert" not in text and text.count("&lt;/script&gt;&lt;script&gt;alert(1)") == 3  # title, head, warning
    outside = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert "http:" not in outside and "https:" not in outside and "default-src 'none'" in outside


def test_a_surface_is_thinned_to_what_a_browser_can_move() -> None:
    mesh = fs.block((0.3, 0.2, 0.1), (12, 10, 6), "hexahedron20")
    u = mesh.points[:, :1] * np.exp(1j * mesh.points[:, :1]) * np.array([0.0, 3.0, 4.0])
    whole, thin = (moving(mesh, u, {}, most) for most in (10**6, 200))
    assert len(whole.points) == 13 * 11 * 7 - 11 * 9 * 5 and len(whole.cells) == 4 * (12 * 10 + 12 * 6 + 10 * 6)
    assert 60 < len(thin.points) <= 200 and thin.cells.max() < len(thin.points) and thin.cells.shape[1] == 3
    assert (np.diff(np.sort(thin.cells, axis=1), axis=1) > 0).all()  # no triangle has become a line
    for made, off in ((whole, 1e-12), (thin, 0.05)):
        assert np.linalg.norm(made.u, axis=1).max() == pytest.approx(1)
        nearest = np.abs(mesh.points[:, None] - made.points[None]).max(axis=2).argmin(axis=0)
        assert np.abs(mesh.points[nearest] - made.points).max() < off  # no place is far from a node
        shape = u[nearest] * (made.u[-1, 2] / u[nearest][-1, 2])
        assert np.abs(shape - made.u).max() < 10 * off  # and moves as nodes do there
    top = whole.u.ravel()[np.abs(whole.u).argmax()]
    assert top.real > 0 and abs(top.imag) < 1e-12
    line = moving(fs.Mesh(np.arange(5.0)[:, None], np.stack([np.arange(4), np.arange(1, 5)], axis=1), "line"),
                  np.zeros((5, 3), dtype=complex), {})
    assert line.points.shape == (5, 3) and line.cells.shape == (4, 2) and not line.u.any()


def test_a_mode_s_file_holds_the_shape_in_single_precision(folders: dict[str, Path]) -> None:
    path = folders["solid"] / MODE_FILE
    mode = read_mode(path)
    told = results(folders["solid"])["complex-modes"]["least_stable"]
    assert mode.facts["eigenvalue"] == told["eigenvalue"] and mode.points.dtype == np.float32
    assert np.linalg.norm(mode.u, axis=1).max() == pytest.approx(1, abs=1e-6)
    sent = coded(mode)
    again = np.frombuffer(__import__("base64").b64decode(sent["real"]), "<i2").reshape(-1, 3) * sent["unit"]
    np.testing.assert_allclose(again, mode.u.real, atol=sent["unit"])


# ---- in a browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync = pytest.importorskip("playwright.sync_api", reason="pages are opened by playwright")
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("there is no Chromium here (Debian: apt-get install chromium)")
    with sync.sync_playwright() as play:
        # as root there is no sandbox; without a graphics card WebGL is computed by the processor
        opened = play.chromium.launch(executable_path=path, args=["--no-sandbox", "--use-angle=swiftshader",
                                                                  "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"])
        yield opened
        opened.close()


class Opened:
    """A page in a browser, with what went wrong in it."""

    def __init__(self, browser: Any, path: Path, **context: Any) -> None:
        self.wrong: list[str] = []
        self.page = browser.new_context(offline=True, **context).new_page()
        self.page.set_default_timeout(PATIENCE)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda line: self.wrong.append(line.text) if line.type == "error" else None)
        self.page.on("request", lambda asked: None if asked.url.startswith(("file:", "data:", "blob:")) else
                     self.wrong.append(asked.url))
        self.page.goto(path.as_uri())
        self.page.evaluate("window.ready.then(() => null)")

    def hover(self, plot: int) -> tuple[str, list[list[float]]]:
        """What the label says when the mouse is on the first mark of a plot, and x and y of the marks that say so."""
        canvas = self.page.locator(".canvas").nth(plot)
        canvas.scroll_into_view_if_needed()
        x, y = canvas.evaluate("""box => {
          const known = one => (v, i) => v !== null && one.y[i] !== null;
          const trace = box._fullData.find(one => one.mode.includes("markers") && one.x.some(known(one)));
          const i = trace.x.findIndex(known(trace));
          const frame = box.getBoundingClientRect(), { xaxis, yaxis } = box._fullLayout;
          return [frame.x + xaxis._offset + xaxis.d2p(trace.x[i]), frame.y + yaxis._offset + yaxis.d2p(trace.y[i])];
        }""")
        self.page.mouse.move(x - 2, y - 2)
        self.page.mouse.move(x, y)
        label = canvas.locator(".hovertext").first
        label.wait_for()
        said = label.text_content()
        return said, canvas.evaluate("""(box, said) => box._fullData
          .flatMap(one => one.text.map((text, i) => [text, one.x[i], one.y[i]]))
          .filter(([text]) => text.replaceAll("<br>", "") === said).map(([, x, y]) => [x, y])""", said)

    def moved(self, before: list[float]) -> list[float]:
        """Where the nodes are once they are drawn elsewhere."""
        for _ in range(300):
            now = self.places()
            if np.abs(np.subtract(now, before)).max() > 1e-3 * np.abs(before).max():
                return now
            self.page.wait_for_timeout(200)
        raise AssertionError("the mode does not move")

    def at_phase(self, degrees: float, scale: float) -> Any:
        """Where the nodes are at a phase and a scale, if they are drawn in a moment."""
        for name, value in (("scale", scale), ("phase", degrees)):
            self.page.locator(f"#{name}").evaluate(
                "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", value)
        self.page.wait_for_timeout(200)
        return np.array(self.places())

    def turns_about(self, rest: list[float]) -> bool:
        """Whether half a period on everything is on the other side of where it rests; a busy machine is given time to draw."""
        for _ in range(100):
            half, none = self.at_phase(180, 1), self.at_phase(180, 0)
            size = np.abs(none).max()
            if np.abs(half - none).max() > 1e-3 * size and np.abs(half + rest - 2 * none).max() <= 1e-6 * size:
                return True
        return False

    def places(self) -> list[float]:
        """Where the mode's nodes are, as they are drawn."""
        return self.page.evaluate("""() => {
          const drawn = document.getElementById('motion')._fullData[0];
          return [...(drawn.z || []), ...drawn.x, ...drawn.y];
        }""")


@pytest.mark.slow
@pytest.mark.sampled(99)
# a brake's mode is drawn as that of the solid is; the page of limit cycles has no mode, and nothing that the others lack
@pytest.mark.parametrize("name", [*FOUR[:2], pytest.param(FOUR[2], marks=pytest.mark.rare)])
def test_a_page_in_a_browser(name: str, folders: dict[str, Path], browser: Any) -> None:
    path = folders[name] / page.PAGE_FILE
    opened = Opened(browser, path, viewport={"width": 1200, "height": 900})
    told = results(folders[name])
    assert opened.page.locator("#verdict li").count() >= 2 and opened.page.locator(".plot").count() == places_of(told)
    firsts = [place["panels"][0]["series"] for chart in told["charts"] for place in chart["places"]]
    said, marks = opened.hover(next(at for at, series in enumerate(firsts) if any(one["marker"] for one in series)))
    numbers = [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", said)]
    assert marks and all(np.isclose(numbers, value, rtol=1e-5, atol=1e-300).any() for value in marks[0])
    # a click sorts, another sorts the other way round
    table = opened.page.locator("#tables details[open] table").last
    column = next(i for i in range(table.locator("th").count())
                  if len(set(table.locator(f"tbody tr td:nth-child({i + 1})").all_text_contents())) > 1
                  or table.locator("tbody tr").count() == 1)
    head, cells = table.locator("th").nth(column), table.locator(f"tbody tr td:nth-child({column + 1})")
    orders = []
    for _ in range(2):
        head.locator("button").click()
        values = cells.evaluate_all("all => all.map(one => one.dataset.v ?? one.textContent)")
        try:
            values = [float(value) for value in values if value != "–"]
        except ValueError:
            values = [value for value in values if value != "–"]
        orders.append(values)
    assert orders[0] == sorted(orders[0]) and orders[1] == sorted(orders[0], reverse=True)
    assert head.get_attribute("aria-sort") == "descending"
    if (folders[name] / MODE_FILE).exists():
        rest = opened.places()
        opened.page.click("#play")
        first = opened.moved(rest)
        opened.moved(first)
        opened.page.click("#play")
        assert opened.turns_about(rest)
        still = opened.places()  # turns_about ends without displacement
        opened.at_phase(180, 1)
        opened.moved(still)
        # a solid has lines of its mesh that move with it: one that turns about its own axis would seem still
        ends = opened.page.evaluate("""() => {
          const [body, lines] = document.getElementById('motion')._fullData;
          if (!lines || lines.type !== "scatter3d") return null;
          const places = of => Array.from(of.x, (x, i) => [x, of.y[i], of.z[i]].join()), known = new Set(places(lines));
          return places(body).filter(place => known.has(place)).length / body.x.length;
        }""")
        assert name != "solid" or ends > 0.9
    assert not opened.wrong
    opened.page.context.close()  # an open one goes on to draw


@pytest.mark.slow
def test_a_page_on_a_phone_at_night_and_on_paper(folders: dict[str, Path], browser: Any) -> None:
    backgrounds = []
    for scheme, name in (("light", "solid"), ("dark", "chain")):  # with what WebGL draws, and without
        opened = Opened(browser, folders[name] / page.PAGE_FILE, viewport={"width": 400, "height": 800}, color_scheme=scheme)
        assert opened.page.evaluate("document.documentElement.scrollWidth") <= 400
        for canvas in opened.page.locator(".canvas").all():
            assert canvas.bounding_box()["x"] + canvas.bounding_box()["width"] <= 400
        backgrounds.append(opened.page.evaluate("getComputedStyle(document.body).backgroundColor"))
        paper = opened.page.pdf(format="A4")
        assert paper.startswith(b"%PDF") and not opened.wrong
        opened.page.context.close()
    assert len(set(backgrounds)) == 2


# ---- maps over two parameters, one for each value of a third

MAPS = """
from dataclasses import dataclass
import numpy as np
import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.stability import stability_map_chart, stability_map_tables
from femsub.output import Verdict

@dataclass(frozen=True)
class Maps(Ask):
    '''Maps.'''
    maps: bool = key(True, "that they are asked for")
    KIND = "maps"
    alone = True

    def run(self, models):
        return run(models.say)

def run(progress):
    K = [(1.0, np.diag([1.0, 2.0])), ("split", np.diag([0.0, 1.0])), ("mu", [[0, 1], [-1, 0]])]
    family = fs.Affine(np.eye(2), [("damping", np.eye(2))], K)
    maps = {f"d = {d:g}": fs.stability_map(family.fixed(damping=d), {"split": (-2, 1), "mu": (0, 2)}, points=(9, 7),
                                           progress=progress) for d in (0.1, 0.5)}
    return Result({}, [stability_map_chart("map", maps, "A pair"), *stability_map_tables("map", maps["d = 0.1"]),
                       Verdict(["It is."], [], "yes", "It is stable in part.", "Is it stable?")])
"""


@pytest.fixture(scope="module")
def of_maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output of a scene of one's own with two maps."""
    made = tmp_path_factory.mktemp("map")
    (made / "own.py").write_text(MAPS)
    (made / "my.toml").write_text('use = ["own.py"]\nunits = "SI"\npage = true\n[[ask]]\nmaps = true\n')
    assert main(["run", "-q", str(made / "my.toml"), "--out", str(made / "out")]) == 0
    return made / "out"


@pytest.mark.slow
def test_a_scene_writes_the_map_and_its_borders(of_maps: Path) -> None:
    with (of_maps / "map.csv").open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 63 and {*rows[0]} >= {"split", "mu", "growing_modes", "growth", "omega", "frequency_hz", "undecided"}
    assert (of_maps / "map-borders.csv").is_file() and (of_maps / "map.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_slider_of_the_page_shows_one_map_after_the_other(of_maps: Path, browser: Any) -> None:
    opened = Opened(browser, of_maps / page.PAGE_FILE, viewport={"width": 1200, "height": 900})
    slider = opened.page.locator(".plot input[type=range]").first
    shown = "document.querySelector('.plot .canvas')._fullData.map(one => [one.type, one.x.length])"
    before = opened.page.evaluate(shown)
    title = "one => one.nextElementSibling.textContent"
    assert before[0] == ["heatmap", 9] and slider.evaluate(title) == "growing modes, d = 0.1"
    slider.evaluate("one => { one.value = 1; one.dispatchEvent(new Event('input')); }")
    assert slider.evaluate(title) == "growing modes, d = 0.5"
    assert opened.page.evaluate(shown) != before and not opened.wrong
