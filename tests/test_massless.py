"""Reductions of components with massless DOF, with all and nearly all modes kept, against references of their own."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs

CLOSE = 1e-7  # of ω², relatively
MODELS = 30  # that `test_random_massless_models` takes, with every third reduction; `sweep(range(500))` is the long run
LARGEST = 1e6  # a column of V, in units of the largest motion that the full model's modes and static shapes have


@dataclass(frozen=True)
class Massless:
    """M = LLᵀ (n, n) of known rank k, L (n, k); K regular on the null space of M."""

    seed: int
    kind: str
    L: np.ndarray
    K: np.ndarray
    D: np.ndarray
    floating: bool
    interface: list[int]
    ports: dict[str, np.ndarray]
    sparse: bool

    @property
    def M(self) -> np.ndarray:
        return self.L @ self.L.T

    @property
    def sub(self) -> fs.Substructure:
        M, K, D = (sp.csr_array(part) if self.sparse else part for part in (self.M, self.K, self.D))
        return fs.Substructure(M, K, D, self.interface, self.ports)


def solved(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A⁻¹B for a symmetric A whose DOF may have any units."""
    unit = np.where(A.diagonal() != 0, np.abs(A.diagonal()), 1.0) ** -0.5
    return unit[:, None] * np.linalg.solve(unit[:, None] * A * unit, unit[:, None] * B)


def finite(K: np.ndarray, L: np.ndarray, s: float | None = None) -> np.ndarray:
    """All finite ω², ascending: those of the k x k matrix Lᵀ(K + sM)⁻¹L, k the rank of M = LLᵀ, are 1/(ω² + s).

    Without s, between the lowest elastic and the highest, where neither end loses many digits.
    """
    if s is None:
        middle = 1e-3 * np.trace(K) / np.trace(L @ L.T)
        first = finite(K, L, middle)
        if first[-1] < 1e-9 * middle:  # rigid motion is all there is
            return np.zeros_like(first)
        s = float(np.sqrt(first[-1] * first[first > 1e-10 * first[-1]][0]))
    flexible = L.T @ solved(K + s * (L @ L.T), L)
    return np.sort(1 / la.eigvalsh((flexible + flexible.T) / 2) - s)


def root(M: np.ndarray) -> np.ndarray:
    """L (r, k) with LLᵀ = M, of which eigenvalues that are rounding beside the entries have been left out."""
    unit = np.where(M.diagonal() > 0, M.diagonal(), 1.0) ** 0.5
    values, vectors = la.eigh(M / np.outer(unit, unit))
    keep = values > 1e-13 * max(values[-1], 1.0)
    return np.where(M.diagonal()[:, None] > 0, unit[:, None] * vectors[:, keep] * np.sqrt(values[keep]), 0.0)


