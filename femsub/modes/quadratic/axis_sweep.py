"""Proved crossings of eigenvalues over a line in the plane of s, for all values of a parameter that acts through few columns.

In the setting of `femsub.modes.quadratic.cells`, P(s; ε) = P(s) + ε T(s), where T(s) = A(s)Bᵀ has r columns and acts in U alone.
On the line s = s_0 + t d, P(s; ε) is singular where x = 1/ε is an eigenvalue of the (r, r) matrix

    -G(s) - ΔG,   G = Bᵀ P_U⁻¹ A,   ‖ΔG‖ ≤ ‖Bᵀ P_U⁻¹ P_UL‖ ‖P_LU P_U⁻¹ A‖ / (c (1 - a)),   a = ‖P_LU P_U⁻¹ P_UL‖ / c < 1.

So one sweep over t serves all values of the parameter. In the eigenvectors of -G(s) the matrix for |t' - t| ≤ h is
diag(μ + (t' - t) b) and an error, which Gershgorin's discs enclose. The error has two parts: off-diagonal entries of first order,
which act to second order on a disc that is clear of all others, and the remainder of the series of 1/(λ - s). If no disc of a
piece meets a real x of the range, the piece has no crossing. If a disc that does is clear of all others, its eigenvalue is
analytic in t' and within R of μ + (t' - t) b. So by Cauchy's estimate its derivative is within R / (h - |t' - t|) of b. Where
this is below |Im b|, there is at most one crossing. As dλ/dε = -1 / (ε² dμ/ds), λ crosses a line to its left (seen along d) for
Im b > 0. In the code the centres of discs have the diagonal entries of second order as well.

Rounding is included. S = Σ x_k z_kᴴ / (λ_k - s) is P_U⁻¹ except for a factor I + E. With N_k = z_kᴴM (λ_k - σ) and t = s - σ,

    E = Σ x_k ρ_k / (1 - t ν_k) + (-Σ x_k (N_k + z_kᴴP'(σ)) - I) - t Σ x_k z_kᴴM,   ρ_k = ν_k z_kᴴP(σ) + z_kᴴP'(σ) + N_k,

where all terms would be 0 without rounding. Each term of a sum in VᵀT_iV is taken to be wrong by four roundings.

Sources: as for `femsub.stability.exclusion`; T. Kato, Perturbation Theory (1995), sec. II.1 (the resolvent as a sum);
N. J. Higham, T. Mary, SIAM J. Sci. Comput. 41 (2019) A2815 (rounding of sums as random).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.modes.quadratic.cells import images
from femsub.modes.quadratic.energy_basis import Coupling

if TYPE_CHECKING:
    from femsub.modes.quadratic.projected_count import Projection


class Line(NamedTuple):
    """s = start + t along, 0 ≤ t ≤ length, |along| = 1."""

    start: complex
    along: complex
    length: float


class Met(NamedTuple):
    """The only crossing of a disc in |t - `at`| ≤ `room`: its t is in `between`, its ε in `values`; is it to the `left`?"""

    at: float
    room: float
    between: tuple[float, float]
    values: tuple[float, float]
    left: bool

    def holds(self, other: Met) -> bool:
        """Whether the other is the same crossing: other crossings in the room have other values of ε."""
        return (self.at - self.room <= other.between[0] and other.between[1] <= self.at + self.room
                and self.values[0] <= other.values[1] and other.values[0] <= self.values[1])


class _Enclosures(NamedTuple):
    """The discs (l, r) of l pieces: centres μ + tb + t²q, radii, and whether a disc is clear of all others."""

    mu: Array
    slope: Array
    bend: Array
    radius: Array
    clear: Array


class Sweep:
    """The pencil of a projection, + ε Σ weight_q s^k T_q, for ε in a range: P_U(s; ε) = Σ s^k (P_k + ε T_k).

    Parameters
    ----------
    projection : Projection
        At ε = 0 (`Projection.changed`).
    weights : sequence of float
        θ_q = weight_q ε of each change.
    between : (lo, hi)
        The range of ε, lo < 0 < hi.
    """

    def __init__(self, projection: Projection, weights: Sequence[float], between: tuple[float, float]) -> None:
        self.projection, self.outer, self.between, self.terms = projection, projection.outer, between, projection.terms
        self.P, self.slope = projection.matrices, np.array([  # of each term the weights of ε
            np.array(own) * (0.0 if place is None else weights[place]) for place, own in projection.own_weights])
        self.T = np.einsum("ik,iab->kab", self.slope, projection.inside)

    def shapes(self, s: complex, value: float, steps: int = 4) -> tuple[Array, Array, complex, complex]:
        """Right and left vectors in V (m,) of the eigenvalue λ nearest to s, λ - s, and dλ/dε."""
        K, D, M = self.P + value * self.T
        P, slope = K + s * (D + s * M), D + 2 * s * M
        factor = la.lu_factor(P + EPS * la.norm(P) * np.eye(len(P)))
        x = z = np.random.default_rng(len(P)).standard_normal(len(P)).astype(complex)
        for _ in range(steps):
            x, z = la.lu_solve(factor, slope @ x), la.lu_solve(factor, slope.conj().T @ z, trans=2)
            x, z = x / la.norm(x), z / la.norm(z)
        own = z.conj() @ slope @ x
        change = z.conj() @ (np.tensordot([1.0, s, s * s], self.T, 1) @ x)
        return x, z, complex(-(z.conj() @ P @ x) / own), complex(-change / own)

    def eigenvalue(self, s: complex, value: float, steps: int) -> complex:
        """The eigenvalue of P_U(s; ε) near s at ε = `value`, by Newton's method; NaN if the iteration leaves the region."""
        for _ in range(steps):
            if not abs(s) <= self.outer.size:
                return complex(np.nan)
            move = self.shapes(s, value)[2]
            s += move
            if abs(move) <= EPS**0.75 * abs(s):
                break
        return s


