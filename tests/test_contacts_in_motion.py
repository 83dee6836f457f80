"""Contacts with stiffness in motion: in time for any size, limit cycles by harmonic balance and shooting, surfaces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import solve_ivp

import femsub as fs
from femsub.checks import Array
from femsub.coupling.contacts.friction_contact import FrictionInMotion
from femsub.model.contact import small_matrices
from femsub.motion.cycles.balance import Balance, Orbit
from femsub.motion.cycles.compliance import compliance
from femsub.motion.cycles.continuation import Path
from femsub.motion.nonlinear_model import sliding

LAW = fs.StribeckArctan(eps=5e-2)


@dataclass(frozen=True)
class VanDerPol:
    """f = ε (1 - u²) v - b u² at one port, which moves a mass on a spring in a cycle."""

    eps: float = 1.0
    b: float = 0.0
    ports: ClassVar[tuple[str, ...]] = ("mass",)

    def linearised(self, model: fs.Substructure) -> tuple[float, None]:
        return -self.eps, None

    def exerted(self, u: Array, v: Array) -> Array:
        return self.eps * (1 - u**2) * v - self.b * u**2

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        return np.diag(-2 * self.eps * u * v - 2 * self.b * u), np.diag(self.eps * (1 - u**2))


@dataclass(frozen=True)
class Bumper:
    """A normal spring k u + h u³, whose force c times as large acts along the second port: columns that act on each other."""

    k: float = 0.4
    h: float = 0.6
    c: float = 0.3
    ports: tuple[str, str] = ("normal", "tangential")

    def linearised(self, model: fs.Substructure) -> tuple[None, Array]:
        return None, self.k * np.array([[1.0, 0.0], [self.c, 0.0]])

    def exerted(self, u: Array, v: Array) -> Array:
        return -(self.k * u[0] + self.h * u[0] ** 3) * np.array([1.0, self.c])

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        return -(self.k + 3 * self.h * u[0] ** 2) * np.array([[1.0, 0.0], [self.c, 0.0]]), np.zeros((2, 2))


def part(n: int, sparse: bool = False) -> fs.Substructure:
    """A chain with two ports for belts, and two for a bumper."""
    chain, unit = fs.chain(n, damping=0.02), np.eye(n)
    ports = {"belt": unit[1], "other": unit[n // 2], "normal": unit[n - 1], "tangential": unit[0]}
    parts = [getattr(chain, name) if sparse else getattr(chain, name).toarray() for name in "MKD"]
    return fs.Substructure(*parts, ports=ports)


def integrated(model: fs.Substructure, W: Array, force: Any, start: Array, times: Array) -> Array:
    """q(t) and q̇(t) by SciPy's Radau or DOP853 from M q̈ = W f(Wᵀq, Wᵀq̇) - D q̇ - K q, written down anew; (2n, times)."""
    pencil, n = model.pencil.dense(), model.size

    def rate(_: float, y: Array) -> Array:
        q, v = y[:n], y[n:]
        return np.concatenate([v, np.linalg.solve(pencil.M, W @ force(W.T @ q, W.T @ v) - pencil.D @ v - pencil.K @ q)])

    return solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=1e-10, atol=1e-13).y


def both(belts: list[fs.Belt], bumper: Bumper) -> Any:
    """f of two belts and a bumper, in the order of their columns."""
    def force(u: Array, v: Array) -> Array:
        rubbing = [belt.force * belt.law.value(belt.speed - v[i]) for i, belt in enumerate(belts)]  # type: ignore[union-attr]
        spring = bumper.k * u[2] + bumper.h * u[2] ** 3
        return np.array([*rubbing, -spring, -bumper.c * spring])

    return force


