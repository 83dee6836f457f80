"""Loss of stability of a model of any size: candidates from a small model, each refined on the full pencil, and counted.

Right vectors of the full pencil at some values of the parameter span a basis V. The pencil VᵀP(λ; p)V is exact at these values,
and `discs` finds all of its crossings. Each starts Newton's method on the full pencil, P(iω; p)x = 0, with left vectors y:

    yᴴP(iω; p)x + i yᴴP'x Δω + yᴴ∂P/∂p x Δp = 0,   x ← P⁻¹P'x,   y ← P⁻ᴴP'ᴴy,   P' = ∂P/∂λ.

Its vectors join V, until the crossings of the small pencil stand still. Between the values the crossings must make up the change
of the number of growing eigenvalues of the full pencil.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import ComplexFactor
from femsub.checks import NOT_CHECKED, Array, Matrix, Tally
from femsub.errors import SingularMatrixError
from femsub.model import in_band
from femsub.modes.quadratic.complex_modes import complex_modes
from femsub.stability.crossings import Crossing, Found, change, weight
from femsub.stability.discs import LARGEST, Discs
from femsub.stability.exclusion import union
from femsub.stability.question import CriticalValue, Question, fastest

if TYPE_CHECKING:
    from femsub.model import Pencil
    from femsub.modes import ComplexModes
    from femsub.stability.parameter import PencilOver

#: Of the range: where the full pencil is solved. A loss may well be at a simple fraction, and would be hard to count there.
SAMPLES = (0.0, 0.234, 0.486, 0.771, 1.0)
BEYOND = 0.05  # of the range: so far beyond the loss of a smaller model that of the full one is expected
AROUND = 0.02  # of the band's width: modes so far beside the band are in the basis as well
KEPT = 1e-3  # singular values of the basis of modes of unit length, relative to the largest
NEW = 1e-8  # share of a vector outside the basis with which it joins
ROUNDS = 6  # of refining
STILL = 1e-9  # of the range: the movement of crossings at which the rounds end
STEPS = 6  # of Newton's method, each with a factorisation, at most
DIFFERENCE = 1e-6  # of the range: the step of the difference for ∂P/∂p
FAR = 0.05  # of the range: the longest step in p,
SETTLED = 1e-4  # and the change of ω and p, relatively, at which it ends: the small pencil has the square of it with its vectors
EXACT, GOOD = 1e-11, 1e-8  # backward errors on the full pencil, up to which a crossing is not refined, and is accepted
BESIDE = 1e-9  # of |λ|: a shift beside an eigenvalue at which P is singular to working precision


@dataclass(frozen=True)
class Followed:
    """Crossings of a small model on modes of the full one, refined on the full one and counted.

    With `first`, the range ends at the first of the values beyond its begin at which more modes grow, or some did at its begin.
    The loss may be known to be `near` a value, by a smaller model: then the range up to there is solved at its ends alone.
    """

    first: bool = False
    near: float = np.nan

    def unfit(self, question: Question) -> str:
        if not np.isfinite(question.between[1]):
            return "a model can be followed over a finite range"
        if not np.isfinite(question.band[1]):
            return f"a model of {question.size} DOF needs a band: give band=(lo, hi) in rad per unit of time"
        return ""

    def solve(self, question: Question) -> CriticalValue:
        (lo, hi), over, band = question.between, question.over, question.band
        over.affine((lo, hi))  # a false declaration is told
        beyond = self.near + BEYOND * (hi - lo)
        places = [lo + share * (hi - lo) for share in SAMPLES[:-1]]
        if lo < beyond < hi:
            places = [lo, beyond, *(place for place in places if place > beyond)]
        values = np.union1d([*places, hi], over.kinks((lo, hi)))
        margin = AROUND * (band[1] - band[0])
        wide = max(0.0, band[0] - margin), band[1] + margin
        samples: dict[float, ComplexModes] = {}
        growing: dict[float, Array] = {}
        for p in values.tolist():
            samples[p] = complex_modes(over(p), band=wide)
            growing[p] = _growing(samples[p], band)
            if self.first and p > lo and (len(growing[lo]) or weight(growing[p].imag)):
                hi = p
                break
        question = replace(question, between=(lo, hi))
        found = [_refined(question, piece) for piece in _pieces(band, wide, samples)]
        losses, regains, unclear = ([one for part in found for one in getattr(part, name)] for name in
                                    ("losses", "regains", "open"))
        losses, regains = (sorted(several, key=lambda one: (one.value, one.omega)) for several in (losses, regains))
        begin = growing[lo]
        lost: list[float] = []
        for a, b in pairwise(samples):
            own = [[one for one in several if a < one.value <= b or one.value == a == lo] for several in (losses, regains)]
            listed, rise = change(*own), weight(growing[b].imag) - weight(growing[a].imag)
            if listed != rise or NOT_CHECKED in (samples[a].evidence, samples[b].evidence):
                unclear.append((a, b))
            if rise > listed:
                lost.append(a)
        left = union(unclear)
        grown = weight(begin.imag)
        tally = Tally(change(losses, regains), None if left else weight(growing[hi].imag) - grown, sampled=True)
        return CriticalValue.of(question, losses, regains, tally, growing=grown, fastest=fastest(begin), lost=lost, open=left,
                                solved=len(samples), method="followed")


@dataclass(frozen=True, eq=False)
class _Piece:
    """A part of the band with few enough modes, and a basis (n, r) of those in it and beside it."""

    band: tuple[float, float]
    V: Array


def _pieces(band: tuple[float, float], wide: tuple[float, float], samples: dict[float, ComplexModes]) -> list[_Piece]:
    """The band in parts whose small models `discs` can take."""
    shapes = [modes.shapes[:, in_band(modes.eigenvalues, wide) & (modes.eigenvalues.imag >= 0)] for modes in samples.values()]
    V = _spanned(np.hstack(shapes))
    if not V.shape[1]:
        return []
    room = LARGEST - 20
    if V.shape[1] <= room:
        return [_Piece(band, V)]
    heights = np.sort(np.concatenate([modes.eigenvalues.imag for modes in samples.values()]))
    heights = heights[(heights > band[0]) & (heights < band[1])]
    half = float(np.median(heights)) if len(heights) else sum(band) / 2
    if not band[0] < half < band[1] or min(half - band[0], band[1] - half) < 1e-3 * band[1]:
        return [_Piece(band, V[:, :room])]  # what it lacks shows in the counts
    beside = AROUND * (band[1] - band[0])
    return [*_pieces((band[0], half), (wide[0], half + beside), samples),
            *_pieces((float(np.nextafter(half, np.inf)), band[1]), (half - beside, wide[1]), samples)]


def _spanned(X: Array) -> Array:
    """An orthonormal basis of the real and imaginary parts of shapes, each turned to be as real as it can."""
    turn = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", X, X)))
    X = X * turn / np.linalg.norm(X, axis=0)
    both = np.hstack([X.real, X.imag])
    size, mix = np.linalg.eigh(both.T @ both)
    order = np.argsort(-size)
    order = order[size[order] > KEPT**2 * size.max(initial=0.0)]
    return np.linalg.qr(both @ (mix[:, order] / np.sqrt(size[order])))[0]


def _joined(V: Array, vectors: Array) -> Array:
    """V with what is new in the real and imaginary parts of vectors."""
    for part in np.hstack([vectors.real, vectors.imag]).T:
        size = float(np.linalg.norm(part))
        for _ in range(2):
            part = part - V @ (V.T @ part)
        if np.linalg.norm(part) > NEW * size:
            V = np.hstack([V, (part / np.linalg.norm(part))[:, None]])
    return V


def _refined(question: Question, piece: _Piece) -> CriticalValue:
    """The crossings in a part of the band, of the full pencil; `open` tells where a candidate could not be verified."""
    over, (lo, hi), V = question.over, question.between, piece.V
    places: list[float] = []
    for turn in range(ROUNDS):
        small = replace(question, over=over.projected(V, (lo, hi)), band=piece.band, falls=False, floats=False)
        found = Discs().solve(small)
        crossings = [*found.losses, *found.regains]
        rough = [(one, x) for one in crossings if error_of(over, one, x := V @ one.shape) > EXACT]
        now = [value for one in crossings for value in (one.value, one.omega / piece.band[1] * (hi - lo))]
        still = len(now) == len(places) and np.allclose(now, places, rtol=0.0, atol=STILL * (hi - lo))
        if not rough or still or turn == ROUNDS - 1:
            break
        places = now
        for one, x in rough:
            V = _joined(V, _newton(over, (lo, hi), one, x))
    good: Found = ([], [])
    poor: list[tuple[float, float]] = []
    for several, kept in zip((found.losses, found.regains), good, strict=True):
        for one in several:
            if (verified := _verified(over, (lo, hi), one, V @ one.shape)) is not None:
                kept.append(verified)
            else:
                poor.append((max(lo, one.value - FAR * (hi - lo)), min(hi, one.value + FAR * (hi - lo))))
    return replace(found, losses=tuple(good[0]), regains=tuple(good[1]), open=(*found.open, *poor))


def _verified(over: PencilOver, between: tuple[float, float], one: Crossing, x: Array) -> Crossing | None:
    """A crossing with its shape on the full pencil, and as wide as Newton's next step would move it; None if it does not hold.

    Where two modes coalesce the small pencil tells the shape beside the crossing only; a solution mends it.
    """
    factor = _factor(over(one.value), 1j * one.omega)
    if factor is not None and error_of(over, one, x) > GOOD:
        x = factor.solve(factor.solve(x.conj(), transposed=True).conj())  # (PᴴP)⁻¹x: yᴴP'x = 0 at an exceptional point
    if factor is None or error_of(over, one, x) > GOOD:
        return None
    _, moves = _step(over, between, one, factor, x / np.linalg.norm(x), x.conj())
    far = 2 * abs(float(moves[1]))
    return replace(one, shape=x / np.linalg.norm(x), width=max(one.width, far)) if np.isfinite(far) else None


def error_of(over: PencilOver, one: Crossing, x: Array) -> float:
    """The backward error of a crossing on the full pencil."""
    return float(over(one.value).backward_error(np.array([1j * one.omega]), x[:, None].astype(complex))[0])


def _newton(over: PencilOver, between: tuple[float, float], start: Crossing, x: Array) -> Array:
    """Right and left vectors (n, 2) at the crossing of the full pencil near a candidate.

    Where two modes coalesce on the axis Newton's step fails, but its vectors are those that the small model lacks.
    """
    at, width, vectors = start, between[1] - between[0], np.stack([x, x.conj()], axis=1)
    for _ in range(STEPS):
        factor = _factor(over(at.value), 1j * at.omega)
        if factor is None:
            break
        vectors, (turn, move) = _step(over, between, at, factor, vectors[:, 0], vectors[:, 1])
        if not np.isfinite([turn, move]).all() or abs(move) > FAR * width or abs(turn) > FAR * at.omega:
            break
        at = replace(at, omega=at.omega + float(turn), value=min(max(at.value + float(move), between[0]), between[1]))
        if abs(turn) <= SETTLED * at.omega and abs(move) <= SETTLED * width:
            break
    return vectors


def _step(over: PencilOver, between: tuple[float, float], at: Crossing, factor: ComplexFactor, x: Array, y: Array
          ) -> tuple[Array, Array]:
    """Better vectors x and y (n, 2) of the full pencil, and Newton's step (Δω, Δp) with them."""
    pencil = over(at.value)
    for _ in range(2):  # the first left vector is a guess
        x = factor.solve(_slope(pencil.M, pencil.D, at.omega, x))
        y = factor.solve(_slope(pencil.M.T, pencil.D.T, at.omega, y.conj()), transposed=True).conj()
        x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    aside = DIFFERENCE * (between[1] - between[0])
    aside = aside if at.value + aside <= between[1] else -aside
    rest, other = (one.residual(np.array([1j * at.omega]), x[:, None])[:, 0] for one in (pencil, over(at.value + aside)))
    error, change = y.conj() @ rest, (y.conj() @ (other - rest)) / aside
    turning = 1j * (y.conj() @ _slope(pencil.M, pencil.D, at.omega, x))
    if at.kind == "divergence":
        moves = np.array([0.0, -error.real / change.real if change.real else np.inf])
    else:
        system = np.array([[turning.real, change.real], [turning.imag, change.imag]])
        known = np.isfinite(system).all() and np.isfinite(error)
        moves = np.linalg.lstsq(system, -np.array([error.real, error.imag]), rcond=None)[0] if known else np.full(2, np.nan)
    return np.stack([x, y], axis=1), moves


def _factor(pencil: Pencil, value: complex) -> ComplexFactor | None:
    for beside in (0.0, BESIDE):
        try:
            return ComplexFactor(pencil.sparse().at(value + beside * (abs(value) or 1.0)))
        except SingularMatrixError:
            continue
    return None


def _slope(M: Matrix, D: Matrix, omega: float, x: Array) -> Array:
    """P'(iω)x; Mx for a real eigenvalue 0."""
    return 2j * omega * (M @ x) + D @ x if omega else M @ x


def _growing(modes: ComplexModes, band: tuple[float, float]) -> Array:
    """λ in the band, Im λ ≥ 0, that certainly grow."""
    z = modes.eigenvalues
    return z[(z.imag >= 0) & (z.real > modes.error_bar) & ~modes.rigid & in_band(z, band)]
