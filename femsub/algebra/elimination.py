"""Elimination of linear equations A x = 0 from a model: x = L y with a sparse L, and the number of redundant equations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra.matrices import is_symmetric
from femsub.algebra.null_spaces import ROUNDING, SUMS, RowSpace, row_space
from femsub.checks import EPS, Array, ConditionWarning, Matrix, warn


@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations A x = 0, A (m, n). Some of the coordinates x are physical DOF, the others amplitudes of shapes.

    Attributes
    ----------
    A : sparse, shape (m, n)
    unit : ndarray, shape (n,)
        The displacement of each coordinate at unit energy. Entries are compared in these units.
    physical : ndarray of bool, shape (n,)
        Whether each coordinate is the displacement of a DOF, not the amplitude of a shape.
    owner : ndarray of int, shape (m,)
        The number of the joint that each equation belongs to, for messages.
    size : sparse, shape (m, n)
        The sum of the magnitudes of the terms of each entry. An entry that is rounding beside this sum is left of a cancellation.
        `eliminate` sets and updates it.
    """

    A: Matrix
    unit: Array
    physical: Array
    owner: Array
    size: Any = None

    def chosen(self, rows: Array) -> Equations:
        """The equations with these numbers, or those for which `rows` is True."""
        rows = np.arange(len(self.owner))[rows]
        return replace(self, A=self.A[rows], owner=self.owner[rows], size=None if self.size is None else self.size[rows])

    def through(self, T: Matrix, unit: Array, physical: Array) -> Equations:
        """The equations in new coordinates y, x = T y."""
        size = None if self.size is None else sp.csr_array(self.size @ abs(T))
        return replace(self, A=sp.csr_array(self.A @ T), size=size, unit=unit, physical=physical)


def units(mass: Array, stiffness: Array) -> tuple[Array, float]:
    """The displacement of each coordinate at unit energy, (|k_jj| + ω² |m_jj|)^(-1/2), (n,), and ω², the median |k_jj|/|m_jj|."""
    mass, size = np.abs(mass), np.abs(stiffness)
    both = (size > 0) & (mass > 0)
    typical = float(np.median(size[both] / mass[both])) if both.any() else 1.0
    energy = size + typical * mass
    usual = float(np.median(energy[energy > 0])) if energy.any() else 1.0
    return np.where(energy > 0, energy, usual) ** -0.5, typical


def comparable(unit: Array, spread: float = 1e3) -> Array:
    """The displacements at unit energy, (n,), limited to within a factor `spread` of their median.

    Beside a DOF of almost no stiffness and mass, all other DOF would count as rounding, although the joints move it with them.
    """
    usual = float(np.median(unit)) if len(unit) else 1.0
    return np.clip(unit, usual / spread, usual * spread)


def reach(S: Matrix, unit: Array) -> Array:
    """The displacement of each coordinate y_j, (k,), at which the first DOF of x = S y has moved by its unit; 1 if S_j is 0."""
    size = largest(sp.csr_array(abs(sp.csr_array(S)).T) @ sp.diags_array(1 / unit))
    return 1 / np.where(size > 0, size, 1.0)


@dataclass(frozen=True, eq=False)
class Eliminated:
    """x = L y, L (n, k), for every x that fulfils the equations; `redundant` is the number of redundant equations."""

    L: Matrix
    unit: Array
    physical: Array
    redundant: int


