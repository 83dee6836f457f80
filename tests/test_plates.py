"""The Kirchhoff plate against closed forms: Bogner-Fox-Schmit rectangles and Morley triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import femsub as fs
from femsub.components.plate import Layout

SI = {"E": 210e9, "nu": 0.3, "rho": 7850.0, "thickness": 2e-3}
MM = {"E": 210e3, "nu": 0.3, "rho": 7.85e-9, "thickness": 2.0}
A, B = 1.0, 0.7
SPEED = np.sqrt(SI["E"] * SI["thickness"] ** 2 / (12 * (1 - SI["nu"] ** 2) * SI["rho"]))  # ω = (wave number)² SPEED


def rectangle(nx: int, ny: int, kind: str, *, a: float = A, b: float = B, shake: float = 0.0) -> fs.Mesh:
    """A grid on [0, a] x [0, b], its triangles halves of the rectangles, inner nodes moved by up to `shake` cells."""
    x, y = np.meshgrid(np.linspace(0, a, nx + 1), np.linspace(0, b, ny + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).ravel()
    cells = np.column_stack([corner, corner + ny + 1, corner + ny + 2, corner + 1])
    if kind == "triangle":
        cells = np.vstack([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    left, right = np.isclose(points[:, 0], 0), np.isclose(points[:, 0], a)
    edge = left | right | np.isclose(points[:, 1], 0) | np.isclose(points[:, 1], b)
    points[~edge] += np.random.default_rng(1).uniform(-shake, shake, ((~edge).sum(), 2)) * (a / nx, b / ny)
    patch = np.hypot(points[:, 0] - 0.5 * a, points[:, 1] - 0.5 * b) < 0.3 * a
    sets = {"left": left, "right": right, "edge": edge, "patch": patch}
    return fs.Mesh(points, cells, kind, {name: np.flatnonzero(rows) for name, rows in sets.items()})


@pytest.mark.sampled(7)
@pytest.mark.parametrize("kind", ["quad", "triangle"])
@pytest.mark.parametrize("counts", [(1, 1), (2, 3), (5, 4), (30, 2), (60, 60)])
@pytest.mark.parametrize(("units", "scale"), [(SI, 1.0), (MM, 1000.0), (SI, 0.01)])
def test_rigid_body_modes_are_counted_in_any_units(kind: str, counts: tuple[int, int], units: dict, scale: float) -> None:
    mesh = rectangle(*counts, kind, a=0.1 * counts[0] * scale, b=0.1 * counts[1] * scale, shake=0.2 * (kind == "triangle"))
    assert fs.normal_modes(fs.plate(mesh, **units), count=2).rigid == 3
    if counts == (60, 60):
        return  # the small ones say the rest
    assert fs.normal_modes(fs.plate(mesh, **units, supports={"left": "simply supported"}), count=2).rigid == 1
    if counts != (1, 1):
        assert fs.normal_modes(fs.plate(mesh, **units, supports={"left": "clamped"}), count=2).rigid == 0


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-5])
def test_modes_of_a_small_plate_are_counted_in_any_size(scale: float) -> None:
    """w and w,xy differ by the fourth power of the cell size; neither inertia nor condition may be lost in that."""
    sub = fs.plate(rectangle(3, 2, "quad", a=A * scale, b=B * scale), **{**SI, "thickness": SI["thickness"] * scale})
    omega = fs.normal_modes(sub, count=6).frequencies
    found = fs.normal_modes(sub, band=(0.0, float((omega[6] + omega[7]) / 2)))
    assert (found.rigid, len(found.frequencies), found.counted[1]) == (3, 7, 7)


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_units_change_no_digit_beyond_rounding(kind: str) -> None:
    si, mm = (fs.normal_modes(fs.plate(rectangle(10, 8, kind, a=A * scale, b=B * scale), **units), count=8).frequencies
              for units, scale in ((SI, 1.0), (MM, 1e3)))
    assert np.abs(mm[3:] / si[3:] - 1).max() < 1e-9


def motions(sub: fs.Substructure) -> np.ndarray:
    """w = 1, x and y at the nodes, (n, 3); the slopes w,n of triangles are still missing."""
    assert sub.dofs is not None
    point, kind = sub.dofs.points, np.array(sub.dofs.labels)[sub.dofs.components]
    return np.column_stack([(kind == "w") * 1.0, (kind == "w") * point[:, 0] + (kind == "w,x"),
                            (kind == "w") * point[:, 1] + (kind == "w,y")])


def test_rigid_motion_costs_nothing_and_carries_the_whole_mass() -> None:
    mass = SI["rho"] * SI["thickness"] * A * B
    for kind in ("quad", "triangle"):
        sub = fs.plate(rectangle(5, 4, kind, shake=0.2 * (kind == "triangle")), **SI)
        r = motions(sub)
        if kind == "triangle":  # the slopes that w = x and w = y leave without energy are n
            edges = np.flatnonzero(sub.dofs.components == 1)
            for column in (1, 2):
                inner = sub.K[edges][:, edges]
                r[edges, column] = np.linalg.lstsq(inner.toarray(), -(sub.K @ r[:, column])[edges], rcond=None)[0]
            assert np.allclose(np.hypot(r[edges, 1], r[edges, 2]), 1)
            assert (r[edges, 1] > -1e-9).all() and (r[edges, 2][np.abs(r[edges, 1]) < 1e-9] > 0).all()  # to +x, else to +y
        assert np.abs(sub.K @ r).max() < 1e-13 * (abs(sub.K) @ np.abs(r)).max()
        assert np.allclose([r[:, 0] @ sub.M @ r[:, 0], r[:, 1] @ sub.M @ r[:, 1], r[:, 1] @ sub.M @ r[:, 2]],
                           [mass, mass * A**2 / 3, mass * A * B / 4], rtol=1e-12)
        assert (sub.K != sub.K.T).nnz == 0 and (sub.M != sub.M.T).nnz == 0


@pytest.mark.parametrize(("kind", "element"), [("quad", "ElementQuadBFS"), ("triangle", "ElementTriMorley")])
def test_matrices_are_those_of_scikit_fem(kind: str, element: str) -> None:
    """Same numbers, same numbering; only the edges' normals may point the other way."""
    import skfem
    from skfem.helpers import dd, ddot, eye, trace

    mesh, nu = rectangle(3, 2, kind, shake=0.2 * (kind == "triangle")), SI["nu"]
    grid = (skfem.MeshQuad if kind == "quad" else skfem.MeshTri)(mesh.points.T.copy(), mesh.cells.T.copy())
    basis = skfem.Basis(grid, getattr(skfem, element)(), intorder=6)

    def bending(u, v, w):  # type: ignore[no-untyped-def]
        return ddot((1 - nu) * dd(u) + nu * eye(trace(dd(u)), 2), dd(v))

    K = skfem.BilinearForm(bending).assemble(basis).toarray()
    M = skfem.BilinearForm(lambda u, v, w: u * v).assemble(basis).toarray()
    sub = fs.plate(mesh, **{**SI, "rho": 1 / SI["thickness"]})
    ours = sub.K.toarray() * 12 * (1 - nu**2) / (SI["E"] * SI["thickness"] ** 3)
    sign = signs(ours, K)
    assert (sign[:len(mesh.points) * (4 if kind == "quad" else 1)] == 1).all()
    assert np.abs(ours - K * np.outer(sign, sign)).max() < 1e-10 * np.abs(K).max()
    assert np.abs(sub.M.toarray() - M * np.outer(sign, sign)).max() < 1e-10 * np.abs(M).max()


