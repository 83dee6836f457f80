"""A reduced model beside the full one, if that is there, and what several checks of an audit need of both, computed once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from femsub import checks
from femsub.checks import DENSE, EQUAL, Array, Tally
from femsub.errors import FemsubError, InputError, InputTypeError
from femsub.model import DofMap, Pencil, ReducedSubstructure, Substructure, rounding_of
from femsub.modes import ShiftInvert, lowest_modes, modes_under, motion_of
from femsub.reduction.frequency_bounds import frequency_bounds
from femsub.studies.audit_model import AGREE, HELD_KIND, SHAPED, SmallModel, array, body, motions

if TYPE_CHECKING:
    from femsub.modes import NormalModes
    from femsub.reduction import FrequencyBounds

ENTRIES = ("M", "K", "D", "V", "kinds", "interface", "full_interface", "dofs", "cutoff", "name")


class Unknown(NamedTuple):
    """Why a check cannot be decided, and what to do about it."""

    why: str
    todo: str = ""


class KeptModes(NamedTuple):
    """The modes of the full model up to the first one that the reduced model lacks.

    `apart` is how far ω² of each mode kept is from the nearest of these, and `first` the frequency of the first one missing.
    `counted` and `listed` are the modes below the cut-off in the full and in the reduced model; -1 where no cut-off is stated.
    """

    modes: NormalModes | None
    apart: Array
    first: float
    counted: int
    listed: int
    tally: Tally


class Mapped(NamedTuple):
    """Rigid motions by the DOF map that the interface can distinguish: R (n_b, k), UᵀR, and their energies, ascending.

    Energies are relative to those of single DOF; there are none where R is empty or the interface moves in shapes only. `free` is
    the number of all motions of the interface without energy, `whole` says whether the map names all six rigid motions.
    """

    R: Array
    at: Array
    energy: Array
    free: int
    whole: bool


@dataclass(eq=False)
class Case:
    """A reduced model and the full one.

    Parameters
    ----------
    small : SmallModel
    full : Substructure, optional
    most : int
        Frequencies that are compared, at most: each costs a mode of the full model.
    few : int
        Frequencies that are bounded without the full model, and printed, at most.
    sound : bool
        Whether no check of the small matrices alone has found a fault so far.
    stopped : bool
        Whether a fault forbids all other checks.
    """

    small: SmallModel
    full: Substructure | None = None
    most: int = 60
    few: int = 10
    sound: bool = True
    stopped: bool = False

    @classmethod
    def of(cls, reduced: Any, full: Substructure | None, cutoff: float | None = None, **stated: Any) -> Case:
        """The reduced model of a `Substructure`, a `Pencil`, or a mapping with its matrices, faults and all, beside the full one.

        Raises
        ------
        InputError, InputTypeError
            None of these; an entry that is unknown, or no matrix; a cut-off whose square times a mass may overflow; a full model
            that is no `Substructure`.
        """
        own: dict[str, Any] = {}
        if isinstance(reduced, Mapping):
            given = checks.mapping("reduced", reduced, "names and matrices, as {'M': M, 'K': K}")
            if strange := [key for key in given if key not in ENTRIES]:
                raise InputError(f"reduced has an entry {strange[0]!r}; known are {', '.join(ENTRIES)}")
            if "M" not in given or "K" not in given:
                raise InputError(f"reduced needs M and K, but has {', '.join(given) or 'nothing'}")
            there = {key: value for key, value in given.items() if value is not None}
            own["name"] = str(given.get("name", "model"))
            for key in [key for key in "MKDV" if key in there]:
                value = there[key]
                own[key] = checks.real_array(key, value.toarray() if hasattr(value, "toarray") else value, finite=False)
                if own[key].ndim != 2 or not own[key].size:
                    raise InputError(f"{key} must be a matrix, but its shape is {own[key].shape}")
            for key, name in (("interface", "places"), ("full_interface", "rows")):
                if key in there:
                    own[name] = checks.whole_numbers(key, there[key]).astype(np.intp)
            if "kinds" in there:
                own["kinds"] = tuple(checks.word("kinds", kind) for kind in checks.items("kinds", there["kinds"], "words"))
            if "dofs" in there:
                own["dofs"] = checks.instance("dofs", there["dofs"], DofMap)
            if "cutoff" in there:
                own["cutoff"] = np.inf if there["cutoff"] == np.inf else checks.positive_number("cutoff", there["cutoff"])
        elif isinstance(reduced, (Substructure, Pencil)):
            own = {"name": getattr(reduced, "name", "model"), **{key: array(getattr(reduced, key)) for key in "MKD"}}
            if isinstance(reduced, Substructure):
                own |= {"places": reduced.interface if len(reduced.interface) else None, "dofs": reduced.interface_dofs}
            if isinstance(reduced, ReducedSubstructure):
                own |= {"V": np.asarray(reduced.V), "kinds": tuple(reduced.kinds), "rows": reduced.full_interface,
                        "cutoff": reduced.cutoff, "carried": motion_of(reduced.rigid_motion)}
        else:
            raise InputTypeError("reduced must be a Substructure, a Pencil or a mapping with M and K, not "
                                 f"{type(reduced).__name__}")
        if cutoff is not None:
            own["cutoff"] = cutoff
        highest = float(np.finfo(float).max) ** 0.25  # ω² times a mass up to 1e154 is finite
        if highest < own.get("cutoff", 0.0) < np.inf:
            raise InputError(f"cutoff must be below {highest:.0e}, so that its square is finite; it is {own['cutoff']:g}")
        if full is not None:
            checks.instance("full", full, Substructure, "made by solid, read_component or others")
        return cls(SmallModel(**own, **stated), full)

    @property
    def whole(self) -> Substructure:
        """The full model, by checks that need it."""
        assert self.full is not None
        return self.full

    @cached_property
    def has(self) -> set[str]:
        """What checks may need: 'full' or 'alone', 'V' or 'no V', 'D', 'projected' or 'massless'."""
        small = self.small
        damped = small.D is not None and small.D.any()
        return {"alone" if self.full is None else "full", "no V" if small.V is None else "V", *["D"] * bool(damped),
                "projected" if small.projected else "massless"}

    @cached_property
    def gyroscopic(self) -> bool:
        """Whether D may be unsymmetric: it is said to be, or that of the full model is."""
        return self.small.gyroscopic or (self.full is not None and not self.full.pencil.symmetric[1])

    @cached_property
    def active(self) -> bool | None:
        """Whether the symmetric part of the full model's D has a negative eigenvalue; None of a large model."""
        if self.full is None:
            return False
        if self.full.size > DENSE:
            return None
        D = array(self.full.D)
        return bool(np.linalg.eigvalsh((D + D.T) / 2)[0] < -1e-12 * np.abs(D).max(initial=0.0))  # beyond rounding

    @cached_property
    def rows(self) -> Array:
        """The interface as DOF of the full model, as the reduced model states it, or else as the full one."""
        if self.small.rows is not None:
            return self.small.rows
        return np.zeros(0, dtype=np.intp) if self.full is None else self.full.interface

    @cached_property
    def inside(self) -> Array:
        """The other DOF of the full model."""
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
        """The factor that the modes of the reduced model's basis belong to."""
        return self.held if self.small.basis == "held" and len(self.rows) else self.free

    def lowest(self, handle: ShiftInvert, count: int) -> NormalModes:
        """So many modes of the full model by one of its factors, or all."""
        return lowest_modes(handle, max(0, min(count, handle.elastic)))

    @cached_property
    def rounding(self) -> dict[str, float]:
        """Relative rounding of the entries of K and M, as the digits show that they end after."""
        return {key: rounding_of(A, np.zeros((len(A), 0))) for key, A in (("K", self.small.K), ("M", self.small.M))}

    @cached_property
    def statics(self) -> tuple[Array, Array, Array] | Unknown:
        """Constraint modes C (n, n_b) of the full model, CᵀKC and CᵀMC; or why there are none."""
        if not len(self.rows):
            return Unknown("no interface is known")
        C = np.zeros((self.whole.size, len(self.rows)))
        C[self.rows, np.arange(len(self.rows))] = 1.0
        try:
            if len(self.inside):
                if self.held.rigid.shape[1]:
                    return Unknown("the interface does not hold the inside of the full model")
                C[self.inside] = -self.held.elastic_solve((self.whole.K @ C)[self.inside], np.zeros((len(self.inside), 0)))
        except FemsubError as error:
            return Unknown(str(error))
        K, M = (C.T @ (A @ C) for A in (self.whole.K, self.whole.M))
        return C, (K + K.T) / 2, (M + M.T) / 2

    @cached_property
    def moved(self) -> tuple[Array, Array, float | None] | Unknown:
        """q (r, k) of the full model's rigid motion Z (n, k), Z, and the share of Z that V leaves out where q comes from V."""
        try:
            Z = self.free.rigid
        except FemsubError as error:
            return Unknown(f"that of the full model could not be found: {error}")
        small, left = self.small, None
        U, X = small.parted[0], small.static
        at = U.T @ Z[self.rows] if len(self.rows) == len(U) else Z[:0]
        if not Z.shape[1]:
            return np.zeros((small.size, 0)), Z, None
        seen = len(at) and np.linalg.matrix_rank(at / np.linalg.norm(at, axis=0).clip(1e-300), AGREE) == Z.shape[1]
        if seen and X is not None and np.linalg.norm(U @ at - Z[self.rows]) <= AGREE * np.linalg.norm(Z[self.rows]):
            q = X @ at
        elif small.V is not None:
            unit = np.sqrt(np.maximum(self.whole.M.diagonal(), 0.0))[:, None]
            q = np.linalg.lstsq(unit * small.V, unit * Z, rcond=None)[0]
            left = float(np.linalg.norm(unit * (small.V @ q - Z)) / np.linalg.norm(unit * Z))
        else:
            return Unknown("the interface does not distinguish all rigid motions", "Give V")
        carried = small.motion
        if carried is not None and carried.shape[1] and carried.shape == q.shape and small.strain(carried) <= EQUAL:
            q = carried @ np.linalg.lstsq(carried, q, rcond=None)[0]  # without its rounding
        return q, Z, left

    @cached_property
    def mapped(self) -> Mapped | None:
        """The rigid motions that the DOF map of the interface names, and their energies; None without a map."""
        small = self.small
        if small.dofs is None or small.static is None or not len(small.B):
            return None
        R, whole = motions(small.dofs)
        R = R[:, np.abs(R).any(axis=0)]
        U, X = small.parted[0], small.static
        S = X.T @ small.K @ X
        weight = small.energy_unit(S, X.T @ small.M @ X, R.shape[1])
        weight = np.where(weight > 0, weight, 1.0)
        single = S / np.sqrt(np.outer(weight, weight))
        at = U.T @ R
        size = np.linalg.norm(at, axis=0)
        keep: list[int] = []
        for j in np.flatnonzero(size > 0).tolist():
            if np.linalg.matrix_rank(at[:, [*keep, j]] / size[[*keep, j]], tol=AGREE) > len(keep):
                keep.append(j)
        energy = np.zeros(0)
        if keep and U.shape[1] == len(U):
            q = np.linalg.qr(np.sqrt(weight)[:, None] * at[:, keep])[0]
            energy = np.abs(np.linalg.eigvalsh(q.T @ single @ q))
        return Mapped(R[:, keep], at[:, keep], energy, int(np.count_nonzero(np.linalg.eigvalsh(single) <= EQUAL)), whole)

    @cached_property
    def block(self) -> tuple[Array, float, Array, float, float] | None:
        """The mass matrix P (6, 6) of the rigid motions by the DOF map, if all are free: with mass, centre, error and extent."""
        small, found = self.small, self.mapped
        if found is None or not found.whole or len(found.energy) != 6 or (found.energy > EQUAL).any():
            return None
        assert small.dofs is not None and small.dofs.points is not None and small.static is not None
        q = small.static @ found.at
        P = q.T @ small.M @ q
        length = float(np.ptp(small.dofs.points, axis=0).max())
        m, centre, wrong = body(P, length)
        return P, m, centre + small.dofs.points.mean(axis=0), wrong, length

    @cached_property
    def comparable(self) -> tuple[Array, Array, Array, Array] | None:
        """U, X of the reduced model and C, CᵀMC of the full one, where both have static responses to the same interface."""
        small, statics = self.small, self.statics
        if isinstance(statics, Unknown) or small.places is None or not len(small.B) or len(small.B) != len(self.rows) \
                or small.static is None:
            return None
        return small.parted[0], small.static, statics[0], statics[2]

    @cached_property
    def kept(self) -> KeptModes | Unknown:
        """The modes that the reduced model keeps, beside those of the full one.

        Those below a stated cut-off, or else below the first one that is missing, are counted by the inertia of K - ω²M.
        """
        state = "State the kinds of the coordinates, or the interface"
        small, none = self.small, np.zeros(0)
        if not small.basis:
            return Unknown("which modes the model keeps is not stated", state)
        held, cut = small.basis == "held", small.cutoff
        if np.isinf(cut) and small.size == self.whole.size:
            return KeptModes(None, none, np.inf, -1, -1, Tally(small.size, self.whole.size))
        try:
            own = small.kept_frequencies
            handle = self.factor
            if not handle.K.shape[0]:
                return KeptModes(None, none, np.inf, -1, -1, Tally(0, 0))
            rigid = handle.rigid.shape[1]
            elastic = own[0 if held else rigid:]
            wanted = (len(own) - rigid if held else int(np.count_nonzero(own[rigid:] < cut)) if np.isfinite(cut) else
                      len(small.modal) - rigid)
            modes = self.lowest(handle, min(wanted + 1, self.most))
            # how far each is from the nearest one of the full model, as far as these are known
            there = modes.frequencies[rigid:]
            known = elastic[elastic <= there.max(initial=0.0) * (1 + AGREE)]
            apart = np.abs(known[:, None] ** 2 / there[None, :] ** 2 - 1).min(axis=1) if len(known) else known
            strange = np.count_nonzero(~(apart <= AGREE))
            shapes = sum(np.size(column) // self.whole.size for column in self.whole.ports.values())  # static, beside the modes
            # V says what the coordinates are: Herting's have the form of Craig-Bampton's, and need not be modes
            if not small.kinds and (strange > len(apart) / 2 or 0 < strange <= shapes or (strange and small.V is not None)):
                return Unknown("the coordinates beside the interface are not stated to be modes, and "
                               f"{strange} of {len(apart)} are none of the full model", state)
            # the lowest frequency of the full model that the reduced one has not got, as often as it stands there
            true, left, first = modes.frequencies, list(own), np.inf
            for value in true:
                near = [at for at, one in enumerate(left)
                        if abs(one - value) <= SHAPED * max(value, 1e-3 * true.max(initial=0.0))]
                if not near:
                    first = float(value)
                    break
                left.pop(min((abs(left[at] - value), at) for at in near)[1])
            if np.isfinite(cut):
                counted = modes_under(handle.K, handle.M, (cut * (1 - AGREE)) ** 2)
                listed = int(np.count_nonzero(elastic < cut * (1 - AGREE))) + (0 if held else rigid)
                return KeptModes(modes, apart, min(first, cut), counted, listed, Tally(listed, counted))
            below = None if np.isinf(first) else modes_under(handle.K, handle.M, (first * (1 - AGREE)) ** 2)
            return KeptModes(modes, apart, first, -1, -1, Tally(int(np.count_nonzero(own < first)), below))
        except FemsubError as error:
            return Unknown(f"they could not be counted: {error}")

    @cached_property
    def frequencies(self) -> Array | Unknown:
        """Elastic frequencies (k, 2) of the reduced and of the full model, interface free, up to the cut-off, stated or found."""
        first = np.nan if isinstance(self.kept, Unknown) else self.kept.first
        try:
            rigid = self.free.rigid.shape[1]
            own = self.small.free_frequencies[rigid:]
            reach = self.small.cutoff if np.isfinite(self.small.cutoff) else first if first < np.inf else np.inf
            most = min(self.most, self.free.elastic, max(1, int(np.count_nonzero(own <= reach))), len(own))
            if most <= 0:
                return np.zeros((0, 2))
            true = lowest_modes(self.free, most).frequencies[rigid:]
            return np.stack([own[:len(true)], true], axis=1)
        except FemsubError as error:
            return Unknown(f"those of the full model could not be found: {error}")

    @cached_property
    def bounds(self) -> FrequencyBounds | Unknown:
        """Bounds of the lowest frequencies from the small matrices and the stated cut-off, or why there are none."""
        small = self.small
        if not self.sound:
            return Unknown("the faults come first")
        if np.isnan(small.cutoff):
            return Unknown("no cut-off is stated")
        if small.basis != "held":
            return Unknown("bounds without the full model are known for Craig-Bampton models alone")
        kinds = np.full(small.size, "constraint", dtype=object)
        kinds[small.modal] = HELD_KIND
        try:
            M, K = ((A + A.T) / 2 for A in (small.M, small.K))
            rom = ReducedSubstructure(M, K, None, {}, small.name, V=np.eye(small.size) if small.V is None else small.V,
                                      kinds=tuple(small.kinds or kinds.tolist()), cutoff=small.cutoff, rigid_motion=small.carried)
            return frequency_bounds(rom, max(1, min(self.few, len(small.elastic_frequencies))))
        except FemsubError as error:
            return Unknown(f"they have no bounds: {error}")