def eliminate(equations: Equations, refuse: Callable[[Array, int, int], None], pivot: float = 1e-5,
              spread: float = 0.1) -> Eliminated:
    """x = L y with A L = 0, in three steps: equal DOF are merged, dependent DOF substituted, and a null space found for the rest.

    1. Equations x_i = x_j and x_i = 0: equal DOF become one coordinate, found by connected components. The entries of L are
       exactly 1. Neither the order of the equations nor a redundant loop changes L.
    2. An equation with a DOF that no other equation contains is solved for this DOF. L stays sparse.
    3. The remaining equations couple generalised coordinates. For each group of equations that share coordinates, x = S Q₂ y.
       S = diag(unit), and Q₂ spans the null space of A S, from a QR decomposition with pivots. A pivot below 1e-10 of the first
       marks a redundant equation.

    Parameters
    ----------
    equations : Equations
    refuse : callable
        Called with the owners of equations that leave their coordinates no motion, and the numbers of these equations and
        coordinates. It raises the error.
    pivot : float
        An equation is solved for a DOF only if its entry, relative to the largest one, exceeds this. The default allows for lever
        arms in mm.
    spread : float
        The same for a generalised coordinate, in units of energy. A tenth is the usual threshold of sparse LU.

    Raises
    ------
    InputError
        By `refuse`.
    """
    given, whole = equations.A.shape
    L = sp.eye_array(whole, format="csr")
    equations = _pruned(replace(equations, size=abs(equations.A)))

    # 1. equal DOF get one coordinate, held DOF none, until no equation of these two kinds is left
    while True:
        A, n = equations.A, equations.A.shape[1]
        count, start = np.diff(A.indptr), A.indptr[:-1]
        held, pair = A.indices[start[count == 1]], start[count == 2]
        pair = pair[A.data[pair] == -A.data[pair + 1]]
        if not len(held) and not len(pair):
            break
        graph = sp.csr_array((np.ones(len(pair)), (A.indices[pair], A.indices[pair + 1])), shape=(n, n))
        joined, group = connected_components(graph, directed=False)
        moves = np.ones(joined, dtype=bool)
        moves[group[held]] = False
        number = np.cumsum(moves) - 1
        rows = np.flatnonzero(moves[group])
        T = sp.csr_array((np.ones(len(rows)), (rows, number[group[rows]])), shape=(n, int(moves.sum())))
        unit = (T.T @ equations.unit[:, None] ** -2.0).ravel() ** -0.5
        physical = (T.T @ equations.physical.astype(float)) > 0
        L, equations = L @ T, _pruned(equations.through(T, unit, physical))

    # 2. an equation is solved for a coordinate that no other equation contains; equations without such a coordinate are left
    if len(equations.owner):
        A, (m, n) = equations.A, equations.A.shape
        rows, columns, size = np.repeat(np.arange(m), np.diff(A.indptr)), A.indices, np.abs(A.data)
        alone = np.bincount(columns, minlength=n)[columns] == 1
        is_physical = equations.physical[columns]
        energy, plain = size * equations.unit[columns], np.where(is_physical, size, 0.0)
        first = A.indptr[:-1]
        longest = np.maximum.reduceat(plain, first)[rows]
        share = energy / np.maximum.reduceat(energy, first)[rows]
        # prefer a displacement to an amplitude: a dependent displacement keeps its meaning
        rank = np.where(is_physical & (plain > pivot * longest), 1 + size / np.where(longest > 0, longest, 1.0),
                        np.where(share > spread, share, 0.0)) * alone
        best = np.lexsort((rank, rows))[A.indptr[1:] - 1]
        chosen = best[rank[best] > 0]
        taken, dependent = rows[chosen], columns[chosen]
        entry = np.ones(m)
        entry[taken] = A.data[chosen]
        kept = np.ones(n, dtype=bool)
        kept[dependent] = False
        number, owner = np.cumsum(kept) - 1, np.zeros(m, dtype=np.intp)
        owner[taken] = dependent
        used = np.zeros(m, dtype=bool)
        used[taken] = True
        others = used[rows] & kept[columns]
        rest = sp.csr_array((-A.data[others] / entry[rows[others]], (owner[rows[others]], number[columns[others]])),
                            shape=(n, int(kept.sum())))
        T = sp.csr_array(sp.eye_array(n, format="csr")[:, kept] + rest)
        L, equations = L @ T, _pruned(equations.chosen(np.flatnonzero(~used)).through(T, equations.unit[kept],
                                                                                       equations.physical[kept]))

    # 3. for each group of equations an orthonormal basis of its null space, in units of energy
    if len(equations.owner):
        unit, places, blocks = equations.unit, [], []
        for rows, columns in groups(equations.A):
            found = _rows_apart(equations, rows, columns)
            if found.rank == len(columns):
                refuse(equations.owner[rows], len(rows), len(columns))
            places.append(columns)
            blocks.append(unit[columns, None] * _clean(found.rest))
        T, stay = _beside_kept(len(unit), places, blocks)
        new = T.shape[1] - len(stay)
        physical = np.append(equations.physical[stay], np.zeros(new, dtype=bool))
        none = equations.chosen(np.zeros(0, dtype=np.intp))
        L, equations = L @ T, none.through(T, np.append(unit[stay], np.ones(new)), physical)
    return Eliminated(sp.csr_array(L), equations.unit, equations.physical, given - (whole - L.shape[1]))


