"""Reductions in several steps, of a model or of the parts of a system, with names and mode counts for tables."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from femsub.coupling import System
from femsub.model import Contact, ReducedSubstructure, Substructure
from femsub.output import label
from femsub.reduction.contact_modes import ContactModes
from femsub.reduction.method import Method
from femsub.reduction.reduce import reduce
from femsub.reduction.reductor import Reductor

Step: TypeAlias = Method | Mapping[str, Method]


def methods_of(steps: Sequence[Step]) -> list[Method]:
    """The methods of all steps, part by part."""
    return [one for step in steps for one in (step.values() if isinstance(step, Mapping) else [step])]


def reduced_by(model: Substructure, steps: Sequence[Step], contacts: Sequence[Contact], ports: bool, workers: int | None = None,
               bases: Bases | None = None) -> Substructure:
    """The model after all steps. A tolerance holds under the contacts. For contact modes, `ports` means the contacts' ports."""
    if bases is not None:
        bases.lent = 0.0
    for step in steps:
        places = [name for contact in contacts for name in contact.ports]
        joining: Any = places if isinstance(step, ContactModes) and ports and contacts else ports
        judged: Any = contacts or None  # a tolerance holds under these contacts; ContactModes has contacts of its own
        if bases is not None and isinstance(step, Method) and step.modes is not None:
            model = bases.first(model, step, joining)
            continue
        if bases is not None and isinstance(model, System) and isinstance(step, Mapping) and \
                all(one.modes is not None for one in step.values()):
            step = {name: bases.first(model.parts[name], one, ports) for name, one in step.items()}  # type: ignore[misc]
        tolerance = isinstance(step, Method) and step.band is not None and not isinstance(step, ContactModes)
        model = reduce(model, step, joining, judged if tolerance else None, workers=workers)  # type: ignore[arg-type]
    return model


class Bases:
    """Reductors for a list of reductions: one for each model and method, with the largest number of modes requested.

    `lent` is the time in seconds of bases that the last model used, but that were computed for an earlier model.
    """

    def __init__(self, methods: Sequence[Sequence[Step]]) -> None:
        self.asked = [one for steps in methods for one in methods_of(steps)]
        self.made: list[tuple[Substructure, Reductor, float]] = []
        self.lent = 0.0

    def first(self, model: Substructure, method: Method, ports: Any) -> ReducedSubstructure:
        """The model reduced by a method with a number of modes; an existing reductor is used if there is one."""
        found = next((one for one in self.made if one[0] is model and _alike(one[1].task.method, method)), None)
        if found is None:
            most = max((one for one in self.asked if _alike(one, method)), key=lambda one: one.modes or 0)
            start = time.perf_counter()
            basis = Reductor(model, most, ports)
            self.made.append((model, basis, time.perf_counter() - start))
        else:
            _, basis, seconds = found
            self.lent += seconds
        return basis.first(method.modes or 0)


def _alike(one: Method, other: Method) -> bool:
    """Whether two methods have numbers of modes, and are otherwise equal."""
    return one.modes is not None and other.modes is not None and type(one) is type(other) and \
        replace(one, modes=other.modes) == other


def key_of(steps: Sequence[Step]) -> str:
    """The key of the first step; 'mixed' if the parts have methods with different keys, 'full' without any step."""
    keys = {one.row_key for one in methods_of(steps[:1])} if steps else {"full"}
    return keys.pop() if len(keys) == 1 else "mixed"


def step_name(steps: Sequence[Step]) -> str:
    """The label of the method; for a mixed key, each part with its method."""
    return in_words(steps) if key_of(steps) == "mixed" else label(key_of(steps))


def in_words(steps: Sequence[Step]) -> str:
    """'Craig-Bampton with 4 modes', or 'disc by Craig-Bampton with 4 modes, pad by Rubin with 2 modes'."""
    said = []
    for step in steps:
        names = {name: str(one) for name, one in step.items()} if isinstance(step, Mapping) else {"": str(step)}
        alike = len(set(names.values())) == 1 and isinstance(step, Mapping)
        said.append(f"each part by {next(iter(names.values()))}" if alike else
                    ", ".join(f"{name} by {one}" if name else one for name, one in names.items()))
    return ", then ".join(said)


def kept_modes(model: Substructure) -> dict[str, int]:
    """The number of elastic modes in a reduced model, by its name, or in each reduced part of a system."""
    if isinstance(model, System):
        return {name: sum(kept_modes(part).values()) for name, part in model.parts.items()
                if isinstance(part, (System, ReducedSubstructure))}
    return {model.name: model.modes} if isinstance(model, ReducedSubstructure) else {}


def port_error(model: Substructure, port: str) -> float:
    """The static error at a port in the energy norm; for a system, the error of the part that has the port."""
    if isinstance(model, System):
        name, _, rest = port.partition(".")
        return port_error(model.parts[name], rest) if name in model.parts else 0.0
    return model.port_error.get(port, 0.0) if isinstance(model, ReducedSubstructure) else 0.0


def twins(one: Substructure, other: Substructure, tol: float = 1e-6) -> bool:
    """Whether two reduced models of one part are the same model in different coordinates, q = T p.

    Shapes, M and K differ by at most the relative `tol`, to allow for rounding and for errors of the eigensolver.
    """
    if one.size != other.size or not isinstance(one, ReducedSubstructure) or not isinstance(other, ReducedSubstructure):
        return False
    T = np.linalg.lstsq(one.V, other.V, rcond=None)[0]
    pairs = [(one.V @ T, other.V), *((T.T @ A @ T, B) for A, B in ((one.M, other.M), (one.K, other.K)))]
    return all(np.linalg.norm(A - B) <= tol * np.linalg.norm(B) for A, B in pairs)
