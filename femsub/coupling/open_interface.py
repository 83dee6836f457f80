"""Where a system can be joined further: which DOF of the parts, in which sets, and how they are read from its coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra import product
from femsub.checks import Array, Matrix, items
from femsub.coupling.joined import rows_of_parts
from femsub.coupling.joints import End, Link, site
from femsub.model import Substructure

SAME = 1e-9  # of a row of the interface that two rows may differ by which are the motion of one DOF


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
    chosen = {}
    for name, part in parts.items():
        left = np.ones(len(part.interface_numbers), dtype=bool)
        for link in links:
            if name in link.equations:
                left[sp.csr_array(link.equations[name]).indices] = False
        for places in part.sets.values():  # a corner that two edges share stays open with the edge that is not joined
            if left[places].any():
                left[places] = True
        chosen[name] = np.flatnonzero(left)
    return chosen


def listed(parts: Mapping[str, Substructure], ends: Sequence[End]) -> dict[str, Array]:
    chosen: dict[str, list[int]] = {name: [] for name in parts}
    for end in items("interface", ends, "ends, as [('disc', 'left')]"):
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
    close = alike & (np.abs(value[other] - value[one]) <= SAME) & (np.abs(size[other] - size[one]) <= SAME * size[one])
    one, other = one[close], other[close]
    same = abs(B[one] - B[other]).max(axis=1).toarray().ravel() <= SAME if len(one) else np.zeros(0, dtype=bool)
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
