"""The eigenpairs in a region of the spectrum: all by LAPACK, or some, until an independent count shows that none is missing.

The count comes from a projection on undamped modes with an error bound (`projected_count`), for any damping. The projection gives
the eigenpairs as well: each is corrected until it solves the full problem, and none is listed twice. If no projection can count,
LAPACK finds all eigenvalues of a model that is small enough. In a larger model PEP searches for the eigenvalues nearest to 0.
Then only inertia can count: for a part with proportional damping, or an undamped rotating part.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.linalg import LinAlgError

from femsub.algebra import FEW, QUADRATIC, SMALL, WIDE, one_thread, scaled
from femsub.checks import (
    EPS,
    Array,
    ConditionWarning,
    FemsubWarning,
    MissedModesError,
    NotEnoughMemoryError,
    SingularMatrixError,
    Tally,
    warn,
)
from femsub.modes.quadratic import dense
from femsub.modes.quadratic.bars import mended
from femsub.modes.quadratic.matching import clear_radius, distinct
from femsub.modes.quadratic.projected_count import UNCOUNTED, Projection, Varied, about_radius
from femsub.modes.quadratic.projected_pairs import TOGETHER, left_vectors, right_pairs
from femsub.modes.quadratic.region import Box, Contour, Count, Region, listed, sizes_up_to
from femsub.modes.quadratic.singular_mass import finite
from femsub.modes.quadratic.sparse import Shifted

if TYPE_CHECKING:
    from femsub.model import Affine, Pencil

log = logging.getLogger(__name__)

KEPT = 200_000  # DOF up to which a `count` is proved by default; in larger models the second factor takes too much memory
ROOM = 0.02  # share of a box's top by which its edges may move out, to keep clear of eigenvalues
FEWER = "too few eigenvalues in the disc"


class SearchResult(NamedTuple):
    """λ (k,), X and Y (n, k), including all eigenpairs in the region.

    `known` are all λ found, also outside the region. `tally` and `counted` are the evidence that no eigenvalue is missing.
    """

    values: Array
    X: Array
    Y: Array
    known: Array
    tally: Tally
    counted: Count | None = None


def search(pencil: Pencil, region: Region, evidence: bool | None, projection: Projection | None = None) -> SearchResult:
    """The eigenpairs in a region, by LAPACK if that is faster, or if most eigenvalues are wanted. Multipliers are projected out.

    A given `projection`, which several values of a parameter share, is tried first for the count.
    """
    freed = pencil.freed
    given, pencil = pencil, pencil if freed is None else freed.pencil
    region = region.at_most(2 * pencil.size)
    many = region.is_all or (region.count or 0) > pencil.size / 2
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    found = None if small or (many and pencil.size <= QUADRATIC) or region.is_all else _some(pencil, region, evidence, projection)
    if found is None:
        found = _all(pencil, region, given)
    if freed is None:
        return found
    X, Y = freed.shapes(found.values, found.X, found.Y)
    return found._replace(X=X, Y=Y)


def _all(pencil: Pencil, region: Region, given: Pencil) -> SearchResult:
    """All eigenvalues by LAPACK: 2n, or fewer if M is singular, since some are infinite then. Their number follows from ranks.

    `given` is the pencil with its multipliers.
    """
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
    if not pencil.is_sparse or region.is_all:
        return SearchResult(values, X, Y, values, Tally(len(values), number))
    at = region.listed(values)  # only requested eigenpairs are corrected
    at = at[values[at].imag >= 0]
    better = mended(pencil, values[at], X[:, at], Y[:, at])
    every, X, Y = values.copy(), X.astype(complex), Y.astype(complex)
    for k, value, x, y in zip(at[better.done], better.values[better.done], better.X.T[better.done], better.Y.T[better.done],
                              strict=True):
        other = np.flatnonzero(values == values[k].conj())[:1 if values[k].imag else 0]
        every[k], X[:, k], Y[:, k] = value, x, y
        every[other], X[:, other], Y[:, other] = value.conj(), x.conj()[:, None], y.conj()[:, None]
    return SearchResult(every, X, Y, every, Tally(len(values) - int(better.vague.sum()), number))


def _some(given: Pencil, region: Region, evidence: bool | None, projection: Projection | None) -> SearchResult | None:
    """The eigenpairs in a region of a sparse or large pencil; None if LAPACK has to find all eigenpairs.

    Warns
    -----
    FemsubWarning
        No count was possible; with the reason.
    """
    sparse = given.sparse()
    pencil = sparse.alike()  # with DOF scaled to similar size
    small = not given.is_sparse or given.size <= QUADRATIC  # small enough for LAPACK, if there is no count
    wanted = small or (evidence if evidence is not None else region.box is not None or pencil.size <= KEPT)
    # the count, and the eigenpairs from it
    count, pairs, why = None, None, ""
    if wanted:
        for _ in range(2):
            projection, count, why = _counted(pencil, region, projection)
            pairs = None if count is None or projection is None else _corrected(projection, pencil, count, region)
            if pairs is not None or projection is None or not _widened(projection):
                break
    elif evidence is None:
        why = f"the model has {pencil.size} DOF, and above {KEPT} none is made unasked, because of its second factor"
    if pairs is None and small:
        return None
    # else PEP searches. If a count was tried by default and failed, it searches once, since nothing checks the result
    problem = None
    if pairs is None:
        log.debug("quadratic problem of %d DOF: eigenvalues by PEP", pencil.size)
        problem = Shifted(pencil)
        values, X, count = problem.search(region, count, evidence is not None or not wanted)
    else:
        values, X = pairs
    tally = Tally(listed(values)) if count is None else count.tally(values)
    # correct pairs where an error that is small relative to ‖D‖ may be large for λ: two digits are lost where d_ii is a hundred
    # times sqrt(m_ii k_ii)
    at, done, left = region.beside(values), np.zeros(len(values), dtype=bool), np.zeros(X.shape, dtype=complex)
    mass, damping, stiffness = (np.abs(part.diagonal()) for part in (pencil.M, pencil.D, pencil.K))
    if small or (pencil.size <= KEPT and (damping > 100 * np.sqrt(mass * stiffness)).any()):
        better = mended(pencil, values[at], X[:, at], left[:, at])
        values, X = values.copy(), X.astype(complex)
        values[at], X[:, at], left[:, at], done[at] = better.values, better.X, better.Y, better.done
        # again: a λ that was far off may have been counted in place of another one, or may be no eigenvalue
        tally = tally if count is None else count.tally(values)
        tally = replace(tally, listed=tally.listed - int(better.vague.sum()))
    if small and tally.counted != tally.listed:
        return None
    if tally.counted is None and why:
        warn(f"no count shows that no eigenvalue is missing: {why}. " + (
            "Give evidence=True" if not wanted else "Ask for a lower band, or reduce the model"), FemsubWarning)
    # left vectors of the listed eigenvalues, and conjugates
    known = values if count is None else np.append(values, count.values[~count.contour.encloses(count.values)])
    taken = region.upper(values)
    values, X, left, done = values[taken], X[:, taken], left[:, taken], done[taken]
    Y = X.conj() if all(pencil.symmetric) else None
    if Y is None and projection is not None and projection.counted is not None and tally.listed == tally.counted:
        with suppress(LinAlgError, NotEnoughMemoryError):
            Y = left_vectors(projection.counted, pencil, values, X)
    if Y is None:
        problem = problem or Shifted(pencil)
        Y = problem.left(values, X, listed(known[np.abs(known) <= np.abs(values).max(initial=0.0) + 2 * problem.shift]) + 8)
    Y = np.where(done, left, Y)
    twice = np.flatnonzero(values.imag)
    values, X, Y = (np.concatenate([part, part[..., twice].conj()], axis=-1) for part in (values, X, Y))
    at = region.listed(values)
    values, X, Y = values[at], X[:, at], Y[:, at]
    X, Y = (X, Y) if pencil is sparse else sparse.restored(X, Y)
    return SearchResult(values, X, Y, known, tally, count)


def _counted(pencil: Pencil, region: Region, projection: Projection | None) -> tuple[Projection | None, Count | None, str]:
    """A projection and its count in a contour around the region, or the reason for none. A given projection is tried first."""
    outer = _around(region.box) if region.box is not None else Contour()
    inside = partial(_inside, region, outer)
    if projection is not None:
        count = projection.on(inside)
        if count is not None:
            return projection, count, ""
        log.info("no count by the projection for all values of the parameter, so this one is solved alone: %s", projection.why)
    if not np.isfinite(outer.size):
        return None, None, "the band has no end"
    why, modes = "", None
    try:
        if region.box is None:
            radius, modes = about_radius(pencil, region.count or 0)
        # a projection usually takes two eigenproblems; with this limit they cost no more than all eigenvalues by LAPACK
        most = int(pencil.size * 0.5 ** (1 / 3)) if pencil.size <= QUADRATIC else QUADRATIC
        for wider in (1.0, 1.25, 1.5):  # the disc may contain too few eigenvalues; the first is mostly wide enough
            if region.box is None:
                outer = Contour(wider * radius)
            projection = Projection(pencil, outer, most, lowest=modes)
            count = projection.on(partial(_inside, region, outer))
            if count is not None:
                return projection, count, ""
            why = projection.why
            if why != FEWER:
                break
    except UNCOUNTED as error:
        why = str(error)
    log.info("no count by projection: %s", why)
    return None, None, why


def _inside(region: Region, outer: Contour, values: Array, moved: Array, room: float = ROOM) -> Contour:
    """The contour for the count, between eigenvalues of the projection: just beyond the nearest ones, or around the box.

    Parameters move each eigenvalue by up to `moved`. An edge of a box moves out by up to `room`.

    Raises LinAlgError, as if there were no projection, if the disc has fewer eigenvalues than wanted.
    """
    if region.box is None:
        size, last = sizes_up_to(values[outer.encloses(values)], region.count or 0)
        if last + 1 >= len(size):
            raise LinAlgError(FEWER)
        return Contour(clear_radius(size, last + 1))
    upper, moved = values[values.imag >= 0], moved[values.imag >= 0]
    a, b, _, hi = region.box
    moves = np.linspace(0.002, room, 10 * round(room / ROOM)) * hi

    def best(edges: Array, coordinates: Array, beside: Array) -> float:
        distance = np.hypot(edges[:, None] - coordinates, np.maximum(beside, EPS * hi))
        near = room * hi / 40 / distance.min(axis=1, initial=np.inf) + (moved / distance).sum(axis=1)  # moves add up
        return float(edges[np.argmax(near <= 1.1 * near.min()) if moved.any() else np.argmin(near)])  # the nearest good edge

    above, off = upper.imag - hi, np.maximum(a - upper.real, upper.real - b)
    return Contour(sides=(best(a - moves, upper.real, above), best(b + moves, upper.real, above),
                          best(hi + moves, upper.imag, off)))


def _corrected(projection: Projection, pencil: Pencil, count: Count, region: Region) -> tuple[Array, Array] | None:
    """All eigenpairs inside the contour, corrected from those of the projection; None if their number is not the count.

    If the wanted number ends inside a cluster, the contour of the count lies below the cluster, whose pairs are corrected as
    well.
    """
    small = copy(projection.counted)
    if small is not None:
        if region.box is None:
            size, last = sizes_up_to(count.values, region.count or 0)
            apart = np.flatnonzero(np.diff(size[last:]) > TOGETHER * size[last + 1:])
            beyond = size[last + (apart[0] if len(apart) else 0)] * (1 + TOGETHER / 2)
            small.contour = Contour(max(small.contour.radius, float(beyond)))
        with suppress(LinAlgError, NotEnoughMemoryError):
            found = right_pairs(small, pencil)
            found = None if found is None else distinct(*found)  # two may have become the same
            if found is not None and count.tally(found[0]).listed == count.number:
                return found
            log.info("corrections of the %d eigenpairs of the projection do not converge", count.number)
    return None


def _widened(projection: Projection) -> bool:
    """Extend V by residuals of the eigenpairs in the last contour; return whether it has grown.

    Friction that acts outside V may keep corrections from converging.
    """
    small = projection.counted
    if small is None:
        return False
    at = np.flatnonzero(small.contour.encloses(small.each) & (small.each.imag >= 0))
    if (size := projection.size + 4 * len(at)) > projection.most:  # real and imaginary parts, right and left
        log.info("a basis of %d shapes might let them converge, and the limit is %d", size, projection.most)
        return False
    with suppress(LinAlgError, NotEnoughMemoryError):
        residuals = [projection.residuals(small.each[at], side[:, at], side is small.z) for side in (small.x, small.z)]
        return projection.add(np.hstack(residuals))
    return False


def projection_over(reference: Pencil | tuple[Affine, Array], changes: Sequence[Varied], box: Box, room: float = ROOM,
                    kept: bool = False) -> Projection:
    """One projection that counts in a rectangle for all values of the parameters that make these changes of a pencil.

    For one value, `search` takes its `Projection.changed`, if that value's pencil has the units of the reference. A reference
    given as a family with its factors is formed only temporarily. `kept` is as in `Projection`.

    Raises
    ------
    SingularMatrixError, MissedModesError, NotConvergedError, NotEnoughMemoryError
        No projection exists, see `Projection`.
    """
    pencil = reference[0].weighted(reference[1], by_slabs=True) if isinstance(reference, tuple) else reference
    if pencil.freed is not None:
        raise SingularMatrixError("the pencil has Lagrange multipliers. Eliminate the constraints, as primal coupling does")
    sparse = pencil.sparse()
    alike = sparse.alike()
    unit = sparse.units[1] if alike is not sparse else np.ones(pencil.size)
    changes = [change._replace(matrix=sp.csr_array(change.matrix) if alike is sparse else
                               scaled(sp.csr_array(change.matrix), *sparse.units)) for change in changes]
    sums, held = None, [alike]
    if isinstance(reference, tuple) and pencil.is_sparse and all(pencil.symmetric):
        sums = reference[0].sums(reference[1], unit)
    del pencil, sparse, alike  # Python holds the arguments of a call until it returns: so the projection pops the pencil
    found = Projection(held.pop, _around(box, room), min(len(unit), QUADRATIC), changes, kept=kept, sums=sums)
    found.unit = unit
    return found


def count_over(projection: Projection, box: Box, room: float = ROOM) -> Count | None:
    """The number of eigenvalues in a contour around a rectangle, for all changes θ ± half of the projection; None if not proved.

    Edges may move out by up to `room` times the top of the box, into gaps between eigenvalues as parameters move these.
    """
    return projection.on(partial(_inside, Region(box=box), _around(box, room), room=room))


def _around(box: Box, room: float = ROOM) -> Contour:
    """The contour around a rectangle whose edges may move out by up to `room` of its top, from the real axis on."""
    a, b, _, hi = box
    return Contour(sides=(a - room * hi, b + room * hi, (1 + room) * hi))
