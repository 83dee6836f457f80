"""`Substructure`: symmetric M and K, any D, an interface and named ports. A reduced substructure is a `Substructure` again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import scipy.sparse as sp

from femsub.algebra import ROUNDING, Frozen, as_matrix, is_symmetric, rows_of_zeros, same, shared, translations
from femsub.checks import (
    EQUAL,
    POSITION,
    Array,
    InputError,
    Matrix,
    check_band,
    empty_dofs_error,
    instance,
    mapping,
    real_array,
    unknown_name,
    warn,
    whole_numbers,
    word,
)
from femsub.model.bands import beyond
from femsub.model.contact import Contacts, contacts_of, small_matrices
from femsub.model.dof_map import DofMap
from femsub.model.estimate import SHARE, Estimate
from femsub.model.held import check_held, floating
from femsub.model.inertia import Inertia, Supported
from femsub.model.origin import Origin
from femsub.model.pencil import Pencil
from femsub.model.rigid_motion import Carried, RigidMotion

if TYPE_CHECKING:
    from femsub.model.affine import Affine


@dataclass(frozen=True, eq=False, repr=False)
class Substructure(Frozen):
    """A component: mass, damping and stiffness matrices, its interface DOF and its named ports.

    M ü + D u̇ + K u = Σ w_p f_p + interface forces, with M, D, K of shape (n, n).

    Parameters
    ----------
    M, K : array_like or sparse, shape (n, n)
        Mass and stiffness, symmetric, in consistent units. A difference of a_ij and a_ji up to 1e-9 of
        sqrt(|a_ii a_jj|) counts as rounding and is averaged out, with a warning above 1e-13. Sparse matrices stay
        sparse (CSR). Mass must not be negative; DOF without mass are allowed.
    D : array_like or sparse, shape (n, n), optional
        Damping, symmetric or not.
    interface : sequence of int, or mapping of str to sequence of int
        Interface DOF, counted from 0. A reduced model lists them in this order. A mapping gives names to sets of DOF, as
        {"left": [0, 1], "right": [8, 9]}. Joints refer to a set by its name. Two sets may share a DOF.
    ports : mapping of str to array_like, shape (n,) or (n, p)
        Named columns w on which belts, forces and outputs act.
    name : str
        Used in messages and by `couple`.
    dofs : DofMap, optional
        The node, direction and coordinates of each DOF.
    sets : mapping of str to array_like of int, optional
        The named sets as positions in `interface`, counted from 0. A mapping given as `interface` sets them.
    H : array_like or sparse, shape (n, n), optional
        Structural damping, symmetric: the stiffness is K + iH for harmonic motion. A loss factor η means H = ηK, see `damped` and
        `Material`. `frequency_response`, `complex_modes` and `harmonic_balance` use it. Analyses that cannot use it refuse the
        model. `equivalent_viscous` replaces it by a D.

    Raises
    ------
    InputError, InputTypeError
        Unsymmetric or negative M, unsymmetric K or H, NaN, sizes that do not fit, an interface DOF twice or out of
        range, an unusable port.

    Warns
    -----
    FemsubWarning
        M or K is unsymmetric by more than the rounding of an assembly, or they seem to be in each other's place.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Substructure(M=[[1, 0], [0, 1]], K=[[2, -1], [-1, 1]], interface=[0], ports={"belt": [0, 1]})
    Substructure 'part': 2 DOF, dense, 1 interface DOF, ports belt
    """

    M: Matrix
    K: Matrix
    D: Matrix
    interface: Array
    ports: Mapping[str, Array]
    name: str
    dofs: DofMap | None = None
    cutoff: float = field(default=np.inf, init=False)  #: rad per unit of time; modes above it are artefacts of the reduction
    sets: Mapping[str, Array] = field(default_factory=dict)
    H: Matrix | None = None
    rigid_motion: Carried = field(default=None, init=False)  #: None for a full model: it is found from K, once
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)), init=False)  #: see `Pencil.noise`
    supported: Supported | None = field(default=None, init=False)  #: DOF held by the model's supports, if they are known

    def __init__(self, M: Any, K: Any, D: Any = None, interface: Iterable[int] | Mapping[str, Iterable[int]] = (),
                 ports: Mapping[str, Any] | None = None, name: str = "part", dofs: DofMap | None = None,
                 sets: Mapping[str, Any] | None = None, H: Any = None) -> None:
        word("name", name)
        pencil = Pencil(M, D, K)
        mass, stiffness = (part if flag else _symmetric(name, part) for name, part, flag in
                           zip("MK", (pencil.M, pencil.K), pencil.symmetric[::2], strict=True))
        diagonal = mass.diagonal()
        if diagonal.min() < 0:
            where = int(diagonal.argmin())
            raise InputError(f"M has a negative mass: M[{where}, {where}] = {diagonal[where]:.6g}")
        if not np.any(diagonal) and np.any(stiffness.data if sp.issparse(stiffness) else stiffness):  # K = 0 is allowed
            raise InputError("M has no mass at all: every diagonal entry is zero")
        # every positive semidefinite M fulfils m_ij² ≤ m_ii m_jj; a factorisation would be too expensive here
        bound = np.sqrt(diagonal)
        if sp.issparse(mass):  # with few new arrays, since the first access to their memory takes longer than the arithmetic
            size, limit = np.abs(mass.data), np.repeat(bound, np.diff(mass.indptr))
            limit *= bound[mass.indices]
        else:
            size, limit = np.abs(mass), np.outer(bound, bound)
        limit *= 1 + EQUAL
        if (size > limit).any():
            at = int((size - limit).argmax())
            i, j = divmod(at, len(bound))
            if sp.issparse(mass):
                i, j = int(np.searchsorted(mass.indptr, at, "right")) - 1, int(mass.indices[at])
            raise InputError(f"M is not positive semidefinite: M[{i}, {j}] = {mass[i, j]:.6g} is larger than "
                             f"sqrt(M[{i}, {i}] M[{j}, {j}]), so some motion would have negative kinetic energy")
        del size, limit
        if type(self) is Substructure and _in_each_others_place(mass, stiffness):  # parts of a system were checked before
            warn(f"M and K of {name!r} seem to be in each other's place: most rows of M sum to 0 along a translation, as "
                 "those of a stiffness matrix do, and those of K do not. The order is Substructure(M, K), read_component(M, K)")
        if dofs is not None and instance("dofs", dofs, DofMap).size != pencil.size:
            raise InputError(f"the DOF map has {dofs.size} DOF, but the matrices are {pencil.size} x {pencil.size}")
        if isinstance(interface, Mapping):  # named sets may overlap: list each DOF once, and store sets as positions in this list
            named = {key: _interface(rows, pencil.size, f"the interface set {key!r}") for key, rows in interface.items()}
            interface = list(dict.fromkeys(int(row) for rows in named.values() for row in rows))
            place = {row: at for at, row in enumerate(interface)}
            sets = {key: np.array([place[int(row)] for row in rows], dtype=np.intp) for key, rows in named.items()}
        joined = _interface(interface, pencil.size)
        checked = {}
        for key, column in mapping("ports", {} if ports is None else ports, "names and columns, as {'belt': w}").items():
            what = f"port {word('the name of a port', key)!r}"
            checked[key] = w = np.array(real_array(what, column.toarray() if sp.issparse(column) else column))
            if w.ndim not in (1, 2) or w.shape[0] != pencil.size or w.size == 0:
                raise InputError(f"{what} has the shape {w.shape}; the model has {pencil.size} DOF, so ({pencil.size},) or "
                                 f"({pencil.size}, p)")
        self._set(M=mass, K=stiffness, D=pencil.D, interface=joined, sets=checked_sets(sets, len(joined)),
                  ports=checked, name=name, dofs=dofs, rigid_motion=None,
                  noise=pencil.noise, H=None if H is None else _structural(H, stiffness))
        if mass is pencil.M and stiffness is pencil.K:
            self._set(_checked=pencil)

    def __repr__(self) -> str:
        kind = f"sparse, {self.K.nnz} nonzeros in K" if sp.issparse(self.K) else "dense"
        ports = f"ports {', '.join(self.ports)}" if self.ports else "no ports"
        return f"{type(self).__name__} {self.name!r}: {self.size} DOF, {kind}, {len(self.interface)} interface DOF, {ports}"

    @property
    def size(self) -> int:
        return int(self.M.shape[0])

    @property
    def is_reduced(self) -> bool:
        """Whether this is a reduced model, or a system with a reduced part."""
        return any(part.is_reduced for part in getattr(self, "parts", {}).values())

    @cached_property
    def interior(self) -> Array:
        """The DOF that are not interface DOF, ascending."""
        return np.setdiff1d(np.arange(self.size), self.interface)

    @cached_property
    def interface_rows(self) -> Matrix:
        """B, shape (n_b, n), with u_b = B u: the physical interface displacements in this model's coordinates."""
        count = len(self.interface)
        return sp.csr_array((np.ones(count), (np.arange(count), self.interface)), shape=(count, self.size))

    @cached_property
    def interface_dofs(self) -> DofMap | None:
        """The node, motion and point of each interface DOF; None if they are not known."""
        return None if self.dofs is None else self.dofs.kept(self.interface)

    @property
    def interface_numbers(self) -> Array:
        """The interface DOF in the full component's numbering, shape (n_b,): for a reduced model, as rows of V."""
        return self.interface

    @cached_property
    def pencil(self) -> Pencil:
        """λ²M + λD + K without any contact, with the model's rigid motion, rounding in D and cut-off."""
        plain = vars(self).pop("_checked", None) or Pencil(self.M, self.D, self.K)
        if self.rigid_motion is None and not self.noise.shape[1] and self.cutoff == plain.cutoff:
            return plain
        return plain.carrying(self.rigid_motion, self.noise, self.cutoff)

    def linearised(self, contacts: Contacts = None, *, structural: bool = False) -> Pencil:
        """The pencil linearised about steady sliding: with D + Σ W C_D Wᵀ and K + Σ W C_K Wᵀ over the given contacts.

        K may become unsymmetric. The pencil does not contain structural damping H. With `structural`, the caller adds H itself.

        Raises
        ------
        InputError
            The model has structural damping, and `structural` is False.
        """
        if not structural:
            self.viscous_only("λ²M + λD + K")
        return self.pencil.with_contacts([small_matrices(self, contact) for contact in contacts_of(contacts)])

    def check_held(self, contacts: Contacts, noun: str = "the part") -> None:
        """Raise an InputError if friction drives a rigid motion that nothing but the contact holds (`femsub.model.held`)."""
        check_held(self, contacts, noun)

    def floating(self, contacts: Contacts) -> RigidMotion | None:
        """The rigid motion that the contacts do not resist, driven by friction or not; None if it is not known."""
        return floating(self, contacts)

    def with_damping(self, D: Any) -> Self:
        """A copy with another D, shape (n, n), symmetric or not; None removes all damping."""
        pencil = self.pencil.damped_by(D)
        return self._with(D=pencil.D, pencil=pencil, rigid_motion=pencil.rigid_motion, noise=pencil.noise)

    def with_structural_damping(self, H: Any) -> Self:
        """A copy with another H, shape (n, n), symmetric; None removes it."""
        return self._with(H=None if H is None else _structural(H, self.K), pencil=self.pencil)

    def viscous_only(self, what: str) -> None:
        """Raise an InputError if the model has structural damping, which cannot be part of `what`."""
        if self.H is not None:
            raise InputError(f"{self.name!r} has structural damping H, which has no place in {what}: K + iH holds in harmonic "
                             "motion alone. Take fs.equivalent_viscous(model, omega), which damps motion at ω as much, or "
                             "model.with_structural_damping(None). In a scene file, give rayleigh in place of loss")

    def dof_name(self, row: int) -> str:
        """The name of a DOF in messages: 'uz at node 12', or without a DOF map 'DOF 3', counted from 0."""
        return f"DOF {row}" if self.dofs is None else self.dofs.name(row)

    def empty(self, *beside: Matrix | None) -> Array:
        """The DOF with neither mass nor stiffness: their rows and columns of M and K, and of the matrices `beside`, are zero."""
        found: Array = shared((self.M, self.K), "empty DOF", lambda: rows_of_zeros(self.M, self.K))
        return rows_of_zeros(*(A for A in beside if A is not None), among=found) if len(found) else found

    def refuse_empty(self, *beside: Matrix | None, rows: Array | None = None, name: str | None = None) -> None:
        """Raise an error if DOF have neither mass nor stiffness, among `rows` if given. All analyses use this check.

        `beside` are other matrices that act in an analysis: D and K (n, n) of its pencil, or the columns (n, p) of its contacts.
        `name` is the model's name in the message.

        Raises
        ------
        SingularMatrixError
            There are such DOF. The message names the first ones.
        """
        found = self.empty(*beside)
        found = found if rows is None else np.intersect1d(found, rows)
        if len(found):
            raise empty_dofs_error(len(found), map(self.dof_name, found.tolist()), self.name if name is None else name)

    def rigid_inertia(self) -> Inertia | None:
        """The inertia forces of rigid accelerations on the DOF; None if the motion of a DOF in rigid motion is not known."""
        if self.dofs is None or self.dofs.no_rigid:
            return None
        R = self.dofs.rigid(np.zeros(3))
        return Inertia.of(R, np.asarray(self.M @ R), self.supported)

    def _carry(self, rigid_motion: Carried, noise: Array) -> None:
        """Sets the rigid motion and rounding that a model takes over from its parts, before its pencil is formed."""
        self._set(rigid_motion=rigid_motion, noise=noise)

    def port(self, name: str) -> Array:
        """The column(s) w of a port, shape (n,) or (n, p); an unknown name is an InputError."""
        if not isinstance(name, str) or name not in self.ports:
            raise unknown_name("port", name, self.ports)
        return self.ports[name]


