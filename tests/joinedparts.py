"""Joined parts with few and many interface DOF, held and floating: what reduction methods are compared on.

The parts are meant for free interfaces: each is held by its own supports, or floats, and meets its neighbours at few DOF
beside those that it has.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import grid_pairs, stiffness
from benchmarks.lattices import lattice


@dataclass(frozen=True)
class Joined:
    """Full parts and their joints."""

    parts: Mapping[str, fs.Substructure]
    joints: list[Any]

    def system(self, make: Callable[[fs.Substructure], fs.Substructure] = lambda part: part) -> fs.Substructure:
        """The system of the parts, each as `make` leaves it."""
        return fs.couple({name: make(part) for name, part in self.parts.items()}, self.joints)


def chains(pieces: int, fixed: bool = True, n: int = 33) -> Joined:
    """A chain of n masses in so many pieces, each with half of the mass that it shares."""
    masses, springs = np.linspace(1.0, 2.0, n), np.linspace(3.0, 1.0, n)
    ends = np.linspace(0, n - 1, pieces + 1).astype(int)
    parts: dict[str, fs.Substructure] = {}
    for i, (a, b) in enumerate(itertools.pairwise(ends)):
        own = masses[a:b + 1].copy()
        own[[0, -1]] *= 0.5 if i else 1.0, 0.5 if i < pieces - 1 else 1.0
        held = fixed and i == 0
        interface = [b - a + 1] if i == 0 else [1] if i == pieces - 1 else [1, b - a + 1]
        parts[f"p{i}"] = fs.chain(b - a + 1, masses=own, springs=springs[a:b + 1], interface=interface, fixed=held, damping=0.0)
    names = list(parts)
    return Joined(parts, [fs.Rigid((one, [parts[one].size - 1]), (other, [0])) for one, other in itertools.pairwise(names)])


def cross(arms: int, n: int = 6) -> Joined:
    """Chains of n masses and more, every other of them held, that meet in one mass."""
    parts = {f"a{i}": fs.chain(n + i, masses=np.linspace(1, 2, n + i), springs=1.0 + i, interface=[n + i], fixed=i % 2 == 0,
                               damping=0.0) for i in range(arms)}
    return Joined(parts, [fs.Rigid(*((name, [part.size - 1]) for name, part in parts.items()))])


def truss(pieces: int, bays: int = 6, height: int = 3, held: bool = False) -> Joined:
    """A plane truss of springs cut across; each cut has the two DOF of its `height` nodes."""
    parts = {}
    for i in range(pieces):
        bare = lattice(bays, height, held=held and i == 0, seed=i)
        left, right = np.arange(2 * height), np.arange(bare.size - 2 * height, bare.size)
        ends = {"left": left, "right": right}
        used = {key: ends[key] for key, needed in (("left", i > 0), ("right", i < pieces - 1)) if needed}
        parts[f"t{i}"] = fs.Substructure(bare.M, bare.K, interface=used, ports=bare.ports, name=f"t{i}")
    return Joined(parts, [fs.Rigid((one, "right"), (other, "left")) for one, other in itertools.pairwise(parts)])


def beams(count: int, elements: int = 12) -> Joined:
    """A clamped steel beam in so many pieces."""
    parts = {}
    for i in range(count):
        where = ["left", "right"][int(i == 0):1 + int(i < count - 1)]
        parts[f"b{i}"] = fs.beam(1.0 / count, elements, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, interface=where, ports={},
                                 supports={"left": "clamped"} if i == 0 else None)
    return Joined(parts, [fs.Rigid((one, "right"), (other, "left"), tol=np.inf)
                          for one, other in itertools.pairwise(parts)])


def membranes(n: int = 5) -> Joined:
    """Four square membranes of springs that meet along four edges and in one node; none is held."""
    parts = {}
    nodes = np.arange(n * n).reshape(n, n)
    edges = {"west": nodes[0], "east": nodes[-1], "south": nodes[:, 0], "north": nodes[:, -1]}
    pairs = grid_pairs(nodes)
    for i, j in itertools.product((0, 1), repeat=2):
        K = stiffness(n * n, pairs, np.full(len(pairs), 1 + 0.1 * i + 0.3 * j))
        used = {key: edges[key] for key in ("west" if i else "east", "south" if j else "north")}
        parts[f"m{i}{j}"] = fs.Substructure(sp.diags_array(np.linspace(1, 2, n * n)), sp.csr_array(K), interface=used,
                                            name=f"m{i}{j}")
    return Joined(parts, [fs.Rigid(("m00", "east"), ("m10", "west")), fs.Rigid(("m01", "east"), ("m11", "west")),
                          fs.Rigid(("m00", "north"), ("m01", "south")), fs.Rigid(("m10", "north"), ("m11", "south"))])


#: with parts that are held or float, two to eight of them, two to four meeting in one place
JOINED: dict[str, Callable[[], Joined]] = {
    "chain in 2": lambda: chains(2), "chain in 3": lambda: chains(3), "chain in 5": lambda: chains(5),
    "floating chain in 8": lambda: chains(8, fixed=False), "3 chains in a cross": lambda: cross(3),
    "4 chains in a cross": lambda: cross(4), "held truss in 2": lambda: truss(2, held=True),
    "floating truss in 3": lambda: truss(3), "beam in 2": lambda: beams(2), "beam in 4": lambda: beams(4),
    "4 membranes": membranes}

#: the same in sizes that leave reduction something to do
LARGER: dict[str, Callable[[], Joined]] = {
    "chain in 2": lambda: chains(2, n=121), "floating chain in 3": lambda: chains(3, fixed=False, n=121),
    "4 chains in a cross": lambda: cross(4, 40), "held truss in 2": lambda: truss(2, 14, held=True),
    "floating truss in 3": lambda: truss(3, 14), "beam in 2": lambda: beams(2, 30), "beam in 4": lambda: beams(4, 30),
    "4 membranes": lambda: membranes(9)}
