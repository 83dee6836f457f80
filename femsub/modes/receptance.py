"""`frequency_response`: the response of a model to harmonic forces, h(iω) = Cᵀ(-ω²M + iωD + K + iH)⁻¹F, directly or by modes.

The modal method is the projection of `energy_basis` on V = [Φ Ψ]. Φ are all modes below a limit Ω, counted by inertia. Ψ are the
static responses outside the modes: to the loads F, to unit forces C at the responses, to forces on the ports of contacts, and to
forces on all rows and columns of D if D acts on few DOF. A = K' = K + MΦ(Ω² - Λ)ΦᵀM lifts the modes to Ω, so that K' ≥ Ω²M, even
with soft mounts. P_U = VᵀP(iω)V, P_UL and P_LU are as in `energy_basis`. F_L and C_L are the parts of F and C outside V, in the
norm of A⁻¹. The modal response h' = CᵀV P_U⁻¹ VᵀF has the error

    |h - h'| ≤ ‖C_L - P_ULᵀ P_U⁻ᵀ VᵀC‖ ‖F_L - P_LU P_U⁻¹ VᵀF‖ / (c - ‖P_LU P_U⁻¹ P_UL‖).

Loads whose static response is in Ψ add nothing to F_L, C_L, P_LU and P_UL, whether forces act in the direction of motion or not.
The remainders by errors of solutions, dependent columns and rounding are computed. With ω < Ω, c = 1 - ω²/Ω², minus the remainder
of contacts. If P_LU is large, static responses to it join Ψ. The bound includes the residual of the small equations, and rounding
in the entries of the matrices.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import BLOCK, SMALL, WIDE, Frozen, halves, shared_factor
from femsub.checks import (
    EPS,
    Array,
    FemsubError,
    InputError,
    InputTypeError,
    Matrix,
    SingularMatrixError,
    Tally,
    choice,
    instance,
    items,
    naming,
    positive_number,
    real_array,
    rows,
    shown,
    unknown_name,
    whole_number,
)
from femsub.model import Contacts, Pencil, ReducedSubstructure, Substructure, beyond, contacts_of, small_matrices
from femsub.modes.charts import receptances_chart
from femsub.modes.noise import Noise
from femsub.modes.normal_modes import modes_below, modes_under
from femsub.modes.quadratic.correction import inverse_at
from femsub.modes.quadratic.energy_basis import EnergyBasis, Term
from femsub.modes.shift_invert import ShiftInvert
from femsub.output import Chart, Displayed, Table

log = logging.getLogger(__name__)

TOL = 1e-5  # tolerance of responses; also the root of the share of a motion's energy that a basis may leave out


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Frozen, Displayed):
    """Receptances from loads to responses over frequency, with bounds of their errors, made by `frequency_response`.

    u_i(t) = Re(h_ij(ω) f_j exp(iωt)), h of shape (nf, nr, nl).

    Attributes
    ----------
    omega : ndarray, shape (nf,)
        Radians per unit of time.
    receptance : ndarray, shape (nf, nr, nl)
        h, complex: displacement over force.
    bound : ndarray, shape (nf, nr, nl)
        Bound of the error of each entry of `receptance` as a solution of the model: from rounding and the residual at frequencies
        that were solved directly, else from the truncation of the modes. inf where no bound is known.
    residual : ndarray, shape (nf,)
        The largest over the loads: for a direct solution the backward error ‖F - Px‖ / ((ω²‖M‖ + ω‖D‖ + ‖K‖) ‖x‖), for a modal
        solution ‖F - Px‖ / ‖x‖ in the norms of energy.
    responses, loads : tuple of str
        Names of the rows and columns.
    direct : ndarray of bool, shape (nf,)
        Whether the equations of the model were solved directly at each frequency, without modes.
    modes : int
        The number of modes used.
    tally : Tally
        The number of frequencies, and of frequencies at which the bound is within the tolerance.
    cutoff : float
        Cut-off of the model, or the lowest of several models (inf for a full model). The bound is the error relative to this
        model; above the cut-off it says little about the full model.
    noise : tuple of Noise
        The noise of the measurements from which the receptance follows, see `scatter`, `ellipses` and `covariance`.

    Examples
    --------
    >>> import numpy as np
    >>> import femsub as fs
    >>> found = fs.frequency_response(fs.chain(10, belt=2), at=[0.1, 0.5, 1.0])
    >>> found
    FrequencyResponse: 1 response to 1 load at 3 frequencies, ω 0.1 to 1 rad/time, 3 solved directly, certified
    >>> found.mobility.shape, np.allclose(abs(found.mobility), found.omega[:, None, None] * abs(found.receptance))
    ((3, 1, 1), True)
    """

    omega: Array
    receptance: Array
    bound: Array
    residual: Array
    responses: tuple[str, ...]
    loads: tuple[str, ...]
    direct: Array
    modes: int = 0
    tally: Tally = field(default=Tally(0))
    noise: tuple[Noise, ...] = ()
    cutoff: float = np.inf

    def tables(self) -> list[Table]:
        """A table with a row for each frequency, load and response."""
        rows = [{"load": load, "response": response, "omega": float(omega),
                 "magnitude": float(abs(h)), "phase": float(np.degrees(np.angle(h))), "bound": float(bound)}
                for j, load in enumerate(self.loads) for i, response in enumerate(self.responses)
                for omega, h, bound in zip(self.omega, self.receptance[:, i, j], self.bound[:, i, j], strict=True)]
        return [Table("response", rows, title="Receptances")] if rows else []

    def curves(self, full: FrequencyResponse | None = None) -> list[dict[str, Any]]:
        """For each response to each load: frequencies, size and phase in degrees; with `full` also `error` over the full size."""
        bound = None if full is None else self.error(full)
        found = []
        for j, i in product(range(len(self.loads)), range(len(self.responses))):
            h = self.receptance[:, i, j]
            found.append({"omega": self.omega, "magnitude": np.abs(h), "phase": np.degrees(np.angle(h))})
            if full is not None and bound is not None:
                found[-1]["error"] = bound[:, i, j] / np.abs(full.receptance[:, i, j])
        return found

    def errors(self, full: FrequencyResponse) -> list[dict[str, Any]]:
        """For each response to each load: the largest error bound over the largest size, its ω, and the largest local ratio."""
        rows, bound = [], self.error(full)
        for j, i in product(range(len(self.loads)), range(len(self.responses))):
            size, error = np.abs(full.receptance[:, i, j]), bound[:, i, j]
            rows.append({"error": float(error.max() / size.max()), "omega": float(self.omega[int(error.argmax())]),
                         "error_local": float((error / size).max()), "evidence": self.evidence})
        return rows

    def chart(self, title: str = "Receptance", most: int = 8, full: FrequencyResponse | None = None) -> Chart:
        """|h| and its phase over ω for at most `most` pairs; error bounds are dotted lines if they are large enough to be seen.

        With the response of the `full` model, its curves are grey behind, and a panel shows the bound of the error against it,
        over |h|.
        """
        return receptances_chart(self, title, most, full)

    @classmethod
    def measured(cls, at: Any, receptance: Any, responses: Sequence[str], loads: Sequence[str], *, level: float | None = None,
                 scatter: Any = None) -> FrequencyResponse:
        """The response of a part that is known by measured receptances.

        Parameters
        ----------
        at : array_like, shape (nf,)
            Radians per unit of time.
        receptance : array_like, shape (nf, nr, nl), or (ns, nf, nr, nl) of repeated measurements
            The mean of repeated measurements is taken. Its noise follows from them, with all correlation between the entries.
        responses, loads : sequence of str
            Names of the rows and columns.
        level : float, optional
            The stated noise: σ of each entry relative to its size. The entries are taken as independent.
        scatter : array_like, shape (nf, nr, nl), optional
            σ of each entry, instead of `level`.

        Raises
        ------
        InputError, InputTypeError
            Shapes do not fit, a name is given twice, or noise is stated in more than one way.
        """
        omega, h = np.atleast_1d(real_array("at", at)), rows("receptance", receptance)
        names = [tuple(items(what, given, "names")) for what, given in (("responses", responses), ("loads", loads))]
        shape = (len(omega), *map(len, names))
        if h.dtype.kind not in "iufc" or h.shape[-3:] != shape or h.ndim not in (3, 4) or not np.isfinite(h).all():
            raise InputError(f"receptance must be finite numbers of shape {shape}, by the lengths of at, responses and loads, or "
                             f"of repeated measurements (ns, {', '.join(map(str, shape))}), not {shown(h)}")
        for what, own in zip(("responses", "loads"), names, strict=True):
            if not all(isinstance(one, str) for one in own) or len(set(own)) < len(own):
                raise InputError(f"{what} must be names, each of them once, not {shown(own)}")
        if (h.ndim == 4) + (level is not None) + (scatter is not None) > 1:
            raise InputError("give one of level, scatter and repeated measurements: each states the noise")
        deviations = None
        if h.ndim == 4:
            if len(h) < 2:
                raise InputError("repeated measurements are at least two; one alone shows nothing of the noise")
            deviations, h = h - h.mean(axis=0), h.mean(axis=0)
        elif level is not None:
            scatter = positive_number("level", level) * np.abs(h)
        elif scatter is not None:
            scatter = real_array("scatter", scatter)
            if scatter.shape != shape or scatter.min(initial=0.0) < 0:
                raise InputError(f"scatter must be of shape {shape}, none of it negative, but its shape is {scatter.shape}")
        noisy = scatter is not None or deviations is not None
        return cls(np.array(omega), np.array(h, dtype=complex), np.zeros(shape), np.zeros(len(omega)), names[0], names[1],
                   np.zeros(len(omega), dtype=bool),
                   noise=(Noise.of(*shape[1:], scatter=scatter, deviations=deviations),) if noisy else ())

    @property
    def repeated(self) -> int:
        """The number of measurements from which the noise follows, the smallest of all parts; 0 if the noise is stated."""
        return min((one.repeated for one in self.noise if one.repeated), default=0)

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        """E|δ|² and E[δ²] of each entry."""
        found = [one.moments() for one in self.noise]
        return sum(part[0] for part in found), sum(part[1] for part in found)  # type: ignore[return-value]

    @property
    def scatter(self) -> Array | None:
        """The standard deviation σ of each entry by noise, σ² = E|δ|², (nf, nr, nl); None if no noise is known.

        `bound` does not include it. It is inf where the noise is too large for first order.
        """
        return np.sqrt(self._moments[0]) if self.noise else None

    def covariance(self, entries: Sequence[tuple[str, str]]) -> tuple[Array, Array]:
        """Γ = E[δ δᴴ] and C = E[δ δᵀ] of the noise δ of k entries, (nf, k, k) each: covariance and pseudo-covariance.

        The real parts x and imaginary parts y have E[x xᵀ] = Re(Γ + C)/2, E[y yᵀ] = Re(Γ - C)/2, E[y xᵀ] = Im(Γ + C)/2.
        NaN where the noise is too large for first order.

        Parameters
        ----------
        entries : sequence of (response, load)
            Names.

        Raises
        ------
        InputError, InputTypeError
            No noise is known; unknown names.

        Examples
        --------
        >>> import femsub as fs
        >>> drawn = 1.0 + 0.01 * np.random.default_rng(0).standard_normal((8, 1, 1, 2))  # real noise
        >>> found = fs.FrequencyResponse.measured([5.0], drawn, ["tip"], ["a", "b"])
        >>> gamma, turned = found.covariance([("tip", "a"), ("tip", "b")])
        >>> gamma.shape, bool(np.allclose(gamma, turned))
        ((1, 2, 2), True)
        """
        if not self.noise:
            raise InputError("no noise is known of this receptance. Give `level`, `scatter` or repeated measurements to "
                             "FrequencyResponse.measured")
        rows, columns_ = [], []
        for pair in items("entries", entries, "pairs (response, load)"):
            if not isinstance(pair, (tuple, list)) or len(pair) != 2:
                raise InputTypeError(f"each of entries must be a pair (response, load), not {shown(pair)}")
            rows.append(self._place("response", pair[0]))
            columns_.append(self._place("load", pair[1]))
        if not rows:
            raise InputError("entries is empty: name at least one pair (response, load)")
        found = [one.covariance(np.array(rows), np.array(columns_)) for one in self.noise]
        return sum(part[0] for part in found), sum(part[1] for part in found)  # type: ignore[return-value]

    def ellipses(self, share: float = 0.95) -> tuple[Array, Array]:
        """Ellipses around the entries that contain the true values with probability `share`: semi-axes, and angle of the longer
        one.

        The semi-axes are √(q (Γ ± |C|)/2) with Γ = E|δ|² and C = E[δ²]. The longer axis is turned by arg(C)/2 from the real axis.
        With p for `share`, q is -2 ln(1 - p) for stated noise. For n measurements it is (n - 1)((1 - p)^(-2/(n - 2)) - 1), which
        is 2 (n - 1)/(n - 2) times F with 2 and n - 2 degrees of freedom (Hotelling). The noise is taken as normal. Its real and
        imaginary parts may have any sizes and correlation. Two measurements are too few.

        Returns
        -------
        axes : ndarray, shape (nf, nr, nl, 2)
            The longer semi-axis first. inf if no noise is known, and where it is too large for first order.
        angle : ndarray, shape (nf, nr, nl)
            In radians, -π/2 to π/2.
        """
        _probability(share)
        shape, n = self.receptance.shape, self.repeated
        if not self.noise or n == 2:
            return np.full((*shape, 2), np.inf), np.zeros(shape)
        q = (n - 1) * ((1 - share) ** (-2 / (n - 2)) - 1) if n else -2 * np.log(1 - share)
        size, turned = self._moments
        both = np.stack([size + np.abs(turned), np.maximum(size - np.abs(turned), 0.0)], axis=-1)
        return np.sqrt(q * both / 2), np.angle(turned) / 2

    def radius(self, share: float = 0.95) -> Array:
        """The distance from the entries within which the true values lie with probability `share`, shape (nf, nr, nl).

        It is σ √(-ln(1 - p)), or σ √((n - 1)((1 - p)^(-1/(n - 1)) - 1)) if σ follows from n measurements (F distribution with 2
        and 2n - 2 degrees of freedom). The noise is taken as normal, with independent real and imaginary parts of equal size. It
        is inf if no noise is known. `ellipses` does not need this assumption about real and imaginary parts.
        """
        _probability(share)
        if (scatter := self.scatter) is None:
            return np.full(self.receptance.shape, np.inf)
        n = self.repeated - 1
        return scatter * np.sqrt(n * ((1 - share) ** (-1 / n) - 1) if self.repeated else -np.log(1 - share))

    @property
    def mobility(self) -> Array:
        """iω h: velocity over force, shape (nf, nr, nl)."""
        return 1j * self.omega[:, None, None] * self.receptance

    @property
    def accelerance(self) -> Array:
        """-ω² h: acceleration over force, shape (nf, nr, nl)."""
        return -self.omega[:, None, None] ** 2 * self.receptance

    @property
    def evidence(self) -> str:
        """'certified' if the bound is within the tolerance at every frequency; see `femsub.checks`."""
        return self.tally.evidence

    @property
    def above_cutoff(self) -> Array:
        """Whether each frequency lies above the cut-off of the model, bool, shape (nf,)."""
        return beyond(self.omega, self.cutoff)

    def entry(self, response: str, load: str) -> Array:
        """The receptance from a load to a response, by their names, shape (nf,)."""
        return self.receptance[:, self._place("response", response), self._place("load", load)]

    def _place(self, what: str, name: str) -> int:
        names = self.responses if what == "response" else self.loads
        if name not in names:
            raise unknown_name(what, name, names)
        return names.index(name)

    def error(self, full: FrequencyResponse) -> Array:
        """A bound of |h - h_full| for this (reduced) model against the full model, entry by entry, shape (nf, nr, nl).

        It is the difference of the two receptances plus their own bounds, at the same frequencies, loads and responses.
        """
        instance("full", full, FrequencyResponse, "made by frequency_response")
        for what in ("responses", "loads"):
            if getattr(self, what) != getattr(full, what):
                raise InputError(f"the {what} differ: {', '.join(getattr(self, what))} here, {', '.join(getattr(full, what))} in "
                                 "the full model. Ask both for the same")
        if not np.array_equal(self.omega, full.omega):
            raise InputError(f"the frequencies differ: {len(self.omega)} here, {len(full.omega)} in the full model. Give both "
                             "the same `at`")
        return np.abs(self.receptance - full.receptance) + self.bound + full.bound

    def __repr__(self) -> str:
        span = f", ω {self.omega.min():.5g} to {self.omega.max():.5g} rad/time" if len(self.omega) else ""
        span += f", {int(self.above_cutoff.sum())} of them above the cut-off {self.cutoff:.4g}" if self.above_cutoff.any() else ""
        how = f", {int(self.direct.sum())} solved directly" + (f", {self.modes} modes" if self.modes else "")
        return (f"FrequencyResponse: {_counted(len(self.responses), 'response')} to {_counted(len(self.loads), 'load')} at "
                f"{len(self.omega)} frequencies{span}{how}, {self.evidence}")


def _probability(share: float) -> None:
    if not 0 < share < 1:
        raise InputError(f"share must lie between 0 and 1, but is {shown(share)}")


def frequency_response(model: Substructure, contacts: Contacts = None, *, at: Any, loads: Any = None, responses: Any = None,
                       method: str = "auto", tol: float = TOL) -> FrequencyResponse:
    """The receptance of a full or reduced model or system, at rest or about steady sliding.

    h(ω) = Cᵀ(-ω²M + iωD + K + iH)⁻¹F, shape (nr, nl), with F (n, nl) the loads and C (n, nr) the responses. Contacts add to D and
    K as in `complex_modes`; H is the structural damping. Mobility and accelerance are iωh and -ω²h.

    Parameters
    ----------
    model : Substructure
    contacts : Belt or another contact, or a sequence of them, optional
    at : float or array_like, shape (nf,)
        Frequencies ω ≥ 0 in radians per unit of time. Frequencies above the cut-off of a reduced model are computed for
        comparison with the full model, and the result gives their number.
    loads, responses : optional
        Names of ports or interface sets, DOF counted from 0, a list of these, or columns, an array of floats (n,) or (n, k). In a
        reduced model a DOF is a DOF of the component, a row of V. By default the loads are all ports, and the responses are at
        the loads.
    method : {"auto", "direct", "modal"}
        'direct' factorises once for each frequency. 'modal' computes all modes up to twice the highest frequency, once, and
        static responses outside the modes. 'auto' is 'direct' for dense models, for fewer than 8 frequencies, and if the modal
        method has no bound. Else it is 'modal', and direct at those frequencies where the bound exceeds `tol`.
    tol : float
        The largest accepted error bound, relative to |h_ij|. At an antiresonance it is relative to a thousandth of the largest
        |h| for this load, or of the median of |h_ij| over the frequencies, if that is larger.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError, InputTypeError
        A negative frequency; an unknown port or DOF; no loads; 'modal' for a model without a bound: an unsymmetric D on many DOF,
        contacts of surfaces, more than 300 columns, K not positive semidefinite.
    SingularMatrixError
        An undamped resonance, or ω = 0 of a floating model.

    References
    ----------
    D. J. Ewins, Modal Testing (2000), ch. 2 (receptance, structural damping). R. R. Craig, A. J. Kurdila, Fundamentals of
    Structural Dynamics (2006), sec. 11.2 (static correction).

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.damped(fs.chain(400, belt=2, damping=0.0), structural=0.02)
    >>> omega = np.linspace(0.0, 0.05, 40)
    >>> found = fs.frequency_response(sub, at=omega)
    >>> found.modes, found.evidence
    (13, 'certified')
    >>> exact = fs.frequency_response(sub, at=omega, method="direct")
    >>> bool((abs(found.receptance - exact.receptance) <= found.bound + exact.bound).all())
    True
    >>> rom = fs.reduce(sub, fs.CraigBampton(modes=4), ports=True)
    >>> error = fs.frequency_response(rom, at=omega).error(found)
    >>> error.shape
    (40, 1, 1)
    """
    instance("model", model, Substructure)
    omega = np.array(np.atleast_1d(real_array("at", at)), dtype=float)
    if omega.ndim != 1 or not omega.size or omega.min() < 0:
        raise InputError("at must be frequencies in rad per unit of time, a number or a flat list, none of them negative")
    names, F = columns(model, loads, "loads")
    outputs, C = (names, F) if responses is None else columns(model, responses, "responses")
    choice("method", method, ("auto", "direct", "modal"))
    positive_number("tol", tol)
    pencil = model.linearised(contacts, structural=True)
    model.refuse_empty(pencil.D, pencil.K, model.H)
    basis: Modal | None = None
    # modes cost as much as 12 direct solutions of a chain, and less than one solution of a bulky solid
    if method == "modal" or (method == "auto" and pencil.is_sparse and pencil.size > SMALL and len(omega) >= 8):
        try:
            basis = Modal.of(model, contacts, F, C, float(omega.max()), WIDE if method == "auto" else model.size)
        except FemsubError as error:
            if method == "modal":
                raise
            log.info("%r by direct solutions, since %s", model, error)
    shape = (len(omega), C.shape[1], F.shape[1])
    h, bound, residual = np.zeros(shape, dtype=complex), np.full(shape, np.inf), np.full(len(omega), np.inf)
    direct = np.ones(len(omega), dtype=bool)
    if basis is not None:
        for k, value in enumerate(omega.tolist()):
            h[k], bound[k], residual[k] = basis.response(value)
        direct = loose(h, bound, tol) & (method == "auto")
    if direct.any():
        whole = Whole(pencil.dense() if pencil.size <= SMALL else pencil, model.H, F, C)
        for k in np.flatnonzero(direct):
            h[k], bound[k], residual[k] = whole.response(float(omega[k]))
    found = FrequencyResponse(omega, h, bound, residual, outputs, names, direct, 0 if basis is None else basis.modes,
                              within(h, bound, tol), cutoff=model.cutoff)
    log.info("%r", found)
    return found


def loose(h: Array, bound: Array, tol: float, faint: float = 1e-3) -> Array:
    """Whether at each frequency some bound exceeds the tolerance, bool, shape (nf,).

    The tolerance is relative to |h_ij|, but at least to the share `faint` of the largest response to the load, and of the median
    over frequency.
    """
    size = np.abs(h)
    size = np.maximum(size, faint * np.maximum(size.max(axis=1, keepdims=True), np.median(size, axis=0)))
    return ~(bound <= tol * size).all(axis=(1, 2))


def within(h: Array, bound: Array, tol: float, computed: bool = True) -> Tally:
    """The number of frequencies, and of those with all bounds within the tolerance; the latter only if all is `computed`."""
    return Tally(len(h), int(np.count_nonzero(~loose(h, bound, tol))) if computed else None)


def columns(model: Substructure, given: Any, what: str) -> tuple[tuple[str, ...], Array]:
    """Loads or responses by their names, and as columns (n, k)."""
    if isinstance(given, np.ndarray) and given.dtype.kind == "f":
        W = real_array(what, given)
        if W.ndim not in (1, 2) or W.shape[0] != model.size or not W.size:
            raise InputError(f"{what} have the shape {W.shape}; the model has {model.size} DOF, so ({model.size},) or "
                             f"({model.size}, k)")
        W = W.reshape(model.size, -1)
        return tuple(f"column {k}" for k in range(W.shape[1])), W
    if given is None and not model.ports:
        raise InputError(f"{model.name!r} has no ports: name {what}, as DOF, names of interface sets, or columns")
    single = isinstance(given, (str, int, np.integer)) and not isinstance(given, bool)
    asked = list(model.ports) if given is None else [given] if single else items(what, given, "ports or DOF")
    if not asked:
        raise InputError(f"{what} is empty: name at least one port or DOF")
    basis = model.V if isinstance(model, ReducedSubstructure) else None
    size = model.size if basis is None else len(basis)
    parts = []
    for key in asked:
        if isinstance(key, str) and (key in model.ports or key not in model.sets):
            with naming(what):
                w = model.port(key)
        elif isinstance(key, str):
            joined: Matrix = model.interface_rows[model.sets[key]].T
            w = np.asarray(joined.toarray() if sp.issparse(joined) else joined)
        elif isinstance(key, bool) or not isinstance(key, (int, np.integer)):
            raise InputTypeError(f"each of {what} must be the name of a port or an interface set, or a DOF, not {shown(key)}")
        else:
            dof = whole_number(f"the DOF in {what}", key)
            if not 0 <= dof < size:
                raise InputError(f"{what}: there is no DOF {dof}. {model.name!r} has {size}, counted from 0")
            w = np.zeros(size)
            w[dof] = 1.0
            w = w if basis is None else np.array(basis[dof])
        parts.append((key if isinstance(key, str) else f"DOF {key}", w))
    names = [name if w.ndim == 1 else f"{name}[{k}]" for name, w in parts for k in range(1 if w.ndim == 1 else w.shape[1])]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{what}: {twice[0]!r} is named {names.count(twice[0])} times")
    return tuple(names), np.column_stack([w for _, w in parts])


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


# ---- the equations as a whole

def port_responses(pencil: Pencil, s: complex, W: Array, H: Matrix | None = None) -> tuple[Array, Array]:
    """P(s)⁻¹W and P(s)⁻ᵀW, shape (n, p) each: the responses to harmonic forces on the columns of W, from one factor.

    P has K + iH if the structural damping H is given.

    Raises
    ------
    SingularMatrixError
        s is an eigenvalue, e.g. iω at an undamped resonance.
    """
    solve = _solver(pencil, s, H)
    x = solve(W, False)
    return x, x if all(pencil.symmetric) else solve(W, True)


def _solver(pencil: Pencil, s: complex, H: Matrix | None) -> Any:
    """A function of (B, transposed) that returns P(s)⁻¹B or P(s)⁻ᵀB."""
    if pencil.is_sparse and s == 0 and H is None and pencil.symmetric[2]:
        real = shared_factor(pencil.K, "symmetric")
        return lambda B, transposed: real.solve(B)
    return inverse_at(pencil, s, H).solve


@dataclass(frozen=True, eq=False)
class Whole:
    """The equations of a model, solved directly at one frequency after another."""

    pencil: Pencil
    H: Matrix | None
    F: Array
    C: Array

    def response(self, omega: float) -> tuple[Array, Array, float]:
        """h (nr, nl), its bound, and the largest backward error.

        With x' and y', the computed P⁻¹F and P⁻ᵀC, y'ᵀ(F - Px') is the error of h to first order. The rounding error of the
        residual is added entry by entry; it has the size of a rounding in each entry of the matrices. The bound is infinite if
        such roundings, with random signs, change x' or y' by their own size: then P is singular within rounding.
        """
        pencil, s = self.pencil, 1j * omega if omega else 0.0
        try:
            solve = _solver(pencil, s, self.H)
            x = solve(self.F, False)
            y = x if self.C is self.F and all(pencil.symmetric) else solve(self.C, True)
        except SingularMatrixError:
            raise _singular(omega) from None
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise _singular(omega)
        rest, each = self._residual(pencil, s, self.F, x)
        wrong = pencil.backward_error(np.full(x.shape[1], s), x, rest).max(initial=0.0)
        changed = _changed(solve, False, each, x)
        if y is not x:
            transposed = pencil if all(pencil.symmetric) else pencil.transposed()
            changed = max(changed, _changed(solve, True, self._residual(transposed, s, self.C, y)[1], y))
        bound = np.abs(y).T @ each / (1 - changed) ** 2 if changed < 1 else np.full((y.shape[1], x.shape[1]), np.inf)
        return self.C.T @ x, bound, float(wrong)

    def _residual(self, pencil: Pencil, s: complex, F: Array, x: Array) -> tuple[Array, Array]:
        """F - Px, and its size plus that of its rounding, entry by entry."""
        values = np.full(x.shape[1], s)
        rest, size = F - pencil.residual(values, x), np.abs(F) + pencil.magnitude(values, x)
        if self.H is not None:
            rest, size = rest - 1j * (self.H @ x), size + abs(self.H) @ np.abs(x)
        return rest, np.abs(rest) + _terms(pencil) * EPS * size


def _changed(solve: Any, transposed: bool, residual: Array, x: Array) -> float:
    """The largest change of a column of x by a residual of this size and random signs, relative to the column."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], residual.shape)
    size = np.linalg.norm(x, axis=0)
    change = np.linalg.norm(solve(signs * residual, transposed), axis=0)
    return float(np.divide(change, size, out=np.zeros_like(size), where=size > 0).max(initial=0.0))


