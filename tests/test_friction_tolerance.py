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
from femsub.reduction.parameter_box import Radii

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


@pytest.mark.sampled(12)
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("seed", SEEDS)
def test_no_unstable_mode_of_a_random_brake_is_missed(seed: int) -> None:
    row = judged(brake(seed))
    assert row["missed"] == row["invented"] == row["outside"] == 0
    assert row["rom"] in (row["full"], None) and (row["rom"] is not None or seed == CLOSE)
    assert row["true"] <= TOL and row["estimate"] <= TOL
    for error, estimate in row["pairs"]:
        assert error <= estimate <= 1.02 * error + 1e-4  # the radius of the circle is the rest


@pytest.mark.slow  # as most of these brakes
def test_the_brakes_here_are_not_all_stable() -> None:
    unstable = [brake(seed).votes.count(False) for seed in SEEDS]
    assert sum(unstable) >= 8 and sum(count > 0 for count in unstable) >= 4


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("ports", [True, False])
def test_the_model_is_the_one_that_was_judged(ports: bool) -> None:
    one = brake(EASY)
    rom = fs.reduce(one.system, fs.ContactModes(band=one.band, tol=1e-2, contacts=one.contacts), ports=ports)
    modes = fs.complex_modes(rom, one.contacts, band=one.band)
    assert rom.estimate is not None and rom.estimate.met and len(modes)
    assert modes.full_growth is not None and np.isfinite(modes.full_growth).all()
    assert errors(one, fs.complex_modes(rom, one.contacts).eigenvalues)[0].max() <= 1e-2
    np.testing.assert_allclose(rom.K, rom.V.T @ (one.system.K @ rom.V), atol=1e-9 * np.abs(rom.K).max())
    K = one.system.linearised([replace(contact, mu=0.0) for contact in one.contacts]).dense().K
    loads = np.hstack([w.reshape(len(w), -1) for w in one.system.ports.values()])
    answers = la.solve((K + K.T) / 2, loads)
    left = answers - rom.V @ np.linalg.lstsq(rom.V, answers, rcond=None)[0]
    assert (la.norm(left) < 1e-8 * la.norm(answers)) == ports


def test_a_tolerance_takes_the_friction_that_is_given() -> None:
    with pytest.raises(fs.InputError, match="friction=False needs a number of modes"):
        fs.ContactModes(band=(0.0, 1.0), tol=1e-2, contacts=brake(EASY).contacts, friction=False)


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_tolerance_keeps_fewer_modes_the_wider_it_is() -> None:
    one = brake(EASY)
    sizes = [fs.reduce(one.system, fs.ContactModes(band=one.band, tol=tol, contacts=one.contacts)).size for tol in (1e-2, 1e-5)]
    assert sizes[0] < sizes[1]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_what_cannot_be_met_or_counted_is_refused_with_the_reason() -> None:
    one = brake(EASY)
    with pytest.raises(fs.NotConvergedError, match=r"cannot be reduced to a relative error of 1e-15 .* under this friction"):
        fs.reduce(one.system, fs.ContactModes(band=one.band, tol=1e-15, contacts=one.contacts))
    turning = np.triu(np.full((60, 60), 10.0), 1)
    masses = fs.Substructure(np.eye(60), np.diag(np.arange(1.0, 61.0)), turning - turning.T, ports={"n": np.eye(60)[0],
                                                                                                  "t": np.eye(60)[1]})
    with pytest.raises(fs.NotConvergedError, match=r"cannot be counted: inertia, damping and gyroscopic .* Lower the band"):
        fs.reduce(masses, fs.ContactModes(band=(0.0, 2.0), tol=1e-2, contacts=Rub()))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_a_mode_is_called_stable_only_if_the_full_system_is_told_to_agree() -> None:
    one = brake(CLOSE)  # a mode grows in the full system by 1e-7 of |λ|
    modes = fs.complex_modes(reduced(CLOSE), one.contacts, band=one.band)
    assert one.is_stable is False and modes.is_stable is not True
    assert modes.full_growth is not None and np.isfinite(modes.full_growth).all()
    stable = replace(modes, eigenvalues=modes.eigenvalues - 2 * np.abs(modes.eigenvalues.real))
    assert replace(stable, full_growth=None).is_stable is True and stable.is_stable is not True
    assert True not in replace(stable, full_growth=np.abs(modes.full_growth)).stable


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_under_other_contacts_nothing_is_told_of_the_full_system() -> None:
    one = brake(EASY)
    modes = fs.complex_modes(reduced(EASY), [replace(contact, mu=0.1) for contact in one.contacts], band=one.band)
    assert modes.full_growth is not None and np.isnan(modes.full_growth).all() and None not in modes.stable


