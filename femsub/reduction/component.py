"""The reduction of one component, step by step: checked arguments, basis, projection."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import SMALL, WORK, check_memory, kept_free, one_thread, units as energy_units, without
from femsub.checks import EPS, EQUAL, Array, instance
from femsub.errors import ConditionWarning, InputError, InputTypeError, PortWarning, SingularMatrixError, warn
from femsub.model import (
    SHARE,
    Affine,
    Pencil,
    ReducedSubstructure,
    RigidMotion,
    Substructure,
    coordinates,
    costs,
    size_of_products,
    units,
)
from femsub.modes import IN_PARTS, motion_of
from femsub.reduction.basis import Basis, Kept, Partition, Statics, assembled, projected, square, structural
from femsub.reduction.craig_bampton import DIGITS
from femsub.reduction.estimates.nested import Nested
from femsub.reduction.frequency_bounds import origin_of
from femsub.reduction.method import METHODS, Method
from femsub.reduction.wider import Wider

if TYPE_CHECKING:
    from femsub.coupling import Belt

log = logging.getLogger("femsub.reduction.reduce")  # of the function that users call

FIRST = 100  # assumed number of modes if it follows from a tolerance, for the choice of threads
PART_OF_A_CUT = ("K of this part is indefinite, as it may be where matrices were cut. Reduce such parts by "
                 "CraigBampton(modes=...) or Guyan(), or cut the mesh")
PORT_LIMIT = 0.01  # relative error of a port's static response (energy norm) above which `reduce` warns


def reduced(sub: Substructure, method: Method, ports: bool | Sequence[str] = False,
            contacts: Belt | Sequence[Belt] | None = None) -> ReducedSubstructure:
    """One component by one method; see `reduce`."""
    task = checked(sub, method, ports, contacts)
    try:
        with one_thread(work(task) < WORK), kept_free(task.beside):
            part = method.part(sub)
            if method.held and not len(part.sub.interior):
                return finished(task, part, whole_basis(task, part))
            turned = task.turned(part)
            statics = method.statics(replace(part, alone=True), part.factored(method.modes or 0), turned.extra)
            return finished(task, part, finished_basis(turned, statics, method.kept(statics, turned.pencil)))
    except SingularMatrixError as error:
        reason = str(error).removeprefix(f"{sub.name!r}: ")
        is_cut = any(sub.name in key.split("+") for key in sub.sets)  # as `cut` names what its parts share
        raise SingularMatrixError(f"{sub.name!r}: " + (f"{PART_OF_A_CUT} ({reason})" if is_cut else reason)) from None


def finished(task: Task, part: Partition, basis: Basis) -> ReducedSubstructure:
    """The model that `reduce` returns."""
    if not basis.V.shape[1]:
        raise InputError(f"the basis for {task.sub.name!r} would be empty: modes=0, and no interface is given. Ask for modes, or "
                         "name interface DOF")
    basis.V[part.sub.interface] = basis.interface  # exact, where products leave rounding
    if part.turn is not None:
        basis = replace(basis, V=part.turn @ basis.V, motion=None if basis.motion is None else part.turn @ basis.motion)
    rom = task.method.finished(task.sub, model_of(task, basis))
    rom._set(wider=Wider.of(task.sub, task.method.held))
    log.info("%r", rom)
    return rom


@dataclass(frozen=True, eq=False)
class Task:
    """The checked arguments of `reduce`. `extra` (n, s) holds the port columns whose static responses join the basis.

    `pencil` is the damped model whose complex eigenvalues must be within the tolerance. `beside` are the bytes that the reduction
    needs beside its factor.
    """

    sub: Substructure
    method: Method
    ports: Mapping[str, Array]
    extra: Array
    pencil: Pencil | None
    beside: float = 0.0

    @property
    def columns(self) -> int:
        """Static shapes of the method, and responses to the ports: those that join the basis, and those that judge it."""
        return self.method.static_columns(self.sub) + self.extra.shape[1] + sum(w.shape[1] for w in self.ports.values())

    @property
    def held(self) -> Array | None:
        """The interface DOF that the method holds while it computes modes."""
        return self.sub.interface if self.method.held else None

    def turned(self, part: Partition) -> Task:
        """In the coordinates of the part, where these are others."""
        T = part.turn
        if T is None:
            return self
        pencil = None if self.pencil is None else part.sub.with_damping(T.T @ (self.pencil.D @ T)).pencil
        return replace(self, ports={name: T.T @ w for name, w in self.ports.items()}, extra=T.T @ self.extra, pencil=pencil)


def checked(sub: Substructure, method: Method, ports: bool | Sequence[str], contacts: Belt | Sequence[Belt] | None) -> Task:
    """The arguments of `reduce`, and whether the memory is there."""
    if isinstance(sub, (Affine, Pencil)):
        raise InputTypeError(f"reduce takes a Substructure, whose K is symmetric, not {type(sub).__name__}: reduce "
                             "Substructure(M, (K + K.T) / 2, D, interface=[...]), and project the rest on its basis by "
                             f"{type(sub).__name__.lower()}.reduced(rom), which keeps the cut-off")
    instance("sub", sub, Substructure)
    if not isinstance(method, Method):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if len(sub.interface_rows.shape) == 2 and sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} is already reduced, and its interface is spread over generalised coordinates (as "
                         "Craig-Chang does). Reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
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
    task = Task(sub, method, columns if method.judges_ports else {}, extra, pencil)
    beside = check_memory(sub.name, sub.K, task.columns, method.modes or 0, method.static_columns(sub), task.held)
    return replace(task, beside=beside)


def finished_basis(task: Task, statics: Statics, kept: Kept) -> Basis:
    """The basis in the coordinates of the method; it warns where the modes kept of a floating part have few digits."""
    known = kept.found.rounding[:kept.found.rigid + kept.elastic]
    handle, lost = statics.handle, float(known.max(initial=0.0))
    if not kept.elastic and handle.exact < handle.rigid.shape[1]:
        lost = handle.doubt**0.5  # the soft mode is in static shapes, as exact as shapes are
    # of a K with fewer digits there is another warning, and under a tolerance the estimate counts rounding in
    if handle.floating and lost > DIGITS and handle.unit == EPS and task.method.goal is None:
        warn(f"rounding in the entries of K may change ω² of the modes of {task.sub.name!r} by a relative {lost:.0e}, and the "
             f"reduced model has them as they are. {IN_PARTS}", ConditionWarning)
    return task.method.coordinates(assembled(statics, kept, task.ports, task.method.mode_kind), statics)


def whole_basis(task: Task, part: Partition, judged: bool = True) -> Basis:
    """The basis of a component whose DOF are all interface: the identity, nothing is left out.

    In a system it is not judged by itself: it may be a point mass, which has no modes.
    """
    sub, method, b = part.sub, task.method, part.sub.interface
    if method.modes and sub is task.sub:
        raise InputError(f"{method.modes} {method.mode_kind} modes were asked for, but every DOF is interface, so there are "
                         "none. Use modes=0, or a smaller interface")
    goal = method.goal if judged else None
    estimate = None if goal is None else Nested.whole(sub, task.pencil).estimate(0, goal.band, goal.tol)
    return Basis(np.eye(sub.size)[:, b], square(sub.M, b), square(sub.K, b), ("constraint",) * len(b), 0, np.inf,
                 task.extra.shape[1], dict.fromkeys(task.ports, 0.0), 0, np.eye(len(b)), estimate)


def model_of(task: Task, basis: Basis) -> ReducedSubstructure:
    """The model in the coordinates of a basis; it warns where a port is poorly represented."""
    sub, V = task.sub, basis.V
    title = task.method.title(basis.modes)
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warn(
                f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with "
                f"{title}. Put its DOF into the interface, or call reduce(..., ports=True)", PortWarning)
    own = np.inf if V.shape[1] == sub.size else basis.cutoff
    cutoff = min(own, sub.cutoff)
    estimate = None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff)
    D, motion, noise = damping(sub, basis, projected(sub.D, V, V) if basis.D is None else basis.D)
    return ReducedSubstructure(
        basis.M, basis.K, D, {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, modes=basis.modes, full_interface=sub.interface, cutoff=cutoff, method=title,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        interface_dofs=sub.interface_dofs, sets=sub.sets, estimate=estimate, rigid_motion=motion, noise=noise,
        H=structural(sub, V), origin=origin_of(sub, V, own))


def damping(sub: Substructure, basis: Basis, D: Array) -> tuple[Array, RigidMotion | None, Array]:
    """VᵀDV without the rounding of rigid motion, this motion, and G: the rounding of D is up to EPS G Gᵀ.

    The motion is known as the method, or else the component, knows it. What a component carries is looked for in the span of V.
    """
    V = basis.V
    carried = np.abs(V).T @ sub.noise if sub.noise.shape[1] else np.zeros((V.shape[1], 0))  # |V| takes as much memory as V
    noise = np.hstack([carried, size_of_products(sub.D, V)])
    if sub.pencil.symmetric[1]:
        D = (D + D.T) / 2
    q: Array | None = None
    unit = units(sub.M)
    if basis.rigid is not None and basis.motion is not None:
        q, Z = basis.rigid, basis.motion
        if sub.rigid_motion is None and (costs(sub.K, Z)[0] > EQUAL).any():
            return D, None, noise
    elif (motion := motion_of(sub.rigid_motion)) is not None:
        q, Z = coordinates(V, motion.shapes, unit), motion.shapes
    else:
        return D, None, noise
    if q is None:
        return D, None, noise
    found = RigidMotion.of(Z, sub.D, unit, q)
    return without(D, found.undamped, energy_units(basis.M.diagonal(), basis.K.diagonal())[0]), found, noise


def work(task: Task) -> float:
    """Approximate number of multiplications in the dense part of a reduction; decides about threads."""
    sub, kept = task.sub, FIRST if task.method.modes is None else task.method.modes
    if not sp.issparse(sub.K) or sub.size <= SMALL or kept > 0.3 * sub.size:
        return float(sub.size) ** 3
    return float(sub.size) * (kept + task.method.static_columns(sub) + task.extra.shape[1]) ** 2
