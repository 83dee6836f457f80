"""`cut`: a mesh, or the matrices of a substructure, cut into parts, with the joints that restore the whole model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra import Frozen, partition, runs
from femsub.checks import EQUAL, Array, InputError, InputTypeError, Matrix, instance, items, whole_number
from femsub.components import Mesh, corners_of, edges_of, places_of
from femsub.components.chain import chain
from femsub.coupling.joints import Rigid
from femsub.model import DofMap, Substructure

PLACES = ("supports", "interface", "ports")  # arguments of `plate` and `solid` that refer to sets of nodes


@dataclass(frozen=True, eq=False, repr=False)
class Cut(Frozen):
    """Parts of one model, and the joints between them, as `cut` returns them. ``parts, joints = cut(...)`` unpacks it.

    Attributes
    ----------
    parts : mapping of str to Substructure
    joints : tuple of Rigid
        One joint for each group of parts that meet. It joins the DOF that these parts share, and no other part has.
    rows : mapping of str to ndarray of int, shape (n_p,)
        For each part, its DOF as rows of the model.
    cells : mapping of str to ndarray of int
        For each part, its cells as rows of the mesh; empty for matrices.
    meshes : mapping of str to Mesh
        For each part its mesh, with the model's node numbers and the part's share of sets and groups; empty for matrices.
    size : int
        The number of DOF of the model, n.

    Examples
    --------
    >>> import femsub as fs
    >>> halves = fs.cut(fs.chain(10), into=2)
    >>> system = fs.couple(*halves)
    >>> u = fs.normal_modes(system, 1).shapes
    >>> halves.whole(system.expand(u)).shape
    (10, 1)
    """

    parts: Mapping[str, Substructure]
    joints: tuple[Rigid, ...]
    rows: Mapping[str, Array]
    size: int
    cells: Mapping[str, Array] = field(default_factory=dict)
    meshes: Mapping[str, Mesh] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Any]:
        return iter((self.parts, self.joints))

    def __repr__(self) -> str:
        sizes = [len(rows) for rows in self.rows.values()]
        shared = np.count_nonzero(np.bincount(np.concatenate(list(self.rows.values()))) > 1)
        return (f"Cut of {self.size} DOF: {len(sizes)} parts of {min(sizes)} to {max(sizes)} DOF, {shared} DOF shared, "
                f"{len(self.joints)} joint{'s' * (len(self.joints) != 1)}")

    def whole(self, u: Mapping[str, Array]) -> Array:
        """The displacements of the model, (n,) or (n, k), from those of its parts, as `System.expand` returns them."""
        kinds = [np.asarray(u[name]) for name in self.rows]
        found = np.zeros((self.size, *kinds[0].shape[1:]), dtype=np.result_type(*kinds))
        for name, rows in self.rows.items():
            found[rows] = u[name]
        return found


def cut(model: Mesh | Substructure, build: Callable[..., Substructure] | None = None, *, into: int | None = None,
        sets: Sequence[str] | None = None, **arguments: Any) -> Cut:
    """Cut a mesh, or a substructure's matrices, into parts that `couple` joins to the same model again.

    K = Σ_p L_pᵀ K_p L_p, where L_p (n_p, n) selects the part's DOF; M and D likewise. DOF at a cut belong to all parts that meet
    there, and to the interface of each. Supports, ports, named sets and damping go to the parts that have their DOF.

    A mesh is cut between its cells, and K_p is the sum of the part's own elements: any reduction method may follow. The elements
    of a substructure's matrices are not known. So the entries between DOF at a cut are divided between the parts. Craig-Bampton
    and Guyan use only the sum of these entries, so they are as accurate as for a mesh. All other methods need a positive
    semidefinite K_p, and refuse another K_p (SingularMatrixError). K_p is semidefinite if K is diagonally dominant, as for chains
    of springs. Otherwise cut the mesh.

    Parameters
    ----------
    model : Mesh or Substructure
    build : function, for a mesh
        Makes the component of a mesh: `plate`, `solid`, or a function of your own with their keywords. The component must have a
        DOF map with the mesh's node numbers.
    into : int, 2 or more
        The number of parts. SCOTCH (of PETSc) chooses parts with few shared DOF; without SCOTCH the model is halved repeatedly.
        A port stays in one part. The parts are called 'p1', 'p2', ...
    sets : sequence of str, for a mesh
        Instead of `into`: names of groups of cells. Each group becomes a part with this name. Each cell must be in one group.
    **arguments
        Arguments of `build`. `supports`, `interface` and `ports` refer to the whole mesh.

    Returns
    -------
    Cut
        Unpacks to the parts, by name, and the joints. The DOF that parts share form an interface set in each of them, called
        after these parts, as 'p1+p2'.

    Raises
    ------
    InputError, InputTypeError
        More parts than cells or nodes; an unknown or empty group, groups that overlap or do not contain all cells; a port across
        several parts.

    References
    ----------
    F. Pellegrini, J. Roman, Lect. Notes Comput. Sci. 1067 (1996) 493 (SCOTCH).

    Examples
    --------
    >>> import femsub as fs
    >>> steel, bar = fs.Material(2.1e11, 0.3, 7850.0), fs.block((1.0, 0.1, 0.1), (8, 1, 1), "hexahedron")
    >>> parts, joints = fs.cut(bar, fs.solid, into=2, material=steel, supports=["left"])
    >>> fs.couple(parts, joints).size == fs.solid(bar, steel, supports=["left"]).size
    True
    >>> fs.cut(fs.chain(100), into=4)
    Cut of 100 DOF: 4 parts of 25 to 26 DOF, 3 DOF shared, 3 joints
    """
    if isinstance(model, Substructure):
        if build is not None or sets is not None or arguments:
            raise InputTypeError("a Substructure is cut by cut(model, into=4) alone: build, sets and others are for a Mesh")
        if into is None:
            raise InputError("into is missing: give the number of parts, into=4")
        return _cut_matrices(model, into)
    instance("model", model, Mesh, "or a Substructure")
    if not callable(build):
        raise InputTypeError("cut needs the function that makes the component of a mesh, as cut(mesh, fs.solid, into=4, "
                             f"material=steel), not {build!r:.60}")
    if (into is None) == (sets is None):
        raise InputError("give either into, the number of parts, or sets, groups of cells that become parts")
    whole = instance("what build returns", build(model, **arguments), Substructure)
    if whole.dofs is None:
        raise InputError("the component that build returns has no map of its DOF (dofs=), by which parts find theirs")
    if into is not None:
        cells = _pieces(model, into, [whole.dofs.nodes[np.flatnonzero(w.reshape(whole.size, -1).any(axis=1))]
                                      for w in whole.ports.values()])
    else:
        cells = model.cells_in(items("sets", sets, "names of groups of cells"), "sets")
    if empty := [name for name, chosen in cells.items() if not len(chosen)]:
        raise InputError(f"sets: the group {empty[0]!r} of the mesh {model.name!r} is empty; leave it out")
    own = {key: value for key, value in arguments.items() if key not in PLACES}
    matrices, rows, meshes = {}, {}, {}
    for name, chosen in cells.items():
        meshes[name], nodes = _piece(model, chosen, name)
        part = build(meshes[name], **own)
        rows[name], kept = _places(whole.dofs, part.dofs, model, meshes[name], nodes)
        matrices[name] = tuple(A if len(kept) == part.size else A[kept][:, kept] for A in (part.M, part.D, part.K))
    return replace(_joined(whole, rows, matrices), cells=cells, meshes=meshes)


def cut_mesh(mesh: Mesh, into: int, under: Sequence[Array]) -> dict[str, Mesh]:
    """The mesh in `into` pieces, each with the mesh's node numbers and with sets, as 'p1+p2', of the nodes that pieces share.

    Each array in `under` contains node numbers that stay together in one piece.
    """
    cells = _pieces(mesh, into, under)
    member = np.zeros((len(mesh.points), len(cells)), dtype=bool)
    for number, chosen in enumerate(cells.values()):
        member[mesh.cells[chosen], number] = True
    shared = _meetings(list(cells), member)[0]
    if twice := set(mesh.sets) & set(shared):
        raise InputError(f"the set {min(twice)!r} of {mesh.name!r} has the name of the nodes that these parts share: rename it")
    whole = mesh.with_sets(**shared)
    return {name: _piece(whole, chosen, name)[0] for name, chosen in cells.items()}


def _pieces(mesh: Mesh, into: int, under: Sequence[Array]) -> dict[str, Array]:
    """The cells of `into` pieces, connected by faces (in a plane mesh by edges).

    The nodes in each array of `under` stay together in one piece.
    """
    count = len(mesh.cells)
    if count == 1:
        raise InputError(f"the mesh {mesh.name!r} has one cell, and cells are not cut: mesh it finer")
    into = whole_number("into, the number of parts,", into, 2, count)
    corners = _incidence(corners_of(mesh), len(mesh.points))
    neighbours = sp.coo_array(corners @ corners.T)
    beside = neighbours.data >= mesh.dimension
    graph = sp.csr_array((np.ones(beside.sum()), (neighbours.row[beside], neighbours.col[beside])), shape=(count, count))
    cells, numbers = mesh.cells, mesh.numbers
    if mesh.kind == "triangle":  # the edges of a plate's triangles have DOF, too
        edges, of_cell, _ = edges_of(mesh)
        cells = np.hstack([cells, len(numbers) + of_cell])
        numbers = np.concatenate([numbers, numbers.max() + 1 + np.arange(len(edges))])
    nodes = _incidence(cells, len(numbers))
    together = []
    for wanted in under:
        beneath = np.isin(numbers, wanted)
        held = nodes @ beneath  # the number of these nodes in each cell
        cell, node = sp.coo_array(nodes[:, beneath]).coords
        order = np.lexsort((cell, -held[cell], node))
        together.append(np.unique(cell[order][np.flatnonzero(np.diff(node[order], prepend=-1))]))
    part = _partition(graph, into, together)
    return {f"p{number + 1}": np.flatnonzero(part == number) for number in range(into)}


def _partition(graph: Matrix, into: int, together: Sequence[Array]) -> Array:
    """The part of each node of a graph, (n,). The nodes of each group in `together` are in the same part."""
    pairs = np.concatenate([np.stack([group, np.full(len(group), group[0])]) for group in together if len(group)]
                           + [np.zeros((2, 0), dtype=int)], axis=1)
    count, cluster = connected_components(sp.csr_array((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), shape=graph.shape),
                                          directed=False)
    if count < into:
        raise InputError(f"into={into} parts are too many: the ports leave {count} pieces that can be parts. Take fewer")
    merged = _incidence(cluster[:, None], count)
    return partition(merged.T @ graph @ merged, into)[cluster]


def _incidence(cells: Array, count: int) -> Matrix:
    """The incidence matrix of cells and nodes, sparse, (m, n): 1.0 for each node of a cell."""
    return sp.csr_array((np.ones(cells.size), cells.ravel(), np.arange(0, cells.size + 1, cells.shape[1])),
                        shape=(len(cells), count))


def _piece(mesh: Mesh, cells: Array, name: str) -> tuple[Mesh, Array]:
    """Some cells of a mesh as a separate mesh with the same node numbers, and its nodes as rows of the whole mesh."""
    nodes, places = np.unique(mesh.cells[cells], return_inverse=True)
    groups = {key: np.flatnonzero(np.isin(cells, chosen)) for key, chosen in mesh.groups.items()}
    sets = {key: here for key, chosen in mesh.sets.items() if len(here := np.flatnonzero(np.isin(nodes, chosen)))}
    return Mesh(mesh.points[nodes], places.reshape(len(cells), -1), mesh.kind, sets, groups, mesh.numbers[nodes],
                name=name), nodes


def _places(whole: DofMap | None, part: DofMap | None, mesh: Mesh, piece: Mesh, nodes: Array) -> tuple[Array, Array]:
    """The rows in the whole model of a part's DOF, and the numbers of these DOF in the part; held DOF are left out."""
    if whole is None or part is None or whole.labels != part.labels:
        raise InputError("build gives the component of a part of the mesh another map of its DOF than that of the whole mesh")
    numbers = part.nodes.copy()
    beyond = np.flatnonzero(numbers > piece.numbers.max())
    if len(beyond):  # edges of triangles, whose numbers continue those of the nodes
        ends = np.array([len(mesh.points), 1])
        edges = nodes[edges_of(piece)[0][numbers[beyond] - piece.numbers.max() - 1]] @ ends
        numbers[beyond] = mesh.numbers.max() + 1 + np.searchsorted(edges_of(mesh)[0] @ ends, edges)
    count = len(whole.labels)
    place = places_of(numbers * count + part.components, whole.nodes * count + whole.components)
    kept = np.flatnonzero(place >= 0)
    return place[kept], kept


