"""Contact modes: the real modes of a system whose surfaces touch, and its static responses to their friction forces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la

from femsub.algebra import ROUNDING
from femsub.checks import Array, InputError, truth, word
from femsub.model import Affine, ReducedSubstructure, Substructure, contact_matrix, contacts_at, contacts_of, small_matrices
from femsub.reduction.basis import Basis, Kept, Partition, Statics, projected
from femsub.reduction.free_interface import FreeInterface
from femsub.reduction.vectors import vectors_within

if TYPE_CHECKING:
    from femsub.model import Contacts, Pencil
    from femsub.modes import ShiftInvert
    from femsub.reduction.method import Request

@dataclass(frozen=True)
class ContactModes(FreeInterface):
    """Real modes of the system in contact without friction, and their static responses to the friction forces.

    With K₀, the symmetric part of K + K_contact(μ = 0), and K₁ = ∂K_contact/∂μ,

        (K₀ - ω²M) Φ = 0,   Φᵀ M Φ = I,   V = [Φ, Ξ],   Ξ = K₀⁻¹ K₁ Φ without the components in Φ.

    Φ alone is the usual choice for brakes. It represents the response to the friction forces K₁Φ only by the modes that are
    kept. With Ξ this response is exact at ω = 0. The basis has two columns for each mode, minus dependent columns.

    Use it as a second step for a system of reduced parts, whose contact surfaces are a large interface, or as the only step for
    a full system. The result does not include the contact: give it to the analysis, as for the full system. It acts on the same
    sets.

    Parameters
    ----------
    modes : int
        Number of elastic modes of the system in contact.
    band : (lo, hi), with tol : float
        In place of `modes`: right and left vectors of the system with friction that keep every λ within the relative error `tol`,
        if lo ≤ Im λ ≤ hi and |Re λ| ≤ hi. This is a `ParameterBox` of one value: it holds for the given contacts with their μ.
        The number of eigenvalues is counted. ``.estimate`` has the error of each λ, and hence a region that contains the λ of the
        full system. `complex_modes` under these contacts calls a mode stable or unstable only if this holds for both λ. For other
        values of μ use a `ParameterBox` over μ, or a number of modes.
    contacts : contact, or sequence of contacts
        `FrictionContact` or others whose stiffness is linear in the parameter.
    parameter : str
        The field of the contacts that is 0 in K₀, by default 'mu'.
    friction : bool
        Whether Ξ joins the basis, by default True; only with a number of modes.

    Raises
    ------
    InputError, InputTypeError
        No contacts, or none with this parameter; a tolerance without friction.
    NotConvergedError
        Raised by `reduce`: no model meets the tolerance, or the eigenvalues of the full system in the band cannot be counted.

    References
    ----------
    N. Gräbner, V. Mehrmann, S. Quraishi, C. Schröder, U. von Wagner, ZAMM 96 (2016) 1155 (real modes and their errors);
    J. M. Dickens, J. M. Nakagawa, M. J. Wittbrodt, Comput. Struct. 62 (1997) 985 (static responses in addition to modes).

    Examples
    --------
    >>> import femsub as fs
    >>> steel, mesh = fs.Material(2.1e11, 0.3, 7850.0), fs.block((0.1, 0.05, 0.02), (4, 2, 1))
    >>> pad = fs.solid(mesh, steel, supports=["top"], interface=["bottom"])
    >>> rubbing = fs.FrictionContact("bottom", "ground", mesh, stiffness=1e12, mu=0.4, direction=(1, 0, 0))
    >>> small = fs.reduce(pad, fs.ContactModes(4, contacts=rubbing))
    >>> small.size, small.modes, small.linearised(rubbing)
    (8, 4, Pencil: 8 DOF, dense, K unsymmetric, cut-off 2.793e+05 rad/time)
    >>> small = fs.reduce(pad, fs.ContactModes(band=(0, 3e5), tol=1e-3, contacts=rubbing))
    >>> small.estimate.met, fs.complex_modes(small, rubbing, band=(0, 3e5)).full_growth.shape
    (True, (6, 2))
    """

    contacts: Any = None
    parameter: str = "mu"
    friction: bool = True

    key, label, colour, marker = "contact-modes", "Contact modes", "#c51b7d", "*"
    takes_cutoff = False
    mode_kind = "real"
    judges_ports = False  # the static error would hold for the system in contact, not for the system itself
    offered = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not contacts_of(self.contacts):
            raise InputError("ContactModes needs the contacts of the system, e.g. contacts=[fs.FrictionContact(...)]")
        if not truth("friction", self.friction) and self.band is not None:
            raise InputError("a tolerance includes the effect of friction: friction=False needs a number of modes")
        contacts_at(self.contacts, word("parameter", self.parameter), 0.0)

    @property
    def row_key(self) -> str:
        return self.key if self.friction else "real-modes"

    def title(self, modes: int) -> str:
        """'Contact modes with 4 real modes', or 'Contact modes of 6 λ within 0.001' with a tolerance."""
        return super().title(modes) if self.goal is None else f"{self.label} of {modes} λ within {self.goal.tol:g}"

    def part(self, sub: Substructure) -> Rubbing:
        """The system with the contact's stiffness at μ = 0, and K₁."""
        pencil, terms = sub.pencil, []
        for without, with_friction in zip(*(contacts_at(self.contacts, self.parameter, mu) for mu in (0.0, 1.0)), strict=True):
            (W, _, C0), (_, _, C1) = small_matrices(sub, without), small_matrices(sub, with_friction)
            pencil = pencil.with_contact(0.0, W, C0)
            terms.append(contact_matrix(W, C1 - C0))  # a difference of two K would take the memory of both
        K0 = pencil.K if pencil.symmetric[2] else (pencil.K + pencil.K.T) * 0.5
        whole = Substructure(sub.M, K0, None, sub.interface, sub.ports, sub.name)
        if pencil.rigid_motion is not None:  # rigid motion that remains in contact; K0 would show it only within rounding
            whole = whole._with(rigid_motion=pencil.damped_by(None).rigid_motion)
        return Rubbing(whole, slice(None), friction=sum(terms))

    def static_columns(self, sub: Substructure) -> int:
        """One response to friction for each mode; interface DOF add no static shapes."""
        return (self.modes or 0) if self.friction else 0

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """No constraint modes, and only the forces of ports: the friction forces follow later, from the modes."""
        return Statics.of(part, handle, extra, "friction response")

    def judged(self, sub: Substructure, contacts: Contacts) -> Pencil:
        """The system with its friction, and with the further contacts."""
        return sub.linearised([*contacts_of(self.contacts), *contacts_of(contacts)], structural=True)

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """The given number of modes, and the friction forces K₁Φ."""
        part, kept = statics.part, super().kept(statics, pencil)
        assert isinstance(part, Rubbing)
        return replace(kept, forces=part.friction @ kept.shapes) if self.friction else kept

    @property
    def by_vectors(self) -> bool:
        """True with a tolerance."""
        return self.goal is not None

    def vectors(self, request: Request) -> Basis:
        """[Z, V] for a tolerance: Z is rigid motion that the contacts do not resist, V are the other vectors, ZᵀMV = 0."""
        goal, pencil, sub = self.goal, request.pencil, request.sub
        assert goal is not None and pencil is not None
        friction = [contact_matrix(W, C1 - C0) for (W, _, C1), (_, _, C0) in (
            [small_matrices(sub, one) for one in pair] for pair in
            zip(contacts_of(self.contacts), contacts_at(self.contacts, self.parameter, 0.0), strict=True))]
        K = pencil.K - sum(friction)
        if abs(K - K.T).max() <= ROUNDING * abs(pencil.K).max():  # friction alone makes K unsymmetric
            K = (K + K.T) / 2
        motion = sub.floating(self.contacts)
        Z = np.zeros((sub.size, 0)) if motion is None else motion.shapes
        answers = self.part(sub).factored().elastic_solve(request.extra) if request.extra.shape[1] else request.extra
        family = Affine(pencil.M, pencil.D, [(1.0, K), (1.0, sum(friction))])
        V, estimate = vectors_within(family, goal, np.hstack([Z, answers]), repr(sub.name))
        V = np.hstack([Z, V @ la.null_space((sub.M @ Z).T @ V) if Z.shape[1] else V])
        M, K = (projected(A, V, V, symmetric=True) for A in (sub.M, sub.K))
        kinds = ("rigid",) * Z.shape[1] + ("complex",) * (V.shape[1] - Z.shape[1])
        return Basis(V, (M + M.T) / 2, (K + K.T) / 2, kinds, estimate.modes, estimate.cutoff, 0, {}, 1, V[sub.interface],
                     estimate, np.eye(V.shape[1], Z.shape[1]), Z)

    def finished(self, sub: Substructure, model: ReducedSubstructure) -> ReducedSubstructure:
        """The model with VᵀKV, K of the system without contact."""
        wider = replace(model.wider, part=self.part)
        if self.goal is None:
            K, motion = projected(sub.K, model.V, model.V), model.rigid_motion
            if motion is not None:  # motion that is rigid in contact is also rigid without contact
                motion = replace(motion, belong=None)  # type: ignore[type-var]
            model = replace(model, K=(K + K.T) / 2, estimated=None, rigid_motion=motion)
        model._set(wider=wider)
        return model


@dataclass(frozen=True, eq=False)
class Rubbing(Partition):
    """A system with its contact at μ = 0, and K₁ = ∂K/∂μ."""

    friction: Any = None
