"""Factors are made once for a model and found again: how many there are, how long they live, and that no number depends on it."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import FrameType
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import lattice

import femsub as fs
from femsub import algebra
from femsub.algebra import QUADRATIC, memory
from femsub.algebra.factor import release, shared_factor
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.processes import cache
from femsub.checks import EPS
from femsub.modes.normal_modes import _counted
from femsub.modes.receptance import port_responses
from femsub.modes.shift_invert import ShiftInvert
from femsub.motion.cycles.compliance import compliance
from femsub.motion.nonlinear_model import sliding
from femsub.stability import growing_border

BELT = fs.Belt("belt", force=1.0, slope=-1e-4)
BAND = (0.0, 0.02)


def made(call: Callable[[], object]) -> int:
    before = SparseFactor.made
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        call()
    return SparseFactor.made - before


def long_chain() -> fs.Substructure:
    return fs.chain(2500, belt=2, interface=(1, 900))


def plate(cells: tuple[int, int] = (14, 12)) -> fs.Substructure:
    """Its DOF are deflections and slopes, in units of their own."""
    return fs.plate(fs.rectangle((1.0, 0.8), cells), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01,
                    supports={"left": "clamped"}, interface=["right"], ports={"belt": (0.5, 0.4)}, rayleigh=(1.0, 1e-6))


@pytest.fixture
def nothing_shared(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    cache.drop()
    monkeypatch.setattr("femsub.algebra.processes.cache._kept", Forgetful())
    yield


class Forgetful(dict):  # type: ignore[type-arg]
    """Keeps nothing."""

    def __contains__(self, key: object) -> bool:
        return False


# counts ---------------------------------------------------------------------------------------------------------------

def test_the_second_search_for_modes_makes_none() -> None:
    for sub in (long_chain(), lattice(14, 11), lattice(14, 11, held=True)):
        assert made(lambda sub=sub: fs.normal_modes(sub, 5)) >= 2
        assert made(lambda sub=sub: fs.normal_modes(sub, 5)) == 0
        assert made(lambda sub=sub: fs.normal_modes(sub, 8)) == 1  # the count beyond another mode


def test_modes_that_rounding_moves_up_are_not_counted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sub, found, real = long_chain(), list[int](), algebra.symmetric_modes

    def moved(*arguments: Any, **options: Any) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = real(*arguments, **options)
        found.append(len(values))
        return values * (1 + 8 * EPS), shapes

    first = fs.normal_modes(sub, 5)
    monkeypatch.setattr(algebra, "symmetric_modes", moved)
    assert made(lambda: fs.normal_modes(sub, 5)) == 0 < len(found)
    assert fs.normal_modes(sub, 5).counted == first.counted


def test_bases_of_the_same_part_share_what_is_the_same() -> None:
    sub = long_chain()
    assert made(lambda: fs.reduce(sub, fs.CraigBampton(5))) == 2  # K_ii, and its count
    assert made(lambda: fs.reduce(sub, fs.CraigBampton(10))) == 1  # another count
    assert made(lambda: fs.reduce(sub, fs.CraigChang(5))) == 2  # K, and its count
    assert made(lambda: fs.reduce(sub, fs.CraigChang(10))) == 1
    assert made(lambda: fs.normal_modes(sub, 6)) == 0  # those below a limit counted before
    with pytest.warns(fs.PortWarning):
        assert fs.reduce(sub, fs.CraigChang(5)).factorisations == 0 == fs.reduce(sub, fs.CraigBampton(5)).factorisations


def test_a_factorisation_that_broke_down_is_told_of() -> None:
    chain = fs.chain(300).K.tolil()
    chain[0, 0] = 1.0  # free at both ends, with every other DOF turned round: no translation tells that it floats
    turned = sp.diags_array(np.where(np.arange(300) % 2, 1.0, -1.0))
    sub = fs.Substructure(sp.eye_array(300), turned @ chain.tocsr() @ turned)
    before = SparseFactor.made
    handle = ShiftInvert(sub.K, sub.M)
    assert handle.floating and handle.factorisations == SparseFactor.made - before == 2  # of K, in vain, and of K - σM


@pytest.mark.slow
def test_the_contacts_of_a_model_share_its_factor_and_its_count() -> None:
    sub = long_chain()
    assert made(lambda: fs.complex_modes(sub, BELT, band=BAND)) == 2
    other = fs.Belt("belt", force=2.0, slope=-1e-4)
    assert made(lambda: fs.complex_modes(sub, other, band=BAND)) == 0  # its damping is that of one column
    assert made(lambda: fs.normal_modes(sub, 10)) == 0
    belt = fs.Belt(slope=0.0)
    assert made(lambda: fs.sweep(long_chain(), belt, "slope", np.linspace(0, -1e-3, 20), band=BAND)) <= 3  # one bounds Re λ


@pytest.mark.slow
def test_a_border_takes_one_factor_and_one_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growing_border, "port_responses", None)  # nor one that nobody counts
    assert made(lambda: fs.critical_slope(long_chain(), band=BAND)) == 2
    assert made(lambda: fs.critical_slope(plate((34, 30)), band=(0.0, 1500.0))) == 2


@pytest.mark.parametrize(("damping", "iterated"), [(1e-3, True), (50.0, False)])
def test_a_response_beyond_the_basis_is_found_by_its_factor_or_by_a_complex_one(damping: float, iterated: bool,
                                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    sub = fs.chain(400, belt=2, damping=0.1)
    sub = sub.with_damping(sub.D + damping * sub.K)
    taken: list[int] = []
    monkeypatch.setattr(growing_border, "port_responses", lambda *given: taken.append(1) or port_responses(*given))
    W, omega = sub.port("belt")[:, None], 0.1
    basis = growing_border._Growing(sub.pencil, W, 0.2)
    Z = basis._beyond(omega)
    assert len(taken) == (not iterated)
    x = np.linalg.solve(sub.pencil.at(1j * omega).toarray(), W)
    space = np.linalg.qr(np.hstack([basis.V, Z.real, Z.imag]))[0]
    assert np.linalg.norm(x - space @ (space.T @ x)) < 1e-11 * np.linalg.norm(x)


def test_models_in_units_of_their_own_share_too() -> None:
    sub = plate()
    first = made(lambda: fs.complex_modes(sub, BELT, band=(0.0, 1500.0)))
    other = made(lambda: fs.complex_modes(sub, fs.Belt("belt", force=2.0, slope=-1.0), band=(0.0, 1500.0)))
    assert first <= 3 and other == 0  # damping is proportional beside the belt, whatever rounding left of small αM in it


def test_the_compliance_of_a_cycle_takes_one() -> None:
    contact = sliding(long_chain(), fs.Belt("belt", force=1.0, speed=0.1, law=fs.StribeckArctan(eps=1e-3)))
    found = []
    assert made(lambda: found.append(compliance(contact))) == 1
    assert made(lambda: found[0].mobility(0.005j * np.arange(1, 4))) == 0


def test_a_matrix_found_singular_is_not_tried_again() -> None:
    sub = lattice(14, 11, held=True)
    K = sp.csr_array(sub.K - 0.5 * sub.M)
    for tries in (1, 0):
        before = SparseFactor.made
        with pytest.raises(fs.SingularMatrixError, match="broke down"):
            shared_factor(K, "definite")
        assert SparseFactor.made - before == tries


# life -----------------------------------------------------------------------------------------------------------------

@pytest.mark.slow
def test_a_factor_dies_with_its_model() -> None:
    sub = plate()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        fs.normal_modes(sub, 3), fs.complex_modes(sub, BELT, count=4), ShiftInvert(sub.K, sub.M, sub.interior)
    handle = ShiftInvert(sub.K, sub.M, sub.interior)
    inner, outer = weakref.ref(handle.factor), weakref.ref(shared_factor(sub.K, "definite"))
    before = cache.kept_bytes()
    del handle
    gc.collect()
    assert inner() is not None and outer() is not None
    del sub
    gc.collect()
    assert inner() is None and outer() is None and cache.kept_bytes() < before
    assert all(at in cache._owners for owners, _ in cache._kept for at in owners)


def test_another_matrix_at_the_same_place_in_memory_never_passes_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = sp.csr_array(np.eye(3)), sp.csr_array(2 * np.eye(3))
    monkeypatch.setattr(cache, "id", lambda _: -1, raising=False)
    assert [cache.shared((A,), "trace", lambda A=A: A.trace()) for A in (one, other, one, one)] == [3, 6, 3, 3]
    cache.forget((one,), "trace")


def test_the_longest_unused_gives_way_first(monkeypatch: pytest.MonkeyPatch) -> None:
    cache.drop()
    subs = [lattice(14, 11, held=True) for _ in range(3)]
    one = shared_factor(subs[0].K, "definite").bytes
    assert 0 < one == pytest.approx(cache.kept_bytes(), abs=1)
    monkeypatch.setenv(cache.VARIABLE, str(2.5 * one))
    for sub in (subs[1], subs[0], subs[2]):
        shared_factor(sub.K, "definite")
    assert cache.kept_bytes() == pytest.approx(2 * one, abs=2)
    assert [made(lambda sub=sub: shared_factor(sub.K, "definite")) for sub in (subs[2], subs[0], subs[1])] == [0, 0, 1]
    monkeypatch.setenv(cache.VARIABLE, "0")
    factor = shared_factor(lattice(14, 11, held=True).K, "definite")
    assert cache.kept_bytes() == 0 and np.isfinite(factor.solve(np.ones(factor.size))).all()


def test_a_factor_is_released_by_the_name_of_its_model() -> None:
    sub, other = plate(), plate()
    for part in (sub, other):
        fs.normal_modes(part, 3), fs.complex_modes(part, BELT, count=4)
    in_use = shared_factor(sub.K, "definite")
    release(sub)
    assert made(lambda: fs.normal_modes(sub, 3)) > 0 == made(lambda: fs.normal_modes(other, 3))
    assert np.linalg.norm(sub.K @ in_use.solve(sub.port("belt")) - sub.port("belt")) < 1e-6  # nobody closed it


def test_what_is_kept_gives_way_before_memory_is_said_to_be_short(machine: Callable[..., None]) -> None:
    sub = lattice(40, 30, held=True)
    cache.drop()
    shared_factor(sub.K, "definite")
    need = sum(memory.reduction_bytes(sub.K, 2, 5).values())
    machine(free=lambda: 2 * need - cache.kept_bytes() * 2 * need, large=1000)
    memory.check_memory("lattice", sub.K, 2, 5, 2)
    assert cache.kept_bytes() == 0


def test_models_travel_without_their_factors() -> None:
    sub = lattice(14, 11, held=True)
    before = len(pickle.dumps(sub.K))
    shared_factor(sub.K, "definite")
    assert len(pickle.dumps(sub.K)) == before


@pytest.mark.parametrize("told", ["x", "-1", "nan"])
def test_a_limit_that_is_no_number_of_bytes_is_refused_each_time(told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sub = lattice(14, 11, held=True)
    monkeypatch.setenv(cache.VARIABLE, told)
    for _ in range(2):
        with pytest.raises(fs.InputError, match=cache.VARIABLE):
            shared_factor(sub.K, "definite")
    monkeypatch.setenv(cache.VARIABLE, "")  # as if it were not set
    assert [made(lambda: shared_factor(sub.K, "definite")) for _ in range(2)] == [1, 0]


def test_what_takes_no_room_does_not_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    cache.drop()
    monkeypatch.setenv(cache.VARIABLE, "10")
    owners = [np.zeros(1) for _ in range(50)]
    for owner in owners:
        cache.shared((owner,), "count", lambda: 1)
        cache.shared((owner,), "factor", lambda: 2, lambda _: 4.0)
    assert cache.kept_bytes() == 8
    assert [cache.shared((owner,), "count", lambda: 2) for owner in owners] == [1] * 50
    cache.drop(*owners)
    assert cache.kept_bytes() == 0 and not cache._kept


def test_of_many_bands_a_model_keeps_one_list_of_modes() -> None:
    sub = fs.chain(150)
    found = [fs.normal_modes(sub, band=(0.0, hi)) for hi in (0.1, 0.3, 0.2, 0.3, 0.1)]
    assert len(_counted(sub.K, sub.M)) == 1
    assert [len(modes.frequencies) for modes in found] == [int((fs.chain_frequencies(150) < hi).sum())
                                                           for hi in (0.1, 0.3, 0.2, 0.3, 0.1)]


def test_what_was_made_of_two_matrices_leaves_no_trace_in_the_one_that_lives_on() -> None:
    M = np.eye(3)
    for _ in range(5):
        K = np.eye(3)
        cache.shared((K, M), "count", lambda: 3)
        del K
    assert not any(id(M) in owners for owners, _ in cache._kept)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_process_forked_while_another_thread_looks_something_up_does_not_hang() -> None:
    owner, held, enough = np.zeros(1), threading.Event(), threading.Event()

    def hold() -> None:
        with cache._lock:
            held.set()
            enough.wait(0.3)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    child = os.fork()
    if not child:
        signal.alarm(3)
        cache.shared((owner,), "a", lambda: 1)
        os._exit(0)
    enough.set()
    assert os.waitpid(child, 0)[1] == 0
    thread.join()
    assert cache.shared((owner,), "a", lambda: 2) == 2


# numbers --------------------------------------------------------------------------------------------------------------

def answers(sub: fs.Substructure, band: tuple[float, float]) -> list[np.ndarray]:
    """Each asked twice, so that the second finds what the first has made; nothing that the sign of a shape would turn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = []
        for _ in range(2):
            rom = fs.reduce(sub, fs.CraigChang(5))
            found += [fs.normal_modes(sub, 5).eigenvalues, np.linalg.eigvalsh(rom.K), np.linalg.eigvalsh(rom.M),
                      fs.complex_modes(sub, BELT, band=band).eigenvalues,
                      fs.complex_modes(sub, BELT, count=6).eigenvalues]
        return found


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("make", "band"), [(long_chain, BAND), (plate, (0.0, 1500.0)), (lambda: lattice(9, 8), (0.0, 0.4))])
def test_no_number_depends_on_it(make: Callable[[], fs.Substructure], band: tuple[float, float],
                                 request: pytest.FixtureRequest) -> None:
    sub = make()
    if "belt" not in sub.ports:
        sub = fs.Substructure(sub.M, sub.K, 1e-2 * sub.M, sub.interface, {"belt": np.eye(sub.size)[7]})
    with_it = answers(sub, band)
    request.getfixturevalue("nothing_shared")
    for one, two in zip(with_it, answers(sub, band), strict=True):
        # mostly the same to the last digit; but where data lie in memory decides on BLAS' order of adding up, and a λ near 0
        # that is nearly defective has only half of its digits
        np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-8 * max(np.abs(two).max(), 1e-2 * band[1]))