def _cut_matrices(whole: Substructure, into: int) -> Cut:
    A = sp.csr_array(sum(abs(sp.csr_array(B)) for B in (whole.K, whole.M, whole.D, whole.D.T)))
    if whole.dofs is None:
        node = runs(A)
    else:
        _, node = np.unique(whole.dofs.nodes, return_inverse=True)
    count = int(node.max()) + 1
    if count == 1:
        raise InputError(f"the matrices of {whole.name!r} cannot be cut: " + (
            "each DOF is coupled with every other, as in one element or a reduced model. Cut the full model or its mesh"
            if whole.dofs is None else "all DOF belong to one node"))
    into = whole_number("into, the number of parts,", into, 2, count)
    of_node = _incidence(node[:, None], count)
    graph = sp.coo_array(of_node.T @ A @ of_node)
    graph = sp.csr_array((np.ones(graph.nnz), graph.coords), shape=graph.shape)
    under = [np.unique(node[np.flatnonzero(w.reshape(whole.size, -1).any(axis=1))]) for w in whole.ports.values()]
    owner = _partition(graph, into, under)
    ported = np.zeros(count, dtype=bool)
    ported[np.concatenate([*under, np.zeros(0, dtype=int)]).astype(int)] = True
    member, common = members(graph, owner, ported, into)
    member, common = member[node], [sp.csr_array(of_node @ one @ of_node.T) for one in common]
    return in_rows(whole, {f"p{at + 1}": np.flatnonzero(column) for at, column in enumerate(member.T)}, common)


