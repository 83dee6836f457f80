"""Universal files: meshes with each kind of element, groups, trace lines; modes; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.io.universal import read_universal

#: corner, or middle between two corners, of each node in the order of universal files: around the bottom, up, around the top
ORDERS = {"tetra10": (118, "0 01 1 12 2 02 03 13 23 3"), "tetra": (111, "0 1 2 3"), "hexahedron": (115, "0 1 2 3 4 5 6 7"),
          "hexahedron20": (116, "0 01 1 12 2 23 3 03 04 15 26 37 4 45 5 56 6 67 7 47"),
          "wedge": (112, "0 1 2 3 4 5"), "wedge15": (113, "0 01 1 12 2 02 03 14 25 3 34 4 45 5 35")}
CORNERS = {"tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
           "wedge": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
           "hexahedron": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]}
#: the edges whose middles follow the corners in VTK's order, which is that of meshio
EDGES = {"tetra": "01 12 02 03 13 23", "wedge": "01 12 02 34 45 35 03 14 25", "hexahedron": "01 12 23 03 45 56 67 47 04 15 26 37"}
SYSTEM = """    -1
  2420
         1
Mesh
         7         0         0
CS
    1.0000000000000000E+0    0.0000000000000000E+0    0.0000000000000000E+0
    0.0000000000000000E+0    1.0000000000000000E+0    0.0000000000000000E+0
    0.0000000000000000E+0    0.0000000000000000E+0    1.0000000000000000E+0
    0.0000000000000000E+0    0.0000000000000000E+0    0.0000000000000000E+0
    -1
"""


def numbers(*values: int) -> str:
    return "".join(f"{value:10d}" for value in values) + "\n"


def universal(kind: str) -> tuple[str, np.ndarray]:
    """One element, whose nodes count from 11 in its order, with a group of it and its first node; and the nodes' places."""
    type_, order = ORDERS[kind]
    corners = np.array(CORNERS[kind.rstrip("0123456789")], dtype=float)
    places = np.array([corners[[int(digit) for digit in word]].mean(axis=0) for word in order.split()])
    nodes = "".join(numbers(11 + at, 7, 1, 11) + "".join(f"{value:25.16E}" for value in place).replace("E", "D") + "\n"
                    for at, place in enumerate(places))
    names = [11 + at for at in range(len(places))]
    lines = [numbers(*names[start:start + 8]) for start in range(0, len(names), 8)]
    element = numbers(5, type_, 1, 1, 7, len(names)) + "".join(lines)
    group = numbers(1, 0, 0, 0, 0, 0, 0, 2) + "rim\n" + numbers(7, 11, 0, 0, 8, 5, 0, 0)
    bodies = {2411: nodes, 2412: element, 2467: group, 2400: "  1\n"}
    return SYSTEM + "".join(f"    -1\n{number:6d}\n{body}    -1\n" for number, body in bodies.items()), places


@pytest.mark.parametrize("kind", list(ORDERS))
def test_each_kind_of_element(tmp_path: Path, kind: str) -> None:
    text, places = universal(kind)
    (tmp_path / "part.unv").write_text(text)
    found, notes = read_universal(tmp_path / "part.unv")
    shape = kind.rstrip("0123456789")
    corners = np.array(CORNERS[shape], dtype=float)
    middles = [corners[[int(digit) for digit in edge]].mean(axis=0) for edge in EDGES[shape].split()]
    expected = corners if kind == shape else np.vstack([corners, middles])
    assert found.cells[0].type == kind and np.array_equal(found.points[found.cells[0].data[0]], expected)
    assert found.points_id.tolist() == list(range(11, 11 + len(places))) and notes == ["data set 2400 skipped"]
    if shape == "wedge":
        return  # femsub has no such element
    mesh = fs.read_mesh(tmp_path / "part.unv")
    assert mesh.sets["rim"].tolist() == [0] and mesh.groups["rim"].tolist() == [0]
    moved = np.tile([1.0, 0.0, 0.0], len(places))
    volume = 1 / 6 if shape == "tetra" else 1.0
    assert float(moved @ (fs.solid(mesh, fs.Material(1.0, 0.3, 1.0)).M @ moved)) == pytest.approx(volume)


