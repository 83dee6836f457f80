"""Your own component: M, D and K from files, reduced and judged like every other."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from femsub.bases import METHODS, reduce
from femsub.cea import complex_modes
from femsub.components import read_component
from femsub.errors import InputError, PortWarning, unknown_name
from femsub.files import Writer
from femsub.friction import Belt
from femsub.modelfiles import FORMATS, matrix_files
from femsub.report import machine, table
from femsub.scene import Result, Scene
from femsub.stability import critical_slope
from femsub.studies import study
from femsub.substructure import Substructure

Progress = Callable[[str], None]


@dataclass(frozen=True)
class MatricesScene(Scene):
    """A component whose matrices are in files, as `read_component` takes them.

    Attributes
    ----------
    M, K, D : str
        Files, relative to the scene file: Matrix Market, SciPy, MATLAB, Nastran OP4, Abaqus, CalculiX. D may be left out.
    dofs : str
        The file of the DOF map, where the matrices do not carry it in themselves: .dof or 'node,component' a line.
    massless : bool
        Whether M may leave out DOF of K.
    interface : list of int or str
        Interface DOF, counted from 0, or by the map as "12:uz", "12.3" (node and direction) or "12:*".
    port : int or str, or a list of them
        The DOF under the belt: the port is w with 1 there.
    format : str
        What the output "reduced-matrices" writes: mtx, npz, mat or op4.
    modes : list of int
        Numbers of modes to compare, for each method.
    band : list of float
        Frequencies (rad per unit of time) in which the models are compared.
    """

    M: str = ""
    K: str = ""
    D: str = ""
    dofs: str = ""
    massless: bool = False
    interface: list[int | str] = field(default_factory=list)
    port: list[int | str] = field(default_factory=list)
    modes: list[int] = field(default_factory=lambda: [10, 20])
    band: list[float] = field(default_factory=list)
    format: str = "mtx"
    folder: str = "."

    OUTPUTS: ClassVar[tuple[str, ...]] = ("critical-slope", "eigenvalues", "error-time")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("reduced-matrices",)

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("M", "K"):
            if not getattr(self, key):
                raise InputError(f"scene key {key!r} is missing: name the file of the matrix")
        if len(self.band) != 2:
            raise InputError("scene key 'band' must be [lo, hi] in rad per unit of time: it says where models are compared")
        if not self.port:
            raise InputError("scene key 'port' is missing: name the DOF under the belt, counted from 0")
        if self.format not in FORMATS:
            raise unknown_name("format", self.format, FORMATS)

    def model(self) -> Substructure:
        """The component, checked."""
        paths = {key: Path(self.folder) / getattr(self, key) for key in ("M", "K", "D", "dofs") if getattr(self, key)}
        return read_component(paths["M"], paths["K"], paths.get("D"), dofs=paths.get("dofs"), interface=self.interface,
                              ports={"belt": self.port}, name=self.name, massless=self.massless)


SCENE = MatricesScene


def run(scene: MatricesScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    progress(f"{scene.name}: reading")
    sub, slope, band = scene.model(), scene.friction_slope(), (scene.band[0], scene.band[1])
    belt = Belt(force=scene.force, slope=slope)
    methods = [METHODS[name](modes) for name in scene.methods for modes in scene.modes]
    data: dict[str, Any] = {"scene": scene.name, "machine": machine(), "model": repr(sub), "slope": slope,
                            "force": scene.force, "band": band}
    text, rows, drawings = [repr(sub)], [], {}
    files: dict[str, Callable[[], bytes]] = {}
    models: list[tuple[str, Substructure]] = [("full", sub)]
    if {"critical-slope", "eigenvalues", "reduced-matrices"} & set(scene.outputs):
        progress(f"{scene.name}: reducing")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PortWarning)  # the figure is in the table
            models += [(method.__class__.__name__, reduce(sub, method)) for method in methods]
    if "critical-slope" in scene.outputs:
        progress(f"{scene.name}: critical slope")
        found = [(name, model, critical_slope(model, band=band, force=scene.force)) for name, model in models]
        data["critical-slope"] = [{"model": name, "size": model.size, "slope": border.slope, "omega": border.omega}
                                  for name, model, border in found]
        text.append(table(["model", "DOF", "critical slope", "at ω", "static port error"],
                          [[name, model.size, border.slope, border.omega, getattr(model, "port_error", {}).get("belt", 0.0)]
                           for name, model, border in found], ["s", "d", ".6g", ".5g", ".1e"]))
    if "eigenvalues" in scene.outputs:
        progress(f"{scene.name}: complex modes")
        spectra: list[dict[str, Any]] = []
        for name, model in models:
            modes = complex_modes(model, belt, band=band)
            spectra.append({"model": name, "size": model.size, "growth": modes.growth, "is_stable": modes.is_stable,
                            "eigenvalues": modes.eigenvalues, "error_bar": modes.error_bar, "certified": modes.certified,
                            "backward_error": modes.backward_error, "above_cutoff": modes.above_cutoff})
        data["eigenvalues"] = spectra
        text.append(table(["model", "DOF", "largest Re λ", "stable", "eigenvalues", "certified"],
                          [[m["model"], m["size"], m["growth"], str(m["is_stable"]), len(m["eigenvalues"]), str(m["certified"])]
                           for m in spectra], ["s", "d", ".4g", "s", "d", "s"]))
    if "error-time" in scene.outputs:
        result = study(sub, methods, band, belt=belt, repeats=scene.repeats, progress=progress)
        rows = [{"output": "error-time", **row.flat()} for row in (result.full, *result.rows)]
        data["error-time"] = rows
        text.append(str(result))

        def draw() -> Any:
            from femsub.figures import error_time_figure
            return error_time_figure([(f"of {len(sub.interface)} DOF", result)])

        drawings["error-time"] = draw
    if "reduced-matrices" in scene.outputs:
        for method, (name, model) in zip(methods, models[1:], strict=True):
            below = f"{name}-{method.modes}"
            files |= {f"{below}/{file}": partial(_content, writer) for file, writer in matrix_files(model, scene.format).items()}
        data["reduced-matrices"] = sorted({file.split("/")[0] for file in files})
        text.append(f"reduced matrices, with --out: {', '.join(data['reduced-matrices'])}")
    return Result(data, rows, "\n\n".join(text), drawings, files)


def _content(writer: Writer) -> bytes:
    file = io.BytesIO()
    writer(file)
    return file.getvalue()
