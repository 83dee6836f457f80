"""`read_component`: a component from the files of another program."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import (
    Array,
    InputError,
    InputTypeError,
    Matrix,
    empty_dofs_text,
    mapping,
    naming,
    path_of,
    positive_number,
    truth,
    warn,
    word,
)
from femsub.io.abaqus_calculix import DIRECTIONS, HELD, dof_map, read_dofs
from femsub.io.damage import unreadable_refused
from femsub.io.matrix_files import guarded, read_labelled
from femsub.io.model_folder import read_model
from femsub.io.superelements import ENDINGS, read_superelement
from femsub.model import DofMap, ReducedSubstructure, Substructure

#: Words in the names of files, and of matrices in them, that name what they hold; 'sti' and 'mas' are CalculiX'.
NAMES = {"M": {"m", "mas", "mass", "masse", "maa", "mff", "mgg"}, "K": {"k", "sti", "stiff", "stiffness", "kaa", "kff", "kgg"}}


@unreadable_refused
def read_component(M: str | Path, K: str | Path | None = None, D: str | Path | None = None, *,
                   dofs: DofMap | str | Path | None = None, interface: Iterable[Any] = (),
                   ports: Mapping[str, Any] | None = None, name: str | None = None, massless: bool = False,
                   drop_empty: bool = False, cutoff: float | None = None) -> Substructure:
    """Read a component from the files of another program, a superelement, or a model that `write_matrices` wrote.

    The component is M ü + D u̇ + K u = Σ w_p f_p with M, K, D of shape (n, n).

    Parameters
    ----------
    M, K, D : str or Path
        Files as for `read_matrix`. If a .mat, .npz, .op4, .pch or .full file holds several matrices, the one called M, K or D
        is taken, or the one named after a colon: 'model.mat:Kff'. M alone may be a folder of `write_matrices`: the model is
        restored exactly, a reduced model as a reduced one. M alone may also be a .full file of Ansys, or a file of an external
        superelement of Nastran, with its other files beside it ('part.op4', 'part.asm', 'part.pch', 'part.op2'), or of Sierra/SD
        ('part.nc4').
    dofs : DofMap, str or Path, optional
        The map, or its file: CalculiX' .dof ('12.3' a line) or text with 'node,component[,x,y,z]' a line. Abaqus' files of
        FORMAT=MATRIX INPUT contain it.
    interface : sequence
        DOF: numbers from 0, or by the map '12:uz', '12.3' (node and direction), `12:*` (all of a node), (12, 'uz').
    ports : mapping of str
        For each port a DOF as in `interface`, a sequence of DOF (w is 1 there), a mapping of DOF to weight, or the column(s) w as
        an array of floats, shape (n,) or (n, p).
    name : str, optional
        Default: the name of K's file, or the one in the folder of `write_matrices`.
    massless : bool
        Whether M may lack DOF of K, as Abaqus' files do for DOF without mass. Otherwise the file counts as cut short.
    drop_empty : bool
        Whether DOF with neither mass, damping nor stiffness are left out, as Nastran's KGG has them at nodes of solids. DOF
        map and ports follow. `interface` and `ports` count from 0 in the files' rows. An interface DOF or a port that needs such
        a DOF is refused.
    cutoff : float, optional
        Of a superelement, in rad per unit of time: up to which frequency its author kept modes. Its files do not contain it.

    Returns
    -------
    Substructure
        DOF that an Abaqus boundary condition holds (1e36 on the diagonal of K) are removed, as are empty ones with `drop_empty`;
        the others keep their names. A superelement is a `ReducedSubstructure`. Its interface has the set 'boundary' and a set for
        each boundary grid, named by its number. Its motions are along the basic axes ('ux', ..., 'rz'), whatever frames the grids
        have.

    Notes
    -----
    What each kind of file may contain, what is refused, and what no reader can detect is listed at `read_matrix`; for a folder
    at `femsub.io.model_folder.read_model`, for superelements at `femsub.io.superelements.read_superelement`.

    Raises
    ------
    InputError
        A file that cannot be read, is cut short or belongs to another model, a DOF that does not exist, matrices that are
        not a component (see `Substructure`), as an unsymmetric K: read that with `read_matrix`, for a `Pencil`. The message names
        the file.

    Warns
    -----
    FemsubWarning
        A superelement without `cutoff`. DOF with neither mass, damping nor stiffness: their number, and the first of them.

    Examples
    --------
    >>> import femsub as fs
    >>> files = fs.write_matrices("model", fs.chain(10, belt=2))
    >>> fs.read_component("model/M.mtx", "model/K.mtx", interface=[0], ports={"belt": 1})
    Substructure 'K': 10 DOF, sparse, 28 nonzeros in K, 1 interface DOF, ports belt
    """
    # arguments
    ports = None if ports is None else mapping("ports", ports, "names and columns")
    name = None if name is None else word("name", name)
    truth("massless", massless)
    truth("drop_empty", drop_empty)
    listed = interface.tolist() if isinstance(interface, np.ndarray) else interface
    bare = isinstance(listed, (list, tuple, range)) and not listed
    first = path_of("M", M)
    superelement = K is None and first.suffix.lower() in ENDINGS and not first.is_dir()
    if cutoff is not None and not superelement:
        raise InputError("cutoff is for superelements, read_component('part.op4', cutoff=...)")
    found: Substructure
    # a superelement, with ports w = Vᵀ w_full on the motions that it recovers
    if superelement:
        if D is not None or dofs is not None or not bare:
            raise InputError(f"{M} is a superelement, whose files have D, interface and DOF map: give M, ports, name and cutoff")
        limit = None if cutoff is None else positive_number("cutoff", cutoff)
        part: ReducedSubstructure = guarded(first, lambda path: read_superelement(path, name, limit))
        columns = {port: part.V.T @ _column(port, value, len(part.V), part.full_dofs) for port, value in (ports or {}).items()}
        found = replace(part, ports=columns) if columns else part
    # a folder of write_matrices
    elif K is None and first.suffix.lower() not in (".full", ".sub"):
        given = {"D": D is not None, "dofs": dofs is not None, "interface": not bare, "ports": ports is not None}
        beside = [key for key, there in given.items() if there]
        if beside:
            raise InputError(f"K is missing: name its file. If {M} is a folder of write_matrices, leave out "
                             f"{' and '.join(beside)}: it contains interface, ports and DOF map")
        found = read_model(first)
        found = found if name is None else found._with(name=name)
    # matrices, and a DOF map of their own or beside them
    else:
        K = M if K is None else K
        paths = {key: path_of(key, path) for key, path in (("M", M), ("K", K), ("D", "" if D is None else D))}
        if paths["D"] == Path():  # '' stands for no damping
            del paths["D"]
        refuse_exchanged(paths["M"], paths["K"])
        matrices, own = read_aligned(paths, {key: key for key in paths}, "K", ("M",), massless, drop_empty)
        size = matrices["K"].shape[0]
        if dofs is not None and own is not None:
            raise InputError(f"dofs: {paths['K']} already contains node and DOF of each entry. Leave the map out")
        if dofs is not None:
            own = dofs if isinstance(dofs, DofMap) else read_dofs(path_of("dofs", dofs))
            if own.size != size:
                half = " (of a cyclic symmetric model, CalculiX lists one half only)" if 2 * own.size == size else ""
                raise InputError(f"dofs: the DOF map {'' if isinstance(dofs, DofMap) else dofs} has {own.size} DOF, but "
                                 f"{paths['K']} has {size} rows{half}")
        rows = dof_numbers("interface", interface, size, own)
        columns = {port: _column(port, value, size, own) for port, value in (ports or {}).items()}
        try:
            found = Substructure(matrices["M"], matrices["K"], matrices.get("D"), rows, columns,
                                 Path(str(K).split(":")[0]).stem if name is None else name, own)
        except (InputError, InputTypeError) as error:
            listed = ", ".join(f"{key} is {path}" for key, path in paths.items())
            raise type(error)(f"{error} ({listed})") from None
    # empty DOF
    empty = found.empty(found.D, found.H)
    if len(empty) and drop_empty:
        return _without(found, empty)
    if len(empty):
        advice = "" if np.isin(empty, found.interface).all() else ". Leave them out by drop_empty=True"
        warn(f"{found.name!r}: {empty_dofs_text(len(empty), map(found.dof_name, empty.tolist()))}. Analyses refuse them, unless "
             f"joints or contacts act there{advice}")
    return found


def _without(sub: Substructure, empty: Array) -> Substructure:
    """The component without these DOF; an error if its interface or a port uses one of them."""
    def named(rows: Array) -> str:
        return f"{empty_dofs_text(len(rows), map(sub.dof_name, rows.tolist()))}, so drop_empty cannot leave "\
               f"{'them' if len(rows) > 1 else 'it'} out"

    if len(taken := np.intersect1d(sub.interface, empty)):
        raise InputError(f"interface of {sub.name!r}: {named(taken)}. Name other interface DOF")
    for port, w in sub.ports.items():
        if len(taken := empty[w.reshape(sub.size, -1)[empty].any(axis=1)]):
            raise InputError(f"port {port!r} of {sub.name!r}: {named(taken)}. Let the port act on other DOF")
    if isinstance(sub, ReducedSubstructure):
        raise InputError(f"{sub.name!r} is reduced: {named(empty)}")
    keep = np.setdiff1d(np.arange(sub.size), empty)
    M, K, D, H = (None if A is None else A[keep][:, keep] for A in (sub.M, sub.K, sub.D, sub.H))
    return Substructure(M, K, D, np.searchsorted(keep, sub.interface), {port: w[keep] for port, w in sub.ports.items()}, sub.name,
                        None if sub.dofs is None else sub.dofs.kept(keep), sub.sets, H)


def _kind(path: Path) -> str:
    """'M' or 'K' where the name of a file says that it holds a mass or a stiffness matrix, such as 'beam.sti'; else ''."""
    file, _, inside = str(path.name).partition(":")
    words = {word for word in re.split(r"[^a-z]+", (inside or file).lower()) if word}
    kinds = [kind for kind, names in NAMES.items() if words & names]
    return kinds[0] if len(kinds) == 1 else ""


def refuse_exchanged(M: Path, K: Path) -> None:
    """Refuses files of M and K that by their names are in each other's place."""
    if _kind(M) == "K" and _kind(K) == "M":
        raise InputError(f"M is {M}, which by its name holds a stiffness matrix, and K is {K}, by its name a mass matrix. The "
                         "mass comes first: read_component(M, K). If the names are wrong, rename the files")


