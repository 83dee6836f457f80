"""`write_superelement`: a reduced model for other programs, and beside it how far it may be trusted."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, choice, instance, path_of, whole_number, whole_numbers
from femsub.io.abaqus_calculix import DIRECTIONS, write_dofs
from femsub.io.atomic import Writer, write_or_refuse
from femsub.io.damage import announced
from femsub.io.model_folder import write_op4, write_single
from femsub.io.op4 import op4_module
from femsub.model import DofMap, ReducedSubstructure, Substructure


class Numbering(NamedTuple):
    """How modal coordinates are numbered in another program, and how many nodes its superelements may have."""

    per_part: int = 100_000  # the scalar points of superelement s have the numbers from s per_part on
    per_node: int = 1  # modal coordinates that share a number
    nodes: int | None = None


#: CalculiX' memory and time grow with the highest number of a node, which has three DOF or six; its user elements have 255 nodes
PROGRAMS = {name: Numbering() for name in ("nastran", "dmig", "abaqus")} | {
    "calculix": Numbering(per_part=1_000, per_node=3, nodes=255), "exudyn": Numbering()}
VALIDITY = "validity.json"
LARGEST_ID = 99_999_999  # the largest number in eight columns
DMIG = {"K": "KAAX", "M": "MAAX", "D": "BAAX", "H": "K4AAX"}
CASE = {"K": "K2GG", "M": "M2GG", "D": "B2GG", "H": "K42GG"}  # the commands of case control that take them
#: the matrices that EXTSEOUT writes into OP4, in this order; a matrix that a model does not have is a single 0
EXTSEOUT = ("kaa", "maa", "baa", "k4xx", "pa", "gpxx", "gdxx", "rvax", "va", "mug1", "mug1o", "mes1", "mes1o", "mee1", "mee1o",
            "mgpf", "mgpfo", "mef1", "mef1o", "mqg1", "mqg1o", "mqmg1", "mqmg1o")


def write_superelement(folder: str | Path, model: Substructure, program: str, full: Substructure | None = None,
                       number: int = 101, recover: str | Sequence[int] | None = None) -> list[Path]:
    """Write a reduced model as a superelement for another program: M, D, K of shape (r, r) and rows of V, which recover u = V q.

    Parameters
    ----------
    folder : str or Path
        Created if it does not exist.
    model : ReducedSubstructure or Substructure
        Its interface motions must be coordinates, as with `CraigBampton`. Coordinates that a DOF map calls 'ux', ..., 'rz' become
        DOF of their nodes, all others scalar points or nodes of their own. In a model that is not reduced, all coordinates are
        boundary. Nastran needs an interface.
    program : str
        See the table.
    full : Substructure, optional
        The full model, for Exudyn: the inertia of a floating frame does not follow from M alone.
    number : int
        Number of the superelement, 1 to 999. The numbers of its scalar points begin with it, so that one model may have several
        superelements.
    recover : 'all' or sequence of int, optional
        The nodes whose motions the other program can recover, by their numbers in the full model's DOF map. By default only the
        nodes of the interface. Each motion costs r numbers: 60,000 motions with 28 coordinates take 100 MB of DMIG.

    Returns
    -------
    list of Path
        The files written. Beside the files of the table there is always validity.json: the cut-off, the estimate of the error,
        what is recovered, and node, direction and kind of each coordinate. For Abaqus and CalculiX with `recover`, recovery.mtx
        has the rows of V and dofs.csv names them.

    Notes
    -----
    ===========  ==================================================  =========================================
    program      files                                               used there
    ===========  ==================================================  =========================================
    nastran      NAME.op4, NAME.asm, NAME.pch, as of EXTSEOUT         SEBULK, EXTOP4
    dmig         NAME.pch with KAAX, MAAX, MUG1T; 10 digits           K2GG = KAAX, M2GG = MAAX
    abaqus       NAME.inp with `*MATRIX INPUT`, K.mtx, M.mtx          `*INCLUDE`
    calculix     NAME.inp with `*MATRIX ASSEMBLE`, K.mtx, M.mtx       `*INCLUDE`; from version 2.21
    exudyn       NAME.npz                                             `ObjectFFRFreducedOrderInterface`
    ===========  ==================================================  =========================================

    NAME is the model's name with '_' in place of signs that are no letter or digit. Damping D is BAA, BAAX (B2GG) or D.mtx.
    Structural damping H is K4XX, K4AAX (K42GG) or H.mtx. CalculiX and Exudyn have no matrix for them. CalculiX takes at most 255
    nodes. Exudyn gets the elastic modes Ψ = V Φ of the model, with the shape integrals of Zwölfer and Gerstmayr (2020) over the
    full mass. Its file recovers all motions. `read_component` reads the files for Nastran back, `read_matrix` the matrices for
    Abaqus and CalculiX.

    Raises
    ------
    InputError
        An unknown program; interface motions that are not coordinates; for Nastran, no interface; a node to recover that the
        model does not have; more than a format can hold; a folder that cannot be written.
    MissingPackageError
        'nastran' without pyyeti.

    References
    ----------
    A. Zwölfer, J. Gerstmayr (2020): The nodal-based floating frame of reference formulation with modal reduction. Acta
    Mechanica 232, 835-851.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.block((1.0, 0.1, 0.1), (4, 1, 1), "hexahedron")
    >>> part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left"], name="arm")
    >>> rom = fs.reduce(part, fs.CraigBampton(modes=4))
    >>> sorted(path.name for path in fs.write_superelement("arm", rom, "dmig"))
    ['arm.pch', 'validity.json']
    """
    target = path_of("folder", folder)
    choice("program", program, PROGRAMS)
    whole_number("number", number, 1, LARGEST_ID // Numbering().per_part)
    full = None if full is None else instance("full", full, Substructure)
    places = _places(instance("model", model, Substructure), number, PROGRAMS[program])
    nodes: str | list[int] = [] if recover is None else choice("recover", recover, ("all",)) if isinstance(recover, str) else (
        sorted(set(whole_numbers("recover", recover).tolist())))
    # the rows of V that are written
    V, dofs = (model.V, model.full_dofs) if isinstance(model, ReducedSubstructure) else (np.zeros((0, model.size)), model.dofs)
    rows = np.arange(len(V)) if nodes == "all" else np.zeros(0, dtype=np.intp)
    if nodes and nodes != "all":
        if dofs is None or (missing := np.setdiff1d(nodes, dofs.nodes)).size:
            known = "its full model has no DOF map" if dofs is None else f"not node {missing[0]}"
            raise InputError(f"recover: {model.name!r} does not know these nodes: {known}. Name nodes of the full model's DOF "
                             "map, or 'all'")
        rows = np.flatnonzero(np.isin(dofs.nodes, nodes) & (len(V) > 0))  # models that are not reduced have no V
    name = "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in model.name)[:40] or "part"
    recovers = nodes
    if program == "exudyn":
        if recover not in (None, "all"):
            raise InputError("recover: Exudyn's file has the motions of all nodes; leave recover out")
        files, recovers = _exudyn(model, full, name), "all"
    else:
        maker = {"nastran": _nastran, "dmig": _dmig}.get(program, partial(_matrix_input, calculix=program == "calculix"))
        files = maker(model, places, name, rows)
    if program in ("nastran", "dmig") and isinstance(model, ReducedSubstructure):
        recovered = [node for node, _ in _recovery(model, places, rows)[0]]
        whole = model.full_dofs is not None and len(recovered) == len(np.unique(model.full_dofs.nodes))
        recovers = "all" if nodes == "all" and whole else recovered
    validity: Writer = partial(_validity, model=model, places=places, recovers=recovers)
    return write_or_refuse(f"the folder {folder}", target, files | {VALIDITY: validity})


@dataclass(frozen=True)
class Places:
    """(node, direction from 1) of each coordinate, the direction of a scalar point being 0; `order` has the boundary first."""

    labels: Array  # (r, 2)
    order: Array  # (r,) ascending by node and direction, scalar points last
    points: dict[int, Array]  # of the nodes that have a place
    kinds: tuple[str, ...]
    number: int
    boundary: Array  # (r,) bool: what other parts are joined to, not the modal coordinates

    @property
    def grids(self) -> dict[int, list[int]]:
        """The directions of each node that is no scalar point."""
        found: dict[int, list[int]] = {}
        for node, direction in self.labels[self.order].tolist():
            if direction:
                found.setdefault(node, []).append(direction)
        return found

    def scalars(self, boundary: bool | None = None) -> list[int]:
        """The numbers of all scalar points; only of those on the boundary, which come first, or only of the others."""
        return [int(self.labels[at, 0]) for at in self.order
                if not self.labels[at, 1] and boundary in (None, bool(self.boundary[at]))]


def _places(model: Substructure, number: int, numbering: Numbering) -> Places:
    """Node and direction of each coordinate in the other program."""
    per_part, per_node, _ = numbering
    if len(model.interface) != len(model.interface_numbers):
        raise InputError(f"the interface motions of {model.name!r} are no coordinates of the reduced model, and another "
                         "program can join nothing else. Use fs.CraigBampton, or another method that keeps them")
    kinds = ("physical",) * model.size
    dofs, rows = model.dofs, np.arange(model.size)
    if isinstance(model, ReducedSubstructure):
        dofs, rows, kinds = model.interface_dofs, model.interface, model.kinds
    boundary = np.isin(np.arange(model.size), rows)
    labels, points = np.zeros((model.size, 2), dtype=np.int64), dict[int, Array]()
    if dofs is not None:
        where = None if dofs.points is None else _spatial(dofs.points)
        for at, row in enumerate(rows):
            label = dofs.labels[dofs.components[at]]
            if label in DIRECTIONS:
                labels[row] = dofs.nodes[at], DIRECTIONS.index(label) + 1
                if where is not None:
                    points[int(dofs.nodes[at])] = where[at]
        if (labels[:, 1] > 0).any() and labels[labels[:, 1] > 0, 0].min() < 1:
            raise InputError(f"node {labels[labels[:, 1] > 0, 0].min()} of {model.name!r}: other programs count nodes from 1")
    free = np.flatnonzero(labels[:, 1] == 0)
    free = free[np.argsort(~boundary[free], kind="stable")]
    labels[free, 0] = max(number * per_part, int(labels[:, 0].max())) + 1 + np.arange(len(free)) // per_node
    if per_node > 1:
        labels[free, 1] = np.arange(len(free)) % per_node + 1
    if labels[:, 0].max() > LARGEST_ID:
        raise InputError(f"node {labels[:, 0].max()} of {model.name!r} has more than eight digits")
    order = np.lexsort((labels[:, 1], labels[:, 0], labels[:, 1] == 0))
    return Places(labels, order, points, kinds, number, boundary)


def _spatial(points: Array) -> Array:
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def _validity(file: BinaryIO, model: Substructure, places: Places, recovers: str | list[int]) -> None:
    method, estimate = (model.method, model.estimate) if isinstance(model, ReducedSubstructure) else ("full", None)
    about: dict[str, Any] = {
        "name": model.name, "method": method, "unit of frequencies": "rad per unit of time",
        "cutoff": None if np.isinf(model.cutoff) else model.cutoff, "estimate": None if estimate is None else estimate.record(),
        "recovered nodes": recovers if recovers else "none but the interface",
        "coordinates": [{"node": int(node), "direction": int(direction), "kind": kind}
                        for (node, direction), kind in zip(places.labels, places.kinds, strict=True)]}
    file.write((json.dumps(about, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def trust(model: Substructure) -> str:
    """One line for the head of a file: up to where the model may be trusted."""
    limit = "complete, without a cut-off" if np.isinf(model.cutoff) else f"cut-off {model.cutoff:.6g} rad per unit of time"
    estimate = model.estimate if isinstance(model, ReducedSubstructure) else None
    error = "no estimate of its error" if estimate is None else f"estimated error {estimate.worst:.1e} to {estimate.band[1]:.6g}"
    return f"{limit}, {error}: see {VALIDITY}"


def _ordered(model: Substructure, places: Places) -> dict[str, Array]:
    """K, M and, where they are not 0, D and H in the order of the places, dense."""
    parts = {"K": model.K, "M": model.M, "D": model.D} | ({} if model.H is None else {"H": model.H})
    dense = {key: part.toarray() if sp.issparse(part) else np.asarray(part) for key, part in parts.items()}
    return {key: part[np.ix_(places.order, places.order)] for key, part in dense.items() if key in "KM" or np.any(part)}


def _recovery(model: Substructure, places: Places, rows: Array) -> tuple[list[tuple[int, int]], Array]:
    """(node, first row from 1) in MUG1, and MUG1 itself, (6 nodes, r): six rows for each node whose motions have directions."""
    if not isinstance(model, ReducedSubstructure) or model.full_dofs is None:
        return [], np.zeros((0, model.size))
    dofs = model.full_dofs
    known = [DIRECTIONS.index(label) if label in DIRECTIONS else -1 for label in dofs.labels]
    direction = np.array(known, dtype=np.int64)[dofs.components]
    rows = rows[direction[rows] >= 0]
    nodes, index = np.unique(dofs.nodes[rows], return_inverse=True)
    table = np.zeros((6 * len(nodes), model.size))
    table[6 * index + direction[rows]] = model.V[rows][:, places.order]
    if not table.any():  # no program reads a matrix without entries
        return [], np.zeros((0, model.size))
    return [(int(node), 6 * at + 1) for at, node in enumerate(nodes)], table


def _card(name: str, *values: Any) -> Iterator[str]:
    """A card of small fields: its name, and eight values on each line."""
    for start in range(0, len(values), 8):
        yield f"{'' if start else name:8}" + "".join(f"{value!s:>8}" for value in values[start:start + 8])


def _grid_lines(points: dict[int, Array]) -> Iterator[str]:
    for node, point in points.items():
        x, y, z = (sixteen(value) for value in point)
        yield f"GRID*   {node:16d}{0:16d}{x}{y}"
        yield f"*       {z}{0:16d}"


def sixteen(value: float) -> str:
    """A number in sixteen columns with as many digits as they hold, as 1.2345678901D+02."""
    for digits in range(15, 7, -1):
        text = f"{value:.{digits}E}".replace("E", "D")
        if len(text) <= 16:
            return f"{text:>16}"
    raise InputError(f"{value} has no room in sixteen columns")


def _head(model: Substructure, what: str) -> list[str]:
    return [f"$ {what} of {' '.join(model.name.encode('ascii', 'replace').decode().split())}, by femsub", f"$ {trust(model)}"]


def _placed(model: Substructure, places: Places) -> dict[int, Array]:
    """The points of the boundary's grids; an error if there are no boundary DOF, or a grid has no point."""
    if not places.boundary.any():
        raise InputError(f"{model.name!r} has no interface, and Nastran joins a superelement by nothing else. Name interface DOF "
                         "before you reduce it, or write its matrices with write_matrices")
    if missing := [node for node in places.grids if node not in places.points]:
        raise InputError(f"node {missing[0]} of {model.name!r} has no place: Nastran needs the points of its DOF map")
    return {node: places.points[node] for node in places.grids}