def test_the_content_tells_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "export.txt").write_text(universal("tetra")[0].rstrip("\n"))  # a last line -1 is whole
    assert fs.read_mesh(tmp_path / "export.txt").kind == "tetra"


@pytest.mark.parametrize(("old", "new", "message"), [
    ("        12         7", "        11         7", "node 11 twice"),
    ("        12         7", "        x2         7", "whole number"),
    ("1.0000000000000000D+00", "1.0000000x00000000D+00", "not all numbers"),
    ("         5       111", "         5       115", "has not 8"),
    ("         4\n        11        12", "         5\n        11        12", "announces 5 nodes"),
    ("rim\n", "\n", "head of a group"),
    ("        11        12        13        14\n", "        11        12        13        15\n", "node 15"),
    ("  2467\n", "  58b\n", "does not end where it says"), ("  2467\n", "  x\n", "number of a data set"),
    ("  1\n    -1\n", "", "without its end"),
    ("         2\nrim", "         3\nrim", "announces 3 members"), ("  2411\n", "  2499\n", "0 nodes")])
def test_faults_are_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    text, _ = universal("tetra")
    assert old in text
    (tmp_path / "part.unv").write_text(text.replace(old, new, 1))
    with pytest.raises(fs.InputError, match=message):
        fs.read_mesh(tmp_path / "part.unv")


def reals(*values: float) -> str:
    return "".join(f"{value:13.5E}" for value in values) + "\n"


#: a test model: program and units, four nodes of the old data set, a trace line with the pen up before the last two nodes
BENCH = ("    -1\n   151\nfile\nabout\nMaker\nx\nx\nBench 3\nx\n    -1\n"
         "    -1\n   164\n         5mm (milli-newton)\n  1.0\n    -1\n"
         "    -1\n    15\n" + "".join(numbers(node, 0, 1, 8)[:-1] + reals(node, 0.0, 0.5) for node in (3, 4, 7, 9)) + "    -1\n"
         "    -1\n    82\n" + numbers(1, 5, 8) + "Rim\n" + numbers(3, 4, 0, 7, 9, 0, 0, 0) + "    -1\n")


def old_mode(hertz: float, damping: float, shape: np.ndarray, loss: float = 0.0) -> str:
    """Data set 55 of a normal mode."""
    body = "".join(numbers(node) + reals(*row) for node, row in zip((3, 4, 7, 9), shape, strict=True))
    head = numbers(1, 2, 2, 8, 2, 3) + numbers(2, 4, 0, 1) + reals(hertz, 1, damping, loss)
    return "    -1\n    55\n" + "NONE\n" * 5 + head + body + "    -1\n"


def new_mode(value: complex, shape: np.ndarray) -> str:
    """Data set 2414 of a complex mode with rotations, whose twelve numbers for each node stand on two lines."""
    body = "".join(numbers(node) + reals(*row[:3].view(float)) + reals(*row[3:].view(float))
                   for node, row in zip((3, 4, 7, 9), shape, strict=True))
    return "    -1\n  2414\n" + numbers(1) + "mode\n" + numbers(1) + "NONE\n" * 5 + numbers(1, 7, 3, 8, 5, 6) + \
        numbers(*[0] * 8) + numbers(0, 0) + reals(*[0] * 6) + reals(value.real, value.imag, *[0] * 4) + body + "    -1\n"


SHAPES = np.random.default_rng(2).standard_normal((2, 4, 3))


