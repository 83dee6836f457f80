"""The keys of scene files: told once, and shown by `femsub keys`, `femsub new` and the schema as they are checked."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import logging
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_runs_that_fail
import test_scene

from femsub.app import explain
from femsub.app.asks.modes import ModesAsk
from femsub.app.cli import main
from femsub.app.grammar import Scene, built_in, text_of
from femsub.app.kinds import FAMILIES, Kinds
from femsub.checks import InputError, installed_by
from femsub.io import (
    Faults,
    Key,
    alternatives,
    first_line,
    item_type,
    key,
    keys_of,
    listed_keys,
    parsed_toml,
    read_table,
    spelt as spelt_key,
    table_schema,
    toml,
    toml_text,
)
from femsub.output import SYSTEMS, span

ROOT = Path(__file__).parent.parent
SCENES = list(built_in())
#: all tables of scene files by the names that `femsub keys` has for them
TABLES = explain.TABLES | {f"{family}.{name}": Kinds().kind(family, name) for family in FAMILIES
                           for name in Kinds().names(family)}
SHAPE = table_schema  # the schema of a table
#: keys that exclude others
ALONE = {"parameter": ("material", "mass", "spring", "damper")}
#: a number, a text, a list, a table and a truth, so that every key refuses one of them
OTHERS = (3.5, "strange", [["x"]], {"strange": 1}, True)


@pytest.fixture(scope="module")
def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft7Validator.check_schema(explain.schema())
    return jsonschema.Draft7Validator(explain.schema())


def scene_texts() -> dict[str, str]:
    """Every scene in the tree: files, and blocks of the documentation."""
    files = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
             for path in [*ROOT.glob("*/*.toml"), *ROOT.glob("femsub/app/scenes/*.toml")]}
    blocks = {f"{path.name} {number}": text for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
              for number, text in enumerate(re.findall(r"```toml\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL))
              if "scene = " in text or "[[ask]]" in text}
    return files | blocks


def wrong_texts() -> list[str]:
    """The wrong scenes of the tests."""
    return [*(text for text, _ in test_scene.BAD), *test_runs_that_fail.ODD]


#: What no schema can see, by a piece of the text: names that refer to others, bounds that depend on other keys, what is in files,
#: the order within a pair, NaN and Inf, numbers that rounding spoils, and what only the computation finds.
UNSEEN = (
    "vary =", "belt = 11", "interface = [1, 1]", "sizes = [12]", "sizes = [1]", "modes = 3\n", '"M.mtx"', "chian.",
    "chain.bolt", "band = [1.0, 0.5]", "nan", "inf", "1e308", "1e200", "1e-300", "1e-320", "100000", "ask = []",
    "/dev/zero", "craig-bampten")


def test_the_schema_leaves_kinds_of_ones_own_alone(validator: Any) -> None:
    own = 'part.chain.chain = 4\nask = [{places = 3}]\n'
    assert not validator.is_valid(tomllib.loads(own)) and validator.is_valid(tomllib.loads(f'use = ["mine.py"]\n{own}'))
    assert not validator.is_valid(tomllib.loads(f'use = ["mine.py"]\n{own}part.chain.damping = -1'))


def whole(name: str) -> dict[str, Any]:
    """A table with all its keys, each with its example or its default."""
    kind = TABLES[name]
    table = {spelt_key(kind, field): one.default if one.example is None else one.example
             for field, one in keys_of(kind).items()}
    left_out = ALONE.get(name, ())[1:]
    return {spelt: value for spelt, value in table.items() if value not in (None, "", [], {}) and spelt not in left_out}


def faults_of(kind: Any, table: dict[str, Any]) -> list[str]:
    faults = Faults()
    read_table(kind, table, (), faults)
    return [text for _, text in faults.found]


@pytest.mark.parametrize("name", TABLES)
def test_every_field_of_a_table_is_a_key_that_is_explained(name: str) -> None:
    kind = TABLES[name]
    known = keys_of(kind)
    assert set(known) == {item.name for item in dataclasses.fields(kind)} - set(getattr(kind, "WITHOUT", {}))
    assert all(one.meaning and not one.meaning.endswith(".") for one in known.values())
    assert all(one.example is not None for one in known.values() if one.required)
    if name not in explain.TABLES:
        assert next(iter(known)) == kind.KIND.replace("-", "_") and kind.__doc__ != kind.__mro__[1].__doc__


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
    assert len(rejected) >= 30
    assert not [text for text in taken if not any(unseen in text for unseen in UNSEEN)]


@pytest.mark.parametrize("name", TABLES)
def test_a_table_with_every_key_is_taken_by_the_checks_and_by_the_schema(name: str) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    table = whole(name)
    assert not faults_of(TABLES[name], table)
    assert not list(jsonschema.Draft7Validator(SHAPE(TABLES[name])).iter_errors(table))
    assert not table or faults_of(TABLES[name], table | {"strange": 1})


def wrong_values(one: Key) -> Iterator[Any]:
    """Values that a key cannot have: beyond each of its bounds, another word, a list of another length, one value twice."""
    whole_ones = int in alternatives(one.type) or list[int] in alternatives(one.type)
    step = 1 if whole_ones else 1e-6
    numbers = [bound for bound in (one.above, one.below) if bound is not None]
    numbers += [one.least - step] if one.least is not None else []
    numbers += [one.most + step] if one.most is not None else []
    words = ["strange"] * (one.choices is not None)
    listed = any(item_type(kind) for kind in alternatives(one.type))
    bare = not listed or one.length is None  # of a list of fixed length no value stands alone
    yield from (value for value in [*numbers, *words] if bare)
    if listed:
        length = one.length or 1
        yield from ([value] * length for value in [*numbers, *words])
    if one.length:
        yield [1.0 + at for at in range(one.length + 1)]
    if one.distinct:
        yield [1, 1]
    if listed:
        yield []


@pytest.mark.parametrize("name", TABLES)
def test_the_bounds_and_types_of_each_key_are_checked_as_the_schema_says(name: str) -> None:
    """Of each key the wrong values are refused by both, and what is right beside them by neither."""
    jsonschema = pytest.importorskip("jsonschema")
    kind, table = TABLES[name], whole(name)
    shape = jsonschema.Draft7Validator(SHAPE(kind))
    for field, one in keys_of(kind).items():
        spelt = spelt_key(kind, field)
        if spelt in (others := ALONE.get(name, ())):
            table = {key_: value for key_, value in table.items() if key_ not in others}
        for value in wrong_values(one):
            found = faults_of(kind, table | {spelt: value})
            assert any(text.startswith(spelt) for text in found), (spelt, value, found)
            assert not shape.is_valid(table | {spelt: value}), (spelt, value)
        strange = [value for value in OTHERS if faults_of(kind, table | {spelt: value})]
        refused = [value for value in OTHERS if not shape.is_valid(table | {spelt: value})]
        assert strange or Any in alternatives(one.type), spelt
        seen = [value for value in strange if value not in refused]
        assert not [value for value in refused if value not in strange] and (not seen or one.unit.startswith("rad/") or
                                                                            field in UNSEEN_WORDS), (spelt, seen)
        if one.required:
            without = {key_: value for key_, value in table.items() if key_ != spelt}
            assert any(f"the key {spelt!r} is missing" in text for text in faults_of(kind, without))
            assert not shape.is_valid(without)


#: keys whose words only the classes' own checks know
UNSEEN_WORDS = ("methods", "directions", "between")


@pytest.mark.parametrize("name", SCENES)
def test_a_new_file_is_the_scene_as_it_is(name: str, validator: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", name]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"#:schema {explain.FILE}\n# {built_in()[name]}\n")
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    assert validator.is_valid(tomllib.loads(text)) and tomllib.loads(text)["name"] == name
    if name in ("matrices", "own-parts", "superelements"):  # whose files are examples
        assert main(["run", str(path)]) == 2
        said = capsys.readouterr().err
        assert "there is no file" in said and "missing:" not in said
        return
    scene, own = Scene.from_file(path), Scene.from_file(name)
    for family in ("parts", "joints", "contacts", "materials", "parameters", "reduce", "asks", "settings"):
        assert getattr(scene, family) == getattr(own, family), family


@pytest.mark.parametrize("name", SCENES)
def test_a_new_file_of_ones_own_is_all_that_it_stands_for(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "my.toml").write_text(f'scene = "{name}"\nname = "mine"\n[reduce]\ntolerance = 0.125\n', encoding="utf-8")
    assert main(["new", str(tmp_path / "my.toml")]) == 0
    text = capsys.readouterr().out
    below = parsed_toml(text_of(name), name)
    assert text.startswith(f"#:schema {explain.FILE}\n")
    assert tomllib.loads(text) == below | {"name": "mine", "reduce": {**below.get("reduce", {}), "tolerance": 0.125}}


@pytest.mark.parametrize("name", TABLES)
def test_keys_are_listed_with_type_unit_default_and_meaning(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", name]) == 0
    text, kind = capsys.readouterr().out, TABLES[name]
    assert first_line(kind) in " ".join(text.split()) and max(map(len, text.splitlines())) <= 80
    for field, one in keys_of(kind).items():
        entry = re.search(rf"^{spelt_key(kind, field)} +(.+(?:\n +.+)+)", text, re.MULTILINE)
        assert entry is not None
        said = " ".join(entry[1].split())
        assert " ".join(one.meaning.split()) in said and f"[{one.unit}]" in said + "[]" * (not one.unit)
        assert one.bounds in said and (not one.choices or all(word in said for word in one.choices(kind)))
        if one.required:
            assert "; required" in said
        elif not one.required_with:
            assert one.otherwise in said and (one.otherwise or one.default in (None, "", [], {}) or
                                              f"; default: {toml(one.default)}" in said)
        assert one.otherwise or one.required or one.required_with or one.default not in (None, "", [], {}), "no default is told"


def test_all_kinds_are_listed_with_their_first_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys"]) == 0
    text = capsys.readouterr().out
    for name, kind in TABLES.items():
        assert re.search(rf"^ *{name.rpartition('.')[2]}:? +{re.escape(first_line(kind))}$", text, re.MULTILINE), name
    assert main(["keys", "critcal"]) == 2 and "did you mean 'critical'" in capsys.readouterr().err
    assert main(["keys", "matrices"]) == 0  # a part and an ask
    assert re.findall(r"^(\w+): matrices$", capsys.readouterr().out, re.MULTILINE) == ["part", "ask"]


@pytest.mark.parametrize("family", FAMILIES)
def test_no_kind_hides_a_name_that_its_family_uses(family: str) -> None:
    """The ask `map` was taken for Python's map, once it was imported."""
    package = importlib.import_module(f"femsub.app.{family}s")
    used = {node.id for node in ast.walk(ast.parse(Path(str(package.__file__)).read_text(encoding="utf-8")))
            if isinstance(node, ast.Name)}
    assert not used & {name.replace("-", "_") for name in Kinds().names(family)}


