"""A small model over a box of parameters: its numbers of eigenvalues are right for all values, and its error bars hold."""

from __future__ import annotations

import math
import pickle
import re
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from brakescene import brake_models
from scipy.io import loadmat

import femsub as fs
from femsub.checks import FemsubWarning, InputError
from femsub.modes import eigenpairs
from femsub.modes.quadratic import projected_count
from femsub.reduction import over_box, parameter_box, states
from femsub.reduction.states import iterated, spread
from femsub.stability.labels import sources_of


def truth(pencil: fs.Pencil) -> np.ndarray:
    """All eigenvalues by LAPACK on a companion form."""
    M, D, K = (np.asarray(part.toarray() if sp.issparse(part) else part) for part in (pencil.M, pencil.D, pencil.K))
    n = len(M)
    return la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]]),
                      np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), M]]))


def inverse(speed):
    return 1 / speed


def together(mu, speed):
    return mu / speed


def family(seed: int, n: int = 60) -> fs.Affine:
    """A damped net of springs with a circulatory, a gyroscopic and a damping term that depend on μ and a speed."""
    rng = np.random.default_rng(seed)
    M, K = fs.chain(n).M, fs.chain(n).K
    extra = sp.random_array((n, n), density=3 / n, rng=rng)
    K = sp.csr_array(K + sp.diags_array(rng.uniform(0.0, 0.2, n)) + 0.1 * extra @ extra.T)
    rub = sp.random_array((n, n), density=2 / n, rng=rng)
    dashpots = sp.diags_array(rng.uniform(0.0, 0.1, n) * (rng.random(n) < 0.2))
    turn = sp.random_array((n, n), density=1 / n, rng=rng)
    return fs.Affine(M, [(1.0, 1e-3 * K), (inverse, dashpots), ("speed", sp.csr_array(0.01 * (turn - turn.T)))],
                     [(1.0, K), ("mu", sp.csr_array(0.01 * rub)), (together, sp.csr_array(0.005 * rub.T))])


@cache
def reduced_family(seed: int) -> fs.BoxModel:
    """Several tests ask the same one."""
    return fs.reduce(family(seed), fs.ParameterBox({"mu": (0.0, 1.0), "speed": (0.5, 2.0)}, (0.0, 0.5)))


def check(small: fs.BoxModel, full, band: tuple[float, float], places: list[dict[str, float]]) -> None:
    """Numbers inside the contours, and every λ in the band within the error bar of one of the small model, and the reverse."""
    for place in places:
        cell, every, found = small.cell(**place), truth(full(**place)), small.modes(**place)
        if cell.number is not None:
            assert np.count_nonzero(cell.contour.encloses(every)) == cell.number, place
        lam, bar = found.eigenvalues, found.error_bar
        rounding = 1e-12 * band[1]
        assert (np.abs(lam[:, None] - every).min(axis=1) <= bar + rounding).all(), place
        deep = every[(every.imag >= band[0] + 1e-4) & (every.imag <= band[1] - 1e-4) & (np.abs(every.real) <= band[1] - 1e-4)]
        assert (np.abs(deep[:, None] - lam).min(axis=1, initial=np.inf) <= bar.max(initial=0.0) + rounding).all(), place
        near = (np.abs(every.real) <= band[1]) & (np.abs(every.imag) <= band[1]) & (np.abs(every.imag) >= band[0])
        growing = every[near].real.max(initial=-np.inf)
        if found.is_stable is not None and abs(growing) > 1e-10:
            assert found.is_stable == (growing < 0), place


@pytest.mark.sampled(4)  # the quick ones are shared with other tests
@pytest.mark.parametrize("seed", range(6))
def test_random_families(seed):
    band, ranges = (0.0, 0.5), {"mu": (0.0, 1.0), "speed": (0.5, 2.0)}
    full, small = family(seed), reduced_family(seed)
    assert small.evidence == "certified" and small.open_share == 0
    rng = np.random.default_rng(seed)
    corners = [{"mu": mu, "speed": speed} for mu in (0.0, 1.0) for speed in (0.5, 2.0)]
    places = [{name: float(rng.uniform(*ends)) for name, ends in ranges.items()} for _ in range(4)]
    check(small, full.at, band, corners + places)
    assert small.error < 1e-6


