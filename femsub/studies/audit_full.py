"""A reduced model against the full one: every statement is a bound, a count, or an equation that holds or does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import EPS, Array, Matrix, Tally
from femsub.errors import FemsubError
from femsub.model import rounding_of
from femsub.modes import ShiftInvert, lowest_modes, modes_under, motion_of
from femsub.studies.audit_alone import FREE, STATED, factor, strain
from femsub.studies.audit_model import (
    FAULT,
    GOOD,
    HELD_KIND,
    UNKNOWN,
    Finding,
    Model,
    frequencies,
    listed,
    units,
    within,
)

if TYPE_CHECKING:
    from femsub.model import RigidMotion, Substructure
    from femsub.modes import NormalModes

SAME = 1e-6  # relative difference of matrices that are one
CONVERGED = 1e-6  # relative difference of ω² of a mode that has converged
COUPLED = 1e-4  # of the coupling of modes to the interface, which is only as good as the shapes of other programs
DIGITS = 1e-8  # relative rounding of entries: fewer than nine digits
SPANNED = 1e-4  # of the static response in the energy norm: the difference of energies has half the digits
NEAR = 1e-4  # relative distance of frequencies that are one cluster
AT = 1e-6  # relative distance to the cut-off within which nothing is counted
MOST = 60  # frequencies that are compared
BELOW, STATE = "modes below the cut-off", "State the kinds of the coordinates, or the interface"
ROUNDING = 256 * EPS  # of sums in products with the full matrices


@dataclass(frozen=True, eq=False)
class Full:
    """The full model, with the interface that the reduced one has.

    `statics` are its constraint modes C (n, n_b), CᵀKC and CᵀMC; None where the interface does not hold the inside, or is not
    known. `why` says which.
    """

    sub: Substructure
    rows: Array
    statics: tuple[Array, Array, Array] | None
    why: str = ""

    @classmethod
    def of(cls, sub: Substructure, rows: Array) -> Full:
        """The full model with the interface `rows`."""
        if not len(rows):
            return cls(sub, rows, None, "no interface is known")
        C = np.zeros((sub.size, len(rows)))
        C[rows, np.arange(len(rows))] = 1.0
        inside = np.setdiff1d(np.arange(sub.size), rows)
        try:
            handle = ShiftInvert(sub.K, sub.M, inside) if len(inside) else None
            if handle is not None and handle.rigid.shape[1]:
                return cls(sub, rows, None, "the interface does not hold the inside of the full model")
            if handle is not None:
                C[inside] = -handle.elastic_solve((sub.K @ C)[inside], np.zeros((len(inside), 0)))
        except FemsubError as error:
            return cls(sub, rows, None, str(error))
        K, M = (C.T @ (A @ C) for A in (sub.K, sub.M))
        return cls(sub, rows, (C, (K + K.T) / 2, (M + M.T) / 2))

    @property
    def inside(self) -> Array:
        return np.setdiff1d(np.arange(self.sub.size), self.rows)

    def handle(self, basis: str) -> ShiftInvert:
        """The factor of the matrices that the modes of such a basis belong to."""
        held = basis == "held" and len(self.rows)
        return ShiftInvert(self.sub.K, self.sub.M, self.inside if held else slice(None),
                           None if held else self.sub.rigid_motion)


@dataclass(frozen=True, eq=False)
class Compared:
    """What the comparison with the full model found beside its findings.

    `omega` (k, 2) are the elastic frequencies of the reduced model and those of the full one. `first_missing` is the frequency
    of the first mode that is left out.
    """

    findings: tuple[Finding, ...]
    tally: Tally
    omega: Array
    rigid: int
    first_missing: float


def compared(model: Model, full: Full) -> Compared:
    """All checks against the full model."""
    found: list[Finding] = [*_interface(model, full)]
    if model.V is not None:
        found += _projections(model, full)
    else:
        found += _spectrum(model, full)
    found += _statics(model, full)
    found += _rigid(model, full)
    tally, first = Tally(0), np.nan
    try:
        modes, tally, first = _modes(model, full)
        found += modes
    except FemsubError as error:
        found.append(Finding(BELOW, UNKNOWN, f"they could not be counted: {error}"))
    omega, rigid = np.zeros((0, 2)), 0
    try:
        omega, rigid = _frequencies(model, full, first)
        found += _ritz(model, omega)
    except FemsubError as error:
        found.append(Finding("frequencies", UNKNOWN, f"those of the full model could not be found: {error}"))
    return Compared(tuple(found), tally, omega, rigid, first)


def _interface(model: Model, full: Full) -> Iterator[Finding]:
    own, there = model.rows, full.sub.interface
    if own is not None and len(there) and not np.array_equal(own, there):
        same = set(own.tolist()) == set(there.tolist())
        at = np.flatnonzero(own != there)[0] if len(own) == len(there) else 0
        yield Finding("interface list", FAULT, "the reduced model and the full one list the same interface DOF in another order, "
                      f"first at place {at}" if same else f"the reduced model's interface has {len(own)} DOF, the full one's "
                      f"{len(there)}, and {len(set(own.tolist()) ^ set(there.tolist()))} are in one list only",
                      todo="Take the list that the reduction was made with")
    if model.V is not None and model.places is not None and len(model.places) == len(full.rows):
        wrong = np.abs(model.V[full.rows] - model.B).max(axis=1)
        bad = np.flatnonzero(wrong > SAME)
        yield Finding.of("V moves the interface", float(wrong.max(initial=0.0)), SAME,
                         f"V does not move interface DOF {listed(bad)} by one with their coordinates",
                         "The interface list, its order or a sign is not that of V")


def _projections(model: Model, full: Full) -> Iterator[Finding]:
    """M = VᵀMV, K = VᵀKV, D = VᵀDV."""
    assert model.V is not None
    V, sub = model.V, full.sub
    size = np.abs(V)
    for key, own in (("M", model.M), ("K", model.K), ("D", model.D)):
        A: Matrix = getattr(sub, key)
        mine = np.zeros_like(model.K) if own is None else own
        whole = V.T @ (A @ V)
        if key == "D" and not (mine.any() or whole.any()):
            continue
        rounding = ROUNDING * (size.T @ (abs(A) @ size))
        name, scale = f"{key} = Vᵀ{key}V", whole if key != "D" else _damping_scale(whole, V, sub)
        if key == "M" and not model.projected:
            part = _massive(model, full).shapes.T @ (A @ V)
            name, whole = "M = VᵀMΦΦᵀMV", part.T @ part
        apart = within(mine - whole, scale, rounding)
        i, j = _first_of(apart)
        yield Finding.of(name, float(apart[i, j]), SAME, f"{key}[{i}, {j}] is {mine[i, j]:.6g}, but Vᵀ{key}V gives "
                         f"{whole[i, j]:.6g}{_scale_of(mine, whole)}", _advice(apart, key))


def _massive(model: Model, full: Full) -> NormalModes:
    """The free modes Φ of the full model that have mass in MacNeal's; its other coordinates have none."""
    handle = full.handle("free")
    return lowest_modes(handle, max(0, min(model.mass_rank - handle.rigid.shape[1], handle.elastic)))


