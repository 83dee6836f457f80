"""A chain of masses and springs, as in the paper."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.kinds import key
from femsub.app.parts import Made, Part, PartSite
from femsub.checks import Array, InputError


@dataclass(frozen=True)
class ChainPart(Part):
    """A chain of masses between springs, held at its left end, with a dashpot at mass 1 and a port "belt".

    Masses are numbered from 1. A joint or contact names a mass as 'part.m3'.
    """

    chain: int = key(10, "number of masses", least=1, most=10**7)
    masses: float | list[float] = key(1.0, "the masses: one value, or one for each", unit="mass", above=0)
    springs: float | list[float] = key(1.0, "the springs: one value, or one for each; the first holds mass 1",
                                       unit="force/length", least=0)
    damping: float = key(0.1, "the dashpot at mass 1", unit="force·time/length", least=0)
    belt: int = key(2, "the mass of the port 'belt'", least=1)
    interface: list[int | float | str] = key([1], "masses through which it is joined; 'belt' is the mass under the belt", least=1,
                                             distinct=True)
    ports: dict[str, Any] = field(default_factory=dict)
    fixed: bool = key(True, "whether the first spring is held at its left end")
    cut: int = key(0, "number of pieces, each of which is a part; of a mass at a cut, each piece has half", least=0)

    KIND: ClassVar[str] = "chain"
    WITHOUT: ClassVar[dict[str, str]] = {"ports": "the port of a chain is 'belt'"}

    @property
    def port_names(self) -> list[str]:
        return ["belt"]

    def mesh(self, site: PartSite) -> fs.Mesh | None:
        return None if self.cut or self.chain < 2 else fs.components.line(np.arange(self.chain) + 1.0, site.name)

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        if self.cut:
            if self.cut >= self.chain:
                raise InputError(f"{self.chain} masses can be cut into {self.chain - 1} pieces at most, not {self.cut}")
            parts, joints, _ = fs.coupling.cut_chain(self.chain, self.cut, self.belt, self.damping, masses=self.masses,
                                                     springs=self.springs)
            return Made(dict(parts), joints)
        masses = list(dict.fromkeys(self.belt if one == "belt" else one for one in self.prefer(site)))
        if strange := [one for one in masses if not isinstance(one, int)]:
            raise InputError(f"interface has {strange[0]!r}, but masses are numbers from 1 to {self.chain}, or 'belt'")
        sub = fs.chain(self.chain, self.belt, self.damping, masses=self.masses, springs=self.springs, interface=masses,
                       fixed=self.fixed, name=site.name)
        if site.interface:  # a joint names a mass by a set of its own
            sub = fs.Substructure(sub.M, sub.K, sub.D, {f"m{one}": [one - 1] for one in masses}, sub.ports, site.name, sub.dofs)
        return self.one(site, sub, mesh)

    def end(self, words: str, sets: Iterable[str] | None) -> Any:
        if not (words[:1] == "m" and words[1:].isdecimal() and 1 <= int(words[1:]) <= self.chain):
            raise InputError(f"{words!r} is no mass: name one from m1 to m{self.chain}")
        return int(words[1:])

    def set_of(self, words: str) -> Any:
        return words

    def moved(self, mesh: fs.Mesh, sub: fs.Substructure, u: Array) -> Array | None:
        return np.asarray(u[:, None] * np.array([1.0, 0.0, 0.0])[:, None])  # the chain lies along x, and its masses move along x
