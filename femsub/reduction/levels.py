"""`reduce_by_levels`: parts made, reduced and freed one by one in workers, then joined and reduced pair by pair.

No process holds more than one part, or two reduced parts. Each result has a folder of its own, so that a run that was killed can
continue from the results that exist.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from femsub.algebra import DamagedFileError, Files, check_workers, files_of, load, most_memory, only_one, side_by_side, store
from femsub.checks import Array, InputError, InputTypeError, choice, instance, mapping, path_of, warn, word
from femsub.coupling import Rigid, System, couple, rows_of_parts
from femsub.model import ReducedSubstructure, Substructure
from femsub.reduction.basis import Partition
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.frequency_bounds import FrequencyBounds, frequency_bounds
from femsub.reduction.method import reduced

log = logging.getLogger(__name__)

Recipe: TypeAlias = Callable[[], Substructure]
UNFINISHED = ".unfinished"  # ending of a folder that is being written
MODEL, TASK = "model", "task"  # files in the folder of a task
JOINED = "+"  # in the names of sets that parts share, as 'p1+p2'
ADVICE = "Call reduce_by_levels again with the same arguments: it continues from the finished parts"
ROOM = f"Make room there. {ADVICE}. Or name another folder"
FORM = 3  # version of the folders' format; results in another format are computed again


@dataclass(frozen=True, repr=False)
class Task:
    """The record of one result of a worker: a reduced part, or two earlier results that were joined and reduced.

    Attributes
    ----------
    name : str
    level : int
        0 for a part; 1 or more for two joined results.
    below : tuple of str
        The names of the two results that were joined; empty for a part.
    parts : tuple of str
        The names of all parts in the result.
    sets : mapping of str to int
        The open interface: its named sets, each with its number of DOF.
    size, reduced_to, modes : int
        Numbers of coordinates before and after the reduction, and of fixed-interface modes among them.
    cutoff : float
        No mode that was left out lies below this frequency, in radians per unit of time.
    seconds : float
        From the start of the task until its files are written.
    memory : float
        Peak memory of the worker's process until then, in bytes.
    bytes : float
        The size of its files, which the next level reads.
    key : str
        A hash of all inputs of the result.
    files : mapping of str to (int, str)
        The size and the hash of each of its files, which are checked before the files are used.
    """

    name: str
    level: int
    below: tuple[str, ...]
    parts: tuple[str, ...]
    sets: Mapping[str, int]
    size: int
    reduced_to: int
    modes: int
    cutoff: float
    seconds: float = 0.0
    memory: float = 0.0
    bytes: float = 0.0
    key: str = ""
    files: Files = field(default_factory=dict)

    def __repr__(self) -> str:
        return (f"Task {self.name!r}: {self.size} coordinates to {self.reduced_to}, cut-off {self.cutoff:.4g} rad/time, "
                f"{self.seconds:.3g} s, {self.memory / 1e9:.2g} GB")


@dataclass(frozen=True, eq=False, repr=False)
class Levels:
    """A model of many parts, each of which was in memory only while it was reduced. `reduce_by_levels` makes it.

    Attributes
    ----------
    model : System
        The last two results, joined. Its ports are the ports of the parts, named as 'p7.belt'. Its interface consists of the
        parts' sets without a '+', named as 'p7.end'.
    tasks : mapping of str to Task
        The records of all results, level by level.
    recipes : mapping of str to callable
        The functions that make the parts, as given.
    folder : Path

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.block((4.0, 0.1, 0.1), (40, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0)
    >>> parts = fs.cut_to_files("bar", mesh, fs.solid, into=4, material=steel, supports=["left"])
    >>> bar = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=2e4), "bar/reduced")
    >>> [(task.level, task.size > task.reduced_to) for task in bar.tasks.values()]
    [(0, True), (0, True), (0, True), (0, True), (1, True), (1, True), (2, False)]
    """

    model: System
    tasks: Mapping[str, Task]
    recipes: Mapping[str, Recipe]
    folder: Path

    def __repr__(self) -> str:
        sizes = [task.size for task in self.tasks.values() if not task.below]
        return (f"Levels: {len(sizes)} parts of {sum(sizes)} DOF in total, joined in {self.levels} levels to {self.model.size} "
                f"coordinates; the most memory of a process {self.memory / 1e9:.2g} GB")

    @property
    def levels(self) -> int:
        return max(task.level for task in self.tasks.values())

    @property
    def memory(self) -> float:
        """Largest peak memory of a process, in bytes: of a worker, or of the process that joined the last two results."""
        return max(task.memory for task in self.tasks.values())

    def bounds(self, count: int) -> FrequencyBounds:
        """`frequency_bounds` of the whole model, with all steps of reduction included. No full model is needed."""
        return frequency_bounds(self.model, count)

    def expand(self, x: Array, names: Sequence[str] | None = None) -> Iterator[tuple[str, Array]]:
        """The displacements of one part after the other, (name, u), from coordinates x of the model, shape (n,) or (n, k).

        Each part is made and factorised again, since its constraint modes are not stored. `names` selects parts; default all.

        Raises
        ------
        InputError
            x has the wrong number of rows; a part is unknown; a file of the folder is not as it was written.
        """
        for name in names or ():
            choice("part", name, self.recipes)
        x = np.asarray(x)
        if x.ndim == 0 or x.shape[0] != self.model.size:
            raise InputError(f"x must have {self.model.size} rows, one per coordinate, but its shape is {x.shape}")
        # from the last task down to the parts, each with its coordinates q (r, k)
        waiting = [(name, self.model.L[rows] @ x.reshape(len(x), -1)) for name, rows in
                   zip(self.model.parts, rows_of_parts(self.model.parts), strict=True)]
        while waiting:
            name, q = waiting.pop()
            task = self.tasks[name]
            if task.below:
                down = _read(self.folder, task)["down"]
                waiting += [(below, down[below] @ q) for below in task.below]
            elif names is None or name in names:
                part = self.recipes[name]()
                if part.size != task.size or _lengths(part) != task.sets:
                    raise InputError(f"the function of the part {name!r} makes another component now, of {part.size} DOF "
                                     f"instead of {task.size}, or with another interface. Delete {self.folder} and reduce again")
                # constraint modes by a new solve, the other shapes as stored
                n_b, u = len(part.interface), np.zeros((part.size, q.shape[1]))
                u[part.interface] = q[:n_b]
                if len(part.interior):
                    loads = part.K[part.interior][:, part.interface] @ q[:n_b]
                    u[part.interior] = Partition.of(part, True).factored().factor.solve(-loads)
                    u[part.interior] += _read(self.folder, task)["beside"] @ q[n_b:]
                yield name, u.reshape(-1, *x.shape[1:])


def reduce_by_levels(parts: Mapping[str, Recipe], method: CraigBampton, folder: str | Path, *, workers: int | None = None,
                     executor: Executor | None = None) -> Levels:
    """Reduce a model that no process can hold: each part in a worker, then pair by pair, as `couple` and `reduce` would.

    Level 0 reduces each part to its interface and its fixed-interface modes. Each further level joins the results in
    pairs:

        (M, K)_ab = Lᵀ diag(M_a, M_b) L, Lᵀ diag(K_a, K_b) L;   DOF that only a and b share become interior: V = [[I, 0], [Ψ, Φ]].

    So each joint is reduced at the level where it closes, with all other interfaces held. No matrix contains the whole interface.
    The last two results are joined to the model. This is automated multi-level substructuring with parts in place of a matrix's
    ordering.

    Interface sets with a '+' in their name, as 'p1+p2', are joined with sets of the same name, DOF by DOF where they meet. Such
    a set has all DOF that these parts, and no others, share. All other sets stay open.

    Parameters
    ----------
    parts : mapping of str to callable
        For each part a function without arguments that makes its `Substructure`, or a `functools.partial` of a function. Pickle
        must accept it. `cut_to_files` makes such functions from a mesh. A worker makes the part, and ``expand`` makes it again.
    method : CraigBampton
        The same at all levels. ``CraigBampton(cutoff=...)`` keeps all modes below a frequency in radians per unit of time: take
        some 5 to 10 times the highest frequency of interest.
    folder : str or Path
        For the result of each step. Results of an earlier run with the same parts and method are reused; all others are computed.
        Each file is compared with its hash first. A warning names a damaged file, and its step is repeated. A function is
        identified by its name and arguments: delete the folder if you change its code. The processes of an executor must have
        access to the folder. Its files are read by pickle: do not use a folder of somebody you do not trust.
    workers, executor
        As in `reduce`.

    Returns
    -------
    Levels
        ``.model``, ``.bounds(count)`` of its frequencies, ``.expand(x)``, and time and memory of each step in ``.tasks``.

    Raises
    ------
    InputError, InputTypeError
        A part shares no set with the others; another method; a function returns no Substructure; another run uses the folder.
    NotEnoughMemoryError
        The folder has no room for a result. With more room the same call continues from there.
    WorkerError
        A worker process died or ran out of memory. The same call continues from there.

    Notes
    -----
    A joint of n_b DOF makes dense matrices of some 2 n_b rows, so this suits parts in a row, or with small joints.

    References
    ----------
    J. K. Bennighof, R. B. Lehoucq, SIAM J. Sci. Comput. 25 (2004) 2084.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.block((4.0, 0.1, 0.1), (40, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0)
    >>> parts = fs.cut_to_files("bar", mesh, fs.solid, into=4, material=steel, supports=["left"])
    >>> bar = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=2e4), "bar/reduced")
    >>> bar.levels, bar.bounds(4).evidence
    (2, 'certified')
    """
    for name, recipe in mapping("parts", parts, "names and functions, as {'p1': partial(build, 'p1.vtu')}").items():
        if not word("the name of a part", name) or re.search(r"[./\\~\s]", name):
            raise InputError(f"the name of a part is that of a folder, without '.', '/', '~' and spaces, but one is {name!r}")
        if not callable(recipe):
            raise InputTypeError(f"the part {name!r} must be a function without arguments that makes a Substructure, not "
                                 f"{type(recipe).__name__}. Reduce an existing Substructure by reduce")
    if len(parts) < 2:
        raise InputError(f"parts must be two or more, but there are {len(parts)}; reduce takes one")
    if type(instance("method", method, CraigBampton)) is not CraigBampton or method.band is not None:
        raise InputError("parts are joined level by level by CraigBampton(cutoff=...) or CraigBampton(modes=...), not by "
                         f"{method}")
    check_workers(workers, executor)
    target = path_of("folder", folder).absolute()
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be made: {error.strerror or error}") from None
    with only_one(target):
        for left in target.glob(f"*{UNFINISHED}"):
            _cleared(left)
        done = partial(_done, target, workers=workers, executor=executor)
        first = {name: (_key(recipe, method), recipe, method) for name, recipe in parts.items()}
        tasks = done(_reduced_part, first, what="part")
        there, level = list(tasks.values()), 0
        while len(there) > 2:
            level += 1
            jobs = {}
            for pair in _pairs(there):
                closing = _closing(pair, there)
                # the files belong to the key: modes may have other signs if a task is computed again
                content = [repr((task.name, task.key, sorted(task.files.items()))) for task in pair]
                jobs["~".join((pair[0].parts[0], pair[1].parts[0], str(level)))] = (
                    _key(*content, closing, level, method), pair, closing, level, method)
            made = done(_reduced_pair, jobs, what="pair")
            tasks |= made
            joined = {name for task in made.values() for name in task.below}
            there = [*made.values(), *(task for task in there if task.name not in joined)]
        _pairs(there)
        start = time.perf_counter()
        system = _joined(target, "model", there, _closing(there, there))
        last = Task(system.name, level + 1, tuple(task.name for task in there),
                    tuple(name for task in there for name in task.parts), _lengths(system), system.size, system.size, 0,
                    system.cutoff, time.perf_counter() - start, most_memory())
        return Levels(system, tasks | {system.name: last}, dict(parts), target)


def _key(*what: object) -> str:
    """A hash of all inputs of a result."""
    try:
        return hashlib.sha256(pickle.dumps((FORM, *what), protocol=5)).hexdigest()
    except Exception as error:
        raise InputError(f"a part's function cannot be sent to a worker, since pickle refuses it: {error}. Define it at the top "
                         "level of a module") from None


def _done(folder: Path, call: Callable[..., Task], jobs: Mapping[str, tuple[Any, ...]], what: str, workers: int | None,
          executor: Executor | None) -> dict[str, Task]:
    """The tasks of one level: from an earlier run if there, otherwise from workers. The first entry of a job is its key."""
    found = {name: task for name, (key, *_) in jobs.items() if (task := _earlier(folder, name, key, what)) is not None}
    if found:
        log.info("%d of %d %ss are there from an earlier run", len(found), len(jobs), what)
    left = {name: (folder, name, *job) for name, job in jobs.items() if name not in found}
    if left:
        found |= side_by_side(call, left, workers, executor, what=what, advice=ADVICE)
    return {name: found[name] for name in jobs}


def _earlier(folder: Path, name: str, key: str, what: str) -> Task | None:
    """The task of an earlier run with this key, if its files are unchanged; otherwise None. Warns of damaged files."""
    if not ((folder / name).exists() or (folder / name).is_symlink()):
        return None
    try:
        task = load(folder / name / TASK)
        if task.name != name:
            raise DamagedFileError(f"{folder / name / TASK} is the record of {task.name!r}")
        if task.key != key:
            return None
        load(folder / name, task.files)
    except MemoryError:
        raise
    except Exception as error:  # a pickle of another version may raise anything
        if isinstance(error, OSError) and not isinstance(error, (FileNotFoundError, IsADirectoryError, NotADirectoryError)):
            raise _unread(folder / name, error) from None  # no free file handle, or a failing disk: the result may be intact
        why = error if isinstance(error, DamagedFileError) else f"{folder / name} is damaged ({type(error).__name__}: {error})"
        warn(f"{why}. The {what} {name!r} is made anew")
        return None
    return task


def _read(folder: Path, task: Task) -> dict[str, Any]:
    """The contents of a task's folder, after a check that its files are as the task wrote them."""
    try:
        found: dict[str, Any] = load(folder / task.name, task.files)
    except DamagedFileError as error:
        raise DamagedFileError(f"{error}. {ADVICE}, and makes {task.name!r} anew") from None
    except OSError as error:
        raise _unread(folder / task.name, error) from None
    return found


