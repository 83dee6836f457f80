"""Models written and read back to the last digit; what was damaged or could not be written is told."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from matrixhelp import same

import femsub as fs


def same_map(first: fs.DofMap, second: fs.DofMap) -> None:
    assert first.labels == second.labels
    assert np.array_equal(first.nodes, second.nodes) and np.array_equal(first.components, second.components)
    assert (first.points is None) == (second.points is None)
    assert first.points is None or np.array_equal(first.points, second.points)


@pytest.mark.parametrize("format", ["mtx", "npz", "mat", "op4"])
@pytest.mark.parametrize("kind", ["full", "bare", "CraigBampton", "CraigChang"])
def test_round_trip(tmp_path: Path, sub: fs.Substructure, format: str, kind: str) -> None:
    if format == "op4":
        pytest.importorskip("pyyeti.nastran.op4")
    model = {"full": lambda: sub, "bare": lambda: fs.Substructure(sub.M, sub.K),
             "CraigBampton": lambda: fs.reduce(sub, fs.CraigBampton(modes=5), ports=True),
             "CraigChang": lambda: fs.reduce(sub, fs.CraigChang(modes=5), ports=True)}[kind]()
    written = fs.write_matrices(tmp_path / "deep" / "out", model, format)
    assert {path.name for path in written} == set(os.listdir(tmp_path / "deep" / "out"))
    read = fs.read_component(tmp_path / "deep" / "out")
    assert type(read) is type(model) and repr(read) == repr(model)
    for part in "MDK":
        same(getattr(model, part), getattr(read, part))
    assert list(read.interface) == list(model.interface) and list(read.ports) == list(model.ports)
    assert all(np.array_equal(w, read.ports[port]) for port, w in model.ports.items())
    if isinstance(model, fs.ReducedSubstructure):
        same(read.V, model.V)
        same_map(read.full_dofs, model.full_dofs)
        assert np.array_equal(read.interface_rows, model.interface_rows)
        for key in ("kinds", "modes", "cutoff", "method", "dropped", "factorisations", "port_error"):
            assert getattr(read, key) == getattr(model, key)
    elif model.dofs:
        same_map(read.dofs, model.dofs)


def test_matlab_counts_from_1(tmp_path: Path, sub: fs.Substructure) -> None:
    rom = fs.reduce(sub, fs.CraigBampton(modes=3), ports=True)
    fs.write_matrices(tmp_path, rom, "mat")
    content = scipy.io.loadmat(tmp_path / "model.mat")
    assert content["interface"].ravel().tolist() == (rom.interface + 1).tolist()
    assert [str(name[0]) for name in content["port_names"].ravel()] == ["pad", "belt"] and content["ports"].shape == (rom.size, 3)


def test_a_model_of_a_folder_gets_the_name_it_is_given(tmp_path: Path, sub: fs.Substructure) -> None:
    """The name was ignored."""
    for model in (sub, fs.reduce(sub, fs.CraigBampton(2), ports=True)):
        fs.write_matrices(tmp_path / "out", model)
        found = fs.read_component(tmp_path / "out", name="another")
        assert found.name == "another" and type(found) is type(model) and np.array_equal(found.interface, model.interface)
        assert abs(found.K - model.K).max() == 0 and fs.read_component(tmp_path / "out").name == model.name
        with pytest.raises(fs.InputError, match="name must have printable characters"):
            fs.read_component(tmp_path / "out", name="a\nb")


def test_what_was_written_and_then_damaged(tmp_path: Path, sub: fs.Substructure) -> None:
    fs.write_matrices(tmp_path / "out", sub, "mtx")
    for beside, named in (({"interface": [0]}, "interface"), ({"dofs": "d.csv", "ports": {}}, "dofs and ports"),
                          ({"D": "D.mtx"}, "D")):
        with pytest.raises(fs.InputError, match=f"leave out {named}: it contains interface, ports and DOF map"):
            fs.read_component(tmp_path / "out", **beside)  # type: ignore[arg-type]
    with pytest.raises(fs.InputError, match="K is missing: name its file"):
        fs.read_component(tmp_path)
    about = json.loads((tmp_path / "out" / "model.json").read_text())
    del about["interface"]
    (tmp_path / "out" / "model.json").write_text(json.dumps(about))
    with pytest.raises(fs.InputError, match=r"model\.json is damaged"):
        fs.read_component(tmp_path / "out")
    with pytest.raises(fs.InputError, match="unknown format 'mtz'; did you mean 'mtx'"):
        fs.write_matrices(tmp_path / "new", sub, "mtz")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("place", "failing"), [(Path, "open"), (os, "replace")])
def test_nothing_is_written_when_the_disk_is_full(tmp_path: Path, sub: fs.Substructure, monkeypatch: pytest.MonkeyPatch,
                                                  place: Any, failing: str) -> None:
    fs.write_matrices(tmp_path / "old", sub)
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}
    real, calls = getattr(place, failing), []

    def full_disk(*arguments: Any, **more: Any) -> Any:
        calls.append(arguments)
        if len(calls) == (3 if failing == "open" else 1):
            raise OSError(28, "No space left on device")
        return real(*arguments, **more)

    for folder in ("old", "new"):
        calls.clear()
        with monkeypatch.context() as patch:
            patch.setattr(place, failing, full_disk)
            with pytest.raises(fs.InputError, match="cannot be written: No space left"):
                fs.write_matrices(tmp_path / folder, fs.Substructure(2 * sub.M, sub.K))
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    assert not (tmp_path / "new").exists()


def written(tmp_path: Path, sub: fs.Substructure, reduced: bool = True, format: str = "mtx") -> tuple[Path, dict[str, Any]]:
    folder = tmp_path / "out"
    fs.write_matrices(folder, fs.reduce(sub, fs.CraigBampton(modes=5), ports=True) if reduced else sub, format)
    return folder, json.loads((folder / "model.json").read_text())


def rehashed(folder: Path, about: dict[str, Any]) -> None:
    """model.json with what is said in `about` and the hashes that fit the files, without its own: only the rest is wrong."""
    about["sha256"] = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in about["sha256"]
                       if name != "model.json"}
    (folder / "model.json").write_text(json.dumps(about))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("path", "value", "words"), [
    ("femsub", 2, "version 2"), ("femsub", True, "version True"), ("femsub", "1", "version '1'"),
    ("femsub", None, "version None"), ("files/K", "../K.mtx", "must be a file in this folder"),
    ("files/K", "/etc/passwd", "must be a file in this folder"), ("files/K", "", "must be a file in this folder"),
    ("files/K", "..", "must be a file"), ("files/K", 5, "must be a file"), ("files", [], "'files' must be"),
    ("files", {}, "'files' must name D, K, M, V, ports, but names none"), ("files", None, "'files'"),
    ("dofs", "../dofs.csv", "must be a file in this folder"), ("labels", "ux", "must be a list"),
    ("labels", [1], "must be a list"), ("reduced/cutoff", float("nan"), "NaN is no number"),
    ("reduced/cutoff", -1.0, "'cutoff' must be a positive number"), ("reduced/cutoff", "x", "'cutoff' must be"),
    ("reduced/cutoff", 0, "'cutoff' must be"), ("reduced/cutoff", True, "'cutoff' must"),
    ("reduced/cutoff", float("inf"), "Infinity is no number"), ("reduced/kinds", ["free"], "1 kinds are listed"),
    ("reduced/kinds", "free", "'kinds' must be"), ("reduced/interface", [0, 99], "interface"),
    ("reduced/interface", [0, 0], "interface"), ("reduced/interface", ["x"], "'interface' must"),
    ("reduced/interface", [[0]], "'interface' must"), ("reduced/dropped", -1, "'dropped'"),
    ("reduced/modes", "x", "'modes' must"), ("reduced/modes", 99, "its modes"),
    ("reduced/port_error", {"nobody": 0.1}, "errors of ports"), ("reduced/port_error", {"belt": "x"}, "'port_error' must"),
    ("reduced/noise", [[1.0], []], "rounding of its matrices"), ("reduced/noise", ["x"], "rounding of its matrices"),
    ("reduced", [], "'reduced' must be a table"), ("reduced", "x", "'reduced' must be"),
    ("interface", [0, "x"], "'interface' must"), ("interface", [3], "is not that of V"), ("interface", 5, "'interface' must"),
    ("ports", {"pad": 10 ** 12, "belt": 0}, "columns"), ("ports", {"belt": 0}, "its ports have 1 columns"),
    ("ports", ["belt"], "'ports' must be"), ("name", 5, "'name' must be"), ("sha256", {}, "hashes of no file"),
    ("sha256", "x", "'sha256' must be"), ("sha256", None, "'sha256' must be"),
])
def test_entries_of_a_model_that_are_wrong(tmp_path: Path, sub: fs.Substructure, path: str, value: Any, words: str) -> None:
    folder, about = written(tmp_path, sub)
    node = about
    for key in path.split("/")[:-1]:
        node = node[key]
    node[path.split("/")[-1]] = value
    if path.startswith("sha256"):
        (folder / "model.json").write_text(json.dumps(about))
    else:
        rehashed(folder, about)
    with pytest.raises(fs.InputError, match=r"model\.json") as caught:
        fs.read_component(folder)
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "5", "null", "{", '{"femsub": 1, "femsub": 1}', "[" * 100000, "\xff"])
def test_a_model_that_is_no_table(tmp_path: Path, sub: fs.Substructure, text: str) -> None:
    folder, _ = written(tmp_path, sub)
    (folder / "model.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(fs.InputError, match=r"model\.json is damaged"):
        fs.read_component(folder)


def test_a_basis_with_a_column_too_few(tmp_path: Path, sub: fs.Substructure) -> None:
    folder, about = written(tmp_path, sub, format="npz")
    np.save(folder / "V.npy", np.load(folder / "V.npy")[:, :-1])
    with pytest.raises(fs.InputError, match=r"V\.npy is not the file that model\.json was written with"):
        fs.read_component(folder)
    rehashed(folder, about)
    with pytest.raises(fs.InputError, match=r"V is 24 x \d+, but M has"):
        fs.read_component(folder)


@pytest.mark.parametrize("format", ["mtx", "npz", "mat"])
def test_a_mix_of_two_models_is_refused(tmp_path: Path, sub: fs.Substructure, format: str) -> None:
    """Each file of another model, put in the place of this one's, as a write that is killed leaves it."""
    folder, _ = written(tmp_path, sub, False, format)
    places = np.array(sub.dofs.points) + 1 if sub.dofs else None
    dofs = fs.DofMap(sub.dofs.nodes, sub.dofs.components, points=places) if sub.dofs else None
    ports = {key: 2 * w for key, w in sub.ports.items()}
    other = fs.Substructure(2 * sub.M, 2 * sub.K, 2 * sub.D, sub.interface, ports, sub.name, dofs)
    fs.write_matrices(tmp_path / "other", other, format)
    for file in sorted(os.listdir(folder)):
        mine = (folder / file).read_bytes()
        (folder / file).write_bytes((tmp_path / "other" / file).read_bytes())
        with pytest.raises(fs.InputError, match="a write was stopped"):
            fs.read_component(folder)
        (folder / file).unlink()
        with pytest.raises(fs.InputError, match=r"there is no file|has no model\.json"):
            fs.read_component(folder)
        (folder / file).write_bytes(mine)
    assert fs.read_component(folder).name == sub.name


