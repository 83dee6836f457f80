"""What each check of an audit measures: the figure that decides, and the words of its sentence, or a finding of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from femsub.checks import EPS, EQUAL, Array
from femsub.studies.audit_case import Case, Unknown
from femsub.studies.audit_model import (
    AGREE,
    AXES,
    HELD_KIND,
    ROUNDING,
    SHAPED,
    coupling,
    frequencies,
    listed,
    off_diagonal,
    scaled,
    units,
    within,
)

GOOD, FAULT, UNKNOWN = "good", "fault", "unknown"
#: unit of length in m, of mass in kg
SYSTEMS = {"SI": (1.0, 1.0), "mm-t-s": (1e-3, 1e3)}


@dataclass(frozen=True)
class Finding:
    """What one check of an audit has found.

    Attributes
    ----------
    what : str
        What was checked.
    verdict : str
        'good', 'fault' or 'unknown'.
    said : str
        What was found, in a sentence.
    figure, limit : float, optional
        The number that decides, and how large it may be.
    todo : str
        What to do about it.
    """

    what: str
    verdict: str
    said: str = ""
    figure: float | None = None
    limit: float | None = None
    todo: str = ""


@dataclass(frozen=True)
class Seen:
    """A figure that the limit of its check decides, and the words that fill the check's sentence and advice."""

    figure: float
    words: Mapping[str, Any]


#: what a check sees of a case: a figure, a finding that no limit decides (its name is put in), or nothing where it does not apply
Sight: TypeAlias = "Seen | Finding | None"


def unknown(why: str, todo: str = "", figure: float | None = None, limit: float | None = None) -> Finding:
    """A finding that cannot be decided."""
    return Finding("", UNKNOWN, why, figure, limit, todo)


def good(said: str, figure: float | None = None, limit: float | None = None) -> Finding:
    """A finding that is right, with what there is to know of it."""
    return Finding("", GOOD, said, figure, limit)


def not_numbers(case: Case) -> Sight:
    """Entries that are NaN or Inf."""
    for key, A in case.small.given.items():
        if not np.isfinite(A).all():
            row, place = np.argwhere(~np.isfinite(A))[0]
            return Seen(1.0, {"key": key, "row": row, "column": place})
    return Seen(0.0, {})


def misfits(case: Case) -> Sight:
    """Shapes and lists that do not belong together."""
    small, r, wrong = case.small, case.small.size, ""
    shapes = {key: A.shape for key, A in small.given.items()}
    if bad := [key for key in "MKD" if shapes.get(key, (r, r)) != (r, r)]:
        wrong = f"{bad[0]} is {' x '.join(map(str, shapes[bad[0]]))}, M has {r} rows"
    elif len(shapes.get("V", (0, r))) != 2 or shapes.get("V", (0, r))[1] != r:
        wrong = f"V is {' x '.join(map(str, shapes['V']))}, but there are {r} coordinates"
    elif small.kinds and len(small.kinds) != r:
        wrong = f"{len(small.kinds)} kinds are stated for {r} coordinates"
    elif small.places is not None and (np.any(small.places < 0) or np.any(small.places >= r)
                                       or len(np.unique(small.places)) < len(small.places)):
        wrong = f"the interface names a coordinate twice, or one outside 0 to {r - 1}"
    elif small.rows is not None and small.V is not None and np.any(small.rows >= len(small.V)):
        wrong = f"the interface names row {int(small.rows.max())}, but V has {len(small.V)} rows"
    elif small.dofs is not None and len(small.B) and small.dofs.size != len(small.B):
        wrong = f"the DOF map has {small.dofs.size} DOF, the interface {len(small.B)}"
    return Seen(float(bool(wrong)), {"wrong": wrong})


def other_model(case: Case) -> Sight:
    """Sizes that no reduction of this full model has; nothing is said where they fit."""
    small, n, wrong = case.small, case.whole.size, ""
    if small.V is not None and len(small.V) != n:
        wrong = f"V has {len(small.V)} rows, but the full model {n} DOF"
    elif small.rows is not None and small.rows.max(initial=-1) >= n:
        wrong = f"the interface names DOF {small.rows.max()}, but the full model has {n}"
    elif small.size > n:
        wrong = f"the reduced model has {small.size} coordinates, the full one {n} DOF"
    return Seen(1.0, {"wrong": wrong}) if wrong else None


