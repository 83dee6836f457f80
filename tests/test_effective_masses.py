"""Effective masses: the cantilever's closed form, sums against the rigid mass, and what a reduction keeps of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import femsub as fs
from femsub.model import Inertia

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
SIX = ("ux", "uy", "uz", "rx", "ry", "rz")


def bar(**given: Any) -> fs.Substructure:
    return fs.solid(fs.block((1.0, 0.2, 0.1), (2, 1, 1), "hexahedron20"), STEEL, **given)


def test_a_cantilever_has_the_effective_masses_of_its_closed_form() -> None:
    """Euler-Bernoulli: φ = cosh - cos - σ (sinh - sin) has the mean 2σ/β and the mean square 1, so a share (2σ/β)²."""
    beta = np.array([brentq(lambda x: np.cos(x) + 1 / np.cosh(x), k * np.pi, (k + 1) * np.pi) for k in range(4)])
    sigma = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))
    shares = (2 * sigma / beta) ** 2
    assert np.allclose(shares, [0.6131, 0.1883, 0.0647, 0.0331], atol=5e-5)
    beam = fs.beam(2.0, 60, E=3.0, I=0.5, rho=7.0, A=0.25, supports={"left": "clamped"})
    found = fs.effective_masses(beam, fs.normal_modes(beam, count=4))
    assert found.directions == ("uz", "ry") and np.allclose(found.shares[:, 0], shares, rtol=1e-6)
    assert np.isclose(found.mass[0], 7.0 * 0.25 * 2.0) and np.allclose(found.factors**2 * found.modal_masses[:, None],
                                                                      found.effective)
    # the tail of the series, of which Σ (2σ/β)² = 1, and the mass that no mode moves: that of half an element at the clamp
    assert np.isclose(found.rest[0] + found.still[0], (1 - shares.sum()) * found.mass[0], rtol=1e-5)
    assert 0 < found.still[0] < found.mass[0] / 60


@pytest.mark.parametrize("supports", [[], ["left"], {"left": "x", "bottom": "y"}], ids=str)
def test_all_modes_move_the_mass_that_can_move(supports: Any) -> None:
    part = bar(supports=supports)
    modes = fs.normal_modes(part, band=(0.0, 1e9))
    found = fs.effective_masses(part, modes, origin=(0.3, -1.0, 2.0))
    assert len(modes.eigenvalues) == part.size and found.directions == SIX
    assert (np.abs(found.rest) < 1e-10 * found.mass).all() and (found.still > -1e-10 * found.mass).all()
    # a cuboid's mass, and its moments of inertia by Steiner
    m, (a, b, c), r = 7850.0 * 0.02, (1.0, 0.2, 0.1), np.array([0.5, 0.1, 0.05]) - [0.3, -1.0, 2.0]
    central = m / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    assert np.allclose(found.mass, [m, m, m, *(central + m * (r @ r - r**2))], rtol=1e-10)
    assert (found.still[:3] > 1e-3 * m).any() == bool(supports)
    few = fs.effective_masses(part, fs.normal_modes(part, count=5), origin=(0.3, -1.0, 2.0))
    assert np.allclose(few.reach, found.reach)
    assert (few.rest > 1e-3 * few.mass).any() == bool(supports)  # the missing tail; of a free part rigid motion is all


def test_a_plate_and_a_massless_dof_have_sums_too() -> None:
    flat = fs.plate(fs.rectangle((1.0, 0.7), (4, 3)), E=1.0, nu=0.3, rho=1.0, thickness=0.01, supports={"left": "clamped"})
    found = fs.effective_masses(flat, fs.normal_modes(flat, band=(0.0, 1e6)))
    assert found.directions == ("uz", "rx", "ry") and (np.abs(found.rest) < 1e-10 * found.mass).all()
    chain = fs.chain(5)
    M = chain.M.toarray()
    M[2, 2] = 0.0
    bare = fs.Substructure(M, chain.K)
    found = fs.effective_masses(bare, fs.normal_modes(bare, band=(0.0, 10.0)), directions={"x": np.ones(5)})
    assert np.isclose(found.effective.sum(), 4.0) and np.isclose(found.reach[0], 4.0)


def test_the_interface_drives_the_modes_of_a_craig_bampton_model_as_a_support_would() -> None:
    rom, clamped = fs.reduce(bar(interface=["left"]), fs.CraigBampton(6)), bar(supports=["left"])
    own, there = fs.effective_masses(rom), fs.effective_masses(clamped, fs.normal_modes(clamped, count=6))
    assert np.allclose(own.frequencies, there.frequencies) and np.allclose(own.mass, there.mass)
    assert np.allclose(own.effective, there.effective, atol=1e-8 * own.mass.max())
    assert rom.interface_dofs is not None
    assert np.allclose(own.interface @ rom.interface_dofs.rigid(np.zeros(3)), own.coupling, atol=1e-8 * own.coupling.max())
    assert np.isnan(own.reach).all() and "rest" in str(own) and "no mode" not in str(own)
    # in a free model the rigid-body modes move all, so that elastic ones move nothing
    free = fs.effective_masses(rom, fs.normal_modes(rom, count=3))
    assert np.allclose(free.effective[:6].sum(axis=0), free.mass) and np.allclose(free.effective[6:], 0, atol=1e-9)


def test_a_reduced_part_and_a_system_keep_the_mass_of_their_parts(tmp_path: Any) -> None:
    clamped = bar(supports=["left"], interface=["right"])
    rom = fs.reduce(clamped, fs.CraigBampton(8))
    full, small = (fs.effective_masses(one, fs.normal_modes(one, count=3)) for one in (clamped, rom))
    assert np.allclose(small.shares, full.shares, atol=2e-3) and np.allclose(small.mass, full.mass)
    assert (small.still >= full.still - 1e-9 * full.mass).all()  # a basis lacks more than the supports
    fs.write_matrices(tmp_path / "rom", rom)
    again = fs.read_component(tmp_path / "rom")
    assert np.array_equal(fs.effective_masses(again, fs.normal_modes(again, count=3)).mass, small.mass)
    assert isinstance(rom, fs.ReducedSubstructure) and isinstance(rom.inertia, Inertia)
    other = bar(interface=["right"])
    pair = fs.couple({"a": rom, "b": other}, [fs.Rigid(("a", "right"), ("b", "right"))])
    found = fs.effective_masses(pair, fs.normal_modes(pair, count=3))
    assert np.allclose(found.mass, small.mass + fs.effective_masses(other, fs.normal_modes(other, count=1)).mass)
    with pytest.raises(fs.InputError, match="another model"):
        fs.effective_masses(rom, fs.normal_modes(clamped, count=3))
    with pytest.raises(fs.InputError, match="directions"):
        fs.effective_masses(fs.chain(4), fs.normal_modes(fs.chain(4), count=1))
    with pytest.raises(fs.InputError, match="give modes"):
        fs.effective_masses(clamped)


@pytest.mark.parametrize("method", [fs.MacNeal(4), fs.Rubin(4), fs.CraigBampton(4), fs.Guyan()], ids=repr)
@pytest.mark.parametrize("supports", [[], ["left"]], ids=str)
def test_all_modes_of_a_reduced_model_move_what_it_can_move(method: Any, supports: Any) -> None:
    rom = fs.reduce(bar(supports=supports, interface=["right"]), method)
    modes = fs.normal_modes(rom, count=len(rom.M) - np.count_nonzero(rom.M.diagonal() == 0) - 6 * (not supports))
    found = fs.effective_masses(rom, modes)
    assert (np.abs(found.rest) < 1e-10 * found.mass).all() and (found.still > -1e-10 * found.mass).all()


def test_an_audit_says_what_share_of_the_mass_the_modes_move() -> None:
    rom = fs.reduce(bar(interface=["left"]), fs.CraigBampton(6))
    said = {one.what: one.said for one in fs.audit(rom).findings}["mass that the modes move"]
    share = fs.effective_masses(rom).shares.sum(axis=0)
    assert f"{share[0]:.0%}".replace("%", " %") in said or f"{share[:3].min():.0%}".replace("%", " %") in said


@pytest.mark.parametrize("make", [lambda: bar(supports=["left"]), lambda: fs.reduce(bar(interface=["left"]), fs.CraigBampton(6)),
                                  lambda: fs.beam(1.0, 8, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, supports={"left": "clamped"})])
def test_normal_modes_know_their_effective_masses(make: Any) -> None:
    part = make()
    for modes in (fs.normal_modes(part, count=4), fs.normal_modes(part, band=(0.0, 4000.0))):
        there = fs.effective_masses(part, modes)
        assert modes.directions == there.directions and np.allclose(modes.mass, there.mass)
        assert np.allclose(modes.mass_shares, there.shares, atol=1e-12)
        assert f"; they move {repr(there).partition('modes move ')[2].partition(' of ')[0]} of " in repr(modes)
    bare = fs.normal_modes(fs.chain(4), count=2)
    assert bare.directions == () and "move" not in repr(bare)


def test_a_comparison_and_a_card_say_how_much_mass_a_mode_moves() -> None:
    part = bar(supports=["left"], interface=["right"])
    own = fs.normal_modes(part, count=4)
    known = fs.ModeSet(1j * own.frequencies[::-1], own.shapes[:, ::-1], part.dofs)
    pairs = known.compare(part, own)
    assert np.allclose(pairs.mass_shares, own.mass_shares[::-1]) and "; they move" in repr(pairs)
    complex_ones = fs.complex_modes(part, band=(0.0, float(own.frequencies[3])))
    assert known.compare(part, complex_ones).mass_shares.shape == (4, 0)
    for card in fs.mode_cards(part, None, complex_ones):
        one = card.real_modes[0]  # without damping and friction a mode is a real mode
        at = int(np.argmin(np.abs(own.frequencies - one.frequency)))
        assert np.allclose(list(one.mass_shares.values()), own.mass_shares[at, :3], atol=1e-9)
        assert f"{max(one.mass_shares.values()):.1%}" in card.tables()[0].text()
