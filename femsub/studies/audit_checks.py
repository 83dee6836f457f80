"""The checks of an audit: a function for the figure of each check, and a table of requirements, limits and sentences.

The function of a check returns a figure, which a limit decides, or a finding without a limit, or None if it does not apply.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from femsub.checks import EPS, EQUAL, Array, FemsubError
from femsub.model import MOTIONS, ReducedSubstructure, by_diagonal, over_diagonal, rounding_of, units
from femsub.output import FASTEST, IN_SI, factor_words
from femsub.reduction import AGREE, HELD_KIND, METHODS, PRODUCTS, SHAPED, Body, GivenModel, Mapped, coupling, off_diagonal
from femsub.studies.audit_case import FAULT, GOOD, Case, Finding, KeptModes, listed, unknown


class Seen:
    """A figure, to be compared with the limit of its check, and the words that fill the check's sentence and advice."""

    def __init__(self, figure: float, **words: Any) -> None:
        self.figure, self.words = float(figure), words


Sight: TypeAlias = "Seen | Finding | None"


def good(said: str, figure: float | None = None, limit: float | None = None) -> Finding:
    """The finding that a property is good, with facts about it in `said`."""
    return Finding("", GOOD, said, figure, limit)


def fault(said: str, todo: str, figure: float | None = None, limit: float | None = None) -> Finding:
    """The finding of a fault, with its own sentence and advice."""
    return Finding("", FAULT, said, figure, limit, todo)


def not_numbers(case: Case) -> Sight:
    """Entries that are NaN or Inf."""
    for key, A in case.given.items():
        for row, column in np.argwhere(~np.isfinite(A))[:1]:
            return Seen(1.0, key=key, row=row, column=column)
    return Seen(0.0)


def misfits(case: Case) -> Sight:
    """Shapes of matrices and lists that do not fit together."""
    r, places, wrong = case.size, case.interface, ""
    shapes = {key: A.shape for key, A in case.given.items()}
    if bad := [key for key in "MKD" if shapes.get(key, (r, r)) != (r, r)]:
        wrong = f"{bad[0]} is {' x '.join(map(str, shapes[bad[0]]))}, M has {r} rows"
    elif case.V is not None and (case.V.ndim != 2 or case.V.shape[1] != r):
        wrong = f"V is {' x '.join(map(str, shapes['V']))}, but there are {r} coordinates"
    elif case.kinds and len(case.kinds) != r:
        wrong = f"{len(case.kinds)} kinds are stated for {r} coordinates"
    elif places is not None and (np.any(places < 0) or np.any(places >= r) or len(np.unique(places)) < len(places)):
        wrong = f"the interface names a coordinate twice, or one outside 0 to {r - 1}"
    elif case.full_interface is not None and case.V is not None and np.any(case.full_interface >= len(case.V)):
        wrong = f"the interface names row {int(case.full_interface.max())}, but V has {len(case.V)} rows"
    elif case.dofs is not None and len(case.B) and case.dofs.size != len(case.B):
        wrong = f"the DOF map has {case.dofs.size} DOF, the interface {len(case.B)}"
    return Seen(bool(wrong), wrong=wrong)


def other_model(case: Case) -> Sight:
    """Sizes that no reduction of this full model has; None where they fit."""
    n, rows, wrong = case.whole.size, case.full_interface, ""
    if case.V is not None and len(case.V) != n:
        wrong = f"V has {len(case.V)} rows, but the full model {n} DOF"
    elif rows is not None and rows.max(initial=-1) >= n:
        wrong = f"the interface names DOF {rows.max()}, but the full model has {n}"
    elif case.size > n:
        wrong = f"the reduced model has {case.size} coordinates, the full one {n} DOF"
    return Seen(1.0, wrong=wrong) if wrong else None


def rounded(case: Case) -> Sight:
    """The relative rounding error of the entries, from the number of digits after which they end."""
    found = {key: rounding_of(case.given[key], np.zeros((case.size, 0))) for key in "KM"}
    worst = max(found, key=lambda key: found[key])
    return Seen(found[worst], key=worst, digits=1 - np.log10(8 * found[worst]))


def skew(key: str, case: Case) -> Sight:
    """The largest |a_ij - a_ji| / √(a_ii a_jj)."""
    A = case.given[key]
    share = over_diagonal(A - A.T, A)
    i, j = np.unravel_index(int(share.argmax()), share.shape)
    return Seen(share[i, j], i=i, j=j, one=A[i, j], other=A[j, i])


def negative(key: str, case: Case) -> Sight:
    """-λ_min of a matrix scaled to a diagonal of 1, and the coordinate that moves most in its eigenvector.

    M may be zero at interface DOF of MacNeal's models only.
    """
    A, bare = case.given[key], case.massless
    values, vectors = np.linalg.eigh(by_diagonal((A + A.T) / 2))
    lowest = max(-float(values[0]), 0.0)
    if key == "M" and len(bare) and lowest <= EQUAL:
        return fault(f"coordinates {listed(bare)} have stiffness but no mass", "The mass at the interface is lost: take M_bb of "
                     "the reduction as well, as CᵀMC", len(bare), 0.0) if case.projected else good(
            f"{len(bare)} interface DOF without mass, as MacNeal's", lowest, EQUAL)
    return Seen(lowest, at=int(np.abs(vectors[:, 0]).argmax()))