def _terms(pencil: Pencil) -> float:
    """The number of roundings in one entry of Px: those of the entries of a row add up at random."""
    longest = int(np.diff(pencil.K.indptr).max()) if pencil.is_sparse else pencil.size
    return 4 + float(np.sqrt(longest))


def _singular(omega: float) -> SingularMatrixError:
    return SingularMatrixError(f"the dynamic stiffness is singular at ω = {omega:.6g}, an undamped resonance or rigid motion. "
                               "Give frequencies without this one, or add damping")


# ---- by modes

@dataclass(frozen=True)
class _Columns:
    """The matrix W C Wᵀ (n, n) with a few columns W (n, p), which may be dense."""

    W: Array
    C: Array

    def __matmul__(self, x: Array) -> Array:
        return self.W @ (self.C @ (self.W.T @ x))


@dataclass(frozen=True, eq=False)
class Modal:
    """A model projected on V = [Φ Ψ]; see the module's docstring.

    Attributes
    ----------
    basis : EnergyBasis
    matrices : ndarray, shape (3, r, r)
        K + iH, D and M with contacts.
    F, C : ndarray, shapes (r, nl) and (r, nr)
    lost_F, lost_C : ndarray, shapes (nl,) and (nr,)
        ‖F_L‖ and ‖C_L‖ of each column.
    spoilt : (float, float)
        d and k: contacts and dashpots lower c by ωd + k.
    noise : ndarray, shape (r, r)
        The change in the entries of A = VᵀP(iω)V that rounding in each entry of the matrices, and errors of the modes, may cause.
    noise_F, noise_C : ndarray, shapes (r, nl) and (r, nr)
        The change that rounding may cause in VᵀF and VᵀC.
    modes : int
        The number of modes, rigid-body modes included.
    """

    basis: EnergyBasis
    matrices: Array
    F: Array
    C: Array
    lost_F: Array
    lost_C: Array
    spoilt: tuple[float, float]
    noise: Array
    noise_F: Array
    noise_C: Array
    modes: int

    @classmethod
    def of(cls, model: Substructure, contacts: Contacts, F: Array, C: Array, highest: float, most: int, *,
           reach: float = 2.0, sweeps: int = 3) -> Modal:
        """The projection for frequencies up to `highest`, with all modes up to `reach` times that frequency, at most `most`
        modes.

        Then c is at least 3/4, without contacts. `sweeps` times, static responses to images outside the basis are added; one or
        two sweeps make the bound small.

        Raises
        ------
        InputError
            The bound of the module's docstring does not hold for the model, or there are too many modes.
        """
        acting = [small_matrices(model, contact) for contact in contacts_of(contacts)]
        if any(map(sp.issparse, (part for term in acting for part in term))):
            raise InputError("contacts of surfaces act on too many DOF for the modal way. Take method='direct'")
        braked = np.unique(np.concatenate(model.D.nonzero()))  # the rows and columns of D
        few = len(braked) <= BLOCK  # one solve gives each DOF its static response
        if few:  # D acts as a contact does
            one_by_one = np.zeros((model.size, len(braked)))
            one_by_one[braked, np.arange(len(braked))] = 1.0
            acting.append((one_by_one, one_by_one.T @ (model.D @ one_by_one), 0.0))
        elif not model.pencil.symmetric[1]:
            raise InputError("an unsymmetric D on many DOF has no bound for the modal way. Take method='direct'")
        forces = np.hstack([F, C, *(W for W, *_ in acting)])
        if forces.shape[1] > WIDE:
            raise InputError(f"{forces.shape[1]} columns of loads, responses, contacts and dashpots are too many for the modal "
                             f"way (at most {WIDE}). Take method='direct', or ask for fewer at a time")
        handle = ShiftInvert(model.K, model.M, carried=model.rigid_motion)
        floor = handle.lowest ** 0.5 / reach  # far below, rounding of K may hide whether rigid motion is below the limit
        limit = max(reach * highest, floor) if np.isfinite(floor) or not highest else reach * highest
        if most < model.size and (count := modes_under(model.K, model.M, limit**2)) > most:
            raise InputError(f"{count} modes lie below {limit:.5g} rad/time, more than {most}. Take method='direct'")
        found = modes_below(model.K, model.M, limit, handle)

        # K' with its solutions, corrected once for the errors of the modes and of the factor
        Phi, values, top = found.shapes, found.eigenvalues, found.counted[0] ** 2
        momenta, lift = model.M @ Phi, np.diag(values - top)

        def product(x: Array) -> Array:
            return np.asarray(model.K @ x - momenta @ (lift @ (momenta.T @ x)))

        def solve(B: Array) -> Array:
            x = np.zeros(B.shape)
            for _ in range(2):
                rest = B - product(x)
                x += handle.elastic_solve(rest, Phi) + Phi @ (Phi.T @ rest) / top
            return x

        # the terms, and their ranges for imaginary s; static responses of terms on few columns lie in V, up to `spoilt`
        constant, rate, none = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0)
        terms = [Term(model.M, (0.0, 0.0, 1.0), range=(0.0, 1 / top)), Term(_Columns(momenta, lift), constant, range=none)]
        terms += [] if few else [Term(model.D, rate, range=none)]
        terms += [] if model.H is None else [Term(model.H, (1j, 0.0, 0.0), range=none)]
        rounding, sizes = _terms(model.pencil) * EPS, []
        for W, *factors in acting:
            full = [np.array(part if np.ndim(part) else part * np.eye(W.shape[1])) for part in factors]
            sizes.append((np.abs(W), highest * np.abs(full[0]) + np.abs(full[1]), [float(np.linalg.norm(part)) for part in full]))
            for part, weights in zip(full, (rate, constant), strict=True):
                terms += [Term(_Columns(W, half), weights, sign, none)
                          for half, sign in zip(halves(part), (1.0, -1.0), strict=True) if half.any()]

        # V: the modes, static responses, and static responses to images outside these
        basis = EnergyBasis(product, solve, terms, model.size)
        basis.add(Phi / np.sqrt(top), unit=True)
        static = solve(forces)
        basis.add(static)
        for _ in range(sweeps):
            loads = []
            for i, term in enumerate(terms):
                size, turn = np.linalg.eigh(basis.lost[i, :, i])
                joining = abs(term.weight(np.array(1j * highest))) ** 2 * size > TOL**2
                loads.append(basis.image(i, turn[:, joining][:, -BLOCK:]))
            if not basis.add(solve(np.hstack(loads))):
                break
        V, size, m = basis.V, np.abs(basis.V), len(values)

        # the part of the forces outside V, and the changes that rounding and the errors of the modes may cause
        change = solve(forces - product(static))  # the error of the solutions, to first order
        lost = sum(np.einsum("ij,ij->j", x, product(x)).clip(0.0) for x in (static + change - V @ (V.T @ forces), change))
        of_F, of_C, *of_acting = np.split(lost, np.cumsum([F.shape[1], C.shape[1], *(W.shape[1] for W, *_ in acting)])[:-1])
        spoilt = [sum(float(own.sum()) * norms[at] for own, (*_, norms) in zip(of_acting, sizes, strict=True)) for at in (0, 1)]
        each = abs(model.K) @ size + highest**2 * (abs(model.M) @ size)
        each = each if few else each + highest * (abs(model.D) @ size)
        each = each if model.H is None else each + abs(model.H) @ size
        noise = rounding * (size.T @ each)
        for columns_, both, _ in sizes:
            touched = size.T @ columns_
            noise += rounding * (touched @ both @ touched.T)
        matrices = basis.matrices  # ΦᵀKΦ and ΦᵀMΦ are known more accurately
        for at, given, own in ((0, basis.energy + basis.inside[1], values / top), (2, basis.inside[0], np.full(m, 1 / top))):
            change = -given
            change[m:, m:] = 0.0
            change[np.arange(m), np.arange(m)] += own
            matrices[at] += change
            noise += (highest**2 if at else 1.0) * np.abs(change)
        return cls(basis, matrices, V.T @ F, V.T @ C, np.sqrt(of_F), np.sqrt(of_C), (spoilt[0], spoilt[1]), noise,
                   rounding * (size.T @ np.abs(F)), rounding * (size.T @ np.abs(C)), m)

    def response(self, omega: float) -> tuple[Array, Array, float]:
        """h (nr, nl), its bound, and the largest ‖F - Px‖ / ‖x‖ in the norms of energy."""
        A = np.tensordot([1.0, 1j * omega, -omega**2], self.matrices, 1)
        right, left = self.basis.products(1j * omega)
        try:
            inverse = np.linalg.inv(A)
        except np.linalg.LinAlgError:
            raise _singular(omega) from None
        v, w = inverse @ self.F, inverse.T @ self.C
        into, out = (own + np.sqrt(np.einsum("ij,ij->j", x.conj(), gram @ x).real.clip(0.0))
                     for own, gram, x in ((self.lost_F, right, v), (self.lost_C, left, w.conj())))
        changed = np.abs(inverse) @ self.noise  # by rounding: how much a vector A⁻¹b may change, relative to its entries
        sure = 1 - float(np.linalg.norm(changed))
        margin = self.basis.coercivity((0.0, 0.0), omega) - omega * self.spoilt[0] - self.spoilt[1]
        margin -= np.sqrt(max(np.einsum("ij,ji->", inverse.conj().T @ right, inverse @ left).real, 0.0)) / max(sure, EPS)
        bound = np.full((len(out), len(into)), np.inf)
        if margin > 0 and sure > 0:
            size = np.linalg.solve(np.eye(len(A)) - changed, np.abs(v))
            rest = np.abs(self.F - A @ v) + self.noise @ size + self.noise_F
            bound = np.outer(out, into) / (margin * sure**2) + np.abs(w).T @ rest + self.noise_C.T @ size
        energy = np.linalg.norm(v, axis=0)
        wrong = np.divide(into, energy, out=np.zeros_like(into), where=energy > 0)
        return self.C.T @ v, bound, float(wrong.max(initial=0.0))
