"""Extreme cases of finite elements: what a port on a set of nodes means, and digits of very fine beams."""

from __future__ import annotations

import re
import warnings
from fractions import Fraction
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.extreme.cases import STEEL, case
from benchmarks.extreme.reference import EPS, Array, Found, answered, mp


def edge_mean(kind: str, cells: int) -> Found:
    """Ports of a plate on sets of nodes are means of w: of w = x + 2y and of w = x² + 2xy + 3y² on the unit square, which
    the elements hold, along its rim, along x = 1, over all of it and at two nodes, in exact fractions.
    """
    mesh = fs.rectangle((1.0, 1.0), (cells, cells), kind)
    corners = [int(np.argmin(np.abs(mesh.points - end).sum(axis=1))) for end in (0.0, 1.0)]
    mesh = mesh.with_sets(all=np.arange(len(mesh.points)), two=corners)
    ports = ("edge", "right", "all", "two")
    sub = fs.plate(mesh, **STEEL, thickness=0.01, ports={name: name for name in ports})
    dofs: Any = sub.dofs
    x, y = dofs.points.T
    normal = _normals(sub) if kind == "triangle" else np.zeros((2, sub.size))
    # the second along x = 0, x = 1, y = 0 and y = 1, the rim's sides: 1, 1 + 1 + 1, 1/3, 1/3 + 1 + 3
    rim = (Fraction(1) + 3 + Fraction(1, 3) + Fraction(13, 3)) / 4
    means = {1: (Fraction(3, 2), Fraction(2), Fraction(3, 2), Fraction(3, 2)),
             2: (rim, Fraction(3), Fraction(11, 6), Fraction(3))}
    worst = 0.0
    for degree, gradient in ((1, (0 * x + 1, 0 * x + 2)), (2, (2 * x + 2 * y, 2 * x + 6 * y))):
        w = x + 2 * y if degree == 1 else x**2 + 2 * x * y + 3 * y**2
        values = {"w": w, "w,x": gradient[0], "w,y": gradient[1], "w,xy": np.full(len(x), 2.0 if degree == 2 else 0.0),
                  "w,n": normal[0] * gradient[0] + normal[1] * gradient[1]}
        u = np.choose(dofs.components, [values[label] for label in dofs.labels])
        for name, mean in zip(ports, means[degree], strict=True):
            worst = max(worst, abs(float(sub.port(name) @ u) / float(mean) - 1))
    weighed = np.unique(dofs.nodes[(sub.port("edge") != 0) & (dofs.components == 0)])
    lie = "" if np.isin(mesh.numbers[mesh.sets["edge"]], weighed).all() else "nodes of the rim have no weight"
    bound = 8 * EPS * len(x)
    return Found(f"means over {len(ports)} sets, {kind}", worst, bound, worst / bound, "8 n eps, sums of n terms", lie=lie)


def _normals(sub: fs.Substructure) -> Array:
    """n of each w,n of a grid of triangles, (2, n): by its place along x, y or a diagonal, with the sign for which w = x and
    w = y, without stiffness, have K u = 0.
    """
    dofs: Any = sub.dofs
    x, y = dofs.points.T
    slopes = np.array(dofs.labels)[dofs.components] == "w,n"
    K = sub.K.toarray()
    n = np.zeros((2, sub.size))
    for row, field in enumerate((x, y)):
        n[row, slopes] = np.linalg.lstsq(K[:, slopes], -K[:, ~slopes] @ field[~slopes], rcond=None)[0]
    places = np.array([[1, 0], [0, 1], [1, 1], [1, -1]]) / np.array([[1], [1], [np.sqrt(2)], [np.sqrt(2)]])
    both = np.vstack([places, -places])
    nearest = np.argmin(np.linalg.norm(n.T[:, None] - both, axis=2), axis=1)
    exact = both[nearest].T * slopes
    assert np.abs(exact - n)[:, slopes].max() < 1e-6
    return exact


