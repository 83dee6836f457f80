"""The requested region of a spectrum: the eigenvalues nearest to 0, those in a rectangle, or all."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import QUADRATIC
from femsub.checks import Array, InputError, Tally, check_band, interval, whole_number
from femsub.model import in_band

if TYPE_CHECKING:
    from femsub.model import Pencil

Box = tuple[float, float, float, float]  # (re_lo, re_hi, lo, hi)


@dataclass(frozen=True)
class Contour:
    """The upper half of a curve around 0 that is symmetric about the real axis: a rectangle (re_lo, re_hi, hi), or a circle."""

    radius: float = 0.0
    sides: tuple[float, float, float] | None = None

    @property
    def size(self) -> float:
        """The largest |λ| inside."""
        return self.radius if self.sides is None else float(np.hypot(max(-self.re[0], self.re[1]), self.top))

    @property
    def re(self) -> tuple[float, float]:
        """The smallest and the largest Re λ; 0 lies between them."""
        a, b, _ = self.sides or (-self.radius, self.radius, 0.0)
        return min(a, 0.0), max(b, 0.0)

    @property
    def top(self) -> float:
        """The largest Im λ."""
        return self.radius if self.sides is None else self.sides[2]

    def at(self, t: Array) -> Array:
        """Points for 0 ≤ t ≤ 1, counter-clockwise from the real axis."""
        if self.sides is None:
            return self.radius * np.exp(1j * np.pi * t)
        a, b, hi = self.sides
        corners = np.array([b + 0j, b + 1j * hi, a + 1j * hi, a + 0j])
        return np.interp(3 * t, np.arange(4.0), corners.real) + 1j * np.interp(3 * t, np.arange(4.0), corners.imag)

    @property
    def where(self) -> str:
        """The region, for messages."""
        if self.sides is None:
            return f"|λ| < {self.radius:.6g}"
        return "{:.6g} < Re λ < {:.6g}, |Im λ| < {:.6g}".format(*self.sides)

    def encloses(self, values: Array) -> Array:
        """Which values lie inside, bool; a value and its conjugate get the same answer."""
        if self.sides is None:
            return np.abs(values) < self.radius
        a, b, hi = self.sides
        return (values.real > a) & (values.real < b) & (np.abs(values.imag) < hi)


def listed(values: Array) -> int:
    """The number of eigenvalues represented: a λ with Im λ > 0 counts twice."""
    return len(values) + int(np.count_nonzero(values.imag))


def sizes_up_to(values: Array, count: int) -> tuple[Array, int]:
    """|λ| of the values with Im λ ≥ 0, ascending, and the index of the last of the `count` nearest to 0, conjugates included."""
    upper = values[values.imag >= 0]
    upper = upper[np.argsort(np.abs(upper), kind="stable")]
    return np.abs(upper), int(np.searchsorted(np.cumsum(1 + (upper.imag != 0)), count))


@dataclass(frozen=True)
class Count:
    """`number` eigenvalues lie inside the contour, conjugates included, by an independent count.

    `values` are approximate eigenvalues of the pencil, also outside the contour; empty if the count was made without them.
    """

    contour: Contour
    number: int
    values: Array = field(repr=False)
    size: int  #: of the projected problem
    margin: float  #: bound of the coupling; the theorem needs less than 1

    @property
    def disc(self) -> tuple[float, int] | None:
        """The radius of the disc and the number of eigenvalues in it; None for a rectangle."""
        return (self.contour.radius, self.number) if self.contour.sides is None else None

    def tally(self, values: Array) -> Tally:
        """The number of eigenvalues that a search has found inside, from its λ with Im λ ≥ 0, and the counted number."""
        return Tally(listed(values[self.contour.encloses(values)]), self.number)


@dataclass(frozen=True)
class Region:
    """`count` eigenvalues nearest to 0, or the eigenvalues in the rectangle `box`; all if both are None."""

    count: int | None = None
    box: Box | None = None

    @property
    def is_all(self) -> bool:
        return self.count is None and self.box is None

    def at_most(self, count: int) -> Region:
        """The same region of a problem with no more than `count` eigenvalues."""
        return self if self.count is None else replace(self, count=min(self.count, count))

    def listed(self, values: Array) -> Array:
        """Indices of the values in the region, in the order of listing."""
        if self.box is not None:
            inside = np.flatnonzero(in_band(values, self.box[2:], self.box[:2]))
            return inside[np.argsort(values[inside].imag, kind="stable")]
        # by |λ|, conjugates side by side with Im λ > 0 first; at least `count`, a pair never split
        with np.errstate(divide="ignore"):
            size = np.round(np.log(np.abs(values)), 13)  # equal up to rounding of each |λ|, however large others are
        turn = np.array([np.count_nonzero(values[:i] == value) for i, value in enumerate(values)])  # among equal ones
        order = np.lexsort((-values.imag, turn, np.abs(values.imag), values.real, size))
        if self.count is None or self.count >= len(order):
            return order
        split = values[order[self.count]].imag < 0 and values[order[self.count]] == values[order[self.count - 1]].conj()
        return order[:self.count + split]

    def upper(self, values: Array) -> Array:
        """Ascending indices of the values, Im λ ≥ 0, that lie in the region or whose conjugates lie in it."""
        pairs = np.flatnonzero(values.imag > 0)
        every = np.append(values, values[pairs].conj())
        return np.unique(np.append(np.arange(len(values)), pairs)[self.listed(every)])

    def beside(self, values: Array) -> Array:
        """`upper` of a region with four more values, or a box wider by 1 %: corrections may move these into the region."""
        if self.box is None:
            return replace(self, count=(self.count or len(values)) + 4).upper(values)
        a, b, lo, hi = self.box
        more = 0.01 * max(abs(a), abs(b), hi)
        return replace(self, box=(a - more, b + more, max(lo - more, 0.0), hi + more)).upper(values)

    @property
    def radius(self) -> float:
        """The radius of a disc around 0 that contains the box, even if its edges move out by 2 %."""
        a, b, _, hi = self.box or (0.0, 0.0, 0.0, np.inf)
        return 1.03 * float(np.hypot(max(abs(a), abs(b)), hi))


def region_of(pencil: Pencil, count: Any, band: Any, re: Any) -> Region:
    """The region from the checked arguments of `complex_modes`."""
    if count is not None and band is not None:
        raise InputError("give count or band, not both")
    if re is not None and band is None:
        raise InputError("re=(a, b) is only valid together with band=(lo, hi)")
    if count is not None:
        count, most = whole_number("count", count), 2 * pencil.size
        if not 1 <= count <= most:
            raise InputError(f"count must be between 1 and {most}, the number of eigenvalues of {pencil.size} DOF, not {count}")
    box = None
    if band is not None:
        lo, hi = check_band(band)
        box = (*((-hi, hi) if re is None else interval("re", re)), lo, hi)
    region = Region(count, box)
    if region.is_all and pencil.is_sparse and pencil.size > QUADRATIC:
        raise InputError(f"a sparse model of {pencil.size} DOF has {2 * pencil.size} eigenvalues: ask for count=20 or "
                         "band=(lo, hi)")
    return region