CONTACTS: tuple[Any, ...] = (fs.Belt(speed=0.2, law=LAW), fs.Belt("other", 0.5, 0.3, LAW), Bumper())


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.parametrize(("method", "tol", "close"), [("lsoda", None, 1e-6), ("alpha", 1e-6, 2e-2)])
def test_several_belts_and_an_own_contact_in_time(method: str, tol: float | None, close: float) -> None:
    """Against an integration by SciPy of the equations as they stand, from a start far from rest."""
    model = part(6, sparse=method == "alpha")
    rng = np.random.default_rng(3)
    start = fs.State(0.2 * rng.standard_normal(6), 0.2 * rng.standard_normal(6))
    run = fs.transient(model, CONTACTS, (0.0, 6.0), start=start, step=0.5, record="states", method=method, tol=tol)
    assert run.effort.method == method and run.energy.residual < (1e-6 if method == "lsoda" else 1e-2)
    W = np.column_stack([model.port(name) for name in ("belt", "other", "normal", "tangential")])
    exact = integrated(model, W, both(list(CONTACTS[:2]), Bumper()), np.concatenate([start.displacement, start.velocity]), run.t)
    assert run.states is not None
    found = np.hstack(run.states).T
    assert np.abs(found - exact).max() < close * np.abs(exact).max()
    without = fs.transient(model, CONTACTS[:2], (0.0, 6.0), start=start, step=0.5, record="states", method=method, tol=tol)
    assert without.states is not None and np.abs(np.hstack(without.states).T - exact).max() > 0.1 * np.abs(exact).max()


@pytest.mark.rare
def test_the_generalised_alpha_method_takes_a_contact_much_stiffer_than_the_model() -> None:
    """A wave is reflected by a spring a thousand times as stiff as the model's, in a contact that S does not contain."""
    n, end = 310, 30.0
    model = part(n, sparse=True)
    stiff = fs.LinearContact(("normal", "tangential"), stiffness=[[1e3, 0.0], [200.0, 0.0]], damping=[[2.0, 0.0], [0.0, 0.0]])
    start = np.concatenate([1e-2 * np.exp(-(((np.arange(n) - n + 20) / 6.0) ** 2)), np.zeros(n)])
    exact, free = (_moved(pencil.dense(), start, end) for pencil in (model.linearised(stiff), model.pencil))
    errors = []
    for tol in (1e-4, 1e-5):
        run = fs.transient(model, stiff, (0.0, end), start=fs.State(start[:n], start[n:]), samples=10, tol=tol)
        assert run.effort.method == "alpha" and run.energy.residual < 2e-2
        found = np.concatenate([run.final.displacement, run.final.velocity])
        errors.append(float(np.abs(found - exact).max() / np.abs(exact).max()))
    assert errors[1] < 1e-3 and errors[1] < 0.5 * errors[0] and np.abs(free - exact).max() > np.abs(exact).max()


def _moved(pencil: fs.Pencil, start: Array, end: float) -> Array:
    """exp(A t) y, by eigenvectors."""
    n = pencil.size
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(pencil.M, pencil.K), -np.linalg.solve(pencil.M, pencil.D)]])
    values, shapes = np.linalg.eig(A)
    return (shapes @ (np.exp(end * values) * np.linalg.solve(shapes, start))).real


# limit cycles


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("eps", "period"), [(0.1, 6.2871), (1.0, 6.6632868593)])
def test_van_der_pol(eps: float, period: float) -> None:
    """The period at ε = 1 is 6.6632868593..., 2π(1 + ε²/16 - 5ε⁴/3072 + ...) for small ε."""
    model, contact = fs.Substructure([[1.0]], [[1.0]], ports={"mass": [1.0]}), VanDerPol(eps)
    start = fs.State(np.array([1.0]), np.array([0.0]))
    run = fs.transient(model, contact, (0.0, 100.0), start=start, step=0.02, record_from=60.0)
    cycle = fs.harmonic_balance(model, contact, start=run, harmonics=30)
    assert cycle.period == pytest.approx(period, abs=1e-9 if eps == 1 else 1e-4)
    shot = fs.shoot(model, contact, cycle)
    assert shot.period == pytest.approx(cycle.period, rel=1e-8) and shot.is_stable
    assert cycle.is_stable is None and "stability not computed" in repr(cycle) and "no belt" in repr(cycle)
    assert cycle.state().displacement == pytest.approx(shot.state.displacement, abs=1e-7)
    again = fs.harmonic_balance(model, contact, start=cycle, harmonics=30)
    assert again.omega == pytest.approx(cycle.omega, rel=1e-10) and again.newton <= 3


