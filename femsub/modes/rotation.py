"""A solid that turns about its axis of symmetry, seen from a fixed frame: gyroscopic, convective and prestress terms.

The mesh stands still and the material flows through it. u(x, t) is the displacement, in fixed Cartesian components, of the
particle that would be at the place x without vibration. The time derivative that follows a particle is then ∂/∂t + Ω∂_θ, with
∂_θ = (e × x)·∇, which acts on Cartesian components as on scalars. So

    ρ(ü + 2Ω ∂_θ u̇ + Ω² ∂_θ² u) = div(σ + ∇u Ω²σ₀)

where σ₀ is the stress that the centrifugal load causes at Ω = 1. Integrated by parts, without boundary terms because the body
looks the same from every angle:

    M ü + (D + Ω D_G) u̇ + (K + Ω² (K_R + K_geo)) u = f,
    D_G = 2 ∫ρ v·∂_θ u,   K_R = -∫ρ ∂_θ v·∂_θ u,   K_geo = ∫ ∇v:(∇u σ₀).

All three act on each Cartesian component alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from femsub.algebra import Frozen
from femsub.checks import (
    POSITION,
    Array,
    FemsubWarning,
    InputError,
    InputTypeError,
    Matrix,
    choice,
    finite_number,
    instance,
    real_array,
    warn,
)
from femsub.components import KINDS, Material, Mesh, Pattern, at_points, boundary_faces, corner_nodes, materials_of, node_rows
from femsub.model import TRANSLATIONS, Substructure
from femsub.modes.shift_invert import ShiftInvert

TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False, repr=False)
class Rotor(Frozen):
    """A part that turns about its axis of symmetry, in a fixed frame, at any speed; `rotating` makes one.

    M ü + (D + Ω D_G) u̇ + (K + Ω² K_Ω) u = f, all (n, n): an affine family in Ω and Ω².

    Attributes
    ----------
    part : Substructure
        The part at rest: M, D, K, interface and ports.
    gyroscopic : sparse, shape (n, n)
        D_G, exactly skew, in mass.
    centrifugal : sparse, shape (n, n)
        K_Ω = K_R + K_geo, exactly symmetric, in mass.
    axis : ndarray, shape (3,)
        The unit vector e; a positive speed turns from x to y where e = z.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.annulus(0.05, 0.15, 0.01, (1, 12, 1)), fs.Material(2.1e11, 0.3, 7850.0)
    >>> rotor = fs.rotating(fs.solid(mesh, steel, supports=["inner"]), mesh, steel)
    >>> rotor
    Rotor 'annulus': 252 DOF, turns about (0, 0, 1)
    >>> turning = rotor.at(50.0)  # a Substructure, to be reduced, coupled and analysed as any other
    >>> float(abs(turning.D + turning.D.T).max())  # no damping, but a skew D
    0.0
    """

    part: Substructure
    gyroscopic: Matrix
    centrifugal: Matrix
    axis: Array

    def __repr__(self) -> str:
        axis = ", ".join(f"{x:.4g}" for x in self.axis)
        return f"Rotor {self.part.name!r}: {self.part.size} DOF, turns about ({axis})"

    def at(self, speed: float) -> Substructure:
        """The part turning at a speed Ω in rad per unit of time: K + Ω²K_Ω is symmetric, D + ΩD_G is not.

        Above the lowest critical speed (where a wave runs as fast as the material, ω = mΩ) the stiffness has negative
        eigenvalues. Complex modes are still correct there, but bases for reduction need a lower speed.
        """
        omega = finite_number("speed", speed)
        return replace(self.part, D=self.part.D + omega * self.gyroscopic, K=self.part.K + omega**2 * self.centrifugal)


def rotating(part: Substructure, mesh: Mesh, material: Material | Mapping[str, Material], *,
             axis: str | Sequence[float] = "z", centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Rotor:
    """The matrices of a solid that turns about its axis of symmetry, in a fixed frame.

    The mesh stands still while the material flows through it. With ∂_θ = (e × x)·∇ on Cartesian components,

        D_G = 2 ∫ρ v·∂_θ u dV,   K_Ω = ∫ ∇v:(∇u σ₀) dV - ∫ρ ∂_θ v·∂_θ u dV,

    where σ₀ is the stress due to the centrifugal load at Ω = 1, with the part's supports held and its interface free. D_G is made
    exactly skew. A wave with m nodal diameters and the frequency ω in the turning frame has ω + mΩ in the fixed frame if it runs
    with the material, and ω - mΩ if it runs against the material.

    Supports, interface and ports are fixed in space. The part's own D is taken as damping from outside. Damping of the
    turning material would also add ΩD∂_θ to K; that circulatory term is not included.

    Parameters
    ----------
    part : Substructure
        The solid at rest, as `solid` makes it from the same mesh and material. Supports should go all the way round.
    mesh : Mesh
        Its mesh.
    material : Material, or mapping of str to Material
        As for `solid`.
    axis : str or sequence of float, shape (3,)
        'x', 'y', 'z', or a vector, which is normalised.
    centre : sequence of float, shape (3,)
        A point of the axis.

    Raises
    ------
    InputError
        The body, or one of its materials, is not round about the axis: somewhere its surface faces along the circumference (a
        hole, a tooth), by more than the coarseness of its faces explains. Or 1 % of the centrifugal load or of its moments is not
        balanced. Or the part is not made from this mesh and material, or the axis has the length 0.
    InputTypeError
        The part has no DOF of solid elements: it is a beam, a plate, a reduced or a coupled part.

    Warns
    -----
    FemsubWarning
        Supports that do not go all the way round.

    References
    ----------
    U. Nackenhorst, The ALE-formulation of bodies in rolling contact, Comput. Methods Appl. Mech. Eng. 193 (2004) 4299-4322.
    G. Genta, Dynamics of Rotating Systems (2005), has the same terms in the turning frame.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.annulus(0.05, 0.15, 0.01, (1, 16, 1)), fs.Material(2.1e11, 0.3, 7850.0)
    >>> disc = fs.rotating(fs.solid(mesh, steel, supports=["inner"]), mesh, steel).at(100.0)
    >>> waves = fs.complex_modes(disc, count=10).eigenvalues.imag
    >>> waves[waves > 0].round(-1)
    array([7000., 7170., 7200., 7770., 8170.])
    """
    # a full component of solid elements
    instance("mesh", mesh, Mesh)
    instance("part", part, Substructure, "a solid at rest, see solid")
    if type(part) is not Substructure:
        raise InputTypeError(f"part must be a full component, but {part.name!r} is a {type(part).__name__}. Turn the components "
                             "first, then reduce or couple what `at` gives")
    if mesh.kind not in KINDS:
        raise InputTypeError(f"the mesh {mesh.name!r} has {mesh.kind} cells. Only solids can turn: one of {', '.join(KINDS)}")
    dofs = part.dofs
    if dofs is None or dofs.labels != TRANSLATIONS:
        found = "no DOF map" if dofs is None else f"the DOF {', '.join(dofs.labels)}"
        raise InputTypeError(f"part must be a solid with the DOF {', '.join(TRANSLATIONS)}, but {part.name!r} has {found}. Beams "
                             "and plates cannot turn")
    parts = materials_of(mesh, material)

    # the axis
    if isinstance(axis, str):
        e = np.eye(3)["xyz".index(choice("axis", axis, "xyz"))]
    else:
        e = real_array("axis", axis)
        length = float(np.linalg.norm(e)) if e.shape == (3,) else 0.0
        if not 0 < length < np.inf:
            raise InputError(f"axis must be 'x', 'y', 'z' or three numbers that are not all 0, not {axis!r:.60}")
        e = e / length
    middle = real_array("centre", centre)
    if middle.shape != (3,):
        raise InputError(f"centre must be three numbers, a point of the axis, not {centre!r:.60}")
    across = np.cross(e, np.eye(3)).T  # across @ x = e × x
    around = (mesh.points - middle) @ across.T
    radius = np.linalg.norm(around, axis=1)

    # no surface of the body, or of a material in it, may face along the circumference, as the wall of a hole does: on a surface
    # of revolution (e × x)·n = 0. The normal at a corner, averaged over its faces, may deviate by half the extent of these faces
    # around the axis. A fifth is added for coarse faces on curved surfaces, such as rounded edges
    for one, members in parts:
        body = mesh if len(parts) == 1 else Mesh(mesh.points, mesh.cells[members], mesh.kind)
        faces = corner_nodes(body, *boundary_faces(body))
        corners = mesh.points[faces] - middle
        areas = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        unit = areas / np.maximum(np.linalg.norm(areas, axis=1), TINY)[:, None]
        normals, extent = np.zeros_like(mesh.points), np.zeros(len(mesh.points))
        np.add.at(normals, faces, unit[:, None])
        turn = corners.mean(axis=1) @ across.T
        wide = np.ptp(np.einsum("fca,fa->fc", corners, turn), axis=1) / np.maximum(np.linalg.norm(turn, axis=1), TINY)
        np.maximum.at(extent, faces, wide[:, None])
        nodes = np.unique(faces)
        along = np.abs(np.einsum("na,na->n", normals[nodes], around[nodes]))
        sizes = np.linalg.norm(normals[nodes], axis=1) * radius[nodes]
        bad = nodes[along * radius[nodes] > (extent[nodes] / 2 + 0.2 * radius[nodes]) * sizes]
        if len(bad):
            place = ", ".join(f"{x:.4g}" for x in mesh.points[bad[0]])
            which = "" if len(parts) == 1 else f" of the material {one}"
            raise InputError(f"{mesh.name!r} is not round about the axis: at {len(bad)} of the {len(nodes)} corners on the "
                             f"surface{which} this faces along the circumference, one of them at ({place}). In a fixed frame its "
                             "matrices would change with time. Check axis and centre, or mesh the part without holes, slots and "
                             "teeth")

    # for each DOF of the part its row among the 3n DOF of the mesh
    nodes = node_rows(mesh, dofs.nodes)
    if dofs.points is not None:
        apart = np.abs(dofs.points - mesh.points[nodes]).max(axis=1)
        if apart.max() > POSITION * np.ptp(mesh.points, axis=0).max():
            raise InputError(f"node {dofs.nodes[apart.argmax()]} of {part.name!r} lies {apart.max():.3g} from its place in the "
                             f"mesh {mesh.name!r}. Give the mesh that the part was made from")
    rows = 3 * nodes + dofs.components

    # the centrifugal load ∫ρ N_i x_⊥ dV (n, 3), with x_⊥ the vector from the axis, and the masses ∫ρ N_i² dV (n,)
    count = len(mesh.points)
    load, masses, size = np.zeros((count, 3)), np.zeros(count), 0.0
    for one, members, N, root, _ in at_points(mesh, parts):
        cells = mesh.cells[members]
        away = -((N @ mesh.points[cells] - middle) @ (across @ across).T)
        weight = one.rho * root**2
        forces = N.T @ (weight[..., None] * away)
        for direction in range(3):
            load[:, direction] += np.bincount(cells.ravel(), forces[..., direction].ravel(), count)
        masses += np.bincount(cells.ravel(), (weight @ N**2).ravel(), count)
        size += float((weight * np.linalg.norm(away, axis=-1)).sum())
    force, moments = load.sum(axis=0), load.T @ (mesh.points - middle)
    # ∫ρ x_⊥ xᵀ dV, which is the same in all directions across the axis
    uneven = np.linalg.norm(moments + np.trace(moments) / 2 * across @ across) / np.trace(moments)
    left = max(float(np.linalg.norm(force)) / size, float(uneven))
    if left > 0.01:  # meshes of round bodies have far less
        raise InputError(f"{mesh.name!r} is not balanced about the axis: {left:.2%} of the centrifugal load or of its moments "
                         "are left over. Check axis, centre and materials, or whether the body is round")
    ratio = float(part.M.diagonal().sum() / masses[rows // 3].sum())
    if not 0.1 < ratio < 10:  # lumped masses change it less, and other units more
        raise InputError(f"the masses of {part.name!r} are {ratio:.3g} times those of the mesh {mesh.name!r} with this material. "
                         "Give the mesh, material and units that the part was made with")

    # the displacements under this load; in a body held all the way round they are not along the circumference
    field = np.zeros(3 * count)
    field[rows] = ShiftInvert(part.K, part.M).elastic_solve(load.ravel()[rows, None])[:, 0]
    field = field.reshape(-1, 3)
    swirl = np.einsum("na,na->n", field, around) / np.maximum(radius, TINY)
    share = float(np.linalg.norm(swirl) / np.linalg.norm(field))
    if share > 0.1:  # coarse meshes with round supports have less
        warn(f"{part.name!r}: {share:.0%} of the displacement under the centrifugal load is along the circumference, so "
             "its supports do not go all the way round. They stand still in space and do not turn with the part. Hold "
             "whole rings of nodes", FemsubWarning)
    gyroscopic, centrifugal = (matrix[rows][:, rows] for matrix in turning(mesh, parts, across, middle, field))
    return Rotor(part, gyroscopic, centrifugal, e)


def turning(mesh: Mesh, parts: list[tuple[Material, Array]], across: Array, centre: Array,
             field: Array) -> tuple[Matrix, Matrix]:
    """D_G and K_Ω (3n, 3n), with the stress of the displacements `field` (n, 3)."""
    pattern = Pattern(mesh.cells, len(mesh.points))
    total = np.zeros((pattern.size, 2))
    for material, members, N, root, G in at_points(mesh, parts):
        cells = mesh.cells[members]
        m, q, k, _ = G.shape
        around = (N @ mesh.points[cells] - centre) @ across.T
        S, T = N * root[..., None], (G @ around[..., None])[..., 0]  # root times N and times ∂_θ N
        rate = S.swapaxes(1, 2) @ T
        gradient = field[cells].swapaxes(1, 2)[:, None] @ G / root[..., None, None]
        lam, mu = material.lame
        trace = np.trace(gradient, axis1=-2, axis2=-1)[..., None, None]
        stress = lam * trace * np.eye(3) + mu * (gradient + gradient.swapaxes(-1, -2))
        pulled = (G @ stress).swapaxes(1, 2).reshape(m, k, 3 * q)
        stiffness = pulled @ G.swapaxes(2, 3).reshape(m, 3 * q, k) - material.rho * (T.swapaxes(1, 2) @ T)
        both = np.stack([material.rho * (rate - rate.swapaxes(1, 2)), stiffness], axis=-1)
        keep, blocks, add = pattern.places(members)
        total[blocks] += add @ both.reshape(-1, 2)[keep]
    return pattern.spread_diagonal(total[:, 0], skew=True), pattern.spread_diagonal(total[:, 1])
