"""Extreme cases of complex modes and of the border of stability: how they are measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import dense
from benchmarks.extreme.cases import alternating, case, chain, judge, one
from benchmarks.extreme.reference import (
    EPS,
    Array,
    Found,
    border,
    energy_conditions,
    matched,
    mp,
    quadratic,
    worst,
)


def roots(damping: Any, stiffness: Any) -> Array:
    """λ² + dλ + k = 0 for all pairs of coefficients, without cancellation."""
    d, k = (np.atleast_1d(np.asarray(part, dtype=complex)) for part in np.broadcast_arrays(damping, stiffness))
    root = np.sqrt(d * d / 4 - k)
    large = -d / 2 - np.where((d.conj() * root).real >= 0, root, -root)
    return np.concatenate([large, np.divide(k, large, out=np.zeros_like(large), where=large != 0)])


def proportional(n: int, alpha: float, beta: float) -> tuple[fs.Pencil, Array]:
    """The chain with D = αM + βK, and its eigenvalues."""
    sub, omega = fs.chain(n), fs.chain_frequencies(n)
    return fs.Pencil(sub.M, alpha * sub.M + beta * sub.K, sub.K), roots(alpha + beta * omega**2, omega**2)


def paired(n: int, gyroscopic: float, circulatory: Any) -> tuple[fs.Pencil, Array]:
    """Two motions for each mass of a chain, λ²I + λgJ + K⊗I₂ + I⊗C with J = [[0, 1], [-1, 0]]: for C = cJ
    λ² ± iλg + ω² ± ic = 0; for a matrix C, without g, λ² = -ω² - (eigenvalues of C).
    """
    J, pair, eye, omega = np.array([[0.0, 1.0], [-1.0, 0.0]]), sp.eye_array(2), sp.eye_array(n), fs.chain_frequencies(n)
    C = circulatory * J if np.ndim(circulatory) == 0 else np.asarray(circulatory)
    K = sp.kron(fs.chain(n).K, pair) + sp.kron(eye, sp.csr_array(C))
    if np.ndim(circulatory) == 0:
        values = np.concatenate([roots(sign * 1j * gyroscopic, omega**2 + sign * 1j * circulatory) for sign in (1, -1)])
    else:
        middle = np.trace(C) / 2  # a defective pair in C: exactly the double eigenvalue
        values = np.concatenate([roots(0.0, omega**2 + middle)] * 2)
    return fs.Pencil(sp.eye_array(2 * n), sp.kron(eye, gyroscopic * sp.csr_array(J)), K), values


def cea(build: Callable[[], Any], closed: bool = False, power: int = 1, belt: fs.Belt | None = None, regular: bool = True,
        semisimple: bool = False, **options: Any) -> Found:
    """Complex modes against a companion matrix in 60 digits, or against closed forms with `closed`.

    An error must lie within femsub's own error bar, and of a dense pencil (with `regular` M) within the bound of a backward
    stable method; at a defective eigenvalue of the order `power` within (10 m eps)^(1/power) ‖A‖ instead. Sets are compared,
    one to one: what is listed twice is wrong, and of a band all must be there that lies in it or on its edges. Of equal
    eigenvalues that are `semisimple` no shape may be a combination of the others.
    """
    model = build()
    if closed:
        pencil, known = model
        reference = [mp.mpc(complex(value)) for value in known]
    else:
        pencil = model if isinstance(model, fs.Pencil) else model.linearised(belt)
        reference = quadratic(pencil.M, pencil.D, pencil.K)
    found = fs.complex_modes(pencil if closed else model, belt, **options)
    values = found.eigenvalues
    distance, partner = matched(values, reference)
    real, lie = partner >= 0, ""
    if not real.all():
        lie = f"{np.count_nonzero(~real)} eigenvalues that do not exist, such as {values[~real][0]:.3g}"
        found, values, distance, partner = _only(found, real), values[real], distance[real], partner[real]
    size = np.array([abs(complex(reference[j])) for j in partner])
    top = max(float(abs(value)) for value in reference)
    noise = EPS * np.where(size > 0, size, 0) + 1e-40 * top  # closed forms are rounded, too
    bound, why = 1.05 * found.error_bar + 4 * noise, "femsub's error bar"
    if power > 1 and closed:
        bound = np.minimum(bound, (20 * pencil.size * EPS) ** (1 / power) * top)
        why = f"error bar, and (10 m eps)^(1/{power}) ‖A‖"
    if regular and not closed:
        near, first = energy_conditions(pencil.M, pencil.D, pencil.K)
        nearest = np.abs(near[:, None] - np.array([complex(reference[j]) for j in partner])).argmin(axis=0)
        stable = first[nearest] if power == 1 else np.minimum(
            first[nearest], (20 * pencil.size * EPS) ** (1 / power) * max(top, 1e-300))
        if power > 1:
            bound = stable
            why = f"(10 m eps)^(1/{power}) ‖A‖, {power}-fold defective"
        else:
            why = "error bar, and 10 m eps ‖A‖ cond + 8 roundings per entry"
        bound = np.minimum(bound, stable)
    scale = np.where(size > 0, size, 1.0)
    zero = (size == 0) & (distance == 0)
    figures = judge((distance / scale)[~zero], (bound / scale)[~zero])
    growing = max((float(mp.re(value)) for value in reference), default=-np.inf) if not options else None
    if growing is not None and found.is_stable is not None and found.is_stable is not (growing <= 0):
        lie = lie or f"is_stable is {found.is_stable}, but the largest Re λ is {growing:.2e}"
    if "band" in options:
        missed, beyond = _against_band(partner, reference, options["band"], options.get("re"))
        lie = lie or (f"{beyond} listed from outside of the band" if beyond else "")
    else:
        missed = _missed(values, reference) if options else len(reference) - len(values)
        if len(values) < min(options.get("count", 0), len(reference)):
            lie = lie or f"{options['count']} were asked for, {len(values)} came"
    told = f"{len(values)} complex eigenvalues, stable: {found.is_stable}"
    shapes = found.shapes / np.linalg.norm(found.shapes, axis=0)
    if semisimple:
        groups = [np.flatnonzero(np.abs(values - value) <= 1e-9 * abs(value)) for value in values if value]
        least = min((np.linalg.svd(shapes[:, group], compute_uv=False)[-1] for group in groups), default=1.0)
        lie = lie or ("equal eigenvalues with dependent shapes" if least < 1e-6 else "")
    return Found(told, *figures, why, float(found.backward_error.max(initial=0.0)), None,
                 float(np.linalg.cond(shapes[:, values.imag > 0])) if (values.imag > 0).any() else None, missed, lie)


def _only(found: fs.ComplexModes, keep: Array) -> fs.ComplexModes:
    return replace(found, shapes=found.shapes[:, keep], **{key: getattr(found, key)[keep] for key in (
        "eigenvalues", "backward_error", "error_bar", "rigid", "above_cutoff", "condition")})


def _missed(values: Array, reference: list[Any]) -> int:
    there = np.array([complex(value) for value in reference])
    reach = np.abs(values).max() * (1 - 1e-6)
    return max(0, int(np.count_nonzero(np.abs(there) < reach)) - int(np.count_nonzero(np.abs(values) < reach)))


def _against_band(partner: Array, reference: list[Any], band: tuple[float, float],
                  re: tuple[float, float] | None) -> tuple[int, int]:
    """How many in the band or on an edge were not found, and how many were listed that lie further off than 4e-6 |λ|."""
    there = np.array([complex(value) for value in reference])
    a, b = re or (-band[1], band[1])
    size = np.maximum(np.abs(there), 1e-2 * band[1])
    beyond = np.max([band[0] - there.imag, there.imag - band[1], a - there.real, there.real - b], axis=0) / size
    listed = np.isin(np.arange(len(there)), partner)
    return int(np.count_nonzero((beyond <= 1e-12) & ~listed)), int(np.count_nonzero((beyond > 4e-6) & listed))


def slope(build: Callable[[], fs.Substructure], known: float | None = None, within: float = 0.0, at: float | None = None,
          sparse: bool = False, **options: Any) -> Found:
    """The critical slope against the root of Im G in 60 digits, with no mode unstable at 0.999 of it.

    Or against a known one, exactly or `within` a relative error, `at` a known frequency; or of a `sparse`
    chain by its pivots, without that look at the modes.
    """
    sub = build()
    found = fs.critical_slope(sub, **options)
    told = f"critical slope {found.value:.6g}"
    if known is not None:
        error = abs(found.value - known) / abs(known or 1.0)
        lie = f"it is {known:.6g}" if error > within else f"it is at ω = {at:g}" if at is not None and found.omega != at else ""
        return Found(told, error, max(within, EPS), error / max(within, EPS), "known beforehand", lie=lie)
    w = sub.port(options.get("port", "belt"))
    if found.value == 0.0 or not np.isfinite(found.value):
        return Found(told, 1.0, EPS, np.inf, "it is neither 0 nor infinite")
    exact_slope, moved = border(sub.M, sub.D, sub.K, w, found.omega, sparse)
    growing = None
    if not sparse:
        spectrum = quadratic(sub.M, dense(sub.D) + 0.999 * found.value * np.outer(w, w), sub.K)
        size = max(abs(value) for value in spectrum)
        lo, hi = found.band[0] - mp.mpf(10) ** -30 * size, found.band[1]  # of a real λ Im λ is rounding
        growing = int(sum(lo <= value.imag <= hi and value.real > mp.mpf(10) ** -45 * size for value in spectrum))
    error = float(abs(exact_slope - mp.mpf(found.value)) / abs(exact_slope))
    bound = 10 * moved + _modal(sub, w, found.omega)
    return Found(told, error, bound, error / bound, "10 roundings per entry + those of ΦᵀDΦ", missed=growing)


def on_an_edge(build: Callable[[], fs.Substructure], band: tuple[float, float] | None, **options: Any) -> Found:
    """The border of a chain sought in bands that end or begin at its frequency."""
    omega = fs.critical_slope(build(), band=band).omega
    return worst(slope(build, band=edge, **options) for edge in ((omega, 3 * omega), (0.3 * omega, omega)))


def drift(n: int, alpha: float, beta: float, reduced: bool = False, **options: Any) -> Found:
    """A floating chain with D = αM + βK: uniform motion has λ(nλ + nα + c) = 0, hence drifts from c = -nα on, at ω = 0.

    Its damping is what is left of D's entries when they are added up; 8 roundings of each are allowed.
    """
    sub = fs.damped(fs.chain(n, belt=10, damping=0.0, fixed=False), rayleigh=(alpha, beta))
    within = 8 * EPS * float(abs(sub.D).sum()) / (n * alpha) if alpha else 0.0
    found = slope(lambda: fs.reduce(sub, fs.CraigChang(6), ports=True) if reduced else sub, -n * alpha, within, 0.0, **options)
    return replace(found, why="8 roundings of D against rigid motion")


def tiny_slope(build: Callable[[], fs.Substructure], damping: float) -> Found:
    """A slope that is 0 up to what turns a damping ratio of 1e-13; the true one is that of the chain times `damping`."""
    sub = build()
    found, whole = fs.critical_slope(sub), fs.critical_slope(sub.with_damping(sub.D / damping))
    natural = 2 * float(np.sqrt(np.linalg.eigvalsh(dense(sub.K)).max()))
    error = abs(found.value - damping * whole.value) / natural
    return Found(f"critical slope {found.value:.6g}", error, 2e-13, error / 2e-13, "a damping ratio of 1e-13 is rounding")


def _modal(sub: fs.Substructure, w: Array, omega: float) -> float:
    """n eps ω |y|ᵀ|C||q| / |h| of the heaviest motion: C = ΦᵀDΦ is what the border is sought with."""
    import scipy.linalg as la

    values, shapes = la.eigh(dense(sub.K), dense(sub.M))
    C, load = shapes.T @ dense(sub.D) @ shapes, shapes.T @ w
    q = np.linalg.solve(np.diag(values - omega**2 + 0j) + 1j * omega * C, load)
    return float(len(w) * EPS * omega * np.abs(q) @ np.abs(C) @ np.abs(q) / np.abs(load @ q))


BELT = fs.Belt(slope=-0.2677)
TWIN = np.array([[1.0, 0.5], [-0.5, 2.0]])  # two modes whose frequencies have just met: defective
case("ratios", "CEA, every other spring 1e12", cea, chain(6, springs=alternating(6, 1e12)), belt=BELT)
case("ratios", "CEA, every other mass 1e12", cea, chain(6, masses=alternating(6, 1e12)), belt=BELT)
case("ratios", "CEA, mount of 1e-12", cea, chain(6, springs=one(6, 0, 1e-12)))
case("ratios", "slope, every other mass 1e12", slope, chain(6, belt=2, masses=alternating(6, 1e12)))
case("ratios", "slope, every other spring 1e12", slope, chain(6, belt=2, springs=alternating(6, 1e12)))
case("ratios", "slope, mount of 1e-12", slope, chain(6, belt=2, springs=one(6, 0, 1e-12)))
for ratio in (1e12, 1e-12):
    case("units", f"CEA, ω times {ratio:g}", cea, lambda r=ratio: fs.Pencil(fs.chain(6).M / r, fs.chain(6).D, fs.chain(6).K * r))
    case("units", f"slope, ω times {ratio:g}", slope, lambda r=ratio: fs.Substructure(
        fs.chain(6).M / r, fs.chain(6).K * r, fs.chain(6).D, [0], fs.chain(6, belt=2).ports))
case("massless", "CEA, a massless DOF without damping", cea, lambda: fs.Pencil(np.diag(one(6, 2, 0.0)), 0.1 * np.diag(one(6, 2,
     0.0)),
     fs.chain(6).K), regular=False)
case("massless", "CEA, a massless DOF on a dashpot", cea,
     lambda: fs.Pencil(np.diag(one(6, 2, 0.0)), np.diag(one(6, 2, 0.0) == 0) * 1e6,
     fs.chain(6).K), regular=False)
case("massless", "slope, a massless DOF", slope, lambda: fs.Substructure(np.diag(one(6, 1, 0.0)), fs.chain(6).K, fs.chain(6).D,
     [0],
     fs.chain(6, belt=3).ports), expect="M is singular or nearly so")
case("repeated", "CEA, equal damped twins", cea, lambda: fs.Pencil(np.eye(4), np.kron(np.eye(2), fs.chain(2).D.toarray()),
     np.kron(np.eye(2), fs.chain(2).K.toarray())))
for belt in (2, 5, 10):
    case("edges", f"slope on an edge, chain 10, belt m{belt}", on_an_edge, chain(10, belt=belt), None, quick=belt == 2)
case("edges", "slope on an edge, bracketed", on_an_edge, chain(10, belt=2), None, method="bracketing", quick=False)
for belt in (2, 7):
    case("edges", f"slope on an edge, chain 400, belt m{belt}", on_an_edge, chain(400, belt=belt), (0.0, 0.025), sparse=True)
for way in ("auto", "bracketing"):
    case("border", f"drift first, {way}", drift, 10, 1e-4, 0.05, method=way)
    case("border", f"drift first, CC, {way}", drift, 10, 1e-4, 0.05, True, method=way)
case("border", "drift first, 3,000 masses", drift, 3000, 1e-6, 5.0, band=(0.0, 0.01))
case("border", "drift without damping, 400 masses", drift, 400, 0.0, 0.05, band=(0.0, 0.006))
case("border", "drift first, pairs above it", slope, lambda: fs.damped(fs.chain(10, belt=10, damping=0.0, fixed=False),
     rayleigh=(1e-4, 0.05)), band=(1e-3, 1.0))
DENSE, A = fs.chain(6), np.random.default_rng(3).standard_normal((6, 6))
for label, D in (("undamped", None), ("overdamped", 10 * np.eye(6)), ("overdamped 1e6", 1e6 * np.eye(6)),
                 ("negatively damped", -0.1 * np.eye(6)), ("D not proportional", A @ A.T), ("D unsymmetric", A)):
    case("damping", f"CEA, {label}", cea, lambda D=D: fs.Pencil(DENSE.M, D, DENSE.K))
case("damping", "CEA, D and K unsymmetric", cea, lambda: fs.Pencil(DENSE.M, A, DENSE.K.toarray() + 0.5 * (A - A.T)))
case("damping", "CEA, K negative", cea, lambda: fs.Pencil(np.eye(6), 0.1 * np.eye(6), -DENSE.K.toarray()))
case("damping", "CEA, K = 0", cea, lambda: fs.Pencil(np.eye(3), np.diag([1.0, 2.0, 3.0]), np.zeros((3, 3))), regular=False)
for alpha, beta in ((0.0, 0.0), (0.01, 1e-3), (-0.01, 0.0), (10.0, 0.0), (1e-9, 0.0)):
    case("damping", f"PEP, D = {alpha:g} M + {beta:g} K", cea, lambda a=alpha, b=beta: proportional(300, a, b), closed=True,
         count=12)
case("damping", "PEP, undamped, band", cea, lambda: proportional(300, 0.0, 0.0), closed=True, band=(0.0, 0.1), quick=False)
case("damping", "PEP, D = 1e4 K", cea, lambda: proportional(300, 0.0, 1e4), closed=True, count=12, quick=False)
case("damping", "PEP, D = 1e4 K, 2,100 masses", cea, lambda: proportional(2100, 0.0, 1e4), closed=True, count=12,
     expect="of 16 complex modes converged", quick=False)
case("damping", "PEP, gyroscopic", cea, lambda: paired(150, 1.0, 0.0), closed=True, count=12)
case("damping", "PEP, circulatory", cea, lambda: paired(150, 0.0, 1e-3), closed=True, count=12)
case("damping", "slope, undamped", slope, lambda: fs.chain(6, belt=3).with_damping(None), known=0.0)
case("damping", "slope, damping of 1e-13", tiny_slope, chain(6, belt=2, damping=1e-13), 1e-12)
case("damping", "slope, overdamped", slope, lambda: fs.chain(6, belt=3).with_damping(10 * np.eye(6)))
case("damping", "slope, negatively damped", slope, lambda: fs.chain(6, belt=3).with_damping(-0.1 * np.eye(6)),
     expect="unstable before the belt acts")
case("damping", "slope, dashpot of 1e4", slope, chain(6, belt=2, damping=1e4))
case("damping", "slope, dashpot of 1e7", slope, chain(6, belt=2, damping=1e7), expect="rounding may move the border")
case("damping", "slope, dashpot of 1e11", slope, chain(6, belt=2, damping=1e11), expect="lost in the rounding of a dashpot")
case("damping", "slope, gyroscopic", slope, lambda: fs.chain(6, belt=3).with_damping(0.05 * np.eye(6) + 0.3 * (A - A.T)))
case("defective", "flutter, two modes just met", cea, lambda: fs.Pencil(np.eye(2), None, TWIN), power=2)
case("defective", "flutter, 1e-8 beyond", cea, lambda: fs.Pencil(np.eye(2), None, TWIN + 1e-8 * np.array([[0, 1], [-1, 0]])),
     power=2)
case("defective", "flutter, 1e-8 before", cea, lambda: fs.Pencil(np.eye(2), None, TWIN - 1e-8 * np.array([[0, 1], [-1, 0]])),
     power=2)
case("defective", "critical damping", cea, lambda: fs.Pencil(np.eye(2), np.diag([2.0, 4.0]), np.diag([1.0, 4.0])), power=2)
case("defective", "triple eigenvalue", cea, lambda: fs.Pencil(np.eye(3), None, np.eye(3) + np.diag([1.0, 1.0], 1)), power=3)
case("defective", "PEP, every mode of 150 a defective pair", cea, lambda: paired(150, 0.0, TWIN), closed=True, count=12,
     quick=False)
