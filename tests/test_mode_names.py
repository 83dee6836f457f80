"""Names of modes against closed forms of thin annuli, and against signs counted on the shapes of a disc with a hat."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import special as sf
from scipy.optimize import brentq

import femsub as fs
from femsub.checks import Array
from femsub.coupling import brake_meshes

IRON = fs.Material(1.1e11, 0.26, 7200.0)
INNER, OUTER, HEIGHT = 0.05, 0.15, 0.005


def roots(rows_at: Callable[[Any], Any], grid: Array) -> list[float]:
    """Where the determinant of rows (4, 4) changes its sign; each column is scaled."""
    def f(x: Any) -> Any:
        A = np.moveaxis(np.array(rows_at(x)), (0, 1), (-2, -1))
        return np.linalg.det(A / np.maximum(np.abs(A).max(axis=-2, keepdims=True), 1e-300))

    values = f(grid)
    at = np.flatnonzero(np.sign(values[1:]) * np.sign(values[:-1]) < 0)
    return [float(brentq(f, grid[i], grid[i + 1])) for i in at]


def bending(n: int, highest: float) -> list[float]:
    """ω of the free thin annulus out of plane: M_r = V_r = 0 at both rims, w = J_n, Y_n, I_n, K_n of kr."""
    nu = IRON.nu
    stiff = IRON.E * HEIGHT**2 / (12 * (1 - nu**2) * IRON.rho)  # ω² = stiff k⁴

    def conditions(k: Any) -> Any:
        rows: list[Any] = []
        for r in (INNER, OUTER):
            x = k * r
            moment, shear = [], []
            for w, sign in ((sf.jvp, -1), (sf.yvp, -1), (sf.ivp, 1), (sf.kvp, 1)):
                f, f1 = w(n, x, 0), k * w(n, x, 1)
                laplacian = sign * k * k * f  # f'' + f'/r - n²f/r²
                moment.append(laplacian - (1 - nu) * (f1 / r - n * n * f / r**2))
                shear.append(sign * k * k * f1 - (1 - nu) * n * n / r**2 * (f1 - f / r))
            rows += [np.array(moment) / k**2, np.array(shear) / k**3]
        return rows

    return [stiff**0.5 * k * k for k in roots(conditions, np.linspace(2.0, (highest / stiff**0.5)**0.5, 400))]


def in_plane(n: int, highest: float) -> list[float]:
    """ω of the free annulus in plane stress: u_r = φ' + nψ/r, u_θ = -nφ/r - ψ', σ_r = τ_rθ = 0 at both rims."""
    nu = IRON.nu
    fast, slow = (IRON.E / IRON.rho / (1 - nu**2))**0.5, (IRON.E / IRON.rho / 2 / (1 + nu))**0.5

    def conditions(omega: Any) -> Any:
        rows: list[Any] = []
        for r in (INNER, OUTER):
            normal, shear = [], []
            for speed, first in ((fast, True), (slow, False)):
                for bessel in (sf.jvp, sf.yvp):
                    k = omega / speed
                    f, f1, f2 = (k**d * bessel(n, k * r, d) for d in range(3))
                    u, u1 = (f1, f2) if first else (n * f / r, n * f1 / r - n * f / r**2)
                    v, v1 = (-n * f / r, -n * f1 / r + n * f / r**2) if first else (-f1, -f2)
                    normal.append(u1 + nu / r * (u + n * v))
                    shear.append(v1 - v / r - n * u / r)
            rows += [normal, shear]
        return rows

    return roots(conditions, np.linspace(2e3, highest, 150))


def signs(f: Array, closed: bool = False) -> int:
    """Changes of sign, without what is small."""
    large = f[np.abs(f) > 0.02 * np.abs(f).max()]
    return int(np.count_nonzero(np.diff(np.sign(np.append(large, large[:closed])))))


def counted(mesh: fs.Mesh, dofs: fs.DofMap, u: Array, motion: str) -> tuple[float, int, int]:
    """The share of u_z², nodal diameters and circles of one component, by the signs at the nodes of the face z = 0.

    Along the outer rim n is half the changes of sign; along the radius at its largest motion they are m.
    """
    moved = fs.displacements(mesh, dofs, u)
    face = np.flatnonzero(np.abs(mesh.points[:, 2]) < 1e-9)
    x, moved = mesh.points[face], moved[face]
    r, angle = np.hypot(x[:, 0], x[:, 1]), np.round(np.arctan2(x[:, 1], x[:, 0]), 6)
    angle[angle < -3.14159] = np.round(np.pi, 6)
    parts = {"in plane, radial": (moved[:, 0] * x[:, 0] + moved[:, 1] * x[:, 1]) / r,
             "in plane, tangential": (moved[:, 1] * x[:, 0] - moved[:, 0] * x[:, 1]) / r, "out of plane": moved[:, 2]}
    energy = {name: float((part**2 * r).sum()) for name, part in parts.items()}
    rim = np.flatnonzero(r > r.max() - 1e-9)
    rim = rim[np.argsort(angle[rim])]
    around = parts[motion][rim]
    line = np.flatnonzero(angle == angle[rim[np.abs(around).argmax()]])
    line = line[np.argsort(r[line])]
    return energy["out of plane"] / sum(energy.values()), signs(around, closed=True) // 2, signs(parts[motion][line])


@cache
def ring(radial: int = 3, around: int = 24) -> tuple[fs.Mesh, fs.Substructure, fs.NormalModes]:
    mesh = fs.annulus(INNER, OUTER, HEIGHT, (radial, around, 1))
    part = fs.solid(mesh, IRON, name="disc")
    return mesh, part, fs.normal_modes(part, count=40)


@pytest.mark.slow
def test_forty_modes_of_an_annulus_have_the_names_of_the_thin_plate() -> None:
    _, part, modes = ring(4, 48)
    names = fs.mode_names(part, modes)
    assert all(name.family == "rigid" for name in names[:6])
    found: dict[tuple[str, int, int], list[float]] = {}
    for name, omega in zip(names[6:], modes.frequencies[6:], strict=True):
        assert name.family == "disc" and name.purity > 0.95
        found.setdefault((name.motion[:3], *name.counts), []).append(float(omega))  # type: ignore[arg-type]
    highest, exact = 1.15 * float(modes.frequencies[-1]), {}
    for n in range(12):
        values = bending(n, highest)
        for m, value in enumerate(values):  # of n = 0 and 1 the first is a rigid motion
            exact["out", n, m + (n < 2)] = value
    for key, values in found.items():
        assert len(values) == (1 if key[1] == 0 else 2) or values[-1] > 0.99 * modes.frequencies[-1]
        if key[0] == "out":  # of a thin plate, whose ω is higher, the more so for short waves
            assert 0.9 * exact[key] < values[0] < 1.02 * exact[key], key
    low = [key for key, value in exact.items() if value < 0.95 * modes.frequencies[-1]]
    assert set(low) <= set(found)
    flat = [(key, values) for key, values in found.items() if key[0] == "in "]
    assert flat  # in-plane modes are there, too, and agree better
    for (_, n, _), values in flat:
        assert np.isclose(np.array(in_plane(n, highest)), values[0], rtol=0.01).any()


def test_names_agree_with_signs_counted_on_the_shape() -> None:
    mesh, part, modes = ring()
    assert part.dofs is not None
    names = fs.mode_names(part, modes)
    for at in range(6, 46):
        out, *counts = counted(mesh, part.dofs, modes.shapes[:, at], names[at].motion)
        assert tuple(counts) == names[at].counts and (out > 0.5) == (names[at].motion == "out of plane"), at


@pytest.mark.slow
def test_forty_modes_of_a_disc_with_a_hat() -> None:
    mesh = brake_meshes(0.025)["disc"]
    part = fs.solid(mesh, IRON, supports=["hub"], name="disc")
    modes = fs.normal_modes(part, count=40)
    assert part.dofs is not None
    for at, name in enumerate(fs.mode_names(part, modes)):
        out, *counts = counted(mesh, part.dofs, modes.shapes[:, at], name.motion)
        assert name.family == "disc" and name.counts == tuple(counts), (at, name, counts)
        # two pairs of one nodal diameter tilt the ring and shift it by nearly as much
        assert (out > 0.5) == (name.motion == "out of plane") or (counts[0] == 1 and abs(out - 0.5) < 0.15), (at, name, out)


def test_a_disc_is_one_in_any_place_and_of_any_mesh() -> None:
    """Turned, shifted, of unlike tetrahedra; a square block and a pad are none."""
    mesh, _, _ = ring()
    turn = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    moved = fs.Mesh(mesh.points @ turn.T * np.linalg.det(turn) + [1.0, 2.0, 3.0], mesh.cells, mesh.kind)
    x, y, z = mesh.points.T
    angle = np.arctan2(y, x) + 0.4 * np.sin(np.arctan2(y, x))  # twice as many nodes on one side
    uneven = fs.Mesh(np.stack([np.hypot(x, y) * np.cos(angle), np.hypot(x, y) * np.sin(angle), z], axis=1), mesh.cells, mesh.kind)
    for one in (moved, uneven, fs.annulus(INNER, OUTER, 0.02, (1, 16, 1), "tetra10")):
        part = fs.solid(one, IRON, name="disc")
        names = fs.mode_names(part, fs.normal_modes(part, count=5))[6:]
        assert [(name.motion, name.counts) for name in names[:2]] == [("out of plane", (2, 0))] * 2
        assert names[2].counts == (0, 1) and names[3].counts == names[4].counts == (3, 0)
    block = fs.solid(fs.block((1.0, 1.0, 0.1), (3, 3, 1)), IRON)
    assert {name.family for name in fs.mode_names(block, fs.normal_modes(block, count=3))} == {"rigid", "plate"}


def test_beams_and_plates_have_half_waves() -> None:
    pinned = fs.beam(1.0, 30, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "pinned", "right": "pinned"})
    assert [name.counts for name in fs.mode_names(pinned, fs.normal_modes(pinned, count=6))] == [(k,) for k in range(1, 7)]
    sides = ("left", "right", "front", "back")
    flat = fs.plate(fs.rectangle((1.0, 0.7), (8, 6)), E=1.0, nu=0.3, rho=1.0, thickness=0.01,
                    supports=dict.fromkeys(sides, "simply supported"))
    modes = fs.normal_modes(flat, count=10)
    order = sorted(((p, q) for p in range(1, 7) for q in range(1, 6)), key=lambda pq: pq[0]**2 + (pq[1] / 0.7)**2)
    assert [name.counts for name in fs.mode_names(flat, modes)] == order[:10]
    bar = fs.solid(fs.block((1.0, 0.1, 0.05), (8, 1, 1)), IRON, supports=["left"])
    kinds = [name.motion for name in fs.mode_names(bar, fs.normal_modes(bar, count=7))]
    assert set(kinds) == {"bending", "torsion", "axial"} and kinds[0] == "bending"


def test_a_part_of_a_system_names_the_mode_and_a_chain_its_mass() -> None:
    parts = {"long": fs.beam(1.0, 10, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"}, interface=["right"]),
             "short": fs.beam(0.5, 6, E=1.0, I=1.0, rho=1.0, A=1.0, interface=["left", "right"])}
    pair = fs.couple(parts, [fs.Spring(("long", "right"), ("short", "left"), stiffness=1e-3, tol=np.inf)])
    full = fs.mode_names(pair, fs.normal_modes(pair, count=6))
    soft = [name for name in full if name.family == "rigid"]
    assert {name.part for name in soft} == {"short"} and "long: bending, 1 half wave" in map(str, full)
    small = fs.reduce(pair, fs.CraigChang(8))
    assert [name.same for name in fs.mode_names(small, fs.normal_modes(small, count=6), full=pair)] == \
        [name.same for name in full]
    chain = fs.chain(4)
    assert str(fs.mode_names(chain, fs.normal_modes(chain, count=1))[0]) == "chain: DOF 3"
    with pytest.raises(fs.InputError, match="full"):
        fs.mode_names(chain, fs.normal_modes(chain, count=1), full=pair)
    with pytest.raises(fs.InputError, match="rows"):
        fs.mode_names(chain, fs.normal_modes(pair, count=1))
