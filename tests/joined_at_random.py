"""Small joined systems made at random, and what they must give: the eigenvalues of the directly assembled matrices.

    PYTHONPATH=. python tests/joined_at_random.py [FIRST LAST]

For each seed the parts are complete by each method (or full, one in five), and joined at once and in two steps: the complex
eigenvalues with and without a belt, the critical slope and the number of rigid-body modes must be those of the matrices.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

import femsub as fs
from femsub.reduction.reduce import METHODS

CLOSE = 1e-8  # relative difference of eigenvalues
RIGID = 1e-4  # share of the largest |λ| below which one is that of rigid motion: a double zero knows half the digits
SLOPE = -0.3  # of the belt


@dataclass
class Model:
    """Parts, joints, and the directly assembled matrices of all parts with the joints' equations C u = 0."""

    parts: dict[str, fs.Substructure] = field(default_factory=dict)
    joints: list[fs.Rigid | fs.Spring] = field(default_factory=list)
    rows: list[np.ndarray] = field(default_factory=list)
    springs: list[tuple[float, np.ndarray]] = field(default_factory=list)

    def place(self, part: str, dof: int) -> np.ndarray:
        """The row that picks a DOF of a part out of all."""
        sizes = {name: one.size for name, one in self.parts.items()}
        row = np.zeros(sum(sizes.values()))
        row[sum(size for name, size in list(sizes.items())[:list(sizes).index(part)]) + dof] = 1.0
        return row

    def rigid(self, *ends: tuple[str, int]) -> None:
        self.joints.append(fs.Rigid(*((part, f"d{dof}") for part, dof in ends), name=f"r{len(self.joints)}"))
        self.rows += [self.place(*ends[0]) - self.place(*end) for end in ends[1:]]

    def ground(self, part: str, dof: int) -> None:
        self.joints.append(fs.Rigid((part, f"d{dof}"), "ground", name=f"g{len(self.joints)}"))
        self.rows.append(self.place(part, dof))

    def spring(self, one: tuple[str, int], other: tuple[str, int], stiffness: float) -> None:
        ends = ((part, f"d{dof}") for part, dof in (one, other))
        self.joints.append(fs.Spring(*ends, stiffness=stiffness, name=f"s{len(self.joints)}"))
        self.springs.append((stiffness, self.place(*one) - self.place(*other)))

    def direct(self) -> tuple[np.ndarray, ...]:
        """M, D, K and the belt's column in a basis of C u = 0, the motions without mass condensed; None if these are soft."""
        M, D, K = (la.block_diag(*(dense(getattr(part, key)) for part in self.parts.values())) for key in "MDK")
        K = K + sum(k * np.outer(row, row) for k, row in self.springs)
        Q = la.null_space(np.array(self.rows), rcond=1e-10) if self.rows else np.eye(len(M))
        w = np.concatenate([part.port("belt").ravel() if name == "p0" else np.zeros(part.size)
                            for name, part in self.parts.items()])
        M, D, K, w = Q.T @ M @ Q, Q.T @ D @ Q, Q.T @ K @ Q, Q.T @ w
        mass, turn = np.linalg.eigh(M)
        moving, bare = turn[:, mass > 1e-12 * mass[-1]], turn[:, mass <= 1e-12 * mass[-1]]
        soft = bare.T @ K @ bare
        if not moving.shape[1] or (len(soft) and np.linalg.cond(soft) > 1e8):
            return ()
        T = moving - bare @ np.linalg.solve(soft, bare.T @ K @ moving)
        return T.T @ M @ T, T.T @ D @ T, T.T @ K @ T, T.T @ w * (np.linalg.norm(w) > 1e-12)


def dense(A: object) -> np.ndarray:
    return A.toarray() if hasattr(A, "toarray") else np.asarray(A)


