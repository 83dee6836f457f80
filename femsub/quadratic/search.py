"""The eigenpairs in a region of the spectrum: all by LAPACK, or by PEP until an independent count shows that none is missing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import Array, Tally
from femsub.errors import ConditionWarning, InputError, MissedModesError, NotConvergedError, warn
from femsub.linalg.factor import QUADRATIC, SMALL, WIDE
from femsub.linalg.threads import FEW, one_thread
from femsub.model.matrices import unit_length
from femsub.quadratic import dense
from femsub.quadratic.certificate import MOST, Enclosed, Nearest
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
    """Search by LAPACK if that is faster, or if most eigenvalues are wanted; else by PEP. Multipliers are projected out first."""
    if (freed := pencil.freed) is not None:
        found = _searched(freed.pencil, region.at_most(2 * freed.pencil.size), certify, pencil)
        X, Y = freed.shapes(found.values, found.X, found.Y)
        return found._replace(X=X, Y=Y)
    return _searched(pencil, region, certify, pencil)


def _searched(pencil: Pencil, region: Region, certify: bool | None, given: Pencil) -> Found:
    """The same without multipliers; `given` is the pencil with them."""
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    many = (region.count or 0) > pencil.size / 2 and (pencil.size <= QUADRATIC or not pencil.is_sparse)
    if small or many or region.is_all:
        return _by_lapack(pencil, given)
    pencil = pencil.sparse()
    alike = pencil.alike()
    found = _by_pep(alike, region, certify, given)
    if alike is pencil:
        return found
    X, Y = (unit_length(unit[:, None] * vectors) for unit, vectors in zip(pencil.units[::-1], (found.X, found.Y), strict=True))
    return found._replace(X=X, Y=Y)


def _by_lapack(pencil: Pencil, given: Pencil) -> Found:
    """All eigenvalues: 2n, or fewer if M is singular, since some are infinite then. Their number follows from ranks."""
    n = pencil.size
    log.debug("quadratic problem of %d DOF: all eigenvalues by LAPACK", n)
    with one_thread(n <= FEW):
        values, X, Y = dense.solve(pencil.dense())
        number = finite(given.dense())
    if number is None:
        warn("the number of finite eigenvalues is not known: M or D has a rank that depends on rounding, or a constraint holds "
             f"velocities. {len(values)} eigenvalues were found, and others may be missing. Set masses and damping that are "
             "rounding to 0, or scale the matrices", ConditionWarning)
    elif len(values) != number:
        raise MissedModesError(f"{len(values)} eigenvalues were found, but there are {number}, by the ranks of M and D. Check "
                               "the scaling of M, D and K")
    return Found(values, X, Y, values, Tally(len(values), number))


def _by_pep(pencil: Pencil, region: Region, certify: bool | None, given: Pencil) -> Found:
    """Search for more and more eigenvalues nearest to 0, until the certificate shows that the region is complete."""
    problem = Shifted(pencil)
    certificate = Nearest(problem, region.count or 0, certify) if region.box is None else Enclosed(problem, region.box, certify)
    searched = Search(problem.nearest, pencil.size)
    while True:
        if certificate.ask > certificate.most:
            if pencil.size <= QUADRATIC:  # more than half of all
                return _by_lapack(pencil, given)
            raise InputError(
                f"the disc around 0 that holds the band has about {certificate.ask} eigenvalues. The solver has to compute "
                f"all of them, and the limit is {MOST}. Lower the band, narrow re=(a, b), or reduce the model")
        log.debug("quadratic problem of %d DOF: %d eigenvalues by PEP", pencil.size, certificate.ask)
        try:
            values, X = searched.found(certificate.ask)
            if certificate.is_short(values):
                continue
            missed = certificate.missed(values, X)
        except NotConvergedError:
            if pencil.size <= QUADRATIC:
                return _by_lapack(pencil, given)
            if not certificate.is_found_without_proof():
                raise
            continue
        if missed == 0 or (missed is None and searched.settled()):
            break
        if missed is None:
            continue
        if missed < 0 or searched.exhausted:
            if pencil.size <= QUADRATIC:
                return _by_lapack(pencil, given)
            raise MissedModesError(certificate.lacking(missed))
        certificate.ask = searched.more(certificate.ask, missed)
    taken, mirrored = certificate.taken(values)
    near, X = values[taken], X[:, taken]
    Y = problem.left(near, X, searched.ask, searched.searches)
    near, X, Y = (np.concatenate([part, part[..., mirrored].conj()], axis=-1) for part in (near, X, Y))
    return Found(near, X, Y, values, certificate.tally, certificate.counted)
