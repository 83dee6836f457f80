"""`couple`: substructures joined to a system, which is a `Substructure` again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from femsub.checks import Array, Matrix, choice, instance, items, mapping, word
from femsub.errors import InputError, InputTypeError
from femsub.model.dof_map import DofMap
from femsub.model.dual import FORCE, Multiplied, by_forces, check_span, finite_span, multiplied
from femsub.model.elimination import Equations, congruent, eliminate, recovered
from femsub.model.joints import End, Joint, Link, site, spatial
from femsub.model.matrices import is_symmetric
from femsub.model.substructure import ReducedSubstructure, Substructure, checked_sets

FULL = 0.3  # of all entries that are not 0: from here on a system of full and reduced parts is kept dense
SAME = 1e-9  # of a row of the interface that two rows may differ by which are the motion of one DOF


@dataclass(frozen=True, eq=False, repr=False)
class System(Substructure):
    """Joined parts as one substructure: M ẍ + D ẋ + K x = f. `couple` makes it.

    x, shape (n,), are the coordinates that the joints leave. A system is used like any other substructure. Its ports and
    interface sets are those of the parts; their names begin with the part's, as 'disc.belt'.

    Attributes
    ----------
    parts : mapping of str to Substructure
    joints : tuple of Joint
    L : sparse, or dense if all parts are, shape (N, n)
        q = L x. q stacks the coordinates of all parts.
    open : mapping of str to ndarray of int
        The system's interface: for each part, positions in the interface of the part.
    redundant : int
        Equations of the joints that follow from the others. They were left out.
    multipliers : mapping of str to matrix, shape (m, n)
        For each joint with Lagrange multipliers, by its name: G with λ = G x. The joint acts with the forces -C_pᵀλ on the
        interface of the part p; C_p is that of its `Link`.
    assembly : str
        'primal' or 'dual', as in `couple`.
    spurious : int
        Negative or infinite eigenvalues ω² of the assembly of dual Craig-Bampton parts. The system does not contain them.

    Examples
    --------
    >>> import femsub as fs
    >>> left, right = fs.chain(5, interface=[5]), fs.chain(6, interface=[1], fixed=False)
    >>> system = fs.couple({"left": left, "right": right}, [fs.Rigid(("left", [4]), ("right", [0]))])
    >>> system
    System 'system': 10 DOF of 2 parts (left, right) and 1 joints, sparse, 28 nonzeros in K, 0 interface DOF
    >>> {name: len(u) for name, u in system.expand([1.0] * 10).items()}
    {'left': 5, 'right': 6}
    >>> list(system.ports)
    ['left.belt', 'right.belt']
    """

    dofs: DofMap | None = field(default=None, init=False)
    parts: Mapping[str, Substructure] = field(default_factory=dict)
    joints: tuple[Joint, ...] = ()
    L: Matrix = None
    open: Mapping[str, Array] = field(default_factory=dict)
    redundant: int = 0
    multipliers: Mapping[str, Matrix] = field(default_factory=dict)
    spurious: int = 0
    assembly: str = "primal"

    def __init__(self, M: Any, K: Any, D: Any, interface: Any, ports: Mapping[str, Any], name: str, *,
                 parts: Mapping[str, Substructure], joints: Iterable[Joint], L: Matrix, open: Mapping[str, Array],
                 sets: Mapping[str, Array] | None = None, redundant: int = 0,
                 multipliers: Mapping[str, Matrix] | None = None, spurious: int = 0, assembly: str = "primal") -> None:
        super().__init__(M, K, D, interface, ports, name)
        self._set(parts=dict(parts), joints=tuple(joints), L=L, open=dict(open), redundant=redundant,
                  multipliers=multipliers or {}, spurious=spurious, assembly=assembly,
                  sets=checked_sets(sets, sum(map(len, open.values()))), cutoff=min(part.cutoff for part in parts.values()))

    def __repr__(self) -> str:
        kind = f"sparse, {self.K.nnz} nonzeros in K" if sp.issparse(self.K) else "dense"
        beside = f", {self.redundant} equations redundant" if self.redundant else ""
        beside += f", {sum(rows.shape[0] for rows in self.multipliers.values())} multipliers" if self.multipliers else ""
        beside += f", {self.spurious} spurious eigenvalues left out" if self.spurious else ""
        return (f"System {self.name!r}: {self.size} DOF of {len(self.parts)} parts ({', '.join(self.parts)}) and "
                f"{len(self.joints)} joints, {kind}, {self.interface_rows.shape[0]} interface DOF{beside}")

    @cached_property
    def interface_rows(self) -> Matrix:
        """B with u_b = B x, shape (n_b, n)."""
        return super().interface_rows if len(self.interface) else _rows(self.parts, self.L, self.open)

    @property
    def interface_numbers(self) -> Array:
        """The coordinates that are the interface, shape (n_b,); -1 where it is spread over many coordinates."""
        count = sum(map(len, self.open.values()))
        return self.interface if len(self.interface) == count else np.full(count, -1)

    @cached_property
    def interface_dofs(self) -> DofMap | None:
        """The maps of all parts in one, with nodes numbered anew from 1; None if a part has no map."""
        maps = [self.parts[name].interface_dofs for name, places in self.open.items() if len(places)]
        if not maps or any(one is None or one.points is None for one in maps):
            return None
        found = [one.kept(places) for one, places in zip(maps, (p for p in self.open.values() if len(p)), strict=True) if one]
        labels = tuple(dict.fromkeys(label for one in found for label in one.labels))
        nodes, components, start = [], [], 1
        for one in found:
            _, number = np.unique(one.nodes, return_inverse=True)
            nodes.append(start + number)
            start = int(nodes[-1].max(initial=start - 1)) + 1
            components.append(np.array([labels.index(label) for label in one.labels])[one.components])
        points = np.concatenate([spatial(one.points) for one in found if one.points is not None])
        return DofMap(np.concatenate(nodes), np.concatenate(components), labels, points)

    def expand(self, x: Array) -> dict[str, Array]:
        """The displacements of each part, {name: u}, from x of shape (n,) or (n, k); u has the shape (n_p,) or (n_p, k).

        For a reduced part u = V q. The parts of a system within the system are listed one by one, as 'front.disc'.
        """
        x = np.asarray(x)
        if x.ndim == 0 or x.shape[0] != self.size:
            raise InputError(f"x must have {self.size} rows, one per coordinate, but its shape is {x.shape}")
        found: dict[str, Array] = {}
        for (name, part), rows in zip(self.parts.items(), _blocks(self.parts), strict=True):
            q = self.L[rows] @ x
            if isinstance(part, System):
                found |= {f"{name}.{inner}": u for inner, u in part.expand(q).items()}
            else:
                found[name] = part.expand(q) if isinstance(part, ReducedSubstructure) else q
        return found

    def collected(self, u: Mapping[str, Array]) -> Array:
        """The x whose L x comes nearest to given displacements of the parts, as `expand` lists them; shape (n,) or (n, k).

        Raises
        ------
        InputError
            A part is reduced, so that its coordinates are no displacements.
        """
        blocks = []
        for name, part in self.parts.items():
            if isinstance(part, ReducedSubstructure):
                raise InputError(f"the part {name!r} is reduced: its coordinates do not follow from displacements")
            inner = {key.removeprefix(f"{name}."): one for key, one in u.items() if key.startswith(f"{name}.")}
            blocks.append(part.collected(inner) if isinstance(part, System) else u[name])
        L = sp.csc_array(self.L)
        gram, load = sp.csc_array(L.T @ L), L.T @ np.concatenate(blocks)
        diagonal = gram.diagonal()
        if gram.nnz == np.count_nonzero(diagonal):  # equal DOF alone
            return load / diagonal.reshape(-1, *[1] * (load.ndim - 1))
        return splu(gram).solve(load.real) + (1j * splu(gram).solve(load.imag) if np.iscomplexobj(load) else 0.0)

    def with_parts(self, parts: Mapping[str, Substructure]) -> System:
        """The same joints between other models of the parts, such as reduced ones; a part that is not named stays.

        The interface is the same, too.

        Raises
        ------
        InputError, InputTypeError
            A name that is no part; see `couple`.
        """
        for name in mapping("parts", parts, "names and substructures, as {'disc': rom}"):
            choice("part", name, self.parts)
        ends = [(name, self.parts[name].interface_numbers[places]) for name, places in self.open.items() if len(places)]
        return couple(dict(self.parts) | dict(parts), self.joints, self.name, assembly=self.assembly, interface=ends)

    def interface_forces(self, omega: Array, x: Array) -> dict[str, Array]:
        """The forces g on the interface of each part in undamped motion: Bᵀg = (K - ω²M)q with u_b = Bq, {name: (n_b, k)}.

        On a full part g is what its own elasticity and inertia leave to the joints. Of a reduced part whose interface is spread
        over generalised coordinates it is the g that comes nearest.

        Parameters
        ----------
        omega : array_like, shape (k,)
            Radians per unit of time.
        x : array_like, shape (n, k)
            The system's coordinates.
        """
        found = {}
        for (name, part), rows in zip(self.parts.items(), _blocks(self.parts), strict=True):
            q = self.L[rows] @ x
            balance = part.K @ q - (part.M @ q) * np.asarray(omega) ** 2
            B = part.interface_rows
            if len(part.interface) == B.shape[0]:
                found[name] = balance[part.interface]
            else:
                found[name] = np.linalg.lstsq((B.toarray() if sp.issparse(B) else B).T, balance, rcond=None)[0]
        return found


def couple(parts: Mapping[str, Substructure], joints: Sequence[Joint], name: str = "system", *,
           assembly: str = "primal", interface: Sequence[End] | None = None) -> System:
    """Join substructures to a system, which is a substructure again.

    M, D, K = Lᵀ diag(M_p, D_p, K_p) L + Σ Rᵀ(0, c, k)R with q = L x. L spans all motions that the joints allow; c and k are
    dampers and springs on the motions R q.

    The parts may be full, reduced by any method, or systems, in any mix. DOF that are equal become one coordinate. A DOF that
    is equal to a sum of others is replaced by that sum. Equations between generalised coordinates alone (Craig-Chang joined
    with Craig-Chang) are fulfilled by a basis of their null space. Parts reduced by `DualCraigBampton` are joined weakly, by
    their interface forces.

    Parameters
    ----------
    parts : mapping of str to Substructure
        The parts by name. A name has no dot.
    joints : sequence of Joint
        `Rigid`, `Spring`, `Tied`, `Averaged`, `Kinematic`, or a subclass of `femsub.model.joints.Joint`.
    name : str
    assembly : {"primal", "dual"}
        "dual" keeps the coordinates of the parts and adds the Lagrange multipliers λ of the joints as coordinates:
        K = [[K, Aᵀ], [A, 0]], M = diag(M, 0). This K is indefinite. The finite eigenvalues are those of "primal".
    interface : sequence of ends, optional
        The interface of the system, for further joints: (part, set) or (part, list of DOF). Joined DOF are allowed. By default
        all interface DOF of the parts that are not joined. A named set that is joined only in part stays whole.

    Returns
    -------
    System
        A `Substructure` again; ``.expand(x)`` gives the displacements of each part.

    Raises
    ------
    InputError, InputTypeError
        A part that is joined to nothing, an unknown part or set, interfaces that do not meet, an end that is not an
        interface DOF, joints that allow no motion. The message names the part and the joint.

    References
    ----------
    D. de Klerk, D. J. Rixen, S. N. Voormeeren, AIAA J. 46 (2008) 1169, sec. II (primal and dual assembly).

    Examples
    --------
    >>> import femsub as fs
    >>> left, right = fs.chain(5, interface=[5]), fs.chain(6, interface=[1], fixed=False)
    >>> rom = fs.reduce(right, fs.CraigChang(modes=3))
    >>> fs.couple({"left": left, "right": rom}, [fs.Rigid(("left", [4]), ("right", [0]))]).size
    9
    """
    parts = _checked_parts(parts)
    choice("assembly", assembly, ("primal", "dual"))
    joints = [instance("each of joints", joint, Joint, "as Rigid(('disc', 'left'), ('pad', 'right'))")  # type: ignore[type-abstract]
              for joint in items("joints", joints, "joints")]
    links = [_linked(joint, parts) for joint in joints]
    _connected(parts, links)
    weak = [bool(link.equations) and (assembly == "dual" or any(by_forces(parts[part]) for part in link.equations))
            for link in links]
    equations = _equations(parts, links, _units(parts), _physical(parts))

    def tell(owner: Array) -> str:
        return ", ".join(repr(joints[i]) for i in dict.fromkeys(owner.tolist()))

    dual = np.array(weak, dtype=bool)[equations.owner]
    found = eliminate(equations.chosen(~dual), tell)
    if not found.L.shape[1]:
        raise InputError(f"the joints of {name!r} leave nothing to move")
    joined = Multiplied(found.L, sp.csr_array((0, found.L.shape[1])), equations.A[:0], found.unit, equations.owner[:0])
    redundant, spurious, dense = found.redundant, 0, not any(sp.issparse(part.K) for part in parts.values())
    weakly = False
    if dual.any() or any(map(by_forces, parts.values())):
        forces, compliance = _forces(parts, links, weak, equations.unit)
        K = sp.block_diag([sp.csr_array(part.K) for part in parts.values()], format="csr")
        joined = multiplied(equations.chosen(dual), found.L, forces, compliance, K, tell)
        redundant += int(dual.sum()) - len(joined.owner)
        weakly = bool(forces.nnz)
        if weakly:
            check_span(joined.S.shape[1], name)
    matrices = _matrices(parts, links, joined, dense or weakly)
    if weakly:
        X, unit, matrices, spurious = finite_span(*matrices)
        joined = joined.through(X, unit)
    chosen = _unjoined(parts, links) if interface is None else _listed(parts, interface)
    open_, place = _distinct(parts, chosen, joined.S, joined.unit)
    T, columns = recovered(_rows(parts, joined.S, open_), joined.unit)
    if T is not None:
        joined, matrices = joined.through(T, joined.unit), tuple(congruent(A, T) for A in matrices)
    M, D, K = matrices
    if sp.issparse(K) and not all(sp.issparse(part.K) for part in parts.values()) and K.nnz > FULL * K.shape[0] ** 2:
        M, D, K = (A.toarray() for A in matrices)
    L = joined.S if sp.issparse(K) else joined.S.toarray()
    ports = {f"{part}.{port}": L[rows].T @ w for (part, sub), rows in zip(parts.items(), _blocks(parts), strict=True)
             for port, w in sub.ports.items()}
    return System(M, K, D, columns, ports, name, parts=parts, joints=joints, L=L, open=open_, sets=_sets(parts, place),
                  redundant=redundant, multipliers=_by_joint(joints, joined), spurious=spurious, assembly=assembly)


def _checked_parts(parts: Any) -> dict[str, Substructure]:
    found = dict(mapping("parts", parts, "names and substructures, as {'disc': rom, 'pad': full}"))
    if not found:
        raise InputError("parts is empty: name at least one")
    for name, part in found.items():
        if not word("the name of a part", name) or "." in name:
            raise InputError(f"a part's name must be a word without a dot, since ports are named 'part.port', not {name!r}")
        instance(f"the part {name!r}", part, Substructure)
    return found


def _linked(joint: Joint, parts: Mapping[str, Substructure]) -> Link:
    """What a joint says, with its name in the message where it cannot say it, and its sizes checked."""
    try:
        link = instance("what a joint's link returns", joint.link(parts), Link)
    except (InputError, InputTypeError) as error:
        raise type(error)(f"{joint!r}: {error}") from None
    for what, table, widths in (("equations", link.equations, {name: len(sub.interface_numbers) for name, sub in parts.items()}),
                                ("motions", link.motions, {name: sub.size for name, sub in parts.items()})):
        sizes = {matrix.shape[0] for matrix in table.values()}
        for part, matrix in table.items():
            if matrix.shape[1] != widths[part] or len(sizes) > 1:
                raise InputError(f"{joint!r}: its {what} of {part!r} must have {widths[part]} columns and as many rows as those "
                                 f"of the other parts, but are {matrix.shape}")
    return link


def _connected(parts: Mapping[str, Substructure], links: Sequence[Link]) -> None:
    """All parts hang together, by joints or by the ground."""
    if len(parts) == 1:
        return
    names = list(parts)
    pairs = [(names[0], names[0])]
    for link in links:
        members = [*link.equations, *link.motions, *(["."] if link.grounded else [])]
        pairs += [(members[0], other) for other in members]
    number = {name: at for at, name in enumerate((*names, "."))}  # the ground is one more, whose name no part can have
    table = np.array([[number[one], number[other]] for one, other in pairs])
    graph = sp.csr_array((np.ones(len(table)), (table[:, 0], table[:, 1])), shape=(len(number), len(number)))
    group = connected_components(graph, directed=False)[1]
    alone = [name for name, own in zip(names, group, strict=False) if np.count_nonzero(group == own) == 1]
    if alone:
        raise InputError(f"the part {alone[0]!r} is joined to nothing: give a joint that names it, or leave it out")
    apart = [name for name, own in zip(names, group, strict=False) if own != group[0]]
    if apart:
        raise InputError(f"no joints lead from {names[0]!r} to {', '.join(map(repr, apart))}: these are systems of their own")


def _blocks(parts: Mapping[str, Substructure]) -> list[slice]:
    """The rows of each part's coordinates in q."""
    ends = np.cumsum([0, *(part.size for part in parts.values())])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _units(parts: Mapping[str, Substructure]) -> Array:
    """How far each coordinate moves at unit energy: (k_jj + ω² m_jj)^(-1/2) with a typical ω of all parts."""
    K = np.concatenate([np.abs(part.K.diagonal()) for part in parts.values()])
    M = np.concatenate([np.abs(part.M.diagonal()) for part in parts.values()])
    both = (K > 0) & (M > 0)
    typical = float(np.median(K[both] / M[both])) if both.any() else 1.0
    energy = K + typical * M
    return np.where(energy > 0, energy, 1.0) ** -0.5


