"""Every reduction method: exact with all modes, what each is to the others, bounds, damping, ports, units, clear errors."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from joinedparts import JOINED, LARGER, Joined

import femsub as fs
from benchmarks.lattices import lattice
from femsub.reduction.reduce import METHODS

PARTS: dict[str, Callable[[], fs.Substructure]] = {
    "held chain": lambda: fs.chain(14, belt=4, interface=(1, 14), damping=0.1),
    "floating chain": lambda: fs.chain(14, belt=4, interface=(14, 1), fixed=False),
    "one DOF holds it": lambda: fs.chain(14, belt=4, interface=(3,), fixed=False),
    "held lattice": lambda: lattice(4, 5, held=True),
    "floating lattice": lambda: lattice(4, 5),
    "massless interface": lambda: massless(),
    "large floating lattice": lambda: lattice(14, 11),
}
SMALL = [name for name in PARTS if "large" not in name]
KEYS = sorted(METHODS)
FREE = ["craig-chang", "rubin", "dual-craig-bampton"]  # of one span
RITZ = [key for key in KEYS if key not in ("guyan", "macneal")]  # by themselves, Dual Craig-Bampton too
PHYSICAL = ["craig-bampton", "guyan", "herting", "macneal", "rubin"]


def massless() -> fs.Substructure:
    """A floating lattice whose interface DOF have no mass."""
    sub = lattice(4, 5, seed=3)
    mass = sub.M.diagonal()
    mass[sub.interface] = 0.0
    return fs.Substructure(sp.diags_array(mass), sub.K, interface=sub.interface, ports=sub.ports, name="massless")


def reduced(sub: fs.Substructure, key: str, modes: int, **options: object) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(sub, METHODS[key](modes), **options)


def spectrum(model: fs.Substructure) -> np.ndarray:
    """All finite ω, those of rigid-body modes as 0."""
    mass = model.M.toarray() if sp.issparse(model.M) else model.M
    unit = np.sqrt(np.where(mass.diagonal() > 0, mass.diagonal(), 1.0))
    rank = np.linalg.matrix_rank(mass / np.outer(unit, unit), tol=1e-10, hermitian=True)
    rigid = fs.normal_modes(model, count=0).rigid
    return np.asarray(fs.normal_modes(model, count=int(rank) - rigid).frequencies)


@cache
def unreduced(name: str) -> tuple[Joined, np.ndarray]:
    """Joined parts and the spectrum of their full system, which all methods are compared with."""
    joined = JOINED[name]()
    return joined, spectrum(joined.system())


def whole(sub: fs.Substructure, key: str) -> int:
    """All modes of the kind that a method keeps."""
    finite = np.count_nonzero(sub.M.diagonal())
    if METHODS[key].held and key != "herting":
        return int(np.count_nonzero(sub.M.diagonal()[sub.interior]))
    return int(finite - fs.normal_modes(sub, count=0).rigid)


def angle(one: np.ndarray, other: np.ndarray, M: object) -> float:
    """The largest angle between two spans of equal dimension, in the metric of M, which is diagonal."""
    weight = np.sqrt(np.where(M.diagonal() > 0, M.diagonal(), M.diagonal().max()))[:, None]
    first, second = (la.orth(weight * x / np.linalg.norm(weight * x, axis=0), rcond=1e-10) for x in (one, other))
    assert first.shape == second.shape
    return float(np.linalg.norm(second - first @ (first.T @ second), 2))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", SMALL)
def test_all_modes_give_the_full_spectrum(name: str, key: str) -> None:
    sub = PARTS[name]()
    rom, full = reduced(sub, key, whole(sub, key)), spectrum(sub)
    found = spectrum(rom)
    rigid = np.count_nonzero(full == 0)
    assert len(found) == len(full) and np.count_nonzero(found == 0) == rigid
    assert np.abs(found[rigid:] / full[rigid:] - 1).max() < 1e-9
    if key in (*FREE, "macneal", "herting") and name != "massless interface":
        assert rom.dropped >= len(sub.interface) and rom.size == sub.size and np.isinf(rom.cutoff)


def test_guyan_is_exact_with_the_interface_at_all_dof_and_craig_bampton_without_modes_else() -> None:
    sub = fs.chain(14, belt=4, interface=tuple(range(1, 15)), damping=0.1)
    assert np.allclose(spectrum(fs.reduce(sub, fs.Guyan())), spectrum(sub), rtol=1e-12)
    for name in PARTS:
        if name != "one DOF holds it":
            sub = PARTS[name]()
            one, other = (reduced(sub, key, 0) for key in ("guyan", "craig-bampton"))
            assert all(np.array_equal(getattr(one, key), getattr(other, key)) for key in ("V", "M", "D", "K"))
            assert one.method == "Guyan" and one.cutoff == other.cutoff
    assert fs.Guyan() == fs.Guyan(modes=0) and str(fs.Guyan()) == "Guyan"


@pytest.mark.parametrize("name", PARTS)
def test_guyan_takes_further_masters_in_place_of_modes(name: str) -> None:
    sub = PARTS[name]()
    full = fs.normal_modes(sub, count=4)
    errors = []
    for masters in (6, 12):
        rom = reduced(sub, "guyan", masters)
        n_b = len(sub.interface)
        assert rom.size == n_b + masters and rom.modes == 0
        assert rom.method == str(fs.Guyan(masters)) == f"Guyan with {masters} further masters"
        rows = [int(np.flatnonzero(np.all(unit == rom.V, axis=1))[0]) for unit in np.eye(rom.size)]  # all are DOF
        assert np.array_equal(rows[:n_b], sub.interface) and np.array_equal(rom.interface, np.arange(n_b))
        statics = sub.K @ rom.V  # no force on any other
        assert np.abs(np.delete(statics, rows, axis=0)).max(initial=0.0) < 1e-9
        elastic = slice(full.rigid, None)
        errors.append(float((fs.normal_modes(rom, count=4).frequencies[elastic] / full.frequencies[elastic] - 1).max()))
    assert -1e-9 < errors[1] < errors[0]
    bare = fs.Substructure(sub.M, sub.K, ports=sub.ports)  # and they can hold what has no interface
    assert fs.normal_modes(reduced(bare, "guyan", 12), count=1).rigid == full.rigid


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("modes", [0, 4])
def test_methods_of_one_span(name: str, modes: int) -> None:
    sub = PARTS[name]()
    free = [reduced(sub, key, modes) for key in FREE]
    assert all(angle(rom.V, free[0].V, sub.M) < 1e-9 for rom in free[1:])
    hcb, hurty, herting = (reduced(sub, key, modes) for key in ("craig-bampton", "hurty", "herting"))
    assert angle(hcb.V, hurty.V, sub.M) < 1e-9
    assert angle(free[0].V, herting.V, sub.M) < 1e-9


@pytest.mark.sampled(5)
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", PARTS)
def test_matrices_are_projections_and_the_interface_can_be_read(name: str, key: str) -> None:
    sub = PARTS[name]()
    rom = reduced(sub, key, 4)
    for letter in "DK" if key == "macneal" else "MDK":
        exact = rom.V.T @ (getattr(sub, letter) @ rom.V)
        assert np.abs(getattr(rom, letter) - exact).max() <= 1e-9 * max(1.0, np.abs(exact).max())
    q = np.random.default_rng(1).standard_normal(rom.size)
    assert np.allclose(rom.interface_rows @ q, rom.expand(q)[sub.interface], rtol=0, atol=1e-9 * np.abs(rom.V).max())
    if key in PHYSICAL:
        n_b = len(sub.interface)
        assert np.array_equal(rom.interface, np.arange(n_b)) and np.array_equal(rom.V[sub.interface], np.eye(n_b, rom.size))
    assert len(rom.kinds) == rom.size == rom.V.shape[1] and METHODS[key].label in rom.method
    assert fs.normal_modes(rom, count=0).rigid == fs.normal_modes(sub, count=0).rigid


@pytest.mark.sampled(5)
@pytest.mark.parametrize("key", RITZ)
@pytest.mark.parametrize("name", ["held chain", "floating chain", "floating lattice", "large floating lattice"])
def test_ritz_values_bound_from_above_and_never_rise(name: str, key: str) -> None:
    sub = PARTS[name]()
    full = fs.normal_modes(sub, count=min(30, whole(sub, "craig-chang")))
    before = np.full(len(full.eigenvalues), np.inf)
    for modes in (0, 1, 2, 4, 5):
        rom = reduced(sub, key, modes)
        values = np.linalg.eigvalsh(la.solve(la.cholesky(rom.M, lower=True), la.solve(la.cholesky(rom.M, lower=True), rom.K).T))
        values, noise = values[:30], 1e-10 * full.eigenvalues[-1]
        assert (values >= full.eigenvalues[:len(values)] - noise).all()
        assert (values <= before[:len(values)] + noise).all()
        before = np.append(values, np.full(len(full.eigenvalues), np.inf))


@pytest.mark.parametrize("key", ["craig-chang", "dual-craig-bampton"])
@pytest.mark.parametrize("name", PARTS)
def test_residual_shapes_are_orthogonal_to_kept_modes(name: str, key: str) -> None:
    sub = PARTS[name]()
    rom = reduced(sub, key, 3)
    kept = np.array([kind in ("rigid", "free") for kind in rom.kinds])
    residual = rom.V[:, ~kept]
    for A in (sub.M, sub.K):
        size = np.sqrt(np.abs(np.einsum("ij,ij->j", residual, A @ residual)))
        scale = np.sqrt(np.maximum(np.einsum("ij,ij->j", rom.V[:, kept], A @ rom.V[:, kept]), 1e-3))
        assert np.abs(rom.V[:, kept].T @ (A @ residual)).max() < 1e-8 * max(1e-3, float(np.max(np.outer(scale, size))))


@pytest.mark.parametrize("key", ["craig-chang", "rubin", "dual-craig-bampton"])
def test_a_load_that_inertia_balances_leaves_no_residual(key: str) -> None:
    """A loose mass beside two masses on a spring: the force on it moves the part rigidly, and what else it does is rounding."""
    for loose, one, other, k in np.random.default_rng(4).uniform(0.3, 3.0, (20, 4)):
        sub = fs.Substructure(np.diag([loose, one, other]), [[0, 0, 0], [0, k, -k], [0, -k, k]], interface=[1, 0])
        rom = reduced(sub, key, 0)
        np.testing.assert_allclose(rom.K, rom.V.T @ sub.K @ rom.V, atol=1e-9 * k)
        if key != "dual-craig-bampton":
            np.testing.assert_allclose(spectrum(rom), [0, 0, np.sqrt(k * (1 / one + 1 / other))], rtol=1e-9)


@pytest.mark.parametrize("modes", [0, 2])
@pytest.mark.parametrize("sub", [
    fs.chain(9, interface=range(1, 10), fixed=False), fs.chain(9, interface=(1, 2, 5, 6, 7, 8, 9)),
    fs.beam(1.0, 4, E=2e11, I=1e-8, rho=7850.0, A=1e-4, interface=[0.0, 0.25, 0.5, 0.75, 1.0])],
    ids=["free chain", "held chain", "free beam"])
def test_dual_craig_bampton_has_forces_that_do_not_depend_on_each_other(sub: fs.Substructure, modes: int) -> None:
    """More forces than residual responses: with one coordinate each, M and K would be singular together."""
    rom = fs.reduce(sub, fs.DualCraigBampton(modes))
    rigid = fs.normal_modes(sub, count=0).rigid
    assert rom.kinds.count("interface force") == len(sub.interface) - rom.dropped == rom.size - rigid - modes
    found, exact = (fs.normal_modes(one, count=rom.size - rigid) for one in (rom, fs.reduce(sub, fs.CraigChang(modes))))
    assert found.rigid == exact.rigid and found.evidence == "certified"
    np.testing.assert_allclose(found.frequencies, exact.frequencies, rtol=1e-9)
    other = fs.chain(3, interface=[3])
    joints = [fs.Rigid(("part", [4]), ("other", [2]))]
    weak, full = (fs.normal_modes(fs.couple({"part": one, "other": other}, joints), count=3) for one in (rom, sub))
    assert weak.rigid == full.rigid
    np.testing.assert_allclose(weak.frequencies, full.frequencies, rtol=1e-3 if rom.size == sub.size else 0.1)


def test_rubin_and_macneal_have_the_blocks_of_their_papers() -> None:
    sub = lattice(4, 5)
    dual, rubin, macneal = (reduced(sub, key, 4) for key in ("dual-craig-bampton", "rubin", "macneal"))
    b, m = sub.interface, 3 + 4
    Phi, Psi = dual.V[:, :m], dual.V[:, m:]
    G, H = Psi[b], Psi.T @ (sub.M @ Psi)
    free, forces = fs.normal_modes(sub, count=4), np.eye(sub.size)[:, b]
    assert np.allclose(dual.K[m:, m:], G, rtol=1e-9) and np.allclose(dual.M[m:, m:], H, rtol=1e-9)
    assert np.array_equal(dual.K[:m, :m], np.diag(np.append(np.zeros(3), dual.K.diagonal()[3:m])))
    assert dual.kinds[m:] == ("interface force",) * len(b)
    response = np.linalg.pinv(sub.K.toarray(), rcond=1e-12, hermitian=True)  # independent of the package's own solves
    P = np.eye(sub.size) - sub.M @ (free.shapes @ free.shapes.T)
    assert np.allclose(Psi, P.T @ response @ P @ forces, atol=1e-9 * np.abs(Psi).max())
    inverse = np.linalg.inv(G)
    coupling = -inverse @ Phi[b]
    K = np.block([[inverse, coupling], [coupling.T, np.diag(dual.K.diagonal()[:m]) + Phi[b].T @ inverse @ Phi[b]]])
    T = np.vstack([np.hstack([inverse, coupling])])
    assert np.allclose(rubin.K, K, atol=1e-9 * np.abs(K).max()) and np.allclose(macneal.K, K, atol=1e-9 * np.abs(K).max())
    M = T.T @ H @ T + np.diag(np.append(np.zeros(len(b)), np.ones(m)))
    assert np.allclose(rubin.M, M, atol=1e-9 * np.abs(M).max())
    assert np.array_equal(macneal.M, np.diag(np.append(np.zeros(len(b)), np.ones(m))))


def test_hurty_splits_the_constraint_modes() -> None:
    chains = fs.chain(9, interface=(1, 5, 9), fixed=False), fs.chain(9, interface=(1, 9))
    for sub, rigid in ((lattice(4, 5), 3), (chains[0], 1), (chains[1], 0)):
        rom = reduced(sub, "hurty", 2)
        n_b = len(sub.interface)
        assert rom.kinds == ("rigid",) * rigid + ("constraint",) * (n_b - rigid) + ("fixed-interface",) * 2
        assert not rom.K[:rigid].any() and np.abs(sub.K @ rom.V[:, :rigid]).max(initial=0.0) < 1e-12
        B = rom.V[sub.interface]
        holding = np.flatnonzero(~B[:, rigid:].any(axis=1))  # redundant constraint modes leave them at rest
        redundant = np.setdiff1d(np.arange(n_b), holding)
        assert np.allclose(B[holding][:, :rigid] @ B[holding][:, :rigid].T, np.eye(rigid))
        assert np.array_equal(B[redundant, rigid:n_b], np.eye(n_b - rigid))


@pytest.mark.parametrize("key", KEYS)
def test_damped_models_have_the_full_ones_complex_modes_with_all_modes(key: str) -> None:
    sub = fs.chain(10, belt=3, interface=(1, 10), damping=0.1)
    belt = fs.Belt(port="belt", slope=-0.002)
    rom = reduced(sub, key, whole(sub, key))
    full, found = (np.sort_complex(fs.complex_modes(model, belt).eigenvalues) for model in (sub, rom))
    assert np.abs(found - full).max() < 1e-9


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", ["held chain", "floating lattice"])
def test_port_columns_join(name: str, key: str) -> None:
    sub = PARTS[name]()
    modes = 0 if key == "guyan" else 3  # a master may be the port
    plain, rom = reduced(sub, key, modes), reduced(sub, key, modes, ports=True)
    assert rom.size == plain.size + 1 and plain.port_error["belt"] > 1e-3 and rom.port_error["belt"] < 1e-7
    rigid = fs.normal_modes(sub, count=0).shapes
    w = sub.ports["belt"]
    w = w - sub.M @ (rigid @ (rigid.T @ w))
    if not rigid.shape[1] or key in (*FREE, "macneal", "herting"):  # the statics of self-equilibrated loads
        answer = rom.V @ np.linalg.lstsq(rom.K, rom.V.T @ w, rcond=1e-12)[0]
        assert np.abs(sub.K @ answer - w).max() < 1e-8


@pytest.mark.parametrize("key", KEYS)
def test_a_port_at_the_interface_adds_nothing(key: str) -> None:
    sub = fs.chain(14, belt=1, interface=(1, 14), fixed=False)
    plain, rom = reduced(sub, key, 3), reduced(sub, key, 3, ports=True)
    assert rom.size == plain.size and rom.dropped == plain.dropped + 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", ["held chain", "floating lattice", "massless interface"])
def test_units_and_numbering_change_nothing(name: str, key: str) -> None:
    sub = PARTS[name]()
    order = np.random.default_rng(5).permutation(sub.size)
    place = np.argsort(order)
    factor = 1e-3  # SI to mm, t, s: K in N/mm, M in t
    M, K, D = (A[order][:, order] * factor for A in (sub.M, sub.K, sub.D))
    other = fs.Substructure(M, K, D, interface=place[sub.interface], ports={"belt": sub.ports["belt"][order]})
    modes = 0 if key == "guyan" else 4  # masters may tie
    one, two = spectrum(reduced(sub, key, modes)), spectrum(reduced(other, key, modes))
    assert np.allclose(one, two, rtol=1e-9, atol=0) and len(one) == len(two)


def test_tolerances() -> None:
    sub = fs.chain(60, belt=4, interface=(1, 60), damping=0.0)
    band = (0.0, 0.2)
    expected = {key: reduced_to(sub, METHODS[key], band) for key in ("craig-bampton", "craig-chang")}
    for key, like in (("hurty", "craig-bampton"), ("rubin", "craig-chang"), ("dual-craig-bampton", "craig-chang")):
        rom = reduced_to(sub, METHODS[key], band)
        assert rom.estimate is not None and rom.estimate.met and rom.modes == expected[like].modes
    damped, belt = fs.chain(60, belt=4, interface=(1, 60), damping=0.1), fs.Belt(port="belt", slope=-0.002)
    cc, rubin = (reduced_to(damped, kind, band, belt) for kind in (fs.CraigChang, fs.Rubin))
    assert rubin.modes == cc.modes and rubin.estimate is not None and cc.estimate is not None
    assert rubin.estimate.met and len(rubin.estimate.eigenvalues) == len(cc.estimate.eigenvalues) > 0
    with pytest.raises(fs.NotConvergedError, match=r"cannot be condensed to 0.001.*CraigBampton\(modes=\d+\)"):
        fs.reduce(sub, fs.Guyan(band=band, tol=1e-3))
    dense = fs.chain(60, belt=4, interface=tuple(range(1, 61, 2)), damping=0.0)
    condensed = reduced_to(dense, fs.Guyan, (0.0, 0.06))
    assert condensed.estimate is not None and condensed.estimate.met and condensed.size == 30


def reduced_to(sub: fs.Substructure, kind: type, band: tuple[float, float],
               contacts: fs.Belt | None = None) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(sub, kind(band=band, tol=1e-3), contacts=contacts)


def test_nearly_complete_bases_keep_their_digits() -> None:
    """Where little is left as residual in some directions, the physical forms must not divide by it."""
    bare = lattice(8, 8)
    wide = fs.Substructure(bare.M, bare.K, interface=range(16), ports=bare.ports, name="wide")
    for sub, counts in ((lattice(4, 5), range(31, 37)), (wide, (107, 124))):
        full = spectrum(sub)
        for modes in counts:
            for key in ("rubin", "macneal", "herting"):
                found = spectrum(reduced(sub, key, modes))
                limit = 1e-6 if key == "macneal" else 1e-9  # its interface is to stay massless for longer
                assert np.abs(found[3:modes + 3] / full[3:modes + 3] - 1).max() < limit


@pytest.mark.sampled(17)
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", JOINED)
def test_joined_parts_with_all_modes_are_the_unreduced_system(name: str, key: str) -> None:
    joined, full = unreduced(name)
    system = joined.system(lambda part: reduced(part, key, whole(part, key)))
    found, rigid = spectrum(system), np.count_nonzero(full == 0)
    assert len(found) == len(full) and np.count_nonzero(found == 0) == rigid
    assert np.abs(found[rigid:] / full[rigid:] - 1).max() < 1e-9


@pytest.mark.parametrize("name", JOINED)
def test_joined_parts_condensed_on_all_of_their_dof_are_the_unreduced_system(name: str) -> None:
    joined, full = unreduced(name)
    all_dof = {}
    for part, sub in joined.parts.items():
        sets = {key: sub.interface[places] for key, places in sub.sets.items()}
        named = sets | {"rest": sub.interior} if sets else range(sub.size)
        all_dof[part] = fs.Substructure(sub.M, sub.K, interface=named, dofs=sub.dofs)
    found = spectrum(replace(joined, parts=all_dof).system(lambda p: fs.reduce(p, fs.Guyan())))
    rigid = np.count_nonzero(full == 0)
    assert np.abs(found[rigid:] / full[rigid:] - 1).max() < 1e-9


@pytest.mark.sampled(13)
@pytest.mark.parametrize("key", ["craig-bampton", "craig-chang", "guyan", "herting", "hurty", "rubin"])
@pytest.mark.parametrize("name", JOINED)
def test_joined_frequencies_bound_from_above_and_never_rise(name: str, key: str) -> None:
    joined, full = unreduced(name)
    before = np.full(len(full), np.inf)
    for modes in (0,) if key == "guyan" else (1, 2, 3):
        found = spectrum(joined.system(lambda part, modes=modes: reduced(part, key, modes)))
        assert (found >= full[:len(found)] * (1 - 1e-9)).all() and (found <= before[:len(found)] * (1 + 1e-9)).all()
        before = np.append(found, np.full(len(full), np.inf))


def at_equal_size(key: str, joined: Joined, full: fs.NormalModes, coordinates: int = 8) -> tuple[int, np.ndarray]:
    """The size, and the errors of the eight lowest ω, of parts with so many coordinates besides those of their interface.

    These are modes of either kind, rigid ones too.
    """
    def small(part: fs.Substructure) -> fs.Substructure:
        rigid = fs.normal_modes(part, count=0).rigid if key in (*FREE, "macneal", "herting") else 0
        return fs.reduce(part, METHODS[key](coordinates - rigid))

    system: Any = joined.system(small)
    modes = fs.normal_modes(system, count=8)
    return system.size + system.spurious, np.abs(modes.frequencies[modes.rigid:] / full.frequencies[full.rigid:] - 1)


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.filterwarnings("ignore::femsub.PortWarning")
@pytest.mark.parametrize("name", LARGER)
def test_rubin_and_dual_craig_bampton_beat_macneal_and_craig_bampton_at_equal_size(name: str) -> None:
    """With 8 coordinates a part, which are enough for the 8 frequencies compared: the table of docs/methods/choice.md."""
    joined = LARGER[name]()
    full = fs.normal_modes(joined.system(), count=8)
    sizes, errors = zip(*(at_equal_size(key, joined, full)
                          for key in ("craig-bampton", "macneal", "dual-craig-bampton", "rubin", "herting")), strict=True)
    assert sizes[0] == sizes[1] == sizes[3]
    told = [[float(np.exp(np.log(np.maximum(error, 1e-14)).mean())), float(error.max())] for error in errors]
    for hcb, macneal, dual, rubin, _ in zip(*told, strict=True):
        assert rubin < dual < min(hcb, macneal)
    page = (Path(__file__).parent.parent / "docs" / "methods" / "choice.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| {name}[^|]*\|(.*)\|$", page, re.MULTILINE)
    shown = [[float(number) for number in re.findall(r"[\de.-]+", cell)] for cell in row.split("|")]
    np.testing.assert_allclose(np.log10(told[:4]), np.log10(shown), atol=0.3)
    np.testing.assert_allclose(np.log10(told[4]), np.log10(shown[3]), atol=0.3)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("left_out", [4, 10])
@pytest.mark.parametrize("name", ["chain in 2", "held truss in 2", "beam in 2", "beam in 4"])
def test_systems_by_methods_of_one_span_have_one_spectrum(name: str, left_out: int) -> None:
    joined = JOINED[name]()
    for family in (("craig-chang", "rubin", "herting"), ("craig-bampton", "hurty")):
        systems = (joined.system(lambda part, key=key: reduced(part, key, max(whole(part, key) - left_out, 1))) for key in family)
        one, *others = (fs.normal_modes(system, count=8).frequencies for system in systems)
        assert all(np.abs(other[one > 0] / one[one > 0] - 1).max() < 1e-9 for other in others)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [6, 86, 98, 111, 330])  # some of the last four were refused: a chain moved by rounding
def test_loose_pieces_in_the_interface_stay_rigid_to_the_last_digit(seed: int) -> None:
    """Else their rows of K are squares of roundings, and a motion that costs nothing is taken for an elastic mode."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        K = np.zeros((6, 6))
        for one in (2, 3, 4):  # a chain of four beside two loose masses
            k = rng.uniform(0.3, 3.0)
            K[one:one + 2, one:one + 2] += [[k, -k], [-k, k]]
        sub = fs.Substructure(np.diag(rng.uniform(0.3, 3.0, 6)), K, interface=rng.permutation(6))
        rom = reduced(sub, "rubin", 2)
        loose = np.flatnonzero(sub.interface < 2)
        assert not rom.K[loose].any()
        np.testing.assert_allclose(rom.K, K[np.ix_(sub.interface, sub.interface)], atol=1e-9)


