"""Fuzzing of readers: valid files are damaged at random, read in child processes and judged by what comes back.

Right is a FemsubError, the content of the valid file, or the honest meaning of the damaged one. A finding is all else: another
exception, a crash, a hang, memory without bounds, and content that the damaged file does not have.

Other content is counted by whether a warning or a note said so. Where none did, it is `undetectable` by one of five rules:

    (value)    the file is as long as before, and only real values of the content differ: without a checksum (formats that have
               one are `strict`) nothing in a file says what a number was, neither one byte nor a block of zeros
    (number)   only numbers of the text, or eight bytes of a binary file, became others, and the content has the same count of
               everything (but for the entries, where the number became 0): a number that names a node, a row or a group names
               another one
    (name)     only letters within a name became others, and the content is the same but for that name: who asks for the old one
               hears that there is none
    (fewer)    the file is a row of units that no count covers (`Subject.units`), and some of them are gone: what is left is the
               whole file of less content

Where a second reader finds the same meaning (`Subject.honest`), other content is `meant`. So it is with scenes: TOML has no end
mark, and editors write no last line end, so that a scene that is cut is a scene with defaults; a run shows what it takes, and
results.json has every key.

All else is `silent`, counted by the kind of damage and listed: the file may hold what shows it.

A module `fuzz_NAME.py` beside this one offers `subjects(folder) -> list[Subject]`: it writes valid files into the folder and
tells how each is read. `scripts/fuzz-files` runs all of them at length, the tests a short seeded part:

    report = fuzz(subjects(tmp_path), count=100, seed=1, folder=tmp_path / "damaged")
    assert not report.findings, report
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import itertools
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

NUMBER = re.compile(rb"(?<![\w.+-])[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?(?![\w.+-])")
WORD = re.compile(rb"[^\s,;]+")
#: no number in any format: put in place of one, the file has no meaning any more
NONSENSE = (b"2.5xyz", b"0x10", b"1.2.3", b"--1", b"1e", b"x", b"1e5e5", b"+-2", b"1.0f", b"\xd9\xa3", b"1_0", b"#", b"?")
#: numbers of every kind: in place of another, the file means something else
NUMBERS = (b"0", b"-1", b"1", b"2", b"7", b"1.5", b"-0.0", b"1e3", b"1e400", b"99999999999", b"4000000000", b"2147483648",
           b"9223372036854775808", b"100000", b"1e-320", b"nan", b"inf", b"-2.5D+01", b"3.5+2")
FIELDS = tuple(value.to_bytes(size, "little", signed=True) for size in (1, 2, 4, 8)
               for value in (0, -1, 1, 5, 2 ** (8 * size - 1) - 1, -2 ** (8 * size - 1)))
JSON = (None, True, 0, -1, 1.5, 10 ** 12, float("nan"), "x", "../M.mtx", [], {}, [1, "x"], {"x": 1})


@dataclass(frozen=True)
class Subject:
    """A valid file or folder, and how it is read.

    Parameters
    ----------
    name : str
    path : Path
        A file, or a folder whose files are damaged one at a time.
    reader : str
        'module:function' for the child: takes the path, returns the content as mappings, sequences, arrays, sparse matrices,
        texts and numbers (anything else by its repr).
    text : bool
        Whether it is damaged as text: words, numbers, lines. In a folder, this is asked of each file by `text_file`.
    strict : set of str
        Kinds of damage behind which only the valid file's content or a refusal is right. 'word' puts nonsense in the place of
        a number, 'comma' writes 0,5 for 0.5 (a warning is right as well: commas separate numbers), 'nul' puts NUL bytes before
        the file. Checksums make 'bytes' strict, counts of lines make 'line' strict. A folder's .json is never strict: it is
        what the rest is checked against.
    honest : callable, optional
        The content that a damaged file honestly has, in the reader's form, or None if it has no meaning: a second reader, slow
        and simple. With it, any other content is a finding.
    words : callable, optional
        bytes to (start, stop) of the numbers in it that nonsense may replace; all by default.
    units : callable, optional
        Bytes to the units of which the format is a row: parts that neither a count nor another part covers.
    vocabulary : sequence of bytes
        Words of the format (keywords, options) that may stand in the place of others.
    header : int
        Bytes at the beginning that are damaged more often than the rest.
    """

    name: str
    path: Path
    reader: str
    text: bool = True
    strict: frozenset[str] = frozenset({"cut", "word", "comma", "nul"})
    honest: Callable[[Path], Any] | None = None
    words: Callable[[bytes], list[tuple[int, int]]] | None = None
    units: Callable[[bytes], list[bytes]] | None = None
    vocabulary: Sequence[bytes] = ()
    header: int = 200
    text_file: Callable[[str], bool] = lambda name: name.endswith((".mtx", ".csv", ".json", ".txt"))


@dataclass(frozen=True)
class Mutant:
    """A damaged file: the kind of damage, what was done, which file of a folder, and its new bytes (None: deleted)."""

    kind: str
    what: str
    file: str
    data: bytes | None


@dataclass
class Report:
    """How many mutants of each subject ended how, and the findings with the place where each mutant is kept."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)  # other content without a word
    undetectable: list[str] = field(default_factory=list)  # those of them that a rule explains, for a second reader

    @property
    def total(self) -> int:
        return sum(sum(counter.values()) for counter in self.counts.values())

    def __str__(self) -> str:
        keys = sorted({key for counter in self.counts.values() for key in counter})
        lines = [f"{self.total} mutants, {len(self.findings)} findings"]
        lines += [f"  {name:24s} " + "  ".join(f"{key} {counter[key]}" for key in keys if counter[key])
                  for name, counter in self.counts.items()]
        return "\n".join(lines + self.findings)


