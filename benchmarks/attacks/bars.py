"""Error bars of complex eigenvalues, against 150 digits: small pencils with M, D and K up to 40 orders of magnitude apart."""

from __future__ import annotations

import numpy as np
from mpmath import mp

import femsub as fs
from benchmarks.attacks.common import Random, attack, exact_eigenvalues, misfit
from femsub.checks import Array

KINDS = ("scales", "units", "nearly singular", "friction", "clusters")


def spd(rng: Random, n: int) -> Array:
    B = rng.standard_normal((n, n)).round(3)
    return B @ B.T + 0.1 * np.eye(n)


def pencil(kind: str, rng: Random) -> fs.Pencil:
    n = int(rng.integers(1, 5))
    M, D, K = spd(rng, n), spd(rng, n) * rng.choice([0.0, 1.0, 1.0, -1.0]), spd(rng, n)
    if rng.random() < 0.3:
        D = np.diag(rng.choice([0.0, 1.0], n))
    if rng.random() < 0.3:
        M = np.diag(rng.uniform(0.5, 2.0, n))
    if kind == "nearly singular":
        z = rng.choice([1.0, -1.0, 0.5], n)
        P = np.eye(n) - np.outer(z, z) / (z @ z)
        K = P @ K @ P
        K = (K + K.T) / 2 + 10.0 ** rng.uniform(-20, -12) * np.diag(rng.uniform(0, 1, n)) * rng.choice([0.0, 1.0])
    if kind in ("friction", "scales") and rng.random() < 0.5:
        K = K + rng.standard_normal((n, n)) * rng.choice([0.1, 1.0, 10.0])
    if kind == "clusters":
        K, M, D = (np.kron(np.eye(2), A) for A in (np.kron(np.eye(n), K[:1, :1]), M, D))
        K[0, 0] *= 1 + 10.0 ** rng.uniform(-16, -6)
    if kind in ("scales", "friction", "nearly singular"):
        M, D, K = (A * 10.0 ** rng.uniform(-20, 20) for A in (M, D, K))
    if kind == "units":
        unit = 10.0 ** rng.uniform(-10, 10, len(M))
        M, D, K = (unit[:, None] * A * unit for A in (M, D * 10.0 ** rng.uniform(-10, 10), K))
        M, D, K = ((A + A.T) / 2 for A in (M, D, K))
    return fs.Pencil(M, D, K)


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    given = pencil(kind, rng)
    try:
        modes = fs.complex_modes(given)
    except fs.FemsubError:
        return "refused"
    with mp.workdps(150):
        exact = exact_eigenvalues(*(mp.matrix(A.tolist()) for A in (given.M, given.D, given.K)))
        if len(exact) != len(modes):
            return modes.evidence if modes.evidence == "not checked" else f"wrong: {len(modes)} of {len(exact)}"
        unit = np.abs(given.K).max(axis=0)
        unit = np.where(unit > 0, unit, 1.0) ** -0.5
        if modes.rigid.any() and np.linalg.cond(given.K * np.outer(unit, unit)) < 1e11:  # in one stiffness of all DOF
            return f"wrong: {np.count_nonzero(modes.rigid)} rigid, but K is regular"
        # of a K that is singular within rounding λ is 0
        fault = misfit(modes.eigenvalues, np.where(modes.rigid, np.inf, modes.error_bar), exact)
    return f"wrong: {fault}" if fault else modes.evidence
