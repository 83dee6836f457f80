"""What an audit looks at: a reduced model's matrices as they are, faults and all, and the full model, if that is there.

What several checks need of both is computed here, once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub import checks
from femsub.checks import DENSE, EPS, EQUAL, Array, FemsubError, InputError, InputTypeError, Tally
from femsub.model import DofMap, Pencil, ReducedSubstructure, RigidMotion, Substructure, units
from femsub.modes import NormalModes, ShiftInvert, lowest_modes, modes_under, motion_of
from femsub.reduction.frequency_bounds import frequency_bounds

if TYPE_CHECKING:
    from femsub.reduction import FrequencyBounds

HELD_KIND, FREE_KINDS = "fixed-interface", ("free", "free and inertia relief")
PHYSICAL = ("constraint", "interface")  # kinds of coordinates beside which free modes are not alone
SPREAD = "interface mode"  # a kind that no single frequency is the cut-off of
AGREE = 1e-6  # relative difference of entries, energies and ω² of one model as two programs write them, with seven digits
SHAPED = 1e-4  # the same of what is linear in shapes, which have half the digits of their energies, and of clusters of ω
ROUNDING = 256 * EPS  # of sums in products with large matrices
GOOD, FAULT, UNKNOWN = "good", "fault", "unknown"
ENTRIES = ("M", "K", "D", "V", "kinds", "interface", "full_interface", "dofs", "cutoff", "name")


@dataclass(frozen=True)
class Finding:
    """What one check of an audit has found.

    Attributes
    ----------
    what : str
        What was checked.
    verdict : str
        'good', 'fault' or 'unknown'.
    said : str
        What was found, in a sentence.
    figure, limit : float, optional
        The number that decides, and how large it may be.
    todo : str
        What to do about it.
    """

    what: str
    verdict: str
    said: str = ""
    figure: float | None = None
    limit: float | None = None
    todo: str = ""


def unknown(why: str, todo: str = "", figure: float | None = None, limit: float | None = None) -> Finding:
    """What cannot be decided. The name of the check is put in later."""
    return Finding("", UNKNOWN, why, figure, limit, todo)


class KeptModes(NamedTuple):
    """The modes of the full model up to the first one that the reduced model lacks; None where all are kept.

    `apart` is how far ω² of each mode kept is from the nearest of these, and `first` the frequency of the first one missing.
    `tally` are the modes below the cut-off, stated or found, in the reduced and in the full model.
    """

    modes: NormalModes | None
    apart: Array
    first: float
    tally: Tally


class Mapped(NamedTuple):
    """Rigid motions by the DOF map that the interface can distinguish: UᵀR (n_b, k), and their energies, ascending.

    Energies are relative to those of single DOF; there are none where R is empty or the interface moves in shapes only. `free` is
    the number of all motions of the interface without energy, `whole` says whether the map names all six rigid motions.
    """

    at: Array
    energy: Array
    free: int
    whole: bool


class Body(NamedTuple):
    """P (6, 6), the mass matrix of the rigid motions by the DOF map: mass, centre, relative error, and the map's extent."""

    P: Array
    mass: float
    centre: Array
    wrong: float
    length: float


