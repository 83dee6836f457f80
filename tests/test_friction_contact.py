"""Coulomb friction between surfaces: forces of rigid motions, the turning second body, reduced models, errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.coupling.contacts.friction_contact import contact_points
from femsub.model import family_of
from femsub.model.contact import small_matrices

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
K, MU, P, V, SLOPE = 1e12, 0.4, 2e6, 3.0, -0.05
AREA = 0.1 * 0.05
ABOUT = {"axis": (0, 0, 1), "centre": (0.1, -0.3, 0)}
PLATE = fs.block((0.2, 0.1, 0.02), (5, 3, 2))


def moved(mesh: fs.Mesh, by: tuple[float, float, float]) -> fs.Mesh:
    return dataclasses.replace(mesh, points=mesh.points + by)


def pair(kind: str = "hexahedron", held: bool = True) -> tuple[fs.System, dict[str, fs.Mesh]]:
    """A pad of 0.1 x 0.05 on a plate whose nodes are elsewhere."""
    meshes = {"pad": moved(fs.block((0.1, 0.05, 0.02), (4, 2, 2), kind), (0.05, 0.02, 0.02)), "plate": PLATE}
    parts = {"pad": fs.solid(meshes["pad"], STEEL, interface=["bottom", "top"], rayleigh=(1.0, 1e-8), name="pad"),
             "plate": fs.solid(PLATE, STEEL, supports=["bottom"], interface=["top"], rayleigh=(1.0, 1e-8), name="plate")}
    contact = fs.FrictionContact("pad.bottom", "plate.top", meshes, K, MU, direction=(1, 0, 0))
    return fs.couple(parts, [contact, *([fs.Spring(("pad", "top"), stiffness=1e6)] if held else [])]), meshes


def rubbing(meshes: Any, **changed: Any) -> fs.FrictionContact:
    way = {} if "axis" in changed else {"direction": (1.0, 0, 0)}
    return fs.FrictionContact("pad.bottom", "plate.top", meshes, **{"stiffness": K, "mu": MU, **way, **changed})


def motion(system: fs.System, **u: Any) -> np.ndarray:
    """The system's coordinates for displacement fields u(x) of its parts; 0 where none is given."""
    found = {}
    for name, part in system.parts.items():
        field = u.get(name, lambda x: np.zeros_like(x))(part.dofs.points)
        found[name] = field[np.arange(part.size), part.dofs.components]
    return system.collected(found)


def resultant(system: fs.System, force: np.ndarray, part: str, moment: bool = False) -> np.ndarray:
    """The sum of a system's generalised force on a part along x, y, z; with moment=True the one about ABOUT."""
    dofs, f = system.parts[part].dofs, system.expand(force)[part]
    vectors = np.zeros((len(f), 3))
    vectors[np.arange(len(f)), dofs.components] = f
    return np.cross(dofs.points - ABOUT["centre"], vectors).sum(axis=0) if moment else vectors.sum(axis=0)


def added(system: fs.System, contact: fs.FrictionContact) -> Any:
    """W C_K Wᵀ by itself: as a difference of two K it would lose digits."""
    W, _, C = small_matrices(system, contact)
    return W @ C @ W.T


def constant(*vector: float) -> Any:
    return lambda x: np.tile(np.array(vector), (len(x), 1))


def turned(x: np.ndarray) -> np.ndarray:
    return np.cross([0.0, 0.0, 1.0], x - ABOUT["centre"])


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10"])
def test_pressing_the_pad_drags_it_along_and_the_plate_back(kind: str) -> None:
    system, meshes = pair(kind)
    pencil = system.linearised(rubbing(meshes))
    force = -(pencil.K - system.K) @ motion(system, pad=constant(0, 0, -1e-6))
    assert resultant(system, force, "pad") == pytest.approx([MU * K * AREA * 1e-6, 0, K * AREA * 1e-6], abs=1e-3)
    assert resultant(system, force, "plate") == pytest.approx([-MU * K * AREA * 1e-6, 0, -K * AREA * 1e-6], abs=1e-3)
    assert np.abs((pencil.K - system.K) @ motion(system, pad=constant(1e-6, 2e-6, 0))).max() < 1e-3  # sliding costs nothing


