"""Receptances against the stored matrices in 64 bits of mantissa: the error of no entry exceeds its bound, by any method.

The reference is an LU in long double of the matrices as they are stored. For joined parts it is the primal system, for virtual
points the least-squares motion, by Gram-Schmidt in long double.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, stiffness
from femsub.checks import Array

KINDS = ("rows", "soft", "direct", "coupled", "units", "points")


def full(A: Any, n: int) -> Array:
    found: Array = np.zeros((n, n)) if A is None else A.toarray() if sp.issparse(A) else A
    return found


def exact_responses(parts: tuple[Array, ...], F: Array, C: Array, at: Array) -> Array:
    """Cᵀ(-ω²M + iωD + K + iH)⁻¹F in long double for (M, D, K, H), with one step of refinement."""
    M, D, K, H = (np.asarray(A, dtype=np.longdouble) for A in parts)
    found = []
    for w in at.astype(np.longdouble):
        P = (K - w * w * M) + np.clongdouble(1j) * (w * D + H)
        size = np.abs(P).astype(float)
        r = 2.0 ** -np.rint(np.log2(np.maximum(size.max(axis=1), 1e-300)))
        c = 2.0 ** -np.rint(np.log2(np.maximum((r[:, None] * size).max(axis=0), 1e-300)))
        P, load = r[:, None] * P * c, r[:, None] * F.astype(np.clongdouble)
        factor = eliminated(P)
        x = substituted(*factor, load)
        found.append(C.T.astype(np.clongdouble) @ (c[:, None] * (x + substituted(*factor, load - P @ x))))
    return np.array(found)


def eliminated(P: Array) -> tuple[Array, Array]:
    """P[rows] = L U, both in one array."""
    U, n = P.copy(), len(P)
    rows = np.arange(n)
    for k in range(n - 1):
        best = k + int(np.abs(U[k:, k]).argmax())
        U[[k, best]], rows[[k, best]] = U[[best, k]], rows[[best, k]]
        U[k + 1:, k] /= U[k, k]
        U[k + 1:, k + 1:] -= U[k + 1:, k, None] * U[k, k + 1:]
    return rows, U


def substituted(rows: Array, U: Array, F: Array) -> Array:
    x = F[rows].copy()
    for k in range(1, len(U)):
        x[k] -= U[k, :k] @ x[:k]
    for k in range(len(U) - 1, -1, -1):
        x[k] = (x[k] - U[k, k + 1:] @ x[k + 1:]) / U[k, k]
    return x


# ---- models

def chain(rng: Random, n: int, spread: float, mount: float, inner: float | None = None) -> tuple[Array, Array]:
    """M and K of a chain with springs 10^U(-spread, spread) on a mount: with a soft or stiff spring inside, or cross springs."""
    pairs = [(i - 1, i) for i in range(n)]
    springs = 10.0 ** rng.uniform(-spread, spread, n)
    springs[0] = mount
    if inner is not None:
        springs[int(rng.integers(1, n))] = inner
    for _ in range(int(rng.integers(0, n // 3)) if inner is None and rng.random() < 0.4 else 0):
        i, j = sorted(rng.choice(n, 2, replace=False).tolist())
        pairs.append((i, j))
        springs = np.append(springs, 10.0 ** rng.uniform(-spread, spread))
    mass = 10.0 ** rng.uniform(-spread, spread, n) if rng.random() < 0.7 else np.ones(n)
    M = np.diag(mass)
    if rng.random() < 0.2:
        off = 0.2 * np.sqrt(mass[:-1] * mass[1:])
        M = M + np.diag(off, 1) + np.diag(off, -1)
    return M, stiffness(n, pairs, springs)


def beam(rng: Random) -> tuple[Array, Array]:
    length = 10.0 ** rng.uniform(-6, 2)
    h = length / rng.uniform(10, 200)
    part = fs.beam(length, int(rng.integers(12, 40)), E=1.6e11, I=h**4 / 12, rho=2330.0, A=h * h,
                   supports={"left": "clamped"} if rng.random() < 0.6 else None)
    return full(part.M, part.size), full(part.K, part.size)


def undamped(M: Array, K: Array) -> Array:
    unit = np.maximum(np.abs(K).max(axis=1), 1e-300) ** -0.5
    values = la.eigvalsh(unit[:, None] * K * unit, unit[:, None] * M * unit)
    return np.sqrt(np.maximum(values, 0.0))


def damping(rng: Random, way: str, M: Array, K: Array) -> tuple[Array, Array | None]:
    """D and H."""
    n, unit = len(M), np.sqrt(np.median(K.diagonal()) * np.median(M.diagonal()))
    D, H = np.zeros((n, n)), None
    few = rng.choice(n, 6, replace=n < 6)
    size = unit * 10.0 ** rng.uniform(-4, 2)
    if way == "mass":
        D = 10.0 ** rng.uniform(-5, 0) * unit / np.median(M.diagonal()) * M
    elif way == "rayleigh":
        D = 10.0 ** rng.uniform(-5, -1) * unit / np.median(M.diagonal()) * M + 10.0 ** rng.uniform(-5, -1) * K * (
            np.median(M.diagonal()) / unit)
    elif way == "feedback":
        for i, j in few.reshape(-1, 2)[:int(rng.integers(1, 4))]:
            D[i, j] += size * rng.choice([-1.0, 1.0])
        if rng.random() < 0.5:
            D[few[0], few[0]] += size
    elif way == "gyroscopic":
        for i, j in few.reshape(-1, 2)[:int(rng.integers(1, 4))]:
            D[i, j] += size
            D[j, i] -= size
        D[few[1], few[1]] += size * rng.integers(0, 2)
    elif way == "block":
        D[np.ix_(few[:3], few[3:])] = size * rng.standard_normal((3, 3))
    elif way == "dashpots":
        D[few[:3], few[:3]] = size * rng.random(3)
    elif way == "turning":  # on all DOF: no modal way
        D = size * 1e-2 * (np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1))
    if rng.random() < 0.4:
        H = 10.0 ** rng.uniform(-4, -0.3) * K if rng.random() < 0.5 else np.diag(
            0.1 * K.diagonal() * rng.random(n) * (rng.random(n) < rng.choice([0.1, 1.0])))
    return D, H


def alone(kind: str, rng: Random) -> str:
    n = int(rng.integers(14, 110))
    if kind == "rows":
        M, K = beam(rng) if rng.random() < 0.2 else chain(rng, n, rng.choice([0.0, 1.0]), float(rng.choice([0.0, 1.0, 1e-3])))
        way = str(rng.choice(["feedback", "gyroscopic", "block", "dashpots", "mass"], p=[0.35, 0.25, 0.2, 0.1, 0.1]))
    else:
        inner = 10.0 ** rng.uniform(-12, 8) if rng.random() < 0.4 else None
        M, K = beam(rng) if rng.random() < 0.1 else chain(rng, n, float(rng.uniform(0, 2)), 10.0 ** rng.uniform(-14, -1), inner)
        if rng.random() < 0.15:
            unit = 10.0 ** rng.uniform(-6, 6, 2)
            M, K = unit[0] * M, unit[1] * K
        way = str(rng.choice(["none", "mass", "rayleigh", "dashpots", "feedback", *(["turning"] if kind == "direct" else [])]))
    n = len(M)
    D, H = damping(rng, way, M, K)
    ports = {"a": np.eye(n)[int(rng.integers(n))], "b": np.eye(n)[int(rng.integers(n))] if rng.random() < 0.7 else
             rng.standard_normal(n)}
    made = sp.csr_array if rng.random() < 0.7 or kind != "direct" else np.asarray
    model = fs.Substructure(made(M), made(K), made(D), H=None if H is None else made(H), ports=ports)
    acts, W = None, np.column_stack(list(ports.values()))
    Ds, Ks, Ws = D.astype(np.longdouble), K.astype(np.longdouble), W.astype(np.longdouble)
    if rng.random() < (0.5 if kind == "rows" else 0.2):
        unit = np.median(K.diagonal()) * 10.0 ** rng.uniform(-3, 1)
        C_K = unit * rng.standard_normal((2, 2)) * rng.integers(0, 2, (2, 2))
        rate = unit * np.sqrt(np.median(M.diagonal()) / np.median(K.diagonal()))
        C_D = rate * rng.standard_normal((2, 2)) * rng.integers(0, 2, (2, 2))
        acts = fs.LinearContact(("a", "b"), damping=C_D, stiffness=C_K)
        Ds, Ks = Ds + Ws @ C_D @ Ws.T, Ks + Ws @ C_K @ Ws.T
    own = undamped(M, K)
    top = own[min(len(own) - 1, int(rng.integers(1, 25)))]
    if kind != "rows" and rng.random() < 0.3:  # far below the first elastic mode
        top = max(own[min(3, len(own) - 1)], own[-1] * 1e-9) * 10.0 ** rng.uniform(-6, 0)
    omega = top * (np.linspace(0.03, 1.0, 9) if rng.random() < 0.7 else 10.0 ** rng.uniform(-4, 0, 9))
    if H is None and way in ("none", "feedback", "gyroscopic", "block", "dashpots"):  # not onto resonances
        omega = omega[(np.abs(omega[:, None] / own - 1) > 1e-6).all(axis=1)]
    exact = exact_responses((M, Ds, Ks, full(H, n)), W, W, omega)
    words = []
    for method in ("direct",) if kind == "direct" else ("modal", "auto"):
        try:
            found = fs.frequency_response(model, acts, at=omega, method=method)
        except fs.FemsubError as error:
            words.append(f"refused {method}: {type(error).__name__}: {error}")
            continue
        if what := fault(found, exact):
            return f"wrong: {method}, {way}{', contact' * (acts is not None)}: {what}"
        words.append(found.evidence)
    return min(words, key=lambda word: (not word.startswith("refused"), word))


def fault(found: fs.FrequencyResponse, exact: Array, tol: float = 1e-5) -> str:
    """What does not fit, or nothing."""
    error = np.abs(found.receptance.astype(np.clongdouble) - exact).astype(float)
    bad = error > found.bound
    if bad.any():
        ratio = np.where(bad, error / np.maximum(found.bound, 1e-300), 0.0)
        k = np.unravel_index(ratio.argmax(), ratio.shape)
        return (f"{found.evidence}, |h| = {abs(complex(exact[k])):.3g} at ω = {found.omega[k[0]]:.5g}, off by {error[k]:.2g}, "
                f"bound {found.bound[k]:.2g}{', direct' * bool(found.direct[k[0]])}")
    size = np.abs(exact).astype(float)
    size = np.maximum(size, 1e-3 * np.maximum(size.max(axis=1, keepdims=True), np.median(size, axis=0)))
    if found.evidence == "certified" and (error > 1.01 * tol * size).any():
        return f"certified, but off by {float((error / size).max()):.2g}, where {tol:g} was asked"
    return ""


# ---- joined parts

def joined(kind: str, rng: Random) -> str:
    parts: dict[str, fs.Substructure] = {}
    ends: list[list[int]] = []
    if kind == "units":
        length = 10.0 ** rng.uniform(-8, 4)
        h, scale = length / rng.uniform(10, 100), 10.0 ** rng.uniform(-3, 3)
        data = {"E": scale * 1.6e11, "I": h**4 / 12, "rho": 10.0 ** rng.uniform(-3, 3) * 2330.0, "A": h * h}
        for k, name in enumerate("ab"):
            left = {"left": "clamped"} if k == 0 else None
            part = fs.beam(length * (1.0 if k == 0 else rng.uniform(0.3, 2)), int(rng.integers(3, 10)), **data, supports=left,
                           interface=["right" if k == 0 else "left"])
            parts[name] = fs.damped(part, structural=rng.uniform(0.001, 0.05)) if rng.random() < 0.5 else part
            ends.append([int(dof) for dof in part.interface])
        count = 2
    else:
        count = int(rng.integers(1, 4))
        for k, name in enumerate("ab"):
            n = int(rng.integers(5, 40))
            mount = 0.0 if k and rng.random() < 0.5 else 10.0 ** rng.uniform(-10, 1) if rng.random() < 0.5 else 1.0
            M, K = chain(rng, n, float(rng.choice([0.0, 1.0])), mount)
            D, H = damping(rng, str(rng.choice(["none", "mass", "rayleigh", "dashpots"])), M, K)
            parts[name] = fs.Substructure(M, K, D, H=H, name=name)
            ends.append([int(dof) for dof in rng.choice(n, count, replace=False)])
    one, other = parts.values()
    n, m = one.size, other.size
    far = [int(rng.integers(n)), int(rng.integers(m))]
    loads = [list(dict.fromkeys([*ends[k], far[k]])) for k in range(2)]
    T = np.zeros((n + m, n + m - count))
    T[:n, :n] = np.eye(n)
    free = [j for j in range(m) if j not in ends[1]]
    T[[n + j for j in free], np.arange(n, n + len(free))] = 1.0
    T[[n + j for j in ends[1]], ends[0]] = 1.0
    M, D, K, H = (T.T @ la.block_diag(full(a, n), full(b, m)).astype(np.longdouble) @ T for a, b in (
        (one.M, other.M), (one.D, other.D), (one.K, other.K), (one.H, other.H)))
    own = undamped(M.astype(float), K.astype(float))
    omega = own[min(int(rng.integers(1, 12)), len(own) - 1)] * np.sort(rng.uniform(0.05, 1.1, 5))
    if rng.random() < 0.4:
        omega = omega * 10.0 ** rng.uniform(-6, 0)
    try:
        known = {name: fs.frequency_response(part, at=omega, loads=loads[k])
                 for k, (name, part) in enumerate(parts.items())}
    except fs.SingularMatrixError as error:
        return f"refused part: {error}"
    joints = [(("a", f"DOF {i}"), ("b", f"DOF {j}")) for i, j in zip(*ends, strict=True)]
    F = np.hstack([T[:n][loads[0]].T, T[n:][loads[1]].T])
    exact = exact_responses((M, D, K, H), F, F, omega)
    try:
        found = fs.couple_responses(known, joints)
    except fs.FemsubError as error:
        return f"refused: {type(error).__name__}: {error}"
    return f"wrong: {what}" if (what := fault(found, exact)) else found.evidence


# ---- virtual points

def point(rng: Random) -> str:
    """Sensors around a point, at any distance, on parts that move by translation more than by rotation, or less."""
    count, reach, far = int(rng.integers(6, 13)), 10.0 ** rng.uniform(-6, 2), rng.standard_normal(3) * 10.0 ** rng.uniform(-6, 2)
    places = {f"s{k}": (tuple((far + reach * rng.standard_normal(3)).tolist()), tuple(rng.standard_normal(3).tolist()))
              for k in range(count)}
    Y = 10.0 ** rng.uniform(-12, 3) * (rng.standard_normal((2, count + 1, count + 1)) + 1j)
    Y += rng.integers(0, 2) * 10.0 ** rng.uniform(-12, 3)
    given = fs.FrequencyResponse.measured([1.0, 2.0], Y, [*places, "far"], [*places, "far"])
    try:
        found = fs.virtual_point(given, far, places)
    except fs.InputError as error:
        return f"refused: {error}"
    R = np.zeros((count, 6), dtype=np.longdouble)
    for k, (x, d) in enumerate(places.values()):
        arm, along = np.array(x, dtype=np.longdouble) - far, np.array(d, dtype=np.longdouble)
        along = along / np.sqrt(along @ along)
        R[k] = [*along, *np.cross(arm, along)]
    unit = np.sqrt((R * R).sum(axis=0))
    Q = R / unit
    for _ in range(3):  # Gram-Schmidt, repeated
        for j in range(6):
            for i in range(j):
                Q[:, j] -= Q[:, i] * (Q[:, i] @ Q[:, j])
            Q[:, j] /= np.sqrt(Q[:, j] @ Q[:, j])
    T = np.zeros((7, count + 1), dtype=np.longdouble)
    T[:6, :count] = substituted(*eliminated(Q.T @ R), Q.T)
    T[6, count] = 1
    return f"wrong: {what}" if (what := fault(found, T @ Y @ T.T)) else "bounded"


@attack("receptances", KINDS)
def attacked(kind: str, rng: Random) -> str:
    return point(rng) if kind == "points" else joined(kind, rng) if kind in ("coupled", "units") else alone(kind, rng)
