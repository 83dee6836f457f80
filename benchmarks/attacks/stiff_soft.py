"""Normal modes of systems whose stiffnesses differ by nine decades or, of free lumps on soft springs, by twenty, and of free
bodies whose K was written with few digits.
"""

from __future__ import annotations

import mpmath
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, heard

KINDS = ("stiff-soft chains", "random stiff-soft", "written with few digits", "free lumps")
SURE = 1e-7  # relative error of ω² that is allowed in addition to the rounding in K
ROUNDINGS = 20  # changes of each entry by one rounding, see `NormalModes.rounding`
DIGITS = 40  # of mpmath
HOLDS = 1e-3  # ratio of the lowest ω² of a mount to its highest
EXACT = 1e-12  # relative error of ω² that lumps may have beside their rounding
DUST = 4e-15  # share of the energy of the forces that cancel: a smaller energy of a mode is within the rounding of K
LEAST = 1e-14  # share of K: a mount softer than a hundred times this is within the rounding of an assembly


def _chain(rng: Random) -> str:
    """Against the singular values of its bidiagonal factor, which one-sided Jacobi gives to nearly all digits."""
    n, decades = int(rng.integers(3, 150)), rng.choice([0.0, 1.0, 4.0])
    springs = rng.choice([1.0, 1e9], n) if rng.random() < 0.3 else 10.0 ** rng.uniform(0, 9, n)
    masses = 10.0 ** rng.uniform(-decades, decades, n)
    root = np.sqrt(springs)
    B = (np.diag(root) - np.diag(root[1:], -1)) / np.sqrt(masses)
    sva, _, _, work, *_ = la.lapack.dgejsv(B, joba=2, jobu=3, jobv=3)
    exact = np.sort(sva * work[0] / work[1]) ** 2
    sub = fs.chain(n, springs=springs.tolist(), masses=masses.tolist())
    return _compared(sub, exact, rng)


def _random(rng: Random) -> str:
    """Against mpmath: a network of springs to neighbours and to the ground, masses that may be coupled, or blocks."""
    n = int(rng.integers(2, 10))
    ends = rng.integers(0, n, (2, 3 * n))
    lines = np.zeros((3 * n, n))
    lines[np.arange(3 * n), ends[0]] = 1.0
    lines[np.arange(3 * n), ends[1]] -= 1.0 * (ends[0] != ends[1])
    many = rng.random() < 0.7
    springs = 10.0 ** rng.uniform(0, 9, 3 * n) if many else rng.choice([1.0, 1e9], 3 * n) * rng.uniform(0.5, 2, 3 * n)
    K = lines.T @ (springs[:, None] * lines) + np.eye(n)
    M = np.diag(10.0 ** rng.uniform(-1, 1, n))
    if rng.random() < 0.5:
        A = rng.standard_normal((n, n))
        M = M + 0.1 * A @ A.T
    K, M = (K + K.T) / 2, (M + M.T) / 2
    with mpmath.workdps(DIGITS):
        inverse = mpmath.inverse(mpmath.cholesky(mpmath.matrix(M.tolist())))
        reduced = inverse * mpmath.matrix(K.tolist()) * inverse.T
        exact = np.sort(np.array([float(value) for value in mpmath.eigsy((reduced + reduced.T) / 2, eigvals_only=True)]))
    return _compared(fs.Substructure(M, K), exact, rng)


def _compared(sub: fs.Substructure, exact: np.ndarray, rng: Random) -> str:
    count = int(rng.integers(1, sub.size + 1)) if rng.random() < 0.5 else sub.size
    modes, told = _modes(sub, count)
    if modes is None:
        return "refused"
    if modes.rigid:
        return "told" if told else f"wrong: {modes.rigid} rigid modes of a held system, lowest ω² {exact[0]:.3g}"
    if len(modes.eigenvalues) != count:
        return f"wrong: {len(modes.eigenvalues)} modes for {count}"
    return _beyond(modes, exact, SURE, ROUNDINGS) or ("told" if told else modes.evidence)


def _beyond(modes: fs.NormalModes, exact: np.ndarray, sure: float, roundings: float) -> str:
    """The fault in ω² of the elastic modes, a relative error above `sure` plus ROUNDINGS roundings of K; '' if there is none."""
    values, rounding = modes.eigenvalues[modes.rigid:], modes.rounding[modes.rigid:]
    off = np.abs(values / exact[:len(values)] - 1)
    at = int((off / (sure + roundings * rounding)).argmax())
    if off[at] <= sure + roundings * rounding[at]:
        return ""
    return (f"wrong: {modes.evidence}, elastic mode {at + 1} of {len(values)}, ω² {values[at]:.8g} for {exact[at]:.8g}, off by "
            f"{off[at]:.1e}, rounding {rounding[at]:.1e}")