# tables within a table


@dataclass(frozen=True)
class Piece:
    """A part of a system."""

    mesh: str = key("", "the part's mesh file", required=True, example="part.msh")
    length: float = key(1.0, "the part's length", unit="m", above=0)
    held: list[str] = key([], "sets that are held", otherwise="none", example=["left"])


@dataclass(frozen=True)
class Link:
    """A joint between two parts."""

    parts: list[str] = key([], "the two parts", form="[one, other]", required=True, example=["left", "right"])
    kind: str = key("rigid", "its kind", choices=lambda _: ("rigid", "springs"))


@dataclass(frozen=True)
class Whole:
    """Parts and joints."""

    name: str = key("", "the name", otherwise="none", example="pair")
    parts: list[Piece] = key([], "the parts", required=True, example=[{"mesh": "a.msh"}, {"mesh": "b.msh", "length": 2.0}])
    joints: list[Link] = key([], "the joints", otherwise="none")
    named: dict[str, Piece] = key({}, "others by their names", otherwise="none")


def test_a_key_may_be_a_table_a_list_of_tables_or_tables_by_name() -> None:
    table = tomllib.loads('name = "two"\n[[parts]]\nmesh = "a"\nlength = 3\n[[parts]]\nmesh = "b"\nheld = "left"\n'
                          '[[joints]]\nparts = ["a", "b"]\n[named]\nc = {mesh = "c"}\n')
    faults = Faults()
    assert read_table(Whole, table, (), faults) == Whole("two", [Piece("a", 3.0), Piece("b", held=["left"])], [Link(["a", "b"])],
                                                   {"c": Piece("c")})
    assert read_table(Whole, {"parts": {"mesh": "a"}}, (), faults) == Whole(parts=[Piece("a")])  # one does for a list of one
    assert not faults.found