def part(rng: np.random.Generator, name: str) -> fs.Substructure:
    """Masses on springs, of one or two pieces, held or floating; at times with massless DOF, which have no damper either."""
    n = int(rng.choice([2, 3, 4, 6, 8]))
    K, C, mass = np.zeros((n, n)), np.zeros((n, n)), rng.uniform(0.5, 2.0, n)
    if rng.random() < 0.3 and n > 2:
        mass[rng.choice(n, n // 3, replace=False)] = 0.0
    piece = rng.integers(0, int(rng.choice([1, 1, 2])), n)
    for label in set(piece):
        own = np.flatnonzero(piece == label)
        mass[own[0]] = mass[own[0]] or 1.0
        pairs = [(own[j], own[rng.integers(0, j)]) for j in range(1, len(own))]
        for a, b in pairs + [tuple(rng.choice(own, 2, replace=False)) for _ in range(len(own) // 3)]:
            link = np.eye(n)[a] - np.eye(n)[b]
            K += rng.uniform(0.5, 2.0) * np.outer(link, link)
            C += (mass[a] > 0) * (mass[b] > 0) * rng.uniform(0.01, 0.05) * np.outer(link, link)
        if rng.random() < 0.4:
            K[own[0], own[0]] += rng.uniform(0.5, 2.0)
    interface = rng.permutation(n)[:int(rng.integers(1, n + 1))]
    return fs.Substructure(np.diag(mass), K, C + 0.02 * np.diag(mass), {f"d{dof}": [dof] for dof in interface.tolist()},
                           ports={"belt": np.eye(n)[rng.choice(np.flatnonzero(mass))]}, name=name)


def model(seed: int) -> Model:
    """Two to five parts in a tree of rigid joints and springs, with joints beside, cross points, repeats and the ground."""
    rng = np.random.default_rng(seed)
    made = Model({f"p{i}": part(rng, f"p{i}") for i in range(int(rng.integers(2, 6)))})
    names = list(made.parts)

    def ends(count: int, *parts: str) -> list[list[tuple[str, int]]]:
        count = min(count, *(len(made.parts[name].interface) for name in parts))
        chosen = [[(name, int(dof)) for dof in rng.permutation(made.parts[name].interface)[:count]] for name in parts]
        return [list(pair) for pair in zip(*chosen, strict=True)]

    for i in range(1, len(names)):
        pair = names[i], names[int(rng.integers(0, i))]
        for one, other in ends(int(rng.integers(1, 4)), *pair):
            made.rigid(one, other) if rng.random() < 0.75 else made.spring(one, other, rng.uniform(0.5, 2.0))
    if rng.random() < 0.5:
        one, other = ends(1, *rng.choice(names, 2, replace=False))[0]
        made.spring(one, other, 1.5) if rng.random() < 0.5 else made.rigid(one, other)
    if len(names) > 3 and rng.random() < 0.5:  # never both of the first two, which may be one in a system of their own
        made.rigid(*ends(1, *rng.permutation(names[1:])[:3])[0])
    if rng.random() < 0.3:
        made.ground(*ends(1, names[-1])[0][0])
    return made


def complete(sub: fs.Substructure, key: str) -> fs.Substructure:
    """The part with all modes of a method; the part itself where the method has none for it."""
    method = METHODS[key]
    mass = sub.M.diagonal()
    if (key == "guyan" and not mass[sub.interior].all()) or not sub.K.diagonal()[mass > 0].any():
        return sub
    if key == "guyan":
        modes = len(sub.interior)
    elif method.held and (key != "herting" or not len(sub.interior)):
        modes = int(np.count_nonzero(mass[sub.interior]))
    else:
        modes = int(np.count_nonzero(mass)) - fs.normal_modes(sub, count=0).rigid
    try:
        return fs.reduce(sub, method(modes), ports=True)
    except (fs.InputError, fs.SingularMatrixError) as error:
        if "does not hold" in str(error) or "can vibrate" in str(error):
            return sub
        raise


def joined(made: Model, parts: dict[str, fs.Substructure], nested: bool) -> fs.Substructure:
    """The parts joined at once, or the first two before the others, where joints lead from one to the other."""
    own = [joint for joint in made.joints if {end[0] for end in ends_of(joint)} <= {"p0", "p1"}]
    if not nested or len(parts) == 2 or not any(len({end[0] for end in ends_of(joint)}) == 2 for joint in own):
        return fs.couple(parts, made.joints)
    rest = [joint for joint in made.joints if joint not in own]
    open_ = dict.fromkeys(end for joint in rest for end in ends_of(joint) if end[0] in ("p0", "p1"))
    front = fs.couple({name: parts[name] for name in ("p0", "p1")}, own, interface=list(open_))
    return fs.couple({"front": front} | {name: one for name, one in parts.items() if name not in ("p0", "p1")},
                     [moved(joint) for joint in rest])


def ends_of(joint: fs.Rigid | fs.Spring) -> list[tuple[str, str]]:
    ends = joint.ends if isinstance(joint, fs.Rigid) else (joint.first, joint.second)
    return [end for end in ends if end != "ground"]


def moved(joint: fs.Rigid | fs.Spring) -> fs.Rigid | fs.Spring:
    """The joint with the ends of the first two parts as those of the system of both."""
    ends = [("front", f"{part}.{name}") if part in ("p0", "p1") else (part, name) for part, name in ends_of(joint)]
    if isinstance(joint, fs.Spring):
        return fs.Spring(*ends, stiffness=joint.stiffness, name=joint.name)
    return fs.Rigid(*ends, *(["ground"] if len(ends) < len(joint.ends) else []), name=joint.name)


def eigenvalues(M: np.ndarray, D: np.ndarray, K: np.ndarray) -> np.ndarray:
    """λ of λ²M + λD + K with a regular M, shape (2n,)."""
    n = len(M)
    return la.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]]), la.block_diag(np.eye(n), M), right=False)


