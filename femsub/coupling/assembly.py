"""`couple`: substructures joined to a system, which is a `Substructure` again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from femsub.algebra import (
    ROUNDING,
    SINGULAR,
    SUMS,
    Equations,
    block_diagonal,
    comparable,
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
from femsub.checks import DENSE, EQUAL, Array, InputError, InputTypeError, Matrix, choice, instance, items, mapping, naming, word
from femsub.coupling.dual import Multiplied, finite_span, interface_forces, multiplied
from femsub.coupling.joints import End, Joint, Link, site
from femsub.model import (
    Carried,
    DofMap,
    Estimate,
    Inertia,
    Joined,
    ReducedSubstructure,
    Substructure,
    checked_sets,
    size_of_products,
)


@dataclass(frozen=True, eq=False, repr=False)
class System(Substructure):
    """Joined parts as one substructure: M ẍ + D ẋ + K x = f. `couple` makes it.

    x, shape (n,), are the coordinates that the joints leave free. A system is used like any other substructure. It has the ports
    and interface sets of its parts, with the part's name in front, as 'disc.belt'.

    Attributes
    ----------
    parts : mapping of str to Substructure
    joints : tuple of Joint
    L : sparse, or dense if all parts are, shape (N, n)
        q = L x. q stacks the coordinates of all parts.
    open : mapping of str to ndarray of int
        The system's interface: for each part, positions in the interface of the part.
    redundant : int
        The number of the joints' equations that follow from other equations. They were left out.
    multipliers : mapping of str to matrix, shape (m, n)
        For each joint with Lagrange multipliers, by its name: G with λ = G x. The joint exerts the forces -C_pᵀλ on the
        interface of the part p, with the C_p of its `Link`.
    assembly : str
        'primal' or 'dual', as in `couple`.
    spurious : int
        The number of negative or infinite ω² in the assembly of dual Craig-Bampton parts. The system does not contain them.
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

    def __post_init__(self) -> None:
        sets, motion, noise = checked_sets(self.sets, sum(map(len, self.open.values()))), self.rigid_motion, self.noise
        super().__init__(self.M, self.K, self.D, self.interface, self.ports, self.name, H=self.H)
        self._set(parts=self.parts, joints=tuple(self.joints), L=self.L, open=self.open, multipliers=self.multipliers, sets=sets,
                  cutoff=min(part.cutoff for part in self.parts.values()))
        self._carry(motion.belonging(self.D, self.K) if isinstance(motion, Joined) else None,
                    noise if len(noise) == self.size else self.noise)

    def __repr__(self) -> str:
        kind = f"sparse, {self.K.nnz} nonzeros in K" if sp.issparse(self.K) else "dense"
        beside = f", {self.redundant} equations redundant" if self.redundant else ""
        beside += f", {sum(rows.shape[0] for rows in self.multipliers.values())} multipliers" if self.multipliers else ""
        beside += f", {self.spurious} spurious eigenvalues left out" if self.spurious else ""
        joints = f"{len(self.joints)} joint{'s' * (len(self.joints) != 1)}"
        return (f"System {self.name!r}: {self.size} DOF of {len(self.parts)} parts ({', '.join(self.parts)}) and "
                f"{joints}, {kind}, {self.interface_rows.shape[0]} interface DOF{beside}")

    def dof_name(self, row: int) -> str:
        """The name of the first DOF that moves with this coordinate, with its part, as 'pad: uz at node 12'."""
        column = self.L[:, [row]]
        at = int(np.argmax((column.toarray() if sp.issparse(column) else column).ravel() != 0))
        name, part, start = next((name, part, rows.start) for (name, part), rows in
                                 zip(self.parts.items(), rows_of_parts(self.parts), strict=True) if at < rows.stop)
        return f"{name}: {part.dof_name(at - start)}"

    @cached_property
    def interface_rows(self) -> Matrix:
        """B with u_b = B x, shape (n_b, n)."""
        return super().interface_rows if len(self.interface) else open_rows(self.parts, self.L, self.open)

    @property
    def interface_numbers(self) -> Array:
        """The coordinates that are interface DOF, shape (n_b,); all -1 if the interface combines several coordinates."""
        count = sum(map(len, self.open.values()))
        return self.interface if len(self.interface) == count else np.full(count, -1)

    @cached_property
    def interface_dofs(self) -> DofMap | None:
        """One DOF map of the interface DOF of all parts, with nodes numbered anew from 1; None if a part has no map."""
        names = [name for name, places in self.open.items() if len(places)]
        maps = [self.parts[name].interface_dofs for name in names]
        if not maps or any(one is None or one.points is None for one in maps):
            return None
        found = [one.kept(self.open[name]) for name, one in zip(names, maps, strict=True) if one]
        labels = tuple(dict.fromkeys(label for one in found for label in one.labels))
        owner = np.repeat(np.arange(len(found)), [one.size for one in found])
        nodes = np.unique([owner, np.concatenate([one.nodes for one in found])], axis=1, return_inverse=True)[1]
        components = [labels.index(one.labels[k]) for one in found for k in one.components]
        points = np.concatenate([one.in_space for one in found])
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

    def rigid_inertia(self) -> Inertia | None:
        """The inertia forces of rigid accelerations of all parts together; None if those of a part are not known."""
        own = [part.rigid_inertia() for part in self.parts.values()]
        known = [one for one in own if one is not None]
        return None if len(known) < len(own) else Inertia(np.asarray(self.L.T @ np.vstack([one.forces for one in known])),
                                                          np.sum([one.mass for one in known], axis=0))

    def collected(self, u: Mapping[str, Array]) -> Array:
        """The x, (n,) or (n, k), for which L x is closest to given displacements of the parts, listed as by `expand`.

        A superelement of another program, whose coordinates are the first of its DOF, counts as a full part.

        Raises
        ------
        InputError
            A part is reduced, so its coordinates are not displacements.
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
        factor = splu(sp.csc_array(gram + sp.diags_array((gram.diagonal() == 0) * 1.0)))  # 0 for multipliers
        return factor.solve(load.real) + 1j * factor.solve(load.imag) if np.iscomplexobj(load) else factor.solve(load)

    def with_parts(self, parts: Mapping[str, Substructure]) -> System:
        """The system with other models of some parts, such as reduced models, and with the same joints and interface.

        Raises
        ------
        InputError, InputTypeError
            A name that is not a part; a system whose damping was changed after its parts were joined; see `couple`.
        """
        for name in mapping("parts", parts, "names and substructures, as {'disc': rom}"):
            choice("part", name, self.parts)
        if self.own_damping:
            raise InputError(f"the damping of {self.name!r} was changed after its parts were joined, and the parts do not have "
                             "it. Give it to the parts before they are joined, or to the system of reduced parts")
        ends = [(name, self.parts[name].interface_numbers[places]) for name, places in self.open.items() if len(places)]
        return couple(dict(self.parts) | dict(parts), self.joints, self.name, assembly=self.assembly, interface=ends)

    def with_damping(self, D: Any) -> Self:
        """A copy with another D, shape (n, n). It has no estimate, since the estimate is not valid for another D."""
        return super().with_damping(D).estimated_by(None)._damped_here()

    def with_structural_damping(self, H: Any) -> Self:
        """A copy with another H, shape (n, n), symmetric; None removes it."""
        return super().with_structural_damping(H)._damped_here()

    def _damped_here(self) -> Self:
        return self._with(own_damping=True, pencil=self.pencil)

    def estimated_by(self, estimate: Estimate | None) -> Self:
        """A copy with this estimate of its errors, whose cut-off is limited to the system's."""
        within = None if estimate is None else replace(estimate, cutoff=min(estimate.cutoff, self.cutoff))
        return self._with(estimate=within, pencil=self.pencil)

    def interface_forces(self, omega: Array, x: Array) -> dict[str, Array]:
        """The forces g on the interface of each part in undamped motion: Bᵀg = (K - ω²M)q with u_b = Bq, {name: (n_b, k)}.

        g are the forces of the joints, which balance the elastic and inertia forces of the part. In a reduced part whose
        interface displacements combine several coordinates, g is the least-squares solution.

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

    The parts may be full, reduced by any method, or systems, in any combination. Equal DOF become one coordinate. A DOF that is
    equal to a sum of other DOF is replaced by that sum. If interface displacements combine several generalised coordinates
    (Craig-Chang), the joined displacements become coordinates first. If they are not independent, a basis of the equations' null
    space is used. Parts reduced by `DualCraigBampton` are joined weakly, by their interface forces.

    Parameters
    ----------
    parts : mapping of str to Substructure
        The parts by name. A name must not contain a dot.
    joints : sequence of Joint
        `Rigid`, `Spring`, `Tied`, `Averaged`, `Kinematic`, or a subclass of `femsub.coupling.joints.Joint`.
    name : str
    assembly : {"primal", "dual"}
        "dual" keeps the coordinates of the parts and adds the Lagrange multipliers λ of the joints as coordinates:
        K = [[K, Aᵀ], [A, 0]], M = diag(M, 0). This K is indefinite. The finite eigenvalues are those of "primal":
        `complex_modes` projects the multipliers out first.
    interface : sequence of ends, optional
        The interface of the system, for further joints: (part, set) or (part, list of DOF). Joined DOF are allowed. The default
        is all interface DOF of the parts that are not joined, and all DOF of named sets that are only partly joined.

    Returns
    -------
    System
        A `Substructure` again; ``.expand(x)`` returns the displacements of each part.

    Raises
    ------
    InputError, InputTypeError
        A part without any joint, an unknown part or set, interfaces that do not meet, an end that is not an interface DOF,
        joints that allow no motion. The message names the part and the joint.

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
    parts = dict(mapping("parts", parts, "names and substructures, as {'disc': rom, 'pad': full}"))
    if not parts:
        raise InputError("parts is empty: name at least one")
    for key, part in parts.items():
        if not word("the name of a part", key) or "." in key:
            raise InputError(f"a part's name must be a word without a dot, since ports are named 'part.port', not {key!r}")
        instance(f"the part {key!r}", part, Substructure)
    choice("assembly", assembly, ("primal", "dual"))
    joints = [instance("each of joints", joint, Joint, "as Rigid(('disc', 'left'), ('pad', 'right'))")  # type: ignore[type-abstract]
              for joint in items("joints", joints, "joints")]
    links = [linked(joint, parts) for joint in joints]
    check_connected(parts, links)
    full = {key: part for key, part in parts.items() if not isinstance(part, ReducedSubstructure)}
    for key, part in full.items():  # joints act on the interface, contacts on ports
        acting = [part.D, part.H, *(w.reshape(part.size, -1) for w in part.ports.values())]
        part.refuse_empty(*acting, rows=part.interior, name=key)
    C, owner = conditions(parts, links)
    A = sp.csr_array(C @ block_diagonal([part.interface_rows for part in parts.values()]))
    A.sort_indices()
    physical = np.concatenate([np.isin(np.arange(part.size), part.interface) for part in parts.values()])
    equations = Equations(A, comparable(units_of_energy(parts)), physical, owner)
    by_force, compliance = forces_on_parts(parts, equations.unit)
    forces = sp.csr_array(-by_force @ C.T)

    def refuse(owner: Array, equations: int, coordinates: int) -> None:
        """Raises an error for locked coordinates. They are caused by too few modes, unless the parts have all their modes."""
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
        # forces on the open interface, and forces on DOF with springs
        kept = (np.bincount(C.indices, minlength=len(compliance)) == 0) | (sprung(parts, links).astype(float) @ abs(by_force) > 0)
        kept &= compliance > 0
        K = block_diagonal([part.K for part in parts.values()])
        joined = multiplied(equations.chosen(dual), found.L, forces, by_force[:, kept], compliance[kept], K, refuse)
        redundant += int(dual.sum()) - len(joined.owner)
        weakly = bool(forces.nnz)
        if weakly and joined.S.shape[1] > DENSE:
            raise InputError(f"{name!r} has {joined.S.shape[1]} coordinates. Dual Craig-Bampton parts take a decomposition of "
                             f"all of them, up to {DENSE}: reduce the other parts too, or reduce those by CraigChang, which "
                             "spans the same space")
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
    # a system of full and reduced parts is dense above the share of entries at which `product` multiplies dense matrices
    if sp.issparse(K) and not all(sp.issparse(part.K) for part in parts.values()) and K.nnz > 0.3 * K.shape[0] ** 2:
        M, D, K = (A.toarray() for A in (M, D, K))
    L = joined.S if sp.issparse(K) else joined.S.toarray()
    unit, ports, losses = reach(joined.S, equations.unit), {}, []
    noise = [np.zeros((L.shape[1], 0))]  # the rounding of all projections in D: of the parts, and of LᵀDL
    for (key, part), rows in zip(parts.items(), rows_of_parts(parts), strict=True):
        noise += [abs(joined.S[rows]).T @ part.noise, size_of_products(part.D, joined.S[rows])]
        if part.H is not None:
            losses.append(L[rows].T @ (part.H @ L[rows]))
        for port, w in part.ports.items():
            # Lᵀw, exactly 0 if the joints hold the port: with rounding in it, stability would be lost at a slope of 1e30
            loads = w.reshape(len(w), -1)
            whole = (np.abs(loads) * equations.unit[rows, None]).max(axis=0, initial=0.0)
            ports[f"{key}.{port}"] = links_without_rounding([(loads.T @ L[rows], whole)], unit).T.reshape(-1, *w.shape[1:])
    H = sum(losses[1:], losses[0]) if losses else None
    sets = {}  # the parts' sets, 'disc.left', with all their DOF in the interface of the system
    for key, part in parts.items():
        for inner, places in part.sets.items():
            at = np.array(list(dict.fromkeys(place[key][places].tolist())), dtype=np.intp)  # two DOF may be one coordinate now
            if len(at) and (at >= 0).all():
                sets[f"{key}.{inner}"] = at
    multipliers: dict[str, Matrix] = {}
    for number in dict.fromkeys(joined.owner.tolist()):
        key = repr(joints[number])
        if key in multipliers:
            raise InputError(f"two joints are called {key!r}, so their multipliers share a name: give each a name=")
        multipliers[key] = joined.G[np.flatnonzero(joined.owner == number)]
    motion = Joined(tuple(parts.values()), joined.S, units_of_energy(parts), equations.A,
                    *(tuple(sp.csr_array(C) @ R for R, link in springs if np.any(C := getattr(link, key)))
                      for key in ("stiffness", "damping")))
    return System(M, K, D, columns, ports, name, parts=parts, joints=tuple(joints), L=L, open=open_, sets=sets,
                  redundant=redundant, multipliers=multipliers, spurious=spurious, assembly=assembly, rigid_motion=motion,
                  noise=np.hstack(noise), H=None if H is None else (H + H.T) / 2)


def _matrices(parts: Mapping[str, Substructure], springs: Sequence[tuple[Matrix, Link]], joined: Multiplied,
              unit: Array, dense: bool) -> tuple[Matrix, Matrix, Matrix]:
    """M, D, K in the coordinates of the system, with springs and multipliers."""
    S = joined.S.toarray() if dense else joined.S
    alike = not dense and is_identity(S)  # only springs and contacts join the parts: each product would be a copy
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
                moving = np.unique(joined.S[rows].indices)  # only a few coordinates of the system move a part
                T = joined.S[rows][:, moving]
                A[np.ix_(moving, moving)] += product(T.T, product(matrix, T))
        else:
            A = block_diagonal(matrices)
            if not alike:
                A = sp.csr_array(S.T @ (A @ S))
        plain = all(is_symmetric(one) for one in (*matrices, *(link.damping for _, link in springs if key == "D")))
        if plain and not alike:
            A = (A + A.T) / 2  # A is symmetric up to rounding
        added = [R.T @ (C if dense else sp.csr_array(C)) @ R for R, link in moved if of and np.any(C := getattr(link, of))]
        if key == "K" and len(joined.owner):
            added.append(joined.work().toarray() if dense else joined.work())
        if added:  # summed first, since these matrices have few entries and A has many
            few = sum(added)
            A = A + ((few + few.T) / 2 if plain else few)
        found.append(A)
    return found[0], found[1], found[2]


def _settled(parts: Mapping[str, Substructure], springs: Sequence[tuple[Matrix, Link]], joined: Multiplied,
             matrices: tuple[Matrix, Matrix, Matrix]) -> tuple[Matrix, Matrix, Matrix]:
    """M, D, K in which mass and stiffness that are only rounding are 0, for massless coordinates and rigid motion.

    m_jj and k_jj are compared with the sum of the absolute values of their terms: only this sum shows that a coordinate has no
    mass or no stiffness. If each coordinate is a DOF, nothing cancels.
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
    # entries of L up to ROUNDING of a motion count as 0, so a mass up to ROUNDING², relative to the stiffness, does too
    least = ROUNDING**2 * stiffness[mixed] / units(M.diagonal(), stiffness)[1]
    bound["M"] = np.maximum(bound["M"], least / SUMS)  # `without_dust` multiplies it by SUMS
    M, K = (without_dust(A, np.bincount(mixed, bound[key], len(stiffness))) for key, A in (("M", M), ("K", K)))
    return M, D, K


