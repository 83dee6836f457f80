"""Contacts, which act on a model's ports: their protocol, and a linear contact given by its matrices.

Friction may make a contact's stiffness unsymmetric, while a `Substructure` has symmetric M and K. So the contact is a separate
object, and the model linearised with it, `Substructure.linearised`, is a `Pencil`. The port columns of a reduced model are VᵀW,
so one contact serves the full and the reduced model.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
import scipy.sparse as sp

from femsub.algebra import Frozen, as_matrix
from femsub.checks import Array, InputError, InputTypeError, Matrix, items, mapping, naming, real_array, shown, unknown_name, word

log = logging.getLogger(__name__)

Model: TypeAlias = Any  # a Substructure; not named as the type, since its module imports this one

@runtime_checkable
class Contact(Protocol):
    """The protocol of contacts, which act on ports of a model. This table is the interface for a contact of your own.

    W (n, p) has the columns of the contact's ports side by side. u = Wᵀq and v = Wᵀq̇ are the motion there. Make your contact a
    frozen dataclass, so that it can be compared, pickled and changed by `replace`, as in `critical_value`.

    =====================  ================================================================================================
    ports                  names of the ports, a tuple of str
    sets                   names of interface sets, whose DOF follow the ports' columns; optional, for contacts of surfaces
    linearised(model)      (C_D, C_K): D becomes D + W C_D Wᵀ, K becomes K + W C_K Wᵀ about the operating point. Each is a
                           matrix (p, p), symmetric or not, dense or sparse; a number c, which stands for c times the unit
                           matrix; or None.
    exerted(u, v)          the force f (p,) in motion: M q̈ + D q̇ + K q = W f(u, v), for `transient` and limit cycles
    tangents(u, v)         (∂f/∂u, ∂f/∂v), (p, p) each. At the operating point they are -C_K and -C_D. Return None for a
                           derivative that is 0 everywhere: if f depends on v alone, limit cycles take less time and have
                           multipliers.
    in_motion(model)       replaces `exerted` and `tangents`: returns an object that has them, for a force that depends on the
                           model
    columnwise             True if all columns follow the same law, each independent of the others. `exerted` then takes u and v
                           of any shape, entry by entry, and `tangents` also takes (p, m), for m times, and returns (p, p, m).
    scalar()               f and ∂f/∂v of a single column as fast functions of one float v, if f does not depend on u
    affine                 names of the fields in which C_D and C_K are affine, a + b p with all other fields as they are: a tuple
                           of str, an attribute of the class or a property. Without it `critical_value` is at most 'confirmed'.
                           Samples check it. A subclass must declare it again, since it may change the matrices.
    affine_through         functions of fields in which C_D and C_K are affine, a + Σ b_i f_i(p): a dict of field names, each with
                           one function, as {"speed": np.reciprocal}, or with a tuple of functions; None is the field itself.
                           Otherwise as `affine`. Products such as mu / speed need nothing more: one field changes at a time.
    kinks(parameter)       values of a field at which C_D or C_K has a kink or a jump, a sequence of numbers. `critical_value` and
                           `track` look there.
    =====================  ================================================================================================

    `ports` and `linearised` are required. `affine` and `kinks` are for analyses over a field. Without `exerted` and `tangents`,
    analyses of nonlinear motion refuse the contact, by its name.
    """

    @property
    def ports(self) -> tuple[str, ...]: ...

    def linearised(self, model: Model) -> tuple[Any, Any]: ...


Contacts: TypeAlias = Contact | Sequence[Contact] | None  # type of the argument `contacts`


@dataclass(frozen=True, eq=False, repr=False)
class LinearContact(Frozen):
    """A linear contact between ports: f = -C_K u - C_D v, with any real C_K and C_D, for springs, dashpots and friction's terms.

    D + W C_D Wᵀ, K + W C_K Wᵀ, where W (n, p) has the columns of the ports side by side. Coulomb friction at a constant μ makes
    C_K unsymmetric. A normal spring k with the tangential force -μ k u_n on the ports ("n", "t") has C_K = k [[1, 0], [μ, 0]].

    Parameters
    ----------
    ports : sequence of str
        Names of the ports. A port of several columns takes as many rows of the matrices.
    stiffness, damping : array_like, shape (p, p), optional
        C_K (force / length) and C_D (force · time / length); none by default.

    Raises
    ------
    InputError, InputTypeError
        No port, no matrix, matrices that are not square or of different sizes, NaN. When the contact is used: matrices whose
        size is not the number of the ports' columns in the model.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.Substructure([[1, 0], [0, 1]], [[2, 1], [1, 2]], ports={"n": [1, 0], "t": [0, 1]})
    >>> rubbing = fs.LinearContact(("n", "t"), stiffness=[[0, -4 / 3], [0, 0]])
    >>> print(rubbing)
    LinearContact: on n, t; stiffness 2 x 2, unsymmetric
    >>> fs.complex_modes(sub, rubbing).is_stable
    False
    """

    ports: tuple[str, ...]
    stiffness: Array | None = None
    damping: Array | None = None

    affine: ClassVar[tuple[str, ...]] = ("stiffness", "damping")

    def __post_init__(self) -> None:
        names = [self.ports] if isinstance(self.ports, str) else items("ports", self.ports, "names of ports")
        if not names:
            raise InputError("ports is empty: a contact needs at least one port")
        given = {name: np.array(real_array(name, value)) for name in ("stiffness", "damping")
                 if (value := getattr(self, name)) is not None}
        if not given:
            raise InputError("a linear contact needs stiffness or damping: matrices on the columns of its ports")
        for name, matrix in given.items():
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
                raise InputError(f"{name} must be square, one row per column of the ports, but its shape is {matrix.shape}")
        if len({matrix.shape for matrix in given.values()}) > 1:
            raise InputError(f"stiffness is {given['stiffness'].shape}, but damping {given['damping'].shape}")
        self._set(ports=tuple(word("each of ports", name) for name in names), **given)

    def __repr__(self) -> str:
        shown = [f"{name} {len(matrix)} x {len(matrix)}, {'symmetric' if np.array_equal(matrix, matrix.T) else 'unsymmetric'}"
                for name in ("stiffness", "damping") if (matrix := getattr(self, name)) is not None]
        return f"LinearContact: on {', '.join(self.ports)}; {'; '.join(shown)}"

    def linearised(self, model: Model) -> tuple[Array | None, Array | None]:
        """(C_D, C_K), whatever the model."""
        return self.damping, self.stiffness

    def exerted(self, u: Array, v: Array) -> Array:
        """f = -C_K u - C_D v, shape (p,)."""
        K, D = self.tangents(u, v)
        parts = [C @ moved for C, moved in ((K, u), (D, v)) if C is not None]
        return parts[0] if len(parts) == 1 else parts[0] + parts[1]

    def tangents(self, u: Array, v: Array) -> tuple[Array | None, Array | None]:
        """(-C_K, -C_D)."""
        return None if self.stiffness is None else -self.stiffness, None if self.damping is None else -self.damping


def contacts_of(contacts: Any) -> tuple[Contact, ...]:
    """A tuple of contacts, each checked, from one contact, several or None."""
    if contacts is None:
        return ()
    given = [contacts] if isinstance(contacts, Contact) and not isinstance(contacts, type) else \
        items("contacts", contacts, "Belts or other contacts, or one of them")
    for contact in given:
        model = hasattr(type(contact), "pencil")  # a model has ports and linearised(), too
        if model or isinstance(contact, type) or not isinstance(contact, Contact):
            raise InputTypeError("a contact must be a Belt, a LinearContact or another object with `ports` and "
                                 f"linearised(model), not {shown(contact)}{'. Join models with couple' * model}")
    return tuple(given)


def fields_of(contact: Any) -> tuple[str, ...]:
    """The names of the fields that `replace` can change; none for a contact that is no dataclass."""
    return tuple(item.name for item in fields(contact) if item.init) if is_dataclass(contact) else ()


def contacts_at(contacts: Contacts, parameter: str, value: float) -> list[Any]:
    """The contacts with this value of a parameter. Contacts without the parameter stay as they are, which the log reports.

    Raises
    ------
    InputError
        No contact has the parameter.
    """
    given: Sequence[Any] = contacts_of(contacts)
    known = [fields_of(one) for one in given]
    without = ", ".join(type(one).__name__ for one, names in zip(given, known, strict=True) if parameter not in names)
    if not any(parameter in names for names in known):
        raise unknown_name("parameter", parameter, {name for names in known for name in names})
    if without:
        log.info("%s has no %s and stays as it is", without, parameter)
    return [replace(one, **{parameter: value}) if parameter in names else one for one, names in zip(given, known, strict=True)]


def without(contacts: Contacts, parameter: str = "mu") -> list[Any]:
    """The contacts with 0 for this field, by default without friction. Contacts without the field stay as they are."""
    given: Sequence[Any] = contacts_of(contacts)
    return [replace(one, **{parameter: 0.0}) if parameter in fields_of(one) else one for one in given]


def affine_fields(contact: Any) -> tuple[str, ...]:
    """The fields in which a contact's matrices are affine, as its own class declares."""
    if "affine" not in vars(type(contact)):
        return ()
    what = f"`affine` of {type(contact).__name__}"
    return _its_fields(contact, what, items(what, contact.affine, "names of its fields"))


