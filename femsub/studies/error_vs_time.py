"""Error against run time: reduced models and the full model, measured in one run in alternating order."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, WIDE, release, timed
from femsub.checks import (
    Array,
    FemsubError,
    InputError,
    PortWarning,
    instance,
    interval,
    items,
    listener,
    real_array,
    unknown_name,
    whole_number,
    word,
)
from femsub.coupling import System
from femsub.model import Contact, Contacts, ReducedSubstructure, Substructure, contacts_of, in_band, usable_band, without
from femsub.modes import (
    ComplexModes,
    NormalModes,
    beside_the_full,
    complex_modes,
    extra_eigenvalues,
    force_error,
    frequency_error,
    frequency_response,
    held_error,
    held_frequencies,
    relative_error,
    spectrum_errors,
    turnover,
    undamped,
)
from femsub.reduction import (
    Bases,
    Method,
    Step,
    in_words,
    kept_modes,
    key_of,
    methods_of,
    port_error,
    reduced_by,
    step_name,
    twins,
)
from femsub.stability import Loss, first_belt, first_loss, with_value
from femsub.studies.results import PHASES, Row, Study, Timing, with_front

Steps: TypeAlias = Step | Sequence[Step]
Progress = Callable[[str], None]


def study(model: Substructure, methods: Sequence[Steps], band: tuple[float, float], *, contacts: Contacts = None,
          parameter: str | None = None, values: Sequence[float] = (), between: tuple[float, float] | None = None,
          ports: bool = False, repeats: int = 5, shared: bool = False, held: bool = False,
          critical: Sequence[float] | None = None, at: Any = None, assembly: float = np.nan,
          progress: Progress | None = None) -> Study:
    """Reduce a model by several methods, and compare errors and run times with the full one.

    Compared are undamped frequencies, complex modes at each value of a parameter, which of them grow, the first loss of
    stability over the parameter, and the forces in the joints of a system.

    Parameters
    ----------
    model : Substructure or System
        The full model.
    methods : sequence of CraigBampton, CraigChang or another `Method`
        One entry per reduced model; list the same method with several numbers of modes to see convergence. With a band
        and a tolerance, the row shows how many modes were chosen (under the contacts, if there are any). Of a system an entry
        may be a mapping, {'disc': CraigBampton(20), 'pad': Rubin(5)}: its parts are reduced one by one, and the forces in the
        joints are compared as well. An entry may be several steps, ({'disc': Rubin(20)}, ContactModes(30, contacts=...)).
    band : (lo, hi)
        The band in which errors are measured, in radians per unit of time.
    contacts : Belt, FrictionContact or another contact, or a sequence of them, optional
        The contacts under which complex modes are compared; without one only the model's own damping acts.
    parameter : str, optional
        The field of the contacts whose critical value is compared, such as 'mu'. By default 'slope' if one of the contacts is a
        belt: the critical slope of the first belt, while the other contacts act as they are.
    values : sequence of float
        Values of the parameter at which complex modes are compared. By default the contacts are as they are given.
    between : (lo, hi)
        The range of the parameter in which the first loss is sought; 'slope' of a belt has none.
    ports : bool
        Passed to `reduce`: static port columns join each basis; of `ContactModes` those of the contacts' ports.
    repeats : int
        Number of runs; each time is the median. Reduced models are solved three times as often, at several values once at each.
        Models take turns, so that a slow phase of the machine affects all of them.
    shared : bool
        Whether models of one method with given numbers of modes are taken from the basis of the largest (`Reductor`). A
        convergence study then costs little more than this one reduction. The seconds to reduce a model include those of this
        basis, so they are more than a smaller model alone would take. By default each model is reduced anew.
    held : bool
        Whether undamped frequencies are compared with the interface held at rest as well, as in a mount. This solves the full
        model once more.
    critical : sequence of float, optional
        The critical values of the full model and of each reduced one, if they are known already.
    at : array_like, optional
        Frequencies at which the receptances of the contacts' ports (without contacts: of all ports) are compared as well, under
        the contacts as they are given; see `frequency_response`.
    assembly : float
        Seconds for building the model, for the record.
    progress : callable, optional
        Called with a short text about the current step.

    Returns
    -------
    Study
        The times of the full model are those of the eigensolver alone. The independent count of its eigenvalues in the band (up
        to 2,000 DOF) is done once and not timed. A method that cannot reduce the model is in ``.left_out`` with the reason.
        Without an interface several methods give the same model. Only one of them is compared; ``.left_out`` names the others.

    Raises
    ------
    InputError, InputTypeError
        No method, or none that can reduce the model; an unknown port or parameter; a bad band; `critical` of the wrong length.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.study(fs.chain(10, belt=1), [fs.CraigBampton(3), fs.CraigChang(3)], band=(0.0, 0.5), repeats=1)
    >>> [row.label for row in found.rows], found.recommended(tol=0.1) is not None
    (['Craig-Bampton', 'Craig-Chang'], True)
    """
    given = contacts_of(contacts)
    band = usable_band(instance("model", model, Substructure), band)
    asked_for: list[tuple[Step, ...]] = []
    for method in items("methods", methods, "reductions, e.g. [CraigBampton(modes=4)]"):
        asked_for.append(tuple(method if isinstance(method, (list, tuple)) else [method]))
        for single in methods_of(asked_for[-1]):
            instance("each of methods", single, Method, "e.g. CraigBampton(modes=4)")  # type: ignore[type-abstract]
    if not asked_for:
        raise InputError("methods is empty. Name at least one, e.g. [CraigBampton(modes=4), CraigChang(modes=4)]")
    whole_number("repeats", repeats, least=1, most=1000)
    instance("shared", shared, bool)
    instance("held", held, bool)
    # the parameter ('' for none), its values and its range
    belt, values = first_belt(given), tuple(real_array("values", values).ravel().tolist())
    parameter = ("slope" if belt is not None else "") if parameter is None else word("parameter", parameter)
    between = None if between is None else interval("between", between)
    if not parameter and (values or between):
        raise InputError("values and between need a parameter of the contacts: name it, e.g. parameter='mu'")
    if parameter and not any(hasattr(contact, parameter) for contact in given):
        raise unknown_name("parameter", parameter, sorted({name for contact in given for name in vars(contact)}))
    if parameter == "slope" and belt is not None and between is not None:
        raise InputError("the critical slope of a belt is the largest one up to 0: leave between out")
    known = None if critical is None else real_array("critical", critical, finite=False).ravel()
    if known is not None and len(known) != len(asked_for) + 1:
        raise InputError(f"critical must have {len(asked_for) + 1} values, of the full model and of each method, not "
                         f"{len(known)}")
    say = listener("progress", progress)
    asked = Comparison(model, given, band, parameter, values, between)
    # the full and the reduced models, solved several times in turn, and why other methods are left out
    full, small = Tried(model, phases=[{}]), [Tried(model, steps) for steps in asked_for]
    refused: list[tuple[tuple[Step, ...], FemsubError]] = []
    if model.size <= QUADRATIC:
        say(f"{model.name}: complex modes of the full model")
        full.spectra = [complex_modes(model, load, band=band) for load in asked.loads]
    for turn in range(repeats):
        bases = Bases(asked_for) if shared else None
        for one in list(small):
            say(f"{model.name}: run {turn + 1} of {repeats}, {in_words(one.steps)}")
            try:
                with warnings.catch_warnings(), timed() as spent:
                    warnings.simplefilter("ignore", PortWarning)  # the row has the port error
                    one.model, seconds = _clocked(reduced_by, model, one.steps, given, ports, None, bases)
                one.phases.append(spent | {"basis": seconds - sum(spent.values()) + (bases.lent if bases else 0.0)})
            except FemsubError as error:
                refused.append((one.steps, error))
                small.remove(one)
        # without an interface several methods keep the same shapes: a model that equals an earlier one is left out
        for one in list(small) if not turn and not len(model.interface) else ():
            for other in small[:small.index(one)]:
                if key_of(other.steps) != key_of(one.steps) and twins(other.model, one.model):
                    refused.append((one.steps, InputError(f"without an interface it is the same as {step_name(other.steps)}")))
                    small.remove(one)
                    break
        if not small:
            raise refused[0][1] if len(refused) == 1 else InputError(
                f"no method can reduce {model.name!r}: {'; '.join(_left_out(refused, small))}")
        say(f"{model.name}: run {turn + 1} of {repeats}, full model")
        found = _solved(full, asked.loads, band)
        full.spectra = full.spectra or found
        for one in small:  # for a small dense model the whole spectrum costs no more than the band
            for _ in range(3 if len(asked.loads) == 1 else 1):  # see `repeats`; the start of BLAS threads may take as long as one
                one.spectra = _solved(one, asked.loads, None if one.model.size <= WIDE else band)
    # errors against the full model
    say(f"{model.name}: undamped frequencies")
    own = asked.at_rest(model)
    modes = undamped(own, band)
    rates = [turnover(model, load, spectrum) for load, spectrum in zip(asked.loads, full.spectra, strict=True)]
    rows = [asked.row(full, one, modes, rates) for one in (full, *small)]
    models = tuple(one.model for one in small)
    if known is not None:
        losses = [Loss(float(known[i])) for i in (0, *(1 + asked_for.index(one.steps) for one in small))]
    else:
        losses = asked.losses([model, *models], rows, say)
    rows = [replace(row, critical=loss.value, omega=loss.omega, reason=loss.reason,
                    error_critical=relative_error(loss.value, losses[0].value)) for row, loss in zip(rows, losses, strict=True)]
    if held and len(model.interface):
        say(f"{model.name}: undamped frequencies with the interface held")
        rows = [replace(row, error_held=error) for row, error in zip(rows, asked.held_errors(models), strict=True)]
    if at is not None:
        say(f"{model.name}: receptances")
        rows = [replace(row, error_response=error) for row, error in zip(rows, asked.response_errors(models, at), strict=True)]
    return Study(model.name, band, repeats, rows[0], with_front(rows[1:], band[1]), assembly=assembly, parameter=parameter,
                 values=values, between=between, left_out=tuple(_left_out(refused, small)), models=models,
                 spectra=tuple(full.spectra), interface=len(model.interface), steps=tuple(one.steps for one in small))


@dataclass(eq=False)
class Tried:
    """A model of the study, its steps of reduction (none for the full one), its spectra at each value, and its run times."""

    model: Substructure
    steps: tuple[Step, ...] = ()
    spectra: list[ComplexModes] = field(default_factory=list)
    phases: list[dict[str, float]] = field(default_factory=list)
    solving: list[float] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Comparison:
    """The terms of the comparison: full model, contacts, band, parameter, its values and its range."""

    model: Substructure
    contacts: Sequence[Contact]
    band: tuple[float, float]
    parameter: str
    values: tuple[float, ...]
    between: tuple[float, float] | None

    @property
    def loads(self) -> list[list[Any]]:
        """The contacts at each value."""
        return [with_value(self.contacts, self.parameter, value) for value in self.values] or [list(self.contacts)]

    @property
    def places(self) -> list[str]:
        """The ports at which contacts act; without contacts all ports."""
        return [name for contact in self.contacts for name in contact.ports] if self.contacts else list(self.model.ports)

    def at_rest(self, model: Substructure) -> Substructure:
        """The model without damping and friction, with the stiffness of the contacts at the least value of the parameter."""
        least = min([*(self.between or ()), *self.values], default=None)
        contacts = self.contacts if least is None else with_value(self.contacts, self.parameter, least)
        pencil = model.linearised(without(contacts), structural=True)
        return model if pencil.K is model.pencil.K else Substructure(model.M, (pencil.K + pencil.K.T) / 2, name=model.name)

    def row(self, full: Tried, one: Tried, modes: NormalModes, rates: Sequence[Array]) -> Row:
        """The row of a model, without its first loss.

        `modes` are the undamped modes of the full model, see `at_rest`; `rates` are the scales of errors of Re λ.
        """
        model, reduced, pairs = one.model, one is not full, list(zip(full.spectra, one.spectra, strict=True))
        found = [spectrum_errors(*pair, (full.model, model), scale, self.band) for pair, scale in zip(pairs, rates, strict=True)]
        growth, votes = -np.inf, []  # largest Re λ, and stable or not, of the modes in the band and below the cut-off
        for spectrum in one.spectra:
            keep = np.flatnonzero(~spectrum.rigid & ~spectrum.above_cutoff & in_band(spectrum.eigenvalues, self.band))
            growth = float(spectrum.eigenvalues.real[keep].max(initial=growth))
            votes += [spectrum.stable[i] for i in keep] or [None]
        theirs = undamped(self.at_rest(model)) if reduced else modes
        kept, force = kept_modes(model), np.nan
        if isinstance(self.model, System) and isinstance(model, System):
            force = force_error(self.model, modes, model, theirs, self.band) if reduced else 0.0
        stored = [model.M, model.D, model.K, *([model.V] if isinstance(model, ReducedSubstructure) else [])]
        memory = sum(part.data.nbytes + part.indices.nbytes + part.indptr.nbytes if sp.issparse(part) else part.nbytes
                     for part in stored) / 1e6
        frequencies = modes.elastic[in_band(modes.elastic, self.band)]
        return Row(
            method=key_of(one.steps), modes=sum(kept.values()), size=model.size, parts=kept if reduced and isinstance(
                model, System) else {}, cutoff=model.cutoff, memory=memory,
            error_eigenvalue=_largest(each.eigenvalue for each in found),
            error_growth=_largest(each.growth for each in found), error_real=_largest(each.real for each in found),
            error_frequency=frequency_error(frequencies, theirs.elastic) if reduced else 0.0, error_force=force,
            mac=-_largest(-each.mac for each in found), missing=sum(each.missing for each in found),
            extra=sum(extra_eigenvalues(*pair, self.band) for pair in pairs), missed=sum(each.missed for each in found),
            invented=sum(each.invented for each in found), growth=growth, critical=np.nan, error_critical=np.nan,
            stable=False if False in votes else None if None in votes else True,
            port_error=max((port_error(model, name) for name in self.places), default=0.0),
            reduction=Timing.of([sum(seconds.values()) for seconds in one.phases]), solution=Timing.of(one.solving),
            phases={name: Timing.of([seconds.get(name, 0.0) for seconds in one.phases]) for name in PHASES} if reduced else {})

    def held_errors(self, models: Sequence[Substructure]) -> list[float]:
        """The largest error of a frequency in the band with the interface at rest: 0 for the full model, then one per model.

        All are NaN if the contacts have a stiffness, since it may act on the interface.
        """
        if self.at_rest(self.model) is not self.model:
            return [np.nan] * (1 + len(models))
        own = held_frequencies(self.model, self.band)
        return [0.0, *(held_error(own, held_frequencies(model)) for model in models)]

    def response_errors(self, models: Sequence[Substructure], at: Any) -> list[float]:
        """Bounds of the errors of receptances, relative to the entry's largest |h|: 0 for the full model, then one per model."""
        exact = frequency_response(self.model, self.contacts, at=at, loads=self.places)
        size = np.abs(exact.receptance).max(axis=0)
        errors = [frequency_response(model, self.contacts, at=at, loads=self.places).error(exact).max(axis=0) for model in models]
        return [0.0, *(float((error / np.where(size > 0, size, 1.0)).max()) for error in errors)]

    def losses(self, models: Sequence[Substructure], rows: Sequence[Row], say: Progress) -> list[Loss]:
        """The first loss of each model. Over a range, the full model's is sought near that of the most accurate reduced one."""
        if self.between is None and (self.parameter != "slope" or first_belt(self.contacts) is None):
            return [Loss()] * len(models)
        say(f"{self.model.name}: critical {self.parameter}")
        look = partial(first_loss, contacts=self.contacts, parameter=self.parameter, between=self.between, band=self.band)
        small = [look(model) for model in models[1:]]
        errors = [row.error_eigenvalue for row in rows[1:]]
        best = small[int(np.argmin(np.where(np.isnan(errors), np.inf, errors)))]
        return [look(models[0], near=best.value), *small]