def in_rows(whole: Substructure, rows: dict[str, Array], common: Sequence[Matrix] | None = None) -> Cut:
    """The cut of a substructure into parts with these DOF; see `members` for `common`."""
    member = np.stack([np.isin(np.arange(whole.size), own) for own in rows.values()], axis=1)
    common = common or [sp.csr_array(whole.M.shape)] * len(rows)
    shares = [divided(sp.csr_array(B), common, member) for B in (whole.M, whole.D, whole.K)]
    return _joined(whole, rows, dict(zip(rows, zip(*shares, strict=True), strict=True)))


def _joined(whole: Substructure, rows: dict[str, Array], matrices: Mapping[str, tuple[Matrix, Matrix, Matrix]]) -> Cut:
    """The parts with their interfaces, sets and ports, and the joints between them."""
    names, count = list(rows), whole.size
    member = np.stack([np.isin(np.arange(count), own) for own in rows.values()], axis=1)
    cut_sets, joints = _meetings(names, member)
    owner = {}  # the part of each port: the first part with all of its DOF
    for key, w in whole.ports.items():
        under = member[np.flatnonzero(w.reshape(whole.size, -1).any(axis=1))]
        if not under.all(axis=0).any():
            touched = ", ".join(repr(names[k]) for k in np.flatnonzero(under.any(axis=0)))
            raise InputError(f"the port {key!r} lies across the parts {touched}, and a port belongs to one part. Choose groups "
                             "of cells that leave it whole, or fewer parts")
        owner[key] = names[int(under.all(axis=0).argmax())]
    named = {key: whole.interface[places] for key, places in whole.sets.items()} | cut_sets
    if twice := set(whole.sets) & set(cut_sets):
        raise InputError(f"the interface set {min(twice)!r} has the name of the DOF that these parts share: give it another one")
    if whole.H is not None:
        raise InputError(f"{whole.name!r} has structural damping H, which a cut does not divide. Remove it by "
                         "with_structural_damping(None), and give the parts loss factors by damped(part, structural=...)")
    outer = np.concatenate([whole.interface, *(shared for shared in cut_sets.values())])
    outer = outer[np.sort(np.unique(outer, return_index=True)[1])].astype(np.intp)
    parts = {}
    for number, (name, own) in enumerate(rows.items()):
        M, D, K = matrices[name]
        interface = outer[member[outer, number]]
        parts[name] = Substructure(
            M, K, D if D.nnz else None, places_of(interface, own),
            {key: w[own] for key, w in whole.ports.items() if owner[key] == name}, name,
            None if whole.dofs is None else whole.dofs.kept(own),
            {key: places for key, at in named.items() if len(places := places_of(at[member[at, number]], interface))})
    return Cut(parts, joints, rows, count)


