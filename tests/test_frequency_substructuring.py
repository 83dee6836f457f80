"""Parts known by receptances, joined: against the coupled model, with noise, and from sensors around an interface."""

from __future__ import annotations

from dataclasses import replace
from functools import partialmethod
from typing import Any

import numpy as np
import pytest
from scipy import special  # scipy.stats would take half a second of every process's collection

import femsub as fs
from benchmarks.lattices import lattice
from femsub.modes import noise

OMEGA = np.linspace(0.1, 1.5, 12)
Joints = list[tuple[tuple[str, str], tuple[str, str]]]


def pair(seed: int) -> tuple[dict[str, fs.Substructure], dict[str, Any], Joints, fs.System]:
    """Two random lattices, one of them reduced, joined at two nodes: parts, their loads, the joints, and the system."""
    rng = np.random.default_rng([17, seed])
    parts, loads = {}, {}
    for name, held in (("a", True), ("b", bool(rng.random() < 0.5))):
        sub = lattice(int(rng.integers(3, 6)), 3, held=held, seed=seed)
        sub = fs.damped(sub, rayleigh=(0.02, 0.02), structural=0.02 * rng.random())
        at = rng.choice(sub.size, 5, replace=False)
        parts[name] = fs.Substructure(sub.M, sub.K, sub.D, interface=at[:4], ports={"out": np.eye(sub.size)[at[4]]}, H=sub.H)
        loads[name] = [*map(int, at[:4]), "out"]
    if seed % 2:
        parts["b"] = fs.reduce(parts["b"], fs.Rubin(4), ports=True)
    ends = [[f"DOF {dof}" for dof in loads[name][:4]] for name in "ab"]
    joints = [(("a", one), ("b", other)) for one, other in zip(*ends, strict=True)]
    system = fs.couple(parts, [fs.Rigid(("a", loads["a"][:4]), ("b", loads["b"][:4]))])
    return parts, loads, joints, system


@pytest.mark.parametrize("seed", range(8))
def test_joined_receptances_are_those_of_the_coupled_model(seed: int) -> None:
    parts, loads, joints, system = pair(seed)
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    found = fs.couple_responses(known, joints)
    exact = fs.frequency_response(system, at=OMEGA, loads=["a.out", "b.out"])
    for response in exact.responses:
        for load in exact.loads:
            h = exact.entry(response, load)
            assert np.abs(found.entry(response, load) - h).max() < 1e-9 * np.abs(exact.receptance).max()
            k = found.responses.index(response), found.loads.index(load)
            assert (np.abs(found.entry(response, load) - h) <= found.bound[:, k[0], k[1]] + 1e-10).all()
    (_, one), (_, other) = joints[0]
    assert found.entry(f"a.{one}", "b.out") == pytest.approx(found.entry(f"b.{other}", "b.out"), rel=1e-8)
    assert found.evidence == "certified" and found.scatter is None and np.isinf(found.radius()).all()


def noisy(exact: np.ndarray, sigma: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return exact + sigma / np.sqrt(2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))


@pytest.mark.parametrize("repeated", [0, 6])
def test_the_stated_scatter_holds_in_95_percent_of_200_runs(repeated: int) -> None:
    """Of 1 % noise on one part, stated or seen in repeated measurements; each run is one draw at each frequency and entry."""
    parts, loads, joints, _ = pair(1)
    rng, level = np.random.default_rng(4), 0.01
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    exact, a = fs.couple_responses(known, joints), known["a"]
    sigma, inside, worst = level * np.abs(a.receptance), [], 0.0
    for _ in range(200):
        drawn = [noisy(a.receptance, sigma, rng) for _ in range(repeated or 1)]
        given = fs.FrequencyResponse.measured(OMEGA, drawn if repeated else drawn[0], a.responses, a.loads,
                                              level=None if repeated else level)
        found = fs.couple_responses({"a": given, "b": known["b"]}, joints)
        inside.append(np.abs(found.receptance - exact.receptance) <= found.radius(0.95))
        worst = max(worst, float(found.residual.max()))
    assert worst < 0.5 and found.evidence == "not checked" and found.repeated == repeated
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)  # 200 runs of 12 x 100 entries
    assert np.mean(inside, axis=0).min() > 0.86  # none by itself is far off: 95 % of 200 are 190 ± 3


