"""Runs an extreme case and judges it: right within its bound, refused with a reason, or wrong."""

from __future__ import annotations

import time
import warnings
from typing import Any

import femsub as fs
from benchmarks.extreme.table import CASES

BACKWARD, ORTHOGONAL = 1e-9, 1e-8  # a backward error above the first is warned of by femsub itself
FIGURES = ("error", "bound", "ratio", "backward", "orthogonality", "condition", "missed")
Row = dict[str, Any]


def evaluate(name: str) -> Row:
    """Runs one case and judges it."""
    case, start = CASES[name], time.perf_counter()
    row: Row = {"group": case.group, "case": name, "verdict": "wrong", "as_known": False, "computed": "", "reason": ""}
    row |= dict.fromkeys(FIGURES) | {"why": "", "warnings": []}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", fs.FemsubWarning)
        warnings.simplefilter("ignore", fs.PortWarning)
        try:
            found = case.run()
        except fs.FemsubError as error:
            row |= {"verdict": "refused", "reason": f"{type(error).__name__}: {error}"}
            found = None
        except Exception as error:  # whatever else is raised is no refusal, but must not end the run
            row |= {"reason": f"{type(error).__name__}: {error}"}
            found = None
    told = [one for one in caught if issubclass(one.category, fs.FemsubWarning)]
    row |= {"warnings": [str(one.message) for one in told]}
    if found is not None:
        row |= {key: getattr(found, key) for key in ("computed", "why", *FIGURES)}
        faults = [found.lie, f"{found.ratio:.2g} times its bound" if found.ratio > 1 else "",
                  "the bound says nothing" if not found.bound < 1 else "", f"{found.missed} missed" if found.missed else "",
                  f"‖ΦᵀMΦ - I‖ = {found.orthogonality:.1e}" if (found.orthogonality or 0) > ORTHOGONAL else "",
                  f"backward error {found.backward:.1e}" if (found.backward or 0) > BACKWARD and not told else ""]
        lost = [str(one.message) for one in told if issubclass(one.category, fs.ConditionWarning)]
        row["reason"] = "; ".join(fault for fault in faults if fault)
        if not row["reason"]:
            row["verdict"] = "right"
        elif lost:
            row |= {"verdict": "refused", "reason": f"ConditionWarning: {lost[0]} [{row['reason']}]"}
    known = "right" if case.expect == "right" else "refused"
    row["as_known"] = row["verdict"] == known and (known == "right" or case.expect in row["reason"])
    return row | {"seconds": time.perf_counter() - start}
