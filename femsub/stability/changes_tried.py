"""`modified`: a model with changes."""
from __future__ import annotations
from dataclasses import replace
from typing import Any
from femsub.model import Substructure, added, as_changes
from femsub.checks import instance


def modified(model: Any, changes: Any) -> Any:
    given = as_changes("changes", changes)
    plus = added(instance("model", model, Substructure), given)
    parts = {key: getattr(model, key) if key not in plus else getattr(model, key) + plus[key] for key in "MDK"}
    return Substructure(parts["M"], parts["K"], parts["D"], interface=model.interface, ports=dict(model.ports), name=model.name, dofs=model.dofs, sets=model.sets)
