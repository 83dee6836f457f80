"""The faces of a surface that lie opposite another one: against a search of every pair of faces, and what takes them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.components.mesh import boundary_faces, corner_nodes

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
KINDS = ("hexahedron", "tetra", "hexahedron20", "tetra10", "hexahedron27")


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation."""
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else Q[:, ::-1]


def put(mesh: fs.Mesh, at: object, Q: np.ndarray | None = None) -> fs.Mesh:
    points = mesh.points + np.array(at)
    return replace(mesh, points=points if Q is None else points @ Q.T)


def overlap(P: np.ndarray, Q: np.ndarray) -> float:
    """The area that two convex polygons share: P is cut by one edge of Q after the other."""
    def area(one: list[np.ndarray]) -> float:
        x, y = np.array(one).T
        return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2

    found, Q = list(P), Q if area(list(Q)) > 0 else Q[::-1]
    for a, b in zip(Q, np.roll(Q, -1, axis=0), strict=True):
        side = [(b - a)[0] * (p - a)[1] - (b - a)[1] * (p - a)[0] for p in found]
        cut = []
        for i, p in enumerate(found):
            after = (i + 1) % len(found)
            cut += [p] if side[i] >= 0 else []
            if side[i] * side[after] < 0:
                cut.append(p + side[i] / (side[i] - side[after]) * (found[after] - p))
        found = cut
        if len(found) < 3:
            return 0.0
    return abs(area(found))


def pair(rng: np.random.Generator, kinds: tuple[str, str], gap: float) -> tuple[dict[str, fs.Mesh], np.ndarray]:
    """A pad that lies askew over a plate, maybe beyond its edge, and how both are turned in space."""
    pad = fs.block((*rng.uniform(0.2, 0.6, 2), 0.1), (*rng.integers(1, 4, 2).tolist(), 1), kinds[0])
    plate = fs.block((1.0, 0.8, 0.1), (*rng.integers(2, 7, 2).tolist(), 1), kinds[1])
    a, Q = rng.uniform(0, 2 * np.pi), rotation(rng)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    pad = put(put(pad, -np.append(pad.points[:, :2].mean(axis=0), 0), turn), (*rng.uniform(0, 0.9, 2), 0.1 + gap))
    return {"pad": put(pad, (0, 0, 0), Q), "plate": put(plate, (0, 0, 0), Q)}, Q


@pytest.mark.parametrize("seed", range(20))
def test_faces_and_coverage_are_those_of_a_search_of_every_pair(seed: int) -> None:
    """Turned meshes of all kinds; every second one is apart by more than a face, which a large tol allows."""
    rng = np.random.default_rng(seed)
    kinds = KINDS[seed % 5], KINDS[int(rng.integers(5))]
    gap = 0.7 if seed % 2 else 0.0
    meshes, Q = pair(rng, kinds, gap)
    seen = []
    for mesh, top in zip(meshes.values(), (False, True), strict=True):
        cells, sides = boundary_faces(mesh)
        flat = (mesh.points @ Q)[corner_nodes(mesh, cells, sides)]
        level = 0.1 if top else 0.1 + gap
        seen.append(flat[np.abs(flat[:, :, 2] - level).max(axis=1) < 1e-9][:, :, :2])
    shared = np.array([[overlap(P, R) for R in seen[1]] for P in seen[0]])
    area = [np.array([overlap(P, P) for P in faces]) for faces in seen]
    met = shared.max(axis=0) > 1e-9
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        found = fs.facing(("pad", "bottom"), "plate", meshes, tol=1.01 * gap or None)
    assert len(found.faces) == met.sum()
    mine = (meshes["plate"].points @ Q)[found.faces[:, :seen[1].shape[1]], :2].mean(axis=1)
    np.testing.assert_allclose(sorted(mine.round(8).tolist()), sorted(seen[1][met].mean(axis=1).round(8).tolist()), atol=1e-7)
    assert found.coverage == pytest.approx((shared.sum() / area[0].sum(), shared.sum() / area[1][met].sum()), rel=1e-9)
    assert found.areas == pytest.approx((area[0].sum(), area[1][met].sum()), rel=1e-9)
    np.testing.assert_array_equal(found.nodes, np.unique(found.faces))
    np.testing.assert_array_equal(found.nodes, found.meshes["plate"].sets[found.second[1]])
    lost = 1 - shared.sum() / area[0].sum()
    assert [one.category for one in heard] == ([fs.PortWarning] if lost > 1e-6 else [])


