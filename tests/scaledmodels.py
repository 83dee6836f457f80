"""Random models and the same ones with each DOF in another unit, a power of two: not one eigenvalue may depend on that.

`python tests/scaledmodels.py 200` tries seeds 0 to 199 and counts the outcomes;
`tests/test_badly_scaled_models.py` takes a few of them.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks.lattices import lattice
from femsub.checks import EPS

REACH = 17  # units from 2⁻¹⁷ to 2¹⁷
MOTIONS = ("lattice held", "lattice floating", "chain", "uneven chain", "plate", "beam")
DAMPINGS = ("belt", "dashpots", "proportional", "proportional and belt", "unsymmetric", "everywhere", "none")
PATTERNS = ("each", "halves", "by turns", "rising", "few")


@dataclass(frozen=True)
class Problem:
    """A pencil or a substructure, what is asked of it, and the units (n,) of its DOF."""

    name: str
    M: Any
    D: Any
    K: Any
    ask: dict[str, Any]
    units: np.ndarray
    pencil: bool  # K is not symmetric, or given as a pencil

    def model(self, scaled: bool, dense: bool = False) -> fs.Substructure | fs.Pencil:
        S = sp.diags_array(self.units if scaled else np.ones(len(self.units)), format="csr")
        M, D, K = (sp.csr_array(S @ part @ S) for part in (self.M, self.D, self.K))
        if dense:
            M, D, K = (part.toarray() for part in (M, D, K))
        return fs.Pencil(M, D, K) if self.pencil else fs.Substructure(M, K, D)


def component(kind: str, size: int, rng: np.random.Generator) -> fs.Substructure:
    if kind.startswith("lattice"):
        return lattice(max(2, size // 20), 10 if size >= 40 else 2, held="held" in kind, seed=int(rng.integers(99)))
    if kind == "chain":
        return fs.chain(size, belt=2, fixed=bool(rng.random() < 0.7))
    if kind == "uneven chain":
        masses, springs = np.exp(rng.uniform(-3, 3, (2, size)))
        return fs.chain(size, belt=2, masses=masses, springs=springs)
    steel = {"E": 2.1e11, "rho": 7850.0}
    if kind == "beam":
        return fs.beam(1.0, max(2, min(size, 300) // 2), **steel, I=1e-8, A=1e-4,
                       supports={"left": "clamped"}, interface=["right"])
    cells = max(2, round((size / 3) ** 0.5))
    mesh = fs.rectangle((0.5, 0.4), (cells, cells), "quad")
    return fs.plate(mesh, **steel, nu=0.3, thickness=2e-3, supports={"edge": "simply supported"})


def damping(kind: str, sub: fs.Substructure, rng: np.random.Generator) -> sp.csr_array:
    """A damping in the units of the model: of the size of some hundredths of the critical one."""
    n, M, K = sub.size, sp.csr_array(sub.M), sp.csr_array(sub.K)
    unit = sp.diags_array((K.diagonal() * M.diagonal()) ** 0.25)
    omega = float(np.sqrt(np.median(K.diagonal() / M.diagonal())))
    D = sp.csr_array((n, n))
    if "proportional" in kind:
        D = D + 1e-3 * omega * M + 1e-2 / omega * K
    if "belt" in kind:
        w = np.zeros(n)
        w[rng.choice(n, 2, replace=False)] = 1.0, -0.5
        w = unit @ w
        D = D + rng.uniform(-0.05, 0.05) * sp.csr_array(np.outer(w, w))
    if kind == "dashpots":
        some = np.where(np.arange(n) < 5, 0.3 * rng.random(n), 0.0)
        D = D + unit @ sp.diags_array(rng.permutation(some)) @ unit
    if kind == "unsymmetric":
        rows = rng.choice(n, (2, 6))
        D = D + unit @ sp.csr_array((rng.uniform(-0.1, 0.1, 6), tuple(rows)), shape=(n, n)) @ unit + 1e-3 / omega * K
    if kind == "everywhere":
        D = D + unit @ sp.diags_array(0.1 * rng.random(n)) @ unit
    return sp.csr_array(D)


def units(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    powers = {"each": rng.integers(-REACH, REACH + 1, n), "halves": np.where(np.arange(n) < n // 2, -REACH, REACH),
              "by turns": np.where(np.arange(n) % 2, -REACH, REACH), "rising": np.round(np.linspace(-REACH, REACH, n)),
              "few": np.where(np.arange(n) % 17 == 3, rng.integers(-REACH, REACH + 1, n), 0)}[kind]
    return 2.0 ** rng.permutation(powers) if kind == "few" else 2.0 ** powers


def problem(seed: int) -> tuple[Problem, bool]:
    """A random problem, and whether it is asked as a dense one."""
    rng = np.random.default_rng([seed, 11])
    dense = bool(rng.random() < 0.25)
    low, high = (8, 120) if dense else [(12, 100), (101, 500), (500, 1100), (2001, 2300)][seed % 4]
    kind, form, pattern = (str(rng.choice(names)) for names in (MOTIONS, DAMPINGS, PATTERNS))
    sub = component(kind, int(rng.integers(low, high)), rng)
    D, K, n = damping(form, sub, rng), sp.csr_array(sub.K), sub.size
    unlike = bool(rng.random() < 0.25)
    if unlike:
        rows, stiff = rng.choice(n, (2, 5)), np.sqrt(K.diagonal())
        K = K + sp.csr_array((0.1 * stiff[rows[0]] * stiff[rows[1]] * rng.uniform(-1, 1, 5), tuple(rows)), shape=(n, n))
    modes = fs.normal_modes(sub, count=min(14, n - 3)).frequencies
    hi = float(np.sqrt(modes[-1] * modes[-2]))
    asks: list[dict[str, Any]] = [{"count": int(rng.integers(4, 30))}, {"band": (0.0, hi)}, {"band": (0.3 * hi, hi)}]
    if n <= 120:
        asks.append({})
    ask = asks[int(rng.integers(len(asks)))]
    if "count" in ask:
        ask["count"] = min(ask["count"], n)
    name = (f"{seed}: {kind}, {n} DOF, {form}{', K unsymmetric' if unlike else ''}, {'dense' if dense else 'sparse'}, {pattern}, "
            f"{ask}")
    return Problem(name, sp.csr_array(sub.M), D, K, ask, units(pattern, n, rng), unlike), dense


def told(call: Callable[[], Any]) -> tuple[Any, list[str]]:
    """What a call returns, or its refusal, and the warnings of femsub."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = call()
        except fs.FemsubError as error:
            found = error
    return found, [str(one.message) for one in caught if issubclass(one.category, fs.FemsubWarning)]


