"""Mode shapes as pictures, as VTU files, and in motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, BinaryIO

import numpy as np

import femsub as fs
from femsub.app.moving import mode_file
from femsub.app.result import Picture
from femsub.checks import Array
from femsub.components import shapes_figure, turned
from femsub.io import Writer

Drawn = tuple[fs.Mesh, Array]  # a mesh, and the shapes on it (nodes, 3, k)


def pictures(name: str, drawn: Mapping[str, Drawn], titles: Sequence[str], title: str, marks: Mapping[str, Array],
             fields: Sequence[str]) -> tuple[list[Picture], dict[str, Writer]]:
    """A picture of the first real shapes and a VTU file of all, for each kind of mesh."""
    found, files = list[Picture](), dict[str, Writer]()
    for kind, (mesh, shapes) in drawn.items():
        at = f"{name}-{kind}" if len(drawn) > 1 else name
        found.append(Picture(at, partial(lowest_figure, mesh, shapes, titles, title, marks if len(drawn) == 1 else {})))
        files[f"{at}.vtu"] = partial(vtu, mesh, dict(zip(fields, np.moveaxis(shapes, -1, 0), strict=True)))
    return found, files


def lowest_figure(mesh: fs.Mesh, shapes: Array, titles: Sequence[str], title: str, marks: Mapping[str, Array],
                  most: int = 6) -> Any:
    """A picture of the first `most` of real shapes (nodes, 3, k): more would be too small to be seen."""
    return shapes_figure(mesh, shapes[..., :most], titles[:most], title, marks)


def complex_pictures(name: str, drawn: Mapping[str, Drawn], words: str, title: str, marks: Mapping[str, Array],
                     omega: float) -> tuple[list[Picture], dict[str, Writer]]:
    """The real and the imaginary part of one complex shape, as a picture and a VTU file, and its motion over a period."""
    found, files = list[Picture](), dict[str, Writer]()
    for kind, (mesh, fields) in drawn.items():
        at = f"{name}-{kind}" if len(drawn) > 1 else name
        shape = turned(fields[..., :1])[..., 0]
        small = float(np.linalg.norm(shape.imag, axis=1).max()) or 1.0
        parts = np.stack([shape.real, shape.imag / small], axis=-1)
        titles = ["real part", f"imaginary part, drawn {1 / small:.3g} times larger"]
        found.append(Picture(at, partial(shapes_figure, mesh, parts, titles, title, marks if len(drawn) == 1 else {})))
        files[f"{at}.vtu"] = partial(vtu, mesh, {f"real-part {words}": shape.real, f"imaginary-part {words}": shape.imag})
        if omega > 0:
            files |= motion_files(mesh, shape, omega, words, at)
    return found, files


def page_mode(paged: bool, drawn: Mapping[str, Drawn], title: str, eigenvalue: complex) -> dict[str, Writer]:
    """The file of the first complex shape for the page, if one is asked for."""
    if not paged or not drawn:
        return {}
    mesh, fields = next(iter(drawn.values()))
    return mode_file(mesh, fields[..., 0], f"least stable mode{title}", complex(eigenvalue))


def vtu(mesh: fs.Mesh, shapes: Mapping[str, Array], file: BinaryIO) -> None:
    """Writes a mesh with fields on it."""
    file.write(fs.io.mesh_bytes(mesh, shapes))


def motion_files(mesh: fs.Mesh, shape: Array, omega: float, named: str, title: str, phases: int = 12) -> dict[str, Writer]:
    """Re(u e^(iωt)) at so many `phases` of a period: a .pvd file, which ParaView animates, and the file of each phase in it."""
    bare = fs.Mesh(mesh.points, mesh.cells, mesh.kind)
    times = {f"{title}/phase-{k:02d}.vtu": 2 * np.pi * k / phases / omega for k in range(phases)}

    def phase(time: float, file: BinaryIO) -> None:
        vtu(bare, {f"displacement {named}": (shape * np.exp(1j * omega * time)).real}, file)

    def series(file: BinaryIO) -> None:
        file.write(fs.io.series_bytes(times))

    files: dict[str, Writer] = {f"{title}.pvd": series}
    return files | {name: partial(phase, time) for name, time in times.items()}
