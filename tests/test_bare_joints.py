"""DOF with next to no stiffness of their own, as those below a contact, joined to stiff ones: they move with these."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.coupling.assembly import conditions, linked
from femsub.coupling.joints import Joint, Link, site, stacked
from femsub.model import bare

STIFF = 1e7
DUST = [6e-28, 1e-13, 1e-6, 1e20]  # stiffness of the DOF that is joined to springs of 1e7
COEFFICIENTS = [1.0, -1.0, 2.0, 0.5, 1e-2, 30.0]


def parts_of(stiffness: float) -> dict[str, fs.Substructure]:
    """Two stiff chains, and a part with a DOF without mass, of some stiffness, beside an oscillator."""
    soft = fs.Substructure(np.diag([0.0, 1.0]), np.diag([stiffness, 0.3 * STIFF]), interface=[0], ports={"pin": [1.0, 0.0]})
    chain = fs.chain(4, springs=STIFF, interface=[4], damping=0.0)
    return {"a": chain, "soft": soft, "b": chain}


def plain(parts: Mapping[str, fs.Substructure], names: tuple[str, ...], ends: Mapping[str, int]) -> np.ndarray:
    """ω² of the parts with one DOF in common, by LAPACK on the sum of their matrices."""
    size = sum(parts[name].size - 1 for name in names) + 1
    M, K, at = np.zeros((size, size)), np.zeros((size, size)), 1
    for name in names:
        rows = np.zeros(parts[name].size, dtype=int)
        others = np.arange(parts[name].size) != ends[name]
        rows[others] = at + np.arange(others.sum())
        at += others.sum()
        M[np.ix_(rows, rows)] += sp.csr_array(parts[name].M).toarray()
        K[np.ix_(rows, rows)] += sp.csr_array(parts[name].K).toarray()
    return la.eigh(K, M, eigvals_only=True)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("stiffness", DUST)
@pytest.mark.parametrize("assembly", ["primal", "dual"])
@pytest.mark.parametrize("names", [("a", "soft"), ("soft", "a"), ("a", "soft", "b"), ("soft", "b", "a")])
def test_equal_dof_stay_equal_whatever_their_stiffness(names: tuple[str, ...], assembly: str, stiffness: float) -> None:
    parts, ends = parts_of(stiffness), {"a": 3, "soft": 0, "b": 3}
    joints = [fs.Rigid((one, [ends[one]]), (other, [ends[other]])) for one, other in pairwise(names)]
    system = fs.couple({name: parts[name] for name in names}, joints, assembly=assembly)
    expected = np.sqrt(plain(parts, names, ends))
    count = len(expected) if stiffness < STIFF else len(expected) - 1  # DOF on a stiff spring hardly move
    found = fs.complex_modes(system).eigenvalues.imag
    np.testing.assert_allclose(np.sort(found[found > 0])[:count], expected[:count], rtol=1e-7)
    if assembly == "primal":
        at = {name: u[ends[name]] for name, u in system.expand(np.eye(system.size)).items()}
        assert all((u == at["soft"]).all() and u.any() for u in at.values())
        np.testing.assert_array_equal(system.ports["soft.pin"], at["soft"])


class Sum(Joint):
    """Σ coefficient × DOF = 0."""

    def __init__(self, ends: list[tuple[str, int]], coefficients: list[float]) -> None:
        self.ends, self.coefficients = ends, coefficients

    def link(self, parts: Mapping[str, fs.Substructure]) -> Link:
        terms = zip(self.ends, self.coefficients, strict=True)
        return Link(equations=stacked(tuple((part, site(parts, (part, [row])).chosen(c)) for (part, row), c in terms)))


def random_system(seed: int) -> tuple[dict[str, fs.Substructure], list[Joint]]:
    """Parts whose DOF differ by up to 38 decades in stiffness, joined one to one, and by sums."""
    rng = np.random.default_rng(seed)
    decades = [(-28, 10), (0, 20), (5, 9), (-10, 10)][rng.integers(4)]
    parts: dict[str, fs.Substructure] = {}
    for name in "abcd"[:int(rng.integers(2, 5))]:
        n = int(rng.integers(2, 5))
        root = np.sqrt(10.0 ** rng.uniform(*decades, n))
        C = np.corrcoef(rng.standard_normal((n, 3 * n)))
        M, K = np.diag(10.0 ** rng.uniform(-3, 3, n)), C * np.outer(root, root)
        if rng.random() < 0.5:
            M[0, 0], K[0], K[:, 0] = 0.0, 0.0, 0.0
            K[0, 0] = rng.choice([0.0, 6e-28])
        parts[name] = fs.Substructure(M, K, interface=range(n), ports={"port": np.eye(n)[rng.integers(n)]})
    names, joints = list(parts), []
    for one, other in pairwise(names):
        count = int(rng.integers(1, min(parts[one].size, parts[other].size) + 1))
        joints.append(fs.Rigid(*((name, rng.permutation(parts[name].size)[:count].tolist()) for name in (one, other))))
    dofs = [(name, row) for name in names for row in range(parts[name].size)]
    for _ in range(int(rng.integers(3))):
        chosen = rng.permutation(len(dofs))[:int(rng.integers(2, 4))]
        joints.append(Sum([dofs[k] for k in chosen], rng.choice(COEFFICIENTS, len(chosen)).tolist()))
    return parts, joints


def exact_rank(rows: np.ndarray) -> int:
    """By elimination in fractions."""
    A, rank = [[Fraction(entry) for entry in row] for row in rows.tolist()], 0
    for column in range(rows.shape[1]):
        pivot = next((at for at in range(rank, len(A)) if A[at][column]), None)
        if pivot is not None:
            A[rank], A[pivot] = A[pivot], A[rank]
            for at in range(rank + 1, len(A)):
                factor = A[at][column] / A[rank][column]
                A[at] = [a - factor * b for a, b in zip(A[at], A[rank], strict=True)]
            rank += 1
    return rank


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(60))
def test_all_motions_that_the_joints_allow_are_there(seed: int) -> None:
    parts, joints = random_system(seed)
    C = conditions(parts, [linked(joint, parts) for joint in joints])[0].toarray()
    rank, size = exact_rank(C), C.shape[1]
    moving = np.array([exact_rank(np.vstack([C, row])) > rank for row in np.eye(size)])
    if not (moving & (la.block_diag(*(part.M for part in parts.values())).diagonal() > 0)).any():
        with pytest.raises(fs.InputError):
            fs.couple(parts, joints)
        return
    system = fs.couple(parts, joints)
    L = system.L
    assert L.shape == (size, size - rank)
    assert (np.abs(C @ L) <= 1e-9 * np.abs(C).max(axis=1, keepdims=True) * np.abs(L).max(axis=0)).all()
    assert la.svdvals(L / np.linalg.norm(L, axis=0)).min() > 1e-7
    assert (L[moving].any(axis=1)).all()
    start = 0
    for name, part in parts.items():
        w = L[start:start + part.size].T @ part.port("port")
        np.testing.assert_allclose(system.port(f"{name}.port"), w, atol=1e-12 * np.abs(L).max())
        assert system.port(f"{name}.port").any() == w.any()
        start += part.size


@pytest.mark.parametrize(("row", "expected"), [([1e-12, 0.0], True), ([1e-12, 1e-40], True), ([1e-12, -1e-30], True),
                                               ([-1e-12, 1e-12], False), ([0.0, 1e-28], False), ([0.0, 0.0], True),
                                               ([1.0, 0.0], False), ([1e-18, 1e-27], False)])
def test_bare_is_what_no_stiffness_is(row: list[float], expected: bool) -> None:
    """A soft spring is a spring, however soft; and a multiplier, whose row is 1, is no rounding beside 1e9."""
    assert bare(np.array([[1e9, row[0]], row])).tolist() == [False, expected]


@pytest.fixture(scope="module", params=["lost", "kept", "none"])
def pressed(request: pytest.FixtureRequest) -> tuple[dict[str, fs.Substructure], fs.Substructure]:
    """A slab in two pieces, a pad on both with the DOF of the slab below it, and the whole of them.

    Normals that are tilted by rounding leave dust on the tangential DOF. Its diagonal is lost where the contact is K of the whole
    less K of the parts.
    """
    steel = {"material": fs.Material(2.1e11, 0.3, 7850.0)}
    slab, block = fs.block((0.4, 0.1, 0.02), (8, 2, 1), "hexahedron"), fs.block((0.1, 0.1, 0.03), (2, 2, 1), "hexahedron")
    upper = fs.Mesh(block.points + np.array([0.15, 0.0, 0.02]), block.cells, block.kind)
    cut, base, pad = fs.cut(slab, fs.solid, into=2, supports=["left"], **steel), *(
        fs.solid(mesh, **steel, **more) for mesh, more in ((slab, {"supports": ["left"]}), (upper, {})))
    n, N, tilt = base.size, base.size + pad.size, 0.0 if request.param == "none" else 1e-18
    rng, spots = np.random.default_rng(1), {tuple(spot): row for row, spot in zip(range(0, n, 3), _spots(base), strict=True)}
    contact = sp.lil_array((N, N))
    for row, spot in zip(range(n, N, 3), _spots(pad), strict=True):
        if tuple(spot) in spots:
            rows = np.append(spots[tuple(spot)] + np.arange(3), row + np.arange(3))
            normal = np.append(tilt * rng.standard_normal(2), 1.0)
            gap = np.append(normal, -normal)
            contact[np.ix_(rows, rows)] += 1e7 * np.outer(gap, gap)
    contact = sp.csr_array(contact)
    M, K = (sp.block_diag([A, B], format="csr") for A, B in ((base.M, pad.M), (base.K, pad.K)))
    if request.param == "lost":
        contact -= sp.diags_array(np.where(contact.diagonal() < 1.0, contact.diagonal(), 0.0))
    below = np.setdiff1d(np.unique(contact.indices), np.arange(n, N))
    below = np.unique(below // 3 * 3) + np.arange(3)[:, None]
    rows = dict(cut.rows) | {"pad": np.append(np.sort(below.ravel()), np.arange(n, N))}
    matrices = {name: (part.M, part.K) for name, part in cut.parts.items()}
    own = N - n
    bare_rows = sp.csr_array((below.size, below.size))
    matrices["pad"] = (sp.block_diag([bare_rows, pad.M], format="csr"),
                       sp.block_diag([bare_rows, pad.K], format="csr") + contact[rows["pad"]][:, rows["pad"]])
    assert matrices["pad"][0].shape[0] == below.size + own
    top = np.sort((3 * np.flatnonzero(_spots(pad)[:, 2] == 0.05) + np.arange(3)[:, None]).ravel()) + n
    return sharing(rows, matrices, top, N), fs.Substructure(M, K + contact, interface=top)


def sharing(rows: dict[str, np.ndarray], matrices: dict[str, tuple[Any, Any]], open_: np.ndarray, size: int,
            ) -> dict[str, fs.Substructure]:
    """Parts whose DOF are these rows of a model. Interface sets are what some of them share, as 'p1+p2', and the open 'joint'."""
    names = list(rows)
    member = np.stack([np.isin(np.arange(size), rows[name]) for name in names], axis=1)
    parts = {}
    for name in names:
        sets: dict[str, list[int]] = {}
        for place in np.flatnonzero(member[rows[name]].sum(axis=1) > 1):
            key = "+".join(np.array(names)[member[rows[name][place]]])
            sets.setdefault(key, []).append(int(place))
        joint = np.flatnonzero(np.isin(rows[name], open_))
        given = {key: np.array(places) for key, places in sets.items()} | ({"joint": joint} if len(joint) else {})
        parts[name] = fs.Substructure(*matrices[name], interface=given, name=name)
    return parts


def _spots(sub: fs.Substructure) -> np.ndarray:
    """The places of nodes with three DOF each."""
    assert sub.dofs is not None and sub.dofs.points is not None
    return sub.dofs.points[::3].round(9)


def test_a_contact_leaves_bare_dof_to_its_part(pressed: tuple[dict[str, fs.Substructure], fs.Substructure]) -> None:
    pad = pressed[0]["pad"]
    small = fs.reduce(pad, fs.CraigBampton(len(pad.interior)))
    stiffness = np.abs(small.K[:18]).max(axis=1)
    assert np.count_nonzero(stiffness < 1e-6) == 12 and np.count_nonzero(stiffness > 1e5) == 6


def test_parts_with_bare_dof_are_the_whole(pressed: tuple[dict[str, fs.Substructure], fs.Substructure], tmp_path: Path) -> None:
    parts, whole = pressed
    levels = fs.reduce_by_levels({name: partial(_given, part) for name, part in parts.items()}, fs.CraigBampton(cutoff=3e5),
                                 tmp_path)
    found, bounds = fs.normal_modes(whole, 8), levels.bounds(5)
    omega = found.frequencies[found.rigid:][:5]
    assert bounds.rigid == found.rigid == 3
    assert (bounds.lower <= omega * (1 + 1e-9)).all() and (omega <= bounds.upper * (1 + 1e-9)).all()
    assert bounds.error.max() < 0.05


def _given(part: fs.Substructure) -> fs.Substructure:
    return part
