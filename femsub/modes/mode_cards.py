"""`mode_cards`: for each complex mode the real modes that meet in it, the forces that feed it, where, and one sentence.

For each eigenpair of λ²M + λD + K let λ = σ + iω, m = xᴴMx, xᴴDx = d + ig, and xᴴNx = in for the skew part N of K. The imaginary
part of ω xᴴ(λ²M + λD + K)x = 0 is the balance of power:

    2σ E = -ω² d - ω n,   E = ω² m + ω g / 2.

Without gyroscopic forces (g = 0) E is four times the mean kinetic energy of Re(x exp(iωt)). π/ω times each term on the right is
the work of its force over the period 2π/ω. So each force contributes its power over 2E to Re λ, and these parts add up to Re λ.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import POSITION, Array, InputError, Matrix, instance, whole_number, whole_numbers, word
from femsub.model import (
    MOTIONS,
    TRANSLATIONS,
    Pencil,
    Substructure,
    contacts_of,
    small_matrices,
    without,
)
from femsub.modes import ComplexModes, ModeName, ShiftInvert, all_modes, check_full, modes_below, named, parts_energies
from femsub.output import Chart, Column, Displayed, Level, Panel, Series, Table, column, fitted

if TYPE_CHECKING:
    from femsub.model import Contact, Contacts

MET = 0.1  # share above which a second real mode is said to meet the first


class RealMode(NamedTuple):
    """A real mode of the system without friction, and its part in a complex mode.

    Attributes
    ----------
    frequency : float
        ω in radians per unit of time.
    share : float
        |yᴴMφ φᵀMx| over the sum of these products for all real modes.
    phase : float
        The angle of φᵀMx relative to that of the first real mode, in degrees, -180 to 180.
    name : ModeName
    mass_shares : mapping of str to float
        Its effective mass relative to the whole mass, in each direction of translation: how well a shaker could drive it. Empty
        if the rigid motions of the model are not known.
    place : int
        For a disc: the rank of its pair among the pairs with this motion, from the lowest, counted from 1. A mode without nodal
        diameters has its rank among such modes. 0 for other parts, and if the rank is not clear.
    """

    frequency: float
    share: float
    phase: float
    name: ModeName
    mass_shares: Mapping[str, float] = MappingProxyType({})
    place: int = 0


class ContactWork(NamedTuple):
    """The work of one contact in a complex mode, node by node.

    Attributes
    ----------
    name : str
    nodes : tuple of str, length q
        'disc.under-inboard: node 12', or a port and its column.
    points : ndarray, shape (q, 3)
        The places of the nodes; NaN if they are not known.
    circulatory, damping : ndarray, shape (q,)
        The parts of Re λ by friction forces that follow displacements, and by the contact's damping.
    work : ndarray, shape (q,)
        The work of both in one period, for the shape in its given scale.
    where : str
        The third of the contact that feeds most: 'leading edge', 'middle', 'trailing edge'; '' if there is no direction of
        sliding.
    """

    name: str
    nodes: tuple[str, ...]
    points: Array
    circulatory: Array
    damping: Array
    work: Array
    where: str

    @property
    def growth(self) -> Array:
        """The whole contribution of the contact to Re λ at each node, (q,)."""
        return self.circulatory + self.damping


@dataclass(frozen=True, eq=False, repr=False)
class ModeCard(Displayed):
    """The real modes in a complex mode, and the forces that feed it, made by `mode_cards`.

    Attributes
    ----------
    eigenvalue : complex
    real_modes : tuple of RealMode
        Real modes of the system without friction, the largest share first; `most` of them.
    captured : float
        The share of the kinetic energy of x in the real modes that were computed.
    name : ModeName
        The name of the complex mode itself, at the phase with most motion.
    energy, strain : mapping of str to float
        The share of each part in the kinetic energy and in the elastic energy.
    growth : mapping of str to float
        The parts of Re λ, which add up to Re λ: 'circulatory' from the skew part of K, 'contact damping' and 'damping' from D,
        and 'structural damping'.
    contacts : tuple of ContactWork
    kinetic : float
        E for the shape in its given scale: 2 Re λ E is the power of all forces that are not conservative.
    turn : float
        The angle φ in degrees at which Re(x exp(iφ)), as it is drawn, has most motion.
    phases : mapping of str to float
        The angle at which each part has most motion, relative to the whole, in degrees from -90 to 90: ½ arg of qᵀMq.
    error_bar : float
        The error bar of Re λ. A force that adds less than this does not count as feeding the mode.

    Examples
    --------
    >>> import numpy as np
    >>> import femsub as fs
    >>> hoffmann = fs.Substructure(np.eye(2), [[2.0, 1.0], [1.0, 2.0]], ports={"x": [1, 0], "y": [0, 1]})
    >>> rubbing = fs.LinearContact(("x", "y"), stiffness=[[0.0, -1.2], [0.0, 0.0]])
    >>> modes = fs.complex_modes(hoffmann, rubbing)
    >>> card = fs.mode_cards(hoffmann, rubbing, modes, modes.unstable)[0]
    >>> [round(mode.share, 2) for mode in card.met], round(card.eigenvalue.real, 3), round(card.growth["circulatory"], 3)
    ([0.5, 0.5], 0.157, 0.157)
    """

    eigenvalue: complex
    real_modes: tuple[RealMode, ...]
    captured: float
    name: ModeName
    energy: Mapping[str, float]
    strain: Mapping[str, float]
    growth: Mapping[str, float]
    contacts: tuple[ContactWork, ...]
    kinetic: float
    turn: float
    phases: Mapping[str, float]
    error_bar: float = 0.0

    @property
    def met(self) -> tuple[RealMode, RealMode] | None:
        """The two real modes that meet in the complex mode; None if one real mode makes up most of it."""
        first, *others = self.real_modes
        return (first, others[0]) if others and others[0].share > MET else None

    @property
    def apart(self) -> float:
        """The distance of the two real modes without friction, in radians per unit of time; NaN if only one makes up the mode."""
        return np.nan if self.met is None else abs(self.met[0].frequency - self.met[1].frequency)

    @property
    def work(self) -> dict[str, float]:
        """The work of each kind of force in one period, for the shape in its given scale: 2π E/ω times its part of Re λ."""
        return {key: 2 * np.pi / self.eigenvalue.imag * self.kinetic * part for key, part in self.growth.items()}

    @property
    def feeding(self) -> tuple[ContactWork, ...]:
        """The contacts that feed the mode: the one that adds most to Re λ, and others that add at least half as much."""
        added = [float(one.growth.sum()) for one in self.contacts]
        most = max(added, default=0.0)
        return tuple(one for one, own in zip(self.contacts, added, strict=True) if own > self.error_bar and own >= most / 2)

    @property
    def sentence(self) -> str:
        """The mode in one sentence."""
        return f"{hertz(self.eigenvalue.imag)}: {self._made_of}; {self._fed_by}."

    @property
    def _made_of(self) -> str:
        if self.met is None:
            return f"{phrase(self.real_modes[0])} ({self.real_modes[0].share:.0%} of it)".replace("%", " %")
        one, other = self.met
        among = "among others " if one.share + other.share < 1 - 2 * MET else ""
        how = f"{among}({hertz(self.apart)} apart without friction)"
        if one.name.family == "disc" and one.name.same == other.name.same:
            return f"the two modes of {phrase(one)} meet {how}"
        return f"{phrase(one)} meets {phrase(other)} {how}"

    @property
    def _fed_by(self) -> str:
        """The forces that feed the mode, and whether it grows, in words."""
        feeds = {key: part for key, part in self.growth.items() if part > self.error_bar}
        if not feeds:
            return "nothing feeds it"
        what = "friction" if self.contacts else "the circulatory force"
        if max(feeds, key=lambda key: feeds[key]) != "circulatory":
            what = "negative damping"
        edges = {one.where for one in self.feeding}
        if self.feeding:
            what += f" on {f'the {edges.pop()} of ' if len(edges) == 1 and all(edges) else ''}"
            what += " and ".join(one.name for one in self.feeding)
        return f"{what} feeds it" + ("" if self.eigenvalue.real > self.error_bar else ", and damping takes out more")

    def __repr__(self) -> str:
        return f"ModeCard: {self.sentence}"

    def tables(self) -> list[Table]:
        """Tables of the real modes with their phases, of the parts, and of the forces that add up to Re λ."""
        rows = [{"name": str(one.name), "omega": one.frequency, "share": one.share, "phase": round(one.phase, 3) + 0.0}
                | ({"mass": max(one.mass_shares.values()), "way": max(one.mass_shares, key=one.mass_shares.__getitem__)}
                   if one.mass_shares else {}) for one in self.real_modes]
        shaken = [Column("mass", "mass", ".1%", "", "the largest effective mass of a translation, over the whole"),
                  Column("way", "in", "s", "", "direction of this mass")] if self.real_modes[0].mass_shares else []
        made = Table("real-modes", rows, [
            Column("name", "real mode", "s"), column("omega", "ω", ".6g"), Column("share", "share", ".1%"),
            Column("phase", "phase [°]", ".0f", "°", "of its coordinate, beside the first"), *shaken], "Real modes")
        parts = [{"part": key, "kinetic": share, "elastic": self.strain[key], "phase": round(self.phases[key], 3) + 0.0}
                 for key, share in self.energy.items()]
        forces = [{"force": key, "growth": part, "work": self.work[key]} for key, part in self.growth.items()]
        forces.append({"force": "sum: Re λ", "growth": sum(self.growth.values()), "work": sum(self.work.values())})
        return [made, Table("parts", parts, ["part", Column("kinetic", "kinetic energy", ".1%"),
                                             Column("elastic", "elastic energy", ".1%"),
                                             Column("phase", "phase [°]", ".0f", "°", "of most motion, beside the whole")],
                            "The parts"),
                Table("forces", forces, [Column("force", "force", "s"), Column("growth", "part of Re λ", ".4g", "1/time"),
                                         Column("work", "work in a period", ".4g")], "What feeds it")]

    def chart(self, title: str = "") -> Chart:
        """The shares of the real modes, the parts' shares of the kinetic energy, and the forces that add up to Re λ."""
        bars = (("real mode", "share of the mode  [%]", [(f"{one.name}, {one.frequency:.5g} rad/time", 100 * one.share)
                                                        for one in self.real_modes]),
                ("part", "share of the kinetic energy  [%]", [(name, 100 * share) for name, share in self.energy.items()]),
                ("force", "part of Re λ  [1/time]", list(self.growth.items())))
        panels = []
        for what, label, rows in bars:
            series = [one for rank, (name, value) in enumerate(rows, 1) for one in (
                Series("", [0.0, value], [rank, rank], line="solid", marker="", width=6.0, legend=False,
                       colour="#c0392b" if what == "force" and value > 0 else "#2166ac"),
                Series("", [value / 2], [rank - 0.35], marker="", colour="black", legend=False, labels=[name]))]
            panels.append(Panel(series, label, f"rank of the {what}", levels=[Level(0.0, line="solid", colour="#808080")],
                                limits={"y": (len(rows) + 0.5, 0.3)}, whole="y"))
        most = max(len(rows) for *_, rows in bars)
        return Chart("card", title or self.sentence, panels, 3, width=1.25, height=1.2 + 0.4 * most)

    def __str__(self) -> str:
        return fitted("\n\n".join([self.sentence, *(one.text() for one in self.tables())]))


