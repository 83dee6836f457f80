"""Derivatives of eigenvalues: against 50-digit differences, closed forms, rebuilt models, and where eigenvalues meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import mpmath as mp
import numpy as np
import pytest
import scipy.sparse as sp
from scipy import optimize

import femsub as fs
from femsub.components import two_mode, two_mode_critical
from femsub.coupling.contacts.friction_contact import FrictionInMotion
from femsub.model import Jet
from femsub.modes.quadratic import correction

STEEL = fs.Material(2.1e11, 0.3, 7850.0)


def precise(M: Any, D: Any, K: Any, value: complex, x: np.ndarray) -> Any:
    """The eigenvalue near a value, to 50 digits, by Newton's method on the bordered equations."""
    n, x, lam = M.rows, mp.matrix(x.tolist()), mp.mpc(value)
    c = x.H.copy()
    for _ in range(12):
        J, r = mp.zeros(n + 1), mp.zeros(n + 1, 1)
        P = lam**2 * M + lam * D + K
        J[:n, :n], J[:n, n], J[n, :n] = P, (2 * lam * M + D) * x, c
        r[:n], r[n] = P * x, (c * x)[0] - 1
        step = mp.lu_solve(J, -r)
        x, lam = x + step[:n], lam + step[n]
        if abs(step[n]) < mp.mpf(10) ** -42 * abs(lam):
            break
    return lam


def circulatory(seed: int) -> tuple[fs.Affine, list[np.ndarray]]:
    """A random damped model with unsymmetric K, and the matrices of its parameters a (M), b (D) and c (K)."""
    r = np.random.default_rng(seed)
    n = int(r.integers(2, 5))
    A, B, C, M1, D1, K1 = r.standard_normal((6, n, n))
    K = (A @ A.T + 0.1 * np.eye(n)) * 10 ** r.uniform(-1, 4)
    parts = [B @ B.T + n * np.eye(n), C @ C.T * 10 ** r.uniform(-3, 0.5), K + r.uniform(0, 1) * np.abs(K).max() * K1,
             M1 + M1.T, D1, K1]
    M, D, K, M1, D1, K1 = parts
    return fs.Affine([(1.0, M), ("a", M1)], [(1.0, D), ("b", D1)], [(1.0, K), ("c", K1)]), parts


@pytest.mark.slow
def test_derivatives_agree_with_differences_of_50_digits() -> None:
    with mp.workdps(50):
        for seed in range(8):
            family, parts = circulatory(seed)
            modes = fs.complex_modes(family.at(a=0, b=0, c=0))
            k = int(np.argmax(modes.eigenvalues.imag))
            found = fs.sensitivities(family, None, modes, ["a", "b", "c"], at={"a": 0, "b": 0, "c": 0}, of=[k])
            assert found.differentiable[0]
            matrices, h = [mp.matrix(part.tolist()) for part in parts], mp.mpf(10) ** -14
            for j in range(3):
                ends = []
                for side in (-1, 0, 1):
                    moved = matrices[:3]
                    moved[j] = moved[j] + side * h * matrices[3 + j]
                    ends.append(precise(*moved, modes.eigenvalues[k], modes.shapes[:, k]))
                exact, curve = complex((ends[2] - ends[0]) / (2 * h)), complex((ends[2] - 2 * ends[1] + ends[0]) / h**2)
                off = abs(found.first[0, j] - exact)
                assert off <= found.error_bar[0, j] or off <= 1e-8 * abs(exact)
                assert found.error_bar[0, j] <= 1e-8 * np.abs(found.first[0]).max()  # it says something
                assert abs(found.second[0, j, j] - curve) <= 1e-8 * np.abs(found.second[0]).max()


def test_both_members_of_a_pair_have_conjugated_derivatives() -> None:
    family, _ = circulatory(3)
    at = {"a": 0.0, "b": 0.0, "c": 0.0}
    modes = fs.complex_modes(family.at(**at))
    found = fs.sensitivities(family, None, modes, ["b"], at=at)
    for k, value in enumerate(modes.eigenvalues):
        twin = int(np.argmin(np.abs(modes.eigenvalues - value.conj())))
        assert np.isclose(found.first[twin, 0], found.first[k, 0].conj(), rtol=1e-12)


