"""The trajectories of scripts/attractors.py: one for each task, followed until it has settled; safe to interrupt and resume."""

from __future__ import annotations

import json
import signal
import time
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.attractor_states import Motion, motion, settled
from benchmarks.sealed import opened, sealed
from femsub.coupling.contacts.belt import STICKING
from femsub.motion.nonlinear_model import State, project, sliding
from femsub.reduction.reduce import METHODS

Record = dict[str, Any]


COMPARED = ("craig-bampton", "craig-chang")  # the paper's methods


@dataclass(frozen=True)
class Settings:
    """The model, the belt, the starts and how long each is followed. Starts have speeds between `kicks`, see `starts`."""

    masses: int = 10
    belt: int = 2
    damping: float = 0.1
    force: float = 1.0
    speed: float = 0.19113
    eps: float = 1e-3
    kicks: tuple[float, float] = (1e-3, 1.0)
    seed: int = 1
    window: float = 2000.0
    earliest: float = 8000.0
    latest: float = 20_000.0
    step: float = 0.25
    tol: float = 1e-8

    def contact(self) -> fs.Belt:
        return fs.Belt("belt", force=self.force, speed=self.speed, law=fs.StribeckArctan(eps=self.eps))


@dataclass(frozen=True)
class Task:
    """One start of one model: 'full', 'craig-bampton' or 'craig-chang' with so many DOF and an interface (masses from 1).

    `family` is 'random' (the starts that are compared), 'again' (as many others, for the full model), 'impulse' (1e-3 on the
    belt's mass), 'rest' (no displacement, no velocity) or 'carried' (from where the full model's random start of that number has
    ended: does the reduced model stay there?).
    """

    method: str
    size: int
    interface: tuple[int, ...]
    family: str
    number: int

    @property
    def key(self) -> tuple[Any, ...]:
        return tuple(asdict(self).values())


def tasks(settings: Settings, sizes: Iterable[int], interfaces: Iterable[tuple[int, ...]], starts: int) -> list[Task]:
    """All tasks; the full model does not depend on the interface and has a second set of starts, for comparison with itself."""
    first = next(iter(interfaces))
    models = [("full", settings.masses, first)]
    models += [(method, size, interface) for interface in interfaces for method in COMPARED for size in sizes
               if len(interface) < size <= settings.masses]
    families = [("random", number) for number in range(starts)] + [("impulse", 0), ("rest", 0)]
    found = [Task(*model, *family) for model in models for family in families]
    return found + [Task(*models[0], "again", number) for number in range(starts)]


def carried(wanted: Iterable[Task], numbers: Iterable[int]) -> list[Task]:
    """For each reduced model among the tasks, those from the ends of the full model's random starts of these numbers."""
    models = dict.fromkeys((task.method, task.size, task.interface) for task in wanted if task.method != "full")
    return [Task(*model, "carried", number) for model in models for number in numbers]


@lru_cache(maxsize=4)
def full_model(settings: Settings, interface: tuple[int, ...]) -> fs.Substructure:
    return fs.chain(settings.masses, belt=settings.belt, damping=settings.damping, interface=list(interface))


@lru_cache(maxsize=64)
def model(settings: Settings, method: str, size: int, interface: tuple[int, ...]) -> fs.Substructure:
    """The full model, or a reduced one of so many DOF."""
    full = full_model(settings, interface)
    if method == "full":
        return full
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)  # a contact outside the interface is what is looked at
        return fs.reduce(full, METHODS[method](size - len(interface)))


