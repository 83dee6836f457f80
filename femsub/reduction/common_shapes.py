"""Interface modes part by part: parts that meet get the shapes of both, so that they can be joined again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from femsub.algebra import congruent
from femsub.checks import Array, Matrix
from femsub.coupling import System, rows_of_parts, units_of_energy
from femsub.errors import InputError
from femsub.model import ReducedSubstructure, Substructure
from femsub.modes import ShiftInvert, units
from femsub.reduction.interface_modes import INSIDE, KIND, InterfaceModes

ALIKE = 1e-6  # of a shape on the interface between parts: where others contain it but for less it is no shape of its own
EXACT = 1e-12  # the same for rigid motion, of which nothing may be lost: a floating system would be held by it


def with_common_shapes(system: System, models: Mapping[str, ReducedSubstructure]) -> dict[str, ReducedSubstructure]:
    """Parts whose interfaces were reduced one by one, with common shapes where they meet, so that they can be joined again.

    Coordinates of the system that the same parts move are one group, as those of an edge. In each group every part gets the
    shapes of all the parts that meet there. If one part alone was reduced nothing changes: its neighbours have their whole
    interface, and follow it.

    References
    ----------
    S.-K. Hong, B. I. Epureanu, M. P. Castanier, Mech. Syst. Signal Process. 37 (2013) 403; Krattiger et al. 2019 (local level
    with exact compatibility).
    """
    own = {name: model for name, model in models.items() if KIND in model.kinds}
    if len(own) < 2:
        return dict(models)
    if system.multipliers:
        raise InputError(f"{system.name!r} has joints by multipliers (Dual Craig-Bampton parts, or dual assembly), where parts "
                         "need not move alike. Reduce the interface of the whole system, as reduce(system, InterfaceModes(20))")
    unit, whole = units_of_energy({"": system}), ShiftInvert(system.K, system.M, carried=system.rigid_motion).rigid
    motion: dict[str, Matrix] = {}
    shapes: list[Array] = []
    member = np.zeros((system.size, len(own)), dtype=bool)
    for name, rows in zip(system.parts, rows_of_parts(system.parts), strict=True):
        if name in own:
            B = (sp.csr_array(system.parts[name].interface_rows) @ sp.csr_array(system.L[rows])).tocsc()
            at = np.flatnonzero(np.diff(B.indptr))
            member[at, len(shapes)], motion[name] = True, B
            B = B[:, at] @ sp.diags_array(unit[at])
            found = np.zeros((system.size, own[name].size))  # in units of energy
            inverse = B.power(-1).T if B.nnz == len(at) == B.shape[0] else np.linalg.pinv(B.toarray())
            found[at] = inverse @ own[name].interface_rows
            shapes.append(found)
    signature = np.unique(member, axis=0, return_inverse=True)[1]
    blocks: list[tuple[Array, Array, Array]] = []
    for group in (np.flatnonzero(signature == one) for one in np.unique(signature[member.any(axis=1)])):
        meets, size = member[group[0]], unit[group, None]
        met = np.hstack([found[group] for found, one in zip(shapes, meets, strict=True) if one])
        blocks.append((group, meets, size * _orthonormal((whole[group] / size, EXACT), (met, ALIKE))))
    return dict(models) | {name: _in_shapes(
        system.parts[name], model, np.hstack([motion[name][:, group] @ block for group, meets, block in blocks if meets[at]]),
        motion[name] @ whole) for at, (name, model) in enumerate((name, own[name]) for name in motion)}


def _orthonormal(*stages: tuple[Array, float]) -> Array:
    """Orthonormal columns that span the columns (n, k) of each stage, but for shares below its limit beside earlier stages."""
    basis = np.zeros((len(stages[0][0]), 0))
    for columns, least in stages:
        found = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        for _ in range(2):
            found = found - basis @ (basis.T @ found)
        U, share, _ = np.linalg.svd(found, full_matrices=False)
        basis = np.hstack([basis, U[:, share > least]])
    return basis


def _in_shapes(part: Substructure, model: ReducedSubstructure, shapes: Array, rigid: Array) -> ReducedSubstructure:
    """The model with given shapes of the interface (n_b, k) and `rigid` motions (n_b, r) in place of its own."""
    turned = InterfaceModes(0).part(part)
    sub, i, b = turned.sub, turned.sub.interface, part.interface
    if part.size - len(i) != len(b):
        raise InputError(f"{part.name!r} is a system of its own, whose inner joints would lose their motion; reduce the "
                         "interface of the whole system instead")
    unit = units(sub.K)[b, None]
    Q = _orthonormal((rigid / unit, EXACT), (shapes / unit, EXACT))
    T = np.zeros((part.size, len(i) + Q.shape[1]))
    T[i, np.arange(len(i))] = 1.0
    T[b, len(i):] = unit * Q
    V = T if turned.turn is None else turned.turn @ T
    M, D, K = (congruent(A.toarray(), T) for A in (sub.M, sub.D, sub.K))
    found = replace(model, M=M, D=D, K=K, V=V, ports={name: V.T @ w for name, w in part.ports.items()},
                    kinds=(INSIDE,) * len(i) + (KIND,) * Q.shape[1], modes=Q.shape[1],
                    method=f"{Q.shape[1]} interface shapes", full_interface=b, full_dofs=part.dofs, estimate=None)
    return InterfaceModes(0).finished(part, found)