def test_a_symmetric_factor_gives_the_derivatives_of_a_large_model_within_their_bars() -> None:
    """Of a sparse model the left vector comes from a symmetric factor, of a dense one from a complex one."""
    count = 60
    chain = fs.chain(count, belt=20)
    ports = {"n": np.eye(count)[19], "t": np.eye(count)[44]}
    sub = fs.Substructure(chain.M, chain.K, 1e-3 * chain.K, interface=[10], ports=ports)
    rubbing = fs.LinearContact(("n", "t"), stiffness=[[0.5, 0.0], [0.2, 0.0]], damping=[[0.0, 0.0], [0.0, 0.01]])
    modes, changes = fs.complex_modes(sub, rubbing, count=20), [fs.AddedMass([30]), fs.AddedDamper([7]), fs.AddedSpring("n")]
    light, whole = (fs.sensitivities(sub, rubbing, modes, changes, second=more) for more in (False, True))
    assert np.isnan(light.second).all() and np.isfinite(whole.second).all()
    assert (np.abs(light.first - whole.first) <= light.error_bar + whole.error_bar).all()
    assert (light.error_bar <= 1e-6 * np.abs(light.first).max(axis=0)).all()
    dense = fs.Substructure(chain.M.toarray(), chain.K.toarray(), 1e-3 * chain.K.toarray(), ports=ports)
    again = fs.sensitivities(dense, rubbing, fs.complex_modes(dense, rubbing), changes)
    at = [int(np.argmin(np.abs(again.eigenvalues - value))) for value in light.eigenvalues]
    assert (np.abs(light.first - again.first[at]) <= light.error_bar + again.error_bar[at] + 1e-12).all()


@pytest.mark.parametrize("friction", [1.0, 1e-3, 1e-6])
def test_left_vectors_of_lightly_damped_modes_need_no_complex_factor(monkeypatch: pytest.MonkeyPatch, friction: float) -> None:
    """The symmetric part of Re P(λ) is nearly singular there, in another direction than the mode if friction is weak.

    Its factor would then gain few digits, and each mode would take a complex one.
    """
    made: list[bool] = []

    class Counted(correction.ComplexFactor):
        def __init__(self, P: Any) -> None:
            made.append(True)
            super().__init__(P)

    monkeypatch.setattr(correction, "ComplexFactor", Counted)
    count = 60
    chain, ports = fs.chain(count, damping=0), {"n": np.eye(count)[19], "t": np.eye(count)[44]}
    sub = fs.Substructure(chain.M, chain.K, 1e-7 * chain.K, ports=ports)
    rubbing = fs.LinearContact(("n", "t"), stiffness=[[0.5 * friction, 0.0], [0.2 * friction, 0.0]],
                               damping=[[0.0, 0.0], [0.0, 0.01 * friction]])
    modes, changes = fs.complex_modes(sub, rubbing, count=20), [fs.AddedMass([30]), fs.AddedDamper([7])]
    assert modes.left is not None
    rough = replace(modes, left=modes.left + 1e-5 * np.random.default_rng(0).standard_normal(modes.left.shape))
    light = fs.sensitivities(sub, rubbing, rough, changes)
    assert not made
    whole = fs.sensitivities(sub, rubbing, modes, changes, second=True)
    assert made  # the count sees them
    assert (np.abs(light.first - whole.first) <= light.error_bar + whole.error_bar).all()
    assert (light.error_bar <= 1e-6 * np.abs(light.first).max(axis=0)).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bars_hold_where_a_mode_hardly_moves(seed: int) -> None:
    """Springs to the ground at random make modes local: far from them other modes than the nearest carry the error."""
    rng, count = np.random.default_rng(seed), 60
    chain, ports = fs.chain(count, damping=0), {"n": np.eye(count)[19], "t": np.eye(count)[44]}
    K = chain.K + sp.diags_array(2 * rng.random(count))
    sub = fs.Substructure(chain.M, K, 1e-6 * K, ports=ports)
    rubbing = fs.LinearContact(("n", "t"), stiffness=[[0.5, 0.1], [-0.2, 0.0]], damping=[[0.0, 0.02], [0.0, 0.01]])
    modes, changes = fs.complex_modes(sub, rubbing, count=12), [fs.AddedMass([k]) for k in range(count)]
    assert modes.left is not None
    rough = replace(modes, left=modes.left + 1e-7 * rng.standard_normal(modes.left.shape))
    light = fs.sensitivities(sub, rubbing, rough, changes, second=False)
    whole = fs.sensitivities(sub, rubbing, modes, changes, second=True)
    assert np.abs(light.first).min() < 1e-9 * np.abs(light.first).max()
    assert (np.abs(light.first - whole.first) <= light.error_bar + whole.error_bar).all()


