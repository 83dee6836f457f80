"""What a reduction method is: its names and looks, the part whose modes it keeps, and the steps that are its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from femsub.checks import Array, check_band, finite_number, whole_number
from femsub.errors import InputError
from femsub.reduction.basis import Kept, Responses
from femsub.reduction.statics import Partition, Statics

if TYPE_CHECKING:
    from femsub.modes.shift_invert import ShiftInvert

METHODS: dict[str, type[Method]] = {}  #: every method by its key


@dataclass(frozen=True)
class Method(ABC):
    """u ≈ Vq, V = [C Φ Ξ]: static shapes C, modes Φ of a part of the component, and what static responses add to them, Ξ.

    Parameters
    ----------
    modes : int
        Number of elastic modes that are kept.
    band : (lo, hi), with tol : float
        Instead of `modes`: as many as a band and a tolerance need; see `reduce`.

    Notes
    -----
    A method of your own is a subclass with a key; from then on `study`, tables, figures and scene files take it by that key:

    1. It is a frozen dataclass without fields of its own. `reduce` makes nothing but its steps.
    2. `key` is its name in scene files and results, `label` that in tables and figures, `colour` and `marker` are those of
       figures (as matplotlib names them). `key` is not inherited: a subclass without one is no method yet.
    3. `held` says what the modes are those of: of the interior, with the interface fixed, or of the whole part, with the
       interface free. It says which matrix is factorised, too.
    4. `statics` is the step that must be there. It gets the part and its factor, and returns C with CᵀKC, and the
       forces whose static responses join the basis. CᵀKΦ must be 0 for the modes Φ of the part.
    5. `responses` solves for the static responses. One of your own may use that some are known already.
    6. No step changes what the steps before it returned, and none releases the factor.

    `reduce` takes the steps in this order: check, partition, factor, statics, modes, responses, basis, projection.
    """

    modes: int | None = None
    band: tuple[float, float] | None = None
    tol: float | None = None

    key: ClassVar[str]
    label: ClassVar[str]
    colour: ClassVar[str]
    marker: ClassVar[str]
    held: ClassVar[bool]

    def __init_subclass__(cls) -> None:
        if "key" not in vars(cls):
            return
        known = METHODS.get(cls.key)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise InputError(f"the key {cls.key!r} of {cls.__name__} is that of {known.__name__}; give it another one")
        for name in ("label", "colour", "marker", "held"):
            if not hasattr(cls, name):
                raise InputError(f"the reduction method {cls.__name__} has no {name}; see femsub.reduction.method.Method")
        METHODS[cls.key] = cls

    def __post_init__(self) -> None:
        name = type(self).__name__
        if (self.modes is None) == (self.band is None and self.tol is None):
            found = "nothing is given" if self.modes is None else f"modes={self.modes!r} and a band or tolerance are both given"
            raise InputError(f"{name} takes modes=20, or band=(lo, hi) with tol=1e-3, but {found}")
        if self.modes is not None:
            if whole_number("modes", self.modes) < 0:
                raise InputError(f"modes must not be negative, but is {self.modes}")
            return
        if self.band is None or self.tol is None:
            lacking = "band=(lo, hi), in rad per unit of time," if self.band is None else "tol=1e-3, the relative error allowed,"
            raise InputError(f"{name}: {lacking} is missing; band and tol go together")
        object.__setattr__(self, "band", check_band(self.band))
        if not 0 < finite_number("tol", self.tol) < 1:
            raise InputError(f"tol is a relative error between 0 and 1, not {self.tol!r}")

    def __str__(self) -> str:
        """'Craig-Bampton with 4 modes'."""
        extent = f"{self.modes} modes" if self.band is None else f"tol {self.tol:g} up to {self.band[1]:.5g} rad/time"
        return f"{self.label} with {extent}"

    @abstractmethod
    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """C, CᵀKC and the forces F, to which `extra` (n, s) belongs: the ports whose static responses were asked for."""

    def responses(self, statics: Statics, kept: Kept, ports: Mapping[str, Array]) -> Responses:
        """The static responses to F less the share of the modes, and the energy of the whole ones to the ports (n, p)."""
        loads = np.hstack([np.zeros((len(statics.forces), 0)), *(w[statics.part.rows] for w in ports.values())])
        energy = np.einsum("ij,ij->j", statics.handle.elastic_solve(loads), loads)
        return Responses(statics.handle.elastic_solve(statics.forces, kept.shapes), energy, energy, 0)
