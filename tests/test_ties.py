"""Meshes that do not match are glued: the patch test, the order of convergence, and surfaces that do not meet."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from test_coupling import HOW

import femsub as fs
from femsub.components import Side, Surface

STEEL = fs.Material(1.0, 0.3, 1.0)


def box(kind: str, counts: tuple[int, int, int], start: float, length: float = 1.0, bent: float = 0.0, **how: object) -> tuple[
        fs.Substructure, fs.Mesh]:
    """A part of a bar of 1 x 1 from x = start on; `bent` moves the nodes of its cross sections."""
    mesh = fs.block((length, 1.0, 1.0), counts, kind)
    points = mesh.points.copy()
    points[:, 1:] += bent * np.sin(np.pi * points[:, 1:2]) * np.sin(np.pi * points[:, 2:3]) * [1.0, -0.7]
    points[:, 0] += start
    mesh = fs.Mesh(points, mesh.cells, mesh.kind, sets=mesh.sets)
    return fs.solid(mesh, STEEL, **how), mesh


def glued(kinds: tuple[str, str], counts: tuple[tuple[int, int, int], tuple[int, int, int]], bent: float = 0.0,
          supports: object = None, how: str = "full") -> tuple[fs.System, dict[str, fs.Mesh]]:
    a, mesh_a = box(kinds[0], counts[0], 0.0, bent=bent, interface=["right"], supports=supports)
    b, mesh_b = box(kinds[1], counts[1], 1.0, bent=-0.8 * bent, interface=["left", "right"], ports={"pull": ("right", "x")})
    meshes = {"a": mesh_a, "b": mesh_b}
    return fs.couple({"a": HOW[how](a), "b": HOW[how](b)}, [fs.Tied(("a", "right"), ("b", "left"), meshes)],
                     interface=[("b", "right")]), meshes


HEX, TET = "hexahedron", "tetra"
PAIRS = [((HEX, HEX), ((2, 3, 3), (2, 2, 2)), 0.0), ((HEX, HEX), ((2, 3, 4), (2, 5, 2)), 0.05),
         ((HEX, HEX), ((1, 2, 2), (1, 3, 3)), 0.0), ((TET, HEX), ((2, 3, 3), (2, 2, 2)), 0.04),
         ((TET, TET), ((2, 2, 3), (1, 3, 2)), 0.05), (("hexahedron20", HEX), ((1, 2, 2), (1, 3, 3)), 0.0),
         ((HEX, "hexahedron20"), ((1, 3, 3), (1, 2, 2)), 0.0), (("tetra10", "hexahedron27"), ((1, 2, 2), (1, 3, 3)), 0.0)]


@pytest.mark.parametrize(("kinds", "counts", "bent"), PAIRS)
def test_constant_stress_passes_the_glue(kinds: tuple[str, str], counts: tuple, bent: float) -> None:
    """The patch test: a bar pulled at both ends is in one state of stress, and stretches and narrows as one."""
    system, meshes = glued(kinds, counts, bent)
    exact = np.concatenate([_stretched(mesh.points) for mesh in meshes.values()])
    loads = np.concatenate([_pull(mesh, side) for (name, mesh), side in zip(meshes.items(), (-1.0, 1.0), strict=True)])
    f = system.L.T @ loads
    x = spla.spsolve(sp.csc_array(system.L.T @ system.L), system.L.T @ exact)
    assert np.abs(system.L @ x - exact).max() < 1e-10  # the linear field is one that the glue allows
    assert np.abs(system.K @ x - f).max() < 1e-10 * np.abs(f).max()  # and is in equilibrium with the pull


def _stretched(points: np.ndarray) -> np.ndarray:
    """Strain 1 along x at stress E = 1, and -ν across."""
    return (points * [1.0, -0.3, -0.3]).ravel()


def _pull(mesh: fs.Mesh, side: float) -> np.ndarray:
    """Nodal forces of the stress 1 on the outer end, from a port's average."""
    part = fs.solid(mesh, STEEL, ports={"end": ("left" if side < 0 else "right", "x")})
    return side * part.ports["end"]


@pytest.mark.parametrize("how", ["craig-bampton", "craig-chang"])
def test_reduced_parts_are_glued_alike(how: str) -> None:
    full, reduced = (glued(("hexahedron", "hexahedron"), ((2, 3, 3), (2, 2, 2)), supports=["left"], how=name)[0]
                     for name in ("full", how))
    modes = [fs.normal_modes(model, count=10).frequencies for model in (full, reduced)]
    np.testing.assert_allclose(modes[1], modes[0], rtol=1e-9)


@cache
def fine() -> np.ndarray:
    """Elastic frequencies of the free bar as one part, on a mesh that matches."""
    return fs.normal_modes(fs.solid(fs.block((2.0, 1.0, 1.0), (8, 4, 4), "hexahedron20"), STEEL), count=6).frequencies[6:]


