"""Loss of stability of a model of any size: crossings of a small model, each refined on the full pencil, proved or counted.

Where the parameter acts through few columns, one projection of the model serves all of its values, and sweeps run around the
rectangle of all growing λ in the band: up the axis, out along the edges of the band, and up at Re λ = the end of the band
(`femsub.modes.quadratic.axis_sweep`). If the parameter acts through many columns and a proof is requested, windows cover its
range, and each window serves all of these lines (`femsub.modes.quadratic.window_sweep`). The sweeps find all eigenvalues that
cross the sides of the rectangle for any value, and prove that no others do. If the number inside is known for one value, it is
then known for all: the answer is certified.

In all other cases the answer is confirmed. Right vectors of the full pencil at some values of the parameter span a basis V. The
pencil VᵀP(λ; p)V is exact at these values, and `discs` finds all of its crossings. Each crossing starts Newton's method on the
full pencil, P(iω; p)x = 0, with left vectors y:

    yᴴP(iω; p)x + i yᴴP'x Δω + yᴴ∂P/∂p x Δp = 0,   x ← P⁻¹P'x,   y ← P⁻ᴴP'ᴴy,   P' = ∂P/∂λ.

If Newton's method does not end close to its start, its vectors join V, and the small pencil is solved again. V also contains the
modes that reach an edge of the band anywhere in the range, and so all modes that cross the whole band between two values. Between
two values, the crossings and the growing modes that pass an edge must explain the change in the number of growing eigenvalues of
the full pencil.

A mode that is in the band only between two samples must come in through an edge ω, and leave again. At a frequency ω the
parameter is an eigenvalue: with the chord of the pencil over an interval around m,

    (P(iω; m) + t ΔP(iω)) x = 0,    -P(iω; m)⁻¹ ΔP(iω) x = x / t,

so that the t near the interval belong to the dominant eigenvalues 1/t of one operator. Block Arnoldi finds them with one
factorisation and few solves. If few DOF depend on the parameter, its basis ends with the rank of ΔP.

If an eigenvalue passes the edge beside the axis, at λ = r + iω, t is complex. If the mode reaches the axis within a distance g in
p, its eigenvalue moves by r within g, and the distance of t from the interval is about g.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.checks import EPS, EQUAL, NOT_CHECKED, Array, FemsubWarning, NotConvergedError, Tally, warn
from femsub.model import Pencil, in_band
from femsub.modes import (
    UNCOUNTED,
    AxisSweep,
    ComplexModes,
    Coupling,
    Inverse,
    Line,
    Met,
    Projection,
    Varied,
    WindowSweep,
    corrected,
    each_of,
    few_columns,
    modes_over,
    projection_over,
    slope,
    solver_near,
)
from femsub.stability.border import OUTSIDE
from femsub.stability.crossings import ASIDE, STEP, Crossing, Found, change, fed_by, weight
from femsub.stability.discs import LARGEST, Discs
from femsub.stability.exclusion import RESOLUTION, is_mirrored, union
from femsub.stability.parameter import PencilOver
from femsub.stability.question import CriticalValue, LossQuestion, fastest

log = logging.getLogger(__name__)

#: Shares of the range at which the full pencil is solved. Simple fractions are avoided: a loss there would be hard to count.
SAMPLES = (0.0, 0.234, 0.486, 0.771, 1.0)
EXPECTED = 0.05  # share of the range: largest distance of a crossing from its candidate, or from that of a smaller model


@dataclass(frozen=True)
class Followed:
    """Crossings of a small model on modes of the full one, refined on the full one and counted.

    With `first`, the range ends at the first sample beyond its start at which modes grow, or at the first sample of all if modes
    grow at the start. A smaller model may show that the loss is `near` a value: up to there, only the ends are solved.

    Newton's method takes at most `steps` steps, each with a factorisation. At most `steps` small models are made, each with the
    vectors of crossings that Newton's method did not reach from the last one. Crossings that are not verified then are open. A
    small model has at most `columns` columns, and the band is divided into as many parts as this takes. With 30 columns in place
    of 90 the discs take a fifth of the time. But fewer modes make crossings rougher, and more small models are needed. With
    `any_rank`, sweeps also prove the answer where the parameter acts through many columns, such as friction between meshes.
    """

    first: bool = False
    near: float = np.nan
    steps: int = 6
    columns: int = 30
    any_rank: bool = False

    def unfit(self, question: LossQuestion) -> str:
        if not np.isfinite(question.between[1]):
            return "a model can be followed over a finite range"
        if not np.isfinite(question.band[1]):
            return f"a model of {question.model.size} DOF needs a band: give band=(lo, hi) in rad per unit of time"
        return ""

    def solve(self, question: LossQuestion) -> CriticalValue:
        (lo, hi), band = question.between, question.band
        over = replace(question.over, at=lru_cache(maxsize=4)(question.over.at))  # Newton's method returns to some values
        question = replace(question, over=over)
        over.affine((lo, hi))  # refuses a false declaration
        if not self.first:
            try:
                return _swept(question, self.steps, self.any_rank)
            except (*UNCOUNTED, la.LinAlgError) as error:  # of LAPACK, if P_U is singular at its shift
                log.info("no proof by a sweep of the frequency: %s", error)
        beyond = self.near + EXPECTED * (hi - lo)
        places = [lo + share * (hi - lo) for share in SAMPLES[:-1]]
        if lo < beyond < hi:
            places = [lo, beyond, *(place for place in places if place > beyond)]
        values = np.union1d([*places, hi], over.kinks((lo, hi)))
        margin = OUTSIDE * (band[1] - band[0])
        wide = max(0.0, band[0] - margin), band[1] + margin
        samples: dict[float, ComplexModes] = {}
        growing: dict[float, Array] = {}
        for p, modes in zip(values.tolist(), modes_over(over, values.tolist(), over.terms((lo, hi)), wide), strict=True):
            samples[p] = modes
            z = samples[p].eigenvalues
            growing[p] = z[(z.imag >= 0) & (z.real > samples[p].error_bar) & ~samples[p].rigid & in_band(z, band)]  # certainly
            if self.first and p > lo and (len(growing[lo]) or weight(growing[p].imag)):
                hi = p
                break
        question = replace(question, between=(lo, hi))
        ends, gap = over.straight(list(samples)), float(np.diff(list(samples)).max())
        passing = [modes_at(over, ends, gap, 1j * edge, LARGEST) for edge in band]
        shapes = np.hstack([np.zeros((over(lo).size, 0)), *(one[1] for one in passing if one is not None)])
        found = [_refined(question, *piece, self.steps) for piece in _pieces(band, wide, samples, shapes, self.columns)]
        losses, regains, unclear = ([one for part in found for one in getattr(part, name)] for name in
                                    ("losses", "regains", "open"))
        losses, regains = (sorted(several, key=lambda one: (one.value, one.omega)) for several in (losses, regains))
        if vague := [edge for edge, one in zip(band, passing, strict=True) if one is None]:
            warn(f"the modes that come to the edge of the band at {vague[0]:.6g} within the range of {question.parameter!r} are "
                 f"not known: they need a basis of more than {LARGEST} vectors, or the pencil is singular there. A mode that "
                 "crosses the band may be missed. Move the edge, or take a shorter range", FemsubWarning)
            unclear.append((lo, hi))
        begin = growing[lo]
        lost: list[float] = []
        entered = 0
        for a, b in pairwise(samples):
            own = [[one for one in several if a < one.value <= b or one.value == a == lo] for several in (losses, regains)]
            rise = weight(growing[b].imag) - weight(growing[a].imag) - change(*own)
            inside = [a, *(p for p in ends if a < p < b), b]
            passed = _passages(question, inside, np.concatenate([growing[a], growing[b]]), self.steps) if rise else []
            inward = sum(step for _, step in passed)
            entered += inward
            lost += [value for value, step in passed if step > 0]
            if rise != inward or NOT_CHECKED in (samples[a].evidence, samples[b].evidence):
                unclear.append((a, b))
            if rise > inward:
                lost.append(a)
        left = union(unclear)
        grown = weight(begin.imag)
        tally = Tally(change(losses, regains), None if left else weight(growing[hi].imag) - grown - entered, sampled=True)
        return CriticalValue.of(question, losses, regains, tally, growing=grown, fastest=fastest(begin), lost=lost, open=left,
                                solved=len(samples), method="followed")


def _swept(question: LossQuestion, steps: int, any_rank: bool = False) -> CriticalValue:
    """The certified answer.

    Raises
    ------
    NotConvergedError, SingularMatrixError, MissedModesError, NotEnoughMemoryError
        The sweeps cannot prove an answer; the message gives the reason.
    """
    over, (lo, hi), band = question.over, question.between, question.band
    if not over.affine((lo, hi)) or (terms := over.terms((lo, hi))) is None:
        raise NotConvergedError("a contact is not affine in the parameter")
    if not terms:
        raise NotConvergedError("nothing depends on the parameter")
    if any(is_mirrored(over(p)) for p in (lo, hi)):
        raise NotConvergedError("without damping eigenvalues are on the axis for all values")
    few = all(few_columns(sp.csr_array(half)) is not None for _, T, _ in terms for half in (T + T.T, T - T.T))
    if not few and not any_rank:
        raise NotConvergedError("the parameter acts through many columns; solver='swept' takes these, too")
    p0 = lo + SAMPLES[2] * (hi - lo) if few else (lo + hi) / 2  # a crossing there would have an infinite μ
    reference = over(p0)
    weights = [(of(hi) - of(lo)) / (hi - lo) for *_, of in terms]
    changes = [Varied(T, q, abs(w) * max(hi - p0, p0 - lo)) for (q, T, _), w in zip(terms, weights, strict=True)]
    projection = projection_over(reference, changes, (0.0, band[1], *band), 0.01).changed(np.zeros(len(terms)))
    if projection.least <= 0 or projection.free.shape[1]:
        raise NotConvergedError("the model floats, or damping outweighs the stiffness of other shapes")
    side, height = band[1], band[1] - band[0]
    axis = Line(1j * band[0], 1j, height)
    edges = [Line(1j * edge, 1.0, side) for edge in band if edge]
    lines = [axis, *edges, Line(side + 1j * band[0], 1j, height)]
    sweep: AxisSweep | WindowSweep
    if few:
        for _ in range(4):
            if not _enriched(projection, band):
                break
        sweep = AxisSweep(projection, weights, (lo - p0, hi - p0))
    else:
        enriched_over(projection, np.array(weights), np.linspace(lo - p0, hi - p0, 5), band)
        sweep = WindowSweep(projection, weights, (lo - p0, hi - p0))
    met: list[list[Met]] = []
    every = sweep.swept(lines) if isinstance(sweep, WindowSweep) else (
        sweep.swept(line, RESOLUTION * band[1]) for line in lines)
    for line, (found, left) in zip(lines, every, strict=True):
        if left:
            raise NotConvergedError(f"in {len(left)} pieces the crossings are not known, for example near s = "
                                    f"{line.start + line.along * sum(left[0]) / 2:.6g}")
        log.info("%d crossings of the line from %s", len(found), line.start)
        met.append([one for one in found if one.values[1] >= lo - p0 and one.values[0] <= hi - p0])
        # at an end of the range it is not known which modes grow, and at a corner whether the eigenvalue is in the band
        if any(one.values[0] <= end - p0 <= one.values[1] for one in met[-1] for end in (lo, hi)) or (
                line is not axis and any(one.between[0] <= 0 <= one.between[1] for one in met[-1])):
            raise NotConvergedError("an eigenvalue is on the axis or an edge of the band at an end of the range, or at a corner")
    if met[-1]:
        raise NotConvergedError(f"a mode grows faster than the band's end {band[1]:.6g}")
    # the small pencil has as many eigenvalues in the rectangle as the full one
    z = each_of(lambda p: Coupling.of(projection.changed(np.array(weights) * (p - p0)), projection.outer.size).values, (lo, hi))
    grown = [one[(one.imag >= 0) & (one.real > 0) & (one.real < side) & in_band(one, band)] for one in z]
    sparse = reference.sparse()
    V = projection.V if sparse.alike() is sparse else sparse.units[1][:, None] * projection.V
    both: Found = ([], [])
    # MUMPS takes one call at a time; BLAS has one thread then
    came = [each_of(lambda one: _come_to(question, sweep, V, band[0], one, p0, steps), [one])[0] for one in met[0]]
    crossings = each_of(lambda one, to: _crossing(question, sweep, one, to, p0, steps), met[0], came)
    for one, crossing in zip(met[0], crossings, strict=True):
        if in_band(np.array([crossing.omega]), band)[0]:
            both[int(one.left)].append(crossing)
    entered, lost = 0, []
    for line, part in zip(edges, met[1:-1], strict=True):
        for one in (one for one in part if one.at > 0):
            inward = one.left == (line.start.imag == band[0])
            entered += 2 if inward else -2
            lost += [p0 + sum(one.values) / 2] if inward else []
    losses, regains = (sorted(part, key=lambda one: (one.value, one.omega)) for part in both)
    begin, end = (weight(z.imag) for z in grown)
    solved = 2 + (sweep.solved if isinstance(sweep, WindowSweep) else 1)
    return CriticalValue.of(question, losses, regains, Tally(change(losses, regains), end - begin - entered), growing=begin,
                            fastest=fastest(grown[0]), lost=lost, solved=solved, method="followed")


def _enriched(projection: Projection, band: tuple[float, float]) -> bool:
    """Add residuals of eigenvectors in the band to V where the coupling with the outside is not small; True if any were added."""
    small = Coupling.of(projection, projection.outer.size)
    near = np.flatnonzero((small.nu != 0) & (small.each.imag >= 0) & in_band(np.nan_to_num(small.each), band))
    if not len(near):
        return False
    lam = small.each[near]
    scale = np.sqrt(projection.least * np.maximum(np.abs(lam.real), EPS * np.abs(lam)))
    residuals = [projection.coefficients(lam, x[:, near] / scale, adjoint) for x, adjoint in ((small.x, False), (small.z, True))]
    return projection.join(residuals, EPS**0.5)  # squares of shares of a coupling that must be below 1


def enriched_over(projection: Projection, weights: Array, values: Array, band: tuple[float, float]) -> None:
    """Add large residuals of eigenvectors at some `values` to V: at every other value of all λ near the band, else near the axis.

    A residual is compared with a distance from the eigenvalue: |Re λ|, or a hundredth of the band's end if that is less.
    """
    columns = []
    projection.lost  # noqa: B018  (computed once, since `changed` copies it)
    every = each_of(lambda value: Coupling.of(projection.changed(weights * value), projection.outer.size), values)
    for i, small in enumerate(every):
        lam = np.nan_to_num(small.each)
        near = np.flatnonzero((small.nu != 0) & (lam.imag >= 0.9 * band[0]) & (lam.imag <= 1.3 * band[1])
                              & (np.abs(lam.real) < (0.1 if i % 2 == 0 else 1e-3) * band[1]))
        scale = np.sqrt(projection.least * np.clip(np.abs(lam[near].real), 2e-4 * band[1], 1e-2 * band[1]))
        columns += [small.basis.coefficients(lam[near], x[:, near] / scale, adjoint)
                    for x, adjoint in ((small.x, False), (small.z, True))]
    projection.join(columns, 0.02)


def _come_to(question: LossQuestion, sweep: AxisSweep | WindowSweep, V: Array, start: float, one: Met, p0: float, steps: int
             ) -> _Met:
    """The result of Newton's method on the full pencil; an error if it is not the crossing of the axis that the sweep found."""
    over, (lo, hi) = question.over, question.between
    omega, value = start + one.at, sum(one.values) / 2
    real = start + one.between[0] <= 0  # a real eigenvalue, which has no conjugate
    omega = 0.0 if real else omega
    x, y, *_ = sweep.shapes(1j * omega, value)
    found = _newton(over, (lo, hi), _At(p0 + value, 1j * omega, 0.0 if real else 1j), V @ x, steps, left=V @ y)
    p, at = found.at.value, found.at.lam.imag
    slack = EQUAL * (hi - lo)  # tolerance of Newton's method; there is no other crossing in the whole room
    if not found.settled or abs(at - omega) > one.room or not one.values[0] - slack <= p - p0 <= one.values[1] + slack:
        raise NotConvergedError("Newton's method did not converge to the crossing near "
                                f"ω = {omega:.6g}, {over.parameter} = {p0 + value:.6g}")
    return found