def test_a_test_model_is_a_mesh_of_lines(tmp_path: Path) -> None:
    (tmp_path / "bench.uff").write_text(BENCH)
    mesh = fs.read_mesh(tmp_path / "bench.uff")
    assert mesh.kind == "line" and mesh.numbers[mesh.cells].tolist() == [[3, 4], [7, 9]]
    assert mesh.groups["Rim"].tolist() == [0, 1] and np.array_equal(mesh.points[1], [4.0, 0.0, 0.5])
    assert mesh.repairs[:2] == ("written by Bench 3", "its units: mm (milli-newton); nothing is converted")


def test_places_are_in_the_global_frame(tmp_path: Path) -> None:
    """A node of data set 15 names the frame of its place; one of 2411 names a frame for export, its place is in the part's."""
    system = "    -1\n    18\n" + numbers(7, 0, 0, 8, 1) + "CS\n" + reals(0, 0, 0, 0, 1, 0) + reals(0, 0, 1) + "    -1\n"
    (tmp_path / "old.uff").write_text(system + BENCH.replace(numbers(4, 0, 1, 8).rstrip(), numbers(4, 7, 1, 8).rstrip()))
    with pytest.raises(fs.InputError, match="coordinate system 7, which is turned"):
        fs.read_mesh(tmp_path / "old.uff")
    text = universal("tetra")[0]
    (tmp_path / "new.unv").write_text(system + text)
    assert fs.read_mesh(tmp_path / "new.unv").kind == "tetra" and SYSTEM in text


def test_modes_of_a_bench(tmp_path: Path) -> None:
    (tmp_path / "bench.uff").write_text(BENCH + old_mode(12.0, 0.0, SHAPES[1], 0.06) + old_mode(10.0, 0.01, SHAPES[0], 0.02))
    found = fs.read_modes(tmp_path / "bench.uff")
    assert found.frequencies == pytest.approx(2 * np.pi * np.array([10.0, 12.0])) and found.damping == pytest.approx([0.01, 0.03])
    assert found.shapes == pytest.approx(SHAPES.reshape(2, 12).T, rel=1e-5) and found.shapes.dtype == float
    assert found.dofs.name(5) == "uz at node 4" and found.dofs.points is not None and found.dofs.points[5].tolist() == [4, 0, 0.5]
    assert found.notes == ("written by Bench 3", "its units: mm (milli-newton); nothing is converted")


def test_complex_modes_with_rotations(tmp_path: Path) -> None:
    shape = np.concatenate([SHAPES[0] + 1j * SHAPES[1], SHAPES[1] + 2j * SHAPES[0]], axis=1)
    shape[:, 4] = 0  # not measured
    (tmp_path / "bench.uff").write_text(new_mode(-0.5 - 40j, shape) + new_mode(-0.25 + 30j, shape.conj()))
    found = fs.read_modes(tmp_path / "bench.uff")
    assert found.eigenvalues == pytest.approx([-0.25 + 30j, -0.5 + 40j], rel=1e-5) and found.dofs.points is None
    assert found.dofs.size == 20 and found.dofs.labels[found.dofs.components[4]] == "rz"
    assert found.shapes[:, 1] == pytest.approx(shape[:, [0, 1, 2, 3, 5]].ravel(), rel=1e-5)


@pytest.mark.parametrize(("old", "new", "message"), [
    (numbers(7), numbers(4), "a node twice"), (numbers(7), "         x\n", "whole number"), ("E+00", "x+00", "not all numbers"),
    (numbers(1, 2, 2, 8, 2, 3), numbers(1, 2, 2, 8, 2, 6), "6 values for each node"),
    (numbers(1, 2, 2, 8, 2, 3), numbers(1, 1, 2, 8, 2, 3), "holds no modes"), (numbers(7), "", "lines, but 2 for each"),
    (reals(10.0, 1, 0.01, 0), reals(10.0, 1, 1.5, 0), "damping ratio 1.5"), (reals(10.0, 1, 0.01, 0), "\n", "real parameters"),
    (reals(10.0, 1, 0.01, 0), "   nan   1.0   0.0   0.0\n", "nan Hz"), ("NONE\n" * 3, "", "should be six numbers")])
