"""A point with six motions, beams in space, and joints of directions that do not agree."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import femsub as fs
from femsub.model.dof_map import way_of

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
TUBE = {"E": 2.1e11, "G": 8.1e10, "rho": 7850.0, "A": 5e-4, "J": 2.5e-7}
I_Y, I_Z = 1e-7, 3e-7


def rotation(rng: np.random.Generator) -> np.ndarray:
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else -Q


def frequencies(model: fs.Substructure, count: int) -> np.ndarray:
    return fs.normal_modes(model, count=count).frequencies[:count]


def solved(model: fs.Substructure, port: str) -> np.ndarray:
    """Static displacements under a unit force on a port."""
    return np.linalg.solve(np.asarray(model.K.todense()), model.ports[port])


# nodes


def test_a_node_is_a_rigid_body_at_its_place() -> None:
    rng = np.random.default_rng(3)
    L = rng.normal(size=(3, 3))
    hub = fs.node((1.0, 2.0, 3.0), 2.0, L @ L.T, ports={"torque": "rz"}, name="hub")
    assert hub.dofs.labels == ("ux", "uy", "uz", "rx", "ry", "rz") and (hub.dofs.points == [1.0, 2.0, 3.0]).all()
    np.testing.assert_allclose(hub.M.toarray(), np.block([[2.0 * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), L @ L.T]]))
    assert hub.K.nnz == 0 and hub.ports["torque"].tolist() == [0, 0, 0, 0, 0, 1] and hub.sets["node"].tolist() == list(range(6))
    np.testing.assert_allclose(fs.node((0, 0, 0), 1.0, 0.5).M.diagonal(), [1, 1, 1, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(fs.node((0, 0, 0), 1.0, (1, 2, 3)).M.diagonal(), [1, 1, 1, 1, 2, 3])


@pytest.mark.parametrize("joint", [fs.Kinematic, fs.Averaged])
def test_a_node_without_mass_changes_nothing_but_what_it_joins(joint: type) -> None:
    bar = fs.solid(fs.block((0.3, 0.1, 0.1), (3, 2, 2)), STEEL, supports=["left"], interface=["right"])
    tip = (0.3, 0.05, 0.05)
    bare = fs.couple({"bar": bar, "tip": fs.node(tip)}, [joint(("tip", "node"), ("bar", "right"))])
    if joint is fs.Averaged:
        np.testing.assert_allclose(frequencies(bare, 4), frequencies(bar, 4), rtol=1e-8)
    else:
        assert (frequencies(bare, 4) >= frequencies(bar, 4) * (1 - 1e-9)).all()
    # a mass on the node is one on a second node that is fixed to it, and by stiff springs nearly so
    loaded = fs.couple({"bar": bar, "tip": fs.node(tip, 5.0, 0.02)}, [joint(("tip", "node"), ("bar", "right"))])
    parts = {"bar": bar, "tip": fs.node(tip), "hub": fs.node(tip, 5.0, 0.02)}
    links = (fs.Rigid(("tip", "node"), ("hub", "node")), fs.Spring(("tip", "node"), ("hub", "node"), stiffness=1e14))
    for link, close in zip(links, (1e-9, 1e-4), strict=True):
        two = fs.couple(parts, [joint(("tip", "node"), ("bar", "right")), link])
        np.testing.assert_allclose(frequencies(two, 4), frequencies(loaded, 4), rtol=close)


@pytest.mark.parametrize(("given", "words"), [
    ({"point": (0, 0)}, r"point must be three numbers"), ({"point": "origin"}, "point"),
    ({"mass": -1.0}, "mass must not be negative"), ({"inertia": (1.0, 2.0)}, "one number, three, or a matrix"),
    ({"inertia": (1.0, -2.0, 1.0)}, "must not be negative about any axis"),
    ({"inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "inertia must be symmetric"),
    ({"ports": {"load": "u"}}, r"port 'load': unknown motion 'u'")])
def test_what_is_no_node_is_refused(given: dict, words: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        fs.node(**{"point": (0.0, 0.0, 0.0), **given})


def test_a_point_without_mass_must_be_joined() -> None:
    with pytest.raises(fs.SingularMatrixError, match="neither mass nor stiffness: ux at node 1"):
        fs.normal_modes(fs.node((0, 0, 0)), count=1)
    with pytest.raises(fs.InputError, match="M has no mass at all"):  # but a K alone is a mistake
        fs.Substructure(np.zeros((2, 2)), np.eye(2))


# directions


def beam() -> fs.Substructure:
    return fs.beam(1.0, 8, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, supports={"left": "clamped"}, interface=["right"])


JOINTS: list[Callable] = [fs.Rigid, lambda a, b: fs.Spring(a, b, stiffness=1.0)]


@pytest.mark.parametrize("joint", JOINTS)
def test_lists_of_dof_of_other_directions_are_refused(joint: Callable) -> None:
    """w,x is -θ_y: joined as they stand, a beam's end would turn against the node."""
    arm, hub = beam(), fs.node((1.0, 0.0, 0.0), 0.5, 0.01)
    end = arm.interface.tolist()
    for rows, words in (([2, 4], r"w,x at node 9 of 'arm' would meet ry at node 1 of 'hub': w,x = -ry, they turn"),
                        ([4, 2], r"w at node 9 of 'arm' would meet ry at node 1 of 'hub': w and ry are different directions"),
                        ([0, 4], r"w and ux are different directions")):
        with pytest.raises(fs.InputError, match=words + r".* Kinematic and Averaged"):
            fs.couple({"arm": arm, "hub": hub}, [joint(("arm", end), ("hub", rows))])
    joined = fs.couple({"arm": arm, "hub": hub}, [joint(("arm", end[:1]), ("hub", [2]))])  # w is uz
    assert joined.size == arm.size + hub.size - (joint is fs.Rigid)
    turned = fs.Substructure(arm.M, arm.K, interface={"right": end}, name="arm")  # without names nothing is known
    assert fs.couple({"arm": turned, "hub": hub}, [joint(("arm", end), ("hub", [2, 4]))]).size