def gains(exact: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """Measurements whose sensors have gain errors of 1 % in common for all loads, beside noise of 0.2 % in each entry."""
    of_sensor = 0.01 * rng.standard_normal((count, len(exact), exact.shape[1], 1))
    return np.array([noisy(exact * (1 + one), 0.002 * np.abs(exact), rng) for one in of_sensor])


def within(found: fs.FrequencyResponse, exact: np.ndarray) -> np.ndarray:
    axes, angle = found.ellipses(0.95)
    off = (exact - found.receptance) * np.exp(-1j * angle)
    return np.asarray((off.real / axes[..., 0]) ** 2 + (off.imag / axes[..., 1]) ** 2 <= 1)


@pytest.mark.slow
def test_ellipses_hold_in_95_percent_of_200_runs_with_noise_of_sensors_in_common() -> None:
    """Of ten measurements. The joint ellipsoid of three entries has all correlation between them in it."""
    parts, loads, joints, _ = pair(1)
    rng, n = np.random.default_rng(7), 10
    known = {name: fs.frequency_response(part, at=OMEGA[2:], loads=loads[name]) for name, part in parts.items()}
    exact, a = fs.couple_responses(known, joints), known["a"]
    entries = [("a.out", "a.out"), ("b.out", "a.out"), (exact.responses[0], "b.out")]
    at = tuple(np.array([(exact.responses.index(row), exact.loads.index(column)) for row, column in entries]).T)
    q = (n - 1) * 6 / (n - 6) * special.fdtri(6, n - 6, 0.95)  # Hotelling, of six real numbers
    inside, joint = [], []
    for _ in range(200):
        given = fs.FrequencyResponse.measured(a.omega, gains(a.receptance, rng, n), a.responses, a.loads)
        found = fs.couple_responses({"a": given, "b": known["b"]}, joints)
        inside.append(within(found, exact.receptance)[:, at[0], at[1]])
        gamma, turned = found.covariance(entries)
        size = np.block([[(gamma + turned).real, (turned - gamma).imag], [(turned + gamma).imag, (gamma - turned).real]]) / 2
        off = (found.receptance - exact.receptance)[:, at[0], at[1]]
        off = np.concatenate([off.real, off.imag], axis=1)
        joint.append(np.einsum("fi,fi->f", off, np.linalg.solve(size, off[..., None])[..., 0]) <= q)
    assert np.mean(inside, axis=(0, 1)) == pytest.approx(0.95, abs=0.016)  # 2,000 draws: 0.95 ± 0.005
    assert np.mean(joint) == pytest.approx(0.95, abs=0.016)


def test_covariance_of_stated_noise_on_both_parts_holds_in_95_percent_of_200_runs() -> None:
    parts, loads, joints, _ = pair(2)
    rng = np.random.default_rng(8)
    known = {name: fs.frequency_response(part, at=OMEGA[2:], loads=loads[name]) for name, part in parts.items()}
    exact = fs.couple_responses(known, joints)
    entries = [("a.out", "a.out"), ("b.out", "b.out")]
    at = tuple(np.array([(exact.responses.index(row), exact.loads.index(column)) for row, column in entries]).T)
    joint = []
    for _ in range(200):
        given = {name: fs.FrequencyResponse.measured(one.omega, noisy(one.receptance, 0.003 * np.abs(one.receptance), rng),
                                                     one.responses, one.loads, level=0.003) for name, one in known.items()}
        found = fs.couple_responses(given, joints)
        gamma, turned = found.covariance(entries)
        off = (found.receptance - exact.receptance)[:, at[0], at[1]]
        joint.append(2 * np.einsum("fi,fi->f", off.conj(), np.linalg.solve(gamma, off[..., None])[..., 0]).real
                     <= special.chdtri(4, 0.05))
        assert not turned.any()
    assert np.mean(joint) == pytest.approx(0.95, abs=0.016)


def test_the_covariance_is_that_of_the_primal_assembly(monkeypatch: pytest.MonkeyPatch) -> None:
    """With S = Y⁻¹ and motions u = L q, Y_c = L (Lᵀ S L)⁻¹ Lᵀ and δY_c = (Y_c S) δY (S Y_c): no Lagrange multipliers."""
    parts, loads, joints, _ = pair(0)
    rng = np.random.default_rng(9)
    known = {name: fs.frequency_response(part, at=OMEGA[:4], loads=loads[name]) for name, part in parts.items()}
    given = dict(known)
    for name, one in known.items():
        how = {"scatter": 1e-5 * np.abs(one.receptance)} if name == "a" else {}
        drawn = one.receptance if how else np.array([noisy(one.receptance, 1e-5 * np.abs(one.receptance), rng) for _ in range(7)])
        given[name] = fs.FrequencyResponse.measured(one.omega, drawn, one.responses, one.loads, **how)
    found = fs.couple_responses(given, joints)
    names = found.responses
    kept = [name for name in names if name not in [f"b.{other}" for _, (_, other) in joints]]
    L = np.zeros((len(names), len(kept)))
    same = {f"b.{other}": f"a.{one}" for (_, one), (_, other) in joints}
    for row, name in enumerate(names):
        L[row, kept.index(same.get(name, name))] = 1.0
    entries = [("a.out", "a.out"), ("b.out", "a.out"), ("a.out", names[6])]
    at = [(names.index(row), names.index(column)) for row, column in entries]
    gamma, turned = found.covariance(entries)
    for f in range(4):
        Y = np.zeros((10, 10), dtype=complex)
        Y[:5, :5], Y[5:, 5:] = given["a"].receptance[f], given["b"].receptance[f]
        S = np.linalg.inv(Y)
        Y_c = L @ np.linalg.solve(L.T @ S @ L, L.T)
        assert found.receptance[f] == pytest.approx(Y_c, rel=1e-6, abs=1e-8 * np.abs(Y_c).max())
        J = np.array([np.outer((Y_c @ S)[i], (S @ Y_c)[:, j]) for i, j in at])  # (k, 10, 10)
        one = (J[:, :5, :5] * given["a"].noise[0].scatter[f]).reshape(3, -1)
        other = np.array([(J[:, 5:, 5:] * d[f]).sum(axis=(1, 2)) for d in given["b"].noise[0].deviations]) / np.sqrt(42)
        assert gamma[f] == pytest.approx(one @ one.conj().T + other.T @ other.conj(), rel=1e-6)
        assert turned[f] == pytest.approx(other.T @ other, rel=1e-6, abs=1e-9 * np.abs(gamma[f]).max())
        size, skew = gamma[f].diagonal().real, turned[f].diagonal()
        axes, angle = found.ellipses(0.5)
        i, j = np.array(at).T
        q = 6 * (0.5 ** (-2 / 5) - 1)
        assert (axes[f, i, j] ** 2).sum(axis=-1) == pytest.approx(q * size)
        assert axes[f, i, j, 0] ** 2 - axes[f, i, j, 1] ** 2 == pytest.approx(q * np.abs(skew))
        assert np.exp(2j * angle[f, i, j]) == pytest.approx(skew / np.abs(skew))
    monkeypatch.setattr(noise.Noise, "covariance", partialmethod(noise.Noise.covariance, most=20))
    assert found.covariance(entries)[0] == pytest.approx(gamma, rel=1e-12)


def test_noise_keeps_its_correlation_through_one_joining_after_the_other() -> None:
    parts, loads, joints, _ = pair(1)
    rng = np.random.default_rng(3)
    known = {name: fs.frequency_response(part, at=OMEGA[2:4], loads=loads[name]) for name, part in parts.items()}
    for name, one in known.items():
        known[name] = fs.FrequencyResponse.measured(one.omega, gains(one.receptance, rng, 4), one.responses, one.loads)
    whole = fs.couple_responses(known, joints)
    half = fs.couple_responses(known, joints[:2])
    found = fs.couple_responses({"all": half}, [(("all", f"{a}.{one}"), ("all", f"{b}.{other}"))
                                                for (a, one), (b, other) in joints[2:]])
    assert found.receptance == pytest.approx(whole.receptance, rel=1e-6) and found.repeated == 4
    for ours, theirs in zip(found.covariance([("all.a.out", "all.b.out"), ("all.b.out", "all.b.out")]),
                            whole.covariance([("a.out", "b.out"), ("b.out", "b.out")]), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-5, abs=1e-8 * np.abs(theirs).max())


def test_noise_that_first_order_cannot_hold_is_loud() -> None:
    parts, loads, joints, _ = pair(1)
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    a = known["a"]
    given = fs.FrequencyResponse.measured(OMEGA, a.receptance, a.responses, a.loads, level=0.05)
    with pytest.warns(fs.FemsubWarning, match=r"too large for first order at \d+ of 12 frequencies, most at ω = 0\.1 "):
        found = fs.couple_responses({"a": given, "b": known["b"]}, joints)
    little = fs.FrequencyResponse.measured(OMEGA, a.receptance, a.responses, a.loads, level=0.005)
    assert found.residual == pytest.approx(10 * fs.couple_responses({"a": little, "b": known["b"]}, joints).residual)
    lost = found.residual >= 1
    assert 0 < lost.sum() < 12 and found.scatter is not None
    for figures in (found.scatter, found.radius(), found.ellipses()[0], found.ellipses()[0][..., 1]):
        assert np.isinf(figures[lost]).all() and np.isfinite(figures[~lost]).all()
    gamma, turned = found.covariance([("a.out", "b.out")])
    assert np.isnan(gamma[lost]).all() and np.isnan(turned[lost]).all() and np.isfinite(gamma[~lost]).all()
    for wrong, message in (([], "is empty"), ([("a.out", "c")], "unknown load 'c'"), ([("c", "b.out")], "unknown response 'c'")):
        with pytest.raises(fs.InputError, match=message):
            found.covariance(wrong)
    with pytest.raises(fs.InputTypeError, match="must be a pair"):
        found.covariance(["a.out"])  # type: ignore[list-item]
    with pytest.raises(fs.InputError, match="no noise is known"):
        a.covariance([("out", "out")])
    assert np.isinf(a.ellipses()[0]).all()
    two = fs.FrequencyResponse.measured([1.0], [[[[1.0]]], [[[2.0]]]], ["a"], ["a"])
    assert np.isinf(two.ellipses()[0]).all() and np.isfinite(two.radius()).all()


def test_the_bound_goes_through_the_joints() -> None:
    parts, loads, joints, _ = pair(0)
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    exact, rng = fs.couple_responses(known, joints), np.random.default_rng(1)
    for size in (1e-6, 1e-3):
        wrong = {}
        for name, one in known.items():
            change = size * np.abs(one.receptance) * rng.uniform(-1, 1, one.receptance.shape)
            wrong[name] = replace(one, receptance=one.receptance + change, bound=size * np.abs(one.receptance))
        found = fs.couple_responses(wrong, joints)
        known_here = np.isfinite(found.bound)
        assert (np.abs(found.receptance - exact.receptance) <= found.bound + exact.bound)[known_here].all()
        assert known_here.all() or size > 1e-6


@pytest.mark.parametrize("omega", [3e-6, 3e-5, 1e-3])
def test_the_bound_has_the_cancellation_of_joining_in_it(omega: float) -> None:
    """A free chain moves by 1/(20ω²), far more than the joined chains do."""
    one, other = fs.chain(30, damping=0.0), fs.chain(20, fixed=False, damping=0.0)
    known = {name: fs.frequency_response(part, at=omega, loads=[0]) for name, part in (("a", one), ("b", other))}
    found = fs.couple_responses(known, [(("a", "DOF 0"), ("b", "DOF 0"))])
    K, M = np.zeros((2, 49, 49))
    for part, at in ((one, np.arange(30)), (other, np.array([0, *range(30, 49)]))):
        K[np.ix_(at, at)] += part.K.toarray()
        M[np.ix_(at, at)] += part.M.toarray()
    exact = np.linalg.inv(K - omega**2 * M)[0, 0]  # well conditioned
    assert (np.abs(found.receptance - exact) <= found.bound + 1e-12).all()
    sharp = fs.couple_responses(known, [(("a", "DOF 0"), ("b", "DOF 0"))], tol=0.5 * float(found.bound.max()))
    assert sharp.evidence == "not checked"
    assert fs.couple_responses(known, [(("a", "DOF 0"), ("b", "DOF 0"))], tol=0.5).evidence == "certified"


def test_displacements_and_rotations_join_in_any_units() -> None:
    scaled = []
    for length in (1.0, 1e-6, 1e5):
        h, E = length / 50, 1.6e11
        data = {"E": E, "I": h**4 / 12, "rho": 2330.0, "A": h * h}
        a = fs.beam(length, 8, **data, supports={"left": "clamped"}, interface=["right"])
        b = fs.beam(length, 8, **data, interface=["left"])
        omega = fs.normal_modes(a, count=1).frequencies[0] * np.array([0.2, 0.5, 1.3, 2.2])
        known = {name: fs.frequency_response(part, at=omega, loads=part.interface.tolist())
                 for name, part in (("a", a), ("b", b))}
        found = fs.couple_responses(known, [(("a", f"DOF {i}"), ("b", f"DOF {j}"))
                                            for i, j in zip(a.interface, b.interface, strict=True)])
        assert found.evidence == "certified"
        scaled.append(found.receptance[:, 0, 0] * E * h**4 / 12 / length**3)
    for other in scaled[1:]:
        assert other == pytest.approx(scaled[0], rel=1e-4)


def test_a_virtual_point_of_sensors_around_a_rigid_interface() -> None:
    rng = np.random.default_rng(2)
    point, places = np.array([0.1, 0.2, 0.0]), {}
    for k in range(9):
        places[f"s{k}"] = (tuple(point + rng.uniform(-0.05, 0.05, 3)), tuple(rng.standard_normal(3)))
    R = np.array([[*(d / np.linalg.norm(d)), *np.cross(np.array(x) - point, d / np.linalg.norm(d))]
                  for x, d in ((np.array(x), np.array(d)) for x, d in places.values())])
    flexible = rng.standard_normal((3, 7, 7)) + 1j * rng.standard_normal((3, 7, 7))  # six of the point, one beside
    outer = np.zeros((10, 7))
    outer[:9, :6], outer[9, 6] = R, 1.0
    names = [*places, "far"]
    sensed = fs.FrequencyResponse.measured([1.0, 2.0, 3.0], outer @ flexible @ outer.T, names, names, level=0.01)
    found = fs.virtual_point(sensed, point, places)
    assert found.responses == ("point.ux", "point.uy", "point.uz", "point.rx", "point.ry", "point.rz", "far") == found.loads
    # forces at the sensors are those of the point: T_f of Rᵀ is the identity on all that a rigid interface feels
    assert found.receptance == pytest.approx(flexible, rel=1e-9) and found.residual.max() < 1e-12
    order = list(places)[::-1]  # the same sum in another order: rounding alone, which the bound has
    other = fs.virtual_point(sensed, point, {key: places[key] for key in order})
    assert (np.abs(other.receptance - found.receptance) <= other.bound + found.bound).all() and found.bound.max() < 1e-9
    bent = replace(sensed, receptance=sensed.receptance + 0.1 * rng.standard_normal((3, 10, 10)))
    assert 1e-3 < fs.virtual_point(bent, point, places).residual.max() < 1
    assert sensed.scatter is not None
    runs = (replace(sensed, receptance=noisy(sensed.receptance, sensed.scatter, rng)) for _ in range(300))
    drawn = np.array([fs.virtual_point(one, point, places).receptance for one in runs])
    assert np.sqrt((np.abs(drawn - flexible) ** 2).mean(axis=0)) == pytest.approx(found.scatter, rel=0.3)
    with pytest.raises(fs.InputError, match="leave some of them unknown"):
        fs.virtual_point(sensed, point, dict(list(places.items())[:5]))
    with pytest.raises(fs.InputError, match="unknown sensor 'x'"):
        fs.virtual_point(sensed, point, places | {"x": places["s0"]})


def test_bad_joints_and_measurements_are_named() -> None:
    parts, loads, joints, _ = pair(0)
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    for wrong, message in (((("a", "out"), ("c", "out")), "unknown part 'c'"), ((("a", "out"), ("a", "out")), "at both ends"),
                           ((("a", "rim"), ("b", "out")), "is no response of")):
        with pytest.raises(fs.InputError, match=message):
            fs.couple_responses(known, [wrong])  # type: ignore[list-item]
    with pytest.raises(fs.InputTypeError, match="must be a pair of ends"):
        fs.couple_responses(known, [("a", "b")])  # type: ignore[list-item]
    with pytest.raises(fs.SingularMatrixError, match="no unique forces"):
        fs.couple_responses(known, [*joints, joints[0]])
    with pytest.raises(fs.InputError, match="other frequencies"):
        fs.couple_responses(known | {"b": fs.frequency_response(parts["b"], at=OMEGA[1:], loads=loads["b"])}, joints)
    for options, message in (({"level": 0.1, "scatter": np.ones((1, 1, 1))}, "give one of"), ({"level": -1}, "must be positive")):
        with pytest.raises(fs.InputError, match=message):
            fs.FrequencyResponse.measured([1.0], [[[1.0]]], ["a"], ["a"], **options)  # type: ignore[arg-type]
    with pytest.raises(fs.InputError, match="must be finite numbers of shape"):
        fs.FrequencyResponse.measured([1.0, 2.0], [[[1.0]]], ["a"], ["a"])
    with pytest.raises(fs.InputError, match="at least two"):
        fs.FrequencyResponse.measured([1.0], [[[[1.0]]]], ["a"], ["a"])


# universal files

def dataset(row: tuple[int, int], column: tuple[int, int], h: np.ndarray, kind: int = 12, **other: Any) -> dict[str, Any]:
    """Dataset 58 as pyuff writes it, over 1 to n Hz."""
    return {"type": 58, "func_type": 4, "rsp_node": row[0], "rsp_dir": row[1], "ref_node": column[0], "ref_dir": column[1],
            "binary": 0, "abscissa_spacing": 0, "abscissa_min": 1.0, "abscissa_inc": 0.0, "ord_data_type": 6, "z_axis_value": 0.0,
            "abscissa_spec_data_type": 18, "ordinate_spec_data_type": kind, "orddenom_spec_data_type": 13, "x": HERTZ, "data": h,
            "num_pts": len(h), "ver_num": 1, "load_case_id": 0, "rsp_ent_name": "NONE", "ref_ent_name": "NONE",
            **{f"id{k}": "x" for k in range(1, 6)}, **other}


HERTZ = np.arange(1.0, 13.0)


def written(path: Any, *sets: dict[str, Any]) -> Any:
    pytest.importorskip("pyuff").UFF(str(path)).write_sets(list(sets), "overwrite")
    return path


def test_universal_files_hold_measured_parts(tmp_path: Any) -> None:
    known = fs.frequency_response(fs.damped(lattice(3, 3, held=True), structural=0.05), at=2 * np.pi * HERTZ / 50, loads=[4, 9])
    h, omega = known.receptance, 2 * np.pi * HERTZ
    ends = ((7, 2), (8, -3))
    signs = np.array([1.0, -1.0])
    sets = [dataset(ends[i], ends[j], -omega**2 * signs[i] * signs[j] * h[:, i, j], binary=j) for i in (0, 1) for j in (0, 1)]
    found = fs.read_response(written(tmp_path / "a.uff", *sets), level=0.01)
    assert found.responses == found.loads == ("7:uy", "8:uz") and found.omega == pytest.approx(omega, rel=1e-6)
    assert found.receptance == pytest.approx(h, rel=1e-5) and found.scatter == pytest.approx(0.01 * np.abs(h), rel=1e-5)
    velocity = dataset((7, 2), (7, 2), 1j * omega * h[:, 0, 0], kind=11)
    again = dataset((7, 2), (7, 2), 1.02 * h[:, 0, 0], kind=8)
    twice = fs.read_response(written(tmp_path / "b.uff", velocity, again))
    assert twice.repeated == 2 and twice.receptance[:, 0, 0] == pytest.approx(1.01 * h[:, 0, 0], rel=1e-5)


def test_what_is_wrong_with_a_universal_file_is_named(tmp_path: Any) -> None:
    pytest.importorskip("pyuff")
    h = np.ones(12, dtype=complex)
    whole = dataset((1, 1), (1, 1), h)
    for name, sets, message in (
            ("missing", [whole, dataset((2, 1), (2, 1), h)], "from 2:ux to 1:ux is missing"),
            ("uneven", [whole, whole, dataset((2, 1), (1, 1), h)], "is there 1 times for some pairs and 2 times"),
            ("strain", [dataset((1, 1), (1, 1), h, kind=3)], "has the data types 3 over 13"),
            ("coherence", [whole | {"func_type": 6}], "holds no frequency response function"),
            ("shifted", [whole, dataset((2, 1), (1, 1), h, x=HERTZ + 1)], "other frequencies")):
        with pytest.raises(fs.InputError, match=message):
            fs.read_response(written(tmp_path / f"{name}.uff", *sets))
    text = written(tmp_path / "good.uff", whole, dataset((2, 1), (1, 1), h)).read_text()
    for cut in (0, 40, 200, 700, len(text) // 2 + 90, len(text) - 30):
        (tmp_path / "cut.uff").write_text(text[:cut])
        with pytest.raises(fs.InputError, match=r"cut\.uff"):
            fs.read_response(tmp_path / "cut.uff")
    one = "1.00000000000e+00"
    for old, new, message in ((one, "NaN".ljust(17), "holds a NaN"), (one, "1.0000x000000e+00", "are not all numbers"),
                              (" 12         0", " 14         0", "announces 14 values, but has 12")):
        (tmp_path / "odd.uff").write_text(text.replace(old, new, 1))
        with pytest.raises(fs.InputError, match=message):
            fs.read_response(tmp_path / "odd.uff")
    with pytest.raises(fs.InputError, match="there is no file"):
        fs.read_response(tmp_path / "none.uff")