def test_faults_of_modes_are_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = BENCH + old_mode(10.0, 0.01, SHAPES[0])
    start = text.index("    55\n")
    assert old in text[start:]
    (tmp_path / "bench.uff").write_text(text[:start] + text[start:].replace(old, new, 1))
    with pytest.raises(fs.InputError, match=message):
        fs.read_modes(tmp_path / "bench.uff")


def test_a_mode_that_lacks_a_node(tmp_path: Path) -> None:
    """Nodes without motion need not be listed in data set 55, but a mode of 2414 says nothing about nodes that are missing."""
    whole = old_mode(10.0, 0.0, SHAPES[0])
    less = whole.replace(numbers(9) + reals(*SHAPES[0, 3]), "")
    (tmp_path / "old.uff").write_text(whole + less)
    assert not fs.read_modes(tmp_path / "old.uff").shapes[9:, 1].any()
    shape = np.tile(SHAPES[0] + 0j, 2)
    other = new_mode(40j, shape)
    cut = other.replace(numbers(9) + other.split(numbers(9))[1].split("    -1")[0], "")
    (tmp_path / "new.uff").write_text(other + cut)
    with pytest.raises(fs.InputError, match="does not say how node 9 moves"):
        fs.read_modes(tmp_path / "new.uff")


@pytest.mark.parametrize("binary", [False, True])
def test_real_files_say_what_pyuff_says(tmp_path: Path, binary: bool) -> None:
    """Functions as pyuff writes them, in text or binary, whose length it writes too small for complex values."""
    pyuff = pytest.importorskip("pyuff")
    h, x = np.random.default_rng(1).standard_normal((2, 9)).T.copy().view(complex).ravel(), np.arange(1.0, 10.0)
    head = {"type": 58, "func_type": 4, "rsp_node": 2, "rsp_dir": 3, "ref_node": 5, "ref_dir": 1, "abscissa_spacing": 1,
            "abscissa_min": 1.0, "abscissa_inc": 1.0, "ord_data_type": 6, "abscissa_spec_data_type": 18,
            "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 13, "x": x, "data": h, "num_pts": 9, "rsp_ent_name": "NONE",
            "ref_ent_name": "NONE", "ver_num": 1, "load_case_id": 0, "z_axis_value": 0.0, **{f"id{k}": "x" for k in range(1, 6)}}
    pyuff.UFF(str(tmp_path / "a.uff")).write_sets([head | {"binary": 0}, head | {"binary": int(binary)}], "overwrite")
    found = fs.read_response(tmp_path / "a.uff")
    assert found.repeated == 2 and found.receptance[:, 0, 0] == pytest.approx(h, rel=1e-10)


HERTZ = np.array([5.0, 15.0, 25.0, 35.0, 45.0])
RECEPTANCE = 1 / (2e3 * (1 - (HERTZ / 64) ** 2 + 0.05j))


def functions(types: tuple[int, int], values: np.ndarray, fill: str = "", end: str = "\n") -> str:
    """Data set 58 of one response in text, single precision, evenly spaced, whose last line goes on with `fill`."""
    flat = [f"{value:13.5E}" for value in np.column_stack([values.real, values.imag]).ravel()]
    lines = ["".join(flat[start:start + 6]) for start in range(0, len(flat), 6)]
    head = ["    -1", "    58", *["NONE"] * 5, f"    4{1:10d}{1:5d}{0:10d} {'NONE':10s}{3:10d}{3:4d} {'NONE':10s}{7:10d}{3:4d}",
            numbers(5, len(values), 1).rstrip() + reals(HERTZ[0], 10.0, 0.0).rstrip(),
            *(f"{kind:10d}    0    0    0 NONE                 NONE" for kind in (18, *types, 0))]
    return end.join([*head, *lines[:-1], lines[-1] + fill, "    -1", ""])


