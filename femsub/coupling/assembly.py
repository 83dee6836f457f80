"""`couple`: substructures joined to a system, which is a `Substructure` again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from femsub.algebra import (
    ROUNDING,
    SUMS,
    block_diagonal,
    congruent,
    eliminate,
    is_identity,
    is_symmetric,
    largest,
    links_without_rounding,
    product,
    reach,
    recovered,
    units,
    without_dust,
)
from femsub.checks import Array, Matrix, choice, instance, items, mapping
from femsub.coupling.dual import Multiplied, check_span, finite_span, multiplied
from femsub.coupling.joined import (
    check_connected,
    checked_parts,
    conditions,
    distinct,
    equations_of,
    forces_on_parts,
    linked,
    listed,
    open_rows,
    rows_of_parts,
    springs_of,
    sprung,
    units_of_energy,
    unjoined,
    whole_sets,
    with_interfaces,
)
from femsub.coupling.joints import End, Joint, Link, spatial
from femsub.errors import InputError
from femsub.model import Carried, DofMap, Estimate, Joined, ReducedSubstructure, Substructure, checked_sets, size_of_products


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
    estimate : Estimate, optional
        Error estimates of its modes in the band, if its parts were reduced to a tolerance of the system.

    Examples
    --------
    >>> import femsub as fs
    >>> left, right = fs.chain(5, interface=[5]), fs.chain(6, interface=[1], fixed=False)
    >>> system = fs.couple({"left": left, "right": right}, [fs.Rigid(("left", [4]), ("right", [0]))])
    >>> system
    System 'system': 10 DOF of 2 parts (left, right) and 1 joint, sparse, 28 nonzeros in K, 0 interface DOF
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
    estimate: Estimate | None = field(default=None, init=False)
    own_damping: bool = field(default=False, init=False)  #: whether D or H was changed since the parts were joined
    rigid_motion: Carried = None
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __init__(self, M: Any, K: Any, D: Any, interface: Any, ports: Mapping[str, Any], name: str, *,
                 parts: Mapping[str, Substructure], joints: Iterable[Joint], L: Matrix, open: Mapping[str, Array],
                 sets: Mapping[str, Array] | None = None, redundant: int = 0,
                 multipliers: Mapping[str, Matrix] | None = None, spurious: int = 0, assembly: str = "primal",
                 rigid_motion: Carried = None, noise: Array | None = None, H: Any = None) -> None:
        super().__init__(M, K, D, interface, ports, name, H=H)
        self._set(parts=dict(parts), joints=tuple(joints), L=L, open=dict(open), redundant=redundant,
                  multipliers=multipliers or {}, spurious=spurious, assembly=assembly,
                  sets=checked_sets(sets, sum(map(len, open.values()))), cutoff=min(part.cutoff for part in parts.values()))
        self._carry(rigid_motion.belonging(self.D, self.K) if isinstance(rigid_motion, Joined) else None,
                    self.noise if noise is None or len(noise) != self.size else noise)

    def __repr__(self) -> str:
        kind = f"sparse, {self.K.nnz} nonzeros in K" if sp.issparse(self.K) else "dense"
        beside = f", {self.redundant} equations redundant" if self.redundant else ""
        beside += f", {sum(rows.shape[0] for rows in self.multipliers.values())} multipliers" if self.multipliers else ""
        beside += f", {self.spurious} spurious eigenvalues left out" if self.spurious else ""
        joints = f"{len(self.joints)} joint{'s' * (len(self.joints) != 1)}"
        return (f"System {self.name!r}: {self.size} DOF of {len(self.parts)} parts ({', '.join(self.parts)}) and "
                f"{joints}, {kind}, {self.interface_rows.shape[0]} interface DOF{beside}")

    def dof_name(self, row: int) -> str:
        """The part's name of the first of its DOF that move with this coordinate, as 'pad: uz at node 12'."""
        column = self.L[:, [row]]
        at = int(np.argmax((column.toarray() if sp.issparse(column) else column).ravel() != 0))
        ends = np.cumsum([0, *(part.size for part in self.parts.values())])
        place = int(np.searchsorted(ends, at, "right")) - 1
        name, part = list(self.parts.items())[place]
        return f"{name}: {part.dof_name(at - int(ends[place]))}"

    @cached_property
    def interface_rows(self) -> Matrix:
        """B with u_b = B x, shape (n_b, n)."""
        return super().interface_rows if len(self.interface) else open_rows(self.parts, self.L, self.open)

    @property
    def interface_numbers(self) -> Array:
        """The coordinates that are the interface, shape (n_b,); -1 where it is spread over many coordinates."""
        count = sum(map(len, self.open.values()))
        return self.interface if len(self.interface) == count else np.full(count, -1)

    @cached_property
    def interface_dofs(self) -> DofMap | None:
        """The maps of all parts in one, with nodes numbered anew from 1; None if a part has no map."""
        names = [name for name, places in self.open.items() if len(places)]
        maps = [self.parts[name].interface_dofs for name in names]
        if not maps or any(one is None or one.points is None for one in maps):
            return None
        found = [one.kept(self.open[name]) for name, one in zip(names, maps, strict=True) if one]
        labels = tuple(dict.fromkeys(label for one in found for label in one.labels))
        owner = np.repeat(np.arange(len(found)), [one.size for one in found])
        nodes = np.unique([owner, np.concatenate([one.nodes for one in found])], axis=1, return_inverse=True)[1]
        components = [labels.index(one.labels[k]) for one in found for k in one.components]
        points = np.concatenate([spatial(one.points) for one in found if one.points is not None])
        return DofMap(nodes.ravel() + 1, components, labels, points)

    def expand(self, x: Array) -> dict[str, Array]:
        """The displacements of each part, {name: u}, from x of shape (n,) or (n, k); u has the shape (n_p,) or (n_p, k).

        For a reduced part u = V q. The parts of a system within the system are listed one by one, as 'front.disc'.
        """
        x = np.asarray(x)
        if x.ndim == 0 or x.shape[0] != self.size:
            raise InputError(f"x must have {self.size} rows, one per coordinate, but its shape is {x.shape}")
        found: dict[str, Array] = {}
        for (name, part), rows in zip(self.parts.items(), rows_of_parts(self.parts), strict=True):
            q = self.L[rows] @ x
            if isinstance(part, System):
                found |= {f"{name}.{inner}": u for inner, u in part.expand(q).items()}
            else:
                found[name] = part.expand(q) if isinstance(part, ReducedSubstructure) else q
        return found

    def collected(self, u: Mapping[str, Array]) -> Array:
        """The x whose L x comes nearest to given displacements of the parts, as `expand` lists them; shape (n,) or (n, k).

        A superelement of another program, whose coordinates are the first of its DOF, counts as a full part.

        Raises
        ------
        InputError
            A part is reduced, so that its coordinates are no displacements.
        """
        blocks = []
        mapping("u", u, "names and displacements, as expand gives them")
        for name, part in self.parts.items():
            if isinstance(part, ReducedSubstructure) and not np.array_equal(part.V[:part.size], np.eye(part.size)):
                raise InputError(f"the part {name!r} is reduced: its coordinates do not follow from displacements")
            inner = {key.removeprefix(f"{name}."): one for key, one in u.items() if key.startswith(f"{name}.")}
            rows = np.shape(u.get(name, 0.0))[:1]
            if not isinstance(part, System) and rows != (part.size,) and rows != np.shape(getattr(part, "V", ()))[:1]:
                raise InputError(f"u must have {part.size} rows for the part {name!r}, but {list(u)} are given, and its shape is "
                                 f"{np.shape(u.get(name, 0.0))}")
            blocks.append(part.collected(inner) if isinstance(part, System) else u[name][:part.size])
        L = sp.csc_array(self.L)
        gram, load = L.T @ L, L.T @ np.concatenate(blocks)
        factor = splu(sp.csc_array(gram + sp.diags_array((gram.diagonal() == 0) * 1.0)))  # multipliers move nothing, and are 0
        return factor.solve(load.real) + 1j * factor.solve(load.imag) if np.iscomplexobj(load) else factor.solve(load)

    def with_parts(self, parts: Mapping[str, Substructure]) -> System:
        """The same joints between other models of the parts, such as reduced ones; a part that is not named stays.

        The interface is the same, too.

        Raises
        ------
        InputError, InputTypeError
            A name that is no part; damping that the system got after its parts were joined; see `couple`.
        """
        for name in mapping("parts", parts, "names and substructures, as {'disc': rom}"):
            choice("part", name, self.parts)
        if self.own_damping:
            raise InputError(f"the damping of {self.name!r} was changed after its parts were joined, and the parts do not have "
                             "it. Give it to the parts before they are joined, or to the system of reduced parts")
        ends = [(name, self.parts[name].interface_numbers[places]) for name, places in self.open.items() if len(places)]
        return couple(dict(self.parts) | dict(parts), self.joints, self.name, assembly=self.assembly, interface=ends)

    def with_damping(self, D: Any) -> Self:
        """A copy with another D, shape (n, n), and without the estimate, which is not valid for it."""
        return super().with_damping(D).estimated_by(None)._damped_here()

    def with_structural_damping(self, H: Any) -> Self:
        """A copy with another H, shape (n, n), symmetric; None removes it."""
        return super().with_structural_damping(H)._damped_here()

    def _damped_here(self) -> Self:
        return self._with(own_damping=True, pencil=self.pencil)

    def estimated_by(self, estimate: Estimate | None) -> Self:
        """A copy that carries an estimate of its errors, whose cut-off is not above the system's."""
        within = None if estimate is None else replace(estimate, cutoff=min(estimate.cutoff, self.cutoff))
        return self._with(estimate=within, pencil=self.pencil)

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
        omega, x, found = np.asarray(omega), np.asarray(x), {}
        if x.ndim == 0 or x.shape[0] != self.size or omega.shape not in ((), x.shape[1:]):
            raise InputError(f"x must have {self.size} rows and one column for each of omega, but the shapes are {x.shape} and "
                             f"{omega.shape}")
        for (name, part), rows in zip(self.parts.items(), rows_of_parts(self.parts), strict=True):
            q = self.L[rows] @ x
            balance = part.K @ q - (part.M @ q) * omega**2
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
    is equal to a sum of others is replaced by that sum. Where an interface is spread over generalised coordinates (Craig-Chang),
    its joined displacements become coordinates first. Where they are not independent, a basis of the equations' null space is
    taken. Parts reduced by `DualCraigBampton` are joined weakly, by
    their interface forces.

    Parameters
    ----------
    parts : mapping of str to Substructure
        The parts by name. A name has no dot.
    joints : sequence of Joint
        `Rigid`, `Spring`, `Tied`, `Averaged`, `Kinematic`, or a subclass of `femsub.coupling.joints.Joint`.
    name : str
    assembly : {"primal", "dual"}
        "dual" keeps the coordinates of the parts and adds the Lagrange multipliers λ of the joints as coordinates:
        K = [[K, Aᵀ], [A, 0]], M = diag(M, 0). This K is indefinite. The finite eigenvalues are those of "primal":
        `complex_modes` projects the multipliers out first.
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
    parts = checked_parts(parts)
    choice("assembly", assembly, ("primal", "dual"))
    joints = [instance("each of joints", joint, Joint, "as Rigid(('disc', 'left'), ('pad', 'right'))")  # type: ignore[type-abstract]
              for joint in items("joints", joints, "joints")]
    links = [linked(joint, parts) for joint in joints]
    check_connected(parts, links)
    full = {key: part for key, part in parts.items() if not isinstance(part, ReducedSubstructure)}
    for key, part in full.items():  # joints reach the interface, contacts the ports
        acting = [part.D, part.H, *(w.reshape(part.size, -1) for w in part.ports.values())]
        part.refuse_empty(*acting, rows=part.interior, name=key)
    C, owner = conditions(parts, links)
    equations = equations_of(parts, C, owner)
    by_force, compliance = forces_on_parts(parts, equations.unit)
    forces = sp.csr_array(-by_force @ C.T)

    def refuse(owner: Array, equations: int, coordinates: int) -> None:
        """Locked coordinates are a result of too few modes, unless all parts of these joints have all of theirs."""
        named = dict.fromkeys(owner.tolist())
        if any(np.isfinite(parts[part].cutoff) for i in named for part in links[i].equations):
            raise InputError(f"{', '.join(repr(joints[i]) for i in named)}: the {equations} equations leave no motion to the "
                             f"{coordinates} coordinates they couple: keep more modes in these parts, or join fewer DOF")

    dual = np.isin(owner, owner[forces.indices]) | (assembly == "dual")
    turn, between = with_interfaces(parts, C[np.flatnonzero(~dual)], equations.chosen(~dual))
    found = eliminate(between, refuse)
    found = replace(found, L=sp.csr_array(turn @ found.L))
    joined = Multiplied(found.L, sp.csr_array((0, found.L.shape[1])), equations.A[:0], found.unit, owner[:0])
    redundant, spurious, dense = found.redundant, 0, not any(sp.issparse(part.K) for part in parts.values())
    weakly = False
    if dual.any() or by_force.nnz:
        forces = forces[:, np.flatnonzero(dual)]
        # on the open interface, and where springs pull beside the joints
        kept = (np.bincount(C.indices, minlength=len(compliance)) == 0) | (sprung(parts, links).astype(float) @ abs(by_force) > 0)
        kept &= compliance > 0
        K = block_diagonal([part.K for part in parts.values()])
        joined = multiplied(equations.chosen(dual), found.L, forces, by_force[:, kept], compliance[kept], K, refuse)
        redundant += int(dual.sum()) - len(joined.owner)
        weakly = bool(forces.nnz)
        if weakly:
            check_span(joined.S.shape[1], name)
    if not joined.S.shape[1]:
        raise InputError(f"the joints of {name!r} leave nothing to move")
    springs = springs_of(parts, links)
    chosen = unjoined(parts, links) if interface is None else listed(parts, interface)
    if weakly:
        matrices = _matrices(parts, springs, joined, equations.unit, True)
        X, unit, matrices, spurious = finite_span(*matrices, joined.multipliers, open_rows(parts, joined.S, chosen))
        joined = joined.through(X, unit)
        if not len(unit):
            raise InputError(f"the joints of {name!r} leave no finite mode")
    open_, place = distinct(parts, chosen, joined.S, joined.unit)
    T, columns = recovered(open_rows(parts, joined.S, open_), joined.unit)
    if T is not None:
        joined = joined.through(T, joined.unit)
        if weakly:
            matrices = congruent(matrices[0], T), congruent(matrices[1], T), congruent(matrices[2], T)
    if not weakly:
        matrices = _matrices(parts, springs, joined, equations.unit, dense)
    M, D, K = matrices if len(joined.owner) and not weakly else _settled(parts, springs, joined, matrices)
    # a system of full and reduced parts is kept dense from the share of entries on from which `product` multiplies dense matrices
    if sp.issparse(K) and not all(sp.issparse(part.K) for part in parts.values()) and K.nnz > 0.3 * K.shape[0] ** 2:
        M, D, K = (A.toarray() for A in (M, D, K))
    L = joined.S if sp.issparse(K) else joined.S.toarray()
    unit, ports, losses = reach(joined.S, equations.unit), {}, []
    noise = [np.zeros((L.shape[1], 0))]  # the rounding of all projections in D: that of the parts, and that of LᵀDL
    for (key, part), rows in zip(parts.items(), rows_of_parts(parts), strict=True):
        noise += [abs(joined.S[rows]).T @ part.noise, size_of_products(part.D, joined.S[rows])]
        if part.H is not None:
            losses.append(L[rows].T @ (part.H @ L[rows]))
        for port, w in part.ports.items():
            # Lᵀw, exactly 0 where the joints hold the port: else it would lose its stability at a slope of 1e30
            loads = w.reshape(len(w), -1)
            whole = (np.abs(loads) * equations.unit[rows, None]).max(axis=0, initial=0.0)
            ports[f"{key}.{port}"] = links_without_rounding([(loads.T @ L[rows], whole)], unit).T.reshape(-1, *w.shape[1:])
    H = sum(losses[1:], losses[0]) if losses else None
    multipliers: dict[str, Matrix] = {}
    for number in dict.fromkeys(joined.owner.tolist()):
        key = repr(joints[number])
        if key in multipliers:
            raise InputError(f"two joints are called {key!r}, so their multipliers share a name: give each a name=")
        multipliers[key] = joined.G[np.flatnonzero(joined.owner == number)]
    motion = Joined(tuple(parts.values()), joined.S, units_of_energy(parts), equations.A,
                    *(tuple(sp.csr_array(C) @ R for R, link in springs if np.any(C := getattr(link, key)))
                      for key in ("stiffness", "damping")))
    return System(M, K, D, columns, ports, name, parts=parts, joints=joints, L=L, open=open_, sets=whole_sets(parts, place),
                  redundant=redundant, multipliers=multipliers, spurious=spurious, assembly=assembly, rigid_motion=motion,
                  noise=np.hstack(noise), H=None if H is None else (H + H.T) / 2)


