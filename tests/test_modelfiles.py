"""Models written and read back to the last digit; what was damaged or could not be written is told."""

from __future__ import annotations

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
        for key in ("kinds", "cutoff", "method", "dropped", "factorisations", "port_error"):
            assert getattr(read, key) == getattr(model, key)
    elif model.dofs:
        same_map(read.dofs, model.dofs)


def test_matlab_counts_from_1(tmp_path: Path, sub: fs.Substructure) -> None:
    rom = fs.reduce(sub, fs.CraigBampton(modes=3), ports=True)
    fs.write_matrices(tmp_path, rom, "mat")
    content = scipy.io.loadmat(tmp_path / "model.mat")
    assert content["interface"].ravel().tolist() == (rom.interface + 1).tolist()
    assert [str(name[0]) for name in content["port_names"].ravel()] == ["pad", "belt"] and content["ports"].shape == (rom.size, 3)


def test_what_was_written_and_then_damaged(tmp_path: Path, sub: fs.Substructure) -> None:
    fs.write_matrices(tmp_path / "out", sub, "mtx")
    with pytest.raises(fs.InputError, match="tells interface, ports and DOF map itself"):
        fs.read_component(tmp_path / "out", interface=[0])
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


@pytest.mark.parametrize("failing", ["fdopen", "replace"])
def test_nothing_is_written_when_the_disk_is_full(tmp_path: Path, sub: fs.Substructure, monkeypatch: pytest.MonkeyPatch,
                                                  failing: str) -> None:
    fs.write_matrices(tmp_path / "old", sub)
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}
    real, calls = getattr(os, failing), []

    def full_disk(*arguments: Any, **more: Any) -> Any:
        calls.append(arguments)
        if len(calls) == (3 if failing == "fdopen" else 1):
            raise OSError(28, "No space left on device")
        return real(*arguments, **more)

    for folder in ("old", "new"):
        calls.clear()
        with monkeypatch.context() as patch:
            patch.setattr(os, failing, full_disk)
            with pytest.raises(fs.InputError, match="cannot be written: No space left"):
                fs.write_matrices(tmp_path / folder, fs.Substructure(2 * sub.M, sub.K))
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    assert not (tmp_path / "new").exists()
