"""Superelements of Nastran and Sierra/SD in public test data, against these programs' own runs.

    python -m benchmarks superelements PYYETI PYNASTRAN SDYNPY

with clones of github.com/twmacro/pyyeti (read at commit 034fb7b), github.com/SteveDoyle2/pyNastran (v1.4) and
github.com/sandialabs/sdynpy (acac752), which are not part of this repository. It needs
pyyeti and pyNastran installed. Prints one line per case.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from femsub.io.op2 import read_op2

BUSHES = ("20110010", "20110020", "20110030")  # grids that CBUSH 20110001 to 20110003 hold
STIFF, ROTATING, TWISTING = 1e9, 1e6, 10.0  # PBUSH 230093: along all axes, about r and θ, about z of frame 200102
AXIS = np.array([0.0007401582292714349, 0.0, 0.9999997260828603])  # z of frame 200102
LOADED, FORCE = "20110034", 50.0  # cases 105, 106, 107: along x, y, z


def last(path: Path, name: str) -> Any:
    from pyyeti.nastran import op4

    names, matrices, *_ = op4.load(str(path), into="list")
    return [matrix for known, matrix in zip(names, matrices, strict=True) if known == name][-1].ravel()


def joined(folder: Path) -> tuple[Any, Any]:
    """NX Nastran 9: inboard and outboard by SECONCT."""
    parts = {name: fs.read_component(folder / f"{name}.asm", cutoff=314.0) for name in ("inboard", "outboard")}
    system = fs.couple(parts, [fs.Rigid(("inboard", "boundary"), ("outboard", "boundary"))])
    return fs.normal_modes(system, count=48).frequencies[6:], np.sqrt(last(folder / "nas2cam.op4", "lambda")[6:])


def free(folder: Path, run: str) -> tuple[Any, Any]:
    """One superelement, of whose grid 475 only one motion is boundary, free."""
    part = fs.read_component(folder / "reduced_bset_notall6.asm", cutoff=1e3)
    theirs = np.sqrt(last(folder / f"nas2cam_notall6_{run}.op4", "lambda")[6:])
    return fs.normal_modes(part, count=len(theirs)).frequencies[6:6 + len(theirs)], theirs


def one_file(folder: Path) -> tuple[Any, Any]:
    """Simcenter Nastran 2019.2: a superelement in one .op2 file, free, and the frequencies of the run that made it."""
    from pyNastran.op2.op2 import OP2

    part = fs.read_component(folder / "other/extse04c_cnv2_0.op2", cutoff=500.0)
    result = OP2(debug=None)
    result.read_op2(str(folder / "superelements/extse04c.op2"))
    theirs = np.sqrt(next(iter(result.eigenvectors.values())).eigns[6:10])
    return fs.normal_modes(part, count=4).frequencies[6:10], theirs


def op2_matrices(folders: Sequence[Path]) -> None:
    """The matrices of all .op2 files up to 1.5 MB, by femsub and by pyYeti."""
    from pyyeti.nastran.op2 import OP2

    files = [path for folder in folders for path in sorted(folder.rglob("*.op2")) if path.stat().st_size < 1_500_000]
    read, equal, count = 0, 0, 0
    for path in files:
        try:
            ours = read_op2(path).matrices
        except fs.InputError as error:
            print(f"  {error}")
            continue
        read += 1
        for name, several in OP2(str(path)).rdop2mats(which="all", lower=True).items():
            for at, theirs in enumerate(several, 1):
                found: Any = ours.get(name if at == 1 else f"{name}#{at}")
                count += 1
                equal += found is not None and np.array_equal(found.toarray(), theirs)
    print(f".op2: {read} of {len(files)} files read, {equal} of {count} matrices of pyYeti the same")


def sierra(folder: Path) -> None:
    """Full matrices of Sierra/SD, and two of its Craig-Bampton models joined, against its frequencies of the full models."""
    from scipy.io import netcdf_file

    def theirs(name: str) -> Any:
        with netcdf_file(folder / f"{name}-eig.exo", mmap=False) as found:
            return 2 * np.pi * found.variables["time_whole"][6:].copy()

    for name in ("block_a", "block_a2", "block_c"):
        part = fs.read_component(folder / f"{name}_Maa.m", folder / f"{name}_Kaa.m", interface=[0])
        apart = fs.normal_modes(part, count=20).frequencies[6:] / theirs(name)[:20] - 1
        print(f"Sierra/SD, {name}: {part.size} DOF, 20 frequencies, relative difference {np.abs(apart).max():.1e}")
    parts = {f"p{at}": fs.read_component(folder / f"block_{at}-cbr.nc4", cutoff=1e4) for at in (1, 2)}
    system = fs.couple(parts, [fs.Rigid(("p1", "boundary"), ("p2", "boundary"))])
    apart = fs.normal_modes(system, count=20).frequencies[6:] / theirs("block_all")[:20] - 1
    print(f"Sierra/SD, two Craig-Bampton models joined: 20 frequencies, above those of the full model by {apart.min():.1e} to "
          f"{apart.max():.1e}")


def bushes(folder: Path) -> tuple[Any, Any]:
    """MSC Nastran 2017: sizes of the forces and moments in three bushes that hold a superelement with frames of its own."""
    from pyNastran.op2.op2 import OP2

    part = fs.read_component(folder / "incl/se/se_test_n11.asm", cutoff=1e9)
    K, rows = part.K.copy(), {grid: part.interface[part.sets[grid]] for grid in (*BUSHES, LOADED)}
    about = ROTATING * (np.eye(3) - np.outer(AXIS, AXIS)) + TWISTING * np.outer(AXIS, AXIS)
    for grid in BUSHES:
        for some, spring in ((rows[grid][:3], STIFF * np.eye(3)), (rows[grid][3:], about)):
            K[np.ix_(some, some)] += spring
    loads = np.zeros((len(K), 3))
    loads[rows[LOADED][:3]] = FORCE * np.eye(3)
    moved = np.abs(K).max(axis=0) > 1e-6  # rotations of some grids have no stiffness
    u = np.zeros(loads.shape)
    u[moved] = np.linalg.solve(K[np.ix_(moved, moved)], loads[moved])
    ours = np.array([[np.linalg.norm(spring @ u[some], axis=0) for some, spring in (
        (rows[grid][:3], STIFF * np.eye(3)), (rows[grid][3:], about))] for grid in BUSHES])
    with tempfile.TemporaryDirectory() as place:  # the file lacks its last mark, an empty record
        whole = Path(place) / "whole.op2"
        whole.write_bytes((folder / "se_test_n11_static_10_cases.op2").read_bytes() + struct.pack("<3i", 4, 0, 4))
        result = OP2(debug=None)
        result.read_op2(str(whole))
    forces = {found.isubcase: found.data[0] for found in result.op2_results.force.cbush_force.values()}
    theirs = np.array([[np.linalg.norm(forces[case][:, part].astype(float), axis=1) for part in (slice(3), slice(3, 6))]
                       for case in (105, 106, 107)])
    return ours.transpose(2, 1, 0), theirs


def main(pyyeti: Path, pynastran: Path, sdynpy: Path) -> None:
    cases = {"NX Nastran 9, two parts joined": joined(pyyeti / "pyyeti/tests/nas2cam_extseout")}
    for run in ("msc2017", "msc2017_b", "nx2021"):
        cases[f"{run}, one part free"] = free(pyyeti / "pyyeti/tests/nas2cam_extseout", run)
    cases["Simcenter Nastran 2019, one .op2 file, free"] = one_file(pynastran / "models")
    for name, (ours, theirs) in cases.items():
        print(f"{name}: {len(theirs)} frequencies, relative difference {np.abs(ours / theirs - 1).max():.1e}")
    forces, others = bushes(pynastran / "models/superelements/se_test_static")
    for at, what in enumerate(("forces", "moments")):
        worst = np.abs(forces[:, at] - others[:, at]).max() / others[:, at].max()
        print(f"MSC Nastran 2017, a part held by three bushes: 9 {what}, difference {worst:.1e} of the largest")
    op2_matrices([pynastran, pyyeti])
    sierra(sdynpy / "docs/book/assets")
