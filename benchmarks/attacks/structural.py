"""Complex modes with structural damping H under friction: every solution of λ²M + λD + K ± iH, against 60 digits.

'friction': H ⪰ 0 of any rank, unsymmetric contacts. 'overdamped': some λ are real without H. 'gyroscopic': D with a skew part.
'floating': rigid motion, with an H that acts on it in half of the models. 'large': 8 to 24 DOF of the first three, against LAPACK
on the companion matrix. The solutions are the λ of λ²M + λD + K + iH above the real axis, their conjugates, and the real λ
without H.
"""

from __future__ import annotations

import numpy as np
from mpmath import mp
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks.attacks.common import Random, attack, eigenvalues, exact_eigenvalues
from femsub.checks import Array

KINDS = ("friction", "overdamped", "gyroscopic", "floating", "large")
DIGITS = 60


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    model, contact = _model(kind, rng)
    try:
        modes = fs.complex_modes(model, contact)
    except fs.FemsubError as error:
        return f"refused: {error}"
    pencil = model.linearised(contact, structural=True).dense()
    lossy, plain = (_exact(pencil, scale * np.asarray(model.H), kind == "large") for scale in (1.0, 0.0))
    size = np.abs(lossy).max()
    sure = 1e-7 if kind == "large" else 1e-9  # of the largest |λ|: nearer to the axis rounding of the matrices decides the side
    up, real = lossy[lossy.imag > 0], plain[np.abs(plain.imag) <= (1e-12 * size if kind == "large" else 0.0)]
    found = modes.eigenvalues
    bar = modes.error_bar + (1e-8 * size if kind == "large" else 1e-15 * np.abs(found)) + np.where(modes.rigid, 1e-7 * size, 0.0)
    for name, mine, own, there in (("upper", found[found.imag > 0], bar[found.imag > 0], up),
                                   ("real", found[found.imag == 0], bar[found.imag == 0], real)):
        clear = np.abs(there.imag) > sure * size if name == "upper" else np.ones(len(there), dtype=bool)
        far = np.abs(mine[:, None] - there) - own[:, None]
        rows, columns = linear_sum_assignment(np.maximum(far, 0.0))
        unmet = [there[j] for j in np.setdiff1d(np.arange(len(there)), columns) if clear[j]]
        strange = [mine[i] for i in np.setdiff1d(np.arange(len(mine)), rows) if np.abs(mine[i].imag) > own[i] or name == "real"]
        off = [mine[i] for i, j in zip(rows, columns, strict=True) if far[i, j] > 0 and np.isfinite(own[i])]
        if unmet or strange or off:
            if modes.evidence == "not checked" and not off:
                return "not checked"
            return f"wrong: {modes.evidence}, {name}: missing {unmet}, too many {strange}, off {off}"
    growth = max(np.max(up.real, initial=-np.inf), np.max(real.real, initial=-np.inf))
    if modes.is_stable is not None and abs(growth) > sure * size and modes.is_stable != (growth < 0):
        return f"wrong: stable {modes.is_stable}, but growth {growth}"
    return modes.evidence


def _model(kind: str, rng: Random) -> tuple[fs.Substructure, fs.LinearContact]:
    n = int(rng.integers(8, 25) if kind == "large" else rng.integers(1, 5))
    M = np.diag(10 ** rng.uniform(-1, 1, n)) if rng.random() < 0.5 else _semidefinite(rng, n, n) + 0.2 * np.eye(n)
    K = _semidefinite(rng, n, n) + 0.1 * np.eye(n)
    H = _semidefinite(rng, n, int(rng.integers(1, n + 1))) * 10 ** rng.uniform(-4, 1)
    D = np.zeros((n, n))
    kinds = {kind} if kind != "large" else set(rng.choice(KINDS[:3], int(rng.integers(1, 4))))
    if "overdamped" in kinds:
        D = D + _semidefinite(rng, n, int(rng.integers(1, n + 1))) * 10 ** rng.uniform(0, 2)
    if "gyroscopic" in kinds:
        G = rng.standard_normal((n, n)) * 10 ** rng.uniform(-2, 1)
        D = D + G - G.T
    if "floating" in kinds:
        z = rng.integers(1, 3, n) * rng.choice([-1.0, 1.0], n)
        P = np.eye(n) * (z @ z) - np.outer(z, z)
        K = P @ np.diag(rng.integers(1, 9, n).astype(float)) @ P  # whole numbers: Kz is 0 to the last digit
        if rng.random() < 0.5:
            H = P @ np.diag(rng.integers(0, 9, n).astype(float)) @ P * 2.0 ** rng.integers(-9, 2)
        else:
            H = H + 2.0 ** rng.integers(-9, 2) * np.eye(n)
    if rng.random() < 0.3:
        H = 2.0 ** rng.integers(-7, 2) * K  # HZ is 0 where KZ is
    if rng.random() < 0.2 and "floating" not in kinds:
        K = K - rng.uniform(0, 2) * np.eye(n)
    if rng.random() < 0.1:
        H = -H
    ports = {name: rng.standard_normal(n) for name in "ab"}
    C = [rng.standard_normal((2, 2)) * rng.integers(0, 2) * 10 ** rng.uniform(-2, 0.5) for _ in range(2)]
    if "floating" in kinds:
        C[1] *= 0.0
    return (fs.Substructure(M, K, D, H=(H + H.T) / 2, ports=ports),
            fs.LinearContact(("a", "b"), damping=C[0], stiffness=C[1]))


def _semidefinite(rng: Random, n: int, rank: int) -> Array:
    A = rng.standard_normal((n, rank))
    return A @ A.T


def _exact(pencil: fs.Pencil, H: Array, by_lapack: bool) -> Array:
    if by_lapack:
        return eigenvalues(pencil.M, pencil.D, pencil.K + 1j * H)
    with mp.workdps(DIGITS):
        M, D, K, loss = (mp.matrix(A.tolist()) for A in (pencil.M, pencil.D, pencil.K, H))
        values = exact_eigenvalues(M, D, K + mp.mpc(0, 1) * loss)
        size = max(abs(value) for value in values)  # a multiple λ has the root of the working precision as its error
        return np.array([complex(value.real, 0 if abs(value.imag) <= mp.mpf(10) ** (-DIGITS // 3) * size else value.imag)
                         for value in values])