def mode_cards(model: Substructure | Pencil, contacts: Contacts, modes: ComplexModes, which: Iterable[int] | None = None, *,
               full: Substructure | None = None, parameter: str = "mu", most: int = 6) -> tuple[ModeCard, ...]:
    """Cards of complex modes (λ²M + λD + K)x = 0: the real modes that meet in each, and the forces that add up to Re λ.

    The real modes φ of M and of the symmetric part of K at μ = 0 make up x. Their shares are |yᴴMφ φᵀMx|, the contribution of one
    real mode to yᴴMx with the left vector y, over the sum of all. For a sparse model the real modes up to 1.5 |λ| are taken, and
    y is found in the span of these and x. The parts of Re λ are the powers of the forces over 2E:

        2 Re λ E = -ω² Re xᴴDx - ω Im xᴴKx,   E = ω² xᴴMx + ω Im xᴴDx / 2.

    At a node of a contact the power is Re(conj(iωu)f) with its force f = -(C_K - C_K⁰)u - iω C_D u. C_K⁰ is the symmetric part of
    C_K at μ = 0, or of C_K if the contact has no μ.

    Parameters
    ----------
    model : Substructure or Pencil
        Full, reduced or a system.
    contacts : contact, sequence of contacts or None
        The contacts that the modes were computed with.
    modes : ComplexModes
        Complex modes of this model with these contacts.
    which : iterable of int, optional
        Indices of modes, such as `modes.unstable`. In a pair the mode with Im λ > 0 has the card. By default all oscillating
        modes.
    full : Substructure, optional
        For a reduced system: the system that it was reduced from, so that its parts are named.
    parameter : str
        The field of contacts that is 0 without friction.
    most : int
        The number of real modes in a card.

    Returns
    -------
    tuple of ModeCard
        ``print(card)`` shows a card, ``card.sentence`` is its summary.

    Raises
    ------
    InputError, InputTypeError
        The modes are of another model, a mode does not oscillate, or the system has Lagrange multipliers.
    MissedModesError, SingularMatrixError
        The real modes were not found: K without friction is indefinite.

    References
    ----------
    N. Hoffmann and others, Eur. J. Mech. A 21 (2002) 915 (two modes that meet); H. Ouyang and others, Int. J. Veh. Noise Vib. 1
    (2005) 207.

    Examples
    --------
    >>> import femsub as fs
    >>> model = fs.Pencil([[1, 0], [0, 1]], [[0.02, 0], [0, 0.02]], [[2, 0.3], [-0.3, 2.2]])
    >>> modes = fs.complex_modes(model)
    >>> print(fs.mode_cards(model, None, modes, modes.unstable)[0].tables()[2].text())
    force        part of Re λ  work in a period
    -----------  ------------  ----------------
    circulatory       0.09737            0.8886
    damping             -0.01          -0.09126
    sum: Re λ         0.08737            0.7973
    """
    given = contacts_of(contacts)
    if not isinstance(modes, ComplexModes):
        raise InputError(f"modes must be ComplexModes, as of fs.complex_modes(model, contacts), not {type(modes).__name__}")
    word("parameter", parameter)
    if isinstance(model, Pencil):
        if given:
            raise InputError("a Pencil has no ports for contacts: leave them out, its K and D contain them")
        pencil = still = model
    else:
        pencil = instance("model", model, Substructure, "or a Pencil").linearised(contacts, structural=True)
        if getattr(model, "multipliers", None):
            raise InputError(f"{model.name!r} has Lagrange multipliers, and no real modes of its own. Join its parts with "
                             "assembly='primal'")
        still = model.linearised(without(given, parameter), structural=True)
    if len(modes.shapes) != pencil.size:
        raise InputError(f"the modes have {len(modes.shapes)} DOF, but the model has {pencil.size}: are they of another model?")
    check_full(model, full)
    values = modes.eigenvalues
    chosen = np.flatnonzero((values.imag > 0) & ~modes.rigid) if which is None else whole_numbers("which", which)
    if (bad := [at for at in chosen.tolist() if not 0 <= at < len(values) or values[at].imag == 0]):
        raise InputError(f"which: mode {bad[0]} is not one of those that oscillate, {np.flatnonzero(values.imag).tolist()}")
    chosen = chosen[values[chosen].imag > 0]
    if not len(chosen):
        return ()

    # the real modes of the system without friction
    M, K0 = (A if flag else (A + A.T) * 0.5 for A, flag in zip((still.M, still.K), still.symmetric[::2], strict=True))
    carried = None if still.rigid_motion is None else still.damped_by(None).rigid_motion
    if pencil.is_sparse:
        real = modes_below(K0, M, 1.5 * float(np.abs(values[chosen]).max()), ShiftInvert(K0, M, carried=carried))
    else:
        real = all_modes(K0, M, carried=carried)
    if not len(real.eigenvalues):
        raise InputError(f"no real mode without friction lies below 1.5 |λ| = {1.5 * np.abs(values[chosen]).max():.4g}: "
                         "the modes are no vibrations of this model")
    X = modes.shapes[:, chosen]
    A, B = real.shapes.T @ (M @ X), left_vectors(pencil, values[chosen], X, real.shapes, getattr(model, "H", None))
    product = np.abs(A) * np.abs(B[:len(A)])
    shares = product / product.sum(axis=0)
    order = np.argsort(-shares, axis=0, kind="stable")[:whole_number("most", most, least=2)]
    plain = Substructure(M, K0, name="model") if isinstance(model, Pencil) else model
    below = int(order[:2].max()) + 1  # all modes up to the highest that may meet another, to rank the pairs of a disc
    shown = np.union1d(np.arange(below), order)
    names = dict(zip(shown.tolist(), named(plain, real.shapes[:, shown], full), strict=True))
    places_of_pairs = places_in_families([names[j] for j in range(below)])
    inertia, masses = plain.rigid_inertia(), dict[int, Mapping[str, float]]()
    if inertia is not None:
        ways, of_way = [at for at in inertia.acting if MOTIONS[at] in TRANSLATIONS], inertia.mass.diagonal()
        masses = {j: {MOTIONS[at]: float((phi @ inertia.forces[:, at])**2 / of_way[at]) for at in ways}
                  for j, phi in zip(shown.tolist(), real.shapes[:, shown].T, strict=True)}
    kinetic_of, strain_of, square_of = parts_energies(plain, X, full)
    forms = named(plain, X, full)
    acting = [Acting.of(plain, one, parameter) for one in given]
    cards = []
    for at, (value, x) in enumerate(zip(values[chosen], X.T, strict=True)):
        a = A[:, at]
        angles = np.degrees(np.angle(a * np.conj(a[order[0, at]])))
        made = tuple(RealMode(float(real.frequencies[j]), float(shares[j, at]), float(angles[j]), names[j], masses.get(j, {}),
                              places_of_pairs[j] if j < below else 0)
                     for j in order[:, at].tolist())

        # the balance of power
        omega, inertia, braking = value.imag, np.vdot(x, M @ x).real, np.vdot(x, pencil.D @ x)
        kinetic = omega**2 * inertia + omega * braking.imag / 2
        places = tuple(one.at(omega, x, kinetic) for one in acting)
        parts = {"circulatory": -omega * np.vdot(x, pencil.K @ x).imag / (2 * kinetic)}
        rubbing = float(sum(one.damping.sum() for one in places))
        if acting:
            parts["contact damping"] = rubbing
        parts["damping"] = -omega**2 * braking.real / (2 * kinetic) - rubbing
        if (H := getattr(model, "H", None)) is not None:
            parts["structural damping"] = -omega * np.vdot(x, H @ x).real / (2 * kinetic)
        captured = float((np.abs(a)**2).sum() / inertia)
        whole = sum(one[at] for one in square_of.values())
        phases = {key: float(np.degrees(np.angle(one[at] / whole)) / 2) for key, one in square_of.items()}
        cards.append(ModeCard(
            complex(value), made, captured, forms[at], {key: float(one[at]) for key, one in kinetic_of.items()},
            {key: float(one[at]) for key, one in strain_of.items()}, {key: float(one) for key, one in parts.items()}, places,
            float(kinetic), float(np.degrees(np.angle(whole)) / -2), phases, float(modes.error_bar[chosen[at]])))
    return tuple(cards)