def linked(joint: Joint, parts: Mapping[str, Substructure]) -> Link:
    """The `Link` of a joint, with checked sizes. An error names the joint."""
    try:
        link = instance("what a joint's link returns", joint.link(parts), Link)
    except (InputError, InputTypeError) as error:
        raise type(error)(f"{joint!r}: {error}") from None
    for what, table in (("equations", link.equations), ("motions", link.motions)):
        sizes = {matrix.shape[0] for matrix in table.values()}
        for part, matrix in table.items():
            width = len(parts[part].interface_numbers) if what == "equations" else parts[part].size
            if matrix.shape[1] != width or len(sizes) > 1:
                raise InputError(f"{joint!r}: its {what} of {part!r} must have {width} columns and as many rows as those of the "
                                 f"other parts, but are {matrix.shape}")
    return link


def check_connected(parts: Mapping[str, Substructure], links: Sequence[Link]) -> None:
    """Raises an error unless all parts are connected, by joints or through the ground."""
    names, ground = list(parts), "."  # the ground counts as a part; names of parts contain no dot
    groups = [{name} for name in (*names, ground)]
    for link in links:
        members = {*link.equations, *link.motions, *([ground] if link.grounded else [])}
        touched = [group for group in groups if group & members]
        groups = [group for group in groups if not group & members] + [set().union(*touched)]
    first = next(group for group in groups if names[0] in group)
    apart = [name for name in names if name not in first]
    if apart and (alone := [name for name in names if {name} in groups]):
        raise InputError(f"the part {alone[0]!r} is joined to nothing: give a joint that names it, or leave it out")
    if apart:
        raise InputError(f"no joints lead from {names[0]!r} to {', '.join(map(repr, apart))}: these are systems of their own")


