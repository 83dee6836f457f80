"""A model as a function of one parameter: a field of its contacts, or a parameter of an `Affine`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

from femsub.checks import instance, word
from femsub.errors import InputError, unknown_name
from femsub.model.affine import Affine
from femsub.model.contact import Contacts, contacts_of
from femsub.model.substructure import Substructure

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil


def pencil_over(model: Substructure | Affine, contacts: Contacts, parameter: str) -> Callable[[float], Pencil]:
    """The pencil as a function of the parameter, which changes in all contacts that have it.

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, an `Affine` with contacts or with other parameters that have no value.
    """
    word("parameter", parameter)
    if isinstance(model, Affine):
        if contacts is not None:
            raise InputError("an Affine has no ports for contacts. Put them into its matrices, or use a Substructure")
        if parameter not in model.parameters:
            raise unknown_name("parameter", parameter, model.parameters)
        if rest := [name for name in model.parameters if name != parameter]:
            raise InputError(f"{', '.join(rest)} must have values: give model.fixed({rest[0]}=...) instead of the model")
        return lambda p: model.at(**{parameter: p})
    instance("model", model, Substructure, "or an Affine")
    given = contacts_of(contacts)
    known = [_fields(contact) for contact in given]
    if not any(parameter in names for names in known):
        raise unknown_name("parameter", parameter, sorted(set().union(*known)) if known else [])
    return lambda p: model.linearised([replace(contact, **{parameter: p}) if parameter in names else contact  # type: ignore[type-var]
                                       for contact, names in zip(given, known, strict=True)])


def _fields(contact: Any) -> set[str]:
    return {item.name for item in fields(contact) if item.init} if is_dataclass(contact) else set()
