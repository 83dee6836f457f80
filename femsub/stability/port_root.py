"""Loss of stability of a model of any size under a contact that feeds one port: D + c W Wᵀ, c falling from 0 without end.

On the border a pair λ = iω fulfils 1 + c·iω·wᵀ(-ω²M + iωD + K)⁻¹w = 0. Every root found is verified on the pencil.

The border of a reduced model depends on its truncation error, above all where two frequencies are close. Two modes of nearly
equal frequency mix: a small error of the model changes their shapes, and with them the damping of each mode. A dashpot whose
response is not in the basis has the same effect. So the border may be far off although all frequencies are accurate. It is
therefore computed again on a wider model, whose basis also has the responses to the residuals of the modes
(`femsub.reduction.wider`).

For a large component this takes time. In that case only modes are examined whose distance is below their error. The error of a
frequency is that of the model's estimate, or it is bounded from the modes left out. S = M_cc - M_co M_oo⁻¹ M_oc is the mass of
the constraint modes that the kept modes do not represent, q_b are the coordinates of the constraint modes. ω² falls by at most

    ω⁴ q_bᵀ S q_b / (θ - ω²),   θ = ω_cut².
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, WIDE, negative_eigenvalues
from femsub.checks import EQUAL, Array, CutoffWarning, FemsubError, InputError, Tally, warn
from femsub.model import SHARE, Pencil, ReducedSubstructure, Substructure, contacts_of
from femsub.stability.border import Band, Border, ModalContact, dense_border
from femsub.stability.crossings import Crossing, change, weight
from femsub.stability.discs import LARGEST
from femsub.stability.growing_border import ACTING, sparse_border
from femsub.stability.question import CriticalValue, LossQuestion, fastest

log = logging.getLogger(__name__)


class Fed(NamedTuple):
    """A pencil at the start of the range, and how the parameter feeds the columns W (n, k): D + s (p - begin) W Wᵀ."""

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
                "slope of a Belt, with other contacts that add to D only. critical_value with a finite range takes any "
                "parameter")

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
        # warnings where a reduced model may be inaccurate
        stable, sure = not len(found.unstable), SHARE * model.cutoff
        ports = [name for one in contacts_of(question.contacts) if hasattr(one, question.parameter) for name in one.ports]
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
        losses = [Crossing(value, 2 * EQUAL * abs(value - begin), float(omega), shape, "hopf" if omega else "divergence",
                           found.growth)
                  for omega, shape in zip(found.crossing, found.shapes.T, strict=True) if value <= end]
        tally = Tally(change(losses, ()), found.beyond if losses else None, sampled=True)
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
    """W and s if the parameter p acts only by a term s p W Wᵀ in D, which is checked at two values.

    None if it acts in another way, or if its contact refuses the start or a value beyond.
    """
    model, over, (begin, end) = question.model, question.over, question.between
    share, beside = over.shares[0], min(begin + 1.0, end)
    if not isinstance(model, Substructure) or len(over.shares) > 1 or share.terms is None or not share.affine:
        return None
    try:
        (W, D, K), (_, other, stiff) = share.terms(over.sign * begin), share.terms(over.sign * beside)
    except InputError:
        return None
    if any(sp.issparse(C) for C in (W, D, K, other, stiff)) or np.any(np.asarray(stiff) - K):
        return None
    slope, pencil = (np.asarray(other) - D) / (beside - begin), over(begin)
    s = float(slope.flat[0])
    if not s or not (slope.ndim == 0 or np.array_equal(slope, s * np.eye(len(slope)))) or pencil.K is not model.pencil.K:
        return None
    return Fed(pencil, np.asarray(W), s)


def is_narrow(pencil: Pencil, top: float) -> bool:
    """Whether a dense pencil has up to a twelfth of its modes below `top`: a search for these takes a tenth of LAPACK's time."""
    if pencil.size <= WIDE or not np.isfinite(top):
        return False
    if not pencil.M.diagonal().all():
        return True  # only a basis of modes can do without massless motions
    below = negative_eigenvalues(pencil.K - (ACTING * top) ** 2 * pencil.M)
    return bool(12 * below <= pencil.size)