def _crossing(question: LossQuestion, sweep: AxisSweep | WindowSweep, one: Met, found: _Met, p0: float, steps: int) -> Crossing:
    """The crossing that Newton's method found, with the growth on both sides."""
    over, (lo, hi) = question.over, question.between
    p, at, shape, real = found.at.value, found.at.lam.imag, found.vectors[:, 0], not found.at.along
    ends, growth = (max(lo, p - ASIDE * (hi - lo)), min(hi, p + ASIDE * (hi - lo))), []
    for end, sign in zip(ends, (1, -1) if one.left else (-1, 1), strict=True):
        for share in (1.0, 1 / 8, 1 / 64):  # nearer, if farther away it is taken for another mode
            lam = 1j * at
            for step in np.linspace(p, p + share * (end - p), 9)[1:]:
                lam = sweep.eigenvalue(lam, step - p0, steps)
            if sign * lam.real > 0:
                break
        growth.append(lam.real)
    return Crossing(p, 2 * found.off, at, shape.real / la.norm(shape.real) if real else shape,
                    "divergence" if real else fed_by(over(ends[one.left - 1]), shape, at), (growth[0], growth[1]))


def factor_at(pencil: Pencil, value: complex) -> Inverse | None:
    """The factor of P(λ), or of P at a value next to λ if P(λ) is singular; None if P is singular there, too."""
    return solver_near(pencil.sparse(), value) or (None if value else solver_near(pencil.sparse(), 2**22 * EPS))


