"""Complex modes of the full and the reduced models: which of them grow, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import WHICH, AskAt, rowed
from femsub.app.kinds import key
from femsub.app.result import Remark, Result, Table, column, label
from femsub.app.shapes import complex_pictures, page_mode, several_pictures
from femsub.model import in_band

if TYPE_CHECKING:
    from femsub.app.models import Known, Models

SHOWN = ("is_stable", "eigenvalues", "error_bar", "backward_error", "above_cutoff")  # attributes of complex modes
NO_GROWTH = "no eigenvalue up to ω"


@dataclass(frozen=True)
class ComplexModesAsk(AskAt):
    """Complex eigenvalue analysis: the largest Re λ of each model, the modes that grow, the shape of the least stable one.

    Above the cut-off of a reduced model, neither its eigenvalues nor those of the full model are compared.
    """

    complex_modes: str = key("all", "the models: 'full', 'reduced', 'all', or 'best', the largest of the last method",
                             choices=lambda _: WHICH)
    every: bool = key(False, "whether all eigenvalues of small models are listed, not only those in the band")

    KIND: ClassVar[str] = "complex-modes"
    PENCIL: ClassVar[bool] = True

    def run(self, models: Models) -> Result:
        spectra, panels, unstable = list[dict[str, Any]](), list[dict[str, Any]](), list[dict[str, Any]]()
        remarks: list[Remark] = []
        solved: list[tuple[Models, list[tuple[Known, fs.ComplexModes]]]] = []
        for values, own in self.variants(models):
            found = self.spectra(own)
            solved.append((own, found))
            lead, exact = found[0]
            rows = [self.row(own, one, modes, lead, exact) for one, modes in found]
            spectra += rowed(values, rows)
            of = ", ".join(f"{name} {value}" for name, value in values.items())
            counts = list(dict.fromkeys(row["modes"] for row in rows if row["model"] != "full"))
            for count in dict.fromkeys([counts[0], counts[len(counts) // 2], counts[-1]] if counts else [0]):
                words = ", ".join(filter(None, (of, f"{count} modes" if len(counts) > 1 else "")))
                panels += [{**row, "panel": words or "all models"} for row in rows if row["model"] == "full"
                           or row["modes"] == count]
            parts = lead is own.exact and not own.pencil and not own.alone
            unstable += rowed(values, exact.growing(own.full if parts else None))
            remarks.append(Remark.of_stability(rows) if rows[0]["model"] == "full" else Remark())
        own, found = solved[0]
        lead, exact = found[0]
        data: dict[str, Any] = {"complex-modes": {"models": spectra, "unstable": unstable, "at": self.at}}
        columns: list[Any] = [*self.varying, "model", "modes", "size", "up_to", "counted", "full_counted",
                              column("growth", "largest Re λ"), "full_growth", "is_stable",
                              *(["shape_error"] if any("shape_error" in row for row in spectra) else [])]
        only = [name for name in (getattr(each, "key", each) for each in columns) if name not in ("counted", "full_counted")]
        shown: list[Any] = [
            f"Complex modes{'' if self.every else ' in the band'}{self.at_words} ({lead.kind} model: completeness "
            f"{exact.evidence})",
            Table("complex-modes", spectra, columns, "Complex modes", len(self.varying) + 3, only=only, none=NO_GROWTH),
            fs.modes.eigenvalue_chart(panels, f"{models.scene.name}{self.at_words}"), *remarks,
            Remark.of_completeness(exact.evidence, self.at_words.replace(", ", " at ", 1))]
        if unstable:
            energies = [column(name, form=".2f") for name in unstable[0] if name.startswith("energy_")]
            shown += [f"Modes that grow, of the {lead.kind} model: {len(unstable)}", Table(
                "complex-modes-unstable", unstable,
                [*self.varying, "omega", column("growth", form=".5g"), "error_bar", "damping", *energies], "Modes that grow")]
        if exact.least_stable is None or models.pencil:
            return Result(data, shown)
        made, files = self.shapes(own, found, exact.least_stable, data["complex-modes"])
        return Result(data, [*shown, *made], files)

    @property
    def at_words(self) -> str:
        """', mu = 0.4'."""
        return "".join(f", {name} = {value:g}" for name, value in self.at.items())

    def spectra(self, models: Models) -> list[tuple[Known, fs.ComplexModes]]:
        """The chosen models with their modes, the full model first if it is chosen."""
        band = None if self.every else models.band_of(self.band)
        found = []
        for one in models.chosen(self.complex_modes):
            large = self.every and one is models.exact and one.model.size > 300
            found.append((one, models.spectrum(one, self.at, (0.0, 1.5 * models.band[1]) if large else band)))
        return found

    def row(self, models: Models, one: Known, found: fs.ComplexModes, lead: Known, exact: fs.ComplexModes) -> dict[str, Any]:
        """The row of a model in the table. It is compared with `lead`, the first model, whose modes are `exact`."""
        cutoff = getattr(one.model, "cutoff", np.inf)
        top = float(exact.frequencies.max(initial=0.0)) if self.every or models.pencil else models.band_of(self.band)[1]
        limit = min(cutoff, top)
        data: dict[str, Any] = {**one.head, "evidence": found.evidence, "cutoff": cutoff, "up_to": limit} | {
            name: getattr(found, name) for name in SHOWN}
        for name, modes in (("", found), ("full_", exact)):
            keep = fs.modes.listed(modes) & in_band(modes.eigenvalues, (0.0, limit))
            data |= {f"{name}counted": int(keep.sum()), f"{name}growth": float(modes.eigenvalues.real[keep].max(initial=-np.inf))}
        at = exact.least_stable
        if one.before and at is not None and len(found) and lead is models.exact and not models.pencil:
            nearest = int(np.argmin(np.abs(found.eigenvalues - exact.eigenvalues[at])))
            x = one.expand(found.shapes[:, [nearest]])[:, 0]
            data["shape_error"] = fs.modes.angle_between(x, exact.shapes[:, at], models.full.M)
        return data

    def shapes(self, models: Models, found: list[tuple[Known, fs.ComplexModes]], at: int, data: dict[str, Any]) -> tuple[
            list[Any], dict[str, Any]]:
        """Output and files with shapes: the least stable mode by the last chosen model, and modes of the full one that grow."""
        scene, units = models.scene, models.scene.units
        (first, exact), (one, modes) = found[0], found[-1]
        if not len(modes):
            return [f"{label(one.kind)} with {one.modes} modes has no eigenvalue in the band: no shape is recovered"], {}
        true = complex(exact.eigenvalues[at])
        nearest = int(np.argmin(np.abs(modes.eigenvalues - true)))
        value, u = complex(modes.eigenvalues[nearest]), one.expand(modes.shapes[:, [nearest]])
        shown: list[Any] = []
        whose = f"{label(one.kind)} with {one.modes} modes ({one.model.size} DOF)" if one.before else "the full model"
        data["least_stable"] = {**one.head, "eigenvalue": value, "omega": value.imag, "full": true}
        if one.before:
            error = float(models.full.linearised(models.at(self.at)).backward_error(np.array([value]), u)[0])
            data["least_stable"]["backward_error"] = error
            shown.append(f"least stable mode, recovered from {whose}: λ = {value.real:.6g} {value.imag:+.6g}i, full model "
                         f"{true.real:.6g} {true.imag:+.6g}i; backward error in the full pencil {error:.1e}; it oscillates at "
                         f"{value.imag:.6g} rad/time")
        drawn = models.drawn(u)
        files = page_mode(scene.paged, drawn, f", of {whose}{self.at_words}", value)
        if not drawn or not scene.figures:
            return shown, files
        named = f"{units.frequency(value.imag)} growth {value.real:.4g} 1/{units.time}"
        title = f"{scene.name}{self.at_words}: least stable mode, λ = {value.real:.4g} {value.imag:+.5g}i, of {whose}"
        made, more = complex_pictures("complex-modes-shape", drawn, named, title, models.marks, value.imag)
        chosen = exact.unstable if first is models.exact else np.zeros(0, dtype=int)
        if len(chosen) > 1:
            chosen = chosen[np.argsort(exact.eigenvalues[chosen].imag)]
            names = [units.frequency(exact.eigenvalues[i].imag) for i in chosen]
            titles = [f"{name}, Re λ = {exact.eigenvalues[i].real:.4g} 1/{units.time}" for name, i
                      in zip(names, chosen, strict=True)]
            many, files_of_many = several_pictures(
                "complex-modes-unstable", models.drawn(exact.shapes[:, chosen]), titles,
                f"{scene.name}{self.at_words}: modes that grow, at the phase of the largest displacement", models.marks, names)
            made, more = [*made, *many], more | files_of_many
        return [*shown, *made], files | more