def model(seed: int) -> Massless:
    """A chain with side springs, held or floating; M diagonal with zeros, rank-deficient, or consistent with zeros."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 15)) if rng.random() < 0.96 else int(rng.integers(101, 110))
    spread = rng.choice([0.0, 0.7, 3.0])
    K = np.zeros((n, n))
    bars = [(j, j + 1) for j in range(n - 1)]
    bars += [tuple(rng.choice(n, 2, replace=False)) for _ in range(int(rng.integers(0, 3)))]
    for i, j in bars:
        k = float(np.exp(spread * rng.uniform(-1, 1)))
        K[[i, j], [i, j]] += k
        K[[i, j], [j, i]] -= k
    floating = bool(rng.random() < 0.35)
    if not floating:
        for j in {0, *rng.choice(n, int(rng.integers(0, 2)), replace=False)}:
            K[j, j] += float(np.exp(spread * rng.uniform(-1, 1)))
    kind = str(rng.choice(["diagonal", "shared", "consistent"], p=[0.6, 0.2, 0.2]))
    masses = np.exp(rng.choice([0.0, 1.0]) * rng.uniform(-1, 1, n)) * rng.choice([1.0, 1.0, 2.0], n)
    bare = rng.choice(n, int(rng.integers(1, max(2, (2 * n) // 3))), replace=False)
    if kind == "diagonal":
        L = np.delete(np.diag(np.sqrt(masses)), bare, axis=1)
    elif kind == "shared":  # fewer masses than DOF, each moved by several
        L = np.zeros((n, n - len(bare)))
        for column in L.T:
            rows = rng.choice(n, min(n, int(rng.integers(1, 4))), replace=False)
            column[rows] = rng.choice([1.0, 0.5, 2.0], len(rows))
    else:  # linear elements of mass, some of them without
        elements = rng.choice(n - 1, max(1, (n - 1) - len(bare)), replace=False)
        L = np.zeros((n, 2 * len(elements)))
        for at, j in enumerate(elements):
            L[j:j + 2, 2 * at:2 * at + 2] = np.sqrt(masses[j]) * la.cholesky(np.array([[2.0, 1.0], [1.0, 2.0]]) / 6, lower=True)
    units = float(rng.choice([1.0, 1.0, 1e8])), float(rng.choice([1.0, 1.0, 1e-3]))
    K *= units[0]
    L = root(L @ L.T) * np.sqrt(units[1])
    interface = sorted(int(j) for j in rng.choice(n, int(rng.integers(1, 3)), replace=False))
    ports = {"unit": np.eye(n)[int(rng.integers(n))]}
    if rng.random() < 0.5:
        ports["several"] = np.where(rng.random((n, 2)) < 3 / n, rng.choice([1.0, 0.5, -1.0], (n, 2)), 0.0)
        ports["several"][int(rng.integers(n)), :] = 1.0
    damping = rng.choice(["none", "stiffness", "dashpots"])
    size = float(rng.choice([1.0, 40.0])) * np.sqrt(units[0] * units[1])
    D = {"none": 0.0 * K, "stiffness": 0.02 * K * size / units[0],
         "dashpots": np.diag(np.where(rng.random(n) < 0.4, 0.1 * size, 0.0))}[str(damping)]
    return Massless(seed, kind, L, K, D, floating, interface, ports, bool(n > 60 or rng.random() < 0.3))


def regular(given: Massless) -> bool:
    """Whether no motion is free of both mass and stiffness, none of the mass is without a share of its own, and some motion is
    elastic.
    """
    pencil = given.K / np.trace(given.K) + given.M / np.trace(given.M)
    moving = given.L.shape[1] > int(given.floating)  # besides rigid motion, for which the references here have no scale
    return moving and bool(la.eigvalsh(pencil)[0] > 1e-9 / len(pencil)) and np.linalg.matrix_rank(given.L) == given.L.shape[1]


def most(given: Massless, kind: type) -> int:
    """How many elastic modes there are: the rank of the mass that moves."""
    if kind is fs.CraigBampton:
        return int(np.linalg.matrix_rank(np.delete(given.L, given.interface, axis=0)))
    return given.L.shape[1] - int(given.floating)


def tasks(given: Massless) -> Iterator[tuple[str, object, bool, int]]:
    """Name, method, ports and how many modes are left out (-1: a tolerance)."""
    omega = np.sqrt(finite(given.K, given.L)[int(given.floating):])
    for kind in (fs.CraigBampton, fs.CraigChang):
        there = most(given, kind)
        for left in range(min(3, there + 1)):
            for ports in (False, True):
                yield f"{kind.__name__}({there - left} of {there}), ports={ports}", kind(there - left), ports, left
        if len(omega):
            for share, tol in ((0.45, 1e-3), (1.2, 1e-6)):
                hi = float(omega[0] + share * (omega[-1] - omega[0]))
                yield f"{kind.__name__}({share}, {tol})", kind(band=(0.0, hi), tol=tol), True, -1


def faults(given: Massless, method: object, ports: bool, left: int) -> str:
    """What is wrong with the reduced model, or nothing."""
    sub, full, rigid = given.sub, finite(given.K, given.L), int(given.floating)
    rom = fs.reduce(sub, method, ports=ports)
    V, massless = rom.V, rom.M.diagonal() == 0
    if not all(np.isfinite(part).all() for part in (V, rom.M, rom.K, rom.D)):
        return "not finite"
    for name, part, whole in (("M", rom.M, given.M), ("K", rom.K, given.K), ("D", rom.D, given.D)):
        scale = np.sqrt(np.einsum("ij,ij->j", abs(V), abs(whole) @ abs(V)) + np.abs(whole).max() * (V**2).sum(axis=0))
        wrong = np.abs(V.T @ whole @ V - part) > 1e-9 * np.outer(scale, scale)
        if name == "K":  # what couples a motion without mass to others moves their ω² by its square
            slack = np.abs(V.T @ whole @ V - part) > 1e-6 * np.outer(scale, scale)
            wrong[massless], wrong[:, massless] = slack[massless], slack[:, massless]
        if name == "M":  # what is taken for massless has at most 1e-8 of the mass that a mode has for its stiffness
            traces = np.einsum("ij,ij->j", V, whole @ V)[massless] * full[rigid:][:1]
            wrong[massless] = wrong[:, massless] = False
            if (traces > 1e-8 * rom.K.diagonal()[massless]).any():
                return f"mass of {traces.max():.1e} is left out"
        if wrong.any():
            return f"{name} is not its projection"
    # in units of the full model's own modes and static shapes
    inverse = la.pinvh(given.K)
    largest = max(np.abs(inverse).max() ** 0.5 * full[-1] ** 0.5, 1.0) * max(1.0, np.linalg.norm(given.L, axis=0).min() ** -1)
    if np.abs(V).max() > LARGEST * largest:
        return f"a column of V of {np.abs(V).max():.1e}, {largest:.1e} is usual"
    # K is regular on what has no mass
    if la.eigvalsh(rom.M / max(rom.M.max(), 1e-300))[0] < -1e-12:
        return "M is indefinite"
    found = finite(rom.K, root(rom.M), float(np.sqrt(full[rigid] * full[-1])) if len(full) > rigid else None)
    tiny = 1e-9 * full[-1]
    listed = fs.normal_modes(rom, count=len(found) - rigid) if len(found) > rigid else None
    known = np.count_nonzero(found < 10 * full[-1])
    if listed is not None and (listed.rigid != rigid or off(listed.eigenvalues[rigid:known], found[rigid:known], tiny) > CLOSE):
        return "normal_modes finds others"
    low = min(len(found), len(full))
    if left >= 0 and (found[:low] < full[:low] * (1 - CLOSE) - tiny * CLOSE * 10).any():
        return "a mode below the full model's"
    if left == 0:
        if len(found) < len(full):
            return f"{len(found)} of {len(full)} finite modes"
        if off(found[rigid:len(full)], full[rigid:], tiny) > CLOSE:
            return f"the spectrum is off by {off(found[rigid:len(full)], full[rigid:], tiny):.1e}"
        if len(found) > len(full):
            return f"{len(found)} finite modes, the full model has {len(full)}"
    if ports:
        loads = np.hstack([w.reshape(len(V), -1) for w in given.ports.values()] + [np.eye(len(V))[:, given.interface]])
        s = float(full[rigid:].min(initial=full[-1]))
        for value, close in ((0.0, 1e-8), (-s, np.inf if left > 0 else 1e-8)):
            if (given.floating and value == 0.0) or left < 0:
                continue
            exact = loads.T @ solved(given.K - value * given.M, loads)
            near = (V.T @ loads).T @ solved(rom.K - value * rom.M, V.T @ loads)
            if np.abs(near - exact).max() > close * np.abs(exact).max():
                return f"the response at {value:.2g} is off by {np.abs(near - exact).max() / np.abs(exact).max():.1e}"
    if left < 0:
        hi = method.band[1]  # type: ignore[attr-defined]
        if not rom.estimate.met:
            return "the estimate is not met"
        inside = np.sqrt(full[rigid:])
        inside = inside[inside <= hi]
        got = np.sqrt(np.maximum(found[rigid:], 0.0))[:len(inside)]
        if len(got) < len(inside) or (np.abs(got / inside - 1) > rom.estimate.tol).any():
            return f"an ω off by {np.abs(got / inside[:len(got)] - 1).max():.1e} for {rom.estimate.tol:g}"
        missed = damped_error(given, rom, hi)
        if not missed <= rom.estimate.tol:
            return f"a λ off by {missed:.1e} for {rom.estimate.tol:g}"
    return ""


def off(found: np.ndarray, exact: np.ndarray, tiny: float) -> float:
    """The largest relative difference."""
    return float(np.abs(found / np.maximum(exact, tiny) - 1).max(initial=0.0))


def complex_spectrum(M: np.ndarray, D: np.ndarray, K: np.ndarray, s: float) -> np.ndarray:
    """λ of λ²M + λD + K, from the eigenvalues 1/(λ - s) of (A - sB)⁻¹B, of which those at infinity are 0."""
    n = len(M)
    eye, zero = np.eye(n), np.zeros((n, n))
    A, B = np.block([[zero, eye], [-K / s**2, -D / s]]), np.block([[eye, zero], [zero, M]])
    z = la.eigvals(la.solve(A - B, B))
    z = z[np.abs(z) > 1e-7 * np.abs(z).max()]
    return s * (1 + 1 / z)


def damped_error(given: Massless, rom: fs.ReducedSubstructure, hi: float, real: bool = False) -> float:
    """The largest relative error of a λ of the full model with 0 < Im λ ≤ hi and |Re λ| ≤ hi, those next to 0 left out.

    So are real ones, unless asked for: a DOF with damping but no mass relaxes by itself, which neither modes nor static
    shapes need hold.
    """
    if not given.D.any():
        return 0.0
    exact, found = complex_spectrum(given.M, given.D, given.K, hi), complex_spectrum(rom.M, rom.D, rom.K, hi)
    wanted = exact[(exact.imag >= (0.0 if real else 1e-3 * np.abs(exact))) & (exact.imag <= hi) & (np.abs(exact.real) <= hi)]
    wanted = wanted[np.abs(wanted) > 1e-3 * hi]
    return float(max((np.abs(found - value).min() / abs(value) for value in wanted), default=0.0))


def needless(given: Massless, method: object) -> bool:
    """Whether a tolerance was refused that the model with all modes and ports meets.

    Massless DOF that are damped move by themselves: of that motion a basis holds what loads at the interface and ports ask for.
    """
    kind, hi = type(method), method.band[1]  # type: ignore[attr-defined]
    try:
        whole = fs.reduce(given.sub, kind(most(given, kind)), ports=True)
    except fs.FemsubError:
        return True
    if not given.D.any() or damped_error(given, whole, hi, real=True) > 0.9 * method.tol:  # type: ignore[attr-defined]
        return not given.D.any()
    full, own = (complex_spectrum(part.M, part.D, part.K, hi) for part in (given, whole))
    counts = [np.count_nonzero((np.abs(part.imag) <= hi) & (np.abs(part.real) <= hi) & (np.abs(part) > 1e-3 * hi))
              for part in (full, own)]
    return counts[0] == counts[1]


def sweep(seeds: range, every: int = 1) -> tuple[Counter[str], list[str]]:
    """How many models and reductions there were, and what was wrong with which; `every` leaves out some of the reductions."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    seed = seeds.start
    while counts["models"] < len(seeds):
        given, seed = model(seed), seed + 1
        if not regular(given):
            continue
        counts["models"] += 1
        counts[given.kind] += 1
        counts["floating" if given.floating else "held"] += 1
        for name, method, ports, left in list(tasks(given))[given.seed % every::every]:
            counts["reductions"] += 1
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", fs.PortWarning)
                    fault = faults(given, method, ports, left)
            except fs.NotConvergedError as error:
                counts["refused"] += 1
                fault = f"refused: {error}" if left >= 0 or needless(given, method) else ""
            except Exception as error:  # a traceback is what is looked for
                fault = f"{type(error).__name__}: {error}"
            if fault:
                wrong.append(f"{given.seed} ({len(given.K)} DOF, {given.kind}, floating={given.floating}) {name}: {fault}")
    return counts, wrong


