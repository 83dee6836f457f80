"""`mode_names`: names of modes from their shapes: nodal diameters and circles of a disc, half waves of a beam or a plate.

The geometry of each part follows from the places of its DOF: a body of revolution is a disc, a slender body a beam, a thin body a
plate. The part with most of the kinetic energy gives a mode its name.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from femsub.checks import POSITION, Array, InputError, instance
from femsub.model import AXES, DofMap, ReducedSubstructure, Substructure, by_places
from femsub.modes.shift_invert import motion_of

if TYPE_CHECKING:
    from femsub.modes.normal_modes import NormalModes
    from femsub.modes.quadratic.complex_modes import ComplexModes


@dataclass(frozen=True)
class ModeName:
    """The name of a mode: its part, its kind of motion and its counts. Made by `mode_names`.

    Attributes
    ----------
    part : str
        The part with the largest share of the kinetic energy.
    share : float
        The share of the kinetic energy in this part.
    family : str
        'disc', 'beam', 'plate', 'rigid', or 'other'.
    motion : str
        For a disc 'out of plane', 'in plane, radial', 'in plane, tangential'; for a beam 'bending', 'torsion' or 'axial'; for a
        plate 'out of plane' or 'in plane'; for a rigid motion 'along x', 'about z'; else the DOF that moves most.
    counts : tuple of int
        Nodal diameters and circles of a disc, half waves of a beam, half waves along the length and the width of a plate.
    purity : float
        The share of the part's motion that has this form.

    Examples
    --------
    >>> import femsub as fs
    >>> beam = fs.beam(1.0, 20, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "pinned", "right": "pinned"})
    >>> name = fs.mode_names(beam, fs.normal_modes(beam, count=3))[2]
    >>> print(name, name.counts)
    beam: bending, 3 half waves (3,)
    """

    part: str
    share: float
    family: str
    motion: str
    counts: tuple[int, ...] = ()
    purity: float = 1.0

    @property
    def same(self) -> tuple[Any, ...]:
        """The values that are equal for the two modes of a pair."""
        return self.part, self.family, self.motion, self.counts

    @property
    def mixed(self) -> bool:
        """Whether less than two thirds of a disc's motion has these counts: attached parts mix its modes."""
        return self.family == "disc" and self.purity < 2 / 3

    @property
    def lines(self) -> str:
        """'4 nodal diameters and 1 nodal circle' for a disc; else ''."""
        if self.family != "disc":
            return ""
        n, m = self.counts
        diameters = f"{n} nodal diameter{'s' * (n != 1)}" if n else "no nodal diameter"
        return diameters + (f" and {m} nodal circle{'s' * (m != 1)}" if m else "")

    @property
    def form(self) -> str:
        """The motion in words, without the part."""
        if self.family == "disc":
            return f"{self.motion}, {'mixed, mostly ' if self.mixed else ''}{self.lines}"
        if self.family in ("beam", "plate"):
            waves = " x ".join(map(str, self.counts))
            twisting = self.family == "plate" and self.motion == "out of plane" and self.counts == (2, 2)
            bending = self.family == "plate" and self.motion == "out of plane" and 1 in self.counts
            return (f"{'twisting' if twisting else 'bending' if bending else self.motion}, {waves} half "
                    f"wave{'s' * (self.counts != (1,))}")
        return f"rigid motion {self.motion}" if self.family == "rigid" else self.motion

    def __str__(self) -> str:
        return f"{self.part}: {self.form}"


class MovingPart(NamedTuple):
    """A part without parts of its own, with its coordinates q (r, k), its displacements u (n, k), and the DOF map of u."""

    name: str
    model: Substructure
    q: Array
    u: Array
    dofs: DofMap | None


