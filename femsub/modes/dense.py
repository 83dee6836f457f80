"""All modes of small dense matrices by LAPACK, accurate at both ends of the spectrum; and what makes modes orthonormal."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, Matrix
from femsub.errors import NotConvergedError, SingularMatrixError

ORTHOGONAL = 1e-12  # deviation of ΦᵀMΦ from I from which modes are orthogonalised once more
ROWS = 20_000  # of Φ, worked on at a time


def dense_modes(K: Array, M: Array) -> tuple[Array, Array]:
    """All finite λ (k,) and φ (n, k) of dense Kφ = λMφ, K definite, ΦᵀMΦ = I.

    The lower part comes from Mφ = θKφ, the upper from Kφ = λMφ, since each loses digits towards its far end. They meet in
    a gap of the spectrum, see `_seam`.

    Raises
    ------
    SingularMatrixError
        K is not positive definite.
    """
    try:
        theta, x = la.eigh(M, K, check_finite=False)
    except la.LinAlgError as error:
        raise SingularMatrixError(
            "K is singular to working precision beside its rigid-body motion: a piece is held by so much less than the "
            f"stiffness of the rest that rounding takes it; hold it, or leave it out ({error})") from None
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
    """How many modes to take from Mφ = θKφ, where Kφ = λMφ has the rest; `values` are λ, `theta` θ = 1/λ, (n,) each.

    With p of them, vectors at the seam are off by eps/gap · λ_p/λ_1 from below and eps/gap · λ_n/λ_p+1 from above: in a
    cluster each part would come with its own choice of vectors. The p with the least is taken; 0 and n have no seam.
    """
    top, bottom, tiny = float(values[-1]), 1 / float(theta[0]), np.finfo(float).tiny
    below, above = np.maximum(values[:-1], bottom), np.maximum(values[1:], bottom)
    gap = np.minimum(1 - below / above, 1 - np.maximum(theta[1:], 0.0) / np.maximum(theta[:-1], tiny))
    loss = np.maximum(below / bottom, top / above) / np.maximum(gap, EPS)
    return int(np.argmin(np.concatenate([[top / bottom], loss, [top / bottom]])))


def orthonormalise(shapes: Array, M: Matrix) -> None:
    """Steps towards ΦᵀMΦ = I, in place, that change each mode by those below it only: the least bit of a high mode would
    cost a low one much energy. A solve blows up what rounding leaves of the lowest modes in the others by ω²/ω₁².

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
            raise NotConvergedError(f"modes {i + 1} and {j + 1} are not independent, φᵀMφ = {gram[i, j]:.3g}: the eigensolver "
                                    "lost a mode; check the scaling of K and M")
        for start in range(0, len(shapes), ROWS):
            shapes[start:start + ROWS] -= shapes[start:start + ROWS] @ change
