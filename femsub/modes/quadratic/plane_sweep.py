"""Where a parameter of any rank brings an eigenvalue to a line in the plane of s, for all its values: proved.

P(s; ε) = P(s) + ε T(s), where T acts through any number of columns, inside U and outside (see `energy_basis`). The line is
s = s_0 + t d. The plane of (t, ε) is covered by patches, |t - t_c| ≤ H and |ε - ε_c| ≤ E. In a patch W_R and W_L (m, k) span
right and left vectors of eigenvalues of P_U near s_c, at values ε in the patch, and C_R and C_L the vectors with

    C_Lᴴ P_U(s_c; ε_c) W_R = 0,   W_Lᴴ P_U(s_c; ε_c) C_R = 0,   C_Lᴴ P_U(s_c; ε_c) C_R = I.

With u = W_R g + C_R v and the part y outside, in units in which Re P_L ≥ 1, P(s; ε)(u, y) = 0 is

    F g + Y' (v, y) = 0,   Y g + Z (v, y) = 0,   Z = [ N  C_LᴴP_UL ; P_LU C_R  P_L ],

with F = W_Lᴴ P_U W_R and N = C_Lᴴ P_U C_R. All but P_L are polynomials in t and ε, known exactly. In the patch ‖N - I‖ ≤ ν,
‖C_LᴴP_UL‖ ‖P_LU C_R‖ ≤ κ², and the lengths of v and y of a solution of Z(v, y) = r are at most those of

    [ 1 - ν  -κ ; -κ  1 ]⁻¹ (|r_1|, |r_2|),   so that ‖Z⁻¹‖ ≤ ζ, the norm of this inverse, where 1 - ν > κ².

P(s; ε) is regular where F is, and ζ ‖Y F⁻¹ Y'‖ < 1. In a box |t - t_0| ≤ a, |ε - ε_0| ≤ b, with F = F_0 + ΔF, Y = Y_0 + ΔY,
Y' = Y'_0 + ΔY', e = ‖F_0⁻¹ΔF‖ < 1 and l = ‖Y_0F_0⁻¹‖ ‖ΔF‖ + ‖ΔY‖,

    ‖Y F⁻¹ Y'‖ ≤ ‖Y_0F_0⁻¹Y'_0‖ + l ‖F_0⁻¹Y'_0‖ / (1 - e) + ‖ΔY'‖ (‖Y_0F_0⁻¹‖ + l ‖F_0⁻¹‖ / (1 - e)).

Boxes are halved until they are excluded, or lie in the window of a crossing. In the window, with the singular vectors of F_0 as
coordinates, all but the last belong to Z. What is left is one equation φ(t, ε) = φ_0 + φ_t t + φ_ε ε + ρ(t, ε) = 0, analytic in
complex |t| ≤ A and |ε| ≤ B, |ρ| ≤ r there. For complex ε, c is less by |Im ε| Σ |s^k| g, g a bound of |xᴴTx| / xᴴAx. With the
least singular value σ of the real matrix of (A φ_t, B φ_ε),

- all zeros with |t| ≤ A and |ε| ≤ B, real, are in the ellipse of the radius q = (r + |φ_0|) / σ in (t/A, ε/B), and if q < 1/2
  there is an odd number (degree);
- where |t| ≤ A/2 and |ε| ≤ B/2, ρ has derivatives of at most 2r/A and 2r/B (Cauchy). So if σ > √2 2r, there is one at most.

As dλ/dε = -φ_ε / φ_s, its direction is known. The same holds for any share of the coupling with the outside. So in what lines
enclose P has as many eigenvalues as P_U.

References: as for `energy_basis`; T. Kato, Math. Ann. 125 (1952) 208 (‖CTX‖² ≤ ‖C|Tᵀ|Cᴴ‖ ‖Xᴴ|T|X‖).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import pairwise
from math import comb
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.modes.quadratic.axis_sweep import Line, Met
from femsub.modes.quadratic.cells import images
from femsub.modes.quadratic.energy_basis import each_of, eigenpairs

if TYPE_CHECKING:
    from femsub.modes.quadratic.projected_count import Projection

log = logging.getLogger(__name__)

Poly = dict[tuple[int, int], Array]  #: coefficients of t^a ε^b


class PlaneSweep:
    """The pencil of a projection, + ε Σ weight_q s^k T_q, for ε in a range.

    Parameters
    ----------
    projection : Projection
        At ε = 0 (`Projection.changed`).
    weights : sequence of float
        θ_q = weight_q ε of each change.
    between : (lo, hi)
        The range of ε, lo < 0 < hi.
    slices : int
        The range is divided into so many at first, and each patch has the vectors at its ends and in its middle.
    """

    def __init__(self, projection: Projection, weights: Sequence[float], between: tuple[float, float], slices: int = 4) -> None:
        self.projection, self.between, self.outer, self.slices = projection, between, projection.outer, slices
        w, m, size = np.array(weights), projection.size, projection.outer.size
        base, most = projection.changed(np.zeros(len(w))), 1.02 * max(map(abs, between))
        c = projection.changed(np.zeros(len(w)), np.abs(w) * most).least
        self.least = 0.9 * c  # a tenth is left to complex ε
        sizes = np.array([term.largest(size) for term in projection.changed(np.abs(w) * most).terms])
        H, lost = images(projection, sizes)
        self.P: Poly = dict(zip(((0, 0), (1, 0), (2, 0)), base.matrices, strict=True))
        self.R: Poly = {}  # of P_LU, and of P_ULᵀ
        self.L: Poly = {}
        grows = 0.0  # Σ |s^k| g
        for (place, own), term, inside, image in zip(projection.own_weights, base.terms, projection.inside, H, strict=True):
            if place is not None and not term.spanned:
                grows += abs(w[place]) * projection.norm(term) * float(np.array(own) @ size ** np.arange(3))
            for a in range(3):
                weight = term.weights[a] if place is None else w[place] * own[a]
                if weight:
                    at = a, int(place is not None)
                    if place is not None:
                        self.P[at] = self.P.get(at, 0.0) + weight * inside
                    self.R[at] = self.R.get(at, 0.0) + weight * image
                    self.L[at] = self.L.get(at, 0.0) + term.sign * weight * image
        self.reach = min(0.01 * max(map(abs, between)), 0.1 * c / grows if grows else np.inf)  # of complex ε
        root = self.least**-0.5 if c > 0 else np.inf
        self.R, self.L = ({at: root * part for at, part in several.items()} for several in (self.R, self.L))
        self.gram = [{(i, j): (several[i].T @ several[j]).astype(np.float32) for i in several for j in several}
                     for several in (self.R, self.L)]
        self.left_out = root * lost
        self.rounding = 8 * EPS * m**-0.5 * float(np.append(1.0, sizes) @ [
            la.norm(one, 2) for one in projection.sizes(projection.V)])
        self.rounding += 8 * EPS * sum(size**a * most**b * float(la.norm(np.abs(A), 2)) for (a, b), A in self.P.items())
        # |Aᵀ| and |A| of all coefficients of second order
        self.moduli: dict[tuple[int, int], tuple[Array, Array]] = {}
        for at, A in self.P.items():
            if sum(at) > 1:
                u, s, v = la.svd(A)
                self.moduli[at] = ((u * s) @ u.T).astype(np.float32), ((v.T * s) @ v).astype(np.float32)
        lo, hi = between
        self.nodes = np.linspace(lo, hi, 2 * slices + 1)
        self.pairs = dict(zip(self.nodes.tolist(), each_of(self.pairs_at, self.nodes.tolist()), strict=True))
        self.solved = len(self.nodes)

    def pairs_at(self, value: float) -> tuple[Array, Array, Array]:
        """All finite λ of P_U with right and left vectors (m, k) of unit length."""
        zero = np.zeros_like(self.P[0, 0])
        matrices = np.array([self.P[a, 0] + value * self.P.get((a, 1), zero) for a in range(3)])
        (shift, nu, x, z), *_ = eigenpairs(matrices, self.outer.size)
        x, z, nu = x[:, nu != 0], z[:, nu != 0], nu[nu != 0]
        return shift + 1 / nu, x / la.norm(x, axis=0), z / la.norm(z, axis=0)

    def swept(self, line: Line, least: float, most: int = 4000, start: int = 0) -> tuple[list[Met], list[tuple[float, float]]]:
        """All crossings of a line, and the pieces (of t) in which they are not known.

        The first of them has a length of `least`, or there are more than `most` patches.
        """
        (lo, hi), met, left, seen = self.between, [], [], 0
        start = start or (32 if not line.start.real and line.along == 1j else 8)  # far from the axis there are few eigenvalues
        ends, values = np.linspace(0.0, line.length, start + 1), np.linspace(lo, hi, self.slices + 1)
        waiting = [((a + b) / 2, (b - a) / 2, (c + d) / 2, (d - c) / 2) for a, b in pairwise(ends.tolist())
                   for c, d in pairwise(values.tolist())]
        while waiting:
            seen += len(waiting)
            log.info("%d patches of %s", len(waiting), line)
            found = each_of(lambda *at: self._patch(line, *at), *zip(*waiting, strict=True))
            again: list[tuple[float, float, float, float]] = []
            for (t, h, e, b), (known, along) in zip(waiting, found, strict=True):
                if known is not None:
                    met += known
                elif seen > most or 2 * h <= least or b <= least / line.length * (hi - lo):
                    left.append((t - h, t + h))
                else:
                    again += [(t + sign * h / 2, h / 2, e, b) if along else (t, h, e + sign * b / 2, b / 2) for sign in (-1, 1)]
            if left:
                return [], left
            waiting = again
        every: list[Met] = []
        for one in sorted(met, key=lambda one: -one.room):
            if not any(one.holds(other) or other.holds(one) for other in every):  # neighbours meet the same one
                every.append(one)
        return sorted(every), left

    def _patch(self, line: Line, t: float, h: float, e: float, b: float, step: int = 4) -> tuple[list[Met] | None, bool]:
        """The crossings in a patch, None if they are not known; and whether t is to be divided then, or ε."""
        s = line.start + t * line.along
        values = self.nodes[np.abs(self.nodes - e) <= 1.01 * b].tolist() or [e]  # vectors of a farther node serve no small patch
        for value in values:
            if value not in self.pairs:
                self.pairs[value] = self.pairs_at(value)
        pairs = [self.pairs[value] for value in values]
        # near pairs end in a gap, beyond six half widths
        apart = np.concatenate([np.abs(lam - s) for lam, *_ in pairs])
        reach = max(6 * h, 0.01 * abs(s))
        ends = np.sort([0.7 * reach, *apart[(apart > 0.7 * reach) & (apart < 1.3 * reach)], 1.3 * reach])
        at = int(np.argmax(ends[1:] / ends[:-1]))
        reach = float(np.sqrt(ends[at] * ends[at + 1]))
        if np.count_nonzero(apart <= reach) > 12 * len(values) and 6 * h > 0.01 * abs(s):
            return None, True
        patch = PlanePatch(self, s, e, line.along, (h, b), pairs, reach)
        if not patch.known or patch.zeta > 8:
            return None, patch.along
        if not patch.size:
            return [], True
        middles = (np.arange(step) + 0.5) / step * 2 - 1
        boxes = np.array([(x * h, y * b, h / step, b / step) for x in middles for y in middles])
        met: list[tuple[Met, tuple[float, float]]] = []
        tried: list[Array] = []
        seen = turn = 0
        while len(boxes):
            seen, turn = seen + len(boxes), turn + 1
            parts = [patch.excluded(boxes[i:i + 256]) for i in range(0, len(boxes), 256)]
            done, along, towards = (np.concatenate(part) for part in zip(*parts, strict=True))
            boxes, along, towards = boxes[~done], along[~done], towards[~done]
            near = np.flatnonzero((np.abs(towards - boxes[:, :2]) <= 2 * boxes[:, 2:]).all(axis=1) & (turn >= step))
            for i in near:
                place, size = towards[i] + (t, e), boxes[i, 2:]
                known = any(abs(place[0] - one.at) <= one.room and abs(place[1] - at_value) <= room
                            for one, (at_value, room) in met)
                if known or any((np.abs(place - other[:2]) <= 3 * other[2:]).all() and (size > other[2:] / 8).any()
                                for other in tried):
                    continue
                tried.append(np.append(place, size))
                window = self._window(line, *place.tolist())
                met += [] if window is None else [window]
            inside = np.zeros(len(boxes), dtype=bool)
            for one, (at_value, room) in met:
                inside |= (np.abs(boxes[:, 0] + t - one.at) + boxes[:, 2] <= one.room) & (
                    np.abs(boxes[:, 1] + e - at_value) + boxes[:, 3] <= room)
            boxes, along = boxes[~inside], along[~inside]
            # halving does not help where the bound itself is too large; beside curves little is left
            if seen > 6000 or turn > 60 or (boxes[:, 2:].prod(axis=1).sum() > h * b * max(0.5 ** (turn / 2), 0.02) and turn > 3):
                return None, patch.far
            move = np.where(along[:, None], [1, 0], [0, 1]) * boxes[:, 2:] / 2
            size = np.where(along[:, None], [0.5, 1], [1, 0.5]) * boxes[:, 2:]
            boxes = np.vstack([np.hstack([boxes[:, :2] + sign * move, size]) for sign in (-1, 1)])
        return [one for one, _ in met], True

    def _window(self, line: Line, t: float, e: float) -> tuple[Met, tuple[float, float]] | None:
        """The one crossing in a window near (t, ε), and the value in the middle of the window with half of its width; or None."""
        h, b = 0.006 * self.outer.size, 0.03 * (self.between[1] - self.between[0])
        for _ in range(8):
            s = line.start + t * line.along
            room = min(self.outer.top - s.imag, s.real - self.outer.re[0], self.outer.re[1] - s.real)
            if room <= 0 or abs(e) > 1.01 * max(map(abs, self.between)):
                return None  # c holds up to there
            h = min(h, room)
            try:
                pairs = [self.pairs_at(e)]
                patch = PlanePatch(self, s, e, line.along, (h, b), pairs, max(6 * h, 0.02 * abs(s)))
            except la.LinAlgError:
                return None
            if not patch.known:
                h, b = h / 2.5, b / 2.5
                continue
            place = patch.singular() if patch.size else None
            if place is None:
                return None
            if (np.abs(place) > 0.05 * np.array([h, b])).any():
                t, e = t + float(place[0]), e + float(place[1])
                continue
            proved = patch.single(place, self.reach)
            if proved is None:  # a smaller patch has fewer pairs, that are less coupled
                h, b = h / 4, b / 4
                continue
            room, off, value_room, value_off, left = proved
            t, e = t + float(place[0]), e + float(place[1])
            return Met(t, room, (t - off, t + off), (e - value_off, e + value_off), left), (e, value_room)
        return None

    def _at(self, s: complex, value: float) -> tuple[Array, Array, Array]:
        """P_U, ∂P_U/∂s and ∂P_U/∂ε."""
        P, slope, change = _all(self.P, np.array([s]), np.array([value]))
        return P[0], slope[0], change[0]

    def shapes(self, s: complex, value: float, steps: int = 4) -> tuple[Array, Array, complex, complex]:
        """Right and left vectors in V (m,) of the eigenvalue nearest to s; how far it is, and dλ/dε."""
        P, slope, change = self._at(s, value)
        factor = la.lu_factor(P + EPS * la.norm(P) * np.eye(len(P)))
        x = z = np.random.default_rng(len(P)).standard_normal(len(P)).astype(complex)
        for _ in range(steps):
            x, z = la.lu_solve(factor, slope @ x), la.lu_solve(factor, slope.conj().T @ z, trans=2)
            x, z = x / la.norm(x), z / la.norm(z)
        own = z.conj() @ slope @ x
        return x, z, complex(-(z.conj() @ P @ x) / own), complex(-(z.conj() @ change @ x) / own)

    def eigenvalue(self, s: complex, value: float, steps: int) -> complex:
        """The eigenvalue of P_U(s; ε) near s at ε = `value`, by Newton's method; NaN if that leaves the region."""
        for _ in range(steps):
            if not abs(s) <= self.outer.size:
                return complex(np.nan)
            move = self.shapes(s, value)[2]
            s += move
            if abs(move) <= EPS**0.75 * abs(s):
                break
        return s


