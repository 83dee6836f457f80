"""The nonlinear contact: its forces, the sliding equilibrium, and disturbances that are the same for every model."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.motion.nonlinear_model import project, sliding

LAW = fs.StribeckArctan(eps=1e-3)
BELT = fs.Belt(speed=0.19113, law=LAW)


def two_ports() -> fs.Substructure:
    chain = fs.chain(6, belt=2)
    W = np.zeros((6, 2))
    W[3, 0] = W[4, 1] = 1.0
    return fs.Substructure(chain.M, chain.K, chain.D, [0], {"belt": chain.port("belt"), "pair": W})


def test_force_and_its_tangent_go_by_column() -> None:
    model = two_ports()
    contact = sliding(model, [BELT, fs.Belt("pair", force=3.0, speed=-0.05, law=fs.StribeckArctanOdd())])
    v = np.random.default_rng(0).uniform(-0.3, 0.3, (3, 7))
    found = contact.exerted(v, v)
    assert contact.columns == 3 and found.shape == (3, 7)
    np.testing.assert_allclose(found[0], LAW.value(0.19113 - v[0]), rtol=1e-15)
    np.testing.assert_allclose(found[2], 3.0 * fs.StribeckArctanOdd().value(-0.05 - v[2]), rtol=1e-15)
    h = 1e-7
    slope = (contact.exerted(v, v + h) - contact.exerted(v, v - h)) / (2 * h)
    of_u, of_v = contact.tangents(v, v)
    assert contact.by_speed and not of_u.any()
    np.testing.assert_allclose(of_v, np.eye(3)[:, :, None] * slope, rtol=1e-5, atol=1e-5)


def test_sliding_equilibrium_balances_and_its_tangent_is_the_linear_model() -> None:
    for model in (fs.chain(10, belt=2), fs.reduce(fs.chain(10, belt=2, interface=[1, 2]), fs.CraigChang(3))):
        contact = sliding(model, BELT)
        q = contact.equilibrium
        np.testing.assert_allclose(model.K @ q, contact.W[:, 0] * LAW.value(0.19113), atol=1e-13)
        linear = model.linearised(BELT).D - model.D
        assert abs(linear - (-contact.tangents(np.zeros(1), np.zeros(1))[1][0, 0]) * np.outer(contact.W, contact.W)).max() < 1e-15


def test_a_blow_is_the_same_disturbance_for_full_and_reduced() -> None:
    full = fs.chain(10, belt=2, masses=np.linspace(1.0, 2.0, 10))
    with pytest.warns(fs.PortWarning):
        rom = fs.reduce(full, fs.CraigBampton(4))
    blow = sliding(full, BELT).impulse(1e-3)
    np.testing.assert_allclose(blow.velocity[1], 1e-3 / full.M.diagonal()[1], rtol=1e-14)
    np.testing.assert_allclose(sliding(rom, BELT).impulse(1e-3).velocity, project(rom, full.M, blow.velocity), atol=1e-17)
    assert project(rom, full.M, rom.expand(np.eye(5))) == pytest.approx(np.eye(5), abs=1e-13)


def test_what_has_no_answer_is_refused() -> None:
    chain = fs.chain(4, belt=2)
    with pytest.raises(fs.InputError, match="has a slope only"):
        sliding(chain, fs.Belt(slope=-0.2))
    with pytest.raises(fs.InputError, match="two belts act on one port"):
        sliding(chain, [BELT, BELT])
    with pytest.raises(fs.InputError, match="at least one contact, such as a Belt"):
        sliding(chain, [])
    floating = fs.Substructure(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]], ports={"belt": [1.0, 0.0]})
    with pytest.raises(fs.InputError, match=r"floats .1 rigid-body modes.*Hold it"):
        _ = sliding(floating, BELT).equilibrium
    with pytest.raises(fs.InputError, match="velocity must have 4 entries"):
        sliding(chain, BELT).perturbed(velocity=[1.0, 2.0])
    with pytest.raises(fs.InputError, match="velocity holds a NaN"):
        sliding(chain, BELT).perturbed(velocity=[np.nan] * 4)
    massless = fs.Substructure(np.diag([1.0, 0.0]), [[2.0, -1.0], [-1.0, 1.0]], ports={"belt": [1.0, 0.0]})
    with pytest.raises(fs.InputError, match="M is singular"):
        sliding(massless, BELT).impulse()


def test_a_model_is_no_contact() -> None:
    chain = fs.chain(4, belt=2)
    for given in (chain, [BELT, chain], fs.reduce(chain, fs.CraigChang(2), ports=True)):
        with pytest.raises(fs.InputTypeError, match=r"a contact must be a Belt.*Join models with couple"):
            fs.complex_modes(chain, given)


ANALYSES = [fs.complex_modes, fs.self_excitation, fs.transient, fs.harmonic_balance, fs.shoot, fs.branch, fs.reduce,
            fs.critical_value, fs.track, fs.refine]


@pytest.mark.parametrize("analysis", ANALYSES, ids=lambda analysis: analysis.__name__)
def test_contacts_are_called_contacts_everywhere(analysis: Any) -> None:
    names = list(inspect.signature(analysis).parameters)
    assert "contacts" in names and not {"belt", "belts"} & set(names)


def test_hundreds_of_contacts_are_as_many_steps_and_no_calls_within_calls() -> None:
    """Ten belts at each mass of a chain: D is that of all, and the rigid motion of a floating one is still known."""
    size, count = 60, 600  # twice as many contacts are deeper than calls go in Python
    ports = {f"c{at}": np.eye(1, size, at % size).ravel() for at in range(count)}
    bare = fs.chain(size, fixed=False, damping=0.0)
    sub = fs.Substructure(bare.M, bare.K, ports=ports)
    pencil = sub.linearised([fs.Belt(port=name, slope=-2.0**-10) for name in ports])
    assert (pencil.D.diagonal() == -10 * 2.0**-10).all() and fs.complex_modes(pencil, count=4).rigid.sum() >= 1