@dataclass(frozen=True, eq=False, repr=False)
class ReducedSubstructure(Substructure):
    """A reduced component, made by `reduce`: a `Substructure` in the coordinates q of a basis, u ≈ V q.

    V has the shape (n, r); M, D, K have (r, r). It is used like any other substructure. These attributes are added:

    Attributes
    ----------
    V : ndarray, shape (n, r)
    kinds : tuple of str, length r
        The label of each column: 'rigid', 'constraint', 'interface', 'fixed-interface', 'free', 'residual attachment',
        'free and inertia relief', 'interface force', 'static port'.
    modes : int
        The number of elastic modes in the basis.
    method : str
        One line that names the method and its size.
    cutoff : float
        The frequency of the first mode left out (inf if none is). Modes above it must not decide about stability.
    dropped : int
        The number of columns left out because they depended on the others.
    port_error : dict of str to float
        For each port, the relative error of the static response in the energy norm, compared with the full component.
    factorisations : int
        The number of factorisations of the component made for the basis: 0 if earlier calls had made them already.
    full_dofs : DofMap, optional
        The DOF map of the rows of V.
    full_interface : ndarray of int
        The interface as rows of V.
    interface_dofs : DofMap, optional
        The DOF map of the interface; by default the part of `full_dofs`.
    estimate : Estimate, optional
        Error estimates of its modes in the band, if `reduce` was given a tolerance.
    estimated : (M, D, K), optional
        The matrices that `estimate` is valid for, by default the model's own. A copy with other matrices loses the estimate.
    rigid_motion : RigidMotion, optional
        The coordinates q of the full component's rigid motions, V q = Z. A copy with another K loses them.
    noise : ndarray, shape (r, k), optional
        Rounding in VᵀDV: see `Pencil`.
    origin : Origin, optional
        The model that `reduce` started from. It is not known for a superelement or a model made by hand. A copy with another M or
        K loses it.
    inertia : Inertia, optional
        The inertia forces of rigid accelerations on the coordinates, VᵀP. A copy with another M loses them.
    change_error : float
        For a result of `modified`: the estimated relative error of its λ up to 0.7 of the cut-off, with the damping of the
        changes and without friction. The error of the reduction is included. NaN if it is not known.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> rom = fs.reduce(sub, fs.CraigChang(modes=3))
    >>> rom
    ReducedSubstructure 'chain': 4 of 10 DOF by Craig-Chang with 3 free modes, cut-off 1 rad/time
    >>> rom.expand([1.0, 0.0, 0.0, 0.0]).shape
    (10,)
    """

    interface: Array = field(init=False)
    dofs: DofMap | None = field(default=None, init=False)
    cutoff: float = np.inf
    V: Array = field(default_factory=lambda: np.zeros((0, 0)))
    kinds: tuple[str, ...] = ()
    modes: int = 0
    method: str = ""
    dropped: int = 0
    port_error: Mapping[str, float] = field(default_factory=dict)
    factorisations: int = 0
    full_dofs: DofMap | None = None
    full_interface: Array = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    interface_dofs: DofMap | None = None
    estimate: Estimate | None = None
    estimated: tuple[Matrix, Matrix, Matrix] | None = None
    rigid_motion: Carried = None
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)))
    origin: Origin | None = None
    inertia: Inertia | None = None
    change_error: float = np.nan

    #: object that makes a model with more shapes, as long as the full component exists; not pickled
    wider: ClassVar[Any] = None

    def __post_init__(self) -> None:
        V = real_array("V", self.V)
        if V.ndim != 2 or V.shape[1] != np.shape(self.M)[0]:
            raise InputError("V must have a row per DOF of the component and a column per coordinate, but its shape is "
                             f"{V.shape}, and that of M is {np.shape(self.M)}")
        if not self.cutoff > 0:
            raise InputError(f"cutoff must be a positive frequency, inf where nothing was left out, but is {self.cutoff!r}")
        full_interface = _interface(self.full_interface, len(V))
        # A coordinate is an interface DOF if its column alone moves that DOF, by 1.
        rows = V[full_interface]
        places = [int(np.argmax(row == 1.0)) for row in rows if np.count_nonzero(row) == 1 and 1.0 in row]
        physical = len(places) == len(rows) and len(set(places)) == len(places)
        sets, motion, noise = checked_sets(self.sets, len(full_interface)), self.rigid_motion, self.noise
        super().__init__(self.M, self.K, self.D, places if physical else (), self.ports, self.name, H=self.H)
        own = self.M, self.D, self.K
        estimated = self.estimated or own
        valid = self.estimate is not None and all(A is B or (A.shape == B.shape and not (A != B).sum())
                                                  for A, B in zip(estimated, own, strict=True))
        known = self.interface_dofs
        if known is None and self.full_dofs is not None:
            known = self.full_dofs.kept(full_interface)
        self._set(V=V, interface_dofs=known, sets=sets, kinds=tuple(self.kinds), cutoff=float(self.cutoff),
                  port_error=self.port_error, full_interface=full_interface,
                  origin=None if self.origin is None else self.origin.belonging(self.M, self.K, same),
                  inertia=None if self.inertia is None else self.inertia.belonging(self.M),
                  estimate=self.estimate if valid else None, estimated=estimated if valid else None,
                  rigid_motion=motion.belonging(*own) if isinstance(motion, RigidMotion) else None,
                  noise=noise if noise is not None and len(noise) == self.size else self.noise)

    def __repr__(self) -> str:
        limit = "complete" if np.isinf(self.cutoff) else f"cut-off {self.cutoff:.4g} rad/time"
        return f"ReducedSubstructure {self.name!r}: {self.size} of {self.V.shape[0]} DOF by {self.method}, {limit}"

    @cached_property
    def interface_rows(self) -> Matrix:
        """B with u_b = B q, shape (n_b, r)."""
        return self.V[self.full_interface]

    @property
    def is_reduced(self) -> bool:
        """Always True."""
        return True

    @property
    def interface_numbers(self) -> Array:
        """`full_interface`."""
        return self.full_interface

    def rigid_inertia(self) -> Inertia | None:
        """`inertia`."""
        return self.inertia

    def with_damping(self, D: Any) -> Self:
        """A copy with another D, shape (r, r). It has no estimate, since the estimate is not valid for another D."""
        return super().with_damping(D)._with(estimate=None, estimated=None, wider=self.wider)

    def dof_name(self, row: int) -> str:
        """The name of the interface DOF if the coordinate is one, otherwise 'coordinate 3'."""
        at = np.flatnonzero(self.interface == row)
        return self.interface_dofs.name(int(at[0])) if len(at) and self.interface_dofs is not None else f"coordinate {row}"

    def expand(self, q: Array) -> Array:
        """u = V q, (n,) or (n, k), from q (r,) or (r, k)."""
        q = np.asarray(q)
        if q.ndim == 0 or q.shape[0] != self.size:
            raise InputError(f"q must have {self.size} rows, one per coordinate, but its shape is {q.shape}")
        return self.V @ q


