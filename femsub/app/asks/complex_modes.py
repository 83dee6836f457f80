"""Complex modes of the full and the reduced models, which of them grow, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

import femsub as fs
from femsub.app.asks import WHICH, Ask, parameter_of, rowed
from femsub.app.keys import key
from femsub.app.result import Remark, Result, Table, column, label
from femsub.app.shapes import complex_pictures, page_mode, pictures, turned, vtu
from femsub.model import in_band

if TYPE_CHECKING:
    from femsub import ComplexModes
    from femsub.app.grammar import Scene
    from femsub.app.models import Known, Models
    from femsub.app.result import Shown

SHOWN = ("is_stable", "eigenvalues", "error_bar", "backward_error", "above_cutoff")  # of complex modes
NO_GROWTH = "no eigenvalue up to ω"

Drawings: TypeAlias = tuple[list[Any], dict[str, Any]]  # pictures, and writers of files by their names


@dataclass(frozen=True)
class ComplexModesAsk(Ask):
    """Complex eigenvalue analysis: the largest Re λ of each model, the modes that grow, the shape of the least stable one.

    Eigenvalues of a reduced model above its cut-off, and those of the full model beyond it, are no part of the comparison.
    """

    complex_modes: str = key("all", "of which models: 'full', 'reduced', 'all', or 'best', the largest of the last method",
                             choices=lambda _: WHICH)
    at: dict[str, float] = key({}, "values of parameters: {mu = 0.4}", otherwise="as they are given")
    every: bool = key(False, "whether all eigenvalues of small models are listed, not those in the band alone")

    KIND: ClassVar[str] = "complex-modes"
    PENCIL: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.at:
            parameter_of(scene, name)

    def run(self, models: Models) -> Result:
        scene, spectra, panels = models.scene, list[dict[str, Any]](), list[dict[str, Any]]()
        shapes: list[Any] = []
        shown: list[Shown] = []
        files: dict[str, Any] = {}
        unstable: list[dict[str, Any]] = []
        remarks: list[Any] = []
        for values, own in self.variants(models):
            found = self.spectra(own)
            exact, at = found[0][1], least_stable(found[0][1])
            rows = [self.row(own, one, modes, exact, at, found[0][0]) for one, modes in found]
            spectra += rowed(values, rows)
            of = ", ".join(f"{name} {value}" for name, value in values.items())
            counts = list(dict.fromkeys(row["modes"] for row in rows if row["model"] != "full"))
            kept = list(dict.fromkeys([counts[0], counts[len(counts) // 2], counts[-1]])) if counts else [0]
            for modes in kept:
                words = ", ".join(filter(None, (of, f"{modes} modes" if len(counts) > 1 else "")))
                panels += [{**row, "panel": words or "all models"} for row in rows if row["model"] == "full"
                           or row["modes"] == modes]
            unstable += rowed(values, growing(own, found[0][0], exact))
            shapes.append((own, found, at))
            remarks.append(Remark.of_stability(rows) if rows[0]["model"] == "full" else Remark())
        data: dict[str, Any] = {"complex-modes": {"models": spectra, "unstable": unstable, "at": self.at}}
        columns: list[Any] = [*self.varying, "model", "modes", "size", "up_to", "counted", "full_counted",
                   column("growth", "largest Re λ"), "full_growth", "is_stable",
                   *(["shape_error"] if any("shape_error" in row for row in spectra) else [])]
        at_words = "".join(f", {name} = {value:g}" for name, value in self.at.items())
        words = f"Complex modes{'' if self.every else ' in the band'}{at_words} ({shapes[0][1][0][0].kind} model: completeness " \
                f"{shapes[0][1][0][1].evidence})"
        only = [one for one in (column(each).key if isinstance(each, str) else each.key for each in columns)
                if one not in ("counted", "full_counted")]
        shown += [words, Table("complex-modes", spectra, columns, "Complex modes", len(self.varying) + 3, only=only,
                               none=NO_GROWTH),
                  fs.modes.eigenvalue_chart(panels, f"{scene.name}{at_words}")]
        shown += remarks
        shown.append(Remark.of_completeness(shapes[0][1][0][1].evidence, at_words.replace(", ", " at ", 1)))
        parts = [name for row in unstable[:1] for name in row if name.startswith("energy_")]
        if unstable:
            shown += [f"Modes that grow, of the {shapes[0][1][0][0].kind} model: {len(unstable)}", Table(
                "complex-modes-unstable", unstable, [*self.varying, "omega", column(
                    "growth", form=".5g"), "error_bar", "damping", *(column(name, form=".2f") for name in parts)],
                "Modes that grow")]
        for own, found, at in shapes[:1]:
            if at is not None and not models.pencil:
                made, files = self.shapes(own, found, at, data)
                shown += made
        return Result(data, shown, files)

    def spectra(self, models: Models) -> list[tuple[Known, ComplexModes]]:
        """The models with their modes; the full one first, unless reduced ones alone are asked for."""
        band = None if self.every else models.given_band if models.pencil else models.band_of(self.band)
        found = []
        for one in models.chosen(self.complex_modes):
            full = one is models.exact
            limit = (0.0, 1.5 * models.band[1]) if self.every and full and one.model.size > 300 else band
            found.append((one, models.spectrum(one, self.at, limit)))
        return found

    def row(self, models: Models, one: Known, found: ComplexModes, exact: ComplexModes, at: int | None,
            first: Known) -> dict[str, Any]:
        """What a table shows of a model, beside the first one."""
        cutoff = getattr(one.model, "cutoff", np.inf)
        top = float(exact.frequencies.max(initial=0.0)) if self.every or models.pencil else models.band_of(self.band)[1]
        limit = min(cutoff, top)
        data: dict[str, Any] = {**one.head, "evidence": found.evidence, "cutoff": cutoff, "up_to": limit} | {
            name: getattr(found, name) for name in SHOWN}
        for name, modes in (("", found), ("full_", exact)):
            keep = fs.modes.listed(modes) & in_band(modes.eigenvalues, (0.0, limit))
            data |= {f"{name}counted": int(keep.sum()), f"{name}growth": float(modes.eigenvalues.real[keep].max(initial=-np.inf))}
        if one.before and at is not None and len(found) and first is models.exact and not models.pencil:
            # ‖x - y (yᴴMx)/(yᴴMy)‖ / ‖x‖ in the norm of M: the sine of the angle between the shapes
            nearest = int(np.argmin(np.abs(found.eigenvalues - exact.eigenvalues[at])))
            x, y, M = one.expand(found.shapes[:, [nearest]])[:, 0], exact.shapes[:, at], models.full.M
            rest = x - y * (np.vdot(y, M @ x) / np.vdot(y, M @ y))
            data["shape_error"] = float(np.sqrt(abs(np.vdot(rest, M @ rest)) / abs(np.vdot(x, M @ x))))
        return data

    def shapes(self, models: Models, found: list[tuple[Known, ComplexModes]], at: int, data: dict[str, Any]) -> Drawings:
        """Pictures and files of the modes that grow, or of the least stable one, of the last model that was asked for."""
        scene, units = models.scene, models.scene.units
        first, exact = found[0]
        one, modes = found[-1]
        if not len(modes):
            return [f"{label(one.kind)} with {one.modes} modes has no eigenvalue in the band: no shape is recovered"], {}
        true = complex(exact.eigenvalues[at])
        nearest = int(np.argmin(np.abs(modes.eigenvalues - true)))
        value, u = complex(modes.eigenvalues[nearest]), one.expand(modes.shapes[:, [nearest]])
        shown: list[Any] = []
        whose = f"{label(one.kind)} with {one.modes} modes ({one.model.size} DOF)" if one.before else "the full model"
        data["complex-modes"]["least_stable"] = {**one.head, "eigenvalue": value, "omega": value.imag, "full": true}
        if one.before:
            error = float(models.full.linearised(models.at(self.at)).backward_error(np.array([value]), u)[0])
            data["complex-modes"]["least_stable"]["backward_error"] = error
            shown.append(f"least stable mode, recovered from {whose}: λ = {value.real:.6g} {value.imag:+.6g}i, full model "
                         f"{true.real:.6g} {true.imag:+.6g}i; backward error in the full pencil {error:.1e}; it oscillates at "
                         f"{value.imag:.6g} rad/time")
        drawn = models.drawn(u)
        at_words = "".join(f", {name} = {number:g}" for name, number in self.at.items())
        files = page_mode(scene.paged, drawn, f", of {whose}{at_words}", value)
        if not drawn or not scene.figures:
            return shown, files
        named = f"{units.frequency(value.imag)} growth {value.real:.4g} 1/{units.time}"
        title = f"{scene.name}{at_words}: least stable mode, λ = {value.real:.4g} {value.imag:+.5g}i, of {whose}"
        made, more = complex_pictures("complex-modes-shape", drawn, named, title, models.marks, value.imag)
        shown, files = [*shown, *made], files | more
        chosen = exact.unstable if first is models.exact else np.zeros(0, dtype=int)
        if len(chosen) > 1:
            chosen = chosen[np.argsort(exact.eigenvalues[chosen].imag)]
            many = {kind: (mesh, turned(fields)) for kind, (mesh, fields) in models.drawn(exact.shapes[:, chosen]).items()}
            names = [units.frequency(exact.eigenvalues[i].imag) for i in chosen]
            titles = [f"{name}, Re λ = {exact.eigenvalues[i].real:.4g} 1/{units.time}" for name, i
                      in zip(names, chosen, strict=True)]
            made, _ = pictures("complex-modes-unstable", {kind: (mesh, fields.real) for kind, (mesh, fields) in many.items()},
                               titles,
                               f"{scene.name}{at_words}: modes that grow, at the phase of the largest displacement",
                               models.marks, names)
            for kind, (mesh, fields) in many.items():
                views = {"real-part": fields.real, "imaginary-part": fields.imag, "phase": np.degrees(np.angle(fields))}
                files["complex-modes-unstable" + (f"-{kind}" if len(many) > 1 else "") + ".vtu"] = partial(vtu, mesh, {
                    f"{view} {name}": fields_[..., i] for view, fields_ in views.items() for i, name in enumerate(names)})
            shown += made
        return shown, files


def least_stable(modes: ComplexModes) -> int | None:
    """The eigenvalue with the largest Re λ that oscillates."""
    moving = np.flatnonzero(~modes.rigid & (modes.eigenvalues.imag > 0))
    return int(moving[np.argmax(modes.eigenvalues.real[moving])]) if len(moving) else None


def growing(models: Models, one: Known, modes: ComplexModes) -> list[dict[str, Any]]:
    """The modes of a model that grow, with their damping ratio -Re λ/|λ| in % and each part's share of the kinetic energy."""
    chosen: np.ndarray = modes.unstable
    chosen = chosen[np.argsort(modes.eigenvalues[chosen].imag)]
    energy: dict[str, Any] = {}
    if not models.pencil and not models.alone and one is models.exact and len(chosen):
        energy = {f"energy_{name}": np.einsum("ik,ik->k", u.conj(), models.full.parts[name].M @ u).real
                  for name, u in models.full.expand(modes.shapes[:, chosen]).items()}
    total = sum(energy.values()) if energy else 1.0
    return [{"omega": value.imag, "growth": value.real, "error_bar": bar, "damping": -100 * value.real / abs(value),
             **{name: float((part / total)[i]) for name, part in energy.items()}}
            for i, (value, bar) in enumerate(zip(modes.eigenvalues[chosen], modes.error_bar[chosen], strict=True))]
