"""Loss of stability over any parameter: flutter, negative damping and divergence. One question, and a solver chosen for it."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import check_band, choice, finite_number, shown
from femsub.errors import InputError, InputTypeError
from femsub.model import Substructure, usable_band
from femsub.stability.discs import Discs
from femsub.stability.followed import Followed
from femsub.stability.parameter import pencil_over
from femsub.stability.port_root import PortRoot
from femsub.stability.question import CriticalValue, Question, Solver

if TYPE_CHECKING:
    from femsub.model import Affine, Contacts

log = logging.getLogger(__name__)

#: In the order in which they are tried: the first that can answer a question does.
SOLVERS: Mapping[str, Solver] = {"discs": Discs(), "followed": Followed(), "root": PortRoot()}


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
    between : (begin, end)
        The range searched. It may fall, (0.0, -0.5): losses are then met on the way down. For a port's root it may be without
        end, (0.0, -inf).
    band : (lo, hi), optional
        Only crossings with lo ≤ ω ≤ hi count, in radians per unit of time. Default: all, for a reduced model those up to its
        cut-off. Divergence (ω = 0) counts if the band begins at 0. Needed for a model of more than 300 DOF.
    solver : {'auto', 'discs', 'followed', 'root'}
        'discs': up to 300 DOF; discs around all eigenvalues exclude all other crossings. 'followed': any size; candidates come
        from a small model on modes of the full one at some values of the parameter, and each is refined on the full pencil.
        'root': the first loss alone, where the parameter only feeds a port through D (see `critical_slope`); any size. 'auto'
        takes the first of them that can answer.

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
    An undamped model counts as stable while all its eigenvalues are on the axis. Two of its modes of one frequency, neither of
    which acts on the other, cannot be told from a flutter that is narrower than the window; such intervals are in `open`.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.critical_value(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", between=(0.0, -0.03))
    >>> print(f"{found.value:.6f} {found.losses[0].kind} {found.evidence}")
    -0.025567 hopf certified
    """
    choice("solver", solver, ("auto", *SOLVERS))
    question = question_of(model, contacts, parameter, between, band)
    reasons = []
    for one in SOLVERS.values() if solver == "auto" else [SOLVERS[solver]]:
        if not (reason := one.unfit(question)):
            return answer(question, one)
        reasons.append(reason)
    raise InputError("; ".join(reasons))


def question_of(model: Substructure | Affine, contacts: Contacts, parameter: str, between: tuple[float, float],
                band: tuple[float, float] | None) -> Question:
    """The question, checked."""
    begin, end = _range(between)
    over = pencil_over(model, contacts, parameter)
    limits = (0.0, np.inf) if band is None else check_band(band)
    if isinstance(model, Substructure):
        limits = usable_band(model, band)
    falls = end < begin
    if falls:
        over, begin, end = over.turned(), 0.0 - begin, 0.0 - end
    return Question(model, contacts, parameter, over, (begin, end), limits, band is not None, falls)


def answer(question: Question, solver: Solver) -> CriticalValue:
    """What a solver finds."""
    result = solver.solve(question)
    log.info("%r", result)
    return result


def _range(between: Any) -> tuple[float, float]:
    """(begin, end), different; the end may be infinite."""
    if isinstance(between, (str, bytes, Mapping, set)) or not isinstance(between, Iterable) or len(pair := list(between)) != 2:
        raise InputTypeError(f"between must be a pair (begin, end), not {shown(between)}")
    begin = finite_number("between", pair[0])
    end = pair[1] if isinstance(pair[1], float) and np.isinf(pair[1]) else finite_number("between", pair[1])
    if begin == end:
        raise InputError(f"between must be a range, but begins and ends at {begin:g}")
    return begin, float(end)