@pytest.mark.parametrize("modes", [1, 2])
@pytest.mark.parametrize("ports", [False, True])
def test_a_chain_with_two_massless_dof(modes: int, ports: bool) -> None:
    """All interior modes kept, what the port adds has no mass; two coordinates are constraint and port."""
    K = 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    L = np.diag(np.sqrt([1.0, 0, 1, 0, 2]))[:, [0, 2, 4]]
    sub = fs.Substructure(L @ L.T, K, 0.02 * K, interface=[0], ports={"p": np.array([0.0, 1.0, 0.0, 0.5, 0.0])})
    for method in (fs.CraigBampton(modes), fs.CraigChang(modes + 1)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fs.PortWarning)
            rom = fs.reduce(sub, method, ports=ports)
        assert np.abs(rom.V).max() < 2 and np.linalg.norm(rom.K) < 20
        if modes == 2:
            assert finite(rom.K, root(rom.M)) == pytest.approx(finite(K, L), rel=1e-12)
            assert np.isinf(rom.cutoff)
        if modes == 2 and ports:
            assert rom.M[-1, -1] == 0.0 == np.abs(rom.M[-1]).max()
            belt = fs.Belt(port="p", slope=-0.05)
            full = sub.linearised(belt)
            exact = complex_spectrum(full.M, full.D, full.K, 1.0)
            found = fs.complex_modes(rom, belt).eigenvalues
            assert len(found) >= 6 and np.abs(found).max() < 1e3
            assert max(np.abs(exact - value).min() / abs(value) for value in found) < 1e-9