def signs(ours: np.ndarray, K: np.ndarray) -> np.ndarray:
    """s with ours = s K s, spread from the first DOF along the largest entries."""
    sign = np.zeros(len(K))
    sign[0] = 1.0
    while not sign.all():
        known = np.flatnonzero(sign)
        strength = np.abs(K[known]) * (sign == 0)
        i, j = np.unravel_index(strength.argmax(), strength.shape)
        sign[j] = sign[known[i]] * np.sign(ours[known[i], j] * K[known[i], j])
    return sign


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_the_order_of_nodes_and_corners_does_not_matter(kind: str, rng: np.random.Generator) -> None:
    mesh = rectangle(5, 4, kind)
    place = rng.permutation(len(mesh.points))
    points = np.empty_like(mesh.points)
    points[place] = mesh.points
    cells = np.array([np.roll(cell, rng.integers(4))[::rng.choice([-1, 1])] for cell in place[mesh.cells]])
    other = fs.Mesh(np.column_stack([points, np.full(len(points), 2.5)]), cells, kind,
                    {"left": place[mesh.sets["left"]], "edge": place[mesh.sets["edge"]]}, numbers=np.arange(len(points)) + 100)
    for supports in ({"left": "clamped"}, {"edge": "simply supported"}):
        one, two = (fs.plate(m, **SI, supports=supports) for m in (mesh, other))
        assert one.size == two.size
        assert np.allclose(fs.normal_modes(one, count=5).frequencies, fs.normal_modes(two, count=5).frequencies, rtol=1e-10)
    sub = fs.plate(other, **SI, ports={"p": tuple(points[7])})
    assert sub.dofs.name(int(np.flatnonzero(sub.port("p"))[0])) == "w at node 107"
    assert np.allclose(sub.dofs.points[sub.dofs.find(107, "w")], points[7])