def _physical(parts: Mapping[str, Substructure]) -> Array:
    """Which coordinates are displacements of interface DOF."""
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for part, rows in zip(parts.values(), _blocks(parts), strict=True):
        found[rows.start + part.interface] = True
    return found


def _equations(parts: Mapping[str, Substructure], links: Sequence[Link], unit: Array, physical: Array) -> Equations:
    """Σ_p C_p B_p q_p = 0 of all joints below each other."""
    rows = dict(zip(parts, _blocks(parts), strict=True))
    blocks, owner = [], []
    interfaces = {name: sp.csr_array(part.interface_rows) for name, part in parts.items()}
    for number, link in enumerate(links):
        if link.equations:
            block = sum(sp.csr_array(_spread(sp.csr_array(C) @ interfaces[part], rows[part].start, len(unit)))
                        for part, C in link.equations.items())
            blocks.append(block)
            owner.append(np.full(block.shape[0], number))
    A = sp.csr_array(sp.vstack(blocks)) if blocks else sp.csr_array((0, len(unit)))
    return Equations(A, unit, physical, np.concatenate([np.zeros(0, dtype=int), *owner]))


def _spread(C: Matrix, start: int, size: int) -> Matrix:
    """The columns of a sparse C from a place on among `size`."""
    return sp.csr_array((C.data, C.indices + start, C.indptr), shape=(C.shape[0], size))