@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
def test_the_error_of_a_change_is_that_of_the_system_in_contact() -> None:
    one, changes = brake(EASY), [fs.AddedDamper(("disc", [5]), 30.0), fs.AddedMass(("pad0", [8]), 0.002)]
    small, full = (fs.modified(model, changes) for model in (reduced(EASY), one.system))
    exact, found = (fs.complex_modes(model, one.contacts, band=one.band).eigenvalues for model in (full, small))
    error = (np.abs(exact[:, None] - found).min(axis=1) / np.abs(exact)).max()
    assert error < small.change_error < 0.02  # without the contact it was 0.08


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


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_rigid_motion_is_neither_counted_twice_nor_refused(drag: float) -> None:
    rub, band = Rub(drag=drag), (0.0, 1.2)
    rom = fs.reduce(sliding(), fs.ContactModes(band=band, tol=1e-6, contacts=rub))
    exact, modes = (fs.complex_modes(one, rub).eigenvalues for one in (sliding(), rom))
    exact = exact[within(exact, band) & (np.abs(exact) > 1e-3)]
    assert rom.size < 24 and (np.abs(exact[:, None] - modes).min(axis=1) <= 1e-6 * np.abs(exact)).all()
    judged = fs.complex_modes(rom, rub, band=band)
    full = fs.complex_modes(sliding(), rub, band=band)
    assert judged.is_stable is not False and len(judged.unstable) == 0
    assert np.count_nonzero(np.abs(judged.eigenvalues) > 1e-3) == np.count_nonzero(np.abs(full.eigenvalues) > 1e-3)
    assert (np.abs(judged.eigenvalues) < 1e-3).any()  # λ = 0, one or two of them by rounding


def test_a_motion_so_slow_that_it_may_be_rigid_is_called_neither() -> None:
    estimate = reduced(EASY).estimate
    assert estimate is not None
    low, high = estimate.growth_of_full(np.array([1e-9 * estimate.band[1] + 0j]))[0]
    assert low < 0 < high


def test_motion_without_mass_follows() -> None:
    rub, band = Rub(), (0.0, 1.0)
    rom = fs.reduce(sliding(massless=True), fs.ContactModes(band=band, tol=1e-6, contacts=rub))
    exact, found = (fs.complex_modes(one, rub, band=band).eigenvalues for one in (sliding(massless=True), rom))
    exact, found = (part[np.abs(part) > 1e-3] for part in (exact, found))  # λ = 0, one or two of them by rounding
    assert rom.size < 12 and len(exact) == len(found) == 2
    np.testing.assert_allclose(found, exact, rtol=1e-6)


@pytest.mark.sampled(3)
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("seed", [FLUTTER, 3, 36])
def test_an_unstable_mode_just_below_the_end_of_the_band_is_not_missed(seed: int) -> None:
    one = brake(seed)
    growing = one.values[one.inside[[vote is False for vote in one.votes]]]
    assert len(growing)
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
    monkeypatch.setattr(Radii, "circles", staticmethod(lambda values, size: 2e-4 * np.abs(values)))
    wide = fs.reduce(one.system, fs.ContactModes(band=band, tol=1e-3, contacts=one.contacts)).estimate
    assert plain is not None and wide is not None and len(wide.eigenvalues) == len(plain.eigenvalues) + 1
    assert plain.reaching(band) == band and wide.reaching(band)[1] == pytest.approx(value.imag, rel=1e-3)
