"""`modified`: a model with changes. `what_helps`: candidates in the order of their effect."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag

from femsub.checks import EPS, Array, InputError, Matrix, finite_number, instance, items, mapping, whole_number, word
from femsub.model import SHARE, Change, ChangeTerm, ReducedSubstructure, Substructure, added, as_changes, usable_band
from femsub.modes import all_modes, beside_the_full, each_of, match
from femsub.output import Chart, Displayed, Table, column
from femsub.stability.charts import changes_chart
from femsub.stability.sensitivities import sensitivities

if TYPE_CHECKING:
    from femsub.model import Contacts
    from femsub.modes import ComplexModes

SIDE = 4  #: number of dense models that are made and solved in parallel; each has its own basis

log = logging.getLogger(__name__)

_Key: TypeAlias = tuple[str, Any, Any]  # of a term: its matrix, and the numbers of U and A


def modified(model: Substructure, changes: Sequence[Change], *, few: int = 12) -> Any:
    """A model with changes at their amounts: M + ΔM, D + ΔD, K + ΔK and H + ΔH.

    For a full model this is exact. The basis of a reduced model gets static responses of the full model, as long as this exists:
    K⁻¹Uᵀ for changes of up to `few` motions U, otherwise the responses to the forces of the change in the model's modes. Ports
    and sets stay.

    `change_error` estimates the largest relative error of λ of the modes up to 0.7 of the cut-off ω_c. It includes the damping of
    the changes, but no other damping and no friction. With the residual r = P(λ)Vx of the changed full model it is
    rᴴK⁻¹r / |λ xᵀP'(λ)x| (1 - |λ|²/ω_c²)⁻¹, without damping rᵀK⁻¹r / 2ω²φᵀMφ (1 - ω²/ω_c²)⁻¹.

    Parameters
    ----------
    model : Substructure
        Full or reduced, or a system. The basis of a system of reduced parts, and of a `MacNeal` model, is not extended.
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
        A change that the model cannot take; a mass that becomes negative.

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
    return next(_each_modified(model, [given], whole_number("few", few, least=0)))


def _each_modified(model: Substructure, candidates: Sequence[Sequence[Change]], few: int = 12) -> Iterator[Any]:
    """The model with the changes of each candidate. Candidates for a reduced model share the work on the full model."""
    if not isinstance(model, ReducedSubstructure):
        yield from (_plus(model, changes) for changes in candidates)
        return
    full = None if model.wider is None else model.wider.full()
    if np.isinf(model.cutoff):
        yield from (replace(_plus(model, changes), change_error=0.0) for changes in candidates)  # nothing is left out
        return
    if full is None or full.size != len(model.V) or not _has_its_mass(model, full):
        log.info("the changes of %r are projected on its basis as it is: its full model is gone, or its M is not the projected "
                 "one, as with MacNeal's method", model.name)
        yield from (_plus(model, changes) for changes in candidates)
        return
    batch, sizes = list[list[_Acting]](), dict[_Key, int]()

    def made(batch: list[list[_Acting]]) -> Iterator[Any]:
        joined = _ChangedBasis(model, full, batch, few)
        for at in range(0, len(batch), SIDE):
            several = batch[at:at + SIDE]  # a single one solves with the full model
            yield from each_of(joined.changed, several) if len(several) > 1 else map(joined.changed, several)

    for changes in candidates:
        acting = [_Acting((term.matrix, _bytes(term.U), _bytes(term.A)), term, float(term.factor(change.amount)))
                  for change in changes for term in change.terms(full)]
        more = sizes | {key: term.U.shape[0] if term.U.shape[0] <= few else model.size for key, term, _ in acting}
        if batch and sum(more.values()) > model.size:  # a joined basis of up to twice as many columns
            yield from made(batch)
            batch, more = [], {key: more[key] for key, *_ in acting}
        batch.append(acting)
        sizes = more
    if batch:
        yield from made(batch)


def _has_its_mass(model: ReducedSubstructure, full: Substructure) -> bool:
    """Whether M of the model is VᵀMV, tested with a random vector."""
    q = np.random.default_rng(5).standard_normal(model.size)
    u = model.V @ q
    energy = float(u @ (full.M @ u))
    return bool(abs(q @ (model.M @ q) - energy) <= EPS**0.5 * energy)


class _Acting(NamedTuple):
    """A term of a change with its θ at the amount. Equal terms have the same key."""

    key: _Key
    term: ChangeTerm
    weight: float