@dataclass(eq=False)
class Case:
    """The matrices (r, r) of a reduced model, what is stated of it, and the full model; what is not stated is None, or NaN.

    `interface` are the coordinates that are interface DOF, `full_interface` the interface as rows of V (n, r), `carried` the
    rigid motion that the model carries, and `turning` whether the part turns.

    Parameters
    ----------
    most : int
        Frequencies that are compared, at most: each costs a mode of the full model.
    few : int
        Frequencies that are bounded without the full model, and printed, at most.
    sound : bool
        Whether no check of the small matrices alone has found a fault so far.
    stopped : bool
        Whether a fault forbids all other checks.
    """

    name: str
    M: Array
    K: Array
    D: Array | None = None
    V: Array | None = None
    kinds: tuple[str, ...] = ()
    interface: Array | None = None
    full_interface: Array | None = None
    dofs: DofMap | None = None
    cutoff: float = np.nan
    carried: RigidMotion | None = None
    mass: float | None = None
    floating: bool | None = None
    turning: bool = False
    units: str = ""
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
        if isinstance(reduced, Mapping):
            given = checks.mapping("reduced", reduced, "names and matrices, as {'M': M, 'K': K}")
            if strange := [key for key in given if key not in ENTRIES]:
                raise InputError(f"reduced has an entry {strange[0]!r}; known are {', '.join(ENTRIES)}")
            if "M" not in given or "K" not in given:
                raise InputError(f"reduced needs M and K, but has {', '.join(given) or 'nothing'}")
            own: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
            own["name"] = str(given.get("name", "model"))
            for key in [key for key in own if key in "MKDV"]:
                value = own[key]
                own[key] = checks.real_array(key, value.toarray() if hasattr(value, "toarray") else value, finite=False)
                if own[key].ndim != 2 or not own[key].size:
                    raise InputError(f"{key} must be a matrix, but its shape is {own[key].shape}")
            for key in [key for key in own if key.endswith("interface")]:
                own[key] = checks.whole_numbers(key, own[key]).astype(np.intp)
            own["kinds"] = tuple(checks.word("kinds", kind) for kind in checks.items("kinds", own.get("kinds", ()), "words"))
            if "dofs" in own:
                checks.instance("dofs", own["dofs"], DofMap)
            if own.get("cutoff", np.inf) != np.inf:
                own["cutoff"] = checks.positive_number("cutoff", own["cutoff"])
        elif isinstance(reduced, (Substructure, Pencil)):
            own = {"name": getattr(reduced, "name", "model"), **{key: array(getattr(reduced, key)) for key in "MKD"}}
            if isinstance(reduced, Substructure):
                own |= {"interface": reduced.interface if len(reduced.interface) else None, "dofs": reduced.interface_dofs}
            if isinstance(reduced, ReducedSubstructure):
                own |= {"V": np.asarray(reduced.V), "kinds": tuple(reduced.kinds), "full_interface": reduced.full_interface,
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
        return cls(**own, **stated, full=full)

    # the reduced model

    @property
    def size(self) -> int:
        return len(self.M)

    @property
    def given(self) -> dict[str, Array]:
        """The matrices that are there, by name."""
        every = {"M": self.M, "K": self.K, "D": self.D, "V": self.V}
        return {key: A for key, A in every.items() if A is not None}

    @cached_property
    def has(self) -> dict[str, bool]:
        """What checks may need, by its word."""
        return {"full": self.full is not None, "alone": self.full is None, "no V": self.V is None, "projected": self.projected,
                "massless": not self.projected, "damped": self.D is not None and bool(self.D.any())}

    @property
    def motion(self) -> Array | None:
        """The shapes (r, k) of the rigid motion that the model carries, if there are any."""
        return None if self.carried is None or not self.carried.count else self.carried.shapes

    @cached_property
    def B(self) -> Array:
        """(n_b, r) with u_b = B q; without rows where no interface is known."""
        if self.interface is not None and len(self.interface):
            return np.eye(self.size)[self.interface]
        return self.V[self.full_interface] if self.V is not None and self.full_interface is not None else np.zeros((0, self.size))

    @cached_property
    def parted(self) -> tuple[Array, Array, Array]:
        """U (n_b, k), P (r, k) and N (r, r - k): B P = U, B N = 0, UᵀU = I. U are the motions that the interface can make."""
        if self.interface is not None and len(self.interface):
            return np.eye(len(self.interface)), np.eye(self.size)[:, self.interface], np.eye(self.size)[:, self.others]
        if not len(self.B):
            return np.zeros((0, 0)), np.zeros((self.size, 0)), np.eye(self.size)
        size = np.linalg.norm(self.B, axis=0)  # coordinates have units of their own
        unit = np.where(size > EQUAL * size.max(initial=0.0), size, 1.0)
        U, s, W = np.linalg.svd(self.B / unit)
        k = int(np.count_nonzero(s > EQUAL * s.max(initial=0.0)))
        return U[:, :k], W[:k].T / s[:k] / unit[:, None], W[k:].T / unit[:, None]

    @cached_property
    def static(self) -> Array | None:
        """X (r, k): the static response to motions U of the interface, B X = U; None where the inside has no firm hold."""
        _, P, N = self.parted
        if not N.shape[1]:
            return P
        inner = N.T @ self.K @ N
        unit = units(inner)
        inner = inner * np.outer(unit, unit)
        if np.linalg.eigvalsh(inner).min() <= 1e-13:
            return None
        return P - N @ (unit[:, None] * la.solve(inner, unit[:, None] * (N.T @ self.K @ P), assume_a="pos"))

    @cached_property
    def massless(self) -> Array:
        """Coordinates without mass, as those of MacNeal's interface."""
        return np.flatnonzero(~self.M.any(axis=0) & (self.K.diagonal() > 0))

    @cached_property
    def mass_rank(self) -> int:
        """The rank of M, but for rounding."""
        return int(np.linalg.matrix_rank(scaled(self.M), ROUNDING, hermitian=True))

    @cached_property
    def projected(self) -> bool:
        """Whether M is that of a Ritz model. MacNeal's is not: its free modes alone have mass."""
        return self.basis != "free" or self.mass_rank == self.size

    @property
    def others(self) -> Array:
        """The coordinates that are not interface DOF."""
        return np.setdiff1d(np.arange(self.size), [] if self.interface is None else self.interface)

    @cached_property
    def basis(self) -> str:
        """'held' for modes of a held interface, 'free' for free ones, '' where that is not known."""
        if self.kinds:
            if SPREAD in self.kinds:
                return ""
            if HELD_KIND in self.kinds or set(self.kinds) <= {"constraint", "rigid", "static port"}:
                return "held"
            return "free" if set(self.kinds) & set(FREE_KINDS) else ""
        if self.interface is None or not len(self.interface):
            return ""
        M, K = (A[np.ix_(self.others, self.others)] for A in (self.M, self.K))
        if max(coupling(self.K, self.interface, self.others), off_diagonal(M), off_diagonal(K)) <= SHAPED:
            return "held"
        return "free" if len(self.massless) else ""

    @cached_property
    def modal(self) -> Array:
        """The coordinates that are modes, each with a frequency of its own: by their kinds, or those beside the interface."""
        if not self.kinds:
            return self.others if self.basis == "held" else np.zeros(0, dtype=np.intp)
        alone = self.basis == "free" and not set(self.kinds) & set(PHYSICAL)  # Hurty's rigid motions are no modes
        return np.flatnonzero(np.isin(self.kinds, [HELD_KIND, *(("rigid", "free") if alone else ())]))

    @property
    def modal_frequencies(self) -> Array:
        """√(k_ii / m_ii) of the coordinates that are modes, in their order."""
        mass = self.M.diagonal()[self.modal]
        return np.sqrt(np.abs(self.K.diagonal()[self.modal]) / np.where(mass > 0, mass, 1.0))

    @property
    def kept_frequencies(self) -> Array:
        """ω of the modes that the model keeps, ascending: of a free basis with its rigid motions, and what else follows them."""
        if self.basis == "held" and len(self.B) and "static port" not in self.kinds:
            N = self.parted[2]
            return spectrum(N.T @ self.K @ N, N.T @ self.M @ N)  # the interface at rest
        return np.sort(self.modal_frequencies) if self.basis == "held" or len(self.modal) else self.free_frequencies

    def energy_unit(self, K: Array, M: Array, rigid: int) -> Array:
        """What the energy of single DOF is compared with, diag K + ω² diag M: a K that is rounding alone has no scale of its own.

        ω is the first frequency of the model above so many rigid motions.
        """
        omega = self.free_frequencies
        return np.abs(K.diagonal()) + float(omega[min(rigid, len(omega) - 1)] ** 2 if len(omega) else 0.0) * M.diagonal()

    @cached_property
    def free_frequencies(self) -> Array:
        """ω of the model by itself, rigid motion and rounding as 0."""
        return spectrum(self.K, self.M)

    @property
    def elastic_frequencies(self) -> Array:
        """Those above 1e-4 of the highest: what lies below is rigid motion, but for rounding."""
        return self.free_frequencies[self.free_frequencies > SHAPED * self.free_frequencies.max(initial=0.0)]

    def strain(self, q: Array) -> float:
        """The largest qᵀKq of the columns of q, over the energy of the single coordinates."""
        whole = q.T**2 @ self.energy_unit(self.K, self.M, q.shape[1])
        return float((np.abs(np.einsum("ij,ij->j", q, self.K @ q)) / np.where(whole > 0, whole, 1.0)).max(initial=0.0))

    @cached_property
    def mapped(self) -> Mapped | None:
        """The rigid motions that the DOF map of the interface names, and their energies; None without a map."""
        if self.dofs is None or self.static is None or not len(self.B):
            return None
        dofs, U, X = self.dofs, self.parted[0], self.static
        R = np.zeros((dofs.size, 0))
        if dofs.points is not None and not dofs.no_rigid:
            R = dofs.rigid()
        elif dofs.points is None:  # rotations need points
            still = DofMap(dofs.nodes, dofs.components, dofs.labels, np.zeros((dofs.size, 3)))
            R = R if still.no_rigid else still.rigid()[:, :3]
        R = R[:, R.any(axis=0)]
        S = X.T @ self.K @ X
        weight = self.energy_unit(S, X.T @ self.M @ X, R.shape[1])
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
        return Mapped(at[:, keep], energy, int(np.count_nonzero(np.linalg.eigvalsh(single) <= EQUAL)), R.shape[1] == 6)

    @cached_property
    def body(self) -> Body | None:
        """The mass matrix of the six rigid motions by the DOF map, if all are free.

        How far it is from [[m I, -m c×], [m c×, J]] of a rigid body, relative, with J about the centre c a sum of masses.
        """
        found = self.mapped
        if found is None or not found.whole or len(found.energy) != 6 or (found.energy > EQUAL).any():
            return None
        assert self.dofs is not None and self.dofs.points is not None and self.static is not None
        q = self.static @ found.at
        P = q.T @ self.M @ q
        length, m = float(np.ptp(self.dofs.points, axis=0).max()), float(np.trace(P[:3, :3])) / 3
        if m <= 0:
            return Body(P, m, np.zeros(3), np.inf, length)
        moment = (P[:3, 3:] - P[:3, 3:].T) / 2
        c = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / m
        reach = max(length, float(np.sqrt(max(np.trace(P[3:, 3:]), 0.0) / m)))
        arm = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
        axes = np.linalg.eigvalsh(P[3:, 3:] + m * arm @ arm)  # about the centre
        wrong = (np.abs(P[:3, :3] - m * np.eye(3)).max() / m, np.abs(P[:3, 3:] + P[:3, 3:].T).max() / (2 * m * reach),
                 max(axes[2] - axes[0] - axes[1], -axes[0], 0.0) / (m * reach**2))
        return Body(P, m, c + self.dofs.points.mean(axis=0), float(max(wrong)), length)

    @cached_property
    def bounds(self) -> FrequencyBounds | Finding:
        """Bounds of the lowest frequencies from the small matrices and the stated cut-off, or why there are none."""
        if not self.sound:
            return unknown("the faults come first")
        if np.isnan(self.cutoff):
            return unknown("no cut-off is stated")
        if self.basis != "held":
            return unknown("bounds without the full model are known for Craig-Bampton models alone")
        kinds = np.full(self.size, "constraint", dtype=object)
        kinds[self.modal] = HELD_KIND
        try:
            M, K = ((A + A.T) / 2 for A in (self.M, self.K))
            rom = ReducedSubstructure(M, K, None, {}, self.name, V=np.eye(self.size) if self.V is None else self.V,
                                      kinds=tuple(self.kinds or kinds.tolist()), cutoff=self.cutoff, rigid_motion=self.carried)
            return frequency_bounds(rom, max(1, min(self.few, len(self.elastic_frequencies))))
        except FemsubError as error:
            return unknown(f"they have no bounds: {error}")

    # the full model

    @property
    def whole(self) -> Substructure:
        """The full model, by checks that need it."""
        assert self.full is not None
        return self.full

    @cached_property
    def gyroscopic(self) -> bool:
        """Whether D may be unsymmetric: the part is said to turn, or D of the full model is."""
        return self.turning or (self.full is not None and not self.full.pencil.symmetric[1])

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
        return self.whole.interface if self.full_interface is None else self.full_interface

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
        return self.held if self.basis == "held" and len(self.rows) and len(self.inside) else self.free

    def lowest(self, handle: ShiftInvert, count: int) -> NormalModes:
        """So many modes of the full model by one of its factors, or all."""
        return lowest_modes(handle, max(0, min(count, handle.elastic)))

    @cached_property
    def statics(self) -> tuple[Array, Array, Array] | Finding:
        """Constraint modes C (n, n_b) of the full model, CᵀKC and CᵀMC; or why there are none."""
        if not len(self.rows):
            return unknown("no interface is known")
        C = np.zeros((self.whole.size, len(self.rows)))
        C[self.rows, np.arange(len(self.rows))] = 1.0
        try:
            if len(self.inside):
                if self.held.rigid.shape[1]:
                    return unknown("the interface does not hold the inside of the full model")
                C[self.inside] = -self.held.elastic_solve((self.whole.K @ C)[self.inside], np.zeros((len(self.inside), 0)))
        except FemsubError as error:
            return unknown(str(error))
        K, M = (C.T @ (A @ C) for A in (self.whole.K, self.whole.M))
        return C, (K + K.T) / 2, (M + M.T) / 2

    @cached_property
    def comparable(self) -> tuple[Array, Array, Array, Array] | None:
        """U, X of the reduced model and C, CᵀMC of the full one, where both have static responses to the same interface."""
        if isinstance(self.statics, Finding) or self.interface is None or not len(self.B) or len(self.B) != len(self.rows) \
                or self.static is None:
            return None
        return self.parted[0], self.static, self.statics[0], self.statics[2]

    @cached_property
    def moved(self) -> tuple[Array, Array, float | None] | Finding:
        """q (r, k) of the full model's rigid motion Z (n, k), Z, and the share of Z that V leaves out where q comes from V."""
        try:
            Z = self.free.rigid
        except FemsubError as error:
            return unknown(f"that of the full model could not be found: {error}")
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
            q = carried @ np.linalg.lstsq(carried, q, rcond=None)[0]  # without its rounding
        return q, Z, left

    @cached_property
    def kept(self) -> KeptModes | Finding:
        """The modes that the reduced model keeps, beside those of the full one.

        Those below a stated cut-off, or else below the first one that is missing, are counted by the inertia of K - ω²M.
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
            # how far each is from the nearest one of the full model, as far as these are known
            there = modes.frequencies[rigid:]
            known = elastic[elastic <= there.max(initial=0.0) * (1 + AGREE)]
            apart = np.abs(known[:, None] ** 2 / there[None, :] ** 2 - 1).min(axis=1) if len(known) else known
            strange = np.count_nonzero(~(apart <= AGREE))
            shapes = sum(np.size(column) // self.whole.size for column in self.whole.ports.values())  # static, beside the modes
            # V says what the coordinates are: Herting's have the form of Craig-Bampton's, and need not be modes. Most are where
            # the model is nearly complete
            lacking = handle.K.shape[0] - len(own)
            if not self.kinds and (strange > len(apart) / 2 or 0 < strange <= max(shapes, lacking if lacking < len(own) else 0)
                                   or (strange and self.V is not None)):
                return unknown("the coordinates beside the interface are not stated to be modes, and "
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
                limit, listed = cut * (1 - AGREE), (0 if held else rigid)
                listed += int(np.count_nonzero(elastic < limit))
            else:
                limit, listed = first * (1 - AGREE), int(np.count_nonzero(own < first))
            counted = None if np.isinf(limit) else modes_under(handle.K, handle.M, limit**2)
            return KeptModes(modes, apart, min(first, cut) if np.isfinite(cut) else first, Tally(listed, counted))
        except FemsubError as error:
            return unknown(f"they could not be counted: {error}")

    @cached_property
    def frequencies(self) -> tuple[Array, Array] | Finding:
        """Elastic frequencies, interface free, up to the cut-off, stated or found: the reduced model's, and what they are beside.

        These are the full model's, (k,) both, or without it what they cannot lie below.
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
            return unknown(f"those of the full model could not be found: {error}")


def scaled(A: Array) -> Array:
    """a_ij / √(a_ii a_jj). Where a diagonal entry is not positive, the largest of its row stands for it."""
    diagonal, size = A.diagonal(), np.abs(A).max(axis=0, initial=0.0)
    unit = np.where(diagonal > 0, diagonal, np.where(size > 0, size, 1.0)) ** -0.5
    return A * np.outer(unit, unit)


def coupling(A: Array, some: Array, others: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj) between some coordinates and others."""
    return float(np.abs(scaled(A)[np.ix_(some, others)]).max(initial=0.0))


def off_diagonal(A: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj), i ≠ j."""
    whole = scaled(A)
    return float(np.abs(whole - np.diag(whole.diagonal())).max(initial=0.0))


def spectrum(K: Array, M: Array) -> Array:
    """ω of Kx = ω²Mx in ascending order, K and M semidefinite; coordinates without mass follow statically."""
    if not len(K):
        return np.zeros(0)
    K, M = (K + K.T) / 2, (M + M.T) / 2
    heaviest = float(M.diagonal().max())
    unit = units(K + np.diag(M.diagonal()) * (K.diagonal().max() / heaviest) if heaviest > 0 else K)
    mass = M * np.outer(unit, unit)
    stiff = K * np.outer(unit, unit)
    values, turn = la.eigh(mass)
    heavy = values > 1e-12 * max(values[-1], 0.0)
    if not heavy.any():
        return np.zeros(0)
    Q = turn[:, heavy]
    inner = Q.T @ stiff @ Q
    if not heavy.all():
        # by 1/(ω² + σ) with σ about the lowest: condensed to Q, stiff coordinates that nearly depend on each other lose digits
        ratios = np.einsum("ij,ij->j", Q, stiff @ Q) / values[heavy]
        shift = float(ratios[ratios > EQUAL * ratios.max()].min(initial=ratios.max()))
        try:
            inverse = la.eigh(mass, stiff + shift * mass, eigvals_only=True)[-len(ratios):][::-1]
            return np.sqrt(np.maximum(1 / inverse - shift, 0.0))
        except la.LinAlgError:  # K + σM is not positive definite: a fault, which another check names
            Z = turn[:, ~heavy]
            inner -= (Q.T @ stiff @ Z) @ np.linalg.pinv(Z.T @ stiff @ Z, rcond=1e-12, hermitian=True) @ (Z.T @ stiff @ Q)
    root = values[heavy] ** -0.5
    return np.sqrt(np.maximum(np.linalg.eigvalsh(inner * np.outer(root, root)), 0.0))


def array(value: Any) -> Array:
    """A dense array of float64."""
    return np.asarray(value.toarray() if sp.issparse(value) else value, dtype=float)


def listed(numbers: Sequence[int] | Array, most: int = 4) -> str:
    """'0, 3 and 2 more'."""
    text = ", ".join(str(int(number)) for number in numbers[:most])
    return text + (f" and {len(numbers) - most} more" if len(numbers) > most else "")


def within(difference: Array, A: Array, rounding: Array | float = 0.0) -> Array:
    """|Δ_ij| over √(a_ii a_jj); what is within the rounding counts as none."""
    size = np.sqrt(np.abs(A.diagonal()))
    size = np.where(size > 0, size, EPS * size.max(initial=0.0))
    beyond = np.maximum(np.abs(difference) - rounding, 0.0)
    return np.divide(beyond, np.outer(size, size), out=np.where(beyond > 0, np.inf, 0.0), where=np.outer(size, size) > 0)