def modes_at(over: PencilOver, ends: Sequence[float], gap: float, lam: complex, most: int) -> tuple[Array, Array] | None:
    """t (k,), complex, and shapes (n, k) of all modes that have the eigenvalue λ for p = t, with t up to `gap` from the range.

    The pencil is close to its chords between the `ends`. None if a basis of `most` vectors is not enough, or P is singular.
    """
    places: list[Array] = []
    shapes: list[Array] = []
    for a, b in pairwise(ends):
        m, half = (a + b) / 2, (b - a) / 2
        first, last = (over(p).at(lam) for p in (a, b))
        factor = factor_at(over(m), lam)
        found = None if factor is None else _dominant(factor, (last - first) / (b - a), 1 / (half + gap), most)
        if found is None:
            return None
        near = np.abs(found[0] - np.clip(found[0].real, -half, half)) <= gap
        places.append(m + found[0][near])
        shapes.append(found[1][:, near])
    return np.concatenate(places), np.hstack(shapes)


def _dominant(factor: Inverse, change: Any, least: float, most: int) -> tuple[Array, Array] | None:
    """t and unit vectors x of (P + tC)x = 0 with |1/t| ≥ `least`; None if a basis of `most` vectors is not enough.

    The pairs count as complete if they and the next pair have converged, since pairs of largest |1/t| converge first.
    """
    n = change.shape[0]
    Q, image = np.zeros((2, n, 0), dtype=complex)
    new = factor.solve(change @ np.random.default_rng(n).standard_normal((n, min(8, n))))  # at most 8 shapes of one t
    while True:
        size = np.linalg.norm(new, axis=0)
        for _ in range(2):
            new = new - Q @ (Q.conj().T @ new)
        new = np.divide(new, size, out=np.zeros_like(new), where=size > 0)
        u, s, _ = np.linalg.svd(new, full_matrices=False)
        new = u[:, s > n * EPS]
        if not np.isfinite(size).all() or Q.shape[1] + new.shape[1] > most:
            return None
        ended = not new.shape[1]
        Q, image = np.hstack([Q, new]), np.hstack([image, new := -factor.solve(change @ new)]) if not ended else image
        inverse, small = np.linalg.eig(Q.conj().T @ image)
        order = np.argsort(-np.abs(inverse), kind="stable")
        wanted = int(np.count_nonzero(np.abs(inverse) >= least))
        order = order[:wanted + 1]
        x, size = Q @ small[:, order], np.abs(inverse[order])
        # rough shapes suffice: Newton's method on the full pencil improves the shapes that matter
        poor = np.linalg.norm(image @ small[:, order] - x * inverse[order], axis=0) > size / 100
        if ended or (len(order) > wanted and not poor.any()):
            return 1 / inverse[order[:wanted]], x[:, :wanted] / np.linalg.norm(x[:, :wanted], axis=0)


