"""All modes of small dense matrices by LAPACK, accurate at both ends of the spectrum; orthonormalisation of modes."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, Matrix
from femsub.errors import NotConvergedError, SingularMatrixError

ORTHOGONAL = 1e-12  # deviation of ΦᵀMΦ from I above which modes are orthogonalised once more
ROWS = 20_000  # rows of Φ processed at a time


def dense_modes(K: Array, M: Array) -> tuple[Array, Array]:
    """All finite λ (k,) and φ (n, k) of dense Kφ = λMφ, K definite, ΦᵀMΦ = I.

    The lower part of the spectrum comes from Mφ = θKφ, the upper part from Kφ = λMφ: each form loses digits at its small
    eigenvalues. The two parts are joined in a gap of the spectrum, see `_seam`.

    Raises
    ------
    SingularMatrixError
        K is not positive definite.
    """
    try:
        theta, x = la.eigh(M, K, check_finite=False)
    except la.LinAlgError as error:
        raise SingularMatrixError(
            "K is numerically singular, apart from its rigid-body modes. A piece is probably held by a stiffness far below that "
            f"of the rest. Support this piece, or leave it out ({error})") from None
    theta, x = theta[::-1], x[:, ::-1]
    low = int(np.count_nonzero(theta > 1e-15 * theta[0]))
    try:
        values, upper = la.eigh(K, M, check_finite=False)
    except la.LinAlgError:  # M is only semidefinite
        values, upper = np.zeros(low), np.zeros((len(K), low))
    else:
        low = _seam(values, theta)
    values[:low], upper[:, :low] = 1 / theta[:low], x[:, :low] / np.sqrt(theta[:low])
    orthonormalise(upper, M)
    return values, upper


def _seam(values: Array, theta: Array) -> int:
    """The number p of modes to take from Mφ = θKφ; Kφ = λMφ gives the rest. `values` are λ, `theta` θ = 1/λ, (n,) each.

    Vectors at the seam have errors of eps/gap · λ_p/λ_1 from below and eps/gap · λ_n/λ_p+1 from above. A seam inside a
    cluster would combine two different bases of one eigenspace. The p with the smallest error is taken; 0 and n have no seam.
    """
    top, bottom, tiny = float(values[-1]), 1 / float(theta[0]), np.finfo(float).tiny
    below, above = np.maximum(values[:-1], bottom), np.maximum(values[1:], bottom)
    gap = np.minimum(1 - below / above, 1 - np.maximum(theta[1:], 0.0) / np.maximum(theta[:-1], tiny))
    loss = np.maximum(below / bottom, top / above) / np.maximum(gap, EPS)
    return int(np.argmin(np.concatenate([[top / bottom], loss, [top / bottom]])))


def orthonormalise(shapes: Array, M: Matrix) -> None:
    """Make ΦᵀMΦ = I, in place. Each mode is corrected by lower modes only.

    A small component of a high mode would dominate the energy of a low one. A solve amplifies the rounding components of
    the lowest modes in the others by ω²/ω₁².

    Raises
    ------
    NotConvergedError
        One of the modes is listed twice.
    """
    for _ in range(4):
        gram = shapes.T @ (M @ shapes)
        change = np.triu(gram, 1) + np.diag((gram.diagonal() - 1) / 2)
        off = np.abs(change).max(initial=0.0)
        if off < ORTHOGONAL:
            break
        if not off < 0.5:
            i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
            raise NotConvergedError(f"modes {i + 1} and {j + 1} are not independent, φᵀMφ = {gram[i, j]:.3g}. The eigensolver "
                                    "has listed one mode twice. Check the scaling of K and M")
        for start in range(0, len(shapes), ROWS):
            shapes[start:start + ROWS] -= shapes[start:start + ROWS] @ change
