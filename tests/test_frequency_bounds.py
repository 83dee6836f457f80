"""Bounds of frequencies from reduced matrices alone hold for full models of many kinds, and are sharp enough to be of use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from benchmarks.attacks import frequency_bounds as attack
from femsub.coupling.joints import Joint, Link
from femsub.reduction.frequency_bounds import left_out

pytestmark = pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")  # belts on the inside are meant
STEEL = fs.Material(2.1e11, 0.3, 7850.0)


def holds(bounds: fs.FrequencyBounds, full: np.ndarray) -> bool:
    """Within the rounding of the frequencies themselves."""
    return bool((bounds.lower <= full * (1 + 1e-9)).all() and (full <= bounds.upper * (1 + 1e-9)).all())


@pytest.mark.parametrize("modes", [2, 5, 20])
def test_of_one_part(modes: int) -> None:
    bounds = fs.frequency_bounds(fs.reduce(fs.chain(100, belt=30), fs.CraigBampton(modes), ports=True), min(modes, 5))
    full = fs.chain_frequencies(100)[:len(bounds.upper)]
    assert holds(bounds, full) and bounds.evidence == "certified"
    assert (bounds.error <= 20 * (1 - full / bounds.upper)).all()  # no bound says everything, one far too large says nothing


def random_parts(seed: int) -> fs.System:
    """A chain of random masses and springs in two to four parts, of which each may have a belt on its inside."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(20, 60))
    chosen = sorted(rng.choice(np.arange(1, n + 1), size=2, replace=False).tolist())
    masses, springs = rng.lognormal(0, 1, n), rng.lognormal(0, 1.5, n)
    sub = fs.chain(n, belt=int(rng.integers(1, n)), masses=masses, springs=springs, interface=chosen, damping=0.0)
    return fs.couple(*fs.cut(sub, into=int(rng.integers(2, 5))))


@pytest.mark.sampled(8)
@pytest.mark.parametrize("seed", range(40))
def test_of_random_chains_in_parts(seed: int) -> None:
    system = random_parts(seed)
    method = [fs.CraigBampton, fs.Hurty][seed % 2]
    small = fs.reduce(system, {name: method(1 + seed % 3) for name, part in system.parts.items() if len(part.interior) > 4},
                      ports=seed % 3 == 0)
    count = min(3, small.size - 1)
    assert holds(fs.frequency_bounds(small, count), fs.normal_modes(system, count).frequencies)


@pytest.mark.parametrize("supports", [["left"], []], ids=["held", "floating"])
def test_of_a_solid_in_parts(supports: list[str]) -> None:
    """With more modes the bound falls as the error does, and no rigid motion spoils it."""
    mesh = fs.block((1.0, 0.1, 0.1), (12, 1, 2), "hexahedron")
    system = fs.couple(*fs.cut(mesh, fs.solid, into=3, material=STEEL, supports=supports))
    full = fs.normal_modes(system, 6)
    errors = []
    for cutoff in (6e4, 2.4e5):
        bounds = fs.frequency_bounds(fs.reduce(system, dict.fromkeys(system.parts, fs.CraigBampton(cutoff=cutoff))), 6)
        assert bounds.rigid == full.rigid == (0 if supports else 6) and bounds.evidence == "certified"
        assert holds(bounds, full.frequencies[full.rigid:])
        errors.append(bounds.error.max())
    assert errors[1] < 0.2 * errors[0] and errors[1] < 2e-3


def test_a_part_without_anything_left_out_adds_nothing() -> None:
    left, right = fs.chain(12, interface=[12], damping=0.0), fs.chain(15, interface=[1], fixed=False, damping=0.0)
    joints = [fs.Rigid(("left", [11]), ("right", [0]))]
    system = fs.couple({"left": left, "right": fs.reduce(right, fs.CraigBampton(14))}, joints)
    bounds = fs.frequency_bounds(system, 4)
    assert bounds.error.max() < 1e-12 and bounds.evidence == "certified"


class Inside(Joint):
    """A spring from the ground to the last coordinate of the part 'a'."""

    def link(self, parts: Mapping[str, fs.Substructure]) -> Link:
        return Link(motions={"a": np.eye(parts["a"].size)[-1:]}, stiffness=np.eye(1), damping=np.zeros((1, 1)), grounded=True)


