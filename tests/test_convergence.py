"""Frequencies fall onto closed forms with the order of the element: each element is a class with its data."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from test_beams import SI as BAR, SPEED, SUPPORTS, wave_numbers
from test_plates import SI as SHEET, SPEED as SHEET_SPEED, A, B, rectangle

import femsub as fs


class Convergence:
    """The relative errors of ω² fall as h**order, fitted over several grids."""

    order: ClassVar[int]
    grids: ClassVar[tuple[int, ...]]
    within: ClassVar[float] = 0.2
    from_above: ClassVar[bool] = True  # conforming: Ritz values

    def errors(self, n: int) -> np.ndarray:
        """ω² / exact - 1 of the first modes, with n elements along an edge."""
        raise NotImplementedError

    def test_errors_fall_with_the_order_of_the_element(self) -> None:
        errors = np.array([self.errors(n) for n in self.grids])
        assert not self.from_above or (errors > 0).all()
        rates = -np.polyfit(np.log(self.grids), np.log(np.abs(errors)), 1)[0]
        assert np.abs(rates - self.order).max() < self.within


class Beam(Convergence):
    order, grids = 4, (6, 8, 12, 16, 24)
    ends: ClassVar[str]
    foundation: ClassVar[float] = 0.0

    def errors(self, n: int) -> np.ndarray:
        exact = wave_numbers(self.ends, 2) ** 4 * SPEED**2 + self.foundation / (BAR["rho"] * BAR["A"])
        part = fs.beam(1.0, n, **BAR, foundation=self.foundation, supports=SUPPORTS[self.ends])
        elastic = fs.normal_modes(part, count=4).eigenvalues[2 if self.ends == "free" else 0:]  # on a foundation, rigid motion
        return elastic[:2] / exact - 1  # has k_f/ρA


class TestPinnedBeam(Beam):
    ends = "pinned"


class TestClampedBeam(Beam):
    ends = "clamped-free"


class TestFreeBeam(Beam):
    ends = "free"


class TestPinnedBeamOnFoundation(TestPinnedBeam):
    foundation = 2e3


class TestClampedBeamOnFoundation(TestClampedBeam):
    foundation = 2e3


class TestFreeBeamOnFoundation(TestFreeBeam):
    foundation = 2e3


class Plate(Convergence):
    kind: ClassVar[str]

    def errors(self, n: int) -> np.ndarray:
        exact = np.sort([(np.pi**2 * (j**2 / A**2 + k**2 / B**2) * SHEET_SPEED) ** 2 for j in (1, 2) for k in (1, 2)])[:2]
        part = fs.plate(rectangle(n, n, self.kind), **SHEET, supports={"edge": "simply supported"})
        modes = fs.normal_modes(part, count=2)
        assert modes.rigid == 0
        return modes.eigenvalues / exact - 1


class TestBognerFoxSchmit(Plate):
    kind, order, grids = "quad", 4, (4, 6, 8, 12, 16)


class TestMorley(Plate):
    kind, order, grids, from_above = "triangle", 2, (24, 32, 40, 48, 64), False


class Solid(Convergence):
    """A box between smooth walls: u = (sin πx/a cos πy/b /a, -cos πx/a sin πy/b /b, 0) shears, ω² = μ/ρ π²(a⁻² + b⁻²)."""

    kind: ClassVar[str]
    within = 0.3

    def errors(self, n: int) -> np.ndarray:
        a, b, c, material = 1.0, 0.8, 0.6, fs.Material(2.6, 0.3, 1.3)
        walls = {"left": "x", "right": "x", "front": "y", "back": "y", "bottom": "z", "top": "z"}
        part = fs.solid(fs.block((a, b, c), (n, n, n), self.kind), material, supports=walls)
        exact = material.lame[1] / material.rho * np.pi**2 * (a**-2 + b**-2)
        return fs.normal_modes(part, count=1).eigenvalues / exact - 1


class TestHexahedron(Solid):
    kind, order, grids = "hexahedron", 2, (4, 6, 8, 10)


class TestTetra(Solid):
    kind, order, grids = "tetra", 2, (4, 6, 8, 10)


class TestHexahedron20(Solid):
    kind, order, grids = "hexahedron20", 4, (2, 3, 4, 5)


class TestHexahedron27(Solid):
    kind, order, grids = "hexahedron27", 4, (2, 3, 4, 5)


@pytest.mark.slow
class TestTetra10(Solid):
    kind, order, grids = "tetra10", 4, (4, 5, 6, 7, 8)  # comes up to 4 from below