@pytest.mark.parametrize("key", PHYSICAL)
def test_a_massless_interface_dof_has_no_mass_by_rounding(key: str) -> None:
    """With all modes kept, modes and one massless shape are solved for the interface: a mass of 1e-80 would be a mode."""
    K = np.array([[6.765, -2.175, -4.59], [-2.175, 2.175, 0.0], [-4.59, 0.0, 4.59]])
    sub = fs.Substructure(np.diag([2.315, 0.0, 1.747]), K, interface=[0, 1, 2])
    rom = reduced(sub, key, 0 if METHODS[key].held else 1)
    assert not rom.M[1].any() and not rom.M[:, 1].any()
    system = fs.couple({"a": rom, "b": fs.chain(3, interface=[3])}, [fs.Rigid(("a", [1]), ("b", [2]))])
    full = fs.couple({"a": sub, "b": fs.chain(3, interface=[3])}, [fs.Rigid(("a", [1]), ("b", [2]))])
    assert np.allclose(spectrum(system), spectrum(full), rtol=1e-9)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", ["held lattice", "floating lattice"])
def test_methods_tell_how_many_static_shapes_they_make(name: str, key: str) -> None:
    sub, modes = PARTS[name](), 0 if key == "guyan" else 2
    rom, told = reduced(sub, key, modes), METHODS[key](modes).static_columns(sub)
    rigid = fs.normal_modes(sub, count=0).shapes.shape[1]
    assert told + modes <= rom.size + rom.dropped <= told + modes + rigid


