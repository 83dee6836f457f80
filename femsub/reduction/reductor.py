"""A reductor keeps the basis with the most modes, and gives any smaller model of it: the factor and the modes are made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from femsub.algebra import WORK, one_thread
from femsub.checks import Array, whole_number
from femsub.errors import InputError
from femsub.modes import count_deferred
from femsub.reduction.basis import Kept
from femsub.reduction.component import checked, finished, reduced, work

if TYPE_CHECKING:
    from femsub.model import ReducedSubstructure, Substructure
    from femsub.modes import NormalModes, ShiftInvert
    from femsub.reduction.method import Method

ANSWERS = 4  # blocks of static responses that are kept


class Reductor:
    """The models of one component by one method with m modes, for all m up to that of the method: ``Reductor(...).first(m)``.

    They are those of ``reduce(sub, replace(method, modes=m))`` to the accuracy of the modes. The factor, the constraint modes,
    the modes and their count, and the static responses are made once, for the largest model. What is left for each are the
    products with its own basis. Methods whose factor depends on the number of modes (`Guyan`) are run anew.

    Parameters
    ----------
    sub : Substructure
    method : Method
        With the largest number of modes.
    ports : bool or sequence of str
        As of `reduce`.

    Examples
    --------
    >>> import femsub as fs
    >>> from femsub.reduction import Reductor
    >>> basis = Reductor(fs.chain(10, belt=1), fs.CraigBampton(modes=6))
    >>> [basis.first(modes).size for modes in (2, 4, 6)]
    [3, 5, 7]
    """

    def __init__(self, sub: Substructure, method: Method, ports: bool | Sequence[str] = False) -> None:
        self.task, self._ports, self._known = checked(sub, method, ports, None), ports, False
        if method.modes is None:
            raise InputError(f"a reductor takes a method with a number of modes, e.g. {type(method).__name__}(modes=20)")
        if not method.nested or (method.held and not len(sub.interior)):
            return
        with one_thread(work(self.task) < WORK):
            self.part = part = method.part(sub)
            self.turned = self.task.turned(part)
            statics = method.statics(part, part.factored(), self.turned.extra)
            self.kept = method.kept(statics, None)
            count_deferred(statics.handle, self.kept.found)
        handle: Any = statics.handle
        if len(self.kept.found.shapes) == handle.K.shape[0]:  # the modes are those of the factor's matrix
            handle = Answers(handle, self.kept.found)
        # the memory of C would be that of the first V
        self.statics, self._known = replace(statics, handle=handle, constraint=statics.constraint.copy(order="F")), True

    def first(self, modes: int) -> ReducedSubstructure:
        """The model with the lowest modes, so many of them."""
        most = self.task.method.modes or 0
        method = replace(self.task.method, modes=whole_number("modes", modes, least=0, most=most))
        if not self._known:
            return reduced(self.task.sub, method, self._ports)
        found, rigid = self.kept.found, self.kept.rigid
        kept = self.kept if modes == most else Kept(found, modes, float(found.frequencies[rigid + modes]))
        with one_thread(work(self.task) < WORK):
            responses = method.responses(self.statics, kept, self.turned.ports)
            basis = method.basis(self.statics, kept, responses, self.turned.ports)
            return finished(replace(self.task, method=method), self.part, basis)


class Answers:
    """A factor whose static responses are kept: with fewer modes Φ, the share of the others, Φ Λ⁻¹ Φᵀ B, is put back."""

    def __init__(self, handle: ShiftInvert, found: NormalModes) -> None:
        self._handle, self._modes = handle, found
        self._kept: list[tuple[Array, Array]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)

    def elastic_solve(self, B: Array, kept: Array | None = None) -> Array:
        """As `ShiftInvert.elastic_solve`; `kept` are the first of the modes, or none but the rigid ones."""
        shapes = self._modes.shapes
        rest = next((x for b, x in self._kept if np.array_equal(b, B)), None)
        if rest is None:
            rest = self._handle.elastic_solve(B, shapes)
            self._kept = [*self._kept[1 - ANSWERS:], (B, rest)]
        others = slice(self._modes.rigid if kept is None else kept.shape[1], None)
        share = (shapes[:, others].T @ B) / self._modes.eigenvalues[others, None]
        return cast(Array, rest + shapes[:, others] @ share)
