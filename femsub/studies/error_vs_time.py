"""Error against run time: reduced models and the full model, measured in one run in alternating order."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, SMALL, WIDE, release, timed
from femsub.checks import Array, check_band, instance, items, listener, real_array, whole_number
from femsub.coupling import Belt, System
from femsub.errors import CutoffWarning, FemsubError, InputError, PortWarning
from femsub.model import Contact, Contacts, ReducedSubstructure, Substructure, contacts_of, in_band
from femsub.modes import (
    ComplexModes,
    NormalModes,
    all_modes,
    extra_eigenvalues,
    frequency_error,
    relative_error,
    spectrum_errors,
    turnover,
)
from femsub.modes.normal_modes import normal_modes
from femsub.modes.quadratic.complex_modes import complex_modes
from femsub.reduction import Method
from femsub.reduction.reduce import reduce
from femsub.stability.critical_slope import critical_slope
from femsub.studies.joint_forces import force_error
from femsub.studies.results import PHASES, Row, Study, Timing, with_front

Progress = Callable[[str], None]
SHORT_RUNS = 3  # solutions of a reduced model per turn


def study(sub: Substructure, methods: Sequence[Method | Mapping[str, Method]], band: tuple[float, float], *,
          belt: Contacts = None, port: str = "belt", ports: bool = False, repeats: int = 5,
          slopes: Sequence[float] | None = None, assembly: float = np.nan, progress: Progress | None = None) -> Study:
    """Reduce a component by several methods, and compare errors and run times with the full model.

    Compared are undamped frequencies, complex modes and the critical slope.

    Parameters
    ----------
    sub : Substructure
        The full model.
    methods : sequence of CraigBampton, CraigChang or another `Method`
        One entry per reduced model; list the same method with several numbers of modes to see convergence. With a band
        and a tolerance, the row shows how many modes were chosen (under the belt, if there is one). Of a system an entry may
        be a mapping, {'disc': CraigBampton(20), 'pad': Rubin(5)}: its parts are reduced one by one, and the forces in the
        joints are compared as well.
    band : (lo, hi)
        The band in which errors are measured, in radians per unit of time.
    belt : Belt, LinearContact or another contact, or a sequence of them, optional
        The contacts under which complex modes are compared; without one only the models' own damping acts.
    port : str
        The port for the critical slope (if a belt is given, the first one's port is used). The other contacts act as well; there
        is no critical slope if one of them adds to K.
    ports : bool
        Passed to `reduce`: static port columns join each basis.
    repeats : int
        Number of runs; each time is the median (reduced models are solved three times as often). Models take turns, so that
        a slow phase of the machine affects all of them.
    slopes : sequence of float, optional
        The critical slopes of the full model and of each reduced one, if they are known already.
    assembly : float
        Seconds for building `sub`, for the record.
    progress : callable, optional
        Called with a short text about the current step.

    Returns
    -------
    Study
        The times of the full model are those of the eigensolver alone. If an independent count confirms the number of its
        eigenvalues in the band (up to 2,000 DOF), this is done once and not timed.

    Raises
    ------
    InputError, InputTypeError
        No method, an unknown port, a bad band; `slopes` of the wrong length.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.study(fs.chain(10, belt=1), [fs.CraigBampton(3), fs.CraigChang(3)], band=(0.0, 0.5), repeats=1)
    >>> [row.label for row in found.rows], found.recommended(tol=0.1) is not None
    (['Craig-Bampton', 'Craig-Chang'], True)
    """
    instance("sub", sub, Substructure)
    contacts = contacts_of(belt)
    first = next((contact for contact in contacts if isinstance(contact, Belt)), None)
    lo, hi = check_band(band)
    methods = items("methods", methods, "reductions, e.g. [CraigBampton(modes=4)]")
    for method in methods:
        for one in method.values() if isinstance(method, Mapping) else [method]:
            instance("each of methods", one, Method, "e.g. CraigBampton(modes=4)")  # type: ignore[type-abstract]
    if not methods:
        raise InputError("methods is empty. Name at least one, e.g. [CraigBampton(modes=4), CraigChang(modes=4)]")
    whole_number("repeats", repeats, least=1, most=1000)
    place, force = (first.port, first.force) if first is not None else (port, 1.0)
    others = [contact for contact in contacts if contact is not first]
    if sub.ports:  # without a port there is no critical slope
        sub.port(place)
    tell = listener("progress", progress)
    roms, spectra, phases, solving = _measured(sub, methods, contacts, (lo, hi), ports, repeats, tell)
    models = [sub, *roms]
    reasons: Sequence[str] = [""] * len(models)
    if slopes is None:
        tell(f"{sub.name}: critical slopes")
        slopes, _, reasons = zip(*(border_or_reason(model, place, force, (lo, hi), others) if place in model.ports and force
                                   else (np.nan, np.nan, "") for model in models), strict=True)
    elif len(slopes := list(real_array("slopes", slopes, finite=False).ravel())) != len(models):
        raise InputError(f"slopes must be {len(models)}, of the full model and of each method, not {len(slopes)}")
    tell(f"{sub.name}: undamped frequencies")
    modes = normal_modes(sub, band=(lo, hi)) if sub.size > SMALL else all_modes(sub.K, sub.M, carried=sub.rigid_motion)
    own = elastic(modes)[in_band(elastic(modes), (lo, hi))]
    rates = turnover(sub, contacts, spectra[0])
    rows = []
    for i, model in enumerate(models):
        found = spectrum_errors(spectra[0], spectra[i], (sub, model), rates)
        growth, stable = _judged(spectra[i], (lo, hi))
        taken = phases[i]
        rows.append(Row(
            _key(methods[i - 1]) if i else "full", sum(kept_modes(model).values()),
            model.size, found.eigenvalue, found.growth, relative_error(slopes[i], slopes[0]), found.missing, slopes[i],
            growth,
            Timing.of([sum(one.values()) for one in taken]), Timing.of(solving[i]),
            port_error(model, place), model.cutoff,
            extra_eigenvalues(spectra[0], spectra[i], (lo, hi)),
            frequency_error(own, all_frequencies(model)) if i else 0.0, found.mac,
            {name: Timing.of([one.get(name, 0.0) for one in taken]) for name in PHASES} if i else {}, _megabytes(model),
            stable=stable, reason=reasons[i], parts=kept_modes(model) if i and isinstance(model, System) else {},
            error_force=_force_error(sub, modes, model, (lo, hi))))
    return Study(sub.name, (lo, hi), repeats, rows[0], with_front(rows[1:], hi), assembly)


def _measured(sub: Substructure, methods: Sequence[Method | Mapping[str, Method]], contacts: Sequence[Contact],
              band: tuple[float, float], ports: bool, repeats: int, tell: Progress
              ) -> tuple[list[Substructure], list[ComplexModes], list[list[dict[str, float]]], list[list[float]]]:
    """Reduced models, all spectra (the full model's first), and for each run the seconds by phase of reduction, and to solve."""
    solving: list[list[float]] = [[] for _ in range(len(methods) + 1)]
    phases: list[list[dict[str, float]]] = [[{}], *([] for _ in methods)]
    models: list[Any] = [None] * len(methods)
    spectra: list[Any] = [None] * (len(methods) + 1)
    if sub.size <= QUADRATIC:
        tell(f"{sub.name}: complex modes of the full model")
        spectra[0] = complex_modes(sub, contacts, band=band)
    for turn in range(repeats):
        for i, method in enumerate(methods):
            tell(f"{sub.name}: run {turn + 1} of {repeats}, {in_words(method)}")
            with warnings.catch_warnings(), timed() as spent:
                warnings.simplefilter("ignore", PortWarning)  # the port error is in the row
                tolerance = not isinstance(method, Mapping) and method.band is not None
                models[i], seconds = _clocked(reduce, sub, method, ports=ports, contacts=contacts or None if tolerance else None)
            phases[i + 1].append(spent | {"basis": seconds - sum(spent.values())})
        tell(f"{sub.name}: run {turn + 1} of {repeats}, full model")
        found, seconds = _clocked(complex_modes, sub, contacts, band=band, evidence=False)
        spectra[0] = found if spectra[0] is None else spectra[0]
        solving[0].append(seconds)
        for i, model in enumerate(models, start=1):  # for a small dense model the whole spectrum costs no more than the band
            for _ in range(SHORT_RUNS):  # waking BLAS threads may cost as much as the work
                spectra[i], seconds = _clocked(complex_modes, model, contacts, band=None if model.size <= WIDE else band,
                                                evidence=False)
                solving[i].append(seconds)
    return models, spectra, phases, solving


def all_frequencies(model: Substructure) -> Array:
    """Every undamped elastic frequency of a small model."""
    return elastic(all_modes(model.K, model.M, carried=model.rigid_motion))


def elastic(modes: NormalModes) -> Array:
    """The frequencies that do not belong to rigid motion."""
    return modes.frequencies[modes.rigid:]


def _megabytes(model: Substructure) -> float:
    parts = [model.M, model.D, model.K, *([model.V] if isinstance(model, ReducedSubstructure) else [])]
    return sum(part.data.nbytes + part.indices.nbytes + part.indptr.nbytes if sp.issparse(part) else part.nbytes
               for part in parts) / 1e6


def _judged(modes: ComplexModes, band: tuple[float, float]) -> tuple[float, bool | None]:
    """The largest Re λ in a band and below the cut-off, and whether the modes there are stable."""
    keep = np.flatnonzero(~modes.rigid & ~modes.above_cutoff & in_band(modes.eigenvalues, band))
    votes = [modes.stable[i] for i in keep]
    stable = False if False in votes else (True if votes and None not in votes else None)
    return float(modes.eigenvalues.real[keep].max(initial=-np.inf)), stable


def border_or_reason(model: Substructure, port: str, force: float, band: tuple[float, float],
                     others: Sequence[Contact] = ()) -> tuple[float, float, str]:
    """Critical slope under other contacts and its ω; or NaN and the reason why there is none, e.g. a band above the cut-off.

    For tables of many models, where one failure must not prevent the results of the others.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CutoffWarning)  # the error is measured anyway
            found = critical_slope(model, port, force=force, contacts=others or None, band=band)
            return found.value, found.omega, ""
    except FemsubError as error:
        return np.nan, np.nan, str(error)


def _clocked(call: Callable[..., Any], model: Substructure, *arguments: Any, **options: Any) -> tuple[Any, float]:
    """The result of a call on a model, and its seconds without any factor made before."""
    _released(model)
    start = time.perf_counter()
    result = call(model, *arguments, **options)
    return result, time.perf_counter() - start


def _force_error(sub: Substructure, modes: NormalModes, model: Substructure, band: tuple[float, float]) -> float:
    if not isinstance(sub, System) or not isinstance(model, System):
        return np.nan
    return 0.0 if model is sub else force_error(sub, modes, model, band)


def _released(model: Substructure) -> None:
    release(model)
    for part in model.parts.values() if isinstance(model, System) else ():
        _released(part)


def _key(method: Method | Mapping[str, Method]) -> str:
    """The key of a method, or of that of all parts; 'mixed' where they differ."""
    keys = {one.key for one in method.values()} if isinstance(method, Mapping) else {method.key}
    return keys.pop() if len(keys) == 1 else "mixed"


def in_words(method: Method | Mapping[str, Method]) -> str:
    """'Craig-Bampton with 4 modes', or 'disc by Craig-Bampton with 4 modes, pad by Rubin with 2 modes'."""
    if not isinstance(method, Mapping):
        return str(method)
    told = {name: str(one) for name, one in method.items()}
    if len(set(told.values())) == 1:
        return f"each part by {next(iter(told.values()))}"
    return ", ".join(f"{name} by {one}" for name, one in told.items())


def kept_modes(model: Substructure) -> dict[str, int]:
    """The number of elastic modes in a reduced model, by its name, or in each reduced part of a system."""
    if isinstance(model, System):
        return {name: sum(kept_modes(part).values()) for name, part in model.parts.items()
                if isinstance(part, (System, ReducedSubstructure))}
    return {model.name: model.modes} if isinstance(model, ReducedSubstructure) else {}


def port_error(model: Substructure, port: str) -> float:
    """The static error at a port in the energy norm, of a system that of the part that has the port."""
    if isinstance(model, System):
        name, _, rest = port.partition(".")
        return port_error(model.parts[name], rest) if name in model.parts else 0.0
    return model.port_error.get(port, 0.0) if isinstance(model, ReducedSubstructure) else 0.0