class AxisSweep(Sweep):
    """A `Sweep` along one line after the other; all changes of the projection must be spanned."""

    def __init__(self, projection: Projection, weights: Sequence[float], between: tuple[float, float]) -> None:
        super().__init__(projection, weights, between)
        if any(slope.any() and not term.spanned for slope, term in zip(self.slope, self.terms, strict=True)):
            raise ValueError("what the parameter changes acts outside the basis")
        small, parts = Coupling.of(projection, projection.outer.size), self.T
        size, rows = la.svd(np.vstack(list(parts)), full_matrices=False)[1:]
        self.B = rows[size > len(size) * EPS * size[0]].T
        self.small, self.c = small, projection.least
        self.left, self.right = self.B.T @ small.x, small.z.conj().T @ (parts @ self.B)  # (r, k), (3, k, r)
        largest = np.array([term.largest(projection.outer.size) for term in projection.terms])
        H, self.left_out = images(projection, largest)
        self.HX, self.HZ = H @ small.x, H @ small.z
        self.lengths = [np.linalg.norm(part, axis=0) for part in (small.x, small.z)]
        self.each = [np.sqrt(np.maximum(np.einsum("kaa->ak", own).real, 0.0)) for own in small.both_products]
        # independent errors in the entries have a norm of 1/√m of the norm of their sizes
        m = projection.size
        self.rounding = 4 * EPS * m**-0.5 * float(np.append(1.0, largest) @ [
            la.norm(one, 2) for one in projection.sizes(projection.V)])
        self.A = parts @ self.B
        self.rounding += 4 * EPS * float(
            projection.outer.size ** np.arange(3) @ [la.norm(np.abs(part), 2) for part in self.P])
        self.off = residuals_of(self.P, small.shift, small.nu, small.x, small.z)

    def discs(self, s: Array, h: Array, along: complex) -> _Enclosures:
        """The discs for the pieces |t| ≤ h, (l,), of the line s + t along."""
        small, reach = self.small, h[:, None]
        (x, z), signs = self.lengths, np.array([term.sign for term in self.terms])
        with np.errstate(all="ignore"):
            each = small.nu / (1 - (s[:, None] - small.shift) * small.nu)  # 1/(λ - s), and the remainders of its series
            distance = np.where(small.nu != 0, np.abs(small.each - s[:, None]), np.inf)
            clear = np.where(distance > reach, distance - reach, np.nan)
            first, second, third = (np.where(np.isfinite(distance), reach**k / (distance**k * clear), 0.0) for k in (1, 2, 3))
            whole = np.abs(each) + first
            # G, with one step of refinement: so errors of the eigenpairs count only as far as they change over the piece
            powers = s[:, None, None, None] ** np.arange(3)[:, None, None]
            columns = (powers * self.right).sum(axis=1)  # zᴴA(s), (l, k, r)
            answer, adjoint = small.x @ (each[..., None] * columns), (self.left * each[:, None]) @ small.z.conj().T
            rest = (powers * self.A).sum(axis=1)
            for power, part in zip(powers.swapaxes(0, 1), self.P, strict=True):
                rest -= power * (part @ answer)
            G = -((self.left * each[:, None]) @ columns + adjoint @ rest)
            known = np.isfinite(G).all(axis=(1, 2)) & np.isfinite(whole).all(axis=1)
            known &= (s.real - h >= self.outer.re[0]) & (s.real + h <= self.outer.re[1])  # where c holds
            known &= np.abs(s.imag) + h <= self.outer.top
            mu, V = np.linalg.eig(np.where(known[:, None, None], G, 0.0))
            try:
                W = np.linalg.inv(V)
            except np.linalg.LinAlgError:
                W = np.linalg.pinv(V)  # V is singular: ‖WV - I‖ is at least 1
            # all other terms in the eigenvectors of G, entry by entry
            columns, slopes, bends = columns @ V, (self.right[1] + 2 * s[:, None, None] * self.right[2]) @ V, self.right[2] @ V
            left, turn = W @ self.left, (W @ self.left) * each[:, None]
            change = -along * ((turn * each[:, None]) @ columns + turn @ slopes)
            bend = -(along**2) * ((turn * each[:, None] ** 2) @ columns + (turn * each[:, None]) @ slopes + turn @ bends)
            inner, size, slopes, bends = np.abs(left), np.abs(columns), np.abs(slopes), np.abs(bends)
            step = h[:, None, None]
            off = (inner * third[:, None]) @ size + step * ((inner * second[:, None]) @ slopes
                                                            + step * ((inner * first[:, None]) @ bends))
            # rounding of P_U and of the eigenpairs
            moves = step * (slopes + step * bends)
            moves = first[..., None] * (size + moves) + np.abs(each)[..., None] * moves
            begin = np.linalg.norm(answer @ V, axis=1)
            answers = begin + x @ moves
            adjoints = np.linalg.norm(W @ adjoint, axis=2) + (inner * first[:, None]) @ z
            constant, growing, own = self.off
            base, rows = constant + growing * (np.abs(s - small.shift) + h), np.linalg.norm(W, axis=2)
            largest = whole @ (x * z)
            wrong = base + whole @ (x * own) + self.rounding * largest
            pairs = [(adjoints * self.rounding, answers)] + [(part / (1 - wrong)[:, None], other) for part, other in (
                (rows * growing * reach + (inner * first[:, None]) @ own, answers),
                (rows * base[:, None] + (inner * whole[:, None]) @ own, answers - begin),
                (rows * (wrong * largest)[:, None], np.linalg.norm(rest @ V, axis=1)))]
            # the coupling with the outside of U
            weight = np.stack([term.weight(s) for term in self.terms])  # (p, l)
            rise = np.stack([term.change(s, h) for term in self.terms]).T
            lengths = small._lengths(s, reach, small.both_products)
            share = (lengths[0] * lengths[1] * whole).sum(axis=1) / self.c
            right = sum(w[:, None, None] * (image @ (each[..., None] * columns)) for w, image in zip(
                weight, self.HX, strict=True))
            lost = sum(w[:, None, None] * (image @ turn.conj().swapaxes(1, 2)) for w, image in zip(
                signs[:, None] * weight.conj(), self.HZ, strict=True))
            pairs.append((
                (np.linalg.norm(lost, axis=1) + (inner @ (lengths[1] * first)[..., None])[..., 0]
                 + (inner @ ((rise @ self.each[1]) * np.abs(each))[..., None])[..., 0] + self.left_out * adjoints)
                / (self.c * (1 - share))[:, None],
                np.linalg.norm(right, axis=1) + (lengths[0][:, None] @ moves)[:, 0]
                + (((rise @ self.each[0]) * np.abs(each))[:, None] @ size)[:, 0] + self.left_out * answers))
            off = off + sum(one[:, :, None] * other[:, None] for one, other in pairs)
            off = np.where((known & (share < 1) & (wrong < 1))[:, None, None] & np.isfinite(off), off, np.inf)
            return _discs(np.where(known[:, None, None], G, 0.0), mu, V, W, change, bend, off, h)

    def touches(self, found: _Enclosures, h: Array) -> Array:
        """Which discs may meet a real x with 1/x in the range, (l, r)."""
        ends = found.mu + np.multiply.outer([-1.0, 1.0], h[:, None] * found.slope)
        bend = h[:, None] ** 2 * found.bend
        above = np.where(ends.imag.prod(axis=0) > 0, np.abs(ends.imag).min(axis=0), 0.0) - np.abs(bend.imag)
        lo, hi = self.between
        beside = np.minimum(1 / hi - ends.real.max(axis=0), ends.real.min(axis=0) - 1 / lo) - np.abs(bend.real)
        return np.asarray(~(np.maximum(above, beside) > found.radius))

    def swept(self, line: Line, least: float, start: int = 64, most: int = 64) -> tuple[list[Met], list[tuple[float, float]]]:
        """All crossings of a line, and the pieces (of t) in which crossings are not decided.

        There are such pieces if one became as short as `least`, as beside an undamped mode, or if more than `most` pieces were
        tested for each eigenvalue of P_U.
        """
        edges = np.linspace(0.0, line.length, start + 1)
        t, h = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        met: list[Met] = []
        left: list[tuple[float, float]] = []
        seen = 0
        while len(t):
            parts = []
            for at in range(0, len(t), start):
                where, half = t[at:at + start], h[at:at + start]
                found = self.discs(line.start + where * line.along, half, line.along)
                held = self.touches(found, half)
                for i in np.flatnonzero(held.any(axis=1)):
                    several, k = None, int(held[i].argmax())
                    move = -found.mu[i, k].imag / (found.slope[i, k].imag or np.nan)
                    slope = abs(found.slope[i, k].imag)
                    if abs(move) <= 3 * half[i] and found.clear[i, k] and 4 * half[i] * slope > found.radius[i, k]:
                        several = self._met(line, where[i] + move, 8 * half[i])  # half of this reach contains the piece
                    if several is None:
                        parts.append((where[i], half[i]))
                    else:
                        met += several
            seen += len(t)
            ended = seen > most * len(self.small.nu) or any(2 * b <= least for _, b in parts)
            left += [(float(a - b), float(a + b)) for a, b in parts if ended]
            halves = [(a + sign * b / 2, b / 2) for a, b in parts if not ended for sign in (-1, 1)]
            t, h = np.array(halves).reshape(-1, 2).T
        every: list[Met] = []
        for one in sorted(met, key=lambda one: one.room):
            if not any(one.holds(other) or other.holds(one) for other in every):  # neighbours find the same crossing
                every.append(one)
        return [self._nearer(line, one) for one in sorted(every)], left

    def _met(self, line: Line, at: float, reach: float, known: Met | None = None) -> list[Met] | None:
        """All crossings with |t - at| ≤ reach / 2, one for each disc, None if not proved; or a `known` one in new bounds."""
        found = self.discs(line.start + np.array([at]) * line.along, np.array([reach]), line.along)
        met, room = [], reach / 2  # the other half is for the estimate of the slope
        for k in np.flatnonzero(self.touches(found, np.array([reach]))[0]):
            mu, slope, bend, radius = (part[0, k] for part in found[:4])
            off = (radius + abs(mu.imag)) / (abs(slope.imag) - room * abs(bend.imag))
            move = -float(mu.imag / slope.imag)
            half = (radius + off**2 * abs(bend.imag)) / abs(slope.imag)
            x, width = mu.real + move * slope.real, half * abs(slope.real) + off**2 * abs(bend.real) + radius
            single = found.clear[0, k] and abs(slope.imag) > 2 * room * abs(bend.imag) + radius / room and off < room
            if single and width < abs(x):
                zero = at + move
                met.append(Met(zero, room - abs(move), (zero - half, zero + half), (1 / (x + width), 1 / (x - width)),
                               bool(slope.imag > 0)))
            elif known is None:
                return None
        return met if known is None else [one for one in met if known.holds(one)]

    def _nearer(self, line: Line, one: Met) -> Met:
        """The same crossing in the narrowest bounds that rounding allows."""
        while True:
            new = self._met(line, one.at, np.diff(one.between)[0], one)
            if not new or not np.diff(new[0].between) < np.diff(one.between) / 2:
                return one
            one = new[0]._replace(room=one.room - abs(new[0].at - one.at))


