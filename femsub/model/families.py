"""`family_of`: a model with contacts and changes as an `Affine` over their parameters, and the check of contacts' declarations.

A contact declares in `affine` and `affine_through` that its C_D and C_K are affine in each parameter p_i, or in functions f(p_i),
with all other parameters fixed. So C_D and C_K are sums Σ c_S Π f(p_i) over sets S of parameters. The values of C at the corners
of a box determine all c_S, and each c_S gives one matrix W c_S Wᵀ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from inspect import Parameter, Signature
from itertools import product
from operator import mul
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.algebra import as_matrix, without_rounding
from femsub.checks import EPS, EQUAL, Array, InputError, Matrix, instance, interval, items, mapping, unknown_name, word
from femsub.model.affine import Affine, Theta
from femsub.model.changes import as_changes
from femsub.model.contact import Contacts, affine_functions, columns_of, contacts_of, fields_of, small_matrices
from femsub.model.jets import Jet
from femsub.model.pencil import contact_matrix
from femsub.model.substructure import Substructure

Function: TypeAlias = Callable[[Any], Any] | None  # a function of one parameter; None is the parameter itself
Key: TypeAlias = tuple[tuple[str, Function], ...]  # factors of a product

SAMPLES = (0.0, 0.19, 0.5, 0.77, 1.0)  # places in the range where a declaration is checked
IRREGULAR = (5**0.5 - 1) / 2  # place of the other parameters in their ranges: regular places would miss a periodic dependence
DUST = 512 * EPS  # share of the largest entry of C: smaller entries are the rounding of terms that cancel
COLUMNS_ALONE = 8  # up to this many columns of a contact each entry of C is checked; above, this many random combinations


@dataclass(frozen=True)
class Product:
    """θ(p) = Π f_i(p_i), a factor of an `Affine`. If f_i is None, it is the parameter p_i itself."""

    factors: Key

    @property
    def __name__(self) -> str:
        return " * ".join(name if function is None else f"{getattr(function, '__name__', 'f')}({name})"
                          for name, function in self.factors)

    @property
    def __signature__(self) -> Signature:
        return Signature([Parameter(name, Parameter.KEYWORD_ONLY) for name, _ in self.factors])

    def __call__(self, **values: Any) -> Any:
        return reduce(mul, (values[name] if function is None else function(values[name]) for name, function in self.factors))


def theta_of(key: Key) -> Theta:
    """The factor of an `Affine` for a product: a number, a name or a `Product`."""
    return 1.0 if not key else key[0][0] if len(key) == 1 and key[0][1] is None else Product(key)


@dataclass(frozen=True)
class _From:
    """θ(p - p_0): the factor of a change whose parameter has the present value p_0."""

    factor: Callable[[Any], Any]
    start: float

    def __call__(self, p: Any) -> Any:
        return self.factor(p - self.start)

    @property
    def __name__(self) -> str:
        return f"change from {self.start:g} to "


def family_of(model: Substructure | Affine, contacts: Contacts, parameters: Sequence[str],
              ranges: Mapping[str, tuple[float, float]], changes: Mapping[str, Any] | None = None, apart: bool = False) -> Affine:
    """A model with contacts over parameters p as an `Affine`: M, D + Σ θ_S(p) W c_S Wᵀ and K + Σ θ_S(p) W c_S Wᵀ.

    A parameter of `changes` adds θ(p) UᵀAU to M, D and K, see `Change`. The result can be used wherever an `Affine` is accepted:
    `reduce` over a `ParameterBox`, `scatter`, `stability_map`, `critical_value`, `track`.

    Parameters
    ----------
    model : Substructure or Affine
        An `Affine` must have exactly these parameters, accepts no contacts or changes, and is returned as it is.
    contacts : contact or sequence of contacts
        A parameter changes in all contacts that have it. Contacts without any of the parameters stay as they are.
    parameters : sequence of str
        Fields of the contacts, and names in `changes`.
    ranges : mapping of str to (lo, hi)
        The range of each parameter. The contacts' matrices are computed at a few values in it, which also check the declarations.
    changes : mapping of str to a change, or a sequence of them, optional
        Parameters that are not fields of contacts, each with its changes: a constant of a material (`MaterialChange`), a mass,
        a spring or a dashpot (`AddedMass`, ...), a joint (`JointChange`). The value of the parameter is the constant itself,
        such as E in Pa, or the total that is added. The amounts of the changes are ignored. A reduced model keeps its basis.
    apart : bool
        Whether the constant terms of the changing contacts are matrices of their own, beside D and K of the model. For a large
        model their sum would take as much memory as D and K.

    Returns
    -------
    Affine
        Its factors are products of parameters, or of the functions of them that contacts declare. Terms with the same factor are
        summed to one matrix, and so are the constant terms, unless `apart`. A parameter without effect has a matrix of zeros in
        K. The cut-off is the model's.

    Raises
    ------
    InputError, InputTypeError
        A parameter that no contact has, or that a contact has without declaring itself affine in it; a declaration that samples
        contradict; a range without lo < hi, or with values that a constant cannot have; structural damping; changes of one
        parameter that start from different values.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.family_of(fs.chain(3, belt=1), fs.Belt(slope=-0.1), ["force", "slope"], {"force": (1, 2), "slope": (-0.3, 0)})
    Affine: 3 DOF, sparse, parameters force, slope
    >>> ranges = {"slope": (-0.3, 0), "tuned": (0, 1)}
    >>> fs.family_of(fs.chain(3, belt=1), fs.Belt(slope=-0.1), ["slope", "tuned"], ranges, {"tuned": fs.AddedMass([2])})
    Affine: 3 DOF, sparse, parameters tuned, slope
    """
    names = [word("each of parameters", name) for name in items("parameters", parameters, "names")]
    instance("apart", apart, bool)
    if isinstance(model, Affine):
        if contacts is not None or changes:
            raise InputError("an Affine has no ports for contacts and no nodes for changes. Put them into its matrices, or use "
                             "a Substructure")
        if unknown := [name for name in names if name not in model.parameters]:
            raise unknown_name("parameter", unknown[0], model.parameters)
        if rest := [name for name in model.parameters if name not in names]:
            raise InputError(f"{', '.join(rest)} must have values: give model.fixed({rest[0]}=...) instead of the model")
        return model
    instance("model", model, Substructure, "or an Affine").viscous_only("a model over parameters")
    given: Sequence[Any] = contacts_of(contacts)
    known = [fields_of(contact) for contact in given]
    changed = {} if changes is None else mapping("changes", changes, "names of parameters and lists of changes")
    for name in changed:
        word("each of changes", name)
    fields = set().union(*known)
    if unknown := [name for name in names if name not in fields and name not in changed]:
        raise unknown_name("parameter", unknown[0], sorted(fields | set(changed)))
    if both := sorted(fields & set(changed)):
        raise InputError(f"{both[0]!r} is a field of a contact. Give its change another name")
    if idle := [name for name in changed if name not in names]:
        raise unknown_name("change", idle[0], names)
    mapping("ranges", ranges, "names and pairs (lo, hi)")
    if missing := [name for name in names if name not in ranges]:
        raise InputError(f"no range is given for {', '.join(missing)}. Give all of {', '.join(names)}")
    box = {name: interval(f"the range of {name}", ranges[name]) for name in names}
    model.refuse_empty(model.D, *(columns_of(model, contact) for contact in given))

    own = [{name: ends for name, ends in box.items() if name in fields} for fields in known]
    constant = model.linearised([contact for contact, changing in zip(given, own, strict=True) if not changing])
    first = None if apart and not changed else ()
    sums: tuple[dict[Any, Matrix], ...] = {first: constant.D}, {first: constant.K}
    for contact, changing in zip(given, own, strict=True):
        if changing:
            for into, found in zip(sums, _terms_of(model, contact, changing), strict=True):
                for key, A in found.items():
                    into[key] = into[key] + A if key in into else A
    D, K = ([(theta_of(key or ()), A) for key, A in terms.items() if np.any(A.data if sp.issparse(A) else A)] for terms in sums)
    family = Affine(constant.M, D, K)
    if changed:
        sums = tuple(dict(getattr(family, name)) for name in "MDK")
        for name, several in changed.items():
            for matrix, theta, A in _changing(model, name, several, box[name]):
                into = sums["MDK".index(matrix)]
                into[theta] = into[theta] + A if theta in into else as_matrix(matrix, A)
        # not by the constructor, whose check of the order of D and K fails if the constant terms have no stiffness left
        family = family._with(**{name: tuple(terms.items()) for name, terms in zip("MDK", sums, strict=True)})
    without = [(name, constant.K - constant.K) for name in names if name not in family.parameters]
    return family._with(K=(*family.K, *without)).below(model.cutoff)


def _changing(model: Substructure, name: str, several: Any, between: tuple[float, float]) -> Iterator[tuple[str, Theta, Matrix]]:
    """Yields the name of the matrix, the factor θ and UᵀAU for each term of the changes of a parameter."""
    given = as_changes(f"the changes of {name}", several if isinstance(several, (list, tuple)) else [several])
    if not given:
        raise InputError(f"the parameter {name} has no changes")
    starts = [0.0 if np.isnan(one.value) else one.value for one in given]
    if max(starts) != min(starts):
        raise InputError(f"the changes of {name} start from different values, {min(starts):g} to {max(starts):g}: give each a "
                         "parameter of its own")
    for change, start in zip(given, starts, strict=True):
        for end in between:
            change.allowed(end - start)
        for matrix, U, A, factor in change.terms(model):
            if matrix == "H":
                raise InputError(f"{change.name} changes the structural damping, which a model over parameters cannot have")
            whole = U.T @ ((sp.csr_array(A) if sp.issparse(U) else A) @ U)
            if matrix != "D":
                whole = (whole + whole.T) / 2
            jets = [factor(Jet.of(p - start, 0, 1)) for p in (*between, start)]
            if not any(jet.second.any() for jet in jets):  # θ is linear, as for E and ρ: the parameter itself is the factor
                slope = float(jets[-1].first[0])
                yield matrix, name, slope * whole
                if start:
                    yield matrix, 1.0, -start * slope * whole
            else:
                yield matrix, theta_of(((name, _From(factor, start)),)), whole


def check_affine(owner: str, parameter: str, functions: Sequence[Function], at: Callable[[float], tuple[Array, ...]],
                 between: tuple[float, float]) -> None:
    """Raises an error if coefficients are not affine in these functions of the parameter, as `owner` declares.

    `at(p)` returns the coefficients at the value p, in blocks; all coefficients of a block have the same unit.
    """
    lo, hi = between
    places = [lo + share * (hi - lo) for share in SAMPLES]
    found, nodes = [at(p) for p in places], _nodes(functions)[1:]
    moved = _basis(owner, parameter, functions, places)[:, 1:]
    moved = moved - moved[0]
    weights = moved @ np.linalg.inv(moved[nodes])
    for block in zip(*found, strict=True):
        c = np.array([np.ravel(numbers) for numbers in block])
        off = np.abs(c - c[0] - weights @ (c[nodes] - c[0]))
        excess = off - EQUAL * np.abs(c).max(axis=0) - DUST * np.abs(c).max(initial=0.0)
        if excess.size and excess.max() > 0:
            row, column = np.unravel_index(int(excess.argmax()), excess.shape)
            part = off[row, column] / np.abs(c[:, column]).max()
            straight = tuple(functions) == (None,)
            raise InputError(f"{owner} declares that it is affine in {'' if straight else 'functions of '}{parameter!r}, but at "
                             f"{places[row]:.6g} an entry of its matrices is off {'a straight line' if straight else 'that'} by "
                             f"{part:.1e} of its size. Take {parameter!r} out of `{'affine' if straight else 'affine_through'}`")


def coefficients(W: Matrix, *terms: float | Matrix) -> tuple[Array, ...]:
    """The entries of C_D and of C_K; of large matrices random combinations xᵀCy."""
    columns = W.shape[1]
    if columns <= COLUMNS_ALONE:
        return tuple(C * np.eye(columns) if isinstance(C, float) else C.toarray() if sp.issparse(C) else C for C in terms)
    x, y = np.random.default_rng(columns).standard_normal((2, columns, COLUMNS_ALONE))
    return tuple(np.einsum("ij,ij->j", x, C * y if isinstance(C, float) else C @ y) for C in terms)


def _nodes(functions: Sequence[Function]) -> list[int]:
    """Indices of as many `SAMPLES` as there are coefficients: one for the constant, and one for each function."""
    if len(functions) + 1 >= len(SAMPLES):
        raise InputError(f"a field may have at most {len(SAMPLES) - 2} functions in `affine_through`, not {len(functions)}")
    return [round(at) for at in np.linspace(0, len(SAMPLES) - 1, len(functions) + 1)]


def _basis(owner: str, parameter: str, functions: Sequence[Function], places: Sequence[float]) -> Array:
    """1 and the functions at some places, shape (places, 1 + functions)."""
    one = [[1.0]]
    family = Affine(one, None, [(theta_of(((parameter, function),)), one) for function in functions])
    found = np.array([family.factors(**{parameter: p}) for p in places])
    if np.linalg.matrix_rank(found / np.maximum(np.abs(found).max(axis=0), np.finfo(float).tiny)) < found.shape[1]:
        raise InputError(f"the functions of {parameter!r} in `affine_through` of {owner} depend on each other from "
                         f"{places[0]:g} to {places[-1]:g}, or one is constant")
    return found


def _terms_of(model: Substructure, contact: Any, box: Mapping[str, tuple[float, float]]) -> list[dict[Key, Matrix]]:
    """W c_S Wᵀ for all products S, for C_D and for C_K."""
    owner = type(contact).__name__
    middle = replace(contact, **{name: (lo + hi) / 2 for name, (lo, hi) in box.items()})
    functions = {name: affine_functions(middle, name) for name in box}
    if silent := [name for name, declared in functions.items() if not declared]:
        raise InputError(f"{owner} does not declare how its matrices depend on {silent[0]!r}. Name it in `affine` if they are "
                         f"affine in it, or in `affine_through` if in a function of it, as {{{silent[0]!r}: np.reciprocal}}")

    inside = {name: lo + IRREGULAR * (hi - lo) for name, (lo, hi) in box.items()}
    for name, declared in functions.items():
        check_affine(owner, name, declared, lambda p, name=name: coefficients(  # type: ignore[misc]
            *small_matrices(model, replace(contact, **{**inside, name: p}))), box[name])

    # The matrices at all corners. `keys`, the columns of `basis` and the corners are in the order of the same product.
    places = {name: [lo + SAMPLES[at] * (hi - lo) for at in _nodes(functions[name])] for name, (lo, hi) in box.items()}
    keys: list[Key] = [tuple(factor for factor in row if factor is not None)
                       for row in product(*([None, *((name, function) for function in functions[name])] for name in box))]
    basis = reduce(np.kron, (_basis(owner, name, functions[name], places[name]) for name in box))
    corners = [small_matrices(model, replace(contact, **dict(zip(box, point, strict=True))))
               for point in product(*places.values())]
    sparse = sp.issparse(model.K)
    W = sp.csr_array(corners[0][0]) if sparse else corners[0][0]
    found: list[dict[Key, Matrix]] = []
    for at in (1, 2):
        added: dict[Key, Matrix] = {}
        for row, fitted in _fitted(basis, [corner[at] for corner in corners], W.shape[1]).items():
            c, symmetric = without_rounding(fitted)
            A = contact_matrix(W, c)
            A = A if sparse or not sp.issparse(A) else A.toarray()
            added[keys[row]] = (A + A.T) / 2 if symmetric else A
        found.append(added)
    return found


def _fitted(basis: Array, values: Sequence[float | Matrix], size: int) -> dict[int, Matrix]:
    """c_S (size, size), sparse, from C = Σ_S basis[corner, S] c_S at all corners; entries that are rounding are left out."""
    found = [sp.coo_array(sp.csr_array(C * sp.eye_array(size) if isinstance(C, float) else C)) for C in values]
    places = [one.row.astype(np.int64) * size + one.col for one in found]
    used = places[0] if all(np.array_equal(places[0], one) for one in places) else np.unique(np.concatenate(places))
    C = np.zeros((len(values), len(used)))
    for row, place, one in zip(C, places, found, strict=True):
        row[slice(None) if place is used else np.searchsorted(used, place)] = one.data
    inverse = np.linalg.inv(basis)

    def times(A: Array, rows: Array) -> Array:
        """A @ rows. BLAS rounds columns differently, depending on their place, so symmetric matrices would become unsymmetric."""
        return np.array([sum((a * row for a, row in zip(weights, rows, strict=True)), np.zeros(len(used))) for weights in A])

    c = times(inverse, C - C[0])  # an entry that does not change has no other terms
    c[0] += C[0]
    for _ in range(3):  # over a narrow range the inverse has few digits, and each correction adds as many
        c += times(inverse, C - times(basis, c))
    acting = np.abs(c) * np.abs(basis).max(axis=0)[:, None]
    c[acting <= DUST * np.abs(C).max(axis=0)] = 0.0
    terms = {}
    for row, own in enumerate(c):
        if acting[row].max(initial=0.0) > DUST * np.abs(C).max(initial=0.0):
            there = np.flatnonzero(own)
            terms[row] = sp.csr_array((own[there], np.divmod(used[there], size)), shape=(size, size))
    return terms
