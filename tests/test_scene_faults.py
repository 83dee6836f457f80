"""What is wrong with a scene file is refused before anything is computed: all of it at once, each fault with its line."""

from __future__ import annotations

import random
import re
import warnings
from pathlib import Path

import pytest

import femsub as fs
from femsub.app.grammar import Scene, text_of
from femsub.app.models import Models
from femsub.checks import InputError
from femsub.io import line_numbers

#: built-in scenes that need no files
SCENES = ("chain", "beam", "plate", "solid", "frequency-response", "plate-parts", "solid-parts", "brake", "chain-transient",
          "plate-limit-cycle", "two-mode", "affine")
ASSIGNED = re.compile(r"^([a-zA-Z_-]+) = (.*)$")
WORDS = re.compile(r'"([\w.]+)"')


def mutated(text: str, rng: random.Random) -> tuple[str, int, str]:
    """A scene file with one fault: the text, the line of the fault, and a word that the message must have."""
    lines = text.split("\n")
    keyed = [at for at, line in enumerate(lines) if ASSIGNED.match(line) and not line.startswith(("name", "note", "vary"))]
    while True:
        at = rng.choice(keyed)
        key, value = ASSIGNED.match(lines[at]).groups()  # type: ignore[union-attr]
        kind = rng.choice(("key", "type", "name", "number", "ask", "part"))
        if kind == "key":
            wrong = key[:-1] + "qq"
            lines[at] = f"{wrong} = {value}"
            return "\n".join(lines), at + 1, wrong
        if kind == "type" and re.fullmatch(r"[-+.\de]+", value):
            lines[at] = f'{key} = "much"'
            return "\n".join(lines), at + 1, "much"
        if kind == "number" and re.fullmatch(r"[+.\de]+", value) and key in (
                "E", "rho", "thickness", "stiffness", "width", "height", "force", "chain", "elements", "points", "repeats"):
            lines[at] = f"{key} = -3"
            return "\n".join(lines), at + 1, "must"
        if kind == "name" and key in ("material", "supports", "clamped", "interface", "belt", "friction", "tied", "spring",
                                      "mount",
                                      "law", "methods", "compare") and (words := WORDS.findall(value)):
            word = rng.choice(words)
            lines[at] = lines[at].replace(f'"{word}"', f'"{word}qq"')
            return "\n".join(lines), at + 1, f"{word.rpartition('.')[2]}qq"
        if kind == "ask":
            return f"{text}\n[[ask]]\nmodes-per-prt = 1e-3\n", len(lines) + 1, "unknown kind of ask"
        if kind == "part":
            return f"{text}\n[part.lone]\nchain = 3\n", len(lines) + 1, "joined to nothing"