def read_aligned(paths: Mapping[str, Path], usual: Mapping[str, str], frame: str,
                 masses: Collection[str], massless: bool, drop_empty: bool = False) -> tuple[dict[str, Matrix], DofMap | None]:
    """{key: matrix} from files, all on the rows of the matrix `frame` without DOF that Abaqus holds in it; and their DOF map.

    `usual` has the usual names of the matrices, for files with several. The matrices `masses` must have all DOF of the frame,
    unless `massless`. With `drop_empty` they may lack the DOF for which the frame has only zeros.
    """
    read = {}
    for key, path in paths.items():
        try:
            read[key] = read_labelled(path, usual=usual[key])
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
    target = read[frame].labels
    if unlike := [key for key, item in read.items() if (item.labels is None) != (target is None)]:
        raise InputError(f"{paths[frame]} and {paths[unlike[0]]} do not go together: one has node and DOF of each entry, the "
                         "other only row numbers. Write both with the same FORMAT")
    if target is None:
        return {key: item.matrix for key, item in read.items()}, None
    for key in masses:
        if (read[key].matrix.diagonal() >= HELD).any():
            raise InputError(f"{key} holds 1e36 on its diagonal ({paths[key]}), as Abaqus writes it into a stiffness matrix for "
                             "held DOF: are M and K swapped?")
    held = read[frame].matrix.diagonal() >= HELD
    rows = np.flatnonzero(~held)
    if not len(rows):
        raise InputError(f"{paths[frame]}: every DOF is held by a boundary condition (1e36 on the diagonal)")
    keys = target @ np.array([100, 1])
    matrices = {}
    for key, item in read.items():
        assert item.labels is not None
        own = item.labels @ np.array([100, 1])
        place = np.minimum(np.searchsorted(keys, own), len(keys) - 1)
        strange = keys[place] != own
        if strange.any():
            raise InputError(f"{key} has {int(strange.sum())} DOF that are not in {frame}, first "
                             f"{_named(item.labels[strange][0])} ({paths[key]}, {paths[frame]}). Both must be complete, and of "
                             "the same step of the same model")
        missing = np.setdiff1d(np.flatnonzero(~held), place)
        size = abs(read[frame].matrix)
        empty = missing[np.asarray(size.sum(axis=0) + size.sum(axis=1))[missing] == 0]
        missing = np.setdiff1d(missing, empty) if drop_empty else missing
        if key in masses and len(missing) and not massless:
            advice = "they have no mass, give massless=True" if len(empty) < len(missing) else \
                f"no element acts on them, as the zeros of {frame} say, leave them out by drop_empty=True"
            raise InputError(f"{frame} has {len(missing)} DOF that are not in {key}, first {_named(target[missing[0]])} "
                             f"({paths[frame]}, {paths[key]}). {key} may be cut short. If {advice}")
        entries = item.matrix.tocoo()
        whole = sp.csr_array((entries.data, (place[entries.row], place[entries.col])), shape=(len(keys), len(keys)))
        matrices[key] = whole[rows][:, rows] if held.any() else whole
    return matrices, dof_map(target[rows])


