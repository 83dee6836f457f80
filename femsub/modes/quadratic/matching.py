"""Two spectra side by side: eigenvalues are matched by distance and by shape, never by position.

Within one model: equal and almost equal eigenvalues, duplicates, several searches. Between two models: eigenvalues that only one
of them has, and differences of eigenvalues, of undamped frequencies with the interface free and fixed, and of joint forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import SMALL, unit_length
from femsub.checks import EPS, EQUAL, Array, Matrix
from femsub.coupling import Rigid, System, couple
from femsub.model import (
    DOUBLE,
    Contacts,
    ReducedSubstructure,
    Substructure,
    contacts_of,
    in_band,
    small_matrices,
    upper,
    within,
)
from femsub.modes.normal_modes import NormalModes, all_modes, normal_modes

if TYPE_CHECKING:
    from femsub.modes.normal_modes import NormalModes
    from femsub.modes.quadratic.complex_modes import ComplexModes

HALF = EPS**0.5  # half of the digits: results with fewer are poor, and eigenvalues closer than this count as one
#: Two results for one eigenvalue may differ by this: λ relative to |λ|, and a unit shape by its part outside the span of others.
#: The residual of a search is HALF at worst, and the error of a defective double eigenvalue and its shape is the square root of
#: that.
SPLIT = HALF**0.5
NEAR = 0.5  # |Δλ| / |λ| above which an eigenvalue has no counterpart
CLUSTER = 1e-3  # |Δλ| / |λ| up to which modes are compared as one subspace


def match(reference: Array, values: Array, alike: Array | None = None, *, weight: float = 0.05,
          far: float | None = None) -> tuple[Array, Array]:
    """The one-to-one assignment of two spectra with the least sum of `pair_costs`: indices into both."""
    return assigned(pair_costs(reference, values, alike, weight=weight, far=far))


def pair_costs(reference: Array, values: Array, alike: Array | None = None, *, weight: float = 0.05,
               far: float | None = None) -> Array:
    """|Δλ| + weight |λ| (1 - MAC); with `far` min(|Δλ| / |λ|, far) + weight (1 - MAC), shape (k, l).

    `far` limits the cost of an eigenvalue without a counterpart, so that it does not change the assignment of others.

    Parameters
    ----------
    reference, values : ndarray, shapes (k,) and (l,)
    alike : ndarray, shape (k, l), optional
        The MAC of the shapes, which decides between close frequencies; NaN means no cost.
    weight : float
        |Δλ| / |λ| that costs as much as a MAC of 0. By default the distance over which modes change places between two models.
    far : float, optional
        The largest |Δλ| / |λ| that counts.
    """
    cost, size = np.abs(reference[:, None] - values), np.abs(reference)[:, None]
    if far is not None:
        cost = np.divide(cost, size, out=np.where(cost > 0, far, 0.0), where=size > 0)
        cost, size = np.minimum(cost, far), np.ones(1)
    return cost if alike is None else cost + weight * size * np.nan_to_num(1 - alike)


def assigned(cost: Array) -> tuple[Array, Array]:
    """Rows and columns of the one-to-one assignment with the least sum of costs."""
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(cost)


def distinct(values: Array, X: Array) -> tuple[Array, Array]:
    """λ (k,) and X (n, k) without duplicates, that is without eigenpairs whose eigenvalue and shape are already listed.

    A duplicate could hide a missing eigenvalue when numbers are compared. Rounding may turn two equal real eigenvalues into a
    conjugate pair, of which only Im λ > 0 is listed. They become two real eigenvalues again, with the shapes Re x and Im x.
    """
    false = np.flatnonzero((values.imag != 0) & (np.abs(values.imag) <= EQUAL * np.abs(values)))
    parts = (np.column_stack([x.real, x.imag]) for x in unit_length(X[:, false]).T)
    false = false[np.array([la.svdvals(part)[1] > SPLIT for part in parts], dtype=bool)]
    if len(false):
        values, X = np.append(values, values[false].real), np.hstack([X, X[:, false].imag])
        values[false], X[:, false] = values[false].real, X[:, false].real
        X = unit_length(X)
    keep = np.ones(len(values), dtype=bool)
    for group in clusters(values, EQUAL):
        if values[group[0]] == 0:
            continue  # rigid-body motion: its number is known
        R, order = la.qr(unit_length(X[:, group]), mode="r", pivoting=True, check_finite=False)
        small = np.abs(R.diagonal()) <= SPLIT
        keep[group[order[len(small) - np.count_nonzero(small):]]] = False
    return (values, X) if keep.all() else (values[keep], X[:, keep])


def joined(values: Array, X: Array, more: Array, Y: Array) -> tuple[Array, Array]:
    """The eigenpairs (λ, X) of one search together with the new ones of another search, (more, Y).

    A search from one start vector finds one direction of each eigenspace, and others only by rounding. Another start finds
    others. In a known cluster only shapes outside its span are new.
    """
    known = len(values)
    both, new = np.append(values, more), np.ones(len(more), dtype=bool)
    for group in clusters(both, SPLIT):
        old, late = group[group < known], group[group >= known] - known
        if not len(old) or not len(late):
            continue
        if both[group[0]] == 0:
            new[late] = False
            continue
        Q = la.qr(X[:, old], mode="economic", check_finite=False)[0]
        for j in late:
            rest = Y[:, j] / np.linalg.norm(Y[:, j])
            for _ in range(2):
                rest = rest - Q @ (Q.conj().T @ rest)
            length = np.linalg.norm(rest)
            new[j] = length > SPLIT
            if new[j]:
                Q = np.column_stack([Q, rest / length])
    return np.append(values, more[new]), np.hstack([X, Y[:, new]])


def clusters(values: Array, radius: float) -> list[Array]:
    """Clusters of values (k,) connected by relative distances ≤ radius: indices of groups of two or more; zeros are one group."""
    from scipy.spatial import cKDTree

    size = np.abs(values)
    zeros, at = np.flatnonzero(size == 0), np.flatnonzero(size)
    found = [zeros] if len(zeros) > 1 else []
    if len(at) > 1:
        relative = np.stack([np.log(size[at]), np.angle(values[at] + 0.0)], axis=1)  # 0.0: no real λ < 0 has the angle -π
        pairs = cKDTree(relative).query_pairs(radius, output_type="ndarray")
        if not len(pairs):  # of most small models
            return found
        links = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(at), len(at)))
        label = sp.csgraph.connected_components(links, directed=False)[1]
        order = np.argsort(label, kind="stable")
        groups = np.split(at[order], np.flatnonzero(np.diff(label[order])) + 1)
        found += [group for group in groups if len(group) > 1]
    return found


def clear_radius(size: Array, count: int) -> float:
    """A radius at which the first `count` eigenvalues can be counted, given the sizes |λ|, ascending (k,).

    It lies in the widest gap behind them. If there is no gap, because they end inside a cluster, it lies just below the
    cluster. Then no smaller eigenvalue is missing, and any member of the cluster may be listed.
    """
    tail = size[count - 1:]
    if len(tail) > 1 and tail[-1] > 0:
        floor = np.maximum(tail, 1e-3 * tail[-1])
        ratios = floor[1:] / floor[:-1]
        at = int(np.argmax(ratios))
        if ratios[at] > 1 + DOUBLE:
            return float(np.sqrt(floor[at] * floor[at + 1]))
    gaps = np.flatnonzero(np.diff(size[:count]) > DOUBLE * size[1:count])
    return float(size[gaps[-1] + 1 if len(gaps) else 0] * (1 - DOUBLE / 2))


# two models


class SpectrumErrors(NamedTuple):
    """Largest errors of λ and of Re λ over the matched eigenvalues, and how many are not matched, or of another stability.

    `eigenvalue` and `real` are relative to |λ|, `growth` to a scale of its own. `missing` eigenvalues have no counterpart, `mac`
    is the smallest MAC. `missed` modes grow in the full model only, `invented` modes in the reduced model only.
    """

    eigenvalue: float
    growth: float
    missing: int
    mac: float
    real: float
    missed: int
    invented: int


def rows_beside(modes: NormalModes, reference: Sequence[float]) -> list[dict[str, Any]]:
    """The table rows of normal modes; elastic modes have their matching reference frequency and the relative difference."""
    rows, own, theirs = modes.rows(), modes.elastic, np.array(reference, dtype=float)
    for at, to in zip(*match(own, theirs), strict=True) if len(theirs) else ():
        if (difference := abs(float(own[at] / theirs[to] - 1))) <= NEAR:
            rows[modes.rigid + at] |= {"reference": float(theirs[to]), "difference": difference}
    return rows


def angle_between(x: Array, y: Array, M: Matrix) -> float:
    """The sine of the angle between two shapes (n,) in the norm of M: ‖x - y (yᴴMx)/(yᴴMy)‖ / ‖x‖."""
    rest = x - y * (np.vdot(y, M @ x) / np.vdot(y, M @ y))
    return float(np.sqrt(abs(np.vdot(rest, M @ rest)) / abs(np.vdot(x, M @ x))))


def likeness(full: Substructure, model: Substructure, x: Array, y: Array) -> Array:
    """MAC |xᴴM Vy|² / (xᴴMx · yᴴM_r y) of shapes x (n, k) of the full model and y (r, l) of a reduced one, (k, l).

    NaN if the other model has no basis V. The weight M makes it independent of the units of the DOF.
    """
    fields = _fields(full, model, y)
    if fields is None:
        return np.full((x.shape[1], y.shape[1]), np.nan)
    Mx = full.M @ x
    return np.abs(Mx.conj().T @ fields) ** 2 / np.outer(_energy(x, Mx), _energy(fields, full.M @ fields))


def _fields(full: Substructure, model: Substructure, y: Array) -> Array | None:
    if isinstance(full, System) and isinstance(model, System):
        return full.collected(model.expand(y)) if model is not full else y
    if isinstance(model, ReducedSubstructure) and len(model.V) == full.size:
        return model.V @ y
    return y if model.size == full.size else None


def _energy(x: Array, Mx: Array) -> Array:
    return np.einsum("ij,ij->j", x.conj(), Mx).real


def spectrum_errors(full: ComplexModes, reduced: ComplexModes, models: tuple[Substructure, Substructure] | None = None,
                    scale: Array | None = None, band: tuple[float, float] = (0.0, np.inf)) -> SpectrumErrors:
    """Errors over the eigenvalues of the full model with Im λ ≥ 0, without rigid motion.

    The error of Re λ is relative to `scale`, one value per eigenvalue of the full model, such as `turnover`. Without it the
    scale is Re λ itself, which vanishes at the stability border. Differences within the error bars are ignored.

    If the two `models` are given, shapes count as well. They decide between close frequencies. The smallest MAC is
    returned (else NaN), for clusters that of the subspace. Modes of the reduced model that grow count in the `band`.
    """
    ours, theirs = listed(full), listed(reduced)
    reference, x, bars = full.eigenvalues[ours], full.shapes[:, ours], full.error_bar[ours]
    values, y, other = reduced.eigenvalues[theirs], reduced.shapes[:, theirs], reduced.error_bar[theirs]
    lost, grows = reference.real > bars, (values.real > other) & in_band(values, band)
    if len(reference) == 0:
        return SpectrumErrors(0.0, 0.0, 0, 1.0 if models else np.nan, 0.0, 0, int(grows.sum()))
    at, to = match(reference, values, likeness(*models, x, y) if models else None)
    error = np.abs(values[to] - reference[at]) / np.abs(reference[at])
    near = error <= NEAR
    missing = len(reference) - int(near.sum())
    same = near & (reference[at].real > 0) & (values[to].real > 0)
    missed, invented = int(lost.sum() - (lost[at] & same).sum()), int(grows.sum() - (grows[to] & same).sum())
    if not near.any():
        return SpectrumErrors(np.nan, np.nan, missing, np.nan, np.nan, missed, invented)
    size = np.abs(reference.real) if scale is None else np.maximum(scale[ours], np.abs(reference.real))
    growth, noise = np.abs(values[to].real - reference[at].real), np.nan_to_num(bars[at] + other[to], posinf=0.0)
    real = float((growth / np.abs(reference[at]))[near].max())
    size = np.maximum(size[at], noise)
    growth = np.divide(growth, size, out=np.zeros_like(size), where=(size > noise) | (growth > noise))
    # the smallest share of xᴴMx that is represented by the partners of a shape and of its cluster
    mac, fields = np.nan, _fields(*models, y[:, to[near]]) if models else None
    if models and fields is not None:
        M: Matrix = models[0].M
        own, mac = reference[at[near]], 1.0
        for shape, group in zip(x[:, at[near]].T, np.abs(own[:, None] - own) <= CLUSTER * np.abs(own), strict=True):
            Z = fields[:, group]
            MZ = M @ Z
            held = MZ.conj().T @ shape
            represented = held.conj() @ np.linalg.lstsq(Z.conj().T @ MZ, held, rcond=None)[0]
            mac = min(mac, float(represented.real / (shape.conj() @ (M @ shape)).real))
        mac = max(mac, 0.0)
    return SpectrumErrors(float(error[near].max()), float(growth[near].max()), missing, mac, real, missed, invented)


def turnover(model: Substructure, contacts: Contacts, modes: ComplexModes) -> Array:
    """(|xᴴDx| + |xᴴHx| / |λ| + Σ |u|ᵀ(|C_D| + |C_K - C_Kᵀ| / 2|λ|)|u|) / 2xᴴMx, u = Wᵀx: the sum of the rates at which D and H
    dissipate energy and contacts supply it; for a belt F|μ'| |u|².

    For a complex λ of a symmetric pencil, |Re λ| is the difference of these rates, which vanishes at the stability border.
    Without a contact the value is |Re λ|.
    """
    x = modes.shapes
    taken = np.abs(np.einsum("ij,ij->j", x.conj(), model.D @ x).real)
    size = np.maximum(np.abs(modes.eigenvalues), np.finfo(float).tiny)
    if model.H is not None:
        taken = taken + np.abs(np.einsum("ij,ij->j", x.conj(), model.H @ x)) / size
    for contact in contacts_of(contacts):
        W, damping, stiffness = small_matrices(model, contact)
        moved = np.abs(W.T @ x)
        skew = 0.0 if isinstance(stiffness, float) else (stiffness - stiffness.T) / 2
        for C, unit in ((damping, 1.0), (skew, size)):
            if not isinstance(C, float) or C:
                taken = taken + np.einsum("ij,ij->j", moved, abs(C) * moved if isinstance(C, float) else abs(C) @ moved) / unit
    return taken / (2 * np.maximum(_energy(x, model.M @ x), np.finfo(float).tiny))


def listed(modes: ComplexModes) -> Array:
    """Which eigenvalues are compared, bool (k,): Im λ ≥ 0, without rigid-body modes."""
    return np.asarray(~modes.rigid & upper(modes.eigenvalues))


def extra_eigenvalues(full: ComplexModes, reduced: ComplexModes, band: tuple[float, float]) -> int:
    """The number of eigenvalues of a reduced model in the band, below its cut-off, without a match in the full model."""
    shown = listed(reduced)
    reference, values = full.eigenvalues[listed(full)], reduced.eigenvalues[shown]
    counted = ~reduced.above_cutoff[shown] & within(values, band)
    counted[match(reference, values)[1]] = False
    return int(counted.sum())


def frequency_error(full: Array, reduced: Array) -> float:
    """The largest |Δω| / ω over the frequencies of the full model that have a counterpart (0 if there are none)."""
    if not len(full):
        return 0.0
    if not len(reduced):
        return np.nan
    at, to = match(full, reduced)
    error = np.abs(reduced[to] - full[at]) / full[at]
    near = error <= NEAR
    return float(error[near].max()) if near.any() else np.nan


def relative_error(value: float, reference: float) -> float:
    """|value - reference| / |reference|; 0 if both are equal, even if infinite."""
    if value == reference:
        return 0.0
    return float(abs(value - reference) / abs(reference)) if reference else np.nan


def undamped(model: Substructure, band: tuple[float, float] | None = None) -> NormalModes:
    """The undamped modes in a band; all modes if the model is small or no band is given."""
    if band is not None and model.size > SMALL:
        return normal_modes(model, band=band)
    return all_modes(model.K, model.M, carried=model.rigid_motion)


def force_error(full: System, ours: NormalModes, reduced: System, theirs: NormalModes, band: tuple[float, float],
                near: float = 0.5, held: float = 0.5, least: float = 0.1) -> float:
    """The largest error of the joint forces over the undamped elastic modes of the full system in the band.

    max_j (‖g_j - ḡ_j‖ / ω_j) / max_k (‖g_k‖ / ω_k), g of the full system, ḡ of the reduced one. g are the forces on the
    interfaces of all parts in a mode of unit modal mass. The joints carry no load in some modes, such as the symmetric ones of
    two equal parts. So all modes share one scale, which grows with ω. Modes of a cluster are compared as a subspace. NaN if the
    band holds no mode of the full system, or if one of them has no counterpart. `theirs` are all modes of the reduced system.

    A counterpart is within `near` of ω, as in `match`. Its share of the mode's energy is at least `least` of the largest share,
    so modes of a cluster count and noise does not. All counterparts together must have more than `held` of the energy, so that no
    two modes of the full system have the same counterpart.
    """
    at = np.flatnonzero(in_band(ours.frequencies, band) & (np.arange(len(ours.frequencies)) >= ours.rigid))
    if not len(at):
        return np.nan
    x, y = ours.shapes[:, at], full.collected(reduced.expand(theirs.shapes))
    size = np.sqrt(np.einsum("ij,ij->j", y, full.M @ y))  # 1 except for methods that change the mass, such as MacNeal's
    share = x.T @ (full.M @ y) / size
    omega = ours.frequencies[at, None]
    share[np.abs(theirs.frequencies - omega) > near * omega] = 0.0
    share[np.abs(share) < least * np.abs(share).max(axis=1, keepdims=True)] = 0.0
    if ((share**2).sum(axis=1) < held).any():
        return np.nan
    own = joint_forces(full, ours, at)
    found = joint_forces(reduced, theirs, np.arange(len(theirs.frequencies))) @ (share / size).T
    scale = ours.frequencies[at] * (np.linalg.norm(own, axis=0) / ours.frequencies[at]).max()
    error = np.linalg.norm(found - own, axis=0)
    return float((error / scale).max()) if scale.any() else np.nan


def joint_forces(system: System, modes: NormalModes, at: Array) -> Array:
    """The interface forces of all parts, stacked, shape (Σ n_b, k)."""
    return np.concatenate(list(system.interface_forces(modes.frequencies[at], modes.shapes[:, at]).values()))


def held_frequencies(model: Substructure, band: tuple[float, float] | None = None) -> Array:
    """The undamped frequencies in a band with the interface fixed; all frequencies if the model is small or no band is given."""
    if model.size <= len(model.interface_numbers):
        return np.empty(0)
    at_rest = couple({"held": model}, [Rigid(("held", model.interface_numbers), "ground")], interface=[])
    found = undamped(at_rest, band).elastic
    return found[in_band(found, band)] if band else found


def held_error(full: Array, reduced: Array) -> float:
    """The largest |Δω| / ω; inf where a frequency of the full model has no counterpart at all."""
    at, to = match(full, reduced)
    return float((np.abs(reduced[to] - full[at]) / full[at]).max(initial=0.0)) if len(at) == len(full) else np.inf
