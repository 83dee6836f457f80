"""The eigenpairs in a region of the spectrum: all by LAPACK, or some until an independent count shows that none is missing.

The count is that of a projection on undamped modes with its bound, or one in a disc around 0 from inertia and a small
determinant, or the winding number of det P around a rectangle. All are independent of the search. A projection that has counted
gives the eigenpairs as well: each is corrected until it solves the full problem, and none is listed twice. Else PEP searches for
more and more eigenvalues nearest to 0, and lists those with Im λ ≥ 0, until the region is complete.

Costs are in units of LAPACK's, which are proportional to n³. The coefficients are measured, with one thread, on reduced models of
446 to 1,500 coordinates. LAPACK took 6 ns n³. PEP took (1.2 x + 13 x²) ns n³ for xn eigenvalues: solves, and orthogonalisation.
The count in a disc took 22 x³ ns n³ for each column of a contact or dashpot.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.linalg import LinAlgError

from femsub.algebra import FEW, QUADRATIC, SMALL, WIDE, negative_eigenvalues, one_thread, scaled, shared
from femsub.checks import Array, Matrix, Tally
from femsub.errors import (
    ConditionWarning,
    FemsubWarning,
    InputError,
    MissedModesError,
    NotConvergedError,
    NotEnoughMemoryError,
    SingularMatrixError,
    warn,
)
from femsub.model import beyond, in_band
from femsub.modes.normal_modes import modes_under
from femsub.modes.quadratic import damping_split, dense, disc_count
from femsub.modes.quadratic.bars import mended
from femsub.modes.quadratic.disc_count import Edge
from femsub.modes.quadratic.matching import clear_radius, distinct
from femsub.modes.quadratic.projected_count import Projection, Varied, about_radius
from femsub.modes.quadratic.projected_pairs import left_vectors, right_pairs
from femsub.modes.quadratic.region import Box, Contour, Count, listed
from femsub.modes.quadratic.singular_mass import finite
from femsub.modes.quadratic.sparse import KEPT, Search, Shifted
from femsub.modes.quadratic.winding_count import clear_of, missed_eigenvalues, undamped_reference

if TYPE_CHECKING:
    from femsub.model import Pencil
    from femsub.modes.quadratic.region import Region

log = logging.getLogger(__name__)


def by_pep(size: int, ask: int, columns: int = 0) -> float:
    """The cost of `ask` of the 2n eigenvalues, and of their count where contacts and dashpots have so many `columns`."""
    x = ask / size
    return x * (1.2 + x * (13.0 + x * 22.0 * columns)) / 6.0  # ns; see above


class Budget:
    """What searches by PEP may cost before LAPACK is asked for all eigenvalues; without a limit of a model too large for it.

    A sparse model may take all of LAPACK's cost: its solves cost next to nothing, and its counts are cheap. A dense one may take
    this `share` of it: if the search fails, so much is lost, and LAPACK comes after it.
    """

    def __init__(self, size: int, is_dense: bool, is_limited: bool = True, share: float = 0.1) -> None:
        self.size, self.is_dense, self.is_limited = size, is_dense, is_limited
        self.left = (share if is_dense else 1.0) if is_limited else float("inf")

    def covers(self, ask: int, columns: int = 0) -> bool:
        """Whether a search for `ask` eigenvalues is within the budget."""
        return by_pep(self.size, ask, columns) <= self.left

    def spend(self, ask: int, columns: int = 0) -> bool:
        """The same, and take its cost from what is left."""
        self.left -= by_pep(self.size, ask, columns)
        return self.left >= 0


class SearchResult(NamedTuple):
    """λ (k,), X and Y (n, k), including all in the region; the evidence of completeness, with the count if there is
    one; and all λ that were found, also outside the region.
    """

    values: Array
    X: Array
    Y: Array
    known: Array
    tally: Tally
    counted: Count | None = None


def projection_over(pencil: Pencil, changes: Sequence[Varied], band: tuple[float, float]) -> Projection | None:
    """One projection that counts in a band for all values of a parameter, which makes these changes of a pencil; None if none.

    `search` takes it where it is `Projection.changed` for a value, and `pencil` has the units of that value's pencil.
    """
    why = "LAPACK finds all of its eigenvalues" if not pencil.is_sparse or pencil.size <= SMALL else \
        "it has Lagrange multipliers" if pencil.freed is not None else ""
    alike = pencil if why else pencil.alike()
    if alike is not pencil:
        changes = [change._replace(matrix=scaled(change.matrix, *pencil.units)) for change in changes]
    try:
        if not why:
            return Projection(alike, _around((-band[1], band[1], *band)), _most_shapes(pencil.size), changes)
    except (SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError) as error:
        why = str(error)
    log.info("no projection for all values of the parameter, each is solved alone: %s", why)
    return None


def _around(box: Box) -> Contour:
    """The contour around a rectangle whose edges may move by up to 2 %, from the real axis on."""
    a, b, _, hi = box
    return Contour(sides=(a - 0.02 * hi, b + 0.02 * hi, 1.02 * hi))


def _most_shapes(size: int) -> int:
    """Shapes of a projection: two of its eigenproblems, the usual number, cost no more than all eigenvalues by LAPACK."""
    return int(size * 0.5 ** (1 / 3)) if size <= QUADRATIC else QUADRATIC


def search(pencil: Pencil, region: Region, evidence: bool | None, projection: Projection | None = None) -> SearchResult:
    """Search by LAPACK if that is faster, or if most eigenvalues are wanted; else by PEP. Multipliers are projected out first.

    A model of up to 2,000 DOF is searched by PEP where that is predicted to be cheaper (`cost`) and gives a count; a dense one
    where it takes a tenth of LAPACK's time. Else LAPACK finds all eigenvalues, and so certifies them. A `projection` that
    other values of a parameter share counts, if it can.
    """
    if projection is not None:
        found = _in_units(pencil, region, evidence, Budget(pencil.size, False, pencil.size <= QUADRATIC), projection)
        if found is not None:
            return found
    if (freed := pencil.freed) is not None:
        found = _searched(freed.pencil, region.at_most(2 * freed.pencil.size), evidence, pencil)
        X, Y = freed.shapes(found.values, found.X, found.Y)
        return found._replace(X=X, Y=Y)
    return _searched(pencil, region, evidence, pencil)


def _searched(pencil: Pencil, region: Region, evidence: bool | None, given: Pencil) -> SearchResult:
    """The same without multipliers; `given` is the pencil with them."""
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    many = (region.count or 0) > pencil.size / 2 and pencil.size <= QUADRATIC
    if region.is_all or (not pencil.is_sparse and (small or many)):
        return _by_lapack(pencil, given)
    if not pencil.is_sparse:  # where a search is predicted to cost much less than all eigenvalues
        budget, least = Budget(pencil.size, True), region.count or 0
        if region.box is not None:  # about the number to be found: the undamped ones in the disc around the rectangle
            a, b, _, hi = region.box
            radius = float(np.hypot(max(abs(a), abs(b)), hi))
            least = 2 * pencil.size
            if np.isfinite(radius):
                least = 2 * negative_eigenvalues(pencil.symmetric_stiffness - radius**2 * pencil.M) if pencil.symmetric[0] else 0
        found = _in_units(pencil.sparse(), region, evidence, budget) if budget.covers(least) else None
        return found or _by_lapack(pencil, given)
    if not small and not many:
        found = _in_units(pencil, region, evidence, Budget(pencil.size, False, pencil.size <= QUADRATIC))
        if found is not None:
            return found
    found = _by_lapack(pencil, given)
    at = region.listed(found.values)  # those that are asked for are mended
    at = at[found.values[at].imag >= 0]
    values, X, Y, done, vague = mended(pencil, found.values[at], found.X[:, at], found.Y[:, at])
    if vague.any():
        found = found._replace(tally=Tally(found.tally.listed - int(vague.sum()), found.tally.counted))
    every, right, left = found.values.copy(), found.X.astype(complex), found.Y.astype(complex)
    for k, value, x, y in zip(at[done], values[done], X.T[done], Y.T[done], strict=True):
        other = np.flatnonzero(found.values == found.values[k].conj())[:1 if found.values[k].imag else 0]
        every[k], right[:, k], left[:, k] = value, x, y
        every[other], right[:, other], left[:, other] = value.conj(), x.conj()[:, None], y.conj()[:, None]
    return found._replace(values=every, X=right, Y=left, known=every)


def _in_units(pencil: Pencil, region: Region, evidence: bool | None, budget: Budget, projection: Projection | None = None
              ) -> SearchResult | None:
    """By PEP on a sparse pencil, whose DOF it scales to similar size."""
    alike = pencil.alike()
    found = _by_pep(alike, region, evidence, budget, pencil, projection)
    if found is None or alike is pencil:
        return found
    X, Y = pencil.restored(found.X, found.Y)
    return found._replace(X=X, Y=Y)


def _by_lapack(pencil: Pencil, given: Pencil) -> SearchResult:
    """All eigenvalues: 2n, or fewer if M is singular, since some are infinite then. Their number follows from ranks."""
    n = pencil.size
    log.debug("quadratic problem of %d DOF: all eigenvalues by LAPACK", n)
    values, X, Y = dense.solve(pencil.dense())
    with one_thread(n <= FEW):
        number = finite(given.dense())
    if number is None:
        warn("the number of finite eigenvalues is not known: M or D has a rank that depends on rounding, or a constraint holds "
             f"velocities. {len(values)} eigenvalues were found, and others may be missing. Set masses and damping that are "
             "rounding to 0, or scale the matrices", ConditionWarning)
    elif len(values) != number:
        raise MissedModesError(f"{len(values)} eigenvalues were found, but there are {number}, by the ranks of M and D. Check "
                               "the scaling of M, D and K")
    return SearchResult(values, X, Y, values, Tally(len(values), number))


def _by_pep(pencil: Pencil, region: Region, evidence: bool | None, budget: Budget, given: Pencil,
            projection: Projection | None = None) -> SearchResult | None:
    """Search for more and more eigenvalues nearest to 0, until the certificate shows that the region is complete.

    None where LAPACK is to find all: the budget does not last, or a model that is small enough has no other count, or PEP fails
    on it. `given` is the pencil in its own units.

    Warns
    -----
    FemsubWarning
        No count was possible; with the reason.
    """
    proof = budget.is_limited and (region.box is not None or not budget.is_dense if evidence is None else evidence)
    if budget.is_dense and damping_split.split(pencil) is None:
        if proof:
            return None  # any other count of a full matrix would cost more than all eigenvalues
        evidence = False
    certificate = _Nearest(pencil, region.count or 0, evidence, given) if region.box is None else \
        _Enclosed(pencil, region.box, evidence, not budget.is_limited, projection)
    if proof and not certificate.can_count:
        return None
    # no more than one search is made where nobody can check it, unless it is asked for
    hasty = evidence is None and certificate.wanted and not certificate.can_count
    columns = 0 if certificate.parts is None else certificate.parts.W.shape[1]
    searched = Search(lambda ask, seed: certificate.problem.nearest(ask, seed), pencil.size)
    while certificate.pairs is None:
        if certificate.ask > certificate.most:
            if pencil.size <= QUADRATIC:  # more than half of all
                return None
            raise InputError(
                f"the disc around 0 that holds the band has about {certificate.ask} eigenvalues. The solver has to compute "
                f"all of them, and the limit is {certificate.most:g}. Lower the band, narrow re=(a, b), or reduce the model")
        if searched.ask != certificate.ask and not budget.spend(certificate.ask, columns):
            return None
        log.debug("quadratic problem of %d DOF: %d eigenvalues by PEP", pencil.size, certificate.ask)
        try:
            values, X = searched.found(certificate.ask)
            if certificate.is_short(values):
                continue
            missed = certificate.missed(values, X)
        except NotConvergedError:
            if pencil.size <= QUADRATIC:
                return None
            if not certificate.is_found_uncounted():
                raise
            continue
        if missed is None and proof:
            return None
        if missed == 0 or (missed is None and (hasty or searched.settled())):
            break
        if missed is None:
            continue
        if missed < 0 or searched.exhausted:
            if pencil.size <= QUADRATIC:
                return None
            raise MissedModesError(certificate.lacking(missed))
        certificate.ask = searched.more(certificate.ask, missed)
    values, X = certificate.pairs or searched.pool
    if certificate.pairs is not None:
        certificate.missed(values, X)  # none, but for the tally
    # mended where an error beside ‖D‖ may be large; what is then listed is compared with the count once more, since a λ far off
    # may have been counted in place of another one
    at, done, left = certificate.about(values), np.zeros(len(values), dtype=bool), np.zeros(X.shape, dtype=complex)
    mass, damping, stiffness = (np.abs(part.diagonal()) for part in (pencil.M, pencil.D, pencil.K))
    # an error beside ‖D‖ takes two digits of λ where d_ii is a hundred times sqrt(m_ii k_ii): then a large model is mended, too
    if pencil.size <= QUADRATIC or (pencil.size <= KEPT and (damping > 100 * np.sqrt(mass * stiffness)).any()):
        better = mended(pencil, values[at], X[:, at], left[:, at])
        values, X = values.copy(), X.astype(complex)
        values[at], X[:, at], left[:, at], done[at] = better.values, better.X, better.Y, better.done
        certificate.again(values, int(better.vague.sum()))
    if certificate.tally.counted not in (None, certificate.tally.listed) and pencil.size <= QUADRATIC:
        return None  # some of those that were counted are none
    if certificate.tally.counted is None and certificate.why:
        warn(f"no count shows that no eigenvalue is missing: {certificate.why}. "
             + ("Give evidence=True to sample the winding number of det P, or a lower band" if region.box is not None
                else "Ask for a band with evidence=True, where the winding number of det P is sampled" if certificate.wanted
                else "Give evidence=True"), FemsubWarning)
    taken, mirrored = certificate.taken(values)
    near, X = values[taken], X[:, taken]
    own = certificate.left(near, X)
    if own is None:
        own = certificate.problem.left(near, X, searched.ask or certificate.ask, searched.searches)
    Y = np.where(done[taken], left[:, taken], own)
    near, X, Y = (np.concatenate([part, part[..., mirrored].conj()], axis=-1) for part in (near, X, Y))
    return SearchResult(near, X, Y, certificate.known(values), certificate.tally, certificate.counted)


class _Evidence:
    """The count in a disc around 0, for a pencil with proportional damping except in a few columns; for others by projection."""

    def __init__(self, pencil: Pencil, wanted: bool) -> None:
        self.pencil, self.wanted = pencil, wanted
        self.counted: Count | None = None
        self.count: Count | None = None  # by a projection before the search
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

    def projected(self, outer: Contour, inside: Callable[[Array], Contour]) -> Count | None:
        """The count by projection, for any damping; `inside` chooses the contour from the projection's eigenvalues."""
        if not self.wanted or not np.isfinite(outer.size):
            return None
        if self.projection is not None:  # for all values of a parameter
            found = self.projection.on(inside)
            if found is not None:
                return found
            log.info("no count by the projection for all values of the parameter, so this one is solved alone: %s",
                     self.projection.why)
        try:
            self.projection = Projection(self.pencil, outer, _most_shapes(self.pencil.size))
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
        if self.pairs is None or self.counted is None:
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
        self.counted, parts = None, self.parts
        if at is not None and parts is not None:
            inside, found = X[:, np.abs(values) <= at.radius], None
            if parts.K0 is self.pencil.K and self.problem.definite is not None:  # an existing factor
                found = disc_count.count(parts, at, *self.problem.definite, inside)
            if found is None or found.margin >= 1:
                with suppress(SingularMatrixError):
                    found = disc_count.count(parts, at, *disc_count.definite(parts, at.radius), inside)
            self.counted = found if found is not None and found.margin < 1 else None
        return self.lacked(values)

    def lacked(self, values: Array) -> int | None:
        """How many the count has more than are found; None without a count."""
        if self.counted is None:
            self.tally = Tally(listed(values))
            return None
        self.tally = self.counted.tally(values)
        return self.counted.number - self.tally.listed

    def again(self, values: Array, vague: int) -> None:
        """The tally of values that are known better now, without those that may be no eigenvalues."""
        if self.counted is not None:
            self.tally = self.counted.tally(values)
        self.tally = replace(self.tally, listed=self.tally.listed - vague)

    def lacking(self, missed: int) -> str:
        """The message of the error if eigenvalues are missing."""
        if self.counted is None:
            return (f"{missed} eigenvalues in or near the band are missing, by the winding number of det P. Shift the band a "
                    "little, or narrow re=(a, b)")
        count = self.counted
        return (f"{count.number - missed} eigenvalues were found in {count.contour.where}, but an independent count gives "
                f"{count.number}. Ask for more or fewer, or for another band")