class PlanePatch:
    """The matrices F, Y and Y' of a patch about (s, ε) with the half widths `half`, as polynomials; see the module's text."""

    def __init__(self, sweep: PlaneSweep, s: complex, value: float, along: complex, half: tuple[float, float],
                 pairs: Sequence[tuple[Array, Array, Array]], reach: float) -> None:
        self.half, (h, b), m = half, half, len(sweep.P[0, 0])
        P = _moved(sweep.P, s, value, along)
        near = [np.abs(lam - s) <= reach for lam, *_ in pairs]
        spans = []
        for side in (1, 2):
            u, size, _ = la.svd(np.hstack([one[side][:, at] for one, at in zip(pairs, near, strict=True)]), full_matrices=False)
            spans.append((u, int(np.count_nonzero(size > 1e-4))))  # what is left out belongs to C
        k = self.size = max(number for _, number in spans)
        right, left = spans[0][0][:, :k], spans[1][0][:, :k].conj().T
        C_L, C_R = la.qr(P[0, 0] @ right)[0][:, k:], la.qr((left @ P[0, 0]).conj().T)[0][:, k:]
        u, size, v = la.svd(C_L.conj().T @ P[0, 0] @ C_R)
        C_L, C_R, largest = (C_L @ (u * size**-0.5)).conj().T, C_R @ (v.conj().T * size**-0.5), float(size[-1] ** -0.5)
        # ν, by norms to first order, and by |A| beyond; in single precision
        left_32, right_32, digits = C_L.astype(np.complex64), C_R.astype(np.complex64), m**0.5 * float(np.finfo(np.float32).eps)
        S_L, S_R = left_32.T @ left_32.conj(), right_32 @ right_32.conj().T
        first = []
        for at, step in (((1, 0), h), ((0, 1), b)):
            if at in P:
                A = P[at].astype(np.complex64)
                first.append(step * (_largest(left_32 @ (A @ right_32)) + digits * largest**2 * float(la.norm(A))))
            else:
                first.append(0.0)
        sizes = {at: (_root(A, S_L) * _root(B, S_R)) ** 0.5 for at, (A, B) in sweep.moduli.items()}
        both = sizes.get((2, 1), 0.0)
        second = h * h * (sizes.get((2, 0), 0.0) + (abs(value) + b) * both) + h * b * (sizes.get((1, 1), 0.0) + 2 * abs(s) * both)
        nu = sum(first) + second + largest**2 * sweep.rounding + m * EPS * float(size[0] / size[-1])
        self.along, self.known, self.zeta = first[0] + second > first[1], False, np.inf
        self.far = first[0] + second > 2 * first[1]  # where the vectors at other ε do not serve either
        if nu >= 0.9:
            return
        # κ
        lengths = []
        for gram, S in zip(sweep.gram, (S_R, S_L), strict=True):
            parts = {(0, 0): lambda a, e: s**a * value**e, (1, 0): lambda a, e: a * s ** max(a - 1, 0) * value**e,
                  (0, 1): lambda a, e: e * s**a, (2, 0): lambda a, e: (a == 2) * value**e,
                  (1, 1): lambda a, e: e * a * s ** max(a - 1, 0), (2, 1): lambda a, e: e * (a == 2)}
            length = largest * sweep.left_out
            for (i, j), weight in parts.items():
                w = {p: complex(weight(*p)) for p in {p for p, _ in gram}}
                if not i + j:
                    A = sum((np.complex64(w[p].conjugate() * w[q]) * part for (p, q), part in gram.items() if w[p] and w[q]),
                            np.zeros_like(S))
                    found = _root(A, S)
                else:  # of a sum no more than the sum
                    traces = {p: max(float(np.vdot(gram[p, p], S.real)), 0.0) for p in w if w[p]}
                    found = sum(abs(w[p]) * traces[p] ** 0.5 for p in traces) ** 2 * h ** (2 * i) * b ** (2 * j)
                scale = sum(abs(w[p]) ** 2 * float(np.trace(gram[p, p])) for p in w) * h ** (2 * i) * b ** (2 * j)
                length += (found + digits * largest**2 * scale) ** 0.5
            lengths.append(length)
        kappa = float(np.prod(lengths)) ** 0.5
        # units of y in which both lengths are κ
        self.sides, self.balance = (C_L, C_R), (lengths[1] / lengths[0]) ** 0.5 if kappa else 1.0
        if 1 - nu - kappa**2 <= 0.1:
            return
        self.known, self.zeta = True, float(la.norm(la.inv([[1 - nu, -kappa], [-kappa, 1.0]]), 2))
        if not k:
            return
        # coordinates in which F is about diag(t - τ) / max(|τ|, h)
        F = {at: left @ A @ right for at, A in P.items()}
        tau, turn = la.eig(-F[0, 0], F[1, 0])
        with np.errstate(all="ignore"):
            try:
                left, right = np.linalg.solve(F[1, 0] @ turn, left), right @ turn
            except la.LinAlgError:
                self.known = False
                return
            even = np.sqrt(la.norm(left, axis=1) / la.norm(right, axis=0))
            scale = np.maximum(np.abs(tau), h) ** -0.5
        right, left = right * (even * scale), left * (scale / even)[:, None]
        if not (np.isfinite(right).all() and np.isfinite(left).all()):
            self.known = False
            return
        balance = self.balance
        wide = [float(la.norm(part, 2)) for part in (left, right)]
        self.F = {at: left @ A @ right for at, A in P.items()}
        self.Y, lost = self._short([{at: C_L @ (A @ right) for at, A in P.items()}, _moved(
            {at: balance * (A @ right) for at, A in sweep.R.items()}, s, value, along)])
        Z, other = self._short([{at: (left @ A @ C_R).T for at, A in P.items()}, _moved(
            {at: A @ left.T / balance for at, A in sweep.L.items()}, s, value, along)])
        self.Z = {at: A.T for at, A in Z.items()}
        rounding = largest * sweep.rounding
        self.off = (sweep.rounding * wide[0] * wide[1], lost + rounding * wide[1] + sweep.left_out * balance * wide[1],
                    other + rounding * wide[0] + sweep.left_out / balance * wide[0])
        self.norms = [{at: float(la.norm(A, 2)) for at, A in part.items()} for part in (self.F, self.Y, self.Z)]

    def _short(self, parts: Sequence[Poly]) -> tuple[Poly, float]:
        """Polynomials one below the other with rows turned into as few as they take, and the norm of what is left out."""
        (h, b), powers = self.half, sorted({at for part in parts for at in part})
        tall = []
        for part in parts:
            rows = len(next(iter(part.values())))
            tall.append(np.hstack([h**i * b**j * part.get((i, j), np.zeros((rows, self.size))) for i, j in powers]))
        (R,), n = la.qr(np.vstack(tall), mode="r"), len(powers)
        R = R[:n * self.size]
        u, size, _ = la.svd(R, full_matrices=False)
        keep = size > EPS**0.5 * size[0]
        found = np.split(u[:, keep].conj().T @ R, n, axis=1)
        lost = n * float(size[~keep].max(initial=0.0))
        return {(i, j): A / (h**i * b**j) for (i, j), A in zip(powers, found, strict=True)}, lost

    def _changes(self, which: int, a: Array, b: Array) -> tuple[Array, Array]:
        """Bounds of what a polynomial changes over boxes of these half widths: all of it, and beyond first order."""
        (h, e), n = self.half, self.norms[which]
        second = a * a * (n.get((2, 0), 0.0) + e * n.get((2, 1), 0.0)) + a * b * (n.get((1, 1), 0.0) + 2 * h * n.get((2, 1), 0.0))
        first = a * (n.get((1, 0), 0.0) + 2 * h * n.get((2, 0), 0.0) + e * n.get((1, 1), 0.0) + 2 * h * e * n.get((2, 1), 0.0))
        first = first + b * (n.get((0, 1), 0.0) + h * n.get((1, 1), 0.0) + h * h * n.get((2, 1), 0.0))
        return first + second + self.off[which], second + self.off[which]

    def excluded(self, boxes: Array) -> tuple[Array, Array, Array]:
        """Of boxes (l, 4), t, ε and half widths: which hold no crossing, in which direction to halve others, and Newton's step.

        That is the step for det F = 0, to a real t and ε.
        """
        t, e, a, b = boxes.T
        F, slope, change = _all(self.F, t, e)
        inverse = np.linalg.inv(F)
        moved, fed = inverse @ slope, inverse @ change
        size, of_t, of_e = _four(inverse), a * _four(moved), b * _four(fed)
        (whole, second), (of_y, _), (of_z, _) = (self._changes(i, a, b) for i in range(3))
        share = of_t + of_e + size * second
        p, q = (np.einsum("lii->l", part) for part in (moved, fed))
        with np.errstate(all="ignore"):
            det = p.real * q.imag - p.imag * q.real
            towards = np.stack([t - q.imag / det, e + p.imag / det], axis=1)
            Y, Z = _all(self.Y, t, e)[0] @ inverse, _all(self.Z, t, e)[0]
            Y_size, Z_size = _four(Y), _four(inverse @ Z)
            more = (Y_size * whole + of_y) / (1 - share)
            product = _four(Y @ Z) + more * Z_size + of_z * (Y_size + more * size)
        return (share < 0.9) & (self.zeta * product < 0.99), of_t >= of_e, towards

    def singular(self, steps: int = 12) -> Array | None:
        """(t, ε), real, near 0 where F is singular; None if Newton's method leaves the patch."""
        at = np.zeros(2)
        for _ in range(steps):
            F, slope, change = (part[0] for part in _all(self.F, at[:1], at[1:]))
            u, size, v = la.svd(F)
            p, q = (u[:, -1].conj() @ part @ v[-1].conj() for part in (slope, change))
            system = np.array([[p.real, q.real], [p.imag, q.imag]])
            if not la.det(system):
                return None
            move = -la.solve(system, [size[-1], 0.0])
            at = at + move
            if (np.abs(at) > self.half).any():
                return None
            if (np.abs(move) <= EPS**0.5 * np.array(self.half)).all():
                return at
        return None

    def single(self, place: Array, reach: float) -> tuple[float, float, float, float, bool] | None:
        """Half widths of a window in t and of the crossing's interval, both in ε; whether λ crosses to the left. Or None."""
        F, slope, change = (part[0] for part in _all(self.F, place[:1], place[1:]))
        (Y, Y_t, Y_e), (Z, Z_t, Z_e) = ([part[0] for part in _all(poly, place[:1], place[1:])] for poly in (self.Y, self.Z))
        u, size, v = la.svd(F)
        u, v = u.conj().T, v.conj().T
        slope, change = u @ slope @ v, u @ change @ v
        (Y, Y_t, Y_e), (Z, Z_t, Z_e) = (Y @ v, Y_t @ v, Y_e @ v), (u @ Z, u @ Z_t, u @ Z_e)
        p, q, inverse = slope[-1, -1], change[-1, -1], 1 / np.maximum(size[:-1], EPS * size[0])
        if not abs(p) * abs(q):
            return None
        real, f = np.array([[p.real, q.real], [p.imag, q.imag]]), float(inverse.max(initial=0.0))
        a = 0.9 * self.half[0]
        of_Y, of_Z = _norm(Y[:, :-1] * inverse), _norm(inverse[:, None] * Z[:-1])
        both = _norm(Y[:, :-1] * inverse @ Z[:-1])
        while a > EPS * self.half[0]:
            b = min(a * abs(p) / abs(q), 0.9 * self.half[1], reach)
            a = min(a, b * abs(q) / abs(p))
            seconds = [float(self._changes(i, np.array(a), np.array(b))[1]) for i in range(3)]

            def moved(i: int, A: Array, B: Array, a: float = a, b: float = b, seconds: list[float] = seconds) -> float:
                return a * _norm(A) + b * _norm(B) + seconds[i]

            share = f * seconds[0] + sum(step * _norm(inverse[:, None] * part[:-1, :-1]) for step, part in (
                (a, slope), (b, change)))
            whole, of_y, of_z = moved(0, slope, change), moved(1, Y_t, Y_e), moved(2, Z_t, Z_e)
            if share < 0.9:
                f_all, left = f / (1 - share), of_Y * whole + of_y
                product = both + left * of_Z / (1 - share) + of_z * (of_Y + left * f_all)
                if self.zeta * product < 0.9:
                    zeta = self.zeta / (1 - self.zeta * product)
                    to_y, to_z = of_Y + left * f_all, of_Z + (of_Z * whole + of_z) * f_all
                    column, row = moved(0, slope[:-1, -1:], change[:-1, -1:]), moved(0, slope[-1:, :-1], change[-1:, :-1])
                    below = _norm(Y[:, -1:]) + moved(1, Y_t[:, -1:], Y_e[:, -1:])
                    beside = _norm(Z[-1:]) + moved(2, Z_t[-1:], Z_e[-1:])
                    outer = zeta * (below + to_y * column)
                    rest = seconds[0] + row * (f_all * column + to_z * outer) + beside * outer
                    sigma = float(la.svd(real * [a, b], compute_uv=False)[-1])
                    off = (rest + float(size[-1])) / sigma if sigma else np.inf
                    if off < 0.45 and sigma > 2 * 2**0.5 * rest:
                        return a, off * a, b, off * b, bool((-q / p).imag > 0)
            a /= 2
        return None


