"""The eigenpairs of a pencil, from the eigenpairs of its projection on undamped modes by corrections outside and inside the
basis.

No pair needs a factor of P(λ): outside the basis A⁻¹ approximates P(λ)⁻¹, and inside the basis the eigenpairs of the projection
give the inverse. Each sweep multiplies the error by about ‖A⁻¹(P - A)‖ outside the basis. A sweep that does not halve the error
is slow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import ROUNDING, SUMS, divided, fork_pays, shared_zeros, times
from femsub.checks import EPS, Array, Matrix
from femsub.modes.quadratic.matching import HALF, clusters, match
from femsub.modes.quadratic.projected_count import Projection

if TYPE_CHECKING:
    from collections.abc import Sequence

    from femsub.model import Pencil
    from femsub.modes.quadratic.energy_basis import Coupling

#: Relative distance below which eigenvalues are corrected together. Two eigenvalues at a distance of 7e-4 diverged when corrected
#: separately, by a factor of 1 to 3 in each sweep; above 1e-3 none diverged.
TOGETHER = 1e-3


def right_pairs(small: Coupling, pencil: Pencil, together: int = 16) -> tuple[Array, Array] | None:
    """The eigenpairs inside the contour, Im λ ≥ 0: λ (k,) and X (n, k), to rounding. None if corrections do not converge.

    λ is exactly 0 for rigid motion: once where other parts of the pencil act on it, else twice. If a fork pays, each process
    corrects at most `together` clusters at once: each needs the memory of some twenty vectors.
    """
    values, basis = small.each, _basis(small)
    driven = basis.damped_motion(pencil)
    moving = np.argsort(np.abs(values), kind="stable")[driven.shape[1]:]  # V does not contain motion on which nothing acts
    at = np.intersect1d(moving, np.flatnonzero(small.contour.encloses(values) & ((values.imag >= 0) | _nearly_real(values))))
    found = _corrected(small, (pencil.M, pencil.D, pencil.K), pencil.norms, at, 0.0, together)
    if found is None:
        return None
    Z = np.hstack([basis.free, driven, basis.free])
    return np.append(found[0], np.zeros(Z.shape[1])), np.hstack([found[1], Z / np.linalg.norm(Z, axis=0)])


def left_vectors(small: Coupling, pencil: Pencil, values: Array, X: Array, error: float = 0.01,
                 together: int = 16) -> Array | None:
    """Left vectors (n, k) of eigenvalues (k,) with the right vectors X, up to a relative `error`.

    None if a left vector contains more than `error` of another mode. This is seen from yᴴ((λ_i + λ_j)M + D)x, which vanishes for
    two different eigenvalues. One per cent is enough for error bars. `together` is as in `right_pairs`, whose rigid motion Z
    fulfils ZᵀK = 0.
    """
    if (still := values == 0).any():
        moving = left_vectors(small, pencil, values[~still], X[:, ~still], error, together)
        if moving is None:
            return None
        Y = X.astype(complex)
        Y[:, ~still] = moving
        return Y
    finite = np.flatnonzero(small.nu)
    at = finite[match(values, small.each[finite])[1]]
    transposed = tuple(part if same else sp.csr_array(part.T)
                       for part, same in zip((pencil.M, pencil.D, pencil.K), pencil.symmetric, strict=True))
    found = _corrected(small, transposed, pencil.norms, at, error, together)
    if found is None:
        return None
    Y = found[1]
    products = (Y.conj().T @ times(pencil.M, X)) * (values[:, None] + values) + Y.conj().T @ times(pencil.D, X)
    for group in clusters(values, HALF):  # equal eigenvalues: any basis is valid, take the dual one
        dual = np.linalg.inv(products[np.ix_(group, group)])
        Y[:, group], products[group] = Y[:, group] @ dual.conj().T, dual @ products[group]
    size = np.sqrt(np.abs(products.diagonal()))
    with np.errstate(divide="ignore", invalid="ignore"):
        mixed = np.abs(products) / np.outer(size, size)
    np.fill_diagonal(mixed, 0.0)
    return Y / np.linalg.norm(Y, axis=0) if mixed.max(initial=0.0) < error else None


def _corrected(small: Coupling, matrices: tuple[Matrix, ...], norms: tuple[float, ...], at: Array, left: float,
               together: int) -> tuple[Array, Array] | None:
    """λ (k,) and X (n, k) of unit length, from the eigenpairs `at` of VᵀPV. With `left` > 0: those of Pᵀ at λ̄, to this error.

    Distant eigenpairs are corrected independently, so a forked process corrects half of them if that saves time.
    """
    factor = _basis(small).factor
    if not fork_pays(factor, 10 * len(at)):  # each takes five sweeps or more, with two real columns
        return _together(small, matrices, norms, at, left)
    label, each = np.arange(len(at)), small.each[at]
    for group in clusters(np.where(_nearly_real(each), each.real, each), TOGETHER):
        label[group] = group[0]
    order = np.argsort(label, kind="stable")
    first = np.append(np.flatnonzero(np.diff(label[order], prepend=-1)), len(at))  # of each cluster
    values = shared_zeros(2, len(at)).T.view(complex)[:, 0]
    X = shared_zeros(2 * factor.size, len(at)).T.view(complex).T

    def some(part: slice) -> None:
        these = order[first[part.start]:first[part.stop]]
        found = _together(small, matrices, norms, at[these], left)
        values[these], X[:, these] = (np.nan, 0.0) if found is None else found

    number = len(first) - 1
    blocks = 2 * -(-number // (2 * together))  # as many for the fork as for this process
    divided(some, number, True, width=-(-number // blocks))
    return (values, X) if np.isfinite(values).all() else None


def _together(small: Coupling, matrices: tuple[Matrix, ...], norms: tuple[float, ...], at: Array, error_of_left: float
              ) -> tuple[Array, Array] | None:
    """As `_corrected`, for all pairs at once. None if the corrections do not converge.

    Outside V, X changes by V VᵀR - A⁻¹R, with R = P(λ)X. This would be exact if P were A there. The change inside V follows from
    (VᵀPV)⁻¹ = Σ x_j z_jᴴ / (λ_j - s): λ_k changes by z_kᴴρ and x_k by -Σ x_j z_jᴴρ / (λ_j - λ_k), j ≠ k, where ρ is VᵀR after the
    first change. The corrections converge because A⁻¹(A - P) is small outside V, as the bound of the count shows. Eigenvalues
    near each other are corrected together, with a matrix S instead of λ: MXS² + DXS + KX = 0. Rounding may turn two equal real λ
    into a pair: they become real again, with the shapes Re x and Im x.
    """
    basis, left = _basis(small), error_of_left > 0
    V, factor = basis.V, basis.factor
    finite = np.flatnonzero(small.nu)
    x, z = (part[:, finite] for part in ((small.z, small.x) if left else (small.x, small.z)))
    each = small.each[finite].conj() if left else small.each[finite]
    at = np.searchsorted(finite, at)
    for one in at[(each.imag[at] > 0) & _nearly_real(each[at])]:
        two = np.abs(each - each[one].conj()).argmin()
        for part, share in ((x, 1), (z, 2)):  # z stays dual to x
            part[:, two], part[:, one] = share * part[:, one].imag, share * part[:, one].real
        each[[one, two]] = each[one].real
    values = each[at]
    real = values.imag == 0
    still = np.sqrt(2 * V.shape[1] * EPS) * small.unit  # rounding splits the double eigenvalue 0 of rigid motion by this
    if (np.abs(values) < still).any() or (~real & (np.abs(values.imag) < TOGETHER * np.abs(values))).any():
        return None
    S, X = np.diag(values), _complex(V @ _real(x[:, at]))
    label, among = np.arange(len(at)), clusters(values, TOGETHER)
    for group in among:
        label[group] = group[0]
    here, Xh, found = np.arange(len(at)), X, np.empty_like(X)
    errors = _Errors(len(at))
    inner = [part.T if left else part for part in basis.matrices[::-1]]  # VᵀMV, VᵀDV and VᵀKV
    # VᵀR is 0 at first, and the basis knows A⁻¹R outside V
    step, rho = _complex(basis.residuals(values.conj() if left else values, x[:, at], left)), 0j * x[:, at]
    error, falls = np.ones((2, len(at)))
    while True:  # until all pairs are solved, or one is stuck
        step -= basis.free @ (basis.momenta.T @ step)  # A is small there, so that rounding would grow
        T, groups = S[np.ix_(here, here)], [np.flatnonzero(label[here] == group[0]) for group in among]
        after = rho + _applied(inner, rho, T, groups) - _complex(V.T @ _real(_applied(matrices, step, T, groups)))
        change, of_S = _change_inside(z.conj().T @ after, T, each, at[here], groups)
        S[np.ix_(here, here)] += of_S
        moved = _complex(V @ _real(rho + x @ change)) - step
        Xh = Xh + moved
        more = error * falls > SUMS
        if left:
            more &= falls * _lengths(moved) > error_of_left * _lengths(Xh)
        S[:, real], Xh[:, real[here]] = S[:, real].real, Xh[:, real[here]].real
        stay = np.isin(label[here], label[here[more]])
        found[:, here[~stay]] = Xh[:, ~stay]  # the last correction of these pairs
        here, Xh = here[stay], Xh[:, stay]
        if not len(here):
            break
        T, groups = S[np.ix_(here, here)], [np.flatnonzero(label[here] == group[0]) for group in among]
        R, size = _applied(matrices, Xh, T, groups), np.abs(T.diagonal())
        error = _lengths(R) / ((size**2 * norms[0] + size * norms[1] + norms[2]) * _lengths(Xh))
        falls = errors.add(here, error)
        if errors.stuck:
            return None
        stay = np.isin(label[here], label[here[~errors.done[here]]])
        found[:, here[~stay]] = Xh[:, ~stay]
        here, R, Xh, error, falls = here[stay], R[:, stay], Xh[:, stay], error[stay], falls[stay]
        if not len(here):
            break
        step, rho = _complex(factor.solve(_real(R))), _complex(V.T @ _real(R))
    X = found
    values = S.diagonal().copy()
    for group in among:
        values[group], turn = np.linalg.eig(S[np.ix_(group, group)])
        X[:, group] = X[:, group] @ turn
        if real[group].any() and np.iscomplex(values[group]).any():  # they are a pair
            return None
    values[real], X[:, real] = values[real].real, X[:, real].real
    return (values, X / np.linalg.norm(X, axis=0)) if np.isfinite(values).all() else None


def _nearly_real(values: Array) -> Array:
    """Which λ may be one of two equal real λ that rounding has turned into a pair; they are corrected together."""
    return np.abs(values.imag) < TOGETHER / 2 * np.abs(values)


class _Errors:
    """Backward errors of pairs from sweep to sweep, and which pairs are solved or do not converge.

    Up to `slow` sweeps may fail to halve the error: at first the errors inside and outside the basis fall in turn.
    """

    def __init__(self, number: int, slow: int = 3) -> None:
        self._last, self._least = np.full((2, number), np.inf)
        self._slow, self._most = np.zeros(number, dtype=int), slow

    def add(self, here: Array, error: Array) -> Array:
        """Store the errors of the pairs `here`; return the factor expected of the next sweep: that of this one, at least 1/2."""
        last = self._last[here]  # infinite at first
        self._slow[here] += ~(error < last / 2)
        self._last[here], self._least[here] = error, np.minimum(error, self._least[here])
        return np.maximum(error / last, 0.5)

    @property
    def stuck(self) -> bool:
        """Whether any pair does not converge."""
        return bool(((self._slow > self._most) & (self._last > ROUNDING)).any())

    @property
    def done(self) -> Array:
        """Which pairs are solved: the error is below `SUMS`, or it is below `ROUNDING` and no longer falls."""
        lowest = ((self._slow > 1) & (self._last <= self._least)) | (self._slow > 2 * self._most)
        return (self._last <= SUMS) | (lowest & (self._last < ROUNDING))


def _applied(matrices: Sequence[Matrix], X: Array, T: Array, groups: list[Array]) -> Array:
    """MXT² + DXT + KX (n, k)."""
    M, D, K = (times(part, X) for part in matrices)
    return _times(_times(M, T, groups) + D, T, groups) + K


def _change_inside(inside: Array, T: Array, each: Array, own: Array, groups: list[Array]) -> tuple[Array, Array]:
    """The changes of X in eigenvectors of VᵀPV, shape (len(each), k), and of S (k, k); `inside` is zᴴVᵀP(λ)X.

    Column k belongs to the eigenvalue each[own[k]], a column in a group to all eigenvalues of the group. Components along a
    column's own eigenvectors change S. Components along all other eigenvectors change X.
    """
    alone = np.setdiff1d(np.arange(len(own)), np.concatenate([[], *groups]).astype(int))
    with np.errstate(divide="ignore", invalid="ignore"):
        change, more = inside / (T.diagonal() - each[:, None]), np.zeros_like(T)
    change[own[alone], alone] = 0.0
    more[alone, alone] = inside[own[alone], alone]
    for columns in groups:
        here, others = np.ix_(own[columns], columns), np.setdiff1d(np.arange(len(each)), own[columns])
        apart = each[others, None, None] * np.eye(len(columns)) - T[np.ix_(columns, columns)].T
        change[here] = 0.0
        change[np.ix_(others, columns)] = -np.linalg.solve(apart, inside[np.ix_(others, columns)][:, :, None])[:, :, 0]
        more[np.ix_(columns, columns)] = inside[here]
    return change, more


def _basis(small: Coupling) -> Projection:
    assert isinstance(small.basis, Projection)
    return small.basis


def _lengths(A: Array) -> Array:
    """Euclidean lengths of complex columns."""
    return np.sqrt(np.einsum("ij,ij->j", A.real, A.real) + np.einsum("ij,ij->j", A.imag, A.imag))


def _times(A: Array, T: Array, groups: list[Array]) -> Array:
    """The product A T, for a matrix T that is diagonal except for the blocks of the `groups`."""
    product = A * T.diagonal()
    for group in groups:
        product[:, group] = A[:, group] @ T[np.ix_(group, group)]
    return product


def _real(A: Array) -> Array:
    """Real and imaginary parts of complex columns side by side, shape (n, 2k)."""
    return np.ascontiguousarray(A).view(float)


def _complex(A: Array) -> Array:
    return np.ascontiguousarray(A, dtype=float).view(complex)