def test_springs_on_interfaces_are_allowed_and_others_are_not() -> None:
    part = fs.chain(20, belt=10, interface=[20], damping=0.0)
    other = fs.chain(20, interface=[1], fixed=False, damping=0.0)
    small = {"a": fs.reduce(part, fs.CraigBampton(4)), "b": fs.reduce(other, fs.CraigBampton(4))}
    at_ends = [fs.Spring(("a", [19]), ("b", [0]), stiffness=0.3)]
    bounds = fs.frequency_bounds(fs.couple(small, at_ends), 4)
    assert holds(bounds, fs.normal_modes(fs.couple({"a": part, "b": other}, at_ends), 4).frequencies)
    with pytest.raises(fs.InputError, match="acts on the inside of the reduced part 'a'"):
        fs.frequency_bounds(fs.couple(small, [*at_ends, Inside()]), 2)


def test_a_mode_that_is_missing_shows() -> None:
    """Were a low mode left out, the cut-off would be that mode's: the bound says so."""
    full = fs.chain(60, damping=0.0)
    rom = fs.reduce(full, fs.CraigBampton(8))
    lost = np.array([kind != "fixed-interface" or at != 1 for at, kind in enumerate(rom.kinds)])  # all but the lowest of them
    poor = replace(rom, M=rom.M[np.ix_(lost, lost)], K=rom.K[np.ix_(lost, lost)], D=rom.D[np.ix_(lost, lost)], V=rom.V[:, lost],
                   ports={}, kinds=tuple(np.array(rom.kinds)[lost]), cutoff=0.026, rigid_motion=None, noise=None)
    bounds = fs.frequency_bounds(poor, 2)
    assert rom.cutoff > 0.026 and holds(bounds, fs.chain_frequencies(60)[:2]) and bounds.evidence == "not checked"


def test_what_has_no_bound_is_refused() -> None:
    with pytest.raises(fs.InputError, match=r"coordinates of the kind 'free'.*CraigBampton and Hurty"):
        fs.frequency_bounds(fs.reduce(fs.chain(20), fs.CraigChang(4)), 2)
    with pytest.raises(fs.InputError, match="count=50 frequencies were asked for, but 'chain' has 5"):
        fs.frequency_bounds(fs.reduce(fs.chain(20), fs.CraigBampton(4)), 50)
    with pytest.raises(fs.InputTypeError, match="model must be"):
        fs.frequency_bounds(3, 2)  # type: ignore[arg-type]


def test_inertia_that_modes_represent_is_not_counted() -> None:
    """With all fixed-interface modes, all that is left of the inertia of the inside is that of the interface's own DOF."""
    rom = fs.reduce(fs.chain(30, interface=[30], damping=0.0), fs.CraigBampton(28))
    left = 2.0**2 * left_out(replace(rom, cutoff=2.0), np.eye(rom.size)).coupling
    assert 1.0 <= left[0, 0] <= 1.1 and np.abs(left[1:, 1:]).max() < 1e-13  # m30 = 1, and the one mode left out


def turned(rom: fs.ReducedSubstructure, T: np.ndarray) -> fs.ReducedSubstructure:
    """By hand: the coordinates that leave the interface at rest are T times others."""
    inner = np.array([kind != "constraint" for kind in rom.kinds])
    S = np.eye(rom.size)
    S[np.ix_(inner, inner)] = T
    return fs.ReducedSubstructure(S.T @ rom.M @ S, S.T @ rom.K @ S, None, {}, rom.name, V=rom.V @ S,
                                  kinds=tuple("fixed-interface" if at else "constraint" for at in inner), cutoff=rom.cutoff,
                                  full_interface=rom.full_interface)


@pytest.mark.parametrize("ports", [False, True], ids=["modes", "and a static response"])
def test_modes_may_be_scaled_and_mixed(ports: bool) -> None:
    """Files of other programs scale modes to their largest entry, and do not tell residual vectors from modes."""
    full = fs.chain(80, belt=30, interface=[80], damping=0.0)
    rom = fs.reduce(full, fs.CraigBampton(6), ports=ports)
    exact, expected = fs.chain_frequencies(80)[:4], fs.frequency_bounds(rom, 4)
    random = np.random.default_rng(3)
    for T in (10.0 ** random.uniform(-3, 3, rom.size - 1) * np.eye(rom.size - 1), random.standard_normal((rom.size - 1,) * 2)):
        bounds = fs.frequency_bounds(turned(rom, T), 4)
        assert holds(bounds, exact) and bounds.evidence == "confirmed"  # that there was one step is the author's word
        assert np.abs(bounds.lower / expected.lower - 1).max() < 1e-9


