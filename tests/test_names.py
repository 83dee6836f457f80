"""Names and values of others on a terminal, in messages and in CSV files: no escapes, no formulas, no two megabytes."""

from __future__ import annotations

import csv
import io
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.app import cli
from femsub.app.grammar import Scene
from femsub.checks import FemsubWarning, csv_cell, printable, shown, unknown_name, warn
from femsub.io.abaqus_calculix import read_dofs, write_dofs
from femsub.output import table_csv

EVIL = "pad\x1b]0;owned\x07\x1b[31m\x9b2J\u202e"


@pytest.mark.parametrize("make", [
    lambda name: fs.Substructure(np.eye(2), np.eye(2), name=name), lambda name: fs.Spring(("a", [0]), stiffness=1.0, name=name),
    lambda name: fs.Substructure(np.eye(2), np.eye(2), ports={name: np.ones(2)}), lambda name: fs.Belt(port=name, slope=-0.1),
    lambda name: fs.Substructure(np.eye(2), np.eye(2), interface={name: [0]}),
    lambda name: fs.Rigid(("a", [0]), ("b", [0]), name=name), lambda name: fs.Kinematic(("a", "b"), ("c", "d"), name=name),
    lambda name: fs.Averaged(("a", "b"), ("c", "d"), name=name), lambda name: fs.DofMap([1], [0], [name]),
    lambda name: fs.Tied(("a", "b"), ("c", "d"), {}, name=name), lambda name: fs.couple({name: fs.chain(2)}, []),
    lambda name: fs.Mesh(np.eye(2), [[0, 1]], "line", name=name), lambda name: fs.Mesh(np.eye(2), [[0, 1]], "line", {name: [0]})])
def test_a_name_is_printable_text(make: Any) -> None:
    for wrong in (EVIL, "two\nlines", None, 3):
        with pytest.raises((fs.InputError, fs.InputTypeError)) as caught:
            make(wrong)
        assert str(caught.value).isprintable() and len(str(caught.value)) < 500


def test_a_name_may_have_spaces_of_any_script_and_a_file_any_name(tmp_path: Path) -> None:
    for name in ("disc\u00a0A", "\u30d6\u30ec\u30fc\u30ad\u3000A"):
        model = fs.Substructure(np.eye(2), np.eye(2), name=name)
        fs.write_matrices(tmp_path / "model", model)
        assert fs.read_component(tmp_path / "model").name == name
        mesh = fs.Mesh(np.eye(2), [[0, 1]], "line", {name: [0]}, name=name)
        assert fs.read_mesh(fs.write_mesh(tmp_path / f"{name}.vtu", mesh)).name == name
    index = tmp_path / "model" / "model.json"
    index.write_text(index.read_text("utf-8").replace('"name": "', '"name": "\\u001b'), "utf-8")
    with pytest.raises(fs.InputError, match=r"model\.json.*printable characters"):
        fs.read_component(tmp_path / "model")
    plain = fs.write_mesh(tmp_path / "plain.vtu", fs.block((1.0, 1.0, 1.0), (1, 1, 1)))
    evil = plain.rename(tmp_path / f"{EVIL}\n.vtu")
    assert fs.read_mesh(evil).name == "pad\\x1b]0;owned\\x07\\x1b[31m\\x9b2J\\u202e\\n"


def test_the_name_of_a_scene_is_a_name_and_a_part_of_a_file_name() -> None:
    for name in ("disc\u00a0A", "\u30d6\u30ec\u30fc\u30ad\u3000A"):
        assert Scene({"scene": "chain", "name": name}).name == name
    for wrong, why in ((EVIL, "printable characters only"), ("two\nlines", "printable characters only"), ("a/b", "without /"),
                       ("x" * 101, "at most 100 characters")):
        with pytest.raises(fs.InputError, match=f"name: .*{why}") as caught:
            Scene({"scene": "chain", "name": wrong})
        assert str(caught.value).isprintable()


