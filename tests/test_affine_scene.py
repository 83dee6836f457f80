"""The scene `affine`: own matrices with factors of named parameters, from the files of every format, and their expressions."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.optimize
import scipy.sparse as sp
from numpy.polynomial import polynomial

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene, text_of
from femsub.checks import InputError
from femsub.components import disc_pair, two_mode
from femsub.model import Expression, Factor

OWN = """
name = "own"
figures = false
[part.disc]
affine.M = [{matrix = "M.mtx"}]
affine.D = [{matrix = "pair.mat:D1"}, {matrix = "DR.npz", factor = "mu / speed"}, {matrix = "DG.npy", factor = "speed"}]
affine.K = [{matrix = "K1.mtx"}, {matrix = "pair.mat:KR", factor = "mu"}, {matrix = "Kgeo.mtx", factor = "speed**2"}]
[parameter.speed]
between = [0.005, 0.2]
[parameter.mu]
value = 0.4
[[ask]]
critical = "speed"
"""
BOTH = OWN + '[[ask]]\nflutter = "speed"\npoints = 21\n'



def written(folder: Path) -> dict[str, Any]:
    """The matrices of the small example, in files of several kinds."""
    pair = disc_pair()
    for name in ("M", "K1", "Kgeo"):
        scipy.io.mmwrite(folder / f"{name}.mtx", sp.csr_array(pair[name]))
    scipy.io.savemat(folder / "pair.mat", {name: sp.csc_matrix(pair[name]) for name in ("D1", "KR")})
    sp.save_npz(folder / "DR.npz", sp.csc_array(pair["DR"]))
    np.save(folder / "DG.npy", pair["DG"])
    return pair


def run(folder: Path, text: str) -> dict[str, Any]:
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "scene.toml"), "--out", str(folder / "out")]) == 0
    return json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))


def border(mu: float, lo: float, hi: float) -> list[float]:
    """Speeds at which the Hurwitz determinant of the pair's characteristic polynomial vanishes."""
    A = disc_pair()

    def hurwitz(speed: float) -> float:
        D = A["D1"] + mu / speed * A["DR"] + speed * A["DG"]
        K = A["K1"] + mu * A["KR"] + speed**2 * A["Kgeo"]
        entry = np.stack([K, D, A["M"]], axis=-1)
        a0, a1, a2, a3, _ = polynomial.polysub(polynomial.polymul(entry[0, 0], entry[1, 1]),
                                               polynomial.polymul(entry[0, 1], entry[1, 0]))
        return float(a1 * (a2 * a3 - a1) - a0 * a3**2)

    speeds = np.linspace(lo, hi, 2001)
    signs = np.sign([hurwitz(speed) for speed in speeds])
    return [scipy.optimize.brentq(hurwitz, speeds[i], speeds[i + 1], xtol=1e-14) for i in np.flatnonzero(np.diff(signs))]


@pytest.mark.slow
def test_a_turning_disc_without_files_and_from_files(tmp_path: Path) -> None:
    """D1 + μ DR/Ω + Ω DG and K1 + μ KR + Ω² Kgeo lose and regain stability where the Hurwitz determinant vanishes."""
    written(tmp_path)
    data = run(tmp_path, BOTH)
    rows, exact = data["critical"], border(0.4, 0.005, 0.2)
    assert [row["stability"] for row in rows] == ["lost", "regained"] and {row["kind"] for row in rows} == {"flutter"}
    np.testing.assert_allclose([row["value"] for row in rows], exact, atol=1e-10)
    assert rows[0]["evidence"] == "confirmed" and data["critical-all"]["not_excluded"] == {"own": []}
    assert (tmp_path / "out" / "critical.csv").read_text().startswith("model,modes,size,stability,value,kind,omega,")
    assert len(data["flutter"]["branches"]) == 2 * 21 and len({item["path"] for item in data["files"]}) == 6
    pencil, other = (Scene.from_file(source).models.full.at(mu=0.4, speed=0.1)
                     for source in ("affine", str(tmp_path / "scene.toml")))
    for name in "MDK":
        np.testing.assert_allclose(getattr(pencil.dense(), name), getattr(other.dense(), name), rtol=1e-15)


