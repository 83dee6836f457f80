"""Every argument of every public function takes nonsense: an answer, or an error of femsub's own that ends within a minute.

Odd values of each kind (numbers, arrays, sparse matrices, containers, texts, and the argument's own value in another dress) come
when slow tests run. There a message is short and printable, and a masked array is refused if anything is masked.
"""

from __future__ import annotations

import inspect
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import norm

import femsub as fs
from femsub.checks import shown

LIMIT = 60.0  # seconds for one call: what takes longer hangs, on a busy machine as well
#: arguments that are looked at later, by `couple`, or for some programs alone
LATER = ("first", "second", "end", "reference", "surface", "weights", "full")
KINDS = ("numbers", "arrays", "sparse", "containers", "texts", "dressed")
NONSENSE: dict[str, Any] = {
    "None": None,
    "a word": "x",
    "nothing": "",
    "True": True,
    "-1": -1,
    "0": 0,
    "10**30": 10**30,
    "-1.5": -1.5,
    "1e308": 1e308,
    "NaN": float("nan"),
    "inf": float("inf"),
    "1j": 1j,
    "[]": [],
    "{}": {},
    "[NaN]": [float("nan")],
    "['x']": ["x"],
    "[None]": [None],
    "(3, 1)": (3, 1),
    "(-inf, inf)": (-np.inf, np.inf),
    "too long": list(range(100)),
    "ragged": [[1.0], [1.0, 2.0]],
    "{1: 2}": {1: 2},
    "{'x': None}": {"x": None},
    "empty array": np.zeros((0, 0)),
    "bytes": b"x",
    "an object": object(),
    "a class": dict,
    "NaN array": np.full((3, 3), np.nan),
    "text array": np.array(["a", "b"]),
    "a set": {1, 2},
    "lambda": lambda: None,
}
RESULTS = {
    "Audit",
    "BoxModel",
    "Branch",
    "Cell",
    "ComplexModes",
    "CriticalValue",
    "Cut",
    "EffectiveMasses",
    "Estimate",
    "Facing",
    "FrequencyBounds",
    "Levels",
    "LimitCycle",
    "ModeCard",
    "ModeName",
    "NormalModes",
    "ReducedSubstructure",
    "Refined",
    "Rotor",
    "Scatter",
    "SelfExcitation",
    "Sensitivities",
    "ShotCycle",
    "StabilityMap",
    "StabilitySweep",
    "Study",
    "System",
    "Tracked",
    "Transient",
    "WhatHelps",
}  # made by femsub, not by a caller