def dependent(case: Case) -> Sight:
    """The relative energy of the motion with the least mass and stiffness. Coordinates that have neither are a fault."""
    some = np.flatnonzero(case.M.any(axis=0) | case.K.any(axis=0))
    if not len(some) or (len(some) < case.size and "interface force" not in case.kinds):
        empty = np.setdiff1d(np.arange(case.size), some)
        return fault(f"coordinates {listed(empty)} have neither mass nor stiffness", "Leave these columns out", len(empty), 0.0)
    M, K = (A[np.ix_(some, some)] for A in (case.M, case.K))
    whole = M + K * (M.diagonal().sum() / K.diagonal().sum() if K.diagonal().sum() > 0 else 1.0)
    values, vectors = np.linalg.eigh(by_diagonal(whole))
    x = vectors[:, 0] * units(whole)
    energies = [(abs(float(x @ A @ x)), float(x**2 @ np.abs(A.diagonal()))) for A in (M, K)]
    share = max(part / single if single > 0 else 0.0 for part, single in energies)
    if abs(values[0]) > EQUAL or share > EQUAL:
        return good("")
    return fault(f"a motion of coordinates {listed(some[np.argsort(-np.abs(vectors[:, 0]))[:2]])} has neither mass nor "
                 "stiffness: one of them is a copy of others", "Leave one out: a mode is listed twice", share, EQUAL)


def gyroscopic(case: Case, D: Array) -> Sight:
    """‖D - Dᵀ‖ / 2‖D‖."""
    share = float(np.linalg.norm(D - D.T) / (2 * np.linalg.norm(D)))
    if share > EQUAL and case.gyroscopic:
        return good(f"the part turns: {share:.1e} of D is gyroscopic", share)
    return Seen(share, share=share)


def feeding(case: Case, D: Array) -> Sight:
    """-λ_min of the symmetric part of D. Each coordinate is scaled by its own damping, plus a share of the largest rate."""
    rates = []
    for A in (case.M, case.K):
        there = A.diagonal() > 0
        largest = float((D.diagonal()[there] / A.diagonal()[there]).max(initial=0.0))
        rates.append(largest * A.diagonal())
    size = np.sqrt(np.maximum(D.diagonal(), 0.0) + EQUAL * sum(rates))  # below, a diagonal entry of D is rounding
    size = np.where(size > 0, size, max(float(size.max()), float(np.sqrt(np.abs(D).max()))))
    values, vectors = np.linalg.eigh((D + D.T) / 2 / np.outer(size, size))
    found = max(-float(values[0]), 0.0)
    if found > EQUAL and (case.gyroscopic or (case.full is not None and case.active is not False)):
        return None if case.active else unknown(  # None: D of the full model feeds energy in, too
            "its symmetric part feeds energy in, as friction on a part that turns may do", "Look at D of the full model", found,
            EQUAL)
    return Seen(found, at=int(np.abs(vectors[:, 0]).argmax()))


def unlike_modes(case: Case) -> Sight:
    """The largest difference of ΦᵀMΦ from I, and of ΦᵀKΦ from a diagonal matrix, relative to energies of single modes."""
    at = case.modal
    if not len(at):
        return unknown("which coordinates are modes is not stated, and they do not look like it", "State the kinds of the "
                       "coordinates, or the interface") if not case.kinds and case.size > len(case.B) else None
    M, K = (A[np.ix_(at, at)] for A in (case.M, case.K))
    mixed = max(off_diagonal(M), off_diagonal(K))
    length = float(np.abs(M.diagonal() - 1).max()) if case.kinds else 0.0
    return Seen(max(mixed, length), why=f"the masses of modes differ from 1 by up to {length:.2g}" if length > mixed else
                f"modes share up to {mixed:.2g} of their energy")


def shared_stiffness(case: Case) -> Sight:
    """ΨᵀKΦ between constraint modes Ψ and fixed-interface modes Φ, relative to energies of single coordinates."""
    at = case.modal
    if case.basis != "held" or not 0 < len(at) < case.size:
        return None
    return Seen(coupling(case.K, np.setdiff1d(np.arange(case.size), at), at))


def moved_mass(case: Case, mapped: Mapped) -> Sight:
    """The least and the largest share of the mass that the fixed-interface modes move in a rigid motion q.

    The share is Σ L²/m over qᵀMq, with the rows L = (M q)_i and the masses m = M_ii of the modes i.
    """
    X, at = case.static, case.modal
    if X is None or case.basis != "held" or not len(at) or not mapped.at.size:
        return None
    q = X @ mapped.at
    L, own, whole = case.M[at] @ q, case.M.diagonal()[at], np.einsum("ij,ij->j", q, case.M @ q)
    if not (own > 0).all() or not (whole > 0).all():
        return None
    share = (L**2 / own[:, None]).sum(axis=0) / whole
    return good(f"with the interface held, the {len(at)} modes move {share.min():.0%} to {share.max():.0%} of the mass in "
                f"{len(share)} rigid motions".replace("%", " %"))


