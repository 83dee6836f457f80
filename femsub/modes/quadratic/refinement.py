"""Refinement of a reduced model's complex modes to those of the full model; the change of λ is the reduced model's error."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femsub.checks import (
    Array,
    ConditionWarning,
    FemsubWarning,
    InputError,
    InputTypeError,
    Matrix,
    NotConvergedError,
    SingularMatrixError,
    items,
    positive_number,
    warn,
    whole_number,
)
from femsub.coupling import System
from femsub.model import Contacts, Pencil, ReducedSubstructure, Substructure, without
from femsub.modes.quadratic import dense
from femsub.modes.quadratic.complex_modes import ComplexModes, with_bars
from femsub.modes.quadratic.energy_basis import EnergyBasis, terms_of
from femsub.modes.quadratic.full_solve import ByParts, ByWhole, solve_of
from femsub.modes.quadratic.matching import HALF, assigned, pair_costs

APART = 0.1  # two refined modes with a larger relative distance of λ are never compared as one space


@dataclass(frozen=True, eq=False, repr=False)
class Refined:
    """Complex modes of the full model, refined by `refine` from k complex modes of a reduced model.

    Attributes
    ----------
    modes : ComplexModes
        Modes of the full model, in the order of `which`.
    which : ndarray of int, shape (k,)
        Rows of the reduced model's modes.
    reduced : ndarray of complex, shape (k,)
        Their eigenvalues in the reduced model.
    moved : ndarray, shape (k,)
        |λ_full - λ_reduced|, the error of the reduced result; NaN if there is no counterpart, see `lost`.
    overlap : ndarray, shape (k,)
        The share of the reduced shape's energy that it has in common with the refined shape, 0 to 1. Modes whose λ are closer
        together than the error of the reduced model, such as double modes of a disc, are compared as one space: within it their
        shapes are arbitrary.
    merged : tuple of (i, j)
        Rows i and j of the reduced modes lead to the same mode of the full model; j is also `lost`.
    lost : ndarray of bool, shape (k,)
        The refined mode has less than half of the reduced shape: the full model has no such mode.
    steps, factorisations, solves : int
        Number of iterations, of factorisations (0 if factors of earlier calls were used), and of right-hand sides solved.
    whole : str
        Why the whole of a system was factorised; empty if the factors of its parts were used.

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(30, belt=2), fs.Belt(slope=-0.01)
    >>> rom = fs.reduce(sub, fs.CraigChang(modes=6), ports=True)
    >>> refined = fs.refine(sub, fs.complex_modes(rom, belt, count=4), rom, belt)
    >>> bool(refined.lost.any()), bool(refined.moved.max() < 1e-4)
    (False, True)
    """

    modes: ComplexModes
    which: Array
    reduced: Array
    moved: Array
    overlap: Array
    merged: tuple[tuple[int, int], ...]
    lost: Array
    steps: int
    factorisations: int
    solves: int
    whole: str = ""

    def __repr__(self) -> str:
        size = np.abs(self.reduced)
        share = np.divide(self.moved, size, out=np.zeros(len(size)), where=(size > 0) & np.isfinite(self.moved))
        lost = f", {int(self.lost.sum())} without a counterpart in the full model" if self.lost.any() else ""
        return (f"Refined: {len(self.which)} complex modes{lost}, moved by up to {share.max(initial=0.0):.2g} of |λ|; "
                f"{self.steps} steps, {self.factorisations} factorisations, {self.solves} solves"
                f"{'' if self.whole else ' through the parts'}; backward error "
                f"{self.modes.backward_error.max(initial=0.0):.0e}")


def refine(full: Substructure, modes: ComplexModes, rom: ReducedSubstructure | System,
           contacts: Contacts = None, *, which: Sequence[int] | None = None, tol: float = 1e-8,
           steps: int = 20) -> Refined:
    """Refine the complex modes of a reduced model to those of the full model, and return how far each λ moves.

    P(λ)x = 0 of the full model is solved by x ← x - A⁻¹P(λ)x from x = Vq, with A = K - σM factorised once, for all modes
    together. This is residual inverse iteration with a fixed real factor. By itself it converges only for the lowest mode:
    each step multiplies an error component with the frequency Ω by about ω²/Ω². Therefore the corrections of all modes
    join the reduction basis, and λ and x come from the pencil projected on it (Voss's nonlinear Arnoldi method, in a
    block). Then only components with Ω above the basis' cut-off remain.

    A system under belts is not factorised as a whole. A⁻¹ consists of the factors of its parts with their interfaces held, which
    Craig-Bampton and Hurty have already computed, and of a dense matrix for the DOF between the parts (see `ByParts`). If that is
    not possible, the whole is factorised, and ``.whole`` gives the reason.

    Parameters
    ----------
    full : Substructure
        The model that was reduced.
    modes : ComplexModes
        `complex_modes(rom, contacts)`, by count or by band.
    rom : ReducedSubstructure, or System
        The reduced model; for a full system also a system of the same parts, each reduced by its own method.
    contacts : contact, or sequence of contacts, optional
        As for `modes`. The stiffness of contacts between surfaces joins K in A, without their friction.
    which : sequence of int, optional
        Rows of `modes`; all below the cut-off by default.
    tol : float
        Bound of sqrt(r̄ᵀA⁻¹r / x̄ᵀAx) with r = P(λ)x, which is dimensionless. The relative error of λ is about its
        square (its product with that of the left vector).
    steps : int
        Largest number of iterations.

    Returns
    -------
    Refined

    Raises
    ------
    InputError, InputTypeError
        `full`, `modes` and `rom` do not belong together, or a row does not exist.
    NotConvergedError
        Not converged within `steps`; the message has the error reached.

    Warns
    -----
    FemsubWarning
        Reduced modes have no counterpart in the full model, or two have the same counterpart.

    References
    ----------
    A. Neumaier, SIAM J. Numer. Anal. 22 (1985) 914; H. Voss, BIT Numer. Math. 44 (2004) 387.

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(30, belt=2), fs.Belt(slope=-0.01)
    >>> rom = fs.reduce(sub, fs.CraigChang(modes=6), ports=True)
    >>> refined = fs.refine(sub, fs.complex_modes(rom, belt, count=4), rom, belt)
    >>> refined.modes.shapes.shape
    (30, 4)
    """
    chosen, V = _check(full, modes, rom, contacts, which)
    positive_number("tol", tol)
    whole_number("steps", steps, least=1)
    # one row of each conjugate pair is refined, and stands for the other one
    one_of_each: list[int] = []
    stands: list[int] = []
    for row in chosen.tolist():
        value = modes.eigenvalues[row]
        free = [i for i in one_of_each if value.imag and stands.count(i) == 1 and modes.eigenvalues[i] == value.conjugate()]
        one_of_each += [] if free else [row]
        stands.append(free[0] if free else row)
    rows, mirrored = np.array(one_of_each, dtype=int), np.array(stands, dtype=int)
    pencil = full.linearised(contacts)
    full.refuse_empty(pencil.D, pencil.K)
    space = _Space(pencil, *_held(full, rom, pencil, contacts))
    values, X = modes.eigenvalues[rows], V @ modes.shapes[:, rows]
    down = values.imag < 0
    values, X = np.where(down, values.conj(), values), np.where(down, X.conj(), X)
    still = modes.rigid[rows]
    space.add(V)
    q = space.coordinates(X)
    start, first, twin = q, values, np.full(len(rows), -1)
    error = np.where(still, 0.0, np.inf)
    for step in range(steps + 1):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConditionWarning)  # about missing digits of K, which is a projection here
            K, D, M = space.matrices
            small, xs, ys = dense.solve(Pencil(M, D, K))
        at, taken = _matched(values, q, small, xs, still)
        twin = np.where(taken >= 0, taken, twin)
        values, q = np.where(still, 0.0, small[at]), np.where(still, q, xs[:, at])
        left = None if all(pencil.symmetric) else ys[:, at]
        # the space only grows, so an error once below tol stays there
        active = np.flatnonzero(error > tol)
        if not len(active):
            break
        error[active], z = space.corrections(values[active], q[:, active], 0.1 * tol)
        if left is not None:
            other, more = space.corrections(values[active], left[:, active], 0.1 * tol, True)
            error[active], z = np.maximum(error[active], other), np.hstack([z, more])
        if error.max(initial=0.0) <= tol:
            break
        if step == steps or not space.add(z):
            worst = int(error.argmax())
            raise NotConvergedError(
                f"the mode that started at λ = {modes.eigenvalues[rows[worst]]:.6g} is at {values[worst]:.6g} after {step} "
                f"steps, with an error of {error[worst]:.1e} above tol={tol:g}. Give more steps, a larger tol, or refine fewer "
                "modes from a basis with a higher cut-off")
        grown = space.V.shape[1] - len(q)
        q, start = (np.vstack([part, np.zeros((grown, len(rows)))]) for part in (q, start))
    share = _shares(start, q, values, np.abs(values - first), twin < 0)
    X = space.V @ q
    X = X / np.linalg.norm(X, axis=0)
    Y = X.conj() if left is None else space.V @ left
    Y = Y / np.linalg.norm(Y, axis=0)
    # each chosen mode is that of its representative, or the conjugate
    at = np.array([int(np.flatnonzero(rows == row)[0]) for row in mirrored], dtype=int)
    flip = down[at] != (mirrored != chosen)
    values, X, Y = (np.where(flip, part[..., at].conj(), part[..., at]) for part in (values, X, Y))
    result = with_bars(pencil, values, X, Y, cutoff=full.cutoff)
    lost = ((share[at] < 0.5) | (twin[at] >= 0)) & ~modes.rigid[chosen]
    merged = tuple((int(rows[twin[i]]), int(rows[i])) for i in range(len(rows)) if twin[i] >= 0)
    moved = np.where(lost, np.nan, np.abs(values - modes.eigenvalues[chosen]))
    if lost.any():
        one = int(np.flatnonzero(lost)[0])
        also = f". Rows {', '.join(f'{i} and {j}' for i, j in merged)} lead to the same mode" if merged else ""
        warn(
            f"{int(lost.sum())} of {len(chosen)} reduced modes have no counterpart in the full model. The first is row "
            f"{chosen[one]}, λ = {modes.eigenvalues[chosen[one]]:.6g}: refined to λ = {values[one]:.6g} it keeps "
            f"{100 * share[at][one]:.2g} % of its shape{also}. Keep more modes in the basis", FemsubWarning)
    return Refined(result, chosen, modes.eigenvalues[chosen], moved, share[at], merged, lost, step, space.by.factorisations,
                   space.solves, space.by.whole)


def _held(full: Substructure, rom: Any, pencil: Pencil, contacts: Contacts) -> tuple[Matrix, ByWhole | ByParts]:
    """K plus the symmetric contact stiffness without friction, which presses surfaces together, and its solver.

    Friction is the parameter mu of a contact. If this K is not positive definite, the K without contacts is used; the refinement
    is slower then.
    """
    if pencil.K is full.K:
        return full.K, solve_of(full, rom, full.K)
    K = full.linearised(without(contacts)).K
    try:
        K = (K + K.T) * 0.5
        return K, solve_of(full, rom, K)
    except SingularMatrixError:
        return full.K, solve_of(full, rom, full.K)


class _Space(EnergyBasis):
    """The basis that grows by corrections, orthonormal in the A of `by`, and the pencil's terms on it."""

    def __init__(self, pencil: Pencil, K: Matrix, by: ByWhole | ByParts) -> None:
        self.by, self.solves = by, 0
        terms = [*by.terms(pencil.M), *terms_of(pencil.D, (0.0, 1.0, 0.0))]
        if pencil.K is not K:
            terms += terms_of(pencil.K - K, (1.0, 0.0, 0.0))
        super().__init__(by.product, by.solve, terms, pencil.size)

    def coordinates(self, X: Array) -> Array:
        return self.V.T @ (self.product(X.real) + 1j * self.product(X.imag))

    def corrections(self, values: Array, q: Array, least: float, left: bool = False) -> tuple[Array, Array]:
        """sqrt(r̄ᵀA⁻¹r / x̄ᵀAx) per column of x = Vq; real and imaginary parts of A⁻¹r, for x of unit energy, above `least`.

        For left vectors r = P(λ)ᴴx. VᵀP(λ)x is 0, so A⁻¹r lies outside V.
        """
        # With the phase that makes them as real as possible, half of the corrections are negligible and left out.
        q = q * np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", q, q))) / np.linalg.norm(q, axis=0)
        z = self.residuals(values, q, left)
        self.solves += z.shape[1]
        lengths = np.sqrt(np.maximum(np.einsum("ij,ij->j", z, self.product(z)), 0.0))
        return np.linalg.norm(lengths.reshape(-1, 2), axis=1), z[:, lengths > least]


