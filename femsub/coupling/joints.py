"""Joints: equations between the motions of parts, and springs between parts. A joint of your own is one class."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.checks import (
    EPS,
    EQUAL,
    POSITION,
    Array,
    InputError,
    InputTypeError,
    Matrix,
    items,
    naming,
    positive_number,
    real_array,
    shown,
    unknown_name,
    word,
)

if TYPE_CHECKING:
    from femsub.model import DofMap, Substructure

GROUND = "ground"
End: TypeAlias = Any  # ("disc", "left"), ("disc", [0, 1, 2]), or "ground"


@dataclass(frozen=True, eq=False)
class Link:
    """The equations, springs and dampers of a joint between parts.

    Attributes
    ----------
    equations : mapping of str to matrix, shape (m, n_b)
        C_p per part, with Σ_p C_p u_b,p = 0 for the motions u_b,p of the parts' interfaces.
    motions : mapping of str to matrix, shape (s, n_p)
        R_p per part: springs and dampers act on the motion Σ_p R_p q_p, with the parts' coordinates q_p.
    stiffness, damping : ndarray, shape (s, s)
        The matrices of these springs and dampers.
    grounded : bool
        Whether the joint leads to the ground. A part needs no other joint then.
    """

    equations: Mapping[str, Matrix] = field(default_factory=dict)
    motions: Mapping[str, Matrix] = field(default_factory=dict)
    stiffness: Array = field(default_factory=lambda: np.zeros((0, 0)))
    damping: Array = field(default_factory=lambda: np.zeros((0, 0)))
    grounded: bool = False


class Joint(ABC):
    """Base class of joints. A joint of your own is a subclass with `link`, which returns equations and springs as a `Link`."""

    @abstractmethod
    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """The joint's equations, springs and dampers for these parts; an InputError should name the part."""


@dataclass(frozen=True, eq=False)
class Site:
    """The DOF of an end of a joint, in a part's interface.

    Attributes
    ----------
    part, title : str
        The part's name, and the name of the end in messages, as 'disc.left'.
    places : ndarray, shape (k,)
        The places of the DOF in the part's interface.
    dofs : DofMap or None
        The DOF map of the end, if the part has one.
    named : bool
        Whether the end is a named set, whose order has no meaning.
    """

    part: str
    title: str
    sub: Substructure
    places: Array
    dofs: DofMap | None
    named: bool

    def __len__(self) -> int:
        return len(self.places)

    def chosen(self, factor: float = 1.0) -> Matrix:
        """The matrix (k, n_b) that picks these DOF from the interface, times a factor."""
        shape = len(self), len(self.sub.interface_numbers)
        return sp.csr_array((np.full(len(self), factor), (np.arange(len(self)), self.places)), shape=shape)

    @property
    def physical(self) -> bool:
        """Whether the interface displacements are coordinates of the part, not sums of several coordinates."""
        return len(self.sub.interface) == len(self.sub.interface_numbers)

    def name(self, at: int) -> str:
        """The name of the DOF number `at`, as "uz at node 12 of 'disc'"."""
        where = f"DOF {self.sub.interface_numbers[self.places[at]]}" if self.dofs is None else self.dofs.name(at)
        return f"{where} of {self.part!r}"


def site(parts: Mapping[str, Substructure], end: End) -> Site:
    """The DOF of an end: a named interface set of a part, or a list of DOF, which must be interface DOF."""
    part, what = _split(parts, end)
    sub = parts[part]
    numbers, known = sub.interface_numbers, sub.interface_dofs
    if isinstance(what, str):
        if what not in sub.sets:
            raise unknown_name(f"interface set of {part!r}", what, sub.sets)
        places = sub.sets[what]
        return Site(part, f"{part}.{what}", sub, places, None if known is None else known.kept(places), True)
    given = items(f"the DOF of the end {shown(end)}", what, "DOF numbers, or the name of a set")
    rows = np.array([None] if any(isinstance(row, Sequence) for row in given) else given)
    if rows.ndim != 1 or not np.issubdtype(rows.dtype, np.integer) or not len(rows):
        raise InputTypeError(f"the end {shown(end)} must list whole numbers, the DOF of {part!r} counted from 0")
    at = {int(number): place for place, number in enumerate(numbers)}
    strange = [int(row) for row in rows if int(row) not in at]
    if strange:
        raise InputError(f"DOF {strange[0]} of {part!r} is no interface DOF, and only these can be joined: name it in its "
                         f"interface= (which has {len(numbers)} DOF" + (f", {shown(numbers.tolist())})" if len(numbers) else ")"))
    if len(set(rows.tolist())) < len(rows):
        raise InputError(f"the end {shown(end)} lists a DOF of {part!r} twice")
    places = np.array([at[int(row)] for row in rows], dtype=np.intp)
    return Site(part, f"{part}{shown(rows.tolist())}", sub, places, None if known is None else known.kept(places), False)


