"""Probabilities of instability against closed forms, enclosures and labels against dense solutions, families, inputs."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy import stats

import femsub as fs
from femsub.checks import FemsubWarning, InputError, InputTypeError
from femsub.output import draw
from femsub.stability.labels import SeenMode, sources_of
from femsub.stability.leaves import Companion, Middle
from femsub.stability.mode_families import grouped
from femsub.stability.scatter_chart import scatter_chart, scatter_tables

FIRST, SECOND = 2 * np.pi * 100, 2 * np.pi * 75
CRITICAL = abs(FIRST**2 - SECOND**2) / (2 * FIRST * SECOND)  # of Hultén's plane model without damping
LAWS = {"normal": stats.norm(0.28, 0.03), "uniform": stats.uniform(0.2, 0.2), "lognormal": stats.lognorm(0.2, scale=0.27)}


def hulten(*eta: float) -> fs.Affine:
    """Two modes that friction couples (Hultén 1993): K = [[ω₁², -μω₂²], [μω₁², ω₂²]], D = diag(η_i ω_i)."""
    D = np.diag([eta[0] * FIRST, eta[1] * SECOND]) if eta else None
    return fs.Affine(np.eye(2), D, [(1.0, np.diag([FIRST**2, SECOND**2])), ("mu", [[0.0, -SECOND**2], [FIRST**2, 0.0]])])


def hurwitz(first: float, second: float, mu: np.ndarray) -> np.ndarray:
    """Whether s⁴ + a s³ + b s² + c s + d has a root on the right, by Hurwitz: stable if abc > c² + a²d, all positive."""
    p, q = first * FIRST, second * SECOND
    a, b, c = p + q, FIRST**2 + SECOND**2 + p * q, p * SECOND**2 + q * FIRST**2
    d = (1 + mu**2) * FIRST**2 * SECOND**2
    return np.asarray(a * b * c < c**2 + a**2 * d)


def random_family(seed: int, n: int = 6) -> fs.Affine:
    """Damped modes with circulatory, gyroscopic and symmetric terms of two parameters."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(1, 6, n))
    skew, turn, load = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    return fs.Affine(np.eye(n), [(1.0, np.diag(0.05 * omega)), (reciprocal, 0.02 * (turn - turn.T))],
                     [(1.0, np.diag(omega**2)), ("x", 0.5 * (skew - skew.T)), (product, 0.3 * load @ load.T)])


@dataclass(frozen=True)
class Rubbing:
    """The motion of p pushes q with μ, and that of q pushes p back."""

    mu: float = 0.0
    ports: tuple[str, ...] = ("p", "q")
    affine: ClassVar[tuple[str, ...]] = ("mu",)

    def linearised(self, model: Any) -> tuple[Any, Any]:
        return None, self.mu * np.array([[0.0, 1.0], [-1.0, 0.0]])


def reciprocal(y: float) -> float:
    return 1 / y


def product(x: float, y: float) -> float:
    return x * y