def _scalar_lines(places: Places, name: str, *before: int, boundary: bool | None = None) -> Iterator[str]:
    scalars = places.scalars(boundary)
    return _card(name, *before, scalars[0], "THRU", scalars[-1]) if scalars else iter(())


def _set_lines(places: Places) -> list[str]:
    """Which scalar points are boundary, and which are modal coordinates."""
    return [*_scalar_lines(places, "BSET1", 0, boundary=True), *_scalar_lines(places, "QSET1", 0, boundary=False)]


def _tug1(recovered: list[tuple[int, int]], size: int) -> Iterator[str]:
    """DTI cards with the rows of MUG1."""
    if recovered:
        yield from _card("DTI", "TUG1", 0, 6 * len(recovered), size, 32767, 0, 7, 0, "PHIP", "", 7, "", "", "REAL", 1, "ENDREC")
        yield from _card("DTI", "TUG1", 1, *(word for column in range(1, size + 1) for word in (column, 0.0)), "ENDREC")
        yield from _card("DTI", "TUG1", 2, *[""] * 6, *("TYPE", "ID", "COMP", "ROW") * 2,
                         *(word for node, row in recovered for word in (1, node, 6, row)), "ENDREC")


def _nastran(model: Substructure, places: Places, name: str, rows: Array) -> dict[str, Writer]:
    points, matrices = _placed(model, places), _ordered(model, places)
    recovered, table = _recovery(model, places, rows)
    size, number = model.size, places.number
    parts: dict[str, Any] = {key: np.zeros((1, 1)) for key in EXTSEOUT}
    parts |= {"kaa": matrices["K"], "maa": matrices["M"], "va": np.ones((size, 1))}
    parts |= {name: matrices[key] for key, name in (("D", "baa"), ("H", "k4xx")) if key in matrices}
    parts |= {"mug1": table} if recovered else {}
    inner = {}
    if isinstance(model, ReducedSubstructure) and model.full_dofs is not None and model.full_dofs.points is not None:
        here = dict(zip(model.full_dofs.nodes.tolist(), _spatial(model.full_dofs.points), strict=True))
        inner = {node: here[node] for node, _ in recovered if node not in points}
    ids = [*places.grids, *places.scalars()]
    joined = [value for node in ids for value in (node, node)]
    extrn = [value for node in ids for value in (node, "".join(map(str, places.grids.get(node, [0]))))]
    sets: dict[str, list[int]] = {}
    for node, directions in places.grids.items():
        sets.setdefault("".join(map(str, directions)), []).append(node)
    boundary = [*_grid_lines(points), *_scalar_lines(places, "SPOINT")]
    asm = [*_head(model, "External superelement"), "$ for the main bulk data of the assembly run",
           *_card("SEBULK", number, "EXTOP4", "", "MANUAL", "", "", number),
           *_card("SECONCT", number, 0, "", "NO", *[""] * 4, *joined), *boundary]
    pch = [*_head(model, "External superelement"), "$ for the end of the assembly run", *_card("BEGIN SUPER", number),
           *_card("EXTRN", *extrn), *boundary, *_grid_lines(inner),
           *(line for directions, nodes in sets.items() for line in _card("ASET1", directions, *nodes)),
           *_set_lines(places), *_tug1(recovered, size)]
    texts: dict[str, Writer] = {f"{name}.{ending}": partial(_write_lines, lines=announced(lines))
                                for ending, lines in (("asm", asm), ("pch", pch))}
    return {f"{name}.op4": partial(write_op4, op4=op4_module(), parts=parts)} | texts


