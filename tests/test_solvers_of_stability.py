"""`critical_value`: every solver gives the same losses, on models of any size; what cannot be answered is refused."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks import solvers
from femsub.stability import edges, followed
from femsub.stability.critical_value import first_value


@pytest.mark.parametrize("kind", solvers.KINDS)
def test_all_solvers_agree_on_random_models(kind: str) -> None:
    """Two seeds of benchmarks/attacks/solvers.py; `scripts/attack.py solvers` runs thousands."""
    found = [solvers.attacked(kind, seed) for seed in (0, 4)]
    assert set(found) <= {"agree", "none"} and "agree" in found


@pytest.mark.parametrize(("begin", "end"), [(0.0, -0.03), (-0.03, 0.0)])
def test_a_range_that_falls_is_met_on_the_way_down(begin: float, end: float) -> None:
    """Losses of one direction are regains of the other."""
    chain, belt = fs.chain(10, belt=2), fs.Belt(slope=0.0)
    up, down = (fs.critical_value(chain, belt, "slope", between=pair) for pair in ((-0.03, 0.0), (0.0, -0.03)))
    assert [one.value for one in down.losses] == pytest.approx([one.value for one in reversed(up.regains)], abs=1e-11)
    assert down.value == pytest.approx(-0.0255665084, abs=1e-9) and down.searched == (0.0, -0.03) and not down.growing
    assert (up.value, up.growing) == (-0.03, 4) and up.fastest.real > 0 and np.isnan(down.fastest.real)
    found = fs.critical_value(chain, belt, "slope", between=(begin, end), band=(0.0, 2.1), solver="followed")
    same = down if begin == 0.0 else up
    for name in ("losses", "regains"):
        assert [one.value for one in getattr(found, name)] == pytest.approx([one.value for one in getattr(same, name)], abs=1e-10)
    assert found.evidence == "confirmed" and found.method == "followed" and not found.open


def test_the_first_loss_alone_is_that_of_all_with_fewer_solutions(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, belt = fs.chain(10, belt=2), fs.Belt(slope=0.0)
    made, limits = counted(monkeypatch), ("slope", (0.0, -0.1), (0.0, 2.1))
    every = fs.critical_value(chain, belt, "slope", between=limits[1], band=limits[2], solver="followed")
    assert made["complex_modes"] == 5 and made["ComplexFactor"] <= 4 * len(every.losses + every.regains)
    for near, solved, end in ((np.nan, 3, -0.0486), (-0.0255, 2, -0.0305), (-0.01, 4, -0.0486), (-np.inf, 3, -0.0486)):
        made["complex_modes"] = 0
        found = first_value(chain, belt, *limits, near)
        assert found.value == pytest.approx(every.value, abs=1e-11) and found.evidence == every.evidence == "confirmed"
        assert made["complex_modes"] == found.solved == solved and found.searched[1] == pytest.approx(end)
        assert not found.open and found.omega == pytest.approx(every.omega, rel=1e-9)
    grown = first_value(chain, belt, "slope", (-0.03, 0.0), limits[2])
    assert (grown.value, grown.growing, grown.solved) == (-0.03, 4, 2)


def test_never_lost_and_unstable_from_the_begin_look_the_same_by_all_solvers() -> None:
    chain, belt = fs.chain(10, belt=2), fs.Belt(slope=0.0)
    unstable = fs.Substructure(chain.M, chain.K, -0.01 * chain.K, ports=chain.ports)
    for solver in ("discs", "followed", "root"):
        never = fs.critical_value(chain, belt, "slope", between=(0.0, -0.01), band=(0.0, 2.1), solver=solver)
        assert never.value == -np.inf and not never.losses and "never lost" in repr(never)
        begin = fs.critical_value(unstable, belt, "slope", between=(0.0, -0.01), band=(0.0, 2.1), solver=solver)
        assert begin.value == 0.0 and begin.growing == 20 and begin.fastest.real > 0 and "grow from the begin" in repr(begin)


def brake_like(n: int) -> tuple[fs.Affine, tuple[float, float]]:
    """A plate of springs (n² masses) of two nearly equal frequencies and a circulatory coupling on a patch: D, K sparse."""
    step = sp.diags_array([-np.ones(n - 1), 2.05 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    eye = sp.eye_array(n)
    K = sp.kron(step, eye) + 1.003 * sp.kron(eye, step)
    w, v = np.zeros((2, n * n))
    w[n // 3 * n + n // 3:][:4] = 1.0
    v[n // 4 * n + n // 2:][:4] = 1.0
    turning = sp.csr_array(np.outer(w, v) - 0.9 * np.outer(v, w)) if n < 40 else \
        sp.csr_array(sp.csr_array(w[:, None]) @ sp.csr_array(v[None]) - 0.9 * sp.csr_array(v[:, None]) @ sp.csr_array(w[None]))
    D = 2e-4 * K + sp.diags_array(1e-5 * np.random.default_rng(3).random(n * n))
    return fs.Affine(sp.eye_array(n * n), D, [(1.0, K), ("mu", turning)]), (0.0, 0.7)


def counted(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How many bands are searched and how many complex factors made."""
    homes = {"complex_modes": followed, "ComplexFactor": edges}
    made = dict.fromkeys(homes, 0)
    for name, home in homes.items():
        def call(*arguments: object, name: str = name, real: object = getattr(home, name), **options: object) -> object:
            made[name] += 1
            return real(*arguments, **options)  # type: ignore[operator]

        monkeypatch.setattr(home, name, call)
    return made


