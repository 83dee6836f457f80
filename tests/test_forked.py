"""Columns that a fork finds meanwhile: all are there at the end, whatever becomes of the fork."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import scipy.linalg as la

import femsub as fs
from femsub.algebra import divided, fork_pays, libraries, one_thread, shared_factor, shared_zeros
from femsub.algebra.processes.beside import Divided, columns_left, give_back_cores

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
COLUMNS = 100


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()


class Solves:
    """Column j becomes j + 1, and remembers the process that found it; `unlike` is what the fork does first."""

    def __init__(self, unlike: Callable[[], object] = lambda: None) -> None:
        self.found, self.by, self.owner, self.unlike = shared_zeros(3, COLUMNS), shared_zeros(1, COLUMNS), os.getpid(), unlike

    def __call__(self, part: slice) -> None:
        if os.getpid() != self.owner:
            self.unlike()
        self.found[:, part] = 1.0 + np.arange(COLUMNS)[part]
        self.by[:, part] = os.getpid()

    @property
    def whole(self) -> bool:
        return bool((self.found == 1.0 + np.arange(COLUMNS)).all())


def waited(work: Divided) -> None:
    until = time.monotonic() + 60
    while work.busy() and time.monotonic() < until:
        time.sleep(0.01)


def test_a_fork_finds_all_columns_while_this_process_does_something_else() -> None:
    solves, before = Solves(), children()
    work = Divided(solves, COLUMNS, True, 32)
    waited(work)
    work.finish()
    assert solves.whole and (solves.by != os.getpid()).all()
    assert children() == before


@pytest.mark.parametrize("beside", [True, False])
def test_what_no_fork_has_begun_is_found_here(beside: bool) -> None:
    solves = Solves(lambda: time.sleep(0.3))
    assert divided(solves, COLUMNS, beside, lambda: "found") == "found"
    assert solves.whole and solves.by[0, -1] == os.getpid()


@pytest.mark.parametrize("end", ["killed", "raises", "hangs"])
def test_a_fork_that_does_not_answer_costs_no_column(end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.processes.beside.PATIENCE", 0.2)

    def fail() -> None:
        if end == "raises":
            raise MemoryError
        if end == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(1000)

    solves, before = Solves(fail), children()
    work = Divided(solves, COLUMNS, True, 32)
    time.sleep(0.2)
    assert work.busy() is (end == "hangs")
    work.finish()
    assert solves.whole and (solves.by == os.getpid()).all()
    assert children() == before


def test_an_error_meanwhile_ends_the_fork_and_gives_the_threads_back() -> None:
    before, threads = children(), [one["num_threads"] for one in libraries().info()]

    def fail() -> None:
        assert all(one["num_threads"] == 1 for one in libraries().info()) and columns_left() == COLUMNS
        raise KeyError

    with pytest.raises(KeyError):
        divided(Solves(lambda: time.sleep(1000)), COLUMNS, True, fail)
    assert columns_left() == 0
    assert children() == before
    assert [one["num_threads"] for one in libraries().info()] == threads


def test_an_error_of_the_solves_is_told() -> None:
    def refuse(part: slice) -> None:
        raise fs.SingularMatrixError("as if")

    with pytest.raises(fs.SingularMatrixError, match="as if"):
        divided(refuse, COLUMNS, True)


def test_a_fork_that_has_ended_gives_its_core_back_meanwhile() -> None:
    seen: list[list[int]] = []

    def counts() -> list[int]:
        return [one["num_threads"] for one in libraries().info()]

    def look() -> None:
        seen.append(counts())
        until = time.monotonic() + 60
        while counts() != before and time.monotonic() < until:
            give_back_cores()
            time.sleep(0.01)
        seen.append(counts())

    with libraries().limit(limits=2):
        before = counts()
        divided(Solves(), COLUMNS, True, look)
        assert seen == [[1] * len(before), before]


def test_one_thread_may_end_in_any_order() -> None:
    with libraries().limit(limits=2):
        before = [one["num_threads"] for one in libraries().info()]
        first, second = one_thread(True), one_thread(True)
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert all(one["num_threads"] == 1 for one in libraries().info())
        second.__exit__(None, None, None)
        assert [one["num_threads"] for one in libraries().info()] == before


@pytest.mark.slow
def test_constraint_modes_of_a_fork_are_those_of_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.factor.WORK", 0.0)
    monkeypatch.setattr("femsub.algebra.processes.beside.cores", lambda: 2)
    asked, found = [], []
    begin = Divided.__init__
    monkeypatch.setattr(Divided, "__init__", lambda self, solve, columns, forked, width: (
        asked.append(forked), begin(self, solve, columns, forked, width), waited(self))[1])
    for block in (16, 20_000):  # half of it wider than all columns: no fork
        monkeypatch.setattr("femsub.algebra.factor.BLOCK", block)
        monkeypatch.setattr("femsub.algebra.processes.beside.BLOCK", block)
        sub = fs.solid(fs.block((1.0, 0.5, 0.3), (8, 5, 4), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
        for method in (fs.CraigBampton(6), fs.CraigBampton(cutoff=2e4), fs.Herting(3), fs.Guyan(),
                       fs.CraigBampton(band=(0.0, 8e3), tol=1e-3)):
            rom = fs.reduce(sub, method)
            found.append(la.eigvalsh(rom.K, rom.M))
    if asked[0] is False:
        pytest.skip("no CHOLMOD")
    half = len(found) // 2
    assert asked == [True] * half + [False] * half
    for values, others in zip(found[:half], found[half:], strict=True):
        assert np.allclose(values, others, rtol=1e-9, atol=1e-11 * others[-1])


def test_a_fork_that_dies_within_a_block_leaves_the_constraint_modes_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its columns are written already, and it has not said so."""
    monkeypatch.setattr("femsub.algebra.factor.WORK", 0.0)
    monkeypatch.setattr("femsub.algebra.factor.BLOCK", 16)
    monkeypatch.setattr("femsub.algebra.processes.beside.BLOCK", 16)
    monkeypatch.setattr("femsub.algebra.processes.beside.cores", lambda: 2)
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (8, 5, 4), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
    right = fs.reduce(sub, fs.CraigBampton(3)).K
    owner, begin = os.getpid(), Divided.__init__

    def dying(self: Divided, solve: Callable[[slice], None], columns: int, forked: bool, width: int) -> None:
        def first(part: slice) -> None:
            solve(part)
            if os.getpid() != owner:
                os._exit(0)

        begin(self, first, columns, forked, width)
        waited(self)

    monkeypatch.setattr(Divided, "__init__", dying)
    assert np.abs(fs.reduce(sub, fs.CraigBampton(3)).K - right).max() <= 1e-12 * np.abs(right).max()