def _unread(path: Path, error: OSError) -> InputError:
    return InputError(f"{path} cannot be read: {error.strerror or error}. Nothing was deleted; try again once it can be read")


def _pairs(tasks: Sequence[Task]) -> list[tuple[Task, Task]]:
    """The pairs to join next: first pairs that share most DOF, and among these the smaller ones. Each task is in at most one."""
    found = []
    for one, other in combinations(tasks, 2):
        if shared := sum(one.sets[key] for key in _shared(one, other)):
            found.append((-shared, len(one.parts) + len(other.parts), one, other))
    met = {task.name for *_, one, other in found for task in (one, other)}
    if lost := [task for task in tasks if task.name not in met]:
        raise InputError(f"{lost[0].parts[0]!r} shares no interface set with the other parts. Sets that are joined have the same "
                         f"name in both parts, as 'p1+p2'. The sets of {lost[0].parts[0]!r} are "
                         f"{', '.join(map(repr, lost[0].sets)) or 'none'}")
    pairs: list[tuple[Task, Task]] = []
    taken: set[str] = set()
    for *_, one, other in sorted(found, key=lambda entry: entry[:2]):
        if not taken & {one.name, other.name}:
            pairs.append((one, other))
            taken |= {one.name, other.name}
    return pairs


def _shared(one: Task, other: Task) -> list[str]:
    """The sets at which two tasks are joined."""
    return [key for key in one.sets if JOINED in key and key in other.sets]


