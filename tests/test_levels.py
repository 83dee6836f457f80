"""Parts that are made in workers, reduced and joined level by level are the model that they are cut from."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rails import ARGUMENTS, STEEL, cells_of, piece, rail

import femsub as fs
from femsub.io.pieces import Piece
from femsub.reduction import levels as levels_module
from femsub.reduction.method import reduced

BAR = {"material": STEEL, "supports": ["left"], "ports": {"belt": ("patch", "x")}, "rayleigh": (0.0, 1e-7)}


def bar() -> fs.Mesh:
    mesh = fs.block((2.0, 0.1, 0.15), (24, 1, 2), "hexahedron")
    return mesh.with_sets(patch=lambda x: (abs(x[:, 0] - 1) < 0.1) & (x[:, 2] > 0.149))


def whole(parts: Mapping[str, Piece], full: fs.Substructure, u: Mapping[str, np.ndarray]) -> np.ndarray:
    """Displacements of the parts in the order of the whole model."""
    assert full.dofs is not None
    place = {key: row for row, key in enumerate(zip(full.dofs.nodes.tolist(), full.dofs.components.tolist(), strict=True))}
    found = np.full((full.size, *next(iter(u.values())).shape[1:]), np.nan)
    for name, one in u.items():
        dofs = parts[name]().dofs
        assert dofs is not None
        found[[place[key] for key in zip(dofs.nodes.tolist(), dofs.components.tolist(), strict=True)]] = one
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Piece], fs.Levels]:
    folder = tmp_path_factory.mktemp("bar")
    parts = fs.cut_to_files(folder, bar(), fs.solid, into=5, **BAR)
    return parts, fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=3e4), folder / "reduced")


def test_the_frequencies_lie_within_the_bounds(made: tuple[dict[str, Piece], fs.Levels]) -> None:
    full, (_, levels) = fs.solid(bar(), **BAR), made
    bounds, omega = levels.bounds(5), fs.normal_modes(full, 5).frequencies
    assert levels.levels == 3 and levels.model.size < 0.5 * full.size and not len(levels.model.interface)
    assert (bounds.lower <= omega * (1 + 1e-9)).all() and (omega <= bounds.upper * (1 + 1e-9)).all()
    assert bounds.evidence == "certified" and bounds.error.max() < 20 * (1 - omega / bounds.upper).max() < 1e-2


def test_the_border_is_that_of_the_whole(made: tuple[dict[str, Piece], fs.Levels]) -> None:
    full, (_, levels) = fs.solid(bar(), **BAR), made
    (port,) = levels.model.ports
    assert port.endswith(".belt")
    border, own = (fs.critical_slope(model, port=name, band=(0.0, 8e3)) for model, name in ((full, "belt"), (levels.model, port)))
    assert own.value == pytest.approx(border.value, rel=1e-4) and own.omega == pytest.approx(border.omega, rel=1e-4)


def test_displacements_come_part_by_part(made: tuple[dict[str, Piece], fs.Levels]) -> None:
    full, (parts, levels) = fs.solid(bar(), **BAR), made
    modes = fs.normal_modes(levels.model, 3)
    u = whole(parts, full, dict(levels.expand(modes.shapes)))
    assert np.allclose(np.diag(u.T @ full.K @ u), modes.eigenvalues, rtol=1e-9)  # nothing was lost on the way
    assert np.abs(np.diag(fs.normal_modes(full, 3).shapes.T @ (full.M @ u))) == pytest.approx(1.0, abs=1e-5)
    (name, one), = levels.expand(modes.shapes[:, 0], names=["p2"])
    assert name == "p2" and one.shape == (parts["p2"]().size,)
    with pytest.raises(fs.InputError, match="unknown part 'p9'"):
        list(levels.expand(modes.shapes, names=["p9"]))
    with pytest.raises(fs.InputError, match="x must have"):
        list(levels.expand(np.ones(3)))


def test_parts_may_meet_in_edges_and_points(tmp_path: Path) -> None:
    """Four pieces of a square meet in one edge, which closes last. The square floats."""
    mesh = fs.block((1.0, 1.0, 0.2), (4, 4, 1), "hexahedron")
    parts = fs.cut_to_files(tmp_path, mesh, fs.solid, into=4, material=STEEL)
    sets = {key for one in parts.values() for key in one().sets}
    assert max(key.count("+") for key in sets) >= 2
    levels = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=1e5), tmp_path / "reduced")
    full = fs.normal_modes(fs.solid(mesh, STEEL), 4)
    bounds = levels.bounds(4)
    assert bounds.rigid == full.rigid == 6
    assert (bounds.lower <= full.frequencies[6:] * (1 + 1e-9)).all() and (full.frequencies[6:] <= bounds.upper * (1 + 1e-9)).all()


def chain_piece(at: int, count: int, folder: str = "") -> fs.Substructure:
    """One of `count` pieces of a chain of unit masses, held at its start, with an open end; a file tells that it was made."""
    if folder:
        Path(folder, f"made-{at}-{len(list(Path(folder).iterdir()))}").touch()
    ends = {f"p{one}+p{one + 1}": [0 if one == at - 1 else 9] for one in (at - 1, at) if 0 < one < count}
    ends |= {"end": [9]} if at == count else {}
    masses = np.ones(10)
    masses[0] *= 0.5 if at > 1 else 1.0
    masses[-1] *= 0.5 if at < count else 1.0
    bare = fs.chain(10, masses=masses, fixed=at == 1, damping=0.0)
    return fs.Substructure(bare.M, bare.K, interface=ends, name=f"p{at}")


def chain_parts(count: int, folder: str = "") -> dict[str, partial[fs.Substructure]]:
    return {f"p{at}": partial(chain_piece, at, count, folder) for at in range(1, count + 1)}


def test_parts_need_no_mesh_and_an_open_end_stays_open(tmp_path: Path) -> None:
    levels = fs.reduce_by_levels(chain_parts(4), fs.CraigBampton(modes=4), tmp_path)
    assert list(levels.model.sets) == ["p4.end"] and len(levels.model.interface) == 1
    bounds, full = levels.bounds(3), fs.chain_frequencies(37)[:3]
    assert (bounds.lower <= full).all() and (full <= bounds.upper * (1 + 1e-9)).all() and bounds.error.max() < 0.05
    more = fs.chain(3, interface=[1], fixed=False)
    further = fs.couple({"all": levels.model, "more": more}, [fs.Rigid(("all", "p4.end"), ("more", [0]))])
    assert fs.normal_modes(further, 1).frequencies[0] < bounds.upper[0]


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    notes, work = tmp_path / "notes", tmp_path / "work"
    notes.mkdir()
    first = fs.reduce_by_levels(chain_parts(4, str(notes)), fs.CraigBampton(modes=3), work)
    assert len(list(notes.iterdir())) == 4
    again = fs.reduce_by_levels(chain_parts(4, str(notes)), fs.CraigBampton(modes=3), work)
    assert len(list(notes.iterdir())) == 4 and (again.model.K == first.model.K).all()
    (work / "p2" / "pickle").write_bytes(b"cut short")
    with pytest.warns(fs.FemsubWarning, match=r"p2/pickle is damaged, .*: it has 9 bytes.*The part 'p2' is made anew"):
        fs.reduce_by_levels(chain_parts(4, str(notes)), fs.CraigBampton(modes=3), work)
    assert len(list(notes.iterdir())) == 5
    fs.reduce_by_levels(chain_parts(4, str(notes)), fs.CraigBampton(modes=2), work)
    assert len(list(notes.iterdir())) == 9
    assert not [path for path in work.iterdir() if path.name.endswith(".unfinished")]


@pytest.mark.parametrize("error", [MemoryError(), OSError(24, "Too many open files"), OSError(5, "Input/output error")])
def test_what_cannot_be_read_for_now_is_not_taken_for_damaged(error: Exception, tmp_path: Path,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: object, **__: object) -> None:
        raise error

    notes, work = tmp_path / "notes", tmp_path / "work"
    notes.mkdir()
    parts, method = chain_parts(2, str(notes)), fs.CraigBampton(modes=3)
    fs.reduce_by_levels(parts, method, work)
    for place in ("numpy.load", "femsub.checks.hash_of"):
        with monkeypatch.context() as patch, pytest.raises((MemoryError, fs.InputError)):
            patch.setattr(place, failing)
            fs.reduce_by_levels(parts, method, work)
    fs.reduce_by_levels(parts, method, work)
    assert len(list(notes.iterdir())) == 2


def files_in(folder: Path) -> list[str]:
    """All files that the tasks have written, but for arrays of zeros."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file() and path.name != "alive"
                  and any(path.read_bytes()[128:]))


