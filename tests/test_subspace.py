"""A basis that grows: [V Q]ᵀA[V Q] = I, the span, and what is left out, whatever the units and however close the columns."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from femsub.algebra.subspace import orthonormal


def grown(size: int = 60, spread: float = 8.0) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    """A (n, n) of a condition of 10^spread, and V (n, 5) with VᵀAV = I."""
    rng = np.random.default_rng(4)
    Q = np.linalg.qr(rng.standard_normal((size, size)))[0]
    A = (Q * np.logspace(0, spread, size)) @ Q.T
    A = (A + A.T) / 2
    V, AV = orthonormal(rng.standard_normal((size, 5)), A.__matmul__)
    assert np.abs(V.T @ AV - np.eye(5)).max() < 1e-13
    return A, V, rng


def off(V: np.ndarray, Q: np.ndarray, A: np.ndarray) -> float:
    """Of [V Q], how far from A-orthonormal."""
    both = np.hstack([V, Q])
    return float(np.abs(both.T @ A @ both - np.eye(both.shape[1])).max())


@pytest.mark.parametrize("share", [1.0, 1e-3, 1e-6, 1e-8])
def test_what_is_nearly_in_the_basis_is_still_orthonormal_to_it(share: float) -> None:
    A, V, rng = grown()
    columns = V @ rng.standard_normal((5, 4)) + share * rng.standard_normal((60, 4)) / np.sqrt(A.diagonal().max())
    Q, AQ = orthonormal(columns, A.__matmul__, V)
    assert Q.shape[1] == 4 and off(V, Q, A) < 1e-12 and np.abs(AQ - A @ Q).max() < 1e-10 * np.abs(AQ).max()
    left = columns - np.hstack([V, Q]) @ (np.hstack([V, Q]).T @ (A @ columns))
    assert np.sqrt(np.einsum("ij,ij->j", left, A @ left)).max() < 1e-7 * np.linalg.norm(V.T @ A @ columns, axis=0).max()


def test_columns_close_to_each_other_and_in_any_units() -> None:
    A, V, rng = grown()
    columns = rng.standard_normal((60, 1)) + 1e-4 * rng.standard_normal((60, 6))
    Q = orthonormal(columns * 10.0 ** np.arange(-9, 9, 3), A.__matmul__, V)[0]
    assert Q.shape[1] == 6 and off(V, Q, A) < 1e-12


def test_what_holds_nothing_new_is_left_out() -> None:
    A, V, rng = grown(spread=2.0)
    one = rng.standard_normal((60, 1))
    for columns, rank in ((V @ rng.standard_normal((5, 3)), 0), (np.zeros((60, 2)), 0), (np.zeros((60, 0)), 0),
                          (np.hstack([one, 3 * one, one + V[:, :1]]), 1), (np.eye(60), 55)):
        Q = orthonormal(columns, A.__matmul__, V)[0]
        assert Q.shape == (60, rank) and off(V, Q, A) < 1e-11
    A[:, 7] = A[7] = 0.0  # what has no length in A has none
    assert orthonormal(np.eye(60)[:, [7, 8]], A.__matmul__)[0].shape == (60, 1)


def test_the_rounding_of_a_soft_direction_is_nothing_new() -> None:
    """V spans the whole space. What the projection leaves of columns along its soft vector is not short, and still rounding."""
    rng = np.random.default_rng(4)
    Q, size = np.linalg.qr(rng.standard_normal((20, 20)))[0], np.append(1e-9, np.ones(19))
    A, V = (Q * size) @ Q.T, Q / np.sqrt(size)
    columns = (Q / size) @ rng.standard_normal((20, 6))
    assert orthonormal(columns, A.__matmul__, V)[0].shape == (20, 0)


def test_sums_of_many_terms_make_no_direction_of_their_rounding() -> None:
    """Dependent columns of a large model: their Gram matrix has the rounding of 30,000 terms, above that of its own entries."""
    n, three = 30_000, np.arange(30_000)[:, None] % 3 == np.arange(3)
    columns = np.hstack([np.ones((n, 1)), three.astype(float)])
    for size in np.random.default_rng(0).uniform(0.1, 1.0, 30):
        M = sp.csr_array(sp.diags_array([np.full(n - 3, size / 6), np.full(n, size * 4 / 6), np.full(n - 3, size / 6)],
                                        offsets=[-3, 0, 3]))
        Q, MQ = orthonormal(columns, M.__matmul__)
        assert Q.shape == (n, 3) and np.abs(Q.T @ MQ - np.eye(3)).max() < 1e-10
