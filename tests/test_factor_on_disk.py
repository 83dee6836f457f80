"""A factor that does not fit into memory lies on a disk: the same results, less memory, and no file is left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import lattice

import femsub as fs
from femsub.algebra import factorise, factors_made, memory, shared_factor
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.processes import cache, folders
from femsub.modes import ShiftInvert

SIZE = (24, 18)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for factors, on a disk with room."""
    monkeypatch.setattr(memory, "temporary", lambda: tmp_path)
    monkeypatch.setattr(memory, "in_memory", lambda _: False)
    return tmp_path


@pytest.mark.parametrize("kind", ["definite", "symmetric", "general"])
def test_it_solves_as_one_in_memory_and_leaves_no_file(kind: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.petsc.goes_to_disk", lambda A, possible, kept: possible)
    sub = lattice(*SIZE, held=True)
    A = {"definite": sub.K, "symmetric": sp.csr_array(sub.K - sub.K.diagonal().mean() * sp.eye_array(sub.size)),
         "general": sp.csr_array(sub.K + sp.triu(sub.K) / 10)}[kind]
    factor = factorise(A, kind)  # type: ignore[arg-type]
    assert isinstance(factor, SparseFactor) and factor.on_disk and "on disk" in repr(factor)
    files = [file for file in place.glob("femsub-*/*") if file.name != folders.ALIVE]
    assert sum(file.stat().st_size for file in files) > 8 * A.nnz / 2
    B = np.random.default_rng(3).standard_normal((sub.size, 70))
    X = factor.solve(B)
    assert np.linalg.norm(A @ X - B) < 1e-10 * np.linalg.norm(abs(A) @ abs(X))
    if kind == "symmetric":
        assert factor.negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.toarray()) < 0) > 0
    if kind == "general":
        assert np.linalg.norm(A.T @ factor.transposed.solve(B) - B) < 1e-10 * np.linalg.norm(abs(A.T) @ abs(X))
    factor.close()
    assert not list(place.iterdir())


