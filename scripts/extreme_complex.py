"""Extreme cases of complex modes and of the border of stability: how they are measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from extreme_cases import judge
from extreme_reference import EPS, Array, Found, border, dense, energy_conditions, matched, mp, quadratic

import femsub as fs


def roots(damping: Any, stiffness: Any) -> Array:
    """λ² + dλ + k = 0 for all pairs of coefficients, without cancellation."""
    d, k = (np.asarray(part, dtype=complex) for part in np.broadcast_arrays(damping, stiffness))
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
        **options: Any) -> Found:
    """Complex modes against a companion matrix in 60 digits, or against closed forms with `closed`.

    An error must lie within femsub's own error bar, and of a dense pencil (with `regular` M) within the bound of a backward
    stable method; at a defective eigenvalue of the order `power` within (10 m eps)^(1/power) ‖A‖ instead.
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
    size = np.array([abs(complex(reference[j])) for j in partner])
    top = max(float(abs(value)) for value in reference)
    noise = EPS * np.where(size > 0, size, 0) + 1e-40 * top  # closed forms are rounded, too
    bound, why = 1.05 * found.error_bar + 4 * noise, "femsub's error bar"
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
    worst = judge((distance / scale)[~zero], (bound / scale)[~zero])
    growing = max((float(mp.re(value)) for value in reference), default=-np.inf) if not options else None
    lie = ""
    if growing is not None and found.is_stable is not None and found.is_stable is not (growing <= 0):
        lie = f"is_stable is {found.is_stable}, but the largest Re λ is {growing:.2e}"
    missed = _missed(values, reference, options) if options else len(reference) - len(values)
    told = f"{len(values)} complex eigenvalues, stable: {found.is_stable}"
    shapes = found.shapes / np.linalg.norm(found.shapes, axis=0)
    return Found(told, *worst, why, float(found.backward_error.max()), None,
                 float(np.linalg.cond(shapes[:, values.imag > 0])) if (values.imag > 0).any() else None, missed, lie)


def _missed(values: Array, reference: list[Any], options: dict[str, Any]) -> int:
    there = np.array([complex(value) for value in reference])
    if "band" in options:
        lo, hi = options["band"]
        edge = 1e-9 * hi
        inside = (there.imag >= lo + edge) & (there.imag <= hi - edge) & (np.abs(there.real) <= hi - edge)
        return max(0, int(inside.sum()) - len(values))
    reach = np.abs(values).max() * (1 - 1e-6)
    return max(0, int(np.count_nonzero(np.abs(there) < reach)) - int(np.count_nonzero(np.abs(values) < reach)))


def slope(build: Callable[[], fs.Substructure], known: float | None = None) -> Found:
    """The critical slope against the root of Im G in 60 digits, with no mode unstable at 0.999 of it; or a known one."""
    sub = build()
    found = fs.critical_slope(sub)
    if known is not None:
        same = found.slope == known
        return Found(f"critical slope {found.slope:.6g}", float(not same), EPS, float(not same), "known beforehand",
                     lie="" if same else f"it is {known:.6g}")
    w = sub.port("belt")
    if found.slope == 0.0 or not np.isfinite(found.slope):
        return Found(f"critical slope {found.slope:.6g}", 1.0, EPS, np.inf, "it is neither 0 nor infinite")
    exact_slope, moved = border(sub.M, sub.D, sub.K, w, found.omega)
    spectrum = quadratic(sub.M, dense(sub.D) + 0.999 * found.slope * np.outer(w, w), sub.K)
    size = max(abs(value) for value in spectrum)
    growing = sum(value.imag >= 0 and value.real > mp.mpf(10) ** -45 * size for value in spectrum)
    error = float(abs(exact_slope - mp.mpf(found.slope)) / abs(exact_slope))
    bound = 10 * moved + _modal(sub, w, found.omega)
    return Found(f"critical slope {found.slope:.6g}", error, bound, error / bound, "10 roundings per entry + those of ΦᵀDΦ",
                 missed=int(growing))


def tiny_slope(build: Callable[[], fs.Substructure], damping: float) -> Found:
    """A slope that is 0 up to what turns a damping ratio of 1e-13; the true one is that of the chain times `damping`."""
    sub = build()
    found, whole = fs.critical_slope(sub), fs.critical_slope(sub.with_damping(sub.D / damping))
    natural = 2 * float(np.sqrt(np.linalg.eigvalsh(dense(sub.K)).max()))
    error = abs(found.slope - damping * whole.slope) / natural
    return Found(f"critical slope {found.slope:.6g}", error, 2e-13, error / 2e-13, "a damping ratio of 1e-13 is rounding")


def _modal(sub: fs.Substructure, w: Array, omega: float) -> float:
    """n eps ω |y|ᵀ|C||q| / |h| of the heaviest motion: C = ΦᵀDΦ is what the border is sought with."""
    import scipy.linalg as la

    values, shapes = la.eigh(dense(sub.K), dense(sub.M))
    C, load = shapes.T @ dense(sub.D) @ shapes, shapes.T @ w
    q = np.linalg.solve(np.diag(values - omega**2 + 0j) + 1j * omega * C, load)
    return float(len(w) * EPS * omega * np.abs(q) @ np.abs(C) @ np.abs(q) / np.abs(load @ q))
