"""Rigid-body motion in complex modes: as many eigenvalues exactly 0 as there must be, and none of a mode that is only soft."""

from __future__ import annotations

import dataclasses
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks import rigid as attack
from benchmarks.lattices import lattice
from femsub.algebra import null_space
from femsub.model import RigidMotion, rigid_motion
from femsub.model.rigid_motion import elastic_forces, links, strains
from femsub.modes.quadratic.dense import modal_form
from femsub.modes.shift_invert import ShiftInvert

pytestmark = pytest.mark.filterwarnings("ignore::femsub.PortWarning")
STEEL = {"SI": (fs.Material(2.1e11, 0.3, 7850.0), 1.0), "mm-t-s": (fs.Material(2.1e5, 0.3, 7.85e-9), 1e3)}
FACES = [("left", 3, (2, 1, 1), (0.2, 0.06, 0.04)), ("right", 4, (8, 3, 2), (1.0, 0.1, 0.1)),
         ("top", 8, (4, 2, 1), (2.0, 1.5, 0.1))]


def block(face: str, count: int, cells: tuple[int, int, int], sides: tuple[float, float, float], units: str = "SI",
          uneven: float = 0.0) -> fs.Substructure:
    """It floats, and its interface is flat: across the plane its condensed K holds rounding only, where that has rank 0."""
    material, length = STEEL[units]
    mesh = fs.block(tuple(length * side for side in sides), cells, "hexahedron")
    nodes = mesh.nodes(face)
    nodes = nodes[np.linspace(0, len(nodes) - 1, count).astype(int)]
    points = mesh.points + uneven * length * min(sides) * np.random.default_rng(1).uniform(-1, 1, mesh.points.shape)
    mesh = fs.Mesh(points, mesh.cells, mesh.kind, mesh.sets | {"joint": nodes})
    return fs.solid(mesh, material, interface=["joint"], ports={"belt": ("right", "y")})


def zeros(model: fs.Substructure | fs.Pencil, contact: fs.Belt | None = None) -> int:
    """How many eigenvalues are at 0; all others have to be far from it."""
    modes = fs.complex_modes(model, contact)
    size = np.abs(modes.eigenvalues)
    assert np.array_equal(modes.rigid, size == 0) and size[~modes.rigid].min() > 1e-5 * size.max() ** 0.5
    return int(modes.rigid.sum())


