"""The Euler-Bernoulli beam: cubic (Hermite) elements, supports, an elastic foundation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import check_room
from femsub.checks import EQUAL, POSITION, Array, choice, finite_number, items, positive_number, real_array, whole_number
from femsub.components.bending_elements import hermite_matrices
from femsub.components.build import component, free_to_lift, gathered, node_at, optional_mapping, per_part, warn_of_rounding
from femsub.errors import InputError, InputTypeError
from femsub.model import DofMap

if TYPE_CHECKING:
    from femsub.model import Substructure

LABELS = ("w", "w,x")
#: which of w and w,x a support holds
SUPPORTS: dict[str, tuple[int, ...]] = {"free": (), "pinned": (0,), "guided": (1,), "clamped": (0, 1)}


def beam(length: float, elements: int | Sequence[float] = 20, *, E: Any, I: Any, rho: Any, A: Any,  # noqa: E741
         foundation: Any = 0.0, supports: Mapping[Any, str] | None = None, interface: Sequence[Any] = (),
         ports: Mapping[str, Any] | None = None, rayleigh: tuple[float, float] | None = None,
         name: str = "beam") -> Substructure:
    """A straight Euler-Bernoulli beam of cubic (Hermite) elements, with supports and an elastic foundation.

    K = Σ_e ∫ EI N''N''ᵀ + k_f NNᵀ dx, M = Σ_e ∫ ρA NNᵀ dx with the cubics N of (w, w,x) at both ends, (n, n).
    This is bending in one plane, without rotary inertia and shear: EI w'''' + k_f w + ρA ẅ = 0. Each node has the DOF w and
    w,x (labels of the DOF map). w is uz, and w,x is -ry: `Kinematic` and `Averaged` mind the sign, and lists of DOF that join w,x
    to ry are refused. For joints with solids and nodes at any place there is `space_beam`. Nodes count from 1, from the left end
    at x = 0. Held DOF are removed. A pinned beam has ω_k² = (kπ/L)⁴ EI/ρA + k_f/ρA; the error of ω² falls with the fourth power
    of the element's length.

    Any consistent units: m, kg, s with E in Pa; or mm, t, s with E in MPa, rho in t/mm³ (steel: 7.85e-9), I in mm⁴,
    A in mm². ω is in rad/s in both.

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
        The DOF of these nodes that are not held. Each place names an interface set, 'left' or '0.3'.
    ports : mapping of str to place, or to (place, label)
        The deflection w at the place, or the slope with the label 'w,x'.
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
    supports = optional_mapping("supports", supports, "places and kinds, as {'left': 'clamped'}")
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
    held = [2 * _node(x, place, "supports") + dof for place, kind in supports.items()
            for dof in SUPPORTS[choice("support", kind, SUPPORTS)]]
    dofs = DofMap(np.repeat(np.arange(1, m + 2), 2), np.tile([0, 1], m + 1), LABELS, np.repeat(x, 2)[:, None])
    interface = items("interface", interface, "places")
    columns = {}
    for port, place in ports.items():
        label: Any = "w"
        if isinstance(place, tuple):
            if len(place) != 2:
                raise InputTypeError(f"port {port!r} must be a place or a pair (place, label), not {place!r:.80}")
            place, label = place
        columns[port] = np.zeros(len(lift))
        at = 2 * _node(x, place, f"port {port!r}")
        columns[port][at + LABELS.index(choice(f"motion of port {port!r}:", label, LABELS))] = 1.0
    return component(
        K, M, np.array(held, dtype=int), {str(place): 2 * _node(x, place, "interface") + np.arange(2) for place in interface},
        columns, dofs, rayleigh, name)


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
    # 16 entries of K and M, each with row and column, and four copies while they are summed
    check_room(f"a beam of {count:.3g} elements", 2 * 16 * 16 * 4.0 * count)
    x = np.arange(count + 1) * (size / count)
    return x, np.full(count, x[-1] / count)  # exactly equal, unlike differences of x


def _node(x: Array, place: Any, what: str) -> int:
    if isinstance(place, str):
        return 0 if choice(f"place in {what}:", place, ("left", "right")) == "left" else len(x) - 1
    where = [finite_number(f"a place in {what}", place)]
    return node_at(x[:, None], 1 + np.arange(len(x)), where, what, POSITION * np.diff(x).min())