def test_a_part_without_stiffness_is_named() -> None:
    ball = fs.Substructure([[2.0]], [[0.0]], interface=[0], name="ball")
    with pytest.raises(fs.SingularMatrixError, match="'ball': no DOF has both stiffness and mass"):
        fs.reduce(ball, fs.Rubin(0))


def test_macneal_where_a_regular_mass_is_needed_tells_of_rubin() -> None:
    rom = fs.reduce(fs.chain(10, belt=10, interface=[10], damping=0.1), fs.MacNeal(4))
    with pytest.raises(fs.InputError, match="Rubin"):
        fs.critical_slope(rom)
    for method in ("auto", "alpha"):
        with pytest.raises(fs.InputError, match="by Rubin: MacNeal leaves the interface without mass"):
            fs.transient(rom, fs.Belt(speed=0.1911, law=fs.StribeckArctan(eps=0.02)), time=(0, 1), method=method)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("first", range(0, 400, 100))
def test_macneal_s_stiffness_is_that_of_its_shapes_also_where_the_modes_leave_little(first: int) -> None:
    """K = VᵀKV: of a residual shape that moves the interface by 1e-5 of what all shapes do, that motion is no rounding."""
    worst = 0.0
    for seed in range(first, first + 100):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(6, 16))
        places = (1 + rng.choice(n, int(rng.integers(1, 4)), replace=False)).tolist()
        full = fs.chain(n, masses=rng.lognormal(0, 1, n), springs=rng.lognormal(0, 1, n), interface=places,
                        belt=int(rng.integers(1, n + 1)))
        try:
            rom = fs.reduce(full, fs.MacNeal(modes=int(rng.integers(1, 9))), ports=True)
        except fs.InputError:  # its interface has no independent motions, or more modes than there are
            continue
        K = rom.V.T @ (full.K @ rom.V)
        size = np.sqrt(np.abs(np.outer(K.diagonal(), K.diagonal())))
        worst = max(worst, float((np.abs(rom.K - K) / size).max()))
    assert worst < 1e-6