@pytest.mark.rare
def test_the_mean_displacement_follows_an_even_force() -> None:
    """-b u² shifts the mean by -b⟨u²⟩ / k: it is eliminated, and agrees with the mean of the orbit that shooting finds."""
    model, contact = fs.Substructure([[1.0]], [[2.0]], ports={"mass": [1.0]}), VanDerPol(0.5, 0.2)
    start = fs.State(np.array([0.5]), np.array([0.0]))
    run = fs.transient(model, contact, (0.0, 100.0), start=start, step=0.02, record_from=60.0)
    cycle = fs.harmonic_balance(model, contact, start=run)
    shot = fs.shoot(model, contact, cycle)
    assert shot.residual < 1e-8 and shot.period == pytest.approx(cycle.period, rel=1e-7) and shot.steps <= 3
    times = np.linspace(0, cycle.period, 41)[:-1]
    places = np.array([cycle.state(t).displacement[0] for t in times])
    begin = np.concatenate([shot.state.displacement, shot.state.velocity])
    exact = integrated(model, np.eye(1), contact.exerted, begin, times)[0]
    np.testing.assert_allclose(places, exact, atol=1e-4 * np.abs(exact).max())
    assert places.mean() == pytest.approx(-0.2 * (places**2).mean() / 2.0, rel=1e-4) and places.mean() < -0.05


@pytest.mark.rare
def test_belts_beside_a_bumper_in_a_cycle() -> None:
    """Two belts and a contact with coupled columns: harmonic balance from a transient, closed by shooting."""
    model = part(5)
    run = fs.transient(model, CONTACTS, (0.0, 600.0), impulse=0.1, step=0.1, record_from=450.0)
    cycle = fs.harmonic_balance(model, CONTACTS, start=run, harmonics=25)
    shot = fs.shoot(model, CONTACTS, cycle)
    assert cycle.residual < 1e-8 and shot.residual < 1e-8 and shot.steps <= 3
    assert shot.omega == pytest.approx(cycle.omega, rel=1e-6) and shot.rms == pytest.approx(cycle.rms, rel=1e-4)
    assert cycle.orbit.v.shape[1] == 4 and 0 <= cycle.sticking <= 1 and cycle.rms > 0.02
    found = fs.branch(model, CONTACTS, "force", (0.95, 1.05), start=cycle, harmonics=25, points=9)
    assert found.values.min() < 1.0 < found.values.max() and "stability not computed" in repr(found)
    for value, point in ((found.values[0], found.points[0]), (found.values[-1], found.points[-1])):
        changed = (replace(CONTACTS[0], force=float(value)), *CONTACTS[1:])
        alone = fs.harmonic_balance(model, changed, start=cycle, harmonics=point.orbit.harmonics)
        assert point.omega == pytest.approx(alone.omega, rel=1e-8) and point.rms == pytest.approx(alone.rms, rel=1e-7)
        assert abs(point.rms / cycle.rms - 1) > 1e-4