def test_a_factor_that_is_refused_leaves_no_file(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.petsc.goes_to_disk", lambda A, possible, kept: possible)
    K = lattice(*SIZE, held=True).K
    with pytest.raises(fs.SingularMatrixError):
        factorise(sp.csr_array(K - np.median(K.diagonal()) * sp.eye_array(len(K.diagonal()))), "definite")
    assert not list(place.iterdir())


@pytest.mark.parametrize("kind", ["definite", "symmetric"])
def test_a_full_disk_is_told_as_such_and_not_remembered(kind: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.petsc.goes_to_disk", lambda A, possible, kept: possible)
    sub, told = lattice(*SIZE, held=True), SparseFactor._infog
    monkeypatch.setattr(SparseFactor, "_infog", lambda self, number: -90 if number == 1 else told(self, number))
    with pytest.raises(fs.NotEnoughMemoryError, match="TMPDIR"):
        shared_factor(sub.K, kind)  # type: ignore[arg-type]
    assert not list(place.iterdir())
    monkeypatch.setattr(SparseFactor, "_infog", told)
    assert shared_factor(sub.K, kind).on_disk  # type: ignore[arg-type]
    cache.drop()


def test_memory_decides(place: Path, machine: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_FILL", 1e9)
    sub = lattice(*SIZE, held=True)
    cache.drop()
    need = memory.FACTOR_BYTES * memory.factor_nonzeros(sub.K)
    for free, beside, on_disk in ((1.3, 0.0, False), (1.1, 0.0, True), (1.6, 0.5, True), (1.8, 0.5, False), (0.2, 0.0, False)):
        machine(free=free * need, large=100)
        with memory.kept_free(beside * need):
            assert memory.goes_to_disk(sub.K, True) is on_disk
            assert not memory.goes_to_disk(sub.K, False)  # of a count nothing is kept
    machine(free=0.9 * need, large=sub.size + 1)
    assert not memory.goes_to_disk(sub.K, True)  # a small model
    machine(free=0.9 * need, large=100)
    monkeypatch.setattr(memory, "disk", lambda: (place, 0.0))
    assert not memory.goes_to_disk(sub.K, True)  # a full disk


def test_a_reduction_that_would_not_fit_has_its_factor_on_disk(place: Path, machine: Callable[..., None],
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_FILL", 1e9)
    monkeypatch.setattr(memory, "LIBRARIES", "numpy")
    sub, kinds = lattice(*SIZE, held=True), []
    cache.drop()
    parts, less = (memory.reduction_bytes(sub.K, len(sub.interface) + 2, 5, sub.interface, on_disk=on_disk)
                   for on_disk in (False, True))
    whole, short, least = sum(parts.values()), 0.99 * (parts["factorisation"] + parts["columns"]), sum(less.values())
    assert least < short < whole  # the matrices are there before the factor
    monkeypatch.setattr("femsub.algebra.factor._logged", lambda handle: (kinds.append(handle.on_disk), handle)[1])
    roms = []
    for free in (2 * whole, short):
        cache.drop()
        machine(free=free, large=100)
        roms.append(fs.reduce(sub, fs.CraigBampton(5), ports=True))
        assert any(kinds) is (free < whole), kinds
    assert np.allclose(np.diag(roms[0].K)[-5:], np.diag(roms[1].K)[-5:], rtol=1e-9, atol=0)
    cache.drop()
    machine(free=0.9 * least, large=100)
    with pytest.raises(fs.NotEnoughMemoryError, match="for the columns"):
        fs.reduce(sub, fs.CraigBampton(5), ports=True)
    machine(free=short, large=100)
    monkeypatch.setattr(memory, "disk", lambda: (place, 0.0))
    with pytest.raises(fs.NotEnoughMemoryError, match="TMPDIR"):
        fs.reduce(sub, fs.CraigBampton(5), ports=True)
    assert not list(place.iterdir())


@pytest.mark.parametrize("what", [{"count": 20}, {"band": (0.0, 6e3)}], ids=["count", "band"])
def test_a_factor_makes_room_for_the_count_of_its_modes(what: dict[str, Any], machine: Callable[..., None],
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    """It is given up where both would not fit, and made again if solves follow, as they do after the count of a band."""
    held, make_room = [], ShiftInvert.make_room
    monkeypatch.setattr(ShiftInvert, "make_room", lambda self: (make_room(self), held.append("factor" in vars(self)))[0])
    found, made = [], []
    for free in (1e12, memory.BASE):
        cache.drop()
        machine(free=free, large=100)
        sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                       supports={"left": "clamped"})
        before = factors_made()
        found.append(fs.normal_modes(sub, **what))
        made.append(factors_made() - before)
    assert held == [True, False] and made[1] - made[0] == int("band" in what)
    before = factors_made()
    if "band" in what:  # what is counted already gives nothing up
        assert fs.normal_modes(sub, band=(0.0, 3e3)).evidence == "certified" and factors_made() == before
    assert len(found[0].frequencies) == len(found[1].frequencies) and found[1].evidence == "certified"
    assert np.allclose(found[0].frequencies, found[1].frequencies, rtol=1e-9, atol=0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("method", [fs.Herting(5), fs.CraigBampton(5), fs.MacNeal(5), fs.Guyan()], ids=lambda method: method.key)
def test_reductions_go_on_without_the_factor(method: fs.Method, monkeypatch: pytest.MonkeyPatch) -> None:
    roms = []
    for room in (True, False):
        cache.drop()
        monkeypatch.setattr("femsub.modes.shift_invert.has_room_to_count", lambda K, nonzeros, room=room: room)
        sub = fs.solid(fs.block((1.0, 0.5, 0.3), (10, 7, 5), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
        roms.append(fs.reduce(sub, method))
    assert np.allclose(roms[0].K, roms[1].K, rtol=0, atol=1e-9 * np.abs(roms[0].K).max())


@pytest.mark.skipif(not Path("/proc/mounts").exists(), reason="mounts are told by Linux")
def test_a_folder_in_memory_is_no_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    mounts = [line.split() for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
    tmpfs = [where for _, where, kind, *_ in mounts if kind == "tmpfs" and Path(where).is_dir()]
    if not tmpfs:
        pytest.skip("nothing is in memory here")
    assert folders.in_memory(Path(tmpfs[0])) and not folders.in_memory(Path("/proc"))
    monkeypatch.setattr(memory, "temporary", lambda: Path(tmpfs[0]))
    monkeypatch.setattr(memory, "in_memory", lambda _: True)
    assert memory.disk()[1] == 0.0
