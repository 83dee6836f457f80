"""Changes of a model: matrices that are added to M, D, K and H, as functions of an amount. The protocol, and changes at nodes.

A change acts on displacements u = U q of a few DOF, ΔK = θ(a) UᵀAU. U of a reduced model is U V, with the U of the full model;
U of a system is U L, with the U of a part. So one change serves the full and the reduced model, as one contact does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, InputTypeError, Matrix, finite_number, items, shown, unknown_name, whole_numbers
from femsub.model.dof_map import MOTIONS, DofMap, first_apart
from femsub.model.substructure import ReducedSubstructure, Substructure

GROUND = "ground"


class ChangeTerm(NamedTuple):
    """θ(a) UᵀAU, which a change adds to one of the matrices; `matrix` is 'M', 'D', 'K' or 'H'.

    U has the shape (t, n) and A (t, t). θ accepts a `Jet` in place of a number, and θ(0) = 0.
    """

    matrix: str
    U: Matrix
    A: Matrix
    factor: Callable[[Any], Any]


class Change(ABC):
    """A change of a model by an amount. Write a change of your own as a frozen dataclass with `amount`, `name` and `terms`.

    `sensitivities` uses the derivative at the amount 0; `modified` applies the amount.

    Attributes
    ----------
    amount : float
        In `unit`. For a parameter, the difference from its present value.
    unit : str
        For tables.
    """

    amount: float
    unit: ClassVar[str] = ""

    @property
    def value(self) -> float:
        """The parameter's present value; NaN for a mass, spring or damper that the model does not have yet."""
        return float("nan")

    @property
    @abstractmethod
    def name(self) -> str:
        """A name for tables."""

    def allowed(self, amount: float) -> None:  # noqa: B027  (most amounts are)
        """Raise an `InputError` for an amount with which the model makes no sense, such as a negative E."""

    @abstractmethod
    def terms(self, model: Substructure) -> list[ChangeTerm]:
        """The terms that the change adds to the matrices of a model.

        Raises
        ------
        InputError
            The model does not have the place where it acts.
        """


@dataclass(frozen=True, eq=False)
class _AtNodes(Change):
    """Adds a Σ_i s_i u_i² to the quadratic form of M, K or D, with the motions u_i of an end and shares s_i.

    The amount is the sum over the nodes in each direction: a set of N nodes has s = 1/N. The motion of a port has s = 1.
    """

    at: Any
    amount: float = 1.0
    directions: Sequence[str] | None = None

    matrix: ClassVar[str]
    noun: ClassVar[str]

    def __post_init__(self) -> None:
        finite_number("amount", self.amount)
        if self.directions is not None:
            object.__setattr__(self, "directions", tuple(items("directions", self.directions, "names of motions, as 'uz'")))

    @property
    def name(self) -> str:
        return f"{self.noun} at {_title(self.at)}"

    def terms(self, model: Substructure, few: int = 64) -> list[ChangeTerm]:
        """One term, on the motions of the end. A is dense for up to `few` motions, which takes less time."""
        U, shares, _ = end_motions(model, self.at, self.directions)
        A = np.diag(shares) if len(shares) <= few else sp.diags_array(shares, format="csr")
        return [ChangeTerm(self.matrix, U, A, lambda a: a)]


@dataclass(frozen=True, eq=False)
class AddedMass(_AtNodes):
    """A mass m on a set of nodes or on the motion of a port: M + m Σ_i s_i e_i e_iᵀ, (n, n).

    Each node of a set of N nodes gets the share s = 1/N of the mass, in each direction. Rotations are left out, unless
    `directions` names them. At a port, M becomes M + m w wᵀ.

    Parameters
    ----------
    at : str, sequence of int, or (part, sequence of int)
        An interface set or a port of the model, as 'disc.rim' of a system, or DOF of the full model, counted from 0. For a
        system give the DOF with their part, (part, DOF).
    amount : float
        m in units of mass. A negative m removes mass.
    directions : sequence of str, optional
        Labels of the DOF map, as 'uz'. Only these motions count.

    Raises
    ------
    InputError, InputTypeError
        When the change is used: a place that the model does not have, an unknown direction.

    Examples
    --------
    >>> import femsub as fs
    >>> chain = fs.chain(3)
    >>> fs.modified(chain, [fs.AddedMass([2], 0.5)]).M.diagonal().tolist()
    [1.0, 1.0, 1.5]
    """

    unit: ClassVar[str] = "mass"
    matrix: ClassVar[str] = "M"
    noun: ClassVar[str] = "mass"