@pytest.mark.sampled(5)
@pytest.mark.parametrize("units", STEEL)
@pytest.mark.parametrize("uneven", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize(("face", "count", "cells", "sides"), FACES)
def test_all_six_of_a_reduced_block(face: str, count: int, cells: tuple, sides: tuple, uneven: float, units: str) -> None:
    sub = block(face, count, cells, sides, units, uneven)
    for method in (fs.CraigBampton(modes=3), fs.CraigBampton(modes=15), fs.CraigChang(modes=5)):
        rom = fs.reduce(sub, method)
        elastic = fs.normal_modes(rom, count=1)
        omega = float(elastic.frequencies[-1])
        assert elastic.rigid == modal_form(rom.pencil).rigid == 6
        for D, expected in ((None, 12), (1e-2 / omega * rom.K, 12), (1e-2 * omega * rom.M, 6)):
            modes = fs.complex_modes(rom.with_damping(D))
            assert modes.rigid.sum() == expected and np.array_equal(modes.eigenvalues[modes.rigid], np.zeros(expected))
            assert np.abs(modes.eigenvalues[~modes.rigid]).min() > 5e-3 * omega
            votes = (~modes.rigid & ~modes.above_cutoff).any()
            assert len(modes.unstable) == 0 and modes.is_stable is (True if votes and D is not None else None)
        brake = fs.Belt(slope=-1e-3 * omega * float(rom.M.diagonal().max()))
        pushed = fs.complex_modes(rom.with_damping(None), brake)  # of the six the belt drives one combination
        assert pushed.rigid.sum() == 11 and pushed.is_stable is not True


@pytest.mark.parametrize("units", [1.0, 1e-20, 1e20])
def test_interfaces_that_just_hold(units: float) -> None:
    """Their K is 0 exactly, and dust in the other coordinates has no scale there."""
    chain = fs.chain(20, belt=2, interface=(1,), fixed=False, damping=0.0)
    beam = fs.beam(1.0, 20, E=2.1e11, I=1.3e-8, rho=7850.0, A=4e-4, interface=["right"], ports={"belt": 0.5})
    for sub, rigid, push in ((chain, 1, 1e-3), (beam, 2, 0.1)):
        rom = fs.reduce(sub, fs.CraigBampton(modes=4))
        rom = fs.Substructure(rom.M * units, rom.K * units, None, rom.interface, {"belt": rom.port("belt")})
        assert modal_form(rom.pencil).rigid == fs.normal_modes(rom, count=1).rigid == rigid
        assert zeros(rom) == 2 * rigid and zeros(rom, fs.Belt(slope=push * units)) == 2 * rigid - 1


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("modes", [0, 6])
def test_friction_or_a_negative_spring_inside_does_not_hide_them(modes: int, symmetric: bool) -> None:
    rom = fs.reduce(block(*FACES[0]), fs.CraigBampton(modes=modes))
    reduced, place = rom.interface.reshape(3, 3), rom.full_dofs.points[rom.full_interface[::3]]
    assert np.ptp(place[:, 0]) < 1e-12
    spring, other = np.zeros((2, rom.size))
    for column, (a, b) in ((spring, (0, 1)), (other, (1, 2))):
        along = (place[b] - place[a]) / np.linalg.norm(place[b] - place[a])
        column[reduced[a]], column[reduced[b]] = -along, along
    top = np.abs(rom.K.diagonal()).max()
    K = rom.K - 3 * top * np.outer(spring, spring) if symmetric else rom.K + 3 * top * np.outer(other, spring)
    pencil = fs.Pencil(rom.M, None, K)
    assert la.eigvalsh((K + K.T) / 2, rom.M)[0] < 0
    assert modal_form(pencil).rigid == 6 and zeros(pencil) == 12


def test_a_rigid_motion_that_the_unsymmetric_part_of_k_resists_is_none() -> None:
    sub = lattice(4, 5)
    M, K = sub.M.toarray(), sub.K.toarray()
    K[0, 7], K[7, 0] = K[0, 7] + 0.3, K[7, 0] - 0.3
    n = len(K)
    form = modal_form(fs.Pencil(M, None, K))
    assert form.rigid == 1 and np.abs(K @ form.shapes[:, 0]).max() < 1e-14
    found = fs.complex_modes(fs.Pencil(M, None, K)).eigenvalues
    plain = la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]]))
    assert (found == 0).sum() == 2
    for value in found[np.abs(found) > 1e-3]:
        assert np.abs(plain - value).min() < 1e-9


@pytest.mark.filterwarnings("ignore:rounding in the entries of K")
@pytest.mark.parametrize("share", [1e-12, 1e-9, 1e-6])
def test_soft_mounts_are_elastic(share: float) -> None:
    free = block(*FACES[0])
    held = fs.Substructure(free.M, free.K + 2.1e9 * share * sp.eye_array(free.size), interface=free.interface)
    mass = float(free.M.sum()) / 3
    for model in (held, fs.reduce(held, fs.CraigBampton(modes=6)), fs.reduce(held, fs.CraigChang(modes=6))):
        modes = fs.complex_modes(model)
        assert not modes.rigid.any() and fs.normal_modes(model, count=1).rigid == 0
        assert modal_form(model.pencil.dense()).rigid == 0
        # heaving: all springs in line
        low = np.sort(modes.frequencies)[:12]
        omega = np.sqrt(2.1e9 * share * free.size / 3 / mass)
        assert np.abs(low / omega - 1).min() < 1e-3


def test_an_oscillator_by_itself_is_elastic_however_soft() -> None:
    assert modal_form(fs.Pencil(np.eye(2), None, np.diag([1.0, 1e-20]))).rigid == 0
    assert modal_form(fs.Pencil(np.eye(2), None, np.diag([1.0, 0.0]))).rigid == 1
    assert modal_form(fs.Pencil(np.eye(2), None, np.zeros((2, 2)))).rigid == 2


def test_free_parts_of_unlike_stiffness_are_told_one_by_one() -> None:
    K = la.block_diag(*[fs.chain(60, fixed=False, springs=k).K.toarray() for k in (1.0, 1e12)])
    modes = fs.normal_modes(fs.Substructure(np.eye(120), K), count=1)
    assert modes.rigid == 2 and modes.frequencies[2] == pytest.approx(2 * np.sin(np.pi / 120), rel=1e-9)
    assert modal_form(fs.Pencil(np.eye(120), None, K)).rigid == 2


