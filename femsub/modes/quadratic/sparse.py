"""Eigenvalues of a sparse pencil nearest to a shift, by SLEPc's PEP (TOAR), with right and left vectors."""

from __future__ import annotations

from contextlib import suppress
from copy import copy
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import Handle, SparseFactor, Transposed, inertia, quadratic_modes, shared_factor
from femsub.checks import EQUAL, Array, InputError, MissedModesError, NotConvergedError, SingularMatrixError
from femsub.model import DOUBLE, beyond, costs
from femsub.modes.normal_modes import lowest_modes, modes_under
from femsub.modes.quadratic.matching import SPLIT, clear_radius, clusters, distinct, joined, match
from femsub.modes.quadratic.projected_count import proportional
from femsub.modes.quadratic.region import Contour, Count, Region, listed
from femsub.modes.shift_invert import ShiftInvert, motion_of

if TYPE_CHECKING:
    from femsub.model import Pencil

# Attempts: tolerance, increment of the random seed, relative increment of the number asked for. TOAR's error estimate is
# optimistic, by five digits at 1e-12 if K is singular. If TOAR fails while reordering a Schur form with equal eigenvalues,
# another start vector and a larger space usually succeed.
ATTEMPTS = ((1e-14, 0, 0.0), (1e-12, 0, 0.0), (1e-12, 100, 0.15), (1e-12, 200, 0.3))