def alike_modes(case: Case) -> Sight:
    """Two modes with the same frequency that act on the interface alike. A symmetric part may have such modes."""
    at, square = case.modal, case.modal_frequencies**2
    others = np.setdiff1d(np.arange(case.size), at)
    moved = np.vstack([case.M[np.ix_(others, at)], case.K[np.ix_(others, at)]])
    for i in np.argsort(square)[:-1]:
        near = np.flatnonzero((np.abs(square - square[i]) <= EQUAL * abs(square[i])) & (np.arange(len(at)) > i))
        for j in near if moved[:, i].any() else ():
            if min(np.abs(moved[:, i] - s * moved[:, j]).max() for s in (1, -1)) <= EQUAL * np.abs(moved[:, i]).max():
                return unknown(f"coordinates {at[i]} and {at[j]} have one frequency and act on the interface alike: a mode "
                               "listed twice, or a symmetric part", "Give V, or the full model")
    return None


def carried_strain(case: Case, motion: Array) -> Sight:
    """The strain energy of the rigid motion that the model carries, relative to the energy of single DOF."""
    return Seen(case.strain(motion))


def mapped_strain(case: Case) -> Sight:
    """The strain energies of the rigid motions that the DOF map names, relative to the energy of single DOF."""
    if case.mapped is None:
        return None if case.motion is not None else unknown(
            "nothing says where the interface DOF are and how they move", "Give the DOF map of the interface, with points "
            "(dofs), or the full model")
    _, energy, free, whole = case.mapped
    if not len(energy):
        return unknown("the DOF map has no known translations, or the interface moves in shapes only",
                       f"Known labels: {', '.join(MOTIONS)}, w, w,x and w,y")
    count = int(np.count_nonzero(energy <= EQUAL))
    soft = energy[(energy > EQUAL) & (energy <= SHAPED)]
    wrong = ""
    if case.floating and count < len(energy):
        wrong = f"the part floats, but {len(energy) - count} of {len(energy)} rigid motions have an elastic energy"
    elif free > count and whole:
        wrong = f"K has {free} motions without energy, but by the DOF map only {count} are rigid motion"
    if wrong:
        return fault(wrong, "A soft spring to the ground, or entries with few digits. Write all digits, and remove the spring"
                     if energy.max() <= SHAPED else "DOF are swapped, have another sign or other units, or the map belongs to "
                     "another model: compare it DOF by DOF", float(energy.max()), EQUAL)
    if len(soft):
        return unknown(f"{len(soft)} rigid motions have very little energy: a soft mount, or an unintended spring",
                       "State whether the part floats (floating), or give the full model", float(soft.max()), EQUAL)
    if count:
        return good(f"{count} rigid motions are free", float(energy[energy <= EQUAL].max()), EQUAL)
    return unknown("the part is held, as far as K shows", "State whether it floats (floating), or give the full model",
                   float(energy.min()), EQUAL)


def unlike_body(case: Case, body: Body) -> Sight:
    """The relative error of the rigid motions' mass matrix, compared with the form that a rigid body's has."""
    if body.wrong <= AGREE:
        return good(f"mass {body.mass:.6g}, its centre at ({', '.join(f'{one:.4g}' for one in body.centre)})", body.wrong, AGREE)
    return Seen(body.wrong, masses=", ".join(f"{one:.6g}" for one in body.P.diagonal()[:3]))


def other_mass(case: Case, body: Body, stated: float) -> Sight:
    """|m / m_stated - 1|."""
    return Seen(abs(body.mass / stated - 1), mass=body.mass, stated=stated, factor=factor_words(body.mass / stated))


def implausible(case: Case, body: Body, lightest: float = 1e-2, heaviest: float = 1e8, fastest: float = FASTEST) -> Sight:
    """Mass over the cube of the interface's extent L [kg/m³], and the wave speed ω L/π [m/s] of the first elastic ω.

    The limits of the density are wide, since a part may be much lighter or heavier than a cube of side L. No solid has waves
    faster than `fastest`.
    """
    if case.units not in IN_SI:
        return unknown("the system of units is not stated", "State units ('SI' or 'mm-t-s')")
    if not body.length:
        return unknown("the interface is one point")
    metre, kilogram = IN_SI[case.units]
    density = body.mass * kilogram / (body.length * metre) ** 3
    omega = case.free_frequencies[case.free_frequencies > 1e-3 * case.free_frequencies.max(initial=0.0)]
    speed = float(omega.min(initial=0.0)) * body.length * metre / np.pi
    if lightest <= density <= heaviest and speed <= fastest:
        return good("", density, heaviest)
    return fault(f"in {case.units} units the mass over the interface's extent cubed is {density:.2g} kg/m³, and the first "
                 f"elastic frequency needs waves of {speed:.2g} m/s",
                 "No solid is like that: lengths, masses or times are in other units", density, heaviest)


