"""Your own component: M, D and K from files, reduced and judged like every other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from femsub import Substructure, read_component
from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.component import ComponentRun, ComponentScene
from femsub.io import FORMATS, model_files


@dataclass(frozen=True)
class MatricesScene(ComponentScene):
    """A component whose matrices M, D and K are in files, in any consistent units."""

    M: str = key("", "the file of the mass matrix, relative to the scene file: Matrix Market, SciPy, MATLAB, Nastran OP4, "
                 "Abaqus, CalculiX", required=True, example="M.mtx", file=True)
    K: str = key("", "the file of the stiffness matrix", required=True, example="K.mtx", file=True)
    D: str = key("", "the file of the damping matrix", otherwise="no damping", example="D.mtx", file=True)
    dofs: str = key("", "the file of the DOF map, where the matrices do not carry it in themselves: .dof, or 'node,component' a "
                    "line", example="K.dof", file=True)
    massless: bool = key(False, "whether M may leave out DOF of K")
    drop_empty: bool = key(False, "whether DOF with neither mass, damping nor stiffness are left out")
    interface: list[int | str] = key([], "interface DOF: counted from 0, or by the map as '12:uz', '12.3' (node and direction) "
                                     "or '12:*'", least=0, otherwise="none", example=[0])
    port: list[int | str] = key([], "the DOF under the belt, as for interface: the port is w with 1 there", least=0,
                                required=True, example=[1])
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/time", least=0, form="[lo, hi]",
                            required=True, example=[0.0, 1000.0])
    ports: bool = False
    format: str = key("mtx", "what the output reduced-matrices writes", choices=lambda _: FORMATS)

    OUTPUTS: ClassVar[tuple[str, ...]] = ("critical-slope", "eigenvalues", "error-time")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("modes", "frequency-response", "reduced-matrices")

    def run(self, progress: Progress) -> Result:
        return MatricesRun(self, progress).study()

    def component(self) -> tuple[Substructure, None]:
        """The component, checked."""
        paths = {name: Path(self.folder) / getattr(self, name) for name in ("M", "K", "D", "dofs") if getattr(self, name)}
        return read_component(**paths, interface=self.interface, ports={"belt": self.port}, name=self.name,
                              massless=self.massless, drop_empty=self.drop_empty), None


class MatricesRun(ComponentRun):
    """The outputs of a component, and its reduced matrices."""

    scene: MatricesScene

    def reduced_matrices(self) -> Result:
        files = {f"{method.key}-{method.modes}/{file}": writer
                 for method, model in self.reduced for file, writer in model_files(model, self.scene.format).items()}
        folders = sorted({file.split("/")[0] for file in files})
        return Result({"reduced-matrices": folders}, [f"reduced matrices, with --out: {', '.join(folders)}"], files)
