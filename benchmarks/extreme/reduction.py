"""Extreme cases of reduced models: DOF without mass, tolerances, cut-off, and what a study says of its errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import dense
from benchmarks.extreme.cases import basis, case, judge, lattice
from benchmarks.extreme.complex import cea, roots, slope
from benchmarks.extreme.reference import EPS, Array, Found, answered, border, claim, matched, mp, quadratic, worst

CORRECTED = 1e-10  # what is left of inertia relief after its last correction, relatively
TALLEST = 1e6  # entry of V of a model of unit masses and springs; it was 1e42


def issue() -> fs.Substructure:
    """Five DOF, two of them without mass, and D = 0.02 K."""
    K = 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    return fs.Substructure(np.diag([1.0, 0, 1, 0, 2]), K, 0.02 * K, interface=[0], ports={"p": np.array([0, 1.0, 0, 0.5, 0])})


def bare(n: int, every: int, held: bool = True, consistent: bool = False, units: tuple[float, float] = (1.0, 1.0)
         ) -> fs.Substructure:
    """A chain in which every second (third, ...) DOF has no mass, or every second element of a consistent M has none."""
    if consistent:
        elements = np.zeros((n, n))
        for j in range(0, n - 1, every):
            elements[j:j + 2, j:j + 2] += np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        M = elements
    else:
        M = np.diag(np.where(np.arange(n) % every, 1.0, 0.0))
    K = dense(fs.chain(n, fixed=held).K)
    ports = {"unit": np.eye(n)[2], "several": np.eye(n)[:, [0, n // 2]]}
    return fs.Substructure(M * units[0], K * units[1], 0.02 * K * np.sqrt(units[0] * units[1]), interface=[1, n - 1], ports=ports)


def most(sub: fs.Substructure, kind: type) -> int:
    """How many elastic modes there are: the rank of the mass that moves, less rigid motion."""
    if kind is fs.CraigBampton:
        return int(np.linalg.matrix_rank(dense(sub.M)[np.ix_(sub.interior, sub.interior)]))
    return int(np.linalg.matrix_rank(dense(sub.M))) - int(np.linalg.matrix_rank(dense(sub.K)) < sub.size)


def nearly_complete(build: Callable[[], fs.Substructure], kind: type, rigid: int = 0) -> Found:
    """All modes, one and two fewer, with ports and without: kept modes, statics and, with all, the spectrum of the full model."""
    sub, founds = build(), []
    there, floating = most(sub, kind), rigid if kind is fs.CraigChang else 0
    for left in range(min(3, there + 1)):
        for ports in (False, True):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", fs.PortWarning)
                found = basis(lambda: sub, kind(there - left), floating, ports, left == 0, rigid)
                rom = fs.reduce(sub, kind(there - left), ports=ports)
            unit = max(1.0, float(dense(sub.M).max()) ** -0.5, float(np.abs(dense(sub.K)).max()) ** -0.5)
            tall = float(np.abs(rom.V).max())
            founds.append(replace(found, lie=found.lie or f"an entry of V of {tall:.0e}" * (tall > TALLEST * unit)))
    return worst(founds)


def same_poles(build: Callable[[], fs.Substructure], method: Any) -> Found:
    """The pairs of a reduced model with all modes and ports are those of the full model in 60 digits, within ten error bars:
    the entries of VᵀMV, VᵀDV and VᵀKV have their rounding, too.
    """
    sub = build()
    rom = fs.reduce(sub, method, ports=True)
    found = fs.complex_modes(rom)
    pairs = found.eigenvalues.imag > 0
    reference = [value for value in quadratic(sub.M, sub.D, sub.K) if value.imag > mp.mpf(10) ** -20 * abs(value)]
    distance, partner = matched(found.eigenvalues[pairs], reference)
    size = np.abs(found.eigenvalues[pairs])
    lie = "pairs that do not exist" if (partner < 0).any() else "is_stable is not True" if found.is_stable is not True else ""
    kept = partner >= 0
    bounds = (10 * found.error_bar[pairs] + 100 * EPS * size) / size
    return Found(f"{len(size)} pairs of {rom.size} coordinates", *judge((distance / size)[kept], bounds[kept]),
                 "ten error bars of the reduced model", float(found.backward_error.max()),
                 missed=len(reference) - int(kept.sum()), lie=lie)


def tolerance(build: Callable[[], fs.Substructure], method: Any, rigid: int = 0) -> Found:
    """Every ω and every pair of the full model, D = 0.02 K, in the band has its counterpart within the tolerance asked for.

    References by LAPACK: 1/(ω² + s) of (M, K + sM), and λ² + 0.02 ω² λ + ω² = 0.
    """
    sub = build()
    rom = fs.reduce(sub, method, ports=True)
    hi, tol, M, K = method.band[1], method.tol, dense(sub.M), dense(sub.K)
    assert np.array_equal(dense(sub.D), 0.02 * K)
    flexible = la.eigvalsh(M, K + hi**2 * M)
    squares = np.sort(1 / flexible[flexible > 1e-12 * flexible[-1]] - hi**2)[rigid:]
    omega = np.sqrt(squares[squares <= hi**2])
    found = fs.normal_modes(rom, count=len(omega)).frequencies[rigid:]
    damped = roots(0.02 * omega**2, omega**2)
    damped, own = damped[(damped.imag > 0) & (damped.imag <= hi)], _spectrum(rom, hi)
    errors = np.append(np.abs(found / omega - 1), np.abs(damped[:, None] - own).min(axis=1) / np.abs(damped))
    lie = "" if rom.estimate is not None and rom.estimate.met else "the estimate is not met"
    return Found(f"{len(omega)} ω and {len(damped)} λ by {rom.size} of {sub.size} DOF", *judge(errors, np.full(len(errors), tol)),
                 "the tolerance that was asked for", missed=int(np.count_nonzero(errors > 0.5)), lie=lie)


def _spectrum(model: fs.Substructure, s: float) -> Array:
    """λ from the eigenvalues 1/(λ - s) of a companion matrix; those at infinity, where M is singular, are 0."""
    eye, zero = np.eye(model.size), np.zeros((model.size, model.size))
    A, B = np.block([[zero, eye], [-model.K / s**2, -model.D / s]]), np.block([[eye, zero], [zero, model.M]])
    z = la.eigvals(la.solve(A - B, B))
    return np.asarray(s * (1 + 1 / z[np.abs(z) > 1e-7 * np.abs(z).max()]))


def other_damping() -> Found:
    """A tolerance is met for one D: with another one the estimate goes, in a folder it stays."""
    import tempfile

    sub = fs.chain(60, belt=30)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        rom = fs.reduce(sub, fs.CraigChang(band=(0.0, 0.3), tol=1e-3))
    kept = [other for other in (rom.with_damping(0.1 * rom.K), fs.damped(rom, rayleigh=(0.1, 0.0))) if other.estimate is not None]
    with tempfile.TemporaryDirectory() as folder:
        fs.write_matrices(folder, rom)
        back: Any = fs.read_component(folder)
    lost = repr(back.estimate) != repr(rom.estimate)
    lie = "an estimate of another D" if kept else "the estimate got lost in files" if lost else ""
    return claim("an estimate, and none", lie, "an estimate holds for its damping only")


def packed() -> fs.Substructure:
    """A beam on a foundation, which packs its frequencies just above ω = 10,000, much as in the README."""
    n = 60
    near, far = np.full(n - 1, -4.0), np.ones(n - 2)
    K = sp.diags_array([far, near, np.full(n, 6.1), near, far], offsets=[-2, -1, 0, 1, 2]) * 1e6
    return fs.Substructure(1e-3 * sp.eye_array(n), K, 1e-6 * K, interface=[0, n // 3, n - 1], ports={"belt": np.eye(n)[n // 3]})


def above_cutoff(method: Any, ask: str) -> Found:
    """What is asked of a reduced model beyond its cut-off: bands are to be refused, and modes without a band to be marked."""
    rom = fs.reduce(packed(), method)
    band = (0.0, 2.0 * rom.cutoff)
    asks = {"slope": lambda: fs.critical_slope(rom, band=band), "modes": lambda: fs.complex_modes(rom, band=band),
            "sweep": lambda: fs.sweep(rom, fs.Belt(slope=0.0), "slope", [-0.1], band=band)}
    if ask in asks:
        return answered(asks[ask])
    answer = fs.complex_modes(rom)
    beyond = np.abs(answer.eigenvalues.imag) > rom.cutoff * (1 + 1e-9)
    marked = np.array_equal(beyond, answer.above_cutoff) and beyond.any() and "up to the cut-off" in repr(answer)
    below = answer.eigenvalues[~beyond]
    own = quadratic(rom.M, rom.D, rom.K)
    distance, size = matched(below, own)[0], np.abs(below)
    there = sum(abs(value.imag) <= rom.cutoff for value in own)
    bounds = 1.05 * answer.error_bar[~beyond] / size + 4 * EPS
    return Found(f"{len(size)} modes below the cut-off", *judge(distance / size, bounds), "femsub's error bar",
                 float(answer.backward_error.max()), missed=int(there) - len(size),
                 lie="" if marked else "what lies above the cut-off is not marked")


def without_artefact() -> Found:
    """CC with the interface {m1, m3} has a hardly damped shape above its cut-off. By default the border is that of what lies
    below: the full model's, up to (ω/ω_cut)⁴, of which order residual flexibility leaves its error.
    """
    sub = fs.chain(10, belt=3, interface=(1, 3))
    rom = fs.reduce(sub, fs.CraigChang(3))
    found = fs.critical_slope(rom)
    exact, _ = border(sub.M, sub.D, sub.K, sub.port("belt"), fs.critical_slope(sub).omega)
    error, bound = float(abs(exact - mp.mpf(found.value)) / abs(exact)), (found.omega / rom.cutoff) ** 4
    return Found(f"critical slope {found.value:.6g}", error, bound, error / bound, "(ω/ω_cut)⁴ of residual flexibility")


def near_cutoff() -> Found:
    """The border of a reduced model next to its cut-off comes with a warning, and is that of its own matrices."""
    rom = fs.reduce(packed(), fs.CraigChang(3))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = slope(lambda: rom)
    warned = any(issubclass(one.category, fs.CutoffWarning) for one in told)
    return replace(found, lie="" if warned else "no warning next to the cut-off")


def study_at_border(factor: float, hi: float) -> Found:
    """The error of Re λ that a study prints, at or beside the border of stability, against λ in 60 digits: |Δ Re λ| over what
    damping takes and the belt feeds, (|xᴴDx| + |c||wᵀx|²)/2xᴴMx, worked out here from eigenvectors of the companion matrix.
    """
    sub = fs.chain(10, belt=2)
    w = sub.port("belt")
    omega = fs.critical_slope(sub).omega
    c = factor * float(border(sub.M, sub.D, sub.K, w, omega)[0])
    belt, method = fs.Belt(slope=c), fs.CraigChang(4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        row = fs.study(sub, [method], band=(0.0, hi), contacts=belt, repeats=1).rows[0]
        rom = fs.reduce(sub, method)
    v = rom.V.T @ w
    full, own = (np.array([complex(value) for value in quadratic(m.M, dense(m.D) + c * np.outer(load, load), m.K)])
                 for m, load in ((sub, w), (rom, v)))
    M, D, K = dense(sub.M), dense(sub.D), dense(sub.K)
    expected = 0.0
    for value in full[(full.imag > 0) & (full.imag <= hi)]:
        x = np.linalg.svd(value**2 * M + value * (D + c * np.outer(w, w)) + K)[2][-1].conj()
        fed = (abs(x.conj() @ D @ x) + abs(c) * abs(w @ x) ** 2) / (2 * abs(x.conj() @ M @ x))
        near = own[np.argmin(np.abs(own - value))]
        expected = max(expected, abs(near.real - value.real) / fed)
    error, bound = abs(row.error_growth - expected), 0.01 * expected + 1e-9
    return Found(f"error of Re λ {row.error_growth:.1e}, {expected:.1e} in truth", error, bound, error / bound,
                 "1 % of the figure, 1e-9 where λ is rounding", lie="" if row.error_growth < 1 else "it blows up")


def relief(solves: int) -> Found:
    """Craig-Chang of a floating lattice with 40 interface DOF: the statics of inertia relief, against K + sMZZᵀM, which is
    regular, in double precision; and no more solves for each than foretold by the rate |σ|/(λ₁ + |σ|).
    """
    from femsub.modes.shift_invert import ShiftInvert

    sub = lattice(12, 10)
    wide = np.arange(0, sub.size, 6)
    handle = ShiftInvert(sub.K, sub.M)
    forces = np.eye(sub.size)[:, wide]
    before = handle.factor.columns
    x = handle.elastic_solve(forces)
    each = (handle.factor.columns - before) / len(wide)
    M, K, at = dense(sub.M), dense(sub.K), np.arange(sub.size) // 2
    turn = np.column_stack([at // 10, at % 10]).astype(float)
    first = np.arange(sub.size) % 2 == 0
    Z = np.column_stack([first, ~first, np.where(first, -turn[:, 1], turn[:, 0])]).astype(float)
    Z = Z @ np.linalg.inv(np.linalg.cholesky(Z.T @ M @ Z)).T
    held = M @ Z
    b = forces - held @ (Z.T @ forces)
    factor = la.cho_factor(K + held @ held.T)
    exact: Array = la.cho_solve(factor, b)
    scale = float(np.abs(exact).max())
    error = float(np.abs(x - exact).max()) / scale
    bound = 8 * EPS * float((np.abs(exact).T @ (np.abs(K) @ np.abs(exact))).max()) / scale + CORRECTED
    return Found(f"{len(wide)} attachment modes, {each:.2g} solves each", error, bound, error / bound,
                 "8 eps |u|ᵀ|K||u| and 1e-10 of corrections", lie="" if each <= solves else f"{each:.2g} solves for a column")


def unsymmetric_files(K: Array) -> Found:
    """The same in files: to be refused, with their names."""
    import tempfile
    from pathlib import Path

    from scipy.io import mmwrite

    with tempfile.TemporaryDirectory() as folder:
        for name, part in (("M", np.eye(len(K))), ("K", K)):
            mmwrite(Path(folder) / f"{name}.mtx", sp.coo_array(part), precision=17)
        return answered(lambda: fs.read_component(Path(folder) / "M.mtx", Path(folder) / "K.mtx"))


HCB, CC = fs.CraigBampton, fs.CraigChang
for method, label in ((HCB, "HCB"), (CC, "CC")):
    case("massless", f"{label}, all and nearly all modes, 2 of 5 bare", nearly_complete, issue, method)
    case("massless", f"{label}, all and nearly all modes, every 2nd bare", nearly_complete, lambda: bare(12, 2), method)
    case("massless", f"{label}, all and nearly all modes, floating", nearly_complete, lambda: bare(12, 2, held=False), method, 1)
    case("massless", f"{label}, all and nearly all modes, N, t and s", nearly_complete, lambda: bare(11, 3, units=(1e-3, 1e8)),
         method)
    case("massless", f"{label}, all and nearly all modes, consistent M", nearly_complete, lambda: bare(12, 3, consistent=True),
         method)
    case("massless", f"CEA, {label} with all modes, 2 of 5 bare", same_poles, issue, method(most(issue(), method)))
    case("massless", f"CEA, {label} with all modes, every 2nd bare", same_poles, lambda: bare(10, 2),
         method(most(bare(10, 2), method)))
    case("massless", f"slope, {label} with all modes, 2 of 5 bare", lambda m=method: slope(lambda: fs.reduce(
         issue(), m(most(issue(), m)), ports=True), port="p"), expect="M is singular or nearly so")
    for tol, hi in ((1e-3, 0.3), (1e-6, 0.6)):
        case("massless", f"{label}, tolerance {tol:g}", tolerance, lambda: bare(40, 3), method(band=(0.0, hi), tol=tol))
        case("massless", f"{label}, tolerance {tol:g}, floating", tolerance, lambda: bare(40, 3, held=False),
             method(band=(0.0, hi), tol=tol), 1)
case("interface", "CC, inertia relief at 40 DOF", relief, 4)
for label, six in (("HCB", HCB(6)), ("CC", CC(6))):
    case("border", f"slope, {label}, band above the cut-off", above_cutoff, six, "slope", expect="reaches above the cut-off")
    case("border", f"sweep, {label}, band above the cut-off", above_cutoff, six, "sweep", expect="reaches above the cut-off")
    case("border", f"CEA, {label}, band above the cut-off", above_cutoff, six, "modes", expect="reaches above the cut-off")
    case("border", f"CEA, {label}, all modes", above_cutoff, six, "all")
case("border", "slope, CC, shape above the cut-off", without_artefact)
case("border", "slope, CC, next to the cut-off", near_cutoff)
for factor, label in ((0.5, "before"), (1.0, "at"), (1.5, "beyond")):
    case("border", f"study {label} the border, first pair", study_at_border, factor, 0.2, quick=factor == 1)
    case("border", f"study {label} the border, half of them", study_at_border, factor, 0.75, quick=factor > 0.5)
case("damping", "CC, a tolerance and another damping", other_damping)


FLUTTER = np.array([[1000.0, 200, 0], [-600, 1010, 0], [0, 0, 1e13]])  # Re λ = +5.4
case("ratios", "flutter beside 1e13, as a component", answered, lambda: fs.Substructure(np.eye(3), FLUTTER),
     expect="K is not symmetric")
case("ratios", "M unsymmetric beside 1e13", answered, lambda: fs.Substructure(FLUTTER + 1e3 * np.eye(3), np.eye(3)),
     expect="M is not symmetric")
case("ratios", "flutter beside 1e13, in files", unsymmetric_files, FLUTTER, expect="K is not symmetric")
case("ratios", "CEA, flutter beside 1e13", cea, lambda: fs.Pencil(np.eye(3), None, FLUTTER))