def random_start(settings: Settings, family: str, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity of the full model beside the sliding equilibrium, shape (n,) each.

    Every mode has a Gaussian amplitude and a random phase, all with the same mean energy; the whole is scaled so that the
    speed under the belt has the rms A over such starts, with log A even between the ends of `kicks`: from small ones to several
    times the belt's speed, which begin with sticking.
    """
    sub = full_model(settings, (1,))
    modes = fs.normal_modes(sub, count=settings.masses)
    generator = np.random.default_rng([settings.seed + (family == "again"), number])
    kick = float(np.exp(generator.uniform(*np.log(settings.kicks))))
    size = kick * generator.standard_normal(settings.masses) / np.linalg.norm(modes.shapes.T @ sub.port("belt")) * np.sqrt(2)
    phase = generator.uniform(0, 2 * np.pi, settings.masses)
    return modes.shapes @ (size * np.cos(phase) / modes.frequencies), modes.shapes @ (size * np.sin(phase))


def start(settings: Settings, task: Task) -> State:
    """The same physical start for every model, by M-orthogonal projection."""
    found = model(settings, task.method, task.size, task.interface)
    contact = sliding(found, settings.contact())
    if task.family == "impulse":
        return contact.impulse(1e-3)
    if task.family == "rest":
        return State(np.zeros(found.size), np.zeros(found.size))
    if task.family == "carried":
        u, v = _ended(settings, task.number)
    else:
        u, v = random_start(settings, task.family, task.number)
    if isinstance(found, fs.ReducedSubstructure):
        M = full_model(settings, task.interface).M
        u, v = project(found, M, u), project(found, M, v)
    return contact.perturbed(u, v)


def follow(settings: Settings, task: Task) -> Record:
    """A trajectory window by window until two successive ones show one motion, not before `earliest` and until `latest`.

    Those of the family 'again' go on until `latest`: they show whether others were left too early.
    """
    began, found = time.perf_counter(), model(settings, task.method, task.size, task.interface)
    windows, first, end, _ = _settle(settings, found, start(settings, task), task.family == "again")
    steady = len(windows) > 1 and settled(*windows[-2:])
    return asdict(task) | {"settled": steady, "end": end, "settled_at": first, "seconds": time.perf_counter() - began,
                           "motion": windows[-1].flat()}


Settled = tuple[list[Motion], float | None, float, State]


def _settle(settings: Settings, found: fs.Substructure, state: State, to_the_end: bool) -> Settled:
    """The motions of all windows, when it first had settled, the time reached and the state there."""
    belt, t, first = settings.contact(), 0.0, None
    windows: list[Motion] = []
    while not windows or t < settings.latest * (1 - 1e-9):
        run = fs.transient(found, belt, (t, t + settings.window), start=state, step=settings.step, tol=settings.tol)
        if not run.complete:
            raise KeyboardInterrupt
        state, t = run.final, run.end
        windows.append(motion(run.velocity("belt")[:-1], settings.step, settings.speed, STICKING * settings.eps))
        if len(windows) > 1 and t >= settings.earliest * (1 - 1e-9) and settled(*windows[-2:]):
            first = t if first is None else first
            if not to_the_end:
                break
    return windows, first, t, state


@lru_cache(maxsize=16)
def _ended(settings: Settings, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the full model's random start has ended, beside the sliding equilibrium."""
    full, task = full_model(settings, (1,)), Task("full", settings.masses, (1,), "random", number)
    state = _settle(settings, full, start(settings, task), False)[3]
    return state.displacement - sliding(full, settings.contact()).equilibrium, state.velocity


def read(path: Path, settings: Settings) -> dict[tuple[Any, ...], Record]:
    """What a file of an earlier run holds, by key; the line on which that run was cut off is taken out of it.

    Raises
    ------
    InputError
        The file belongs to other settings.
    """
    if not path.exists():
        return {}
    text = path.read_bytes()
    whole = text[:text.rfind(b"\n") + 1]
    head, *lines = whole.splitlines() or [b""]
    if head and opened(head, path) != _head(settings):
        raise fs.InputError(f"{path} holds results of other settings; give another --out, or remove it")
    if len(whole) < len(text):
        with path.open("r+b") as file:
            file.truncate(len(whole))
    return {_key(record): record for line in lines if (record := opened(line, path)) is not None}


def _key(record: Record) -> tuple[Any, ...]:
    return tuple(tuple(value) if isinstance(value := record[name], list) else value for name in Task.__dataclass_fields__)


def _head(settings: Settings) -> Record:
    return {"settings": json.loads(json.dumps(asdict(settings)))}


def run(path: Path, settings: Settings, wanted: list[Task], workers: int, tell: Callable[[str], None]) -> list[Record]:
    """The records of all tasks, in their order: from the file, and what is not there is computed and appended as it comes."""
    done = read(path, settings)
    missing = [task for task in wanted if task.key not in done]
    if missing:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            if file.tell() == 0:
                file.write(sealed(_head(settings)) + "\n")
            for count, record in enumerate(_computed(settings, missing, workers), start=len(wanted) - len(missing) + 1):
                file.write(sealed(record) + "\n")
                file.flush()
                done[_key(record)] = json.loads(json.dumps(record))
                tell(f"{count} of {len(wanted)} trajectories: {record['method']}, {record['size']} DOF")
    return [done[task.key] for task in wanted]


def _computed(settings: Settings, missing: list[Task], workers: int) -> Iterable[Record]:
    if workers < 2:
        for task in missing:
            yield follow(settings, task)
        return
    # Ctrl-C is for the process that writes; a worker that took it would hand back half a trajectory.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=signal.signal,
                               initargs=(signal.SIGINT, signal.SIG_IGN))
    try:
        futures: list[Future[Record]] = [pool.submit(follow, settings, task) for task in missing]
        for future in as_completed(futures):
            yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