def test_a_rigid_body_in_place_of_the_second() -> None:
    mesh = fs.block((0.1, 0.05, 0.02), (4, 2, 1))
    pad = fs.solid(mesh, STEEL, supports=["top"], interface=["bottom"])
    pencil = pad.linearised(fs.FrictionContact("bottom", "ground", mesh, K, MU, direction=(0, 2, 0)))
    along = [np.array([label == pad.dofs.labels[k] for k in pad.dofs.components], dtype=float) for label in ("ux", "uy", "uz")]
    force = (pencil.K - pad.K) @ along[2]
    assert [w @ force for w in along] == pytest.approx([0, MU * K * AREA, K * AREA], abs=1.0)


def test_without_friction_the_contact_is_a_bed_of_springs() -> None:
    system, meshes = pair()
    added = (system.linearised(rubbing(meshes, mu=0.0)).K - system.K).toarray()
    assert np.abs(added - added.T).max() <= 1e-12 * np.abs(added).max()
    assert np.linalg.eigvalsh(added)[0] >= -1e-9 * np.abs(added).max()


def test_friction_damps_across_and_a_falling_slope_feeds_along() -> None:
    system, meshes = pair()
    added = system.linearised(rubbing(meshes, pressure=P, speed=V, slope=SLOPE)).D - system.D
    across = resultant(system, -added @ motion(system, pad=constant(0, 1, 0)), "pad")
    along = resultant(system, -added @ motion(system, pad=constant(1, 0, 0)), "pad")
    assert across == pytest.approx([0, -MU * P * AREA / V, 0], rel=1e-9, abs=1e-6)
    assert along == pytest.approx([-SLOPE * P * AREA, 0, 0], rel=1e-9, abs=1e-6)


def test_the_contact_turned_as_a_whole_turns_its_force() -> None:
    """Both bodies turned by φ about the axis: the force of steady sliding turns along, δf = φ e × f0."""
    system, meshes = pair()
    contact = rubbing(meshes, pressure=P, speed=V, **ABOUT)
    alone = replace(contact, speed=None)
    carried = added(system, contact) - added(system, alone)
    unit = fs.FrictionContact("pad.bottom", "plate.top", meshes, 1.0, MU, **ABOUT)
    lift = -added(system, unit) @ motion(system, pad=constant(0, 0, -1))  # N and μT of a pressure of 1
    f0 = P * resultant(system, lift, "pad")
    force = -carried @ motion(system, pad=turned, plate=turned)
    assert np.cross([0, 0, 1], f0)[:2] == pytest.approx(resultant(system, force, "pad")[:2], rel=1e-9)


def test_turning_the_second_body_alone_changes_nothing() -> None:
    """It is the same surface before and after."""
    system, meshes = pair()
    contact = rubbing(meshes, pressure=P, speed=V, slope=SLOPE, **ABOUT)
    carried = added(system, contact) - added(system, replace(contact, speed=None))
    # in the set of the plate's top alone: its bottom is held
    assert np.abs(carried @ motion(system, plate=turned)).max() < 1e-9 * np.abs(carried @ motion(system, pad=turned)).max()


SHIFT, EDGES = np.array([0.1, 0.045, 0.02]), np.array([0.1, 0.05])  # middle of the pad's face, and its sides


def quadratic(a: np.ndarray, turned: bool = False) -> Any:
    """A field of second order in x and y with random coefficients a (3, 5); with turned=True e × (x - c)·∇ of it."""

    def field(x: np.ndarray) -> Any:
        (X, Y), way = ((x - SHIFT)[:, :2] / EDGES).T, np.cross([0, 0, 1], x - ABOUT["centre"])[:, :2] / EDGES
        if turned:
            dX, dY = way.T
            return np.stack([dX, dY, 2 * X * dX, X * dY + Y * dX, 2 * Y * dY], axis=1) @ a.T
        return np.stack([X, Y, X**2, X * Y, Y**2], axis=1) @ a.T
    return field