def test_chain_on_a_belt_and_its_loss():
    chain, band = fs.chain(60, belt=5, damping=0.1), (0.0, 0.5)
    small = fs.reduce(chain, fs.ParameterBox({"slope": (-0.02, 0.0)}, band), contacts=fs.Belt(slope=0.0))
    check(small, lambda slope: chain.linearised(fs.Belt(slope=slope)), band, [{"slope": p} for p in (-0.02, -0.013, -0.004, 0.0)])
    ours = fs.critical_value(small, None, "slope", between=(0.0, -0.02))

    def growing(slope: float) -> int:
        every = truth(chain.linearised(fs.Belt(slope=slope)))
        return int(np.count_nonzero((every.real > 0) & (every.imag > 0) & (every.imag < band[1])))

    assert len(ours.losses) == growing(-0.02) > 1 and not ours.regains
    for place, one in enumerate(ours.losses):
        assert [growing(one.value * share) for share in (1 - 1e-5, 1 + 1e-5)] == [place, place + 1]


@pytest.mark.parametrize("unlike", [False, True])
def test_shapes_of_the_full_model(unlike):
    full = family(7)
    if unlike:  # DOF in units that differ by up to 10⁴
        unit = sp.diags_array(10.0 ** np.linspace(-2, 2, full.size))
        full = full._each(lambda theta, A: (theta, sp.csr_array(unit @ A @ unit)))
    small = fs.reduce(full, fs.ParameterBox({"mu": (0.0, 0.5), "speed": (1.0, 2.0)}, (0.0, 0.4)))
    modes = small.modes(mu=0.3, speed=1.3)
    pencil = full.at(mu=0.3, speed=1.3)
    X = small.expand(modes.shapes)
    residual = np.linalg.norm(pencil.residual(modes.eigenvalues, X), axis=0)
    assert (residual < 1e-4 * pencil.norms[2] * np.linalg.norm(X, axis=0)).all()
    check(small, full.at, (0.0, 0.4), [{"mu": 0.3, "speed": 1.3}])


@pytest.mark.slow
def test_an_eigenvalue_that_crosses_a_contour_divides_the_box():
    # the second mass moves from ω = 0.7 to 1.5: across all edges that a contour around the band may have
    full = fs.Affine(np.eye(3), 0.01 * np.eye(3), [(1.0, np.diag([0.3, 0.0, 9.0])), ("k", np.diag([0.0, 1.0, 0.0]))])
    small = fs.reduce(full, fs.ParameterBox({"k": (0.49, 2.25)}, (0.0, 1.0)))
    assert small.evidence == "certified" and len(small.cells) > 1
    check(small, full.at, (0.0, 1.0), [{"k": k} for k in np.linspace(0.49, 2.25, 60).tolist()])
    assert small.number(k=0.5) == 4 and small.number(k=2.2) == 2
    line = fs.reduce(fs.Affine(full.M, full.D, [*full.K, ("a", np.zeros((3, 3)))]),
                     fs.ParameterBox({"k": (0.49, 2.25), "a": (0.0, 1.0)}, (0.0, 1.0)))
    edge = max(hi for cell in line.cells if (hi := cell.ranges["k"][1]) < 2.25)  # of two cells one has it
    assert len(line.fixed(k=edge).cells) == 1 and line.fixed(k=edge).number(a=0.5) is not None
    open_cells = r"100\.0% of the box is not proved after 1 cells: k from 0\.49 to 1\.37 \(.* at s = .*\).* or cells=4"
    with pytest.warns(FemsubWarning, match=open_cells):
        small = fs.reduce(full, fs.ParameterBox({"k": (0.49, 2.25)}, (0.0, 1.0), cells=1))
    place = complex(re.search(r"at s = (\S+) for", small.cells[0].why)[1].replace("i", "j"))
    assert 0.6 < abs(place) < 1.6  # where the second mass moves
    assert small.open_share == 1 and small.evidence == "not checked" and small.number(k=0.5) is None
    check(small, full.at, (0.0, 1.0), [{"k": k} for k in (0.49, 0.8, 0.99)])


def test_a_factor_that_takes_no_interval_is_sampled():
    sampled = (lambda k: math.sin(k), np.diag([0.0, 1.0, 0.0]))
    full = fs.Affine(np.eye(3), 0.01 * np.eye(3), [(1.0, np.diag([0.3, 0.5, 9.0])), sampled])
    small = fs.reduce(full, fs.ParameterBox({"k": (0.0, 0.2)}, (0.0, 1.0)))
    assert small.evidence == "confirmed" and small.modes(k=0.1).evidence == "confirmed"
    check(small, full.at, (0.0, 1.0), [{"k": k} for k in (0.0, 0.13, 0.2)])


