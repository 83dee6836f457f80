"""What stands behind complex modes: a count at any size, condition numbers, and refinement with the full model."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane
from femsub.algebra import QUADRATIC
from femsub.algebra.petsc import SparseFactor
from femsub.modes import match
from femsub.modes.quadratic import dense, projected_pairs, search, sparse
from femsub.modes.quadratic.matching import clusters
from femsub.modes.quadratic.projected_count import Projection
from femsub.modes.quadratic.region import Contour, Count

BELT = fs.Belt(slope=-0.2677)


def in_disc(pencil: fs.Pencil, radius: float) -> int:
    """How many of LAPACK's eigenvalues lie in it."""
    return int(np.count_nonzero(np.abs(dense.solve(pencil.dense())[0]) < radius))


def counted(pencil: fs.Pencil, radius: float, rounds: int = 8) -> Count | None:
    """By a projection, in a disc."""
    disc = Contour(radius)
    return Projection(pencil, disc).on(lambda *_: disc, rounds)


def contact(sub: fs.Substructure, seed: int, strength: float, flutter: float, rayleigh: tuple[float, float]) -> fs.Pencil:
    """Two columns on six DOF with an unsymmetric damping, and with flutter > 0 an unsymmetric stiffness."""
    rng = np.random.default_rng(seed)
    rows, unit = rng.choice(sub.size, 6, replace=False), sub.K.diagonal().max()
    W = np.zeros((sub.size, 2))
    W[rows] = rng.standard_normal((6, 2))
    W = sp.csr_array(W)
    D, K = (size * W @ sp.csr_array(rng.standard_normal((2, 2))) @ W.T for size in (strength, flutter * unit))
    return fs.Pencil(sub.M, D + rayleigh[0] * sub.M + rayleigh[1] * sub.K, sub.K + K if flutter else sub.K)


# the count ------------------------------------------------------------------------------------------------------------

@pytest.mark.sampled(5)
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("flutter", [0.0, 0.02])
@pytest.mark.parametrize("rayleigh", [(0.0, 0.0), (0.02, 0.03)])
def test_the_count_is_lapack_s_and_moves_with_the_contact(held: bool, flutter: float, rayleigh: tuple[float, float]) -> None:
    shifted = 0
    for seed, strength in enumerate((0.01, 1.0, 30.0)):
        sub = lattice(9, 8, held=held, seed=seed)
        pencil = contact(sub, seed, strength, flutter, rayleigh)
        omega = fs.normal_modes(sub, count=24).frequencies
        values = dense.solve(pencil.dense())[0]
        for radius in (0.5 * (omega[9] + omega[10]), 0.9 * omega[20] + 0.1 * omega[21]):
            found = counted(pencil, radius)
            assert found is not None and found.margin < 1
            assert found.number == np.count_nonzero(np.abs(values) < radius)
            shifted += found.number != 2 * np.count_nonzero(omega < radius)
    assert shifted, "the contact is too weak to say anything"


def test_an_unproved_count_is_none() -> None:
    """A basis without what the contact does beside its modes must not give a number that is not one."""
    sub = lattice(12, 10, held=True, seed=3)
    pencil = contact(sub, 3, 30.0, 0.02, (0.0, 0.0))
    omega = fs.normal_modes(sub, count=60).frequencies
    assert counted(pencil, 0.5 * (omega[50] + omega[51]), rounds=0) is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("ask", [{"count": 20}, {"band": (0.0, 0.1)}, {"band": (0.02, 0.1), "re": (-0.01, 0.05)}])
