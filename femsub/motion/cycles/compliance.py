"""The dynamic compliance of a model at its belts' ports, for models of any size.

    h(s) = Wᵀ(s²M + sD + K)⁻¹W,   Y(s) = s h(s),   both (p, p)

Y is the mobility: v_k = Y(ikω) f_k is the speed under the belts that harmonic k of the friction causes. Harmonic balance uses
only Y of a model. A dense model is decomposed once; then each Y costs O(n). A sparse model is solved at the requested
frequencies, and the solutions serve as a basis for frequencies nearby.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg as la

from femsub.algebra import QUADRATIC, Handle, is_symmetric, orthonormal, shared_factor
from femsub.checks import EPS, Array, Matrix
from femsub.model import Pencil, Substructure
from femsub.modes import ModalForm, ShiftInvert, lowest_modes, modal_form, port_responses
from femsub.motion.nonlinear_model import Sliding

NEGLECTED = 1e-7  # relative error of a speed that harmonic balance accepts from partial fractions, from a basis, or from aliasing
CACHED_ENTRIES = 200_000  # entries of a temporary array: 3 MB, which fit into a cache


class Spectral(NamedTuple):
    """λ_j, right and left vectors of a dense pencil in modal form, A = right diag(values) left."""

    form: ModalForm  #: the undamped modes, in which the state is (Ωq, q̇)
    values: Array
    right: Array
    left: Array
    lower: slice  #: the rows of q̇


def spectral(pencil: Pencil) -> Spectral | None:
    """The decomposition of a dense pencil.

    None if M is not definite, or if eigenvalues (nearly) coalesce, so that partial fractions would suffer cancellation.
    """
    form = modal_form(pencil)
    if form is None:
        return None
    n, r, A = len(form.omega), form.rigid, form.state()
    values, right = la.eig(A, check_finite=False)
    if form.is_definite and is_symmetric(form.C):
        values = form.with_energy(values, right)
    try:
        left = la.inv(right, check_finite=False)
    except la.LinAlgError:
        return None
    condition = np.linalg.norm(right) * np.linalg.norm(left) / len(A)
    # the condition number is 1 for a normal A; at this limit half of the digits are left
    return Spectral(form, values, right, left, slice(n - r, None)) if condition < EPS**-0.5 else None


_KNOWN: WeakKeyDictionary[Substructure, Spectral | None] = WeakKeyDictionary()


def small(model: Substructure) -> bool:
    """Whether a model is small enough to compute all its modes and the stability of its cycles."""
    return not model.pencil.is_sparse or model.size <= QUADRATIC


def compliance(contact: Sliding) -> Compliance:
    """The compliance of a model at its contacts: by partial fractions if it is `small`, else by solves.

    A model is decomposed once. A model with structural damping is solved at each frequency.
    """
    model = contact.model
    if model.H is None and small(model):
        if model not in _KNOWN:
            _KNOWN[model] = spectral(model.pencil.dense())
        found = _KNOWN[model]
        if found is not None and (fractions := Fractions(found, contact.W)).error <= NEGLECTED:
            return fractions
    return Solved(model.pencil, contact.W, model.H)


class Fractions:
    """Y(s) = Σ_j R_j / (s - λ_j), R_j = c_j b_jᵀ, with c = Wᵀ X and b = Wᵀ Y from the right and left eigenvectors."""

    def __init__(self, found: Spectral, W: Array) -> None:
        self.found = found
        self._last: tuple[Array, Array, Array] | None = None
        self.w = found.form.shapes.T @ W
        self.out = self.w.T @ found.right[found.lower]
        self.into = found.left[:, found.lower] @ self.w
        self.residues = (self.out.T[:, :, None] * self.into[:, None, :]).reshape(len(found.values), -1)
        # the largest relative difference from a solve, at frequencies next to the most important poles
        values, self.error = found.values, 0.0
        upper = np.flatnonzero(values.imag > 0)
        if len(upper):
            height = np.abs(self.residues[upper]).sum(axis=1) / np.maximum(np.abs(values[upper].real), 1e-300)
            s = 1j * values[upper[np.argsort(-height)[:3]]].imag * (1 + 1e-3)  # beside the pole, where Y may be infinite
            exact = np.array([value * self.w.T @ la.solve(found.form.at(value), self.w) for value in s])
            size = np.abs(exact).max(axis=(1, 2))
            off = np.abs(self.mobility(s)[0] - exact).max(axis=(1, 2))
            self.error = float((off / np.where(size > 0, size, 1.0)).max())

    def mobility(self, s: Array) -> tuple[Array, Array]:
        """Y(s) and dY/ds, shape (m, p, p) each."""
        s = np.asarray(s, dtype=complex)
        if self._last is not None and np.array_equal(self._last[0], s):
            return self._last[1:]
        p = self.out.shape[0]
        Y, slope = (np.empty((len(s), p * p), dtype=complex) for _ in range(2))
        step = max(1, CACHED_ENTRIES // len(self.found.values))
        for start in range(0, len(s), step):
            at = slice(start, start + step)
            inverse = 1 / (s[at, None] - self.found.values)
            # einsum instead of @: for such small products, starting the threads of a BLAS takes more time than they save, and
            # slows down the threads of other libraries (NumPy, SciPy and PETSc have their own)
            Y[at] = np.einsum("mj,jk->mk", inverse, self.residues)
            slope[at] = -np.einsum("mj,jk->mk", np.square(inverse, out=inverse), self.residues)
        self._last = s.copy(), Y.reshape(-1, p, p), slope.reshape(-1, p, p)
        return self._last[1:]

    def estimate(self, s: Array) -> Array:
        """Y(s), shape (m, p, p)."""
        return self.mobility(s)[0]

    def response(self, s: Array, force: Array) -> Array:
        """x (n, m) with P(s_k) x_k = W f_k, s ≠ 0."""
        state = (force @ self.into.T).T / (s[None, :] - self.found.values[:, None])
        return self.found.form.shapes @ ((self.found.right[self.found.lower] @ state) / s)


class Solved:
    """Y(s) by one solve for each frequency that the responses found so far do not represent.

    The real and imaginary parts of the responses span V. V q with VᵀP(s)V q = VᵀW replaces the model if the error of h,
    estimated from the residual, is below NEGLECTED. Newton's method changes ω only a little in each step, and neighbouring
    harmonics share modes. So fewer systems are solved (`solves`) than there are harmonics. The basis of a sparse model begins
    with its lowest modes, `modes` in number. With structural damping H, P(s) + iH is solved for each s = iω, ω > 0.
    """

    def __init__(self, pencil: Pencil, W: Array, H: Matrix | None = None, modes: int = 40) -> None:
        self.pencil, self.W, self.H, self.solves = pencil, W, H, 0
        self.symmetric = all(pencil.symmetric)
        self.V = np.zeros((pencil.size, 0))
        self.quick: Fractions | None = None
        if H is None and pencil.is_sparse and pencil.size > QUADRATIC:
            # the lowest modes, which nearby responses cannot distinguish, and the first moments of h about 0
            lowest = lowest_modes(ShiftInvert(pencil.K, pencil.M, carried=pencil.rigid_motion), modes, evidence=False)
            moments = [self.static.solve(W)]
            for _ in range(3):
                moments.append(self.static.solve(pencil.M @ moments[-1]))
            self.V = orthonormal(lowest.shapes, np.asarray)[0]  # first, since the moments are nearly combinations of the modes
            self._grow(np.hstack(moments))

    def _galerkin(self, s: Array) -> tuple[Array, Array]:
        """x = V q - K⁻¹r with r = P(s)Vq - W, shape (m, n, p), and the error |rᵀK⁻¹r| / |h| (m,), infinite without a basis.

        Mainly high modes are missing in the basis, for which P is nearly K. Hence the correction K⁻¹r and the error estimate.
        """
        n, p = self.W.shape
        if self.quick is None:
            return np.zeros((len(s), n, p), dtype=complex), np.full(len(s), np.inf)
        found, wrong, size = np.empty((len(s), n, p), dtype=complex), np.zeros(len(s)), np.zeros(len(s))
        for c in range(p):
            q = self.quick.response(s, np.tile(np.eye(p)[c], (len(s), 1)))
            gap = self.images[0] @ (q * s**2) + self.images[1] @ (q * s) + self.images[2] @ q - self.W[:, c, None]
            both = self.static.solve(np.hstack([gap.real, gap.imag]))
            change = both[:, :len(s)] + 1j * both[:, len(s):]
            x = self.V @ q - change
            found[:, :, c] = x.T
            wrong += np.abs(np.einsum("nm,nm->m", gap, change))
            size += np.abs(self.W[:, c] @ x)
        return found, wrong / np.where(size > 0, size, 1.0)

    @cached_property
    def static(self) -> Handle:
        """K⁻¹."""
        return shared_factor(self.pencil.K, "definite")

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "static"}  # a factor cannot be pickled

    def _exact(self, s: complex) -> tuple[Array, Array]:
        self.solves += 1
        return port_responses(self.pencil, s, self.W, self.H)

    def _responses(self, s: Array) -> tuple[Array, dict[int, Array]]:
        """P(s)⁻¹W, shape (m, n, p), and P(s)⁻ᵀW at the frequencies at which a system was solved."""
        found, wrong = self._galerkin(s)
        left: dict[int, Array] = {}
        exact = np.zeros(len(s), dtype=bool)
        while (wrong > NEGLECTED).any():
            # solve at eight frequencies at once: the responses in between are often combinations of these
            bad = np.flatnonzero(wrong > NEGLECTED)
            chosen = bad[np.unique(np.linspace(0, len(bad) - 1, min(len(bad), 8)).astype(int))]
            new, other = zip(*(self._exact(s[i]) for i in chosen), strict=True)
            left.update(zip(chosen, other, strict=True))
            exact[chosen] = True
            found[chosen] = new
            if self.H is None:
                self._grow(np.hstack(new))
                again, wrong = self._galerkin(s)
                found[~exact] = again[~exact]
            wrong[exact] = 0.0
        return found, left

    def _grow(self, new: Array) -> None:
        new = np.hstack([new.real, new.imag]) if np.iscomplexobj(new) else new
        self.V = np.hstack([self.V, orthonormal(new, np.asarray, self.V)[0]])
        self.images = [part @ self.V for part in (self.pencil.M, self.pencil.D, self.pencil.K)]
        M, D, K = (self.V.T @ image for image in self.images)
        found = spectral(Pencil((M + M.T) / 2, D, (K + K.T) / 2))
        self.quick = None if found is None else Fractions(found, self.V.T @ self.W)

    def mobility(self, s: Array) -> tuple[Array, Array]:
        """Y(s) and dY/ds = h - s yᵀ(2sM + D)x, shape (m, p, p) each."""
        s = np.asarray(s, dtype=complex)
        x, left = self._responses(s)
        y = x if self.symmetric else [left[i] if i in left else self._exact(value)[1] for i, value in enumerate(s)]
        Y, slope = (np.empty((len(s), x.shape[2], x.shape[2]), dtype=complex) for _ in range(2))
        for i, value in enumerate(s):
            h = self.W.T @ x[i]
            Y[i] = value * h
            slope[i] = h - value * (y[i].T @ (2 * value * (self.pencil.M @ x[i]) + self.pencil.D @ x[i]))
        return Y, slope

    def estimate(self, s: Array) -> Array:
        """Y(s) from the responses found so far, shape (m, p, p)."""
        return (self.mobility(s) if self.quick is None else self.quick.mobility(s))[0]

    def response(self, s: Array, force: Array) -> Array:
        """x (n, m) with P(s_k) x_k = W f_k."""
        return np.einsum("mnp,mp->nm", self._responses(np.asarray(s, dtype=complex))[0], force)


#: `mobility` returns Y(s) (m, p, p) and dY/ds at m frequencies, `estimate` returns Y from the responses found so far, and
#: `response` returns x = P(s)⁻¹W f (n, m) for forces f (m, p)
Compliance: TypeAlias = Fractions | Solved
