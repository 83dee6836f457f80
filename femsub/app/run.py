"""Runs a scene: all asks in the order of the file. A failure or an interruption keeps the results of the other asks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from femsub.app.asks import Ask
from femsub.app.models import Models
from femsub.app.result import Chart, Picture, Progress, Result, Shown, Table
from femsub.checks import FemsubError, Interruptible

if TYPE_CHECKING:
    from femsub.app.grammar import Scene


def run_all(scene: Scene, progress: Progress) -> Result:
    """The results of all asks.

    Failures are reported in the text and in data["failed"], an interruption by data["complete"] = False.

    Raises
    ------
    FemsubError
        The first failure, if every ask has failed; a fault of the models.
    """
    models = Models(scene, lambda text: progress(f"{scene.name}: {text}"))
    scene.__dict__["models"] = models
    data, head = introduced(models)
    parts, failed, complete = [Result({}, head)], dict[str, FemsubError](), True
    with Interruptible() as work:
        for name, ask in titled(scene.asks).items():
            models.say(ask.KIND)
            try:
                part = renamed(ask.run(models), name, ask)
            except FemsubError as error:  # the other asks do not need this one
                failed[name] = error
                part = Result({}, [f"{name}: failed; {error}"])
            parts.append(part)
            complete = part.data.get("complete", True)  # False: interrupted within it
            if not complete:
                break
    complete = complete and work.complete
    if failed and len(failed) == len(scene.asks):
        raise next(iter(failed.values()))
    for part in parts:
        data |= part.data
    if failed:
        data["failed"] = {name: f"{type(error).__name__}: {error}" for name, error in failed.items()}
    if not complete:
        data["complete"] = False
        parts.append(Result({}, ["Interrupted: these results are incomplete."]))
    every: list[Shown] = []
    for part in parts:
        every += [*[""] * bool(every and part.text()), *part.shown]
    notes = {name: note for part in parts for name, note in part.notes.items()}
    return Result(data, every, {name: file for part in parts for name, file in part.files.items()}, head, notes)


def introduced(models: Models) -> tuple[dict[str, Any], list[Shown]]:
    """A description of the model, as data and as the first printed lines."""
    scene = models.scene
    if not scene.parts:
        return {}, []
    full = models.full
    data: dict[str, Any] = {"model": repr(full), "size": full.size}
    lines: list[Shown] = [f"{scene.name}: {full!r}"]
    if not models.alone:
        data["parts"] = [{"part": name, "size": part.size, "interface": len(part.interface)} for name, part in full.parts.items()]
    else:
        data["interface"] = len(getattr(full, "interface", ()))
    if repairs := [line for mesh in models.meshes.values() for line in mesh.repairs]:
        data["repairs"] = repairs
        lines.append(f"mesh: {'; '.join(repairs)}")
    _ = models.contacts
    if models.alone and not models.pencil:
        with scene.faults.at(("reduce",)):
            models.reductions()
        scene.faults.check()  # before anything is computed
    contacts = [one.words for one in scene.contacts.values()]  # type: ignore[attr-defined]
    if contacts:
        data["contacts"] = contacts
        lines += contacts
    if scene.reduce.methods:
        counts = ", ".join(map(str, scene.reduce.sizes or scene.reduce.modes))
        lines.append(f"{scene.reduce.labels} with {counts} {'DOF' if scene.reduce.sizes else 'modes'}"
                     + (", static responses to ports joined" if scene.reduce.ports else ""))
    return data, lines


def titled(asks: list[Ask]) -> dict[str, Ask]:
    """The asks by name. The name is the ask's title; if several have the same title, later ones get a number."""
    found: dict[str, Ask] = {}
    for ask in asks:
        names = (ask.title, *(f"{ask.title}-{number}" for number in range(2, len(asks) + 1)))
        found[next(name for name in names if name not in found)] = ask
    return found


def renamed(found: Result, name: str, ask: Ask) -> Result:
    """The result with tables, figures and files named after the ask instead of after its kind."""
    def named(old: str) -> str:
        return name + old[len(ask.KIND):] if old.startswith(ask.KIND) and name != ask.KIND else old

    shown = [replace(one, name=named(one.name)) if isinstance(one, (Table, Chart, Picture)) else one for one in found.shown]
    data = {named(key): value for key, value in found.data.items()}
    files = {named(key): value for key, value in found.files.items()}
    notes = {named(one.name): ask.note for one in found.shown if ask.note and hasattr(one, "name")}
    return replace(found, data=data, shown=shown, files=files, notes=notes)
