"""Cards of complex modes: the balance of power, shares by left vectors, and pairs that are found again by lowering μ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from brakescene import brake_models

import femsub as fs
from femsub.checks import Array
from femsub.modes import ModeName
from femsub.modes.mode_cards import ordinal, places_in_families


@dataclass(frozen=True)
class Rubbing:
    """μ times a circulatory matrix on one port with as many columns."""

    circulatory: tuple[tuple[float, ...], ...]
    mu: float = 0.0
    damping: float = 0.0
    ports: ClassVar[tuple[str, ...]] = ("all",)
    affine: ClassVar[tuple[str, ...]] = ("mu",)

    def linearised(self, model: fs.Substructure) -> tuple[float, Array]:
        return self.damping, self.mu * np.array(self.circulatory)


def alone(M: Any, K: Any, D: Any = None) -> fs.Substructure:
    return fs.Substructure(M, K, D, ports={"all": np.eye(len(K))})


def random_spd(rng: np.random.Generator, n: int) -> Array:
    A = rng.standard_normal((n, n))
    return A @ A.T / n + np.eye(n)


def followed(pencil_at: Callable[[float], fs.Pencil], pair: Array, mu: float, steps: int = 60) -> Array:
    """|λ| of two eigenvalues at μ = 0, both followed from μ down as a pair of neighbours."""
    for now in np.linspace(mu, 0.0, steps + 1)[1:]:
        pencil = pencil_at(float(now))
        values = fs.complex_modes(pencil).eigenvalues
        values = values[values.imag > 0]
        cost = np.abs(values[:, None] - pair)
        first = cost[:, 0].argmin()
        cost[first, 1] = np.inf
        pair = values[[first, cost[:, 1].argmin()]]
    return np.sort(np.abs(pair))


@pytest.mark.parametrize("seed", range(6))
def test_the_parts_of_growth_add_up(seed: int) -> None:
    """With damping, gyroscopic and circulatory forces, a contact on some DOF, and structural damping."""
    rng = np.random.default_rng(seed)
    n, p = 7, 3
    skew = rng.standard_normal((n, n))
    D = 0.1 * random_spd(rng, n) + (skew - skew.T) * (seed % 2)
    C, B = rng.standard_normal((2, p, p))
    model = fs.Substructure(random_spd(rng, n), 9 * random_spd(rng, n), D, ports={"face": rng.standard_normal((n, p))})
    model = model.with_structural_damping(0.1 * model.K) if seed > 3 else model
    contact = fs.LinearContact(("face",), stiffness=C - C.min() * np.eye(p), damping=0.1 * B)
    modes = fs.complex_modes(model, contact)
    cards = fs.mode_cards(model, contact, modes)
    assert len(cards) == np.count_nonzero(modes.eigenvalues.imag > 0) > 0
    for card, at in zip(cards, np.flatnonzero(modes.eigenvalues.imag > 0), strict=True):
        value, x, (rubbed,) = card.eigenvalue, modes.shapes[:, at], card.contacts
        assert np.isclose(sum(card.growth.values()), value.real, rtol=0, atol=1e-9 * abs(value))
        assert np.isclose(rubbed.circulatory.sum(), card.growth["circulatory"], atol=1e-9 * abs(value))
        assert np.isclose(rubbed.damping.sum(), card.growth["contact damping"]) and rubbed.nodes == (
            "face, column 1", "face, column 2", "face, column 3")
        # the work of the contact's forces, integrated over a period, node by node
        t = np.arange(64) / 64 * 2 * np.pi / value.imag
        u = (model.port("face").T @ x)[:, None] * np.exp(1j * value.imag * t)
        v = (1j * value.imag * u).real
        power = -((C - C.T) / 2 @ u.real + 0.1 * B @ v) * v
        work = power.mean(axis=1) * 2 * np.pi / value.imag
        assert np.allclose(work, rubbed.work, atol=1e-9 * np.abs(work).max())
        assert np.isclose(sum(card.work.values()), 2 * np.pi / value.imag * card.kinetic * value.real)


@pytest.mark.parametrize("seed", range(4))
def test_shares_are_those_of_left_and_right_vectors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M, K = random_spd(rng, 5), 4 * random_spd(rng, 5)
    circulatory = rng.standard_normal((5, 5))
    model, contact = alone(M, K), Rubbing(tuple(map(tuple, (circulatory - circulatory.T).tolist())), 1.0)
    modes = fs.complex_modes(model, contact)
    omega2, Phi = la.eigh(K, M)
    square, left, right = la.eig(K + contact.linearised(model)[1], M, left=True)
    for card in fs.mode_cards(model, contact, modes, most=5):
        at = int(np.abs(square + card.eigenvalue**2).argmin())
        a, b = Phi.T @ M @ right[:, at], Phi.T @ M @ left[:, at]
        share = np.abs(a * b.conj()) / np.abs(a * b).sum()
        by_frequency = sorted(card.real_modes, key=lambda one: one.frequency)
        assert np.allclose([one.frequency for one in by_frequency], np.sqrt(omega2))
        assert np.allclose([one.share for one in by_frequency], share, atol=1e-6) and np.isclose(card.captured, 1.0)


def hoffmann(mu: float, k: float = 1.0) -> fs.Pencil:
    """A mass on inclined springs on a belt, in the form of N. Hoffmann and others (2002): [[k11, k12 - μ k3], [k12, k22]].

    With k11 = k22 the two modes meet at μ = k12/k3, here 3/4.
    """
    return fs.Pencil(np.eye(2), None, k * np.array([[2.0, 1.0 - 4 / 3 * mu], [1.0, 2.0]]))


def test_hoffmann_s_two_modes_meet() -> None:
    own, contact = alone(np.eye(2), [[2.0, 1.0], [1.0, 2.0]]), Rubbing(((0.0, -4 / 3), (0.0, 0.0)), 0.9)
    assert np.allclose(own.linearised(contact).K, hoffmann(0.9).K)
    modes = fs.complex_modes(own, contact)
    growing, falling = sorted(fs.mode_cards(own, contact, modes), key=lambda one: -one.eigenvalue.real)
    assert growing.eigenvalue.real > 0 and growing.met is not None  # μ is above the border, 3/4
    assert np.allclose(sorted(one.frequency for one in growing.met), [1.0, np.sqrt(3.0)])
    pair = np.array([growing.eigenvalue, falling.eigenvalue])
    assert np.allclose(followed(hoffmann, pair, 0.9), [1.0, np.sqrt(3.0)], rtol=1e-6)
    assert np.isclose(growing.growth["circulatory"], growing.eigenvalue.real) and np.isclose(growing.apart, np.sqrt(3.0) - 1)
    assert "meets" in growing.sentence and "feeds it." in growing.sentence and "nothing feeds it" in falling.sentence
    # below the border one real mode makes up most of each, and nothing feeds it
    below = Rubbing(contact.circulatory, 0.1)
    for card in fs.mode_cards(own, below, fs.complex_modes(own, below)):
        assert card.met is None and "nothing feeds it" in card.sentence


def test_hulten_s_two_modes_meet_beside_others() -> None:
    """ẍ + diag(ηω) ẋ + [[ω₁², -μω₂²], [μω₁², ω₂²]] x = 0, among modes that take no part, in turned coordinates."""
    one, two = 2 * np.pi * 100, 2 * np.pi * 75
    omega = np.array([one, two, 2 * np.pi * 90, 2 * np.pi * 40, 2 * np.pi * 110])
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((5, 5)))[0]
    circulatory = np.zeros((5, 5))
    circulatory[0, 1], circulatory[1, 0] = -two**2, one**2
    turned = tuple(map(tuple, (turn @ circulatory @ turn.T).tolist()))
    model = alone(np.eye(5), turn @ np.diag(omega**2) @ turn.T, turn @ np.diag(0.01 * omega) @ turn.T)
    border = abs(one**2 - two**2) / (2 * one * two)
    assert np.isclose(border, 0.29167, atol=1e-5)
    for mu, grows in ((0.9 * border, False), (1.3 * border, True)):
        contact = Rubbing(turned, mu)
        cards = fs.mode_cards(model, contact, fs.complex_modes(model, contact))
        card = max(cards, key=lambda card: card.growth["circulatory"])
        assert (card.eigenvalue.real > 0) == grows and card.met is not None
        assert np.allclose(sorted(mode.frequency for mode in card.met), [two, one])
        assert np.isclose(card.apart, 2 * np.pi * 25) and "25 Hz apart without friction" in card.sentence
        # without damping the shares are (1 ± √(1 - μ²/μ_c²)) / 2 below the border, and equal above
        lead = np.sqrt(max(1 - (mu / border)**2, 0.0)) / 2
        assert np.allclose([mode.share for mode in card.met], [0.5 + lead, 0.5 - lead], atol=0.01)
        assert card.growth["circulatory"] > 0 > card.growth["damping"]
        others = [other for other in cards if other.met is None]
        assert {round(other.real_modes[0].frequency / 2 / np.pi) for other in others} == {90, 40, 110}


def test_many_modes_in_one_are_said_to_be_many() -> None:
    """A force a × u turns u about a. Of three real modes of nearly one frequency, each has (1 - a_j²)/2, here a third."""
    contact = Rubbing(((0.0, -0.3, 0.3), (0.3, 0.0, -0.3), (-0.3, 0.3, 0.0)), 1.0)
    model = alone(np.eye(3), np.diag([4.0, 4.01, 4.02]))
    card = max(fs.mode_cards(model, contact, fs.complex_modes(model, contact)), key=lambda card: card.eigenvalue.real)
    assert np.allclose([mode.share for mode in card.real_modes], 1 / 3, atol=0.02) and "among others (" in card.sentence


def test_a_sparse_model_has_the_cards_of_the_dense_one_to_its_real_modes() -> None:
    n = 60
    chain = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=(-1, 0, 1), format="csr")
    w = np.eye(n)[:, [3, 20]]
    contact = fs.LinearContact(("face",), stiffness=np.array([[0.0, 0.6], [-0.6, 0.0]]))
    cards = []
    for K in (chain, chain.toarray()):
        model = fs.Substructure(sp.eye_array(n, format="csr") if sp.issparse(K) else np.eye(n), K, ports={"face": w})
        modes = fs.complex_modes(model, contact, band=(0.0, 0.6))
        cards.append(fs.mode_cards(model, contact, modes))
    assert len(cards[0]) == len(cards[1]) > 3
    for few, every in zip(*cards, strict=True):
        assert 0.99 < few.captured < 1 - 1e-9 and np.isclose(every.captured, 1.0)
        assert np.allclose([mode.share for mode in few.real_modes[:3]], [mode.share for mode in every.real_modes[:3]], atol=0.01)


def test_a_contact_of_surfaces_has_its_nodes_and_a_leading_edge() -> None:
    """The second body moves along x, so that it comes in at x = 0; about z, at the smallest angle."""
    mesh = fs.block((0.1, 0.05, 0.02), (4, 1, 1), "hexahedron")
    pad = fs.solid(mesh, fs.Material(5e9, 0.25, 2500.0), supports=["top"], interface=["bottom"], name="pad")
    ways: tuple[dict[str, Any], ...] = ({"direction": (1.0, 0.0, 0.0)}, {"axis": (0.0, 0.0, 1.0), "centre": (0.05, -0.2, 0.0)},
                                       {"axis": (0.0, 0.0, -1.0), "centre": (0.05, -0.2, 0.0)})
    for way, sense in zip(ways, (1, -1, 1), strict=True):  # about +z it moves along -x here
        contact = fs.FrictionContact("bottom", "ground", mesh, 1e12, 0.6, 1e6, speed=1.0, **way)
        modes = fs.complex_modes(pad, contact, count=6)
        for card in fs.mode_cards(pad, contact, modes):
            rubbed, = card.contacts
            assert rubbed.name == "bottom" and len(rubbed.nodes) == len(mesh.nodes("bottom")) == len(rubbed.points)
            assert np.isclose(sum(card.growth.values()), card.eigenvalue.real, rtol=0, atol=1e-8 * abs(card.eigenvalue))
            x = rubbed.points[:, 0] / 0.1 if sense > 0 else 1 - rubbed.points[:, 0] / 0.1
            edges = rubbed.growth[x < 0.3].sum(), rubbed.growth[x > 0.7].sum()
            if rubbed.where == "leading edge":
                assert edges[0] > edges[1]
            elif rubbed.where == "trailing edge":
                assert edges[1] > edges[0]


def test_bad_input_is_refused() -> None:
    chain = fs.chain(4)
    modes = fs.complex_modes(chain, fs.Belt(slope=-0.1))
    for given, said in (((chain, None, fs.normal_modes(chain, count=1)), "ComplexModes"), ((fs.chain(5), None, modes), "DOF"),
                        ((chain, fs.Belt(slope=-0.1), modes, [99]), "which"),
                        ((chain.pencil, fs.Belt(slope=-0.1), modes), "no ports")):
        with pytest.raises(fs.InputError, match=said):
            fs.mode_cards(*given)
    with pytest.raises(fs.InputError, match="multipliers"):
        parts = {"a": fs.chain(4, interface=[4]), "b": fs.chain(3, interface=[1], fixed=False)}
        dual = fs.couple(parts, [fs.Rigid(("a", [3]), ("b", [0]))], assembly="dual")
        fs.mode_cards(dual, None, fs.complex_modes(dual))
    # one belt: its falling characteristic feeds the mode
    belt = fs.Belt(slope=-0.3)
    growing = fs.complex_modes(chain, belt)
    card = fs.mode_cards(chain, belt, growing, growing.unstable[growing.eigenvalues[growing.unstable].imag > 0][:1])[0]
    assert "negative damping" in card.sentence and card.growth["contact damping"] > 0 and "part of Re λ" in str(card)


def test_pairs_of_a_disc_are_counted_where_pads_split_and_mix_them() -> None:
    def disc(n: int, m: int = 0, purity: float = 1.0, motion: str = "out of plane", part: str = "disc") -> ModeName:
        return ModeName(part, 1.0, "disc", motion, (n, m), purity)

    pad = ModeName("pad", 1.0, "plate", "in plane", (1, 1))
    # the disc alone, and with pads, of which one mode more is mostly like the pair with two diameters
    alone = [disc(1), disc(1), disc(0), disc(2), disc(2), disc(3), disc(3), disc(0, 1), disc(1, 1), disc(1, 1), disc(4)]
    assert places_in_families(alone) == [1, 1, 1, 2, 2, 3, 3, 2, 4, 4, 5]
    braked = [disc(0, 0, 0.6), disc(1), disc(2, 0, 0.4), disc(2), disc(2, 0, 0.6), pad, disc(3), disc(3), disc(1, 1, 0.5),
              disc(2, 0, 1.0, "in plane, radial"), disc(1, 1), disc(4), disc(1, part="rotor")]
    assert places_in_families(braked) == [0, 1, 0, 2, 0, 0, 3, 3, 0, 1, 4, 5, 1]
    hat = [disc(1), disc(1), disc(2), disc(2), disc(2), disc(2), disc(3)]  # of a hat, which repeats the counts
    assert places_in_families(hat) == [1, 1, 2, 2, 0, 0, 0]
    assert " ".join(map(ordinal, (1, 2, 3, 4, 11, 12, 13, 21, 111))) == "1st 2nd 3rd 4th 11th 12th 13th 21st 111th"


@pytest.mark.slow
def test_a_sentence_names_the_place_of_a_pair() -> None:
    """Of an annulus with a belt's circulatory force between two points, beside the places of its real modes."""
    mesh = fs.annulus(0.05, 0.15, 0.012, (1, 16, 1))
    disc = fs.solid(mesh, fs.Material(1.1e11, 0.26, 7200.0), supports=["inner"], interface=["top"], name="disc")
    modes = fs.normal_modes(disc, count=7)
    names = fs.mode_names(disc, modes)
    pair = [at for at, name in enumerate(names) if name.motion == "out of plane" and name.counts == (3, 0)]
    assert len(pair) == 2
    shapes = modes.shapes[:, pair]
    N = disc.M @ shapes @ np.array([[0.0, 1.0], [-1.0, 0.0]]) @ (disc.M @ shapes).T  # makes these two flutter
    size = 1e-2 * modes.frequencies[pair[0]]**2
    fluttering = fs.Substructure(disc.M, disc.K, interface=disc.interface, ports={"all": np.eye(disc.size)}, name="disc",
                                 dofs=disc.dofs)
    rubbing = fs.LinearContact(("all",), stiffness=size * N)
    found = fs.complex_modes(fluttering, rubbing)
    first, *_ = fs.mode_cards(fluttering, rubbing, found, [int(found.eigenvalues.real.argmax())])
    assert "the two modes of the disc's 3rd out-of-plane pair with 3 nodal diameters meet" in first.sentence