def usable_band(model: Substructure | Pencil | Affine, band: Any = None) -> tuple[float, float]:
    """The band (lo, hi) of an analysis: hi must not exceed the cut-off; default (0, cut-off).

    Above the cut-off the modes of a reduced model are artefacts of the reduction, often hardly damped. So all analyses refuse a
    band that reaches above it. If the cut-off is not known (NaN), results are 'not checked'. Up to SHARE of the cut-off errors
    are usually small; from there to the cut-off they may be large.

    Raises
    ------
    InputError
        Not a band, or a band that ends above the cut-off.
    """
    if band is None:
        return 0.0, np.inf if np.isnan(model.cutoff) else float(model.cutoff)
    lo, hi = check_band(band)
    if beyond(hi, model.cutoff):
        raise InputError(f"band=({lo:.6g}, {hi:.6g}) reaches above the cut-off of {called(model)}, {model.cutoff:.6g} rad/time: "
                         "modes above it are artefacts of the reduction. Keep more modes, or end the band at the cut-off "
                         f"(at {SHARE:g} of it, {SHARE * model.cutoff:.5g}, errors are usually small)")
    return lo, hi


def called(model: Substructure | Pencil | Affine) -> str:
    """A model's name in quotes, or 'the reduced Pencil', since a pencil has no name."""
    return repr(model.name) if isinstance(model, Substructure) else f"the reduced {type(model).__name__}"