def _passages(question: LossQuestion, ends: list[float], growing: Array, steps: int) -> list[tuple[float, int]]:
    """The values at which growing eigenvalues pass an edge of the band, and their number, which is negative if they leave it.

    On each edge the search starts at Re λ = 0, and at Re λ of the eigenvalues `growing` at the first and at the last of the
    `ends`. An edge at 0 is left out: a real eigenvalue is in a band that begins at 0.
    """
    over, band, a, b = question.over, question.band, ends[0], ends[-1]
    passed: list[tuple[float, int]] = []
    for edge in [edge for edge in band if edge]:
        met: list[_Met] = []
        for rate in (0.0, *growing.real.tolist()):
            found = modes_at(over, ends, b - a, rate + 1j * edge, LARGEST) or (np.zeros(0), np.zeros((0, 0)))
            starts = [(_placed(over, question.between, _At(float(t.real), rate + 1j * edge, 1.0), x, steps), x)
                      for t, x in zip(found[0], found[1].T, strict=True)]
            met += [one for one in (_newton(over, question.between, *start, steps, far=1.0) for start in starts)
                    if one.settled and a < one.at.value <= b and one.at.lam.real > 0]
        for i, one in enumerate(met):
            if not any(abs(one.at.value - other.at.value) <= ASIDE**2 * (b - a)
                       and abs(one.at.lam - other.at.lam) <= ASIDE**2 * abs(one.at.lam) for other in met[:i]):  # each once
                passed.append((one.at.value, 2 if (one.rate.imag > 0) == (edge == band[0]) else -2))
    return passed