def disc_and_pad(shift: float = 0.0, kind: str = "hexahedron") -> dict[str, fs.Mesh]:
    """A plate and a pad of 100 x 100 mm on it, `shift` of its 100 mm beyond the plate's edge."""
    disc, pad = fs.block((0.4, 0.2, 0.02), (8, 4, 1), kind, name="disc"), fs.block((0.1, 0.1, 0.01), (3, 3, 1), kind, name="pad")
    return {"disc": disc, "pad": put(pad, (0.12 if not shift else -0.1 * shift, 0.04, 0.02))}


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10"])
def test_ties_contacts_and_interfaces_take_what_was_found(kind: str) -> None:
    meshes = disc_and_pad(kind=kind)
    under = fs.facing(("pad", "bottom"), "disc", meshes)
    assert repr(under).startswith("Facing: 100 % of pad.bottom (area 0.01) and 4")
    if kind == "hexahedron":
        assert repr(under).endswith("4 % of disc.facing-pad-bottom (0.0225; 9 faces, 16 nodes) have a partner")
    parts = {"disc": fs.solid(meshes["disc"], STEEL, supports=["left"], interface=[under]),
             "pad": fs.solid(meshes["pad"], STEEL, supports={"left": "x"}, interface={under: "z"})}
    assert parts["disc"].sets.keys() == {"facing-pad-bottom"} and parts["pad"].sets.keys() == {"bottom"}
    assert len(parts["disc"].interface) == 3 * len(under.nodes)
    assert len(parts["pad"].interface) == len(meshes["pad"].sets["bottom"])  # along z alone
    rubbing = fs.FrictionContact(under, stiffness=1e11, mu=0.3, direction=(1, 0, 0), tol=None)
    named = fs.FrictionContact("pad.bottom", "disc.facing-pad-bottom", under.meshes, 1e11, 0.3, direction=(1, 0, 0))
    parts["pad"] = fs.solid(meshes["pad"], STEEL, interface=under)
    assert repr(rubbing) == repr(named) and rubbing.sets == ("pad.bottom", "disc.facing-pad-bottom")
    system = fs.couple(parts, [rubbing])
    assert abs(rubbing.linearised(system)[1] - named.linearised(system)[1]).max() == 0
    assert replace(rubbing, mu=0.1).mu == 0.1
    tied = fs.couple(parts, [fs.Tied(under)])
    assert tied.size == parts["disc"].size + parts["pad"].size - len(parts["pad"].interface)
    # the faces that were found are all that is needed: the whole top of the disc gives the same system
    other = dict(meshes, disc=meshes["disc"])
    top = {**parts, "disc": fs.solid(meshes["disc"], STEEL, supports=["left"], interface=["top"])}
    whole = fs.couple(top, [fs.Tied(("pad", "bottom"), ("disc", "top"), other)])
    np.testing.assert_allclose(fs.normal_modes(tied, 3).frequencies, fs.normal_modes(whole, 3).frequencies, rtol=1e-9)


def test_the_tolerance_of_what_was_found_is_that_of_the_joint() -> None:
    meshes = disc_and_pad()
    meshes["pad"] = put(meshes["pad"], (0, 0, 0.004))
    with pytest.raises(fs.InputError, match=r"pad.bottom and disc do not face each other: they are 0\.004 apart; .* larger tol"):
        fs.facing(("pad", "bottom"), "disc", meshes)
    under = fs.facing(("pad", "bottom"), ("disc", "top"), meshes, tol=0.005, name="under")
    assert under.second == ("disc", "under") and under.coverage[0] == pytest.approx(1.0)
    assert fs.Tied(under).tol == fs.FrictionContact(under, stiffness=1.0, mu=0.0, direction=(1, 0, 0)).tol == 0.005
    assert fs.Tied(under, tol=0.006).tol == 0.006


def test_one_percent_without_a_partner_is_heard() -> None:
    meshes = disc_and_pad(0.01)
    words = r"only 99\.0 % of pad\.bottom lies on disc.* 1\.0 % of its area of 0\.01 has no partner"
    with pytest.warns(fs.PortWarning, match=words):
        under = fs.facing(("pad", "bottom"), "disc", meshes)
    assert under.coverage == pytest.approx((0.99, 0.0099 / 0.015), rel=1e-9)
    parts = {name: fs.solid(mesh, STEEL, interface=[under]) for name, mesh in meshes.items()}
    with pytest.warns(fs.PortWarning, match=words.replace("disc", "disc.facing-pad-bottom")):
        fs.couple(parts, [fs.FrictionContact(under, stiffness=1e11, mu=0.3, direction=(1, 0, 0))])
    digits = {**disc_and_pad(), "pad": put(disc_and_pad()["pad"], (-0.12 - 2e-7, 0, 0))}  # beyond the edge by a file's last digit
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert fs.facing(("pad", "bottom"), "disc", digits).coverage[0] < 1 - 1e-6


