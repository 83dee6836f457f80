"""The proof of a count for all values of parameters in a cell at once.

In the setting of `energy_basis`, P(s; θ) = P(s; θ_c) + E, E = Σ_q ε_q s^k T_q with |ε_q| ≤ δ_q, each T_q a whole term,
unsymmetric or not. The polar decompositions T_qV = W|T_qV| and T_qᵀV = Z|T_qᵀV| in the norm of A give Q_R = |T_qV|^½ and
Q_L = |T_qᵀV|^½, (m, r). With these the blocks of T_q, inside and outside U, are

    T_UU = Q_L C Q_Rᵀ,   T_LU = B_R Q_Rᵀ,   T_UL = Q_L B_Lᵀ,   ‖C‖ ≤ 1

(mixed Schwarz inequality: |yᴴTx|² ≤ xᴴ|T|x · yᴴ|Tᵀ|y, and the square root is operator monotone). With the factor √(δ_q |s|^k) in
Q_R, Q_L and B, E has blocks of this form with some ‖C‖ ≤ 1. Singular values of T_qV that are too small to matter are not kept one
by one: columns √ρ I stand for all of them.

At θ_c, P_U⁻¹ = XZᴴ + T_f. XZᴴ has the eigenpairs near the contour, with 1/√(λ_k - s) in both x_k and z_k. T_f is the sum over all
other pairs, whose terms largely cancel. If P(s; θ)(u, y) = 0 with u = Xg + T_f v, let p = Q_RᵀT_f v, R' = P_LU + E_LU and
L' = P_UL + E_UL. Then

    g = (ZᴴET_fEX - ZᴴEX) g + ZᴴET_fQ_L C p + (ZᴴET_f - Zᴴ) L' y
    p = -Q_RᵀT_f (EX g + Q_L C p + L' y)
    y = -P_L⁻¹ (R'X g - P_LU T_f (EX g + Q_L C p + L' y) + B_R C p)

Bounds of these blocks form a matrix β ≥ 0, with a row and a column for each near pair, for p and for y; ‖P_L⁻¹‖ ≤ 1/c holds in
the whole cell. If the spectral radius ϱ of β is below 1, the only solution is 0. If this holds on a closed curve, the number of
eigenvalues inside is the same for all θ in the cell as at θ_c. For near pairs the first two orders in E enter exactly. This
matters for friction, where zᴴEx is small compared with ‖Q_Lᵀz‖ ‖Q_Rᵀx‖. In a cluster with nearly dependent vectors, sums over
single pairs are large. Near such a cluster, all pairs belong to T_f.

The curve is divided into pieces, and each piece has its own near pairs. Products with T_f are evaluated in the middle of the
piece. Their change over the piece is bounded by sums over eigenpairs, which decide how fine the pieces must be before anything is
multiplied. The same products serve the finer pieces on which near pairs are bounded.

References: T. Kato, Math. Ann. 125 (1952) 208 (mixed Schwarz inequality); L. Collatz, Math. Z. 48 (1942) 221 (ϱ(β) is at most the
largest (βw)_i / w_i, w > 0); A. T. Patera, G. Rozza (2007), see `energy_basis`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.algebra import times
from femsub.checks import EPS, Array
from femsub.modes.quadratic.energy_basis import NEARBY, PIECES, SAFE, WIDER, Coupling, EnergyBasis, discs_on, of_pieces, pieces

if TYPE_CHECKING:
    from femsub.modes.quadratic.region import Contour

LEFT = 0.005  # share of the bound that truncated singular values may use


class WholeTerm(NamedTuple):
    """A whole term T s^power that a parameter changes, given by TᵀV (`left`) and TV (`right`) in the norm of A.

    Each of the two has its singular values, singular vectors, and the Gram matrix of its components outside V. `inside` is VᵀTV.
    """

    power: int
    inside: Array
    left: tuple[Array, Array, Array]
    right: tuple[Array, Array, Array]

    @classmethod
    def of(cls, basis: EnergyBasis, halves: Sequence[int], power: int) -> WholeTerm:
        """The sum of the basis' symmetric and skew terms with the numbers `halves`, as one whole term."""
        signs = [basis.terms[i].sign for i in halves]
        T = basis.inside[list(halves)].sum(axis=0)  # 0 for a parameter without effect, which has no terms
        noise = len(halves) * np.diag(basis.noise[list(halves)].sum(axis=0))
        sides = []
        for inner, own in ((T @ T.T, signs), (T.T @ T, [1.0] * len(halves))):
            outer = noise + sum(a * b * basis.lost[i, :, j, :] for i, a in zip(halves, own, strict=True)
                                for j, b in zip(halves, own, strict=True))
            square, vectors = la.eigh(inner + outer)
            sides.append((np.sqrt(np.maximum(square[::-1], 0.0)), vectors[:, ::-1], outer))
        return cls(power, T, *sides)

    def columns(self, least: float) -> tuple[list[Array], list[float], float]:
        """Q_L and Q_R of singular values above `least`, ‖B_L‖ and ‖B_R‖, and the sum of the largest values left out."""
        Q, outside, rest = [], [], 0.0
        for size, vectors, outer in (self.left, self.right):
            k = int(np.count_nonzero(size > least))
            unit = vectors[:, :k] / np.sqrt(size[:k])
            Q.append(unit * size[:k])
            outside.append(float(np.sqrt(max(la.norm(unit.T @ outer @ unit, 2), 0.0))) if k else 0.0)
            rest += float(size[k]) if k < len(size) else 0.0
        return Q, outside, rest


