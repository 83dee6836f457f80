"""Parts known by receptances, joined: against the coupled model, with noise, and from sensors around an interface."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import femsub as fs
from benchmarks.lattices import lattice

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


def test_a_virtual_point_of_sensors_around_a_rigid_interface() -> None:
    rng = np.random.default_rng(2)
    point, places = np.array([0.1, 0.2, 0.0]), {}
    for k in range(9):
        places[f"s{k}"] = (tuple(point + rng.uniform(-0.05, 0.05, 3)), tuple(rng.standard_normal(3)))
    R = np.array([[*(d / np.linalg.norm(d)), *np.cross(np.array(x) - point, d / np.linalg.norm(d))]
                  for x, d in ((np.array(x), np.array(d)) for x, d in places.values())])
    flexible = rng.standard_normal((3, 7, 7)) + 1j * rng.standard_normal((3, 7, 7))  # six motions of the point, one beside
    outer = np.zeros((10, 7))
    outer[:9, :6], outer[9, 6] = R, 1.0
    names = [*places, "far"]
    sensed = fs.FrequencyResponse.measured([1.0, 2.0, 3.0], outer @ flexible @ outer.T, names, names, level=0.01)
    found = fs.virtual_point(sensed, point, places)
    assert found.responses == ("point.ux", "point.uy", "point.uz", "point.rx", "point.ry", "point.rz", "far") == found.loads
    # forces at the sensors are those of the point: T_f of Rᵀ is the identity on all that a rigid interface feels
    assert found.receptance == pytest.approx(flexible, rel=1e-9) and found.residual.max() < 1e-12
    bent = replace(sensed, receptance=sensed.receptance + 0.1 * rng.standard_normal((3, 10, 10)))
    assert 1e-3 < fs.virtual_point(bent, point, places).residual.max() < 1
    drawn = np.array([fs.virtual_point(fs.FrequencyResponse.measured([1.0, 2.0, 3.0], noisy(
        sensed.receptance, sensed.scatter, rng), names, names), point, places).receptance for _ in range(300)])
    assert np.sqrt((np.abs(drawn - flexible) ** 2).mean(axis=0)) == pytest.approx(found.scatter, rel=0.3)
    with pytest.raises(fs.InputError, match="leave some of them unknown"):
        fs.virtual_point(sensed, point, dict(list(places.items())[:5]))
    with pytest.raises(fs.InputError, match="unknown sensor 'x'"):
        fs.virtual_point(sensed, point, places | {"x": places["s0"]})


def test_bad_joints_and_measurements_are_named() -> None:
    parts, loads, joints, _ = pair(0)
    known = {name: fs.frequency_response(part, at=OMEGA, loads=loads[name]) for name, part in parts.items()}
    for wrong, message in (((("a", "out"), ("c", "out")), "unknown part 'c'"), ((("a", "rim"), ("b", "out")), "is no response of"),
                           ((("a", "out"), ("a", "out")), "at both ends")):
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