@pytest.mark.slow
def test_a_sparse_unsymmetric_pencil_is_followed_with_few_solutions(monkeypatch: pytest.MonkeyPatch) -> None:
    """324 DOF, above the limit of the discs: the losses are those of its dense eigenvalues beside them."""
    family, band = brake_like(18)
    made = counted(monkeypatch)
    found = fs.critical_value(family, None, "mu", between=(0.0, 0.01), band=band)
    assert found.method == "followed" and len(found.losses) >= 2 and found.evidence == "confirmed"
    assert made["complex_modes"] == 5 and made["ComplexFactor"] <= 8 * (len(found.losses) + len(found.regains))

    def growing(p: float) -> int:
        z = fs.complex_modes(family.at(mu=p).dense()).eigenvalues
        return int(((z.real > 1e-9) & (z.imag > band[0]) & (z.imag <= band[1])).sum())

    for several, change in ((found.losses, 1), (found.regains, -1)):
        for one in several:
            assert growing(one.value + 1e-6) - growing(one.value - 1e-6) == change
            pencil = family.at(mu=one.value)
            assert pencil.backward_error(np.array([1j * one.omega]), one.shape[:, None])[0] < 1e-8


@pytest.mark.slow
def test_a_pencil_of_2000_dof_is_followed_within_30_solutions(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many modes in the band as a model of 4,096 DOF has up to 0.38, and as many solutions."""
    family, _ = brake_like(48)
    made = counted(monkeypatch)
    found = fs.critical_value(family, None, "mu", between=(0.0, 0.005), band=(0.0, 0.42))
    assert found.losses and found.method == "followed" and made["complex_modes"] + made["ComplexFactor"] <= 30
    for one in found.losses:
        growth = [fs.complex_modes(family.at(mu=one.value + step), band=(0.999 * one.omega, 1.001 * one.omega)).growth
                  for step in (-1e-4, 1e-4)]
        assert growth[0] < 0 < growth[1]


@pytest.mark.slow
def test_a_mode_that_the_small_model_gets_wrong_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without refinement the candidates do not solve the full pencil: none is listed, and their places are open."""
    family, band = brake_like(18)
    monkeypatch.setattr(followed, "_newton", lambda over, between, start, x: followed._Met(start, x[:, None], 0.0, np.nan))
    monkeypatch.setattr(followed, "GOOD", 0.0)
    found = fs.critical_value(family, None, "mu", between=(0.0, 0.01), band=band)
    assert found.open and found.evidence == "not checked"


@pytest.mark.parametrize(("options", "words"), [
    ({"between": (0.0, -np.inf), "solver": "discs"}, "finite range"),
    ({"between": (0.0, -np.inf), "solver": "followed"}, "finite range"),
    ({"between": (0.0, np.inf), "solver": "root"}, "only takes damping from one port"),
    ({"between": (0.0, np.inf)}, "only takes damping from one port"),
    ({"between": (0.0, -0.1), "solver": "followed"}, "needs a band"), ({"between": (np.inf, 0.0)}, "between must be"),
    ({"between": (0.0, -0.1), "solver": "guess"}, "unknown solver 'guess'"), ({"between": (0.0, np.nan)}, "finite"),
    ({"between": (0.1, 0.1)}, "must be a range"), ({"between": 3.0}, "must be a pair")])
def test_what_a_solver_cannot_answer_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        fs.critical_value(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", **options)  # type: ignore[arg-type]


def test_the_port_s_root_takes_the_force_of_a_belt_as_well() -> None:
    chain, slope = fs.chain(400, belt=2), fs.critical_slope(fs.chain(400, belt=2), band=(0.0, 0.1)).value
    belt, band = fs.Belt(force=0.0, slope=-0.5), (0.0, 0.1)
    found = fs.critical_value(chain, belt, "force", between=(0.0, np.inf), band=band, solver="root")
    assert found.value == pytest.approx(slope / -0.5, rel=1e-9)


def test_sweep_takes_any_parameter() -> None:
    sub = fs.Substructure(np.eye(2), [[2, 1], [1, 2]], 0.01 * np.eye(2), ports={"n": [1, 0], "t": [0, 1]})
    family = fs.Affine(sub.M, sub.D, [(1.0, sub.K), ("mu", [[0, -4 / 3], [0, 0]])])
    found = fs.sweep(family, None, "mu", [0.5, 0.9])
    assert found.growth[0] < 0 < found.growth[1] and found.parameter == "mu"
    border = fs.critical_value(family, None, "mu", between=(0.0, 1.0)).value
    beside = fs.sweep(family, None, "mu", [border - 1e-6, border + 1e-6]).growth
    assert beside[0] < 0 < beside[1]
    forces = fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=-0.1), "force", [0.1, 0.5, 1.0])  # a negative one would be refused
    slopes = fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", [-0.01, -0.05, -0.1])
    assert forces.growth == pytest.approx(slopes.growth)
    law = fs.StribeckArctan(eps=1e-2)
    speeds = fs.sweep(fs.chain(10, belt=2), fs.Belt(speed=1.0, law=law), "speed", [0.2, 5.0])
    assert speeds.growth[0] > 0 > speeds.growth[1]