@pytest.mark.slow
def test_a_box_too_wide_for_the_bound_is_open_at_its_ends(monkeypatch):
    monkeypatch.setattr(projected_count, "WIDE", 40)  # as of a model too large to be its own basis
    # there gyroscopic forces may outweigh the stiffness of what is outside the basis
    n = 80
    K, turn = fs.chain(n).K, sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[1, -1])
    full = fs.Affine(sp.eye_array(n), [(1.0, 1e-3 * K), ("speed", sp.csr_array(turn))], K)
    with pytest.warns(FemsubWarning, match="of the box is not proved"):
        small = fs.reduce(full, fs.ParameterBox({"speed": (-0.03, 0.03)}, (0.0, 0.5)))
    assert small.evidence == "not checked" and 0 < small.open_share < 0.5 and small.error < 1e-6
    check(small, full.at, (0.0, 0.5), [{"speed": speed} for speed in (-0.03, -0.01, 0.013, 0.03)])


def test_a_parameter_that_leaves_c_as_it_is_is_not_halved(monkeypatch):
    """Where other shapes may lack stiffness, the range of the parameter that takes it is halved, not that of the first one."""
    monkeypatch.setattr(projected_count, "WIDE", 40)
    n = 80
    K, turn = fs.chain(n).K, sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[1, -1])
    spring = sp.csr_array(([0.1], ([4], [4])), shape=(n, n))
    full = fs.Affine(sp.eye_array(n), [(1.0, 1e-3 * K), ("speed", sp.csr_array(turn))], [(1.0, K), ("spring", spring)])
    with pytest.warns(FemsubWarning, match="of the box is not proved"):
        small = fs.reduce(full, fs.ParameterBox({"spring": (0.0, 1.0), "speed": (-0.03, 0.03)}, (0.0, 0.5), cells=8))
    assert 0 < small.open_share < 1 and {cell.ranges["spring"] for cell in small.cells} == {(0.0, 1.0)}


def test_a_small_model_may_be_its_own_basis():
    """Where gyroscopic forces outweigh the stiffness at every value, nothing may be left out, and the count is proved."""
    n = 46
    K, turn = fs.chain(n).K, sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[1, -1])
    full = fs.Affine(sp.eye_array(n), [(1.0, 0.1 * sp.diags_array(np.linspace(0, 1, n))), ("speed", sp.csr_array(turn))], K)
    small = fs.reduce(full, fs.ParameterBox({"speed": (1.0, 1.1)}, (0.0, 0.5)))
    assert small.evidence == "certified"
    check(small, full.at, (0.0, 0.5), [{"speed": speed} for speed in (1.0, 1.03, 1.1)])


def test_rigid_motion_stays_at_zero():
    full = fs.Affine(np.eye(3), None, [(1.0, np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])),
                                       ("k", np.array([[1.0, -1, 0], [-1, 1, 0], [0, 0, 0]]))])
    small = fs.reduce(full, fs.ParameterBox({"k": (0.0, 0.5)}, (0.0, 1.3)))
    modes = small.modes(k=0.25)
    assert (modes.eigenvalues[:2] == 0).all() and modes.rigid[:2].all() and modes.evidence == "certified"
    assert small.number(k=0.1) == 4


def test_rigid_motion_that_dashpots_and_friction_act_on():
    """It has no stiffness of its own, and yet dashpots of 10⁵ and friction leave all digits to the other shapes."""
    n = 40
    K = fs.chain(n).K - sp.csr_array(([1.0], ([0], [0])), shape=(n, n))
    dashpots = sp.csr_array(([1e5, 5e4], ([2, 5], [2, 5])), shape=(n, n))
    rub = sp.random_array((n, n), density=3 / n, rng=np.random.default_rng(3))
    full = fs.Affine(sp.eye_array(n), dashpots, [(1.0, K), ("k", K), ("mu", sp.csr_array(0.01 * (rub - rub.T)))])
    small = fs.reduce(full, fs.ParameterBox({"mu": (0.9, 1.0), "k": (0.0, 0.01)}, (0.1, 0.5)))
    assert small.evidence == "certified" and len(small.cells) == 1 and small.size < n and small.error < 1e-6
    check(small, full.at, (0.1, 0.5), [{"mu": 0.9, "k": 0.0}, {"mu": 0.95, "k": 0.005}])


