"""Where friction takes the stability away: the sweep over the slope, and the critical slope itself."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from femsub.checks import Array, choice, instance, positive_number, real_array
from femsub.errors import CutoffWarning, FemsubWarning, InputError, SingularMatrixError
from femsub.linalg.factor import QUADRATIC, WIDE, factorise
from femsub.linalg.threads import FEW, one_thread
from femsub.model.bands import in_band
from femsub.model.estimate import SHARE, usable_band
from femsub.model.friction import Belt
from femsub.model.substructure import Substructure
from femsub.quadratic.complex_modes import complex_modes
from femsub.quadratic.dense import eigenvalues, modal_form
from femsub.stability.border import dense_border, sparse_border

log = logging.getLogger(__name__)

SMALL = 150  # up to so many DOF a sparse model is treated as dense
FAR = 1e8  # times the end of a band: no Re λ is so large


@dataclass(frozen=True, eq=False, repr=False)
class StabilitySweep:
    """The largest Re λ over the friction slope; m slopes.

    Attributes
    ----------
    slopes : ndarray, shape (m,)
        μ'(v0); D gets force · slope · w wᵀ.
    growth : ndarray, shape (m,)
        max Re λ over the band, rigid-body modes left out, 1 per unit of time.
    omega : ndarray, shape (m,)
        Im λ of that mode.
    band : (lo, hi)
        What was looked at: of a reduced model no more than what lies below its cut-off.
    """

    slopes: Array
    growth: Array
    omega: Array
    band: tuple[float, float]

    def __repr__(self) -> str:
        return (f"StabilitySweep: {len(self.slopes)} slopes from {self.slopes.min():.4g} to {self.slopes.max():.4g}, "
                f"max Re λ from {self.growth.min():.4g} to {self.growth.max():.4g}, {np.sum(self.growth > 0)} unstable")


@dataclass(frozen=True, eq=False, repr=False)
class CriticalSlope:
    """The largest c ≤ 0 at which a pair in the band reaches the imaginary axis and grows just below.

    Attributes
    ----------
    slope : float
        c / force; 0.0 for an undamped mode that feels the belt (or one whose damping ratio is rounding: a slope that
        turned no more than 1e-13 of it), -inf where stability is never lost.
    omega : float
        Frequency of the (lowest) pair on the axis, NaN for -inf. 0.0 where it is no pair, but a real λ that passes 0: a
        rigid-body motion that has lost its damping and begins to drift. What oscillates is then found with a band from above 0.
    shape : ndarray of complex, shape (n,) or (r,)
        Its eigenvector, in the coordinates of the model.
    crossing : ndarray
        The frequencies of all pairs that cross together at this slope.
    band : (lo, hi)
        The frequencies looked at: of a reduced model no more than what lies below its cut-off.
    growth : (float, float)
        Re λ of the pair at 0.999 c and at 1.001 c, computed from the pencil: the verification.
    method : str
        'scalar function' or 'bracketing'.
    """

    slope: float
    omega: float
    shape: Array
    crossing: Array
    band: tuple[float, float]
    growth: tuple[float, float] = (np.nan, np.nan)
    method: str = "scalar function"

    def __float__(self) -> float:
        return self.slope

    def __repr__(self) -> str:
        where = f"band {self.band[0]:.5g} to {self.band[1]:.5g} rad/time"
        if np.isinf(self.slope):
            return f"CriticalSlope: none, stability is never lost in the {where}"
        more = f", {len(self.crossing)} pairs cross together" if len(self.crossing) > 1 else ""
        if self.omega == 0:
            more = f" (rigid motion drifts: a real λ passes 0{', and ' * (len(self.crossing) > 1)}" + \
                   (f"{len(self.crossing) - 1} pairs cross with it" if len(self.crossing) > 1 else "") + ")"
        return f"CriticalSlope: {self.slope:.9g} at ω = {self.omega:.6g} rad/time{more} ({where}, by {self.method})"


def sweep(model: Substructure, slopes: Sequence[float] | Array, port: str = "belt", *, force: float = 1.0,
          band: tuple[float, float] | None = None) -> StabilitySweep:
    """max Re λ of λ²M + λ(D + F s w wᵀ) + K over slopes s.

    A small model is brought to its undamped modes once, and each slope costs one small eigenproblem. A sparse one above
    2,000 DOF, which needs a band, takes a PEP for each; so does a dense one above 300 DOF if a band is given.
    One with massless motions takes all of its complex modes for each slope.

    Raises
    ------
    InputError
        An unknown port, slopes that are not finite, a missing band, or one that reaches above the model's cut-off.

    Warns
    -----
    FemsubWarning
        A sparse model above 2,000 DOF may have Re λ above the end of the band, which is not looked for.
    """
    instance("model", model, Substructure, "with a port")
    positive_number("force", force)
    values = np.atleast_1d(real_array("slopes", slopes))
    if values.ndim != 1 or values.size == 0:
        raise InputError("slopes must be a flat, non-empty sequence of finite numbers")
    w = model.port(port).reshape(model.size, -1)
    limits = usable_band(model, band)
    growth, omega = np.empty(len(values)), np.empty(len(values))
    if model.pencil.is_sparse and model.size > QUADRATIC and band is None:
        raise InputError(f"a sparse model of {model.size} DOF needs band=(lo, hi) in rad per unit of time")
    few = model.size <= (QUADRATIC if model.pencil.is_sparse else np.inf if band is None else WIDE)
    fast = np.zeros(len(values), dtype=bool) if few else _fast(model, w, force * values, limits[1])
    whole = np.full(len(values), few) if few or model.pencil.is_sparse else fast.copy()
    with one_thread(model.size <= FEW):
        form = modal_form(model.pencil.dense()) if whole.any() else None
        if form is None:  # massless motions
            whole[:] = False
        else:
            amplitude = form.shapes.T @ w
            for i in np.flatnonzero(whole):
                spectrum = eigenvalues(form, form.C + force * values[i] * (amplitude @ amplitude.T))
                growth[i], omega[i] = _leading(spectrum[form.rigid:], limits)
    untold = fast & model.pencil.is_sparse
    for i in np.flatnonzero(~whole):
        searched = None if few or (fast[i] and not untold[i]) else limits
        modes = complex_modes(model, Belt(port, force=force, slope=float(values[i])), band=searched, certify=False)
        growth[i], omega[i] = _leading(modes.eigenvalues[~modes.rigid], limits)
    if untold.any():
        warnings.warn(f"from the slope {values[untold].max():.4g} on Re λ may be above {limits[1]:.4g}, where the band ends: "
                      "of a large sparse model only what has |Re λ| up to there is looked for, so that max Re λ may be larger",
                      FemsubWarning, stacklevel=2)
    return StabilitySweep(values, growth, omega, limits)


def _fast(model: Substructure, W: Array, c: Array, hi: float) -> Array:
    """At which c (k,) D + cWWᵀ may make something grow with Re λ > hi while |Im λ| ≤ hi, bool (k,); at the others nothing does.

    With m, d, k = xᴴMx, xᴴDx, xᴴKx of a shape that grows, (m + Re d / Re λ) |λ|² + k = 0. Hence for a ≤ Re λ ≤ b, hi ≤ a, the
    matrix aM + D + cWWᵀ + K / 2b is not definite. One interval tells most slopes, several the rest.
    """
    fast = np.ones(len(c), dtype=bool)
    for edges in (hi * np.array([1.0, FAR]), hi * np.append(4.0 ** np.arange(5), FAR)):
        if fast.any():
            fast = c <= max(_indefinite(model, W, a, b) for a, b in pairwise(edges))
    return fast


def _indefinite(model: Substructure, W: Array, a: float, b: float) -> float:
    """The c ≤ 0 up to which aM + D + cWWᵀ + K / 2b is not definite, -inf if it always is."""
    try:
        factor = factorise(a * model.M + (model.D + model.D.T) / 2 + model.K / (2 * b), "definite")
    except SingularMatrixError:
        return np.inf
    compliance = float(np.linalg.eigvalsh(W.T @ factor.solve(W))[-1])
    factor.close()
    return -1 / compliance if compliance > 0 else -np.inf


def _leading(values: Array, band: tuple[float, float]) -> tuple[float, float]:
    values = values[in_band(values, band) & (np.abs(values) > 0)]
    if len(values) == 0:
        return -np.inf, np.nan
    at = int(np.argmax(values.real))
    return float(values[at].real), abs(float(values[at].imag))


def critical_slope(model: Substructure, port: str = "belt", *, force: float = 1.0,
                   band: tuple[float, float] | None = None, method: str = "auto") -> CriticalSlope:
    """1 + c·iω·wᵀ(-ω²M + iωD + K)⁻¹w = 0: the slope c/F at which sliding on a port loses its stability.

    Parameters
    ----------
    model : Substructure
        Full or reduced.
    port : str
        Where the belt is. With several columns the contact is D + c W Wᵀ, and the border is bracketed on the
        complex modes instead of found as a root.
    force : float
        Normal force F; the slope returned is c/F.
    band : (lo, hi), optional
        Only pairs with lo ≤ Im λ ≤ hi may cross. By default all of a dense (or small sparse) model, and of a reduced
        one those below its cut-off: what lies above are shapes of the reduction, which may be hardly damped, and a band
        that reaches there is refused. Required for a sparse model above 2,000 DOF. With lo = 0 rigid motion that loses its
        damping counts, too (ω = 0).
    method : {'auto', 'scalar', 'bracketing'}

    Raises
    ------
    UnstableModelError
        The model is unstable at c = 0; the λ is shown.
    InputError
        An unknown port or method, a force that is not positive, a missing band, or one that reaches above the cut-off.
    NotConvergedError
        A crossing found as a root could not be verified on the pencil, or rounding may move it by more than 1e-3; or a pair
        that lost its stability outside of the band has moved into it before.

    Warns
    -----
    CutoffWarning
        The border of a reduced model lies above 0.7 of its cut-off, where its modes may be far off; or none was found in a
        band that reaches above that.
    """
    instance("model", model, Substructure, "with a port")
    positive_number("force", force)
    choice("method", method, ("auto", "scalar", "bracketing"))
    w = model.port(port).reshape(model.size, -1)
    if method == "scalar" and w.shape[1] > 1:
        raise InputError(f"port {port!r} has {w.shape[1]} columns; the scalar function is for one, use method='bracketing'")
    sparse = model.size > (SMALL if model.pencil.is_sparse else WIDE)
    if model.pencil.is_sparse and band is None and model.size > QUADRATIC:
        raise InputError(f"a sparse model of {model.size} DOF needs band=(lo, hi) in rad per unit of time: which "
                         "frequencies may lose their stability?")
    limits = usable_band(model, band)
    if sparse and band is not None:
        found = sparse_border(model.pencil.sparse(), w, limits, method)
    else:
        found = dense_border(model.pencil, w, limits, method)
    sure = SHARE * model.cutoff
    if found.omega > sure or (np.isinf(found.c) and limits[1] > sure):
        what = f"the border at ω = {found.omega:.5g} lies" if np.isfinite(found.c) else \
            f"no border was found, but the band, which ends at {limits[1]:.5g}, reaches"
        warnings.warn(f"{what} above {SHARE:g} of the cut-off of {model.name!r} ({model.cutoff:.5g} rad/time), where modes of a "
                      "reduced model may be far from the component's: keep more modes to be sure", CutoffWarning, stacklevel=2)
    result = CriticalSlope(found.c / force, found.omega, found.shape, found.crossing, limits, found.growth, found.method)
    log.info("%r", result)
    return result
