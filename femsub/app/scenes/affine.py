"""Your own pencil with parameters: matrices from files with factors, over one parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from femsub import Affine
from femsub.algebra import as_matrix
from femsub.app.expressions import Expression, Factor
from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.flutter import Flutter, FlutterScene
from femsub.checks import Matrix
from femsub.components import disc_pair
from femsub.errors import InputError, unknown_name
from femsub.io import read_aligned

BETWEEN = [0.005, 0.2]  # of the example
#: the example's factors, by its matrices
EXAMPLE = {"M": {"M": "1"}, "D": {"D1": "1", "DR": "mu / speed", "DG": "speed"},
           "K": {"K1": "1", "KR": "mu", "Kgeo": "speed**2"}}


@dataclass(frozen=True)
class TermKeys:
    """One matrix of a sum, and its factor."""

    file: str = key("", "the file of the matrix, relative to the scene file: Matrix Market, SciPy, MATLAB, Nastran OP4, Abaqus, "
                    "CalculiX; 'model.mat:DR' names a matrix in it", required=True, example="K1.mtx", file=True)
    factor: str | float = key("1", "what the matrix is multiplied by: a number, or arithmetic of parameters with + - * / **, "
                              "sqrt, exp, log, sin, cos and pi")


@dataclass(frozen=True)
class FixedKeys:
    """The value of a parameter that does not change."""

    name: str = key("", "the parameter's name", required=True, example="mu")
    value: float = key(0.0, "its value")


FRICTION = FixedKeys("mu", 0.4)  # of the example


@dataclass(frozen=True)
class AffineScene(FlutterScene):
    """A pencil λ² Σ θ M + λ Σ θ D + Σ θ K of your own matrices, each with a factor θ of named parameters, over one of them.

    Any of the matrices may be unsymmetric. So a brake comes from another program as D1 + mu/speed DR + speed DG and K1 + mu KR +
    speed² Kgeo. Without files the matrices are those of a small example: a pair of waves of a disc that turns under a pad, with
    the parameters mu = 0.4 and speed.
    """

    M: list[TermKeys] = key([], "the masses, added up", otherwise="those of the example", required_with="K",
                            example=[TermKeys("M.mtx")])
    D: list[TermKeys] = key([], "the dampings and gyroscopic terms, added up", otherwise="those of the example, or none",
                            example=[TermKeys("D1.mtx"), TermKeys("DR.mtx", "mu / speed"), TermKeys("DG.mtx", "speed")])
    K: list[TermKeys] = key([], "the stiffnesses and circulatory terms, added up", otherwise="those of the example",
                            required_with="M", example=[TermKeys("K1.mtx"), TermKeys("KR.mtx", "mu"),
                                                        TermKeys("Kgeo.mtx", "speed**2")])
    parameter: str = key("", "the parameter that changes", otherwise="the one that fixed has no value for", example="speed")
    fixed: list[FixedKeys] = key([], "values of the other parameters", example=[FRICTION],
                                 otherwise=f"none; {FRICTION.name} = {FRICTION.value:g} in the example")
    between: list[float] = key([], "the range of the parameter", form="[lo, hi]", required_with="M", example=BETWEEN,
                               otherwise="that of the example")
    band: list[float] = key([], "the frequencies that are looked at", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="all; required above 300 DOF", example=[0.0, 1000.0])
    massless: bool = key(False, "whether M may leave out DOF of K")

    def __post_init__(self) -> None:
        if not self.M and not self.K:
            if self.D:
                raise InputError("scene key 'M' is missing: D alone is no model, give the files of M and K as well")
            self.fill(between=BETWEEN)
        super().__post_init__()
        if twice := [one.name for one in self.fixed if [other.name for other in self.fixed].count(one.name) > 1]:
            raise InputError(f"scene key 'fixed': {twice[0]!r} has {len(twice)} values. Give each parameter one")
        if not self.names:
            raise InputError("the scene needs a parameter, but no factor has a name in it. Give a factor such as 'mu'")
        for one in self.fixed:
            if one.name not in self.names:
                raise unknown_name("parameter in the scene key 'fixed'", one.name, self.names)
        if self.parameter and self.parameter not in self.names:
            raise unknown_name("parameter in the scene key 'parameter'", self.parameter, self.names)
        if self.parameter in self.values:
            raise InputError(f"scene key 'parameter': {self.parameter!r} changes, but fixed has a value for it. Remove it there")
        for name, where in self.names.items():
            if name not in self.values and name != self.over:
                raise unknown_name(f"parameter in the scene key {where!r} (it is neither 'parameter' nor in 'fixed')", name,
                                   [self.over, *self.values])
        factors = [factor for terms in self.terms.values() for factor in terms.values()]
        for factor in factors:
            factor.check_over(self.over, (self.between[0], self.between[1]), self.values)
        lines = [factor.lines(self.over, self.values) for factor in factors]
        if all(line and not line[1] for line in lines):
            raise InputError(f"scene key {self.names[self.over]!r}: no factor changes with {self.over!r}, which cancels. Change "
                             "the expression, or name another parameter")

    @cached_property
    def terms(self) -> dict[str, dict[str, Expression]]:
        """The factors of M, D and K by the scene keys of their matrices, or by the names of the example's."""
        if not self.M:
            return {sum_: {name: Expression(text, name) for name, text in terms.items()} for sum_, terms in EXAMPLE.items()}
        return {sum_: {f"{sum_}[{i}]": Expression(str(term.factor), f"{sum_}[{i}].factor")
                       for i, term in enumerate(getattr(self, sum_), 1)} for sum_ in "MDK"}

    @cached_property
    def names(self) -> dict[str, str]:
        """All parameters, in the order in which they come, and the scene key where each comes first."""
        found: dict[str, str] = {}
        for terms in self.terms.values():
            for one in terms.values():
                for name in one.names:
                    found.setdefault(name, one.where)
        return found

    @cached_property
    def values(self) -> dict[str, float]:
        """Those of the parameters that do not change."""
        given = {one.name: one.value for one in self.fixed}
        return given if self.M or self.parameter == FRICTION.name else {FRICTION.name: FRICTION.value, **given}

    @cached_property
    def over(self) -> str:
        """The parameter that changes."""
        free = [name for name in self.names if name not in self.values]
        if not self.parameter and len(free) != 1:
            listed = ", ".join(f"{name} ({self.names[name]})" for name in free)
            raise InputError("scene key 'parameter' must name the parameter that changes: "
                             + (f"fixed has no value for {listed}" if free else "fixed has values for all"))
        return self.parameter or free[0]

    def run(self, progress: Progress) -> Result:
        progress(f"{self.name}: reading the matrices")
        model = self.model()
        sums = {sum_: " + ".join(name if one.text == "1" else f"({one.text}) {name}" for name, one in terms.items())
                for sum_, terms in self.terms.items() if terms}
        data = {"parameter": self.over, "fixed": self.values, "sums": sums, "dof": model.size, "band": self.band or None}
        at = "".join(f", {name} = {value:g}" for name, value in self.values.items())
        text = [f"{model.size} DOF{at}", *(f"{sum_} = {said}" for sum_, said in sums.items())]
        band = (self.band[0], self.band[1]) if self.band else None
        return Flutter(self, progress, {self.name: model}, self.over, {}, self.over, band).study(data, text)

    def model(self) -> Affine:
        """The pencil over the parameter that changes."""
        matrices, sums = self.matrices(), []
        for terms in self.terms.values():
            added: list[tuple[Any, Matrix]] = []
            for name, one in terms.items():
                A, line = matrices[name], one.lines(self.over, self.values)
                if line is None:
                    added.append((Factor(one, self.over, tuple(self.values.items())), A))
                else:  # a straight line in the parameter stands as such, so that it can be certified
                    parts = ((1.0, line[0]), (self.over, line[1]))
                    added += [(theta, factor * A) for theta, factor in parts if factor] or [(0.0, A)]
            sums.append(added or None)
        return Affine(*sums)

    def matrices(self) -> Mapping[str, Matrix]:
        """By the names of `terms`, checked, all of one size."""
        if not self.M:
            return disc_pair()
        paths = {f"{sum_}[{i}]": Path(self.folder) / term.file for sum_ in "MDK" for i, term in enumerate(getattr(self, sum_), 1)}
        found, _ = read_aligned(paths, {name: name[0] for name in paths}, "K[1]", [name for name in paths if name[0] == "M"],
                                self.massless or len(self.M) > 1)
        checked = {name: as_matrix(f"{name}.file ({paths[name]})", A) for name, A in found.items()}
        size = checked["K[1]"].shape[0]
        for name, A in checked.items():
            if A.shape[0] != size:
                raise InputError(f"{name}.file: {paths[name]} is {A.shape[0]} x {A.shape[0]}, but K[1].file, {paths['K[1]']}, is "
                                 f"{size} x {size}. All matrices must have one size")
        return checked
