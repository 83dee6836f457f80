"""Interface modes: a plate in parts whose interface moves in a tenth as many shapes, with its frequencies and critical slopes."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.model.estimate import SHARE
from femsub.modes import dense, normal_modes
from femsub.reduction.reduce import METHODS

pytestmark = pytest.mark.filterwarnings("ignore::femsub.PortWarning")
STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "thickness": 0.004}
PRIMAL = sorted(METHODS.keys() - {"macneal", "dual-craig-bampton"})  # projections, so that frequencies come from above


@cache
def plate(cells: tuple[int, int] = (32, 16), pieces: tuple[int, int] = (4, 2), held: bool = True) -> fs.System:
    """A plate of 2 m x 1 m in pieces with matching meshes; a belt on a joint, and a port amid a piece."""
    size = 2.0 / pieces[0], 1.0 / pieces[1]
    parts, joints = {}, []
    for i, j in np.ndindex(*pieces):
        mesh = fs.rectangle(size, (cells[0] // pieces[0], cells[1] // pieces[1]))
        mesh = dataclasses.replace(mesh, points=mesh.points + np.multiply(size, (i, j)))
        ports = {"belt": mesh.points.max(axis=0) - [0.0, size[1] / 2]} if (i, j) == (pieces[0] // 2 - 1, 0) else {}
        ports |= {"amid": mesh.points.mean(axis=0)} if (i, j) == (0, 0) else {}
        sides = {"left": i > 0, "right": i < pieces[0] - 1, "front": j > 0, "back": j < pieces[1] - 1}
        parts[f"p{i}{j}"] = fs.plate(mesh, **STEEL, supports={"left": "clamped"} if held and not i else {},
                                     interface=[side for side, joined in sides.items() if joined],
                                     ports={name: tuple(place) for name, place in ports.items()}, rayleigh=(1.0, 1e-6))
        joints += [fs.Rigid((f"p{i - 1}{j}", "right"), (f"p{i}{j}", "left"))] if i else []
        joints += [fs.Rigid((f"p{i}{j - 1}", "back"), (f"p{i}{j}", "front"))] if j else []
    return fs.couple(parts, joints)


@cache
def reduced(key: str = "craig-bampton", modes: int = 30, **which: object) -> fs.System:
    full = plate(**which)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(full, dict.fromkeys(full.parts, METHODS[key](modes)), ports=True)


def small(key: str = "craig-bampton", modes: int = 6, **which: object) -> fs.System:
    return reduced(key, modes, cells=(8, 4), pieces=(2, 2), **which)


def elastic(model: fs.Substructure, count: int = 20) -> np.ndarray:
    found = fs.normal_modes(model, count=count)
    return found.frequencies[found.rigid:]


def interface(system: fs.System) -> int:
    """How many independent interface DOF the parts have in the system, joined ones once."""
    parts, B, start = system.parts.values(), [], 0
    for part in parts:
        rows = part.interface_rows
        B.append((rows.toarray() if sp.issparse(rows) else rows) @ system.L[start:start + part.size])
        start += part.size
    table = np.vstack(B)
    return int(np.linalg.matrix_rank(table / np.linalg.norm(table, axis=1)[:, None], tol=1e-9))


# a tenth of the interface


@pytest.mark.slow
def test_a_tenth_of_the_interface_keeps_the_frequencies() -> None:
    system = reduced()
    tenth = interface(system) // 10
    rom = fs.reduce(system, fs.InterfaceModes(tenth))
    assert tenth == 32 and rom.modes == tenth and rom.kinds.count("interface mode") == tenth
    wrong = elastic(rom) / elastic(plate()) - 1
    assert wrong.min() > -1e-9 and wrong.max() < 1e-3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("port", ["p10.belt", "p00.amid"])  # on a joint, and amid a piece
def test_a_tenth_of_the_interface_keeps_the_critical_slope(port: str) -> None:
    system = reduced(modes=10)
    rom = fs.reduce(system, fs.InterfaceModes(interface(system) // 10), ports=True)
    band = (0.0, 1.01 * elastic(plate())[-1])
    slope = fs.critical_slope(plate(), port=port, band=band).value
    assert fs.critical_slope(rom, port=port, band=band).value == pytest.approx(slope, rel=1e-2)
    assert rom.port_error[port] < 1e-6
    q = fs.normal_modes(rom, count=3).shapes
    u = plate().port(port) @ plate().collected(system.expand(rom.expand(q)))
    assert np.allclose(u, rom.port(port) @ q, atol=1e-9 * abs(u).max())


def test_the_whole_plate_follows_from_the_interface_modes() -> None:
    system = reduced()
    rom = fs.reduce(system, fs.InterfaceModes(40))
    q = fs.normal_modes(rom, count=3).shapes
    u = system.expand(rom.expand(q))
    assert {name: shape.shape for name, shape in u.items()} == {name: (part.size, 3) for name, part in plate().parts.items()}
    x = plate().collected(u)  # no gap at the joints
    again = plate().expand(x)
    assert max(abs(u[name] - again[name]).max() for name in u) < 1e-9 * abs(x).max()
    true = fs.normal_modes(plate(), count=3).shapes
    assert np.allclose(abs(np.sum(x * (plate().M @ true), axis=0)), 1.0, atol=1e-4)


# what must hold with any number


@pytest.mark.sampled(3)
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("key", sorted(METHODS.keys() - {"macneal"}))
def test_all_interface_modes_are_the_system(key: str, held: bool) -> None:
    system = small(key, held=held)
    n_b, rigid = interface(system), fs.normal_modes(system, count=1).rigid
    assert rigid == (0 if held else 3)
    rom = fs.reduce(system, fs.InterfaceModes(n_b - rigid))
    assert rom.size == system.size and rom.cutoff == system.cutoff
    assert fs.InterfaceModes(1).static_columns(system) == system.size - n_b
    for key in "MDK":
        energy, own = rom.V.T @ getattr(system, key) @ rom.V, getattr(rom, key)
        assert np.allclose(energy, own, rtol=1e-6, atol=1e-6 * np.sqrt(np.outer(*[own.diagonal().clip(1e-9 * own.max())] * 2)))
    assert np.allclose(elastic(rom, 15), elastic(system, 15), rtol=1e-9) and fs.normal_modes(rom, count=1).rigid == rigid


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", PRIMAL)
def test_frequencies_fall_with_every_mode_and_stay_above(key: str) -> None:
    system = small(key)
    found = [elastic(system, 6)] + [elastic(fs.reduce(system, fs.InterfaceModes(count)), 6) for count in (40, 24, 16, 8)]
    for below, above in pairwise(found):
        assert (above >= below * (1 - 1e-9)).all()
    assert (found[-1] > 1.0001 * found[0]).any()


@pytest.mark.parametrize("key", ["rubin", "craig-chang"])
def test_the_modes_are_those_of_the_condensed_interface(key: str) -> None:
    """Of free-interface parts K_bb alone is the residual stiffness, whose modes have nothing in common with the interface's."""
    system = small("rubin")
    b = np.unique(sp.csr_array(sp.vstack([sp.csr_array(part.interface_rows) @ sp.csr_array(system.L[start:start + part.size])
                                          for part, start in zip(system.parts.values(), np.cumsum([0] + [
                                              part.size for part in system.parts.values()])[:-1], strict=True)])).indices)
    true, count = fs.normal_modes(system, count=6), len(b) // 4
    wrong = la.eigh(system.K[np.ix_(b, b)], system.M[np.ix_(b, b)])[1][:, :count]
    rom = fs.reduce(system, fs.InterfaceModes(count))

    def lost(shapes: np.ndarray) -> float:
        """The share of the interface's motion in the lowest modes that no combination of the shapes has."""
        unit = np.sqrt(system.K.diagonal()[b])[:, None]
        u = unit * true.shapes[b]
        return float(max(np.linalg.norm(u - (unit * shapes) @ np.linalg.lstsq(unit * shapes, u, rcond=None)[0], axis=0)
                         / np.linalg.norm(u, axis=0)))

    assert lost(wrong) > 0.5 > 0.05 > lost(rom.V[b])
    i = np.setdiff1d(np.arange(system.size), b)
    T = np.zeros((system.size, len(i) + count))
    T[i, np.arange(len(i))], T[b, len(i):] = 1.0, wrong
    omega = np.sqrt(la.eigvalsh(T.T @ system.K @ T, T.T @ system.M @ T)[:6])
    assert (omega / true.frequencies - 1).max() > 0.1 > 1e-3 > (elastic(rom, 6) / true.frequencies - 1).max()
    if key == "craig-chang":  # the same span in coordinates that are not physical
        other = fs.reduce(small(key), fs.InterfaceModes(count))
        assert np.allclose(elastic(other, 6), elastic(rom, 6), rtol=1e-8)


