"""The base class of all reduction methods, and the reduction of one component by any of them, step by step."""

from __future__ import annotations

import logging
import weakref
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import scipy.sparse as sp

from femsub.algebra import SMALL, SUMS, WORK, check_memory, kept_free, one_thread, slabs, without
from femsub.checks import (
    DENSE,
    EPS,
    EQUAL,
    Array,
    ConditionWarning,
    InputError,
    InputTypeError,
    Matrix,
    PortWarning,
    SingularMatrixError,
    positive_number,
    shown,
    warn,
    whole_number,
)
from femsub.model import (
    SHARE,
    Affine,
    Contacts,
    Origin,
    Pencil,
    ReducedSubstructure,
    RigidMotion,
    Substructure,
    coordinates,
    costs,
    size_of_products,
    units,
)
from femsub.modes import IN_PARTS, ShiftInvert, lowest_modes, modes_below, motion_of
from femsub.output import LOOKS, Look
from femsub.reduction.basis import Basis, Kept, Partition, Statics, assembled, projected, square, structural
from femsub.reduction.estimates.nested import Nested
from femsub.reduction.estimates.search import Goal, Space, chosen_in
from femsub.reduction.frequency_bounds import origin_of
from femsub.reduction.wider import Wider

if TYPE_CHECKING:
    from femsub.coupling import Belt

log = logging.getLogger("femsub.reduction.reduce")  # named after the function that users call

METHODS: dict[str, type[Method]] = {}  #: every method by its key
FIRST = 100  # assumed number of modes if it follows from a tolerance, for the choice of threads
DIGITS = 1e-4  # relative rounding error of the condensed stiffness, or of ω² of a mode, above which `reduce` warns
PORT_LIMIT = 0.01  # relative error of a port's static response (energy norm) above which `reduce` warns
PART_OF_A_CUT = ("K of this part is indefinite, as it may be where matrices were cut. Reduce such parts by "
                 "CraigBampton(modes=...) or Guyan(), or cut the mesh")


