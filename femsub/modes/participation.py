"""`effective_masses`: how much of a model's mass its modes move if its supports, or its interface, are accelerated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import cg

from femsub.checks import EPS, Array, InputError, NotConvergedError, instance, mapping, real_array, word
from femsub.model import MOTIONS, ReducedSubstructure, Substructure
from femsub.modes import all_modes
from femsub.output import Chart, Column, Displayed, Level, Panel, Series, Table, column, fitted

if TYPE_CHECKING:
    from femsub.modes import NormalModes


@dataclass(frozen=True, eq=False, repr=False)
class EffectiveMasses(Displayed):
    """Participation factors and effective masses of modes, made by `effective_masses`.

    L = ΦᵀP, Γ = L / m, effective masses Γ² m = L² / m, with the forces P (n, d) of the rigid accelerations.

    Attributes
    ----------
    frequencies : ndarray, shape (k,)
        ω in radians per unit of time.
    directions : tuple of str, length d
        'ux', 'uy', 'uz' along the axes, 'rx', 'ry', 'rz' about axes through `origin`.
    coupling : ndarray, shape (k, d)
        L.
    modal_masses : ndarray, shape (k,)
        m = diag(ΦᵀMΦ).
    mass : ndarray, shape (d,)
        The whole mass, or moment of inertia: diag(RᵀMR) over all DOF, those at supports included.
    reach : ndarray, shape (d,)
        diag(PᵀM⁻¹P): the mass that all modes of the model move together. NaN with the interface held, where it is not known.
    interface : ndarray, shape (k, n_b)
        L = Φᵀ(M_ii Ψ_c + M_ib) of fixed-interface modes, for the motion of each interface DOF; (k, 0) for other modes.
    origin : ndarray, shape (3,)

    Examples
    --------
    >>> import femsub as fs
    >>> beam = fs.beam(1.0, 40, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"})
    >>> found = fs.effective_masses(beam, fs.normal_modes(beam, count=4))
    >>> found
    EffectiveMasses: 4 modes move 89.9 % of uz, 99.9 % of ry
    >>> found.shares[:, 0].round(4).tolist()
    [0.6131, 0.1883, 0.0647, 0.0331]
    """

    frequencies: Array
    directions: tuple[str, ...]
    coupling: Array
    modal_masses: Array
    mass: Array
    reach: Array
    interface: Array
    origin: Array

    @property
    def factors(self) -> Array:
        """The participation factors Γ = L / m, (k, d)."""
        return self.coupling / self.modal_masses[:, None]

    @property
    def effective(self) -> Array:
        """The effective masses L² / m, (k, d)."""
        return self.coupling**2 / self.modal_masses[:, None]

    @property
    def shares(self) -> Array:
        """The effective masses relative to the whole mass, (k, d)."""
        return self.effective / self.mass

    @property
    def rest(self) -> Array:
        """The mass that other modes of the model move: `reach` minus the sum of effective masses, (d,)."""
        return self.reach - self.effective.sum(axis=0)

    @property
    def still(self) -> Array:
        """The mass that no mode of the model moves: at supports and, in a reduced model, outside its basis, (d,)."""
        return self.mass - self.reach

    def __repr__(self) -> str:
        moved = ", ".join(f"{share:.1%} of {name}".replace("%", " %")
                          for share, name in zip(self.shares.sum(axis=0), self.directions, strict=True))
        return f"EffectiveMasses: {len(self.frequencies)} modes move {moved}"

    def tables(self) -> list[Table]:
        """A table of the effective masses as shares of the whole mass, with lines for sums."""
        lines = [(at + 1, omega, share) for at, (omega, share) in enumerate(zip(self.frequencies, self.shares, strict=True))]
        held = np.isnan(self.reach).all()
        sums: list[tuple[str, Any, Array]] = [("sum", None, self.shares.sum(axis=0))]
        sums += [("rest", None, 1 - self.shares.sum(axis=0))] if held else [
            ("other modes", None, self.rest / self.mass), ("no mode", None, self.still / self.mass)]
        rows = [{"mode": name, "omega": omega, **dict(zip(self.directions, share.tolist(), strict=True))}
                for name, omega, share in [*((str(at), float(omega), share) for at, omega, share in lines), *sums,
                                           ("mass", None, self.mass)]]
        own = [Column(name, name, "s", "", f"share of the whole mass that the mode moves, {name}", cell=partial(_printed, name))
               for name in self.directions]
        return [Table("masses", rows, [Column("mode", "mode", "s"), column("omega", "ω", ".6g"), *own],
                      "Effective masses, as shares of the whole")]

    def chart(self, title: str = "Effective masses") -> Chart:
        """The share of the whole mass, in %, that the modes up to each frequency move together, for each direction."""
        order = np.argsort(self.frequencies, kind="stable")
        sums = 100 * np.cumsum(self.shares[order], axis=0)
        series = [Series(name, self.frequencies[order], sums[:, at], line="solid", size=4.0, colour=f"C{at % 10}",
                         marker="os^Dv<"[at % 6]) for at, name in enumerate(self.directions)]
        return Chart("masses", title, [Panel(series, "ω  [rad/time]", "share of the whole, summed up  [%]",
                                             levels=[Level(100.0, "", "y", "dot")], limits={"y": (-3.0, 106.0)})], width=0.8)

    def __str__(self) -> str:
        return fitted(self.tables()[0].text())


def _printed(name: str, row: Mapping[str, Any]) -> str:
    """A share rounded to four digits after the point, or the whole mass."""
    return format(row[name], ".4g") if row["mode"] == "mass" else format(round(row[name], 4) + 0.0, ".4f")


def effective_masses(model: Substructure, modes: NormalModes | None = None, *, origin: Any = (0.0, 0.0, 0.0),
                     directions: Mapping[str, Any] | None = None) -> EffectiveMasses:
    """Participation factors L = ΦᵀP, Γ = L / m and effective masses Γ² m of modes (n, k), for rigid accelerations.

    P = M_ff R_f + M_fh R_h (n, d) are the forces of a rigid acceleration R of the part with its supports. f are the DOF of the
    model and h the DOF at supports; without supports P = MR. All modes together move PᵀM⁻¹P. For a part without supports this is
    its whole mass RᵀMR. With supports the remaining mass moves with them.

    The rigid motions follow from the DOF map: six for a solid, uz, rx and ry for a plate, uz and ry for a beam along x. A reduced
    model has the forces VᵀP of its full part, and a system the forces of its parts. If several modes have the same frequency,
    only the sum of their effective masses has a meaning.

    Parameters
    ----------
    model : Substructure
        Full, reduced or a system.
    modes : NormalModes, optional
        Modes of this model. By default, in a Craig-Bampton model, the fixed-interface modes of its basis. Their coupling to
        motions of the interface is M_qb = Φᵀ(M_ii Ψ_c + M_ib), see `EffectiveMasses.interface`.
    origin : array_like, shape (3,)
        The point about which rotations turn.
    directions : mapping of str to array_like, shape (n,), optional
        Rigid motions of a model without a DOF map, in its coordinates, as {"x": [1, 1, 1]}.

    Returns
    -------
    EffectiveMasses
        ``print(fs.effective_masses(...))`` shows the table.

    Raises
    ------
    InputError, InputTypeError
        The rigid motions of the model are not known; the modes are of another model; no modes are given, and the model has no
        fixed-interface modes as coordinates.
    NotConvergedError
        The solution for M⁻¹P has not converged.

    References
    ----------
    J. J. Wijker, Mechanical Vibrations in Spacecraft Design, Springer, 2004 (modal effective mass).

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.block((1.0, 0.1, 0.05), (6, 1, 1), "hexahedron20")
    >>> part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["left"])
    >>> print(fs.effective_masses(part, fs.normal_modes(part, count=3), origin=(0, 0.05, 0.025)))
    mode               ω      ux      uy      uz       rx      ry      rz
    -----------  -------  ------  ------  ------  -------  ------  ------
    1            268.576  0.0000  0.0000  0.6062   0.0000  0.9679  0.0000
    2            530.707  0.0000  0.6078  0.0000   0.0000  0.0000  0.9689
    3            1689.11  0.0000  0.0000  0.1869   0.0000  0.0266  0.0000
    sum                -  0.0000  0.6078  0.7931   0.0000  0.9945  0.9689
    other modes        -  0.9804  0.3726  0.1872   0.9804  0.0055  0.0310
    no mode            -  0.0196  0.0196  0.0196   0.0196  0.0000  0.0000
    mass               -   39.25   39.25   39.25  0.04089   13.09   13.12
    """
    instance("model", model, Substructure)
    about = real_array("origin", origin)
    if about.shape != (3,):
        raise InputError(f"origin must be a point (x, y, z), but its shape is {about.shape}")
    known, whole = None, True
    if directions is not None:
        names = tuple(word("a name in directions", key) for key in mapping("directions", directions, "names and motions"))
        R = [real_array(f"the motion {key!r}", one) for key, one in directions.items()]
        if not names or any(one.shape != (model.size,) for one in R):
            raise InputError(f"each of directions must be a motion of the {model.size} DOF, as {{'x': [1, 1, ...]}}")
        P = np.asarray(model.M @ np.column_stack(R))
        mass = np.einsum("ij,ij->j", np.column_stack(R), P)
    else:
        known = model.rigid_inertia()
        if known is None:
            raise InputError(f"how {model.name!r} moves as a rigid body is not known: it has no DOF map with places, or motions "
                             "such as w,n in it. Give directions={'x': motion}")
        known, names = known.about(about), MOTIONS
        P, mass = known.forces, known.mass.diagonal()
        whole = isinstance(model, ReducedSubstructure) or model.supported is not None or bool(getattr(model, "parts", {}))
    some = np.flatnonzero(mass > EPS * mass.max(initial=0.0))
    if not len(some):
        raise InputError(f"no rigid motion moves any mass of {model.name!r}")
    P, mass, names = P[:, some], mass[some], tuple(names[at] for at in some)

    if modes is None:
        at = np.flatnonzero([kind == "fixed-interface" for kind in getattr(model, "kinds", ())])
        if not len(at) or not len(model.interface):
            raise InputError(f"give modes, e.g. fs.normal_modes(model, count=20): {model.name!r} has no fixed-interface modes as "
                             "coordinates beside its interface, as Craig-Bampton models have")
        interface, own = model.M[np.ix_(at, model.interface)], model.M[np.ix_(at, at)].diagonal()
        omega, L, reach = np.sqrt(model.K[np.ix_(at, at)].diagonal() / own), P[at], np.full(len(mass), np.nan)
    else:
        shapes = getattr(modes, "shapes", None)
        if shapes is None or np.iscomplexobj(shapes) or not hasattr(modes, "frequencies"):
            raise InputError(f"modes must be NormalModes, as of fs.normal_modes(model, count=20), not {type(modes).__name__}")
        if len(shapes) != model.size:
            raise InputError(f"the modes have {len(shapes)} DOF, but {model.name!r} has {model.size}: are they of another model?")
        omega, L, own = modes.frequencies, shapes.T @ P, np.einsum("ij,ij->j", shapes, model.M @ shapes)
        reach, interface = moved_by_all(model, P) if whole else mass, np.zeros((len(omega), 0))
    return EffectiveMasses(omega, names, L, own, mass, reach, interface, about)


def moved_by_all(model: Substructure, P: Array) -> Array:
    """diag(PᵀM⁻¹P) of P (n, d), in the DOF with mass, as 2 PᵀA - AᵀMA with MA = P - R: its error is only -RᵀM⁻¹R.

    By conjugate gradients, since a mass matrix scaled to a diagonal of 1 has a small condition number. For a dense model by
    LAPACK; if its M is singular, as in MacNeal's method, by its modes, since motions without mass follow the others.
    """
    M = model.M
    diagonal = M.diagonal()
    unit = np.where(diagonal > 0, diagonal, np.inf) ** -0.5
    if not sp.issparse(M):
        forces = unit[:, None] * P
        try:
            return np.asarray(np.einsum("ij,ij->j", forces, la.cho_solve(la.cho_factor(M * np.outer(unit, unit)), forces)))
        except la.LinAlgError:
            return np.asarray(((all_modes(model.K, M, carried=model.rigid_motion).shapes.T @ P)**2).sum(axis=0))
    scale = sp.diags_array(unit)
    scaled, A = scale @ M @ scale, np.zeros_like(P)
    for at, column_of in enumerate((unit[:, None] * P).T):
        A[:, at], failed = cg(scaled, column_of, rtol=EPS**0.5, maxiter=10 * len(P))
        if failed:
            raise NotConvergedError("M⁻¹P was not found by conjugate gradients: M is nearly singular. Reduce the model, or look "
                                    "at the shapes of its elements")
    return np.asarray(np.einsum("ij,ij->j", A, 2 * unit[:, None] * P - scaled @ A))