def _spectrum(model: Model, full: Full) -> Iterator[Finding]:
    """All ω of the reduced model, against those of the full one in the shapes that the kinds of coordinates name.

    The span of constraint and fixed-interface modes is known, and that of free modes and the residual response to forces at the
    interface. ω does not depend on the coordinates in it, so no V is needed.
    """
    what, sub = "frequencies of the shapes stated", full.sub
    if not model.kinds or not model.basis or not len(full.rows) or (model.basis == "held" and full.statics is None):
        return
    handle = full.handle(model.basis)
    rigid = 0 if model.basis == "held" else handle.rigid.shape[1]
    kept = model.kinds.count(HELD_KIND if model.basis == "held" else "free")
    if model.basis == "free" and not kept:  # Herting's kinds do not name the modes alone
        if sub.ports:
            return
        kept = max(0, model.size - len(full.rows) - rigid)
    if kept > MOST:
        yield Finding(what, UNKNOWN, f"the model has {kept} modes, and only up to {MOST} are compared", todo="Give V")
        return
    modes = lowest_modes(handle, min(kept, handle.elastic))
    forces, ports = np.eye(sub.size)[:, full.rows], np.column_stack([np.zeros((sub.size, 0)), *sub.ports.values()])
    also = ports if model.size == kept + rigid + len(full.rows) + ports.shape[1] else ports[:, :0]
    if model.basis == "held" and full.statics is not None:
        inner = np.zeros((sub.size, modes.shapes.shape[1] + also.shape[1]))
        inner[full.inside] = np.hstack([modes.shapes, handle.elastic_solve(also[full.inside], modes.shapes)])
        shapes = np.hstack([full.statics[0], inner])
    else:
        residual = handle.elastic_solve(np.hstack([forces, also]), modes.shapes)
        shapes = np.hstack([modes.shapes, residual if model.projected else residual[:, :0]])
    there, own = frequencies(*(shapes.T @ (A @ shapes) for A in (sub.K, sub.M))), model.free_frequencies
    if len(own) != len(there):
        return  # shapes that depend on each other were left out
    elastic = there[full.handle("free").rigid.shape[1]:]
    if not len(elastic) or not elastic[0]:
        return
    beyond = np.maximum(np.abs(own**2 - there**2) - ROUNDING * len(own) * there[-1] ** 2, 0.0)
    apart = beyond / np.maximum(there, elastic[0]) ** 2
    worst = int(apart.argmax())
    yield Finding.of(what, float(apart[worst]), SAME, f"frequency {worst + 1} of all {len(own)} is {own[worst]:.6g}, but "
                     f"{there[worst]:.6g} in the span of the shapes that the kinds name", "An entry of M or K is wrong, or the "
                     "coordinates are not what their kinds say")


