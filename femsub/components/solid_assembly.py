"""Stiffness and mass of solid elements, by batched products over all elements of a chunk, summed directly into CSR."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import upper as upper_triangle
from femsub.checks import EQUAL, Array, InputError, Matrix, finite_number, positive_number
from femsub.components.mesh import Mesh
from femsub.components.solid_elements import jacobians, quadrature, reference, shape_functions

CHUNK = 1 << 27  # bytes of element matrices held at a time


@dataclass(frozen=True)
class Material:
    """A linear elastic, isotropic material: σ = λ tr(ε) I + 2μ ε, λ = Eν/((1 + ν)(1 - 2ν)), μ = E/(2(1 + ν)).

    Parameters
    ----------
    E : float
        Young's modulus, force per length²: Pa with m, N, kg, s; MPa with mm, N, tonne, s.
    nu : float
        Poisson's ratio, -1 < ν < 0.5.
    rho : float
        Density, mass per length³: kg/m³, or tonne/mm³ (steel: 7.85e-9).
    loss : float
        Loss factor η of structural damping: in harmonic motion the modulus is E(1 + iη). η times the stiffness is part of the H
        of the component, see `Substructure`.

    Raises
    ------
    InputError, InputTypeError
        E or rho not positive, ν outside (-1, 0.5), a negative loss factor.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Material(E=2.1e11, nu=0.3, rho=7850.0)
    Material(E=210000000000.0, nu=0.3, rho=7850.0, loss=0.0)
    """

    E: float
    nu: float
    rho: float
    loss: float = 0.0

    def __post_init__(self) -> None:
        for name in ("E", "rho"):
            positive_number(name, getattr(self, name))
        if finite_number("loss", self.loss) < 0:
            raise InputError(f"loss must not be negative, but is {self.loss!r}")
        if not -1 < finite_number("nu", self.nu) < 0.5:
            raise InputError(f"nu must lie between -1 and 0.5, both excluded, but is {self.nu!r}")

    @property
    def lame(self) -> tuple[float, float]:
        """(λ, μ)."""
        return lame(self.E, self.nu)


def lame(E: Any, nu: Any) -> tuple[Any, Any]:
    """(λ, μ) from numbers, arrays or jets."""
    return (E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)))


def stiffness_and_mass(mesh: Mesh, materials: list[tuple[Material, Array]], degree: int | None = None) -> tuple[Matrix, Matrix]:
    """K and M, CSR of shape (3n, 3n), from all cells in one pass; DOF 3i + a is the motion of node i along axis a.

        K_ia,jc = Σ_e ∫ c_abcd ∂N_i/∂x_b ∂N_j/∂x_d dV,   M_ia,jc = δ_ac Σ_e ∫ ρ N_i N_j dV.

    Both are exactly symmetric.

    Parameters
    ----------
    mesh : Mesh
        A mesh of isoparametric solid cells.
    materials : list of (Material, cells)
        Each material with its cells.
    degree : int, optional
        Degree of the quadrature (in each direction, for hexahedra). By default the integrals are exact for affine cells, and
        the mass is exact for straight edges.

    References
    ----------
    K.-J. Bathe, Finite Element Procedures (1996), ch. 5.
    """
    pattern = Pattern(mesh.cells, len(mesh.points))
    stiffness, mass = np.zeros((pattern.size, 9)), np.zeros(pattern.size)
    for material, cells, N, root, G in at_points(mesh, materials, degree):
        keep, blocks, add = pattern.places(cells)
        m, q, k, _ = G.shape
        # ∫ ∂N_i/∂x_b ∂N_j/∂x_d dV for all i, j, b, d; since both factors are the same array, matmul calls a symmetric kernel
        G = G.reshape(m, q, 3 * k)
        pairs = (G.swapaxes(1, 2) @ G).reshape(m, k, 3, k, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 9)
        stiffness[blocks] += add @ (pairs[keep] @ _moduli(material))
        S = N * root[..., None]
        mass[blocks] += add @ (material.rho * (S.swapaxes(1, 2) @ S).reshape(-1)[keep])  # ∫ N_i N_j dV for all i, j
    return pattern.spread(stiffness), pattern.spread_diagonal(mass)


def at_points(mesh: Mesh, materials: list[tuple[Material, Array]],
              degree: int | None = None) -> Iterator[tuple[Material, Array, Array, Array, Array]]:
    """Yields chunks of cells with the factors of integrals over these cells.

    Yields
    ------
    material : Material
    cells : ndarray, shape (m,)
        Rows of `mesh.cells`.
    N : ndarray, shape (q, k)
        Shape functions at the q quadrature points.
    root : ndarray, shape (m, q)
        √(w det J), so that ∫ f dV = Σ_q root² f.
    G : ndarray, shape (m, q, k, 3)
        root ∂N/∂x. A product of two of these, summed over the points, is an integral.
    """
    size = max(1, CHUNK // (8 * 20 * mesh.cells.shape[1]**2))  # cells in a chunk
    for material, members in materials:
        for start in range(0, len(members), 8 * size):
            part = members[start:start + 8 * size]
            degrees = exact_degree(mesh, part) if degree is None else np.full(len(part), degree)
            for exact in np.unique(degrees).tolist():
                X, w = quadrature(mesh.kind, exact)
                N, dN = shape_functions(mesh.kind, X)
                chosen = part[degrees == exact]
                for i in range(0, len(chosen), size):
                    cells = chosen[i:i + size]
                    yield material, cells, N, *_gradients(mesh.points, mesh.cells[cells], dN, w)


def exact_degree(mesh: Mesh, cells: Array) -> Array:
    """Quadrature degrees (m,): 2p for affine cells, where both integrands are polynomials of this degree, otherwise 2p + 2."""
    corners = reference(mesh.kind).nodes
    J = jacobians(mesh.points, mesh.cells[cells], shape_functions(mesh.kind, corners)[1])
    spread = np.abs(J - J[:, :1]).max(axis=(1, 2, 3)) > EQUAL * np.abs(J).max(axis=(1, 2, 3))
    return 2 * reference(mesh.kind).degree + 2 * spread


def _gradients(points: Array, cells: Array, dN: Array, w: Array) -> tuple[Array, Array]:
    """√(w det J), shape (m, q), and √(w det J) ∂N/∂x, shape (m, q, k, 3)."""
    J = jacobians(points, cells, dN)
    a, b, c = J[..., 0, :], J[..., 1, :], J[..., 2, :]
    adjugate = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-1)  # J⁻¹ det J
    det = np.einsum("mqd,mqd->mq", a, adjugate[..., 0])
    if det.min() <= 0:
        bad = np.flatnonzero((det <= 0).any(axis=1))
        centre = ", ".join(f"{x:.4g}" for x in points[cells[bad[0]]].mean(axis=0))
        raise InputError(f"{len(bad)} cells are inverted or have no volume, one of them at ({centre}). Check the order of "
                         "their nodes")
    root = np.sqrt(det * w)
    return root, dN @ (adjugate * (root / det)[..., None, None]).swapaxes(-1, -2)  # ∂N/∂x = J⁻¹ ∂N/∂X


def _cross(a: Array, b: Array) -> Array:
    # NumPy's function takes twice as long
    result = np.empty_like(a)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        result[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return result


def _moduli(material: Material) -> Array:
    """c_abcd = λ δ_ab δ_cd + μ (δ_ac δ_bd + δ_ad δ_bc) with rows (b, d) and columns (a, c), shape (9, 9)."""
    lam, mu = material.lame
    one = np.eye(3)
    c = lam * np.einsum("ab,cd->abcd", one, one) + mu * (np.einsum("ac,bd->abcd", one, one) + np.einsum("ad,bc->abcd", one, one))
    return c.transpose(1, 3, 0, 2).reshape(9, 9)


class Pattern:
    """The ordered list of nonzero 3 x 3 blocks (i, j), i ≤ j, of K, and the block of each pair of nodes of a cell."""

    def __init__(self, cells: Array, nodes: int) -> None:
        self.cells, self.nodes = cells, nodes
        m, k = cells.shape
        touch = sp.csr_array((np.ones(m * k, dtype=np.int8), cells.ravel(), np.arange(0, m * k + 1, k)), shape=(m, nodes))
        upper = upper_triangle(touch.T.astype(np.int8).tocsr() @ touch)
        upper.sort_indices()
        self.rows = np.repeat(np.arange(nodes), np.diff(upper.indptr))
        self.columns = upper.indices.astype(np.int64)
        self.keys = self.rows * nodes + self.columns
        self.size = len(self.keys)

    def places(self, members: Array | slice) -> tuple[Array, slice, Matrix]:
        """For some cells: the flat indices of their node pairs with i ≤ j, the blocks that these pairs add to, and a matrix A.

        Values v (pairs, c) of these pairs add A @ v to the blocks.
        """
        cells = self.cells[members]
        i, j = np.broadcast_arrays(cells[:, :, None], cells[:, None, :])
        keep = np.flatnonzero((i <= j).ravel())
        at = np.searchsorted(self.keys, i.ravel()[keep] * self.nodes + j.ravel()[keep])
        low, high = int(at.min()), int(at.max()) + 1
        # a column for each pair, and a row for each block: the product sums the pairs of a block
        add = sp.csc_array((np.ones(len(at)), at - low, np.arange(len(at) + 1)), shape=(high - low, len(at)))
        return keep, slice(low, high), add

    @cached_property
    def both(self) -> tuple[Array, Array, Array, Array]:
        """The CSR structure of both triangles; for each block its index in the upper triangle, and whether it is mirrored."""
        off = np.flatnonzero(self.rows != self.columns)
        rows, columns = np.concatenate([self.rows, self.columns[off]]), np.concatenate([self.columns, self.rows[off]])
        source = np.concatenate([np.arange(self.size), off])
        order = np.argsort(rows * self.nodes + columns, kind="stable")
        indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=self.nodes))])
        index = np.int32 if 9 * len(rows) <= np.iinfo(np.int32).max else np.int64
        return indptr.astype(index), columns[order].astype(index), source[order], order >= self.size

    def spread(self, blocks: Array) -> Matrix:
        """CSR (3n, 3n) from the upper blocks (size, 9)."""
        indptr, columns, source, mirrored = self.both
        blocks = blocks.reshape(-1, 3, 3)
        own = np.flatnonzero(self.rows == self.columns)
        blocks[own] = (blocks[own] + blocks[own].transpose(0, 2, 1)) / 2  # rounding differs on both sides of the diagonal
        data = blocks[source]
        data[mirrored] = data[mirrored].transpose(0, 2, 1)
        return sp.csr_array(sp.bsr_array((data, columns, indptr), shape=(3 * self.nodes,) * 2))

    def scalar(self, values: Array, skew: bool = False) -> Matrix:
        """CSR (n, n) from one number (size,) for each upper block. With `skew`, entries below the diagonal change their sign."""
        indptr, columns, source, mirrored = self.both
        data = np.where(mirrored, -values[source], values[source]) if skew else values[source]
        return sp.csr_array((data, columns.copy(), indptr.copy()), shape=(self.nodes,) * 2)  # each may be changed in place

    def spread_diagonal(self, values: Array, skew: bool = False) -> Matrix:
        """CSR (3n, 3n): each entry of `scalar` times the unit matrix (3, 3)."""
        return sp.kron(self.scalar(values, skew), sp.eye_array(3), format="csr")
