"""What parts and joints say together: checked, and as equations on the coordinates of all parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import Equations, block_diagonal, units
from femsub.checks import Array, Matrix, instance, mapping, word
from femsub.coupling.dual import FORCE, by_forces
from femsub.coupling.joints import Joint, Link
from femsub.errors import InputError, InputTypeError
from femsub.model import Substructure


def checked_parts(parts: Any) -> dict[str, Substructure]:
    found = dict(mapping("parts", parts, "names and substructures, as {'disc': rom, 'pad': full}"))
    if not found:
        raise InputError("parts is empty: name at least one")
    for name, part in found.items():
        if not word("the name of a part", name) or "." in name:
            raise InputError(f"a part's name must be a word without a dot, since ports are named 'part.port', not {name!r}")
        instance(f"the part {name!r}", part, Substructure)
    return found


def linked(joint: Joint, parts: Mapping[str, Substructure]) -> Link:
    """What a joint says, with its name in the message where it cannot say it, and its sizes checked."""
    try:
        link = instance("what a joint's link returns", joint.link(parts), Link)
    except (InputError, InputTypeError) as error:
        raise type(error)(f"{joint!r}: {error}") from None
    for what, table, widths in (("equations", link.equations, {name: len(sub.interface_numbers) for name, sub in parts.items()}),
                                ("motions", link.motions, {name: sub.size for name, sub in parts.items()})):
        sizes = {matrix.shape[0] for matrix in table.values()}
        for part, matrix in table.items():
            if matrix.shape[1] != widths[part] or len(sizes) > 1:
                raise InputError(f"{joint!r}: its {what} of {part!r} must have {widths[part]} columns and as many rows as those "
                                 f"of the other parts, but are {matrix.shape}")
    return link


def check_connected(parts: Mapping[str, Substructure], links: Sequence[Link]) -> None:
    """All parts hang together, by joints or by the ground."""
    names, ground = list(parts), "."  # the ground is one more, whose name no part can have
    groups = [{name} for name in (*names, ground)]
    for link in links:
        members = {*link.equations, *link.motions, *([ground] if link.grounded else [])}
        touched = [group for group in groups if group & members]
        groups = [group for group in groups if not group & members] + [set().union(*touched)]
    first = next(group for group in groups if names[0] in group)
    apart = [name for name in names if name not in first]
    if apart and (alone := [name for name in names if {name} in groups]):
        raise InputError(f"the part {alone[0]!r} is joined to nothing: give a joint that names it, or leave it out")
    if apart:
        raise InputError(f"no joints lead from {names[0]!r} to {', '.join(map(repr, apart))}: these are systems of their own")


def rows_of_parts(parts: Mapping[str, Substructure]) -> list[slice]:
    """The rows of each part's coordinates in q."""
    ends = np.cumsum([0, *(part.size for part in parts.values())])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def units_of_energy(parts: Mapping[str, Substructure]) -> Array:
    """How far each coordinate moves at unit energy: (k_jj + ω² m_jj)^(-1/2) with a typical ω of all parts."""
    K = np.concatenate([np.abs(part.K.diagonal()) for part in parts.values()])
    M = np.concatenate([np.abs(part.M.diagonal()) for part in parts.values()])
    return units(M, K)[0]


def on_all_parts(table: Mapping[str, Matrix], widths: Mapping[str, int]) -> Matrix:
    """The matrices of a joint on some parts, in one for the coordinates of all parts, sparse, shape (m, Σ widths)."""
    rows = next(iter(table.values())).shape[0]
    return sp.csr_array(sp.hstack([sp.csr_array(table.get(name, (rows, width))) for name, width in widths.items()]))


def conditions(parts: Mapping[str, Substructure], links: Sequence[Link]) -> tuple[Matrix, Array]:
    """C (m, Σ n_b) with C u_b = 0 of all joints below each other, for the interfaces of all parts; and the joint of each row."""
    widths = {name: len(part.interface_numbers) for name, part in parts.items()}
    found = {number: on_all_parts(link.equations, widths) for number, link in enumerate(links) if link.equations}
    owner = np.repeat(np.array([*found], dtype=int), np.array([C.shape[0] for C in found.values()], dtype=int))
    none = sp.csr_array((0, sum(widths.values())))
    return sp.csr_array(sp.vstack([none, *found.values()])), owner


def equations_of(parts: Mapping[str, Substructure], C: Matrix, owner: Array) -> Equations:
    """Σ_p C_p B_p q_p = 0 of `conditions`, on the coordinates of all parts."""
    A = sp.csr_array(C @ block_diagonal([part.interface_rows for part in parts.values()]))
    A.sort_indices()
    physical = [np.isin(np.arange(part.size), part.interface) for part in parts.values()]
    return Equations(A, units_of_energy(parts), np.concatenate(physical), owner)


def joint_forces(parts: Mapping[str, Substructure], C: Matrix, unit: Array) -> tuple[Matrix, Array]:
    """Of the parts that are reduced by interface forces g: -Cᵀ of `conditions` in the rows of g, sparse, shape (N, m); and, for
    each g, the square of how far its DOF moves at unit energy of the part, shape (N,).
    """
    compliance, places = np.zeros(len(unit)), []
    for part, rows in zip(parts.values(), rows_of_parts(parts), strict=True):
        place = sp.csr_array((part.size, len(part.interface_numbers)))
        if by_forces(part):
            force = np.array(part.kinds) == FORCE  # type: ignore[attr-defined]
            place = sp.eye_array(part.size, format="csr")[:, np.flatnonzero(force)]
            moved = np.asarray(part.interface_rows)[:, ~force] ** 2 @ unit[rows][~force] ** 2
            compliance[rows] = place @ (moved + part.K.diagonal()[force])  # modes may not move a DOF at all
        places.append(place)
    return sp.csr_array(block_diagonal(places) @ -C.T), compliance


def springs_of(parts: Mapping[str, Substructure], links: Sequence[Link]) -> list[tuple[Matrix, Link]]:
    """R (s, N) of each joint with springs or dampers, on the coordinates of all parts: they act on the motion R q."""
    widths = {name: part.size for name, part in parts.items()}
    return [(on_all_parts(link.motions, widths), link) for link in links if link.motions]


def sprung(parts: Mapping[str, Substructure], links: Sequence[Link]) -> Array:
    """Which coordinates of the parts springs move, shape (N,)."""
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for R, _ in springs_of(parts, links):
        found[R.indices] = True
    return found