def test_a_large_model_is_counted_and_a_removed_eigenvalue_noticed(ask: dict[str, object],
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Where corrections do not give the pairs, a search does."""
    monkeypatch.setattr(search, "right_pairs", lambda *_: None)
    sub = fs.chain(3000, belt=2)
    ask = ask if "band" not in ask else {key: tuple(0.1 * edge for edge in pair) for key, pair in ask.items()}
    modes = fs.complex_modes(sub, BELT, evidence=True, **ask)
    assert modes.evidence == "certified" and ("band" in ask or modes.counted is not None)
    original = sparse.quadratic_modes

    def forgetful(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = original(*arguments, **options)
        keep = np.setdiff1d(np.arange(len(values)), np.argsort(np.abs(values))[4])
        return values[keep], shapes[:, keep]

    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", forgetful)
    with pytest.raises(fs.MissedModesError, match="independent count"):
        fs.complex_modes(sub, BELT, evidence=True, **ask)


def test_what_is_missing_is_fetched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "right_pairs", lambda *_: None)
    original, calls = sparse.quadratic_modes, []

    def forgetful_once(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = original(*arguments, **options)
        calls.append(len(values))
        keep = np.setdiff1d(np.arange(len(values)), [3] if len(calls) == 1 else [])
        return values[keep], shapes[:, keep]

    sub = fs.chain(3000, belt=2)
    exact = fs.complex_modes(sub, BELT, band=(0.0, 0.01))
    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", forgetful_once)
    again = fs.complex_modes(sub, BELT, band=(0.0, 0.01))
    assert len(calls) == 2 and np.allclose(again.eigenvalues, exact.eigenvalues, rtol=1e-10)


def test_the_sign_of_friction_is_seen_by_the_count() -> None:
    sub = fs.chain(60, belt=1, damping=0.1)
    pencils = [sub.linearised(fs.Belt(slope=slope)) for slope in (-4.0, 4.0)]
    values = [dense.solve(pencil.dense())[0] for pencil in pencils]
    assert values[0].real.max() > 2.2 and values[1].real.max() < 0
    radius = 0.5 * (np.abs(values[0]).max() + np.abs(values[1]).max())
    numbers = [counted(pencil, radius) for pencil in pencils]
    assert all(found is not None and found.margin < 1 for found in numbers)
    assert [found.number for found in numbers] == [in_disc(pencil, radius) for pencil in pencils] == [120, 119]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rayleigh", [(0.0, 0.0), (0.002, 0.03), (0.0, 2e-3), (0.003, 0.0)])
def test_proportional_damping_and_a_few_dashpots_need_no_bound_by_factors(rayleigh: tuple[float, float],
                                                                          rng: np.random.Generator) -> None:
    """Beside 40 dashpots D = αM + βK is bounded by α and β, beside 41 by two more factors."""
    made = []
    for count in (0, 40, 41):
        sub = fs.chain(3000)
        where = rng.choice(3000, count, replace=False)
        dashpots = sp.csr_array((1e-3 * (rng.random(count) + 0.1), (where, where)), shape=(3000, 3000))
        pencil, before = fs.Pencil(sub.M, dashpots + rayleigh[0] * sub.M + rayleigh[1] * sub.K, sub.K), SparseFactor.made
        found = counted(pencil, 0.0201)
        made.append(SparseFactor.made - before)
        assert found is not None and (count or found.number == 2 * np.count_nonzero(fs.chain_frequencies(3000) < 0.0201))
    assert made[:2] == [2, 2] and made[2] > 3


def test_stored_zeros_are_no_contact() -> None:
    sub = lattice(10, 10, held=True, seed=1)
    there = (np.array([3, 5]), np.array([5, 3]))
    zeros, flutter = (sp.csr_array((values, there), shape=sub.K.shape) for values in (np.zeros(2), np.array([0.1, -0.1])))
    pencil = fs.Pencil(sub.M, zeros, sub.K + flutter)
    radius = 1.001 * fs.normal_modes(sub, count=5).frequencies[-1]
    found = counted(pencil, radius)
    assert found is not None and found.number == in_disc(pencil, radius)


def test_what_is_asked_by_count_is_certified_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    sub = fs.chain(500, belt=2)
    found = fs.complex_modes(sub, BELT, count=12)
    assert found.evidence == "certified" and found.counted is not None and found.counted[1] >= 12 == len(found)
    monkeypatch.setattr("femsub.modes.quadratic.search.QUADRATIC", 400)  # not for LAPACK
    monkeypatch.setattr("femsub.modes.quadratic.search.KEPT", 400)  # beyond it only if asked
    with pytest.warns(fs.FemsubWarning, match=r"500 DOF, and above 400 .* Give evidence=True"):
        assert fs.complex_modes(sub, BELT, count=12).evidence == "not checked"
    assert fs.complex_modes(sub, BELT, count=12, evidence=True).evidence == "certified"


def test_a_count_costs_few_factorisations() -> None:
    made = {}
    for name, ask in (("count", {"count": 20}), ("band", {"band": (0.0, 0.01)})):
        for evidence in (False, True):
            sub, before = fs.chain(3000, belt=2), SparseFactor.made
            fs.complex_modes(sub, BELT, evidence=evidence, **ask)
            made[name, evidence] = SparseFactor.made - before
    assert made == {("count", False): 1, ("count", True): 2, ("band", False): 2, ("band", True): 2}


# condition ------------------------------------------------------------------------------------------------------------

def test_condition_is_tisseur_s_and_bounds_what_perturbations_do() -> None:
    sub = fs.chain(10, belt=2)
    pencil = sub.linearised(BELT)
    modes = fs.complex_modes(sub, BELT)
    M, D, K = (part.toarray() for part in (pencil.M, pencil.D, pencil.K))
    rng, eps, largest = np.random.default_rng(1), 1e-7, 0.0
    for _ in range(60):
        dM, dD, dK = (norm * a / np.linalg.norm(a, 2) for norm, a in
                      zip(pencil.norms, rng.standard_normal((3, 10, 10)), strict=True))
        moved = dense.solve(fs.Pencil(M + eps * dM, D + eps * dD, K + eps * dK))[0]
        _, to = match(modes.eigenvalues, moved)
        ratio = np.abs(moved[to] - modes.eigenvalues) / (eps * modes.condition * np.abs(modes.eigenvalues))
        largest = max(largest, float(ratio.max()))
    assert 0.05 < largest < 1.01
    free = fs.complex_modes(fs.chain(6, fixed=False))
    assert np.isinf(free.condition[free.rigid]).all() and np.isfinite(free.condition[~free.rigid]).all()
    twin = fs.complex_modes(fs.Pencil(np.eye(2), np.zeros((2, 2)), np.eye(2)))  # semisimple: well-conditioned
    assert twin.condition.max() < 3
    jordan = fs.complex_modes(fs.Pencil(np.eye(2), np.zeros((2, 2)), np.array([[1.0, 1.0], [0.0, 1.0]])))
    assert jordan.condition.min() > 1e6


# refinement -----------------------------------------------------------------------------------------------------------

def reduced(sub: fs.Substructure, method: object, belt: fs.Belt,
            band: tuple[float, float]) -> tuple[fs.Substructure, fs.ComplexModes]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        rom = fs.reduce(sub, method)
    return rom, fs.complex_modes(rom, belt, band=band)


@pytest.mark.parametrize("method", [fs.CraigBampton(6), fs.CraigChang(6)])
@pytest.mark.parametrize("unsymmetric", [False, True])
def test_refined_modes_are_those_of_the_full_model(method: object, unsymmetric: bool) -> None:
    sub = fs.chain(400, belt=2)
    if unsymmetric:  # gyroscopic
        G = sp.coo_array((np.array([0.3, -0.3]), ([20, 21], [21, 20])), shape=(400, 400))
        sub = sub.with_damping(sub.D + sp.csr_array(G))
    band = (0.0, 0.03)
    rom, small = reduced(sub, method, BELT, band)
    full = fs.complex_modes(sub, BELT, band=band)
    before = SparseFactor.made
    out = fs.refine(sub, small, rom, BELT)
    assert out.factorisations == SparseFactor.made - before <= 1
    assert out.solves <= 2 * len(small) * (1 + unsymmetric) * (out.steps + 1)
    assert len(full) == len(small) == len(out.modes) and not out.lost.any() and out.merged == ()
    assert np.abs(out.modes.eigenvalues / full.eigenvalues - 1).max() < 1e-8
    true = np.abs(small.eigenvalues - full.eigenvalues)
    seen = true > 1e-9 * np.abs(full.eigenvalues)
    assert seen.sum() >= 2 and np.abs(out.moved[seen] / true[seen] - 1).max() < 0.01
    assert np.abs(np.einsum("ij,ij->j", full.shapes.conj(), out.modes.shapes)).min() > 1 - 1e-8
    assert out.modes.backward_error.max() < 1e-9
    assert (out.moved < 3 * np.abs(full.eigenvalues)).all() and repr(out).startswith("Refined: ")


@pytest.mark.slow
def test_refinement_keeps_rows_conjugates_and_rigid_modes() -> None:
    sub = fs.chain(300, belt=40, fixed=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        rom = fs.reduce(sub, fs.CraigChang(8))
    belt = fs.Belt(slope=-0.05)  # at -0.1 the damping of rigid motion would cancel, and 0 be a double eigenvalue
    small = fs.complex_modes(rom, belt, count=12)
    out = fs.refine(sub, small, rom, belt)
    full = fs.complex_modes(sub, belt, count=12)
    at, to = match(full.eigenvalues, out.modes.eigenvalues)
    difference = np.abs(out.modes.eigenvalues[to] - full.eigenvalues[at])
    assert (difference < 1e-8 * np.abs(full.eigenvalues[at]) + 1e-12).all()
    assert np.array_equal(out.which, np.arange(len(small))) and np.array_equal(out.reduced, small.eigenvalues)
    assert (np.sign(out.modes.eigenvalues.imag) == np.sign(small.eigenvalues.imag)).all()
    pencil = sub.linearised(belt)
    assert pencil.backward_error(out.modes.eigenvalues, out.modes.shapes).max() < 1e-9
    rest = fs.refine(sub, small, rom, belt, which=np.flatnonzero(small.rigid))
    assert rest.solves == 0 and small.rigid.any() and not rest.moved.any() and rest.modes.rigid.all()
    two = fs.refine(sub, small, rom, belt, which=[5, 2])
    assert np.array_equal(two.which, [5, 2]) and np.allclose(two.modes.eigenvalues, out.modes.eigenvalues[[5, 2]], rtol=1e-9)


def test_two_reduced_modes_that_lead_to_one_are_told() -> None:
    sub = fs.chain(400, belt=2)
    band = (0.0, 0.03)
    rom, small = reduced(sub, fs.CraigBampton(6), BELT, band)
    # A seventh that is the third over again, a little off.
    off = 1 + 1e-7j
    grown = replace(small, eigenvalues=np.append(small.eigenvalues, small.eigenvalues[2] * off),
                    shapes=np.hstack([small.shapes, small.shapes[:, 2:3]]), rigid=np.append(small.rigid, False),
                    above_cutoff=np.append(small.above_cutoff, False))
    with pytest.warns(fs.FemsubWarning, match="lead to the same mode"):
        out = fs.refine(sub, grown, rom, BELT)
    assert len(out.merged) == 1 and set(out.merged[0]) == {2, len(small)}
    assert out.lost.sum() == 1 and np.isnan(out.moved[out.lost]).all()
    plain = fs.refine(sub, small, rom, BELT)
    kept = np.flatnonzero(~out.lost)
    assert len(kept) == len(small)
    assert np.allclose(np.sort(out.modes.eigenvalues[kept].imag), np.sort(plain.modes.eigenvalues.imag), rtol=1e-9)


def test_refinement_refuses_what_does_not_belong_together() -> None:
    sub = fs.chain(200, belt=2)
    rom, small = reduced(sub, fs.CraigBampton(5), BELT, (0.0, 0.05))
    with pytest.raises(fs.InputError, match="with these contacts"):
        fs.refine(sub, small, rom, fs.Belt(slope=-5.0))
    with pytest.raises(fs.InputError, match="reduced from 200 DOF"):
        fs.refine(fs.chain(100), small, rom, BELT)
    with pytest.raises(fs.InputError, match="coordinates"):
        fs.refine(sub, fs.complex_modes(sub, BELT, count=2), rom, BELT)
    for wrong in ([0, 0], [99], [-1]):
        with pytest.raises(fs.InputError, match="rows of the"):
            fs.refine(sub, small, rom, BELT, which=wrong)
    for options in ({"tol": 0.0}, {"steps": 0}, {"which": []}):
        with pytest.raises(fs.InputError):
            fs.refine(sub, small, rom, BELT, **options)
    with pytest.raises(fs.InputTypeError, match="refine takes"):
        fs.refine(rom, small, sub, BELT)  # type: ignore[arg-type]
    with pytest.raises(fs.NotConvergedError, match="after 1 steps, with an error of"):
        fs.refine(sub, small, rom, BELT, steps=1, tol=1e-12)


def test_one_word_for_each_quality_of_evidence() -> None:
    sub = fs.chain(400, belt=2)
    proportional = sub.with_damping(0.01 * sub.M)
    everywhere = sub.with_damping(sp.diags_array(0.1 * np.random.default_rng(1).random(400)))
    band, belt = (0.0, 0.05), fs.Belt(slope=-0.01)
    for model, contact, ask, word in (
            (fs.chain(10, belt=2), belt, {}, "certified"),  # all are computed
            (proportional, None, {"band": band}, "certified"),
            (proportional, None, {"count": 12}, "certified"),  # by inertia alone
            (proportional, belt, {"band": band}, "certified"),  # by projection
            (sub, belt, {"count": 12}, "certified"),
            (everywhere, belt, {"band": band}, "certified"),
            (fs.chain(2100, belt=2), belt, {"band": (0.0, 0.01), "evidence": False}, "not checked")):
        modes = fs.complex_modes(model, contact, **ask)
        assert modes.evidence == word
        assert f"completeness {word}" in repr(modes)
    assert fs.normal_modes(sub, count=5).evidence == "certified"


@pytest.mark.parametrize(("interface", "split"), [([0, 7, 10], 0.0), ([0, 3, 4, 11], 1e-6)])
def test_double_modes_of_a_symmetric_structure_are_not_lost(interface: list[int], split: float) -> None:
    """A ring has modes in pairs. The interface breaks its symmetry, so that their shapes lie elsewhere in the reduced model."""
    ring = 2.05 * np.eye(24) - np.roll(np.eye(24), 1, axis=0) - np.roll(np.eye(24), -1, axis=0)
    full = fs.Substructure(np.diag([1.0 + split, *np.ones(23)]), ring, interface=interface)
    rom = fs.reduce(full, fs.CraigBampton(8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        out = fs.refine(full, fs.complex_modes(rom, count=10), rom)
    assert not out.lost.any() and (out.overlap > 0.9).all() and np.isfinite(out.moved).all()
    exact = fs.normal_modes(full, count=5).frequencies
    np.testing.assert_allclose(np.sort(out.modes.eigenvalues.imag)[5:], exact, rtol=1e-9)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("share", [1.0, 0.8])  # of the radius that is expected: the second disc is wide enough
def test_those_nearest_to_0_come_from_a_projection(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a band: no search by PEP, no factor of an unsymmetric matrix."""
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                   supports={"left": "clamped"})
    uneven = sp.diags_array(np.linspace(1.0, 2.0, sub.size))
    pencil = fs.Pencil(sub.M, sp.csr_array(1e-7 * (uneven @ sub.K @ uneven)), sub.K)
    every = fs.complex_modes(pencil, band=(0.0, 1e4)).eigenvalues
    exact = np.sort(np.abs(every[every.imag > 0]))

    def never(*_: object, **__: object) -> None:
        raise AssertionError("PEP was asked")

    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", never)
    radius = search.about_radius

    def smaller(*given: object) -> tuple[float, object]:
        size, modes = radius(*given)
        return share * size, modes

    monkeypatch.setattr(search, "about_radius", smaller)
    found = fs.complex_modes(pencil, count=7)
    assert len(exact) > 4 and found.evidence == "certified" and found.backward_error.max() < 1e-13
    assert len(found) == 8  # a pair is never split
    np.testing.assert_allclose(np.sort(np.abs(found.eigenvalues))[::2], exact[:4], rtol=1e-10)