def test_hurtys_interface_counts_what_moves_it_once() -> None:
    assert interface(small("hurty")) == interface(small()) == fs.reduce(small("hurty"), fs.InterfaceModes(48)).modes


# band and tolerance


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", ["craig-bampton", "rubin"])
@pytest.mark.parametrize("tol", [1e-2, 1e-4])
def test_a_tolerance_is_met_with_few_modes(key: str, tol: float) -> None:
    system = reduced(key, 8, cells=(16, 8), pieces=(2, 2))
    true = elastic(system, 8)
    rom = fs.reduce(system, fs.InterfaceModes(band=(0.0, 1.01 * true[-1]), tol=tol))
    error = (elastic(rom, 8) / true - 1).max()
    assert rom.estimate.met and error <= rom.estimate.worst <= tol and rom.estimate.worst < 10 * error
    assert len(rom.estimate.frequencies) == 8 and len(rom.estimate.eigenvalues) == 8  # the plate is damped
    fewer = fs.reduce(system, fs.InterfaceModes(rom.modes - 1))
    assert (elastic(fewer, 8) / true - 1).max() > 0.9 * tol or SHARE * fewer.cutoff <= 1.01 * true[-1]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", ["craig-bampton", "craig-chang"])
def test_complex_eigenvalues_under_a_belt_are_within_the_tolerance(key: str) -> None:
    system = reduced(key, 8, cells=(16, 8), pieces=(2, 2))
    belt = fs.Belt("p00.belt", force=20.0, slope=-0.5)
    band = (0.0, 200.0)
    rom = fs.reduce(system, fs.InterfaceModes(band=band, tol=1e-4), contacts=belt)
    one, other = (fs.complex_modes(model, belt, band=band).eigenvalues for model in (system, rom))
    one, other = (found[np.argsort(found.imag)] for found in (one, other))
    assert np.allclose(np.sort(rom.estimate.eigenvalues.imag), other.imag, rtol=1e-9)
    assert len(one) == len(other) > 5 and (abs(other - one) / abs(one)).max() <= rom.estimate.worst <= 1e-4


