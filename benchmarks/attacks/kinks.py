"""Contacts and laws with kinks and jumps over their parameter, declared affine or not, with knots or without.

The number of growing eigenvalues that follows from losses and regains is compared with LAPACK's count in the state
matrix: at values all over the range, and on both sides of each kink. The state matrix is made from the model's M, D, K and the
law itself. Dips without knots are wider than the distance of the samples of C_D and C_K, which is told as a limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, crossings, eigenvalues, positive
from femsub.checks import Array

KINDS = ("table", "table with knots", "two contacts", "stiffness", "declared", "declared falsely")
GRID = 300
CLEAR = 1e-9  # of the largest |λ|: Re λ that counts as growing or not
BESIDE = 1e-7  # of the range around a crossing


@dataclass(frozen=True)
class Steps:
    """μ' = `level`, and `falls` between the edges 2i and 2i + 1."""

    edges: tuple[float, ...]
    falls: tuple[float, ...]
    level: float = 0.0

    def value(self, v: Any) -> Any:
        dips = zip(self.edges[::2], self.edges[1::2], self.falls, strict=True)
        return 1.0 + self.level * np.asarray(v) + sum(fall * np.clip(np.asarray(v) - a, 0.0, b - a) for a, b, fall in dips)

    def slope(self, v: Any) -> Any:
        dips = zip(self.edges[::2], self.edges[1::2], self.falls, strict=True)
        return self.level + sum(fall * (np.heaviside(np.asarray(v) - a, 0.5) - np.heaviside(np.asarray(v) - b, 0.5))
                                for a, b, fall in dips)


class Knots(Steps):
    """The same with its knots."""

    @property
    def knots(self) -> tuple[float, ...]:
        return self.edges


@dataclass(frozen=True)
class Table:
    """C_D = c·1 or C_K = c·[[0, 1], [-1, 0]], with c = linear interpolation in a table over p."""

    p: float = 0.0
    at: tuple[float, ...] = (0.0, 1.0)
    c: tuple[float, ...] = (0.0, 0.0)
    circulatory: bool = False

    @property
    def ports(self) -> tuple[str, ...]:
        return ("a", "b") if self.circulatory else ("belt",)

    def linearised(self, model: fs.Substructure) -> tuple[Any, Any]:
        c = float(np.interp(self.p, self.at, self.c))
        return (None, c * np.array([[0.0, 1.0], [-1.0, 0.0]])) if self.circulatory else (c, None)


class Declared(Table):
    """The same, declared affine in p whether it is or not."""

    affine = ("p",)


@attack(KINDS, seed_first=True, silent=False)
def attacked(kind: str, rng: Random) -> str:
    """One random case: the evidence if it is right."""
    model = _model(rng)
    lo = float(rng.uniform(0.05, 0.5))
    hi = lo + float(10.0 ** rng.uniform(-0.5, 1.0))
    between, force = (lo, hi), float(10.0 ** rng.uniform(-1, 1))
    narrow = 10.0 ** rng.uniform(-8, -2) if kind == "table with knots" else 10.0 ** rng.uniform(-2.9, -0.5)
    places = np.sort(rng.uniform(lo, hi, 2 * int(rng.integers(1, 3))))
    places[1::2] = np.minimum(places[::2] + narrow * (hi - lo), np.append(places[2::2], hi) - 1e-3 * (places[1::2] - places[::2]))
    edges = tuple(places.tolist())
    depth = tuple((-(10.0 ** rng.uniform(-2.5, 0.5, len(edges) // 2))).tolist())
    law = (Knots if kind == "table with knots" or rng.random() < 0.3 else Steps)(edges, depth, float(rng.choice([0.0, 0.02])))
    if kind.startswith("table") or kind == "two contacts":
        if any(b - a < 1e-3 * (hi - lo) for a, b in zip(edges[::2], edges[1::2], strict=True)) and not isinstance(law, Knots):
            law = Knots(law.edges, law.falls, law.level)
        contacts: list[Any] = [fs.Belt(force=force, speed=lo, law=law)]
        if kind == "two contacts":
            other = Steps((float(rng.uniform(lo, hi)), hi + 1.0), (float(rng.uniform(-0.1, 0.1)),))
            contacts.append(fs.Belt("a", force=force, speed=lo, law=other))
            edges = (*edges, other.edges[0])
        name = "speed"
    else:
        name, at = "p", np.sort(np.concatenate([[lo, hi], rng.uniform(lo, hi, 3)]))
        c = rng.uniform(-1.0, 1.0, len(at)) * 10.0 ** rng.uniform(-2, 0)
        if kind == "declared":
            c = np.interp(at, [lo, hi], c[[0, -1]])
        contacts = [(Table if kind == "stiffness" else Declared)(lo, tuple(at.tolist()), tuple(c.tolist()),
                                                                 kind == "stiffness" or bool(rng.random() < 0.5))]
        edges = tuple(at[1:-1].tolist())
    try:
        found = fs.critical_value(model, contacts, name, between=between)
    except fs.InputError as error:
        return "refused" if kind == "declared falsely" and "declares that it is affine" in str(error) else \
            f"wrong: {error}"
    if kind == "declared falsely":
        return f"wrong: the kinks at {edges} contradict the declaration, but nothing is said"
    steps = narrow * np.array([-1.0, -0.5, -0.1, 0.1, 0.5, 1.0])
    p = np.concatenate([np.linspace(lo, hi, GRID), *(edge + np.append(steps, steps * 1e-3) * (hi - lo) for edge in edges)])
    difference = _difference(model, contacts, name, found, p[(p > lo) & (p < hi)])
    if difference and found.evidence != "not checked":
        return f"wrong: {found!r}; {difference}"
    return "told" if difference else found.evidence


def _model(rng: Random) -> fs.Substructure:
    n = int(rng.integers(2, 5))
    K, unit = positive(rng, n, 0.5), np.eye(n)
    D = 10.0 ** rng.uniform(-3, -1) * (0.2 * np.eye(n) + 0.1 * K)
    return fs.Substructure(np.eye(n), K, D, ports={"belt": rng.standard_normal(n), "a": unit[0], "b": unit[1]})


def _difference(model: fs.Substructure, contacts: list[Any], name: str, found: fs.CriticalValue, p: Array) -> str:
    """Where the number of growing eigenvalues is not what follows from the losses and regains; nothing if it is everywhere."""
    width = found.searched[1] - found.searched[0]
    places, change = crossings(found)
    edges = np.append(places, [edge for part in found.open for edge in part])
    for value in np.sort(p):
        if (len(edges) and np.abs(edges - value).min() <= BESIDE * width) or any(a <= value <= b for a, b in found.open):
            continue
        D, K = np.array(model.D), np.array(model.K)
        for contact in contacts:
            changed = replace(contact, **{name: float(value)})
            W = np.column_stack([model.port(port) for port in changed.ports])
            if isinstance(changed, fs.Belt):
                D = D + changed.force * float(changed.law.slope(value)) * W @ W.T  # type: ignore[union-attr]
            else:
                C = changed.linearised(model)
                D, K = (A if one is None else A + W @ (one * np.eye(W.shape[1]) if np.ndim(one) == 0 else one) @ W.T
                        for A, one in zip((D, K), C, strict=True))
        z = eigenvalues(model.M, D, K)
        if np.abs(z.real).min() <= CLEAR * np.abs(z).max():
            continue
        expected = found.growing + change[np.searchsorted(places, value)]
        if (counted := int((z.real > 0).sum())) != expected:
            return f"at {value:.9g} {counted} grow, not {expected}"
    return ""
