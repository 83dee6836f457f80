"""The contact of docs/extend/contact.md, and several at once, go wherever a belt goes, or are refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from extendpages import names_of

import femsub as fs
from femsub.checks import Array
from femsub.motion.first_order import Flow

Rubbing: Any = names_of("contact", blocks=1)["Rubbing"]  # K + W k [[1, 0], [μ, 0]] Wᵀ on the ports "normal", "tangential"

def part(n: int = 12, sparse: bool = True) -> fs.Substructure:
    """A chain whose masses move in two directions, with ports at its end."""
    chain = fs.chain(n, belt=2, damping=0.02)
    M, D, K = (sp.block_diag([A, factor * A], format="csr") for A, factor in ((chain.M, 1.0), (chain.D, 1.0), (chain.K, 1.4)))
    unit = np.eye(2 * n)
    ports = {"belt": unit[1], "normal": unit[n - 1], "tangential": unit[2 * n - 1]}
    parts = (M, K, D) if sparse else (M.toarray(), K.toarray(), D.toarray())
    return fs.Substructure(*parts, interface=[0], ports=ports, name="two directions")


def explicit(sub: fs.Substructure, rubbing: Any, slope: float = 0.0) -> tuple[Array, Array, Array]:
    """M, D, K with the contacts written into them by hand."""
    M, D, K = (A.toarray() if sp.issparse(A) else A.copy() for A in (sub.M, sub.D, sub.K))
    n, t, b = (int(np.argmax(sub.port(name))) for name in ("normal", "tangential", "belt"))
    K[n, n] += rubbing.k
    K[t, n] += rubbing.k * rubbing.mu
    D[b, b] += slope
    return M, D, K


def spectrum(M: Array, D: Array, K: Array) -> Array:
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return np.linalg.eigvals(A)


def apart(found: Array, exact: Array) -> float:
    """The largest distance of a value found to the nearest exact one."""
    return float(np.abs(found[:, None] - exact).min(axis=1).max())


@pytest.mark.parametrize("sparse", [True, False])
def test_it_stands_in_the_pencil_as_written_by_hand(sparse: bool) -> None:
    sub, rubbing = part(sparse=sparse), Rubbing(k=2.0, mu=0.5)
    pencil = sub.linearised([rubbing, fs.Belt(slope=-0.1)])
    M, D, K = explicit(sub, rubbing, -0.1)
    for name, exact in zip("MDK", (M, D, K), strict=True):
        found = getattr(pencil, name)
        assert sp.issparse(found) is sparse
        np.testing.assert_allclose(found.toarray() if sparse else found, exact, atol=1e-15)
    assert pencil.symmetric == (True, True, False) and sub.linearised(rubbing).M is sub.pencil.M
    assert sub.linearised(()).K is sub.pencil.K
    modes = fs.complex_modes(sub, [rubbing, fs.Belt(slope=-0.1)])
    assert len(modes) == 48 and apart(modes.eigenvalues, spectrum(M, D, K)) < 1e-12


def test_full_and_complete_reduced_model_agree_under_it() -> None:
    sub, contacts = part(), [Rubbing(k=0.5, mu=0.8), fs.Belt(slope=-0.02)]
    rom = fs.reduce(sub, fs.CraigBampton(23), ports=True)
    full, small = (fs.complex_modes(model, contacts, count=10) for model in (sub, rom))
    assert apart(small.eigenvalues, full.eigenvalues) < 1e-10
    coarse = fs.reduce(sub, fs.CraigBampton(12), ports=True)
    modes = fs.complex_modes(coarse, contacts, count=6)
    refined = fs.refine(sub, modes, coarse, contacts)
    assert apart(refined.modes.eigenvalues, full.eigenvalues) < 1e-8 < np.nanmax(refined.moved)


@pytest.mark.slow
def test_a_large_model_under_it_is_counted() -> None:
    sub, contacts = part(200), [Rubbing(k=0.5, mu=0.8), fs.Belt(slope=-0.02)]
    modes = fs.complex_modes(sub, contacts, band=(0.0, 0.06))
    exact = spectrum(*explicit(sub, Rubbing(0.5, 0.8), -0.02))
    inside = exact[(exact.imag >= 0) & (exact.imag <= 0.06) & (np.abs(exact.real) <= 0.06)]
    assert len(modes) == len(inside) > 5 and modes.evidence == "certified"
    assert apart(inside, modes.eigenvalues) < 1e-9


@pytest.mark.slow
def test_a_linear_contact_says_the_same() -> None:
    sub, rubbing = part(), Rubbing(k=2.0, mu=0.5)
    given = fs.LinearContact(("normal", "tangential"), stiffness=[[2.0, 0.0], [1.0, 0.0]])
    assert np.array_equal(sub.linearised(given).K.toarray(), sub.linearised(rubbing).K.toarray())
    belt = fs.LinearContact("belt", damping=[[-0.1]])
    assert np.array_equal(sub.linearised(belt).D.toarray(), sub.linearised(fs.Belt(slope=-0.1)).D.toarray())
    turning = fs.LinearContact(("normal", "tangential"), damping=[[0.0, 0.3], [-0.3, 0.1]], stiffness=np.eye(2))
    large = fs.complex_modes(part(200), [turning, belt], band=(0.0, 0.04))  # D with an unsymmetric term, K with a symmetric one
    assert large.evidence == "certified"
    pencil = part(200).linearised([turning, belt]).dense()
    exact = spectrum(pencil.M, pencil.D, pencil.K)
    inside = exact[(exact.imag >= 0) & (exact.imag <= 0.04) & (np.abs(exact.real) <= 0.04)]
    assert len(inside) == len(large) and apart(inside, large.eigenvalues) < 1e-9
    u, v = np.array([1.0, 2.0]), np.array([-1.0, 0.5])
    np.testing.assert_allclose(turning.exerted(u, v), [-1.15, -2.35], atol=1e-15)


@pytest.mark.slow
def test_its_own_parameter_is_searched_for_the_loss_of_stability() -> None:
    sub = part(8, sparse=False)
    sub = sub.with_damping(0.01 * sub.K)
    contacts = [Rubbing(k=0.5), fs.LinearContact(("normal", "tangential"), stiffness=[[0.5, 0.3], [0.3, 0.5]])]
    full = fs.critical_value(sub, contacts, "mu", between=(-6.0, 6.0))
    assert full.evidence == "certified" and not full.open and {"flutter", "divergence"} == {
        one.kind for one in (*full.losses, *full.regains)}
    for one in (*full.losses, *full.regains):
        below, above = (len(fs.complex_modes(sub, [replace(contacts[0], mu=one.value + step), contacts[1]]).unstable)
                        for step in (-1e-6, 1e-6))
        assert above - below == (1 if one in full.losses else -1) * (2 if one.omega else 1)
    rom = fs.reduce(sub, fs.CraigBampton(15), ports=True)  # complete
    small = fs.critical_value(rom, contacts, "mu", between=(-6.0, 6.0))
    assert [one.value for one in small.losses] == pytest.approx([one.value for one in full.losses], rel=1e-8)


def test_a_study_takes_several_contacts() -> None:
    sub, contacts = part(), [fs.Belt(slope=-0.02), Rubbing(k=0.5, mu=0.2)]
    table = fs.study(sub, [fs.CraigBampton(6)], (0.0, 0.5), contacts=contacts, ports=True, repeats=1)
    full = fs.complex_modes(sub, contacts, band=(0.0, 0.5))
    assert table.full.growth == pytest.approx(full.eigenvalues.real.max(), rel=1e-9) and table.rows[0].missing == 0
    assert np.isnan(table.full.critical) and "critical_value" in table.full.reason
    two = [fs.Belt(slope=-0.02), fs.LinearContact("normal", damping=[[0.05]])]
    one, both = (fs.study(sub, [fs.CraigBampton(6)], (0.0, 0.5), contacts=some, ports=True, repeats=1) for some in (two[0], two))
    assert both.full.critical < one.full.critical
    alone = fs.critical_slope(sub.with_damping(sub.linearised(two[1]).D), band=(0.0, 0.5))
    assert both.full.critical == alone.value == fs.critical_slope(sub, contacts=two[1], band=(0.0, 0.5)).value


@dataclass(frozen=True)
class Hardening(Rubbing):  # type: ignore[misc]
    """The same with a normal force k u_n + h u_n³ and a dashpot: what it exerts, and the tangents."""

    h: float = 0.0
    d: float = 0.0

    def linearised(self, model: fs.Substructure) -> tuple[Array, Array]:  # type: ignore[override]
        return np.diag([self.d, 0.0]), super().linearised(model)[1]

    def exerted(self, u: Array, v: Array) -> Array:
        normal = self.k * u[0] + self.h * u[0] ** 3
        return np.array([-normal - self.d * v[0], -self.mu * normal])

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        slope = self.k + 3 * self.h * u[0] ** 2
        return np.array([[-slope, 0.0], [-self.mu * slope, 0.0]]), np.diag([-self.d, 0.0])


def test_in_time_a_linear_contact_moves_as_its_pencil_says() -> None:
    sub = part(4, sparse=False)
    rubbing = Hardening(k=0.7, mu=0.4, d=0.05)
    run = fs.transient(sub, rubbing, (0.0, 30.0), impulse={"normal": 1e-2}, samples=60, record="states")
    pencil, n = sub.linearised(rubbing), sub.size
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(pencil.M, pencil.K), -np.linalg.solve(pencil.M, pencil.D)]])
    start = np.concatenate([np.zeros(n), np.linalg.solve(sub.M, 1e-2 * sub.port("normal"))])
    exact = (la.expm(A * 30.0) @ start)[:n]
    assert run.states is not None and np.abs(run.states[0][-1] - exact).max() < 1e-7 * np.abs(exact).max()
    assert run.energy.residual < 1e-6 and run.effort.method == "lsoda"
    given = fs.LinearContact(("normal", "tangential"), stiffness=[[0.7, 0.0], [0.28, 0.0]], damping=np.diag([0.05, 0.0]))
    other = fs.transient(sub, given, (0.0, 30.0), impulse={"normal": 1e-2}, samples=60, record="states")
    assert other.states is not None and np.abs(other.states[0][-1] - exact).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize("method", ["lsoda", "radau"])
def test_in_time_it_acts_beside_a_belt(method: str) -> None:
    sub, law = part(4, sparse=False), fs.StribeckArctan(eps=5e-2)
    contacts = [fs.Belt(speed=0.2, law=law), Hardening(k=0.7, mu=0.4, h=0.5, d=0.05)]
    run = fs.transient(sub, contacts, (0.0, 10.0), impulse=0.05, step=0.05, method=method)
    assert run.energy.residual < 1e-6 and list(run.contact.ports) == ["belt", "normal", "tangential"]
    assert "Hardening on normal, tangential" in repr(run.contact)
    rest = run.contact.equilibrium
    assert not run.contact.pull(rest).any() and np.abs(run.contact.exerted(run.contact.W.T @ rest, np.zeros(3))[1:]).min() > 0
    u, v, h = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.1, 0.2]), 1e-6
    for at, tangent in enumerate(run.contact.tangents(u, v)):
        for j in range(3):
            step = h * np.eye(3)[j]
            moved = [run.contact.exerted(u + sign * step * (at == 0), v + sign * step * (at == 1)) for sign in (1, -1)]
            np.testing.assert_allclose(tangent[:, j], (moved[0] - moved[1]) / (2 * h), atol=1e-7)
    system = Flow(run.contact, run.start, 0.0, 1e-9, "lsoda", run.contact.W)
    y = np.random.default_rng(0).standard_normal(2 * sub.size + 2)
    exact = system.jacobian(0.0, y).T.copy()
    for j in range(len(y)):
        step = h * np.eye(len(y))[j]
        difference = (system.rate(0.0, y + step).copy() - system.rate(0.0, y - step)) / (2 * h)
        np.testing.assert_allclose(exact[:, j], difference, atol=1e-6 * np.abs(exact).max())
    assert "normal" in run.displacements and np.isfinite(run.velocity("tangential")).all()


def test_what_moves_not_is_refused_by_name() -> None:
    sub = part(4, sparse=False)
    with pytest.raises(fs.InputTypeError, match=r"Rubbing has no exerted\(u, v\)"):
        fs.transient(sub, Rubbing())


def test_where_it_has_no_place_it_is_refused_by_name() -> None:
    sub = part()
    belt = fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2))
    still = fs.State(np.zeros(sub.size), np.zeros(sub.size))
    calls = (lambda c: fs.harmonic_balance(sub, c), lambda c: fs.shoot(sub, c, still, 1.0), lambda c: fs.branch(sub, c))
    for call in calls:
        with pytest.raises(fs.InputTypeError, match=r"Rubbing has no exerted\(u, v\)"):
            call([belt, Rubbing()])


def test_what_is_no_contact_is_told() -> None:
    sub = part()

    class Half(Rubbing):  # type: ignore[misc]
        def linearised(self, model: fs.Substructure) -> Array:  # type: ignore[override]
            return np.eye(2)

    class Wide(Rubbing):  # type: ignore[misc]
        def linearised(self, model: fs.Substructure) -> tuple[None, Array]:
            return None, np.eye(3)

    for wrong, told in ((Half(), r"must return \(C_D, C_K\)"), (Wide(), r"shape \(3, 3\), but its ports .* have 2 columns"),
                        (Rubbing(k=np.nan), "NaN or Inf"), (fs.LinearContact("elsewhere", stiffness=[[1.0]]), "port 'elsewhere'"),
                        (Rubbing, "list of Belts or other contacts"), ([Rubbing], "must be a Belt, a LinearContact"),
                        (fs.LinearContact("belt", stiffness=np.eye(2)), "have 1 columns")):
        with pytest.raises((fs.InputError, fs.InputTypeError), match=told):
            fs.complex_modes(sub, wrong)
    with pytest.raises(fs.InputError, match="contacts that add to D only"):
        fs.reduce(sub, fs.CraigBampton(band=(0, 1), tol=1e-3), contacts=Rubbing())
    for arguments, told in ((((), np.eye(1)), "at least one port"), ((("n",),), "needs stiffness or damping"),
                            ((("n",), np.ones((1, 2))), "must be square"), ((("n",), np.eye(2), np.eye(1)), "but damping")):
        with pytest.raises(fs.InputError, match=told):
            fs.LinearContact(*arguments)
    assert replace(Rubbing(), mu=0.1).mu == 0.1