def _named(label: Array) -> str:
    return f"DOF {label[1]} of node {label[0]}"


def dof_numbers(what: str, references: Any, size: int, dofs: DofMap | None) -> list[int]:
    """DOF numbers from 0 of numbers, '12:uz', '12.3', '12:*' and (12, 'uz')."""
    if isinstance(references, (str, int, np.integer)) or (isinstance(references, tuple) and len(references) == 2
                                                          and isinstance(references[1], str) and dofs is not None):
        references = [references]
    if not isinstance(references, Iterable):
        raise InputTypeError(f"{what} must be DOF, as 3, '12:uz' or (12, 'uz'), not {references!r}")
    if isinstance(references, np.ndarray):
        references = references.tolist()
    found = list[int]()
    for reference in references:
        if isinstance(reference, (int, np.integer)) and not isinstance(reference, bool):
            if not 0 <= reference < size:
                raise InputError(f"{what}: there is no DOF {reference}; the model has {size}, counted from 0")
            found.append(int(reference))
            continue
        if isinstance(reference, str):
            separator = ":" if ":" in reference else "."
            node, _, motion = (part.strip() for part in reference.partition(separator))
        elif isinstance(reference, tuple) and len(reference) == 2:
            node, motion = str(reference[0]), str(reference[1])
        else:
            raise InputTypeError(f"{what}: {reference!r} is not a DOF. Give a number from 0, '12:uz', '12.3' or (12, 'uz')")
        if not node.lstrip("-").isdecimal() or not motion:
            raise InputError(f"{what}: {reference!r} is not a DOF. Give a number from 0, or node and motion: '12:uz', "
                             "'12.3', '12:*'")
        if dofs is None:
            raise InputError(f"{what}: {reference!r} names a node, but there is no DOF map. Give dofs, or the number of the DOF")
        if motion.isdecimal():
            motion = DIRECTIONS[int(motion) - 1] if 1 <= int(motion) <= len(DIRECTIONS) else f"dof{motion}"
        with naming(what):
            found += dofs.find(int(node), None if motion == "*" else motion).tolist()
    return found


def _column(port: str, value: Any, size: int, dofs: DofMap | None) -> Any:
    if sp.issparse(value) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
        return value
    w = np.zeros(size)
    weights = value if isinstance(value, Mapping) else dict.fromkeys(dof_numbers(f"port {port!r}", value, size, dofs), 1.0)
    for reference, weight in weights.items():
        w[dof_numbers(f"port {port!r}", reference, size, dofs)] = weight
    return w