SOFT = [(1.9e10, 190.0), (1.9e10, 19.0), (1.9e10, 1.9), (1e6, 1e-2), (1e6, 1e-3), (1.1e6, 1.3e-3), (2.0**34, 200.0), (1.0, 0.1),
        (3.0, 3e-12)]


@pytest.mark.parametrize(("stiff", "soft"), SOFT)
def test_a_soft_spring_inside_hides_no_rigid_motion(stiff: float, soft: float) -> None:
    """Three masses: the diagonal has lost digits of the soft spring, but K Z = 0 for the translation, which gives them back."""
    K = np.array([[stiff, -stiff, 0], [-stiff, stiff + soft, -soft], [0, -soft, soft]])
    mean, product = stiff + soft, 3 * soft * stiff  # λ² - 2 mean λ + product = 0
    exact = np.sqrt(product / (mean + np.sqrt(mean**2 - product)))
    sub = fs.Substructure(np.eye(3), K)
    modes = fs.normal_modes(sub, count=2)
    assert modes.rigid == 1 and modes.evidence == "certified" and modes.rounding[1] < 1e-6
    assert modes.frequencies[1] == pytest.approx(exact, rel=1e-7)
    found = fs.complex_modes(sub)
    assert found.rigid.sum() == 2 and np.abs(found.eigenvalues[~found.rigid]).min() == pytest.approx(exact, rel=1e-3)


def soft_system(frequency: float, method: fs.Method | None = None) -> fs.System:
    """A free steel beam and a block of 50 kg on a spring, as in issue 53."""
    beam = fs.beam(1.0, 20, E=2.1e11, I=8e-6, rho=7850.0, A=1e-2, interface=["left", "right"])
    block = fs.Substructure([[50.0]], [[0.0]], interface={"m": [0]})
    spring = fs.Spring(("beam", [0]), ("block", "m"), stiffness=50 * (2 * np.pi * frequency) ** 2)
    return fs.couple({"beam": beam if method is None else fs.reduce(beam, method), "block": block}, [spring])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("frequency", [10.0, 5.0, 3.0, 0.5, 0.01])
def test_a_block_on_a_soft_spring_floats_with_the_beam(frequency: float) -> None:
    """Where the spring is soft, the beam is rigid: ω² = k (1/m + 1/m_beam + 12 (L/2)²/(m_beam L²))."""
    beam = 7850.0 * 1e-2
    exact = 2 * np.pi * frequency * np.sqrt(1 + 50 * 4 / beam)
    for model in (soft_system(frequency), soft_system(frequency, fs.CraigChang(3)), soft_system(frequency, fs.Guyan())):
        modes = fs.normal_modes(model, count=2)
        assert modes.rigid == 2 and modes.rounding.max() < 1e-4
        assert modes.frequencies[2] == pytest.approx(exact, rel=1e-6 + 1e-5 * frequency**2)
        found = fs.complex_modes(model)
        assert found.rigid.sum() == 4 and found.is_stable is not False


def test_three_pieces_in_a_row_on_springs_of_1e_12_of_their_stiffness() -> None:
    block = fs.solid(fs.block((1.0, 0.4, 0.3), (1, 1, 1), "hexahedron"), STEEL["SI"][0], interface=["left", "right"])
    size = 1e-12 * float(block.K.diagonal().min())
    joints = [fs.Spring((f"p{i}", "right"), (f"p{i + 1}", "left"), stiffness=size, tol=np.inf) for i in range(2)]
    modes = fs.normal_modes(fs.couple({f"p{i}": block for i in range(3)}, joints), count=13)
    along = 4 * size / (7850.0 * 0.12) * np.array([1.0, 3.0])  # of three masses in a row
    assert modes.rigid == 6 and modes.rounding[6:18].max() < 1e-8 and modes.eigenvalues[18] > 1e9 * modes.eigenvalues[17]
    assert [np.abs(modes.eigenvalues / value - 1).min() for value in along] == pytest.approx([0, 0], abs=1e-9)


def test_low_frequencies_of_a_floating_beam_keep_their_digits() -> None:
    beam = fs.beam(1.0, 60, E=2.1e11, I=1.3e-8, rho=7850.0, A=4e-4, interface=["left", "right"])
    rom = fs.reduce(beam, fs.CraigBampton(modes=40))
    modes = fs.complex_modes(rom)
    found = np.sort(modes.frequencies[~modes.rigid])[::2][:5]
    np.testing.assert_allclose(found, fs.normal_modes(rom, count=5).frequencies[2:], rtol=1e-12)


