"""A surface joined with one node: rigid motion stays free, a rigid surface moves as one, an averaged one stays soft."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from test_coupling import HOW, elastic

import femsub as fs

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
SIX = ("ux", "uy", "uz", "rx", "ry", "rz")


def hub(mass: float, where: tuple[float, float, float], labels: tuple[str, ...] = SIX) -> fs.Substructure:
    """A body of no extent with the motions named, all of them interface."""
    count = len(labels)
    inertia = [mass if label.startswith("u") else mass * 1e-3 for label in labels]
    return fs.Substructure(sp.diags_array(inertia), sp.csr_array((count, count)), interface={"node": range(count)}, name="hub",
                           dofs=fs.DofMap([1] * count, range(count), labels, np.tile(where, (count, 1))))


def bar(how: str = "full") -> fs.Substructure:
    mesh = fs.block((0.3, 0.1, 0.1), (3, 2, 2), "hexahedron")
    return HOW[how](fs.solid(mesh, STEEL, interface=["left", "right"], name="bar"))


@pytest.mark.parametrize("how", ["full", "craig-bampton", "craig-chang"])
@pytest.mark.parametrize("joint", [fs.Averaged, fs.Kinematic])
def test_rigid_motion_stays_free_and_the_node_moves_with_the_surface(joint: type, how: str) -> None:
    part = bar(how)
    system = fs.couple({"hub": hub(0.5, (0.35, 0.05, 0.02)), "bar": part}, [joint(("hub", "node"), ("bar", "right"))])
    modes = fs.normal_modes(system, count=2)
    assert modes.rigid == 6 and modes.frequencies[6] > 0
    assert system.size == part.size + (6 - 27 if joint is fs.Kinematic else 0)
    u = system.expand(modes.shapes)
    dofs = bar().dofs.kept(bar().interface[bar().sets["right"]])
    moved = u["bar"][bar().interface[bar().sets["right"]]]
    r = dofs.points[::3] - [0.35, 0.05, 0.02]
    follow = u["hub"][None, :3] + np.cross(u["hub"].T[None, :, 3:], r[:, None, :]).transpose(0, 2, 1)
    size = np.abs(moved).max(axis=0)
    columns = slice(None) if joint is fs.Kinematic else slice(6)  # on average in elastic motion, exactly in rigid motion
    assert (np.abs(follow.reshape(-1, 8) - moved)[:, columns] / size[columns]).max() < 1e-8
    np.testing.assert_allclose(follow.mean(axis=0), moved.reshape(-1, 3, 8).mean(axis=0), atol=1e-8 * size.max())


def test_an_average_holds_nothing_and_a_rigid_surface_stiffens() -> None:
    light, where = 1e-9, (0.3, 0.05, 0.05)
    bare = np.sqrt(elastic(bar())[6:12])
    parts = {"hub": hub(light, where), "bar": bar()}
    soft, stiff = (np.sqrt(elastic(fs.couple(parts, [joint(("hub", "node"), ("bar", "right"))]))[6:12])
                   for joint in (fs.Averaged, fs.Kinematic))
    np.testing.assert_allclose(soft, bare, rtol=1e-6)
    assert (stiff > bare * (1 - 1e-9)).all() and stiff[-1] > 1.001 * bare[-1]


def test_a_force_on_the_node_has_its_resultant_and_its_moment_on_the_surface() -> None:
    where = np.array([0.35, 0.08, 0.01])
    link = fs.Averaged(("hub", "node"), ("bar", "right"), weights=np.repeat(np.linspace(1, 2, 9), 3)).link(
        {"hub": hub(1.0, tuple(where)), "bar": bar()})
    mean = -link.equations["bar"].toarray()[:, bar().sets["right"]]
    points = bar().interface_dofs.points[bar().sets["right"]][::3]
    for k, load in enumerate(np.eye(6)):
        forces = (mean.T @ load).reshape(-1, 3)
        np.testing.assert_allclose(forces.sum(axis=0), load[:3], atol=1e-9, err_msg=SIX[k])
        np.testing.assert_allclose(np.cross(points - where, forces).sum(axis=0), load[3:], atol=1e-9, err_msg=SIX[k])


def test_the_mean_is_the_rigid_motion_nearest_by_weighted_squares() -> None:
    weights, where = np.random.default_rng(2).uniform(1, 5, 27), np.array([0.35, 0.08, 0.01])
    link = fs.Averaged(("hub", "node"), ("bar", "right"), weights=weights).link({"hub": hub(1.0, tuple(where)), "bar": bar()})
    mean = -link.equations["bar"].toarray()[:, bar().sets["right"]]
    u = np.random.default_rng(3).standard_normal(27)
    t, theta = np.split(mean @ u, 2)
    r = bar().interface_dofs.points[bar().sets["right"]][::3] - where
    rest = (weights * (u - (t + np.cross(theta, r)).ravel())).reshape(-1, 3)
    np.testing.assert_allclose(rest.sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.cross(r, rest).sum(axis=0), 0.0, atol=1e-9)


def test_a_beam_ends_in_a_hub_with_its_slope() -> None:
    beam = fs.beam(1.0, 6, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, supports={"left": "clamped"}, interface=["right"])
    body = hub(2.0, (1.2, 0.0, 0.0), ("uz", "ry"))
    system = fs.couple({"beam": beam, "hub": body}, [fs.Kinematic(("hub", "node"), ("beam", "right"))])
    u = system.expand(np.eye(system.size))
    np.testing.assert_allclose(u["beam"][-1], -u["hub"][1])  # w,x = -θ_y
    np.testing.assert_allclose(u["beam"][-2], u["hub"][0] + 0.2 * u["hub"][1], atol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_long_arms_keep_the_joint_sparse_in_any_unit(scale: float) -> None:
    mesh = fs.block((0.3 * scale, 0.1 * scale, 0.1 * scale), (3, 2, 2), "hexahedron")
    part = fs.solid(mesh, fs.Material(2.1e11 * scale**-2, 0.3, 7850.0 * scale**-4), interface=["right"])
    body = hub(1.0, (8.0 * scale, 0.0, 0.0))
    system = fs.couple({"hub": body, "bar": part}, [fs.Kinematic(("hub", "node"), ("bar", "right"))])
    # the coordinates of the hub, and those of the bar that do not follow it, as they were
    assert np.count_nonzero(np.diff(system.L[-part.size:].indptr) == 1) >= part.size - 27
    assert sorted(np.diff(sp.csc_array(system.L[:6]).indptr))[-6:] == [1] * 6


def test_a_plate_turns_as_one_with_a_hub() -> None:
    plate = fs.plate(fs.rectangle((1.0, 0.5), (4, 2)), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, interface=["right"])
    body = hub(2.0, (1.2, 0.25, 0.0), ("uz", "rx", "ry"))
    system = fs.couple({"plate": plate, "hub": body}, [fs.Kinematic(("hub", "node"), ("plate", "right"))])
    assert system.size == plate.size - 12 + 3 and fs.normal_modes(system, count=2).rigid == 3
    motion = system.expand(np.eye(system.size))
    at = plate.dofs.find(plate.dofs.nodes[plate.interface[0]])
    w, x, y, twist = (motion["plate"][at[list(plate.dofs.labels).index(label)]] for label in ("w", "w,x", "w,y", "w,xy"))
    uz, rx, ry = motion["hub"]
    np.testing.assert_allclose(w, uz - 0.25 * rx + 0.2 * ry, atol=1e-12)
    for found, wanted in ((x, -ry), (y, rx), (twist, 0 * rx)):
        np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize(("joint", "words"), [
    (fs.Kinematic(("three", "node"), ("bar", "right")), "three.node does not determine ux at node .* of 'bar'"),
    (fs.Averaged(("hub", "node"), ("bar", [0, 1, 2])), "does not determine rx at node 1 of 'hub'"),
    (fs.Averaged(("hub", "node"), ("bar", "right"), weights=(1.0,)), "weights must be 27 numbers"),
    (fs.Kinematic(("bar", "left"), ("hub", "node")), "bar.left must be one node, but its DOF belong to 9"),
    (fs.Kinematic(("chain", [0]), ("bar", "right")), r"the DOF of chain\[0\] have no known places"),
])
def test_what_has_no_rigid_motion_is_told(joint: object, words: str) -> None:
    parts = {"hub": hub(1.0, (0.3, 0, 0)), "three": hub(1.0, (0.3, 0, 0), ("ux", "uy", "uz")), "bar": bar(), "chain": fs.chain(3)}
    with pytest.raises(fs.InputError, match=words):
        fs.couple(parts, [joint])