def _split(parts: Mapping[str, Substructure], end: End) -> tuple[str, Any]:
    if isinstance(end, str) or not isinstance(end, Sequence) or len(end) != 2 or not isinstance(end[0], str):
        raise InputTypeError("an end must be (part, set), as ('disc', 'left'), (part, list of DOF), or 'ground', not "
                             f"{shown(end)}")
    if end[0] not in parts:
        raise unknown_name("part", end[0], parts)
    return end[0], end[1]


def title(end: End) -> str:
    """The name of an end in messages, as 'disc.left'."""
    if isinstance(end, Sequence) and not isinstance(end, str) and len(end) == 2:
        return f"{end[0]}.{end[1]}" if isinstance(end[1], str) else f"{end[0]}{shown(end[1])}"
    return str(end)


def matched(one: Site, other: Site, tol: float | None) -> Site:
    """The DOF of `other` in the order of `one`: by motion and place if both are known, otherwise in the order listed.

    Raises
    ------
    InputError
        Different numbers of DOF; a DOF without a counterpart within the tolerance, with the distance of the nearest one. In the
        order listed: DOF of different directions.
    """
    if len(one) != len(other):
        raise InputError(f"{one.title} has {len(one)} DOF, but {other.title} {len(other)}: name sets of the same DOF, or join "
                         "meshes that do not match by Tied")
    if one.dofs is None or other.dofs is None:
        return other
    if not (one.named and other.named) or tol == np.inf or one.dofs.points is None or other.dofs.points is None:
        refuse_other_ways(one, other)
        return other
    ours, theirs = one.dofs.in_space, other.dofs.in_space
    size = max(float(np.abs(where).max(initial=0.0)) for where in (ours, theirs))
    limit = POSITION * size if tol is None else tol
    order, apart = nearest(ours, theirs, [one.dofs.labels[k] for k in one.dofs.components],
                           [other.dofs.labels[k] for k in other.dofs.components])
    worst = int(np.argmax(apart))
    if not apart[worst] <= limit:
        far = (f"no DOF of {other.title} moves in this way{_otherwise(one, other, worst)}" if apart[worst] == np.inf else
               f"the nearest such DOF of {other.title} is {apart[worst]:.4g} away, and tol={limit:.3g} is allowed; move the "
               "part, give a larger tolerance, or tol=inf to join DOF in their order")
        raise InputError(f"{one.title} and {other.title} do not meet at {one.name(worst)}: {far}")
    if len(np.unique(order)) < len(order):
        twice = int(np.flatnonzero(np.bincount(order) > 1)[0])
        raise InputError(f"{other.name(twice)} meets two DOF of {one.title}: tol={limit:.3g} is larger than the distance "
                         "of nodes")
    return Site(other.part, other.title, other.sub, other.places[order], other.dofs.kept(order), True)


def refuse_other_ways(one: Site, other: Site) -> None:
    """Raises an error if DOF of two ends, in their order, have different axes, or opposite senses of rotation about one axis."""
    assert one.dofs is not None and other.dofs is not None
    if (found := one.dofs.apart_from(other.dofs)) is not None:
        at, how = found
        raise InputError(f"{one.name(at)} would meet {other.name(at)}: {how}. List DOF of the same directions in the same "
                         "order. Kinematic and Averaged join DOF of any directions, with their signs. If it is meant so, leave "
                         "the DofMap of one part out")


def _otherwise(one: Site, other: Site, at: int) -> str:
    """The end of a message: the name that the other end has for the same motion, or for its negative, and the remedy."""
    assert one.dofs is not None and other.dofs is not None
    label = one.dofs.labels[one.dofs.components[at]]
    if name := other.dofs.also_called(label):
        return f" by this name, but {label} = {name}. Join the two by Kinematic or Averaged, which mind names and signs"
    return ". Name sets of the same motions, or join by Kinematic or Averaged"


