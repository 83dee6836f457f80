"""Hurty/Craig-Bampton and Craig-Chang: the relations that define them, on chains and lattices, held and floating."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from reducedproblems import rigid_motions

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.processes import threads
from femsub.modes.normal_modes import lowest_modes
from femsub.modes.shift_invert import ShiftInvert
from femsub.reduction.basis import projected

METHODS = [fs.CraigBampton, fs.CraigChang]
COMPONENTS = {
    "chain": lambda: fs.chain(12, belt=4, interface=(1, 12)), "long chain": lambda: fs.chain(400, belt=4, interface=(1, 400)),
    "floating chain": lambda: fs.chain(300, belt=4, interface=(1, 300), fixed=False),
    "floating lattice": lambda: lattice(5, 6), "large floating lattice": lambda: lattice(14, 11),
    "held lattice": lambda: lattice(12, 9, held=True),
    "dense": lambda: fs.Substructure(*(part.toarray() for part in (lattice(5, 6).M, lattice(5, 6).K)),
                                     interface=[0, 1, 58, 59], ports={"belt": np.eye(60)[30]}),
}


@pytest.fixture(params=COMPONENTS)
def component(request: pytest.FixtureRequest) -> fs.Substructure:
    return COMPONENTS[request.param]()


def quiet(sub: fs.Substructure, method: object, **options: object) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(sub, method, **options)


def columns(rom: fs.ReducedSubstructure, *kinds: str) -> np.ndarray:
    return rom.V[:, [kind in kinds for kind in rom.kinds]]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("ports", [False, True])
def test_matrices_are_projections(component: fs.Substructure, method: type, ports: bool) -> None:
    rom = quiet(component, method(5), ports=ports)
    for reduced, full in ((rom.M, component.M), (rom.D, component.D), (rom.K, component.K)):
        exact = rom.V.T @ (full @ rom.V)
        assert np.abs(reduced - exact).max() <= 1e-9 * max(1.0, np.abs(exact).max())
    assert np.array_equal(rom.ports["belt"], rom.V.T @ component.ports["belt"])
    assert len(rom.kinds) == rom.size and rom.factorisations == 1


@pytest.mark.parametrize("wide", [64, 70, 5])
def test_half_of_a_symmetric_projection_is_enough(wide: int, rng: np.random.Generator) -> None:
    A, V = fs.chain(200).K, rng.standard_normal((200, 90))
    np.testing.assert_allclose(projected(A, V, V[:, :wide], symmetric=True), V.T @ (A @ V[:, :wide]), rtol=1e-10, atol=1e-10)


def test_hcb_relations(component: fs.Substructure) -> None:
    rom = quiet(component, fs.CraigBampton(4))
    b, i = component.interface, component.interior
    constraint, fixed = columns(rom, "constraint"), columns(rom, "fixed-interface")
    assert np.array_equal(constraint[b], np.eye(len(b))) and np.array_equal(fixed[b], np.zeros((len(b), 4)))
    assert np.array_equal(rom.interface, np.arange(len(b)))
    force = component.K @ constraint
    assert np.abs(force[i]).max() < 1e-10
    assert np.abs(constraint.T @ (component.K @ fixed)).max() < 1e-10
    assert np.allclose(fixed.T @ (component.M @ fixed), np.eye(4), atol=1e-10)


@pytest.mark.parametrize(("name", "motions"), [
    ("floating chain", np.ones((300, 1))), ("floating lattice", rigid_motions(5, 6)),
    ("large floating lattice", rigid_motions(14, 11))])
def test_constraint_modes_of_a_floating_component_reproduce_rigid_motion(name: str, motions: np.ndarray) -> None:
    sub = COMPONENTS[name]()
    constraint = columns(quiet(sub, fs.CraigBampton(2)), "constraint")
    assert np.abs(constraint @ motions[sub.interface] - motions).max() < 1e-9 * np.abs(motions).max()


def test_craig_chang_relations(component: fs.Substructure) -> None:
    rom = quiet(component, fs.CraigChang(4))
    kept, residual = columns(rom, "rigid", "free"), columns(rom, "residual attachment")
    assert np.allclose(rom.V.T @ (component.M @ rom.V), np.eye(rom.size), atol=1e-8)
    scale = np.abs(residual.T @ (component.K @ residual)).max()
    assert np.abs(kept.T @ (component.K @ residual)).max() < 1e-9 * scale
    assert np.abs(kept.T @ (component.M @ residual)).max() < 1e-9
    # with the interface forces the reduced model is statically exact, up to rigid motion
    F = np.zeros((component.size, len(component.interface)))
    F[component.interface, np.arange(len(component.interface))] = 1.0
    rigid = columns(rom, "rigid")
    F -= component.M @ (rigid @ (rigid.T @ F))
    elastic = np.diag(rom.K) > 0
    u = rom.V[:, elastic] @ ((rom.V[:, elastic].T @ F) / np.diag(rom.K)[elastic][:, None])
    assert np.abs(component.K @ u - F).max() < 1e-8


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [10, 60])
def test_every_mode_kept_gives_the_full_spectrum(method: type, n: int) -> None:
    sub = fs.chain(n, belt=2)
    rom = quiet(sub, method(n - 1))
    assert rom.size == n and np.isinf(rom.cutoff)
    assert np.abs(np.sqrt(la.eigvalsh(rom.K, rom.M)) / fs.chain_frequencies(n) - 1).max() < 1e-11
    belt = fs.Belt(slope=-0.2677)
    full, reduced = (np.sort_complex(fs.complex_modes(model, belt).eigenvalues) for model in (sub, rom))
    assert np.abs(full - reduced).max() < 1e-11


def test_craig_chang_with_every_mode_says_that_nothing_is_left() -> None:
    rom = quiet(fs.chain(10, belt=2), fs.CraigChang(10), ports=True)
    assert rom.size == 10 and rom.dropped == 2 and set(rom.kinds) == {"free"}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("method", METHODS)
def test_ritz_values_bound_from_above_and_fall(component: fs.Substructure, method: type) -> None:
    exact = la.eigvalsh(*(part.toarray() if sp.issparse(part) else part for part in (component.K, component.M)))
    previous = None
    for modes in (0, 1, 3, 6):
        rom = quiet(component, method(modes))
        values = la.eigvalsh(rom.K, rom.M)
        slack = 1e-10 * exact[-1]
        assert (values >= exact[:len(values)] - slack).all()
        if previous is not None:
            assert (values[:len(previous)] <= previous + slack).all()
        previous = values


@pytest.mark.parametrize("method", METHODS)
def test_port_error_is_the_static_error(method: type) -> None:
    sub = fs.chain(10, belt=2)
    with pytest.warns(fs.PortWarning, match="port 'belt' of 'chain': its static response is off by"):
        rom = fs.reduce(sub, method(4))
    w = sub.ports["belt"]
    exact = np.linalg.solve(sub.K.toarray(), w)
    error = exact - rom.V @ np.linalg.solve(rom.K, rom.V.T @ w)
    assert rom.port_error["belt"] == pytest.approx(np.sqrt(error @ (sub.K @ error) / (exact @ w)), rel=1e-8)
    if method is fs.CraigBampton:
        assert error[1] / exact[1] == pytest.approx(0.13, abs=0.01)  # DESIGN: 13 % at m2


@pytest.mark.parametrize("method", METHODS)
def test_the_two_remedies_silence_the_warning(method: type) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", fs.PortWarning)
        joined = fs.reduce(fs.chain(10, belt=2), method(4), ports=True)
        widened = fs.reduce(fs.chain(10, belt=2, interface=(1, 2)), method(3))
    assert joined.port_error["belt"] < 1e-6 and widened.port_error["belt"] < 1e-6
    assert joined.size == 6 and widened.size == 5


def test_permuted_dof_and_other_units_change_no_digit(rng: np.random.Generator) -> None:
    plain = lattice(12, 9, held=True)
    order = rng.permutation(plain.size)
    place = np.argsort(order)
    other = fs.Substructure(1e-3 * plain.M[order][:, order], 1e6 * plain.K[order][:, order], interface=place[plain.interface])
    for method in (fs.CraigBampton(5), fs.CraigChang(5)):
        here = la.eigvalsh(*(getattr(quiet(plain, method), key) for key in "KM"))
        there = la.eigvalsh(*(getattr(quiet(other, method), key) for key in "KM"))
        assert np.allclose(there * 1e-9, here, rtol=1e-9)


def test_one_factorisation_per_basis() -> None:
    for sub in (lattice(14, 11), lattice(14, 11, held=True)):
        for method in (fs.CraigBampton(5), fs.CraigChang(5)):
            before = SparseFactor.made
            quiet(sub, method)
            assert SparseFactor.made - before == 2  # the basis, and the independent count


def test_a_reduced_model_reduces_again() -> None:
    first = quiet(fs.chain(300, belt=2, interface=(1, 2)), fs.CraigBampton(20))
    second = quiet(first, fs.CraigBampton(6))
    assert second.size == 8 and second.cutoff <= first.cutoff
    lowest = np.sqrt(la.eigvalsh(second.K, second.M))[0]
    assert lowest == pytest.approx(fs.chain_frequencies(300, 1)[0], rel=1e-5)


def test_interface_empty_or_everything() -> None:
    K, M = fs.chain(20).K, fs.chain(20).M
    modal = fs.reduce(fs.Substructure(M, K), fs.CraigBampton(3))
    assert np.allclose(np.sqrt(np.diag(modal.K)), fs.chain_frequencies(20, 3), rtol=1e-12)
    whole = fs.reduce(fs.Substructure(M, K, interface=range(20)), fs.CraigBampton(0))
    assert np.array_equal(whole.K, K.toarray()) and np.isinf(whole.cutoff)


def test_inertia_relief_takes_about_as_many_solves_as_constraint_modes() -> None:
    """Each elastic solution converges by a known rate, which tells when the next correction is not worth a solve."""
    sub = lattice(30, 24)
    wide = fs.Substructure(sub.M, sub.K, interface=np.arange(0, sub.size, 6))
    columns = len(wide.interface)
    handle = ShiftInvert(wide.K, wide.M)
    forces = np.eye(wide.size)[:, wide.interface]
    before = handle.factor.columns
    x = handle.elastic_solve(forces)
    assert handle.sigma < 0 and handle.factor.columns - before <= 4 * columns
    b = forces - wide.M @ (handle.rigid @ (handle.rigid.T @ forces))
    assert np.abs(wide.K @ x - b).max() <= 1e-11 and np.abs(handle.rigid.T @ (wide.M @ x)).max() <= 1e-11
    kept = lowest_modes(handle, 20).shapes
    before = handle.factor.columns
    handle.elastic_solve(forces, kept)
    assert handle.factor.columns - before <= 3 * columns


def test_a_load_that_moves_only_rigidly_ends_no_other_column_early() -> None:
    sub = lattice(30, 24)
    handle = ShiftInvert(sub.K, sub.M)
    forces = np.hstack([np.zeros((sub.size, 1)), sub.M @ handle.rigid, np.eye(sub.size)[:, [0, 77]]])
    x = handle.elastic_solve(forces)
    alone = handle.elastic_solve(forces[:, -2:])
    assert np.abs(x[:, -2:] - alone).max() <= 1e-11 * np.abs(alone).max()
    assert np.abs(x[:, :-2]).max() <= 1e-9 * np.abs(alone).max()


@pytest.mark.parametrize("n", [90, 1000])
def test_small_reductions_use_one_blas_thread_and_give_the_others_back(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of NumPy's, SciPy's and PETSc's BLAS stand in each other's way: 0.1 s for 100 DOF, 0.005 s without."""
    fs.reduce(fs.chain(n), fs.CraigBampton(2))  # every library is loaded
    controls = [(lambda one=one: one.num_threads, one.set_num_threads) for one in threads.libraries().lib_controllers]
    if not controls:
        pytest.skip("no OpenBLAS that can be told its number of threads")
    before, seen = [get() for get, _ in controls], []
    original = fs.CraigBampton.statics

    def noted(self: fs.CraigBampton, *given: object) -> object:
        seen.extend(get() for get, _ in controls)
        return original(self, *given)

    monkeypatch.setattr(fs.CraigBampton, "statics", noted)
    fs.reduce(fs.chain(n), fs.CraigBampton(5))
    assert set(seen) == {1} and [get() for get, _ in controls] == before
    with pytest.raises(fs.InputError):
        fs.reduce(fs.chain(n), fs.CraigBampton(n + 5))
    assert [get() for get, _ in controls] == before
    with threads.one_thread(False):
        assert [get() for get, _ in controls] == before
