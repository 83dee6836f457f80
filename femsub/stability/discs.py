"""Loss of stability by an exclusion of all other crossings: discs around all eigenvalues of a small model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from femsub.algebra import FEW, WIDE, one_thread
from femsub.checks import InputError, Tally
from femsub.model import in_band
from femsub.stability.crossings import ASIDE, Found, change, extrapolated, settled
from femsub.stability.exclusion import Family, Stretch
from femsub.stability.question import CriticalValue, LossQuestion, fastest

LARGEST = WIDE  # DOF of a model


@dataclass(frozen=True)
class Discs:
    """A range is divided into intervals, in each of which discs around the eigenvalues show that none crosses the axis.

    Around the crossings, windows of 1e-11 of the range remain; the number of growing eigenvalues on both sides is known from the
    intervals beside them. So no loss is stepped over, however short it is. The modes that cross in a window are found from both
    of its sides, and must explain the change in that number (`femsub.stability.crossings`).

    At most `most` intervals are tested; each takes one decomposition of the state matrix and some products with it. Intervals
    that remain then are open, and the result lists them. An interval of up to `narrow` times the resolution is a window: only the
    crossings in it are determined. In a wider interval, rounding may hide which modes grow, up to `narrow` times this width from
    a place.
    """

    most: int = 6000
    narrow: float = 1e3

    def unfit(self, question: LossQuestion) -> str:
        if question.model.size > LARGEST:
            return f"discs take models of up to {LARGEST} DOF, but this one has {question.model.size}"
        if question.floats and question.band[0] > 0:
            return "discs do not accept a model that floats. Hold it, or leave the solver open: the range is then followed"
        return "" if np.isfinite(question.between[1]) else "discs take a finite range"

    def solve(self, question: LossQuestion) -> CriticalValue:
        small = question.over(question.between[0])  # for a followed model, the projected pencil
        with one_thread(small.size <= FEW):
            family = Family(question.over, question.between)
            if question.floats or family.floating:
                raise InputError("the model floats or has a motion without stiffness over the whole range. Hold it with supports "
                                 "or springs")
            parts = family.parts(self.most, question.band)
            # The crossings in the band, in the intervals that are not excluded. Wide intervals are open. A narrow one is open if
            # the modes that cross do not explain the change in the number of growing modes, or if no mode crosses. But at an end
            # of the range a mode may touch the axis without crossing it
            (lo, hi), limits = question.between, question.band
            reach, width = ASIDE * (hi - lo), self.narrow * family.least
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
                        min(hi, part.end + min(above / 3, reach)) if part.end < hi else hi + width)
                before = known if i and (known := parts[i - 1].growing) is not None else begin
                after = parts[i + 1].growing if i + 1 < len(parts) else None
                narrow = part.end - part.begin <= width
                crossed = settled(family, (part.begin, part.end), room, (before, after)) if narrow else None
                if crossed is None or not (edge or any(crossed)):
                    if not part.meets(limits):
                        listed, last = listed + (0 if after is None else after - before), before
                        continue
                    left.append((part.begin, part.end))
                    crossed, unknown = self._seen(family, part, room, before, after)
                    lost += [] if unknown is None else [unknown]
                else:
                    listed, last = listed + change(*crossed), before + change(*crossed)
                for several, new in zip(found, crossed, strict=True):
                    several.extend(one for one in sorted(new, key=lambda one: one.omega)
                                   if in_band(np.array([one.omega]), limits)[0])
            last = known if (known := parts[-1].growing) is not None else last
            z = family.spectrum(lo).z[family.grown(lo)[0]]
            z = z[in_band(np.abs(z.imag), limits)]
            tally = Tally(listed, None if left else last - begin, sampled=not family.affine)
            return CriticalValue.of(question, *found, tally, method="discs", growing=len(z), lost=lost, open=left,
                                    solved=family.solved, fastest=fastest(z))

    def _seen(self, family: Family, part: Stretch, room: tuple[float, float], before: int,
              after: int | None) -> tuple[Found, float | None]:
        """The certain crossings in an open interval, and the value beyond which stability is lost at an unknown place, or None.

        Bisection finds, one after the other, the places at which the number of certainly growing modes changes. A crossing is
        listed only if it is settled there.
        """
        after = int(family.grown(part.end)[0].sum()) if after is None else after
        found: Found = ([], [])
        begin, reach = part.begin, self.narrow**2 * family.least  # so far from a place, rounding may hide which modes grow
        while before != after:
            a, b = begin, part.end
            while b - a > family.least and a < (m := (a + b) / 2) < b:
                a, b = (m, b) if int(family.grown(m)[0].sum()) == before else (a, m)
            near = max(room[0], a - reach), min(room[1], b + reach)
            crossed = settled(family, (a, b), near, (None, None)) or extrapolated(family, (a, b), near)
            if not crossed or not change(*crossed) or b <= begin or a < begin:
                return found, begin if after > before else None
            for several, new in zip(found, crossed, strict=True):
                several.extend(new)
            begin, before = b, before + change(*crossed)
        return found, None
