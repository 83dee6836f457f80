"""What parts and joints say together: checked, on the coordinates of all parts, and where a system can be joined further."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra import SINGULAR, Equations, block_diagonal, comparable, product, recovered, units
from femsub.checks import EQUAL, Array, Matrix, instance, items, mapping, naming, word
from femsub.coupling.dual import interface_forces
from femsub.coupling.joints import End, Joint, Link, site
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
    for what, table in (("equations", link.equations), ("motions", link.motions)):
        sizes = {matrix.shape[0] for matrix in table.values()}
        for part, matrix in table.items():
            width = len(parts[part].interface_numbers) if what == "equations" else parts[part].size
            if matrix.shape[1] != width or len(sizes) > 1:
                raise InputError(f"{joint!r}: its {what} of {part!r} must have {width} columns and as many rows as those of the "
                                 f"other parts, but are {matrix.shape}")
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


def on_all_parts(tables: Sequence[Mapping[str, Matrix]], widths: Mapping[str, int]) -> Matrix:
    """The matrices of joints on some parts each, below each other for the coordinates of all parts: sparse, (m, Σ widths)."""
    ends = np.cumsum([0, *widths.values()])
    whole = sp.eye_array(ends[-1], format="csr")
    picked = {name: whole[a:b] for name, (a, b) in zip(widths, pairwise(ends), strict=True)}
    blocks = [sum(sp.csr_array(matrix) @ picked[name] for name, matrix in table.items()) for table in tables]
    return sp.csr_array(sp.vstack([sp.csr_array((0, ends[-1])), *blocks]))


def conditions(parts: Mapping[str, Substructure], links: Sequence[Link]) -> tuple[Matrix, Array]:
    """C (m, Σ n_b) with C u_b = 0 of all joints below each other, for the interfaces of all parts; and the joint of each row."""
    widths = {name: len(part.interface_numbers) for name, part in parts.items()}
    found = {number: link.equations for number, link in enumerate(links) if link.equations}
    owner = np.repeat(np.array([*found], dtype=int), np.array([_count(table) for table in found.values()], dtype=int))
    return on_all_parts([*found.values()], widths), owner


def _count(table: Mapping[str, Matrix]) -> int:
    """How many equations or motions a joint has."""
    return int(next(iter(table.values())).shape[0])


def equations_of(parts: Mapping[str, Substructure], C: Matrix, owner: Array) -> Equations:
    """Σ_p C_p B_p q_p = 0 of `conditions`, on the coordinates of all parts."""
    A = sp.csr_array(C @ block_diagonal([part.interface_rows for part in parts.values()]))
    A.sort_indices()
    physical = [np.isin(np.arange(part.size), part.interface) for part in parts.values()]
    return Equations(A, comparable(units_of_energy(parts)), np.concatenate(physical), owner)


def with_interfaces(parts: Mapping[str, Substructure], C: Matrix, given: Equations) -> tuple[Matrix, Equations]:
    """q = T z, sparse, and the `given` equations C u_b = 0 in z, which has joined interface displacements among its coordinates.

    Where an interface is spread over generalised coordinates (Craig-Chang), its displacements take the place of as many of these
    if they are independent. Else equations between such parts would couple all coordinates of all parts in a row.
    """
    turns, rows, kinds, start = [], [], [], 0
    used = np.bincount(C.indices, minlength=C.shape[1]) > 0
    for part, at in zip(parts.values(), rows_of_parts(parts), strict=True):
        B, physical = sp.csr_array(part.interface_rows), given.physical[at]
        joined = np.flatnonzero(used[start:start + B.shape[0]])
        start += B.shape[0]
        T, places = None, joined
        if len(joined):
            # units of energy at the part's lowest ω², at which its displacements cost next to nothing but strain
            mass, stiffness = np.abs(part.M.diagonal()), np.abs(part.K.diagonal())
            square = np.divide(stiffness, mass, out=np.zeros(len(mass)), where=mass > 0)
            square = square[square > SINGULAR * square.max(initial=0.0)]  # less is the stiffness that rounding gives rigid motion
            energy = stiffness + float(square.min() if len(square) else 1.0) * mass
            T, places = recovered(B[joined], comparable(np.where(energy > 0, energy, 1.0) ** -0.5))
        if T is not None:
            B = sp.csr_array((np.ones(len(places)), (joined, places)), shape=B.shape)
            physical = (np.diff(sp.csc_array(T).indptr) == 1) & (T.T @ physical.astype(float) > 0)
            physical[places] = True
        turns.append(sp.eye_array(part.size) if T is None else T)
        rows.append(B)
        kinds.append(physical)
    T = block_diagonal(turns)
    unit = (T.multiply(T).T @ given.unit[:, None] ** -2.0).ravel() ** -0.5
    A = sp.csr_array(C @ block_diagonal(rows))
    A.sort_indices()
    return T, Equations(A, unit, np.concatenate(kinds), given.owner)


def forces_on_parts(parts: Mapping[str, Substructure], unit: Array) -> tuple[Matrix, Array]:
    """A (N, Σ n_b), sparse: what forces at all interfaces do in parts that are reduced by such forces; and the square of how far
    their DOF move at unit energy of such a part, shape (Σ n_b,).
    """
    places, compliance = [], []
    for part, rows in zip(parts.values(), rows_of_parts(parts), strict=True):
        place = interface_forces(part)
        places.append(place)
        squares = np.zeros(place.shape[1])
        if place.nnz:
            others = np.diff(place.indptr) == 0
            squares = np.asarray(part.interface_rows)[:, others] ** 2 @ unit[rows][others] ** 2  # modes may not move a DOF at all
            squares += np.einsum("ij,ij->j", place.toarray(), part.K @ place.toarray())
        compliance.append(squares)
    return sp.csr_array(block_diagonal(places)), np.concatenate(compliance)


def springs_of(parts: Mapping[str, Substructure], links: Sequence[Link]) -> list[tuple[Matrix, Link]]:
    """R (s, N) of each joint with springs or dampers, on the coordinates of all parts: they act on the motion R q."""
    widths = {name: part.size for name, part in parts.items()}
    return [(on_all_parts([link.motions], widths), link) for link in links if link.motions]


def sprung(parts: Mapping[str, Substructure], links: Sequence[Link]) -> Array:
    """Which coordinates of the parts springs move, shape (N,)."""
    found = np.zeros(sum(part.size for part in parts.values()), dtype=bool)
    for R, _ in springs_of(parts, links):
        found[R.indices] = True
    return found


def open_rows(parts: Mapping[str, Substructure], L: Matrix, open_: Mapping[str, Array]) -> Matrix:
    """B_p L_p of the open places of all parts below each other, sparse, shape (n_b, n)."""
    found = [sp.csr_array((0, L.shape[1]))]
    for (name, part), rows in zip(parts.items(), rows_of_parts(parts), strict=True):
        places = open_.get(name, ())
        if len(places):
            found.append(sp.csr_array(product(sp.csr_array(part.interface_rows)[places], sp.csr_array(L[rows]))))
    B = sp.csr_array(sp.vstack(found))
    B.eliminate_zeros()
    B.sort_indices()
    return B


def unjoined(parts: Mapping[str, Substructure], links: Sequence[Link]) -> dict[str, Array]:
    """The places of each part's interface that no equation touches; of a set that has some of these all."""
    left_of = {name: np.ones(len(part.interface_numbers), dtype=bool) for name, part in parts.items()}
    for link in links:
        for name, matrix in link.equations.items():
            left_of[name][sp.csr_array(matrix).indices] = False
    chosen = {}
    for name, part in parts.items():
        left = left_of[name]
        for places in part.sets.values():  # a corner that two edges share stays open with the edge that is not joined
            if left[places].any():
                left[places] = True
        chosen[name] = np.flatnonzero(left)
    return chosen


