"""Components on which estimates are checked against full solutions: chains, beams, plates, solids, held and floating.

Each is small enough for all of its eigenvalues to be had by LAPACK. tests/test_tolerance.py takes the quick ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane
from femsub.model.bands import moving, upper
from femsub.reduction.basis import Partition, Statics

STEEL: dict[str, Any] = {"E": 2.1e11, "rho": 7850.0}


@dataclass(frozen=True)
class Problem:
    """A component, the belts on it, and a band that ends in the gap behind the mode number `wanted`."""

    name: str
    make: Callable[[], fs.Substructure]
    wanted: int = 8
    slope: float | None = None  # of the belt; None: the model's own damping
    ports: bool = False
    quick: bool = False
    hcb: bool = True  # the interface holds the component

    @cached_property
    def sub(self) -> fs.Substructure:
        return self.make()

    @property
    def belt(self) -> fs.Belt | None:
        return None if self.slope is None else fs.Belt(slope=self.slope)

    @property
    def kinds(self) -> list[type]:
        return [fs.CraigBampton, fs.CraigChang] if self.hcb else [fs.CraigChang]

    @cached_property
    def omega(self) -> np.ndarray:
        """All elastic frequencies of the full model."""
        modes = fs.normal_modes(self.sub, band=(0.0, self.band[1]))
        return modes.frequencies[modes.rigid:]

    @cached_property
    def band(self) -> tuple[float, float]:
        modes = fs.normal_modes(self.sub, count=self.wanted + 3)
        elastic = modes.frequencies[modes.rigid:]
        gap = self.wanted - 1 + int(np.argmax(elastic[self.wanted:] / elastic[self.wanted - 1:-1]))
        return 0.0, float(np.sqrt(elastic[gap] * elastic[gap + 1]))

    @cached_property
    def eigenvalues(self) -> np.ndarray:
        """All λ of the full model with Im λ ≥ 0, without rigid-body modes, by |λ|; none where it is not damped."""
        pencil = self.sub.linearised(self.belt)
        return positive(pencil) if pencil.norms[1] > 0 else np.zeros(0, dtype=complex)


def positive(pencil: fs.Pencil) -> np.ndarray:
    """All λ with Im λ ≥ 0 of a pencil in ascending |λ|, those left out that are 0 for rigid motion, or 0 by rounding."""
    found = fs.complex_modes(pencil.dense())
    values = found.eigenvalues[~found.rigid & upper(found.eigenvalues) & moving(found.eigenvalues, found.error_bar)]
    return values[np.argsort(np.abs(values), kind="stable")]


def uneven(n: int, spread: float, **options: object) -> fs.Substructure:
    """A chain whose masses and springs are scattered by e^{±spread}."""
    rng = np.random.default_rng(n)
    masses, springs = np.exp(spread * rng.uniform(-1, 1, (2, n)))
    return fs.chain(n, masses=masses, springs=springs, **options)  # type: ignore[arg-type]


def stiff() -> fs.Substructure:
    """Springs of 1 and 1e6 by turns of five."""
    springs = np.where(np.arange(60) // 5 % 2 == 0, 1.0, 1e6)
    return fs.chain(60, belt=7, springs=springs, interface=(1, 30))


def turning(sub: fs.Substructure, share: float) -> fs.Substructure:
    """The same with a gyroscopic part and one that is neither symmetric nor skew in D, in each DOF's own units."""
    rng = np.random.default_rng(5)
    A = sp.random_array(sub.K.shape, density=1.5 / sub.size, rng=rng, format="csr")
    unit = sp.diags_array((sub.K.diagonal() * sub.M.diagonal()) ** 0.25)
    return sub.with_damping(sub.D + share * (unit @ (A - A.T + 0.3 * abs(A)) @ unit))


def beam(free: bool = False, **options: object) -> fs.Substructure:
    nodes = np.linspace(0, 1.0, 41)
    supports, joints = ({}, ["left", "right"]) if free else ({"left": "clamped"}, ["right"])
    return fs.beam(1.0, 40, **STEEL, I=1e-4**2 / 12, A=1e-4, supports=supports, interface=joints, ports={"belt": nodes[14]},
                   **options)  # type: ignore[arg-type]


