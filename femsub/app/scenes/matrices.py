"""Your own component: M, D and K from files, reduced and judged like every other."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from femsub import Substructure, read_component
from femsub.app.scene import Progress, Result
from femsub.app.scenes.component import ComponentScene, Work
from femsub.app.scenes.outputs import run_component
from femsub.checks import choice
from femsub.errors import InputError
from femsub.io.model_folder import FORMATS, matrix_files


@dataclass(frozen=True)
class MatricesScene(ComponentScene):
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
    """

    M: str = ""
    K: str = ""
    D: str = ""
    dofs: str = ""
    massless: bool = False
    interface: list[int | str] = field(default_factory=list)
    port: list[int | str] = field(default_factory=list)
    ports: bool = False
    format: str = "mtx"
    folder: str = "."

    OUTPUTS: ClassVar[tuple[str, ...]] = ("critical-slope", "eigenvalues", "error-time")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("modes", "reduced-matrices")

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("M", "K"):
            if not getattr(self, key):
                raise InputError(f"scene key {key!r} is missing: name the file of the matrix")
        if not self.band:
            raise InputError("scene key 'band' must be [lo, hi] in rad per unit of time: it says where models are compared")
        if not self.port:
            raise InputError("scene key 'port' is missing: name the DOF under the belt, counted from 0")
        choice("format", self.format, FORMATS)

    def component(self) -> tuple[Substructure, None]:
        """The component, checked."""
        paths = {key: Path(self.folder) / getattr(self, key) for key in ("M", "K", "D", "dofs") if getattr(self, key)}
        return read_component(paths["M"], paths["K"], paths.get("D"), dofs=paths.get("dofs"), interface=self.interface,
                              ports={"belt": self.port}, name=self.name, massless=self.massless), None


SCENE = MatricesScene


def run(scene: MatricesScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    return run_component(scene, progress, {"reduced-matrices": _written})


def _written(work: Work) -> Result:
    assert isinstance(work.scene, MatricesScene)
    files = {f"{method.key}-{method.modes}/{file}": writer
             for method, model in work.reduced for file, writer in matrix_files(model, work.scene.format).items()}
    folders = sorted({file.split("/")[0] for file in files})
    return Result({"reduced-matrices": folders}, [], f"reduced matrices, with --out: {', '.join(folders)}", {}, files)
