"""Reduction bases: one short file per method, all behind `reduce`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array
from femsub.errors import InputError, InputTypeError, PortWarning
from femsub.linalg.factor import SMALL
from femsub.linalg.memory import check_memory
from femsub.linalg.threads import WORK, one_thread
from femsub.model.estimate import SHARE, Estimate
from femsub.model.friction import Belt
from femsub.model.substructure import ReducedSubstructure, Substructure
from femsub.reduction.basis import Basis, projected
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang

METHODS: dict[str, type[CraigBampton] | type[CraigChang]] = {"craig-bampton": CraigBampton, "craig-chang": CraigChang}
FIRST = 100  # modes that a search for their number may well take
PORT_LIMIT = 0.01  # a port's static response may be wrong by so much in the energy norm before `reduce` warns

__all__ = ["METHODS", "Basis", "CraigBampton", "CraigChang", "Estimate", "reduce"]


def reduce(sub: Substructure, method: CraigBampton | CraigChang,
           ports: bool | Sequence[str] = False, contacts: Belt | Sequence[Belt] | None = None) -> ReducedSubstructure:
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
    method : CraigBampton or CraigChang
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
        An unknown method or port; more modes than there are; an interface that does not hold the component (HCB);
        contacts without a tolerance.
    NotConvergedError
        No basis meets the tolerance; the message holds the figures of the largest.
    NotEnoughMemoryError
        The memory it needs is not there.
    """
    if not isinstance(sub, Substructure):
        raise InputTypeError(f"reduce takes a Substructure, not {type(sub).__name__}")
    if not isinstance(method, tuple(METHODS.values())):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if len(sub.interface_rows.shape) == 2 and sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} has its interface spread over generalised coordinates (as Craig-Chang leaves it); "
                         "reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
    names = list(sub.ports) if ports is True else list(ports or [])
    columns = {name: _columns(sub.port(name)) for name in sub.ports}
    for name in names:
        sub.port(name)
    extra = np.hstack([columns[name] for name in names]) if names else np.zeros((sub.size, 0))
    static = len(sub.interface) + 2 * sum(w.shape[1] for w in columns.values())
    if contacts is not None and method.band is None:
        raise InputError("contacts are for a tolerance, e.g. CraigBampton(band=(0, 2e3), tol=1e-3); a basis with a given "
                         "number of modes does not depend on them")
    damped = None
    if method.band is not None:
        pencil = sub.linearised(contacts)
        if method.band[1] >= SHARE * sub.cutoff:
            raise InputError(f"the band ends at {method.band[1]:.5g} rad/time, but {sub.name!r} is itself reduced, cut off "
                             f"at {sub.cutoff:.5g}: end below {SHARE:g} of that, or reduce the full component")
        damped = pencil if pencil.norms[1] > 0 else None
    check_memory(sub.name, sub.K, static, method.modes or 0, len(sub.interface))
    with one_thread(_work(sub, method.modes, extra.shape[1]) < WORK):
        basis = method.basis(sub, extra, columns, damped)
        D = projected(sub.D, basis.V)
    if not basis.V.shape[1]:
        raise InputError(f"no basis for {sub.name!r}: modes=0 and no interface leave nothing to move; ask for modes, or name "
                         "interface DOF")
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warnings.warn(
                f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with "
                f"{basis.method}; put its DOF into the interface, or call reduce(..., ports=True)",
                PortWarning, stacklevel=2)
    V = basis.V
    cutoff = min(np.inf if V.shape[1] == sub.size else basis.cutoff, sub.cutoff)
    estimate = None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff)
    return ReducedSubstructure(
        basis.M, basis.K, D, {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, full_interface=sub.interface, cutoff=cutoff, method=basis.method,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        estimate=estimate)


def _work(sub: Substructure, modes: int | None, extra: int) -> float:
    """About how many multiplications the dense part of a reduction takes, all modes at once or a basis worked on twice."""
    n, kept = sub.size, FIRST if modes is None else modes
    if not sp.issparse(sub.K) or n <= SMALL or kept > 0.3 * n:
        return float(n) ** 3
    return float(n) * (kept + len(sub.interface) + extra) ** 2


def _columns(w: Array) -> Array:
    return w.reshape(len(w), -1)
