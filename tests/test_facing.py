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
    pad = put(put(put(pad, -np.append(pad.points[:, :2].mean(axis=0), 0), turn), (*rng.uniform(0, 0.9, 2), 0.1 + gap)), (0, 0, 0), Q)
    return {"pad": pad, "plate": put(plate, (0, 0, 0), Q)}, Q


@pytest.mark.parametrize("seed", range(20))
def test_faces_and_coverage_are_those_of_a_search_of_every_pair(seed: int) -> None:
    """Turned meshes of all kinds; every second one is apart by more than a face, which a large tol allows."""
    rng = np.random.default_rng(seed)
    kinds = KINDS[seed % 5], KINDS[int(rng.integers(5))]
    gap = 0.7 if seed % 2 else 0.0
    meshes, Q = pair(rng, kinds, gap)
    seen, below = [], 0.1 + gap / 2
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
    assert below and len(found.faces) == met.sum()
    mine = (meshes["plate"].points @ Q)[found.faces[:, :seen[1].shape[1]], :2].mean(axis=1)
    np.testing.assert_allclose(sorted(map(tuple, mine.round(9))), sorted(map(tuple, seen[1][met].mean(axis=1).round(9))), atol=1e-8)
    assert found.coverage == pytest.approx((shared.sum() / area[0].sum(), shared.sum() / area[1][met].sum()), rel=1e-9)
    assert found.areas == pytest.approx((area[0].sum(), area[1][met].sum()), rel=1e-9)
    np.testing.assert_array_equal(found.nodes, np.unique(found.faces))
    np.testing.assert_array_equal(found.nodes, found.meshes["plate"].sets[found.second[1]])
    lost = 1 - shared.sum() / area[0].sum()
    assert [one.category for one in heard] == ([fs.PortWarning] if lost > 1e-6 else [])
