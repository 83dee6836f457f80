"""A turning solid in a fixed frame: rigid rotors, the turning frame's frequencies, spinning membranes; what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.modes import rotation
from femsub.modes.quadratic.sparse import by_inertia

MESHES = Path(__file__).parent.parent / "meshes"
STEEL = fs.Material(2.1e11, 0.3, 7850.0)
ACROSS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # e_z × x
SURE = {"certified", "confirmed"}
KINDS = ["hexahedron", "hexahedron20", "hexahedron27", "tetra", "tetra10"]


@cache
def disc(around: int, interface: bool = False, rings: int = 1) -> tuple[fs.Mesh, fs.Rotor]:
    """A disc held at its inner rim."""
    mesh = fs.annulus(0.05, 0.15, 0.01, (rings, around, 1))
    mesh = mesh.with_sets(pad=lambda x: (np.hypot(*(x[:, :2] - [0.15, 0.0]).T) < 0.04) & (x[:, 2] > 0.009))
    part = fs.solid(mesh, STEEL, supports=["inner"], interface=["pad"] if interface else [])
    return mesh, fs.rotating(part, mesh, STEEL)


def rigid(x: np.ndarray) -> np.ndarray:
    """Three translations and three small rotations about the origin, shape (3n, 6)."""
    motions = [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]
    return np.stack([motion.ravel() for motion in motions], axis=1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_rigid_rotor_has_the_textbook_gyroscopic_matrix(kind: str) -> None:
    """Genta, Dynamics of Rotating Systems (2005): the moment of momentum I_p Ω turns with the tilt, and that is all."""
    mesh = fs.annulus(0.05, 0.15, 0.03, (1, 12, 2), kind)
    mesh = replace(mesh, points=mesh.points - [0.0, 0.0, 0.015])
    free = fs.solid(mesh, STEEL)
    rotor = fs.rotating(free, mesh, STEEL)
    assert free.dofs is not None and free.dofs.points is not None
    R = rigid(free.dofs.points[::3])
    M, G, K = (R.T @ (A @ R) for A in (free.M, rotor.gyroscopic, rotor.centrifugal))
    polar = M[5, 5]
    expected = np.zeros((6, 6))
    expected[3, 4], expected[4, 3] = polar, -polar
    assert np.allclose(G, expected, rtol=0, atol=1e-10 * polar)
    assert np.abs(K[:3, :3]).max() < 1e-10 * M[0, 0] and np.abs(K[3:, 3:]).max() < 1e-10 * polar


def test_the_matrices_are_skew_and_symmetric_to_the_last_digit() -> None:
    rotor = disc(16)[1]
    assert abs(rotor.gyroscopic + rotor.gyroscopic.T).max() == 0
    assert abs(rotor.centrifugal - rotor.centrifugal.T).max() == 0


@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron27", "tetra10"])
def test_a_rigid_translation_feels_no_rotation_and_a_turn_about_the_axis_no_force(kind: str) -> None:
    mesh = fs.annulus(0.05, 0.15, 0.03, (1, 16, 1), kind)
    free = fs.solid(mesh, STEEL)
    rotor = fs.rotating(free, mesh, STEEL)
    assert free.dofs is not None and free.dofs.points is not None
    R = rigid(free.dofs.points[::3])
    scale = np.abs(rotor.centrifugal).sum(axis=1).max()
    assert np.abs(rotor.centrifugal @ R[:, :3]).max() < 1e-11 * scale
    # the surface is round to the mesh's order only
    turned = np.linalg.norm(rotor.centrifugal @ R[:, 5]) / np.linalg.norm(free.M @ R[:, 5])
    assert turned < 1e-3


def turning_frame(mesh: fs.Mesh, rotor: fs.Rotor, speed: float) -> fs.Pencil:
    """M ẅ + 2Ω M(e × ẇ) + (K + Ω² (K_geo + M(e × e ×)))w for the part of `rotor`, seen from the disc.

    K_geo = K_Ω - K_R, where K_R, which knows no stress, comes from a material without stiffness worth the name.
    """
    part, nodes = rotor.part, rotor.part.size // 3
    soft = fs.Material(1e-20 * STEEL.E, STEEL.nu, STEEL.rho)
    assert part.dofs is not None
    convective = rotation.turning(  # type: ignore[attr-defined]
        mesh, [(soft, np.arange(len(mesh.cells)))], ACROSS, np.zeros(3), np.zeros((len(mesh.points), 3)))[1]
    rows = 3 * (part.dofs.nodes - 1) + part.dofs.components
    geometric = rotor.centrifugal - convective[rows][:, rows]
    across = sp.kron(sp.eye_array(nodes), ACROSS)
    return fs.Pencil(part.M, 2 * speed * part.M @ across, part.K + speed**2 * (geometric + part.M @ across @ across))


def diameters(part: fs.Substructure, shapes: np.ndarray) -> np.ndarray:
    """k of each shape's largest wave e^{ikθ} in cylindrical components on the outer rim."""
    assert part.dofs is not None and part.dofs.points is not None
    x = part.dofs.points[::3]
    rim = np.flatnonzero((np.abs(np.hypot(x[:, 0], x[:, 1]) - 0.15) < 1e-9) & (x[:, 2] < 1e-9))
    angle = np.arctan2(x[rim, 1], x[rim, 0])
    u = shapes.reshape(len(x), 3, -1)[rim]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    waves = np.arange(-6, 7)
    turned = np.stack([c * u[:, 0] + s * u[:, 1], c * u[:, 1] - s * u[:, 0], u[:, 2]])
    share = np.einsum("kn,anm->kam", np.exp(-1j * np.outer(waves, angle)), turned)
    found: np.ndarray = waves[np.linalg.norm(share, axis=1).argmax(axis=0)]
    return found


