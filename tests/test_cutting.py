"""`cut`: parts of one mesh or one pair of matrices are the whole again when they are coupled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.sparse.csgraph import connected_components

import femsub as fs
from femsub.algebra import partitioning, petsc

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
BLOCK = {"material": STEEL, "supports": ["left"], "interface": ["top"], "ports": {"belt": ("right", "y")},
         "rayleigh": (1.0, 1e-6)}
PLATE = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "thickness": 0.01, "supports": {"left": "clamped", "front": "simply supported"},
         "interface": ["back"], "ports": {"belt": "right"}, "rayleigh": (1.0, 1e-6)}


def dense(A: Any) -> np.ndarray:
    return A.toarray() if sp.issparse(A) else np.asarray(A)


def order(cut: fs.Cut, system: fs.System) -> np.ndarray:
    """Where each coordinate of the system stands in the whole, (n,)."""
    found = cut.whole(system.expand(np.eye(system.size)))
    assert np.array_equal(np.sort(found.argmax(axis=0)), np.arange(system.size)) and found.sum() == np.count_nonzero(found)
    return found.argmax(axis=0)


def check(whole: fs.Substructure, cut: fs.Cut) -> fs.System:
    """The coupled parts have the matrices, ports and modes of the whole, one coordinate for each DOF, no equation twice."""
    system = fs.couple(*cut)
    assert system.size == whole.size == cut.size and not system.redundant
    at = order(cut, system)
    for name in "MDK":
        ours, theirs = dense(getattr(system, name)), dense(getattr(whole, name))[np.ix_(at, at)]
        unit = np.sqrt(np.maximum(np.abs(theirs.diagonal()), 1e-300))
        assert np.abs((ours - theirs) / np.outer(unit, unit)).max(where=np.abs(theirs) + np.abs(ours) > 0, initial=0.0) < 1e-13
    for name, w in whole.ports.items():
        ports = [w_ for port, w_ in system.ports.items() if port.endswith(f".{name}")]
        assert len(ports) == 1
        assert_allclose(ports[0], w[at], atol=1e-14 * np.abs(w).max())
    assert_allclose(fs.normal_modes(system, 6).frequencies, fs.normal_modes(whole, 6).frequencies, rtol=1e-9)
    return system


@pytest.mark.sampled(3)
@pytest.mark.parametrize("into", [2, 3, 5, 8])
@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_a_solid_in_parts_is_the_whole(kind: str, into: int) -> None:
    mesh = fs.block((1.0, 0.5, 0.2), (5, 3, 2), kind)
    cut = fs.cut(mesh, fs.solid, into=into, **BLOCK)
    assert list(cut.parts) == [f"p{number}" for number in range(1, into + 1)]
    check(fs.solid(mesh, **BLOCK), cut)
    assert np.array_equal(np.sort(np.concatenate(list(cut.cells.values()))), np.arange(len(mesh.cells)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("into", [2, 5, 8])
@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_a_plate_in_parts_is_the_whole(kind: str, into: int) -> None:
    """Triangles have DOF on edges, too."""
    mesh = fs.rectangle((1.0, 0.5), (8, 6), kind)
    check(fs.plate(mesh, **PLATE), fs.cut(mesh, fs.plate, into=into, **PLATE))


def test_where_three_parts_and_more_meet_one_joint_holds_them() -> None:
    mesh = fs.rectangle((1.0, 1.0), (4, 4))
    beyond = mesh.points[mesh.cells].mean(axis=1) > 0.5
    quarter = [np.flatnonzero((beyond == (x, y)).all(axis=1)) for x in (0, 1) for y in (0, 1)]
    mesh = fs.Mesh(mesh.points, mesh.cells, "quad", mesh.sets, dict(zip("abcd", quarter, strict=True)))
    cut = fs.cut(mesh, fs.plate, sets=["a", "b", "c", "d"], **(PLATE | {"ports": {}}))
    cross = next(joint for joint in cut.joints if repr(joint) == "a+b+c+d")
    assert [len(cut.parts[name].sets["a+b+c+d"]) for name, _ in cross.ends] == [4, 4, 4, 4]  # w, w,x, w,y, w,xy of the middle
    assert len(cut.joints) == 5
    check(fs.plate(mesh, **(PLATE | {"ports": {}})), cut)


def test_sets_supports_ports_and_damping_go_to_the_parts_that_have_them() -> None:
    mesh = fs.block((1.0, 0.5, 0.2), (6, 3, 2), "hexahedron")
    cut = fs.cut(mesh, fs.solid, into=3, **BLOCK)
    whole = fs.solid(mesh, **BLOCK)
    assert [name for name, part in cut.parts.items() if "belt" in part.ports] == [
        name for name, part in cut.parts.items() if np.isin(np.flatnonzero(whole.ports["belt"]), cut.rows[name]).all()][:1]
    for name, part in cut.parts.items():
        theirs = np.intersect1d(cut.rows[name], whole.interface)
        ours = cut.rows[name][part.interface[part.sets["top"]]] if "top" in part.sets else theirs[:0]
        assert np.array_equal(np.sort(ours), theirs)
        assert part.dofs is not None and whole.dofs is not None
        assert part.dofs.nodes.tolist() == whole.dofs.nodes[cut.rows[name]].tolist()


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("kind", "into"), [("hexahedron", 2), ("hexahedron", 5), ("hexahedron20", 2), ("quad", 8),
                                            ("triangle", 5)])
def test_matrices_in_parts_are_the_whole_and_craig_bampton_serves(kind: str, into: int) -> None:
    if kind in ("quad", "triangle"):
        whole = fs.plate(fs.rectangle((1.0, 0.5), (14, 10), kind), **(PLATE | {"ports": {"belt": (1.0, 0.5)}}))
    else:
        counts = (8, 4, 3) if kind == "hexahedron" else (5, 3, 2)
        whole = fs.solid(fs.block((1.0, 0.5, 0.2), counts, kind), **(BLOCK | {"ports": {}}))
    cut = fs.cut(whole, into=into)
    check(whole, cut)
    full = fs.normal_modes(whole, 4).frequencies
    errors = []
    for modes in (4, 16):
        parts = {name: fs.reduce(part, fs.CraigBampton(modes), ports=True) for name, part in cut.parts.items()}
        errors.append(fs.normal_modes(fs.couple(parts, cut.joints), 4).frequencies / full - 1)
    assert (errors[1] > -1e-9).all() and errors[1].max() < 1e-3 and (errors[1] < errors[0] + 1e-9).all()


def test_matrices_without_a_map_are_cut_by_their_pattern() -> None:
    whole = fs.solid(fs.block((1.0, 0.5, 0.2), (6, 3, 2), "hexahedron"), STEEL, supports=["left"])
    check(whole, fs.cut(fs.Substructure(whole.M, whole.K, interface=[0, 1, 2]), into=3))


def test_a_chain_in_parts_stays_semidefinite_so_that_every_method_serves() -> None:
    """A diagonally dominant K has diagonally dominant parts."""
    whole = fs.chain(40, belt=2, springs=np.linspace(1.0, 3.0, 40))
    cut = fs.cut(whole, into=4)
    check(whole, cut)
    for part in cut.parts.values():
        assert np.linalg.eigvalsh(dense(part.K))[0] > -1e-14
    parts = {name: fs.reduce(part, fs.CraigChang(6), ports=True) for name, part in cut.parts.items()}
    reduced, full = (fs.normal_modes(one, 3).frequencies for one in (fs.couple(parts, cut.joints), whole))
    assert_allclose(reduced, full, rtol=1e-4)


def test_a_part_of_matrices_that_is_indefinite_is_refused_by_free_interface_methods() -> None:
    whole = fs.solid(fs.block((1.0, 0.5, 0.2), (8, 4, 2), "hexahedron"), STEEL, supports=["left"])
    parts, joints = fs.cut(whole, into=3)
    for method in (fs.CraigChang(4), fs.Herting(4), fs.CraigBampton(band=(0, 1e4), tol=1e-3)):
        with pytest.raises(fs.SingularMatrixError, match=r"^'p1': .* CraigBampton\(modes=\.\.\.\) or Guyan\(\), or cut the mesh"):
            fs.reduce(parts["p1"], method)
        assert fs.reduce(parts["p1"], fs.Guyan()).size
    with pytest.raises(fs.SingularMatrixError, match=r"^'p[123]': K of this part is indefinite.* or cut the mesh"):
        fs.reduce(fs.couple(parts, joints), dict.fromkeys(parts, fs.CraigChang(4)))
    free = fs.Substructure(np.diag([1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 0.0]))
    with pytest.raises(fs.SingularMatrixError, match=r"^'part': K - σM is not positive definite") as caught:
        fs.reduce(free, fs.CraigChang(1))
    assert "cut" not in str(caught.value)


def test_a_mesh_in_pieces_is_cut_within_them() -> None:
    one = fs.block((1.0, 0.5, 0.2), (4, 2, 2), "hexahedron")
    points, cells = [one.points, one.points + np.array([2.0, 0.0, 0.0])], [one.cells, one.cells + len(one.points)]
    sets = {"left": one.sets["left"], "right": one.sets["right"] + len(one.points)}
    two = fs.Mesh(np.vstack(points), np.vstack(cells), "hexahedron", sets)
    cut = fs.cut(two, fs.solid, into=4, material=STEEL, supports=["left"], interface=["right"])
    pieces = [{int(cell >= len(one.cells)) for cell in cells} for cells in cut.cells.values()]
    assert all(len(piece) == 1 for piece in pieces)
    with pytest.raises(fs.InputError, match="no joints lead from"):
        fs.couple(*cut)


def test_a_crack_keeps_its_two_sides_apart() -> None:
    """Nodes at one place that are not one node, on a cut and within a part; of triangles edges as well."""
    for kind in ("quad", "triangle"):
        mesh = fs.rectangle((1.0, 1.0), (4, 4), kind)
        crack = np.flatnonzero((mesh.points[:, 0] == 0.5) & (mesh.points[:, 1] > 0.3))
        cells = mesh.cells.copy()
        right = mesh.points[cells].mean(axis=1)[:, 0] > 0.5
        for number, node in enumerate(crack):
            cells[right] = np.where(cells[right] == node, len(mesh.points) + number, cells[right])
        open_ = fs.Mesh(np.vstack([mesh.points, mesh.points[crack]]), cells, kind, {"left": mesh.sets["left"]},
                        {"one": np.flatnonzero(~right), "two": np.flatnonzero(right)})
        own = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "thickness": 0.01, "supports": {"left": "clamped"}}
        check(fs.plate(open_, **own), fs.cut(open_, fs.plate, sets=["one", "two"], **own))
        check(fs.plate(open_, **own), fs.cut(open_, fs.plate, into=3, **own))


def test_places_of_a_large_matrix_are_not_taken_for_others() -> None:
    n, (row, column) = 70_000, divmod(5 + 2**32, 70_000)  # in 32 bits it has the number of the place (0, 5)
    rows, columns = np.array([[0, row, 1], [5, column, 1]], dtype=np.int32)
    A = sp.coo_array(([3.0, 2.0], (rows[1:], columns[1:])), shape=(n, n))
    assert sp.csr_array(A)[rows, columns].tolist() == [0.0, 3.0, 2.0]


def test_wrong_cuts_are_told() -> None:
    mesh = fs.rectangle((1.0, 1.0), (2, 2))
    mesh = fs.Mesh(mesh.points, mesh.cells, "quad", mesh.sets, {"a": [0, 1], "b": [1, 2, 3], "c": [2, 3], "none": []})
    own = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "thickness": 0.01}
    for wrong, message in (({"into": 5}, "into.*at most 4"), ({"into": 1}, "at least 2"), ({}, "either into"),
                           ({"into": 2, "sets": ["a", "c"]}, "either into"), ({"sets": ["a", "b"]}, "0 cells .* 1 in several"),
                           ({"sets": ["a"]}, "2 cells .* in none"), ({"sets": ["a", "c", "none"]}, "'none' .* is empty"),
                           ({"sets": ["a", "d"]}, "group of cells"),
                           ({"sets": ["a", "c"], "ports": {"belt": "edge"}}, "'belt' lies across the parts 'a', 'c'")):
        with pytest.raises(fs.InputError, match=message):
            fs.cut(mesh, fs.plate, **own, **wrong)  # type: ignore[arg-type]
    with pytest.raises(fs.InputTypeError, match="the function that makes the component"):
        fs.cut(mesh, into=2)
    with pytest.raises(fs.InputTypeError, match="is cut by cut"):
        fs.cut(fs.chain(10), fs.plate, into=2)
    with pytest.raises(fs.InputError, match="into is missing"):
        fs.cut(fs.chain(10))
    with pytest.raises(fs.InputError, match="at most 10"):
        fs.cut(fs.chain(10), into=11)
    with pytest.raises(fs.InputError, match=r"too many: p\d+ has no node of its own\. Take fewer"):
        fs.cut(fs.chain(10), into=10)
    full = np.ones((6, 6)) + 6 * np.eye(6)
    for model, message in ((fs.Substructure(full, full, name="block"), "the matrices of 'block' .* coupled with every other"),
                           (fs.Substructure(full, full, dofs=fs.DofMap(np.full(6, 7), np.arange(6), tuple("abcdef"))),
                            "all DOF belong to one node"),
                           (fs.reduce(fs.chain(10), fs.CraigBampton(4)), "more nodes, or its mesh")):
        with pytest.raises(fs.InputError, match=message):
            fs.cut(model, into=2)
    with pytest.raises(fs.InputError, match=r"'rectangle' has one cell.* mesh it finer"):
        fs.cut(fs.rectangle((1.0, 1.0), (1, 1)), fs.plate, into=2, **own)
    bare = fs.Substructure(np.eye(4), np.eye(4))
    with pytest.raises(fs.InputError, match="no map of its DOF"):
        fs.cut(mesh, lambda mesh: bare, into=2)


def grid(n: int) -> sp.csr_array:
    line, one = sp.diags_array([np.ones(n - 1)] * 2, offsets=[-1, 1]), sp.eye_array(n)
    return sp.csr_array(sp.kron(line, one) + sp.kron(one, line))


@pytest.mark.parametrize("library", [True, False])
@pytest.mark.parametrize("count", [2, 3, 8, 30])
def test_a_graph_falls_into_equal_parts_in_one_piece(count: int, library: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not library:
        monkeypatch.setattr(partitioning, "scotch_parts", lambda graph, count: None)
    elif not petsc.has("ptscotch"):
        pytest.skip("PETSc was built without SCOTCH")
    graph = grid(30)
    part = partitioning.partition(graph, count)
    sizes = np.bincount(part, minlength=count)
    assert sizes.min() > 0.5 * 900 / count and sizes.max() < 1.6 * 900 / count
    assert max(connected_components(graph[part == own][:, part == own])[0] for own in range(count)) == 1
    edges = sp.coo_array(graph)
    assert np.count_nonzero(part[edges.row] != part[edges.col]) / 2 < 3.2 * 30 * np.sqrt(count)
    assert np.array_equal(part, partitioning.partition(graph, count))  # the same at each call
