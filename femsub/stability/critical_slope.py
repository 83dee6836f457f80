"""The friction slope at which steady sliding on a port loses its stability: `critical_value` over a falling slope without end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import choice, instance, positive_number
from femsub.coupling import Belt
from femsub.errors import InputError, UnstableModelError
from femsub.model import LinearContact, Substructure, contacts_of, small_matrices
from femsub.stability.critical_value import answer, question_of
from femsub.stability.port_root import PortRoot

if TYPE_CHECKING:
    from femsub.model import Contact, Contacts
    from femsub.stability.question import CriticalValue


def critical_slope(model: Substructure, port: str = "belt", *, force: float = 1.0, contacts: Contacts = None,
                   band: tuple[float, float] | None = None, method: str = "auto") -> CriticalValue:
    """The friction slope c/F at which steady sliding on a port loses its stability.

    On the border a pair λ = iω fulfils 1 + c·iω·wᵀ(-ω²M + iωD + K)⁻¹w = 0. Every root found is verified on the pencil. This is
    ``critical_value(model, [Belt(port, force=force, slope=0.0), ...], "slope", between=(0.0, -inf), solver="root")``.

    Parameters
    ----------
    model : Substructure
        Full or reduced.
    port : str
        The port under the belt. With several columns the contact is D + c W Wᵀ, and the border is bracketed on the
        complex modes instead of found as a root.
    force : float
        Normal force F; the slope returned is c/F.
    contacts : Belt, LinearContact or another contact, or a sequence of them
        Contacts that act as well, with terms in D only. For terms in K see `critical_value`.
    band : (lo, hi), optional
        Only pairs with lo ≤ Im λ ≤ hi count. Default: all pairs of a dense (or small sparse) model; for a reduced model those
        below its cut-off. A band above the cut-off is refused, since modes there are artefacts of the reduction, often hardly
        damped. Required for a sparse model above 2,000 DOF. With lo = 0 rigid motion that loses its damping counts, too
        (ω = 0, 'divergence').
    method : {'auto', 'scalar', 'bracketing'}
        How the border is found: as a root of the scalar function above, or by bracketing on the complex modes.

    Returns
    -------
    CriticalValue
        Of the largest c ≤ 0 at which a pair in the band reaches the imaginary axis and grows just below. The value is 0.0 if a
        mode under the belt has no damping beyond rounding (damping ratio below 1e-13), and -inf if stability is never lost.
        `growth` is Re λ of the pair at 0.999 c and at 1.001 c, computed from the pencil as a verification.

    Raises
    ------
    UnstableModelError
        The model is unstable at c = 0; the message shows λ.
    InputError
        An unknown port or method, a force that is not positive, a missing band, or one that reaches above the cut-off; a contact
        that adds to K.
    NotConvergedError
        A root could not be verified on the pencil; rounding may move it by a relative 1e-3 or more; or a pair that lost its
        stability outside the band has moved into it before.

    Warns
    -----
    CutoffWarning
        The border of a reduced model lies above 0.7 of its cut-off, where its modes may be inaccurate; or none was found in a
        band that reaches above that. Or the border moves by more than 3 % if the responses to the residuals of its modes join
        the basis, as it may where two frequencies are closer than they are accurate. This is looked at while the full
        component exists; of one above 5,000 DOF only for such frequencies.

    Examples
    --------
    >>> import femsub as fs
    >>> critical = fs.critical_slope(fs.chain(10, belt=2))
    >>> print(f"{critical.value:.6f} {critical.omega:.5f} {len(critical.crossing)}")
    -0.025567 0.14946 1
    """
    instance("model", model, Substructure, "with a port")
    choice("method", method, ("auto", "scalar", "bracketing"))
    model.port(port)
    belt = Belt(port, force=positive_number("force", force), slope=0.0)
    held = [_held(model, one) for one in contacts_of(contacts)]
    question = question_of(model, [belt, *(one for one in held if one is not None)], "slope", (0.0, -np.inf), band)
    solver = PortRoot(method)
    if reason := solver.unfit(question):
        raise InputError(reason)
    result = answer(question, solver)
    if result.growing:
        worst = result.fastest
        raise UnstableModelError(f"the model is unstable before the belt acts: λ = {worst.real:.6g} {worst.imag:+.6g}i. The "
                                 "critical slope needs a model that is stable at slope 0. Check D")
    return result


def _held(model: Substructure, contact: Contact) -> Contact | None:
    """A contact whose own slope does not change; None if it does nothing."""
    if not hasattr(contact, "slope"):
        return contact
    W, D, K = small_matrices(model, contact)
    unit = np.eye(W.shape[1])
    terms = {name: C * unit if isinstance(C, float) else C for name, C in (("damping", D), ("stiffness", K)) if np.any(C)}
    return LinearContact(contact.ports, **terms) if terms else None