def test_nodal_diameters_split_as_the_turning_frame_says() -> None:
    """A wave e^{i(kθ' + ωt)} of the turning frame, θ' = θ - Ωt, has ω - kΩ in the fixed frame."""
    speed, errors = 200.0, []
    for rings in (1, 2):
        mesh, rotor = disc(12 * rings, rings=rings)
        frames = []
        for pencil, shift in ((turning_frame(mesh, rotor, speed), speed), (rotor.at(speed).pencil, 0.0)):
            modes = fs.complex_modes(pencil, count=18)
            assert np.abs(modes.eigenvalues.real).max() < 1e-6
            up = modes.eigenvalues.imag > 0
            wave = diameters(rotor.part, modes.shapes[:, up])
            assert sorted(wave) == [-4, -3, -2, -1, 0, 1, 2, 3, 4]
            frames.append((modes.eigenvalues.imag[up] - shift * wave)[np.argsort(wave)])
        off = np.abs(frames[1] / frames[0] - 1)
        errors.append(np.maximum(off, off[::-1]))  # of the two waves of each pair
    assert errors[1].max() < 2e-5 and (errors[1] < errors[0] / 10).all()  # of order four or better


def test_no_wave_of_a_band_is_missing_or_added() -> None:
    mesh, rotor = disc(12)
    speed, top = 300.0, 1.45e4
    seen = fs.complex_modes(turning_frame(mesh, rotor, speed), band=(1.0, top + 4 * speed))
    wave = diameters(rotor.part, seen.shapes)
    expected = np.sort(seen.eigenvalues.imag - wave * speed)
    expected = expected[expected < top]
    found = fs.complex_modes(rotor.at(speed), band=(1.0, top))
    assert seen.evidence in SURE and found.evidence == "certified"
    assert len(expected) == len(found.eigenvalues) == 7
    assert np.allclose(np.sort(found.eigenvalues.imag), expected, rtol=1e-3)


