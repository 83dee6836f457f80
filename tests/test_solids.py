"""Solids: entries against scikit-fem, frequencies against closed forms, rigid motion, patches, bad input."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from scipy.spatial import cKDTree
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

import femsub as fs
from femsub.checks import InputError, InputTypeError
from femsub.components import solid_assembly, solid_elements
from femsub.components.mesh import boundary_faces, distinct_sides
from femsub.components.patches import solid_average
from femsub.components.solid_assembly import stiffness_and_mass

STEEL = {"SI": (fs.Material(2.1e11, 0.3, 7850.0), 1.0), "mm-t-s": (fs.Material(2.1e5, 0.3, 7.85e-9), 1e3)}
ELEMENTS = {"hexahedron": skfem.ElementHex1, "hexahedron20": skfem.ElementHexS2, "hexahedron27": skfem.ElementHex2,
            "tetra": skfem.ElementTetP1, "tetra10": skfem.ElementTetP2}


def warped(kind: str, counts: tuple[int, int, int]) -> fs.Mesh:
    """A block whose cells have straight edges but are no parallelepipeds."""
    points, cells = solid_elements.box(counts, "tetra" if kind.startswith("tetra") else "hexahedron")
    points = points / counts * (1.0, 0.6, 0.4)
    x, y, z = points.T
    points = points + 0.08 * np.stack([y * z, x * z - x * y, x * y], axis=1)
    return fs.Mesh(*solid_elements.raised(points, cells, kind), kind)


@pytest.mark.parametrize("kind", ELEMENTS)
def test_entries_equal_those_of_scikit_fem(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ten = 8 * 20 * 10 * solid_elements.reference(kind).nodes.shape[0] ** 2
    monkeypatch.setattr(solid_assembly, "CHUNK", ten)  # cells at a time
    mesh, material = warped(kind, (3, 3, 2)), fs.Material(3.0, 0.31, 1.7)
    half = np.arange(len(mesh.cells)) % 2 == 0  # two materials, alike, in cells that take turns
    K, M = stiffness_and_mass(mesh, [(material, np.flatnonzero(half)), (material, np.flatnonzero(~half))])
    assert (K != K.T).nnz == 0 and (M != M.T).nnz == 0

    corners = solid_elements.reference(kind).corners
    used, cells = np.unique(mesh.cells[:, :corners], return_inverse=True)
    cells = cells.reshape(-1, corners)
    linear = "hexahedron" if corners == 8 else "tetra"
    order = solid_elements.skfem_element(linear)[1].argsort()
    kinds = {"hexahedron": skfem.MeshHex, "tetra": skfem.MeshTet}
    other = kinds[linear](mesh.points[used].T.copy(), cells[:, order].T.copy())
    X, w = solid_elements.quadrature(kind, int(solid_assembly.exact_degree(mesh, np.arange(1))[0]))
    basis = skfem.Basis(other, skfem.ElementVector(ELEMENTS[kind]()), quadrature=(np.ascontiguousarray(X.T), w))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return material.rho * dot(u, v)

    node = cKDTree(mesh.points).query(basis.doflocs.T)[1]
    component = np.empty(basis.N, dtype=int)
    for i, dofs in enumerate(basis.element_dofs):
        component[dofs] = i % 3
    to = sp.csr_array((np.ones(basis.N), (np.arange(basis.N), 3 * node + component)))
    for ours, theirs in ((K, linear_elasticity(*material.lame).assemble(basis)), (M, inertia.assemble(basis))):
        assert abs(to @ ours @ to.T - theirs).max() <= 1e-12 * abs(theirs).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("units", STEEL)
@pytest.mark.parametrize("kind", ELEMENTS)
def test_six_rigid_body_modes_in_either_system_of_units(kind: str, units: str) -> None:
    material, length = STEEL[units]
    sub = fs.solid(fs.block((1.0 * length, 0.3 * length, 0.1 * length), (8, 3, 2), kind), material)
    modes = fs.normal_modes(sub, count=4)
    assert modes.rigid == 6 and modes.residual.max() < 1e-12
    other = fs.normal_modes(fs.solid(fs.block((1.0, 0.3, 0.1), (8, 3, 2), kind), STEEL["SI"][0]), count=4)
    np.testing.assert_allclose(modes.frequencies[6:], other.frequencies[6:], rtol=1e-9)
    # the mass, and rigid motion costs nothing
    x, y, z = sub.dofs.points[::3].T
    motions = np.zeros((sub.size, 6))
    for axis in range(3):
        motions[axis::3, axis] = 1.0
    motions[1::3, 3], motions[2::3, 3] = -z, y
    motions[0::3, 4], motions[2::3, 4] = z, -x
    motions[0::3, 5], motions[1::3, 5] = -y, x
    np.testing.assert_allclose(np.diag(motions.T @ (sub.M @ motions))[:3], material.rho * 0.03 * length**3, rtol=1e-12)
    assert np.abs(sub.K @ motions).max() <= 1e-13 * abs(sub.K).max() * np.abs(motions).max()


def test_two_materials() -> None:
    mesh = fs.block((2.0, 1.0, 1.0), (4, 2, 2), "hexahedron20")
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 1.0
    mesh = fs.Mesh(mesh.points, mesh.cells, mesh.kind, mesh.sets, {"pad": np.flatnonzero(right), "plate": np.flatnonzero(~right)})
    heavy, light = fs.Material(2.0, 0.2, 5.0), fs.Material(1.0, 0.2, 1.0)
    sub = fs.solid(mesh, {"pad": heavy, "plate": light})
    motion = np.zeros(sub.size)
    motion[0::3] = 1.0
    assert motion @ (sub.M @ motion) == pytest.approx(6.0, rel=1e-12)
    with pytest.raises(InputError, match="8 cells of 'mesh' are in none of the groups, and 0 in several"):
        fs.solid(mesh, {"pad": heavy})
    with pytest.raises(InputError, match="unknown group of cells"):
        fs.solid(mesh, {"pads": heavy})


@pytest.mark.parametrize("kind", ELEMENTS)
def test_a_patch_sees_the_average_over_its_area(kind: str) -> None:
    mesh = fs.block((2.0, 1.0, 0.5), (5, 3, 2), kind).with_sets(half=lambda p: (p[:, 2] > 0.49) & (p[:, 0] < 1.21))
    average, normal = solid_average(mesh, "half", "port")
    x, y, _ = mesh.points.T
    assert average.sum() == pytest.approx(1.0, rel=1e-14) and np.allclose(normal, [0, 0, 1], atol=1e-14)
    assert average @ x == pytest.approx(0.6, rel=1e-12) and average @ y == pytest.approx(0.5, rel=1e-12)
    expected = 1.2**2 / 3 if solid_elements.reference(kind).degree == 2 else average @ x**2
    assert average @ x**2 == pytest.approx(expected, rel=1e-12)
    cells, _ = boundary_faces(mesh)
    assert len(cells) == 2 * (15 + 10 + 6) * (2 if kind.startswith("tet") else 1)


@pytest.mark.parametrize("spread", [1, 1000])  # from 55,000 nodes on, four of them do not fit into one number of 64 bits
def test_faces_and_edges_are_listed_once_and_in_order(spread: int) -> None:
    block = fs.block((2.0, 1.0, 0.5), (5, 3, 2), "hexahedron")
    mesh = SimpleNamespace(cells=block.cells * spread, points=np.zeros((len(block.points) * spread, 3)))
    for sides in (solid_elements.reference("hexahedron").faces, solid_elements.reference("hexahedron").edges):
        given = np.sort(mesh.cells[:, np.array(sides)].reshape(-1, len(sides[0])), axis=1)
        corners, number, times = distinct_sides(mesh, np.array(sides))
        assert np.array_equal(corners, np.unique(given, axis=0)) and times.sum() == len(given)
        assert np.array_equal(corners[number.ravel()], given) and np.array_equal(np.bincount(number.ravel()), times)


@pytest.mark.parametrize("kind", ELEMENTS)
def test_a_port_means_faces_cells_edges_or_nodes_by_what_its_set_is(kind: str) -> None:
    mesh = fs.block((2.0, 1.0, 1.0), (2, 2, 2), kind)
    x, y, z = mesh.points.T
    mesh = mesh.with_sets(rim=(y == 0) & (z == 0), half=x <= 1, tips=[int(np.argmin(x + y + z)), int(np.argmax(x + y + z))])
    left = np.flatnonzero((x[mesh.cells] <= 1).all(axis=1))
    mesh = fs.Mesh(mesh.points, mesh.cells, kind, mesh.sets, {"left half": left})
    ports = ("rim", "half", "tips", "left half", "right")
    sub = fs.solid(mesh, STEEL["SI"][0], ports={port: (port, "x") for port in ports})
    linear = np.zeros((len(x), 3))
    linear[:, 0] = 1 + x + 2 * y + 3 * z
    assert [sub.port(port) @ linear.ravel() for port in ports] == pytest.approx([2.0, 4.0, 4.5, 4.0, 5.5], rel=1e-12)
    if solid_elements.reference(kind).degree == 2:
        linear[:, 0] = x**2 + y * z
        assert [sub.port(port) @ linear.ravel() for port in ports] == pytest.approx([4 / 3, 7 / 12, 2.5, 7 / 12, 4.25], rel=1e-12)


@pytest.mark.parametrize("kind", ELEMENTS)
def test_a_port_on_a_set_of_several_kinds_is_refused(kind: str) -> None:
    mesh = fs.block((2.0, 1.0, 1.0), (2, 2, 2), kind)
    x, y, z = mesh.points.T
    face = np.flatnonzero((x == 0) & (y <= 0.5) & (z <= 0.5))
    mesh = mesh.with_sets(six=np.append(face, np.flatnonzero((x == 2) & (y == 1) & (z != 0.5) & (z % 0.5 == 0))))
    with pytest.raises(InputError, match=r"port 'p': 2 of the \d+ nodes of the set 'six' belong to none of the faces"):
        fs.solid(mesh, STEEL["SI"][0], ports={"p": ("six", "x")})


def test_middle_nodes_beyond_the_faces_of_a_patch_are_told_and_do_not_count() -> None:
    """A choice by coordinates takes in the middle nodes of half a face more; with those or without, the faces are the same."""
    mesh = fs.block((4.0, 1.0, 1.0), (4, 2, 2), "hexahedron20")
    mesh = mesh.with_sets(whole=lambda p: (p[:, 2] == 1) & (p[:, 0] <= 2), more=lambda p: (p[:, 2] == 1) & (p[:, 0] <= 2.6))
    with pytest.warns(fs.PortWarning, match="3 of the 24 nodes of the set 'more'"):
        sub = fs.solid(mesh, STEEL["SI"][0], ports={"whole": ("whole", "x"), "more": ("more", "x")})
    assert np.array_equal(sub.port("whole"), sub.port("more"))


def test_normals_of_a_bent_patch_and_ports() -> None:
    ring = fs.annulus(0.5, 1.0, 0.2, (2, 24, 1), "hexahedron20")
    ring = ring.with_sets(sector=lambda p: (np.hypot(p[:, 0], p[:, 1]) > 0.999) & (p[:, 0] > 0.7))
    _, normal = solid_average(ring, "sector", "port")
    assert np.allclose(normal, [1, 0, 0], atol=1e-12)
    sub = fs.solid(ring, STEEL["SI"][0], supports={"inner": "xyz"}, interface={"sector": "z"},
                   ports={"rub": ("sector", (0, 3.0, 4.0)), "push": ("sector", "normal")}, rayleigh=(2.0, 1e-6))
    still = np.zeros(sub.size)
    still[sub.dofs.components == 1], still[sub.dofs.components == 2] = 1.0, 2.0
    assert sub.port("rub") @ still == pytest.approx(0.6 + 1.6, rel=1e-12)
    assert abs(sub.D - (2.0 * sub.M + 1e-6 * sub.K)).max() <= 1e-14 * abs(sub.D).max()
    assert set(sub.dofs.components[sub.interface]) == {2}
    held = set(ring.numbers[ring.sets["inner"]])
    assert not held & set(sub.dofs.nodes)


@pytest.mark.parametrize("change, words", [
    ({"supports": ["lid"]}, "unknown set of nodes of the mesh 'block': 'lid'; valid"),
    ({"supports": {"left": "w"}}, "'w' for the set 'left' must be 'clamped' or some of the letters x, y, z"),
    ({"interface": ["left"], "supports": ["left"]}, "interface 'left' of 'block' is held by the supports"),
    ({"rayleigh": (-1.0, 0.0)}, "alpha of rayleigh must not be negative"),
    ({"ports": {"belt": ("left", "x")}, "supports": ["left"]}, "sits on DOF that the supports hold"),
    ({"ports": {"belt": ("top", "up")}}, "unknown direction of port 'belt'"),
    ({"ports": {"belt": ("top", (0, 0, 0))}}, "three numbers, not all 0"),
    ({"ports": {"belt": ("one", "normal")}}, "only faces of the surface have a normal, and 'one' holds none"),
    ({"ports": {"belt": ("all", "normal")}}, "only faces of the surface have a normal, and 'all' holds none"),
])
def test_bad_input(change: dict, words: str) -> None:
    mesh = fs.block((1.0, 1.0, 1.0), (2, 2, 2), "hexahedron").with_sets(one=[0], all=np.arange(27))
    with pytest.raises(InputError, match=words):
        fs.solid(mesh, STEEL["SI"][0], **change)


def test_more_bad_input() -> None:
    mesh = fs.block((1.0, 1.0, 1.0), (2, 2, 2), "hexahedron")
    with pytest.raises(InputError, match="nu must lie between"):
        fs.Material(1.0, 0.5, 1.0)
    with pytest.raises(InputError, match="rho must be positive"):
        fs.Material(1.0, 0.3, -1.0)
    with pytest.raises(InputTypeError, match="mesh must be a Mesh"):
        fs.solid("mesh.inp", STEEL["SI"][0])
    with pytest.raises(InputError, match="quad cells, which are 2D, but a solid needs"):
        fs.solid(fs.rectangle((1.0, 1.0), (2, 2), "quad"), STEEL["SI"][0])
    turned = fs.Mesh(mesh.points, mesh.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]], "hexahedron")
    with pytest.raises(InputError, match=r"8 cells are inverted or have no volume, one of them at \(0.25, 0.25, 0.25\)"):
        fs.solid(turned, STEEL["SI"][0])


@pytest.mark.parametrize("layers", [1, 2])
def test_bricks_of_8_nodes_lock_as_the_docstring_says_and_those_of_20_do_not(layers: int) -> None:
    thickness, count = 1e-2, 8
    euler = 3.5160152685 * np.sqrt(2.1e11 / 7850.0 / 12) * thickness
    for kind, factor in (("hexahedron", np.sqrt(1 + 0.5 / (count * thickness) ** 2)), ("hexahedron20", 1.0)):
        mesh = fs.block((1.0, thickness, thickness), (count, 1, layers), kind)
        sub = fs.solid(mesh, fs.Material(2.1e11, 0.0, 7850.0), supports={"left": "clamped"})
        assert fs.normal_modes(sub, count=1).frequencies[0] == pytest.approx(factor * euler, rel=0.01)


@pytest.mark.parametrize(("arguments", "text"), [
    ({"material": (1, 2, 3)}, "material must be a Material or map groups"),
    ({"material": {"all": (1, 2, 3)}}, "material of the group 'all' must be a Material(E, nu, rho), not (1, 2, 3)"),
    ({"supports": 5}, "supports must be a list of names of sets"),
    ({"supports": {"left": 5}}, "supports: the motions of the set 'left' must be letters, such as 'xyz', not 5"),
    ({"supports": [["left"]]}, "unknown set of nodes"),
    ({"interface": 7}, "interface must be a list of names of sets"),
    ({"ports": ["p"]}, "ports must be a dict of names"),
    ({"ports": {"p": "right"}}, "port 'p' must be (set of nodes, direction)"),
    ({"ports": {"p": ("right", [[1, 2], [3]])}}, "the direction of port 'p' must be rows of the same length"),
    ({"ports": {"p": ("right", [1j, 0, 0])}}, "the direction of port 'p' must be real numbers"),
    ({"ports": {"p": ("right", None)}}, "the direction of port 'p' must be real numbers"),
    ({"ports": {"p": ("right", "-w")}}, "unknown direction of port 'p': '-w'"),
    ({"rayleigh": 3}, "rayleigh"),
    ({"rayleigh": (1, "a")}, "rayleigh"),
])
def test_arguments_of_the_wrong_kind(arguments: dict, text: str) -> None:
    mesh = fs.block((1, 1, 1), (1, 1, 1), "hexahedron")
    mesh = fs.Mesh(mesh.points, mesh.cells, mesh.kind, mesh.sets, {"all": [0]})
    with pytest.raises((fs.InputError, fs.InputTypeError)) as caught:
        fs.solid(mesh, **{"material": fs.Material(E=1.0, nu=0.3, rho=1.0), **arguments})
    assert text in str(caught.value) and "\n" not in str(caught.value)


def test_no_supports_and_directions_the_other_way() -> None:
    mesh, steel = fs.block((1, 1, 1), (1, 1, 1), "hexahedron"), fs.Material(E=1.0, nu=0.3, rho=1.0)
    ports = {sign + way: ("right", sign + way) for sign in ("", "-") for way in ("x", "y", "z", "normal")}
    sub = fs.solid(mesh, steel, supports=None, interface=None, ports=ports)
    assert sub.M.shape == (24, 24)
    for way in ("x", "y", "z", "normal"):
        assert np.array_equal(sub.ports["-" + way], -sub.ports[way]) and np.any(sub.ports[way])