def rounded(case: Case) -> Sight:
    """Relative rounding of the entries, as the digits show that they end after."""
    worst = max(case.rounding, key=lambda key: case.rounding[key])
    return Seen(case.rounding[worst], {"key": worst, "digits": 1 - np.log10(8 * case.rounding[worst])})


def skew(key: str, case: Case) -> Sight:
    """The largest |a_ij - a_ji| / √(a_ii a_jj)."""
    A = getattr(case.small, key)
    share = within(A - A.T, A)
    i, j = np.unravel_index(int(share.argmax()), share.shape)
    return Seen(float(share[i, j]), {"i": i, "j": j, "one": A[i, j], "other": A[j, i]})


def negative(key: str, case: Case) -> Sight:
    """-λ_min of a matrix scaled to a diagonal of 1, and the coordinate that moves most; M may lack the mass of an interface."""
    A, bare = getattr(case.small, key), case.small.massless
    values, vectors = np.linalg.eigh(scaled((A + A.T) / 2))
    lowest = max(-float(values[0]), 0.0)
    if key == "M" and len(bare) and lowest <= EQUAL:
        if case.small.projected:
            return Finding("", FAULT, f"coordinates {listed(bare)} have stiffness but no mass", float(len(bare)), 0.0,
                           "The mass at the interface is lost: take M_bb of the reduction as well, as CᵀMC")
        return good(f"{len(bare)} interface DOF without mass, as MacNeal's", lowest, EQUAL)
    return Seen(lowest, {"at": int(np.abs(vectors[:, 0]).argmax())})


def dependent(case: Case) -> Sight:
    """The energy of the motion that has least of mass and stiffness; coordinates that are all zero are reported."""
    small = case.small
    some = np.flatnonzero(small.M.any(axis=0) | small.K.any(axis=0))
    if not len(some) or (len(some) < small.size and "interface force" not in small.kinds):
        empty = np.setdiff1d(np.arange(small.size), some)
        return Finding("", FAULT, f"coordinates {listed(empty)} have neither mass nor stiffness", float(len(empty)), 0.0,
                       "Leave these columns out")
    M, K = (A[np.ix_(some, some)] for A in (small.M, small.K))
    whole = M + K * (M.diagonal().sum() / K.diagonal().sum() if K.diagonal().sum() > 0 else 1.0)
    values, vectors = np.linalg.eigh(scaled(whole))
    x = vectors[:, 0] * units(whole)
    energies = [(abs(float(x @ A @ x)), float(x**2 @ np.abs(A.diagonal()))) for A in (M, K)]
    share = max(part / single if single > 0 else 0.0 for part, single in energies)
    if values[0] > EQUAL or values[0] < -EQUAL or share > EQUAL:
        return good("")
    return Finding("", FAULT, f"a motion of coordinates {listed(some[np.argsort(-np.abs(vectors[:, 0]))[:2]])} has neither mass "
                   "nor stiffness: one of them is a copy of others", share, EQUAL, "Leave one out: a mode is listed twice")


def gyroscopic(case: Case) -> Sight:
    """‖D - Dᵀ‖ / 2‖D‖."""
    assert case.small.D is not None
    D = case.small.D
    share = float(np.linalg.norm(D - D.T) / (2 * np.linalg.norm(D)))
    if share > EQUAL and case.gyroscopic:
        return good(f"the part turns: {share:.1e} of D is gyroscopic", share)
    return Seen(share, {"share": share})