def _left_out(refused: Sequence[tuple[tuple[Step, ...], FemsubError]], small: Sequence[Tried]) -> list[str]:
    """'Craig-Bampton is left out: ...'; with its number of modes if models of this method with other numbers are kept."""
    there = {step_name(one.steps) for one in small}
    return list(dict.fromkeys(f"{in_words(steps) if step_name(steps) in there else step_name(steps)} is left out: {error}"
                              for steps, error in refused))


def _solved(one: Tried, loads: Sequence[Any], band: tuple[float, float] | None) -> list[ComplexModes]:
    """The complex modes under each of the loads. The seconds are appended to `one.solving`."""
    found = []
    for load in loads:
        modes, seconds = _clocked(beside_the_full, one.model, load, band=band, evidence=False)
        found.append(modes)
        one.solving.append(seconds)
    return found


def _largest(values: Iterable[float]) -> float:
    """The largest of the finite values, NaN if there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return max(finite, default=np.nan)


def _clocked(call: Callable[..., Any], model: Substructure, *arguments: Any, **options: Any) -> tuple[Any, float]:
    """The result of a call on a model, and its seconds. Factors from earlier calls are released first."""
    _released(model)
    start = time.perf_counter()
    result = call(model, *arguments, **options)
    return result, time.perf_counter() - start


def _released(model: Substructure) -> None:
    release(model)
    for part in model.parts.values() if isinstance(model, System) else ():
        _released(part)