def test_sets_in_their_order_are_compared_too() -> None:
    one, two = fs.node((0, 0, 0), 1.0, 1.0), fs.node((1, 0, 0), 1.0, 1.0)
    odd = fs.Substructure(two.M, two.K, interface={"node": [1, 0, 2, 3, 4, 5]}, dofs=two.dofs)
    assert fs.couple({"a": one, "b": two}, [fs.Rigid(("a", "node"), ("b", "node"), tol=float("inf"))]).size == 6
    with pytest.raises(fs.InputError, match="ux and uy are different directions"):
        fs.couple({"a": one, "b": odd}, [fs.Rigid(("a", "node"), ("b", "node"), tol=float("inf"))])
    plane = fs.Substructure(np.eye(2), np.eye(2), interface={"node": [0, 1]},
                            dofs=fs.DofMap([1, 1], [0, 1], ("uz", "ry"), [[1, 0, 0]] * 2))
    with pytest.raises(fs.InputError, match=r"no DOF of plane.node moves in this way by this name, but w = uz. Join the two by"):
        fs.couple({"arm": beam(), "plane": plane}, [fs.Rigid(("arm", "right"), ("plane", "node"))])


def test_springs_added_between_other_directions_are_refused() -> None:
    hub = fs.node((1.0, 0.0, 0.0), 0.5, 0.01)
    end = beam().interface.tolist()
    system = fs.couple({"arm": beam(), "hub": hub}, [fs.Spring(("hub", [2]), ("arm", end[:1]), stiffness=1.0)],
                       interface=[("arm", "right"), ("hub", "node")])
    with pytest.raises(fs.InputError, match=r"w,x = -ry, they turn about one axis"):
        fs.modified(system, [fs.AddedSpring(("arm", end[1:]), 1.0, to=("hub", [4]))])
    assert fs.modified(system, [fs.AddedSpring(("arm", end[:1]), 1.0, to=("hub", [2]))]).size == system.size


