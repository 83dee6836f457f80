"""The proof that no eigenvalue of a region is missing; how many eigenvalues to ask for; when the search may stop.

The proof is a count in a disc around 0 from inertia and a small determinant, or that of a projection on undamped modes with its
bound, or the winding number of det P around a rectangle. All are independent of the search. The search finds the eigenvalues
nearest to 0, and lists those with Im λ ≥ 0. A projection that has counted a rectangle gives the eigenpairs as well: each is
corrected until it solves the full problem, and none is listed twice.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.linalg import LinAlgError

from femsub.algebra import QUADRATIC, shared
from femsub.checks import Array, Matrix, Tally
from femsub.errors import MissedModesError, NotConvergedError, NotEnoughMemoryError, SingularMatrixError
from femsub.model import beyond, in_band
from femsub.modes.normal_modes import modes_under
from femsub.modes.quadratic import damping_split, disc_count, projected_count
from femsub.modes.quadratic.disc_count import Count, Edge
from femsub.modes.quadratic.multiplicity import clear_radius, distinct
from femsub.modes.quadratic.projected_count import Projection, about_radius
from femsub.modes.quadratic.projected_pairs import left_vectors, right_pairs
from femsub.modes.quadratic.region import Box, Contour, listed
from femsub.modes.quadratic.sparse import KEPT, Shifted
from femsub.modes.quadratic.winding_count import clear_of, missed_eigenvalues, undamped_reference

if TYPE_CHECKING:
    from femsub.model import Pencil

log = logging.getLogger(__name__)

Counted = Count | projected_count.Count
DISCS, WIDER = 3, 1.25  # attempts at a disc that holds the eigenvalues nearest to 0, and how much wider the next one is
MOST = 1500  # eigenvalues computed by TOAR at most: beyond, run times reach hours and backward errors grow


class _Counted:
    """The count in a disc around 0, for a pencil with proportional damping except in a few columns; for others by projection."""

    def __init__(self, pencil: Pencil, wanted: bool) -> None:
        self.pencil, self.wanted = pencil, wanted
        self.counted: Counted | None = None
        self.count: projected_count.Count | None = None  # by a projection before the search
        self.short = False  # whether a disc was too small for it
        self.why = ""  # the projection gave no count
        self.tally = Tally(0)
        self.projection: Projection | None = None
        self.pairs: tuple[Array, Array] | None = None  # all that are needed, where no search is
        self.parts = damping_split.split(pencil) if wanted else None

    @property
    def can_count(self) -> bool:
        """Whether a way to count is left before the search."""
        return self.count is not None or not self.why or self.parts is not None

    @cached_property
    def problem(self) -> Shifted:
        """The shifted problem, for a search: its factor is made at the first use."""
        return Shifted(self.pencil)

    def projected(self, outer: Contour, inside: Callable[[Array], Contour]) -> projected_count.Count | None:
        """The count by projection, for any damping; `inside` chooses the contour from the projection's eigenvalues."""
        if not self.wanted or not np.isfinite(outer.size):
            return None
        n = self.pencil.size  # two of the projection's eigenproblems, the usual number, cost no more than all eigenvalues
        try:
            self.projection = Projection(self.pencil, outer, int(n * 0.5 ** (1 / 3)) if n <= QUADRATIC else QUADRATIC)
            found = self.projection.on(inside)
        except (SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError) as error:
            self.why = str(error)
            found = None
        else:
            self.why = self.projection.why
        if found is None:
            log.info("no count by projection: %s", self.why)
        return found

    def _pairs(self) -> tuple[Array, Array] | None:
        """All eigenpairs inside the contour from those of the projection, if as many as it counts are solved for."""
        if self.count is None or self.projection is None or self.projection.counted is None:
            return None
        with suppress(LinAlgError, NotEnoughMemoryError):
            found = right_pairs(self.projection.counted, self.pencil)
            found = None if found is None else distinct(*found)  # two may have come to one eigenvalue
            if found is not None and self.count.tally(found[0]).listed == self.count.number:
                return found
        return None

    def left(self, values: Array, X: Array) -> Array | None:
        """Left vectors by the projection that has counted, if there is one and they are clear."""
        if all(self.pencil.symmetric):
            return X.conj()
        if self.projection is None or self.projection.counted is None or self.tally.listed != self.tally.counted:
            return None
        with suppress(LinAlgError, NotEnoughMemoryError):
            return left_vectors(self.projection.counted, self.pencil, values, X)
        return None

    def known(self, values: Array) -> Array:
        """The λ found, and those near them that were not searched for, as the projection has them."""
        if self.pairs is None or not isinstance(self.counted, projected_count.Count):
            return values
        return np.append(values, self.counted.values[~self.counted.contour.encloses(self.counted.values)])

    def edge(self, radius: float) -> Edge | None:
        """The undamped count at a radius, moved out by up to 0.1 % if a mode lies there; None if no count is possible."""
        if (parts := self.parts) is None:
            return None
        owners = (parts.K0, parts.M, *([] if parts.skew is None else [self.pencil.D]))
        for there in (radius, radius * (1 + 1e-5), radius * (1 + 1e-3)):
            with suppress(SingularMatrixError):
                return shared(owners, ("edge", there, parts.W.shape[1] > 0), partial(disc_count.edge, parts, there))
        return None

    def missed_in(self, at: Edge | None, values: Array, X: Array) -> int | None:
        """The number of missing eigenvalues in the disc; None if there is no proof."""
        self.counted = None if at is None else self._counted(at, X[:, np.abs(values) <= at.radius])
        return self.lacked(values)

    def lacked(self, values: Array) -> int | None:
        """How many the count has more than are found; None without a count."""
        if self.counted is None:
            self.tally = Tally(listed(values))
            return None
        self.tally = self.counted.tally(values)
        return self.counted.number - self.tally.listed

    def told_again(self, values: Array, vague: int) -> None:
        """The tally of values that are known better now, without those that may be no eigenvalues."""
        if self.counted is not None:
            self.tally = self.counted.tally(values)
        self.tally = replace(self.tally, listed=self.tally.listed - vague)

    def _counted(self, at: Edge, inside: Array) -> Count | None:
        problem, parts, found = self.problem, self.parts, None
        assert parts is not None
        if parts.K0 is self.pencil.K and problem.definite is not None:  # an existing factor
            found = disc_count.count(parts, at, *problem.definite, inside)
        if found is None or not found.is_valid:
            with suppress(SingularMatrixError):
                found = disc_count.count(parts, at, *disc_count.definite(parts, at.radius), inside)
        return found if found is not None and found.is_valid else None

    def lacking(self, missed: int) -> str:
        """The message of the error if eigenvalues are missing."""
        if self.counted is None:
            return (f"{missed} eigenvalues in or near the band are missing, by the winding number of det P. Shift the band a "
                    "little, or narrow re=(a, b)")
        return (f"{self.counted.number - missed} eigenvalues were found in {self.counted.where}, but an independent count gives "
                f"{self.counted.number}. Ask for more or fewer, or for another band")