def _closing(pair: Sequence[Task], there: Sequence[Task]) -> tuple[str, ...]:
    """The sets that become interior when two tasks are joined: common sets that no other task has."""
    others = {key for task in there if task not in pair for key in task.sets}
    return tuple(key for key in _shared(*pair) if key not in others)


def _joined(folder: Path, name: str, pair: Sequence[Task], closing: Sequence[str]) -> System:
    """Two reduced models joined at their common sets. All sets but the `closing` ones form the interface and keep their names."""
    models = {task.name: _read(folder, task)[MODEL] for task in pair}
    one, other = pair
    joints = [Rigid((one.name, key), (other.name, key), name=key) for key in _shared(one, other)]
    kept = [(task, key) for task in pair for key in task.sets if key not in closing]
    system = couple(models, joints, name, interface=[(task.name, key) for task, key in kept])
    sets = {key if JOINED in key else _named(task, key): system.sets[f"{task.name}.{key}"] for task, key in reversed(kept)}
    ports = {_named(task, key): system.ports[f"{task.name}.{key}"] for task in pair for key in models[task.name].ports}
    return system._with(sets=sets, ports=ports)


def _named(task: Task, key: str) -> str:
    """'p7.belt' for 'belt' of the part p7; joined results have such names already."""
    return key if task.below else f"{task.name}.{key}"


