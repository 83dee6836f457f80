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

FORCE = "interface force"  # the kind of a coordinate that is the force on an interface DOF, one for each
SOFT = 1e4 * DEPENDENT  # relative residual flexibility above which no combination of joint forces is near to being stiff
SHIFT = EPS**0.25  # the shift, relative to a typical ω²: of a rigid motion's θ = 1/shift solves lose a quarter of the digits


@dataclass(frozen=True, eq=False)
class Multiplied:
    """q = S x and λ = G x, and the equations A q = 0 that λ belongs to, all of them independent."""

    S: Matrix
    G: Matrix
    A: Matrix
    unit: Array
    owner: Array

    @property
    def multipliers(self) -> int:
        """How many of the coordinates x are multipliers: the others have empty columns in G."""
        return len(np.unique(sp.csr_array(self.G).indices))

    def through(self, T: Matrix, unit: Array) -> Multiplied:
        """In new coordinates, x = T z. What cancels in S T is 0: a trace of elastic motion would stiffen a rigid one."""
        S = sp.csr_array(product(self.S, T))
        S = sp.csr_array(S.multiply(abs(S) > ROUNDING * product(abs(self.S), abs(sp.csr_array(T)))))
        return Multiplied(S, sp.csr_array(product(self.G, T)), self.A, unit, self.owner)

    def work(self) -> Matrix:
        """GᵀAS + (GᵀAS)ᵀ, what the multipliers add to the stiffness, sparse, shape (n, n)."""
        half = sp.csr_array(product(self.G.T, product(self.A, self.S)))
        return half + half.T


def interface_forces(part: Substructure) -> Matrix:
    """A (n, n_b), sparse: how forces at the interface act on the coordinates g of a part that is reduced by such forces; else 0.

    A force without a coordinate of its own acts on those that it depends on, K_gg⁻¹ times the motion of its DOF by them.
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
    """x = (y, λ): the coordinates that the other joints leave, but without forces that λ gives, and the multipliers.

    A part reduced by interface forces g moves by u_b = Φ_b η + G g with the residual flexibility G, and g = -Cᵀλ. If two joined
    parts have almost no residual flexibility (all modes kept), λ would have neither mass nor stiffness. Then the joint is made
    exact by elimination. Forces on an open interface are kept if they have flexibility.

    Parameters
    ----------
    equations : Equations
        A q = 0 of the joints with multipliers.
    L : sparse, shape (N, n)
        What the other joints leave; it does not touch the coordinates g.
    forces : sparse, shape (N, m)
        -Cᵀ in the rows of the coordinates g, without entries where no part has such.
    own : sparse, shape (N, k)
        What forces do in these rows that stay beside those of the joints.
    compliance : ndarray, shape (k,)
        The flexibility of their DOF by all coordinates of the part.
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
    # L beside combinations of the forces `own` that have residual flexibility
    scale, alone = compliance ** -0.5, congruent(K, own)
    values, turn = np.linalg.eigh(alone.toarray() * np.outer(scale, scale))
    turn = scale[:, None] * turn[:, values > DEPENDENT]
    yielding = product(own, sp.csr_array(turn))
    L = sp.csr_array(sp.hstack([L[:, stay], yielding]))
    unit = np.append(unit[stay], np.einsum("ij,ij->j", turn, alone @ turn) ** -0.5)
    if not F.nnz:
        return _beside(L, F, sp.eye_array(len(rows), format="csr"), A, unit, owner)
    # F without what these do, FᵀK own = 0: they take their share of λ, and in their place stands their sum with it. Else a λ
    # whose whole response they can give as well would have no flexibility and no mass, up to rounding, whose sign decides about
    # a mode. It is a stiff one instead
    bent = product(K, yielding)
    share = np.linalg.solve(product(yielding.T, bent).toarray(), product(bent.T, F).toarray())
    F = sp.csr_array(F - product(yielding, sp.csr_array(share)))
    AL = sp.csr_array(A @ L)
    size = np.sqrt(AL.multiply(AL) @ unit**2)
    size = 1 / np.where(size > 0, size, 1.0)
    flexibility = product(F.T, product(K, F)).toarray() * np.outer(size, size)
    flexibility = (flexibility + flexibility.T) / 2
    with suppress(np.linalg.LinAlgError):
        # every combination of joint forces has clearly more than no flexibility: λ stay, each moves the parts of its joint alone
        np.linalg.cholesky(flexibility - SOFT * np.eye(len(flexibility)))
        return _beside(L, F, sp.csr_array(sp.diags_array(size)), A, unit, owner)
    values, turn = np.linalg.eigh(flexibility)
    turn = size[:, None] * turn
    stiff = values <= DEPENDENT
    exact = eliminate(Equations(sp.csr_array(turn[:, stiff].T @ AL.toarray()), unit, np.zeros(len(unit), dtype=bool),
                                owner[np.abs(turn[:, stiff]).argmax(axis=0)]), refuse)
    return _beside(sp.csr_array(L @ exact.L), F, sp.csr_array(turn[:, ~stiff]), A, exact.unit, owner)


