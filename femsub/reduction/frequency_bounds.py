"""`frequency_bounds`: how far the frequencies of a Craig-Bampton model may lie below those listed, proved from small matrices.

With A = L⁻¹ML⁻ᵀ, K = LLᵀ, the 1/ω² of the full model are the eigenvalues of A. The shapes that are kept and the modes that are
left out are orthogonal in K. On the modes left out, A ≤ σ = Σ_s 1/ω_c,s² for the cut-offs ω_c,s of the steps of reduction s. The
coupling of the reduced model's modes to them is bounded by the inertia of each part that its own modes cannot represent:

    RᵀR ≤ G,  G_ij = Σ_p v_ip·v_jp / (ω_c,p² ω_i ω_j),  v_ip·v_jp = q_ipᵀ (M_oo - M_oφ M_φo) q_jp,

q_p the coordinates of the part p besides those of its fixed-interface modes φ. So no solve with the full model is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Tally, instance, whole_number
from femsub.coupling import System, rows_of_parts
from femsub.errors import InputError
from femsub.model import ReducedSubstructure, Substructure
from femsub.modes import NormalModes, ShiftInvert, lowest_modes, modes_below
from femsub.reduction.craig_bampton import CraigBampton

HELD = ("constraint", "rigid", CraigBampton.mode_kind, "static port")  # kinds of coordinates of models with a held interface
BESIDE = 20  # more modes of the reduced model than are asked for: what lies above them bounds what they may be mixed with
REACH = 1.5  # times the highest frequency asked for; modes up to there make the bounds nearly as sharp as all would


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
        The frequencies listed, and their number in the full model as the bounds prove it: the next one is higher than these.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.frequency_bounds(fs.reduce(fs.chain(100), fs.CraigBampton(modes=20)), count=3)
    FrequencyBounds: 3 elastic frequencies, ω 0.01563 to 0.078129 rad/time, too high by at most 1.5e-06, certified
    """

    upper: Array
    lower: Array
    rigid: int
    tally: Tally

    @property
    def error(self) -> Array:
        """1 - lower/upper, shape (k,): no frequency listed is too high by more than this share of itself."""
        return 1 - self.lower / self.upper

    @property
    def evidence(self) -> str:
        """'certified' if the bounds prove that no frequency is missing among those listed; see `femsub.checks`."""
        return self.tally.evidence

    def __repr__(self) -> str:
        span = f", ω {self.upper[0]:.5g} to {self.upper[-1]:.5g} rad/time" if len(self.upper) else ""
        return (f"FrequencyBounds: {len(self.upper)} elastic frequencies{span}, too high by at most "
                f"{self.error.max(initial=0.0):.1e}, {self.evidence}")


