"""Contact modes: the real modes of a system whose surfaces touch, and its static responses to their friction forces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from femsub.checks import Array, truth, word
from femsub.errors import InputError
from femsub.model import ReducedSubstructure, Substructure, contact_matrix, contacts_at, contacts_of, small_matrices
from femsub.reduction.basis import Kept, Partition, Statics, projected
from femsub.reduction.estimates.friction import FrictionSpace
from femsub.reduction.estimates.search import chosen_in
from femsub.reduction.free_interface import FreeInterface

if TYPE_CHECKING:
    from femsub.model import Contacts, Pencil
    from femsub.modes import ShiftInvert


@dataclass(frozen=True)
class ContactModes(FreeInterface):
    """Real modes of the system in contact without friction, and what friction adds to them to first order.

    With K₀, the symmetric part of K + K_contact(μ = 0), and K₁ = ∂K_contact/∂μ,

        (K₀ - ω²M) Φ = 0,   Φᵀ M Φ = I,   V = [Φ, Ξ],   Ξ = K₀⁻¹ K₁ Φ without its share of Φ.

    Φ alone is the usual choice for brakes. It represents the response to the friction forces K₁Φ only by the modes that are
    kept. Ξ is that response, exact at ω = 0. The basis has twice as many columns as modes, less those that depend on others.

    It is a second step for a system of reduced parts, whose contact surfaces are a large interface; and the only step for a
    full system. The contact itself is not part of the result: give it to the analysis, as for the full system. It acts on the
    same sets.

    Parameters
    ----------
    modes : int
        Number of elastic modes of the system in contact.
    band : (lo, hi), with tol : float
        In place of `modes`: few modes that keep every λ of the system with friction within the relative error `tol`, if
        lo ≤ Im λ ≤ hi and |Re λ| ≤ hi. This holds for the contacts as they are given, with their μ. ``.estimate`` has the error
        of each λ, and where λ of the full system is. `complex_modes` under these contacts calls a mode stable or unstable only if
        both agree. If that makes the basis smaller, the responses to K₁ᵀΦ and D₁Φ join it, too; D₁ is what the contacts add to D.
    contacts : contact, or sequence of contacts
        `FrictionContact` or others whose stiffness is linear in the parameter.
    parameter : str
        The field of the contacts that is 0 in K₀, by default 'mu'.
    friction : bool
        Whether Ξ joins the basis, by default True.

    Raises
    ------
    InputError, InputTypeError
        No contacts, or none with this parameter.
    NotConvergedError
        When it is used: no model meets the tolerance, or it cannot be excluded that the full system has further eigenvalues.

    References
    ----------
    N. Gräbner, V. Mehrmann, S. Quraishi, C. Schröder, U. von Wagner, ZAMM 96 (2016) 1155 (real modes and what they miss);
    J. M. Dickens, J. M. Nakagawa, M. J. Wittbrodt, Comput. Struct. 62 (1997) 985 (static responses beside modes).

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
    judges_ports = False  # an error would be that of the system in contact
    offered = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not contacts_of(self.contacts):
            raise InputError("ContactModes needs the contacts of the system, e.g. contacts=[fs.FrictionContact(...)]")
        truth("friction", self.friction)
        contacts_at(self.contacts, word("parameter", self.parameter), 0.0)

    @property
    def row_key(self) -> str:
        return self.key if self.friction else "real-modes"

    def part(self, sub: Substructure) -> Rubbing:
        """The whole system with the contact's stiffness at μ = 0, and K₁."""
        pencil, terms = sub.pencil, []
        for without, with_friction in zip(*(contacts_at(self.contacts, self.parameter, mu) for mu in (0.0, 1.0)), strict=True):
            (W, _, C0), (_, _, C1) = small_matrices(sub, without), small_matrices(sub, with_friction)
            pencil = pencil.with_contact(0.0, W, C0)
            terms.append(contact_matrix(W, C1 - C0))  # a difference of two K would take the memory of both
        K0 = pencil.K if pencil.symmetric[2] else (pencil.K + pencil.K.T) * 0.5
        damping = None if self.band is None else sub.linearised(self.contacts, structural=True).D - sub.D
        whole = Substructure(sub.M, K0, None, sub.interface, sub.ports, sub.name)
        if pencil.rigid_motion is not None:  # the contact's stiffness would be rounding in it
            whole = whole._with(rigid_motion=pencil.damped_by(None).rigid_motion)
        return Rubbing(whole, slice(None), friction=sum(terms), damping=damping)

    def static_columns(self, sub: Substructure) -> int:
        """One response to friction for each mode; the interface has no shapes of its own, however large it is."""
        return (self.modes or 0) if self.friction else 0

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """No constraint modes; of the forces only those of the ports, since the others follow from the modes."""
        return Statics.of(part, handle, extra, "friction response")

    def judged(self, sub: Substructure, contacts: Contacts) -> Pencil:
        """The system with its friction, and with the further contacts."""
        return sub.linearised([*contacts_of(self.contacts), *contacts_of(contacts)], structural=True)

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """A given number of modes, or as many as the tolerance requires; see `FrictionSpace`."""
        part = statics.part
        assert isinstance(part, Rubbing)
        if (goal := self.goal) is None or pencil is None:
            kept = super().kept(statics, pencil)
            return replace(kept, forces=part.friction @ kept.shapes) if self.friction else kept
        return chosen_in(FrictionSpace(statics, pencil, part.friction, part.damping, self.friction), goal)

    def finished(self, sub: Substructure, model: ReducedSubstructure) -> ReducedSubstructure:
        """With VᵀKV of the system itself: the contact is no part of it."""
        K, motion = projected(sub.K, model.V, model.V), model.rigid_motion
        if motion is not None:  # what moves in contact does so without it
            motion = replace(motion, belong=None)  # type: ignore[type-var]
        found = replace(model, K=(K + K.T) / 2, estimated=None, rigid_motion=motion)
        found._set(wider=replace(model.wider, part=self.part))
        return found


@dataclass(frozen=True, eq=False)
class Rubbing(Partition):
    """A system with its contact at μ = 0, K₁ = ∂K/∂μ, and, for a tolerance, what the contact adds to D."""

    friction: Any = None
    damping: Any = None