class _ChangedBasis:
    """A reduced model with the static responses to many changes in one basis W = [V, N₁, N₂, …], (n, w).

    Products with matrices of the full model are computed once for all changes. A model with some of the changes has V and the
    columns of these changes: its matrices are blocks of WᵀMW, WᵀDW and WᵀKW. The residual of a mode x = Wφ of the changed
    model is

        r = KWφ - ω²MWφ + Σ θ (1 or -ω²) UᵀAUWφ = Zy,   Z = [KW, MW, L₁, L₂, …],

    with UᵀAUW = LC for each term of a change. So rᵀK⁻¹r = yᵀ(ZᵀK⁻¹Z)y, with the rounding of terms that cancel.
    """

    def __init__(self, model: ReducedSubstructure, full: Substructure, candidates: Sequence[Sequence[_Acting]], few: int) -> None:
        self.model, part = model, model.wider.partition(full)
        self.contact = None if part.sub.K is full.K else part.sub.K - full.K  # for contact modes: the contact's stiffness
        self.terms = {key: term for acting in candidates for key, term, _ in acting}
        # static responses to unit forces for a change of few motions, otherwise to its forces in the model's modes
        self.few = {key: term.U.shape[0] <= few for key, term in self.terms.items()}
        shapes = np.zeros((full.size, 0))
        if not all(self.few.values()):
            modes = all_modes(model.K, model.M, carried=model.rigid_motion) if self.contact is None else \
                all_modes(model.K + model.V.T @ (self.contact @ model.V), model.M)
            shapes = model.V @ modes.shapes[:, modes.eigenvalues <= (SHARE * model.cutoff) ** 2]
        loads = {self._group(key): _dense(term.U).T if self.few[key] else np.asarray(term.U.T @ (term.A @ (term.U @ shapes)))
                 for key, term in self.terms.items()}
        new = model.wider.shapes(model, full, list(loads.values())) if loads else []
        self.parts: dict[str, Any] = model.wider.bordered(model, full, np.hstack([np.zeros((full.size, 0)), *new]))
        W, ends = self.parts["V"], model.size + np.cumsum([0, *(one.shape[1] for one in new)])
        self.columns = {key: np.arange(*ends[at:at + 2]) for at, key in enumerate(loads)}
        self.held = np.zeros((W.shape[1],) * 2) if self.contact is None else W.T @ (self.contact @ W)

        self.moved = {key: np.asarray(term.U @ W) for key, term in self.terms.items()}
        self.K, self.M, self.responses = part.sub.K, full.M, partial(model.wider.responses, full)
        self.energy: Array | None = None
        if len(candidates) == 1:  # a single candidate has fewer modes than Z has columns
            return
        # ZᵀK⁻¹Z, and the places of each L in Z
        Z, start = [np.asarray(self.K @ W), np.asarray(self.M @ W)], 2 * W.shape[1]
        self.places: dict[_Key, Array] = {}
        for key, term in self.terms.items():
            Z.append(_dense(term.U).T if self.few[key] else np.asarray(term.U.T @ (term.A @ self.moved[key])))
            self.places[key] = np.arange(start, start := start + Z[-1].shape[1])
        forces = np.hstack(Z)
        self.energy = forces.T @ self.responses(forces)

    def _group(self, key: _Key) -> Any:
        """The key of a term's static responses: terms with the same few motions share them."""
        return key[1] if self.few[key] else key

    def changed(self, acting: Sequence[_Acting]) -> Any:
        """The model with the changes of one of the candidates, and its `change_error`.

        The basis contains the static response to a damping force. The inertia of that response leaves a residual outside the
        basis, which modes without the damper do not have.
        """
        model = self.model
        groups = dict.fromkeys(self._group(key) for key, *_ in acting)
        new = np.concatenate([np.zeros(0, dtype=int), *(self.columns[key] for key in groups)])
        at = np.append(np.arange(model.size), new)
        # columns of several groups may depend on each other
        T = np.eye(len(at))
        if len(groups) > 1:
            size, turn = np.linalg.eigh(self.parts["M"][np.ix_(new, new)])
            kept = size > EPS**0.75 * size.max(initial=0.0)
            T = block_diag(np.eye(model.size), turn[:, kept] / np.sqrt(size[kept]))
        plus: dict[str, Array] = {}
        for key, term, weight in acting:
            if weight:
                moved = self.moved[key][:, at] @ T
                plus[key[0]] = plus.get(key[0], 0.0) + weight * (moved.T @ (term.A @ moved))

        def block(A: Array) -> Array:
            found = T.T @ A[np.ix_(at, at)] @ T
            found[:model.size, :model.size] = A[:model.size, :model.size]
            return found

        own: dict[str, Any] = {name: None if self.parts[name] is None else block(self.parts[name]) for name in "MDKH"}
        for name, more in plus.items():
            own[name] = more if own[name] is None else own[name] + more
        own |= {name: (A + A.T) / 2 for name, A in own.items() if name != "D" and A is not None}
        ports = {name: T.T @ w[at] for name, w in self.parts["ports"].items()}
        wide = replace(model, **own, V=np.hstack([model.V, self.parts["V"][:, new] @ T[model.size:, model.size:]]), ports=ports,
                       kinds=(*model.kinds, *("residual",) * (T.shape[1] - model.size)), estimate=None, estimated=None)
        wide._set(wider=model.wider)  # for the changes that name a part

        limit = (SHARE * model.cutoff) ** 2
        # columns of a change may nearly depend on V: the highest modes, which are not used, then have fewer digits
        modes = all_modes(wide.K, wide.M, EPS**0.5, wide.rigid_motion) if self.contact is None else \
            all_modes(wide.K + block(self.held), wide.M, EPS**0.5)
        elastic = modes.eigenvalues > EPS**0.5 * limit
        moving = elastic & (modes.eigenvalues <= limit)
        value, x, rate = 1j * np.sqrt(modes.eigenvalues[moving]), T @ modes.shapes[:, moving], 2 * modes.eigenvalues[moving]
        if any(key[0] in "DH" and weight for key, _, weight in acting):
            value, x, rate = self._damped(acting, at, T @ modes.shapes[:, elastic], modes.eigenvalues[elastic], limit)
        share = np.minimum(np.abs(value / model.cutoff), SHARE) ** 2
        error = self._residual_energy(acting, value, at, x) / np.abs(rate) / (1 - share)
        wide._set(change_error=float(error.max(initial=0.0)))
        return wide

    def _damped(self, acting: Sequence[_Acting], at: Array, shapes: Array, stiffness: Array, limit: float
                ) -> tuple[Array, Array, Array]:
        """λ (k,) above the axis with |λ|² up to `limit`, the columns `at` of W times x, and λ xᵀP'(λ)x of λ² + λC + Ω² + iH.

        C and H are those of the changes in the small model's elastic modes, `shapes` and Ω², without its own damping.
        """
        parts = {"D": np.zeros((len(stiffness),) * 2), "H": np.zeros((len(stiffness),) * 2)}
        for key, term, weight in acting:
            if key[0] in parts:
                moved = self.moved[key][:, at] @ shapes
                parts[key[0]] += weight * (moved.T @ (term.A @ moved))
        C, K = parts["D"], np.diag(stiffness) + (1j * parts["H"] if parts["H"].any() else 0.0)
        value, X = np.linalg.eig(np.block([[np.zeros_like(C), np.eye(len(C))], [-K, -C]]))
        kept = (value.imag > 0) & (np.abs(value) ** 2 <= limit)
        value, X = value[kept], X[:len(C), kept]
        return value, shapes @ X, value * np.einsum("ij,ij->j", X, 2 * value * X + C @ X)

    def _residual_energy(self, acting: Sequence[_Acting], value: Array, at: Array, x: Array) -> Array:
        """rᴴK⁻¹r (k,) of r = P(λ)u, λ (k,), u the columns `at` of W times x, (len(at), k). λ is imaginary if x is real."""
        square = value**2 if np.iscomplexobj(x) else -value.imag**2
        by: dict[str, Any] = {"M": square, "K": 1.0, "D": value, "H": 1j}
        if self.energy is None:
            u = self.parts["V"][:, at] @ x
            y = self.K @ u + (self.M @ u) * square
            for key, term, weight in acting:
                y = y + term.U.T @ (term.A @ (self.moved[key][:, at] @ x)) * (weight * by[key[0]])
            gram: Callable[[Array], Array] = self.responses
        else:
            rows, ys = [at, len(self.parts["V"].T) + at], [x, square * x]
            for key, term, weight in acting:
                rows.append(self.places[key] if self.few[key] else self.places[key][at])
                ys.append((term.A @ (self.moved[key][:, at] @ x) if self.few[key] else x) * (weight * by[key[0]]))
            places, y = np.concatenate(rows), np.vstack(ys)
            gram = self.energy[np.ix_(places, places)].__matmul__
        parts = (y.real, y.imag) if np.iscomplexobj(y) else (y,)
        return np.abs(np.sum([np.einsum("ij,ij->j", part, gram(part)) for part in parts], axis=0))