class Nearest(_Counted):
    """The `number` eigenvalues nearest to 0, conjugates included, and a disc that contains them."""

    most = np.inf

    def __init__(self, pencil: Pencil, number: int, evidence: bool | None, given: Pencil) -> None:
        wanted = pencil.size <= KEPT if evidence is None else evidence
        super().__init__(pencil, wanted)
        self.number, self.unasked = number, evidence is None
        if self.unasked and not wanted:
            self.why = f"the model has {pencil.size} DOF, and above {KEPT} none is made unasked, because of its second factor"
        self.tried = wanted and self.parts is None and pencil.is_sparse and pencil.size > QUADRATIC
        if self.tried:
            self._project(given)
        # The eigenvalues nearest to a shift are not exactly those nearest to 0, so a few more are computed. A count needs a
        # gap behind the last one, and therefore the next one.
        self.ask = number + (0 if self.pairs else 12 if self.problem.shift else 0) + (2 if wanted else 0)

    def _project(self, given: Pencil) -> None:
        """The count and the pairs by projection, in a disc that is widened until it holds the `number` nearest.

        Its first radius is found in the units of the `given` pencil, in which a uniform motion is one of a body.
        """
        with suppress(SingularMatrixError, NotConvergedError, NotEnoughMemoryError):
            radius = about_radius(given, self.number)
            for _ in range(DISCS):
                self.short = False
                self.count = self.projected(disc := Contour(radius), partial(self._behind, disc))
                if not self.short:
                    break
                radius *= WIDER
        self.pairs = self._pairs()

    def _behind(self, disc: Contour, values: Array) -> Contour:
        """The circle just behind the `number` nearest; LinAlgError, as where there is no projection, if the disc has fewer."""
        upper = values[(values.imag >= 0) & disc.encloses(values)]
        size, so_far = np.sort(np.abs(upper)), np.cumsum(1 + (upper[np.argsort(np.abs(upper), kind="stable")].imag != 0))
        last = int(np.searchsorted(so_far, self.number))
        self.short = last + 1 >= len(size)
        if self.short:
            raise LinAlgError("too few eigenvalues in the disc")
        return Contour(clear_radius(size, last + 1))

    def _sure(self, values: Array) -> Array:
        """Indices, ascending in |λ|, of the values that are certainly nearest to 0."""
        if self.pairs is not None:
            return np.argsort(np.abs(values), kind="stable")
        near = np.flatnonzero(~beyond(np.abs(values), np.abs(values - self.problem.shift).max() - self.problem.shift))
        return near[np.argsort(np.abs(values[near]), kind="stable")]

    def is_short(self, values: Array) -> bool:
        """Whether other eigenvalues may be nearer to 0 than those found; then `ask` is increased."""
        all_of_them = 2 * self.pencil.size
        if listed(values[self._sure(values)]) >= self.number or listed(values) >= all_of_them or self.ask >= all_of_them:
            return False
        self.ask = min(2 * self.ask, all_of_them)
        return True

    def missed(self, values: Array, X: Array) -> int | None:
        """The number of missing eigenvalues by an independent count; None without one."""
        if not self.wanted:
            return None
        if self.count is not None:
            self.counted = self.count
            return self.lacked(values)
        radius = clear_radius(np.abs(values[self._sure(values)]), len(self.taken(values)[0]))
        if self.missed_in(self.edge(radius), values, X) is None and not self.tried:
            disc = Contour(radius)
            self.counted = self.projected(disc, lambda _: disc)
        return self.lacked(values)

    def is_found_uncounted(self) -> bool:
        """Whether to give up the count: if the caller did not request it, it must not make the search fail."""
        if not self.wanted or not self.unasked:
            return False
        self.wanted, self.parts, self.ask = False, None, self.ask - 2
        return True

    def about(self, values: Array) -> Array:
        """Indices of the requested eigenvalues, and of those that may belong to them once they are known better."""
        sure = self._sure(values)
        return sure[:len(self.taken(values)[0]) + 2]

    def taken(self, values: Array) -> tuple[Array, Array]:
        """Indices of the requested eigenvalues, and which of these stand for a pair."""
        sure = self._sure(values)
        so_far = np.cumsum(1 + (values[sure].imag != 0))
        sure = sure[:int(np.searchsorted(so_far, self.number)) + 1]
        return sure, np.flatnonzero(values[sure].imag)


