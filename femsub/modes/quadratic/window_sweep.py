"""Proved crossings of eigenvalues over lines in the plane of s, for all values of a parameter of any rank.

P(s; ε) = P(s) + ε T(s), where T acts through any number of columns, inside U and outside (see `energy_basis`). In a window,
ε = m + t with |t| ≤ h, the eigenpairs of P_U at m give P_U⁻¹ = X(Λ - s)⁻¹Zᴴ + T_f(s). X, Λ and Z have the n pairs near the lines,
T_f has all others. If P(s; ε)(u, y) = 0, then u = Xg + q with

    (Λ - s) g + Zᴴ(tTu + P_ULy) = 0,   q = -T_f(tTu + P_ULy),   y = -P_L⁻¹P_LU u.

With T(s)x_j = T(λ_j)x_j + (s - λ_j) T'_j x_j, B_ij = z_iᴴT(λ_j)x_j, N_ij = z_iᴴT'_jx_j, and q inserted once into tZᴴTq,

    (Λ - s) g + (I - tN)⁻¹ [tB - t²Q] g + (I - tN)⁻¹ [-t²ZᴴTT_fT q + (ZᴴP_UL - tZᴴTT_fP_UL) y] = 0,   Q = ZᴴTT_fTX,

and (I - tN)⁻¹ (tB - t²Q) = tB + t²(NB - Q) + t³N(I - tN)⁻¹(NB - Q). To turn the vectors to first order, g = (I + tX̂)g' with
x̂_ij = b_ij / (λ_j - λ_i) as in `femsub.stability.exclusion`, b = diag B: then

    (λ_i - s + t b_i) g'_i + Σ_j e_ij(s, t) g'_j = 0,   |e_ij| ≤ f_ij  for all complex |t| ≤ h,  |s - s_c| ≤ d,
    F = (I - h|X̂|)⁻¹ (h|B'| + h²|BX̂ - X̂b + NB - Q| + h³ …) + the terms of q and y.

Norms bound |q| and |y| by |g|, in units in which Re P_L ≥ 1:

    |q| ≤ Σ h‖T_fTx_j‖ |g_j| + h‖T_fT‖ |q| + ‖T_f‖‖P_UL‖ |y|,   |y| ≤ Σ ‖P_LUx_j‖ |g_j| + ‖P_LU‖ |q|.

So P(s; ε) is regular where the spectral radius of f_ij / |λ_i - s + t b_i| is below 1. A tile is an interval of a line and an
interval of ε in a window. Tiles are halved until that holds, or until they lie in the rectangle |s - s_0| ≤ a, |ε - ε_0| ≤ b of
one crossing. For this rectangle, all other g'_j of a window about ε_0 are eliminated from the equation of one g'_i. Along the
line s = s_0 + τ d this leaves

    φ(τ, t) = (λ_i - s_0) - τ d + t b_i + ρ(τ, t) = 0,   |ρ| ≤ r = f_ii + f_i.(D - F)⁻¹f_.i

for complex |τ| ≤ a and |t| ≤ b; D is the diagonal matrix of the smallest |λ_j - s + t b_j| of the other pairs. For complex ε, c
is smaller by |Im ε| Σ |s^k| g, where g is a bound of |xᴴTx| / xᴴAx. With the smallest singular value σ of the real
matrix of (-a d, b b_i),

- all real zeros with |τ| ≤ a and |t| ≤ b are in the ellipse with the radius ϱ = (r + |λ_i - s_0|) / σ in (τ/a, t/b), and if
  ϱ < 1/2 their number is odd (degree);
- where |τ| ≤ a/2 and |t| ≤ b/2, ρ has derivatives of at most 2r/a and 2r/b (Cauchy). So if σ > 2√2 r, there is at most one zero.

The direction of the crossing is known, since dλ/dε is about b_i. All this also holds with any fraction of the coupling to the
outside. So in a region enclosed by lines without crossings P has as many eigenvalues as P_U.

T_f and Q are evaluated at s_c. For |s - s_c| ≤ d a product of polynomials and of the series of 1/(λ_k - s) about s_c changes by
no more than the same product of all moduli, at d, minus its value at 0. ‖T_f‖ follows from its Taylor series, with Frobenius
norms except for its value at one point. ‖P_LU‖ at one s is a convex function of ε. Rounding is included: with S, the sum over
LAPACK's pairs, SP_U = I + Σ x_k r_k / (λ_k - s) + E_0 as in `axis_sweep`. Then r_k u joins the equation of g_k, and the other
terms join that of q.

References: as for `energy_basis`; R. S. Varga, Geršgorin and His Circles (2004); L. Collatz, Math. Z. 48 (1942) 221 (the spectral
radius of F ≥ 0 is at most the largest (Fw)_i / w_i, w > 0).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, NotConvergedError
from femsub.modes.quadratic.axis_sweep import Line, Met, Sweep, residuals_of
from femsub.modes.quadratic.energy_basis import Coupling, each_of, eigenpairs

if TYPE_CHECKING:
    from femsub.modes.quadratic.projected_count import Projection

log = logging.getLogger(__name__)

NEAREST = 130  # largest number of eigenpairs treated one by one in a window
PARTS = 14  # intervals of the range to begin with
BELOW = 0.98  # required spectral radius; the theorem needs 1


class Crossed(NamedTuple):
    """The only crossing of line `of` in |t - t_0| ≤ a, |ε - ε_0| ≤ b."""

    of: int
    met: Met
    value: float
    room: float

    def holds(self, tiles: Array) -> Array:
        """Which tiles (l, 5) - line, t, half width, ε, half width - lie inside, bool."""
        of, t, h, e, b = tiles.T
        return np.asarray((of == self.of) & (np.abs(t - self.met.at) + h <= self.met.room) & (
            np.abs(e - self.value) + b <= self.room))

    @property
    def tile(self) -> Array:
        """The tile (1, 5) in which the crossing certainly lies."""
        (a, b), (c, d) = self.met.between, self.met.values
        return np.array([[self.of, (a + b) / 2, (b - a) / 2, (c + d) / 2, (d - c) / 2]])


class WindowSweep(Sweep):
    """A `Sweep` along several lines at once, window by window of ε.

    Raises
    ------
    NotConvergedError
        c is not positive for all ε.
    """

    def __init__(self, projection: Projection, weights: Sequence[float], between: tuple[float, float]) -> None:
        super().__init__(projection, weights, between)
        self.weights, m, size = np.array(weights), projection.size, projection.outer.size
        lost = projection.lost  # evaluated once, for all copies by `changed`
        self.most = 1.02 * max(map(abs, between))
        widest = projection.changed(np.abs(self.weights) * self.most)
        if (c := widest.least) <= 0:
            raise NotConvergedError(f"for some value of the parameter, forces of shapes outside the basis may reach "
                                    f"{1 - c:.2g} times their stiffness")
        self.c = 0.9 * c  # a tenth is reserved for complex ε
        self.signs = np.array([term.sign for term in self.terms])
        grows = 0.0  # Σ |s^k| g
        for slope, term in zip(self.slope, self.terms, strict=True):
            if slope.any() and not term.spanned:  # for a skew T the range is known only if real ε need it
                g = max(map(abs, term.range))
                g = g if np.isfinite(g) else projection.norm(term)
                grows += g * float(np.abs(slope) @ size ** np.arange(3))
        self.reach = min(0.02 * max(map(abs, between)), 0.1 * c / grows if grows else np.inf)  # of complex ε
        self.powers = [k for k in range(3) if self.T[k].any()]
        self.sizes = np.array([la.norm(A, 2) for A in self.T])
        largest = np.array([term.largest(size) for term in widest.terms])
        self.rounding = 8 * EPS * m**-0.5 * float(np.append(1.0, largest) @ [
            la.norm(one, 2) for one in projection.sizes(projection.V)])
        self.rounding += 8 * EPS * float(size ** np.arange(3) @ [
            la.norm(np.abs(A), 2) + self.most * la.norm(np.abs(B), 2) for A, B in zip(self.P, self.T, strict=True)])
        # ‖images outside V‖ of each term
        self.outside = np.array([np.hypot(_root(lost[i, :, i]), own.max() ** 0.5) for i, own in enumerate(projection.noise)])
        # ‖P_LU‖ and ‖P_ULᴴ‖ at one s are convex functions of ε: no larger between values than their chords
        self.middle, values = complex(sum(self.outer.re), self.outer.top) / 2, np.linspace(-self.most, self.most, 5)
        self.at_middle = values, np.array([max(map(_root, projection.changed(self.weights * e).products(self.middle)))
                                           for e in values])
        self.solved = 0

    def swept(self, lines: Sequence[Line], least: float = 5e-4, most: int = 80
              ) -> list[tuple[list[Met], list[tuple[float, float]]]]:
        """All crossings of each line; or no crossings, and the pieces (of t) in which crossings are not decided.

        Crossings are not decided if an interval of ε becomes as short as `least` of the range, or if more than `most` windows
        were needed.
        """
        corners = np.array([one.start + t * one.along for one in lines for t in (0.0, one.length)])
        if corners.imag.max() > self.outer.top or corners.real.min() < self.outer.re[0] or corners.real.max() > self.outer.re[1]:
            raise ValueError("a line leaves the region of the projection")
        self.lines, same = lines, EPS**0.5 * np.array([1.0, self.outer.size, self.most])
        known: list[Crossed] = []
        waiting = list(pairwise(np.linspace(*self.between, PARTS + 1).tolist()))
        while waiting:
            log.info("%d intervals of the parameter, from %.4g on", len(waiting), waiting[0][0])
            found = each_of(self._tested, *zip(*waiting, strict=True))
            starts: list[tuple[int, float, float]] = []
            for place in (one for _, places in found for one in places):
                tile = np.array([[place[0], place[1], 0.0, place[2], 0.0]])
                if not any(one.holds(tile)[0] for one in known) and not any(
                        (np.abs(np.subtract(place, other)) <= same).all() for other in starts):
                    starts.append(place)
            for one in each_of(self._crossing, *zip(*starts, strict=True)) if starts else []:
                if one is not None and not any(one.holds(other.tile)[0] or other.holds(one.tile)[0] for other in known):
                    known.append(one)
            again: list[tuple[float, float]] = []
            left, narrow = [np.zeros((0, 5))], False
            for (a, b), (tiles, _) in zip(waiting, found, strict=True):
                for one in known:
                    tiles = tiles[~one.holds(tiles)]
                if len(tiles):
                    lo, hi = max(a, float((tiles[:, 3] - tiles[:, 4]).min())), min(b, float((tiles[:, 3] + tiles[:, 4]).max()))
                    again += [(lo, hi)] if hi - lo <= 0.6 * (b - a) else [(lo, (lo + hi) / 2), ((lo + hi) / 2, hi)]
                    left.append(tiles)
                    narrow |= b - a <= least * (self.between[1] - self.between[0])
            if narrow or self.solved + len(again) > most:
                log.info("the sweep ends with %d open tiles: %s", sum(map(len, left)), "an interval is as short as allowed" if
                         narrow else f"it takes at least {self.solved + len(again)} windows, and the limit is {most}")
                of, t, h, *_ = np.vstack(left).T
                return [([], [(float(a - b), float(a + b)) for a, b in zip(t[of == k], h[of == k], strict=True)])
                        for k in range(len(lines))]
            waiting = again
        return [(sorted(one.met for one in known if one.of == of), []) for of in range(len(lines))]

    def _tested(self, begin: float, end: float) -> tuple[Array, list[tuple[int, float, float]]]:
        """Tiles (l, 5) in which a crossing is not excluded, and estimated places of crossings near them: line, t, ε."""
        m, h = (begin + end) / 2, (end - begin) / 2 * (1 + 4 * EPS)
        self.solved += 1
        window = Window(self, m)
        tiles, places = window.tested(h), []
        for i, at, value in window.candidates(tiles):
            line = self.lines[i]
            found = self.place(line, at, value)
            if found is not None and abs(found[1] - m) <= 1.1 * h and -0.01 * line.length <= found[0] <= 1.01 * line.length:
                places.append((i, *found))
        return tiles, places

    def place(self, line: Line, t: float, value: float, steps: int = 12) -> tuple[float, float] | None:
        """(t, ε) where an eigenvalue of P_U is on the line."""
        for _ in range(steps):
            if not abs(value) <= 1.01 * self.most:
                return None
            move, rate = (part / line.along for part in self.shapes(line.start + t * line.along, value)[2:])
            if not rate.imag:
                return None
            step = -move.imag / rate.imag
            t, value = t + move.real + rate.real * step, value + step
            if abs(move) <= EPS**0.5 * self.outer.size and abs(step) <= EPS**0.5 * self.most:
                return t, value
        return None

    def _crossing(self, of: int, t: float, value: float) -> Crossed | None:
        """The rectangle around (t, ε) in which it is proved that the line `of` has one crossing; None if it is not proved."""
        line = self.lines[of]
        s = line.start + t * line.along
        room = min(self.outer.top - s.imag, s.real - self.outer.re[0], self.outer.re[1] - s.real)
        b = min(self.reach, self.most - abs(value))
        if room <= 0 or b <= 0:
            return None
        self.solved += 1
        window = Window(self, value)
        if not len(window.lam):
            return None
        i = int(np.abs(window.lam - s).argmin())
        rate = complex(window.B[i, i] / line.along)
        off = complex((window.lam[i] - s) / line.along)
        found: Crossed | None = None
        for _ in range(20):
            a = min(max(abs(rate) * b, 1e-9 * self.outer.size), room)
            r = window.single(s, a, b, i)
            sigma = float(la.svd(np.array([[-a, rate.real * b], [0.0, rate.imag * b]]), compute_uv=False)[-1])
            q = (r + abs(off)) / sigma if sigma else np.inf
            if q < 0.25 and sigma > 2 * 2**0.5 * r:
                between, values = (t - q * a, t + q * a), (value - q * b, value + q * b)
                if found is None:
                    found = Crossed(of, Met(t, a, between, values, bool(rate.imag > 0)), value, b)
                elif q * b < 0.5 * (found.met.values[1] - value):  # the same crossing in narrower bounds
                    found = found._replace(met=found.met._replace(between=between, values=values))
                else:
                    break
            elif found is not None:
                break
            b /= 3
        return found


class Segment(NamedTuple):
    """Bounds for |s' - s| ≤ d, see `Window.segment`."""

    reach: float
    N: Array
    Q: Array
    off: Array
    column: Array
    row: Array
    far: float
    far_T: float
    size: float
    fed: Array
    wrong: float
    lengths: tuple[Array, Array, Array, Array]
    outside: tuple[float, float]