class Shifted:
    """The factor of P(σ) for a sparse pencil, and a scale for λ. The shift σ is 0 if K is regular, else small and positive."""

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.shift = 0.0
        self.searches = 1  # number of start vectors used so far
        self.rigid: Array = np.zeros((pencil.size, 0))
        symmetric = pencil.symmetric[0] and pencil.symmetric[2]
        self.motion = motion_of(pencil.rigid_motion)
        try:
            if symmetric and self.motion is not None and self.motion.count:
                raise SingularMatrixError("K has rigid motion")
            self.factor = self._factor(0.0, symmetric)
            self.scale = self._scale()
        except SingularMatrixError:
            self.shift = self.scale = self._free_shift(symmetric)
            self.factor = self._factor(self.shift, symmetric and pencil.symmetric[1])

    def _factor(self, shift: float, symmetric: bool) -> SparseFactor | Transposed:
        matrix = self.pencil.at(shift) if shift else self.pencil.K
        found: Handle | None = None
        if symmetric and matrix.diagonal().min() > 0:
            with suppress(SingularMatrixError):
                found = shared_factor(matrix, "definite")
        found = found or shared_factor(matrix, "symmetric" if symmetric else "general")
        assert isinstance(found, SparseFactor)
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
        """The shift for a singular K: half of the first elastic frequency, or for unsymmetric matrices from min k_ii / m_ii."""
        if symmetric:
            handle = ShiftInvert(self.pencil.K, self.pencil.M, carried=self.pencil.rigid_motion)
            self.rigid = handle.rigid
            if self.motion is None:
                self.motion = handle.motion(self.pencil.D)
                self.rigid = self.motion.shapes
            return 0.5 * float(lowest_modes(handle, 1).frequencies[-1])
        stiffness, mass = np.abs(self.pencil.K.diagonal()), self.pencil.M.diagonal()
        loaded = (stiffness > 0) & (mass > 0)
        if not loaded.any():
            raise SingularMatrixError("K is singular, and no DOF has both mass and stiffness, so no shift can be chosen. Check K "
                                      "and M")
        return 1e-2 * float(np.sqrt((stiffness[loaded] / mass[loaded]).min()))

    def nearest(self, count: int, seed: int = 1) -> tuple[Array, Array]:
        """At least `count` eigenvalues nearest to the shift, with shapes, without duplicates. Only Im λ ≥ 0 is listed."""
        pencil = self.pencil
        matrices = (pencil.M, pencil.D, pencil.K)
        for tol, start, room in ATTEMPTS:
            ask = min(count + int(np.ceil(room * count)), 2 * pencil.size)
            try:
                values, X = quadratic_modes(self.factor, matrices, self.shift, ask, tol=tol, scale=self.scale, seed=seed + start)
                break
            except NotConvergedError as error:
                last = error
        else:
            raise last
        values, X = distinct(values, X)
        if self.rigid.shape[1]:
            # eigenvalues of rigid motion are exactly 0: one for each rigid-body mode, and a second one if D does not damp it. The
            # solver returns this multiple eigenvalue split by rounding
            assert self.motion is not None
            number, order = self.motion.zeros, np.argsort(np.abs(values), kind="stable")
            of = np.cumsum(1 + (values[order].imag != 0))
            drop = order[:int(np.searchsorted(of, number)) + 1]
            if of[len(drop) - 1] != number or np.abs(values[drop]).max() > 0.1 * self.shift:
                raise MissedModesError(f"{number} eigenvalues must be 0 because of {self.rigid.shape[1]} rigid-body modes, but "
                                       f"those nearest to 0 are {values[drop]}. Ask for more eigenvalues")
            keep = np.setdiff1d(np.arange(len(values)), drop)
            shapes = self.rigid[:, np.arange(number) % self.rigid.shape[1]]
            values, X = np.append(values[keep], np.zeros(number)), np.hstack([X[:, keep], shapes])
        elif self.shift:
            still = np.flatnonzero(np.abs(values) < 1e-5 * self.shift)
            still = still[costs(pencil.K, X[:, still])[0] <= EQUAL]
            both = still[values[still].imag != 0]  # their conjugates are 0 as well
            values[still] = 0.0
            if len(both):
                values, X = np.append(values, values[both]), np.hstack([X, X[:, both].conj()])
        return values, X / np.linalg.norm(X, axis=0)

    def search(self, region: Region, count: Count | None, thorough: bool, searches: int = 4) -> tuple[Array, Array, Count | None]:
        """λ (k,), Im λ ≥ 0, and X (n, k) of all eigenpairs in a region, searched until they match the count; and the count.

        If no count is given, inertia counts where it can. Further start vectors find further directions of an eigenspace: four
        starts were always enough. A `thorough` search without a count ends when another start finds no new eigenpair in the
        clusters.

        Raises
        ------
        InputError
            The disc around 0 that contains the box has too many eigenvalues: beyond 1,500 run times reach hours, and backward
            errors grow.
        MissedModesError
            The number found differs from the count.
        """
        pencil, most = self.pencil, 2 * self.pencil.size
        # number of eigenvalues to ask for at first, and the distance from the shift that they must reach
        if region.box is None:
            ask, reach = (region.count or 0) + (12 if self.shift else 0) + 2, 0.0  # the shift is nearer to others than 0
        elif count is not None:
            reach = 1.001 * float(np.abs(count.values[count.contour.encloses(count.values)]).max(initial=0.0)) + self.shift
            ask = int(np.count_nonzero(np.abs(count.values) <= reach)) + 8
        else:
            reach, below, most = region.radius + self.shift, 10, min(pencil.size, 1500)
            if pencil.symmetric[0]:
                with suppress(SingularMatrixError):
                    below = modes_under(pencil.symmetric_stiffness, pencil.M, region.radius**2)
            ask = 2 * below + 12
        values, X, known = np.zeros(0), np.zeros((pencil.size, 0)), 0
        for self.searches in range(1, searches + 1):
            while True:
                if ask > most and region.box is not None:
                    raise InputError(f"the disc around 0 that holds the band has about {ask} eigenvalues. The solver has to "
                                     f"compute all of them, and the limit is {most}. Lower the band, narrow re=(a, b), or reduce "
                                     "the model")
                found, shapes = self.nearest(min(ask, most), self.searches)
                far = float(np.abs(found - self.shift).max(initial=0.0))
                near = ~beyond(np.abs(found), far - self.shift)  # eigenvalues not found may be nearer to 0 than the others
                enough = listed(found[near]) >= (region.count or 0) if region.box is None else far >= reach
                if enough or listed(found) >= 2 * pencil.size:
                    break
                ask *= 2
            if region.box is None:
                found, shapes = found[near], shapes[:, near]
            values, X = joined(values, X, found, shapes) if self.searches > 1 else (found, shapes)
            if count is None:
                last = len(region.upper(values))
                count = by_inertia(pencil, clear_radius(np.sort(np.abs(values)), last) if region.box is None else region.radius)
            if count is not None:
                missed = count.number - count.tally(values).listed
                if missed <= 0:
                    break
                ask += 2 * missed + 10
            elif not thorough or len(values) == known or not clusters(values[values != 0], DOUBLE):
                break
            known = len(values)
        if count is not None and (number := count.tally(values).listed) != count.number:
            raise MissedModesError(f"{number} eigenvalues were found in {count.contour.where}, but an independent count gives "
                                   f"{count.number}. Ask for more or fewer, or for another band")
        return values, X, count

    def left(self, values: Array, X: Array, ask: int) -> Array:
        """Left vectors y, yᴴP(λ) = 0, from the transposed pencil, matched by λ.

        If an eigenvalue has no counterpart among the `ask` left eigenpairs, its column is zero, and its error bar becomes
        infinite.
        """
        other = copy(self)
        other.pencil, other.factor = self.pencil.transposed(), self.factor.transposed
        found, vectors = other.nearest(ask)
        for seed in range(2, self.searches + 1):  # each search from another start vector
            found, vectors = joined(found, vectors, *other.nearest(ask, seed))
        Y = np.zeros_like(X)
        at, to = match(values, found, far=2 * SPLIT)
        near = np.abs(found[to] - values[at]) <= SPLIT * np.maximum(np.abs(values[at]), self.shift)
        Y[:, at[near]] = vectors[:, to[near]].conj()
        return Y


