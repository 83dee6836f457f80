"""`FrictionInMotion`: what a `FrictionContact` exerts in motion on one model, nonlinear, with its tangents."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix


@dataclass(frozen=True, eq=False, repr=False)
class FrictionInMotion:
    """f(u, v) of a `FrictionContact` about steady sliding, where u = 0, v = 0 and f = 0.

    At each point the pressure is P = max(p - k Nᵀu, 0), and the second body slides against the first one at the velocity
    w = (V - Tᵀv + Tᵣᵀu) t - (Sᵀv - Sᵣᵀu) s, with the terms of u for a second body that turns. The force on the first body is
    P n + μ(|w|) P w/|w|, less its value in steady sliding. Without a speed or a pressure the sliding direction stays t. Without
    a pressure the surfaces do not part.

    Attributes
    ----------
    N, T, S : sparse or dense, shape (q, p)
        The motion at q points along n, t and s.
    carried : (matrix, matrix) or None
        Tᵣ and Sᵣ (q, p).
    area, speed : ndarray, shape (q,)
        Areas, and V; the speed is None where the sliding direction does not turn.
    slow : float
        Share of V below which friction is proportional to the sliding velocity: its direction has no jump then.
    """

    N: Matrix
    T: Matrix
    S: Matrix
    carried: tuple[Matrix, Matrix] | None
    area: Array
    speed: Array | None
    stiffness: float
    pressure: float
    mu: float
    slope: float
    slow: float = 0.01

    def exerted(self, u: Array, v: Array) -> Array:
        """f(u, v), shape (p,)."""
        more, _ = self._pressed(u)
        if self.speed is None:
            return self.N.T @ (self.area * more) + self.mu * (self.T.T @ (self.area * more))
        along, across, _, mu, _ = self._sliding(u, v)
        P = self.pressure + more
        return (self.N.T @ (self.area * more) + self.T.T @ (self.area * (mu * P * along - self.mu * self.pressure))
                + self.S.T @ (self.area * (mu * P * across)))

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array | None]:
        """(∂f/∂u, ∂f/∂v), shape (p, p) each; None for 0."""
        of_u, *of_v = (A.toarray() if sp.issparse(A) else A for A in self._derivatives(u, v))
        return of_u, of_v[0] if of_v else None

    def at_rest(self) -> list[Matrix]:
        """-∂f/∂u, and -∂f/∂v unless it is 0, at u = 0 and v = 0."""
        rest = np.zeros(self.N.shape[1])
        return [-A for A in self._derivatives(rest, rest)]

    def dense(self, most: int = 100_000) -> FrictionInMotion:
        """The same with dense matrices, if each has `most` numbers or fewer: sparse products of so few take longer."""
        if np.prod(self.N.shape) > most:
            return self
        N, T, S, *carried = (A.toarray() for A in (self.N, self.T, self.S, *(self.carried or ())))
        return replace(self, N=N, T=T, S=S, carried=tuple(carried) or None)

    def _derivatives(self, u: Array, v: Array) -> list[Matrix]:
        """∂f/∂u, and ∂f/∂v unless it is 0."""
        more, touching = self._pressed(u)
        normal = self._by(-self.stiffness * touching, self.N)
        if self.speed is None:
            return [self.N.T @ normal + self.mu * (self.T.T @ normal)]
        along, across, slow, mu, moves = self._sliding(u, v)
        P = self.pressure + more
        turned = mu * P / slow  # of the friction, over a velocity across it
        fallen = moves * (self.slope * P - turned)
        blocks = turned + fallen * along**2, fallen * along * across, turned + fallen * across**2
        of_v = -self._squared(blocks, (self.T, self.S))
        of_u = self.N.T @ normal + self.T.T @ _scaled(mu * along, normal) + self.S.T @ _scaled(mu * across, normal)
        if self.carried is not None:
            of_u = of_u + self._squared(blocks, self.carried)
        return [of_u, of_v]

    def _pressed(self, u: Array) -> tuple[Array, Array]:
        """P - p, and where the surfaces touch."""
        more = -self.stiffness * (self.N @ u)
        touching = more > -self.pressure if self.pressure else np.ones(len(more), dtype=bool)
        return np.where(touching, more, -self.pressure), touching

    def _sliding(self, u: Array, v: Array) -> tuple[Array, Array, Array, Array, Array]:
        """w/|w| along t and s, |w|, μ(|w|), and where |w| is not too small to have a direction."""
        assert self.speed is not None
        along, across = self.speed - self.T @ v, -(self.S @ v)
        if self.carried is not None:
            along, across = along + self.carried[0] @ u, across + self.carried[1] @ u
        size = np.hypot(along, across)
        slow = np.maximum(size, self.slow * self.speed)
        return along / slow, across / slow, slow, self.mu + self.slope * (slow - self.speed), size >= slow

    def _by(self, factor: Array, A: Matrix) -> Matrix:
        """Rows of A times factors and areas."""
        return _scaled(factor * self.area, A)

    def _squared(self, blocks: tuple[Array, Array, Array], right: tuple[Matrix, Matrix]) -> Matrix:
        """[T S]ᵀ [[a, b], [b, c]] of the right pair."""
        a, b, c = blocks
        return self.T.T @ (self._by(a, right[0]) + self._by(b, right[1])) + \
            self.S.T @ (self._by(b, right[0]) + self._by(c, right[1]))


def _scaled(factor: Array, A: Matrix) -> Matrix:
    return sp.diags_array(factor) @ A if sp.issparse(A) else factor[:, None] * A