def apart(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest relative distance of matched eigenvalues, without those of rigid motion; inf if their numbers differ."""
    found, exact = (x[np.abs(x) > RIGID * np.abs(exact).max()] for x in (found, exact))
    if len(found) != len(exact):
        return np.inf
    distance = np.abs(found[:, None] - exact) / np.abs(exact)
    rows, columns = linear_sum_assignment(distance)
    return float(distance[rows, columns].max(initial=0.0))


def regular(system: fs.Substructure) -> bool:
    return bool(np.linalg.cond(dense(system.M)) < 1e12)


def findings(seed: int, keys: list[str]) -> list[str]:
    """What is wrong with a model in which all parts, or some of them, are complete by a method; nothing if all is well."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return list(_findings(seed, keys))


def _findings(seed: int, keys: list[str]) -> Iterator[str]:
    made = model(seed)
    direct = made.direct()
    if not direct:
        return
    M, D, K, w = direct
    exact, under = eigenvalues(M, D, K), eigenvalues(M, D + SLOPE * np.outer(w, w), K)
    rigid = int(np.count_nonzero(np.linalg.eigvalsh(K) < 1e-10))
    slope = None if rigid else float(fs.critical_slope(fs.Substructure(M, K, D, ports={"belt": w})))
    rng = np.random.default_rng(seed)
    for key in keys:
        parts = {name: complete(one, key) if rng.random() < 0.8 else one for name, one in made.parts.items()}
        for nested in (False, True):
            what = f"seed {seed}, {key}{', nested' * nested}"
            try:
                system = joined(made, parts, nested)
                port = next(name for name in system.ports if name.endswith("p0.belt"))
                alone, belt = (fs.complex_modes(system, belt) for belt in (None, fs.Belt(port, slope=SLOPE)))
                count = fs.normal_modes(system, count=0).rigid
                own = slope if rigid or not regular(system) else float(fs.critical_slope(system, port))
            except fs.FemsubError as error:
                yield f"{what}: {type(error).__name__}: {error}"
                continue
            for modes, values, name in ((alone, exact, "eigenvalues"), (belt, under, "eigenvalues under the belt")):
                far = apart(modes.eigenvalues, values)
                if far > CLOSE:
                    yield f"{what}: {name} off by {far:.1e} ({len(modes.eigenvalues)} of {len(values)})"
            if count != rigid:
                yield f"{what}: {count} rigid-body modes of {rigid}"
            if slope is not None and not np.isclose(own, slope, rtol=CLOSE, atol=0.0):
                yield f"{what}: critical slope {own:.10g}, not {slope:.10g}"


if __name__ == "__main__":
    first, last = map(int, sys.argv[1:3]) if len(sys.argv) > 2 else (0, 300)
    every = [finding for seed in range(first, last) for finding in findings(seed, sorted(METHODS))]
    print(*every, f"{len(every)} findings", sep="\n")
    sys.exit(bool(every))