@pytest.mark.slow
def test_the_jacobian_of_coupled_contacts_is_exact() -> None:
    model, rng = part(5), np.random.default_rng(0)
    contact = sliding(model, (CONTACTS[0], Bumper(h=2.0), VanDerPolAt("other")))
    balance = Balance(contact, compliance(contact))
    orbit = Orbit(0.2 * (rng.standard_normal((3, 4)) + 1j * rng.standard_normal((3, 4))) / np.arange(1, 4)[:, None] ** 2, 0.6)
    count, x = 64, orbit.vector
    J = balance.derivative(orbit, balance.residual(orbit, count))

    def residual(x: Array) -> Array:
        R = balance.residual(orbit.at(x), count)[0]
        return np.concatenate([R.real.ravel(), R.imag.ravel()])

    for j in range(len(x)):
        step = 1e-6 * np.eye(len(x))[j]
        np.testing.assert_allclose(J[:, j], (residual(x + step) - residual(x - step)) / 2e-6, atol=2e-6 * np.abs(J).max())
    path = Path(contact, balance.flexibility, "force", 0, (1.0, 1.0, 1.0), 1e-3, 10)
    ahead, behind = (path._system(orbit, value, count)[0] for value in (1.0 + 1e-4, 1.0 - 1e-4))
    by_force = path._system(orbit, 1.0, count)[1][:-1, -1]
    np.testing.assert_allclose(by_force, (ahead - behind)[:-1] / 2e-4, atol=1e-6 * np.abs(by_force).max())


@dataclass(frozen=True)
class VanDerPolAt:
    """The same at any port, with an even force."""

    port: str

    @property
    def ports(self) -> tuple[str, ...]:
        return (self.port,)

    def linearised(self, model: fs.Substructure) -> tuple[float, None]:
        return -1.0, None

    def exerted(self, u: Array, v: Array) -> Array:
        return VanDerPol(0.3, 0.4).exerted(u, v)

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        return VanDerPol(0.3, 0.4).tangents(u, v)


def test_an_evaluation_does_not_depend_on_what_was_evaluated_before() -> None:
    contact, rng = sliding(part(5), CONTACTS), np.random.default_rng(1)
    balance = Balance(contact, compliance(contact))
    orbits = [Orbit(size * (rng.standard_normal((3, 4)) + 1j * rng.standard_normal((3, 4))), 0.6) for size in (0.02, 0.3)]
    first = [balance.residual(orbit, 64) for orbit in orbits]
    again = [balance.residual(orbit, 64) for orbit in reversed(orbits)][::-1]
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.R, other.R) and np.array_equal(one.course.mean, other.course.mean)
    assert np.abs(first[0].course.mean - first[1].course.mean).max() > 1e-3


def test_contacts_stand_in_the_order_given_and_the_motion_is_the_same() -> None:
    model, start = part(6), fs.State(0.1 * np.sin(np.arange(6.0)), np.zeros(6))
    turned = (CONTACTS[2], CONTACTS[1], CONTACTS[0])
    one, other = (fs.transient(model, contacts, (0.0, 10.0), start=start, samples=20) for contacts in (CONTACTS, turned))
    assert one.contact.ports == ["belt", "other", "normal", "tangential"]
    assert other.contact.ports == ["normal", "tangential", "other", "belt"]
    np.testing.assert_allclose(one.velocity("belt"), other.velocity("belt"), atol=1e-7)


def test_contacts_that_depend_on_speeds_alone_are_shifted_and_have_multipliers() -> None:
    """Dashpots between two ports beside a belt, as a contact and in D; their tangent is no diagonal."""
    model, belt = part(10), fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    C, names = 1e-3 * np.array([[3.0, 2.5], [1.5, 2.0]]), ("other", "tangential")
    dashpots, W = fs.LinearContact(names, damping=C), np.column_stack([model.port(name) for name in names])
    inside = fs.Substructure(model.M, model.K, model.D + W @ C @ W.T, ports=model.ports)
    alone, contacts = fs.harmonic_balance(inside, belt, harmonics=25), (dashpots, belt)
    contact = sliding(model, contacts)
    speeds = np.array([alone.state(at).velocity for at in alone.period * np.arange(64) / 64]) @ contact.W
    start = replace(alone, contact=contact, orbit=Orbit(np.fft.rfft(speeds, axis=0)[1:26] / 64, alone.omega),
                    flexibility=compliance(contact))
    cycle = fs.harmonic_balance(model, contacts, start=start, harmonics=25)
    assert cycle.omega == pytest.approx(alone.omega, rel=1e-7)
    assert cycle.floquet is not None and alone.floquet is not None
    np.testing.assert_allclose(np.abs(cycle.floquet.values[:4]), np.abs(alone.floquet.values[:4]), atol=1e-4)
    one, other = (fs.transient(sub, given, (0.0, 20.0), samples=10, impulse={"belt": 1e-3}) for sub, given in (
        (model, contacts), (inside, belt)))
    np.testing.assert_allclose(one.velocity("belt"), other.velocity("belt"), atol=1e-9)