@dataclass(frozen=True)
class Method(ABC):
    """Base class of the reduction methods: u ≈ Vq, V = [C Φ Ξ].

    C are static shapes (constraint modes), Φ are modes, and Ξ are static responses made orthogonal to Φ.

    Parameters
    ----------
    modes : int
        Number of elastic modes that are kept.
    band : (lo, hi), with tol : float
        Instead of `modes`: the number follows from a band and a tolerance; see `reduce`.
    cutoff : float
        Instead of both: all modes below this frequency, in radians per unit of time. They are counted before they are computed.

    Notes
    -----
    To add a method, write a subclass with a key. `study`, tables, figures and scene files then accept that key.

    1. The subclass is a frozen dataclass. Scenes create it from a number of modes alone, so its own fields need defaults.
    2. `key` is the name in scene files and results, `label` the name in tables and figures. `colour` and `marker` are
       matplotlib's names for the figures. A subclass without a key of its own is not registered.
    3. `held` is True for modes of the interior with the interface fixed, False for modes of the whole component with the
       interface free. It also decides which matrix is factorised.
    4. `statics` is the one step that a method must define. It gets the part and its factor. It returns C with CᵀKC, and
       the forces whose static responses join the basis. CᵀKΦ must be 0 for the modes Φ of the part. `Statics.rigid` holds the
       rigid motions in C. If it is None, rigid motion is found numerically from the reduced K and D.
    5. `kept` finds the modes, and may add a force for each mode, whose static response joins the basis. `coordinates` turns the
       basis [C Φ Ξ] into other coordinates. Both may be overridden. Each gets the results of earlier steps, and must not change
       them.
    6. `static_columns` returns the number of static shapes. Override it if that is not the number of interface DOF.
    7. `unestimated` is the reason why no estimate exists for a band and a tolerance. A method with such a reason refuses them.
       `title` names a model with a given number of modes.

    `reduce` checks the arguments, makes the part and its factor, runs the steps, and projects D and the ports.
    """

    modes: int | None = None
    band: tuple[float, float] | None = None
    tol: float | None = None
    cutoff: float | None = field(default=None, kw_only=True)

    key: ClassVar[str]
    label: ClassVar[str]
    colour: ClassVar[str]
    marker: ClassVar[str]
    held: ClassVar[bool]
    mode_kind: ClassVar[str]  #: the label of elastic modes: 'fixed-interface' or 'free', as `held` says, if no other is given
    judges_ports: ClassVar[bool] = True  #: whether the model reports the error of its static responses to ports
    offered: ClassVar[bool] = True  #: whether studies and scenes offer it for components by its key
    nested: ClassVar[bool] = True  #: whether part and factor are the same for any number of modes (`Reductor`)
    takes_cutoff: ClassVar[bool] = True  #: whether all modes below a frequency can be asked for
    unestimated: ClassVar[str] = ""  #: why no estimate is possible for a band and a tolerance; empty if one is possible

    def __init_subclass__(cls) -> None:
        if "held" in vars(cls) and "mode_kind" not in vars(cls):
            cls.mode_kind = "fixed-interface" if cls.held else "free"
        if "key" not in vars(cls):
            return
        known = METHODS.get(cls.key)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise InputError(f"the key {cls.key!r} of {cls.__name__} is that of {known.__name__}; give it another one")
        for name in ("label", "colour", "marker", "held"):
            if not hasattr(cls, name):
                raise InputError(f"the reduction method {cls.__name__} has no {name}; see femsub.reduction.method.Method")
        if cls.offered:
            METHODS[cls.key] = cls
            LOOKS[cls.key] = Look(cls.label, cls.colour, cls.marker)

    def __post_init__(self) -> None:
        name = type(self).__name__
        if self.cutoff is not None:
            if not self.takes_cutoff:
                raise InputError(f"{name} takes no cutoff; give modes=20")
            if self.modes is not None or self.band is not None or self.tol is not None:
                raise InputError(f"{name} takes one of modes=20, cutoff=2e4, and band=(lo, hi) with tol=1e-3, but several are "
                                 "given")
            object.__setattr__(self, "cutoff", positive_number("cutoff", self.cutoff))
            return
        if (self.modes is None) == (self.band is None and self.tol is None):
            found = "nothing is given" if self.modes is None else f"modes={self.modes!r} and a band or tolerance are both given"
            raise InputError(f"{name} takes modes=20, or band=(lo, hi) with tol=1e-3, but {found}")
        if self.modes is not None:
            whole_number("modes", self.modes, least=0)
            return
        if self.band is None or self.tol is None:
            lacking = "band=(lo, hi), in rad per unit of time," if self.band is None else "tol=1e-3, the relative error allowed,"
            raise InputError(f"{name}: {lacking} is missing; band and tol go together")
        if self.unestimated:
            raise InputError(f"{name} takes a number of modes only, e.g. modes=20: no estimate is possible for a tolerance, "
                             f"since {self.unestimated}")
        object.__setattr__(self, "band", Goal(self.band, self.tol).band)

    def __str__(self) -> str:
        """'Craig-Bampton with 4 modes'."""
        extent = f"{self.modes} modes" if self.band is None else f"tol {self.tol:g} up to {self.band[1]:.5g} rad/time"
        extent = extent if self.cutoff is None else f"all modes below {self.cutoff:.5g} rad/time"
        return f"{self.label} with {extent}"

    def title(self, modes: int) -> str:
        """'Craig-Bampton with 4 fixed-interface modes': the name of the model with this number of modes."""
        return f"{self.label} with {modes} {self.mode_kind} modes"

    def part(self, sub: Substructure) -> Partition:
        """The DOF that the factor and the modes belong to."""
        return Partition.of(sub, self.held)

    def static_columns(self, sub: Substructure) -> int:
        """Number of static shapes that the method computes, without responses to ports. The memory check needs it first."""
        return len(sub.interface)

    def judged(self, sub: Substructure, contacts: Contacts) -> Pencil | None:
        """The model whose complex eigenvalues must be within the tolerance; None without damping.

        Raises
        ------
        InputError
            A contact adds stiffness: the basis does not contain the static responses to its forces.
        """
        pencil = sub.linearised(contacts, structural=True)
        if pencil.K is not sub.pencil.K:
            raise InputError("the estimate of a tolerance takes contacts that add to D only, such as belts. Use "
                             "ContactModes(band=..., tol=..., contacts=...) for friction between surfaces, or give a number of "
                             f"modes instead, e.g. {type(self).__name__}(modes=20)")
        return pencil if pencil.norms[1] > 0 else None

    @abstractmethod
    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """C, CᵀKC and the forces F. F includes `extra` (n, s), the ports' columns whose static responses were requested."""

    @property
    def by_vectors(self) -> bool:
        """Whether `vectors` makes the basis, without modes of a part."""
        return False

    def vectors(self, request: Request) -> Basis:
        """The basis, if `by_vectors`."""
        raise NotImplementedError

    def sought(self, handle: ShiftInvert) -> Kept | None:
        """The given number of modes, or all modes below the cut-off; None with a tolerance.

        A second process may solve for static shapes meanwhile.
        """
        if self.cutoff is not None:
            found = modes_below(handle.K, handle.M, self.cutoff, handle)
            elastic = len(found.eigenvalues) - found.rigid
            return Kept(found, elastic, free_below=found.counted[0] if elastic < handle.elastic else np.inf)
        return None if self.modes is None else lowest(handle, self.modes)

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """The modes of the part: from `sought`, or as many as band and tolerance require with the damping of `pencil`."""
        if (kept := self.sought(statics.handle)) is not None:
            return kept
        assert self.goal is not None
        return chosen_in(Space.of(statics, pencil, self.goal.band[1]), self.goal)

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The basis V = [C Φ Ξ], transformed by `Basis.turned` if the model has other coordinates."""
        return basis

    def finished(self, sub: Substructure, model: ReducedSubstructure) -> ReducedSubstructure:
        """The model as `reduce` returns it."""
        return model

    @property
    def goal(self) -> Goal | None:
        """The band and the tolerance; None with a number of modes."""
        return None if self.band is None or self.tol is None else Goal(self.band, self.tol)

    @property
    def row_key(self) -> str:
        """The key in tables and figures."""
        return self.key


def lowest(handle: ShiftInvert, count: int, defer: bool = True) -> Kept:
    """The `count` lowest elastic modes, and the next mode, if any, for the cut-off. After `defer`, call `count_deferred`."""
    return Kept(lowest_modes(handle, count + (count < handle.elastic), defer), count)


def reduced(sub: Substructure, method: Method, ports: bool | Sequence[str] = False,
            contacts: Belt | Sequence[Belt] | None = None) -> ReducedSubstructure:
    """One component, reduced by one method; see `reduce`."""
    request = checked(sub, method, ports, contacts)
    try:
        with one_thread(request.work < WORK), kept_free(request.beside):
            if method.by_vectors:
                return finished(request, Partition(sub, slice(None)), method.vectors(request))
            part = method.part(sub)
            if method.held and not len(part.sub.interior):
                return finished(request, part, whole_basis(request, part))
            turned = request if part.turn is None else request.turned(part)
            statics = method.statics(replace(part, alone=True), part.factored(method.modes or 0), turned.extra)
            kept = statics.sought or method.kept(statics, turned.pencil)
            return finished(request, part, assembled(statics, kept, turned.ports, method.mode_kind), statics, kept)
    except SingularMatrixError as error:
        reason = str(error).removeprefix(f"{sub.name!r}: ")
        is_cut = any(sub.name in key.split("+") for key in sub.sets)  # `cut` names a common interface after its parts: "a+b"
        raise SingularMatrixError(f"{sub.name!r}: " + (f"{PART_OF_A_CUT} ({reason})" if is_cut else reason)) from None


@dataclass(frozen=True, eq=False)
class Request:
    """The checked arguments of `reduce`.

    Attributes
    ----------
    sub : Substructure
    method : Method
    ports : mapping of str to ndarray, shape (n, p)
        Port columns; the error of their static responses judges the basis.
    extra : ndarray, shape (n, s)
        The port columns whose static responses join the basis.
    pencil : Pencil, optional
        The damped model whose complex eigenvalues must be within the tolerance.
    static : int
        Number of static shapes of the method itself.
    beside : float
        Bytes that the reduction needs in addition to its factor.
    """

    sub: Substructure
    method: Method
    ports: Mapping[str, Array]
    extra: Array
    pencil: Pencil | None
    static: int
    beside: float = 0.0

    @property
    def columns(self) -> int:
        """Number of static shapes of the method, of port responses that join the basis, and of port responses that judge it."""
        return self.static + self.extra.shape[1] + sum(w.shape[1] for w in self.ports.values())

    @property
    def held(self) -> Array | None:
        """The interface DOF that the method holds while it computes modes."""
        return self.sub.interface if self.method.held else None

    @property
    def work(self) -> float:
        """Approximate number of multiplications in the dense part of the reduction; decides about threads."""
        sub, kept = self.sub, FIRST if self.method.modes is None else self.method.modes
        if not sp.issparse(sub.K) or sub.size <= SMALL or kept > 0.3 * sub.size:
            return float(sub.size) ** 3
        return float(sub.size) * (kept + self.static + self.extra.shape[1]) ** 2

    def turned(self, part: Partition) -> Request:
        """The request in the coordinates z of the part, x = turn z."""
        T: Matrix = part.turn
        pencil = None if self.pencil is None else part.sub.with_damping(T.T @ (self.pencil.D @ T)).pencil
        return replace(self, ports={name: T.T @ w for name, w in self.ports.items()}, extra=T.T @ self.extra, pencil=pencil)


def checked(sub: Substructure, method: Method, ports: bool | Sequence[str], contacts: Belt | Sequence[Belt] | None) -> Request:
    """The arguments of `reduce` as a `Request`, after checks of each argument and of the free memory."""
    if not isinstance(sub, Substructure):
        if isinstance(sub, (Affine, Pencil)):
            raise InputTypeError(f"reduce takes a Substructure, whose K is symmetric, not {type(sub).__name__}: reduce "
                                 "Substructure(M, (K + K.T) / 2, D, interface=[...]), and project the rest on its basis by "
                                 f"{type(sub).__name__.lower()}.reduced(rom), which keeps the cut-off")
        raise InputTypeError(f"sub must be a Substructure, not {shown(sub)}")
    if not isinstance(method, Method):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} is already reduced, and its interface is spread over generalised coordinates (as "
                         "Craig-Chang does). Reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
    static = method.static_columns(sub)
    sub.refuse_empty(rows=sub.interior if method.held else None)
    columns = {name: w.reshape(len(w), -1) for name, w in sub.ports.items()}
    names = list(sub.ports) if ports is True else list(ports or [])
    for name in names:
        sub.port(name)
    extra = np.hstack([np.zeros((sub.size, 0)), *(columns[name] for name in names)])
    if contacts is not None and method.band is None:
        raise InputError("contacts have no effect on a basis with a given number of modes. Leave them out, or give a band and a "
                         f"tolerance, e.g. {type(method).__name__}(band=(0, 2e3), tol=1e-3)")
    pencil = None
    if method.band is not None:
        pencil = method.judged(sub, contacts)
        if method.band[1] >= SHARE * sub.cutoff:
            raise InputError(f"the band ends at {method.band[1]:.5g} rad/time, but {sub.name!r} is already reduced, with a "
                             f"cut-off of {sub.cutoff:.5g}. End the band below {SHARE:g} of that, or reduce the full component")
    request = Request(sub, method, columns if method.judges_ports else {}, extra, pencil, static)
    beside = check_memory(sub.name, sub.K, request.columns, method.modes or 0, static, request.held)
    return replace(request, beside=beside)


def whole_basis(request: Request, part: Partition, judged: bool = True) -> Basis:
    """The identity, as the basis of a component whose DOF are all interface.

    `judged` is False in a system: its estimate holds for all parts, and a point mass has no modes to estimate.
    """
    sub, method, b = part.sub, request.method, part.sub.interface
    if method.modes and sub is request.sub:
        raise InputError(f"{method.modes} {method.mode_kind} modes were asked for, but every DOF is interface, so there are "
                         "none. Use modes=0, or a smaller interface")
    goal = method.goal if judged else None
    estimate = None if goal is None else Nested.whole(sub, request.pencil).estimate(0, goal.band, goal.tol)
    return Basis(np.eye(sub.size)[:, b], square(sub.M, b), square(sub.K, b), ("constraint",) * len(b), 0, np.inf,
                 request.extra.shape[1], dict.fromkeys(request.ports, 0.0), 0, np.eye(len(b)), estimate)


def finished(request: Request, part: Partition, basis: Basis, statics: Statics | None = None, kept: Kept | None = None
             ) -> ReducedSubstructure:
    """The model that `reduce` returns. `statics` and `kept` led to the basis [C Φ Ξ]; without them the basis is final.

    Warns if kept modes of a floating part have few correct digits, or if the static response to a port is inaccurate.
    """
    sub, method = request.sub, request.method

    # the coordinates of the method
    if statics is not None and kept is not None:
        known = kept.found.rounding[:kept.found.rigid + kept.elastic]
        handle, lost = statics.handle, float(known.max(initial=0.0))
        if not kept.elastic and handle.exact < handle.rigid.shape[1]:
            lost = handle.doubt**0.5  # static shapes represent the soft mode; a shape is less accurate than its ω²
        # a K with fewer digits has its own warning, and with a tolerance the estimate includes rounding
        if handle.floating and lost > DIGITS and handle.unit == EPS and method.goal is None:
            warn(f"rounding in the entries of K may change ω² of the modes of {sub.name!r} by a relative {lost:.0e}, and the "
                 f"reduced model inherits this error. {IN_PARTS}", ConditionWarning)
        basis = method.coordinates(basis, statics)
    if not basis.V.shape[1]:
        raise InputError(f"the basis for {sub.name!r} would be empty: modes=0, and no interface is given. Ask for modes, or "
                         "name interface DOF")
    basis.V[part.sub.interface] = basis.interface  # exact, where products leave rounding
    if part.turn is not None:
        basis = replace(basis, V=part.turn @ basis.V, motion=None if basis.motion is None else part.turn @ basis.motion)
    V, title = basis.V, method.title(basis.modes)
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warn(f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with {title}. Put "
                 "its DOF into the interface, or call reduce(..., ports=True)", PortWarning)
    own = np.inf if V.shape[1] == sub.size else basis.cutoff
    cutoff = min(own, sub.cutoff)
    origin = origin_of(sub, V, own) if sub.is_reduced else Origin(V.shape[1], len(V), own)

    # VᵀDV without rounding in rigid motion; the rigid motion; and G: the rounding of D is up to EPS G Gᵀ. The rigid motion comes
    # from the method, or else from the component. In the latter case its coordinates are found in the span of V
    D, H = projected(sub.D, V, V) if basis.D is None else basis.D, structural(sub, V)
    D = (D + D.T) / 2 if sub.pencil.symmetric[1] else D
    carried = np.abs(V).T @ sub.noise if sub.noise.shape[1] else np.zeros((V.shape[1], 0))  # |V| takes as much memory as V
    q: Array | None = None
    motion: RigidMotion | None = None
    unit = units(sub.M)
    # V itself is rounded: where D acts on DOF that hardly move, VᵀDV is the square of a rounding of V
    far = np.max([np.abs(V[a:b] / unit[a:b, None]).max(axis=0, initial=0.0) for a, b in slabs(len(V))], axis=0)
    square = SUMS / EPS**0.5 * far[:, None] * size_of_products(sub.D, unit[:, None])
    noise = np.hstack([carried, size_of_products(sub.D, V), square])
    if basis.rigid is not None and basis.motion is not None:
        if sub.rigid_motion is not None or (costs(sub.K, basis.motion)[0] <= EQUAL).all():
            q, Z = basis.rigid, basis.motion
    elif (given := motion_of(sub.rigid_motion)) is not None:
        q, Z = coordinates(V, given.shapes, unit), given.shapes
    if q is not None:
        motion = RigidMotion.of(Z, sub.D, unit, q)
        with np.errstate(divide="ignore"):  # in units of D's rounding, so that the change of each entry stays within it
            D = without(D, motion.undamped, 1 / np.linalg.norm(noise, axis=1))

    model = ReducedSubstructure(
        basis.M, basis.K, D, {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, modes=basis.modes, full_interface=sub.interface, cutoff=cutoff, method=title,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        interface_dofs=sub.interface_dofs, sets=sub.sets, rigid_motion=motion, noise=noise, H=H, origin=origin,
        inertia=None if (inertia := sub.rigid_inertia()) is None else inertia.projected(V),
        estimate=None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff))
    model._set(wider=Wider(weakref.ref(sub), sub if sub.size <= DENSE else None, method.held))
    model = method.finished(sub, model)
    log.info("%r", model)
    return model
