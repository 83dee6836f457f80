"""The answer of a run in plain sentences, from its results.json: may a small model replace the full one, what decides it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import ceil, isfinite
from typing import Any, NamedTuple

from femsub.app.figure_style import look
from femsub.app.scene import PAGE, SCENES, scene_of
from femsub.app.units import SYSTEMS, UNKNOWN, Units
from femsub.checks import NOT_CHECKED

Data = Mapping[str, Any]
STABLE = {True: "stable", False: "unstable", None: "neither stable nor unstable beyond its error bars"}
TOLERANCE = 1e-3  # of growth rates, where the scene has no key for it (`Study.recommended`)
#: what no run can tell, for every scene that compares models
NEVER = ("All errors are relative to the full model. The run does not tell how well its mesh, its materials and its friction law "
         "describe the real part.")
LINEAR = ("The verdict is that of the linear model about steady sliding. Motion beyond the border was not computed: see the "
          "scenes of limit cycles and those in time.")


class Verdict(NamedTuple):
    """'yes', 'no', 'in part', 'open' or 'found'; the answer in a sentence; what decides it; what is not checked."""

    answer: str
    headline: str
    decides: list[str]
    unchecked: list[str]
    question: str = "May a small model replace the full one?"


def verdict(told: Data) -> Verdict:
    """What the results say."""
    choices = list(_choices(told))
    if choices:
        found = _chosen(told, choices)
    elif "cycles" in told:
        found = _cycles(told)
    elif "critical-value" in told:
        found = _critical_value(told)
    elif "models" in told:
        found = _in_time(told)
    else:
        found = Verdict("open", "This run compares no models by their errors, so it does not decide whether a small model may "
                        "replace the full one.", [], [])
    proof, proven = _completeness(told)
    unchecked = [*found.unchecked, *([] if proven else proof), *_left_out(told)]
    return found._replace(decides=[*found.decides, *_stability(told), *(proof if proven else [])],
                          unchecked=list(dict.fromkeys(unchecked)))


def units_of(told: Data) -> Units:
    """The units that the run names."""
    return SYSTEMS.get(told.get("inputs", {}).get("units", ""), UNKNOWN)


def _choices(told: Data) -> Iterator[dict[str, Any]]:
    """Each recommendation: what it holds for, its sentence, and the row of its model or None."""
    if isinstance(one := told.get("recommended"), dict):
        yield {"where": "", "rows": told.get("error-time", [])} | one
    timed = told.get("error-time")
    if isinstance(timed, dict) and "recommendation" in timed:
        yield timed | {"where": "", "sentence": timed["recommendation"], "model": timed.get("recommended")}
    elif isinstance(timed, dict):
        for one in timed.get("recommended", []):
            rows = [row for row in timed["rows"] if row.get("interface") == one["interface"]]
            yield {"where": f"interface {one['interface']}", "rows": rows} | one
    for name, data in told.items():
        if name.startswith("methods") and isinstance(data, dict) and "recommended" in data:
            where = name.removeprefix("methods").strip("-").replace("-", " ")
            yield data | {"where": where, "sentence": data["recommendation"], "model": data["recommended"]}


def _chosen(told: Data, choices: Sequence[Data]) -> Verdict:
    fit = [one for one in choices if one["model"]]
    band = _band(told)
    tolerance = told.get("inputs", {}).get("tolerance") or TOLERANCE
    if not fit:
        return Verdict("no", f"No small model of this run may replace the full one {band}.",
                       [_sentence(one["sentence"], one["where"]) for one in choices], [NEVER, LINEAR])
    best = min(fit, key=lambda one: one["model"]["size"])
    answer = "yes" if len(fit) == len(choices) else "in part"
    headline = f"{_model(best['model'])} may replace the full model{_of(told, best)} {band}{_where(best['where'])}."
    decides: list[str] = []
    for one in choices:
        where = f"{one['where'].capitalize()}: " if one["where"] and len(choices) > 1 else ""
        said = _decides(one, tolerance) if one["model"] else [_sentence(one["sentence"], "")]
        decides += [where + " ".join(said)] if where else said
    outside = "Frequencies outside the band were not compared."
    return Verdict(answer, headline, decides, [
        outside, *([f"The full model was solved at {best['parameter']} = {_listed(best['values'])} alone."]
                   if best.get("values") else []),
        NEVER, LINEAR])


def _decides(one: Data, tolerance: float) -> list[str]:
    """What makes a model fit, figure by figure."""
    row = one["model"]
    full = next((other for other in one["rows"] if other.get("method") == "full"), None)
    if one.get("parameter"):
        return [f"{_model(row)}: no unstable mode of the full model is missed{_invented(row)}.",
                f"Its critical {one['parameter']} is within {_shown(row['error_critical'], '.1e')} of the full model's.",
                f"Its eigenvalues are within {_shown(row['error_eigenvalue'], '.1e')} of their modulus, its growth rates within "
                f"{_shown(row['error_real'], '.1e')}."]
    said = [f"{_model(row)}: the growth rates in the band are within {_shown(row['error_growth'], '.1e')} of the rates of "
            f"damping and friction; the tolerance is {tolerance:g}.",
            "No eigenvalue of the band is missing and none is extra. The band ends below the model's cut-off."]
    if row.get("critical") == "-inf" and row.get("error_critical") == 0:
        said.append("At no slope does it lose its stability in the band, and neither does the full model.")
    elif _number(row.get("error_critical")):
        said.append(f"Its critical slope is {_shown(row['critical'], '.5g')}, within {_shown(row['error_critical'], '.1e')} of "
                    "the full model's.")
    if _number(row.get("error_force")):
        said.append(f"The forces in the joints are within {_shown(row['error_force'], '.1e')}.")
    if full is not None and row["stable"] != full["stable"]:
        said.append(f"Mind: in the band the full model is {STABLE[full['stable']]} and the small one {STABLE[row['stable']]}. "
                    "The border is nearer than the error.")
    elif full is not None:
        said.append(f"In the band both models are {STABLE[full['stable']]}.")
    if full is not None and full["solution_median_s"] and row["solution_median_s"]:
        reducing, small, large = (seconds_words(value) for value in (
            row["reduction_median_s"], row["solution_median_s"], full["solution_median_s"]))
        said.append(f"It takes {reducing} to reduce and {small} to solve. The full model takes {large}: {_pays(row, full)}.")
    return said


def _pays(row: Data, full: Data) -> str:
    """From how many solutions on the reduction is worth its time."""
    gain = full["solution_median_s"] - row["solution_median_s"]
    if gain <= 0:
        return "nothing is gained in time"
    count = ceil(row["reduction_median_s"] / gain)
    return "the reduction pays at once" if count <= 1 else f"the reduction pays from {count} solutions on"


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _spectra(told: Data) -> Sequence[Data]:
    found = told.get("eigenvalues")
    return found["models"] if isinstance(found, dict) else found or []


def _completeness(told: Data) -> tuple[list[str], bool]:
    """Whether all eigenvalues of the full model in the band were found, if that is told; and whether it was checked at all."""
    evidence = next((one["evidence"] for one in _spectra(told) if one["model"] == "full" and "evidence" in one),
                    told.get("completeness"))
    said = [f"Completeness of the full model's eigenvalues in the band: {evidence}."] if evidence else []
    return said, evidence != NOT_CHECKED


def _stability(told: Data) -> list[str]:
    """What the eigenvalues of the full model say."""
    models = _spectra(told)
    full = next((one for one in models if one["model"] == "full"), None)
    said = []
    if full is not None and _number(full.get("growth")):
        said.append(f"Steady sliding is {STABLE[full['is_stable']]}: the full model's largest Re λ is "
                    f"{_shown(full['growth'], '.5g')}.")
        wrong = [one for one in models if one["is_stable"] != full["is_stable"]]
        said += [f"Mind: {_named(one['model'], one['size'])} says {STABLE[one['is_stable']]}." for one in wrong]
    if isinstance(told.get("unstable"), list):
        count = len(told["unstable"])
        modes = f"{count} unstable mode{'s' * (count != 1)}"
        said.append(f"At mu = {told['unstable'][0]['mu']:g} the full model has {modes} in the band." if count else
                    "The full model has no unstable mode in the band.")
    critical = told.get("flutter", {}).get("critical", {}) if isinstance(told.get("flutter"), dict) else {}
    found = [f"of the {name} model at mu = {_shown(at['mu'], '.6g')}" for name, at in critical.items() if _number(at["mu"])]
    said += [f"Loss of stability in the flutter diagram: {', '.join(found)}."] if found else []
    return said


def _cycles(told: Data) -> Verdict:
    """Limit cycles: whether each reduced model has those of the full one, with the same stability."""
    rows = [row for row in told["cycles"] if "omega" in row]
    full = {row["family"]: row for row in rows if row["model"] == "full"}
    names = list(dict.fromkeys(row["model"] for row in told["cycles"] if row["model"] != "full"))
    decides, good = [], []
    for name in names if full else ():
        own = {row["family"]: row for row in rows if row["model"] == name}
        both = [family for family in full if family in own]
        other = [family for family in both if own[family]["is_stable"] != full[family]["is_stable"]]
        label = _named(name, next(row["size"] for row in told["cycles"] if row["model"] == name))
        said = f"{label} has {len(both)} of the {len(full)} cycles of the full model"
        if both:
            said += (f", with frequencies within {max(own[at]['omega_error'] for at in both):.1e} and amplitudes (rms) within "
                     f"{max(own[at]['rms_error'] for at in both):.1e}")
        decides.append(f"{said}.")
        decides += [f"{label}: the cycle near ω = {at:.4g} is {STABLE[own[at]['is_stable']]}, but "
                    f"{STABLE[full[at]['is_stable']]} in the full model." for at in other]
        if len(both) == len(full) and not other:
            good.append(label)
    unchecked = [NEVER, "Cycles that begin from no mode of the band were not sought. Motions that are no cycle were not either."]
    if "branches" in told:
        unchecked.append("Branches are drawn and listed, not judged: the verdict is that of the cycles at one parameter.")
    if not full:
        return Verdict("open", "The full model's limit cycles are not among the results. Nothing is decided.", decides, unchecked)
    if not names:
        return Verdict("open", f"The full model has {len(full)} limit cycles. No small model was compared.", decides, unchecked)
    at = _at(told)
    if good:
        return Verdict("yes" if len(good) == len(names) else "in part",
                       f"{' and '.join(good)} may replace the full model for its limit cycles {at}, if the errors told here will "
                       "do. The same cycles exist and are stable alike.", decides, unchecked)
    return Verdict("no", f"No small model has all limit cycles of the full model {at} with the same stability.", decides,
                   unchecked)


def _at(told: Data) -> str:
    return f"at v0 = {told['speed']:g}, F = {told['force']:g}"


def _in_time(told: Data) -> Verdict:
    quality = [row for row in told.get("quality", []) if "verdict" in row]
    decides = [_sentence(row["verdict"], _named(row["model"], row["size"])) for row in quality]
    for row in told["models"]:
        if row["rms"] is not None and row["peaks"]:
            strongest = units_of(told).said(f"{_shown(row['peaks'][0], '.5g')} rad/time")
            decides.append(f"{_named(row['model'], row['size'])}: rms {_shown(row['rms'], '.5g')}, strongest at {strongest}.")
    return Verdict("open", "The models are compared in time, each by one trajectory. No tolerance is set, so the figures below "
                   "are yours to judge.", decides,
                   [NEVER, "Where several motions exist, another start may end in another one. One trajectory does not show it."])


def _critical_value(told: Data) -> Verdict:
    decides = []
    for row in told["critical-value"]:
        if _number(row["value"]):
            closed = f" The closed form gives {_shown(row['exact'], '.8g')}." if _number(row.get("exact")) else ""
            decides.append(f"{row['model']}: stability is {row['stability']} at {_shown(row['value'], '.8g')} by {row['kind']} "
                           f"({row['evidence']}).{closed}")
        else:
            decides.append(f"{row['model']}: stability is {row['stability']} ({row['evidence']}).")
    lost, (low, high) = sum(row["stability"] == "lost" for row in told["critical-value"]), told["between"]
    return Verdict("found", f"{lost} loss{'es' * (lost != 1)} of stability from {low:g} to {high:g}. The model is small as it "
                   "is, so that nothing is reduced.", decides,
                   ["Values of the parameter outside the range were not searched."], "Where is stability lost?")


def _left_out(told: Data) -> list[str]:
    """What was not asked for, failed or was interrupted."""
    said = [f"The output {name} failed: {reason}." for name, reason in told.get("failed", {}).items()]
    if not told.get("complete", True):
        said.append("The run was interrupted. What came after is missing.")
    inputs = told.get("inputs", {})
    every = scene_of(inputs["scene"])[0].OUTPUTS if inputs.get("scene") in SCENES else ()
    missing = [name for name in every if name not in inputs.get("outputs", []) and name != PAGE]
    if missing:
        said.append(f"Outputs of this scene that were not asked for: {', '.join(missing)}.")
    return said


def _model(row: Data) -> str:
    """'Craig-Bampton with 8 modes (11 DOF)'."""
    return f"{look(row['method']).label} with {row['modes']} modes ({row['size']} DOF)"


def _named(model: str, size: int) -> str:
    return f"{look(model).label} ({size} DOF)"


def _of(told: Data, choice: Data) -> str:
    full = next((row["size"] for row in choice["rows"] if row.get("method") == "full"), told.get("size"))
    return f" of {full} DOF" if full else ""


def _where(where: str) -> str:
    return f" ({where})" if where else ""


def _invented(row: Data) -> str:
    return f", but {row['invented']} invented" if row["invented"] else " and none is invented"


def _band(told: Data) -> str:
    band = told.get("band") or (told["error-time"].get("band") if isinstance(told.get("error-time"), dict) else None)
    return units_of(told).said(f"in the band {band[0]:g} to {band[1]:.4g} rad/time") if band else "in the band"


def _sentence(text: str, start: str) -> str:
    """A recommendation as a sentence of its own."""
    text = f"{start}: {text}" if start else text
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


def seconds_words(value: float) -> str:
    """'3.1 ms', '2.4 s'."""
    return f"{value * 1e3:.3g} ms" if value < 1 else f"{value:.3g} s"


def _shown(value: Any, form: str) -> str:
    """A number as results.json has it, where it may be infinite, or not known."""
    return "unknown" if value is None else format(float(value), form)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