@dataclass(frozen=True)
class AskedOneByOne(fs.Belt):
    columnwise: ClassVar[bool] = False


def test_a_contact_is_asked_at_all_times_at_once_or_time_by_time() -> None:
    model, given = part(5), {"port": "pair", "force": 0.7, "speed": 0.2, "law": LAW}
    pair = fs.Substructure(model.M, model.K, model.D, ports={"pair": np.eye(5)[:, [1, 3]]})
    v = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 9))
    one, other = (sliding(pair, kind(**given)) for kind in (fs.Belt, AskedOneByOne))
    np.testing.assert_allclose(one.exerted(v, v), other.exerted(v, v), rtol=1e-15)
    np.testing.assert_allclose(one.tangents(v, v), other.tangents(v, v), rtol=1e-14)


@pytest.mark.slow
def test_a_branch_over_a_parameter_of_a_contact_of_ones_own() -> None:
    """Van der Pol's ε: against shooting at one end, and the period at ε = 1, 6.6632868593, at the other."""
    model = fs.Substructure([[1.0]], [[1.0]], ports={"mass": [1.0]})
    start = fs.State(np.array([1.0]), np.array([0.0]))
    run = fs.transient(model, VanDerPol(0.9), (0.0, 100.0), start=start, step=0.02, record_from=60.0)
    cycle = fs.harmonic_balance(model, VanDerPol(0.9), start=run, harmonics=30)
    found = fs.branch(model, VanDerPol(0.9), "eps", (0.85, 1.0), start=cycle, harmonics=30, points=30)
    assert found.values[[0, -1]] == pytest.approx([0.85, 1.0], rel=1e-12)
    assert found.points[-1].period == pytest.approx(6.6632868593, rel=1e-7)
    shot = fs.shoot(model, VanDerPol(0.85), found.points[0])
    assert shot.period == pytest.approx(found.points[0].period, rel=1e-6) and shot.steps <= 3
    with pytest.raises(fs.InputError, match=r"unknown port of a contact with a eps 'maas'; did you mean 'mass'"):
        fs.branch(model, VanDerPol(0.9), "eps", (0.85, 1.0), start=cycle, port="maas")


def test_what_is_missing_for_a_cycle_is_told() -> None:
    model = part(5)
    for start in (None, 0.5):
        with pytest.raises(fs.InputError, match=r"with Bumper a cycle needs a start that moves: a transient, .*LimitCycle"):
            fs.harmonic_balance(model, CONTACTS, start=start)
    with pytest.raises(fs.InputError, match="several contacts, or one that is no belt, a branch must begin at a known cycle"):
        fs.branch(model, (CONTACTS[0], Bumper()))
    with pytest.raises(fs.InputError, match=r"unknown parameter 'slope'.* c, h, k"):
        fs.branch(model, Bumper())
    with pytest.raises(fs.InputError, match="at least one contact, such as a Belt"):
        fs.transient(model, ())


