"""Checks of names in scene files: each name must exist, and every part must be joined to the others."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

from femsub.app.asks import check_bounds, parameter_of
from femsub.app.contacts import ContactKind
from femsub.app.ends import GROUND, End
from femsub.checks import InputError, unknown_name

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.io import Faults


def check_names(scene: Scene, faults: Faults) -> None:
    """Notes as faults all unknown names, parts that are joined to nothing, and asks that the scene does not allow."""
    meshes: dict[str, Any] = {}
    for name, part in scene.parts.items():
        with faults.at(("part", name)):
            meshes[name] = mesh = scene.mesh(name)
            known = {**mesh.sets, **mesh.groups} if mesh is not None else {}
            for key, one in part.sets_named() if mesh is not None else ():
                if one not in known:
                    faults.add(("part", name, key), unknown_name("set", one, known))
        for material in part.materials:
            if material not in scene.materials:
                faults.add(("part", name, "material"), unknown_name("material", material, scene.materials))
    links: list[set[str]] = []
    for family, several in (("joint", scene.joints), ("contact", scene.contacts)):
        for name, joint in several.items():
            ports = joint.places if isinstance(joint, ContactKind) else []
            for end in (*ports, *joint.surfaces):
                with faults.at((*scene.place(family, name), type(joint).KIND)):
                    check_end(scene, end, meshes, end in ports)
            links.append({End.of(end).part for end in (*ports, *joint.surfaces)} - {GROUND})
    if not faults.found:
        if not scene.parts and not all(ask.alone for ask in scene.asks):
            faults.add((), "there is no part: give a table such as [part.disc], or scene = \"chain\" or another name of `femsub "
                       "scenes`")
        if not scene.asks:
            faults.add((), f"nothing is asked: give a table [[ask]] with one of {', '.join(scene.kinds.names('ask'))}")
    for name in lone(scene, links) if not faults.found else ():
        faults.add(("part", name), "it is joined to nothing: give a joint or a contact that names it, or take it out")
    if not faults.found:
        for name, given in scene.parameters.items():
            if not given.acts:
                with faults.at(("parameter", name)):
                    parameter_of(scene, name)
                    check_bounds(scene, name, [*given.between, *([] if given.value is None else [given.value])])
        for at, ask in enumerate(scene.asks):
            with faults.at(("ask", at)):
                ask.check(scene)
    for at, ask in enumerate(scene.asks if not faults.found and not scene.variant else ()):
        with faults.at(("ask", at, "vary")):
            if empty := [path for path, values in ask.vary.items() if not values]:
                raise InputError(f"{empty[0]!r} has no values")
            for values in product(*ask.vary.values()) if ask.vary else ():
                scene.varied(dict(zip(ask.vary, values, strict=True)))


def lone(scene: Scene, links: Sequence[set[str]]) -> list[str]:
    """Parts that are not connected to the largest group of joined parts, and that no ask names."""
    named = {name for ask in scene.asks for name in ask.parts_named()}
    groups = [{name} for name in scene.parts if name not in named]
    for link in links:
        met = [group for group in groups if group & link]
        if len(met) > 1:
            groups = [group for group in groups if group not in met] + [set().union(*met)]
    largest: set[str] = max(groups, key=len, default=set())
    return [name for name in scene.parts if name not in named | largest]


def check_end(scene: Scene, words: str, meshes: Mapping[str, Any], port: bool) -> None:
    """Refuses an end of a joint or contact that does not exist, or that cannot be joined."""
    if words == GROUND:
        return
    end, every = End.of(words), scene.table.get("part", {})
    if end.part not in scene.parts:
        if end.part in every:
            return  # it has faults of its own
        raise unknown_name("part", end.part, every)
    part = scene.parts[end.part]
    if type(part).KIND == "affine":
        raise InputError(f"{end.part!r} is a pencil of matrices, which can be neither joined nor under a contact")
    if port:
        part.check_port(end.part, end.rest if end.mark == "." else words)
    elif end.mark == ":":
        if not re.fullmatch(r"\s*\d+(\s*,\s*\d+)*\s*", end.rest):
            raise InputError(f"{words!r} must list DOF behind the colon, counted from 0, as '{end.part}:0,4,5'")
    elif end.mark and end.rest not in part.port_names and end.part in meshes:
        part.end(end.rest, None if meshes[end.part] is None else meshes[end.part].sets)