def _shares(start: Array, q: Array, values: Array, moved: Array, own: Array) -> Array:
    """The share (k,) of each starting shape in the span of the refined modes that the reduced model does not separate from it.

    `own` marks the modes that are no twin of another mode.
    """
    unit, found = q / np.maximum(np.linalg.norm(q, axis=0), 1e-300), np.zeros(len(values))
    for i, value in enumerate(values):
        near = np.abs(values - value) <= np.minimum(np.maximum(moved, moved[i]), APART * np.abs(value))
        near &= own
        near[i] = True
        space = np.linalg.qr(unit[:, near])[0]
        found[i] = float(np.linalg.norm(space.conj().T @ start[:, i])) ** 2 / max(float(np.linalg.norm(start[:, i])) ** 2, 1e-300)
    return found


def _matched(values: Array, q: Array, small: Array, xs: Array, still: Array) -> tuple[Array, Array]:
    """One Ritz pair for each mode of the previous step, by shape and distance; and which mode has taken its best pair (or -1)."""
    unit = q / np.maximum(np.linalg.norm(q, axis=0), 1e-300)
    shapes = np.abs(unit.conj().T @ (xs / np.maximum(np.linalg.norm(xs, axis=0), 1e-300))) ** 2
    cost = pair_costs(values, small, shapes, weight=1.0, far=1.0)
    cost[:, small.imag < 0] = 3.0  # conjugates have nearly the same shapes
    cost[still] = 0.0
    rows, at = assigned(cost)
    twin = np.full(len(values), -1)
    best = cost.argmin(axis=1)
    for i in rows[~still]:
        taken = np.flatnonzero((at == best[i]) & ~still)
        if best[i] != at[i] and len(taken) and cost[i, at[i]] > cost[i, best[i]] + 0.5:  # half a shape, as for `Refined.lost`
            twin[i] = int(taken[0])
    return at, twin


