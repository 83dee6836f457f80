"""`reduce`: the line of steps from a component and a method to a reduced model."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, instance
from femsub.errors import InputError, InputTypeError, PortWarning
from femsub.linalg.factor import SMALL
from femsub.linalg.memory import check_memory
from femsub.linalg.threads import WORK, one_thread
from femsub.model.estimate import SHARE
from femsub.model.substructure import ReducedSubstructure, Substructure
from femsub.modes.normal_modes import confirm
from femsub.reduction.basis import Basis, projected
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang
from femsub.reduction.method import METHODS, Method
from femsub.reduction.mode_selection import unreduced
from femsub.reduction.statics import Partition, square

if TYPE_CHECKING:
    from femsub.model.friction import Belt
    from femsub.model.pencil import Pencil

FIRST = 100  # modes that a search for their number may well take
PORT_LIMIT = 0.01  # a port's static response may be wrong by so much in the energy norm before `reduce` warns

__all__ = ["METHODS", "CraigBampton", "CraigChang", "Method", "reduce"]  # importing these registers the two


def reduce(sub: Substructure, method: Method, ports: bool | Sequence[str] = False,
           contacts: Belt | Sequence[Belt] | None = None) -> ReducedSubstructure:
    """VᵀMV, VᵀDV, VᵀKV, Vᵀw with V (n, r) from the method: a small substructure that stands in for `sub`.

    With a number of modes, `CraigBampton(modes=20)`, that many are kept. With a band and a tolerance,
    `CraigBampton(band=(0, hi), tol=1e-3)`, as few as will do: every frequency ω of the undamped model in the band, and
    every complex eigenvalue λ with Im λ and |Re λ| up to hi if the model is damped or has `contacts`, is estimated to be
    within the relative error `tol` of the full model's, and hi is below 0.7 of the cut-off. The estimate takes no
    solution of the full model; its figures are in ``.estimate`` (see `Nested.bounds` and `Nested.doubt`). DOF that have
    damping but no mass relax by themselves, with a real λ of their own: that one is held only if they are interface or port.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton, CraigChang or another `Method`
        With its number of modes, or with a band and a tolerance.
    ports : bool or sequence of str
        True (or names) adds the static response to those ports' columns to the basis.
    contacts : Belt or sequence of Belt, optional
        With a tolerance: the belts under which the complex eigenvalues are wanted; without, the model's own D counts.

    Warns
    -----
    PortWarning
        The static response at a port is off by more than 1 % in the energy norm. Its figure is in ``.port_error``.

    Raises
    ------
    InputError, InputTypeError
        An unknown method or port; more modes than there are; an interface that does not hold the component (Craig-Bampton);
        contacts without a tolerance.
    NotConvergedError
        No basis meets the tolerance; the message holds the figures of the largest.
    NotEnoughMemoryError
        The memory it needs is not there.
    """
    task = _checked(sub, method, ports, contacts)
    with one_thread(_work(task) < WORK):
        basis = _basis(task) if len(sub.interior) or not method.held else _whole(task)
        if not basis.V.shape[1]:
            raise InputError(f"no basis for {sub.name!r}: modes=0 and no interface leave nothing to move; ask for modes, or "
                             "name interface DOF")
        return _projected(task, basis)


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked, checked: `extra` (n, s) are the ports' columns whose static responses join, `pencil` is the damped model
    whose complex eigenvalues must be within the tolerance.
    """

    sub: Substructure
    method: Method
    ports: Mapping[str, Array]
    extra: Array
    pencil: Pencil | None


def _checked(sub: Substructure, method: Method, ports: bool | Sequence[str],
             contacts: Belt | Sequence[Belt] | None) -> _Task:
    instance("sub", sub, Substructure)
    if not isinstance(method, Method):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if len(sub.interface_rows.shape) == 2 and sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} has its interface spread over generalised coordinates (as Craig-Chang leaves it); "
                         "reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
    columns = {name: w.reshape(len(w), -1) for name, w in sub.ports.items()}
    names = list(sub.ports) if ports is True else list(ports or [])
    for name in names:
        sub.port(name)
    extra = np.hstack([np.zeros((sub.size, 0)), *(columns[name] for name in names)])
    if contacts is not None and method.band is None:
        raise InputError(f"contacts are for a tolerance, e.g. {type(method).__name__}(band=(0, 2e3), tol=1e-3); a basis with a "
                         "given number of modes does not depend on them")
    pencil = None
    if method.band is not None:
        pencil = sub.linearised(contacts)
        if method.band[1] >= SHARE * sub.cutoff:
            raise InputError(f"the band ends at {method.band[1]:.5g} rad/time, but {sub.name!r} is itself reduced, cut off "
                             f"at {sub.cutoff:.5g}: end below {SHARE:g} of that, or reduce the full component")
        pencil = pencil if pencil.norms[1] > 0 else None
    static = len(sub.interface) + 2 * sum(w.shape[1] for w in columns.values())
    check_memory(sub.name, sub.K, static, method.modes or 0, len(sub.interface))
    return _Task(sub, method, columns, extra, pencil)


def _basis(task: _Task) -> Basis:
    """The steps of which the method may replace those that are its own."""
    method = task.method
    part = Partition.of(task.sub, method.held)
    statics = method.statics(part, part.factored(), task.extra)
    kept = method.kept(statics, task.pencil)
    responses = method.responses(statics, kept, task.ports)
    statics.handle.release()  # before the count, which takes a factor of its own
    confirm(statics.handle, kept.found)
    return method.basis(statics, kept, responses, task.ports)


def _whole(task: _Task) -> Basis:
    """That of a component whose every DOF is interface, where a method would hold them all: nothing is left out."""
    sub, method, b = task.sub, task.method, task.sub.interface
    if method.modes:
        raise InputError(f"{method.modes} {method.mode_kind} modes were asked for, but every DOF is interface: there are 0")
    estimate = None if method.band is None else unreduced(sub.K, sub.M, method.band, method.tol, task.pencil)
    return Basis(np.eye(sub.size)[:, b], square(sub.M, b), square(sub.K, b), ("constraint",) * len(b), 0, np.inf,
                 task.extra.shape[1], dict.fromkeys(task.ports, 0.0), 0, estimate)


def _projected(task: _Task, basis: Basis) -> ReducedSubstructure:
    sub, V = task.sub, basis.V
    title = f"{task.method.label} with {basis.modes} {task.method.mode_kind} modes"
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warnings.warn(
                f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with "
                f"{title}; put its DOF into the interface, or call reduce(..., ports=True)", PortWarning, stacklevel=3)
    cutoff = min(np.inf if V.shape[1] == sub.size else basis.cutoff, sub.cutoff)
    estimate = None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff)
    return ReducedSubstructure(
        basis.M, basis.K, projected(sub.D, V, V), {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, modes=basis.modes, full_interface=sub.interface, cutoff=cutoff, method=title,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        estimate=estimate)


def _work(task: _Task) -> float:
    """About how many multiplications the dense part of a reduction takes, all modes at once or a basis worked on twice."""
    sub, kept = task.sub, FIRST if task.method.modes is None else task.method.modes
    if not sp.issparse(sub.K) or sub.size <= SMALL or kept > 0.3 * sub.size:
        return float(sub.size) ** 3
    return float(sub.size) * (kept + len(sub.interface) + task.extra.shape[1]) ** 2