def pieces_of(model: Any, X: Array, full: Any = None, name: str = "") -> Iterator[MovingPart]:
    """The innermost parts of a model in the motions X (n, k). `full` is the model that it was reduced from."""
    if full is not None:
        X, model = model.expand(X), full
    parts = getattr(model, "parts", None)
    if not parts:
        reduced = isinstance(model, ReducedSubstructure)
        u, dofs = (model.expand(X), model.full_dofs) if reduced else (X, model.dofs)
        yield MovingPart(name or model.name, model, X, u, dofs)
        return
    q, start = model.L @ X, 0
    for key, part in parts.items():
        yield from pieces_of(part, q[start:start + part.size], name=f"{name}.{key}" if name else key)
        start += part.size


def energies(A: Any, q: Array) -> Array:
    """qᴴAq of each motion, (k,)."""
    return np.einsum("ij,ij->j", q.conj(), A @ q).real


def parts_energies(model: Any, X: Array, full: Any = None) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """The share of each part in qᴴMq and in qᴴKq of motions X (n, k), (k,) each, and qᵀMq, whose angle is twice its phase."""
    pieces = list(pieces_of(model, X, full))
    kinetic, elastic = ({piece.name: energies(getattr(piece.model, key), piece.q) for piece in pieces} for key in "MK")
    for table in (kinetic, elastic):
        whole = sum(table.values())
        table |= {name: np.divide(one, whole, out=np.zeros_like(one), where=whole != 0) for name, one in table.items()}
    return kinetic, elastic, {piece.name: np.einsum("ij,ij->j", piece.q, piece.model.M @ piece.q) for piece in pieces}


def mode_names(model: Substructure, modes: NormalModes | ComplexModes, *, full: Substructure | None = None
               ) -> tuple[ModeName, ...]:
    """Names of modes (n, k) by their shapes: the part that moves most, and its motion.

    A disc is a body of revolution that is not longer than wide, also with a hat, and with pads attached to it. Its motion is
    expanded in cos nθ and sin nθ about its axis. The n with most of the motion is the number of nodal diameters. The changes of
    sign of this term along the radius are the nodal circles. Circles and the plane of the motion are read at the rim, since a hat
    moves in plane where its ring bends. A beam is more than three times as long as wide, a plate more than twice as wide as
    thick. The number of half waves is the number of sign changes plus one. A part without supports of its own, with more than
    half of its motion rigid, has a rigid motion. All other motions are named by the DOF that moves most.

    Parameters
    ----------
    model : Substructure
        Full, reduced or a system.
    modes : NormalModes or ComplexModes
        The modes of this model.
    full : Substructure, optional
        For a reduced system: the system that it was reduced from. Its parts are named.

    Returns
    -------
    tuple of ModeName

    Raises
    ------
    InputError, InputTypeError
        Modes of another model.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.annulus(0.05, 0.15, 0.01, (2, 24, 1))
    >>> disc = fs.solid(mesh, fs.Material(1.1e11, 0.26, 7200.0), supports=["inner"], name="disc")
    >>> for name in fs.mode_names(disc, fs.normal_modes(disc, count=5))[2:]:
    ...     print(name)
    disc: out of plane, no nodal diameter
    disc: out of plane, 2 nodal diameters
    disc: out of plane, 2 nodal diameters
    """
    instance("model", model, Substructure)
    shapes = getattr(modes, "shapes", None)
    if shapes is None or len(shapes) != model.size:
        raise InputError(f"modes must be those of {model.name!r}, as of fs.normal_modes, with {model.size} rows in their shapes")
    check_full(model, full)
    return named(model, np.asarray(shapes), full)


def check_full(model: Any, full: Any) -> None:
    """An error unless `full` is None, or has the DOF that the model was reduced from."""
    if full is not None and not (isinstance(model, ReducedSubstructure) and instance("full", full, Substructure).size
                                 == len(model.V)):
        raise InputError("full must be what the model was reduced from: a substructure with as many DOF as V has rows")


