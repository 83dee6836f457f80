"""Everything public travels: through pickle (to another process), `deepcopy`, and `replace` where it is a dataclass."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import norm

import femsub as fs
from femsub.motion.cycles.compliance import Solved

BELT = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=0.02))
#: how one of each public class is made; the objects are small, and made once
MAKE: dict[str, Callable[[], Any]] = {
    "Scene": lambda: fs.Scene({"scene": "chain"}),
    "Affine": lambda: fs.Affine(np.eye(2), [("speed", [[0, 1], [-1, 0]])], [(1.0, np.eye(2)), ("mu", [[0, 1], [0, 0]])]),
    "AddedDamper": lambda: fs.AddedDamper("belt", 0.2, to=[3]),
    "AddedMass": lambda: fs.AddedMass([1, 2], 0.5),
    "AddedSpring": lambda: fs.AddedSpring([1], -0.5),
    "Averaged": lambda: fs.Averaged(("hub", [0, 1]), ("disc", "bore"), weights=(1.0, 2.0)),
    "Audit": lambda: fs.audit(made("ReducedSubstructure"), full()),
    "Belt": lambda: BELT,
    "Branch": lambda: fs.branch(full(), BELT, start=cycle(), points=4),
    "ComplexModes": lambda: fs.complex_modes(full(), BELT),
    "ContactModes": lambda: fs.ContactModes(modes=3, contacts=made("FrictionContact")),
    "CraigBampton": lambda: fs.CraigBampton(band=(0.0, 0.5), tol=1e-2),
    "CraigChang": lambda: fs.CraigChang(modes=3),
    "CriticalValue": lambda: fs.critical_value(full(), fs.Belt(slope=0.0), "slope", between=(-0.1, 0.0)),
    "Cut": lambda: fs.cut(full(), into=2),
    "DofMap": lambda: fs.DofMap([3, 3, 5], [0, 1, 0], points=np.eye(3)),
    "DualCraigBampton": lambda: fs.DualCraigBampton(modes=3),
    "Estimate": lambda: made("ReducedSubstructure").estimate,
    "Facing": lambda: fs.facing(("a", "top"), "b", stacked()),
    "FrequencyBounds": lambda: fs.frequency_bounds(made("ReducedSubstructure"), count=1),
    "FrictionContact": lambda: fs.FrictionContact("pad.face", "disc.track", {"pad": made("Mesh"), "disc": made("Mesh")}, 1e9, 0.4,
                                                  direction=(1.0, 0.0, 0.0), speed=2.0),
    "FrequencyResponse": lambda: fs.frequency_response(full(), BELT, at=[0.1, 0.5]),
    "Guyan": lambda: fs.Guyan(),
    "Herting": lambda: fs.Herting(modes=3),
    "Hurty": lambda: fs.Hurty(modes=3),
    "InterfaceModes": lambda: fs.InterfaceModes(modes=3),
    "JointChange": lambda: fs.JointChange(made("Spring"), -0.1),
    "Kinematic": lambda: fs.Kinematic(("hub", [0, 1]), ("disc", "bore")),
    "Levels": lambda: levels(),
    "LimitCycle": lambda: cycle(),
    "LinearContact": lambda: fs.LinearContact(("belt",), stiffness=[[0.5]]),
    "MacNeal": lambda: fs.MacNeal(modes=3),
    "Material": lambda: fs.Material(2.1e11, 0.3, 7850.0),
    "MaterialChange": lambda: fs.MaterialChange.plate(made("Mesh"), "E", -1e9, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01),
    "Mesh": lambda: fs.rectangle((1.0, 1.0), (2, 2)),
    "ModeSet": lambda: fs.ModeSet([1j, -0.1 + 2j], np.eye(3)[:, :2], made("DofMap"), ["a note"]),
    "EffectiveMasses": lambda: fs.effective_masses(full(), fs.normal_modes(full(), count=3), directions={"x": np.ones(6)}),
    "ModeCard": lambda: fs.mode_cards(full(), BELT, fs.complex_modes(full(), BELT))[0],
    "ModeName": lambda: fs.mode_names(full(), fs.normal_modes(full(), count=1))[0],
    "NormalModes": lambda: fs.normal_modes(full(), count=3),
    "Pencil": lambda: full().linearised(BELT),
    "ParameterBox": lambda: fs.ParameterBox({"slope": (-0.1, 0.0)}, (0.0, 0.5), tol=1e-3),
    "BoxModel": lambda: fs.reduce(full(), made("ParameterBox"), contacts=fs.Belt(slope=0.0)),
    "Cell": lambda: made("BoxModel").cells[0],
    "StabilityMap": lambda: fs.stability_map(fs.Affine(np.eye(2), None, [(1.0, np.diag([1.0, 2.0])), ("a", np.eye(2, k=1)),
                                                                         ("b", -np.eye(2, k=-1))]),
                                             {"a": (0.0, 1.0), "b": (0.0, 1.0)}, points=(3, 3)),
    "ReducedSubstructure": lambda: quietly(lambda: fs.reduce(full(), fs.CraigBampton(band=(0.0, 0.5), tol=1e-2))),
    "Refined": lambda: fs.refine(full(), fs.complex_modes(made("ReducedSubstructure"), BELT), made("ReducedSubstructure"), BELT),
    "Rigid": lambda: fs.Rigid(("a", [5]), ("b", [0]), tol=1e-3),
    "Rotor": lambda: rotor(),
    "Rubin": lambda: fs.Rubin(modes=3),
    "SelfExcitation": lambda: fs.self_excitation(full(), made("ReducedSubstructure"), BELT),
    "Sensitivities": lambda: fs.sensitivities(full(), BELT, made("ComplexModes"), ["force", fs.AddedMass([2])]),
    "ShotCycle": lambda: fs.shoot(full(), BELT, cycle(), tol=1e-8),
    "Spring": lambda: fs.Spring(("a", "belt"), stiffness=[[2.0]], damping=0.1),
    "StabilitySweep": lambda: fs.sweep(full(), fs.Belt(slope=0.0), "slope", [-0.1, -0.01]),
    "State": lambda: made("Transient").final,
    "StribeckArctan": lambda: fs.StribeckArctan(eps=0.1),
    "StribeckArctanOdd": lambda: fs.StribeckArctanOdd(eps=0.1),
    "Study": lambda: quietly(lambda: fs.study(full(), [fs.CraigBampton(3)], (0.0, 0.5), repeats=1)),
    "Substructure": lambda: full(),
    "System": lambda: fs.couple({"a": fs.chain(6, interface=[1, 6]), "b": made("ReducedSubstructure")},
                                [made("Rigid")], interface=[("a", [0])]),
    "Tied": lambda: fs.Tied(("a", "right"), ("b", "left"), {"a": made("Mesh"), "b": made("Mesh")}),
    "Tracked": lambda: fs.track(full(), fs.Belt(slope=0.0), "slope", [-0.1, 0.0]),
    "Transient": lambda: fs.transient(full(), BELT, (0.0, 20.0)),
    "Scatter": lambda: fs.scatter(fs.Affine(np.eye(2), 0.01 * np.eye(2), [(1.0, np.diag([1.0, 2.0])), ("a", np.eye(2, k=1))]),
                                  {"a": norm(0.3, 0.1)}, samples=64),
    "WhatHelps": lambda: fs.what_helps(full(), BELT, [fs.AddedDamper([2], 0.1)]),
}
CLASSES = [name for name in fs.__all__ if inspect.isclass(getattr(fs, name)) and not issubclass(getattr(fs, name), BaseException)]
DATA = [name for name in CLASSES if dataclasses.is_dataclass(getattr(fs, name))]


def quietly(make: Callable[[], Any]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        return make()


def stacked() -> dict[str, fs.Mesh]:
    low = fs.block((1.0, 1.0, 1.0), (1, 1, 1))
    return {"a": low, "b": dataclasses.replace(low, points=low.points + np.array([0.0, 0.0, 1.0]))}


def levels() -> fs.Levels:
    with tempfile.TemporaryDirectory() as folder:
        parts = fs.cut_to_files(folder, fs.block((6.0, 1.0, 1.0), (6, 1, 1), "hexahedron"), fs.solid, into=2,
                                material=fs.Material(1.0, 0.3, 1.0), supports=["left"])
        return fs.reduce_by_levels(parts, fs.CraigBampton(2), Path(folder) / "reduced", workers=1)


def rotor() -> fs.Rotor:
    mesh, steel = fs.annulus(0.1, 0.2, 0.02, (1, 8, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0)
    return fs.rotating(fs.solid(mesh, steel, supports=["inner"]), mesh, steel)


@cache
def full() -> fs.Substructure:
    return fs.chain(6, belt=2, damping=0.1)


@cache
def cycle() -> fs.LimitCycle:
    return fs.harmonic_balance(full(), BELT, harmonics=20)


@cache
def made(name: str) -> Any:
    return MAKE[name]()


def same(one: Any, two: Any, path: str = "") -> None:
    """Fields, entries and what is read-only agree; properties too, since they are what a user asks."""
    assert type(one) is type(two), path
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, two, err_msg=path)
        assert one.flags.writeable == two.flags.writeable, path
    elif sp.issparse(one):
        assert one.shape == two.shape and not (one != two).nnz, path
        same(one.data, two.data, f"{path}.data")
    elif isinstance(one, Mapping):
        assert list(one) == list(two), path
        for key in one:
            same(one[key], two[key], f"{path}[{key!r}]")
    elif isinstance(one, (tuple, list)):
        assert len(one) == len(two), path
        for i, pair in enumerate(zip(one, two, strict=True)):
            same(*pair, f"{path}[{i}]")
    elif dataclasses.is_dataclass(one):
        for item in dataclasses.fields(one):
            same(getattr(one, item.name), getattr(two, item.name), f"{path}.{item.name}")
        assert repr(one) == repr(two), path
        for name, _ in inspect.getmembers(type(one), lambda member: isinstance(member, property)):
            same(getattr(one, name), getattr(two, name), f"{path}.{name}")
    elif type(one).__module__.split(".")[0] == "femsub" and hasattr(one, "__dict__") and not callable(one):
        assert vars(one).keys() - {"static"} == vars(two).keys() - {"static"}, path
    elif not callable(one):
        assert one == two or one != one, path


@pytest.mark.parametrize("name", fs.__all__)
def test_everything_public_passes_pickle_and_deepcopy(name: str) -> None:
    public = getattr(fs, name)
    if inspect.isclass(public) and issubclass(public, BaseException):
        error = public("a figure of 3")
        assert str(pickle.loads(pickle.dumps(error))) == str(copy.deepcopy(error)) == "a figure of 3"
    elif inspect.isclass(public):
        assert name in MAKE, f"say in MAKE how an object of {name} is made"
        thing = made(name)
        assert type(thing) is public
        same(thing, pickle.loads(pickle.dumps(thing)))
        same(thing, copy.deepcopy(thing))
    assert pickle.loads(pickle.dumps(public)) is public or name == "__version__"


@pytest.mark.parametrize("name", DATA)
def test_a_dataclass_is_replaced_by_what_was_given(name: str) -> None:
    thing = made(name)
    again = dataclasses.replace(thing)
    if name == "Pencil":  # with its D as it stands: what it was made of is not known any more
        assert thing.contacts and not again.contacts
        thing = dataclasses.replace(thing)
    same(thing, again)
    same(thing, pickle.loads(pickle.dumps(again)))


def test_what_is_computed_by_a_copy_is_the_same() -> None:
    for name in ("Substructure", "ReducedSubstructure"):
        for other in (copy.deepcopy(made(name)), dataclasses.replace(made(name))):
            assert np.array_equal(fs.complex_modes(other, BELT).eigenvalues, fs.complex_modes(made(name), BELT).eigenvalues)
            same(other.pencil, made(name).pencil)
            same(other.interface_rows, made(name).interface_rows)
    orbit = pickle.loads(pickle.dumps(cycle()))
    assert np.array_equal(orbit.floquet.values, cycle().floquet.values) and orbit.sticking == cycle().sticking
    assert fs.branch(orbit.contact.model, BELT, start=orbit, points=2).points[0].omega == pytest.approx(orbit.omega, rel=1e-6)


@pytest.mark.slow
def test_another_process_reads_what_was_pickled() -> None:
    things = [made(name) for name in ("Belt", "Branch", "ReducedSubstructure", "Mesh")]
    code = "import pickle, sys; print(*pickle.load(sys.stdin.buffer), sep='\\n')"
    said = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(things), capture_output=True, check=True).stdout
    assert said.decode().splitlines() == [str(thing) for thing in things]


def test_a_cycle_leaves_its_factor_behind() -> None:
    solved = Solved(full().pencil, cycle().contact.W)  # what a large model's cycle holds
    large = dataclasses.replace(cycle(), flexibility=solved, stability=False)
    state = large.state()
    assert solved.static is solved.static
    again = pickle.loads(pickle.dumps(large))
    assert "static" not in vars(again.flexibility)
    np.testing.assert_allclose(again.state().displacement, state.displacement, rtol=1e-12)
    np.testing.assert_allclose(again.flexibility.mobility(np.array([0.3j]))[0], solved.mobility(np.array([0.3j]))[0], rtol=1e-9)


def test_a_belt_takes_the_slope_anew_unless_it_was_given() -> None:
    law = fs.StribeckArctan(eps=1e-3)
    belt = fs.Belt(speed=0.19113, law=law)
    for one in (belt, copy.deepcopy(belt), pickle.loads(pickle.dumps(belt))):
        assert dataclasses.replace(one, speed=0.3).slope == law.slope(0.3) != belt.slope
        assert dataclasses.replace(one, law=fs.StribeckArctan(eps=0.1)).slope == fs.StribeckArctan(eps=0.1).slope(0.19113)
        assert dataclasses.replace(one, force=2.0).slope == belt.slope
    assert dataclasses.replace(fs.Belt(speed=0.1, slope=-0.2), speed=0.3).slope == -0.2
    given = fs.Belt(speed=0.19113, law=law, slope=float(law.slope(0.19113)))
    with pytest.raises(fs.InputError, match="contradicts the law"):
        dataclasses.replace(given, speed=0.3)
    with pytest.raises(fs.InputError, match="contradicts the law"):
        dataclasses.replace(belt, slope=-0.1)


def test_an_estimate_goes_with_the_matrices_it_holds_for(tmp_path: Path) -> None:
    rom = made("ReducedSubstructure")
    fs.write_matrices(tmp_path, rom)
    read = fs.read_component(tmp_path)
    assert rom.estimate is not None
    same(rom, read)
    for model in (rom, read, copy.deepcopy(rom)):
        same(dataclasses.replace(model, name="other").estimate, rom.estimate)
        for other in (dataclasses.replace(model, D=2 * model.D), dataclasses.replace(model, D=None), model.with_damping(model.D),
                      dataclasses.replace(dataclasses.replace(model, K=1.01 * model.K), name="other")):
            assert other.estimate is None and other.estimated is None


def test_nobody_writes_into_a_copy() -> None:
    sub, mesh = (pickle.loads(pickle.dumps(made(name))) for name in ("Substructure", "Mesh"))
    for array in (sub.ports["belt"], sub.interface, sub.K.data, mesh.points, mesh.sets["left"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(TypeError, match="item assignment"):
        sub.ports["belt"] = np.ones(6)
