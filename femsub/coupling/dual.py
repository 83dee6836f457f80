"""Joints by Lagrange multipliers λ: a saddle-point system, or Rixen's weak form for parts reduced by interface forces."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import DEPENDENT, ROUNDING, SINGULAR, Equations, congruent, eliminate, independent, product, units
from femsub.checks import EPS, Array, Matrix, MissedModesError

if TYPE_CHECKING:
    from femsub.model import Substructure

FORCE = "interface force"  # the kind of a coordinate that is the force on one interface DOF
SOFT = 1e4 * DEPENDENT  # relative residual flexibility above which no combination of joint forces is nearly stiff
SHIFT = EPS**0.25  # the shift, relative to a typical ω²: solves lose a quarter of the digits of a rigid motion's θ = 1/shift


@dataclass(frozen=True, eq=False)
class Multiplied:
    """q = S x and λ = G x, with the independent equations A q = 0 of the multipliers λ."""

    S: Matrix
    G: Matrix
    A: Matrix
    unit: Array
    owner: Array

    @property
    def multipliers(self) -> int:
        """The number of coordinates x that are multipliers: the other coordinates have empty columns in G."""
        return len(np.unique(sp.csr_array(self.G).indices))

    def through(self, T: Matrix, unit: Array) -> Multiplied:
        """The same in new coordinates z, x = T z. Rounding in S T is set to 0: it would add elastic motion to rigid motion."""
        S = sp.csr_array(product(self.S, T))
        S = sp.csr_array(S.multiply(abs(S) > ROUNDING * product(abs(self.S), abs(sp.csr_array(T)))))
        return Multiplied(S, sp.csr_array(product(self.G, T)), self.A, unit, self.owner)

    def work(self) -> Matrix:
        """GᵀAS + (GᵀAS)ᵀ, the terms of the multipliers in the stiffness, sparse, shape (n, n)."""
        half = sp.csr_array(product(self.G.T, product(self.A, self.S)))
        return half + half.T


def interface_forces(part: Substructure) -> Matrix:
    """A (n, n_b), sparse: the coordinates g of a part reduced by interface forces, from these forces; 0 for other parts.

    A force without a coordinate of its own acts on the coordinates g that it depends on: K_gg⁻¹ times the displacement of its DOF
    by them.
    """
    force = np.flatnonzero(np.array(getattr(part, "kinds", ())) == FORCE)
    n_b = len(part.interface_numbers)
    on = np.eye(len(force), n_b)
    if 0 < len(force) < n_b:
        K = part.K[np.ix_(force, force)]
        scale = K.diagonal()[:, None] ** -0.5
        inverse, moved = np.linalg.inv(scale * K * scale.T), scale * np.asarray(part.interface_rows)[:, force].T
        on = scale * np.where(np.abs(inverse @ moved) > ROUNDING * (np.abs(inverse) @ np.abs(moved)), inverse @ moved, 0.0)
    return sp.csr_array(sp.eye_array(part.size, format="csr")[:, force] @ sp.csr_array(on))


def multiplied(equations: Equations, L: Matrix, forces: Matrix, own: Matrix, compliance: Array, K: Matrix,
               refuse: Callable[[Array, int, int], None]) -> Multiplied:
    """x = (y, λ): the multipliers λ, and the coordinates y that the other joints leave, without forces that λ determines.

    A part reduced by interface forces g moves by u_b = Φ_b η + G g with the residual flexibility G, and g = -Cᵀλ. If two joined
    parts have almost no residual flexibility (all modes kept), λ would have neither mass nor stiffness. Then elimination makes
    the joint exact. Forces on an open interface are kept if they have flexibility.

    Parameters
    ----------
    equations : Equations
        A q = 0 of the joints with multipliers.
    L : sparse, shape (N, n)
        The motions that the other joints allow; these joints do not act on the coordinates g.
    forces : sparse, shape (N, m)
        -Cᵀ in the rows of the coordinates g; empty columns if no part of the joint has such coordinates.
    own : sparse, shape (N, k)
        The columns of interface forces that stay coordinates, beside the joints' forces.
    compliance : ndarray, shape (k,)
        The flexibility of the DOF of these forces, by all coordinates of their part.
    K : sparse, shape (N, N)
        The parts' stiffness.

    References
    ----------
    D. J. Rixen, J. Comput. Appl. Math. 168 (2004) 383, eqs. (18) to (22).
    """
    unit = (L.multiply(L).T @ equations.unit[:, None] ** -2.0).ravel() ** -0.5  # L may have negative entries
    size = (abs(equations.A) @ abs(L)) @ unit
    rows = independent(Equations(sp.csr_array(equations.A @ L), unit, unit > 0, equations.owner), np.where(size > 0, size, 1.0))
    A, F, owner = equations.A[rows], sp.csr_array(forces[:, rows]), equations.owner[rows]
    stay = np.flatnonzero((np.diff(forces.indptr) + np.diff(own.indptr) > 0).astype(float) @ abs(L) == 0)
    # the columns of L, and the combinations of the forces `own` with residual flexibility
    scale, alone = compliance ** -0.5, congruent(K, own)
    values, turn = np.linalg.eigh(alone.toarray() * np.outer(scale, scale))
    turn = scale[:, None] * turn[:, values > DEPENDENT]
    yielding = product(own, sp.csr_array(turn))
    L = sp.csr_array(sp.hstack([L[:, stay], yielding]))
    unit = np.append(unit[stay], np.einsum("ij,ij->j", turn, alone @ turn) ** -0.5)
    if not F.nnz:
        return _beside(L, F, sp.eye_array(len(rows), format="csr"), A, unit, owner)
    # Make F K-orthogonal to the forces `own`, FᵀK own = 0, whose coordinates then include their share of λ. Without this, a λ
    # whose response the forces `own` can represent would have no flexibility and no mass but rounding, and the sign of the
    # rounding would decide about a mode. With it, such a λ is stiff, and its joint is eliminated.
    bent = product(K, yielding)
    share = np.linalg.solve(product(yielding.T, bent).toarray(), product(bent.T, F).toarray())
    F = sp.csr_array(F - product(yielding, sp.csr_array(share)))
    AL = sp.csr_array(A @ L)
    size = np.sqrt(AL.multiply(AL) @ unit**2)
    size = 1 / np.where(size > 0, size, 1.0)
    flexibility = product(F.T, product(K, F)).toarray() * np.outer(size, size)
    flexibility = (flexibility + flexibility.T) / 2
    with suppress(np.linalg.LinAlgError):
        # If every combination of joint forces has clear flexibility, all λ stay, and each moves only the parts of its joint.
        np.linalg.cholesky(flexibility - SOFT * np.eye(len(flexibility)))
        return _beside(L, F, sp.csr_array(sp.diags_array(size)), A, unit, owner)
    values, turn = np.linalg.eigh(flexibility)
    turn = size[:, None] * turn
    stiff = values <= DEPENDENT
    exact = eliminate(Equations(sp.csr_array(turn[:, stiff].T @ AL.toarray()), unit, np.zeros(len(unit), dtype=bool),
                                owner[np.abs(turn[:, stiff]).argmax(axis=0)]), refuse)
    return _beside(sp.csr_array(L @ exact.L), F, sp.csr_array(turn[:, ~stiff]), A, exact.unit, owner)


def _beside(L: Matrix, F: Matrix, turn: Matrix, A: Matrix, unit: Array, owner: Array) -> Multiplied:
    """x = (y, μ), λ = turn μ: coordinates y and multipliers μ. The unit of a force is 1 over the unit of its motion."""
    S = sp.csr_array(sp.hstack([L, product(F, turn)]))
    G = sp.csr_array(sp.hstack([sp.csr_array((A.shape[0], L.shape[1])), turn]))
    return Multiplied(S, G, A, np.append(unit, np.ones(turn.shape[1])), owner)


def finite_span(M: Array, D: Array, K: Array, multipliers: int,
                B: Matrix) -> tuple[Matrix, Array, tuple[Array, Array, Array], int]:
    """X = [X₁ X₀] (n, k): the eigenvectors X₁ with finite ω² ≥ 0 of K x = ω² M x, X₁ᵀMX₁ = I, and static responses X₀.

    X₀ are massless static responses to forces at the open interface B x, X₀ᵀKX₀ = I: the flexibility of DOF without mass.

    K is indefinite: the weak joints of dual Craig-Bampton parts cause as many negative or infinite ω² as multipliers. M is
    positive semidefinite, M = FFᵀ. With s > 0 the eigenvalues θ of Fᵀ(K + sM)⁻¹F are 1/(ω² + s), and x = (K + sM)⁻¹F v/θ.

    The number of columns of X₁ is known from an independent count. K has one negative eigenvalue for each multiplier, since the
    parts and springs alone are stable. N spans the null space of M. Each negative eigenvalue of NᵀKN causes an infinite ω²; each
    of the other negative eigenvalues of K causes a finite ω² < 0. So X₁ has rank M - multipliers + (negative eigenvalues of
    NᵀKN) columns. X₀ is N (NᵀKN)⁻¹NᵀBᵀ, orthonormalised.

    Returns
    -------
    X : sparse, shape (n, k)
    unit : ndarray, shape (k,)
        The displacement of each coordinate at unit energy.
    matrices : (M, D, K)
        XᵀMX, XᵀDX, XᵀKX, in which the stiffness of rigid motion is exactly 0.
    spurious : int
        The number of eigenvectors that X leaves out, n - k.

    Raises
    ------
    MissedModesError
        Another number of modes was found, or NᵀKN is singular within rounding, so that the number is not known.
    """
    unit, typical = units(M.diagonal(), K.diagonal())  # also usable for free coordinates, whose stiffness is only rounding
    stiffness, inertia = unit[:, None] * K * unit, unit[:, None] * M * unit
    mass, turn = np.linalg.eigh(inertia)
    kept = mass > SINGULAR * mass[-1]
    F = turn[:, kept] * np.sqrt(mass[kept])
    shift = SHIFT * typical
    back = np.linalg.solve(stiffness + shift * inertia, F)
    small = F.T @ back
    theta, V = np.linalg.eigh((small + small.T) / 2)
    finite = np.abs(theta) > SINGULAR * np.abs(theta).max()  # the others have an infinite ω²
    omega2 = np.full(len(theta), -np.inf)
    omega2[finite] = 1 / theta[finite] - shift
    good = np.flatnonzero(omega2 > -EPS**0.5 * shift)  # half of the digits of a rigid motion's θ = 1/shift are kept
    good = good[np.argsort(omega2[good], kind="stable")]
    bare, null = np.linalg.eigh(turn[:, ~kept].T @ stiffness @ turn[:, ~kept])
    expected = int(kept.sum()) - multipliers + int(np.count_nonzero(bare < -ROUNDING))
    # ω² so large that its sign is not known counts as infinite
    if not len(good) <= expected <= len(good) + int(np.count_nonzero(~finite)):
        raise MissedModesError(f"{len(good)} finite modes were found in a system of Dual Craig-Bampton parts, but by the rank of "
                               f"M it has {expected}. Its joints are too stiff, or its parts too unlike, for weak joints: reduce "
                               "the parts by CraigChang, which spans the same space")
    # N diag(k)⁻¹NᵀBᵀ with NᵀKN = diag(k). If a k is within rounding, its sign and the number of finite modes are not known.
    known = np.abs(bare) > ROUNDING
    scaled = B @ sp.diags_array(unit)
    at = (scaled @ turn[:, ~kept] @ null[:, known]).T
    shapes = turn[:, ~kept] @ null[:, known] @ (at / bare[known, None])
    flexibility = at.T @ (at / bare[known, None])
    size, whole = flexibility.diagonal(), scaled.multiply(scaled).sum(axis=1)
    soft = size > DEPENDENT * whole
    scale = np.where(soft, np.where(soft, size, 1.0) ** -0.5, 0.0)
    values, mixed = np.linalg.eigh(flexibility * np.outer(scale, scale))
    clear = values > DEPENDENT
    still = shapes @ (scale[:, None] * mixed[:, clear] / np.sqrt(values[clear]))
    X = unit[:, None] * np.hstack([(back @ V[:, good]) / theta[good], still])
    rigid = np.flatnonzero(omega2[good] < EPS**0.5 * shift)
    matrices = congruent(M, X), congruent(D, X), congruent(K, X)
    matrices[2][rigid], matrices[2][:, rigid] = 0.0, 0.0
    matrices[0][len(good):], matrices[0][:, len(good):] = 0.0, 0.0
    far = np.append((np.maximum(omega2[good], 0.0) + typical) ** -0.5, np.ones(still.shape[1]))
    return sp.csr_array(X), far, matrices, len(M) - X.shape[1]