def images(basis: EnergyBasis, sizes: Array) -> tuple[Array, float]:
    """H (p, h, m) with H_iᵀH_j ≈ `basis.lost`[i, :, j], and a bound of the norm of its error, for terms of these `sizes` (p,).

    By Cholesky factorisation with pivots, which ends where the pivots fall below eps^0.6 / pm.
    """
    p, m = basis.lost.shape[:2]
    scale = np.repeat(sizes, m)
    gram = np.array(basis.lost.reshape(p * m, p * m), order="F")
    gram *= scale[:, None]
    gram *= scale
    whole = float(np.trace(gram))
    factor, order, rank, _ = la.lapack.dpstrf(gram, tol=EPS**0.6 / max(p * m, 1), overwrite_a=True)
    factor[:rank, :rank] = np.triu(factor[:rank, :rank])
    H = np.zeros((p * m, rank))
    H[order - 1] = factor[:rank].T
    del gram, factor
    left = max(whole - float(np.einsum("ij,ij->", H, H)), 0.0) + float(scale**2 @ basis.noise.ravel())
    np.divide(H, scale[:, None], out=H, where=scale[:, None] > 0)  # other rows are 0
    return H.reshape(p, m, rank).transpose(0, 2, 1), float(np.sqrt(p * left))


class CellBound:
    """Upper bound of ϱ(β)² on a contour, for all θ with |θ_q - θ_c| ≤ δ_q.

    Parameters
    ----------
    small : Coupling
        The eigenpairs at θ_c and their coupling with the outside.
    contour : Contour
    c : float
        The coercivity constant of the whole cell.
    changes : sequence of (WholeTerm, float)
        Whole terms with their δ.
    outside : tuple
        `images` of the basis.
    """

    def __init__(self, small: Coupling, contour: Contour, c: float, changes: Sequence[tuple[WholeTerm, float]],
                 outside: tuple[Array, float]) -> None:
        self.small, self.contour, self.root, (H, self.left_out) = small, contour, c**-0.5, outside
        self.changes = [(change, delta) for change, delta in changes if delta]
        near, _ = small.near(contour)
        self.near = np.flatnonzero(near)
        self.order = np.append(self.near, np.flatnonzero(~near))
        sides = [(part[:, self.near], part[:, self.order]) for part in (small.z, small.x)]  # left, right; of near and all pairs
        self.lengths = [np.linalg.norm(part, axis=0) for _, part in sides]
        self.all_near = np.ones(len(self.near), dtype=bool)
        whole = max(float((np.abs(self._coefficients(s, self.all_near)[self.order]) * self.lengths[0] * self.lengths[1]).sum())
                    for s in contour.at(np.linspace(0.0, 1.0, 64)))  # about the largest ‖T_f‖
        right, left = small.both_products
        self.beside, self.products = [(right[at], left[at]) for at in (self.near, self.order)]
        # columns of Q_L and Q_R with their powers of s, and lengths of images of all pairs: squares in U by powers of s
        parts: list[list[tuple[Array, int]]] = [[], []]
        self.inside = np.zeros((3, len(self.near), len(self.near)))  # |z_jᴴE_UU x_k|
        self.outside = np.zeros((2, 3, len(self.near)))  # of E_UL and E_LU
        self.first: list[tuple[int, Array, Array]] = []  # power, |z_jᴴT_qX| and |ZᴴT_qx_k|
        self.images: list[list[Array]] = [[], []]  # z_jᴴT_q and (T_qx_k)ᵀ, multiplied by |s|^power at the contour's size
        square, self.rest = np.zeros(2), 0.0
        (z, all_z), (x, all_x) = sides
        for change, delta in self.changes:
            power, size = change.power, delta * contour.size**change.power
            Q, norms, rest = change.columns(LEFT / (max(whole, EPS) * len(self.changes) * size))
            for side, (of, columns, (_, _, outer)) in enumerate(zip((z, x), Q, (change.left, change.right), strict=True)):
                parts[side].append((columns * np.sqrt(delta), power))
                self.outside[side, power] += delta * np.sqrt(np.maximum(np.einsum("ik,ik->k", of.conj(), outer @ of).real, 0.0))
            square, self.rest = square + size * np.square(norms), self.rest + size * rest
            images = delta * (z.conj().T @ change.inside), delta * (change.inside @ x)
            self.inside[power] += np.abs(images[0] @ x)
            self.first.append((power, np.abs(images[0] @ all_x), np.abs(all_z.conj().T @ images[1])))
            for several, image in zip(self.images, (images[0], images[1].T), strict=True):
                several.append((image * contour.size**power).astype(np.complex64))
        self.B = np.sqrt((square + self.rest) / c)  # of P_UL and of P_LU
        self.within = [[np.stack([sum((np.abs(columns.T @ of)**2).sum(axis=0) for columns, own in several if own == power)
                                  + self.rest * (power == 0) * (np.abs(of)**2).sum(axis=0) for power in range(3)])
                        for of in side] for side, several in zip(sides, parts, strict=True)]
        # single precision; `norms` bound its rounding, see `_of_far`
        weights = np.transpose([term.weights for term in small.basis.terms])
        signs = np.array([term.sign for term in small.basis.terms])
        self.H = [np.tensordot(self.root * own, H, 1).astype(np.complex64) for own in (signs * weights.conj(), weights)]
        self.parts = parts
        self.Q = [(np.hstack([np.zeros((len(x), 0)), *(columns for columns, _ in several)]).astype(np.float32),
                   np.repeat([power for _, power in several], [columns.shape[1] for columns, _ in several]).astype(int))
                  for several in parts]
        self.norms = [(_norm(columns * contour.size ** (own / 2)) + self.rest**0.5,
                       sum(contour.size**power * la.norm(part) for power, part in enumerate(H)))
                      for (columns, own), H in zip(self.Q, self.H, strict=True)]
        self.moved = [self.root * np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0)) for own in self.products[::-1]]

    def _of_far(self, s: complex, reach: float, single: Array) -> Array:
        """The products with T_f that `_bound` needs, at s and for all |s' - s| ≤ reach, in two rows (2, 4 + 2n + n²).

        T_f is the sum over all pairs but the near pairs chosen by `single` (n,). With R = P_LU and L = P_UL, a row has
        ‖Q_RᵀT_fQ_L‖, ‖RT_fQ_L‖/√c, ‖Q_RᵀT_fL‖/√c and ‖RT_fL‖/c; then for the chosen pairs, others are 0, ‖z_jᴴET_fQ_L‖,
        ‖Q_RᵀT_fEx_k‖ and |z_jᴴET_fEx_k|.
        """
        small, powers, weights, root = self.small, (abs(s) + reach) ** np.arange(3), self._coefficients(s, single), self.rest**0.5
        exact = small.pairs.sum(weights)
        whole, T = la.norm(exact), exact.astype(np.complex64)  # summed in single precision, clusters would lose all digits
        turned = np.ascontiguousarray(T.T)
        Q_L, Q_R = (part * np.sqrt(powers).astype(np.float32)[power] for part, power in self.Q)
        degrees = (s ** np.arange(3)).astype(np.complex64)
        L, R = (np.tensordot(own, part, 1) for own, part in zip((degrees.conj(), degrees), self.H, strict=True))
        TQ, QT, TL, RT = times(Q_L.T, turned).T, times(Q_R.T, T), T @ L.conj().T, R @ T
        # each change has its own power of s
        own = np.array([(powers[power] / self.contour.size**power) for power, *_ in self.first], dtype=np.float32)
        zE, xE = (own[:, None, None] * np.stack([image[single] for image in part]) for part in self.images)
        zT, xT = zE @ T, xE @ turned
        # for each pair the lengths of the vectors on both sides of T_f: images in Q and outside
        of_z, of_x = (np.hypot(la.norm(times(Q.T, part.reshape(-1, len(T)).T), axis=0).reshape(part.shape[:2]),
                               root * la.norm(part, axis=2)).sum(axis=0) for Q, part in ((Q_L, zT), (Q_R, xT)))
        second = np.abs(zT.reshape(-1, len(T)) @ xE.reshape(-1, len(T)).T).reshape(zT.shape[:2] + xT.shape[:2]).sum(axis=(0, 2))
        few = np.array([la.norm([[_norm(times(Q_R.T, TQ)), root * la.norm(QT)], [root * la.norm(TQ), self.rest * whole]], 2),
                        np.hypot(_norm(times(Q_L.T, RT.T)), root * la.norm(RT)),
                        np.hypot(_norm(times(Q_R.T, TL)), root * la.norm(TL)), la.norm(RT @ L.conj().T)])
        # the rounding of products in single precision
        (of_L, outside_L), (of_R, outside_R) = self.norms
        digits = len(T) ** 0.5 * (np.finfo(np.float32).eps * whole
                                  + EPS * (self.lengths[1] * np.abs(weights[self.order])) @ self.lengths[0])
        z, x = (la.norm(np.abs(part).sum(axis=0), axis=1) for part in (zE, xE))
        n = len(single)
        here = np.zeros(4 + 2 * n + n * n)
        here[:4] = few + digits * np.array([of_L * of_R, of_L * outside_R, of_R * outside_L, outside_R * outside_L])
        here[4:4 + n][single], here[4 + n:4 + 2 * n][single] = of_z + digits * z * of_L, of_x + digits * x * of_R
        here[4 + 2 * n:].reshape(n, n)[np.ix_(single, single)] = second + digits * np.outer(z, x)
        return np.stack([here, here + self._change(s, reach, single)])

    def _change(self, s: complex, reach: float, single: Array) -> Array:
        """Bounds of the changes of the products in `_of_far` for |s' - s| ≤ reach, by sums over pairs, (4 + 2n + n²,)."""
        small, powers, size = self.small, (abs(s) + reach) ** np.arange(3), np.abs(self._coefficients(s, single))[self.order]
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = np.where(size > 0, np.abs(small.each[self.order] - s), np.inf)
            change = np.where(distance > reach, size * reach / (distance - reach), np.inf)
        if not np.isfinite(change).all():
            return np.full(4 + (2 + len(self.near)) * len(self.near), np.inf)
        columns = [np.sqrt(powers @ part) for _, part in self.within]
        images = [self.root * part[0]
                  for part in small._lengths(np.array([s]), np.array([[reach]]), self.products)[::-1]]
        slopes = np.array([float(term.change(np.array(s), np.array(reach))) for term in small.basis.terms])
        moved = [slopes @ own + self.root * self.left_out * whole  # of images by L and R, from those at s
                 for own, whole in zip(self.moved, self.lengths, strict=True)]
        zs, xs = (sum(powers[one[0]] * one[k] for one in self.first) for k in (1, 2))
        return np.hstack([(columns[1] * change) @ columns[0],
                          (images[1] * change + moved[1] * size) @ columns[0],
                          columns[1] @ (change * images[0] + size * moved[0]),
                          (images[1] * change + moved[1] * size) @ images[0] + (images[1] * size) @ moved[0],
                          zs @ (change * columns[0]), (columns[1] * change) @ xs, ((zs * change) @ xs).ravel()])

    def _bound(self, s: Array, reach: Array, of_far: Array, single: Array, *, coupled: bool = True) -> Array:
        """Upper bounds (l,) of ϱ(β)² for |s' - s| ≤ reach; without the coupling to the outside if not `coupled`."""
        n, (to_u, from_u) = len(self.near), self.B
        powers = (np.abs(s) + reach)[:, None] ** np.arange(3)
        near = self._distance(s, reach)
        near = np.where(single, np.where(near > 0, near, np.nan), np.inf)
        a = np.sqrt(np.abs(self.small.nu[self.near]) / near)
        images = self.small._lengths(s, reach[:, None], self.beside)[::-1]
        columns = [np.sqrt(powers @ part) for part, _ in self.within]
        L, R = (self.root * (own + powers @ part) for own, part in zip(images, self.outside, strict=True))
        known = np.isfinite(of_far).all(axis=1)
        of_far = np.where(known[:, None], of_far, 0.0)
        QQ, RQ, QL, RL = of_far.T[:4]
        to_p, of_p, second = np.split(of_far[:, 4:], [n, 2 * n], axis=1)
        second = a[:, :, None] * second.reshape(len(s), n, n) * a[:, None]
        gp, pg = a * to_p, a * of_p
        gy, yg = coupled * a * (L + to_p * to_u + QL[:, None] * columns[0]), coupled * a * (R + RQ[:, None] * columns[1])
        few = np.stack([QQ, (QL + QQ * to_u) * coupled, (RQ + from_u) * coupled, (RL + RQ * to_u) * coupled])
        found = _radius(a[:, :, None] * np.tensordot(powers, self.inside, 1) * a[:, None] + second, gp, gy, pg, yg, few)
        return np.where(np.isfinite(a).all(axis=1) & known, found**2, np.inf)

    def _coefficients(self, s: complex, single: Array) -> Array:
        """1/(λ - s) of all pairs; 0 for infinite λ, and for the near pairs chosen by `single` (n,)."""
        found = self.small.nu / (1 - (s - self.small.shift) * self.small.nu)
        found[self.near[single]] = 0.0
        return found

    def _single(self, s: Array, reach: Array, apart: Array) -> Array:
        """The pairs near pieces of the contour, for those pieces where they are to be `apart`, (l, n)."""
        return (self._distance(s, reach) <= NEARBY) & apart[:, None]

    def _distance(self, s: Array, reach: Array) -> Array:
        """Lower bounds of |s' - λ|/|λ - σ| of the near pairs for |s' - s| ≤ reach, (l, n)."""
        return self.small._apart(s, self.near) - reach[:, None] * np.abs(self.small.nu[self.near])

    def margin(self) -> tuple[float, list[Array], Array, complex]:
        """Upper bound of ϱ(β)² on the contour, directions that lower it, the share of each change where it fails, and s there.

        Near pairs are treated one by one, except where this makes the bound too large, as in a cluster of nearly dependent
        vectors. If the bound is not below `SAFE` everywhere, the value returned is that at s, or on a piece about s.
        """
        every, zero = self.contour.at(np.linspace(0.0, 1.0, 128)), np.zeros(1)
        none = np.zeros((128, 4 + (2 + len(self.near)) * len(self.near)))
        least = self._bound(every, np.zeros(128), none, np.tile(self.all_near, (128, 1)))
        at = every[[least.argmax()]]  # most cells that are too large fail here
        chosen = [self._single(at, zero, np.array([apart])) for apart in (True, False)]
        best = min(((self._of_far(at[0], 0.0, single[0])[:1], single) for single in chosen),
                   key=lambda one: float(self._bound(at, zero, *one)[0]))
        if (bound := float(self._bound(at, zero, *best)[0])) >= SAFE:
            return bound, self._directions(at, *best), self._blame(at[0]), at[0]
        start, stop, apart = self._divided(*pieces(12), np.ones(12, dtype=bool))
        s, reach = discs_on(self.contour, start, stop)
        single = self._single(s, reach, apart)
        worst, seen = 0.0, 0
        of_far = of_pieces(self._of_far, s, reach, single)
        while len(start):
            found = self._bound(s, reach, of_far[:, 1], single)
            good, seen = found < SAFE, seen + len(s)
            worst = max(worst, float(found[good].max(initial=0.0)))
            start, stop, s, reach = (part[~good] for part in (start, stop, s, reach))
            of_far, apart, single = (part[~good] for part in (of_far, apart, single))
            if not len(s):
                break
            if seen > PIECES // 100 or (stop - start < 1e6 * EPS).any():  # a smaller cell is faster
                return float(found[~good][0]), [], self._blame(s[0]), s[0]
            here, coarse = (self._bound(s, 0 * reach, of_far[:, k], single) >= SAFE for k in range(2))
            if (here & ~apart).any():  # halving does not help
                k = int(np.argmax(here & ~apart))
                return float(found[~good][k]), self._directions(s[[k]], of_far[k, :1], single[[k]]), self._blame(s[k]), s[k]
            middle = np.where(here, stop, (start + stop) / 2)
            again = np.append(coarse, coarse[~here])
            start, stop = np.append(start, middle[~here]), np.append(middle, stop[~here])
            apart = np.append(apart & ~here, apart[~here])
            of_far, single = (np.concatenate([part, part[~here]]) for part in (of_far, single))
            if again.any():
                more = self._divided(start[again], stop[again], apart[again])
                start, stop, apart = (np.append(part[~again], own) for part, own in zip((start, stop, apart), more, strict=True))
                discs = discs_on(self.contour, *more[:2])
                new = self._single(*discs, more[2])
                of_far, single = (np.concatenate([part[~again], own])
                                  for part, own in ((of_far, of_pieces(self._of_far, *discs, new)), (single, new)))
            s, reach = discs_on(self.contour, start, stop)
        return worst, [], np.zeros(len(self.changes)), 0j

    def _divided(self, start: Array, stop: Array, apart: Array) -> tuple[Array, Array, Array]:
        """The pieces, halved until the change of T_f alone does not make the bound fail. This takes no products of matrices."""
        done = [np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)]
        while len(start):
            s, reach = discs_on(self.contour, start, stop)
            single = self._single(s, reach, apart)
            change = np.array([self._change(*one) for one in zip(s, reach, single, strict=True)])
            without, with_it = (self._bound(s, 0 * reach, one, single) for one in (np.zeros_like(change), change))
            coarse = (with_it >= SAFE / 2) & (without < SAFE / 4) & (stop - start > 1e6 * EPS)
            done = [np.append(own, part[~coarse]) for own, part in zip(done, (start, stop, apart), strict=True)]
            start, stop, apart = start[coarse], stop[coarse], apart[coarse]
            middle = (start + stop) / 2
            start, stop, apart = np.append(start, middle), np.append(middle, stop), np.append(apart, apart)
        return done[0], done[1], done[2]

    def _blame(self, s: complex) -> Array:
        """Estimate of the gain from halving each change's range: its share in β, from each near pair and from all others
        together.

        A sum over all pairs would overrate a change that moves many shapes, such as that of a whole part's stiffness.
        """
        small, T = self.small, self.small.pairs.sum(self._coefficients(s, self.all_near))
        size = np.abs(small.nu[self.near]) / np.maximum(small._apart(np.array([s]), self.near)[0], EPS)
        found = []
        for (power, *_), left, (own_left, _), (own_right, _) in zip(self.first, self.images[0], *self.parts, strict=True):
            near = np.abs(np.einsum("ki,ik->k", left, small.x[:, self.near])) @ size / self.contour.size**power
            found.append(abs(s)**power * (float(near) + _norm(own_right.T @ T @ own_left)))
        return np.array(found)

    def _directions(self, at: Array, of_far: Array, single: Array) -> list[Array]:
        """Residuals of the directions that the changes move most; none if the bound fails without the coupling to the outside."""
        s = at[0]
        if self._bound(at, np.zeros(1), of_far, single, coupled=False)[0] >= SAFE / 4:  # then a smaller cell gains more
            return []
        small, found = self.small, []
        middle = small.nu / (1 - (s - small.shift) * small.nu)
        for x, z, (Q, power), adjoint in ((small.x * middle, small.z, self.Q[0], False),
                                          (small.z * middle.conj(), small.x, self.Q[1], True)):
            moved = x @ (z.conj().T @ (Q * abs(s) ** (power / 2)))
            u = la.svd(moved, full_matrices=False)[0][:, :WIDER // 2]
            found.append(small.basis.residuals(np.full(u.shape[1], s), u, adjoint))
        return found


def _radius(gg: Array, gp: Array, gy: Array, pg: Array, yg: Array, few: Array) -> Array:
    """Upper bounds of the spectral radii of [gg gp gy; pg QQ py; yg yp yy] ≥ 0 (l, n + 2, n + 2), by Collatz's quotients."""
    n, (pp, py, yp, yy) = gp.shape[1], few[:, :, None]
    w, found = np.ones((len(gp), n + 2)), np.full(len(gp), np.inf)
    for _ in range(WIDER):
        g, p, y = w[:, :n], w[:, n:n + 1], w[:, n + 1:]
        new = np.hstack([(gg @ g[:, :, None])[:, :, 0] + gp * p + gy * y,
                         (pg * g).sum(axis=1, keepdims=True) + pp * p + py * y,
                         (yg * g).sum(axis=1, keepdims=True) + yp * p + yy * y])
        found = np.fmin(found, (new / w).max(axis=1))
        w = (w + new) / (w + new).max(axis=1, keepdims=True)
    return found


def _norm(A: Array) -> float:
    """The largest singular value, from the smaller of AAᴴ and AᴴA."""
    if not A.size:
        return 0.0
    gram = A @ A.conj().T if A.shape[0] < A.shape[1] else A.conj().T @ A
    return float(np.sqrt(max(float(la.eigvalsh(gram, subset_by_index=[len(gram) - 1] * 2, check_finite=False)[0]), 0.0)))
