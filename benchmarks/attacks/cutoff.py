"""Every analysis of reduced models in all forms, in bands below, at and above their cut-off.

The reference is the cut-off by LAPACK: the lowest frequency of the modes that a basis leaves out. Two modes of the full model,
which may lie above the cut-off, flutter under friction. An answer for a band above the cut-off must have no evidence, and a band
below it must not be refused. An answer without a band must state where it ends, and contain no loss beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, row_of_springs

KINDS = ("complex modes", "critical value", "sweep", "track", "slope", "normal modes", "study")
FORMS = ("model", "system", "twice", "affine", "affine by cut-off", "affine twice", "fixed", "basis alone")
SAFE = 1e-6  # relative distance of a band's end from the cut-off
TOP = 1e4  # end of a band far above all frequencies


@dataclass(frozen=True)
class Case:
    """A reduced model in some form, its contacts, and its cut-off by LAPACK; NaN where only a basis was given."""

    model: Any
    contacts: Any
    cutoff: float
    highest: float  # highest frequency of the full model

    @property
    def pencil(self) -> fs.Pencil:
        return self.model.at(mu=0.3) if isinstance(self.model, fs.Affine) else self.model.linearised(self.contacts)


@attack("cutoff", KINDS)
def attacked(kind: str, random: Random) -> str:
    """The evidence, 'refused' for a band above the cut-off, or what is wrong."""
    substructures = kind in ("slope", "normal modes", "study")
    form = str(random.choice(FORMS[:2] if kind == "study" else FORMS[:3] if substructures else FORMS))
    case = _case(random, form, form == "twice" or kind == "study")
    where = str(random.choice(["below", "at", "just above", "above", "beyond", "none"]))
    if kind in ("normal modes", "study") and where == "none":
        where = "at"
    limit = case.highest * 0.2 if np.isnan(case.cutoff) else case.cutoff
    hi = {"below": limit * random.uniform(0.2, 1.0), "at": limit, "above": limit * random.uniform(1.05, 3.0),
          "just above": limit * (1 + SAFE * 10.0 ** random.uniform(0, 4)), "beyond": TOP * case.highest, "none": 0.0}[where]
    lo = hi * random.choice([0.0, random.uniform(0.0, 0.9)])
    band = None if where == "none" else (float(lo), float(hi))
    told = f"{form}, {where} (cut-off {case.cutoff:.6g}, band {band})"
    try:
        found = _ask(kind, case, band, random)
    except fs.InputError as error:
        if "reaches above the cut-off" in str(error):
            return "refused" if where in ("just above", "above", "beyond") else f"wrong: {told}: {error}"
        return f"wrong: {told}: {error}"
    except (fs.UnstableModelError, fs.NotConvergedError) as error:
        return f"no answer: {told}: {type(error).__name__}"
    evidence = getattr(found, "evidence", "without evidence")
    if np.isnan(case.cutoff):
        known = evidence not in ("certified", "confirmed") and "not known" in repr(found)
        return "not checked, cut-off not known" if known else f"wrong: {told}: {found!r}"
    if where in ("just above", "above", "beyond"):
        return f"wrong: {told}: {found!r}"
    if where == "none" and np.isfinite(case.cutoff) and "up to the cut-off" not in repr(found):
        return f"wrong: {told}: does not say where it ends: {found!r}"
    ends = [one.omega for one in getattr(found, "losses", ())]
    if isinstance(found, fs.ComplexModes) and len(found.unstable):
        ends.append(found.frequencies[found.unstable].max())
    if max(ends, default=0.0) > case.cutoff * (1 + SAFE):
        return f"wrong: {told}: a verdict from above the cut-off: {found!r}"
    return str(evidence)


def _ask(kind: str, case: Case, band: tuple[float, float] | None, random: Random) -> Any:
    model, contacts = case.model, case.contacts
    asks: dict[str, Callable[[], Any]] = {
        "critical value": lambda: fs.critical_value(model, contacts, "mu", between=(0.0, 0.7), band=band),
        "sweep": lambda: fs.sweep(model, contacts, "mu", [0.1, 0.3], band=band),
        "track": lambda: fs.track(model, contacts, "mu", [0.1, 0.3], band=band),
        "slope": lambda: fs.critical_slope(model, next(iter(model.ports)), band=band),
        "normal modes": lambda: fs.normal_modes(model, band=band),
        "study": lambda: fs.study(model, [fs.ContactModes(2, contacts=contacts)], band or (0.0, 1.0), contacts=contacts,
                                  repeats=1)}
    if kind != "complex modes":
        return asks[kind]()
    if isinstance(model, fs.Substructure) and random.random() < 0.5:
        return fs.complex_modes(model, contacts, band=band)
    return fs.complex_modes(case.pencil, band=band)


@dataclass(frozen=True)
class Rubbing:
    """ΔK = μ (a bᵀ - b aᵀ) on the columns a, b of two ports."""

    mu: float = 0.0
    ports: tuple[str, ...] = ("a", "b")
    affine = ("mu",)

    def linearised(self, model: fs.Substructure) -> tuple[None, np.ndarray]:
        return None, self.mu * np.array([[0.0, 1.0], [-1.0, 0.0]])


def _case(random: Random, form: str, once: bool) -> Case:
    n = int(random.integers(14, 36))
    springs, masses = 10.0 ** random.uniform(-0.5, 0.5, n + 1), 10.0 ** random.uniform(-0.3, 0.3, n)
    scale = 10.0 ** random.uniform(-3, 6)
    K = scale * row_of_springs(springs)
    M = np.diag(masses)
    omega = np.sqrt(la.eigh(K, M, eigvals_only=True))
    D = random.choice([1e-5, 1e-3]) / omega[0] * K
    X = la.eigh(K, M)[1]
    i = int(random.integers(n - 1))  # a pair anywhere, most often above the cut-off
    F = M @ X[:, [i, i + 1]] * np.sqrt((omega[i + 1] ** 2 - omega[i] ** 2) * random.uniform(1.0, 3.0))
    kind = sp.csr_array if random.random() < 0.5 else np.asarray
    interface = sorted(int(dof) for dof in random.choice(n, int(random.integers(1, 4)), replace=False))
    ports = {"a": F[:, 0], "b": F[:, 1]}
    sub = fs.Substructure(kind(M), kind(K), kind(D), interface, ports, "part")
    count = int(random.integers(2, 7))
    free = random.random() < 0.3 and not once
    rom = fs.reduce(sub, (fs.CraigChang if free else fs.CraigBampton)(count))
    held = np.setdiff1d(np.arange(n), interface)
    cutoff = omega[count] if free else np.sqrt(la.eigh(K[np.ix_(held, held)], M[np.ix_(held, held)], eigvals_only=True))[count]
    contact = Rubbing()
    if form == "model":
        return Case(rom, contact, cutoff, omega[-1])
    if form == "system":
        spring = fs.Spring(("part", "a"), "ground", stiffness=1e-3 * scale / float(F[:, 0] @ F[:, 0]))
        return Case(fs.couple({"part": rom}, [spring]), Rubbing(ports=("part.a", "part.b")), cutoff, omega[-1])
    if form == "twice":
        again = np.sqrt(np.maximum(la.eigh(rom.K, rom.M, eigvals_only=True), 0.0))[2]
        whole = fs.reduce(rom, fs.ContactModes(2, contacts=contact))
        return Case(whole, contact, min(again, cutoff) if whole.size < rom.size else cutoff, omega[-1])
    family = fs.Affine(kind(M), kind(D), [(1.0, kind(K)), ("mu", kind(F @ np.array([[0.0, 1.0], [-1.0, 0.0]]) @ F.T))])
    if form == "fixed":
        other = fs.Affine(family.M, family.D, [*family.K, ("extra", kind(0.1 * K))]).reduced(rom).fixed(extra=0.2)
        return Case(other, None, cutoff, omega[-1])
    small = {"affine": lambda: family.reduced(rom), "affine by cut-off": lambda: family.reduced(rom.V, cutoff=rom.cutoff),
             "basis alone": lambda: family.reduced(rom.V), "affine twice": lambda: family.reduced(rom)}[form]()
    if form == "affine twice":
        return Case(small.reduced(np.eye(small.size)[:, :3], cutoff=(limit := float(cutoff * random.uniform(0.4, 2.0)))), None,
                    min(limit, cutoff), omega[-1])
    return Case(small, None, np.nan if form == "basis alone" else cutoff, omega[-1])