def _pieces(band: tuple[float, float], wide: tuple[float, float], samples: dict[float, ComplexModes], passing: Array,
            columns: int) -> list[tuple[tuple[float, float], Array]]:
    """The band in parts whose small models `discs` can solve, each with a basis (n, r) of the modes in it and near it.

    The basis holds the shapes `passing` (n, k) as well.
    """
    shapes = [modes.shapes[:, in_band(modes.eigenvalues, wide) & (modes.eigenvalues.imag >= 0)] for modes in samples.values()]
    X = np.hstack([*shapes, passing])
    # an orthonormal basis of their real and imaginary parts; a phase makes each shape as real as possible
    X = X * np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", X, X))) / np.linalg.norm(X, axis=0)
    both = np.hstack([X.real, X.imag])
    size, mix = np.linalg.eigh(both.T @ both)
    order = np.argsort(-size)
    order = order[size[order] > EPS**0.5 * size.max(initial=0.0)]  # half of their digits are right
    V = np.linalg.qr(both @ (mix[:, order] / np.sqrt(size[order])))[0]
    if not V.shape[1]:
        return []
    if V.shape[1] <= columns:
        return [(band, V)]
    heights = np.sort(np.concatenate([modes.eigenvalues.imag for modes in samples.values()]))
    heights = heights[(heights > band[0]) & (heights < band[1])]
    half = float(np.median(heights)) if len(heights) else sum(band) / 2
    if not band[0] < half < band[1] or min(half - band[0], band[1] - half) < 1e-3 * band[1]:
        return [(band, V[:, :LARGEST - 20])]  # missing modes show in the counts
    beside = OUTSIDE * (band[1] - band[0])
    return [*_pieces((band[0], half), (wide[0], half + beside), samples, passing, columns),
            *_pieces((float(np.nextafter(half, np.inf)), band[1]), (half - beside, wide[1]), samples, passing, columns)]


