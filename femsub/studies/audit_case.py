"""The case of an audit: a reduced model's matrices as given, with any faults, and the full model if there is one.

Quantities of both models that several checks need are computed here, once.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from femsub.checks import DENSE, EQUAL, Array, FemsubError, FemsubWarning, Tally, first_few, instance
from femsub.model import ReducedSubstructure, Substructure
from femsub.modes import NormalModes, ShiftInvert, lowest_modes, modes_under
from femsub.reduction import AGREE, METHODS, SHAPED, GivenModel, Method, dense, reduced_by

if TYPE_CHECKING:
    from femsub.reduction import FrequencyBounds

GOOD, FAULT, UNKNOWN = "good", "fault", "unknown"


@dataclass(frozen=True)
class Finding:
    """The result of one check of an audit.

    Attributes
    ----------
    what : str
        The name of the check.
    verdict : str
        'good', 'fault' or 'unknown'.
    said : str
        The result in a sentence.
    figure, limit : float, optional
        The number that decides, and its largest good value.
    todo : str
        Advice.
    """

    what: str
    verdict: str
    said: str = ""
    figure: float | None = None
    limit: float | None = None
    todo: str = ""


def unknown(why: str, todo: str = "", figure: float | None = None, limit: float | None = None) -> Finding:
    """The finding that a check cannot decide. The check adds its name later."""
    return Finding("", UNKNOWN, why, figure, limit, todo)


class KeptModes(NamedTuple):
    """The lowest `modes` of the full model, one more than the reduced model keeps; None if nothing can be left out.

    `apart` has the relative difference of ω² of each kept mode from the nearest of these modes. `first` is the frequency of the
    first missing mode, or a lower stated cut-off. `tally` counts the modes below the cut-off, stated or found, in both models.
    """

    modes: NormalModes | None
    apart: Array
    first: float
    tally: Tally


@dataclass(eq=False)
class Case(GivenModel):
    """A reduced model, facts that its user states, and the full model. `turning` is whether the part turns.

    Parameters
    ----------
    most : int
        Largest number of frequencies that are compared: each costs a mode of the full model.
    few : int
        Largest number of frequencies that are printed, and that are bounded without the full model.
    sound : bool
        Whether no check of the small matrices alone has found a fault so far.
    stopped : bool
        Whether a fault forbids all other checks.
    """

    mass: float | None = None
    floating: bool | None = None
    turning: bool = False
    units: str = ""
    full: Substructure | None = None
    most: int = 60
    few: int = 10
    sound: bool = True
    stopped: bool = False

    def __post_init__(self) -> None:
        if self.full is not None:
            instance("full", self.full, Substructure, "made by solid, read_component or others")

    @cached_property
    def has(self) -> dict[str, bool]:
        """Requirements of checks: word → whether the case meets the requirement."""
        return {"full": self.full is not None, "alone": self.full is None, "no V": self.V is None, "projected": self.projected,
                "massless": not self.projected, "damped": self.D is not None and bool(self.D.any())}

    @cached_property
    def bounds(self) -> FrequencyBounds | Finding:
        """Bounds of the lowest frequencies from the small matrices and the stated cut-off, or why there are none."""
        if not self.sound:
            return unknown("they are not computed before the faults are corrected")
        if np.isnan(self.cutoff):
            return unknown("no cut-off is stated")
        if self.basis != "held":
            return unknown("without the full model, bounds are known for Craig-Bampton models only")
        try:
            return self.frequency_bounds(max(1, min(self.few, len(self.elastic_frequencies))))
        except FemsubError as error:
            return unknown(f"they have no bounds: {error}")

    # the full model

    @property
    def whole(self) -> Substructure:
        """The full model, for checks that need it."""
        assert self.full is not None
        return self.full

    @cached_property
    def gyroscopic(self) -> bool:
        """Whether D may be unsymmetric: the part is said to turn, or D of the full model is."""
        return self.turning or (self.full is not None and not self.full.pencil.symmetric[1])

    @cached_property
    def active(self) -> bool | None:
        """Whether the symmetric part of the full model's D has a negative eigenvalue; None for a large model."""
        if self.full is None:
            return False
        if self.full.size > DENSE:
            return None
        D = dense(self.full.D)
        return bool(np.linalg.eigvalsh((D + D.T) / 2)[0] < -1e-12 * np.abs(D).max(initial=0.0))  # beyond rounding

    @cached_property
    def rows(self) -> Array:
        """The interface as DOF of the full model: as the reduced model states it, or else the full model's own."""
        return self.whole.interface if self.full_interface is None else self.full_interface

    @cached_property
    def inside(self) -> Array:
        """The DOF of the full model that are not interface DOF."""
        return np.setdiff1d(np.arange(self.whole.size), self.rows)

    @cached_property
    def free(self) -> ShiftInvert:
        """The factor of the full model with its interface free."""
        return ShiftInvert(self.whole.K, self.whole.M, slice(None), self.whole.rigid_motion)

    @cached_property
    def held(self) -> ShiftInvert:
        """The factor of the full model with its interface held."""
        return ShiftInvert(self.whole.K, self.whole.M, self.inside)

    @property
    def factor(self) -> ShiftInvert:
        """The factor of the full model for the modes of the reduced model's basis: interface held or free."""
        return self.held if self.basis == "held" and len(self.rows) and len(self.inside) else self.free

    def lowest(self, handle: ShiftInvert, count: int) -> NormalModes:
        """The rigid-body modes and the `count` lowest elastic modes (or all) of the full model, by one of its factors."""
        return lowest_modes(handle, max(0, min(count, handle.elastic)))

    def reduced(self, method: Method, ports: bool = False) -> Substructure:
        """A new reduction of the full model, with the interface that the reduced model states."""
        full = self.whole
        if not np.array_equal(self.rows, full.interface):
            full = Substructure(full.M, full.K, full.D, self.rows, full.ports, full.name, full.dofs)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FemsubWarning)
            return reduced_by(full, [method], (), ports)

    @cached_property
    def statics(self) -> Any:
        """The full model reduced to its constraint modes, the columns of V; or a finding why there are none."""
        if not len(self.rows):
            return unknown("no interface is known")
        try:
            return self.reduced(METHODS["craig-bampton"](0))
        except FemsubError as error:
            return unknown(str(error))

    @cached_property
    def comparable(self) -> tuple[Array, Array, ReducedSubstructure] | None:
        """U and X of the reduced model, and the full model's `statics`; None unless both are responses to the same interface."""
        if isinstance(self.statics, Finding) or self.interface is None or not len(self.B) or len(self.B) != len(self.rows) \
                or self.static is None:
            return None
        return self.parted[0], self.static, self.statics

    @cached_property
    def moved(self) -> tuple[Array, Array, float | None] | Finding:
        """Coordinates q (r, k) of the full model's rigid motion Z (n, k), Z, and the share of Z that V leaves out.

        The share is None unless q is computed by V.
        """
        try:
            Z = self.free.rigid
        except FemsubError as error:
            return unknown(f"the rigid motion of the full model could not be computed: {error}")
        U, X, left = self.parted[0], self.static, None
        at = U.T @ Z[self.rows] if len(self.rows) == len(U) else Z[:0]
        if not Z.shape[1]:
            return np.zeros((self.size, 0)), Z, None
        seen = len(at) and np.linalg.matrix_rank(at / np.linalg.norm(at, axis=0).clip(1e-300), AGREE) == Z.shape[1]
        if seen and X is not None and np.linalg.norm(U @ at - Z[self.rows]) <= AGREE * np.linalg.norm(Z[self.rows]):
            q = X @ at
        elif self.V is not None:
            unit = np.sqrt(np.maximum(self.whole.M.diagonal(), 0.0))[:, None]
            q = np.linalg.lstsq(unit * self.V, unit * Z, rcond=None)[0]
            left = float(np.linalg.norm(unit * (self.V @ q - Z)) / np.linalg.norm(unit * Z))
        else:
            return unknown("the interface does not distinguish all rigid motions", "Give V")
        carried = self.motion
        if carried is not None and carried.shape == q.shape and self.strain(carried) <= EQUAL:
            q = carried @ np.linalg.lstsq(carried, q, rcond=None)[0]  # removes the rounding errors of q
        return q, Z, left

    @cached_property
    def kept(self) -> KeptModes | Finding:
        """The modes that the reduced model keeps, compared with modes of the full model.

        The modes below a stated cut-off, or else below the first missing mode, are counted by the inertia of K - ω²M.
        """
        state, none = "State the kinds of the coordinates, or the interface", np.zeros(0)
        if not self.basis:
            return unknown("which modes the model keeps is not stated", state)
        held, cut = self.basis == "held", self.cutoff
        if np.isinf(cut) and self.size == self.whole.size:
            return KeptModes(None, none, np.inf, Tally(self.size, self.whole.size))
        try:
            own = self.kept_frequencies
            handle = self.factor
            if not handle.K.shape[0]:
                return KeptModes(None, none, np.inf, Tally(0, 0))
            rigid = handle.rigid.shape[1]
            elastic = own[0 if held else rigid:]
            wanted = (len(own) - rigid if held else int(np.count_nonzero(own[rigid:] < cut)) if np.isfinite(cut) else
                      len(self.modal) - rigid)
            modes = self.lowest(handle, min(wanted + 1, self.most))
            # relative difference of each ω² from the nearest one of the full model, up to the highest that was computed
            there = modes.frequencies[rigid:]
            known = elastic[elastic <= there.max(initial=0.0) * (1 + AGREE)]
            apart = np.abs(known[:, None] ** 2 / there[None, :] ** 2 - 1).min(axis=1) if len(known) else known
            strange = np.count_nonzero(~(apart <= AGREE))
            shapes = sum(np.size(column) // self.whole.size for column in self.whole.ports.values())  # static ones
            # without stated kinds the coordinates need not be modes, and V shows what they are; Herting's matrices, for example,
            # have the form of Craig-Bampton's
            if not self.kinds and strange and (self.V is not None or strange > len(apart) / 2 or strange <= shapes
                                               or self.is_herting(own)):
                return unknown("the coordinates beside the interface are not stated to be modes, and "
                               f"{strange} of {len(apart)} are no modes of the full model", state)
            # the lowest frequency of the full model that the reduced one lacks, multiplicities included
            true, left, first = modes.frequencies, list(own), np.inf
            for value in true:
                near = [at for at, one in enumerate(left)
                        if abs(one - value) <= SHAPED * max(value, 1e-3 * true.max(initial=0.0))]
                if not near:
                    first = float(value)
                    break
                left.pop(min((abs(left[at] - value), at) for at in near)[1])
            if np.isfinite(cut):
                limit, listed = cut * (1 - AGREE), (0 if held else rigid)
                listed += int(np.count_nonzero(elastic < limit))
            else:
                limit, listed = first * (1 - AGREE), int(np.count_nonzero(own < first))
            counted = None if np.isinf(limit) else modes_under(handle.K, handle.M, limit**2)
            return KeptModes(modes, apart, min(first, cut) if np.isfinite(cut) else first, Tally(listed, counted))
        except FemsubError as error:
            return unknown(f"they could not be counted: {error}")

    def is_herting(self, own: Array) -> bool:
        """Whether these frequencies of the interior are those of Herting's model of the same size."""
        rigid = self.free.rigid.shape[1]
        for modes in {len(own), len(own) - rigid}:  # inertia relief depends on the modes, or is apart from them
            try:
                again = replace(GivenModel.of(self.reduced(METHODS["herting"](modes))), kinds=()).kept_frequencies
            except FemsubError:
                continue
            if len(again) == len(own) and np.allclose(again, own, rtol=AGREE, atol=0.0):
                return True
        return False

    @cached_property
    def frequencies(self) -> tuple[Array, Array] | Finding:
        """Elastic frequencies (k,), interface free, up to the cut-off, stated or found, and the full model's frequencies (k,).

        Without the full model, the second array has lower bounds of its frequencies.
        """
        if self.full is None:
            found = self.bounds
            return replace(found, todo="Give the full M and K") if isinstance(found, Finding) else (found.upper, found.lower)
        reach = self.cutoff if np.isfinite(self.cutoff) else np.inf if isinstance(self.kept, Finding) else self.kept.first
        try:
            rigid = self.free.rigid.shape[1]
            own = self.free_frequencies[rigid:]
            most = min(self.most, max(1, int(np.count_nonzero(own <= reach))), len(own))
            true = self.lowest(self.free, most).frequencies[rigid:]
            return own[:len(true)], true
        except FemsubError as error:
            return unknown(f"the frequencies of the full model could not be computed: {error}")


def listed(numbers: Sequence[int] | Array) -> str:
    """'0, 3, 4, 7 and 2 more'."""
    return first_few([str(int(number)) for number in numbers], most=4)
