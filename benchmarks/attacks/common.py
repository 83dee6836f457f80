"""What attacks share: a case with its own generator and its seed in what it reports, small models, and spectra by other means."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import numpy as np
import scipy.sparse as sp
from mpmath import mp

from femsub.checks import Array

Random = np.random.Generator


def attack(kinds: Sequence[str], seed_first: bool = False, silent: bool = True) -> Callable[[Callable[[str, Random], str]],
                                                                                           Callable[[str, int], str]]:
    """Makes `attacked(kind, seed)` of a function of a kind and a generator; what is wrong begins with the seed.

    The generator is seeded with the place of the kind and the seed, in this order or, with `seed_first`, in the other one.
    """
    def made(case: Callable[[str, Random], str]) -> Callable[[str, int], str]:
        @wraps(case)
        def attacked(kind: str, seed: int) -> str:
            place = tuple(kinds).index(kind)
            with warnings.catch_warnings():
                if silent:
                    warnings.simplefilter("ignore")
                found = case(kind, np.random.default_rng([seed, place] if seed_first else [place, seed]))
            word, colon, text = found.partition(":")
            return f"{word}: seed {seed}{colon}{text}" if colon else f"{word}, seed {seed}" if word == "wrong" else word

        return attacked

    return made


def dense(A: Any) -> Array:
    return np.array(A.toarray() if sp.issparse(A) else A, dtype=float)


def positive(rng: Random, n: int, least: float) -> Array:
    """A random positive definite matrix, whose eigenvalues are not below `least`."""
    A = rng.standard_normal((n, n))
    return np.asarray(A @ A.T / n + least * np.eye(n))


def row_of_springs(springs: Array) -> Array:
    """K of a row of masses: springs[i] is before mass i, and one more than masses holds the last."""
    behind = springs[1:] if len(springs) > 1 else np.zeros(0)
    n = len(springs) - 1
    return np.asarray(np.diag(springs[:n] + behind) - np.diag(behind[:n - 1], 1) - np.diag(behind[:n - 1], -1))


def null_space(B: Array, basis: Array, rank: float) -> Array:
    """The motions of a basis that B annuls: its singular values up to `rank` are 0."""
    if not len(B) or not basis.shape[1]:
        return basis
    values, V = np.linalg.svd(B @ basis)[1:]
    return np.asarray(basis @ V[int(np.count_nonzero(values > rank)):].T)


def eigenvalues(M: Array, D: Array, K: Array) -> Array:
    """All λ of (λ²M + λD + K)x = 0 by LAPACK, with a regular M."""
    n = len(M)
    return np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]]))


def exact_eigenvalues(M: mp.matrix, D: mp.matrix, K: mp.matrix) -> list[mp.mpc]:
    """The same in the digits that mpmath works with."""
    n, lead = M.rows, M ** -1
    low, middle, companion = -(lead * K), -(lead * D), mp.zeros(2 * M.rows)
    for i in range(n):
        companion[i, n + i] = 1
        for j in range(n):
            companion[n + i, j], companion[n + i, n + j] = low[i, j], middle[i, j]
    return list(mp.eig(companion, left=False, right=False))