def _matrices(parts: Mapping[str, Substructure], springs: Sequence[tuple[Matrix, Link]], joined: Multiplied,
              unit: Array, dense: bool) -> tuple[Matrix, Matrix, Matrix]:
    """M, D, K in the coordinates of the system, with springs and multipliers."""
    S = joined.S.toarray() if dense else joined.S
    alike = not dense and is_identity(S)  # nothing is joined but by springs and contacts: each product would be a copy
    own, rows_of = reach(joined.S, unit), dict(zip(parts, rows_of_parts(parts), strict=True))
    moved = []
    for _, link in springs:
        ends = [(sp.csr_array(R), rows_of[part]) for part, R in link.motions.items()]
        moved.append((links_without_rounding([(R @ S[at], largest(abs(R) * unit[at])) for R, at in ends], own), link))
    found = []
    for key, of in (("M", ""), ("D", "damping"), ("K", "stiffness")):
        matrices = [getattr(part, key) for part in parts.values()]
        if dense:
            A = np.zeros((S.shape[1], S.shape[1]))
            for matrix, rows in zip(matrices, rows_of_parts(parts), strict=True):
                moving = np.unique(joined.S[rows].indices)  # few coordinates of the system move a part
                T = joined.S[rows][:, moving]
                A[np.ix_(moving, moving)] += product(T.T, product(matrix, T))
        else:
            A = block_diagonal(matrices)
            if not alike:
                A = sp.csr_array(S.T @ (A @ S))
        plain = all(is_symmetric(one) for one in (*matrices, *(link.damping for _, link in springs if key == "D")))
        if plain and not alike:
            A = (A + A.T) / 2  # but for rounding it is symmetric
        added = [R.T @ (C if dense else sp.csr_array(C)) @ R for R, link in moved if of and np.any(C := getattr(link, of))]
        if key == "K" and len(joined.owner):
            added.append(joined.work().toarray() if dense else joined.work())
        if added:  # summed first: they have few entries, and A has many
            few = sum(added)
            A = A + ((few + few.T) / 2 if plain else few)
        found.append(A)
    return found[0], found[1], found[2]