def nearest(points: Array, others: Array, labels: Sequence[str], kinds: Sequence[str]) -> tuple[Array, Array]:
    """For each point, the nearest of the other points with the same label, and its distance (inf if there is none)."""
    from scipy.spatial import cKDTree

    order, apart = np.zeros(len(points), dtype=np.intp), np.full(len(points), np.inf)
    mine, theirs = np.asarray(labels), np.asarray(kinds)
    for label in dict.fromkeys(labels):
        at, to = np.flatnonzero(mine == label), np.flatnonzero(theirs == label)
        if len(to):
            distance, index = cKDTree(others[to]).query(points[at])
            order[at], apart[at] = to[index], distance
    return order, apart


def allowed(tol: Any) -> float | None:
    """A checked tolerance: a distance above 0, inf (places are ignored), or None (the default)."""
    return tol if tol is None or (isinstance(tol, float) and tol == np.inf) else \
        positive_number("tol", tol)


class Rigid(Joint):
    """Equal motion of two or more ends, u_a = u_b = ...; with 'ground' among them u_a = 0.

    Two named sets with known coordinates are matched by direction and place; their order does not matter. Lists of DOF, and
    sets without coordinates, are matched in their order.

    Parameters
    ----------
    *ends : (part, set), (part, list of DOF) or 'ground'
        Two or more.
    tol : float, optional
        The largest distance between matched DOF, in units of length; by default 1e-6 of the largest coordinate. With inf, DOF
        are matched in their order, wherever they are. Directions with known names must then agree.
    name : str
        Used in messages and for multipliers.

    Raises
    ------
    InputError, InputTypeError
        Fewer than two ends. In `couple`: ends that do not meet or have different numbers of DOF, or DOF of different directions.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Rigid(("disc", "rim"), ("pad", "back"), tol=1e-4)
    Rigid(disc.rim, pad.back)
    """

    ends: tuple[End, ...]
    tol: float | None
    name: str

    def __init__(self, *ends: End, tol: float | None = None, name: str = "") -> None:
        self.ends, self.name = ends, word("name", name)
        if len(ends) < 2:
            raise InputError(f"Rigid joins two or more ends, as Rigid(('disc', 'left'), ('pad', 'right')), not {len(ends)}")
        if all(_is_ground(end) for end in ends):
            raise InputError("Rigid joins the ground to itself: name an end, ('disc', 'left')")
        self.tol = allowed(tol)

    def __repr__(self) -> str:
        return self.name or f"Rigid({', '.join(title(end) for end in self.ends)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation per DOF and end beyond the first."""
        grounded = any(_is_ground(end) for end in self.ends)
        sites = [site(parts, end) for end in self.ends if not _is_ground(end)]
        # each DOF of a full part is then in one equation, by which the coordinates of the first end determine it
        sites.sort(key=lambda one: one.physical)
        centre, others = sites[0], sites[1:]
        ends = [(one.part, *one.places.tolist()) for one in sites]
        if twice := [one.title for at, one in enumerate(sites) if ends[at] in ends[:at]]:
            raise InputError(f"{twice[0]} is joined to itself")
        pairs = [((centre.part, centre.chosen()), (other.part, matched(centre, other, self.tol).chosen(-1.0)))
                 for other in others]
        return Link(equations=stacked(*pairs, *([((centre.part, centre.chosen()),)] if grounded else [])), grounded=grounded)


def _is_ground(end: End) -> bool:
    return isinstance(end, str) and end == GROUND


def stacked(*blocks: Sequence[tuple[str, Matrix]]) -> dict[str, Matrix]:
    """One matrix per part, (m, n_b), of stacked blocks of equations. A block is a list of (part, C); a part may occur twice."""
    widths = {part: C.shape[1] for block in blocks for part, C in block}
    rows: dict[str, list[Matrix]] = {part: [] for part in widths}
    for block in blocks:
        count = block[0][1].shape[0]
        for part, width in widths.items():
            rows[part].append(sum((C for name, C in block if name == part), sp.csr_array((count, width))))
    return {part: sp.csr_array(sp.vstack(several)) for part, several in rows.items()}


