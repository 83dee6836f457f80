"""Loss of stability of a model of any size under a contact that feeds one port: D + c W Wᵀ, c falling from 0 without end.

On the border a pair λ = iω fulfils 1 + c·iω·wᵀ(-ω²M + iωD + K)⁻¹w = 0. Every root found is verified on the pencil.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from femsub.algebra import QUADRATIC, WIDE, negative_eigenvalues
from femsub.checks import EQUAL, Array, Tally
from femsub.errors import CutoffWarning, InputError, warn
from femsub.model import SHARE, Pencil, Substructure, contacts_of
from femsub.stability.border import Border, dense_border
from femsub.stability.border_doubt import doubt
from femsub.stability.crossings import Crossing, change, weight
from femsub.stability.growing_border import ACTING, sparse_border
from femsub.stability.question import CriticalValue, LossQuestion, fastest


class Fed(NamedTuple):
    """A pencil at the begin of the range, and how the parameter feeds the columns W (n, k): D + s (p - begin) W Wᵀ."""

    pencil: Pencil
    W: Array
    s: float


class PortRoot:
    """The first loss as a root of the scalar function (one column), or by bracketing on the complex modes (several)."""

    def __init__(self, method: str = "auto") -> None:
        self.method = method

    def unfit(self, question: LossQuestion) -> str:
        if isinstance(question.model, Substructure):
            fed = port_fed(question)
            if fed is not None and fed.s < 0 and all(fed.pencil.symmetric[::2]):
                return ""
        return ("the port's root takes a Substructure and a parameter that only takes damping from one port, as a falling "
                "slope of a Belt, with other contacts that add to D only. See critical_value with a finite range, which takes "
                "any")

    def solve(self, question: LossQuestion) -> CriticalValue:
        model, fed = question.model, port_fed(question)
        assert isinstance(model, Substructure) and fed is not None
        if self.method == "scalar" and fed.W.shape[1] > 1:
            raise InputError(f"the port has {fed.W.shape[1]} columns, but the scalar function takes one. Use "
                             "method='bracketing'")
        if model.pencil.is_sparse and not question.limited and model.size > QUADRATIC:
            raise InputError(f"a sparse model of {model.size} DOF needs a band: give band=(lo, hi) in rad per unit of time, the "
                             "frequencies that may lose their stability")
        found = self._border(question)
        # what may be inaccurate of a reduced model
        stable, sure = not len(found.unstable), SHARE * model.cutoff
        ports = [name for contact in contacts_of(question.contacts) if hasattr(contact, question.parameter)
                 for name in contact.ports]
        if stable and (found.omega > sure or (np.isinf(found.c) and question.band[1] > sure)):
            what = f"the border at ω = {found.omega:.5g} lies" if np.isfinite(found.c) else \
                f"no border was found, but the band, which ends at {question.band[1]:.5g}, reaches"
            warn(f"{what} above {SHARE:g} of the cut-off of {model.name!r} ({model.cutoff:.5g} rad/time), where modes of a "
                 "reduced model may be inaccurate. Keep more modes", CutoffWarning)
        elif stable and len(ports) == 1:
            finding = doubt(model, fed.pencil, ports[0], question.band, found, lambda wide: self._border(question.of(wide)))
            if finding:
                warn(finding, CutoffWarning)
        begin, end = question.between
        value = begin + found.c / fed.s
        losses = [] if not value <= end else [
            Crossing(value, 2 * EQUAL * abs(value - begin), float(omega), shape, "hopf" if omega else "divergence",
                     found.growth)
            for omega, shape in zip(found.crossing, found.shapes.T, strict=True)]
        beyond = found.beyond if losses else None
        tally = Tally(change(losses, ()), beyond, sampled=True)
        return CriticalValue.of(question, losses, (), tally, growing=weight(found.unstable.imag), fastest=fastest(found.unstable),
                                method=found.method)

    def _border(self, question: LossQuestion) -> Border:
        fed = port_fed(question)
        assert fed is not None
        # a sparse model is treated as dense up to half the DOF of a dense one: its factor costs little
        if question.limited and (fed.pencil.size > WIDE / 2 if fed.pencil.is_sparse else is_narrow(fed.pencil, question.band[1])):
            return sparse_border(fed.pencil.sparse(), fed.W, question.band, self.method)
        return dense_border(fed.pencil, fed.W, question.band, self.method)


def port_fed(question: LossQuestion) -> Fed | None:
    """How the parameter feeds a port; None if it does anything else, or if its contact refuses the begin or a value beyond."""
    begin, end = question.between
    try:
        found = question.over.port_damping(begin, min(begin + 1.0, end))
    except InputError:
        return None
    if found is None or not isinstance(question.model, Substructure):
        return None
    pencil = question.over(begin)
    return Fed(pencil, *found) if pencil.K is question.model.pencil.K else None


def is_narrow(pencil: Pencil, top: float) -> bool:
    """Whether a dense pencil has few modes up to a frequency: of a twelfth a search took a tenth of LAPACK's time for all."""
    if pencil.size <= WIDE or not np.isfinite(top):
        return False
    if not pencil.M.diagonal().all():
        return True  # only a basis of modes can do without massless motions
    below = negative_eigenvalues(pencil.K - (ACTING * top) ** 2 * pencil.M)
    return bool(12 * below <= pencil.size)
