"""Maps over two parameters: borders in closed form, islands and folds within cells, numbers against dense solutions, spots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import FrozenInstanceError, replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.output import draw
from femsub.stability import stability_map_chart, stability_map_tables
from femsub.stability.margins import between

D = 0.1  # damping of the pairs below
SQUARE = {"x": (0.0, 1.0), "y": (0.0, 1.0)}
Field = Callable[[float, float], float]


def pairs(*fields: Field, gap: float = 1.0) -> fs.Affine:
    """Two modes of ω² = k each, k = 1, 1 + gap, ...: λ² + Dλ + k ± ig = 0 with g = D√k + f(x, y) grows where f > 0, at ω² = k."""
    n = 2 * len(fields)
    k = np.repeat(1.0 + gap * np.arange(len(fields)), 2)
    terms: list[Any] = [(1.0, np.diag(k))]
    for at, f in enumerate(fields):
        skew = np.zeros((n, n))
        skew[2 * at, 2 * at + 1], skew[2 * at + 1, 2 * at] = 1.0, -1.0
        terms.append((lambda x, y, f=f, k=k[2 * at]: D * k**0.5 + max(f(x, y), -0.9 * D), skew))
    return fs.Affine(np.eye(n), D * np.eye(n), terms)


def random_family(seed: int, n: int = 12, damping: float = 0.01) -> fs.Affine:
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(1, n, n))
    skew, load = rng.standard_normal((n, n)), rng.standard_normal((n, 3))
    K = [(1.0, np.diag(omega**2)), ("x", skew - skew.T), ("y", load @ load.T)]
    return fs.Affine(np.eye(n), np.diag(2 * damping * omega), K)


def grown(model: fs.Affine, at: Mapping[str, float], band: tuple[float, float] | None = None) -> int:
    modes = fs.complex_modes(model.at(**at), band=band)
    return sum(modes.eigenvalues[i].imag >= 0 for i in modes.unstable)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("radius", [0.35, 0.12, 0.045, 0.02])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_island_is_a_closed_line_also_within_a_cell(radius: float, sign: float) -> None:
    """Where x² + y² is small about (0.54, 0.55) it grows, or is stable alone; cells are 0.1 wide."""
    found = fs.stability_map(pairs(lambda x, y: sign * (radius**2 - (x - 0.54)**2 - (y - 0.55)**2)), SQUARE, points=(11, 11))
    line, = found.borders
    assert line.closed and (line.points[0] == line.points[-1]).all() and len(line.points) > 4
    assert np.abs(np.hypot(*(line.points - [0.54, 0.55]).T) - radius).max() < 2e-7
    assert line.omega == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("radius", [0.47, 0.2])
def test_an_island_in_a_wide_cell_between_narrow_ones_is_found(radius: float) -> None:
    """Differences of values at unequal distances are no curvature: for a parabola about 0.5 they are 0 at 0.02 and 0.98."""
    model = fs.Affine([[1]], [(lambda x, y: ((x - 0.5)**2 + (y - 0.5)**2) / radius**2 - 1, [[0.1]])], [[1]])
    axis = [0.0, 0.02, 0.98, 1.0]
    line, = fs.stability_map(model, {"x": axis, "y": axis}).borders
    assert line.closed and np.hypot(*(line.points - 0.5).T) == pytest.approx(radius, rel=1e-5)


def test_a_small_island_of_a_model_without_halving_is_not_seen() -> None:
    model = pairs(lambda x, y: 0.02**2 - (x - 0.54)**2 - (y - 0.55)**2)
    assert not fs.stability_map(model, SQUARE, points=(11, 11), halvings=0).borders


@pytest.mark.parametrize("tip", [0.583, 0.515])
def test_a_fold_that_passes_one_edge_twice_is_found(tip: float) -> None:
    """The tip of x = tip + 40 (y - 0.55)² is between two points of the grid, at which nothing grows."""
    found = fs.stability_map(pairs(lambda x, y: 0.01 * (x - tip - 40 * (y - 0.55)**2)), SQUARE, points=(11, 11))
    line, = found.borders
    assert not line.closed and line.points[:, 0].min() < tip + 0.02
    assert np.abs(line.points[:, 0] - tip - 40 * (line.points[:, 1] - 0.55)**2).max() < 1e-5


@pytest.mark.parametrize("level", [1e-3, -1e-3])
def test_two_lines_of_one_mode_in_a_cell_do_not_touch(level: float) -> None:
    """The hyperbola (x - 0.55)(y - 0.55) = -level has two branches, on the same side of the cell's middle each."""
    found = fs.stability_map(pairs(lambda x, y: (x - 0.55) * (y - 0.55) + level), SQUARE, points=(11, 11))
    assert len(found.borders) == 2
    for line in found.borders:
        product = (line.points - 0.55).prod(axis=1)
        assert np.abs(product + level).max() < 1e-6 and len(np.unique(np.sign(line.points[:, 0] - 0.55))) == 1