def face_mean(kind: str) -> Found:
    """Ports of a solid on faces, edges, cells and single nodes: means of u = x² + yz over sets of a block 2 x 1 x 1."""
    mesh = fs.block((2.0, 1.0, 1.0), (2, 2, 2), kind)
    x, y, z = mesh.points.T
    mesh = mesh.with_sets(rim=(y == 0) & (z == 0), half=x <= 1, tips=[int(np.argmin(x + y + z)), int(np.argmax(x + y + z))])
    means = {"rim": Fraction(4, 3), "half": Fraction(7, 12), "tips": Fraction(5, 2), "right": Fraction(17, 4)}
    sub = fs.solid(mesh, fs.Material(**STEEL), ports={port: (port, "x") for port in means})
    u = np.zeros((len(x), 3))
    u[:, 0] = x**2 + y * z
    error = max(abs(float(sub.port(port) @ u.ravel()) / float(mean) - 1) for port, mean in means.items())
    bound = 8 * EPS * len(x)
    return Found(f"means over {len(means)} sets, {kind}", error, bound, error / bound, "8 n eps, sums of n terms")


def mixed_set(kind: str) -> Found:
    """A set of a cell and of a node far from it is neither: to be refused."""
    mesh = fs.rectangle((1.0, 1.0), (4, 4), kind).with_sets(mixed=[0, 1, 5, 6, 24])
    return answered(lambda: fs.plate(mesh, **STEEL, thickness=0.01, ports={"p": "mixed"}))


SPEED: dict[str, Any] = {"E": 210e9, "I": 1e-2**4 / 12, "rho": 7850.0, "A": 1e-4}


def _wave_number() -> float:
    """cosh β cos β = -1, the first."""
    return float(mp.findroot(lambda b: mp.cosh(b) * mp.cos(b) + 1, 1.875))


def beam_entries(elements: int, length: float = 0.7) -> Found:
    """The Rayleigh quotient of the cantilever's first mode by the entries of K and M as they are stored, in exact fractions."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.ConditionWarning)
        sub = fs.beam(length, elements, **SPEED, supports={"left": "clamped"})
    beta = _wave_number()
    z = beta * np.arange(1, elements + 1) / elements
    ratio = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))
    w = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
    slope = beta / length * (np.sinh(z) + np.sin(z) - ratio * (np.cosh(z) - np.cos(z)))
    x = [Fraction(value) for value in np.ravel(np.column_stack([w, slope])).tolist()]
    energy, mass = (sum((Fraction(v) * x[i] * x[j] for i, j, v in zip(*(part.tolist() for part in (A.row, A.col, A.data)),
                                                                      strict=True)), Fraction(0))
                    for A in (sub.K.tocoo(), sub.M.tocoo()))
    exact = (beta / length) ** 4 * SPEED["E"] * SPEED["I"] / (SPEED["rho"] * SPEED["A"])
    error = abs(float(energy / mass) / exact - 1)
    return Found(f"ω² of {elements} elements", error, 1e-6, error / 1e-6, "1e-6, from where on rounding is to be told")


def beam_frequency(elements: int, ends: str) -> Found:
    """The first frequency of a fine beam: within the figure of femsub's warning, or within 1e-6 without one."""
    supports = {"clamped": {"left": "clamped"}, "pinned": {"left": "pinned", "right": "pinned"}}[ends]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", fs.ConditionWarning)
        found = fs.normal_modes(fs.beam(1.0, elements, **SPEED, supports=supports), count=1)
    figures = [float(match[1]) for one in told if (match := re.search(r"may take (\S+) of", str(one.message)))]
    beta = _wave_number() if ends == "clamped" else np.pi
    exact = beta**2 * np.sqrt(SPEED["E"] * SPEED["I"] / (SPEED["rho"] * SPEED["A"]))
    error, bound = abs(float(found.frequencies[0]) / exact - 1), max(figures, default=1e-6)
    return Found(f"ω of {elements} elements, {'told' if figures else 'not told'}", error, bound, error / bound,
                 "the figure of the warning, 1e-6 without one", float(found.residual[0]))


for kind in ("quad", "triangle"):
    case("interface", f"port on sets of a plate, {kind}", edge_mean, kind, 8)
    case("interface", f"port on a mixed set, {kind}", mixed_set, kind, expect="belong to none of the cells")
for kind in ("hexahedron20", "tetra10"):
    case("interface", f"port on sets of a solid, {kind}", face_mean, kind)
for n in (1000, 3000):
    case("slender", f"entries of a beam of {n:,} elements", beam_entries, n)
for held_as in ("clamped", "pinned"):
    for n in (500, 1000, 2000, 3000):
        case("slender", f"ω of a {held_as} beam of {n:,} elements", beam_frequency, n, held_as)
