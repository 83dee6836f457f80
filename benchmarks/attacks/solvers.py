"""One question, several solvers: losses by discs, followed, by the port's root, `critical_slope`, and the Hopf start of a branch.

Random models of 4 to 12 DOF. 'flutter': a circulatory K grows with the parameter. 'hopf': the slope of a belt. 'divergence': a
load takes stiffness away. 'undamped': flutter without damping, where two modes coalesce. Values, frequencies and kinds must
agree.
"""

from __future__ import annotations

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, positive

KINDS = ("flutter", "hopf", "divergence", "undamped")
SAME = 1e-7  # of the range, beside the widths: two values of one loss
LIKE = 1e-5  # relative difference of two frequencies; near a coalescence the square root of SAME


@attack(KINDS, seed_first=True)
def attacked(kind: str, rng: Random) -> str:
    """One random case: 'agree', 'none' if nothing is lost, 'open' if a solver says that it does not know."""
    model, contacts, name, between, top = _model(kind, rng)
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


def _model(kind: str, rng: Random
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