def test_a_copy_with_other_matrices_has_no_bound_of_the_steps_before() -> None:
    """What earlier steps have left out is known in the coordinates that `reduce` made, and of no others."""
    parts = {name: fs.reduce(fs.chain(60, interface=[*held, 60], damping=0.0), fs.CraigBampton(3))
             for name, held in (("a", [1]), ("b", []))}
    twice = fs.reduce(fs.couple(parts, [fs.Rigid(("a", [59]), ("b", [59]))]), fs.CraigBampton(6))
    assert fs.frequency_bounds(twice, 2).evidence == "certified"
    T = np.diag(np.where(np.array(twice.kinds) == "fixed-interface", 1e6, 1.0))
    other = replace(twice, M=T @ twice.M @ T, K=T @ twice.K @ T, D=T @ twice.D @ T, V=twice.V @ T)
    with pytest.raises(fs.InputError, match="its matrices are not those that reduce made"):
        fs.frequency_bounds(other, 2)


def test_a_cut_off_that_is_no_frequency_is_refused() -> None:
    rom = fs.reduce(fs.chain(20), fs.CraigBampton(3))
    for cutoff in (np.nan, -1.0, 0.0):
        with pytest.raises(fs.InputError, match="cutoff must be a positive frequency"):
            replace(rom, cutoff=cutoff)


