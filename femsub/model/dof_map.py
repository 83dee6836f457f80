"""`DofMap`: the node and the direction of motion of each row of a matrix."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femsub.algebra import Frozen
from femsub.checks import Array, InputError, items, real_array, unknown_name, whole_numbers, word

LARGEST = 10 ** 15  # limit of node numbers: node and motion are packed into one integer
TRANSLATIONS = ("ux", "uy", "uz")
MOTIONS = (*TRANSLATIONS, "rx", "ry", "rz")  # motions of a node, and of a rigid body
AXES = {"ux": 0, "uy": 1, "uz": 2, "w": 2}
#: the axis and the sign of each motion that is a rotation: the slopes of a deflection w are ∂w/∂x = -θ_y and ∂w/∂y = θ_x
ROTATIONS = {"rx": (0, 1.0), "ry": (1, 1.0), "rz": (2, 1.0), "w,x": (1, -1.0), "w,y": (0, 1.0)}
STILL = ("w,xy",)  # motions that are 0 in rigid motion


@dataclass(frozen=True, eq=False, repr=False)
class DofMap(Frozen):
    """The node and the motion of each degree of freedom.

    DOF i is the motion `labels[components[i]]` of the node `nodes[i]`, which lies at `points[i]`.

    Parameters
    ----------
    nodes : array_like of int, shape (n,)
        Node numbers: the numbers of the mesh file; without a file, counted from 1.
    components : array_like of int, shape (n,)
        Indices into `labels`.
    labels : sequence of str
        E.g. ("ux", "uy", "uz") for a solid, ("w", "w,x") for a beam.
    points : array_like, shape (n, d), optional
        Coordinates of the node of each DOF, d = 1 to 3.

    Raises
    ------
    InputError
        Lengths that do not fit, a component without a label, the same motion of the same node twice, a node number of more
        than 15 digits, points that are not finite real numbers.

    Examples
    --------
    >>> import femsub as fs
    >>> dofs = fs.DofMap(nodes=[1, 1, 2, 2], components=[0, 1, 0, 1], labels=("ux", "uy"))
    >>> dofs.name(3), dofs.find(2, "ux")
    ('uy at node 2', array([2]))
    """

    nodes: Array
    components: Array
    labels: tuple[str, ...]
    points: Array | None

    def __init__(self, nodes: Iterable[int] | Array, components: Iterable[int] | Array, labels: Sequence[str] = TRANSLATIONS,
                 points: Array | None = None) -> None:
        numbers, kinds = (whole_numbers(f"{name} of a DOF map", given)
                          for name, given in (("nodes", nodes), ("components", components)))
        labels = tuple(word("labels of a DOF map", label) for label in items("labels of a DOF map", labels, "strings"))
        if len(numbers) != len(kinds):
            raise InputError("a DOF map needs one node and one component per DOF, but there are "
                             f"{len(numbers)} nodes and {len(kinds)} components")
        if len(kinds) and not 0 <= kinds.min() <= kinds.max() < len(labels):
            raise InputError(f"components must be 0 to {len(labels) - 1}, for the labels {', '.join(labels)}, but one is "
                             f"{kinds[(kinds < 0) | (kinds >= len(labels))][0]}")
        if len(numbers) and max(-int(numbers.min()), int(numbers.max())) >= LARGEST:
            raise InputError(f"nodes of a DOF map must be below {LARGEST:.0e}, but run from {numbers.min()} to {numbers.max()}")
        where = None if points is None else np.array(real_array("points of a DOF map", points))
        if where is not None and (where.ndim != 2 or len(where) != len(numbers)):
            raise InputError(f"points of a DOF map must have {len(numbers)} rows, one per DOF, but their shape is {where.shape}")
        pairs = numbers.astype(np.int64) * len(labels) + kinds
        ordered = np.sort(pairs)
        twice = ordered[1:][ordered[1:] == ordered[:-1]]
        if len(twice):
            raise InputError(f"DOF map: {labels[int(twice[0] % len(labels))]} at node {twice[0] // len(labels)} is listed twice")
        small = np.int8 if len(labels) <= np.iinfo(np.int8).max else np.int32
        self._set(nodes=numbers.astype(np.int64), components=kinds.astype(small), labels=labels, points=where)

    def __repr__(self) -> str:
        count = len(np.unique(self.nodes))
        return f"DofMap: {self.size} DOF at {count} node{'s' * (count != 1)}, {', '.join(self.labels)}"

    @property
    def size(self) -> int:
        return len(self.nodes)

    @property
    def in_space(self) -> Array:
        """The points with all three coordinates, (n, 3); they must be known."""
        assert self.points is not None
        return np.pad(self.points, ((0, 0), (0, 3 - self.points.shape[1])))

    def name(self, index: int) -> str:
        """E.g. 'uz at node 12', the name of one DOF (counted from 0)."""
        return f"{self.labels[self.components[index]]} at node {self.nodes[index]}"

    def find(self, node: int, label: str | None = None) -> Array:
        """The DOF (counted from 0) of a node, or only the one of a given motion. An unknown node or label is an InputError."""
        if label is not None and label not in self.labels:
            raise unknown_name("motion", label, self.labels)
        start, stop = np.searchsorted(self._sorted[0], [node, node + 1])
        found = np.sort(self._sorted[1][start:stop])
        if label is not None:
            found = found[self.components[found] == self.labels.index(label)]
        if not len(found):
            what = "there is no" if label is None else f"there is no {label} at"
            raise InputError(f"{what} node {node} in the DOF map. Held DOF are not in it. Nodes run from {self.nodes.min()} to "
                             f"{self.nodes.max()}")
        return found

    def rows_of(self, other: DofMap) -> Array:
        """For each DOF of another map, the row in this map with the same node and motion; -1 if there is none."""
        named = {label: at for at, label in enumerate(self.labels)}
        kinds = np.array([named.get(label, -1) for label in other.labels])[other.components]
        keys = self.nodes * len(self.labels) + self.components
        order = np.argsort(keys)
        wanted = other.nodes * len(self.labels) + kinds
        place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(order) - 1)]
        return np.where((kinds >= 0) & (keys[place] == wanted), place, -1)

    def kept(self, rows: Array) -> DofMap:
        """The map of some of the DOF, in the order of `rows`."""
        return DofMap(self.nodes[rows], self.components[rows], self.labels, None if self.points is None else self.points[rows])

    @property
    def no_rigid(self) -> str:
        """Why `rigid` cannot give the motion of the DOF in rigid motion; '' if it can."""
        for label in self.labels:
            if label not in (*AXES, *ROTATIONS, *STILL):
                return (f"the motion {label!r} has no known part in a rigid motion; those of "
                        f"{', '.join((*AXES, *ROTATIONS, *STILL))} have")
        return "the places of the DOF are not known" if self.points is None else ""

    def rigid(self, origin: Array | None = None) -> Array:
        """R (n, 6) with u = R g for the rigid motion g = (t, θ): translations t + θ × (x - x₀), and rotations θ.

        x₀ is `origin`, by default the mean of the points of all DOF.

        Raises
        ------
        InputError
            The places are not known; a motion other than ux, uy, uz, w, slopes and rotations.
        """
        if self.no_rigid:
            raise InputError(self.no_rigid)
        r = self.in_space
        r = r - (r.mean(axis=0) if origin is None else origin)
        # row a of the cross product θ × r, as coefficients of θ
        turn = np.zeros((len(r), 3, 3))
        for a, (b, c) in enumerate(((1, 2), (2, 0), (0, 1))):
            turn[:, a, b], turn[:, a, c] = r[:, c], -r[:, b]
        R = np.zeros((self.size, 6))
        for number, label in enumerate(self.labels):
            at = np.flatnonzero(self.components == number)
            if label in AXES:
                R[at, AXES[label]], R[at, 3:] = 1.0, turn[at, AXES[label]]
            elif label in ROTATIONS:
                axis, sign = ROTATIONS[label]
                R[at, 3 + axis] = sign
        return R

    def apart_from(self, other: DofMap) -> tuple[int, str] | None:
        """The first DOF whose direction differs from the same DOF of another map, and the difference; None if all agree."""
        return first_apart(*([dofs.labels[k] for k in dofs.components] for dofs in (self, other)))

    def also_called(self, label: str) -> str:
        """This map's name for the direction of `label`, with its sign, such as 'uz' for 'w'; '' if it has none."""
        mine = way_of(label)
        for name in self.labels:
            if (yours := way_of(name)) is not None and mine is not None and yours[:2] == mine[:2]:
                return name if yours == mine else f"-{name}"
        return ""

    @cached_property
    def _sorted(self) -> tuple[Array, Array]:
        order = np.argsort(self.nodes, kind="stable")
        return self.nodes[order], order


def way_of(label: str) -> tuple[str, int, float] | None:
    """The direction of a named motion: along or about an axis (0 to 2), and its sense; None if the name is not known."""
    if label in AXES:
        return "along", AXES[label], 1.0
    if label in ROTATIONS:
        return "about", *ROTATIONS[label]
    return ("twist", STILL.index(label), 1.0) if label in STILL else None


def first_apart(ours: Sequence[str], theirs: Sequence[str]) -> tuple[int, str] | None:
    """The first place where two lists of motions have different directions, and the difference; None if they agree.

    Unknown names agree with any other name.
    """
    for one, other in dict.fromkeys(zip(ours, theirs, strict=True)):  # each pair of names once
        mine, yours = way_of(one), way_of(other)
        if mine is not None and yours is not None and mine != yours:
            at = next(k for k, both in enumerate(zip(ours, theirs, strict=True)) if both == (one, other))
            return at, (f"{one} = -{other}, they turn about one axis in opposite senses" if mine[:2] == yours[:2] else
                        f"{one} and {other} are different directions")
    return None