def test_without_an_eigenvalue_no_shape_has_one():
    """Friction moves the only mode in the band out of `re`; on its undamped shape alone it would still be there."""
    friction = np.array([[0.0, 1.0], [-1.0, 0.0]])
    full = fs.Affine(np.eye(2), 0.01 * np.eye(2), [(1.0, fs.chain(2).K), ("mu", friction)])
    small = fs.reduce(full, fs.ParameterBox({"mu": (4.0, 5.0)}, (0.0, 3.0), re=(-0.03, 0.2)))
    assert small.evidence == "certified" and [cell.number for cell in small.cells] == [0]
    modes = small.modes(mu=4.5)
    assert len(modes) == 0 and modes.evidence == "certified"


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_a_band_far_from_all_modes_is_empty(damping):
    """Without a shape to keep, the number is 0 all the same, for all values."""
    K = fs.chain(60).K + sp.eye_array(60)
    full = fs.Affine(sp.eye_array(60), damping * K, [(1.0, sp.csr_array(K)), ("k", sp.csr_array(K))])
    small = fs.reduce(full, fs.ParameterBox({"k": (0.0, 0.05)}, (0.0, 0.1)))
    assert small.evidence == "certified" and [cell.number for cell in small.cells] == [0]
    modes = small.modes(k=0.03)
    assert len(modes) == 0 and modes.evidence == "certified" and small.error == 0


def test_some_of_the_parameters_may_be_fixed():
    small = reduced_family(4)
    part = small.fixed(speed=1.0)
    assert part.parameters == ("mu",) and part.evidence == small.evidence
    np.testing.assert_allclose(part.modes(mu=0.4).eigenvalues, small.modes(mu=0.4, speed=1.0).eigenvalues, rtol=1e-12)
    assert part.number(mu=0.4) == small.number(mu=0.4, speed=1.0)
    point = small.fixed(speed=1.0, mu=0.4)  # all of them
    np.testing.assert_allclose(point.modes().eigenvalues, part.modes(mu=0.4).eigenvalues, rtol=1e-12)
    assert point.number() == part.number(mu=0.4) and len(point.modes_over()) == 1 and "one value" in repr(point)
    again = pickle.loads(pickle.dumps(part))
    assert repr(again) == repr(part) and again.number(mu=0.4) == part.number(mu=0.4)
    found = fs.complex_modes(small.at(mu=0.4, speed=1.0), band=(0.0, 0.5))
    np.testing.assert_allclose(np.sort_complex(found.eigenvalues), np.sort_complex(part.modes(mu=0.4).eigenvalues),
                               rtol=small.box.tol)


