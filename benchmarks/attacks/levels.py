"""`reduce_by_levels` that was killed, or whose files were damaged: the digits of an undisturbed run, or a file is named.

killed    kill -9 at a random moment of a process that reduces one model after another into one folder, or of one of its workers
damaged   files of the folder are cut, zeroed, changed, exchanged, gone, or of another model, and the call is repeated
expanded  the same between the reduction and `expand`
pieces    the same with the meshes that the parts are made of
full      the folder is on a disk that becomes full (a tmpfs; needs the right to mount one)
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, heard
from femsub.checks import CERTIFIED

KINDS = ("killed", "damaged", "expanded", "pieces", "full")
STEEL = fs.Material(2.1e11, 0.3, 7850.0)
Digits = tuple[np.ndarray, dict[str, np.ndarray]]


def arm(at: int, count: int, length: int, seed: int) -> fs.Substructure:
    """One of `count` pieces of a chain with random springs, held at its begin."""
    rng = np.random.default_rng([seed, at])
    masses, belt = rng.uniform(0.5, 2.0, length), int(rng.integers(1, length + 1))
    bare = fs.chain(length, masses=masses, fixed=at == 1, damping=0.01, belt=belt)
    scale = np.diag(rng.uniform(0.9, 1.1, length))
    ends = {f"p{one}+p{one + 1}": [0 if one == at - 1 else length - 1] for one in (at - 1, at) if 0 < one < count}
    return fs.Substructure(bare.M, scale @ bare.K.toarray() @ scale, scale @ bare.D.toarray() @ scale, ends,
                           bare.ports if at == 2 else None, name=f"p{at}")


def arms(seed: int) -> dict[str, partial[fs.Substructure]]:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 7))
    return {f"p{at}": partial(arm, at, count, int(rng.integers(9, 40)), seed) for at in range(1, count + 1)}


def digits(levels: fs.Levels) -> Digits:
    """Frequencies, and the displacements of the lowest modes by part."""
    modes = fs.normal_modes(levels.model, 3)
    if levels.bounds(2).evidence != CERTIFIED:
        raise ValueError("not certified")
    return modes.frequencies, dict(levels.expand(modes.shapes))


def off(found: Digits, right: Digits) -> float:
    """The largest relative difference of two, whatever signs their modes have."""
    sign = np.sign(np.sum([np.sum(found[1][name] * u, axis=0) for name, u in right[1].items()], axis=0))
    size = max(np.abs(u).max() for u in right[1].values())
    return max(float(np.abs(found[0] / right[0] - 1).max()),
               *(float(np.abs(sign * found[1][name] - u).max()) / size for name, u in right[1].items()))


FAULTS = ("zeroed", "zeroed", "cut", "longer", "flipped", "flipped", "gone", "folder", "exchanged", "linked")


def damage(rng: Random, path: Path, others: list[Path]) -> str:
    """Does one of these to a file, in two cases with another one; what was done."""
    fault, content = FAULTS[int(rng.integers(len(FAULTS)))], bytearray(path.read_bytes())
    if fault == "zeroed":  # as a power cut leaves a file
        begin = int(rng.choice([128, 4096, rng.integers(len(content))]))
        content[begin:] = bytes(max(len(content) - begin, 0))
    elif fault == "cut":
        del content[int(rng.integers(len(content))):]
    elif fault == "longer":
        content += rng.bytes(int(rng.integers(1, 99)))
    elif fault == "flipped":
        for at in rng.integers(len(content), size=int(rng.integers(1, 4))):
            content[at] ^= 1 << int(rng.integers(8))
    elif fault in ("exchanged", "linked"):
        other = others[int(rng.integers(len(others)))]
        if not other.exists() or other == path:
            return fault
        if fault == "exchanged":
            mine, content = content, bytearray(other.read_bytes())
            other.write_bytes(mine)
    if fault in ("gone", "folder", "linked"):
        path.unlink()
    else:
        path.write_bytes(content)
    if fault == "folder":
        path.mkdir()
    elif fault == "linked":
        path.symlink_to(other)
    return fault


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "alive")


def content_of(folder: Path) -> dict[str, bytes | None]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))
            if path.name not in ("alive", "task") and (path.is_file() or not any(path.iterdir()))}


def harmed(rng: Random, folder: Path, stale: Path) -> str:
    """One to three faults; what was done. Of two models, whole tasks and single files of the other come as well."""
    done = []
    for _ in range(int(rng.integers(1, 4))):
        paths = files_of(folder)
        path = paths[int(rng.integers(len(paths)))]
        where = path.relative_to(folder)
        if rng.random() < 0.2 and (other := stale / where).exists():
            path.unlink()
            shutil.copyfile(other, path)
            done.append(f"{where} of another model")
        elif rng.random() < 0.15 and (stale / where.parts[0]).exists():
            shutil.rmtree(folder / where.parts[0])
            shutil.copytree(stale / where.parts[0], folder / where.parts[0])
            done.append(f"all of {where.parts[0]} of another model")
        else:
            done.append(f"{where} {damage(rng, path, paths)}")
    return ", ".join(done)


def damaged(seed: int, place: Path, expanded: bool) -> str:
    rng = np.random.default_rng(seed)
    parts, method = arms(seed), fs.CraigBampton(modes=int(rng.integers(3, 6)))
    levels = fs.reduce_by_levels(parts, method, place / "work")
    right, x = digits(levels), fs.normal_modes(levels.model, 3).shapes
    others = {name: partial(one.func, *one.args[:3], seed + int(rng.integers(2))) for name, one in parts.items()}
    fs.reduce_by_levels(others, fs.CraigBampton(modes=3 + int(rng.integers(3))), place / "stale")
    before = content_of(place / "work")
    what = harmed(rng, place / "work", place / "stale")
    if expanded:
        try:
            found = right[0], dict(levels.expand(x))
        except fs.InputError as error:
            return "refused" if f"{place / 'work'}" in str(error) else f"wrong: {what}: no file is named: {error}"
        return "certified" if (far := off(found, right)) < 1e-9 else f"wrong: {what}: off by {far:.1e}"
    after = content_of(place / "work")
    changed = {name.partition("/")[0] for name in before | after if before.get(name) != after.get(name)}
    again, refusal, said = heard(fs.reduce_by_levels, parts, method, place / "work")
    if refusal:
        raise refusal
    named = {task for task in changed for one in said if re.search(rf"{re.escape(str(place / 'work' / task))}[/ ]", str(one))}
    if (far := off(digits(again), right)) > 1e-9:
        return f"wrong: {what}: off by {far:.1e}"
    if silent := [task for task in changed - named if f"all of {task} of" not in what and f"{task}/task/" not in what]:
        return f"wrong: {what}: {silent} without a word: {[str(one) for one in said]}"
    return "certified, and named" if named else "certified"


def pieces(seed: int, place: Path) -> str:
    rng = np.random.default_rng(seed)
    mesh = fs.block((2.0, 0.1, 0.15), (int(rng.integers(8, 16)), 1, 1), "hexahedron")
    parts = fs.cut_to_files(place / "meshes", mesh, fs.solid, into=3, material=STEEL, supports=["left"])
    method, late = fs.CraigBampton(cutoff=3e4), bool(rng.integers(2))
    levels = fs.reduce_by_levels(parts, method, place / "work")
    right, x = digits(levels), fs.normal_modes(levels.model, 3).shapes
    paths = files_of(place / "meshes")
    path = paths[int(rng.integers(3))]
    fault = damage(rng, path, paths)
    try:
        found = (right[0], dict(levels.expand(x))) if late else digits(fs.reduce_by_levels(parts, method, place / "again"))
    except fs.InputError as error:
        return "refused" if f"{place / 'meshes'}" in str(error) else f"wrong: no file is named: {error}"
    return "certified" if (far := off(found, right)) < 1e-9 else f"wrong: {fault}: off by {far:.1e}"


def run(seed: int, folder: str, workers: int) -> None:
    """What the process does that is killed: one model after the other into one folder, without end."""
    print("begin", flush=True)
    while True:
        for modes in (3, 4):
            fs.reduce_by_levels(arms(seed), fs.CraigBampton(modes=modes), folder, workers=workers)


def children(pid: int) -> list[int]:
    found = [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]
    return [one for one in found if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]


def killed(seed: int, place: Path) -> str:
    rng = np.random.default_rng(seed)
    workers = 2 if seed % 4 == 3 else 1
    command = [sys.executable, "-c", f"from {__name__} import run; run({seed}, {str(place / 'work')!r}, {workers})"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None and process.stdout.readline() == "begin\n"
    time.sleep(float(rng.uniform(0.0, 4.0 if workers > 1 else 1.0)))
    victim = process.pid
    if workers > 1 and rng.random() < 0.5 and (found := children(process.pid)):
        victim = found[int(rng.integers(len(found)))]
    os.kill(victim, signal.SIGKILL)
    if victim != process.pid:
        try:
            process.wait(10)  # with a WorkerError, or it had begun a worker anew
        except subprocess.TimeoutExpired:
            process.kill()
    process.wait()
    process.stdout.close()
    left = [*place.glob("work/*.unfinished")]
    method = fs.CraigBampton(modes=3 + int(rng.integers(2)))
    for _ in range(100):  # workers of a process that was killed end a moment later
        try:
            levels = fs.reduce_by_levels(arms(seed), method, place / "work")
            break
        except fs.InputError as error:
            if "another run works" not in str(error):
                raise
            time.sleep(0.1)
    right = digits(fs.reduce_by_levels(arms(seed), method, place / "alone"))
    if (far := off(digits(levels), right)) > 1e-9:
        return f"wrong: off by {far:.1e}"
    if here := list((place / "work").glob("*.unfinished")):
        return f"wrong: left: {here}"
    return "certified, within a write" if left else "certified"


@contextmanager
def small_disk(place: Path, size: int) -> Iterator[None]:
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", place], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", place], check=True, capture_output=True)


def full(seed: int, place: Path) -> str:
    """The disk has room for a part of the results; then it is made larger."""
    rng = np.random.default_rng(seed)
    parts, method = arms(seed), fs.CraigBampton(modes=4)
    alone = fs.reduce_by_levels(parts, method, place / "alone")
    pages = 4096 * (1 + sum(1 + path.stat().st_size // 4096 for path in files_of(place / "alone")))
    disk = place / "disk"
    try:
        with small_disk(disk, 4096 * int(rng.integers(1, pages // 4096))):
            try:
                found = fs.reduce_by_levels(parts, method, disk)
                outcome = "certified"
            except fs.NotEnoughMemoryError as error:
                if str(disk) not in str(error) or "Make room there" not in str(error):
                    return f"wrong: {error}"
                if here := list(disk.glob("*.unfinished")):
                    return f"wrong: left: {here}"
                subprocess.run(["mount", "-o", f"remount,size={4 * pages}", disk], check=True, capture_output=True)
                found, outcome = fs.reduce_by_levels(parts, method, disk), "refused, and went on with room"
            far = off(digits(found), digits(alone))
            return outcome if far < 1e-9 else f"wrong: off by {far:.1e}"
    except (subprocess.CalledProcessError, FileNotFoundError):
        return "not run: no right to mount"


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    acts: dict[str, Callable[[int, Path], str]] = {"killed": killed, "damaged": partial(damaged, expanded=False),
                                                   "expanded": partial(damaged, expanded=True), "pieces": pieces, "full": full}
    with tempfile.TemporaryDirectory() as folder:
        return acts[kind](int(rng.integers(2**31)), Path(folder))
