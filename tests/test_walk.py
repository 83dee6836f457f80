"""How far a component travels through the files while it is reduced: each file that is entered again has to be read again."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cached_property
from inspect import getattr_static
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import femsub as fs
from femsub.model.pencil import Pencil
from femsub.model.substructure import Substructure

PACKAGE = Path(fs.__file__).parent
STEPS = ("femsub.reduction", "femsub.modes")  # the rooms whose objects are made of the component
FILES, RETURNS = 14, 15  # later work may lower them


def visits(work: Callable[[], object], given: tuple[object, ...]) -> list[str]:
    """The files in the order in which calls lead into them with the component, its matrices, or what a step has made of it.

    Reading a property is no visit.
    """
    found: list[str] = []

    def belongs(value: object) -> bool:
        return any(value is one for one in given) or isinstance(value, Substructure | Pencil) \
            or (not isinstance(value, type) and type(value).__module__.startswith(STEPS))

    def seen(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(str(PACKAGE)) or code.co_name.startswith("<"):
            return
        arguments = [frame.f_locals.get(name) for name in code.co_varnames[:code.co_argcount + code.co_kwonlyargcount]]
        read = arguments and isinstance(getattr_static(type(arguments[0]), code.co_name, None), property | cached_property)
        file = str(Path(code.co_filename).relative_to(PACKAGE))
        if not read and found[-1:] != [file] and any(map(belongs, arguments)):
            found.append(file)

    sys.setprofile(seen)
    try:
        work()
    finally:
        sys.setprofile(None)
    return found


def test_a_component_travels_through_the_files_of_its_method_while_it_is_reduced(capsys: pytest.CaptureFixture[str]) -> None:
    steel, mesh = fs.Material(2.1e11, 0.3, 7850.0), fs.block((1.0, 0.1, 0.1), (6, 2, 2), "hexahedron")

    def solid() -> fs.Substructure:
        return fs.solid(mesh, steel, interface=["left"])

    method, sub = fs.CraigBampton(modes=4), solid()
    fs.reduce(solid(), method)  # what is imported late is imported
    found = visits(lambda: fs.reduce(sub, method), (sub, sub.M, sub.K, sub.D))
    with capsys.disabled():
        print(f"\nreduce: a component enters {len(set(found))} files, and comes back {len(found) - len(set(found))} times")
    assert len(set(found)) <= FILES, sorted(set(found))
    assert len(found) - len(set(found)) <= RETURNS, found
    assert {"reduction/reduce.py", "reduction/method.py", "reduction/craig_bampton.py",
            "modes/shift_invert.py", "modes/normal_modes.py"} <= set(found)