def same(first: Any, second: Any, one_to_one: bool = True) -> float:
    """The largest distance of paired eigenvalues over the sum of their error bars; inf where the numbers differ."""
    if one_to_one and len(first.eigenvalues) != len(second.eigenvalues):
        return np.inf
    a, b = first.eigenvalues, second.eigenvalues
    distance = np.abs(a[:, None] - b[None, :])
    allowed = first.error_bar[:, None] + second.error_bar[None, :] + 4 * EPS * np.abs(a)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(distance == 0, 0.0, distance / allowed)
    ratio = np.where(np.isfinite(ratio), ratio, 1e300)
    rows, columns = linear_sum_assignment(np.minimum(ratio, 1e6))
    return float(ratio[rows, columns].max(initial=0.0))


def complex_outcome(seed: int) -> tuple[str, str]:
    """'same', 'told', 'refused both' or a fault; and what there is to say of it."""
    case, dense = problem(seed)
    clean, before = told(lambda: fs.complex_modes(case.model(False, dense), **case.ask))
    found, warned = told(lambda: fs.complex_modes(case.model(True, dense), **case.ask))
    if isinstance(clean, Exception):
        return ("refused both" if isinstance(found, Exception) else "refused clean only"), f"{case.name}: {clean}"
    if isinstance(found, Exception):
        return "refused", f"{case.name}: {type(found).__name__}: {found}"
    ratio = same(clean, found)
    figures = f"{case.name}: {len(found)} of {len(clean)}, {ratio:.2g} of the bars; bars {bars(clean):.1e} -> {bars(found):.1e}"
    if warned and not before:
        return "told", f"{figures}; {warned[0]}"
    if ratio > 1:
        return "wrong", figures
    if clean.is_stable != found.is_stable:
        return "verdict", f"{figures}; {clean.is_stable} -> {found.is_stable}"
    if clean.evidence != "not checked" and found.evidence == "not checked":
        return "no proof", figures
    if bars(found) > 100 * bars(clean) + 1e-12:
        return "wide bars", figures
    return "same", figures


def bars(modes: Any) -> float:
    """The largest error bar, relative to |λ|."""
    size = np.abs(modes.eigenvalues)
    return float(np.divide(modes.error_bar, size, out=np.zeros(len(size)), where=size > 0).max(initial=0.0))


def normal_outcome(seed: int) -> tuple[str, str]:
    """The same of `normal_modes`, within what rounding moves and the residuals that are accepted."""
    case, dense = problem(seed)
    if case.pencil:
        return "no modes", case.name
    ask = {"count": min(8, len(case.units) - 3)} if "band" not in case.ask else {"band": (0.0, case.ask["band"][1])}
    clean, before = told(lambda: fs.normal_modes(case.model(False, dense), **ask))
    found, warned = told(lambda: fs.normal_modes(case.model(True, dense), **ask))
    if isinstance(clean, Exception):
        return ("refused both" if isinstance(found, Exception) else "refused clean only"), f"{case.name}: {clean}"
    if isinstance(found, Exception):
        return "refused", f"{case.name}: {type(found).__name__}: {found}"
    if warned and not before:
        return "told", f"{case.name}: {warned[0]}"
    if len(clean.eigenvalues) != len(found.eigenvalues) or clean.rigid != found.rigid:
        return "wrong", f"{case.name}: {clean} -> {found}"
    moved = np.abs(found.eigenvalues - clean.eigenvalues) / np.maximum(clean.eigenvalues, 1e-300)
    share = float((moved / (100 * clean.rounding + 1e-11)).max(initial=0.0))
    return ("wrong" if share > 1 else "same"), f"{case.name}: moved by {moved.max(initial=0.0):.1e}"


def main() -> None:
    first, last = (0, int(sys.argv[1])) if len(sys.argv) == 2 else (int(sys.argv[1]), int(sys.argv[2]))
    for label, outcome in (("complex", complex_outcome), ("normal", normal_outcome)):
        counts: Counter[str] = Counter()
        for seed in range(first, last):
            kind, text = outcome(seed)
            counts[kind] += 1
            if kind not in ("same", "no modes"):
                print(f"{label} {kind}: {text}", flush=True)
        print(label, dict(counts), flush=True)


if __name__ == "__main__":
    main()