def affine_functions(contact: Any, field: str) -> tuple[Callable[[Any], Any] | None, ...]:
    """The functions of a field in which a contact's matrices are affine, as its own class declares.

    None stands for the field itself. The tuple is empty if the contact declares nothing for the field.
    """
    if field in affine_fields(contact):
        return (None,)
    if "affine_through" not in vars(type(contact)):
        return ()
    what = f"`affine_through` of {type(contact).__name__}"
    known = mapping(what, contact.affine_through, "its fields' names and functions")
    _its_fields(contact, what, known)
    given = known.get(field, ())
    functions = (given,) if callable(given) else tuple(items(f"{field!r} in {what}", given, "functions"))
    if unfit := [function for function in functions if function is not None and not callable(function)]:
        raise InputTypeError(f"{field!r} in {what} must be a function of the field, or a tuple of such, not {shown(unfit[0])}")
    return functions


def _its_fields(contact: Any, what: str, names: Iterable[Any]) -> tuple[str, ...]:
    checked = tuple(word(what, name) for name in names)
    if missing := [name for name in checked if not hasattr(contact, name)]:
        raise InputError(f"{what} names {missing[0]!r}, which is not a field of the contact")
    return checked


def kinks_of(contact: Any, parameter: str) -> tuple[float, ...]:
    """The values of a field at which a contact's matrices have a kink or a jump, as the contact declares."""
    if not callable(kinks := getattr(contact, "kinks", None)):
        return ()
    found = real_array(f"kinks({parameter!r}) of {type(contact).__name__}", kinks(parameter))
    return tuple(np.atleast_1d(found).ravel().tolist())