def by_inertia(pencil: Pencil, radius: float) -> Count | None:
    """The number of eigenvalues in |λ| < R of a part with D = αM + βK, or of a rotating part; None for other parts.

    With proportional damping it is twice the number of negative eigenvalues of K - R²M. The damping must be so weak that none of
    the modes below R is overdamped.

    A rotating part has a skew D and a positive definite K. All its eigenvalues are imaginary, λ = iω. The quadratic form of the
    Hermitian P(iω) is k + ωg - ω²m with k > 0. It changes sign once as ω grows, so the number of negative eigenvalues of P(iR) is
    the number of ω below R (P. Lancaster, Lambda-Matrices and Vibrating Systems, 1966). The real matrix [[A, -RD], [RD, A]],
    A = K - R²M, has twice as many negative eigenvalues.
    """
    simple = proportional(pencil, pencil.D) if all(pencil.symmetric) else None
    plain = simple is not None and not simple[2].shape[1] and abs(simple[0]) < radius / 2 and abs(simple[1]) * radius < 0.5
    if not plain and (pencil.symmetric != (True, False, True) or abs(pencil.D + pencil.D.T).max() > EQUAL * abs(pencil.D).max()):
        return None
    for near in (radius, radius * (1 + 1e-5), radius * (1 + 1e-3)):  # an eigenvalue may lie on the circle
        A, B = pencil.K - near**2 * pencil.M, near / 2 * (pencil.D - pencil.D.T)
        with suppress(SingularMatrixError):
            if plain:
                return Count(Contour(near), 2 * inertia(sp.csr_array(A)), np.zeros(0), 0, 0.0)
            shared_factor(pencil.K, "definite")
            return Count(Contour(near), inertia(sp.block_array([[A, -B], [B, A]], format="csr")), np.zeros(0), 0, 0.0)
    return None
