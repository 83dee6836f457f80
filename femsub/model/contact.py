"""What acts on a model's ports: the protocol of contacts, and a linear contact given by its matrices.

Friction may make a contact's stiffness unsymmetric. A `Substructure` keeps symmetric M and K all the same. The contact is
separate, and the model linearised under it, `Substructure.linearised`, is a `Pencil`. W of a reduced model is VᵀW, so one
contact serves the full and the reduced model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from femsub.checks import Array, items, real_array, shown, word
from femsub.errors import InputError, InputTypeError
from femsub.model.frozen import Frozen

if TYPE_CHECKING:
    from femsub.model.substructure import Substructure


@runtime_checkable
class Contact(Protocol):
    """What acts on ports of a model. This table is the interface for a contact of your own.

    W (n, p) has the columns of the contact's ports side by side, u = Wᵀq and v = Wᵀq̇ are the motion there. Make your contact a
    frozen dataclass, so that it can be compared, pickled and changed by `replace`, as `critical_value` does.

    =====================  ================================================================================================
    ports                  names of the ports, a tuple of str
    linearised(model)      (C_D, C_K): D becomes D + W C_D Wᵀ, K becomes K + W C_K Wᵀ about the operating point. Each is a
                           matrix (p, p), symmetric or not; a number c, which stands for c times the unit matrix; or None.
    exerted(u, v)          the force f (p,) in motion: M q̈ + D q̇ + K q = W f(u, v), for `transient`
    tangents(u, v)         (∂f/∂u, ∂f/∂v), (p, p) each. At the operating point they are -C_K and -C_D.
    =====================  ================================================================================================

    The first two are required. Without the others the contact has no place in nonlinear motion, and is refused there by name.
    """

    @property
    def ports(self) -> tuple[str, ...]: ...

    def linearised(self, model: Substructure) -> tuple[Any, Any]: ...


Contacts: TypeAlias = Contact | Sequence[Contact] | None  # what functions take


@dataclass(frozen=True, eq=False, repr=False)
class LinearContact(Frozen):
    """A linear contact between ports: f = -C_K u - C_D v, with any real C_K and C_D, for springs, dashpots and friction's terms.

    D + W C_D Wᵀ, K + W C_K Wᵀ, where W (n, p) has the columns of the ports side by side. Coulomb friction at a constant μ makes
    C_K unsymmetric. A normal spring k with the tangential force -μ k u_n on the ports ("n", "t") has C_K = k [[1, 0], [μ, 0]].

    Parameters
    ----------
    ports : sequence of str
        Names of the ports; a port of several columns takes as many rows.
    stiffness, damping : array_like, shape (p, p), optional
        C_K (force / length) and C_D (force · time / length); none by default.

    Raises
    ------
    InputError, InputTypeError
        No port, neither of the matrices, matrices that are not square or not alike, NaN. Another number of columns than the
        model's ports have, when the contact is used.

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

    def __post_init__(self) -> None:
        names = [self.ports] if isinstance(self.ports, str) else items("ports", self.ports, "names of ports")
        if not names:
            raise InputError("a contact needs at least one port")
        found = {name: self._matrix(name) for name in ("stiffness", "damping")}
        given = [matrix for matrix in found.values() if matrix is not None]
        if not given:
            raise InputError("a linear contact needs stiffness or damping: matrices on the columns of its ports")
        if len({matrix.shape for matrix in given}) > 1:
            raise InputError(f"stiffness is {given[0].shape}, but damping {given[1].shape}")
        self._set(ports=tuple(word("each of ports", name) for name in names), **found)

    def _matrix(self, name: str) -> Array | None:
        if (value := getattr(self, name)) is None:
            return None
        matrix = np.array(real_array(name, value))
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            raise InputError(f"{name} must be square, one row per column of the ports, but its shape is {matrix.shape}")
        return matrix

    def __repr__(self) -> str:
        told = [f"{name} {len(matrix)} x {len(matrix)}, {'symmetric' if np.array_equal(matrix, matrix.T) else 'unsymmetric'}"
                for name in ("stiffness", "damping") if (matrix := getattr(self, name)) is not None]
        return f"LinearContact: on {', '.join(self.ports)}; {'; '.join(told)}"

    def linearised(self, model: Substructure) -> tuple[Array | None, Array | None]:
        """(C_D, C_K), whatever the model."""
        return self.damping, self.stiffness

    def exerted(self, u: Array, v: Array) -> Array:
        """f = -C_K u - C_D v, shape (p,)."""
        K, D = self.tangents(u, v)
        return K @ u + D @ v

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        """(-C_K, -C_D)."""
        none = np.zeros((len(u), len(u)))
        return none if self.stiffness is None else -self.stiffness, none if self.damping is None else -self.damping


def contacts_of(contacts: Any) -> tuple[Contact, ...]:
    """One contact, several or None as a tuple, each checked to be one."""
    if contacts is None:
        return ()
    given = [contacts] if isinstance(contacts, Contact) and not isinstance(contacts, type) else \
        items("contacts", contacts, "Belts or other contacts, or one of them")
    for contact in given:
        if isinstance(contact, type) or not isinstance(contact, Contact):
            raise InputTypeError("a contact must be a Belt, a LinearContact or another object with `ports` and "
                                 f"linearised(model), not {shown(contact)}")
    return tuple(given)


def port_columns(model: Substructure, contact: Contact) -> Array:
    """W (n, p), the columns of a contact's ports side by side; an unknown port is an InputError."""
    if isinstance(contact.ports, str) or not contact.ports:
        raise InputError(f"the ports of {type(contact).__name__} must be a tuple of names, not {shown(contact.ports)}")
    return np.hstack([model.port(name).reshape(model.size, -1) for name in contact.ports])


def small_matrices(model: Substructure, contact: Contact) -> tuple[Array, float | Array, float | Array]:
    """W (n, p), C_D and C_K of a contact on a model, checked: each C is a number or a matrix (p, p)."""
    W = port_columns(model, contact)
    terms = contact.linearised(model)
    if not isinstance(terms, tuple) or len(terms) != 2:
        raise InputTypeError(f"{type(contact).__name__}.linearised must return (C_D, C_K), not {shown(terms)}")
    checked: list[float | Array] = []
    for name, value in zip(("C_D", "C_K"), terms, strict=True):
        C = real_array(f"{name} of {type(contact).__name__}", 0.0 if value is None else value)
        if C.ndim and C.shape != (W.shape[1],) * 2:
            raise InputError(f"{name} of {type(contact).__name__} has the shape {C.shape}, but its ports "
                             f"({', '.join(contact.ports)}) have {W.shape[1]} columns on {model.name!r}")
        checked.append(np.array(C) if C.ndim else float(C))
    return W, checked[0], checked[1]