@pytest.mark.slow
def test_the_frequencies_of_a_turning_part_are_counted_by_inertia() -> None:
    """Against all eigenvalues by LAPACK, at many radii; where K is not positive definite nothing is claimed."""
    rng, sub = np.random.default_rng(7), fs.chain(150, damping=0.0)
    for size in (0.1, 1.0, 5.0):
        G = size * sp.random_array((150, 150), density=0.03, rng=rng)
        pencil = fs.Pencil(sub.M, sp.csr_array(G - G.T), sub.K)
        omega = np.abs(fs.complex_modes(pencil.dense()).eigenvalues)
        for radius in (0.05, 0.3, 1.0, 1.9, 3.0):
            found = by_inertia(pencil, radius)
            assert found is not None and found.number == np.count_nonzero(omega < radius)
        assert fs.complex_modes(pencil, band=(0.0, 0.2)).evidence == "certified"
        assert fs.complex_modes(pencil, count=10).evidence == "certified"
    loose = fs.Pencil(sub.M, pencil.D, sub.K - 0.01 * sub.M)
    assert by_inertia(loose, 1.0) is None
    modes = fs.complex_modes(loose, count=6)  # by LAPACK: there is no count
    exact = fs.complex_modes(loose.dense()).eigenvalues
    assert modes.evidence == "certified" and np.isclose(np.abs(modes.eigenvalues), np.sort(np.abs(exact))[:6], rtol=1e-9).all()


@pytest.mark.slow
def test_any_axis_and_both_directions() -> None:
    mesh, rotor = disc(12)
    turn = la.expm(np.cross(np.eye(3), [0.3, -0.7, 0.4]))
    moved = replace(mesh, points=mesh.points @ turn.T + [1.0, 2.0, -0.5])
    part = fs.solid(moved, STEEL, supports=["inner"])
    other = fs.rotating(part, moved, STEEL, axis=7 * turn[:, 2], centre=turn @ [0.0, 0.0, 5.0] + [1.0, 2.0, -0.5])
    here, there, back = (np.sort(fs.complex_modes(one.at(speed).linearised().dense()).eigenvalues.imag)
                         for one, speed in ((rotor, 300.0), (other, 300.0), (rotor, -300.0)))
    assert np.allclose(here, there, rtol=1e-9) and np.allclose(here, back, rtol=1e-9)


@cache
def free_disc() -> fs.Rotor:
    mesh = fs.annulus(0.01, 1.0, 0.01, (12, 24, 1))
    return fs.rotating(fs.solid(mesh, STEEL), mesh, STEEL)


# tilting has no stiffness but for the rounding of the products below, of which some processors leave enough for a warning
@pytest.mark.filterwarnings("ignore:.*rigid-body motion, although K:femsub.checks.ConditionWarning")
@pytest.mark.parametrize(("wave", "circles"), [(1, 0), (2, 0), (3, 0), (0, 1), (2, 1)])
def test_a_spinning_membrane(wave: int, circles: int) -> None:
    """Lamb and Southwell, Proc. R. Soc. Lond. A 99 (1921) 272-280: a full disc without bending stiffness, ω²/Ω² in its frame is
    ((m + 2n)(m + 2n + 2)(3 + ν) - m²(1 + 3ν))/8. A small hole stands in for the centre."""
    rotor = free_disc()
    free = rotor.part
    assert free.dofs is not None and free.dofs.points is not None
    # lateral motion f(r) cos mθ and f(r) sin mθ, the same through the thickness: two columns for each radius
    x = free.dofs.points[2::3]
    angle, radii = np.arctan2(x[:, 1], x[:, 0]), np.unique(np.hypot(x[:, 0], x[:, 1]).round(9), return_inverse=True)[1]
    lift = np.zeros((free.size, 2 * (radii.max() + 1)))
    for side, value in enumerate((np.cos(wave * angle), np.sin(wave * angle))):
        lift[3 * np.arange(len(x)) + 2, 2 * radii + side] = value
    lift = lift[:, lift.any(axis=0)]
    M, G, K = (lift.T @ (A @ lift) for A in (free.M, rotor.gyroscopic, rotor.centrifugal))
    square = ((wave + 2 * circles) * (wave + 2 * circles + 2) * (3 + STEEL.nu) - wave**2 * (1 + 3 * STEEL.nu)) / 8
    lam = fs.complex_modes(fs.Pencil(M, G, K)).eigenvalues
    for omega in {np.sqrt(square) + wave, abs(np.sqrt(square) - wave)} - {0.0}:
        assert np.abs(lam - 1j * omega).min() < 2e-3 * (1 + omega)