@pytest.mark.parametrize("ask", [{"band": (0.0, 1.2e4)}, {"band": (4e3, 1.2e4)}, {"count": 22}])
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (0.0, 1e-7), (30.0, 1e-7)])
def test_floating_models_need_no_search(alpha: float, beta: float, ask: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """λ = 0 of rigid motion is known; where air resists it, six equal λ = -α are beside it. λ² + (α + βω²)λ + ω² = 0."""
    free = fs.solid(fs.block((1.0, 0.3, 0.1), (16, 6, 5), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0))
    omega = fs.normal_modes(free, count=14).frequencies[6:]
    assert free.size > QUADRATIC

    def never(*_: object, **__: object) -> None:
        raise AssertionError("PEP was asked")

    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", never)
    found = fs.complex_modes(fs.Pencil(free.M, sp.csr_array(alpha * free.M + beta * free.K), free.K), **ask)
    assert found.evidence == "certified" and found.backward_error.max() < 1e-13
    half = (alpha + beta * omega**2) / 2
    upper = -half + 1j * np.sqrt(omega**2 - half**2)
    if "count" in ask:
        np.testing.assert_array_equal(found.eigenvalues[:6], 0)
        assert (np.abs(found.eigenvalues[6:12] + alpha) <= found.error_bar[6:12]).all()
        assert found.error_bar[6:12].max() <= 1e-3 * alpha
        np.testing.assert_allclose(found.eigenvalues[12:22:2], upper[:5], rtol=1e-9)
        return
    inside = upper[(upper.imag > ask["band"][0]) & (upper.imag < ask["band"][1])]
    moving = found.eigenvalues[found.eigenvalues.imag > 1.0]
    assert len(inside) > 1 and len(moving) == len(inside)
    np.testing.assert_allclose(moving, inside, rtol=1e-9)
    still = found.eigenvalues.imag <= 1.0
    rest, order = found.eigenvalues[still], np.argsort(found.eigenvalues[still])
    expected = np.sort(np.repeat([0.0, -alpha], 6)) if ask["band"][0] == 0 else np.zeros(0)
    assert len(rest) == len(expected) and found.error_bar[still].max(initial=0.0) <= 1e-3 * alpha
    assert (np.abs(rest[order] - expected) <= found.error_bar[still][order]).all()
    assert found.rigid.sum() == (rest == 0).sum()


def test_equal_real_values_that_rounding_makes_a_pair_are_corrected_by_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of two processes has some of the clusters, and neither would know a pair without its other half."""
    monkeypatch.setattr(projected_pairs, "fork_pays", lambda *_: True)
    free = fs.solid(fs.block((1.0, 0.3, 0.1), (8, 3, 2), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0))
    pencil = fs.Pencil(free.M, sp.csr_array(30.0 * free.M), free.K).sparse().alike()
    outer = Contour(sides=(-1e4, 1e4, 1e4))
    projection = Projection(pencil, outer)
    assert projection.on(lambda *_: outer) is not None
    small = projection.counted
    assert small is not None
    real = np.flatnonzero((np.abs(small.each + 30.0) < 1e-3) & (small.each.imag == 0))
    for one, two in zip(real[::2], real[1::2], strict=False):  # LAPACK may have made pairs of the others
        for part, share in ((small.x, 1.0), (small.z, 0.5)):
            part[:, one], part[:, two] = (share * (part[:, one] + sign * 1j * part[:, two]) for sign in (1, -1))
        small.nu[[one, two]] = 1 / (small.each[one].real + np.array([1e-8j, -1e-8j]) - small.shift)
    del small.each
    assert (small.each.imag[np.abs(small.each + 30.0) < 1e-3] != 0).sum() > 3
    found = projected_pairs.right_pairs(small, pencil, together=1)
    assert found is not None
    np.testing.assert_allclose(np.sort(found[0][found[0].imag == 0].real), np.repeat([-30.0, 0.0], 6), rtol=1e-6)


def test_equal_negative_values_are_one_cluster_whatever_the_sign_of_their_zero() -> None:
    assert [group.tolist() for group in clusters(np.array([complex(-1.0, 0.0), complex(-1.0, -0.0)]), 1e-9)] == [[0, 1]]


def test_where_no_projection_counts_no_wider_disc_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Damping that is too strong for it is so in any disc."""
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                   supports={"left": "clamped"})
    uneven = sp.diags_array(np.linspace(1.0, 2.0, sub.size))
    pencil = fs.Pencil(sub.M, sp.csr_array(1e-7 * (uneven @ sub.K @ uneven)), sub.K)
    asked: list[object] = []

    def refused(_: object, contour: object, *__: object, **___: object) -> None:
        asked.append(contour)
        raise fs.NotConvergedError("all are strongly damped")

    monkeypatch.setattr(search, "Projection", refused)
    with pytest.warns(fs.FemsubWarning, match="no eigenvalue is missing: all are strongly damped"):
        found = fs.complex_modes(pencil, count=4)
    assert len(asked) == 1 and len(found) == 4 and found.evidence == "not checked"


@pytest.mark.parametrize("evidence", [None, True])
def test_a_disc_whose_radius_is_not_known_is_not_passed_over_in_silence(
        evidence: bool | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The warning has the reason. A search that nobody can check is repeated only where a count is asked for."""
    sub, searches, nearest = membrane(12), [], sparse.Shifted.nearest  # with double eigenvalues

    def unknown(*_: object) -> float:
        raise fs.NotConvergedError("4 restarts are not enough")

    def counting(self: sparse.Shifted, count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
        searches.append(count)
        return nearest(self, count, seed)

    monkeypatch.setattr("femsub.modes.quadratic.search.QUADRATIC", 100)  # not for LAPACK
    monkeypatch.setattr(search, "about_radius", unknown)
    monkeypatch.setattr(sparse.Shifted, "nearest", counting)
    with pytest.warns(fs.FemsubWarning, match="no eigenvalue is missing: 4 restarts are not enough"):
        found = fs.complex_modes(sub.with_damping(0.01 * sub.K @ sub.K), count=8, evidence=evidence)
    assert found.evidence == "not checked" and (len(searches) == 1) == (evidence is None)
