"""Small models: a point with a mass; two modes and Ziegler's pendulum, which flutter; two waves of a turning disc."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, InputError, choice, finite_number, naming, real_array
from femsub.components.build import not_negative, optional_mapping
from femsub.model import MOTIONS, Affine, DofMap, Substructure


def two_mode(damping: tuple[float, float] = (0.0, 0.0)) -> Affine:
    """A mass on crossed springs, pressed onto a moving belt. The parameter "mu" is the coefficient of friction.

    M = I, D = diag(d1, d2), K = [[2, 1 - 4μ/3], [1, 2]]; without damping ω² = 2 ± √(1 - 4μ/3). The mass and one of the springs
    are the units.

    Parameters
    ----------
    damping : (d1, d2)
        Dashpots along and across the belt.

    References
    ----------
    N. Hoffmann, M. Fischer, R. Allgaier, L. Gaul, Int. J. Mech. Sci. 44 (2002) 2029.
    """
    d = np.diag([finite_number("each of damping", value) for value in damping])
    return Affine(np.eye(2), d if d.any() else None, [(1.0, [[2.0, 1.0], [1.0, 2.0]]), ("mu", [[0.0, -4 / 3], [0.0, 0.0]])])


def two_mode_critical(damping: tuple[float, float] = (0.0, 0.0)) -> float:
    """The friction at which `two_mode` begins to flutter: μ = 3/4 (1 + 2 d1 d2), for d1, d2 ≥ 0.

    From the Hurwitz determinant of (s² + d1 s + 2)(s² + d2 s + 2) - (1 - 4μ/3), which vanishes at s² = -2.
    """
    return 0.75 * (1 + 2 * damping[0] * damping[1])


def ziegler(damping: float = 0.0) -> Affine:
    """Ziegler's pendulum: two bars of length l, masses 2m and m, springs k and dashpots b in both joints, a load "P".

    M = [[3, 1], [1, 1]], D = b [[2, -1], [-1, 1]], K = [[2 - P, P - 1], [-1, 1]], in the units m = l = k = 1. The load P follows
    the direction of the second bar, so K is unsymmetric.

    Parameters
    ----------
    damping : float
        b ≥ 0 of the dashpot in each joint.

    References
    ----------
    H. Ziegler, Ing.-Arch. 20 (1952) 49; O. N. Kirillov, Nonconservative Stability Problems of Modern Physics (2013), ch. 1.
    """
    joints = np.array([[2.0, -1.0], [-1.0, 1.0]])
    D = finite_number("damping", damping) * joints
    return Affine([[3.0, 1.0], [1.0, 1.0]], D if D.any() else None, [(1.0, joints), ("P", [[-1.0, 1.0], [0.0, 0.0]])])


def ziegler_critical(damping: float = 0.0) -> float:
    """The load at which `ziegler` begins to flutter: 7/2 - √2 without damping, otherwise 41/28 + b²/2.

    The second value follows from the Hurwitz determinant of 2s⁴ + 7bs³ + (7 - 2P + b²)s² + 2bs + 1. Its limit for b → 0 is 30 %
    lower than the first value: the destabilisation paradox.
    """
    return 41 / 28 + damping**2 / 2 if damping else 3.5 - float(np.sqrt(2.0))


def disc_pair() -> dict[str, Array]:
    """The matrices M, D1, DR, DG, K1, KR and Kgeo, (2, 2) each, of q̈ + (D1 + μ DR/Ω + Ω DG) q̇ + (K1 + μ KR + Ω² Kgeo) q = 0.

    The deflection w = q₁ cos mθ + q₂ sin mθ has m = 3 nodal diameters in a fixed frame. The material flows through it at the
    speed Ω, which gives DG = 2m [[0, 1], [-1, 0]] and Kgeo = -m² I. Without the pad the frequencies are ω₀ ∓ mΩ, and ω₀ = 1.
    Springs of the pad press on both faces of the disc at θ = 0, with the total stiffness k = 0.1: K1 = diag(1 + k, 1). A face
    at the distance h/2 from the mid-plane moves by -h/2 ∂w/∂θ along the circumference, where friction acts on it. So
    KR = -k (h m / 2) [[0, 0], [1, 0]] with h = 0.1. A turning direction of sliding makes friction damp: DR = diag(c, 0). D1 = d I
    is external damping. The radius of the pad, the modal mass and ω₀ are the units.
    """
    m, k, h, c, d = 3, 0.1, 0.1, 1e-4, 2e-3
    return {"M": np.eye(2), "D1": d * np.eye(2), "DR": np.diag([c, 0.0]), "DG": 2 * m * np.array([[0.0, 1.0], [-1.0, 0.0]]),
            "K1": np.diag([1 + k, 1.0]), "KR": -k * h * m / 2 * np.array([[0.0, 0.0], [1.0, 0.0]]), "Kgeo": -m**2 * np.eye(2)}


def node(point: Sequence[float] | Array, mass: float = 0.0, inertia: Any = 0.0, *, ports: Mapping[str, str] | None = None,
         name: str = "node") -> Substructure:
    """A point with three displacements and three rotations: a bolt, a hub, the end of a beam.

    M = diag(m I, J), shape (6, 6), and K = 0. The DOF are ux, uy, uz, rx, ry, rz along and about x, y, z, in this order. They
    form the interface set "node". `Kinematic` and `Averaged` join the node to a surface, `Rigid` and `Spring` to another node or
    to the ground. Two nodes at the same place are joined by their sets.

    Parameters
    ----------
    point : array_like, shape (3,)
        The place of the node.
    mass : float
        m, lumped at the point; by default 0.
    inertia : float or array_like, shape (3,) or (3, 3)
        J about the point (mass · length²): one number for all axes, three numbers for x, y and z, or a symmetric matrix; by
        default 0.
    ports : mapping of str to str
        The motions on which forces or contacts act, as {"load": "uz"}; for a moment a rotation, as {"torque": "rx"}.
    name : str

    Raises
    ------
    InputError, InputTypeError
        A point that is not three numbers, a negative mass or inertia, an unsymmetric inertia, an unknown motion.

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
    return Substructure(sp.csr_array(M), sp.csr_array((6, 6)), interface={"node": np.arange(6)}, ports=columns, name=name,
                        dofs=dofs)