@pytest.mark.parametrize(("fill", "message"), [
    (f"{0.0:13.5E}" * 2, None), (" " * 26, None), (f"{0.0:13.5E}{1e-9:13.5E}", "announces 5 values, but has 6"),
    (f"{0.0:13.5E}" * 3, "has 6.5"), (f"\n{0.0:13.5E}{0.0:13.5E}", "has 6"), (f"{0.0:13.5E}{np.nan:13.5E}", "has 6")])
def test_zeros_fill_the_last_line(tmp_path: Path, fill: str, message: str | None) -> None:
    (tmp_path / "a.uff").write_text(functions((8, 13), RECEPTANCE, fill))
    if message is None:
        assert fs.read_response(tmp_path / "a.uff").receptance[:, 0, 0] == pytest.approx(RECEPTANCE, rel=1e-5)
        return
    with pytest.raises(fs.InputError, match=message):
        fs.read_response(tmp_path / "a.uff")


@pytest.mark.parametrize(("types", "stated", "message"), [
    ((8, 9), {}, None), ((12, 0), {"over": "force"}, None), ((1, 13), {"quantity": "acceleration"}, None),
    ((0, 1), {"quantity": "velocity", "over": "force"}, None), ((11, 13), {"quantity": "velocity", "over": "force"}, None),
    ((12, 0), {}, r"types 12 over 0 \(unknown\), .* state it by over='force'$"),
    ((1, 13), {"over": "force"}, r"types 1 \(general\) over 13, .* state it by quantity='displacement', 'velocity' or"),
    ((12, 13), {"quantity": "velocity"}, "which are not those of velocity over the load, as stated"),
    ((3, 0), {}, r"needed$"), ((12, 8), {"over": "force"}, "as stated"), ((1, 3), {"quantity": "force"}, "quantity")])
def test_what_a_file_leaves_open_is_stated(tmp_path: Path, types: tuple[int, int], stated: dict[str, str],
                                           message: str | None) -> None:
    order = {8: 0, 11: 1, 12: 2, "velocity": 1, "acceleration": 2}.get(stated.get("quantity", types[0]), 0)
    (tmp_path / "a.uff").write_text(functions(types, (2j * np.pi * HERTZ) ** order * RECEPTANCE))
    if message is None:
        assert fs.read_response(tmp_path / "a.uff", **stated).receptance[:, 0, 0] == pytest.approx(RECEPTANCE, rel=1e-5)
        return
    with pytest.raises(fs.InputError, match=message):
        fs.read_response(tmp_path / "a.uff", **stated)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_no_byte_of_binary_values_is_lost_unseen(tmp_path: Path, end: bytes) -> None:
    """Blanks and line ends follow the values; they are no values where bytes are missing."""
    raw = np.column_stack([RECEPTANCE.real, RECEPTANCE.imag]).astype("<f4").tobytes()
    text = functions((8, 13), RECEPTANCE[:5], end=end.decode()).encode()
    start = [at for at in range(len(text)) if text.startswith(end, at)][12] + len(end)
    head = text[:start].replace(b"    58", f"    58b     1     2          11{len(raw):12d}".encode())
    for values, behind in ((raw, end), (raw, b""), (raw, end + end)):
        (tmp_path / "a.uff").write_bytes(head + values + behind + b"    -1" + end)
        assert fs.read_response(tmp_path / "a.uff").receptance[:, 0, 0] == pytest.approx(RECEPTANCE, rel=1e-6)
    for count in (1, 2, 4, 6):
        for values in (raw[:-count], raw + b"x" * count):
            (tmp_path / "a.uff").write_bytes(head + values + end + b"    -1" + end)
            with pytest.raises(fs.InputError, match="does not end where it says"):
                fs.read_response(tmp_path / "a.uff")


