"""A small model over a box of parameters, whose number of eigenvalues in a band is proved for all values at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from femsub.algebra import by_threads, one_thread
from femsub.checks import (
    EPS,
    NOT_CHECKED,
    Array,
    InputError,
    Tally,
    check_band,
    finite_number,
    interval,
    items,
    mapping,
    positive_number,
    real_array,
    whole_number,
)
from femsub.model import DOUBLE, Affine, in_band
from femsub.modes import ComplexModes, Contour, eigenpairs
from femsub.reduction.states import States, improved, listed, seen

if TYPE_CHECKING:
    from femsub.model import Pencil

Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class ParameterBox:
    """Ranges of parameters for which `reduce` makes one small model of λ² M + λ D + K, with a band and a tolerance.

    Parameters
    ----------
    ranges : mapping of str to (lo, hi)
        lo < hi, in the units of each parameter. Without ranges the box is one value: the model as it is.
    band : (lo, hi)
        In radians per unit of time: every eigenvalue with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi is kept.
    re : (a, b), optional
        In place of |Re λ| ≤ hi: only eigenvalues with a ≤ Re λ ≤ b. With strong damping, choose a close to 0, such as -hi/40.
        The model then has no shapes for modes that decay faster: it is smaller and computed sooner. It has all growing modes with
        Re λ up to b.
    tol : float
        The largest distance of a λ of the small model from one of the full model, relative to |λ|. The distance is estimated. A
        |λ| below 1e-6 of hi counts as 0, and is as exact as rounding allows.
    cells : int
        The largest number of cells of the box that are tried. Cells without a proof are open, and a warning names them.

    Raises
    ------
    InputError, InputTypeError
        lo ≥ hi, a band without an end, a ≥ 0 or b ≤ 0.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.ParameterBox({"speed": (1, 4), "mu": (0, 0.6)}, band=(0, 2e4))
    ParameterBox: speed from 1 to 4, mu from 0 to 0.6; band 0 to 20000 rad/time, tol 1e-06
    """

    ranges: Ranges
    band: tuple[float, float]
    tol: float = 1e-6
    cells: int = 32
    re: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        found = {}
        for name, pair in mapping("ranges", self.ranges, "names and pairs (lo, hi)").items():
            ends = [finite_number(f"the range of {name}", end) for end in items(f"the range of {name}", pair, "(lo, hi)")]
            if len(ends) != 2 or ends[0] >= ends[1]:
                raise InputError(f"the range of {name} must be (lo, hi) with lo < hi, not {pair!r}")
            found[name] = (ends[0], ends[1])
        band = check_band(self.band)
        if not np.isfinite(band[1]):
            raise InputError("band must end: give (lo, hi) in rad per unit of time")
        if self.re is not None:
            a, b = interval("re", self.re)
            if not a < 0 < b:
                raise InputError(f"re must be (a, b) with a < 0 < b, so that stability can be lost in it, but is ({a:g}, {b:g})")
            object.__setattr__(self, "re", (a, b))
        for name, value in (("ranges", found), ("band", band), ("tol", positive_number("tol", self.tol)),
                            ("cells", whole_number("cells", self.cells))):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        ranges = Cell(self.ranges).where
        growth = "" if self.re is None else f", Re λ from {self.re[0]:g} to {self.re[1]:g}"
        return f"ParameterBox: {ranges}; band {self.band[0]:g} to {self.band[1]:g} rad/time{growth}, tol {self.tol:g}"

    @property
    def region(self) -> tuple[float, float, float, float]:
        """(a, b, lo, hi)."""
        return *(self.re or (-self.band[1], self.band[1])), *self.band

    @property
    def still(self) -> float:
        """|λ| up to this value counts as rigid motion, whose λ is 0 but for rounding."""
        return DOUBLE * self.band[1]

    @property
    def contour(self) -> Contour:
        """The contour around the region, for a cell without a contour of its own."""
        a, b, _, hi = self.region
        return Contour(sides=(a, b, hi))


@dataclass(frozen=True)
class Cell:
    """A part of a box of parameters, and the number of eigenvalues in a contour for all values in it.

    Attributes
    ----------
    ranges : mapping of str to (lo, hi)
    contour : Contour or None
        Encloses the band. No eigenvalue crosses it.
    number : int or None
        The number of eigenvalues of the full model inside, conjugates included; None if the cell is open.
    margin : float
        The bound of `femsub.modes.quadratic.cells`, whose limit is 1.
    sampled : bool
        Whether a factor was sampled, since it takes no `Interval`.
    states : States or None
        Bases from which the eigenpairs are computed, with one column for each eigenvalue in the contour.
    why : str
        Why the cell is open, and near which s = λ. A cell that was not tried has the reason of the cell that was halved.

    Examples
    --------
    >>> import femsub as fs
    >>> family = fs.Affine([[1]], None, [(1.0, [[1]]), ("k", [[1]])])
    >>> small = fs.reduce(family, fs.ParameterBox({"k": (0, 1)}, band=(0, 2)))
    >>> cell, = small.cells
    >>> cell.number, cell.evidence
    (2, 'certified')
    """

    ranges: Ranges
    contour: Contour | None = None
    number: int | None = None
    margin: float = np.inf
    sampled: bool = False
    states: States | None = field(default=None, repr=False, compare=False)
    why: str = ""

    @property
    def evidence(self) -> str:
        """'certified' for all values in the cell, 'confirmed' where a factor was sampled, or 'not checked'."""
        return Tally(self.number or 0, self.number, self.sampled).evidence

    @property
    def where(self) -> str:
        return ", ".join(f"{name} from {lo:g} to {hi:g}" for name, (lo, hi) in self.ranges.items()) or "one value"

    @property
    def volume(self) -> float:
        return prod(hi - lo for lo, hi in self.ranges.values())

    def holds(self, values: Mapping[str, float]) -> bool:
        """Whether the cell contains the values."""
        return all(lo <= values[name] <= hi for name, (lo, hi) in self.ranges.items())


@dataclass(frozen=True)
class Radii:
    """The distance of each λ of the small model from one of the full model, from residuals of its pairs, to first order.

    |δλ| ≤ ‖R‖ ‖L‖ / (c |zᴴP'(λ)x|) with the residuals R and L of right and left vectors in the norm of A⁻¹, if P(λ) outside the
    basis has an inverse of at most 1/c in the norm of A. c is an estimate: a third of the smallest value found at parameter
    values whose eigenvectors are not in the basis. Pairs from `States` also have residuals r and l in the basis, where P(λ) has
    another inverse. ‖r‖ ‖l‖ times the norm of this inverse, without the pairs inside the contour, is added.

    `images` (p + 1, d, r) are the images of the basis under A and under the terms, as real rows with the same lengths and angles.
    Negligible directions are dropped. They are in single precision if its rounding is negligible, too.
    """

    images: Array
    lost: Array  #: (p + 1,): the norms of the dropped parts of the images
    signs: Array
    places: Array  #: for each term: the index of its change in θ, or -1
    held: Array  #: for each term: a constant that is added to the θ of its change
    base: Array  #: (p, 3): weights c_0, c_1, c_2
    rounding: Array  #: (p + 1, d, d): |V|ᵀ|A||V|, and the same for the terms; times EPS the effect of rounding of their entries
    least: float  #: c

    def weights(self, theta: Array) -> Array:
        """(p + 1, 3): the weights of A and of the terms in the coefficients of s⁰, s and s²."""
        scale = np.where(self.places < 0, 1.0, np.append(theta, 1.0)[self.places] + self.held)
        return np.vstack([[1.0, 0.0, 0.0], scale[:, None] * self.base])

    def at(self, theta: Array) -> RadiiAt:
        """A function that gives the radius of each single eigenvalue at θ."""
        weights = self.weights(theta)
        terms, d, r = self.images.shape
        # one product, so that the images are read from memory once
        both = np.hstack([weights, weights * np.append(1.0, self.signs)[:, None]]).astype(self.images.dtype)
        right, left = (both.T @ self.images.reshape(terms, d * r)).reshape(2, 3 * d, r)
        return RadiiAt(self, weights, right, left, np.tensordot(np.abs(weights.T), self.rounding, 1))

    @staticmethod
    def circles(values: Array, size: Array) -> Array:
        """The radius of each λ, Im λ ≥ 0, from the `size` of each λ alone. Circles that meet get that of a common circle."""
        # Σ_j η_j / |s - λ_j| < 1 on the circle, conjugates included: to first order η_k / (1 - the sum over all other λ)
        pairs = np.flatnonzero(values.imag)
        every = np.append(size, size[pairs])
        apart = np.abs(values[:, None] - np.append(values, values[pairs].conj()))
        others = apart + np.diag(np.full(len(every), np.inf))[:len(values)]
        radius = size
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(3):
                room = 1 - np.where(others > radius[:, None], every / (others - radius[:, None]), np.inf).sum(axis=1)
                radius = np.where(room > 0.5, size / room, np.inf)
        for k in np.flatnonzero(~np.isfinite(radius)):
            order = np.argsort(apart[k])
            for number in range(1, len(order) + 1):  # λ in the circle take half of the sum, all others the other half
                inside, beyond = order[:number], order[number:]
                radius[k] = 2 * every[inside].sum() + apart[k, inside[-1]]
                room = apart[k, beyond] - radius[k]
                if (room > 0).all() and (every[beyond] / room).sum() < 0.5:
                    break
        return np.asarray(radius)


class RadiiAt(NamedTuple):
    """`Radii` at one θ: images under the parts of P = Σ s^k P_k and of its adjoint, (3d, r), and their rounding, (3, d, d)."""

    radii: Radii
    weights: Array
    right: Array
    left: Array
    rounding: Array

    def __call__(self, values: Array, x: Array, z: Array) -> Array:
        """The radius of each λ alone, with its x and z of |zᴴP'(λ)x| = 1, (k,)."""
        size, own = 1 / self.radii.least, np.abs(self.weights @ values ** np.arange(3)[:, None])
        # by entries: with norms, dashpots of 10⁶ times critical damping would exceed the tolerance; 16 EPS was too little
        moved = np.einsum("ji,jki->ik", np.abs(values) ** np.arange(3)[:, None], self.rounding @ np.abs(x))
        rounding = 64 * EPS * np.einsum("ik,ki->i", moved, np.abs(z))
        for images, s, part in ((self.right, values, x), (self.left, values.conj(), z)):
            columns = np.concatenate([part, part * s, part * s * s])
            image = np.vstack([columns.real.T, columns.imag.T]).astype(images.dtype) @ images  # real times complex
            square = np.einsum("ka,ka->k", image, image).reshape(2, -1).sum(axis=0)
            length = np.linalg.norm(part, axis=0)
            size = size * (np.sqrt(square) + self.radii.lost @ own * length)
        return np.asarray(size + rounding)


@dataclass(frozen=True, eq=False, repr=False)
class BoxModel(Affine):
    """A small `Affine` over a box of parameters, made by `reduce`, with the number of eigenvalues proved and the error estimated.

    Its matrices are VᵀA_iV (r, r), each with the factor θ_i(p) of the full model.

    Attributes
    ----------
    box : ParameterBox
    cells : tuple of Cell
        They cover the box.
    V : ndarray, shape (n, r)
    evidence : str
        'certified': in each cell the number of eigenvalues in the band is proved for all values. 'confirmed': the same, but a
        factor of the model was sampled, since it takes no interval. 'not checked': some cells are open, or the given model is a
        projection whose cut-off is not known. Numbers and radii refer to the given model, also if its parts are reduced.
    open_share : float
        The share of the box's volume that is open.
    error : float
        The largest estimated |δλ| / |λ| at the parameter values where it was evaluated.
    values : ndarray, shape (k, number of parameters)
        The values of the parameters whose eigenvectors span V. They were chosen where the error was largest.

    Examples
    --------
    >>> import femsub as fs
    >>> chain = fs.chain(60, belt=5)
    >>> box = fs.ParameterBox({"slope": (-0.02, 0.0)}, band=(0.0, 0.5))
    >>> small = fs.reduce(chain, box, contacts=fs.Belt(slope=0.0))
    >>> small.evidence, small.modes(slope=-0.01).is_stable
    ('certified', False)
    """

    box: ParameterBox
    cells: tuple[Cell, ...]
    V: Array
    radii: Radii
    middle: Array  #: factors of the reference
    varied: Array  #: which factors vary
    free: int  #: the number of columns of V that are free rigid motion: each has λ = 0 twice
    error: float
    values: Array

    def __post_init__(self) -> None:
        self._set(**{item.name: getattr(self, item.name) for item in fields(self)} | {"cutoff": self.box.band[1]})

    def __repr__(self) -> str:
        inside = f"{len(self.cells)} cell{'s' * (len(self.cells) != 1)}"
        share = f", {self.open_share:.1%} of it open" if self.open_share else ""
        over = ", ".join(self.box.ranges) or "one value"
        return (f"BoxModel: {self.size} of {len(self.V)} DOF, {over} in {inside}, {self.evidence}{share}; "
                f"λ within {self.error:.1e}")

    @property
    def evidence(self) -> str:
        if np.isnan(self.cutoff):
            return NOT_CHECKED
        known = [cell for cell in self.cells if cell.number is not None]
        return Tally(len(self.cells), len(known), any(cell.sampled for cell in known)).evidence

    @property
    def open_share(self) -> float:
        whole = sum(cell.volume for cell in self.cells)
        return sum(cell.volume for cell in self.cells if cell.number is None) / whole

    def at(self, **values: float) -> Pencil:
        """The small pencil at values of all parameters.

        Raises
        ------
        InputError
            A value is outside the box, missing or unknown.
        """
        self._inside(values)
        return super().at(**values)

    def fixed(self, **values: float) -> BoxModel:
        """The model for given values of some of the parameters."""
        self._inside(values)
        found = cast(BoxModel, super().fixed(**values))
        rest = {name: ends for name, ends in self.box.ranges.items() if name not in values}
        box = replace(self.box, ranges=rest)
        cells = tuple(replace(cell, ranges={key: ends for key, ends in cell.ranges.items() if key not in values},
                              states=cell.states and replace(cell.states, given={**cell.states.given, **values}))
                      for cell in self.cells
                      if all(cell.ranges[name][0] <= value < cell.ranges[name][1]  # each value in one cell, ends included
                             or value == cell.ranges[name][1] == self.box.ranges[name][1] for name, value in values.items()))
        return found._with(box=box, cells=cells)

    def _inside(self, values: Mapping[str, float]) -> None:
        self._check(values)
        for name, value in values.items():
            lo, hi = self.box.ranges[name]
            if not lo <= value <= hi:
                raise InputError(f"{name} = {value:g} is outside the box, whose {'lower' if value < lo else 'upper'} bound is "
                                 f"{lo if value < lo else hi:g}. Make a model of a larger box")

    def cell(self, **values: float) -> Cell:
        """The cell that contains these values. On an edge of several cells, a proved cell is preferred."""
        self._inside(values)
        self._check_all("value", values)
        return max((cell for cell in self.cells if cell.holds(values)), key=lambda cell: cell.number is not None)

    def number(self, **values: float) -> int | None:
        """The number of eigenvalues of the full model in the contour of the cell, conjugates included; None if it is open."""
        return self.cell(**values).number

    @one_thread(True)  # of these sizes two threads take longer than one
    def pairs(self, values: Mapping[str, float], fine: bool = False) -> tuple[Pencil, Array, Array, Array, Array]:
        """The pencil; λ (k,), Im λ ≥ 0, in and near the band; x and z (r, k), |zᴴP'(λ)x| = 1; the radius of each λ alone.

        λ are in the order of Im λ, without λ = 0 of free rigid motion. Pairs are as accurate as the tolerance of the box
        requires; with `fine`, as rounding allows.
        """
        factors = self.factors(**values)
        lam, x, z, size = self._listed(self.cell(**values), values, factors, fine)
        none = np.zeros((self.free, len(lam)))
        return self.weighted(factors), lam, np.vstack([none, x]), np.vstack([none, z]), size

    def _listed(self, cell: Cell, values: Mapping[str, float], factors: Array, fine: bool = False) -> tuple[Array, ...]:
        """λ, x, z and size of `pairs`, without free rigid motion."""
        region, contour, matrices = self.box.region, cell.contour or self.box.contour, self.moving(factors)
        found, sizes = None, self.radii.at((factors - self.middle)[self.varied])
        if cell.states is not None and cell.number is not None:
            number, tol = cell.number - 2 * self.free, self.box.tol
            found = listed(cell.states, values, matrices, contour.encloses, number, sizes, tol, fine)
        if found is None:
            lam, x, z = self.every(matrices)
            near = (in_band(lam, region[2:], region[:2]) | contour.encloses(lam)) & (lam.imag >= 0)  # or just outside the band
            lam, x, z = improved(matrices, lam[near], x[:, near], z[:, near])
            found = lam, x, z, sizes(lam, x, z)
        order = np.argsort(found[0].imag, kind="stable")
        return tuple(part[..., order] for part in found)

    @one_thread(True)
    def eigenvalues(self, values: Mapping[str, float]) -> tuple[Array, Array, bool]:
        """λ (k,) with Im λ ≥ 0 in the band, without free rigid motion; the radius of each; whether none is missing."""
        cell = self.cell(**values)
        lam, _, _, size = self._listed(cell, values, self.factors(**values))
        near, bar, number = self._in_band(cell, lam, size)
        return lam[near], bar, number == cell.number and not np.isnan(self.cutoff)

    @one_thread(True)
    def distance(self, cell: Cell, states: States, values: Mapping[str, float]) -> float:
        """Largest distance over |λ| of the eigenvalues from a cell's states, without iteration, from those of the full model.

        inf if their number is not that of the cell.
        """
        (lam, _, _, size), *_, raw = self.on(cell, states, values)
        if len(lam) + np.count_nonzero(lam.imag) + 2 * self.free != cell.number:
            return np.inf
        with np.errstate(all="ignore"):
            off = (self.radii.circles(lam, size) + np.abs(lam - raw)) / np.maximum(np.abs(lam), self.box.still)
        return float(off.max(initial=0.0)) if np.isfinite(off).all() else np.inf

    def on(self, cell: Cell, states: States, values: Mapping[str, float]) -> tuple[list[Array], Array, int, Array]:
        """The eigenpairs of a cell from these states, without iteration; see `seen`."""
        assert cell.contour is not None and cell.number is not None
        factors = self.factors(**values)
        return seen(states, values, self.moving(factors), cell.contour.encloses, cell.number - 2 * self.free,
                    self.radii.at((factors - self.middle)[self.varied]), self.box.tol)

    def _in_band(self, cell: Cell, lam: Array, size: Array) -> tuple[Array, Array, int]:
        """The indices of λ in the band, the radius of each, and the number of eigenvalues in the cell's contour."""
        region = self.box.region
        enclosed = (cell.contour or self.box.contour).encloses(lam)
        near = np.flatnonzero(in_band(lam, region[2:], region[:2]))
        number = 2 * self.free + int(enclosed.sum() + np.count_nonzero(lam[enclosed].imag))
        return near, self.radii.circles(lam, size)[near], number

    @one_thread(True)
    def modes(self, **values: float) -> ComplexModes:
        """The complex modes in the band at values of all parameters; the error bars are distances from λ of the full model.

        Shapes are in the coordinates of the small model, see `expand`. `tally` counts the eigenvalues in the contour of the cell.
        """
        cell, free = self.cell(**values), self.free
        pencil, lam, x, _, size = self.pairs(values)
        near, bar, number = self._in_band(cell, lam, size)
        values_, x = lam[near], x[:, near]
        zeros = np.zeros(2 * free * (self.box.band[0] == 0))
        shapes = np.zeros((self.size, len(zeros) + len(near)), dtype=complex)
        shapes[np.arange(len(zeros)) // 2, np.arange(len(zeros))] = 1.0
        shapes[:, len(zeros):] = x / np.linalg.norm(x, axis=0)
        values_, bar = np.append(zeros, values_), np.append(zeros, bar)
        rigid = np.arange(len(values_)) < len(zeros)
        tally = Tally(number, cell.number, sampled=cell.sampled)
        residual = pencil.residual(values_, shapes)
        scale = np.abs(values_)**2 * pencil.norms[0] + np.abs(values_) * pencil.norms[1] + pencil.norms[2]
        return ComplexModes(values_, shapes, np.linalg.norm(residual, axis=0) / scale, bar, rigid, np.zeros(len(bar), dtype=bool),
                            searched=self.box.region, tally=tally, cutoff=self.cutoff,
                            full_growth=np.stack([values_.real - bar, values_.real + bar], axis=1))

    def modes_over(self, **values: Any) -> list[ComplexModes]:
        """`modes` at many values, in one thread for each core. Each value is an array of the same shape, or one number for all.

        Raises
        ------
        InputError, InputTypeError
            A value is outside the box, missing or unknown; arrays of unlike shapes.
        """
        try:
            columns = np.broadcast_arrays(*(real_array(name, value) for name, value in values.items()))
        except ValueError:
            sizes = ", ".join(f"{name} {np.shape(value)}" for name, value in values.items())
            raise InputError(f"values must be arrays of equal shape, or numbers, but these are {sizes}") from None
        rows = np.stack([part.ravel() for part in columns], axis=1).tolist() if columns else [[]]
        places = [dict(zip(values, row, strict=True)) for row in rows]
        for place in places:  # before any work
            self.cell(**place)
        return list(by_threads(lambda place: self.modes(**place), places))

    def moving(self, factors: Array) -> tuple[Array, Array, Array]:
        """K, D and M (d, d) without free rigid motion, with these θ (q,)."""
        d, found, start = self.size - self.free, [], 0
        for matrices in self.moving_rows:
            found.append((factors[start:start + len(matrices)] @ matrices).reshape(d, d))
            start += len(matrices)
        M, D, K = found
        return K, D, M

    @cached_property
    def moving_rows(self) -> list[Array]:
        """The matrices of M, of D and of K as rows, (q_M, d²) and so on."""
        d = self.size - self.free
        return [np.array([A[self.free:, self.free:] for _, A in terms]).reshape(len(terms), d * d)
                for terms in (self.M, self.D, self.K)]

    def every(self, matrices: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """All λ of K, D and M (2d,), and x and z (d, 2d) with |zᴴP'(λ)x| = 1; infinite λ are inf."""
        hi = self.box.band[1]
        (shift, nu, x, z), *_ = eigenpairs(np.stack(matrices), float(np.hypot(hi, hi)))
        with np.errstate(all="ignore"):
            lam = shift + 1 / nu
        return np.where(np.isfinite(lam), lam, np.inf), x, z

    def expand(self, shapes: Array) -> Array:
        """Shapes of the full model, Vq (n, ...), from shapes q of the small model."""
        return self.V @ shapes
