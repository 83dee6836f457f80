"""The extreme cases by name. Importing this file fills `CASES`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.extreme.cases import (
    CASES,
    STEEL,
    alternating,
    basis,
    bending,
    case,
    coupled_twins,
    held,
    in_units,
    lattice,
    modes,
    one,
    pieces,
    ring,
    soft_rigid,
)
from benchmarks.extreme.complex import cea, drift, on_an_edge, paired, proportional, slope, tiny_slope
from benchmarks.extreme.continua import beam_entries, beam_frequency, edge_mean, face_mean, mixed_set
from benchmarks.extreme.motion import Chain, floquet, proportional_to_its_blow, small_motion, sticking_unknown
from benchmarks.extreme.reduction import (
    above_cutoff,
    bare,
    issue,
    most,
    near_cutoff,
    nearly_complete,
    other_damping,
    relief,
    same_poles,
    study_at_border,
    tolerance,
    unsymmetric_files,
    without_artefact,
)
from benchmarks.extreme.reference import Found, answered, worst
from benchmarks.extreme.spectra import (
    component,
    copies,
    critical,
    critical_ones,
    damped,
    edge,
    in_other_units,
    listed,
    membrane,
    mixed,
    rubbing,
    sliding_pairs,
    stiffness_of_mass,
    tied,
)

__all__ = ["CASES"]

HCB, CC = fs.CraigBampton, fs.CraigChang
BELT = fs.Belt(slope=-0.2677)
TWIN = np.array([[1.0, 0.5], [-0.5, 2.0]])  # two modes whose frequencies have just met: defective


FLUTTER = np.array([[1000.0, 200, 0], [-600, 1010, 0], [0, 0, 1e13]])  # Re λ = +5.4


def every(run: Callable[..., Found], *arguments: object, asks: Sequence[dict[str, object]], **options: object) -> Found:
    """One case for several bands or counts."""
    return worst(run(*arguments, **options, **ask) for ask in asks)


def chain(n: int, **options: Any) -> Callable[[], fs.Substructure]:
    return lambda: fs.chain(n, **options)


LARGE = "chain of a million masses"


def thin(kind: str, thickness: float, count: int = 1) -> object:
    """A cantilever of steel, 1 long, as thick as wide."""
    return lambda: fs.solid(fs.block((1.0, thickness, thickness), (count, 1, 1), kind), fs.Material(2.1e11, 0.0, 7850.0),
                            supports={"left": "clamped"})


# stiffness and mass ratios within a part
group = "ratios"
case(group, "every other spring 1e12", modes, chain(12, springs=alternating(12, 1e12)), 12)
case(group, "every other spring 1e-12, 200 masses", modes, chain(200, springs=alternating(200, 1e-12)), 10, checked=4,
     expect="rounding in the entries of K")
case(group, "springs graded over 1e12, 200 masses", modes, chain(200, springs=10 ** np.linspace(0, 12, 200)), 10, checked=4)
case(group, "one spring of 1e12, 200 masses", modes, chain(200, springs=one(200, 100, 1e12)), 10, checked=6)
case(group, "one spring of 1e-12", modes, chain(12, springs=one(12, 6, 1e-12)), 12)
case(group, "mount of 1e-12", modes, chain(12, springs=one(12, 0, 1e-12)), 12)
case(group, "mount of 1e-12 under 200 masses", soft_rigid, 200, 1e-12)
case(group, "every other mass 1e12", modes, chain(12, masses=alternating(12, 1e12)), 12)
case(group, "one mass of 1e12, 60 of 200 modes", modes, chain(200, masses=one(200, 100, 1e12)), 60, checked=6)
case(group, "masses graded over 1e12, 200 masses", modes, chain(200, masses=10 ** np.linspace(0, 12, 200)), 60, checked=6)
case(group, "springs and masses graded over 1e12", modes,
     chain(12, springs=10 ** np.linspace(0, 12, 12), masses=10 ** np.linspace(0, -12, 12)), 12)
case(group, "soft and light end, 1e24 in ω²", modes,
     chain(12, springs=10 ** np.linspace(0, -12, 12), masses=10 ** np.linspace(0, 12, 12)), 12)
case(group, "HCB, every other spring 1e12", basis, chain(12, springs=alternating(12, 1e12), interface=(1, 12)), HCB(4))
case(group, "CC, every other spring 1e12", basis, chain(12, springs=alternating(12, 1e12), interface=(1, 12)), CC(4))
case(group, "HCB, every other mass 1e12", basis, chain(12, masses=alternating(12, 1e12), interface=(1, 12)), HCB(10), whole=True)
case(group, "CC, every other mass 1e12", basis, chain(12, masses=alternating(12, 1e12), interface=(1, 12)), CC(4))
case(group, "CEA, every other spring 1e12", cea, chain(6, springs=alternating(6, 1e12)), belt=BELT)
case(group, "CEA, every other mass 1e12", cea, chain(6, masses=alternating(6, 1e12)), belt=BELT)
case(group, "CEA, mount of 1e-12", cea, chain(6, springs=one(6, 0, 1e-12)))
case(group, "slope, every other mass 1e12", slope, chain(6, belt=2, masses=alternating(6, 1e12)))
case(group, "slope, every other spring 1e12", slope, chain(6, belt=2, springs=alternating(6, 1e12)))
case(group, "slope, mount of 1e-12", slope, chain(6, belt=2, springs=one(6, 0, 1e-12)))

case(group, "flutter beside 1e13, as a component", answered, lambda: fs.Substructure(np.eye(3), FLUTTER),
     expect="K is not symmetric")
case(group, "M unsymmetric beside 1e13", answered, lambda: fs.Substructure(FLUTTER + 1e3 * np.eye(3), np.eye(3)),
     expect="M is not symmetric")
case(group, "flutter beside 1e13, in files", unsymmetric_files, FLUTTER, expect="K is not symmetric")
case(group, "CEA, flutter beside 1e13", cea, lambda: fs.Pencil(np.eye(3), None, FLUTTER))

group = "units"
for label, mass, stiffness in (("mm, t, s", 1e-3, 1e-3), ("nm, ng, ns", 1e12, 1e-6), ("1e-30 and 1e30", 1e-30, 1e30),
                               ("1e30 and 1e-30", 1e30, 1e-30)):
    case(group, f"floating lattice, {label}", modes, lambda m=mass, k=stiffness: in_units(lattice(3, 4), m, k), 5, rigid=3)
case(group, "HCB in mm, t, s", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e-3, 1e-3), HCB(10), whole=True)
case(group, "CC in units of 1e30 and 1e-30", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e30, 1e-30), CC(10),
     whole=True)
for ratio in (1e12, 1e-12):
    case(group, f"CEA, ω times {ratio:g}", cea, lambda r=ratio: fs.Pencil(fs.chain(6).M / r, fs.chain(6).D, fs.chain(6).K * r))
    case(group, f"slope, ω times {ratio:g}", slope, lambda r=ratio: fs.Substructure(
        fs.chain(6).M / r, fs.chain(6).K * r, fs.chain(6).D, [0], fs.chain(6, belt=2).ports))

SCALED = ("by turns", "halves", "rising", "each")
case(group, "PEP, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(proportional(
     300, 0.01, 1e-3), p), **ask} for p in SCALED for ask in ({"count": 12}, {"band": (0.0, 0.1)})], closed=True)
case(group, "modes, DOF in units of 2^-17 to 2^17", every, listed, asks=[{"build": lambda p=p: component(in_other_units(
     proportional(300, 0.0, 0.0), p), fs.chain_frequencies(300))} for p in SCALED], count=12)
case(group, "CEA, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(
     proportional(60, 0.01, 1e-3), p)} for p in SCALED], closed=True)

group = "massless"
for n in (20, 300):
    case(group, f"every other mass 0, n = {n}", modes,
         lambda n=n: fs.Substructure(sp.diags_array(1.0 - np.arange(n) % 2), fs.chain(n).K), 5, checked=3)
case(group, "M of half rank, no zero on its diagonal", modes, lambda: fs.Substructure(
    sp.kron(sp.eye_array(10), np.ones((2, 2))), fs.chain(20).K), 10)
case(group, "more modes than masses", modes,
     lambda: fs.Substructure(sp.kron(sp.eye_array(10), np.ones((2, 2))), fs.chain(20).K), 11)
case(group, "HCB, massless interface", basis,
     lambda: fs.Substructure(np.diag(1.0 - np.arange(12) % 2), fs.chain(12).K, interface=[1]),
     HCB(3))
case(group, "CC, massless interface", basis,
     lambda: fs.Substructure(np.diag(1.0 - np.arange(12) % 2), fs.chain(12).K, interface=[1]),
     CC(3))
case(group, "CEA, a massless DOF without damping", cea, lambda: fs.Pencil(np.diag(one(6, 2, 0.0)), 0.1 * np.diag(one(6, 2, 0.0)),
     fs.chain(6).K), regular=False)
case(group, "CEA, a massless DOF on a dashpot", cea,
     lambda: fs.Pencil(np.diag(one(6, 2, 0.0)), np.diag(one(6, 2, 0.0) == 0) * 1e6,
     fs.chain(6).K), regular=False)
case(group, "slope, a massless DOF", slope, lambda: fs.Substructure(np.diag(one(6, 1, 0.0)), fs.chain(6).K, fs.chain(6).D, [0],
     fs.chain(6, belt=3).ports), expect="M is singular or nearly so")
case(group, "neither mass nor stiffness", modes,
     lambda: fs.Substructure(sp.diags_array(one(8, 7, 0.0)), held(fs.chain(8).K, 7)), 3,
     expect="1 DOF has neither mass nor stiffness: DOF 7")

for method, label in ((HCB, "HCB"), (CC, "CC")):
    case(group, f"{label}, all and nearly all modes, 2 of 5 bare", nearly_complete, issue, method)
    case(group, f"{label}, all and nearly all modes, every 2nd bare", nearly_complete, lambda: bare(12, 2), method)
    case(group, f"{label}, all and nearly all modes, floating", nearly_complete, lambda: bare(12, 2, held=False), method, 1)
    case(group, f"{label}, all and nearly all modes, N, t and s", nearly_complete, lambda: bare(11, 3, units=(1e-3, 1e8)), method)
    case(group, f"{label}, all and nearly all modes, consistent M", nearly_complete, lambda: bare(12, 3, consistent=True), method)
    case(group, f"CEA, {label} with all modes, 2 of 5 bare", same_poles, issue, method(most(issue(), method)))
    case(group, f"CEA, {label} with all modes, every 2nd bare", same_poles, lambda: bare(10, 2),
         method(most(bare(10, 2), method)))
    case(group, f"slope, {label} with all modes, 2 of 5 bare", lambda m=method: slope(lambda: fs.reduce(
         issue(), m(most(issue(), m)), ports=True), port="p"), expect="M is singular or nearly so")
    for tol, hi in ((1e-3, 0.3), (1e-6, 0.6)):
        case(group, f"{label}, tolerance {tol:g}", tolerance, lambda: bare(40, 3), method(band=(0.0, hi), tol=tol))
        case(group, f"{label}, tolerance {tol:g}, floating", tolerance, lambda: bare(40, 3, held=False),
             method(band=(0.0, hi), tol=tol), 1)
for label, parts in (("statics", [(1, 0, 4), (2, 0, 3), (0, 0, 1), (0, 0, 5), (1, 0, 9), (0, 0, 2)]),
                     ("dashpots", [(1, 0.5, 4), (0, 3, 1), (2, 0.25, 3), (0, 0, 1), (0, 0.5, 2), (1, 0.125, 16)]),
                     ("one mass", [(1, 0.5, 1), (0, 2, 1), (0, 1, 8), (0, 0, 1), (0, 0, 3)]),
                     ("unstable", [(1, -0.5, 4), (0, 0, 2), (1, 0.25, 9), (0, 1, 3), (0, 0, 7)])):
    case(group, f"CEA, singular M in mixed DOF, {label}", every, cea, asks=[
         {"build": lambda parts=parts, seed=seed: mixed(parts, seed)} for seed in range(4)], closed=True)
case(group, "CEA, tied by a multiplier", every, cea, asks=[{"build": lambda f=f: tied(f)} for f in (0.0, 0.125)], closed=True)

group = "rigid"
for count in (1, 2, 5, 12):
    case(group, f"{count} floating chains", modes, lambda c=count: pieces(*[fs.chain(6, fixed=False)] * c), 4, rigid=count)
case(group, "4 floating lattices, 12 rigid modes", modes,
     lambda: pieces(*[lattice(3, 4, seed) for seed in range(4)]), 4, rigid=12,
     checked=3)
case(group, "mechanism with 12 free shears", modes, lambda: lattice(4, 8, diagonals=False), 3, rigid=12)
case(group, "a mass without springs", modes, lambda: fs.Substructure(sp.eye_array(8), held(fs.chain(8).K, 4)), 3, rigid=1)
case(group, "one piece held, one floating", modes, lambda: pieces(fs.chain(60, fixed=False), fs.chain(50)), 5, rigid=1)
case(group, "two floating pieces, 1e6 in stiffness", modes,
     lambda: pieces(fs.chain(60, fixed=False), fs.chain(50, fixed=False, springs=1e6)), 5, rigid=2)
case(group, "two floating pieces, 1e12 in stiffness", modes,
     lambda: pieces(fs.chain(60, fixed=False), fs.chain(50, fixed=False, springs=1e12)), 5, rigid=2)
case(group, "no stiffness at all", modes,
     lambda: fs.Substructure(np.eye(8), np.zeros((8, 8))), 0, expect="no DOF has both stiffness and mass")
case(group, "a negative spring", modes, lambda: fs.Substructure(np.eye(8), fs.chain(8).K.toarray() - 0.5 * np.eye(8)), 2,
     expect="negative eigenvalue")

for pieces_of, counts in ((1, (2, 4, 9)), (5, (6, 18, 19, 40))):
    case(group, f"CEA, {pieces_of} floating with friction, by count", every, cea, lambda p=pieces_of: rubbing(p), closed=True,
         asks=[{"count": count} for count in counts])
case(group, "PEP, floating, K unsymmetric, by count", every, cea, lambda: sliding_pairs(100), closed=True,
     asks=[{"count": count} for count in (6, 18, 19, 40)])

group = "interface"
case(group, "HCB, empty", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12).K), HCB(3))
case(group, "HCB, empty and floating", basis,
     lambda: fs.Substructure(fs.chain(12).M, fs.chain(12, fixed=False).K), HCB(3), rigid=1)
case(group, "HCB, all DOF", basis, chain(12, interface=range(1, 13)), HCB(0), whole=True)
case(group, "HCB, all DOF, and modes", basis, chain(12, interface=range(1, 13)), HCB(3), expect="every DOF is interface")
case(group, "HCB, not restraining", basis, lambda: fs.Substructure(lattice(3, 4).M, lattice(3, 4).K, interface=[0, 1]), HCB(3),
     expect="the interface does not hold")
case(group, "HCB, just restraining", basis, lambda: lattice(3, 4), HCB(3))
case(group, "HCB, on one of two pieces", basis, lambda: pieces(fs.chain(8), fs.chain(8, fixed=False), interface=(0,)), HCB(3),
     expect="the interface does not hold")
case(group, "CC, empty", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12).K), CC(3))
case(group, "CC, all DOF", basis, chain(12, interface=range(1, 13)), CC(3), whole=True)
case(group, "CC, not restraining", basis,
     lambda: fs.Substructure(lattice(3, 4).M, lattice(3, 4).K, interface=[0, 1]), CC(3), rigid=3)

case(group, "CC, inertia relief at 40 DOF", relief, 4)
for kind in ("quad", "triangle"):
    case(group, f"port on sets of a plate, {kind}", edge_mean, kind, 8)
    case(group, f"port on a mixed set, {kind}", mixed_set, kind, expect="belong to none of the cells")
case(group, "port on a support", answered, lambda: fs.plate(fs.rectangle((1.0, 1.0), (4, 4)), **STEEL, thickness=0.01,
     supports={"edge": "clamped"}, ports={"p": "left"}), expect="sits on DOF that the supports hold")
for kind in ("hexahedron20", "tetra10"):
    case(group, f"port on sets of a solid, {kind}", face_mean, kind)

group = "modes 0, 1, all"
case(group, "no modes", modes, chain(300), 0)
case(group, "no modes, floating", modes, chain(300, fixed=False), 0, rigid=1)
case(group, "all of 300", modes, chain(300), 300, frequencies=fs.chain_frequencies(300))
case(group, "a single mass", modes, chain(1), 1)
for method in (HCB, CC):
    name = "HCB" if method is HCB else "CC"
    case(group, f"{name}, no modes", basis, chain(12, interface=(1, 12)), method(0))
    case(group, f"{name}, one mode", basis, chain(12, interface=(1, 12)), method(1))
    case(group, f"{name}, all modes", basis, chain(12, interface=(1, 12)), method(10), whole=True)
    case(group, f"{name}, neither modes nor interface", basis, lambda: fs.Substructure(np.eye(3), fs.chain(3).K), method(0),
         expect="would be empty")

group = "repeated"
case(group, "ring of 24, all modes", modes, lambda: ring(24), 23, rigid=1)
case(group, "ring of 240, a pair cut", modes, lambda: ring(240), 8, rigid=1, checked=8)
case(group, "square plate", modes, lambda: fs.plate(fs.rectangle((1.0, 1.0), (3, 3)), **STEEL, thickness=0.01,
     supports=dict.fromkeys(("left", "right", "front", "back"), "simply supported")), 8, checked=6)
case(group, "annulus, floating", modes,
     lambda: fs.solid(fs.annulus(0.1, 0.2, 0.02, (1, 8, 1), "hexahedron"), fs.Material(**STEEL)), 8,
     rigid=6, checked=4, quick=False)
case(group, "twins coupled by 1e-8", modes, lambda: coupled_twins(60, 1e-8), 9, checked=6)
case(group, "twins coupled by 1e-14", modes, lambda: coupled_twins(60, 1e-14), 9, checked=6)
case(group, "300 equal modes", modes, lambda: fs.Substructure(sp.eye_array(300), sp.eye_array(300)), 5)
case(group, "CEA, equal damped twins", cea, lambda: fs.Pencil(np.eye(4), np.kron(np.eye(2), fs.chain(2).D.toarray()),
     np.kron(np.eye(2), fs.chain(2).K.toarray())))

for sparse, label in ((False, "dense"), (True, "sparse")):
    for n in ((12, 60), (300, 3100))[sparse]:
        case(group, f"K = 2 M, {n} DOF", listed, lambda n=n, s=sparse: stiffness_of_mass(n, 2.0, s), count=9)
        case(group, f"CEA, K = 2 M, {n} DOF", cea, lambda n=n, s=sparse: damped(stiffness_of_mass(n, 2.0, s), 0.02), closed=True,
             count=8, semisimple=True)
    size = 70 if sparse else 12
    case(group, f"counts that cut a sixfold one, {label}", every, listed, lambda n=size, s=sparse: copies(n, 6, s),
         asks=[{"count": count} for count in (2, 5, 8, 11, 17)])
    case(group, f"CEA, counts that cut a sixfold one, {label}", every, cea,
         lambda n=size, s=sparse: damped(copies(n, 6, s), 1e-3), asks=[{"count": count} for count in (2, 5, 8, 11, 17)],
         closed=True, semisimple=True)

group = "edges"
for sparse, label in ((False, "dense"), (True, "sparse")):
    for name, known in (("pairs", lambda s=sparse: membrane(16 if s else 7, s)),
                        ("sixfold", lambda s=sparse: copies(70 if s else 12, 6, s))):
        omega = np.sort(known()[1])
        levels = omega[np.diff(omega, prepend=-1.0) > 1e-9]
        ends = [(0.0, levels[2]), (levels[1], levels[2]), (levels[1], levels[4]), (levels[3], levels[5])]
        tilted = [tuple(edge(omega, 1e-3) if omega else 0.0 for omega in band) for band in ends]
        case(group, f"{name} on edges, {label}", every, listed, known, asks=[{"band": band} for band in ends])
        case(group, f"CEA, {name} on edges, {label}", every, cea, lambda known=known: damped(known(), 1e-3), closed=True,
             semisimple=True, asks=[{"band": band, **re} for band in tilted for re in ({}, {"re": (-5e-4, 0.1)})])
    case(group, f"CEA, double real λ on an edge, {label}", every, cea, lambda s=sparse: critical(0.0, s), closed=True, power=2,
         asks=[{"band": (0.0, 10.0), "re": (-3.0, 10.0)}, {"band": (0.0, 10.0), "re": (-100.0, -3.0)}])
for belt in (2, 5, 10):
    case(group, f"slope on an edge, chain 10, belt m{belt}", on_an_edge, chain(10, belt=belt), None, quick=belt == 2)
case(group, "slope on an edge, bracketed", on_an_edge, chain(10, belt=2), None, method="bracketing", quick=False)
for belt in (2, 7):
    case(group, f"slope on an edge, chain 400, belt m{belt}", on_an_edge, chain(400, belt=belt), (0.0, 0.025), sparse=True)

group = "border"
for label, six in (("HCB", HCB(6)), ("CC", CC(6))):
    case(group, f"slope, {label}, band above the cut-off", above_cutoff, six, "slope", expect="reaches above the cut-off")
    case(group, f"sweep, {label}, band above the cut-off", above_cutoff, six, "sweep", expect="reaches above the cut-off")
    case(group, f"CEA, {label}, band above the cut-off", above_cutoff, six, "modes", expect="reaches above the cut-off")
    case(group, f"CEA, {label}, all modes", above_cutoff, six, "all")
case(group, "slope, CC, shape above the cut-off", without_artefact)
case(group, "slope, CC, next to the cut-off", near_cutoff)
for way in ("auto", "bracketing"):
    case(group, f"drift first, {way}", drift, 10, 1e-4, 0.05, method=way)
    case(group, f"drift first, CC, {way}", drift, 10, 1e-4, 0.05, True, method=way)
case(group, "drift first, 3,000 masses", drift, 3000, 1e-6, 5.0, band=(0.0, 0.01))
case(group, "drift without damping, 400 masses", drift, 400, 0.0, 0.05, band=(0.0, 0.006))
case(group, "drift first, pairs above it", slope, lambda: fs.damped(fs.chain(10, belt=10, damping=0.0, fixed=False),
     rayleigh=(1e-4, 0.05)), band=(1e-3, 1.0))
for factor, label in ((0.5, "before"), (1.0, "at"), (1.5, "beyond")):
    case(group, f"study {label} the border, first pair", study_at_border, factor, 0.2, quick=factor == 1)
    case(group, f"study {label} the border, half of them", study_at_border, factor, 0.75, quick=factor > 0.5)

group = "motion"
for n, belt, blow in ((120, 5, 1e-3), (320, 20, 1e-3), (320, 20, 1e-9), (320, 20, 0.1)):
    case(group, f"alpha, {n} masses, blow of {blow:g}", small_motion, n, belt, blow, 60.0)
case(group, "alpha, 320 masses, few samples", small_motion, 320, 20, 1e-3, 60.0, 100, quick=False)
for integrator in ("alpha", "lsoda", "dop853", "radau"):
    case(group, f"{integrator}, tiny blows", proportional_to_its_blow, integrator, 1e-4, quick=integrator != "radau")
for cycle, harmonics in ((Chain(2, 2, 0.05, 0.2, 0.01, odd=True), 8), (Chain(3, 2, 0.1, 0.3, 0.01), 10),
                         (Chain(3, 3, 0.1, 0.2, 0.005), None), (Chain(4, 4, 0.2, 0.15, 0.01), 20),
                         (Chain(5, 2, 0.1, 0.3, 0.01, odd=True), 12)):
    case(group, f"Floquet, chain {cycle.n}, belt m{cycle.belt}, {harmonics or 'usual'} harmonics", floquet, cycle, harmonics)
case(group, "sticking without an ε", sticking_unknown)

group = "damping"
DENSE, A = fs.chain(6), np.random.default_rng(3).standard_normal((6, 6))
for label, D in (("undamped", None), ("overdamped", 10 * np.eye(6)), ("overdamped 1e6", 1e6 * np.eye(6)),
                 ("negatively damped", -0.1 * np.eye(6)), ("D not proportional", A @ A.T), ("D unsymmetric", A)):
    case(group, f"CEA, {label}", cea, lambda D=D: fs.Pencil(DENSE.M, D, DENSE.K))
case(group, "CEA, D and K unsymmetric", cea, lambda: fs.Pencil(DENSE.M, A, DENSE.K.toarray() + 0.5 * (A - A.T)))
case(group, "CEA, K negative", cea, lambda: fs.Pencil(np.eye(6), 0.1 * np.eye(6), -DENSE.K.toarray()))
case(group, "CEA, K = 0", cea, lambda: fs.Pencil(np.eye(3), np.diag([1.0, 2.0, 3.0]), np.zeros((3, 3))), regular=False)
for alpha, beta in ((0.0, 0.0), (0.01, 1e-3), (-0.01, 0.0), (10.0, 0.0), (1e-9, 0.0)):
    case(group, f"PEP, D = {alpha:g} M + {beta:g} K", cea, lambda a=alpha, b=beta: proportional(300, a, b), closed=True, count=12)
case(group, "PEP, undamped, band", cea, lambda: proportional(300, 0.0, 0.0), closed=True, band=(0.0, 0.1), quick=False)
case(group, "PEP, D = 1e4 K", cea, lambda: proportional(300, 0.0, 1e4), closed=True, count=12, quick=False)
case(group, "PEP, D = 1e4 K, 2,100 masses", cea, lambda: proportional(2100, 0.0, 1e4), closed=True, count=12,
     expect="of 16 complex modes converged", quick=False)
case(group, "CC, a tolerance and another damping", other_damping)
case(group, "PEP, gyroscopic", cea, lambda: paired(150, 1.0, 0.0), closed=True, count=12)
case(group, "PEP, circulatory", cea, lambda: paired(150, 0.0, 1e-3), closed=True, count=12)
case(group, "slope, undamped", slope, lambda: fs.chain(6, belt=3).with_damping(None), known=0.0)
case(group, "slope, damping of 1e-13", tiny_slope, chain(6, belt=2, damping=1e-13), 1e-12)
case(group, "slope, overdamped", slope, lambda: fs.chain(6, belt=3).with_damping(10 * np.eye(6)))
case(group, "slope, negatively damped", slope, lambda: fs.chain(6, belt=3).with_damping(-0.1 * np.eye(6)),
     expect="unstable before the belt acts")
case(group, "slope, dashpot of 1e4", slope, chain(6, belt=2, damping=1e4))
case(group, "slope, dashpot of 1e7", slope, chain(6, belt=2, damping=1e7), expect="rounding may move the border")
case(group, "slope, dashpot of 1e11", slope, chain(6, belt=2, damping=1e11), expect="lost in the rounding of a dashpot")
case(group, "slope, gyroscopic", slope, lambda: fs.chain(6, belt=3).with_damping(0.05 * np.eye(6) + 0.3 * (A - A.T)))

group = "defective"
case(group, "flutter, two modes just met", cea, lambda: fs.Pencil(np.eye(2), None, TWIN), power=2)
case(group, "flutter, 1e-8 beyond", cea, lambda: fs.Pencil(np.eye(2), None, TWIN + 1e-8 * np.array([[0, 1], [-1, 0]])), power=2)
case(group, "flutter, 1e-8 before", cea, lambda: fs.Pencil(np.eye(2), None, TWIN - 1e-8 * np.array([[0, 1], [-1, 0]])), power=2)
case(group, "critical damping", cea, lambda: fs.Pencil(np.eye(2), np.diag([2.0, 4.0]), np.diag([1.0, 4.0])), power=2)
for near in (0.0, 2.0**-30, 2.0**-44, -(2.0**-30)):
    for sparse, label in ((False, "dense"), (True, "sparse")):
        case(group, f"damping {near:.0e} off critical, {label}", every, cea, lambda r=near, s=sparse: critical(r, s), closed=True,
             power=2, asks=[{"band": (0.0, 10.3), "re": (-100.0, 100.0)}, {"count": 4}, {"count": 5}])
case(group, "critical damping, 25 models", every, cea, closed=True, power=2, asks=[
     {"build": lambda seed=seed: critical_ones(seed), **ask} for seed in range(25)
     for ask in ({"band": (0.0, 10.3), "re": (-100.0, 100.0)}, {"count": 1 + seed % 8})])
case(group, "triple eigenvalue", cea, lambda: fs.Pencil(np.eye(3), None, np.eye(3) + np.diag([1.0, 1.0], 1)), power=3)
case(group, "PEP, every mode of 150 a defective pair", cea, lambda: paired(150, 0.0, TWIN), closed=True, count=12, quick=False)

group = "slender"
BAR: dict[str, Any] = {"E": 2.1e11, "I": 1e-16 / 12, "rho": 7850.0, "A": 1e-8}
case(group, "beam of 1 : 1e-4, 100 elements", modes, lambda: fs.beam(1.0, 100, **BAR, supports={"left": "clamped"}), 6, checked=4)
case(group, "beam of 2,000 elements", modes, lambda: fs.beam(1.0, 2000, **BAR, supports={"left": "pinned", "right": "pinned"}), 6,
     checked=2, quick=False)
case(group, "beam of 6,000 elements", modes, lambda: fs.beam(1.0, 6000, **BAR, supports={"left": "clamped"}), 6, checked=1,
     expect="rounding may take", quick=False)
for n in (1000, 3000):
    case(group, f"entries of a beam of {n:,} elements", beam_entries, n)
for held_as in ("clamped", "pinned"):
    for n in (500, 1000, 2000, 3000):
        case(group, f"ω of a {held_as} beam of {n:,} elements", beam_frequency, n, held_as)
case(group, "plate cells of 1 : 1e4", modes, lambda: fs.plate(fs.rectangle((1.0, 1e-4), (2, 2)), **STEEL, thickness=1e-6,
     supports={"left": "clamped"}), 5, checked=4, expect="rounding may take")
case(group, "plate cells of 1 : 100", modes, lambda: fs.plate(fs.rectangle((1.0, 1e-2), (2, 2)), **STEEL, thickness=1e-4,
     supports={"left": "clamped"}), 5, checked=4)
case(group, "brick of 1 : 1e-3, 20 nodes", modes, thin("hexahedron20", 1e-3), 3, checked=2, quick=False)
case(group, "bricks of 1 : 1e-4, 20 nodes", modes, thin("hexahedron20", 1e-4, 8), 3, quick=False,
     expect="elements too thin or too small")
case(group, "locking: 8 elements of 20 nodes", bending, "hexahedron20", 1e-3)
case(group, "locking: 8 elements of 8 nodes, as foretold", bending, "hexahedron", 1e-3)

case("large", LARGE, modes, chain(1_000_000), 20, frequencies=fs.chain_frequencies(1_000_000, 20), quick=False)