def _write_lines(file: BinaryIO, lines: Sequence[str]) -> None:
    file.write(("\n".join(lines) + "\n").encode("ascii"))


def _dmig(model: Substructure, places: Places, name: str, rows: Array) -> dict[str, Writer]:
    points, matrices = _placed(model, places), _ordered(model, places)
    recovered, table = _recovery(model, places, rows)
    labels = places.labels[places.order].tolist()

    def write(file: BinaryIO) -> None:
        lines = [*_head(model, "Superelement"), "$ " + ", ".join(f"{CASE[key]} = {DMIG[key]}" for key in matrices),
                 *_grid_lines(points), *_scalar_lines(places, "SPOINT"), *_set_lines(places), *_tug1(recovered, model.size)]
        for key, matrix in matrices.items():
            form = 6 if np.array_equal(matrix, matrix.T) else 1
            lines += _dmig_lines(DMIG[key], form, np.tril(matrix) if form == 6 else matrix, labels, labels)
        if recovered:
            lines += _dmig_lines("MUG1T", 9, table.T, labels, [[column, 0] for column in range(1, len(table) + 1)])
        _write_lines(file, announced(lines))

    return {f"{name}.pch": write}


def _dmig_lines(name: str, form: int, matrix: Array, rows: list[list[int]], columns: list[list[int]]) -> list[str]:
    lines = [f"DMIG    {name:8}{0:8d}{form:8d}{2:8d}{0:8d}{'':8}{'':8}{len(columns) if form == 9 else '':>8}"]
    for j in range(matrix.shape[1]):
        entries = np.flatnonzero(matrix[:, j])
        if len(entries):
            lines.append(f"DMIG*   {name:16}{columns[j][0]:16d}{columns[j][1]:16d}")
            lines += [f"*       {rows[i][0]:16d}{rows[i][1]:16d}{sixteen(float(matrix[i, j]))}" for i in entries]
    return lines


