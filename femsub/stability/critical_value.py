"""Loss of stability over any parameter: flutter, negative damping and divergence. One question, and a solver chosen for it.

`critical_slope` is the question for the slope of a belt, which falls from 0 without limit.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from femsub.checks import (
    InputError,
    InputTypeError,
    UnstableModelError,
    choice,
    finite_number,
    instance,
    items,
    positive_number,
    shown,
)
from femsub.coupling import Belt
from femsub.model import (
    Affine,
    Contact,
    Contacts,
    LinearContact,
    Substructure,
    contacts_at,
    contacts_of,
    small_matrices,
    usable_band,
)
from femsub.stability.discs import Discs
from femsub.stability.followed import Followed
from femsub.stability.parameter import pencil_over
from femsub.stability.port_root import PortRoot
from femsub.stability.question import CriticalValue, LossQuestion

log = logging.getLogger(__name__)

#: `unfit` returns the reason why a solver cannot answer a question, or '' if it can. `solve` returns the answer.
Solver: TypeAlias = Discs | Followed | PortRoot
#: In the order in which they are tried: the first that can answer a question does.
SOLVERS: Mapping[str, Solver] = {"discs": Discs(), "swept": Followed(any_rank=True), "followed": Followed(), "root": PortRoot()}


def critical_value(model: Substructure | Affine, contacts: Contacts, parameter: str, *, between: tuple[float, float],
                   band: tuple[float, float] | None = None, solver: str = "auto") -> CriticalValue:
    """The values of a parameter at which stability is lost and regained: flutter, negative damping and divergence.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced, of any size.
    contacts : Belt, LinearContact or another contact, or a sequence of them
        On the model's ports; None for an `Affine`.
    parameter : str
        A field of one of the contacts, such as 'mu' or 'speed'. It changes in all contacts that have it. Or a parameter of an
        `Affine`; give values to the others before, ``affine.fixed(speed=5.0)``.
    between : (start, end)
        The range searched. It may descend, (0.0, -0.5): losses are then sought on the way down. For a port's root it may be
        infinite, (0.0, -inf).
    band : (lo, hi), optional
        Only crossings with lo ≤ ω ≤ hi count, in radians per unit of time. Default: all, for a reduced model those up to its
        cut-off. Divergence (ω = 0) counts if the band begins at 0. Needed for a model of more than 300 DOF.
    solver : {'auto', 'discs', 'swept', 'followed', 'root'}
        'discs': up to 300 DOF; discs around all eigenvalues exclude all other crossings. 'swept': any size, for damped models
        with an affine parameter; sweeps along the lines around all growing λ in the band exclude all other crossings. If the
        sweeps fail, the model is followed. 'followed': any size; candidates come from a small model on modes of the full model
        at some values of the parameter. Each candidate is refined on the full pencil. Sweeps exclude all other crossings only if
        the parameter acts through few columns. 'root': any size; only the first loss, if the parameter only feeds a port through
        D (see `critical_slope`). 'auto' takes the first solver that can answer.

    Returns
    -------
    CriticalValue

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, a range that a contact refuses, a solver that cannot answer this, a missing band, or a model that
        floats or has massless motions.

    Notes
    -----
    An undamped model counts as stable while all its eigenvalues are on the axis. Two uncoupled undamped modes of equal frequency
    look like a flutter that is narrower than the window; such intervals are in `open`.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.critical_value(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", between=(0.0, -0.03))
    >>> print(f"{found.value:.6f} {found.losses[0].kind} {found.evidence}")
    -0.025567 hopf certified
    """
    choice("solver", solver, ("auto", *SOLVERS))
    question = question_of(model, contacts, parameter, between, band)
    return _answer(question, SOLVERS.values() if solver == "auto" else [SOLVERS[solver]])


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
        For the largest c ≤ 0 at which a pair in the band reaches the imaginary axis and grows just below. The value is 0.0 if a
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
        the basis. This may happen if two frequencies are closer than their errors. The check needs the full component; above
        5,000 DOF only such frequencies are checked.

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
    acting: list[Contact] = [belt]
    for one in contacts_of(contacts):  # a contact with a slope of its own, which must not change, acts by its matrices
        if hasattr(one, "slope"):
            W, D, K = small_matrices(model, one)
            unit = np.eye(W.shape[1])
            terms = {name: C * unit if isinstance(C, float) else C for name, C in (("damping", D), ("stiffness", K)) if np.any(C)}
            acting += [LinearContact(one.ports, **terms)] if terms else []
        else:
            acting.append(one)
    question = question_of(model, acting, "slope", (0.0, -np.inf), band)
    result = _answer(question, [PortRoot(method)])
    if result.growing:
        worst = result.fastest
        raise UnstableModelError(f"the model is unstable before the belt acts: λ = {worst.real:.6g} {worst.imag:+.6g}i. The "
                                 "critical slope needs a model that is stable at slope 0. Check D")
    return result


def first_value(model: Substructure | Affine, contacts: Contacts, parameter: str, between: tuple[float, float],
                band: tuple[float, float], near: float = np.nan) -> CriticalValue:
    """`critical_value` by following, up to a value of the parameter beyond the first loss: for tables of many models.

    The loss is expected `near` the loss of a smaller model. If it is found elsewhere, its evidence is the same.
    """
    question = question_of(model, contacts, parameter, between, band)
    return _answer(question, [Followed(first=True, near=-near if question.falls else near)])


def question_of(model: Substructure | Affine, contacts: Contacts, parameter: str, between: tuple[float, float],
                band: tuple[float, float] | None) -> LossQuestion:
    """The question, after checks of the arguments."""
    # start and end must differ, and the end may be infinite
    if isinstance(between, set) or len(pair := items("between", between, "two numbers (start, end)")) != 2:
        raise InputTypeError(f"between must be a pair (start, end), not {shown(between)}")
    begin = finite_number("between", pair[0])
    end = float(pair[1]) if isinstance(pair[1], float) and np.isinf(pair[1]) else float(finite_number("between", pair[1]))
    if begin == end:
        raise InputError(f"between must be a range, but begins and ends at {begin:g}")
    over = pencil_over(model, contacts, parameter)
    limits = usable_band(model, band)
    left = []  # whether rigid motion is left at both ends of the range; friction may drive it only if the band begins above 0
    if isinstance(model, Substructure):
        for value in (begin, end if np.isfinite(end) else begin + float(np.sign(end))):
            try:
                acting = contacts_at(contacts, parameter, value)
            except InputError:  # a contact may refuse the end of a range
                continue
            if not limits[0]:
                model.check_held(acting)
            motion = model.floating(acting)
            left.append(motion is not None and motion.count > 0)
    floats = bool(left) and all(left)
    falls = end < begin
    if falls:
        over, begin, end = replace(over, sign=-1.0), 0.0 - begin, 0.0 - end
    return LossQuestion(model, contacts, parameter, over, (begin, end), limits, band is not None, falls, floats)


def _answer(question: LossQuestion, solvers: Iterable[Solver]) -> CriticalValue:
    """The answer of the first solver that can answer the question."""
    reasons = []
    for one in solvers:
        if not (reason := one.unfit(question)):
            result = one.solve(question)
            log.info("%r", result)
            return result
        reasons.append(reason)
    raise InputError("; ".join(dict.fromkeys(reasons)))

