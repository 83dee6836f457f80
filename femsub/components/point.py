"""`node`: one point with six motions, and with a mass if it has one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, choice, naming, real_array
from femsub.components.build import not_negative, optional_mapping
from femsub.errors import InputError
from femsub.model import MOTIONS, DofMap, Substructure


def node(point: Sequence[float] | Array, mass: float = 0.0, inertia: Any = 0.0, *, ports: Mapping[str, str] | None = None,
         name: str = "node") -> Substructure:
    """A point with three displacements and three rotations: a bolt, a hub, the end of a beam.

    M = diag(m I, J), shape (6, 6), and K = 0. The DOF are ux, uy, uz, rx, ry, rz along and about x, y, z, in this order, and make
    up the interface set "node". `Kinematic` and `Averaged` join it to a surface, `Rigid` and `Spring` to another node or to the
    ground. Two nodes at the same place are joined by their sets.

    Parameters
    ----------
    point : array_like, shape (3,)
        Its place.
    mass : float
        m, lumped there; by default 0.
    inertia : float or array_like, shape (3,) or (3, 3)
        J about the point (mass · length²): one number for all axes, those about x, y and z, or a symmetric matrix; by default 0.
    ports : mapping of str to str
        Where forces or contacts act: a motion, as {"load": "uz"}, or a moment, as {"torque": "rx"}.
    name : str

    Raises
    ------
    InputError, InputTypeError
        A point of other than three numbers, a mass or an inertia that is negative, an inertia that is not symmetric, an unknown
        motion.

    Examples
    --------
    >>> import femsub as fs
    >>> hub = fs.node((0.0, 0.0, 0.1), mass=2.0, inertia=(0.01, 0.01, 0.02), ports={"torque": "rz"})
    >>> print(hub, hub.dofs.name(5), sep="\\n")
    Substructure 'node': 6 DOF, sparse, 0 nonzeros in K, 6 interface DOF, ports torque
    rz at node 1
    """
    place = real_array("point", point)
    if place.shape != (3,):
        raise InputError(f"point must be three numbers, (x, y, z), but its shape is {place.shape}")
    J = real_array("inertia", inertia)
    if J.shape not in ((), (3,), (3, 3)):
        raise InputError(f"inertia must be one number, three, or a matrix (3, 3), but its shape is {J.shape}")
    J = J if J.ndim == 2 else np.diag(np.broadcast_to(J, 3))
    if np.abs(J - J.T).max() > EQUAL * np.abs(J).max():
        raise InputError("inertia must be symmetric")
    if np.linalg.eigvalsh(J)[0] < -EQUAL * np.abs(J).max():
        raise InputError("inertia must not be negative about any axis")
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = not_negative("mass", mass) * np.eye(3), (J + J.T) / 2
    columns = {}
    for port, label in optional_mapping("ports", ports, "names and motions, as {'load': 'uz'}").items():
        with naming(f"port {port!r}"):
            columns[port] = np.eye(6)[MOTIONS.index(choice("motion", label, MOTIONS))]
    dofs = DofMap(np.ones(6, dtype=int), np.arange(6), MOTIONS, np.tile(place, (6, 1)))
    return Substructure(sp.csr_array(M), sp.csr_array((6, 6)), interface={"node": np.arange(6)}, ports=columns, name=name, dofs=dofs)
