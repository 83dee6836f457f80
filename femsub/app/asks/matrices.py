"""The matrices of the reduced models as files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.checks import InputError
from femsub.io import FORMATS, model_files

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class MatricesAsk(Ask):
    """M, D, K, V and the DOF map of each reduced model, in a folder for each."""

    matrices: str = key("mtx", "the format", choices=lambda _: FORMATS)

    KIND: ClassVar[str] = "matrices"
    NEEDS: ClassVar[tuple[str, ...]] = ("reduce",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if len(scene.parts) > 1:
            raise InputError("matrices can be written only for a scene with one part")

    def run(self, models: Models) -> Result:
        files = {f"{one.kind}-{one.modes}/{file}": writer for one in models.reduced
                 for file, writer in model_files(one.model, self.matrices).items()}
        folders = sorted({file.split("/")[0] for file in files})
        return Result({"matrices": folders}, [f"reduced matrices, with --out: {', '.join(folders)}"], files)