@pytest.mark.parametrize(("kind", "turning"), [("hexahedron20", False), ("hexahedron20", True), ("tetra10", True)])
def test_it_is_the_derivative_of_coulombs_law(kind: str, turning: bool) -> None:
    """The law with the true direction of v, integrated by a rule of its own; its change by differences."""
    meshes = {"pad": moved(fs.block((0.1, 0.05, 0.02), (4, 2, 1), kind), (0.05, 0.02, 0.02)),
              "plate": fs.block((0.2, 0.1, 0.02), (5, 3, 1), kind)}
    contact = rubbing(meshes, pressure=P, speed=V, slope=SLOPE, **(ABOUT if turning else {}))
    system = fs.couple({name: fs.solid(mesh, STEEL, interface=["bottom", "top"]) for name, mesh in meshes.items()}, [contact])
    W, *small = small_matrices(system, contact)
    rule, weight = np.polynomial.legendre.leggauss(8)
    s = np.stack(np.meshgrid(rule, rule), axis=2).reshape(-1, 2) / 2
    x, w = np.column_stack([s * EDGES, np.zeros(len(s))]) + SHIFT, np.outer(weight, weight).ravel() * EDGES.prod() / 4
    rng = np.random.default_rng(5)
    (u1, u2), (v1, v2), (a1, a2) = rng.standard_normal((3, 2, 3, 5))
    u1[2] = u2[2] = 0.0  # k would hide the terms of p; it is in the tests above

    def power(h: float, moving: bool) -> float:
        """Of the contact's forces under displacements (or velocities) h u, on the fields a."""
        far = V * np.cross([0, 0, 1], x - ABOUT["centre"]) if turning else V * np.tile([1.0, 0, 0], (len(x), 1))
        slide = far + (h * (quadratic(v2)(x) - quadratic(v1)(x)) if moving else 0)
        if turning and not moving:
            slide = slide + V * h * (np.cross([0, 0, 1], quadratic(u1)(x) - quadratic(u2)(x)) + quadratic(u2, turned=True)(x))
        slide[:, 2] = 0.0
        size = np.linalg.norm(slide, axis=1)
        mu = MU + SLOPE * (size - np.linalg.norm(far, axis=1))
        force = P * ((mu / size)[:, None] * slide + [0, 0, 1])
        return float(w @ (force * (quadratic(a1)(x) - quadratic(a2)(x))).sum(axis=1))

    for moving, C, one, two in ((True, small[0], v1, v2), (False, small[1], u1, u2)):
        h = 1e-5
        found = W.T @ motion(system, pad=quadratic(a1), plate=quadratic(a2)) @ C @ (
            W.T @ motion(system, pad=quadratic(one), plate=quadratic(two)))
        assert -found == pytest.approx((power(h, moving) - power(-h, moving)) / (2 * h), rel=1e-5, abs=1e-3)


def test_pads_on_both_sides_are_dragged_along_and_brake_the_disc() -> None:
    meshes = {"over": moved(fs.block((0.1, 0.05, 0.02), (4, 2, 1)), (0.05, 0.02, 0.02)),
              "below": moved(fs.block((0.06, 0.05, 0.02), (2, 2, 1)), (0.1, 0.03, -0.02)), "plate": PLATE}
    parts = {name: fs.solid(mesh, STEEL, interface=["bottom", "top"]) for name, mesh in meshes.items()}
    contacts = [fs.FrictionContact("over.bottom", "plate.top", meshes, K, MU, **ABOUT),
                fs.FrictionContact("below.top", "plate.bottom", meshes, K, MU, **ABOUT)]
    system = fs.couple(parts, contacts)
    pressed = motion(system, over=constant(0, 0, -1e-6), below=constant(0, 0, 1e-6))
    force = -sum(added(system, contact) for contact in contacts) @ pressed
    turning = {name: resultant(system, force, name, moment=True)[2] for name in meshes}
    assert turning["over"] > 0 and turning["below"] > 0
    assert turning["plate"] == pytest.approx(-turning["over"] - turning["below"], rel=1e-9)
    assert resultant(system, force, "below")[2] == pytest.approx(-K * 1e-6 * 0.06 * 0.05, rel=1e-9)