def saddle(scale: float) -> fs.Pencil:
    """Three masses, the last two held together by a multiplier; one DOF with a dashpot alone, one with neither."""
    M, D, K = (np.zeros((6, 6)) for _ in range(3))
    M[:3, :3], D[3, 3] = np.diag([1.0, 2.0, 3.0]), 0.5
    K[:5, :5] = scale * (3 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
    K[5, 1:3] = K[1:3, 5] = [1.0, -1.0]
    return fs.Pencil(M, D, K)


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
def test_multipliers_need_not_be_single_dof(scale: float) -> None:
    """4 + 1 finite λ in any coordinates: with M, D and K full, the ranks tell it all the same."""
    plain = saddle(scale)
    T = np.tril(np.random.default_rng(3).integers(-1, 2, (6, 6)), -1) + np.eye(6)
    turned = fs.Pencil(*(T.T @ A @ T for A in (plain.M, plain.D, plain.K)))
    clean, found = (fs.complex_modes(pencil) for pencil in (plain, turned))
    assert len(clean) == len(found) == 5 and clean.evidence == found.evidence == "certified"
    distance = np.abs(found.eigenvalues[:, None] - clean.eigenvalues)
    assert (distance.min(axis=0) < 1e-9 * np.abs(clean.eigenvalues)).all()
    assert (found.eigenvalues[found.eigenvalues.imag != 0].reshape(-1, 2).sum(axis=1).imag == 0).all()


def test_a_number_that_depends_on_rounding_is_not_certified() -> None:
    """μ holds a velocity, v = 0; D takes the place of M, det P(λ) = 1; or a mass is 1e-15 of the others in no DOF of its own."""
    velocity = fs.Pencil(np.diag([1.0, 0.0]), [[0.0, 1.0], [1.0, 0.0]], np.diag([1.0, 0.0]))
    none = fs.Pencil(np.diag([1.0, 0.0]), [[0.0, 1.0], [1.0, 0.0]], np.eye(2))
    T = np.array([[0.6, 0.8], [-0.8, 0.6]])
    light = fs.Pencil(T.T @ np.diag([1.0, 4e-15]) @ T, None, T.T @ np.diag([1.0, 2.0]) @ T)
    for pencil in (velocity, none, light):
        with pytest.warns(fs.ConditionWarning, match="the number of finite eigenvalues is not known"):
            assert fs.complex_modes(pencil).evidence == "not checked"


@pytest.mark.parametrize("seed", range(4))
def test_a_constraint_of_velocities_leaves_no_infinite_eigenvalue_in_the_list(seed: int) -> None:
    """λ bᵀq = 0 by a multiplier in D, whose mass is rounding: QZ returns its infinite eigenvalues as numbers of any size."""
    n, rng = 5, np.random.default_rng(seed)
    A, b = rng.standard_normal((n, n)), rng.standard_normal(n)
    M, D, K = np.zeros((3, n + 1, n + 1))
    M[:n, :n], D[:n, :n], K[:n, :n], D[n, :n], D[:n, n], M[n, n] = np.eye(n), 0.01 * np.eye(n), A @ A.T, b, b, 3e-15
    Q = np.linalg.qr(rng.standard_normal((n + 1, n + 1)))[0]
    with pytest.warns(fs.ConditionWarning, match="constraint holds velocities"):
        found = fs.complex_modes(fs.Pencil(*(Q.T @ part @ Q for part in (M, D, K)))).eigenvalues
    Z = la.null_space(b[None])
    exact = fs.complex_modes(fs.Pencil(*(Z.T @ part[:n, :n] @ Z for part in (M, D, K)))).eigenvalues
    moving = found[np.abs(found) > 1e-3]
    assert len(moving) == len(exact) and np.abs(moving[:, None] - exact).min(axis=0).max() < 1e-6


@pytest.mark.slow
def test_a_rounding_of_lapack_alone_leaves_no_number_open() -> None:
    """M = BᵀB of whole numbers is singular. LAPACK's least eigenvalue may be 1e-15: `run chain-parts` warned of it."""
    for seed in range(400):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 13))
        B = rng.integers(-2, 3, (n - int(rng.integers(1, 3)), n)).astype(float)
        if (rank := np.linalg.matrix_rank(B)) == len(B):
            found = fs.complex_modes(fs.Pencil(B.T @ B, 0.1 * np.eye(n), np.diag(np.arange(1.0, n + 1))))
            assert (len(found), found.evidence) == (n + rank, "certified"), seed