def plate(cells: int = 8, edge: bool = True, triangles: bool = False) -> fs.Substructure:
    """A square, simply supported all round (repeated frequencies), or floating."""
    mesh = fs.rectangle((0.5, 0.5), (cells, cells), "triangle" if triangles else "quad")

    def node(x: int, y: int) -> int:
        return x * (cells + 1) + y

    corners = [node(0, 0), node(cells, 0), node(cells, cells)]
    joint = [node(cells // 2, cells // 4), node(cells // 4, cells // 2)] if edge else corners
    mesh = mesh.with_sets(joint=np.array(joint))
    return fs.plate(mesh, **STEEL, nu=0.3, thickness=2e-3, supports={"edge": "simply supported"} if edge else {},
                    interface=["joint"], ports={"belt": tuple(mesh.points[node(cells // 2, cells // 2 - 1)])},
                    rayleigh=(3.0, 2e-6))


def block(held: bool) -> fs.Substructure:
    mesh = fs.block((0.2, 0.06, 0.04), (8, 3, 2), "hexahedron")
    tips = mesh.nodes("right")
    mesh = mesh.with_sets(joint=tips[[0, 3, -1]], pad=np.setdiff1d(mesh.nodes("top"), mesh.nodes("left"))[5:8])
    return fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["left"] if held else [], interface=["joint"],
                    ports={"belt": ("pad", "x")}, rayleigh=(20.0, 1e-8))


def disc(held: bool, joints: int = 3) -> fs.Substructure:
    """A ring of bricks: frequencies come in pairs."""
    mesh = fs.annulus(0.03, 0.1, 0.01, (2, 24, 1), "hexahedron")
    rim = np.intersect1d(mesh.nodes("outer"), mesh.nodes("top"))
    rim = rim[np.argsort(np.arctan2(*mesh.points[rim, 1::-1].T))]
    mesh = mesh.with_sets(joint=rim[::len(rim) // joints][:joints], pad=rim[3:5])
    return fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["inner"] if held else [], interface=["joint"],
                    ports={"belt": ("pad", "y")}, rayleigh=(50.0, 1e-8))


def named(sub: fs.Substructure, interface: list[int], belt: int) -> fs.Substructure:
    return fs.Substructure(sub.M, sub.K, sub.D, interface, {"belt": np.eye(sub.size)[belt]}, sub.name)


GALLERY = (
    Problem("chain 10", lambda: fs.chain(10, belt=2), 4, -0.2677, quick=True),
    Problem("chain 10, stable", lambda: fs.chain(10, belt=2, interface=(1, 2)), 3, -0.01, quick=True),
    Problem("chain 10, own damping", lambda: fs.chain(10, belt=2, damping=1.5), 4, quick=True),
    Problem("chain 50, belt m25", lambda: fs.chain(50, belt=25, interface=(1, 50)), 8, -0.05),
    Problem("chain 50, ports", lambda: fs.chain(50, belt=25, interface=(1, 50)), 8, -0.05, ports=True, quick=True),
    Problem("chain 150, belt m2", lambda: fs.chain(150, belt=2), 12, -0.2677),
    Problem("chain 300, belt m150", lambda: fs.chain(300, belt=150, interface=(1, 100, 300)), 10, -0.02),
    Problem("chain 300, undamped", lambda: fs.chain(300, belt=4, damping=0.0, interface=(100, 200)), 10),
    Problem("chain 60, floating", lambda: fs.chain(60, belt=4, interface=(1, 60), fixed=False), 6, -0.05, quick=True),
    Problem("uneven chain 120", lambda: uneven(120, 1.0, belt=5, interface=(1, 60)), 10, -0.05),
    Problem("very uneven chain 80", lambda: uneven(80, 4.0, belt=5, interface=(1, 40)), 8, -0.02),
    Problem("stiff chain", stiff, 6, -0.05, quick=True),
    Problem("chain 40, strongly damped", lambda: fs.damped(fs.chain(40, belt=3), dashpots={19: 1.0, 30: 5.0}), 8, quick=True),
    Problem("chain 60, Rayleigh", lambda: fs.damped(fs.chain(60, belt=3, interface=(1, 30)), rayleigh=(1e-3, 0.05)), 8),
    Problem("chain 60, unsymmetric D", lambda: turning(fs.chain(60, belt=3, interface=(1, 30)), 0.02), 8, -0.05, quick=True),
    Problem("lattice, floating", lambda: lattice(9, 8), 8, -0.1),
    Problem("lattice, held", lambda: lattice(9, 8, held=True), 8, -0.1, quick=True),
    Problem("lattice, unsymmetric D", lambda: turning(lattice(9, 8, held=True), 0.01), 8),
    Problem("membrane", lambda: fs.damped(named(membrane(14), [20, 100], 50), dashpots={77: 0.3}), 8, -0.2),
    Problem("beam", beam, 5, -3.0, quick=True),
    Problem("beam, Rayleigh", lambda: beam(rayleigh=(2.0, 1e-6)), 5, -1.0),
    Problem("beam on springs, dashpot", lambda: fs.damped(beam(foundation=1e4), dashpots={33: 2.0}), 5),
    Problem("beam, floating", lambda: beam(True), 5, -1.0, quick=True),
    Problem("square plate", plate, 8, -2.0),
    Problem("square plate, ports", plate, 8, -20.0, ports=True),
    Problem("square plate, triangles", lambda: plate(7, triangles=True), 7, -2.0),
    Problem("square plate, unsymmetric D", lambda: turning(plate(7), 0.01), 6, -2.0),
    Problem("square plate, floating", lambda: plate(7, edge=False), 8, -2.0),
    Problem("block", lambda: block(True), 6, -100.0),
    Problem("block, floating", lambda: block(False), 6, -50.0),
    Problem("disc", lambda: disc(True), 8, -200.0),
    Problem("disc, ports", lambda: disc(True), 8, -1000.0, ports=True),
    Problem("disc, floating", lambda: disc(False), 8, -50.0),
    Problem("disc, floating, one joint", lambda: disc(False, 1), 8, -50.0, hcb=False),
    Problem("block, dashpots", lambda: fs.damped(block(True), dashpots={100: 300.0, 200: 1000.0}), 6),
)


@cache
def quick() -> tuple[Problem, ...]:
    return tuple(problem for problem in GALLERY if problem.quick)


def statics(kind: Any, sub: fs.Substructure, extra: np.ndarray) -> Statics:
    """What a method works out of a component before it looks for modes."""
    part = Partition.of(sub, kind.held)
    return kind(0).statics(part, part.factored(), extra)


def rigid_motions(nx: int, ny: int) -> np.ndarray:
    """Two translations and the rotation of `lattice`, (n, 3)."""
    x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    motions = np.zeros((2 * nx * ny, 3))
    motions[0::2, 0] = motions[1::2, 1] = 1.0
    motions[0::2, 2], motions[1::2, 2] = -y.ravel(), x.ravel()
    return motions
