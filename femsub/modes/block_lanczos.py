"""Block Lanczos with thick restart: many right-hand sides at once where single solves are bound by memory traffic.

Krylov-Schur (SLEPc) solves for one right-hand side at a time, and reads the whole factor each time. On bulky solids a column in a
block of 10 costs a quarter of a single solve, but 1.6 times as many columns are needed: see `python -m benchmarks bases`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import LARGE, ROUNDING, times
from femsub.checks import EPS, Array, Matrix, NotConvergedError

if TYPE_CHECKING:
    from femsub.algebra import Handle


def block_lanczos(factor: Handle, M: Matrix, sigma: float, count: int, *, tol: float, seed: int = 1, known: Array | None = None,
                  seen: Callable[[Array, Array], int] | None = None, restarts: int = 60, block: int | None = None
                  ) -> tuple[Array, Array]:
    """Lowest eigenvalues above σ of (K - λM)φ = 0: A V = V T + Q R Eᵀ, A = (K - σM)⁻¹M, VᵀMV = I, V (n, m), λ = σ + 1/θ.

    `factor` is the factor of K - σM, which is positive definite. A Ritz pair is accepted if ‖R Eᵀy‖ ≤ tol θ. T is block
    tridiagonal. So a new block is first orthogonalised against the last two blocks by known coefficients, and then in one pass
    against all blocks, which removes rounding. A restart keeps the wanted Ritz vectors and half of the others.

    Parameters
    ----------
    factor : Handle
    M : sparse, shape (n, n)
        Positive semidefinite.
    known : ndarray, shape (n, k), optional
        M-orthonormal shapes to deflate. There must be far more other shapes than `count` and a block.
    seen : callable, optional
        Gets the approximate λ of each step, shape (count,), and bounds of their relative errors. Returns how many of them have to
        meet `tol`; the others are returned with the accuracy reached.
    restarts : int
        Largest number of restarts. The default is far more than any model has needed.
    block : int, optional
        Columns of a block. A wider block makes a column cheaper, but needs more columns. BLAS takes eight columns at a time, so
        ten take longer per column. The default is 8, and 16 from 100 modes on, where orthogonalisation gains as well.

    Returns
    -------
    eigenvalues : ndarray, shape (count,)
    shapes : ndarray, shape (n, count)
        M-normalised.

    Raises
    ------
    NotConvergedError
        Fewer than `count` Ritz pairs have converged within `restarts`.

    References
    ----------
    R. G. Grimes, J. G. Lewis, H. D. Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228 (block, shift and invert); K. Wu,
    H. Simon, SIAM J. Matrix Anal. Appl. 22 (2000) 602 (thick restart); B. N. Parlett, The Symmetric Eigenvalue Problem
    (1998), sec. 6.9 (a second pass only after cancellation).
    """
    locked = np.zeros((factor.size, 0)) if known is None else known

    def due(theta: Array, error: Array) -> int:
        return seen(sigma + 1 / theta, error) if seen else count

    theta, X = _ritz_vectors(factor, M, count, tol, locked, due, np.random.default_rng(seed),
                             restarts=restarts, block=block or (8 if count < 100 else 16))
    # the residual by rounding in T and X is at most half of EPS θ₁/θ_k, and the error of λ a hundredth of it
    if theta[0] * EPS <= tol / 10 * theta[-1] and M.diagonal().all():
        return sigma + 1 / theta, X
    MX = times(M, X)
    # Z = AX removes components in the null space of M, and zᵀ(K - σM)z = zᵀMx is accurate to rounding for small θ as well
    Z = factor.solve(MX)
    Z -= locked @ (times(M, locked).T @ Z)
    square = np.einsum("ij,ij->j", Z, times(M, Z))
    return sigma + np.einsum("ij,ij->j", Z, MX) / square, Z / np.sqrt(square)


def _ritz_vectors(factor: Handle, M: Matrix, count: int, tol: float, locked: Array, seen: Callable[[Array, Array], int],
                  rng: np.random.Generator, *, restarts: int, block: int) -> tuple[Array, Array]:
    """The wanted θ (count,) and their Ritz vectors after a step of inverse iteration, (n, count). All other memory is freed."""
    n, known = locked.shape
    room = n - known
    b = min(block, room // 4)
    most = min(room - b, int(2.5 * count) + 4 * b)
    columns, T = np.zeros((known + most + b, n)), np.zeros((most + b, most + b))
    whole = columns.T
    whole[:, :known], V = locked, whole[:, known:]

    def random(columns: int) -> Array:
        return factor.solve(times(M, rng.standard_normal((n, columns))))

    def put(W: Array, at: int) -> tuple[Array, Array, Array]:
        """Append Q, W = VC + QR, M-orthonormal to V and in itself; return C, R and MQ.

        Columns that are only rounding are replaced by random ones, with R = 0.
        """
        basis, size, clean = whole[:, :known + at], W.shape[1], False
        C, R = np.zeros((known + at, size)), np.eye(size)
        for _ in range(2 * size + 6):  # one or two are usual; columns that are only rounding take two more each
            MW = times(M, W)
            G = W.T @ MW
            before = float(np.trace(G))
            if not clean:
                share = (MW.T @ basis).T
                W, G, C = W - _product(basis, share), G - share.T @ share, C + share @ R
            values, Y = np.linalg.eigh((G + G.T) / 2)
            good = values > (size * EPS) ** 2 * max(float(values[-1]), float(np.finfo(float).tiny))
            root = np.sqrt(values[good])
            change, lost = Y[:, good] / root, size - int(good.sum())
            R = np.vstack([(root[:, None] * Y[:, good].T) @ R, np.zeros((lost, size))])
            if clean and not lost and values[0] > 0.5 * values[-1]:  # the change is only rounding: no new product MW
                V[:, at:at + size] = W @ change
                return C[known:], R, MW @ change
            W, clean = W @ change, not lost and EPS**2 * before < ROUNDING**2 * values[0]  # little was lost to cancellation
            if lost:
                more = random(lost)
                more -= W @ (W.T @ (M @ more))
                W = np.hstack([W, more / np.linalg.norm(more, axis=0) * np.linalg.norm(W, axis=0).max(initial=1.0)])
        raise NotConvergedError(f"a block of {size} columns could not be made orthogonal to the {known + at} before it. Ask for "
                                "fewer modes, or check the matrices")

    def mixed(into: Array, Y: Array) -> None:
        """VY takes the place of the first columns of `into`: a second basis may not fit beside a large factor."""
        for start in range(0, n, LARGE):
            rows = slice(start, start + LARGE)
            into[rows, :Y.shape[1]] = _product(V[rows, :len(Y)], Y)

    _, _, MQ = put(random(b), 0)
    first, m, done, looked = 0, 0, 0, 0
    while True:
        new = slice(m, m + b)
        W = factor.solve(MQ)
        T[new, new] = MQ.T @ W  # above it T has R of the block before, or of the Ritz vectors kept, from row `first` on
        W -= _product(V[:, first:m + b], T[first:m + b, new])
        first, m = m, m + b
        C, R, MQ = put(W, m)
        T[:m, new] += C
        T[new, :m] = T[:m, new].T
        full = m + b > most
        if full or (m >= count and m - looked >= m // 16):  # else eigenvalues of T would take longer than the steps
            theta, Y = np.linalg.eigh((T[:m, :m] + T[:m, :m].T) / 2)
            theta, Y, looked = theta[::-1], np.array(Y[:, ::-1], order="F"), m  # BLAS cannot use a negative stride
            rest = R @ Y[m - b:]
            residual = np.linalg.norm(rest[:, :count], axis=0)
            due = seen(theta[:count], residual / theta[:count]) if m >= count and (theta[:count] > 0).all() else count
            if m >= count and (residual <= tol * np.abs(theta[:count]))[:due].all():  # AX = XΘ + QREᵀY: this step needs no solve
                mixed(whole, np.vstack([Y[:, :count], rest[:, :count] / theta[:count]]))
                columns.resize((count, n), refcheck=False)  # nothing reads `whole` and V any more
                return theta[:count], columns.T
        if full:
            if done == restarts:
                good = int(np.count_nonzero(residual <= tol * np.abs(theta[:count])))
                raise NotConvergedError(f"{good} of {count} modes converged to {tol:g} within {restarts} restarts. Ask for "
                                        "fewer modes, or check the matrices")
            done += 1
            keep = min((2 * count + 3 * m) // 5, m - b)
            mixed(V, Y[:m, :keep])
            V[:, keep:keep + b] = V[:, m:m + b]
            T[:] = 0.0
            T[np.arange(keep), np.arange(keep)] = theta[:keep]
            first, m, R, looked = 0, keep, rest[:, :keep], keep
        T[first:m, m:m + b] = R.T
        T[m:m + b, first:m] = R


def _product(V: Array, Y: Array) -> Array:
    """VY (n, k) of a tall V, with contiguous columns: BLAS takes half as long for YᵀVᵀ."""
    return (Y.T @ V.T).T