def _damping_scale(whole: Array, V: Array, sub: Substructure) -> Array:
    """|V|ᵀ|D||V| on the diagonal: D may cancel, or be skew."""
    return np.diag((np.abs(V).T @ (abs(sub.D) @ np.abs(V))).diagonal()) if whole.any() else np.diag(
        (V.T @ (sub.M @ V)).diagonal())


def _scale_of(mine: Array, whole: Array) -> str:
    """What one factor between two matrices may come from."""
    there = np.abs(whole) > 1e-6 * np.abs(whole).max(initial=0.0)
    if not there.any():
        return ""
    ratio = mine[there] / whole[there]
    middle = float(np.median(ratio))
    return factor(middle) if np.abs(ratio - middle).max() <= 1e-3 * abs(middle) and abs(middle - 1) > STATED else ""


def _advice(apart: Array, key: str) -> str:
    wrong = apart > SAME
    bad = np.flatnonzero(wrong.sum(axis=1) > 0.5 * len(wrong))
    if 0 < len(bad) < 0.5 * len(wrong):
        return f"Coordinates {listed(bad)} are to blame: their columns of V, or their rows of {key}"
    return f"V, or {key}, is of another model, or in other units"


def _statics(model: Model, full: Full) -> Iterator[Finding]:
    """XᵀKX and XᵀMX, D alike, against the full model's on the interface."""
    what, inertia = "static interface response", "inertia seen from the interface"
    if full.statics is None:
        yield Finding(what, UNKNOWN, full.why)
        return
    C, K_c, M_c = full.statics
    if not len(model.B):
        yield Finding(what, UNKNOWN, "the reduced model's interface is not known", todo="State it, in the full one's order")
        return
    if len(model.B) != len(full.rows):
        yield Finding(what, FAULT, f"the reduced model has {len(model.B)} interface DOF, the full one {len(full.rows)}",
                      todo="State both interfaces, in the same order")
        return
    if model.places is None:
        yield _spanned(what, model, full, C @ model.parted[0])
        return
    U, X = model.parted[0], model.static
    if X is None:
        yield Finding(what, FAULT, "the inside of the reduced model has no firm hold at the interface",
                      todo="A coordinate has no stiffness, or K is not that of this model")
        return
    own_K, own_M = X.T @ model.K @ X, X.T @ model.M @ X
    K, M = U.T @ K_c @ U, U.T @ M_c @ U
    bare = full.sub.K.diagonal()[full.rows]
    floor = np.abs(C).T @ (abs(full.sub.K) @ np.abs(C)) * ROUNDING + EPS * np.sqrt(np.outer(bare, bare))
    own = np.abs(X).T @ (abs(model.K) @ np.abs(X)) * ROUNDING
    apart = within(own_K - K, K, np.abs(U).T @ floor @ np.abs(U) + own)
    yield Finding.of(what, float(apart.max()), SAME, _place(apart, "the condensed stiffness", own_K, K), _guess(own_K, K))
    if model.projected:
        apart = within(own_M - M, M)
        yield Finding.of(inertia, float(apart.max()), SAME, _place(apart, "the mass of static shapes", own_M, M),
                         _guess(own_M, M))
    if model.V is None and model.D is not None:
        whole, own = U.T @ (C.T @ (full.sub.D @ C)) @ U, X.T @ model.D @ X
        if whole.any() or own.any():
            size = np.diag((np.abs(C).T @ (abs(full.sub.D) @ np.abs(C))).diagonal()) if whole.any() else M
            apart = within(own - whole, U.T @ size @ U, ROUNDING * size.max())
            yield Finding.of("damping seen from the interface", float(apart.max()), SAME,
                             _place(apart, "the damping of static shapes", own, whole), _guess(own, whole))


