"""The keys of scene files: told once, and shown by `femsub keys`, `femsub new` and the schema as they are checked."""

from __future__ import annotations

import dataclasses
import logging
import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_cycle_scenes
import test_fe_scenes
import test_matrix_scene
import test_runs_that_fail
import test_scene
import test_transient_scenes

from femsub.app import explain
from femsub.app.cli import main
from femsub.app.keys import check_keys, item_kind, key, keys_of, values_of
from femsub.app.scene import SCENES, load, scene_of
from femsub.app.units import SYSTEMS
from femsub.checks import installed_by
from femsub.errors import InputError
from femsub.studies import span

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft7Validator.check_schema(explain.schema())
    return jsonschema.Draft7Validator(explain.schema())


def scene_texts() -> dict[str, str]:
    """Every scene in the tree: files, and blocks of the documentation."""
    files = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in ROOT.glob("*/*.toml")}
    blocks = {f"{path.name} {number}": text for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
              for number, text in enumerate(re.findall(r"```toml\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL))
              if "scene = " in text}
    return files | blocks


def wrong_texts() -> list[str]:
    """The wrong scenes of the tests."""
    def listed(test: Any) -> list[Any]:
        return list(test.pytestmark[-1].args[1])

    texts = [text for test in (test_scene.test_bad_scene_ends_in_one_line, test_fe_scenes.test_bad_input_ends_in_one_line,
                               test_transient_scenes.test_bad_scenes_are_refused) for text, _ in listed(test)]
    texts += [f'scene = "chain-limit-cycle"\n{text}' for text, _ in listed(test_cycle_scenes.test_a_bad_scene_ends_in_one_line)]
    texts += [test_matrix_scene.SCENE.replace(*change) for change, _ in listed(test_matrix_scene.test_a_scene_with_bad_names)]
    return [*texts, *test_runs_that_fail.ODD]


#: What no schema can see, by a piece of the text: bounds that depend on other keys, what is in files and meshes, the order
#: within a pair, NaN and Inf, numbers that rounding spoils, models beyond the memory, and what only the computation finds.
UNSEEN = (
    "belt = 11", "belts = [1, 12]", "sizes = [12]", "size = 1", "modes = [401]", "time = [0, 100]", "E = [1.0, 2.0]", '.vtu"',
    '"K.mtx"\nport = 0\nband', "/dev/zero", '"L.dof"', '"4:uy"', "port = 20", 'K = "K.dof"', "[9.0, 9.0]", "0.3501",
    "band = [1.0, 0.5]", "band = [2.0, 1.0]", "time = [5, 1]", "nan", "inf", "1e308", "1e200", "1e-300", "1e-320", "100000",
    "force = 0.001")


@pytest.mark.parametrize("name", SCENES)
def test_every_field_of_a_scene_is_a_key_that_is_explained(name: str) -> None:
    scene = scene_of(name)[0]
    without = {"folder", "own", *scene.WITHOUT}
    known = keys_of(scene)
    assert set(known) == {item.name for item in dataclasses.fields(scene)} - without
    assert all(one.meaning and not one.meaning.endswith(".") for one in known.values())


@pytest.mark.parametrize("text", scene_texts().values(), ids=list(scene_texts()))
def test_the_schema_takes_every_scene_in_the_tree(validator: Any, text: str) -> None:
    assert not [error.message for error in validator.iter_errors(tomllib.loads(text))]


def test_the_schema_rejects_the_wrong_scenes_of_the_tests(validator: Any) -> None:
    rejected, taken = [], []
    for text in wrong_texts():
        try:
            table = tomllib.loads(text)
        except (ValueError, RecursionError):  # also of a number with too many digits
            continue
        (taken if validator.is_valid(table) else rejected).append(text)
    assert len(rejected) > 40
    assert not [text for text in taken if not any(unseen in text for unseen in UNSEEN)]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_s_own_schema_says_what_the_schema_of_all_says(name: str) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    every, own = (jsonschema.Draft7Validator(made) for made in (explain.schema(), explain.scene_schema(name)))
    for text in [*scene_texts().values(), *wrong_texts()]:
        try:
            table = tomllib.loads(text)
        except (ValueError, RecursionError):  # also of a number with too many digits
            continue
        if table.get("scene", "chain") == name:
            assert own.is_valid(table) == every.is_valid(table), text


@pytest.mark.parametrize("name", SCENES)
def test_a_new_file_runs_as_it_is_and_shows_the_defaults(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", name]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"#:schema {explain.FILE}\n")
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    scene, _ = load(str(tmp_path / "my.toml"))
    if name not in ("matrices", "own-parts", "superelements"):  # which have no defaults for their files
        assert dataclasses.replace(load(name)[0], **({"folder": str(tmp_path)} if hasattr(scene, "folder") else {})) == scene
    shown = re.findall(r"^#?(\w+) = ", text, re.MULTILINE)
    own = keys_of(scene_of(name)[0])
    tables = [inner for one in own.values() if dataclasses.is_dataclass(inner := item_kind(one.type))]
    within = {key for table in tables for key in keys_of(table)}
    assert sorted(set(shown) - within | {"scene"}) == sorted({"scene", *(key for key in own if key not in within
                                                              and not dataclasses.is_dataclass(item_kind(own[key].type)))})
    assert within <= set(shown) and (tables or len(shown) == len(set(shown)))
    # each key that shows its default, without the #
    keys = re.split(r"\n#?\[\[", text)[0]
    blocks = [block for block in keys.split("\n\n")[1:] if "; an example)" not in " ".join(block.split("\n# "))]
    plain = re.sub(r"^#(\w+ = )", r"\1", "\n\n".join(blocks), flags=re.MULTILINE)
    values = tomllib.loads(plain)
    assert values.pop("scene", name) == name
    for field, value in values.items():
        found = getattr(scene, field)
        rounded = all(isinstance(item, float) for item in (found if isinstance(found, list) else [found]))
        assert value == (pytest.approx(found, rel=1e-14) if rounded else found), field


@pytest.mark.parametrize("name", SCENES)
def test_the_schema_takes_a_new_file_with_every_key(validator: Any, name: str) -> None:
    text = explain.new_text(name)
    assert validator.is_valid(tomllib.loads(text))
    assert not list(validator.iter_errors(tomllib.loads(re.sub(r"^#(\w+ = |\[)", r"\1", text, flags=re.MULTILINE))))


@pytest.mark.parametrize("name", SCENES)
def test_keys_are_listed_with_type_unit_default_and_meaning(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", name]) == 0
    text = capsys.readouterr().out
    for field, one in keys_of(scene_of(name)[0]).items():
        entry = re.search(rf"^{field} +(.+(?:\n +.+)+)", text, re.MULTILINE)
        assert entry is not None
        said = " ".join(entry[1].split())
        assert one.meaning in said and f"[{one.unit}]" in said + "[]" * (not one.unit)


# tables within a scene


@dataclass(frozen=True)
class Part:
    """A part of a system."""

    mesh: str = key("", "the part's mesh file", required=True, example="part.msh")
    length: float = key(1.0, "the part's length", unit="m", above=0)
    held: list[str] = key([], "sets that are held", otherwise="none", example=["left"])


@dataclass(frozen=True)
class Joint:
    """A joint between two parts."""

    parts: list[str] = key([], "the two parts", form="[one, other]", required=True, example=["left", "right"])
    kind: str = key("rigid", "its kind", choices=lambda _: ("rigid", "springs"))


@dataclass(frozen=True)
class System:
    """Parts and joints."""

    name: str = key("", "the name", otherwise="none", example="pair")
    parts: list[Part] = key([], "the parts", required=True, example=[Part("a.msh"), Part("b.msh", 2.0)])
    joints: list[Joint] = key([], "the joints", otherwise="none")


def test_a_key_may_be_a_list_of_tables() -> None:
    table = tomllib.loads('name = "two"\n[[parts]]\nmesh = "a"\nlength = 3\n[[parts]]\nmesh = "b"\nheld = "left"\n'
                          '[[joints]]\nparts = ["a", "b"]\n')
    system = System(**values_of(System, table))
    assert system == System("two", [Part("a", 3.0), Part("b", held=["left"])], [Joint(["a", "b"])])
    check_keys(system)


@pytest.mark.parametrize(("text", "words"), [
    ('[[parts]]\nmesh = "a"\n[[parts]]\nlenth = 1', r"unknown scene key 'parts\[2\].lenth'; did you mean 'parts\[2\].length'"),
    ('[[parts]]\nmesh = "a"\nlength = 0.0', r"parts\[1\].length must be positive, but is 0.0"),
    ("[[parts]]\nlength = 1.0", r"scene key 'parts\[1\].mesh' is missing"),
    ('[[parts]]\nmesh = 3', r"scene key 'parts\[1\].mesh' must be a string, not 3"),
    ('parts = ["a"]', "scene key 'parts' must be a list of tables"),
    ('[[parts]]\nmesh = "a"\n[[joints]]\nparts = ["a"]', r"joints\[1\].parts must be \[one, other\]"),
    ('[[parts]]\nmesh = "a"\n[[joints]]\nparts = ["a", "b"]\nkind = "rigit"', "did you mean 'rigid'"),
])
def test_what_is_wrong_in_a_table_is_named_and_the_schema_rejects_it(text: str, words: str) -> None:
    table = tomllib.loads(text)
    with pytest.raises(InputError, match=words):
        values_of(System, table)
    jsonschema = pytest.importorskip("jsonschema")
    assert not jsonschema.Draft7Validator(explain._table(System, explain.defaults_of(System))).is_valid(table)


def test_parts_that_are_shown_as_an_example_say_where_they_come_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without the # at their files the new scene file was refused for what it lacks, not for the files that are not there."""
    parts = tomllib.loads(explain.new_text("own-parts"))["parts"]
    assert [sorted(part) for part in parts] == [["K", "M", "interface", "name", "port"], ["interface", "mesh", "name"]]
    (tmp_path / "my.toml").write_text(explain.new_text("own-parts"), encoding="utf-8")
    assert main(["run", str(tmp_path / "my.toml")]) == 2
    assert "there is no file" in capsys.readouterr().err


def test_tables_are_listed_and_written_as_a_file_to_begin_with() -> None:
    defaults = explain.defaults_of(System)
    listed = "\n".join(explain._listed(System, defaults, ""))
    assert re.search(r"^ +length +a number above 0 \[m\]; default: 1.0$", listed, re.MULTILINE)
    text = "\n".join(explain._template(System, defaults, ""))
    assert tomllib.loads(text) == {"parts": [{"mesh": "a.msh"}, {"mesh": "b.msh", "length": 2.0}]}
    whole = tomllib.loads(re.sub(r"^#(\w+ = |\[)", r"\1", text, flags=re.MULTILINE))
    assert whole["parts"][1] == {"mesh": "b.msh", "length": 2.0, "held": ["left"]}
    assert whole["joints"] == [{"parts": ["left", "right"], "kind": "rigid"}]
    assert System(**values_of(System, whole)).parts[0].length == 1.0


# the command line


def femsub(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "femsub", *words], capture_output=True, text=True, check=False)


def test_python_m_femsub_is_the_command_and_knows_its_version() -> None:
    import femsub as package

    done = femsub("--version")
    assert done.returncode == 0 and done.stdout == f"femsub {package.__version__}\n"


@pytest.mark.parametrize("words", ["--version", "scenes", "new beem", "completion bash"])
def test_what_computes_nothing_loads_no_numpy(words: str) -> None:
    program = ("import atexit, sys; atexit.register(lambda: print('numpy' in sys.modules, 'scipy' in sys.modules)); "
               "from femsub.app.cli import main; main(sys.argv[1:])")
    done = subprocess.run([sys.executable, "-c", program, *words.split()], capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "False False"


def test_quiet_prints_nothing_and_verbose_tells_what_is_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.toml").write_text('n = 6\nsizes = [3]\noutputs = ["size-sweep", "eigenvalues"]\n', encoding="utf-8")
    run, listening = ["run", str(tmp_path / "scene.toml"), "--no-figures"], list(logging.getLogger("femsub").handlers)
    assert main([*run, "--quiet", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert not printed.out and not printed.err and (tmp_path / "out" / "results.json").exists()
    assert main([*run, "-v"]) == 0
    told = capsys.readouterr()
    assert "Complex modes" in told.out and all(line.startswith("femsub: ") for line in told.err.splitlines())
    assert "femsub: chain: eigenvalues" in told.err.splitlines()
    assert main([*run, "-vv"]) == 0
    assert len(capsys.readouterr().err) > len(told.err)
    assert main(run) == 0 and not capsys.readouterr().err  # the log of one run is not that of the next
    assert logging.getLogger("femsub").handlers == listening


def test_quiet_still_tells_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "chian", "--quiet"]) == 2 and "did you mean 'chain'" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "offered"), [
    (["femsub", "ru"], {"run"}), (["femsub", "run", "chain-t"], {"chain-transient"}), (["femsub", "new", "bea"], {"beam"}),
    (["femsub", "run", "chain", "--no"], {"--no-figures"}), (["femsub", "run", "mine"], {"mine.toml", "mine.py", "mine.json"})])
def test_bash_completes_commands_scenes_and_files(words: list[str], offered: set[str], tmp_path: Path,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    (tmp_path / "femsub.bash").write_text(capsys.readouterr().out, encoding="utf-8")
    for ending in ("toml", "py", "json", "txt"):
        (tmp_path / f"mine.{ending}").touch()
    program = (f". ./femsub.bash; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _shtab_femsub; "
               'echo "${COMPREPLY[@]}"')
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert set(done.stdout.split()) == offered, done.stderr


def test_every_wrong_key_is_told() -> None:
    with pytest.raises(InputError) as told:
        values_of(scene_of("chain")[0], {"siize": 4, "n": "ten", "zzzz": 1, "interfase": [1], "sizes": []})
    for words in ("'n' must be a whole number", "'siize'; did you mean 'size'?", "'zzzz'; ", "'sizes' is an empty list",
                  "'interfase'; did you mean 'interface'?"):
        assert words in str(told.value)
    assert str(told.value).count("alid: ") == 1


def test_a_band_may_be_given_in_hertz_and_comes_back_as_given() -> None:
    kind = scene_of("plate")[0]
    for band in (["500 Hz", "5 kHz"], ["500Hz", "5000.0 Hz"], [1000 * np.pi, "5e3 Hz"]):
        assert values_of(kind, {"units": "SI", "band": band})["band"] == pytest.approx([1000 * np.pi, 10_000 * np.pi], rel=1e-15)
    assert SYSTEMS["SI"].said(span((1000 * np.pi, 10_000 * np.pi))).endswith("(500 to 5000 Hz)")
    for table, words in (({"band": [0, "5 kHz"]}, 'give units, e.g. units = "SI"'), ({"units": "SI", "band": [0, "5 kHertz"]},
                                                                                   "must be a list of numbers"),
                         ({"units": "SI", "thickness": "5 Hz"}, "'thickness' must be a number")):
        with pytest.raises(InputError, match=words):
            values_of(kind, table)


def test_without_shtab_it_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 1
    assert installed_by("shtab") in capsys.readouterr().err


def test_whoever_listens_is_told_what_was_factorised_solved_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    import femsub as fs

    assert any(isinstance(handler, logging.NullHandler) for handler in logging.getLogger("femsub").handlers)
    beam = fs.beam(1.0, 80, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"}, interface=["right"])
    with caplog.at_level(logging.DEBUG, "femsub"):
        rom = fs.reduce(beam, fs.CraigBampton(modes=4))
        modes = fs.complex_modes(rom)
    told = [(record.name, record.levelname, record.getMessage()) for record in caplog.records]
    assert ("femsub.reduction.reduce", "INFO", repr(rom)) in told
    assert ("femsub.modes.quadratic.complex_modes", "INFO", repr(modes)) in told
    assert any(name == "femsub.algebra.factor" and level == "INFO" and "definite" in text for name, level, text in told)
    assert any("negative" in text for _, level, text in told if level == "DEBUG")