def test_supports_hold_what_they_should() -> None:
    quad = fs.plate(rectangle(4, 3, "quad"), **SI, supports={"left": "simply supported"})
    assert {quad.dofs.labels[quad.dofs.components[i]] for i in quad.dofs.find(1)} == {"w,x", "w,xy"}
    triangle = fs.plate(rectangle(4, 3, "triangle"), **SI, supports={"edge": "clamped"})
    # the diagonal of a corner's cell joins two nodes of the border, and is no part of it
    assert triangle.size == 3 * 2 + (3 * 12 + 4 + 3 - 2 * 7)


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_interface_and_ports(kind: str) -> None:
    mesh = rectangle(10, 8, kind)
    sub = fs.plate(mesh, **SI, supports={"left": "clamped"}, interface=("right",), ports={"pad": "patch", "end": "right"})
    assert len(sub.interface) == (9 * 4 if kind == "quad" else 9 + 8)
    assert np.allclose(sub.dofs.points[sub.interface, 0], A)
    level = (sub.dofs.components == 0).astype(float)
    assert np.isclose(sub.port("pad") @ level, 1) and np.isclose(sub.port("end") @ level, 1)
    w = sub.port("pad")[level == 1]
    assert w.max() > 1.5 * w[w > 0].min()  # by area: more inside the patch than on its rim


def interpolated(mesh: fs.Mesh, sub: fs.Substructure, f: Callable, fx: Callable, fy: Callable, fxy: Callable) -> np.ndarray:
    """f in the DOF of a free plate."""
    x, y = sub.dofs.points.T
    normal = np.zeros((sub.size, 2))
    if mesh.kind == "triangle":
        layout = Layout(mesh)
        normal[layout.rows[:, 3:]] = layout.shape[1]
    values = {"w": f(x, y), "w,x": fx(x, y), "w,y": fy(x, y), "w,xy": fxy(x, y),
              "w,n": normal[:, 0] * fx(x, y) + normal[:, 1] * fy(x, y)}
    return np.choose(sub.dofs.components, [values[label] for label in sub.dofs.labels])


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_a_port_on_cells_or_edges_is_their_mean(kind: str) -> None:
    """Of w = x² + 2xy + 3y², which both elements hold exactly: 3/2 + 1/2 - 1/6 over the unit square, and so on."""
    mesh = fs.rectangle((1.0, 1.0), (2, 2), kind)
    mesh = mesh.with_sets(all=np.arange(9), middle=lambda p: p[:, 0] == 0.5, two=[0, 8])
    half = np.flatnonzero((mesh.points[mesh.cells, 0] <= 0.5).all(axis=1))
    mesh = fs.Mesh(mesh.points, mesh.cells, kind, mesh.sets, {"half": half})
    sub = fs.plate(mesh, **SI, ports={key: key for key in ("all", "half", "edge", "right", "middle", "two")})
    u = interpolated(mesh, sub, lambda x, y: x**2 + 2 * x * y + 3 * y**2, lambda x, y: 2 * x + 2 * y, lambda x, y: 2 * x + 6 * y,
                     lambda x, y: 2 + 0 * x)
    sides = (1.0, 1 + 1 + 1, 1 / 3, 1 / 3 + 1 + 3)  # along x = 0, x = 1, y = 0, y = 1
    expected = {"all": 11 / 6, "half": 1 / 12 + 1 / 4 + 1, "edge": sum(sides) / 4, "right": sides[1], "middle": 7 / 4,
                "two": 3.0}
    for port, mean in expected.items():
        assert sub.port(port) @ u == pytest.approx(mean, rel=1e-12), port


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_a_port_along_the_rim_weighs_all_of_its_nodes(kind: str) -> None:
    mesh = fs.rectangle((1.0, 1.0), (8, 8), kind)  # of triangles, two corners are whole cells
    sub = fs.plate(mesh, **SI, ports={"e": "edge"})
    weighed = np.unique(sub.dofs.nodes[(sub.port("e") != 0) & (sub.dofs.components == 0)])
    assert np.isin(mesh.numbers[mesh.sets["edge"]], weighed).all() and len(mesh.sets["edge"]) == 32


