"""What becomes of memory that is freed."""

from __future__ import annotations

import ctypes


def give_back_freed_memory() -> None:
    """Large blocks go back to the system when they are freed, as they would without OpenMPI: loading it takes mmap from
    malloc, and a factor of 8 GB, once given up, would stay in the heap beside the next one.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        for option, value in ((-3, 1 << 25), (-1, 1 << 26), (-4, 1 << 16)):  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_MMAP_MAX
            libc.mallopt(option, value)
