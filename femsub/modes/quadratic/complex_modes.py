"""Complex eigenvalue analysis (CEA): (λ²M + λD + K)x = 0 for full and reduced models, with error bars and proofs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import SMALL, reused_memory, unit_length
from femsub.checks import (
    NOT_CHECKED,
    Array,
    ConditionWarning,
    FemsubWarning,
    InputError,
    Matrix,
    Tally,
    check_band,
    instance,
    truth,
    until,
    warn,
)
from femsub.model import Pencil, RigidMotion, Substructure, beyond, look_at_the_order, usable_band
from femsub.modes.charts import modes_chart
from femsub.modes.mode_names import parts_energies
from femsub.modes.quadratic.bars import bars
from femsub.modes.quadratic.dense import blurred
from femsub.modes.quadratic.lossy import LossyPencil
from femsub.modes.quadratic.projected_count import UNCOUNTED, Projection, Varied
from femsub.modes.quadratic.region import region_of
from femsub.modes.quadratic.search import SearchResult, count_over, projection_over, search
from femsub.modes.shaped import Shaped
from femsub.output import Chart, Table, damping_percent

if TYPE_CHECKING:
    from femsub.model import Contacts

log = logging.getLogger(__name__)

LOUD = 1e-9  # backward error above which there is a warning


@dataclass(frozen=True, eq=False, repr=False)
class ComplexModes(Shaped):
    """Complex modes of a model, made by `complex_modes`: k eigenpairs of λ²M + λD + K with their error bars.

    Attributes
    ----------
    eigenvalues : ndarray of complex, shape (k,)
        By count: nearest to 0 first, both members of a pair side by side. By band: ascending in Im λ.
    shapes : ndarray of complex, shape (n, k) or (r, k)
        Right eigenvectors of unit length, in the model's coordinates.
    backward_error : ndarray, shape (k,)
        See `Pencil.backward_error`.
    error_bar : ndarray, shape (k,)
        Bound of the error of the eigenvalue: |y|ᵀ(2|r| + rounding in P(λ)x) / |yᴴP'(λ)x|, that is backward error times condition
        number, with the residual r = P(λ)x and the left vector y (Tisseur 2000, Th. 5). It is evaluated entry by entry, so it
        does not depend on the units of the DOF. If rounding may let two eigenvalues coalesce, their gap is added. Infinite for a
        defective eigenvalue. Infinite also if |y|ᵀ|r| is above 1e-3 of the same sum over the terms of r: λ and x are no solution
        then. 0 for rigid motion.
    condition : ndarray, shape (k,)
        κ = (|λ|²‖M‖ + |λ|‖D‖ + ‖K‖) ‖x‖‖y‖ / (|λ| |yᴴP'(λ)x|): a relative perturbation ε of the matrices moves λ by up to
        κ ε |λ| (Tisseur 2000, Th. 5). Unlike `error_bar` it depends on the units of the DOF. Infinite at 0 and for a
        defective eigenvalue.
    rigid : ndarray of bool, shape (k,)
        Eigenvalues at 0 from rigid-body modes, Kx = 0 within rounding: neither unstable nor Hopf points.
    above_cutoff : ndarray of bool, shape (k,)
        Eigenvalues above the reduction's cut-off. They are listed if no band was asked for, but `is_stable` ignores them.
    searched : (re_lo, re_hi, lo, hi) or None
        The rectangle that was searched for a band.
    cutoff : float
        Cut-off of the model (inf for a full model). No statement is made about modes above it. If it is not known (NaN), the
        evidence is 'not checked'.
    tally : Tally
        The number of eigenvalues found and their independent count (`femsub.checks`).
    evidence : str
        The evidence that no eigenvalue is missing. 'certified': all eigenvalues were computed, or their number follows from
        inertia, alone or together with the error bound of a projection. 'not checked' otherwise.
    counted : (radius, number) or None
        The independent count in a disc: `number` eigenvalues lie in |λ| < radius, conjugates included, and all have been found.
        For a band the disc contains the searched rectangle. None if the count was made in a rectangle.
    full_growth : ndarray, shape (k, 2), or None
        The range in which Re λ of the full system lies; NaN outside the band. Known for a model of contact modes with a
        tolerance, under the contacts that it was made for; else None.
    left : ndarray of complex, shape (n, k) or (r, k), or None
        Left eigenvectors of unit length, yᴴP(λ) = 0, from which the error bars follow; None if they were not computed.

    Examples
    --------
    >>> import femsub as fs
    >>> modes = fs.complex_modes(fs.chain(10, belt=2), fs.Belt(slope=-0.2677), count=4)
    >>> modes.is_stable, len(modes), modes.evidence
    (False, 4, 'certified')
    """

    eigenvalues: Array
    shapes: Array
    backward_error: Array
    error_bar: Array
    rigid: Array
    above_cutoff: Array
    searched: tuple[float, float, float, float] | None = None
    counted: tuple[float, int] | None = None
    condition: Array = field(default_factory=lambda: np.zeros(0))
    tally: Tally = field(default=Tally(0))
    full_growth: Array | None = None
    cutoff: float = np.inf
    left: Array | None = None

    @property
    def evidence(self) -> str:
        """'certified', 'confirmed' or 'not checked'; see `femsub.checks`."""
        return NOT_CHECKED if np.isnan(self.cutoff) else self.tally.evidence

    @property
    def stable(self) -> tuple[bool | None, ...]:
        """Per eigenvalue: True left of the axis, False right of it, None on it within the error bar (or rigid).

        None as well if `full_growth` is known and contradicts the sign or contains 0.
        """
        votes = [None if rigid or abs(value.real) <= bar else bool(value.real < 0)
                 for value, bar, rigid in zip(self.eigenvalues, self.error_bar, self.rigid, strict=True)]
        if self.full_growth is None:
            return tuple(votes)
        return tuple(vote if not (high >= 0 if vote else low <= 0) else None
                     for vote, (low, high) in zip(votes, self.full_growth, strict=True))

    @property
    def is_stable(self) -> bool | None:
        """False if a mode grows, True if all modes decay, None if the error bars do not decide.

        Rigid-body modes and modes above the cut-off do not count.
        """
        votes = [vote for vote, rigid, beyond in zip(self.stable, self.rigid, self.above_cutoff, strict=True)
                 if not rigid and not beyond]
        if False in votes:
            return False
        return True if votes and None not in votes else None

    @property
    def unstable(self) -> Array:
        """Indices of the modes below the cut-off that certainly grow (Re λ above its error bar)."""
        return np.array([i for i, vote in enumerate(self.stable) if vote is False and not self.above_cutoff[i]], dtype=int)

    @property
    def frequencies(self) -> Array:
        """|Im λ| in radians per unit of time, shape (k,)."""
        return np.abs(self.eigenvalues.imag)

    @property
    def frequencies_hz(self) -> Array:
        """|Im λ| / 2π, shape (k,); Hz where the unit of time is the second."""
        return self.frequencies / (2 * np.pi)

    @property
    def damping_percent(self) -> Array:
        """-100 Re λ / |λ|, shape (k,); 0 for an eigenvalue at 0. Below 0 a mode grows."""
        return damping_percent(self.eigenvalues)

    @property
    def growth(self) -> float:
        """The largest Re λ of the modes that decide `is_stable` (-inf if there is none)."""
        return float(self.eigenvalues.real[~self.rigid & ~self.above_cutoff].max(initial=-np.inf))

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def tables(self) -> list[Table]:
        """A table with a row for each eigenvalue with Im λ ≥ 0, by frequency."""
        stable = self.stable
        chosen: Array = np.flatnonzero(self.eigenvalues.imag >= 0)
        rows = [{"mode": number, "omega": float(self.eigenvalues[i].imag),
                 "growth": float(self.eigenvalues[i].real), "damping": float(self.damping_percent[i]),
                 "error_bar": float(self.error_bar[i]), "backward_error": float(self.backward_error[i]), "is_stable": stable[i],
                 "rigid": bool(self.rigid[i]), "above_cutoff": bool(self.above_cutoff[i])}
                for number, i in enumerate(chosen[np.argsort(self.eigenvalues.imag[chosen], kind="stable")], 1)]
        columns = ["mode", "omega", "growth", "damping", "error_bar", "is_stable"]
        return [Table("complex-modes", rows, columns, "Complex modes")] if rows else []

    def chart(self, title: str = "Complex modes") -> Chart:
        """Im λ over Re λ, and over the damping ratio -Re λ/|λ| in %, for eigenvalues with Im λ ≥ 0; growing modes are red."""
        return modes_chart(self, title)

    @property
    def least_stable(self) -> int | None:
        """The index of the oscillating mode with the largest Re λ, without rigid motion; None if no mode oscillates."""
        moving = np.flatnonzero(~self.rigid & (self.eigenvalues.imag > 0))
        return int(moving[np.argmax(self.eigenvalues.real[moving])]) if len(moving) else None

    @property
    def fastest(self) -> int | None:
        """The index of the oscillating mode below the cut-off that grows fastest; None if none grows."""
        at = np.flatnonzero((self.eigenvalues.imag > 0) & ~self.above_cutoff & (self.eigenvalues.real > 0))
        return int(at[np.argmax(self.eigenvalues.real[at])]) if len(at) else None

    def growing(self, model: Substructure | None = None) -> list[dict[str, Any]]:
        """A row for each growing mode, by frequency.

        With the model given, a row has each part's share of the kinetic energy, 'energy_PART'.
        """
        chosen: Array = self.unstable[np.argsort(self.eigenvalues[self.unstable].imag)]
        shares = {} if model is None else parts_energies(model, self.shapes[:, chosen])[0]
        return [{"omega": value.imag, "growth": value.real, "error_bar": bar, "damping": -100 * value.real / abs(value),
                 **{f"energy_{name}": float(share[i]) for name, share in shares.items()}}
                for i, (value, bar) in enumerate(zip(self.eigenvalues[chosen], self.error_bar[chosen], strict=True))]

    def drawn_first(self) -> list[int]:
        """Indices of the growing modes with Im λ > 0; if there are none, the index of the least stable mode."""
        grows = [int(i) for i in self.unstable if self.eigenvalues[i].imag > 0]
        return grows or [i for i in (self.least_stable,) if i is not None]

    def title_of(self, i: int) -> str:
        """The title of a picture of shape i: frequency and damping."""
        return f"ω = {self.eigenvalues[i].imag:.5g} rad/time, damping {self.damping_percent[i]:.3g} %"

    def __repr__(self) -> str:
        verdict = {True: "stable", False: f"unstable ({len(self.unstable)} of them grow)",
                   None: "stability undecided within the error bars"}[self.is_stable]
        if self.growth == -np.inf:
            verdict = "none of which decides stability"  # rigid motion, or above the cut-off
        verdict += until(self.cutoff) if self.searched is None or np.isnan(self.cutoff) else ""
        verdict += f", largest Re λ {self.growth:.6g}" if self.growth > -np.inf else ""
        worst = f"{self.backward_error.max():.0e}" if len(self) else "none"
        beyond = f", {int(self.above_cutoff.sum())} above the cut-off" if self.above_cutoff.any() else ""
        return (f"ComplexModes: {len(self)} eigenvalues{beyond}, {verdict}; backward error {worst}, "
                f"completeness {self.evidence}")


def complex_modes(model: Substructure | Pencil, contacts: Contacts = None, *,
                  count: int | None = None, band: tuple[float, float] | None = None,
                  re: tuple[float, float] | None = None, evidence: bool | None = None) -> ComplexModes:
    """Complex modes of a substructure with linearised contacts, or of a pencil: (λ²M + λD + K)x = 0.

    The eigenvalues of sparse models, and of dense models above 300 DOF, are counted by a projection on undamped modes (see
    `evidence`). The eigenpairs of the projection are corrected with its own factor until their residual is rounding. If no
    projection can count, or most eigenvalues are wanted, LAPACK finds all eigenvalues of dense models and of models of up to
    2,000 DOF. In larger sparse models SLEPc's PEP (TOAR, shift-invert) finds the eigenvalues nearest to 0.

    A model with structural damping H has K + iH in place of K where Im λ > 0, K - iH where Im λ < 0, and K where λ is real. All
    solutions are listed. LAPACK finds them, up to 2,000 DOF. On the imaginary axis, where stability is lost, H is exact. The real
    λ are those of the model without H. If H moves one of these above the real axis, the real λ and the new pair are both listed.
    So there may be more than 2n eigenvalues.

    Parameters
    ----------
    model : Substructure or Pencil
        A pencil may have any real D and K, symmetric or not.
    contacts : Belt, LinearContact or another contact, or a sequence of them, optional
        A belt adds F μ'(v0) w wᵀ to D; other contacts add terms of their own to D and K
        (`femsub.model.contact.Contact`). K may become unsymmetric. Without a contact the model's own D and K
        are used. Not for a pencil.
    count : int, optional
        Number of eigenvalues nearest to 0, conjugates included. A pair is never split, so there may be one more.
    band : (lo, hi), optional
        Every eigenvalue with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi, in radians per unit of time. The edges belong to the band, with a
        tolerance of 1e-9 |λ| for rounding. A double eigenvalue split by rounding (up to 1e-6 |λ|) is in as a whole or not at all
        (`bands.in_band`). For contact modes with a tolerance, a λ beside the band is also listed if the λ of the full system may
        lie in the band. A band that reaches above the cut-off of a reduced model is refused.
    re : (a, b), optional
        With `band`: a ≤ Re λ ≤ b instead.
    evidence : bool, optional
        Whether to count the eigenvalues independently. In a band, for any D and K, the undamped modes up to 2.5 times the upper
        edge are found and counted. A bound of the truncation error then proves the number of complex eigenvalues
        (`projected_count`). This takes a few real factorisations, and about as many solves as 300 modes. Two factorisations are
        enough if D is proportional except for at most 40 columns (belts, dashpots). For a `count`, the eigenvalues are counted in
        a disc around 0. Counting is the default for a band, and for a `count` up to 200,000 DOF; up to 2,000 DOF it is always
        done. If damping or gyroscopic forces are too strong for the bound, LAPACK lists all eigenvalues up to 2,000 DOF: 2n, or
        the number that follows from the ranks of M and D. In larger models inertia alone counts if D is proportional, or skew as
        in a rotating part. Otherwise no count is possible there, whatever `evidence` asks for: the eigenvalues found by a search
        are listed, 'not checked', and a warning gives the reason with the number needed. With ``evidence=True`` the search is
        repeated from other start vectors where eigenvalues are close to each other.

    Returns
    -------
    ComplexModes
        λ, shapes, error bars, and the evidence that no eigenvalue is missing.

    Raises
    ------
    InputError, InputTypeError
        `count` and `band` together, or neither for a sparse model above 2,000 DOF; more than 2n eigenvalues; a band that reaches
        above the cut-off; a part that friction pushes but no support holds, unless a band begins above 0.
    NotConvergedError, SingularMatrixError, MissedModesError
        The eigensolver has not converged; no shift makes the pencil regular; the independent count differs from the number found.

    Warns
    -----
    FemsubWarning
        A backward error is above 1e-9.
    ConditionWarning
        M or D has a rank that depends on rounding, so that the number of finite eigenvalues is not known: 'not checked'. Or
        eigenvalues have an elastic energy within the rounding of a K written with few digits.

    References
    ----------
    F. Tisseur, Linear Algebra Appl. 309 (2000) 339 (backward error and condition); C. Campos, J. E. Roman, SIAM J. Sci.
    Comput. 38 (2016) S385 (PEP, TOAR).

    Examples
    --------
    >>> import femsub as fs
    >>> rom = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=4), ports=True)
    >>> modes = fs.complex_modes(rom, fs.Belt(slope=-0.01), count=2)
    >>> modes.eigenvalues.imag.round(3), modes.is_stable
    (array([ 0.149, -0.149]), True)
    """
    if evidence is not None:
        truth("evidence", evidence)
    pencil = pencil_of(model, contacts)
    return _listed(model, contacts, pencil, count, None if band is None else usable_band(model, band), re, evidence)


def beside_the_full(model: Substructure, contacts: Contacts, *, band: tuple[float, float] | None = None,
                    evidence: bool | None = None) -> ComplexModes:
    """`complex_modes` in a band that may reach above the cut-off, for comparisons; the evidence is 'not checked' then."""
    found = _listed(model, contacts, pencil_of(model, contacts), None, band, None, evidence)
    return found if band is None or not beyond(band[1], model.cutoff) else replace(found, tally=Tally(len(found)))


def modes_over(pencil_at: Callable[[float], Pencil], values: Sequence[float],
               terms: Sequence[tuple[int, Matrix, Callable[[float], float]]] | None, band: tuple[float, float]
               ) -> Iterator[ComplexModes]:
    """`complex_modes` of a pencil in a band at ascending values of a parameter, counted by one projection.

    The projection is made from the undamped modes at the middle of the values. Each (q, T, θ) in `terms` is a term θ(p) λ^q T of
    the pencil, and no other term depends on p. The modes returned are those of the projection, one of each pair; their error bars
    bound its truncation error. If a bar reaches the imaginary axis, if the terms are not known (None), or if the projection gives
    no count, the value is solved alone.
    """
    m, projection, theta = (values[0] + values[-1]) / 2, None, np.zeros((len(values), 0))
    middle = pencil_at(m)
    if terms is None:
        log.info("a contact is not affine in the parameter, so that each value is solved alone")
    elif middle.is_sparse and middle.size > SMALL:  # of other models LAPACK finds all eigenvalues
        theta = np.array([[of(p) - of(m) for *_, of in terms] for p in values]).reshape(len(values), -1)
        sizes = np.abs(theta).max(axis=0).tolist()
        changes = [Varied(T, q, size) for (q, T, _), size in zip(terms, sizes, strict=True)]
        try:
            projection = projection_over(middle, changes, (-band[1], band[1], *band), kept=True)
        except UNCOUNTED as error:
            log.info("no projection for all values of the parameter, so that each is solved alone: %s", error)
    for p, weights in zip(values, theta.tolist(), strict=True):
        pencil = pencil_at(p)
        if projection is not None:  # in its units; shapes that one value adds to the basis stay for the next value
            projection, pencil = projection.changed(weights), pencil._with(units=middle.units)
            if (rough := _rough(projection, pencil, band)) is not None:
                yield rough
                continue
        yield _listed(pencil, None, pencil_of(pencil, None), None, band, None, None, projection)


def _rough(projection: Projection, pencil: Pencil, band: tuple[float, float]) -> ComplexModes | None:
    """The modes of a projection whose count in the band is proved; None without a count, or if a bar reaches the imaginary axis.

    The shapes outside the basis move λ by at most ‖P_LU x‖ ‖zᴴP_UL‖ / c to first order: these are the error bars.
    """
    count = count_over(projection, (-band[1], band[1], *band))
    small = projection.counted
    if count is None or small is None or projection.free.shape[1]:
        return None
    every = np.nan_to_num(small.each, nan=np.inf, posinf=np.inf)
    at = np.flatnonzero(count.contour.encloses(every) & (every.imag >= 0))
    lam = every[at]
    lengths = small._lengths(lam, np.zeros((1, 1)), (small._products(small.x[:, at]), small._products(small.z[:, at])))
    off = lengths[0].diagonal() * lengths[1].diagonal() / projection.least
    if (np.abs(lam.real) <= off).any():
        return None
    X, sparse = projection.V @ small.x[:, at], pencil.sparse()
    X = X if sparse.alike() is sparse else sparse.units[1][:, None] * X
    none = np.zeros(len(at), dtype=bool)
    X = X / np.linalg.norm(X, axis=0)
    return ComplexModes(lam, X, pencil.backward_error(lam, X), off, none, none, tally=count.tally(lam))


def _listed(model: Substructure | Pencil, contacts: Contacts, pencil: Pencil, count: int | None,
            band: tuple[float, float] | None, re: tuple[float, float] | None, evidence: bool | None,
            projection: Projection | None = None) -> ComplexModes:
    """`ComplexModes` of a model from its pencil with contacts, after the arguments of `complex_modes`; warns of poor results."""
    estimate = getattr(model, "estimate", None)
    if band is not None and estimate is not None:
        band = estimate.reaching(check_band(band))
    region = region_of(pencil, count, band, re)
    at_rest = contacts is not None and (region.box is None or region.box[2] == 0)  # a band above 0 has elastic modes only
    judged = model if at_rest and isinstance(model, Substructure) else None
    if judged is not None:
        judged.check_held(contacts)
    with reused_memory(pencil.size):
        found = pencil.all_modes() if isinstance(pencil, LossyPencil) else search(pencil, region, evidence, projection)
        if judged is not None and not pencil.symmetric[2]:
            found = _still(found, judged.floating(contacts))
        at = region.listed(found.values)
        result = with_bars(pencil, found.values[at], found.X[:, at], found.Y[:, at], found.known, model.cutoff)
    if result.backward_error.max(initial=0.0) > LOUD:
        warn(f"a complex mode has a backward error of {result.backward_error.max():.1e} (λ = "
             f"{result.eigenvalues[result.backward_error.argmax()]:.5g}). Ask for fewer, or scale the matrices",
             FemsubWarning)
    lost, unit = blurred(pencil, result.shapes)
    if (lost := lost & ~result.rigid).any():
        size = np.where(lost, np.abs(result.eigenvalues), 0.0)
        result = replace(result, error_bar=np.maximum(result.error_bar, size))
        warn(f"{int(lost.sum())} eigenvalues, up to |λ| = {size.max():.3g}, have an elastic energy within the rounding of K's "
             f"entries, which are known to about {unit:.0e} of each. Most likely they are rigid-body motion; their stability is "
             "undecided. Write K with all digits (17)", ConditionWarning)
    located = None if estimate is None or not len(estimate.located) or isinstance(pencil, LossyPencil) else estimate
    result = replace(result, searched=None if region.box is None else (*region.box[:3], min(region.box[3], model.cutoff)),
                     tally=found.tally,
                     counted=None if found.counted is None else found.counted.disc,
                     full_growth=None if located is None else located.growth_of_full(result.eigenvalues))
    log.info("%r", result)
    return result


def _still(found: SearchResult, motion: RigidMotion | None) -> SearchResult:
    """The eigenpairs with λ = 0 exactly for rigid motion that friction drives: K z = 0 but zᵀK ≠ 0.

    LAPACK's eigenvalues of this motion are those nearest to 0, with rounding errors. They are replaced by 0 and z.
    """
    if motion is None or (lacking := motion.zeros - int(np.count_nonzero(found.values == 0))) <= 0:
        return found
    order = np.argsort(np.where(found.values == 0, np.inf, np.abs(found.values)), kind="stable")
    at = order[:min(lacking, np.count_nonzero(found.values))]
    Z, X = np.linalg.qr(motion.shapes)[0], found.X[:, at]
    at = at[np.linalg.norm(X - Z @ (Z.T @ X), axis=0) < np.linalg.norm(Z.T @ X, axis=0)]  # others are elastic
    if not len(at) or found.values[at].sum().imag:  # a pair would be split
        return found
    values, X, Y = (part.copy() for part in (found.values, found.X, found.Y))
    values[at], X[:, at] = 0.0, unit_length(motion.shapes[:, np.arange(len(at)) % motion.count])
    return found._replace(values=values, X=X, Y=Y, known=np.append(np.delete(found.known, at), values[at])
                          if len(found.known) == len(values) else found.known)


def pencil_of(model: Substructure | Pencil, contacts: Contacts) -> Pencil:
    """The pencil of a model with its contacts linearised; a `LossyPencil` if the model has structural damping."""
    if isinstance(model, Pencil):
        if contacts is not None:
            raise InputError("a Pencil has no ports for contacts. Put the contact into D, or use a Substructure")
        pencil = model
    else:
        pencil = instance("model", model, Substructure, "or a Pencil").linearised(contacts, structural=True)
        model.refuse_empty(pencil.D, pencil.K, model.H)
        pencil = pencil if model.H is None else LossyPencil.of(pencil, model.H, model.name)
    look_at_the_order(*([(1.0, part)] for part in (pencil.M, pencil.D, pencil.K)))
    if not any(np.any(A.data if pencil.is_sparse else A) for A in (pencil.M, pencil.D)):
        raise InputError("M and D are both zero, so there are no eigenvalues")
    return pencil


def with_bars(pencil: Pencil, values: Array, X: Array, Y: Array, known: Array | None = None,
              cutoff: float = np.inf) -> ComplexModes:
    """`ComplexModes` of eigenpairs λ (k,), X (n, k), with error bars from their left vectors Y (n, k), see `bars`."""
    # C order: a sparse product would copy arrays of any other order, each time
    X, Y = np.ascontiguousarray(X), np.ascontiguousarray(Y)
    backward, bar, condition = bars(pencil, values, X, Y, known)
    rigid = (values == 0) & (bar == 0)
    return ComplexModes(values, X, backward, bar, rigid, beyond(np.abs(values.imag), cutoff), condition=condition, cutoff=cutoff,
                        left=Y)
