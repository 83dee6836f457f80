"""Counts and storage: sparse models of 110 to 230 DOF under strong damping, against LAPACK on their dense matrices.

'dashpots': a few to the ground, up to 1e6 of critical. 'everywhere': one at each mass. 'friction': dashpots and an unsymmetric K.
'gyroscopic': the same with a skew D. 'cells': many small parts, each with a strong dashpot inside. Asked by band or count.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, grid_pairs, row_of_springs, stiffness
from femsub.checks import Array

KINDS = ("dashpots", "everywhere", "friction", "gyroscopic", "cells")
NEAR = 1e-6  # relative distance from an edge at which rounding beside a large D decides what is in the band


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    pencil = _pencil(kind, rng)
    omega = np.sort(np.sqrt(np.abs(np.linalg.eigvalsh(((pencil.K + pencil.K.T) / 2).toarray()))))  # M = 1
    every = fs.complex_modes(pencil.dense()).eigenvalues
    try:
        if rng.random() < 0.6:
            hi = float(omega[int(rng.integers(3, 50))] * rng.uniform(0.9, 1.1))
            modes = fs.complex_modes(pencil, band=(0.0, hi))
            least, most = (_inside(every, hi * (1 + sign * NEAR)) for sign in (-1, 1))
        else:
            count = int(rng.integers(2, 50))
            modes = fs.complex_modes(pencil, count=count)
            size = np.sort(np.abs(every))
            edge = np.abs(modes.eigenvalues).max()
            least, most = every[np.abs(every) < edge * (1 - NEAR)], every[np.abs(every) <= edge * (1 + NEAR)]
            if not size[count - 1] * (1 - NEAR) <= edge <= size[min(count, len(size) - 1)] * (1 + NEAR):
                return f"wrong: {modes.evidence}, |λ| up to {edge}, but {size[count - 1:count + 1]}"
    except fs.FemsubError as error:
        return f"refused: {error}"
    if not len(least) <= len(modes) <= len(most):
        return modes.evidence if modes.evidence == "not checked" else \
            f"wrong: {modes.evidence}, {len(modes)} listed, but there are {len(least)} to {len(most)}"
    return modes.evidence


def _inside(values: Array, hi: float) -> Array:
    return values[(values.imag >= 0) & (values.imag <= hi) & (np.abs(values.real) <= hi)]


def _pencil(kind: str, rng: Random) -> fs.Pencil:
    if kind == "cells":
        parts = []
        for _ in range(int(rng.integers(30, 55))):
            K = 10 ** rng.uniform(-1, 2) * row_of_springs(np.ones(5))
            parts.append((1e-3 * K + np.diag([0, 1.0, 0, 0]) * 10 ** rng.uniform(-1, 3), K))
        D, K = (la.block_diag(*some) for some in zip(*parts, strict=True))
        ends = np.arange(3, len(K) - 1, 4)
        K = K + stiffness(len(K), np.stack([ends, ends + 1], 1), 10 ** rng.uniform(-3, 0, len(ends)))
        return fs.Pencil(sp.eye_array(len(K)), sp.csr_array(D), sp.csr_array(K))
    shape = rng.integers(11, 16, 2)
    n = int(shape.prod())
    ends = grid_pairs(np.arange(n).reshape(shape))
    spread = rng.uniform(0, 2)
    K = stiffness(n, ends, 10 ** rng.uniform(-spread, spread, len(ends))) + 0.01 * np.eye(n)
    share, low = 1.0 if kind == "everywhere" else rng.choice([0.02, 0.05, 0.15, 0.4]), rng.uniform(-2, 3)
    d = np.where(rng.random(n) < share, 10 ** rng.uniform(low, low + rng.uniform(0, 3), n) * np.sqrt(K.diagonal()), 0.0)
    D = np.diag(d) + (1e-3 * K if rng.random() < 0.3 else 0.0)
    if kind in ("gyroscopic", "friction"):
        G, size = np.zeros((n, n)), 10 ** rng.uniform(*((-3, 0) if kind == "gyroscopic" else (-2, 0)))
        np.add.at(G, tuple(rng.integers(0, n, (2, n // 8))), size * rng.standard_normal(n // 8))
        D, K = (D + G - G.T, K) if kind == "gyroscopic" else (D, K + G)
    return fs.Pencil(sp.eye_array(n), sp.csr_array(D), sp.csr_array(K))