def test_no_message_holds_what_a_terminal_obeys() -> None:
    for error in (fs.InputError(f"no {EVIL}"), fs.MissingPackageError(EVIL), fs.WorkerError(EVIL),
                  unknown_name("part", EVIL, [EVIL])):
        assert str(error).isprintable() and "pad\\x1b]0;owned" in str(error) and "\\x9b" in str(error) and "\\u202e" in str(error)
    with pytest.warns(FemsubWarning) as caught:
        warn(EVIL)
    assert str(caught[0].message).isprintable()
    assert printable("μ\nω", 9) == "μ\nω" and printable("\ud800") == "\\ud800"


def test_what_was_found_is_shortened() -> None:
    long = "x" * 2_000_000
    assert len(str(unknown_name("key", long, ["band"]))) < 200
    assert len(str(fs.InputError(f"the key {long!r} is wrong: change it"))) < 5000
    assert str(fs.InputError(f"the key {long!r} is wrong: change it")).endswith("is wrong: change it")
    assert shown(10**5000) == "an object of type int"  # Python itself refuses to print it

    class Odd:
        def __repr__(self) -> str:
            raise RuntimeError

    for value in (long, b"x" * 100, [1] * 1000, EVIL, Odd(), {EVIL: "two\nlines"}, np.array(EVIL), 10**400):
        assert len(shown(value)) <= 60 and shown(value).isprintable()


def test_the_command_line_prints_no_escapes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text(f'scene = "chain"\n"{"k" * 2_000_000}" = 1\n', encoding="utf-8")
    assert cli.main(["run", str(tmp_path / "a.toml")]) == 2
    assert len(capsys.readouterr().err) < 5000
    (tmp_path / "b.toml").write_text('scene = "chain"\n"a\\u001b[31m" = 1\n', encoding="utf-8")
    assert cli.main(["run", str(tmp_path / "b.toml")]) == 2
    assert "\x1b" not in capsys.readouterr().err
    for text in ('[part."a\\u001b[31m"]\nchain = 3\n', '[[ask]]\nmodes = 3\nname = "a\\u001b[31m"\n', '[[ask]]\nmodes = 3\n'
                                                                                                      'note = "\\u001b[31m"\n',
                 '[contact.belt]\nbelt = "chain.\\u001b[31m"\n', '[[ask]]\ncritical = "\\u001b[31m"\n'):
        (tmp_path / "c.toml").write_text(f'scene = "chain"\n{text}', encoding="utf-8")
        assert cli.main(["run", str(tmp_path / "c.toml")]) == 2, text
        assert "\x1b" not in (said := capsys.readouterr().err) and said.startswith("femsub: ")
    assert cli.main(["run", f"{EVIL}.toml"]) == 2
    said = capsys.readouterr().err
    assert "\x1b" not in said and "\\x1b[31m\\x9b2J" in said
    record = logging.LogRecord("femsub", logging.INFO, "", 0, "part %r of %s", ("pad", EVIL), None)
    assert cli.printable_record(record) and record.getMessage() == "part 'pad' of " + printable(EVIL)


@pytest.mark.parametrize("sign", list("=+-@\t\r"))
def test_a_spreadsheet_runs_no_name(sign: str, tmp_path: Path) -> None:
    name = f"{sign}cmd|' /C calc'!A0"
    file = io.BytesIO()
    table_csv([{"model": name, name: -1.5, "parts": [name, "b"], "values": [-1.0, 2.0]}], file)
    cells = [cell for row in csv.reader(io.StringIO(file.getvalue().decode(), newline="")) for cell in row]
    assert cells == ["model", csv_cell(name), "parts", "values", csv_cell(name), "-1.5", csv_cell(f"{name} b"), "-1.0 2.0"]
    assert csv_cell(name) == (f"'{name}" if sign.isprintable() else f"\\{'t' if sign == chr(9) else 'r'}{name[1:]}")


def test_labels_of_dof_are_read_again_as_they_were(tmp_path: Path) -> None:
    dofs = fs.DofMap([1, 1, 2], [0, 1, 2], ["=1+1", "-x", "uz"])
    with (tmp_path / "dofs.csv").open("wb") as file:
        write_dofs(file, dofs)
    assert "\n1,'=1+1\n1,'-x\n2,uz\n" in (tmp_path / "dofs.csv").read_text(encoding="utf-8")
    found = read_dofs(tmp_path / "dofs.csv", dofs.labels)
    assert found.labels == dofs.labels and np.array_equal(found.components, dofs.components)