class Window:
    """The eigenpairs of P_U at one value of ε, and bounds about it."""

    def __init__(self, sweep: WindowSweep, value: float) -> None:
        self.sweep, self.value, T = sweep, value, sweep.T
        matrices = sweep.P + value * T
        (shift, nu, x, z), *_ = eigenpairs(matrices, sweep.outer.size)
        with np.errstate(divide="ignore", invalid="ignore"):
            lam = np.where(nu != 0, shift + 1 / nu, np.inf)
        corners = np.array([one.start + t * one.along for one in sweep.lines for t in (0.0, one.length)])
        away = np.hypot(np.maximum(0, np.maximum(corners.real.min() - lam.real, lam.real - corners.real.max())),
                        np.maximum(0, np.maximum(corners.imag.min() - lam.imag, lam.imag - corners.imag.max())))
        away = np.where(np.isfinite(lam), away, np.inf)
        self.clear = min(0.7 * sweep.outer.top, float(np.sort(away)[min(NEAREST, len(away) - 1)]))
        near = away < self.clear
        self.shift, self.lam, self.x, self.z = shift, lam[near], x[:, near], z[:, near]
        self.far = nu[~near], lam[~near], x[:, ~near], z[:, ~near].conj().T
        _, _, X, Z = self.far
        left = self.z.conj().T
        rows, images = [left @ A for A in T], [A @ self.x for A in T]
        self.fed = np.stack([la.norm(part, axis=1) for part in rows])  # ‖z_iᴴT‖
        self.left, self.right = np.stack([part @ X for part in rows]), np.stack([Z @ part for part in images])
        own = [left @ part for part in images]
        self.B = own[0] + own[1] * self.lam + own[2] * self.lam**2
        self.N = own[1] + own[2] * self.lam, own[2]
        self.lengths = [la.norm(part, axis=0) for part in (self.x, self.z)]
        self.far_lengths = la.norm(X, axis=0), la.norm(Z, axis=1)
        gram = X.conj().T @ X
        # of Σ e_k x_k z_kᴴT_p, or without T_p: the form of squares of Frobenius norms, lengths of rows, the norm at one point
        self.begin, self.forms = self._each(corners[:2].mean()), []
        for rows in (Z, *(Z @ T[k] for k in sweep.powers)):
            T_f = (X * self.begin) @ rows
            self.forms.append((gram * (rows @ rows.conj().T).conj(), la.norm(rows, axis=1), _root(T_f.conj().T @ T_f)))
        here = sweep.projection.changed(sweep.weights * value)
        self.small = Coupling(here, shift, nu, x, z, sweep.outer.size)
        self.products = self.small._products(self.x), self.small._products(self.z)
        constant, growing, each = residuals_of(matrices, shift, nu, x, z)
        self.off, self.own = (constant, growing, each[~near]), each[near]

    def _each(self, s: complex) -> Array:
        """1/(λ - s) of the far pairs."""
        nu = self.far[0]
        return nu / (1 - (s - self.shift) * nu)

    def segment(self, s: complex, d: float) -> Segment | None:
        """The bounds that `rest` takes, for all |s' - s| ≤ d; None if d is too large."""
        sweep, (nu, lam, X, Z) = self.sweep, self.far
        each, distance = self._each(s), np.where(nu != 0, np.abs(lam - s), np.inf)
        if not (distance > 1.5 * d).all():
            return None
        largest, size = 1 / (distance - d), np.abs(each)
        heres, bounds = [], []  # polynomials at s, and of their entries for |s' - s| ≤ d
        for constant, linear, square in (self.left, self.right):
            heres.append(constant + s * (linear + s * square))
            bounds.append(np.abs(heres[-1]) + d * (np.abs(linear + 2 * s * square) + d * np.abs(square)))
        (a, b), (A, B) = heres, bounds
        off = np.maximum((A * largest) @ B - (np.abs(a) * size) @ np.abs(b), 0.0)
        of_x, of_z = self.far_lengths
        column = la.norm((X * each) @ b, axis=0) + of_x @ (B * largest[:, None] - np.abs(b) * size[:, None])
        row = la.norm((a * each) @ Z, axis=1) + (A * largest - np.abs(a) * size) @ of_z
        # T_f and T_fT: by their Taylor series
        series = [each - self.begin, *(d**k * each ** (k + 1) for k in range(1, 4))]
        rest = (d / distance) ** 4 * largest * of_x
        norms = []
        for form, of_row, begin in self.forms:
            squares = [float((e.conj() @ form @ e).real) + len(e) * EPS * float(np.abs(e) * of_x @ of_row) ** 2 for e in series]
            norms.append(begin + sum(max(square, 0.0) ** 0.5 for square in squares) + float(rest @ of_row))
        most = (abs(s) + d) ** np.arange(3)
        far, far_T = norms[0], float(most[sweep.powers] @ norms[1:])
        constant, growing, own = self.off
        wrong = far * sweep.rounding + float((largest * of_x) @ own) + constant + growing * (abs(s - self.shift) + d)
        return Segment(d, self.N[0] + s * self.N[1], (a * each) @ b, off, column, row, far, far_T, float(most @ sweep.sizes),
                       most @ self.fed, wrong, *self._outside(s, d))

    def _outside(self, s: complex, d: float) -> tuple[tuple[Array, Array, Array, Array], tuple[float, float]]:
        """Bounds of ‖P_LU x_j‖ and ‖z_iᴴP_UL‖, the same for T, and norms of P_LU and T outside, in units in which P_L ≥ 1."""
        sweep, root = self.sweep, self.sweep.c**-0.5
        lengths = [root * part[0] for part in self.small._lengths(np.array([s]), np.array([[d]]), self.products)]
        _, linear, square = sweep.slope.T
        weight, change = sweep.slope @ [1.0, s, s * s], d * (np.abs(linear + 2 * s * square) + d * np.abs(square))
        for own, w in zip(self.products, (weight, sweep.signs * weight.conj()), strict=True):
            sizes = np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0))
            here = np.einsum("a,kab,b->k", w.conj(), own, w).real
            lengths.append(root * (np.sqrt(np.maximum(here, 0.0)) + change @ sizes))
        moved = sum(term.change(np.array(sweep.middle), np.array(abs(s - sweep.middle) + d)) * size
                    for term, size in zip(self.small.basis.terms, sweep.outside, strict=True))
        whole = float(np.interp(self.value, *sweep.at_middle) + moved)
        return tuple(lengths), (root * whole, root * float((np.abs(weight) + change) @ sweep.outside))

    def turn(self, h: float) -> Array:
        """X̂ (n, n) for |t| ≤ h, 0 where vectors would turn by too much."""
        X = first_turn(self.lam, self.B, h * np.abs(self.B))
        return np.where(h * np.abs(X).sum(axis=1, keepdims=True) <= 0.5, X, 0.0)

    def rest(self, given: Segment, h: float) -> Array | None:
        """F (n, n) for |t| ≤ h; None if h is too large for a bound."""
        sweep, B, N, d, X = self.sweep, self.B, given.N, given.reach, self.turn(h)
        b = B.diagonal()
        turn, slip = h * np.abs(X), h * (np.abs(N) + d * np.abs(self.N[1]))
        if slip.sum(axis=1).max(initial=0.0) > 0.5:
            return None
        first = np.where(X != 0, 0.0, np.abs(B))
        np.fill_diagonal(first, 0.0)
        second, eye = N @ B - given.Q, np.eye(len(b))
        rough = given.off + d * np.abs(self.N[1]) @ np.abs(B)
        whole = np.abs(second) + rough
        slipped, turned = la.inv(eye - slip), la.inv(eye - turn)
        G = h * first + h**2 * (np.abs(B @ X - X * b + second) + rough + whole @ turn + slip @ (slipped @ whole) @ (eye + turn))
        (right, left, right_T, left_T), (outside, outside_T) = given.lengths, given.outside
        outside += h * outside_T
        of_x, of_z = self.lengths
        rounding = self.own + of_z * sweep.rounding + h * given.fed * given.wrong
        rows = np.stack([h**2 * given.row * given.size + rounding, left + h * left_T + h * given.row * outside], axis=1)
        columns = np.stack([h * given.column + given.wrong * of_x, right + h * right_T])
        few = np.array([[h * given.far_T + given.wrong, given.far * outside], [outside, 0.0]])
        if few[0, 0] + few[0, 1] * few[1, 0] >= 0.95:
            return None
        both = turned @ slipped
        F = turned @ G + both @ (np.outer(rounding, of_x) + rows @ la.inv(np.eye(2) - few) @ columns) @ (eye + turn)
        return F if np.isfinite(F).all() else None

    def apart(self, tiles: Array) -> Array:
        """Smallest distances (l, n) of |λ_i + t b_i - s| in tiles (l, 5)."""
        found = np.empty((len(tiles), len(self.lam)))
        for k, line in enumerate(self.sweep.lines):
            at = tiles[:, 0] == k
            _, u, uh, e, eh = tiles[at].T[:, :, None]
            v, b = (self.lam - line.start) / line.along, self.B.diagonal() / line.along
            w = v + (e - self.value) * b
            found[at] = np.hypot(np.maximum(np.abs(w.real - u) - eh * np.abs(b.real) - uh, 0.0),
                                 np.maximum(np.abs(w.imag) - eh * np.abs(b.imag), 0.0))
        return found

    def tested(self, h: float, fine: int = 40) -> Array:
        """The tiles (l, 5) for |t| ≤ h in which a crossing is not excluded."""
        left, waiting = [np.zeros((0, 5))], []
        for k, line in enumerate(self.sweep.lines):
            number = int(np.ceil(line.length / (self.clear / 1.5)))
            waiting += [(k, (i + 0.5) * line.length / number, line.length / number / 2) for i in range(number)]
        while waiting:
            k, u, half = waiting.pop()
            line = self.sweep.lines[k]
            tiles = np.array([(k, u, half, self.value + at * h, h / 4) for at in (-0.75, -0.25, 0.25, 0.75)])
            given = self.segment(line.start + u * line.along, half)
            F = None if given is None else self.rest(given, h)
            tiles = tiles if F is None else self.opened(F, tiles, h / fine)
            if len(tiles) and half > self.clear / 30:
                waiting += [(k, u + sign * half / 2, half / 2) for sign in (-1, 1)]
            else:
                left.append(tiles)
        return np.vstack(left)

    def opened(self, F: Array, tiles: Array, least: float, most: int = 3000) -> Array:
        """The parts of the tiles that F does not exclude, with half width `least` in ε; wider if more than `most` were tested."""
        left, seen, speed = [np.zeros((0, 5))], 0, np.abs(self.B.diagonal())
        while len(tiles):
            D, seen = self.apart(tiles), seen + len(tiles)
            bad = ~(_radius(F, D) < BELOW)
            if not bad.any():
                break
            tiles, D = tiles[bad], D[bad]
            along = tiles[:, 2] > speed[D.argmin(axis=1)] * tiles[:, 4]
            ended = (~along & (tiles[:, 4] <= least)) | (seen > most)
            left.append(tiles[ended])
            tiles, along = tiles[~ended], along[~ended, None]
            size = np.where(along, [1, 1, 0.5, 1, 1], [1, 1, 1, 1, 0.5]) * tiles
            move = np.where(along, [0, 0.5, 0, 0, 0], [0, 0, 0, 0.5, 0]) * tiles[:, [0, 2, 0, 4, 0]]
            tiles = np.vstack([size + sign * move for sign in (-1, 1)])
        return np.vstack(left)

    def candidates(self, tiles: Array) -> list[tuple[int, float, float]]:
        """Where the centres of the discs nearest to open tiles cross the line: line, t, ε, one place for each disc and line."""
        if not len(tiles) or not len(self.lam):
            return []
        found = []
        for k, i in {(int(tile[0]), int(i)) for tile, i in zip(tiles, self.apart(tiles).argmin(axis=1), strict=True)}:
            line = self.sweep.lines[k]
            v, b = complex((self.lam[i] - line.start) / line.along), complex(self.B[i, i] / line.along)
            if b.imag:
                move = -v.imag / b.imag
                found.append((k, v.real + move * b.real, self.value + move))
        return found

    def single(self, s: complex, a: float, b: float, i: int) -> float:
        """A bound of |φ - (λ_i - s + t b_i)| for complex |s' - s| ≤ a, |t| ≤ b, φ of the equation left for g_i; inf if none."""
        given = self.segment(s, a)
        F = None if given is None else self.rest(given, b)
        if F is None:
            return np.inf
        D = np.abs(self.lam - s) - b * np.abs(self.B.diagonal()) - a
        others = np.arange(len(D)) != i
        if not (D[others] > 0).all():
            return np.inf
        rest = np.diag(D[others]) - F[np.ix_(others, others)]
        if not _radius(F[np.ix_(others, others)], D[None, others])[0] < BELOW:
            return np.inf
        return float(F[i, i] + F[i, others] @ np.maximum(la.solve(rest, F[others, i]), 0.0)) * (1 + 1e-9)