def feeding(case: Case) -> Sight:
    """-λ_min of the symmetric part of D, each coordinate scaled by its own damping, or by a share of the largest rate."""
    assert case.small.D is not None
    D, rates = case.small.D, []
    for A in (case.small.M, case.small.K):
        there = A.diagonal() > 0
        largest = float((D.diagonal()[there] / A.diagonal()[there]).max(initial=0.0))
        rates.append(largest * A.diagonal())
    size = np.sqrt(np.maximum(D.diagonal(), 0.0) + EQUAL * sum(rates))  # below, a diagonal entry of D is rounding
    size = np.where(size > 0, size, max(float(size.max()), float(np.sqrt(np.abs(D).max()))))
    values, vectors = np.linalg.eigh((D + D.T) / 2 / np.outer(size, size))
    found = max(-float(values[0]), 0.0)
    if found > EQUAL and (case.gyroscopic or (case.full is not None and case.active is not False)):
        return None if case.active else unknown(  # the full model's own does the same otherwise
            "its symmetric part feeds energy in, as friction on a part that turns may do", "Look at D of the full model", found,
            EQUAL)
    return Seen(found, {"at": int(np.abs(vectors[:, 0]).argmax())})


def unlike_modes(case: Case) -> Sight:
    """How far ΦᵀMΦ is from I, and ΦᵀKΦ from a diagonal."""
    small, at = case.small, case.small.modal
    if not len(at):
        return unknown("which coordinates are modes is not stated, and they do not look like it", "State the kinds of the "
                       "coordinates, or the interface") if not small.kinds and small.size > len(small.B) else None
    M, K = (A[np.ix_(at, at)] for A in (small.M, small.K))
    mixed = max(off_diagonal(M), off_diagonal(K))
    length = float(np.abs(M.diagonal() - 1).max()) if small.kinds else 0.0
    return Seen(max(mixed, length), {"why": f"the masses of modes differ from 1 by up to {length:.2g}" if length > mixed else
                                     f"modes share up to {mixed:.2g} of their energy"})


def shared_stiffness(case: Case) -> Sight:
    """ΨᵀKΦ between constraint and fixed-interface modes."""
    small, at = case.small, case.small.modal
    if small.basis != "held" or not 0 < len(at) < small.size:
        return None
    return Seen(coupling(small.K, np.setdiff1d(np.arange(small.size), at), at), {})


def alike_modes(case: Case) -> Sight:
    """Two modes with the same frequency that move the interface alike; of a symmetric part that may be so."""
    small, at = case.small, case.small.modal
    others = np.setdiff1d(np.arange(small.size), at)
    square = small.modal_frequencies**2
    moved = np.vstack([small.M[np.ix_(others, at)], small.K[np.ix_(others, at)]])
    for i in np.argsort(square)[:-1]:
        near = np.flatnonzero((np.abs(square - square[i]) <= EQUAL * abs(square[i])) & (np.arange(len(at)) > i))
        for j in near if moved[:, i].any() else ():
            if min(np.abs(moved[:, i] - s * moved[:, j]).max() for s in (1, -1)) <= EQUAL * np.abs(moved[:, i]).max():
                return unknown(f"coordinates {at[i]} and {at[j]} have one frequency and act on the interface alike: a mode "
                               "listed twice, or a symmetric part", "Give V, or the full model")
    return None


def carried_strain(case: Case) -> Sight:
    """The energy of the rigid motion that the model carries, over that of its single DOF."""
    motion = case.small.motion
    return None if motion is None or not motion.shape[1] else Seen(case.small.strain(motion), {})


def mapped_strain(case: Case) -> Sight:
    """The energies of the rigid motions that the DOF map names, relative to those of the single DOF."""
    small = case.small
    if case.mapped is None:
        return None if small.motion is not None and small.motion.shape[1] else unknown(
            "nothing says where the interface DOF are and how they move", "Give the DOF map of the interface, with points "
            "(dofs), or the full model")
    energy, free, whole = case.mapped.energy, case.mapped.free, case.mapped.whole
    if not len(energy):
        return unknown("the DOF map has no translations that are known, or the interface moves in shapes only",
                       f"Labels that are known: {', '.join(AXES)}, w, w,x and w,y")
    count = int(np.count_nonzero(energy <= EQUAL))
    soft = energy[(energy > EQUAL) & (energy <= SHAPED)]
    wrong = ""
    if small.floating and count < len(energy):
        wrong = f"the part floats, but {len(energy) - count} of {len(energy)} rigid motions have an elastic energy"
    elif free > count and whole:
        wrong = f"K has {free} motions without energy, but by the DOF map only {count} are rigid motion"
    if wrong:
        return Finding("", FAULT, wrong, float(energy.max()), EQUAL, "A soft spring to the ground, or entries with few digits. "
                       "Write all digits, and remove the spring" if energy.max() <= SHAPED else "DOF are swapped, have another "
                       "sign or other units, or the map belongs to another model: compare it DOF by DOF")
    if len(soft):
        return unknown(f"{len(soft)} rigid motions have very little energy: a soft mount, or a spring that nobody meant",
                       "State whether the part floats (floating), or give the full model", float(soft.max()), EQUAL)
    if count:
        return good(f"{count} rigid motions are free", float(energy[energy <= EQUAL].max()), EQUAL)
    return unknown("the part is held, so far as K shows", "State whether it floats (floating), or give the full model",
                   float(energy.min()), EQUAL)