@pytest.mark.parametrize("wrong", [lambda one: fs.chain(one), lambda one: fs.Belt(force=one)])
def test_a_span_of_time_is_no_number(wrong: Callable[[object], object]) -> None:
    with pytest.raises(fs.InputTypeError, match=r"must be a (whole )?number, not .*timedelta64"):
        wrong(np.timedelta64(3))


def test_a_set_of_the_interface_is_named_when_it_is_refused() -> None:
    for given in ({"sets": {"left": {"a": [0]}}, "interface": [0]}, {"interface": {"left": "x"}}):
        with pytest.raises(fs.InputTypeError, match="the interface set 'left' must be a list of whole numbers"):
            fs.Substructure(np.eye(2), np.eye(2), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("label", ["=a", "'=a", "''=a", "'a", "'", "-x"])
def test_a_label_of_any_sign_is_read_back(label: str, tmp_path: Path) -> None:
    with (tmp_path / "dofs.csv").open("wb") as file:
        write_dofs(file, fs.DofMap(np.array([1, 2]), np.array([0, 1]), (label, "ux")))
    assert read_dofs(tmp_path / "dofs.csv").name(0) == f"{label} at node 1"


def test_an_unknown_part_of_a_value_names_its_argument() -> None:
    """'unknown set of nodes', 'unknown port', 'an end must be': which argument had it was left out."""
    mesh, sub = fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"), fs.chain(6, belt=2)
    steel, flat = fs.Material(1.0, 0.3, 1.0), fs.rectangle((1.0, 1.0), (2, 2))
    thin = {"E": 1.0, "nu": 0.3, "rho": 1.0, "thickness": 0.1}
    parts = {"a": fs.chain(4, interface=[4]), "b": fs.chain(3, interface=[1], fixed=False)}
    right = fs.Rigid(("a", [3]), ("b", [0]))
    rom, slow = fs.reduce(sub, fs.CraigChang(modes=3), ports=True), fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=1e-2))
    response = fs.frequency_response(sub, at=[0.1], loads=["belt"])
    rub = fs.FrictionContact("bottom", "ground", mesh, 1.0, 0.4, direction=np.array([1.0, 0.0, 0.0]))
    top = fs.solid(mesh, steel, interface=["top"])
    for argument, call in {
            "supports": lambda: fs.solid(mesh, steel, supports=["lft"]),
            "interface": lambda: fs.solid(mesh, steel, interface=["lft"]),
            "supports ": lambda: fs.plate(flat, **thin, supports={"lft": "clamped"}),
            "interface ": lambda: fs.plate(flat, **thin, interface=["lft"]),
            "first": lambda: fs.couple(parts, [right, fs.Spring("a", ("b", [0]), stiffness=1.0)]),
            "second": lambda: fs.couple(parts, [right, fs.Spring(("a", [3]), ("c", [0]), stiffness=1.0)]),
            "interface  ": lambda: fs.couple(parts, [right], interface=["a"]),
            "reference": lambda: fs.couple(parts, [fs.Kinematic(("c", [3]), ("b", [0]))]),
            "loads": lambda: fs.frequency_response(sub, at=[0.1], loads=["bolt"]),
            "responses": lambda: fs.frequency_response(sub, at=[0.1], loads=["belt"], responses=["bolt"]),
            "impulse": lambda: fs.transient(rom, slow, (0.0, 1.0), impulse={"bolt": 1.0}),
            "joints": lambda: fs.couple_responses({"a": response}, [(("b", "belt"), ("a", "belt"))]),
            "sets": lambda: fs.Substructure(np.eye(2), np.eye(2), interface=[0], sets={None: [0]}),  # type: ignore[dict-item]
            "first ": lambda: top.linearised(rub)}.items():
        with pytest.raises(fs.FemsubError, match=argument.strip()):
            call()
