"""The audit of reduced models: the scene's own, superelements, or matrices from files of any program."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.audit_command import ModelFiles
from femsub.app.kinds import key
from femsub.app.result import Remark, Result, Table, column
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models

EXAMPLE, PARTS = "example", "parts"


@dataclass(frozen=True)
class AuditAsk(Ask):
    """Checks of reduced models: which properties hold, which do not, and which cannot be known."""

    audit: str | ModelFiles = key(PARTS, "'parts': each part that is a superelement, and each reduced model against the full "
                                  "one; the files of a model; or 'example', a steel beam whose basis lacks one mode",
                                  choices=lambda _: (PARTS, EXAMPLE))
    full: ModelFiles = key(None, "the files of the full model", otherwise="not known", example={"M": "full-M.mtx",
                                                                                                "K": "full-K.mtx"})
    cutoff: float = key(0.0, "the cut-off: all modes below it are kept, as the author states", unit="rad/time", least=0,
                        otherwise="the cut-off that the model states")
    mass: float = key(0.0, "the mass that the part should have", unit="mass", least=0, otherwise="not stated")
    floating: str = key("", "whether the part is unsupported (floats)", choices=lambda _: ("yes", "no"), otherwise="not stated",
                        example="yes")
    gyroscopic: bool = key(False, "whether the part turns, so that D may be unsymmetric")

    KIND: ClassVar[str] = "audit"

    @property
    def alone(self) -> bool:  # type: ignore[override]
        """Whether the scene may be without parts."""
        return self.audit != PARTS

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if self.audit == PARTS and not scene.reduce.methods and not any(
                type(part).KIND == "superelement" for part in scene.parts.values()):
            raise InputError("audit needs reduced models, [reduce], or a part that is a superelement")

    def run(self, models: Models) -> Result:
        units = models.scene.units.system
        if self.audit == PARTS:
            return self.of_parts(models, units)
        reduced, full = example() if self.audit == EXAMPLE else (self.matrices(models), self.whole(models))
        models.say("checking")
        found = fs.audit(reduced, full, mass=self.mass or None, cutoff=self.cutoff or None, gyroscopic=self.gyroscopic,
                         floating={"yes": True, "no": False}.get(self.floating), units=units)
        checks, frequencies = found.tables()
        listed = ["", f"{frequencies.title}:", frequencies] if len(found.omega) else []
        charts = [found.chart()] if any(map(math.isfinite, found.lower)) else []
        return Result({"audit": found.record()}, [found.answer, checks, *listed, *charts])

    def matrices(self, models: Models) -> Any:
        """The reduced model from files: a model of `write_matrices`, or a dict of its matrices."""
        own, folder = self.audit, models.scene.folder
        assert isinstance(own, ModelFiles)
        if own.model:
            return fs.read_component((folder / own.model).parent)
        fs.io.refuse_exchanged(folder / own.M, folder / own.K)
        found: dict[str, Any] = {name: fs.read_matrix(folder / getattr(own, name)) for name in "MKDV" if getattr(own, name)}
        dofs = fs.io.read_dofs(folder / own.dofs) if own.dofs else None
        lists = {"interface": own.interface, "kinds": own.kinds, "dofs": dofs}
        return found | {"name": models.scene.name} | {name: value for name, value in lists.items() if value}

    def whole(self, models: Models) -> fs.Substructure | None:
        """The full model from files, if there is one."""
        if self.full is None:
            return None
        folder = models.scene.folder
        if self.full.model:
            return fs.read_component((folder / self.full.model).parent)
        paths = {name: folder / file for name in ("M", "K", "D", "dofs") if (file := getattr(self.full, name))}
        return fs.read_component(**paths, interface=self.full.interface, massless=True)

    def of_parts(self, models: Models, units: str) -> Result:
        """The audits of superelements, without a full model, and of the scene's reduced models against the full one."""
        rows, checks, masses = list[dict[str, Any]](), list[dict[str, Any]](), list[str]()
        faults, unknown = list[str](), list[str]()
        given = {models.full.name: models.full} if models.alone else models.full.parts
        asked = [(name, part, None) for name, part in given.items() if isinstance(part, fs.ReducedSubstructure)]
        asked += [(f"{one.kind}, {one.modes} modes", one.model, models.full) for one in models.reduced if len(one.before) == 1
                  and models.alone]
        for name, part, full in asked:
            models.say(f"checking {name}")
            found = fs.audit(part, full, units=units)
            dofs, own = part.interface_dofs, part.full_dofs
            # a label such as 'ux@3' is of a coordinate system that the files do not define
            frames = [at for at, label in enumerate(own.labels) if "@" in label] if own else []
            rows.append({"part": name, "size": part.size, "interface": len(part.interface_numbers), "modes": part.modes,
                         "cutoff": part.cutoff, "recovered": len(part.V), "grids": len(np.unique(dofs.nodes)) if dofs else None,
                         "own_frame": int(np.isin(own.components, frames).sum()) if own else None, "trusted": found.trusted,
                         "faults": len(found.faults), "unknown": len(found.unknown)})
            checks += [{"part": name, **row} for row in found.tables()[0].rows]
            masses += [f"{name}: {one.said}" for one in found.findings if one.what == "mass and inertia"]
            faults += [f"{name}: {one.what}: {one.said}. {one.todo}." for one in found.faults]
            unknown += [f"{name}: {one.what}: {one.said}." for one in found.unknown]
        columns = ("part", "size", column("grids", "grids", "d"), "interface", "modes", "cutoff", column("recovered", "motions",
                                                                                                         "d"),
                   column("own_frame", "own frame", "d"), column("trusted", "trusted ω", ".5g", unit="rad/time"),
                   column("faults", "faults", "d"))
        return Result({"audit": {"rows": rows, "checks": checks}}, [
            "Reduced models as they were read or made, and checked:", Table("audit", rows, columns, "Audit"), *masses,
            Table("audit-checks", checks, (), "Checks"), Remark(faults, unknown)])


def example(lost: int = 3) -> tuple[Any, Any]:
    """(reduced, full): a steel beam reduced to twelve coordinates, whose third mode is removed as if it had never been there."""
    full = fs.beam(1.0, 60, E=2.1e11, I=1.7e-9, rho=7850.0, A=2e-4, supports={"left": "clamped"}, interface=["right"], rayleigh=(
        5.0, 1e-7))
    whole = fs.reduce(full, fs.CraigBampton(10))
    at = [one for one in range(whole.size) if one != len(whole.interface) + lost - 1]
    M, D, K = (A[at][:, at] for A in (whole.M, whole.D, whole.K))
    return fs.ReducedSubstructure(M, K, D, {}, whole.name, V=whole.V[:, at], kinds=tuple(whole.kinds[one] for one in at),
                                  full_interface=whole.full_interface, cutoff=whole.cutoff, method="Craig-Bampton",
                                  full_dofs=whole.full_dofs), full

