"""Families of modes that grow: modes of the same shape at neighbouring values of the parameters belong together.

The places are taken in the order in which each is nearest to a place that was taken before (Prim's tree). The modes of a place
are matched one to one with the families by λ and MAC; a family is represented by its mode at the nearest place. A mode that
matches no family begins a new one. So a family is continuous, though its shape may change over the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Array

if TYPE_CHECKING:
    from femsub.stability.labels import SeenMode


def grouped(nodes: Sequence[SeenMode], scale: Array, least: float = 0.5) -> Array:
    """The number of the family of each node, from 0 on.

    Parameters
    ----------
    nodes : sequence of SeenMode
    scale : ndarray, shape (q,)
        Units of the parameters for the distances between places.
    least : float
        The smallest MAC with which a mode may belong to a family.
    """
    from scipy.optimize import linear_sum_assignment

    family = np.full(len(nodes), -1)
    if not nodes:
        return family
    places, at = np.unique([node.place for node in nodes], axis=0, return_inverse=True)
    at, places = at.ravel(), places / scale
    of_place = [np.flatnonzero(at == k) for k in range(len(places))]
    values = np.array([node.value for node in nodes])
    order, far = [0], np.linalg.norm(places - places[0], axis=1)
    far[0] = np.inf
    while len(order) < len(places):
        k = int(far.argmin())
        order.append(k)
        far = np.where(np.isin(np.arange(len(places)), order), np.inf,
                       np.minimum(far, np.linalg.norm(places - places[k], axis=1)))
    count = 0
    for k in order:
        mine = of_place[k]
        away = np.linalg.norm(places[at] - places[k], axis=1)
        nearest = [known[away[known].argmin()] for f in range(count) if len(known := np.flatnonzero(family == f))]
        if nearest:
            mac = np.abs([[nodes[i].x.conj() @ nodes[j].Mx for j in nearest] for i in mine]) ** 2
            size = np.maximum(np.abs(values[mine, None]), np.finfo(float).tiny)  # λ may be 0 of a motion without stiffness
            moved = np.abs(values[mine, None] - values[nearest]) / size
            rows, columns = linear_sum_assignment(np.where(mac >= least, 1 - mac + np.minimum(moved, 1.0), 10.0))
            for row, column in zip(rows, columns, strict=True):
                if mac[row, column] >= least:
                    family[mine[row]] = column
        for i in mine[family[mine] < 0]:
            family[i], count = count, count + 1
    return family