def _lumps(rng: np.random.Generator) -> str:
    """Three chains of 2 to 4 masses in a row on soft springs, free, against mpmath."""
    sizes = rng.integers(2, 5, 3)
    n, stiff = int(sizes.sum()), 10.0 ** rng.uniform(6, 14)
    springs, masses = stiff * rng.uniform(0.5, 2, n - 1), rng.uniform(1, 2, n)
    springs[np.cumsum(sizes)[:2] - 1] = 10.0 ** rng.uniform(-6, 4, 2)
    lines = -np.diff(np.eye(n), axis=0)
    K, M = lines.T @ (springs[:, None] * lines), np.diag(masses)
    with mpmath.workdps(DIGITS):
        root, share = [mpmath.sqrt(one) for one in springs], [1 / mpmath.mpf(one) for one in masses]
        small = mpmath.matrix(n - 1)  # of the springs' forces, whose small ω² have all digits
        for i in range(n - 1):
            small[i, i] = springs[i] * (share[i] + share[i + 1])
            if i:
                small[i, i - 1] = small[i - 1, i] = -root[i] * root[i - 1] * share[i]
        exact = np.sort(np.array([float(value) for value in mpmath.eigsy(small, eigvals_only=True)]))
    modes, told = _modes(fs.Substructure(M, K if rng.random() < 0.5 else sp.csr_array(K)), int(rng.integers(1, n)))
    hidden = exact < DUST * 2 * (np.diag(K) / masses).max()
    if modes is None:
        return "refused, within rounding" if hidden[0] else "refused"
    if modes.rigid != 1:
        return "told" if told else f"{'within rounding' if hidden[modes.rigid - 2] else 'wrong'}: {modes.rigid} rigid modes"
    return _beyond(modes, exact, EXACT, ROUNDINGS) or ("told" if told else modes.evidence)


def _written(rng: Random) -> str:
    """A small block, free or on soft springs, its K with few digits, in single precision, or from a rough assembly."""
    cells = tuple(int(value) for value in rng.integers(1, 5, 3))
    mesh = fs.block(tuple(rng.uniform(0.1, 1.0, 3)), cells, "hexahedron")
    uneven = rng.choice([0.0, 0.02]) * rng.uniform(-1, 1, mesh.points.shape) * 0.1
    full = fs.solid(fs.Mesh(mesh.points + uneven, mesh.cells, mesh.kind, mesh.sets), fs.Material(2.1e11, 0.3, 7850.0))
    K, M = full.K, full.M
    digits, way = int(rng.integers(5, 17)), rng.choice(["digits", "single", "assembly"])
    unit = 10.0 ** (1 - digits) if way == "digits" else 1.2e-7 if way == "single" else 10.0 ** -rng.uniform(8, 16)
    low = np.zeros(0)
    if rng.random() < 0.4:
        springs = 10.0 ** rng.uniform(2, 6) * max(unit, LEAST) * K.diagonal() * (rng.random(full.size) < rng.choice([0.3, 1.0]))
        Z = fs.normal_modes(full, count=1).shapes[:, :6]
        held = la.eigvalsh(Z.T @ (springs[:, None] * Z))
        if springs.max() <= 1e-4 * K.diagonal().max() and held[0] > HOLDS * held[-1]:  # no motion is free, or nearly
            K, low = K + sp.diags_array(springs), held
    elastic = la.eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=[6, 8])
    K = sp.csr_array(sp.triu(K))
    if way == "single":
        K.data = K.data.astype(np.float32).astype(float)
    elif way == "digits":
        K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    else:
        K.data = K.data * (1 + unit * rng.uniform(-1, 1, len(K.data)))
    K = sp.csr_array(K + sp.triu(K, 1).T)
    modes, told = _modes(fs.Substructure(M, K), 9)
    if modes is None:
        return "refused"
    given = modes.eigenvalues[:9] if len(low) else modes.eigenvalues[modes.rigid:][:3]
    wanted = np.append(low, elastic) if len(low) else elastic
    if told:
        return "told"
    if modes.rigid != (0 if len(low) else 6):
        return (f"wrong: {modes.evidence}, {modes.rigid} rigid modes of a {'mounted' if len(low) else 'free'} block, without a "
                f"word, {way} {digits} ({unit:.0e}), ω² {modes.eigenvalues[:7].round(6)}, mount {low.round(6)}")
    off = np.abs(given / wanted - 1).max()
    return modes.evidence if off < 0.1 + 1e3 * unit else f"wrong: ω² {given} for {wanted}, {way} {digits} ({unit:.0e})"


def _modes(sub: fs.Substructure, count: int) -> tuple[fs.NormalModes | None, bool]:
    """The modes, None if they were refused, and whether a warning names lost digits."""
    modes, _, said = heard(fs.normal_modes, sub, count=count)
    return modes, any(isinstance(one, fs.ConditionWarning) for one in said)


@attack("stiff_soft", KINDS)
def attacked(kind: str, rng: Random) -> str:
    """One random case: the evidence, 'told' where a warning names lost digits, 'refused', or what was wrong."""
    return {"stiff-soft chains": _chain, "random stiff-soft": _random, "written with few digits": _written,
            "free lumps": _lumps}[kind](rng)