def test_lines_of_two_modes_cross_and_stay_apart() -> None:
    found = fs.stability_map(pairs(lambda x, y: x - 0.37, lambda x, y: y - 0.61), SQUARE, points=(8, 9))
    lines = sorted(found.borders, key=lambda line: line.omega[0])
    assert len(lines) == 2 and found.number.max() == 2
    assert lines[0].points[:, 0] == pytest.approx(0.37, abs=1e-6) and lines[0].omega == pytest.approx(1.0, abs=1e-6)
    assert lines[1].points[:, 1] == pytest.approx(0.61, abs=1e-6) and lines[1].omega == pytest.approx(2**0.5, abs=1e-6)
    assert [sorted(line.points[[0, -1], 1 - at]) for at, line in enumerate(lines)] == [[0.0, 1.0]] * 2


@pytest.mark.parametrize("strip", [0.02, -0.02])
def test_modes_that_change_places_between_two_points_have_a_border_each(strip: float) -> None:
    """One ceases to grow at x = 0.55 + strip, another begins at 0.55 - strip: one grows at each point of the grid."""
    model = pairs(lambda x, y: 0.55 + strip - x, lambda x, y: x - 0.55 + strip)
    found = fs.stability_map(model, SQUARE, points=(11, 5))
    assert (found.number == 1).all() and len(found.borders) == 2
    for line, x, omega in zip(sorted(found.borders, key=lambda line: line.omega[0]), (0.55 + strip, 0.55 - strip), (1.0, 2**0.5),
                              strict=True):
        assert line.points[:, 0] == pytest.approx(x, abs=1e-6) and line.omega == pytest.approx(omega, abs=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("points", [(31, 21), (30, 20)])
def test_undamped_modes_grow_where_they_coalesce(points: tuple[int, int]) -> None:
    """K = [[1, y], [-y, 2 + x]] has complex λ² where 2|y| > |1 + x|. Some points of the first grid are on that border."""
    pair = fs.Affine(np.eye(2), None, [(1.0, np.diag([1.0, 2.0])), ("x", np.diag([0.0, 1.0])), ("y", [[0, 1], [-1, 0]])])
    found = fs.stability_map(pair, {"x": (-2.0, 1.0), "y": (0.0, 2.0)}, points=points)
    x, y = np.meshgrid(*found.values, indexing="ij")
    beside = np.abs(2 * y - np.abs(1 + x)) > 1e-9
    assert (found.number == (2 * y > np.abs(1 + x)))[beside].all() and not found.undecided[beside].any()
    line, = found.borders
    assert np.abs(2 * line.points[:, 1] - np.abs(1 + line.points[:, 0])).max() < 1e-6
    assert line.omega**2 == pytest.approx(1.5 + line.points[:, 0] / 2, abs=1e-5)


def test_a_border_takes_few_eigenproblems() -> None:
    """None beside those of the grid with damping, where Newton's method finds it; some for each place without."""
    line, = (found := fs.stability_map(pairs(lambda x, y: 0.3 * (x**2 - 0.37**2)), SQUARE, points=(12, 9))).borders
    assert found.solved == 12 * 9 and len(line.points) == 9
    pair = fs.Affine(np.eye(2), None, [(1.0, np.diag([1.0, 2.0])), ("x", np.diag([0.0, 1.0])), ("y", [[0, 1], [-1, 0]])])
    line, = (found := fs.stability_map(pair, {"x": (0.0, 1.0), "y": (0.0, 2.0)}, points=(12, 9), halvings=0)).borders
    assert found.solved < 12 * 9 + 7 * len(line.points)


def test_no_point_on_an_edge_leaves_it_by_rounding() -> None:
    ends = np.random.default_rng(1).uniform(0, 1, (1000, 2, 2))
    ends[:, 1, 0] = ends[:, 0, 0]
    for pair, t in zip([[[0.8, 0.0], [0.8, 1.0]], *ends], [0.2, *np.random.default_rng(2).uniform(0, 1, 1000)], strict=True):
        place, pair = between(np.array(pair), t), np.array(pair)
        assert place[0] == pair[0, 0] and pair[:, 1].min() <= place[1] <= pair[:, 1].max()


@pytest.mark.parametrize("damping", [None, 0.2 * np.eye(2)])
def test_divergence_has_no_frequency(damping: Any) -> None:
    model = fs.Affine(np.eye(2), damping, [(1.0, np.diag([1.0, 9.0])), ("x", np.diag([-1.0, 0])), ("y", np.diag([-1.0, 0]))])
    line, = fs.stability_map(model, {"x": (0.0, 0.9), "y": (0.0, 0.8)}, points=(6, 7)).borders
    assert line.points.sum(axis=1) == pytest.approx(1.0, abs=1e-6) and not line.omega.any()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(4))