# transposed -----------------------------------------------------------------------------------------------------------

def unsymmetric(n: int = 300) -> fs.Pencil:
    sub = fs.chain(n, belt=2, damping=0.1)
    rng = np.random.default_rng(4)
    rows, columns = rng.integers(0, n, (2, 40))
    return fs.Pencil(sub.M, sub.D, sub.K + sp.csr_array((1e-3 * rng.standard_normal(40), (rows, columns)), shape=(n, n)))


@pytest.mark.parametrize("kind", ["symmetric", "general"])
@pytest.mark.parametrize("shuffled", [False, True])
def test_mumps_takes_the_arrays_of_a_matrix_as_they_are(kind: Any, shuffled: bool) -> None:
    """Without stored diagonal entries, as of a saddle point, and with columns in any order."""
    rng, n, m = np.random.default_rng(0), 300, 40
    B = sp.csr_array(rng.standard_normal((n, m)) * (rng.random((n, m)) < 0.05) + np.eye(n, m))
    K = sp.diags_array([4.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n))
    A = sp.csr_array(sp.block_array([[K, B], [B.T, None]]))
    assert (A.diagonal()[n:] == 0).all() and not np.isin(np.arange(n, n + m), A.indices[A.indptr[n]:]).any()
    given = A
    if shuffled:
        order = np.concatenate([rng.permutation(np.arange(*ends)) for ends in zip(A.indptr, A.indptr[1:], strict=False)])
        given = sp.csr_array((A.data[order], A.indices[order], A.indptr), shape=A.shape)
    factor, b = SparseFactor(given, kind, probed=False), rng.standard_normal((n + m, 3))
    if factor.package != "mumps":
        pytest.skip("this PETSc factors it by another package")
    assert np.allclose(A @ factor.solve(b), b, atol=1e-10)
    if kind == "symmetric":
        assert factor.negative_pivots == (np.linalg.eigvalsh(A.toarray()) < 0).sum()


