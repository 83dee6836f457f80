"""What parts and joints say together: checked, and as equations on the coordinates of all parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra import Equations, units
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
    if len(parts) == 1:
        return
    names = list(parts)
    pairs = [(names[0], names[0])]
    for link in links:
        members = [*link.equations, *link.motions, *(["."] if link.grounded else [])]
        pairs += [(members[0], other) for other in members]
    number = {name: at for at, name in enumerate((*names, "."))}  # the ground is one more, whose name no part can have
    table = np.array([[number[one], number[other]] for one, other in pairs])
    graph = sp.csr_array((np.ones(len(table)), (table[:, 0], table[:, 1])), shape=(len(number), len(number)))
    group = connected_components(graph, directed=False)[1]
    alone = [name for name, own in zip(names, group, strict=False) if np.count_nonzero(group == own) == 1]
    if alone:
        raise InputError(f"the part {alone[0]!r} is joined to nothing: give a joint that names it, or leave it out")
    apart = [name for name, own in zip(names, group, strict=False) if own != group[0]]
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


def physical_coordinates(parts: Mapping[str, Substructure]) -> Array:
    """Which coordinates are displacements of interface DOF."""
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for part, rows in zip(parts.values(), rows_of_parts(parts), strict=True):
        found[rows.start + part.interface] = True
    return found


def equations_of(parts: Mapping[str, Substructure], links: Sequence[Link], unit: Array, physical: Array) -> Equations:
    """Σ_p C_p B_p q_p = 0 of all joints below each other."""
    rows = dict(zip(parts, rows_of_parts(parts), strict=True))
    blocks, owner = [], []
    interfaces = {name: sp.csr_array(part.interface_rows) for name, part in parts.items()}
    for number, link in enumerate(links):
        if link.equations:
            block = sum(sp.csr_array(_spread(sp.csr_array(C) @ interfaces[part], rows[part].start, len(unit)))
                        for part, C in link.equations.items())
            blocks.append(block)
            owner.append(np.full(block.shape[0], number))
    A = sp.csr_array(sp.vstack(blocks)) if blocks else sp.csr_array((0, len(unit)))
    return Equations(A, unit, physical, np.concatenate([np.zeros(0, dtype=int), *owner]))


def _spread(C: Matrix, start: int, size: int) -> Matrix:
    """The columns of a sparse C from a place on among `size`."""
    return sp.csr_array((C.data, C.indices + start, C.indptr), shape=(C.shape[0], size))


def joint_forces(parts: Mapping[str, Substructure], links: Sequence[Link], weak: Sequence[bool],
                 unit: Array) -> tuple[Matrix, Array]:
    """Of the parts that are reduced by interface forces g: -C_pᵀ in the rows of g, sparse, shape (N, m), of all weak joints; and,
    for each g, the square of how far its DOF moves at unit energy of the part, shape (N,).
    """
    size, compliance = len(unit), np.zeros(len(unit))
    at = {}
    for (name, part), rows in zip(parts.items(), rows_of_parts(parts), strict=True):
        if by_forces(part):
            force = np.array(part.kinds) == FORCE  # type: ignore[attr-defined]
            at[name] = rows.start + np.flatnonzero(force)
            compliance[at[name]] = (np.asarray(part.interface_rows)[:, ~force] ** 2 @ unit[rows][~force] ** 2
                                    + part.K.diagonal()[force])  # modes may not move a DOF at all
    columns = [sp.csr_array((size, 0))]
    for link in (link for link, held in zip(links, weak, strict=True) if held):
        column = sp.csr_array((size, next(iter(link.equations.values())).shape[0]))
        for name in at.keys() & link.equations.keys():
            C = sp.coo_array(link.equations[name])
            column = column + sp.csr_array((-C.data, (at[name][C.col], C.row)), shape=column.shape)
        columns.append(column)
    return sp.csr_array(sp.hstack(columns)), compliance


def sprung(parts: Mapping[str, Substructure], links: Sequence[Link]) -> Array:
    """Which coordinates of the parts springs move, shape (N,)."""
    rows = dict(zip(parts, rows_of_parts(parts), strict=True))
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for link in links:
        for name, R in link.motions.items():
            found[rows[name].start + sp.coo_array(R).col] = True
    return found
