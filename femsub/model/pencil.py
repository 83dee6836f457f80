"""The quadratic pencil λ²M + λD + K: the input of every stability analysis, for full and reduced models alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import (
    BLOCK,
    Frozen,
    as_matrix,
    diagonal,
    equilibration,
    halves,
    is_symmetric,
    norm,
    plus,
    scaled,
    shared,
    times,
    unit_length,
    units as energy_units,
    weighted,
    without_rounding,
    without_signs,
)
from femsub.checks import Array, InputError, Matrix, limit_of, positive_number, real_array, warn
from femsub.model.constraints import Freed, freed
from femsub.model.rigid_motion import Carried, Damped, Scaled, Touched, changed

SPREAD = 16.0  # ratio of the DOF's scales above which a sparse pencil is rescaled


@dataclass(frozen=True, eq=False, repr=False)
class Pencil(Frozen):
    """A quadratic eigenvalue problem, given by its matrices: P(λ) = λ²M + λD + K.

    M, D and K are real, of shape (n, n), sparse or dense, symmetric or not.

    Parameters
    ----------
    M, D, K : array_like or sparse, shape (n, n)
        Mass, damping and stiffness in consistent units; λ is then in radians per unit of time. ``D=None`` means no damping. If
        one of the three is dense, all are stored dense.

    Attributes
    ----------
    symmetric : (bool, bool, bool)
        Whether M, D and K are exactly symmetric.
    contacts : tuple of (float or ndarray, float or ndarray, ndarray)
        (C_D, C_K, W) of the terms W C_D Wᵀ and W C_K Wᵀ that `with_contact` has added to D and K; a number c stands for c times
        the unit matrix. They are kept because rounding hides their low rank in D and K.
    K0 : array or sparse, shape (n, n)
        K without these contacts.
    rigid_motion : RigidMotion, its source, or None
        Rigid motion that the model carries. If it is None, rigid motion is found from K and D, within their rounding.
    noise : ndarray, shape (n, k)
        G: projections may have changed D by up to EPS G Gᵀ, entry by entry.
    cutoff : float
        Cut-off frequency of a pencil in the coordinates of a basis: modes above it are artefacts of the reduction. inf if the
        basis is complete, NaN if it is not known.

    Raises
    ------
    InputError, InputTypeError
        Shapes that do not fit, NaN or Inf, complex entries.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Pencil([[1, 0], [0, 1]], None, [[2, -1], [-1, 1]])
    Pencil: 2 DOF, dense, all symmetric
    """

    M: Matrix
    D: Matrix
    K: Matrix
    symmetric: tuple[bool, bool, bool] = field(init=False)
    contacts: tuple[tuple[float | Array, float | Array, Array], ...] = field(init=False)
    K0: Matrix = field(init=False)
    rigid_motion: Carried = field(init=False)
    noise: Array = field(init=False)
    cutoff: float = field(init=False)

    def __init__(self, M: Any, D: Any, K: Any) -> None:
        mass = as_matrix("M", M)
        stiffness = as_matrix("K", K, mass.shape[0])
        damping = sp.csr_array(mass.shape) if D is None else as_matrix("D", D, mass.shape[0])
        parts = (mass, damping, stiffness)
        if not all(sp.issparse(part) for part in ((mass, stiffness) if D is None else parts)):
            parts = tuple(map(_dense, parts))
        checked, flags = zip(*(without_rounding(part) for part in parts), strict=True)
        self._set(**dict(zip("MDK", checked, strict=True)), symmetric=flags, contacts=(), K0=checked[2], rigid_motion=None,
                  noise=np.zeros((mass.shape[0], 0)), cutoff=np.inf)

    def __repr__(self) -> str:
        kind = "sparse" if self.is_sparse else "dense"
        odd = [name for name, flag in zip("MDK", self.symmetric, strict=True) if not flag]
        return f"Pencil: {self.size} DOF, {kind}, {'all symmetric' if not odd else ' and '.join(odd) + ' unsymmetric'}" \
            + limit_of(self.cutoff)

    @property
    def size(self) -> int:
        return int(self.M.shape[0])

    @property
    def is_sparse(self) -> bool:
        return bool(sp.issparse(self.K))

    @cached_property
    def norms(self) -> tuple[float, float, float]:
        """Upper bounds of ‖M‖₂, ‖D‖₂ and ‖K‖₂ (see `norm`)."""
        return norm(self.M), norm(self.D), norm(self.K)

    @cached_property
    def symmetric_stiffness(self) -> Matrix:
        """The symmetric part of K without contacts: `K0` itself if that is symmetric."""
        if is_symmetric(self.K0) if self.K0 is not self.K else self.symmetric[2]:
            return self.K0
        return self.halves[0]

    @cached_property
    def halves(self) -> tuple[Matrix, Matrix]:
        """The symmetric and the skew part of K without contacts."""
        return halves(self.K0)

    @cached_property
    def freed(self) -> Freed | None:
        """The pencil without its Lagrange multipliers, or None if it has none (see `constraints`)."""
        return freed(self)

    def dense(self) -> Pencil:
        """The same pencil with dense matrices."""
        if not self.is_sparse:
            return self
        found = Pencil(*(part.toarray() for part in (self.M, self.D, self.K)))
        return found._with(rigid_motion=self.rigid_motion, noise=self.noise, cutoff=self.cutoff)

    def sparse(self) -> Pencil:
        """The same pencil with sparse matrices."""
        if self.is_sparse:
            return self
        found = Pencil(*(sp.csr_array(part) for part in (self.M, self.D, self.K)))
        return found._with(rigid_motion=self.rigid_motion, noise=self.noise, cutoff=self.cutoff, contacts=self.contacts,
                           K0=found.K if self.K0 is self.K else sp.csr_array(self.K0))

    def carrying(self, rigid_motion: Carried, noise: Array, cutoff: float | None = None) -> Pencil:
        """A copy with this rigid motion, rounding in D (`noise`) and, if given, cut-off."""
        return self._with(rigid_motion=rigid_motion, noise=noise, cutoff=self.cutoff if cutoff is None else float(cutoff))

    def below(self, cutoff: float) -> Pencil:
        """A copy with this cut-off."""
        return self if cutoff == self.cutoff else self._with(cutoff=float(cutoff))

    def reduced(self, basis: Any, cutoff: float | None = None) -> Pencil:
        """VᵀP(λ)V (r, r) on the basis V of a reduced model. See `Affine.reduced`."""
        V, limit = basis_of(basis, self.size, cutoff)
        return Pencil(*(projected(A, V) for A in (self.M, self.D, self.K))).below(float(np.minimum(limit, self.cutoff)))

    def transposed(self) -> Pencil:
        """λ²Mᵀ + λDᵀ + Kᵀ. Its right eigenvectors are the conjugated left eigenvectors of this pencil."""
        return Pencil(self.M.T, self.D.T, self.K.T)

    def with_contact(self, damping: float | Array, W: Array, stiffness: float | Array = 0.0) -> Pencil:
        """A copy with D + W C_D Wᵀ and K + W C_K Wᵀ, W of shape (n,) or (n, p), each C a number or a matrix (p, p).

        A number c stands for c times the unit matrix. Matrices that do not change are shared and not checked again. A sparse C
        belongs to a surface, with too many columns for methods that use the low rank: it becomes part of `K0`.
        """
        return self.with_contacts([(W, damping, stiffness)])

    def with_contacts(self, terms: Sequence[tuple[Matrix, float | Matrix, float | Matrix]]) -> Pencil:
        """A copy with D + Σ W C_D Wᵀ and K + Σ W C_K Wᵀ for terms (W, C_D, C_K): see `with_contact`. Sums are checked once."""
        terms = [(W, damping, stiffness) for W, damping, stiffness in terms if _any(damping) or _any(stiffness)]
        if not terms:
            return self
        surface = [sp.issparse(damping) or sp.issparse(stiffness) for _, damping, stiffness in terms]
        found, K0, motion = self, self.K0, self.rigid_motion
        contacts: list[Any] = list(self.contacts)
        damped, stiff = ([contact_matrix(one[0], one[of]) if _any(one[of]) else None for one in terms] for of in (1, 2))
        if any(A is not None for A in stiff):
            K, symmetric = self._with_more("K", _total(stiff))
            found = self._with(K=K, symmetric=(*self.symmetric[:2], symmetric))
            of_surfaces = [A if flag else None for A, flag in zip(stiff, surface, strict=True)]
            if any(A is not None for A in of_surfaces):
                K0 = K if self.K0 is self.K and all(surface) else self._plus(self.K0, _total(of_surfaces))
        if any(A is not None for A in damped):
            found = found.with_damping(_total(damped))
        unit = energy_units(diagonal(self.M), diagonal(self.K0))[0]
        for (W, damping, stiffness), flag in zip(terms, surface, strict=True):
            if not flag:
                C_D, C_K = (C if np.isscalar(C) else np.array(C) for C in (damping, stiffness))
                contacts.append((C_D, C_K, np.array(W).reshape(len(W), -1)))
            motion = changed(motion, Touched(damping, W, stiffness, unit))
        return found._with(contacts=tuple(contacts), K0=K0, noise=self.noise, rigid_motion=motion)

    def with_damping(self, extra: Matrix) -> Pencil:
        """A copy with D + extra. M and K are shared and not checked again."""
        return self._damped(*self._with_more("D", extra))._with(noise=self.noise)

    def _with_more(self, name: str, extra: Matrix) -> tuple[Matrix, bool]:
        """D or K plus `extra`, checked, and whether the sum is symmetric."""
        part = getattr(self, name)
        if not (self.is_sparse and self.symmetric["MDK".index(name)]):
            return without_rounding(as_matrix(name, self._plus(part, extra), self.size))
        more = sp.csr_array(extra)
        more.sum_duplicates()
        more = sp.csr_array((more.data, more.indices, more.indptr), shape=more.shape)  # with 32-bit indices, like M, D and K
        more, symmetric = without_rounding(more, part)
        return as_matrix(name, weighted([(1.0, part), (1.0, more)]), self.size), symmetric

    def _plus(self, part: Matrix, extra: Matrix) -> Matrix:
        return part + (sp.csr_array(extra) if self.is_sparse else _dense(extra))

    def damped_by(self, D: Any) -> Pencil:
        """A copy with another D (None: no damping), sparse or dense like M and K, which are shared and not checked again."""
        D = sp.csr_array(self.M.shape) if D is None else D
        D = (D if sp.issparse(D) else sp.csr_array(np.asarray(D))) if self.is_sparse else _dense(D)
        return self._damped(*without_rounding(as_matrix("D", D, self.size)))

    def _damped(self, D: Matrix, symmetric: bool) -> Pencil:
        return self._with(D=D, symmetric=(self.symmetric[0], symmetric, self.symmetric[2]), contacts=(), K0=self.K,
                          noise=np.zeros((self.size, 0)), rigid_motion=changed(self.rigid_motion, Damped(D, diagonal(self.M))))

    @cached_property
    def units(self) -> tuple[Array, Array]:
        """Scales r and c, (n,) each, powers of two, with which all DOF of diag(r) P(λ) diag(c) have entries of similar size.

        They follow from the diagonal of K. They come from `equilibration` of |K| + ω|D| + ω²|M| with a typical ω if a diagonal
        entry is 0, or if K is unsymmetric with much larger entries beside the diagonal. r = c unless M is unsymmetric.
        """
        stiffness = np.abs(diagonal(self.K))
        if self.symmetric[0] and stiffness.all():
            r = c = 2.0 ** np.rint(-np.log2(stiffness) / 2)
            # the diagonal of an unsymmetric K, about 1 after scaling, shows the units only if no entry is much larger
            if self.symmetric[2] or without_signs(scaled(self.K, r, c)).max() <= SPREAD**0.5:
                return r, c
        mass = np.abs(diagonal(self.M))
        both = (mass > 0) & (stiffness > 0)
        omega = float(np.sqrt(np.median(stiffness[both] / mass[both]))) if both.any() else 1.0
        r, c = equilibration(abs(self.K) + omega * abs(self.D) + omega**2 * abs(self.M))
        if self.symmetric[0]:  # a congruence, so that M stays symmetric
            r = c = 2.0 ** np.rint(np.log2(r * c) / 2)
        return r, c

    def alike(self) -> Pencil:
        """The scaled pencil diag(r) P(λ) diag(c) with the `units` r and c: same λ, shapes x / c and y / r.

        The pencil itself is returned if the scales of its DOF differ by less than a factor of 16. Krylov vectors are orthonormal
        in the units of the DOF: scales that differ by 2ᵏ enlarge rounding errors by about 4ᵏ.
        """
        if all(unit.max() <= SPREAD * unit.min() for unit in self.units):
            return self
        rows, columns = self.units
        # all pencils with these M and K share the scaled matrices, since factors are looked up by the matrix object
        mass, stiffness = shared((self.M, self.K), ("scaled", rows.tobytes(), columns.tobytes()),
                                 lambda: (scaled(self.M, rows, columns), scaled(self.K, rows, columns)))
        parts = {"M": mass, "D": scaled(self.D, rows, columns), "K": stiffness, "noise": rows[:, None] * self.noise,
                 "rigid_motion": changed(self.rigid_motion, Scaled(columns))}
        if np.array_equal(rows, columns):
            return self._with(**parts, contacts=tuple((*C, rows[:, None] * W) for *C, W in self.contacts),
                              K0=stiffness if self.K0 is self.K else scaled(self.K0, rows, columns))
        # not a congruence: D and K may lose their symmetry
        return self._with(**parts, symmetric=tuple(is_symmetric(parts[name]) for name in "MDK"), contacts=(), K0=stiffness)

    def restored(self, X: Array, Y: Array) -> tuple[Array, Array]:
        """Right and left shapes of this pencil, diag(c) X and diag(r) Y of unit length, from shapes X and Y of `alike`."""
        rows, columns = self.units
        return unit_length(columns[:, None] * X), unit_length(rows[:, None] * Y)

    def at(self, value: complex) -> Matrix:
        """P(value), shape (n, n); complex only if `value` is."""
        return plus(plus(value * self.D, self.K), value * value * self.M)

    def residual(self, eigenvalues: Array, shapes: Array) -> Array:
        """R = MXΛ² + DXΛ + KX, column by column P(λ_j) x_j; shapes (k,) and (n, k) give (n, k)."""
        lam = np.asarray(eigenvalues)
        return (self.M @ shapes) * lam**2 + (self.D @ shapes) * lam + self.restoring(lam, shapes)

    def restoring(self, eigenvalues: Array, shapes: Array) -> Array:
        """KX (n, k), the part of P(λ_j) x_j without powers of λ."""
        return times(self.K, shapes)

    @property
    def sizes(self) -> tuple[Matrix, Matrix, Matrix]:
        """|M|, |D| and |K| for the rounding in products, entry by entry. The last includes all terms without λ."""
        return without_signs(self.M), without_signs(self.D), without_signs(self.K)

    def magnitude(self, eigenvalues: Array, shapes: Array) -> Array:
        """(|λ|²|M| + |λ||D| + |K|)|x| entry by entry: EPS times this is the rounding in P(λ)x."""
        lam, size = np.abs(eigenvalues), np.abs(shapes)
        mass, damping, stiffness = (times(part, size) for part in self.sizes)
        return mass * lam**2 + damping * lam + stiffness

    def backward_error(self, eigenvalues: Array, shapes: Array, residual: Array | None = None) -> Array:
        """Backward errors η_j = ‖P(λ_j)x_j‖ / ((|λ_j|²‖M‖ + |λ_j|‖D‖ + ‖K‖) ‖x_j‖), shape (k,).

        η is the smallest relative change of the matrices that makes (λ, x) an exact eigenpair
        (Tisseur, Linear Algebra Appl. 309 (2000), Th. 1). It depends neither on units nor on the scale of x. Pass R as
        `residual` if it has been computed already.
        """
        lam = np.abs(eigenvalues)
        mass, damping, stiffness = self.norms
        scale = (lam**2 * mass + lam * damping + stiffness) * np.linalg.norm(shapes, axis=0)
        size = np.linalg.norm(self.residual(eigenvalues, shapes) if residual is None else residual, axis=0)
        return np.divide(size, scale, out=np.zeros_like(size), where=scale > 0)


def look_at_the_order(*parts: Sequence[tuple[float, Matrix]], light: float = 0.1, many: int = 10) -> None:
    """Warns if D and K seem to be in each other's place. `parts` are the terms of M, D and K with their factors.

    The damping ratio ζ = d/(2√(mk)) of each DOF with mass, from the diagonals, decides. The warning is given if all have ζ > 1,
    and all would have ζ < `light` with D and K exchanged, as in nearly all structures. At least `many` DOF must agree, which is
    no accident. K must also have no more entries than D: in the right order, D has as many entries only if it damps a material.
    """
    if not all(parts) or _entries(parts[2]) > _entries(parts[1]):
        return
    m, d, k = (np.sum([theta * diagonal(A) for theta, A in terms], axis=0) for terms in parts)
    at = m > 0
    m, d, k = m[at], d[at], np.abs(k[at])
    exchanged = (d > 0) & (d * d > 4 * m * k) & (k * k < (2 * light) ** 2 * m * d)
    if len(m) < many or not k.any() or not exchanged.all():
        return
    with np.errstate(divide="ignore"):
        given, other = (float(np.median(one / (2 * np.sqrt(m * two)))) for one, two in ((d, k), (k, d)))
    warn(f"D and K seem to be in each other's place: by themselves all {len(m)} DOF with mass are overdamped, with a median "
         f"damping ratio of {given:.3g}, and with D and K exchanged all are lightly damped, {other:.3g}. The order is "
         "Pencil(M, D, K) and Affine(M, D, K), but Substructure(M, K, D)")


def _entries(terms: Sequence[tuple[float, Matrix]]) -> int:
    return sum(int(A.nnz if sp.issparse(A) else np.count_nonzero(A)) for _, A in terms)


def _dense(A: Any) -> Any:
    return A.toarray() if sp.issparse(A) else A


def _any(C: Any) -> bool:
    return bool(C.nnz if sp.issparse(C) else np.any(C))


def _total(matrices: Sequence[Matrix | None]) -> Matrix:
    """The sum of the matrices that are not None."""
    return reduce(add, (A for A in matrices if A is not None))


def contact_matrix(W: Matrix, C: float | Array | Matrix) -> Matrix:
    """W C Wᵀ, shape (n, n); W of shape (n,) or (n, p), C a number or a matrix (p, p). Sparse unless W is dense and C sparse."""
    if sp.issparse(C) and not sp.issparse(W):
        return np.asarray(W @ (C @ W.T))
    columns = sp.csr_array(W if sp.issparse(W) else np.asarray(W).reshape(len(W), -1))
    return sp.csr_array(columns @ sp.csr_array(C) @ columns.T if np.ndim(C) or sp.issparse(C) else C * (columns @ columns.T))


def projected(A: Matrix, V: Array) -> Array:
    """VᵀAV (r, r), symmetric if A is."""
    found: Array = np.hstack([V.T @ (A @ V[:, at:at + BLOCK]) for at in range(0, V.shape[1], BLOCK)])
    return (found + found.T) / 2 if is_symmetric(A) else found


def basis_of(basis: Any, size: int, cutoff: float | None) -> tuple[Array, float]:
    """V (n, r) and its cut-off, from a reduced model, or from an array V with `cutoff`. The cut-off is NaN if it is not known."""
    model = hasattr(basis, "V") and hasattr(basis, "cutoff")
    V = real_array("V", basis.V if model else basis)
    if V.ndim != 2 or V.shape[0] != size or not V.shape[1]:
        raise InputError(f"V must have {size} rows, one per DOF, and a column or more, but its shape is {V.shape}")
    if cutoff is not None:
        return V, np.inf if isinstance(cutoff, float) and cutoff == np.inf else positive_number("cutoff", cutoff)
    return V, float(basis.cutoff) if model else np.nan if V.shape[1] < size else np.inf