def calls(folder: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """A call that works for each public function, by keywords: the arguments to be replaced in turn."""
    sub, belt = fs.chain(6, belt=2), fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=1e-2))
    slope = fs.Belt(slope=-0.05)
    rom = fs.reduce(sub, fs.CraigChang(modes=3), ports=True)
    modes = fs.complex_modes(rom, slope)
    mesh, flat = fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"), fs.rectangle((1.0, 1.0), (2, 2))
    steel, above = fs.Material(1.0, 0.3, 1.0), fs.Mesh(mesh.points + np.array([0.0, 0.0, 1.0]), mesh.cells, mesh.kind, mesh.sets)
    brick = fs.solid(mesh, steel)
    ring = fs.annulus(0.1, 0.2, 0.02, (1, 8, 1), "hexahedron")
    run = fs.transient(sub, belt, (0.0, 20.0))
    t = np.linspace(0.0, 20.0, 500)
    y = np.exp(0.1 * t) * np.sin(3 * t)
    fs.write_matrices(folder / "model", rom)
    fs.write_mesh(folder / "mesh.vtu", mesh)
    soft = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    cycle = fs.harmonic_balance(rom, soft, harmonics=40)
    parts = {"a": fs.chain(4, interface=[4]), "b": fs.chain(3, interface=[1], fixed=False)}
    pair = fs.couple(parts, [fs.Rigid(("a", [3]), ("b", [0]))])

    sliding = fs.FrictionContact("top", "ground", mesh, 1.0, 0.4, direction=np.array([1.0, 0.0, 0.0]))

    def rigid(end: Any, tol: Any, name: Any) -> fs.Rigid:
        return fs.Rigid(end, ("b", [0]), tol=tol, name=name)

    def coupled(**given: Any) -> fs.System:
        """A joint's own arguments, where they are used."""
        return fs.couple(parts, [fs.Rigid(("a", [3]), ("b", [0])), fs.Spring(**given)])

    def rubbing(**given: Any) -> fs.Pencil:
        """Arguments of a friction contact, where they are used."""
        return fs.solid(mesh, steel, interface=["top"]).linearised(fs.FrictionContact(**given))

    def change(kind: Any) -> Callable[..., fs.Substructure]:
        """Arguments of a change, where they are used."""
        def used(**given: Any) -> fs.Substructure:
            return fs.modified(sub, [kind(**given)])

        used.__signature__ = inspect.signature(kind)  # type: ignore[attr-defined]
        return used

    rubbing.__signature__ = inspect.signature(fs.FrictionContact)  # type: ignore[attr-defined]

    def cut(model: Any, into: Any, sets: Any) -> fs.Cut:  # what a caller's own build raises is the caller's
        return fs.cut(model, fs.plate, into=into, sets=sets, E=1.0, nu=0.3, rho=1.0, thickness=0.1)

    def pieces(folder: Any, mesh: Any, build: Any, into: Any, supports: Any, interface: Any, ports: Any) -> Any:
        return fs.cut_to_files(folder, mesh, build, into=into, material=steel, supports=supports, interface=interface,
                               ports=ports)

    (folder / "hammer.uff").write_text("\n".join([
        "    -1", "    58", *"abcde", "    4         0    1         0       NONE         1   1       NONE         1   1",
        "         6         1         0  0.00000e+00  0.00000e+00  0.00000e+00",
        *(f"{kind:10}    0    0    0 NONE                 NONE" for kind in (18, 12, 13, 0)),
        "  1.00000e+00   1.00000000000e+00   0.00000000000e+00", "    -1", ""]))
    (folder / "modes.uff").write_text("\n".join([
        "    -1", "    55", *"abcde", "         1         2         2         8         2         3",
        "         2         4         0         1", "  1.00000e+01  1.00000e+00  0.00000e+00  0.00000e+00",
        "         7", "  1.00000e+00  2.00000e+00  3.00000e+00", "    -1", ""]))
    tip = fs.frequency_response(sub, at=[0.1, 0.2], loads="belt")
    places = {f"s{k}": ((k % 2, k // 2 % 2, k // 4), tuple(np.eye(3)[k % 3])) for k in range(9)}
    sensed = fs.FrequencyResponse.measured([1.0], np.ones((1, 9, 9)), list(places), list(places))
    row = fs.block((6.0, 1.0, 1.0), (6, 1, 1), "hexahedron")
    recipes = pieces(folder / "pieces", row, fs.solid, 2, ["left"], None, None)
    coupled.__signature__ = inspect.signature(fs.Spring)  # type: ignore[attr-defined]
    usual: dict[str, Any] = {
        "M": sub.M, "K": sub.K, "reference": ("a", [3]), "surface": ("b", [0]), "full": sub, "model": sub, "sub": sub, "into": 2,
        "E": 1.0, "nu": 0.3, "rho": 1.0, "thickness": 0.1, "material": steel, "contacts": soft, "parameter": "slope",
        "values": [-0.1, 0.0], "mesh": mesh, "t": t, "signal": y, "method": fs.CraigBampton(2)}
    own: dict[str, dict[str, Any]] = {  # beside the usual values and the defaults
        "Scene": {"table": {"scene": "chain"}, "folder": folder},
        "Affine": {"M": np.eye(2), "D": None, "K": [(1.0, np.eye(2)), ("mu", [[0.0, 1.0], [0.0, 0.0]])]},
        "FrictionContact": {"stiffness": 1.0, "mu": 0.4, "direction": (1.0, 0.0, 0.0), "first": "top", "second": "ground",
            "meshes": mesh},
        "LinearContact": {"ports": ("belt",), "stiffness": [[1.0]]}, "Averaged": {}, "Kinematic": {},
        "Rigid": {"end": ("a", [3]), "tol": None, "name": ""},
        "Spring": {"first": ("a", [3]), "second": ("b", [0]), "stiffness": 1.0, "damping": 0.1},
        "Tied": {"first": ("a", "right"), "second": ("b", "left"), "meshes": {"a": mesh, "b": mesh}},
        "system_estimate": {"full": pair, "rom": fs.reduce(pair, {"b": fs.CraigBampton(1)}), "band": (0.0, 1.0)},
        "couple": {"parts": parts, "joints": [fs.Rigid(("a", [3]), ("b", [0]))], "name": "pair", "interface": [("a", [3])]},
        "cut": {"model": flat, "sets": None}, "Belt": {"speed": 0.2, "law": fs.StribeckArctan()},
        **{name: {"modes": 3} for name in ("CraigBampton", "DualCraigBampton", "Herting", "Hurty", "InterfaceModes", "MacNeal",
                                           "Rubin")},
        "CraigBampton(tol)": {"modes": None, "band": (0.0, 1.0), "tol": 0.01, "cutoff": None},
        "CraigBampton(cutoff)": {"modes": None, "cutoff": 1.0}, "CraigChang": {"band": (0.0, 1.0), "tol": 0.01},
        "DofMap": {"nodes": [1, 1], "components": [0, 1], "labels": ("ux", "uy")},
        "ContactModes": {"modes": 3, "contacts": sliding}, "Guyan": {"modes": 0}, "Material": {"loss": 0.1},
        "ParameterBox": {"ranges": {"slope": (-0.1, 0.0)}, "band": (0.0, 0.5), "tol": 1e-3, "cells": 2},
        "Mesh": {"points": mesh.points, "cells": mesh.cells, "kind": mesh.kind, "sets": {"a": [0, 1]}, "groups": {"g": [0]},
            "name": "m"},
        "Pencil": {"D": sub.D}, "State": {"displacement": np.zeros(6), "velocity": np.zeros(6)}, "StribeckArctan": {},
        "StribeckArctanOdd": {},
        "Substructure": {"D": sub.D, "interface": [0], "ports": {"belt": np.eye(6)[1]}, "name": "s", "sets": {"left": [0]}},
        "annulus": {"inner": 1.0, "outer": 2.0, "counts": (1, 8, 1), "name": "a", "sector": (0.0, 1.0)},
        "beam": {"length": 1.0, "elements": 4, "I": 1.0, "A": 1.0, "supports": {0: "clamped"}, "interface": ("right",),
            "ports": {"belt": 0.5}, "rayleigh": (0.0, 0.1), "name": "b"},
        "facing": {"first": ("a", "top"), "second": ("b", "bottom"), "meshes": {"a": mesh, "b": above}, "name": "f"},
        "node": {"point": (0.0, 0.0, 1.0), "mass": 1.0, "inertia": 0.1, "ports": {"load": "uz"}, "name": "n"},
        "space_beam": {"points": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "elements": 4, "G": 1.0, "A": 1.0, "I": 1.0, "J": 1.0,
            "supports": {"left": "clamped"}, "interface": ("right",), "ports": {"belt": ("right", "uz")}, "rayleigh": (0.0, 0.1),
            "name": "b"},
        "block": {"lengths": (1.0, 1.0, 1.0), "counts": (1, 1, 1), "name": "b"},
        "branch": {"model": rom, "points": 3, "harmonics": 40, "tol": 0.01, "stability": False},
        "chain": {"n": 5, "belt": 2, "name": "c"}, "chain_frequencies": {"n": 5, "count": 3},
        "complex_modes": {"contacts": slope, "count": 4},
        "complex_modes(band)": {"model": rom, "contacts": slope, "band": (0.0, 0.5), "re": (-1.0, 1.0)},
        "critical_slope": {"band": (0.0, 3.0)},
        "critical_value": {"contacts": slope, "between": (-0.1, 0.0), "band": (0.0, 3.0)},
        "cut_to_files": {"folder": folder / "cut", "mesh": row, "build": fs.solid, "supports": ["left"], "interface": ["right"],
            "ports": {"belt": ("right", "y")}},
        "damped": {"rayleigh": (0.1, 0.1), "dashpots": {0: 0.1}, "structural": 0.1},
        "equivalent_viscous": {"model": fs.damped(sub, structural=0.1), "omega": 0.5}, "damped(modal)": {"modal": 0.01},
        "damped(ratios)": {"ratios": ((0.5, 0.01), (1.0, 0.01))},
        "displacements": {"dofs": brick.dofs, "u": np.zeros(brick.size)},
        "audit": {"reduced": fs.reduce(sub, fs.CraigBampton(3), ports=True), "full": sub, "mass": 1.0, "cutoff": 1.0,
            "floating": True, "gyroscopic": True, "units": "SI"},
        "FrequencyResponse": {"at": [1.0], "receptance": [[[1.0]]], "responses": ["a"], "loads": ["a"], "level": 0.1},
        "couple_responses": {"parts": {"a": tip, "b": tip}, "joints": [(("a", "belt"), ("b", "belt"))]},
        "frequency_response": {"contacts": slope, "at": [0.1, 0.2], "loads": ["belt"], "responses": 0, "tol": 1e-06},
        "ModeSet": {"eigenvalues": [1j], "shapes": np.ones((2, 1)), "dofs": fs.DofMap([1, 2], [0, 0])},
        "read_modes": {"path": folder / "modes.uff"},
        "read_response": {"path": folder / "hammer.uff", "level": 0.1, "quantity": "acceleration", "over": "force"},
        "virtual_point": {"response": sensed, "point": (0, 0, 0), "sensors": places},
        "frequency_bounds": {"model": fs.reduce(sub, fs.CraigBampton(3), ports=True), "count": 1},
        "growth_rate": {"between": (0.0, 10.0)}, "harmonic_balance": {"model": rom, "harmonics": 40, "tol": 0.001},
        "mode_names": {"modes": fs.normal_modes(sub, count=3), "full": None},
        "mode_cards": {"contacts": slope, "modes": fs.complex_modes(sub, slope), "which": None, "full": None, "most": 3},
        "effective_masses": {"modes": fs.normal_modes(sub, count=3), "directions": {"x": np.ones(6)}},
        "normal_modes": {"count": 3}, "normal_modes(band)": {"band": (0.0, 1.0)},
        "plate": {"mesh": flat, "supports": {"left": "clamped"}, "interface": ("right",), "ports": {"belt": "right"},
            "rayleigh": (0.0, 0.1), "name": "p"},
        "read_component": {"M": folder / "model"}, "read_matrix": {"path": folder / "model" / "M.mtx"},
        "read_mesh": {"path": folder / "mesh.vtu"}, "rectangle": {"lengths": (1.0, 1.0), "counts": (1, 1), "name": "r"},
        "reduce": {},
        "reduce(parts)": {"sub": pair, "method": dict.fromkeys(parts, fs.CraigBampton(2)), "ports": False, "workers": None,
            "executor": None},
        "reduce_by_levels": {"parts": recipes, "folder": folder / "levels", "workers": 1},
        "refine": {"modes": modes, "rom": rom, "contacts": slope}, "rms": {},
        "rotating": {"part": fs.solid(ring, steel), "mesh": ring},
        "self_excitation": {"reduced": rom, "contacts": belt, "band": (0.0, 2.0)},
        "shoot": {"model": rom, "start": cycle, "tol": 1e-06, "rounds": 3},
        "AddedMass": {"at": [1], "amount": 0.1}, "AddedSpring": {"at": [1], "amount": 0.1, "to": [3]},
        "AddedDamper": {"at": "belt", "amount": 0.1}, "JointChange": {"joint": fs.Spring(("chain", "belt"), stiffness=1.0)},
        "MaterialChange": {"parameter": "E", "amount": 0.1, "cells": [0], "part": "", "rayleigh": (0.0, 0.1)},
        "modified": {"changes": [fs.AddedMass([1], 0.1)]},
        "sensitivities": {"contacts": slope, "modes": fs.complex_modes(sub, slope), "parameters": ["slope"], "of": [0]},
        "what_helps": {"contacts": slope, "candidates": [fs.AddedDamper([1], 0.1)], "band": (0.0, 1.0)},
        "solid": {"name": "x", "supports": ["left"], "interface": ["right"], "ports": {"belt": ("right", "y")},
            "rayleigh": (0.0, 0.1)},
        "spectrogram": {"length": 5.0, "windows": 20}, "spectrum": {}, "sticking": {"run": run},
        "study": {"methods": [fs.CraigBampton(2)], "band": (0.0, 0.5), "contacts": slope, "parameter": "slope",
            "values": [-0.1], "repeats": 1, "assembly": 0.0, "held": True},
        "scatter": {"model": sub, "inputs": {"slope": norm(-0.05, 0.01)}, "contacts": slope, "band": (0.0, 3.0), "samples": 16,
            "covariance": [[1.0]], "seed": 1, "confidence": 0.9, "importance": False},
        "family_of": {"model": sub, "contacts": slope, "parameters": ["slope", "tuned"],
                      "ranges": {"slope": (-0.3, 0.0), "tuned": (0.0, 1.0)}, "changes": {"tuned": fs.AddedMass([2])}},
        "stability_map": {"model": fs.Affine(sub.M, sub.D, [(1.0, sub.K), ("a", np.eye(6, k=1)), ("b", -np.eye(6))]),
            "over": {"a": (0.0, 1.0), "b": (0.0, 0.5)}, "points": (3, 3), "halvings": 1, "spots": 1,
            "full": fs.Affine(sub.M, sub.D, [(1.0, sub.K), ("a", np.eye(6, k=1)), ("b", -np.eye(6))])},
        "sweep": {"contacts": slope, "band": (0.0, 3.0)}, "track": {"contacts": slope, "band": (0.0, 1.0)},
        "transient": {"model": rom, "contacts": belt, "time": (0.0, 5.0)},
        "transient(alpha)": {"contacts": belt, "time": (0.0, 5.0), "step": 0.1, "tol": None, "method": "alpha"},
        "write_matrices": {"folder": folder / "new", "model": rom},
        "write_superelement": {"folder": folder / "super", "program": "dmig"},
        "write_mesh": {"path": folder / "again.vtu", "shapes": {"a": np.zeros((len(mesh.points), 3))}},
    }
    special: dict[str, Callable[..., Any]] = {
        **{name: change(getattr(fs, name)) for name in ("AddedMass", "AddedSpring", "AddedDamper", "JointChange")},
        "MaterialChange": fs.MaterialChange.solid,
        "FrictionContact": rubbing, "Rigid": rigid, "Spring": coupled, "cut": cut, "cut_to_files": pieces,
        "FrequencyResponse": fs.FrequencyResponse.measured}
    table: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {}
    for name, given in own.items():
        plain = name.partition("(")[0]
        function = special.get(plain) or getattr(fs, plain)
        table[name] = function, {
            key: given[key] if key in given else usual[key] if one.default is one.empty else one.default
            for key, one in inspect.signature(function).parameters.items()
            if plain == name or key in given or one.default is one.empty}  # those in brackets have these alone
    return table


class Odd:
    """An object that has a length, and nothing else that could be asked for."""

    def __len__(self) -> int:
        return 3

    def __repr__(self) -> str:
        return "two\nlines \x1b[31m"


def odd_values(kind: str, right: Any) -> list[Any]:
    """The odd values of a kind, beside NONSENSE; those that are dressed are made of the valid value."""
    if kind == "numbers":
        return [10**400, -(10**400), -np.inf, np.True_, np.float64("nan"), np.int64(-3), 2**63, 5e-324, np.complex128(1 + 1j),
                np.datetime64("2026-01-01"), np.ma.masked]
    if kind == "arrays":
        return [np.array(1.0), np.array("x"), np.array(None), np.zeros(0), np.zeros((0, 3)), np.zeros((2, 2, 2)), np.eye(3)[:2],
                np.array([1, 2], dtype=object), np.array([10**400]), np.array(10**400), np.eye(3) * 1j, np.full(3, np.nan),
                np.array([True, False]), np.zeros(3, dtype=[("a", float)]), np.matrix([[1.0, 2.0]]),
                np.ma.masked_array([1.0, 2.0, 3.0], mask=[0, 1, 0]), np.ma.masked_array(np.eye(6), mask=np.eye(6)),
                [np.ma.masked_array([1.0], mask=[1])], np.arange(3, dtype="m8[s]")]
    if kind == "sparse":
        return [sp.bsr_array(np.eye(4), blocksize=(2, 2)), [sp.bsr_array(np.eye(2))], [sp.csr_array(np.eye(2)), sp.eye_array(3)],
                sp.coo_array((3, 2)), sp.csr_array((0, 0)), sp.eye_array(3) * 1j, sp.csr_array(np.full((2, 2), np.nan)),
                sp.dok_array((2, 2)), sp.lil_array((3, 3)), sp.csr_matrix(np.eye(2)), {"a": sp.eye_array(2)},
                sp.coo_array(np.ones(3))]
    if kind == "containers":
        return [(), set(), [[]], {None: 1}, iter([1.0]), range(3), (1, 2, 3), [object()], Odd(), {"a": {"b": []}}, [10**400],
                (10**400, 1), {"x": 10**400}, [1j], [True], [[[1.0]]], frozenset({"a"}), {(1, 2): 3}, (x for x in "ab"),
                Ellipsis, NotImplemented]
    if kind == "texts":
        return ["\0", "a\nb", "\x1b[31m", "x" * 100_000, bytearray(b"x"), "=1+1", "../x", "ü", "\ud800", "None",
                "nan", "1.0", Path("x"), np.str_("x"), "x\u202e"]
    found: list[Any] = [[right], (right, right), {"a": right}, {"a": [right]}]
    try:
        numeric = isinstance(right, (np.ndarray, list, tuple)) and len(right) > 0 and np.asarray(right).dtype.kind in "iuf"
    except ValueError:  # rows of several lengths
        numeric = False
    if numeric:
        found += [np.ma.masked_array(right, mask=np.arange(np.size(right)).reshape(np.shape(right)) == 0),
                  np.asarray(right)[None], np.asarray(right, dtype=complex)]
    if sp.issparse(right):
        found += [right.tobsr(), right.todok(), [right.tobsr()], right * 1j, right[:-1], sp.csr_matrix(right),
                  np.ma.masked_array(right.toarray(), mask=right.toarray() == 0)]
    if isinstance(right, (int, float)):
        found += [np.array(right), np.array([right]), np.ma.masked_array(right, mask=True), str(right), np.float32(right),
                  complex(right)]
    return found


def masks(value: Any) -> bool:
    """Whether something is masked."""
    return isinstance(value, (list, np.ma.MaskedArray)) and any(
        np.ma.is_masked(one) for one in (value if isinstance(value, list) else [value]))


class Lateness(BaseException):
    """Not an Exception, which the code under test may catch."""


def _late(_signal: int, _frame: FrameType | None) -> None:
    raise Lateness


@pytest.fixture(scope="module")
def working(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    return calls(tmp_path_factory.mktemp("front-door"))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Files that nonsense names are written to a folder that goes."""
    monkeypatch.chdir(tmp_path)
    before = signal.signal(signal.SIGALRM, _late)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


NAMES = sorted(
    {
        name
        for name in fs.__all__
        if callable(getattr(fs, name))
        and not (isinstance(getattr(fs, name), type) and issubclass(getattr(fs, name), BaseException))
    }
    - RESULTS
    | {"CraigBampton(cutoff)", "CraigBampton(tol)", "complex_modes(band)", "damped(modal)", "damped(ratios)",
       "normal_modes(band)", "reduce(parts)", "transient(alpha)"}
)


THIRDS = [0, *(pytest.param(rest, marks=pytest.mark.rare) for rest in (1, 2))]


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name == "study" else name for name in NAMES])
@pytest.mark.parametrize("third", THIRDS)
def test_nonsense_is_answered_or_refused(
        name: str, third: int, working: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> None:
    """Each word at a third of the arguments, and each argument with a third of the words."""
    function, right = working[name]
    assert set(right) <= set(inspect.signature(function).parameters)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        function(**right)  # or the table above is stale
        faults = [
            f"{argument}={word}: {fault}"
            for at, argument in enumerate(right)
            for word, value in list(NONSENSE.items())[(third - at) % 3::3]
            if not (argument == "progress" and callable(value))  # what a caller's own function raises is the caller's
            and (fault := _fault(function, right | {argument: value}))
        ]
    assert not faults, "\n".join([f"{len(faults)} faults", *faults])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the matrix subclass")
@pytest.mark.parametrize("third", THIRDS)
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.rare) if at % 3 else name
                                  for at, name in enumerate(name for name in NAMES if name != "study")])
def test_odd_values_are_answered_or_refused(
        name: str, third: int, tmp_path: Path, working: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> None:
    """Each value of each kind at a third of the arguments, and each argument a third of the values."""
    function, right = working[name]
    writes = name.startswith("write") or name in ("cut_to_files", "reduce_by_levels")
    faults = []
    for at, argument in enumerate(argument for argument in right if argument not in ("progress", "build")):
        values = [value for kind in KINDS for value in odd_values(kind, right[argument])]
        for place, value in list(enumerate(values))[(third - at) % 3::3]:
            fresh = {key: tmp_path / argument / str(place) / Path(right[key]).name for key in {"folder", "path"} & right.keys()}
            for path in fresh.values():
                path.parent.mkdir(parents=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                fault = _fault(function, right | (fresh if writes else {}) | {argument: value},
                               masks(value) and argument not in LATER)
            faults += [f"{argument}={shown(value)}: {fault}"] * bool(fault)
    assert not faults, "\n".join([f"{len(faults)} faults", *faults])


def _fault(function: Callable[..., Any], arguments: dict[str, Any], masked: bool = False) -> str:
    """What is wrong with the outcome of a call, nothing if it is an answer, which `masked` values may not have, or a refusal."""
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        function(**arguments)
    except fs.FemsubError as error:
        text = str(error)
        if not text or len(text) > 5000 or not text.replace("\n", "").isprintable():
            return f"an error of {len(text)} characters, of which a terminal may obey some"
    except Lateness:
        return f"not done in {LIMIT:g} s"
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {error!s:.90} ({Path(at.filename).name}:{at.lineno})"
    else:
        return "the mask was lost" if masked else ""
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return ""


def test_every_argument_is_in_the_table(working: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> None:
    for name in (name for name in NAMES if "(" not in name):
        function = working[name][0]
        covered = {argument for key, (_, right) in working.items() if key.split("(")[0] == name for argument in right}
        assert covered == set(inspect.signature(function).parameters), name


@pytest.mark.parametrize(("kind", "value"), [
    ("mask", np.ma.masked_array(np.eye(2), mask=np.eye(2))), ("10**400", [[10**400, 0], [0, 1]]),
    ("bsr", [sp.bsr_array(np.eye(2))]),
    ("0-d", np.array(1.0)), ("objects", np.array(None))])
def test_odd_matrices_are_refused_by_name(kind: str, value: Any) -> None:
    """A mask was lost; the others were errors of Python's own."""
    for name in "MK":
        with pytest.raises(fs.FemsubError, match=f"^{name} "):
            fs.Pencil(**{"M": np.eye(2), "D": None, "K": np.eye(2)} | {name: value})
    for name, call in (("band", lambda: fs.normal_modes(fs.chain(3), band=value)), ("name", lambda: fs.Substructure(
            np.eye(2), np.eye(2), name=value)), ("n", lambda: fs.chain(value)), ("n", lambda: fs.chain(10**400))):
        with pytest.raises(fs.FemsubError, match=name):
            call()