def test_a_straight_line_is_certified(tmp_path: Path) -> None:
    """Hoffmann's two modes over μ, K's factor written as arithmetic: a straight line in μ, so that no sample is needed."""
    exact = two_mode()
    for name, matrix in (("M", exact.M[0][1]), ("K", exact.K[0][1]), ("KR", [[0.0, 1.0], [0.0, 0.0]])):
        np.save(tmp_path / f"{name}.npy", matrix)
    text = ('[part.modes]\naffine.M = [{matrix = "M.npy"}]\n'
            'affine.K = [{matrix = "K.npy"}, {matrix = "KR.npy", factor = "-2 * share * (mu - 1) / 3 - 2 * share / 3"}]\n'
            '[parameter.share]\nvalue = 2\n[[ask]]\ncritical = "mu"\nbetween = [0, 1.5]\n')
    rows = run(tmp_path, text)["critical"]
    assert [row["value"] for row in rows] == pytest.approx([0.75], abs=1e-10) and rows[0]["evidence"] == "certified"


def test_abaqus_numbers_are_brought_together(tmp_path: Path) -> None:
    """By node and DOF of each entry, in the order of K, without what Abaqus holds; KR has entries of few DOF only."""
    (tmp_path / "M.mtx").write_text("7,1,7,1,2.0\n3,1,3,1,1.0\n9,1,9,1,5.0\n")
    (tmp_path / "K.mtx").write_text("3,1,3,1,4.0\n3,1,7,1,-1.0\n7,1,3,1,-1.0\n7,1,7,1,9.0\n9,1,9,1,1e36\n")
    (tmp_path / "KR.mtx").write_text("7,1,7,1,0.5\n")
    sums = {"M": [{"matrix": "M.mtx"}], "K": [{"matrix": "K.mtx"}, {"matrix": "KR.mtx", "factor": "p"}]}
    scene = Scene({"part": {"own": {"affine": sums}}, "ask": [{"critical": "p", "between": [0, 1]}]}, tmp_path)
    pencil = scene.models.full.at(p=2.0).dense()
    assert np.array_equal(pencil.M, np.diag([1.0, 2.0])) and np.array_equal(pencil.K, [[4.0, -1.0], [-1.0, 10.0]])


