"""Borders of stability by several methods: contacts with kinks, solvers that must agree, reduced models, and meetings of modes.

kinks     Contacts and laws with kinks and jumps over their parameter, declared affine or not, with knots or without. The number
          of growing eigenvalues that follows from losses and regains is compared with LAPACK's count in the state matrix, made
          from the model's M, D, K and the law itself: at values all over the range, and on both sides of each kink. Dips
          without knots are wider than the distance of the samples of C_D and C_K, which is documented as a limit.
solvers   One question, several solvers: losses by discs, followed, by the port's root, `critical_slope`, and the Hopf start of a
          branch. Random models of 4 to 12 DOF. 'flutter': a circulatory K grows with the parameter. 'hopf': the slope of a belt.
          'divergence': a load takes stiffness away. 'undamped': flutter without damping, where two modes coalesce. Values,
          frequencies and kinds must agree.
twins     Reduced models with twin frequencies: two beams of nearly one frequency on a foot, against the full model. The belt acts
          on the tip of one beam, or on the foot. Dashpots are on the foot, on the tip of the other beam, or nearly nowhere. The
          band ends at 0.7 of the cut-off. A slope that is off by more than 3.5 % without a warning is wrong.
meetings  `track`: coalescences that are planted must be named, and none beside them. The undamped models have M = 1 and ω² the
          eigenvalues of K(p). There a coalescence or splitting is a value at which the number of real ω², or of positive ones,
          changes: found on a grid with bisection, or known in closed form where K is made of blocks of two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, crossings, eigenvalues, heard, miscounted, positive
from femsub.checks import Array
from femsub.stability.meetings import Meeting

KINKS = ("table", "table with knots", "two contacts", "stiffness", "declared", "declared falsely")
SOLVERS = ("flutter", "hopf", "divergence", "undamped")
TWINS = ("twin beams", "free interface", "joined", "tolerance")
MEETINGS = ("circulatory", "blocks", "through a pair", "damped alike", "damped", "veering", "symmetric")
GRID = 300  # number of values of a law with kinks
CLEAR = 1e-9  # share of the largest |λ|: a larger |Re λ| is certainly growing or decaying
BESIDE = 1e-7  # share of the range around a crossing that is not compared
SAME = 1e-7  # share of the range, in addition to the widths, within which two values are the same loss
LIKE = 1e-5  # relative difference of equal frequencies; near a coalescence the square root of SAME
OFF = 0.035  # relative error of a reduced model's slope that needs a warning
FINE = 4001  # number of grid values on which meetings of modes are searched
GAP = 1e-3  # difference of two λ of about 2 that are equal up to rounding
APART = 1e-6  # share of the range within which a meeting is the meeting of the reference


# -- kinks


@dataclass(frozen=True)
class Steps:
    """μ' = `level`, and `falls` between the edges 2i and 2i + 1."""

    edges: tuple[float, ...]
    falls: tuple[float, ...]
    level: float = 0.0

    def value(self, v: Any) -> Any:
        dips = zip(self.edges[::2], self.edges[1::2], self.falls, strict=True)
        return 1.0 + self.level * np.asarray(v) + sum(fall * np.clip(np.asarray(v) - a, 0.0, b - a) for a, b, fall in dips)

    def slope(self, v: Any) -> Any:
        dips = zip(self.edges[::2], self.edges[1::2], self.falls, strict=True)
        return self.level + sum(fall * (np.heaviside(np.asarray(v) - a, 0.5) - np.heaviside(np.asarray(v) - b, 0.5))
                                for a, b, fall in dips)


class Knots(Steps):
    """The same with its knots."""

    @property
    def knots(self) -> tuple[float, ...]:
        return self.edges


@dataclass(frozen=True)
class Table:
    """C_D = c·1 or C_K = c·[[0, 1], [-1, 0]], with c = linear interpolation in a table over p."""

    p: float = 0.0
    at: tuple[float, ...] = (0.0, 1.0)
    c: tuple[float, ...] = (0.0, 0.0)
    circulatory: bool = False

    @property
    def ports(self) -> tuple[str, ...]:
        return ("a", "b") if self.circulatory else ("belt",)

    def linearised(self, model: fs.Substructure) -> tuple[Any, Any]:
        c = float(np.interp(self.p, self.at, self.c))
        return (None, c * np.array([[0.0, 1.0], [-1.0, 0.0]])) if self.circulatory else (c, None)


