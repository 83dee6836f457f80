"""Enclosures of the eigenvalues of a family at many neighbouring values, from one decomposition in their middle.

In first order the family is a(θ) - λ b, with a affine in the factors θ. At the middle b⁻¹a = V diag(z) V⁻¹. Let directions t_q
with |t_q| ≤ 1 span the changes of θ over the values, with B_q = V⁻¹ b⁻¹a_q V and their diagonals b_q. The vectors are turned to
first order, X = Σ t_q X_q with entries b_ij / (z_j - z_i), where z_i and z_j are so far apart that I - |X| keeps a non-negative
inverse:

    (V(I + X))⁻¹ b⁻¹a(θ) V(I + X) = diag(z + Σ t_q b_q) + (I + X)⁻¹ (B' + C),   C = Σ t_q t_r (B_q X_r - X_r diag(b_q)),

where B' is Σ t_q B_q without its diagonal and without the entries that X has. Let G ≥ |B' + C| entry by entry, without the
diagonal of C, which is known at each value. The terms beside diag(z + Σ t_q b_q + c(t)) are bounded by

    F = G + (I - |X|)⁻¹ |X| (G + |diag C|),   |(I + X)⁻¹ - I| ≤ (I - |X|)⁻¹ |X|.

Each eigenvalue is in the union of the discs around these centres with radii Σ_j f_ij. If a disc is clear of all others for all
values, its radius shrinks to f_ii + τ r_i, r_i = Σ_{j≠i} f_ij, by a scaled similarity (`exclusion.isolated`). So the sign of
Re λ is known at each value at which the centre is farther from the axis than the radius.

Sources: S. Gershgorin 1931; R. S. Varga, Geršgorin and His Circles (2004), sec. 1.1 and 2.1 (scaled discs and their counts); A.
Berman, R. J. Plemmons, Nonnegative Matrices (1994), ch. 6: (I - |X|)⁻¹ ≥ 0 if (I - |X|)w = 1 has a solution w > 0.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, Array
from femsub.stability.exclusion import first_turn, isolated


class Linear(Protocol):
    """a(θ) = unit (a_0 + Σ θ_i a_i) and b alike, (q + 1, k, k); columns of x (d, k) are the shapes of states."""

    @property
    def a(self) -> Array: ...
    @property
    def b(self) -> Array: ...
    @property
    def x(self) -> Array: ...
    @property
    def unit(self) -> float: ...


class Companion(NamedTuple):
    """The first-order form of λ² M + λ D + K with states (x, λx / unit)."""

    a: Array
    b: Array
    x: Array
    unit: float

    @classmethod
    def of(cls, M: list[Array], D: list[Array], K: list[Array], unit: float | None = None) -> Companion:
        """The pencil of terms (n, n), each with a factor of its own, in the order M, D, K."""
        n = len(M[0])
        unit = unit or float(np.sqrt(sum(np.linalg.norm(A) for A in K) / sum(np.linalg.norm(A) for A in M))) or 1.0
        terms = [*((A, 2) for A in M), *((A, 1) for A in D), *((A, 0) for A in K)]
        a, b = np.zeros((2, len(terms) + 1, 2 * n, 2 * n))
        a[0, :n, n:], b[0, :n, :n] = np.eye(n), np.eye(n)
        for i, (A, power) in enumerate(terms, 1):
            if power == 2:
                b[i, n:, n:] = A
            else:
                a[i, n:, power * n:(power + 1) * n] = -A * unit ** (power - 2.0)
        return cls(a, b, np.eye(n, 2 * n), unit)

    @classmethod
    def between(cls, M: list[Array], D: list[Array], K: list[Array], unit: float, right: Array, left: Array) -> Companion:
        """a = z'ᵀx' - zᵀ(Kx + unit Dx') and b = z'ᵀx + unit² zᵀMx' of right states (x, x') and left ones (z', z), (2n, k)."""
        (x, moving), (other, z) = np.split(right, 2), np.split(left, 2)
        a, b = np.zeros((2, 1 + len(M) + len(D) + len(K), x.shape[1], x.shape[1]))
        a[0], b[0] = other.T @ moving, other.T @ x
        terms = [*((b, unit**2, A, moving) for A in M), *((a, -unit, A, moving) for A in D), *((a, -1.0, A, x) for A in K)]
        for i, (into, scale, A, part) in enumerate(terms, 1):
            into[i] = scale * (z.T @ (A @ part))
        return cls(a, b, x, unit)


class Middle(NamedTuple):
    """The decomposition at the middle of some values: z (k,), V, V⁻¹ and b⁻¹ (k, k), and a bound of the rounding in V⁻¹ b⁻¹a V.

    z has the `upper` eigenvalues with Im z > 0, their conjugates in the same order, and the real eigenvalues.
    """

    linear: Linear
    upper: int
    z: Array
    V: Array
    inverse: Array
    solved: Array
    noise: Array

    @classmethod
    def of(cls, linear: Linear, factors: Array) -> Middle | None:
        """The decomposition at these factors (q,); None if b or V is singular."""
        a, b = ((np.append(1.0, factors) @ part.reshape(len(part), -1)).reshape(part.shape[1:]) for part in (linear.a, linear.b))
        try:
            solved = linear.unit * np.linalg.inv(b)
            A = solved @ a
            z, V = np.linalg.eig(A)
            inverse = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            return None
        up = np.flatnonzero(z.imag > 0)
        order = np.concatenate([up, up + 1, np.flatnonzero(z.imag == 0)])
        z, V, inverse = z[order].astype(complex), V[:, order], inverse[order]
        # right and left vectors of equal lengths: row sums are then smallest
        even = np.sqrt(np.linalg.norm(inverse, axis=1))
        V, inverse = V * even, inverse / even[:, None]
        n = len(up)
        z[n:2 * n], V[:, n:2 * n], inverse[n:2 * n] = z[:n].conj(), V[:, :n].conj(), inverse[:n].conj()
        size = np.abs(solved) @ np.abs(a)
        noise = np.abs(inverse @ (A @ V) - np.diag(z)) + 4 * EPS * (np.abs(inverse) @ (size @ np.abs(V)))
        return None if not np.isfinite(noise).all() else cls(linear, n, z, V, inverse, solved, noise)

    def around(self, changes: Array, directions: Array) -> Around:
        """The enclosures for these changes of the factors (m, q), and for all between; F is infinite if vectors turn too much.

        `directions` (d, q) are the main directions of change, for example one for each parameter. Factors of b must not change.
        """
        varied = np.flatnonzero(changes.any(axis=0))
        parts = self.solved @ self.linear.a[1 + varied]
        size = np.linalg.norm(parts, axis=(1, 2))
        varied, parts, size = varied[size > 0], parts[size > 0], size[size > 0]
        # the directions of unit size; the part of the changes outside their span counts as rounding
        scaled, own = changes[:, varied] * size, directions[:, varied] * size
        own = own[own.any(axis=1)]
        share = np.linalg.pinv(own)
        rest = scaled - scaled @ share @ own
        most = np.abs(scaled @ share).max(axis=0, initial=0.0)
        own, most, share = own[most > 0], most[most > 0], share[:, most > 0]
        to = np.zeros((changes.shape[1], len(own)))
        to[varied] = size[:, None] * share / most
        mixed = np.tensordot(most[:, None] * own / size, parts, 1)
        left = np.tensordot(np.abs(rest).max(axis=0, initial=0.0) / size, np.abs(parts), 1)
        # conjugate eigenvalues have conjugate entries: only one half is computed
        k, n = len(self.z), self.upper
        half, partner = np.r_[0:n, 2 * n:k], np.r_[n:2 * n, 0:n, 2 * n:k]
        B = np.empty((len(mixed), k, k), dtype=complex)
        for own, part in zip(B, mixed, strict=True):
            own[:, half] = self.inverse @ (part @ self.V[:, half])
            own[:, n:2 * n] = own[partner][:, :n].conj()
        entries, b = np.abs(B).sum(axis=0), np.einsum("qii->qi", B)
        X = first_turn(self.z, B, entries)
        turn = np.abs(X).sum(axis=0)
        G = np.where(turn > 0, 0.0, entries)
        np.fill_diagonal(G, 0.0)
        curved, short = np.zeros((len(B), len(B), k), dtype=complex), (B[:, half].astype(np.complex64), X.astype(np.complex64))
        for q in range(len(B)):
            for r in range(q, len(B)):
                pairs = [(q, r)] if q == r else [(q, r), (r, q)]
                C = sum(short[0][i] @ short[1][j] - short[1][j][half] * b[i].astype(np.complex64) for i, j in pairs)
                C[np.arange(len(half)), half] = 0.0
                G[half] += np.abs(C)
                curved[q, r] = sum(np.einsum("ij,ji->i", B[i], X[j]) for i, j in pairs)
        G[n:2 * n] = G[:n][:, partner]
        # rounding: of the middle and of the changes, of the turn, and of the products in C
        moved = np.tensordot(np.abs(changes[:, varied]).max(axis=0, initial=0.0), np.abs(self.linear.a[1 + varied]), 1)
        other = left + 4 * EPS * (np.abs(self.solved) @ moved)
        noise = self.noise + np.abs(self.inverse) @ (other @ np.abs(self.V))
        G += noise + noise @ turn + 2 * k * np.finfo(np.float32).eps * (entries @ turn)
        whole = turn @ (G + np.diag(np.abs(curved).sum(axis=(0, 1))))
        try:
            found = np.linalg.solve(np.eye(len(G)) - turn, np.column_stack([whole, np.ones(len(G))]))
        except np.linalg.LinAlgError:
            found = np.full((len(G), len(G) + 1), np.inf)
        held = (found[:, -1] > 0).all() and np.isfinite(found).all()
        return Around(self, to, B, b, curved, G + np.maximum(found[:, :-1], 0.0) if held else np.full_like(G, np.inf))


class Around(NamedTuple):
    """The enclosures for changes of the factors around a `Middle`: t = change @ `to`, and F as in the text of the module."""

    middle: Middle
    to: Array  #: (q, directions)
    B: Array
    b: Array
    curved: Array
    F: Array

    def centres(self, changes: Array, at: Array) -> Array:
        """z + Σ t_q b_q + c(t) of the eigenvalues `at`, (m, len(at))."""
        t = changes @ self.to
        found = self.middle.z[at] + t @ self.b[:, at]
        for q, row in enumerate(self.curved):
            for r in range(q, len(row)):
                found += (t[:, q] * t[:, r])[:, None] * row[r, at]
        return np.asarray(found)

    def radii(self) -> tuple[Array, Array, Array]:
        """For each disc (k,): the radius with which it is clear of all others, or inf; the plain radius; the number of its group.

        Plain discs that may overlap at some value belong to one group.
        """
        own, z = self.F.diagonal(), self.middle.z
        plain = self.F.sum(axis=1)
        apart = np.abs(z[:, None] - z) - own[:, None] - own
        for move in (*self.b, *self.curved.reshape(-1, len(z))):
            if move.any():
                apart -= np.abs(move[:, None] - move)
        np.fill_diagonal(apart, np.inf)
        links = sp.csr_array(apart <= (plain - own)[:, None] + (plain - own))
        return isolated(self.F, apart) + own, plain, sp.csgraph.connected_components(links, directed=False)[1]

    def votes(self, changes: Array, at: Array, known: Array) -> tuple[Array, Array, Array]:
        """Centres of the eigenvalues `at` (m, k); votes (m, k); and the radius (k,) of each enclosure.

        A vote is 1 if the eigenvalue grows, -1 if it decays, 0 within `known` of the axis, and 2 if undecided. `known` (k,) is
        the error radius that each eigenvalue has anyway, such as that of a reduced model.
        """
        centres = self.centres(changes, at)
        if not np.isfinite(self.F).all():
            return centres, np.full(centres.shape, 2), np.full(len(at), np.inf)
        alone, plain, group = self.radii()
        rate, radius = centres.real, alone[at]
        votes = np.where(np.abs(rate) > radius + known, np.sign(rate).astype(int), np.where(np.abs(rate) + radius <= known, 0, 2))
        for k in np.flatnonzero(~np.isfinite(radius)):  # if a group is on one side, all its members are
            every = np.flatnonzero(group == group[at[k]])
            other = self.centres(changes, every).real
            beyond = np.abs(other) > plain[every] + known[k]
            one_side = beyond.all(axis=1) & (np.sign(other) == np.sign(other[:, :1])).all(axis=1)
            votes[one_side, k] = np.sign(other[one_side, 0]).astype(int)
        return centres, votes, np.where(np.isfinite(radius), radius, plain[at])

    def turning(self, changes: Array, at: Array) -> float:
        """A measure of how much changes (m, q) turn the vectors of these eigenvalues, and so of the gain by halving them."""
        t = np.abs(changes @ self.to).max(axis=0)
        among = np.abs(self.B[:, at][:, :, at]) * t[:, None, None]
        gap = np.abs(self.middle.z[at, None] - self.middle.z[at]) + among.sum(axis=0)
        np.fill_diagonal(gap, np.inf)
        return float((among.sum(axis=0) / np.where(gap > 0, gap, 1.0)).sum())
