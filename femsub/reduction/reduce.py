"""`reduce`: from a component and a method, or a system and methods of its parts, to a reduced model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, overload

from femsub.algebra import reused_memory
from femsub.errors import InputError
from femsub.reduction.contact_modes import ContactModes
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang
from femsub.reduction.dual_craig_bampton import DualCraigBampton
from femsub.reduction.guyan import Guyan
from femsub.reduction.herting import Herting
from femsub.reduction.hurty import Hurty
from femsub.reduction.interface_modes import InterfaceModes
from femsub.reduction.macneal import MacNeal
from femsub.reduction.method import METHODS, PORT_LIMIT, Method, reduced
from femsub.reduction.parts import part_by_part
from femsub.reduction.rubin import Rubin

if TYPE_CHECKING:
    from femsub.coupling import Belt, System
    from femsub.model import ReducedSubstructure, Substructure

#: importing the methods registers them
__all__ = ["METHODS", "PORT_LIMIT", "ContactModes", "CraigBampton", "CraigChang", "DualCraigBampton", "Guyan",
           "Herting", "Hurty", "InterfaceModes", "MacNeal", "Method", "Rubin", "reduce"]


@overload
def reduce(sub: Substructure, method: Method, ports: bool | Sequence[str] = ...,
           contacts: Belt | Sequence[Belt] | None = ...) -> ReducedSubstructure: ...


@overload
def reduce(sub: Substructure, method: Mapping[str, Method | ReducedSubstructure], ports: bool = ...,
           contacts: Belt | Sequence[Belt] | None = ..., *, workers: int | None = ...,
           executor: Executor | None = ...) -> System: ...


def reduce(sub: Substructure, method: Method | Mapping[str, Method | ReducedSubstructure], ports: bool | Sequence[str] = False,
           contacts: Belt | Sequence[Belt] | None = None, *, workers: int | None = None,
           executor: Executor | None = None) -> ReducedSubstructure | System:
    """Replace a component by a small one: project it onto the basis V of a reduction method.

    The result has the matrices VᵀMV, VᵀDV, VᵀKV (r, r) and the ports Vᵀw, with V (n, r) from the method.

    ``CraigBampton(modes=20)`` keeps that many modes. ``CraigBampton(band=(0, hi), tol=1e-3)`` keeps as few as possible:

    - Every frequency ω of the undamped model in the band is estimated to be within the relative error `tol`.
    - If the model is damped or has `contacts`, the same holds for every complex eigenvalue with Im λ and |Re λ| up to hi.
    - hi is below 0.7 of the cut-off frequency.

    The estimate needs no solution of the full model. Its figures are in ``.estimate`` (see `Nested.bounds` and
    `Nested.doubt`). A DOF with damping but no mass has a real λ of its own. It is kept only if the DOF is interface or port.
    Structural damping is carried along as VᵀHV. The estimate is that of the model without it.

    Of a system, band and tolerance are the system's. All parts that have one have the same, and are reduced by `CraigBampton`
    or `Hurty`. The modes of each part are then chosen so that the system is within `tol`, with few modes in all, and with all
    modes of the parts up to hi.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton, CraigChang or another `Method`
        With its number of modes, or with a band and a tolerance. Of a system it may be a mapping, {'disc': CraigBampton(20)}:
        these parts are reduced, each by its own method, and joined again; the other parts stay. Equal parts with equal methods
        are reduced once. A model that a part was reduced to before may stand in place of the method.
    ports : bool or sequence of str
        True, or the names of ports: adds the static responses to these ports to the basis.
    contacts : Belt or sequence of Belt, optional
        Only with a tolerance: the belts under which the complex eigenvalues must be accurate. Default: only the model's own D.
    workers : int, optional
        Of a system: so many processes reduce its parts side by side, each with one thread of BLAS. Default: this process alone.
    executor : concurrent.futures.Executor, optional
        Reduces the parts instead of processes started for this call: that of dask (``client.get_executor()``), of mpi4py or any
        other. Its processes must see this machine's temporary folder (environment variable TMPDIR).

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
        No basis meets the tolerance; the message says how accurate the largest one is.
    NotEnoughMemoryError
        The reduction needs more memory than is free.
    WorkerError
        A worker process died or ran out of memory. ``.part`` names its part, ``.done`` holds the other parts' models:
        ``reduce(system, methods | error.done)`` goes on from there.

    Notes
    -----
    With workers the results are those of one process to the last digit, if that uses one thread of BLAS, too
    (OMP_NUM_THREADS=1). The factors of the parts are made in the workers and end with them. What needs one later, as `refine`
    does, makes it again. A script that uses workers must begin its work under ``if __name__ == "__main__":``.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> fs.reduce(sub, fs.CraigBampton(modes=4))
    ReducedSubstructure 'chain': 5 of 10 DOF by Craig-Bampton with 4 fixed-interface modes, cut-off 1.355 rad/time
    """
    if isinstance(method, Mapping):
        return part_by_part(sub, method, ports, contacts, workers, executor)
    if workers is not None or executor is not None:
        raise InputError("workers and executor are for the parts of a system: name them with their methods, as in "
                         "reduce(system, {'disc': CraigBampton(20), 'pad': CraigBampton(10)}, workers=2)")
    with reused_memory(getattr(sub, "size", 0)):
        return reduced(sub, method, ports, contacts)
