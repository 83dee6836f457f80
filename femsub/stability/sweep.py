"""Growth rates over the values of a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from femsub.algebra import QUADRATIC, check_workers, factorise, side_by_side
from femsub.checks import EPS, Array, FemsubWarning, InputError, SingularMatrixError, real_array, until, warn
from femsub.model import Affine, Contacts, Pencil, Substructure, in_band
from femsub.modes import complex_modes, eigenvalues, modal_form
from femsub.output import Chart, Displayed, Table, column
from femsub.stability.charts import growth_over_chart
from femsub.stability.critical_value import question_of
from femsub.stability.port_root import is_narrow, port_fed

FAR = EPS**-0.5  # times the end of a band: an upper bound of Re λ


@dataclass(frozen=True, eq=False, repr=False)
class StabilitySweep(Displayed):
    """The largest growth rate Re λ for each of m values of a parameter, made by `sweep`.

    Attributes
    ----------
    parameter : str
    values : ndarray, shape (m,)
    growth : ndarray, shape (m,)
        max Re λ over the band, without rigid-body modes, 1 per unit of time.
    omega : ndarray, shape (m,)
        Im λ of that mode.
    band : (lo, hi)
        The band searched; for a reduced model it ends at the cut-off.
    cutoff : float
        The cut-off of a reduced model if no band was given. Otherwise inf.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", [-0.2, -0.01]).growth > 0
    array([ True, False])
    """

    parameter: str
    values: Array
    growth: Array
    omega: Array
    band: tuple[float, float]
    cutoff: float = np.inf

    def tables(self) -> list[Table]:
        """A row for each value."""
        rows = [{self.parameter: float(value), "growth": float(growth), "omega": float(omega)}
                for value, growth, omega in zip(self.values, self.growth, self.omega, strict=True)]
        return [Table("sweep", rows, [column(self.parameter, form=".6g"), "growth", "omega"], f"Growth over {self.parameter}")]

    def chart(self, title: str = "The largest growth") -> Chart:
        """The largest Re λ over the parameter, and Im λ of that mode."""
        return growth_over_chart(self, title)

    def __repr__(self) -> str:
        return (f"StabilitySweep: {len(self.values)} values of {self.parameter} from {self.values.min():.4g} to "
                f"{self.values.max():.4g}, max Re λ from {self.growth.min():.4g} to {self.growth.max():.4g}, "
                f"{np.sum(self.growth > 0)} unstable{until(self.cutoff)}")


def sweep(model: Substructure | Affine, contacts: Contacts, parameter: str, values: Sequence[float] | Array, *,
          band: tuple[float, float] | None = None, workers: int | None = None,
          executor: Executor | None = None) -> StabilitySweep:
    """The largest growth rate for each of several values of a parameter: max Re λ of λ²M + λD + K.

    If the parameter only feeds a port through D, as a belt's slope does, a small model is transformed to its undamped modes once;
    then each value needs one small eigenproblem. A sparse model above 2,000 DOF needs a band, and PEP solves it for each value.
    The same holds for a dense model above 300 DOF if a narrow band is given, and if the parameter does not only feed a port.

    Parameters
    ----------
    model, contacts, parameter
        As for `critical_value`.
    values : sequence of float
        Values of the parameter.
    band : (lo, hi), optional
        Only modes with lo ≤ Im λ ≤ hi, in radians per unit of time. Default: all, for a reduced model up to its cut-off.
    workers : int, optional
        Number of processes that share the values; see `reduce`. Useful if a value takes seconds: a process takes 1 s to start.
    executor : concurrent.futures.Executor, optional
        Takes the values one by one instead.

    Returns
    -------
    StabilitySweep

    Raises
    ------
    InputError
        An unknown parameter, values that are not finite, a missing band, or one that reaches above the model's cut-off.
    WorkerError
        A worker process died. ``.done`` holds the sweeps over the other values.

    Warns
    -----
    FemsubWarning
        A sparse model above 2,000 DOF may have eigenvalues with Re λ above the end of the band. These are not computed.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", [-0.2, -0.1, -0.01])
    >>> print(f"{found.growth[0]:.4f}")
    0.0146
    """
    p = np.atleast_1d(real_array("values", values))
    if p.ndim != 1 or p.size == 0:
        raise InputError("values must be a flat, non-empty sequence of finite numbers")
    sign = -1.0 if p.sum() < 0 else 1.0  # a contact may refuse values of the other sign
    question = question_of(model, contacts, parameter, (0.0, sign * np.inf), band)
    limits, pencil = question.band, question.over.at(p[0])
    growth, omega = np.empty(len(p)), np.empty(len(p))
    if pencil.is_sparse and pencil.size > QUADRATIC and band is None:
        raise InputError(f"a sparse model of {pencil.size} DOF needs a band: give band=(lo, hi) in rad per unit of time")
    check_workers(workers, executor)
    count = len(p) if executor is not None else min(workers or 1, len(p))
    if count > 1:
        groups = {f"{first + 1} of {count}": (p[first::count],) for first in range(count)}
        found = side_by_side(partial(sweep, model, contacts, parameter, band=band), groups, workers, executor,
                             what=f"group of values of {parameter}")
        for first, part in enumerate(found[name] for name in groups):
            growth[first::count], omega[first::count] = part.growth, part.omega
        return StabilitySweep(parameter, p, growth, omega, limits, question.cutoff)
    few = pencil.size <= QUADRATIC if pencil.is_sparse else band is None or not is_narrow(pencil, limits[1])
    whole, fast = np.zeros(len(p), dtype=bool), np.zeros(len(p), dtype=bool)
    if (fed := port_fed(question)) is not None:
        c, pencil = fed.s * sign * p, fed.pencil
        fast = fast if few else _fast(pencil, fed.W, c, limits[1])
        whole = few | (fast & (not pencil.is_sparse))
        form = modal_form(pencil.dense()) if whole.any() else None
        whole &= form is not None  # a model with massless motions has no modal form
        if form is not None:
            amplitude = form.shapes.T @ fed.W
            for i in np.flatnonzero(whole):
                spectrum = eigenvalues(form, form.C + c[i] * (amplitude @ amplitude.T))
                growth[i], omega[i] = _leading(spectrum[form.rigid:], limits)
    untold = fast & pencil.is_sparse
    for i in np.flatnonzero(~whole):
        searched = None if few or (fast[i] and not untold[i]) else limits
        modes = complex_modes(question.over.at(p[i]), band=searched, evidence=False)
        growth[i], omega[i] = _leading(modes.eigenvalues[~modes.rigid], limits)
    if untold.any():
        warn(f"at {parameter} of {p[untold].max():.4g} and below, max Re λ may be larger than reported. In a large "
             f"sparse model only eigenvalues with |Re λ| up to the end of the band ({limits[1]:.4g}) are computed",
             FemsubWarning)
    return StabilitySweep(parameter, p, growth, omega, limits, question.cutoff)


def _fast(pencil: Pencil, W: Array, c: Array, hi: float) -> Array:
    """Whether there may be an eigenvalue with Re λ > hi and |Im λ| ≤ hi at each c (k,), bool (k,). False is certain.

    With m, d, k = xᴴMx, xᴴDx, xᴴKx of a growing shape, (m + Re d / Re λ) |λ|² + k = 0. Hence for a ≤ Re λ ≤ b, hi ≤ a, the
    matrix aM + D + cWWᵀ + K / 2b is not definite. One interval decides most slopes, several decide the rest.
    """
    fast = np.ones(len(c), dtype=bool)
    for edges in (hi * np.array([1.0, FAR]), hi * np.append(4.0 ** np.arange(5), FAR)):
        if not fast.any():
            break
        limits = []  # the largest c ≤ 0 at which each matrix is not definite; -inf if it always is
        for a, b in pairwise(edges):
            try:
                factor = factorise(a * pencil.M + (pencil.D + pencil.D.T) / 2 + pencil.K / (2 * b), "definite")
            except SingularMatrixError:
                limits.append(np.inf)
                continue
            compliance = float(np.linalg.eigvalsh(W.T @ factor.solve(W))[-1])
            factor.close()
            limits.append(-1 / compliance if compliance > 0 else -np.inf)
        fast = c <= max(limits)
    return fast


def _leading(values: Array, band: tuple[float, float]) -> tuple[float, float]:
    values = values[in_band(values, band) & (np.abs(values) > 0)]
    if len(values) == 0:
        return -np.inf, np.nan
    at = int(np.argmax(values.real))
    return float(values[at].real), abs(float(values[at].imag))