def test_states_that_stay_know_how_far_they_are_off():
    """`scatter` encloses eigenvalues on the states of a place: so it asks at corners of its neighbourhood."""
    small, rng = reduced_family(4), np.random.default_rng(4)
    seen = []
    for cell, source in zip(small.cells, sources_of(small), strict=True):
        ends = np.array([cell.ranges[name] for name in small.parameters])
        for reach in (0.0, 0.03, 0.1):
            place, half = rng.uniform(*(ends @ [[0.7, 0.3], [0.3, 0.7]]).T), reach * np.ptp(ends, axis=1)
            off, fixed = source.error(place, place - half, place + half), source.linear(place)
            for side in rng.uniform(-1, 1, (4, 2)):
                values = dict(zip(small.parameters, (place + side * half).tolist(), strict=True))
                a, b = (np.tensordot(np.append(1.0, small.factors(**values)), part, 1) for part in (fixed.a, fixed.b))
                every, found = truth(family(4).at(**values)), fixed.unit * la.eigvals(a, b)
                far = np.abs(found[:, None] - every).min(axis=1)
                assert (far <= off * np.abs(found) + 1e-9).all() and len(found) == cell.number
            seen.append((reach, off))
    assert max(off for reach, off in seen if not reach) <= small.box.tol
    assert min(off for reach, off in seen if reach > 0.05) > 3 * small.box.tol
    lacks = replace(cell, number=cell.number + 2)
    assert small.distance(lacks, cell.states, values) == np.inf


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(3))
def test_a_box_may_end_beside_the_axis(seed):
    """Fewer shapes, and still all that grows or decays slowly."""
    full, band = family(seed), (0.0, 0.5)
    strong = sp.diags_array(np.where(np.arange(full.size) < 20, 6.0, 0.0))
    full = fs.Affine(full.M, [*full.D, (1.0, sp.csr_array(strong))], full.K)
    wide, near = (fs.reduce(full, fs.ParameterBox({"mu": (0.0, 1.0), "speed": (0.5, 2.0)}, band, re=re))
                  for re in (None, (-0.03, 0.5)))
    assert near.evidence == "certified" and near.size < wide.size
    assert "Re λ from -0.03 to 0.5" in repr(near.box)
    for place in ({"mu": 0.0, "speed": 0.5}, {"mu": 1.0, "speed": 2.0}, {"mu": 0.3, "speed": 0.9}):
        every, cell, found = truth(full.at(**place)), near.cell(**place), near.modes(**place)
        assert np.count_nonzero(cell.contour.encloses(every)) == cell.number
        wanted = every[(every.real > -0.0299) & (every.imag >= 0) & (every.imag < 0.4999)]
        assert len(wanted) > 1
        assert (np.abs(wanted[:, None] - found.eigenvalues).min(axis=1) < found.error_bar.max() + 1e-11).all()
        assert (np.abs(found.eigenvalues[:, None] - every).min(axis=1) < found.error_bar + 1e-11).all()
        assert found.searched == (-0.03, 0.5, *band) and (found.eigenvalues.real >= -0.03).all()
    assert near.fixed(mu=0.5).box.re == (-0.03, 0.5)


def test_radii_beside_dashpots_of_a_million_times_critical():
    """Squares of their images, and norms of their rounding, leave few digits or none for modes in which they stand still."""
    n, band = 16, (0.0, 0.7)
    K, strong = fs.chain(n).K, np.zeros(n)
    strong[[3, 11]] = 2e6
    full = fs.Affine(sp.eye_array(n), [(1.0, 1e-3 * K), (1.0, sp.diags_array(strong))],
                     [(1.0, K), ("k", sp.diags_array(np.linspace(0.0, 0.1, n)))])
    small = fs.reduce(full, fs.ParameterBox({"k": (0.0, 1.0)}, band))
    assert small.evidence == "certified"
    found, exact = small.modes(k=0.4), fs.complex_modes(full.at(k=0.4), band=band)
    assert len(found) == len(exact) > 3 and (found.error_bar < 1e-4 * np.abs(found.eigenvalues)).all()
    apart = np.abs(found.eigenvalues[:, None] - exact.eigenvalues) - exact.error_bar
    assert (apart.min(axis=1) <= found.error_bar).all()


def test_rounding_beside_strong_dashpots_is_not_learnt_from():
    """LAPACK's λ of a node are off by more than their radii; the estimate of what lies outside the basis stays what it was."""
    n = 16
    K, strong, turn = fs.chain(n).K, np.zeros(n), np.linspace(0.05, 0.1, n - 1)
    strong[[3, 8, 11]] = 1e5, 2e5, 3e5
    full = fs.Affine(sp.eye_array(n), [(1.0, 1e-3 * K), (1.0, sp.diags_array(strong)),
                                       ("speed", sp.diags_array([turn, -turn], offsets=[1, -1]))], K)
    small = fs.reduce(full, fs.ParameterBox({"speed": (0.0, 1.0)}, (0.0, 0.7)))
    assert small.evidence == "certified" and small.error < 1e-6 and small.radii.least > 1e-3