def unlike_body(case: Case) -> Sight:
    """How far the mass matrix of the rigid motions is from that of a rigid body."""
    if case.block is None:
        return None
    P, m, centre, wrong, _ = case.block
    if wrong <= AGREE:
        return good(f"mass {m:.6g}, its centre at ({', '.join(f'{one:.4g}' for one in centre)})", wrong, AGREE)
    return Seen(wrong, {"masses": ", ".join(f"{one:.6g}" for one in P.diagonal()[:3])})


def other_mass(case: Case) -> Sight:
    """|m / m_stated - 1|."""
    if case.block is None or case.small.mass is None:
        return None
    mass, stated = case.block[1], case.small.mass
    return Seen(abs(mass / stated - 1), {"mass": mass, "stated": stated, "factor": factor(mass / stated)})


def implausible(case: Case, lightest: float = 1e-2, heaviest: float = 1e8, fastest: float = 2e4) -> Sight:
    """Mass over the cube of the interface's extent [kg/m³], and the speed [m/s] that waves need for the first elastic ω.

    A long thin part has much less or much more mass than a cube of its extent. No solid has waves faster than `fastest`.
    """
    if case.block is None:
        return None
    small, m, length = case.small, case.block[1], case.block[4]
    if small.units not in SYSTEMS:
        return unknown("the system of units is not stated", "State units ('SI' or 'mm-t-s')")
    if not length:
        return unknown("the interface is one point")
    metre, kilogram = SYSTEMS[small.units]
    density = m * kilogram / (length * metre) ** 3
    omega = small.free_frequencies[small.free_frequencies > 1e-3 * small.free_frequencies.max(initial=0.0)]
    speed = float(omega.min(initial=0.0)) * length * metre / np.pi
    if lightest <= density <= heaviest and speed <= fastest:
        return Finding("", GOOD, "", density, heaviest)
    return Finding("", FAULT, f"in {small.units} units the mass over the interface's extent cubed is {density:.2g} kg/m³, and "
                   f"the first elastic frequency needs waves of {speed:.2g} m/s", density, heaviest,
                   "No solid is like that: lengths, masses or times are in other units")


def factor(ratio: float) -> str:
    """What a factor between two models may come from."""
    known = {1e3: "t against kg, or N/mm against N/m", 1e6: "mm against m, squared", 1e9: "mm³ against m³",
             1e12: "t/mm³ against kg/m³", 9.80665: "weight for mass", 9806.65: "weight for mass in mm",
             386.0886: "weight for mass in inches (WTMASS)", 0.0254: "inches against m", 25.4: "inches against mm",
             4.4482216: "lbf against N", 0.45359237: "lb against kg"}
    for value, why in known.items():
        for one in (value, 1 / value):
            if ratio > 0 and abs(ratio / one - 1) < 2e-3:  # the digits of these factors, and of what is compared
                return f", by a factor of {ratio:.4g} (as {why})"
    return f", by a factor of {ratio:.6g}" if ratio > 0 else ""


def common_factor(own: Array, there: Array) -> str:
    """What one factor between two matrices may come from; '' where they differ by none, or by less than 1 %."""
    large = np.abs(there) > AGREE * np.abs(there).max(initial=0.0)
    if not large.any():
        return ""
    ratio = own[large] / there[large]
    middle = float(np.median(ratio))
    return factor(middle) if np.abs(ratio - middle).max() <= 1e-3 * abs(middle) and abs(middle - 1) > 0.01 else ""


