"""The verdict whether reduced models have the limit cycles of the full model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from femsub.output import NEVER, STABLE, Verdict, named


def cycles_verdict(rows: Sequence[Mapping[str, Any]], where: str, unchecked: Sequence[str] = ()) -> Verdict:
    """The verdict whether each reduced model has the limit cycles of the full model, with the same stability."""
    known = [row for row in rows if "omega" in row]
    full = {row["family"]: row for row in known if row["model"] == "full"}
    names = {row["model"]: row["size"] for row in rows if row["model"] != "full"}
    decides, good = [], []
    for name, size in names.items() if full else ():
        own = {row["family"]: row for row in known if row["model"] == name}
        both = [family for family in full if family in own]
        other = [family for family in both if own[family]["is_stable"] != full[family]["is_stable"]]
        said = f"{named(name, size)} has {len(both)} of the {len(full)} cycles of the full model"
        if both:
            said += (f", with frequencies within {max(own[at]['omega_error'] for at in both):.1e} and amplitudes (rms) within "
                     f"{max(own[at]['rms_error'] for at in both):.1e}")
        decides.append(f"{said}.")
        decides += [f"{named(name, size)}: the cycle near ω = {at:.4g} is {STABLE[own[at]['is_stable']]}, but "
                    f"{STABLE[full[at]['is_stable']]} in the full model." for at in other]
        if len(both) == len(full) and not other:
            good.append(named(name, size))
    if not full:
        end = "open", "The full model's limit cycles are not among the results. Nothing is decided."
    elif not names:
        end = "open", f"The full model has {len(full)} limit cycles. No small model was compared."
    elif good:
        end = "yes" if len(good) == len(names) else "in part", (
            f"{' and '.join(good)} may replace the full model for its limit cycles {where}, if the errors shown here are "
            "acceptable. The same cycles exist and are stable alike.")
    else:
        end = "no", f"No small model has all limit cycles of the full model {where} with the same stability."
    sought = "Cycles that begin from no mode of the band were not sought. Motions that are no cycle were not either."
    return Verdict(decides, [NEVER, sought, *unchecked], *end)