def _rows(parts: Mapping[str, Substructure], L: Matrix, open_: Mapping[str, Array]) -> Matrix:
    """B_p L_p of the open places of all parts below each other, sparse, shape (n_b, n)."""
    found = [sp.csr_array((0, L.shape[1]))]
    for (name, part), rows in zip(parts.items(), _blocks(parts), strict=True):
        places = open_.get(name, ())
        if len(places):
            found.append(sp.csr_array(sp.csr_array(part.interface_rows)[places] @ sp.csr_array(L[rows])))
    B = sp.csr_array(sp.vstack(found))
    B.eliminate_zeros()
    B.sort_indices()
    return B


def _unjoined(parts: Mapping[str, Substructure], links: Sequence[Link]) -> dict[str, Array]:
    """The places of each part's interface that no equation touches; of a set that has some of these all."""
    chosen = {}
    for name, part in parts.items():
        left = np.ones(len(part.interface_numbers), dtype=bool)
        for link in links:
            if name in link.equations:
                left[sp.csr_array(link.equations[name]).indices] = False
        for places in part.sets.values():  # a corner that two edges share stays open with the edge that is not joined
            if left[places].any():
                left[places] = True
        chosen[name] = np.flatnonzero(left)
    return chosen


def _listed(parts: Mapping[str, Substructure], ends: Sequence[End]) -> dict[str, Array]:
    chosen: dict[str, list[int]] = {name: [] for name in parts}
    for end in items("interface", ends, "ends, as [('disc', 'left')]"):
        found = site(parts, end)
        chosen[found.part] += found.places.tolist()
    return {name: np.array(list(dict.fromkeys(places)), dtype=np.intp) for name, places in chosen.items()}


