"""Components of about a wanted number of DOF, for `scaling`, and what their frequencies must be.

The chain has unit masses and springs and a dashpot; the others are of steel, in m, kg and s, without damping. Their belt
takes so little (damping ratios of about 1e-6) that it moves no frequency by more than 1e-12.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import femsub as fs

DAMPING = 0.1  # of the chain
STEEL: dict[str, Any] = {"E": 2.1e11, "rho": 7850.0}
NU = 0.3
LENGTH, SIDE = 1.0, 0.02  # of the beam, which is square
SIDES, THICKNESS = (1.0, 0.8), 0.005  # of the plate
SLAB, NODES = (2.0, 1.5, 0.1), 33  # of the solid; nodes of its interface
REFERENCE = 100_000  # up to so many DOF the solid's reduced models are compared with its own modes


@dataclass(frozen=True)
class Kind:
    """The sizes measured, the most that make sense, the modes kept, and how many frequencies are compared."""

    sizes: tuple[int, ...]
    modes: int
    compared: int
    slope: float
    rigid: int = 0
    most: float = np.inf
    pep: float = np.inf  # up to so many DOF the full CEA is solved unless asked for


KINDS = {
    "chain": Kind((10, 100, 1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), 20, 20, 0.0),
    # The condition of K grows with n⁴; at 2·10⁴ DOF rounding alone moves the lowest ω by 10 % in the full model's PEP.
    "beam": Kind((10, 100, 1_000, 10_000, 20_000), 20, 5, 3e-4, most=20_000),
    "plate": Kind((80, 1_000, 10_000, 30_000, 100_000, 300_000), 20, 5, 6e-3, most=300_000),
    "solid": Kind((1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), 50, 10, 2.0, rigid=6, pep=300_000),
}


def build(kind: str, n: int) -> fs.Substructure:
    """The component of about n DOF, from its mesh on; its interface does not grow with n."""
    return {"chain": chain, "beam": beam, "plate": plate, "solid": solid}[kind](n)


def chain(n: int) -> fs.Substructure:
    """Belt under m2, which is not in the interface {m1}, as in the paper."""
    return fs.chain(n, belt=2, damping=DAMPING)


def beam(n: int) -> fs.Substructure:
    """Clamped at the left, joined at the right (2 DOF), a belt at 0.35 L."""
    elements = n // 2
    return fs.beam(LENGTH, elements, E=STEEL["E"], I=SIDE**4 / 12, rho=STEEL["rho"], A=SIDE**2, supports={"left": "clamped"},
                   interface=["right"], ports={"belt": np.linspace(0, LENGTH, elements + 1)[round(0.35 * elements)]})


def plate(n: int) -> fs.Substructure:
    """Simply supported all round, Bogner-Fox-Schmit rectangles (4 nx ny DOF); joined at 3 nodes (12 DOF), a belt at one."""
    nx = round((n / 4 * SIDES[0] / SIDES[1]) ** 0.5)
    ny = round(nx * SIDES[1] / SIDES[0])
    mesh = fs.rectangle(SIDES, (nx, ny))

    def node(x: float, y: float) -> int:
        return round(x * nx) * (ny + 1) + round(y * ny)

    mesh = mesh.with_sets(joint=np.array([node(0.6, share) for share in (0.25, 0.5, 0.75)]))
    return fs.plate(mesh, **STEEL, nu=NU, thickness=THICKNESS, supports={"edge": "simply supported"}, interface=["joint"],
                    ports={"belt": tuple(mesh.points[node(0.35, 0.4)])})


def solid(n: int) -> fs.Substructure:
    """A floating slab of bricks with 8 nodes, joined at 33 nodes of its left face (99 DOF), a belt along its right face."""
    size = np.linspace(0.5, 20, 4000)[:, None] * [20, 15, 1]
    counts = np.maximum(1, size.round()).astype(int)
    chosen = counts[np.abs(np.log(3 * np.prod(counts + 1, axis=1) / n)).argmin()]
    mesh = fs.block(SLAB, [int(count) for count in chosen], "hexahedron")
    left = mesh.nodes("left")
    mesh = mesh.with_sets(joint=left[np.linspace(0, len(left) - 1, min(NODES, len(left))).astype(int)])
    return fs.solid(mesh, fs.Material(STEEL["E"], NU, STEEL["rho"]), interface=["joint"], ports={"belt": ("right", "y")})


def lowest(kind: str, n: int) -> np.ndarray | None:
    """The exact ω of the beam, k⁴ EI/ρA = ω² with cos kL cosh kL = -1, and of the plate; None where there are none."""
    count = KINDS[kind].compared
    if kind == "beam":
        roots = np.pi * (np.arange(1, count + 1) - 0.5)
        for _ in range(50):  # cos x = -1/cosh x, from the zeros of the cosine
            roots -= (np.cos(roots) + 1 / np.cosh(roots)) / (-np.sin(roots) - np.tanh(roots) / np.cosh(roots))
        return (roots / LENGTH) ** 2 * (STEEL["E"] * SIDE**2 / 12 / STEEL["rho"]) ** 0.5
    if kind == "plate":
        waves = [np.arange(1, 20) / side for side in SIDES]
        bending = STEEL["E"] * THICKNESS**2 / (12 * (1 - NU**2) * STEEL["rho"])
        return np.sort(np.pi**2 * np.add.outer(waves[0] ** 2, waves[1] ** 2).ravel() * bending**0.5)[:count]
    if kind == "chain" or n >= REFERENCE:  # the chain's are known in closed form for any size
        return None
    modes = fs.normal_modes(build(kind, n), count=count)
    return modes.frequencies[modes.rigid:]


def slope(kind: str, n: int) -> float:
    """The belt's slope; of the chain about half of the one at which a mode loses its stability.

    First order in the damping: mode j moves m_k by sin(kθ_j), θ_j = (2j - 1)π/(2n + 1), and decays while
    d1 sin²θ_j + c sin²2θ_j > 0, that is c > -d1/(4 cos²θ_j). At n = 10⁴ the exact value agrees to 6e-11.
    """
    return -DAMPING / (4 * np.cos(np.pi / (2 * n + 1)) ** 2) / 2 if kind == "chain" else KINDS[kind].slope