def test_the_band_ends_below_the_parts_cutoff() -> None:
    system = small()
    with pytest.raises(fs.InputError, match="already reduced, with a cut-off"):
        fs.reduce(system, fs.InterfaceModes(band=(0.0, system.cutoff), tol=1e-3))


# part by part


def test_one_part_of_a_system_is_reduced_by_itself() -> None:
    system = small()
    rom = system.parts["p10"]
    part = fs.reduce(rom, fs.InterfaceModes(15))
    assert part.size == rom.size - len(rom.interface) + 3 + 15 and part.sets.keys() == {"left", "back"}
    assert "'plate': 24 of 60 DOF by Craig-Bampton with 6 fixed-interface modes, then 15 interface modes" in repr(part)
    assert np.array_equal(part.interface_numbers, rom.interface_numbers)  # joints may name them
    local = system.with_parts({"p10": part})  # its neighbours have their whole interface, and follow it
    error = elastic(local, 6) / elastic(system, 6) - 1
    assert local.size < system.size and error.min() > -1e-9 and 1e-9 < error.max() < 1e-2
    u = local.expand(fs.normal_modes(local, count=2).shapes)
    assert u["p10"].shape == (60, 2) == u["p11"].shape


@pytest.mark.sampled(4)
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("key", ["craig-bampton", "rubin"])
def test_parts_that_meet_share_their_shapes(key: str, held: bool) -> None:
    system, full = small(key, held=held), plate((8, 4), (2, 2), held)
    sizes, errors, expected = [], [], elastic(system, 6)
    for count in (2, 4, 8, 24):
        local = fs.reduce(system, dict.fromkeys(system.parts, fs.InterfaceModes(count)))
        assert fs.normal_modes(local, count=1).rigid == (0 if held else 3)
        sizes.append(local.size)
        errors.append(elastic(local, 6) / expected - 1)
        u = local.expand(fs.normal_modes(local, count=4).shapes)
        again = full.expand(full.collected(u))
        assert max(abs(u[name] - again[name]).max() for name in u) < 1e-9 * max(abs(u[name]).max() for name in u)
    assert sorted(sizes) == sizes and sizes[0] < sizes[-1] == system.size
    assert min(error.min() for error in errors) > -1e-9 and errors[0].max() > 1e-4 > errors[2].max() and errors[-1].max() < 1e-9
    further = fs.reduce(local, fs.InterfaceModes(24))  # then of the whole system
    assert np.allclose(elastic(further, 6), elastic(fs.reduce(system, fs.InterfaceModes(24)), 6), rtol=1e-9)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("key", ["craig-bampton", "rubin"])