def unlike(apart: Array, own: Array, there: Array) -> Seen:
    """The largest of the differences `apart` of two matrices, with its place, the entries there, and a common factor."""
    # the first entry that is as large as any, but for rounding
    i, j = np.unravel_index(int(np.argmax(apart >= (1 - AGREE) * apart.max())), apart.shape)
    return Seen(float(apart.max()), {"i": i, "j": j, "own": own[i, j], "there": there[i, j], "factor": common_factor(own, there)})


def unlike_interface(apart: Array, own: Array, there: Array) -> Seen:
    """The same of matrices of the interface, with what would explain the difference: signs, an order, units, some DOF."""
    size = np.sqrt(np.abs(there.diagonal()))
    size = np.where(size > 0, size, 1.0)
    wrong = np.abs(own - there) > AGREE * np.outer(size, size)
    bad = np.flatnonzero(wrong.diagonal())
    seen = unlike(apart, own, there)
    if not (np.abs(np.abs(own) - np.abs(there)) > AGREE * np.outer(size, size)).any():
        turned = np.flatnonzero(np.sign(own * there).sum(axis=0) < 0)
        guess = f"The sign of interface DOF {listed(turned) or 'some'} is turned"
    elif len(bad) > 1 and np.allclose(np.sort(own.diagonal()[bad]), np.sort(there.diagonal()[bad]), rtol=AGREE):
        guess = f"Interface DOF {listed(bad)} are in another order"
    elif seen.words["factor"]:
        guess = "Bring both models to one system of units"
    elif 0 < len(bad) < len(own) and not np.delete(np.delete(wrong, bad, 0), bad, 1).any():
        guess = f"Look at interface DOF {listed(bad)}: their constraint modes or entries"
    else:
        guess = "Constraint modes are wrong or missing, or the model is another one: add the static shapes of the interface"
    return Seen(seen.figure, {**seen.words, "guess": guess})


def other_interface(case: Case) -> Sight:
    """Whether the reduced model and the full one list the same interface DOF; nothing is said where they do."""
    own, there = case.small.rows, case.whole.interface
    if own is None or not len(there) or np.array_equal(own, there):
        return None
    one_only = len(set(own.tolist()) ^ set(there.tolist()))
    at = np.flatnonzero(own != there)[0] if len(own) == len(there) else 0
    why = f"the reduced model and the full one list the same interface DOF in another order, first at place {at}"
    if one_only:
        why = (f"the reduced model's interface has {len(own)} DOF, the full one's {len(there)}, and {one_only} are in one "
               "list only")
    return Seen(1.0, {"why": why})


def unmoved_interface(case: Case) -> Sight:
    """How far V moves interface DOF by other than one with their coordinates."""
    small = case.small
    if small.V is None or small.places is None or len(small.places) != len(case.rows):
        return None
    wrong = np.abs(small.V[case.rows] - small.B).max(axis=1)
    return Seen(float(wrong.max(initial=0.0)), {"bad": listed(np.flatnonzero(wrong > AGREE))})


def unlike_projection(key: str, case: Case) -> Sight:
    """A - VᵀAV over the energies of single coordinates; MacNeal's M is that of its free modes Φ alone, VᵀMΦΦᵀMV."""
    small, whole = case.small, case.whole
    assert small.V is not None
    V, A = small.V, getattr(whole, key)
    size = np.abs(V)
    own, there = small.given.get(key, np.zeros_like(small.K)), V.T @ (A @ V)
    scale = there
    if key == "D":
        if not (own.any() or there.any()):
            return None
        # D may cancel, or be skew
        scale = np.diag((size.T @ (abs(A) @ size) if there.any() else V.T @ (whole.M @ V)).diagonal())
    if key == "M" and not small.projected:
        massive = case.lowest(case.free, small.mass_rank - case.free.rigid.shape[1])
        part = massive.shapes.T @ (A @ V)
        there = part.T @ part
    apart = within(own - there, scale, ROUNDING * (size.T @ (abs(A) @ size)))
    bad = np.flatnonzero((apart > AGREE).sum(axis=1) > 0.5 * len(apart))
    blamed = 0 < len(bad) < 0.5 * len(apart)
    seen = unlike(apart, own, there)
    return Seen(seen.figure, {**seen.words, "advice": f"Coordinates {listed(bad)} are to blame: their columns of V, or their "
                              f"rows of {key}" if blamed else f"V, or {key}, is of another model, or in other units"})