class _Nearest(_Evidence):
    """The `number` eigenvalues nearest to 0, conjugates included, and a disc that contains them."""

    most = np.inf

    def __init__(self, pencil: Pencil, number: int, evidence: bool | None, given: Pencil) -> None:
        wanted = pencil.size <= KEPT if evidence is None else evidence
        super().__init__(pencil, wanted)
        self.number, self.unasked = number, evidence is None
        if self.unasked and not wanted:
            self.why = f"the model has {pencil.size} DOF, and above {KEPT} none is made unasked, because of its second factor"
        self.tried = wanted and self.parts is None and pencil.is_sparse and pencil.size > QUADRATIC
        if self.tried:  # a disc is widened until it holds the nearest; in the units given a uniform motion is one of a body
            radii: list[float] = []
            try:
                radii = (about_radius(given, number) * np.array([1.0, 1.25, 1.5])).tolist()  # the first is mostly wide enough
            except (SingularMatrixError, NotConvergedError, NotEnoughMemoryError) as error:
                self.why = f"the radius of a disc with {number} eigenvalues is not known: {error}"
            for radius in radii:
                self.short = False
                self.count = self.projected(Contour(radius), partial(self._behind, Contour(radius)))
                if not self.short:
                    break
            self.pairs = self._pairs()
        # The eigenvalues nearest to a shift are not exactly those nearest to 0, so a few more are computed. A count needs a
        # gap behind the last one, and therefore the next one.
        self.ask = number + (0 if self.pairs else 12 if self.problem.shift else 0) + (2 if wanted else 0)

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