@dataclass(frozen=True, eq=False)
class _Between(_AtNodes):
    to: Any = GROUND

    def terms(self, model: Substructure, few: int = 64) -> list[ChangeTerm]:
        """One term, on the motion relative to the other end."""
        term, = super().terms(model, few)
        if isinstance(self.to, str) and self.to == GROUND:
            return [term]
        mine = end_motions(model, self.at, self.directions)[2]
        other, _, yours = end_motions(model, self.to, self.directions)
        if other.shape != term.U.shape:
            raise InputError(f"{_title(self.at)} has {term.U.shape[0]} motions, but {_title(self.to)} {other.shape[0]}")
        if mine is not None and yours is not None and (found := first_apart(mine, yours)) is not None:
            raise InputError(f"motion {found[0] + 1} of {_title(self.at)} and of {_title(self.to)} do not fit: {found[1]}. List "
                             "DOF of the same directions in the same order, or name the directions")
        return [term._replace(U=term.U - other)]

    @property
    def name(self) -> str:
        return super().name + ("" if isinstance(self.to, str) and self.to == GROUND else f" to {_title(self.to)}")


@dataclass(frozen=True, eq=False)
class AddedSpring(_Between):
    """A spring k from a set of nodes, or from the motion of a port, to the ground or to another end: K + k Σ_i s_i d_i d_iᵀ.

    Each node of a set of N nodes gets the share s = 1/N of the stiffness, in each direction. To join two sets node by node, by
    their places, use `Spring`.

    Parameters
    ----------
    at, amount, directions : see `AddedMass`
        The amount is k in force per length. A negative k removes stiffness.
    to : 'ground', or as `at`
        The other end, with as many motions in the same order.

    Raises
    ------
    InputError, InputTypeError
        When the change is used: see `AddedMass`; ends with different numbers of motions, or with different directions.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.modified(fs.chain(3), [fs.AddedSpring([2], 0.5)]).K.diagonal().tolist()
    [2.0, 2.0, 1.5]
    """

    unit: ClassVar[str] = "force/length"
    matrix: ClassVar[str] = "K"
    noun: ClassVar[str] = "spring"


@dataclass(frozen=True, eq=False)
class AddedDamper(_Between):
    """A dashpot c from a set of nodes, or from the motion of a port, to the ground or to another end: D + c Σ_i s_i d_i d_iᵀ.

    Parameters
    ----------
    at, amount, directions, to : see `AddedSpring`
        The amount is c in force · time per length.

    Raises
    ------
    InputError, InputTypeError
        See `AddedSpring`.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.modified(fs.chain(3), [fs.AddedDamper("belt", 0.5)]).D.diagonal().tolist()
    [0.6, 0.0, 0.0]
    """

    unit: ClassVar[str] = "force time/length"
    matrix: ClassVar[str] = "D"
    noun: ClassVar[str] = "damper"


