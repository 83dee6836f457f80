"""Loss of stability over any parameter: flutter, negative damping and divergence, with an exclusion of all other crossings."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import FEW, WIDE, one_thread
from femsub.checks import Tally, check_band, interval
from femsub.errors import InputError
from femsub.model import Substructure, in_band, usable_band
from femsub.stability.crossings import BESIDE, Crossing, Found, extrapolated, settled, shown_value, weight
from femsub.stability.exclusion import Family, Part
from femsub.stability.parameter import PencilOver, pencil_over

if TYPE_CHECKING:
    from femsub.model import Affine, Contacts

log = logging.getLogger(__name__)

LARGEST = WIDE  # DOF of a model
MOST = 6000  # intervals that are tested at most
NARROW = 1e3  # times the resolution: an interval in which a crossing is counted, and nothing else looked for
SEEN = 1e-5  # of the range: how far beside a place in an open interval rounding may hide which modes grow


@dataclass(frozen=True, eq=False, repr=False)
class CriticalValue:
    """The values of a parameter at which stability is lost, made by `critical_value`; ``float(...)`` gives the first.

    Attributes
    ----------
    parameter : str
    value : float
        The first loss. The begin of the range if a mode grows there already; inf if stability is never lost. If it is first lost
        in an open interval, at a place that is not known, the begin of what is left of this interval.
    losses, regains : tuple of Crossing
        Where modes begin and cease to grow, ascending in value. A loss at either end of the range belongs to it: at the begin the
        mode grows above it, at the end it would beyond. A regain at the end belongs to it as well. At the begin there is none,
        since nothing has grown in the range before. So losses less regains, a pair counting twice, are the growing eigenvalues
        just beyond the end less those at the begin.
    searched : (lo, hi)
        The range of the parameter.
    band : (lo, hi)
        The band in which crossings count; for a reduced model it ends at the cut-off.
    growing : int
        Number of eigenvalues in the band that grow at the begin of the range (a pair counts twice).
    open : tuple of (float, float)
        Intervals in which a crossing, or one there and back, was not excluded: because eigenvalues pass each other on the axis or
        touch it, because rounding hides which grow, or because the effort ends. A window is open as well if the modes found to
        cross do not make up the change of the number of growing eigenvalues. Of crossings in a wide interval only those are
        listed that could be verified.
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
        elif self.losses and self.losses[0].value == self.value:
            one = self.losses[0]
            where = "" if one.kind == "divergence" else f" at ω = {one.omega:.6g} rad/time"
            first = f"{shown_value(one.value, one.width)} ({one.kind}{where})"
        elif np.isfinite(self.value):
            first = f"above {self.value:.9g}, at a place not known,"
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
    eigenvalues on both sides is known from the intervals beside them. So no loss is stepped over, however short it is. The modes
    that cross in a window are told from both of its sides, and must make up the change of that number
    (`femsub.stability.crossings`).

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

    Wide ones are open, and so are narrow ones in which the modes that cross do not make up the change of the number that grow, or
    none crosses. A mode that only touches the axis at an end of the range has nothing to cross.
    """
    (lo, hi), reach = searched, BESIDE * (searched[1] - searched[0])
    found: Found = ([], [])
    left: list[tuple[float, float]] = []
    lost: list[float] = []  # where an interval begins in which stability is lost at an unknown place
    begin = last = int(family.grown(lo)[0].sum())
    listed = 0
    windows = [i for i, part in enumerate(parts) if part.growing is None]
    for at, i in enumerate(windows):
        part, edge = parts[i], i in (0, len(parts) - 1)
        below = part.begin - (parts[windows[at - 1]].end if at else -np.inf)
        above = (parts[windows[at + 1]].begin if at + 1 < len(windows) else np.inf) - part.end
        room = (max(lo, part.begin - min(below / 3, reach)),
                min(hi, part.end + min(above / 3, reach)) if part.end < hi else hi + NARROW * family.least)
        before = known if i and (known := parts[i - 1].growing) is not None else begin
        after = parts[i + 1].growing if i + 1 < len(parts) else None
        narrow = part.end - part.begin <= NARROW * family.least
        told = settled(family, (part.begin, part.end), room, (before, after)) if narrow else None
        if told is None or not (edge or any(told)):
            heights = np.abs(np.imag(part.touching))
            if len(heights) and not in_band(heights, limits).any():  # not listed, whatever it is
                listed, last = listed + (0 if after is None else after - before), before
                continue
            left.append((part.begin, part.end))
            told, unknown = _seen(family, part, room, before, after)
            lost += [] if unknown is None else [unknown]
        else:
            change = sum(map(weight, told[0])) - sum(map(weight, told[1]))
            listed, last = listed + change, before + change
        for several, new in zip(found, told, strict=True):
            several.extend(one for one in sorted(new, key=lambda one: one.omega) if in_band(np.array([one.omega]), limits)[0])
    last = known if (known := parts[-1].growing) is not None else last
    growing = int(in_band(np.abs(family.spectrum(lo).z[family.grown(lo)[0]].imag), limits).sum())
    value = lo if growing else min([np.inf, *(one.value for one in found[0]), *lost])
    tally = Tally(listed, None if left else last - begin, sampled=not family.affine)
    return CriticalValue(parameter, value, tuple(found[0]), tuple(found[1]), searched, limits, growing, tuple(left), tally,
                         family.solved)


def _seen(family: Family, part: Part, room: tuple[float, float], before: int, after: int | None) -> tuple[Found, float | None]:
    """What is certain of the crossings in an open interval, and from where on one is lost at an unknown place, if so.

    The places at which the number of those that certainly grow changes are found by bisection, one after the other. A crossing is
    told only if it is settled there.
    """
    after = int(family.grown(part.end)[0].sum()) if after is None else after
    found: Found = ([], [])
    begin, reach = part.begin, SEEN * (family.between[1] - family.between[0])
    while before != after:
        a, b = family.narrowed(begin, part.end, before)
        near = max(room[0], a - reach), min(room[1], b + reach)
        told = settled(family, (a, b), near, (None, None)) or extrapolated(family, (a, b), near)
        change = sum(map(weight, told[0])) - sum(map(weight, told[1])) if told else 0
        if not told or not change or b <= begin or a < begin:
            return found, begin if after > before else None
        for several, new in zip(found, told, strict=True):
            several.extend(new)
        begin, before = b, before + change
    return found, None
