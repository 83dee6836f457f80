"""`Tied`: surfaces of solids whose meshes do not match, glued by a mortar condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, InputError, InputTypeError, Matrix, instance, mapping, naming, positive_number, word
from femsub.components import Facing, Mesh, Surface, common_points, reach, reference
from femsub.coupling.joints import End, Joint, Link, nearest, site, stacked, title

if TYPE_CHECKING:
    from femsub.model import DofMap, Substructure


@dataclass(frozen=True, eq=False)
class Tied(Joint):
    """Two surfaces of solids whose meshes do not match, glued (mortar method).

    ∫ ψ_i (u_a - u_b) dA = 0 for every node i of the first surface. The integrals are taken over the common parts of the faces
    of both surfaces. A state of constant stress is represented exactly, and the error falls with the order of the elements. For
    linear elements ψ are dual functions, which keep the equations sparse; for quadratic elements they are the shape functions.

    Parameters
    ----------
    first, second : (part, set)
        Interface sets of two solids. The nodes of the first surface follow the second. Give the finer surface first, or the
        surface that lies within the other: all its faces must lie on the second surface.
    meshes : mapping of str to Mesh
        The meshes of both parts, by the names of the parts, with node sets of the same names. A `Facing` as `first` replaces
        both surfaces, meshes and tol.
    tol : float, optional
        The largest distance between the surfaces, in units of length; by default 0.05 of the size of a face.
    name : str
        Used in messages and for multipliers.

    Raises
    ------
    InputError
        In `couple`: surfaces that lie apart; a first surface that reaches beyond the second; nodes that are not in the interface.

    References
    ----------
    B. I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989 (dual functions); M. A. Puso, Int. J. Numer. Meth. Eng. 59 (2004) 315
    (common parts of faces in space).

    Examples
    --------
    >>> import femsub as fs
    >>> steel, fine, coarse = fs.Material(2.1e11, 0.3, 7850.0), fs.block((1, 1, 1), (3, 3, 3)), fs.block((1, 1, 1), (2, 2, 2))
    >>> parts = {"a": fs.solid(fine, steel, interface=["left"]), "b": fs.solid(coarse, steel, interface=["left"])}
    >>> system = fs.couple(parts, [fs.Tied(("a", "left"), ("b", "left"), {"a": fine, "b": coarse})])
    >>> sum(part.size for part in parts.values()) - system.size == 3 * len(fine.sets["left"])
    True
    """

    first: End
    second: End = None
    meshes: Mapping[str, Mesh] = field(default_factory=dict)
    tol: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.first, Facing):
            unpacked(self, self.first, self.first.first, self.first.second)
        word("name", self.name)
        for key, mesh in mapping("meshes", self.meshes, "the parts' names and meshes").items():
            instance(f"the mesh of {key!r}", mesh, Mesh)
        if self.tol is not None:
            positive_number("tol", self.tol)

    def __repr__(self) -> str:
        return self.name or f"Tied({title(self.first)}, {title(self.second)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation for each DOF of the first surface."""
        both = []
        for name, end in (("first", self.first), ("second", self.second)):
            with naming(name):
                found = site(parts, end)
                if not found.named or found.dofs is None or found.dofs.points is None:
                    raise InputTypeError(f"{found.title} must be a named interface set of a solid, whose DOF have known places")
                if found.part not in self.meshes:
                    raise InputError(f"the mesh of {found.part!r} is missing: give meshes={{{found.part!r}: mesh, ...}}")
                both.append((found, Surface.of(self.meshes[found.part], end[1].rpartition(".")[2], found.title)))
        (one, ours), (other, theirs) = both
        T = mortar(ours, theirs, self.tol, f"{one.title} and {other.title}")
        assert one.dofs is not None and other.dofs is not None
        blocks = []
        for label in dict.fromkeys(one.dofs.labels[k] for k in one.dofs.components):
            mine, yours = motion_of_nodes(one.dofs, ours, label), motion_of_nodes(other.dofs, theirs, label)
            if (held := np.diff(mine.indptr) == 0).any():
                count = int(held.sum())
                raise InputError(f"{label} of {count} node{'s' * (count != 1)} of {one.title} is held, or no interface DOF, e.g. "
                                 f"of node {ours.numbers[int(held.argmax())]}: release it, or let {other.title} come first")
            blocks.append([(one.part, mine @ one.chosen()), (other.part, -T @ yours @ other.chosen())])
        return Link(stacked(*blocks))