def test_a_large_model_is_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Springs of 320 masses of their own, two of them coupled by friction: above the size that discs take."""
    n = 320
    own = 10.0 + np.arange(n) ** 2
    own[:2] = 2.0
    K, KR = sp.lil_array(sp.diags_array(own)), sp.lil_array((n, n))
    K[0, 1] = K[1, 0] = 1.0
    KR[0, 1] = -4 / 3
    for name, matrix in (("M", sp.eye_array(n)), ("D", 0.02 * sp.eye_array(n)), ("K", K), ("KR", KR)):
        sp.save_npz(tmp_path / f"{name}.npz", sp.csc_array(matrix))
    text = ('band = [0.5, 2.5]\n[part.modes]\naffine.M = [{matrix = "M.npz"}]\naffine.D = [{matrix = "D.npz"}]\n'
            'affine.K = [{matrix = "K.npz"}, {matrix = "KR.npz", factor = "mu"}]\n[[ask]]\ncritical = "mu"\nbetween = [0, 1.5]\n')
    data = run(tmp_path, text)
    critical = fs.critical_value(two_mode((0.02, 0.02)), None, "mu", between=(0.0, 1.5)).losses[0]
    row, = data["critical"]
    assert row["value"] == pytest.approx(critical.value, abs=1e-6) and row["omega"] == pytest.approx(critical.omega, rel=1e-5)
    assert (row["stability"], row["kind"], row["evidence"]) == ("lost", "flutter", "certified")
    assert data["critical-all"]["not_excluded"] == {"scene": []}
    (tmp_path / "scene.toml").write_text(text.replace("band = [0.5, 2.5]\n", ""), encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml")]) == 2
    assert "320 DOF needs a band" in capsys.readouterr().err


@pytest.mark.parametrize(("change", "words"), [
    (("mu / speed", "mu / sped"), r"line 12: ask 1: the parameter 'sped' has no value: give \[parameter.sped\] with value"),
    (('critical = "speed"', 'critical = "sped"'), r"line 12: ask 1: unknown parameter 'sped'; did you mean 'speed'"),
    (("parameter.mu", "parameter.nu"), r"parameter.nu: unknown parameter 'nu'; did you mean 'mu'"),
    (('[parameter.mu]\nvalue = 0.4\n', ''), r"the parameter 'mu' has no value: give \[parameter.mu\] with value"),
    (("0.005, 0.2]", "-0.1, 0.2]"), r"'mu / speed' has no value at mu = 0.4, speed = .*: division by"),
    (("0.005, 0.2]", "0.0, 0.2]"), r"'mu / speed' has no value at mu = 0.4, speed = 0: .*division by"),
    (("speed**2", "speed^2"), r"'speed\^2' has \^ \(write \*\* for powers\) in it, but only numbers"),
    (("speed**2", "__import__('os')"), r"K\[3\].* in it, but only numbers, names"),
    (("speed**2", "speed.real"), r"K\[3\].*: 'speed.real' has speed.real in it"),
    (("speed**2", "speed *"), r"K\[3\].* must be an expression such as '1 / speed', not 'speed \*'"),
    (('factor = "speed"', 'factr = "speed"'), r"part.disc.affine.D 3.factr: unknown key 'factr'; did you mean 'factor'"),
    (('factor = "speed"', 'factor = ["speed"]'), r"part.disc.affine.D 3.factor: it must be a string or a number"),
    (("DR.npz", "wide.npz"), r"line 4: part.disc: D\[2\] must be square, but its shape is \(2, 3\)"),
    (("DR.npz", "large.npz"), r"line 4: part.disc: D\[2\] is 3 x 3, but K\[1\] is 2 x 2"),
    (("DR.npz", "none.npz"), r"there is no file .*none.npz"),
    (("pair.mat:KR", "pair.mat:KX"), r"pair.mat has no matrix 'KX'"),
    (("M.mtx", "KX.mtx"), r"there is no file .*KX.mtx"),
    (("between = [0.005, 0.2]\n", "value = 0.1\n"), "ask 1: between is missing: the range of 'speed'"),
    (('affine.M = [{matrix = "M.mtx"}]\n', ""), "part.disc.affine: the key 'M' is missing"),
])
def test_what_does_not_fit_is_told(change: tuple[str, str], words: str, tmp_path: Path,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    sp.save_npz(tmp_path / "wide.npz", sp.csc_array(np.ones((2, 3))))
    sp.save_npz(tmp_path / "large.npz", sp.csc_array(np.eye(3)))
    assert change[0] in OWN
    (tmp_path / "scene.toml").write_text(OWN.replace(*change), encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert re.search(words, said) and said.startswith("femsub: ") and said.count("\n") == 1 + 2 * ("2 faults:" in said), said
    assert not (tmp_path / "out").exists()


def test_growth_at_the_start_of_the_range_is_no_zero_losses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between 0.041 and 0.116 one mode grows."""
    told = run(tmp_path, 'scene = "affine"\nfigures = false\n[[ask]]\ncritical = "speed"\nbetween = [0.06, 0.1]\n')
    assert [row["stability"] for row in told["critical"]] == ["lost at the start"]
    assert "Found. Modes grow from the start of the range of speed." in " ".join(capsys.readouterr().out.split())


