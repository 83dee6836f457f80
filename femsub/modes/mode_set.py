"""Modes that are known at some degrees of freedom only, such as measured modes, and their comparison with a model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import Frozen
from femsub.checks import Array, InputError, instance, items, positive_number, rows, shown
from femsub.model import MOTIONS, DofMap, ReducedSubstructure, Substructure
from femsub.modes.normal_modes import moved
from femsub.modes.quadratic.matching import CLUSTER, NEAR, match

if TYPE_CHECKING:
    from femsub.modes.normal_modes import NormalModes
    from femsub.modes.quadratic.complex_modes import ComplexModes


@dataclass(frozen=True, eq=False, repr=False)
class ModeSet(Frozen):
    """Modes without matrices: λ, shape (k,), and shapes (m, k) at m degrees of freedom. Made by `read_modes`.

    λ = -ζω + iω√(1 - ζ²) for an oscillation with the frequency ω and the damping ratio ζ.

    Parameters
    ----------
    eigenvalues : array_like of complex, shape (k,)
        λ in radians per unit of time, one of each pair, Im λ ≥ 0.
    shapes : array_like, shape (m, k)
        Real or complex, each in a scale of its own.
    dofs : DofMap
        Node and direction of each row, with the places of nodes if they are known.
    notes : sequence of str
        Remarks of the reader.

    Raises
    ------
    InputError
        Sizes that do not fit, numbers that are not finite, a mode without motion, Im λ < 0.

    Examples
    --------
    >>> import numpy as np
    >>> import femsub as fs
    >>> dofs = fs.DofMap(nodes=[1, 2], components=[0, 0], labels=("ux",))
    >>> known = fs.ModeSet([1j, -0.02 + 2j], np.array([[1.0, 1.0], [1.0, -1.0]]), dofs)
    >>> known
    ModeSet: 2 modes at 2 DOF, ω 1 to 2.0001 rad/time
    >>> known.damping.round(3).tolist()
    [0.0, 0.01]
    """

    eigenvalues: Array
    shapes: Array
    dofs: DofMap
    notes: tuple[str, ...] = ()

    def __init__(self, eigenvalues: Any, shapes: Any, dofs: DofMap, notes: Iterable[str] = ()) -> None:
        values, columns = np.atleast_1d(rows("eigenvalues", eigenvalues)), rows("shapes", shapes)
        m, kinds = instance("dofs", dofs, DofMap).size, {values.dtype.kind, columns.dtype.kind}
        if values.ndim != 1 or columns.shape != (m, len(values)) or not kinds <= set("fciu") or not len(values):
            raise InputError(f"shapes must be numbers of shape ({m}, {values.size}), a row per DOF and a column for each of the "
                             f"eigenvalues, {shown(values)}, not {shown(columns)}")
        if not (np.isfinite(values).all() and np.isfinite(columns).all() and (values.imag >= 0).all()):
            raise InputError("eigenvalues and shapes must be finite, and Im λ ≥ 0: give one of each pair")
        if not columns.any(axis=0).all():
            raise InputError(f"mode {int(np.argmin(columns.any(axis=0))) + 1} has no motion")
        texts = tuple(instance("each of notes", one, str) for one in items("notes", notes, "strings"))
        self._set(eigenvalues=values + 0j, shapes=columns * 1.0, dofs=dofs, notes=texts)

    @classmethod
    def of(cls, eigenvalues: Array, shapes: Array, nodes: Array, directions: Array, points: Array | None = None,
           notes: Iterable[str] = ()) -> ModeSet:
        """Modes by node and direction (0 to 5, ux to rz) of each row, ascending, without rows that are 0 in every mode."""
        order, moved = np.argsort(np.abs(eigenvalues), kind="stable"), shapes.any(axis=1)
        dofs = DofMap(nodes, directions, MOTIONS, points).kept(np.flatnonzero(moved))
        return cls(eigenvalues[order], shapes[moved][:, order], dofs, notes)

    @property
    def frequencies(self) -> Array:
        """ω = |λ| in radians per unit of time, shape (k,)."""
        return np.abs(self.eigenvalues)

    @property
    def damping(self) -> Array:
        """The damping ratios ζ = -Re λ / |λ|, shape (k,)."""
        return 0.0 - self.eigenvalues.real / np.maximum(self.frequencies, np.finfo(float).tiny)

    def __repr__(self) -> str:
        ends = self.frequencies.min(), self.frequencies.max()
        return f"ModeSet: {len(self.eigenvalues)} modes at {self.dofs.size} DOF, ω {ends[0]:.5g} to {ends[1]:.5g} rad/time"

    def compare(self, model: Substructure, modes: NormalModes | ComplexModes, *, tol: float | None = None) -> ModePairs:
        """Pair these modes with those of a model by their shapes at the common DOF.

        MAC = |xᴴy|² / (xᴴx yᴴy), shape (k, l), with the shapes x (p, k) known and y (p, l) of the model at p DOF (Allemang and
        Brown 1982). Rotations count only if there are no common displacements, since they have another unit.

        Parameters
        ----------
        model : Substructure
            Full or reduced, with the DOF map of its nodes.
        modes : NormalModes or ComplexModes
            The modes of this model. Complex modes count if Im λ ≥ 0.
        tol : float, optional
            If node numbers differ: each node is matched to the model's nearest node, up to this distance. By default nodes are
            matched by their numbers.

        Returns
        -------
        ModePairs

        Raises
        ------
        InputError
            A model without a DOF map, no common DOF, modes of another model, `tol` without places.

        Examples
        --------
        >>> import femsub as fs
        >>> mesh = fs.block((1.0, 0.1, 0.1), (4, 1, 1), "hexahedron")
        >>> part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
        >>> own = fs.normal_modes(part, count=4)
        >>> known = fs.ModeSet(1j * own.frequencies, own.shapes, part.dofs)
        >>> rom = fs.reduce(part, fs.CraigBampton(6))
        >>> known.compare(rom, fs.normal_modes(rom, count=4)).mac.round(3).tolist()[6:]
        [1.0, 1.0, 1.0, 1.0]
        """
        instance("model", model, Substructure)
        dofs = model.full_dofs if isinstance(model, ReducedSubstructure) else model.dofs
        if dofs is None:
            raise InputError(f"{model.name!r} has no DOF map, so its motions have no names. Compare with a part that has one")
        values, shapes = np.asarray(modes.eigenvalues), np.asarray(modes.shapes)
        values, shapes = (values[values.imag >= 0], shapes[:, values.imag >= 0]) if np.iscomplexobj(values) else \
            (1j * np.sqrt(values), shapes)
        if len(shapes) != model.size:
            raise InputError(f"the modes have {len(shapes)} DOF, but {model.name!r} has {model.size}: are they of another model?")
        here, there = self._common(dofs, tol)
        x = self.shapes[here]
        y = (model.expand(shapes) if isinstance(model, ReducedSubstructure) else shapes)[there]
        size = np.einsum("ij,ij->j", x.conj(), x).real, np.einsum("ij,ij->j", y.conj(), y).real
        table = np.abs(x.conj().T @ y) ** 2 / np.maximum(np.outer(*size), np.finfo(float).tiny)
        known, found = match(self.eigenvalues, values, table, weight=1.0, far=NEAR)
        together = np.abs(values[found][:, None] - values) <= CLUSTER * np.abs(values[found])[:, None]
        mac = np.array([_share(x[:, one], y[:, group]) for one, group in zip(known, together, strict=True)])
        ends = np.abs(values[found]), self.frequencies[known]
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.where(ends[0] == ends[1], 0.0, ends[0] / ends[1] - 1)
        directions = getattr(modes, "directions", ())
        return ModePairs(known, found, mac, change, table, len(here), directions,
                         modes.mass_shares[found] if directions else np.zeros((len(found), 0)))  # type: ignore[union-attr]

    def _common(self, dofs: DofMap, tol: float | None) -> tuple[Array, Array]:
        """Rows of this set, and rows of the model's map for the same motions."""
        nodes = self.dofs.nodes
        if tol is not None:  # for each row the number of the model's nearest node; -1 if none is near
            from scipy.spatial import cKDTree

            positive_number("tol", tol)
            if self.dofs.points is None or dofs.points is None or self.dofs.points.shape[1] != dofs.points.shape[1]:
                raise InputError("tol needs the places of the nodes here and there, in as many coordinates")
            distance, at = cKDTree(dofs.points).query(self.dofs.points)
            nodes = np.where(distance <= tol, dofs.nodes[at], -1)
        labels, theirs = ([one.labels[kind] for kind in one.components] for one in (self.dofs, dofs))
        place = {key: at for at, key in enumerate(zip(dofs.nodes.tolist(), theirs, strict=True))}
        both = [(at, place[key]) for at, key in enumerate(zip(nodes.tolist(), labels, strict=True)) if key in place]
        both = [pair for pair in both if labels[pair[0]] not in MOTIONS[3:]] or both
        if not both:
            raise InputError(f"the modes and the model have no DOF in common: {self.dofs} here, {dofs} there. Where the "
                             "numbers of the nodes differ, tol= finds them by their places")
        here, there = np.array(both).T
        return here, there