@pytest.mark.parametrize(("text", "words"), [
    ('[[parts]]\nmesh = "a"\n[[parts]]\nlenth = 1', "parts 2.lenth: unknown key 'lenth'; did you mean 'length'"),
    ('[[parts]]\nmesh = "a"\nlength = 0.0', "parts 1.length: it must be positive, but is 0.0"),
    ("[[parts]]\nlength = 1.0", "parts 1: the key 'mesh' is missing"),
    ('[[parts]]\nmesh = 3', "parts 1.mesh: it must be a string, not 3"),
    ('parts = ["a"]', "parts: it must be a list of tables"),
    ('[[parts]]\nmesh = "a"\n[[joints]]\nparts = ["a"]', "joints 1.parts: it must be [one, other]"),
    ('[[parts]]\nmesh = "a"\n[[joints]]\nparts = ["a", "b"]\nkind = "rigit"', "joints 1.kind: unknown kind 'rigit'; did you "
                                                                              "mean"),
    ('[[parts]]\nmesh = "a"\n[named.c]\nmehs = "c"', "named.c.mehs: unknown key 'mehs'; did you mean 'mesh'"),
])
def test_what_is_wrong_in_a_table_is_named_and_the_schema_rejects_it(text: str, words: str) -> None:
    table = tomllib.loads(text)
    assert any(words in one for one in faults_of(Whole, table)), faults_of(Whole, table)
    jsonschema = pytest.importorskip("jsonschema")
    assert not jsonschema.Draft7Validator(SHAPE(Whole)).is_valid(table)


