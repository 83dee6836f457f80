"""Nastran's external superelements: matrices in OP4 or DMIG, and the grids, frames and order of their DOF in .asm and .pch."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, POSITION, Array, InputError, Matrix, warn
from femsub.io.abaqus_calculix import DIRECTIONS, TextMatrix
from femsub.io.damage import MOST, check_room, existing
from femsub.io.dmig import cards_of, dmig_of, quadruples, whole
from femsub.io.nastran import Systems, systems_of, tables_of
from femsub.io.op2 import read_op2
from femsub.io.op4 import read_op4
from femsub.io.sierra import read_cbr
from femsub.model import DofMap, ReducedSubstructure, Substructure, of_few_digits

NETCDF = (".nc", ".nc4")  # of Sierra/SD
ENDINGS = (".op4", ".op2", ".asm", ".pch", ".bdf", ".nas", ".dat", *NETCDF)
BOUNDARY = "boundary"  # the name of the set of all boundary DOF
RIGID = 5e-10  # relative to the largest entry, forces that ten digits leave in rigid motion; a softer support counts as none


def read_superelement(path: Path, name: str | None, cutoff: float | None) -> ReducedSubstructure:
    """An external superelement of Nastran (EXTSEOUT) from any one of its files, which stand beside each other; or of Sierra/SD.

    ===================  =======================================================================================
    it reads             .op4 (EXTSEOUT MATOP4, KAA or KXX, MAA or MXX, BAA, MUG1) with .asm or .pch; .op2 with
                         them, or alone (EXTSEOUT DMIGOP2); DMIG cards
                         (EXTSEOUT DMIGPCH, K2GG, M2GG) with .pch, .asm or their own deck; EXTRN, SECONCT, GRID,
                         CORD1x, CORD2x, SPOINT, BSET, BSET1, QSET, QSET1, DTI TUG1
                         .nc of Sierra/SD, see `femsub.io.sierra.read_cbr`
    it turns             the motions of a boundary grid in a frame of its own (CD) into those along the basic axes
    it recovers          u = V q: the boundary, the modal coordinates themselves, called 'q', and other grids (MUG1)
    it refuses           an order of DOF that does not fit the matrices, grids that are missing, several
                         superelements in a file, whatever `read_op4` and `read_dmig` refuse
    it cannot know       up to which frequency modes were kept; units; the frame of recovered grids that the files
                         do not list (their motions are called 'ux@own', ...)
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    # the files of the same name in this folder, by their endings in small letters; the file itself where there are several
    deck, ending = _Deck(existing(path)), path.suffix.lower()
    files = {other.suffix.lower(): other for other in sorted(path.parent.iterdir())
             if other.stem == path.stem and other.suffix.lower() in ENDINGS and other.is_file()} | {ending: path}
    # a Craig-Bampton model of Sierra/SD: its nodes as grids, its modes as scalar points behind the last of them
    if ending in NETCDF:
        (matrices, labels, points), deck.program = read_cbr(path), "Sierra/SD"
        modes = labels[:, 0] == 0
        numbers = np.where(modes, max(points) + np.cumsum(modes), labels[:, 0])
        deck.cards += [("GRID", [str(node), "", *(f"{one:.17e}" for one in where)]) for node, where in points.items()]
        deck.cards.append(("SPOINT", [str(number) for number in numbers[modes]]))
        dofs = list(zip(numbers.tolist(), np.where(modes, 0, labels[:, 1]).tolist(), strict=True))
        if any(not 0 <= direction <= 6 for _, direction in dofs) or min(points) < 1:
            raise InputError(f"{path} is damaged: cbmap has a direction beyond 6, or a node below 1")
        M, K, D = (_dense(path, A) for A in matrices)
        raw = _Raw(M, K, D if D.any() else None, None, dofs, np.zeros((0, len(K))), [])
        return _assembled(deck, raw, path.stem if name is None else name, cutoff)
    # cards
    of_op2, cards = read_op2(path) if ending == ".op2" else ({}, [])
    deck.cards += cards
    beside = () if cards else (".asm", ".pch") if ending in (".op4", ".op2", ".asm", ".pch") else (ending,)
    for other in (one for one in beside if one in files):
        deck.add(files[other])
    if not deck.cards:
        raise InputError(f"{path} has neither {path.stem}.asm nor {path.stem}.pch beside it, which list the DOF of a "
                         f"superelement. Copy them there, or read its matrices alone, "
                         f"read_component('{path.name}:maa', '{path.name}:kaa')")
    # matrices, whose rows are in the order that the cards give, or DMIG's with grid and direction of their rows
    if ending != ".op2" and any(card == "DMIG" for card, _ in deck.cards):
        found = dmig_of(path, deck.cards)
        end = _pair(path, found)
        known = {key: set(map(tuple, places.tolist())) for key in (f"{letter}{end}" for letter in ("k", "m", "b", "k4"))
                 if key in found and (places := found[key].labels) is not None}
        rows = sorted(set().union(*known.values()))
        for key, what in ((f"k{end}", "stiffness"), (f"m{end}", "mass")):
            if lost := sorted(set(rows) - known.get(key, set())):
                warn(f"{path}: {key.upper()} has no entries for {len(lost)} of {len(rows)} DOF, first grid {lost[0][0]}, "
                     f"direction {lost[0][1]}: they count as without {what}. If they have it, the file is damaged")
        raw = _raw(deck, path, found, rows, written=True)
    elif ending == ".op2":
        raw = _raw(deck, path, of_op2, deck.order())
    elif ".op4" in files:
        found = {name: TextMatrix(matrix) for name, matrix in read_op4(files[".op4"]).items()}
        raw = _raw(deck, files[".op4"], found, deck.order())
    else:
        raise InputError(f"{path} has no DMIG cards, and there is no {path.stem}.op4 beside it with the matrices")
    return _assembled(deck, raw, path.stem if name is None else name, cutoff)