@pytest.mark.parametrize(("kind", "sizes", "order"), [("hexahedron", (2, 4), 2), ("hexahedron20", (1, 2), 4)])
def test_frequencies_converge_at_the_elements_order(kind: str, sizes: tuple[int, ...], order: int) -> None:
    """The bar cut in the middle, on meshes of n and n + 1 elements across: with degree p the error of ω falls with h^2p."""
    errors = []
    for n in sizes:
        modes = fs.normal_modes(glued((kind, kind), ((n, n + 1, n + 1), (n, n, n)))[0], count=6)
        assert modes.rigid == 6
        errors.append(np.abs(modes.frequencies[6:] / fine() - 1).max())
    assert np.log(errors[0] / errors[1]) / np.log(sizes[1] / sizes[0]) > 0.75 * order


def test_the_first_surface_may_be_a_part_of_the_second() -> None:
    """A pad on a larger face: what it covers follows it, and the rest is free."""
    a, mesh_a = box("hexahedron", (1, 3, 3), 0.0, interface=["left", "right"])
    pad = fs.block((0.2, 0.5, 0.5), (1, 2, 2), "hexahedron")
    pad = fs.Mesh(pad.points + np.array([1.0, 0.2, 0.3]), pad.cells, pad.kind, sets=pad.sets)
    b = fs.solid(pad, STEEL, interface=["left"])
    tie = fs.Tied(("b", "left"), ("a", "right"), {"a": mesh_a, "b": pad})
    system = fs.couple({"a": a, "b": b}, [tie])
    assert system.size == a.size + b.size - 27 and fs.normal_modes(system, count=1).rigid == 6
    with pytest.raises(fs.InputError, match=r"a.right and b.left cannot be tied: .*only .*% of it lies on the other surface"):
        fs.couple({"a": a, "b": b}, [fs.Tied(("a", "right"), ("b", "left"), {"a": mesh_a, "b": pad})])


@pytest.mark.parametrize(("gap", "tolerance", "words"), [
    (0.1, None, "the surfaces are 0.1 apart, and 0.0177 is allowed"), (0.01, 1e-3, "are 0.01 apart, and 0.001 is allowed"),
    (0.01, None, None), (0.1, 0.2, None), (5.0, 1.0, "only 0% of it lies on the other surface")])
def test_surfaces_that_lie_apart_are_told(gap: float, tolerance: float | None, words: str | None) -> None:
    a, mesh_a = box("hexahedron", (1, 2, 2), 0.0, interface=["right"])
    b, mesh_b = box("hexahedron", (1, 2, 2), 1.0 + gap, interface=["left"])
    tie = fs.Tied(("a", "right"), ("b", "left"), {"a": mesh_a, "b": mesh_b}, tol=tolerance)
    if words is None:
        assert fs.couple({"a": a, "b": b}, [tie]).size == a.size + b.size - 27
        return
    with pytest.raises(fs.InputError, match=rf"Tied\(a.right, b.left\): .*{words}"):
        fs.couple({"a": a, "b": b}, [tie])


def test_what_cannot_be_tied_is_told() -> None:
    a, mesh_a = box("hexahedron", (1, 2, 2), 0.0, interface=["right"], supports={"front": "y"})
    b, mesh_b = box("hexahedron", (1, 2, 2), 1.0, interface=["left"])
    meshes = {"a": mesh_a, "b": mesh_b}
    for tie, words in ((fs.Tied(("a", "right"), ("b", "left"), meshes), "uy of 3 nodes of a.right is held, or no interface DOF"),
                       (fs.Tied(("b", "left"), ("a", "right"), {"b": mesh_b}), "the mesh of 'a' is missing"),
                       (fs.Tied(("b", b.interface[:3].tolist()), ("a", "right"), meshes), "must be a named interface set")):
        with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
            fs.couple({"a": a, "b": b}, [tie])
    # held nodes of the second surface hold those that follow it
    assert fs.couple({"a": a, "b": b}, [fs.Tied(("b", "left"), ("a", "right"), meshes)]).size == a.size + b.size - 27


def test_points_on_curved_faces_are_placed_in_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each point stops when it is in its place: rounding in one does not keep the others going."""
    _, mesh = box("hexahedron20", (1, 3, 3), 0.0, bent=0.05)
    far = fs.Mesh(mesh.points + 20.0, mesh.cells, mesh.kind, sets=mesh.sets)  # where rounding is 5e-14 of a face
    surface = Surface.of(far, "right", "right")
    rng, evaluated, along = np.random.default_rng(2), [], Side.along
    at, s = rng.integers(len(surface.faces), size=2000), rng.random((2000, 2))

    def counted(side: Side, way: np.ndarray) -> np.ndarray:
        evaluated.append(len(way))
        return along(side, way)

    monkeypatch.setattr(Side, "along", counted)
    assert np.abs(Side.nearest(surface, at, Side(surface, at, s).x).s - s).max() < 1e-11
    assert sum(evaluated) < 7 * len(at)