def _matrix_input(model: Substructure, places: Places, name: str, rows: Array, calculix: bool) -> dict[str, Writer]:
    """Lines 'node,DOF,node,DOF,entry', of one triangle if the matrix is symmetric, and the deck that reads them."""
    matrices, most_nodes = _ordered(model, places), PROGRAMS["calculix"].nodes
    labels = places.labels[places.order].copy()
    labels[:, 1] = np.maximum(labels[:, 1], 1)  # a scalar point is the first DOF of a node of its own
    nodes = np.unique(labels[:, 0])
    if calculix:
        _undamped(model, "CalculiX")
    if calculix and most_nodes is not None and len(nodes) > most_nodes:
        raise InputError(f"the superelement of {model.name!r} would have {len(nodes)} nodes, and CalculiX takes {most_nodes} at "
                         "most: reduce its interface")
    full = {key: bool(np.array_equal(matrix, matrix.T)) for key, matrix in matrices.items()}
    zero = np.zeros(3)
    lines = [line.replace("$", "**") for line in _head(model, "Superelement")]
    lines += ["*NODE" + (f", NSET=P{places.number}" if calculix else ""),
              *(f"{node}, " + ", ".join(f"{value:.16g}" for value in places.points.get(node, zero)) for node in nodes.tolist())]
    if calculix:
        lines.append(f"*MATRIX ASSEMBLE, NAME=P{places.number}, STIFFNESS FILE=K.mtx, MASS FILE=M.mtx")
        lines += ["** no element has it, but a dynamic step asks for a density", f"*MATERIAL, NAME=P{places.number}", "*DENSITY",
                  "1."]
        most = 6 if labels[:, 1].max() > 3 else 3
        used = {(node, direction) for node, direction in labels.tolist()}
        idle = [(node, direction) for node in nodes.tolist() for direction in range(1, most + 1) if (node, direction) not in used]
        lines += ["** DOF that the superelement does not have", "*BOUNDARY"] * bool(idle)
        lines += [f"{node}, {direction}, {direction}" for node, direction in idle]
    else:
        names = {"K": "STIFFNESS", "M": "MASS", "D": "VISCOUS DAMPING", "H": "STRUCTURAL DAMPING"}
        lines += [f"*MATRIX INPUT, NAME=FEMSUB_{key}, INPUT={key}.mtx" + ", TYPE=UNSYMMETRIC" * (not full[key])
                  for key in matrices]
        lines.append("*MATRIX ASSEMBLE, " + ", ".join(f"{names[key]}=FEMSUB_{key}" for key in matrices))
    files: dict[str, Writer] = {f"{name}.inp": partial(_write_lines, lines=lines)}
    # CalculiX takes the places of M's entries from K; each row has its diagonal, as these programs write it
    pattern = np.any([matrix != 0 for matrix in matrices.values()], axis=0) | np.eye(model.size, dtype=bool)
    keep = {key: np.tril(pattern) if symmetric else pattern for key, symmetric in full.items()}
    for key, matrix in matrices.items():
        i, j = np.nonzero(keep[key])
        table = zip(labels[i].tolist(), labels[j].tolist(), matrix[i, j].tolist(), strict=True)
        files[f"{key}.mtx"] = partial(_write_lines, lines=[
            f"{row[0]},{row[1]},{column[0]},{column[1]},{value:.16e}" for row, column, value in table])
    if isinstance(model, ReducedSubstructure) and len(rows):
        files["recovery.mtx"] = partial(write_single, part=model.V[np.ix_(rows, places.order)], name="recovery.mtx")
        if (dofs := model.full_dofs) is not None:
            where = None if dofs.points is None else dofs.points[rows]
            files["dofs.csv"] = partial(write_dofs, dofs=DofMap(dofs.nodes[rows], dofs.components[rows], dofs.labels, where))
    return files