def test_a_contact_makes_its_matrices_once_for_all_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """`complex_modes` has made them; the model, its linearisation and the family over μ ask for them again."""
    mesh = fs.block((0.1, 0.04, 0.02), (3, 2, 1))
    pad = fs.solid(mesh, STEEL, supports={"left": "xyz"}, interface=["bottom"], rayleigh=(50.0, 1e-7))
    rubbing = fs.FrictionContact("bottom", "ground", mesh, stiffness=2e11, mu=0.5, direction=(1, 0, 0))
    modes, rest, asked = fs.complex_modes(pad, rubbing, count=4), FrictionInMotion.at_rest, []
    monkeypatch.setattr(FrictionInMotion, "at_rest", lambda self: asked.append(self) or rest(self))
    fs.sensitivities(pad, rubbing, modes, ["mu"], of=[0])
    assert not asked


def test_where_modes_meet_the_pair_has_coefficients_and_lambda_has_no_derivative() -> None:
    """Hoffmann's model meets at μ = 3/4, where ω² = 2 ± √(1 - 4μ/3)."""
    model, mu = two_mode(), two_mode_critical()
    modes = fs.complex_modes(model.at(mu=mu))
    found = fs.sensitivities(model, None, modes, ["mu"], at={"mu": mu})
    assert not found.differentiable.any() and np.isnan(found.first).all()
    one = next(one for one in found.meetings if one.mean.imag > 0)
    # λ = i√(2 ± w), w² = 1 - 4μ/3: mean = i√2 + O(w²), square = -w²/8 + O(w⁴)
    assert abs(one.mean - 1j * 2**0.5) < 1e-7 and abs(one.square) < 1e-12
    assert np.isclose(one.square_slopes[0], 1 / 6, rtol=1e-6)
    step = 1e-4
    exact = fs.complex_modes(model.at(mu=mu + step)).eigenvalues
    exact = exact[exact.imag > 0]
    near = one.at(step)
    assert np.abs(np.sort(exact.real) - np.sort(near.real)).max() < 1e-2 * np.abs(exact.real).max()
    before = fs.sensitivities(model, None, fs.complex_modes(model.at(mu=0.5)), ["mu"], at={"mu": 0.5})
    assert before.differentiable.all() and not before.meetings
    lam = before.eigenvalues
    assert np.allclose(before.first[:, 0], np.sign((lam**2).real + 2) * -2 / 3 / (1 - 2 / 3) ** 0.5 / (2 * lam), rtol=1e-9)


def test_equal_modes_of_a_symmetric_model_split_to_first_order() -> None:
    M, K = np.eye(3), np.diag([4.0, 4.0, 9.0])
    family = fs.Affine(M, None, [(1.0, K), ("k", np.diag([1.0, 3.0, 0.0]))])
    found = fs.sensitivities(family, None, fs.complex_modes(family.at(k=0.0)), ["k"], at={"k": 0.0})
    assert found.differentiable.sum() == 2
    one = next(one for one in found.meetings if one.mean.imag > 0)
    assert np.allclose(np.sort(np.linalg.eigvals(one.slopes[0]).imag), [1 / 4, 3 / 4])


