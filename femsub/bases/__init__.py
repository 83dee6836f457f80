"""Reduction bases: one short file per method, all behind `reduce`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from femsub.bases.basis import Basis, projected
from femsub.bases.craig_bampton import CraigBampton
from femsub.bases.craig_chang import CraigChang
from femsub.errors import InputError, InputTypeError, PortWarning
from femsub.memory import check_memory
from femsub.pencil import Array
from femsub.substructure import ReducedSubstructure, Substructure

METHODS: dict[str, type[CraigBampton] | type[CraigChang]] = {"craig-bampton": CraigBampton, "craig-chang": CraigChang}
PORT_LIMIT = 0.01  # a port's static response may be wrong by so much in the energy norm before `reduce` warns

__all__ = ["METHODS", "Basis", "CraigBampton", "CraigChang", "reduce"]


def reduce(sub: Substructure, method: CraigBampton | CraigChang,
           ports: bool | Sequence[str] = False) -> ReducedSubstructure:
    """VᵀMV, VᵀDV, VᵀKV, Vᵀw with V (n, r) from the method: a small substructure that stands in for `sub`.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton or CraigChang
        With its number of modes.
    ports : bool or sequence of str
        True (or names) adds the static response to those ports' columns to the basis.

    Warns
    -----
    PortWarning
        The static response at a port is off by more than 1 % in the energy norm. Its figure is in ``.port_error``.

    Raises
    ------
    InputError, InputTypeError
        An unknown method or port; more modes than there are; an interface that does not hold the component (HCB).
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
    check_memory(sub.name, sub.K, static, method.modes, len(sub.interface))
    basis = method.basis(sub, extra, columns)
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
    cutoff = np.inf if V.shape[1] == sub.size else basis.cutoff
    return ReducedSubstructure(
        basis.M, basis.K, projected(sub.D, V), {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, full_interface=sub.interface, cutoff=min(cutoff, sub.cutoff), method=basis.method,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs)


def _columns(w: Array) -> Array:
    return w.reshape(len(w), -1)
