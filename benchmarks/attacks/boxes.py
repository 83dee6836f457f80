"""Models reduced over a box of parameters, against dense solutions at values all over the box.

A family is a chain or a net of springs with two to four terms that depend on one to three parameters, by numbers, powers,
inverses and products. 'light': damping of up to 1 % of critical, proportional or not. 'strong': dashpots of up to a million
times critical, or everywhere. 'negative': dashpots that feed the motion. 'gyroscopic': D with a skew part. 'circulatory':
friction between DOF, or between two modes, which flutter. 'mixed': any of these. Terms act at a few DOF or at all, in a few
families on M; half of the families are dense.

At each value the λ of the full model in the band lie within the radius of some λ of the small model, and each of these within
its radius of one of the full model. Re λ lies within its bounds. Verdicts of stability and the count in the cell's contour are
those of the full model. Along a line through the box every loss and regain is found, and none beside them. λ beside an edge
count on neither side. Values that contradict a radius are solved again by Newton's method. Where only the count is false and not
proved, the outcome is 'confirmed, but'. 'within more than tol': a radius exceeds ten times what was asked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise, product
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, crossed, dense, eigenvalues, grid_pairs, stiffness
from femsub.algebra import unit_length
from femsub.checks import EPS, Array

KINDS = ("light", "strong", "negative", "gyroscopic", "circulatory", "mixed")
#: factors of terms; the ranges are those of `family`
THETAS: tuple[Any, ...] = (
    "speed", "mu", "load", lambda speed: speed**2, lambda speed: 1 / speed, lambda load: load**-2, lambda mu, load: mu * load,
    lambda mu, speed: mu / speed, lambda speed, load: speed * load, lambda mu, speed, load: mu * load / speed**2)
ROUNDING = 1e-10  # share of the band's top: a smaller radius is not compared with the error of the dense reference
BESIDE = 1e-5  # share of the band's top: λ nearer to an edge or contour are not compared; share of a range that ends bisection


@attack("boxes", KINDS)
def boxes(kind: str, rng: Random) -> str:
    """The evidence of a model that is right all over its box, 'refused', or what is wrong."""
    full, ranges, band = family(kind, rng)
    re = (-band[1] * 10.0 ** rng.uniform(-3, 0), band[1]) if rng.random() < 0.5 else None
    box = fs.ParameterBox(ranges, band=band, tol=float(rng.choice([1e-3, 1e-6, 1e-6, 1e-8])), re=re)
    try:
        small = fs.reduce(full, box)
    except fs.FemsubError as error:
        return f"refused: {type(error).__name__}: {error}"
    # dense solutions at corners, at random values and on a line; fewer for larger models, since each takes n³
    count = int(np.clip(6e7 / full.size**3, 3, 24))
    points, name = [at_random(ranges, rng) for _ in range(max(2, count // 2))], str(rng.choice(list(ranges)))
    line = [{**points[-1], name: float(value)} for value in np.linspace(*ranges[name], count + 2)]
    points += [corners(ranges)[i] for i in rng.permutation(2 ** len(ranges))[:4 if full.size > 200 else 8]] + line
    faults, doubts, exact, worst = list[str](), list[str](), list[Array](), np.zeros(2)
    for point in points:
        exact.append(spectrum(full, point))
        found, counts, reached = judged(full, small, point, exact[-1])
        proved = any(cell.evidence == "certified" for cell in small.cells if cell.holds(point))
        faults, doubts, worst = faults + found + counts * proved, doubts + counts * (not proved), np.maximum(worst, reached)
    found, losses = along(full, small, name, line, exact[-len(line):])
    text = (f"{small.size} of {full.size} DOF, {len(small.cells)} cells, {100 * small.open_share:.3g} % "
            f"open, error/radius {worst[0]:.2g}, radius/tol {worst[1] / box.tol:.2g}, {losses} crossings")
    if faults := faults + found:
        return f"wrong: {'; '.join(faults[:3])}: {small.evidence}, {text}"
    word = small.evidence + ", within more than tol" * bool(worst[1] > 10 * box.tol)
    return f"{word}, but: {'; '.join(doubts[:3])}: {text}" if doubts else f"{word}: {text}"


def family(kind: str, rng: Random) -> tuple[fs.Affine, dict[str, tuple[float, float]], tuple[float, float]]:
    """A random family, the ranges of its parameters, and a band."""
    wide = int(rng.integers(3, 7)) if rng.random() < 0.5 else 1
    place = np.arange(int(10 ** rng.uniform(np.log10(40), np.log10(400))) // wide * wide).reshape(-1, wide)
    n, pairs = place.size, np.vstack([grid_pairs(place), np.column_stack([place[0], np.full(wide, -1)])])  # the first row is held
    K = stiffness(n, pairs, 10.0 ** rng.uniform(-0.5, 0.5, len(pairs)))
    m, k = 10.0 ** rng.uniform(-0.3, 0.3, n), K.diagonal()
    squares, X = np.linalg.eigh(K / np.sqrt(np.outer(m, m)))
    F, omega, kept = X * np.sqrt(m)[:, None], np.sqrt(squares), int(rng.integers(3, max(5, n // 12)))
    hi = float(omega[kept] + rng.uniform(0.2, 0.8) * (omega[kept + 1] - omega[kept]))

    def spots() -> Array:
        """Weights of a few DOF, or of all DOF."""
        few = np.isin(np.arange(n), rng.choice(n, int(rng.integers(1, 6)), replace=False))
        return np.asarray(rng.uniform(0.2, 1.0, n) * (few if rng.random() < 0.6 else 1.0))

    def light() -> Array:
        ratio = 10.0 ** rng.uniform(-5, -2)
        return ratio * (omega[0] * np.diag(m) + K / hi) if rng.random() < 0.5 else np.diag(spots() * m * hi * ratio)

    def strong() -> Array:
        where = spots()
        return np.diag(where * m * hi * 10.0 ** rng.uniform(-1.0, 0.0 if where.all() else rng.choice([1.3, 1.3, 1.3, 6.0])))

    def gyroscopic() -> Array:
        G, (at, other) = np.zeros((n, n)), pairs[:len(pairs) - wide].T
        G[at, other] = spots()[at] * m[at] * hi * 10.0 ** rng.uniform(-3, -0.5)
        return np.asarray(G - G.T)

    def circulatory() -> Array:
        i = int(rng.integers(kept + 2))
        if rng.random() < 0.5:  # two modes act on each other
            force = (squares[i + 1] - squares[i]) * rng.uniform(0.2, 2.0)
            return np.asarray(force * (np.outer(F[:, i], F[:, i + 1]) - np.outer(F[:, i + 1], F[:, i])))
        N, (at, other) = np.zeros((n, n)), pairs[rng.choice(len(pairs) - wide, int(rng.integers(1, 6)), replace=False)].T
        N[at, other] = k[at] * 10.0 ** rng.uniform(-2, 0)
        return N

    every: dict[str, tuple[str, Callable[[], Array]]] = {
        "light": ("D", light), "strong": ("D", strong), "negative": ("D", lambda: -light()), "gyroscopic": ("D", gyroscopic),
        "circulatory": ("K", circulatory), "stiffness": ("K", lambda: np.diag(spots() * k * rng.uniform(-0.05, 0.5))),
        "mass": ("M", lambda: np.diag(spots() * m * rng.uniform(0, 0.5)))}
    low = 10.0 ** rng.uniform(-1, 2, 2)
    ranges = {"mu": (0.0, float(rng.uniform(0.1, 1.0))),
              **{name: (float(a), float(a * rng.uniform(1.1, 4.0))) for name, a in zip(("speed", "load"), low, strict=True)}}
    terms: dict[str, list[tuple[Any, Array]]] = {"M": [(1.0, np.diag(m))], "D": [(1.0, light())], "K": [(1.0, K)]}
    used = set(rng.choice(list(ranges), int(rng.integers(1, 4)), replace=False))
    usable = [theta for theta in THETAS if set(fs.Affine(K, None, [(theta, K)]).parameters) <= used]
    thetas = [usable[i] for i in rng.permutation(len(usable))[:int(rng.integers(1, 4))]]
    for i, theta in enumerate([*thetas, *[1.0] * int(rng.integers(len(thetas) < 2, 2))]):
        part = kind if i == 0 and kind != "mixed" else str(rng.choice(list(every), p=np.array([4, 3, 2, 4, 4, 4, 1]) / 22))
        name, made = every[part]
        alone = fs.Affine(K, None, [(theta, K)])  # whose largest factor in the box becomes 1
        largest = max(alone.at(**{key: point[key] for key in alone.parameters}).K[0, 0] / k[0] for point in corners(ranges))
        terms[name].append((theta, made() / largest))
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0] if rng.random() < 0.5 else None
    unit = 10.0 ** rng.uniform(-2, 4)  # of time

    def given(A: Array) -> Any:
        """The matrix, sparse, or dense in other coordinates with the same symmetry."""
        if turn is None:
            return sp.csr_array(A)
        upper, lower = (turn.T @ (A + sign * A.T) @ turn / 2 for sign in (1, -1))
        return (upper + upper.T) / 2 + (lower - lower.T) / 2

    full = fs.Affine(*([(theta, unit**power * given(A)) for theta, A in terms[key]] for power, key in enumerate("MDK")))
    return full, {name: ranges[name] for name in full.parameters}, (unit * hi * float(rng.choice([0.0, 0.0, 0.3])), unit * hi)


def corners(ranges: Mapping[str, tuple[float, float]]) -> list[dict[str, float]]:
    return [dict(zip(ranges, values, strict=True)) for values in product(*ranges.values())]


def at_random(ranges: Mapping[str, tuple[float, float]], rng: Random) -> dict[str, float]:
    return {name: float(rng.uniform(*ends)) for name, ends in ranges.items()}


def judged(full: fs.Affine, small: Any, point: dict[str, float], exact: Array) -> tuple[list[str], list[str], Array]:
    """What is wrong at a value with λ, growth and verdicts, and with the count; the largest error over its radius, and radius
    over |λ|.
    """
    pencil, modes, (a, b, lo, hi) = full.at(**point), small.modes(**point), small.box.region
    found, radius = modes.eigenvalues, modes.error_bar
    told, counts, ratio = list[str](), list[str](), 0.0
    where = ", ".join(f"{name} = {value:.9g}" for name, value in point.items())

    def inside(sign: int) -> Array:
        """The exact λ in the band with its edges moved inwards (1) or outwards (-1)."""
        by = sign * (BESIDE * hi + radius.max(initial=0.0))
        high = (exact.imag >= (lo + by if lo else 0.0)) & (exact.imag <= hi - by)
        return exact[high & (exact.real >= a + by) & (exact.real <= b - by)]

    for value in inside(1):
        if not (np.abs(value - found) <= radius).any():
            better, bar = newton(pencil, value)
            told += [f"λ = {better:.9g} is missing at {where}"] * (not (np.abs(better - found) <= radius + bar).any())
    for value, size, (least, most), stable in zip(found, radius, modes.full_growth, modes.stable, strict=True):
        better, bar = complex(exact[np.argmin(np.abs(exact - value))]), 0.0
        if not (abs(better - value) <= size and least <= better.real <= most and stable in (None, better.real < 0)):
            better, bar = newton(pencil, value)
        ratio = max(ratio, abs(better - value) / max(size, ROUNDING * hi))
        if not (abs(better - value) <= size + bar and least - bar <= better.real <= most + bar):
            told.append(f"λ = {value:.9g} ± {size:.2g} that grows by {least:.3g} to {most:.3g} is {better:.9g} at {where}")
        if contradicts(stable, better, bar):
            told.append(f"λ = {better:.9g} is called {'stable' if stable else 'unstable'} at {where}")
    better, bar = max(inside(1 if modes.is_stable else -1), key=lambda value: float(value.real), default=complex(-np.inf)), 0.0
    if np.isfinite(better) and contradicts(modes.is_stable, better, bar):
        better, bar = newton(pencil, better)
    if contradicts(modes.is_stable, better, bar):
        told.append(f"{'stable' if modes.is_stable else 'unstable'} with {better:.9g} at {where}")
    for cell in small.cells:
        if cell.number is not None and cell.holds(point):
            least, most = (int(np.count_nonzero(cell.contour.encloses(exact * (1 + side * BESIDE)))) for side in (1, -1))
            if not least <= cell.number <= most:
                counts.append(f"{least} in the contour, but {cell.number} ({cell.evidence}) at {where}")
    return told, counts, np.array([ratio, (radius / np.maximum(np.abs(found), ROUNDING * hi)).max(initial=0.0)])


def contradicts(stable: bool | None, value: complex, bar: float) -> bool:
    """Whether the sign of Re λ certainly contradicts a verdict."""
    return stable is not None and (value.real > bar if stable else value.real < -bar)


def spectrum(full: fs.Affine, point: Mapping[str, float]) -> Array:
    pencil = full.at(**point)
    return eigenvalues(*(dense(part) for part in (pencil.M, pencil.D, pencil.K)))


def newton(pencil: fs.Pencil, value: complex) -> tuple[complex, float]:
    """λ next to a value, by two-sided Rayleigh quotients, and its possible change by rounding."""
    M, D, K = (dense(part) for part in (pencil.M, pencil.D, pencil.K))
    x = y = np.random.default_rng(0).standard_normal(len(M)) + 0j
    for _ in range(5):
        factor = la.lu_factor((beside := value * (1 + 1e-12)) * (beside * M + D) + K)  # at λ itself a pivot may be 0
        for _ in range(2):
            x, y = (unit_length(la.lu_solve(factor, b, trans=turned)) for b, turned in ((x, 0), (y, 1)))
        slope = y @ (2 * value * (M @ x) + D @ x)
        value -= y @ (value * (value * (M @ x) + D @ x) + K @ x) / slope
        size = abs(value)**2 * np.abs(M) + abs(value) * np.abs(D) + np.abs(K)
        bar = float(10 * EPS * (np.abs(y) @ size @ np.abs(x)) / abs(slope))
    return complex(value), bar


def along(full: fs.Affine, small: Any, name: str, line: list[dict[str, float]], spectra: list[Array]) -> tuple[list[str], int]:
    """What is wrong with losses and regains along a line, and how many there are. Each is looked at, and between two points of
    the line all are found by bisection if they do not add up to how many more grow by the `spectra`.
    """
    others, (begin, end), (lo, hi) = {key: line[0][key] for key in line[0] if key != name}, small.box.ranges[name], small.box.band
    found = fs.critical_value(small.fixed(**others), None, name, between=(begin, end), band=(lo, hi))
    shortest, shift, told = BESIDE * (end - begin), ROUNDING * hi, list[str]()
    every = [(one, sign * (1 + (one.omega > 0))) for sign, several in ((1, found.losses), (-1, found.regains)) for one in several]

    def growing(exact: Array) -> Array:
        return exact[(np.abs(exact.imag) >= lo) & (np.abs(exact.imag) <= hi) & (exact.real > shift)]

    def near(omega: float, p: float) -> tuple[complex, float]:
        """λ of the full model next to iω, and the radius of the small model's λ."""
        exact, modes = spectrum(full, {**others, name: p}), small.modes(**{**others, name: p})
        found, size = np.append(modes.eigenvalues, np.inf), np.append(modes.error_bar, 0.0)
        return complex(exact[np.argmin(np.abs(exact - 1j * omega))]), float(size[np.argmin(np.abs(found - 1j * omega))])

    for one, _ in every:
        value, size = near(one.omega, one.value)
        told += [f"{one!r} is none at {others}"] * (not abs(value - 1j * one.omega) <= size + BESIDE * hi)
    for i, (before, after) in enumerate(pairwise(spectra)):
        a, b = line[i][name], line[i + 1][name]
        more = len(growing(after)) - len(growing(before)) - sum(step for one, step in every if a < one.value <= b)
        # of what comes into the band, or grows by more than rounding from there on, both ends grow
        for p, omega in crossed(lambda p: growing(spectrum(full, {**others, name: p})), np.array([a, b] * bool(more)), shortest):
            a, b = max(begin, p - 10 * shortest), min(end, p + 10 * shortest)
            ends = [newton(full.at(**{**others, name: end}), near(omega, end)[0])[0].real for end in (a, b)]
            room = 2 * shortest + 2 * (near(omega, p)[1] + shift) / max(abs(ends[1] - ends[0]) / (b - a), EPS)
            known = any(abs(one.value - p) <= room + one.width and abs(one.omega - omega) <= 1e-3 * hi for one, _ in every)
            known |= found.evidence == "not checked" or any(a - room <= p <= b + room for a, b in found.open) or min(ends) > 0
            told += [f"the crossing at {name} = {p:.9g}, ω = {omega:.6g} is missing at {others}"] * (
                not known and lo + BESIDE * hi < omega < hi * (1 - BESIDE))
    return told, len(every)
