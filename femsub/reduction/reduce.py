"""`reduce`: from a component and a method to a reduced model, step by step."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, overload

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, choice, instance, shown
from femsub.errors import InputError, InputTypeError, PortWarning
from femsub.linalg.factor import SMALL
from femsub.linalg.memory import check_memory
from femsub.linalg.threads import WORK, one_thread
from femsub.model.assembly import System
from femsub.model.estimate import SHARE
from femsub.model.substructure import ReducedSubstructure, Substructure
from femsub.modes.normal_modes import confirm
from femsub.reduction.basis import Basis, projected
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang
from femsub.reduction.craig_chang_physical import CraigChangPhysical
from femsub.reduction.dual_craig_bampton import DualCraigBampton
from femsub.reduction.guyan import Guyan
from femsub.reduction.herting import Herting
from femsub.reduction.hurty import Hurty
from femsub.reduction.interface_modes import InterfaceModes, with_common_shapes
from femsub.reduction.macneal import MacNeal
from femsub.reduction.method import METHODS, Method
from femsub.reduction.mode_selection import unreduced
from femsub.reduction.rubin import Rubin
from femsub.reduction.statics import Partition, square

if TYPE_CHECKING:
    from femsub.model.friction import Belt
    from femsub.model.pencil import Pencil

log = logging.getLogger(__name__)

FIRST = 100  # assumed number of modes if it follows from a tolerance, for the choice of threads
PORT_LIMIT = 0.01  # relative error of a port's static response (energy norm) above which `reduce` warns

#: importing the methods registers them
__all__ = ["METHODS", "CraigBampton", "CraigChang", "CraigChangPhysical", "DualCraigBampton", "Guyan", "Herting", "Hurty",
           "InterfaceModes", "MacNeal", "Method", "Rubin", "reduce"]


@overload
def reduce(sub: Substructure, method: Method, ports: bool | Sequence[str] = ...,
           contacts: Belt | Sequence[Belt] | None = ...) -> ReducedSubstructure: ...


@overload
def reduce(sub: Substructure, method: Mapping[str, Method], ports: bool = ..., contacts: None = ...) -> System: ...


def reduce(sub: Substructure, method: Method | Mapping[str, Method], ports: bool | Sequence[str] = False,
           contacts: Belt | Sequence[Belt] | None = None) -> ReducedSubstructure | System:
    """Replace a component by a small one: project it onto the basis V of a reduction method.

    The result has the matrices VᵀMV, VᵀDV, VᵀKV (r, r) and the ports Vᵀw, with V (n, r) from the method.

    ``CraigBampton(modes=20)`` keeps that many modes. ``CraigBampton(band=(0, hi), tol=1e-3)`` keeps as few as possible:

    - Every frequency ω of the undamped model in the band is estimated to be within the relative error `tol`.
    - If the model is damped or has `contacts`, the same holds for every complex eigenvalue with Im λ and |Re λ| up to hi.
    - hi is below 0.7 of the cut-off frequency.

    The estimate needs no solution of the full model. Its figures are in ``.estimate`` (see `Nested.bounds` and
    `Nested.doubt`). A DOF with damping but no mass has a real λ of its own. It is kept only if the DOF is interface or port.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton, CraigChang or another `Method`
        With its number of modes, or with a band and a tolerance. Of a system it may be a mapping, {'disc': CraigBampton(20)}:
        these parts are reduced, each by its own method, and joined again; the other parts stay.
    ports : bool or sequence of str
        True, or the names of ports: adds the static responses to these ports to the basis.
    contacts : Belt or sequence of Belt, optional
        Only with a tolerance: the belts under which the complex eigenvalues must be accurate. Default: only the model's own D.

    Returns
    -------
    ReducedSubstructure, or System where the parts were reduced one by one
        A `Substructure` again; ``.expand(q)`` gives the displacements of the full component.

    Warns
    -----
    PortWarning
        The static response to a port's force is wrong by more than 1 % in the energy norm; see ``.port_error``.

    Raises
    ------
    InputError, InputTypeError
        An unknown method or port; more modes than there are; an interface that does not hold the component (Craig-Bampton);
        contacts without a tolerance.
    NotConvergedError
        No basis meets the tolerance; the message tells how accurate the largest one is.
    NotEnoughMemoryError
        The reduction needs more memory than is free.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> fs.reduce(sub, fs.CraigBampton(modes=4))
    ReducedSubstructure 'chain': 5 of 10 DOF by Craig-Bampton with 4 fixed-interface modes, cut-off 1.355 rad/time
    """
    if isinstance(method, Mapping):
        return _part_by_part(sub, method, ports, contacts)
    task = _checked(sub, method, ports, contacts)
    with one_thread(_work(task) < WORK):
        part = method.part(sub)
        basis = _basis(task.turned(part), part) if len(part.sub.interior) or not method.held else _whole(task, part)
        if not basis.V.shape[1]:
            raise InputError(f"the basis for {sub.name!r} would be empty: modes=0, and no interface is given. Ask for modes, or "
                             "name interface DOF")
        rom = method.finished(sub, _projected(task, basis if part.turn is None else replace(basis, V=part.turn @ basis.V)))
    log.info("%r", rom)
    return rom


def _part_by_part(sub: Substructure, methods: Mapping[str, Method], ports: bool | Sequence[str],
                  contacts: Belt | Sequence[Belt] | None) -> System:
    system = instance("sub", sub, System, "made by couple, where each part has a method of its own")
    if not isinstance(ports, bool):
        raise InputTypeError(f"ports must be True or False where the parts of a system are reduced, not {shown(ports)}")
    if contacts is not None:
        raise InputError("contacts belong to one component with a tolerance; where the parts of a system are reduced, leave them "
                         "out")
    for name in methods:
        choice("part", name, system.parts)
    made = {name: reduce(system.parts[name], method, ports) for name, method in methods.items()}
    return system.with_parts(with_common_shapes(system, made))


@dataclass(frozen=True, eq=False)
class _Task:
    """The checked arguments of `reduce`. `extra` (n, s) holds the port columns whose static responses join the basis.

    `pencil` is the damped model whose complex eigenvalues must be within the tolerance.
    """

    sub: Substructure
    method: Method
    ports: Mapping[str, Array]
    extra: Array
    pencil: Pencil | None

    def turned(self, part: Partition) -> _Task:
        """In the coordinates of the part, where these are others."""
        T = part.turn
        if T is None:
            return self
        pencil = None if self.pencil is None else part.sub.with_damping(T.T @ (self.pencil.D @ T)).pencil
        return replace(self, ports={name: T.T @ w for name, w in self.ports.items()}, extra=T.T @ self.extra, pencil=pencil)


def _checked(sub: Substructure, method: Method, ports: bool | Sequence[str],
             contacts: Belt | Sequence[Belt] | None) -> _Task:
    instance("sub", sub, Substructure)
    if not isinstance(method, Method):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if len(sub.interface_rows.shape) == 2 and sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} is already reduced, and its interface is spread over generalised coordinates (as "
                         "Craig-Chang does). Reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
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
        pencil = sub.linearised(contacts)
        if pencil.K is not sub.pencil.K:
            raise InputError("the estimate of a tolerance takes contacts that add to D only, such as belts. Give a number of "
                             f"modes instead, e.g. {type(method).__name__}(modes=20)")
        if method.band[1] >= SHARE * sub.cutoff:
            raise InputError(f"the band ends at {method.band[1]:.5g} rad/time, but {sub.name!r} is already reduced, with a "
                             f"cut-off of {sub.cutoff:.5g}. End the band below {SHARE:g} of that, or reduce the full component")
        pencil = pencil if pencil.norms[1] > 0 else None
    static = len(sub.interface) + 2 * sum(w.shape[1] for w in columns.values())
    check_memory(sub.name, sub.K, static, method.modes or 0, len(sub.interface))
    return _Task(sub, method, columns, extra, pencil)


def _basis(task: _Task, part: Partition) -> Basis:
    """The four steps; a method may override each."""
    method = task.method
    statics = method.statics(part, part.factored(), task.extra)
    kept = method.kept(statics, task.pencil)
    responses = method.responses(statics, kept, task.ports)
    statics.handle.release()  # frees memory before `confirm` makes a factor of its own
    confirm(statics.handle, kept.found)
    return method.basis(statics, kept, responses, task.ports)


def _whole(task: _Task, part: Partition) -> Basis:
    """The basis of a component whose DOF are all interface: the identity, nothing is left out."""
    sub, method, b = part.sub, task.method, part.sub.interface
    if method.modes and sub is task.sub:
        raise InputError(f"{method.modes} {method.mode_kind} modes were asked for, but every DOF is interface, so there are "
                         "none. Use modes=0, or a smaller interface")
    estimate = None if method.band is None else unreduced(sub.K, sub.M, method.band, method.tol, task.pencil)
    return Basis(np.eye(sub.size)[:, b], square(sub.M, b), square(sub.K, b), ("constraint",) * len(b), 0, np.inf,
                 task.extra.shape[1], dict.fromkeys(task.ports, 0.0), 0, estimate)


def _projected(task: _Task, basis: Basis) -> ReducedSubstructure:
    sub, V = task.sub, basis.V
    title = task.method.title(basis.modes)
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warnings.warn(
                f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with "
                f"{title}. Put its DOF into the interface, or call reduce(..., ports=True)", PortWarning, stacklevel=3)
    cutoff = min(np.inf if V.shape[1] == sub.size else basis.cutoff, sub.cutoff)
    estimate = None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff)
    return ReducedSubstructure(
        basis.M, basis.K, projected(sub.D, V, V), {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, modes=basis.modes, full_interface=sub.interface, cutoff=cutoff, method=title,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        interface_dofs=sub.interface_dofs, sets=sub.sets, estimate=estimate)


def _work(task: _Task) -> float:
    """Approximate number of multiplications in the dense part of a reduction; decides about threads."""
    sub, kept = task.sub, FIRST if task.method.modes is None else task.method.modes
    if not sp.issparse(sub.K) or sub.size <= SMALL or kept > 0.3 * sub.size:
        return float(sub.size) ** 3
    return float(sub.size) * (kept + len(sub.interface) + task.extra.shape[1]) ** 2
