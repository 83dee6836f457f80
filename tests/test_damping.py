"""Rayleigh, modal and dashpot damping on full and reduced models."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane
from femsub.modes import turnover

STEEL = {"E": 210e9, "I": 1e-2**4 / 12, "rho": 7850.0, "A": 1e-4}


def beam(n: int = 12, **options: object) -> fs.Substructure:
    return fs.beam(1.0, n, **STEEL, supports={"left": "clamped"}, interface=("right",), ports={"belt": 0.5}, **options)


def reduced() -> fs.ReducedSubstructure:
    return fs.reduce(beam(), fs.CraigChang(modes=4), ports=True)


def ratios(sub: fs.Substructure, count: int) -> tuple[np.ndarray, np.ndarray]:
    """|λ| and ζ = -Re λ/|λ| of the lowest pairs."""
    lam = fs.complex_modes(sub).eigenvalues
    lam = lam[lam.imag > 0][:count]
    return np.abs(lam), -lam.real / np.abs(lam)


@pytest.mark.parametrize("make", [beam, reduced])
def test_rayleigh(make) -> None:  # type: ignore[no-untyped-def]
    sub = make()
    damped = fs.damped(sub, rayleigh=(3.0, 1e-5))
    assert type(damped) is type(sub) and sp.issparse(damped.D) == sp.issparse(sub.K)
    assert abs(damped.D - 3.0 * sub.M - 1e-5 * sub.K).max() <= 1e-14 * abs(damped.D).max()
    omega, zeta = ratios(damped, 4)
    assert np.allclose(zeta, 1.5 / omega + 0.5e-5 * omega, rtol=1e-6)
    assert abs(sub.D).max() == 0  # the model given is as it was


@pytest.mark.parametrize("order", [1, -1])
def test_rayleigh_through_two_ratios(order: int) -> None:
    sub = beam()
    omega = fs.normal_modes(sub, count=4).frequencies
    points = ((omega[0], 0.02), (omega[2], 0.03))[::order]
    _, zeta = ratios(fs.damped(sub, ratios=points), 3)
    assert np.allclose(zeta[[0, 2]], [0.02, 0.03], rtol=1e-8)
    only_mass = fs.damped(sub, ratios=((1.0, 0.04), (4.0, 0.01))).D  # on the limit: β = 0 up to rounding
    assert abs(only_mass - 0.08 * sub.M).max() < 1e-10 * abs(only_mass).max()


@pytest.mark.parametrize("make", [beam, reduced])
def test_modal_ratios(make) -> None:  # type: ignore[no-untyped-def]
    sub = make()
    _, zeta = ratios(fs.damped(sub, modal=(0.01, 0.05, 0.0, 0.02)), 5)
    assert np.allclose(zeta[:5], [0.01, 0.05, 0.0, 0.02, 0.0], atol=1e-8)
    _, zeta = ratios(fs.damped(sub, modal=0.03), sub.size)
    assert len(zeta) == sub.size and np.allclose(zeta, 0.03, rtol=1e-5)


def test_modal_damping_leaves_rigid_motion_alone() -> None:
    sub = fs.beam(1.0, 10, **STEEL)
    damped = fs.damped(sub, modal=0.02)
    rigid = fs.normal_modes(sub, count=1).shapes[:, :2]
    assert np.abs(damped.D @ rigid).max() < 1e-9 * (abs(damped.D) @ np.abs(rigid)).max()
    assert np.array_equal(damped.D.toarray(), damped.D.toarray().T)


def test_dashpots() -> None:
    sub = lattice(4, 3, held=True)
    D = fs.damped(sub, dashpots={3: 2.0, (0, 5): 0.5, "belt": 4.0}).D.toarray()
    expected = np.zeros((sub.size, sub.size))
    expected[3, 3] = 2.0
    expected[np.ix_([0, 5], [0, 5])] = [[0.5, -0.5], [-0.5, 0.5]]
    expected += 4.0 * np.outer(sub.port("belt"), sub.port("belt"))
    assert np.allclose(D, expected, rtol=1e-14, atol=0)


def test_dashpots_of_a_reduced_model_sit_at_the_component() -> None:
    sub = beam()
    for method in (fs.CraigChang(modes=4), fs.CraigBampton(modes=4)):
        rom = fs.reduce(sub, method, ports=True)
        before = fs.reduce(fs.damped(sub, dashpots={4: 2.0, (0, 6): 1.0, "belt": 3.0}), method, ports=True)
        after = fs.damped(rom, dashpots={4: 2.0, (0, 6): 1.0, "belt": 3.0})
        assert isinstance(after, fs.ReducedSubstructure) and np.allclose(after.D, before.D, rtol=1e-12)


def test_kinds_add_up_and_so_do_calls() -> None:
    sub = beam()
    at_once = fs.damped(sub, rayleigh=(1.0, 1e-6), modal=0.01, dashpots={"belt": 2.0}).D
    one_by_one = fs.damped(fs.damped(fs.damped(sub, rayleigh=(1.0, 1e-6)), modal=0.01), dashpots={"belt": 2.0}).D
    assert abs(at_once - one_by_one).max() < 1e-14 * abs(at_once).max()
    assert abs(beam(rayleigh=(1.0, 1e-6)).D - fs.damped(sub, rayleigh=(1.0, 1e-6)).D).max() == 0


@pytest.mark.parametrize(("arguments", "words"), [
    ({}, "at least one of rayleigh"), ({"rayleigh": (0.1, -1e-3)}, "beta of rayleigh must not be negative"),
    ({"rayleigh": 0.1}, "must be a pair"), ({"rayleigh": (1, 0), "ratios": ((1, 0.1), (2, 0.1))}, "Give only one of them"),
    ({"ratios": ((1.0, -0.1), (2.0, 0.1))}, "zeta of ratios must not be negative"),
    ({"ratios": ((2.0, 0.1), (2.0, 0.2))}, "two different positive frequencies"),
    ({"ratios": ((1.0, 0.02), (4.0, 0.1))}, "second ζ can be 0.005 to 0.08"), ({"ratios": (1.0, 0.1)}, "each point of ratios"),
    ({"modal": -0.01}, "modal must not be negative"), ({"modal": [0.01, -0.02]}, r"modal\[1\] must not be negative"),
    ({"modal": "all"}, "must be a ratio"), ({"modal": [0.01] * 99}, "99 elastic modes were asked for"),
    ({"dashpots": {"belt": -1.0}}, "dashpot 'belt' must not be negative"), ({"dashpots": {"bolt": 1.0}}, "did you mean 'belt'"),
    ({"dashpots": {99: 1.0}}, "there is no DOF 99"), ({"dashpots": {(1, 1): 1.0}}, "has the same DOF at both ends"),
    ({"dashpots": {(1, 2, 3): 1.0}}, "at one DOF or between two"), ({"dashpots": [1.0]}, "dashpots must map"),
    ({"dashpots": {1.5: 1.0}}, "must be a whole number"),
])
def test_damped_refuses(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        fs.damped(beam(), **arguments)


def test_modal_damping_of_a_large_sparse_model_is_refused() -> None:
    with pytest.raises(fs.InputError, match="Apply it to the reduced model"):
        fs.damped(membrane(50), modal=0.01)
    with pytest.raises(fs.InputTypeError, match="takes a Substructure"):
        fs.damped(fs.Pencil([[1.0]], None, [[1.0]]), modal=0.01)  # type: ignore[type-var]


# structural damping: K + iH

def lossy(n: int = 6, seed: int = 0, damping: float = 0.0) -> fs.Substructure:
    """A chain whose springs have loss factors of their own."""
    sub = fs.chain(n, belt=2, damping=damping)
    cells = np.random.default_rng(seed).random(n)[:, None, None] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    H = np.zeros((n + 1, n + 1))
    for at, cell in enumerate(cells):
        H[at:at + 2, at:at + 2] += 0.1 * cell
    return sub.with_structural_damping(H[1:, 1:])


def test_equivalent_viscous_damping_is_the_same_at_its_frequency() -> None:
    sub, omega = lossy(), np.array([0.3, 0.7])
    found = fs.frequency_response(fs.equivalent_viscous(sub, 0.7), at=omega, method="direct").receptance
    exact = fs.frequency_response(sub, at=omega, method="direct").receptance
    off = np.abs(found - exact).ravel() / np.abs(exact).ravel()
    assert off[1] < 1e-13 and off[0] > 1e-3
    rom = fs.reduce(sub, fs.CraigBampton(band=(0.0, 1.0), tol=1e-2), ports=True)
    viscous = fs.equivalent_viscous(rom, 0.7)
    assert viscous.H is None and np.abs(viscous.D - rom.D - rom.H / 0.7).max() < 1e-15 and viscous.estimate is None
    for wrong in (0.0, -1.0):
        with pytest.raises(fs.InputError, match="omega must be"):
            fs.equivalent_viscous(sub, wrong)
    with pytest.raises(fs.InputError, match="no structural damping"):
        fs.equivalent_viscous(beam(), 1.0)


def test_complex_modes_of_a_loss_factor_have_their_closed_form() -> None:
    """λ = ±iω√(1 ± iη), a pair for each undamped mode."""
    eta, omega = 0.3, fs.chain_frequencies(8)
    found = fs.complex_modes(fs.damped(fs.chain(8, damping=0.0), structural=eta))
    upper = np.sort_complex(-1j * found.eigenvalues[found.eigenvalues.imag > 0])
    assert np.abs(upper - np.sort_complex(omega * np.sqrt(1 + 1j * eta))).max() < 1e-13
    assert len(found) == 16 and found.evidence == "certified" and found.is_stable is True
    assert found.backward_error.max() < 1e-13 and found.error_bar.max() < 1e-11
    light = fs.damped(fs.chain(8, damping=0.0), structural=0.01)
    found = fs.complex_modes(light)
    assert turnover(light, None, found) == pytest.approx(np.abs(found.eigenvalues.real), rel=2e-5)
    few = fs.complex_modes(fs.damped(fs.chain(8, damping=0.0), structural=eta), count=3)
    assert len(few) == 4 and np.array_equal(few.eigenvalues[::2].conj(), few.eigenvalues[1::2])


@pytest.mark.parametrize("seed", range(10))
def test_complex_modes_with_structural_damping_under_friction(seed: int) -> None:
    """Against the companion matrix with K + iH, and the residual of each pair with the sign of its Im λ."""
    rng = np.random.default_rng(seed)
    sub = lossy(6, seed, damping=0.1 * rng.random())
    contacts = [fs.LinearContact(("belt",), stiffness=[[rng.standard_normal()]], damping=[[0.1 * rng.standard_normal()]])]
    W = np.linalg.qr(rng.standard_normal((6, 2)))[0]
    sub = fs.Substructure(sub.M, sub.K, sub.D, ports={**sub.ports, "n": W[:, 0], "t": W[:, 1]}, H=sub.H)
    contacts.append(fs.LinearContact(("n", "t"), stiffness=[[0.0, 0.4], [-0.2, 0.0]]))
    found = fs.complex_modes(sub, contacts)
    pencil = sub.linearised(contacts, structural=True).dense()
    H = sub.H.toarray() if sp.issparse(sub.H) else sub.H
    every, plain = (np.linalg.eigvals(np.block([[np.zeros((6, 6)), np.eye(6)], [-stiffness, -pencil.D]]))  # M = I
                    for stiffness in (pencil.K + 1j * H, pencil.K))
    assert len(found) == 2 * np.count_nonzero(every.imag > 0) + np.count_nonzero(plain.imag == 0)
    for value, x, bar in zip(found.eigenvalues, found.shapes.T, found.error_bar, strict=True):
        sign = np.sign(value.imag)
        assert np.linalg.norm((pencil.at(value) + 1j * sign * H) @ x) < 1e-12
        if sign:
            assert np.abs(every - (value if sign > 0 else value.conj())).min() < bar + 1e-12


def test_motion_that_does_not_oscillate_is_listed_without_structural_damping() -> None:
    sub = fs.Substructure(np.eye(3), [[1, -1, 0], [-1, 2, -1], [0, -1, 1]], ports={"end": [1, 0, 0]})
    still = fs.complex_modes(fs.damped(sub, structural=0.1))
    assert still.rigid.sum() == 2 and len(still) == 6
    pushed = fs.LinearContact(("end",), stiffness=[[-2.0]])
    found, plain = (fs.complex_modes(model, pushed) for model in (fs.damped(sub, structural=0.1), sub))
    diverging = [modes.eigenvalues[(modes.eigenvalues.imag == 0) & (modes.eigenvalues.real > 0)] for modes in (found, plain)]
    assert found.is_stable is False and diverging[0] == pytest.approx(diverging[1], rel=1e-12)
    assert len(found) == 8  # the decaying partner of the λ that grows is lifted
    braked = fs.complex_modes(fs.damped(sub, structural=0.1, dashpots={0: 0.1}))
    assert len(braked) == 8 and (braked.eigenvalues.imag == 0).sum() == 2 and braked.growth < 0


def test_a_mode_that_structural_damping_lifts_off_the_axis_is_listed() -> None:
    """d > 2 sqrt(km): the real λ are those without H, and the faster one moves up with it. In P₊ the slower one moves down."""
    sub, d = fs.Substructure([[1.0]], [[1.0]], [[2.5]], H=[[0.3]], ports={"p": [1.0]}), 2.5
    found = fs.complex_modes(sub)
    lifted = (-d - np.sqrt(d * d - 4 - 1.2j)) / 2
    assert found.evidence == "certified" and lifted.imag > 0
    exact = np.sort_complex([-2.0, -0.5, lifted, lifted.conjugate()])
    assert np.sort_complex(found.eigenvalues) == pytest.approx(exact, rel=1e-13)
    turning = fs.Substructure(np.eye(2), np.diag([1.0, 4.0]), [[0.0, 1.0], [-1.0, 0.0]], H=np.diag([0.0, 0.5]),
                              ports={"a": [1, 0], "b": [0, 1]})
    pushed = fs.LinearContact(("a", "b"), stiffness=[[-3.0, 2.0], [0.5, 0.0]])  # det K < 0: a λ grows on the axis without H
    pencil = turning.linearised(pushed, structural=True)
    every = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-(pencil.K + 1j * turning.H), -pencil.D]]))
    found = fs.complex_modes(turning, pushed)
    upper = found.eigenvalues[found.eigenvalues.imag > 0]
    assert len(upper) == np.count_nonzero(every.imag > 0) and (np.abs(upper[:, None] - every).min(axis=1) < 1e-13).all()
    real = found.eigenvalues[found.eigenvalues.imag == 0]
    plain = fs.complex_modes(fs.Pencil(pencil.M, pencil.D, pencil.K)).eigenvalues
    assert real == pytest.approx(np.sort(plain[plain.imag == 0].real)[np.argsort(np.argsort(real.real))]) and len(real) == 2
    assert found.is_stable is False and found.evidence == "certified"


def test_structural_damping_against_a_fixed_point_acts_on_rigid_motion() -> None:
    """m λ² + ih = 0 above the axis; on it, the rigid motion without H."""
    found = fs.complex_modes(fs.Substructure(np.eye(2), [[1, -1], [-1, 1]], H=np.eye(2)))
    upper = np.sort_complex(found.eigenvalues[found.eigenvalues.imag > 0])
    assert upper == pytest.approx(np.sort_complex([-np.sqrt(-1j), -np.sqrt(-2 - 1j)]), rel=1e-13)
    assert found.rigid.sum() == 2


def test_the_border_with_structural_damping_is_that_of_viscous_damping_at_its_frequency() -> None:
    sub, omega = lossy(damping=0.05), 0.5
    for _ in range(12):
        border = fs.critical_slope(fs.equivalent_viscous(sub, omega), port="belt", band=(0.0, 0.6))
        omega = border.omega
    nearest = fs.complex_modes(sub, fs.Belt(slope=border.value)).eigenvalues
    at = np.abs(nearest - 1j * omega).argmin()
    assert abs(nearest[at] - 1j * omega) < 1e-9


def test_structural_damping_is_never_dropped_silently() -> None:
    sub, belt = lossy(), fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    start = fs.State(np.zeros(6), np.zeros(6))
    analyses = {
        "linearised": lambda: sub.linearised(), "critical_slope": lambda: fs.critical_slope(sub, port="belt"),
        "critical_value": lambda: fs.critical_value(sub, belt, "speed", between=(0.1, 0.3)),
        "sweep": lambda: fs.sweep(sub, belt, "speed", [0.1, 0.2]), "track": lambda: fs.track(sub, belt, "speed", [0.1, 0.2]),
        "transient": lambda: fs.transient(sub, belt, time=(0, 1)), "shoot": lambda: fs.shoot(sub, belt, start, period=1.0),
        "branch": lambda: fs.branch(sub, belt),
        "refine": lambda: fs.refine(sub, fs.complex_modes(small, belt, count=2), small, belt)}
    small = fs.reduce(sub, fs.CraigBampton(3), ports=True)
    for name, analysis in analyses.items():
        with pytest.raises(fs.InputError, match=r"structural damping H.*equivalent_viscous"):
            raise AssertionError(f"{name} took it: {analysis()!r}")
    with pytest.raises(fs.InputError, match="Reduce it first"):
        fs.complex_modes(fs.damped(fs.chain(2001), structural=0.1), count=4)
    massless = fs.damped(fs.Substructure(np.diag([1.0, 0.0]), [[2, -1], [-1, 2]]), structural=0.1)
    with pytest.raises(fs.InputError, match="regular M"):
        fs.complex_modes(massless)
    found = fs.study(sub, [fs.CraigBampton(3)], band=(0.0, 0.8), contacts=belt, repeats=1, ports=True)
    assert all("structural damping" in row.reason and np.isfinite(row.error_growth) for row in found.rows)


def test_harmonic_balance_has_structural_damping_in_every_harmonic() -> None:
    """v_k = ikω Wᵀ(-k²ω²M + ikωD + K + iH)⁻¹W f_k, by a solution of the equations of the harmonics one by one."""
    rom = fs.reduce(fs.damped(fs.chain(10, belt=2), structural=0.01), fs.CraigChang(modes=3), ports=True)
    belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    start = fs.harmonic_balance(fs.equivalent_viscous(rom, 0.73), belt, harmonics=20)
    cycle = fs.harmonic_balance(rom, belt, harmonics=20, start=start)
    times = cycle.period * np.arange(4096) / 4096
    v = cycle.velocity(times)
    f = np.fft.rfft(cycle.contact.exerted(v[None], v[None])[0])[:21] / 4096
    w = rom.ports["belt"]
    for k in range(1, 21):
        s = 1j * k * cycle.omega
        h = w @ np.linalg.solve(s**2 * rom.M + s * rom.D + rom.K + 1j * rom.H, w)
        assert abs(cycle.harmonics[k - 1, 0] - s * h * f[k]) < 1e-9 * cycle.rms
    assert 1e-4 < abs(cycle.rms / start.rms - 1) < 0.05 and cycle.is_stable is None
    at = cycle.state(0.3)
    assert w @ at.velocity == pytest.approx(float(cycle.velocity(0.3)), rel=1e-6)
    with pytest.raises(fs.InputError, match="no start is found by itself"):
        fs.harmonic_balance(rom, belt)


def test_damping_of_a_joined_system_is_not_lost_where_its_parts_are_reduced() -> None:
    parts = {name: fs.chain(6, interface=[end], fixed=end == 6) for name, end in (("left", 6), ("right", 1))}
    system = fs.couple(parts, [fs.Rigid(("left", [5]), ("right", [0]))])
    lossy_system = fs.damped(system, structural=0.1)
    for changed in (lossy_system, fs.damped(system, rayleigh=(0.1, 0.1)), fs.equivalent_viscous(lossy_system, 1.0)):
        with pytest.raises(fs.InputError, match="the parts do not have it"):
            fs.reduce(changed, {"left": fs.CraigBampton(3)})
        with pytest.raises(fs.InputError, match="the parts do not have it"):
            changed.with_parts({})
    before = fs.couple({name: fs.damped(part, structural=0.1) for name, part in parts.items()}, system.joints)
    small = fs.reduce(before, {"left": fs.CraigBampton(3)}, ports=True)
    assert abs(before.H - lossy_system.H).max() < 1e-15 and abs(small.H - 0.1 * small.K).max() < 1e-14
    assert abs(fs.equivalent_viscous(small, 2.0).D - small.D - small.H / 2).max() < 1e-15
