"""Loss of stability by friction: growth rates over the slope of the friction law, and the critical slope."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import QUADRATIC, WIDE, check_workers, factorise, negative_eigenvalues, side_by_side
from femsub.checks import Array, choice, instance, positive_number, real_array
from femsub.coupling import Belt
from femsub.errors import CutoffWarning, FemsubWarning, InputError, SingularMatrixError, warn
from femsub.model import SHARE, Substructure, in_band, usable_band
from femsub.modes import Budget, eigenvalues, modal_form
from femsub.modes.quadratic.complex_modes import complex_modes
from femsub.stability.border import dense_border, sparse_border
from femsub.stability.border_doubt import doubt

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from femsub.model import Contacts
    from femsub.stability.contact_model import Border

log = logging.getLogger(__name__)

NEAR = 1.5  # times the end of the band: modes up to there act on its border
SMALL = 150  # DOF up to which a sparse model is treated as dense
FAR = 1e8  # times the end of a band: an upper bound of Re λ


@dataclass(frozen=True, eq=False, repr=False)
class StabilitySweep:
    """The largest growth rate Re λ for each of m friction slopes, made by `sweep`.

    Attributes
    ----------
    slopes : ndarray, shape (m,)
        μ'(v0); D gets force · slope · w wᵀ.
    growth : ndarray, shape (m,)
        max Re λ over the band, without rigid-body modes, 1 per unit of time.
    omega : ndarray, shape (m,)
        Im λ of that mode.
    band : (lo, hi)
        The band searched; for a reduced model it ends at the cut-off.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.sweep(fs.chain(10, belt=2), [-0.2, -0.01]).growth > 0
    array([ True, False])
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
    """The friction slope at which sliding loses its stability, made by `critical_slope`; ``float(...)`` gives the slope.

    It is c / F for the largest c ≤ 0 at which a pair in the band reaches the imaginary axis and grows just below.

    Attributes
    ----------
    slope : float
        c / F. 0.0 if a mode under the belt has no damping beyond rounding (damping ratio below 1e-13). -inf if stability is
        never lost.
    omega : float
        Frequency of the (lowest) pair on the axis; NaN for -inf. 0.0 if no pair but a real λ passes 0: a rigid-body motion
        has lost its damping and begins to drift. To find oscillations then, use a band that starts above 0.
    shape : ndarray of complex, shape (n,) or (r,)
        Its eigenvector, in the model's coordinates.
    crossing : ndarray
        The frequencies of all pairs that cross together at this slope.
    band : (lo, hi)
        The band searched; for a reduced model it ends at the cut-off.
    growth : (float, float)
        Re λ of the pair at 0.999 c and at 1.001 c, computed from the pencil as a verification.
    method : str
        'scalar function' or 'bracketing'.

    Examples
    --------
    >>> import femsub as fs
    >>> critical = fs.critical_slope(fs.chain(10, belt=2))
    >>> print(f"{critical.slope:.6f} {critical.omega:.5f} {len(critical.crossing)}")
    -0.025567 0.14946 1
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
          band: tuple[float, float] | None = None, workers: int | None = None,
          executor: Executor | None = None) -> StabilitySweep:
    """The largest growth rate for each of several friction slopes s: max Re λ of λ²M + λ(D + F s w wᵀ) + K.

    A small model is transformed to its undamped modes once; then each slope needs one small eigenproblem. A sparse model
    above 2,000 DOF needs a band, and PEP solves it for each slope. The same holds for a dense model above 300 DOF if a narrow
    band is given. For a model with massless motions all complex modes are computed for each slope.

    Parameters
    ----------
    model : Substructure
        Full or reduced.
    slopes : sequence of float
        Values of s = μ'(v0).
    port : str
        The port under the belt.
    force : float
        Normal force F.
    band : (lo, hi), optional
        Only modes with lo ≤ Im λ ≤ hi, in radians per unit of time. Default: all, for a reduced model up to its cut-off.
    workers : int, optional
        So many processes share the slopes; see `reduce`. It pays where a slope takes seconds: a process takes one to start.
    executor : concurrent.futures.Executor, optional
        Takes the slopes one by one instead.

    Returns
    -------
    StabilitySweep

    Raises
    ------
    InputError
        An unknown port, slopes that are not finite, a missing band, or one that reaches above the model's cut-off.
    WorkerError
        A worker process died. ``.done`` holds the sweeps over the other slopes.

    Warns
    -----
    FemsubWarning
        A sparse model above 2,000 DOF may have eigenvalues with Re λ above the end of the band. These are not computed.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.sweep(fs.chain(10, belt=2), [-0.2, -0.1, -0.01])
    >>> print(f"{found.growth[0]:.4f}")
    0.0146
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
        raise InputError(f"a sparse model of {model.size} DOF needs a band: give band=(lo, hi) in rad per unit of time")
    check_workers(workers, executor)
    count = len(values) if executor is not None else min(workers or 1, len(values))
    if count > 1:
        groups = {f"{first + 1} of {count}": (values[first::count],) for first in range(count)}
        found = side_by_side(partial(sweep, model, port=port, force=force, band=band), groups, workers, executor,
                             what="group of slopes")
        for first, part in enumerate(found[name] for name in groups):
            growth[first::count], omega[first::count] = part.growth, part.omega
        return StabilitySweep(values, growth, omega, limits)
    few = model.size <= QUADRATIC if model.pencil.is_sparse else band is None or not _is_narrow(model, limits[1])
    fast = np.zeros(len(values), dtype=bool) if few else _fast(model, w, force * values, limits[1])
    whole = np.full(len(values), few) if few or model.pencil.is_sparse else fast.copy()
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
        modes = complex_modes(model, Belt(port, force=force, slope=float(values[i])), band=searched, evidence=False)
        growth[i], omega[i] = _leading(modes.eigenvalues[~modes.rigid], limits)
    if untold.any():
        warn(f"at slopes of {values[untold].max():.4g} and below, max Re λ may be larger than reported. In a large "
             f"sparse model only eigenvalues with |Re λ| up to the end of the band ({limits[1]:.4g}) are computed",
             FemsubWarning)
    return StabilitySweep(values, growth, omega, limits)