@pytest.mark.parametrize("reduced", [False, True])
def test_belts_nodes_and_joints_agree_with_rebuilt_models(reduced: bool) -> None:
    law = fs.StribeckArctan(eps=0.05)

    def model(mass: float = 0.0, spring: float = 2.0, damper: float = 0.0) -> fs.Substructure:
        part = fs.chain(6, interface=[3, 6], belt=2)
        M, D = part.M.toarray(), part.D.toarray()
        M[5, 5] += mass
        D[2, 2] += damper
        D[5, 5] += damper
        D[2, 5] -= damper
        D[5, 2] -= damper
        part = fs.Substructure(M, part.K, D, interface={"tip": [5], "middle": [2]}, ports=dict(part.ports), name="chain")
        return fs.couple({"chain": part, "other": fs.chain(3, interface=[1], fixed=False)},
                         [fs.Spring(("chain", "tip"), ("other", [0]), stiffness=spring)])

    def growth(speed: float = 0.2, force: float = 0.5, **of: float) -> tuple[fs.System, fs.Belt, fs.ComplexModes]:
        system, belt = model(**of), fs.Belt("chain.belt", force=force, speed=speed, law=law)
        return system, belt, fs.complex_modes(system, belt)

    system, belt, modes = growth()
    joint = system.joints[0]
    changes = [fs.AddedMass("chain.tip"), fs.JointChange(joint), fs.AddedDamper("chain.tip", to=("chain", [2]))]
    subject: fs.Substructure = system
    if reduced:  # complete, so that its modes are those of the full one
        subject = fs.couple({"chain": fs.reduce(system.parts["chain"], fs.CraigBampton(4)), "other": system.parts["other"]},
                            [joint])
        modes = fs.complex_modes(subject, belt)
    k = int(np.argmax(modes.eigenvalues.imag))
    found = fs.sensitivities(subject, belt, modes, ["speed", "force", *changes], of=[k])
    at = {"speed": 0.2, "force": 0.5, "mass": 0.0, "spring": 2.0, "damper": 0.0}
    for j, (name, now) in enumerate(at.items()):
        h = 1e-4
        ends = [fs.complex_modes(*growth(**{name: now + side * h})[:2]).eigenvalues for side in (-1, 1)]
        ends = [values[np.argmin(np.abs(values - modes.eigenvalues[k]))] for values in ends]
        exact = (ends[1] - ends[0]) / (2 * h) * (2.0 if name == "spring" else 1.0)  # of a joint: per its whole
        assert abs(found.first[0, j] - exact) <= 1e-6 * np.abs(found.first[0]).max(), name
    assert found.values.tolist()[:2] == [0.2, 0.5] and found.units[2:] == ("mass", "", "force time/length")


def numbers(family: Callable[..., fs.Substructure], change: fs.MaterialChange, steps: float,
            k: int = 0) -> tuple[complex, complex]:
    """∂λ/∂p of a model, and the central difference of the fourth order of rebuilt ones."""
    model = family(0.0)
    modes = fs.complex_modes(model)
    upper = np.flatnonzero(modes.eigenvalues.imag > 0)
    at = upper[np.argsort(modes.eigenvalues[upper].imag)[k]]
    found = fs.sensitivities(model, None, modes, [change], of=[at])

    def moved(side: int) -> complex:
        values = fs.complex_modes(family(side * steps)).eigenvalues
        return complex(values[np.argmin(np.abs(values - modes.eigenvalues[at]))])

    difference = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * steps)
    return complex(found.first[0, 0]), difference