def _symmetric(name: str, matrix: Matrix) -> Matrix:
    """(A + Aᵀ)/2 of a matrix A that is symmetric up to rounding: |a_ij - a_ji| ≤ EQUAL sqrt(|a_ii a_jj|).

    The rounding of an assembly is below ROUNDING. Products of matrices may have more, so a larger difference gives a warning.
    """
    skew, unit = sp.coo_array(matrix - matrix.T), np.sqrt(np.abs(matrix.diagonal()))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(skew.data == 0, 0.0, np.abs(skew.data) / (unit[skew.row] * unit[skew.col]))
    where = int(share.argmax())
    row, column = int(skew.row[where]), int(skew.col[where])
    places = f"{name}[{row}, {row}] {name}[{column}, {column}]"
    size = f"a difference of {share[where]:.1e} of sqrt({places})" if share[where] < np.inf else f"although {places} = 0"
    found = (f"{name} is not symmetric: {name}[{row}, {column}] = {matrix[row, column]:.6g}, but {name}[{column}, {row}] = "
             f"{matrix[column, row]:.6g}, {size}")
    if share[where] > EQUAL:
        raise InputError(f"{found}. Only {EQUAL:g} is accepted as rounding. Give an unsymmetric matrix to Pencil(M, D, K), "
                         f"and friction as a contact. If it is rounding after all, give ({name} + {name}.T) / 2")
    if share[where] > ROUNDING:
        warn(f"{found}. It is treated as rounding and averaged out. If it is friction, use Pencil(M, D, K), else give "
             f"({name} + {name}.T) / 2")
    mean = (matrix + matrix.T) * 0.5
    return sp.csr_array(mean) if sp.issparse(mean) else mean


