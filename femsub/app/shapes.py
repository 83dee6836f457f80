"""Mode shapes as pictures, as VTU files, and in motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import femsub as fs
from femsub.app.result import Picture
from femsub.checks import Array

if TYPE_CHECKING:
    from femsub.io import Writer

Drawn = tuple[fs.Mesh, Array]  # a mesh, and the shapes on it (nodes, 3, k)


def pictures(name: str, drawn: Mapping[str, Drawn], titles: Sequence[str], title: str, marks: Mapping[str, Array],
             fields: Sequence[str], most: int = 6) -> tuple[list[Picture], dict[str, Writer]]:
    """A picture of the first `most` real shapes and a VTU file of all, for each kind of mesh."""
    found, files = list[Picture](), dict[str, Any]()
    for kind, (mesh, shapes) in drawn.items():
        at = f"{name}-{kind}" if len(drawn) > 1 else name
        found.append(Picture(at, partial(fs.components.shapes_figure, mesh, shapes[..., :most], titles[:most], title,
                                         marks if len(drawn) == 1 else {})))
        files[f"{at}.vtu"] = fs.io.mesh_writer(mesh, dict(zip(fields, np.moveaxis(shapes, -1, 0), strict=True)))
    return found, files


def complex_pictures(name: str, drawn: Mapping[str, Drawn], words: str, title: str, marks: Mapping[str, Array],
                     omega: float) -> tuple[list[Picture], dict[str, Writer]]:
    """The real and the imaginary part of one complex shape, as a picture and a VTU file, and its motion over a period."""
    found, files = list[Picture](), dict[str, Any]()
    for kind, (mesh, fields) in drawn.items():
        at = f"{name}-{kind}" if len(drawn) > 1 else name
        shape = fs.components.turned(fields[..., :1])[..., 0]
        small = float(np.linalg.norm(shape.imag, axis=1).max()) or 1.0
        parts = np.stack([shape.real, shape.imag / small], axis=-1)
        titles = ["real part", f"imaginary part, drawn {1 / small:.3g} times larger"]
        found.append(Picture(at, partial(fs.components.shapes_figure, mesh, parts, titles, title,
                                         marks if len(drawn) == 1 else {})))
        files[f"{at}.vtu"] = fs.io.mesh_writer(mesh, {f"real-part {words}": shape.real, f"imaginary-part {words}": shape.imag})
        if omega > 0:
            files |= fs.io.motion_files(mesh, shape, omega, words, at)
    return found, files


def several_pictures(name: str, drawn: Mapping[str, Drawn], titles: Sequence[str], title: str, marks: Mapping[str, Array],
                     words: Sequence[str]) -> tuple[list[Picture], dict[str, Writer]]:
    """Pictures of several complex shapes, each at the phase of its largest displacement.

    The VTU files have real and imaginary parts, and phases in degrees.
    """
    many = {kind: (mesh, fs.components.turned(fields)) for kind, (mesh, fields) in drawn.items()}
    real = {kind: (mesh, fields.real) for kind, (mesh, fields) in many.items()}
    found, files = pictures(name, real, titles, title, marks, words)
    for file, (mesh, fields) in zip(files, many.values(), strict=True):
        views = {"real-part": fields.real, "imaginary-part": fields.imag, "phase": np.degrees(np.angle(fields))}
        files[file] = fs.io.mesh_writer(mesh, {f"{view} {word}": shapes[..., i] for view, shapes in views.items()
                                         for i, word in enumerate(words)})
    return found, files


def page_mode(paged: bool, drawn: Mapping[str, Drawn], title: str, eigenvalue: complex) -> dict[str, Writer]:
    """The file of the first complex shape for the page, if the scene asks for a page."""
    if not paged or not drawn:
        return {}
    mesh, fields = next(iter(drawn.values()))
    return fs.io.mode_file(mesh, fields[..., 0], f"least stable mode{title}", complex(eigenvalue))
