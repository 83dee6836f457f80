"""A basis that grows in place, whose images are not kept: what it holds is right, and a box takes a few times its memory."""

from __future__ import annotations

import mmap
import tracemalloc

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.algebra import Room
from femsub.checks import Array
from femsub.modes.quadratic.energy_basis import EnergyBasis, Term


def test_bases_with_one_beginning_grow_apart() -> None:
    rng = np.random.default_rng(1)
    V, room = Room().joined(np.zeros((7, 0)), rng.random((7, 3)))
    first = V.copy()
    one, other = rng.random((2, 7, 3))
    joined = [room.joined(V, new) for new in (one, other)]  # there is room for one of them behind V
    longer = joined[0][1].joined(joined[0][0], other)[0]
    assert np.array_equal(V, first)
    assert all(np.array_equal(found, np.hstack([first, new])) for (found, _), new in zip(joined, (one, other), strict=True))
    assert np.array_equal(longer, np.hstack([first, one, other]))
    assert np.shares_memory(joined[0][0], V) and not np.shares_memory(joined[1][0], V)


@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_residuals_join_by_their_products(kept: bool, seed: int) -> None:
    """A and the terms have full images: residuals are those of dense algebra, and what is left of each is below the limit."""
    rng, n, m = np.random.default_rng(seed), 150, 9
    S, G, root = rng.standard_normal((3, n, n)) / n**0.5
    A, halves = np.eye(n) + root @ root.T, (S + S.T, G - G.T)
    terms = [Term(sp.csr_array(half), weights, sign) for half, weights, sign in zip(
        halves, ((0.3, 0.0, 1.0), (0.0, 1.0, 0.0)), (1.0, -1.0), strict=True)]
    basis = EnergyBasis(A.__matmul__, lambda B: np.linalg.solve(A, B), terms, n, kept=kept)
    basis.add(rng.standard_normal((n, m)))
    s, x = [1.0, 1j] @ rng.standard_normal((2, 5)), np.tensordot([1.0, 1j], rng.standard_normal((2, m, 5)), 1)

    def residuals(V: Array) -> Array:
        """Of P and of Pᴴ, (n, 2k); a column of x is one of V."""
        loads = np.hstack([sum(half @ (V[:, :m] @ (x * weight)) for half, weight in zip(halves, (w[0], sign * w[1]), strict=True))
                           for sign, w in ((1, [term.weight(s) for term in terms]),
                                           (-1, [term.weight(s).conj() for term in terms]))])
        return np.asarray(np.linalg.solve(A, loads) - V @ (V.T @ loads))

    def lengths(R: Array) -> Array:
        R = np.hstack([R.real, R.imag])
        return np.asarray(np.einsum("ij,ij->j", R, A @ R))

    basis.lost  # noqa: B018
    exact, C = residuals(basis.V), [basis.coefficients(s, x, adjoint) for adjoint in (False, True)]
    found = np.hstack([basis.residuals(s, x, adjoint).view(complex) for adjoint in (False, True)])
    assert np.abs(found - exact).max() < 1e-5 * np.abs(exact).max()  # kept in single precision
    least = float(np.median(lengths(exact))) / 10
    before, V = basis.at([term.weights for term in terms]), basis.V
    assert basis.join(C, least) and m < basis.size <= m + 20
    assert np.allclose(basis.V.T @ A @ basis.V, np.eye(basis.size))
    assert lengths(residuals(basis.V)).sum() <= 20 * least * 1.01 and lengths(exact).max() > least
    assert before.size == m and np.array_equal(basis.V[:, :m], V)


@pytest.mark.slow
def test_a_box_takes_a_few_times_the_memory_of_its_basis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a long chain, whose matrices and factor are small beside V, and V has more columns than are solved for at a time."""
    largest, basis = [0.0], [0]

    def joined(room: Room, V: Array, new: Array) -> tuple[Array, Room]:
        """As that of `Room`, in memory that is not traced: columns that are not there yet take no pages."""
        m, both, copied = V.shape[1], V.shape[1] + new.shape[1], 0
        if m != room._used or both > room._array.shape[1]:
            old, room = V, Room()
            room._array = np.frombuffer(mmap.mmap(-1, 32 * len(V) * both)).reshape((len(V), 4 * both), order="F")
            room._array[:, :m], copied = old, old.nbytes
        room._array[:, m:both], room._used = new, both
        traced = tracemalloc.get_traced_memory()
        largest[0] = max(largest[0], traced[1] - before[0] + basis[0], traced[0] - before[0] + copied + 8 * len(V) * both)
        basis[0] = 8 * len(V) * both
        tracemalloc.reset_peak()
        return room._array[:, :both], room

    def made(n: int, hi: float) -> None:
        rng, chain, rows = np.random.default_rng(1), fs.chain(n), n // 2 + np.arange(60)
        rub = sp.csr_array((1e-5 * rng.standard_normal(120), rng.choice(rows, (2, 120))), shape=(n, n))
        D = sp.csr_array(1e-3 * chain.K + sp.diags_array(1e-4 * np.linspace(0, 1, n)))
        family = fs.Affine(chain.M, [(1.0, D)], [(1.0, chain.K), ("mu", rub)])
        tracemalloc.reset_peak()
        before[0], largest[0], basis[0] = tracemalloc.get_traced_memory()[0], 0.0, 0
        small = fs.reduce(family, fs.ParameterBox({"mu": (0.0, 1.0)}, (0.0, hi), tol=1e-4))
        assert small.evidence == "certified"
        largest[0] = max(largest[0], tracemalloc.get_traced_memory()[1] - before[0] + basis[0])

    monkeypatch.setattr(Room, "joined", joined)
    before = [0]
    tracemalloc.start()
    try:
        made(400, 0.03)  # modules take memory as well
        made(4500, 0.025)
    finally:
        tracemalloc.stop()
    assert largest[0] < 4.5 * basis[0]  # of 105 columns, beside which blocks of 64 are not small
