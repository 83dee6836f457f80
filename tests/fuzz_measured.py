"""Valid universal files of measurements for `fuzzing`: modes, functions in text and binary, a test model."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from fuzzing import Subject
from test_universal import BENCH, SHAPES, new_mode, numbers, old_mode, reals

import femsub as fs

WORDS = (b"    -1\n", b"    55\n", b"  2414\n", b"    58\n", b"    15\n", b"    82\n", b"NONE", b"         2", b"         0")


def read_modes(path: Path) -> Any:
    found = fs.read_modes(path)
    for note in found.notes:
        warnings.warn(note, stacklevel=1)
    points = np.zeros(0) if found.dofs.points is None else found.dofs.points
    return [found.eigenvalues, found.shapes, found.dofs.nodes, found.dofs.components, points]


def read_response(path: Path) -> Any:
    found = fs.read_response(path)
    return [found.omega, found.receptance, found.responses, found.loads]


def values_of_modes(data: bytes) -> list[tuple[int, int]]:
    """The nodes and motions of the first mode."""
    start = re.search(rb"(?m)^ +(55|2414)\n(.*\n){8,13}(?= +3\n)", data)
    assert start is not None
    stop = data.index(b"    -1", start.end())
    return [match.span() for match in re.finditer(rb"\S+", data[:stop]) if match.start() >= start.end()]


def function(response: int, h: np.ndarray, binary: bool) -> bytes:
    """Data set 58 of complex values, evenly spaced from 1 Hz."""
    raw = h.astype("<c16").tobytes()
    head = "    -1\n    58" + (f"b     1     2          11{len(raw):12d}" if binary else "") + "\n"
    head += "NONE\n" * 5 + f"    4{1:10d}{1:5d}{0:10d} {'NONE':10s}{response:10d}{3:4d} {'NONE':10s}{5:10d}{1:4d}\n"
    head += numbers(6, len(h), 1).rstrip() + reals(1.0, 0.5, 0.0)
    head += "".join(f"{kind:10d}    0    0    0 NONE                 NONE                \n" for kind in (18, 12, 13, 0))
    text = "".join(f"{value:20.11E}" for value in h.view(float)).encode() + b"\n"
    return head.encode() + (raw if binary else text) + b"    -1\n"


def subjects(folder: Path) -> list[Subject]:
    made: list[Subject] = []

    def add(name: str, content: bytes, reader: str, **how: Any) -> None:
        path = folder / name / "m.uff"
        path.parent.mkdir(parents=True)
        path.write_bytes(content)
        made.append(Subject(name, path, reader, **how))

    text = {"vocabulary": WORDS, "strict": frozenset({"word", "comma", "nul"}), "words": values_of_modes,
            "units": lambda data: re.findall(rb"(?s) *-1\n.*?\n *-1\n", data) if data.count(b"    -1\n") % 2 == 0 else [data]}
    modes = "fuzz_measured:read_modes"
    add("uff-55", (BENCH + old_mode(10.0, 0.01, SHAPES[0]) + old_mode(12.0, 0.0, SHAPES[1])).encode(), modes, **text)
    six = np.concatenate([SHAPES[0] + 1j * SHAPES[1], SHAPES[1] - 1j * SHAPES[0]], axis=1)
    add("uff-2414", (BENCH + new_mode(-1 + 40j, six) + new_mode(-2 + 90j, six.conj())).encode(), modes, **text)
    add("uff-82", BENCH.encode(), "fuzz_meshes:read", vocabulary=WORDS, strict=frozenset({"comma", "nul"}))
    h = np.random.default_rng(4).standard_normal((2, 8)).view(complex)
    for binary in (False, True):
        add(f"uff-58{'b' * binary}", b"".join(function(2 + row, h[row], binary) for row in (0, 1)), "fuzz_measured:read_response",
            text=not binary, strict=frozenset({"comma", "nul"}), vocabulary=WORDS)
    return made
