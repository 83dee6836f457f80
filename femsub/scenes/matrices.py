"""Your own component: M, D and K from files, reduced and judged like every other."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from femsub.bases import METHODS, reduce
from femsub.cea import complex_modes
from femsub.errors import InputError, PortWarning
from femsub.friction import Belt
from femsub.report import machine, table
from femsub.scene import Result, Scene
from femsub.stability import critical_slope
from femsub.studies import study
from femsub.substructure import Substructure

Progress = Callable[[str], None]


@dataclass(frozen=True)
class MatricesScene(Scene):
    """A component whose matrices are in files: Matrix Market (.mtx), SciPy (.npz) or NumPy (.npy).

    Attributes
    ----------
    M, K, D : str
        Files, relative to the scene file. D may be left out.
    interface : list of int
        Interface DOF, counted from 0.
    port : int or list of int
        The DOF under the belt, counted from 0: the port is w with 1 there.
    modes : list of int
        Numbers of modes to compare, for each method.
    band : list of float
        Frequencies (rad per unit of time) in which the models are compared.
    """

    M: str = ""
    K: str = ""
    D: str = ""
    interface: list[int] = field(default_factory=list)
    port: list[int] = field(default_factory=list)
    modes: list[int] = field(default_factory=lambda: [10, 20])
    band: list[float] = field(default_factory=list)
    folder: str = "."

    OUTPUTS: ClassVar[tuple[str, ...]] = ("critical-slope", "eigenvalues", "error-time")

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("M", "K"):
            if not getattr(self, key):
                raise InputError(f"scene key {key!r} is missing: name the file of the matrix")
        if len(self.band) != 2:
            raise InputError("scene key 'band' must be [lo, hi] in rad per unit of time: it says where models are compared")
        if not self.port:
            raise InputError("scene key 'port' is missing: name the DOF under the belt, counted from 0")

    def model(self) -> Substructure:
        """The component, checked."""
        read = {key: _read(Path(self.folder) / getattr(self, key), key) for key in ("M", "K", "D") if getattr(self, key)}
        size = read["M"].shape[0]
        w = np.zeros(size)
        for number in self.port:
            if not 0 <= number < size:
                raise InputError(f"port: there is no DOF {number}; the model has {size}, counted from 0")
            w[number] = 1.0
        return Substructure(read["M"], read["K"], read.get("D"), self.interface, {"belt": w}, self.name)


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
    models: list[tuple[str, Substructure]] = [("full", sub)]
    if {"critical-slope", "eigenvalues"} & set(scene.outputs):
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
    return Result(data, rows, "\n\n".join(text), drawings)


def _read(path: Path, key: str) -> Any:
    """A matrix from .mtx, .npz or .npy.

    Raises
    ------
    InputError
        No such file, an unknown ending, or a file that cannot be read as one.
    """
    if not path.is_file():
        raise InputError(f"{key}: there is no file {path}")
    try:
        if path.suffix == ".mtx":
            from scipy.io import mmread

            return mmread(path)
        if path.suffix == ".npz":
            from scipy.sparse import load_npz

            return load_npz(path)
        if path.suffix == ".npy":
            return np.load(path, allow_pickle=False)
    except (ValueError, OSError, KeyError, EOFError) as error:
        raise InputError(f"{key}: {path} cannot be read as a matrix ({error})") from None
    raise InputError(f"{key}: {path.name} has an unknown ending; .mtx, .npz and .npy are read")
