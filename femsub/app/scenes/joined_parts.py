"""What the scenes of joined parts share: the study over methods, each applied part by part, with its table and its figure."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from femsub import Substructure, normal_modes, reduce, study
from femsub.app.figures_parts import errors_figure
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Scene, method_keys, other_method_names
from femsub.errors import FemsubError, PortWarning
from femsub.model.assembly import System
from femsub.model.friction import Belt
from femsub.reduction.reduce import METHODS, PORT_LIMIT, Method
from femsub.studies.results import Study

RIGID = 6  # rigid-body modes that a part has at most


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
    methods, left_out = _methods(scene, system, choices or {}, lambda text: progress(f"{title}: {text}"))
    found = study(system, methods, (scene.band[0], scene.band[1]), belt=belt, ports=scene.ports, repeats=scene.repeats,
                  port=belt.port if belt is not None else next(iter(system.ports), "belt"), progress=progress)
    rows = [row.flat() for row in (found.full, *found.rows)]
    parts = [{"part": part, "size": sub.size, "interface": len(sub.interface)} for part, sub in system.parts.items()]
    said = [f"{title}: {system!r}", str(found), *_full_words(found), *left_out, *_port_words(found),
            found.recommendation(scene.tolerance)]
    data = {"system": repr(system), "parts": parts, "rows": rows, "left_out": left_out,
            "recommendation": said[-1]}
    return Result({name: data}, {name: rows}, "\n".join(said), {name: lambda: errors_figure(found, title)})


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


def _methods(scene: JoinedScene, system: System, choices: Mapping[str, Choice],
             tell: Progress) -> tuple[list[dict[str, Method]], list[str]]:
    """A mapping of parts to methods for each row, without those that some part cannot be reduced by, and why."""
    made: dict[tuple[tuple[str, Method], ...], None] = {}
    left_out: list[str] = []
    for name in scene.methods:
        tell(f"{METHODS[name].label}: which modes there are")
        for row, count in enumerate(scene.modes):
            try:
                mapping = {part: _made(sub, own.method or name, own.modes[min(row, len(own.modes) - 1)] if own.modes else count)
                           for part, sub in system.parts.items()
                           if (own := choices.get(part, Choice())).method != "full"}
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", PortWarning)
                    for part, method in mapping.items() if row == 0 else ():
                        reduce(system.parts[part], method)
            except FemsubError as error:
                left_out.append(f"{METHODS[name].label} is left out: {error}")
                break
            made[tuple(mapping.items())] = None
    return [dict(pairs) for pairs in made], list(dict.fromkeys(left_out))


def _made(part: Substructure, key: str, modes: int) -> Method:
    """The method with so many modes, or with all that the part has."""
    kind = METHODS[key]
    if kind.held:
        return kind(min(modes, len(part.interior)))
    room = part.size - (normal_modes(part, count=min(1, part.size)).rigid if modes > part.size - RIGID else RIGID)
    return kind(min(modes, max(room, 0)))
