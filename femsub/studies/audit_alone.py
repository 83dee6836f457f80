"""What the small matrices of a reduced model show by themselves, without the full model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Array
from femsub.studies.audit_model import (
    FAULT,
    GOOD,
    UNKNOWN,
    Finding,
    Model,
    coupling,
    listed,
    off_diagonal,
    scaled,
    units,
)

if TYPE_CHECKING:
    from femsub.model import DofMap

SYMMETRY = 1e-9  # as that of `Substructure`
NEGATIVE = 1e-9  # eigenvalue of a matrix with diagonal 1 that counts as rounding
SINGULAR = 1e-10  # the same for a motion that has neither mass nor stiffness
ORTHONORMAL = 1e-6  # as good as other programs' eigensolvers
FREE = 1e-9  # energy of a motion over that of its single DOF up to which it strains nothing
SOFT = 1e-4  # and up to which it may be a soft mount, or a spring that nobody meant
INERTIA = 1e-6  # of the mass matrix of a rigid body
FLOOR = 1e-9  # of the largest rate of damping: below, a diagonal entry of D is rounding
STATED = 0.01  # of a mass that is stated
TWICE = 1e-9
#: plausible solids: mass over the cube of the interface's extent [kg/m³], and the largest wave speed [m/s]
DENSITY, SPEED = (1e-2, 1e8), 2e4
#: unit of length in m, of mass in kg
SYSTEMS = {"SI": (1.0, 1.0), "mm-t-s": (1e-3, 1e3)}
AXES = ("ux", "uy", "uz", "rx", "ry", "rz")


def numbers(model: Model) -> Finding:
    """Whether all entries are finite."""
    bad = [key for key in "MKDV" if (A := getattr(model, key)) is not None and not np.isfinite(A).all()]
    if not bad:
        return Finding("entries are numbers", GOOD)
    at = np.argwhere(~np.isfinite(getattr(model, bad[0])))[0]
    return Finding("entries are numbers", FAULT, f"{bad[0]} holds a NaN or Inf, first at row {at[0]}, column {at[1]}",
                   todo="Write the matrices again. Nothing else was checked")


def sizes(model: Model) -> Finding:
    """Whether shapes and lists belong together."""
    r, wrong = model.size, ""
    shapes = {key: A.shape for key in "MKDV" if (A := getattr(model, key)) is not None}
    if bad := [key for key in "MKD" if shapes.get(key, (r, r)) != (r, r)]:
        wrong = f"{bad[0]} is {' x '.join(map(str, shapes[bad[0]]))}, M has {r} rows"
    elif len(shapes.get("V", (0, r))) != 2 or shapes.get("V", (0, r))[1] != r:
        wrong = f"V is {' x '.join(map(str, shapes['V']))}, but there are {r} coordinates"
    elif model.kinds and len(model.kinds) != r:
        wrong = f"{len(model.kinds)} kinds are stated for {r} coordinates"
    elif model.places is not None and (np.any(model.places < 0) or np.any(model.places >= r)
                                       or len(np.unique(model.places)) < len(model.places)):
        wrong = f"the interface names a coordinate twice, or one outside 0 to {r - 1}"
    elif model.rows is not None and model.V is not None and np.any(model.rows >= len(model.V)):
        wrong = f"the interface names row {int(model.rows.max())}, but V has {len(model.V)} rows"
    elif model.dofs is not None and len(model.B) and model.dofs.size != len(model.B):
        wrong = f"the DOF map has {model.dofs.size} DOF, the interface {len(model.B)}"
    return Finding("sizes fit", FAULT if wrong else GOOD, wrong,
                   todo="Take matrices and lists of one and the same model. Nothing else was checked" if wrong else "")


def alone(model: Model, known: bool, active: bool | None = False) -> Iterator[Finding]:
    """All checks that need no full model. With a full model `known`, what it decides better is left to it.

    `active` is whether the D of the full model feeds energy in; None if that is not known.
    """
    for key, A in (("M", model.M), ("K", model.K)):
        yield _symmetric(key, A)
    yield _definite(model)
    yield _semidefinite("K", model.K, "stiffness", "energy would be won by a deformation")
    yield _independent(model)
    if model.D is not None and model.D.any():
        yield from _damping(model, active)
    yield from _modal(model)
    if not known:
        yield from _twice(model)
        yield from rigid(model)
        yield _stated_mass(model, None)


def _symmetric(key: str, A: Array) -> Finding:
    size = np.sqrt(np.abs(A.diagonal()))
    skew = np.abs(A - A.T)
    share = np.divide(skew, np.outer(size, size), out=np.where(skew > 0, np.inf, 0.0), where=np.outer(size, size) > 0)
    i, j = np.unravel_index(int(share.argmax()), share.shape)
    return Finding.of(f"{key} symmetric", float(share[i, j]), SYMMETRY,
                      f"{key}[{i}, {j}] = {A[i, j]:.6g}, but {key}[{j}, {i}] = {A[j, i]:.6g}",
                      "Write both triangles, and the same ones; half of a symmetric file may have been read")


def _lowest(A: Array) -> tuple[float, int]:
    """The lowest eigenvalue of A with diagonal 1, and the coordinate that moves most in it."""
    values, vectors = np.linalg.eigh(scaled((A + A.T) / 2))
    return float(values[0]), int(np.abs(vectors[:, 0]).argmax())


def _semidefinite(key: str, A: Array, what: str, why: str) -> Finding:
    lowest, at = _lowest(A)
    return Finding.of(f"{key} positive", -lowest if lowest < 0 else 0.0, NEGATIVE,
                      f"{key} has a negative eigenvalue, mostly in coordinate {at}: {why}",
                      f"Look at the {what} of coordinate {at}: a sign, an entry that is lost, or columns in another order")


def _definite(model: Model) -> Finding:
    found = _semidefinite("M", model.M, "mass", "some motion has negative kinetic energy")
    bare = model.massless
    if found.verdict == FAULT or not len(bare):
        return found
    if model.projected:
        return Finding("M positive", FAULT, f"coordinates {listed(bare)} have stiffness but no mass", float(len(bare)), 0.0,
                       "The mass at the interface is lost: take M_bb of the reduction as well, as CᵀMC")
    return Finding("M positive", GOOD, f"{len(bare)} interface DOF without mass, as MacNeal's", found.figure, found.limit)


def _independent(model: Model) -> Finding:
    """No motion may have neither mass nor stiffness; coordinates that are all zero are reported."""
    some = np.flatnonzero(model.M.any(axis=0) | model.K.any(axis=0))
    if len(some) < model.size and "interface force" not in model.kinds:
        empty = np.setdiff1d(np.arange(model.size), some)
        return Finding("coordinates independent", FAULT, f"coordinates {listed(empty)} have neither mass nor stiffness",
                       float(len(empty)), 0.0, "Leave these columns out")
    M, K = (A[np.ix_(some, some)] for A in (model.M, model.K))
    whole = M + K * (M.diagonal().sum() / K.diagonal().sum() if K.diagonal().sum() > 0 else 1.0)
    values, vectors = np.linalg.eigh(scaled(whole))
    x = vectors[:, 0] * units(whole)
    share = max(_share(A, x) for A in (M, K))
    at = some[np.argsort(-np.abs(vectors[:, 0]))[:2]]
    if values[0] > SINGULAR or values[0] < -NEGATIVE or share > SINGULAR:
        return Finding("coordinates independent", GOOD)
    return Finding("coordinates independent", FAULT, f"a motion of coordinates {listed(at)} has neither mass nor stiffness: one "
                   "of them is a copy of others", share, SINGULAR, "Leave one out: a mode is listed twice")


def _share(A: Array, x: Array) -> float:
    """|xᵀAx| over the energy of the single coordinates."""
    whole = float(x**2 @ np.abs(A.diagonal()))
    return abs(float(x @ A @ x)) / whole if whole > 0 else 0.0


def _damping(model: Model, active: bool | None) -> Iterator[Finding]:
    assert model.D is not None
    D = model.D
    skew = float(np.linalg.norm(D - D.T) / (2 * np.linalg.norm(D)))
    if skew > SYMMETRY and model.gyroscopic:
        yield Finding("D symmetric", GOOD, f"the part turns: {skew:.1e} of D is gyroscopic", skew)
    else:
        yield Finding.of("D symmetric", skew, SYMMETRY, f"a share of {skew:.1e} of D is skew, and the part is not said to turn",
                         "If it turns, state it (gyroscopic); else an entry is lost, or a triangle is")
    size = np.sqrt(np.maximum(D.diagonal(), 0.0) + FLOOR * sum(_largest(D, A) * A.diagonal() for A in (model.M, model.K)))
    size = np.where(size > 0, size, max(float(size.max()), float(np.sqrt(np.abs(D).max()))))
    values, vectors = np.linalg.eigh((D + D.T) / 2 / np.outer(size, size))
    at = int(np.abs(vectors[:, 0]).argmax())
    if (model.gyroscopic or active is not False) and values[0] < -NEGATIVE:
        if not active:  # the full model's own does the same otherwise
            yield Finding("D takes energy out", UNKNOWN, "its symmetric part feeds energy in, as friction on a part that turns "
                          "may do", float(-values[0]), NEGATIVE, "Look at D of the full model")
        return
    yield Finding.of("D takes energy out", float(-values[0]) if values[0] < 0 else 0.0, NEGATIVE,
                     f"D has a negative eigenvalue, mostly in coordinate {at}: it feeds energy in",
                     "Look at its sign. Friction with a falling characteristic belongs to a contact, not to D")


def _largest(D: Array, A: Array) -> float:
    """The largest d_ii / a_ii that is positive, or 0."""
    there = A.diagonal() > 0
    return float((D.diagonal()[there] / A.diagonal()[there]).max(initial=0.0))


def _modal(model: Model) -> Iterator[Finding]:
    """Modes are orthonormal in M, orthogonal in K, and share no stiffness with constraint modes."""
    at = model.modal
    if not len(at):
        if not model.kinds and model.size > len(model.B):
            yield Finding("modes orthonormal", UNKNOWN, "which coordinates are modes is not stated, and they do not look like it",
                          todo="State the kinds of the coordinates, or the interface")
        return
    M, K = (A[np.ix_(at, at)] for A in (model.M, model.K))
    mixed, length = max(off_diagonal(M), off_diagonal(K)), float(np.abs(M.diagonal() - 1).max())
    stated = bool(model.kinds)
    why = f"the masses of modes differ from 1 by up to {length:.2g}" if stated and length > mixed else \
        f"modes share up to {mixed:.2g} of their energy"
    yield Finding.of("modes orthonormal", max(mixed, length if stated else 0.0), ORTHONORMAL, "ΦᵀMΦ is not I, or ΦᵀKΦ is not "
                     f"diagonal: {why}", "Normalise the modes to mass 1, the matrices with them; modes that are not orthogonal "
                     "have not converged")
    if model.basis == "held" and len(at) < model.size:
        others = np.setdiff1d(np.arange(model.size), at)
        yield Finding.of("modes and interface share no stiffness", coupling(model.K, others, at), ORTHONORMAL,
                         "ΨᵀKΦ is not 0 between constraint modes Ψ and fixed-interface modes Φ",
                         "The constraint modes are not the static response of this K: compute them again, K_ii Ψ_i = -K_ib")


def _twice(model: Model) -> Iterator[Finding]:
    """Two modes with the same frequency that move the interface alike; of a symmetric part that may be so."""
    at = model.modal
    if model.V is not None or len(at) < 2:
        return
    others = np.setdiff1d(np.arange(model.size), at)
    mass = model.M.diagonal()[at]
    square = model.K.diagonal()[at] / np.where(mass > 0, mass, 1.0)
    moved = np.vstack([model.M[np.ix_(others, at)], model.K[np.ix_(others, at)]])
    for i in np.argsort(square)[:-1]:
        near = np.flatnonzero((np.abs(square - square[i]) <= TWICE * abs(square[i])) & (np.arange(len(at)) > i))
        for j in near:
            if moved[:, i].any() and min(np.abs(moved[:, i] - s * moved[:, j]).max() for s in (1, -1)) <= TWICE * np.abs(
                    moved[:, i]).max():
                yield Finding("no mode twice", UNKNOWN, f"coordinates {at[i]} and {at[j]} have one frequency and act on the "
                              "interface alike: a mode listed twice, or a symmetric part", todo="Give V, or the full model")
                return


def motions(dofs: DofMap) -> tuple[Array, bool]:
    """Rigid motions of the DOF of a map (n_b, k) about the middle of its points, and whether they are all six.

    Translations come first. Rotations need points. A plate's w with its slopes has three.
    """
    labels = np.array([dofs.labels[one] for one in dofs.components])
    deep = np.zeros((len(labels), 3))
    if dofs.points is not None:
        deep[:, :dofs.points.shape[1]] = dofs.points - dofs.points.mean(axis=0)
    x, y, z = deep.T
    if np.isin(labels, ("w", "w,x", "w,y")).all():
        flat = np.stack([labels == "w", np.where(labels == "w", x, labels == "w,x"), np.where(labels == "w", y, labels == "w,y")],
                        axis=1).astype(float)
        few = 1 if dofs.points is None else 1 + min(dofs.points.shape[1], 2)
        return flat[:, :few], False
    if not np.isin(labels, AXES).all():
        return np.zeros((len(labels), 0)), False
    kind = np.array([AXES.index(label) for label in labels])
    found = np.eye(6)[kind]
    none = np.zeros_like(x)
    turned = np.stack([[none, z, -y], [-z, none, x], [y, -x, none]])  # ω × x, by the direction of the DOF and the axis
    for axis in range(3):
        found[kind == axis, 3:] = turned[axis][:, kind == axis].T
    if dofs.points is None or dofs.points.shape[1] < 3:
        return found[:, :3], False
    return found, bool(np.isin(np.arange(3), kind).all())


def rigid(model: Model) -> Iterator[Finding]:
    """K r = 0, and the mass matrix of a rigid body, of motions by the DOF map; without one, of the motion that is carried."""
    what = "rigid motion strains nothing"
    if model.motion is not None and model.motion.shape[1]:
        yield Finding.of(what, strain(model, model.motion), FREE, "the rigid motion that the model carries has an "
                         "elastic energy", "K has been changed, or grounded by a spring, since it was reduced")
    if model.dofs is None or model.static is None or not len(model.B):
        if model.motion is None or not model.motion.shape[1]:
            yield Finding(what, UNKNOWN, "nothing says where the interface DOF are and how they move", todo="Give the DOF map "
                          "of the interface, with points (dofs), or the full model")
        return
    U, X = model.parted[0], model.static
    R, whole = motions(model.dofs)
    R = R[:, np.abs(R).any(axis=0)]
    S = X.T @ model.K @ X
    at = U.T @ R
    weight = model.energy_unit(S, X.T @ model.M @ X, R.shape[1])
    weight = np.where(weight > 0, weight, 1.0)
    free = int(np.count_nonzero(np.linalg.eigvalsh(S / np.sqrt(np.outer(weight, weight))) <= FREE))
    seen = U.shape[1] == len(U)
    R, at = _apart(R, at)
    if not R.shape[1] or not seen:
        yield Finding(what, UNKNOWN, "the DOF map has no translations that are known, or the interface moves in shapes only",
                      todo=f"Labels that are known: {', '.join(AXES)}, w, w,x and w,y")
        return
    energy = _energies(S, weight, at)
    loose = energy <= FREE
    soft = ~loose & (energy <= SOFT)
    count = int(loose.sum())
    if model.floating and count < R.shape[1]:
        yield Finding(what, FAULT, f"the part floats, but {R.shape[1] - count} of {R.shape[1]} rigid motions have an elastic "
                      "energy", float(energy.max()), FREE, _why_strained(energy))
    elif free > count and whole:
        yield Finding(what, FAULT, f"K has {free} motions without energy, but by the DOF map only {count} are rigid motion",
                      float(energy.max()), FREE, _why_strained(energy))
    elif soft.any():
        yield Finding(what, UNKNOWN, f"{int(soft.sum())} rigid motions have very little energy: a soft mount, or a spring that "
                      "nobody meant", float(energy[soft].max()), FREE, "State whether the part floats (floating), or give the "
                      "full model")
    elif count:
        yield Finding(what, GOOD, f"{count} rigid motions are free", float(energy[loose].max()), FREE)
    else:
        yield Finding(what, UNKNOWN, "the part is held, so far as K shows", float(energy.min()), FREE,
                      "State whether it floats (floating), or give the full model")
    if whole and count == R.shape[1] == 6:
        yield from _body(model, X @ at, R)


def _why_strained(energy: Array) -> str:
    if energy.max() <= SOFT:
        return "A soft spring to the ground, or entries with few digits. Write all digits, and remove the spring"
    return "DOF are swapped, have another sign or other units, or the map belongs to another model: compare it DOF by DOF"


def strain(model: Model, q: Array) -> float:
    """The largest qᵀKq of the columns of q, over the energy of the single coordinates."""
    whole = q.T**2 @ model.energy_unit(model.K, model.M, q.shape[1])
    return float((np.abs(np.einsum("ij,ij->j", q, model.K @ q)) / np.where(whole > 0, whole, 1.0)).max(initial=0.0))


def _apart(R: Array, at: Array) -> tuple[Array, Array]:
    """The motions that the interface can distinguish."""
    size = np.linalg.norm(at, axis=0)
    keep: list[int] = []
    for j in range(at.shape[1]):
        if size[j] > 0 and np.linalg.matrix_rank(at[:, [*keep, j]] / size[[*keep, j]], tol=1e-6) > len(keep):
            keep.append(j)
    return R[:, keep], at[:, keep]


def _energies(S: Array, weight: Array, at: Array) -> Array:
    """The energies of combinations of motions, relative to that of the single DOF, in ascending order."""
    q = np.linalg.qr(np.sqrt(weight)[:, None] * at)[0]
    return np.abs(np.linalg.eigvalsh(q.T @ (S / np.sqrt(np.outer(weight, weight))) @ q))


def body(P: Array, length: float) -> tuple[float, Array, float]:
    """Mass, centre and how far P (6, 6) is from [[m I, -m c×], [m c×, J]] of a rigid body, relative."""
    m = float(np.trace(P[:3, :3])) / 3
    if m <= 0:
        return m, np.zeros(3), np.inf
    moment = (P[:3, 3:] - P[:3, 3:].T) / 2
    centre = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / m
    reach = max(length, float(np.sqrt(max(np.trace(P[3:, 3:]), 0.0) / m)))
    wrong = np.abs(P[:3, :3] - m * np.eye(3)).max() / m
    skew = np.abs(P[:3, 3:] + P[:3, 3:].T).max() / (2 * m * reach)
    arm = np.array([[0, -centre[2], centre[1]], [centre[2], 0, -centre[0]], [-centre[1], centre[0], 0]])
    axes = np.linalg.eigvalsh(P[3:, 3:] + m * arm @ arm)  # about the centre
    unlike = max(axes[2] - axes[0] - axes[1], -axes[0], 0.0) / (m * reach**2)
    return m, centre, float(max(wrong, skew, unlike))


def _body(model: Model, q: Array, R: Array) -> Iterator[Finding]:
    assert model.dofs is not None and model.dofs.points is not None
    P = q.T @ model.M @ q
    length = float(np.ptp(model.dofs.points, axis=0).max())
    m, centre, wrong = body(P, length)
    centre = centre + model.dofs.points.mean(axis=0)
    place = ", ".join(f"{one:.4g}" for one in centre)
    yield Finding("mass and inertia", GOOD if wrong <= INERTIA else FAULT, f"mass {m:.6g}, its centre at ({place})" if
                  wrong <= INERTIA else f"the masses along x, y, z are {', '.join(f'{one:.6g}' for one in P.diagonal()[:3])}, or "
                  "moments do not fit a rigid body", wrong, INERTIA, "" if wrong <= INERTIA else
                  "Mass is lost, DOF are swapped, or rotations have other units than translations")
    if model.mass is not None:
        yield _stated_mass(model, m)
    yield _plausible(model, m, length)


def _stated_mass(model: Model, m: float | None) -> Finding:
    if m is None or model.mass is None:
        return Finding("", GOOD)
    ratio = m / model.mass
    return Finding.of("mass as stated", abs(ratio - 1), STATED, f"the mass is {m:.6g}, but {model.mass:.6g} is stated"
                      f"{factor(ratio)}", "Check density and units")


def factor(ratio: float) -> str:
    """What a factor between two models may come from."""
    known = {1e3: "t against kg, or N/mm against N/m", 1e6: "mm against m, squared", 1e9: "mm³ against m³",
             1e12: "t/mm³ against kg/m³", 9.80665: "weight for mass", 9806.65: "weight for mass in mm",
             386.0886: "weight for mass in inches (WTMASS)", 0.0254: "inches against m", 25.4: "inches against mm",
             4.4482216: "lbf against N", 0.45359237: "lb against kg"}
    for value, why in known.items():
        for one in (value, 1 / value):
            if ratio > 0 and abs(ratio / one - 1) < 2e-3:
                return f", by a factor of {ratio:.4g} (as {why})"
    return f", by a factor of {ratio:.6g}" if ratio > 0 else ""


def _plausible(model: Model, m: float, length: float) -> Finding:
    what = "units fit"
    if model.units not in SYSTEMS:
        return Finding(what, UNKNOWN, "the system of units is not stated", todo="State units ('SI' or 'mm-t-s')")
    if not length:
        return Finding(what, UNKNOWN, "the interface is one point")
    metre, kilogram = SYSTEMS[model.units]
    density = m * kilogram / (length * metre) ** 3
    omega = model.free_frequencies[model.free_frequencies > 1e-3 * model.free_frequencies.max()]
    speed = float(omega.min(initial=0.0)) * length * metre / np.pi
    good = DENSITY[0] <= density <= DENSITY[1] and speed <= SPEED
    return Finding(what, GOOD if good else FAULT, "" if good else f"in {model.units} units the mass over the interface's extent "
                   f"cubed is {density:.2g} kg/m³, and the first elastic frequency needs waves of {speed:.2g} m/s", density,
                   DENSITY[1], "" if good else "No solid is like that: lengths, masses or times are in other units")