def _lengths(sub: Substructure) -> dict[str, int]:
    return {key: len(places) for key, places in sub.sets.items()}


def _reduced_part(folder: Path, name: str, key: str, recipe: Recipe, method: CraigBampton) -> Task:
    """In a worker: the part is made, reduced, written without its constraint modes, and freed."""
    start = time.perf_counter()
    part = instance(f"what the function of the part {name!r} returns", recipe(), Substructure)
    if not part.sets:
        raise InputError(f"the part {name!r} has no named interface sets, by which parts are joined, as "
                         "interface={'p1+p2': [0, 1]}")
    model = reduced(part, method, ports=True)
    beside = np.array(model.kinds) != "constraint"
    task = Task(name, 0, (), (name,), _lengths(part), part.size, model.size, model.modes, model.cutoff, key=key)
    return _written(folder, task, start, model, beside=model.V[part.interior][:, beside])


def _reduced_pair(folder: Path, name: str, key: str, pair: tuple[Task, Task], closing: Sequence[str], level: int,
                  method: CraigBampton) -> Task:
    """In a worker: two results are read, joined, reduced and written."""
    start = time.perf_counter()
    system = _joined(folder, name, pair, closing)
    few = method if method.modes is None else CraigBampton(min(method.modes, len(system.interior)))
    model = reduced(system, few, ports=True)
    down = {task.name: system.L[rows] @ model.V for task, rows in zip(pair, rows_of_parts(system.parts), strict=True)}
    task = Task(name, level, tuple(task.name for task in pair), tuple(one for task in pair for one in task.parts),
                _lengths(system), system.size, model.size, model.modes, model.cutoff, key=key)
    return _written(folder, task, start, model, down=down)


def _written(folder: Path, task: Task, start: float, model: ReducedSubstructure, **beside: object) -> Task:
    """The task with its time and memory. Its folder has the model, with V at the interface only; it is complete or absent."""
    own = model.full_interface
    dofs = None if model.full_dofs is None else model.full_dofs.kept(own)
    light = replace(model, V=model.V[own], full_interface=np.arange(len(own)), full_dofs=dofs, name=task.name)
    new, target = folder / f"{task.name}{UNFINISHED}", folder / task.name
    _cleared(new)
    store(new, {MODEL: light, **beside}, f"the result of {task.name!r}", ROOM)
    files = files_of(new)
    task = replace(task, seconds=time.perf_counter() - start, memory=most_memory(), files=files,
                   bytes=float(sum(size for size, _ in files.values())))
    try:
        store(new / TASK, task, f"the record of {task.name!r}", ROOM)
    except BaseException:
        _cleared(new)
        raise
    _cleared(target)
    new.rename(target)
    return task


def _cleared(path: Path) -> None:
    """Delete a folder, or a file or a link of this name."""
    try:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be deleted: {error.strerror or error}. Delete it, or name another folder") from None
