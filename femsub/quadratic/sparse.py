"""Eigenvalues of a sparse pencil near 0 or in a rectangle, by SLEPc's PEP, with left vectors and an independent count."""

from __future__ import annotations

from contextlib import suppress
from copy import copy
from functools import partial
from typing import NamedTuple

import numpy as np

from femsub.checks import Array
from femsub.errors import BreakdownError, InputError, MissedModesError, NotConvergedError, SingularMatrixError
from femsub.linalg.factor import QUADRATIC, Handle, shared_factor
from femsub.linalg.petsc import Factor, Transposed, quadratic_modes
from femsub.linalg.shared import shared
from femsub.model.bands import beyond, in_band
from femsub.model.pencil import Pencil
from femsub.modes.normal_modes import lowest_modes
from femsub.modes.shift_invert import ShiftInvert
from femsub.quadratic import damping_split as splitting
from femsub.quadratic import dense as qep
from femsub.quadratic import disc_count as condensed
from femsub.quadratic.matching import match
from femsub.quadratic.multiplicity import Search, clear_radius, distinct, joined
from femsub.quadratic.winding_count import missed_around, undamped_reference

SAME = 1e-6  # |Δλ| / |λ| up to which left and right vectors belong to one eigenvalue
MOST = 1500  # eigenvalues asked of TOAR at the most: beyond, minutes become hours and backward errors grow
# Tolerance, what is added to the seed of the start, and what to the number asked for, relatively; tried in turn. TOAR's own
# estimate is optimistic, at 1e-12 by five digits where K is singular. Where it breaks off, in reordering a Schur form with
# equal eigenvalues, another start and a larger space get it by.
ATTEMPTS = ((1e-14, 0, 0.0), (1e-12, 0, 0.0), (1e-12, 100, 0.15), (1e-12, 200, 0.3))
KEPT = 200_000  # up to so many DOF a second factor may stay in memory for a count, which is made unasked
Box = tuple[float, float, float, float]
Proof = condensed.Count | None


class Found(NamedTuple):
    """λ (k,), X and Y (n, k), whether an independent argument says that none is missing, the count in a disc if that does, and
    all λ that were found, those beyond the band or the count included.
    """

    values: Array
    X: Array
    Y: Array
    certified: bool
    proof: Proof
    known: Array