def _meetings(names: Sequence[str], member: Array) -> tuple[dict[str, Array], tuple[Rigid, ...]]:
    """The DOF that each group of parts shares, as sets such as 'p1+p2', and a joint for each group."""
    shared = np.flatnonzero(member.sum(axis=1) > 1)
    groups, number = np.unique(member[shared], axis=0, return_inverse=True)
    sets, joints = {}, []
    for at in range(len(groups) - 1, -1, -1):  # in this order, groups with the first part come first
        meeting = [names[k] for k in np.flatnonzero(groups[at])]
        key = "+".join(meeting)
        sets[key] = shared[number.ravel() == at]
        joints.append(Rigid(*((name, key) for name in meeting), tol=np.inf, name=key))  # all parts list the DOF in equal order
    return sets, tuple(joints)


def cut_chain(n: int, pieces: int, belt: int = 1, damping: float = 0.1, *, masses: Any = 1.0,
              springs: Any = 1.0) -> tuple[dict[str, Substructure], list[Rigid], str]:
    """The chain of `chain` in pieces of about equal length. The mass at a joint is divided equally between both pieces.

    Returns
    -------
    parts, joints, port
        The parts 'p1', 'p2', ... counted from the wall, the joints for `couple`, and the belt's port in the system, such as
        'p1.belt'. Only the part under the belt has a port.
    """
    whole = chain(n, belt, damping, masses=masses, springs=springs, interface=())
    ends = np.linspace(0, n - 1, whole_number("pieces", pieces, 2, n - 1) + 1).astype(int)
    parts, joints = in_rows(whole, {f"p{number}": np.arange(first, last + 1) for number, (first, last) in
                                    enumerate(pairwise(ends.tolist()), start=1)})
    return parts, list(joints), next(f"{name}.belt" for name, part in parts.items() if part.ports)