def other_spectrum(case: Case) -> Sight:
    """All ω of the reduced model, against those of the full one in the shapes that the kinds of coordinates name.

    The span of constraint and fixed-interface modes is known, and that of free modes and the residual response to forces at the
    interface. ω does not depend on the coordinates in it, so no V is needed.
    """
    small, sub, basis, n_b = case.small, case.whole, case.small.basis, len(case.rows)
    if not small.kinds or not basis or not n_b or (basis == "held" and isinstance(case.statics, Unknown)):
        return None
    handle = case.factor
    rigid = 0 if basis == "held" else handle.rigid.shape[1]
    kept = small.kinds.count(HELD_KIND if basis == "held" else "free")
    if basis == "free" and not kept:  # Herting's kinds do not name the modes alone
        if sub.ports:
            return None
        kept = max(0, small.size - n_b - rigid)
    if kept > case.most:
        return unknown(f"the model has {kept} modes, and only up to {case.most} are compared", "Give V")
    modes = case.lowest(handle, kept)
    forces, ports = np.eye(sub.size)[:, case.rows], np.column_stack([np.zeros((sub.size, 0)), *sub.ports.values()])
    also = ports if small.size == kept + rigid + n_b + ports.shape[1] else ports[:, :0]
    if basis == "held" and not isinstance(case.statics, Unknown):
        inner = np.zeros((sub.size, modes.shapes.shape[1] + also.shape[1]))
        inner[case.inside] = np.hstack([modes.shapes, handle.elastic_solve(also[case.inside], modes.shapes)])
        shapes = np.hstack([case.statics[0], inner])
    else:
        residual = handle.elastic_solve(np.hstack([forces, also]), modes.shapes)
        shapes = np.hstack([modes.shapes, residual if small.projected else residual[:, :0]])
    there, own = frequencies(*(shapes.T @ (A @ shapes) for A in (sub.K, sub.M))), small.free_frequencies
    elastic = there[case.free.rigid.shape[1]:]
    if len(own) != len(there) or not len(elastic) or not elastic[0]:
        return None  # shapes that depend on each other were left out
    beyond = np.maximum(np.abs(own**2 - there**2) - ROUNDING * len(own) * there[-1] ** 2, 0.0)
    apart = beyond / np.maximum(there, elastic[0]) ** 2
    worst = int(apart.argmax())
    return Seen(float(apart[worst]), {"mode": worst + 1, "count": len(own), "own": own[worst], "there": there[worst]})


def unlike_statics(case: Case) -> Sight:
    """XᵀKX against the full model's stiffness condensed to the interface, or what V leaves out of the static response."""
    small, n_b, statics = case.small, len(case.rows), case.statics
    if isinstance(statics, Unknown):
        return unknown(*statics)
    if not len(small.B):
        return unknown("the reduced model's interface is not known", "State it, in the full one's order")
    if len(small.B) != n_b:
        return Finding("", FAULT, f"the reduced model has {len(small.B)} interface DOF, the full one {n_b}",
                       todo="State both interfaces, in the same order")
    if small.places is None:
        # what V leaves out of the constraint modes, in the energy norm; inertia gives rigid motion an energy too
        shapes, V, elastic = statics[0] @ small.parted[0], small.given["V"], small.elastic_frequencies
        square = float(elastic[0]) ** 2 if len(elastic) else float(case.whole.K.diagonal().sum() / case.whole.M.diagonal().sum())
        A = case.whole.K + case.whole.M * square
        AC, AV = A @ shapes, A @ V
        gram = V.T @ AV
        unit = units(gram)
        q = unit[:, None] * np.linalg.lstsq(gram * np.outer(unit, unit), unit[:, None] * (V.T @ AC), rcond=1e-14)[0]
        rest = shapes - V @ q
        lost = np.sqrt(np.abs(np.einsum("ij,ij->j", rest, A @ rest)) / np.einsum("ij,ij->j", shapes, AC))
        left = float(lost.max(initial=0.0))
        said = f"V leaves out a share of {left:.1e} of the static response to a motion of the interface, in the energy norm"
        return Finding("", FAULT, said, left, SHAPED, "Add the static shapes of the interface: constraint modes, or residual "
                       "attachment modes") if left > SHAPED else good("", left, SHAPED)
    U, X = small.parted[0], small.static
    if X is None:
        return Finding("", FAULT, "the inside of the reduced model has no firm hold at the interface",
                       todo="A coordinate has no stiffness, or K is not that of this model")
    C, K, _ = statics
    bare = case.whole.K.diagonal()[case.rows]
    floor = np.abs(C).T @ (abs(case.whole.K) @ np.abs(C)) * ROUNDING + EPS * np.sqrt(np.outer(bare, bare))
    own, there = X.T @ small.K @ X, U.T @ K @ U
    rounding = np.abs(U).T @ floor @ np.abs(U) + np.abs(X).T @ (abs(small.K) @ np.abs(X)) * ROUNDING
    return unlike_interface(within(own - there, there, rounding), own, there)


