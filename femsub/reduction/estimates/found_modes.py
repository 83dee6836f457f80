"""The modes of a part found so far, and its static shapes. There is one factorisation; modes are added, never recomputed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from femsub.algebra import BLOCK, check_columns
from femsub.checks import DENSE, EPS, Array, Matrix
from femsub.model import Pencil, RigidMotion, units
from femsub.modes import NormalModes, independent, lightest, lowest_modes
from femsub.reduction.basis import Kept, Statics, in_blocks
from femsub.reduction.estimates.nested import Nested

TINY = float(np.finfo(float).tiny)


class FoundModes:
    """The modes found so far, and the static shapes without the modes' contribution. `pencil` has the damping of the part."""

    def __init__(self, statics: Statics, pencil: Pencil | None, begin: int = 10) -> None:
        self.statics, self.pencil, self.all = statics, pencil, statics.handle.elastic
        self.found = lowest_modes(statics.handle, min(begin, self.all), evidence=False)
        self.loads = np.hstack([statics.forces, statics.inertia[statics.part.rows]])
        self.rest = statics.handle.elastic_solve(self.loads, self.found.shapes)

    @property
    def modes(self) -> int:
        return len(self.found.eigenvalues) - self.found.rigid

    @property
    def top(self) -> float:
        """The highest frequency found."""
        return float(self.found.frequencies[-1]) if self.modes else 0.0

    @property
    def complete(self) -> bool:
        return self.modes == self.all

    @property
    def spent(self) -> bool:
        """Whether all modes are found, or DENSE/4 modes of a large part, which take as long as all modes of DENSE DOF."""
        return self.complete or (self.modes >= DENSE // 4 and self.statics.handle.K.shape[0] > DENSE)

    @property
    def most(self) -> int:
        """The largest number of modes that a model may have. If more modes exist, the highest one found is the cut-off."""
        return self.modes - (not self.complete)

    def grow(self, count: int) -> None:
        """Compute modes up to `count`, and remove their contribution from the static shapes (no further solve)."""
        handle, sub, count = self.statics.handle, self.statics.part.sub, min(count, self.all)
        if count > self.modes:
            # columns needed: modes twice, Krylov vectors for the new modes, loads and static shapes (twice, for the residuals)
            check_columns(sub.name, sub.size, 5 * (count - self.modes) + 4 * count + 4 * self.loads.shape[1])
            self.replace(lowest_modes(handle, count, known=self.found, evidence=False))

    def reach(self, limit: float, times: float = np.inf) -> None:
        """Compute modes until one lies above `limit`. One step increases their number by the factor `times` at most.

        The number of modes for each step is extrapolated from the modes found so far.
        """
        while not self.complete and self.top <= limit:
            omega = self.found.elastic
            half = len(omega) // 2
            power = np.log(len(omega) / half) / max(np.log(omega[-1] / omega[half - 1]), 1e-3) if half else 1.0
            guess = len(omega) * (limit / omega[-1]) ** min(max(power, 0.5), 3.0)
            count = np.clip(1.1 * guess + 4, 1.5 * len(omega) + 1, 4 * len(omega) + 4)
            self.grow(int(min(count, times * len(omega))))

    def replace(self, found: NormalModes) -> None:
        self.found = found
        self.rest = self.statics.handle.deflate(self.rest, found.shapes)

    def counted_in(self, count: int) -> Kept | None:
        """The `count` kept modes, if an inertia count confirms them and the next mode.

        None if a mode had been missed; it is then computed.
        """
        found = self.found
        if found.tally.counted is None:
            found = lowest_modes(self.statics.handle, min(count + 1, self.all), known=found, defer=True)
            if not np.array_equal(found.eigenvalues, self.found.eigenvalues[:len(found.eigenvalues)]):
                self.replace(lowest_modes(self.statics.handle, self.modes, known=found, evidence=False))
                return None
        return Kept(found, count)

    def nested(self, further: Array | None = None) -> tuple[Nested, Span]:
        """M, D and K in U = [C Φ Ξ], and U. Ξ includes the static responses to `further` loads (n_i, k)."""
        statics, found, loads, rest = self.statics, self.found, self.loads, self.rest
        if further is not None and further.shape[1]:
            loads = np.hstack([loads, further])
            rest = np.hstack([rest, statics.handle.elastic_solve(further, found.shapes)])
        static, stiffness, mass, _ = independent(statics.handle, rest, loads, found.shapes, found.eigenvalues)
        span = Span(statics, found.shapes, static)
        M, K = in_blocks(statics.condensed, found.eigenvalues, stiffness, mass, span.dot(statics.inertia))
        inner = [statics.constraint[statics.part.rows], found.shapes, static]
        forces = np.concatenate([shapes.T @ statics.forces for shapes in inner])
        q = statics.rigid_in(found.rigid, len(M))
        D = None if self.pencil is None else self.pencil.D
        motion = None if q is None else RigidMotion.of(span.times(q), D, units(statics.part.sub.M), q)
        plain = Nested(M, K, None, len(statics.condensed), found.rigid, found.eigenvalues[found.rigid:], forces, statics.rounding,
                       lightest=lightest(statics.handle), motion=motion)
        if self.pencil is None:
            return plain, span
        D, symmetric = span.projected(self.pencil.D), self.pencil.symmetric[1]
        return replace(plain, D=(D + D.T) / 2 if symmetric else D, symmetric=symmetric), span

    def residuals(self, span: Span, sides: list[tuple[Array, Array, bool]]) -> Array:
        """Loads that span the residuals (λ²MΞx + λDUx)/|λ| of eigenpairs λ, x in U; for left vectors, of the transposed pencil.

        The terms in MΦ, F and MC are left out: U already contains K⁻¹ times these loads.
        """
        assert self.pencil is not None
        blocks = []
        for value, x, left in sides:
            D, size = self.pencil.D.T if left else self.pencil.D, np.abs(value)
            for part in (np.real, np.imag):
                static = np.zeros(x.shape)
                static[span.rest] = part(x * (value**2 / size))[span.rest]
                residual = self.pencil.M @ span.times(static) + D @ span.times(part(x * (value / size)))
                blocks.append(residual[self.statics.part.rows])
        return compressed(np.hstack(blocks), self.statics.handle.K.diagonal())


@dataclass(frozen=True, eq=False)
class Span:
    """U = [C Φ Ξ] (n, R) as an operator: Φ and Ξ are large and have interior rows only, so U is never stored."""

    statics: Statics
    modes: Array
    static: Array

    @property
    def rest(self) -> slice:
        """The columns of Ξ."""
        first = self.statics.constraint.shape[1] + self.modes.shape[1]
        return slice(first, first + self.static.shape[1])

    def dot(self, x: Array) -> Array:
        """Uᵀx, shape (R, k), for x (n, k)."""
        inner = x[self.statics.part.rows]
        return np.concatenate([self.statics.constraint.T @ x, self.modes.T @ inner, self.static.T @ inner])

    def times(self, q: Array) -> Array:
        """Uq, shape (n, k)."""
        first, second = self.statics.constraint.shape[1], self.statics.constraint.shape[1] + self.modes.shape[1]
        u = self.statics.constraint @ q[:first]
        u[self.statics.part.rows] += self.modes @ q[first:second] + self.static @ q[second:]
        return u

    def projected(self, D: Matrix) -> Array:
        """UᵀDU, shape (R, R), a block of columns at a time."""
        blocks, rows = [np.zeros((self.rest.stop, 0))], self.statics.part.rows
        for group, own in ((self.statics.constraint, slice(None)), (self.modes, rows), (self.static, rows)):
            for start in range(0, group.shape[1], BLOCK):
                full = np.zeros((self.statics.part.sub.size, min(BLOCK, group.shape[1] - start)), order="F")
                full[own] = group[:, start:start + BLOCK]
                blocks.append(self.dot(D @ full))
        return np.hstack(blocks)


def compressed(columns: Array, stiffness: Array) -> Array:
    """A basis of the columns, orthonormal after scaling each row by sqrt(K_ii); negligible directions are left out."""
    unit = np.where(stiffness > 0, stiffness, 1.0)[:, None] ** -0.5
    scaled = unit * columns
    share, vectors = np.linalg.eigh(scaled.T @ scaled)
    keep = share > EPS * float(share.max(initial=TINY))
    return columns @ (vectors[:, keep] / np.sqrt(share[keep]))
