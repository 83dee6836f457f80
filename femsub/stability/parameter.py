"""A model as a function of one parameter, a field of its contacts or a parameter of an `Affine`, and the form of that function.

A contact declares in `affine` that its matrices are affine in the parameter, an `Affine` by its factors. Samples only check a
declaration. If there is none, C_D and C_K or the factors are sampled densely, which costs no eigenproblem. Kinks that a contact
names divide the range.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from femsub.checks import Array, InputError, Matrix, instance, unknown_name, word
from femsub.model import (
    COLUMNS_ALONE,
    DUST,
    IRREGULAR,
    Affine,
    Contacts,
    Pencil,
    Substructure,
    affine_fields,
    affine_functions,
    check_affine,
    coefficients,
    columns_of,
    contacts_of,
    family_of,
    fields_of,
    kinks_of,
    projected,
    small_matrices,
)

log = logging.getLogger(__name__)

SAMPLED_AT = 2048  # number of values at which a coefficient is sampled; an eighth of it for contacts of more columns
Terms: TypeAlias = tuple[Matrix, float | Matrix, float | Matrix]


@dataclass(frozen=True, eq=False)
class Share:
    """A contact that depends on the parameter, or the factors of an `Affine`.

    `coefficients` returns the numbers on which the pencil depends, in blocks of one unit each. `affine`: whether they are
    declared as affine in the parameter. `kinks` are the values at which they are not smooth. `few`: the contact has few columns.
    `terms` returns W, C_D and C_K of a contact.
    """

    owner: str
    coefficients: Callable[[float], tuple[Array, ...]]
    affine: bool
    kinks: tuple[float, ...] = ()
    few: bool = True
    terms: Callable[[float], Terms] | None = None


@dataclass(frozen=True, eq=False)
class PencilOver:
    """The pencil as a function of the parameter, ``over(p)``, and what is known about the form of this function.

    With `sign` -1 it is a function of the parameter with the other sign.
    """

    parameter: str
    at: Callable[[float], Pencil]
    shares: tuple[Share, ...]
    sign: float = 1.0
    #: the pencil over a range as a sum of matrices; None where a contact declares nothing
    family: Callable[[tuple[float, float]], Affine | None] = lambda between: None

    def __call__(self, p: float) -> Pencil:
        return self.at(self.sign * p)

    def projected(self, V: Array, between: tuple[float, float]) -> PencilOver:
        """The function for the pencil in coordinates q, u = Vq, with V (n, r)."""
        def small(p: float) -> Pencil:
            pencil = self.at(p)
            return type(pencil)(*(projected(A, V) for A in (pencil.M, pencil.D, pencil.K)))

        if not self.affine(between):
            return replace(self, at=lru_cache(maxsize=64)(small))  # enough for the values to which an exclusion returns
        lo, hi = (self.sign * p for p in between)
        first, last = small(lo), small(hi)
        step = [(getattr(last, name) - getattr(first, name)) / (hi - lo) for name in "MDK"]
        return replace(self, at=lambda p: type(first)(*(getattr(first, name) + (p - lo) * slope
                                                        for name, slope in zip("MDK", step, strict=True))))

    def terms(self, between: tuple[float, float]) -> list[tuple[int, Matrix, Callable[[float], float]]] | None:
        """(power, T, θ) of all terms θ(p) λ^power T that depend on the parameter; None if they are not known.

        They are known for an `Affine`, and for contacts that declare how they depend on the parameter (`family_of`).
        """
        lo, hi = sorted(self.sign * p for p in between)
        if (family := self.family((lo, hi))) is None:
            return None
        every = [(power, theta, T) for power, terms in ((2, family.M), (1, family.D), (0, family.K)) for theta, T in terms]
        return [(power, T, lambda p, at=at: float(family.factors(**{self.parameter: self.sign * p})[at]))  # type: ignore[misc]
                for at, (power, theta, T) in enumerate(every) if (callable(theta) or isinstance(theta, str)) and abs(T).max()]

    def affine(self, between: tuple[float, float]) -> bool:
        """Whether M is constant and D and K are affine in the parameter, as declared by all `shares`.

        Raises
        ------
        InputError
            Samples contradict a declaration.
        """
        for share in self.shares:
            if share.affine:
                check_affine(share.owner, self.parameter, (None,), share.coefficients,
                             (self.sign * between[0], self.sign * between[1]))
        return all(share.affine for share in self.shares)

    def kinks(self, between: tuple[float, float]) -> list[float]:
        """The values within the range at which a coefficient is not smooth, ascending."""
        places = {self.sign * float(p) for share in self.shares if not share.affine for p in share.kinks}
        return sorted(p for p in places if between[0] < p < between[1])

    def straight(self, values: Sequence[float]) -> list[float]:
        """Ends of intervals over which the pencil is close to its chord: those of the range if it is affine, else more values.

        Close means: no coefficient differs from its chord by more than a tenth of its change over the range. The `values` are
        among the ends, see `Sampled.straight`.
        """
        lo, hi = values[0], values[-1]
        if self.affine((lo, hi)):
            return [lo, hi]
        return self.sampled((lo, hi)).straight(values)

    def sampled(self, between: tuple[float, float]) -> Sampled:
        """The coefficients that are not affine, over the range."""
        return Sampled([share for share in self.shares if not share.affine], between, self.kinks(between), self.sign)


class Sampled:
    """The coefficients at many values of the parameter. They show at which additional values an interval must be examined."""

    def __init__(self, shares: Sequence[Share], between: tuple[float, float], kinks: Sequence[float], sign: float) -> None:
        self.shares, self.end, self.sign = shares, between[1], sign
        count = SAMPLED_AT if all(share.few for share in shares) else SAMPLED_AT // 8
        steps = np.arange(count)
        inside = between[0] + (steps + steps * IRREGULAR % 1.0) / count * (between[1] - between[0])
        self.p = np.unique(np.concatenate([between, inside, kinks]))
        self.c = self._at(self.p)
        self.size = np.maximum(np.abs(self.c).max(axis=0), 1e-300)

    def _at(self, values: Array) -> Array:
        """The coefficients; extrapolated linearly above the range, where a contact may refuse the parameter."""
        return np.array([self._one(p) if p <= self.end else 2 * self._one(self.end) - self._one(2 * self.end - p)
                         for p in values.tolist()])

    def _one(self, p: float) -> Array:
        return np.concatenate([np.ravel(block) for share in self.shares for block in share.coefficients(self.sign * p)])

    def straight(self, values: Sequence[float], off_chord: float = 0.1) -> list[float]:
        """The values, and more where a coefficient is off its chord by more than `off_chord` of its change over the range."""
        bound = off_chord * np.ptp(self.c, axis=0) + DUST * self.size
        waiting, ends = list(pairwise(values)), set(values)
        while waiting:
            a, b = waiting.pop()
            inside = (self.p > a) & (self.p < b)
            first, last = self._at(np.array([a, b]))
            off = np.abs(self.c[inside] - first - (self.p[inside] - a)[:, None] / (b - a) * (last - first))
            if (off > bound).any():
                m = float(self.p[inside][int((off / bound).max(axis=1).argmax())])
                ends.add(m)
                waiting += [(a, m), (m, b)]
        return sorted(ends)

    def places(self, begin: float, end: float, usual: Sequence[float] = ()) -> list[float]:
        """The values in (begin, end) at which a coefficient is farther off its chord than at the `usual` values; 4 at most."""
        inside = (self.p > begin) & (self.p < end)
        if not inside.any():
            return []
        m = (begin + end) / 2
        p = np.array([begin, end, m, *usual])
        c = self._at(p)
        slope = (c[1] - c[0]) / (end - begin)
        off, known = (np.abs(values - c[2] - (at[:, None] - m) * slope) / self.size
                      for at, values in ((self.p[inside], self.c[inside]), (p, c)))
        excess = off.max(axis=0) - (known[3:].max(axis=0) if len(usual) else 0.0)
        farther = np.flatnonzero(excess > DUST)
        farther = farther[np.argsort(-excess[farther], kind="stable")]
        return list(dict.fromkeys(self.p[inside][off[:, farther].argmax(axis=0)].tolist()))[:4]


def pencils_of(model: Substructure | Affine, contacts: Contacts, names: Sequence[str], what: str = "a map"
               ) -> Callable[[Mapping[str, float]], Pencil]:
    """The pencil as a function of the parameters `names`. Each parameter changes in all contacts that have it.

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter; an `Affine` with contacts, or with other parameters that have no value; structural damping, which
        `what` cannot take into account.
    """
    if isinstance(model, Affine):
        family_of(model, contacts, names, {})  # its checks
        return lambda p: model.at(**p)
    instance("model", model, Substructure, "or an Affine").viscous_only(what)
    given: Sequence[Any] = contacts_of(contacts)
    known = [fields_of(one) for one in given]
    for name in names:
        if not any(name in fields for fields in known):
            raise unknown_name("parameter", name, sorted(set().union(*known)))
        if idle := [type(one).__name__ for one, fields in zip(given, known, strict=True) if name not in fields]:
            log.info("%s has no %r and stays as it is", ", ".join(idle), name)
    return lambda p: model.linearised([replace(one, **{name: value for name, value in p.items() if name in fields})
                                       for one, fields in zip(given, known, strict=True)])


def pencil_over(model: Substructure | Affine, contacts: Contacts, parameter: str) -> PencilOver:
    """The pencil as a function of one parameter; errors are those of `pencils_of`.

    The pencil has no cut-off. The band of the question respects that of the model, but solvers search a little beyond the band.
    """
    word("parameter", parameter)
    pencil_at = pencils_of(model, contacts, [parameter], "an analysis over a parameter")

    def at(p: float) -> Pencil:
        return pencil_at({parameter: p}).below(np.inf)

    if isinstance(model, Affine):
        return PencilOver(parameter, at, (Share("the Affine", lambda p: (model.factors(**{parameter: p}),),
                                                model.affine_in(parameter)),), family=lambda between: model)
    given = contacts_of(contacts)
    model.refuse_empty(model.D, *(columns_of(model, contact) for contact in given))

    def share(contact: Any) -> Share:
        def terms(p: float) -> Terms:
            return small_matrices(model, replace(contact, **{parameter: p}))

        return Share(type(contact).__name__, lambda p: coefficients(*terms(p)), parameter in affine_fields(contact),
                     kinks_of(contact, parameter), small_matrices(model, contact)[0].shape[1] <= COLUMNS_ALONE, terms)

    changing = [contact for contact in given if parameter in fields_of(contact)]

    def family(between: tuple[float, float]) -> Affine | None:
        middle = {parameter: (between[0] + between[1]) / 2}
        declared = all(affine_functions(replace(contact, **middle), parameter) for contact in changing)  # type: ignore[type-var]
        try:
            return family_of(model, given, [parameter], {parameter: between}) if declared else None
        except InputError as error:  # such as a law with one slope throughout; the pencil at each value is still known
            if all(one.affine for one in shares):
                raise
            log.info("no sum of matrices over %s: %s", parameter, error)
            return None

    shares = tuple(map(share, changing))
    return PencilOver(parameter, at, shares, family=family)
