"""Borders of reduced models with twin frequencies: two beams of nearly one frequency on a foot, against the full model.

The belt acts on the tip of one beam, or on the foot. Dashpots are on the foot, on the tip of the other beam, or nearly nowhere.
The band ends at 0.7 of the cut-off. A slope that is off by more than 3.5 % without a warning is wrong.
"""

from __future__ import annotations

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, heard

KINDS = ("twin beams", "free interface", "joined", "tolerance")
OFF = 0.035


@attack(KINDS, seed_first=True)
def attacked(kind: str, rng: Random) -> str:
    """One random case: 'right', 'told' if the slope is off, 'needless' if the warning was not necessary."""
    beams, foot, port = _parts(rng)
    modes, with_port = int(rng.integers(2, 9)), bool(rng.random() < 0.5)
    joints = [fs.Rigid((name, "left"), ("foot", "top")) for name in beams]
    if kind == "joined":
        full: fs.Substructure = fs.couple(beams | {"foot": foot}, joints)
        method = (fs.CraigBampton, fs.Rubin)[int(rng.integers(2))]
        small: fs.Substructure = fs.reduce(full, {name: method(modes) for name in beams}, ports=with_port)
        port = "one.tip" if port == "tip" else "foot.foot"
    else:
        parts = fs.couple(beams | {"foot": foot}, joints, interface=[("foot", "top")])
        full = fs.Substructure(parts.M, parts.K, parts.D, interface=parts.interface, name="twins",
                               ports={"tip": parts.port("one.tip"), "foot": parts.port("foot.foot")})
        if kind == "tolerance":
            top = float(fs.normal_modes(full, count=8).frequencies[int(rng.integers(2, 8))])
            asked = fs.CraigBampton(band=(0.0, top), tol=float(10.0 ** rng.uniform(-4, -1.5)))
            small = fs.reduce(full, asked, ports=with_port)
        else:
            free = (fs.CraigChang, fs.Rubin, fs.MacNeal)[int(rng.integers(3))]
            small = fs.reduce(full, (free if kind == "free interface" else fs.CraigBampton)(modes), ports=with_port)
    band = (0.0, 0.6999 * small.cutoff if np.isfinite(small.cutoff) else 1e3)
    try:
        exact = fs.critical_slope(full, port, band=band)
    except fs.FemsubError:
        return "no reference"
    found, refusal, told = heard(fs.critical_slope, small, port, band=band)
    if refusal:
        return "refused"
    same = found.value == exact.value or abs(found.value - exact.value) <= OFF * abs(exact.value)
    if same:
        near = abs(found.value - exact.value) > 0.5 * OFF * abs(exact.value) if np.isfinite(exact.value) else False
        return "right" if not told else "told within half the limit" if near else "needless"
    return "told" if told else f"wrong: {found!r}, full {exact!r}, {small!r}"


def _parts(rng: Random) -> tuple[dict[str, fs.Substructure], fs.Substructure, str]:
    """Two beams, a foot of a mass and an inertia on springs, and the port under the belt."""
    n, detuned = int(rng.integers(6, 11)), 1 + 10.0 ** rng.uniform(-6, -1.5)
    material, a, b = (10.0 ** rng.uniform(-6, -3), 10.0 ** rng.uniform(-8, -5)), rng.random(), rng.random()
    beams = {}
    for name, E in (("one", 1.0), ("two", detuned)):
        beam = fs.beam(1.0, n, E=E, I=1.0, rho=1.0, A=1.0, interface=["left"], ports={"tip": "right"}, rayleigh=material,
                       name=name)
        if name == "two" and a < 0.7:
            w = beam.port("tip").reshape(-1, 1)
            beam = beam.with_damping(beam.D.toarray() + 10.0 ** rng.uniform(-4, 0) * w @ w.T)
        beams[name] = beam
    M, K = np.diag([10.0 ** rng.uniform(-1, 1), 10.0 ** rng.uniform(-3, -1)]), np.diag(10.0 ** rng.uniform(0, 3, 2))
    D = material[0] * M + material[1] * K
    D[0, 0] += 10.0 ** rng.uniform(-3, 0.5) * (b < 0.5)
    foot = fs.Substructure(M, K, D, interface={"top": [0, 1]}, ports={"foot": [1.0, 0.0]}, name="foot")
    return beams, foot, "tip" if rng.random() < 0.7 else "foot"