def left_vectors(pencil: Pencil, values: Array, X: Array, Phi: Array, H: Matrix | None) -> Array:
    """y (r, k) with yᴴVᵀP(λ)V = 0, in an M-orthonormal basis V of the real modes Φ, its first columns, and the shapes X.

    Since the span of V contains x, VᵀP(λ)V is singular at the λ of the model itself. If Φ is complete, V y is the left vector.
    """
    M = pencil.M
    E = np.hstack([X.real, X.imag])
    E = E / np.sqrt(np.maximum(np.einsum("ij,ij->j", E, M @ E), np.finfo(float).tiny))
    for _ in range(2):
        E = E - Phi @ (Phi.T @ (M @ E))
    size, turn = np.linalg.eigh(E.T @ (M @ E))
    new = size > POSITION**2
    V = np.hstack([Phi, E @ (turn[:, new] / np.sqrt(size[new]))])
    small = [V.T @ (A @ V) for A in (M, pencil.D, pencil.K if H is None else pencil.K + 1j * H)]
    found = [np.linalg.svd(value**2 * small[0] + value * small[1] + small[2])[0][:, -1] for value in values]
    return np.array(found).T


class Acting(NamedTuple):
    """A contact's forces on its columns W (n, p): -(C - C⁰)u by friction, and -C_D u̇. C⁰ does no work in a period."""

    name: str
    W: Matrix
    friction: Matrix  # C - C⁰
    damping: Matrix
    node: Array  # of each column, its place in `nodes`
    nodes: tuple[str, ...]
    points: Array
    along: Array  # place of each node in the direction of sliding, 0 at the leading edge to 1; NaN without such a direction

    @classmethod
    def of(cls, model: Substructure, contact: Contact, parameter: str) -> Acting:
        still, = without(contact, parameter)
        W, *terms = small_matrices(model, contact)
        damping, C, C0 = (sp.csr_array(A) if sp.issparse(A) or np.ndim(A) else A * sp.eye_array(W.shape[1], format="csr")
                          for A in (*terms, small_matrices(model, still)[2]))
        names, points = columns_of_contact(model, contact)
        nodes = tuple(dict.fromkeys(names))
        number = {name: at for at, name in enumerate(nodes)}
        node, places = np.array([number[name] for name in names]), np.full((len(nodes), 3), np.nan)
        places[node] = points
        title = str(getattr(contact, "first", ", ".join(contact.ports)))
        return cls(title, W, C - (C0 + C0.T) / 2, damping, node, nodes, places, along_sliding(contact, places))

    def at(self, omega: float, x: Array, kinetic: float) -> ContactWork:
        """The parts of Re λ by the forces at each node."""
        u, count = np.asarray(self.W.T @ x), len(self.nodes)
        turning = np.bincount(self.node, -omega * (u.conj() * (self.friction @ u)).imag, count) / (2 * kinetic)
        braking = np.bincount(self.node, -omega**2 * (u.conj() * (self.damping @ u)).real, count) / (2 * kinetic)
        where, total = "", turning + braking
        if np.isfinite(self.along).all():
            third = np.minimum((3 * self.along).astype(int), 2)
            where = ("leading edge", "middle", "trailing edge")[int(np.bincount(third, total, 3).argmax())]
        return ContactWork(self.name, self.nodes, self.points, turning, braking, 2 * np.pi / omega * kinetic * total, where)


