"""`MaterialChange`: another material in some cells of a solid, a plate or a beam, from the matrices of these elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from femsub.checks import Array, InputError, Matrix, choice, finite_number, instance, positive_number, whole_numbers, word
from femsub.components.beam import LABELS, element_lengths
from femsub.components.bending_elements import hermite_matrices
from femsub.components.build import gathered, not_negative, rayleigh_factors
from femsub.components.mesh import Mesh
from femsub.components.plate import Layout
from femsub.components.solid_assembly import Material, lame, stiffness_and_mass
from femsub.model import TRANSLATIONS, Change, ChangeTerm, DofMap, Jet, displacements, full_dofs

Values = Mapping[str, Any]
#: For each kind of component: the matrix, 'K' or 'M', and its factor as a function of the constants of the material.
FACTORS: Mapping[str, tuple[tuple[str, Callable[[Values], Any]], ...]] = {
    "solid": (("K", lambda of: lame(of["E"], of["nu"])[0]), ("K", lambda of: lame(of["E"], of["nu"])[1]),
              ("M", lambda of: of["rho"])),
    "plate": (("K", lambda of: _bending(of)), ("K", lambda of: _bending(of) * of["nu"]),
              ("M", lambda of: of["rho"] * of["thickness"])),
    "beam": (("K", lambda of: of["E"] * of["I"]), ("K", lambda of: of["foundation"]), ("M", lambda of: of["rho"] * of["A"]))}


def _scaled(by: float | str, factor: Callable[[Values], Any], of: Values) -> Any:
    return (of[by] if isinstance(by, str) else by) * factor(of)


def _bending(of: Values) -> Any:
    return of["E"] * of["thickness"] ** 3 / (12 * (1 - of["nu"] ** 2))


@dataclass(frozen=True, eq=False, repr=False)
class MaterialChange(Change):
    """Another value of one constant of the material in some cells: ΔK = Σ_i (c_i(p + a) - c_i(p)) K_i, and ΔM likewise.

    Create one with `solid`, `plate` or `beam`, which take the arguments of the builders with the same names. K_i and M_i are
    matrices of the cells' elements, so any amount is exact, and so are derivatives. A model does not know the material with which
    it was built: give the same constants here.

    Attributes
    ----------
    kind : 'solid', 'plate' or 'beam'
    parameter : str
        The constant that changes.
    amount : float
        The difference from its present value, in its unit.
    constants : mapping of str to float
        The present values of all constants.
    matrices : tuple of sparse matrices
        K_i and M_i of the cells, in the order of `FACTORS`.
    dofs : DofMap
        The DOF of the cells.
    part : str
        The part of a system; '' for a model that is not a system.
    where : str
        The group of cells.
    rayleigh : (alpha, beta), optional
        D changes by αΔM + βΔK.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.block((1.0, 0.1, 0.1), (4, 1, 1)), fs.Material(2.1e11, 0.3, 7850.0)
    >>> bar = fs.solid(mesh, steel, supports=["left"])
    >>> softer = fs.MaterialChange.solid(mesh, steel, "E", -2.1e10)
    >>> print(f"{abs(fs.modified(bar, [softer]).K - 0.9 * bar.K).max() / bar.K.max():.0e}")
    2e-16
    """

    kind: str
    parameter: str
    amount: float
    constants: Mapping[str, float]
    matrices: tuple[Matrix, ...]
    dofs: DofMap
    part: str = ""
    where: str = ""
    rayleigh: tuple[float, float] | None = None

    def __repr__(self) -> str:
        return f"MaterialChange: {self.name}, {self.value:g} {self.amount:+g}"

    @property
    def name(self) -> str:
        return f"{self.parameter} of {' '.join(one for one in (self.part, self.where) if one) or self.kind}"

    def __post_init__(self) -> None:
        choice("parameter", self.parameter, self.constants)
        word("part", self.part)
        if self.rayleigh is not None:
            object.__setattr__(self, "rayleigh", rayleigh_factors(self.rayleigh))
        self.allowed(0.0)
        self.allowed(finite_number("amount", self.amount))

    def allowed(self, amount: float) -> None:
        """Raise an `InputError` for an amount that gives no valid material."""
        of = {**self.constants, self.parameter: self.value + amount}
        if self.kind == "solid":
            Material(**of)
        elif self.kind == "plate":
            Material(of["E"], of["nu"], of["rho"])
            positive_number("thickness", of["thickness"])
        else:
            for name, value in of.items():
                (not_negative if name == "foundation" else positive_number)(name, value)

    @property
    def value(self) -> float:
        """The present value of the constant."""
        return self.constants[self.parameter]

    @classmethod
    def solid(cls, mesh: Mesh, material: Material, parameter: str, amount: float = 0.0, *, cells: Any = None, part: str = "",
              rayleigh: tuple[float, float] | None = None) -> Self:
        """The change of a solid: `parameter` is 'E', 'nu', 'rho' or 'loss'.

        Parameters
        ----------
        mesh, material
            As given to `solid`; the material of the cells.
        parameter, amount
            See the class.
        cells : str or sequence of int, optional
            A group of the mesh, or rows of its cells; default: all.
        part : str
            The part of a system.
        rayleigh : (alpha, beta), optional
            As given to `solid`: D changes with K and M.
        """
        members, where = _cells(mesh, cells)
        now = {name: getattr(instance("material", material, Material), name) for name in ("E", "nu", "rho", "loss")}
        nodes, places = np.unique(mesh.cells[members], return_inverse=True)
        piece = Mesh(mesh.points[nodes], places.reshape(-1, mesh.cells.shape[1]), mesh.kind)
        every = np.arange(len(members))
        (K0, M), (K1, _) = (stiffness_and_mass(piece, [(SimpleNamespace(lame=moduli, rho=1.0), every)])  # type: ignore[list-item]
                            for moduli in ((1.0, 0.0), (0.0, 1.0)))  # λ and μ by themselves
        own = np.arange(3 * len(nodes))
        dofs = DofMap(mesh.numbers[nodes][own // 3], own % 3, TRANSLATIONS)
        return cls("solid", parameter, amount, now, (K0, K1, M), dofs, part, where, rayleigh)

    @classmethod
    def plate(cls, mesh: Mesh, parameter: str, amount: float = 0.0, *, E: float, nu: float, rho: float, thickness: float,
              cells: Any = None, part: str = "", rayleigh: tuple[float, float] | None = None) -> Self:
        """The change of a plate: `parameter` is 'E', 'nu', 'rho' or 'thickness'. For other arguments see `plate` and `solid`."""
        members, where = _cells(mesh, cells)
        now = {"E": E, "nu": nu, "rho": rho, "thickness": thickness}
        layout = Layout(mesh)
        (K0, M), (K1, _) = (layout.matrices(nu, members) for nu in (0.0, 1.0))  # K is affine in ν
        return cls("plate", parameter, amount, now, (K0, K1 - K0, M), layout.dofs(), part, where, rayleigh)

    @classmethod
    def beam(cls, length: float, elements: int | Sequence[float], parameter: str, amount: float = 0.0, *, E: float, I: float,  # noqa: E741
             rho: float, A: float, foundation: float = 0.0, cells: Any = None, part: str = "",
             rayleigh: tuple[float, float] | None = None) -> Self:
        """The change of a beam: `parameter` is 'E', 'I', 'rho', 'A' or 'foundation'. For other arguments see `beam` and `solid`.

        `cells` are elements, counted from 0 at the left.
        """
        x, h = element_lengths(length, elements)
        members = np.arange(len(h)) if cells is None else _rows(cells, len(h))
        now = {"E": E, "I": I, "rho": rho, "A": A, "foundation": foundation}
        rows = 2 * members[:, None] + np.arange(4)
        K, M = gathered(rows, 2 * len(x), lambda part: hermite_matrices(h[members[part]]))
        dofs = DofMap(np.repeat(np.arange(1, len(x) + 1), 2), np.tile([0, 1], len(x)), LABELS)
        return cls("beam", parameter, amount, now, (K, M, M), dofs, part, "" if cells is None else "cells", rayleigh)

    def terms(self, model: Any) -> list[ChangeTerm]:
        """The terms of K and M, and the resulting terms of D and H."""
        known = full_dofs(model, self.part)
        if known is None:
            raise InputError(f"{self.name}: the model has no DOF map, so its DOF are not known to be those of the mesh")
        rows = known.rows_of(self.dofs)
        moved = np.flatnonzero(rows >= 0)  # other DOF are held
        if not len(moved):
            raise InputError(f"{self.name}: the part has none of the DOF of these cells. Give the mesh that it was built of")
        alpha, beta = self.rayleigh or (0.0, 0.0)
        found: list[tuple[str, Matrix, Callable[[Values], Any]]] = []
        for (key, factor), A in zip(FACTORS[self.kind], self.matrices, strict=True):
            found.append((key, A, factor))
            if ratio := alpha if key == "M" else beta:
                found.append(("D", A, partial(_scaled, ratio, factor)))
            if key == "K" and (self.constants.get("loss") or self.parameter == "loss"):
                found.append(("H", A, partial(_scaled, "loss", factor)))
        U = displacements(model, rows[moved], self.part)
        terms = []
        for key, A, factor in found:
            jet, now = factor({**self.constants, self.parameter: Jet.of(self.value, 0, 1)}), factor(self.constants)
            if isinstance(jet, Jet) and (jet.first.any() or jet.second.any()):  # the factor depends on the parameter
                terms.append(ChangeTerm(key, U, A[moved][:, moved] if len(moved) < A.shape[0] else A,
                                        lambda a, factor=factor, now=now: factor(  # type: ignore[misc]
                                            {**self.constants, self.parameter: self.value + a}) - now))
        return terms


def _cells(mesh: Any, cells: Any) -> tuple[Array, str]:
    """Rows of the cells of a group, or as listed, and the group's name."""
    instance("mesh", mesh, Mesh)
    if isinstance(cells, str):
        return mesh.groups[choice(f"group of cells of the mesh {mesh.name!r}:", cells, mesh.groups)], cells
    if cells is None:
        return np.arange(len(mesh.cells)), ""
    return _rows(cells, len(mesh.cells)), "cells"


def _rows(cells: Any, count: int) -> Array:
    found = np.unique(whole_numbers("cells", cells)).astype(int)
    if not len(found) or found[0] < 0 or found[-1] >= count:
        raise InputError(f"cells must be rows from 0 to {count - 1}, one or more")
    return found