def residuals_of(matrices: Array, shift: float, nu: Array, x: Array, z: Array) -> tuple[float, float, Array]:
    """Bounds of the constant of E, of its slope in t, and of all |ρ_k| / |ν_k|; see the module's text."""
    (K, D, M), m, column, Z = matrices, len(x), nu[:, None], z.conj().T
    lengths, unit = [np.linalg.norm(part, axis=0) for part in (x, z)], 4 * EPS * m**0.5
    P, slope = K + shift * D + shift**2 * M, D + 2 * shift * M
    rows = column * (Z @ P), Z @ slope, np.divide(Z @ M, column, out=np.zeros_like(Z), where=column != 0)
    rounding = unit * sum(np.linalg.norm(part, axis=1) for part in (
        np.abs(column) * (np.abs(Z) @ np.abs(P)), np.abs(Z) @ np.abs(slope),
        np.divide(np.abs(Z) @ np.abs(M), np.abs(column), out=np.zeros(Z.shape), where=column != 0)))
    own = np.linalg.norm(rows[0] + rows[1] + rows[2], axis=1) + rounding
    return (la.norm(x @ ((rows[1] + rows[2]) * (column != 0)) + np.eye(m)) + float(lengths[0] @ rounding),
            la.norm(x @ (Z @ M)) + unit * float(lengths[0] @ lengths[1]) * la.norm(M),
            np.divide(own, np.abs(nu), out=np.zeros(len(own)), where=nu != 0))