@pytest.mark.slow
def test_sets_kept_as_interface_carry_the_contact_into_reduced_models() -> None:
    system, meshes = pair()
    contact = rubbing(meshes, pressure=P / 100, speed=V, **ABOUT)
    band = (0.0, 1.2e5)
    full = fs.complex_modes(system, contact, band=band)
    found = fs.complex_modes(fs.reduce(system, {name: fs.CraigBampton(30) for name in system.parts}), contact, band=band)
    assert len(found.eigenvalues) == len(full.eigenvalues) == 8
    assert (np.abs(found.eigenvalues - full.eigenvalues) < 5e-3 * np.abs(full.eigenvalues)).all()
    assert sum(full.eigenvalues.real > 0) == sum(found.eigenvalues.real > 0) == 1  # two modes near 76,000 rad/s flutter
    assert fs.complex_modes(system, replace(contact, mu=0.0), band=band).is_stable
    assert not system.linearised(contact).symmetric[2]
    dense = system.linearised(contact).dense()
    lower = -np.linalg.solve(dense.M, np.hstack([dense.K, dense.D]))
    values = np.linalg.eigvals(np.vstack([np.eye(system.size, 2 * system.size, system.size), lower]))
    for value in full.eigenvalues:
        assert np.abs(values - value).min() < 1e-6 * np.abs(value)


def test_a_part_that_only_the_contact_holds_is_a_part_of_the_system() -> None:
    assert set(pair(held=False)[0].parts) == {"pad", "plate"}
    system, _ = pair()
    with pytest.raises(fs.InputError, match="'plate' is joined to nothing"):
        fs.couple(system.parts, [fs.Spring(("pad", "top"), stiffness=1e6)])


@pytest.mark.parametrize(("changed", "message"), [
    ({"mu": -0.1}, "mu must not be negative"),
    ({"pressure": -1.0}, "pressure must not be negative"),
    ({"stiffness": 0.0}, "stiffness must be positive"),
    ({"direction": None}, "either direction"),
    ({"axis": (0, 0, 1)}, "either direction"),
    ({"direction": (0, 0, 0)}, "direction must be three numbers"),
    ({"speed": 0.0}, "speed must be positive"),
    ({"direction": (0, 0, 1)}, "does not slide along the surface"),
    ({"first": "pad.left"}, "interface set"),
    ({"second": "plate.bottom"}, "unknown interface set"),
    ({"second": "disc.top"}, "unknown interface set"),
    ({"meshes": {"plate": PLATE}}, "mesh of the part"),
])
def test_what_cannot_rub_is_refused(changed: dict[str, Any], message: str) -> None:
    system, meshes = pair()
    given = {"first": "pad.bottom", "second": "plate.top", "meshes": meshes, "stiffness": K, "mu": MU, "direction": (1, 0, 0)}
    with pytest.raises(fs.InputError, match=message):
        system.linearised(fs.FrictionContact(**{**given, **changed}))


def test_surfaces_that_lie_apart_or_look_the_same_way_are_refused() -> None:
    system, meshes = pair()
    with pytest.raises(fs.InputError, match=r"they are at least 0\.01 apart"):
        system.linearised(rubbing({**meshes, "pad": moved(meshes["pad"], (0, 0, 0.01))}))
    below = {**meshes, "pad": moved(meshes["pad"], (0, 0, -0.02))}  # its top lies on the plate's
    with pytest.raises(fs.InputError, match="do not face each other"):
        system.linearised(replace(rubbing(below), first="pad.top"))


