"""Block Lanczos with thick restart: many right-hand sides at once where single solves are bound by memory traffic.

Krylov-Schur (SLEPc) solves for one right-hand side at a time, and reads the whole factor each time. On bulky solids a
column in a block of 10 costs a quarter of that, while 1.6 times as many columns are needed: see `scripts/bench.py`.
"""

from __future__ import annotations

import numpy as np

from femsub.algebra import Handle
from femsub.checks import EPS, Array, Matrix
from femsub.errors import NotConvergedError

BLOCK = 10  # larger blocks make a column cheaper, but need a longer basis: more solves and more orthogonalisation
RESTARTS = 60
ROWS = 50_000


def block_lanczos(factor: Handle, M: Matrix, sigma: float, count: int, *, tol: float, seed: int = 1,
                  known: Array | None = None) -> tuple[Array, Array]:
    """The eigenvalues of (K - λM)φ = 0 next above σ: A V = V T + Q R Eᵀ, A = (K - σM)⁻¹M, VᵀMV = I, V (n, m), λ = σ + 1/θ.

    `factor` is that of K - σM, which is positive definite. A Ritz pair is accepted if ‖R Eᵀy‖ ≤ tol θ. Each block is
    orthogonalised twice against all earlier ones. A restart keeps the wanted Ritz vectors and half of the others.

    Parameters
    ----------
    factor : Handle
    M : sparse, shape (n, n)
        Positive semidefinite.
    known : ndarray, shape (n, k), optional
        M-orthonormal shapes to deflate.

    Returns
    -------
    eigenvalues : ndarray, shape (count,)
    shapes : ndarray, shape (n, count)
        M-normalised.

    Raises
    ------
    NotConvergedError
        Fewer than `count` Ritz pairs have converged within 60 restarts.

    References
    ----------
    R. G. Grimes, J. G. Lewis, H. D. Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228 (block, shift and invert); K. Wu,
    H. Simon, SIAM J. Matrix Anal. Appl. 22 (2000) 602 (thick restart).
    """
    locked = np.zeros((factor.size, 0)) if known is None else known
    inert = M @ locked
    MX = _ritz_momenta(factor, M, count, tol, seed, locked, inert)
    # z = Ax removes components in the null space of M, and θ = xᵀMz is accurate to rounding for small θ as well
    X = factor.solve(MX)
    X -= locked @ (inert.T @ X)
    theta = np.einsum("ij,ij->j", MX, X)
    return sigma + 1 / theta, X / np.sqrt(np.einsum("ij,ij->j", X, M @ X))


def _ritz_momenta(factor: Handle, M: Matrix, count: int, tol: float, seed: int, locked: Array, inert: Array) -> Array:
    """MX for the wanted Ritz vectors X, shape (n, count). All other memory is freed."""
    n, rng = factor.size, np.random.default_rng(seed)
    room = n - locked.shape[1]
    b = min(BLOCK, room)
    most = min(room, int(2.5 * count) + 2 * b)
    V, MV = np.empty((n, most + b), order="F"), np.empty((n, most + b), order="F")
    T = np.zeros((most + b, most + b))

    def against(W: Array, size: int) -> tuple[Array, Array]:
        """W orthogonalised in two passes against the basis and the locked shapes, and its coefficients in the basis."""
        share = np.zeros((size, W.shape[1]))
        for _ in range(2):
            part = MV[:, :size].T @ W
            W = W - V[:, :size] @ part - locked @ (inert.T @ W)
            share += part
        return W, share

    def put(W: Array, at: int) -> Array:
        """Append W made M-orthonormal, W = Q R; return R. Columns that are only rounding are replaced by random ones, R = 0."""
        size, R = W.shape[1], np.eye(W.shape[1])
        while True:
            MW = M @ W
            G = W.T @ MW
            values, Y = np.linalg.eigh((G + G.T) / 2)
            good = values > (size * EPS) ** 2 * max(float(values[-1]), float(np.finfo(float).tiny))
            root = np.sqrt(values[good])
            change, lost = Y[:, good] / root, size - int(good.sum())
            R = np.vstack([(root[:, None] * Y[:, good].T) @ R, np.zeros((lost, size))])
            if not lost and values[0] > 0.5 * values[-1]:  # the change is only rounding: no new product MW
                V[:, at:at + size], MV[:, at:at + size] = W @ change, MW @ change
                return R
            W = W @ change
            if lost:
                W = np.hstack([W, against(factor.solve(M @ rng.standard_normal((n, lost))), at)[0]])

    put(against(factor.solve(M @ rng.standard_normal((n, b))), 0)[0], 0)
    m, restarts = 0, 0
    while True:
        W, share = against(factor.solve(MV[:, m:m + b]), m + b)
        T[:m + b, m:m + b] = share
        T[m:m + b, :m] = share[:m].T
        m += b
        theta, Y = np.linalg.eigh((T[:m, :m] + T[:m, :m].T) / 2)
        theta, Y = theta[::-1], np.array(Y[:, ::-1], order="F")  # BLAS cannot use a negative stride
        R = put(W, m) if m < room else np.zeros((b, b))
        residual = np.linalg.norm(R @ Y[m - b:, :count], axis=0)
        if m >= count and (residual <= tol * np.abs(theta[:count])).all():
            break
        if m + b > most:
            if restarts == RESTARTS:
                good = int(np.count_nonzero(residual <= tol * np.abs(theta[:count])))
                raise NotConvergedError(f"{good} of {count} modes converged to {tol:g} within {restarts} restarts. Ask for "
                                        "fewer modes, or check the matrices")
            restarts += 1
            keep = min((2 * count + 3 * m) // 5, m - b)
            for basis in (V, MV):  # in place: a second basis may not fit beside a large factor
                for start in range(0, n, ROWS):
                    rows = slice(start, start + ROWS)
                    basis[rows, :keep] = basis[rows, :m] @ Y[:, :keep]
                basis[:, keep:keep + b] = basis[:, m:m + b]
            T[:] = 0.0
            T[np.arange(keep), np.arange(keep)] = theta[:keep]
            m = keep
    return MV[:, :m] @ Y[:, :count]