@dataclass(frozen=True, eq=False)
class JointChange(Change):
    """A joint's springs and dampers times a share a are added: K + a RᵀkR, D + a RᵀcR with the relative motion R of the joint.

    For a joint of the system, a = -0.1 removes a tenth of it. For another joint, a = 1 adds it. Functions that expect a change
    also accept a `Spring`: it means a = 1.

    Parameters
    ----------
    joint : Spring, or another `Joint` without equations
    amount : float
        a, without unit.

    Raises
    ------
    InputTypeError, InputError
        Something else than a joint. When the change is used: a joint with equations, or ends that the model does not have.

    Examples
    --------
    >>> import femsub as fs
    >>> chain = fs.chain(3, interface=[3])
    >>> softer = fs.JointChange(fs.Spring(("chain", [2]), stiffness=2.0), -0.25)
    >>> fs.modified(chain, [softer]).K.diagonal().tolist()
    [2.0, 2.0, 0.5]
    """

    joint: Any
    amount: float = 1.0

    @property
    def value(self) -> float:
        """1, the whole joint."""
        return 1.0

    def __post_init__(self) -> None:
        finite_number("amount", self.amount)
        if not callable(getattr(self.joint, "link", None)) or isinstance(self.joint, type):
            raise InputTypeError(f"joint must be a Spring or another joint, not {shown(self.joint)}")

    @property
    def name(self) -> str:
        return repr(self.joint)

    def terms(self, model: Substructure) -> list[ChangeTerm]:
        """The terms of the joint's springs and dampers."""
        if (whole := _behind(model)) is not None:
            return [term._replace(U=term.U @ model.V) for term in self.terms(whole)]  # type: ignore[attr-defined]
        parts = getattr(model, "parts", None)
        link = self.joint.link({model.name: model} if parts is None else parts)
        if link.equations or not link.motions:
            raise InputError(f"{self.joint!r} has equations or no motions: only springs and dampers can be changed by a share")
        U = sum(sp.csr_array(R) @ sp.csr_array(_coordinates(model, name)) for name, R in link.motions.items())
        U = U if sp.issparse(model.K) else U.toarray()
        return [ChangeTerm(key, U, sp.csr_array(C), lambda a: a) for key, C in (("K", link.stiffness), ("D", link.damping))
                if np.any(C)]


def as_changes(what: str, given: Any) -> list[Change]:
    """A list of changes, each checked. A joint becomes its `JointChange` with the share 1."""
    found: list[Change] = []
    for one in items(what, given, "changes, as AddedMass(...), MaterialChange(...) or a Spring"):
        joint = callable(getattr(one, "link", None)) and not isinstance(one, type)
        change = JointChange(one) if joint else one
        if not isinstance(change, Change):
            raise InputTypeError(f"each of {what} must be a change, as AddedMass(...), or a Spring, not {shown(one)}")
        found.append(change)
    return found


def added(model: Substructure, changes: Sequence[Change]) -> dict[str, Matrix]:
    """ΔM, ΔD, ΔK and ΔH (n, n) of changes at their amounts, by name; matrices without a change are left out."""
    found: dict[str, Matrix] = {}
    for change in changes:
        for key, U, A, factor in change.terms(model):
            if weight := float(factor(change.amount)):
                plus = weight * (U.T @ ((sp.csr_array(A) if sp.issparse(U) else A) @ U))
                found[key] = found[key] + plus if key in found else plus
    return found


def part_of(model: Substructure, part: str) -> Substructure:
    """A part of a system by its name, such as 'disc', or 'front.disc' for a part of the system 'front' in it.

    An empty name, or the model's own name, returns the model itself if it is no system.

    Raises
    ------
    InputError
        There is no such part, or a system is given without the name of a part.
    """
    parts = getattr(model, "parts", None)
    if part not in ("", model.name) and (whole := _behind(model)) is not None:
        return part_of(whole, part)
    if parts is None:
        if part in ("", model.name):
            return model
        raise unknown_name("part", part, [model.name])
    for name, one in parts.items():
        if part == name and not hasattr(one, "parts"):
            return one
        if part.startswith(f"{name}."):
            return part_of(one, part.removeprefix(f"{name}."))
    raise unknown_name(f"part of {model.name!r}", part, parts)


def _behind(model: Substructure) -> Substructure | None:
    """The full system that was reduced as a whole to this model, as long as it exists: only the full system knows the parts."""
    wider = getattr(model, "wider", None)
    found: Any = None if wider is None else wider.full()
    return found if hasattr(found, "parts") and found.size == len(model.V) else None  # type: ignore[attr-defined]


def full_dofs(model: Substructure, part: str = "") -> DofMap | None:
    """The DOF map of the full part, also if the part is reduced."""
    found = part_of(model, part)
    return found.full_dofs if isinstance(found, ReducedSubstructure) else found.dofs