class Shifted:
    """P(σ) of a sparse pencil factorised, σ = 0 where K allows it, else a small positive shift; with a scale for λ."""

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.shift = 0.0
        self.rigid: Array = np.zeros((pencil.size, 0))
        self.handle: ShiftInvert | None = None  # of a floating model: K - σM, positive definite
        symmetric = pencil.symmetric[0] and pencil.symmetric[2]
        try:
            self.factor = self._factor(0.0, symmetric)
            self.scale = self._scale()
        except SingularMatrixError:
            self.shift = self.scale = self._free_shift(symmetric)
            self.factor = self._factor(self.shift, symmetric and pencil.symmetric[1])

    def _factor(self, shift: float, symmetric: bool) -> Factor | Transposed:
        matrix = self.pencil.at(shift) if shift else self.pencil.K
        found: Handle | None = None
        if symmetric and matrix.diagonal().min() > 0:
            with suppress(SingularMatrixError):
                found = shared_factor(matrix, "definite")
        found = found or shared_factor(matrix, "symmetric" if symmetric else "general")
        assert isinstance(found, Factor)
        return found

    def _scale(self) -> float:
        """The size of the smallest eigenvalues, min(‖K⁻¹M‖^-½, ‖K⁻¹D‖^-1), by a few power steps."""
        x = np.random.default_rng(5).standard_normal((self.pencil.size, 2))
        growth = np.ones(2)
        for _ in range(4):
            x = self.factor.solve(np.stack([self.pencil.M @ x[:, 0], self.pencil.D @ x[:, 1]], axis=1))
            growth = np.linalg.norm(x, axis=0)
            x = x / np.where(growth > 0, growth, 1.0)
        if growth[0] * self.pencil.norms[2] > 1e15 * self.pencil.norms[0]:
            raise SingularMatrixError("K is singular to working precision")
        with np.errstate(divide="ignore"):
            return float(min(growth[0] ** -0.5, 1 / growth[1]))

    def _free_shift(self, symmetric: bool) -> float:
        """Half of the first elastic frequency where K and M are symmetric; else from the softest diagonal."""
        if symmetric:
            handle = ShiftInvert(self.pencil.K, self.pencil.M)
            self.rigid = handle.rigid
            if self.pencil.size <= KEPT:
                self.handle = handle
            return 0.5 * float(lowest_modes(handle, 1).frequencies[-1])
        stiffness, mass = np.abs(self.pencil.K.diagonal()), self.pencil.M.diagonal()
        loaded = (stiffness > 0) & (mass > 0)
        if not loaded.any():
            raise SingularMatrixError("K is singular and no DOF has both mass and stiffness: no shift can be chosen")
        return 1e-2 * float(np.sqrt((stiffness[loaded] / mass[loaded]).min()))

    def nearest(self, count: int, seed: int = 1) -> tuple[Array, Array]:
        """At least `count` eigenvalues nearest to the shift (of a pair only Im λ ≥ 0 is listed), with shapes, none twice."""
        pencil = self.pencil
        matrices = (pencil.M, pencil.D, pencil.K)
        for tol, start, room in ATTEMPTS:
            ask = min(count + int(np.ceil(room * count)), 2 * pencil.size)
            try:
                values, X = quadratic_modes(self.factor, matrices, self.shift, ask, tol=tol, scale=self.scale, seed=seed + start)
                break
            except BreakdownError:
                if (tol, start, room) == ATTEMPTS[-1]:
                    raise
            except NotConvergedError:
                if tol == ATTEMPTS[-1][0]:
                    raise
        values, X = distinct(values, X)
        if self.rigid.shape[1]:
            values, X = self._zeros(values, X)
        elif self.shift:
            still = np.flatnonzero(np.abs(values) < 1e-5 * self.shift)
            scale = np.linalg.norm(abs(pencil.K) @ np.abs(X[:, still]), axis=0)
            still = still[np.linalg.norm(pencil.K @ X[:, still], axis=0) <= 1e-9 * scale]
            both = still[values[still].imag != 0]  # stand for their conjugates, which are 0 as well
            values[still] = 0.0
            if len(both):
                values, X = np.append(values, values[both]), np.hstack([X, X[:, both].conj()])
        return values, X / np.linalg.norm(X, axis=0)

    def gathered(self, count: int, searches: int) -> tuple[Array, Array]:
        """What several searches, each from another start, find together."""
        values, X = self.nearest(count)
        for seed in range(2, searches + 1):
            values, X = joined(values, X, *self.nearest(count, seed))
        return values, X

    def _zeros(self, values: Array, X: Array) -> tuple[Array, Array]:
        """Puts exact zeros for the eigenvalues of rigid-body motion, which come out as a broken-up multiple eigenvalue.

        Their number is n_r plus the rigid motions that D does not brake.
        """
        Z = self.rigid
        braking = np.linalg.svd(Z.T @ (self.pencil.D @ Z), compute_uv=False)
        scale = self.pencil.norms[1] * float((Z**2).sum(axis=0).max())
        number = Z.shape[1] + int(np.count_nonzero(braking <= 1e-14 * scale))
        order = np.argsort(np.abs(values), kind="stable")
        listed = np.cumsum(1 + (values[order].imag != 0))
        drop = order[:int(np.searchsorted(listed, number)) + 1]
        if listed[len(drop) - 1] != number or np.abs(values[drop]).max() > 0.1 * self.shift:
            raise MissedModesError(f"{number} eigenvalues at 0 are due to {Z.shape[1]} rigid-body modes, but those nearest to "
                                   f"0 are {values[drop]}; ask for more eigenvalues")
        keep = np.setdiff1d(np.arange(len(values)), drop)
        shapes = Z[:, np.arange(number) % Z.shape[1]]
        return np.append(values[keep], np.zeros(number)), np.hstack([X[:, keep], shapes])

    def left(self, values: Array, X: Array, ask: int, searches: int) -> Array:
        """Left vectors y, yᴴP(λ) = 0: x̄ for a symmetric pencil, else from the transposed one, matched by λ.

        `ask` eigenvalues next to the shift were asked for, in so many `searches`, until these were found among them. Where no
        counterpart is found the column is zero, which makes its error bar infinite.
        """
        if all(self.pencil.symmetric):
            return X.conj()
        other = copy(self)
        other.pencil, other.factor = self.pencil.transposed(), self.factor.transposed
        found, vectors = other.gathered(ask, searches)
        Y = np.zeros_like(X)
        at, to = match(values, found, far=2 * SAME)
        near = np.abs(found[to] - values[at]) <= SAME * np.maximum(np.abs(values[at]), self.shift)
        Y[:, at[near]] = vectors[:, to[near]].conj()
        return Y


