"""What every reduction method refuses, with one class of error and the same words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import SparseFactor
from femsub.reduction.reduce import METHODS

HELD = ("craig-bampton", "guyan", "hurty")  # of a chain with one mass held, 9 DOF are left
UNESTIMATED = ("herting", "macneal")
BAND = (0.0, 0.2)


def loose() -> fs.Substructure:
    """A floating lattice that its interface of one node lets turn."""
    return fs.Substructure(lattice(4, 4).M, lattice(4, 4).K, interface=[0, 1], name="calliper")


Made = Callable[[type], object]
ALWAYS: dict[str, tuple[Made, type[Exception], str]] = {
    "a negative number of modes": (lambda kind: kind(modes=-1), fs.InputError, "modes must be at least 0, but is -1"),
    "half a mode": (lambda kind: kind(modes=2.5), fs.InputTypeError, r"modes must be a whole number, not 2\.5"),
    "modes and a tolerance": (lambda kind: kind(modes=3, band=BAND, tol=1e-3), fs.InputError,
                              "modes=3 and a band or tolerance are both"),
    "a band alone": (lambda kind: kind(band=BAND), fs.InputError, "band and tol go together"),
    "an unknown port": (lambda kind: fs.reduce(fs.chain(10), kind(modes=0), ports=["bolt"]), fs.InputError,
                        "unknown port 'bolt'"),
    "what is already reduced": (lambda kind: fs.reduce(fs.reduce(fs.chain(30, belt=1), fs.CraigChang(4)), kind(modes=0)),
                                fs.InputError, "Reduce the full component instead"),
}


@pytest.mark.parametrize("what", ALWAYS)
@pytest.mark.parametrize("key", sorted(METHODS))
def test_every_method_refuses(key: str, what: str) -> None:
    make, error, words = ALWAYS[what]
    with pytest.raises(error, match=words):
        make(METHODS[key])


@pytest.mark.parametrize("key", sorted(METHODS))
def test_more_modes_than_there_are(key: str) -> None:
    with pytest.raises(fs.InputError, match=f"11 elastic modes were asked for, but there are {9 if key in HELD else 10}"):
        fs.reduce(fs.chain(10), METHODS[key](modes=11))


@pytest.mark.parametrize("key", sorted(METHODS))
def test_no_interface_and_no_modes(key: str) -> None:
    words = "Herting needs interface DOF" if key == "herting" else "would be empty: modes=0, and no interface is given"
    with pytest.raises(fs.InputError, match=words):
        fs.reduce(fs.Substructure(fs.chain(5).M, fs.chain(5).K), METHODS[key](modes=0))


@pytest.mark.parametrize("key", [*HELD, "herting"])
def test_an_interface_that_does_not_hold_a_floating_part(key: str) -> None:
    with pytest.raises(fs.InputError, match=r"the interface does not hold 'calliper'.*1 rigid-body modes remain"):
        fs.reduce(loose(), METHODS[key](modes=0))


@pytest.mark.parametrize("key", sorted(METHODS))
def test_a_tolerance_is_for_methods_with_an_estimate(key: str) -> None:
    if key not in UNESTIMATED:
        assert METHODS[key](band=BAND, tol=1e-3).tol == 1e-3
        return
    with pytest.raises(fs.InputError, match=f"{METHODS[key].__name__} takes a number of modes only.*no estimate is possible"):
        METHODS[key](band=BAND, tol=1e-3)


@pytest.mark.parametrize("key", sorted(METHODS))
def test_coordinates_of_another_model(key: str) -> None:
    rom = fs.reduce(fs.chain(10, belt=1, interface=[1]), METHODS[key](modes=2), ports=True)
    assert np.array_equal(rom.expand(np.eye(rom.size)), rom.V)
    with pytest.raises(fs.InputError, match=f"q must have {rom.size} rows"):
        rom.expand(np.ones(rom.size + 1))


def test_what_is_no_method() -> None:
    with pytest.raises(fs.InputTypeError, match="unknown method 'hcb'"):
        fs.reduce(fs.chain(10), "hcb")


@pytest.mark.parametrize("key", [*HELD, "herting"])
def test_an_interface_that_leaves_a_rotation_is_told_before_any_factor_is_made(key: str) -> None:
    solid = fs.solid(fs.block((1, 1, 1), (4, 4, 4), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
    line = np.flatnonzero((solid.dofs.points[:, 0] == 0) & (solid.dofs.points[:, 1] == 0))  # an edge: turning about it is free
    for interface, left in ((line, 1), (line[:3], 3)):
        part = fs.Substructure(solid.M, solid.K, interface=interface, name="cube", dofs=solid.dofs)
        before = SparseFactor.made
        with pytest.raises(fs.InputError, match=rf"the interface does not hold 'cube'.*{left} rigid-body modes remain"):
            fs.reduce(part, METHODS[key](modes=0))
        assert SparseFactor.made == before


def test_an_edge_holds_a_part_that_its_supports_keep_from_turning() -> None:
    solid = fs.solid(fs.block((1, 1, 1), (4, 4, 4), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"],
                     supports=["right"])
    line = np.flatnonzero((solid.dofs.points[:, 0] == 0) & (solid.dofs.points[:, 1] == 0))
    part = fs.Substructure(solid.M, solid.K, interface=line, name="cube", dofs=solid.dofs)
    assert fs.reduce(part, fs.CraigBampton(modes=2)).size == len(line) + 2
