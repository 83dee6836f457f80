"""Units that a scene names. If it names them, all output has Hz beside rad/s, and names such as m/s for "length/time"."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

#: keys of results that hold numbers, or lists of numbers, in rad per unit of time
FREQUENCIES = ("omega", "omega_of_cea", "up_to", "cutoff", "band", "family", "counted_below", "peaks")
_NUMBER = r"[-+]?(?<![\d.])\d[\d.]*+(?:e[-+]?\d++)?"
_TOLD = re.compile(rf"(?:({_NUMBER})\s++to\s++)?({_NUMBER})\s++rad/time")  # a line may end between
_BRACKETED = re.compile(r"\[[^\[\]]*\]")


@dataclass(frozen=True)
class Units:
    """The units of a scene's numbers; the words 'length', 'time', 'mass' and 'force' where the units are unknown."""

    length: str = "length"
    time: str = "time"
    mass: str = "mass"
    force: str = "force"

    @property
    def system(self) -> str:
        """'SI' or 'mm-t-s'; '' for other units."""
        return next((name for name, one in SYSTEMS.items() if one == self), "")

    @property
    def known(self) -> bool:
        """Whether the scene has named its units. The unit of time is the second then."""
        return self.time == "s"

    @classmethod
    def of(cls, given: Any) -> Units:
        """The units of 'SI' or 'mm-t-s', or of a mapping of length, time and mass to names; `UNKNOWN` for ''."""
        if not isinstance(given, Mapping):
            return SYSTEMS.get(given, UNKNOWN) if isinstance(given, str) else UNKNOWN
        length, time, mass = (str(given.get(name, name)) for name in ("length", "time", "mass"))
        newton = (length, mass, time) in (("m", "kg", "s"), ("mm", "t", "s"))
        return cls(length, time, mass, str(given.get("force") or ("N" if newton else f"{mass}·{length}/{time}²")))

    def frequency(self, omega: float) -> str:
        """'123.4 Hz', or '775.2 rad/time'."""
        return f"{omega / (2 * pi):.4g} Hz" if self.known else f"{omega:.4g} rad/time"

    def said(self, text: str) -> str:
        """A text or label with these units: 'to 775 rad/time' becomes 'to 775 rad/s (to 123 Hz)', '[length]' becomes '[m]'."""
        if not self.known:
            return text
        text = _TOLD.sub(lambda found: f"{found[0][:-4]}s (" + " to ".join(
            f"{_hertz(float(end)):.4g}" for end in found.groups() if end) + " Hz)", text).replace("rad/time", "rad/s")
        words = re.compile(r"\b(length|time|mass|force)\b")
        return _BRACKETED.sub(lambda found: words.sub(lambda word: str(getattr(self, word[0])), found[0]), text)

    def with_hertz(self, data: Any) -> Any:
        """Results with a value in Hz after each key of `FREQUENCIES`: 'frequency_hz' after 'omega', 'band_hz' after 'band'.

        Texts go through `said`. If the units are unknown, the results are returned unchanged.
        """
        if not self.known:
            return data
        if isinstance(data, str):
            return self.said(data)
        if isinstance(data, (list, tuple)):
            return [self.with_hertz(item) for item in data]
        if not isinstance(data, Mapping):
            return data
        found: dict[str, Any] = {}
        for key, value in data.items():
            found[key] = self.with_hertz(value)
            if key in FREQUENCIES and value is not None:
                found[f"{key.replace('omega', 'frequency')}_hz"] = _hertz(value)
        return found


UNKNOWN = Units()
SYSTEMS = {"SI": Units("m", "s", "kg", "N"), "mm-t-s": Units("mm", "s", "t", "N")}
IN_SI = {"SI": (1.0, 1.0), "mm-t-s": (1e-3, 1e3)}  #: the unit of length in m, and the unit of mass in kg
FASTEST, DENSEST = 2e4, 3e4  #: limits of solids: waves in diamond have 1.8e4 m/s, osmium has 2.3e4 kg/m³


def _hertz(value: Any) -> Any:
    return [_hertz(item) for item in value] if hasattr(value, "__iter__") else float(value) / (2 * pi)


def factor_words(ratio: float) -> str:
    """A factor between the numbers of two models, and its possible cause: ', by a factor of 1000 (as t against kg, …)'."""
    known = {1e3: "t against kg, or N/mm against N/m", 1e6: "mm against m, squared", 1e9: "mm³ against m³",
             1e12: "t/mm³ against kg/m³", 9.80665: "weight for mass", 9806.65: "weight for mass in mm",
             386.0886: "weight for mass in inches (WTMASS)", 0.0254: "inches against m", 25.4: "inches against mm",
             4.4482216: "lbf against N", 0.45359237: "lb against kg"}
    for value, why in known.items():
        for one in (value, 1 / value):
            if ratio > 0 and abs(ratio / one - 1) < 2e-3:  # allows for the digits of these factors, and of the numbers compared
                return f", by a factor of {ratio:.4g} (as {why})"
    return f", by a factor of {ratio:.6g}" if ratio > 0 else ""