def largest(A: Matrix) -> Array:
    """The largest entry of each row of a sparse A ≥ 0."""
    return np.asarray(sp.csr_array(A).max(axis=1).todense()).ravel() if all(A.shape) else np.zeros(A.shape[0])


def _pruned(equations: Equations) -> Equations:
    """The equations without entries that are rounding, and without equations that then have no entry.

    Entries of DOF are compared unscaled. In units of energy, a stiff DOF would be rounding beside a soft DOF that equals it, and
    the soft DOF would be held. Entries of shapes have the rounding of their part, and are compared in units of energy.
    """
    A, physical = equations.A, equations.physical[equations.A.indices]
    rows = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    plain = largest(equations.size @ sp.diags_array(equations.physical * 1.0))
    whole = largest(equations.size @ sp.diags_array(equations.unit))
    keep = np.where(physical, np.abs(A.data) > ROUNDING * plain[rows],
                    np.abs(A.data) * equations.unit[A.indices] > ROUNDING * whole[rows])
    left = np.flatnonzero(np.bincount(rows[keep], minlength=A.shape[0]))
    A = sp.csr_array((A.data[keep], (rows[keep], A.indices[keep])), shape=A.shape)
    return replace(equations, A=A).chosen(left)


def _beside_kept(n: int, places: list[Array], blocks: list[Array]) -> tuple[Matrix, Array]:
    """T with x = T y, y = (coordinates in no places, coordinates of the blocks), and the numbers of the former.

    Block i gives the coordinates x in places[i]; those in no places stay as they are.
    """
    taken = np.concatenate(places)
    kept = np.setdiff1d(np.arange(n), taken)
    T = sp.block_diag([sp.eye_array(len(kept)), *map(sp.coo_array, blocks)], format="csr")
    return sp.csr_array(T[np.argsort(np.append(kept, taken))]), kept


def _clean(Q: Array) -> Array:
    """Q with rounding set to 0. It would give rigid motion a strain energy, and a massless coordinate a mass."""
    return np.where(np.abs(Q) > 4 * EPS * np.abs(Q).max(axis=0, initial=0.0), Q, 0.0)


def groups(A: Matrix) -> Iterator[tuple[Array, Array]]:
    """Rows and columns of each connected group of equations."""
    m = A.shape[0]
    graph = sp.block_array([[None, A], [A.T, None]], format="csr")
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if members[0] < m and members[-1] >= m:
            at = int(np.searchsorted(members, m))
            yield members[:at], members[at:] - m


def _rows_apart(equations: Equations, rows: Array, columns: Array, size: Array | None = None) -> RowSpace:
    """The row space of these equations in units of energy, with a warning where rounding decides whether a row is redundant.

    Each row is divided by its norm, or by its `size` before terms cancelled in it. With `size` no basis is computed.
    """
    A = equations.A[rows][:, columns].toarray() * equations.unit[columns]
    found = row_space(A / (np.linalg.norm(A, axis=1) if size is None else size)[:, None], basis=size is None)
    if found.doubt:
        warn(f"the parts' shapes already fulfil an equation of the joints to {found.doubt:.0e} (relative). Rounding decides "
             "whether it is redundant, or costs a mode. Keep more modes, or join fewer DOF", ConditionWarning)
    return found


def links_without_rounding(ends: Iterable[tuple[Matrix, Array]], unit: Array) -> Matrix:
    """Σ B (m, n), the motion between the ends of a link, with rounding set to 0; `unit` (n,) are displacements at unit energy.

    `ends` has each B with the size of its motions at unit energy before the joints, (m,). An entry is compared only with the ends
    that it belongs to. Beside a light end, which moves far, the entries of a heavy end would count as rounding. Beside shapes of
    large numbers, those of the light end would.
    """
    moved: Any = 0.0
    size: Any = 0.0
    for B, whole in ends:
        end = masked(B, abs(B) * unit > ROUNDING * whole[:, None])
        moved = moved + end
        size = size + (end != 0) * whole[:, None]
    return masked(moved, abs(moved) * unit > ROUNDING * size)  # the difference of ends that move alike is rounding


def masked(A: Matrix, keep: Matrix) -> Matrix:
    """A with 0 where `keep` is not True."""
    return sp.csr_array(A.multiply(keep)) if sp.issparse(A) else np.where(keep, A, 0.0)


