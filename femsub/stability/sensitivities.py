"""`sensitivities`: derivatives of complex eigenvalues with respect to parameters, from left and right vectors.

With P(λ; p)x = 0 and yᴴP = 0, P' = ∂P/∂λ and P_j = ∂P/∂p_j,

    λ_j = -yᴴP_j x / yᴴP'x,
    P x_j = -(P_j + λ_j P')x,   Pᴴy_j = -(P_j + λ_j P')ᴴy,   with yᴴP'x_j = 0 and y_jᴴP'x = 0,
    λ_jk = -yᴴ[(P_jk + λ_k P'_j + λ_j P'_k + 2 λ_j λ_k M)x + (P_j + λ_j P')x_k + (P_k + λ_k P')x_j] / yᴴP'x.

One factor of P beside λ serves all parameters. The bar of λ_j comes from the residuals r = Px and l = Pᴴy, rounding included. An
error δx of x with Pδx = -r changes λ_j by y_jᴴ(-r) / yᴴP'x to first order; an error of y changes it by lᴴx_j / yᴴP'x. An error of
λ does not enter through the vectors, because of the conditions on x_j and y_j.

Where eigenvalues meet, λ is not differentiable. But the matrix S (m, m) with these eigenvalues is differentiable, up to
similarity. With Z = [X; XS] of the pencil's companion form, its left counterpart W, and Q the lower half of W,

    MXS² + DXS + KX = 0,   S_j = -(WᴴEZ)⁻¹ Qᴴ(M_j XS² + D_j XS + K_j X),   E = diag(I, M).

References
----------
P. Lancaster, Numer. Math. 6 (1964) 377 (λ_j); A. L. Andrew, K.-W. E. Chu, P. Lancaster, SIAM J. Matrix Anal. Appl. 14 (1993) 903
(vectors, second derivatives); A. P. Seyranian, A. A. Mailybaev, Multiparameter Stability Theory with Mechanical Applications
(2003), ch. 2 (where eigenvalues meet).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import (
    EPS,
    Array,
    InputError,
    Matrix,
    finite_number,
    instance,
    items,
    mapping,
    positive_number,
    truth,
    unknown_name,
    whole_numbers,
    word,
)
from femsub.model import Affine, Jet, Substructure, as_changes, contacts_of, family_of, fields_of, kinks_of
from femsub.modes import ComplexModes, corrected, left_by_symmetric_factor, left_slope, pencil_of, slope, solver_near
from femsub.output import Chart, Displayed, Table, column
from femsub.stability.charts import sensitivities_chart

if TYPE_CHECKING:
    from femsub.model import Change, Contacts, Pencil

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class MetPair:
    """Eigenvalues that meet, or nearly meet: the eigenvalues of S + Σ_j δp_j S_j, where S is known to first order.

    For a pair, λ = mean + Σ mean_j δp_j ± √(square + Σ square_j δp_j), with `square` of half the distance. If it is 0 while its
    derivative is not, λ moves with the root of δp.

    Attributes
    ----------
    modes : tuple of int
        Their indices among the given modes. A partner that is not among these is not listed.
    S : ndarray, shape (m, m)
    slopes : ndarray, shape (q, m, m)
        S_j for each parameter, in units of λ per unit of the parameter.
    error : float
        Estimated error of the eigenvalues' mean, from the last step of the iteration and rounding.
    """

    modes: tuple[int, ...]
    S: Array
    slopes: Array
    error: float

    @property
    def mean(self) -> complex:
        """tr S / m."""
        return complex(np.trace(self.S) / len(self.S))

    @property
    def mean_slopes(self) -> Array:
        """tr S_j / m, shape (q,)."""
        return np.asarray(np.trace(self.slopes, axis1=1, axis2=2) / len(self.S))

    @property
    def square(self) -> complex:
        """((s₁₁ - s₂₂)/2)² + s₁₂ s₂₁ of a pair, (λ₁ - λ₂)²/4."""
        S = self._pair()
        return complex(((S[0, 0] - S[1, 1]) / 2) ** 2 + S[0, 1] * S[1, 0])

    @property
    def square_slopes(self) -> Array:
        """The derivatives of `square`, shape (q,)."""
        S, T = self._pair(), self.slopes
        return np.asarray((S[0, 0] - S[1, 1]) * (T[:, 0, 0] - T[:, 1, 1]) / 2 + T[:, 0, 1] * S[1, 0] + S[0, 1] * T[:, 1, 0])

    def at(self, *steps: float) -> Array:
        """The eigenvalues (m,) after a step of each parameter, of S + Σ_j δp_j S_j."""
        if len(steps) != len(self.slopes):
            raise InputError(f"give {len(self.slopes)} steps, one for each parameter, not {len(steps)}")
        return np.linalg.eigvals(self.S + np.tensordot(np.array([finite_number("a step", one) for one in steps]), self.slopes, 1))

    def _pair(self) -> Array:
        if len(self.S) != 2:
            raise InputError(f"{len(self.S)} eigenvalues meet: only a pair has a square of half its distance. Use S and slopes")
        return self.S


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Displayed):
    """Derivatives of k eigenvalues with respect to q parameters, made by `sensitivities`.

    Attributes
    ----------
    parameters, units : tuple of str
    values : ndarray, shape (q,)
        The present values of the parameters; NaN for a change that the model does not have yet, such as an added mass.
    eigenvalues : ndarray of complex, shape (k,)
        λ after the correction of the vectors.
    first : ndarray of complex, shape (k, q)
        ∂λ/∂p; NaN where λ is not differentiable.
    error_bar : ndarray, shape (k, q)
        Bound of the error of `first` to first order, from residuals and rounding.
    second : ndarray of complex, shape (k, q, q)
        ∂²λ/∂p_i∂p_j; NaN where `first` is NaN, or if second derivatives were not computed.
    differentiable : ndarray of bool, shape (k,)
        False for rigid motion at λ = 0, and where eigenvalues meet.
    meetings : tuple of MetPair
        The eigenvalues that meet.

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.02)
    >>> found = fs.sensitivities(sub, belt, fs.complex_modes(sub, belt, count=4), ["slope"])
    >>> print(found)
    Sensitivities: 4 eigenvalues over slope; Re λ changes most with slope, by -0.0582 per unit
    """

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    eigenvalues: Array
    first: Array
    error_bar: Array
    second: Array
    differentiable: Array
    meetings: tuple[MetPair, ...]

    @property
    def growth(self) -> Array:
        """∂Re λ/∂p, shape (k, q)."""
        return self.first.real

    @property
    def frequency(self) -> Array:
        """∂|Im λ|/∂p, shape (k, q)."""
        return np.where(self.eigenvalues.imag < 0, -1.0, 1.0)[:, None] * self.first.imag

    @property
    def relative(self) -> Array:
        """p ∂λ/∂p, shape (k, q): the change of λ by the whole of p, to first order. NaN where p has no value."""
        return np.asarray(self.first * self.values)

    def at(self, *steps: float) -> Array:
        """λ + Σ λ_j δp_j + Σ λ_jk δp_j δp_k / 2 after a step of each parameter, shape (k,); NaN where that is not known."""
        if len(steps) != len(self.parameters):
            raise InputError(f"give {len(self.parameters)} steps, one for each parameter, not {len(steps)}")
        d = np.array([finite_number("a step", one) for one in steps])
        return np.asarray(self.eigenvalues + self.first @ d + (self.second @ d) @ d / 2)

    def tables(self) -> list[Table]:
        """A row for each eigenvalue and parameter."""
        rows = [{"omega": float(value.imag), "growth": float(value.real), "parameter": name,
                 "growth_slope": float(self.first[i, j].real), "frequency_slope": float(self.first[i, j].imag),
                 "error_bar": float(self.error_bar[i, j])}
                for i, value in enumerate(self.eigenvalues) for j, name in enumerate(self.parameters)]
        columns = ["omega", column("growth", form=".5g"), column("parameter", form="s"),
                   column("growth_slope", "∂Re λ/∂p", ".5g"), column("frequency_slope", "∂Im λ/∂p", ".5g"), "error_bar"]
        return [Table("sensitivities", rows, columns, "Derivatives of eigenvalues", keys=2)] if rows else []

    def chart(self, title: str = "Change of Re λ by the whole of each parameter, to first order", most: int = 4) -> Chart:
        """A bar with its error for each parameter, by size, of the `most` eigenvalues with the largest Re λ."""
        return sensitivities_chart(self, title, most)

    def __repr__(self) -> str:
        met = int((~self.differentiable).sum())
        beside = f", {met} of them not differentiable" if met else ""
        growth = np.abs(np.nan_to_num(self.growth))
        k, j = np.unravel_index(int(growth.argmax()), growth.shape) if growth.size else (0, 0)
        most = f"; Re λ changes most with {self.parameters[j]}, by {self.growth[k, j]:.3g} per unit" if growth.any() else ""
        return f"Sensitivities: {len(self.eigenvalues)} eigenvalues over {', '.join(self.parameters)}{beside}{most}"


class _Piece(NamedTuple):
    """θ(p) s^power UᵀAU, a part of P that depends on parameters, with the jet of θ; U = None: identity."""

    matrix: str
    U: Matrix | None
    A: Matrix
    jet: Jet

    def weight(self, s: complex, order: int = 0) -> complex:
        """The factor of A at s, or the derivative of this factor with respect to s."""
        if self.matrix == "H":
            return 1j * np.sign(np.imag(s)) * (order == 0)
        return complex({"M": (s * s, 2 * s), "D": (s, 1.0), "K": (1.0, 0.0)}[self.matrix][order])

    def moved(self, x: Array) -> Array:
        return x if self.U is None else self.U @ x

    def back(self, f: Array) -> Array:
        return f if self.U is None else self.U.T @ f


class _Parameters(NamedTuple):
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    pieces: list[_Piece]


def sensitivities(model: Substructure | Affine, contacts: Contacts, modes: ComplexModes,
                  parameters: Sequence[str | Change], *, of: Sequence[int] | None = None,
                  at: Mapping[str, float] | None = None, second: bool | None = None,
                  together: float = 1e-6) -> Sensitivities:
    """Derivatives of the eigenvalues of complex modes with respect to parameters, with error bars and second derivatives.

    ∂λ/∂p = -yᴴ(λ²∂M/∂p + λ∂D/∂p + ∂K/∂p)x / yᴴ(2λM + D)x with left and right vectors y and x, (n,).

    Left vectors are computed by inverse iteration with one factor for each λ, which corrects λ and x as well. No parameter is
    differentiated by differences. One exception: a factor that takes no `Jet`, such as a function of `math`.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced. For a reduced model, the derivatives are those of the small model.
    contacts : Belt, FrictionContact or another contact, or a sequence of them
        With the parameter values at which derivatives are computed; None for an `Affine`.
    modes : ComplexModes
        Of this model with these contacts.
    parameters : sequence of str or changes
        A str is a field of the contacts, such as 'mu', in all that have it, or a parameter of an `Affine`. The contact must
        declare how it depends on the field, as for `family_of`. A change is an `AddedMass`, `AddedSpring`, `AddedDamper`,
        `MaterialChange` or `JointChange`, whatever its amount; a `Spring` stands for its share, as a `JointChange`.
    of : sequence of int, optional
        Only these modes; default: all.
    at : mapping of str to float
        The values of all parameters of an `Affine`.
    second : bool, optional
        Whether second derivatives are computed. Default: only for dense models. They take a complex factor for each λ. Without
        them, a symmetric factor corrects the approximate left vector in `modes` of a sparse model.
    together : float
        Eigenvalues meet if their distance is below this share of |λ|, or below eight times the error of one of them.

    Returns
    -------
    Sensitivities

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, a contact that does not declare it or has a kink there, modes of another model.

    Notes
    -----
    For SciPy's optimisers, use `growth` of the mode that must decay as the gradient. The largest Re λ of several modes has a
    kink where two are equal.

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.02)
    >>> modes = fs.complex_modes(sub, belt, count=4)
    >>> found = fs.sensitivities(sub, belt, modes, ["slope", fs.AddedMass([9])], of=[0])
    >>> found.growth.round(4).tolist(), found.frequency.round(4).tolist()
    ([[-0.0083, 0.0]], [[0.0, -0.0142]])
    """
    instance("modes", modes, ComplexModes)
    positive_number("together", together)
    pencil, known = _varied(model, contacts, parameters, at)
    if len(modes.shapes) != pencil.size:
        raise InputError(f"the modes have {len(modes.shapes)} DOF, but the model has {pencil.size}: are they of another model?")
    chosen = np.arange(len(modes)) if of is None else whole_numbers("of", of)
    if len(chosen) and not 0 <= chosen.min() <= chosen.max() < len(modes):
        raise InputError(f"of must name modes from 0 to {len(modes) - 1}")
    values, k, q = modes.eigenvalues, len(chosen), len(known.names)
    lam, first, bar = values[chosen].astype(complex), np.full((k, q), np.nan + 0j), np.full((k, q), np.nan)
    curves, plain, meetings = np.full((k, q, q), np.nan + 0j), np.ones(k, dtype=bool), {}
    second_too = not pencil.is_sparse if second is None else truth("second", second)
    sizes = _Sizes(*pencil.sizes)

    def solved(mode: int) -> _Simple | None:
        quick = _light(pencil, sizes, known, modes, mode) if pencil.is_sparse and not second_too else None
        return quick or _simple(pencil, sizes, known, values[mode], modes.shapes[:, mode])

    every = np.append(values, values[~np.isin(values.conj(), values)].conj())
    for row, mode in enumerate(chosen.tolist()):
        twin = next((one for one in range(row) if plain[one] and values[mode].imag
                     and values[chosen[one]] == values[mode].conj()), None)
        if twin is not None:  # the conjugate of a mode that is done
            lam[row], first[row], bar[row], curves[row] = lam[twin].conj(), first[twin].conj(), bar[twin], curves[twin].conj()
            continue
        near = np.abs(every - values[mode])
        reach = max(together * abs(values[mode]), 8 * modes.error_bar[mode])
        if np.isfinite(reach) and not modes.rigid[mode] and np.count_nonzero(near <= reach) == 1 and \
                (found := solved(mode)) is not None \
                and 8 * found.off < np.sort(near)[1:2].min(initial=np.inf):
            lam[row], first[row], bar[row], curves[row] = found[:4]
            continue
        plain[row] = False
        if modes.rigid[mode]:
            continue
        members = np.flatnonzero(np.abs(values - values[mode]) <= reach) if np.isfinite(reach) else \
            np.argsort(np.abs(values - values[mode]))[:2]
        key = tuple(sorted({mode, *members.tolist()}))
        if key not in meetings:
            meetings[key] = _meeting(pencil, known, key, modes)
    return Sensitivities(known.names, known.units, known.values, lam, first, bar, curves, plain,
                         tuple(one for one in meetings.values() if one is not None))


def _varied(model: Any, contacts: Contacts, parameters: Any, at: Mapping[str, float] | None) -> tuple[Pencil, _Parameters]:
    """The pencil, and the parts of it that depend on the parameters, with their jets."""
    given = items("parameters", [parameters] if isinstance(parameters, str) else parameters, "names or changes")
    named = [word("each of parameters", one) for one in given if isinstance(one, str)]
    if not given:
        raise InputError("parameters is empty: name a field of a contact, or give a change")
    if len(set(named)) < len(named):
        raise InputError("parameters names one of them twice")
    if isinstance(model, Affine):
        if contacts is not None:
            raise InputError("an Affine has no ports for contacts. Put them into its matrices, or use a Substructure")
        given_at = mapping("at", {} if at is None else at, "names and values")
        values = {key: finite_number(key, one) for key, one in given_at.items()}
        family, pencil = model, model.at(**values)
        if len(named) < len(given):
            raise InputError("an Affine has no nodes for changes: its parameters are the names of its factors")
    else:
        if at is not None:
            raise InputError("at is for the parameters of an Affine; contacts have their values")
        instance("model", model, Substructure, "or an Affine")
        pencil = pencil_of(model, contacts)
        values, family = _now(contacts, named), None
        if named:
            # of one sign, since a contact may refuse others; the fit over them is exact
            ranges = {name: (min(value / 2, 2 * value), max(value / 2, 2 * value)) if value else (0.0, 1.0)
                      for name, value in values.items()}
            # no copy of the model if possible: contacts store their matrices by the model's DOF
            viscous = model if model.H is None else model.with_structural_damping(None)
            family = family_of(viscous, contacts, named, ranges)
    q, pieces = len(given), []
    order = {one: j for j, one in enumerate(given) if isinstance(one, str)}
    if family is not None:
        if unknown := [name for name in named if name not in family.parameters]:
            raise unknown_name("parameter", unknown[0], family.parameters)
        place = np.array([order.get(name, q) for name in family.parameters], dtype=int)
        terms = [(key, A) for key in "MDK" for _, A in getattr(family, key)]
        for (key, A), own in zip(terms, family.jets(**{name: values[name] for name in family.parameters}), strict=True):
            if own.first.any() or own.second.any():
                wide, curve = np.zeros(q + 1), np.zeros((q + 1, q + 1))
                wide[place], curve[np.ix_(place, place)] = own.first, own.second
                pieces.append(_Piece(key, None, A, Jet(own.value, wide[:q], curve[:q, :q])))
    changes = dict(zip([j for j, one in enumerate(given) if not isinstance(one, str)],
                       as_changes("parameters", [one for one in given if not isinstance(one, str)]), strict=True))
    for j, change in changes.items():
        for key, U, A, factor in change.terms(model):
            pieces.append(_Piece(key, U, A, factor(Jet.of(0.0, j, q))))
    names = tuple(changes[j].name if j in changes else one for j, one in enumerate(given))
    units = tuple(changes[j].unit if j in changes else "" for j in range(q))
    numbers = np.array([changes[j].value if j in changes else values[one] for j, one in enumerate(given)], dtype=float)
    return pencil, _Parameters(names, units, numbers, pieces)


def _now(contacts: Contacts, named: Sequence[str]) -> dict[str, float]:
    """The values of fields of contacts. A field must have the same value in all contacts that have it."""
    known = contacts_of(contacts)
    found = {}
    for name in named:
        owners = [one for one in known if name in fields_of(one)]
        if not owners:
            raise unknown_name("parameter", name, sorted({field for one in known for field in fields_of(one)}))
        values = {finite_number(f"{name} of {type(one).__name__}", getattr(one, name)) for one in owners}
        if len(values) > 1:
            raise InputError(f"the contacts have different values of {name}: {', '.join(f'{one:g}' for one in sorted(values))}. "
                             "A parameter changes in all that have it")
        found[name] = values.pop()
        if any(found[name] in kinks_of(one, name) for one in owners):
            raise InputError(f"a contact has a kink at {name} = {found[name]:g}: there is no derivative")
    return found


class _Simple(NamedTuple):
    """λ, its derivatives (q,) with their bars (q,), second derivatives (q, q), and the error of λ."""

    value: complex
    first: Array
    bar: Array
    second: Array
    off: float


class _Work(NamedTuple):
    """For one eigenpair: P_j x and P_jᴴy, (n, q), or their products YᴴP_j x and XᴴP_jᴴy with some vectors; yᴴP_j x, yᴴP'_j x, the
    rounding in the former, yᴴP_jk x, and ‖P_j x‖₁ and ‖P_jᴴy‖₁.
    """

    pushed: Array
    pulled: Array
    work: Array
    turned: Array
    size: Array
    curves: Array
    sums: Array

    @classmethod
    def of(cls, known: _Parameters, value: complex, x: Array, y: Array, onto: tuple[Array, Array] | None = None) -> _Work:
        q = len(known.names)
        F, L = np.zeros((2, len(x) if onto is None else onto[0].shape[1], q), dtype=complex)
        work, turned = np.zeros((2, q), dtype=complex)
        size, sums, curves = np.zeros(q), np.zeros((2, q)), np.zeros((q, q), dtype=complex)
        several = np.column_stack([x, y] if onto is None else [x, y, *onto])
        r = 0 if onto is None else onto[0].shape[1]
        for piece, (motions, ones) in zip(known.pieces, _motions(known.pieces, several), strict=True):
            there, here = motions[:, 0], motions[:, 1]
            f, g, weight = piece.A @ there, piece.A.T @ here, piece.weight(value)
            product = np.vdot(here, f)
            rounding = abs(weight) * float(np.abs(here) @ (abs(piece.A) @ np.abs(there)))
            pushed, pulled = (piece.back(f), piece.back(g)) if onto is None else \
                (motions[:, 2:2 + r].conj().T @ f, motions[:, 2 + r:].conj().T @ g)
            lengths = abs(weight) * np.array([np.sum(ones * np.abs(f)), np.sum(ones * np.abs(g))])
            for j in np.flatnonzero(piece.jet.first):
                theta = piece.jet.first[j]
                sums[:, j] += abs(theta) * lengths
                F[:, j] += theta * weight * pushed
                L[:, j] += theta * np.conj(weight) * pulled
                work[j] += theta * weight * product
                turned[j] += theta * piece.weight(value, 1) * product
                size[j] += abs(theta) * rounding
            if piece.jet.second.any():
                curves += piece.jet.second * weight * product
        return cls(F, L, work, turned, size, curves, sums)


def _motions(pieces: list[_Piece], X: Array) -> Iterator[tuple[Array, Array | float]]:
    """UX of each piece, X (n, k), and the row sums of |U|. All pieces with a sparse U are computed at once."""
    few = [piece.U for piece in pieces if sp.issparse(piece.U)]
    whole = sp.csr_array(sp.vstack(few)) if few else X[:0].T
    moved, sums, start = whole @ X if few else X[:0], np.asarray(abs(whole).sum(axis=1)), 0
    for piece in pieces:
        if piece.U is None or not sp.issparse(piece.U):
            yield piece.moved(X), 1.0 if piece.U is None else np.abs(piece.U).sum(axis=1)
        else:
            part = slice(start, start := start + piece.U.shape[0])
            yield moved[part], sums[part]


class _Sizes(NamedTuple):
    """`Pencil.sizes`, for the rounding in products with P, entry by entry."""

    M: Matrix
    D: Matrix
    K: Matrix

    def doubts(self, P: Matrix, turned: Matrix, value: complex, x: Array, y: Array, left: Array) -> tuple[Array, Array]:
        """Errors of Px and of Pᴴy entry by entry, (n,) each: twice the residual, and the rounding in it, as in `bars`.

        `turned` is Pᵀ. `left` is P'ᴴy, the direction of an error of λ in Pᴴy.
        """
        s, found = abs(value), []
        back = (turned @ y.conj()).conj()
        for r, v, (M, D, K) in ((P @ x, x, self), (back - left * (np.vdot(x, back) / np.vdot(x, left)), y,
                                                   (A.T for A in self))):
            size = np.abs(v)
            found.append(2 * np.abs(r) + 4 * EPS * (s * s * (M @ size) + s * (D @ size) + K @ size))
        return found[0], found[1]

    def rates(self, value: complex, x: Array, y: Array) -> float:
        """The sum of the absolute values of the terms of yᴴP'x."""
        return float(np.abs(y) @ (2 * abs(value) * (self.M @ np.abs(x)) + self.D @ np.abs(x)))