def test_what_is_rounding_of_the_stiffness_beside_it_is_none() -> None:
    K = la.block_diag(fs.chain(5, fixed=False).K.toarray(), 1e-32)
    spring = np.array([1.0, 0, -1, 0, 0, 0])
    K -= 3.0 * np.outer(spring, spring)
    form = modal_form(fs.Pencil(np.eye(6), None, K))
    assert form.rigid == 2 and (form.sign < 0).sum() == 1


EIGHT = {one.key: one for one in (fs.CraigBampton, fs.Hurty, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.Herting,
                                  fs.DualCraigBampton, fs.Guyan)}


def damped(sub: fs.Substructure, beta: float, interface: list[int]) -> fs.Substructure:
    return fs.Substructure(sub.M, sub.K, beta * sub.K, interface)


def verdict(model: fs.Substructure) -> tuple[int, int, bool]:
    """Eigenvalues at 0, rigid-body modes, and whether a mode is said to grow, or to be undecided where others count."""
    modes = fs.complex_modes(model)
    votes = (~modes.rigid & ~modes.above_cutoff).any()
    return int(modes.rigid.sum()), fs.normal_modes(model, count=0).rigid, modes.is_stable is (True if votes else None)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("key", EIGHT)
def test_damped_parts_keep_the_rigid_motion_of_the_full_one(key: str) -> None:
    """VᵀDV keeps rounding where D annuls rigid motion: Guyan's guided beam grew by 1.2e-17, beyond its bar."""
    guided = damped(fs.beam(1.0, 5, E=1.0, I=1.0, rho=1.0, A=1.0), 1e-4, [0, 1, 11])
    free = damped(fs.beam(1.0, 5, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4), 1e-5, [0, 1, 10, 11])
    for sub, held, expected in ((guided, [1], (2, 1, True)), (free, [], (4, 2, True))):
        joints = [fs.Rigid(("a", held), "ground")] if held else []
        for part in (sub, fs.reduce(sub, EIGHT[key](2))):
            assert verdict(fs.couple({"a": part}, joints) if held else part) == expected
            assert verdict(fs.couple({"a": part}, joints)) == expected
    rom = fs.reduce(free, EIGHT[key](2))
    pair = fs.couple({"a": rom, "b": rom}, [fs.Rigid(("a", [11]), ("b", [1]))])  # by slopes alone
    assert verdict(pair) == (6, 3, True)


@pytest.mark.parametrize("key", EIGHT)
def test_a_dashpot_to_the_ground_leaves_one_eigenvalue_at_0(key: str) -> None:
    """That of the motion it brakes is negative, and no rounding of 0; of MacNeal's, with DOF without mass, too."""
    sub = fs.beam(1.0, 5, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4)
    D = 1e-5 * sub.K.toarray()
    D[4, 4] += 1e-2
    sub = fs.Substructure(sub.M, sub.K, D, [0, 1, 10, 11])
    for model in (sub, fs.reduce(sub, EIGHT[key](2))):
        modes = fs.complex_modes(model)
        assert modes.rigid.sum() == 3 and modes.is_stable is not False
        slow = modes.eigenvalues[~modes.rigid & (np.abs(modes.eigenvalues) < 1.0)]
        assert len(slow) == 1 and slow[0].imag == 0 and slow[0].real == pytest.approx(-1e-2 * 1.12 / 0.785, rel=1e-3)


def test_what_a_contact_holds_or_brakes_is_no_rigid_motion() -> None:
    sub = fs.beam(1.0, 5, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, ports={"belt": 0.0})
    sub = fs.Substructure(sub.M, sub.K, 1e-5 * sub.K, [0, 1, 10, 11], sub.ports)
    spring = fs.LinearContact(("belt",), stiffness=[[1e3]])
    for method in (fs.Guyan(), fs.CraigBampton(2), fs.Rubin(2), fs.MacNeal(2)):
        rom = fs.reduce(sub, method)
        assert fs.complex_modes(rom).rigid.sum() == 4
        assert fs.complex_modes(rom, fs.Belt("belt", slope=1e-3)).rigid.sum() == 3
        assert fs.complex_modes(rom, spring).rigid.sum() == 2


