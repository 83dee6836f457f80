"""Block Gram-Schmidt: orthonormalise columns against a basis and among themselves; a basis that grows in place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from femsub.algebra.processes.limits import BLOCK
from femsub.checks import EPS, Array


class Room:
    """Memory for a basis and for columns to come, which takes no pages before they are written.

    Without it, each new block would need a copy of the basis, and for a while twice its memory.
    """

    def __init__(self) -> None:
        self._array, self._used = np.zeros((0, 0)), 0

    def joined(self, V: Array, new: Array) -> tuple[Array, Room]:
        """[V new], and its room: this one if V is the last basis made in it and the new columns fit. V itself does not change."""
        m, both = V.shape[1], V.shape[1] + new.shape[1]
        room = self
        if m != self._used or both > self._array.shape[1]:
            room = Room()
            try:  # a basis grows about threefold, and each new room is a copy
                room._array = np.empty((len(V), 4 * both), order="F")
            except MemoryError:  # on a system that does not overcommit memory
                room._array = np.empty((len(V), both), order="F")
            room._array[:, :m] = V
        room._array[:, m:both], room._used = new, both
        return room._array[:, :both], room


def orthonormal(columns: Array, product: Callable[[Array], Array], V: Array | None = None, inside: float = 1e-9
                ) -> tuple[Array, Array]:
    """Q (n, k) with [V Q]ᵀA[V Q] = I and span [V Q] = span [V columns], and AQ.

    Block Gram-Schmidt in two passes. Columns are scaled to unit length before each pass, so that their units do not matter.
    Their Gram matrix keeps only half of the digits; the second pass recovers the rest. Columns that lie in V or depend on
    others, within rounding, are left out; k may be 0.

    Parameters
    ----------
    columns : ndarray, shape (n, l)
    product : callable
        x (n, l) to Ax, with a symmetric positive semidefinite A.
    V : ndarray, shape (n, m), optional
        VᵀAV = I; m may be 0.
    inside : float
        Relative length below which a column's remainder outside V counts as rounding. The default is well above V's own deviation
        from VᵀAV = I, so that a column keeps at least seven digits.

    References
    ----------
    L. Giraud, J. Langou, M. Rozložník, J. van den Eshof, Numer. Math. 101 (2005) 87 (two passes are enough).
    """
    x, image = columns, product(columns)
    for last in (False, True):
        # the second pass begins with columns of unit length, and leaves them their length; shorter ones are the rounding that
        # dependent columns left
        x, image, length = _longer(x, image, 0.5 if last else 0.0)
        if V is not None and V.shape[1]:
            share = (V.T @ image) / length
            del image  # few arrays of this size at a time
            x = x / length
            for at in range(0, len(length), BLOCK):
                x[:, at:at + BLOCK] -= V @ share[:, at:at + BLOCK]
            x, image, length = _longer(x, product(x), 0.5 if last else inside)
        if not x.shape[1]:
            break
        gram = x.T @ image / np.outer(length, length)
        values, vectors = np.linalg.eigh((gram + gram.T) / 2)
        good = values > 64 * EPS * values[-1]  # below lies the rounding of the products
        # up to a condition of 2 no digit of the Gram matrix is lost, and a second pass changes nothing
        last |= (V is None or not V.shape[1]) and values[-1] < 2 * values[0]
        change = vectors[:, good] / np.sqrt(values[good]) / length[:, None]
        x = x @ change
        if last:
            image = image @ change  # the change is well conditioned: AQ loses no digits
            break
        image = product(x)
    return x, image


def _longer(x: Array, image: Array, least: float) -> tuple[Array, Array, Array]:
    """The columns whose A-norm exceeds `least`, their products with A, and their norms."""
    length = np.sqrt(np.maximum(np.einsum("ij,ij->j", x, image), 0.0))
    keep = length > least
    return (x, image, length) if keep.all() else (x[:, keep], image[:, keep], length[keep])