def test_tables_are_listed_and_written_as_they_are_read() -> None:
    listed = "\n".join(listed_keys(Whole, ""))
    assert len(re.findall(r"^ +length +a number above 0 \[m\]; default: 1.0$", listed, re.MULTILINE)) == 2
    table = {"name": 'a "b"', "part": {"x y": {"n": 1e-9, "m": True}, "z": {"ports": {"belt": [0.3, 1]}}},
             "ask": [{"critical": "mu", "vary": {"part.z.n": [0.1 + 0.2, 12345678.0]}}, {"modes": 3}]}
    assert tomllib.loads(toml_text(table)) == table


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
    (tmp_path / "scene.toml").write_text('scene = "chain"\n[part.chain]\nchain = 6\n[reduce]\nsizes = [3]\n[[ask]]\n'
                                         'critical = "slope"\n[[ask]]\ncomplex-modes = "all"\n', encoding="utf-8")
    run, listening = ["run", str(tmp_path / "scene.toml"), "--no-figures"], list(logging.getLogger("femsub").handlers)
    assert main([*run, "--quiet", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert not printed.out and not printed.err and (tmp_path / "out" / "results.json").exists()
    assert main([*run, "-v"]) == 0
    told = capsys.readouterr()
    assert "Complex modes" in told.out and all(line.startswith("femsub: ") for line in told.err.splitlines())
    assert "femsub: chain: complex-modes" in told.err.splitlines()
    assert main([*run, "-vv"]) == 0
    assert len(capsys.readouterr().err) > len(told.err)
    assert main(run) == 0 and not capsys.readouterr().err  # the log of one run is not that of the next
    assert logging.getLogger("femsub").handlers == listening


def test_quiet_still_tells_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "chian", "--quiet"]) == 2 and "did you mean 'chain'" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "offered"), [
    (["femsub", "ru"], {"run"}), (["femsub", "run", "chain-t"], {"chain-transient"}), (["femsub", "new", "bea"], {"beam"}),
    (["femsub", "run", "chain", "--no"], {"--no-figures"}), (["femsub", "run", "mine"], {"mine.toml", "mine.json"})])
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
    table = {"scene": "chain", "part": {"chain": {"chian": 4, "chain": "ten", "zzzz": 1, "interfase": [1]}},
             "reduce": {"sizes": []}}
    with pytest.raises(InputError) as told:
        Scene(table)
    for words in ("part.chain.chain: it must be a whole number", "'chian'; did you mean 'chain'?", "unknown key 'zzzz'; ",
                  "reduce.sizes: it is an empty list", "'interfase'; did you mean 'interface'?"):
        assert words in str(told.value)
    assert str(told.value).startswith("5 faults:")


