"""From element matrices to a `Substructure`: summation into CSR chunk by chunk, removal of held DOF."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import (
    EPS,
    Array,
    ConditionWarning,
    InputError,
    InputTypeError,
    Matrix,
    finite_number,
    mapping,
    real_array,
    warn,
)
from femsub.components.solid_assembly import Pattern
from femsub.model import Substructure, Supported

if TYPE_CHECKING:
    from femsub.model import DofMap

CHUNK = 1 << 25  # bytes of element matrices held at a time
LOSS = 2.0**-46  # entries are rounded by at most this share of sqrt(K_ii K_jj); more would give rotations an energy


def optional_mapping(name: str, value: Any, of: str) -> Mapping[Any, Any]:
    """The mapping of an optional argument; empty for None."""
    return {} if value is None else mapping(name, value, of)


def per_part(name: str, value: Any, count: int, part: str, zero: bool = False) -> Array:
    """One positive number (or 0, with `zero`) per element or mass, shape (count,), from a single number or one per part."""
    try:
        values = np.broadcast_to(real_array(name, value, finite=False), (count,))
    except ValueError:
        raise InputError(f"{name} must be one number or {count} of them, one per {part}, not {value!r:.80}") from None
    good = np.isfinite(values) & ((values >= 0) if zero else (values > 0))
    if not good.all():
        raise InputError(f"{name} must be {'zero or more' if zero else 'positive'} and finite, but is "
                         f"{values[np.argmin(good)]:.6g}" + (f" in {part} {np.argmin(good) + 1}" if np.ndim(value) else ""))
    return values


def node_at(points: Array, numbers: Array, place: Any, what: str, within: float) -> int:
    """The row of `points` (n, d) that is at a place. `numbers` are the nodes' numbers, for messages."""
    apart = np.linalg.norm(points - place, axis=1)
    nearest = int(apart.argmin())
    if apart[nearest] > within:
        there, here = (f"x = {x[0]:.9g}" if len(x) == 1 else f"({', '.join(f'{value:.9g}' for value in x)})"
                       for x in (place, points[nearest]))
        raise InputError(f"{what}: there is no node at {there}. The nearest is number {numbers[nearest]} at {here}")
    return nearest


def not_negative(name: str, value: Any) -> float:
    """A finite number that is zero or more."""
    number = finite_number(name, value)
    if number < 0:
        raise InputError(f"{name} must not be negative, but is {number:.6g}. Only a contact may supply energy")
    return number


def pair(name: str, value: Any, what: str) -> tuple[Any, Any]:
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or getattr(value, "shape", "?") == () \
            or len(value) != 2:
        raise InputTypeError(f"{name} must be a pair {what}, not {value!r:.80}")
    return value[0], value[1]


def rayleigh_factors(rayleigh: tuple[float, float]) -> tuple[float, float]:
    """(α, β), checked."""
    alpha, beta = pair("rayleigh", rayleigh, "(alpha, beta)")
    return not_negative("alpha of rayleigh", alpha), not_negative("beta of rayleigh", beta)


def proportional(sub: Substructure, rayleigh: tuple[float, float]) -> Matrix:
    """αM + βK for the pair `rayleigh` = (α, β)."""
    alpha, beta = rayleigh_factors(rayleigh)
    return alpha * sub.M + beta * sub.K