def fingerprint(content: Any, *, reals: bool = True) -> str:
    """A hash that is equal for equal content: bits of numbers, order of sequences, not that of mappings.

    Without `reals`, it is equal where only real numbers and those of texts differ: the shapes, indices and names are the same.
    """
    digest = hashlib.sha256()
    _feed(content, digest.update, reals)
    return digest.hexdigest()


def _feed(content: Any, update: Callable[[bytes], object], reals: bool) -> None:
    import numpy as np
    import scipy.sparse as sp

    if sp.issparse(content):
        entries = sp.csr_array(content, copy=True)  # a model's own are read-only
        entries.sum_duplicates()
        if reals:
            entries.eliminate_zeros()
        update(b"sparse")
        _feed([entries.shape, entries.indptr.astype(np.int64), entries.indices.astype(np.int64), entries.data], update, reals)
    elif isinstance(content, np.ndarray):
        plain = content if content.dtype.kind in "OSUMmV" else content.astype(complex if content.dtype.kind == "c" else float)
        update(f"array {plain.shape}".encode())
        if not reals and content.dtype.kind in "fc":
            return
        update(repr(plain.tolist()).encode() if plain.dtype.kind in "OSUMmV" else (plain + 0).tobytes())
    elif isinstance(content, Mapping):
        update(b"mapping")
        for key in sorted(content, key=repr):
            update(repr(key).encode())
            _feed(content[key], update, reals)
    elif isinstance(content, (list, tuple)):
        update(f"sequence {len(content)}".encode())
        for part in content:
            _feed(part, update, reals)
    else:
        said = repr(content.item() if isinstance(content, np.generic) else content).encode()
        update(said if reals or isinstance(content, (int, np.integer)) else NUMBER.sub(b"1", said))


def counts(content: Any) -> Any:
    """How much there is of everything in it, as nested texts, whatever the numbers and names are."""
    import scipy.sparse as sp

    if isinstance(content, Mapping):  # lists of members announce no count, or the reader compares it
        return ["mapping", *sorted(repr(counts(part)) for key, part in content.items() if key not in ("sets", "groups"))]
    if isinstance(content, (list, tuple)):
        return ["sequence", *(counts(part) for part in content)]
    return [repr(getattr(content, "shape", type(content))), content.nnz if sp.issparse(content) else 0]


def unnamed(content: Any) -> Any:
    """The content without its names: the keys of mappings, whose parts are sorted, and texts."""
    if isinstance(content, Mapping):
        return sorted(fingerprint(unnamed(part)) for part in content.values())
    if isinstance(content, (list, tuple)):
        return [unnamed(part) for part in content]
    return "text" if isinstance(content, str) else content


# --- damage ------------------------------------------------------------------------------------------------------------------

def mutants(subject: Subject, count: int, seed: int) -> Iterator[Mutant]:
    """`count` damaged versions, the same for the same seed."""
    files = {"": subject.path.read_bytes()} if subject.path.is_file() else \
        {str(path.relative_to(subject.path)): path.read_bytes() for path in sorted(subject.path.rglob("*")) if path.is_file()}
    for index in range(count):
        rng = random.Random(f"{seed} {subject.name} {index}")
        while True:
            name = rng.choice(list(files))
            mutant = _mutant(subject, name, files[name], rng)
            if mutant.data != files[name]:
                break
        yield mutant