def test_numbers_and_borders_are_those_of_dense_solutions(seed: int) -> None:
    model, rng = random_family(seed), np.random.default_rng(seed)
    found = fs.stability_map(model, {"x": (0.0, 2.0), "y": (0.0, 8.0)}, points=(21, 17))
    assert found.number.max() > 1 and found.borders
    for i, j in zip(rng.integers(0, 21, 30), rng.integers(0, 17, 30), strict=True):
        modes = fs.complex_modes(model.at(x=found.values[0][i], y=found.values[1][j]))
        assert found.number[i, j] == grown(model, {"x": found.values[0][i], "y": found.values[1][j]})
        assert found.growth[i, j] == pytest.approx(modes.growth, rel=1e-6)
        assert found.omega[i, j] == pytest.approx(abs(modes.eigenvalues[modes.eigenvalues.real.argmax()].imag), rel=1e-6)
    places = [(line.points[at], line.omega[at]) for line in found.borders for at in range(len(line.points))]
    for at in rng.integers(0, len(places), 30):
        (x, y), omega = places[at]
        assert np.abs(np.linalg.eigvals(state(model.at(x=x, y=y))) - 1j * omega).min() < 1e-5 * omega
    # between neighbours the number changes by the borders that pass between them
    for i, j in zip(rng.integers(0, 20, 30), rng.integers(0, 17, 30), strict=True):
        y, ends = found.values[1][j], found.values[0][i:i + 2]
        passed = [x for (x, at), omega in places if at == y and ends[0] <= x <= ends[1]]
        assert len(passed) >= abs(int(found.number[i + 1, j]) - int(found.number[i, j]))
        assert (len(passed) - int(found.number[i + 1, j]) + int(found.number[i, j])) % 2 == 0


    # a line ends at the edge of the map
    ends = np.array([line.points[at] for line in found.borders for at in (0, -1) if not line.closed]).reshape(-1, 2)
    assert np.minimum(ends, [2.0, 8.0] - ends).min(axis=1) == pytest.approx(0.0, abs=1e-12)


def state(pencil: fs.Pencil) -> np.ndarray:
    zero, one = np.zeros_like(pencil.M), np.eye(pencil.size)
    return np.block([[zero, one], [-np.linalg.solve(pencil.M, pencil.K), -np.linalg.solve(pencil.M, pencil.D)]])


