"""Charts of eigenvalues in the complex plane, of receptances, and of frequencies on springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.output import (
    ROUNDING,
    STYLES,
    Chart,
    Level,
    Panel,
    Series,
    damping_percent,
    floored,
    grouped,
    hover_of,
    linear_up_to,
    look,
    nested,
)

if TYPE_CHECKING:
    from femsub.modes.normal_modes import NormalModes
    from femsub.modes.quadratic.complex_modes import ComplexModes
    from femsub.modes.receptance import FrequencyResponse

HOLLOW = "Right of the line Re λ = 0 a mode grows. Hollow marks of reduced models lie above their cut-off."
RESPONSE = "The error is bounded: the difference from the full model's receptance, and what is not known of both."
PLANE = "Re λ  [1/time]", "Im λ  [rad/time]"


def eigenvalue_chart(models: Sequence[Mapping[str, Any]], title: str, clump: float = 0.4) -> Chart:
    """Eigenvalues in the complex plane (the paper's Fig. 4); hollow above the reduced model's cut-off.

    If the eigenvalues of reduced models fill less than the share `clump` of the full range of Im λ, a second row of the figure
    shows them enlarged.
    """
    places = grouped(models, "panel")
    # the frames around the reduced models' eigenvalues below their cut-off
    frames: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {}
    for name, several in places.items():
        every = np.concatenate([np.asarray(model["eigenvalues"]) for model in several])
        values = np.concatenate([np.zeros(0), *(np.asarray(model["eigenvalues"])[~np.asarray(model["above_cutoff"])]
                                                for model in several if model["model"] != "full")])
        values = values[values.imag >= 0]
        if len(values) and values.imag.max() < clump * every.imag.max():
            low, high = -0.05 * values.imag.max(), 1.15 * values.imag.max()
            seen = every[(every.imag >= low) & (every.imag <= high)]
            room = 0.08 * (np.ptp(seen.real) or high)
            frames[name] = (float(seen.real.min() - room), float(seen.real.max() + room)), (float(low), float(high))
    up_to = linear_up_to([value for model in models for value in np.asarray(model["eigenvalues"]).real])
    linear = {"x": up_to} if up_to else {}
    # panels
    line = [Level(0.0, line="solid", colour="#808080")]
    sizes = {name: " and ".join(dict.fromkeys(str(model["size"]) for model in several if model["model"] != "full"))
             for name, several in places.items()}  # '5', or '9 and 10' if the methods differ
    panels = [Panel(_spectra(several), *PLANE, f"{name} ({sizes[name]} DOF)" if len(several) > 1 else name, levels=line,
                    share={"x": "all", "y": "all"}, band=frames[name][1] if name in frames else None, linear=linear)
              for name, several in places.items()]
    for name, several in places.items() if frames else ():
        limits = dict(zip("xy", frames[name], strict=True)) if name in frames else {}
        panels.append(Panel(_spectra(several, True) if name in frames else (), *PLANE,
                            "the grey part, enlarged" if name in frames else "", levels=line, limits=limits,
                            where="figure"))
    return Chart("complex-modes", f"Eigenvalues: {title}", panels, len(places), note=HOLLOW, width=1.0 if len(places) > 1
                 else 0.7,
                 height=3.6, columns=3)


def _spectra(models: Sequence[Mapping[str, Any]], enlarged: bool = False, crowd: int = 60) -> list[Series]:
    """The full model as large circles, reduced models as marks within them; circles are small above `crowd` eigenvalues."""
    series = []
    for at, model in enumerate(models):
        values, beyond = np.asarray(model["eigenvalues"]), np.asarray(model["above_cutoff"])
        full, label = model["model"] == "full", look(model["model"]).label
        size = (10.0 if len(values) <= crowd or enlarged else 5.0) if full else nested(at - 1)
        for chosen, hollow, word in ((~beyond, full, label), (beyond, True, f"{label}, above its cut-off")):
            own = values[chosen]
            if len(own):
                hover = {"DOF": [model["size"]] * len(own), "Re λ": own.real, "ω [rad/time]": own.imag,
                        "error bar of Re λ": np.asarray(model["error_bar"])[chosen],
                        "damping [%]": [one if z.imag else None for one, z in zip(damping_percent(own), own, strict=True)]}
                series.append(Series(word, own.real, own.imag, model["model"], size=size, hollow=hollow, hover=hover))
    return series


def response_chart(curves: Sequence[Mapping[str, Any]], title: str) -> Chart:
    """|h| and its phase over ω for each model, and for reduced models the bound of the relative error.

    A curve has `model`, `modes`, `size`, `omega`, `magnitude`, `phase` in degrees and, for a reduced model, `error`.
    """
    panels = []
    for key, label, logs in (("magnitude", "|h|  [length/force]", "y"), ("phase", "phase of h  [°]", ""),
                             ("error", "bound of the error over |h|  [-]", "y")):
        seen: dict[str, int] = {}
        series = []
        for curve in curves:
            if key not in curve:
                continue
            at = seen.setdefault(curve["model"], 0)
            seen[curve["model"]] += 1
            line, _, width = STYLES[at % len(STYLES)] if curve["model"] != "full" else ("solid", False, 2.2)
            series.append(Series(f"{look(curve['model']).label}, {curve['size']} DOF{curve.get('words', '')}", curve["omega"],
                                 np.asarray(curve[key], dtype=float), curve["model"], line, "", width=width))
        panels.append(Panel(series, "ω  [rad/time]", label, logs=logs, rounding=key == "error", share={"x": "omega"}))
    return Chart("response", title, panels, note=RESPONSE, height=2.0, columns=3)


def modes_chart(modes: ComplexModes, title: str) -> Chart:
    """Im λ over Re λ, and over the damping ratio in %, for Im λ ≥ 0, with marks for growing, decaying and undecided modes."""
    values, upper = modes.eigenvalues, modes.eigenvalues.imag >= 0
    decays, open_, grows = (np.array([vote is one for vote in modes.stable], dtype=bool) & ~modes.above_cutoff
                            for one in (True, None, False))
    kinds = ((decays, "decays", "#4d4d4d", "o", True), (open_, "undecided, or rigid", "#e69f00", "D", True),
             (modes.above_cutoff, "above the cut-off", "#b0b0b0", "s", True), (grows, "grows", "#c0392b", "o", False))
    panels = []
    for label, x in (("Re λ  [1/time]", values.real), ("-Re λ / |λ|  [%]", damping_percent(values))):
        series = []
        for chosen, word, colour, marker, hollow in kinds:
            own = np.flatnonzero(upper & chosen)
            if len(own):
                series.append(Series(word, x[own], values[own].imag, colour=colour, marker=marker, hollow=hollow, size=6.0,
                                     labels=[f"{omega:.5g}" for omega in values[own].imag] if word == "grows" else (),
                                     hover={"ω [rad/time]": values[own].imag, "Re λ": values[own].real,
                                            "damping [%]": damping_percent(values[own]), "error bar": modes.error_bar[own]}))
        up_to = linear_up_to(x[upper])
        panels.append(Panel(series, label, "Im λ  [rad/time]", levels=[Level(0.0, line="solid", colour="#808080")],
                            linear={"x": up_to} if up_to else {}, share={"y": "omega"}))
    return Chart("complex-modes", title, panels, 2, note="Right of the line Re λ = 0 a mode grows.",
                 height=3.6)


def frequencies_chart(modes: NormalModes, title: str) -> Chart:
    """Frequencies over the mode number, with other marks for rigid motions."""
    numbers = np.arange(1, len(modes.frequencies) + 1)
    series = [Series(word, numbers[chosen], modes.frequencies[chosen], colour=colour, marker="o", hollow=hollow, hover={
        "residual": modes.residual[chosen]}) for word, chosen, colour, hollow in (
            ("rigid", numbers <= modes.rigid, "#e69f00", True), ("elastic", numbers > modes.rigid, "#0067a5", False))
        if chosen.any()]
    return Chart("modes", title, [Panel(series, "number of the mode  [-]", "ω  [rad/time]", whole="x")], width=0.8)


def receptances_chart(found: FrequencyResponse, title: str, most: int, full: FrequencyResponse | None = None) -> Chart:
    """|h| with its bound, and the phase, over ω, for at most `most` pairs of load and response.

    Curves of the full model lie behind. The error against it has its own panel.
    """
    pairs = [(i, j) for j in range(len(found.loads)) for i in range(len(found.responses))]  # the order of `curves`
    size, phase, off = list[Series](), list[Series](), list[Series]()
    own, exact = found.curves(full), [] if full is None else full.curves()
    for at, ((i, j), curve) in enumerate(zip(pairs[:most], own, strict=False)):
        for behind in exact[at:at + 1]:
            grey = Series("full model", behind["omega"], behind["magnitude"], line="solid", marker="", colour="#b0b0b0",
                          width=3.5, legend=at == 0)
            size.append(grey)
            phase.append(replace(grey, y=behind["phase"], legend=False))
        h, bound = curve["magnitude"], found.bound[:, i, j]
        one = Series(f"{found.responses[i]} by {found.loads[j]}", found.omega, h, line="solid", marker="", colour=f"C{at % 10}")
        size += [one, *(replace(one, name="what the bound admits", y=np.maximum(h + sign * bound, h * ROUNDING),
                                line="dot", width=0.6, colour="#808080", legend=at == 0) for sign in (-1, 1)
                        if np.isfinite(bound).all() and (bound > 0.01 * h).any())]
        phase.append(replace(one, y=curve["phase"]))
        if "error" in curve:
            off.append(replace(one, y=floored(curve["error"]), legend=False))
    share = {"x": "omega"}
    left = f"{most} of {len(pairs)} pairs of load and response are drawn" if len(pairs) > most else ""
    panels = [Panel(size, "ω  [rad/time]", "|h|  [length/force]", logs="y", share=share),
              Panel(phase, "ω  [rad/time]", "phase of h  [°]", share=share)]
    if off:
        panels.append(Panel(off, "ω  [rad/time]", "bound of the error over |h|  [-]", logs="y", rounding=True, share=share))
    return Chart("response", title, panels, about=left, height=2.2)


def springs_chart(rows: Sequence[Mapping[str, Any]], title: str, lines: int = 8) -> Chart:
    """Error of the lowest frequencies over the stiffness of the springs under the interface; a line for each model.

    A figure has about `lines` lines, which can still be distinguished: for each method the smallest and the largest model, and
    models between them if there is room. A page has all models.
    """
    methods, counts = (list(dict.fromkeys(row[key] for row in rows)) for key in ("model", "modes"))
    room = min(max(lines // max(len(methods), 1), 2), len(STYLES))
    drawn = [counts[at] for at in sorted({round(at) for at in np.linspace(0, len(counts) - 1, min(room, len(counts)))})]
    looks = {modes: STYLES[at] for at, modes in enumerate(reversed(drawn))}

    def panel(kept: Sequence[int], where: str) -> Panel:
        series = []
        for (model, modes), own in grouped((row for row in rows if row["modes"] in kept), "model", "modes").items():
            hover = hover_of(own, {"modes": "modes", "springs": "springs", "error": "error"})
            line, hollow, width = looks.get(modes, STYLES[0])
            series.append(Series(f"{look(model).label}, {own[0]['size']} DOF", hover["springs"], floored(hover["error"]), model,
                                 line, hollow=hollow, width=width, hover=hover))
        return Panel(series, "springs under the interface / static stiffness of the component there  [-]",
                     "relative error of ω  [-]", logs="xy", where=where)

    left = [f"{modes}" for modes in counts if modes not in drawn]
    about = f"not drawn, but in the table: models with {', '.join(left)} modes" if left else ""
    return Chart("springs", title, [panel(drawn, "figure"), panel(counts, "page")], about=about,
                 note="Soft springs leave the interface nearly free, stiff ones nearly fixed. Errors of zero are drawn at "
                 f"{ROUNDING:g}.", height=4.0, columns=3)