def members(graph: Matrix, owner: Array, ported: Array, count: int) -> tuple[Array, list[Matrix]]:
    """The parts that each node of a graph belongs to, bool (n, p), so that each edge lies within a part.

    Of two neighbours in different parts, the node in the part with the lower number becomes a node at a cut, unless it lies under
    a port and the other does not. A node at a cut belongs to every part with an inner node beside it. Elements with all their
    nodes at a cut remain; each goes to one part.

    Returns
    -------
    member : ndarray of bool, shape (n, p)
    common : list of sparse, shape (n, n)
        For each part, the number of its inner nodes and such elements that two nodes at a cut have in common.
    """
    edges, rank = sp.coo_array(graph), owner + count * ported
    shared = np.zeros(len(owner), dtype=bool)
    shared[edges.row[(owner[edges.row] != owner[edges.col]) & (rank[edges.row] < rank[edges.col])]] = True
    beside = sp.csr_array(graph.multiply(shared[:, None]))  # only the rows of nodes at a cut
    between = sp.csr_array(beside.multiply(shared[None, :]))
    common = []
    for part in range(count):
        inner = sp.csr_array(beside.multiply((~shared & (owner == part))[None, :]))
        common.append(sp.csr_array((inner @ inner.T).multiply(between)))
    member = np.stack([one.diagonal() > 0 for one in common], axis=1)
    member[~shared, owner[~shared]] = True
    for part, element in _elements(between, sum(common), owner):
        member[element, part] = True
        pairs = np.repeat(element, len(element)), np.tile(element, len(element))
        common[part] = common[part] + sp.csr_array((np.ones(len(pairs[0])), pairs), shape=graph.shape)
    if not member.any(axis=0).all():
        raise InputError(f"into={count} parts of {len(owner)} nodes are too many: p{int(member.any(axis=0).argmin()) + 1} has no "
                         "node of its own. " + ("Take fewer" if count > 2 else "Cut a model that has more nodes, or its mesh"))
    return member, common


def _elements(between: Matrix, common: Matrix, owner: Array) -> Iterator[tuple[int, Array]]:
    """Yields sets of nodes at a cut that are all neighbours, with their part; the sets cover all pairs missing in `common`."""
    def near(node: int) -> set[int]:
        return set(between.indices[between.indptr[node]:between.indptr[node + 1]].tolist())

    found = sp.coo_array(common)
    known = sp.csr_array((np.ones(found.nnz), found.coords), shape=between.shape)
    bare = sp.coo_array(between - between.multiply(known))
    left = (bare.data > 0) & (bare.row <= bare.col)
    waiting = dict.fromkeys(zip(bare.row[left].tolist(), bare.col[left].tolist(), strict=True))
    for i, j in list(waiting):
        if (i, j) in waiting:
            element = {i, j}
            for k in sorted(near(i) & near(j) - element):
                if element <= near(k):
                    element.add(k)
            nodes = np.array(sorted(element))
            yield int(np.bincount(owner[nodes]).argmax()), nodes
            for one in nodes.tolist():
                for other in nodes.tolist():
                    waiting.pop((one, other), None)