def named(model: Any, X: Array, full: Any = None) -> tuple[ModeName, ...]:
    """The names of motions X (n, k)."""
    pieces = list(pieces_of(model, X, full))
    energy = np.array([energies(piece.model.M, piece.q) for piece in pieces]).reshape(len(pieces), -1)
    whole = energy.sum(axis=0)
    share = energy / np.where(whole > 0, whole, 1.0)
    chosen = share.argmax(axis=0)
    found: dict[int, ModeName] = {}
    for at, piece in enumerate(pieces):
        columns = np.flatnonzero(chosen == at)
        if len(columns):
            shares = share[at, columns]
            found |= zip(columns.tolist(), _of_piece(piece, columns, shares), strict=True)
    return tuple(found[at] for at in range(X.shape[1]))


def _of_piece(piece: MovingPart, columns: Array, shares: Array) -> list[ModeName]:
    """The names of the motions `columns`, in which this part moves most."""
    q, u, model = piece.q[:, columns], piece.u[:, columns], piece.model
    body = None if piece.dofs is None else Geometry.of(piece)
    if body is None:
        most = np.abs(q * np.sqrt(np.abs(model.M.diagonal()))[:, None]).argmax(axis=0)
        return [ModeName(piece.name, float(share), "other", model.dof_name(int(row)))
                for row, share in zip(most, shares, strict=True)]
    # the rigid share of each motion, if no support within the part holds it
    rigid, share = np.zeros_like(q), np.zeros(len(columns))
    if (motion := motion_of(model.rigid_motion) or by_places(model)) is not None and motion.count:
        Z = motion.shapes
        MZ = model.M @ Z
        rigid = Z @ np.linalg.lstsq(Z.T @ MZ, MZ.T @ q, rcond=POSITION**2)[0]
        whole = energies(model.M, q)
        share = np.divide(energies(model.M, rigid), whole, out=share, where=whole > 0)
    moved = model.expand(rigid) if isinstance(model, ReducedSubstructure) else rigid
    elastic = np.flatnonzero(share <= 0.5)
    found = dict(zip(elastic.tolist(), body.named(u[:, elastic]), strict=True))
    found |= {at: ("rigid", body.way(moved[:, at]), (), float(share[at])) for at in np.flatnonzero(share > 0.5).tolist()}
    return [ModeName(piece.name, float(one), *found[at]) for at, one in enumerate(shares)]