def rows_of_parts(parts: Mapping[str, Substructure]) -> list[slice]:
    """The rows of each part's coordinates in q."""
    ends = np.cumsum([0, *(part.size for part in parts.values())])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def units_of_energy(parts: Mapping[str, Substructure]) -> Array:
    """The displacement of each coordinate at unit energy, (N,): (k_jj + ω² m_jj)^(-1/2) with a typical ω of all parts."""
    K = np.concatenate([np.abs(part.K.diagonal()) for part in parts.values()])
    M = np.concatenate([np.abs(part.M.diagonal()) for part in parts.values()])
    return units(M, K)[0]


def on_all_parts(tables: Sequence[Mapping[str, Matrix]], widths: Mapping[str, int]) -> Matrix:
    """The matrices of joints, each on some of the parts, stacked for the coordinates of all parts: sparse, (m, Σ widths)."""
    ends = np.cumsum([0, *widths.values()])
    whole = sp.eye_array(ends[-1], format="csr")
    picked = {name: whole[a:b] for name, (a, b) in zip(widths, pairwise(ends), strict=True)}
    blocks = [sum(sp.csr_array(matrix) @ picked[name] for name, matrix in table.items()) for table in tables]
    return sp.csr_array(sp.vstack([sp.csr_array((0, ends[-1])), *blocks]))


