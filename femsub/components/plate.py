"""The Kirchhoff plate: Morley triangles, or conforming rectangles of Bogner, Fox and Schmit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from femsub.checks import (
    EQUAL,
    POSITION,
    Array,
    InputError,
    InputTypeError,
    Matrix,
    choice,
    finite_number,
    instance,
    items,
    naming,
    positive_number,
)
from femsub.components.bending_elements import (
    CORNERS,
    HERMITE_MEAN,
    OPPOSITE,
    bfs_integrals,
    bfs_matrices,
    morley_edge_integrals,
    morley_integrals,
    morley_matrices,
)
from femsub.components.build import component, gathered, node_at, optional_mapping, warn_of_rounding
from femsub.components.mesh import Mesh, edges_of, edges_within, sides_of
from femsub.components.mesh_checks import refuse_spoilt
from femsub.components.patches import patch
from femsub.components.solid_assembly import Material
from femsub.model import DofMap, Substructure

SUPPORTS = ("free", "simply supported", "clamped")


def plate(mesh: Mesh, *, E: float, nu: float, rho: float, thickness: float, supports: Mapping[str, str] | None = None,
          interface: Sequence[str] = (), ports: Mapping[str, Any] | None = None,
          rayleigh: tuple[float, float] | None = None, name: str = "plate") -> Substructure:
    """A thin (Kirchhoff) plate in bending, of Morley triangles or of conforming rectangles.

    K = Σ_e ∫ B (w,xx² + w,yy² + 2ν w,xx w,yy + 2(1 - ν) w,xy²) dA, M = Σ_e ∫ ρh w² dA as matrices (n, n), with
    B = Eh³/12(1 - ν²), without rotary inertia and shear: B ΔΔw + ρh ẅ = 0. A simply supported rectangle a x b has
    ω² = π⁴ (j²/a² + k²/b²)² B/ρh. For rectangles ω² is too high, and its error falls with the fourth power of the cell size.
    For triangles the error falls with the square and may have either sign (the Morley element is nonconforming).

    Rectangles (kind 'quad', axis-parallel) have the DOF w, w,x, w,y, w,xy at each node. Triangles have w at each node
    and w,n in the middle of each edge; n points to +x, or to +y if the edge is parallel to x. In the DOF map the edges
    follow the nodes and continue the node numbers.

    Any consistent units: m, kg, s with E in Pa; or mm, t, s with E in MPa, rho in t/mm³ (steel: 7.85e-9). ω is in rad/s
    in both systems.

    Parameters
    ----------
    mesh : Mesh
        'triangle' or 'quad' cells; 3D points must lie in a plane of constant z.
    E, nu, rho, thickness : float
        Young's modulus, Poisson's ratio in (-1, 0.5), density, thickness h.
    supports : mapping of set name to str
        'simply supported' (w = 0 along the set), 'clamped' (the slopes too) or 'free'. The edges of a set are the edges
        with both nodes in it; between two nodes of the border only edges of the border count.
    interface : sequence of set names
        All DOF of these nodes (and edges) that are not held become interface DOF. Each set names an interface set.
    ports : mapping of str to set name, or to the place (x, y) of a node
        The mean of w over a set, or w at the node. For a set of nodes the mean is taken over the cells within it if they
        contain all its nodes; otherwise over its edges (between two nodes of the border only edges of the border); otherwise
        over its nodes. For a group of cells it is taken over the cells. A mixed set is refused. Means over cells and edges are
        integrals of the element's shape functions, slopes included.
    rayleigh : (alpha, beta), optional
        D = αM + βK; use `damped` for any other damping.

    Warns
    -----
    ConditionWarning
        Cells are so small or narrow that rounding may change the lowest frequencies by a relative 1e-6 or more.

    Raises
    ------
    InputError, InputTypeError
        Another kind of mesh, quads that are not axis-parallel rectangles, flat triangles, nodes without a cell, an
        unknown set or support, a constant out of range, an interface or a port that is held.

    References
    ----------
    Bogner, Fox and Schmit, Proc. Conf. Matrix Methods in Structural Mechanics, 1965 (rectangle); Morley, Aero. Quart.
    19 (1968) (triangle).

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.rectangle((1.0, 0.5), (4, 2))
    >>> plate = fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, supports={"edge": "simply supported"})
    >>> print(f"{fs.normal_modes(plate, 1).frequencies[0]:.0f} rad/s")
    774 rad/s
    """
    instance("mesh", mesh, Mesh)
    if mesh.kind not in ("triangle", "quad"):
        raise InputError(f"a plate needs triangle or quad cells, but {mesh.name!r} has {mesh.kind}")
    steel, h = Material(E, nu, rho), positive_number("thickness", thickness)
    refuse_spoilt(mesh)
    layout = Layout(mesh)
    bending = steel.E * (h * h * h) / (12 * (1 - steel.nu**2))
    supports = optional_mapping("supports", supports, "names of sets and kinds, as {'edge': 'clamped'}")
    ports = optional_mapping("ports", ports, "names and places, as {'belt': 'patch'}")
    interface = items("interface", interface, "names of sets")
    K, M = layout.matrices(steel.nu)
    K = bending * K
    sides = np.ptp(layout.plane, axis=0)
    warn_of_rounding(K, layout.w, bending * sides.prod() / sides.max() ** 4, name, "take larger cells", growth=0.7)
    with naming("supports"):
        held = np.concatenate([*(layout.held(mesh.nodes(where), kind) for where, kind in supports.items()),
                               np.zeros(0, dtype=int)])
    with naming("interface"):
        joined = {str(where): layout.all_of(mesh.nodes(where)) for where in interface}
    return component(
        K, steel.rho * h * M, held, joined,
        {port: layout.column(where, port, held) for port, where in ports.items()}, layout.dofs(), rayleigh, name)


class Layout:
    """The numbering of a plate's DOF: `step` DOF at each node of `plane` (n, 2), the first is `w` (n,); then one for each edge.

    Only triangles have DOF at edges. `rows` (m, k) are the DOF of each cell, and `shape` are the arrays that describe the cells'
    geometry for integrals.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.plane = mesh, mesh.points[:, :2]
        if mesh.points.shape[1] == 3 and np.ptp(mesh.points[:, 2]) > EQUAL * np.ptp(self.plane, axis=0).max():
            raise InputError(f"a plate lies in a plane of constant z, but z of {mesh.name!r} runs from "
                             f"{mesh.points[:, 2].min():.6g} to {mesh.points[:, 2].max():.6g}")
        self.triangles = mesh.kind == "triangle"
        self.step = 1 if self.triangles else 4
        self.ends, self.of_cell, self.border = edges_of(mesh)
        self.w = self.step * np.arange(len(self.plane))
        self.size = self.step * len(self.plane) + self.triangles * len(self.ends)
        self.rows, self.shape = self._triangles() if self.triangles else self._rectangles()

    def matrices(self, nu: float, cells: Array | slice = slice(None)) -> tuple[Matrix, Matrix]:
        """K and M of all cells, or of some, for unit bending stiffness and unit mass per area."""
        of_cells: Callable[..., tuple[Array, Array]] = morley_matrices if self.triangles else bfs_matrices
        shape = [values[cells] for values in self.shape]
        return gathered(self.rows[cells], self.size, lambda part: of_cells(*(values[part] for values in shape), nu=nu))

    def _triangles(self) -> tuple[Array, tuple[Array, ...]]:
        """The DOF of each cell, its corners (m, 3, 2), and the normals of the edges opposite the corners (m, 3, 2)."""
        cells, edges = self.mesh.cells, self.of_cell[:, [1, 2, 0]]
        corners = self.plane[cells]
        span = np.stack([corners[:, k] - corners[:, j] for j, k in OPPOSITE], axis=1)
        area = np.abs(span[:, 0, 0] * span[:, 1, 1] - span[:, 0, 1] * span[:, 1, 0])
        flat = area <= EQUAL * np.einsum("mid,mid->mi", span, span).max(axis=1)
        if flat.any():
            raise InputError(f"{int(flat.sum())} triangles of {self.mesh.name!r} are flat. The first is cell "
                             f"{int(flat.argmax())}, counted from 0. Mesh that part anew")
        # unit normals of the edges (f, 2), pointing to +x, or to +y if the edge is parallel to x
        along = self.plane[self.ends[:, 1]] - self.plane[self.ends[:, 0]]
        along = along / np.linalg.norm(along, axis=1)[:, None]
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
        leading = np.where(np.abs(normal[:, 0]) > POSITION, normal[:, 0], normal[:, 1])
        normal = normal * np.sign(leading)[:, None]
        return np.hstack([cells, len(self.plane) + edges]), (corners, normal[edges])

    def _rectangles(self) -> tuple[Array, tuple[Array, ...]]:
        """The DOF of each cell, with corners in the order of CORNERS, and its sides (m, 2)."""
        corners = self.plane[self.mesh.cells]
        low, high = corners.min(axis=1), corners.max(axis=1)
        sides = high - low
        with np.errstate(divide="ignore", invalid="ignore"):
            place = (corners - low[:, None, :]) / sides[:, None, :]
        nearest = np.rint(place)
        right = np.abs(place - nearest).max(axis=(1, 2)) <= POSITION  # also False for a side of length 0
        code = nearest[..., 0] * 2 + nearest[..., 1]
        order = np.argsort(code, axis=1)
        right &= (np.sort(code, axis=1) == np.arange(4)).all(axis=1)
        if not right.all():
            raise InputError(f"{int((~right).sum())} quads of {self.mesh.name!r} are not axis-parallel rectangles. The first is "
                             f"cell {int(right.argmin())}, counted from 0. Mesh the plate with triangles, or rotate it")
        order = order[:, [2 * i + j for i, j in CORNERS]]
        cells = np.take_along_axis(self.mesh.cells, order, axis=1)
        return (4 * cells[:, :, None] + np.arange(4)).reshape(len(cells), 16), (sides,)

    def held(self, nodes: Array, kind: Any) -> Array:
        """The DOF that a support holds along a set."""
        if choice("support", kind, SUPPORTS) == "free":
            return np.zeros(0, dtype=int)
        if kind == "clamped":
            return self.all_of(nodes)
        if self.triangles:
            return nodes
        ends = self.ends[edges_within(self.ends, self.border, nodes)]
        along = np.abs(self.plane[ends[:, 1]] - self.plane[ends[:, 0]]).argmax(axis=1)  # 0: along x, so w,x is zero as well
        return np.concatenate([4 * nodes, (4 * ends + 1 + along[:, None]).ravel()])

    def all_of(self, nodes: Array) -> Array:
        """All DOF of the nodes and of the edges in a set."""
        at_nodes = (self.step * nodes[:, None] + np.arange(self.step)).ravel()
        edges = np.flatnonzero(edges_within(self.ends, self.border, nodes)) if self.triangles else nodes[:0]
        return np.concatenate([at_nodes, len(self.plane) + edges])

    def column(self, where: Any, port: str, held: Array) -> Array:
        """The column, for all DOF, that gives the mean of w over a set, or w at a node."""
        w = np.zeros(self.size)
        if isinstance(where, str):
            found = patch(self.mesh, where, f"port {port!r}")
            if found.kind == "nodes":
                w[self.w[found.nodes]] = 1.0
            elif found.kind == "cells":
                over = morley_integrals if self.triangles else bfs_integrals
                np.add.at(w, self.rows[found.cells], over(*(values[found.cells] for values in self.shape)))
            elif not np.isin(self.w[found.nodes], held).all():  # along a support w is 0 (for triangles at nodes only)
                if self.triangles:  # ∫ φ ds. Between two triangles, whose functions differ there, the mean of both sides counts
                    corners, normals = (values[found.cells] for values in self.shape)
                    rows, integrals = self.rows[found.cells], morley_edge_integrals(corners, normals, (found.sides + 2) % 3)
                else:  # a cubic on each edge
                    ends = self.mesh.cells[found.cells[:, None], sides_of("quad", "edges")[found.sides]]
                    along = self.plane[ends[:, 1]] - self.plane[ends[:, 0]]
                    axis = np.abs(along).argmax(axis=1)
                    step = np.take_along_axis(along, axis[:, None], axis=1)
                    rows = 4 * np.repeat(ends, 2, axis=1)
                    rows[:, 1::2] += 1 + axis[:, None]
                    integrals = np.abs(step) * HERMITE_MEAN * np.where(np.arange(4) % 2, step, 1.0)
                np.add.at(w, rows, found.share[:, None] * integrals)
            lift = w[self.w].sum()  # the integral of w = 1
            return w / lift if lift else w
        if not isinstance(where, (Sequence, np.ndarray)) or len(where) != 2:
            raise InputTypeError(f"port {port!r} must be the name of a set or a place (x, y), not {where!r:.80}")
        place = [finite_number(f"port {port!r}", value) for value in where]
        near = POSITION * np.ptp(self.plane, axis=0).max()
        w[self.w[node_at(self.plane, self.mesh.numbers, place, f"port {port!r}", near)]] = 1.0
        return w

    def dofs(self) -> DofMap:
        """The DOF map: w, w,x, w,y, w,xy at nodes; or w at nodes and w,n in the middle of edges, with the next numbers."""
        numbers = self.mesh.numbers.astype(np.int64)
        if not self.triangles:
            return DofMap(np.repeat(numbers, 4), np.tile(np.arange(4), len(numbers)), ("w", "w,x", "w,y", "w,xy"),
                          np.repeat(self.plane, 4, axis=0))
        count = len(self.ends)
        middle = self.plane[self.ends].mean(axis=1)
        return DofMap(np.concatenate([numbers, numbers.max() + 1 + np.arange(count)]),
                      np.repeat([0, 1], [len(numbers), count]), ("w", "w,n"), np.vstack([self.plane, middle]))