def _distinct(parts: Mapping[str, Substructure], chosen: Mapping[str, Array], L: Matrix,
              unit: Array) -> tuple[dict[str, Array], dict[str, Array]]:
    """The chosen places without those that are held, or equal to an earlier one; and, for every place in the interface of a
    part, its place in that of the system (-1: none).

    Within one part only equal coordinates count: shapes of a reduced part may move two DOF alike by chance.
    """
    B = sp.csr_array(_rows(parts, L, chosen) @ sp.diags_array(unit))
    size = np.sqrt(B.multiply(B).sum(axis=1))
    moving = size > 0
    B = sp.csr_array(sp.diags_array(1 / np.where(moving, size, 1.0)) @ B)
    # equal rows have equal values in any direction
    value = B @ np.random.default_rng(3).standard_normal(B.shape[1])
    order = np.argsort(np.where(moving, value, np.inf), kind="stable")[:int(moving.sum())]
    one, other = order[:-1], order[1:]
    owner = np.repeat(np.arange(len(parts)), [len(chosen[name]) for name in parts])
    alike = (owner[one] != owner[other]) | (np.diff(B.indptr)[one] == 1)
    close = alike & (np.abs(value[other] - value[one]) <= SAME) & (np.abs(size[other] - size[one]) <= SAME * size[one])
    one, other = one[close], other[close]
    same = abs(B[one] - B[other]).max(axis=1).toarray().ravel() <= SAME if len(one) else np.zeros(0, dtype=bool)
    graph = sp.csr_array((np.ones(int(same.sum())), (one[same], other[same])), shape=(B.shape[0],) * 2)
    first = np.zeros(0, dtype=np.intp)
    if B.shape[0]:
        _, leader, group = np.unique(connected_components(graph, directed=False)[1], return_index=True, return_inverse=True)
        first = leader[group]
    keep = moving & (first == np.arange(B.shape[0]))
    number = np.where(moving, (np.cumsum(keep) - 1)[first], -1)
    open_, place, start = {}, {}, 0
    for name, part in parts.items():
        places = chosen[name]
        rows = slice(start, start + len(places))
        start += len(places)
        open_[name] = places[keep[rows]]
        place[name] = np.full(len(part.interface_numbers), -1)
        place[name][places] = number[rows]
    return open_, place