def test_a_band_may_be_given_in_hertz_and_comes_back_as_given() -> None:
    for band in (["500 Hz", "5 kHz"], ["500Hz", "5000.0 Hz"], [1000 * np.pi, "5e3 Hz"]):
        scene = Scene({"scene": "plate", "units": "SI", "band": band, "ask": [{"modes": "band", "band": band}]})
        assert scene.settings.band == pytest.approx([1000 * np.pi, 10_000 * np.pi], rel=1e-15)
        assert scene.asks[0].band == scene.settings.band
    # frequencies of another program may be in hertz, too, and the schema says so
    table = {"scene": "plate", "units": "SI", "ask": [{"modes": 3, "reference": ["2 Hz", 20.0]}]}
    assert Scene(table).asks[0].reference == pytest.approx([4 * np.pi, 20.0], rel=1e-15)
    assert "'pattern'" in repr(table_schema(ModesAsk)["properties"]["reference"])
    assert SYSTEMS["SI"].said(span((1000 * np.pi, 10_000 * np.pi))).endswith("(500 to 5000 Hz)")
    for table, words in (({"band": [0, "5 kHz"]}, 'give units, e.g. units = "SI"'),
                         ({"ask": [{"modes": "band", "band": [0, "5 kHz"]}]}, 'give units, e.g. units = "SI"'),
                         ({"units": "SI", "band": [0, "5 KHz"]}, "band: '5 KHz' is no frequency. Give .* or \"5 kHz\""),
                         ({"units": {"length": "m", "mass": "kg", "time": "ms"}, "band": [0, "5 kHz"]}, "units whose time is s"),
                         ({"units": "SI", "part": {"plate": {"thickness": "5 Hz"}}}, "part.plate.thickness: it must be a "
                                                                                     "number")):
        with pytest.raises(InputError, match=words):
            Scene({"scene": "plate", **table})


def test_a_scene_file_may_begin_with_the_mark_of_windows_editors(tmp_path: Path) -> None:
    (path := tmp_path / "my.toml").write_bytes(b"\xef\xbb\xbf" + b'scene = "chain"\r\n')
    assert Scene.from_file(path).name == "chain"


def test_methods_have_labels_whatever_they_are() -> None:
    """A list of steps ended in a TypeError, and with it the scene `brake`."""
    given = ["HCB", ["craig-chang", "contact-modes"], {"disc": "rubin"}, "box", [{"disc": "guyan"}, "box"]]
    assert Scene({"scene": "brake", "reduce": {"methods": given}}).reduce.labels == (
        "Craig-Bampton and Craig-Chang, then contact-modes and one for each part and box and one for each part, then box")
    assert all(Scene.from_file(name).reduce.labels or not Scene.from_file(name).reduce.methods for name in SCENES if name not in (
        "matrices", "own-parts", "superelements"))


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