def _light(pencil: Pencil, sizes: _Sizes, known: _Parameters, modes: ComplexModes, k: int, nearest: int = 8) -> _Simple | None:
    """The derivatives of one λ of a sparse pencil by a symmetric factor from a rough left vector; None where it fails.

    The error bar sums up errors of the vectors in the directions of the `nearest` modes and their conjugates, with
    P⁻¹ ≈ Σ_i x_i y_iᴴ / ((λ - λ_i) y_iᴴP'x_i). It is doubled for all other modes. These may move DOF that the nearest modes do
    not move. So each entry of x and y also gets an error as large as the largest entry of that sum.
    """
    value, x = complex(modes.eigenvalues[k]), modes.shapes[:, k]
    if modes.left is None or not value.imag:
        return None
    lam, X, Y = modes.eigenvalues, modes.shapes, modes.left
    lacking = np.flatnonzero(~np.isin(lam.conj(), lam))
    every = np.append(lam, lam[lacking].conj())
    order = np.argsort(np.abs(every - lam[k]), kind="stable")[1:nearest + 1]
    at, mirrored = np.append(np.arange(len(lam)), lacking)[order], order >= len(lam)
    X, Y = (np.where(mirrored, part[:, at].conj(), part[:, at]) for part in (X, Y))
    P = pencil.at(value)
    turned = sp.csr_array(P.T)  # by rows: a product by columns would take longer
    image = (turned @ Y.conj()).conj()
    own, alike = slope(pencil, value, x), every[order].imag * value.imag > 0  # a light mode is nearly its own conjugate
    y = left_by_symmetric_factor(pencil, value, (P, turned), x, modes.left[:, k],
                                 (X[:, alike], Y[:, alike], image[:, alike]), _between(every, value.imag), along=own)
    if y is None:
        return None
    left = left_slope(pencil, value, y)
    rate = np.vdot(y, own)
    value, (of_x, of_y) = value - complex(np.vdot(y, P @ x) / rate), sizes.doubts(P, turned, value, x, y, left)
    found = _Work.of(known, value, x, y, (Y, X))
    first = -found.work / rate
    F, L = found.pushed + np.outer(Y.conj().T @ own, first), found.pulled + np.outer(X.conj().T @ left, first.conj())
    # (λ - λ_i) y_iᴴP'(λ_i)x_i = y_iᴴP(λ)x_i - (λ - λ_i)² y_iᴴMx_i
    apart = modes.eigenvalues[k] - every[order]
    rates = np.abs(np.einsum("ij,ij->j", image.conj(), X) - apart**2 * np.einsum("ij,ij->j", Y.conj(), pencil.M @ X))
    doubt = float(np.abs(y) @ of_x) / abs(rate)
    mass = np.vdot(y, pencil.M @ x)
    with np.errstate(divide="ignore", invalid="ignore"):
        in_x, in_y = np.abs(Y).T @ of_x / rates, np.abs(X).T @ of_y / rates
        spread = np.abs(L).T @ in_x + np.abs(F).T @ in_y
        spread += found.sums[0] * (np.abs(Y).max(axis=0) @ in_y) + found.sums[1] * (np.abs(X).max(axis=0) @ in_x)
    bar = (2 * spread + np.abs(found.turned + 2 * mass * first) * doubt
           + 4 * EPS * (found.size + np.abs(first) * sizes.rates(value, x, y))) / abs(rate)
    q = len(first)
    return _Simple(value, first, bar, np.full((q, q), np.nan + 0j), doubt) if np.isfinite(bar).all() else None


