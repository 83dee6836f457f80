"""Euler-Bernoulli beams of cubic (Hermite) elements: in one plane, on an elastic foundation, and in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import check_room
from femsub.checks import (
    EQUAL,
    POSITION,
    Array,
    InputError,
    InputTypeError,
    Matrix,
    choice,
    finite_number,
    items,
    positive_number,
    real_array,
    whole_number,
    whole_numbers,
)
from femsub.components.bending_elements import hermite_matrices
from femsub.components.build import component, free_to_lift, gathered, node_at, optional_mapping, per_part, warn_of_rounding
from femsub.model import MOTIONS, DofMap

if TYPE_CHECKING:
    from femsub.model import Substructure

LABELS = ("w", "w,x")
#: the indices of w (0) and w,x (1) that each support holds
SUPPORTS: dict[str, tuple[int, ...]] = {"free": (), "pinned": (0,), "guided": (1,), "clamped": (0, 1)}
#: the indices of the six motions that each support holds
SPACE_SUPPORTS: dict[str, tuple[int, ...]] = {"free": (), "pinned": (0, 1, 2), "clamped": (0, 1, 2, 3, 4, 5)}
#: indices among an element's 12 DOF: stretching, torsion, and (v, v,x = θz), (w, w,x = -θy) at both ends
STRETCH, TWIST, ACROSS, UP = (np.array(at) for at in ((0, 6), (3, 9), (1, 5, 7, 11), (2, 4, 8, 10)))
SLOPES = np.array([1.0, -1.0, 1.0, -1.0])


def beam(length: float, elements: int | Sequence[float] = 20, *, E: Any, I: Any, rho: Any, A: Any,  # noqa: E741
         foundation: Any = 0.0, supports: Mapping[Any, str] | None = None, interface: Sequence[Any] = (),
         ports: Mapping[str, Any] | None = None, rayleigh: tuple[float, float] | None = None,
         name: str = "beam") -> Substructure:
    """A straight Euler-Bernoulli beam of cubic (Hermite) elements, with supports and an elastic foundation.

    K = Σ_e ∫ EI N''N''ᵀ + k_f NNᵀ dx, M = Σ_e ∫ ρA NNᵀ dx with the cubics N of (w, w,x) at both ends, (n, n).
    This is bending in one plane, without rotary inertia and shear: EI w'''' + k_f w + ρA ẅ = 0. Each node has the DOF w and
    w,x (labels of the DOF map). w is uz, and w,x is -ry: `Kinematic` and `Averaged` use this sign, and lists of DOF that join w,x
    to ry are refused. For joints with solids, and for nodes at any place, use `space_beam`. Nodes count from 1, from the left end
    at x = 0. Held DOF are removed. A pinned beam has ω_k² = (kπ/L)⁴ EI/ρA + k_f/ρA; the error of ω² falls with the fourth power
    of the element's length.

    Any consistent units: m, kg, s with E in Pa; or mm, t, s with E in MPa, rho in t/mm³ (steel: 7.85e-9), I in mm⁴,
    A in mm². ω is in rad/s in both systems.

    Parameters
    ----------
    length : float
    elements : int or sequence of float
        The number of equal elements, or the positions x of all nodes, ascending from 0 to `length`.
    E, I, rho, A : float or array_like, one per element
        Young's modulus, second moment of area, density, area; all positive.
    foundation : float or array_like, one per element
        Stiffness k_f of an elastic (Winkler) foundation per length: force / length².
    supports : mapping of place to str
        'clamped', 'pinned', 'guided' (w,x held, w free) or 'free', at 'left', 'right' or the x of a node. Default: free.
    interface : sequence of places
        The DOF of these nodes that are not held become interface DOF. Each place names an interface set, 'left' or '0.3'.
    ports : mapping of str to place, or to (place, label)
        The deflection w at the place, or with the label 'w,x' the slope.
    rayleigh : (alpha, beta), optional
        D = αM + βK; use `damped` for any other damping.

    Warns
    -----
    ConditionWarning
        Elements are so short that rounding may change the lowest frequencies by a relative 1e-6 or more.

    Raises
    ------
    InputError, InputTypeError
        A size that is not positive, positions that do not ascend, no node at a place, an unknown support, an
        interface or a port that is held.

    References
    ----------
    Craig and Kurdila, Fundamentals of Structural Dynamics, 2006, sec. 14.3 (the element matrices).

    Examples
    --------
    >>> import femsub as fs
    >>> fs.beam(1.0, 4, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, supports={"left": "clamped"}, interface=["right"])
    Substructure 'beam': 8 DOF, sparse, 40 nonzeros in K, 2 interface DOF, no ports
    """
    ports = optional_mapping("ports", ports, "names and places, as {'belt': 0.3}")
    x, h = element_lengths(length, elements)
    m = len(h)
    bending = per_part("E", E, m, "element") * per_part("I", I, m, "element")
    mass = per_part("rho", rho, m, "element") * per_part("A", A, m, "element")
    bed = per_part("foundation", foundation, m, "element", zero=True)

    def matrices(part: slice) -> tuple[Array, Array]:
        stiffness, unit = hermite_matrices(h[part])
        return bending[part, None, None] * stiffness, mass[part, None, None] * unit

    def bedding(part: slice) -> tuple[Array]:
        return (bed[part, None, None] * hermite_matrices(h[part])[1],)

    rows, lift = 2 * np.arange(m)[:, None] + np.arange(4), np.arange(2 * (m + 1)) % 2 == 0
    K, M = gathered(rows, len(lift), matrices)
    K = free_to_lift(K, lift)
    whole = 1 / (float(np.sum(h / bending)) * x[-1] ** 2)  # about a third of a tip's stiffness, 3EI/L³
    warn_of_rounding(K, lift, whole, name, "take longer elements", growth=0.05)  # 540 equal elements
    if bed.any():
        K = K + gathered(rows, len(lift), bedding)[0]
    moved = {port: place if isinstance(place, tuple) else (place, "w") for port, place in ports.items()}
    for port, place in moved.items():
        if len(place) != 2:
            raise InputTypeError(f"port {port!r} must be a place or a pair (place, label), not {place!r:.80}")
    return _with_ends(K, M, x[:, None], LABELS, SUPPORTS, supports, interface, moved, rayleigh, name)


def element_lengths(length: float, elements: int | Sequence[float]) -> tuple[Array, Array]:
    """The places of the nodes (m + 1,) and the lengths of the elements (m,)."""
    size = positive_number("length", length)
    if isinstance(elements, (Sequence, np.ndarray)) and not isinstance(elements, str):
        x = real_array("the places of nodes (elements)", elements, finite=False)
        if x.ndim != 1 or len(x) < 2 or x[0] != 0 or not np.isclose(x[-1], size, rtol=EQUAL) or not (np.diff(x) > 0).all():
            raise InputError(f"elements, the positions of the nodes, must ascend from 0 to the length {size:.6g}, not "
                             f"{elements!r:.80}")
        return x, np.diff(x)
    count = whole_number("elements", elements, least=1)
    # 16 entries of K and of M for each element, with their rows and columns, and four copies while they are summed
    check_room(f"a beam of {count:.3g} elements", 2 * 16 * 16 * 4.0 * count)
    x = np.arange(count + 1) * (size / count)
    return x, np.full(count, x[-1] / count)  # exactly equal, unlike differences of x


def _with_ends(K: Matrix, M: Matrix, x: Array, labels: tuple[str, ...], kinds: Mapping[str, tuple[int, ...]], supports: Any,
               interface: Any, ports: Mapping[str, tuple[Any, Any]], rayleigh: tuple[float, float] | None,
               name: str) -> Substructure:
    """The substructure of a beam with the nodes x (m + 1, d) and the motions `labels` at each, held at its supports.

    `kinds` are the indices of the motions that each kind of support holds. Each of `ports` is (place, label).
    """
    step, size = len(labels), K.shape[0]

    def node(place: Any, what: str) -> int:
        if isinstance(place, str):
            return 0 if choice(f"place in {what}:", place, ("left", "right")) == "left" else len(x) - 1
        if x.shape[1] == 1:
            where: Any = [finite_number(f"a place in {what} other than 'left' and 'right'", place)]
        elif (where := real_array(f"a place in {what}", place)).shape != (3,):
            raise InputError(f"a place in {what} must be 'left', 'right' or (x, y, z), not {place!r:.80}")
        near = POSITION * np.linalg.norm(np.diff(x, axis=0), axis=1).min()
        return node_at(x, 1 + np.arange(len(x)), where, what, near)

    supports = optional_mapping("supports", supports, "places and kinds, as {'left': 'clamped'}")
    held = [step * node(place, "supports") + k for place, kind in supports.items()
            for k in kinds[choice("support", kind, kinds)]]
    columns = {}
    for port, (place, label) in ports.items():
        columns[port] = np.zeros(size)
        at = step * node(place, f"port {port!r}")
        columns[port][at + labels.index(choice(f"motion of port {port!r}:", label, labels))] = 1.0
    sets = {str(place): step * node(place, "interface") + np.arange(step) for place in items("interface", interface, "places")}
    every = np.arange(size)
    dofs = DofMap(1 + every // step, every % step, labels, x[every // step])
    return component(K, M, np.array(held, dtype=int), sets, columns, dofs, rayleigh, name)


def space_beam(points: Any, elements: int | Sequence[int] = 20, *, E: Any, G: Any, rho: Any, A: Any, I: Any, J: Any,  # noqa: E741
               up: Sequence[float] = (0.0, 0.0, 1.0), supports: Mapping[Any, str] | None = None, interface: Sequence[Any] = (),
               ports: Mapping[str, Any] | None = None, rayleigh: tuple[float, float] | None = None,
               name: str = "beam") -> Substructure:
    """A beam in space: EA u'' = ρA ü, GJ θ'' = ρ(I_y + I_z) θ̈, EI_z v'''' = -ρA v̈, EI_y w'''' = -ρA ẅ.

    Each element has 12 DOF: ux, uy, uz, rx, ry, rz at both ends, along and about the global axes x, y, z. So its ends can be
    joined to solids and nodes by `Kinematic`, `Averaged`, `Rigid` and `Spring`. Axial displacements and torsion are linear in an
    element, lateral displacements are the cubics of `beam`. Shear and the rotary inertia of bending are neglected, as in `beam`.
    With points that do not lie on a line it is a frame with rigid corners.

    Any consistent units, as for `beam`.

    Parameters
    ----------
    points : array_like, shape (p, 3)
        The two ends, or the ends and corners one after the other.
    elements : int or sequence of int
        The number of equal elements between one point and the next: one number for all spans, or one for each.
    E, G, rho, A : float or array_like, one per element
        Young's modulus, shear modulus, density, area; all positive.
    I : float or (I_y, I_z)
        Second moments of area about the section's y and z; each a number, or one per element. A single number means I_y = I_z.
    J : float or array_like, one per element
        Torsion constant: I_y + I_z for a circle, less for other sections.
    up : array_like, shape (3,)
        The section's z is normal to the beam, in the plane of the beam and `up`. Its y is z × x, with x along the beam.
    supports : mapping of place to str
        'clamped', 'pinned' (ux, uy, uz held) or 'free', at 'left' (the first point), 'right' (the last) or (x, y, z), a node.
    interface : sequence of places
        All six DOF of these nodes become interface DOF. Each place names an interface set.
    ports : mapping of str to (place, motion)
        The motions on which forces or contacts act, as {"load": ("right", "uz")}.
    rayleigh : (alpha, beta), optional
        D = αM + βK.

    Warns
    -----
    ConditionWarning
        Elements are so short that rounding may change the lowest frequencies by a relative 1e-6 or more.

    Raises
    ------
    InputError, InputTypeError
        Points that coincide, a beam along `up`, a size that is not positive, no node at a place, an unknown support or motion.

    References
    ----------
    J. S. Przemieniecki, Theory of Matrix Structural Analysis, 1968, ch. 5 and 11 (the element matrices).

    Examples
    --------
    >>> import femsub as fs
    >>> tube = {"E": 2.1e11, "G": 8.1e10, "rho": 7850.0, "A": 5e-4, "I": 1e-7, "J": 2e-7}
    >>> fs.space_beam([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 4, **tube, supports={"left": "clamped"}, interface=["right"])
    Substructure 'beam': 48 DOF, sparse, 792 nonzeros in K, 6 interface DOF, no ports
    """
    x = nodes_along(points, elements)
    m = len(x) - 1
    span = np.diff(x, axis=0)
    h = np.linalg.norm(span, axis=1)
    R = frames(span / h[:, None], up)
    E, G, rho, A, J = (per_part(key, value, m, "element") for key, value in
                       (("E", E), ("G", G), ("rho", rho), ("A", A), ("J", J)))
    both = (I, I) if np.isscalar(I) or getattr(I, "shape", None) == () else items("I", I, "two, I_y and I_z")
    if len(both) != 2:
        raise InputError(f"I must be one number or a pair (I_y, I_z), not {I!r:.80}")
    I_y, I_z = (per_part(key, value, m, "element") for key, value in zip(("I_y", "I_z"), both, strict=True))

    def matrices(part: slice) -> tuple[Array, Array]:
        count = len(h[part])
        K, M = np.zeros((2, count, 12, 12))
        bent, unit = hermite_matrices(h[part])
        bar, mean = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        length, mass, polar = h[part], (rho * A)[part], (rho * (I_y + I_z))[part]
        for at, rigidity, inertia in ((STRETCH, (E * A)[part], mass), (TWIST, (G * J)[part], polar)):
            K[:, at[:, None], at] = (rigidity / length)[:, None, None] * bar
            M[:, at[:, None], at] = (inertia * length)[:, None, None] * mean
        for at, rigidity, sign in ((ACROSS, (E * I_z)[part], np.ones(4)), (UP, (E * I_y)[part], SLOPES)):
            signs = sign[:, None] * sign
            K[:, at[:, None], at] = rigidity[:, None, None] * bent * signs
            M[:, at[:, None], at] = mass[:, None, None] * unit * signs
        T = np.zeros((count, 12, 12))
        for k in range(0, 12, 3):
            T[:, k:k + 3, k:k + 3] = R[part]
        turned = [T.transpose(0, 2, 1) @ one @ T for one in (K, M)]
        K, M = ((one + one.transpose(0, 2, 1)) / 2 for one in turned)
        return K, M

    rows = 6 * np.arange(m)[:, None] + np.arange(12)
    K, M = gathered(rows, 6 * (m + 1), matrices)
    whole = 1 / (float(np.sum(h / (E * np.minimum(I_y, I_z)))) * h.sum()**2)  # about a third of a tip's stiffness, 3EI/L³
    warn_of_rounding(K, np.arange(K.shape[0]) % 6 < 3, whole, name, "take longer elements", growth=0.2)
    ports = optional_mapping("ports", ports, "names and (place, motion)")
    for port, where in ports.items():
        if not isinstance(where, tuple) or len(where) != 2:
            raise InputTypeError(f"port {port!r} must be a pair (place, motion), as ('right', 'uz'), not {where!r:.80}")
    return _with_ends(K, M, x, MOTIONS, SPACE_SUPPORTS, supports, interface, ports, rayleigh, name)


def nodes_along(points: Any, elements: Any) -> Array:
    """The nodes (m + 1, 3) of equal elements between consecutive points."""
    corners = real_array("points", points)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 2:
        raise InputError(f"points must be two or more, (x, y, z) each, but their shape is {corners.shape}")
    one = not isinstance(elements, (Sequence, np.ndarray)) or isinstance(elements, str) or getattr(elements, "shape", None) == ()
    counts = np.array([whole_number("elements", elements, least=1)]) if one else whole_numbers("elements", elements)
    counts = np.broadcast_to(counts, len(corners) - 1) if len(counts) in (1, len(corners) - 1) else counts
    if len(counts) != len(corners) - 1 or counts.min() < 1:
        raise InputError(f"elements must be 1 or more, one number or {len(corners) - 1} of them, not {elements!r:.80}")
    check_room(f"a beam of {counts.sum():.3g} elements", 2 * 144 * 16 * 4.0 * float(counts.sum()))
    if (np.linalg.norm(np.diff(corners, axis=0), axis=1) <= EQUAL * np.abs(corners).max()).any():
        raise InputError("two of the points that follow each other are the same")
    piece = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[piece]
    inner = corners[piece] + share[:, None] * (corners[piece + 1] - corners[piece])
    return np.vstack([inner, corners[-1:]])


def frames(along: Array, up: Any) -> Array:
    """R (m, 3, 3) with the section's x, y and z as rows: x along each element, and z as near as possible to `up`."""
    given = real_array("up", up)
    if given.shape != (3,) or not given.any():
        raise InputError(f"up must be three numbers, not all 0, but is {up!r:.80}")
    y = np.cross(given / np.linalg.norm(given), along)
    size = np.linalg.norm(y, axis=1)
    if size.min() < POSITION:
        raise InputError(f"a part of the beam lies along up = {up!r:.60}, so that the section's z is not determined: give "
                         "another up")
    y = y / size[:, None]
    return np.stack([along, y, np.cross(along, y)], axis=1)