def test_a_mode_counts_in_the_band_alone() -> None:
    """ω² = 1 + y of the mode that grows for x > 0.5 leaves the band at y = 0.44; the border ends there, and goes up at 1.2."""
    terms = [(lambda x: D * 1.2 + D * (x - 0.5), [[0, 1], [-1, 0]]), (1.0, np.eye(2)), ("y", np.eye(2))]
    model, band = fs.Affine(np.eye(2), D * np.eye(2), terms), (0.5, 1.2)
    found = fs.stability_map(model, SQUARE, points=(7, 8), band=band)
    for (i, j), number in np.ndenumerate(found.number):
        assert number == grown(model, {"x": found.values[0][i], "y": found.values[1][j]}, band)
    places = [(*place, omega) for line in found.borders for place, omega in zip(line.points, line.omega, strict=True)]
    axis = [(x, y) for x, y, omega in places if omega < 1.2 - 1e-4]
    assert axis and all(1.2 + x - 0.5 == pytest.approx((1 + y)**0.5, abs=1e-5) for x, y in axis)
    leaves = [(x, y) for x, y, omega in places if omega > 1.2 - 1e-6]
    assert leaves
    for x, y in leaves:
        values = np.linalg.eigvals(state(model.at(x=x, y=y)))
        assert np.abs(values.imag - 1.2).min() < 1e-5


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stiffness", [4.0, 0.0])
def test_a_mode_that_neither_grows_nor_decays_is_undecided_unless_it_is_rigid(stiffness: float) -> None:
    """A third DOF without damping, which rounding moves to either side of the axis, beside a pair."""
    pair = pairs(lambda x, y: x + y - 0.9)
    M, D3, K = (np.pad(A, (0, 1)) for A in (pair.M[0][1], pair.D[0][1], pair.K[0][1]))
    M[2, 2], K[2, 2] = 1.0, stiffness
    turned = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    terms = [(1.0, turned.T @ K @ turned), (pair.K[1][0], turned.T @ np.pad(pair.K[1][1], (0, 1)) @ turned)]
    found = fs.stability_map(fs.Affine(turned.T @ M @ turned, turned.T @ D3 @ turned, terms), SQUARE, points=(5, 4))
    assert (found.number == (np.add.outer(*found.values) > 0.9)).all() and (found.undecided == (stiffness > 0)).all()
    line, = found.borders
    assert line.points.sum(axis=1) == pytest.approx(0.9, abs=1e-5) and line.omega == pytest.approx(1.0, abs=1e-5)


@pytest.mark.slow
def test_fields_of_contacts_are_parameters() -> None:
    """c = force · slope, which the chain with its belt under m2 takes up to -0.025567."""
    chain = fs.chain(10, belt=2)
    found = fs.stability_map(chain, {"slope": (-0.03, -0.01), "force": (0.5, 2.0)}, contacts=fs.Belt(slope=0.0), points=(6, 5))
    critical = float(fs.critical_slope(chain))
    first = max(found.borders, key=lambda line: line.points.prod(axis=1).max())
    assert first.points.prod(axis=1) == pytest.approx(critical, rel=1e-5)
    assert (found.number[np.outer(*found.values) > critical] == 0).all()


@pytest.mark.slow
def test_a_large_model_is_solved_in_a_band() -> None:
    chain = fs.chain(320, belt=2)
    found = fs.stability_map(chain, {"slope": (-0.05, -0.01), "force": (0.5, 1.0)}, contacts=fs.Belt(slope=0.0), points=(2, 2),
                             band=(0.0, 0.03), halvings=0)
    for i, j in ((0, 0), (0, 1)):
        modes = fs.complex_modes(chain, fs.Belt(slope=found.values[0][i], force=found.values[1][j]), band=(0.0, 0.03))
        assert found.number[i, j] == len(modes.unstable) and found.growth[i, j] == pytest.approx(modes.growth, rel=1e-6)


# ---- a reduced model that knows its error