class Geometry:
    """The nodes of a part, with the directions in which they move, and its principal axes."""

    def __init__(self, points: Array, rows: Array, weight: Array, around: Array, mass: Array) -> None:
        """Nodes (m, 3), the row of u of each translation (m, 3), -1 for none, and weights (m,).

        `around` (k, 3) are the nodes of the whole part, nodes at supports included, and `mass` (k,) their weights.
        """
        self.points, self.rows, self.weight, self.around, self.mass = points, rows, weight, around, mass
        self.centre = mass @ around / mass.sum()
        centred = around - self.centre
        self.axes = np.linalg.eigh(centred.T @ (mass[:, None] * centred))[1][:, ::-1].T  # the longest axis first
        if np.linalg.det(self.axes) < 0:
            self.axes[2] *= -1
        self.extent = np.ptp(centred @ self.axes.T, axis=0)

    @classmethod
    def of(cls, piece: MovingPart) -> Geometry | None:
        """The geometry of a part from its DOF map; None if no translation of a node is known."""
        dofs = piece.dofs
        if dofs is None or dofs.points is None or not any(label in AXES for label in dofs.labels):
            return None
        axis = np.array([AXES.get(label, -1) for label in dofs.labels])[dofs.components]
        moved = np.flatnonzero(axis >= 0)
        nodes, number = np.unique(dofs.nodes[moved], return_inverse=True)
        points, rows, weight = np.zeros((len(nodes), 3)), np.full((len(nodes), 3), -1), np.zeros(len(nodes))
        points[number, :dofs.points.shape[1]] = dofs.points[moved]
        rows[number, axis[moved]] = moved
        own = piece.model.M.diagonal() if len(piece.u) == piece.model.size else np.ones(dofs.size)
        np.add.at(weight, number, own[moved])
        around, mass = points, weight
        if (held := piece.model.supported) is not None and held.dofs.points is not None:
            around = np.vstack([points, held.dofs.in_space])
            moves = np.isin(np.array(held.dofs.labels)[held.dofs.components], list(AXES))
            mass = np.append(weight, held.mass.diagonal() * moves)
        return cls(points, rows, weight, around, mass) if len(nodes) > 1 and weight.any() else None

    def moved(self, u: Array) -> Array:
        """The translations of the nodes, (m, 3); complex translations are turned to the phase with most motion."""
        v = np.where(self.rows >= 0, u[self.rows], 0.0)
        if np.iscomplexobj(v):
            v = v * np.exp(-0.5j * np.angle((self.weight[:, None] * v * v).sum()))
            v = v.real
        return np.asarray(v)

    @cached_property
    def axis(self) -> tuple[Array, Array] | None:
        """The direction of the axis of a body of revolution, and a point on it; None for other bodies."""
        x = self.around - self.centre
        for at in range(3):
            e, first, second = self.axes[at], self.axes[(at + 1) % 3], self.axes[(at + 2) % 3]
            a, b = x @ first, x @ second
            if abs(self.mass @ (a**2 - b**2)) > 0.1 * (self.mass @ a**2) or np.ptp(x @ e) > np.hypot(a, b).max() * 2:
                continue
            shift = np.zeros(2)
            for _ in range(3):  # the outermost node of each sector lies on the rim, whose centre is fitted
                angle, r = np.arctan2(b - shift[1], a - shift[0]), np.hypot(a - shift[0], b - shift[1])
                sector = np.minimum((angle + np.pi) / (2 * np.pi) * 12, 11).astype(int)
                outer = np.zeros(12)
                np.maximum.at(outer, sector, r)
                rim = r >= (1 - POSITION) * outer[sector]
                A = np.column_stack([2 * a[rim], 2 * b[rim], np.ones(rim.sum())])
                shift = np.linalg.lstsq(A, a[rim]**2 + b[rim]**2, rcond=None)[0][:2]
            if outer.min() > 0.9 * outer.max():
                return e, self.centre + shift[0] * first + shift[1] * second
        return None

    def named(self, U: Array) -> list[tuple[str, str, tuple[int, ...], float]]:
        """Family, motion, counts and purity of each elastic motion (n, k)."""
        V = [self.moved(u) for u in U.T]
        long, wide, thick = self.extent
        if long > 3 * wide:
            return [self.as_beam(v) for v in V]
        if self.axis is not None:
            return self.as_disc(V)
        return [self.as_plate(v) if wide > 2 * thick else ("other", "elastic motion", (), 1.0) for v in V]

    def way(self, u: Array) -> str:
        """The largest component of a rigid motion, among translations and rotations about the centre of mass."""
        v, w = self.moved(u), self.weight[:, None] * (self.rows >= 0)
        centre = self.weight @ self.points / self.weight.sum()
        motions = {f"along {name}": np.tile(e, (len(v), 1)) for name, e in zip("xyz", np.eye(3), strict=True)}
        motions |= {f"about {name}": np.cross(e, self.points - centre) for name, e in zip("xyz", np.eye(3), strict=True)}
        size = {name: float((w * one**2).sum()) for name, one in motions.items()}
        motions = {name: one for name, one in motions.items() if size[name] > POSITION**2 * max(size.values())}
        return max(motions, key=lambda name: abs((w * motions[name] * v).sum()) / size[name]**0.5)

    def as_disc(self, V: list[Array]) -> list[tuple[str, str, tuple[int, ...], float]]:
        disc = self.disc
        found: list[tuple[str, str, tuple[int, ...], float]] = []
        parts = [np.stack([np.einsum("ij,ij->i", v, e) for e in disc.directions]) for v in V]  # radial, tangential, axial
        if not parts:
            return []
        energies = disc.harmonics(np.vstack(parts)).reshape(-1, len(parts), 3)
        for at, part in enumerate(parts):
            energy = energies[:, at]
            n = int(energy.sum(axis=1).argmax())
            ring = (disc.root[disc.ring]**2 * part[:, disc.ring]**2).sum(axis=1)  # a hat moves in the plane where the ring bends
            axial = bool(ring[2] > ring[:2].sum())
            which = 2 if axial else int(ring[:2].argmax())
            motion = "out of plane" if axial else ("in plane, radial", "in plane, tangential")[which]
            purity = float(energy[n].sum() / (self.weight * part**2).sum())
            found.append(("disc", motion, (n, changes(disc.profile(part[which], n))), min(purity, 1.0)))
        return found

    @cached_property
    def disc(self) -> Disc:
        assert self.axis is not None
        return Disc(self.points, self.weight, *self.axis)

    def as_beam(self, v: Array) -> tuple[str, str, tuple[int, ...], float]:
        x = (self.points - self.centre) @ self.axes.T
        station = stations(x[:, 0])
        mass = np.bincount(station, self.weight)
        along, side, up = ((v @ e) for e in self.axes)
        middle = [np.bincount(station, self.weight * x[:, at]) / mass for at in (1, 2)]
        y, z = x[:, 1] - middle[0][station], x[:, 2] - middle[1][station]
        means = np.stack([np.bincount(station, self.weight * one) / mass for one in (along, side, up)])
        polar = np.bincount(station, self.weight * (y**2 + z**2))
        turn = np.divide(np.bincount(station, self.weight * (y * up - z * side)), polar, out=np.zeros(len(mass)),
                         where=polar > POSITION * mass * self.extent[0]**2)
        energy = np.array([mass @ means[0]**2, mass @ (means[1]**2 + means[2]**2), polar @ turn**2])
        kind = int(energy.argmax())
        lines = np.stack([mass**0.5 * means[1], mass**0.5 * means[2]])
        way = np.linalg.svd(lines, full_matrices=False)[0][:, 0]
        profile = (means[0], way @ means[1:], turn)[kind]
        purity = float(energy[kind] / (self.weight[:, None] * v**2).sum())
        return "beam", ("axial", "bending", "torsion")[kind], (changes(profile) + 1,), min(purity, 1.0)

    def as_plate(self, v: Array) -> tuple[str, str, tuple[int, ...], float]:
        x = (self.points - self.centre) @ self.axes.T
        parts = np.stack([v @ e for e in self.axes])
        energy = (self.weight * parts**2).sum(axis=1)
        normal = bool(energy[2] > energy[:2].sum())
        which = 2 if normal else int(energy[:2].argmax())
        bases = [legendre(x[:, at], 6) for at in (0, 1)]
        B = (bases[0][:, :, None] * bases[1][:, None, :]).reshape(len(x), -1)
        root = np.sqrt(self.weight)
        c = np.linalg.lstsq(root[:, None] * B, root * parts[which], rcond=POSITION)[0]
        grids = [np.polynomial.legendre.legvander(np.linspace(-1, 1, 61), one.shape[1] - 1) for one in bases]
        field = grids[0] @ c.reshape(bases[0].shape[1], -1) @ grids[1].T
        U, s, W = np.linalg.svd(field)
        return ("plate", "out of plane" if normal else "in plane", (changes(U[:, 0]) + 1, changes(W[0]) + 1),
                float(s[0]**2 / (s**2).sum()) if s.any() else 0.0)


