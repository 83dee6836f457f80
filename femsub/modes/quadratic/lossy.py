"""Complex modes under structural damping: P(λ) = λ²M + λD + K + i s H with s the sign of Im λ.

P is conjugated where λ is, so its eigenvalues come in pairs. Those with Im λ > 0 are eigenvalues of λ²M + λD + K + iH, all of
which LAPACK finds on the state matrix of `dense`, complex here. Its eigenvalues with Im λ < 0 belong to no motion. Real λ are
those of λ²M + λD + K, since motion without oscillation has no sign. H lifts one of two such λ off the axis. It is left out: of
the upper λ as many count as λ²M + λD + K has, those with the largest Im λ / |λ|.
"""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.checks import Array, Matrix, Tally
from femsub.errors import InputError
from femsub.model import Pencil
from femsub.modes.quadratic import dense
from femsub.modes.quadratic.search import Found

MOST = 2000  # DOF up to which LAPACK's time is accepted


class LossyPencil(Pencil):
    """A dense pencil with K + i s H in place of K."""

    H: Array

    @classmethod
    def of(cls, pencil: Pencil, H: Matrix, name: str) -> Self:
        """An InputError for a model that is too large."""
        if pencil.size > MOST:
            raise InputError(f"complex modes with structural damping are for models of up to {MOST} DOF, but {name!r} has "
                             f"{pencil.size}. Reduce it first, or take fs.equivalent_viscous(model, omega)")
        plain = pencil.dense()
        found = cls(plain.M, plain.D, plain.K)._with(rigid_motion=plain.rigid_motion, noise=plain.noise)
        found._set(H=H.toarray() if sp.issparse(H) else H)
        return found

    @cached_property
    def norms(self) -> tuple[float, float, float]:
        mass, damping, stiffness = super().norms
        return mass, damping, stiffness + float(np.linalg.norm(self.H))

    def at(self, value: complex) -> Matrix:
        return super().at(value) + 1j * np.sign(np.imag(value)) * self.H

    def restoring(self, eigenvalues: Array, shapes: Array) -> Array:
        return self.K @ shapes + 1j * np.sign(np.imag(eigenvalues)) * (self.H @ shapes)

    def magnitude(self, eigenvalues: Array, shapes: Array) -> Array:
        return super().magnitude(eigenvalues, shapes) + np.abs(self.H) @ np.abs(shapes)

    def all_modes(self) -> Found:
        """All eigenpairs, each followed by its conjugate.

        Raises
        ------
        InputError
            M is singular.
        """
        form = dense.modal_form(self)
        if form is None:
            raise InputError("M is singular or nearly so (massless DOF), and complex modes with structural damping need a "
                             "regular M. Condense such DOF, or take fs.equivalent_viscous(model, omega)")
        state, begin = form.state().astype(complex), len(form.omega) - form.rigid
        state[begin:, :begin] -= 1j * (form.shapes.T @ self.H @ form.shapes[:, form.rigid:]) / form.omega[form.rigid:]
        values, left, right = la.eig(state, left=True, right=True, check_finite=False)
        real, X_real, Y_real = dense.solve(Pencil(self.M, self.D, self.K).carrying(self.rigid_motion, self.noise))
        still = np.flatnonzero(real.imag == 0)
        size = np.abs(values)
        flat = np.divide(-values.imag, size, out=np.zeros_like(size), where=size > 0)
        up = np.argsort(flat, kind="stable")[:(len(real) - len(still)) // 2]
        up = up[flat[up] < 0]
        pairs = [np.stack([part, part.conj()], axis=-1).reshape(*part.shape[:-1], -1)
                 for part in (values[up], *(_unit(form.shapes @ part[begin:, up]) for part in (right, left)))]
        found, X, Y = (np.concatenate([pair, part[..., still]], axis=-1)
                       for pair, part in zip(pairs, (real, X_real, Y_real), strict=True))
        return Found(found, X, Y, found, Tally(len(found), len(real)))


def _unit(shapes: Array) -> Array:
    return np.asarray(shapes / np.linalg.norm(shapes, axis=0))