def _refined(question: LossQuestion, band: tuple[float, float], V: Array, steps: int) -> CriticalValue:
    """The crossings in a part of the band, of the full pencil; `open` shows where a candidate could not be verified."""
    over, (lo, hi) = question.over, question.between
    unit = np.array([hi - lo, band[1]])
    before = np.zeros((0, 2))
    for turn in range(steps):
        small = replace(question, over=over.projected(V, (lo, hi)), band=band, falls=False, floats=False)
        found = Discs().solve(small)
        crossings = [*found.losses, *found.regains]
        now = np.array([(one.value, one.omega) for one in crossings]).reshape(-1, 2) / unit
        apart = np.abs(now[:, None] - now).max(axis=2) + np.diag(np.full(len(now), np.inf))
        close = np.minimum(ASIDE, apart.min(axis=1, initial=np.inf) / 4)
        refined: dict[int, Crossing] = {}
        rough: list[Array] = []
        for at, one in enumerate(crossings):
            x = V @ one.shape
            joined = _coalesced(over, (lo, hi), one, x, steps, lost=at < len(found.losses))
            if joined is not None and np.abs(np.array([joined.value, joined.omega]) / unit - now[at]).max() <= close[at]:
                refined[id(one)] = joined
                continue
            if error_of(over, one, x) <= RESOLUTION:  # it is as accurate as it can be
                continue
            met = _newton(over, (lo, hi), _At(one.value, 1j * one.omega, 1j if one.kind != "divergence" else 0.0), x, steps)
            if met.settled and np.abs(np.array([met.at.value, met.at.lam.imag]) / unit - now[at]).max() <= close[at]:
                refined[id(one)] = replace(one, value=met.at.value, omega=met.at.lam.imag, shape=met.vectors[:, 0],
                                           width=max(one.width, 2 * met.off))
            else:
                rough.append(met.vectors)
        if not rough or (len(now) == len(before) and np.allclose(now, before, rtol=0.0, atol=EQUAL)) or turn == steps - 1:
            break
        before = now
        for part in np.hstack([half for vectors in rough for half in (vectors.real, vectors.imag)]).T:
            size = float(np.linalg.norm(part))
            for _ in range(2):
                part = part - V @ (V.T @ part)
            if np.linalg.norm(part) > EPS**0.5 * size:
                V = np.hstack([V, (part / np.linalg.norm(part))[:, None]])
    good: Found = ([], [])
    poor: list[tuple[float, float]] = []
    for several, kept in zip((found.losses, found.regains), good, strict=True):
        for one in several:
            if (verified := refined.get(id(one)) or _verified(over, (lo, hi), one, V @ one.shape)) is not None:
                kept.append(verified)
            else:
                poor.append((max(lo, one.value - EXPECTED * (hi - lo)), min(hi, one.value + EXPECTED * (hi - lo))))
    return replace(found, losses=tuple(good[0]), regains=tuple(good[1]), open=(*found.open, *poor))