def test_one_factor_solves_with_the_transpose() -> None:
    K = unsymmetric().K
    b = np.random.default_rng(1).standard_normal((K.shape[0], 70))
    factor = SparseFactor(K, "general")
    for _ in range(2):  # one does not leave the other turned
        x, y = factor.solve(b), factor.transposed.solve(b)
        scale = np.linalg.norm(b) + 4 * np.linalg.norm(x) + 4 * np.linalg.norm(y)
        assert np.linalg.norm(K @ x - b) < 1e-12 * scale and np.linalg.norm(K.T @ y - b) < 1e-12 * scale
        assert np.linalg.norm(K @ y - b) > 1e-6 * np.linalg.norm(b)
    assert factor.transposed.transposed is factor
    symmetric = SparseFactor(fs.chain(200).K, "definite")
    assert symmetric.transposed is symmetric


def test_left_vectors_take_no_factor_of_their_own() -> None:
    assert made(lambda: fs.complex_modes(unsymmetric(QUADRATIC + 1), count=8, evidence=False)) == 1
    pencil = unsymmetric()
    found = fs.complex_modes(pencil, count=8)
    true = np.linalg.eigvals(np.block([[np.zeros((300, 300)), np.eye(300)], [-pencil.K.toarray(), -pencil.D.toarray()]]))
    off = np.abs(found.eigenvalues[:, None] - true).min(axis=1)
    assert np.isfinite(found.error_bar).all() and (off <= found.error_bar + 1e-12).all()


@pytest.mark.slow
def test_threads_may_solve_with_a_factor_and_with_its_transpose() -> None:
    K = unsymmetric().K
    factor, b = SparseFactor(K, "general"), np.random.default_rng(1).standard_normal((K.shape[0], 3))
    right = {turned: factor.solve(b, turned) for turned in (False, True)}
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(lambda i: np.array_equal(factor.solve(b, i % 2 == 1), right[i % 2 == 1]), range(1200)))
    finally:
        sys.setswitchinterval(before)
    assert all(found)


def test_what_goes_while_room_is_made_is_no_error() -> None:
    """Matrices go at each step of it, as the garbage collector may drop them."""
    cache.drop()
    owners = [sp.eye_array(4, format="csr") for _ in range(6)]
    for one in owners:
        cache.shared((one,), "kept", lambda: "result", lambda _: 8.0)

    def trace(frame: FrameType, event: str, _: object) -> Any:
        if event == "line" and owners and frame.f_code.co_filename == cache.__file__:
            sys.settrace(None)
            cache.drop(owners.pop())
            sys.settrace(trace)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        cache.give_up_until(lambda: False)
    finally:
        sys.settrace(before)
    assert not owners and not cache.kept_bytes()