def _mutant(subject: Subject, name: str, data: bytes, rng: random.Random) -> Mutant:
    if name and rng.random() < 0.03:
        return Mutant("delete", "the file is gone", name, None)
    if name.endswith(".json") and rng.random() < 0.7:
        return Mutant("json", *_json(data, name, rng))
    text = subject.text if not name else subject.text_file(name)
    kinds = ("cut", "word", "number", "swap", "line", "header", "bytes", "comma", "nul", "pump") if text else (
        "cut", "bytes", "bits", "field", "block", "nul")
    kind = rng.choice(kinds)
    what, damaged = {"cut": _cut, "word": _nonsense, "number": _number, "swap": _swap, "line": _line, "header": _header,
                     "bytes": _bytes, "bits": _bits, "field": _field, "block": _block, "comma": _comma, "nul": _nul,
                     "pump": _pump}[kind](subject, data, rng)
    return Mutant(kind, what, name, damaged)


def _put(data: bytes, span: tuple[int, int], new: bytes) -> tuple[str, bytes]:
    return f"{data[slice(*span)][:40]!r} becomes {new!r} at byte {span[0]}", data[:span[0]] + new + data[span[1]:]


def _spans(pattern: re.Pattern[bytes], data: bytes, stop: int | None = None) -> list[tuple[int, int]]:
    """Where the pattern stands, of those that begin before `stop`."""
    spans = (match.span() for match in pattern.finditer(data))
    return list(spans if stop is None else itertools.takewhile(lambda span: span[0] < stop, spans))


def _place(subject: Subject, data: bytes, rng: random.Random) -> int:
    """A byte, in one of three cases in the header, in one of ten at the end."""
    draw = rng.random()
    low, high = (0, subject.header) if draw < 0.33 else (len(data) - subject.header, len(data)) if draw < 0.43 else (0, len(data))
    return rng.randrange(max(0, low), max(1, min(high, len(data))))


