"""Modes followed over a parameter by left and right vectors, with their veering, crossing, coalescence and splitting.

Modes j at p and k at q are compared by the product of two overlaps,

    s_jk = y_jᴴ((λ_j + λ_k)M + D) x_k · y_kᴴ((λ_k + λ_j)M + D) x_j,   y_jᴴ(2λ_j M + D) x_j = 1,

which no scaling of vectors changes. All modes at p and q together have Σ_k s_jk = 1 if M and D do not change: s is 1 for the same
mode, 0 for another mode, and 1/2 for both modes of a pair that meets in between, half a step away. s is used in place of the MAC,
which knows right vectors alone and takes the two modes of a coalescence for one.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, WIDE
from femsub.checks import EPS, EQUAL, NOT_CHECKED, Array, FemsubWarning, InputError, real_array, until, warn, whole_number
from femsub.model import DOUBLE, Affine, Contacts, Pencil, Substructure, in_band, upper
from femsub.modes import UNCOUNTED, Region, assigned, clusters, search, with_bars
from femsub.output import Chart, Displayed, Table, column, damping_percent
from femsub.reduction import BoxModel, ParameterBox
from femsub.reduction.over_box import over_box
from femsub.stability.critical_value import question_of
from femsub.stability.crossings import ASIDE, Crossing
from femsub.stability.flutter_chart import flutter_chart
from femsub.stability.meetings import Meeting, meetings_of
from femsub.stability.parameter import pencil_over
from femsub.stability.question import LossQuestion

log = logging.getLogger(__name__)

SAME_MODE = 0.4  # |s - 1| up to which a mode is the same; a pair that meets in the step has 1/2 at least
LEAST_ALIKE = (1 - SAME_MODE) / 2  # |s| from which a mode may be the same, where the step is not halved any more
APPROACH = 0.6  # two modes approach if they come nearer within a step than this share of their distance at its ends
TURN = np.pi / 3  # or if their distance turns by more in the complex plane (wrong successors turn it by π)
PLACES = np.linspace(0.0, 1.0, 9)  # places in a step at which an approach is sought


@dataclass(frozen=True, eq=False, repr=False)
class Tracked(Displayed):
    """Modes over a parameter, made by `track`.

    Attributes
    ----------
    parameter : str
    values : ndarray, shape (p,)
        All computed values, ascending: the requested values, and values at which steps were halved.
    asked : ndarray of bool, shape (p,)
        True for requested values.
    eigenvalues : ndarray, shape (p, branches)
        λ with Im λ ≥ 0; NaN where a branch is outside the band. If a pair becomes two real eigenvalues, one of them has its own
        branch, which holds the conjugate before.
    error_bar, condition : ndarray, shape (p, branches)
        Error bar and condition number of each λ, as in `ComplexModes`.
    meetings : tuple of Meeting
        Ascending in value.
    band : (lo, hi)
    cutoff : float
        The cut-off of a reduced model if no band was given: the band ends there. Otherwise inf.

    Examples
    --------
    >>> import femsub as fs
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], None, [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]])])
    >>> tracked = fs.track(two_mode, None, "mu", [0.0, 0.5, 1.0])
    >>> print(f"{tracked.eigenvalues[-1].real.max():.6f}, {tracked.meetings[0].kind} at {tracked.meetings[0].value:.6f}")
    0.202072, coalescence at 0.750000
    """

    parameter: str
    values: Array
    asked: Array
    eigenvalues: Array
    error_bar: Array
    condition: Array
    meetings: tuple[Meeting, ...]
    band: tuple[float, float]
    cutoff: float = np.inf

    @property
    def growing(self) -> Array:
        """Where a branch certainly grows: Re λ above its error bar, bool (p, branches)."""
        return np.asarray(self.eigenvalues.real > self.error_bar)

    def tables(self) -> list[Table]:
        """A row for each mode at each requested value (this table is not printed), and one for each meeting."""
        at, branch = np.nonzero(self.asked[:, None] & ~np.isnan(self.eigenvalues))
        chosen = self.eigenvalues[at, branch]
        branches = [{self.parameter: float(self.values[i]), "branch": int(j), "growth": float(value.real),
                     "omega": float(value.imag), "damping": float(damping),
                     "error_bar": float(self.error_bar[i, j]), "grows": bool(self.growing[i, j])}
                    for i, j, value, damping in zip(at, branch, chosen, damping_percent(chosen), strict=True)]
        meetings = [{"kind": one.kind, "value": one.value, "width": one.width, "branches": list(one.branches),
                     "growth": one.eigenvalue.real, "omega": one.eigenvalue.imag, "gap": one.gap,
                     "condition": one.condition if np.isfinite(one.condition) else None,
                     "error_bar": one.error_bar if np.isfinite(one.error_bar) else None} for one in self.meetings]
        columns = [column("kind", "meeting", "s"), column("value", self.parameter, ".8g"), column("branches", form="d"),
                   column("growth", form=".6f"), column("omega", "Im λ", ".6f"), column("gap", form=".0e"),
                   column("condition", form=".0e"), "error_bar"]
        found = [Table("flutter", branches, title=f"Branches over {self.parameter}"),
                 Table("flutter-meetings", meetings, columns, "Where modes meet")]
        return [one for one in found if one.rows]

    def chart(self, title: str = "", crossings: Sequence[Crossing] = (), label: str = "") -> Chart:
        """The flutter diagram: Im λ, Re λ and the damping ratio in % over the parameter.

        Coupled modes have one colour, others are grey. `crossings` are known losses and regains, as from `critical_value`.
        `label` names the parameter with its unit.
        """
        return flutter_chart("flutter", {"": self}, {"": crossings}, label or f"{self.parameter}  [-]", title)

    def __repr__(self) -> str:
        kinds = [meeting.kind for meeting in self.meetings]
        counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
        shown = ", ".join(f"{count} {kind}{'s' * (count != 1)}" for kind, count in counts.items()) or "no meetings"
        grow = int(self.growing.any(axis=0).sum())
        return (f"Tracked: {self.eigenvalues.shape[1]} branches over {self.parameter} from {self.values[0]:g} to "
                f"{self.values[-1]:g}, {len(self.values)} values computed, {int(self.asked.sum())} asked for; {shown}; "
                f"{grow} {'branch grows' if grow == 1 else 'branches grow'} somewhere{until(self.cutoff)}")


def track(model: Substructure | Affine, contacts: Contacts, parameter: str, values: Any, *,
          band: tuple[float, float] | None = None, halvings: int = 3000) -> Tracked:
    """Modes followed over a parameter: continuous branches of eigenvalues, and where two of them meet.

    A branch is a continuous curve of eigenvalues. So at a veering it follows its curve, and the shapes change places. Two modes
    that do not act on each other go straight through a crossing. At a coalescence no rule follows from continuity: the branch of
    the higher frequency continues as the one that grows. A step is halved where a mode has no clear successor, or where two modes
    that act on each other come near within it.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced.
    contacts : Belt, LinearContact or another contact, or a sequence of them
        On the model's ports; None for an `Affine`.
    parameter : str
        A field of one of the contacts, such as 'mu' or 'speed', which changes in all contacts that have it. Or the only parameter
        of an `Affine`.
    values : array_like, shape (p,)
        Two or more values, in any order.
    band : (lo, hi), optional
        Modes with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi somewhere in the range, in radians per unit of time. Default: all, for a reduced
        model those up to its cut-off. Required for models above 300 DOF.
    halvings : int
        The largest number of steps that are halved. Each costs an eigenproblem.

    Returns
    -------
    Tracked

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, fewer than two values, a missing band, or one above the cut-off.

    Warns
    -----
    FemsubWarning
        The limit of `halvings` was reached, and further steps were not halved.

    Notes
    -----
    Up to 300 DOF each value costs one decomposition by LAPACK, and steps are halved down to 1e-9 of the range. For a larger
    model whose contacts declare how they depend on the parameter, a small model over the whole range is made if more than 8
    values are requested (`ParameterBox`). It is used if the number of modes is proved for the whole range. Its λ are within
    about 1e-6 |λ|; error bars are distances from λ of the full model, and condition numbers those of the small model. Otherwise
    each value takes one search of `complex_modes` in the band with its own factorisation, since K changes. Steps are halved to
    1e-3 of the range only: a veering narrower than that is taken for a crossing.

    Modes that meet and separate again between two values are missed if slopes and vectors show no trace of this at either value;
    `critical_value` excludes that. A mode that crosses the whole band between two values is missed, too.

    References
    ----------
    A. P. Seyranian, A. A. Mailybaev, Multiparameter Stability Theory (2003), ch. 2 (veering and coalescence of eigenvalues).

    Examples
    --------
    >>> import femsub as fs
    >>> rom = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=4), ports=True)
    >>> fs.track(rom, fs.Belt(slope=0.0), "slope", [-0.03, 0.0], band=(0.0, 0.8))
    Tracked: 3 branches over slope from -0.03 to 0, 2 values computed, 2 asked for; no meetings; 1 branch grows somewhere
    """
    points = np.unique(real_array("values", values))
    if len(points) < 2:
        raise InputError("values must be two or more numbers")
    question = question_of(model, contacts, parameter, (points[0], points[-1]), band)
    if model.size > WIDE and not (question.limited and np.isfinite(question.band[1])):
        raise InputError(f"a model of {model.size} DOF needs a band: give band=(lo, hi) in rad per unit of time")
    whole_number("halvings", halvings, least=0)
    # all steps from left to right, each halved as often as it must be
    lo, hi = question.between
    finest = (EQUAL if model.size <= WIDE else ASIDE) * (hi - lo)
    nodes, spent = _Nodes(question, len(points)), 0
    steps = np.union1d(points, question.over.kinks((lo, hi))).tolist()
    last, still = nodes.at(steps[-1]), nodes.still  # both ends first: a λ = 0 at one end alone is no rigid motion
    here = nodes.at(steps[0])
    label = np.arange(len(here.values))  # the number of each mode's branch; a mode without predecessor is a new one
    count = len(label)
    rows = [(here.p, label, here.values, here.bar, here.condition, here.inside)]
    for end in steps[1:]:
        ahead = [last if end == steps[-1] and nodes.still == still else nodes.at(end)]
        while ahead:
            there = ahead[-1]
            to, clear = _successors(here, there)
            half = (here.p + there.p) / 2
            if not clear and there.p - here.p > finest and here.p < half < there.p and spent < halvings:
                spent += 1
                ahead.append(nodes.at(half))
                continue
            before, label = label, count + np.arange(len(there.values))
            label[to[to >= 0]] = before[to >= 0]
            count += len(label)
            here = _turned(here, ahead.pop(), to)
            rows.append((here.p, label, here.values, here.bar, here.condition, here.inside))
    if spent >= halvings:
        warn(f"{spent} steps were halved, which is the limit: branches may have changed places. Allow more "
             "(halvings=), or track over a shorter range or in a narrower band", FemsubWarning)
    # drop branches that are the conjugate of another one everywhere, or never in the band
    p = np.array([row[0] for row in rows])
    branches = np.unique(np.concatenate([row[1] for row in rows]))
    found = np.full((len(p), len(branches)), np.nan + 0j)
    bar, condition = (np.full(found.shape, np.nan) for _ in range(2))
    inside = np.zeros(found.shape, dtype=bool)
    for i, (_, label, *figures) in enumerate(rows):
        at = np.searchsorted(branches, label)
        found[i, at], bar[i, at], condition[i, at], inside[i, at] = figures
    kept: list[int] = []
    for j in np.lexsort((np.nanmin(np.abs(found.imag), axis=0), -np.nanmax(found.imag, axis=0))):  # upper halves first
        same = [k for k in kept if np.allclose(found[:, k], found[:, j].conj(), rtol=EQUAL, atol=0.0, equal_nan=True)
                and np.abs(found[:, j].imag).max(initial=0.0, where=~np.isnan(found[:, j])) > 0]
        if inside[:, j].any() and not same:
            kept.append(int(j))
    first = [np.flatnonzero(~np.isnan(found[:, j].real))[0] for j in kept]
    begins = found[first, kept]
    kept = [kept[i] for i in np.lexsort((begins.real, begins.imag, first))]
    found, bar, condition, inside = found[:, kept], bar[:, kept], condition[:, kept], inside[:, kept]
    result = Tracked(parameter, p, np.isin(p, points), found, bar, condition,
                     meetings_of(p, found, bar, condition, inside, nodes.modes), question.band, question.cutoff)
    log.info("%r", result)
    return result


class _Node(NamedTuple):
    """The modes at one value, conjugates included: y_jᴴ(2λ_j M + D)x_j = 1, also as a matrix within a cluster of equal λ."""

    p: float
    pencil: Pencil
    values: Array
    X: Array
    Y: Array
    bar: Array
    condition: Array
    cluster: Array  # the number of each mode's cluster
    inside: Array  # whether it is in the band
    rates: Array  # y_jᴴP'(λ_k)x_k, (k, k), with -λ' on the diagonal: how modes act on each other as p changes


class _Nodes:
    """The modes at values of the parameter. `still` is the least number of λ = 0 at any value so far, that of rigid motion.

    Modes are followed beyond the ends of the band by a share `beyond` of its width, so that none is lost at an edge.
    """

    def __init__(self, question: LossQuestion, values: int, beyond: float = 0.1) -> None:
        self.pencil_at, self.band, self.between = question.over, question.band, question.between
        margin = beyond * (self.band[1] - self.band[0])
        self.wide = max(self.band[0] - margin, 0.0), self.band[1] + margin
        self.still = 2 * question.model.size
        self.parameter, self.small = question.parameter, _small(question, self.wide, values)
        if self.small is not None:
            self.pencil_at = pencil_over(self.small, None, self.parameter)

    def modes(self, p: float) -> tuple[Array, Array]:
        """λ and their rates at one value."""
        node = self.at(p)
        return node.values, node.rates

    def at(self, p: float) -> _Node:
        if self.small is not None:
            zero = np.zeros(0, dtype=int)
            pencil, values, X, Y, size = self.small.pairs({self.parameter: p}, fine=True)
            modes = with_bars(pencil, values, X, Y)
            modes = replace(modes, error_bar=self.small.radii.circles(values, size))
        else:
            pencil = self.pencil_at(p)
            if pencil.size <= WIDE or (not np.isfinite(self.band[1]) and pencil.size <= QUADRATIC):
                pencil, region = pencil.dense(), Region()
            else:
                region = Region(box=(-self.wide[1], self.wide[1], *self.wide))
            found = search(pencil, region, None)
            zero = np.flatnonzero(found.values == 0)
            self.still = min(self.still, len(zero))
            moving = upper(found.values)
            moving[zero[:self.still]] = False  # the others pass 0 here, or so near that they look like rigid motion
            moving &= in_band(np.where(moving, found.values, 0), self.wide, (-self.wide[1], self.wide[1]))
            values, X, Y = found.values[moving], found.X[:, moving], found.Y[:, moving]
            modes = with_bars(pencil, values, X, Y, found.known)
        pair = values.imag > 0
        values, X, Y = (np.concatenate([part, part[..., pair].conj()], axis=-1) for part in (values, X, Y))
        bar, condition = (np.append(figure, figure[pair]) for figure in (modes.error_bar, modes.condition))
        heights = values.real + 1j * np.abs(values.imag)
        inside = in_band(heights, self.band, (-self.band[1], self.band[1]))
        cluster, Y = np.arange(len(values)), Y.astype(complex)
        if len(zero) > 1:  # vectors of several λ = 0 are arbitrary, and a pair that passes 0 without damping has only one
            Y[:, values == 0] = np.nan
        with np.errstate(all="ignore"):
            slope = 2 * (pencil.M @ X) * values + pencil.D @ X
            norm = np.einsum("ij,ij->j", Y.conj(), slope).conj()
            Y /= norm
            for group in clusters(values, DOUBLE):
                cluster[group] = group[0]
                turned = Y[:, group] * norm[group]
                try:
                    Y[:, group] = turned @ np.linalg.inv(turned.conj().T @ slope[:, group]).conj().T
                except np.linalg.LinAlgError:  # the group is defective
                    Y[:, group] = np.nan
            # P'(λ)x, the derivative by the parameter, from a difference that stays within the range
            step = ASIDE * (self.between[1] - self.between[0])
            step = step if p + step <= self.between[1] else -step
            rates = Y.conj().T @ ((self.pencil_at(p + step).residual(values, X) - pencil.residual(values, X)) / step)
        rates[~np.isfinite(rates)] = 0.0
        return _Node(p, pencil, values, X, Y, bar, condition, cluster, inside, rates)


def _small(question: LossQuestion, band: tuple[float, float], values: int) -> BoxModel | None:
    """A small model over the whole range: the given model, or one made for a large model if many values are requested.

    Making it takes as long as solving at four to eight values, and each cell of its proof no longer than one. None if the proof
    does not cover the whole range.
    """
    model, over, ends = question.model, question.over, question.between
    if isinstance(model, BoxModel):
        return model
    if model.size <= WIDE or values <= 8 or (family := over.family(ends)) is None:
        return None
    why: object = "it is not proved for all values"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FemsubWarning)  # of open cells: the model is then not used
            small = over_box(family, ParameterBox({question.parameter: ends}, band, cells=values))
        if small.evidence != NOT_CHECKED and small.error <= small.box.tol:
            return small
    except (*UNCOUNTED, InputError, np.linalg.LinAlgError) as error:  # InputError: a factor has a pole in the range
        why = error
    log.info("no small model over the range, so that each value is solved alone: %s", why)
    return None


def _overlap(pencil: Pencil, left: _Node, right: _Node) -> Array:
    """y_jᴴ((λ_j + λ_k)M + D) x_k, the left vectors of one node and the right ones of another."""
    inertia = left.Y.conj().T @ (pencil.M @ right.X)
    return np.asarray((left.values[:, None] + right.values) * inertia + left.Y.conj().T @ (pencil.D @ right.X))


def _successors(here: _Node, there: _Node) -> tuple[Array, bool]:
    """The successor at q of each mode at p, or -1, and whether all successors are clear."""
    with np.errstate(all="ignore"):
        s = _overlap(there.pencil, here, there) * _overlap(there.pencil, there, here).T
    s[~np.isfinite(s)] = 0.0
    # summed over clusters of equal eigenvalues, within which vectors are arbitrary
    whole = s
    (_, row, many), (_, column, most) = (np.unique(node.cluster, return_inverse=True, return_counts=True)
                                         for node in (here, there))
    if len(many) < len(row) or len(most) < len(column):
        summed = np.zeros((len(many), len(most)), dtype=complex)
        np.add.at(summed, (row[:, None], column[None, :]), s)
        whole = (summed / np.minimum.outer(many, most))[np.ix_(row, column)]
    far, size = np.abs(here.values[:, None] - there.values), np.abs(here.values)[:, None]
    far = np.divide(far, size, out=np.ones_like(far), where=size > 0)
    # vectors decide, and if they do not, the distance of λ
    cost = np.minimum(np.abs(whole - 1), 1.0) + 1e-3 * np.minimum(np.abs(s - 1), 1.0) + np.minimum(far, 1.0) / 2
    rows, columns = assigned(cost)
    taken = np.abs(whole[rows, columns]) >= LEAST_ALIKE
    to = np.full(len(here.values), -1)
    to[rows[taken]] = columns[taken]
    alike = np.zeros(len(to), dtype=bool)
    alike[rows] = np.abs(whole[rows, columns] - 1) <= SAME_MODE
    missed = np.ones(len(there.values), dtype=bool)
    missed[to[to >= 0]] = False
    asked = here.inside.copy()
    asked[to >= 0] |= there.inside[to[to >= 0]]
    clear = bool(alike[asked].all()) and not (missed & there.inside).any() and not _meet(here, there, s, to, asked)
    # a mode without successor takes the nearest eigenvalue left: at an exceptional point vectors show nothing
    left, free = np.flatnonzero(to < 0), np.flatnonzero(missed)
    if len(left) and len(free):
        distance = np.abs(here.values[left, None] - there.values[free])
        for i, j in zip(*assigned(distance), strict=True):
            if distance[i, j] <= ASIDE * np.abs(here.values[left[i]]) or 0 in (here.values[left[i]], there.values[free[j]]):
                to[left[i]] = free[j]
    _order_alike(here, there, s, to)
    return to, clear


def _meet(here: _Node, there: _Node, s: Array, to: Array, asked: Array) -> bool:
    """Whether two modes that act on each other come near within the step, by cubics through their values and slopes."""
    rows = np.flatnonzero((to >= 0) & asked & (here.values.imag >= 0))
    if len(rows) < 2:
        return False
    columns = to[rows]
    begin, end = here.values[rows], there.values[columns]
    step, size = there.p - here.p, np.maximum(np.abs(begin), np.abs(end))
    first, last = here.rates[np.ix_(rows, rows)] * step, there.rates[np.ix_(columns, columns)] * step
    rise, fall = -first.diagonal(), -last.diagonal()
    t = PLACES[:, None]
    path = ((1 + 2 * t) * begin + t * rise) * (1 - t) ** 2 + ((3 - 2 * t) * end - (1 - t) * fall) * t**2
    gap = path[:, :, None] - path[:, None, :]
    nearer = np.minimum(np.abs(gap[0]), np.abs(gap[-1]))
    near = (np.abs(gap).min(axis=0) < APPROACH * nearer) | (np.abs(np.angle(gap * gap[0].conj())).max(axis=0) > TURN)
    ends = [np.equal.outer(cluster, cluster) for cluster in (here.cluster[rows], there.cluster[columns])]
    coupled = (np.abs(s[np.ix_(rows, columns)]) > EPS) & ~ends[0] & ~ends[1]
    for rates, together in zip((first, last), ends, strict=True):  # vectors within a cluster are arbitrary
        coupled |= (np.abs(rates * rates.T) > DOUBLE**2 * np.multiply.outer(size, size)) & ~together
    coupled |= coupled.T
    return bool((near & coupled & ~np.eye(len(rows), dtype=bool)).any())


def _order_alike(here: _Node, there: _Node, s: Array, to: Array) -> None:
    """Decide between two successors that vectors do not distinguish: (λ_a - λ_b)² is taken as linear, and its root is continuous.

    If it passes 0 within rounding, the higher frequency continues as the larger growth, and the reverse.
    """
    rows = np.flatnonzero(to >= 0)
    rows = rows[np.abs(s[rows, to[rows]] - 1) > SAME_MODE]
    if len(rows) < 2:
        return
    columns = to[rows]
    size = np.abs(s[np.ix_(rows, columns)])
    near = np.abs(here.values[rows, None] - here.values[rows]) <= 10 * np.abs(here.values[rows, None] - there.values[columns])
    linked = (size >= LEAST_ALIKE) | (size.T >= LEAST_ALIKE) | (near & near.T)
    half = there.values[columns].imag >= 0
    count, part = sp.csgraph.connected_components(linked & np.equal.outer(half, half), directed=False)
    for group in (np.flatnonzero(part == i) for i in range(count)):
        behind, ahead = rows[group], columns[group]
        if len(group) == 2:
            gaps = [values[pair[0]] - values[pair[1]] for values, pair in ((here.values, behind), (there.values, ahead))]
            turn = float((gaps[1] * gaps[0].conjugate()).real)
            apart = min(map(abs, gaps)) > DOUBLE * abs(here.values[behind[0]])
            if apart and abs(turn) > abs(gaps[0] * gaps[1]) / 100:  # turned by a right angle, a pair may have met exactly
                to[behind] = ahead if turn > 0 else ahead[::-1]
                continue
        to[behind[_rank(here.values[behind])]] = ahead[_rank(there.values[ahead])]


def _rank(values: Array) -> Array:
    # before a coalescence frequencies differ, beyond it growth rates: the sum orders both, with the upper of two conjugates last
    return np.argsort(values.real + np.abs(values.imag) + 1e-3 * values.imag, kind="stable")


def _turned(here: _Node, there: _Node, to: Array) -> _Node:
    """The node, in each cluster of equal λ with vectors turned to those of `here`, so that branches go straight on."""
    from_ = np.full(len(there.values), -1)
    from_[to[to >= 0]] = np.flatnonzero(to >= 0)
    X, Y = there.X.copy(), there.Y.copy()
    for number in np.unique(there.cluster):
        group = np.flatnonzero(there.cluster == number)
        if len(group) == 1 or (from_[group] < 0).any() or not np.isfinite(Y[:, group]).all():
            continue
        before = here.X[:, from_[group]]
        lam = there.values[group]
        Z = (lam[:, None] + here.values[from_[group]]) * (Y[:, group].conj().T @ (there.pencil.M @ before)) \
            + Y[:, group].conj().T @ (there.pencil.D @ before)
        unit = np.linalg.norm(Z, axis=0)
        if np.isfinite(Z).all() and unit.all() and np.linalg.cond(Z / unit) < 1 / SAME_MODE**4:
            X[:, group], Y[:, group] = X[:, group] @ (Z / unit), Y[:, group] @ np.linalg.inv(Z / unit).conj().T
    return there._replace(X=X, Y=Y)