def test_modes_are_sought_beside_by_a_part_that_is_reduced_alone() -> None:
    """An estimate of a system takes the constraint modes of all parts, and no modes."""
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (6, 4, 3), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
    method = fs.CraigBampton(3)
    part = method.part(sub)
    for alone in (False, True):
        statics = method.statics(replace(part, alone=alone), part.factored(), np.zeros((sub.size, 0)))
        assert (statics.sought is not None) is alone


def test_no_fork_where_it_would_not_be_safe_or_not_be_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.processes.beside.cores", lambda: 2)
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (6, 4, 3), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0))
    factor = shared_factor(sub.K + 1e6 * sub.M, "definite")
    assert not fork_pays(factor, 1000)
    monkeypatch.setattr("femsub.algebra.factor.WORK", 0.0)
    here, there = fork_pays(factor, 1000), []
    assert here is (factor.package == "cholmod")
    Thread(target=lambda: there.append(fork_pays(factor, 1000))).start()
    while not there:
        time.sleep(0.001)
    assert there == [False]
    assert not fork_pays(factor, 10)
    assert not fork_pays(shared_factor(sub.K + 2e6 * sub.M, "symmetric"), 1000)


def test_columns_that_are_left_are_told() -> None:
    """Their memory is not taken yet."""
    work = Divided(lambda part: None, 10, forked=False, width=4)
    assert work.left == 10
    work.finish()
    assert work.left == 0
