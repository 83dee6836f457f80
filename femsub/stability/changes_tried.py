"""`modified`: a model with changes. `what_helps`: candidates in the order of their effect."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, finite_number, instance, items, mapping, whole_number, word
from femsub.errors import InputError
from femsub.model import SHARE, Change, ReducedSubstructure, Substructure, added, as_changes, usable_band
from femsub.modes import all_modes, beside_the_full, match
from femsub.stability.sensitivities import sensitivities

if TYPE_CHECKING:
    from femsub.model import Contacts
    from femsub.modes import ComplexModes

log = logging.getLogger(__name__)


def modified(model: Substructure, changes: Sequence[Change], *, few: int = 12) -> Any:
    """A model with changes at their amounts: M + ΔM, D + ΔD, K + ΔK and H + ΔH.

    Of a full model this is exact. A reduced model gets static responses of the full one into its basis, as long as that exists:
    K⁻¹Uᵀ of changes of up to `few` motions U, and else those to the forces of the change in the model's modes. Its ports and sets
    stay.

    `change_error` estimates the error of undamped frequencies; damping and friction are not in it. With r = P(iω)Vφ of the
    changed full model it is rᵀK⁻¹r / 2ω²φᵀMφ (1 - ω²/ω_c²)⁻¹, the largest of the modes up to 0.7 of the cut-off ω_c.

    Parameters
    ----------
    model : Substructure
        Full or reduced, or a system. Of a system of reduced parts the basis stays as it is.
    changes : sequence of changes
        `AddedMass`, `AddedSpring`, `AddedDamper`, `MaterialChange`, `JointChange`, or a `Spring`.
    few : int
        See above.

    Returns
    -------
    Substructure, or what the model is
        A `Substructure` again.

    Raises
    ------
    InputError, InputTypeError
        A change that the model has no place for; a mass that becomes negative.

    Examples
    --------
    >>> import femsub as fs
    >>> chain = fs.chain(60)
    >>> small = fs.modified(fs.reduce(chain, fs.CraigBampton(5)), [fs.AddedMass([40], 2.0), fs.AddedSpring([50], 0.1)])
    >>> full = fs.modified(chain, [fs.AddedMass([40], 2.0), fs.AddedSpring([50], 0.1)])
    >>> off = fs.normal_modes(small, 3).frequencies / fs.normal_modes(full, 3).frequencies - 1
    >>> bool(off.max() <= small.change_error < 1e-3)
    True
    """
    given = as_changes("changes", changes)
    instance("model", model, Substructure)
    whole_number("few", few, least=0)
    if not isinstance(model, ReducedSubstructure):
        return _plus(model, given)
    full = None if model.wider is None else model.wider.full()
    if np.isinf(model.cutoff):
        return replace(_plus(model, given), change_error=0.0)  # nothing is left out
    if full is None or full.size != len(model.V):
        log.info("the full model of %r is gone: the changes are projected on its basis as it is", model.name)
        return _plus(model, given)
    limit, K = (SHARE * model.cutoff) ** 2, model.wider.partition(full).sub.K
    contact = None if K is full.K else K - full.K  # of a model of contact modes: what holds its parts together

    def undamped(small: ReducedSubstructure) -> Any:
        if contact is None:
            return all_modes(small.K, small.M, carried=small.rigid_motion)
        return all_modes(small.K + small.V.T @ (contact @ small.V), small.M)

    terms = [term for change in given for term in change.terms(full)]
    each = {id(term.U): term.U for term in terms}.values()
    loads = [U.toarray().T if sp.issparse(U) else U.T for U in each if U.shape[0] <= few]
    if large := [term for term in terms if term.U.shape[0] > few]:
        modes = undamped(model)
        shapes = model.V @ modes.shapes[:, modes.eigenvalues <= limit]
        loads += [U.T @ (A @ (U @ shapes)) for _, U, A, _ in large]
    wide = model.wider.joined(model, full, loads) if loads else model
    wide._set(wider=model.wider)  # for the changes that name a part
    wide = _plus(wide, given)
    modes, plus = undamped(wide), added(full, given)
    moving = (modes.eigenvalues > EPS**0.5 * limit) & (modes.eigenvalues <= limit)
    square, x = modes.eigenvalues[moving], wide.V @ modes.shapes[:, moving]
    force = [A @ x + (plus[key] @ x if key in plus else 0.0) for key, A in (("M", full.M), ("K", K))]
    r = force[1] - force[0] * square
    energy = np.einsum("ij,ij->j", r, model.wider.responses(full, r)) / np.einsum("ij,ij->j", x, force[0])
    error = np.abs(energy) / (2 * square) / (1 - np.minimum(square / model.cutoff**2, SHARE**2))
    return replace(wide, change_error=float(error.max(initial=0.0)))


def _plus(model: Any, changes: Sequence[Change]) -> Any:
    """The model with ΔM, ΔD, ΔK and ΔH in its coordinates."""
    plus = added(model, changes)
    own = {key: getattr(model, key) for key in "MDKH"}
    new = {}
    for key, more in plus.items():
        A = more if own[key] is None else own[key] + more
        new[key] = A if key == "D" else (A + A.T) / 2
    if isinstance(model, ReducedSubstructure):
        return replace(model, **new, estimate=None, estimated=None)
    if type(model) is Substructure:
        parts = own | new
        return Substructure(parts["M"], parts["K"], parts["D"], interface=model.interface, ports=dict(model.ports),
                            name=model.name, dofs=model.dofs, sets=dict(model.sets), H=parts["H"])
    found = replace(model, **new)
    return found._damped_here() if hasattr(found, "_damped_here") else found  # its parts do not have the changes


@dataclass(frozen=True, eq=False)
class TriedChange:
    """A candidate of `what_helps`, solved anew.

    Attributes
    ----------
    name : str
    changes : tuple of Change
    growth : float
        The largest Re λ in the band.
    by_slope : float
        What the first derivatives predict for it.
    is_stable : bool or None
        Of the changed model.
    reached : bool
        Whether the growth is below the target.
    words : str
        What happens to the modes.
    modes : ComplexModes
    change_error : float
        Of the changed model; 0 for a full one.
    in_full : ComplexModes or None
        Those of the full model with these changes, for the best candidates.
    """

    name: str
    changes: tuple[Change, ...]
    growth: float
    by_slope: float
    is_stable: bool | None
    reached: bool
    words: str
    modes: ComplexModes
    change_error: float
    in_full: ComplexModes | None = None


@dataclass(frozen=True, eq=False, repr=False)
class WhatHelps:
    """Candidates in the order of their effect, made by `what_helps`. Its text is a table.

    Attributes
    ----------
    tried : tuple of TriedChange
        The best first.
    before : ComplexModes
    target : float

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.05)
    >>> found = fs.what_helps(sub, belt, {"damper": fs.AddedDamper([4], 0.2), "mass": fs.AddedMass([4], 1.0)}, band=(0.0, 0.5))
    >>> print(found.ranking[0])
    1. damper: mode 1 (ω = 0.14946) goes from +0.000202 to -0.00864; mode 2 (ω = 0.44509) goes from +0.00112 to -0.0106
    """

    tried: tuple[TriedChange, ...]
    before: ComplexModes
    target: float

    @property
    def best(self) -> TriedChange:
        """The first of them."""
        return self.tried[0]

    @property
    def ranking(self) -> tuple[str, ...]:
        """A sentence for each candidate, the best first."""
        return tuple(f"{at}. {one.name}: {one.words}" for at, one in enumerate(self.tried, 1))

    def __repr__(self) -> str:
        reach = sum(one.reached for one in self.tried)
        return (f"WhatHelps: {reach} of {len(self.tried)} candidates bring the growth from {self.before.growth:.4g} to "
                f"{self.target:g} or less; the best is {self.best.name}, {self.best.growth:.4g}")

    def __str__(self) -> str:
        width = max(len("candidate"), *(len(one.name) for one in self.tried))
        lines = [f"{'candidate':{width}}  growth      by slope    stable  error    full model"]
        for one in self.tried:
            full = "-" if one.in_full is None else f"{one.in_full.growth:.4g}"
            verdict = {True: "yes", False: "no", None: "?"}[one.is_stable]
            lines.append(f"{one.name:{width}}  {one.growth:<10.4g}  {one.by_slope:<10.4g}  {verdict:6}  "
                         f"{one.change_error:<7.1e}  {full}")
        return "\n".join([repr(self), *lines, *self.ranking])


def what_helps(model: Substructure, contacts: Contacts, candidates: Mapping[str, Any] | Sequence[Any], target: float = 0.0, *,
               band: tuple[float, float] | None = None, full: Substructure | None = None, first: int = 1) -> WhatHelps:
    """Order candidates by the growth that is left when the changed model is solved anew: max Re λ in the band.

    The slope alone misleads where modes meet or another mode begins to grow, so it is only printed beside.

    Parameters
    ----------
    model : Substructure
        Full or reduced. A reduced one is enough, see `modified`.
    contacts : contact, or a sequence of them
    candidates : mapping of str to changes, or sequence of changes
        Each is a change, or several that are made together.
    target : float
        The growth that is wanted, or less; 0 is stability.
    band : (lo, hi), optional
        As for `complex_modes`.
    full : Substructure, optional
        With a reduced model: the full one, in which the `first` so many candidates are solved as well.
    first : int

    Returns
    -------
    WhatHelps

    Raises
    ------
    InputError, InputTypeError
        No candidate, or one that the model has no place for.

    Examples
    --------
    >>> import femsub as fs
    >>> sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.05)
    >>> found = fs.what_helps(sub, belt, [fs.AddedDamper([4], 0.05), fs.AddedDamper([9], 0.05)])
    >>> [one.name for one in found.tried]
    ['damper at [9]', 'damper at [4]']
    """
    finite_number("target", target)
    whole_number("first", first, least=0)
    named: list[tuple[str, list[Change]]] = []
    listed = mapping("candidates", candidates, "names and changes").items() if isinstance(candidates, Mapping) else \
        ((None, one) for one in items("candidates", candidates, "changes"))
    for name, one in listed:
        changes = as_changes("candidates", one if isinstance(one, (list, tuple)) else [one])
        if not changes:
            raise InputError("a candidate has no changes")
        named.append((", ".join(change.name for change in changes) if name is None else word("the name of a candidate", name),
                      changes))
    if not named:
        raise InputError("candidates is empty: give changes to be tried")
    band = None if band is None else usable_band(instance("model", model, Substructure), band)
    before = beside_the_full(instance("model", model, Substructure), contacts, band=band)
    at = np.flatnonzero((before.eigenvalues.imag >= 0) & ~before.rigid & ~before.above_cutoff)
    slopes = sensitivities(model, contacts, before, [change for _, changes in named for change in changes], of=at.tolist(),
                           second=False)
    tried, start = [], 0
    for name, changes in named:
        own = slopes.growth[:, start:start + len(changes)]
        start += len(changes)
        predicted = slopes.eigenvalues.real + own @ np.array([change.amount for change in changes])
        new = modified(model, changes)
        modes = beside_the_full(new, contacts, band=band)
        tried.append(TriedChange(name, tuple(changes), modes.growth, float(np.nanmax(predicted, initial=-np.inf)),
                                 modes.is_stable, modes.growth <= target, _words(before, modes, model.size), modes,
                                 float(getattr(new, "change_error", np.nan if new.is_reduced else 0.0))))
    tried.sort(key=lambda one: one.growth)
    if full is not None:
        for place, one in enumerate(tried[:first]):
            found = beside_the_full(modified(instance("full", full, Substructure), one.changes), contacts, band=band)
            tried[place] = replace(one, in_full=found)
    return WhatHelps(tuple(tried), before, float(target))


def _words(before: ComplexModes, after: ComplexModes, size: int) -> str:
    """What happens to the modes that grow before or after, which are numbered by their frequency before."""
    lists = []
    for modes in (before, after):
        at = np.flatnonzero((modes.eigenvalues.imag > 0) & ~modes.above_cutoff)
        at = at[np.argsort(modes.eigenvalues[at].imag, kind="stable")]
        x = modes.shapes[:size, at]
        lists.append((modes.eigenvalues[at], x / np.linalg.norm(x, axis=0), [modes.stable[k] is False for k in at]))
    (one, x, grew), (two, y, grows) = lists
    pairs = dict(zip(*(part.tolist() for part in match(one, two, np.abs(x.conj().T @ y) ** 2)), strict=True))
    found = []
    for k, value in enumerate(one.tolist()):
        to = pairs.get(k)
        if to is None or not (grew[k] or grows[to]):
            continue
        now = float(two[to].real)
        what = f"mode {k + 1} (ω = {value.imag:.5g}) "
        found.append(f"{what}goes from {value.real:+.3g} to {now:+.3g}" if grew[k] else f"{what}begins to grow, {now:+.3g}")
    new = [value for place, value in enumerate(two.tolist()) if grows[place] and place not in pairs.values()]
    found += [f"a mode at ω = {value.imag:.5g} grows, {value.real:+.3g}" for value in new]
    return "; ".join(found) or "no mode grows, before or after"