class Disc:
    """Nodes in cylindrical coordinates about an axis, for the expansion of motions in cos nθ and sin nθ."""

    def __init__(self, points: Array, weight: Array, e: Array, centre: Array) -> None:
        x = points - centre
        height = x @ e
        flat = x - np.outer(height, e)
        r = np.linalg.norm(flat, axis=1)
        first = flat[r.argmax()] / r.max()
        second = np.cross(e, first)
        self.angle = np.arctan2(flat @ second, flat @ first)
        radial = np.cos(self.angle)[:, None] * first + np.sin(self.angle)[:, None] * second
        self.directions = radial, np.cross(e, radial), np.tile(e, (len(x), 1))
        self.root, self.r = np.sqrt(weight), r
        rim = r > r.max() - 0.02 * np.ptp(r) - POSITION * r.max()
        # more diameters than half of the number of nodes along the rim cannot be distinguished; nodes at one angle count once
        count = len(np.unique(np.round(self.angle[rim] / POSITION).astype(int) % round(2 * np.pi / POSITION)))
        self.most = max(1, (count - 1) // 2)
        self.over = (legendre(r, 4)[:, :, None] * legendre(height, 2)[:, None, :]).reshape(len(r), -1)
        low, high = height[rim].min(), height[rim].max()
        slack = 1e-3 * np.ptp(height) + POSITION * r.max()
        self.ring = (height >= low - slack) & (height <= high + slack)

    def harmonics(self, parts: Array) -> Array:
        """Σ w u² of the terms in cos nθ and sin nθ of components (c, m), for each n, (n, c)."""
        found, b = [], (self.root * parts).T
        for n in range(self.most + 1):
            waves = [np.cos(n * self.angle), np.sin(n * self.angle)][:1 if n == 0 else 2]
            B = self.root[:, None] * np.hstack([self.over * wave[:, None] for wave in waves])
            values, turn = np.linalg.eigh(B.T @ B)
            some = values > POSITION * values[-1]
            found.append(((turn[:, some].T @ (B.T @ b))**2 / values[some, None]).sum(axis=0))
        return np.array(found)

    def profile(self, part: Array, n: int) -> Array:
        """The terms in cos nθ and sin nθ of one component, along the radius, in the plane of the rim."""
        at = self.ring
        radial = legendre(self.r[at], 7)
        waves = [np.cos(n * self.angle[at]), np.sin(n * self.angle[at])][:1 if n == 0 else 2]
        B = self.root[at, None] * np.hstack([radial * wave[:, None] for wave in waves])
        c = np.linalg.lstsq(B, self.root[at] * part[at], rcond=POSITION)[0].reshape(len(waves), -1)
        grid = np.polynomial.legendre.legvander(np.linspace(-1, 1, 101), radial.shape[1] - 1)
        lines = c @ grid.T
        return np.asarray(np.linalg.svd(lines, full_matrices=False)[2][0])


def legendre(x: Array, degree: int) -> Array:
    """Legendre polynomials of x (m,), scaled to -1 to 1, up to `degree`, or half the number of different x.

    A polynomial through all of many evenly spaced values would oscillate between them.
    """
    span = float(np.ptp(x))
    if not span:
        return np.ones((len(x), 1))
    places = len(np.unique(np.round((x - x.min()) / span / POSITION)))
    return np.asarray(np.polynomial.legendre.legvander(2 * (x - x.min()) / span - 1, min(degree, (places + 1) // 2)))


def stations(x: Array, most: int = 200, bins: int = 60) -> Array:
    """The number of the cross-section of each node (m,): nodes of equal x, or slices if there are too many different x."""
    span = float(np.ptp(x))
    at = np.round((x - x.min()) / span / POSITION)
    if len(np.unique(at)) > most:
        at = np.floor((x - x.min()) / span * bins * (1 - POSITION))
    return np.asarray(np.unique(at, return_inverse=True)[1].ravel())


def changes(f: Array, least: float = 0.03) -> int:
    """How often f changes its sign, between values that are at least the share `least` of the largest."""
    large = f[np.abs(f) > least * np.abs(f).max(initial=0.0)]
    return int(np.count_nonzero(np.diff(np.sign(large))))