@pytest.mark.parametrize("count", [8, 14])
def test_a_floating_system_is_not_held_by_what_its_parts_share(key: str, count: int) -> None:
    """Shapes of neighbours are nearly alike: what is dropped of them must not take a millionth of a rigid motion with it."""
    system = reduced(key, 6, cells=(32, 16), pieces=(4, 2), held=False)
    local = fs.reduce(system, dict.fromkeys(system.parts, fs.InterfaceModes(count)), ports=True)
    assert local.size < system.size and fs.normal_modes(local, count=1).rigid == 3
    assert np.allclose(elastic(local, 6), elastic(system, 6), rtol=1e-3)


# products of the parts' shapes leave two roundings in rigid motion, which some processors' order of sums makes worth a warning
@pytest.mark.filterwarnings("ignore:.*rigid-body motion, although K:femsub.checks.ConditionWarning")
@pytest.mark.parametrize("count", [3, 17])
def test_parts_on_both_sides_of_one_that_is_spread_move_with_it(count: int) -> None:
    """Its generalised coordinates belong to the interfaces of both, and some shapes of one move nothing of the other."""
    full = plate((12, 4), (3, 1), held=False)
    system = fs.reduce(full, {"p00": fs.CraigBampton(6), "p10": fs.CraigChang(6), "p20": fs.Rubin(6)}, ports=True)
    local = fs.reduce(system, {name: fs.InterfaceModes(count) for name in ("p00", "p20")}, ports=True)
    error = elastic(local, 6) / elastic(system, 6) - 1
    assert fs.normal_modes(local, count=1).rigid == 3 and error.min() > -1e-9 and error.max() < (2e-2 if count == 3 else 1e-9)


def test_joints_may_name_the_dof_numbers_of_the_full_parts() -> None:
    named = plate((8, 8), (2, 1))
    ends = [(name, [int(named.parts[name].interface[at]) for at in named.parts[name].sets[side]])
            for name, side in (("p00", "right"), ("p10", "left"))]
    system = fs.reduce(fs.couple(named.parts, [fs.Rigid(*ends)]), dict.fromkeys(named.parts, fs.Rubin(8)))
    local = fs.reduce(system, dict.fromkeys(named.parts, fs.InterfaceModes(6)))
    assert local.size < system.size and elastic(local, 4) / elastic(system, 4) == pytest.approx(1, rel=1e-2)


# systems of all kinds