@pytest.mark.sampled(3)
@pytest.mark.parametrize("law", LAWS)
def test_the_probability_of_hulten_s_model_is_within_its_interval(law: str) -> None:
    """Undamped: P(μ > μ_c) in closed form. Damped: Hurwitz at the samples themselves, and their probability."""
    exact = LAWS[law].sf(CRITICAL)
    found = [fs.scatter(hulten(), {"mu": LAWS[law]}, samples=128, seed=seed) for seed in range(3)]
    assert all(one.interval[0] <= exact <= one.interval[1] for one in found)
    damped = fs.scatter(hulten(0.01, 0.03), {"mu": LAWS[law]}, samples=1024)
    assert (damped.verdict == np.where(hurwitz(0.01, 0.03, damped.samples[:, 0]), 1, -1)).all()
    assert damped.evidence == "confirmed" and damped.solved < len(damped.samples) / 10


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.parametrize(("law", "repetitions"), [(law, 20 if at else 60) for at, law in enumerate(LAWS)])
def test_the_interval_holds_in_95_percent_of_repetitions(law: str, repetitions: int) -> None:
    exact = LAWS[law].sf(CRITICAL)
    mu = np.linspace(0.0, 1.0, 200001)
    border = mu[hurwitz(0.02, 0.01, mu)][0]
    found = [(fs.scatter(model, {"mu": LAWS[law]}, samples=32, seed=seed).interval, p) for seed in range(repetitions)
             for model, p in ((hulten(), exact), (hulten(0.02, 0.01), LAWS[law].sf(border)))]
    inside = [lo <= p <= hi for (lo, hi), p in found]
    assert min(sum(inside[::2]), sum(inside[1::2])) >= 0.95 * repetitions


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(4))
def test_labels_of_enclosures_are_those_of_dense_solutions(seed: int) -> None:
    family = random_family(seed)
    found = fs.scatter(family, {"x": stats.uniform(0.0, 2.0), "y": stats.uniform(0.5, 1.0)}, samples=256, importance=False)
    for (x, y), verdict, growth in zip(found.samples[::4], found.verdict[::4], found.growth[::4], strict=True):
        modes = fs.complex_modes(family.at(x=x, y=y))
        top = modes.eigenvalues.real.max()
        assert verdict == 0 or verdict == np.sign(top)
        assert growth == pytest.approx(top, abs=0.3)  # the centre of an enclosure that need only be on one side of the axis
    assert np.mean(found.verdict == 0) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_enclosures_hold(seed: int) -> None:
    """Each vote is the sign of an eigenvalue, and a disc that is clear of all others has one eigenvalue."""
    family = random_family(seed + 10)
    terms = [[np.asarray(A) for _, A in part] for part in (family.M, family.D, family.K)]
    linear, rng = Companion.of(*terms), np.random.default_rng(seed)
    decided = 0
    for h in (0.2, 0.05, 0.01):
        place = np.array([rng.uniform(0.2, 1.5), rng.uniform(0.6, 1.4)])
        here = family.factors(x=place[0], y=place[1])
        points = place + h * rng.uniform(-1, 1, (20, 2))
        changes = np.array([family.factors(x=x, y=y) for x, y in points]) - here
        middle = Middle.of(linear, here)
        assert middle is not None
        around = middle.around(changes, np.eye(len(here))[[2, 4, 5]])
        every = np.arange(len(middle.z))
        values, votes, radius = around.votes(changes, every, np.zeros(len(every)))
        if not np.isfinite(around.F).all():
            continue
        alone = np.isfinite(around.radii()[0])
        for (x, y), centres, signs in zip(points, values, votes, strict=True):
            P = family.at(x=x, y=y)
            A = np.block([[np.zeros((6, 6)), np.eye(6)], [-P.K, -P.D]])
            far = np.abs(np.linalg.eigvals(A)[:, None] - centres)
            assert ((far <= radius + 1e-9).sum(axis=0)[alone] == 1).all()
            if (signs != 2).all():
                decided += 1
                assert (signs > 0).sum() == (np.linalg.eigvals(A).real > 0).sum()
    assert decided


def test_two_families_are_found_and_their_probabilities_are_in_closed_form() -> None:
    """Two pairs that do not act on each other grow where x, or y, is above 1/2."""
    K = np.diag([1.0, 1.0, 4.0, 4.0])
    first, second = np.zeros((2, 4, 4))
    first[0, 1], first[1, 0], second[2, 3], second[3, 2] = 1.0, -1.0, 1.0, -1.0
    model = fs.Affine(np.eye(4), 0.1 * np.eye(4), [(1.0, K), ("x", 0.2 * first), ("y", 0.4 * second)])
    found = fs.scatter(model, {"x": stats.uniform(), "y": stats.uniform(0.0, 2 / 3)}, samples=2048)
    assert [round(one.omega.mean()) for one in found.families] == [1, 2]
    for one, p in zip(found.families, (1 / 2, 1 / 4), strict=True):
        assert one.interval[0] <= p <= one.interval[1] and one.undecided == 0
    assert found.interval[0] <= 1 - 1 / 2 * 3 / 4 <= found.interval[1]
    # of 1 - (1 - a)(1 - b) with probabilities a, b: first indices by hand
    a, b, whole = 1 / 2, 1 / 4, 5 / 8 * 3 / 8
    first_order = np.array([a * (1 - a) * (1 - b)**2, b * (1 - b) * (1 - a)**2]) / whole
    assert np.abs(found.importance.first - first_order).max() < 0.15
    assert np.abs(found.importance.total - first_order - (1 - first_order.sum())).max() < 0.15
    assert found.tornado()[0, 0] < found.tornado()[0, 1] == 1
    chart = scatter_chart("scatter", found, "Title")
    draw(chart)
    assert [table.name for table in scatter_tables("s", found)] == ["s-families", "s-inputs", "s"]
    assert len(chart.panels[0].series) == 2
    never = fs.scatter(model.fixed(y=0.0), {"x": stats.uniform(0.0, 0.1)}, samples=16)
    assert not never.families
    assert [panel.title for panel in scatter_chart("scatter", never, "Title").panels] == ["inputs"]


