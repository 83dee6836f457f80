"""True errors of reduced random systems, and the fewest modes of the parts with which a system would meet a tolerance."""

from __future__ import annotations

import numpy as np
from randomsystems import Case, compositions

import femsub as fs
from femsub.model.bands import upper, within
from femsub.modes import match
from femsub.reduction.estimates.joined import JoinedSpace, held_statics
from femsub.reduction.estimates.nested import FAR, Nested

TRIALS = 3000  # numbers of modes that are tried for the fewest


def moving(model: fs.Substructure, belt: fs.Belt | None) -> np.ndarray:
    """All λ with Im λ ≥ 0 that are no rigid-body ones, by LAPACK."""
    modes = fs.complex_modes(model.linearised(belt).dense())
    return modes.eigenvalues[upper(modes.eigenvalues) & ~modes.rigid & (modes.eigenvalues != 0)]


def of_omega(case: Case, omega: np.ndarray) -> np.ndarray:
    """True relative errors of the frequencies in the band; infinite where there is none."""
    exact = case.omega[case.omega <= case.band[1]]
    error = np.full(len(exact), np.inf)
    error[:len(omega)] = np.abs(omega[:len(exact)] / exact[:len(omega)] - 1)
    return error


def of_lambda(case: Case, full: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """True relative errors of the eigenvalues in the band, and the reduced model's that belong to them."""
    inside = within(full, case.band)
    error, partner = np.full(len(full), np.inf), np.full(len(full), np.nan + 0j)
    at, to = match(full, values, far=FAR)
    error[at], partner[at] = np.abs(values[to] - full[at]) / np.abs(full[at]), values[to]
    return error[inside], partner[inside]


def fewest(case: Case, full: np.ndarray | None, chosen: np.ndarray, tol: float) -> tuple[int, bool, int]:
    """The fewest modes in all that meet the tolerance, up to those chosen; whether all smaller numbers were tried; and the fewest
    by a rule that takes the modes of all parts up to the same frequency.
    """
    space = JoinedSpace(case.system, {name: held_statics(part) for name, part in case.system.parts.items()}, case.belt,
                        case.band[1])
    for found in space.parts.values():
        found.grow(found.all)
    nested = space.reference().nested
    tried: dict[tuple[int, ...], bool] = {}

    def meets(counts: np.ndarray) -> bool:
        key = tuple(counts.tolist())
        if key not in tried:
            tried[key] = _meets(case, full, nested, counts, tol)
        return tried[key]

    least = np.zeros(len(chosen), dtype=int)
    for at in range(len(chosen)):  # with all modes of the others, which cannot do better
        low, high = 0, int(chosen[at])
        while low < high:
            middle = (low + high) // 2
            counts = nested.most.copy()
            counts[at] = middle
            low, high = (low, middle) if meets(counts) else (middle + 1, high)
        least[at] = low
    limits = np.append(0.0, np.sort(nested.values))
    parts = np.split(nested.values, np.cumsum(nested.most)[:-1])
    low, high = 0, len(limits) - 1
    while low < high:
        middle = (low + high) // 2
        good = meets(np.array([int((part <= limits[middle]).sum()) for part in parts]))
        low, high = (low, middle) if good else (middle + 1, high)
    for total in range(int(least.sum()), int(chosen.sum())):
        for counts in compositions(total, least, nested.most):
            if len(tried) > TRIALS:
                return total, False, low
            if meets(counts):
                return total, True, low
    return int(chosen.sum()), True, low


def _meets(case: Case, full: np.ndarray | None, nested: Nested, counts: np.ndarray, tol: float) -> bool:
    if of_omega(case, nested.undamped(counts)[0]).max(initial=0.0) > tol:
        return False
    return full is None or bool(of_lambda(case, full, nested.damped(counts)[0])[0].max(initial=0.0) <= tol)
