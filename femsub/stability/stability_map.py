"""Stability over two parameters: the number of growing modes at each point of a grid, and the borders as curves."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import (
    NOT_CHECKED,
    Array,
    InputError,
    InputTypeError,
    items,
    listener,
    mapping,
    real_array,
    until,
    whole_number,
    word,
)
from femsub.model import Affine, Contacts, Substructure, usable_band
from femsub.output import Chart, Displayed, Table
from femsub.stability.map_borders import BorderLine, Node, Nodes, joined, leaves
from femsub.stability.map_chart import stability_map_chart, stability_map_tables
from femsub.stability.margins import ModesAt, modes_in, point_modes
from femsub.stability.parameter import pencils_of

log = logging.getLogger(__name__)


class Spot(NamedTuple):
    """A point at which the full model was solved: number of growing modes and largest Re λ of the model and of the full model.

    `radius` is the model's own bound of its error, over |λ|; NaN if it has none. `agrees` is True if the numbers are equal, apart
    from modes that error bars leave undecided.
    """

    at: tuple[float, float]
    number: int
    full_number: int
    growth: float
    full_growth: float
    radius: float
    agrees: bool


@dataclass(frozen=True, eq=False, repr=False)
class StabilityMap(Displayed):
    """The stability of a model at m · k values of two parameters, made by `stability_map`.

    Attributes
    ----------
    parameters : (str, str)
    values : (ndarray of shape (m,), ndarray of shape (k,))
        Of the first and of the second parameter, ascending.
    number : ndarray of int, shape (m, k)
        Number of modes in the band that certainly grow: pairs of eigenvalues, and real eigenvalues.
    growth, omega : ndarray, shape (m, k)
        The largest Re λ in the band, 1 per unit of time, and Im λ of that mode; -inf and NaN if the band is empty.
    undecided : ndarray of bool, shape (m, k)
        Where error bars, or the radii of a reduced model, leave undecided whether a mode grows. An undamped mode on the axis does
        not grow.
    radius : ndarray, shape (m, k)
        The largest radius of a λ in the band, over |λ|; NaN if the model has no radii.
    borders : tuple of BorderLine
        Curves beyond which a mode certainly grows. A line ends at the edge of the map, or where its mode leaves the band.
    spots : tuple of Spot
        The points at which the full model was solved.
    band : (lo, hi)
    solved : int
        Number of eigenproblems, those of borders included.
    cutoff : float
        The cut-off of a reduced model if no band was given: the band ends there. Otherwise inf.
    evidence : str
        The evidence of a `BoxModel`. For other models 'not checked': all eigenvalues are known at the points, but none between
        them.

    Examples
    --------
    >>> import femsub as fs
    >>> K = [(1.0, [[1, 0], [0, 2]]), ("split", [[0, 0], [0, 1]]), ("mu", [[0, 1], [-1, 0]])]
    >>> pair = fs.Affine([[1, 0], [0, 1]], [[0.1, 0], [0, 0.1]], K)
    >>> fs.stability_map(pair, {"split": (-2.0, 1.0), "mu": (0.0, 2.0)}, points=(4, 5))
    StabilityMap: split from -2 to 1, mu from 0 to 2, 20 points; up to 1 mode grows, at 60 % of them; 0 % undecided, 1 border
    """

    parameters: tuple[str, str]
    values: tuple[Array, Array]
    number: Array
    growth: Array
    omega: Array
    undecided: Array
    radius: Array
    borders: tuple[BorderLine, ...]
    spots: tuple[Spot, ...]
    band: tuple[float, float]
    solved: int
    cutoff: float = np.inf
    evidence: str = NOT_CHECKED

    def tables(self) -> list[Table]:
        """A row for each point, one for each place of a border, and one for each point solved in full."""
        return stability_map_tables("map", self)

    def chart(self, title: str = "Stability", labels: Sequence[str] = ("", "")) -> Chart:
        """The number of growing modes, and beside it the largest growth, with borders. `labels` are axis labels."""
        return stability_map_chart("map", {"": self}, title, labels)

    @property
    def undecided_share(self) -> float:
        """The share of the points at which a mode is undecided."""
        return float(self.undecided.mean())

    def __repr__(self) -> str:
        where = ", ".join(f"{name} from {values[0]:g} to {values[-1]:g}"
                          for name, values in zip(self.parameters, self.values, strict=True))
        top, lines, wrong = int(self.number.max()), len(self.borders), sum(not one.agrees for one in self.spots)
        share = f"at {100 * np.mean(self.number > 0):.3g} % of them"
        found = f"up to {top} mode{'s grow' if top > 1 else ' grows'}, {share}" if top else "no mode grows"
        spots = f"; {wrong} of {len(self.spots)} spots differ in the full model" if self.spots else ""
        return (f"StabilityMap: {where}, {self.number.size} points; {found}; {100 * self.undecided_share:.3g} % undecided, "
                f"{lines} border{'s' * (lines != 1)}{spots}{until(self.cutoff)}")


def stability_map(model: Substructure | Affine, over: Mapping[str, Any], *, contacts: Contacts = None,
                  band: tuple[float, float] | None = None, points: tuple[int, int] = (60, 60), halvings: int = 2,
                  full: Substructure | Affine | None = None, spots: int = 4,
                  progress: Callable[[str], None] | None = None) -> StabilityMap:
    """How many modes grow over two parameters, and on which curves their number changes.

    At each point of a grid, all eigenvalues are computed for a model of up to 300 DOF, and the eigenvalues in the band for a
    larger model. A border crosses an edge of the grid if the number of growing modes differs at its ends, or if other modes grow
    there. The place on the edge is a root of the margin. A cell is halved if the curvature of the margins allows a mode to cross
    inside. This finds folds, and islands that contain no grid point.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced. All other parameters of an `Affine` must have values (`Affine.fixed`). A `BoxModel` gives the radius of
        each λ. Radii and error bars together decide which modes grow.
    over : mapping of str to (lo, hi), or to an array of three values or more
        The two parameters: those of an `Affine`, or fields of the contacts, which change in all contacts that have them.
    contacts : Belt, LinearContact or another contact, or a sequence of them, optional
        On the model's ports; None for an `Affine`.
    band : (lo, hi), optional
        Only modes with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi, in radians per unit of time. Default: all, for a reduced model those up to
        its cut-off. Required for a sparse model above 2,000 DOF.
    points : (int, int)
        Number of values of each parameter that is given as a range.
    halvings : int
        How often a cell is halved at most.
    full : Substructure or Affine, optional
        The full model of a reduced one, with the same parameters. It is solved at some `spots`.
    spots : int
        Number of points at which the full model is solved, a tenth of the map apart: where the radius is largest, or where a mode
        is nearest to the axis if the model has no radii.
    progress : callable, optional
        Called with a line of text during the computation.

    Returns
    -------
    StabilityMap

    Raises
    ------
    InputError, InputTypeError
        Not two parameters; an unknown parameter; other parameters without a value; values outside the box of the model; fewer
        than two values.

    Notes
    -----
    The margin of a mode is Re λ. For two undamped modes it is -(λ₁² - λ₂²)², which is analytic where they meet. Within a cell
    the k-th largest margin exceeds its values at the corners by up to 1/8 of its second differences. Twice this value is allowed
    for, with second differences from the grid. An island of less than a quarter of a cell may be missed.

    References
    ----------
    A. P. Seyranian, A. A. Mailybaev, Multiparameter Stability Theory (2003), ch. 3 (borders in the plane of two parameters);
    T. R. Chandrupatla, Adv. Eng. Softw. 28 (1997) 145 (roots of margins where Newton's method finds none).

    Examples
    --------
    >>> import femsub as fs
    >>> K = [(1.0, [[1, 0], [0, 2]]), ("split", [[0, 0], [0, 1]]), ("mu", [[0, 1], [-1, 0]])]
    >>> pair = fs.Affine([[1, 0], [0, 1]], [[0.1, 0], [0, 0.1]], K)
    >>> found = fs.stability_map(pair, {"split": (-2.0, 1.0), "mu": (0.0, 2.0)}, points=(4, 5))
    >>> found.borders[0].closed, round(float(found.growth.max()), 3)
    (False, 0.817)
    """
    # the question
    names = tuple(word("parameter", name) for name in mapping("over", over, "two parameters and their ranges"))
    if len(names) != 2:
        raise InputError(f"a map is over two parameters, but over has {len(names)}. Give values to all others first")
    at = pencils_of(model, contacts, names)
    counts = items("points", points, "two numbers of values")
    if len(counts) != 2:
        raise InputTypeError(f"points must be two numbers of values, not {len(counts)}")
    axes: list[Array] = []
    for name, count in zip(names, counts, strict=True):
        count, values = whole_number("points", count, least=2, most=1000), real_array(f"over[{name!r}]", over[name])
        if values.ndim != 1 or len(np.unique(values)) != len(values) or len(values) < 2:
            raise InputError(f"over[{name!r}] must be a range (lo, hi), lo < hi, or a flat list of different values")
        axes.append(np.linspace(values.min(), values.max(), count) if len(values) == 2 else np.sort(values))
    whole_number("halvings", halvings, least=0, most=10)
    whole_number("spots", spots, least=0)
    limits, say = usable_band(model, band), listener("progress", progress)
    if full is not None:
        full_at = pencils_of(full, contacts, names)
    ends = [dict(zip(names, corner, strict=True)) for corner in product(*(axis[[0, -1]].tolist() for axis in axes))]
    solver = ModesAt(model, at, names, limits, [at(end) for end in ends], say)

    # the grid, and cells halved where a mode may cross within
    shape, step = (len(axes[0]), len(axes[1])), 2**halvings
    nodes = Nodes(axes, step, solver)
    nodes.add(product(range(0, step * shape[0], step), range(0, step * shape[1], step)))
    grid = [[nodes[step * i, step * j] for j in range(shape[1])] for i in range(shape[0])]
    say("the borders")
    lines = joined(leaves(nodes, grid, step), nodes)

    # the result
    def each(figure: str) -> Array:
        return np.array([[getattr(one, figure) for one in row] for row in grid])

    evidence = str(getattr(model, "evidence", NOT_CHECKED))
    cutoff = np.inf if band is not None and not np.isnan(model.cutoff) else model.cutoff
    result = StabilityMap((names[0], names[1]), (axes[0], axes[1]), each("number"), each("growth"), each("omega"),
                          undecided=each("undecided") > 0, radius=each("radius"), borders=tuple(lines), spots=(), band=limits,
                          solved=solver.solved, cutoff=cutoff, evidence=evidence)
    if full is not None:
        far = result.radius if np.isfinite(result.radius).any() else each("nearness")
        found: list[Spot] = []
        places: list[Node] = []
        for flat in np.argsort(-far, axis=None, kind="stable"):
            place = divmod(int(flat), shape[1])
            if len(found) == spots or any(max(abs(place[k] - one[k]) / shape[k] for k in (0, 1)) < 0.1 for one in places):
                continue
            places.append(place)
            p = (float(axes[0][place[0]]), float(axes[1][place[1]]))
            say(f"the full model at {names[0]} = {p[0]:.4g}, {names[1]} = {p[1]:.4g}")
            small = grid[place[0]][place[1]]
            whole = point_modes(modes_in(full_at(dict(zip(names, p, strict=True))), limits), limits)
            agrees = small.number <= whole.number + whole.undecided and whole.number <= small.number + small.undecided
            found.append(Spot(p, small.number, whole.number, small.growth, whole.growth, small.radius, agrees))
        result = replace(result, spots=tuple(found))
    log.info("%r", result)
    return result