@pytest.mark.parametrize("method", [fs.CraigBampton(modes=14), fs.CraigChang(modes=14),
                                    fs.CraigBampton(band=(1.0, 1.2e4), tol=1e-3)])
def test_a_turning_disc_is_reduced_as_any_other(method: Any) -> None:
    rotor = disc(16, interface=True)[1]
    turning, band = rotor.at(250.0), (1.0, 1.2e4)
    rom = fs.reduce(turning, method)
    full, small = fs.complex_modes(turning, band=band), fs.complex_modes(rom, band=band)
    assert {full.evidence, small.evidence} <= SURE and len(full.eigenvalues) == len(small.eigenvalues) > 4
    assert np.allclose(np.sort(full.eigenvalues.imag), np.sort(small.eigenvalues.imag), rtol=1e-3)
    # the basis of the part at rest does as well
    still = fs.reduce(rotor.part, method)
    G, C = (still.V.T @ A @ still.V for A in (rotor.gyroscopic, rotor.centrifugal))
    other = fs.complex_modes(replace(still, D=still.D + 250.0 * G, K=still.K + 250.0**2 * C), band=band)
    assert len(full.eigenvalues) == len(other.eigenvalues)
    K = [(1.0, rotor.part.K), (lambda speed: speed**2, rotor.centrifugal)]
    family = fs.Affine(rotor.part.M, [("speed", rotor.gyroscopic)], K).reduced(still.V)
    lam = fs.complex_modes(family.at(speed=250.0), band=band).eigenvalues
    assert np.allclose(np.sort(lam.imag), np.sort(other.eigenvalues.imag), rtol=1e-9)
    assert np.allclose(np.sort(full.eigenvalues.imag), np.sort(other.eigenvalues.imag), rtol=1e-3)


def test_at_rest_nothing_has_changed() -> None:
    rotor = disc(12)[1]
    still = rotor.at(0.0)
    assert abs(still.K - rotor.part.K).max() == 0 and abs(still.D - rotor.part.D).max() == 0
    assert repr(rotor) == "Rotor 'annulus': 252 DOF, turns about (0, 0, 1)"


def test_the_shipped_brake_fits_together() -> None:
    """The disc is round, the linings lie on it within its tracks, on either side, and the bricks do not match."""
    mesh = fs.read_mesh(MESHES / "brake-disc.vtu")
    iron = fs.Material(1.1e11, 0.26, 7200.0)
    rotor = fs.rotating(fs.solid(mesh, iron, supports=["hub"]), mesh, iron)
    assert rotor.part.size == 3 * (len(mesh.points) - len(mesh.nodes("hub")))
    for side, z in (("inboard", -0.006), ("outboard", 0.006)):
        pad = fs.read_mesh(MESHES / f"brake-{side}.vtu")
        face, track = pad.points[pad.nodes("face")], mesh.points[mesh.nodes(side)]
        assert np.allclose(face[:, 2], z, rtol=0, atol=1e-12) and np.allclose(track[:, 2], z, rtol=0, atol=1e-12)
        radius, outer = np.hypot(face[:, 0], face[:, 1]), np.hypot(track[:, 0], track[:, 1])
        assert outer.min() < radius.min() and radius.max() < outer.max()
        assert np.abs(face[:, None] - track).max(axis=2).min(axis=1).max() > 1e-3
        assert np.abs(pad.points[pad.nodes("back"), 2]).min() > 0.0219
        # every node lies on a circle of the grid, also in the middle of an edge
        assert len(np.unique(np.hypot(pad.points[:, 0], pad.points[:, 1]).round(9))) == 9