def conditions(parts: Mapping[str, Substructure], links: Sequence[Link]) -> tuple[Matrix, Array]:
    """C (m, Σ n_b), the stacked equations C u_b = 0 of all joints on the interfaces of all parts, and the joint of each row."""
    widths = {name: len(part.interface_numbers) for name, part in parts.items()}
    found = {number: link.equations for number, link in enumerate(links) if link.equations}
    counts = [next(iter(table.values())).shape[0] for table in found.values()]  # equations of each joint
    owner = np.repeat(np.array([*found], dtype=int), np.array(counts, dtype=int))
    return on_all_parts([*found.values()], widths), owner


def with_interfaces(parts: Mapping[str, Substructure], C: Matrix, given: Equations) -> tuple[Matrix, Equations]:
    """q = T z, sparse, and the `given` equations C u_b = 0 in z. Joined interface displacements are coordinates in z.

    If the interface displacements of a part combine several coordinates (Craig-Chang), and are independent, they replace as many
    of these coordinates. Otherwise equations between such parts would couple all coordinates of all parts joined in a row.
    """
    turns, rows, kinds, start = [], [], [], 0
    used = np.bincount(C.indices, minlength=C.shape[1]) > 0
    for part, at in zip(parts.values(), rows_of_parts(parts), strict=True):
        B, physical = sp.csr_array(part.interface_rows), given.physical[at]
        joined = np.flatnonzero(used[start:start + B.shape[0]])
        start += B.shape[0]
        T, places = None, joined
        if len(joined):
            # units of energy at the part's lowest ω², where the energy of its displacements is almost only strain energy
            mass, stiffness = np.abs(part.M.diagonal()), np.abs(part.K.diagonal())
            square = np.divide(stiffness, mass, out=np.zeros(len(mass)), where=mass > 0)
            square = square[square > SINGULAR * square.max(initial=0.0)]  # smaller values are rounding, of rigid motion
            energy = stiffness + float(square.min() if len(square) else 1.0) * mass
            T, places = recovered(B[joined], comparable(np.where(energy > 0, energy, 1.0) ** -0.5))
        if T is not None:
            B = sp.csr_array((np.ones(len(places)), (joined, places)), shape=B.shape)
            physical = (np.diff(sp.csc_array(T).indptr) == 1) & (T.T @ physical.astype(float) > 0)
            physical[places] = True
        turns.append(sp.eye_array(part.size) if T is None else T)
        rows.append(B)
        kinds.append(physical)
    T = block_diagonal(turns)
    unit = (T.multiply(T).T @ given.unit[:, None] ** -2.0).ravel() ** -0.5
    A = sp.csr_array(C @ block_diagonal(rows))
    A.sort_indices()
    return T, Equations(A, unit, np.concatenate(kinds), given.owner)