def divided(B: Matrix, common: Sequence[Matrix], member: Array) -> list[Matrix]:
    """B (n, n) as a sum of matrices of the parts, each in the part's own rows.

    An entry between two DOF at a cut is divided between the parts with both DOF, in proportion to `common`. A diagonal entry is
    divided in proportion to the sums of absolute values in the parts' rows. So a diagonally dominant B has diagonally dominant
    parts. In rows that are not dominant, the values are taken relative to sqrt(b_ii b_jj), and balanced.
    """
    shared = member.sum(axis=1) > 1
    inner = (member & ~shared[:, None]).astype(float)
    edges = sp.coo_array(B)
    at_cut = shared[edges.row] & shared[edges.col]
    rest = sp.csr_array((edges.data[~at_cut], (edges.row[~at_cut], edges.col[~at_cut])), shape=B.shape)
    row, column, values = edges.row[at_cut], edges.col[at_cut], edges.data[at_cut]
    share = np.zeros((len(row), len(common)))  # each part's share of each entry
    if len(row):  # SciPy returns no array for empty indices
        share = np.stack([one[row, column] for one in common], axis=1)
    share = np.where(share.any(axis=1, keepdims=True), share, member[row] & member[column])
    share /= share.sum(axis=1, keepdims=True)
    own = np.flatnonzero(row == column)
    share[own] = 0.0
    diagonal = np.abs(B.diagonal())
    beside = abs(rest) @ inner
    np.add.at(beside, row, np.abs(values)[:, None] * share)
    dominant = beside.sum(axis=1) <= (1 + EQUAL) * diagonal
    if not dominant[shared].all():
        unit = np.where(diagonal > 0, diagonal, 1.0) ** -0.5
        scaled = sp.diags_array(unit) @ rest @ sp.diags_array(unit)
        balanced = _balanced(scaled, inner, row, column, (unit[row] * values * unit[column])[:, None] * share)
        beside = np.where(dominant[:, None], beside, balanced)
    beside = np.where(beside.any(axis=1, keepdims=True), beside, member)
    share[own] = beside[row[own]] / beside[row[own]].sum(axis=1, keepdims=True)
    found = []
    for number, chosen in enumerate(member.T):
        kept, place = np.flatnonzero(chosen), np.cumsum(chosen) - 1
        here = np.flatnonzero(share[:, number])
        added = values[here] * share[here, number]
        extra = sp.csr_array((added, (place[row[here]], place[column[here]])), shape=(len(kept), len(kept)))
        found.append(sp.csr_array(rest[kept][:, kept] + extra))
    return found


def _balanced(rest: Matrix, inner: Array, row: Array, column: Array, each: Array, steps: int = 100) -> Array:
    """The parts' shares of the diagonal entries of a matrix with diagonal 1, (n, p): b_ij² ≤ b_ii b_jj in each part, if possible.

    The matrix consists of `rest` and, in each part, of the entries `each` (k, p) at (row, column). Balancing takes at most
    `steps` steps: 99 % of the random matrices that can be balanced need fewer than ten. The excess may rise between steps.
    """
    found = abs(rest) @ inner
    np.add.at(found, row, np.abs(each))
    alone = np.zeros_like(found)  # the largest b_ij² with an inner DOF j
    beside = sp.coo_array(rest)
    part = inner[beside.col].argmax(axis=1)
    outer = ~inner[beside.row].any(axis=1) & inner[beside.col].any(axis=1)
    np.maximum.at(alone, (beside.row[outer], part[outer]), beside.data[outer] ** 2)
    for _ in range(steps):
        found /= np.where((total := found.sum(axis=1, keepdims=True)) > 0, total, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.nan_to_num(alone / found)
            np.maximum.at(excess, row, np.nan_to_num(each**2 / (found[row] * found[column])))
        bad = excess.max(axis=1) > 1
        if not bad.any():
            break
        found[bad] *= np.sqrt(excess[bad])
    return found
