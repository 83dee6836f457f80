"""Linear criteria for the self-excited motion of a reduced model.

The criteria are missing and spurious growing modes, the errors of the other growing modes, and the error of the compliance
h(iω) = Wᵀ(-ω²M + iωD + K)⁻¹W at the contact. Linear analyses of a reduced model ignore modes above its cut-off, but time
integration does not. So all modes count here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, finite_number, instance, positive_number, real_array
from femsub.model import Contact, Contacts, ReducedSubstructure, Substructure, columns_of, contacts_of, within
from femsub.modes import ComplexModes, complex_modes, frequency_response, likeness, listed, match
from femsub.motion.nonlinear_model import project

CRITERIA = ("missing_share", "spurious_share", "growth_error", "frequency_error", "growth_distance", "projection_loss",
            "compliance_static", "compliance_max", "compliance_mean")


@dataclass(frozen=True, eq=False, repr=False)
class SelfExcitation:
    """Growing modes and port compliance of a reduced model compared with the full model, made by `self_excitation`.

    The full model has k growing modes.

    Attributes
    ----------
    growing : ndarray of complex, shape (k,)
        λ of the full model with Re λ > 0 and Im λ ≥ 0, by ascending Im λ.
    counterpart : ndarray of complex, shape (k,)
        The matching λ of the reduced model, growing or not: by default within 5 % of |λ|, and with a MAC of at least 0.9 if
        shapes can be compared; NaN if there is none.
    mac : ndarray, shape (k,)
        The MAC with the mode assigned (`matching.likeness`), whether it matches or not; NaN if shapes cannot be compared.
    loss : ndarray, shape (k,)
        The share of xᴴMx that the basis cannot represent; NaN without a basis.
    spurious : ndarray of complex
        Growing λ of the reduced model that match no growing λ of the full model.
    missing : ndarray of complex
        λ of growing modes of the full model that are missing in the reduced model, or decay there.
    missing_share : float
        The share of the full model's growing modes that are missing (0 if none grows).
    spurious_share : float
        Σ Re λ of spurious modes over Σ Re λ of the full model's growing modes (inf if only spurious modes grow).
    growth_error, frequency_error : float
        The largest |Δ Re λ| / Re λ, and |Δ Im λ| / |λ|, over modes with a counterpart; 0 without any.
    growth_distance : float
        (Σ_missing Re λ + Σ_spurious Re λ + Σ_others |Δ Re λ|) / Σ Re λ: 0 for the full model itself.
    projection_loss : float
        Σ Re λ loss / Σ Re λ: the share of the growing modes' energy outside the basis; NaN without one.
    compliance_static, compliance_max, compliance_mean : float
        ‖Δh‖ / ‖h‖ at ω = 0; the largest ‖Δh‖ over the largest ‖h‖; the mean of ‖Δh‖ / (‖h‖ + ‖h_r‖), which lies between
        0 and 1 and is not dominated by resonances. The compliances contain the models' D without the contacts.
    omega : ndarray
        Frequencies at which compliances were compared.
    band : (lo, hi) or None
        The band in which eigenvalues were compared; None for all.

    Examples
    --------
    >>> import femsub as fs
    >>> full = fs.chain(10, belt=2)
    >>> found = fs.self_excitation(full, fs.reduce(full, fs.CraigChang(6), ports=True), fs.Belt(slope=-0.03))
    >>> len(found.growing), len(found.missing), len(found.spurious)
    (2, 1, 0)
    """

    growing: Array
    counterpart: Array
    mac: Array
    loss: Array
    spurious: Array
    missing: Array
    missing_share: float
    spurious_share: float
    growth_error: float
    frequency_error: float
    growth_distance: float
    projection_loss: float
    compliance_static: float
    compliance_max: float
    compliance_mean: float
    omega: Array
    band: tuple[float, float] | None

    @property
    def verdict(self) -> str:
        """The motion to expect of a transient, in words.

        Reduced chains that lack more than 0.3 of the growing modes never reached the full model's motion
        (docs/guide/motion.md). Growth rates and compliance within 0.1 are fair.
        """
        if not len(self.growing) and not len(self.spurious):
            return "nothing grows, in either model"
        found = f"all {len(self.growing)} growing modes are there"
        if len(self.missing):
            found = f"{len(self.missing)} of {len(self.growing)} growing modes are missing (ω = {_list(self.missing)})"
        if len(self.spurious):
            word = "mode grows" if len(self.spurious) == 1 else "modes grow"
            found += f", {len(self.spurious)} spurious {word} (ω = {_list(self.spurious)})"
        if self.missing_share > 0.3 or not len(self.growing):
            expected = "other motions are expected"
        elif len(self.missing) or len(self.spurious) or max(self.growth_error, self.compliance_mean) > 0.1:
            expected = "the main motion may be the same, but not all coexisting ones"
        else:
            expected = "the same motions are expected"
        return (f"{expected}: {found}, growth rates within {100 * self.growth_error:.2g} %, "
                f"compliance at the contact {100 * self.compliance_mean:.2g} % off on average")

    def flat(self) -> dict[str, float]:
        """The criteria by their names in CRITERIA, and the numbers of growing modes, for tables, CSV and JSON."""
        return {"growing": len(self.growing), "missing": len(self.missing), "spurious": len(self.spurious),
                **{name: float(getattr(self, name)) for name in CRITERIA}}

    def __repr__(self) -> str:
        return (f"SelfExcitation: {len(self.missing)} of {len(self.growing)} growing modes missing, {len(self.spurious)} "
                f"spurious, growth rates within {100 * self.growth_error:.2g} %, compliance {100 * self.compliance_mean:.2g} % "
                f"off up to ω = {self.omega.max():.4g}")


def self_excitation(full: Substructure, reduced: Substructure | Sequence[Substructure], contacts: Contacts, *,
                    band: tuple[float, float] | None = None, count: int | None = None,
                    omega: Any = None, harmonics: float = 3.0, near: float = 0.05, alike: float = 0.9
                    ) -> SelfExcitation | tuple[SelfExcitation, ...]:
    """Check by linear criteria whether a reduced model can show the full model's self-excited motion.

    Growing modes and the port compliance h(iω) = Wᵀ(-ω²M + iωD + K)⁻¹W are compared. A sequence of models gives a tuple.

    Parameters
    ----------
    full : Substructure
        The full model, solved once.
    reduced : Substructure or sequence of Substructure
        Shapes are compared as well if the model has a basis V (from `reduce`).
    contacts : Belt, LinearContact or another contact, or a sequence of them
    band, count
        As for `complex_modes`: the part of a sparse full model's spectrum that is computed. Modes of the reduced models
        outside it are not judged.
    omega : array_like, optional
        Frequencies at which compliances are compared, in radians per unit of time. Default: evenly from 0 to `harmonics` times
        the highest growing frequency (or the highest frequency if none grows); 400 points, or 40 for more than 150 DOF.
    harmonics : float
        See `omega`. Friction is strongly nonlinear and excites harmonics of the growing frequencies.
    near, alike : float
        A mode of a reduced model matches a mode of the full model if |Δλ| / |λ| is at most `near` and the MAC of the two shapes
        at least `alike`. By default 5 % of |λ|, and an angle between the shapes of at most 18°.

    Returns
    -------
    SelfExcitation or tuple of SelfExcitation

    Raises
    ------
    InputError, InputTypeError
        An unknown port, a basis of another model, a sparse full model without band or count, bad frequencies.
    SingularMatrixError
        A model's dynamic stiffness is singular at one of the frequencies: an undamped resonance.

    Examples
    --------
    >>> import femsub as fs
    >>> full = fs.chain(10, belt=2)
    >>> few, many = (fs.reduce(full, fs.CraigChang(modes), ports=True) for modes in (2, 6))
    >>> found = fs.self_excitation(full, [few, many], fs.Belt(slope=-0.2))
    >>> found[0].missing_share > found[1].missing_share
    True
    """
    several = not isinstance(reduced, Substructure)
    models = tuple(reduced) if isinstance(reduced, Sequence) else (reduced,)
    instance("full", full, Substructure)
    for model in models:
        instance("reduced", model, Substructure)
        if isinstance(model, ReducedSubstructure) and len(model.V) != full.size:
            raise InputError(f"the basis of {model.name!r} has {len(model.V)} rows, but the full model has {full.size} DOF. Give "
                             "models reduced from it")
    near, alike = positive_number("near", near), finite_number("alike", alike)
    given = contacts_of(contacts)
    if not given:
        raise InputError("self_excitation needs at least one contact, such as a Belt: without one nothing excites the motion")
    modes = complex_modes(full, given, band=band, count=count)
    values, x, grows = _upper(modes)
    limits = band
    if band is None and len(modes) < 2 * full.size:
        limits = (0.0, float(np.abs(values).max(initial=0.0)))
    if omega is None:
        top = float((values[grows] if grows.any() else values).imag.max(initial=0.0))
        many = 400 if full.size <= 150 else 40  # each needs a solve
        grid = np.linspace(0.0, positive_number("harmonics", harmonics) * (top or 1.0), many)
    else:
        grid = np.atleast_1d(real_array("omega", omega))
        if grid.ndim != 1 or grid.size == 0 or grid.min() < 0:
            raise InputError("omega must be a flat, non-empty sequence of finite frequencies, none negative")
        grid = np.unique(grid)
    reference = _compliance(full, given, grid)
    norm = np.linalg.norm(reference, axis=(1, 2))
    found = []
    for model in models:
        # modes: counterparts, their MAC, the share of energy that the basis cannot represent
        others, y, increase = _upper(complex_modes(model, given))
        mac, loss = likeness(full, model, x, y), np.full(len(values), np.nan)
        if isinstance(model, ReducedSubstructure):
            q = project(model, full.M, np.hstack([x.real, x.imag]))
            kept = np.einsum("ij,ij->j", q, model.M @ q).reshape(2, -1).sum(axis=0)
            loss = np.clip(1 - kept / np.einsum("ij,ij->j", x.conj(), full.M @ x).real, 0.0, 1.0)
        at, to = match(values, others, mac)
        fit = (np.abs(others[to] - values[at]) <= near * np.abs(values[at])) & ~(mac[at, to] < alike)
        counterpart, agreement = np.full(len(values), complex(np.nan, np.nan)), np.full(len(values), np.nan)
        counterpart[at[fit]] = others[to[fit]]
        agreement[at] = mac[at, to]
        # a growing mode that matches only a decaying mode is spurious, too
        extra = increase.copy()
        extra[to[fit & grows[at]]] = False
        if limits is not None:
            extra &= within(others, limits)
        # compliances
        h = _compliance(model, given, grid)
        error, sizes = (np.linalg.norm(part, axis=(1, 2)) for part in (h - reference, h))
        with np.errstate(divide="ignore", invalid="ignore"):
            even = np.nan_to_num(error / (norm + sizes))
        # criteria
        growing, there, spurious = values[grows], counterpart[grows], others[extra]
        missing, total, change = growing[~(there.real > 0)], float(growing.real.sum()), np.abs((there - growing).real)
        off = change / growing.real, np.abs((there - growing).imag) / np.abs(growing)
        found.append(SelfExcitation(
            growing=growing, counterpart=there, mac=agreement[grows], loss=loss[grows], spurious=spurious, missing=missing,
            missing_share=_share(len(missing), len(growing)), spurious_share=_share(spurious.real.sum(), total),
            growth_error=float(off[0][np.isfinite(off[0])].max(initial=0.0)),
            frequency_error=float(off[1][np.isfinite(off[1])].max(initial=0.0)),
            growth_distance=_share(missing.real.sum() + spurious.real.sum() + change[there.real > 0].sum(), total),
            projection_loss=_share(growing.real @ loss[grows], total),
            compliance_static=float(error[0] / norm[0]) if grid[0] == 0 else np.nan,
            compliance_max=float(error.max() / norm.max()), compliance_mean=float(even.mean()), omega=grid, band=limits))
    return tuple(found) if several else found[0]


def table_rows(full: Substructure, reduced: Sequence[Substructure], contacts: Contacts,
               measured: Sequence[Mapping[str, Any]], **options: Any) -> list[dict[str, Any]]:
    """One flat dict per reduced model: method, size, the criteria, the verdict, and the measured errors.

    `measured` contains the errors of each model by name, such as errors of frequency and amplitude of a transient or limit cycle.
    `options` are options of `self_excitation`.
    """
    if len(measured) != len(reduced):
        raise InputError(f"measured must have one entry per reduced model, {len(reduced)}, not {len(measured)}")
    found = self_excitation(full, tuple(reduced), contacts, **options)
    return [{"method": getattr(model, "method", model.name), "size": model.size, **one.flat(), "verdict": one.verdict, **errors}
            for model, one, errors in zip(reduced, found, measured, strict=True)]  # type: ignore[arg-type]


def _upper(modes: ComplexModes) -> tuple[Array, Array, Array]:
    """λ with Im λ ≥ 0 without rigid motion, by ascending Im λ; their shapes; which certainly grow, even above the cut-off."""
    keep = np.flatnonzero(listed(modes))
    keep = keep[np.argsort(modes.eigenvalues[keep].imag, kind="stable")]
    grows = np.array([modes.stable[i] is False for i in keep], dtype=bool)
    return modes.eigenvalues[keep], modes.shapes[:, keep], grows


def _compliance(model: Substructure, contacts: Sequence[Contact], grid: Array) -> Array:
    """h(iω) = WᵀP(iω)⁻¹W over the columns of all contacts, shape (m, p, p), without the contacts."""
    columns = (columns_of(model, contact) for contact in contacts)
    W = np.hstack([W.toarray() if sp.issparse(W) else W for W in columns])
    return frequency_response(model, at=grid, loads=W).receptance


def _share(part: float, whole: float) -> float:
    if np.isnan(part):
        return np.nan
    return float(part / whole) if whole > 0 else (0.0 if part == 0 else np.inf)


def _list(values: Array) -> str:
    return ", ".join(f"{value.imag:.4g}" for value in values[:4]) + ", …" * (len(values) > 4)