def halves() -> fs.System:
    """The small plate as a system of two systems."""
    made = {}
    for side, cut in (("0", "right"), ("1", "left")):
        parts = {name: part for name, part in plate((8, 4), (2, 2)).parts.items() if name[1] == side}
        roms = {name: fs.reduce(part, fs.CraigBampton(6), ports=True) for name, part in parts.items()}
        made[f"h{side}"] = fs.couple(roms, [fs.Rigid((f"p{side}0", "back"), (f"p{side}1", "front"))],
                                     interface=[(name, cut) for name in roms])
    return fs.couple(made, [fs.Rigid(("h0", f"p0{j}.right"), ("h1", f"p1{j}.left")) for j in (0, 1)])


def test_interfaces_of_systems_within_systems_are_found() -> None:
    system = halves()
    flat = fs.reduce(small(), fs.InterfaceModes(24))
    nested = fs.reduce(system, fs.InterfaceModes(24))
    assert system.size == small().size and nested.size == flat.size
    assert np.allclose(elastic(nested, 8), elastic(flat, 8), rtol=1e-9)


@pytest.mark.slow
def test_glued_surfaces_are_one_interface() -> None:
    steel, meshes = fs.Material(2.1e11, 0.3, 7850.0), {"a": fs.block((1.0, 1.0, 1.0), (3, 3, 3)),
                                                       "b": fs.block((1.0, 1.0, 1.0), (2, 2, 2))}
    meshes["b"] = dataclasses.replace(meshes["b"], points=meshes["b"].points + np.array([1.0, 0.0, 0.0]))
    parts = {"a": fs.solid(meshes["a"], steel, supports=["left"], interface=["right"]),
             "b": fs.solid(meshes["b"], steel, interface=["left"])}
    for method in (fs.CraigBampton(8), fs.Rubin(8)):
        roms = {name: fs.reduce(part, method) for name, part in parts.items()}
        system = fs.couple(roms, [fs.Tied(("a", "right"), ("b", "left"), meshes)])
        assert interface(system) == 63
        rom = fs.reduce(system, fs.InterfaceModes(63))
        assert rom.size == system.size and np.allclose(elastic(rom, 8), elastic(system, 8), rtol=1e-9)
        assert (elastic(fs.reduce(system, fs.InterfaceModes(18)), 3) / elastic(system, 3) - 1).max() < 1e-2
        local = fs.reduce(system, {"a": fs.InterfaceModes(12), "b": fs.InterfaceModes(12)})
        error = elastic(local, 3) / elastic(system, 3) - 1
        assert local.size < system.size and error.min() > -1e-9 and error.max() < 1e-2


def test_a_part_that_turns_about_its_interface_keeps_that_motion() -> None:
    """One node does not hold a beam on a hinge: its interior floats, and the static shapes must not contain its rotation."""
    steel = {"E": 2.1e11, "I": 1e-8, "rho": 7850.0, "A": 1e-4}
    arm = fs.beam(1.0, 10, **steel, interface=["left"])
    hinged = fs.Substructure(arm.M, arm.K, interface=[0])  # its deflection, not its slope
    base = fs.beam(1.0, 10, **steel, supports={"left": "clamped"}, interface=["right"])
    system = fs.couple({"base": fs.reduce(base, fs.Rubin(4)), "arm": fs.reduce(hinged, fs.Rubin(4))},
                       [fs.Rigid(("base", [int(base.interface[0])]), ("arm", [0]))])
    assert fs.normal_modes(system, count=3).rigid == 1
    rom = fs.reduce(system, fs.InterfaceModes(2))
    assert rom.size == system.size and fs.normal_modes(rom, count=3).rigid == 1
    assert np.allclose(elastic(rom, 6), elastic(system, 6), rtol=1e-9)