def solve_count(pencil: Pencil, count: int, certify: bool | None) -> Found:
    """At least `count` eigenvalues nearest to 0, conjugates included, and the proof that none is nearer."""
    problem = Shifted(pencil)
    parts = splitting.split(pencil) if certify or (certify is None and pencil.size <= KEPT) else None
    # Around a shift other than 0 the nearest are not quite the nearest to 0: a few more are asked for. A count needs a gap
    # behind the last, and hence the next.
    ask = count + (0 if problem.shift == 0 else 12) + (0 if parts is None else 2)
    search = Search(problem.nearest, pencil.size)
    while True:
        try:
            values, X = search.found(ask)
        except NotConvergedError:
            if pencil.size <= QUADRATIC:
                return _complete(pencil)
            if parts is None or certify:
                raise
            parts, ask = None, ask - 2  # what was not asked for must not be what fails
            continue
        reach = np.abs(values - problem.shift).max() - problem.shift
        sure = ~beyond(np.abs(values), reach)
        if _listed(values[sure]) < count and _listed(values) < 2 * pencil.size and ask < 2 * pencil.size:
            ask = min(2 * ask, 2 * pencil.size)
            continue
        near, Xn = values[sure], X[:, sure]
        order = np.argsort(np.abs(near), kind="stable")
        listed = np.cumsum(1 + (near[order].imag != 0))
        order = order[:int(np.searchsorted(listed, count)) + 1]
        proof = None
        if parts is not None:
            proof = _confirmed(problem, parts, _edge(parts, clear_radius(np.sort(np.abs(near)), len(order))), values, X)
        if proof is None:
            if search.settled():
                break
            continue
        if (missed := proof.number - _number(values, proof.radius)) == 0:
            break
        if missed < 0 or search.exhausted:
            return _complete(pencil, proof, missed)
        ask = search.more(ask, missed)
    known, values, X = values, near[order], Xn[:, order]
    return Found(*_with_conjugates(values, X, problem.left(values, X, search.ask, search.searches)), proof is not None, proof,
                 known)