def _cut(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    size = rng.choice([rng.randrange(max(1, len(data))), max(0, len(data) - rng.randrange(1, 60)),
                       data.rfind(b"\n", 0, rng.randrange(len(data)) + 1) + 1])
    return f"cut to {size} of {len(data)} bytes", data[:size]


def _nonsense(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    spans = subject.words(data) if subject.words else _spans(NUMBER, data)
    return _put(data, rng.choice(spans), rng.choice(NONSENSE)) if spans else _cut(subject, data, rng)


def _number(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    spans = _spans(NUMBER, data)
    if not spans:
        return _bytes(subject, data, rng)
    span = rng.choice(spans)
    digits = bytearray(data[slice(*span)])
    digits[rng.randrange(len(digits))] = rng.choice(b"0123456789")
    return _put(data, span, rng.choice([bytes(digits), rng.choice(NUMBERS), rng.choice(NUMBERS)]))


def _swap(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    spans = _spans(WORD, data)
    if len(spans) < 2:
        return _bytes(subject, data, rng)
    first = rng.randrange(len(spans) - 1)
    other = first + 1 if rng.random() < 0.5 else rng.randrange(len(spans))
    (a, b), (c, d) = sorted([spans[first], spans[other]])
    if a == c:
        return _bytes(subject, data, rng)
    return f"words at bytes {a} and {c} change places", data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _line(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    lines = data.splitlines(keepends=True)
    here, there = rng.randrange(len(lines)), rng.randrange(len(lines))
    act = rng.choice(["removed", "doubled", "moved", "emptied"])
    line = lines.pop(here)
    if act == "doubled":
        lines[here:here] = [line, line]
    elif act == "moved":
        lines.insert(there, line)
    elif act == "emptied":
        lines.insert(here, b"\n")
    return f"line {here + 1} {act}" + (f" to {there + 1}" if act == "moved" else ""), b"".join(lines)


def _header(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    """A word near the beginning (or, where there is a vocabulary, a keyword anywhere) becomes another one, or goes."""
    known = [match for word in subject.vocabulary for match in _spans(re.compile(re.escape(word)), data)]
    spans = known if known and rng.random() < 0.5 else _spans(WORD, data, subject.header)
    if not spans:
        return _bytes(subject, data, rng)
    return _put(data, rng.choice(spans), rng.choice([*subject.vocabulary, *NUMBERS, b"", b"x"]))


def _bytes(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    damaged, places = bytearray(data), []
    for _ in range(rng.choice([1, 1, 1, 2, 5, 20])):
        place = _place(subject, data, rng)
        if damaged:
            damaged[place] = rng.randrange(256)
        places.append(place)
    return f"bytes {places} at random", bytes(damaged)


def _comma(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    spans = [span for span in (subject.words(data) if subject.words else _spans(NUMBER, data)) if b"." in data[slice(*span)]]
    if not spans:
        return _nonsense(subject, data, rng)
    span = rng.choice(spans)
    return _put(data, span, data[slice(*span)].replace(b".", b","))


def _nul(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    count = rng.choice([1, 2, 4, 8, 20, 128, 512])
    return f"{count} NUL bytes before it", bytes(count) + data


def _pump(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    """A sign, a word or a line many times: what takes more than linear time is a hang."""
    start = _place(subject, data, rng)
    lines = data.splitlines(keepends=True)
    unit = rng.choice([data[start:start + rng.choice([1, 2, 3, 8])], rng.choice(lines), rng.choice([*subject.vocabulary, b" "]),
                       rng.choice([b",", b" ", b"\n", b"1", b"% ", b"<", b"'", b"(", b"1 ", b",\n", b"a"])]) or b" "
    count = rng.choice([300, 5_000, 30_000])
    count = min(count, 300_000 // len(unit) + 1)
    return f"{unit[:40]!r} {count} times at byte {start}", data[:start] + unit * count + data[start:]


def _bits(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    place, bit = _place(subject, data, rng), rng.randrange(8)
    return f"bit {bit} of byte {place} turned", data[:place] + bytes([data[place] ^ (1 << bit)]) + data[place + 1:]


def _field(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    new = rng.choice(FIELDS)
    new = new[::-1] if rng.random() < 0.1 else new
    place = _place(subject, data, rng) // len(new) * len(new)
    return _put(data, (place, place + len(new)), new)


def _block(subject: Subject, data: bytes, rng: random.Random) -> tuple[str, bytes]:
    start, size = _place(subject, data, rng), rng.choice([1, 4, 8, 64, 512, 4096])
    act = rng.choice(["gone", "doubled", "zero"])
    block = data[start:start + size]
    new = {"gone": b"", "doubled": 2 * block, "zero": bytes(len(block))}[act]
    return f"{len(block)} bytes at {start} {act}", data[:start] + new + data[start + size:]


def _json(data: bytes, name: str, rng: random.Random) -> tuple[str, str, bytes]:
    tree = json.loads(data)
    node, key, path = tree, None, []
    while isinstance(node, (dict, list)) and node and (key is None or rng.random() < 0.6):
        parent, key = node, rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
        path.append(key)
        node = parent[key]
    act = rng.choice(["set", "set", "set", "delete", "rename", "double"])
    if act == "delete":
        del parent[key]
    elif act == "rename" and isinstance(parent, dict):
        parent[f"{key}x"] = parent.pop(key)
    elif act == "double" and isinstance(parent, list):
        parent.insert(key, node)
    else:
        act = f"set to {(new := rng.choice(JSON))!r}"
        parent[key] = new
    return f"{'/'.join(map(str, path))}: {act}", name, json.dumps(tree, ensure_ascii=False, indent=1).encode()


# --- children ----------------------------------------------------------------------------------------------------------------

class Child:
    """A process that reads file after file; it is started anew when it dies, hangs, or has read many."""

    def __init__(self, seconds: float, memory: int) -> None:
        self.seconds, self.memory, self.read = seconds, memory, 0
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        self.errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `stop`)
        self.process = subprocess.Popen(
            [sys.executable, __file__, str(theirs_in), str(theirs_out), str(self.memory)], pass_fds=(theirs_in, theirs_out),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=self.errors,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OMP_NUM_THREADS": "1",
                 "OPENBLAS_NUM_THREADS": "1"})
        os.close(theirs_in), os.close(theirs_out)
        self.answers, self.questions, self.read = Connection(ours_in, writable=False), Connection(ours_out, readable=False), 0

    def stop(self) -> None:
        if self.process is not None:
            self.answers.close(), self.questions.close(), self.errors.close()
            self.process.kill()
            self.process.wait()
            self.process = None

    def ask(self, reader: str, path: Path) -> tuple[str, str]:
        """How it ended (content, refused, raised, memory, crash, hang), and a fingerprint or a message."""
        if self.process is None or self.read >= 1000:
            self.stop()
            self.start()
        assert self.process is not None
        first = not self.read
        self.read += 1
        try:
            self.questions.send((reader, str(path)))
            if self.answers.poll(self.seconds + (60 if first else 0)):  # the first has to import everything
                answer: tuple[str, str] = self.answers.recv()
                return answer
            ending = ("hang", f"no answer in {self.seconds:g} s")
        except (EOFError, OSError):
            self.process.wait()
            self.errors.seek(0)
            said = " ".join(self.errors.read().decode("utf-8", "replace").split())
            ending = ("crash", f"the process ended with {self.process.returncode}: {said:.500}")
        self.stop()
        return ending


def serve(questions: Connection, answers: Connection, memory: int) -> None:
    """The child: reads paths until there are no more."""
    import faulthandler

    from femsub.checks import FemsubError

    faulthandler.enable()
    warnings.simplefilter("ignore")
    limited = False
    while True:
        try:
            reader, path = questions.recv()
        except EOFError:
            return
        module, name = reader.split(":")
        try:
            read = getattr(importlib.import_module(module), name)
            if not limited:  # behind the imports, and the first file is the valid one
                read(Path(path))
                used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                resource.setrlimit(resource.RLIMIT_AS, (used + memory,) * 2)
                limited = True
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                content = read(Path(path))
            answers.send(("content", f"{fingerprint(content)} {fingerprint(sorted({str(one.message) for one in said}))} "
                                     f"{fingerprint(content, reals=False)} {fingerprint(counts(content))} "
                                     f"{fingerprint(unnamed(content))}"))
        except FemsubError as error:
            hungry = _memory_error(error)
            answers.send(("memory", f"refused only after a MemoryError: {hungry}") if hungry else ("refused", str(error)))
        except BaseException as error:
            trace = traceback.extract_tb(error.__traceback__)
            where = " < ".join(f"{Path(step.filename).name}:{step.lineno}" for step in reversed(trace[-4:]))
            answers.send(("memory" if isinstance(error, MemoryError) else "raised",
                          f"{type(error).__name__}: {error!s:.300} ({where})"))


def _memory_error(error: BaseException | None) -> str:
    from femsub.checks import FemsubError

    while error is not None:
        if isinstance(error, MemoryError) and not isinstance(error, FemsubError):
            return str(error) or "MemoryError"
        error = error.__cause__ or error.__context__
    return ""


# --- judgement ---------------------------------------------------------------------------------------------------------------

def fuzz(subjects: Sequence[Subject], count: int, seed: int, folder: Path, *, jobs: int = 2, seconds: float = 10.0,
         memory: int = 2 << 30) -> Report:
    """Reads `count` damaged versions of each subject and judges each; mutants that are findings are kept in the folder."""
    report = Report({subject.name: Counter() for subject in subjects})
    folder.mkdir(parents=True, exist_ok=True)
    parts = [(subject, list(range(start, count, jobs))) for subject in subjects for start in range(jobs)]
    children = [Child(seconds, memory) for _ in range(jobs)]

    def work(number: int) -> None:
        place, child = folder / f"work{number}", children[number]
        for subject, indices in parts[number::jobs]:
            for ending, finding in _judged(subject, set(indices), count, seed, place, folder, child):
                report.counts[subject.name][ending] += 1
                kept = {"silent": report.silent, "undetectable": report.undetectable}.get(ending.split()[0], report.findings)
                kept.extend([finding] if finding else [])

    try:
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(work, range(jobs)))
    finally:
        for child in children:
            child.stop()
        for number in range(jobs):
            shutil.rmtree(folder / f"work{number}", ignore_errors=True)
    return report


def only_numbers(valid: bytes, damaged: bytes) -> bool:
    """Whether two files differ in numbers only: words of a text, or eight bytes of a binary file."""
    if b"\0" not in valid:
        return NUMBER.sub(b"1", valid) == NUMBER.sub(b"1", damaged)
    places = [at for at, (one, other) in enumerate(zip(valid, damaged, strict=False)) if one != other]
    return len(valid) == len(damaged) and places[-1] - places[0] < 8


def zeroed(valid: bytes, damaged: bytes) -> bool:
    """Whether one number of a text became 0: an entry that is 0 is none."""
    pairs = [(one, other) for one, other in zip(NUMBER.findall(valid), NUMBER.findall(damaged), strict=False) if one != other]
    return b"\0" not in valid and len(pairs) == 1 and not float(pairs[0][1].lower().replace(b"d", b"e"))


def only_letters(valid: bytes, damaged: bytes) -> bool:
    """Whether two files differ within one word only."""
    def shared(one: bytes, other: bytes) -> int:
        return next((at for at, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))

    begin = shared(valid, damaged)
    end = shared(valid[begin:][::-1], damaged[begin:][::-1])
    return not any(re.search(rb"[\s\0<>=]", part[begin:len(part) - end]) for part in (valid, damaged))


def undetectable(subject: Subject, valid: bytes, damaged: bytes, same_shape: bool, same_counts: bool,
                 same_but_names: bool) -> str:
    """The rule by which nothing in the file shows the damage, or ''."""
    text = subject.text if subject.path.is_file() else b"\0" not in valid
    if same_shape and (only_numbers(valid, damaged) or (not text and len(valid) == len(damaged))):
        return "value"
    if only_numbers(valid, damaged) and (same_counts or zeroed(valid, damaged)):
        return "number"
    if same_but_names and only_letters(valid, damaged):
        return "name"
    if subject.units is not None and not Counter(filter(bytes.strip, subject.units(damaged))) - Counter(subject.units(valid)):
        return "fewer"
    return ""


def _judged(subject: Subject, indices: set[int], count: int, seed: int, place: Path, keep: Path,
            child: Child) -> Iterator[tuple[str, str]]:
    shutil.rmtree(place, ignore_errors=True)
    copy = place / subject.path.name  # read where the damaged ones are: a file may name others as seen from there
    if subject.path.is_dir():
        shutil.copytree(subject.path, copy)
    else:
        place.mkdir(parents=True)
        shutil.copy(subject.path, copy)
    ending, original = child.ask(subject.reader, copy)
    assert ending == "content", f"the valid file of {subject.name} is not read: {ending}: {original}"
    for index, mutant in enumerate(mutants(subject, count, seed)):
        if index not in indices:
            continue
        path = _written(subject, mutant, place)
        if child.process is None:  # a child's first file, which sets the limit of memory, must be the valid one
            child.ask(subject.reader, subject.path)
        ending, answer = child.ask(subject.reader, path)
        verdict = ending
        if ending == "refused" and subject.honest is not None and subject.honest(path) is not None:
            verdict = "refused though meant"  # no finding: redundant lines, or a size that only looks wrong
        if ending == "content":
            verdict = "same" if answer.split()[0] == original.split()[0] else "other"
            answer, *parts = answer.split()
            quiet, same_shape, same_counts, same_but_names = (one == other for one, other in zip(parts, original.split()[1:],
                                                                                                 strict=True))
            if verdict == "other" and subject.honest is not None:
                meaning = subject.honest(path)
                verdict = "meant" if meaning is not None and fingerprint(meaning) == answer else "wrong content"
            elif (verdict == "other" and mutant.kind in subject.strict and not mutant.file.endswith(".json")
                    and (quiet or mutant.kind != "comma")):
                verdict = "wrong content"
            if verdict == "other":
                valid = (subject.path / mutant.file if mutant.file else subject.path).read_bytes()
                rule = "" if mutant.data is None else undetectable(
                    subject, valid, mutant.data, same_shape, same_counts, same_but_names)
                verdict = ("other, with a word" if not quiet else f"undetectable ({rule})" if rule else
                           f"silent ({mutant.kind})")
        if verdict.startswith(("silent", "undetectable")):
            yield verdict, f"{verdict}: {subject.name} {index} {mutant.file} ({mutant.kind}): {mutant.what}"
        elif verdict in ("same", "meant", "refused", "refused though meant", "other, with a word"):
            yield verdict, ""
        else:
            kept = keep / f"{subject.name}-{seed}-{index}{subject.path.suffix}"
            with contextlib.suppress(OSError):
                shutil.rmtree(kept) if kept.is_dir() else kept.unlink(missing_ok=True)
            shutil.move(path, kept)
            yield verdict, (f"{verdict}: {subject.name} {mutant.file} ({mutant.kind}: {mutant.what}), kept as {kept}"
                            + ("" if ending == "content" else f": {answer}"))


def _written(subject: Subject, mutant: Mutant, place: Path) -> Path:
    """The damaged file or folder, under the valid one's name."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    path = place / subject.path.name
    if mutant.file:
        shutil.copytree(subject.path, path)
    file = path / mutant.file if mutant.file else path
    if mutant.data is None:
        file.unlink()
    else:
        file.write_bytes(mutant.data)
    return path


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1]), writable=False), Connection(int(sys.argv[2]), readable=False), int(sys.argv[3]))
