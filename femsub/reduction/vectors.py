"""A basis of right and left eigenvectors of a system with friction, with as few vectors as a tolerance allows.

A parameter box of one value (`femsub.reduction.over_box`) gives a reference model that is more accurate than the tolerance
requires. Its eigenvalues in the band are counted. The real and imaginary parts of its right and left vectors are ordered by
their contribution to the residual, relative to the residual that the tolerance allows. The basis takes vectors in this order
until its λ are within the tolerance. The radii of the reference model are included in the error.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, NotConvergedError
from femsub.model import SMALL_SHARE, Affine, Estimate, Pencil, distance_outside, doubled, upper
from femsub.modes import solve
from femsub.reduction.estimates.nested import MARGIN, compared
from femsub.reduction.estimates.search import Goal
from femsub.reduction.over_box import at_one_value, real_parts
from femsub.reduction.parameter_box import ParameterBox


def vectors_within(family: Affine, goal: Goal, shapes: Array, name: str, finer: float = 1e-3,
                   first: float = 8.0) -> tuple[Array, Estimate]:
    """V (n, r), whose span contains `shapes` (n, k), and the error of each λ of VᵀP(s)V in a band; P has no parameters.

    The tolerance of the reference model is `finer` times that of V. The first V has the directions whose contribution to the
    residual is more than `first` times the allowed one.

    Raises
    ------
    NotConvergedError
        The eigenvalues in the band cannot be counted, or rounding prevents the tolerance from being met.
    """
    (lo, hi), tol = goal.band, goal.tol
    model, fixed = at_one_value(family, ParameterBox({}, goal.band, tol * finer), shapes)
    cell, = model.cells
    if cell.number is None or cell.contour is None:
        raise NotConvergedError(f"{name}: the eigenvalues of the full system up to {hi:.5g} rad/time cannot be counted: "
                                f"{cell.why}. Lower the band, mu, or the contact's stiffness")
    larger, exact, x, z, size = model.pairs({})
    still, cutoff = model.box.still, float((cell.contour.sides or (0.0, 0.0, hi))[2])
    share = np.sqrt(model.radii.least * tol * np.maximum(np.abs(exact), still))
    # after the vectors all other directions, largest inertia first: with the vectors alone, V may have spurious λ
    sides = [part for side in (x, z) for part in real_parts(side[fixed:] / share)]
    U, weight, _ = np.linalg.svd(np.hstack([*sides, EPS**0.5 / larger.norms[0] * larger.M[fixed:, fixed:]]), full_matrices=False)
    moving = np.abs(exact) > still
    exact, radius = exact[moving], model.radii.circles(exact, size)[moving]
    both = np.append(np.arange(len(exact)), doubled(exact))
    exact, radius = np.where(np.arange(len(both)) < len(exact), exact[both], exact[both].conj()), radius[both]
    wanted = distance_outside(exact, goal.band, (-hi, hi)) <= radius  # λ of the full system may be in the band
    count = max(int(np.count_nonzero(weight > first)), int(not fixed))
    while True:
        T = la.block_diag(np.eye(fixed), U[:, :count])
        found = solve(Pencil(*(T.T @ part @ T for part in (larger.M, larger.D, larger.K))))[0]
        found = found[upper(found) & (np.abs(found) > still)]
        at, to, distance, inside, alone = compared(exact, found, goal.band, wanted)
        error = (MARGIN * distance + radius[at]) / np.maximum(np.abs(exact[at]), SMALL_SHARE * hi)
        estimate = Estimate(goal.band, tol, int(inside.sum()), cutoff, np.zeros(0), np.zeros(0), found[to[inside]], error[inside],
                            alone, model.size, 1.0, exact[at[inside]], radius[at[inside]])
        if estimate.met:
            return model.V @ T, estimate
        if count >= len(weight):
            raise NotConvergedError(f"{name} cannot be reduced to a relative error of {tol:g} from {lo:.5g} to {hi:.5g} rad/time "
                                    f"under this friction: {estimate!r}. Lower the band, or raise tol")
        count = min(len(weight), max(count + 1, int(1.1 * count)))