def test_a_band_counts_and_an_empty_one_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between 0.5 and 1.1 the mode that grows is outside; above 5 there is none to draw, and the other ask is kept."""
    asks = '[[ask]]\ncritical = "speed"\n[[ask]]\nflutter = "speed"\npoints = 5\n'
    told = run(tmp_path, f'scene = "affine"\nfigures = false\nband = [0.5, 1.1]\nunits = "SI"\n{asks}')
    assert [row["stability"] for row in told["critical"]] == ["never lost"]
    printed = " ".join(capsys.readouterr().out.split())
    assert "modes from 0.5 to 1.1 rad/s (0.07958 to 0.1751 Hz)" in printed and "0 losses" not in printed
    assert told["verdict"]["answer"] == "nowhere" and told["verdict"]["headline"].startswith("Never lost between speed = ")
    (tmp_path / "scene.toml").write_text(f'scene = "affine"\nfigures = false\nband = [5.0, 20.0]\n{asks}', encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) != 0
    told = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert told["critical"] and "has no mode from 5 to 20 rad/time anywhere" in told["failed"]["flutter"]


def test_what_grows_from_the_begin_on_is_told_beside_its_regain(tmp_path: Path) -> None:
    text = 'scene = "affine"\n[parameter.speed]\nbetween = [0.06, 0.2]\n[[ask]]\ncritical = "speed"\n'
    rows = run(tmp_path, text)["critical"]
    assert [row["stability"] for row in rows] == ["lost at the start", "regained"]
    assert rows[1]["value"] == pytest.approx(border(0.4, 0.06, 0.2)[0], abs=1e-10)


# expressions


@pytest.mark.parametrize(("text", "value"), [
    ("1", 1.0), ("-p", -0.7), ("+p - 2", -1.3), ("2 * p**2 / 4 - 1e-3", 2 * 0.49 / 4 - 1e-3), ("p**-2", 0.7**-2),
    ("sqrt(p) + exp(-p / q) * cos(pi * p)", np.sqrt(0.7) + np.exp(-0.35) * np.cos(np.pi * 0.7)),
    ("log(q) ** p + sin(q)", np.log(2.0) ** 0.7 + np.sin(2.0)), ("(1 + q) ** (p - 0.7)", 1.0), ("2 ** q ** p", 2 ** 2**0.7)])
def test_an_expression_has_the_value_that_python_gives(text: str, value: float) -> None:
    one = Expression(text, "factor")
    assert one({"p": 0.7, "q": 2.0}) == pytest.approx(value, rel=1e-14)
    one.check_over("p", (0.2, 1.5), {"q": 2.0})


@pytest.mark.parametrize(("text", "line"), [
    ("3", (3.0, 0.0)), ("p", (0.0, 1.0)), ("1 - p / 4", (1.0, -0.25)), ("2 * (p + 1) - (3 - p) * q", (-4.0, 4.0)),
    ("p ** 1 * sqrt(4)", (0.0, 2.0)), ("q**2 / 2", (2.0, 0.0)), ("p * p", None), ("p**2", None), ("1 / p", None),
    ("exp(p)", None), ("q ** p", None), ("p * q / p", None)])
def test_straight_lines_are_known(text: str, line: tuple[float, float] | None) -> None:
    assert Expression(text, "factor").lines("p", {"q": 2.0}) == line


@pytest.mark.parametrize(("text", "between", "place"), [
    ("1 / (p - 0.3)", (0.0, 1.0), 0.3), ("1 / (p**2 - 0.3)", (0.0, 1.0), 0.3**0.5),
    ("1 / (3 * p - 0.1) ** 2", (0.0, 1.0), 1 / 30), ("p ** -1", (-1.0, 2.0), 0.0), ("log(p - 0.5)", (0.0, 1.0), 0.0),
    ("1 / sin(p)", (3.0, 3.3), np.pi), ("sqrt(p)", (-1.0, 1.0), -1.0), ("1 / (exp(p) - 2)", (0.0, 1.0), np.log(2)),
    ("p ** 0.5", (-1.0, 1.0), -1.0), ("10 ** (400 * p)", (0.0, 1.0), 1.0)])
def test_a_place_without_a_value_is_found_wherever_it_is(text: str, between: tuple[float, float], place: float) -> None:
    """No sample need hit it: ranges are halved about it."""
    with pytest.raises(InputError, match=r"the factor of D\[2\]: .* has no value at p = ") as told:
        Expression(text, "D[2]").check_over("p", between, {})
    assert float(re.findall(r"p = ([-+.e\d]+):", str(told.value))[0]) == pytest.approx(place, abs=1e-7)


@pytest.mark.parametrize("text", ["sqrt(p)", "sqrt(p * p)", "1 / (p * p + 1e-3)", "p ** 0.5 + 1 / (2 + sin(9 * p))",
                                  "sqrt(1 - cos(p))", "1 / (exp(p) - exp(-p) + 1e-6)"])
def test_a_factor_that_is_defined_is_not_refused(text: str) -> None:
    Expression(text, "factor").check_over("p", (0.0, 1.0), {})


@pytest.mark.parametrize("text", ["p if p else 1", "[p]", "p < 1", "p and 1", "lambda: p", "'a'", "True", "1j", "p[0]", "p.x",
                                  "f(p)", "sqrt(p, 1)", "sqrt(x=p)", "sqrt", "p = 1", "p // 2", "p % 2", "",
                                  "(" * 300 + ")" * 300, "1+" * 400 + "1", "(yield p)", "p := 1",
                                  "__import__('os').system('true')", "~p"])
def test_nothing_but_arithmetic_is_taken(text: str) -> None:
    with pytest.raises(InputError, match="the factor of factor"):
        _ = Expression(text, "factor").names


@pytest.mark.parametrize("text", ["p#c", "p # 2", "p\\\n+ 1", "(p#)\n)"])
def test_a_comment_is_no_arithmetic(text: str) -> None:
    with pytest.raises(InputError, match="in it, but only"):
        Expression(text, "K[1]")


def test_an_oscillation_that_no_search_can_follow_is_refused() -> None:
    """A run took 42 s, and said nothing of it."""
    for text in ("sin(p*1e9)+2", "1 / (cos(exp(30 * p)) + 2)", "1 / sin(1 / (p - 0.1 + 1e-9))"):
        with pytest.raises(InputError, match="more than 100 periods"):
            Expression(text, "K[1]").check_over("p", (0.1, 1.0), {})
    Expression("sin(100 * p) + 2", "K[1]").check_over("p", (0.1, 1.0), {})


@pytest.mark.parametrize("factor", ["p-p+1", "p*0+1", "p**0"])
def test_a_parameter_that_cancels_is_named(factor: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was unknown, although it is written there."""
    written(tmp_path)
    (tmp_path / "scene.toml").write_text('[part.disc]\naffine.M = [{matrix = "M.mtx"}]\naffine.K = [{matrix = "K1.mtx"}, '
                                         f'{{matrix = "pair.mat:KR", factor = "{factor}"}}]\n[[ask]]\ncritical = "p"\n'
                                         'between = [0.1, 1.0]\n', encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml")]) == 2
    assert "no factor changes with 'p'" in capsys.readouterr().err


def test_a_factor_is_pickled_and_tells_its_parameter() -> None:
    import pickle

    factor = Factor(Expression("mu / speed", "D[2]"), ("speed",), (("mu", 0.4),))
    model = pickle.loads(pickle.dumps(fs.Affine([[1.0]], [(factor, [[1.0]])], [[1.0]])))
    assert model.parameters == ("speed",) and model.at(speed=2.0).D[0, 0] == pytest.approx(0.2)


def test_rows_of_different_lengths_are_refused(tmp_path: Path) -> None:
    """They ended in a traceback of NumPy's."""
    text = text_of("affine").replace("[[2e-3, 0.0], [0.0, 2e-3]]", "[[2e-3, 0.0], [2e-3]]")
    (tmp_path / "my.toml").write_text(text)
    with pytest.raises(fs.InputError, match=r"part.disc: D\[1\] must be rows of the same length"):
        Scene.from_file(tmp_path / "my.toml").models.full.at(speed=0.1, mu=0.4)
    beam = {"beam": 1.0, "material": "steel", "width": 0.02, "height": 0.01, "left": "clamped", "ports": {"n": 0.5, "t": 1.0}}
    table = {"material": {"steel": {"E": 2.1e11, "rho": 7850.0}}, "part": {"b": beam}, "ask": [{"complex-modes": "full"}],
             "contact": {"c": {"linear": ["b.n", "b.t"], "stiffness": [[1.0, 0.0], [0.0]]}}}
    with pytest.raises(fs.InputError, match="stiffness must be rows of the same length"):
        Scene(table).run(print)
    with pytest.raises(fs.InputError, match="M must be rows of the same length"):
        fs.Substructure([[1.0, 0.0], [1.0]], [[1.0, 0.0], [0.0, 1.0]])


def test_a_value_that_the_ask_gives_needs_no_other() -> None:
    """The value of an ask counted only if [parameter.speed] had one as well."""
    table = {"scene": "affine", "ask": [{"complex-modes": "full", "at": {"speed": 0.1}}]}
    found = Scene(table).run(print).data["complex-modes"]["models"][0]["eigenvalues"]
    family = Scene({"scene": "affine"}).models.full
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(fs.complex_modes(family.at(speed=0.1, mu=0.4)).eigenvalues))
    with pytest.raises(fs.InputError, match=r"'speed' has no value: give \[parameter.speed\] with value"):
        Scene({"scene": "affine", "ask": [{"complex-modes": "full"}]}).run(print)


