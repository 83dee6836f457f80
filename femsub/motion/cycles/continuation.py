"""Pseudo-arclength continuation of limit cycles in one parameter of a contact.

    R(v, ω; p) = 0,  phase(δv) = 0,  t·(x - x₀) = s,   x = [Re v / V, Im v / V, ω / Ω, p / P]

with the scaled tangent t of the last point. Folds need no special treatment. Harmonics are added where the cycle needs them.
Keller in: Rabinowitz (ed.), Applications of Bifurcation Theory, Academic Press 1977, p. 359.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la

from femsub.checks import Array, InputError, NotConvergedError
from femsub.coupling import Belt, with_slope
from femsub.motion.cycles.balance import Balance, Orbit, coefficients, parts_of
from femsub.motion.cycles.compliance import Compliance
from femsub.motion.nonlinear_model import Sliding

PARAMETERS = ("speed", "force", "slope")  # parameters of a belt


def with_parameter(contact: Any, name: str, value: float) -> Any:
    """A contact with another value of a field. For the slope of a belt, its law is changed by `with_slope`."""
    if isinstance(contact, Belt) and name == "slope":
        return replace(contact, law=with_slope(contact.law, value, contact.speed or 0.0))
    return replace(contact, **{name: value})


@dataclass(frozen=True, eq=False)
class Place:
    """One point of a path: an orbit at a value of the parameter, the unit tangent there, and the errors from `Path.left_out`."""

    orbit: Orbit
    value: float
    tangent: Array
    residual: float = 0.0
    left_out: tuple[float, float] | None = None

    @property
    def direction(self) -> float:
        """dp/ds, scaled: its sign changes at a fold."""
        return float(self.tangent[-1])


class Path:
    """Cycles of one model over one parameter of one of its contacts, with the scales of the unknowns."""

    def __init__(self, contact: Sliding, flexibility: Compliance, parameter: str, at: int, scales: tuple[float, float, float],
                 tol: float, most: int) -> None:
        self.base, self.flexibility, self.parameter, self.at = contact, flexibility, parameter, at
        self.scales, self.tol, self.most = scales, tol, most

    def contact(self, value: float) -> Sliding:
        """The contact at a value of the parameter."""
        contacts = list(self.base.contacts)
        try:
            contacts[self.at] = with_parameter(contacts[self.at], self.parameter, value)
        except InputError as error:
            raise NotConvergedError(f"the step led to a {self.parameter} that cannot be: {error}") from None
        return self.base.changed(contacts)

    def balance(self, value: float) -> Balance:
        """The balance at a value of the parameter."""
        return Balance(self.contact(value), self.flexibility)

    def _scale(self, unknowns: int) -> Array:
        """The scales of `unknowns` entries of x."""
        speed, omega, size = self.scales
        return np.append(np.full(unknowns - 2, speed), [omega, size])

    def scaled(self, orbit: Orbit, value: float) -> Array:
        """x of an orbit."""
        x = np.append(orbit.vector, value)
        return x / self._scale(len(x))

    def unscaled(self, x: Array, like: Orbit) -> tuple[Orbit, float]:
        whole = x * self._scale(len(x))
        return like.at(whole[:-1]), float(whole[-1])

    def _system(self, orbit: Orbit, value: float, count: int) -> tuple[Array, Array, Array | None]:
        """R and phase (2Hp + 1,), their scaled derivatives (2Hp + 1, 2Hp + 2), and the mean displacement."""
        speed, _, size = self.scales
        balance = self.balance(value)
        terms = balance.residual(orbit, count)
        R, J = balance.system(orbit, terms)
        h = 1e-6 * size  # for a central difference, whose rounding, EPS/1e-6, and error are below the error of Newton's method
        ahead, behind = (coefficients(self.balance(value + side).force(orbit, count), orbit.harmonics)[1:] for side in (h, -h))
        change = -np.einsum("kij,kj->ki", terms.Y, (ahead - behind) / (2 * h))
        whole = np.column_stack([J, np.append(parts_of(change), 0.0)])
        return R / speed, whole * (self._scale(len(R) + 1) / speed), terms.course.mean

    def correct(self, orbit: Orbit, value: float, row: Array, target: float, *, rounds: int = 14,
                tol: float = 1e-8) -> tuple[Place, int]:
        """Newton's method on R = 0, phase = 0, row·x = target, in at most `rounds` steps, up to a relative step `tol`.

        The place's tangent has a positive component along `row`. The number of steps is returned, too.

        Raises
        ------
        NotConvergedError
            The steps did not become small, diverged, or led to a singular point or a negative frequency.
        """
        count = self.balance(value).samples(orbit)
        x, before = self.scaled(orbit, value), np.inf
        for turn in range(1, rounds + 1):
            R, J, mean = self._system(orbit, value, count)
            bordered = np.vstack([J, row])
            try:
                step = la.solve(bordered, -np.append(R, row @ x - target), check_finite=False)
            except (la.LinAlgError, ValueError):
                raise NotConvergedError("the branch met a singular point") from None
            size = float(np.linalg.norm(step))
            if not np.isfinite(size) or (turn > 2 and size > 3 * before) or size > 1:
                raise NotConvergedError(f"the corrector diverged at {self.parameter} = {value:.6g}")
            x, before = x + step, size
            orbit, value = self.unscaled(x, replace(orbit, mean=mean))
            if orbit.omega <= 0:
                raise NotConvergedError(f"the frequency became negative at {self.parameter} = {value:.6g}")
            if size <= tol * (1 + float(np.linalg.norm(x))):
                break
            if size < 1e-2:  # so near the cycle its number of samples is known
                count = self.balance(value).samples(orbit)
        else:
            raise NotConvergedError(f"the corrector did not converge at {self.parameter} = {value:.6g}: last step {size:.1e}")
        tangent = la.solve(bordered, np.append(np.zeros(len(R)), 1.0), check_finite=False)
        return Place(orbit, value, tangent / np.linalg.norm(tangent),
                     float(np.linalg.norm(R) / np.linalg.norm(x[:-2]))), turn

    def at_value(self, orbit: Orbit, value: float, wanted: float) -> Place:
        """The cycle at exactly this value of the parameter, from an orbit at a value nearby."""
        row = np.append(np.zeros(orbit.vector.size), 1.0)
        return self.correct(orbit, value, row, wanted / self.scales[2])[0]

    def resized(self, place: Place, harmonics: int) -> Place:
        """The same place with another number of harmonics, not corrected."""
        direction = place.orbit.at(place.tangent[:-1]).with_harmonics(harmonics)
        tangent = np.append(direction.vector, place.tangent[-1])
        return replace(place, orbit=place.orbit.with_harmonics(harmonics), tangent=tangent / np.linalg.norm(tangent),
                       left_out=None)

    def step(self, place: Place, length: float) -> tuple[Place, int]:
        """The place at arclength `length` ahead, with as many harmonics as needed, and the number of Newton steps."""
        while True:
            x = self.scaled(place.orbit, place.value)
            orbit, value = self.unscaled(x + length * place.tangent, place.orbit)
            found, turns = self.correct(orbit, value, place.tangent, float(place.tangent @ x) + length)
            left_out = self.left_out(found)
            H = found.orbit.harmonics
            if left_out[0] <= self.tol or self.most <= H:
                return replace(found, left_out=left_out), turns
            place = self.resized(place, min(self.most, max(H + 4, int(1.5 * H))))
            # the old place with more harmonics, corrected so that they are not zero
            x = self.scaled(place.orbit, place.value)
            place, _ = self.correct(place.orbit, place.value, place.tangent, float(place.tangent @ x))

    def left_out(self, place: Place) -> tuple[float, float]:
        """Truncation and aliasing, see `Balance.unresolved`."""
        return self.balance(place.value).unresolved(place.orbit)[:2]
