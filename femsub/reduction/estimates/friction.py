"""How far the complex modes of contact modes are from those of the full system with friction, and that none is missing.

The model is compared with a larger one, and the larger one with the full system by the theorem of
`femsub.modes.quadratic.energy_basis`. A = K₀ - σM is the matrix whose factor is at hand, K₀ the symmetric stiffness in contact at
μ = 0. All modes below √θ are in U, the space of the larger model. So outside U, for |Re λ|, |Im λ| ≤ ω,

    c = 1 - (ω² - σ)/(θ - σ) - s - ω(γ + δ).

s, γ and δ are the largest values, against A outside U, of the symmetric part of K₀ - K, and of the skew and the symmetric part of
D. They come from Lanczos, which approaches them from below, and the coupling is sampled on curves about the band and on circles
about its eigenvalues. The count is therefore 'confirmed', not 'certified'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from femsub.algebra import ROUNDING, check_columns, orthonormal, unresisted
from femsub.checks import EPS, Array, Matrix
from femsub.errors import InputError, NotConvergedError
from femsub.model import DOUBLE, Estimate, Pencil, beyond, distance_outside, units, upper, within
from femsub.modes import (
    ACCEPTED,
    Coupling,
    EnergyBasis,
    Term,
    bars,
    energy_directions,
    independent,
    lowest_modes,
    solve,
    terms_of,
)
from femsub.reduction.basis import Kept, Statics
from femsub.reduction.estimates.found_modes import FoundModes, compressed
from femsub.reduction.estimates.nested import MARGIN, compared
from femsub.reduction.estimates.search import Best, Goal, Space

BEYOND = 1.2  # c holds up to so many times the band: the circles about eigenvalues do not reach farther
ROOM = (1 + 3 * BEYOND) / 4  # the eigenvalues are counted in a rectangle that ends at so many times the band at most
LEAST = 0.05  # smallest c with which the count is tried
SURE = 0.7  # g stays below this share of c at the points where it is sampled
CIRCLE = np.exp(2j * np.pi * (np.arange(8) + 0.5) / 8)  # the points on a circle about an eigenvalue
CHOICES = ((0,), (0, 1), (0, 2), (0, 1, 2))  # of the loads K₁, K₁ᵀ and D₁: the responses that are tried


class Larger:
    """The pencil in U = [Φ Q], how far its eigenvalues are from those of the full system, and the models of every size in it.

    Φ are all modes found, Q the responses to the loads of the first of them, `answered` elastic ones, and to the residuals of the
    complex modes in the band. `rest` (R, s) are the responses in U, `loads` (m, s) the loads on Φ.
    """

    def __init__(self, search: FoundModes, pencil: Pencil, matrices: Sequence[Matrix], hi: float, answered: int) -> None:
        handle, found = search.statics.handle, search.found
        self.search, self.matrices, self.rigid, self.frequencies = search, matrices, found.rigid, found.frequencies[found.rigid:]
        self.size = np.sqrt(found.eigenvalues - handle.sigma)  # of the modes in the coordinates of U
        self.answered = found.rigid + answered
        check_columns(search.statics.part.sub.name, len(found.shapes), 2 * len(found.eigenvalues) + 14 * self.answered)
        self.handle, self.pencil, self.hi = handle, pencil, hi
        self.N = pencil.K - handle.K
        self.symmetric = pencil.symmetric[1] and pencil.symmetric[2]
        self.top = np.inf if search.complete else search.top
        self.found, self.loose = found, 0
        if found.rigid:
            # Turn the rigid modes so that the `loose` ones come first, on which neither N nor D acts. Each of them has a double
            # eigenvalue at 0, in P and in P_U alike, and no part in the others: its column of P is λ²MΦ. What moves by rounding
            # alone is at rest: friction on its motion would not look like rounding
            N, D, r = self.N, pencil.D * hi, found.rigid
            both = sp.vstack([N, D]) if sp.issparse(N) else np.vstack([N, D])
            Z, root = found.shapes[:, :r], np.sqrt(handle.M.diagonal())[:, None]
            Z = np.where(root * np.abs(Z) > ROUNDING * np.linalg.norm(root * Z, axis=0), Z, 0.0)
            Z, free = unresisted(both, Z, np.tile(units(handle.K), 2))
            self.found = replace(found, shapes=np.hstack([Z[:, ::-1], found.shapes[:, r:]]))
            self.loose = len(free)
        shapes = self.found.shapes
        modes, acting = shapes / self.size, []
        for load in matrices:  # 0 where it is but rounding, as that of friction on rigid motion
            force, size = load @ shapes[:, :self.answered], abs(load) @ abs(shapes[:, :self.answered])
            acting.append(np.where(np.linalg.norm(force, axis=0) > ROUNDING * np.linalg.norm(size, axis=0), force, 0.0))
        forces = np.hstack(acting)
        self.loads = shapes.T @ np.hstack([forces, search.loads])
        # the responses, 0 where the modes have left nothing but rounding; of small ones most may be rigid motion
        rest = handle.deflate(np.hstack([handle.elastic_solve(forces, shapes), search.rest]))
        held, energy = self.loads[self.rigid:], np.einsum("ij,ij->j", rest, self.product(rest))
        whole = energy + np.einsum("ij,ij->j", held, held / self.found.eigenvalues[self.rigid:, None])
        rest = np.where(energy > ROUNDING * whole, rest, 0.0)
        sigma = handle.sigma
        terms = [Term(pencil.M, (sigma, 0.0, 1.0), 1.0, (0.0, 1 / (self.top**2 - sigma)), rounding=ROUNDING),
                 *terms_of(pencil.D, (0.0, 1.0, 0.0), sampled=True, rounding=ROUNDING),
                 *terms_of(self.N, (1.0, 0.0, 0.0), sampled=True, rounding=ROUNDING)]
        self.space = EnergyBasis(self.product, handle.factor.solve, terms, len(modes), deflate=self._without_rigid)
        self.space.add(modes[:, self.loose:], modes=True, unit=True)
        self.space.add(orthonormal(rest, self.product, modes)[0], unit=True)
        K, D, M = self.space.matrices
        values, X, Y = solve(Pencil(M, D, K))
        keep = within(values, (0.0, ROOM * hi)) & upper(values)
        answers = self._answers(values[keep], X[:, keep], Y[:, keep])
        held = np.hstack([modes[:, :self.loose], self.space.V])
        self.space.add(orthonormal(answers, self.product, held)[0], unit=True)
        self.U = np.hstack([modes[:, :self.loose], self.space.V])
        self.rest = self.U.T @ self.product(rest)
        K, D, M = self.space.matrices
        self.small = Pencil(M, D, K)
        self.values, self.X, self.Y = solve(self.small)
        slope = np.einsum("ij,ij->j", self.Y.conj(), (self.small.M @ self.X) * (2 * self.values) + self.small.D @ self.X)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.coupling = Coupling(self.space, -hi, 1 / (self.values + hi), self.X, -self.Y / slope.conj(), hi)

    def product(self, x: Array) -> Array:
        """Ax. K times rigid motion is 0: its rounding would exceed -σM."""
        handle = self.handle
        if not handle.sigma:
            return handle.K @ x
        force = handle.K @ handle.deflate(x)
        return force - handle.M @ (handle.rigid @ (handle.rigid.T @ force)) - handle.sigma * (handle.M @ x)

    def _answers(self, values: Array, X: Array, Y: Array) -> Array:
        """A⁻¹ times the residuals of right and left eigenvectors, real and imaginary parts."""
        V = self.space.V
        sides = [self.pencil.residual(values, V @ X)]
        if not self.symmetric:
            sides.append(self.pencil.transposed().residual(values.conj(), V @ Y))
        loads = np.hstack([part for side in sides for part in (side.real, side.imag)])
        if not loads.any():
            return loads[:, :0]
        return self.handle.deflate(self.handle.factor.solve(self._without_rigid(compressed(loads, self.handle.K.diagonal()))))

    def _without_rigid(self, loads: Array) -> Array:
        """The loads without their part MZ on the rigid motion Z, whose response Z/|σ| lies in U.

        It is left out before the solve: the difference of two responses that large would be noise.
        """
        Z = self.handle.rigid
        return loads - self.handle.M @ (Z @ (Z.T @ loads))

    def _outside(self, x: Array) -> Array:
        """x without its part in U."""
        for _ in range(2):
            x = x - self.U @ (self.U.T @ self.product(x))
        return x

    @cached_property
    def coercivity(self) -> float:
        """c up to BEYOND times the band."""
        for at, term in enumerate(self.space.terms):
            if term.sampled and (term.sign > 0 or term.weights[1]):
                low, high = self._ends(term.matrix, term.sign < 0)
                size = MARGIN * float(np.sqrt(high) if term.sign < 0 else max(-low, high))
                self.space.terms[at] = replace(term, range=(-size, size) if term.weights[1] else (MARGIN * low, np.inf))
        return self.space.coercivity((-BEYOND * self.hi, BEYOND * self.hi), BEYOND * self.hi)

    def _ends(self, B: Matrix, skew: bool = False, steps: int = 40) -> tuple[float, float]:
        """The smallest and largest xᴴBx / xᴴAx over L of a symmetric B, or 0; of a skew one those of BᵀA⁻¹B.

        By so many `steps` of Lanczos, which suffice for the two digits that the margins leave open.
        """
        if not abs(B).max():
            return 0.0, 0.0

        def applied(x: Array) -> Array:
            return self._outside(self.handle.factor.solve(self._without_rigid(B @ x)))

        start = self._outside(np.random.default_rng(11).standard_normal((len(self.U), 1)))
        V, image = orthonormal(start, self.product)
        H = np.zeros((steps, steps))
        for k in range(min(steps, len(self.U) - self.U.shape[1]) if V.shape[1] else 0):
            new = -applied(applied(V[:, k:])) if skew else applied(V[:, k:])
            H[:k + 1, k] = image.T @ new[:, 0]
            more, its = orthonormal(new, self.product, V)
            if not more.shape[1]:
                break
            V, image = np.hstack([V, more]), np.hstack([image, its])
        found = np.linalg.eigvalsh(np.triu(H) + np.triu(H, 1).T)
        return min(float(found[0]), 0.0), max(float(found[-1]), 0.0)

    @cached_property
    def counted(self) -> bool:
        """Whether the full system has as many eigenvalues as this model in a rectangle |Re λ| ≤ a, |Im λ| ≤ b about the band."""
        # the places just above the band that are farthest from all values
        places = np.linspace(1.0, ROOM, 25)[1:] * self.hi
        a, b = (float(places[np.abs(places[:, None] - np.abs(part)).min(axis=1).argmax()])
                for part in (self.values.real, self.values.imag))
        corners = [complex(a, 0.0), complex(a, b), complex(-a, b), complex(-a, 0.0)]
        return self.coercivity > LEAST and all(self._clear(begin, end) for begin, end in pairwise(corners))

    def _clear(self, begin: complex, end: complex) -> bool:
        """Whether g < c between two points, sampled at steps of half the distance to the next eigenvalue."""
        length, done = abs(end - begin), 0.0
        while True:
            at = begin + (end - begin) * min(done / length, 1.0)
            if not self.coupling.excludes(at, SURE * self.coercivity):
                return False
            if done >= length:
                return True
            done += max(0.5 * float(np.abs(self.values - at).min()), 1e-5 * length)

    @cached_property
    def radii(self) -> Array:
        """Of each λ about the band, the radius of a circle that holds as many eigenvalues of the full system as of this model.

        So for each of this model there is one of the full system that is not farther away. Infinite where there is no circle.
        """
        found, limit = np.full(len(self.values), np.inf), SURE * self.coercivity
        near = np.flatnonzero(within(self.values, (0.0, ROOM * self.hi)) & upper(self.values))
        if self.coercivity <= LEAST or not len(near):
            return found
        bar = bars(self.small, self.values[near], self.X[:, near], self.Y[:, near], self.values).error_bar
        for k, rounding in zip(near, bar, strict=True):
            value = self.values[k]
            right, left = self.coupling.lengths(value)
            first = right[k] * left[k] / limit
            start = float(max(first if np.isfinite(first) else np.inf, ACCEPTED * abs(value), 4 * rounding))
            for thorough in (False, True):
                radius = start  # one within DOUBLE |λ| needs no other; none may hold 0, or reach to where c is not known
                while found[k] > DOUBLE * abs(value) and radius < min(abs(value), (BEYOND - ROOM) * self.hi, found[k]):
                    if all(self.coupling.excludes(value + radius * turn, limit, thorough) for turn in CIRCLE):
                        found[k] = radius
                    radius *= 2
        return found

    @property
    def most(self) -> int:
        """The most elastic modes of a model: those whose responses are known, and the next one's frequency."""
        return min(self.search.most, self.answered - self.rigid)

    def basis(self, count: int, loads: Sequence[int]) -> Array:
        """T (R, r), TᵀT = I: the model of so many elastic modes and their responses to these loads in the coordinates of U."""
        m, modes, ports = self.rigid + count, len(self.size), self.search.loads.shape[1]
        groups = [np.arange(m) + self.answered * load for load in loads]
        chosen = np.concatenate([*groups, np.arange(self.rest.shape[1] - ports, self.rest.shape[1])])
        T = np.eye(len(self.rest), m)
        if not len(chosen):
            return T
        values = self.found.eigenvalues
        shapes = self.rest[:, chosen].copy()
        shapes[m:modes] += self.loads[m:, chosen] * (self.size[m:] / values[m:])[:, None]
        shapes[:m] = 0.0
        held = self.loads[self.rigid:m, chosen]
        whole = np.einsum("ij,ij->j", shapes, shapes) + np.einsum("ij,ij->j", held, held / values[self.rigid:m, None])
        return np.hstack([T, shapes @ energy_directions(shapes.T @ shapes, whole)[0]])

    def made(self, count: int, loads: Sequence[int]) -> Array:
        """T (R, r) of the model as `reduce` makes it: nearly dependent responses that it drops may be others than in `basis`."""
        m = self.rigid + count
        shapes = self.search.found.shapes[:, :m]
        forces = np.hstack([*(self.matrices[load] @ shapes for load in loads), self.search.statics.forces])
        rest = self.handle.elastic_solve(forces, shapes)
        static = independent(self.handle, rest, forces, shapes, self.search.found.eigenvalues[:m])[0]
        inner = self.U.T @ self.product(static)
        inner[:m] = 0.0
        return np.hstack([np.eye(len(inner), m), np.linalg.qr(inner)[0]])

    def estimate(self, count: int, T: Array, goal: Goal) -> Estimate:
        """The estimate of the model with so many elastic modes and the basis T."""
        pencil, T, band = self.small, T[self.loose:, self.loose:], goal.band
        least = DOUBLE * band[1] if self.rigid else 0.0
        small = Pencil(*(T.T @ (part @ T) for part in (pencil.M, pencil.D, pencil.K))) if T.shape[1] else None
        found = np.zeros(0, dtype=complex) if small is None else solve(small)[0]
        found = found[upper(found) & (np.abs(found) > least)]
        keep = np.flatnonzero(upper(self.values) & (np.abs(self.values) > least))
        exact, radii = self.values[keep], self.radii[keep]
        near = within(exact, (0.0, ROOM * band[1])) & (distance_outside(exact, band, (-band[1], band[1])) <= radii)
        wanted = within(exact, band) | near  # λ of the full system may be in the band
        at, to, distance, inside, alone = compared(exact, found, band, wanted)
        error = (MARGIN * distance + radii[at]) / np.abs(exact[at])
        omega = self.frequencies[:count]
        omega = omega[~beyond(omega, band[1]) & ~beyond(band[0], omega)]
        cutoff = float(np.append(self.frequencies, np.inf)[count])
        return Estimate(band, goal.tol, count, cutoff, omega, np.full(len(omega), 4 * EPS), found[to[inside]], error[inside],
                        alone, self.search.modes, 1.0, exact[at[inside]], radii[at[inside]])

    def fewest(self, loads: Sequence[int], goal: Goal, below: float) -> tuple[int, Estimate] | None:
        """The size and the estimate of the first model of fewer than `below` DOF that meets the tolerance.

        The numbers of modes rise in steps of a tenth: one mode more is not always better, since pairs that meet want both or
        none. Nothing is searched if the largest model does not meet it.
        """
        inside = int(np.searchsorted(self.frequencies[:self.most], goal.band[1], side="right"))
        count, most = max(inside, int(not self.rigid)), self.most  # no basis is empty
        if (size := self.basis(most, loads).shape[1]) >= below:
            most = int(most * below / size)
        if most < count or not self.estimate(most, self.basis(most, loads), goal).met:
            return None
        while count <= most:
            T = self.basis(count, loads)
            found = self.estimate(count, T, goal)
            if found.met:
                T = self.made(count, loads)
                found = self.estimate(count, T, goal)
            if found.met:
                return (T.shape[1], found) if T.shape[1] < below else None
            count = max(count + 1, min(most, int(1.1 * count)))
        return None