def _moved(poly: Poly, s: complex, value: float, along: complex) -> Poly:
    """A polynomial in s and ε as one in t and ε - value about s + t along."""
    found: Poly = {}
    for (a, b), A in poly.items():
        for i in range(a + 1):
            for j in range(b + 1):
                weight = comb(a, i) * s ** (a - i) * comb(b, j) * value ** (b - j) * along**i
                found[i, j] = found.get((i, j), 0.0) + weight * A
    return found


def _all(poly: Poly, t: Array, e: Array) -> tuple[Array, Array, Array]:
    """A polynomial and its slopes in t and ε at several places, (l, p, q) each."""
    shape = (len(t), *next(iter(poly.values())).shape)
    found = np.zeros((3, *shape), dtype=complex)
    for (a, b), A in poly.items():
        for part, weight in zip(found, (t**a * e**b, a * t ** max(a - 1, 0) * e**b, b * t**a), strict=True):
            if weight.any():
                part += weight[:, None, None] * A
    return found[0], found[1], found[2]


def _four(A: Array) -> Array:
    """(Σ σ⁴)^¼ of each matrix, at least its norm."""
    gram = A.conj().swapaxes(1, 2) @ A if A.shape[1] > A.shape[2] else A @ A.conj().swapaxes(1, 2)
    return np.asarray((np.abs(gram) ** 2).sum(axis=(1, 2)) ** 0.25)


def _root(A: Array, S: Array) -> float:
    """At least the norm of XᴴAX, S = XXᴴ, A positive semidefinite: (tr ASAS)^½, with the rounding of this sum."""
    product = A @ S
    rounding = len(A) ** 0.5 * float(np.finfo(product.dtype).eps * np.vdot(product, product).real)
    return (max(float(np.einsum("ij,ji->", product, product).real), 0.0) + rounding) ** 0.5


def _largest(A: Array) -> float:
    """The largest singular value, by AᴴA."""
    return float(la.eigvalsh(A.conj().T @ A, subset_by_index=[len(A) - 1] * 2, check_finite=False)[0]) ** 0.5 if A.size else 0.0


def _norm(A: Array) -> float:
    return float(la.norm(A, 2)) if A.size else 0.0
