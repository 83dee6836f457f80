"""Files of other programs, each beside the numbers that it was written from: legitimate forms are read, damaged ones refused."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack
from femsub.checks import Array

KINDS = ("universal 58", "universal 58 damaged", "Ansys full", "Ansys full damaged")
ORDERS = {"displacement": 0, "velocity": 1, "acceleration": 2}
TYPES = {"displacement": 8, "velocity": 11, "acceleration": 12}
AXES = ("s", "ux", "uy", "uz", "rx", "ry", "rz")


class Response58:
    """Receptances at random pairs, and one form of writing them: text or binary, spacing, precision, fills and line ends."""

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.binary, self.even, self.double = (bool(rng.integers(2)) for _ in range(3))
        self.eol = str(rng.choice(["\n", "\n", "\r\n"]))
        self.big = self.binary and bool(rng.integers(2))
        self.count = int(rng.integers(1, 30))
        self.quantity = str(rng.choice(list(ORDERS)))
        self.top = int(rng.choice([TYPES[self.quantity]] * 3 + [0, 1]))
        self.bottom = int(rng.choice([13, 13, 9, 0, 1]))
        self.stated: dict[str, Any] = {"quantity": self.quantity} if self.top < 2 else {}
        self.stated |= {"over": "force"} if self.bottom < 2 else {}
        self.zeros = not self.binary and bool(rng.integers(2))
        start, step = float(f"{rng.uniform(0.5, 50):.5e}"), float(f"{rng.uniform(0.1, 10):.5e}")
        self.start, self.step = start, step
        self.x = start + step * np.arange(self.count)
        if not self.even:
            self.x = np.cumsum(rng.uniform(0.1, 10, self.count))
        rows, columns = int(rng.integers(1, 3)), int(rng.integers(1, 3))
        ends = [[(int(node), int(direction)) for node, direction in zip(rng.permutation(99)[:k] + 1, rng.choice(
            [-3, -2, -1, 1, 2, 3, 4, -5, 6, 0], k), strict=True)] for k in (rows, columns)]
        self.pairs = [(row, column) for row in ends[0] for column in ends[1]]
        self.shape = rows, columns
        self.h = [10.0 ** rng.uniform(-9, 3) * rng.standard_normal((2, self.count)).T.copy().view(complex).ravel()
                  for _ in self.pairs]
        self.exponent = str(rng.choice(["e", "E", "D", "e+0"]))
        self.padded, self.length = bool(rng.integers(2)), str(rng.choice(["right", "zero", "half", "line end"]))
        self.read: list[Array] = []
        self.torn = False  # the last number ends like a line, and no line ends behind it: as where a byte was lost
        self.sets = [self.head(pair) + self.body(h) for pair, h in zip(self.pairs, self.h, strict=True)]

    @property
    def bytes_(self) -> int:
        return self.count * (2 + (not self.even)) * (8 if self.double else 4)

    def head(self, pair: tuple[tuple[int, int], tuple[int, int]]) -> bytes:
        size = {"right": self.bytes_, "zero": 0, "half": self.bytes_ // 2, "line end": self.bytes_ + len(self.eol)}[self.length]
        (row, turn), (column, other) = pair
        lines = ["    -1", f"    58b{2 if self.big else 1:6d}{2:6d}{11:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}" if self.binary
                 else "    58", *["NONE"] * 5,
                 f"{4:5d}{1:10d}{0:5d}{0:10d} {'NONE':10s}{row:10d}{turn:4d} {'NONE':10s}{column:10d}{other:4d}",
                 f"{6 if self.double else 5:10d}{self.count:10d}{self.even:10d}{self.start:13.5e}{self.step:13.5e}{0:13.5e}",
                 *(f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}" for kind in (18, self.top, self.bottom, 0))]
        return (self.eol.join([line.ljust(80) for line in lines] if self.padded else lines) + self.eol).encode()

    def body(self, h: Array) -> bytes:
        table = np.column_stack([*([] if self.even else [self.x]), h.real, h.imag])
        end = f"    -1{self.eol}".encode()
        if self.binary:
            kind = f"{'>' if self.big else '<'}f{8 if self.double else 4}"
            self.read.append(table.astype(kind).astype(float))
            raw = table.astype(kind).tobytes()
            behind = self.eol.encode() if self.length == "line end" or self.rng.random() < 0.7 else b""
            self.torn |= not behind and raw.endswith(self.eol.encode())
            return raw + behind + end
        words = [[f"{value:13.5e}" if not self.double or (at == 0 and not self.even) else f"{value:20.12e}"
                  for at, value in enumerate(row)] for row in table]
        self.read.append(np.array([[float(word) for word in row] for row in words]))
        flat = [word for row in words for word in row]
        per = 6 if not self.double else 4 if self.even else 3
        if self.zeros:
            flat += [f"{0.0:{20 if self.double else 13}.5e}"] * (-len(flat) % per)
        lines = ["".join(flat[start:start + per]) for start in range(0, len(flat), per)]
        text = self.eol.join(line.ljust(80) for line in lines) + self.eol
        if self.exponent == "e+0":
            text = text.replace("e+", "e+0").replace("e-", "e-0")
        return text.replace("e", self.exponent[0]).encode() + end

    def expected(self) -> Array:
        """(ns, rows, columns)"""
        found = []
        for ((_, turn), (_, other)), table in zip(self.pairs, self.read, strict=True):
            x = table[:, 0] if not self.even else self.x
            sign = (-1.0 if turn < 0 else 1.0) * (-1.0 if other < 0 else 1.0)
            found.append(sign * (table[:, -2] + 1j * table[:, -1]) / (2j * np.pi * x) ** ORDERS[self.quantity])
        return np.array(found).T.reshape(self.count, *self.shape)


def damaged(case: Response58) -> bytes:
    """The file with one fault that shows: of a length, a number, a type or a statement."""
    rng, sets = case.rng, list(case.sets)
    at = int(rng.integers(len(sets)))
    head, body = len(case.head(case.pairs[at])), sets[at]
    inside = body[head:body.rindex(b"    -1")]
    end = body[head + len(inside):]
    eol = case.eol.encode()

    def changed(line: int, start: int, stop: int, word: str) -> bytes:
        lines = body[:head].split(eol)
        lines[line] = lines[line][:start] + word.rjust(stop - start).encode() + lines[line][stop:]
        return eol.join(lines) + body[head:]

    faults = ["cut", "count", "types", "real", "direction", "stated"]
    faults += ["bytes"] if case.binary else ["line", "number more", "letter", "nan", "zero line", "fill"]
    fault = str(rng.choice(faults))
    if fault == "cut":
        stop = int(rng.integers(8, len(body.rstrip()) - 2))
        return b"".join(sets[:at]) + body[:stop]
    if fault == "count":
        change = int(rng.choice([-1, 50] if case.zeros else [-1, 1, 2, 50]))  # a filled line may hold one value more
        sets[at] = changed(8, 10, 20, str(case.count + change))
    elif fault == "types":
        sets[at] = changed(*((10, 0, 10, "3") if rng.random() < 0.5 else (11, 0, 10, "8")))
    elif fault == "real":
        sets[at] = changed(8, 0, 10, "4" if case.double else "2")
    elif fault == "direction":
        sets[at] = changed(7, 51, 55, "7")
    elif fault == "stated":
        if case.stated:
            case.stated = {}
        else:
            case.stated = {"quantity": next(name for name in ORDERS if name != case.quantity)}
    elif fault == "bytes":
        where = int(rng.integers(case.bytes_))
        more = bytes(rng.integers(33, 127, int(rng.integers(1, 20))).tolist())
        sets[at] = body[:head] + (inside[:where] + more + inside[where:] if rng.random() < 0.5 or len(inside) < 30 else
                                  inside[:where] + inside[min(where + len(more), case.bytes_):]) + end
        if sets[at] == body or inside.rstrip(b"\r\n\t \x0b\x0c") != inside[:case.bytes_]:
            sets[at] = body[:head] + more + inside + end
    else:
        lines = inside.split(eol)[:-1]
        row = int(rng.integers(len(lines)))
        if fault == "line":
            del lines[row]
        elif fault == "number more":
            lines[row] = lines[row].rstrip() + b"  1.25000e+00"
        elif fault == "letter":
            lines[row] = lines[row].replace(b".", b"x", 1)
        elif fault == "nan":
            lines[row] = lines[row].rstrip()[:-13].rsplit(b" ", 1)[0] + b" NaN" if len(lines[row].split()) > 1 else b" NaN"
        elif fault == "zero line":
            lines.append(b"  0.00000e+00" * 6)
        else:  # what fills the line is no 0
            lines[-1] = lines[-1].rstrip() + b"  0.00000e+00  1.00000e-09"
        sets[at] = body[:head] + eol.join([*lines, b""]) + end
    return b"".join(sets)


def record(values: np.ndarray) -> np.ndarray:
    """A record of Ansys: its length in words, flags, the content, the length again."""
    content = np.ascontiguousarray(values).view("<i4") if values.dtype == float else values.astype("<i4")
    return np.concatenate([[len(content), 0 if values.dtype == float else -2**31], content, [len(content)]]).astype("<i4")


def packed_record(values: np.ndarray) -> np.ndarray:
    """A record of whole numbers that leaves out entries 0: windows of equal and of other entries, and single ones."""
    content, at, count = list[int](), 0, 0
    while at < len(values):
        end = at + int(np.argmax(values[at:] != values[at])) if (values[at:] != values[at]).any() else len(values)
        if values[at] and (end > at + 1 or at == 0):
            content += [-at, -(end - at), int(values[at])]
        elif values[at]:
            end = end + int(np.argmin(values[end:])) if end < len(values) and not values[end:].all() else len(values)
            content += [at, int(values[at])] if end == at + 1 else [-at, end - at, *values[at:end].tolist()]
        count, at = count + bool(values[at]), end
    return np.concatenate([[len(content) + 2, -2**31 + 2**28, len(values), count], content, [len(content) + 2]]).astype("<i4")


def full_file(path: Path, K: np.ndarray, M: np.ndarray, about: Mapping[str, np.ndarray], unsymmetric: bool,
              triangle: bool = True, packed: bool = False) -> Path:
    """A .full file of all columns of an unsymmetric K, or of lower triangles; of M its `triangle`, or all.

    `packed`: tables of the DOF leave out entries 0.
    """
    def columns(A: np.ndarray, lower: bool) -> tuple[list[np.ndarray], int]:
        found, terms = [], 0
        for column in range(len(A)):
            rows = np.flatnonzero((A[:, column] != 0) | (A[column] != 0))
            rows = rows[(rows > column) | (not lower and rows != column)]
            rows = np.append(rows, column)
            found += [record(rows + 1), record(A[rows, column])]
            terms += len(rows)
        return found, terms

    nodes, kinds, held = about["nodes"], about["kinds"], about["held"]
    first = [record(kinds), record(nodes)]
    tables = [(packed_record if packed else record)(table) for table in (np.full(len(nodes), len(kinds)), held)]
    stiffness, mass = columns(K, not unsymmetric), columns(M, triangle or not unsymmetric)
    starts = np.cumsum([206, *(sum(map(len, part)) for part in (first, stiffness[0], tables, mass[0]))])
    standard, head = np.zeros(100), np.zeros(160)
    standard[[0, 1, 26]] = 4, -1, starts[4]
    head[[0, 1, 7, 8, 13, 18, 26, 32, 33, 35]] = (-4, len(K), len(kinds), stiffness[1], unsymmetric, starts[1] + 60,
                                                  starts[3] + 60, len(nodes), mass[1], starts[2] + 60)
    standard[26] += 60
    parts = [record(standard.astype(int)), record(head.astype(int)), *first, *stiffness[0], *tables, *mass[0]]
    np.concatenate(parts).tofile(path)
    return path


def ansys(rng: Random) -> tuple[dict[str, Any], Array]:
    """Arguments of `full_file` with a random K, symmetric or not, and the rows that are not held, by node and direction."""
    kinds = np.sort(rng.permutation(6)[:int(rng.integers(1, 5))]) + 1
    nodes = rng.permutation(90)[:int(rng.integers(2, 8))] + 1
    n = len(nodes) * len(kinds)
    B = np.tril(rng.standard_normal((n, n)) * (rng.random((n, n)) < rng.uniform(0.1, 1.0)), -1) + np.diag(rng.uniform(1, 3, n))
    B[1, 0] = 1.0
    scale, unsymmetric = 10.0 ** rng.uniform(-6, 12), bool(rng.integers(2))
    K, M = scale * (B @ B.T), np.diag(rng.uniform(1, 2, n)) + 0.01 * (B + B.T)
    if unsymmetric:
        for _ in range(int(rng.integers(1, 6))):
            i, j = rng.permutation(n)[:2]
            K[i, j] += scale * rng.standard_normal()
    held = np.tile(kinds, len(nodes)) * np.where(rng.random(n) < 0.2, -1, 1)
    free = int(rng.integers(n))
    held[free] = abs(held[free])
    given = {"K": K, "M": M, "about": {"nodes": nodes, "kinds": kinds, "held": held}, "unsymmetric": unsymmetric,
             "triangle": bool(rng.integers(2)), "packed": bool(rng.integers(2))}
    labels = np.array([(node, kind) for node in nodes for kind in kinds])
    order = np.lexsort([labels[:, 1], labels[:, 0]])
    return given, order[held[order] > 0]


def harmed(rng: Random, path: Path) -> str:
    """One fault that shows: of the length of the file, of a record, of the header, of a number of a row."""
    words = np.fromfile(path, "<i4")
    size, K, M = int(words[106]), int(words[123]), int(words[131])
    at = K if rng.random() < 0.5 else M
    for _ in range(int(rng.integers(size))):
        at += 3 * int(words[at]) + 6
    count = int(words[at])
    fault = str(rng.choice(["cut", "length", "flags", "row", "twice", "terms", "header", "nan", "symmetry", "nodes"]))
    if fault == "cut":
        words = words[:int(rng.integers(1, len(words)))]
    elif fault == "length":
        words[at + int(rng.choice([0, count + 2, count + 3, 3 * count + 5]))] += int(rng.choice([-1, 1, 1000]))
    elif fault == "flags":
        words[at + int(rng.choice([1, count + 4]))] = -2**31 + 8 if rng.random() < 0.5 else 8
    elif fault == "row":
        words[at + 2] = int(rng.choice([0, -1, size + 1, 2**30]))
    elif fault == "twice":
        words[at + 2 + int(rng.integers(max(count - 1, 1)))] = words[at + 2 + count - 1] if count > 1 else size + 1
    elif fault == "terms":
        words[105 + int(rng.choice([8, 33]))] += int(rng.choice([-1, 1, 50]))
    elif fault == "header":
        places = ((0, 4), (10, 1), (1, size + 1), (1, size - 1), (18, 3), (35, 3), (26, len(words)), (36, 5))
        place, value = places[rng.integers(len(places))]
        words[105 + place] = value
    elif fault == "nan":
        words[at + count + 5:at + count + 7] = np.array([np.nan]).view("<i4")
    elif fault == "symmetry":
        words[105 + 13] = 1 - words[105 + 13]
    else:
        first = 103 + int(words[103]) + 3
        first += int(words[first]) + 3
        words[first + 2] = words[first + 3]  # a node twice
    words.tofile(path)
    return fault


def from_ansys(rng: Random, bad: bool) -> str:
    given, rows = ansys(rng)
    with tempfile.TemporaryDirectory() as folder:
        path = full_file(Path(folder) / "a.full", **given)
        fault = harmed(rng, path) if bad else ""
        try:
            K, M = (fs.read_matrix(path, name).toarray() for name in "KM")
        except fs.FemsubError as error:
            return f"refused: {error}" if bad else f"wrong: refused: {error}"
        if bad:
            return f"wrong: read in spite of {fault}"
        if not given["unsymmetric"]:
            part = fs.read_component(path)
            kinds = [("ux", "uy", "uz", "rx", "ry", "rz")[kind - 1] for kind in given["about"]["kinds"]]
            names = [f"{way} at node {node}" for node in given["about"]["nodes"] for way in kinds]
            if part.dofs is None or [part.dofs.name(row) for row in range(part.size)] != [names[row] for row in rows]:
                return "wrong: names of DOF"
    kept = np.ix_(rows, rows)
    return "certified" if np.array_equal(K, given["K"][kept]) and np.array_equal(M, given["M"][kept]) else "wrong: entries"


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    if kind.startswith("Ansys"):
        return from_ansys(rng, kind.endswith("damaged"))
    with tempfile.TemporaryDirectory() as folder:
        path, case = Path(folder) / "a.uff", Response58(rng)
        bad = kind.endswith("damaged")
        path.write_bytes(damaged(case) if bad else b"".join(case.sets))
        try:
            found = fs.read_response(path, **case.stated)
        except fs.FemsubError as error:
            return f"refused: {error}" if bad or case.torn else f"wrong: refused: {error}"
    if bad:
        return "wrong: read"
    difference = np.abs(found.receptance - case.expected()) / np.abs(case.expected())
    names = tuple(dict.fromkeys(f"{node}:{AXES[abs(turn)]}" for (node, turn), _ in case.pairs))
    if found.responses != names or not difference.max() < 1e-13:
        return f"wrong: {difference.max():.1e} from what was written"
    return "certified"