@pytest.mark.parametrize("shift", [0.0, 1e-8, -2e-7])
def test_faces_that_share_an_edge_with_those_met_are_left_out(shift: float) -> None:
    """The pad ends where faces end, but for the last digits of its coordinates."""
    disc, pad = fs.block((0.4, 0.2, 0.02), (8, 4, 1)), fs.block((0.1, 0.1, 0.01), (3, 3, 1))
    found = fs.facing(("pad", "bottom"), "disc", {"disc": disc, "pad": put(pad, (0.1 + shift, 0.05 - shift, 0.02))})
    assert len(found.faces) == 4 and found.coverage == pytest.approx((1.0, 1.0), abs=1e-5)
    np.testing.assert_allclose(disc.points[found.nodes].mean(axis=0), (0.15, 0.1, 0.02))


@pytest.mark.parametrize(("counts", "kind"), [((24, 36), "hexahedron"), ((20, 12), "hexahedron20"), ((11, 9), "hexahedron27")])
def test_a_bolt_in_a_bore_of_another_mesh_is_covered_all_around(counts: tuple[int, int], kind: str) -> None:
    bolt, ring = fs.annulus(0.01, 0.05, 0.1, (1, counts[0], 1), kind), fs.annulus(0.05, 0.1, 0.1, (1, counts[1], 2), kind)
    found = fs.facing(("bolt", "outer"), "ring", {"bolt": bolt, "ring": ring}, tol=0.008)
    assert found.coverage == pytest.approx((1.0, 1.0), abs=1e-3) and len(found.faces) == 2 * counts[1]
    np.testing.assert_array_equal(found.nodes, ring.sets["inner"])
    assert found.areas[1] == pytest.approx(0.1 * counts[1] * 0.1 * np.sin(np.pi / counts[1]), rel=1e-9)


def test_two_surfaces_of_one_part_have_sets_of_their_own() -> None:
    """A clip around a plate faces it from both sides."""
    meshes = disc_and_pad()
    clip = fs.block((0.1, 0.1, 0.1), (2, 2, 10))
    solid = np.setdiff1d(np.arange(len(clip.cells)), _slot(clip))
    clip = put(replace(clip, cells=clip.cells[solid], groups={}), (0.1, 0.05, -0.04))
    meshes = {"disc": meshes["disc"], "clip": clip.with_sets(above=lambda x: _level(x, 0.02), below=lambda x: _level(x, 0.0))}
    both = [fs.facing(("clip", side), "disc", meshes) for side in ("above", "below")]
    disc = fs.solid(meshes["disc"], STEEL, interface=both)
    assert set(disc.sets) == {"facing-clip-above", "facing-clip-below"}
    assert not set(disc.sets["facing-clip-above"]) & set(disc.sets["facing-clip-below"])


def _slot(mesh: fs.Mesh) -> np.ndarray:
    """Cells of the clip between z = 0.04 and 0.06, but for the rear."""
    middle = mesh.points[mesh.cells].mean(axis=1)
    return np.flatnonzero((np.abs(middle[:, 2] - 0.05) < 0.01) & (middle[:, 0] < 0.05))


def _level(x: np.ndarray, z: float) -> np.ndarray:
    return (np.abs(x[:, 2] - z) < 1e-9) & (x[:, 0] < 0.1501)