def solve_band(pencil: Pencil, box: Box, certify: bool | None) -> Found:
    """All eigenvalues in a rectangle with Im λ ≥ 0."""
    problem = Shifted(pencil)
    a, b, lo, hi = box
    radius = 1.03 * float(np.hypot(max(abs(a), abs(b)), hi)) + problem.shift  # the contour may move out by 2 %
    parts = None if certify is False else splitting.split(pencil)
    at = None if parts is None else _edge(parts, radius)
    winding = at is None and (pencil.size <= QUADRATIC if certify is None else certify)
    reference = undamped_reference(pencil, radius, winding) if at is None else None
    ask = 2 * (at.below if at else reference[1].counted[1] if reference else 10) + 12
    most, search = min(pencil.size, MOST), Search(problem.nearest, pencil.size)
    while True:
        if ask > most:
            if pencil.size <= QUADRATIC:  # more than half of all
                return _complete(pencil)
            raise InputError(
                f"the disc around 0 that holds the band has about {ask} eigenvalues, and with a real shift all of them would "
                f"have to be found ({MOST} at most); lower the band, narrow re=(a, b), or reduce the model")
        try:
            values, X = search.found(ask)
        except NotConvergedError:
            if pencil.size <= QUADRATIC:
                return _complete(pencil)
            raise
        if np.abs(values - problem.shift).max() < radius and _listed(values) < 2 * pencil.size:
            ask = min(2 * ask, most) if ask < most else most + 1
            continue
        proof = None if parts is None or at is None else _confirmed(problem, parts, at, values, X)
        missed = proof.number - _number(values, proof.radius) if proof else 0
        if proof is None and (pencil.size <= QUADRATIC if certify is None else certify):
            reference = reference if winding else undamped_reference(pencil, radius, True)
            winding = True
            if reference is not None:
                try:
                    missed = missed_around(pencil, box, values, radius, reference)
                except NotConvergedError:
                    if pencil.size > QUADRATIC:
                        raise
                    return _complete(pencil)
        if not missed:
            if proof or (winding and reference is not None) or search.settled():
                break
            continue
        if missed < 0 or search.exhausted:
            return _complete(pencil, proof, missed)
        ask = search.more(ask, missed)
    keep = in_band(values, (lo, hi), (a, b))
    known, values, X = values, values[keep], X[:, keep]
    pair = (values.imag != 0) & in_band(values.conj(), (lo, hi), (a, b))  # a double real one, which rounding has split
    values, X = np.append(values, values[pair].conj()), np.hstack([X, X[:, pair].conj()])
    certified = proof is not None or (winding and reference is not None)
    return Found(values, X, problem.left(values, X, search.ask, search.searches), certified, proof, known)


def _complete(pencil: Pencil, proof: Proof = None, missed: int = 0) -> Found:
    """All by LAPACK, which is complete; for a large pencil the error that tells what is missing."""
    if pencil.size <= QUADRATIC:
        values, X, Y = qep.solve(pencil.dense())
        return Found(values, X, Y, True, None, values)
    if proof is None:
        raise MissedModesError(f"the winding number of det P says that {missed} eigenvalues around the band are missing; shift "
                               "the band a little, or narrow re=(a, b)")
    raise MissedModesError(f"an independent count says that {proof.number} eigenvalues lie in |λ| < {proof.radius:.6g}, but "
                           f"{proof.number - missed} were found; ask for more or fewer, or for another band")


def _edge(parts: splitting.Split, radius: float) -> condensed.Edge | None:
    """The undamped count at a radius, or up to 0.1 % beyond it where a mode is just there; None where K0 - R²M cannot be
    factorised.
    """
    for share in (0.0, 1e-5, 1e-3):
        try:
            there = radius * (1 + share)
            return shared((parts.K0, parts.M), ("edge", there, parts.W.shape[1] > 0),
                          partial(condensed.edge, parts, there))
        except SingularMatrixError:
            continue
    return None


def _confirmed(problem: Shifted, parts: splitting.Split, at: condensed.Edge | None, values: Array, X: Array) -> Proof:
    """The number of eigenvalues in the disc, if it can be proved."""
    if at is None:
        return None
    inside = X[:, np.abs(values) <= at.radius]
    if problem.pencil.symmetric[2]:  # K0 is K, and one of the factors at hand may do
        found = None
        if problem.shift == 0 and problem.factor.kind == "definite":
            found = condensed.count(parts, at, problem.factor.solve, 0.0, inside)
        elif problem.handle is not None and problem.handle.factor.kind == "definite":
            found = condensed.count(parts, at, problem.handle.factor.solve, -problem.handle.sigma, inside)
        if found is not None and found.proved:
            return found
    try:
        found = condensed.count(parts, at, *condensed.definite(parts, at.radius), inside)
    except SingularMatrixError:
        return None
    return found if found is not None and found.proved else None


def _number(values: Array, radius: float) -> int:
    return _listed(values[np.abs(values) < radius])


def _listed(values: Array) -> int:
    """How many eigenvalues these stand for, those with Im λ > 0 for two each."""
    return len(values) + int(np.count_nonzero(values.imag))


def _with_conjugates(values: Array, X: Array, Y: Array) -> tuple[Array, Array, Array]:
    double = np.flatnonzero(values.imag)
    return (np.append(values, values[double].conj()), np.hstack([X, X[:, double].conj()]),
            np.hstack([Y, Y[:, double].conj()]))