def test_a_truncation_splits_no_pair() -> None:
    """λ = -1 ± 2i and 0.1 ± 3i, listed by LAPACK in any order: 3 of them are one pair, and its members are conjugates."""
    from femsub.modes.quadratic.singular_mass import _by_qz

    A = la.block_diag([[0.1, 3.0], [-3.0, 0.1]], [[-1.0, 2.0], [-2.0, -1.0]], [[5.0]])
    Q = np.linalg.qr(np.random.default_rng(1).standard_normal((5, 5)))[0]
    for number, exact in ((1, []), (2, [-1 - 2j, -1 + 2j]), (3, [-1 - 2j, -1 + 2j]), (4, [-1 - 2j, -1 + 2j, 0.1 - 3j, 0.1 + 3j])):
        values, left, right = _by_qz(Q @ A, Q @ np.eye(5), number)
        assert len(values) == left.shape[1] == right.shape[1] == len(exact)
        np.testing.assert_allclose(np.sort_complex(values), exact, atol=1e-12)
        assert sorted(values.tolist(), key=str) == sorted(values.conj().tolist(), key=str)
        assert np.abs(Q @ A @ right - Q @ right * values).max(initial=0.0) < 1e-12


def tree(seed: int) -> tuple[fs.Substructure, np.ndarray]:
    """Free trees of springs and dashpots with massless DOF, some with dashpots to the ground; and these dashpots."""
    rng = np.random.default_rng(seed)
    n, pieces = int(rng.integers(3, 16)), int(rng.integers(1, 3))
    mass = np.where((rng.random(n) < rng.choice([0.2, 0.5, 0.8])) & (np.arange(n) >= 2), 0.0, np.exp(rng.normal(0, 2, n)))
    K, D = np.zeros((2, n, n))
    for i in range(pieces, n):
        stretch = np.eye(n)[i] - np.eye(n)[rng.integers(i)]
        K += np.exp(rng.normal(0, 3)) * np.outer(stretch, stretch)
        D += (rng.random() < 0.4) * np.outer(stretch, stretch)
    floor = np.diag(0.3 * (rng.random(n) < 0.2)) * bool(rng.random() < 0.5)
    interface = rng.choice(n, int(rng.integers(1, max(2, n // 3) + 1)), replace=False)
    return fs.Substructure(*map(sp.csr_array, (np.diag(mass), K, D + floor)), np.sort(interface)), floor


def test_free_damped_models_with_massless_dof_have_exact_zeros() -> None:
    """QZ alone splits a double eigenvalue at 0 into ±1e-8, one of which would grow."""
    for seed in range(60):
        sub, floor = tree(seed)
        modes = fs.complex_modes(sub)
        Z = la.null_space(sub.K.toarray())
        assert np.count_nonzero(modes.eigenvalues == 0) == 2 * Z.shape[1] - np.linalg.matrix_rank(Z.T @ floor @ Z), seed
        assert modes.is_stable is not False, seed
        assert modes.evidence == "certified", seed


@pytest.mark.filterwarnings("ignore:the number of finite eigenvalues is not known")
@pytest.mark.parametrize("method", [fs.CraigBampton, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.DualCraigBampton])
def test_no_reduction_of_a_passive_model_grows(method: Callable[[int], fs.Method]) -> None:
    """With all modes kept, what is left of the static shapes has no mass. Rounding in its damping gave λ = 7e18."""
    solved = certified = 0
    for seed in range(60):
        sub, _ = tree(seed)
        for kept in range(sub.size, -1, -1):  # as many modes as there are
            with suppress(fs.InputError):  # also where no mass vibrates, or the interface does not hold the rest
                modes = fs.complex_modes(fs.reduce(sub, method(kept)))
                assert modes.is_stable is not False, seed
                solved, certified = solved + 1, certified + (modes.evidence == "certified")
                break
    assert solved > 20 and certified > 0.8 * solved  # the others are warned of: a rank depends on rounding


@pytest.mark.slow
def test_random_massless_models() -> None:
    counts, wrong = sweep(range(MODELS), every=3)
    assert not wrong, "\n".join(wrong)
    assert counts["models"] == MODELS and counts["reductions"] > 5 * MODELS
