"""Sizes from which a check of memory, a process or a thread pays, and how much each of them takes.

They were measured on two cores. A limit that is off by a factor of two costs seconds, never digits.
"""

from __future__ import annotations

LARGE = 20_000  # DOF from which memory is checked and kept for reuse, and MUMPS replaces SuperLU for complex matrices
BASE = 3e8  # bytes that a process takes before its first task: Python, NumPy, SciPy and PETSc, and buffers of their BLAS
# columns in work at a time: right-hand sides, static shapes, columns of a product. More gain little, and cost 16 n bytes each
BLOCK = 64
SMALL = 100  # DOF up to which LAPACK is quicker than the set-up of a sparse factorisation
WIDE = 300  # coordinates up to which all eigenvalues of a dense problem take less time than those of a band
WORTH = 2e7  # nonzeros of a factor from which a count takes much longer than the start of a process, half a second
FACTOR_BYTES = 8 * 1.6  # bytes per nonzero of a factor, with its indices and its share of the fronts
QUADRATIC = 2000  # DOF up to which LAPACK computes all 2n eigenvalues of a quadratic problem: some 60 s
# DOF up to which a dense eigenproblem gets one thread. A second one gains little; beside other work it costs much: on two busy
# cores 500 DOF took 35 s with two threads and 2 s with one
FEW = QUADRATIC
# dense multiplications below which BLAS gets one thread: a second one gains less than 0.1 s, and loses as much beside other work.
# Sparse ones are bound by memory and take five times as long or more
WORK = 1e8
PATIENCE = 10.0  # seconds until the state of a process that does not answer is checked; many large factors take longer
LOOK = 0.002  # seconds between two checks of a process: a check takes a hundredth of that