def _bytes(A: Matrix) -> tuple[Any, ...]:
    parts = (A.data, A.indices, A.indptr) if sp.issparse(A) and A.format == "csr" else (_dense(A),)
    return A.shape, *(part.tobytes() for part in parts)


def _dense(A: Matrix) -> Array:
    return np.asarray(A.toarray() if sp.issparse(A) else A)


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
    """A candidate of `what_helps`, with the solution of the changed model.

    Attributes
    ----------
    name : str
    changes : tuple of Change
    growth : float
        The largest Re λ in the band.
    by_slope : float
        The growth that first derivatives predict.
    is_stable : bool or None
        Whether the changed model is stable; None if that is undecided.
    reached : bool
        Whether the growth is at most the target.
    words : str
        What happens to the modes.
    modes : ComplexModes
        The modes of the changed model.
    change_error : float
        The estimated error of the changed model, see `modified`; 0 for a full model.
    in_full : ComplexModes or None
        The modes of the full model with these changes, for the best candidates.
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
class WhatHelps(Displayed):
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
        """The best candidate."""
        return self.tried[0]

    @property
    def ranking(self) -> tuple[str, ...]:
        """A sentence for each candidate, the best first."""
        return tuple(f"{at}. {one.name}: {one.words}" for at, one in enumerate(self.tried, 1))

    def tables(self) -> list[Table]:
        """A row for each candidate, the best first."""
        rows = [{"change": one.name, "growth": one.growth, "by_slope": one.by_slope, "is_stable": one.is_stable,
                 "change_error": one.change_error, "in_full": one.in_full.growth if one.in_full is not None else None,
                 "words": one.words} for one in self.tried]
        columns = [column("change", form="s"), column("growth", form=".4g"), column("by_slope", "by slope", ".4g"), "is_stable",
                   column("change_error", "error", ".1e"), column("in_full", "in full", ".4g")]
        return [Table("helps", rows, columns, "Changes")]

    def chart(self, title: str = "What helps") -> Chart:
        """A bar for each candidate, the best at the top: the largest Re λ now and with the change."""
        return changes_chart("helps", self, title)

    def __repr__(self) -> str:
        reach = sum(one.reached for one in self.tried)
        return (f"WhatHelps: {reach} of {len(self.tried)} candidates bring the growth from {self.before.growth:.4g} to "
                f"{self.target:g} or less; the best is {self.best.name}, {self.best.growth:.4g}")

    def __str__(self) -> str:
        return "\n".join([repr(self), self.tables()[0].text(), *self.ranking])


def what_helps(model: Substructure, contacts: Contacts, candidates: Mapping[str, Any] | Sequence[Any], target: float = 0.0, *,
               band: tuple[float, float] | None = None, full: Substructure | None = None, first: int = 1,
               at_once: int = 100) -> WhatHelps:
    """Order candidates by the remaining growth of the changed model: max Re λ in the band.

    The slope alone misleads if modes meet or another mode begins to grow. It is therefore reported for comparison only.

    Parameters
    ----------
    model : Substructure
        Full or reduced. A reduced model is enough, see `modified`.
    contacts : contact, or a sequence of them
    candidates : mapping of str to changes, or sequence of changes
        Each is a change, or several that are made together.
    target : float
        The largest growth that is acceptable; 0 means stability.
    band : (lo, hi), optional
        As for `complex_modes`.
    full : Substructure, optional
        With a reduced model: the full model, with which the best candidates are solved as well.
    first : int
        The number of these candidates.
    at_once : int
        The number of changes whose slopes are computed together: memory grows with its square.

    Returns
    -------
    WhatHelps

    Raises
    ------
    InputError, InputTypeError
        No candidate, or a candidate that the model cannot take.

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
    whole_number("at_once", at_once, least=1)
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
    every = [change for _, changes in named for change in changes]
    growth = np.hstack([sensitivities(model, contacts, before, every[start:start + at_once], of=at.tolist(), second=False).growth
                        for start in range(0, len(every), at_once)])
    tried, start = [], 0
    solve, models = partial(beside_the_full, contacts=contacts, band=band), _each_modified(model, [one for _, one in named])
    solved: list[tuple[float, ComplexModes]] = []
    while several := list(islice(models, 1 if sp.issparse(model.K) else SIDE)):
        errors = [float(getattr(new, "change_error", np.nan if new.is_reduced else 0.0)) for new in several]
        solved += zip(errors, each_of(solve, several) if len(several) > 1 else map(solve, several), strict=True)
    for (name, changes), (error, modes) in zip(named, solved, strict=True):
        predicted = before.eigenvalues.real[at] + growth[:, start:start + len(changes)] @ [change.amount for change in changes]
        start += len(changes)
        tried.append(TriedChange(name, tuple(changes), modes.growth, float(np.nanmax(predicted, initial=-np.inf)),
                                 modes.is_stable, modes.growth <= target, _words(before, modes, model.size), modes, error))
    tried.sort(key=lambda one: one.growth)
    if full is not None:
        for place, one in enumerate(tried[:first]):
            found = beside_the_full(modified(instance("full", full, Substructure), one.changes), contacts, band=band)
            tried[place] = replace(one, in_full=found)
    return WhatHelps(tuple(tried), before, float(target))


def _words(before: ComplexModes, after: ComplexModes, size: int) -> str:
    """What happens to the modes that grow before or after the change. They are numbered by their frequency before."""
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