@pytest.mark.sampled(2)
@pytest.mark.parametrize("parameter", ["E", "nu", "rho", "loss"])
def test_material_of_a_group_of_a_solid(parameter: str) -> None:
    mesh = fs.block((0.1, 0.02, 0.03), (2, 1, 1))
    mesh = fs.Mesh(mesh.points, mesh.cells, mesh.kind, sets=dict(mesh.sets), groups={"root": [0], "tip": [1]})
    soft = fs.Material(5e9, 0.25, 2500.0, loss=0.02)

    def family(step: float) -> fs.Substructure:
        return fs.solid(mesh, {"root": STEEL, "tip": replace(soft, **{parameter: getattr(soft, parameter) + step})},
                        supports=["left"], rayleigh=(3.0, 1e-7))

    change = fs.MaterialChange.solid(mesh, soft, parameter, cells="tip", rayleigh=(3.0, 1e-7))
    ours, theirs = numbers(family, change, 1e-3 * (getattr(soft, parameter)))
    assert abs(ours - theirs) <= 1e-7 * abs(theirs)


@pytest.mark.parametrize("parameter", ["E", "nu", "rho", "thickness"])
@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_material_of_a_plate(parameter: str, kind: str) -> None:
    mesh = fs.rectangle((0.3, 0.2), (3, 2), kind)
    now = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "thickness": 0.004}

    def family(step: float) -> fs.Substructure:
        return fs.plate(mesh, **{**now, parameter: now[parameter] + step}, supports={"left": "clamped"})

    change = fs.MaterialChange.plate(mesh, parameter, **now)  # type: ignore[arg-type]
    ours, theirs = numbers(family, change, 1e-3 * now[parameter], k=1)
    assert abs(ours - theirs) <= 1e-7 * abs(theirs)


def test_material_of_a_beam_is_its_closed_form() -> None:
    """ω = (kπ/L)² √(EI/ρA): ω_E = ω/2E, ω_I = ω/2I, ω_ρ = -ω/2ρ, ω_A = -ω/2A, ω_EE = -ω/4E²."""
    now = {"E": 2.1e11, "I": 1e-8, "rho": 7850.0, "A": 1e-4}
    beam = fs.beam(1.0, 8, **now, supports={"left": "pinned", "right": "pinned"})
    modes = fs.complex_modes(beam, count=4)
    changes = [fs.MaterialChange.beam(1.0, 8, name, **now) for name in now]
    found = fs.sensitivities(beam, None, modes, changes, second=True)
    for k, value in enumerate(modes.eigenvalues):
        assert np.allclose(found.relative[k], value * np.array([0.5, 0.5, -0.5, -0.5]), rtol=1e-7)
        assert np.isclose(found.second[k, 0, 0] * now["E"] ** 2, -value / 4, rtol=1e-6)
        assert np.isclose(found.second[k, 0, 2] * now["E"] * now["rho"], -value / 4, rtol=1e-6)


def test_newton_and_bfgs_take_them_as_gradients() -> None:
    sub = fs.chain(10, belt=2)

    def growth(slope: float) -> tuple[float, float]:
        belt = fs.Belt(slope=slope)
        modes = fs.complex_modes(sub, belt)
        k = int(np.argmax(modes.eigenvalues.real))
        return modes.eigenvalues[k].real, fs.sensitivities(sub, belt, modes, ["slope"], of=[k]).growth[0, 0]

    root = optimize.root_scalar(growth, x0=-0.03, fprime=True)
    assert root.converged and np.isclose(root.root, float(fs.critical_slope(sub)), rtol=1e-6)

    masses = [fs.AddedMass([4]), fs.AddedMass([9])]

    def tried(p: np.ndarray) -> tuple[fs.Substructure, fs.ComplexModes]:
        model = fs.modified(sub, [replace(one, amount=float(amount)) for one, amount in zip(masses, p, strict=True)])
        return model, fs.complex_modes(model, count=4)

    wanted = tried(np.array([0.4, 0.2]))[1].frequencies[::2]

    def tuned(p: np.ndarray) -> tuple[float, np.ndarray]:
        """How far the first two frequencies are from those wanted."""
        model, modes = tried(p)
        at = np.flatnonzero(modes.eigenvalues.imag > 0)
        found = fs.sensitivities(model, None, modes, masses, of=at.tolist())
        off = np.abs(modes.eigenvalues[at].imag) - wanted
        return float(off @ off), 2 * off @ found.frequency

    best = optimize.minimize(tuned, [0.0, 0.0], jac=True, method="BFGS", tol=1e-12)
    assert np.allclose(best.x, [0.4, 0.2], atol=1e-6)