def test_a_model_without_hashes_says_what_to_do(tmp_path: Path, sub: fs.Substructure) -> None:
    folder, about = written(tmp_path, sub)
    del about["sha256"]
    (folder / "model.json").write_text(json.dumps(about))
    with pytest.raises(fs.InputError, match=r"has no hashes of its files, .*or read its matrices one by one"):
        fs.read_component(folder)


def test_an_error_without_bounds_at_a_port_is_written_and_read(tmp_path: Path, sub: fs.Substructure) -> None:
    rom = fs.reduce(sub, fs.CraigBampton(modes=5), ports=True)
    object.__setattr__(rom, "port_error", {"belt": np.inf})
    fs.write_matrices(tmp_path, rom)
    assert fs.read_component(tmp_path).port_error == {"belt": np.inf}


def test_a_size_beyond_all_numbers_is_damage(tmp_path: Path) -> None:
    """1e400 in JSON is infinite, and no whole number."""
    fs.write_matrices(tmp_path, fs.reduce(fs.chain(10), fs.CraigBampton(2)), "npz")
    about = json.loads((tmp_path / "model.json").read_text())
    about["reduced"]["origin"]["size"] = np.inf
    (tmp_path / "model.json").write_text(json.dumps(about).replace("Infinity", "1e400"))
    with pytest.raises(fs.InputError, match="damaged"):
        fs.read_component(tmp_path)
