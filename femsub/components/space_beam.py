"""The Euler-Bernoulli beam in space: stretching, torsion and bending in two planes, straight or along a line of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import check_room
from femsub.checks import EQUAL, POSITION, Array, choice, items, real_array, whole_numbers
from femsub.components.bending_elements import hermite_matrices
from femsub.components.build import component, gathered, node_at, optional_mapping, per_part, warn_of_rounding
from femsub.errors import InputError, InputTypeError
from femsub.model import MOTIONS, DofMap

if TYPE_CHECKING:
    from femsub.model import Substructure

#: which of the six motions a support holds
SUPPORTS: dict[str, tuple[int, ...]] = {"free": (), "pinned": (0, 1, 2), "clamped": (0, 1, 2, 3, 4, 5)}
#: of an element's 12 DOF: stretching, torsion, and (v, v,x = θz), (w, w,x = -θy) at both ends
STRETCH, TWIST, ACROSS, UP = (0, 6), (3, 9), (1, 5, 7, 11), (2, 4, 8, 10)
SLOPES = np.array([1.0, -1.0, 1.0, -1.0])


def space_beam(points: Any, elements: int | Sequence[int] = 20, *, E: Any, G: Any, rho: Any, A: Any, I: Any, J: Any,  # noqa: E741
               up: Sequence[float] = (0.0, 0.0, 1.0), supports: Mapping[Any, str] | None = None, interface: Sequence[Any] = (),
               ports: Mapping[str, Any] | None = None, rayleigh: tuple[float, float] | None = None,
               name: str = "beam") -> Substructure:
    """A beam in space: EA u'', GJ θ'', EI_z v and EI_y w against ρA ü, ρ(I_y + I_z) θ̈, ρA v̈ and ρA ẅ.

    Each element has 12 DOF: at both ends ux, uy, uz, rx, ry, rz in the directions of x, y, z of all parts. So its ends can be
    joined to solids and nodes by `Kinematic`, `Averaged`, `Rigid` and `Spring`. Displacements along and torsion are linear in an
    element, those across are the cubics of `beam`. Shear and the rotary inertia of bending are left out, as there. With points
    that do not lie on a line it is a frame with rigid corners.

    Any consistent units, as for `beam`.

    Parameters
    ----------
    points : array_like, shape (p, 3)
        The two ends, or the ends and corners one after the other.
    elements : int or sequence of int
        Equal elements between one point and the next, one number for all or one each.
    E, G, rho, A : float or array_like, one per element
        Young's modulus, shear modulus, density, area; all positive.
    I : float or (I_y, I_z)
        Second moments of area about the section's y and z; each a number, or one per element. One number is both.
    J : float or array_like, one per element
        Torsion constant: of a circle I_y + I_z, of other sections less.
    up : array_like, shape (3,)
        The section's z is normal to the beam, in the plane of the beam and `up`. Its y is z × x, with x along the beam.
    supports : mapping of place to str
        'clamped', 'pinned' (ux, uy, uz held) or 'free', at 'left' (the first point), 'right' (the last) or (x, y, z), a node.
    interface : sequence of places
        All six DOF of these nodes; each place names an interface set.
    ports : mapping of str to (place, motion)
        Where forces or contacts act, as {"load": ("right", "uz")}.
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
    Substructure 'beam': 48 DOF, sparse, 576 nonzeros in K, 6 interface DOF, no ports
    """
    x = nodes_along(points, elements)
    m = len(x) - 1
    span = np.diff(x, axis=0)
    h = np.linalg.norm(span, axis=1)
    R = frames(span / h[:, None], up)
    E, G, rho, A, J = (per_part(key, value, m, "element") for key, value in
                       (("E", E), ("G", G), ("rho", rho), ("A", A), ("J", J)))
    both = (I, I) if np.ndim(I) == 0 else I
    if isinstance(both, (str, Mapping)) or len(both) != 2:
        raise InputTypeError(f"I must be one number or a pair (I_y, I_z), not {I!r:.80}")
    I_y, I_z = (per_part(key, value, m, "element") for key, value in zip(("I_y", "I_z"), both, strict=True))

    def matrices(part: slice) -> tuple[Array, Array]:
        count = len(h[part])
        K, M = np.zeros((2, count, 12, 12))
        bent, unit = hermite_matrices(h[part])
        bar, mean = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        length, mass, polar = h[part], (rho * A)[part], (rho * (I_y + I_z))[part]
        for at, rigidity, inertia in ((STRETCH, (E * A)[part], mass), (TWIST, (G * J)[part], polar)):
            K[:, np.array(at)[:, None], at] = (rigidity / length)[:, None, None] * bar
            M[:, np.array(at)[:, None], at] = (inertia * length)[:, None, None] * mean
        for at, rigidity, sign in ((ACROSS, (E * I_z)[part], np.ones(4)), (UP, (E * I_y)[part], SLOPES)):
            signs = sign[:, None] * sign
            K[:, np.array(at)[:, None], at] = rigidity[:, None, None] * bent * signs
            M[:, np.array(at)[:, None], at] = mass[:, None, None] * unit * signs
        T = np.zeros((count, 12, 12))
        for k in range(0, 12, 3):
            T[:, k:k + 3, k:k + 3] = R[part]
        turned = [T.transpose(0, 2, 1) @ one @ T for one in (K, M)]
        K, M = ((one + one.transpose(0, 2, 1)) / 2 for one in turned)
        return K, M

    rows = 6 * np.arange(m)[:, None] + np.arange(12)
    K, M = gathered(rows, 6 * (m + 1), matrices)
    every = np.arange(6 * (m + 1))
    whole = 1 / (float(np.sum(h / (E * np.minimum(I_y, I_z)))) * float(h.sum())**2)  # about a third of a tip's stiffness, 3EI/L³
    warn_of_rounding(K, every % 6 < 3, whole, name, "take longer elements", growth=0.2)
    dofs = DofMap(1 + every // 6, every % 6, MOTIONS, x[every // 6])

    def node(place: Any, what: str) -> int:
        if isinstance(place, str):
            return 0 if choice(f"place in {what}:", place, ("left", "right")) == "left" else m
        where = real_array(f"a place in {what}", place)
        if where.shape != (3,):
            raise InputError(f"a place in {what} must be 'left', 'right' or (x, y, z), not {place!r:.80}")
        return node_at(x, 1 + np.arange(m + 1), where, what, POSITION * h.min())

    supports = optional_mapping("supports", supports, "places and kinds, as {'left': 'clamped'}")
    held = [6 * node(place, "supports") + k for place, kind in supports.items()
            for k in SUPPORTS[choice("support", kind, SUPPORTS)]]
    columns = {}
    for port, where in optional_mapping("ports", ports, "names and (place, motion)").items():
        if not isinstance(where, tuple) or len(where) != 2:
            raise InputTypeError(f"port {port!r} must be a pair (place, motion), as ('right', 'uz'), not {where!r:.80}")
        columns[port] = np.zeros(len(every))
        at = 6 * node(where[0], f"port {port!r}")
        columns[port][at + MOTIONS.index(choice(f"motion of port {port!r}:", where[1], MOTIONS))] = 1.0
    sets = {str(place): 6 * node(place, "interface") + np.arange(6) for place in items("interface", interface, "places")}
    return component(K, M, np.array(held, dtype=int), sets, columns, dofs, rayleigh, name)


def nodes_along(points: Any, elements: Any) -> Array:
    """The nodes (m + 1, 3) of equal elements between points, one after the other."""
    corners = real_array("points", points)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 2:
        raise InputError(f"points must be two or more, (x, y, z) each, but their shape is {corners.shape}")
    counts = whole_numbers("elements", [elements] if np.ndim(elements) == 0 else elements)
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
    """R (m, 3, 3): the section's x, y and z as rows, x along each element and z as near as can be to `up`."""
    given = real_array("up", up)
    if given.shape != (3,) or not given.any():
        raise InputError(f"up must be three numbers, not all 0, but is {up!r:.80}")
    y = np.cross(given / np.linalg.norm(given), along)
    size = np.linalg.norm(y, axis=1)
    if size.min() < POSITION:
        raise InputError(f"a part of the beam lies along up = {up!r:.60}, so that the section's z is not determined: give another up")
    y = y / size[:, None]
    return np.stack([along, y, np.cross(along, y)], axis=1)
