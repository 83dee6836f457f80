"""A model as a function of one parameter, a field of its contacts or a parameter of an `Affine`, and the form of that function.

A contact declares in `affine` that its matrices are affine in the parameter, an `Affine` by its factors. Samples only check a
declaration. If there is none, C_D and C_K or the factors are sampled densely, which costs no eigenproblem. Kinks that a contact
names divide the range.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, EQUAL, Array, Matrix, instance, word
from femsub.errors import InputError, unknown_name
from femsub.model import (
    Affine,
    Contacts,
    Pencil,
    Substructure,
    affine_fields,
    columns_of,
    contacts_of,
    fields_of,
    kinks_of,
    projected,
    small_matrices,
)

log = logging.getLogger(__name__)

SAMPLES = (0.0, 0.19, 0.5, 0.77, 1.0)  # places in the range where a declaration is checked
DUST = 512 * EPS  # of the largest entry of C: what is left of others by the rounding of terms that cancel
COLUMNS_ALONE = 8  # columns of a contact up to which each entry of C is a coefficient; above, as many random combinations are
SAMPLED_AT = 2048  # values of the range at which a coefficient is known; an eighth for contacts of more columns
IRREGULAR = (5**0.5 - 1) / 2  # samples at even distances would miss what is periodic
Terms: TypeAlias = tuple[Matrix, float | Matrix, float | Matrix]


@dataclass(frozen=True, eq=False)
class Share:
    """What depends on the parameter: a contact, or the factors of an `Affine`.

    `coefficients` gives the numbers that the pencil depends on, in blocks of one unit each. `affine` is what was declared.
    `kinks` are the values at which they are not smooth. `few`: the contact has few columns. `terms` gives W, C_D and
    C_K of a contact.
    """

    owner: str
    coefficients: Callable[[float], tuple[Array, ...]]
    affine: bool
    kinks: tuple[float, ...] = ()
    few: bool = True
    terms: Callable[[float], Terms] | None = None

    def check(self, parameter: str, between: tuple[float, float], sign: float) -> None:
        """An error if the coefficients contradict the declaration that they are affine."""
        lo, hi = between
        share = np.array(SAMPLES)
        found = [self.coefficients(sign * (lo + at * (hi - lo))) for at in SAMPLES]
        for block in zip(*found, strict=True):
            c = np.array([np.ravel(numbers) for numbers in block])
            off = np.abs(c - c[0] - share[:, None] * (c[-1] - c[0]))
            excess = off - EQUAL * np.abs(c).max(axis=0) - DUST * np.abs(c).max(initial=0.0)
            if excess.size and excess.max() > 0:
                row, column = np.unravel_index(int(excess.argmax()), excess.shape)
                where, part = lo + share[row] * (hi - lo), off[row, column] / np.abs(c[:, column]).max()
                raise InputError(f"{self.owner} declares that it is affine in {parameter!r}, but at {where:.6g} an entry of its "
                                 f"matrices is off a straight line by {part:.1e} of its size. Take {parameter!r} out of `affine`")


@dataclass(frozen=True, eq=False)
class PencilOver:
    """The pencil as a function of the parameter, ``over(p)``, and what is known about the form of this function.

    With `sign` -1 it is a function of the parameter with the other sign.
    """

    parameter: str
    at: Callable[[float], Pencil]
    shares: tuple[Share, ...]
    sign: float = 1.0
    named: tuple[tuple[int, Matrix, Callable[[float], float]], ...] | None = None  #: the terms θ(p) λ^power T of an `Affine`

    def __call__(self, p: float) -> Pencil:
        return self.at(self.sign * p)

    def projected(self, V: Array, between: tuple[float, float]) -> PencilOver:
        """The same for the coordinates q of u = Vq; V is (n, r)."""
        def small(p: float) -> Pencil:
            pencil = self.at(p)
            return type(pencil)(*(projected(A, V) for A in (pencil.M, pencil.D, pencil.K)))

        if not self.affine(between):
            return replace(self, at=lru_cache(maxsize=64)(small))  # as many values as one exclusion comes back to
        lo, hi = (self.sign * p for p in between)
        first, last = small(lo), small(hi)
        step = [(getattr(last, name) - getattr(first, name)) / (hi - lo) for name in "MDK"]
        return replace(self, at=lambda p: type(first)(*(getattr(first, name) + (p - lo) * slope
                                                        for name, slope in zip("MDK", step, strict=True))))

    def terms(self, between: tuple[float, float]) -> list[tuple[int, Matrix, Callable[[float], float]]] | None:
        """(power, T, θ) of all terms θ(p) λ^power T that depend on the parameter; None if they are not known.

        They are known of an `Affine`, and of contacts that are affine in the parameter from the pencils at both ends.
        """
        if not self.affine(between):
            return None if self.named is None else [(power, T, lambda p, theta=theta: theta(self.sign * p))  # type: ignore[misc]
                                                    for power, T, theta in self.named]
        first, last = self(between[0]), self(between[1])
        slopes = [(power, (getattr(last, name) - getattr(first, name)) / (between[1] - between[0]))
                  for power, name in enumerate("KD")]
        return [(power, slope, lambda p: p) for power, slope in slopes if abs(slope).max()]

    def affine(self, between: tuple[float, float]) -> bool:
        """Whether M is constant, and D and K are affine, as all declare on whom they depend.

        Raises
        ------
        InputError
            Samples contradict a declaration.
        """
        for share in self.shares:
            if share.affine:
                share.check(self.parameter, between, self.sign)
        return all(share.affine for share in self.shares)

    def kinks(self, between: tuple[float, float]) -> list[float]:
        """The values within the range at which something is not smooth, ascending."""
        places = {self.sign * float(p) for share in self.shares if not share.affine for p in share.kinks}
        return sorted(p for p in places if between[0] < p < between[1])

    def straight(self, values: Sequence[float]) -> list[float]:
        """Ends of intervals over which the pencil is close to its chord: the range's if it is affine, or the values and others.

        Close: no coefficient is farther off than by a tenth of its change over the range, see `Sampled.straight`.
        """
        lo, hi = values[0], values[-1]
        if self.affine((lo, hi)):
            return [lo, hi]
        return self.sampled((lo, hi)).straight(values)

    def sampled(self, between: tuple[float, float]) -> Sampled:
        """The coefficients that are not affine, over the range."""
        return Sampled([share for share in self.shares if not share.affine], between, self.kinks(between), self.sign)


class Sampled:
    """The coefficients at many values of the parameter. They show where an interval is looked at beside the usual places."""

    def __init__(self, shares: Sequence[Share], between: tuple[float, float], kinks: Sequence[float], sign: float) -> None:
        self.shares, self.end, self.sign = shares, between[1], sign
        count = SAMPLED_AT if all(share.few for share in shares) else SAMPLED_AT // 8
        steps = np.arange(count)
        inside = between[0] + (steps + steps * IRREGULAR % 1.0) / count * (between[1] - between[0])
        self.p = np.unique(np.concatenate([between, inside, kinks]))
        self.c = self._at(self.p)
        self.size = np.maximum(np.abs(self.c).max(axis=0), 1e-300)

    def _at(self, values: Array) -> Array:
        """The coefficients; straight on above the range, where a contact may refuse the parameter."""
        return np.array([self._one(p) if p <= self.end else 2 * self._one(self.end) - self._one(2 * self.end - p)
                         for p in values.tolist()])

    def _one(self, p: float) -> Array:
        return np.concatenate([np.ravel(block) for share in self.shares for block in share.coefficients(self.sign * p)])

    def straight(self, values: Sequence[float], off_chord: float = 0.1) -> list[float]:
        """The values, and others where a coefficient is farther off its chord than by `off_chord` of its change over all."""
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
        """The values in (begin, end) at which a coefficient is farther off its chord than at the `usual` ones; 4 at most."""
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


def pencil_over(model: Substructure | Affine, contacts: Contacts, parameter: str) -> PencilOver:
    """The pencil as a function of the parameter, which changes in all contacts that have it.

    It has no cut-off: the band of the question respects it, and solvers look a little beyond that.

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, an `Affine` with contacts or with other parameters that have no value.
    """
    word("parameter", parameter)
    if isinstance(model, Affine):
        if contacts is not None:
            raise InputError("an Affine has no ports for contacts. Put them into its matrices, or use a Substructure")
        if parameter not in model.parameters:
            raise unknown_name("parameter", parameter, model.parameters)
        if rest := [name for name in model.parameters if name != parameter]:
            raise InputError(f"{', '.join(rest)} must have values: give model.fixed({rest[0]}=...) instead of the model")
        every = [(power, theta, T) for name, power in (("M", 2), ("D", 1), ("K", 0)) for theta, T in getattr(model, name)]
        named = tuple((power, T, lambda p, at=at: float(model.factors(**{parameter: p})[at]))
                      for at, (power, theta, T) in enumerate(every) if callable(theta) or isinstance(theta, str))
        return PencilOver(parameter, lambda p: model.at(**{parameter: p}).below(np.inf),
                          (Share("the Affine", lambda p: (model.factors(**{parameter: p}),), model.affine_in(parameter)),),
                          named=named)
    instance("model", model, Substructure, "or an Affine").viscous_only("an analysis over a parameter")
    given = contacts_of(contacts)
    known = [fields_of(contact) for contact in given]
    if not any(parameter in names for names in known):
        raise unknown_name("parameter", parameter, sorted(set().union(*known)) if known else [])
    for contact, names in zip(given, known, strict=True):
        if parameter not in names:
            log.info("%s has no %r and stays as it is", type(contact).__name__, parameter)

    model.refuse_empty(model.D, *(columns_of(model, contact) for contact in given))

    def at(p: float) -> Pencil:
        return model.linearised([replace(contact, **{parameter: p}) if parameter in names else contact  # type: ignore[type-var]
                                 for contact, names in zip(given, known, strict=True)]).below(np.inf)

    def share(contact: Any) -> Share:
        def terms(p: float) -> Terms:
            return small_matrices(model, replace(contact, **{parameter: p}))

        return Share(type(contact).__name__, lambda p: _coefficients(*terms(p)), parameter in affine_fields(contact),
                     kinks_of(contact, parameter), small_matrices(model, contact)[0].shape[1] <= COLUMNS_ALONE, terms)

    return PencilOver(parameter, at, tuple(share(contact) for contact, names in zip(given, known, strict=True)
                                           if parameter in names))


def _coefficients(W: Matrix, *terms: float | Matrix) -> tuple[Array, ...]:
    """The entries of C_D and of C_K; of large ones random combinations xᵀCy."""
    columns = W.shape[1]
    if columns <= COLUMNS_ALONE:
        return tuple(C * np.eye(columns) if isinstance(C, float) else C.toarray() if sp.issparse(C) else C for C in terms)
    x, y = np.random.default_rng(columns).standard_normal((2, columns, COLUMNS_ALONE))
    return tuple(np.einsum("ij,ij->j", x, C * y if isinstance(C, float) else C @ y) for C in terms)
