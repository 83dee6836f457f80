"""Membranes and trusses of springs: small models whose spectra or rigid-body modes are known in closed form."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

import femsub as fs


def membrane(m: int) -> fs.Substructure:
    """The 5-point stencil on an m x m square: λ_jk = 4 sin²(jπ/2(m+1)) + 4 sin²(kπ/2(m+1)), pairs for j ≠ k."""
    line = sp.diags_array([-np.ones(m - 1), 2 * np.ones(m), -np.ones(m - 1)], offsets=[-1, 0, 1])
    K = sp.kron(line, sp.eye_array(m)) + sp.kron(sp.eye_array(m), line)
    return fs.Substructure(sp.eye_array(m * m), K, name="membrane")


def membrane_eigenvalues(m: int) -> np.ndarray:
    one = 4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * (m + 1))) ** 2
    return np.sort((one[:, None] + one[None, :]).ravel())


def lattice(nx: int, ny: int, *, held: bool = False, seed: int = 0, diagonals: bool = True) -> fs.Substructure:
    """A plane truss of springs, two DOF a node: three rigid-body modes if it is not held; of equal springs without diagonals."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    node = (x * ny + y).ravel()
    place = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    bars = []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1))[:4 if diagonals else 2]:
        start = node.reshape(nx, ny)[max(0, -dx):nx - max(0, dx), max(0, -dy):ny - max(0, dy)]
        bars.append(np.stack([start.ravel(), start.ravel() + dx * ny + dy], axis=1))
    pairs = np.concatenate(bars)
    direction = place[pairs[:, 1]] - place[pairs[:, 0]]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    count, n = len(pairs), 2 * nx * ny
    rows = np.repeat(np.arange(count), 4)
    columns = np.stack([2 * pairs[:, 0], 2 * pairs[:, 0] + 1, 2 * pairs[:, 1], 2 * pairs[:, 1] + 1], axis=1).ravel()
    B = sp.csr_array((np.hstack([-direction, direction]).ravel(), (rows, columns)), shape=(count, n))
    K = B.T @ sp.diags_array(rng.uniform(0.5, 2.0, count) if diagonals else np.ones(count)) @ B
    if held:
        K = K + sp.diags_array(np.where(np.arange(n) < 2 * ny, 1.0, 0.0))
    M = sp.diags_array(np.repeat(rng.uniform(0.5, 2.0, nx * ny), 2))
    w = np.zeros(n)
    w[n // 2] = 1.0
    return fs.Substructure(M, K, interface=[0, 1, n - 2, n - 1], ports={"belt": w}, name="lattice")