def listed(parts: Mapping[str, Substructure], ends: Sequence[End]) -> dict[str, Array]:
    chosen: dict[str, list[int]] = {name: [] for name in parts}
    for end in items("interface", ends, "ends, as [('disc', 'left')]"):
        with naming("interface"):
            found = site(parts, end)
        chosen[found.part] += found.places.tolist()
    return {name: np.array(list(dict.fromkeys(places)), dtype=np.intp) for name, places in chosen.items()}


def distinct(parts: Mapping[str, Substructure], chosen: Mapping[str, Array], L: Matrix,
              unit: Array) -> tuple[dict[str, Array], dict[str, Array]]:
    """The chosen places without those that are held, or equal to an earlier one; and, for every place in the interface of a
    part, its place in that of the system (-1: none).

    Within one part only equal coordinates count: shapes of a reduced part may move two DOF alike by chance.
    """
    B = sp.csr_array(open_rows(parts, L, chosen) @ sp.diags_array(unit))
    size = np.sqrt(B.multiply(B).sum(axis=1))
    moving = size > 0
    B = sp.csr_array(sp.diags_array(1 / np.where(moving, size, 1.0)) @ B)
    # equal rows have equal values in any direction
    value = B @ np.random.default_rng(3).standard_normal(B.shape[1])
    order = np.argsort(np.where(moving, value, np.inf), kind="stable")[:int(moving.sum())]
    one, other = order[:-1], order[1:]
    owner = np.repeat(np.arange(len(parts)), [len(chosen[name]) for name in parts])
    alike = (owner[one] != owner[other]) | (np.diff(B.indptr)[one] == 1)
    close = alike & (np.abs(value[other] - value[one]) <= EQUAL) & (np.abs(size[other] - size[one]) <= EQUAL * size[one])
    one, other = one[close], other[close]
    same = abs(B[one] - B[other]).max(axis=1).toarray().ravel() <= EQUAL if len(one) else np.zeros(0, dtype=bool)
    graph = sp.csr_array((np.ones(int(same.sum())), (one[same], other[same])), shape=(B.shape[0],) * 2)
    first = np.zeros(0, dtype=np.intp)
    if B.shape[0]:
        _, leader, group = np.unique(connected_components(graph, directed=False)[1], return_index=True, return_inverse=True)
        first = leader[group]
    keep = moving & (first == np.arange(B.shape[0]))
    number = np.where(moving, (np.cumsum(keep) - 1)[first], -1)
    open_, place, start = {}, {}, 0
    for name, part in parts.items():
        places = chosen[name]
        rows = slice(start, start + len(places))
        start += len(places)
        open_[name] = places[keep[rows]]
        place[name] = np.full(len(part.interface_numbers), -1)
        place[name][places] = number[rows]
    return open_, place


def whole_sets(parts: Mapping[str, Substructure], place: Mapping[str, Array]) -> dict[str, Array]:
    """The sets of the parts, 'disc.left', that are whole in the interface of the system."""
    found = {}
    for name, part in parts.items():
        for key, places in part.sets.items():
            at = np.array(list(dict.fromkeys(place[name][places].tolist())), dtype=np.intp)  # DOF may have become one
            if len(at) and (at >= 0).all():
                found[f"{name}.{key}"] = at
    return found
