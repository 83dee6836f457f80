"""Noise of measured receptances, and its effect to first order on all results that follow from them.

A measured Y (a, b) has the error δ, with mean 0. A result that follows from it has the error e = L δ R, L (nr, a), R (b, nl). Two
entries e and e' have the covariance Γ = E[e ē'] and the pseudo-covariance C = E[e e']. The mean of n repeated measurements, with
the deviations d from it, has

    Γ = Σ (L d R) conj(L d R)' / (n (n - 1)),   C = Σ (L d R) (L d R)' / (n (n - 1)),

so common noise of several entries, such as noise of one sensor, is included. A stated σ for each entry means independent entries
with real and imaginary parts of equal size: Γ = Σ L R σ² conj(L R)', C = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from femsub.checks import Array


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise of one measurement, and its way to a result: e = L δ R.

    Attributes
    ----------
    left, right : ndarray, shapes (nf or 1, nr, a) and (nf or 1, b, nl)
        L and R.
    scatter : ndarray, shape (nf, a, b), optional
        σ of independent entries.
    deviations : ndarray, shape (ns, nf, a, b), optional
        Deviations of ns repeated measurements from their mean.
    small : ndarray of bool, shape (nf or 1,)
        Whether the noise is small enough for first order, at each frequency.
    """

    left: Array
    right: Array
    small: Array
    scatter: Array | None = None
    deviations: Array | None = None

    @classmethod
    def of(cls, rows: int, columns: int, *, scatter: Array | None = None, deviations: Array | None = None) -> Noise:
        """The noise of a measurement itself, with L = I and R = I."""
        return cls(np.eye(rows)[None], np.eye(columns)[None], np.ones(1, dtype=bool), scatter, deviations)

    def through(self, left: Array, right: Array, small: Array | None = None) -> Noise:
        """The noise of the result left Y right."""
        return replace(self, left=left @ self.left, right=self.right @ right,
                       small=self.small if small is None else self.small & small)

    @property
    def repeated(self) -> int:
        """The number of repeated measurements; 0 for a stated σ."""
        return 0 if self.deviations is None else len(self.deviations)

    def moments(self) -> tuple[Array, Array]:
        """E|e|² and E[e²] of each entry, (nf, nr, nl) each; inf and 0 where the noise is not small."""
        if self.scatter is not None:
            size = np.abs(self.left) ** 2 @ self.scatter**2 @ np.abs(self.right) ** 2
            turned = np.zeros(size.shape, dtype=complex)
        else:
            size, turned = 0.0, 0.0  # type: ignore[assignment]
            assert self.deviations is not None
            for one in self.deviations:
                e = self.left @ one @ self.right / np.sqrt(self.repeated * (self.repeated - 1))
                size, turned = size + np.abs(e) ** 2, turned + e**2
        small = self.small[:, None, None]
        return np.where(small, size, np.inf), np.where(small, turned, 0.0)

    def covariance(self, rows: Array, columns: Array, most: int = 2_000_000) -> tuple[Array, Array]:
        """Γ and C of the entries (rows, columns), (nf, k, k) each; NaN where the noise is not small.

        Temporary arrays have at most `most` numbers: 32 MB, about the size of a processor's cache.
        """
        left, right = self.left[:, rows], np.swapaxes(self.right[:, :, columns], 1, 2)  # (nf, k, a), (nf, k, b)
        if self.deviations is None:
            assert self.scatter is not None
            k, turned = len(rows), np.zeros(())
            gamma = np.zeros((len(self.scatter), k, k), dtype=complex)
            step = max(1, most // (k * right.shape[2]))
            for f, sigma in enumerate(self.scatter):  # one frequency after the other, and in blocks of the rows of σ
                L, R = (part[f if len(part) > 1 else 0] for part in (left, right))
                for start in range(0, len(sigma), step):
                    block = slice(start, start + step)
                    each = (L[:, block, None] * R[:, None] * sigma[block]).reshape(k, -1)
                    gamma[f] += each @ each.conj().T
        else:
            e = np.array([np.einsum("fka,fka->fk", left, right @ np.swapaxes(one, 1, 2)) for one in self.deviations])
            e = np.moveaxis(e, 0, -1) / np.sqrt(self.repeated * (self.repeated - 1))
            gamma, turned = (e @ np.swapaxes(other, 1, 2) for other in (e.conj(), e))
        small = self.small[:, None, None]
        return np.where(small, gamma, np.nan), np.where(small, turned, np.nan) + np.zeros(gamma.shape, dtype=complex)