def _check(full: Any, modes: Any, rom: Any, contacts: Any, which: Any) -> tuple[Array, Array]:
    """The rows of the modes, and V with x = Vq."""
    joined = isinstance(full, System) and isinstance(rom, System)
    fits = joined or (isinstance(full, Substructure) and isinstance(rom, ReducedSubstructure))
    if not fits or not isinstance(modes, ComplexModes):
        raise InputTypeError("refine takes (full, modes, rom): a Substructure, complex_modes(rom, …) and the reduced model, not "
                             f"({type(full).__name__}, {type(modes).__name__}, {type(rom).__name__})")
    if joined and list(full.parts) != list(rom.parts):
        raise InputError(f"the parts of {rom.name!r} ({', '.join(rom.parts)}) are not those of {full.name!r} "
                         f"({', '.join(full.parts)})")
    V = full.collected(rom.expand(np.eye(rom.size))) if joined else rom.V
    if V.shape[0] != full.size:
        raise InputError(f"{rom.name!r} was reduced from {V.shape[0]} DOF, but the full model has {full.size}")
    if modes.shapes.shape[0] != rom.size:
        raise InputError(f"the modes have {modes.shapes.shape[0]} coordinates, but {rom.name!r} has {rom.size}. Give "
                         "complex_modes of the reduced model")
    if which is None:
        chosen = np.flatnonzero(~modes.above_cutoff)
    else:
        chosen = np.array([whole_number("which", row) for row in items("which", which, "rows")], dtype=int)
        bad = chosen[(chosen < 0) | (chosen >= len(modes))]
        if len(bad) or len(np.unique(chosen)) < len(chosen):
            raise InputError(f"which must list rows of the {len(modes)} modes, each once, but is {list(map(int, chosen))}")
    if not len(chosen):
        raise InputError("there is no mode to refine: none lies below the reduction's cut-off. Select rows by which=")
    error = rom.linearised(contacts).backward_error(modes.eigenvalues[chosen], modes.shapes[:, chosen])
    if error.max() > HALF:
        raise InputError(f"the modes are not those of {rom.name!r} with these contacts: their backward error is "
                         f"{error.max():.1e}. Give the same contacts as to complex_modes")
    return chosen, V