def displacements(model: Substructure, rows: Array, part: str = "") -> Matrix:
    """U (t, n): these DOF of the full part in the model's coordinates. For a reduced part of a system U = V[rows] L."""
    found = part_of(model, part)
    if part not in ("", model.name) and (whole := _behind(model)) is not None:
        return displacements(whole, rows, part) @ model.V  # type: ignore[attr-defined]
    V = getattr(found, "V", None)
    count = found.size if V is None else len(V)
    if len(rows) and not 0 <= rows.min() <= rows.max() < count:
        raise InputError(f"DOF {rows.max() if rows.max() >= count else rows.min()} is out of range: {found.name!r} has {count} "
                         f"DOF, counted from 0 to {count - 1}")
    if V is None:
        return sp.csr_array(sp.eye_array(count, format="csr")[rows]) if found is model else _coordinates(model, part, rows)
    return V[rows] if found is model else V[rows] @ _coordinates(model, part)


def _coordinates(model: Substructure, part: str, rows: Array | slice = slice(None)) -> Matrix:
    """The rows of L, (n_p, n), that give a part's coordinates, or some of them, from the model's coordinates."""
    start = 0
    for name, one in getattr(model, "parts", {}).items():
        if part == name:
            own = start + np.arange(one.size)[rows]
            return model.L[own] if len(own) < model.L.shape[0] else model.L  # type: ignore[attr-defined]
        if part.startswith(f"{name}."):
            return _coordinates(one, part.removeprefix(f"{name}."), rows) @ model.L[start:start + one.size]  # type: ignore[attr-defined]
        start += one.size
    part_of(model, part)
    return sp.eye_array(model.size, format="csr")[rows]


def end_motions(model: Substructure, at: Any, directions: Sequence[str] | None = None
                ) -> tuple[Matrix, Array, Sequence[str] | None]:
    """U (t, n) of the motions of an end, their shares (t,), and their names; None if the names are not known, as at ports.

    The share is 1 over the number of nodes, in each direction; 1 for a port.
    """
    if isinstance(at, str) and at in model.ports:
        W = model.port(at).reshape(model.size, -1)
        return sp.csr_array(W.T) if sp.issparse(model.K) else W.T, np.ones(W.shape[1]), None
    labels: Sequence[str] | None
    if isinstance(at, str):
        if at not in model.sets:
            raise unknown_name(f"port or interface set of {model.name!r}", at, (*model.ports, *model.sets))
        places, dofs = model.sets[at], model.interface_dofs
        U = model.interface_rows[places]
        labels = None if dofs is None else [dofs.labels[k] for k in dofs.components[places]]
    else:
        part, rows = ("", at) if not (isinstance(at, (tuple, list)) and len(at) == 2 and isinstance(at[0], str)) else at
        if isinstance(rows, str):
            return end_motions(model, f"{part}.{rows}", directions)
        rows = whole_numbers("the DOF of a change", rows)
        if not len(rows) or len(np.unique(rows)) < len(rows):
            raise InputError(f"the DOF of a change must be one or more, each listed once, but are {shown(rows.tolist())}")
        U, dofs = displacements(model, rows, part), full_dofs(model, part)
        labels = None if dofs is None else [dofs.labels[k] for k in dofs.components[rows]]
    if labels is None:
        if directions is not None:
            raise InputError(f"directions need a DOF map, which {model.name!r} does not have. List the DOF instead")
        return U, np.full(U.shape[0], 1 / U.shape[0]), None
    if directions is not None and (unknown := [one for one in directions if one not in labels]):
        raise unknown_name("direction", unknown[0], sorted(set(labels)))
    # rotations and slopes have another unit than translations
    plain = [label for label in labels if label not in MOTIONS[3:] and "," not in label]
    wanted = set(plain or labels) if directions is None else set(directions)
    kept = np.array([at for at, label in enumerate(labels) if label in wanted])
    names = np.array(labels)[kept]
    shares = np.array([1 / np.count_nonzero(names == label) for label in names])
    return U if len(kept) == len(labels) else U[kept], shares, names.tolist()


def _title(end: Any) -> str:
    return end if isinstance(end, str) else shown(end)