def _spanned(what: str, model: Model, full: Full, C: Array) -> Finding:
    """How much of the constraint modes C (n, k) V leaves out, in the energy norm; inertia gives rigid motion an energy too."""
    assert model.V is not None
    V, omega = model.V, model.free_frequencies
    A = full.sub.K + full.sub.M * float(omega[omega > 1e-4 * omega.max(initial=0.0)].min(initial=np.inf)) ** 2
    AC, AV = A @ C, A @ V
    gram = V.T @ AV
    unit = units(gram)
    q = unit[:, None] * np.linalg.lstsq(gram * np.outer(unit, unit), unit[:, None] * (V.T @ AC), rcond=1e-14)[0]
    rest = C - V @ q
    left = np.sqrt(np.abs(np.einsum("ij,ij->j", rest, A @ rest)) / np.einsum("ij,ij->j", C, AC))
    return Finding.of(what, float(left.max(initial=0.0)), SPANNED, f"V leaves out a share of {left.max(initial=0.0):.1e} of the "
                      "static response to a motion of the interface, in the energy norm", "Add the static shapes of the "
                      "interface: constraint modes, or residual attachment modes")


def _first_of(apart: Array) -> tuple[int, int]:
    """The first entry that is as large as any, but for rounding."""
    i, j = np.unravel_index(int(np.argmax(apart >= (1 - SAME) * apart.max())), apart.shape)
    return int(i), int(j)


def _place(apart: Array, what: str, own: Array, there: Array) -> str:
    i, j = _first_of(apart)
    return f"{what} between interface DOF {i} and {j} is {own[i, j]:.6g}, but {there[i, j]:.6g} in the full model" \
        + _scale_of(own, there)


def _guess(own: Array, there: Array) -> str:
    """What would explain the difference: signs, an order, some DOF."""
    unit = np.sqrt(np.outer(np.abs(there.diagonal()), np.abs(there.diagonal())))
    unit = np.where(unit > 0, unit, 1.0)
    if (np.abs(np.abs(own) - np.abs(there)) <= SAME * unit).all():
        signs = np.sign(own * there)
        turned = np.flatnonzero((signs < 0).sum(axis=0) > (signs > 0).sum(axis=0))
        return f"The sign of interface DOF {listed(turned) or 'some'} is turned"
    moved = np.flatnonzero(np.abs(own - there).diagonal() > SAME * unit.diagonal())
    if len(moved) > 1 and np.allclose(np.sort(own.diagonal()[moved]), np.sort(there.diagonal()[moved]), rtol=SAME):
        return f"Interface DOF {listed(moved)} are in another order"
    if _scale_of(own, there):
        return "Bring both models to one system of units"
    wrong = np.abs(own - there) > SAME * unit
    bad = np.flatnonzero(wrong.diagonal())
    few = 0 < len(bad) < len(own) and not wrong[np.ix_(np.setdiff1d(np.arange(len(own)), bad),
                                                       np.setdiff1d(np.arange(len(own)), bad))].any()
    return f"Look at interface DOF {listed(bad)}: their constraint modes or entries" if few else \
        "Constraint modes are wrong or missing, or the model is another one: add the static shapes of the interface"