def test_what_does_not_face_is_refused() -> None:
    meshes = disc_and_pad()
    for first, second, given, words in (
            (("pad", "bottom"), ("disc", "bottom"), {"tol": 0.05}, "outward normals agree"),
            (("pad", "left"), ("disc", "top"), {}, "no face of one lies before a face of the other"),
            (("pad", "botom"), "disc", {}, "first: .*unknown set .*'botom'; did you mean 'bottom'"),
            (("pad", "bottom"), "dics", {}, "unknown mesh of the part 'dics'; did you mean 'disc'"),
            ("pad", "disc", {}, r"first must be \(part, set\)"),
            (("pad", "bottom"), "disc", {"tol": -1.0}, "tol must be positive")):
        with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
            fs.facing(first, second, meshes, **given)
    with pytest.raises(fs.InputError, match="quad cells"):
        fs.facing(("pad", "bottom"), "disc", {**meshes, "disc": fs.rectangle((1.0, 1.0), (2, 2))})
    under = fs.facing(("pad", "bottom"), "disc", meshes)
    with pytest.raises(fs.InputError, match=r"interface: the mesh 'other' is neither that of 'pad' nor that of 'disc'"):
        fs.solid(fs.block((1.0, 1.0, 1.0), (1, 1, 1), name="other"), STEEL, interface=[under])
    taken = meshes["disc"].with_sets(**{under.second[1]: [0, 1]})
    with pytest.raises(fs.InputError, match="has another set 'facing-pad-bottom': give facing a name"):
        fs.solid(taken, STEEL, interface=[under])
    with pytest.raises(fs.InputTypeError, match="give no second and no meshes"):
        fs.Tied(under, ("disc", "top"))
    with pytest.raises(fs.InputTypeError, match="stiffness"):
        fs.FrictionContact(under, mu=0.1, direction=(1, 0, 0))
    with pytest.raises(fs.InputTypeError, match="mu"):
        fs.FrictionContact(under, stiffness=0.1, direction=(1, 0, 0))


def test_a_set_of_single_nodes_is_refused_in_words_of_the_contact() -> None:
    """Nodes near the pad, chosen one by one, complete no faces at the edge; nor do corners without their midside nodes."""
    meshes = disc_and_pad()
    disc = meshes["disc"].with_sets(near=lambda x: (x[:, 2] > 0.019) & (np.abs(x[:, :2] - [0.17, 0.1]) < 0.06).all(axis=1),
                                    ragged=lambda x: (x[:, 2] > 0.019) & ((x[:, 0] < 0.11) | (x[:, 1] < 0.01)))
    for second, words in (("near", None), ("ragged", r"\d+ of the \d+ nodes of the set 'ragged'")):
        rub = fs.FrictionContact("pad.bottom", f"disc.{second}", {**meshes, "disc": disc}, 1e11, 0.3, direction=(1, 0, 0))
        parts = {"pad": fs.solid(meshes["pad"], STEEL, interface=["bottom"]), "disc": fs.solid(disc, STEEL, interface=[second])}
        if words is None:
            with pytest.warns(fs.PortWarning, match="% of pad.bottom lies on disc.near"):
                fs.couple(parts, [rub])
        else:
            with pytest.raises(fs.InputError, match=words + r".* belong to no whole face .* a tie or contact .* Let fs.facing"):
                fs.couple(parts, [rub])
    quadratic = fs.block((1.0, 1.0, 1.0), (2, 2, 1), "hexahedron20")
    corners = quadratic.with_sets(top=np.intersect1d(quadratic.sets["top"], quadratic.cells[:, :8]))
    with pytest.raises(fs.InputError, match=r"has no whole face .* midside nodes too"):
        fs.facing(("a", "top"), "a", {"a": corners})


def test_a_scene_takes_the_tolerance_of_its_joint(tmp_path: Path) -> None:
    """The post stands 4 mm above the base, which its tolerance of 5 mm allows, and the fault is that of the joint."""
    table = {"material": {"steel": {"E": 2.1e11, "rho": 7850.0}},
             "part": {"base": {"solid": {"lengths": [0.4, 0.2, 0.02], "elements": [8, 4, 1], "cells": "hexahedron"}},
                      "post": {"solid": {"lengths": [0.1, 0.1, 0.01], "elements": [3, 3, 1], "cells": "hexahedron",
                                         "at": [0.12, 0.04, 0.024]}}},
             "joint": [{"tied": ["post.bottom", "base.top"], "facing": True, "tolerance": 0.005}], "ask": [{"modes": 4}]}
    for part in table["part"].values():
        part["material"] = "steel"
    system = fs.Scene(table, tmp_path).models.full
    assert set(system.parts["base"].sets) == {"top-facing-post-bottom"} and system.size == 3 * (2 * 45 + 2 * 16 - 16)
    del table["joint"][0]["tolerance"]
    with pytest.raises(fs.InputError, match=r"joint 1: post.bottom and base.top do not face each other: they are 0\.004 apart"):
        _ = fs.Scene(table, tmp_path).models.full
