"""A component under study: its keys, and its outputs: modes, critical slope, eigenvalues, error against run time."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, BinaryIO, ClassVar

import numpy as np
import scipy.sparse as sp

import femsub as fs
from femsub import studies
from femsub.app.figures import shapes_figure
from femsub.app.keys import key
from femsub.app.moving import mode_file
from femsub.app.scene import Picture, Progress, Result, Run, Scene, Shown, Writer
from femsub.checks import Array
from femsub.components import node_rows
from femsub.errors import InputError, PortWarning
from femsub.model import MOTIONS, in_band
from femsub.modes import beside_the_full, listed, relative_error
from femsub.reduction import METHODS, Method
from femsub.studies import Advice, Remark, Table, column, label, span

RIGID = len(MOTIONS)  # rigid motions that a part has at most
BESIDE = 0.02  # relative distance of the end of the band's default from the modes below and above it
SI_DEFAULTS = ("E", "rho")  # of a scene that makes its component; other units need other numbers
NO_GROWTH = "no eigenvalue up to ω"
RATIOS = np.array([1e-4, 1e-2, 1.0, 10.0, 100.0, 1e4])  # of springs to the own static stiffness at the interface
SHOWN = ("is_stable", "eigenvalues", "error_bar", "backward_error", "above_cutoff")  # of complex modes

Drawn = tuple[fs.Mesh, Array]


@dataclass(frozen=True)
class ComponentScene(Scene):
    """What the scenes of a component share."""

    modes: list[int] = key([10, 20], "numbers of modes to compare, for each method", least=0)
    ports: bool = key(True, "whether the static response to the contact joins each basis")
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]",
                            otherwise=f"from 0 to {100 * BESIDE:g} % above the last of so many modes as elastic says, or above "
                            "the cluster that it belongs to", example=[0.0, 1e4])
    elastic: int = key(8, "elastic modes that are listed beside up to six rigid ones; the default of band holds them, and the "
                       "output joined-interface compares as many frequencies", least=1, most=1000)
    tolerance: float = key(1e-3, "relative error of the growth rates, or of the receptance, that the recommended model may have",
                           above=0)
    frequencies: int = key(400, "frequencies of the band at which receptances are compared", least=2, most=100_000)
    loss: float = key(0.0, "loss factor of the structural damping of the output frequency-response", least=0)
    sliding: bool = key(False, "whether the belt's friction acts in the output frequency-response: about the sliding state, not "
                        "at rest")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("modes", "critical-slope", "eigenvalues", "error-time", "joined-interface")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("frequency-response",)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in SI_DEFAULTS:
            if self.units == "mm-t-s" and getattr(self, name, None) == getattr(type(self), name, np.nan):
                raise InputError(f"scene key {name!r} has its default {getattr(self, name):g}, which is in SI units, but units "
                                 "is 'mm-t-s': give all lengths in mm, E in MPa and rho in t/mm³ (steel: 2.1e5 and 7.85e-9)")

    def run(self, progress: Progress) -> Result:
        return ComponentRun(self, progress).study()

    def component(self) -> tuple[fs.Substructure, fs.Mesh | None]:
        """The component with the port "belt", and the mesh to show its shapes on."""
        raise NotImplementedError


def mode_rows(found: fs.NormalModes) -> list[dict[str, Any]]:
    """The rows of a table of normal modes."""
    return [{"mode": i, "omega": omega, "rigid": i <= found.rigid, "residual": residual}
            for i, (omega, residual) in enumerate(zip(found.frequencies, found.residual, strict=True), start=1)]


def mode_views(scene: Scene, frequencies: Array, drawn: Mapping[str, Drawn], marks: Mapping[str, Array]
               ) -> tuple[list[Picture], dict[str, Writer]]:
    """A picture of the lowest modes and a VTU file of all, for each mesh and the shapes on it (nodes, 3, k)."""
    titles = [f"mode {i}: ω = {omega:.5g} rad/time" for i, omega in enumerate(frequencies, 1)]
    fields = [f"mode-{i:02d} {scene.system.frequency(omega)}" for i, omega in enumerate(frequencies, 1)]
    pictures: list[Picture] = []
    files: dict[str, Writer] = {}
    for kind, (mesh, shapes) in drawn.items():
        name = f"modes-{kind}" if len(drawn) > 1 else "modes"
        pictures.append(Picture(name, partial(lowest_figure, mesh, shapes, titles, f"{scene.name}: normal modes", marks)))
        files[f"{name}.vtu"] = partial(vtu, mesh, dict(zip(fields, np.moveaxis(shapes, -1, 0), strict=True)))
    return pictures, files


def lowest_figure(mesh: fs.Mesh, shapes: Array, titles: Sequence[str], title: str, marks: Mapping[str, Array],
                  most: int = 6) -> Any:
    """A picture of the first `most` of real shapes (nodes, 3, k): more would be too small to be seen."""
    return shapes_figure(mesh, shapes[..., :most], titles[:most], title, marks)


def page_mode(scene: Scene, mesh: fs.Mesh, u: Array, title: str, eigenvalue: complex) -> dict[str, Writer]:
    """The file of a complex shape u (nodes, 3) for the page, if one is asked for."""
    return mode_file(mesh, u, f"least stable mode{title}", complex(eigenvalue)) if scene.paged else {}


def vtu(mesh: fs.Mesh, shapes: Mapping[str, Array], file: BinaryIO) -> None:
    file.write(fs.io.mesh_bytes(mesh, shapes))


def comparable(exact: fs.ComplexModes, found: fs.ComplexModes, limit: float) -> dict[str, Any]:
    """What is shown of a model, and of it and of the full one: how many λ have 0 ≤ Im λ ≤ limit, and their largest Re λ.

    What the full model has beyond the cut-off of a reduced one is no part of the comparison.
    """
    data: dict[str, Any] = {"up_to": limit} | {key: getattr(found, key) for key in SHOWN}
    for name, modes in (("", found), ("full_", exact)):
        keep = listed(modes) & in_band(modes.eigenvalues, (0.0, limit))
        data |= {f"{name}counted": int(keep.sum()), f"{name}growth": float(modes.eigenvalues.real[keep].max(initial=-np.inf))}
    return data


def least_stable(modes: fs.ComplexModes) -> int | None:
    """The eigenvalue with the largest Re λ that oscillates."""
    moving = np.flatnonzero(~modes.rigid & (modes.eigenvalues.imag > 0))
    return int(moving[np.argmax(modes.eigenvalues.real[moving])]) if len(moving) else None


def motion_files(mesh: fs.Mesh, shape: Array, omega: float, named: str, title: str = "least-stable",
                 phases: int = 12) -> dict[str, Writer]:
    """Re(u e^(iωt)) at so many `phases` of a period: a .pvd file, which ParaView animates, and the file of each phase in it."""
    bare = fs.Mesh(mesh.points, mesh.cells, mesh.kind)
    times = {f"{title}/phase-{k:02d}.vtu": 2 * np.pi * k / phases / omega for k in range(phases)}

    def phase(time: float, file: BinaryIO) -> None:
        vtu(bare, {f"displacement {named}": (shape * np.exp(1j * omega * time)).real}, file)

    def series(file: BinaryIO) -> None:
        file.write(fs.io.series_bytes(times))

    files: dict[str, Writer] = {f"{title}.pvd": series}
    return files | {name: partial(phase, time) for name, time in times.items()}


def _frequencies(model: fs.Substructure, springs: Array, count: int) -> Array:
    B = sp.csr_array(model.interface_rows)
    added = B.T @ sp.diags_array(springs) @ B
    if not sp.issparse(model.K):
        added = added.toarray()
    modes = fs.normal_modes(fs.Substructure(model.M, model.K + added, name=model.name), count=count)
    return modes.frequencies[modes.rigid:]


class ComponentRun(Run):
    """What the outputs of a component share, made when first asked for, and the outputs."""

    scene: ComponentScene

    def __post_init__(self) -> None:
        scene = self.scene
        self.say("building the component")
        start = time.perf_counter()
        self.sub, self.mesh = scene.component()
        self.assembly = time.perf_counter() - start
        self.belt = scene.linear_belt
        self.units = scene.system
        self.slopes: list[float] | None = None  # critical ones, once an output has found them
        self.methods = [METHODS[name](modes) for name in scene.methods for modes in scene.modes]
        for count in scene.modes:
            if count > self.sub.size:
                raise InputError(f"modes: {count} are more than the {self.sub.size} DOF of {self.sub.name!r}")

    @cached_property
    def normal(self) -> fs.NormalModes:
        self.say("normal modes")
        return fs.normal_modes(self.sub, count=max(1, min(RIGID + self.scene.elastic, self.sub.size - RIGID)))

    @cached_property
    def band(self) -> tuple[tuple[float, float], str]:
        """The band and the rule it comes from."""
        if self.scene.band:
            return (self.scene.band[0], self.scene.band[1]), "as given"
        omega = self.normal.frequencies[self.normal.rigid:]
        last = min(self.scene.elastic, len(omega)) - 1
        while last + 1 < len(omega) and omega[last + 1] < (1 + 2 * BESIDE) * omega[last]:
            last += 1
        return (0.0, float((1 + BESIDE) * omega[last])), f"to {100 * BESIDE:g} % above elastic mode {last + 1}"

    @cached_property
    def reduced(self) -> list[tuple[Method, fs.ReducedSubstructure]]:
        return [(method, self.reduce(method)) for method in self.methods]

    @property
    def models(self) -> list[tuple[str, int, fs.Substructure]]:
        """'full' or the method's key, the modes kept (0 of the full model), and the model."""
        return [("full", 0, self.sub), *((method.key, rom.modes, rom) for method, rom in self.reduced)]

    def reduce(self, method: Method) -> fs.ReducedSubstructure:
        """The component by one method, as the scene has it."""
        self.say(str(method))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PortWarning)  # the figure is in the tables
            return fs.reduce(self.sub, method, ports=self.scene.ports)

    def field(self, u: Array) -> Array | None:
        """Displacements of the nodes (nodes, 3, k), the largest of each shape 1; None where there is no mesh to show them on."""
        if self.mesh is None or self.sub.dofs is None:
            return None
        found = fs.displacements(self.mesh, self.sub.dofs, u)
        largest = np.linalg.norm(found, axis=1).max(axis=0)
        return found / np.where(largest > 0, largest, 1.0)

    @property
    def marks(self) -> dict[str, Array]:
        """Nodes of the contact and of the interface, as rows of the mesh."""
        assert self.mesh is not None and self.sub.dofs is not None
        rows = {"contact": np.flatnonzero(self.sub.port("belt")), "interface": self.sub.interface}
        nodes = {key: np.unique(self.sub.dofs.nodes[at]) for key, at in rows.items()}
        known = self.mesh.numbers
        return {key: node_rows(self.mesh, at[np.isin(at, known)]) for key, at in nodes.items() if len(at)}

    def modes(self) -> Result:
        found = self.normal
        limit, count = found.counted
        proof = f"the inertia of K - ω²M counts {count} below {limit:.6g}" if np.isfinite(limit) else "all were computed"
        if found.unlisted:
            proof += f", {found.unlisted} of them outside the band"
        head = f"Normal modes of {self.sub.name!r} in rad/time, {found.rigid} of them rigid; {found.evidence}: {proof}"
        rows = mode_rows(found)
        data = {"evidence": found.evidence, "rigid": found.rigid, "counted_below": limit, "counted": count, "rows": rows}
        said = [head, Table("modes", rows, ("mode", "omega", "residual"), "Normal modes")]
        mesh, shapes = self.mesh, self.field(found.shapes)
        if mesh is None or shapes is None or not self.scene.figures:
            return Result({"modes": data}, said)
        pictures, files = mode_views(self.scene, found.frequencies, {"": (mesh, shapes)}, self.marks)
        return Result({"modes": data}, [*said, *pictures], files)

    def critical_slope(self) -> Result:
        band, _ = self.band
        rows: list[dict[str, Any]] = []
        for name, modes, model in self.models:
            self.say(f"critical slope, {label(name)} with {model.size} DOF")
            slope, omega, reason = studies.first_loss(model, self.belt, "slope", None, band)
            full = rows[0]["slope"] if rows else slope
            port_error = model.port_error.get("belt", 0.0) if isinstance(model, fs.ReducedSubstructure) else 0.0
            rows.append({"model": name, "modes": modes, "size": model.size, "slope": slope, "omega": omega,
                         "error": relative_error(slope, full), "port_error": port_error, "reason": reason})
        self.slopes = [row["slope"] for row in rows]
        columns = ("model", "modes", "size", column("slope", "critical slope"), column("omega", "at ω", ".5g"), "error",
                   "port_error")
        notes = [f"{label(row['model'])} with {row['size']} DOF: {row['reason']}" for row in rows if row["reason"]]
        if any(row["omega"] == 0 for row in rows):
            notes.append("ω = 0: rigid motion loses its damping and drifts before anything oscillates; for the border of what "
                         f"oscillates give band = [lo, hi] with lo above 0, e.g. [{1e-3 * band[1]:.3g}, {band[1]:.6g}]")
        return Result({"critical-slope": rows}, ["Critical slopes dμ/dv in the band",
                                                 Table("critical-slope", rows, columns, "Critical slopes", keys=3), *notes,
                                                 studies.critical_slopes_chart(rows)])

    def eigenvalues(self) -> Result:
        band, _ = self.band
        self.say(f"complex modes of {self.sub.size} DOF")
        exact = fs.complex_modes(self.sub, self.belt, band=band)
        at = least_stable(exact)
        spectra: list[dict[str, Any]] = []
        for name, modes, model in self.models:
            found = exact if model is self.sub else beside_the_full(model, self.belt, band=band)
            spectra.append({"model": name, "modes": modes, "size": model.size, "evidence": found.evidence,
                            "cutoff": model.cutoff, **comparable(exact, found, min(band[1], model.cutoff))})
            if isinstance(model, fs.ReducedSubstructure) and at is not None and len(found):
                # ‖x - y (yᴴMx)/(yᴴMy)‖ / ‖x‖ in the norm of M: the sine of the angle between the shapes
                nearest = int(np.argmin(np.abs(found.eigenvalues - exact.eigenvalues[at])))
                x, y, M = model.expand(found.shapes[:, nearest]), exact.shapes[:, at], self.sub.M
                rest = x - y * (np.vdot(y, M @ x) / np.vdot(y, M @ y))
                spectra[-1]["shape_error"] = float(np.sqrt(abs(np.vdot(rest, M @ rest)) / abs(np.vdot(x, M @ x))))
        data: dict[str, Any] = {"eigenvalues": spectra}
        printed = ("model", "modes", "size", "up_to", "counted", "full_counted", column("growth", "largest Re λ"), "full_growth",
                   "is_stable", "shape_error")
        kept = self.scene.modes
        panels = [{**m, "panel": f"{modes} modes"} for modes in dict.fromkeys([kept[0], kept[len(kept) // 2], kept[-1]])
                  for m in spectra if m["model"] == "full" or m["modes"] == modes]
        shown: list[Shown] = [
            f"Complex modes in the band, dμ/dv = {self.belt.slope:.5g} (full model: completeness {exact.evidence})",
            Table("eigenvalues", spectra, printed, "Eigenvalues", 3,
                  only=("model", "modes", "size", "up_to", "growth", "full_growth", "is_stable", "shape_error")),
            studies.eigenvalue_chart(panels, f"{self.scene.name}, dμ/dv = {self.belt.slope:.4g}, F = {self.belt.force:g}"),
            studies.stability_remark(spectra), Remark.of_completeness(exact.evidence)]
        if at is None:
            return Result(data, shown)
        # the least stable shape of the last reduced model, expanded to the component
        assert isinstance(model, fs.ReducedSubstructure)
        if not len(found):
            return Result(data | {"least-stable": {}}, [
                *shown, f"{label(name)} with {modes} modes has no eigenvalue in the band: no shape is recovered"])
        value, true, u = complex(found.eigenvalues[nearest]), complex(exact.eigenvalues[at]), x
        error = float(self.sub.linearised(self.belt).backward_error(np.array([value]), u[:, None])[0])
        shown.append(f"least stable mode, recovered from {label(name)} with {modes} modes ({model.size} DOF): λ = "
                     f"{value.real:.6g} {value.imag:+.6g}i, full model {true.real:.6g} {true.imag:+.6g}i; backward error in the "
                     f"full pencil {error:.1e}; it oscillates at {value.imag:.6g} rad/time")
        data["least-stable"] = {"model": name, "modes": modes, "size": model.size, "eigenvalue": value, "omega": value.imag,
                                "full": true, "backward_error": error}
        mesh, whole = self.mesh, self.field(u)
        if mesh is None or whole is None:
            return Result(data, shown)
        files = page_mode(self.scene, mesh, whole, f", from {label(name)} with {model.size} DOF", value)
        if not self.scene.figures:
            return Result(data, shown, files)
        # any phase will do: the one in which the place that moves most is at its largest
        largest = whole.ravel()[np.argmax(np.abs(whole))]
        shape = whole * (np.conj(largest) / abs(largest))
        small = float(np.linalg.norm(shape.imag, axis=1).max()) or 1.0
        parts = np.stack([shape.real, shape.imag / small], axis=-1)
        titles = ["real part", f"imaginary part, drawn {1 / small:.3g} times larger"]
        title = (f"{self.scene.name}: least stable mode, λ = {value.real:.4g} {value.imag:+.5g}i, from {label(name)} with "
                 f"{model.size} DOF")
        named = f"{self.units.frequency(value.imag)} growth {value.real:.4g} 1/{self.units.time}"
        fields = {f"real-part {named}": shape.real, f"imaginary-part {named}": shape.imag}
        files["least-stable.vtu"] = partial(vtu, mesh, fields)
        if value.imag > 0:
            files |= motion_files(mesh, shape, value.imag, named)
        shown.append(Picture("least-stable", lambda: shapes_figure(mesh, parts, titles, title, self.marks)))
        return Result(data, shown, files)

    def error_time(self) -> Result:
        scene = self.scene
        found = fs.study(self.sub, self.methods, self.band[0], contacts=self.belt, ports=scene.ports, repeats=scene.repeats,
                      held=True, critical=self.slopes, assembly=self.assembly, progress=self.say)
        choice = studies.study_choice(found, scene.tolerance)
        rows = found.flat
        data = {"error-time": rows, "recommended": {"tolerance": scene.tolerance, "sentence": choice.sentence,
                                                    "model": choice.row}}
        return Result(data, ["Error against run time", str(found), choice.sentence,
                             Table("error-time", rows, title="Error against run time"),
                             studies.error_time_chart([(f"of {len(self.sub.interface)} DOF", found)]), choice])

    def frequency_response(self) -> Result:
        """The receptance at the contact, of the full model and the reduced ones, over the band."""
        scene, (lo, hi) = self.scene, self.band[0]
        omega = np.linspace(lo or hi / scene.frequencies, hi, scene.frequencies)
        acting = self.belt if scene.sliding else None
        exact: fs.FrequencyResponse | None = None
        curves: list[dict[str, Any]] = []
        rows: list[dict[str, Any]] = []
        for name, modes, model in self.models:
            self.say(f"receptance, {label(name)} with {model.size} DOF")
            found = fs.frequency_response(fs.damped(model, structural=scene.loss), acting, at=omega, loads="belt")
            h = found.entry("belt", "belt")
            own = {"model": name, "modes": modes, "size": model.size}
            curve = own | {"omega": omega, "magnitude": np.abs(h), "phase": np.degrees(np.angle(h))}
            if exact is not None:
                error, size = found.error(exact)[:, 0, 0], np.abs(exact.entry("belt", "belt"))
                worst = int(error.argmax())
                rows.append(own | {"error": float(error.max() / size.max()), "omega": float(omega[worst]),
                                   "error_local": float((error / size).max()), "evidence": found.evidence})
                curve["error"] = error / size
            exact = exact or found
            curves.append(curve)
        assert exact is not None
        points = [{key: curve[key] for key in ("model", "modes", "size")} | {key: float(curve[key][i]) for key in (
            "omega", "magnitude", "phase", "error") if key in curve} for curve in curves for i in range(len(omega))]
        columns = ("model", "modes", "size", column("error", "err h"), column("omega", "at ω", ".5g"),
                   column("error_local", "err h / h", ".1e"), "evidence")
        table = Table("response-errors", rows, columns, "Errors of receptances", keys=3)
        where = "about the sliding state" if scene.sliding else "at rest"
        head = (f"Receptance at the contact {where}, loss factor {scene.loss:g}, at {len(omega)} frequencies; full model: "
                f"{exact.evidence}, {int(exact.direct.sum())} solved directly, the others by {exact.modes} modes")
        choice = Advice(sentence="no small model of this run is accurate enough. Keep more modes, or lower the band",
                        full=self.sub.size, band=(lo, hi), brief=table.text(self.units.known))
        fit = [row for row in rows if row["error"] <= scene.tolerance and row["size"] < self.sub.size]
        if fit:
            best = min(fit, key=lambda row: (row["size"], row["error"]))
            name, size, off = label(best["model"]), best["size"], f"off by at most {best['error']:.1e}"
            choice = replace(
                choice, decides=[f"Its receptance at the contact is {off} of the largest one, {where}."], size=size,
                sentence=f"for {100 * scene.tolerance:.3g} % of the largest receptance take {name} with {size} DOF: it is {off}",
                model=f"{name} with {best['modes']} modes ({size} DOF)")
        data = {"frequency-response": {"evidence": exact.evidence, "modes": exact.modes, "direct": int(exact.direct.sum()),
                                       "sliding": scene.sliding, "loss": scene.loss, "rows": rows}}
        return Result(data, [head, table, Table("frequency-response", points, title="Receptances"),
                             studies.response_chart(curves, f"{scene.name}: receptance at the contact {where}"), choice])

    def joined_interface(self) -> Result:
        """Error of the lowest frequencies of K + s Bᵀdiag(d)B, M, d_j the condensed stiffness at interface DOF j, over s."""
        sub = self.sub
        if not len(sub.interface):
            return Result({"joined-interface": []}, ["Interface on springs: the component has no interface DOF"])
        condensed = np.diag(self.reduce(fs.CraigBampton(0)).K)[:len(sub.interface)]
        bare = sub.K.diagonal()[sub.interface]
        own = np.where(condensed > 1e-9 * bare, condensed, bare)
        rows: list[dict[str, Any]] = []
        count = min(self.scene.elastic, min(rom.size for _, rom in self.reduced))
        for ratio in RATIOS:
            self.say(f"interface on springs of {ratio:g} times its own stiffness")
            exact = _frequencies(sub, ratio * own, count)
            for method, rom in self.reduced:
                found = _frequencies(rom, ratio * own, count)
                rows.append({"model": method.key, "modes": method.modes, "size": rom.size, "springs": float(ratio),
                             "error": float(np.max(np.abs(found / exact - 1)))})
        models = {(row["model"], row["modes"]): {key: row[key] for key in ("model", "modes", "size")} for row in rows}
        for row in rows:
            models[row["model"], row["modes"]][f"{row['springs']:g}"] = row["error"]
        columns = ("model", "modes", "size", *(column(f"{ratio:g}", form=".1e") for ratio in RATIOS))
        return Result({"joined-interface": rows}, [
            f"Interface on springs: largest error of the lowest {count} frequencies, over the springs' stiffness relative to the "
            "component's own at each interface DOF", Table("", list(models.values()), columns, keys=3),
            Table("joined-interface", rows, title="Interface on springs"),
            studies.springs_chart(rows, f"{self.scene.name}: interface on springs, lowest {count} frequencies")])

    def study(self) -> Result:
        """What the scene asks for, below lines with the component, the friction and the band."""
        scene, sub = self.scene, self.sub
        data: dict[str, Any] = {
            "model": repr(sub), "size": sub.size, "interface": len(sub.interface),
            **scene.friction, "methods": scene.methods, "modes_kept": scene.modes, "ports": scene.ports}
        text = [f"{scene.name}: {sub!r}", scene.friction_words]
        if self.mesh is not None:
            data["mesh"] = repr(self.mesh)
        if self.mesh is not None and self.mesh.repairs:
            data["repairs"] = list(self.mesh.repairs)
            text.append(f"mesh: {'; '.join(self.mesh.repairs)}")
        if set(scene.outputs) & {"critical-slope", "eigenvalues", "error-time", "frequency-response"}:
            band, rule = self.band
            data |= {"band": band, "band_rule": rule}
            modes = ", ".join(map(str, scene.modes))
            text.append(f"band {span(band)} ({rule}); {scene.labels} with {modes} modes"
                        + (", static responses to the contact joined" if scene.ports else ""))
        return self.result(data, text)
