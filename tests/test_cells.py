"""A count that is proved for all values of parameters in a cell, and the small model over a box: never wrong, against LAPACK."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import halves
from femsub.checks import Array
from femsub.modes.quadratic.cells import CellBound, Change, images
from femsub.modes.quadratic.energy_basis import Coupling, EnergyBasis, Term
from femsub.modes.quadratic.region import Contour


def eigenvalues(M: Array, D: Array, K: Array) -> Array:
    """All λ by LAPACK."""
    n = len(M)
    return la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]]))


def test_a_change_that_acts_from_the_basis_to_the_rest_alone_is_not_proved_away() -> None:
    """T has an image outside V and Tᵀ has none: with ‖B_R‖ ‖B_L‖ in ξ, instead of each alone, cells were proved that lose λ."""
    M, A = np.diag([1.0, 1e-3, 1e-6]), np.eye(3)
    coupling, T = np.zeros((3, 3)), np.zeros((3, 3))
    coupling[0, 2], T[2, 0] = 0.05, 1.0
    contour, number = Contour(sides=(-0.9, 0.9, 0.9)), 0
    terms = [Term(sp.csr_array(M), (0.0, 0.0, 1.0), range=(0.0, 1e-6))]
    for matrix, weights in ((coupling, (1.0, 0.0, 0.0)), (T, (0.0, 0.0, 0.0))):
        terms += [Term(half, weights, sign, (0.0, 0.0))
                  for half, sign in zip(halves(sp.csr_array(matrix)), (1.0, -1.0), strict=True)]
    basis = EnergyBasis(lambda x: x, lambda x: x, terms, 3)
    basis.add(np.eye(3)[:, :2])
    small, c = Coupling.of(basis, contour.size), 1 - 2e-6 * contour.size**2
    for delta in (0.5, 1.0, 2.0, 5.0, 10.0):
        outside = images(basis, np.array([1.0, 1.0, 1.0, delta, delta]))
        margin = CellBound(small, contour, c, [(Change.of(basis, [3, 4], 0), delta)], outside).margin()[0]
        counts = {int(np.count_nonzero(contour.encloses(eigenvalues(M, 0 * M, A + coupling + theta * T))))
                  for theta in np.linspace(-delta, delta, 21)}
        assert margin == np.inf or counts == {number}, f"±{delta:g}: {counts} of {margin:.2g}"
        assert margin < 1 or delta > 1