def _sets(parts: Mapping[str, Substructure], place: Mapping[str, Array]) -> dict[str, Array]:
    """The sets of the parts, 'disc.left', that are whole in the interface of the system."""
    found = {}
    for name, part in parts.items():
        for key, places in part.sets.items():
            at = np.array(list(dict.fromkeys(place[name][places].tolist())), dtype=np.intp)  # DOF may have become one
            if len(at) and (at >= 0).all():
                found[f"{name}.{key}"] = at
    return found


def _forces(parts: Mapping[str, Substructure], links: Sequence[Link], weak: Sequence[bool], unit: Array) -> tuple[Matrix, Array]:
    """Of the parts that are reduced by interface forces g: -C_pᵀ in the rows of g, sparse, shape (N, m), of all weak joints; and,
    for each g, the square of how far its DOF moves at unit energy of the part's other coordinates, shape (N,).
    """
    size, compliance = len(unit), np.zeros(len(unit))
    at = {}
    for (name, part), rows in zip(parts.items(), _blocks(parts), strict=True):
        if by_forces(part):
            force = np.array(part.kinds) == FORCE  # type: ignore[attr-defined]
            at[name] = rows.start + np.flatnonzero(force)
            compliance[at[name]] = np.asarray(part.interface_rows)[:, ~force] ** 2 @ unit[rows][~force] ** 2
    columns = [sp.csr_array((size, 0))]
    for link in (link for link, held in zip(links, weak, strict=True) if held):
        column = sp.csr_array((size, next(iter(link.equations.values())).shape[0]))
        for name in at.keys() & link.equations.keys():
            C = sp.coo_array(link.equations[name])
            column = column + sp.csr_array((-C.data, (at[name][C.col], C.row)), shape=column.shape)
        columns.append(column)
    return sp.csr_array(sp.hstack(columns)), compliance