def unpacked(joint: Any, found: Facing, first: Any, second: Any) -> None:
    """Copies the surfaces, meshes and tolerance of a `Facing`, given as first surface, into the fields of a joint."""
    if joint.second is not None or joint.meshes:
        raise InputTypeError("what fs.facing found stands for both surfaces and their meshes: give no second and no meshes")
    for key, value in (("first", first), ("second", second), ("meshes", found.meshes),
                       ("tol", found.tol if joint.tol is None else joint.tol)):
        object.__setattr__(joint, key, value)


def mortar(ours: Surface, theirs: Surface, tol: float | None, what: str, *, missing: float = 1e-3) -> Matrix:
    """T = D⁻¹B (n, m), sparse, with u = T v: the displacements u of our nodes glued to the other surface with displacements v.

    D_ij = ∫ ψ_i N_j dA and B_ik = ∫ ψ_i N'_k dA over the common parts of our faces and theirs. A share `missing` of the area of
    each of our faces may lie beside the other surface.

    Raises
    ------
    InputError
        The surfaces lie apart, or ours reaches beyond theirs.
    """
    here, there, x, w = common_points(ours, theirs, tol)
    gap, limit = np.linalg.norm(x - there.x, axis=1), reach(ours, here.face, tol)
    near = gap <= limit
    area = ours.sizes
    covered = np.bincount(here.face[near], w[near], len(area)) / area
    if covered.min() < 1 - missing:
        worst = int(covered.argmin())
        beside = np.flatnonzero(here.face == worst)
        why = (f"the surfaces are {gap[beside].min():.3g} apart, and {limit[beside].max():.3g} is allowed" if len(beside) and
               not near[beside].any() else f"only {max(covered[worst], 0.0):.0%} of it lies on the other surface")
        nodes = ", ".join(map(str, ours.numbers[ours.faces[worst]][:ours.corners]))
        raise InputError(f"{what} cannot be tied: at the face with the nodes {nodes} of the first, {why}; move the part, give a "
                         "larger tolerance, or let the surface that lies within the other come first")
    here, there, w = here.chosen(near), there.chosen(near), w[near]
    N, load = here.N, sp.diags_array(w)
    if reference(ours.kind).degree > 1:
        from scipy.sparse.linalg import splu

        return sp.csr_array(splu(sp.csc_array(N.T @ load @ N)).solve((N.T @ load @ there.N).toarray()))
    # ψ = A N with ∫ ψ_i N_j = δ_ij ∫ N_j on each face
    local = here.shapes[0]
    mass = np.zeros((len(area), *local.shape[1:] * 2))
    np.add.at(mass, here.face, w[:, None, None] * local[:, :, None] * local[:, None, :])
    share = mass.sum(axis=2)
    A = share[:, :, None] * np.linalg.inv(mass)
    psi = here.sparse(np.einsum("pij,pj->pi", A[here.face], local))
    return sp.csr_array(sp.diags_array(1 / np.bincount(ours.faces.ravel(), share.ravel())) @ (psi.T @ load @ there.N))


def motion_of_nodes(dofs: DofMap, surface: Surface, label: str) -> Matrix:
    """The matrix (n, dofs), sparse, that selects one motion of a surface's nodes from DOF; rows of held nodes are empty."""
    assert dofs.points is not None
    labels = [dofs.labels[k] for k in dofs.components]
    place, apart = nearest(surface.points, dofs.points, [label] * len(surface.points), labels)
    nodes = np.flatnonzero(apart <= EQUAL * np.abs(surface.points).max())
    return sp.csr_array((np.ones(len(nodes)), (nodes, place[nodes])), shape=(len(place), dofs.size))