def _is_narrow(model: Substructure, top: float) -> bool:
    """Whether PEP is predicted to find the modes of a dense model up to a frequency far sooner than LAPACK finds all."""
    if model.size <= WIDE or not np.isfinite(top):
        return False
    if not model.M.diagonal().all():
        return True  # only a basis of modes can do without massless motions
    below = negative_eigenvalues(model.K - (NEAR * top) ** 2 * model.M)
    return Budget(model.size, True).covers(2 * below)


def _fast(model: Substructure, W: Array, c: Array, hi: float) -> Array:
    """At which c (k,) there may be an eigenvalue with Re λ > hi and |Im λ| ≤ hi, bool (k,); at the others there is none.

    With m, d, k = xᴴMx, xᴴDx, xᴴKx of a growing shape, (m + Re d / Re λ) |λ|² + k = 0. Hence for a ≤ Re λ ≤ b, hi ≤ a, the
    matrix aM + D + cWWᵀ + K / 2b is not definite. One interval decides most slopes, several decide the rest.
    """
    fast = np.ones(len(c), dtype=bool)
    for edges in (hi * np.array([1.0, FAR]), hi * np.append(4.0 ** np.arange(5), FAR)):
        if fast.any():
            fast = c <= max(_indefinite(model, W, a, b) for a, b in pairwise(edges))
    return fast


def _indefinite(model: Substructure, W: Array, a: float, b: float) -> float:
    """The largest c ≤ 0 at which aM + D + cWWᵀ + K / 2b is not definite; -inf if it always is."""
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
                   contacts: Contacts = None, band: tuple[float, float] | None = None,
                   method: str = "auto") -> CriticalSlope:
    """The friction slope c/F at which steady sliding on a port loses its stability.

    On the border a pair λ = iω fulfils 1 + c·iω·wᵀ(-ω²M + iωD + K)⁻¹w = 0. Every root found is verified on the pencil.

    Parameters
    ----------
    model : Substructure
        Full or reduced.
    port : str
        The port under the belt. With several columns the contact is D + c W Wᵀ, and the border is bracketed on the
        complex modes instead of found as a root.
    force : float
        Normal force F; the slope returned is c/F.
    contacts : Belt, LinearContact or another contact, or a sequence of them, optional
        Contacts that act as well, with terms in D only. For terms in K see `critical_value`.
    band : (lo, hi), optional
        Only pairs with lo ≤ Im λ ≤ hi count. Default: all pairs of a dense (or small sparse) model; for a reduced model those
        below its cut-off. A band above the cut-off is refused, since modes there are artefacts of the reduction, often hardly
        damped. Required for a sparse model above 2,000 DOF. With lo = 0 rigid motion that loses its damping counts, too
        (ω = 0).
    method : {'auto', 'scalar', 'bracketing'}
        How the border is found: as a root of the scalar function above, or by bracketing on the complex modes.

    Returns
    -------
    CriticalSlope

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
    >>> print(f"{fs.critical_slope(fs.chain(10, belt=2)).slope:.6f}")
    -0.025567
    """
    instance("model", model, Substructure, "with a port")
    positive_number("force", force)
    choice("method", method, ("auto", "scalar", "bracketing"))
    bare, model = model, _under(model, contacts)
    w = model.port(port).reshape(model.size, -1)
    if method == "scalar" and w.shape[1] > 1:
        raise InputError(f"port {port!r} has {w.shape[1]} columns, but the scalar function takes one. Use method='bracketing'")
    if model.pencil.is_sparse and band is None and model.size > QUADRATIC:
        raise InputError(f"a sparse model of {model.size} DOF needs a band: give band=(lo, hi) in rad per unit of time, the "
                         "frequencies that may lose their stability")
    limits = usable_band(model, band)
    found = _border(model, port, limits, method, band is not None)
    sure = SHARE * model.cutoff
    if found.omega > sure or (np.isinf(found.c) and limits[1] > sure):
        what = f"the border at ω = {found.omega:.5g} lies" if np.isfinite(found.c) else \
            f"no border was found, but the band, which ends at {limits[1]:.5g}, reaches"
        warn(f"{what} above {SHARE:g} of the cut-off of {model.name!r} ({model.cutoff:.5g} rad/time), where modes of a "
             "reduced model may be inaccurate. Keep more modes", CutoffWarning)
    elif told := doubt(model, bare, port, limits, found, lambda wide: _border(
            _under(wide, contacts), port, limits, method, band is not None)):
        warn(told, CutoffWarning)
    result = CriticalSlope(found.c / force, found.omega, found.shape, found.crossing, limits, found.growth, found.method)
    log.info("%r", result)
    return result


def _under(model: Substructure, contacts: Contacts) -> Substructure:
    """The model with what the contacts add to D."""
    if contacts is None:
        return model
    pencil = model.linearised(contacts)
    if pencil.K is not model.pencil.K:
        raise InputError("the critical slope takes contacts that add to D only. See critical_value, which takes any")
    return model.with_damping(pencil.D)


def _border(model: Substructure, port: str, band: tuple[float, float], method: str, limited: bool) -> Border:
    w = model.port(port).reshape(model.size, -1)
    if limited and (model.size > SMALL if model.pencil.is_sparse else _is_narrow(model, band[1])):
        return sparse_border(model.pencil.sparse(), w, band, method)
    return dense_border(model.pencil, w, band, method)