def columns_of(model: Model, contact: Contact) -> Matrix:
    """W (n, p), the columns of a contact's ports and the DOF of its sets side by side; an unknown name is an InputError."""
    ports, sets = contact.ports, getattr(contact, "sets", ())
    if isinstance(ports, str) or isinstance(sets, str) or not (ports or sets):
        raise InputError(f"the ports of {type(contact).__name__} must be a tuple of names, not {shown(ports)}")
    columns = [model.port(name).reshape(model.size, -1) for name in ports]
    for name in sets:
        if name not in model.sets:
            argument = next((key for key, value in vars(contact).items() if isinstance(value, str) and value == name), "sets")
            with naming(argument):  # as first and second of a FrictionContact
                raise unknown_name(f"interface set of {model.name!r}", name, model.sets)
        columns.append(model.interface_rows[model.sets[name]].T)
    return sp.csc_array(sp.hstack(columns)) if any(map(sp.issparse, columns)) else np.hstack(columns)


def small_matrices(model: Model, contact: Contact) -> tuple[Matrix, float | Matrix, float | Matrix]:
    """W (n, p), C_D and C_K of a contact on a model, checked: each C is a number or a matrix (p, p)."""
    W = columns_of(model, contact)
    terms = contact.linearised(model)
    if not isinstance(terms, tuple) or len(terms) != 2:
        raise InputTypeError(f"{type(contact).__name__}.linearised must return (C_D, C_K), not {shown(terms)}")
    checked: list[float | Matrix] = []
    for name, value in zip(("C_D", "C_K"), terms, strict=True):
        what = f"{name} of {type(contact).__name__}"
        C = as_matrix(what, value) if sp.issparse(value) else real_array(what, 0.0 if value is None else value)
        if C.ndim and C.shape != (W.shape[1],) * 2:
            names = ", ".join((*contact.ports, *getattr(contact, "sets", ())))
            raise InputError(f"{what} has the shape {C.shape}, but its ports ({names}) have {W.shape[1]} columns on "
                             f"{model.name!r}")
        checked.append(C if sp.issparse(C) else np.array(C) if C.ndim else float(C))
    return W, checked[0], checked[1]
