"""`Affine`: a pencil whose matrices are sums Σ θ_i(p) A_i with named parameters p. All of them may be unsymmetric."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from inspect import Parameter, signature
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.algebra import Frozen, Sum, as_matrix, weighted
from femsub.checks import (
    Array,
    FemsubError,
    InputError,
    InputTypeError,
    Matrix,
    finite_number,
    items,
    limit_of,
    shown,
    unknown_name,
)
from femsub.model.intervals import range_of
from femsub.model.jets import Jet, jet_of
from femsub.model.pencil import Pencil, basis_of, look_at_the_order, projected

Theta: TypeAlias = float | str | Callable[..., float]
Terms: TypeAlias = tuple[tuple[Theta, Matrix], ...]


@dataclass(frozen=True, eq=False, repr=False)
class Affine(Frozen):
    """A pencil with parameters: P(λ; p) = λ² Σ θ_i M_i + λ Σ θ_j D_j + Σ θ_k K_k with factors θ(p).

    Any of the matrices may be unsymmetric: gyroscopic and circulatory terms, friction, follower forces. A disc that turns in a
    fixed frame at Ω has D₁ + D_R/Ω + Ω D_G and K₁ + K_R + Ω² K_geo.

    Parameters
    ----------
    M, D, K : matrix (n, n), or sequence of (θ, matrix)
        Each matrix dense or sparse. θ is a number, the name of a parameter, or a function whose arguments are the names, as
        ``lambda speed: 1 / speed``. An argument with a default value is no parameter. A matrix alone has θ = 1. ``D=None`` means
        no damping. Use a function of a module instead of a lambda if the object is to be pickled, and NumPy's functions instead
        of `math` if its range is to be proved (`factor_ranges`).

    Attributes
    ----------
    parameters : tuple of str
        The names, in the order in which they first appear in M, D and K.
    cutoff : float
        Of matrices that were `reduced`: modes above this frequency are artefacts of the reduction. NaN if it is not known.

    Raises
    ------
    InputError, InputTypeError
        Matrices that are not square, of different sizes, complex, or with NaN; a θ of another kind.

    Examples
    --------
    >>> import femsub as fs
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], None, [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]])])
    >>> two_mode
    Affine: 2 DOF, dense, parameters mu
    >>> print(f"{fs.complex_modes(two_mode.at(mu=1.0)).growth:.6f}")
    0.202072
    """

    M: Terms
    D: Terms
    K: Terms
    cutoff: float = field(default=np.inf, init=False)

    def __init__(self, M: Any, D: Any, K: Any) -> None:
        parts = {name: _terms(name, value) for name, value in (("M", M), ("D", D), ("K", K))}
        if not parts["M"] or not parts["K"]:
            raise InputError("M and K need at least one matrix each")
        size = as_matrix("M", parts["M"][0][1]).shape[0]
        self._set(**{name: tuple((theta, as_matrix(name, A, size)) for theta, A in terms) for name, terms in parts.items()},
                  cutoff=np.inf)
        look_at_the_order(*([(theta, A) for theta, A in terms if not callable(theta) and not isinstance(theta, str)]
                            for terms in (self.M, self.D, self.K)))

    def __repr__(self) -> str:
        kind = "sparse" if all(sp.issparse(A) for _, A in self._all) else "dense"
        shown = f"parameters {', '.join(self.parameters)}" if self.parameters else "no parameters"
        return f"Affine: {self.size} DOF, {kind}, {shown}{limit_of(self.cutoff)}"

    @property
    def _all(self) -> Terms:
        return (*self.M, *self.D, *self.K)

    @property
    def size(self) -> int:
        return int(self.M[0][1].shape[0])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for theta, _ in self._all for name in _names(theta)))

    def affine_in(self, parameter: str) -> bool:
        """Whether D and K are affine in a parameter and M does not depend on it. A function of it counts as not affine."""
        return not any(parameter in _names(theta) for theta, _ in self.M) and \
            not any(callable(theta) and parameter in _names(theta) for theta, _ in self._all)

    def factors(self, **values: float) -> Array:
        """All θ at given values of all parameters, in the order M, D, K."""
        return np.array([_fixed(theta, values) for theta, _ in self._all], dtype=float)

    def jets(self, **values: float) -> list[Jet]:
        """All θ with their derivatives in the parameters, in the order of `factors` and of `parameters`."""
        self._check(values)
        self._check_all("value", values)
        places, count = {name: at for at, name in enumerate(self.parameters)}, len(self.parameters)
        found = []
        for theta, _ in self._all:
            own = {name: float(values[name]) for name in _names(theta)}
            if isinstance(theta, str):
                found.append(Jet.of(own[theta], places[theta], count))
            elif callable(theta):
                _fixed(theta, own)  # an error of the function is reported with its name
                found.append(jet_of(theta, own, places, count))
            else:
                found.append(jet_of(lambda value=theta: value, {}, places, count))
        return found

    def at(self, **values: float) -> Pencil:
        """The pencil at given values of all parameters.

        Raises
        ------
        InputError
            A parameter is missing or unknown, or a θ is not finite there.
        """
        self._check(values)
        self._check_all("value", values)
        return self.weighted(self.factors(**values))

    def weighted(self, factors: Array, by_slabs: bool = False) -> Pencil:
        """The pencil with these θ (q,), in the order of `factors`. `by_slabs` sums sparse matrices with little extra memory."""
        if by_slabs and all(sp.issparse(A) for terms in (self.M, self.D, self.K) for _, A in terms):
            sums = self.sums(factors, np.ones(self.M[0][1].shape[0]))
            return Pencil(*(one.formed() if one.terms else None for one in sums)).below(self.cutoff)
        factor = iter(factors)
        return Pencil(*(weighted([(next(factor), A) for _, A in terms]) if terms else None
                        for terms in (self.M, self.D, self.K))).below(self.cutoff)

    def sums(self, factors: Array, unit: Array) -> list[Sum]:
        """diag(u) A diag(u) for A = M, D and K with these θ, as sums that are not formed."""
        factor = iter(factors)
        return [Sum([(next(factor), A) for _, A in terms], unit) for terms in (self.M, self.D, self.K)]

    def fixed(self, **values: float) -> Affine:
        """The `Affine` with values for some of the parameters: a function of the other parameters only."""
        self._check(values)
        return self._each(lambda theta, A: (_fixed(theta, values), A))

    def _check(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            if name not in self.parameters:
                raise unknown_name("parameter", name, self.parameters)
            finite_number(name, value)

    def _check_all(self, what: str, given: Mapping[str, Any]) -> None:
        if rest := [name for name in self.parameters if name not in given]:
            raise InputError(f"no {what} is given for {', '.join(rest)}. Give all of {', '.join(self.parameters)}")

    def factor_ranges(self, ranges: Mapping[str, tuple[float, float]]) -> tuple[Array, Array, Array]:
        """(lo, hi, proved): lo ≤ θ(p) ≤ hi for all p in a box of all parameters; shapes (q,), in the order M, D, K of `factors`.

        Bounds of numbers and names are exact. A function is evaluated with `Interval`, rounded outwards: its bounds are proved,
        and infinite if there may be a pole in the box. A function that cannot take an `Interval`, such as a table, a branch or a
        function of `math`, is sampled: then `proved` is False.

        Raises
        ------
        InputError, InputTypeError
            A parameter without a range or unknown; lo > hi; a function that is sampled has no value in the box.

        Examples
        --------
        >>> import femsub as fs
        >>> family = fs.Affine([[1]], [(lambda speed: 1 / speed, [[2]])], [(1.0, [[3]]), ("mu", [[1]])])
        >>> lo, hi, proved = family.factor_ranges({"speed": (2, 4), "mu": (0, 0.5)})
        >>> print(lo.round(3), hi.round(3), proved)
        [1.   0.25 1.   0.  ] [1.  0.5 1.  0.5] [ True  True  True  True]
        """
        for name, ends in ranges.items():
            what = f"the range of {name}"
            bounds = [finite_number(f"an end of {what}", end) for end in items(what, ends, "two numbers (lo, hi)")]
            self._check({name: bounds[0] if bounds else np.nan})
            if len(bounds) != 2 or bounds[0] > bounds[1]:
                raise InputError(f"{what} must be (lo, hi) with lo ≤ hi, not {shown(ends)}")
        self._check_all("range", ranges)
        found: list[tuple[Any, Any, bool]] = []
        for theta, _ in self._all:
            box = {name: (float(ranges[name][0]), float(ranges[name][1])) for name in _names(theta)}
            if callable(theta) and box:
                found.append(range_of(theta, box, partial(_fixed, theta)))
            else:
                found.append((*box[theta], True) if isinstance(theta, str) else (_fixed(theta, {}), _fixed(theta, {}), True))
        lo, hi, proved = zip(*found, strict=True)
        return np.array(lo), np.array(hi), np.array(proved)

    def deviation(self, ranges: Mapping[str, tuple[float, float]], centre: Mapping[str, float]) -> tuple[Array, Array]:
        """(bound, proved): |θ(p) - θ(p_c)| ≤ bound for all p in a box of all parameters; shapes (q,), see `factor_ranges`.

        `centre` contains the values p_c of all parameters.
        """
        (lo, hi, proved), at = self.factor_ranges(ranges), self.factors(**centre)
        most = np.maximum(hi - at, at - lo)
        return np.where(most > 0, np.nextafter(most, np.inf), 0.0), proved

    def below(self, cutoff: float) -> Affine:
        """A copy with this cut-off, above which modes are artefacts of a reduction."""
        return self._with(cutoff=float(cutoff))

    def reduced(self, basis: Any, cutoff: float | None = None) -> Affine:
        """The `Affine` with the matrices VᵀA_iV (r, r), on the basis V (n, r) of a reduced model, and with the model's cut-off.

        Parameters
        ----------
        basis : ReducedSubstructure, or array_like of shape (n, r)
            `reduce` a `Substructure` with the symmetric part of K to get one. An array V has no known cut-off: then no band is
            refused, and all analyses are 'not checked'.
        cutoff : float, optional
            Replaces the cut-off of the model: the lowest frequency of the modes that V leaves out, inf if it leaves out none.

        Raises
        ------
        InputError
            V does not have n rows.

        Examples
        --------
        >>> import femsub as fs
        >>> M, K, friction = np.eye(4), fs.chain(4).K.toarray(), np.eye(4, k=1)
        >>> family = fs.Affine(M, None, [(1.0, K), ("mu", friction)])
        >>> rom = fs.reduce(fs.Substructure(M, K, interface=[0]), fs.CraigBampton(modes=1))
        >>> family.reduced(rom)
        Affine: 2 DOF, dense, parameters mu, cut-off 1.414 rad/time
        """
        V, limit = basis_of(basis, self.size, cutoff)
        return self._each(lambda theta, A: (theta, projected(A, V))).below(float(np.minimum(limit, self.cutoff)))

    def _each(self, change: Callable[[Theta, Matrix], tuple[Theta, Matrix]]) -> Affine:
        return self._with(**{name: tuple(change(*term) for term in getattr(self, name)) for name in "MDK"})


def _terms(name: str, value: Any) -> list[tuple[Theta, Any]]:
    """Pairs (θ, matrix); a matrix given alone has θ = 1."""
    if value is None:
        return []
    pairs = isinstance(value, (list, tuple)) and all(isinstance(pair, (list, tuple)) and len(pair) == 2 and _is_matrix(pair[1])
                                                     for pair in value)
    found: list[tuple[Theta, Any]] = [(pair[0], pair[1]) for pair in value] if pairs else [(1.0, value)]
    for theta, _ in found:
        if isinstance(theta, str):
            if not theta.isidentifier():
                raise InputError(f"{theta!r} in {name} is no name of a parameter. Give a name such as 'mu', or a function of it")
        elif callable(theta):
            _names(theta)
        else:
            finite_number(f"the factor of a matrix in {name}", theta)
    return found


def _is_matrix(value: Any) -> bool:
    try:
        return sp.issparse(value) or np.ndim(value) == 2
    except ValueError:  # ragged
        return False


@lru_cache(maxsize=1000)
def _names(theta: Theta) -> list[str]:
    """The parameters of a factor."""
    if isinstance(theta, str):
        return [theta]
    if not callable(theta):
        return []
    try:
        arguments = signature(theta).parameters.values()
    except (TypeError, ValueError):
        raise InputTypeError(f"the arguments of the factor {shown(theta)} are unknown. Give a Python function") from None
    if any(one.kind in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD, Parameter.POSITIONAL_ONLY) for one in arguments):
        raise InputTypeError(f"the factor {shown(theta)} must name its arguments, as lambda speed: 1 / speed")
    return [one.name for one in arguments if one.default is Parameter.empty]


def _fixed(theta: Theta, values: Mapping[str, float]) -> Theta:
    """A factor with values for some of its parameters: a number once all have a value."""
    known = {name: float(values[name]) for name in _names(theta) if name in values}
    if not callable(theta):
        return known.get(theta, theta) if isinstance(theta, str) else theta
    if len(known) < len(_names(theta)):
        return partial(theta, **known) if known else theta
    # the values may have been given in two steps (`fixed`)
    whole = {**theta.keywords, **known} if isinstance(theta, partial) else known
    function = theta.func if isinstance(theta, partial) else theta
    what = f"the factor {getattr(function, '__name__', type(function).__name__)}({', '.join(whole)})"
    shown = f" at {', '.join(f'{name} = {value:g}' for name, value in whole.items())}" if whole else ""
    try:
        found = theta(**known)
    except FemsubError:
        raise
    except Exception as error:
        raise InputError(f"{what} cannot be computed{shown}: {type(error).__name__}: {error}") from error
    return finite_number(f"{what}{shown}", found)