def forces_on_parts(parts: Mapping[str, Substructure], unit: Array) -> tuple[Matrix, Array]:
    """A (N, Σ n_b), sparse, and the compliance (Σ n_b,) of interface DOF of parts that are reduced by interface forces.

    A gives the coordinates of these parts from interface forces. The compliance is the squared displacement at unit energy.
    """
    places, compliance = [], []
    for part, rows in zip(parts.values(), rows_of_parts(parts), strict=True):
        place = interface_forces(part)
        places.append(place)
        squares = np.zeros(place.shape[1])
        if place.nnz:
            others = np.diff(place.indptr) == 0
            squares = np.asarray(part.interface_rows)[:, others] ** 2 @ unit[rows][others] ** 2  # 0 if no mode moves the DOF
            squares += np.einsum("ij,ij->j", place.toarray(), part.K @ place.toarray())
        compliance.append(squares)
    return sp.csr_array(block_diagonal(places)), np.concatenate(compliance)


def springs_of(parts: Mapping[str, Substructure], links: Sequence[Link]) -> list[tuple[Matrix, Link]]:
    """R (s, N) of each joint with springs or dampers, which act on the motion R q of the coordinates of all parts."""
    widths = {name: part.size for name, part in parts.items()}
    return [(on_all_parts([link.motions], widths), link) for link in links if link.motions]


