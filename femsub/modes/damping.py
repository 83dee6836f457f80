"""Damping of a component, full or reduced: Rayleigh, modal and dashpots, all in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from femsub.checks import DENSE, InputError, InputTypeError, Matrix, finite_number, instance, items, positive_number, whole_number
from femsub.components import not_negative, pair, proportional
from femsub.model import ReducedSubstructure, Substructure
from femsub.modes.normal_modes import all_modes, lowest_modes
from femsub.modes.shift_invert import ShiftInvert

Model = TypeVar("Model", bound=Substructure)


def damped(sub: Model, *, rayleigh: tuple[float, float] | None = None,
           ratios: tuple[tuple[float, float], tuple[float, float]] | None = None, modal: float | Sequence[float] | None = None,
           dashpots: Mapping[Any, float] | None = None, structural: float | None = None) -> Model:
    """A copy of a model with more damping: Rayleigh, modal, dashpots, and a loss factor.

    D becomes D + αM + βK + MΦ diag(2ζω) ΦᵀM + Σ c w wᵀ, and H becomes H + ηK, all (n, n). Everything given is added to the
    existing damping (`sub.with_damping(None)` and `sub.with_structural_damping(None)` remove that).

    Parameters
    ----------
    sub : Substructure
        Full or reduced.
    rayleigh : (alpha, beta)
        α in 1/time, β in time. A mode then has ζ = α/(2ω) + βω/2.
    ratios : ((omega1, zeta1), (omega2, zeta2))
        Rayleigh damping that has these ratios at these frequencies (radians per unit of time).
    modal : float or sequence of float
        ζ of every elastic mode, or of the lowest elastic modes by frequency (the others get none). Rigid-body modes stay
        undamped. D becomes a full matrix, so apply it to the reduced model if a sparse one has more than 2,000 DOF.
    dashpots : mapping to float
        c in force × time / length (a port's own unit), by the name of a port, by a DOF counted from 0 (to the
        ground), or by a pair of DOF (between the two). For a reduced model the DOF are those of the component it
        was made from, the rows of V.
    structural : float
        The loss factor η of all of K: harmonic motion has the stiffness K(1 + iη), see `equivalent_viscous`. In a system each
        part may have its own, given before they are joined.

    Raises
    ------
    InputError, InputTypeError
        No damping is given; a negative ζ, c, α, β or η; two ratios that need a negative α or β; an unknown port or DOF; modal
        damping of a large sparse model.

    References
    ----------
    Craig and Kurdila, Fundamentals of Structural Dynamics, 2006, sec. 10.3 (proportional damping; modal damping, with
    D = MΦ diag(2ζω) ΦᵀM for ΦᵀMΦ = I).

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.damped(fs.chain(5, damping=0.0), modal=0.01)
    >>> fs.complex_modes(sub).damping_percent[:2].round(2)
    array([1., 1.])
    """
    if not isinstance(sub, Substructure):
        raise InputTypeError(f"damped takes a Substructure, not {type(sub).__name__}")
    if rayleigh is None and ratios is None and modal is None and dashpots is None and structural is None:
        raise InputError("damped needs at least one of rayleigh, ratios, modal, dashpots and structural")
    if rayleigh is not None and ratios is not None:
        raise InputError("rayleigh and ratios both define Rayleigh damping. Give only one of them")
    D = sub.D

    # Rayleigh: α, β with ζ_i = α/(2ω_i) + βω_i/2
    if ratios is not None:
        points = [pair("each point of ratios", point, "(omega, zeta)")
                  for point in pair("ratios", ratios, "((omega1, zeta1), (omega2, zeta2))")]
        (low, zeta), (high, other) = sorted(
            (finite_number("omega of ratios", omega), not_negative("zeta of ratios", zeta)) for omega, zeta in points)
        if not 0 < low < high:
            raise InputError(f"ratios needs two different positive frequencies, not {low:.6g} and {high:.6g}")
        mass, stiffness = zeta * high - other * low, other * high - zeta * low
        if min(mass, stiffness) < -1e-12 * max(zeta, other) * high:
            raise InputError(f"ratios: ζ = {zeta:.4g} at ω = {low:.6g} and {other:.4g} at {high:.6g} would need a negative α or "
                             f"β. With the first point, the second ζ can be {zeta * low / high:.4g} to {zeta * high / low:.4g}")
        span = high**2 - low**2
        rayleigh = 2 * low * high * max(mass, 0.0) / span, 2 * max(stiffness, 0.0) / span
    if rayleigh is not None:
        D = D + proportional(sub, rayleigh)

    # modal: MΦ diag(2ζω) ΦᵀM, dense
    if modal is not None:
        if sp.issparse(sub.K) and 2 * sub.size > DENSE:  # complex modes then have 2n states
            raise InputError(f"modal damping makes D a full matrix, but {sub.name!r} has {sub.size} DOF (at most {DENSE // 2}). "
                             "Apply it to the reduced model, damped(reduce(...), modal=...), or use ratios=")
        if isinstance(modal, str) or not isinstance(modal, (int, float, np.number, Sequence, np.ndarray)):
            raise InputTypeError(f"modal must be a ratio or a sequence of them, not {modal!r:.80}")
        if isinstance(modal, (Sequence, np.ndarray)):
            each = np.array([not_negative(f"modal[{i}]", value) for i, value in enumerate(items("modal", modal, "ratios"))])
            modes = lowest_modes(ShiftInvert(sub.K, sub.M, carried=sub.rigid_motion), len(each))  # refuses more than exist
        else:
            modes = all_modes(sub.K, sub.M, carried=sub.rigid_motion)
            each = np.full(len(modes.eigenvalues) - modes.rigid, not_negative("modal", modal))
        forces = (sub.M @ modes.shapes[:, modes.rigid:]) * np.sqrt(2 * each * modes.elastic)
        D = D + forces @ forces.T

    # dashpots: Σ c w wᵀ, sparse
    if dashpots is not None:
        if not isinstance(dashpots, Mapping):
            raise InputTypeError(f"dashpots must map DOF, pairs of DOF or ports to numbers, not {type(dashpots).__name__}")
        columns, sizes = [sp.csr_array((sub.size, 0))], []
        for key, value in dashpots.items():
            columns.append(_column(sub, key))
            sizes += [not_negative(f"dashpot {key!r}", value)] * columns[-1].shape[1]
        weighted = sp.csr_array(sp.hstack(columns)) @ sp.diags_array(np.sqrt(sizes))
        added = sp.csr_array(weighted @ weighted.T)
        D = D + (added if sp.issparse(D) else added.toarray())
    found = sub if D is sub.D else sub.with_damping(D)
    if structural is not None:
        H = not_negative("structural", structural) * sub.K
        found = found.with_structural_damping(H if sub.H is None else sub.H + H)
    return found


def equivalent_viscous(model: Model, omega: float) -> Model:
    """A copy with viscous damping in place of structural damping: D + H/ω, shape (n, n), and no H.

    At ω the damping force is the same. A mode at ω_j has the loss factor η ω_j/ω in place of η: less below ω, more above. With ω
    at the top of a band, no mode in the band gets more damping than by H. Use it for analyses that do not accept H.

    Parameters
    ----------
    model : Substructure
        Full, reduced or joined, with structural damping.
    omega : float
        ω in radians per unit of time.

    Raises
    ------
    InputError, InputTypeError
        A model without structural damping; ω that is not positive.

    References
    ----------
    R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics, 2006, sec. 4.6 (equivalent viscous damping). Nastran does the
    same for its transients by PARAM,W3 and W4.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.damped(fs.chain(5, damping=0.0), structural=0.02)
    >>> viscous = fs.equivalent_viscous(sub, 0.5)
    >>> viscous.H is None, bool(abs(viscous.D - 0.04 * sub.K).max() < 1e-15)
    (True, True)
    """
    H = instance("model", model, Substructure).H
    if H is None:
        raise InputError(f"{model.name!r} has no structural damping: give it a loss factor by damped(model, structural=0.02) or "
                         "by its materials")
    return model.with_structural_damping(None).with_damping(model.D + H / positive_number("omega", omega))


def _column(sub: Substructure, key: Any) -> Matrix:
    """w (n, p) of a dashpot at a port, at a DOF, or between two DOF."""
    if isinstance(key, str):
        return sp.csr_array(sub.port(key).reshape(sub.size, -1))
    pair = key if isinstance(key, tuple) else (key,)
    if not 1 <= len(pair) <= 2:
        raise InputError(f"a dashpot acts at one DOF or between two, not at {key!r}")
    basis = sub.V if isinstance(sub, ReducedSubstructure) else sp.eye_array(sub.size, format="csr")
    ends = [whole_number("the DOF of a dashpot", dof) for dof in pair]
    for dof in ends:
        if not 0 <= dof < basis.shape[0]:
            raise InputError(f"dashpot: there is no DOF {dof}. {sub.name!r} has {basis.shape[0]}, counted from 0")
    if len(set(ends)) < len(ends):
        raise InputError(f"the dashpot {key!r} has the same DOF at both ends. Give two different DOF")
    rows = basis[ends]
    return sp.csr_array(rows if len(ends) == 1 else rows[[0]] - rows[[1]]).T