def test_a_set_of_several_kinds_is_no_port() -> None:
    mesh = rectangle(4, 4, "quad").with_sets(mixed=[0, 1, 5, 6, 24], stray=[0, 1, 2, 24])
    for port, words in (("mixed", r"1 of the 5 nodes of the set 'mixed' belong to none of the cells .*\(number 25\)"),
                        ("stray", r"1 of the 4 nodes of the set 'stray' belong to none of the edges .*group of cells")):
        with pytest.raises(fs.InputError, match=words):
            fs.plate(mesh, **SI, ports={"p": port})


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_a_port_along_a_support_is_refused(kind: str) -> None:
    for support in ("simply supported", "clamped"):
        with pytest.raises(fs.InputError, match="sits on DOF that the supports hold"):
            fs.plate(rectangle(4, 4, kind), **SI, supports={"edge": support}, ports={"p": "left"})


@pytest.mark.parametrize("kind", ["quad", "triangle"])
@pytest.mark.parametrize("supports", [{"left": "clamped"}, {}])
@pytest.mark.parametrize("method", [fs.CraigBampton(modes=8), fs.CraigChang(modes=8)])
def test_reduced_models_bound_from_above(kind: str, supports: dict, method: fs.CraigBampton | fs.CraigChang) -> None:
    sub = fs.plate(rectangle(8, 6, kind), **SI, supports=supports, interface=("right",), ports={"pad": "patch"})
    full, rom = fs.normal_modes(sub, count=6), fs.normal_modes(fs.reduce(sub, method, ports=True), count=6)
    error = rom.eigenvalues[rom.rigid:] / full.eigenvalues[full.rigid:] - 1
    assert rom.rigid == full.rigid and error.min() > -1e-8 and error[:3].max() < 1e-2


SKEWED = fs.Mesh([[0, 0], [1, 0], [1.2, 1], [0, 1]], [[0, 1, 2, 3]], "quad")
SOLID = fs.Mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]], "tetra")


@pytest.mark.parametrize(("arguments", "words"), [
    ({"thickness": -1.0}, "thickness must be positive"), ({"E": 0.0}, "E must be positive"), ({"nu": 0.5}, "between -1 and 0.5"),
    ({"nu": -1.0}, "between -1 and 0.5"), ({"rho": float("nan")}, "rho must be a finite number"),
    ({"mesh": SOLID}, "a plate needs triangle or quad cells, but 'mesh' has tetra"), ({"mesh": "disc.msh"}, "must be a Mesh"),
    ({"mesh": SKEWED}, "1 quads of 'mesh' are not axis-parallel rectangles.* triangles"),
    ({"mesh": fs.Mesh([[0, 0], [1, 0], [2, 0]], [[0, 1, 2]], "triangle")}, "1 triangles of 'mesh' are flat"),
    ({"mesh": fs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 1]], [[0, 1, 2]], "triangle")}, "plane of constant z"),
    ({"mesh": fs.Mesh([[0, 0], [1, 0], [0, 1], [5, 5]], [[0, 1, 2]], "triangle")}, "1 node of 'mesh' belongs to no cell"),
    ({"supports": {"rim": "clamped"}}, "unknown set of nodes"), ({"supports": {"left": "simply suported"}}, "did you mean"),
    ({"supports": ["left"]}, "supports must be a dict of names of sets"), ({"interface": "left"}, "a list of names of sets"),
    ({"interface": ("left",), "supports": {"left": "clamped"}}, "held by the supports"),
    ({"ports": {"p": "hub"}}, "unknown set of nodes"), ({"ports": {"p": (9.0, 9.0)}}, r"nearest is number 12 at \(1, 0.7\)"),
    ({"ports": {"p": 3}}, "name of a set or a place"), ({"ports": {"p": "left"}, "supports": {"left": "clamped"}}, "DOF that"),
])
def test_plate_refuses(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        fs.plate(**{"mesh": rectangle(3, 2, "quad"), **SI, **arguments})


def test_cells_too_narrow_for_the_plate_are_told() -> None:
    mesh = fs.rectangle((1.0, 2e-4), (2, 2))
    with pytest.warns(fs.ConditionWarning, match="rounding may take 1e.00 of the lowest frequencies.*take larger cells"):
        fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=1e-6)