# friction of surfaces

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
K, MU, P, V, SLOPE = 1e12, 0.4, 2e6, 3.0, -0.05
AREA = 0.1 * 0.05
TURNING = {"direction": None, "axis": (0, 0, 1), "centre": (0.1, -0.3, 0)}
MESH = fs.block((0.1, 0.05, 0.02), (2, 1, 1))


def pad(**changed: Any) -> tuple[fs.Substructure, fs.FrictionContact]:
    """A block that is held at its top and rubs on rigid ground."""
    model = fs.solid(MESH, STEEL, supports=["top"], interface=["bottom"], rayleigh=(50.0, 1e-7))
    given = {"stiffness": K, "mu": MU, "pressure": P, "direction": (1.0, 0, 0), "speed": V, "slope": SLOPE, **changed}
    return model, fs.FrictionContact("bottom", "ground", MESH, **given)


def turning_pair() -> tuple[fs.Substructure, fs.FrictionContact]:
    """A pad on a plate that turns, with nodes elsewhere."""
    plate = fs.block((0.2, 0.1, 0.02), (3, 2, 1))
    meshes = {"pad": fs.Mesh(MESH.points + np.array([0.05, 0.02, 0.02]), MESH.cells, MESH.kind, MESH.sets), "plate": plate}
    parts = {"pad": fs.solid(meshes["pad"], STEEL, interface=["bottom", "top"], name="pad"),
             "plate": fs.solid(plate, STEEL, supports=["bottom"], interface=["top"], name="plate")}
    contact = fs.FrictionContact("pad.bottom", "plate.top", meshes, K, MU, P, speed=10.0, slope=SLOPE, axis=(0, 0, 1),
                                 centre=(0.1, -0.3, 0))
    return fs.couple(parts, [contact, fs.Spring(("pad", "top"), stiffness=1e6)]), contact


@pytest.mark.parametrize("case", ["direction", "without a speed", "without pressure", "turning pair"])
def test_about_steady_sliding_it_is_its_linearisation(case: str) -> None:
    """∂f/∂u = -C_K and ∂f/∂v = -C_D at the operating point, where it exerts nothing; differences agree elsewhere."""
    changed = {"without a speed": {"speed": None}, "without pressure": {"pressure": 0.0}}.get(case, {})
    model, contact = turning_pair() if case == "turning pair" else pad(**changed)
    _, C_D, C_K = small_matrices(model, contact)
    moving: Any = contact.in_motion(model)
    p = moving.N.shape[1]
    none = np.zeros(p)
    whole = sliding(model, contact)
    of_u, of_v = whole.tangents(none, none)
    assert not moving.exerted(none, none).any()
    assert np.abs(of_u + C_K).max() <= 1e-12 * np.abs(of_u).max()
    assert np.abs(of_v + (C_D.toarray() if sp.issparse(C_D) else C_D)).max() <= 1e-12 * max(np.abs(of_v).max(), 1.0)
    rng = np.random.default_rng(1)
    u, v = 2 * P / K * rng.standard_normal(p), 0.8 * V * rng.standard_normal(p)  # parted here and there, and turned
    if case in ("direction", "turning pair"):
        assert 0 < moving._pressed(u)[1].sum() < len(moving.area)
    for at, size, exact in zip((0, 1), (P / K, V), whole.tangents(u, v), strict=True):
        change, h = rng.standard_normal(p), 1e-7 * size
        step = h * change
        ahead, behind = (moving.exerted(u + sign * step * (at == 0), v + sign * step * (at == 1)) for sign in (1, -1))
        np.testing.assert_allclose(exact @ change, (ahead - behind) / (2 * h), atol=1e-5 * max(np.abs(exact @ change).max(), 1.0))


@pytest.mark.parametrize(("lift", "vx", "vy"), [(0.0, 0.0, 0.0), (-1e-6, 0.5, 0.0), (1e-6, -1.0, 2.0), (5e-6, 1.0, 1.0),
                                                (0.0, 2.99, 0.0), (0.0, 5.0, 0.5)])