def known_sums(A: Matrix, size: Matrix) -> Matrix:
    """A with 0 where a sum is rounding beside the `size` of its terms."""
    return masked(A, abs(A) > SUMS * size)


def independent(equations: Equations, size: Array) -> Array:
    """Indices (ascending) of a maximal set of independent equations.

    `size` (m,) is the size of each equation before terms cancelled in it. An equation whose remainder is rounding beside that
    size follows from the others.
    """
    found = [np.zeros(0, dtype=np.intp)]
    for rows, columns in groups(equations.A):
        apart = _rows_apart(equations, rows, columns, size[rows])
        found.append(rows[apart.order[:apart.rank]])
    return np.sort(np.concatenate(found))


def product(A: Matrix, B: Matrix, filled: float = 0.3) -> Matrix:
    """A B, sparse if both are.

    Two matrices with more than the share `filled` of nonzeros are multiplied as dense ones, which is faster. Interfaces that
    spread over all coordinates give such matrices.
    """
    dense = [X.toarray() if sp.issparse(X) and X.nnz > filled * X.shape[0] * X.shape[1] else X for X in (A, B)]
    if any(map(sp.issparse, dense)):
        return A @ B
    C = dense[0] @ dense[1]
    return sp.csr_array(C) if sp.issparse(A) and sp.issparse(B) else C


def congruent(A: Matrix, T: Matrix) -> Matrix:
    """TᵀAT, sparse if A is; symmetric to the last digit if A is."""
    B = product(T.T, product(A, T))
    B = sp.csr_array(B) if sp.issparse(A) else B
    return (B + B.T) / 2 if is_symmetric(A) else B


def without_dust(A: Matrix, bound: Array) -> Matrix:
    """A positive semidefinite A with 0 in rows and columns whose diagonal entry is rounding, of either sign, beside `bound`."""
    dust = A.diagonal() <= SUMS * bound
    if not A.diagonal()[dust].any():
        return A
    kept = ~dust
    return masked(masked(A, kept[:, None]), kept)


def recovered(B: Matrix, unit: Array) -> tuple[Matrix | None, Array]:
    """x = T y, where y[places] are the interface displacements u_b = B x: B T is I in these columns, and 0 in all others.

    Coordinates that only unit rows of B contain stay as they are. If B does not have full rank, there is no such T, and x stays.
    R. R. Craig and C.-J. Chang (1977) solve for the residual coordinates for the same purpose.

    Parameters
    ----------
    B : sparse, shape (b, n)
    unit : ndarray, shape (n,)
        The displacement of each coordinate at unit energy.

    Returns
    -------
    T : sparse, shape (n, n), or None for the identity
        The columns of the coordinates that stay come first.
    places : ndarray, shape (b,), or (0,) where B does not have full rank
        The columns of T that belong to u_b.
    """
    import scipy.linalg as la

    b, n = B.shape
    plain = (np.diff(B.indptr) == 1) & (B.sum(axis=1) == 1.0)
    columns = np.unique(B[np.flatnonzero(~plain)].indices)
    mixed = ~plain
    mixed[plain] = np.isin(B.indices[B.indptr[:-1][plain]], columns)  # unit rows of a DOF that another row contains, too
    rows = np.flatnonzero(mixed)
    if len(rows) > len(columns):
        return None, np.zeros(0, dtype=np.intp)
    kept = np.setdiff1d(np.arange(n), columns)
    places = np.zeros(b, dtype=np.intp)
    places[~mixed] = np.searchsorted(kept, B.indices[B.indptr[:-1][~mixed]])
    if not len(rows):
        return None, places
    E = B[rows][:, columns].toarray() * unit[columns]
    size = np.linalg.norm(E, axis=1)
    found = row_space(E / size[:, None])
    if found.rank < len(rows):
        return None, places[:0]
    lift = np.zeros((len(columns), len(rows)))
    lift[:, found.order] = found.Q[:, :len(rows)] @ la.solve_triangular(found.R[:len(rows)], np.eye(len(rows)), trans="T")
    block = unit[columns, None] * np.hstack([_clean(lift) / size, _clean(found.rest)])
    places[rows] = len(kept) + np.arange(len(rows))
    return _beside_kept(n, [columns], [block])[0], places
