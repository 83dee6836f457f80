"""`critical_value` against counts in 60 digits, closed forms and dense scans.

At many values of the parameter, and just beside each reported crossing, the number of growing eigenvalues must agree with the
losses and regains. Kinds with a closed form are sums of scalar oscillators λ² + d(p)λ + k(p), mixed by a congruence of few binary
digits: frequency, shape and place of each crossing are known.

The reference of the other kinds is a dense scan with bisection. These are the first five kinds; oscillators beside a damped chain
that pass through the band at any speed, and chains that stiffen as a whole, which are followed; and contacts that declare
themselves affine, in which large terms cancel. In the latter kinds 'refused' counts results that are not checked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp

import femsub as fs
from benchmarks.attacks.common import (
    Random,
    attack,
    crossed,
    crossings,
    eigenvalues,
    exact_eigenvalues,
    heard,
    miscounted,
    positive,
    row_of_springs,
)
from femsub.checks import Array

SCANNED = ("circulatory", "damped", "gyroscopic", "negative damping", "not affine")  # by a dense scan, in floating point
EXACT = ("heavy damping", "tiny damping", "undamped", "belt")
CLOSED = ("real pairs", "close crossings", "ends", "doubles")
PASSING = ("passing", "passing on a curve")  # through the band, followed; by dense eigenvalues
KINDS = (*SCANNED, *EXACT, *CLOSED, "units", *PASSING, "cancelling", "sweeping")

GRID = 2001
ON_AXIS = 1e-7  # of the largest |λ|: what rounding may do to an undamped eigenvalue near a coalescence
NEAR = 1e-7  # of the range: a crossing found by bisection is the same as one of `critical_value`


Judged = tuple[fs.CriticalValue | None, list[str]]  # the result, and what is wrong with it


class Problem(NamedTuple):
    kind: str
    family: fs.Affine
    between: tuple[float, float]
    undamped: bool


@attack("critical_values", KINDS, seed_first=True, silent=False)
def attacked(kind: str, rng: Random) -> str:
    """One random case: the evidence, or a text that begins with 'wrong'."""
    families = {"units": _units, "sweeping": _sweeping, "cancelling": _cancelling, **dict.fromkeys(SCANNED, _scanned),
                **dict.fromkeys(EXACT, _general), **dict.fromkeys(PASSING, _passing), **dict.fromkeys(CLOSED, _closed)}
    found, told = families[kind](kind, rng)
    if told:
        return f"wrong: {'; '.join(told)}: {found!r}"
    if found is None or (kind in (*PASSING, "cancelling", "sweeping") and found.evidence == "not checked"):
        return f"refused: {found!r}" if found else "refused"
    return found.evidence


# -- a dense scan in floating point


def _scanned(kind: str, rng: Random) -> Judged:
    task = problem(len(SCANNED) * int(rng.integers(2**31)) + SCANNED.index(kind))
    found = fs.critical_value(task.family, None, "p", between=task.between)
    return found, differences(task, found) if not found.open else []


def problem(seed: int) -> Problem:
    """A random model with one parameter p."""
    rng = np.random.default_rng(seed)
    kind, n = SCANNED[seed % len(SCANNED)], int(rng.integers(2, 7))

    M, K, any_K, skew = positive(rng, n, 0.5), 4 * positive(rng, n, 0.3), rng.standard_normal((n, n)), rng.standard_normal((n, n))
    skew, damping = skew - skew.T, 10.0 ** rng.uniform(-4, 0) * positive(rng, n, 0.01)
    between = (-float(rng.uniform(0.1, 3)), float(rng.uniform(0.5, 6)))
    eye = np.eye(n)
    terms: dict[str, tuple[Any, Any]] = {
        "circulatory": (None, [(1.0, K), ("p", any_K)]),
        "damped": (damping, [(1.0, K), ("p", any_K)]),
        "gyroscopic": ([(1.0, 2 * skew)], [(1.0, K - 3 * eye), ("p", positive(rng, n, 0.0) - eye)]),
        "negative damping": ([(1.0, damping), ("p", 0.1 * (any_K + any_K.T))], [(1.0, K), ("p", 0.2 * skew)]),
        "not affine": (damping, [(1.0, K), (lambda p: np.sin(3 * p), any_K), (lambda p: p**2, 0.1 * skew)])}
    return Problem(kind, fs.Affine(M, *terms[kind]), between, kind in ("circulatory", "gyroscopic"))


def counter(task: Problem) -> Callable[[float], int | None]:
    """The number of growing eigenvalues at p; None if their real parts are rounding."""
    def grown(p: float) -> int | None:
        M, D, K = (sum(((p if theta == "p" else theta(p) if callable(theta) else theta) * A for theta, A in terms),
                       np.zeros((task.family.size,) * 2)) for terms in (task.family.M, task.family.D, task.family.K))
        z = eigenvalues(M, D, K)
        rate = z.real / np.abs(z).max()
        if task.undamped:
            return int((rate > ON_AXIS).sum())
        return int((rate > 0).sum()) if np.abs(rate).min() > 1e-11 else None

    return grown


def differences(task: Problem, found: fs.CriticalValue) -> list[str]:
    """Where the result and the scan disagree, up to three places; nothing if they agree."""
    lo, hi = task.between
    values, near = crossings(found)[0], NEAR * (hi - lo)
    grid = np.concatenate([np.linspace(lo, hi, GRID), (values[1:] + values[:-1]) / 2, values - 2 * near, values + 2 * near])
    apart = np.abs(grid[:, None] - values).min(axis=1, initial=np.inf) > near
    return miscounted(found, grid[(grid >= lo) & (grid <= hi) & apart], counter(task))


# -- exact counts


def _rounded(A: Any, bits: int = 12) -> Array:
    """The same to `bits` binary digits behind the point of its largest entry."""
    unit = 2.0 ** (np.ceil(np.log2(np.abs(A).max())) - bits)
    return np.asarray(np.round(np.asarray(A) / unit) * unit)


def _general(kind: str, rng: Random) -> Judged:
    family, between = general(kind, rng)
    found = fs.critical_value(family, None, "p", between=between)
    return found, _by_counts(family, found, kind == "undamped")


def general(kind: str, rng: Random) -> tuple[fs.Affine, tuple[float, float]]:
    """A random model of 2 to 4 DOF without structure."""
    n = int(rng.integers(2, 5))
    spread = np.exp(rng.uniform(-1, 1, n))
    A, B = rng.standard_normal((2, n, n))
    spd = A @ A.T / n + 0.2 * np.eye(n)
    K = _rounded(np.diag(rng.uniform(0.5, 6, n)) + (0.6 * B if rng.random() < 0.5 else 0.3 * (B + B.T)))
    any_K, between = _rounded(rng.standard_normal((n, n))), (0.0, float(rng.uniform(1, 6)))
    M = _rounded(np.diag(spread) if rng.random() < 0.5 else spd)
    if kind == "undamped":
        return fs.Affine(M, None, [(1.0, K), ("p", any_K)]), between
    if kind == "belt":
        w = _rounded(rng.standard_normal(n))
        D = _rounded(10.0 ** rng.uniform(-6, 1) * spd)
        return fs.Affine(M, [(1.0, D), ("p", -_rounded(np.outer(w, w) * np.abs(D).max()))], K), between
    D = _rounded(10.0 ** (rng.uniform(1, 4) if kind == "heavy damping" else rng.uniform(-9, -2)) * spd)
    if rng.random() < 0.3:  # divergence alone
        any_K = _rounded(-(any_K @ any_K.T) / n)
    return fs.Affine(M, D, [(1.0, K), ("p", any_K)]), between


def exactly_growing(family: fs.Affine, p: float, undamped: bool) -> int | None:
    """How many λ have Re λ > 0 at p, in 60 digits where doubles leave a doubt; None if some may lie on the axis."""
    pencil = family.at(p=p)
    z = eigenvalues(pencil.M, pencil.D, pencil.K)
    if np.abs(z.real).min() > 1e-6 * np.abs(z).max():  # more than rounding moves a double eigenvalue
        return int((z.real > 0).sum())
    with mp.workdps(60):
        parts = (sum((mp.matrix(A.tolist()) * (p if theta == "p" else theta) for theta, A in terms), mp.zeros(family.size))
                 for terms in (family.M, family.D, family.K))
        found = exact_eigenvalues(*parts)
        size = max(abs(value) for value in found)
        rates = [float(value.real / size) for value in found]
    if any(abs(rate) < 1e-25 and not (undamped and abs(rate) < 1e-40) for rate in rates):
        return None
    return sum(rate > 1e-25 for rate in rates)


def _by_counts(family: fs.Affine, found: fs.CriticalValue, undamped: bool) -> list[str]:
    """Where the result differs from exact counts, up to three places."""
    lo, hi = found.searched
    values = crossings(found)[0]
    every = (*found.losses, *found.regains)
    points = [*np.linspace(lo, hi, 21), *((values[1:] + values[:-1]) / 2)]
    points += [one.value + side * max(one.width, 1e-12 * (hi - lo)) for one in every for side in (-1, 1)]
    points = [p for p in points if lo < p < hi and not any(abs(p - one.value) < 0.9 * one.width for one in every)
              and not any(a <= p <= b for a, b in found.open)]
    grown = {float(p): exactly_growing(family, float(p), undamped) for p in points}
    told = [] if found.open else miscounted(found, points, grown.__getitem__)
    told += [f"{count} grow at p = {p:.17g}, before the first loss" for p, count in grown.items() if count and p < found.value]
    for one in every if found.open else ():  # each of them is there, though others may be missing
        half = max(one.width, 1e-10 * (hi - lo))
        alone = sum(abs(one.value - other.value) <= 2 * half for other in every) == 1
        if alone and lo < one.value - half < one.value + half < hi:
            below, above = (exactly_growing(family, one.value + side * half, undamped) for side in (-1, 1))
            if below is not None and above is not None and (below < above) != (one in found.losses):
                told.append(f"{below} and {above} grow beside {one!r}")
    return [*told[:3], *_figures(family, found)]


def _figures(family: fs.Affine, found: fs.CriticalValue) -> list[str]:
    """Frequencies that are none at the crossing, growth of the wrong sign, shapes that leave a residual."""
    told = []
    for one in (*found.losses, *found.regains):
        pencil = family.at(p=one.value)
        M, D, K = pencil.M, pencil.D, pencil.K
        at = 1j * one.omega
        P = at * at * M + at * D + K
        size = max(np.abs(at * at * M).max(), np.abs(at * D).max(), np.abs(K).max())
        residual = np.linalg.norm(P @ one.shape) / size
        if residual > 1e-3:
            told.append(f"residual {residual:.1e} at {one.value:.9g}")
        below, above = one.growth if one in found.losses else one.growth[::-1]
        if not (above > below and above > 0 and below <= 1e-6):
            told.append(f"growth {one.growth} at {one.value:.9g}")
    return told


# -- closed forms


def _mixed(rng: Random, n: int) -> Array:
    """A regular matrix T of small whole numbers, for congruences TᵀAT that are exact."""
    while True:
        T = np.eye(n) + rng.integers(-1, 2, (n, n)) * (rng.random((n, n)) < 0.5)
        if abs(np.linalg.det(T)) > 0.5 and np.linalg.cond(T) < 30:
            return np.asarray(T)


def _closed(kind: str, rng: Random) -> Judged:
    """Oscillators λ² + (d + p d')λ + k + p k', mixed by a congruence; all figures of few binary digits."""
    n = int(rng.integers(1, 5))
    lo, hi = 0.0, 2.0
    d, dp, k, kp = np.zeros((4, n))
    k = np.sort(rng.choice(np.arange(8, 200), n, replace=False)) / 8.0
    d = _dyadic(rng.uniform(0.01, 1, n))
    if kind == "real pairs":
        where = _dyadic(rng.uniform(0.1, 1.9, n))
        kp = rng.choice([-1.0, 1.0], n) * _dyadic(rng.uniform(0.2, 4, n), 6)
        k = -kp * where
        d = rng.choice([-1.0, 1.0, 1.0], n) * 2.0 ** rng.integers(-28, 12, n)
    elif kind == "close crossings":
        dp = rng.choice([-1.0, 1.0], n) * _dyadic(rng.uniform(0.1, 2, n), 6)
        places = 1.0 + np.cumsum([0.0, *(2.0 ** rng.integers(-46, -6, n - 1))]) if n > 1 else np.ones(1)
        d = -dp * rng.permutation(places)  # rounded by less than 1e-15 of the range
    elif kind == "ends":
        dp = rng.choice([-1.0, 1.0], n) * _dyadic(rng.uniform(0.1, 2, n), 6)
        d = -dp * rng.choice([lo, hi, 0.75, 1.25], n)
    else:  # doubles
        n = 2 * max(1, n // 2)
        k = np.repeat(rng.choice(np.arange(8, 100), n // 2, replace=False) / 8.0, 2)
        dp = np.repeat(rng.choice([-1.0, 1.0], n // 2) * _dyadic(rng.uniform(0.1, 2, n // 2), 6), 2)
        d = -dp * np.repeat(_dyadic(rng.uniform(0.1, 1.9, n // 2)), 2)
        kp = np.zeros(n)
    T = _mixed(rng, n)
    plain = rng.random() < 0.7
    S = T.T if plain else _mixed(rng, n)  # unsymmetric matrices, M as well
    far, time = float(rng.choice([0.0, 0.0, 0.0, 2.0**16])), 2.0 ** float(rng.choice([0, 0, -24, 24]))
    d, dp, k, kp = (d - far * dp) * time, dp * time, (k - far * kp) * time**2, kp * time**2
    family = fs.Affine(S @ T, [(1.0, S @ np.diag(d) @ T), ("p", S @ np.diag(dp) @ T)],
                       [(1.0, S @ np.diag(k) @ T), ("p", S @ np.diag(kp) @ T)])
    band = None
    if rng.random() < 0.25:
        band = (0.0, 3.1 * time) if rng.random() < 0.5 else (3.1 * time, 100.0 * time)
    try:
        found = fs.critical_value(family, None, "p", between=(lo + far, hi + far), band=band)
    except fs.InputError as error:
        if not plain and "M is singular" in str(error):  # by chance symmetric, but not definite
            return None, []
        raise
    return found, _by_form(d, dp, k, kp, T, found)


def _dyadic(x: Array, bits: int = 10) -> Array:
    return np.asarray(np.round(np.asarray(x) * 2**bits) / 2**bits)


def _by_form(d: Array, dp: Array, k: Array, kp: Array, T: Array, found: fs.CriticalValue) -> list[str]:
    """Where the result differs from the crossings of each oscillator."""
    lo, hi = found.searched
    least, most = found.band
    time = float(np.abs(d).max() + np.sqrt(np.abs(k).max()))
    exact: list[tuple[bool, float, float, Array]] = []  # loss, place, ω, shape
    inverse = np.linalg.inv(T)
    for i in range(len(d)):
        if dp[i]:
            p = -d[i] / dp[i]
            if lo <= p <= hi and k[i] + p * kp[i] > 0 and (dp[i] < 0 or p > lo):
                exact.append((bool(dp[i] < 0), p, float(np.sqrt(k[i] + p * kp[i])), inverse[:, i]))
        if kp[i]:
            p = -k[i] / kp[i]
            if lo <= p <= hi and d[i]:  # one of two real eigenvalues passes 0, upwards if the stiffness falls and d > 0
                exact.append((bool((kp[i] < 0) == (d[i] > 0)), p, 0.0, inverse[:, i]))
    exact = [item for item in exact if least <= item[2] <= most]
    told = []
    every = [(True, one) for one in found.losses] + [(False, one) for one in found.regains]
    if not found.open and len(every) != len(exact):
        told.append(f"{len(every)} crossings told, {len(exact)} exist")
    left = list(exact)
    for loss, one in every:
        slack = one.width + 4e-11 * (hi - lo)
        fit = [item for item in left if item[0] == loss and abs(item[1] - one.value) <= slack
               and abs(item[2] - one.omega) <= 1e-6 * max(one.omega, 1e-3 * time)]
        if not fit:
            told.append(f"{one!r} is none of {[item[:3] for item in left]}")
            continue
        cosine = [abs(item[3] @ one.shape) / np.linalg.norm(item[3]) for item in fit]
        same = [item for item in exact if abs(item[2] - one.omega) <= 1e-6 * max(one.omega, 1e-3 * time)]
        if len(same) == 1 and max(cosine) < 0.999:
            told.append(f"{one!r} has another shape, cosine {max(cosine):.3f}")
        at = next(i for i, item in enumerate(left) if item is fit[int(np.argmax(cosine))])
        left.pop(at)
        below, above = one.growth if loss else one.growth[::-1]
        if not (above > -1e-12 * time and above >= below and below <= 1e-9 * time):
            told.append(f"growth {one.growth} of {one!r}")
    losses = [item[1] for item in exact if item[0]]
    damping, stiffness = d + lo * dp, k + lo * kp
    roots = np.concatenate([(-damping + sign * np.sqrt(damping**2 - 4 * stiffness + 0j)) / 2 for sign in (1, -1)])
    roots = roots[(np.abs(roots.imag) >= least) & (np.abs(roots.imag) <= most)]
    growing = int((roots.real > 0).sum())
    if found.growing != growing:
        told.append(f"{growing} grow at the begin, but {found.growing} are told")
    if not growing and min(losses, default=np.inf) < found.value - 1e-9 - 1e-11 * abs(lo):
        told.append(f"the first loss is at {min(losses):.9g}")
    return told


def _units(_: str, rng: Random) -> Judged:
    """The same model in other units of its DOF, and in other coordinates: places and kinds stay, kinds follow from the powers."""
    n = int(rng.integers(2, 5))
    A, B, C = rng.standard_normal((3, n, n))
    M, K = _rounded(A @ A.T / n + 0.5 * np.eye(n)), _rounded(np.diag(rng.uniform(1, 6, n)))
    D = _rounded(10.0 ** rng.uniform(-3, 0) * (B @ B.T / n - 0.05 * np.eye(n)))
    skew, extra = _rounded(C - C.T), _rounded(0.05 * (B + B.T))
    between = (0.0, 3.0)

    def model(T: Array) -> fs.Affine:
        terms = [T.T @ part @ T for part in (M, D, extra, K, skew)]
        return fs.Affine(terms[0], [(1.0, terms[1]), ("p", terms[2])], [(1.0, terms[3]), ("p", terms[4])])

    plain = fs.critical_value(model(np.eye(n)), None, "p", between=between)
    told = _by_counts(model(np.eye(n)), plain, False)
    for one in (*plain.losses, *plain.regains):
        if one.kind == "divergence":
            continue
        pencil = model(np.eye(n)).at(p=one.value)
        x = np.linalg.svd(-one.omega**2 * pencil.M + 1j * one.omega * pencil.D + pencil.K)[2][-1].conj()
        power = float((x.conj() @ pencil.D @ x).real)
        clear = abs(power) > 1e-6 * float(np.abs(x) @ np.abs(pencil.D) @ np.abs(x))
        if clear and one.kind != ("hopf" if power < 0 else "flutter"):
            told.append(f"{one!r}, but Re xᴴDx = {power:.3g}")
    for T in (np.diag(2.0 ** rng.integers(-12, 13, n)), _mixed(rng, n)):
        other = fs.critical_value(model(T), None, "p", between=between)
        if plain.open or other.open:
            continue
        for ours, theirs in ((plain.losses, other.losses), (plain.regains, other.regains)):
            if [one.kind for one in ours] != [one.kind for one in theirs]:
                told.append(f"kinds {[one.kind for one in ours]} become {[one.kind for one in theirs]}")
            elif any(abs(a.value - b.value) > a.width + b.width + 1e-10 for a, b in zip(ours, theirs, strict=True)):
                told.append("places differ with the units")
    return plain, told


# -- modes that pass through the band


def _passing(kind: str, rng: Random) -> Judged:
    """A damped chain and oscillators weakly joined to it, whose frequency and damping change with p, growing or not."""
    n, beside = int(rng.integers(5, 25)), int(rng.integers(1, 4))
    size = n + beside
    springs = np.exp(rng.uniform(-0.5, 0.5, n + 1))
    K = np.zeros((size, size))
    K[:n, :n] = row_of_springs(springs)
    omega = np.sqrt(np.linalg.eigvalsh(K[:n, :n]))
    lo = float(rng.uniform(0.05, 0.8)) * omega[-1]
    band = lo, lo * float(1 + 10.0 ** rng.uniform(-1.5, 0))
    D = 10.0 ** rng.uniform(-4, -1.5) * K + 10.0 ** rng.uniform(-6, -3) * np.eye(size)
    M = np.eye(size)
    K1, D1, places = np.zeros((size, size)), np.zeros((size, size)), []
    for i in range(n, size):
        at, joined = int(rng.integers(n)), 10.0 ** rng.uniform(-8, -2)
        K[[i, at], [i, at]] += joined
        K[i, at], K[at, i] = K[i, at] - joined, K[at, i] - joined
        if rng.random() < 0.3:
            K1[i, at] += joined * rng.standard_normal()
        inside, share = float(rng.uniform(0, 1)), 10.0 ** rng.uniform(-3, -0.3)  # where it is mid-band, and how long it is in
        speed = float(rng.choice([-1.0, 1.0])) * (band[1] ** 2 - band[0] ** 2) / share
        middle = (band[1] ** 2 + band[0] ** 2) / 2 - speed * inside
        if middle < 0 or middle + speed < 0:  # it would diverge: the other way round, from 0
            speed, middle = abs(speed), max(0.0, (band[1] ** 2 + band[0] ** 2) / 2 - abs(speed) * inside)
        K[i, i], K1[i, i] = K[i, i] + middle, K1[i, i] + speed
        place = inside + share * float(rng.uniform(-0.7, 0.7))
        rate = float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(-4, -1)
        D[i, i], D1[i, i] = D[i, i] - rate * place, D1[i, i] + rate
        places += [inside + share * (0.5 + 0.01) * side for side in np.linspace(-1, 1, 41)]
        places += [place + share * side * 10.0 ** -k for side in (-1, 1) for k in range(4)]
    bend = float(rng.uniform(0.2, 2.5))

    def theta(p: float) -> float:
        return float(np.sin(bend * p) / np.sin(bend)) if bend < 1.5 else float(p * p)

    def inverse(q: Array) -> Array:
        return np.arcsin(q * np.sin(bend)) / bend if bend < 1.5 else np.sqrt(q)

    term: Any = theta if kind == "passing on a curve" else "p"
    family = fs.Affine(M, [(1.0, D), ("p", D1)] if term == "p" else [(1.0, D), (term, D1)], [(1.0, K), (term, K1)])
    grid = np.array(places)
    grid = grid[(grid > 0) & (grid < 1)]
    grid = np.union1d(np.linspace(0, 1, 201), grid if term == "p" else inverse(grid))
    turned = rng.random() < 0.3
    between = (1.0, 0.0) if turned else (0.0, 1.0)
    found = heard(fs.critical_value, family, None, "p", between=between, band=band, solver="followed")[0]

    def spectrum(p: float) -> Array:
        q = p if term == "p" else theta(p)
        return eigenvalues(M, D + q * D1, K + q * K1)

    return found, _against(spectrum, grid, band, found)


def _sweeping(_: str, rng: Random) -> Judged:
    """A chain that stiffens or softens as a whole, so that its modes pass through the band one after the other.

    Dashpots turn negative, or two masses act on each other by a circulatory force.
    """
    n = int(rng.integers(8, 30))
    springs = np.exp(rng.uniform(-0.5, 0.5, n + 1))
    K = row_of_springs(springs)
    omega = np.sqrt(np.linalg.eigvalsh(K))
    lo = float(rng.uniform(0.05, 0.9)) * omega[-1]
    band = lo, lo * float(1 + 10.0 ** rng.uniform(-1.5, -0.3))
    D = 10.0 ** rng.uniform(-4, -2) * K + np.diag(10.0 ** rng.uniform(-5, -2, n))
    K1, D1 = K * float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-2, -0.1)), np.zeros((n, n))
    if rng.random() < 0.6:
        at = rng.integers(n, size=2)
        D1[at, at] -= D[at, at] * 10.0 ** rng.uniform(0, 1.5)
    if rng.random() < 0.6:
        at = rng.choice(n, 2, replace=False)
        force = 10.0 ** rng.uniform(-3, 0)
        K1[at[0], at[1]] += force
        K1[at[1], at[0]] -= force
    family = fs.Affine(np.eye(n), [(1.0, D), ("p", D1)], [(1.0, K), ("p", K1)])
    found = heard(fs.critical_value, family, None, "p", between=(0.0, 1.0), band=band, solver="followed")[0]

    return found, _against(lambda p: eigenvalues(np.eye(n), D + p * D1, K + p * K1), np.linspace(0.0, 1.0, 801), band, found)


@dataclass(frozen=True)
class Rubbing:
    """Friction of relative motions of points that move almost alike, declared affine: the terms of W C Wᵀ cancel."""

    mu: float
    stiffness: tuple[float, ...]
    ports = ("points",)
    affine = ("mu",)

    def linearised(self, model: fs.Substructure) -> tuple[None, Array]:
        C = np.zeros((4 * len(self.stiffness),) * 2)
        pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
        for i, k in enumerate(self.stiffness):
            C[4 * i:4 * i + 2, 4 * i:4 * i + 2], C[4 * i + 2:4 * i + 4, 4 * i:4 * i + 2] = k * pair, self.mu * k * pair
        return None, C


def _cancelling(_: str, rng: Random) -> Judged:
    """A model of a few DOF under such a contact, damped; the reference takes the differences of the columns first."""
    n, count = int(rng.integers(3, 9)), int(rng.integers(1, 4))
    A, B = rng.standard_normal((2, n, n))
    M, K = A @ A.T / n + 0.5 * np.eye(n), np.diag(np.sort(rng.uniform(1, 6, n)))
    D = 10.0 ** rng.uniform(-3, -1) * (B @ B.T / n + 0.1 * np.eye(n))
    stiffness = 10.0 ** rng.uniform(0, 7, count)
    W = np.repeat(rng.standard_normal((n, 2 * count)), 2, axis=1)
    W[:, 1::2] += np.repeat(10.0 ** rng.uniform(-1, 0.3, count) / np.sqrt(stiffness), 2) * rng.standard_normal((n, 2 * count))
    model = fs.Substructure(M, K, D, ports={"points": W})
    top = float(10.0 ** rng.uniform(-1, 1))
    found = fs.critical_value(model, Rubbing(0.0, tuple(stiffness)), "mu", between=(0.0, top))
    apart = W[:, ::2] - W[:, 1::2]
    normal, tangential = apart[:, ::2], apart[:, 1::2]
    whole, turning = K + normal * stiffness @ normal.T, tangential * stiffness @ normal.T

    def spectrum(p: float) -> Array:
        return eigenvalues(M, D, whole + p * top * turning)

    scaled = replace(found, losses=tuple(replace(one, value=one.value / top, width=one.width / top) for one in found.losses),
                     regains=tuple(replace(one, value=one.value / top, width=one.width / top) for one in found.regains))
    return found, _against(spectrum, np.linspace(0.0, 1.0, 201), (-1e-9, np.inf), scaled)


def _against(spectrum: Callable[[float], Array], grid: Array, band: tuple[float, float], found: fs.CriticalValue) -> list[str]:
    """Losses and regains that a fine grid of dense eigenvalues has in the band, beside those of a result that is confirmed."""
    if found.evidence == "not checked":
        return []

    exact = crossed(spectrum, grid, 1e-10)
    every = (*found.losses, *found.regains)
    told = []
    for p, omega in exact:
        inside = band[0] * (1 + 1e-6) < omega < band[1] * (1 - 1e-6) and 1e-9 < p < 1 - 1e-9
        if inside and not any(abs(one.value - p) <= 1e-7 + one.width and abs(one.omega - omega) <= 1e-4 * omega + 1e-6
                              for one in every):
            told.append(f"the crossing at p = {p:.9g}, ω = {omega:.6g} is missing")
    for one in every:
        near = [spectrum(one.value + side * max(1e-8, one.width)) for side in (-1, 1)]
        rates = [z[np.argmin(np.abs(z - 1j * one.omega))].real for z in near]
        if not band[0] * (1 - 1e-6) <= one.omega <= band[1] * (1 + 1e-6) or rates[0] * rates[1] > 0 or max(np.abs(rates)) > 1e-2:
            told.append(f"{one!r} is none, Re λ beside it {rates}")
    return told[:3]