def _by_joint(joints: Sequence[Joint], joined: Multiplied) -> dict[str, Matrix]:
    """The rows of G of each joint, by its name."""
    found = {}
    for number in dict.fromkeys(joined.owner.tolist()):
        name = repr(joints[number])
        if name in found:
            raise InputError(f"two joints are called {name!r}, and their multipliers could not be told apart: give each a name=")
        found[name] = joined.G[np.flatnonzero(joined.owner == number)]
    return found


def _matrices(parts: Mapping[str, Substructure], links: Sequence[Link], joined: Multiplied,
              dense: bool) -> tuple[Matrix, Matrix, Matrix]:
    """M, D, K in the coordinates of the system, with springs and multipliers."""
    blocks = dict(zip(parts, _blocks(parts), strict=True))
    S = joined.S.toarray() if dense else joined.S
    springs = [(sum(R @ S[blocks[part]] for part, R in link.motions.items()), link) for link in links if link.motions]
    found = []
    for key in "MDK":
        matrices = [getattr(part, key) for part in parts.values()]
        if dense:
            A = sum(S[rows].T @ (matrix @ S[rows]) for matrix, rows in zip(matrices, blocks.values(), strict=True))
        else:
            A = sp.csr_array(S.T @ (sp.block_diag([sp.csr_array(one) for one in matrices], format="csr") @ S))
        for R, link in springs:
            middle = {"K": link.stiffness, "D": link.damping}.get(key)
            if middle is not None and np.any(middle):
                A = A + (R.T @ (middle if dense else sp.csr_array(middle)) @ R)
        if key == "K" and len(joined.owner):
            A = A + (joined.work().toarray() if dense else joined.work())
        plain = all(is_symmetric(one) for one in (*matrices, *(link.damping for link in links if key == "D")))
        found.append((A + A.T) / 2 if plain else A)  # but for rounding it is symmetric
    return found[0], found[1], found[2]