def test_a_plane_beam_and_a_hub_joined_by_kinematic_have_the_right_sign() -> None:
    """A cantilever with a mass at the end of an arm beyond its tip: the sign of the slope decides the frequency."""
    reach, mass = 0.2, 0.5
    hub = fs.Substructure(np.diag([mass, 1e-6]), np.zeros((2, 2)), interface={"node": [0, 1]},
                          dofs=fs.DofMap([1, 1], [0, 1], ("uz", "ry"), [[1.0 + reach, 0, 0]] * 2))
    system = fs.couple({"arm": beam(), "hub": hub}, [fs.Kinematic(("hub", "node"), ("arm", "right"))])
    # with w at the mass w_tip + reach w,x
    K, M = beam().K.toarray(), beam().M.toarray()
    a = np.zeros(len(K))
    a[-2:] = 1.0, reach
    b = np.eye(len(K))[-1]
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(M + mass * np.outer(a, a) + 1e-6 * np.outer(b, b), K)).real.min())
    assert frequencies(system, 1)[0] == pytest.approx(exact, rel=1e-8)


# beams in space


@pytest.mark.parametrize("seed", range(4))
def test_a_turned_beam_bends_as_plane_beams_do_and_stretches_and_twists_as_bars(seed: int) -> None:
    rng = np.random.default_rng(seed)
    Q, n, L = rotation(rng), int(rng.integers(4, 9)), float(rng.uniform(0.5, 2.0))
    ends = rng.normal(size=3) + np.array([[0, 0, 0], [L, 0, 0]]) @ Q.T
    space = fs.space_beam(ends, n, **TUBE, I=(I_Y, I_Z), up=Q[:, 2] + 0.3 * Q[:, 0], supports={"left": "clamped"})
    plane = [fs.beam(L, n, E=2.1e11, rho=7850.0, A=5e-4, I=I, supports={"left": "clamped"}) for I in (I_Y, I_Z)]  # noqa: E741
    turn = np.cos((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * n))
    bars = np.sqrt(6 * (1 - turn) / (2 + turn)) * n / L  # of n linear elements, held at one end
    wave = [np.sqrt(2.1e11 / 7850), np.sqrt(8.1e10 * 2.5e-7 / 7850 / (I_Y + I_Z))]

    def omega(model: fs.Substructure) -> np.ndarray:
        return np.sqrt(np.linalg.eigvals(np.linalg.solve(model.M.toarray(), model.K.toarray())).real)

    exact = np.sort(np.concatenate([*map(omega, plane), *(c * bars for c in wave)]))
    found = np.sort(omega(space))
    np.testing.assert_allclose(found, exact, rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_free_frame_moves_as_a_rigid_body_without_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(4, 3)), axis=0)
    frame = fs.space_beam(points, [2, 3, 1], **TUBE, I=(I_Y, I_Z), up=rng.normal(size=3))
    R = frame.dofs.rigid()
    assert np.abs(frame.K @ R).max() < 1e-12 * np.abs(frame.K).max() * np.abs(R).max()
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    np.testing.assert_allclose((R.T @ frame.M @ R)[:3, :3], 7850 * 5e-4 * length * np.eye(3), atol=1e-9 * length)
    assert fs.normal_modes(frame, count=1).rigid == 6


def test_deflections_of_a_bracket_are_those_of_the_textbook() -> None:
    """An arm along x, one along y at its end: bending of both, torsion of the first; I_y is for bending along `up`."""
    a, b, E, G = 0.7, 0.4, TUBE["E"], TUBE["G"]
    bracket = fs.space_beam([(0, 0, 0), (a, 0, 0), (a, b, 0)], 2, **TUBE, I=(I_Y, I_Z), supports={"left": "clamped"},
                            ports={"down": ("right", "uz"), "along": ("right", "ux"), "corner": ((a, 0, 0), "uy")})
    down, along, corner = (float(bracket.ports[port] @ solved(bracket, port)) for port in ("down", "along", "corner"))
    assert down == pytest.approx((a**3 + b**3) / (3 * E * I_Y) + a * b**2 / (G * TUBE["J"]), rel=1e-9)
    assert along == pytest.approx(a / (E * TUBE["A"]) + b**3 / (3 * E * I_Z) + a * b**2 / (E * I_Z), rel=1e-9)
    assert corner == pytest.approx(a**3 / (3 * E * I_Z), rel=1e-9)
    upright = fs.space_beam([(0, 0, 0), (a, 0, 0)], 1, **TUBE, I=(I_Y, I_Z), up=(0, 1, 0), supports={"left": "clamped"},
                            ports={"tip": ("right", "uz")})
    assert float(upright.ports["tip"] @ solved(upright, "tip")) == pytest.approx(a**3 / (3 * E * I_Z), rel=1e-9)