@pytest.mark.parametrize(("text", "words"), [
    ('scene = "chain"\n[[ask]]\ncompare = []\n', "line 3: ask 1.compare: it is an empty list. Give one at least of growth"),
    ('scene = "chain"\n[[ask]]\ncritical = "slope"\nvary = {"contact.belt.speed" = [1.0, 2.0]}\n',
     "vary: 'contact.belt.speed' changes nothing, since the slope"),
    *((f'scene = "chain"\n[contact.belt]\nslope = -0.1\n[[ask]]\n{ask}\n', "line 4: ask 1: contact belt: the nonlinear model")
      for ask in ("motion = [0, 10]", "compare-motion = 12.0", "cycles = 1", 'branch = "force"')),
    ('[part.rod]\nmatrices = {M = "M.mtx", K = "K.mtx"}\n[contact.rub]\nbelt = "rod.there"\nforce = 1.0\nspeed = 1.0\n[[ask]]\n'
     'critical = "slope"\n', r"'rod' has no port 'there'. Give it one in \[part.rod\], by ports"),
])
def test_what_would_do_nothing_is_refused_with_what_to_do(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        Scene.from_file(tmp_path / "my.toml")


def test_own_matrices_in_a_built_in_scene_have_parameters_of_their_own(tmp_path: Path) -> None:
    """A file cannot take away a table of the scene that it begins with."""
    (tmp_path / "my.toml").write_text(
        'scene = "affine"\n[part.disc]\naffine.M = {matrix = [[1.0]]}\naffine.D = {matrix = [[1.0]], factor = "p"}\n'
        'affine.K = {matrix = [[2.0]]}\n[parameter.p]\nbetween = [-1.0, 2.0]\n[[ask]]\ncritical = "p"\n', encoding="utf-8")
    assert set(Scene.from_file(tmp_path / "my.toml").parameters) == {"p"}
    (tmp_path / "my.toml").write_text('scene = "affine"\n[parameter.mu]\nvalue = 0.2\n', encoding="utf-8")
    assert set(Scene.from_file(tmp_path / "my.toml").parameters) == {"speed", "mu"}


@pytest.mark.parametrize("name", SCENES)
def test_a_mutated_scene_is_refused_with_its_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def computed(*_: object) -> None:
        raise AssertionError("a model was made")

    monkeypatch.setattr(Models, "_build", computed)
    rng, text, path = random.Random(name), text_of(name), tmp_path / "scene.toml"
    for _ in range(18):
        changed, line, word = mutated(text, rng)
        path.write_text(changed, encoding="utf-8")
        with pytest.raises(InputError) as caught:
            Scene.from_file(path)
        said = str(caught.value)
        # a table whose kind is misspelt is named by its header
        assert any(f"line {at}: " in said for at in (line, line - 1)) and word in said, (line, word, said)
        assert said.startswith(str(path))


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("""name = "t"
band = [0, "8 kHz"]
[part.x]
beam = 1.0
interfase = ["right"]
[part.y]
solid = {radii = [0.05, 0.15], thickness = 0.01, elements = [2, 12, 1]}
material = "stel"
supports = ["iner"]
[[joint]]
rigid = ["x", "w.top"]
[[contact]]
friction = ["y.topp", "ground"]
stiffness = -1.0
[[ask]]
critical = "mu"
[[ask]]
foo = 3
""", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Scene.from_file(path)
    lines = str(caught.value).splitlines()
    assert lines[0] == f"{path}, {len(lines) - 1} faults:"
    assert [int(re.search(r"line (\d+):", line)[1]) for line in lines[1:]] == [2, 3, 5, 8, 9, 11, 14, 17]  # type: ignore[index]


def test_lines_of_tables_lists_and_texts() -> None:
    found = line_numbers('a = 1\n[part.x]\nM = [\n  1,\n  2]\n[[ask]]\nb = """\nc = 3\n"""\n[[ask]]\nd.e = {f = '
                         '1}\n[[part.x.y]]\ng = 2\n')
    assert found["a",] == 1 and found["part", "x"] == 2 and found["part", "x", "M"] == 3
    assert found["ask", 0] == 6 and found["ask", 0, "b"] == 7 and ("ask", 0, "c") not in found
    assert found["ask", 1] == 10 and found["ask", 1, "d", "e", "f"] == 11 and found["part", "x", "y", 0, "g"] == 13


@pytest.mark.parametrize(("lines", "why"), [
    ("[[ask]]\nflutter = 'mu'", "unknown parameter 'mu'"),
    ("[[ask]]\ncritical = 'force'", "between is missing"),
    ("[[ask]]\ncompare = ['growth']", "needs reduced models"),
    ("[[ask]]\nresponse = ['chain.tip']", "unknown port of 'chain' 'tip'"),
    ("[[ask]]\nmodes-per-part = 1e-3", "needs several parts"),
    ("[contact.belt]\nslope = -0.1\n[[ask]]\ncycles = 1", "needs a friction law"),
    ("[[ask]]\ncomplex-modes = 'all'\nat = {nu = 0.3}", "unknown parameter 'nu'"),
    ("[[ask]]\nmap = ['slope', 'force']", "between is missing"),
    ("[[ask]]\nhelps = {force = 1.0}", "is no change"),
])
def test_an_analysis_that_cannot_be_is_refused(lines: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f"[part.chain]\nchain = 4\n{'' if '[contact' in lines else '[contact.belt]'}\n{lines}\n".replace(
        "[contact.belt]\n", "[contact.belt]\nbelt = 'chain.belt'\n", 1), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(why)) as caught:
        Scene.from_file(path)
    assert re.search(r"line \d+: ask 1", str(caught.value))


def test_a_small_model_has_all_modes_that_are_asked_for() -> None:
    """A model of 10 DOF had a default band up to its 4th mode, not its 8th, and one of 3 DOF listed one mode of three."""
    chain = {"part": {"chain": {"chain": 10}}, "ask": [{"modes": 20}]}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = Scene(chain)
        omega = fs.chain_frequencies(10)
        assert scene.models.band == pytest.approx((0.0, 1.02 * omega[7]))
        assert len(scene.run(print).data["modes"]["rows"]) == 10
    assert not caught
    small = Scene({"part": {"chain": {"chain": 3}}, "ask": [{"modes": 1}]})
    assert [row["omega"] for row in small.run(print).data["modes"]["rows"]] == pytest.approx(fs.chain_frequencies(3))
    for wrong in (0, -3):
        with pytest.raises(fs.InputError, match="modes: it must be at least 1"):
            Scene({"scene": "chain", "ask": [{"modes": wrong}]})


def test_an_analysis_over_a_parameter_without_a_contact_names_the_remedy() -> None:
    table = {"part": {"c": {"chain": 4}}, "ask": [{"critical": "slope"}]}
    with pytest.raises(fs.InputError, match=r"give a contact that has it, such as \[contact.rub\] with belt"):
        Scene(table)
    Scene({**table, "contact": {"rub": {"belt": "c.belt"}}})


@pytest.mark.parametrize(("units", "E", "rho", "fine"), [
    ("mm-t-s", 2.1e5, 7.85e-9, True), ("SI", 2.1e11, 7850.0, True), ("", 2.1e5, 7850.0, True), ("SI", 1e6, 1.5, True),
    ("mm-t-s", 2.1e11, 7850.0, False), ("mm-t-s", 2.1e5, 7850.0, False), ("mm-t-s", 2.1e11, 7.85e-9, False),
    ("SI", 2.1e5, 7.85e-9, False)])
def test_a_material_in_other_units_than_the_scene_is_noticed(units: str, E: float, rho: float, fine: bool) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = Scene({"scene": "beam", **({"units": units} if units else {}), "material": {"steel": {"E": E, "rho": rho}}})
        scene.varied({"part.beam.beam": 2.0})
    assert fine == (not caught) and (fine or "No solid is like that: E or rho are in other units" in str(caught[0].message))
    assert len(caught) < 2
