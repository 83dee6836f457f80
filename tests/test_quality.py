"""Criteria for reduced models under self-excitation: what they say of the paper's chain, and what they mean."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.modes import match
from femsub.motion.self_excitation import CRITERIA, table_rows

BELT = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=1e-3))
FULL = fs.chain(10, belt=2, damping=0.1)


def reduced(method: Any, size: int, full: fs.Substructure = FULL) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(full, method(size - len(full.interface)))


def with_basis(full: fs.Substructure, V: np.ndarray, K: np.ndarray | None = None) -> fs.ReducedSubstructure:
    M, stiff, D = (V.T @ (A.toarray() if sp.issparse(A) else A) @ V for A in (full.M, full.K, full.D))
    ports = {name: V.T @ w for name, w in full.ports.items()}
    return fs.ReducedSubstructure(M, stiff if K is None else K, D, ports, "by hand", V=V.copy(), kinds=["free"] * V.shape[1],
                                  full_interface=full.interface, cutoff=np.inf, method="by hand")


@pytest.mark.parametrize("method", [fs.CraigBampton, fs.CraigChang])
def test_a_complete_basis_lacks_nothing(method: Any) -> None:
    found = fs.self_excitation(FULL, reduced(method, 10), BELT)
    assert len(found.growing) == 8 and not len(found.missing) and not len(found.spurious)
    assert all(abs(getattr(found, name)) < 1e-11 for name in CRITERIA)
    assert found.verdict.startswith("the same motions are expected: all 8 growing modes are there, growth rates within")
    assert np.abs(found.mac - 1).max() < 1e-10 and found.band is None


@pytest.mark.slow
def test_the_papers_models_of_five_dof_lack_half_of_what_grows() -> None:
    for method in (fs.CraigBampton, fs.CraigChang):
        found = fs.self_excitation(FULL, reduced(method, 5), BELT)
        assert found.missing.imag == pytest.approx([1.6510, 1.8008, 1.9060, 1.9742], abs=1e-3)
        assert found.missing_share == 0.5 and not len(found.spurious) and found.spurious_share == 0
        assert found.verdict.startswith("other motions are expected: 4 of 8 growing modes are missing (ω = 1.651, 1.801, ")


@pytest.mark.slow
def test_a_residual_shape_that_grows_is_spurious_and_no_mode_of_the_full_model() -> None:
    worse = fs.self_excitation(FULL, reduced(fs.CraigChang, 8), BELT)
    better = fs.self_excitation(FULL, reduced(fs.CraigBampton, 8), BELT)
    assert worse.spurious.imag == pytest.approx([1.835], abs=1e-3) and len(worse.missing) == 3
    assert "other motions" in worse.verdict and "1 spurious mode grows (ω = 1.835)" in worse.verdict
    assert "may be the same, but not all coexisting ones: 2 of 8 growing modes are missing" in better.verdict
    # 1.835 lies within 2 % of 1.801: it is the shape that tells
    assert 0.6 < worse.mac[5] < 0.75 and abs(worse.growing[5].imag - 1.801) < 1e-3
    assert not len(better.spurious) and len(better.missing) == 2
    assert better.growth_distance < 0.5 * worse.growth_distance
    assert worse.compliance_mean < better.compliance_mean  # which therefore does not tell
    assert repr(worse).startswith("SelfExcitation: 3 of 8 growing modes missing, 1 spurious")


def test_growth_distance_adds_up() -> None:
    found = fs.self_excitation(FULL, reduced(fs.CraigBampton, 7), BELT)
    whole = fs.complex_modes(FULL, BELT).eigenvalues
    growing = whole[(whole.real > 0) & (whole.imag > 0)].real.sum()
    paired = found.counterpart.real > 0
    change = np.abs(found.counterpart[paired].real - found.growing[paired].real).sum()
    assert found.growth_distance == pytest.approx((found.missing.real.sum() + found.spurious.real.sum() + change) / growing)
    assert found.spurious_share == pytest.approx(found.spurious.real.sum() / growing)
    assert found.growth_error == pytest.approx(np.nanmax(np.abs(found.counterpart.real / found.growing.real - 1)))
    assert found.projection_loss == pytest.approx(found.growing.real @ found.loss / growing)


@pytest.mark.parametrize("method", [fs.CraigBampton, fs.CraigChang])
def test_static_compliance_is_off_by_the_square_of_the_port_error(method: Any) -> None:
    rom = reduced(method, 5)  # Galerkin: h - h_r is the energy of the error
    found = fs.self_excitation(FULL, rom, BELT)
    assert found.compliance_static == pytest.approx(rom.port_error["belt"] ** 2, rel=1e-9)


def test_loss_and_mac_are_taken_in_energy() -> None:
    M = np.diag([2.0, 1.0, 5.0])
    full = fs.Substructure(M, M @ np.diag([1.0, 1.1, 9.0]), ports={"belt": [1.0, 1.0, 0.0]})
    belt, V = fs.Belt(slope=-0.2), np.array([[1.0], [0.3], [0.0]])
    found = fs.self_excitation(full, with_basis(full, V), belt, omega=[0.5])
    modes = fs.complex_modes(full, belt)
    keep = modes.eigenvalues.imag > 0
    shapes = modes.shapes[:, keep][:, np.argsort(modes.eigenvalues[keep].imag)][:, :2]
    energy = np.einsum("ij,ij->j", shapes.conj(), M @ shapes).real
    cosine = np.abs(V[:, 0] @ M @ shapes) ** 2 / ((V[:, 0] @ M @ V[:, 0]) * energy)  # with one column they are one thing
    assert found.loss == pytest.approx(1 - cosine, abs=1e-12)
    assert np.nanmax(found.mac) == pytest.approx(cosine.max(), abs=1e-12) and cosine.min() > 0.01


@pytest.mark.slow
def test_shapes_decide_where_frequencies_are_close() -> None:
    full = fs.Substructure(np.eye(2), np.diag([1.0, 1.02]) ** 2, ports={"belt": [0.1, 0.2]})
    swapped = with_basis(full, np.eye(2), np.diag([1.021, 1.001]) ** 2)
    found = fs.self_excitation(full, swapped, fs.Belt(slope=-0.1))
    assert found.counterpart.imag == pytest.approx([1.021, 1.001], abs=1e-3)
    assert found.mac.min() > 0.95 and not len(found.missing) and not len(found.spurious)
    bare = fs.Substructure(np.eye(3), np.diag([1.021, 1.001, 9.0]) ** 2, ports={"belt": [0.1, 0.2, 0.0]})
    found = fs.self_excitation(full, bare, fs.Belt(slope=-0.1))  # without a basis there are frequencies only
    assert found.counterpart.imag == pytest.approx([1.001, 1.021], abs=1e-3)
    assert np.isnan(found.mac).all() and np.isnan(found.loss).all() and np.isnan(found.projection_loss)


@pytest.mark.slow
def test_a_mode_that_decays_is_missing_and_one_that_grows_instead_spurious() -> None:
    full = fs.Substructure(np.eye(2), np.diag([1.0, 4.0]), np.diag([0.0, 0.02]), ports={"belt": [0.1, 0.1]})
    other = fs.Substructure(np.eye(2), np.diag([1.0, 4.0]), np.diag([0.02, 0.0]), ports={"belt": [0.1, 0.1]})
    found = fs.self_excitation(full, other, fs.Belt(slope=-1.0))
    assert found.growing.imag == pytest.approx([1.0], abs=1e-3) and found.counterpart[0].real < 0
    assert len(found.missing) == 1 and found.spurious.imag == pytest.approx([2.0], abs=1e-3)
    still = fs.self_excitation(full, other, fs.Belt(slope=1.0))
    assert still.verdict == "nothing grows, in either model" and still.growth_distance == 0


def test_compliance_of_one_mass() -> None:
    one = fs.Substructure([[1.0]], [[1.0]], [[0.1]], ports={"belt": [1.0]})
    softer = fs.Substructure([[1.0]], [[0.5]], [[0.1]], ports={"belt": [1.0]})
    omega = np.array([0.0, 0.7, 1.0])
    h, other = (1 / (k - omega**2 + 0.1j * omega) for k in (1.0, 0.5))
    for at, value in enumerate(omega):
        found = fs.self_excitation(one, softer, fs.Belt(slope=-0.2), omega=value)
        assert found.compliance_max == pytest.approx(abs(other[at] - h[at]) / abs(h[at]))
    found = fs.self_excitation(one, softer, fs.Belt(slope=-0.2), omega=omega)
    assert found.compliance_max == pytest.approx(np.abs(other - h).max() / np.abs(h).max())
    assert found.compliance_mean == pytest.approx((np.abs(other - h) / (np.abs(h) + np.abs(other))).mean())
    assert found.omega == pytest.approx(omega)
    default = fs.self_excitation(one, softer, fs.Belt(slope=-0.2), harmonics=4.0)
    assert default.omega[0] == 0 and default.omega[-1] == pytest.approx(4 * default.growing[0].imag)


def test_several_belts_and_columns() -> None:
    two = fs.Substructure(FULL.M, FULL.K, FULL.D, ports={"belt": FULL.port("belt"), "pad": np.eye(10)[:, 4:6]})
    belts = [BELT, fs.Belt("pad", slope=-0.1)]
    rom = with_basis(two, fs.normal_modes(two, count=6).shapes)
    found = fs.self_excitation(two, rom, belts, omega=[0.9])
    W = np.hstack([two.port("belt")[:, None], two.port("pad")])
    h, other = (w.T @ np.linalg.solve(-0.81 * M + 0.9j * D + K, w) for M, D, K, w in (
        (two.M.toarray(), two.D.toarray(), two.K.toarray(), W), (rom.M, rom.D, rom.K, rom.V.T @ W)))
    assert found.compliance_max == pytest.approx(np.linalg.norm(other - h) / np.linalg.norm(h))


def test_a_large_sparse_model_in_a_band() -> None:
    long = fs.chain(2100, belt=2, damping=0.1)
    rom = fs.reduce(long, fs.CraigChang(8), ports=True)
    belt = fs.Belt(slope=-0.2677)
    with pytest.raises(fs.InputError, match="ask for count=20 or band"):
        fs.self_excitation(long, rom, belt)
    band = (0.0, 0.009)
    found = fs.self_excitation(long, rom, belt, band=band, omega=np.linspace(0, 0.01, 5))
    values = fs.complex_modes(long, belt, band=band).eigenvalues
    assert len(found.growing) == np.sum(values.real > 0) >= 4 and found.band == band
    assert not len(found.missing) and not len(found.spurious)  # what grows beyond the band is not judged
    assert found.growth_error < 1e-4 and found.compliance_static < 1e-10 and found.projection_loss < 1e-4
    counted = fs.self_excitation(long, rom, belt, count=8, omega=[0.001])
    assert counted.band is not None and len(counted.growing) == 4 and not len(counted.spurious)


@pytest.mark.slow
def test_a_sequence_solves_the_full_model_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub.motion import self_excitation

    asked: list[int] = []
    original = self_excitation.complex_modes
    monkeypatch.setattr(self_excitation, "complex_modes", lambda model, *rest, **more: asked.append(model.size) or original(
        model, *rest, **more))
    models = [reduced(fs.CraigBampton, size) for size in (4, 6)]
    both = fs.self_excitation(FULL, models, BELT)
    assert asked == [10, 4, 6]
    assert both[1].flat() == pytest.approx(fs.self_excitation(FULL, models[1], BELT).flat())


def test_bad_input_is_named() -> None:
    rom = reduced(fs.CraigBampton, 5)
    with pytest.raises(fs.InputTypeError, match="must be a Substructure, not"):
        fs.self_excitation(FULL, 3, BELT)  # type: ignore[arg-type]
    with pytest.raises(fs.InputError, match="10 rows, but the full model has 12 DOF"):
        fs.self_excitation(fs.chain(12, belt=2), rom, BELT)
    with pytest.raises(fs.InputError, match="at least one contact, such as a Belt"):
        fs.self_excitation(FULL, rom, [])
    with pytest.raises(fs.InputError, match="none negative"):
        fs.self_excitation(FULL, rom, BELT, omega=[-1.0])
    with pytest.raises(fs.InputTypeError, match="omega must be real numbers"):
        fs.self_excitation(FULL, rom, BELT, omega="all")
    with pytest.raises(fs.InputError, match="harmonics must be positive"):
        fs.self_excitation(FULL, rom, BELT, harmonics=0)
    bare = fs.Substructure(np.eye(1), np.eye(1), ports={"belt": [1.0]})
    with pytest.raises(fs.SingularMatrixError, match="singular at ω = 1, an undamped resonance"):
        fs.self_excitation(bare, bare, fs.Belt(slope=-0.1), omega=[1.0])


def test_rows_of_a_table_hold_criteria_beside_what_was_measured() -> None:
    models = [reduced(fs.CraigBampton, 8), reduced(fs.CraigChang, 8)]
    rows = table_rows(FULL, models, BELT, [{"error_amplitude": 0.07}, {"error_amplitude": 0.36}])
    assert [row["size"] for row in rows] == [8, 8] and rows[0]["method"].startswith("Craig-Bampton")
    assert [(row["missing"], row["spurious"], row["error_amplitude"]) for row in rows] == [(2, 0, 0.07), (3, 1, 0.36)]
    with pytest.raises(fs.InputError, match="measured must have one entry per reduced model"):
        table_rows(FULL, models, BELT, [{}])


def test_match_by_distance_and_by_shape() -> None:
    values, others = np.array([1.0, 1.02]), np.array([1.018, 1.003])
    assert list(match(values, others)[1]) == [1, 0] == list(match(values, others, np.full((2, 2), np.nan))[1])
    assert list(match(values, others, np.eye(2))[1]) == [0, 1]  # where frequencies lie close, shapes decide
    assert list(match(values, others, np.eye(2), weight=1e-3)[1]) == [1, 0]
    # one without a counterpart must not drive others from theirs, and 0 belongs to 0
    assert list(match(np.array([0.0, 1.0, 2.0]), np.array([2.0, 3.0, 0.0]), far=1e-3)[1][[0, 2]]) == [2, 0]