def _structural(H: Any, K: Matrix) -> Matrix:
    """A checked H, sparse or dense like K."""
    found = as_matrix("H", H, K.shape[0])
    if sp.issparse(found) != sp.issparse(K):
        found = sp.csr_array(found) if sp.issparse(K) else found.toarray()
    return found if is_symmetric(found) else _symmetric("H", found)


def _in_each_others_place(M: Matrix, K: Matrix, few: int = 4, some: int = 1000) -> bool:
    """Whether M looks like a stiffness matrix and K does not, by row sums along translations: for stiffness they are 0.

    A sum counts as 0 within the digits of a file. At least `few` rows of a translation must sum to 0, since fewer may do so by
    accident. A sample of `some` rows is checked before all rows.
    """
    if (M.data if sp.issparse(M) else M).min(initial=0.0) >= 0:  # row sums of 0 need negative entries
        return False
    t = translations(M.shape[0])

    def balanced(A: Matrix, rows: Array | slice = slice(None)) -> Array:
        part = A[rows]
        sums, size = np.abs(part @ t), abs(part) @ t
        own = (t[rows] > 0) & (size > 0)
        return (own & (sums <= 10 * POSITION * size)).sum(axis=0) / np.maximum(own.sum(axis=0), few)

    sample = np.random.default_rng(1).integers(len(t), size=some)
    if len(t) > some and (balanced(M, sample) < 0.3).all():  # true for nearly every M, and faster than all rows
        return False
    stiff = balanced(M) > 0.5
    return bool(stiff.any() and (stiff & (balanced(K) < 0.1)).any())


def _interface(values: Iterable[int], size: int, what: str = "interface") -> Array:
    raw = whole_numbers(what, values)
    bad = raw[(raw < 0) | (raw >= size)]
    if bad.size:
        raise InputError(f"interface DOF {bad[0]} is out of range: the model has {size} DOF, counted from 0 to {size - 1}")
    unique, counts = np.unique(raw, return_counts=True)
    if (counts > 1).any():
        raise InputError(f"interface DOF {unique[counts > 1][0]} is listed {counts.max()} times; list each once")
    return raw.astype(np.intp)


def checked_sets(sets: Mapping[str, Any] | None, count: int) -> dict[str, Array]:
    """Named sets of an interface of `count` DOF, checked: each DOF is given by its place in the interface."""
    found = {}
    for name, places in ({} if sets is None else mapping("sets", sets, "names and places in the interface")).items():
        what = f"the interface set {word('a name in sets', name)!r}"
        found[name] = _interface(places, np.iinfo(np.intp).max, what)
        if found[name].max(initial=-1) >= count:
            raise InputError(f"the interface set {name!r} names place {found[name].max()}, but the interface has {count} DOF, "
                             "counted from 0: give the interface as a mapping, {'left': [0, 1]}")
    return found