def _rigid(model: Model, full: Full) -> Iterator[Finding]:
    """The full model's rigid motion strains the reduced one as little, and has the same mass."""
    what = "rigid motion strains nothing"
    try:
        Z = full.handle("free").rigid
    except FemsubError as error:
        yield Finding(what, UNKNOWN, f"that of the full model could not be found: {error}")
        return
    if not Z.shape[1]:
        yield Finding(what, GOOD, "the full model is held", 0.0, FREE)
        return
    U, X = model.parted[0], model.static
    at = U.T @ Z[full.rows] if len(full.rows) == len(U) else Z[:0]
    seen = X is not None and len(at) and np.linalg.matrix_rank(at / np.linalg.norm(at, axis=0).clip(1e-300), 1e-6) == Z.shape[1]
    if seen and X is not None and np.linalg.norm(U @ at - Z[full.rows]) <= SAME * np.linalg.norm(Z[full.rows]):
        q = X @ at
    elif model.V is not None:
        unit = np.sqrt(np.maximum(full.sub.M.diagonal(), 0.0))[:, None]
        q = np.linalg.lstsq(unit * model.V, unit * Z, rcond=None)[0]
        left = np.linalg.norm(unit * (model.V @ q - Z)) / np.linalg.norm(unit * Z)
        yield Finding.of("V has the rigid motion", float(left), SAME, f"a share of {left:.2g} of it is missing",
                         "Add rigid-body modes or constraint modes to the basis")
    else:
        yield Finding(what, UNKNOWN, "the interface does not distinguish all rigid motions", todo="Give V")
        return
    if model.motion is not None and model.motion.shape[1] and np.shape(model.motion) == np.shape(q) \
            and strain(model, model.motion) <= FREE:
        q = model.motion @ np.linalg.lstsq(model.motion, q, rcond=None)[0]  # without its rounding
    yield Finding.of(what, strain(model, q), FREE, f"the full model has {Z.shape[1]} rigid motions, which have an elastic energy "
                     "in the reduced one", "A spring to the ground, swapped or turned DOF, or entries with few digits")
    P = q.T @ model.M @ q
    yield Finding.of("mass and inertia", float(np.abs(P - np.eye(len(P))).max()), SAME, "of rigid motion, the reduced model has "
                     f"{', '.join(f'{one:.6g}' for one in P.diagonal())} times the full model's{_scale_of(P, np.eye(len(P)))}",
                     "Mass is lost or counted twice, the density is another one, or units are")


