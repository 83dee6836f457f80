"""Complex eigenvalue analysis (CEA): (λ²M + λD + K)x = 0 for full and reduced models, with what proves each number."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from femsub.checks import CERTIFIED, CONFIRMED, EPS, NOT_CHECKED, Array, check_band, whole_number
from femsub.errors import FemsubWarning, InputError, InputTypeError, MissedModesError
from femsub.linalg.factor import QUADRATIC, SMALL, WIDE
from femsub.linalg.threads import FEW, one_thread
from femsub.model.bands import beyond, in_band
from femsub.model.friction import Belt
from femsub.model.matrices import equilibration, scaled, unit_length
from femsub.model.pencil import Pencil
from femsub.model.substructure import Substructure

LOUD = 1e-9  # a backward error above this is warned of
CLUSTER = 1e-7  # eigenvalues closer than this, relatively, get their left vectors as a group


@dataclass(frozen=True, eq=False, repr=False)
class ComplexModes:
    """Eigenpairs of λ²M + λD + K with their certificates; k of them.

    Attributes
    ----------
    eigenvalues : ndarray of complex, shape (k,)
        By count: nearest to 0 first, both members of a pair side by side. By band: ascending in Im λ.
    shapes : ndarray of complex, shape (n, k) or (r, k)
        Right eigenvectors of unit length, in the coordinates of the model that was asked.
    backward_error : ndarray, shape (k,)
        See `Pencil.backward_error`.
    error_bar : ndarray, shape (k,)
        How far the eigenvalue may be off: |y|ᵀ(|r| + rounding in P(λ)x) / |yᴴP'(λ)x|, that is backward error times
        condition number, y from the left vectors (Tisseur 2000, Th. 5), taken entry by entry, which is free of the
        units of each DOF. Next to another eigenvalue, with which rounding may make it coalesce, the gap is added;
        infinite where the eigenvalue is defective.
    condition : ndarray, shape (k,)
        κ = (|λ|²‖M‖ + |λ|‖D‖ + ‖K‖) ‖x‖‖y‖ / (|λ| |yᴴP'(λ)x|): a relative perturbation ε of the matrices moves λ by up to
        κ ε |λ| (Tisseur 2000, Th. 5). In the units of the model as it stands, unlike `error_bar`; infinite at 0 and where
        the eigenvalue is defective.
    rigid : ndarray of bool, shape (k,)
        Eigenvalues at 0 from rigid-body modes: neither unstable nor Hopf points.
    above_cutoff : ndarray of bool, shape (k,)
        Beyond the reduction's cut-off: shown, but without a say in `is_stable`.
    searched : (re_lo, re_hi, lo, hi) or None
        The rectangle that was searched, when a band was asked: of a reduced model up to its cut-off, since what lies above
        is not the component's. Eigenvalues listed from above it are `above_cutoff`.
    evidence : str
        That none is missing: 'certified' where all eigenvalues were computed, or inertia alone counts them; 'confirmed' where
        a determinant sampled on a contour agrees with their number, its winding number around the rectangle or the count
        in a disc (see `counted`); 'not checked' otherwise.
    certified : bool
        Whether there is evidence of either kind.
    counted : (radius, number) or None
        The independent count in a disc, see `condensed.count`: so many eigenvalues lie in |λ| < radius, conjugates included,
        and all have been found. The disc holds the rectangle searched, and its unstable part.
    """

    eigenvalues: Array
    shapes: Array
    backward_error: Array
    error_bar: Array
    rigid: Array
    above_cutoff: Array
    searched: tuple[float, float, float, float] | None = None
    certified: bool = False
    counted: tuple[float, int] | None = None
    condition: Array = field(default_factory=lambda: np.zeros(0))
    evidence: str = NOT_CHECKED

    @property
    def stable(self) -> tuple[bool | None, ...]:
        """Per eigenvalue: True left of the axis, False right of it, None on it within the error bar (or rigid)."""
        return tuple(None if rigid or abs(value.real) <= bar else bool(value.real < 0)
                     for value, bar, rigid in zip(self.eigenvalues, self.error_bar, self.rigid, strict=True))

    @property
    def is_stable(self) -> bool | None:
        """False if one of these modes grows, True if all decay, None if that is undecided within the error bars.

        Rigid-body modes and modes above the cut-off do not count.
        """
        votes = [vote for vote, rigid, beyond in zip(self.stable, self.rigid, self.above_cutoff, strict=True)
                 if not rigid and not beyond]
        if False in votes:
            return False
        return True if votes and None not in votes else None

    @property
    def unstable(self) -> Array:
        """Indices of the modes that grow for certain and are below the cut-off."""
        return np.array([i for i, vote in enumerate(self.stable) if vote is False and not self.above_cutoff[i]], dtype=int)

    @property
    def frequencies(self) -> Array:
        """|Im λ| in radians per unit of time, shape (k,)."""
        return np.abs(self.eigenvalues.imag)

    @property
    def damping_ratios(self) -> Array:
        """-Re λ / |λ|, shape (k,); 0 for an eigenvalue at 0."""
        size = np.abs(self.eigenvalues)
        return np.divide(-self.eigenvalues.real, size, out=np.zeros_like(size), where=size > 0)

    @property
    def growth(self) -> float:
        """The largest Re λ among the modes that decide (-inf where none does)."""
        return float(self.eigenvalues.real[~self.rigid & ~self.above_cutoff].max(initial=-np.inf))

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        verdict = {True: "stable", False: f"unstable ({len(self.unstable)} of them grow)",
                   None: "stability undecided within the error bars"}[self.is_stable]
        worst = f"{self.backward_error.max():.0e}" if len(self) else "none"
        beyond = f", {int(self.above_cutoff.sum())} above the cut-off" if self.above_cutoff.any() else ""
        return (f"ComplexModes: {len(self)} eigenvalues{beyond}, {verdict}, largest Re λ {self.growth:.6g}; "
                f"backward error {worst}, completeness {self.evidence}")


def complex_modes(model: Substructure | Pencil, contacts: Belt | Sequence[Belt] | None = None, *,
                  count: int | None = None, band: tuple[float, float] | None = None,
                  re: tuple[float, float] | None = None, certify: bool | None = None) -> ComplexModes:
    """(λ²M + λD + K)x = 0 of a substructure with its contacts linearised, or of a bare pencil.

    Sparse models go to SLEPc's PEP (TOAR, shift-invert), and so do dense ones above 300 DOF of which a band or a count is
    asked; all others to LAPACK.

    Parameters
    ----------
    model : Substructure or Pencil
        A pencil may have any real D and K, symmetric or not.
    contacts : Belt or sequence of Belt, optional
        Each adds F μ'(v0) w wᵀ to D. Without one the model's own D is used. Not for a pencil.
    count : int, optional
        Eigenvalues nearest to 0, both conjugates listed; a pair is never split, so one more may come.
    band : (lo, hi), optional
        Every eigenvalue with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi, in radians per unit of time. Those on an edge are in, and so are
        those beyond it by less than 1e-9 of |λ|, which is room for rounding. If one of a double eigenvalue that rounding has
        split (by up to 1e-6 of |λ|) is in, so is the other (`bands.in_band`).
    re : (a, b), optional
        With `band`: a ≤ Re λ ≤ b instead.
    certify : bool, optional
        Count the eigenvalues independently. Where D is proportional except for at most 40 columns (belts, dashpots), in
        the disc around 0 that holds the band or the `count` eigenvalues: one factorisation of K - R²M, which a band
        needs anyway, and some solves (`condensed`); by default in a band, and with a `count` up to 200,000 DOF. Else, for
        a band, by the winding number of det P, some fifty complex factorisations, by default up to 2,000 DOF. LAPACK's
        results are complete without.

    Raises
    ------
    InputError, InputTypeError
        `count` and `band` together, or neither for a sparse model above 2,000 DOF; more than 2n eigenvalues.
    NotConvergedError, SingularMatrixError, MissedModesError
        The eigensolver gave up; no shift makes the pencil regular; the independent count found more.
    """
    if isinstance(model, Pencil):
        if contacts is not None:
            raise InputError("a bare pencil has no ports: put the contact into D, or use a Substructure")
        pencil, cutoff = model, np.inf
    elif isinstance(model, Substructure):
        pencil, cutoff = model.linearised(contacts), model.cutoff
    else:
        raise InputTypeError(f"complex_modes takes a Substructure or a Pencil, not {type(model).__name__}")
    if pencil.norms[0] == 0 and pencil.norms[1] == 0:
        raise InputError("M and D are both zero: there are no eigenvalues")
    if count is not None and band is not None:
        raise InputError("give count or band, not both")
    box = None if band is None else _rectangle(band, re)
    if re is not None and band is None:
        raise InputError("re=(a, b) goes with band=(lo, hi)")
    if count is not None:
        count = _check_count(count, pencil.size)
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    if pencil.is_sparse and not small and count is None and box is None and pencil.size > QUADRATIC:
        raise InputError(f"a sparse model of {pencil.size} DOF has {2 * pencil.size} eigenvalues: ask for count=20 or "
                         f"band=(lo, hi)")
    if small or (count is None and box is None) or (
            (count or 0) > pencil.size / 2 and (pencil.size <= QUADRATIC or not pencil.is_sparse)):
        from femsub.quadratic.dense import solve

        with one_thread(pencil.size <= FEW):
            values, X, Y = solve(pencil.dense())
        found = values
        _check_complete(pencil, values)
        certified, proof, evidence = True, None, CERTIFIED
    else:
        from femsub.quadratic.sparse import solve_band, solve_count

        sparse = pencil.sparse()
        alike = sparse.alike()
        if box is None:
            values, X, Y, certified, proof, found = solve_count(alike, count or 0, certify)
        else:
            values, X, Y, certified, proof, found = solve_band(alike, box, certify)
        everything = found is values  # LAPACK had to take over
        evidence = proof.evidence if proof is not None else CERTIFIED if everything else CONFIRMED if certified else NOT_CHECKED
        if alike is not sparse:
            X, Y = (unit_length(unit[:, None] * vectors) for unit, vectors in zip(sparse.units[::-1], (X, Y), strict=True))
    if box is not None:
        keep = in_band(values, box[2:], box[:2])
        order = np.flatnonzero(keep)[np.argsort(values[keep].imag, kind="stable")]
    else:
        order = _nearest(values, count)
    # Row by row in memory: a sparse product copies anything else into that order first, each time.
    X, Y = (np.ascontiguousarray(vectors[:, order]) for vectors in (X, Y))
    result = certificates(pencil, values[order], X, Y, found)
    if result.backward_error.max(initial=0.0) > LOUD:
        warnings.warn(f"a complex mode has a backward error of {result.backward_error.max():.1e} (λ = "
                      f"{result.eigenvalues[result.backward_error.argmax()]:.5g}); ask for fewer, or scale the matrices",
                      FemsubWarning, stacklevel=2)
    box = None if box is None else (*box[:3], min(box[3], cutoff))
    counted = None if proof is None else (proof.radius, proof.number)
    return replace(result, above_cutoff=beyond(result.frequencies, cutoff), searched=box, certified=certified, counted=counted,
                   evidence=evidence)


def certificates(pencil: Pencil, values: Array, X: Array, Y: Array, found: Array | None = None) -> ComplexModes:
    """Residuals, backward errors and error bars of eigenpairs with their left vectors.

    `found` are all that are known, the neighbours outside of a band or beyond a count among them: by default `values`.
    Where each complex one is followed by its conjugate, as by count, only one of the two is worked out.
    """
    gaps = _gaps(values, values if found is None else found)
    first = np.flatnonzero(values.imag > 0)
    paired = len(first) > 0 and len(first) == np.count_nonzero(values.imag < 0) and first[-1] + 1 < len(values) \
        and np.array_equal(values[first + 1], values[first].conj()) and np.array_equal(X[:, first + 1], X[:, first].conj())
    if paired and bool((values.imag[first] > CLUSTER * np.abs(values[first])).all()):
        half = np.flatnonzero(values.imag >= 0)
        double = np.sort(np.append(np.arange(len(half)), np.flatnonzero(values.imag[half])))
        regular = len(values) == 2 * len(half)  # then a view of the left vectors, which no product needs in one piece, will do
        both = _certified(pencil, values[half], X[:, half], Y[:, ::2] if regular else Y[:, half], gaps[half])
        return replace(both, eigenvalues=values, shapes=X,
                       **{name: getattr(both, name)[double] for name in ("backward_error", "error_bar", "rigid", "above_cutoff",
                                                                          "condition")})
    return _certified(pencil, values, X, Y, gaps)


def _certified(pencil: Pencil, values: Array, X: Array, Y: Array, gap: Array) -> ComplexModes:
    # |y|ᵀ|r| and not ‖y‖‖r‖: DOF of mixed units (displacements next to rotations) then leave the bar as it is.
    inertia = (pencil.M @ X) * values
    rest = inertia + pencil.D @ X
    residual = rest * values + pencil.K @ X
    slope = inertia + rest  # P'(λ)x = 2λMx + Dx
    doubt = np.abs(residual) + 4 * EPS * pencil.magnitude(values, X)
    sensitivity = np.abs(np.einsum("ij,ij->j", Y.conj(), slope))
    size = np.abs(Y)
    spread, length = np.einsum("ij,ij->j", size, doubt), np.sqrt(np.einsum("ij,ij->j", size, size))
    for group in _clusters(values):
        # In a group of equal eigenvalues any combination of vectors is as good: take the dual left ones.
        gram = Y[:, group].conj().T @ slope[:, group]
        # in no units: unit lengths, where DOF differ in theirs, are of no account
        if np.linalg.cond(scaled(gram, *equilibration(gram))) < 1 / np.sqrt(EPS):
            dual = Y[:, group] @ np.linalg.inv(gram).conj().T
            # Rounding mixes them, too: each moves by no more than the sum of its row (Gershgorin).
            spread[group] = (np.abs(dual).T @ doubt[:, group]).sum(axis=1)
            length[group] = np.linalg.norm(dual, axis=0)
            sensitivity[group] = 1.0
        else:
            sensitivity[group] = 0.0
    bar = np.divide(spread, sensitivity, out=np.full(len(values), np.inf), where=sensitivity > 0)
    # A neighbour at the distance g: d (g - d) = b g is what the first order b = d leaves of d. Where b is no longer small
    # next to g, the two may coalesce, and the first order says nothing further.
    close = bar > gap / 8
    share = np.divide(bar, gap, out=np.zeros_like(bar), where=~close & (gap > 0))
    bar = np.where(close, bar + gap, 2 * bar / (1 + np.sqrt(1 - 4 * share)))
    rigid = values == 0
    bar[rigid] = 0.0
    none = np.zeros(len(values), dtype=bool)
    size = np.abs(values)
    scale = size**2 * pencil.norms[0] + size * pencil.norms[1] + pencil.norms[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(sensitivity * size > 0, scale * np.linalg.norm(X, axis=0) * length / (sensitivity * size), np.inf)
    return ComplexModes(values, X, pencil.backward_error(values, X, residual), bar, rigid, none, condition=condition)


def _rectangle(band: Any, re: Any) -> tuple[float, float, float, float]:
    lo, hi = check_band(band)
    if re is None:
        return -hi, hi, lo, hi
    try:
        a, b = (float(edge) for edge in re)
    except (TypeError, ValueError):
        raise InputError(f"re must be a pair (a, b), not {re!r}") from None
    if not (np.isfinite(a) and np.isfinite(b) and a < b):
        raise InputError(f"re must satisfy a < b, both finite, but is ({a!r}, {b!r})")
    return a, b, lo, hi


def _check_complete(pencil: Pencil, values: Array) -> None:
    """2n eigenvalues; fewer only if M is singular, so that some are infinite."""
    if len(values) == 2 * pencil.size:
        return
    M = pencil.M.toarray() if pencil.is_sparse else pencil.M
    size = np.sqrt(np.abs(M.diagonal()))
    if (size > 0).all() and len(values) < 2 * pencil.size and np.linalg.cond(M / np.outer(size, size)) > 1e12:
        return
    if (size > 0).all() or len(values) > 2 * pencil.size:
        raise MissedModesError(f"{len(values)} eigenvalues were found, but M is regular, so that there are {2 * pencil.size}")


def _check_count(count: Any, size: int) -> int:
    count = whole_number("count", count)
    if not 1 <= count <= 2 * size:
        raise InputError(f"count must be between 1 and {2 * size}, the number of eigenvalues of {size} DOF, not {count}")
    return count


def _nearest(values: Array, count: int | None) -> Array:
    """Indices by |λ|, conjugates side by side with Im λ > 0 first; at least `count`, a pair never split."""
    with np.errstate(divide="ignore"):
        size = np.round(np.log(np.abs(values)), 13)  # equal up to rounding of each |λ|, however large others are
    order = np.lexsort((-values.imag, values.real, size))
    ordered, taken = values[order], np.zeros(len(values), dtype=bool)
    result: list[int] = []
    for i in range(len(order)):
        if taken[i]:
            continue
        if count is not None and len(result) >= count:
            break
        taken[i] = True
        result.append(int(order[i]))
        if ordered[i].imag != 0:
            ahead = np.flatnonzero(~taken & (ordered == ordered[i].conj()))
            if len(ahead):
                taken[ahead[0]] = True
                result.append(int(order[ahead[0]]))
    return np.array(result, dtype=int)


def _gaps(values: Array, found: Array) -> Array:
    """The distance of each eigenvalue to the nearest other one of those found, its own conjugate included; inf without one."""
    if len(values) == 0:
        return np.zeros(0)
    from scipy.spatial import cKDTree

    upper, lower = found[found.imag >= 0], found[found.imag < 0].conj()
    upper = np.append(upper, lower[~np.isin(lower, upper)])  # of a pair one or both may be listed
    every = np.append(upper, upper[upper.imag > 0].conj())
    points, asked = (np.stack([part.real, part.imag], axis=1) for part in (every, values))
    return np.asarray(cKDTree(points).query(asked, k=2)[0][:, 1])


def _clusters(values: Array) -> list[Array]:
    if len(values) == 0:
        return []
    order = np.lexsort((values.real, values.imag))
    close = np.abs(np.diff(values[order])) <= CLUSTER * np.abs(values[order][1:])
    groups = np.split(order, np.flatnonzero(~close) + 1)
    return [group for group in groups if len(group) > 1]