def test_the_band_of_an_ask_holds_for_a_pencil_too() -> None:
    """It was ignored there; and the sensitivities needed a value of [parameter.speed] beside that of the ask."""
    def omega(kind: str, asked: Any, **more: Any) -> list[float]:
        data = Scene({"scene": "affine", "ask": [{kind: asked, "at": {"speed": 0.1}, **more}]}).run(print).data[kind]
        rows = data if isinstance(data, list) else [{"omega": one.imag} for one in data["models"][0]["eigenvalues"]]
        return sorted(float(row["omega"]) for row in rows if row["omega"] > 0)

    low, high = omega("complex-modes", "full")
    assert omega("complex-modes", "full", band=[0.0, (low + high) / 2]) == pytest.approx([low], rel=1e-9)
    assert omega("sensitivities", ["speed"]) == pytest.approx([high], rel=1e-9)  # the mode that grows
    assert omega("sensitivities", ["speed"], band=[low / 2, (low + high) / 2]) == pytest.approx([low], rel=1e-9)



@pytest.mark.parametrize(("lines", "words"), [
    ("[reduce]\nmethods = ['craig-bampton']", "its only method is methods = ['box']"),
    ("[reduce]\nmodes = [1]", "its only method is methods = ['box']"), ("[reduce]\nmethods = ['box']", "give band, e.g. band")])
def test_a_pencil_of_matrices_is_reduced_by_a_box_alone(lines: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(f"scene = 'affine'\n{lines}\n")
    with pytest.raises(fs.InputError, match=re.escape(words.replace("'box'", '"box"'))):
        Scene.from_file(path)
    path.write_text("scene = 'affine'\nband = [0, 3]\n[reduce]\nmethods = ['box']\n")  # as the remedies say
    branches = Scene.from_file(path).run(print).data["flutter"]["branches"]
    assert {row["model"] for row in branches} == {"box"} and len({row["branch"] for row in branches}) == 2
