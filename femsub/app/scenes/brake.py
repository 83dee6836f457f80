"""A disc brake: disc, two pads, and Coulomb friction between them; flutter over μ, full and reduced."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub import studies
from femsub.app.keys import key
from femsub.app.scene import Picture, Progress, Result, Run, Scene, Shown, Writer
from femsub.app.scenes.component import RIGID, least_stable, lowest_figure, motion_files, page_mode, vtu
from femsub.app.scenes.joined_parts import by_kind, contact_modes, with_contact_modes
from femsub.checks import NOT_CHECKED, Array
from femsub.coupling import brake_meshes, opposite
from femsub.errors import FemsubWarning, InputError, PortWarning, warn
from femsub.model import family_of
from femsub.reduction import METHODS
from femsub.studies import Loss, Remark, Row, Study, Table, column, span

PADS = ("inboard", "outboard")
UNUSED = "the friction of a brake is Coulomb's, with mu, pressure and turning"


@dataclass(frozen=True)
class BrakeScene(Scene):
    """A disc of grey cast iron (radius 150 mm) held at its hub, two pads of friction material on steel plates, in SI units.

    The pads are held by springs: on the mean motions of their sets, along x, y and z. Materials: grey cast iron EN-GJL-250 by
    EN 1561, steel by EN 1993-1-1. Friction materials differ widely and are not isotropic (SAE paper 962130): 5 GPa, 0.25 and
    2,500 kg/m³ are assumed. So is the contact stiffness of rough surfaces, of the size of E/thickness of the lining.
    """

    size: float = key(0.025, "length of the elements of femsub's own brake", unit="m", above=0)
    disc: str = key("", "a mesh file of your own disc, relative to the scene file", otherwise="femsub's own", example="disc.vtu",
                    file=True)
    inboard: str = key("", "that of the pad on the first track", otherwise="femsub's own", required_with="disc",
                       example="inboard.vtu", file=True)
    outboard: str = key("", "that of the pad on the second track", otherwise="femsub's own", required_with="disc",
                        example="outboard.vtu", file=True)
    hub: str = key("hub", "the disc's set that is held")
    tracks: list[str] = key(["inboard", "outboard"], "the disc's sets under the pads", form="[inboard, outboard]")
    face: str = key("face", "the pads' set on the disc")
    sprung: list[str] = key(["back", "leading", "trailing"], "the pads' sets that are held by springs")
    springs: float = key(1e7, "stiffness of each of these springs, along x, y and z", unit="N/m", above=0)
    E: list[float] = key([1.1e11, 5e9, 2.1e11], "Young's moduli", unit="Pa", above=0, form="[disc, lining, plate]")
    nu: list[float] = key([0.26, 0.25, 0.3], "Poisson's ratios", above=-1, below=0.5, form="[disc, lining, plate]")
    rho: list[float] = key([7200.0, 2500.0, 7850.0], "densities", unit="kg/m³", above=0, form="[disc, lining, plate]")
    rayleigh: list[float] = key([10.0, 1e-7], "[alpha, beta] of the damping D = αM + βK of the disc", unit="1/s, s", least=0,
                                form="[alpha, beta]")
    rayleigh_pads: list[float] = key([50.0, 1e-6], "the same of the pads", unit="1/s, s", least=0, form="[alpha, beta]")
    contact: float = key(2e11, "normal stiffness of the contact per area", unit="N/m³", above=0)
    pressure: float = key(1e6, "pressure between pads and disc, for the damping by friction", unit="Pa", least=0)
    turning: float = key(50.0, "angular velocity of the disc about z, for the damping by friction", unit="rad/s", above=0)
    mu: list[float] = key([0.0, 0.7], "the range of the coefficient of friction", least=0, form="[lo, hi]")
    points: int = key(29, "values of mu in the flutter diagram of the reduced model", least=2)
    full: list[float] = key([0.2, 0.4, 0.6], "values of mu at which the full model is solved; modes are shown at the last one",
                            least=0, distinct=True)
    band: list[float] = key([1e3, 5e4], "the frequencies that are looked at", unit="rad/s", least=0, form="[lo, hi]")
    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin"])
    modes: list[int] = key([60, 100], "numbers of real modes of the brake in contact; each part keeps as many of its "
                           "own", least=1)
    tolerance: float = key(1e-2, "relative error of the critical μ that the recommended model may have", above=0)
    units: str = "SI"

    OUTPUTS: ClassVar[tuple[str, ...]] = ("unstable", "error-time", "flutter")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("losses",)
    WITHOUT: ClassVar[Mapping[str, str]] = dict.fromkeys(("slope", "law", "eps", "speed", "force"), UNUSED) | {
        "repeats": "each model of the brake is made once"}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.units == "mm-t-s" and not self.disc:
            raise InputError("femsub's own brake is in SI units: leave units out, or give meshes and all data in mm, t and s")

    def run(self, progress: Progress) -> Result:
        brake = Brake(self, progress)
        points = len(brake.contact_nodes)
        data: dict[str, Any] = {"system": repr(brake.system), "size": brake.system.size, "contact_nodes": points,
                                "band": self.band, "contacts": [repr(one) for one in brake.contacts(self.full[-1])]}
        return brake.result(data, [
            f"{self.name}: {brake.system!r}\n"
            f"{points} node{'s' * (points != 1)} of the disc under the pads, contact stiffness {self.contact:g}, "
            f"pressure {self.pressure:g}, disc at {self.turning:g} rad/time; band {span(self.band)}; full model at μ = "
            f"{', '.join(f'{mu:g}' for mu in self.full)}"])


class Brake(Run):
    """The models and the outputs of a run."""

    scene: BrakeScene

    def __post_init__(self) -> None:
        scene = self.scene
        self.range, self.band = (scene.mu[0], scene.mu[1]), (scene.band[0], scene.band[1])
        self.say("building the parts")
        self.meshes: dict[str, fs.Mesh] = brake_meshes(scene.size) if not scene.disc else {
            name: fs.read_mesh(Path(scene.folder) / getattr(scene, name)) for name in ("disc", *PADS)}
        for name, surface in zip(PADS, scene.tracks, strict=True):
            met = opposite(self.meshes[name], scene.face, self.meshes["disc"], surface)
            self.meshes["disc"] = self.meshes["disc"].with_sets(**{f"under-{name}": met})
        self.system.check_held(self.contacts(1.0), "the pad")

    @property
    def contact_nodes(self) -> Array:
        """The nodes under the pads, as rows of all meshes one after the other; the disc is the first."""
        return np.concatenate([self.meshes["disc"].sets[f"under-{name}"] for name in PADS])

    @cached_property
    def system(self) -> fs.System:
        """The full model: the parts on their springs."""
        springs = [fs.Spring((name, f"{place}-{axis}"), stiffness=self.scene.springs)
                   for name in PADS for place in self.scene.sprung for axis in "xyz"]
        parts = {name: self.part(name) for name in ("disc", *PADS)}
        return fs.couple(parts, [*self.contacts(0.0), *springs], self.scene.name)

    def part(self, name: str) -> fs.Substructure:
        """The disc or a pad by itself."""
        scene, mesh = self.scene, self.meshes[name]
        iron, lining, plate = (fs.Material(*one) for one in zip(scene.E, scene.nu, scene.rho, strict=True))
        if name == "disc":
            return fs.solid(mesh, iron, supports=[scene.hub], interface=[f"under-{pad}" for pad in PADS],
                         rayleigh=(scene.rayleigh[0], scene.rayleigh[1]), name=name)
        return fs.solid(mesh, {"lining": lining, "plate": plate}, interface=[scene.face], name=name,
                     ports={f"{place}-{axis}": (place, axis) for place in scene.sprung for axis in "xyz"},
                     rayleigh=(scene.rayleigh_pads[0], scene.rayleigh_pads[1]))

    def contacts(self, mu: float) -> list[fs.FrictionContact]:
        """Between the face of each pad and the track that turns under it."""
        scene = self.scene
        return [fs.FrictionContact(f"{name}.{scene.face}", f"disc.under-{name}", self.meshes, scene.contact, mu, scene.pressure,
                                axis=np.array([0.0, 0.0, 1.0]), speed=scene.turning) for name in PADS]

    @cached_property
    def affine(self) -> fs.Affine:
        """The best reduced model over μ."""
        return family_of(self.best, self.contacts(0.0), ["mu"], {"mu": self.range})

    @cached_property
    def all_critical(self) -> fs.CriticalValue:
        """All losses and regains of the best reduced model; proved to be all if that was asked for."""
        self.say("all losses of stability")
        solver = "auto" if "losses" in self.scene.outputs else "followed"
        return fs.critical_value(self.affine, None, "mu", between=self.range, band=self.band, solver=solver)

    @cached_property
    def compared(self) -> Study:
        """The full model and those reduced by each method, part by part, and then by contact modes."""
        scene, system, contacts = self.scene, self.system, self.contacts(0.0)
        parts = [({part: METHODS[name](min(modes, len(sub.interior) - RIGID)) for part, sub in system.parts.items()}, modes)
                 for name in scene.methods for modes in scene.modes]
        methods = [*with_contact_modes(system, parts, contacts),
                   *(contact_modes(system, modes, contacts, friction=False) for modes in scene.modes)]
        return fs.study(system, methods, self.band, contacts=contacts, parameter="mu", values=scene.full, between=self.range,
                        ports=True, repeats=1, progress=self.say)

    @cached_property
    def exact(self) -> dict[float, fs.ComplexModes]:
        """The full model's modes in the band at some values of μ."""
        if "error-time" in self.scene.outputs:
            return dict(zip(self.scene.full, self.compared.spectra, strict=True))
        self.say(f"full model of {self.system.size} DOF")
        return {mu: fs.complex_modes(self.system, self.contacts(mu), band=self.band) for mu in self.scene.full}

    @cached_property
    def counted(self) -> fs.ComplexModes:
        """Those at the last μ with evidence: a comparison, which measures seconds, leaves the count of a large model out."""
        modes = self.exact[self.scene.full[-1]]
        if modes.evidence != NOT_CHECKED:
            return modes
        self.say(f"count of the full model's modes at μ = {self.scene.full[-1]:g}")
        return fs.complex_modes(self.system, self.contacts(self.scene.full[-1]), band=self.band)

    @cached_property
    def best(self) -> fs.Substructure:
        """The largest model of contact modes of the full system."""
        if (row := self.best_row) is not None:
            return self.compared.models[self.compared.rows.index(row)]
        self.say(f"contact modes with {self.scene.modes[-1]} modes")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PortWarning)
            return fs.reduce(self.system, contact_modes(self.system, self.scene.modes[-1], self.contacts(0.0)))

    @cached_property
    def best_row(self) -> Row | None:
        """Its row, if models are compared."""
        rows = self.compared.rows if "error-time" in self.scene.outputs else ()
        return max((row for row in rows if row.method == fs.ContactModes.key), key=lambda row: row.modes, default=None)

    @cached_property
    def critical(self) -> dict[str, Loss]:
        """The first loss of stability in the band: of the best reduced model, and of the full one."""
        if (row := self.best_row) is not None:
            own, full = (Loss(one.critical, one.omega, one.reason) for one in (row, self.compared.full))
        else:
            self.say("the critical μ")
            look = partial(studies.first_loss, contacts=self.contacts(0.0), parameter="mu", between=self.range, band=self.band)
            own = look(self.best)
            full = look(self.system, near=own.value)
        if full.reason and np.isfinite(own.value):
            warn(f"the critical μ of the full model was not found: {full.reason}", FemsubWarning)
        return {"reduced": own, "full": full}

    def unstable(self) -> Result:
        """The table of unstable modes of the full model at the last μ, their figure and their files."""
        scene, system, mu, modes = self.scene, self.system, self.scene.full[-1], self.counted
        chosen = modes.unstable
        chosen = chosen[np.argsort(modes.eigenvalues[chosen].imag)]
        # the share of each part in the kinetic energy
        energy = {f"energy_{name}": np.einsum("ik,ik->k", u.conj(), system.parts[name].M @ u).real
                  for name, u in system.expand(modes.shapes[:, chosen]).items()}
        total = sum(energy.values())
        rows = [{"mu": mu, "omega": value.imag, "hertz": value.imag / (2 * np.pi), "growth": value.real, "error_bar": bar,
                 "damping": -2 * value.real / abs(value), **{key: float((one / total)[i]) for key, one in energy.items()}}
                for i, (value, bar) in enumerate(zip(modes.eigenvalues[chosen], modes.error_bar[chosen], strict=True))]
        head = (f"Unstable modes of the full model at μ = {mu:g} in the band: {len(rows)} of {len(modes)}; completeness "
                f"{modes.evidence}")
        # the least stable mode of the full model, for a page
        files: dict[str, Writer] = {}
        if (at := least_stable(modes)) is not None:
            (_, (mesh, fields)), = by_kind(system, self.meshes, modes.shapes[:, [at]]).items()
            files = page_mode(scene, mesh, fields[..., 0], f" of the full model at μ = {mu:g}", modes.eigenvalues[at])
        data = {"unstable": rows, "completeness": modes.evidence}
        complete = Remark.of_completeness(modes.evidence, f" at μ = {mu:g}")
        if not rows:
            return Result(data, [f"{head}. All modes decay; give a larger μ, or less damping", complete, Remark(
                ["The full model has no unstable mode in the band."])], files)
        columns = ("hertz", column("growth", form=".5g"), "error_bar", "damping", *(column(key, form=".2f") for key in energy))
        shown: list[Shown] = [
            head, Table("unstable", rows, columns, "Unstable modes of the full model"), complete,
            Remark([f"At μ = {mu:g} the full model has {len(rows)} unstable mode{'s' * (len(rows) != 1)} in the band."])]
        if not scene.figures:
            return Result(data, shown, files)
        (_, (mesh, fields)), = by_kind(system, self.meshes, modes.shapes[:, chosen]).items()
        flat = fields.reshape(-1, fields.shape[-1])
        largest = np.take_along_axis(flat, np.abs(flat).argmax(axis=0)[None], axis=0)[0]  # displacement of each mode
        fields = fields * np.exp(-1j * np.angle(largest))
        names = [f"{row['hertz']:.5g} Hz" for row in rows]
        titles = [f"{name}, Re λ = {row['growth']:.4g} 1/s" for name, row in zip(names, rows, strict=True)]
        title = f"{scene.name}: unstable modes at μ = {mu:g}, at the phase of the largest displacement"
        shown.append(Picture("unstable", lambda: lowest_figure(
            mesh, fields.real, titles, title, {"contact": self.contact_nodes})))
        views = {"real-part": fields.real, "imaginary-part": fields.imag, "phase": np.degrees(np.angle(fields))}
        files["unstable.vtu"] = partial(vtu, mesh, {f"{view} {name}": values[..., i] for view, values in views.items()
                                                    for i, name in enumerate(names)})
        worst = int(np.argmax([row["growth"] for row in rows]))
        return Result(data, shown, files | motion_files(mesh, fields[..., worst], float(rows[worst]["omega"]), names[worst],
                                                        "most-unstable"))

    def error_time(self) -> Result:
        """Each method and number of modes against the full model."""
        scene, found = self.scene, self.compared
        known = f"its critical μ is {found.full.critical:.5f}" if np.isfinite(found.full.critical) else \
            "it has no critical μ in the range"
        head = (f"Reduced models against the full one, which takes {found.full.solution.median:.1f} s per μ; {known}. Parts "
                "reduced by a method are then reduced by contact modes")
        rows, choice = found.flat, studies.study_choice(found, scene.tolerance)
        data = {"error-time": {"parameter": "mu", "values": scene.full, "rows": rows, "left_out": found.left_out,
                               "recommendation": choice.sentence, "recommended": choice.row}}
        return Result(data, [head, str(found), choice.sentence, Table("error-time", rows, title="Error against run time"),
                             studies.friction_errors_chart(found, scene.name, "error-time"), choice])

    def flutter(self) -> Result:
        """Eigenvalues over μ of the best reduced model, and of the full one where it was solved; the critical μ of both."""
        scene, small, affine = self.scene, self.best, self.affine
        self.say("modes of the reduced model over μ")
        followed = fs.track(affine, None, "mu", np.linspace(*self.range, scene.points), band=self.band)
        curves = zip(followed.values, (values[np.isfinite(values)] for values in followed.eigenvalues), strict=True)
        crosses = [(mu, modes.eigenvalues) for mu, modes in self.exact.items()]
        rows = [{"model": name, "mu": float(mu), "omega": float(value.imag), "growth": float(value.real)}
                for name, found in (("reduced", curves), ("full", crosses)) for mu, values in found for value in values]
        own, full = self.critical["reduced"], self.critical["full"]
        if np.isfinite(own.value):
            exact, error = "not found for the full model, ", ""
            if np.isfinite(full.value):
                exact = f"full model {full.value:.6g}, "
                error = f" (error {abs(own.value - full.value) / full.value:.1e})"
            words = (f"Critical μ in the band: {exact}reduced model of {small.size} DOF {own.value:.6g}{error}, at "
                     f"{own.omega / (2 * np.pi):.5g} Hz")
        else:
            words = f"No mode in the band flutters for {scene.mu[0]:g} ≤ μ ≤ {scene.mu[1]:g}"
        critical = {key: {"mu": one.value, "omega": one.omega} for key, one in self.critical.items()}
        name = f"reduced to {small.size} DOF"
        lost = {name: [*self.all_critical.losses, *self.all_critical.regains]} if np.isfinite(own.value) else {}
        losses = ", ".join(f"of the {key} model at μ = {one.value:.6g}" for key, one in self.critical.items()
                           if np.isfinite(one.value))
        return Result({"flutter": {"rows": rows, "critical": critical}}, [
            words, repr(followed).replace(" over mu ", " over μ "),
            Remark([f"Loss of stability in the flutter diagram: {losses}."] if losses else ()),
            Table("flutter", rows, title="Eigenvalues over μ"),
            studies.flutter_chart("flutter", {name: followed}, lost, "μ  [-]", scene.name, {
                f"full model of {self.system.size} DOF": crosses})])

    def losses(self) -> Result:
        """All losses and regains of stability of the best reduced model, and the proof that there are no others."""
        found = self.all_critical
        rows = [{"what": what, "mu": one.value, "omega": one.omega, "kind": one.kind}
                for what, several in (("loss", found.losses), ("regain", found.regains)) for one in several]
        columns = (column("what", form="s"), column("mu", form=".6g"), "omega", column("kind", form="s"))
        return Result({"losses": {"evidence": found.evidence, "rows": rows}}, [
            f"Losses of stability: {found!r}", Table("losses", rows, columns, "Losses of stability")])
