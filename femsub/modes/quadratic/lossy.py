"""Complex modes under structural damping: P(λ)x = 0 with P(λ) = λ²M + λD + K + i s H and s = 1, -1, 0 the sign of Im λ.

P(λ̄) is the conjugate of P(λ), so all solutions off the real axis come in pairs. The solutions above the axis are the eigenvalues
with Im λ > 0 of

    P₊(λ) = λ²M + λD + K + iH,

including eigenvalues that H has moved off the real axis. LAPACK finds the 2n eigenvalues of P₊ on the state matrix of `dense`,
which is complex here. Eigenvalues of P₊ with Im λ < 0 are no solutions. The solutions on the axis are the real eigenvalues of
P₀(λ) = λ²M + λD + K, since motion without oscillation has no sign. If H acts on such a motion, it moves its λ in P₊ to one side
of the axis. If this is the upper side, both are solutions: the real λ, and a pair beside it. So there may be more than 2n
solutions, or fewer. In a mode with viscous damping ζ > 1 the faster λ moves up, if H is positive semidefinite.
"""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, unit_length
from femsub.checks import Array, ConditionWarning, InputError, Matrix, Tally, warn
from femsub.model import Pencil
from femsub.modes.quadratic import dense
from femsub.modes.quadratic.bars import bars
from femsub.modes.quadratic.matching import match
from femsub.modes.quadratic.search import SearchResult


class LossyPencil(Pencil):
    """A dense pencil with K + i s H in place of K; `side`, if it is not 0, is s for all λ."""

    H: Array
    side: int

    @classmethod
    def of(cls, pencil: Pencil, H: Matrix, name: str) -> Self:
        """The dense pencil with H (n, n); an InputError if the model is too large."""
        if pencil.size > QUADRATIC:
            raise InputError(f"complex modes with structural damping are for models of up to {QUADRATIC} DOF, but {name!r} has "
                             f"{pencil.size}. Reduce it first, or take fs.equivalent_viscous(model, omega)")
        plain = pencil.dense()
        found = cls(plain.M, plain.D, plain.K)._with(rigid_motion=plain.rigid_motion, noise=plain.noise)
        found._set(H=H.toarray() if sp.issparse(H) else H, side=0)
        return found

    @cached_property
    def norms(self) -> tuple[float, float, float]:
        mass, damping, stiffness = super().norms
        return mass, damping, stiffness + float(np.linalg.norm(self.H))

    def sign(self, eigenvalues: Array | complex) -> Array:
        return np.sign(np.imag(eigenvalues)) if not self.side else np.full(np.shape(eigenvalues), float(self.side))

    def transposed(self) -> LossyPencil:
        found = type(self)(self.M.T, self.D.T, self.K.T)
        found._set(H=self.H.T, side=self.side)
        return found

    def at(self, value: complex) -> Matrix:
        return super().at(value) + 1j * self.sign(value) * self.H

    def restoring(self, eigenvalues: Array, shapes: Array) -> Array:
        return self.K @ shapes + 1j * self.sign(eigenvalues) * (self.H @ shapes)

    @property
    def sizes(self) -> tuple[Matrix, Matrix, Matrix]:
        """|M|, |D| and |K| + |H|."""
        M, D, K = super().sizes
        return M, D, K + abs(self.H)

    def all_modes(self) -> SearchResult:
        """All solutions, each pair side by side.

        An eigenvalue of P₊ whose |Im λ| is within its error bar lies on the real axis, if P₀ has an eigenvalue within both error
        bars.

        Raises
        ------
        InputError
            M is singular.

        Warns
        -----
        ConditionWarning
            Error bars do not decide on which side of the axis a λ lies, or whether it is real without H. The evidence is 'not
            checked' then.
        """
        plain, upper = Pencil(self.M, self.D, self.K).carrying(self.rigid_motion, self.noise), self._with(H=self.H, side=1)
        # the 2n eigenvalues of P₊
        form = dense.modal_form(self)
        if form is None:
            raise InputError("M is singular or nearly so (massless DOF), and complex modes with structural damping need a "
                             "regular M. Condense such DOF, or take fs.equivalent_viscous(model, omega)")
        form = form.resisted(self.H, self.M)
        n, r = len(form.omega), form.rigid
        state = form.state().astype(complex)
        state[n - r:, :n - r] -= 1j * (form.shapes.T @ self.H @ form.shapes[:, r:]) / form.omega[r:]
        values, left, right = la.eig(state, left=True, right=True, check_finite=False)
        values = np.append(values, np.zeros(r))
        X, Y = (unit_length(np.hstack([form.shapes @ part[n - r:], form.shapes[:, :r]])) for part in (right, left))
        real, X_real, Y_real = dense.solve(plain)
        bar, bar_real = bars(upper, values, X, Y).error_bar, bars(plain, real, X_real, Y_real).error_bar
        axis = np.flatnonzero(np.abs(values.imag) <= bar)
        at, to = match(values[axis], real)
        met = np.abs(values[axis[at]] - real[to]) <= bar[axis[at]] + bar_real[to]
        at, to = axis[at[met]], to[met]
        still = np.flatnonzero(real.imag == 0)
        nearly = np.setdiff1d(np.flatnonzero(np.abs(real.imag) <= bar_real), [*still, *to])
        up = np.setdiff1d(np.flatnonzero(values.imag > 0), at[real[to].imag == 0])
        doubt = len(axis) - len(at) + len(nearly)
        if doubt:
            one = np.append(values[np.setdiff1d(axis, at)], real[nearly])[0].real
            warn(f"{doubt} eigenvalues lie so near to the real axis that rounding decides whether structural damping makes them "
                 f"oscillate, one at {one:.4g}. Some may be missing, or listed though they are no eigenvalues", ConditionWarning)
        pairs = [np.stack([part, part.conj()], axis=-1).reshape(*part.shape[:-1], -1)
                 for part in (values[up], X[:, up], Y[:, up])]
        found, X_all, Y_all = (np.concatenate([pair, part[..., still]], axis=-1)
                               for pair, part in zip(pairs, (real, X_real, Y_real), strict=True))
        known = np.concatenate([values, values.conj(), real])
        return SearchResult(found, X_all, Y_all, known, Tally(len(found), None if doubt else len(found)))