def test_correlated_inputs_have_their_correlation_and_their_probability() -> None:
    """x + y grows above 1: normal with the variance s² + t² + 2ρst."""
    model = fs.Affine(np.eye(2), 0.1 * np.eye(2), [(1.0, np.eye(2)), ("x", [[0, 0.1], [-0.1, 0]]), ("y", [[0, 0.1], [-0.1, 0]])])
    C = np.array([[0.04, -0.03], [-0.03, 0.09]])
    found = fs.scatter(model, {"x": stats.norm(0.5, 0.2), "y": stats.norm(0.4, 0.3)}, covariance=C, samples=2048)
    assert np.cov(found.samples.T) == pytest.approx(C, abs=0.005)
    p = stats.norm(0.9, np.sqrt(C.sum())).sf(1.0)
    assert found.interval[0] <= p <= found.interval[1]
    assert np.corrcoef(stats.rankdata(found.samples, axis=0).T)[0, 1] < -0.3
    singular = fs.scatter(model, {"x": stats.norm(0.5, 0.2), "y": stats.norm(0.4, 0.3)}, covariance=[[1, 1], [1, 1]], samples=64)
    assert np.ptp((singular.samples[:, 0] - 0.5) / 0.2 - (singular.samples[:, 1] - 0.4) / 0.3) < 1e-6


def test_samples_outside_a_box_are_undecided_and_the_bound_is_named() -> None:
    chain = fs.chain(60, belt=5)
    small = fs.reduce(chain, fs.ParameterBox({"slope": (-0.02, 0.0)}, band=(0.0, 0.5)), contacts=fs.Belt(slope=0.0))
    law = stats.uniform(-0.024, 0.024)
    with pytest.warns(FemsubWarning, match=r"16\..* of slope beyond the lower bound -0.02"):
        found = fs.scatter(small, {"slope": law}, samples=256)
    assert found.outside == pytest.approx(4 / 24, abs=0.01) and found.undecided >= found.outside
    for slope, verdict in zip(found.samples[::16, 0], found.verdict[::16], strict=True):
        if slope < -0.02:
            assert verdict == 0
        else:
            stable = small.modes(slope=slope).is_stable
            assert verdict == {True: -1, False: 1, None: 0}[stable] or verdict == 0
    assert found.interval[1] - found.interval[0] > found.outside
    assert found.evidence == "confirmed" and found.solved < 64