def spoilt(path: Path, how: str, other: bytes = b"") -> None:
    content = bytearray(path.read_bytes())
    if how == "zeros":  # as a power cut leaves a file
        content[128:] = bytes(len(content) - 128)
    elif how == "cut":
        del content[len(content) // 2:]
    elif how == "another":
        content = bytearray(other)
    else:
        content[-20] ^= 16
    path.unlink()
    if how != "missing":
        path.write_bytes(content)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("how", ["zeros", "cut", "bit", "missing", "another"])
def test_a_damaged_file_is_named_and_what_it_belongs_to_is_made_anew(tmp_path: Path, how: str) -> None:
    """The digits are those of a run that nobody has disturbed."""
    parts, method = chain_parts(3), fs.CraigBampton(modes=4)
    first = fs.reduce_by_levels(parts, method, tmp_path / "work")
    x = fs.normal_modes(first.model, 3).shapes
    right, names = dict(first.expand(x)), files_in(tmp_path / "work")
    assert {name.partition("/")[0] for name in names} == {*first.tasks} - {"model"} and len(names) > 12
    whole = {name: (tmp_path / "work" / name).read_bytes() for name in names}
    kept = {task: [name for name in names if name.startswith(f"{task}/")] for task in first.tasks}
    # one file of each part at a time, then one of each pair: those of a level do not need each other
    pairs = [task for task in kept if "~" in task]
    for level in ([task for task in kept if task not in pairs], pairs):
        for at in range(max(len(kept[task]) for task in level)):
            damaged = [kept[task][at] for task in level if at < len(kept[task])]
            for name in damaged:
                task, _, file = name.partition("/")
                others = [other for one in kept if one != task and (other := f"{one}/{file}") in whole
                          and whole[other] != whole[name]]
                spoilt(tmp_path / "work" / name, how, whole[[*others, names[name == names[0]]][0]])
            with pytest.warns(fs.FemsubWarning, match="is made anew") as told:
                again = fs.reduce_by_levels(parts, method, tmp_path / "work")
            assert len(told) == len(damaged)
            assert all(str(Path(name).parent) in str(one.message) for name, one in zip(damaged, told, strict=True))
            assert (again.model.K == first.model.K).all() and (again.model.M == first.model.M).all()
            for part, u in again.expand(x):
                assert (u == right[part]).all(), (damaged, part)


@pytest.mark.slow
def test_files_that_are_damaged_behind_the_reduction_are_named_by_expand(tmp_path: Path) -> None:
    parts, method = chain_parts(4), fs.CraigBampton(modes=4)
    levels = fs.reduce_by_levels(parts, method, tmp_path)
    x = fs.normal_modes(levels.model, 1).shapes
    right = dict(levels.expand(x))
    names = [name for name in files_in(tmp_path) if "/task/" not in name]
    for name in names:
        content = (tmp_path / name).read_bytes()
        spoilt(tmp_path / name, "zeros")
        with pytest.raises(fs.InputError, match=rf"{name} is damaged.*Call reduce_by_levels again"):
            list(levels.expand(x))
        (tmp_path / name).write_bytes(content)
    for name in names:
        spoilt(tmp_path / name, "zeros")
    with pytest.warns(fs.FemsubWarning, match="is made anew"):
        levels = fs.reduce_by_levels(parts, method, tmp_path)
    assert all((u == right[part]).all() for part, u in levels.expand(x))


def test_what_was_joined_is_made_anew_with_a_part_whose_modes_have_other_signs(tmp_path: Path,
                                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    """As on another processor. Else `expand` would take one sign for the other."""
    parts, method = chain_parts(4), fs.CraigBampton(modes=4)
    first = fs.reduce_by_levels(parts, method, tmp_path)
    right = dict(first.expand(fs.normal_modes(first.model, 1).shapes))

    def turned(part: fs.Substructure, *given: object, **options: bool) -> fs.ReducedSubstructure:
        model = reduced(part, *given, **options)  # type: ignore[arg-type]
        sign = np.where(np.array(model.kinds) == "constraint", 1.0, -1.0)
        M, K, D = (np.asarray(A) * sign * sign[:, None] for A in (model.M, model.K, model.D))
        return replace(model, V=model.V * sign, M=M, K=K, D=D)

    monkeypatch.setattr(levels_module, "reduced", turned)
    (tmp_path / "p2" / "pickle").unlink()
    with pytest.warns(fs.FemsubWarning, match="The part 'p2' is made anew"):
        again = fs.reduce_by_levels(parts, method, tmp_path)
    found = dict(again.expand(fs.normal_modes(again.model, 1).shapes))
    sign = np.sign(np.vdot(found["p1"], right["p1"]))
    assert all(np.allclose(u, sign * right[part], atol=1e-9) for part, u in found.items())


def star_piece(sets: Mapping[str, list[int]]) -> fs.Substructure:
    bare = fs.chain(10, fixed=False, damping=0.0)
    return fs.Substructure(bare.M, bare.K + 0.1 * np.eye(10), interface=dict(sets))


def test_a_joint_that_another_part_shares_now_is_not_taken_as_closed(tmp_path: Path) -> None:
    """A run without the third arm of a star closes its middle. The run with it may not take that pair for its own."""
    arms = {"p1": {"p1+p2+p3": [0], "p1+p4": [9]}, "p2": {"p1+p2+p3": [0]}, "p4": {"p1+p4": [0], "p4+p5": [9]},
            "p5": {"p4+p5": [0]}}
    method = fs.CraigBampton(modes=4)
    parts = {name: partial(star_piece, sets) for name, sets in arms.items()}
    fs.reduce_by_levels(parts, method, tmp_path / "one")
    more = parts | {"p3": partial(star_piece, {"p1+p2+p3": [0]})}
    found, right = (fs.reduce_by_levels(more, method, tmp_path / name).model for name in ("one", "other"))
    assert fs.normal_modes(found, 4).frequencies == pytest.approx(fs.normal_modes(right, 4).frequencies, rel=1e-12)


def test_a_full_disk_is_named_and_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the third array and from then on. With room again the run goes on."""
    saved, save = [], np.save

    def full(path: Path, array: np.ndarray) -> None:
        saved.append(path)
        if len(saved) > 2:
            path.write_bytes(b"half")
            raise OSError("1000 requested and 4 written")
        save(path, array)

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(fs.NotEnoughMemoryError, match=rf"{tmp_path} cannot take the result of 'p1', .* MB \(1000 requested and 4 "
                                                      r"written\); .* free there. Make room there. Call reduce_by_levels again"):
        fs.reduce_by_levels(chain_parts(3), fs.CraigBampton(modes=3), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["alive"]
    monkeypatch.undo()
    assert fs.reduce_by_levels(chain_parts(3), fs.CraigBampton(modes=3), tmp_path).levels == 2


def test_a_piece_whose_file_has_changed_is_not_built(tmp_path: Path) -> None:
    """Its displacements would be those of another mesh."""
    path = fs.write_mesh(tmp_path / "p1.vtu", piece(0, [4, 4], (1, 1)))
    whole = Piece.of(path, fs.solid, ARGUMENTS)
    fs.write_mesh(path, piece(0, [5, 4], (1, 1)))
    with pytest.raises(fs.InputError, match=r"p1.vtu is not the file .*its content has changed"):
        whole()


def test_a_function_that_makes_another_component_is_not_expanded(tmp_path: Path) -> None:
    levels = fs.reduce_by_levels(chain_parts(3), fs.CraigBampton(modes=3), tmp_path)
    recipes = dict(levels.recipes) | {"p2": partial(chain_piece, 3, 3)}
    with pytest.raises(fs.InputError, match="the function of the part 'p2' makes another component now"):
        list(replace(levels, recipes=recipes).expand(np.ones(levels.model.size)))


def test_a_piece_that_was_written_anew_is_made_anew(tmp_path: Path) -> None:
    """Under the same name: the hash of its file tells."""
    path = fs.write_mesh(tmp_path / "p1.vtu", piece(0, [4, 4], (1, 1)))
    before = Piece.of(path, fs.solid, ARGUMENTS)
    fs.write_mesh(path, piece(0, [5, 4], (1, 1)))
    assert Piece.of(path, fs.solid, ARGUMENTS) != before


KILLED = """
import os, signal, sys
from functools import partial
import femsub as fs
from test_levels import chain_parts, chain_piece

class Deadly(partial):
    def __call__(self):
        if not os.path.exists(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__()

if __name__ == "__main__":
    parts = chain_parts(4, sys.argv[2] + "-notes")
    parts["p3"] = Deadly(chain_piece, 3, 4, "")
    print(fs.reduce_by_levels(parts, fs.CraigBampton(modes=3), sys.argv[1]))
"""


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on(tmp_path: Path) -> None:
    """kill -9 at the third of four parts: the second run makes the third and the fourth, not the first two."""
    notes = tmp_path / "mark-notes"
    notes.mkdir()
    (tmp_path / "script.py").write_text(KILLED, encoding="utf-8")
    places = tmp_path / "script.py", tmp_path / "work", tmp_path / "mark"
    command = [sys.executable, *map(str, places)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, Path(__file__).parents[:2]))}
    first = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert first.returncode == -signal.SIGKILL and sorted(path.name[:6] for path in notes.iterdir()) == ["made-1", "made-2"]
    (tmp_path / "mark").touch()
    second = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert second.returncode == 0 and "Levels: 4 parts" in second.stdout, second.stderr
    assert sorted(path.name[:6] for path in notes.iterdir()) == ["made-1", "made-2", "made-4"]


def dies(at: int, folder: str) -> fs.Substructure:
    if at == 2 and not Path(folder, "mark").exists():
        Path(folder, "mark").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return chain_piece(at, 4)


@pytest.mark.slow
def test_a_worker_that_dies_is_named_and_the_others_are_done(tmp_path: Path) -> None:
    parts = {f"p{at}": partial(dies, at, str(tmp_path)) for at in range(1, 5)}
    with pytest.raises(fs.WorkerError, match=r"no result for the part 'p2'.*Call reduce_by_levels again") as told:
        fs.reduce_by_levels(parts, fs.CraigBampton(modes=3), tmp_path / "work", workers=2)
    assert told.value.part == "p2" and set(told.value.done) == {"p1", "p3", "p4"}
    levels = fs.reduce_by_levels(parts, fs.CraigBampton(modes=3), tmp_path / "work", workers=2)
    alone = fs.reduce_by_levels(parts, fs.CraigBampton(modes=3), tmp_path / "alone")
    assert np.allclose(levels.bounds(3).upper, alone.bounds(3).upper, rtol=1e-12)
    assert levels.tasks["p1"].memory > 0 < levels.tasks["p1"].bytes


def test_a_rail_is_written_piece_by_piece(tmp_path: Path) -> None:
    """No piece knows the whole; their nodes, supports and patch are those of the whole."""
    parts = rail(tmp_path, 3e3, 3, (2, 2))
    layers = cells_of(3e3, 3, (2, 2))
    length = sum(layers) * 0.01
    mesh = fs.block((length, 0.02, 0.02), (sum(layers), 2, 2), "hexahedron")
    pieces = [piece(at, layers, (2, 2)) for at in range(3)]
    for one in pieces:
        assert np.allclose(one.points, mesh.points[one.numbers - 1], atol=1e-12)
    held = np.unique(np.concatenate([one.numbers[one.sets["sleepers"]] for one in pieces])) - 1
    full = fs.solid(mesh.with_sets(sleepers=held), STEEL, supports=["sleepers"])
    bounds = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=3e4), tmp_path / "reduced").bounds(4)
    omega = fs.normal_modes(full, 4).frequencies
    assert (bounds.lower <= omega * (1 + 1e-9)).all() and (omega <= bounds.upper * (1 + 1e-9)).all() and bounds.error.max() < 1e-2


def test_what_cannot_be_joined_is_refused(tmp_path: Path) -> None:
    parts, method = chain_parts(3), fs.CraigBampton(modes=3)
    apart = parts | {"p9": partial(chain_piece, 8, 9)}
    cases = [(apart, method, "'p9' shares no interface set with the other parts.*'p7.p8'"),
             (parts | {"a.b": parts["p1"]}, method, "without '.'.*'a.b'"),
             (parts | {"p1": chain_piece(1, 3)}, method, "'p1' must be a function.*not Substructure"),
             (parts | {"p1": partial(fs.chain, 5)}, method, "'p1' has no named interface sets"),
             (parts | {"p1": partial(dict)}, method, "what the function of the part 'p1' returns must be"),
             ({"p1": parts["p1"]}, method, "two or more"), (parts, fs.Hurty(3), "not by Hurty with 3 modes"),
             (parts | {"p1": lambda: None}, method, "pickle refuses it")]
    for given, how, message in cases:
        with pytest.raises((fs.InputError, fs.InputTypeError), match=message):
            fs.reduce_by_levels(given, how, tmp_path / "work")
    with pytest.raises(fs.InputTypeError, match="method must be"):
        fs.reduce_by_levels(parts, fs.CraigChang(3), tmp_path / "work")  # type: ignore[arg-type]
    (tmp_path / "file").touch()
    with pytest.raises(fs.InputError, match="cannot be made"):
        fs.reduce_by_levels(parts, method, tmp_path / "file" / "work")


def test_one_run_at_a_time_in_a_folder(tmp_path: Path) -> None:
    from femsub.algebra import only_one

    with only_one(tmp_path), pytest.raises(fs.InputError, match="another run works in"):
        fs.reduce_by_levels(chain_parts(3), fs.CraigBampton(modes=3), tmp_path)


def test_pieces_refuse_what_the_mesh_lacks(tmp_path: Path) -> None:
    mesh = bar()
    for arguments, message in (({"supports": ["lft"]}, "supports: the mesh 'block' has no set 'lft'; it has 'left'"),
                               ({"ports": {"belt": ("none", "x")}}, "port 'belt': the mesh"), ({"into": 1000}, "into")):
        with pytest.raises(fs.InputError, match=message):
            fs.cut_to_files(tmp_path, mesh, fs.solid, **({"into": 2, "material": STEEL} | arguments))
    with pytest.raises(fs.InputTypeError, match="build must be the function"):
        fs.cut_to_files(tmp_path, mesh, STEEL, into=2)  # type: ignore[arg-type]


def test_a_port_is_in_one_piece_and_an_open_set_may_lie_across_pieces(tmp_path: Path) -> None:
    """The set of the port ends where the next piece begins, which has some of its nodes, but not the port."""
    mesh = fs.block((2.0, 0.1, 0.1), (8, 1, 1), "hexahedron").with_sets(
        patch=lambda x: (x[:, 0] >= 0.74) & (x[:, 0] <= 1.01) & (x[:, 2] > 0.09), top=lambda x: x[:, 2] > 0.09)
    arguments = {"material": STEEL, "supports": ["left"], "interface": ["top"], "ports": {"belt": ("patch", "x")}}
    parts = fs.cut_to_files(tmp_path, mesh, fs.solid, into=4, **arguments)
    with_port = [name for name, one in parts.items() if one().ports]
    assert len(with_port) == 1
    levels, full = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=1e5), tmp_path / "reduced"), fs.solid(mesh, **arguments)
    assert list(levels.model.ports) == [f"{with_port[0]}.belt"]
    assert len(levels.model.interface) == len(full.interface) and set(levels.model.sets) == {f"p{at}.top" for at in range(1, 5)}
    static = [float(w @ np.linalg.solve(K, w)) for K, w in (
        (full.K.toarray(), full.ports["belt"]), (np.asarray(levels.model.K), levels.model.ports[f"{with_port[0]}.belt"]))]
    assert static[1] == pytest.approx(static[0], rel=1e-8)
