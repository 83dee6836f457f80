"""Element matrices of bending, all elements at once: Hermite lines, Bogner-Fox-Schmit rectangles, Morley triangles."""

from __future__ import annotations

from functools import cache

import numpy as np

from femsub.checks import Array
from femsub.components.solid_elements import side_quadrature, skfem

#: corners of the rectangle in the order of its DOF
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
#: edge i of the triangle lies opposite its corner i
OPPOSITE = ((1, 2), (2, 0), (0, 1))


@cache
def hermite() -> dict[tuple[int, int], Array]:
    """A_ab = ∫ N⁽ᵃ⁾ N⁽ᵇ⁾ᵀ dξ over [0, 1], (4, 4), for the cubics N of the DOF (w, w') at 0 and (w, w') at 1.

    All integrals are multiples of 1/420 and are rounded to these, so that rigid motion has exactly zero energy. A fine beam needs
    this: cancellation in its K grows with the fourth power of the number of elements.
    """
    fem = skfem()
    basis = fem.Basis(fem.MeshLine(np.array([0.0, 1.0])), fem.ElementLineHermite(), intorder=6)
    fields = [basis.basis[i][0] for i in range(4)]
    N = [np.stack([np.asarray(part).ravel() for part in order])
         for order in ([np.asarray(f) for f in fields], [f.grad for f in fields], [f.hess for f in fields])]
    w = basis.dx.ravel()
    return {(a, b): np.round(420 * (N[a] * w) @ N[b].T) / 420 for a in range(3) for b in range(3)}


#: ∫ N dξ over [0, 1] of the same four cubics
HERMITE_MEAN = np.array([1 / 2, 1 / 12, 1 / 2, -1 / 12])


def hermite_matrices(lengths: Array) -> tuple[Array, Array]:
    """∫ N''N''ᵀ dx and ∫ NNᵀ dx, (m, 4, 4), for lines of these lengths (m,), with the DOF (w, w,x) at each end."""
    h = lengths[:, None, None]
    slopes = np.stack([np.ones_like(lengths), lengths] * 2, axis=1)
    scale = slopes[:, :, None] * slopes[:, None, :]
    return hermite()[2, 2] / h**3 * scale, hermite()[0, 0] * h * scale


# for the DOF (w, w,x, w,y, w,xy) of each corner: the index of the cubic in x, and of the cubic in y
_X = np.array([2 * i + a for i, _ in CORNERS for a in (0, 1, 0, 1)])
_Y = np.array([2 * j + b for _, j in CORNERS for b in (0, 0, 1, 1)])


@cache
def _rectangle() -> tuple[Array, Array, Array, Array]:
    """The integrals of (w,xx², w,yy²), of w,xx w,yy + w,yy w,xx, of w,xy² and of w² over the unit square."""
    A = hermite()
    x, y = _X, _Y

    def product(a: tuple[int, int], b: tuple[int, int]) -> Array:
        return A[a][np.ix_(x, x)] * A[b][np.ix_(y, y)]

    return (np.stack([product((2, 2), (0, 0)), product((0, 0), (2, 2))]), product((2, 0), (0, 2)) + product((0, 2), (2, 0)),
            product((1, 1), (1, 1)), product((0, 0), (0, 0)))


def bfs_matrices(sides: Array, nu: float) -> tuple[Array, Array]:
    """∫ (w,xx² + w,yy² + 2ν w,xx w,yy + 2(1 - ν) w,xy²) and ∫ w², (m, 16, 16), for rectangles with sides (m, 2).

    Corners as in CORNERS, with (w, w,x, w,y, w,xy) at each: products of the cubics in x and in y
    (Bogner, Fox and Schmit 1965).
    """
    square, mixed, twist, mass = _rectangle()
    a, b = sides[:, 0], sides[:, 1]
    slopes = _slopes(sides)
    scale = slopes[:, :, None] * slopes[:, None, :]
    a, b = a[:, None, None], b[:, None, None]
    energy = square[0] * (b / a**3) + square[1] * (a / b**3) + (nu * mixed + 2 * (1 - nu) * twist) / (a * b)
    return energy * scale, mass * (a * b) * scale


def bfs_integrals(sides: Array) -> Array:
    """∫ φ dA of the functions of `bfs_matrices`, (m, 16): exact for w up to cubic in x and in y."""
    return (HERMITE_MEAN[_X] * HERMITE_MEAN[_Y]) * sides.prod(axis=1)[:, None] * _slopes(sides)


def _slopes(sides: Array) -> Array:
    """The factors from the DOF of rectangles to the DOF of the unit square, (m, 16)."""
    a, b = sides[:, 0], sides[:, 1]
    return np.tile(np.stack([np.ones_like(a), a, b, a * b], axis=1), (1, 4))