def frequency_bounds(model: Substructure, count: int) -> FrequencyBounds:
    """Bounds of the undamped frequencies of a full model, from its Craig-Bampton model alone.

    With ω_i of the reduced model, θ_i = 1/ω_i², the cut-offs ω_c of its parts and G of the module's text, for each mode i

        1/ω_i,full² ≤ λ_i(Θ + G/(θ_i - ν)),   ν = θ_next + 1/ω_c²,   and   1/ω_i,full² ≤ θ_i + 1/ω_c²,

    λ_i the i-th largest eigenvalue. The smaller of the two holds. ω_i is never too low (minimax). In words: the error is at most
    about (ω/ω_c)² times the share of the kinetic energy that the modes of the parts cannot represent.

    The full model is the one that the parts were reduced from. D plays no part. Rounding is not in the bounds.

    Parameters
    ----------
    model : ReducedSubstructure, or System
        By `CraigBampton` or `Hurty`; of a system each part that is reduced. The cut-offs are those that the reduction has
        counted.
    count : int
        Number of elastic frequencies, from the lowest.

    Returns
    -------
    FrequencyBounds

    Raises
    ------
    InputError
        A part was reduced by another method, whose modes left out are not orthogonal to its shapes; a spring acts on the inside
        of a reduced part; more frequencies than the model has.

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
    modes = lowest_of(model, count)
    elastic = modes.shapes[:, modes.rigid:]
    truncations = [Truncation.of(part, q) for part, q in _reduced_parts(model, elastic)]
    return enclosed(modes, model.size, truncations, [min((one.cutoff for one in truncations), default=np.inf)], count)


def lowest_of(model: Substructure, count: int) -> NormalModes:
    """The modes of a reduced model for the bounds of `count` frequencies: some more, and all up to REACH times the highest."""
    handle = ShiftInvert(model.K, model.M, carried=model.rigid_motion)
    modes = lowest_modes(handle, min(2 * count + BESIDE, handle.elastic))
    if len(modes.eigenvalues) - modes.rigid < count:
        raise InputError(f"count={count} frequencies were asked for, but {model.name!r} has "
                         f"{len(modes.eigenvalues) - modes.rigid}")
    reach = REACH * float(modes.frequencies[modes.rigid + count - 1])
    more = len(modes.eigenvalues) < modes.rigid + handle.elastic and modes.frequencies[-1] < reach
    return modes_below(model.K, model.M, reach, handle) if more else modes


@dataclass(frozen=True, eq=False)
class Truncation:
    """What the modes of one part that were left out may do to k modes of the whole.

    Attributes
    ----------
    cutoff : float
        None of them lies below.
    inertia : ndarray, shape (k, k)
        (v_i·v_j): the inertia that the modes of the part cannot represent.
    """

    cutoff: float
    inertia: Array

    @classmethod
    def of(cls, part: ReducedSubstructure, q: Array) -> Truncation:
        """Of the part in the motions q (r, k)."""
        if strange := set(part.kinds) - set(HELD):
            raise InputError(f"{part.name!r} ({part.method}) has coordinates of the kind {min(strange)!r}. Bounds are known for "
                             "parts by CraigBampton and Hurty only: their shapes share no stiffness with the modes left out")
        mode = np.array([kind == CraigBampton.mode_kind for kind in part.kinds])
        M = part.M.toarray() if sp.issparse(part.M) else part.M
        o = q[~mode]
        seen = M[np.ix_(mode, ~mode)] @ o
        return cls(float(part.cutoff), o.T @ (M[np.ix_(~mode, ~mode)] @ o) - seen.T @ seen)


def enclosed(modes: NormalModes, size: int, truncations: Sequence[Truncation], steps: Sequence[float],
             count: int) -> FrequencyBounds:
    """The bounds of `count` frequencies of a model of `size` coordinates from its lowest modes; see `frequency_bounds`.

    `steps` are the cut-offs of the steps of reduction, one after the other: that of a step is the lowest of its parts.
    """
    import scipy.linalg as la

    omega = modes.frequencies[modes.rigid:]
    theta, sigma = omega**-2.0, float(sum(step**-2.0 for step in steps))
    G = sum((one.inertia / one.cutoff**2 for one in truncations), np.zeros((len(omega),) * 2)) / np.outer(omega, omega)
    G = (G + G.T) / 2
    used, above = len(omega), sigma
    if modes.rigid + used < size:
        used, above = used - 1, float(theta[-1]) + sigma  # the last one stands for all that follow
    worst = theta + sigma
    for i in np.flatnonzero(theta[:min(used, count + 1)] > above):
        mixed = np.diag(theta[:used]) + G[:used, :used] / (theta[i] - above)
        place = [used - 1 - i] * 2
        worst[i] = min(worst[i], float(la.eigvalsh(mixed, subset_by_index=place, check_finite=False)[0]))
    lower = np.minimum(worst**-0.5, omega)
    beyond = float(lower[count]) if len(lower) > count else np.inf if modes.rigid + len(omega) == size and not sigma else 0.0
    proved = int(np.count_nonzero(omega[:count] < beyond))
    return FrequencyBounds(omega[:count], lower[:count], modes.rigid, Tally(count, proved if proved == count else None))


def _reduced_parts(model: Substructure, q: Array) -> Iterator[tuple[ReducedSubstructure, Array]]:
    """Each reduced part with its coordinates in the motions q (n, k)."""
    if isinstance(model, ReducedSubstructure):
        yield model, q
    if isinstance(model, System):
        _check_springs(model)
        for part, rows in zip(model.parts.values(), rows_of_parts(model.parts), strict=True):
            yield from _reduced_parts(part, model.L[rows] @ q)


def _check_springs(system: System) -> None:
    """Springs may act on interfaces: inside a reduced part they would couple its shapes with the modes left out."""
    for joint in system.joints:
        for name, motion in joint.link(system.parts).motions.items():
            part = system.parts[name]
            inside = [at for at, kind in enumerate(getattr(part, "kinds", ())) if kind not in ("constraint", "rigid")]
            if len(inside) and abs(motion)[:, inside].max():
                raise InputError(f"{joint!r} acts on the inside of the reduced part {name!r}, for which no bound is known. Put "
                                 "the DOF that it acts on into the part's interface")
