"""The stability border of a large sparse model, through a basis that grows until the border has converged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from femsub.algebra import FEW, is_symmetric, one_thread, orthonormal, unresisted
from femsub.checks import EPS, EQUAL, Array, NotConvergedError
from femsub.model import Pencil, contact_matrix, in_band, units
from femsub.modes import PortFunction, ShiftInvert, complex_modes, independent, lowest_modes, modes_below, port_responses
from femsub.stability.border import OUTSIDE, Band, Border, ModalContact, dense_border
from femsub.stability.crossings import ASIDE

ACTING = 1.5  # modes up to this multiple of the end of the band affect its border


def sparse_border(pencil: Pencil, W: Array, band: Band, method: str = "auto", rounds: int = 8) -> Border:
    """The border of a large model, by a basis that grows until the border has converged.

    The basis starts with the undamped modes up to ACTING times the band, and the static responses to the contact and to dashpots
    (a Craig-Chang basis, in which Ω is exact to rounding). At each border found, the full model's response to the contact,
    (-ω²M + iωD + K)⁻¹W, joins the basis. The same is done at an edge of the band where a pair may cross, to decide whether that
    border belongs to the band. M and K are symmetric. All DOF are scaled to similar size, so that the complex modes that verify
    the border share the factor. A border that still moves after `rounds` rounds is an error. A round takes at most one complex
    factorisation.
    """
    if (alike := pencil.alike()) is not pencil:
        unit = pencil.units[0][:, None]
        border = sparse_border(alike, unit * W, band, method, rounds)
        return replace(border, shapes=unit * border.shapes)
    basis = _Growing(pencil, W, ACTING * band[1])
    # the edges of the band at which a pair may cross, because a mode or a root of the scalar function is near
    edges = [edge for edge in band if 0 < edge < np.inf]
    near = [edge for edge in edges if np.abs(basis.frequencies - edge).min(initial=np.inf) <= ASIDE * edge]
    if len(near) < len(edges):
        with one_thread(len(basis.K) <= FEW):
            model = ModalContact(basis.pencil, basis.W)
            functions = [PortFunction.of(model.form, w, model.decomposition(0.0)) for w in model.W.T]
            near = [edge for edge in edges if edge in near or any(
                len(function.crossings((1 - OUTSIDE) * edge, (1 + OUTSIDE) * edge)[0]) for function in functions)]
    basis.grow(np.array(near))
    previous = np.nan
    for _ in range(rounds):  # until a response no longer moves the border in ten digits
        border = dense_border(basis.pencil, basis.W, band, method)
        if not np.isfinite(border.c) or border.c == 0 or border.omega == 0 or abs(border.c - previous) <= 1e-10 * abs(border.c):
            break
        previous = border.c
        basis.grow(border.crossing[:4])
    else:
        raise NotConvergedError(f"the border still moved from {previous:.9g} to {border.c:.9g} in the last of {rounds} rounds. "
                                "Narrow the band")
    if np.isinf(border.c):
        return border
    border = replace(border, shapes=basis.V @ border.shapes, beyond=None)
    if border.omega == 0 and border.c < 0:  # rigid motion is exact from the start; oscillating modes still need the refinement
        later = sparse_border(pencil, W, (OUTSIDE * float(basis.frequencies.min(initial=band[1])), band[1]), method, rounds)
        return later if later.c > border.c * (1 - EQUAL) else border
    if border.c == 0:
        return border
    # Re λ of the full model at c(1 ∓ ASIDE), by PEP; an error if they contradict the border
    growth = []
    followed = (min(band[0], (1 - OUTSIDE) * border.omega), max(band[1], (1 + OUTSIDE) * border.omega))
    for factor in (1 - ASIDE, 1 + ASIDE):
        modes = complex_modes(pencil.with_damping(contact_matrix(W, border.c * factor)), band=followed,
                              re=(-0.2 * band[1], 0.2 * band[1]), evidence=False)  # a pair near the axis; few are damped so much
        values, bars = modes.eigenvalues, modes.error_bar
        if modes.rigid.all():
            raise NotConvergedError(f"the border c = {border.c:.9g} at ω = {border.omega:.6g} could not be verified on the full "
                                    f"model: it has no eigenvalue there at {factor:g} c. Narrow the band")
        at = int(np.argmin(np.abs(values - 1j * border.omega) + np.where(modes.rigid, np.inf, 0.0)))
        growth.append(float(values[at].real))
        # Growing real eigenvalues come from a pair that crossed outside the band.
        early = modes.unstable[values[modes.unstable].imag > 0] if factor < 1 else np.zeros(0, dtype=int)
        early = early[in_band(values[early], band)]
        if len(early) or (factor > 1 and values[at].real < -bars[at]):
            shown = values[early[0]] if len(early) else values[at]
            raise NotConvergedError(f"the border c = {border.c:.9g} at ω = {border.omega:.6g} does not hold on the full model: "
                                    f"at {factor:g} c it has λ = {shown:.6g}. Narrow the band")
    return replace(border, growth=(growth[0], growth[1]))


class _Growing:
    """An M-orthonormal basis V of a sparse model with the projected pencil; `grow` adds responses to the contact."""

    def __init__(self, model: Pencil, W: Array, limit: float) -> None:
        self.full, self.load = model, W
        self.handle = handle = ShiftInvert(model.K, model.M, carried=model.rigid_motion)
        modes = modes_below(model.K, model.M, limit, handle)
        if modes.rigid == len(modes.eigenvalues):
            modes = lowest_modes(handle, 1)
        braked = np.unique(model.D.nonzero()[1])
        one_by_one = braked if len(braked) <= 12 else braked[:0]  # each costs a solve now and a coordinate of every border
        forces = np.hstack([W, sp.eye_array(model.size, format="csc")[:, one_by_one].toarray()])
        rest = handle.elastic_solve(forces, modes.shapes)
        statics, stiffness, mass, _ = independent(handle, rest, forces, modes.shapes, modes.eigenvalues)
        massive = mass > 0
        self.rigid = modes.rigid
        loose = unresisted(model.D, modes.shapes[:, :modes.rigid], units(model.M))
        self.loose = loose[1]
        self.V = np.hstack([loose[0], modes.shapes[:, modes.rigid:], statics[:, massive]])
        self.K = np.diag(np.concatenate([modes.eigenvalues, stiffness[massive]]))
        self.frequencies = modes.elastic

    @property
    def W(self) -> Array:
        return self.V.T @ self.load

    @property
    def pencil(self) -> Pencil:
        force = self.full.D @ self.V
        force[:, self.loose] = 0.0  # rounding in D must not damp rigid motion: it would define the border of its drift
        D = self.V.T @ force
        if is_symmetric(self.full.D):
            D[self.loose] = 0.0
        return Pencil(np.eye(len(self.K)), D, self.K)

    def grow(self, omega: Array) -> None:
        if not len(omega):
            return
        new = np.hstack([self._beyond(value) for value in omega])
        new, _ = orthonormal(np.hstack([new.real, new.imag]), self.full.M.__matmul__, self.V)
        cross, own = self.V.T @ (self.full.K @ new), new.T @ (self.full.K @ new)
        cross[:self.rigid] = 0.0  # rounding in K of rigid motion would look like a soft mount
        self.K = np.block([[self.K, cross], [cross.T, (own + own.T) / 2]])
        self.V = np.hstack([self.V, new])

    def _beyond(self, omega: float) -> Array:
        """Z (n, p), the part of the response P(iω)⁻¹W = VQ + Z outside V.

        VᵀMZ = 0, so Z consists of modes above the band, for which A = K - σM is near P(iω). Therefore
        Z ← Z + A⁻¹(W - P(VQ + Z)) contracts, with Q by Galerkin's condition. If large damping prevents this, a complex
        factor is used: that costs as much as some 60 steps.
        """
        P, small, p = self.full.at(1j * omega), self.pencil.at(1j * omega), self.load.shape[1]
        Z, step = np.zeros(self.load.shape, dtype=complex), np.inf
        for _ in range(60):
            rest = self.load - P @ Z
            inside = self.V @ np.linalg.solve(small, self.V.T @ rest)
            rest = rest - P @ inside
            both = self.handle.factor.solve(np.hstack([rest.real, rest.imag]))
            change = both[:, :p] + 1j * both[:, p:]
            change -= self.V @ (self.V.T @ (self.full.M @ change))
            Z, before, step = Z + change, step, float(np.linalg.norm(change))
            # Z no longer changes, or rounding of the response makes it change
            if step <= 4096 * EPS * np.linalg.norm(Z) or before / 2 < step <= EQUAL * np.linalg.norm(inside + Z):
                return Z
            if step > before:
                break
        return port_responses(self.full, 1j * omega, self.load)[0]
