"""Shared models, a gallery of small components with known answers; and that slow tests run where they are asked for."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs

pytest.register_assert_rewrite("matrixhelp")  # its assertions tell their values as those in tests do


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the tests marked slow as well, which a run of all tests leaves out")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """
    A run of all tests leaves out those marked slow; what is selected (-m, -k) or named (a file, a test of it) runs as asked.

    Not by `-m 'not slow'` among pytest's addopts: that leaves out a test that is named, too.
    """
    option = config.option
    named = any((config.invocation_params.dir / arg.partition("::")[0]).is_file() for arg in config.args)
    if option.slow or option.markexpr or option.keyword or named:
        return
    left_out = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


def membrane(m: int) -> fs.Substructure:
    """The 5-point stencil on an m x m square: λ_jk = 4 sin²(jπ/2(m+1)) + 4 sin²(kπ/2(m+1)), pairs for j ≠ k."""
    line = sp.diags_array([-np.ones(m - 1), 2 * np.ones(m), -np.ones(m - 1)], offsets=[-1, 0, 1])
    K = sp.kron(line, sp.eye_array(m)) + sp.kron(sp.eye_array(m), line)
    return fs.Substructure(sp.eye_array(m * m), K, name="membrane")


def membrane_eigenvalues(m: int) -> np.ndarray:
    one = 4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * (m + 1))) ** 2
    return np.sort((one[:, None] + one[None, :]).ravel())


def lattice(nx: int, ny: int, *, held: bool = False, seed: int = 0) -> fs.Substructure:
    """A plane truss of springs with diagonals, two DOF a node: three rigid-body modes if it is not held."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    node = (x * ny + y).ravel()
    place = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    bars = []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        start = node.reshape(nx, ny)[max(0, -dx):nx - max(0, dx), max(0, -dy):ny - max(0, dy)]
        bars.append(np.stack([start.ravel(), start.ravel() + dx * ny + dy], axis=1))
    pairs = np.concatenate(bars)
    direction = place[pairs[:, 1]] - place[pairs[:, 0]]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    count, n = len(pairs), 2 * nx * ny
    rows = np.repeat(np.arange(count), 4)
    columns = np.stack([2 * pairs[:, 0], 2 * pairs[:, 0] + 1, 2 * pairs[:, 1], 2 * pairs[:, 1] + 1], axis=1).ravel()
    B = sp.csr_array((np.hstack([-direction, direction]).ravel(), (rows, columns)), shape=(count, n))
    K = B.T @ sp.diags_array(rng.uniform(0.5, 2.0, count)) @ B
    if held:
        K = K + sp.diags_array(np.where(np.arange(n) < 2 * ny, 1.0, 0.0))
    M = sp.diags_array(np.repeat(rng.uniform(0.5, 2.0, nx * ny), 2))
    w = np.zeros(n)
    w[n // 2] = 1.0
    return fs.Substructure(M, K, interface=[0, 1, n - 2, n - 1], ports={"belt": w}, name="lattice")


def rigid_motions(nx: int, ny: int) -> np.ndarray:
    """Two translations and the rotation of `lattice`, (n, 3)."""
    x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    motions = np.zeros((2 * nx * ny, 3))
    motions[0::2, 0] = motions[1::2, 1] = 1.0
    motions[0::2, 2], motions[1::2, 2] = -y.ravel(), x.ravel()
    return motions


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261120)


@pytest.fixture
def sub() -> fs.Substructure:
    """The held lattice with unsymmetric D, a second port of two columns, names and places of its DOF."""
    base = lattice(4, 3, held=True)
    n, rng = base.size, np.random.default_rng(3)
    dofs = fs.DofMap(np.repeat(np.arange(n // 2) * 7 + 3, 2), np.tile([0, 1], n // 2), points=rng.standard_normal((n, 2)))
    damping = sp.random(n, n, 0.1, random_state=5, format="csr")
    ports = {"pad": rng.standard_normal((n, 2)), "belt": base.port("belt")}
    return fs.Substructure(base.M, base.K, damping, base.interface, ports, "lättice", dofs)