def _modes(model: Model, full: Full) -> tuple[list[Finding], Tally, float]:
    """The modes below the cut-off, counted by the inertia of K - ω²M of the full model; whether those kept have converged."""
    if not model.basis:
        return [Finding(BELOW, UNKNOWN, "which modes the model keeps is not stated", todo=STATE)], Tally(0), np.nan
    held, cut = model.basis == "held", model.cutoff
    if np.isinf(cut) and model.size == full.sub.size:
        return [Finding(BELOW, GOOD, "nothing is left out")], Tally(model.size, full.sub.size), np.inf
    own = _kept(model)
    handle = full.handle(model.basis)
    if not handle.K.shape[0]:
        return [Finding(BELOW, GOOD, "all DOF are interface")], Tally(0, 0), np.inf
    rigid = handle.rigid.shape[1]
    keep = len(own) if held else rigid + int(np.count_nonzero(own[rigid:] < cut)) if np.isfinite(cut) else len(model.modal)
    modes = lowest_modes(handle, max(0, min(keep - rigid + 1, MOST, handle.elastic)))
    apart = _apart(own[0 if held else rigid:], modes.frequencies[rigid:])
    none = np.count_nonzero(~(apart <= CONVERGED))
    shapes = sum(np.size(column) // full.sub.size for column in full.sub.ports.values())  # static ones, made orthogonal to modes
    if not model.kinds and (none > len(apart) / 2 or 0 < none <= shapes):
        return [Finding(BELOW, UNKNOWN, "the coordinates beside the interface are not stated to be modes, and "
                        f"{none} of {len(apart)} are none of the full model", todo=STATE)], Tally(0), np.nan
    first = _first_missing(own, modes.frequencies)
    if np.isfinite(cut):
        counted = modes_under(handle.K, handle.M, (cut * (1 - AT)) ** 2)
        mine = int(np.count_nonzero(own[0 if held else rigid:] < cut * (1 - AT))) + (0 if held else rigid)
        found, tally = [_below(counted, mine, cut)], Tally(mine, counted)
    else:
        found = [_unstated(first, np.isinf(cut))]
        tally = Tally(int(np.count_nonzero(own < first)), _counted(handle, first))
    if len(apart):
        worst = int(apart.argmax())
        found.append(Finding.of(
            "modes converged", float(apart[worst]), CONVERGED, f"mode {worst + 1} of the reduced model is none of the full one: "
            f"ω² is off by {apart[worst]:.1e}", "Compute it again with a tighter tolerance; or the model is reduced from other "
            "matrices, or its coordinates are no modes: state their kinds"))
    if held:
        found += _coupling(model, full, modes)
    return found, tally, min(first, cut) if np.isfinite(cut) else first


def _kept(model: Model) -> Array:
    """ω of the modes that the model keeps, ascending: of a free basis with its rigid motions, and what else follows them."""
    if model.basis != "held":
        return np.sort(model.modal_frequencies) if len(model.modal) else model.free_frequencies
    if "static port" in model.kinds or not len(model.B):
        return np.sort(model.modal_frequencies)
    return model.held_frequencies


def _below(counted: int, mine: int, cut: float) -> Finding:
    return Finding.of(BELOW, float(abs(counted - mine)), 0.0, f"the full model has {counted} modes below the stated cut-off "
                      f"{cut:.6g} rad/time, the reduced one {mine}", "Keep all modes below the cut-off, or state a lower one"
                      if counted > mine else "A mode is listed twice, or is none of the full model")


def _unstated(first: float, complete: bool) -> Finding:
    """Where no cut-off is stated, or the model says that nothing is left out."""
    if np.isinf(first):
        return Finding(BELOW, GOOD)
    if complete:
        return Finding(BELOW, FAULT, f"the model says that no mode is left out, but one at {first:.6g} rad/time is",
                       todo="State this cut-off")
    return Finding(BELOW, GOOD, f"none is stated; the first mode that is left out is at {first:.6g} rad/time")


def _counted(handle: ShiftInvert, first: float) -> int | None:
    """The modes of the full model below the first one that is missing, by their inertia; None if all of those known are there."""
    return None if np.isinf(first) else modes_under(handle.K, handle.M, (first * (1 - AT)) ** 2)


def _apart(mine: Array, there: Array) -> Array:
    """How far ω² of each mode is from that of the nearest one of the full model, as far as these are known."""
    some = mine[mine <= there.max(initial=0.0) * (1 + AT)]
    if not len(some):
        return some
    return np.abs(some[:, None] ** 2 / there[None, :] ** 2 - 1).min(axis=1)


def _first_missing(own: Array, true: Array) -> float:
    """The lowest frequency of the full model that the reduced one has not got, as often as it stands there."""
    left = list(own)
    for value in true:
        near = [at for at, one in enumerate(left) if abs(one - value) <= NEAR * max(value, 1e-3 * true.max(initial=0.0))]
        if not near:
            return float(value)
        left.pop(min(near, key=lambda at: abs(left[at] - value)))
    return np.inf


def _coupling(model: Model, full: Full, modes: NormalModes) -> list[Finding]:
    """M_bi: what the modes of each cluster take part in motions of the interface, Σ p pᵀ, which no rotation changes."""
    if full.statics is None or model.static is None:
        return []
    C, _, M_c = full.statics
    at = model.modal
    mass = np.abs(model.M.diagonal()[at])
    own = model.static.T @ model.M[:, at] / np.sqrt(np.where(mass > 0, mass, 1.0))
    U = model.parted[0]
    if len(U) != len(full.rows) or model.kinds.count("static port"):
        return []
    true = U.T @ (C.T @ (full.sub.M[:, full.inside] @ modes.shapes))
    omega = model.modal_frequencies
    size = np.sqrt((U.T @ M_c @ U).diagonal())
    worst, where = 0.0, 0.0
    frequencies = modes.frequencies
    ends = np.flatnonzero(np.append(np.diff(frequencies) > NEAR * frequencies[1:], True)) + 1
    start = 0
    for end in ends:
        lo, hi = frequencies[start] * (1 - NEAR), frequencies[end - 1] * (1 + NEAR)
        mine = (omega >= lo) & (omega <= hi)
        if mine.sum() == end - start and end < len(frequencies) + (len(frequencies) == len(full.inside)):
            p, q = own[:, mine] / size[:, None], true[:, start:end] / size[:, None]
            gap = float(np.abs(p @ p.T - q @ q.T).max(initial=0.0)) / max(float((q * q).sum(axis=1).max(initial=0.0)), COUPLED)
            worst, where = max((worst, where), (gap, float(frequencies[start])))
        start = end
    return [Finding.of("coupling of modes and interface (M_bi)", worst, COUPLED, f"the part of the modes near ω = {where:.6g} in "
                       "motions of the interface is not the full model's", "The block M_bi is lost, transposed or scaled, or its "
                       "columns are in another order than the modes")]


def _frequencies(model: Model, full: Full, first: float) -> tuple[Array, int]:
    """Elastic frequencies (k, 2) of the reduced and of the full model, interface free, up to the cut-off, stated or found."""
    handle = full.handle("free")
    rigid = handle.rigid.shape[1]
    own = model.free_frequencies[rigid:]
    reach = model.cutoff if np.isfinite(model.cutoff) else first if first < np.inf else np.inf
    most = min(MOST, handle.elastic, max(1, int(np.count_nonzero(own <= reach))), len(own))
    if most <= 0:
        return np.zeros((0, 2)), rigid
    true = lowest_modes(handle, most).frequencies[rigid:]
    return np.stack([own[:len(true)], true], axis=1), rigid


def _ritz(model: Model, omega: Array) -> Iterator[Finding]:
    """No frequency of a Ritz model lies below the full model's."""
    if not len(omega) or not model.projected:
        return
    below = 1 - (omega[:, 0] / omega[:, 1])
    worst = int(below.argmax())
    yield Finding.of("frequencies not below the full model's", max(float(below[worst]), 0.0), SAME, f"mode {worst + 1} "
                     f"has ω = {omega[worst, 0]:.6g}, but {omega[worst, 1]:.6g} in the full model; no projection lowers it",
                     "M, K or both are of another model, or in other units")


def motion_in(model: Substructure) -> RigidMotion | None:
    """The rigid motion that a reduced model carries, if it carries one."""
    return motion_of(model.rigid_motion)


def digits(model: Model) -> Finding:
    """Whether the entries have as many digits as they need."""
    rounding = {key: rounding_of(A, np.zeros((len(A), 0))) for key, A in (("K", model.K), ("M", model.M))}
    worst = max(rounding, key=lambda key: rounding[key])
    return Finding.of("digits", rounding[worst], DIGITS, f"the entries of {worst} end after about "
                      f"{1 - np.log10(8 * rounding[worst]):.0f} digits", "Write them with all digits (17): low modes and rigid "
                      "motion are small differences of large entries")