def columns_of_contact(model: Substructure, contact: Contact) -> tuple[list[str], Array]:
    """The name of each column of a contact, with the node numbers of the parts, and its place (p, 3)."""
    names: list[str] = []
    for port in contact.ports:
        count = model.port(port).size // model.size
        names += [port] if count == 1 else [f"{port}, column {at + 1}" for at in range(count)]
    points = [np.full((len(names), 3), np.nan)]
    dofs, own = model.interface_dofs, None if model.interface_dofs is None else model.interface_dofs.nodes
    inside = getattr(model, "open", {})
    maps = [model.parts[name].interface_dofs for name in inside]  # type: ignore[attr-defined]
    if all(one is not None for one in maps) and maps:  # a system numbers the nodes of its interface anew
        own = np.concatenate([one.nodes[at] for one, at in zip(maps, inside.values(), strict=True)])
    for key in getattr(contact, "sets", ()):
        places = model.sets[key]
        names += [f"{key}: interface DOF {at}" if own is None else f"{key}: node {own[at]}" for at in places.tolist()]
        points.append(np.full((len(places), 3), np.nan) if dofs is None or dofs.points is None else dofs.in_space[places])
    return names, np.vstack(points)


def along_sliding(contact: Any, points: Array) -> Array:
    """Position of each place in the direction of sliding: 0 at the edge where the second body enters, 1 where it leaves."""
    axis, direction = getattr(contact, "axis", None), getattr(contact, "direction", None)
    if (axis is None and direction is None) or not np.isfinite(points).all() or not len(points):
        return np.full(len(points), np.nan)
    if axis is None:
        s = points @ np.asarray(direction)
    else:
        x, e = points - np.asarray(contact.centre), np.asarray(axis)
        middle = x.mean(axis=0) - e * (x.mean(axis=0) @ e)
        s = np.arctan2(x @ np.cross(e, middle), x @ middle) if np.linalg.norm(middle) > 0 else np.full(len(x), np.nan)
    return np.asarray((s - s.min()) / np.ptp(s)) if np.ptp(s) > 0 else np.full(len(points), np.nan)


