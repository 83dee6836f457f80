"""Threads of BLAS are put away for small dense work, and are back afterwards."""

from __future__ import annotations

import os
import subprocess
import sys

CODE = """
import scipy.linalg
import femsub as fs
from femsub.modes.quadratic import dense
from femsub.algebra import threads

def counts():
    return [one["num_threads"] for one in threads.libraries().info()]

seen = []
solve = dense._solved
dense._solved = lambda pencil: (seen.append(counts()), solve(pencil))[1]
before = counts()
fs.complex_modes(fs.chain(10))
assert all(count == 1 for count in seen[0]), seen
assert counts()[:len(before)] == before, (before, counts())
try:
    with threads.one_thread(True):
        raise KeyError
except KeyError:
    pass
assert counts()[:len(before)] == before
with threads.one_thread(False):
    assert counts()[:len(before)] == before
"""


def test_small_dense_work_takes_one_thread_and_gives_the_others_back() -> None:
    two = {**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", CODE], env=two, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
