"""The paper's study: a chain on a belt, full and reduced, by complex modes and critical slopes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from femsub import Belt, Mesh, ReducedSubstructure, Substructure, chain, complex_modes, reduce, studies, study, sweep
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Run, Scene, Writer
from femsub.app.scenes.component import NO_GROWTH, comparable, least_stable, page_mode
from femsub.coupling import LAWS
from femsub.errors import InputError, PortWarning
from femsub.modes import relative_error
from femsub.reduction import METHODS
from femsub.studies import Loss, Study, Table, column, span


@dataclass(frozen=True)
class MassKeys(Scene):
    """The chain of `femsub.chain`."""

    n: int = key(10, "number of masses", least=1, most=10**7)
    masses: float | list[float] = key(1.0, "the masses: one value, or n of them", unit="mass", above=0)
    springs: float | list[float] = key(1.0, "the springs: one value, or n of them; the first holds mass 1", unit="force/length",
                                       least=0)
    damping: float = key(0.1, "the dashpot d1 at mass 1", unit="force·time/length", least=0)
    belt: int = key(2, "the mass under the belt; masses count from 1", least=1)

    @property
    def three_pairs(self) -> list[float]:
        """The band of the lowest three pairs of a uniform chain; what lies higher no small model can follow."""
        return [0.0, float(2 * np.sin(6 * np.pi / (4 * self.n + 2)))]

    @property
    def words(self) -> str:
        """The chain in the first line of what is printed."""
        return f"{self.name}: {self.n} masses, dashpot {self.damping:g} at m1"


@dataclass(frozen=True)
class ChainKeys(MassKeys):
    """The chain and its reduced models."""

    interface: list[int] = key([1], "masses through which the chain is joined", least=1, distinct=True)
    size: int = key(0, "DOF of the reduced models", least=0, otherwise="5, as in the paper, or n if that is less")

    def __post_init__(self) -> None:
        super().__post_init__()
        self.fill(size=min(5, self.n))
        self.check_size("size", self.size, len(self.interface) + (self.n > 1))

    def check_size(self, key: str, size: int, least: int) -> None:
        """Refuses reduced models of more DOF than the chain has, or of too few."""
        if size > self.n:
            raise InputError(f"{key}: {size} DOF means more modes than there are; the chain has {self.n} masses")
        if size < least:
            raise InputError(f"{key}: {size} DOF leave no room for the interface of {len(self.interface)} and the belt")

    def model(self, belt: int, widened: bool = False) -> Substructure:
        """The chain with the belt under a mass, with the paper's interface or with the belt's mass joined to it."""
        interface = [*self.interface, *[belt] * (widened and belt not in self.interface)]
        return chain(self.n, belt, self.damping, masses=self.masses, springs=self.springs, interface=interface, name=self.name)

    def reduced(self, sub: Substructure, method: str, size: int) -> ReducedSubstructure:
        """The model with `size` DOF by one of METHODS."""
        modes = size - len(sub.interface)
        with warnings.catch_warnings():
            # The contact outside the interface is what this scene shows; its error is in the results.
            warnings.simplefilter("ignore", PortWarning)
            return reduce(sub, METHODS[method](modes))


@dataclass(frozen=True)
class ChainScene(ChainKeys):
    """The paper's chain on a belt, with the interface given and next to it the one with the belt's mass."""

    belts: list[int] = key([], "places of the belt in the belt sweep and in the table of critical slopes; belt is for the other "
                           "outputs", least=1, otherwise="1 to the smaller of n and 10")
    sizes: list[int] = key([], "DOF of the reduced models in the size sweep and in the error against time; size is for the other "
                           "outputs", least=1, otherwise="from one more than the interface to the smaller of n and 10")
    band: list[float] = key([], "the frequencies in which eigenvalues are compared", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="the lowest three pairs of a uniform chain")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("friction", "critical-slope", "belt-sweep", "size-sweep", "eigenvalues", "error-time")
    PAPER: ClassVar[Mapping[str, str]] = {"friction": "Fig. 2", "belt-sweep": "Fig. 3a", "size-sweep": "Fig. 3b",
                                          "eigenvalues": "Fig. 4"}

    def __post_init__(self) -> None:
        super().__post_init__()
        most = min(self.n, 10)
        self.fill(belts=list(range(1, most + 1)), sizes=list(range(len(self.interface) + 1, most + 1)), band=self.three_pairs)
        for size in self.sizes:
            self.check_size("sizes", size, len(self.interface))

    def run(self, progress: Progress) -> Result:
        for belt in (self.belt, *self.belts):
            self.model(belt)  # bad values end here, before any work
        data: dict[str, Any] = {
            "n": self.n, "masses": self.masses, "springs": self.springs,
            "damping": self.damping, "interface": self.interface, **self.friction, "methods": self.methods,
            "size": self.size, "band": self.band}
        return ChainRun(self, progress).result(data, [
            f"{self.words}, interface {masses(self.interface)}, {self.friction_words}"])


class ChainRun(Run):
    """The outputs of the chain."""

    scene: ChainScene

    def __post_init__(self) -> None:
        self.band, self.contact = (self.scene.band[0], self.scene.band[1]), self.scene.linear_belt

    def compute(self, output: str) -> Result:
        self.say(output)
        return super().compute(output)

    def models(self, belt: int) -> list[Substructure]:
        """The chain with the paper's interface, and with the belt's mass in it where that is another one."""
        return [self.scene.model(belt, widened) for widened in (False, True)[:1 + (belt not in self.scene.interface)]]

    def border(self, model: Substructure) -> Loss:
        """Critical slope and frequency in the scene's band; NaN and the reason where there is none to be had."""
        return studies.first_loss(model, self.contact, "slope", None, self.band)

    def friction(self) -> Result:
        scene = self.scene
        side = np.concatenate([np.geomspace(1e-5, 0.05, 60), np.linspace(0.06, 1.0, 95)])
        speeds = np.concatenate([-side[::-1], [0.0], side])
        titles = {name: getattr(law, "label", name) for name, law in LAWS.items()}
        curves = [{"law": name, "eps": eps, "value": LAWS[name](eps=eps).value(speeds)}
                  for name in LAWS for eps in sorted({1e-1, 1e-2, 1e-3, scene.eps}, reverse=True)]
        return Result({"friction": {"speed": speeds, "curves": curves}}, [
            studies.friction_chart(speeds, curves, titles, scene.speed, self.contact.slope or 0.0)])

    def critical_slope(self) -> Result:
        rows: list[dict[str, Any]] = []
        for belt in self.scene.belts:
            for sub in self.models(belt):
                exact = self.border(sub)
                for method in self.scene.methods:
                    rom = self.scene.reduced(sub, method, self.scene.size)
                    found = self.border(rom)
                    rows.append({"belt": belt, "interface": place(sub), "method": method, "size": rom.size, "slope": found.value,
                                 "omega": found.omega, "full": exact.value, "error": relative_error(found.value, exact.value),
                                 "port_error": rom.port_error["belt"], "reason": found.reason or exact.reason})
        columns = (column("belt", cell=lambda row: f"m{row['belt']}"), "interface", "method", "size",
                   column("slope", "critical slope", ".6f"), column("full", form=".6f"), "error", "port_error")
        return Result({"critical-slope": {"rows": rows}}, [
            f"Critical slopes dμ/dv in the band {span(self.band)}",
            Table("critical-slope", rows, columns, "Critical slopes", keys=4),
            *dict.fromkeys(f"no critical slope: {row['reason']}" for row in rows if row["reason"]),
            studies.belt_places_chart(rows, masses(self.scene.interface))])

    def belt_sweep(self) -> Result:
        slopes, scene, panels = -np.geomspace(1e-3, 0.4, 60), self.scene, []
        for widened in (False, True):
            for kind in ("full", *scene.methods):
                growth, border = [], []
                for belt in scene.belts:
                    sub = scene.model(belt, widened)
                    model = sub if kind == "full" else scene.reduced(sub, kind, scene.size)
                    reached = self.band[1] <= model.cutoff  # else its modes above the cut-off would have a say
                    growth.append(sweep(model, Belt(force=scene.force, slope=0.0), "slope", slopes, band=self.band).growth
                                  if reached else np.full(len(slopes), np.nan))
                    border.append(self.border(model).value)
                panels.append({"model": kind, "interface": "{m1, belt}" if widened else masses(scene.interface),
                               "growth": np.array(growth), "critical_slope": border})
        found = {"slopes": slopes, "belts": scene.belts, "panels": panels}
        return Result({"belt-sweep": found}, [studies.belt_sweep_chart(found)])

    def size_sweep(self) -> Result:
        scene, curves = self.scene, list[dict[str, Any]]()
        for sub in self.models(scene.belt):
            exact = self.border(sub).value
            for method in scene.methods:
                sizes = [size for size in scene.sizes if size >= len(sub.interface)]
                found = [self.border(scene.reduced(sub, method, size)).value for size in sizes]
                curves.append({"interface": place(sub), "method": method, "sizes": sizes, "slope": found,
                               "full": exact, "error": [relative_error(value, exact) for value in found]})
        rows = [{"belt": scene.belt, "interface": curve["interface"], "method": curve["method"], "size": size, "slope": slope,
                 "full": curve["full"], "error": error} for curve in curves
                for size, slope, error in zip(curve["sizes"], curve["slope"], curve["error"], strict=True)]
        wide = [{"interface": curve["interface"], "method": curve["method"],
                 **{str(size): error for size, error in zip(curve["sizes"], curve["error"], strict=True)}} for curve in curves]
        columns = ("interface", "method", *(column(str(size), f"{size} DOF", ".1e") for size in scene.sizes))
        return Result({"size-sweep": {"curves": curves, "rows": rows}}, [
            f"Relative error of the critical slope in the band {span(self.band)}, belt under m{scene.belt}",
            Table("", wide, columns, keys=2,
                  none="the band reaches above the model's cut-off, or the model has no DOF beside its interface"),
            Table("size-sweep", rows, title="Critical slope over the model's size"),
            studies.size_sweep_chart(curves, scene.belt)])

    def eigenvalues(self) -> Result:
        scene, belt, models = self.scene, self.contact, list[dict[str, Any]]()
        files: dict[str, Writer] = {}
        for sub in self.models(scene.belt):
            exact = complex_modes(sub, belt, band=(0.0, 1.5 * self.band[1]) if scene.n > 300 else None)
            at = least_stable(exact)
            if not files and at is not None and scene.n > 1:  # for a page: the chain lies along x, and its masses move so
                nodes = np.arange(scene.n)
                line = Mesh(nodes[:, None] + 1.0, np.stack([nodes[:-1], nodes[1:]], axis=1), "line")
                u = exact.shapes[:, at, None] * np.array([1.0, 0.0, 0.0])
                files = page_mode(scene, line, u, f" of the full model, belt under m{scene.belt}", exact.eigenvalues[at])
            for kind in ("full", *scene.methods):
                model = sub if kind == "full" else scene.reduced(sub, kind, scene.size)
                modes = exact if kind == "full" else complex_modes(model, belt)
                limit = min(model.cutoff, float(exact.frequencies.max(initial=0.0)))
                models.append({"model": kind, "interface": place(sub), "size": model.size, "cutoff": model.cutoff,
                               **comparable(exact, modes, limit)})
        said = Table("", models, (
            "interface", "model", "size", column("up_to", form=".4g"), "counted", "full_counted",
            column("growth", "largest Re λ", ".4f"), column("full_growth", form=".4f"), "is_stable",
            column("backward_error", cell=lambda row: float(row["backward_error"].max(initial=0.0)))), keys=3, none=NO_GROWTH)
        panels = [{**model, "panel": f"interface {model['interface']}"} for model in models]
        rows = [{"belt": scene.belt, "interface": m["interface"], "method": m["model"],
                 **{key: m[key] for key in ("size", "up_to", "growth", "full_growth", "is_stable")}} for m in models]
        return Result({"eigenvalues": {"belt": scene.belt, "models": models, "rows": rows}}, [
            f"Complex modes, belt under m{scene.belt}, dμ/dv = {belt.slope:.5g}", said,
            Table("eigenvalues", rows, title="Eigenvalues"),
            studies.eigenvalue_chart(panels, f"belt under m{scene.belt}, dμ/dv = {belt.slope:.4g}"),
            studies.stability_remark(models)], files)

    def error_time(self) -> Result:
        scene, compared = self.scene, dict[str, Study]()
        for sub in self.models(scene.belt):
            methods = [METHODS[name](size - len(sub.interface)) for name in scene.methods for size in scene.sizes
                       if size >= len(sub.interface)]
            compared[place(sub)] = study(sub, methods, self.band, contacts=self.contact, repeats=scene.repeats, held=True,
                                         progress=self.progress)
        rows = [{"interface": interface, **row} for interface, found in compared.items() for row in found.flat]
        said = "\n\n".join(f"Error against run time, interface {interface}\n{found}" for interface, found in compared.items())
        choices = {name: studies.study_choice(found, where=f"interface {name}") for name, found in compared.items()}
        recommended = [{"interface": name, "sentence": one.sentence, "model": one.row} for name, one in choices.items()]
        data = {"rows": rows, "band": scene.band, "repeats": scene.repeats, "recommended": recommended}
        return Result({"error-time": data}, [said, Table("error-time", rows, title="Error against run time"),
                                             studies.error_time_chart(list(compared.items())), *choices.values()])


def masses(numbers: Any) -> str:
    """'{m1, m3}'."""
    return "{" + ", ".join(f"m{int(number)}" for number in numbers) + "}"


def place(sub: Substructure) -> str:
    """The interface of a chain by its masses."""
    return masses(sub.interface + 1)