def gathered(dofs: Array, size: int, matrices: Callable[[slice], tuple[Array, ...]]) -> tuple[Matrix, ...]:
    """The assembled matrices Σ_e A_e, as K and M, in CSR (size, size).

    `matrices` returns the element matrices, as (K_e, M_e), for a slice of the elements. `dofs` (m, k) are the DOF of each
    element. The results are exactly symmetric.
    """
    pattern, step = Pattern(dofs, size), max(1, CHUNK // (8 * dofs.shape[1] ** 2))
    total: list[Array] = []
    for start in range(0, len(dofs), step):
        part = slice(start, start + step)
        keep, places, add = pattern.places(part)
        found = matrices(part)
        total = total or [np.zeros(pattern.size) for _ in found]
        for sums, values in zip(total, found, strict=True):
            sums[places] += add @ values.ravel()[keep]
    return tuple(map(pattern.scalar, total))


def free_to_lift(K: Matrix, lift: Array) -> Matrix:
    """K with Σ_j K_ij = 0 exactly over the deflection DOF (marked by `lift`): translation has exactly zero energy.

    K is the symmetric matrix of a free part in bending; for a translation its forces vanish up to rounding. Rounding acts like
    a spring of EPS · K_ii under each deflection, a relative change EPS · n⁴ of the lowest ω² of n elements in a row. Here
    the entries of a row are rounded to multiples of one power of two, so that their sum is exact, and the largest entry
    is set to minus the sum of the others. Then rounding changes only the energy of relative motion, by a share EPS · n². Entries
    that would lose more than LOSS, between elements of very different length, are not changed, so their row keeps its rounding.
    """
    K = K.copy()
    K.sort_indices()
    rows, columns = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr)), K.indices
    place = np.flatnonzero(lift[columns])
    i, j, values = rows[place], columns[place], K.data[place]
    finest = np.frexp(np.bincount(i, np.abs(values), K.shape[0]))[1] - 52
    finest = np.where(lift[i], np.maximum(finest[i], finest[j]), finest[i])
    rounded = np.ldexp(np.rint(np.ldexp(values, -finest)), finest)
    unit = np.sqrt(K.diagonal())
    coarse = np.ldexp(1.0, finest) > LOSS * unit[i] * unit[j]
    rounded = np.where(coarse, values, rounded)
    order = np.lexsort((np.where(i == j, np.inf, np.abs(values)), i))
    last = order[np.flatnonzero(np.diff(i[order], append=-1))]
    rounded[last] = 0.0
    rounded[last] = -np.bincount(i, rounded, K.shape[0])[i[last]]
    K.data[place] = rounded
    mirrored = lift[rows] & ~lift[columns]
    K.data[mirrored] = K.T.tocsr().data[mirrored]  # the structure is symmetric
    return K


def warn_of_rounding(K: Matrix, lift: Array, whole: float, name: str, advice: str, *, growth: float, limit: float = 1e-6) -> None:
    """Warn if rounding in solves with K may change the lowest frequencies by a relative `limit` or more.

    The errors of a factorisation act like a random spring of about EPS · K_ii under each deflection (`lift`). Relative to the
    stiffness of the `whole` part, with n elements in a row, this is a share n^3.5 EPS. The largest observed error is
    `growth` times this share.
    """
    rounding = min(growth * EPS * float(np.linalg.norm(K.diagonal()[lift])) / whole, 1.0)
    if rounding > limit:
        warn(f"{name!r}: rounding may take {rounding:.0e} of the lowest frequencies, because its smallest elements are "
             f"much stiffer than the whole. Remedy: {advice}", ConditionWarning)


def component(K: Matrix, M: Matrix, held: Array, interface: Mapping[str, Array], ports: Mapping[str, Array], dofs: DofMap,
              rayleigh: tuple[float, float] | None, name: str, by_node: bool = False, H: Matrix | None = None) -> Substructure:
    """The substructure without the held DOF. `interface` gives the DOF of each place, `ports` columns, both for all DOF.

    The places are the names of the interface sets. Interface DOF are listed place by place, or with `by_node` in ascending order.
    """
    loose = np.ones(dofs.size, dtype=bool)
    loose[held] = False
    free = np.flatnonzero(loose)
    if not len(free):
        raise InputError(f"supports hold every DOF of {name!r}, so nothing can move. Leave some of them out")
    number = np.cumsum(loose) - 1
    sets = {place: number[rows[loose[rows]]] for place, rows in interface.items()}
    lost = [place for place, rows in sets.items() if not len(rows)]
    if lost and (not by_node or len(lost) == len(sets)):
        raise InputError(f"interface {', '.join(map(repr, lost))} of {name!r} is held by the supports: leave out one or the "
                         "other")
    for port, w in ports.items():
        if not np.any(w[free]):
            raise InputError(f"port {port!r} of {name!r} sits on DOF that the supports hold. Move the port or the support")
    sets = {place: rows for place, rows in sets.items() if len(rows)}
    joined = np.unique(np.concatenate([*sets.values(), free[:0]]))
    whole = len(free) == dofs.size
    rows = M if whole else M[free]
    sub = Substructure(M if whole else rows[:, free], K if whole else K[free][:, free], interface=joined if by_node else sets,
                       ports={port: w[free] for port, w in ports.items()}, name=name, dofs=dofs.kept(free),
                       sets={place: np.searchsorted(joined, rows) for place, rows in sets.items()},
                       H=H if H is None or whole else H[free][:, free])
    if not whole:
        held = np.flatnonzero(~loose)
        sub._set(supported=Supported(rows[:, held], M[held][:, held], dofs.kept(held)))
    return sub if rayleigh is None else sub.with_damping(sub.D + proportional(sub, rayleigh))
