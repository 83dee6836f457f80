"""`frequency_bounds`: proved lower bounds of the full model's frequencies, from the small matrices of its Craig-Bampton model.

With A = L⁻¹ML⁻ᵀ, K = LLᵀ, the 1/ω² of the full model are the eigenvalues of A. The space of the reduced model and the spaces that
each step of reduction leaves out are orthogonal in K. On the spaces left out, A ≤ σ. For one part and one step, σ = 1/ω_c² with
the cut-off ω_c. For several parts σ is the largest value, and for several steps the sum. With Θ = diag(1/ω²) of the reduced model
and R, the coupling of its modes with the spaces left out,

    A = [[Θ, Rᵀ], [R, A_l]] ≤ [[Θ, Rᵀ], [R, σ]],   RᵀR ≤ G   give   λ_i(A) ≤ max(σ, λ_i([[Θ, G^½], [G^½, σ]])).

G is a sum over parts and steps. Each term is 1/ω_c² times the inertia that the exact fixed-interface modes φ of the step cannot
represent, q_oᵀ (M_oo - M_oφ M_φφ⁻¹ M_φo) q_o. The exact modes follow from the matrices: they are the modes, up to the cut-off, of
all coordinates that leave the interface at rest. So these coordinates may be scaled and mixed. The full model is not needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, POSITION, Array, InputError, Tally, instance, whole_number
from femsub.coupling import System, rows_of_parts
from femsub.model import Origin, ReducedSubstructure, Substructure
from femsub.modes import ShiftInvert, lowest_modes, modes_below

HELD = ("constraint", "rigid", "fixed-interface", "static port")  # kinds of coordinates of models with a held interface


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyBounds:
    """Each elastic frequency ω of the undamped full model lies between two numbers: lower ≤ ω ≤ upper. See `frequency_bounds`.

    Attributes
    ----------
    upper, lower : ndarray, shape (k,)
        In radians per unit of time; `upper` are the frequencies of the reduced model.
    rigid : int
        Rigid-body modes, which are exact.
    tally : Tally
        The number of frequencies listed, and that of the full model, if the bounds prove that its next frequency is higher.
    full : str
        In words, the model whose frequencies lie between the bounds, and the assumptions about parts of unknown origin.

    Examples
    --------
    >>> import femsub as fs
    >>> bounds = fs.frequency_bounds(fs.reduce(fs.chain(100), fs.CraigBampton(modes=20)), count=3)
    >>> bounds.full, bool(bounds.error.max() < 2e-6), bounds.evidence
    ("'chain' before reduction (100 DOF)", True, 'certified')
    """

    upper: Array
    lower: Array
    rigid: int
    tally: Tally
    full: str

    @property
    def error(self) -> Array:
        """1 - lower/upper, shape (k,): the largest possible relative error of each listed frequency."""
        return 1 - self.lower / self.upper

    @property
    def evidence(self) -> str:
        """'certified' if the bounds prove that no frequency is missing among those listed; see `femsub.checks`."""
        return self.tally.evidence

    def __repr__(self) -> str:
        span = f", ω {self.upper[0]:.5g} to {self.upper[-1]:.5g} rad/time" if len(self.upper) else ""
        return (f"FrequencyBounds of {self.full}: {len(self.upper)} elastic frequencies{span}, too high by at most "
                f"{self.error.max(initial=0.0):.1e}, {self.evidence}")


def frequency_bounds(model: Substructure, count: int) -> FrequencyBounds:
    """Bounds of the undamped frequencies of a full model, from its Craig-Bampton model alone.

    With ω_i of the reduced model, θ_i = 1/ω_i², and σ and G as in the text of this module, each mode i has

        1/ω_i,full² ≤ λ_i([[Θ, G^½], [G^½, ν]]),   ν = θ_next + σ,   and   1/ω_i,full² ≤ θ_i + σ,

    λ_i the i-th largest eigenvalue, or ν if that is larger, and θ_next the largest θ of the modes that are not in Θ. The smaller
    of the two bounds is used. ω_i is never too low (minimax). In words: the error is at most about (ω/ω_c)² times the share of
    the kinetic energy that the modes of the parts cannot represent.

    The full model is the model before all reductions. The bounds include every reduction, also if a reduced system was reduced
    again. ``.full`` names the full model in words. For a superelement, or a model made by hand, femsub does not know which modes
    were left out. ``.full`` then states the assumptions: the cut-off is right, and there was one step of reduction. For a model
    that is not reduced, such as matrices of a superelement read as plain matrices, the bounds are those of its own frequencies.

    D has no influence. The bounds do not include rounding.

    Parameters
    ----------
    model : ReducedSubstructure, or System
        Reduced by `CraigBampton` or `Hurty` in one or several steps; in a system, this holds for each reduced part. The cut-offs
        are those that the reduction has counted. Coordinates with the interface at rest may be scaled and mixed.
    count : int
        Number of elastic frequencies, from the lowest.

    Returns
    -------
    FrequencyBounds

    Raises
    ------
    InputError
        A step of reduction used another method, whose shapes are not orthogonal to the modes left out; K couples constraint modes
        with fixed-interface modes of a part; a spring acts on the inside of a reduced part; `count` exceeds the number of
        frequencies of the model.

    References
    ----------
    K. Elssel, H. Voss, SIAM J. Matrix Anal. Appl. 28 (2006) 386, theorem 3.2, is the second bound, for one step of reduction.

    Examples
    --------
    >>> import femsub as fs
    >>> rom = fs.reduce(fs.chain(100), fs.CraigBampton(modes=20))
    >>> bounds = fs.frequency_bounds(rom, count=5)
    >>> full = fs.chain_frequencies(100)[:5]
    >>> bool((bounds.lower <= full).all() and (full <= bounds.upper * (1 + 1e-9)).all()), bounds.evidence
    (True, 'certified')
    """
    instance("model", model, Substructure, "made by reduce or couple")
    count = whole_number("count", count, least=1)
    handle = ShiftInvert(model.K, model.M, carried=model.rigid_motion)
    # more modes than requested: θ_next becomes smaller, and the bounds become sharper
    modes = lowest_modes(handle, min(2 * count + 20, handle.elastic))
    if len(modes.eigenvalues) - modes.rigid < count:
        raise InputError(f"count={count} frequencies were asked for, but {model.name!r} has "
                         f"{len(modes.eigenvalues) - modes.rigid}")
    # modes up to here make the bounds nearly as sharp as all would
    reach = 1.5 * float(modes.frequencies[modes.rigid + count - 1])
    if len(modes.eigenvalues) < modes.rigid + handle.elastic and modes.frequencies[-1] < reach:
        modes = modes_below(model.K, model.M, reach, handle)
    omega = modes.elastic
    found = left_out(model, modes.shapes[:, modes.rigid:] / omega)
    worst = _worst(omega**-2.0, found, count + 1, len(omega) == handle.elastic)
    with np.errstate(divide="ignore"):
        beyond = worst[count] ** -0.5
    lower = np.minimum(worst[:count] ** -0.5, omega[:count])
    proved = int(np.count_nonzero(omega[:count] < beyond))
    tally = Tally(count, proved if proved == count else None, sampled=bool(found.premises))  # a premise is not counted
    # whose frequencies are bounded
    full = f"{model.name!r} before reduction ({found.dofs} DOF)"
    if found.premises:
        first, *others = found.premises
        more = f", and {len(others)} more part{'s' * (len(others) > 1)} likewise" if others else ""
        full = f"{model.name!r} before reduction, if {first}{more}"
    elif not model.is_reduced:
        full = f"{model.name!r} itself, whose {model.size} coordinates count as a full model"
    return FrequencyBounds(omega[:count], lower, modes.rigid, tally, full)


def left_out(model: Substructure, q: Array) -> Origin:
    """σ of all reductions of a model, and the coupling G (k, k) of the motions q (r, k) with the spaces left out.

    Raises
    ------
    InputError
        See `frequency_bounds`.
    """
    none = np.zeros((q.shape[1],) * 2)
    if not model.is_reduced:
        return Origin(len(none), model.size, np.inf, coupling=none)
    if isinstance(model, System):
        for joint in model.joints:  # springs inside a reduced part would couple its shapes with the modes left out
            for name, motion in joint.link(model.parts).motions.items():
                inside = [at for at, kind in enumerate(getattr(model.parts[name], "kinds", ()))
                          if kind not in ("constraint", "rigid")]
                if len(inside) and abs(motion)[:, inside].sum():
                    raise InputError(f"{joint!r} acts on the inside of the reduced part {name!r}, for which no bound is known. "
                                     "Put the DOF that it acts on into the part's interface")
        parts = [left_out(part, model.L[rows] @ q if part.is_reduced else q)
                 for part, rows in zip(model.parts.values(), rows_of_parts(model.parts), strict=True)]
        joined = model.L.shape[0] - model.L.shape[1]
        return Origin(len(none), sum(part.dofs for part in parts) - joined, np.inf, max(part.left_out for part in parts),
                      sum((part.coupling for part in parts if part.coupling is not None), none),
                      premises=tuple(one for part in parts for one in part.premises))
    assert isinstance(model, ReducedSubstructure)
    origin, cutoff = model.origin, model.cutoff
    if origin is None:
        limit = f"kept all its fixed-interface modes below {cutoff:.5g} rad/time" if np.isfinite(cutoff) else "lost nothing"
        origin = Origin(model.size, len(model.V), cutoff, premises=(f"{model.name!r} {limit}, in one step",))
    if origin.unbounded:
        raise InputError(f"{model.name!r} was reduced in several steps, and no bound is known for an earlier step: "
                         f"{origin.unbounded}")
    last = origin.cutoff if origin.left_out else cutoff
    G = _coupling(model, q, last)
    return Origin(len(none), origin.dofs, np.inf, last**-2.0 + origin.left_out,
                  G if origin.coupling is None else G + q.T @ origin.coupling @ q, premises=origin.premises)


def origin_of(sub: Substructure, V: Array, cutoff: float) -> Origin:
    """The origin of a model with the basis V (n, r) of a component, which may be reduced itself. `cutoff` is of this step."""
    try:
        before = left_out(sub, V)
    except InputError as error:
        return Origin(V.shape[1], len(V), cutoff, unbounded=str(error))
    return replace(before, cutoff=cutoff, coupling=before.coupling if before.left_out else None)


def _coupling(part: ReducedSubstructure, q: Array, cutoff: float) -> Array:
    """An upper bound G of RᵀR, R the coupling of motions q (r, k) of a part with the modes that its last reduction left out.

    With the interface at rest, K and M of the part have modes ξ, ξᵀKξ = 1, ξᵀMξ = θ. Modes with θ ≥ σ = 1/ω_c² are exact: M does
    not couple them with any shape z left out, zᵀKz = 1. M couples the other modes with z, but (zᵀMξ)² ≤ σ min(θ, σ - θ), since
    M ≤ σK in this space and zᵀKξ = 0.
    """
    import scipy.linalg as la

    if strange := set(part.kinds) - set(HELD):
        raise InputError(f"{part.name!r} ({part.method}) has coordinates of the kind {min(strange)!r}. Bounds are known only for "
                         "parts by CraigBampton and Hurty: K does not couple their shapes with the modes left out")
    if not cutoff * cutoff > np.finfo(float).tiny:
        raise InputError(f"the cut-off of {part.name!r} must be positive, and its square must not be 0, but it is {cutoff}")
    sigma = cutoff**-2.0
    if not sigma:
        return np.zeros((q.shape[1],) * 2)
    inner = np.array([kind not in ("constraint", "rigid") for kind in part.kinds], dtype=bool)
    M, K = (A.toarray() if sp.issparse(A) else A for A in (part.M, part.K))
    unit = np.sqrt(np.abs(K.diagonal()))
    # a model may come from a file that prints no more digits than mesh files do
    shared = np.abs(K[np.ix_(inner, ~inner)]) > POSITION * np.outer(unit[inner], unit[~inner])
    if shared.any():
        raise InputError(f"{part.name!r}: {int(shared.any(axis=1).sum())} coordinates that leave the interface at rest share "
                         "stiffness with its constraint modes. Bounds are known only without this coupling")
    try:
        theta, X = la.eigh(M[np.ix_(inner, inner)], K[np.ix_(inner, inner)], check_finite=False)
    except la.LinAlgError:
        raise InputError(f"{part.name!r}: K of the coordinates that leave the interface at rest is not positive definite, so "
                         "that these are no fixed-interface modes") from None
    exact, far = theta >= sigma, theta < sigma / 2
    near = ~exact & ~far
    shares = X.T @ (K[np.ix_(inner, inner)] @ q[inner])
    rest = q.copy()
    rest[inner] = X[:, far] @ shares[far]
    inertia = M @ rest
    seen = X[:, exact].T @ inertia[inner]
    G = rest.T @ inertia - (seen.T / theta[exact]) @ seen
    beside = (shares[near].T * (sigma - theta[near])) @ shares[near]
    size = float(np.trace(G)), float(np.trace(beside))
    if min(size) > 0:  # (a + b)² ≤ (1 + t) a² + (1 + 1/t) b²
        t = np.sqrt(size[1] / size[0])
        G, beside = G * (1 + t), beside * (1 + 1 / t)
    G = sigma * (G + beside)
    return np.asarray((G + G.T) / 2)


def _worst(theta: Array, found: Origin, count: int, complete: bool) -> Array:
    """Upper bounds of the `count` largest 1/ω² of the full model. `theta` are 1/ω² of the reduced model, all or the largest.

    Beside a mode that is softer by eight digits, the bounds of the other modes would lose these digits. The soft mode is left out
    for the other bounds: the i-th largest eigenvalue of a matrix is at most the (i - 1)-th of a submatrix with one row less.
    """
    assert found.coupling is not None
    used, above = len(theta), found.left_out
    if not complete:
        used, above = used - 1, float(theta[-1]) + found.left_out  # the last one stands for all that follow
    worst = np.full(count, above)
    start = 0
    while start < min(used, count):
        kept = slice(start, used)
        values, P = np.linalg.eigh(found.coupling[kept, kept])
        values = np.maximum(values, 0.0) + EPS * np.abs(values).sum()
        C = P * np.sqrt(values)
        mixed = np.block([[np.diag(theta[kept]), C], [C.T, above * np.eye(used - start)]])
        largest = np.linalg.eigvalsh(mixed)[::-1]
        end = start + int(np.count_nonzero(theta[kept] >= np.sqrt(EPS) * theta[start]))
        some = slice(start, min(end, count))
        worst[some] = np.maximum(largest[:some.stop - start], above)
        start = end
    least = np.append(theta, np.full(count, 0.0 if complete else theta[-1]))[:count] + found.left_out
    return np.asarray(np.minimum(worst, least))
