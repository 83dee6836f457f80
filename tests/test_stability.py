"""The border of stability: DESIGN's table, its four traps, and two ways that must agree."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from scipy.linalg import null_space

import femsub as fs
from benchmarks.attacks.borders import twins
from benchmarks.lattices import lattice
from femsub.modes.quadratic.dense import modal_form
from femsub.modes.receptance import port_responses
from femsub.stability.border import dense_border

TABLE = {  # belt: full, HCB and CC with 5 DOF; d1 = 0.1, interface {m1}
    1: (-0.100000, -0.100000, -0.100000), 2: (-0.025567, -0.025634, -0.025567), 3: (-0.011799, -0.011792, -0.011799),
    4: (-0.006999, -0.006993, -0.006999), 5: (-0.004801, -0.004801, -0.004801), 6: (-0.003633, -0.003635, -0.003633),
}


def models(sub: fs.Substructure, modes: int = 4) -> list[fs.Substructure]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return [sub, fs.reduce(sub, fs.CraigBampton(modes)), fs.reduce(sub, fs.CraigChang(modes))]


@pytest.mark.parametrize("belt", TABLE)
def test_table_of_critical_slopes(belt: int) -> None:
    for model, expected in zip(models(fs.chain(10, belt=belt)), TABLE[belt], strict=True):
        assert round(float(fs.critical_slope(model)), 6) == expected


def test_errors_with_the_belt_under_m2() -> None:
    full, hcb, cc = (float(fs.critical_slope(model)) for model in models(fs.chain(10, belt=2)))
    assert 100 * abs(hcb / full - 1) == pytest.approx(0.27, abs=0.005)
    assert 100 * abs(cc / full - 1) < 0.001
    full, hcb, cc = (float(fs.critical_slope(model)) for model in models(fs.chain(10, belt=2, interface=(1, 2)), 3))
    assert abs(hcb / full - 1) == pytest.approx(9e-7, abs=1e-7) and abs(cc / full - 1) < 1e-8


@pytest.mark.sampled(8)
@pytest.mark.parametrize("belt", range(1, 11))
@pytest.mark.parametrize("n", [10, 33])
def test_the_two_ways_agree_and_the_pencil_confirms(belt: int, n: int) -> None:
    for model in models(fs.chain(n, belt=belt)):
        root, bracket = (fs.critical_slope(model, method=method) for method in ("scalar", "bracketing"))
        assert float(root) == pytest.approx(float(bracket), rel=1e-9)
        band = (0.0, min(model.cutoff, 9.0))
        before, after = (fs.complex_modes(model, fs.Belt(slope=root.value * factor), band=band).growth
                         for factor in (0.999, 1.001))
        assert before < 0 < after
        x = root.shape
        pencil = model.linearised(fs.Belt(slope=root.value))
        assert pencil.backward_error(np.array([1j * root.omega]), x[:, None])[0] < 1e-12


def test_crossings_packed_near_the_top_of_the_spectrum() -> None:
    border = fs.critical_slope(fs.chain(100, belt=2))
    # by mpmath with 60 digits: c = -0.024776507748196382543 at ω = 1.9997556185252546187
    assert border.value == pytest.approx(-0.024776507748196382543, rel=1e-12)
    assert border.omega == pytest.approx(1.9997556185252546187, rel=1e-12)
    low = fs.critical_slope(fs.chain(100, belt=2), band=(0.0, 1.0))
    assert low.value < border.value and low.omega < 1.0


@pytest.mark.parametrize("n", [400, 3000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_sparse_model_with_a_band(n: int) -> None:
    border = fs.critical_slope(fs.chain(n, belt=2), band=(0.0, 10 / n))
    # first order in d1: c = -d1 / (4 cos²(π/(2n + 1))), the next term is of the order of d1² ω²
    assert border.value == pytest.approx(-0.1 / (4 * np.cos(np.pi / (2 * n + 1)) ** 2), rel=1e-7)
    assert border.growth[0] < 0 < border.growth[1]
    if n == 400:
        # by mpmath: -0.025000383611889742032 at ω = 0.0039220856936240334
        assert border.value == pytest.approx(-0.025000383611889742, rel=1e-11)
        assert border.omega == pytest.approx(0.0039220856936240334, rel=1e-11)


@pytest.mark.slow
def test_the_first_of_many_close_borders_in_a_reduced_long_chain() -> None:
    # c_j = -d1 / (4 cos²θ_j): the second border is 2e-9 behind the first, whose resonance is 1e-11 wide, relatively
    sub = fs.chain(100_000, belt=2, interface=(1, 2))
    for modes in (14, 19):
        border = fs.critical_slope(fs.reduce(sub, fs.CraigChang(modes)), band=(0.0, 3e-4))
        assert border.omega == pytest.approx(fs.chain_frequencies(100_000, 1)[0], rel=1e-9)
        assert border.value == pytest.approx(-0.025000000006153, rel=1e-11)


def test_all_pairs_cross_together_where_the_damping_vanishes() -> None:
    border = fs.critical_slope(fs.chain(10, belt=1))
    assert border.value == pytest.approx(-0.1, rel=1e-12) and len(border.crossing) == 10
    assert np.allclose(border.crossing, fs.chain_frequencies(10), rtol=1e-9)
    assert float(fs.critical_slope(fs.chain(10, belt=1), force=2.0)) == pytest.approx(-0.05, rel=1e-12)


def test_without_damping_the_border_is_at_zero() -> None:
    assert float(fs.critical_slope(fs.chain(10, belt=4, damping=0.0))) == 0.0
    assert float(fs.critical_slope(fs.chain(3000, belt=4, damping=0.0), band=(0.0, 0.01))) == 0.0


def test_a_dashpot_at_a_node_leaves_a_mode_undamped() -> None:
    # fixed at m1, n = 7: mode 3 (2j - 1 = 5) has a node where sin(5kπ/15) = 0, at m3 and m6
    dashpot = np.zeros(7)
    dashpot[2] = 0.1
    K, M = fs.chain(7).K, fs.chain(7).M
    border = fs.critical_slope(fs.Substructure(M, K, np.diag(dashpot), ports={"belt": np.eye(7)[0]}))
    assert border.value == 0.0 and border.omega == pytest.approx(2 * np.sin(5 * np.pi / 30), rel=1e-10)
    # a belt on the same node does not feel that mode
    felt = fs.critical_slope(fs.Substructure(M, K, np.diag(dashpot), ports={"belt": np.eye(7)[2]}))
    assert felt.value == pytest.approx(-0.1, rel=1e-9)


@pytest.mark.parametrize("belt", [2, 3, 6])
def test_antiresonances_are_no_borders(belt: int) -> None:
    # the masses right of the belt, fixed at it: at their frequencies the belt's mass stands still whatever c is
    sub = fs.chain(10, belt=belt)
    for omega in fs.chain_frequencies(10 - belt):
        band = (0.9999 * omega, 1.0001 * omega)
        assert fs.critical_slope(sub, band=band).value == -np.inf


def test_never_lost_and_unstable_from_the_start() -> None:
    sub = fs.chain(10, belt=2)
    assert fs.critical_slope(sub, band=(0.2, 0.3)).value == -np.inf
    assert "never lost" in repr(fs.critical_slope(sub, band=(0.2, 0.3)))
    for model in (sub, fs.chain(400, belt=2)):
        unstable = fs.Substructure(model.M, model.K, -0.1 * model.M, ports=model.ports)
        with pytest.raises(fs.UnstableModelError, match="unstable before the belt acts: λ = "):
            fs.critical_slope(unstable, band=(0.0, 0.5))


def test_a_rom_s_own_high_modes_do_not_decide() -> None:
    sub = fs.chain(10, belt=3, interface=(1, 3))
    rom = fs.reduce(sub, fs.CraigChang(3))
    # DESIGN: lost at c ≈ 0 in a mode the full model has not
    artefact = fs.critical_slope(fs.Substructure(rom.M, rom.K, rom.D, ports=rom.ports))
    assert artefact.value > -1e-4 and artefact.omega > rom.cutoff
    assert float(fs.critical_slope(rom)) == pytest.approx(float(fs.critical_slope(sub)), rel=1e-8)
    assert fs.critical_slope(rom).band == (0.0, rom.cutoff)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(3))
def test_lattice_with_proportional_damping_against_brute_force(seed: int) -> None:
    plain = lattice(5, 4, held=True, seed=seed)
    sub = fs.Substructure(plain.M, plain.K, 0.01 * plain.M + 0.002 * plain.K, ports=plain.ports)
    border = fs.critical_slope(sub)

    def growth(c: float) -> float:
        return float(fs.complex_modes(sub, fs.Belt(slope=c)).eigenvalues.real.max())

    lo, hi = 2 * border.value, 0.0
    for _ in range(40):  # to 1e-12
        middle = (lo + hi) / 2
        lo, hi = (middle, hi) if growth(middle) > 0 else (lo, middle)
    assert border.value == pytest.approx(lo, rel=1e-9)


def test_two_columns_are_bracketed() -> None:
    sub = fs.chain(10)
    W = np.eye(10)[:, [1, 4]]
    both = fs.Substructure(sub.M, sub.K, sub.D, ports={"belt": W})
    border = fs.critical_slope(both)
    assert border.method == "bracketing"
    D = sub.D.toarray() + border.value * W @ W.T
    assert np.abs(fs.complex_modes(fs.Pencil(sub.M, D, sub.K)).eigenvalues.real.max()) < 1e-12
    with pytest.raises(ValueError, match="2 columns"):
        fs.critical_slope(both, method="scalar")


def test_sweep_changes_sign_at_the_border() -> None:
    for model in models(fs.chain(10, belt=2)):
        border = float(fs.critical_slope(model))
        found = fs.sweep(model, fs.Belt(slope=0.0), "slope", [0.0, 0.99 * border, 1.01 * border, -0.2677])
        assert (np.sign(found.growth) == [-1, -1, 1, 1]).all()
        exact = fs.complex_modes(model, fs.Belt(slope=-0.2677)).growth
        assert found.growth[-1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
def test_growth_faster_than_the_band_is_found_in_large_models_or_told() -> None:
    """Far beyond the border a pair has become two real λ, the larger of which leaves what a search in the band looks at."""
    sub = fs.damped(fs.chain(610, belt=501, interface=range(1, 610, 2)), rayleigh=(1e-5, 1e-3))
    rom, slopes = fs.reduce(sub, fs.CraigBampton(modes=5)), [-0.01, -3.0]
    assert rom.size > 300
    every = fs.complex_modes(rom, fs.Belt(slope=-3.0)).eigenvalues
    found = fs.sweep(rom, fs.Belt(slope=0.0), "slope", slopes, band=(0.0, 0.3))
    assert found.growth[1] == pytest.approx(every.real.max(), rel=1e-9) and found.growth[1] > 1
    assert 0 < found.growth[0] < 0.01
    for n in (80, 310):
        mass = np.where(np.arange(n) % 7 == 3, 0.0, 1.0)
        chain = fs.chain(n, belt=31)
        bare = fs.Substructure(np.diag(mass), chain.K, 1e-3 * chain.K, ports=chain.ports)
        every = fs.complex_modes(bare, fs.Belt(slope=-3.0)).eigenvalues
        assert fs.sweep(bare, fs.Belt(slope=0.0), "slope", [-3.0], band=(0.0, 0.3)).growth[0] == \
            pytest.approx(every.real.max(), rel=1e-9)
    large = fs.damped(fs.chain(2100, belt=501), rayleigh=(1e-5, 1e-3))
    with pytest.warns(fs.FemsubWarning, match="slope of -3 and below, max Re λ may be larger .*0.02"):
        fs.sweep(large, fs.Belt(slope=0.0), "slope", [-3.0], band=(0.0, 0.02))


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [0, 2, 9])
def test_drift_of_a_large_model_is_known_from_its_rigid_motion_however_its_basis_grows(seed: int) -> None:
    """Rounding beside the zeros of a grown basis took rigid motion for elastic; drift lies where ZᵀDZ + c ZᵀwwᵀZ is singular."""
    plain = lattice(25, 5, seed=seed)
    n, rng = plain.size, np.random.default_rng(seed)
    D = 1e-3 * plain.M + sp.csr_array(([0.5], ([37], [37])), shape=(n, n))
    w = np.zeros(n)
    w[rng.choice(n, 4, replace=False)] = rng.uniform(0.2, 1.0, 4)
    sub = fs.Substructure(plain.M, plain.K, D, ports={"belt": w})
    band = (0.0, 0.6)
    found, exact = fs.critical_slope(sub, band=band), dense_border(sub.pencil, w[:, None], band)  # the latter of all modes
    assert found.value == pytest.approx(exact.c, rel=1e-8) and found.omega == pytest.approx(exact.omega, rel=1e-6)
    Z = null_space(plain.K.toarray())
    drift = -1 / (w @ Z @ np.linalg.solve(Z.T @ D @ Z, Z.T @ w))
    assert found.value >= drift * (1 + 1e-8) and (found.omega > 0 or found.value == pytest.approx(drift, rel=1e-8))


def test_edges_of_a_band_cost_a_large_model_one_decomposition_of_its_basis(monkeypatch: pytest.MonkeyPatch) -> None:
    sub, taken = fs.damped(fs.chain(2100, belt=2), rayleigh=(1e-4, 1e-3)), []
    own = scipy.linalg.eig
    monkeypatch.setattr(scipy.linalg, "eig", lambda *args, **options: taken.append(len(args[0])) or own(*args, **options))
    assert fs.critical_slope(sub, band=(0.01, 0.05)).value == -np.inf
    assert len(taken) == 2  # one for both edges, one for the border


def test_sweep_of_a_sparse_model() -> None:
    sub = fs.chain(2500, belt=2)
    found = fs.sweep(sub, fs.Belt(slope=0.0), "slope", [-0.0125, -0.05], band=(0.0, 0.01))
    assert found.growth[0] < 0 < found.growth[1]
    with pytest.raises(ValueError, match="needs a band"):
        fs.sweep(sub, fs.Belt(slope=0.0), "slope", [-0.01])


def test_refusals() -> None:
    sub = fs.chain(10)
    for options, words in (({"port": "bolt"}, "did you mean 'belt'"), ({"force": 0.0}, "force must be positive"),
                           ({"method": "guess"}, "unknown method 'guess'"), ({"band": (2.0, 1.0)}, "0 <= lo < hi")):
        with pytest.raises(ValueError, match=words):
            fs.critical_slope(sub, **options)
    with pytest.raises(ValueError, match="3000 DOF needs a band"):
        fs.critical_slope(fs.chain(3000))
    with pytest.raises(TypeError, match=r"model must be a Substructure \(with a port\)"):
        fs.critical_slope(sub.pencil)
    with pytest.raises(TypeError, match=r"model must be a Substructure \(or an Affine\)"):
        fs.sweep(sub.pencil, fs.Belt(slope=0.0), "slope", [-0.1])
    with pytest.raises(ValueError, match="unstable before the belt acts"):
        fs.critical_slope(fs.Substructure(sub.M, sub.K, -sub.D, ports=sub.ports))
    with pytest.raises(ValueError, match="M is singular"):
        fs.critical_slope(fs.Substructure(np.diag([1.0, 0.0]), np.eye(2), ports={"belt": [1.0, 0]}))
    assert sp.issparse(sub.K)


@pytest.mark.parametrize("slower", [1e9, 1e12])
def test_units_of_time_change_no_digit(slower: float) -> None:
    sub = fs.chain(6, belt=2)
    other = fs.Substructure(slower * sub.M, sub.K / slower, sub.D, [0], sub.ports)
    assert float(fs.critical_slope(other)) == pytest.approx(float(fs.critical_slope(sub)), rel=1e-13)


@pytest.mark.parametrize(("belt", "slope"), [(2, -0.025), (4, -0.00769946320925)])
def test_heavy_masses_do_not_hide_the_damping_of_light_ones(belt: int, slope: float) -> None:
    sub = fs.chain(6, belt=belt, masses=np.where(np.arange(6) % 2, 1e12, 1.0))
    assert float(fs.critical_slope(sub)) == pytest.approx(slope, rel=1e-8)


def test_a_heavy_dashpot_leaves_the_slope_or_takes_its_digits() -> None:
    held = -0.271533  # times 1/d: the dashpot holds m1, and what is left of its power falls with 1/d
    for damping in (1e2, 1e3, 1e4):
        assert float(fs.critical_slope(fs.chain(6, belt=2, damping=damping))) * damping == pytest.approx(held, rel=1e-3)
    with pytest.raises(fs.NotConvergedError, match="rounding may move the border"):
        fs.critical_slope(fs.chain(6, belt=2, damping=1e7))
    with pytest.raises(fs.NotConvergedError, match="lost in the rounding of a dashpot"):
        fs.critical_slope(fs.chain(6, belt=2, damping=1e11))


def test_damping_that_is_rounding_counts_as_none() -> None:
    assert float(fs.critical_slope(fs.chain(6, belt=2, damping=1e-13))) == 0.0
    assert float(fs.critical_slope(fs.chain(6, belt=2, damping=1e-12))) == pytest.approx(-2.65188e-13, rel=1e-5)


def test_the_hardly_damped_mode_of_a_light_mass_decides() -> None:
    # passed over, the next border would be -0.0287, at which the light mass has λ = 3e10 already
    assert abs(float(fs.critical_slope(fs.chain(6, belt=2, masses=np.where(np.arange(6) % 2, 1e-12, 1.0))))) < 1e-12


def reach() -> fs.Substructure:
    """The README's beam, n = 300: an elastic foundation packs its frequencies just above ω = 316."""
    n = 300
    K = sp.diags_array([np.full(n - 2, 1.0), np.full(n - 1, -4.0), np.full(n, 6.0 + 1e-4), np.full(n - 1, -4.0),
                        np.full(n - 2, 1.0)], offsets=[-2, -1, 0, 1, 2]) * 1e6
    return fs.Substructure(1e-3 * sp.eye_array(n), K, 1e-6 * K, interface=[0, n // 3, n - 1], ports={"belt": np.eye(n)[n // 3]})


@pytest.mark.parametrize("method", [fs.CraigBampton(6), fs.CraigChang(6)], ids=["HCB", "CC"])
def test_a_band_that_reaches_above_the_cut_off_is_refused(method: fs.CraigBampton | fs.CraigChang) -> None:
    rom = fs.reduce(reach(), method)
    above = (0.0, 2.0 * rom.cutoff)
    belt = fs.Belt(slope=0.0)
    for ask in (lambda: fs.critical_slope(rom, band=above), lambda: fs.sweep(rom, belt, "slope", [-0.1], band=above),
                lambda: fs.complex_modes(rom, band=above), lambda: fs.complex_modes(rom.linearised(belt), band=above),
                lambda: fs.critical_value(rom, belt, "slope", between=(0.0, -0.1), band=above),
                lambda: fs.track(rom, belt, "slope", [-0.1, 0.0], band=above), lambda: fs.normal_modes(rom, band=above),
                lambda: fs.study(rom, [fs.CraigBampton(2)], band=above)):
        with pytest.raises(ValueError, match=f"cut-off of .*{rom.cutoff:.6g}"):
            ask()
    modes = fs.complex_modes(rom)  # listed, but marked, and the verdict says up to where it goes
    assert modes.above_cutoff.any() and f"up to the cut-off {rom.cutoff:.4g}" in repr(modes)
    assert "up to the cut-off" in repr(fs.critical_value(rom, belt, "slope", between=(0.0, -0.1)))
    assert "1 of them above the cut-off" in repr(fs.frequency_response(rom, at=np.array([0.5, 2.0]) * rom.cutoff, loads=[0]))
    for band in (None, (0.0, rom.cutoff)):
        assert fs.sweep(rom, belt, "slope", [-0.1], band=band).band == (0.0, rom.cutoff)


@pytest.mark.slow
def test_a_border_next_to_the_cut_off_is_warned_of() -> None:
    sub = reach()
    exact = fs.critical_slope(sub)
    rom = fs.reduce(sub, fs.CraigBampton(3))
    band = (0.0, 320.0)
    with pytest.warns(fs.CutoffWarning, match="no border was found"):
        assert fs.critical_slope(rom, band=band).value == -np.inf
    assert exact.omega < band[1] < rom.cutoff  # but the full model has one
    near = fs.reduce(sub, fs.CraigChang(6))
    with pytest.warns(fs.CutoffWarning, match="the border at ω = 31.* lies above 0.7 of the cut-off"):
        assert float(fs.critical_slope(near)) == pytest.approx(float(exact), rel=0.1)
    enough = fs.reduce(sub, fs.CraigChang(10))
    assert float(fs.critical_slope(enough)) == pytest.approx(float(exact), rel=1e-3)  # without a warning


EDGES = [("dense", 10, 2), ("dense", 10, 5), ("dense", 10, 10), ("dense", 33, 9), ("dense", 33, 17), ("sparse", 400, 2),
         ("sparse", 400, 7), ("sparse", 3000, 3)]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("kind", "n", "belt"), EDGES)
@pytest.mark.parametrize("method", ["auto", "bracketing"])
def test_a_border_on_an_edge_of_the_band_belongs_to_it(kind: str, n: int, belt: int, method: str) -> None:
    sub = fs.chain(n, belt=belt)
    whole = fs.critical_slope(sub, band=None if kind == "dense" else (0.0, 10 / n))
    for band in ((whole.omega, 3 * whole.omega), (0.3 * whole.omega, whole.omega)):
        found = fs.critical_slope(sub, band=band, method=method)
        assert found.value == pytest.approx(whole.value, rel=1e-8) and found.omega == pytest.approx(whole.omega, rel=1e-8)


def test_two_columns_and_an_edge() -> None:
    sub = fs.chain(10)
    both = fs.Substructure(sub.M, sub.K, sub.D, ports={"belt": np.eye(10)[:, [1, 4]]})
    whole = fs.critical_slope(both)
    for band in ((whole.omega, 3 * whole.omega), (0.3 * whole.omega, whole.omega)):
        assert fs.critical_slope(both, band=band).value == pytest.approx(whole.value, rel=1e-8)


def drifting(n: int, alpha: float, beta: float = 0.05) -> fs.Substructure:
    return fs.damped(fs.chain(n, belt=10, damping=0.0, fixed=False), rayleigh=(alpha, beta))


@pytest.mark.parametrize("method", ["auto", "bracketing"])
@pytest.mark.parametrize("reduced", [False, True])
def test_rigid_motion_that_loses_its_damping_first(method: str, reduced: bool) -> None:
    sub = drifting(10, 1e-4)
    model = fs.reduce(sub, fs.CraigChang(6), ports=True) if reduced else sub
    border = fs.critical_slope(model, method=method)
    # uniform motion of ten unit masses: λ(10 λ + 10 α + c) = 0
    assert border.value == pytest.approx(-1e-3, rel=1e-9) and border.omega == 0.0 and list(border.crossing) == [0.0]
    assert border.growth == pytest.approx((-1e-7, 1e-7), rel=1e-5)
    assert border.losses[0].kind == "divergence"
    u = model.expand(border.shape) if reduced else border.shape
    assert np.allclose(u, u[0])
    elastic = fs.critical_slope(model, method=method, band=(1e-3, 1.0))
    assert elastic.omega == pytest.approx(2 * np.sin(np.pi / 20), rel=1e-3) and elastic.value < -0.02


@pytest.mark.parametrize("n", [10, 400])
@pytest.mark.parametrize("reduced", [False, True])
def test_rigid_motion_without_damping_drifts_with_any_falling_slope(n: int, reduced: bool) -> None:
    sub = drifting(n, 0.0)
    model = fs.reduce(sub, fs.CraigChang(6), ports=True) if reduced else sub
    border = fs.critical_slope(model, band=(0.0, 2.5 / n))
    assert border.value == 0.0 and border.omega == 0.0


def test_drift_of_a_large_model_and_together_with_pairs() -> None:
    border = fs.critical_slope(drifting(3000, 1e-6, 5.0), band=(0.0, 0.01))
    assert border.value == pytest.approx(-3e-3, rel=1e-7) and border.omega == 0.0 and border.growth[0] < 0 < border.growth[1]
    # a dashpot under the belt: there all damping vanishes together, that of rigid motion, too
    together = fs.critical_slope(fs.chain(10, belt=1, fixed=False))
    assert together.value == pytest.approx(-0.1, rel=1e-9) and together.omega == 0.0 and len(together.crossing) == 10
    assert "9 more cross with it" in repr(together)


def test_two_columns_on_rigid_motion() -> None:
    sub = drifting(10, 1e-4)
    both = fs.Substructure(sub.M, sub.K, sub.D, ports={"belt": np.eye(10)[:, [2, 6]]})
    assert fs.critical_slope(both).value == pytest.approx(-5e-4, rel=1e-9)


def test_a_sweep_of_a_model_with_massless_dof_takes_its_complex_modes() -> None:
    M, K = np.diag([1.0, 0.0, 1.0, 0.0, 2.0]), 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    sub = fs.Substructure(M, K, 0.02 * K, interface=[0], ports={"belt": np.array([0.0, 1.0, 0.0, 0.5, 0.0])})
    slopes = [-0.03, -0.02, -0.001]
    for model in (sub, fs.reduce(sub, fs.CraigBampton(2), ports=True)):
        found = fs.sweep(model, fs.Belt(slope=0.0), "slope", slopes)
        for slope, growth in zip(slopes, found.growth, strict=True):
            assert growth == pytest.approx(fs.complex_modes(model, fs.Belt(slope=slope)).growth, rel=1e-9)
        with pytest.raises(fs.InputError, match="needs a regular M"):
            fs.critical_slope(model)


@pytest.mark.parametrize("unsymmetric", [False, True])
def test_what_harmonic_forces_move_is_the_same_dense_sparse_and_in_modes(unsymmetric: bool) -> None:
    sub = lattice(5, 4, held=True, seed=1)
    K = sub.K + (0.1 * sp.diags_array(np.ones(sub.size - 3), offsets=3) if unsymmetric else 0 * sub.K)
    pencil, W = fs.Pencil(sub.M, 0.02 * sub.M + 0.01 * sub.K, sp.csr_array(K)), np.eye(sub.size)[:, [3, 8]]
    form = modal_form(pencil.dense())
    assert form is not None
    for s in (0.0, 0.7j, -0.1 + 1.3j):
        x, y = port_responses(pencil, s, W)
        assert np.abs(pencil.at(s) @ x - W).max() < 1e-12 and np.abs(pencil.at(s).T @ y - W).max() < 1e-12
        assert (np.abs(x - y).max() > 1e-3) == unsymmetric
        for ours, theirs in zip((x, y), port_responses(pencil.dense(), s, W), strict=True):
            assert np.abs(ours - theirs).max() < 1e-12
        w = form.shapes.T @ W
        assert np.abs(W.T @ x - w.T @ np.linalg.solve(form.at(s), w)).max() < 1e-12
    held = fs.Pencil(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 4.0]))
    with pytest.raises(fs.SingularMatrixError, match="singular at s = 0\\+1j"):
        port_responses(held, 1j, np.ones((2, 1)))


