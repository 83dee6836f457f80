"""Loss of stability over any parameter: flutter, negative damping and divergence, with an exclusion of all other crossings."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Array, Tally, check_band, interval
from femsub.errors import InputError
from femsub.linalg.factor import WIDE
from femsub.linalg.threads import FEW, one_thread
from femsub.model.bands import in_band
from femsub.model.estimate import usable_band
from femsub.model.substructure import Substructure
from femsub.stability.exclusion import Family, Part, Spectrum
from femsub.stability.parameter import PencilOver, pencil_over

if TYPE_CHECKING:
    from femsub.model.affine import Affine
    from femsub.model.contact import Contacts
    from femsub.model.pencil import Pencil

log = logging.getLogger(__name__)

LARGEST = WIDE  # DOF of a model
MOST = 6000  # intervals that are tested at most
NARROW = 1e3  # times the resolution: an interval in which a crossing is counted, and nothing else looked for
BESIDE = 1e-3  # of the range: how far beside a crossing the growth is told, if there is no other crossing nearer


@dataclass(frozen=True, eq=False, repr=False)
class Crossing:
    """A point at which a mode begins to grow, or ceases to.

    Attributes
    ----------
    value : float
        The parameter.
    width : float
        The crossing lies within value ∓ width / 2.
    omega : float
        Its frequency, in radians per unit of time; 0 for divergence.
    shape : ndarray, shape (n,) or (r,)
        Its eigenvector in the model's coordinates, of unit length; complex unless it diverges.
    kind : str
        'flutter': a circulatory K feeds the motion, or two undamped modes coalesce. 'hopf': negative damping feeds it.
        'divergence': a real eigenvalue passes 0.
    growth : (float, float)
        Re λ of this mode a little below and above the value.
    """

    value: float
    width: float
    omega: float
    shape: Array
    kind: str
    growth: tuple[float, float]

    def __repr__(self) -> str:
        where = "" if self.kind == "divergence" else f" at ω = {self.omega:.6g} rad/time"
        return f"Crossing: {self.value:.9g} ({self.kind}{where}), Re λ from {self.growth[0]:.3g} to {self.growth[1]:.3g}"


@dataclass(frozen=True, eq=False, repr=False)
class CriticalValue:
    """The values of a parameter at which stability is lost, made by `critical_value`; ``float(...)`` gives the first.

    Attributes
    ----------
    parameter : str
    value : float
        The first loss. The begin of the range if a mode grows there already; inf if stability is never lost.
    losses, regains : tuple of Crossing
        Where modes begin and cease to grow, ascending in value.
    searched : (lo, hi)
        The range of the parameter.
    band : (lo, hi)
        The band in which crossings count; for a reduced model it ends at the cut-off.
    growing : int
        Number of eigenvalues in the band that grow at the begin of the range (a pair counts twice).
    open : tuple of (float, float)
        Intervals in which a crossing, or one there and back, was not excluded: because eigenvalues pass each other on the axis or
        touch it, because rounding hides which grow, or because the effort ends. A loss in a wide one is found by bisection.
    tally : Tally
        The eigenvalues of all losses less those of all regains, beside the change of the number that grow over the range.
    evidence : str
        'certified': each crossing outside these points is excluded by discs around the eigenvalues. 'confirmed': the same, but
        the pencil is not declared affine in the parameter (`Contact`). It was sampled in each interval, and what depends on the
        parameter at 2,048 values of the range (256 for contacts of more than 8 columns). A factor that is a function counts as
        not affine. 'not checked': some intervals are open.
    solved : int
        Number of eigenproblems.

    Examples
    --------
    >>> import femsub as fs
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], None, [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]])])
    >>> fs.critical_value(two_mode, None, "mu", between=(0.0, 1.0))
    CriticalValue: mu = 0.75 (flutter at ω = 1.41421 rad/time) of 1 loss and 0 regains from 0 to 1; certified
    """

    parameter: str
    value: float
    losses: tuple[Crossing, ...]
    regains: tuple[Crossing, ...]
    searched: tuple[float, float]
    band: tuple[float, float]
    growing: int
    open: tuple[tuple[float, float], ...]
    tally: Tally
    solved: int

    @property
    def evidence(self) -> str:
        return self.tally.evidence

    def __float__(self) -> float:
        return self.value

    def __repr__(self) -> str:
        if self.growing:
            first = f"{self.growing} eigenvalues grow from the begin on"
        elif self.losses:
            one = self.losses[0]
            first = f"{one.value:.9g} ({one.kind}{'' if one.kind == 'divergence' else f' at ω = {one.omega:.6g} rad/time'})"
        else:
            first = "none"
        losses = f"{len(self.losses)} loss{'' if len(self.losses) == 1 else 'es'}"
        regains = f"{len(self.regains)} regain{'' if len(self.regains) == 1 else 's'}"
        rest = f", {len(self.open)} intervals open" if self.open else ""
        return (f"CriticalValue: {self.parameter} = {first} of {losses} and {regains} from {self.searched[0]:g} to "
                f"{self.searched[1]:g}; {self.evidence}{rest}")


def critical_value(model: Substructure | Affine, contacts: Contacts, parameter: str, *, between: tuple[float, float],
                   band: tuple[float, float] | None = None) -> CriticalValue:
    """The values of a parameter at which stability is lost and regained: flutter, negative damping and divergence.

    The range is divided into intervals. In each, discs around the eigenvalues show that none crosses the imaginary axis
    (`femsub.stability.exclusion`). What is left are windows of 1e-11 of the range around the crossings; the number of growing
    eigenvalues on both sides is known from the intervals beside them. So no loss is stepped over, however short it is.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced, of at most 300 DOF.
    contacts : Belt, LinearContact or another contact, or a sequence of them
        On the model's ports; None for an `Affine`.
    parameter : str
        A field of one of the contacts, such as 'mu' or 'speed'. It changes in all contacts that have it. Or a parameter of an
        `Affine`; give values to the others before, ``affine.fixed(speed=5.0)``.
    between : (lo, hi)
        The range searched.
    band : (lo, hi), optional
        Only crossings with lo ≤ ω ≤ hi count, in radians per unit of time. Default: all, for a reduced model those up to its
        cut-off. Divergence (ω = 0) counts if the band begins at 0.

    Returns
    -------
    CriticalValue

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter, a range that a contact refuses, a model that is too large, floats or has massless motions.

    Notes
    -----
    An undamped model counts as stable while all its eigenvalues are on the axis. Two of its modes of one frequency, neither of
    which acts on the other, cannot be told from a flutter that is narrower than the window; such intervals are in `open`.

    Examples
    --------
    >>> import femsub as fs
    >>> found = fs.critical_value(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", between=(-0.03, 0.0))
    >>> print(f"{found.regains[-1].value:.6f} {found.regains[-1].kind}")
    -0.025567 hopf
    """
    lo, hi = interval("between", between)
    over = _over(model, contacts, parameter)
    limits = (0.0, np.inf) if band is None else check_band(band)
    if isinstance(model, Substructure):
        limits = usable_band(model, band)
    with one_thread(model.size <= FEW):
        family = Family(lambda p: over(p).dense(), (lo, hi), over)
        if family.floating:
            raise InputError("the model floats or has a motion without stiffness over the whole range. Hold it with supports or "
                             "springs")
        parts = family.parts(MOST)
        result = _collected(family, parts, parameter, (lo, hi), limits)
    log.info("%r", result)
    return result


def _over(model: Substructure | Affine, contacts: Contacts, parameter: str) -> PencilOver:
    """The pencil as a function of the parameter."""
    over = pencil_over(model, contacts, parameter)
    if model.size > LARGEST:
        raise InputError(f"critical_value takes models of up to {LARGEST} DOF, but this one has {model.size}. Reduce it first")
    return over


def _collected(family: Family, parts: Sequence[Part], parameter: str, searched: tuple[float, float],
               limits: tuple[float, float]) -> CriticalValue:
    """The crossings in the intervals that are not excluded, in the band.

    Narrow ones without a crossing are open, unless they are at the edge of the range. So are wide ones; of a crossing there only
    one place is told, found by bisection.
    """
    losses: list[Crossing] = []
    regains: list[Crossing] = []
    left: list[tuple[float, float]] = []
    listed = counted = 0
    windows = [i for i, part in enumerate(parts) if part.growing is None]
    for at, i in enumerate(windows):
        part, edge = parts[i], i in (0, len(parts) - 1)
        before, after = (known if known is not None else len(family.grown(p)[0]) for known, p in
                         ((parts[i - 1].growing if i else None, part.begin),
                          (parts[i + 1].growing if i + 1 < len(parts) else None, part.end)))
        narrow = part.end - part.begin <= NARROW * family.least
        heights = np.abs(np.imag(part.touching))
        if not (narrow and (edge or before != after)) and (not len(heights) or in_band(heights, limits).any()):
            left.append((part.begin, part.end))
        if before == after:
            continue
        gaps = [parts[j].begin - part.end for j in windows[at + 1:at + 2]] + \
               [part.begin - parts[j].end for j in windows[max(at - 1, 0):at]]
        beside = min([BESIDE * (searched[1] - searched[0]), *(gap / 3 for gap in gaps)])
        found = _crossings(family, part if narrow else family.narrowed(part, before), after - before, beside, searched)
        counted += after - before
        listed += (1 if after > before else -1) * sum(2 if one.omega else 1 for one in found)
        (losses if after > before else regains).extend(one for one in found if in_band(np.array([one.omega]), limits)[0])
    growing = int(in_band(np.abs(family.grown(searched[0])[0].imag), limits).sum())
    value = searched[0] if growing else losses[0].value if losses else np.inf
    tally = Tally(listed, None if left else counted, sampled=not family.affine)
    return CriticalValue(parameter, value, tuple(losses), tuple(regains), searched, limits, growing, tuple(left), tally,
                         family.solved)


def _crossings(family: Family, window: Part, change: int, beside: float, searched: tuple[float, float]) -> list[Crossing]:
    """The modes that begin (change > 0) or cease to grow in a window: of those that grow on its one side, the nearest."""
    inside = window.end if change > 0 else window.begin
    found = family.spectrum(inside)
    near = np.array(window.touching)
    growing = np.flatnonzero((found.z.real > 0) & (found.z.imag >= 0))
    growing = growing[np.argsort(np.abs(found.z[growing, None] - near).min(axis=1), kind="stable")]
    taken, count = [], 0
    for at in growing:
        weight = 2 if found.z[at].imag > 0 else 1
        if count + weight <= abs(change):
            taken.append(int(at))
            count += weight
    value = (window.begin + window.end) / 2
    sides = max(searched[0], window.begin - beside), min(searched[1], window.end + beside)
    result = []
    for at in taken:
        z = found.z[at]
        shape = family.shape(found, at)
        kind = "divergence" if z.imag == 0 else "flutter" if family.mirrored else _fed(family.pencil_at(value), shape, z.imag)
        rates = [_rate(family.spectrum(p), z, grows) for p, grows in zip(sides, (change < 0, change > 0), strict=True)]
        result.append(Crossing(value, window.end - window.begin, float(z.imag), shape.real if z.imag == 0 else shape, kind,
                               (rates[0], rates[1])))
    return sorted(result, key=lambda one: one.omega)


def _rate(found: Spectrum, z: complex, grows: bool) -> float:
    """Re of the eigenvalue next to z, among those that grow or among the others."""
    bar = 4 * np.abs(found.noise.sum(axis=1))
    among = np.flatnonzero(found.z.real > bar if grows else found.z.real <= bar)
    if not len(among):
        return np.nan
    return float(found.z[among[np.argmin(np.abs(found.z[among] - z))]].real)


def _fed(pencil: Pencil, x: Array, omega: float) -> str:
    """What feeds a motion on the axis: xᴴP(iω)x = 0 has the imaginary part ω xᴴD_s x + Im xᴴK_a x = 0."""
    circulatory = -float((x.conj() @ ((pencil.K - pencil.K.T) / 2 @ x)).imag)
    power, turn = np.linalg.eigh((pencil.D + pencil.D.T) / 2)
    negative = omega * float(np.maximum(-power, 0.0) @ np.abs(turn.T @ x) ** 2)
    return "flutter" if circulatory > negative else "hopf"