class FrictionSpace(Space):
    """The modes of a system in contact without friction, and the larger models that they make under friction.

    Parameters
    ----------
    pencil : Pencil
        The system with friction.
    friction, damping : matrix, shape (n, n)
        K₁, and D₁ that the contacts add to D.
    responses : bool
        Whether the responses to K₁Φ belong to the model, and where it is smaller with them those to D₁Φ and K₁ᵀΦ.

    Raises
    ------
    InputError
        Motions without mass: the model follows them statically, and would not be the one that is judged.
    """

    def __init__(self, statics: Statics, pencil: Pencil, friction: Matrix, damping: Matrix, responses: bool) -> None:
        name, self.pencil, self.answered = statics.part.sub.name, pencil, 0
        if (massless := statics.handle.K.shape[0] - statics.handle.finite) > 0:
            raise InputError(f"{name!r} has {massless} DOF without mass, and a tolerance under friction needs mass everywhere. "
                             "Condense these DOF, or give a number of modes instead, e.g. ContactModes(20, contacts=...)")
        self.modes = FoundModes(statics, None)
        super().__init__(repr(name), {name: self.modes})
        self.loads = [friction, friction.T, damping] if abs(damping).max() else [friction, friction.T]
        self.choices = [one for one in CHOICES if max(one) < len(self.loads)] if responses else [()]
        self.choice: tuple[int, ...] = ()

    def reach(self, hi: float) -> None:
        """Beyond the band, too: with all real modes up to √2 BEYOND times the band, inertia takes no more than half of c."""
        self.modes.reach(2**0.5 * BEYOND * hi, 2.0)

    def best(self, goal: Goal) -> Best | None:
        """The smallest model over all choices of responses."""
        modes, hi, best, below = self.modes, goal.band[1], None, np.inf
        self.reach(hi)
        modes.replace(lowest_modes(modes.statics.handle, modes.modes, known=modes.found))  # counted by inertia
        near = int(np.searchsorted(modes.found.frequencies[modes.found.rigid:], BEYOND * hi))
        self.answered = min(max(near + 3, self.answered), modes.modes)  # and the responses to the next three
        larger = Larger(modes, self.pencil, self.loads, hi, self.answered)
        for choice in self.choices if larger.counted else []:
            if (found := larger.fewest(choice, goal, below)) is not None:
                below, best, self.choice = found[0], found[1], choice
        if best is not None:
            return np.array([best.modes]), best
        if larger.counted and self.answered < modes.modes:
            self.answered *= 2
        elif modes.spent:
            lo, hi = goal.band
            if larger.counted:
                largest = larger.estimate(larger.most, larger.basis(larger.most, self.choices[-1]), goal)
                raise NotConvergedError(
                    f"{self.name} cannot be reduced to a relative error of {goal.tol:g} from {lo:.5g} to {hi:.5g} rad/time under "
                    f"this friction. With {largest.modes} modes: {largest!r}. Lower the band, or raise tol")
            raise NotConvergedError(
                f"{self.name}: with {modes.modes} modes the eigenvalues of the full system up to {hi:.5g} rad/time cannot be "
                f"counted (c = {larger.coercivity:.2g}, at least {LEAST:g} is needed). Lower the band, mu, or the contact's "
                "stiffness")
        else:
            self.grow(1.5)
        return None

    def counted_in(self, counts: Array) -> dict[str, Kept]:
        """The modes are counted already."""
        kept = Kept(self.modes.found, int(counts[0]))
        forces = [self.loads[load] @ kept.shapes for load in self.choice]
        return dict.fromkeys(self.parts, replace(kept, forces=np.hstack([kept.shapes[:, :0], *forces])))