@pytest.mark.parametrize("joint", [fs.Kinematic, fs.Averaged])
def test_a_beam_goes_on_where_a_solid_ends(joint: type) -> None:
    """Half a solid, half a beam, in any direction: within 0.8 % of one beam, and both planes alike."""
    side, Q = 0.02, rotation(np.random.default_rng(5))
    mesh = fs.block((0.4, side, side), (10, 1, 1), "hexahedron20")
    mesh = fs.Mesh(mesh.points @ Q.T, mesh.cells, mesh.kind, sets=mesh.sets)
    section = {"E": 2.1e11, "G": 2.1e11 / 2.6, "rho": 7850.0, "A": side**2, "I": side**4 / 12, "J": 0.1406 * side**4}
    ends = np.array([(0.4, side / 2, side / 2), (1.0, side / 2, side / 2)]) @ Q.T
    parts = {"solid": fs.solid(mesh, STEEL, supports=["left"], interface=["right"]),
             "beam": fs.space_beam(ends, 15, **section, up=Q[:, 2], interface=["left"])}
    found = frequencies(fs.couple(parts, [joint(("beam", "left"), ("solid", "right"))]), 6)
    line = frequencies(fs.beam(1.0, 30, E=2.1e11, I=side**4 / 12, rho=7850.0, A=side**2, supports={"left": "clamped"}), 3)
    np.testing.assert_allclose(found, np.repeat(line, 2), rtol=8e-3)
    np.testing.assert_allclose(found[::2], found[1::2], rtol=1e-6)


def test_short_elements_are_heard() -> None:
    with pytest.warns(fs.ConditionWarning, match="take longer elements"):
        fs.space_beam([(0, 0, 0), (1, 0, 0)], 1000, **TUBE, I=I_Y)


@pytest.mark.parametrize(("given", "words"), [
    ({"points": [(0, 0, 0)]}, "two or more"), ({"points": [(0, 0, 0), (0, 0, 0)]}, "are the same"),
    ({"points": [(0, 0, 0), (0, 0, 1)]}, "lies along up"), ({"up": (0, 0, 0)}, "up must be three numbers"),
    ({"I": (1.0, 2.0, 3.0)}, r"I must be one number or a pair \(I_y, I_z\)"), ({"I": "x"}, "I"),
    ({"J": 0.0}, "J must be positive"),
    ({"elements": [2, 3]}, "elements must be 1 or more, one number or 1"), ({"elements": 0}, "elements must be at least 1"),
    ({"interface": [(0.3, 0, 0)]}, r"interface: there is no node at"), ({"interface": [0.3]}, r"'left', 'right' or \(x, y, z\)"),
    ({"supports": {"left": "glued"}}, "support 'glued'"), ({"ports": {"p": "left"}}, r"must be a pair \(place, motion\)"),
    ({"ports": {"p": ("left", "w")}}, "motion of port 'p'")])
def test_what_is_no_beam_in_space_is_refused(given: dict, words: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        fs.space_beam(**{"points": [(0, 0, 0), (1, 0, 0)], "elements": 4, **TUBE, "I": I_Y, **given})


def test_directions_are_those_of_rigid_motion() -> None:
    """Names of one direction move alike in every rigid motion, those of opposite senses by the negative."""
    labels = ("ux", "uy", "uz", "w", "rx", "ry", "rz", "w,x", "w,y")
    dofs = fs.DofMap(np.ones(len(labels), dtype=int), np.arange(len(labels)), labels, np.tile([0.3, -0.2, 0.7], (len(labels), 1)))
    R = dofs.rigid(np.array([1.0, 2.0, 3.0]))
    for i, one in enumerate(labels):
        for j, other in enumerate(labels):
            mine, yours = way_of(one), way_of(other)
            assert (mine == yours) == np.array_equal(R[i], R[j])
            assert (mine != yours and mine[:2] == yours[:2]) == (np.array_equal(R[i], -R[j]))
    assert way_of("T1") is None