def common_factor(own: Array, there: Array) -> str:
    """Words on a common factor between two matrices and its possible cause; '' without one, or if it is within 1 % of 1."""
    large = np.abs(there) > AGREE * np.abs(there).max(initial=0.0)
    if not large.any():
        return ""
    ratio = own[large] / there[large]
    middle = float(np.median(ratio))
    return factor_words(middle) if np.abs(ratio - middle).max() <= 1e-3 * abs(middle) and abs(middle - 1) > 0.01 else ""


def unlike(apart: Array, own: Array, there: Array) -> Seen:
    """The largest of the differences `apart` of two matrices, with its place, the entries there, and a common factor."""
    # the first entry that equals the largest one within rounding
    i, j = np.unravel_index(int(np.argmax(apart >= (1 - AGREE) * apart.max())), apart.shape)
    return Seen(apart.max(), i=i, j=j, own=own[i, j], there=there[i, j], factor=common_factor(own, there))


def unlike_interface(apart: Array, own: Array, there: Array) -> Seen:
    """`unlike` for matrices of the interface, with a guess at the cause: signs, order or units of DOF, or some of the DOF."""
    size = np.sqrt(np.abs(there.diagonal()))
    size = np.where(size > 0, size, 1.0)
    wrong = np.abs(own - there) > AGREE * np.outer(size, size)
    bad = np.flatnonzero(wrong.diagonal())
    seen = unlike(apart, own, there)
    guess = "Constraint modes are wrong or missing, or the model is another one: add the static shapes of the interface"
    if not (np.abs(np.abs(own) - np.abs(there)) > AGREE * np.outer(size, size)).any():
        turned = np.flatnonzero(np.sign(own * there).sum(axis=0) < 0)
        guess = f"The sign of interface DOF {listed(turned) or 'some'} is turned"
    elif len(bad) > 1 and np.allclose(np.sort(own.diagonal()[bad]), np.sort(there.diagonal()[bad]), rtol=AGREE):
        guess = f"Interface DOF {listed(bad)} are in another order"
    elif seen.words["factor"]:
        guess = "Bring both models to one system of units"
    elif 0 < len(bad) < len(own) and not np.delete(np.delete(wrong, bad, 0), bad, 1).any():
        guess = f"Look at interface DOF {listed(bad)}: their constraint modes or entries"
    return Seen(seen.figure, **seen.words, guess=guess)


def other_interface(case: Case) -> Sight:
    """Whether the reduced model and the full one list the same interface DOF in the same order; None if they do."""
    own, there = case.full_interface, case.whole.interface
    if own is None or not len(there) or np.array_equal(own, there):
        return None
    one_only = len(set(own.tolist()) ^ set(there.tolist()))
    if one_only:
        return Seen(1.0, why=f"the reduced model's interface has {len(own)} DOF, the full one's {len(there)}, and {one_only} are "
                    "in one list only")
    at = np.flatnonzero(own != there)[0] if len(own) == len(there) else 0
    return Seen(1.0, why=f"the reduced model and the full one list the same interface DOF in another order, first at place {at}")


def unmoved_interface(case: Case, V: Array, interface: Array) -> Sight:
    """The largest difference of the interface rows of V from B: each coordinate must move its own interface DOF by 1."""
    if len(interface) != len(case.rows):
        return None
    wrong = np.abs(V[case.rows] - case.B).max(axis=1)
    return Seen(wrong.max(initial=0.0), bad=listed(np.flatnonzero(wrong > AGREE)))


def unlike_projection(key: str, case: Case, V: Array) -> Sight:
    """A_reduced - VᵀAV relative to energies of single coordinates. MacNeal's M is that of its free modes Φ only: VᵀMΦΦᵀMV."""
    whole, A, size = case.whole, getattr(case.whole, key), np.abs(V)
    own, there = case.given.get(key, np.zeros_like(case.K)), V.T @ (A @ V)
    scale = there
    if key == "D":
        if not (own.any() or there.any()):
            return None
        # terms of VᵀDV may cancel, and D may be skew: its diagonal is no scale then
        scale = np.diag((size.T @ (abs(A) @ size) if there.any() else V.T @ (whole.M @ V)).diagonal())
    if key == "M" and not case.projected:
        massive = case.lowest(case.free, case.mass_rank - case.free.rigid.shape[1])
        part = massive.shapes.T @ (A @ V)
        there = part.T @ part
    apart = over_diagonal(own - there, scale, PRODUCTS * (size.T @ (abs(A) @ size)))
    bad = np.flatnonzero((apart > AGREE).sum(axis=1) > 0.5 * len(apart))
    blamed = 0 < len(bad) < 0.5 * len(apart)
    seen = unlike(apart, own, there)
    return Seen(seen.figure, **seen.words, advice=f"Coordinates {listed(bad)} are to blame: their columns of V, or their rows of "
                f"{key}" if blamed else f"V, or {key}, is of another model, or in other units")