def test_rigid_motion_goes_with_copies_and_files_and_not_with_another_stiffness(tmp_path: Path) -> None:
    sub = damped(fs.beam(1.0, 5, E=1.0, I=1.0, rho=1.0, A=1.0), 1e-4, [0, 1, 11])
    rom = fs.reduce(sub, fs.Guyan())
    fs.write_matrices(tmp_path / "rom", rom)
    copies = pickle.loads(pickle.dumps(rom)), fs.read_component(tmp_path / "rom"), dataclasses.replace(rom, name="other")
    for model in (rom, *copies):
        assert verdict(fs.couple({"a": model}, [fs.Rigid(("a", [1]), "ground")]))[:2] == (2, 1)
    held = np.array(rom.K) + np.eye(rom.size)
    assert fs.normal_modes(dataclasses.replace(rom, K=held), count=0).rigid == 0
    undamped = rom.with_damping(None)
    assert fs.complex_modes(undamped).rigid.sum() == 4
    assert fs.complex_modes(rom.with_damping(np.eye(rom.size))).rigid.sum() == 2


def test_a_node_of_a_mode_at_a_dashpot_is_undecided_and_not_unstable() -> None:
    """The dashpot lies in the node of the second mode but for rounding: no sign of VᵀDV holds there, and the bar says so."""
    chain = fs.chain(21, fixed=False, damping=0.0)
    row = np.zeros(21)
    row[9], row[11] = 1.0, -1.0  # rests in every even mode, as these are symmetric
    sub = fs.Substructure(chain.M, chain.K, 1e3 * np.outer(row, row), [0, 20])
    for method in (fs.CraigBampton(12), fs.CraigChang(12), fs.Rubin(12), fs.Herting(12)):
        modes = fs.complex_modes(fs.reduce(sub, method))
        assert modes.rigid.sum() == 2 and not len(modes.unstable)


@pytest.mark.sampled(3)  # each of the five kinds among them
@pytest.mark.parametrize("seed", [2, 7, 27, 51])
@pytest.mark.parametrize("kind", attack.KINDS)
def test_at_random(kind: str, seed: int) -> None:
    assert not attack.attacked(kind, seed).startswith("wrong")


@pytest.mark.filterwarnings("ignore:6 modes are taken as rigid-body motion")
@pytest.mark.parametrize("digits", [9, 12])
def test_all_six_of_a_reduced_block_whose_k_has_few_digits(digits: int) -> None:
    full = fs.solid(fs.block((1.0, 0.1, 0.1), (8, 3, 2), "hexahedron"), STEEL["SI"][0], interface=["left"])
    K = full.K.copy()
    K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    sub = fs.Substructure(full.M, K, interface=full.interface)
    exact = fs.normal_modes(full, count=2).frequencies[6:]
    for method in (fs.CraigBampton(modes=20), fs.CraigChang(modes=5)):
        modes = fs.normal_modes(fs.reduce(sub, method), count=2)
        assert modes.rigid == 6 and np.allclose(modes.frequencies[6:], exact, rtol=2e-2)


def test_equal_real_eigenvalues_that_rounding_splits_are_no_pair():
    """Under D = αM all rigid motions decay with λ = -α. As λ = -α ± 1e-16i these have twice the real part of a pair's energy."""
    sub, alpha = lattice(4, 3, seed=2), 0.4
    form = modal_form(fs.Pencil(sub.M.toarray(), alpha * sub.M.toarray(), sub.K.toarray()))
    n, r = len(form.omega), form.rigid
    assert r == 3 and np.array_equal(form.C, form.C.T)
    state = np.zeros((2 * n - r, 2), dtype=complex)
    state[n - r:n - r + 2] = [[1.0, 1.0], [1j, -1j]]  # q = φ₁ ± iφ₂, without potential energy
    split = np.array([-alpha + 1e-16j, -alpha - 1e-16j])
    assert np.array_equal(form.with_energy(split, state), split)
    pair = np.array([-alpha / 2 + 1j * np.sqrt(form.omega[r]**2 - alpha**2 / 4)])  # the first elastic mode
    state = np.zeros((2 * n - r, 1), dtype=complex)
    state[0], state[n] = form.omega[r], pair[0]
    assert form.with_energy(pair + 1e-9, state) == pytest.approx(pair, rel=1e-13)