def test_many_values_are_those_one_by_one():
    small, mu = reduced_family(0), np.linspace(0.0, 1.0, 7)
    many = small.modes_over(mu=mu, speed=1.5)
    assert len(many) == 7
    for p, found in zip(mu.tolist(), many, strict=True):
        alone = small.modes(mu=p, speed=1.5)
        assert np.array_equal(found.eigenvalues, alone.eigenvalues) and np.array_equal(found.error_bar, alone.error_bar)
    assert len(small.modes_over(mu=np.zeros((2, 3)), speed=1.0)) == 6
    with pytest.raises(InputError, match="speed = 3 is outside the box"):
        small.modes_over(mu=mu, speed=[1.0, 3.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    with pytest.raises(InputError, match=r"equal shape, or numbers, but these are mu \(7,\), speed \(2,\)"):
        small.modes_over(mu=mu, speed=[1.0, 2.0])


def pressed(seed: int = 0, n: int = 45) -> fs.Affine:
    """Two chains that touch, as the parts of a brake: the contact's stiffness is 0.2 + 0.1 p, its friction μ times that; the
    second half of the second chain, its lining, has the stiffness E times that of the others.
    """
    one = fs.chain(n)
    M, K = sp.block_diag([one.M, one.M], format="csr"), sp.block_diag([one.K, one.K], format="csr")
    lining = sp.csr_array(sp.diags_array(np.where(np.arange(n - 1) >= n // 2, 1.0, 0.0)))
    jump = sp.diags_array([-np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n))
    soft = sp.csr_array(sp.block_diag([sp.csr_array((n, n)), jump.T @ lining @ jump]))
    rows = np.random.default_rng(seed).choice(n, 6, replace=False)
    N = sp.csr_array((np.tile([1.0, -1.0], 6), (np.repeat(np.arange(6), 2), np.stack([rows, n + rows], axis=1).ravel())),
                     shape=(6, 2 * n))
    T = sp.csr_array((np.ones(6), (np.arange(6), n + (rows + 3) % n)), shape=(6, 2 * n))
    A, B = N.T @ N, 0.2 * (T.T @ N)

    def both(mu, pressure):
        return mu * pressure

    touching = [(1.0, 0.2 * A), ("pressure", 0.1 * A), ("mu", 0.2 * B), (both, 0.1 * B)]
    return fs.Affine(M, 1e-2 * K, [(1.0, K - soft), ("E", soft), *touching])


def test_values_of_the_greedy_search_take_no_eigenproblem_of_the_basis(monkeypatch):
    """Their pairs come from the small model by inverse iteration, and are the same. Only corners are decomposed."""
    whole, pairs = [], []
    node, predicted = over_box._Maker.node, over_box._Maker.predicted

    def both(self, values, model):
        found, exact = predicted(self, values, model), node(self, values, model.cell(**values).contour)
        pairs.append((found, exact))
        return found

    monkeypatch.setattr(over_box._Maker, "node", lambda self, *given: whole.append(given) or node(self, *given))
    monkeypatch.setattr(over_box._Maker, "predicted", both)
    small = fs.reduce(family(3), fs.ParameterBox({"mu": (0.0, 1.0), "speed": (0.5, 2.0)}, (0.0, 0.5)))
    assert small.evidence == "certified"
    assert len(whole) == 4 and len(pairs) > 1
    for found, exact in pairs:
        order = [np.abs(found.lam - lam).argmin() for lam in exact.lam]
        assert sorted(order) == list(range(len(exact.lam)))
        assert np.abs(found.lam[order] - exact.lam).max() < 1e-11 * np.abs(exact.lam).max()
        for mine, other in ((found.x[:, order], exact.x), (found.z[:, order], exact.z)):
            lengths = np.linalg.norm(mine, axis=0) * np.linalg.norm(other, axis=0)
            assert (np.abs(np.einsum("ik,ik->k", mine.conj(), other)) > (1 - 1e-8) * lengths).all()


@pytest.mark.parametrize("q", [1, 2, 3])
def test_points_are_spread_evenly(q):
    """Each of 8 equal parts of the cube in each direction has nearly its share, and no two points are close."""
    points = spread(128, q)
    assert points.shape == (128, q) and (points >= 0).all() and (points < 1).all()
    for column in points.T:
        assert np.abs(np.histogram(column, 8, (0, 1))[0] - 16).max() <= 5
    apart = np.abs(points[:, None] - points)
    apart = np.linalg.norm(np.minimum(apart, 1 - apart), axis=2)[np.triu_indices(128, 1)]
    assert apart.min() > 0.5 * 128 ** (-1 / q)


@pytest.mark.slow
def test_three_parameters_of_joined_parts(monkeypatch):
    """All of the box is proved, each λ lies in its radius, and states that move with the parameters list them.

    States at the nine corners and middles, which do not move, were more than half of all: none of the values was without a
    decomposition of the whole small model.
    """
    full, band = pressed(), (0.0, 0.3)
    ranges = {"mu": (0.0, 0.6), "E": (0.8, 1.25), "pressure": (0.5, 2.0)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        small = fs.reduce(full, fs.ParameterBox(ranges, band))
    assert small.evidence == "certified" and small.error < 1e-6
    rng = np.random.default_rng(1)
    places, whole = [{name: float(rng.uniform(*ends)) for name, ends in ranges.items()} for _ in range(6)], []
    monkeypatch.setattr(parameter_box, "eigenpairs", lambda *given: whole.append(given) or eigenpairs(*given))
    check(small, full.at, band, places)
    assert len(whole) < len(places) / 2


def test_a_projection_without_a_cut_off_is_not_checked():
    """It may lack modes of the full model, whatever is proved of itself."""
    full = family(2)
    V = np.linalg.eigh(full.at(mu=0.0, speed=1.0).K.toarray())[1][:, :30]
    box = fs.ParameterBox({"mu": (0.0, 0.5), "speed": (1.0, 2.0)}, (0.0, 0.3))
    small = fs.reduce(full.reduced(V), box)
    assert small.evidence == "not checked" and small.open_share == 0
    assert small.modes(mu=0.1, speed=1.0).evidence == small.fixed(speed=1.0).evidence == "not checked"
    known = fs.reduce(full.reduced(V, cutoff=0.5), box)
    assert known.evidence == "certified" and known.cutoff == 0.3
    with pytest.raises(InputError, match="above the cut-off"):
        fs.reduce(full.reduced(V, cutoff=0.2), box)


def test_values_outside_the_box_are_refused():
    small = reduced_family(4)
    for ask in (small.at, small.modes, small.number):
        with pytest.raises(InputError, match=r"mu = 1\.5 is outside the box, whose upper bound is 1\."):
            ask(mu=1.5, speed=1.0)
        with pytest.raises(InputError, match=r"speed = 0\.1 is outside the box, whose lower bound is 0\.5"):
            ask(mu=0.5, speed=0.1)
    with pytest.raises(InputError, match="speed"):
        small.modes(mu=0.5)


@pytest.mark.parametrize("constant", [False, True])
def test_friction_that_makes_the_stiffness_indefinite(constant):
    n, random = 60, np.random.default_rng(3)
    K = np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
    rub = np.zeros((n, n))  # the normal force at one DOF pushes at another, a hundred times as stiff as the chain
    rub[[40, 45, 50], [10, 15, 20]] = 100.0
    assert np.linalg.eigvalsh(K + 0.9 * (rub + rub.T) / 2)[0] < -10
    changing = [(0.9, rub), ("mu", 1e-2 * K)] if constant else [("mu", rub)]
    full = fs.Affine(np.eye(n), 1e-3 * K, [(1.0, K + np.diag(np.isin(np.arange(n), [10, 15, 20]) * 100.0)), *changing])
    band = (0.0, 0.3)
    small = fs.reduce(full, fs.ParameterBox({"mu": (0.8, 1.0)}, band))
    assert small.evidence == "certified"
    check(small, full.at, band, [{"mu": mu} for mu in random.uniform(0.8, 1.0, 5).tolist()])


@pytest.mark.filterwarnings("error:invalid value", "ignore:.*of the box is not proved")
def test_a_cell_in_which_two_changes_have_no_bound_is_halved_without_a_warning_of_numpy():
    """Each of them moves all shapes by almost their stiffness, and only in the middle of the box neither of them acts."""
    K = 2 * np.eye(60) - np.eye(60, k=1) - np.eye(60, k=-1)
    full = fs.Affine(np.eye(60), 1e-3 * K, [(1.0, K), ("p", K), ("q", 2 * K)])
    small = fs.reduce(full, fs.ParameterBox({"p": (-0.9, 0.9), "q": (-0.8, 0.8)}, (0.0, 0.5), cells=1))
    assert small.open_share == 1.0


@pytest.mark.filterwarnings("ignore:the error over the box")
def test_a_box_of_one_value():
    full = fs.Affine(np.diag([1.0, 2.0, 3.0]), None, np.diag([1.0, 8.0, 27.0]))
    small = fs.reduce(full, fs.ParameterBox({}, (0.0, 2.5)))
    assert small.evidence == "certified" and small.size == 2 and "one value" in repr(small)
    np.testing.assert_allclose(np.sort(small.modes().eigenvalues.imag), [1.0, 2.0], rtol=1e-9)
    with pytest.warns(FemsubWarning, match=r"100.0% of the box is not proved after 1 cells: one value"):
        fs.reduce(fs.Affine(np.eye(60), np.triu(np.full((60, 60), 9.0), 1) - np.tril(np.full((60, 60), 9.0), -1),
                            np.diag(np.arange(1.0, 61.0))), fs.ParameterBox({}, (0.0, 2.0)))


@pytest.mark.parametrize(("ranges", "band", "says"), [
    ({"mu": (1, 1)}, (0, 1), r"the range of mu must be \(lo, hi\) with lo < hi"),
    ({"mu": (0, 1)}, (0, np.inf), "band"), ({"mu": (0, np.nan)}, (0, 1), "range of mu"),
])
def test_a_bad_box_is_refused(ranges, band, says):
    with pytest.raises((InputError, TypeError), match=says):
        fs.ParameterBox(ranges, band)


@pytest.mark.parametrize("re", [(0.1, 1.0), (-1.0, 0.0), (1.0, -1.0), (-1.0,)])
def test_a_box_without_the_axis_is_refused(re):
    with pytest.raises((InputError, TypeError), match="re must be"):
        fs.ParameterBox({"mu": (0, 1)}, (0, 1), re=re)


def test_a_pole_in_the_box_is_refused():
    with pytest.raises(fs.checks.FemsubError, match="infinite in the box"):
        fs.reduce(family(3), fs.ParameterBox({"mu": (0.0, 1.0), "speed": (-1.0, 2.0)}, (0.0, 0.5)))


M0 = Path(__file__).parents[2] / "shared" / "brake-m0"


@pytest.mark.rare
@pytest.mark.skipif(not M0.exists(), reason="the matrices of brake M0 are not there")
def test_brake_m0_over_all_speeds(monkeypatch):
    """The page docs/tutorials/public-brake.md shows the same, and its test runs with the slow ones."""
    read = {name: sp.csr_array(next(value for key, value in loadmat(M0 / f"{name}.mat").items() if key[0] != "_")).astype(float)
            for name in ("BMLL", "BDLL", "BDIWLL", "BYLL", "BHLL", "BKLL", "BKQLL", "BWLL")}
    full = fs.Affine(read["BMLL"], [(1.0, read["BDLL"]), (inverse, read["BDIWLL"]), ("speed", read["BYLL"]),
                                    (1 / 1600, read["BHLL"])],
                     [(1.0, read["BKLL"]), (1.0, read["BKQLL"]), (lambda speed: speed**2, read["BWLL"])])
    small = fs.reduce(full, fs.ParameterBox({"speed": (2 * np.pi, 8 * np.pi)}, (0.0, 2e4)))
    assert small.evidence == "certified" and max(cell.margin for cell in small.cells) <= 0.9 and small.error <= 1e-6
    for speed, growth in ((2 * np.pi, 0.000250), (4 * np.pi, 0.000193), (8 * np.pi, 0.000049)):  # printed by others
        modes = small.modes(speed=speed)
        assert len(modes) == 37 and modes.evidence == "certified"
        assert abs(modes.growth - growth) < 1e-6 and (modes.error_bar <= 1e-6 * np.abs(modes.eigenvalues)).all()
    again = []
    monkeypatch.setattr(states, "iterated", lambda matrices, lam, x, z: again.extend(lam) or iterated(matrices, lam, x, z))
    for speed in np.linspace(2 * np.pi, 8 * np.pi, 20):
        assert len(small.modes(speed=speed)) == 37
    assert len(again) <= 20  # the states alone give nearly all pairs: with too low a degree four at each speed were iterated


@pytest.mark.slow
def test_the_brake_over_all_friction():
    """Friction of high rank: few cells. On the scene's own mesh it has rank 189, and norms of its factors alone took seven."""
    brake, band = brake_models(0.05), (1e3, 3e4)
    small = fs.reduce(brake.full, fs.ParameterBox({"mu": (0.0, 0.7)}, band), contacts=brake.at({"mu": 0.0}))
    assert small.evidence == "certified" and len(small.cells) <= 6 and small.error <= 1e-6
    modes, full = small.modes(mu=0.61), fs.complex_modes(brake.full, brake.at({"mu": 0.61}), band=band)
    assert len(modes) == len(full) and full.evidence == "certified"
    assert (np.abs(full.eigenvalues[:, None] - modes.eigenvalues).min(axis=0) <= modes.error_bar).all()
