"""Your own matrices with factors of named parameters: λ² Σ θ M + λ Σ θ D + Σ θ K."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import femsub as fs
from femsub.app.kinds import key
from femsub.app.parts import Made, Part, PartSite
from femsub.app.parts.matrices import found
from femsub.checks import InputError, Matrix
from femsub.model import Expression, affine_of, check_range


@dataclass(frozen=True)
class Summand:
    """One matrix of a sum, and its factor."""

    matrix: str | list[list[float]] = key("", "the file of the matrix ('model.mat:DR' for DR in a file of several), or its rows",
                                          required=True, example="K1.mtx", file=True)
    factor: str | float = key(1.0, "its factor: a number, or an expression of parameters with + - * / **, sqrt, exp, log, sin, "
                              "cos and pi", example="mu / speed")


@dataclass(frozen=True)
class Sums:
    """The sums for M, D and K. Any of the matrices may be unsymmetric."""

    M: list[Summand] = key([], "mass matrices", required=True)
    D: list[Summand] = key([], "damping and gyroscopic matrices", otherwise="none")
    K: list[Summand] = key([], "stiffness and circulatory matrices", required=True)
    massless: bool = key(False, "whether M may leave out DOF of K")


@dataclass(frozen=True)
class AffinePart(Part):
    """A pencil of your own matrices with factors of parameters, such as D1 + mu/speed DR + speed DG and K1 + mu KR + speed² Kgeo.

    It cannot be joined to other parts, and a box alone reduces it. [parameter.NAME] gives ranges and values of its parameters.
    """

    affine: Sums = key(None, "the matrices", required=True, example={"M": [{"matrix": "M.mtx"}], "K": [
        {"matrix": "K.mtx"}, {"matrix": "KR.mtx", "factor": "mu"}]})

    KIND: ClassVar[str] = "affine"
    WITHOUT: ClassVar[dict[str, str]] = dict.fromkeys(("interface", "ports", "loss"), "a pencil has no places, and cannot be "
                                                      "joined")

    @cached_property
    def factors(self) -> dict[str, list[Expression]]:
        """The factors of the matrices in the sums M, D and K."""
        sums = {name: enumerate(getattr(self.affine, name), 1) for name in "MDK"}
        return {name: [Expression(str(one.factor), f"{name}[{i}]") for i, one in terms] for name, terms in sums.items()}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All parameters, in order of appearance."""
        return tuple(dict.fromkeys(name for terms in self.factors.values() for one in terms for name in one.names))

    def __post_init__(self) -> None:
        _ = self.names  # a factor that is no expression is refused here

    def check_over(self, free: str, between: tuple[float, float], values: Mapping[str, float]) -> None:
        """Refuses a range of the parameter `free` in which a factor is undefined, and other parameters without values."""
        for name in self.names:
            if name != free and name not in values:
                raise InputError(f"the parameter {name!r} has no value: give [parameter.{name}] with value")
        check_range([one for terms in self.factors.values() for one in terms], free, between, values)

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        return Made({site.name: self.family(site, self.names, {})})

    def family(self, site: PartSite, free: tuple[str, ...], values: Mapping[str, float]) -> fs.Affine:
        """The pencil as a function of the free parameters; `values` gives the others."""
        matrices = iter(self.matrices(site).values())
        sums = {name: [(one, next(matrices)) for one in terms] for name, terms in self.factors.items()}
        return affine_of(sums, free, values)

    def matrices(self, site: PartSite) -> Mapping[str, Matrix]:
        """The checked matrices, all of one size, by their places such as 'K[1]'."""
        given = {f"{sum_}[{i}]": term.matrix for sum_ in "MDK" for i, term in enumerate(getattr(self.affine, sum_), 1)}
        paths = {name: found(site, one) for name, one in given.items() if isinstance(one, str)}
        matrices: dict[str, Any] = {name: one for name, one in given.items() if not isinstance(one, str)}
        if paths:
            base = next((name for name in paths if name[0] == "K"), next(iter(paths)))
            masses = [name for name in paths if name[0] == "M"]
            matrices |= fs.io.read_aligned(paths, {name: name[0] for name in paths}, base, masses,
                                           self.affine.massless or len(self.affine.M) > 1)[0]
        checked = {name: fs.algebra.as_matrix(name, matrices[name]) for name in given}
        size = checked["K[1]"].shape[0]
        for name, A in checked.items():
            if A.shape[0] != size:
                raise InputError(f"{name} is {A.shape[0]} x {A.shape[0]}, but K[1] is {size} x {size}. All must have one size")
        return checked
