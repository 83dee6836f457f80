"""The eigenpairs in a region of the spectrum: all by LAPACK, or by PEP until an independent count shows that none is missing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import Array, Tally
from femsub.errors import ConditionWarning, InputError, MissedModesError, NotConvergedError, warn
from femsub.linalg.factor import QUADRATIC, SMALL, WIDE, negative_eigenvalues
from femsub.linalg.threads import FEW, one_thread
from femsub.quadratic import damping_split, dense
from femsub.quadratic.certificate import MOST, Enclosed, Nearest
from femsub.quadratic.cost import Budget
from femsub.quadratic.multiplicity import Search
from femsub.quadratic.singular_mass import finite
from femsub.quadratic.sparse import Shifted

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil
    from femsub.quadratic.disc_count import Count
    from femsub.quadratic.region import Region

log = logging.getLogger(__name__)


class Found(NamedTuple):
    """λ (k,), X and Y (n, k), including all in the region; the evidence of completeness, with the count in a disc if there is
    one; and all λ that were found, also outside the region.
    """

    values: Array
    X: Array
    Y: Array
    known: Array
    tally: Tally
    counted: Count | None = None


def search(pencil: Pencil, region: Region, certify: bool | None) -> Found:
    """Search by LAPACK if that is faster, or if most eigenvalues are wanted; else by PEP. Multipliers are projected out first.

    A dense model is searched by PEP only where that is predicted to take a tenth of LAPACK's time (`cost`).
    """
    if (freed := pencil.freed) is not None:
        found = _searched(freed.pencil, region.at_most(2 * freed.pencil.size), certify, pencil)
        X, Y = freed.shapes(found.values, found.X, found.Y)
        return found._replace(X=X, Y=Y)
    return _searched(pencil, region, certify, pencil)


def _searched(pencil: Pencil, region: Region, certify: bool | None, given: Pencil) -> Found:
    """The same without multipliers; `given` is the pencil with them."""
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    many = (region.count or 0) > pencil.size / 2 and pencil.size <= QUADRATIC
    if small or many or region.is_all:
        return _by_lapack(pencil, given)
    budget = Budget(pencil.size, not pencil.is_sparse)
    if budget.is_limited and not budget.covers(_least(pencil, region)):
        return _by_lapack(pencil, given)
    sparse = pencil.sparse()
    alike = sparse.alike()
    found = _by_pep(alike, region, certify, budget)
    if found is None:
        return _by_lapack(pencil, given)
    if alike is sparse:
        return found
    X, Y = sparse.restored(found.X, found.Y)
    return found._replace(X=X, Y=Y)


def _least(pencil: Pencil, region: Region) -> int:
    """About the number of eigenvalues that PEP must find: the undamped ones in the disc around a rectangle."""
    if region.box is None:
        return region.count or 0
    a, b, _, hi = region.box
    radius = float(np.hypot(max(abs(a), abs(b)), hi))
    if not np.isfinite(radius):
        return 2 * pencil.size
    return 2 * negative_eigenvalues(pencil.symmetric_stiffness - radius**2 * pencil.M) if pencil.symmetric[0] else 0


def _by_lapack(pencil: Pencil, given: Pencil) -> Found:
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
    return Found(values, X, Y, values, Tally(len(values), number))


def _by_pep(pencil: Pencil, region: Region, certify: bool | None, budget: Budget) -> Found | None:
    """Search for more and more eigenvalues nearest to 0, until the certificate shows that the region is complete.

    None where LAPACK is to find all: the budget does not last, a dense model can only be certified so, or PEP fails on a model
    that is small enough.
    """
    proof = budget.is_limited and (region.box is not None if certify is None else certify)
    if proof and damping_split.split(pencil) is None:
        return None  # the winding number of a full matrix would cost more than all eigenvalues
    problem = Shifted(pencil)
    certificate = Nearest(problem, region.count or 0, certify) if region.box is None else \
        Enclosed(problem, region.box, certify, not budget.is_limited)
    columns = 0 if certificate.parts is None else certificate.parts.W.shape[1]
    searched = Search(problem.nearest, pencil.size)
    while True:
        if certificate.ask > certificate.most:
            if pencil.size <= QUADRATIC:  # more than half of all
                return None
            raise InputError(
                f"the disc around 0 that holds the band has about {certificate.ask} eigenvalues. The solver has to compute "
                f"all of them, and the limit is {MOST}. Lower the band, narrow re=(a, b), or reduce the model")
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
            if not certificate.is_found_without_proof():
                raise
            continue
        if missed is None and proof:
            return None
        if missed == 0 or (missed is None and searched.settled()):
            break
        if missed is None:
            continue
        if missed < 0 or searched.exhausted:
            if pencil.size <= QUADRATIC:
                return None
            raise MissedModesError(certificate.lacking(missed))
        certificate.ask = searched.more(certificate.ask, missed)
    taken, mirrored = certificate.taken(values)
    near, X = values[taken], X[:, taken]
    Y = problem.left(near, X, searched.ask, searched.searches)
    near, X, Y = (np.concatenate([part, part[..., mirrored].conj()], axis=-1) for part in (near, X, Y))
    return Found(near, X, Y, values, certificate.tally, certificate.counted)
