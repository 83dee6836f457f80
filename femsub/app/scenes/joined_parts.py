"""What the scenes of joined parts share: the study over methods, each applied part by part, with its table and its figure."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from femsub import Belt, Substructure, System, normal_modes, reduce, study
from femsub.app.charts_errors import errors_chart
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Scene, method_keys, other_method_names
from femsub.errors import FemsubError, InputError, PortWarning
from femsub.modes import NEAR, match
from femsub.reduction import METHODS, PORT_LIMIT, Method
from femsub.studies import Row, Study, Table, all_frequencies, column, elastic, study_choice

RIGID = 6  # rigid-body modes that a part has at most
LISTED = 20  # frequencies that are printed; the table in the file has all

Rows = list[dict[str, Method]]
Attempt = Callable[[Substructure, Method], object]


@dataclass(frozen=True)
class JoinedScene(Scene):
    """The keys that scenes of joined parts share."""

    methods: list[str] = key(["craig-bampton", "craig-chang", "macneal", "dual-craig-bampton", "guyan"],
                             "reduction methods, each for all parts that have no method of their own; short names (HCB, CC) and "
                             "those of the Python classes will do",
                             choices=method_keys, also=other_method_names)
    modes: list[int] = key([1, 2, 4], "numbers of modes to compare, in each part that has none of its own", least=0)
    ports: bool = key(False, "whether the static response to a part's ports joins its basis")
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]",
                            required=True, example=[0.0, 1e4])
    tolerance: float = key(1e-3, "relative error of the growth rates that the recommended model may have", above=0)


class Choice(NamedTuple):
    """How one part is reduced: a method's key ('' for that of the row, 'full' for none), and modes row by row ([] for all)."""

    method: str = ""
    modes: Sequence[int] = ()


def compared(scene: JoinedScene, system: System, belt: Belt | None, title: str, name: str, progress: Progress,
             choices: Mapping[str, Choice] | None = None) -> Result:
    """The study of one system: full, and reduced part by part with each method and number of modes."""
    found, methods, left_out = _studied(scene, system, belt, title, progress, choices or {})
    best = found.recommended(scene.tolerance)
    rows = [row.flat() for row in (found.full, *found.rows)]
    parts = [{"part": part, "size": sub.size, "interface": len(sub.interface)} for part, sub in system.parts.items()]
    frequencies = _frequencies(scene, system, None if best is None else methods[found.rows.index(best)])
    data = {"system": repr(system), "parts": parts, "rows": rows, "left_out": left_out,
            "recommendation": found.recommendation(scene.tolerance), "recommended": None if best is None else best.flat(),
            "frequencies": frequencies}
    return Result({name: data}, [
        f"{title}: {system!r}", str(found), *_full_words(found), *left_out, *_port_words(found),
        found.recommendation(scene.tolerance), *_frequencies_told(frequencies, best, f"{name}-frequencies"),
        Table(name, rows, title="Methods, error against run time"), errors_chart(found, title, name),
        study_choice(found, scene.tolerance, name.removeprefix("methods").strip("-").replace("-", " "))])


def _frequencies(scene: JoinedScene, system: System, methods: Mapping[str, Method] | None) -> list[dict[str, Any]]:
    """The natural frequencies of the full system in the band, and beside them those of the model by these methods."""
    own = elastic(normal_modes(system, band=(scene.band[0], scene.band[1])))
    rows: list[dict[str, Any]] = [{"mode": i, "omega": omega} for i, omega in enumerate(own, start=1)]
    if methods is None:
        return rows
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PortWarning)  # the study has told it
        theirs = all_frequencies(reduce(system, methods, ports=scene.ports))
    for at, to in zip(*match(own, theirs), strict=True):
        if abs(theirs[to] - own[at]) <= NEAR * own[at]:
            rows[at] |= {"reduced": theirs[to], "error": abs(theirs[to] - own[at]) / own[at]}
    return rows


