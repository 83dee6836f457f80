"""A component that many tests share; that slow tests run where they are asked for, and CHOLMOD's own where PETSc has it."""

from __future__ import annotations

import gc
import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import memory, petsc
from femsub.algebra.processes import cache
from femsub.algebra.processes.threads import libraries

pytest.register_assert_rewrite("matrixhelp")  # its assertions tell their values as those in tests do


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the tests marked slow as well, which a run of all tests leaves out")
    parser.addoption("--every", action="store_true", help="run every test: the slow ones, and the rare cases as well")
    parser.addoption("--mumps", action="store_true", help="factorise by MUMPS alone, as a PETSc without CHOLMOD does")


def pytest_configure(config: pytest.Config) -> None:
    if config.option.mumps:
        petsc.CHOLMOD = False
    if getattr(config.option, "numprocesses", None):  # each of several processes (-n) gets one BLAS thread
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(name, "1")


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("cholmod") and not petsc.has_cholmod():
        pytest.skip("about CHOLMOD, which this PETSc was built without")


def sampled(cases: list[Any]) -> list[str]:
    """'' for each quick case of a test, 'slow' or 'rare' for the others. Each value of each of several parameters is in one that
    is not rare."""
    found: list[str] = []
    for at, case in enumerate(cases):
        quick, slow = (*case.get_closest_marker("sampled").args, 4)[:2]
        row, turn = divmod(at, quick)
        found.append("" if not turn else "rare" if (row * (quick - 1) + turn) % slow else "slow")
    names = cases[0].callspec.params
    if len(names) > 1:
        values = [{(name, id(case.callspec.params[name])) for name in names} for case in cases]
        seen = set().union(*(own for own, kind in zip(values, found, strict=True) if kind != "rare"))
        for at, (own, kind) in enumerate(zip(values, found, strict=True)):
            if kind == "rare" and not own <= seen:
                found[at] = "slow"
                seen |= own
    return found


@pytest.hookimpl(tryfirst=True)  # before pytest looks at -m
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """
    Of a test marked sampled(k) or sampled(k, j), each k-th case stays quick. Of the others each j-th, by default each fourth, is
    slow. The rest is rare: more of what the slow ones show, for --every, a mark (-m rare) or a name. A run of all tests leaves
    out the slow ones; what is selected (-m, -k) or named (a file, a test of it) runs as asked.

    Not by `-m 'not slow'` among pytest's addopts: that leaves out a test that is named, too.
    """
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for several in cases.values():
        for item, name in zip(several, sampled(several), strict=True):
            if name:
                item.add_marker(name)
    option = config.option
    named = any((config.invocation_params.dir / arg.partition("::")[0]).is_file() for arg in config.args)
    left = set()
    if not (option.every or "rare" in option.markexpr or (not option.markexpr and (option.keyword or named))):
        left.add("rare")
    if not (option.slow or option.every or option.markexpr or option.keyword or named):
        left.add("slow")
    left_out = [item for item in items if any(map(item.get_closest_marker, left))]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not any(map(item.get_closest_marker, left))]


def pytest_collection_finish() -> None:
    """Thousands of collected tests live to the end: the garbage collector need not look through them again and again.

    Nor so often: at Python's own 700 objects, figures and syntax trees take a fifteenth of their time for it.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)


@pytest.fixture(scope="session", autouse=True)
def _imported_before_anything_is_patched() -> None:
    """Names are lazy: a module that is first imported while a test has patched another one would keep what was patched."""
    for name in fs.__all__:
        getattr(fs, name)
    petsc.load()  # it brings a BLAS of its own: loaded inside a test, it would miss the limit that the test has set


@pytest.fixture(autouse=True)
def _blas_keeps_its_threads() -> Iterator[None]:
    """Threads that one test left to BLAS once took a seventh of the time of all tests, in two processes on two cores."""
    before = {library.filepath: library.num_threads for library in libraries().lib_controllers}
    yield
    changed = [library for library in libraries().lib_controllers
               if library.num_threads != before.get(library.filepath, library.num_threads)]
    for library in changed:
        library.set_num_threads(before[library.filepath])
    assert not changed, "this test has changed the number of threads of BLAS, and has not given them back"


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """machine(free, large): a machine with so many bytes free (a number, a function, or None: unknown), looked at from
    models of `large` DOF on."""
    def set_to(free: Any, large: int | None = None) -> None:
        for module in (memory, cache):
            monkeypatch.setattr(module, "available", free if callable(free) else lambda: free)
        if large is not None:
            monkeypatch.setattr(memory, "LARGE", large)

    return set_to


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261120)


@pytest.fixture
def sub() -> fs.Substructure:
    """The held lattice with unsymmetric D, a second port of two columns, names and places of its DOF."""
    base = lattice(4, 3, held=True)
    n, rng = base.size, np.random.default_rng(3)
    dofs = fs.DofMap(np.repeat(np.arange(n // 2) * 7 + 3, 2), np.tile([0, 1], n // 2), points=rng.standard_normal((n, 2)))
    damping = sp.random(n, n, 0.1, random_state=5, format="csr")
    ports = {"pad": rng.standard_normal((n, 2)), "belt": base.port("belt")}
    return fs.Substructure(base.M, base.K, damping, base.interface, ports, "lättice", dofs)
