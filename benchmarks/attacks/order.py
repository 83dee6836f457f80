"""`Pencil(M, K, D)` in place of `Pencil(M, D, K)`: noticed where damping is light, and no word where the order is right.

'chain', 'lattice', 'beam', 'solid': models of femsub in their units, with proportional damping, dashpots, damping of
some of the springs, or mixtures, of ratios from 1e-4 to 0.3, in units of time from 1e-3 to
1e3. 'heavy' and 'heavy material': each DOF has a ratio from 1 to 1000, by dashpots to the ground, or as a multiple of K, which
an exchanged model cannot be told from in some units.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.common import Random, attack, heard
from benchmarks.lattices import lattice
from femsub.model import look_at_the_order

KINDS = ("chain", "lattice", "beam", "solid", "heavy", "heavy material")


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    """'told apart', 'not noticed' if an exchange is not, 'wrong' for a false alarm."""
    heavy = "heavy" in kind
    sub = _model(str(rng.choice(KINDS[:4])) if heavy else kind, rng)
    ratio = 10 ** (rng.uniform(0, 3) if heavy else rng.uniform(-4, -0.5))
    D = _damping(sub, ratio, rng, kind)
    time = 10 ** rng.uniform(-3, 3)  # its unit
    M, D, K = sub.M * time**2, D * time, sub.K
    right, exchanged = (heard(look_at_the_order, *([(1.0, part)] for part in parts))[2] for parts in ((M, D, K), (M, K, D)))
    if right:
        return "alarm" if kind == "heavy material" else f"wrong: {sub!r} of damping ratio {ratio:.2g}: {right[0]}"
    return "told apart" if heavy or exchanged else "not noticed"


def _model(kind: str, rng: Random) -> fs.Substructure:
    n = int(rng.integers(2, 12))
    if kind == "chain":
        return fs.chain(10 * n, damping=0.0)
    if kind == "lattice":
        return lattice(n, 3, held=True, seed=n)
    if kind == "beam":
        return fs.beam(10 ** rng.uniform(-2, 1), n, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"})
    return fs.solid(fs.block((1.0, 0.5, 0.3), (n, 2, 2), "hexahedron"), fs.Material(10 ** rng.uniform(6, 11), 0.3, 1e3),
                    supports={"left": "clamped"})


def _damping(sub: fs.Substructure, ratio: float, rng: Random, kind: str) -> sp.csr_array:
    local = np.sqrt(sub.K.diagonal() * sub.M.diagonal())
    omega = float(np.median(np.sqrt(sub.K.diagonal() / sub.M.diagonal())))
    at = kind == "heavy" or rng.random(sub.size) < 0.2
    dashpots = sp.csr_array(sp.diags_array(2 * ratio * local * at * rng.uniform(1, 2, sub.size)))
    own = rng.uniform(0.5, 1.5, sub.size)
    uneven = sp.diags_array(own) @ sub.K @ sp.diags_array(own)
    kinds = (dashpots, 2 * ratio / omega * sub.K, ratio * (omega * sub.M + sub.K / omega), 2 * ratio / omega * uneven,
             dashpots + ratio / omega * sub.K)
    which = {"heavy": 0, "heavy material": 1}.get(kind, int(rng.integers(len(kinds))))
    return sp.csr_array(kinds[which])
