"""All modes of small dense matrices by LAPACK, accurate at both ends of the spectrum; orthonormalisation of modes."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import LARGE, ROUNDING, SINGULAR
from femsub.checks import EPS, EQUAL, Array, Matrix, NotConvergedError, SingularMatrixError


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
        if off < 8 * ROUNDING:  # the products above have this rounding themselves
            break
        if not off < 0.5:
            i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
            raise NotConvergedError(f"modes {i + 1} and {j + 1} are not independent, φᵀMφ = {gram[i, j]:.3g}. The eigensolver "
                                    "has listed one mode twice. Check the scaling of K and M")
        for start in range(0, len(shapes), LARGE):
            shapes[start:start + LARGE] -= shapes[start:start + LARGE] @ change


def refined(K: Matrix, M: Matrix, values: Array, shapes: Array, which: Array, near: float) -> tuple[Array, Array]:
    """λ (k,) and φ (n, k) with the columns `which` refined by inverse iteration, each DOF in the unit of its own stiffness.

    If a model has stiff and soft DOF, LAPACK's modes from the middle of the spectrum have the rounding of the stiff DOF in all
    entries. The solution of (K - σM)y = Mφ in scaled DOF has it in the stiff DOF only; λ = σ + yᵀMφ / yᵀMy. Neighbours whose λ
    are within the share `near` are refined together.
    """
    from scipy.sparse.linalg import splu

    values, shapes = values.copy(), shapes.copy()
    for group in np.split(which, 1 + np.flatnonzero(np.diff(values[which]) > near * values[which][1:])):
        lam, x = values[group], shapes[:, group]
        for _ in range(6):  # each with a new shift; two or three are usual
            sigma = float(lam.mean()) * (1 + EPS ** (2 / 3))  # on it K - σM would be singular
            unit = 2.0 ** np.rint(np.log2(_units(K, M, np.array([sigma]))[:, 0]))
            A, b = K - sigma * M, unit[:, None] * (M @ x)
            U = sp.diags_array(unit)
            try:  # inverse iteration needs an A that is nearly singular
                y = splu(sp.csc_array(U @ A @ U)).solve(b) if sp.issparse(A) else np.linalg.solve(unit[:, None] * A * unit, b)
            except (RuntimeError, np.linalg.LinAlgError):
                break
            y = unit[:, None] * y
            size = np.sqrt(np.einsum("ij,ij->j", y, M @ y))
            y, energy = y / size, (y / size).T @ (M @ (x / size))  # yᵀ(K - σM)y, without cancellation
            shift, turn = la.eigh((energy + energy.T) / 2, y.T @ (M @ y))
            x, before, lam = y @ turn, lam, sigma + shift
            if (np.abs(lam - before) <= SINGULAR * lam).all():
                break
        values[group], shapes[:, group] = lam, x
    order = np.argsort(values, kind="stable")
    shapes = shapes[:, order]
    orthonormalise(shapes, M)
    return values[order], shapes


def scaled_errors(K: Matrix, M: Matrix, values: Array, shapes: Array) -> tuple[Array, Array]:
    """‖Ur‖ / ‖U⁻¹φ‖ with each DOF in its own unit, and the relative error of λ > 0 that it causes, shape (k,) each."""
    unit = _units(K, M, values)
    residual, size = (np.linalg.norm(part, axis=0) for part in (unit * (K @ shapes - (M @ shapes) * values), shapes / unit))
    return residual / size, np.divide(residual * size, values, out=np.zeros_like(size), where=values > 0)


def _units(K: Matrix, M: Matrix, values: Array) -> Array:
    """max(|k_ii|, λ m_ii)^(-1/2), (n, k)."""
    size = np.maximum(np.abs(K.diagonal())[:, None], np.outer(M.diagonal(), values))
    return np.where(size > 0, size, 1.0) ** -0.5


def semidefinite_frequencies(K: Array, M: Array) -> Array:
    """ω of Kx = ω²Mx in ascending order, K and M semidefinite; coordinates without mass follow statically."""
    if not len(K):
        return np.zeros(0)
    K, M = (K + K.T) / 2, (M + M.T) / 2
    heaviest = float(M.diagonal().max())
    size = K.diagonal() + M.diagonal() * (K.diagonal().max() / heaviest if heaviest > 0 else 0.0)
    unit = np.where(size > 0, size, 1.0) ** -0.5
    mass = M * np.outer(unit, unit)
    stiff = K * np.outer(unit, unit)
    values, turn = la.eigh(mass)
    heavy = values > 1e-12 * max(values[-1], 0.0)
    if not heavy.any():
        return np.zeros(0)
    Q = turn[:, heavy]
    inner = Q.T @ stiff @ Q
    if not heavy.all():
        # by 1/(ω² + σ) with σ about the lowest ω²: if condensed to Q, nearly dependent stiff coordinates lose digits
        ratios = np.einsum("ij,ij->j", Q, stiff @ Q) / values[heavy]
        shift = float(ratios[ratios > EQUAL * ratios.max()].min(initial=ratios.max()))
        try:
            inverse = la.eigh(mass, stiff + shift * mass, eigvals_only=True)[-len(ratios):][::-1]
            return np.sqrt(np.maximum(1 / inverse - shift, 0.0))
        except la.LinAlgError:  # K + σM is not positive definite: a fault that another check reports
            Z = turn[:, ~heavy]
            inner -= (Q.T @ stiff @ Z) @ np.linalg.pinv(Z.T @ stiff @ Z, rcond=1e-12, hermitian=True) @ (Z.T @ stiff @ Q)
    root = values[heavy] ** -0.5
    return np.sqrt(np.maximum(np.linalg.eigvalsh(inner * np.outer(root, root)), 0.0))