def test_a_surface_that_reaches_beyond_the_second_is_told() -> None:
    system, meshes = pair()
    beside = {**meshes, "pad": moved(meshes["pad"], (0.07, 0, 0))}  # 20 of its 100 mm are beside the plate
    contact = rubbing(beside)
    words = r"only 80 % of pad\.bottom lies on plate\.top .* 20 % of its area of 0\.005 has no partner"
    with pytest.warns(fs.PortWarning, match=words):
        parts = {"pad": fs.solid(beside["pad"], STEEL, interface=["bottom"]), "plate": system.parts["plate"]}
        joined = fs.couple(parts, [contact])
    with pytest.warns(fs.PortWarning, match="only 80 %"):
        assert added(joined, contact).sum() != 0
    disc = fs.annulus(0.05, 0.15, 0.01, (2, 12, 1), "hexahedron20")  # curved faces, which have straight edges here
    same = moved(disc, (0, 0, np.ptp(disc.points[:, 2])))
    assert contact_points((same, "bottom", "a"), (disc, "top", "b"), None).share == pytest.approx(1.0, rel=1e-9)


def test_smooth_tractions_on_a_patch_have_their_resultants() -> None:
    mesh = moved(fs.block((0.1, 0.05, 0.02), (4, 2, 2), "hexahedron20"), (0.05, 0.02, 0.0))
    pad = fs.solid(mesh, STEEL, interface=["bottom"])
    loads = fs.FrictionContact("bottom", "ground", mesh, K, MU, direction=(1, 0, 0)).patch_loads(pad, 2)
    u, places = 2 * (pad.dofs.points[:, 0] - 0.1) / 0.1, pad.dofs.components
    work = np.stack([np.where(places == 2, power, 0.0) @ loads for power in (np.ones_like(u), u, u**2)])
    along = np.where(places == 0, 1.0, 0.0) @ loads
    assert loads.shape == (pad.size, 12)  # six polynomials, along n = z and t = x
    g = AREA / 3 / abs(work[1, 1])  # where the outermost points are, of half the length: there the polynomials are ±1
    exact = AREA * np.array([[1, 0, (1 / g**2 - 1) / 2], [0, 1 / (3 * g), 0], [1 / 3, 0, (3 / (5 * g**2) - 1 / 3) / 2]])
    sign = [1, np.sign(work[1, 1]), 1]  # the sense of the axis is open
    assert 0.9 < g <= 1
    np.testing.assert_allclose(work[:, :3] * sign, exact, atol=1e-12 * AREA)  # of 1, P₁(u), P₂(u)
    assert np.abs(work[:, [3, 4]]).max() < 1e-12 * AREA  # of v, uv
    assert along[6] == pytest.approx(AREA) and np.abs(work[:, 6:]).max() + np.abs(along[:6]).max() < 1e-12 * AREA


def test_an_axis_oblique_to_the_surface_is_told() -> None:
    system, meshes = pair()
    small_matrices(system, rubbing(meshes, **ABOUT))  # a warning would be an error
    tilted = {**ABOUT, "axis": (0, np.sin(0.1), np.cos(0.1))}
    with pytest.warns(fs.PortWarning, match=r"axis \(0, 0.09983, 0.995\) is oblique to pad.bottom: 5.73 degrees from"):
        small_matrices(system, rubbing(meshes, **tilted))
    ring = fs.annulus(0.05, 0.1, 0.02, (2, 24, 1))  # its faces at the bore are flat, and the bore is round
    part = fs.solid(ring, STEEL, interface=["inner"])
    small_matrices(part, fs.FrictionContact("inner", "ground", ring, K, MU, axis=(0, 0, 1)))
    with pytest.warns(fs.PortWarning, match=r"oblique to inner: 1\d% of the velocity"):
        small_matrices(part, fs.FrictionContact("inner", "ground", ring, K, MU, axis=(0, 0, 1), centre=(0.01, 0, 0)))