class _Enclosed(_Evidence):
    """All eigenvalues in a rectangle, proved by projection, by the count in the disc around it, or by the winding of det P.

    The projection comes first: it gives the eigenpairs as well and is a proof, which the determinant of a disc is not. TOAR
    computes `most` eigenvalues: beyond, run times reach hours and backward errors grow.
    """

    def __init__(self, pencil: Pencil, box: Box, evidence: bool | None, winding: bool = True,
                 projection: Projection | None = None, most: int = 1500) -> None:
        super().__init__(pencil, evidence is not False)
        self.projection = projection
        self.box, self.most = box, float(min(pencil.size, most))
        self.wound = winding and bool(evidence)  # whether det P may be sampled
        self.count = self.projected(_around(box), self._clear)
        self.pairs = self._pairs()
        self.at = self.edge(self._radius) if self.count is None else None
        if self.count is not None:  # only the eigenvalues up to the farthest in the rectangle are needed
            size = np.abs(self.count.values)
            self.radius = 1.001 * float(size[self.count.contour.encloses(self.count.values)].max(initial=0.0))
            self.radius += 0.0 if self.pairs else self.problem.shift
            self.ask = int(np.count_nonzero(size <= self.radius)) + 8
        else:
            self.radius = self._radius
            below = 10  # about the number of undamped modes in the disc
            if self.at is not None:
                below = self.at.below
            elif self.wound:
                below = 10 if self.reference is None else len(self.reference[1])
            elif pencil.symmetric[0]:
                with suppress(SingularMatrixError):
                    below = modes_under(pencil.symmetric_stiffness, pencil.M, self.radius**2)
            self.ask = 2 * below + 12

    @property
    def _radius(self) -> float:
        """Of the disc around 0, or around a shift, that holds the rectangle; its edges may move out by 2 %."""
        a, b, _, hi = self.box
        return 1.03 * float(np.hypot(max(abs(a), abs(b)), hi)) + self.problem.shift

    def _clear(self, values: Array) -> Contour:
        """The rectangle with its edges moved away from the eigenvalues of the projection."""
        left, right, _, top = clear_of(values[values.imag >= 0], self.box)
        return Contour(sides=(left, right, top))

    @cached_property
    def reference(self) -> tuple[Matrix, Array] | None:
        """See `undamped_reference`."""
        return undamped_reference(self.pencil, self.radius)

    def is_short(self, values: Array) -> bool:
        """Whether the disc around the rectangle may contain more eigenvalues; then `ask` is increased."""
        pencil = self.pencil
        if np.abs(values - self.problem.shift).max() >= self.radius or listed(values) >= 2 * pencil.size:
            return False
        self.ask = int(min(2 * self.ask, self.most) if self.ask < self.most else self.most + 1)
        return True

    def missed(self, values: Array, X: Array) -> int | None:
        """As for `_Nearest`."""
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
        """As for `_Nearest`: those in the rectangle and within a hundredth of its size beside it."""
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