@pytest.mark.parametrize(("kind", "seeds"), [("twin beams", 8), ("joined", 2), ("tolerance", 2), ("free interface", 2)])
def test_a_border_that_twin_frequencies_move_is_told(kind: str, seeds: int) -> None:
    """Two beams of nearly one frequency on a foot: no slope is off by more than 3.5 % of the full model's without a warning."""
    outcomes = [twins(kind, seed) for seed in range(seeds)]
    assert not [one for one in outcomes if one.startswith("wrong") or one == "needless"]
    assert "told" in outcomes or kind != "twin beams"


def test_a_wider_model_has_the_border_of_the_full_one() -> None:
    """Twins whose ω differ by 3.5e-4: the slope is 11 % off, and 1 % at most with the responses to the residuals of the modes."""
    size = 38
    M, K = np.zeros((size, size)), np.zeros((size, size))
    for at, E in ((np.arange(20), 1.0), (np.r_[0:2, 20:38], 1.0007)):
        part = fs.beam(1.0, 9, E=E, I=1.0, rho=1.0, A=1.0)
        M[np.ix_(at, at)] += part.M.toarray()
        K[np.ix_(at, at)] += part.K.toarray()
    M[[0, 1], [0, 1]] += 0.2, 0.01
    K[[0, 1], [0, 1]] += 50.0, 500.0
    D = 1e-4 * M
    D[36, 36] += 0.02
    full = fs.Substructure(M, K, D, interface=[0, 1], ports={"belt": np.eye(size)[18]}, name="twins")
    rom = fs.reduce(full, fs.CraigBampton(6), ports=True)
    band = (0.0, 0.69 * rom.cutoff)
    exact = fs.critical_slope(full, band=band).value
    with pytest.warns(fs.CutoffWarning, match=r"the border of 'twins' moves by 1\d\.\d% .* residuals of its modes"):
        found = fs.critical_slope(rom, band=band).value
    assert abs(found / exact - 1) > 0.1
    modes = fs.normal_modes(rom, count=8)
    assert rom.wider is not None
    wide = rom.wider(rom, modes.frequencies, modes.shapes, "belt")
    assert wide is not None and np.array_equal(wide.K[:rom.size, :rom.size], rom.K)
    assert fs.critical_slope(wide, band=band).value == pytest.approx(exact, rel=1e-2)
    assert pickle.loads(pickle.dumps(rom)).wider is None
    with pytest.warns(fs.CutoffWarning, match="moves by"):  # contacts beside the belt act on the wider model, too
        fs.critical_slope(rom, band=band, contacts=fs.LinearContact("belt", damping=[[1e-4]]))