class Box(fs.Affine):
    """A model of a box of parameters, λ of which are wrong by 1e-3 |λ| at most, most of all at (0.8, 0.2)."""

    evidence = "from its box"

    def at(self, **p: float) -> fs.Pencil:
        if not all(0.0 <= value <= 1.0 for value in p.values()):
            raise fs.InputError(f"{p} is outside its box")
        return super().at(**p)

    def modes(self, **p: float) -> fs.ComplexModes:
        found = fs.complex_modes(self.at(**p))
        radius = np.abs(found.eigenvalues) * 1e-3 / (1 + (p["x"] - 0.8)**2 + (p["y"] - 0.2)**2)
        return replace(found, error_bar=radius)

    def eigenvalues(self, p: dict[str, float]) -> tuple[np.ndarray, np.ndarray, bool]:
        found = self.modes(**p)
        upper = found.eigenvalues.imag >= 0
        return found.eigenvalues[upper], found.error_bar[upper], True


def test_a_radius_decides_and_places_the_spots() -> None:
    exact = pairs(lambda x, y: x - 0.42)
    small, off = Box(exact.M, exact.D, exact.K), pairs(lambda x, y: x - 0.42 if y < 0.5 else -0.05)
    found = fs.stability_map(small, SQUARE, points=(11, 7), full=off, spots=3)
    assert found.evidence == small.evidence and found.radius.max() == pytest.approx(1e-3, rel=0.01)
    assert found.radius[8, 1] == found.radius.max()
    # Re λ of x = 0.4 and x = 0.5 is -0.01 and 0.04
    assert not found.undecided.any() and (found.number == (found.values[0] > 0.42)[:, None]).all()
    line, = found.borders
    assert line.points[:, 0] == pytest.approx(0.42, abs=1e-2)
    assert found.spots[0].at == (found.values[0][8], found.values[1][1]) and found.spots[0].agrees
    assert found.spots[0].radius == found.radius.max() and len(found.spots) == 3
    apart = np.array([one.at for one in found.spots])
    assert min(np.abs(one - other).max() for one, other in combinations(apart, 2)) > 0.1
    # a grid of which some points are nearer to the border than the radius allows
    near = fs.stability_map(small, {"x": np.linspace(0.4199, 0.4201, 5), "y": (0.0, 1.0)}, points=(2, 4), full=off, spots=4)
    assert near.undecided.all() and near.undecided_share == 1.0 and not near.number.any() and not near.borders


def test_spots_that_differ_are_listed() -> None:
    exact = pairs(lambda x, y: x - 0.42)
    small, off = Box(exact.M, exact.D, exact.K), pairs(lambda x, y: x - 0.42 if y < 0.1 else -0.05)
    found = fs.stability_map(small, SQUARE, points=(11, 7), full=off, spots=2)
    assert not found.spots[0].agrees and (found.spots[0].number, found.spots[0].full_number) == (1, 0)
    assert "of 2 spots differ" in repr(found)
    assert found.spots[0].full_growth < 0 < found.spots[0].growth


def test_spots_of_a_model_without_a_radius_are_next_to_the_axis() -> None:
    model = pairs(lambda x, y: x - 0.42)
    found = fs.stability_map(model, SQUARE, points=(11, 11), full=model, spots=3)
    assert all(one.agrees and one.at[0] == found.values[0][4] and np.isnan(one.radius) for one in found.spots)


# ---- input


@pytest.mark.parametrize(("over", "options", "says"), [
    ({"x": (0, 1)}, {}, "a map is over two parameters, but over has 1"),
    ({"x": (0, 1), "y": (0, 1), "z": (0, 1)}, {}, "but over has 3"),
    ({"x": (0, 1), "why": (0, 1)}, {}, "unknown parameter 'why'"),
    ([("x", (0, 1)), ("x", (0, 1))], {}, "over must be a dict"),
    ({"x": (0, 1), "y": (1, 1)}, {}, r"over\['y'\] must be a range"),
    ({"x": (0, 1), "y": 3.0}, {}, r"over\['y'\] must be a range"),
    ({"x": [0.0, 0.5, 0.5], "y": (0, 1)}, {}, r"over\['x'\] must be a range"),
    ({"x": (0, np.nan), "y": (0, 1)}, {}, "NaN or Inf"),
    (SQUARE, {"points": (1, 5)}, "points must be at least 2"),
    (SQUARE, {"points": (5,)}, "two numbers of values"),
    (SQUARE, {"halvings": -1}, "halvings must be at least 0"),
    (SQUARE, {"band": (2.0, 1.0)}, "band"),
    (SQUARE, {"contacts": fs.Belt(slope=0.0)}, "no ports for contacts"),
    (SQUARE, {"full": fs.Affine(np.eye(2), None, [(1.0, np.eye(2))])}, "unknown parameter 'x'")])
