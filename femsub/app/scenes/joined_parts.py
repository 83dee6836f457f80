"""What the scenes of joined parts share: the study over methods, each applied part by part, with its table and its figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from femsub import ContactModes, Substructure, System, normal_modes, study
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Scene, method_keys, other_method_names
from femsub.modes import NEAR, match
from femsub.reduction import METHODS, PORT_LIMIT, Method
from femsub.studies import Row, Study, Table, all_frequencies, column, elastic, errors_chart, friction_errors_chart, study_choice

if TYPE_CHECKING:
    from femsub.model import Contacts

RIGID = 6  # rigid-body modes that a part has at most
LISTED = 20  # frequencies that are printed; the table in the file has all


class Over(NamedTuple):
    """What a study of friction is asked for beside its contacts."""

    parameter: str
    values: Sequence[float]
    between: tuple[float, float]


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
    tolerance: float = key(1e-3, "relative error of the growth rates, or of the critical mu, that the recommended model may have",
                           above=0)


class Choice(NamedTuple):
    """How one part is reduced: a method's key ('' for that of the row, 'full' for none), and modes row by row ([] for all)."""

    method: str = ""
    modes: Sequence[int] = ()


def compared(scene: JoinedScene, system: System, contacts: Contacts, title: str, name: str, progress: Progress,
             choices: Mapping[str, Choice] | None = None, over: Over | None = None) -> Result:
    """The study of one system: full, and reduced part by part with each method and number of modes.

    With `over` it is one of friction over mu: the parts are reduced, and then the system to contact modes.
    """
    rows = _methods(scene, system, choices or {})
    methods: list[Any] = [parts for parts, _ in rows] if over is None else [*_with_contact_modes(system, rows, contacts)]
    found = study(system, methods, (scene.band[0], scene.band[1]), contacts=contacts, ports=scene.ports, repeats=scene.repeats,
                  progress=progress, **(over._asdict() if over else {}))
    best, words = found.recommended(scene.tolerance), found.recommendation(scene.tolerance)
    flat = [row.flat() for row in (found.full, *found.rows)]
    parts = [{"part": part, "size": sub.size, "interface": len(sub.interface)} for part, sub in system.parts.items()]
    frequencies = [] if over else _frequencies(scene, system, None if best is None else found.models[found.rows.index(best)])
    data: dict[str, Any] = {"system": repr(system), "parts": parts, "rows": flat, "left_out": found.left_out,
                            "recommendation": words, "recommended": None if best is None else best.flat(),
                            "frequencies": frequencies}
    data |= {"parameter": over.parameter, "values": over.values} if over else {}
    return Result({name: data}, [
        f"{title}: {system!r}", str(found), *_full_words(found), *_port_words(found), words,
        *_frequencies_told(frequencies, best, f"{name}-frequencies"), Table(name, flat, title="Methods, error against run time"),
        (friction_errors_chart if over else errors_chart)(found, title, name),
        study_choice(found, scene.tolerance, name.removeprefix("methods").strip("-").replace("-", " "))])


def _frequencies(scene: JoinedScene, system: System, model: Substructure | None) -> list[dict[str, Any]]:
    """The natural frequencies of the full system in the band, and beside them those of a reduced model."""
    own = elastic(normal_modes(system, band=(scene.band[0], scene.band[1])))
    rows: list[dict[str, Any]] = [{"mode": i, "omega": omega} for i, omega in enumerate(own, start=1)]
    if model is None:
        return rows
    theirs = all_frequencies(model)
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
    if np.isnan(found.full.critical):
        return []
    return [f"full: critical {found.parameter} {found.full.critical:.6g}, largest Re λ in the band {found.full.growth:.6g}"]


def _port_words(found: Study) -> list[str]:
    """What `reduce` warns of, once for all rows."""
    worst = max(found.rows, key=lambda row: row.port_error, default=None)
    if worst is None or worst.port_error <= PORT_LIMIT:
        return []
    return [f"the static response to the belt is off by up to {100 * worst.port_error:.2g} % ({worst.label} with {worst.size} "
            "DOF). Set ports = true, or put the contact into the interface"]


def _methods(scene: JoinedScene, system: System, choices: Mapping[str, Choice]) -> list[tuple[dict[str, Method], int]]:
    """For each row a mapping of parts to methods, and its number of modes."""
    made: dict[tuple[tuple[str, Method], ...], int] = {}
    for name in scene.methods:
        for row, count in enumerate(scene.modes):
            mapping = {part: _made(sub, own.method or name, own.modes[min(row, len(own.modes) - 1)] if own.modes else count)
                       for part, sub in system.parts.items() if (own := choices.get(part, Choice())).method != "full"}
            made.setdefault(tuple(mapping.items()), count)
    return [(dict(pairs), count) for pairs, count in made.items()]


def _with_contact_modes(system: System, rows: Sequence[tuple[Mapping[str, Method], int]], contacts: Contacts
                        ) -> Iterator[tuple[Mapping[str, Method], Method] | Method]:
    """Each row's reduction of the parts and then of the system to so many contact modes; and contact modes alone."""
    for parts, count in rows:
        room = sum((parts[name].modes or 0) + len(sub.interface) if name in parts else sub.size
                   for name, sub in system.parts.items())
        yield parts, ContactModes(min(count, room - 1), contacts=contacts)
    for count in dict.fromkeys(count for _, count in rows):
        yield ContactModes(min(count, system.size - 1), contacts=contacts)


def _made(part: Substructure, key: str, modes: int) -> Method:
    """The method with so many modes, or with all that the part has."""
    kind = METHODS[key]
    if kind.held:
        return kind(min(modes, len(part.interior)))
    room = part.size - (normal_modes(part, count=min(1, part.size)).rigid if modes > part.size - RIGID else RIGID)
    return kind(min(modes, max(room, 0)))