def unlike_inertia(case: Case) -> Sight:
    """XᵀMX of a Ritz model against the full model's on the interface, CᵀMC."""
    small, seen = case.small, case.comparable
    if seen is None or not small.projected:
        return None
    U, X, _, M = seen
    own, there = X.T @ small.M @ X, U.T @ M @ U
    return unlike_interface(within(own - there, there), own, there)


def unlike_damping(case: Case) -> Sight:
    """XᵀDX against the full model's on the interface, CᵀDC, where no V says more."""
    small, seen = case.small, case.comparable
    if seen is None or small.V is not None or small.D is None:
        return None
    U, X, C, M = seen
    own, there = X.T @ small.D @ X, U.T @ (C.T @ (case.whole.D @ C)) @ U
    if not (own.any() or there.any()):
        return None
    size = np.diag((np.abs(C).T @ (abs(case.whole.D) @ np.abs(C))).diagonal()) if there.any() else M
    return unlike_interface(within(own - there, U.T @ size @ U, ROUNDING * size.max()), own, there)


def missing_motion(case: Case) -> Sight:
    """The share of the full model's rigid motion that V leaves out, where the interface does not distinguish it."""
    if isinstance(case.moved, Unknown) or case.moved[2] is None:
        return None
    return Seen(case.moved[2], {"left": case.moved[2]})


def moved_strain(case: Case) -> Sight:
    """The energy of the full model's rigid motion in the reduced one."""
    if isinstance(case.moved, Unknown):
        return unknown(*case.moved)
    q, Z, _ = case.moved
    return Seen(case.small.strain(q), {"count": Z.shape[1]}) if Z.shape[1] else good("the full model is held", 0.0, EQUAL)


def other_inertia(case: Case) -> Sight:
    """qᵀMq - I of the full model's rigid motion of unit mass."""
    if isinstance(case.moved, Unknown) or not case.moved[1].shape[1]:
        return None
    P = case.moved[0].T @ case.small.M @ case.moved[0]
    return Seen(float(np.abs(P - np.eye(len(P))).max()), {"masses": ", ".join(f"{one:.6g}" for one in P.diagonal()),
                                                          "factor": common_factor(P, np.eye(len(P)))})


def uncounted(case: Case) -> Sight:
    """The difference of the modes below the cut-off, by the inertia of K - ω²M of the full model; or what is known of it."""
    kept, cut = case.kept, case.small.cutoff
    if isinstance(kept, Unknown):
        return unknown(*kept)
    if kept.modes is None:
        return good("nothing is left out" if kept.tally.listed else "all DOF are interface")
    if np.isfinite(cut):
        advice = "Keep all modes below the cut-off, or state a lower one" if kept.counted > kept.listed else \
            "A mode is listed twice, or is none of the full model"
        return Seen(float(abs(kept.counted - kept.listed)), {"counted": kept.counted, "cut": cut, "listed": kept.listed,
                                                             "advice": advice})
    if np.isinf(kept.first):
        return good("")
    if np.isinf(cut):
        return Finding("", FAULT, f"the model says that no mode is left out, but one at {kept.first:.6g} rad/time is",
                       todo="State this cut-off")
    return good(f"none is stated; the first mode that is left out is at {kept.first:.6g} rad/time")