@pytest.mark.slow
@pytest.mark.parametrize("way", [{"direction": (1.0, 0, 0)}, {"axis": (0, 0, 1.0), "centre": (0.1, -0.3, 0)}])
def test_it_is_affine_in_what_it_declares_and_in_nothing_else(way: dict[str, Any]) -> None:
    """C at three values of each number: on a straight line where it says so, off it by more than rounding where not."""
    system, meshes = pair()
    for speed, mu in ((None, MU), (V, MU), (V, 0.0)):
        contact = rubbing(meshes, pressure=P / 100, speed=speed, slope=-0.1, **way | {"mu": mu})
        for name in ("mu", "stiffness", "pressure", "slope", "speed"):
            ends = np.array([1.0, 2.0, 4.0]) * (getattr(contact, name) or 1.0)
            at = [small_matrices(system, replace(contact, **{name: value}))[1:] for value in ends]
            straight = True
            for C in zip(*at, strict=True):
                first, middle, last = (one.toarray() if hasattr(one, "toarray") else np.array(one) for one in C)
                straight &= bool(np.abs(middle - (2 * first + last) / 3).max() <= 1e-10 * np.abs(last).max(initial=1e-300))
            assert straight == (name in contact.affine) or (name == "speed" and speed is None), name


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("names", "terms"), [
    (["mu", "speed"], (2, 3)), (["stiffness", "mu"], (2, 4)), (["slope", "speed"], (3, 2)), (["pressure", "speed", "mu"], (3, 4)),
    (["stiffness", "mu", "pressure", "slope", "speed"], (3, 5))])
def test_it_is_a_sum_of_products_of_its_numbers(names: list[str], terms: tuple[int, int]) -> None:
    """K = K₀ + k N + kμ T - μp S + μ'pΩ R and D = D₀ + μ'p T + μp/Ω S, at random numbers against the contact itself."""
    system, meshes = pair()
    contact = rubbing(meshes, pressure=P, speed=V, slope=SLOPE, **ABOUT)
    box = {"mu": (0.0, 0.7), "speed": (1.0, 9.0), "stiffness": (K / 10, 2 * K), "slope": (-0.1, 0.0), "pressure": (0.0, P)}
    family = family_of(system, contact, names, box)
    assert (len(family.D), len(family.K)) == terms
    rng = np.random.default_rng(2)
    for _ in range(3):
        p = {name: float(rng.uniform(*box[name])) for name in names}
        found, exact = family.at(**{name: p[name] for name in family.parameters}), system.linearised(replace(contact, **p))
        for name in "DK":
            A = getattr(exact, name) - getattr(system, name)
            assert abs(getattr(found, name) - getattr(exact, name)).max() <= 1e-12 * abs(A).max()
    assert family.factor_ranges({name: box[name] for name in family.parameters})[2].all()


def test_a_contact_keeps_its_matrices_and_not_its_shape_functions() -> None:
    system, meshes = pair()
    added(system, rubbing(meshes))
    points = contact_points((meshes["pad"], "bottom", "pad.bottom"), (meshes["plate"], "top", "plate.top"), None)
    assert len(points.terms) == 1  # those of this system: it is the same pair of surfaces
    assert not {"shapes", "J"} & {*vars(points.first), *vars(points.second)} and "normal" not in vars(points)


def test_contacts_on_the_same_surfaces_do_not_share_their_directions() -> None:
    mesh = fs.block((0.1, 0.05, 0.02), (2, 1, 1), "hexahedron")
    pad = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["top"], interface=["bottom"])

    def added(way: tuple[float, ...], mu: float) -> np.ndarray:
        contact = fs.FrictionContact("bottom", "ground", mesh, 1e12, mu, direction=np.array(way))
        return np.asarray((pad.linearised(contact).K - pad.K).toarray())

    along, across, half = added((1.0, 0, 0), 0.4), added((0, 1.0, 0), 0.4), added((1.0, 0, 0), 0.2)
    assert np.abs(along - across).max() > 0.01 * np.abs(along).max()
    np.testing.assert_allclose(half, (along + added((1.0, 0, 0), 0.0)) / 2, atol=1e-12 * np.abs(along).max())


