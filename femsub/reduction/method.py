"""The base class of all reduction methods: names and plot style, which modes are kept, and the steps of the method."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from femsub.checks import Array, positive_number, whole_number
from femsub.errors import InputError
from femsub.modes import modes_below
from femsub.reduction.basis import Basis, Kept, Partition, Statics
from femsub.reduction.estimates.search import Goal, Space, chosen_in, lowest

if TYPE_CHECKING:
    from femsub.model import Contacts, Pencil, ReducedSubstructure, Substructure
    from femsub.modes import ShiftInvert

METHODS: dict[str, type[Method]] = {}  #: every method by its key


@dataclass(frozen=True)
class Method(ABC):
    """Base class of the reduction methods: u ≈ Vq, V = [C Φ Ξ].

    C are static shapes (constraint modes), Φ are modes, and Ξ are static responses made orthogonal to Φ.

    Parameters
    ----------
    modes : int
        Number of elastic modes that are kept.
    band : (lo, hi), with tol : float
        Instead of `modes`: the number follows from a band and a tolerance; see `reduce`.
    cutoff : float
        Instead of both: all modes below this frequency, in radians per unit of time. They are counted before they are computed.

    Notes
    -----
    To add a method, write a subclass with a key. `study`, tables, figures and scene files then accept that key.

    1. The subclass is a frozen dataclass. Scenes create it from a number of modes alone, so its own fields need defaults.
    2. `key` is the name in scene files and results, `label` the name in tables and figures. `colour` and `marker` are
       matplotlib's names for the figures. A subclass without a key of its own is not registered.
    3. `held` is True for modes of the interior with the interface fixed, False for modes of the whole component with the
       interface free. It also decides which matrix is factorised.
    4. `statics` is the one step that a method must define. It gets the part and its factor. It returns C with CᵀKC, and
       the forces whose static responses join the basis. CᵀKΦ must be 0 for the modes Φ of the part. `rigid` in it are the rigid
       motions in C. A method that leaves them out has its rigid motion found from the rounding of the reduced K and D.
    5. `kept` finds the modes, and forces of theirs whose responses join the basis. `coordinates` turns the basis [C Φ Ξ] into
       other coordinates. Both may be overridden. Each gets the results of the earlier steps, and must not change them.
    6. `static_columns` is the number of static shapes, where that is not the number of interface DOF.
    7. `unestimated` says why a band and a tolerance have no estimate, where that is so; they are refused then. `title` is the
       line that names a model with so many modes.

    `reduce` checks the arguments, makes the part and its factor, runs the steps, and projects D and the ports.
    """

    modes: int | None = None
    band: tuple[float, float] | None = None
    tol: float | None = None
    cutoff: float | None = field(default=None, kw_only=True)

    key: ClassVar[str]
    label: ClassVar[str]
    colour: ClassVar[str]
    marker: ClassVar[str]
    held: ClassVar[bool]
    mode_kind: ClassVar[str]  #: the label of elastic modes: 'fixed-interface' or 'free', as `held` says, if no other is given
    judges_ports: ClassVar[bool] = True  #: whether the model reports the error of its static responses to ports
    offered: ClassVar[bool] = True  #: whether studies and scenes offer it for components by its key
    nested: ClassVar[bool] = True  #: whether part and factor are the same for any number of modes (`Reductor`)
    takes_cutoff: ClassVar[bool] = True  #: whether all modes below a frequency can be asked for
    unestimated: ClassVar[str] = ""  #: why no estimate can be had for a band and a tolerance, where that is so

    def __init_subclass__(cls) -> None:
        if "held" in vars(cls) and "mode_kind" not in vars(cls):
            cls.mode_kind = "fixed-interface" if cls.held else "free"
        if "key" not in vars(cls):
            return
        known = METHODS.get(cls.key)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise InputError(f"the key {cls.key!r} of {cls.__name__} is that of {known.__name__}; give it another one")
        for name in ("label", "colour", "marker", "held"):
            if not hasattr(cls, name):
                raise InputError(f"the reduction method {cls.__name__} has no {name}; see femsub.reduction.method.Method")
        if cls.offered:
            METHODS[cls.key] = cls

    def __post_init__(self) -> None:
        name = type(self).__name__
        if self.cutoff is not None:
            if not self.takes_cutoff:
                raise InputError(f"{name} takes no cutoff; give modes=20")
            if self.modes is not None or self.band is not None or self.tol is not None:
                raise InputError(f"{name} takes one of modes=20, cutoff=2e4, and band=(lo, hi) with tol=1e-3, but several are "
                                 "given")
            object.__setattr__(self, "cutoff", positive_number("cutoff", self.cutoff))
            return
        if (self.modes is None) == (self.band is None and self.tol is None):
            found = "nothing is given" if self.modes is None else f"modes={self.modes!r} and a band or tolerance are both given"
            raise InputError(f"{name} takes modes=20, or band=(lo, hi) with tol=1e-3, but {found}")
        if self.modes is not None:
            whole_number("modes", self.modes, least=0)
            return
        if self.band is None or self.tol is None:
            lacking = "band=(lo, hi), in rad per unit of time," if self.band is None else "tol=1e-3, the relative error allowed,"
            raise InputError(f"{name}: {lacking} is missing; band and tol go together")
        if self.unestimated:
            raise InputError(f"{name} takes a number of modes only, e.g. modes=20: no estimate can be had for a tolerance, since "
                             f"{self.unestimated}")
        object.__setattr__(self, "band", Goal(self.band, self.tol).band)

    def __str__(self) -> str:
        """'Craig-Bampton with 4 modes'."""
        extent = f"{self.modes} modes" if self.band is None else f"tol {self.tol:g} up to {self.band[1]:.5g} rad/time"
        extent = extent if self.cutoff is None else f"all modes below {self.cutoff:.5g} rad/time"
        return f"{self.label} with {extent}"

    def title(self, modes: int) -> str:
        """'Craig-Bampton with 4 fixed-interface modes': the model with so many of them."""
        return f"{self.label} with {modes} {self.mode_kind} modes"

    def part(self, sub: Substructure) -> Partition:
        """The part of the component that the factor and the modes are those of."""
        return Partition.of(sub, self.held)

    def static_columns(self, sub: Substructure) -> int:
        """How many static shapes the method computes, without those of the ports; the check of memory asks before any work."""
        return len(sub.interface)

    def judged(self, sub: Substructure, contacts: Contacts) -> Pencil | None:
        """The model whose complex eigenvalues must be within the tolerance; None without damping.

        Raises
        ------
        InputError
            A contact with stiffness: its forces are none of those that the basis of the method is made for.
        """
        pencil = sub.linearised(contacts, structural=True)
        if pencil.K is not sub.pencil.K:
            raise InputError("the estimate of a tolerance takes contacts that add to D only, such as belts. Use "
                             "ContactModes(band=..., tol=..., contacts=...) for friction between surfaces, or give a number of "
                             "modes instead, e.g. "
                             f"{type(self).__name__}(modes=20)")
        return pencil if pencil.norms[1] > 0 else None

    @abstractmethod
    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """C, CᵀKC and the forces F. F includes `extra` (n, s), the ports' columns whose static responses were requested."""

    def sought(self, handle: ShiftInvert) -> Kept | None:
        """A given number of modes, or all below the cut-off; static shapes may be solved for meanwhile. None with a tolerance."""
        if self.cutoff is not None:
            found = modes_below(handle.K, handle.M, self.cutoff, handle)
            elastic = len(found.eigenvalues) - found.rigid
            return Kept(found, elastic, free_below=found.counted[0] if elastic < handle.elastic else np.inf)
        return None if self.modes is None else lowest(handle, self.modes)

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """The modes of the part: those of `sought`, or as many as band and tolerance require with the damping of `pencil`."""
        if (kept := statics.sought or self.sought(statics.handle)) is not None:
            return kept
        assert self.goal is not None
        return chosen_in(Space.of(statics, pencil, self.goal.band[1]), self.goal)

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The basis V = [C Φ Ξ], turned by `Basis.turned` where the model is to have other coordinates."""
        return basis

    def finished(self, sub: Substructure, model: ReducedSubstructure) -> ReducedSubstructure:
        """The model as `reduce` returns it."""
        return model

    @property
    def goal(self) -> Goal | None:
        """The band and the tolerance; None with a number of modes."""
        return None if self.band is None or self.tol is None else Goal(self.band, self.tol)

    @property
    def row_key(self) -> str:
        """The key that stands in tables and figures."""
        return self.key
