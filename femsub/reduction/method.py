"""What a reduction method is: its names and looks, the part whose modes it keeps, and the steps that are its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from femsub.checks import Array, check_band, finite_number, whole_number
from femsub.errors import InputError
from femsub.reduction.basis import Basis, Kept, Responses, assembled
from femsub.reduction.mode_selection import chosen, lowest
from femsub.reduction.statics import Partition, Statics

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil
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

    1. It is a frozen dataclass. Scenes make it with a number of modes alone, so that fields of its own need defaults.
    2. `key` is its name in scene files and results, `label` that in tables and figures, `colour` and `marker` are those of
       figures (as matplotlib names them). A subclass without a key of its own is not registered.
    3. `held` says what the modes are those of: of the interior, with the interface fixed, or of the whole part, with the
       interface free. It says which matrix is factorised, too.
    4. `statics` is the step that must be there. It gets the part and its factor, and returns C with CᵀKC, and the
       forces whose static responses join the basis. CᵀKΦ must be 0 for the modes Φ of the part.
    5. The steps after it may be replaced one by one: `kept` finds the modes, `responses` the static responses, and `basis`
       puts V, M and K together. Each takes what those before it returned, changes nothing of it, and keeps the factor.

    `reduce` checks what is asked, takes the part and its factor, these four steps in their order, and projects D and the ports.
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
            whole_number("modes", self.modes, least=0)
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

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """The modes of the part: so many, or as many as a band and a tolerance need, with the damping of a `pencil`."""
        if self.band is not None:
            return chosen(statics, self.band, self.tol, pencil)
        assert self.modes is not None
        return lowest(statics, self.modes)

    def responses(self, statics: Statics, kept: Kept, ports: Mapping[str, Array]) -> Responses:
        """The static responses to F less the share of the modes, and the energy of the whole ones to the ports (n, p)."""
        loads = np.hstack([np.zeros((len(statics.forces), 0)), *(w[statics.part.rows] for w in ports.values())])
        energy = np.einsum("ij,ij->j", statics.handle.elastic_solve(loads), loads)
        return Responses(statics.handle.elastic_solve(statics.forces, kept.shapes), energy, energy, 0)

    def basis(self, statics: Statics, kept: Kept, responses: Responses, ports: Mapping[str, Array]) -> Basis:
        """V = [C Φ Ξ] with its labels, and M and K in its coordinates."""
        return assembled(statics, kept, responses, ports, self.mode_kind)

    @property
    def mode_kind(self) -> str:
        """What elastic modes are called: 'fixed-interface' or 'free'."""
        return "fixed-interface" if self.held else "free"
