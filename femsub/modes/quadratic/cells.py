"""The proof of a count for all values of parameters in a cell at once.

In the setting of `energy_basis`, P(s; θ) = P(s; θ_c) + Σ_q ε_q s^k T_q with |ε_q| ≤ δ_q, each T_q a whole term, unsymmetric or
not. With A⁻¹T_q outside and inside U, and the polar decompositions T_qV = W|T_qV|, T_qᵀV = Z|T_qᵀV| in the norm of A, there are
Q_R = |T_qV|^½ and Q_L = |T_qᵀV|^½, (m, r), such that the blocks of T_q are

    T_UU = Q_L C Q_Rᵀ,   T_LU = B_R Q_Rᵀ,   T_UL = Q_L B_Lᵀ,   ‖C‖ ≤ 1

(mixed Schwarz inequality: |yᴴTx|² ≤ xᴴ|T|x · yᴴ|Tᵀ|y, and the square root is operator monotone). So with δ_q s^k in Q_R and Q_L,
T = P_U⁻¹ at θ_c, R = P_LU, L = P_UL and c for the whole cell, P(s; θ) is regular for all θ in the cell where

    ξ ‖N‖ < 1,   N = | ‖RTL‖/c      ‖RTQ_L‖/√c |,   ξ = η_R η_L,   η = f/2 + √(1 + f²/4),   f = ‖B‖/√c on each side:
                     | ‖Q_RᵀTL‖/√c  ‖Q_RᵀTQ_L‖ |

the Schur complement is P_U + [L Q_L] X [R; Q_Rᵀ] with X = [I 0; B_Lᵀ I] diag(-P_L⁻¹, C) [I B_R; 0 I], whose norm in these units
is at most ξ: η is that of each triangle. (√(‖B_R‖ ‖B_L‖) for both would need another N.) At θ_c it is `Coupling.margin`.
Singular values of T_qV that are too small to matter join as a third kind of column, √ρ I. On a closed curve this shows that as
many eigenvalues are inside for all θ in the cell as at θ_c. N is evaluated in the middle of pieces of the curve; what it changes
over a piece is bounded by sums over eigenpairs.

References: T. Kato, Math. Ann. 125 (1952) 208 (mixed Schwarz inequality); A. T. Patera, G. Rozza (2007), see `energy_basis`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.modes.quadratic.energy_basis import PIECES, SAFE, WIDER, Coupling, EnergyBasis, discs_on, pieces

if TYPE_CHECKING:
    from femsub.modes.quadratic.region import Contour

LEFT = 0.005  # share of the bound that singular values which are left out may take


class WholeTerm(NamedTuple):
    """A whole term T s^power that a parameter changes, by TᵀV and TV in the norm of A.

    Of each: its singular values and vectors, and the Gram matrix of what is outside V.
    """

    power: int
    left: tuple[Array, Array, Array]
    right: tuple[Array, Array, Array]

    @classmethod
    def of(cls, basis: EnergyBasis, halves: Sequence[int], power: int) -> WholeTerm:
        """The term that is the sum of these symmetric and skew ones of the basis."""
        signs = [basis.terms[i].sign for i in halves]
        T = basis.inside[list(halves)].sum(axis=0)  # 0 of a parameter without effect, which has none
        noise = len(halves) * np.diag(basis.noise[list(halves)].sum(axis=0))
        sides = []
        for inner, own in ((T @ T.T, signs), (T.T @ T, [1.0] * len(halves))):
            outer = noise + sum(a * b * basis.lost[i, :, j, :] for i, a in zip(halves, own, strict=True)
                                for j, b in zip(halves, own, strict=True))
            square, vectors = la.eigh(inner + outer)
            sides.append((np.sqrt(np.maximum(square[::-1], 0.0)), vectors[:, ::-1], outer))
        return cls(power, *sides)

    def columns(self, least: float) -> tuple[list[Array], list[float], float]:
        """Q_L and Q_R of singular values above `least`, ‖B_L‖ and ‖B_R‖, and the sum of the next singular values."""
        Q, outside, rest = [], [], 0.0
        for size, vectors, outer in (self.left, self.right):
            k = int(np.count_nonzero(size > least))
            unit = vectors[:, :k] / np.sqrt(size[:k])
            Q.append(unit * size[:k])
            outside.append(float(np.sqrt(max(la.norm(unit.T @ outer @ unit, 2), 0.0))) if k else 0.0)
            rest += float(size[k]) if k < len(size) else 0.0
        return Q, outside, rest


def images(basis: EnergyBasis, sizes: Array) -> tuple[Array, float]:
    """H (p, h, m) with H_iᵀH_j = `basis.lost` of terms of these sizes, and the norm of what it lacks.

    By Cholesky with pivots, which ends at three fifths of the digits.
    """
    p, m = basis.lost.shape[:2]
    scale = np.repeat(sizes, m)
    gram = np.array(basis.lost.reshape(p * m, p * m) * np.outer(scale, scale), order="F")
    whole = float(np.trace(gram))
    factor, order, rank, _ = la.lapack.dpstrf(gram, tol=EPS**0.6 / max(p * m, 1))
    H = np.zeros((rank, p * m))
    H[:, order - 1] = np.triu(factor)[:rank]
    left = max(whole - float(np.einsum("ij,ij->", H, H)), 0.0) + float(scale**2 @ basis.noise.ravel())
    H = np.divide(H, scale, out=np.zeros_like(H), where=scale > 0)
    return np.ascontiguousarray(H.reshape(rank, p, m).transpose(1, 0, 2)), float(np.sqrt(p * left))


class CellBound:
    """ξ‖N‖ on a contour, for all θ with |θ_q - θ_c| ≤ δ_q.

    Parameters
    ----------
    small : Coupling
        At θ_c.
    contour : Contour
    c : float
        For the whole cell.
    changes : sequence of (WholeTerm, float)
        Whole terms with their δ.
    outside : tuple
        `images` of the basis.
    """

    def __init__(self, small: Coupling, contour: Contour, c: float, changes: Sequence[tuple[WholeTerm, float]],
                 outside: tuple[Array, float]) -> None:
        self.changes = changes
        self.small, self.contour, self.c, (self.H, self.left_out) = small, contour, c, outside
        self.lengths = [np.linalg.norm(part, axis=0) for part in (small.x, small.z)]
        whole = max(float((np.abs(self._coefficients(s)) * self.lengths[0] * self.lengths[1]).sum())
                    for s in contour.at(np.linspace(0.0, 1.0, 64)))  # about the largest ‖T‖
        sides = [[np.zeros((len(small.x), 0))], [np.zeros((len(small.x), 0))]]
        powers = [[np.zeros(0)], [np.zeros(0)]]
        square, self.rest = np.zeros(2), 0.0
        for change, delta in changes:
            size = delta * contour.size**change.power
            if not size:
                continue
            Q, norms, rest = change.columns(LEFT / (whole * len(changes) * size))
            for side, power, part in zip(sides, powers, Q, strict=True):
                side.append(part * np.sqrt(delta))
                power.append(np.full(part.shape[1], float(change.power)))
            square, self.rest = square + size * np.square(norms), self.rest + size * rest
        self.Q = []
        for side, own in zip(sides, powers, strict=True):  # the larger columns first
            columns, degrees = np.hstack(side), np.concatenate(own)
            order = np.argsort(-np.linalg.norm(columns, axis=0) * contour.size ** (degrees / 2))
            self.Q.append((columns[:, order], degrees[order]))
        self.QX, self.QZ, self.HX, self.HZ = (np.asarray(part, dtype=np.complex64) for part in (
            self.Q[1][0].T @ small.x, self.Q[0][0].T @ small.z, self.H @ small.x, self.H @ small.z))  # see `at`
        f = np.sqrt((square + self.rest) / c)  # on either side
        self.xi = float(np.prod(f / 2 + np.sqrt(1 + f * f / 4)))
        self.products = small.both_products
        self.each = [np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0)) for own in self.products]

    def at(self, s: complex, reach: float, share: float) -> tuple[Array, float]:
        """N for |s' - s| ≤ reach, ‖RTL‖/c there being `share`; and ξ‖N‖ at s itself.

        Its rows and columns: outside V, the larger and the smaller columns of Q, and √ρ I. Blocks with smaller columns have the
        norm of Frobenius.
        """
        small, basis, root = self.small, self.small.basis, self.c**-0.5
        few = min(WIDER, len(self.QX), len(self.QZ))
        U, V = (part * ((abs(s) + reach) ** (power / 2)).astype(np.float32)[:, None]
                for part, (_, power) in ((self.QX, self.Q[1]), (self.QZ, self.Q[0])))
        weights = np.array([complex(term.weight(np.array(s))) for term in basis.terms])
        signs = np.array([term.sign for term in basis.terms])
        R, L = (np.tensordot((root * own).astype(np.complex64), part, 1)
                for own, part in ((weights, self.HX), (signs * weights.conj(), self.HZ)))
        middle, change = self._coefficients(s).astype(np.complex64), self._changes(s, reach)
        # at s
        rows, columns = [R, U[:few], U[few:]], [L, V[:few], V[few:]]
        N = np.zeros((4, 4))
        N[0, 0] = share
        for a, b in ((0, 1), (0, 2), (1, 0), (2, 0), (1, 1), (1, 2), (2, 1), (2, 2)):
            norm = la.norm if 2 in (a, b) else _norm
            N[a, b] = norm((rows[a] * middle) @ columns[b].conj().T)
        here = self.xi * _norm(N)
        # near s
        of_r, of_l = (root * part[0] for part in small._lengths(np.array([s]), np.array([[reach]]), self.products))
        of_left, of_right = (np.stack([outer, *(np.linalg.norm(part, axis=0) for part in parts[1:]), self.rest**0.5 * whole])
                             for outer, parts, whole in ((of_r, rows, self.lengths[0]), (of_l, columns, self.lengths[1])))
        more = (of_left * change) @ of_right.T
        slopes = root * np.array([float(term.change(np.array(s), np.array(reach))) for term in basis.terms])
        off = root * self.left_out
        more[0, 1:] += of_right[1:] @ (np.abs(middle) * (slopes @ self.each[0] + off * self.lengths[0]))
        more[1:, 0] += of_left[1:] @ (np.abs(middle) * (slopes @ self.each[1] + off * self.lengths[1]))
        crude = (of_left * np.abs(middle)) @ of_right.T
        more += np.finfo(np.float32).eps * len(middle) ** 0.5 * crude  # the products are made in single precision
        more[3], more[:, 3] = more[3] + crude[3], more[:, 3] + crude[:, 3]
        more[0, 0] = 0.0
        return N + more, here

    def _coefficients(self, s: complex) -> Array:
        """1/(λ - s); 0 of infinite λ."""
        return self.small.nu / (1 - (s - self.small.shift) * self.small.nu)

    def _changes(self, s: complex, reach: float) -> Array:
        """Bounds of what they change by within this distance."""
        distance = np.where(self.small.nu != 0, np.abs(self.small.each - s), np.inf)
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(distance), reach / (distance * (distance - reach)), 0.0)

    def margin(self) -> tuple[float, list[Array], Array]:
        """ξ‖N‖ on the contour, at most; directions that lower it; and the share of each change where it fails.

        Infinite where it cannot be shown to be below `SAFE`.
        """
        near, far, _ = self.small.near_and_far(self.contour, self.c)
        beside = self.products[0][near], self.products[1][near]
        start, stop = pieces(64)
        worst, seen, shares = 0.0, 0, np.zeros(len(self.changes))
        while len(start):
            s, reach = discs_on(self.contour, start, stop)
            share, here = (far + self.small._shares(s, size, near, beside).sum(axis=1) / self.c for size in (reach, 0 * reach))
            if (here * self.xi >= SAFE).any():
                return np.inf, [], shares
            halve = np.ones(len(s), dtype=bool)
            for i in np.flatnonzero(share * self.xi < SAFE):
                N, middle = self.at(s[i], reach[i], share[i])
                found = self.xi * _norm(N)
                if found < SAFE:
                    worst, halve[i] = max(worst, found), False
                elif middle >= SAFE:  # halving does not help
                    return np.inf, self._directions(s[i], N), self._blame(s[i])
                seen += 1
            if seen > PIECES // 10 or (stop - start < 1e6 * EPS).any():  # a smaller cell takes less time
                return np.inf, [], shares
            start, stop = start[halve], stop[halve]
            middle = (start + stop) / 2
            start, stop = np.append(start, middle), np.append(middle, stop)
        return worst, [], shares

    def _blame(self, s: complex) -> Array:
        """δ_q ‖|T_qV|^½ T |T_qᵀV|^½‖ of each change at s, about: what halving its range would gain."""
        middle, found = self._coefficients(s), []
        for change, delta in self.changes:
            left, right = (vectors[:, 0] * size[0] ** 0.5 for size, vectors, _ in (change.left, change.right))
            inner = ((right @ self.small.x) * middle) @ (self.small.z.conj().T @ left)
            found.append(delta * abs(s) ** change.power * abs(inner))
        return np.array(found)

    def _directions(self, s: complex, N: Array) -> list[Array]:
        """Residuals of what the changes move most, if the coupling with the outside has the larger share in N."""
        if self.xi * _norm(N[1:, 1:]) >= SAFE**2:
            return []
        middle, found = self._coefficients(s), []
        for x, z, (Q, power), adjoint in ((self.small.x * middle, self.small.z, self.Q[0], False),
                                          (self.small.z * middle.conj(), self.small.x, self.Q[1], True)):
            moved = x @ (z.conj().T @ (Q * abs(s) ** (power / 2)))
            u = la.svd(moved, full_matrices=False)[0][:, :WIDER // 2]
            found.append(self.small.basis.residuals(np.full(u.shape[1], s), u, adjoint))
        return found


def _norm(A: Array) -> float:
    """The largest singular value, by the smaller of the two products."""
    if not A.size:
        return 0.0
    gram = A @ A.conj().T if A.shape[0] < A.shape[1] else A.conj().T @ A
    return float(np.sqrt(max(float(la.eigvalsh(gram, subset_by_index=[len(gram) - 1] * 2, check_finite=False)[0]), 0.0)))
