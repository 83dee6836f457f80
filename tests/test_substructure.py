"""Construction: what is taken, what is refused, and that nothing changes afterwards."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.algebra import halves

M, K = np.diag([1.0, 2.0, 3.0]), np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])

COUPLED = np.array([[1.0, 0, 0], [0, 2, 2.6], [0, 2.6, 3]])  # 2.6² is more than 2 · 3


def changed(matrix: np.ndarray, at: tuple[int, int], value: float) -> np.ndarray:
    other = matrix.copy()
    other[at] = value
    return other


@pytest.mark.parametrize(("arguments", "words"), [
    ({"M": changed(M, (1, 1), -2.0)}, r"negative mass: M\[1, 1\] = -2"),
    ({"M": np.zeros((3, 3))}, "no mass at all"),
    ({"M": changed(M, (0, 2), 0.5)}, r"M is not symmetric: M\[0, 2\] = 0.5, but M\[2, 0\] = 0"),
    ({"M": COUPLED}, r"M is not positive semidefinite: M\[1, 2\] = 2\.6 is larger than sqrt\(M\[1, 1\] M\[2, 2\]\)"),
    ({"M": sp.csr_array(COUPLED), "K": sp.csr_array(K)}, r"M is not positive semidefinite: M\[1, 2\] = 2\.6 is larger"),
    ({"K": changed(K, (0, 2), 0.5)}, "K is not symmetric.*Pencil"),
    ({"K": changed(K, (2, 1), np.nan)}, "K holds a NaN or Inf, first at row 2, column 1"),
    ({"K": sp.csr_array(changed(K, (2, 1), np.inf))}, "K holds a NaN or Inf, first at row 2, column 1"),
    ({"D": changed(K, (0, 0), np.nan)}, "D holds a NaN"),
    ({"K": K[:2]}, r"K must be square, but its shape is \(2, 3\)"),
    ({"K": np.eye(4)}, "K is 4 x 4, but the other matrices are 3 x 3"),
    ({"M": np.zeros((0, 0)), "K": np.zeros((0, 0))}, "M is empty"),
    ({"K": K * 1j}, "K is complex"),
    ({"K": "stiff"}, "K must be a numeric array"),
    ({"interface": [0, 0]}, "interface DOF 0 is listed 2 times"),
    ({"interface": [3]}, "interface DOF 3 is out of range: the model has 3 DOF"),
    ({"interface": [-1]}, "interface DOF -1 is out of range"),
    ({"interface": [0.5]}, "interface must be a flat list of whole numbers"),
    ({"interface": 0}, "interface must be a list of whole numbers"),
    ({"ports": {"belt": np.ones(2)}}, r"port 'belt' has the shape \(2,\)"),
    ({"ports": {"belt": [1.0, np.nan, 0.0]}}, "port 'belt' holds a NaN or Inf, first at index 1"),
    ({"ports": {"belt": "m1"}}, "port 'belt' must be real numbers"),
    ({"ports": [1.0, 0, 0]}, "ports must be a dict of names and columns"),
])
def test_bad_input_is_named(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        fs.Substructure(**{"M": M, "K": K, **arguments})
    assert isinstance(caught.value, fs.FemsubError)
    assert "\n" not in str(caught.value)


def test_unknown_port_names_the_nearest() -> None:
    sub = fs.Substructure(M, K, ports={"belt": [1.0, 0, 0]})
    with pytest.raises(ValueError, match="unknown port 'bolt'; did you mean 'belt'"):
        sub.port("bolt")


def test_frozen_in_every_part() -> None:
    stiffness = sp.csr_array(K)
    sub = fs.Substructure(sp.csr_array(M), stiffness, interface=[2, 0], ports={"belt": np.array([1.0, 0, 0])})
    stiffness.data[:] = 7.0
    assert np.array_equal(sub.K.toarray(), K)
    with pytest.raises(dataclasses.FrozenInstanceError):
        sub.name = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        sub.K.data[0] = 1.0
    with pytest.raises(TypeError):
        sub.ports["belt"] = np.zeros(3)  # type: ignore[index]
    assert list(sub.interface) == [2, 0] and list(sub.interior) == [1]


def test_sparse_stays_sparse_and_dense_dense() -> None:
    assert fs.Substructure(sp.csr_array(M), sp.coo_matrix(K)).K.format == "csr"
    assert isinstance(fs.Substructure(M, K).K, np.ndarray)
    assert isinstance(fs.Substructure(M, K, sp.csr_array(K)).D, np.ndarray)


def test_rounding_in_symmetry_is_averaged_away() -> None:
    sub = fs.Substructure(M, changed(K, (0, 1), -1.0 + 1e-13))
    assert np.array_equal(sub.K, sub.K.T)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("stiff", [1e4, 1e9, 1e13, 1e18])
def test_flutter_is_not_averaged_away_beside_a_stiff_dof(stiff: float, sparse: bool) -> None:
    """What is small next to the largest entry may be all that two soft DOF have: λ² has two complex roots here."""
    flutter = np.array([[1000.0, 200, 0], [-600, 1010, 0], [0, 0, stiff]])
    growth = np.sqrt(-1005 + 1j * np.sqrt(4 * 120000 - 100) / 2).real
    assert fs.complex_modes(fs.Pencil(np.eye(3), None, flutter)).growth == pytest.approx(growth, rel=1e-9)
    for name, matrices in (("K", (np.eye(3), flutter)), ("M", (flutter + 1e3 * np.eye(3), np.eye(3)))):
        given = [sp.csr_array(part) if sparse else part for part in matrices]
        with pytest.raises(fs.InputError, match=rf"{name} is not symmetric.*{name}\[0, 1\] = 200.*difference of .* Pencil"):
            fs.Substructure(*given)


@pytest.mark.parametrize("kind", ["everywhere", "one triangle", "skew", "dense"])
def test_halves_add_up_and_store_no_zeros(kind: str, rng: np.random.Generator) -> None:
    A = sp.csr_array(sp.random_array((40, 40), density=0.1, rng=rng) + sp.eye_array(40))
    A = {"everywhere": A + 0.5 * A.T, "one triangle": sp.triu(A), "skew": A - A.T, "dense": A.toarray()}[kind]
    A = A if kind == "dense" else sp.csr_array(A)
    even, odd = halves(A)
    for found, exact in ((even, (A + A.T) / 2), (odd, (A - A.T) / 2)):
        assert sp.issparse(found) == sp.issparse(A) and abs(found - exact).max() == 0
        assert not sp.issparse(found) or (found.nnz == np.count_nonzero(exact.toarray()) and found.has_canonical_format)


def test_indices_are_short_where_they_may_be() -> None:
    """A sum of matrices has long ones, twice the memory of each matrix that is made from it."""
    K = fs.chain(20).K
    long = sp.csr_array((K.data, K.indices.astype(np.int64), K.indptr.astype(np.int64)), shape=K.shape)
    pencil = fs.Pencil(sp.eye_array(20), None, long)
    assert long.indices.dtype == np.int64 and pencil.K.indices.dtype == pencil.K.indptr.dtype == np.int32
    assert abs(pencil.K - K).max() == 0


def test_flutter_in_a_file(tmp_path: Path) -> None:
    from scipy.io import mmwrite

    flutter = np.array([[1000.0, 200, 0], [-600, 1010, 0], [0, 0, 1e13]])
    for name, part in (("M", np.eye(3)), ("K", flutter)):
        mmwrite(tmp_path / f"{name}.mtx", sp.coo_array(part), precision=17)
    with pytest.raises(fs.InputError, match=r"K is not symmetric.*a difference of 8.0e-01 of sqrt.*Pencil.*K.mtx"):
        fs.read_component(tmp_path / "M.mtx", tmp_path / "K.mtx")


def test_no_unit_of_a_dof_changes_what_is_symmetric() -> None:
    S = np.diag([2.0**-17, 1.0, 2.0**17])
    for at, value in (((0, 1), 3e-9), ((0, 1), 1e-14), ((1, 2), -1e-14), ((2, 1), 1e-8)):
        for unit in (np.eye(3), S):
            wrong = unit @ changed(K, at, K[at] + value) @ unit
            if abs(value) > 1e-9:
                with pytest.raises(fs.InputError, match="K is not symmetric"):
                    fs.Substructure(M, wrong)
            else:
                assert np.array_equal(fs.Substructure(M, wrong).K, fs.Substructure(M, wrong).K.T)


def test_more_than_an_assembly_rounds_off_is_told() -> None:
    with pytest.warns(fs.FemsubWarning, match=r"K\[0, 1\] = -1, but .*a difference of 5.0e-12 of .* averaged out") as caught:
        fs.Substructure(M, changed(K, (0, 1), -1.0 + 1e-11))
    assert caught[0].filename == __file__


def test_a_difference_where_there_is_no_stiffness() -> None:
    none = np.diag([1.0, 0.0, 0.0])
    with pytest.raises(fs.InputError, match=r"although K\[1, 1\] K\[2, 2\] = 0"):
        fs.Substructure(M, changed(none, (1, 2), 1e-20))



def test_repr_is_one_line_that_tells_the_state() -> None:
    sub = fs.chain(10, belt=2)
    assert repr(sub) == "Substructure 'chain': 10 DOF, sparse, 28 nonzeros in K, 1 interface DOF, ports belt"
    assert repr(fs.Pencil(M, None, changed(K, (0, 2), 0.5))) == "Pencil: 3 DOF, dense, K unsymmetric"


def test_pencil_residual_and_backward_error(rng: np.random.Generator) -> None:
    D = rng.standard_normal((3, 3))
    pencil = fs.Pencil(M, D, K)
    lam, x = np.array([0.3 + 2j]), rng.standard_normal((3, 1)) + 1j
    expected = lam**2 * (M @ x) + lam * (D @ x) + K @ x
    assert np.allclose(pencil.residual(lam, x), expected, rtol=1e-14)
    eta = pencil.backward_error(lam, x)
    assert np.allclose(pencil.backward_error(lam, 1e6 * x), eta, rtol=1e-12)
    assert np.allclose(fs.Pencil(1e-9 * M, 1e-9 * D, 1e-9 * K).backward_error(lam, x), eta, rtol=1e-12)


@pytest.mark.parametrize(("arguments", "words"), [
    ({"n": 0}, "n must be at least 1"), ({"n": 2.5}, "n must be a whole number"),
    ({"belt": 11}, "at least 1 and at most 10, but is 11"), ({"belt": 0}, "masses count from 1"),
    ({"masses": 0.0}, "masses must be positive"), ({"masses": [1.0] * 9 + [-1.0]}, "is -1 in mass 10"),
    ({"masses": [1.0] * 3}, "one number or 10"), ({"springs": np.nan}, "springs must be positive and finite"),
    ({"damping": -0.1}, "damping must not be negative"), ({"interface": [1, 1]}, "listed 2 times"),
])
def test_chain_refuses(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        fs.chain(**{"n": 10, **arguments})


def test_read_only_matrices_of_a_model_are_shared() -> None:
    sub = fs.chain(50)
    again = fs.Substructure(sub.M, sub.K, sub.D)
    assert all(np.shares_memory(getattr(sub, key).data, getattr(again, key).data) for key in "MKD")
    own = sub.K.copy()
    assert not np.shares_memory(fs.Substructure(sub.M, own).K.data, own.data)


N = 6


def backed(kind: str, folder: Path) -> tuple[Any, list[np.ndarray]]:
    """A stiffness matrix that says of itself that it is read-only, and arrays through which it can be written to all the same."""
    K: Any = sp.csr_array(sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(N, N)))
    if kind.startswith("dense"):
        whole = np.memmap(folder / "K", float, "w+", shape=(N + 1, N)) if "memmap" in kind else np.zeros((N + 1, N))
        whole[1:] = K.toarray()
        view = whole[1:].T if "transposed" in kind else whole[1:]
        view.flags.writeable = False
        return view, [whole]
    parts: dict[str, np.ndarray] = {name: getattr(K, name) for name in ("data", "indices", "indptr")}
    writable = []
    for name, part in parts.items():
        if kind == "view of a bigger buffer":
            whole = np.append(part, 0)
            parts[name] = whole[:-1]
        elif kind == "slices":
            whole = np.repeat(part, 2)
            parts[name] = whole[::2]
        elif kind == "memmap":
            whole = np.memmap(folder / name, part.dtype, "w+", shape=part.shape)
            whole[:] = part
            parts[name] = np.memmap(folder / name, part.dtype, "r", shape=part.shape)
        elif kind == "view made before":
            whole = part[:]
        elif kind in ("shared by two", "csc"):  # frozen by a model of the same arrays, not by their owner
            whole = part
        else:
            assert kind == "writable indices"
            whole = part if name != "data" else np.zeros(0)
        writable.append(whole)
    made = sp.csr_array((N, N))
    made.data, made.indices, made.indptr = parts.values()
    if kind not in ("shared by two", "csc"):
        for part in [made.data] if kind == "writable indices" else parts.values():
            part.flags.writeable = False
    assert made.has_canonical_format
    return (made.T if kind == "csc" else made), writable


@pytest.mark.parametrize("kind", ["view of a bigger buffer", "slices", "memmap", "view made before", "shared by two", "csc",
                                  "writable indices", "dense", "dense transposed", "dense memmap"])
def test_a_matrix_that_its_owner_changes_later_leaves_the_model_alone(kind: str, tmp_path: Path) -> None:
    K, writable = backed(kind, tmp_path)
    M = sp.eye_array(N, format="csr")
    models = [fs.Pencil(M, K, K), fs.Substructure(M, K, K), fs.Affine(M, None, [("p", K)]).at(p=1.0),
              fs.Pencil(M, None, M).damped_by(K), fs.Substructure(M, M).with_damping(K)]
    places = [(model, "K") for model in models[:3]] + [(model, "D") for model in (*models[:2], *models[3:])]
    first = fs.complex_modes(models[1].with_damping(None)).eigenvalues
    before = [sp.csr_array(getattr(*place)).toarray() for place in places]
    assert all(np.array_equal(one, before[0]) for one in before) and before[0][0, 0] == 2
    for array in writable:
        array[:] = array[::-1].copy() * 2 if array.dtype == float else 0
    for place, one in zip(places, before, strict=True):
        assert np.array_equal(sp.csr_array(getattr(*place)).toarray(), one)
    again = fs.complex_modes(models[1].with_damping(None))
    assert np.array_equal(again.eigenvalues, first) and again.evidence == "certified"


@pytest.mark.parametrize("copy", [lambda sub: sub, deepcopy, lambda sub: pickle.loads(pickle.dumps(sub))])
def test_no_array_of_a_model_can_be_written_to(copy: Callable[[fs.Substructure], fs.Substructure]) -> None:
    skew = sp.csr_array(([1e-15], ([0], [1])), shape=(4, 4))  # rounding of an assembly, averaged out
    for sub in (fs.chain(4), fs.Substructure(sp.eye_array(4), fs.chain(4).K + skew)):
        made = copy(sub)
        for matrix in (made.M, made.D, made.K, made.pencil.K0):
            for part in ("data", "indices", "indptr"):
                with pytest.raises(ValueError, match="read-only"):
                    getattr(matrix, part)[:1] = 0
        shared = fs.Pencil(made.M, made.D, made.K)
        assert all(np.shares_memory(getattr(shared, key).indices, getattr(made, key).indices) for key in "MDK" if made.D.nnz)


def test_a_contact_of_a_pencil_keeps_its_columns() -> None:
    W, C = np.eye(3)[:, :1], np.array([[0.5]])
    pencil = fs.Pencil(np.eye(3), None, np.eye(3)).with_contact(C, W)
    W[:], C[:] = 7, 7
    damping, _, columns = pencil.contacts[0]
    assert np.array_equal(columns @ damping @ columns.T, pencil.D)


@pytest.mark.parametrize("sparse", [True, False])
@pytest.mark.parametrize("skew", [0.0, 1e-15, 0.3])
def test_several_contacts_are_summed_before_the_check(sparse: bool, skew: float) -> None:
    """D and K with all contacts; a skew part within rounding is averaged out, a larger one stays."""
    K = fs.chain(6).K
    ports = {"a": np.eye(6)[1], "b": np.eye(6)[4], "surface": np.eye(6)[:, 1:4]}
    sub = fs.Substructure(*(A if sparse else A.toarray() for A in (sp.eye_array(6), K, 0.1 * K)), ports=ports)
    C = np.array([[2.0, 0.5 + skew], [0.5, 1.0]])
    S = sp.csr_array(np.diag([1.0, 2.0, 3.0]))
    several = [fs.LinearContact(("a", "b"), stiffness=C, damping=0.1 * C), Surface(S), fs.LinearContact(("b",), damping=[[0.2]])]
    pencil = sub.linearised(several)
    W = np.column_stack([ports["a"], ports["b"]])
    first, second = W @ C @ W.T, ports["surface"] @ S @ ports["surface"].T
    dense = [A.toarray() if sparse else A for A in (pencil.D, pencil.K)]
    b = np.outer(ports["b"], ports["b"])
    for A, wanted in zip(dense, (0.1 * K.toarray() + 0.1 * first + 0.2 * b, K.toarray() + first + second), strict=True):
        assert np.allclose(A, wanted, rtol=0, atol=1e-14)
        assert np.array_equal(A, A.T) == (skew < 0.1)
    assert pencil.symmetric == (True, skew < 0.1, skew < 0.1)
    K0 = pencil.K0.toarray() if sparse else pencil.K0
    assert np.allclose(K0, K.toarray() + second, rtol=0, atol=1e-14)  # a surface is part of it
    assert [np.shape(own) for *_, own in pencil.contacts] == [(6, 2), (6, 1)]


@dataclasses.dataclass(frozen=True)
class Surface:
    """A contact of a sparse matrix, as those of surfaces."""

    C: sp.csr_array
    ports: tuple[str, ...] = ("surface",)

    def linearised(self, model: fs.Substructure) -> tuple[None, sp.csr_array]:
        return None, self.C


@pytest.mark.parametrize(("changes", "words"), [
    ({"V": None}, "V must be real numbers, not None"), ({"V": np.eye(4)}, r"V must have a row per DOF .* \(4, 4\)"),
    ({"V": np.ones(3)}, r"V must have a row per DOF"), ({"full_interface": [3]}, "interface DOF 3 is out of range"),
    ({"full_interface": None}, "interface must be a list of whole numbers")])
def test_a_reduced_model_of_ones_own_needs_a_basis_that_fits(changes: dict, words: str) -> None:
    given = {"V": np.eye(3), "kinds": ["free"] * 3, "full_interface": [0], "cutoff": 1.0, "method": "mine"}
    assert fs.ReducedSubstructure(M, K, None, {}, "part", **given).interface.tolist() == [0]
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        fs.ReducedSubstructure(M, K, None, {}, "part", **(given | changes))


@pytest.mark.parametrize("kind", ["chain", "free chain", "beam", "free beam", "solid", "free solid", "quadratic solid",
                                  "9 digits", "large free solid"])
def test_m_and_k_in_each_others_place_are_told(kind: str) -> None:
    steel = fs.Material(2.1e11, 0.3, 7850.0)
    if kind.endswith("chain"):
        full = fs.chain(8, fixed=kind == "chain")
    elif kind.endswith("beam"):
        full = fs.beam(1.0, 10, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"} if kind == "beam" else {})
    else:
        cells = (20, 4, 4) if "large" in kind else (5, 2, 2)  # of large ones some rows are looked at before all are
        mesh = fs.block((1.0, 0.2, 0.1), cells, "hexahedron20" if "quadratic" in kind else "hexahedron")
        full = fs.solid(mesh, steel, supports=["left"] if kind == "solid" else [])
    K = full.K.copy()
    if "digits" in kind:
        K.data = np.array([float(f"{value:.8e}") for value in K.data])
    with pytest.warns(fs.FemsubWarning, match="M and K of 'part' seem to be in each other's place"):
        fs.Substructure(K, full.M)
    fs.Substructure(full.M, K)  # a warning would be an error


def test_two_masses_that_move_against_each_other_are_a_mass_matrix() -> None:
    M = np.kron(np.eye(3), [[1.0, -1.0], [-1.0, 1.0]]) + np.eye(6)
    assert fs.Substructure(M, fs.chain(6).K.toarray()).size == 6


LAW = fs.Belt(law=fs.StribeckArctan(), speed=1.0)
ANALYSES: dict[str, Callable[[fs.Substructure], Any]] = {
    "normal modes": lambda part: fs.normal_modes(part, count=2), "band": lambda part: fs.normal_modes(part, band=(0.0, 1.0)),
    "complex modes": lambda part: fs.complex_modes(part, count=4),
    "Craig-Bampton": lambda part: fs.reduce(part, fs.CraigBampton(2)),
    "Craig-Chang": lambda part: fs.reduce(part, fs.CraigChang(2)), "Guyan": lambda part: fs.reduce(part, fs.Guyan()),
    "response": lambda part: fs.frequency_response(part, at=[1.0]), "transient": lambda part: fs.transient(part, LAW, (0.0, 1.0)),
    "balance": lambda part: fs.harmonic_balance(part, LAW), "slope": lambda part: fs.critical_slope(part),
    "couple": lambda part: fs.couple({"part": part, "b": fs.chain(2, interface=[1])}, [fs.Rigid(("part", [0]), ("b", [0]))])}


def with_empty_dofs(dofs: fs.DofMap | None, D: Any = None) -> fs.Substructure:
    """Three masses on springs, and four DOF between them that no element acts on."""
    K = np.zeros((7, 7))
    K[np.ix_([0, 2, 5], [0, 2, 5])] = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    return fs.Substructure(np.diag([1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]), K, D, [0], {"belt": np.eye(7)[5]}, dofs=dofs)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("name", list(ANALYSES))
def test_each_analysis_refuses_empty_dofs_in_the_same_words(name: str, sparse: bool) -> None:
    part = with_empty_dofs(fs.DofMap([1, 1, 2, 2, 3, 3, 4], [0, 3, 0, 3, 3, 0, 3], ("ux", "uy", "uz", "rx")))
    if sparse:
        part = fs.Substructure(*map(sp.csr_array, (part.M, part.K)), interface=[0], ports=part.ports, dofs=part.dofs)
    with pytest.raises(fs.SingularMatrixError, match=r"^'part': 4 DOF have neither mass nor stiffness: rx at node 1, rx at node 2"
                       r", rx at node 3 and 1 more\. Leave them out: read_component\(\.\.\., drop_empty=True\)"):
        ANALYSES[name](part)


def test_an_empty_dof_is_what_nothing_acts_on() -> None:
    """A dashpot gives it a real λ, a joint what its partner has; a pencil names it by its number."""
    d = np.array([[1.0, -1.0, 0, 0, 0, 0, 0], [0, 0, 0, 1.0, -1.0, 1.0, -1.0]])
    part = with_empty_dofs(None, d.T @ np.diag([0.1, 0.1]) @ d + np.diag([0, 0, 0, 0.1, 0.2, 0, 0.3]))
    assert len(fs.complex_modes(part)) > 6
    assert np.isfinite(fs.frequency_response(part, at=[1.0]).receptance).all()
    with pytest.raises(fs.SingularMatrixError, match="4 DOF have neither mass nor stiffness: DOF 1, DOF 3, DOF 4 and 1 more"):
        fs.normal_modes(part, count=1)
    two = fs.Substructure([[1.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]], interface=[0, 1])
    with pytest.raises(fs.SingularMatrixError, match="1 DOF has neither mass nor stiffness: DOF 1"):
        fs.complex_modes(two.pencil)
    chain = fs.chain(3, interface=[1], damping=0.0)
    for part in (two, fs.reduce(two, fs.Guyan())):
        joined = fs.couple({"a": part, "b": chain}, [fs.Rigid(("a", [1]), ("b", [0]))])
        assert fs.normal_modes(joined, count=4).frequencies == pytest.approx(
            np.sort([1.0, *fs.normal_modes(chain, count=3).frequencies]))
        left = fs.couple({"a": part, "b": chain}, [fs.Rigid(("a", [0]), ("b", [0]))])
        with pytest.raises(fs.SingularMatrixError, match=r"'system': 1 DOF has neither mass nor stiffness: a: (DOF|coord)"):
            fs.normal_modes(left, count=1)