def first_turn(z: Array, B: Array, size: Array) -> Array:
    """X of the turn of eigenvectors to first order: b_ij / (z_j - z_i) where this gap is large beside `size` (k, k), else 0.

    B may be several matrices (q, k, k) that have this size together. With size = h|B|, no entry of h|X| is above 1/4.
    """
    gap = z - z[:, None]  # z_j - z_i
    far = np.abs(gap) > 4 * (size + size.T)
    np.fill_diagonal(far, False)
    return np.where(far, B / np.where(far, gap, 1.0), 0.0)


def _radius(F: Array, D: Array, steps: int = 16) -> Array:
    """Upper bounds (l,) of the spectral radii of F_ij / D_ki, by Collatz's quotients; rough where a radius is 1 or more."""
    w, found, at = np.ones_like(D), np.full(len(D), np.inf), np.arange(len(D))
    with np.errstate(all="ignore"):
        for _ in range(steps):
            new = (w @ F.T) / D[at]
            found[at] = np.fmin(found[at], (new / w).max(axis=1, initial=0.0))
            again = (found[at] >= BELOW) & ((new / w).min(axis=1, initial=np.inf) < 1)
            if not again.any():
                break
            at, w = at[again], w[again] + np.minimum(new[again], 1e200)
            w = np.maximum(w / w.max(axis=1, keepdims=True), 1e-200)
    return found


def _root(gram: Array) -> float:
    """‖X‖ from the Gram matrix XᴴX: the root of its largest eigenvalue."""
    last = len(gram) - 1
    return max(float(la.eigvalsh(gram, subset_by_index=[last, last], check_finite=False)[0]), 0.0) ** 0.5 if gram.size else 0.0