@pytest.mark.slow
def test_labels_over_a_box_are_those_of_the_full_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three parameters: a field of a contact, a material and a spring. Most samples are not solved for themselves."""
    beam = fs.beam(1.0, 20, E=1.0, I=1.0, rho=1.0, A=1.0, supports={0.0: "clamped"}, rayleigh=(0.5, 0.0),
                   ports={"p": (0.5, "w"), "q": (1.0, "w")})
    rubbing = Rubbing(mu=0.5)
    changes = {"E": fs.MaterialChange.beam(1.0, 20, "E", E=1.0, I=1.0, rho=1.0, A=1.0), "tip": fs.AddedSpring("q")}
    ranges = {"mu": (30.0, 90.0), "E": (0.8, 1.2), "tip": (0.0, 3.0)}
    full = fs.family_of(beam, rubbing, list(ranges), ranges, changes=changes)
    small = fs.reduce(full, fs.ParameterBox(ranges, band=(0.0, 80.0)))
    laws = {name: stats.uniform(lo, hi - lo) for name, (lo, hi) in ranges.items()}
    found = fs.scatter(small, laws, samples=1024, importance=False)
    assert small.evidence == "certified" and found.evidence == "confirmed"
    assert 0.1 < found.probability < 0.9 and found.undecided < 0.01 and found.solved < 0.5 * len(found.samples)
    whole = sources_of(small)
    assert len(whole) == len(small.cells) and all(source.error is not None for source in whole)
    monkeypatch.setattr(import_module("femsub.stability.scatter"), "sources_of",
                        lambda _: [one._replace(error=lambda *_: 0.1) for one in whole])
    coarse = fs.scatter(small, laws, samples=64, importance=False)  # an error that decides nothing leaves all to solutions
    assert coarse.undecided == 0 and coarse.solved > 64
    for i in np.argsort(np.abs(found.growth))[:60]:  # those nearest to the axis
        modes = fs.complex_modes(full.at(**dict(zip(ranges, found.samples[i].tolist(), strict=True))), band=(0.0, 80.0))
        assert found.verdict[i] in (0, np.sign(modes.eigenvalues.real.max()))


def test_a_real_eigenvalue_that_passes_0_has_no_share_of_its_size_as_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    """λ = 0 in the middle of the range: an error of 30 % of the largest |λ| leaves samples about it to solutions."""
    door = fs.Affine(np.eye(1), 4 * np.eye(1), [(1.0, np.eye(1)), ("p", -np.eye(1))])
    small = fs.reduce(door, fs.ParameterBox({"p": (0.5, 1.5)}, band=(0.0, 6.0)))
    source, = sources_of(small)
    monkeypatch.setattr(import_module("femsub.stability.scatter"), "sources_of", lambda _: [source._replace(
        error=lambda *_: 0.3)])
    found = fs.scatter(small, {"p": stats.uniform(0.5, 1.0)}, samples=256)
    assert found.solved > 8 and found.undecided < 0.05
    certain = found.verdict != 0
    assert (found.verdict[certain] == np.where(found.samples[certain, 0] > 1, 1, -1)).all()


def cancelled(x: float) -> float:
    return x - x


def test_a_parameter_that_cancels_leaves_every_verdict_as_it_is() -> None:
    for damping, grows in ((0.1, 0.0), (-0.1, 1.0)):
        alone = fs.Affine(np.eye(2), damping * np.eye(2), [(1.0, np.diag([1.0, 2.0])), (cancelled, np.ones((2, 2)))])
        found = fs.scatter(alone, {"x": stats.norm(0.0, 1.0)}, samples=64)
        assert found.probability == grows and found.undecided == 0.0


def test_motion_without_stiffness_has_a_family_of_its_own() -> None:
    one = np.ones(1)  # λ is 0 within rounding, or exactly
    nodes = [SeenMode(np.array([x]), value, one, one) for x, value in enumerate((1e-16 + 0j, 0j, 0j, -1e-16 + 0j))]
    assert grouped(nodes, one).tolist() == [0, 0, 0, 0]


def test_a_model_whose_cutoff_is_not_known_is_not_checked() -> None:
    chain = fs.chain(40, belt=5)
    family = fs.family_of(chain, fs.Belt(slope=0.0), ["slope"], {"slope": (-0.02, 0.0)})
    rough = family.reduced(np.linalg.qr(np.random.default_rng(0).standard_normal((40, 20)))[0])
    small = fs.reduce(rough, fs.ParameterBox({"slope": (-0.02, 0.0)}, band=(0.0, 0.5)))
    for model in (rough, small):
        found = fs.scatter(model, {"slope": stats.uniform(-0.02, 0.02)}, samples=32, band=(0.0, 0.5))
        assert found.evidence == "not checked"


def test_fields_of_contacts_scatter_as_well_and_a_seed_repeats() -> None:
    chain, law = fs.chain(5, belt=2), stats.norm(-0.03, 0.01)
    belt = fs.Belt(slope=-0.01)
    found, again = (fs.scatter(chain, {"slope": law}, contacts=belt, samples=128, seed=3) for _ in range(2))
    assert (found.samples == again.samples).all() and (found.verdict == again.verdict).all()
    critical = float(fs.critical_slope(chain, "belt"))
    assert (found.verdict == np.where(found.samples[:, 0] < critical, 1, -1)).all()


@pytest.mark.parametrize(("changes", "error", "words"), [
    ({"inputs": {"nu": stats.norm()}}, InputError, "nu"),
    ({"inputs": {}}, InputError, "no parameter"),
    ({"inputs": {"mu": 0.3}}, InputTypeError, "frozen distribution"),
    ({"inputs": {"mu": stats.norm}}, InputTypeError, "frozen distribution"),
    ({"covariance": [[2.0]]}, InputError, "diagonal of covariance"),
    ({"covariance": np.eye(2)}, InputError, "1 rows"),
    ({"confidence": 1.0}, InputError, "confidence"),
    ({"samples": 0}, InputError, "samples"),
])
def test_what_is_wrong_is_named(changes: dict[str, Any], error: type[Exception], words: str) -> None:
    given: dict[str, Any] = {"inputs": {"mu": stats.norm(0.3, 0.1)}, **changes}
    with pytest.raises(error, match=words):
        fs.scatter(hulten(0.01, 0.01), given.pop("inputs"), **given)