def _coalesced(over: PencilOver, between: tuple[float, float], one: Crossing, x: Array, steps: int, *, lost: bool
               ) -> Crossing | None:
    """The coalescence of two modes on the axis, on the full pencil; None if it is not found, or if the pencil has damping.

    p(ω), at which iω is an eigenvalue, is real, and has an extremum there: both modes are on the axis below a loss, which is a
    maximum, and above a regain. With yᴴPx = 0 and P' = ∂P/∂λ,

        dp/dω = -i yᴴP'x / yᴴ∂P/∂p x,   d²p/dω² = 2(yᴴMx + yᴴP'x') / yᴴ∂P/∂p x,   x' = -P⁻¹P'x without its part in x.

    Newton's method for dp/dω = 0 finds ω; the error of p is the square of the error of ω. It iterates x ← P⁻¹y and y ← P⁻ᴴx,
    since P⁻¹P'x does not amplify x where yᴴP'x = 0.
    """
    if one.kind == "divergence" or not is_mirrored(over(one.value)):
        return None
    width, value, omega, y = between[1] - between[0], one.value, one.omega, x
    for _ in range(steps):
        pencil, lam = over(value), 1j * omega
        factor = factor_at(pencil, lam)
        if factor is None:
            break
        with np.errstate(all="ignore"):
            for _ in range(2):  # the first left vector is a guess
                y = factor.solve(x.conj(), transposed=True).conj()
                y /= np.linalg.norm(y)
                x = factor.solve(y)
                x /= np.linalg.norm(x)
            error, change, turning = _quotient(over, between, _At(value, lam, 1j), x, y)
            bent = factor.solve(slope(pencil, lam, x))
            bent = x * (x.conj() @ bent) - bent
            rise = (-1j * turning / change).real
            curve = 2 * ((y.conj() @ (pencil.M @ x) + y.conj() @ slope(pencil, lam, bent)) / change).real
            turn = -rise / curve
            move = (-error / change).real + rise * turn / 2
        if not np.isfinite([move, turn]).all() or abs(move) > EXPECTED * width or abs(turn) > EXPECTED * omega:
            break
        value, omega = float(np.clip(value + move, *between)), float(omega + turn)
        if abs(move) <= EQUAL * width and abs(turn) <= EQUAL * omega:
            return replace(one, value=value, omega=omega, shape=x, width=max(one.width, 2 * abs(move))) \
                if (curve < 0) == lost else None
    return None


def _verified(over: PencilOver, between: tuple[float, float], one: Crossing, x: Array) -> Crossing | None:
    """A crossing with its shape on the full pencil, at least as wide as twice Newton's next step; None if it does not hold.

    Where two modes coalesce, the small pencil represents the shape only beside the crossing. One step of inverse iteration
    improves it.
    """
    at = _At(one.value, 1j * one.omega, 1j if one.kind != "divergence" else 0.0)
    factor = factor_at(over(one.value), at.lam)
    if factor is not None and error_of(over, one, x) > EPS**0.5:
        x = factor.solve(factor.solve(x.conj(), transposed=True).conj())  # (PᴴP)⁻¹x: yᴴP'x = 0 at an exceptional point
    if factor is None or error_of(over, one, x) > EPS**0.5:
        return None
    x = x / np.linalg.norm(x)
    off = _step(over, between, at, factor, x, x.conj()).off
    return replace(one, shape=x, width=max(one.width, 2 * off)) if np.isfinite(off) else None


def error_of(over: PencilOver, one: Crossing, x: Array) -> float:
    """The backward error of a crossing on the full pencil."""
    return float(over(one.value).backward_error(np.array([1j * one.omega]), x[:, None].astype(complex))[0])


class _At(NamedTuple):
    """A value of the parameter, λ there, and the direction in which λ may move: i along the axis, 1 along an edge, 0: none."""

    value: float
    lam: complex
    along: complex


class _Met(NamedTuple):
    """A state of Newton's method: place, right and left vector (n, 2), dλ/dp, and size of the last step in p (NaN: it failed)."""

    at: _At
    vectors: Array
    rate: complex
    off: float
    settled: bool = False