def test_rings_of_two_materials_may_turn_but_not_two_halves() -> None:
    mesh = fs.annulus(0.05, 0.15, 0.01, (2, 12, 1))
    x = mesh.points[mesh.cells].mean(axis=1)
    ring = {"core": np.hypot(x[:, 0], x[:, 1]) < 0.1, "rim": np.hypot(x[:, 0], x[:, 1]) > 0.1}
    halves = {"core": x[:, 1] < 0, "rim": x[:, 1] > 0}
    materials = {"core": STEEL, "rim": fs.Material(1.1e11, 0.26, 7850.0)}
    mixed = fs.Mesh(mesh.points, mesh.cells, mesh.kind, mesh.sets, {name: np.flatnonzero(one) for name, one in ring.items()})
    assert fs.rotating(fs.solid(mixed, materials), mixed, materials).gyroscopic.nnz
    mixed = fs.Mesh(mesh.points, mesh.cells, mesh.kind, mesh.sets, {name: np.flatnonzero(one) for name, one in halves.items()})
    with pytest.raises(fs.InputError, match=r"not round about the axis: .* of the material"):
        fs.rotating(fs.solid(mixed, materials), mixed, materials)


def test_supports_at_three_bolts_are_told() -> None:
    mesh = fs.annulus(0.05, 0.15, 0.01, (1, 12, 1))
    inner = mesh.nodes("inner")
    angle = np.arctan2(mesh.points[inner, 1], mesh.points[inner, 0])
    mesh = mesh.with_sets(bolts=inner[np.abs(np.sin(1.5 * angle)) < 1e-6])
    with pytest.warns(fs.FemsubWarning, match=r"\d\d% of the displacement .* is along the circumference"):
        fs.rotating(fs.solid(mesh, STEEL, supports=["bolts"]), mesh, STEEL)


def ring(**given: Any) -> fs.Rotor:
    mesh = fs.annulus(0.05, 0.15, 0.01, (1, 24, 1), "hexahedron")
    arguments = {"part": fs.solid(mesh, STEEL), "mesh": mesh, "material": STEEL} | given
    return fs.rotating(**arguments)


def cube(cells: int) -> dict[str, Any]:
    mesh = fs.block((1.0, 1.0, 1.0), (cells, cells, 1), "hexahedron")
    return {"part": fs.solid(mesh, STEEL), "mesh": mesh, "centre": (0.5, 0.5, 0.0)}


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: ring(axis="x"), "not round about the axis"),
    (lambda: ring(**cube(8)), "not round about the axis"),
    (lambda: ring(axis=(0.0, 0.1, 1.0)), "not balanced|not round"),
    (lambda: ring(centre=(0.01, 0.0, 0.0)), "not balanced|not round"),
    (lambda: ring(axis=(0.0, 0.0, 0.0)), "axis must be 'x', 'y', 'z' or three numbers"),
    (lambda: ring(axis="r"), "axis"),
    (lambda: ring(centre=(0.0, 0.0)), "centre must be three numbers"),
    (lambda: ring(material=fs.Material(2.1e5, 0.3, 7.85e-9)), "the masses of 'annulus' are .* times"),
    (lambda: ring(mesh=fs.annulus(0.05, 0.16, 0.01, (1, 24, 1), "hexahedron")), "from its place in the mesh"),
    (lambda: ring(part=fs.beam(1.0, 4, E=1.0, I=1.0, rho=1.0, A=1.0)), "Beams and plates cannot turn"),
    (lambda: ring(part=fs.chain(4)), "no DOF map"),
    (lambda: ring(mesh=fs.rectangle((1.0, 1.0), (2, 2))), "Only solids can turn"),
    (lambda: ring(part=fs.reduce(ring().part, fs.CraigChang(modes=3))), "full component, but 'annulus' is a ReducedSubstructure"),
    (lambda: ring().at(np.inf), "speed must be a finite number"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED)
def test_what_cannot_turn_is_told(call: Callable[[], Any], message: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=message):
        call()
