"""A reductor computes the largest model once. The span of a smaller model lies in its span: only small matrices are needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import WORK, kept_free, one_thread
from femsub.checks import Array, InputError, whole_number
from femsub.modes import lightest
from femsub.reduction.basis import assembled, in_blocks, labelled, port_errors, projected
from femsub.reduction.estimates.nested import Nested
from femsub.reduction.method import Method, checked, finished, reduced

if TYPE_CHECKING:
    from femsub.model import ReducedSubstructure, Substructure


class Reductor:
    """The models of one component by one method with m modes, for all m up to that of the method: ``Reductor(...).first(m)``.

    They equal ``reduce(sub, replace(method, modes=m))`` to the accuracy of the modes. With U = [C Φ Ξ] of the largest model, a
    model with fewer modes has V = U T and the static responses

        Ξ_m = Φ_l Λ_l⁻¹ Φ_lᵀF + Ξ (ΞᵀKΞ)⁻¹ ΞᵀF,   Φ_l the modes left out, without dependent columns.

    So each model takes one product with U; all other matrices have the size of the largest model. A method whose factor depends
    on the number of modes (`Guyan`) is run again for each model.

    Parameters
    ----------
    sub : Substructure
    method : Method
        With the largest number of modes.
    ports : bool or sequence of str
        As in `reduce`.

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
        with one_thread(self.task.work < WORK), kept_free(self.task.beside):
            self.part = part = method.part(sub)
            task = self.task if part.turn is None else self.task.turned(part)
            self.statics = statics = method.statics(part, part.factored(), task.extra)
            self.kept = kept = method.kept(statics, None)
            basis = assembled(statics, kept, task.ports, method.mode_kind)
            self.U, r = basis.V, len(basis.M)
            shapes = self.U if part.turn is None else part.turn @ self.U
            self.largest = replace(basis, V=np.eye(r), forces=None, D=projected(sub.D, shapes, shapes))
            self.ports = {name: self.U.T @ w for name, w in task.ports.items()}
            loads = self.U[part.rows].T @ basis.forces
            self.nested = Nested(basis.M, basis.K, None, statics.constraint.shape[1], kept.rigid, kept.values[kept.rigid:], loads,
                                 statics.condensed, lightest=lightest(statics.handle))
        self._known = True

    def first(self, modes: int) -> ReducedSubstructure:
        """The model with the `modes` lowest modes."""
        method = replace(self.task.method, modes=whole_number("modes", modes, least=0, most=self.task.method.modes or 0))
        if not self._known:
            return reduced(self.task.sub, method, self._ports)
        with one_thread(self.task.work < WORK):
            basis = self.largest
            if modes < self.kept.elastic:  # [C Φ Ξ] with fewer modes, in the coordinates of the largest one, V (R, r)
                largest, statics, found, own = self.largest, self.statics, self.kept.found, self.kept.forces
                kept = replace(self.kept, elastic=modes)
                first, k = statics.constraint.shape[1], len(kept.values)
                forces = np.arange(self.nested.loads.shape[1])
                if own is not None:  # one force for each mode, before the others
                    forces = np.delete(forces, slice(found.rigid + modes, own.shape[1]))
                shapes, stiffness, inertia = replace(self.nested, loads=self.nested.loads[:, forces]).static(k - kept.rigid)
                T = np.hstack([np.eye(len(largest.M), first + k), shapes])
                matrices = in_blocks(statics.condensed, kept.values, stiffness, inertia, T.T @ largest.M[:, :first])
                basis = labelled(statics, kept, T, matrices, len(forces) - shapes.shape[1], largest.interface @ T,
                                 self.task.method.mode_kind)
                left = np.hstack([T[:, :0], *self.ports.values()])[first + k:first + len(self.kept.values)]
                energies = largest.energies + np.outer([0, 1], (left**2 / self.kept.values[k:, None]).sum(axis=0))
                basis = replace(basis, port_error=port_errors(self.ports, basis, kept, energies), motion=largest.motion,
                                D=None if largest.D is None else T.T @ largest.D @ T)
            basis = method.coordinates(basis, self.statics)
            return finished(replace(self.task, method=method), self.part, replace(basis, V=times(self.U, basis.V)))


def times(U: Array, T: Array) -> Array:
    """UT, shape (n, k). If a column of T is a unit vector, the column of U is copied instead."""
    plain = (np.count_nonzero(T, axis=0) == 1) & (T == 1.0).any(axis=0)
    V = np.empty((len(U), T.shape[1]), order="F")
    V[:, plain] = U[:, T[:, plain].argmax(axis=0)]
    V[:, ~plain] = U @ T[:, ~plain]
    return V