@dataclass
class _Deck:
    """The cards of a superelement's files."""

    path: Path
    cards: list[tuple[str, list[str]]] = field(default_factory=list)
    supers: set[str] = field(default_factory=set)
    named: int = 0  # number of points in ranges so far
    program: str = "Nastran"

    def add(self, file: Path) -> None:
        cards = cards_of(file)
        self.supers |= {number for card, (number, *_) in cards if card == "BEGIN SUPER"}
        if len(self.supers) > 1:
            raise InputError(f"{file} holds the superelements {', '.join(sorted(self.supers))}: write a file for each")
        self.cards += cards

    def of(self, *names: str) -> Iterable[tuple[str, list[str]]]:
        return ((card, fields) for card, fields in self.cards if card in names)

    def listed(self, card: str, fields: list[str]) -> list[int]:
        """Whole numbers, also as 'from THRU to'."""
        words, found = [word for word in reversed(fields) if word], list[int]()
        while words:
            start = whole(self.path, card, words.pop(), 1)
            if words and words[-1].upper() == "THRU":
                stop = whole(self.path, card, "".join(words[-2:-1]), start)
                self.named += stop - start
                if self.named > MOST:
                    raise InputError(f"{self.path}: {card} names the points {start} to {stop}, which are too many")
                found += range(start, stop + 1)
                del words[-2:]
            else:
                found.append(start)
        return found

    def order(self) -> list[tuple[int, int]]:
        """(grid, direction) of the rows, as EXTRN lists them, else the grids that SECONCT joins with six directions each."""
        found: list[tuple[int, int]] = []
        scalar = self.scalar()
        for card, fields in self.of("EXTRN"):
            for grid, directions in quadruples(fields, 2):
                number = whole(self.path, card, grid, 1)
                if number in scalar:
                    found.append((number, 0))
                    continue
                if not re.fullmatch(r"0?|[1-6]{1,6}", directions) or len(set(directions)) < len(directions):
                    raise InputError(f"{self.path}: {directions!r:.30} are no directions of the grid {number}; they are 0 of a "
                                     "scalar point, or of 1 to 6")
                found += [(number, int(digit)) for digit in sorted(directions or "0")]
        joined: list[tuple[int, int]] = []
        for card, fields in self.of("SECONCT"):
            words, at = [word for word in fields[8:] if word], 0
            while at < len(words):
                span = 6 if [word.upper() for word in words[at + 1:at + 2]] == ["THRU"] else 2
                for number in self.listed(card, words[at:at + span // 2]):
                    joined += [(number, 0)] if number in scalar else [(number, direction) for direction in range(1, 7)]
                at += span
        points = dict(found)
        if found and (lost := [point for point, _ in joined if point not in points]):
            raise InputError(f"{self.path}: SECONCT joins the point {lost[0]}, which EXTRN does not have: {self.path.stem}.asm "
                             "and .pch belong to different runs, or a line of EXTRN is lost")
        if not (found or joined):
            raise InputError(f"{self.path}: neither EXTRN nor SECONCT gives the order of the DOF. Copy {self.path.stem}.pch "
                             "beside it, which EXTSEOUT writes with EXTBULK")
        return found or joined

    def scalar(self) -> set[int]:
        return {number for card, fields in self.of("SPOINT") for number in self.listed(card, fields)}

    def modal(self) -> set[int]:
        """Scalar points that are not in the b-set, and points of the q-set."""
        return (self.scalar() - self.fixed()) | self.points_of("QSET")

    def fixed(self) -> set[int]:
        """Points of the b-set, which the modes of the superelement hold."""
        return self.points_of("BSET", "BNDFIX")

    def points_of(self, *names: str) -> set[int]:
        """Points of cards such as BSET, which has directions behind each point, and BSET1, which has them before all points."""
        found = {number for card, fields in self.of(*(f"{name}1" for name in names)) for number in self.listed(card, fields[1:])}
        return found | {whole(self.path, card, grid, 1) for card, fields in self.of(*names) for grid, _ in quadruples(fields, 2)}

    def recovered(self) -> list[tuple[int, int, int]]:
        """(grid, count of directions, first row of MUG1 from 1), as DTI TUG1 lists them."""
        found: list[tuple[int, int, int]] = []
        for card, fields in self.of("DTI"):
            if fields[:2] == ["TUG1", "2"]:
                for kind, grid, count, row in quadruples([word for word in fields[2:] if word and word != "ENDREC"]):
                    if kind.isdecimal() and kind not in ("1", "2"):
                        warn(f"{self.path}: {card} TUG1 has a point of the kind {kind:.20}, but kinds are 1 (grid) and 2 (scalar "
                             "point): its motions are left out. Is it damaged?")
                    if kind == "1":
                        grid_, count_, row_ = (whole(self.path, f"{card} TUG1", text, 1) for text in (grid, count, row))
                        found.append((grid_, count_, row_))
        rows = sorted((row, row + count) for _, count, row in found)
        if any(count > 6 for _, count, _ in found) or len({grid for grid, *_ in found}) < len(found) or any(
                stop > start for (_, stop), (start, _) in pairwise(rows)):
            raise InputError(f"{self.path}: DTI TUG1 names a grid twice, more than six motions of one, or a row of MUG1 twice")
        return found


@dataclass(frozen=True)
class _Raw:
    """Matrices as in the files, (grid, direction) of their rows, and the motions that the superelement recovers."""

    M: Array
    K: Array
    D: Array | None
    H: Array | None
    rows: list[tuple[int, int]]
    recovery: Array  # (m, n)
    recovered: list[tuple[int, int]]
    written: bool = False  # in the ten digits of DMIG cards


def _pair(path: Path, matrices: Mapping[str, TextMatrix]) -> str:
    """The letters behind K and M in the names of the superelement's matrices, as 'aa' in KAA and MAA."""
    sizes = {name: item.matrix.shape[0] for name, item in matrices.items() if item.matrix.shape[0] == item.matrix.shape[1]}
    # matrices of DMIG cards leave out rows of zeros, as those of DOF without mass
    ends = [name[1:] for name in sizes if name[0] == "k" and (other := f"m{name[1:]}") in sizes and (
        sizes[name] == sizes[other] or all(matrices[one].labels is not None for one in (name, other)))]
    ends = [end for end in ends if sizes[f"k{end}"] > 1] or ends
    if len(ends) != 1:
        listed = ", ".join(f"{name} {item.matrix.shape[0]} x {item.matrix.shape[1]}" for name, item in matrices.items())
        raise InputError(f"{path} should hold one pair of stiffness and mass, as KAA and MAA, but holds {listed or 'nothing'}. "
                         f"Name them: read_component('{path.name}:m...', '{path.name}:k...')")
    return ends[0]


def _raw(deck: _Deck, file: Path, found: Mapping[str, TextMatrix], rows: list[tuple[int, int]], written: bool = False) -> _Raw:
    """The matrices of a file on these rows, and the motions that it recovers."""
    end, n, place = _pair(file, found), len(rows), {row: at for at, row in enumerate(rows)}
    check_room(file, 8 * 10 * n ** 2)  # the matrices, as they are and turned

    def spread(name: str) -> Array:
        dense, labels = _dense(file, found[name].matrix), found[name].labels
        at = [] if labels is None else [place.get((grid, direction), -1) for grid, direction in labels.tolist()]
        if not at or min(at) < 0:
            return dense
        whole = np.zeros((n, n))
        whole[np.ix_(at, at)] = dense
        return whole

    K, M = spread(f"k{end}"), spread(f"m{end}")
    if len(K) != n:
        raise InputError(f"{file}: K{end.upper()} has {len(K)} rows, but the cards beside it name {n} DOF. They belong to "
                         "different runs, or the .pch with EXTRN is missing")
    D, H = (next((part for name in names if name in found and (part := spread(name)).shape == K.shape and part.any()), None)
            for names in ((f"b{end}", f"b{end}1"), (f"k4{end}", f"k4{end}1", "k4xx")))
    # motions that are recovered: the rows of MUG1, which DTI TUG1 lists, or the columns of MUG1T that are there
    tug, table, turned = deck.recovered(), found.get("mug1"), found.get("mug1t")
    at = [(grid, direction + 1, row + direction) for grid, count, row in tug for direction in range(count)]
    motions = np.zeros((0, n))
    if written:
        named, numbered = ([] if labels is None else [(grid, direction) for grid, direction in labels.tolist()]
                           for labels in ((turned.rows, turned.columns) if turned else (None, None)))
        columns = {column: number for number, (column, _) in enumerate(numbered)}
        if tug and max(columns, default=0) < tug[-1][2]:
            warn(f"{file}: DTI TUG1 names {len(tug)} grids to recover, but MUG1T has no motion of the last, {tug[-1][0]}: it "
                 "does not move, or the file is cut short")
        at = [(grid, direction, columns[row] + 1) for grid, direction, row in at if row in columns]
        if strange := set(named) - place.keys():
            warn(f"{file}: MUG1T has motions by grid {min(strange)[0]}, direction {min(strange)[1]}, which is no DOF of the "
                 "superelement: no motions of other grids are recovered. Is a number damaged?")
        elif turned is not None:
            motions = np.zeros((len(columns), n))
            motions[:, [place[row] for row in named]] = _dense(file, turned.matrix).T
    elif table is not None and tug and table.matrix.shape[1] != n:
        warn(f"{file}: motions of other grids are not recovered, since MUG1 has {table.matrix.shape[1]} columns, and "
             f"K{end.upper()} {n} rows")
    elif table is not None and not tug and sp.coo_array(table.matrix).nnz:  # Nastran writes one 0 where nothing is recovered
        warn(f"{file}: motions of other grids are not recovered, since no DTI TUG1 beside it lists the rows of MUG1")
    elif table is not None and tug:
        motions = _dense(file, table.matrix)
        if (last := max(row for _, _, row in at)) > len(motions):
            raise InputError(f"{file}: MUG1 has {len(motions)} rows, but DTI TUG1 names row {last}")
    at = at if len(motions) else []
    recovery = motions[np.array([row for _, _, row in at], dtype=np.intp) - 1]
    return _Raw(M, K, D, H, rows, recovery, [(grid, direction) for grid, direction, _ in at], written)


def _dense(path: Path, matrix: Matrix) -> Array:
    check_room(path, 8 * matrix.shape[0] * matrix.shape[1])
    dense = matrix.toarray() if sp.issparse(matrix) else np.asarray(matrix)
    if np.iscomplexobj(dense):
        raise InputError(f"{path}: a matrix of the superelement is complex; only real ones are read")
    if not np.isfinite(dense).all():
        raise InputError(f"{path}: a matrix of the superelement holds a NaN or Inf")
    return np.asarray(dense, dtype=float)


def _assembled(deck: _Deck, raw: _Raw, name: str, cutoff: float | None) -> ReducedSubstructure:
    path = deck.path
    if len(set(raw.rows)) < len(raw.rows):
        raise InputError(f"{path}: a DOF stands twice in the order of the superelement's DOF")
    checked = Substructure(raw.M, raw.K, raw.D, H=raw.H)
    points, fixed = deck.modal(), deck.fixed()
    modal = np.array([grid in points or (direction == 0 and grid not in fixed) for grid, direction in raw.rows])
    used = (raw.K != 0).any(axis=0) | (raw.M != 0).any(axis=0)
    order = np.concatenate([np.flatnonzero(~modal), np.flatnonzero(modal & used)])
    boundary = [raw.rows[row] for row in np.flatnonzero(~modal)]
    if not boundary:
        raise InputError(f"{path}: the superelement has no boundary, only modal coordinates: neither grids nor scalar points of "
                         "the b-set (BSET1)")
    nb, square = len(boundary), np.ix_(order, order)
    K, M, D = checked.K[square], checked.M[square], None if raw.D is None else checked.D[square]
    H = None if checked.H is None else checked.H[square]
    systems = systems_of(path, tables_of(path, deck.cards)[0])[0] if any(deck.of("GRID")) else None
    cd = {} if systems is None else dict(zip(systems.numbers.tolist(), systems.motions.tolist(), strict=True))
    if systems is not None and len(cd) < len(systems.numbers):
        grid = next(grid for grid in cd if np.count_nonzero(systems.numbers == grid) > 1)
        one, other = systems.places[systems.numbers == grid][:2].tolist()
        raise InputError(f"{path}, or {path.stem}.asm or .pch beside it, has the grid {grid} at {one} and at {other}, or in two "
                         "frames: one file is damaged or of another run")
    missing = sorted({grid for grid, direction in boundary if direction} - cd.keys())
    if missing:
        raise InputError(f"{path}: there is no GRID card of {len(missing)} boundary grids, first {missing[0]}; {path.stem}.pch "
                         f"or {path.stem}.asm should list them. read_component('FILE:M', 'FILE:K') reads the matrices alone")
    place = {} if systems is None else dict(zip(cd, systems.points(), strict=True))
    turn, labels = _turned(boundary, systems, cd, place)
    T = sp.block_diag([turn, sp.eye_array(len(order) - nb)], format="csr")
    K, M, *lossy = ((A + A.T) / 2 for A in (T.T @ part @ T for part in (K, M, H) if part is not None))
    # recovered motions that are no boundary DOF, each once, without grids that do not move
    moved, seen, rows = (raw.recovery != 0).any(axis=1), set(boundary), list[int]()
    alive = {(grid, (direction - 1) // 3) for at, (grid, direction) in enumerate(raw.recovered) if moved[at]}
    for at, (grid, direction) in enumerate(raw.recovered):
        if (grid, direction) not in seen and (grid, (direction - 1) // 3) in alive:
            seen.add((grid, direction))
            rows.append(at)
    extra, recovery = [raw.recovered[at] for at in rows], raw.recovery[np.ix_(np.array(rows, dtype=np.intp), order)] @ T
    if (lost := sorted({grid for grid, _ in extra} - cd.keys())) and any(grid in cd for grid, _ in extra):
        warn(f"{path}: there is no GRID card of {len(lost)} recovered grids, first {lost[0]}, but others have one: places of all "
             "are left out. Is a card lost?")
    back, names = _turned(extra, systems, cd, place)
    V, kept = np.vstack([np.eye(len(order)), back.T @ recovery]), len(order) - nb
    D = None if D is None else T.T @ D @ T
    scale = np.sqrt(np.abs(np.outer(K.diagonal()[nb:], K.diagonal()[:nb])))
    kind = "free" if (np.abs(K[nb:, :nb]) > POSITION * scale).any() else "fixed-interface"
    # without a cut-off, the highest frequency of the modal coordinates
    if cutoff is None:
        k, m = K.diagonal()[nb:], M.diagonal()[nb:]
        cutoff = float(np.sqrt((k[m > 0] / m[m > 0]).max(initial=0.0))) or np.inf
        if np.isfinite(cutoff):
            warn(f"{path} does not say up to which frequency modes were kept. The cut-off of {name!r} is that of its highest "
                 f"modal coordinate, {cutoff:.5g} rad/time; residual vectors among them make it too high. Give cutoff=")
        else:
            warn(f"{path} has no modal coordinates, so that {name!r} counts as a full model. If it was condensed, give cutoff=")
    scalar = [raw.rows[row] for row in order[nb:]]
    nodes = [grid for grid, _ in boundary + scalar + extra]
    nowhere = points | {grid for grid, direction in boundary if not direction}
    where = np.array([[0.0] * 3 if grid in nowhere else place.get(grid, [np.nan] * 3) for grid in nodes])
    dofs = _map(nodes[:nb], labels, where[:nb] if any(direction for _, direction in boundary) else None)
    number = f" {next(iter(deck.supers))}" if deck.supers else ""
    return ReducedSubstructure(
        M, K, D, {}, name, H=lossy[0] if lossy else None, V=V, kinds=("constraint",) * nb + (kind,) * kept, modes=kept,
        method=f"{deck.program} superelement{number} with {kept} modes", cutoff=cutoff, full_interface=np.arange(nb),
        full_dofs=_map(nodes, [*labels, *(f"q{direction or ''}" for _, direction in scalar), *names],
                       where if np.isfinite(where).all() else None), interface_dofs=dofs,
        rigid_motion=of_few_digits(M, D, K, dofs, RIGID, raw.written),
        sets={BOUNDARY: np.arange(nb)} | {str(grid): np.flatnonzero(dofs.nodes == grid) for grid in dict.fromkeys(nodes[:nb])})


def _map(nodes: list[int], labels: list[str], where: Array | None) -> DofMap:
    known = tuple(dict.fromkeys((*DIRECTIONS, *labels)))
    return DofMap(nodes, [known.index(label) for label in labels], known, where)


def _turned(dofs: list[tuple[int, int]], systems: Systems | None, cd: Mapping[int, int], place: Mapping[int, Array]
            ) -> tuple[Any, list[str]]:
    """T, sparse (n, n), with u = T u_basic for motions u in the frames of their grids; and the names of the motions after that.

    The three translations, or rotations, of a grid are turned together. If one or two of them are missing in a turned frame, the
    others keep their directions: they are called 'ux@10' after their frame, or 'ux@own' where the frame is not known.
    """
    n, labels = len(dofs), [""] * len(dofs)
    turned: list[tuple[Array, Any]] = []
    blocks: dict[tuple[int, bool], dict[int, int]] = {}
    for at, (grid, direction) in enumerate(dofs):
        if not direction:
            labels[at] = "scalar"
            continue
        blocks.setdefault((grid, direction > 3), {})[(direction - 1) % 3] = at
    for (grid, turning), rows in blocks.items():
        axes = systems.axes(cd[grid], place[grid]) if systems and grid in cd else None
        basic = axes is not None and np.abs(axes - np.eye(3)).max() <= EQUAL
        ready = basic or (axes is not None and len(rows) == 3)
        for axis, at in rows.items():
            labels[at] = DIRECTIONS[axis + 3 * turning] + ("" if ready else f"@{cd.get(grid, 'own')}")
        if ready and not basic:
            turned.append((np.array([rows[axis] for axis in range(3)]), axes))
    places = np.reshape([at for at, _ in turned], (-1, 3)).astype(np.intp)
    straight = np.setdiff1d(np.arange(n), places)
    i = np.concatenate([straight, np.repeat(places, 3, axis=1).ravel()])
    j = np.concatenate([straight, np.repeat(places, 3, axis=0).ravel()])
    values = np.concatenate([np.ones(len(straight)), *(axes.ravel() for _, axes in turned)])
    return sp.csr_array((values, (i, j)), shape=(n, n)), labels