@dataclass(frozen=True)
class Cubic:
    """A contact whose stiffness depends on a speed by a function of its own."""

    speed: float = 2.0
    ports: ClassVar[tuple[str, ...]] = ("belt",)
    affine_through: ClassVar[dict[str, Any]] = {"speed": lambda v: v**3 - np.exp(-v) / np.sqrt(v)}

    def linearised(self, model: Any) -> tuple[Any, Any]:
        return None, 0.1 * self.affine_through["speed"](self.speed)


def test_a_function_of_a_contact_has_its_first_and_second_derivative() -> None:
    sub = fs.chain(5, belt=3)
    found = fs.sensitivities(sub, Cubic(), modes := fs.complex_modes(sub, Cubic()), ["speed"], of=[0], second=True)
    h = 1e-3
    ends = [fs.complex_modes(sub, Cubic(2.0 + side * h)).eigenvalues for side in (-2, -1, 0, 1, 2)]
    a, b, c, d, e = (values[np.argmin(np.abs(values - modes.eigenvalues[0]))] for values in ends)
    assert np.isclose(found.first[0, 0], (8 * (d - b) - (e - a)) / (12 * h), rtol=1e-8)
    assert np.isclose(found.second[0, 0, 0], (16 * (d + b) - (a + e) - 30 * c) / (12 * h * h), rtol=1e-5)


def test_jets_are_the_derivatives_of_their_functions() -> None:
    mp.mp.dps = 30
    for name in ("exp", "log", "sin", "cos", "tan", "tanh", "sinh", "cosh", "arctan", "sqrt", "expm1", "log1p", "square",
                 "reciprocal"):
        plain = {"arctan": mp.atan, "square": lambda x: x**2, "reciprocal": lambda x: 1 / x}.get(name) or getattr(mp, name)
        jet = getattr(np, name)(Jet.of(0.7, 0, 1) * 2.0 - 0.5)
        wanted = [float(mp.diff(lambda p, of=plain: of(2 * p - mp.mpf("0.5")), mp.mpf("0.7"), order)) for order in (0, 1, 2)]
        assert np.allclose([jet.value, jet.first[0], jet.second[0, 0]], wanted, rtol=1e-9), name
    x, y = (Jet.of(value, at, 2) for at, value in enumerate((1.5, 0.5)))
    jet = abs(-x) ** y / (2.0 - y) + 3.0
    f = [float(mp.diff(lambda a, b: a**b / (2 - b) + 3, (1.5, 0.5), order)) for order in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
    assert np.allclose([*jet.first, jet.second[0, 0], jet.second[0, 1], jet.second[1, 1]], f, rtol=1e-9)


def test_bad_requests_are_refused_by_name() -> None:
    sub, belt = fs.chain(5, belt=2), fs.Belt(slope=-0.02)
    modes = fs.complex_modes(sub, belt)
    for parameters, text in ((["mu"], "mu"), ([], "empty"), (["slope", "slope"], "twice"), ([3], "change"),
                             ([fs.AddedMass("nowhere")], "nowhere"), ([fs.AddedMass([99])], "99"),
                             ([fs.AddedMass([1, 1])], "once")):
        with pytest.raises(fs.FemsubError, match=text):
            fs.sensitivities(sub, belt, modes, parameters)  # type: ignore[arg-type]
    with pytest.raises(fs.InputError, match="another model"):
        fs.sensitivities(fs.chain(6, belt=2), belt, modes, ["slope"])
    with pytest.raises(fs.InputError, match="kink"):
        fs.sensitivities(sub, still := fs.Belt(speed=0.0, law=fs.StribeckArctan()), fs.complex_modes(sub, still), ["speed"])