def sprung(parts: Mapping[str, Substructure], links: Sequence[Link]) -> Array:
    """Which coordinates of the parts are connected to springs or dampers, bool, shape (N,)."""
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for R, _ in springs_of(parts, links):
        found[R.indices] = True
    return found


def open_rows(parts: Mapping[str, Substructure], L: Matrix, open_: Mapping[str, Array]) -> Matrix:
    """The stacked rows B_p L_p of the open interface DOF of all parts, sparse, shape (n_b, n)."""
    found = [sp.csr_array((0, L.shape[1]))]
    for (name, part), rows in zip(parts.items(), rows_of_parts(parts), strict=True):
        places = open_.get(name, ())
        if len(places):
            found.append(sp.csr_array(product(sp.csr_array(part.interface_rows)[places], sp.csr_array(L[rows]))))
    B = sp.csr_array(sp.vstack(found))
    B.eliminate_zeros()
    B.sort_indices()
    return B


def unjoined(parts: Mapping[str, Substructure], links: Sequence[Link]) -> dict[str, Array]:
    """The places in each part's interface that no equation uses, and all places of a set that has at least one of these."""
    left_of = {name: np.ones(len(part.interface_numbers), dtype=bool) for name, part in parts.items()}
    for link in links:
        for name, matrix in link.equations.items():
            left_of[name][sp.csr_array(matrix).indices] = False
    chosen = {}
    for name, part in parts.items():
        left = left_of[name]
        for places in part.sets.values():  # a corner that two edges share stays open with the edge that is not joined
            if left[places].any():
                left[places] = True
        chosen[name] = np.flatnonzero(left)
    return chosen