def _discs(G: Array, mu: Array, V: Array, W: Array, b: Array, q: Array, off: Array, h: Array) -> _Enclosures:
    """Gershgorin's discs of l matrices V⁻¹GV + tb + t²q + F (l, r, r) for all |t| ≤ h and |F| ≤ off, entry by entry; W ≈ V⁻¹."""
    r, t = G.shape[1], h[:, None, None]
    eye = np.eye(r)
    turned = W @ G @ V
    every = np.abs(turned - mu[:, None] * eye) + off + 4 * r * EPS * (np.abs(W) @ np.abs(G) @ np.abs(V))
    # V⁻¹ = (WV)⁻¹W
    wrong = np.linalg.norm(W @ V - eye, axis=(1, 2)) + r * r * EPS * np.linalg.norm(np.abs(W) @ np.abs(V), axis=(1, 2))
    whole = np.linalg.norm(np.abs(turned) + every + t * np.abs(b) + t**2 * np.abs(q), axis=1)
    with np.errstate(all="ignore"):
        every = every + np.where(wrong < 1, wrong / (1 - wrong), np.inf)[:, None, None] * whole[:, None]
        every = np.where(np.isfinite(every), every, np.inf) + (t * np.abs(b) + t**2 * np.abs(q)) * (1 - eye)
        slope, bend, own = (np.einsum("lii->li", part) for part in (b, q, every))
        steps = h[:, None] * np.abs(slope) + h[:, None] ** 2 * np.abs(bend)
        rows = every.sum(axis=2)
        slack = np.abs(mu[:, :, None] - mu[:, None]) - steps[:, :, None] - steps[:, None] - rows[:, None]
        slack += np.where(eye, np.inf, 0.0)
        # row i scaled by τ, column i by 1/τ: the others' discs grow by at most half of the slack, and disc i shrinks
        tau = np.where(slack > 0, 2 * every.swapaxes(1, 2) / slack, np.inf).max(axis=2)
        radius = own + np.where(rows > own, (rows - own) * tau, 0.0)
        clear = (tau <= 1) & (radius < slack.min(axis=2) / 2) & (rows < slack.min(axis=2))
        return _Enclosures(mu, slope, bend, np.where(clear, radius, rows), clear)