def test_the_force_of_a_block_that_moves_as_a_whole(lift: float, vx: float, vy: float) -> None:
    """A [(P - p) n + μ(|w|) P w/|w| - μ p t] with P = max(p - k u, 0) and w = (V - vx, -vy), written down anew."""
    model, contact = pad()
    moving: Any = contact.in_motion(model)
    dofs = model.dofs
    assert dofs is not None
    axes = np.array([[label == dofs.labels[k] for k in dofs.components] for label in ("ux", "uy", "uz")], dtype=float)
    W = model.interface_rows[model.sets["bottom"]].T  # (n, p)
    W = W.toarray() if sp.issparse(W) else W
    f = moving.exerted(W.T @ (lift * axes[2]), W.T @ (vx * axes[0] + vy * axes[1]))
    found = axes @ (W @ f)
    pressure = max(P - K * lift, 0.0)
    w = np.array([V - vx, -vy])
    size = max(float(np.hypot(*w)), FrictionInMotion.slow * V)
    friction = (MU + SLOPE * (size - V)) * pressure * w / size - [MU * P, 0.0]
    np.testing.assert_allclose(found, AREA * np.append(friction, pressure - P), atol=1e-9 * P * AREA)


@pytest.mark.slow
def test_a_block_on_moving_ground_in_time() -> None:
    """Small motion is that of the pencil; large motion that of SciPy, with the surfaces parting in between."""
    model, contact = pad()
    pencil, n = model.linearised(contact).dense(), model.size
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(pencil.M, pencil.K), -np.linalg.solve(pencil.M, pencil.D)]])
    modes = fs.normal_modes(model, count=2)
    period = 2 * np.pi / modes.frequencies[0]
    shape = modes.shapes[:, 0] / np.abs(modes.shapes).max()
    for size, close in ((1e-12, 1e-5), (1e-5, 1e-4)):
        start = fs.State(size * shape, np.zeros(n))
        run = fs.transient(model, contact, (0.0, 3 * period), start=start, samples=30, record="states")
        assert run.states is not None and "FrictionContact" not in run.velocities and run.energy.residual < 1e-4
        y = np.concatenate([start.displacement, start.velocity])
        if size == 1e-12:
            exact = la.expm(A * run.t[-1]) @ y
            found = np.concatenate([run.states[0][-1], run.states[1][-1]])
            scale = np.repeat([np.abs(run.states[0]).max(), np.abs(run.states[1]).max()], n)
        else:
            moving: Any = contact.in_motion(model)
            W = run.contact.W
            exact = integrated(model, W, moving.exerted, y, run.t)
            found, scale = np.hstack(run.states).T, np.repeat([np.abs(part).max() for part in run.states], n)[:, None]
            parted = [not moving._pressed(W.T @ q)[1].all() for q in run.states[0]]
            assert any(parted) and not all(parted)
        assert np.abs((found - exact) / scale).max() < close
    with pytest.raises(fs.InputError, match="an impulse needs a port, but FrictionContact acts on no port"):
        fs.transient(model, contact, impulse=1.0)


@dataclass(frozen=True)
class Shaken:
    """Negative damping of a port up to a displacement, positive beyond, by which the pad moves in a cycle."""

    gain: float = 5e3
    size: float = 1e-6
    ports: ClassVar[tuple[str, ...]] = ("rub",)

    def linearised(self, model: fs.Substructure) -> tuple[float, None]:
        return -self.gain, None

    def exerted(self, u: Array, v: Array) -> Array:
        return self.gain * (1 - (u / self.size) ** 2) * v

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        return np.diag(-2 * self.gain * u * v / self.size**2), np.diag(self.gain * (1 - (u / self.size) ** 2))