def doubt(model: Substructure, pencil: Pencil, port: str, band: Band, found: Border,
          border: Callable[[Substructure], Border], close: float = 0.1, moved: float = 0.03, largest: int = 1000,
          small: int = 5000, most: int = 12) -> str:
    """In words, how much the border moves on a wider model; '' if it hardly moves, or if the full component no longer exists.

    `pencil` is that of the model under contacts at the start, and `border` gives the border of a model with these contacts. Two
    frequencies are neighbours if they differ by less than a share `close`; one of them may be outside the band. A relative change
    above `moved` is reported. A model above `largest` coordinates is not examined. For a component above `small` DOF at most
    `most` modes are examined: each takes two solves with its factor, and adds two coordinates to the wider model.
    """
    if not np.isfinite(model.cutoff) or found.c == 0:
        return ""
    if model.size > largest:
        log.info("the border of %r is not compared with that of a wider model: it has %d coordinates, and %d is the limit",
                 model.name, model.size, largest)
        return ""
    form = ModalContact(pencil.dense(), model.port(port).reshape(model.size, -1)).form
    omega, X = form.omega[form.rigid:], form.shapes[:, form.rigid:]
    order = np.argsort(omega)
    wide = band[0] / (1 + close), min(band[1] * (1 + close), 0.99 * model.cutoff)
    order = order[(omega[order] >= wide[0]) & (omega[order] <= wide[1])]
    omega, X = omega[order], X[:, order]
    # the modes i whose distance to the next mode is below the errors of both, smallest ratio first
    error = omega * _errors(model, omega, X)
    gap, least = np.diff(omega), error[1:] + error[:-1]
    near = np.flatnonzero((gap <= least) & (gap <= close * omega[1:]))
    near = near[np.argsort(gap[near] / least[near], kind="stable")]
    chosen = np.arange(len(omega))
    if _full_size(model) > small or model.size + 2 * len(omega) > LARGEST:
        chosen = np.unique(np.concatenate([near[:most // 2], near[:most // 2] + 1]))
    try:
        larger = _wider(model, omega[chosen], X[:, chosen], port) if len(chosen) else None
        other = found if larger is None else border(larger)
    except FemsubError:  # the border of the wider model is not known
        return ""
    if larger is None and np.isfinite(found.omega):
        mine = np.abs(omega - found.omega).argmin() if len(omega) else -1
        near = near[(near == mine) | (near + 1 == mine)]
        return _advice(f"the border of {model.name!r} at ω = {found.omega:.5g} may be inaccurate, and it cannot be checked "
                       "without the full component", omega, near) if len(near) else ""
    if other.c == found.c or abs(other.c - found.c) <= moved * abs(other.c):
        return ""
    change = "appears" if np.isinf(found.c) else "vanishes" if np.isinf(other.c) else \
        f"moves by {abs(other.c / found.c - 1):.1%} (to ω = {other.omega:.5g})"
    return _advice(f"the border of {model.name!r} {change} if the responses to the residuals of its modes join the basis",
                   omega, near)


def _advice(finding: str, omega: Array, near: Array) -> str:
    if len(near):
        finding += (f". The distance of two frequencies is below their errors ({omega[near[0]]:.7g} and "
                 f"{omega[near[0] + 1]:.7g}), so their modes may be mixed wrongly")
    return finding + ". Keep more modes, or put the DOF of dashpots and belts into the interface"


def _full_size(model: Any) -> int:
    """The number of DOF of the full component, or of the full components of all parts."""
    if hasattr(model, "parts"):
        return sum(map(_full_size, model.parts.values()))
    return len(model.V) if isinstance(model, ReducedSubstructure) else int(model.size)


def _shares(system: Any, q: Array) -> Iterator[tuple[str, Substructure, Array]]:
    """Name and model of each part, with the shapes q (r, k) in its coordinates."""
    at = 0
    for name, part in system.parts.items():
        yield name, part, system.L[at:at + part.size] @ q
        at += part.size


def _errors(model: Any, omega: Array, q: Array, joined: bool = False) -> Array:
    """The relative error of each ω that the modes left out may cause, (k,), for shapes q (r, k)."""
    if (estimate := getattr(model, "estimate", None)) is not None and len(estimate.frequencies) and not joined:
        at = np.abs(omega[:, None] - estimate.frequencies).argmin(axis=1)
        return np.where(omega <= estimate.band[1], estimate.frequency_error[at], 0.0)
    if hasattr(model, "parts"):
        return np.sum([_errors(part, omega, own, True) for _, part, own in _shares(model, q)], axis=0)
    if not np.isfinite(model.cutoff):
        return np.zeros(len(omega))
    constraint = np.array([kind == "constraint" for kind in getattr(model, "kinds", ())], dtype=bool)
    if constraint.any():
        kept, cross = model.M[np.ix_(~constraint, ~constraint)], model.M[np.ix_(~constraint, constraint)]
        missed = model.M[np.ix_(constraint, constraint)] - cross.T @ np.linalg.lstsq(kept, cross, rcond=None)[0]
        energy = np.einsum("ij,ij->j", q[constraint], missed @ q[constraint])
    else:
        energy = np.einsum("ij,ij->j", q, model.M @ q) * joined  # the modes of a single part with free interface are exact
    return np.asarray(omega**2 * np.maximum(energy, 0.0) / (2 * np.maximum(model.cutoff**2 - omega**2, 1e-3 * omega**2)))


def _wider(model: Any, omega: Array, q: Array, port: str) -> Substructure | None:
    """The model with the responses to the residuals of these modes in its basis; None if no full component exists."""
    if hasattr(model, "parts"):
        found = {name: _wider(part, omega, own, port.removeprefix(f"{name}.") if port.startswith(f"{name}.") else "")
                 for name, part, own in _shares(model, q)}
        wide = {name: part for name, part in found.items() if part is not None}
        return model.with_parts(wide) if wide and not model.own_damping else None
    widened = getattr(model, "wider", None)
    return None if widened is None else widened(model, omega, q, port)