def _undamped(model: Substructure, program: str) -> None:
    D = model.D.data if sp.issparse(model.D) else model.D
    if np.any(D) or model.H is not None:
        raise InputError(f"{model.name!r} has damping, and {program} has no matrix for it: write "
                         "model.with_damping(None).with_structural_damping(None), and give the damping there")


def _exudyn(model: Substructure, full: Substructure | None, name: str) -> dict[str, Writer]:
    """The file that Exudyn's `ObjectFFRFreducedOrderInterface.LoadFromFile` reads, in version 1 of the format."""
    if not isinstance(model, ReducedSubstructure) or full is None or full.dofs is None or full.dofs.points is None:
        raise InputError("Exudyn needs a reduced model, and the full one, full=, with a DOF map with the places of its nodes")
    from scipy.linalg import eigh, null_space

    _undamped(model, "Exudyn's file")
    dofs = full.dofs
    if full.size != len(model.V) or set(dofs.labels) - set(DIRECTIONS[:3]):
        raise InputError(f"full has {full.size} DOF and the motions {', '.join(dofs.labels)}; Exudyn's bodies move by ux, uy, "
                         f"uz, and V of the reduced model has {len(model.V)} rows")
    nodes, first, index = np.unique(dofs.nodes, return_index=True, return_inverse=True)
    direction = np.array([DIRECTIONS.index(label) for label in dofs.labels])[dofs.components]
    entries, rows = sp.coo_array(full.M), 3 * index + direction
    n = 3 * len(nodes)
    M = sp.csr_array((entries.data, (rows[entries.row], rows[entries.col])), shape=(n, n))
    x = _spatial(full.dofs.points[first]).ravel()
    # elastic modes with unit modal masses, and their ω²; rigid motion is the frame's
    reduced_M, reduced_K, motion = np.asarray(model.M), np.asarray(model.K), model.rigid_motion
    rigid = np.zeros((model.size, 0)) if motion is None or not hasattr(motion, "shapes") else motion.shapes
    Q = null_space((reduced_M @ rigid).T) if rigid.shape[1] else np.eye(model.size)
    try:
        stiffness, elastic = eigh(Q.T @ reduced_K @ Q, Q.T @ reduced_M @ Q)
    except np.linalg.LinAlgError:
        raise InputError(f"M of {model.name!r} is singular, and Exudyn needs a mass for each mode. Reduce by another method, "
                         "such as fs.Rubin: fs.MacNeal leaves the interface without mass") from None
    shapes = np.zeros((n, len(stiffness)))
    shapes[rows] = model.V @ (Q @ elastic)
    # the constant matrices of Zwölfer and Gerstmayr (2020), named as in Exudyn
    moved = np.tile(np.eye(3), (len(nodes), 1))
    x_tilde, tilde = _skew(x[:, None]), _skew(shapes)
    Mtt = moved.T @ (M @ moved)
    mass = float(Mtt[0, 0])
    centre = moved.T @ (M @ x) / mass
    data: dict[str, Any] = {
        "inertiaLocal": x_tilde.T @ (M @ x_tilde), "Mtt": Mtt, "totalMass": np.array(mass), "chiU": centre,
        "chiUtilde": _skew(centre[:, None]), "mPsiTildePsi": tilde.T @ (M @ shapes), "mPsiTildePsiTilde": tilde.T @ (M @ tilde),
        "mPhitTPsi": moved.T @ (M @ shapes), "mPhitTPsiTilde": moved.T @ (M @ tilde),
        "mXRefTildePsi": x_tilde.T @ (M @ shapes), "mXRefTildePsiTilde": x_tilde.T @ (M @ tilde)}
    data |= {"modeBasis": shapes, "trigList": np.zeros((0, 3), dtype=int), "massMatrixReduced": np.eye(len(stiffness)),
             "stiffnessMatrixReduced": np.diag(stiffness),
             "infoList": np.array([len(stiffness), len(nodes), 3, 4, 7, 7 + len(stiffness)]),
             "rigidBodyNodeType": "NodeType.RotationEulerParameters", "xRef": x, "fileVersion": 1,
             "postProcessingModes": np.array({}, dtype=object), "type": "ObjectFFRFreducedOrderInterface"}
    return {f"{name}.npz": lambda file: np.savez(file, **data)}


def _skew(columns: Array) -> Array:
    """Skew matrices of the vectors in the columns, (3 n, k) to (3 n, 3 k)."""
    x, y, z = (columns[axis::3] for axis in range(3))
    found = np.zeros((len(columns), 3 * columns.shape[1]))
    found[0::3, 1::3], found[0::3, 2::3] = -z, y
    found[1::3, 0::3], found[1::3, 2::3] = z, -x
    found[2::3, 0::3], found[2::3, 1::3] = -y, x
    return found