def _newton(over: PencilOver, between: tuple[float, float], start: _At, x: Array, steps: int, far: float = EXPECTED,
            left: Array | None = None) -> _Met:
    """The value at which the full pencil has an eigenvalue on the line of `start`. No step is longer than `far` of the range.

    Where two modes coalesce on the axis, Newton's step fails, but its vectors are the vectors that the small model lacks. The
    step also fails if λ moves along the line, as on the axis of an undamped model: the line then determines no value.
    """
    width, met = between[1] - between[0], _Met(start, np.stack([x, x.conj() if left is None else left], axis=1), np.nan, np.nan)
    for _ in range(steps):
        factor = factor_at(over(met.at.value), met.at.lam)
        if factor is None:
            break
        last, met = met.at, _step(over, between, met.at, factor, met.vectors[:, 0], met.vectors[:, 1])
        while True:
            turn = abs(met.at.lam - last.lam)
            if not np.isfinite([turn, met.off]).all() or met.off > far * width or turn > far * abs(last.lam):
                return met._replace(at=last)
            # if λ stays on the line, p is not determined
            if start.along and abs((met.rate / start.along).imag) <= EPS**0.5 * abs(met.rate):
                return met._replace(at=last)
            if turn <= EQUAL * abs(met.at.lam) and met.off <= EQUAL * width:
                return met._replace(settled=True)
            # x ← x - P⁻¹P(λ; p)x with the present factor, as long as each step gains a digit
            P, (x, y) = over(met.at.value).at(met.at.lam), met.vectors.T
            x, y = x - factor.solve(P @ x), y - factor.solve(P.T @ y.conj(), transposed=True).conj()
            nearer = _corrected(over, between, met.at, x, y)
            if not nearer.off <= met.off / 10:
                break
            last, met = met.at, nearer
    return met


def _placed(over: PencilOver, between: tuple[float, float], at: _At, x: Array, steps: int) -> _At:
    """The place on the line of `at` at which xᵀP(λ; p)x = 0 for the shape x; `at` itself if Newton's method does not find it.

    A shape found on a chord is close to its mode, but its place may be far off, where another mode is nearer.
    """
    met = at
    for _ in range(steps):
        met, _, _, off, _ = _corrected(over, between, met, x, x.conj())
        if not np.isfinite(off) or off <= EQUAL * (between[1] - between[0]):
            break
    return met if off <= EQUAL * (between[1] - between[0]) else at


def _step(over: PencilOver, between: tuple[float, float], at: _At, factor: Inverse, x: Array, y: Array) -> _Met:
    """Better vectors x and y of the full pencil, and Newton's step with them, which ends within the range."""
    pencil, lam = over(at.value), at.lam
    for _ in range(2):  # the first left vector is a guess
        x, y = corrected(pencil, lam, x, y, factor)
    return _corrected(over, between, at, x, y)


def _corrected(over: PencilOver, between: tuple[float, float], at: _At, x: Array, y: Array) -> _Met:
    """Newton's step for yᴴP(λ; p)x = 0, which ends within the range."""
    error, change, turning = _quotient(over, between, at, x, y)
    with np.errstate(all="ignore"):
        rate = complex(-change / turning)
    if not at.along:
        turn, move = 0.0, -error.real / change.real if change.real else np.inf
    else:
        across = turning * at.along
        system = np.array([[across.real, change.real], [across.imag, change.imag]])
        known = np.isfinite(system).all() and np.isfinite(error)
        turn, move = np.linalg.lstsq(system, -np.array([error.real, error.imag]), rcond=None)[0] if known else np.full(2, np.nan)
    value = min(max(at.value + float(move), between[0]), between[1])
    return _Met(at._replace(value=value, lam=at.lam + at.along * float(turn)), np.stack([x, y], axis=1), rate, abs(float(move)))


def _quotient(over: PencilOver, between: tuple[float, float], at: _At, x: Array, y: Array) -> tuple[complex, complex, complex]:
    """yᴴPx, yᴴ∂P/∂p x and yᴴP'x."""
    pencil = over(at.value)
    if over.affine(between):  # the slope over the whole range, from pencils that are stored
        aside = max(between, key=lambda p: abs(p - at.value)) - at.value
    else:
        aside = STEP * (between[1] - between[0])
        aside = aside if at.value + aside <= between[1] else -aside
    rest, other = (one.residual(np.array([at.lam]), x[:, None])[:, 0] for one in (pencil, over(at.value + aside)))
    return complex(y.conj() @ rest), complex(y.conj() @ (other - rest)) / aside, complex(y.conj() @ slope(pencil, at.lam, x))