def _settled(parts: Mapping[str, Substructure], springs: Sequence[tuple[Matrix, Link]], joined: Multiplied,
             matrices: tuple[Matrix, Matrix, Matrix]) -> tuple[Matrix, Matrix, Matrix]:
    """M, D, K with 0 for what is only rounding: coordinates without mass, and those of rigid motion.

    m_jj and k_jj are compared with the sums of the sizes of which they are left. Only in these sums can be seen that a
    coordinate is free. Where each coordinate is a DOF nothing cancels.
    """
    S = sp.csc_array(joined.S)
    mixed = np.flatnonzero(np.bincount(np.repeat(np.arange(S.shape[1]), np.diff(S.indptr)), S.data != 1.0, S.shape[1]))
    if not len(mixed):
        return matrices
    S = sp.csr_array(abs(S[:, mixed]))
    bound = {key: np.zeros(len(mixed)) for key in "MK"}
    for part, rows in zip(parts.values(), rows_of_parts(parts), strict=True):
        at = np.flatnonzero(np.diff(S[rows].indptr))
        own = S[rows][at]
        for key in bound:
            bound[key] += own.multiply(product(abs(getattr(part, key)[at][:, at]), own)).sum(axis=0)
    for R, link in springs:
        if np.any(link.stiffness):
            moved = abs(R) @ S
            bound["K"] += moved.multiply(abs(link.stiffness) @ moved).sum(axis=0)
    M, D, K = matrices
    stiffness = np.abs(K.diagonal())
    # links up to ROUNDING of a motion are none, so a mass up to the square of that, beside the stiffness of the coordinate
    least = ROUNDING**2 * stiffness[mixed] / units(M.diagonal(), stiffness)[1]
    bound["M"] = np.maximum(bound["M"], least / SUMS)  # of which `without_dust` takes SUMS
    M, K = (without_dust(A, np.bincount(mixed, bound[key], len(stiffness))) for key, A in (("M", M), ("K", K)))
    return M, D, K
