"""Contact modes with a tolerance: no unstable mode is missed, and what is told of the full system holds."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
from randombrakes import TOL, Brake, errors, judged, random_brake

import femsub as fs
from femsub.model.bands import within
from femsub.modes.quadratic.energy_basis import Coupling
from femsub.reduction.estimates import found_modes, friction
from femsub.reduction.estimates.found_modes import FoundModes
from femsub.reduction.estimates.friction import Larger

SEEDS = (3, 6, 7, 29, 36, 56, 61, 70)  # with damping by friction, gyroscopic terms, a falling slope, real λ, or none of these
EASY, FLUTTER, CLOSE = 29, 70, 7


@cache
def brake(seed: int) -> Brake:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return random_brake(seed)


@cache
def reduced(seed: int) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(brake(seed).system, fs.ContactModes(band=brake(seed).band, tol=TOL, contacts=brake(seed).contacts))


def larger(seed: int, above: float) -> Larger:
    """A larger model with the real modes up to so many times the band."""
    one = brake(seed)
    method = fs.ContactModes(1, contacts=one.contacts)
    part = method.part(one.system)
    search = FoundModes(method.statics(part, part.factored(), np.zeros((one.system.size, 0))), None)
    while search.top <= above * one.band[1]:
        search.grow(search.modes + 1)
    return Larger(search, one.system.linearised(one.contacts), [part.friction, part.friction.T], one.band[1], search.modes)


@pytest.mark.sampled(6)
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("seed", SEEDS)
def test_no_unstable_mode_of_a_random_brake_is_missed(seed: int) -> None:
    row = judged(brake(seed))
    assert row["missed"] == row["invented"] == row["outside"] == 0
    assert row["rom"] in (row["full"], None) and (row["rom"] is not None or seed == CLOSE)
    assert row["true"] <= TOL and row["estimate"] <= TOL
    for error, estimate in row["pairs"]:
        assert error <= estimate <= 1.02 * error + 1e-4  # the radius of the circle is the rest


def test_the_brakes_here_are_not_all_stable() -> None:
    unstable = [brake(seed).votes.count(False) for seed in SEEDS]
    assert sum(unstable) >= 8 and sum(count > 0 for count in unstable) >= 4


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("ports", [True, False])
def test_the_model_is_the_one_that_was_judged(ports: bool, friction: bool) -> None:
    one = brake(EASY)
    method = fs.ContactModes(band=one.band, tol=1e-2, contacts=one.contacts, friction=friction)
    rom = fs.reduce(one.system, method, ports=ports)
    modes = fs.complex_modes(rom, one.contacts, band=one.band)
    assert rom.estimate is not None and rom.estimate.met and len(modes)
    assert modes.full_growth is not None and np.isfinite(modes.full_growth).all()
    assert errors(one, fs.complex_modes(rom, one.contacts).eigenvalues)[0].max() <= 1e-2
    assert ("friction response" in rom.kinds) == (friction or bool(ports and one.system.ports))


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_tolerance_keeps_fewer_modes_the_wider_it_is() -> None:
    one = brake(EASY)
    sizes = [fs.reduce(one.system, fs.ContactModes(band=one.band, tol=tol, contacts=one.contacts)).size for tol in (1e-2, 1e-5)]
    assert sizes[0] < sizes[1]


@pytest.mark.parametrize("above", [1.6, 2.0])
def test_the_circles_hold_the_eigenvalues_of_the_full_system(above: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Larger, "_answers", lambda self, *rest: self.space.V[:, :0])  # a poor model, with wide circles
    for seed in (EASY, FLUTTER, 3):
        found, one = larger(seed, above), brake(seed)
        inside = np.flatnonzero(within(found.values, one.band) & (found.values.imag >= 0) & np.isfinite(found.radii))
        assert len(inside)
        distance = np.abs(one.values[:, None] - found.values[inside]).min(axis=0)
        assert (distance <= found.radii[inside] + 1e-9 * np.abs(found.values[inside])).all()


def test_the_constant_bounds_what_the_larger_model_leaves_out() -> None:
    for seed in (EASY, FLUTTER):
        found, one = larger(seed, 1.5), brake(seed)
        pencil, A = one.system.linearised(one.contacts).dense(), found.product(np.eye(one.system.size))
        L = la.null_space((A @ found.U).T)
        root = la.cholesky(L.T @ A @ L)
        reach = friction.BEYOND * one.band[1]
        least = np.inf
        for value in reach * np.array([1j, 1 + 1j, -1 + 1j, 1, -1, 0.3 + 0.9j]):
            P = L.T @ pencil.at(value) @ L
            P = la.solve_triangular(root, la.solve_triangular(root, P, trans=1).conj().T, trans=1)
            least = min(least, float(la.eigvalsh((P + P.conj().T) / 2)[0]))
        assert 0 < found.coercivity <= least + 1e-9


def test_the_coupling_is_the_dual_norm_of_the_residual() -> None:
    found, one = larger(EASY, 1.5), brake(EASY)
    pencil, A = one.system.linearised(one.contacts).dense(), found.product(np.eye(one.system.size))
    at = int(np.argmin(np.abs(found.values - 0.7j * one.band[1])))
    value = found.values[at]
    right, left = found.coupling.lengths(value)
    residual = pencil.at(value) @ (found.U @ found.coupling.x[:, at])
    other = pencil.at(value).T @ (found.U @ found.coupling.z[:, at].conj())
    for length, force in ((right[at], residual), (left[at], other)):
        assert length == pytest.approx(np.sqrt((force.conj() @ la.solve(A, force)).real), rel=1e-4)


def test_too_few_modes_are_not_counted() -> None:
    found = larger(FLUTTER, 0.8)
    assert found.coercivity < 0 and not found.counted and np.isinf(found.radii).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_what_cannot_be_met_or_counted_is_refused_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    one = brake(EASY)
    with pytest.raises(fs.NotConvergedError, match=r"cannot be reduced to a relative error of 1e-14 .* under this friction"):
        fs.reduce(one.system, fs.ContactModes(band=one.band, tol=1e-14, contacts=one.contacts))
    monkeypatch.setattr(found_modes, "DENSE", 1)
    monkeypatch.setattr(friction, "LEAST", 2.0)
    with pytest.raises(fs.NotConvergedError, match=r"cannot be counted \(c = 0\.\d+, at least 2 is needed\)"):
        fs.reduce(one.system, fs.ContactModes(band=one.band, tol=1e-2, contacts=one.contacts))


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_mode_is_called_stable_only_if_the_full_system_is_told_to_agree() -> None:
    one = brake(CLOSE)  # a mode grows in the full system by 1e-7 of |λ|, and decays in the model
    modes = fs.complex_modes(reduced(CLOSE), one.contacts, band=one.band)
    assert one.is_stable is False and modes.is_stable is None
    assert replace(modes, full_growth=None).is_stable is True
    assert modes.full_growth is not None and (modes.full_growth[:, 0] > 0).sum() == 1
    assert True not in replace(modes, full_growth=np.abs(modes.full_growth)).stable


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_under_other_contacts_nothing_is_told_of_the_full_system() -> None:
    one = brake(EASY)
    modes = fs.complex_modes(reduced(EASY), [replace(contact, mu=0.1) for contact in one.contacts], band=one.band)
    assert modes.full_growth is not None and np.isnan(modes.full_growth).all() and None not in modes.stable


def test_the_estimate_is_written_and_read_with_the_circles() -> None:
    estimate = reduced(EASY).estimate
    assert estimate is not None and len(estimate.located) == len(estimate.eigenvalues)
    again = fs.Estimate.of_record(json.loads(json.dumps(estimate.record())))
    np.testing.assert_array_equal(again.located, estimate.located)
    np.testing.assert_array_equal(again.radius, estimate.radius)
    with pytest.raises(fs.InputError, match="damaged"):
        fs.Estimate.of_record(estimate.record() | {"radius": [1.0]})


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_system_of_reduced_parts_is_judged_as_it_is() -> None:
    one = brake(EASY)
    roms = fs.reduce(one.system, {name: fs.CraigBampton(12) for name in one.system.parts}, ports=True)
    small = fs.reduce(roms, fs.ContactModes(band=one.band, tol=TOL, contacts=one.contacts))
    exact, found = (fs.complex_modes(model, one.contacts, band=one.band).eigenvalues for model in (roms, small))
    assert small.size < roms.size
    np.testing.assert_allclose(found, exact, rtol=TOL)


def test_a_pad_that_slides_freely_has_its_elastic_modes_judged() -> None:
    steel, mesh = fs.Material(2.1e11, 0.3, 7850.0), fs.block((0.1, 0.05, 0.02), (4, 2, 1), "hexahedron")
    pad = fs.solid(mesh, steel, interface=["bottom"], rayleigh=(20.0, 1e-7))
    rubbing = fs.FrictionContact("bottom", "ground", mesh, 1e11, 0.3, direction=np.array([1.0, 0.0, 0.0]))
    rom = fs.reduce(pad, fs.ContactModes(band=(0.0, 7e4), tol=TOL, contacts=rubbing))
    assert rom.kinds.count("rigid") == 3 and rom.estimate is not None and rom.estimate.met
    exact, found = (fs.complex_modes(model, rubbing, band=(1e3, 7e4)) for model in (pad, rom))
    assert found.is_stable is True and found.full_growth is not None and np.isfinite(found.full_growth).all()
    np.testing.assert_allclose(found.eigenvalues, exact.eigenvalues, rtol=TOL)


@dataclass(frozen=True)
class Rub:
    """Friction at one point: a spring along the port n, and μ times its force along the port t."""

    ports: tuple[str, ...] = ("n", "t")
    stiffness: float = 5.0
    mu: float = 0.5
    drag: float = 0.0

    def linearised(self, model: fs.Substructure) -> tuple[np.ndarray, np.ndarray]:
        return np.diag([0.0, self.mu * self.drag]), self.stiffness * np.array([[1.0, 0.0], [self.mu, 0.0]])


@cache
def sliding(massless: bool = False, damped: bool = True) -> fs.Substructure:
    """A chain that slides freely along t, and a held one along n; springs between them turn with the friction."""
    random = np.random.default_rng(5)
    difference = np.diff(np.eye(16), axis=0) * np.sqrt(random.uniform(1.0, 10.0, (15, 1)))
    K = la.block_diag(difference.T @ difference, np.diag(random.uniform(1.0, 4.0, 8)))
    for k in range(4):
        link = np.zeros(24)
        link[[3 * k, 3 * k + 1, 16 + k]] = 1.0, -1.0, 0.5
        K += 2.0 * np.outer(link, link)
    mass = random.uniform(0.5, 2.0, 24)
    mass[23] *= not massless
    w = {"n": np.eye(24)[17], "t": np.eye(24)[5]}
    return fs.Substructure(np.diag(mass), K, 1e-3 * K if damped else None, [], w, "sliding")


def of_sliding(rub: Rub, hi: float = 1.2) -> Larger:
    part = (method := fs.ContactModes(1, contacts=rub)).part(sliding())
    search = FoundModes(method.statics(part, part.factored(), np.zeros((24, 0))), None)
    return Larger(search, sliding().linearised(rub), [part.friction, part.friction.T], hi, search.modes)


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_rigid_motion_is_neither_counted_twice_nor_refused(drag: float) -> None:
    rub, band = Rub(drag=drag), (0.0, 1.2)
    found = of_sliding(rub)
    np.testing.assert_allclose(found.U.T @ found.product(found.U), np.eye(found.U.shape[1]), atol=1e-8)
    assert found.loose == (0 if drag else 1) and found.counted
    rom = fs.reduce(sliding(), fs.ContactModes(band=band, tol=1e-6, contacts=rub))
    exact, modes = (fs.complex_modes(one, rub).eigenvalues for one in (sliding(), rom))
    exact = exact[within(exact, band) & (np.abs(exact) > 1e-3)]
    assert rom.size < 24 and (np.abs(exact[:, None] - modes).min(axis=1) <= 1e-6 * np.abs(exact)).all()
    judged = fs.complex_modes(rom, rub, band=band)
    assert judged.is_stable is not False and len(judged.unstable) == 0


def test_the_shift_is_part_of_the_coupling() -> None:
    found = of_sliding(Rub(mu=0.0))
    sigma, mass = found.handle.sigma, found.space.terms[0]
    assert found.loose == 1 and sigma < 0 and mass.weights == (sigma, 0.0, 1.0)
    V, K = found.space.V, found.space.matrices[0]
    np.testing.assert_allclose(K, V.T @ found.pencil.K @ V, atol=1e-12 * np.abs(K).max())


def test_a_motion_so_slow_that_it_may_be_rigid_is_called_neither() -> None:
    estimate = reduced(EASY).estimate
    assert estimate is not None
    low, high = estimate.growth_of_full(np.array([1e-9 * estimate.band[1] + 0j]))[0]
    assert low < 0 < high


def test_motion_without_mass_is_refused() -> None:
    with pytest.raises(fs.InputError, match="1 DOF without mass, and a tolerance under friction needs mass"):
        fs.reduce(sliding(massless=True), fs.ContactModes(band=(0.0, 1.0), tol=1e-3, contacts=Rub()))


def test_a_sum_that_is_not_the_inverse_excludes_nothing() -> None:
    found = larger(EASY, 1.5)
    small, pencil = found.coupling, found.small
    value = 0.9j * float(np.abs(found.values).min())
    V, A = found.space.V, found.product(np.eye(len(found.U)))
    outside = np.eye(len(V)) - V @ (V.T @ A)
    full = brake(EASY).system.linearised(brake(EASY).contacts).dense().at(value)
    root = la.sqrtm(la.inv(A)).real
    P = la.solve(pencil.at(value), np.eye(len(pencil.M)))
    limit = 1.01 * float(la.norm(root @ outside.T @ full @ V @ P @ V.T @ full @ outside @ root, 2))
    assert small.wrong < 1e-6 and not small.excludes(value, 0.9 * limit / 1.01)
    generous = 1.01 * float(np.sqrt(len(pencil.M))) * limit
    assert small.excludes(value, generous)
    lame = Coupling(found.space, small.shift, small.nu, 0.5 * small.x, small.z, small.unit)
    assert lame.wrong > 0.1 and not lame.excludes(value, generous, thorough=False) and lame.excludes(value, generous)


def test_the_model_that_is_made_is_judged_and_not_a_richer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rub, band = Rub(drag=0.3), (0.0, 1.2)
    monkeypatch.setattr(Larger, "basis", lambda self, count, loads: np.eye(len(self.rest)))
    rom = fs.reduce(sliding(), fs.ContactModes(band=band, tol=1e-6, contacts=rub))
    exact, modes = (fs.complex_modes(one, rub).eigenvalues for one in (sliding(), rom))
    exact = exact[within(exact, band) & (np.abs(exact) > 1e-3)]
    assert (np.abs(exact[:, None] - modes).min(axis=1) <= 1e-6 * np.abs(exact)).all()


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_an_unstable_mode_just_below_the_end_of_the_band_is_not_missed() -> None:
    for seed in (FLUTTER, 3, 6, 36):
        one = brake(seed)
        growing = one.values[one.inside[[vote is False for vote in one.votes]]]
        for value in growing[:2]:
            band = (0.0, float(value.imag) * (1 + 1e-7))
            rom = fs.reduce(one.system, fs.ContactModes(band=band, tol=0.05, contacts=one.contacts))
            assert fs.complex_modes(rom, one.contacts, band=band).is_stable is not True


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_circle_that_reaches_into_the_band_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    one = brake(EASY)
    value = one.values[one.inside][np.argmax(one.values[one.inside].imag)]
    band = (0.0, float(value.imag) * (1 - 1e-4))
    plain = fs.reduce(one.system, fs.ContactModes(band=band, tol=1e-3, contacts=one.contacts)).estimate
    monkeypatch.setattr(Larger, "radii", property(lambda self: np.full(len(self.values), 2e-4) * np.abs(self.values)))
    wide = fs.reduce(one.system, fs.ContactModes(band=band, tol=1e-3, contacts=one.contacts)).estimate
    assert plain is not None and wide is not None and len(wide.eigenvalues) == len(plain.eigenvalues) + 1
    assert plain.reaching(band) == band and wide.reaching(band)[1] == pytest.approx(value.imag, rel=1e-3)