def hertz(omega: float) -> str:
    """'2.93 kHz', '34 Hz' for ω in radians per unit of time; the unit of time is taken to be the second."""
    f = omega / (2 * np.pi)
    return f"{f / 1000:.3g} kHz" if f >= 1000 else f"{f:.3g} Hz"


def places_in_families(names: Sequence[ModeName]) -> list[int]:
    """`RealMode.place` of all modes from the lowest on: the rank of the mode's counts among all counts with this motion.

    Attached parts may split or mix a pair of a disc. So the counts are ranked, not the modes. A third clear mode with the same
    counts belongs to another pair, such as a pair of a hat: from there on ranks are not known, 0.
    """
    seen, places, found = Counter[tuple[Any, ...]](), dict[tuple[Any, ...], dict[Any, int]](), list[int]()
    for name in names:
        if name.family != "disc":
            found.append(0)
            continue
        double = name.counts[0] > 0
        own = places.setdefault((name.part, name.motion, double), {})
        place = own.setdefault(name.counts, len(own) + 1)
        seen[name.same] += not name.mixed
        if seen[name.same] > 1 + double:
            own[None] = 0
        found.append(0 if name.mixed or None in own else place)
    return found


def ordinal(number: int) -> str:
    """'1st', '2nd', '3rd', '4th'."""
    return f"{number}{'th' if number % 100 in (11, 12, 13) else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')}"


def phrase(mode: RealMode) -> str:
    """A mode as part of a sentence: "the disc's 3rd out-of-plane pair with 4 nodal diameters"."""
    name, owner = mode.name, f"the {mode.name.part}'s"
    if name.family == "disc":
        motion = name.motion.replace("out of plane", "out-of-plane").replace("in plane, ", "in-plane ")
        if name.mixed:
            return f"{owner} mixed {motion} mode, mostly with {name.lines}"
        place = f"{ordinal(mode.place)} " if mode.place else ""
        return f"{owner} {place}{motion} {'pair' if name.counts[0] else 'mode'} with {name.lines}"
    if name.family in ("beam", "plate"):
        motion, _, waves = name.form.rpartition(", ")
        return f"{owner} {motion.replace(' ', '-')} mode with {waves}"
    if name.family == "rigid":
        return f"{owner} rigid motion {name.motion}"
    return f"{owner} mode at {hertz(mode.frequency)} (mostly {name.motion})"