class Declared(Table):
    """The same, declared affine in p whether it is or not."""

    affine = ("p",)


@attack("kinks", KINKS, seed_first=True, silent=False)
def kinks(kind: str, rng: Random) -> str:
    """One random case: the evidence if the result is right."""
    model = rubbed_model(rng)
    lo = float(rng.uniform(0.05, 0.5))
    hi = lo + float(10.0 ** rng.uniform(-0.5, 1.0))
    between, force = (lo, hi), float(10.0 ** rng.uniform(-1, 1))
    narrow = 10.0 ** rng.uniform(-8, -2) if kind == "table with knots" else 10.0 ** rng.uniform(-2.9, -0.5)
    places = np.sort(rng.uniform(lo, hi, 2 * int(rng.integers(1, 3))))
    places[1::2] = np.minimum(places[::2] + narrow * (hi - lo), np.append(places[2::2], hi) - 1e-3 * (places[1::2] - places[::2]))
    edges = tuple(places.tolist())
    depth = tuple((-(10.0 ** rng.uniform(-2.5, 0.5, len(edges) // 2))).tolist())
    law = (Knots if kind == "table with knots" or rng.random() < 0.3 else Steps)(edges, depth, float(rng.choice([0.0, 0.02])))
    if kind.startswith("table") or kind == "two contacts":
        if any(b - a < 1e-3 * (hi - lo) for a, b in zip(edges[::2], edges[1::2], strict=True)) and not isinstance(law, Knots):
            law = Knots(law.edges, law.falls, law.level)
        contacts: list[Any] = [fs.Belt(force=force, speed=lo, law=law)]
        if kind == "two contacts":
            other = Steps((float(rng.uniform(lo, hi)), hi + 1.0), (float(rng.uniform(-0.1, 0.1)),))
            contacts.append(fs.Belt("a", force=force, speed=lo, law=other))
            edges = (*edges, other.edges[0])
        name = "speed"
    else:
        name, at = "p", np.sort(np.concatenate([[lo, hi], rng.uniform(lo, hi, 3)]))
        c = rng.uniform(-1.0, 1.0, len(at)) * 10.0 ** rng.uniform(-2, 0)
        if kind == "declared":
            c = np.interp(at, [lo, hi], c[[0, -1]])
        contacts = [(Table if kind == "stiffness" else Declared)(lo, tuple(at.tolist()), tuple(c.tolist()),
                                                                 kind == "stiffness" or bool(rng.random() < 0.5))]
        edges = tuple(at[1:-1].tolist())
    try:
        found = fs.critical_value(model, contacts, name, between=between)
    except fs.InputError as error:
        return "refused" if kind == "declared falsely" and "declares that it is affine" in str(error) else \
            f"wrong: {error}"
    if kind == "declared falsely":
        return f"wrong: the kinks at {edges} contradict the declaration, but nothing is said"
    steps = narrow * np.array([-1.0, -0.5, -0.1, 0.1, 0.5, 1.0])
    p = np.concatenate([np.linspace(lo, hi, GRID), *(edge + np.append(steps, steps * 1e-3) * (hi - lo) for edge in edges)])
    # not compared where rounding decides: beside crossings and open intervals
    events = np.append(crossings(found)[0], [end for part in found.open for end in part])
    p = p[(p > lo) & (p < hi) & (np.abs(p[:, None] - events).min(axis=1, initial=np.inf) > BESIDE * (hi - lo))]

    def grown(value: float) -> int | None:
        D, K = np.array(model.D), np.array(model.K)
        for contact in contacts:
            changed = replace(contact, **{name: value})
            W = np.column_stack([model.port(port) for port in changed.ports])
            if isinstance(changed, fs.Belt):
                D = D + changed.force * float(changed.law.slope(value)) * W @ W.T  # type: ignore[union-attr]
            else:
                C = changed.linearised(model)
                D, K = (A if one is None else A + W @ (one * np.eye(W.shape[1]) if np.ndim(one) == 0 else one) @ W.T
                        for A, one in zip((D, K), C, strict=True))
        z = eigenvalues(model.M, D, K)
        return None if np.abs(z.real).min() <= CLEAR * np.abs(z).max() else int((z.real > 0).sum())

    difference = miscounted(found, p, grown)
    if difference and found.evidence != "not checked":
        return f"wrong: {found!r}; {'; '.join(difference)}"
    return "told" if difference else found.evidence


def rubbed_model(rng: Random) -> fs.Substructure:
    n = int(rng.integers(2, 5))
    K, unit = positive(rng, n, 0.5), np.eye(n)
    D = 10.0 ** rng.uniform(-3, -1) * (0.2 * np.eye(n) + 0.1 * K)
    return fs.Substructure(np.eye(n), K, D, ports={"belt": rng.standard_normal(n), "a": unit[0], "b": unit[1]})


# -- solvers


@attack("solvers", SOLVERS, seed_first=True)
def solvers(kind: str, rng: Random) -> str:
    """One random case: 'agree', 'none' if nothing is lost, 'open' if a solver says that it does not know."""
    model, contacts, name, between, top = model_for_all(kind, rng)
    exact = fs.critical_value(model, contacts, name, between=between, band=(0.0, top), solver="discs")
    other = fs.critical_value(model, contacts, name, between=between, band=(0.0, top), solver="followed")
    if other.open or exact.open:
        return "open"
    if (told := _differ(exact, other)):
        return f"wrong: discs {exact!r}, followed {other!r}: {told}"
    if kind == "hopf":
        assert isinstance(model, fs.Substructure)
        root, slope = (fs.critical_value(model, contacts, name, between=between, band=(0.0, top), solver="root"),
                       fs.critical_slope(model))
        if exact.losses and not (_alike(exact, root) and _alike(exact, slope)):
            return f"wrong: discs {exact!r}, root {root!r}, slope {slope!r}"
        if exact.losses and len(slope.crossing) == 1:
            belt = fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2))
            begun = fs.branch(model, belt, "slope", (2 * slope.value, 0.5 * slope.value), points=1, stability=False).hopf
            if begun is None or abs(begun.value / slope.value - 1) > SAME or abs(begun.omega / slope.omega - 1) > LIKE:
                return f"wrong: slope {slope!r}, branch {begun!r}"
    return "agree" if exact.losses else "none"


def _differ(one: fs.CriticalValue, two: fs.CriticalValue) -> str:
    reach = abs(one.searched[1] - one.searched[0])
    for name in ("losses", "regains"):
        mine, theirs = (sorted(getattr(item, name), key=lambda each: (each.value, each.omega)) for item in (one, two))
        if [each.kind for each in mine] != [each.kind for each in theirs]:
            return f"kinds of {name}"
        for a, b in zip(mine, theirs, strict=True):
            if abs(a.value - b.value) > SAME * reach + a.width + b.width:
                return f"values {a.value} and {b.value}"
            if abs(a.omega - b.omega) > LIKE * max(a.omega, b.omega):
                return f"frequencies {a.omega} and {b.omega}"
    return "" if one.growing == two.growing else "number that grows at the begin"


def _alike(one: fs.CriticalValue, two: fs.CriticalValue) -> bool:
    return (abs(two.value / one.value - 1) <= SAME and abs(two.omega / one.omega - 1) <= LIKE
            and two.losses[0].kind == one.losses[0].kind)


def model_for_all(kind: str, rng: Random
           ) -> tuple[fs.Substructure | fs.Affine, fs.Belt | None, str, tuple[float, float], float]:
    n = int(rng.integers(4, 13))
    M, K = positive(rng, n, 0.1), 10.0 ** rng.uniform(0, 4) * positive(rng, n, 0.1)
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.max())
    D = 10.0 ** rng.uniform(-4, -2) * (omega * M + K / omega) + 1e-3 * omega * positive(rng, n, 0.1)
    if kind == "hopf":
        w = rng.standard_normal(n)
        feeds = float(w @ np.linalg.solve(D, w))
        return fs.Substructure(M, K, D, ports={"belt": w}), fs.Belt(slope=0.0), "slope", (0.0, -3 / feeds), 1.5 * omega
    if kind == "divergence":
        load = positive(rng, n, 0.1)
        lost = 1 / np.linalg.eigvals(np.linalg.solve(K, load)).real.max()
        return fs.Affine(M, D, [(1.0, K), ("p", -load)]), None, "p", (0.0, 1.7 * lost), 1.5 * omega
    turning = np.outer(rng.standard_normal(n), rng.standard_normal(n)) * np.linalg.norm(K) / n * rng.uniform(0.2, 2.0)
    return fs.Affine(M, None if kind == "undamped" else D, [(1.0, K), ("p", turning)]), None, "p", (0.0, 1.0), 2.0 * omega


# -- twins


@attack("twins", TWINS, seed_first=True)
def twins(kind: str, rng: Random) -> str:
    """One random case: 'right', 'told' if the slope is off, 'needless' if the warning was not necessary."""
    beams, foot, port = twin_parts(rng)
    modes, with_port = int(rng.integers(2, 9)), bool(rng.random() < 0.5)
    joints = [fs.Rigid((name, "left"), ("foot", "top")) for name in beams]
    if kind == "joined":
        full: fs.Substructure = fs.couple(beams | {"foot": foot}, joints)
        method = (fs.CraigBampton, fs.Rubin)[int(rng.integers(2))]
        small: fs.Substructure = fs.reduce(full, {name: method(modes) for name in beams}, ports=with_port)
        port = "one.tip" if port == "tip" else "foot.foot"
    else:
        parts = fs.couple(beams | {"foot": foot}, joints, interface=[("foot", "top")])
        full = fs.Substructure(parts.M, parts.K, parts.D, interface=parts.interface, name="twins",
                               ports={"tip": parts.port("one.tip"), "foot": parts.port("foot.foot")})
        if kind == "tolerance":
            top = float(fs.normal_modes(full, count=8).frequencies[int(rng.integers(2, 8))])
            asked = fs.CraigBampton(band=(0.0, top), tol=float(10.0 ** rng.uniform(-4, -1.5)))
            small = fs.reduce(full, asked, ports=with_port)
        else:
            free = (fs.CraigChang, fs.Rubin, fs.MacNeal)[int(rng.integers(3))]
            small = fs.reduce(full, (free if kind == "free interface" else fs.CraigBampton)(modes), ports=with_port)
    band = (0.0, 0.6999 * small.cutoff if np.isfinite(small.cutoff) else 1e3)
    try:
        exact = fs.critical_slope(full, port, band=band)
    except fs.FemsubError:
        return "no reference"
    found, refusal, told = heard(fs.critical_slope, small, port, band=band)
    if refusal:
        return "refused"
    same = found.value == exact.value or abs(found.value - exact.value) <= OFF * abs(exact.value)
    if same:
        near = abs(found.value - exact.value) > 0.5 * OFF * abs(exact.value) if np.isfinite(exact.value) else False
        return "right" if not told else "told within half the limit" if near else "needless"
    return "told" if told else f"wrong: {found!r}, full {exact!r}, {small!r}"


def twin_parts(rng: Random) -> tuple[dict[str, fs.Substructure], fs.Substructure, str]:
    """Two beams, a foot of a mass and an inertia on springs, and the port under the belt."""
    n, detuned = int(rng.integers(6, 11)), 1 + 10.0 ** rng.uniform(-6, -1.5)
    material, a, b = (10.0 ** rng.uniform(-6, -3), 10.0 ** rng.uniform(-8, -5)), rng.random(), rng.random()
    beams = {}
    for name, E in (("one", 1.0), ("two", detuned)):
        beam = fs.beam(1.0, n, E=E, I=1.0, rho=1.0, A=1.0, interface=["left"], ports={"tip": "right"}, rayleigh=material,
                       name=name)
        if name == "two" and a < 0.7:
            w = beam.port("tip").reshape(-1, 1)
            beam = beam.with_damping(beam.D.toarray() + 10.0 ** rng.uniform(-4, 0) * w @ w.T)
        beams[name] = beam
    M, K = np.diag([10.0 ** rng.uniform(-1, 1), 10.0 ** rng.uniform(-3, -1)]), np.diag(10.0 ** rng.uniform(0, 3, 2))
    D = material[0] * M + material[1] * K
    D[0, 0] += 10.0 ** rng.uniform(-3, 0.5) * (b < 0.5)
    foot = fs.Substructure(M, K, D, interface={"top": [0, 1]}, ports={"foot": [1.0, 0.0]}, name="foot")
    return beams, foot, "tip" if rng.random() < 0.7 else "foot"


# -- meetings


class Problem(NamedTuple):
    """K(p) = A + pB + p²C of ω²; the values of its coalescences and of its splittings in closed form, None for by a grid."""

    terms: tuple[Array, Array, Array]
    between: tuple[float, float]
    told: tuple[list[float], list[float]] | None


@attack("meetings", MEETINGS, seed_first=True, silent=False)
def meetings(kind: str, rng: Random) -> str:
    """One random case: 'certified' if what is named is what there is, or a text that begins with 'wrong'."""
    task = problem(kind, rng)
    n, (lo, hi) = len(task.terms[0]), task.between
    D = 10.0 ** rng.uniform(-4, -1) * np.eye(n) if kind == "damped alike" else np.zeros((n, n))
    if kind == "damped":
        R = rng.standard_normal((n, n))
        D = 10.0 ** rng.uniform(-4, -1) * R @ R.T / n
    family = fs.Affine(np.eye(n), D, [(1.0, task.terms[0]), ("p", task.terms[1]), (lambda p: p**2, task.terms[2])])
    found = fs.track(family, None, "p", np.linspace(lo, hi, int(rng.integers(2, 15))))
    named = [[one for one in found.meetings if one.kind == word] for word in ("coalescence", "splitting")]
    if kind == "damped":
        told = [f"{one.kind} at {one.value:.6g} is none" for group in named for one in group if not exchanged(task, D, one)]
        return f"wrong: {'; '.join(told)}" if told else "confirmed"
    there = task.told or by_grid(task)
    told = [f"{one.kind} at {one.value:.9g} has a gap of {one.gap:.1e}" for group in named for one in group
            if one.gap > GAP]
    for word, group, places in zip(("coalescence", "splitting"), named, there, strict=True):
        at = np.array([one.value for one in group if not D.any() or abs(one.eigenvalue) > 0.2])  # critical damping is another
        near = APART * (hi - lo)
        told += [f"{word} at {value:.9g} is missing" for value in places
                 if np.abs(at - value).min(initial=np.inf) > near and min(value - lo, hi - value) > near]
        told += [f"{word} at {value:.9g} is invented" for value in at
                 if np.abs(np.array(places) - value).min(initial=np.inf) > near and not changes(task, value, near)]
    if kind == "veering" and not any(one.kind == "veering" for one in found.meetings):
        told.append("the veering is not named")
    return f"wrong: {'; '.join(told)}" if told else "certified"


def problem(kind: str, rng: Random) -> Problem:
    """A random K(p)."""
    n = int(rng.integers(2, 7))

    def any_symmetric(scale: float) -> Array:
        A = rng.standard_normal((n, n))
        return scale * (A + A.T) / 2

    none = np.zeros((n, n))
    C = rng.standard_normal((n, n))
    if kind in ("circulatory", "damped"):
        K = np.diag(rng.uniform(2, 5, n)) + any_symmetric(0.3) + 1.5 * np.eye(n)
        return Problem((K, C - C.T, none), (0.0, 1.0), None)
    if kind == "symmetric":
        return Problem((np.diag(rng.uniform(2, 9, n)) + 3 * np.eye(n), any_symmetric(2.0), none), (-1.0, 1.0), None)
    if kind == "veering":
        c = 10.0 ** rng.uniform(-4, -1)
        K, B = 4.0 * np.eye(2), np.diag([1.0, -1.0])
        K[0, 1] = K[1, 0] = c
        Q = np.linalg.qr(rng.standard_normal((2, 2)))[0]
        return Problem((Q @ K @ Q.T, Q @ B @ Q.T, np.zeros((2, 2))), (-float(rng.uniform(0.5, 1)), float(rng.uniform(0.5, 1))),
                       ([], []))
    return blocks(rng, through=kind == "through a pair")


def blocks(rng: Random, through: bool) -> Problem:
    """Blocks [[a + sp, bp], [-bp, c + tp]] and single modes, mixed by a similarity: (a - c + (s - t)p)² = 4b²p² at a meeting."""
    pairs, single = int(rng.integers(1, 3)), int(rng.integers(1 if through else 0, 3))
    n = 2 * pairs + single
    A, B = np.zeros((n, n)), np.zeros((n, n))
    places: tuple[list[float], list[float]] = ([], [])
    middle = 0.0
    for j in range(pairs):
        base, apart, b = 5 + 8 * j + rng.uniform(0, 2), rng.uniform(0.1, 0.8), rng.uniform(0.5, 2.0)
        s, t = rng.uniform(-0.3, 0.3, 2)
        A[2 * j, 2 * j], A[2 * j + 1, 2 * j + 1] = base, base + apart
        B[2 * j:2 * j + 2, 2 * j:2 * j + 2] = [[s, b], [-b, t]]
        middle = base + apart / 2
        for root in (apart / (s - t - 2 * b), apart / (s - t + 2 * b)):
            if 0 < root < 1:
                kappa = -2 * (apart - (s - t) * root) * (s - t) - 8 * b**2 * root  # d/dp of (a - c + (s - t)p)² - 4b²p²
                where = places[0 if kappa < 0 else 1]
                if not any(abs(root - other) < 1e-9 for other in where):
                    where.append(float(root))
    for j in range(2 * pairs, n):
        if through:  # in the middle of the last pair at a value after its coalescence
            slope = rng.choice([-1, 1]) * rng.uniform(0.5, 6)
            A[j, j], B[j, j] = middle - slope * rng.uniform(0.1, 0.95), slope
        else:
            A[j, j], B[j, j] = rng.uniform(4, 14), rng.uniform(-3, 3)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] if rng.random() < 0.5 else rng.standard_normal((n, n)) + 2 * np.eye(n)
    if through and rng.random() < 0.7:  # the single modes act on the others a little
        B += 10.0 ** rng.uniform(-6, -1) * rng.standard_normal((n, n))
        return Problem((T @ A @ np.linalg.inv(T), T @ B @ np.linalg.inv(T), np.zeros((n, n))), (0.0, 1.0), None)
    return Problem((T @ A @ np.linalg.inv(T), T @ B @ np.linalg.inv(T), np.zeros((n, n))), (0.0, 1.0), places)


