"""A component under study: the keys that such scenes share, and what their outputs share, made when first asked for."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from femsub import Mesh, NormalModes, ReducedSubstructure, Substructure, displacements, normal_modes, reduce
from femsub.app.keys import key
from femsub.app.scene import Progress, Run, Scene
from femsub.checks import Array
from femsub.components import node_rows
from femsub.errors import InputError, PortWarning
from femsub.model import MOTIONS
from femsub.reduction import METHODS, Method

RIGID = len(MOTIONS)  # rigid motions that a part has at most
BESIDE = 0.02  # relative distance of the end of the band's default from the modes below and above it
SI_DEFAULTS = ("E", "rho")  # of a scene that makes its component; other units need other numbers


@dataclass(frozen=True)
class ComponentScene(Scene):
    """What the scenes of a component share."""

    modes: list[int] = key([10, 20], "numbers of modes to compare, for each method", least=0)
    ports: bool = key(True, "whether the static response to the contact joins each basis")
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]",
                            otherwise=f"from 0 to {100 * BESIDE:g} % above the last of so many modes as elastic says, or above "
                            "the cluster that it belongs to", example=[0.0, 1e4])
    elastic: int = key(8, "elastic modes that are listed beside up to six rigid ones; the default of band holds them, and the "
                       "output joined-interface compares as many frequencies", least=1, most=1000)
    tolerance: float = key(1e-3, "relative error of the growth rates, or of the receptance, that the recommended model may have",
                           above=0)
    frequencies: int = key(400, "frequencies of the band at which receptances are compared", least=2, most=100_000)
    loss: float = key(0.0, "loss factor of the structural damping of the output frequency-response", least=0)
    sliding: bool = key(False, "whether the belt's friction acts in the output frequency-response: about the sliding state, not "
                        "at rest")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("modes", "critical-slope", "eigenvalues", "error-time", "joined-interface")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("frequency-response",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.modes:
            raise InputError("modes is empty: name the numbers of modes to compare, e.g. [10, 20]")
        for name in SI_DEFAULTS:
            if self.units == "mm-t-s" and getattr(self, name, None) == getattr(type(self), name, np.nan):
                raise InputError(f"scene key {name!r} has its default {getattr(self, name):g}, which is in SI units, but units "
                                 "is 'mm-t-s': give all lengths in mm, E in MPa and rho in t/mm³ (steel: 2.1e5 and 7.85e-9)")

    def component(self) -> tuple[Substructure, Mesh | None]:
        """The component with the port "belt", and the mesh to show its shapes on."""
        raise NotImplementedError


class Work(Run):
    """A component under study."""

    scene: ComponentScene

    def __init__(self, scene: ComponentScene, progress: Progress) -> None:
        super().__init__(scene, progress)
        self.say("building the component")
        start = time.perf_counter()
        self.sub, self.mesh = scene.component()
        self.assembly = time.perf_counter() - start
        self.belt = scene.linear_belt
        self.units = scene.system
        self.slopes: list[float] | None = None  # critical ones, once an output has found them
        self.methods = [METHODS[name](modes) for name in scene.methods for modes in scene.modes]
        for count in scene.modes:
            if count > self.sub.size:
                raise InputError(f"modes: {count} are more than the {self.sub.size} DOF of {self.sub.name!r}")

    @cached_property
    def normal(self) -> NormalModes:
        self.say("normal modes")
        return normal_modes(self.sub, count=max(1, min(RIGID + self.scene.elastic, self.sub.size - RIGID)))

    @cached_property
    def band(self) -> tuple[tuple[float, float], str]:
        """The band and the rule it comes from."""
        if self.scene.band:
            return (self.scene.band[0], self.scene.band[1]), "as given"
        omega = self.normal.frequencies[self.normal.rigid:]
        last = min(self.scene.elastic, len(omega)) - 1
        while last + 1 < len(omega) and omega[last + 1] < (1 + 2 * BESIDE) * omega[last]:
            last += 1
        return (0.0, float((1 + BESIDE) * omega[last])), f"to {100 * BESIDE:g} % above elastic mode {last + 1}"

    @cached_property
    def reduced(self) -> list[tuple[Method, ReducedSubstructure]]:
        return [(method, self.reduce(method)) for method in self.methods]

    @property
    def models(self) -> list[tuple[str, int, Substructure]]:
        """'full' or the method's key, the modes kept (0 of the full model), and the model."""
        return [("full", 0, self.sub), *((method.key, rom.modes, rom) for method, rom in self.reduced)]

    def reduce(self, method: Method) -> ReducedSubstructure:
        """The component by one method, as the scene has it."""
        self.say(str(method))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PortWarning)  # the figure is in the tables
            return reduce(self.sub, method, ports=self.scene.ports)

    def field(self, u: Array) -> Array | None:
        """Displacements of the nodes (nodes, 3, k), the largest of each shape 1; None where there is no mesh to show them on."""
        if self.mesh is None or self.sub.dofs is None:
            return None
        found = displacements(self.mesh, self.sub.dofs, u)
        largest = np.linalg.norm(found, axis=1).max(axis=0)
        return found / np.where(largest > 0, largest, 1.0)

    @property
    def marks(self) -> dict[str, Array]:
        """Nodes of the contact and of the interface, as rows of the mesh."""
        assert self.mesh is not None and self.sub.dofs is not None
        rows = {"contact": np.flatnonzero(self.sub.port("belt")), "interface": self.sub.interface}
        nodes = {key: np.unique(self.sub.dofs.nodes[at]) for key, at in rows.items()}
        known = self.mesh.numbers
        return {key: node_rows(self.mesh, at[np.isin(at, known)]) for key, at in nodes.items() if len(at)}
