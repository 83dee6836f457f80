"""Errors planted by hand, and what notices them: a lost vector of a pair, a wrong eigenvalue, friction of the wrong sign."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

import femsub as fs
from benchmarks.lattices import membrane, membrane_eigenvalues
from femsub import algebra
from femsub.model import pencil
from femsub.modes import normal_modes
from femsub.modes.quadratic import dense, port_function, search, sparse
from femsub.stability import growing_border

BELT = fs.Belt(slope=-0.2677)


def after(monkeypatch: pytest.MonkeyPatch, module: object, name: str, change: Callable) -> None:
    """Lets `change` spoil what a function returns."""
    original = getattr(module, name)
    monkeypatch.setattr(module, name, lambda *arguments, **options: change(*original(*arguments, **options)))


def without(place: int) -> Callable:
    """λ and vectors without the one at this place in ascending order of |λ|."""
    def change(values: np.ndarray, *vectors: np.ndarray) -> tuple[np.ndarray, ...]:
        keep = np.sort(np.argsort(np.abs(values), kind="stable")[np.arange(len(values)) != place])
        return values[keep], *(part[:, keep] for part in vectors)
    return change


def twice(place: int) -> Callable:
    """λ and vectors with the one at this place in that of its successor: a pair with one vector listed twice."""
    def change(values: np.ndarray, *vectors: np.ndarray) -> tuple[np.ndarray, ...]:
        order = np.argsort(np.abs(values), kind="stable")
        columns = np.arange(len(values))
        columns[order[place + 1]] = order[place]
        return values[columns], *(part[:, columns] for part in vectors)
    return change


def moved(place: int, by: float) -> Callable:
    """One λ (and what is its conjugate) times 1 + by."""
    def change(values: np.ndarray, *vectors: np.ndarray) -> tuple[np.ndarray, ...]:
        spoilt = values[np.argsort(np.abs(values), kind="stable")[place]]
        return np.where((values == spoilt) | (values == np.conj(spoilt)), values * (1 + by), values), *vectors
    return change


# normal modes: the pair λ_12 = λ_21 of a square membrane, dense (LAPACK) and sparse (Krylov-Schur)

SOLVERS = {"dense": (normal_modes, "dense_modes", 6), "sparse": (algebra, "symmetric_modes", 30)}


@pytest.mark.parametrize("path", SOLVERS)
def test_nothing_planted(path: str) -> None:
    size = SOLVERS[path][2]
    assert np.allclose(fs.normal_modes(membrane(size), count=8).eigenvalues, membrane_eigenvalues(size)[:8], rtol=1e-11)


@pytest.mark.parametrize("path", SOLVERS)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_vector_of_a_repeated_pair_is_missed_by_the_count(path: str, place: int, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name, size = SOLVERS[path]
    after(monkeypatch, module, name, without(place))
    try:
        modes = fs.normal_modes(membrane(size), count=8)
    except fs.MissedModesError as error:
        assert "inertia of K - ω²M counts" in str(error)
    else:  # fetched by a second search, from which another vector is taken
        assert path == "sparse" and place > 0
        assert np.allclose(modes.eigenvalues, membrane_eigenvalues(size)[:8], rtol=1e-11)


@pytest.mark.parametrize("path", SOLVERS)
def test_one_vector_of_a_repeated_pair_listed_twice_is_not_orthogonal(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name, size = SOLVERS[path]
    after(monkeypatch, module, name, twice(1))  # the count is right then
    with pytest.raises(fs.NotConvergedError, match="modes 2 and 3 are not independent"):
        fs.normal_modes(membrane(size), count=8)


@pytest.mark.parametrize("path", SOLVERS)
@pytest.mark.parametrize("by", [1e-6, 1e-7])
def test_a_perturbed_frequency_has_a_residual(path: str, by: float, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name, size = SOLVERS[path]
    after(monkeypatch, module, name, moved(3, by))
    assert np.allclose(fs.normal_modes(membrane(size), count=8).eigenvalues, membrane_eigenvalues(size)[:8], rtol=1e-11)  # mended
    monkeypatch.setattr("femsub.modes.normal_modes.refined", lambda K, M, values, shapes, which, near: (values, shapes))
    with pytest.raises(fs.NotConvergedError, match="mode 4 has a relative residual"):
        fs.normal_modes(membrane(size), count=8)


@pytest.mark.parametrize("path", SOLVERS)
def test_reductions_notice_it_too(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name, size = SOLVERS[path]
    sub = membrane(size)
    after(monkeypatch, module, name, without(0))
    for method in (fs.CraigBampton(6), fs.CraigChang(6)):
        with pytest.raises(fs.MissedModesError):
            fs.reduce(sub, method)


# complex modes: LAPACK on the modal form, PEP

@pytest.mark.parametrize("by", [1e-6, 1e-8])
def test_a_perturbed_eigenvalue_of_a_dense_pencil_is_loud(by: float, monkeypatch: pytest.MonkeyPatch) -> None:
    exact = fs.complex_modes(fs.chain(10, belt=2), BELT)
    after(monkeypatch, dense, "solve", moved(6, by))
    with pytest.warns(fs.FemsubWarning, match="has a backward error of"):
        modes = fs.complex_modes(fs.chain(10, belt=2), BELT)
    error = np.abs(modes.eigenvalues - exact.eigenvalues)
    assert error.max() > 0.1 * by and (error <= 1.1 * modes.error_bar + 1e-14).all()  # the bar has grown with it


@pytest.mark.parametrize("by", [1e-4, 1e-8])
def test_a_perturbed_eigenvalue_of_a_sparse_pencil_is_in_its_error_bar(by: float, monkeypatch: pytest.MonkeyPatch) -> None:
    sub = fs.chain(300, belt=2)
    exact = fs.complex_modes(sub, BELT, count=12)
    after(monkeypatch, search, "right_pairs", moved(3, by))
    repaired = fs.complex_modes(sub, BELT, count=12)
    assert (np.abs(repaired.eigenvalues - exact.eigenvalues) <= repaired.error_bar + exact.error_bar).all()
    monkeypatch.setattr("femsub.modes.quadratic.bars.converged", lambda *_: None)  # without corrections, which mend it
    # A backward error is taken against the norm of K, of which low modes make up little: the error bar is what tells.
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        modes = fs.complex_modes(sub, BELT, count=12)
    assert bool(told) == (by == 1e-4)
    error = np.abs(modes.eigenvalues - exact.eigenvalues)
    assert error.max() > 1e-2 * by and (error <= 1.1 * modes.error_bar).all()
    assert modes.error_bar.max() > 100 * exact.error_bar.max()


def test_a_lost_eigenvalue_of_a_dense_pencil_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    twins = fs.Substructure(np.eye(8), np.kron(np.eye(2), fs.chain(4).K.toarray()), 0.1 * np.eye(8))
    assert len(fs.complex_modes(twins)) == 16
    after(monkeypatch, dense, "solve", without(1))
    with pytest.raises(fs.MissedModesError, match="15 eigenvalues"):
        fs.complex_modes(twins)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_lost_one_of_a_repeated_pair_is_noticed_by_the_independent_count(place: int,
                                                                           monkeypatch: pytest.MonkeyPatch) -> None:
    sub = membrane(16).with_damping(0.01 * membrane(16).K)
    exact = fs.complex_modes(sub, band=(0.0, 0.5))
    assert exact.evidence == "certified"
    after(monkeypatch, search, "right_pairs", without(place))
    after(monkeypatch, sparse, "quadratic_modes", without(place))
    # LAPACK finds what corrections have not
    again = fs.complex_modes(sub, band=(0.0, 0.5))
    assert again.evidence == "certified" and np.allclose(again.eigenvalues, exact.eigenvalues, rtol=1e-9)
    if place == 0:  # not one of a pair
        monkeypatch.setattr("femsub.modes.quadratic.search.QUADRATIC", 100)
        with pytest.raises(fs.MissedModesError, match=r"4 eigenvalues were found .* independent count gives 6"):
            fs.complex_modes(sub, band=(0.0, 0.5))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("ask", [{"band": (0.0, 0.5)}, {"count": 12}])
def test_a_ghost_does_not_make_up_for_a_missed_pair(ask: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    sub = membrane(16).with_damping(0.01 * membrane(16).K)
    exact = fs.complex_modes(sub, **ask)
    with monkeypatch.context() as planted:
        after(planted, search, "right_pairs", twice(1))
        after(planted, sparse, "quadratic_modes", twice(3))  # as many as there are, one of them twice and its neighbour lost
        modes = fs.complex_modes(sub, **ask)
        assert modes.evidence == "certified"  # by LAPACK, where no other count is possible
        assert np.allclose(modes.eigenvalues, exact.eigenvalues, rtol=1e-9)
    monkeypatch.setattr("femsub.modes.quadratic.search.QUADRATIC", 100)  # not for LAPACK
    after(monkeypatch, search, "right_pairs", twice(1))
    after(monkeypatch, sparse, "quadratic_modes", twice(3))
    with pytest.raises(fs.MissedModesError, match="independent count"):
        fs.complex_modes(fs.chain(200, damping=0.0).with_damping(0.01 * fs.chain(200).K), evidence=True,
                         **{key: value if key == "count" else (0.0, 0.1) for key, value in ask.items()})


# the border of stability

@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_perturbed_border_is_noticed(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    original = port_function.PortFunction.crossings

    def spoilt(self: object, lo: float, hi: float) -> tuple[np.ndarray, np.ndarray]:
        omega, c = original(self, lo, hi)
        return omega, np.where(np.arange(len(c)) == 0, factor * c, c)

    assert float(fs.critical_slope(fs.chain(10, belt=2))) == pytest.approx(-0.025567, abs=1e-6)
    monkeypatch.setattr(port_function.PortFunction, "crossings", spoilt)
    with pytest.raises(fs.NotConvergedError, match="is not the first one"):
        fs.critical_slope(fs.chain(10, belt=2))


def test_a_lost_border_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    original = port_function.PortFunction.crossings
    monkeypatch.setattr(port_function.PortFunction, "crossings",
                        lambda self, lo, hi: tuple(part[1:] for part in original(self, lo, hi)))
    with pytest.raises(fs.NotConvergedError, match="is not the first one"):
        fs.critical_slope(fs.chain(10, belt=2))


def test_a_border_of_a_sparse_model_that_does_not_hold_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    sub, dense = fs.chain(300, belt=2), growing_border.dense_border

    def spoilt(*arguments: object) -> object:
        found = dense(*arguments)
        return type(found)(1.01 * found.c, found.crossing, found.shapes, found.growth, found.method)

    monkeypatch.setattr(growing_border, "dense_border", spoilt)
    with pytest.raises(fs.NotConvergedError, match="does not hold on the full model"):
        fs.critical_slope(sub, band=(0.0, 0.1))


# the sign of the friction: a falling characteristic destabilises (the paper's Fig. 4), and the table of critical slopes

def sign_of_friction() -> None:
    """What must hold with the right sign, dense and sparse."""
    for sub, options in ((fs.chain(10, belt=2), {}), (fs.chain(300, belt=2), {"count": 12})):
        damped = sub.with_damping(0.001 * sub.K)
        assert fs.complex_modes(damped, BELT, **options).is_stable is False
        assert fs.complex_modes(damped, fs.Belt(slope=0.2677), **options).is_stable is True
    growth = fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", [-0.05, 0.05]).growth
    assert growth[0] > 0 > growth[1]
    assert float(fs.critical_slope(fs.chain(10, belt=2))) == pytest.approx(-0.025567, abs=1e-6)


def test_the_sign_of_the_friction() -> None:
    sign_of_friction()


def test_a_flipped_sign_in_the_contact_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    original = pencil.contact_matrix
    monkeypatch.setattr(pencil, "contact_matrix", lambda w, coefficient: original(w, -coefficient))
    with pytest.raises(AssertionError):
        sign_of_friction()


def test_a_flipped_sign_in_the_border_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    original = port_function.PortFunction.exact
    monkeypatch.setattr(port_function.PortFunction, "exact", lambda self, omega: tuple(-part for part in original(self, omega)))
    with pytest.raises((AssertionError, fs.FemsubError)):
        sign_of_friction()


def test_a_flipped_sign_is_noticed_between_border_and_full_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """The verification of a large model's border uses the contact as belts have it: it does not hold with another sign."""
    original = pencil.contact_matrix
    monkeypatch.setattr(growing_border, "contact_matrix", lambda w, coefficient: original(w, -coefficient))
    with pytest.raises(fs.NotConvergedError, match="does not hold on the full model"):
        fs.critical_slope(fs.chain(300, belt=2), band=(0.0, 0.1))
