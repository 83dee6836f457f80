"""The memory that a sparse factorisation or a reduction will need, estimated from the graph of K before any work."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from zlib import crc32

import numpy as np
import scipy.sparse as sp

from femsub.algebra.ordering import layers as distance_layers, neighbours, quotient
from femsub.algebra.processes.cache import are_free, at_hand, kept_bytes
from femsub.algebra.processes.folders import in_memory, is_writable
from femsub.algebra.processes.limits import BASE, BLOCK, FACTOR_BYTES, LARGE
from femsub.algebra.processes.memory import available, left_of_limit
from femsub.checks import Array, Matrix, NotEnoughMemoryError, temporary

BLOCKS = 3 * BLOCK  # columns in work while constraint modes are computed: loads, solutions and products with K
LIBRARIES = "petsc4py.PETSc"
MOST_FILL = 60  # nonzeros of a factor and its count per nonzero of A, rarely reached: if these fit, the fill is not estimated
HEADROOM = 1.2  # free memory that a factor needs, relative to its estimate: a process that takes too much is killed
FRONTS, BUFFERED = 0.35, 0.15  # shares of a factor that are in memory while it is written to a disk, and used from there
_estimated: dict[tuple[int, int, int], float] = {}  # nonzeros of a factor by pattern of A, 200 bytes for each
_beside: ContextVar[float] = ContextVar("femsub_beside_factor", default=0.0)  # bytes that a factor must leave free


def check_memory(name: str, K: Matrix, columns: int, modes: int, interface: int, held: Array | None = None) -> float:
    """Compare the memory that a reduction needs with the available memory. If it is short, a disk with room takes the factor.

    Returns the bytes of the columns that are needed beside the factor, for `kept_free`.

    Parameters
    ----------
    name : str
    K : sparse, shape (n, n)
    columns, modes : int
        Static responses and modes that will be computed.
    interface : int
        Static shapes of the interface among the columns, for the message.
    held : ndarray, optional
        See `reduction_bytes`.

    Raises
    ------
    NotEnoughMemoryError
        It needs more than is available; the message has both figures and a remedy.
    """
    if not sp.issparse(K) or K.shape[0] < LARGE:
        return 0.0
    libraries = {"libraries": 0.0 if LIBRARIES in sys.modules else BASE / 4}  # the first factorisation loads them
    amply = reduction_bytes(K, columns, modes, held, nonzeros=MOST_FILL * K.nnz) | libraries
    if (free := available()) is None or sum(amply.values()) < free:
        return amply["columns"]
    parts = reduction_bytes(K, columns, modes, held) | libraries
    need, beside, other = sum(parts.values()), parts["columns"], ""
    if (free := at_hand(need)) is not None and need > free:
        on_disk = reduction_bytes(K, columns, modes, held, on_disk=True) | libraries
        place, room = disk()
        if parts["factorisation"] <= room:
            parts = on_disk
        elif sum(on_disk.values()) <= free:
            other = (f", or name by TMPDIR a folder on a disk with {parts['factorisation'] / 1e9:.2g} GB free, where the factor "
                     f"could lie; {place} has no such room")
    advice = {
        "factorisation": "a coarser mesh, or linear elements",
        "matrices": "a coarser mesh",
        "columns": "fewer interface DOF (a rigid or averaged interface)" if interface > modes else "fewer modes"}
    largest = max(advice, key=lambda part: parts[part])
    detail = ", ".join(f"{value / 1e9:.1f} for the {part}" for part, value in parts.items())
    check_room(f"reducing {name!r}", sum(parts.values()), f"Use {advice[largest]}, or a larger machine{other}", f" ({detail})")
    return beside


def check_columns(name: str, size: int, columns: int) -> None:
    """Compare the memory for more columns of `size` DOF with the available memory; the factor exists already.

    Raises
    ------
    NotEnoughMemoryError
        They need more than is available; the message has both figures.
    """
    if size >= LARGE:
        check_room(f"a larger search for modes of {name!r}", 8.0 * size * columns,
                   "Lower the band, raise the tolerance, or use a larger machine")


def check_room(what: str, need: float, advice: str = "Make it smaller", detail: str = "") -> None:
    """Compare the bytes that something needs with the available memory, before any array is made.

    Raises
    ------
    NotEnoughMemoryError
        It needs more than is available; the message has both figures, and `detail` behind the first.
    """
    if are_free(need):
        return
    free = at_hand(need)
    if free is not None and need > free:
        raise NotEnoughMemoryError(f"{what} needs about {need / 1e9:.3g} GB{detail}, but only {free / 1e9:.0f} GB are available. "
                                   f"{advice}")


@contextmanager
def kept_free(bytes_beside: float) -> Iterator[None]:
    """Inside, a factor goes to a disk if it would leave fewer bytes free than these."""
    token = _beside.set(max(bytes_beside, _beside.get()))
    try:
        yield
    finally:
        _beside.reset(token)


def disk() -> tuple[Path, float]:
    """The folder for factors, and the bytes that it may take: the folder for temporary files (TMPDIR), else /var/tmp.

    A folder in memory is of no use. If neither folder is on a disk, the room is 0.
    """
    for place in (temporary(), Path("/var/tmp")):
        if is_writable(place) and not in_memory(place):
            return place, 0.9 * shutil.disk_usage(place).free  # others may need the rest
    return temporary(), 0.0


def goes_to_disk(A: Matrix, possible: bool, kept: bool = True) -> bool:
    """Whether the factor of a sparse A, about to be made, is too large for the memory, and a disk has room for it.

    `possible`: whether the factor can use a disk at all. Of a factor that is not `kept` only the signs of the pivots are stored,
    which takes a quarter of the memory.

    Cached factors are freed first if their memory is needed. A factor that leaves no room for a count beside the search stays in
    memory nevertheless. The modes are then counted afterwards, which takes less time than solves from a disk.

    Raises
    ------
    NotEnoughMemoryError
        The limit of this process (`ulimit -v`) leaves less than the factor takes. OpenBLAS would ask for memory for ever.
    """
    limit, free, beside = left_of_limit(), available() if A.shape[0] >= LARGE else None, _beside.get()
    enough = MOST_FILL * FACTOR_BYTES * A.nnz + beside
    if (limit is None or limit > BASE + enough) and (free is None or free > (1 + (kept_bytes() > 0)) * enough):
        return False
    nonzeros = factor_nonzeros(A)
    need = FACTOR_BYTES * nonzeros if kept else count_bytes(A, nonzeros)
    whole = HEADROOM * need + beside
    if free is not None and (kept_bytes() or free < whole):
        free, limit = at_hand(2 * need + beside), left_of_limit()
    left = min(np.inf if limit is None else limit - BASE, np.inf if free is None else free)
    if possible and A.shape[0] >= LARGE and FRONTS * need < left < whole and need < disk()[1]:
        return True
    if limit is not None and need > limit - BASE:
        raise NotEnoughMemoryError(f"a factor of {A.shape[0]} DOF needs about {(BASE + need) / 1e9:.2g} GB, but the limit of "
                                   f"this process (ulimit -v or -d) leaves {max(limit, 0.0) / 1e9:.2g} GB. Raise the limit, or "
                                   "make the model smaller")
    return False


def reduction_bytes(K: Matrix, columns: int, modes: int, held: Array | None = None, on_disk: bool = False,
                    nonzeros: float | None = None) -> dict[str, float]:
    """Bytes that a reduction needs beside the component itself, by purpose, at the stage that needs most.

    These are the stages, with the columns of n numbers that each holds:

    - constraint modes: blocks of loads and solutions;
    - block Lanczos: V, and the modes;
    - the inertia count: the first factor is gone, and that of LDLᵀ is not kept;
    - static shapes: the responses, their orthogonal combinations, and V or a temporary;
    - the projection: V, and small matrices.

    Where memory is short, a factor that is kept for later is freed before the count. A factor on a disk has only its fronts in
    memory while it is made, and only buffers afterwards.

    Parameters
    ----------
    K : sparse, shape (n, n)
    columns, modes : int
        Static shapes and modes that are computed.
    held : ndarray, optional
        The interface DOF, if it is held while the modes are computed: as many of the columns are constraint modes.
    on_disk : bool
        Whether a disk takes the factor.
    nonzeros : float, optional
        Nonzeros of the factor. By default they are estimated from the graph.
    """
    n, constraint = K.shape[0], 0 if held is None else len(held)
    static, size = max(columns - constraint, 0), columns + modes
    if nonzeros is None:
        # a held interface of less than a hundredth of the DOF makes the factor hardly smaller
        rows = np.setdiff1d(np.arange(n), held) if held is not None and constraint > n / 100 else None
        nonzeros = factor_nonzeros(K if rows is None else K[rows][:, rows])
    small = 9 * 8.0 * size**2  # M, D, K of the model, and their decompositions
    whole = FACTOR_BYTES * nonzeros
    factor = BUFFERED * whole if on_disk else whole
    stages = [(factor, 8.0 * n * (constraint + max(BLOCKS, search_columns(modes)))),
              (count_bytes(K, nonzeros) * (modes > 0), 8.0 * n * (constraint + 2 * modes + 4 * static)),
              (factor, 8.0 * n * (constraint + 2 * modes + 3 * static) + small)]
    if on_disk:
        stages.append((FRONTS * whole, 0.0))
    factor, held_columns = max(stages, key=sum)
    blocks = 12 * K.nnz if held is None else 30 * K.nnz  # K and M of the interior are copies
    return {"factorisation": factor, "matrices": blocks, "columns": held_columns}


def search_columns(modes: int) -> float:
    """Columns of n numbers that block Lanczos needs for this number of modes: its basis, blocks in work and the modes."""
    return (3.5 * modes + 100) * (modes > 0)


def count_bytes(K: Matrix, nonzeros: float, kept: bool = False) -> float:
    """Bytes of an inertia count of K - σM whose factor has `nonzeros`; unless `kept`, a quarter of the factor's bytes.

    Matrices and their graph take another 42 bytes for each nonzero of K.
    """
    return (1.0 if kept else 0.25) * FACTOR_BYTES * nonzeros + 42 * K.nnz


def room_of_count(K: Matrix, nonzeros: float, kept: bool = False) -> float:
    """Bytes that must be free for a second process that makes this count beside the search."""
    return HEADROOM * count_bytes(K, nonzeros, kept) + BASE


def has_room_to_count(K: Matrix, nonzeros: float) -> bool:
    """Whether this count fits into the memory that is free, after cached factors have been freed as far as needed."""
    need = room_of_count(K, nonzeros)
    return K.shape[0] < LARGE or (free := at_hand(need)) is None or free >= need


def factor_nonzeros(A: Matrix) -> float:
    """Estimated number of nonzeros of the Cholesky factor of a sparse symmetric A (n, n) after nested dissection.

    A breadth-first search from one end to the other divides the graph into layers; the smallest near the middle is the
    separator. This is repeated in the larger half only; the other half is assumed to be similar. With separators of s_l DOF
    that touch b_l DOF of earlier ones, in parts of n_l DOF, nnz(L) ≈ Σ_l (n/n_l)(s_l²/2 + s_l b_l)/1.7.

    Matrices of one pattern share the estimate.

    References
    ----------
    A. George, SIAM J. Numer. Anal. 10 (1973) 345.
    """
    A = sp.csr_array(A)
    pattern = A.shape[0], crc32(A.indptr), crc32(A.indices)
    if pattern in _estimated:
        return _estimated[pattern]
    if A.nnz <= 3 * A.shape[0]:  # a tree: no fill
        return A.nnz / 2
    graph, weight = quotient(A)
    count, total, whole = len(weight), 0.0, float(weight.sum())
    part, cut = np.arange(count), np.zeros(count, dtype=bool)
    while True:
        size = float(weight[part].sum())
        border = np.unique(neighbours(graph, part))
        touched = float(weight[border[cut[border]]].sum())
        if len(part) <= 64:  # dense
            break
        # layers from the far end and back again
        inside = np.zeros(count, dtype=bool)
        inside[part] = True
        layers = distance_layers(graph, inside, part[:1])
        for _ in range(2):
            layers = distance_layers(graph, inside, layers[-1])
        sizes = np.cumsum([weight[layer].sum() for layer in layers])
        if sizes[-1] < 0.9 * size:  # disconnected: continue with the larger piece
            reached = np.concatenate(layers)
            part = reached if sizes[-1] > size / 2 else np.setdiff1d(part, reached)
            continue
        # the smallest separator near the middle: the nodes of a layer that touch the next one
        first = int(np.searchsorted(sizes, 0.4 * size))
        last = min(max(first + 1, int(np.searchsorted(sizes, 0.6 * size))), len(layers) - 1)
        if first >= last:  # too few layers: nearly a clique
            break
        walls = []
        for k in range(first, last):
            marked = np.zeros(count, dtype=bool)
            marked[neighbours(graph, layers[k + 1])] = True
            walls.append(layers[k][marked[layers[k]]])
        best = int(np.argmin([weight[wall].sum() for wall in walls]))
        separator = float(weight[walls[best]].sum())
        total += whole / size * (separator**2 / 2 + separator * touched)
        # the larger half
        cut[walls[best]] = True
        k = first + best
        halves = np.concatenate([*layers[:k], np.setdiff1d(layers[k], walls[best])]), np.concatenate(layers[k + 1:])
        part = max(halves, key=len)
    total += whole / size * (size**2 / 2 + size * touched)
    _estimated[pattern] = total / 1.7  # empirical: METIS finds better separators; within a factor of 1.7 on 14 models
    return _estimated[pattern]