@dataclass(frozen=True, eq=False, repr=False)
class ModePairs(Frozen):
    """Pairs of known modes and modes of a model, made by `ModeSet.compare`.

    Attributes
    ----------
    known, found : ndarray of int, shape (p,)
        Indices of the known modes, and of their partners among the model's modes.
    mac : ndarray, shape (p,)
        xᴴPx / xᴴx, where P projects on the model's modes of that frequency (within 0.1 %): for a single mode the MAC.
    change : ndarray, shape (p,)
        ω of the model over the known ω, minus 1; inf if a known rigid-body motion is paired with an elastic mode.
    table : ndarray, shape (k, l)
        The MAC of each known mode and each mode of the model.
    dofs : int
        DOF that were compared.
    directions : tuple of str, length d
        Directions of the model's effective masses, see `NormalModes`; empty for complex modes.
    mass_shares : ndarray, shape (p, d)
        The effective masses of the model's paired modes, over its whole mass.
    """

    known: Array
    found: Array
    mac: Array
    change: Array
    table: Array
    dofs: int
    directions: tuple[str, ...] = ()
    mass_shares: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __repr__(self) -> str:
        return (f"ModePairs: {len(self.known)} of {len(self.table)} modes at {self.dofs} DOF, smallest MAC {self.mac.min():.3f}, "
                f"largest change of ω {np.abs(self.change).max():.1e}{moved(self.directions, self.mass_shares)}")


def _share(x: Array, Y: Array) -> float:
    """xᴴPx / xᴴx with the orthogonal projector P on the columns of Y."""
    size = np.linalg.norm(Y, axis=0)
    basis = Y[:, size > 0] / size[size > 0]
    held = basis @ np.linalg.lstsq(basis, x, rcond=None)[0]
    return float(min((x.conj() @ held).real / (x.conj() @ x).real, 1.0)) if x.any() else 0.0