class Enclosed(_Counted):
    """All eigenvalues in a rectangle, proved by projection, by the count in the disc around it, or by the winding of det P.

    The projection comes first: it gives the eigenpairs as well and is a proof, which the determinant of a disc is not.
    """

    def __init__(self, pencil: Pencil, box: Box, evidence: bool | None, winding: bool = True) -> None:
        super().__init__(pencil, evidence is not False)
        self.box, self.most = box, float(min(pencil.size, MOST))
        self.wound = winding and bool(evidence)  # whether det P may be sampled
        self.count = self._projected()
        self.pairs = self._pairs()
        self.at = self.edge(self._radius) if self.count is None else None
        if self.count is not None:  # only the eigenvalues up to the farthest in the rectangle are needed
            size = np.abs(self.count.values)
            self.radius = 1.001 * float(size[self.count.contour.encloses(self.count.values)].max(initial=0.0))
            self.radius += 0.0 if self.pairs else self.problem.shift
            self.ask = int(np.count_nonzero(size <= self.radius)) + 8
        else:
            self.radius = self._radius
            self.ask = 2 * (self.at.below if self.at else self._undamped()) + 12

    @property
    def _radius(self) -> float:
        """Of the disc around 0, or around a shift, that holds the rectangle; its edges may move out by 2 %."""
        a, b, _, hi = self.box
        return 1.03 * float(np.hypot(max(abs(a), abs(b)), hi)) + self.problem.shift

    def _projected(self) -> projected_count.Count | None:
        """The count by projection in the rectangle from the real axis on, whose edges move by up to 2 %."""
        a, b, _, hi = self.box

        def inside(values: Array) -> Contour:
            left, right, _, top = clear_of(values[values.imag >= 0], self.box)
            return Contour(sides=(left, right, top))

        return self.projected(Contour(sides=(a - 0.02 * hi, b + 0.02 * hi, 1.02 * hi)), inside)

    @cached_property
    def reference(self) -> tuple[Matrix, Array] | None:
        """See `undamped_reference`."""
        return undamped_reference(self.pencil, self.radius)

    def _undamped(self) -> int:
        """About the number of undamped modes in the disc."""
        pencil = self.pencil
        if self.wound:
            return 10 if self.reference is None else len(self.reference[1])
        with suppress(SingularMatrixError):
            return modes_under(pencil.symmetric_stiffness, pencil.M, self.radius**2) if pencil.symmetric[0] else 10
        return 10

    def is_short(self, values: Array) -> bool:
        """Whether the disc around the rectangle may contain more eigenvalues; then `ask` is increased."""
        pencil = self.pencil
        if np.abs(values - self.problem.shift).max() >= self.radius or listed(values) >= 2 * pencil.size:
            return False
        self.ask = int(min(2 * self.ask, self.most) if self.ask < self.most else self.most + 1)
        return True

    def missed(self, values: Array, X: Array) -> int | None:
        """As for `Nearest`."""
        if self.count is not None:
            self.counted = self.count
            return self.lacked(values)
        missed = self.missed_in(self.at, values, X)
        if missed is not None or not self.wound:
            return missed
        if self.reference is None:
            return None
        missed = missed_eigenvalues(self.pencil, self.box, values[np.abs(values) <= self.radius], *self.reference)
        self.tally = Tally(listed(values), listed(values) + missed, sampled=True)
        return missed

    def is_found_uncounted(self) -> bool:
        """Never: the proof needs no additional eigenvalues."""
        return False

    def about(self, values: Array) -> Array:
        """As for `Nearest`: those in the rectangle and within a hundredth of its size beside it."""
        a, b, lo, hi = self.box
        beside = 0.01 * max(abs(a), abs(b), hi)
        return np.flatnonzero(in_band(values, (max(lo - beside, 0.0), hi + beside), (a - beside, b + beside)))

    def taken(self, values: Array) -> tuple[Array, Array]:
        """Indices of the values in the rectangle, and which of these have conjugates in it."""
        band, re = self.box[2:], self.box[:2]
        taken = np.flatnonzero(in_band(values, band, re))
        near = values[taken]
        # a double real eigenvalue split by rounding: both are in
        return taken, np.flatnonzero((near.imag != 0) & in_band(near.conj(), band, re))