@dataclass(frozen=True, eq=False)
class Spring(Joint):
    """Springs and dampers between two ends, or to the ground: f = k d + c ḋ with the relative motion d.

    Parameters
    ----------
    first, second : (part, port), (part, set), (part, list of DOF); the second also 'ground'
        For ports d = w_aᵀu_a - w_bᵀu_b. Sets are matched as in `Rigid`.
    stiffness, damping : float or array_like, shape (p, p)
        One number for each of the p motions, or a matrix. The stiffness must be symmetric and not negative; the damping may be
        any real matrix.
    tol : float, optional
        As in `Rigid`.
    name : str
        Used in messages.

    Raises
    ------
    InputError, InputTypeError
        No stiffness and no damping, a negative or unsymmetric stiffness. In `couple`: ends with different numbers of motions, or
        DOF of different directions.

    Examples
    --------
    >>> import femsub as fs
    >>> parts = {"a": fs.chain(4, interface=[4]), "b": fs.chain(3, belt=1, fixed=False)}
    >>> fs.couple(parts, [fs.Spring(("a", [3]), ("b", "belt"), stiffness=1.0, damping=0.05)]).size
    7
    """

    first: End
    second: End = GROUND
    stiffness: Any = 0.0
    damping: Any = 0.0
    tol: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        word("name", self.name)
        for key in ("stiffness", "damping"):
            value = real_array(key, getattr(self, key))
            if value.ndim not in (0, 2) or (value.ndim == 2 and value.shape[0] != value.shape[1]):
                raise InputError(f"{key} of a Spring must be a number or a square matrix, but its shape is {value.shape}")
        allowed(self.tol)
        if _is_ground(self.first):
            raise InputError("the first end of a Spring must be a part's, ('disc', 'left'); the ground is the second")
        stiffness = np.atleast_2d(real_array("stiffness", self.stiffness))
        if np.abs(stiffness - stiffness.T).max(initial=0.0) > EQUAL * np.abs(stiffness).max(initial=0.0):
            raise InputError("the stiffness of a Spring must be symmetric; friction belongs to a contact")
        values = np.linalg.eigvalsh((stiffness + stiffness.T) / 2)
        if len(values) and values[0] < -4096 * EPS * abs(values[-1]):  # rounding, also of stiffnesses that were added up before
            raise InputError("the stiffness of a Spring must not be negative")
        if not np.any(stiffness) and not np.any(real_array("damping", self.damping)):
            raise InputError("a Spring needs a stiffness or a damping")

    def __repr__(self) -> str:
        return self.name or f"Spring({title(self.first)}, {title(self.second)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """The relative motion, with stiffness and damping."""
        rows = {}
        with naming("first"):
            part, R, one = _motion(parts, self.first)
        rows[part] = R
        if not _is_ground(self.second):
            with naming("second"):
                name, S, other = _motion(parts, self.second)
            if S.shape[0] != R.shape[0]:
                raise InputError(f"{title(self.first)} has {R.shape[0]} motions, but {title(self.second)} {S.shape[0]}")
            if one is not None and other is not None:
                S = sp.csr_array(matched(one, other, self.tol).chosen() @ sp.csr_array(parts[name].interface_rows))
            rows[name] = rows[name] - S if name in rows else -S
            if not sum(abs(one).sum() for one in rows.values()):
                raise InputError(f"{title(self.first)} is joined to itself")
        count = R.shape[0]
        return Link(motions=rows, stiffness=self._matrix("stiffness", count), damping=self._matrix("damping", count),
                    grounded=_is_ground(self.second))

    def _matrix(self, key: str, count: int) -> Array:
        value = real_array(key, getattr(self, key))
        if value.ndim == 0:
            return float(value) * np.eye(count)
        if value.shape != (count, count):
            raise InputError(f"the {key} is {value.shape[0]} x {value.shape[1]}, but {title(self.first)} has {count} motions")
        return np.array(value)


def _motion(parts: Mapping[str, Substructure], end: End) -> tuple[str, Matrix, Site | None]:
    """The part, R (p, n) of the end's motions in the part's coordinates, and the `Site`, which is None for a port."""
    part, what = _split(parts, end)
    sub = parts[part]
    if isinstance(what, str) and what in sub.ports:
        if what in sub.sets:
            raise InputError(f"{part}.{what} is both a port and an interface set: give one of them another name")
        return part, sp.csr_array(sub.ports[what].reshape(sub.size, -1).T), None
    if isinstance(what, str) and what not in sub.sets:
        raise unknown_name(f"port or interface set of {part!r}", what, (*sub.ports, *sub.sets))
    one = site(parts, end)
    return part, sp.csr_array(one.chosen() @ sp.csr_array(sub.interface_rows)), one
