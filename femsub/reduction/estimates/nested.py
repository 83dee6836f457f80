"""Error estimates of a reduced model's frequencies and complex eigenvalues, without a solution of the full component.

Everything here is dense and small. `Nested` holds M, D and K in coordinates U = [C Φ Ξ]. They contain the reduced model of
every size up to the number of modes in Φ. Ξ = (I - ΦΦᵀM)K⁻¹[…] adds the static responses to the residuals of the largest one.
Joined parts form one component: its fixed-interface modes are those of the parts, and each part has its own number of modes.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from femsub.algebra import ROUNDING, WIDE, negative_eigenvalues, without
from femsub.checks import EPS, EQUAL, Array, Matrix
from femsub.model import SHARE, Estimate, Pencil, RigidMotion, Substructure, beyond, in_band, moving, units, upper, within
from femsub.modes import all_modes, energy_directions, match, motion_of, region_of, search, solve

FAR = 2.0  # relative distance |Δλ| / |λ| above which two eigenvalues are not compared
Count: TypeAlias = "int | Array"  # number of modes; for joined parts one number for each part
Solution: TypeAlias = tuple[Array, Array, Array, Array, Array]  # of a damped model, see `Nested.damped`
# accepted residual of modes of these small matrices: ω² of joined parts span up to 12 decades; the error of ω is much smaller
JOINED_RESIDUAL = 1e-7
MARGIN = 1.01  # safety factor on each estimate: with all modes the estimate is the error itself, and rounding could undercut it


@dataclass(frozen=True, eq=False)
class Nested:
    """M, D, K (R, R) in U = [C Φ Ξ]: `constraint` columns C, `rigid` rigid-body modes, the elastic modes of `values`, Ξ.

    CᵀK[Φ Ξ] = 0, ΦᵀKΦ = diag(values), ΦᵀMΞ = ΦᵀKΞ = 0, ΞᵀKΞ diagonal. `loads` = UᵀF (R, s) are the forces whose static
    response belongs to every reduced model. All K⁻¹F and, for C, all K⁻¹MC lie in the span of U. D is None without damping.
    `rounding` (n_c, n_c) bounds the rounding error of CᵀKC, which is large where stiff springs meet a soft interface. A static
    shape counts as massless if its mass per stiffness is below `lightest` times that of the modes (`static_shapes.lightest`).

    For joined parts, `parts` holds the numbers of elastic modes and of columns of Ξ of each part, in the order of Φ and Ξ.
    A `count` of modes is then one number for each part. ω and |λ| above `limit` are not computed if that saves time.
    `motion` is the rigid motion in the coordinates of C and the rigid-body modes, if the component carries it. A band must end
    below `share` times the cut-off.
    """

    M: Array
    K: Array
    D: Array | None
    constraint: int
    rigid: int
    values: Array
    loads: Array
    rounding: Array
    symmetric: bool = True
    lightest: float = 1e-14
    parts: tuple[tuple[int, int], ...] = ()
    limit: float = np.inf
    motion: RigidMotion | None = None
    share: float = SHARE

    @classmethod
    def whole(cls, sub: Substructure, pencil: Pencil | None) -> Nested:
        """The reference of a component that keeps all of its DOF. `pencil` has its damping."""
        dense, none = (pencil or sub.pencil).dense(), np.zeros((sub.size, 0))
        return cls(dense.M, dense.K, None if pencil is None else dense.D, sub.size, 0, none[0], none, np.zeros(dense.K.shape),
                   pencil is None or pencil.symmetric[1], motion=motion_of((pencil or sub).rigid_motion))

    @property
    def modes(self) -> int:
        return len(self.values)

    @cached_property
    def most(self) -> Array:
        """The number of all modes of each part."""
        return np.array([modes for modes, _ in self.parts] or [self.modes])

    @cached_property
    def _owner(self) -> Array:
        """The part of each elastic mode."""
        return np.repeat(np.arange(len(self.most)), self.most)

    @cached_property
    def _groups(self) -> list[slice]:
        """The columns of Ξ of each part."""
        ends = self.rest.start + np.cumsum([0, *(rests for _, rests in self.parts)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)] or [self.rest]

    def held(self, count: Count) -> Array:
        """Which elastic modes a model with `count` modes keeps: the lowest of each part, bool (modes,)."""
        rank = np.arange(self.modes) - np.append(0, np.cumsum(self.most))[self._owner]
        return rank < np.atleast_1d(count)[self._owner]

    @cached_property
    def _first(self) -> int:
        """The column of the first elastic mode."""
        return self.constraint + self.rigid

    @cached_property
    def rest(self) -> slice:
        """The columns of Ξ."""
        return slice(self._first + self.modes, len(self.M))

    @cached_property
    def complete(self) -> bool:
        """Whether all modes of the component are in Φ. Ξ is then empty, or holds the static shapes of massless DOF."""
        return not self.M.diagonal()[self.rest].any()

    @cached_property
    def tops(self) -> Array:
        """The highest known ω² of each part; inf if no shape with mass is left out, or if no mode is known."""
        mass, found = self.M.diagonal(), np.full(len(self.most), np.inf)
        for at, group in enumerate(self._groups):
            mine = self.values[self._owner == at]
            if len(mine) and mass[group].any():
                found[at] = mine[-1]
        return found

    def cutoff(self, count: Count) -> float:
        """The frequency of the first mode left out if `count` modes are kept (inf if none is known)."""
        left = np.append(self.values[~self.held(count)], self.tops)
        return float(np.sqrt(left.min()))

    def basis(self, count: Count) -> Array:
        """T (R, r): the reduced model with the `count` lowest elastic modes (of each part) in the coordinates of U."""
        kept = self._first + np.flatnonzero(self.held(count))
        return np.hstack([np.eye(len(self.M))[:, np.append(np.arange(self._first), kept)], self.static(count)[0]])

    def static(self, count: Count) -> tuple[Array, Array, Array]:
        """The static shapes (R, s) of the model with `count` modes, orthogonal, with their stiffness and mass (1 or exactly 0).

        They are responses to F: Ξ(ΞᵀKΞ)⁻¹ΞᵀF plus φ_k (φ_kᵀF)/ω_k² for each mode left out. Dependent shapes are dropped.
        """
        first, holds = self._first, self.held(count)
        kept, left = first + np.flatnonzero(holds), first + np.flatnonzero(~holds)
        values = self.values[holds]
        shapes = np.zeros(self.loads.shape)
        shapes[left] = self.loads[left] / self.values[~holds, None]
        shapes[self.rest] = self.loads[self.rest] / self.K.diagonal()[self.rest, None]
        held = self.loads[kept]
        energy = shapes.T @ (self.K @ shapes)
        whole = energy.diagonal() + np.einsum("ij,ij->j", held, held / values[:, None])
        change, _ = energy_directions(energy, whole)
        mass = self.M.diagonal()[first:]
        inertia, turn = np.linalg.eigh((shapes[first:] @ change).T @ (mass[:, None] * (shapes[first:] @ change)))
        inertia, change = inertia[::-1], change @ turn[:, ::-1]
        motion = np.sqrt(mass @ shapes[first:] ** 2 + ((held / values[:, None]) ** 2).sum(axis=0))
        top = np.append(inertia, 1 / np.sort(values)[-1:]).max(initial=0.0)
        massless = inertia <= np.maximum(self.lightest * top, (ROUNDING * (np.abs(change).T @ motion)) ** 2)
        unit = np.where(massless, 1.0, inertia)
        shapes = shapes @ (change / np.sqrt(unit))
        shapes[np.ix_(first + np.flatnonzero(mass), massless)] = 0.0
        return shapes, 1 / unit, np.where(massless, 0.0, 1.0)

    def projected(self, T: Array) -> tuple[Array, Array]:
        """TᵀMT and TᵀKT, exactly symmetric."""
        M, K = T.T @ self.M @ T, T.T @ self.K @ T
        return (M + M.T) / 2, (K + K.T) / 2

    def model(self, count: Count) -> tuple[Array, Array, Array]:
        """`basis`, M and K of the reduced model with `count` modes."""
        T = self.basis(count)
        if self.loads.shape[1]:
            return T, *self.projected(T)
        kept = np.append(np.arange(self._first), self._first + np.flatnonzero(self.held(count)))
        return T, self.M[np.ix_(kept, kept)], self.K[np.ix_(kept, kept)]

    def undamped(self, count: Count) -> tuple[Array, Array]:
        """ω of the undamped reduced model with `count` modes, ascending and without rigid-body modes, and their rounding."""
        if not self.constraint:
            omega = np.sqrt(np.sort(self.values[self.held(count)]))
            return omega, np.zeros(len(omega))
        T, M, K = self.model(count)
        omega, shapes = self.lowest(M, K)
        q = T[:self.constraint] @ shapes
        solver = EPS * omega**3 / omega[:1] ** 2  # each 1/ω² has the rounding error of the largest
        return omega, np.einsum("ij,ij->j", q, self.rounding @ q) / (2 * omega) + solver

    def lowest(self, M: Array, K: Array) -> tuple[Array, Array]:
        """ω and shapes, φᵀMφ = 1, of a reduced model up to `limit`, ascending and without rigid-body modes.

        Its first coordinates are C.
        """
        if np.isfinite(self.limit):
            with suppress(la.LinAlgError):
                inverse, shapes = la.eigh(*self.pencil_up_to_limit(M, K), check_finite=False,
                                          subset_by_value=(self.limit**-2, np.inf))
                return inverse[::-1] ** -0.5, (shapes * inverse**-0.5)[:, ::-1]  # LAPACK's shapes have unit energy
        found = all_modes(K, M, JOINED_RESIDUAL, self._carried(len(K)))
        return found.elastic, found.shapes[:, found.rigid:]

    def pencil_up_to_limit(self, M: Array, K: Array) -> tuple[Array, Array]:
        """M, and K with rigid motion moved to ω = 2 limit, so that K is positive definite. The first coordinates are C."""
        held = M[:, :self.constraint] @ self._rigid
        return M, K + (2 * self.limit) ** 2 * (held @ held.T)

    def _carried(self, size: int) -> RigidMotion | None:
        """The rigid motion in `size` coordinates; the first ones are C and the rigid-body modes."""
        if self.motion is None:
            return None
        return RigidMotion(np.pad(self.motion.shapes[:self._first], ((0, size - self._first), (0, 0))), self.motion.free)

    @cached_property
    def _rounding(self) -> Array:
        """`rounding` without `motion`: rigid motion has stiffness 0 without a rounding error."""
        if self.motion is None:
            return self.rounding
        bare = self.K.diagonal()[:self.constraint]
        return without(self.rounding, self.motion.shapes[:self.constraint], np.where(bare > 0, bare, 1.0) ** -0.5)

    @cached_property
    def _rigid(self) -> Array:
        """Rigid-body modes Z in C (n_c, n_r), ZᵀMZ = I. For joined parts they have no other coordinates."""
        part = slice(0, self.constraint)
        Z = self.at_rest.shapes[part]
        return Z @ np.linalg.inv(np.linalg.cholesky(Z.T @ self.M[part, part] @ Z)).T if Z.size else Z

    @cached_property
    def at_rest(self) -> RigidMotion:
        """`motion`, or if it is None the rigid motion found from M and K in [C Φ]."""
        if self.motion is not None:
            return self.motion
        kept = self._first + self.modes
        found = all_modes(self.K[:kept, :kept], self.M[:kept, :kept], JOINED_RESIDUAL)
        Z, D = found.shapes[:, :found.rigid], np.zeros((kept, kept)) if self.D is None else self.D[:kept, :kept]
        return RigidMotion.of(Z, D, units(self.M[:kept, :kept]), Z)

    @cached_property
    def largest(self) -> tuple[Array, Array]:
        """ω of the largest reduced model, and their rounding."""
        return self.undamped(self.most)

    @cached_property
    def bounds(self) -> Array:
        """Lower bounds of the component's elastic frequencies, ascending. Only those below the cut-off are meaningful.

        The component's ω² are the λ at which S(λ) = K_r - λM_r - λ² B(Ω² - λ)⁻¹Bᵀ is singular. Here K_r and M_r belong to
        [C Φ], Ω² ≥ θ_c to the modes left out, and B = CᵀMΦ_left is their coupling. Each of joined parts adds such a term with
        its own θ_c. For λ < θ_c

            B(Ω² - λ)⁻¹Bᵀ ≤ G₀ + λG₁ / (1 - λ/θ_c),   G₀ = BΩ⁻²Bᵀ = ZᵀK⁻¹Z, G₁ = BΩ⁻⁴Bᵀ = ZᵀK⁻¹MK⁻¹Z,

        where Z is MC without the contribution of the kept modes, and K⁻¹ that of the interior. With the right-hand side
        inserted, S has at least as many negative eigenvalues, hence its roots are not larger (Sylvester's law of inertia,
        as in the bounds of Lehmann and of Kato). Substitute modes have exactly this right-hand side: some at θ_c with
        BBᵀ = θ_c²G₁, others at infinity with G₀ - θ_cG₁. The bounds follow from one symmetric eigenproblem.

        References
        ----------
        R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics (2006), ch. 17; T. Kato, J. Phys. Soc. Jpn. 4
        (1949) 334; C. Beattie, F. Goerisch, Numer. Math. 72 (1995) 143.
        """
        if not self.constraint:
            return np.sqrt(np.sort(self.values))
        S, below = self._substitutes
        if (found := self._bounds_of_band(S, below)) is not None:
            return found
        kept = self._first + self.modes
        ritz = all_modes(self.K[:kept, :kept], self.M[:kept, :kept], JOINED_RESIDUAL, self._carried(kept))
        q, r = ritz.shapes[:self.constraint], ritz.rigid
        if self.complete:
            return ritz.frequencies[r:]
        L = S @ q
        a, b = len(ritz.eigenvalues), len(below)
        weight = np.concatenate([np.zeros(r), ritz.eigenvalues[r:] ** -0.5])
        mass = np.zeros((a + b,) * 2)
        mass[:a, :a], mass[:a, a:], mass[a:, :a] = np.eye(a), L.T, L
        mass[a:, a:] = np.diag(below)
        elastic = mass[r:, r:] - mass[r:, :r] @ mass[:r, r:]  # rigid-body motion is condensed: it has no stiffness
        scale = np.concatenate([weight[r:], np.ones(b)])
        inverse = np.linalg.eigvalsh(scale[:, None] * elastic * scale)[::-1]
        inverse = inverse[inverse > 0]
        return inverse[:a - r] ** -0.5

    @property
    def _substitutes(self) -> tuple[Matrix, Array]:
        """The substitute modes of `bounds`: their coupling with C, scaled by stiffness, sparse (s, n_c), and their 1/ω² (s,).

        The modes at θ_c of all parts come first, then the modes at infinity. Ξ is orthogonal in M and K, so each column of Ξ
        gives one mode of each kind.
        """
        top = np.concatenate([np.full(group.stop - group.start, value)
                              for group, value in zip(self._groups, self.tops, strict=True)])
        mass, stiffness = self.M.diagonal()[self.rest], self.K.diagonal()[self.rest]
        top = np.where(np.isfinite(top), top, 0.0)
        dynamic = np.sqrt(top * mass) / stiffness
        soft = np.where(top > 0, np.sqrt(np.maximum(1 - top * mass / stiffness, 0.0) / stiffness), 0.0)  # 0: massless
        coupling, weight = sp.csr_array(self.M[self.rest, :self.constraint]), np.concatenate([dynamic, soft])
        below = np.concatenate([np.divide(1.0, top, out=np.zeros(len(top)), where=top > 0), np.zeros(len(top))])
        felt = weight > EPS * np.append(dynamic, dynamic + soft)
        return sp.csr_array(sp.diags_array(weight[felt]) @ sp.vstack([coupling, coupling], format="csr")[felt]), below[felt]

    def _bounds_of_band(self, S: Matrix, below: Array) -> Array | None:
        """The `bounds` up to at least 0.6 times the limit, which is beyond the band.

        None if there is no limit, or if there are rigid-body modes outside C.

        Take Φ and the substitute modes together. E is their coupling with C scaled by stiffness, and d their 1/ω². The bounds are
        θ^(-1/2) for the eigenvalues θ of

            [ R⁻¹MR⁻ᵀ   R⁻¹Eᵀ   ]
            [ ER⁻ᵀ      diag(d) ] - vvᵀ,   RRᵀ = K + (2 limit)² MZ(MZ)ᵀ,   v = [R⁻¹MZ; EZ],

        M, K and the rigid motion Z belong to C alone. So no mode of [C Φ] is needed. The number of bounds below ω = √λ is the
        number of negative eigenvalues of 1 - λd and of K - λM - λ² Eᵀ(1 - λd)⁻¹E, minus the number of rigid-body modes. Lanczos
        must find the same number.
        """
        if not np.isfinite(self.limit) or self.rigid:
            return None
        part, inner, limit = slice(0, self.constraint), slice(self.constraint, self.rest.start), (0.6 * self.limit) ** 2
        M, K, Z = self.M[part, part], self.K[part, part], self._rigid
        held = M @ Z
        try:
            R = la.cholesky(K + (2 * self.limit) ** 2 * (held @ held.T), lower=True, check_finite=False)
        except la.LinAlgError:
            return None
        E = sp.vstack([sp.diags_array(self.values**-0.5) @ sp.csr_array(self.M[inner, part]), S], format="csr")
        d, v = np.concatenate([1 / self.values, below]), np.concatenate([_solved(R, held), E @ Z])
        size = len(R) + len(d)

        def times(x: Array) -> Array:
            x, y = x[:len(R)], x[len(R):]
            z = la.solve_triangular(R, x, lower=True, trans="T", check_finite=False)
            return np.concatenate([_solved(R, M @ z + E.T @ y), E @ z + (y.T * d).T]) - v @ (v[:len(R)].T @ x + v[len(R):].T @ y)

        if size > WIDE:
            left = 1 - limit * d
            left[left == 0] = np.finfo(float).tiny
            felt = (E.T @ sp.diags_array(limit**2 / left) @ E).toarray()
            count = int(np.count_nonzero(left < 0)) + negative_eigenvalues(K - limit * M - (felt + felt.T) / 2) - Z.shape[1]
            if not count:
                return np.zeros(0)
            with suppress(ArpackNoConvergence):
                if count < size / 4:
                    inverse = eigsh(LinearOperator((size, size), times, dtype=float), count, which="LA",
                                    v0=np.random.default_rng(0).standard_normal(size), return_eigenvectors=False)
                    if inverse.min() * limit >= 1 - EQUAL:
                        return np.sort(inverse ** -0.5)
        inverse = np.linalg.eigvalsh(times(np.eye(size)))[::-1]
        return inverse[inverse > 0][:self.rest.start - Z.shape[1]] ** -0.5

    @cached_property
    def reference(self) -> tuple[Array, Array]:
        """λ of the model in all coordinates U with Im λ ≥ 0, without rigid-body eigenvalues, and the rounding error of each λ."""
        return self._solved(None)[:2]

    def damped(self, count: Count) -> Solution:
        """λ (k,), rounding (k,), right and left shapes in U (R, k) and |yᴴP'(λ)x| of the reduced model, Im λ ≥ 0."""
        return self._of_all_modes if np.array_equal(np.atleast_1d(count), self.most) else self._solved(self.basis(count))

    @cached_property
    def _of_all_modes(self) -> Solution:
        """`damped` of the largest model, stored since it is needed more than once."""
        return self._solved(self.basis(self.most))

    def _solved(self, T: Array | None) -> Solution:
        """`damped` for TᵀP(λ)T: eigenpairs in ascending |λ| up to the limit, without rigid motion. None: T is the identity."""
        assert self.D is not None
        M, K, D = (self.M, self.K, self.D) if T is None else (*self.projected(T), T.T @ self.D @ T)
        pencil = Pencil(M, (D + D.T) / 2 if self.symmetric else D, K)
        pencil = pencil.carrying(self._carried(len(M)), pencil.noise)
        if np.isfinite(self.limit):
            found = search(pencil, region_of(pencil, None, (0.0, self.limit), None), False)
            near = np.abs(found.values) <= self.limit
            values, X, Y = found.values[near], found.X[:, near], found.Y[:, near]
        else:
            values, X, Y = solve(pencil)
        slope = np.abs(np.einsum("ij,ij->j", Y.conj(), (pencil.M @ X) * (2 * values) + pencil.D @ X))
        x, y, size = np.abs(X), np.abs(Y), np.abs(values)
        noise = EPS * np.einsum("ij,ij->j", y, (np.abs(M) @ x) * size**2 + (np.abs(D) @ x) * size)
        noise += EPS * _product(K, X, Y)  # energies, not entries: cancellation in soft motion is covered by `rounding`
        X, Y = (X, Y) if T is None else (T @ X, T @ Y)
        noise += _product(self._rounding, X[:self.constraint], Y[:self.constraint])
        bar = np.divide(noise, slope, out=np.full_like(slope, np.inf), where=slope > 0)
        keep = upper(values) & (values != 0)
        if zeros := self.at_rest.zeros:
            keep &= moving(values, bar)
            keep[np.argsort(np.abs(values), kind="stable")[:zeros]] = False
        order = np.flatnonzero(keep)[np.argsort(np.abs(values[keep]), kind="stable")]
        return values[order], bar[order], X[:, order], Y[:, order], slope[order]

    @cached_property
    def doubt(self) -> tuple[Array, Array]:
        """λ of the largest reduced model, and a bound of the reference's error near each.

        With r = P(λ)Vq and s = P(λ)ᴴVz the component's λ differs by sᴴ P_l(λ)⁻¹ r / (zᴴP'q) to first order. P_l is P in the
        modes left out; the residuals of Craig-Bampton and Craig-Chang act on these modes only. U contains K⁻¹r and K⁻¹s, so
        the reference contains the first two terms of

            P_l⁻¹ = K_l⁻¹ - K_l⁻¹(λ²M + λD)K_l⁻¹ + …

        and neglects those of third and higher order. With ρ = |λ|²/ω_cut² these are at most
        ρ²/(1 - ρ) sqrt(rᴴK_l⁻¹r · sᴴK_l⁻¹s) / |zᴴP'q|, if D is small in the modes left out.

        References
        ----------
        F. Tisseur, Linear Algebra Appl. 309 (2000) 339 (left vectors); Z. Bai, Y. Su, SIAM J. Sci. Comput. 26 (2005)
        1692 (second-order Krylov spaces).
        """
        assert self.D is not None
        values, _, X, Y, slope = self.damped(self.most)
        if self.rest.start == self.rest.stop or not self.modes:  # nothing with mass is left out
            return values, np.zeros(len(values))
        pencil = Pencil(self.M, self.D, self.K)
        stiffness = self.K.diagonal()[self.rest, None]
        right = pencil.residual(values, X)[self.rest]
        left = right.conj() if self.symmetric else pencil.transposed().residual(values.conj(), Y)[self.rest]
        size = np.sqrt((np.abs(right) ** 2 / stiffness).sum(axis=0) * (np.abs(left) ** 2 / stiffness).sum(axis=0))
        ratio = np.minimum(np.abs(values) ** 2 / self.tops.min(), SHARE)
        return values, ratio**2 / (1 - ratio) * np.divide(size, slope, out=np.full(len(size), np.inf), where=slope > 0)

    def estimate(self, count: Count, band: tuple[float, float], tol: float, damped: bool = True) -> Estimate:
        """The error estimate of the reduced model with `count` modes."""
        found = self.damped(count)[:2] if damped and self.D is not None else None
        judged = self.judged(*self.undamped(count), found, band, tol)
        return replace(judged, modes=int(self.held(count).sum()), cutoff=self.cutoff(count))

    def judged(self, omega: Array, rounding: Array, found: tuple[Array, Array] | None, band: tuple[float, float],
               tol: float) -> Estimate:
        """The error estimate of any reduced model, from its elastic ω, its λ (`found`), and the rounding of each.

        The component's ω lie between `bounds` and the ω of the largest model here. This does not depend on the reduced model.
        """
        low, high = self.bounds, self.largest[0]
        known = min(len(omega), len(low), len(high))
        above = np.maximum(omega[:known], high[:known])
        inside = np.flatnonzero(~beyond(low[:known], band[1]) & ~beyond(band[0], above))
        apart = np.maximum(omega[inside] - low[inside], high[inside] - omega[inside])
        error = MARGIN * np.maximum(apart, 0.0) / low[inside]
        error += rounding[inside] / omega[inside] + 4 * EPS
        lacking = int(np.count_nonzero(~beyond(low[known:], band[1])))
        values, errors, unmatched = np.zeros(0, dtype=complex), np.zeros(0), lacking
        if found is not None:
            values, bar = found
            exact, exact_bar = self.reference
            at, to, distance, concerned, alone = compared(exact, values, band, within(exact, band))
            largest, doubt = self.doubt
            near = match(exact, largest, far=FAR)
            tail = np.zeros(len(exact))
            tail[near[0]] = doubt[near[1]]
            errors = ((MARGIN * (distance + tail[at]) + exact_bar[at] + bar[to]) / np.abs(exact[at]))[concerned]
            values, unmatched = values[to[concerned]], unmatched + alone
        return Estimate(band, tol, 0, np.inf, omega[inside], error, values, errors, unmatched, self.modes, self.share)

    def floor(self, band: tuple[float, float], damped: bool = True) -> float:
        """The largest relative error that rounding alone may have made in the band."""
        omega, rounding = self.largest
        inside = in_band(omega, band)
        floor = float((rounding[inside] / omega[inside]).max(initial=4 * EPS))
        if self.D is None or not damped:
            return floor
        exact, bar = self.reference
        inside = within(exact, band)
        return max(floor, float((bar[inside] / np.abs(exact[inside])).max(initial=0.0)))


def compared(exact: Array, found: Array, band: tuple[float, float],
             wanted: Array) -> tuple[Array, Array, Array, Array, int]:
    """Pairs of λ of a model, `found`, and of its reference, `exact`. `wanted` marks the λ of the reference that count.

    Returns the indices in `exact` and in `found` and the distance of each pair, whether a pair counts for the band, and the
    number of λ that count but have no partner.
    """
    at, to = match(exact, found, far=FAR)
    distance, present = np.abs(found[to] - exact[at]), within(found, band)
    inside = wanted[at] | (present[to] & (distance < np.abs(exact[at]) / 2))
    return at, to, distance, inside, int(np.delete(wanted, at).sum() + np.delete(present, to).sum())


def _solved(R: Array, b: Array) -> Array:
    """R⁻¹b for a lower triangular R."""
    x: Array = la.solve_triangular(R, b, lower=True, check_finite=False)
    return x


def _product(A: Array, X: Array, Y: Array) -> Array:
    """sqrt(xᴴAx · yᴴAy) for a positive semidefinite A, column by column."""
    x, y = (np.einsum("ij,ij->j", part.conj(), A @ part).real for part in (X, Y))
    return np.sqrt(np.maximum(x, 0.0) * np.maximum(y, 0.0))