def _between(values: Array, omega: float) -> float:
    """The middle of the wider gap between an eigenfrequency and its two neighbours."""
    size = np.unique(np.abs(values.imag))
    gaps = [(abs(other - abs(omega)), other) for other in (*size[size < abs(omega)][-1:], *size[size > abs(omega)][:1])]
    return (max(gaps)[1] + abs(omega)) / 2 if gaps else abs(omega)


def _simple(pencil: Pencil, sizes: _Sizes, known: _Parameters, value: complex, x: Array, turns: int = 3) -> _Simple | None:
    """The derivatives of one λ; None if the iteration does not converge, as for a multiple λ."""
    start, y, real = value, x.conj(), np.imag(value) == 0
    with np.errstate(all="ignore"):
        for _ in range(turns):  # a new factor only if λ was poor
            solver = solver_near(pencil, value)
            if solver is None:
                return None
            for _ in range(2):  # the first left vector is a guess
                x, y = corrected(pencil, value, x, y, solver)
            rate = np.vdot(y, slope(pencil, value, x))
            off = np.vdot(y, pencil.residual(np.array([value]), x[:, None])[:, 0]) / rate
            value = value - (off.real if real else off)
            if not np.isfinite(value) or abs(value - start) > abs(start):
                return None
            if abs(off) <= EPS**0.75 * abs(value):  # the factor is as good as one at the new λ
                break
        P, own, left = pencil.at(value), slope(pencil, value, x), left_slope(pencil, value, y)
        rate = np.vdot(y, own)
        of_x, of_y = sizes.doubts(P, P.T, value, x, y, left)
        found = _Work.of(known, value, x, y)
        first = -found.work / rate
        F, L = found.pushed + np.outer(own, first), found.pulled + np.outer(left, first.conj())
        X, Y = (_bordered(P, solver, rhs, x, own, y, left, transposed) for rhs, transposed in ((F, False), (L, True)))
        mass = np.vdot(y, pencil.M @ x)
        mixed = L.conj().T @ X + np.outer(found.turned, first)
        second = -(found.curves + mixed + mixed.T + 2 * mass * np.outer(first, first)) / rate
        doubt = float(np.abs(y) @ of_x) / abs(rate)
        bar = (of_x @ np.abs(Y) + of_y @ np.abs(X) + np.abs(found.turned + 2 * mass * first) * doubt
               + 4 * EPS * (found.size + np.abs(first) * sizes.rates(value, x, y))) / abs(rate)
    if not np.isfinite(bar).all():
        return None
    if real:
        first, second = first.real + 0j, second.real + 0j
    return _Simple(complex(value), first, bar, second, doubt)