@pytest.mark.slow
def test_a_cycle_under_friction_between_surfaces() -> None:
    """A pad that moves across the direction of sliding, which the friction follows: harmonic balance is closed by shooting."""
    mesh = fs.block((0.1, 0.05, 0.02), (1, 1, 1))
    model = fs.solid(mesh, STEEL, supports=["top"], interface=["bottom"], rayleigh=(50.0, 1e-8), ports={"rub": ("bottom", "y")})
    friction = fs.FrictionContact("bottom", "ground", mesh, stiffness=K, mu=MU, pressure=P, direction=(1.0, 0, 0), speed=V)
    contacts = (friction, Shaken())
    modes = fs.complex_modes(model, contacts)
    at = int(np.argmax(modes.eigenvalues.real))
    value, shape = modes.eigenvalues[at], modes.shapes[:, at]
    shape = 1.5e-6 * shape / (model.port("rub") @ shape)
    period = 2 * np.pi / value.imag
    start = fs.State(shape.real, (value * shape).real)
    given: dict[str, Any] = {"start": start, "step": period / 30, "record_from": 30 * period}
    run = fs.transient(model, contacts, (0.0, 45 * period), record="states", **given)
    assert np.abs(run.velocity("rub")).max() > 0.2 * V  # far from small
    cycle = fs.harmonic_balance(model, contacts, start=run, harmonics=5)
    shot = fs.shoot(model, contacts, cycle)
    assert cycle.residual < 1e-8 and shot.residual < 1e-8 and shot.is_stable
    assert shot.omega == pytest.approx(cycle.omega, rel=1e-6) and abs(shot.omega / value.imag - 1) > 1e-6
    assert shot.velocity.shape[0] == 25 and shot.rms == pytest.approx(cycle.rms, rel=1e-3)
    bare = fs.transient(model, contacts, (0.0, 32 * period), **given)
    with pytest.raises(fs.InputError, match=r"FrictionContact acts on the sets bottom, .*record='states'"):
        fs.harmonic_balance(model, contacts, start=bare)


@pytest.mark.slow
def test_two_friction_contacts_and_a_belt_by_two_integrators() -> None:
    """A block held by springs at its end, rubbing below and above: the generalised-α method on the sparse model, and LSODA."""
    mesh = fs.block((0.1, 0.05, 0.02), (1, 1, 1), "hexahedron")
    model = fs.solid(mesh, STEEL, supports=["left"], interface=["bottom", "top"], rayleigh=(50.0, 1e-7),
                     ports={"belt": ("right", "y")})
    contacts = [fs.FrictionContact(name, "ground", mesh, stiffness=1e11, mu=MU, pressure=P, direction=way, speed=V)
                for name, way in (("bottom", (1.0, 0, 0)), ("top", (0, 1.0, 0)))]
    belt = fs.Belt(force=100.0, speed=1.0, law=fs.StribeckArctan(eps=0.5))
    first = fs.normal_modes(model, count=1)
    start = fs.State(5e-6 * first.shapes[:, 0] / np.abs(first.shapes).max(), np.zeros(model.size))
    period = 2 * np.pi / first.frequencies[0]
    given: dict[str, Any] = {"start": start, "samples": 20, "record": "states"}
    exact = fs.transient(model, [belt, *contacts], (0.0, 2 * period), method="lsoda", **given)
    found = fs.transient(model, [belt, *contacts], (0.0, 2 * period), method="alpha", tol=1e-5, **given)
    assert exact.states is not None and found.states is not None and "FrictionContact on bottom" in repr(found.contact)
    for one, other in zip(found.states, exact.states, strict=True):
        assert np.abs(one - other).max() < 4e-3 * np.abs(other).max()
    for left_out in (belt, *contacts):
        rest = [one for one in (belt, *contacts) if one is not left_out]
        other = fs.transient(model, rest, (0.0, 2 * period), method="lsoda", **given)
        assert other.states is not None and np.abs(other.states[0] - exact.states[0]).max() > 1e-2 * np.abs(exact.states[0]).max()
