"""Frequency-based substructuring: parts known by their receptances, measured or computed, joined by Lagrange multipliers.

With Y = diag(Y_p) of the parts, u = Y(f + B_fᵀλ) and B u = 0. A row of B (m, nr) is the difference of the two motions of a joint,
and a row of B_f (m, nl) that of the forces there. So

    Y_c = Y - Y B_fᵀ Z B Y,   Z = (B Y B_fᵀ)⁻¹.

For an error δ of the receptances, with T = I - Y B_fᵀ Z B on the left and S = I - B_fᵀ Z B Y on the right,

    δY_c = T δ S - T δ B_fᵀ (B (Y + δ) B_fᵀ)⁻¹ B δ S.

The first term carries the noise of measurements to the result (`noise`). The second term shows how far this can be trusted.

If a part alone moves far more than the joined parts, Y_c is a small difference of large terms. Their rounding is in the bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.checks import (
    EPS,
    Array,
    InputError,
    InputTypeError,
    SingularMatrixError,
    instance,
    items,
    mapping,
    naming,
    positive_number,
    real_array,
    shown,
    unknown_name,
    warn,
    word,
)
from femsub.modes.receptance import TOL, FrequencyResponse, within

MOTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")  # of a virtual point
End = tuple[str, str]


def couple_responses(parts: Mapping[str, FrequencyResponse], joints: Sequence[tuple[End, End]], *, tol: float = TOL
                     ) -> FrequencyResponse:
    """Join parts that are known by their receptances: Lagrange multiplier frequency-based substructuring (LM-FBS).

    Y_c = Y - Y Bᵀ(B Y Bᵀ)⁻¹B Y with Y = diag(Y_p), shape (nf, nr, nl), and B the joints as signed Boolean rows.

    The receptances may be measured (`read_response`, `FrequencyResponse.measured`), or computed by `frequency_response` from full
    and reduced models. All parts have the same frequencies.

    Parameters
    ----------
    parts : mapping of str to FrequencyResponse
        The receptances by part name. Each joined motion must be a response and a load of its part, under the same name.
    joints : sequence of ((part, name), (part, name))
        Motions that become equal. The forces there are opposite.
    tol : float
        The largest accepted bound if computed parts are joined, relative to |h_ij|, as in `frequency_response`.

    Returns
    -------
    FrequencyResponse
        Its names begin with the name of the part: 'disc.rim'. `bound` follows from the bounds of the parts, second order
        included, and has the rounding of the joining. The result is 'certified' if all parts are computed and no bound exceeds
        `tol`. `scatter`, `ellipses` and `covariance` are the first-order effect of the noise of all parts. The parts' noise is
        taken as independent. `residual` is the expected size of the second-order term relative to the first, √E‖Z B δ B_fᵀ‖²,
        with scaled joints.

    Raises
    ------
    InputError, InputTypeError
        A part or name is unknown; frequencies differ; a joined motion is not both a response and a load.
    SingularMatrixError
        A joint is given twice, or parts resonate against each other without damping.

    Warns
    -----
    FemsubWarning
        `residual` is above 0.4 at some frequency, so that the noise of the result is stated too small there. From 1 on it is inf.

    References
    ----------
    D. de Klerk, D. J. Rixen, S. N. Voormeeren, AIAA J. 46 (2008) 1169 (LM-FBS). S. N. Voormeeren, D. de Klerk, D. J. Rixen,
    Mech. Syst. Signal Process. 24 (2010) 106 (how uncertainty goes through it).

    Examples
    --------
    >>> import femsub as fs
    >>> omega = np.linspace(0.1, 1.0, 5)
    >>> left, right = fs.chain(5, interface=[5]), fs.chain(6, interface=[1], fixed=False)
    >>> parts = {"left": fs.frequency_response(left, at=omega, loads=[4]),
    ...          "right": fs.frequency_response(right, at=omega, loads=[0, 5])}
    >>> found = fs.couple_responses(parts, [(("left", "DOF 4"), ("right", "DOF 0"))])
    >>> system = fs.couple({"left": left, "right": right}, [fs.Rigid(("left", [4]), ("right", [0]))])
    >>> exact = fs.frequency_response(system, at=omega, loads=[9]).receptance[:, 0, 0]
    >>> bool(np.allclose(found.entry("right.DOF 5", "right.DOF 5"), exact, rtol=1e-10))
    True
    """
    given = mapping("parts", parts, "names and responses, as {'disc': fs.frequency_response(...)}")
    for name, part in given.items():
        instance(f"the part {name!r}", part, FrequencyResponse, "made by frequency_response or read_response")
    if not given:
        raise InputError("parts is empty: give at least one")
    positive_number("tol", tol)
    omega = next(iter(given.values())).omega
    for name, part in given.items():
        if not np.array_equal(part.omega, omega):
            raise InputError(f"the part {name!r} has other frequencies than {next(iter(given))!r}: give all of them the same")
    responses = [f"{name}.{one}" for name, part in given.items() for one in part.responses]
    loads = [f"{name}.{one}" for name, part in given.items() for one in part.loads]
    with naming("joints"):
        pairs = [_joint(one, given) for one in items("joints", joints, "pairs of ends, ((part, name), (part, name))")]
    if not pairs:
        raise InputError("joints is empty: join at least one motion of two parts")
    B, B_f = (np.zeros((len(pairs), len(names))) for names in (responses, loads))
    for k, ends in enumerate(pairs):
        for end, sign in zip(ends, (1.0, -1.0), strict=True):
            B[k, responses.index(end)] += sign
            B_f[k, loads.index(end)] += sign
    shape = (len(omega), len(responses), len(loads))
    Y, bound = np.zeros(shape, dtype=complex), np.zeros(shape)
    places = []
    row = column = 0
    for part in given.values():
        rows, columns = (slice(at, at + len(names)) for at, names in ((row, part.responses), (column, part.loads)))
        Y[:, rows, columns], bound[:, rows, columns] = part.receptance, part.bound
        places.append((part, rows, columns))
        row, column = rows.stop, columns.stop
    joined = _Joined.of(Y, B, B_f)
    second = joined.second_order(places)
    noise = tuple(one.through(joined.left[:, :, rows], joined.right[:, columns], second < 1.0)
                  for part, rows, columns in places for one in part.noise)
    many = second > 0.4  # first order underestimates the noise: regions of 95 % contain 90 to 94 % here
    if many.any():
        worst = int(second.argmax())
        warn(f"the noise is too large for first order at {int(many.sum())} of {len(omega)} frequencies, most at ω = "
             f"{omega[worst]:.5g} rad/time: terms of second order are {second[worst]:.2g} of the first, so scatter, ellipses "
             f"and covariance are too small there (unknown from 1 on). Measure more often, or leave these frequencies out")
    bound = joined.bounded(bound)
    whole = all(part.tally.counted is not None for part in given.values())
    return FrequencyResponse(omega, joined.Y, bound, second, tuple(responses), tuple(loads),
                             np.zeros(len(omega), dtype=bool), tally=within(joined.Y, bound, tol, whole), noise=noise,
                             cutoff=min(part.cutoff for part in given.values()))


def _joint(joint: Any, parts: Mapping[str, FrequencyResponse]) -> tuple[str, str]:
    """The two ends of a joint as 'part.name'."""
    try:
        ends = [(str(part), str(name)) for part, name in joint]
    except (NotImplementedError, TypeError, ValueError):
        ends = []
    if len(ends) != 2:
        raise InputTypeError(f"each of joints must be a pair of ends, (('disc', 'rim'), ('hat', 'rim')), not {shown(joint)}")
    for part, name in ends:
        if part not in parts:
            raise unknown_name("part", part, parts)
        for what, names in (("response", parts[part].responses), ("load", parts[part].loads)):
            if name not in names:
                raise InputError(f"{name!r} is no {what} of the part {part!r}, but joined motions must be both. Its {what}s are "
                                 f"{', '.join(names)}")
    if ends[0] == ends[1]:
        raise InputError(f"a joint has {ends[0][1]!r} of {ends[0][0]!r} at both ends")
    return f"{ends[0][0]}.{ends[0][1]}", f"{ends[1][0]}.{ends[1][1]}"


@dataclass(frozen=True, eq=False)
class _Joined:
    """Y_c, Z, T and S at all frequencies, with B and B_f; see the module's text.

    The rows of B and B_f are scaled, so that joints of displacements and of rotations count alike in any units.
    """

    given: Array
    Y: Array
    Z: Array
    left: Array
    right: Array
    B: Array
    B_f: Array

    @classmethod
    def of(cls, Y: Array, B: Array, B_f: Array) -> _Joined:
        size = np.abs(B @ Y @ B_f.T)
        size = (size / np.maximum(size.max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)).sum(axis=0)
        B = _per(size.max(axis=1))[:, None] * B
        B_f = _per((_per(size.max(axis=1))[:, None] * size).max(axis=0))[:, None] * B_f
        across = B @ Y @ B_f.T
        rank = np.linalg.svd(across, compute_uv=False)
        if (bad := rank[:, -1] <= 512 * EPS * rank[:, 0]).any():  # the size of rounding where forces cancel
            raise SingularMatrixError(f"the joints have no unique forces at frequency {int(bad.argmax()) + 1} of {len(Y)}: some "
                                      "of them follow from the others, or the parts resonate against each other without damping")
        Z = np.linalg.inv(across)
        left = np.eye(Y.shape[1]) - Y @ B_f.T @ Z @ B
        right = np.eye(Y.shape[2]) - B_f.T @ Z @ B @ Y
        return cls(Y, left @ Y, Z, left, right, B, B_f)

    def bounded(self, bound: Array) -> Array:
        """The bound of δY_c for |δ| ≤ bound, entry by entry, and of rounding; inf where the second-order term is not bounded.

        Z is the inverse of B Y B_fᵀ + Δ, with Δ from its residual: Y_c changes by Y B_fᵀ Z Δ (B Y B_fᵀ)⁻¹ B Y.
        """
        B, B_f, unit = np.abs(self.B), np.abs(self.B_f), np.eye(len(self.B))
        found = np.full(self.Y.shape, np.inf)
        few = EPS * (4 + np.sqrt(sum(self.Y.shape[1:]) + len(B)))  # roundings of a product; they add up at random
        for k, own in enumerate(bound):
            if not np.isfinite(own).all():
                continue
            Y, Z, size = self.given[k], np.abs(self.Z[k]), np.abs(self.given[k])
            across = self.B @ Y @ self.B_f.T
            own = own + few * size
            inverse = (np.abs(across @ self.Z[k] - unit) + few * np.abs(across) @ Z) @ np.abs(across)
            changed = Z @ (B @ own @ B_f.T + inverse)
            if np.linalg.norm(changed, np.inf) >= 1:
                continue
            series = np.linalg.inv(unit - changed)
            out, into = np.abs(Y @ self.B_f.T @ self.Z[k]) @ inverse @ series, np.abs(self.Z[k] @ self.B @ Y)
            left = np.abs(self.left[k]) + out @ Z @ B
            right = np.abs(self.right[k]) + B_f.T @ series @ Z @ inverse @ into
            found[k] = left @ (own + own @ B_f.T @ series @ Z @ B @ own) @ right + out @ into
            found[k] += few * (size @ B_f.T @ Z @ B @ size + np.abs(self.left[k]) @ size)
        return found

    def second_order(self, places: Sequence[tuple[FrequencyResponse, slice, slice]]) -> Array:
        """√E‖Z B δ B_fᵀ‖² for the noise δ of all parts, shape (nf,)."""
        found = np.zeros(len(self.Y))
        for part, rows, columns in places:
            for one in part.noise:
                found += one.through(self.Z @ self.B[:, rows], self.B_f[:, columns].T).moments()[0].sum(axis=(1, 2))
        return np.sqrt(found)


def _per(size: Array) -> Array:
    """1 / size, rounded to a power of two, so that scaling causes no rounding; 1 where the size is 0."""
    return 2.0 ** -np.rint(np.log2(np.where(size > 0, size, 1.0)))


def virtual_point(response: FrequencyResponse, point: Any, sensors: Mapping[str, tuple[Any, Any]],
                  impacts: Mapping[str, tuple[Any, Any]] | None = None, name: str = "point", *, tol: float = TOL
                  ) -> FrequencyResponse:
    """The receptance of an interface's six rigid motions from sensors and impacts around it: virtual point transformation.

    Y_q = T Y T_fᵀ with T = (RᵀR)⁻¹Rᵀ (6, ns), rows of R: dᵀ and ((x - p) × d)ᵀ for a sensor at x along d, and p the point. T_f is
    made in the same way from the impacts.

    Parameters
    ----------
    response : FrequencyResponse
        A receptance measured, or computed, at the places of the sensors.
    point : array_like, shape (3,)
    sensors, impacts : mapping of str to (place, direction)
        Place x and direction d, three numbers each, by name of the response or load. At least six, which must determine all
        motions. By default the impacts are at the sensors.
    name : str
        The name of the point: its motions are 'point.ux' to 'point.rz'. Responses and loads without a sensor or impact stay.
    tol : float
        The largest accepted bound of a computed receptance, relative to |h_ij|, as in `frequency_response`.

    Returns
    -------
    FrequencyResponse
        `residual` is the share of the sensors' motion that is not a rigid motion of the interface, the largest over the loads.

    Raises
    ------
    InputError, InputTypeError
        A response or load is unknown; the sensors do not determine all motions.

    References
    ----------
    M. V. van der Seijs, D. D. van den Bosch, D. J. Rixen, D. de Klerk, COMPDYN 2013, paper 1334 (virtual point transformation).

    Examples
    --------
    >>> import femsub as fs
    >>> places = {str(i): ((x, y, z), d) for i, (x, y, z, d) in enumerate([
    ...     (1, 0, 0, (0, 1, 0)), (1, 0, 0, (0, 0, 1)), (-1, 0, 0, (0, 1, 0)), (-1, 0, 0, (0, 0, 1)),
    ...     (0, 1, 0, (1, 0, 0)), (0, 1, 0, (0, 0, 1)), (0, -1, 0, (1, 0, 0))])}
    >>> R = np.array([[*d, *np.cross(x, d)] for x, d in places.values()])
    >>> mobile = fs.FrequencyResponse.measured([1.0], (R @ R.T)[None], list(places), list(places))
    >>> found = fs.virtual_point(mobile, (0, 0, 0), places)
    >>> found.responses[0], bool(np.allclose(found.receptance[0], np.eye(6))), bool(found.residual[0] < 1e-12)
    ('point.ux', True, True)
    """
    instance("response", response, FrequencyResponse)
    positive_number("tol", tol)
    word("name", name)
    p = _three("point", point)
    left, rows, T, R, unclear = _at_point("sensors", sensors, response.responses, p, name)
    right, columns, *_, blurred = _at_point("impacts", sensors if impacts is None else impacts, response.loads, p, name)
    moved = response.receptance[:, [response.responses.index(key) for key in sensors]]
    rest = np.linalg.norm(moved - R @ (T @ moved), axis=1)
    size = np.linalg.norm(moved, axis=1)
    share = np.divide(rest, size, out=np.zeros_like(rest), where=size > 0).max(axis=1)
    rounding = EPS * (4 + np.sqrt(sum(response.receptance.shape[1:]))) * (unclear + blurred)  # of the products, and of T and T_f
    own = response.bound + rounding * np.abs(response.receptance)
    h, bound = left @ response.receptance @ right.T, np.abs(left) @ own @ np.abs(right.T)
    tally = within(h, bound, tol, response.tally.counted is not None)
    return replace(response, receptance=h, residual=share, responses=rows, loads=columns, bound=bound, tally=tally,
                   noise=tuple(one.through(left, right.T) for one in response.noise))


def _at_point(what: str, given: Mapping[str, tuple[Any, Any]], names: Sequence[str], p: Array, name: str
              ) -> tuple[Array, tuple[str, ...], Array, Array, float]:
    """The transformation of all responses or loads, their new names, T (6, k), R (k, 6) and its condition number."""
    for key in mapping(what, given, "names, places and directions, as {'acc1': ((0, 0, 1), (1, 0, 0))}"):
        if key not in names:
            raise unknown_name(what.removesuffix("s"), key, names)
    R = np.zeros((len(given), 6))
    for k, (key, place) in enumerate(given.items()):
        if not isinstance(place, (tuple, list)) or len(place) != 2:
            raise InputTypeError(f"{what}: {key!r} must have a place and a direction, not {shown(place)}")
        x, d = _three(f"the place of {key!r}", place[0]), _three(f"the direction of {key!r}", place[1])
        if not (length := float(np.linalg.norm(d))):
            raise InputError(f"{what}: {key!r} has no direction: all three numbers are 0")
        R[k] = [*(d / length), *np.cross(x - p, d / length)]
    reach = np.linalg.norm(R[:, 3:], axis=1).max(initial=0.0) or 1.0
    scaled = R / np.array([1.0, 1.0, 1.0, reach, reach, reach])
    values = np.linalg.svd(scaled, compute_uv=False)
    if len(R) < 6 or values[-1] < 1e-8:
        raise InputError(f"{what} must determine all six motions of the point, but these {len(R)} leave some of them unknown. "
                         "Add some at other places or along other directions")
    T = np.linalg.pinv(scaled) / np.array([1.0, 1.0, 1.0, reach, reach, reach])[:, None]
    kept = [one for one in names if one not in given]
    whole = np.zeros((6 + len(kept), len(names)))
    whole[:6, [names.index(key) for key in given]] = T
    whole[6 + np.arange(len(kept)), [names.index(one) for one in kept]] = 1.0
    return whole, (*(f"{name}.{motion}" for motion in MOTIONS), *kept), T, R, float(values[0] / values[-1])


def _three(what: str, value: Any) -> Array:
    found = real_array(what, value)
    if found.shape != (3,):
        raise InputError(f"{what} must be three numbers, but its shape is {found.shape}")
    return found