def test_lines_of_nodes_and_members_may_be_filled(tmp_path: Path) -> None:
    """As the trace lines of a test model may be; other numbers than 0 are still too many."""
    text, _ = universal("tetra")
    mode = old_mode(10.0, 0.0, SHAPES[0])
    for row in SHAPES[0]:
        mode = mode.replace(reals(*row), reals(*row, 0, 0, 0))
    (tmp_path / "mode.uff").write_text(BENCH + mode)
    assert fs.read_modes(tmp_path / "mode.uff").shapes[:, 0] == pytest.approx(SHAPES[0].ravel(), rel=1e-5)
    line = numbers(11, 12, 13, 14)
    for more in (0, 3):
        (tmp_path / "part.unv").write_text(text.replace(line, line.rstrip() + numbers(0, 0, 0, more)))
        if not more:
            assert fs.read_mesh(tmp_path / "part.unv").kind == "tetra"
            continue
        with pytest.raises(fs.InputError, match="announces 4 nodes, but has 8"):
            fs.read_mesh(tmp_path / "part.unv")


def test_modes_are_paired_by_their_shapes() -> None:
    """At some DOF, by numbers or by places; a double mode by its plane; rows in another order and scale."""
    part = fs.solid(fs.block((1.0, 0.1, 0.1), (6, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
    supported = fs.Substructure(part.M[12:, 12:], part.K[12:, 12:], dofs=part.dofs.kept(np.arange(12, part.size)))
    own = fs.normal_modes(supported, count=8)
    rng, rows = np.random.default_rng(0), np.random.default_rng(0).permutation(supported.size)[:30]
    turned = own.shapes.copy()
    turned[:, :2] = own.shapes[:, :2] @ [[0.6, -0.8], [0.8, 0.6]]  # two modes of one frequency are two of any in their plane
    order = rng.permutation(8)
    dofs = supported.dofs.kept(rows)
    known = fs.ModeSet(1j * own.frequencies[order], (turned * rng.uniform(1, 9, 8))[rows][:, order], dofs)
    pairs = known.compare(supported, own)
    assert own.frequencies[1] == pytest.approx(own.frequencies[0], rel=1e-9)
    assert pairs.mac == pytest.approx(np.ones(8)) and pairs.dofs == 30 and np.abs(pairs.change).max() < 1e-12
    assert sorted(pairs.found) == list(range(8)) and (order[pairs.known] == pairs.found)[pairs.found > 1].all()
    other = fs.DofMap(dofs.nodes + 1000, dofs.components, dofs.labels, dofs.points + 1e-3)
    moved = fs.ModeSet(known.eigenvalues, known.shapes, other)
    assert moved.compare(supported, own, tol=0.01).mac == pytest.approx(np.ones(8))
    for tol in (None, 1e-4):
        with pytest.raises(fs.InputError, match="no DOF in common"):
            moved.compare(supported, own, tol=tol)
    rom = fs.reduce(part, fs.CraigBampton(12))
    free = fs.ModeSet(1j * (own := fs.normal_modes(part, count=6)).frequencies, own.shapes, part.dofs)
    found = free.compare(rom, fs.normal_modes(rom, count=6))
    assert found.mac[6:].min() > 0.99 and repr(found).startswith("ModePairs: 12 of 12 modes at 84 DOF, smallest MAC ")
    with pytest.raises(fs.InputError, match="of another model"):
        free.compare(supported, own)


def test_a_decimal_comma_is_refused(tmp_path: Path) -> None:
    """Read as two numbers, it halved a damping ratio."""
    mode = old_mode(10.0, 0.02, SHAPES[0])
    numbers = reals(10.0, 1, 0.02, 0)
    assert numbers in mode
    (tmp_path / "bench.uff").write_text(BENCH + mode.replace(numbers, numbers.replace("1.00000E+00", "1,00000E+00")))
    with pytest.raises(fs.InputError, match=r"hold a comma.*write 0\.5, not 0,5"):
        fs.read_modes(tmp_path / "bench.uff")


@pytest.mark.parametrize("line", range(12))
def test_no_line_of_a_head_is_lost_unseen(line: int, tmp_path: Path) -> None:
    """A function whose head had lost a line above its type counted as one of another type, and was left out."""
    ends = f"    4{1:10d}{0:5d}{0:10d} {'NONE':10s}{{:10d}}{3:4d} {'NONE':10s}{5:10d}{1:4d}\n"
    ids = "".join(f"{number}  ID line\n" for number in range(1, 6))
    sets = ["    -1\n    58\n" + ids + ends.format(node) + numbers(5, 2, 1).rstrip() + reals(1.0, 0.5, 0.0) + "".join(
        f"{kind:10d}    0    0    0 NONE                 NONE                \n" for kind in (18, 12, 13, 0)) +
        reals(1.0, 2.0, 3.0, 4.0) + "    -1\n" for node in (2, 3)]
    path = tmp_path / "two.uff"
    path.write_text("".join(sets))
    assert fs.read_response(path).responses == ("2:uz", "3:uz")
    lines = sets[1].splitlines(keepends=True)
    path.write_text(sets[0] + "".join(lines[:line] + lines[line + 1:]))
    with pytest.raises(fs.InputError, match=r"two\.uff"):
        fs.read_response(path)


def test_text_outside_of_the_data_sets_is_refused(tmp_path: Path) -> None:
    """A first line that was damaged left out the data set that it begins."""
    mode = old_mode(10.0, 0.02, SHAPES[0])
    for text in (f"\0\0{BENCH}{mode}", f"{BENCH}x\n{mode}"):
        (tmp_path / "bench.uff").write_text(text)
        with pytest.raises(fs.InputError, match=r"bench\.uff.*in no data set|without its end|is not the number"):
            fs.read_modes(tmp_path / "bench.uff")


def test_no_more_parameters_than_a_mode_has(tmp_path: Path) -> None:
    """A number in two pieces moved those behind it: λ = -1 + 40i was read as i."""
    six = np.concatenate([SHAPES[0] + 1j * SHAPES[1], SHAPES[1] - 1j * SHAPES[0]], axis=1)
    for text, old, new in ((new_mode(-1 + 40j, six), "4.00000E+01", "4.0  000E+01"),
                           (old_mode(10.0, 0.02, SHAPES[0]), "2.00000E-02", "2.0  000E-02")):
        assert old in text
        (tmp_path / "bench.uff").write_text(BENCH + text.replace(old, new, 1))
        with pytest.raises(fs.InputError, match=r"real parameters, where .* belong"):
            fs.read_modes(tmp_path / "bench.uff")


def test_parameters_that_are_not_announced_are_read(tmp_path: Path) -> None:
    """Some programs announce one parameter and write all of them, and more."""
    text = old_mode(10.0, 0.02, SHAPES[0])
    head, values = numbers(2, 4, 0, 1), reals(10.0, 1, 0.02, 0.0)
    assert head + values in text
    more = numbers(2, 1, 0, 1) + reals(10.0, 1, 0.02, 0, 0)
    (tmp_path / "bench.uff").write_text(BENCH + text.replace(head + values, more))
    assert np.allclose(np.abs(fs.read_modes(tmp_path / "bench.uff").eigenvalues), 20 * np.pi)


@pytest.mark.parametrize(("kind", "fine"), [(18, True), (0, True), (1, True), (17, False), (19, False), (20, False)])
def test_responses_are_over_frequency(tmp_path: Path, kind: int, fine: bool) -> None:
    """Responses over time, rpm or order were read as if in Hz."""
    text = functions((8, 13), RECEPTANCE).replace(f"{18:10d}    0", f"{kind:10d}    0", 1)
    (tmp_path / "a.uff").write_text(text)
    if fine:
        assert fs.read_response(tmp_path / "a.uff").receptance[:, 0, 0] == pytest.approx(RECEPTANCE, rel=1e-5)
        return
    with pytest.raises(fs.InputError, match=rf"listed over the data type {kind}, but frequency \(18\) in Hz is needed"):
        fs.read_response(tmp_path / "a.uff")