def test_a_dof_that_only_rounding_holds_moves_freely_beside_a_soft_elastic_body() -> None:
    """Its motion causes forces of rounding alone, and stays out of the search for the others."""
    n = 201
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0], K[:, 0] = 0.0, 0.0
    K[0, 1] = K[1, 0] = 1e-16
    found = ShiftInvert(K, np.eye(n))
    assert found.rigid.shape[1] == 1 and abs(found.rigid[0, 0]) == 1.0
    modes = fs.normal_modes(fs.Substructure(np.eye(n), K, interface=[0]), count=3)
    np.testing.assert_allclose(modes.frequencies[1:], 2 * np.sin(np.pi * np.arange(1, 4) / (2 * n)), rtol=1e-9)

def test_motions_of_very_different_sizes_meet_their_conditions() -> None:
    """b, the middle one of three, is joined to the small motion of a and to the large one of c: no condition is lost."""
    B = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) * [1e-9, 1e-9, 1e2]
    N = null_space(B, np.abs(B))
    assert N is not None and N.shape == (3, 1)
    assert (np.abs(B @ N) <= 1e-14 * (np.abs(B) @ np.abs(N))).all()
    D = np.diag([1.0, 0.0, 0.0, 0.0])  # and of two motions the small one is damped
    shapes = np.array([[1e-14, 1e-14, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]]).T
    assert RigidMotion.of(shapes, D, np.ones(4)).free == 1


def test_parts_whose_rigid_motions_have_very_different_sizes_on_soft_springs() -> None:
    """Reduced parts have it in units of their stiffness, full ones in those of their mass: 2e-5 of ω was lost in silence."""
    assert attack.attacked("soft", 20728) == "certified"


@pytest.mark.parametrize(("n", "soft"), [(2000, 1e-9), (6000, 1e-8)])
def test_a_long_chain_of_pieces_on_soft_springs_floats(n: int, soft: float) -> None:
    """The first elastic ω² is 1e-8 to 1e-7 of a spring's over its mass: a second shift is still far above it."""
    springs = np.where(np.arange(n - 1) % 2 == 0, 1.0, soft)
    K = sp.diags_array([np.append(springs, 0) + np.append(0, springs), -springs, -springs], offsets=[0, 1, -1], format="csr")
    found = fs.normal_modes(fs.Substructure(sp.eye_array(n, format="csr"), K), count=3)
    assert found.rigid == 1 and found.evidence == "certified"
    exact = np.sqrt(soft / 2) * 2 * np.sin(np.arange(1, 4) * np.pi / n)  # pieces of two masses, but for soft / 2 of it
    np.testing.assert_allclose(found.frequencies[1:], exact, rtol=2 * soft)


def test_a_mode_that_may_be_rigid_motion_is_not_certified_by_a_count() -> None:
    """Rounding of 1 + 1e-9 is the same in each row: a mount of a quarter of the first elastic ω², which K cannot hold."""
    springs = np.where(np.arange(7999) % 2 == 0, 1.0, 1e-9)
    K = sp.diags_array([np.append(springs, 0) + np.append(0, springs), -springs, -springs], offsets=[0, 1, -1], format="csr")
    with pytest.warns(fs.ConditionWarning, match="rounding in the entries of K"):
        found = fs.normal_modes(fs.Substructure(sp.eye_array(8000, format="csr"), K), count=3)
    assert found.rigid == 1 or found.evidence == "not checked"