def _bordered(P: Matrix, solver: Any, rhs: Array, x: Array, own: Array, y: Array, left: Array, transposed: bool) -> Array:
    """The solution of P X = -rhs with yᴴP'X = 0, or of PᴴY = -rhs with YᴴP'x = 0, by a factor of P beside its λ.

    The factor amplifies only the part of a solution along x (or y), which is removed.
    """
    A = P.conj().T if transposed else P
    (null, out), (dual, into) = ((y, own), (x, left)) if transposed else ((x, left), (y, own))

    def solve(B: Array) -> Array:
        B = B - np.outer(into, dual.conj() @ B) / np.vdot(dual, into)
        X = solver.solve(B.conj(), transposed=True).conj() if transposed else solver.solve(B)
        return X - np.outer(null, out.conj() @ X) / np.vdot(out, null)

    X = solve(-rhs)
    return np.asarray(X + solve(-rhs - A @ X))


def _meeting(pencil: Pencil, known: _Parameters, members: tuple[int, ...], modes: ComplexModes, aside: float = 0.05,
             turns: int = 30) -> MetPair | None:
    """S and its derivatives by inverse iteration of a block on the companion form, from both sides; None if it fails."""
    lam, m = modes.eigenvalues[list(members)], max(len(members), 2)
    middle = complex(lam.mean())
    # beside them: at a defective pair P⁻¹ would see one shape only. Other eigenvalues are so far that each turn gains a digit
    apart = np.abs(np.append(modes.eigenvalues, modes.eigenvalues.conj()) - middle)
    reach = np.abs(lam - middle).max()
    gap = float(apart[apart > 2 * reach + EPS**0.25 * abs(middle)].min(initial=abs(middle)))
    centre = middle * (1 + aside * gap / abs(middle))
    unit = abs(centre)
    solver, sigma = solver_near(pencil, centre), centre / unit
    if solver is None:
        return None
    M, D, K = unit * unit * pencil.M, unit * pencil.D, pencil.at(centre) - centre * centre * pencil.M - centre * pencil.D
    n, shapes = pencil.size, modes.shapes[:, list(members)]
    own = lam / unit
    if len(members) == 1:  # the partner is not known
        random = np.random.default_rng(0).standard_normal((n, 1))
        shapes, own = np.hstack([shapes, random / np.linalg.norm(random)]), np.append(own, own)
    Z = np.vstack([shapes, shapes * own])
    W = np.random.default_rng(1).standard_normal((2 * n, m)) + 0j
    S, before, off, last = np.zeros((m, m)), np.zeros(m), np.inf, turns
    with np.errstate(all="ignore"):
        for turn in range(turns):
            a, b = Z[:n], M @ Z[n:]
            u = solver.solve(b + sigma * (M @ a) + D @ a)
            Z = np.linalg.qr(np.vstack([u, sigma * u - a]))[0] if np.isfinite(u).all() else Z * np.nan
            a, b = W[:n], M.T @ W[n:]
            w = solver.solve((a + np.conj(sigma) * b).conj(), transposed=True).conj()
            W = np.vstack([np.conj(sigma) * (M.T @ w) + D.T @ w - b, w])
            if not np.isfinite(Z).all() or not np.isfinite(W).all():
                return None
            W = np.linalg.qr(W)[0]
            X, XS, P, Q = Z[:n], Z[n:], W[:n], W[n:]
            N = P.conj().T @ X + Q.conj().T @ (M @ XS)
            S = np.linalg.solve(N, P.conj().T @ XS - Q.conj().T @ (K @ X + D @ XS))
            now = np.array([np.trace(np.linalg.matrix_power(S, power)) for power in range(1, m + 1)])
            off, before = float(np.abs(now - before).max()), now
            if off <= 64 * EPS * m:  # the shapes, and so S_j, have half as many digits by then
                last = min(last, 3 * turn + 1)
            if turn >= last:
                break
    slopes = np.zeros((len(known.names), m, m), dtype=complex)
    for piece in known.pieces:
        moved = {"M": unit * unit * (XS @ S), "D": unit * XS, "K": X, "H": 1j * np.sign(centre.imag) * X}[piece.matrix]
        push = Q.conj().T @ piece.back(piece.A @ piece.moved(moved))
        slopes -= np.multiply.outer(piece.jet.first, np.linalg.solve(N, push))
    rounding = EPS * np.linalg.cond(N) * float(np.linalg.norm(np.linalg.inv(N)))
    return MetPair(members, unit * S, unit * slopes, unit * (off + rounding))