def test_wrong_input_is_refused_by_name(over: Any, options: dict[str, Any], says: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=says):
        fs.stability_map(pairs(lambda x, y: x - y), over, **options)


def test_values_outside_the_box_of_a_model_are_refused_before_the_work() -> None:
    said: list[str] = []
    exact = pairs(lambda x, y: x - y)
    with pytest.raises(fs.InputError, match=r"'y': 1\.1.* is outside its box"):
        fs.stability_map(Box(exact.M, exact.D, exact.K), {"x": (0.0, 1.0), "y": (0.0, 1.1)}, progress=said.append)
    assert not said


def test_other_parameters_must_have_values() -> None:
    model = fs.Affine(np.eye(2), None, [(1.0, np.eye(2)), ("x", np.eye(2)), ("y", np.eye(2)), ("z", np.eye(2))])
    with pytest.raises(fs.InputError, match=r"z must have values: give model\.fixed"):
        fs.stability_map(model, SQUARE)


def test_values_may_be_given_and_progress_is_reported() -> None:
    said: list[str] = []
    over = {"x": [0.0, 0.9, 0.2], "y": (0, 1)}
    found = fs.stability_map(pairs(lambda x, y: x - 0.3), over, points=(5, 4), progress=said.append)
    assert found.values[0].tolist() == [0.0, 0.2, 0.9] and found.number.shape == (3, 4)
    assert "12 of 12 points" in said and "the borders" in said
    line, = found.borders
    assert line.points[:, 0] == pytest.approx(0.3, abs=1e-6)
    assert "\n" not in repr(found) and repr(found).startswith("StabilityMap: x from 0 to 0.9, y from 0 to 1, 12 points; up to 1")
    with pytest.raises(FrozenInstanceError):
        found.solved = 0  # type: ignore[misc]


# ---- its chart and its tables


def test_a_map_has_a_chart_and_tables() -> None:
    model = pairs(lambda x, y: x - 0.42, lambda x, y: y - 0.61)
    found = fs.stability_map(model, SQUARE, points=(9, 8), full=model, spots=2)
    found = replace(found, undecided=found.number > 1)
    chart = stability_map_chart("map", {"η = 1": found, "η = 2": found}, "Title", ("x  [-]", "y  [-]"))
    figure = draw(chart)
    axes = [axis for axis in figure.axes if axis.get_subplotspec() is not None and axis.get_visible()]
    assert [axis.get_title() for axis in axes[:2]] == ["growing modes, η = 1", "largest growth, η = 1"]
    assert {"border", "full model agrees", "undecided"} <= {*axes[0].get_legend_handles_labels()[1]}
    assert axes[0].collections[0].get_array().reshape(8, 9).tolist() == found.number.T.tolist()
    assert {axis.get_ylabel() for axis in figure.axes} >= {"growing modes", "max Re λ  [1/time]"}
    plain = chart.plain()["places"]
    assert [len(place["panels"]) for place in plain] == [2, 2]
    assert plain[0]["panels"][1]["heat"]["z"] == found.number.T.astype(float).tolist()
    points, borders, spots = stability_map_tables("map", found)
    assert [points.name, borders.name, spots.name] == ["map", "map-borders", "map-spots"] and len(points.rows) == 72
    assert points.rows[9] == {"x": found.values[0][1], "y": found.values[1][1], "growing_modes": 0, "undecided": False,
                              "growth": found.growth[1, 1], "omega": found.omega[1, 1], "radius": points.rows[9]["radius"]}
    assert [row["border"] for row in borders.rows] == [at for at, line in enumerate(found.borders, 1) for _ in line.omega]
    assert "yes" in spots.text()