@pytest.mark.slow
def test_the_pair_of_the_brake_scene_is_found_by_lowering_mu() -> None:
    brake = brake_models(0.05)
    small = fs.reduce(brake.full, fs.ContactModes(60, contacts=brake.at({"mu": 0.0})))
    rubbing = brake.at({"mu": 0.6})
    modes = fs.complex_modes(small, rubbing, band=(1e3, 3e4))
    card, = fs.mode_cards(small, rubbing, modes, modes.unstable, full=brake.full)
    assert card.met is not None and np.isclose(sum(card.growth.values()), card.eigenvalue.real, rtol=0, atol=1e-8 * 2e4)
    assert np.isclose(sum(one.circulatory.sum() for one in card.contacts), card.growth["circulatory"], rtol=1e-8)
    first, second = card.met
    assert first.name.same == second.name.same == ("disc", "disc", "out of plane", (5, 0))
    assert "leading edge" in card.sentence and "5 nodal diameters" in card.sentence and card.energy["disc"] > 0.8
    still = small.with_damping(None)

    def undamped(mu: float) -> fs.Pencil:
        found = still.linearised(brake.at({"mu": mu}))
        return fs.Pencil(found.M, None, found.K)

    values = fs.complex_modes(undamped(0.6)).eigenvalues
    pair = values[(values.imag > 0) & (np.abs(values.imag - card.eigenvalue.imag) < 20.0)]
    assert len(pair) == 2
    assert np.allclose(followed(undamped, pair, 0.6, 12), sorted(mode.frequency for mode in card.met), rtol=1e-5)