def counted(task: Problem, p: Array) -> Array:
    """The numbers of complex and of negative ω² at each value, (k, 2)."""
    A, B, C = task.terms
    z = np.linalg.eigvals(A + p[:, None, None] * B + p[:, None, None]**2 * C)
    real = z.imag == 0.0
    return np.stack([(~real).sum(axis=1), (real & (z.real < 0)).sum(axis=1)], axis=1)


def changes(task: Problem, value: float, near: float) -> bool:
    """Whether the numbers differ on both sides of a value; a grid may step over a narrow range of flutter."""
    return bool(np.ptp(counted(task, np.array([value - near, value + near])), axis=0).any())


def by_grid(task: Problem) -> tuple[list[float], list[float]]:
    """Where the number of pairs of complex ω² grows, or of negative ones, and where it falls: a grid with bisection."""
    lo, hi = task.between
    grid = np.linspace(lo, hi, FINE)
    counts = counted(task, grid)
    up: list[float] = []
    down: list[float] = []
    for i in np.flatnonzero((np.diff(counts, axis=0) != 0).any(axis=1)):
        a, b, before, after = float(grid[i]), float(grid[i + 1]), counts[i], counts[i + 1]
        while b - a > 1e-10 * (hi - lo):
            points = np.linspace(a, b, 9)
            inner = counted(task, points)
            first = int(np.flatnonzero((np.diff(inner, axis=0) != 0).any(axis=1))[0])
            a, b = float(points[first]), float(points[first + 1])
        (up if (after - before).sum() > 0 else down).append(b)
    return up, down


def exchanged(task: Problem, D: Array, one: Meeting) -> bool:
    """Whether two λ change places on a circle in the complex plane of p around the place named, small against the range."""
    A, B, C = task.terms
    n = len(A)
    for radius in np.geomspace(1e-4, 0.1, 12) * (task.between[1] - task.between[0]):
        circle = one.value + radius * np.exp(2j * np.pi * np.arange(401) / 400)
        state = np.zeros((len(circle), 2 * n, 2 * n), dtype=complex)
        state[:, :n, n:] = np.eye(n)
        state[:, n:, :n], state[:, n:, n:] = -(A + circle[:, None, None] * B + circle[:, None, None]**2 * C), -D
        z = np.linalg.eigvals(state)
        start = np.argsort(np.abs(z[0] - one.eigenvalue))[:2]
        here = z[0][start]
        for row in z[1:]:
            cost = np.abs(here[:, None] - row)
            here = row[np.argmin(cost, axis=1)]
        if abs(here[0] - z[0][start[1]]) + abs(here[1] - z[0][start[0]]) < 1e-3 * abs(z[0][start[0]] - z[0][start[1]]):
            return True
    return False