def other_spectrum(case: Case) -> Sight:
    """All ω of the reduced model, compared with ω of the full model in the span of the shapes that the kinds name.

    This span is known for constraint and fixed-interface modes, and for free modes with the residual response to forces at the
    interface. ω does not depend on the choice of coordinates in the span, so V is not needed.
    """
    sub, basis, n_b = case.whole, case.basis, len(case.rows)
    if not case.kinds or not basis or not n_b or (basis == "held" and isinstance(case.statics, Finding)):
        return None
    rigid = 0 if basis == "held" else case.free.rigid.shape[1]
    # some modal coordinates of MacNeal's model may have been replaced by interface coordinates: count its modes by the rank of M
    kept = case.kinds.count(HELD_KIND if basis == "held" else "free") if case.projected else case.mass_rank - rigid
    if basis == "free" and not kept:  # Herting's model has one kind for modes and inertia relief
        if sub.ports:
            return None
        kept = max(0, case.size - n_b - rigid)
    if kept > case.most:
        return unknown(f"the model has {kept} modes, and only up to {case.most} are compared", "Give V")
    method = METHODS["craig-bampton" if basis == "held" else "craig-chang" if case.projected else "macneal"]
    columns = sum(np.size(column) // sub.size for column in sub.ports.values())
    try:
        again = case.reduced(method(kept), ports=case.size == kept + rigid + n_b + columns)
    except FemsubError:
        return None
    there, own = GivenModel.of(again).free_frequencies, case.free_frequencies
    elastic = there[case.free.rigid.shape[1]:]
    if len(own) != len(there) or not len(elastic) or not elastic[0]:
        return None  # dependent shapes were left out of one of the two
    beyond = np.maximum(np.abs(own**2 - there**2) - PRODUCTS * len(own) * there[-1] ** 2, 0.0)
    apart = beyond / np.maximum(there, elastic[0]) ** 2
    worst = int(apart.argmax())
    return Seen(apart[worst], mode=worst + 1, count=len(own), own=own[worst], there=there[worst])


def unlike_statics(case: Case) -> Sight:
    """XᵀKX, compared with the full model's stiffness condensed to the interface, if interface DOF are coordinates."""
    n_b, statics, U, X = len(case.rows), case.statics, case.parted[0], case.static
    if isinstance(statics, Finding):
        return statics
    if not len(case.B):
        return unknown("the reduced model's interface is not known", "State it, in the full one's order")
    if len(case.B) != n_b:
        return fault(f"the reduced model has {len(case.B)} interface DOF, the full one {n_b}",
                     "State both interfaces, in the same order")
    if case.interface is None:
        return None
    if X is None:
        return fault("with the interface held, the stiffness of the reduced model is singular or indefinite",
                     "A coordinate has no stiffness, or K is the matrix of another model")
    bare = case.whole.K.diagonal()[case.rows]
    C = np.abs(statics.V)
    floor = C.T @ (abs(case.whole.K) @ C) * PRODUCTS + EPS * np.sqrt(np.outer(bare, bare))
    own, there = X.T @ case.K @ X, U.T @ statics.K @ U
    rounding = np.abs(U).T @ floor @ np.abs(U) + np.abs(X).T @ (abs(case.K) @ np.abs(X)) * PRODUCTS
    return unlike_interface(over_diagonal(own - there, there, rounding), own, there)


def lost_statics(case: Case, V: Array, statics: ReducedSubstructure) -> Sight:
    """The share of the constraint modes that V leaves out, in the norm of K + ω²M: its M gives rigid motion an energy too."""
    if case.interface is not None or len(case.B) != len(case.rows):
        return None
    whole, elastic = case.whole, case.elastic_frequencies
    square = float(elastic[0]) ** 2 if len(elastic) else float(whole.K.diagonal().sum() / whole.M.diagonal().sum())
    A, shapes = whole.K + whole.M * square, statics.V @ case.parted[0]
    AC = A @ shapes
    gram = V.T @ (A @ V)
    unit = units(gram)
    q = unit[:, None] * np.linalg.lstsq(gram * np.outer(unit, unit), unit[:, None] * (V.T @ AC), rcond=1e-14)[0]
    rest = shapes - V @ q
    left = np.sqrt(np.abs(np.einsum("ij,ij->j", rest, A @ rest)) / np.einsum("ij,ij->j", shapes, AC)).max(initial=0.0)
    return Seen(left, left=left)


def unlike_inertia(case: Case, comparable: tuple[Array, Array, ReducedSubstructure]) -> Sight:
    """XᵀMX of a Ritz model, compared with CᵀMC of the full model, C its static response to motions of the interface."""
    U, X, statics = comparable
    own, there = X.T @ case.M @ X, U.T @ statics.M @ U
    return unlike_interface(over_diagonal(own - there, there), own, there)


def unlike_damping(case: Case, comparable: tuple[Array, Array, ReducedSubstructure], D: Array) -> Sight:
    """XᵀDX, compared with CᵀDC of the full model; only without V, since D = VᵀDV is the stricter check."""
    U, X, statics = comparable
    own, there, C = X.T @ D @ X, U.T @ statics.D @ U, np.abs(statics.V)
    if not (own.any() or there.any()):
        return None
    size = np.diag((C.T @ (abs(case.whole.D) @ C)).diagonal()) if there.any() else statics.M
    return unlike_interface(over_diagonal(own - there, U.T @ size @ U, PRODUCTS * size.max()), own, there)


def missing_motion(case: Case, moved: tuple[Array, Array, float | None]) -> Sight:
    """The share of the full model's rigid motion that V leaves out, if the interface does not distinguish rigid motions."""
    return None if moved[2] is None else Seen(moved[2], left=moved[2])


def moved_strain(case: Case) -> Sight:
    """The strain energy in the reduced model of the full model's rigid motion."""
    if isinstance(case.moved, Finding):
        return case.moved
    q, Z, _ = case.moved
    return Seen(case.strain(q), count=Z.shape[1]) if Z.shape[1] else good("the full model is held", 0.0, EQUAL)


def other_inertia(case: Case, moved: tuple[Array, Array, float | None]) -> Sight:
    """qᵀMq - I in the reduced model, for the full model's rigid motion q, which is normalised to unit mass."""
    P = moved[0].T @ case.M @ moved[0]
    return Seen(np.abs(P - np.eye(len(P))).max(), masses=", ".join(f"{one:.6g}" for one in P.diagonal()),
                factor=common_factor(P, np.eye(len(P)))) if len(P) else None


def uncounted(case: Case) -> Sight:
    """The difference of the numbers of modes below the cut-off, for the full model by the inertia of K - ω²M.

    Without a stated cut-off, a finding about the first mode that is left out.
    """
    kept, cut = case.kept, case.cutoff
    if isinstance(kept, Finding):
        return kept
    own, full = kept.tally.listed, kept.tally.counted
    if kept.modes is None:
        return good("nothing is left out" if own else "all DOF are interface")
    if np.isfinite(cut) and full is not None:
        return Seen(abs(full - own), counted=full, cut=cut, listed=own, advice="Keep all modes below the cut-off, or state a "
                    "lower one" if full > own else "A mode is listed twice, or is no mode of the full model")
    if np.isinf(kept.first):
        return good("")
    if np.isinf(cut):
        return fault(f"the model states that no mode is left out, but a mode at {kept.first:.6g} rad/time is missing",
                     "State this cut-off")
    return good(f"no cut-off is stated; the first mode that is left out is at {kept.first:.6g} rad/time")


def unconverged(case: Case, kept: KeptModes) -> Sight:
    """The largest relative difference in ω² of a kept mode from the nearest mode of the full model."""
    off = kept.apart.max(initial=0.0)
    return Seen(off, mode=int(kept.apart.argmax()) + 1, off=off) if len(kept.apart) else None


def unlike_coupling(case: Case, kept: KeptModes, statics: ReducedSubstructure, static: Array) -> Sight:
    """M_bi: the participation Σ p pᵀ of each cluster of modes in motions of the interface, compared with the full model's.

    A rotation of the modes within their cluster does not change this sum.
    """
    U, at, C = case.parted[0], case.modal, statics.V
    if kept.modes is None or case.basis != "held" or len(U) != len(case.rows) or "static port" in case.kinds:
        return None
    mass = np.abs(case.M.diagonal()[at])
    own = static.T @ case.M[:, at] / np.sqrt(np.where(mass > 0, mass, 1.0))
    true = U.T @ (C.T @ (case.whole.M[:, case.inside] @ kept.modes.shapes))
    size = np.sqrt((U.T @ statics.M @ U).diagonal())
    omega, there = case.modal_frequencies, kept.modes.frequencies
    worst, where, start = 0.0, 0.0, 0
    for end in np.flatnonzero(np.append(np.diff(there) > SHAPED * there[1:], True)) + 1:
        mine = (omega >= there[start] * (1 - SHAPED)) & (omega <= there[end - 1] * (1 + SHAPED))
        complete = end < len(there) or len(there) == len(case.inside)
        if mine.sum() == end - start and complete:
            p, q = own[:, mine] / size[:, None], true[:, start:end] / size[:, None]
            gap = float(np.abs(p @ p.T - q @ q.T).max(initial=0.0)) / max(float((q * q).sum(axis=1).max(initial=0.0)), SHAPED)
            worst, where = max((worst, where), (gap, float(there[start])))
        start = end
    return Seen(worst, omega=where)


def lowered(case: Case, frequencies: tuple[Array, Array]) -> Sight:
    """The largest relative distance by which a frequency of a Ritz model lies below the full model's."""
    own, there = frequencies
    if not len(own):
        return None
    worst = int((1 - own / there).argmax())
    return Seen(max(1 - own[worst] / there[worst], 0.0), mode=worst + 1, own=own[worst], there=there[worst])


def unbounded(case: Case, frequencies: tuple[Array, Array], bounds: Any) -> Sight:
    """The largest relative distance by which a frequency of the full model lies below its bound from the small matrices."""
    there, bound = (values[:min(len(bounds.lower), len(frequencies[1]))] for values in (frequencies[1], bounds.lower))
    if not len(there) or not np.isfinite(case.cutoff) or not case.kinds or bounds.rigid != case.free.rigid.shape[1]:
        return None
    worst = int((1 - there / bound).argmax())
    return Seen(max(1 - there[worst] / bound[worst], 0.0), mode=worst + 1, there=there[worst], bound=bound[worst])


def unseen_modes(case: Case) -> Sight:
    """The finding that the small matrices do not show missing modes."""
    return unknown("whether one is missing cannot be known from the small matrices", "Give the full M and K")


def unknown_frequencies(case: Case) -> Sight:
    """Why the full model's frequencies, or bounds of them without it, are not known; None if they are known."""
    return case.frequencies if isinstance(case.frequencies, Finding) else None


class Check(NamedTuple):
    """One check of an audit.

    Attributes
    ----------
    what : str
        Its name.
    needs : str
        Its requirements, separated by commas: keys of `Case.has`, or attributes of the case that must be known. If one of them
        is not met, the check is left out.
    figure : callable
        A function of the case and the values of those attributes. It returns the figure, a finding without a limit, or None.
    limit : float, optional
        The largest good figure. Without a limit any figure above 0 is a fault, and no figure is shown.
    said, todo : str
        The sentence of a fault and the advice, filled with the words of the figure.
    stops : bool
        Whether a fault ends the audit.
    """

    what: str
    needs: str
    figure: Callable[..., Sight]
    limit: float | None = None
    said: str = ""
    todo: str = ""
    stops: bool = False

    def run(self, case: Case) -> Finding | None:
        """The finding for a case; None if a requirement is not met, or if the check does not apply."""
        given = []
        for word in filter(None, self.needs.split(", ")):
            value = case.has[word] if word in case.has else getattr(case, word)
            if value is None or value is False or isinstance(value, Finding):
                return None
            given += [value] if value is not True else []
        seen = self.figure(case, *given)
        if isinstance(seen, Finding):
            return replace(seen, what=self.what)
        if not isinstance(seen, Seen):
            return None
        figure = None if self.limit is None else float(seen.figure)
        if seen.figure <= (self.limit or 0.0):
            return Finding(self.what, GOOD, "", figure, self.limit)
        return Finding(self.what, FAULT, self.said.format(**seen.words), figure, self.limit, self.todo.format(**seen.words))


#: names and sentences that several checks share
LEFT_OUT = "Take matrices and lists of one and the same model. Nothing else was checked"
STRAINED = "rigid motion strains nothing"
LOOK = "Look at the {} of coordinate {{at}}: a sign, an entry that is lost, or columns in another order"
TRIANGLES = "Write both triangles, and the same ones; half of a symmetric file may have been read"
PLACE = "{} between interface DOF {{i}} and {{j}} is {{own:.6g}}, but {{there:.6g}} in the full model{{factor}}"
ENTRY = "{0}[{{i}}, {{j}}] is {{own:.6g}}, but {1} gives {{there:.6g}}{{factor}}"
BELOW = "modes below the cut-off"
OTHERS = "M, K or both are of another model, or in other units"

CHECKS = (
    Check("entries are numbers", "", not_numbers, None, "{key} holds a NaN or Inf, first at row {row}, column {column}",
          "Write the matrices again. Nothing else was checked", stops=True),
    Check("sizes fit", "", misfits, None, "{wrong}", LEFT_OUT, stops=True),
    Check("same full model", "full", other_model, None, "{wrong}", "The reduction is of another model", stops=True),
    # checks of the small matrices
    Check("digits", "", rounded, 1e-8, "the entries of {key} end after about {digits:.0f} digits",
          "Write them with all digits (17): low modes and rigid motion are small differences of large entries"),
    Check("M symmetric", "", partial(skew, "M"), EQUAL, "M[{i}, {j}] = {one:.6g}, but M[{j}, {i}] = {other:.6g}", TRIANGLES),
    Check("K symmetric", "", partial(skew, "K"), EQUAL, "K[{i}, {j}] = {one:.6g}, but K[{j}, {i}] = {other:.6g}", TRIANGLES),
    Check("M positive", "", partial(negative, "M"), EQUAL,
          "M has a negative eigenvalue, mostly in coordinate {at}: some motion has negative kinetic energy", LOOK.format("mass")),
    Check("K positive", "", partial(negative, "K"), EQUAL,
          "K has a negative eigenvalue, mostly in coordinate {at}: a deformation would release energy",
          LOOK.format("stiffness")),
    Check("coordinates independent", "", dependent),
    Check("D symmetric", "D, damped", gyroscopic, EQUAL, "a share of {share:.1e} of D is skew, and the part is not said to turn",
          "If it turns, state it (gyroscopic); otherwise an entry or a triangle of D is lost"),
    Check("D takes energy out", "D, damped", feeding, EQUAL,
          "D has a negative eigenvalue, mostly in coordinate {at}: it feeds energy in",
          "Look at its sign. Friction with a falling characteristic belongs to a contact, not to D"),
    Check("modes orthonormal", "", unlike_modes, AGREE, "ΦᵀMΦ is not I, or ΦᵀKΦ is not diagonal: {why}",
          "Normalise the modes to mass 1, the matrices with them; modes that are not orthogonal have not converged"),
    Check("modes and interface share no stiffness", "", shared_stiffness, AGREE,
          "ΨᵀKΦ is not 0 between constraint modes Ψ and fixed-interface modes Φ",
          "The constraint modes are not the static response of this K: compute them again, K_ii Ψ_i = -K_ib"),
    Check("mass that the modes move", "mapped", moved_mass),
    # checks that are better done against the full model, if it is given
    Check("no mode twice", "alone, no V", alike_modes),
    Check(STRAINED, "alone, motion", carried_strain, EQUAL, "the rigid motion that the model carries has an elastic energy",
          "K has been changed, or grounded by a spring, since it was reduced"),
    Check(STRAINED, "alone", mapped_strain),
    Check("mass and inertia", "alone, body", unlike_body, AGREE,
          "the masses along x, y, z are {masses}, or moments do not fit a rigid body",
          "Mass is lost, DOF are swapped, or rotations have other units than translations"),
    Check("mass as stated", "alone, body, mass", other_mass, 0.01, "the mass is {mass:.6g}, but {stated:.6g} is stated{factor}",
          "Check density and units"),
    Check("units fit", "alone, body", implausible),
    # checks against the full model
    Check("interface list", "full", other_interface, None, "{why}", "Take the list that the reduction was made with"),
    Check("V moves the interface", "full, V, interface", unmoved_interface, AGREE,
          "V does not move interface DOF {bad} by 1 when their coordinates are 1",
          "The interface list, its order or a sign is not that of V"),
    Check("M = VᵀMV", "full, V, projected", partial(unlike_projection, "M"), AGREE, ENTRY.format("M", "VᵀMV"), "{advice}"),
    Check("M = VᵀMΦΦᵀMV", "full, V, massless", partial(unlike_projection, "M"), AGREE, ENTRY.format("M", "VᵀMV"), "{advice}"),
    Check("K = VᵀKV", "full, V", partial(unlike_projection, "K"), AGREE, ENTRY.format("K", "VᵀKV"), "{advice}"),
    Check("D = VᵀDV", "full, V", partial(unlike_projection, "D"), AGREE, ENTRY.format("D", "VᵀDV"), "{advice}"),
    Check("frequencies of the shapes stated", "full, no V", other_spectrum, AGREE,
          "frequency {mode} of all {count} is {own:.6g}, but {there:.6g} in the span of the shapes that the kinds name",
          "An entry of M or K is wrong, or the coordinates are not what their kinds say"),
    Check("static interface response", "full", unlike_statics, AGREE, PLACE.format("the condensed stiffness"), "{guess}"),
    Check("static interface response", "full, V, statics", lost_statics, SHAPED,
          "V leaves out a share of {left:.1e} of the static response to a motion of the interface, in the energy norm",
          "Add the static shapes of the interface: constraint modes, or residual attachment modes"),
    Check("inertia seen from the interface", "full, projected, comparable", unlike_inertia, AGREE,
          PLACE.format("the mass of static shapes"), "{guess}"),
    Check("damping seen from the interface", "full, no V, comparable, D", unlike_damping, AGREE,
          PLACE.format("the damping of static shapes"), "{guess}"),
    Check("V has the rigid motion", "full, moved", missing_motion, AGREE, "a share of {left:.2g} of it is missing",
          "Add rigid-body modes or constraint modes to the basis"),
    Check(STRAINED, "full", moved_strain, EQUAL,
          "the full model has {count} rigid motions, which have an elastic energy in the reduced one",
          "A spring to the ground, swapped or turned DOF, or entries with few digits"),
    Check("mass and inertia", "full, moved", other_inertia, AGREE,
          "in rigid motion, the masses of the reduced model are {masses} times the full model's{factor}",
          "Mass is lost or counted twice, or density or units differ"),
    Check(BELOW, "full", uncounted, 0.0,
          "the full model has {counted} modes below the stated cut-off {cut:.6g} rad/time, the reduced one {listed}", "{advice}"),
    Check("modes converged", "full, kept", unconverged, AGREE,
          "mode {mode} of the reduced model is no mode of the full one: ω² is off by {off:.1e}",
          "Compute it again with a tighter tolerance; or the model is reduced from other matrices, or its coordinates are no "
          "modes: state their kinds"),
    Check("coupling of modes and interface (M_bi)", "full, kept, statics, static", unlike_coupling, SHAPED,
          "the participation of the modes near ω = {omega:.6g} in motions of the interface differs from the full model's",
          "The block M_bi is lost, transposed or scaled, or its columns are in another order than the modes"),
    Check("frequencies not below the full model's", "full, projected, frequencies", lowered, AGREE,
          "mode {mode} has ω = {own:.6g}, but {there:.6g} in the full model; no projection lowers it", OTHERS),
    Check("frequencies within their bounds", "full, frequencies, bounds", unbounded, AGREE,
          "elastic mode {mode} of the full model has ω = {there:.6g}, below the bound {bound:.6g} by the stated cut-off",
          "The cut-off differs from the stated one, or the matrices belong to another model"),
    # what cannot be known
    Check(BELOW, "alone", unseen_modes),
    Check("frequencies", "", unknown_frequencies))


def findings(case: Case) -> tuple[Finding, ...]:
    """Runs the checks whose requirements the case meets, in the order of the table."""
    found = []
    for check in CHECKS:
        one = check.run(case)
        found += [] if one is None else [one]
        if one is not None and one.verdict == FAULT:
            case.sound &= "full" in check.needs
            case.stopped = check.stops
            if check.stops:
                break
    return tuple(found)