def _frequencies_told(rows: Sequence[Mapping[str, Any]], best: Row | None, name: str) -> list[str | Table]:
    """The lowest of them as a table."""
    if not rows:
        return []
    reduced = [column("reduced", "reduced ω", ".6g"), "error"] if best is not None else []
    of = f", and of {best.label} with {best.size} DOF" if best is not None else ""
    return [f"natural frequencies of the full system in the band{of}, in rad/time:",
            Table(name, rows, ("mode", "omega", *reduced), "Natural frequencies", most=LISTED),
            *[f"and {len(rows) - LISTED} more"] * (len(rows) > LISTED)]


def _full_words(found: Study) -> list[str]:
    """What the errors are relative to."""
    if np.isnan(found.full.slope):
        return []
    return [f"full: critical slope {found.full.slope:.6g}, largest Re λ in the band {found.full.growth:.6g}"]


def _port_words(found: Study) -> list[str]:
    """What `reduce` warns of, once for all rows."""
    worst = max(found.rows, key=lambda row: row.port_error, default=None)
    if worst is None or worst.port_error <= PORT_LIMIT:
        return []
    return [f"the static response to the belt is off by up to {100 * worst.port_error:.2g} % ({worst.label} with {worst.size} "
            "DOF). Set ports = true, or put the contact into the interface"]


def _studied(scene: JoinedScene, system: System, belt: Belt | None, title: str, progress: Progress,
             choices: Mapping[str, Choice]) -> tuple[Study, Rows, list[str]]:
    """The study, its rows' methods, and why others are left out: some part cannot be reduced by them.

    Nearly every refusal shows in the first step of a reduction, which costs little. For the others the parts are reduced one
    by one, but only if the study has failed.
    """
    measure = partial(study, system, band=(scene.band[0], scene.band[1]), belt=belt, ports=scene.ports, repeats=scene.repeats,
                      port=belt.port if belt is not None else next(iter(system.ports), "belt"), progress=progress)
    progress(f"{title}: which methods the parts take")
    methods, left_out = _methods(scene, system, choices, _begun)
    try:
        return measure(methods), methods, left_out
    except FemsubError:
        finished, left_out = _methods(scene, system, choices, reduce)
        if len(finished) == len(methods):
            raise
    return measure(finished), finished, left_out


def _begun(part: Substructure, method: Method) -> None:
    """The static step of a reduction."""
    if len(part.interior) or not method.held:
        step = type(method)(0)
        at = step.part(part)
        step.statics(at, at.factored(), np.zeros((part.size, 0)))


def _methods(scene: JoinedScene, system: System, choices: Mapping[str, Choice], attempt: Attempt) -> tuple[Rows, list[str]]:
    """A mapping of parts to methods for each row, without those at which the attempt fails for some part, and why."""
    made: dict[tuple[tuple[str, Method], ...], None] = {}
    left_out: list[str] = []
    for name in scene.methods:
        for row, count in enumerate(scene.modes):
            try:
                mapping = {part: _made(sub, own.method or name, own.modes[min(row, len(own.modes) - 1)] if own.modes else count)
                           for part, sub in system.parts.items()
                           if (own := choices.get(part, Choice())).method != "full"}
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", PortWarning)
                    for part, method in mapping.items() if row == 0 else ():
                        attempt(system.parts[part], method)
            except FemsubError as error:
                left_out.append(f"{METHODS[name].label} is left out: {error}")
                break
            made[tuple(mapping.items())] = None
    if not made:
        raise InputError(f"no method can reduce the parts: {'; '.join(dict.fromkeys(left_out))}")
    return [dict(pairs) for pairs in made], list(dict.fromkeys(left_out))


def _made(part: Substructure, key: str, modes: int) -> Method:
    """The method with so many modes, or with all that the part has."""
    kind = METHODS[key]
    if kind.held:
        return kind(min(modes, len(part.interior)))
    room = part.size - (normal_modes(part, count=min(1, part.size)).rigid if modes > part.size - RIGID else RIGID)
    return kind(min(modes, max(room, 0)))