def unconverged(case: Case) -> Sight:
    """The largest relative distance in ω² of a mode from the nearest one of the full model."""
    if isinstance(case.kept, Unknown) or not len(case.kept.apart):
        return None
    worst = int(case.kept.apart.argmax())
    return Seen(float(case.kept.apart[worst]), {"mode": worst + 1, "off": case.kept.apart[worst]})


def unlike_coupling(case: Case) -> Sight:
    """M_bi: what the modes of each cluster take part in motions of the interface, Σ p pᵀ, which no rotation changes."""
    small, kept, statics = case.small, case.kept, case.statics
    if isinstance(kept, Unknown) or kept.modes is None or small.basis != "held" or isinstance(statics, Unknown) \
            or small.static is None:
        return None
    U, at = small.parted[0], small.modal
    if len(U) != len(case.rows) or small.kinds.count("static port"):
        return None
    C, _, M_c = statics
    mass = np.abs(small.M.diagonal()[at])
    own = small.static.T @ small.M[:, at] / np.sqrt(np.where(mass > 0, mass, 1.0))
    true = U.T @ (C.T @ (case.whole.M[:, case.inside] @ kept.modes.shapes))
    size = np.sqrt((U.T @ M_c @ U).diagonal())
    omega, there = small.modal_frequencies, kept.modes.frequencies
    worst, where, start = 0.0, 0.0, 0
    for end in np.flatnonzero(np.append(np.diff(there) > SHAPED * there[1:], True)) + 1:
        mine = (omega >= there[start] * (1 - SHAPED)) & (omega <= there[end - 1] * (1 + SHAPED))
        complete = end < len(there) or len(there) == len(case.inside)
        if mine.sum() == end - start and complete:
            p, q = own[:, mine] / size[:, None], true[:, start:end] / size[:, None]
            gap = float(np.abs(p @ p.T - q @ q.T).max(initial=0.0)) / max(float((q * q).sum(axis=1).max(initial=0.0)), SHAPED)
            worst, where = max((worst, where), (gap, float(there[start])))
        start = end
    return Seen(worst, {"omega": where})


def lowered(case: Case) -> Sight:
    """How far a frequency of a Ritz model lies below the full model's."""
    if isinstance(case.frequencies, Unknown) or not len(case.frequencies):
        return None
    own, there = case.frequencies.T
    below = 1 - own / there
    worst = int(below.argmax())
    return Seen(max(float(below[worst]), 0.0), {"mode": worst + 1, "own": own[worst], "there": there[worst]})


def unbounded(case: Case) -> Sight:
    """How far a frequency of the full model lies below its bound from the small matrices alone."""
    small, found = case.small, case.frequencies
    if isinstance(found, Unknown) or not len(found) or not np.isfinite(small.cutoff) or not small.kinds or not case.sound:
        return None
    if isinstance(case.bounds, Unknown) or case.bounds.rigid != case.free.rigid.shape[1]:
        return None
    k = min(len(case.bounds.lower), len(found))
    below = 1 - found[:k, 1] / case.bounds.lower[:k]
    worst = int(below.argmax())
    return Seen(max(float(below[worst]), 0.0), {"mode": worst + 1, "there": found[worst, 1], "bound": case.bounds.lower[worst]})


def unseen_modes(case: Case) -> Sight:
    """Modes that are missing are not seen in the small matrices."""
    return unknown("whether one is missing cannot be known from the small matrices", "Give the full M and K")


def unknown_frequencies(case: Case) -> Sight:
    """Why the frequencies of the full model are not known, or have no bounds without it; nothing is said where they are."""
    if case.full is None:
        return unknown(case.bounds.why, "Give the full M and K") if isinstance(case.bounds, Unknown) else None
    return unknown(*case.frequencies) if isinstance(case.frequencies, Unknown) else None
