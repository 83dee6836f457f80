"""Base class of the methods with free interfaces: free modes, residual attachment modes, and physical interface coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, EQUAL, Array, InputError
from femsub.reduction.basis import Basis, Partition, Statics
from femsub.reduction.method import Method

if TYPE_CHECKING:
    from femsub.modes import ShiftInvert

DUST = 64 * EPS  # an entry counts as rounding below this share of its bound


@dataclass(frozen=True)
class FreeInterface(Method):
    """[Φ_r Φ_f Ψ]: free modes, and the static responses to interface forces without the modes' contribution."""

    held = False

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """Unit forces at the interface, and no constraint modes."""
        n, n_b = part.sub.size, len(part.sub.interface)
        forces = np.zeros((n, n_b + extra.shape[1]), order="F")
        forces[part.sub.interface, np.arange(n_b)] = 1.0
        forces[:, n_b:] = extra
        return Statics.of(part, handle, forces, "residual attachment")


def recovered(basis: Basis, statics: Statics, clear: float = 1e-2) -> Basis:
    """The same model in the coordinates [u_b, rest]: the interface displacements replace as many columns of V.

    With B = V_b = [B_J B_I], u_b = B_J q_J + B_I q_I is solved for q_J:

        V T = [V_J B_J⁻¹, V_I - V_J B_J⁻¹ B_I],   M → TᵀMT,   K → TᵀKT.

    J are the residual shapes, as in Craig and Chang (1977). If the residual flexibility in some direction is almost 0 (exactly 0
    with every mode kept), J takes modes in place of residual shapes: B_J is then regular, and the span is the same.

    A residual shape belongs to J only if its interface motion (`motion_by`), orthogonal to that of the shapes chosen before,
    exceeds `clear`.

    Raises
    ------
    InputError
        The basis cannot move all interface DOF independently of each other.
    """
    b = statics.part.sub.interface
    if not len(b):
        return basis
    motion = motion_by(basis)
    # choose n_b columns with independent interface motion by pivoted QR: residual shapes first
    residual = np.array([kind == statics.kind for kind in basis.kinds])
    solved = np.zeros(0, dtype=np.intp)
    for candidates, least in ((np.flatnonzero(residual), clear), (np.arange(len(residual)), EQUAL)):
        candidates = np.setdiff1d(candidates, solved)
        if len(solved) == len(b) or not len(candidates):
            continue
        new = motion[:, candidates]
        if len(solved):
            Q = np.linalg.qr(motion[:, solved])[0]
            new = new - Q @ (Q.T @ new)
        R, order = la.qr(new, mode="r", pivoting=True)
        count = int(np.count_nonzero(np.abs(R.diagonal()) > least))
        solved = np.append(solved, candidates[order[:min(count, len(b) - len(solved))]])
    if len(solved) < len(b):
        raise InputError(f"{statics.part.sub.name!r}: its {len(b)} interface DOF move in {len(solved)} independent ways only, so "
                         "that not all of them can be coordinates; leave DOF out of the interface that others move rigidly, or "
                         "use CraigChang")
    rest = np.setdiff1d(np.arange(len(basis.M)), solved)
    moved = np.where(np.abs(motion) < DUST, 0.0, basis.interface)  # rounding would couple a massless shape to a mode's mass
    B = moved[:, solved]
    inverse = np.linalg.inv(B)
    inverse = _clean(inverse, np.abs(inverse) @ np.abs(B) @ np.abs(inverse))
    # such a motion of a massless shape would give it a spurious mass; its energy, the square of the motion, is rounding
    faint = (np.abs(motion) < np.sqrt(EPS)) & (basis.M.diagonal() == 0)
    T = np.zeros(basis.M.shape)
    T[solved, :len(b)], T[rest, len(b) + np.arange(len(rest))] = inverse, 1.0
    others = np.where(faint, 0.0, moved)[:, rest]
    T[solved, len(b):] = _clean(-inverse @ others, np.abs(inverse) @ np.abs(others))
    rigid = None if basis.rigid is None else np.vstack([basis.interface @ basis.rigid, basis.rigid[rest]])
    found = basis.turned(T, ("interface",) * len(b) + tuple(basis.kinds[j] for j in rest), rigid)
    return replace(found, interface=np.eye(len(b), len(T)))


def _clean(A: Array, bound: Array) -> Array:
    """A with 0 in place of rounding. Otherwise rigid motion would have a strain energy, and would not be recognised."""
    return np.where(np.abs(A) < DUST * bound, 0.0, A)


def motion_by(basis: Basis) -> Array:
    """Interface displacements of each column at unit energy, shape (n_b, r), each row divided by its length."""
    stiffness, mass = basis.K.diagonal(), basis.M.diagonal()
    both = (stiffness > 0) & (mass > 0)
    strain, inertia = (float(np.einsum("ij,ij,j->", basis.interface[:, on], basis.interface[:, on], 1 / size[on]))
                       for size in (stiffness, mass) for on in (size > 0,))
    # if no column has both stiffness and mass: rigid motion and strain then move the interface equally, in any units
    lowest = float((stiffness[both] / mass[both]).min()) if both.any() else inertia / strain if strain * inertia else 1.0
    B = basis.interface / np.sqrt(stiffness + lowest * mass)
    size = np.linalg.norm(B, axis=1)
    return np.asarray(B / np.where(size > 0, size, 1.0)[:, None])