def resting(springs: Sequence[str] = (), free: bool = False) -> tuple[fs.System, fs.FrictionContact]:
    """A pad on a slide that moves along x. Springs hold means of sets of the pad; the slide may be free to move along x."""
    steel = fs.Material(2.1e11, 0.3, 7850.0)
    meshes = {"pad": moved(fs.block((0.04, 0.04, 0.01), (2, 2, 1), "hexahedron"), (0.03, 0.0, 0.01)),
              "slide": fs.block((0.1, 0.04, 0.01), (3, 1, 2), "hexahedron")}
    pad = fs.solid(meshes["pad"], steel, interface=["bottom"], rayleigh=(10.0, 1e-7),
                   ports={f"{place}-{axis}": (place, axis) for place in ("left", "right", "top") for axis in "xyz"})
    slide = fs.solid(meshes["slide"], steel, supports={"bottom": "yz" if free else "xyz"}, interface=["top"],
                     rayleigh=(10.0, 1e-7))
    contact = fs.FrictionContact("pad.bottom", "slide.top", meshes, 1e12, 0.4, direction=(1, 0, 0))
    held = [fs.Spring(("pad", f"{place}-{axis}"), "ground", stiffness=1e8) for place in springs for axis in "xyz"]
    return fs.couple({"pad": pad, "slide": slide}, [contact, *held]), contact


@pytest.mark.parametrize(("springs", "words"), [((), "2 rigid motions"), (("top",), "turning in the plane of the contact")])
def test_a_part_that_friction_pushes_must_be_held(springs: Sequence[str], words: str) -> None:
    """Its rigid motions have λ = 0. Of a reduced model rounding made them grow, and a critical value was sought without end."""
    system, contact = resting(springs)
    left = 3 - 2 * len(springs)
    for model in (system, fs.reduce(system, fs.ContactModes(8, contacts=contact)),
                  fs.reduce(system, {"pad": fs.CraigChang(6), "slide": fs.CraigBampton(4)}, ports=True)):
        limit = min(model.cutoff, 1e5)
        for ask in (lambda: fs.complex_modes(model, contact, band=(0.0, limit)),  # noqa: B023
                    lambda: fs.complex_modes(model, contact, count=8),  # noqa: B023
                    lambda: fs.critical_value(model, contact, "mu", between=(0.0, 0.6), band=(0.0, limit))):  # noqa: B023
            with pytest.raises(fs.InputError, match=f"the part 'pad' is not supported against {words}"):
                ask()
        without = fs.complex_modes(model, replace(contact, mu=0.0), band=(0.0, limit))  # it may slide where nothing pushes it
        assert without.is_stable is not False and without.rigid.sum() == left
        assert not fs.complex_modes(model, contact, band=(10.0, limit)).rigid.any()  # its elastic modes alone


@pytest.mark.parametrize("free", [False, True])
def test_what_is_held_or_is_the_sliding_itself_is_not_refused(free: bool) -> None:
    system, contact = resting(("left", "right"), free)
    for model in (system, fs.reduce(system, fs.ContactModes(8, contacts=contact))):
        for mu in (0.0, 0.4):
            modes = fs.complex_modes(model, replace(contact, mu=mu), band=(0.0, min(model.cutoff, 1e5)))
            assert modes.is_stable is True and modes.rigid.sum() == free, modes
    rom = fs.reduce(system, fs.ContactModes(8, contacts=contact))
    if free:
        with pytest.raises(fs.InputError, match="floats"):
            fs.critical_value(rom, contact, "mu", between=(0.0, 0.6), band=(0.0, rom.cutoff))
    else:
        assert fs.critical_value(rom, contact, "mu", between=(0.0, 0.6), band=(0.0, rom.cutoff)).value == np.inf