def _beside(L: Matrix, F: Matrix, turn: Matrix, A: Matrix, unit: Array, owner: Array) -> Multiplied:
    """x = (y, μ), λ = turn μ: the multipliers beside the coordinates; a force has the unit of one over a motion."""
    S = sp.csr_array(sp.hstack([L, product(F, turn)]))
    G = sp.csr_array(sp.hstack([sp.csr_array((A.shape[0], L.shape[1])), turn]))
    return Multiplied(S, G, A, np.append(unit, np.ones(turn.shape[1])), owner)


def finite_span(M: Array, D: Array, K: Array, multipliers: int,
                B: Matrix) -> tuple[Matrix, Array, tuple[Array, Array, Array], int]:
    """X = [X₁ X₀] (n, k): the eigenvectors X₁ with finite ω² ≥ 0 of K x = ω² M x, X₁ᵀMX₁ = I, and how many others there are.

    X₀ are static responses without mass to forces at the open interface B x, X₀ᵀKX₀ = I: the flexibility of DOF without mass.

    K is indefinite: the weak joints of dual Craig-Bampton parts give as many negative or infinite ω² as multipliers. M is
    positive semidefinite, M = FFᵀ. With s > 0 the eigenvalues θ of Fᵀ(K + sM)⁻¹F are 1/(ω² + s), and x = (K + sM)⁻¹F v/θ.

    How many columns X₁ must have is counted beside. K has one negative eigenvalue for each multiplier, since without these the
    parts and springs are stable. N spans the null space of M; those of NᵀKN that are negative give an infinite ω², the others
    a finite one below 0. So X₁ has rank M - multipliers + (negative eigenvalues of NᵀKN) columns. X₀ = N (NᵀKN)⁻¹NᵀBᵀ, turned.

    Returns
    -------
    X : sparse, shape (n, k)
    unit : ndarray, shape (k,)
        How far each coordinate moves at unit energy.
    matrices : (M, D, K)
        XᵀMX, XᵀDX, XᵀKX, where rigid motion costs exactly nothing.
    spurious : int

    Raises
    ------
    MissedModesError
        Another number was found, or NᵀKN is singular within rounding, so that the number is not known.
    """
    unit, typical = units(M.diagonal(), K.diagonal())  # free coordinates have no stiffness but rounding
    stiffness, inertia = unit[:, None] * K * unit, unit[:, None] * M * unit
    mass, turn = np.linalg.eigh(inertia)
    kept = mass > SINGULAR * mass[-1]
    F = turn[:, kept] * np.sqrt(mass[kept])
    shift = SHIFT * typical
    back = np.linalg.solve(stiffness + shift * inertia, F)
    small = F.T @ back
    theta, V = np.linalg.eigh((small + small.T) / 2)
    finite = np.abs(theta) > SINGULAR * np.abs(theta).max()  # of the others ω² is infinite
    omega2 = np.full(len(theta), -np.inf)
    omega2[finite] = 1 / theta[finite] - shift
    good = np.flatnonzero(omega2 > -EPS**0.5 * shift)  # half of the digits of a rigid motion's θ = 1/shift are kept
    good = good[np.argsort(omega2[good], kind="stable")]
    bare, null = np.linalg.eigh(turn[:, ~kept].T @ stiffness @ turn[:, ~kept])
    expected = int(kept.sum()) - multipliers + int(np.count_nonzero(bare < -ROUNDING))
    # those that are too high for their sign to be known count as infinite
    if not len(good) <= expected <= len(good) + int(np.count_nonzero(~finite)):
        raise MissedModesError(f"{len(good)} finite modes were found in a system of Dual Craig-Bampton parts, but by the rank of "
                               f"M it has {expected}. Its joints are too stiff, or its parts too unlike, for weak joints: reduce "
                               "the parts by CraigChang, which spans the same space")
    # N diag(k)⁻¹NᵀBᵀ with NᵀKN = diag(k). Of a k within rounding the sign is not known, and with it the number of finite modes
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