def test_modes_that_share_stiffness_with_the_interface_have_no_bound() -> None:
    rom = fs.reduce(fs.chain(20, damping=0.0), fs.CraigBampton(4))
    S = np.eye(rom.size)
    S[0, 1:] = 0.1
    rom = replace(rom, M=S.T @ rom.M @ S, K=S.T @ rom.K @ S, D=0 * rom.D, rigid_motion=None)
    with pytest.raises(fs.InputError, match="4 coordinates that leave the interface at rest share stiffness with its constraint"):
        fs.frequency_bounds(rom, 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", attack.KINDS)
def test_attacks_find_nothing(kind: str, seed: int) -> None:
    """A few seeds of benchmarks/attacks/frequency_bounds.py; `python -m benchmarks attack frequency_bounds` runs thousands."""
    assert not attack.attacked(kind, seed).startswith(("wrong", "refused"))


def two_chains(modes: int, method: type[fs.CraigBampton] | type[fs.CraigChang] = fs.CraigBampton) -> tuple[fs.System, fs.System]:
    """In full, and with both reduced."""
    parts = {"a": fs.chain(60, interface=[60], damping=0.0), "b": fs.chain(60, interface=[1], damping=0.0)}
    system = fs.couple(parts, [fs.Rigid(("a", [59]), ("b", [0]), tol=np.inf)])
    return system, fs.reduce(system, dict.fromkeys(parts, method(modes)))


@pytest.mark.parametrize("modes", [4, 6])
def test_each_step_of_reduction_counts(modes: int, tmp_path: Path) -> None:
    system, once = two_chains(3)
    twice = fs.reduce(once, fs.CraigBampton(modes))
    exact = fs.normal_modes(system, 3).frequencies
    bounds = fs.frequency_bounds(twice, 3)
    assert holds(bounds, exact) and "'system' before reduction (119 DOF)" in str(bounds)
    assert (bounds.error >= 1 - exact / bounds.upper).all() and bounds.error.max() < 0.1
    fs.write_matrices(tmp_path, twice)  # a folder keeps what the first step has left out
    again = fs.frequency_bounds(fs.read_component(tmp_path), 3)
    assert np.allclose(again.lower, bounds.lower, rtol=1e-12) and str(again) == str(bounds)
    assert fs.frequency_bounds(once, 3).error.max() <= bounds.error.max()


def test_a_first_step_without_a_bound_is_named() -> None:
    twice = fs.reduce(two_chains(3, fs.CraigChang)[1], fs.CraigBampton(4))
    with pytest.raises(fs.InputError, match=r"several steps.*kind 'free'.*CraigBampton and Hurty"):
        fs.frequency_bounds(twice, 2)


def test_a_mode_of_a_part_at_the_cutoff() -> None:
    """A hub with eight equal oscillators, of which the reduction keeps some: frequencies equal the cut-off up to rounding."""
    K = np.eye(9)
    K[0, 0], K[0, 1:], K[1:, 0] = 8.0, -1.0, -1.0
    hub = fs.Substructure(np.eye(9), K, interface=[0, 1])
    line = 3.3 * (2 * np.eye(10) - np.eye(10, k=1) - np.eye(10, k=-1) - np.diag([0] * 9 + [1]))
    other = fs.Substructure(2.1 * np.eye(10), line, interface=[0])
    system = fs.couple({"a": hub, "b": other}, [fs.Rigid(("a", [1]), ("b", [0]))])
    exact = fs.normal_modes(system, 5).frequencies
    for kept in range(1, 7):
        small = fs.reduce(system, {"a": fs.CraigBampton(kept), "b": fs.CraigBampton(2)})
        for count in range(1, 6):
            assert holds(fs.frequency_bounds(small, min(count, small.size)), exact[:count])


def test_a_soft_mode_takes_no_digits_from_the_bounds_of_others() -> None:
    """1/ω² of a mass on a spring of 1e-24 is 1e24."""
    soft = fs.Substructure(np.eye(2), np.diag([1e-24, 1e-24]), interface=[0, 1])
    rom = fs.reduce(fs.chain(60, damping=0.0), fs.CraigBampton(10))
    bounds = fs.frequency_bounds(fs.couple({"a": rom, "b": soft}, [fs.Spring(("a", [0]), ("b", [0]), stiffness=1e-20)]), 5)
    assert holds(bounds, fs.normal_modes(fs.couple({"a": fs.chain(60, damping=0.0), "b": soft}, [
        fs.Spring(("a", [0]), ("b", [0]), stiffness=1e-20)]), 5).frequencies) and bounds.error.max() < 1e-4


def test_the_words_say_whose_frequencies_they_are() -> None:
    rom = fs.reduce(fs.chain(40, damping=0.0), fs.CraigBampton(6))
    assert "of 'chain' before reduction (40 DOF): 2 elastic" in str(fs.frequency_bounds(rom, 2))
    plain = fs.frequency_bounds(fs.Substructure(rom.M, rom.K, name="chain"), 2)
    assert "of 'chain' itself, whose 7 coordinates count as a full model: 2 elastic" in str(plain)
    by_hand = fs.frequency_bounds(turned(rom, np.eye(6)), 2)
    limit = f"{rom.cutoff:.5g} rad/time, in one step"
    assert f"before reduction, if 'chain' kept all its fixed-interface modes below {limit}: 2 elastic" in str(by_hand)
    other = fs.chain(5, interface=[1], fixed=False, damping=0.0)
    parts = {"a": turned(rom, np.eye(6)), "b": turned(fs.reduce(other, fs.CraigBampton(2)), np.eye(2))}
    joined = fs.couple(parts, [fs.Spring(("a", [0]), ("b", [0]), stiffness=1.0)])
    assert f"below {limit}, and 1 more part likewise: 2 elastic" in str(fs.frequency_bounds(joined, 2))


def test_all_modes_below_a_frequency() -> None:
    """They are counted, and the cut-off is the frequency that was asked for."""
    sub = fs.chain(50, damping=0.0)
    inside = np.sqrt(np.linalg.eigvalsh(sub.K.toarray()[1:, 1:]))
    for method in (fs.CraigBampton, fs.Hurty):
        rom = fs.reduce(sub, method(cutoff=0.5))
        assert rom.modes == np.count_nonzero(inside < 0.5) and 0.5 <= rom.cutoff < 0.5001
    free = fs.reduce(sub, fs.CraigChang(cutoff=0.5))
    assert free.modes == np.count_nonzero(fs.chain_frequencies(50) < 0.5) and 0.5 <= free.cutoff < 0.5001
    assert fs.reduce(sub, fs.CraigBampton(cutoff=1e-3)).modes == 0
    assert fs.reduce(sub, fs.CraigBampton(cutoff=5.0)).cutoff == np.inf  # all of them
    assert str(fs.Rubin(cutoff=0.5)) == "Rubin with all modes below 0.5 rad/time"
    for made, message in (
            (lambda: fs.CraigBampton(4, cutoff=2.0), "several are given"), (lambda: fs.Guyan(cutoff=2.0), "no cutoff"),
            (lambda: fs.Herting(cutoff=2.0), "no cutoff"), (lambda: fs.Rubin(cutoff=-1.0), "cutoff must be positive")):
        with pytest.raises(fs.InputError, match=message):
            made()