@pytest.mark.parametrize("key", ["craig-bampton", "rubin", "craig-chang"])
def test_ports_amid_parts_and_on_joints_are_measured(key: str) -> None:
    system = small(key)
    with pytest.warns(fs.PortWarning, match="port 'p00.belt' of 'system': its static response is off by"):
        rom = fs.reduce(system, fs.InterfaceModes(6))
    for port in system.ports:
        w, reduced_w = system.port(port), rom.port(port)
        x = np.linalg.solve(system.K, w)
        share = reduced_w @ np.linalg.solve(rom.K, reduced_w) / (w @ x)
        assert rom.port_error[port] == pytest.approx(np.sqrt(1 - share), rel=1e-6, abs=1e-6)
        more = fs.reduce(system, fs.InterfaceModes(6), ports=[port])
        assert more.size == rom.size + 1 and more.port_error[port] < 1e-5 and more.kinds[-1] == "static port"
        assert np.allclose(more.V @ np.linalg.solve(more.K, more.port(port)), x, atol=1e-8 * abs(x).max())


def test_only_the_lowest_modes_of_a_large_interface_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    def seen(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sizes.append(len(K))
        return dense.dense_modes(K, M)

    monkeypatch.setattr(normal_modes, "dense_modes", seen)
    fs.reduce(reduced(), fs.InterfaceModes(25))
    assert interface(reduced()) == 320 and not sizes


# what cannot be


@pytest.mark.parametrize(("make", "words"), [
    (lambda: fs.reduce(fs.chain(10, interface=()), fs.InterfaceModes(2)), "'chain' has no interface DOF"),
    (lambda: fs.reduce(small(), fs.InterfaceModes(49)), "49 interface modes were asked for, .* 'system' has 48"),
    (lambda: fs.reduce(small(held=False), fs.InterfaceModes(50)), "has 49 beside 3 rigid-body modes"),
    (lambda: fs.reduce(fs.chain(5000, interface=(1, 9)), fs.InterfaceModes(1)), "'chain' has 4998 coordinates beside its 2 "
     "interface DOF. Interface modes keep all of them, at most 4000: reduce its parts first"),
    (lambda: fs.reduce(fs.couple(small().parts, small().joints, assembly="dual"), fs.InterfaceModes(9)), "is of dual assembly"),
    (lambda: fs.reduce(halves(), dict.fromkeys(("h0", "h1"), fs.InterfaceModes(2))), "is a system of its own, whose inner"),
    (lambda: fs.reduce(dual := fs.couple(small().parts, small().joints, assembly="dual"), dict.fromkeys(
        dual.parts, fs.InterfaceModes(2))), "has joints by multipliers"),
    (lambda: fs.reduce(small(), fs.InterfaceModes(-1)), "modes"),
    (lambda: fs.InterfaceModes(), "InterfaceModes takes modes=20, or band="),
])
def test_what_cannot_be_reduced_is_told(make: Callable[[], object], words: str) -> None:
    with pytest.raises(fs.InputError, match=words):
        make()


def test_scenes_do_not_offer_it_for_components() -> None:
    assert "interface-modes" not in METHODS


def test_rounding_between_stiff_and_soft_parts_is_told() -> None:
    soft, bar = fs.chain(9, interface=[7, 8, 9]), fs.chain(9, interface=[1, 2, 3, 5, 7], fixed=False)

    def small(contrast: float) -> tuple[fs.System, fs.ReducedSubstructure]:
        parts = {"soft": soft, "stiff": fs.Substructure(bar.M, contrast * bar.K / 3, interface=bar.interface)}
        full = fs.couple(parts, [fs.Rigid(("soft", [8]), ("stiff", [0]))])
        rom = fs.reduce(full, {"soft": fs.CraigBampton(4), "stiff": fs.CraigBampton(1)})
        return rom, fs.reduce(rom, fs.InterfaceModes(band=(0.0, 0.4), tol=1e-2))

    rom, found = small(1e10)
    exact = fs.normal_modes(rom, count=1).frequencies[0]
    assert found.estimate is not None
    assert abs(found.estimate.frequencies[0] / exact - 1) <= found.estimate.frequency_error[0]
    assert found.estimate.frequency_error[0] > 1e-5
    with pytest.raises(fs.NotConvergedError, match="by rounding alone"):
        small(5e12)
