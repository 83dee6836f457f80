"""The first loss of stability of a model over a parameter of its contacts, for tables of many models."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import CutoffWarning, FemsubError, InputError
from femsub.coupling import Belt
from femsub.model import Affine, Contact, Contacts, Substructure, contacts_at, contacts_of, family_of
from femsub.stability.critical_value import critical_slope, critical_value, first_value
from femsub.stability.parameter import pencil_over
from femsub.stability.question import CriticalValue

UNKNOWN = ("stability is lost beyond {} = {:.6g}, at a place that is not known: more modes grow there, but none was found to "
           "cross. Modes without any damping may have met on the axis: give damping. Or a growing mode came into the band at its "
           "edge: move the ends of the band")


class Loss(NamedTuple):
    """The value of a parameter at the first loss of stability (±inf if there is none), and its ω; NaN with the reason why."""

    value: float = np.nan
    omega: float = np.nan
    reason: str = ""


def first_loss(model: Substructure, contacts: Contacts, parameter: str, between: tuple[float, float] | None,
               band: tuple[float, float], near: float = np.nan) -> Loss:
    """The first loss of stability in a band. For tables of many models, an error is returned as the reason, and not raised.

    'slope' of a belt is the largest c ≤ 0 (`critical_slope`), of the first belt; the other contacts act as they are. Any other
    parameter is searched from the lower end of `between` up (`critical_value`), and a little beyond `near`, where a smaller model
    loses its stability.
    """
    given = contacts_of(contacts)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CutoffWarning)  # the error is measured anyway
            if parameter == "slope" and (belt := first_belt(given)) is not None:
                others = [contact for contact in given if contact is not belt]
                slope = critical_slope(model, belt.port, force=belt.force, contacts=others or None, band=band)
                return Loss(slope.value, slope.omega)
            if between is None:
                raise InputError(f"a critical {parameter} is looked for in a range: give between=(lo, hi)")
            acting: Contacts = given
            asked: Substructure | Affine = model
            if pencil_over(model, given, parameter).affine(between):  # its matrices are made once
                asked, acting = family_of(model, given, [parameter], {parameter: (min(between), max(between))}), None
            # an exclusion of all other crossings would take too long for a table of many models
            found = first_value(asked, acting, parameter, between, band, near)
            if np.isfinite(found.value) and not found.first and not found.growing:
                return Loss(reason=UNKNOWN.format(parameter, found.value))
            return Loss(found.value, found.omega if found.first else abs(found.fastest.imag))
    except FemsubError as error:
        return Loss(reason=str(error))


def all_losses(model: Any, contacts: Contacts, parameter: str, between: tuple[float, float] | None,
               band: tuple[float, float] | None) -> CriticalValue:
    """All losses and regains of stability; without a range, over the slope of the first belt, from 0 down."""
    if between is not None:
        return critical_value(model, contacts, parameter, between=between, band=band)
    belt = first_belt(contacts_of(contacts))
    assert belt is not None
    others = [contact for contact in contacts_of(contacts) if contact is not belt]
    return critical_slope(model, belt.port, force=belt.force, contacts=others or None, band=band)


def outcome(found: Sequence[CriticalValue], rows: Sequence[Mapping[str, Any]], words: str) -> tuple[str, str]:
    """'found' if stability is lost, 'nowhere' if it is not, or 'open'; and a sentence about it.

    `rows` are the rows of all answers, `words` names the parameter.
    """
    kinds = [row["stability"] for row in rows]
    if count := kinds.count("lost"):
        return "found", f"{count} loss{'es' * (count != 1)} of stability over {words}."
    if "lost at the start" in kinds:
        return "found", f"Modes grow from the start of the range of {words}."
    if "lost at a place not known" in kinds:
        return "found", f"Stability is lost, at a value of {words} that is not known."
    ends, left = [end for one in found for end in one.searched], any(one.open for one in found)
    return ("open" if left else "nowhere",
            f"{'No loss found' if left else 'Never lost'} between {words} = {min(ends):g} and {max(ends):g}.")


def first_belt(contacts: Sequence[Contact]) -> Belt | None:
    """The first of the contacts that is a belt."""
    return next((contact for contact in contacts if isinstance(contact, Belt)), None)


def with_value(contacts: Sequence[Contact], parameter: str, value: float) -> list[Any]:
    """The contacts with this value of the parameter; 'slope' is that of the first belt."""
    belt = first_belt(contacts) if parameter == "slope" else None
    return [replace(one, slope=value) if one is belt else one for one in contacts] if belt is not None else \
        contacts_at(contacts, parameter, value)