def listed(parts: Mapping[str, Substructure], ends: Sequence[End]) -> dict[str, Array]:
    chosen: dict[str, list[int]] = {name: [] for name in parts}
    for end in items("interface", ends, "ends, as [('disc', 'left')]"):
        with naming("interface"):
            found = site(parts, end)
        chosen[found.part] += found.places.tolist()
    return {name: np.array(list(dict.fromkeys(places)), dtype=np.intp) for name, places in chosen.items()}


def distinct(parts: Mapping[str, Substructure], chosen: Mapping[str, Array], L: Matrix,
              unit: Array) -> tuple[dict[str, Array], dict[str, Array]]:
    """The open places, and for each place in a part's interface its place in the system's interface (-1: none).

    Open are the chosen places whose DOF moves, and is not equal to the DOF of an earlier place. Within one part, DOF are equal
    only if they are the same coordinate: the shapes of a reduced part may move two DOF equally by chance.
    """
    B = sp.csr_array(open_rows(parts, L, chosen) @ sp.diags_array(unit))
    size = np.sqrt(B.multiply(B).sum(axis=1))
    moving = size > 0
    B = sp.csr_array(sp.diags_array(1 / np.where(moving, size, 1.0)) @ B)
    # equal rows have equal products with a random vector
    value = B @ np.random.default_rng(3).standard_normal(B.shape[1])
    order = np.argsort(np.where(moving, value, np.inf), kind="stable")[:int(moving.sum())]
    one, other = order[:-1], order[1:]
    owner = np.repeat(np.arange(len(parts)), [len(chosen[name]) for name in parts])
    alike = (owner[one] != owner[other]) | (np.diff(B.indptr)[one] == 1)
    close = alike & (np.abs(value[other] - value[one]) <= EQUAL) & (np.abs(size[other] - size[one]) <= EQUAL * size[one])
    one, other = one[close], other[close]
    same = abs(B[one] - B[other]).max(axis=1).toarray().ravel() <= EQUAL if len(one) else np.zeros(0, dtype=bool)
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
