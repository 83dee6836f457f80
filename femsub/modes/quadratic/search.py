"""The eigenpairs in a region of the spectrum: all by LAPACK, or by PEP until an independent count shows that none is missing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.algebra import FEW, QUADRATIC, SMALL, WIDE, negative_eigenvalues, one_thread
from femsub.checks import Array, Tally
from femsub.errors import ConditionWarning, FemsubWarning, InputError, MissedModesError, NotConvergedError, warn
from femsub.modes.quadratic import damping_split, dense
from femsub.modes.quadratic.certificate import MOST, Enclosed, Nearest
from femsub.modes.quadratic.cost import Budget
from femsub.modes.quadratic.multiplicity import Search
from femsub.modes.quadratic.newton import mended
from femsub.modes.quadratic.singular_mass import finite
from femsub.modes.quadratic.sparse import KEPT

if TYPE_CHECKING:
    from femsub.model import Pencil
    from femsub.modes.quadratic.certificate import Counted
    from femsub.modes.quadratic.region import Region

log = logging.getLogger(__name__)

HEAVY = 100.0  # d_ii / sqrt(m_ii k_ii) from which on an error beside ‖D‖ is worth Newton steps on a large model


class Found(NamedTuple):
    """λ (k,), X and Y (n, k), including all in the region; the evidence of completeness, with the count if there is
    one; and all λ that were found, also outside the region.
    """

    values: Array
    X: Array
    Y: Array
    known: Array
    tally: Tally
    counted: Counted | None = None


def search(pencil: Pencil, region: Region, evidence: bool | None) -> Found:
    """Search by LAPACK if that is faster, or if most eigenvalues are wanted; else by PEP. Multipliers are projected out first.

    A model of up to 2,000 DOF is searched by PEP where that is predicted to be cheaper (`cost`) and gives a count; a dense one
    where it takes a tenth of LAPACK's time. Else LAPACK finds all eigenvalues, and so certifies them.
    """
    if (freed := pencil.freed) is not None:
        found = _searched(freed.pencil, region.at_most(2 * freed.pencil.size), evidence, pencil)
        X, Y = freed.shapes(found.values, found.X, found.Y)
        return found._replace(X=X, Y=Y)
    return _searched(pencil, region, evidence, pencil)


def _searched(pencil: Pencil, region: Region, evidence: bool | None, given: Pencil) -> Found:
    """The same without multipliers; `given` is the pencil with them."""
    small = pencil.size <= (SMALL if pencil.is_sparse else WIDE)
    many = (region.count or 0) > pencil.size / 2 and pencil.size <= QUADRATIC
    if region.is_all or (not pencil.is_sparse and (small or many)):
        return _by_lapack(pencil, given)
    if pencil.is_sparse:
        found = None if small or many else _in_units(
            pencil, region, evidence, Budget(pencil.size, False, pencil.size <= QUADRATIC))
        return found or _mended_by_lapack(pencil, given, region)
    budget = Budget(pencil.size, True)
    if not budget.covers(_least(pencil, region)):
        return _by_lapack(pencil, given)
    return _in_units(pencil.sparse(), region, evidence, budget) or _by_lapack(pencil, given)


def _in_units(pencil: Pencil, region: Region, evidence: bool | None, budget: Budget) -> Found | None:
    """By PEP on a sparse pencil, whose DOF it scales to similar size."""
    alike = pencil.alike()
    found = _by_pep(alike, region, evidence, budget, pencil)
    if found is None or alike is pencil:
        return found
    X, Y = pencil.restored(found.X, found.Y)
    return found._replace(X=X, Y=Y)


def _mended_by_lapack(pencil: Pencil, given: Pencil, region: Region) -> Found:
    """By LAPACK, and the eigenvalues of a sparse pencil that are asked for mended."""
    found = _by_lapack(pencil, given)
    at = region.listed(found.values)
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


def _by_pep(pencil: Pencil, region: Region, evidence: bool | None, budget: Budget, given: Pencil) -> Found | None:
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
    certificate = Nearest(pencil, region.count or 0, evidence, given) if region.box is None else \
        Enclosed(pencil, region.box, evidence, not budget.is_limited)
    if proof and not certificate.can_count:
        return None
    columns = 0 if certificate.parts is None else certificate.parts.W.shape[1]
    searched = Search(lambda ask, seed: certificate.problem.nearest(ask, seed), pencil.size)
    while certificate.pairs is None:
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
            if not certificate.is_found_uncounted():
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
    values, X = certificate.pairs or searched.pool
    if certificate.pairs is not None:
        certificate.missed(values, X)  # none, but for the tally
    values, X, left, done = _mended(pencil, certificate, values, X)
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
    return Found(near, X, Y, certificate.known(values), certificate.tally, certificate.counted)


def _mended(pencil: Pencil, certificate: Nearest | Enclosed, values: Array, X: Array) -> tuple[Array, Array, Array, Array]:
    """All λ (k,) and X (n, k) of a search, left vectors where they were mended, and where, bool (k,).

    What is then listed is compared with the count once more: a λ far off may have been counted in place of another one.
    """
    at, done, Y = certificate.about(values), np.zeros(len(values), dtype=bool), np.zeros(X.shape, dtype=complex)
    mass, damping, stiffness = (np.abs(part.diagonal()) for part in (pencil.M, pencil.D, pencil.K))
    if pencil.size > KEPT or (pencil.size > QUADRATIC and (damping <= HEAVY * np.sqrt(mass * stiffness)).all()):
        return values, X, Y, done
    found = mended(pencil, values[at], X[:, at], Y[:, at])
    values, X = values.copy(), X.astype(complex)
    values[at], X[:, at], Y[:, at], done[at] = found.values, found.X, found.Y, found.done
    certificate.told_again(values, int(found.vague.sum()))
    return values, X, Y, done