@cache
def _triangle_mass() -> Array:
    """∫ φ φᵀ / area for φ = (λ1, λ2, λ3, λ2λ3, λ3λ1, λ1λ2), shape (6, 6)."""
    X, w = side_quadrature(3, 4)
    corner = np.stack([1 - X[:, 0] - X[:, 1], X[:, 0], X[:, 1]])
    values = np.vstack([corner, [corner[i] * corner[j] for i, j in OPPOSITE]])
    return np.round(180 * 2 * (values * w) @ values.T) / 180


def morley_matrices(corners: Array, normals: Array, nu: float) -> tuple[Array, Array]:
    """The integrals of `bfs_matrices`, (m, 6, 6), for triangles with corners (m, 3, 2).

    DOF: w at the corners, then ∂w/∂n in the middle of the edges OPPOSITE them, n being `normals` (m, 3, 2). With
    barycentric λ, the function of

        edge i is    (λ_i - λ_i²) / (n·∇λ_i)
        corner j is  λ_j + 2 λ_k λ_l + Σ_{i = k, l} (∇λ_k·∇λ_l / |∇λ_i|²)(λ_i - λ_i²)

    (Ming and Xu, Numer. Math. 103 (2006); λ_i - λ_i² has zero slope in the middle of the edges that meet at corner i).
    scikit-fem computes the same functions by inverting a matrix of powers of the global coordinates. That loses digits
    with the square of the ratio of plate size to cell size.
    """
    C, gradient, double = _morley_functions(corners, normals)
    outer = np.stack([gradient[:, k, :, None] * gradient[:, m, None, :] for k, m in OPPOSITE], axis=1)
    outer = outer + outer.swapaxes(2, 3)
    curvature = C[:, :, 3:] @ np.stack([outer[..., 0, 0], outer[..., 1, 1], outer[..., 0, 1]], axis=-1)
    metric = np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 2 * (1 - nu)]])
    area = np.abs(double)[:, None, None] / 2
    energy = area * (curvature @ metric @ curvature.swapaxes(1, 2))
    mass = area * (C @ _triangle_mass() @ C.swapaxes(1, 2))
    return (energy + energy.swapaxes(1, 2)) / 2, (mass + mass.swapaxes(1, 2)) / 2


def morley_integrals(corners: Array, normals: Array) -> Array:
    """∫ φ dA of the functions of `morley_matrices`, (m, 6): exact for w up to quadratic."""
    C, _, double = _morley_functions(corners, normals)
    return np.abs(double)[:, None] / 2 * (C @ np.repeat([1 / 3, 1 / 12], 3))


def morley_edge_integrals(corners: Array, normals: Array, opposite: Array) -> Array:
    """∫ φ ds along the edge opposite one corner (m,) of each triangle, of the functions of `morley_matrices`, (m, 6)."""
    C, _, _ = _morley_functions(corners, normals)
    ends = np.array(OPPOSITE)[opposite]
    length = np.linalg.norm(corners[np.arange(len(corners)), ends[:, 1]] - corners[np.arange(len(corners)), ends[:, 0]], axis=1)
    along = np.hstack([(1 - np.eye(3)) / 2, np.eye(3) / 6])  # of (λ1, λ2, λ3, λ2λ3, λ3λ1, λ1λ2) for edge 1, 2, 3
    return length[:, None] * np.einsum("mij,mj->mi", C, along[opposite])


def _morley_functions(corners: Array, normals: Array) -> tuple[Array, Array, Array]:
    """Coefficients (m, 6, 6), function by function, of (λ1, λ2, λ3, λ2λ3, λ3λ1, λ1λ2); ∇λ (m, 3, 2); twice the areas."""
    span = np.stack([corners[:, k] - corners[:, j] for j, k in OPPOSITE], axis=1)
    double = span[:, 0, 0] * span[:, 1, 1] - span[:, 0, 1] * span[:, 1, 0]
    gradient = np.stack([-span[..., 1], span[..., 0]], axis=-1) / double[:, None, None]
    square = np.einsum("mid,mid->mi", gradient, gradient)
    # λ_i - λ_i² = λ_iλ_k + λ_iλ_l: the products are numbered by the corner that is missing in them, so row i is 0 at i
    bubble = 1.0 - np.eye(3)
    C = np.zeros((len(corners), 6, 6))
    for j, (k, m) in enumerate(OPPOSITE):
        C[:, j, j], C[:, j, 3 + j] = 1.0, 2.0
        dot = np.einsum("md,md->m", gradient[:, k], gradient[:, m])
        for i in (k, m):
            C[:, j, 3:] += (dot / square[:, i])[:, None] * bubble[i]
        C[:, 3 + j, 3:] = (np.einsum("md,md->m", normals[:, j], gradient[:, j]) / square[:, j])[:, None] * bubble[j]
    return C, gradient, double