def _random_pieces(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """K of up to seven pieces on soft springs, the piece of each DOF, motions Z, and shapes that are Z but for a little."""
    sizes = rng.integers(1, 9, int(rng.integers(2, 8)))
    K = la.block_diag(*(A @ A.T for A in (rng.standard_normal((size, size)) for size in sizes)))
    for i, j in rng.integers(0, len(K), (12, 2)):
        K[np.ix_([i, j], [i, j])] += 10.0 ** rng.uniform(-14, -8) * np.array([[1.0, -1.0], [-1.0, 1.0]]) * (i != j)
    order = rng.permutation(len(K))
    Z = rng.standard_normal((len(K), int(rng.integers(0, 4))))
    X = Z @ rng.standard_normal((Z.shape[1], 3)) + 1e-6 * rng.standard_normal((len(K), 3))
    return K[np.ix_(order, order)], np.repeat(np.arange(len(sizes)), sizes)[order], Z, X


@pytest.mark.parametrize("seed", range(12))
def test_forces_and_strains_are_those_of_the_pieces_one_by_one(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    K, piece, Z, X = _random_pieces(rng)
    scale = np.sqrt(K.diagonal())[:, None]
    forces, sizes = np.zeros((2, *X.shape))
    for p in np.unique(piece):
        at = piece == p
        moved = X - Z @ np.linalg.lstsq(scale[at] * Z[at], scale[at] * X[at], rcond=1e-9)[0]
        forces[at], sizes[at] = K[at] @ moved, np.abs(K[at]) @ np.abs(moved)
    monkeypatch.setattr(rigid_motion, "ENTRIES", int(rng.choice([1, 50, 10**6])))
    for matrix in (K, sp.csr_array(K)):
        found = elastic_forces(matrix, X, Z, piece)
        noise = 1e-14 * np.abs(K) @ np.abs(X)
        assert (np.abs(found[0] - forces) <= noise + 1e-12 * sizes).all() and (np.abs(found[1] - sizes) <= noise).all()
        link = links(matrix, piece, 1e-16)
        for moves in (np.ones((len(K), 2)), np.where(piece == 0, 0.0, 1.0)[:, None], X):
            expected = False
            for p in np.unique(piece):
                at = piece == p
                size, V = np.linalg.svd(scale[at] * moves[at], full_matrices=True)[1:]
                rank = int(np.count_nonzero(size > 1e-6 * size.max()))
                Y, U = moves @ V[rank:].T, (moves[at] @ V[:rank].T) / size[:rank]
                own = link.toarray()[at]
                expected |= bool((np.abs(U.T @ (own @ Y)) > 1e-3 * (np.abs(U).T @ (np.abs(own) @ np.abs(Y)))).any())
            assert strains(link, moves, piece, scale[:, 0]) is expected


def test_the_two_forces_of_a_soft_spring_balance_each_other() -> None:
    """Two pieces that move together but for 1e-12, with strains of 1e-8: the sum of the forces was a rounding of the motion."""
    k = np.array([1e6, 1.0, 1e6])
    K = np.diag(np.append(k, 0.0) + np.append(0.0, k)) - np.diag(k, 1) - np.diag(k, -1)
    strain = 1e-8 * np.random.default_rng(0).uniform(-1, 1, (4, 20))
    X = 0.7 + np.array([[0.0], [0.0], [1e-12], [1e-12]]) + strain
    forces, sizes = elastic_forces(K, X, np.ones((4, 1)), np.array([0, 0, 1, 1]))
    assert (np.abs(forces.sum(axis=0)) <= 4 * np.finfo(float).eps * sizes.max(axis=0)).all()


def test_pieces_of_a_size_are_decomposed_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call in Python takes a millisecond, and a chain of 12,000 masses has 6,000 pieces."""
    calls = []

    def counted(name: str) -> None:
        of = getattr(np.linalg, name)
        monkeypatch.setattr(np.linalg, name, lambda *args, **more: calls.append(name) or of(*args, **more))

    for name in ("lstsq", "pinv", "svd", "qr"):
        counted(name)
    n = 400
    springs = np.where(np.arange(n - 1) % 2 == 0, 1.0, 1e-8)
    K = sp.diags_array([np.append(springs, 0) + np.append(0, springs), -springs, -springs], offsets=[0, 1, -1], format="csr")
    piece = np.arange(n) // 2
    elastic_forces(K, np.random.default_rng(0).standard_normal((n, 3)), np.ones((n, 1)), piece)
    strains(links(K, piece, 1e-15), np.ones((n, 2)), piece, np.ones(n))
    assert len(calls) < 10


def test_a_floating_macneal_part_without_elastic_modes_has_rigid_motion_alone() -> None:
    """Rounding made mass of it: 30 eigenvalues were found for 6; in large units its interface could not be solved for."""
    block = fs.block((1.0, 0.4, 0.3), (1, 1, 1), "hexahedron")
    for E, rho in ((1.0, 1.0), (1e19, 1e-12), (1e-9, 1e6)):
        sub = fs.solid(block, fs.Material(E, 0.3, rho))
        sub = fs.Substructure(sub.M, sub.K, interface=range(sub.size))
        rom = fs.reduce(sub, fs.MacNeal(0))
        found = fs.complex_modes(rom)
        assert found.rigid.all() and len(found.rigid) == 12 and found.evidence == "certified"


@pytest.mark.parametrize("seed", [500055, 500364, 500526])
def test_a_macneal_part_of_two_pieces_on_soft_springs_has_its_modes(seed: int) -> None:
    """Motions without mass were made of stiff DOF with little: their stiffness was singular, and the part refused."""
    assert attack.attacked("soft", seed) in ("certified", "told")


def test_a_mode_whose_digits_k_holds_is_listed_between_two_whose_it_does_not_hold() -> None:
    """ω = 0.570 of a chain that hardly a spring holds, with one stiff spring: the modes around it were listed, and certified."""
    k = np.array([0.65, 8.29, 0.91, 3.05, 1e7, 0.1, 2.08, 0.92, 0.28])
    K = np.diag(np.append(k, 0.0) + np.append(0.0, k)) - np.diag(k, 1) - np.diag(k, -1)
    K[0, 0] += 3e-10
    exact = np.sqrt(np.linalg.eigvalsh(K)[1:])
    for count in range(1, 9):
        found = fs.normal_modes(fs.Substructure(np.eye(10), K), count=count)
        assert found.rigid == 1 and found.frequencies[1:] == pytest.approx(exact[:count], rel=1e-3)
    whole = fs.normal_modes(fs.Substructure(np.eye(10), K), band=(0.0, 1.0))
    assert whole.frequencies[1:] == pytest.approx(exact[exact < 1], rel=1e-3)


def test_a_guided_beam_on_the_dof_of_its_interface_alone_keeps_its_rigid_motion() -> None:
    """The modes of the reduced part have other units than its rotations, which are compared with its displacements."""
    assert attack.attacked("guided", 810136) == "certified"


@pytest.mark.parametrize("size", [1.0, 1e-16, 1e-24])
@pytest.mark.parametrize("soft", [1e-3, 1e-8])
def test_a_spring_between_a_mass_and_interface_forces_acts_in_all_units(size: float, soft: float) -> None:
    chain = fs.chain(8, fixed=False, damping=0.0)
    part = fs.Substructure(size * chain.M, size * chain.K, interface=list(range(8)))
    mass, spring = fs.Substructure([[size]], [[0.0]], interface=[0]), fs.Spring(("a", [1]), ("b", [0]), stiffness=soft * size)
    models = [fs.couple({"a": one, "b": mass}, [spring]) for one in (part, fs.reduce(part, fs.DualCraigBampton(modes=0)))]
    full, reduced = (fs.normal_modes(model, count=1).frequencies for model in models)
    assert full[0] == reduced[0] == 0 and reduced[1] == pytest.approx(full[1], rel=1e-6)


def test_a_mode_is_judged_with_each_dof_in_its_own_unit() -> None:
    """Forces of 1e-5 N beside modal coordinates of 1e14: the sum of both residuals refused a mode that has ten digits."""
    assert attack.attacked("soft", 70096) == "certified"


def fine_beam(n: int, ends: tuple[str, str], springs: tuple[float, float] = (0.0, 0.0)) -> fs.Substructure:
    """EI = ρA = L = 1, springs in EI/L³ or EI/L; K alone is known."""
    M, K = attack._beam(n, 0.0, list(ends), list(springs), (1.0, 1.0, 1.0))
    return fs.Substructure(M, K)


@pytest.mark.parametrize("n", [300, 2506, 4000])
def test_the_first_mode_of_a_fine_beam_that_is_guided_and_pinned_is_no_rigid_motion(n: int) -> None:
    """ω² of the next mode is 81 times as high, more than of any other beam whose ends are held or free."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.ConditionWarning)
        assert fs.normal_modes(fine_beam(n, ("guided", "pinned")), count=1).rigid == 0


@pytest.mark.parametrize(("n", "ends", "springs"), [
    (194, ("free", "spring"), (0.0, 5e-5)), (62, ("spring", "spring"), (4e-5, 5e-7)),
    (1744, ("pinned", "turning spring"), (0.0, 0.7)), (4053, ("pinned", "turning spring"), (0.0, 20.0))])
def test_a_fine_beam_on_soft_springs_is_not_called_free_in_silence(n: int, ends: tuple, springs: tuple) -> None:
    with pytest.warns(fs.ConditionWarning, match="taken as rigid-body motion|rounding in the entries of K"):
        fs.normal_modes(fine_beam(n, ends, springs), count=1)


@pytest.mark.parametrize(("n", "ends", "rigid"), [(1000, ("free", "free"), 2), (1000, ("pinned", "free"), 1),
                                                  (1000, ("guided", "free"), 1), (400, ("guided", "pinned"), 0)])
def test_a_beam_of_a_thousand_elements_has_its_rigid_motion_without_a_warning(n: int, ends: tuple, rigid: int) -> None:
    modes = fs.normal_modes(fine_beam(n, ends), count=1)
    assert modes.rigid == rigid and modes.evidence == "certified"
