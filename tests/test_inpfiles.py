"""Abaqus and CalculiX decks: whatever way a mesh is put down, it is read whole, or refused by the keyword's name."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

import numpy as np
import pytest
from test_meshes import volume

import femsub as fs

pytest.importorskip("meshio")

NODES = {1 + i + 10 * j + 100 * k: (i, j, k) for k in range(2) for j in range(4) for i in range(4)}
CORNERS = (0, 1, 11, 10, 100, 101, 111, 110)
CELLS = {1 + i + 10 * j: [1 + i + 10 * j + step for step in CORNERS] for j in range(3) for i in range(3)}
NODE_LINES = [f"{number}, {x}., {y}., {z}." for number, (x, y, z) in NODES.items()]
CELL_LINES = [f"{number}, {', '.join(map(str, nodes))}" for number, nodes in CELLS.items()]
PLAIN = ["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8, ELSET=all", *CELL_LINES]


def deck(folder: Path, lines: list[str], **files: list[str]) -> fs.Mesh:
    for name, others in files.items():
        (folder / f"{name}.inp").write_text("\n".join(others) + "\n")
    path = folder / "deck.inp"
    path.write_text("\n".join(lines) + "\n")
    return fs.read_mesh(path)


def assert_nine(mesh: fs.Mesh) -> None:
    """Nine unit bricks with the numbers of NODES; the order of the cells does not matter."""
    assert volume(mesh) == pytest.approx(9.0) and mesh.repairs == ()
    assert {int(number): tuple(np.round(point, 9)) for number, point in zip(mesh.numbers, mesh.points, strict=True)} == NODES
    assert sorted(map(tuple, mesh.numbers[mesh.cells].tolist())) == sorted(map(tuple, CELLS.values()))


LOW = ["*NODE", *NODE_LINES[:16], "*NSET, NSET=low, GENERATE", "1,4", "11,14", "21,24", "31,34"]
TURNED = [f"{e}, " + ", ".join(str(n if n < 100 else (n - 100) // 10 * 10 + 505 - n % 10) for n in c) for e, c in CELLS.items()]
WAYS = {
    "plain": (PLAIN, {}),
    "lines before the first keyword of an included file": (["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", CELL_LINES[0],
                                                           "*INCLUDE, INPUT=rest.inp"], {"rest": CELL_LINES[1:]}),
    "lines behind an included file": (["*NODE", "*Include, Input = rest.inp", *NODE_LINES[5:], *PLAIN[33:]],
                                      {"rest": NODE_LINES[:5]}),
    "INPUT= of nodes and elements": (["*NODE, INPUT=n.inp", "*ELEMENT, TYPE=C3D8, INPUT=e.inp"],
                                     {"n": ["** nodes", *NODE_LINES], "e": CELL_LINES}),
    "ELGEN": (["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", CELL_LINES[0], "*ELGEN, ELSET=all", "1, 3, 1, 1, 3, 10, 10"], {}),
    "ELGEN of a row, ELCOPY of the others": (
        ["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", CELL_LINES[0], "*ELGEN, ELSET=row", "1, 3",
         "*ELCOPY, OLD SET=row, ELEMENT SHIFT=10, SHIFT NODES=10, NEW SET=second",
         "*ELCOPY, OLD SET=second, ELEMENT SHIFT=10, SHIFT NODES=10"], {}),
    "NGEN along x": (["*NODE", *(line for number, line in zip(NODES, NODE_LINES, strict=True) if number % 10 in (1, 4)),
                      "*NGEN, NSET=made", *(f"{n}, {n + 3}" for n in NODES if n % 10 == 1), *PLAIN[33:]], {}),
    "NFILL along x": (["*NODE", *(line for number, line in zip(NODES, NODE_LINES, strict=True) if number % 10 in (1, 4)),
                       "*NSET, NSET=a, GENERATE", "1, 31, 10", "101, 131, 10", "*NSET, NSET=b, GENERATE", "4,34,10", "104,134,10",
                       "*NFILL, NSET=made", "a, b, 3, 1", *PLAIN[33:]], {}),
    "NCOPY SHIFT": ([*LOW,
                     "*NCOPY, OLD SET=low, CHANGE NUMBER=100, SHIFT, NEW SET=high", "0., 0., 1.", "", *PLAIN[33:]], {}),
    "NCOPY turned by 180°": (
        [*LOW, "*NCOPY, OLD SET=low, CHANGE NUMBER=500, SHIFT", "0., 0., -1.", "1.5,0.,0., 1.5,1.,0., 180.",
         "*ELEMENT, TYPE=C3D8", *TURNED], {}),
    "NCOPY REFLECT": ([*LOW, "*NCOPY, OLD SET=low, CHANGE NUMBER=100, REFLECT=MIRROR", "0.,0.,.5, 1.,0.,.5", "0.,1.,.5",
                       *PLAIN[33:]], {}),
    "NMAP": (["*NODE, NSET=n", *(f"{n}, {y - 5}., {9 - x}., {z}." for n, (x, y, z) in NODES.items()),
              "*NMAP, NSET=n, TYPE=RECTANGULAR", "9.,5.,0., 9.,6.,0.", "8.,5.,0.", "1.,1.,1.", *PLAIN[33:]], {}),
    "coordinates left out at the end of a line": (
        ["*NODE", *(re.sub(r"(, 0\.)+$", "", line) for line in NODE_LINES), *PLAIN[33:]], {}),
    "a comma at the end of a keyword's line": (
        ["*NODE, NSET=n,", *NODE_LINES, "*ELEMENT, TYPE=C3D8,", " ELSET=all,", *CELL_LINES], {}),
    "an instance with nodes of its own": (["*Part, name=P", "*End Part", "*Assembly, name=A", "*Instance, name=P-1, part=P",
                                           *PLAIN, "*End Instance", "*End Assembly"], {}),
    "blank fields": (["*NODE", *(line.replace(" 0.", " ") for line in NODE_LINES), *PLAIN[33:]], {}),
    "normals behind the coordinates": (["*NODE", *(f"{line}, 0., 0., 1." for line in NODE_LINES), *PLAIN[33:]], {}),
    "empty lines, commas at the end": (["*NODE", "", *(f"{line} ," for line in NODE_LINES), " ", PLAIN[33],
                                        *(f"{line}," for line in CELL_LINES)], {}),
}


@pytest.mark.parametrize("way", WAYS)
def test_nine_cells_in_many_ways(way: str, tmp_path: Path) -> None:
    lines, files = WAYS[way]
    mesh = deck(tmp_path, lines, **files)
    if way == "NCOPY turned by 180°":  # node 501 lies where 104 does
        assert volume(mesh) == pytest.approx(9.0) and len(mesh.points) == 32 and mesh.repairs == ()
    else:
        assert_nine(mesh)
    if way.startswith("ELGEN, "):
        assert len(mesh.groups["all"]) == 9


def test_sets_of_what_is_made(tmp_path: Path) -> None:
    mesh = deck(tmp_path, WAYS["NFILL along x"][0])
    assert sorted(mesh.numbers[mesh.nodes("made")]) == sorted(NODES)
    mesh = deck(tmp_path, WAYS["NGEN along x"][0] + ["*ELSET, ELSET=few", "1, 23", "*NSET, NSET=of, ELSET=few"])
    assert sorted(mesh.numbers[mesh.nodes("made")]) == sorted(NODES) and len(mesh.groups["few"]) == 2
    assert sorted(mesh.numbers[mesh.nodes("of")]) == sorted({*CELLS[1], *CELLS[23]})
    mesh = deck(tmp_path, WAYS["NCOPY SHIFT"][0])
    assert sorted(mesh.numbers[mesh.nodes("high")]) == [n for n in NODES if n > 100]


def test_nodes_on_an_arc_and_in_cylindrical_coordinates(tmp_path: Path) -> None:
    """A quarter of a ring: once its nodes lie on arcs between those at 0° and 90°, once they are mapped from r, θ, z."""
    number = {(r, a, z): 1 + a + 100 * r + 1000 * z for r in range(2) for a in range(7) for z in range(2)}
    cells = ["*ELEMENT, TYPE=C3D8", "1, 1, 101, 102, 2, 1001, 1101, 1102, 1002", "*ELGEN", "1, 6"]
    ends = [f"{n}, {0 if a else r + 2}, {r + 2 if a else 0}, {z}" for (r, a, z), n in number.items() if a in (0, 6)]
    arcs = [f"{number[r, 0, z]}, {number[r, 6, z]}, 1, , 0., 0., {z}." for r in range(2) for z in range(2)]
    ring = deck(tmp_path, ["*NODE", *ends, "*NGEN, LINE=C", *arcs, *cells])
    polar = [f"{n}, {r + 2.}, {15. * a}, {z}." for (r, a, z), n in number.items()]
    same = deck(tmp_path, ["*NODE, NSET=n", *polar, "*NMAP, NSET=n, TYPE=CYLINDRICAL", "0,0,0, 0,0,1", "1,0,0", *cells])
    assert np.allclose(ring.points, same.points, rtol=0, atol=1e-12) and np.array_equal(ring.cells, same.cells)
    assert volume(ring) == pytest.approx(6 * np.sin(np.pi / 12) / 2 * 5) and same.repairs == ()


ODD_SETS = ["*NSET, NSET=back, GENERATE", "1, 4", "*NSET, NSET=\"7\"", "1, 2", '*NSET, NSET="a, b"', "3", "*NSET, NSET=every",
            'back, "7", "a, b"', " 11"]


def test_names_in_quotes(tmp_path: Path) -> None:
    mesh = deck(tmp_path, PLAIN + ODD_SETS)
    assert set(mesh.sets) == {"all", "back", "7", "a, b", "every"}
    assert mesh.numbers[mesh.nodes("every")].tolist() == [1, 2, 3, 4, 11] and mesh.numbers[mesh.nodes("7")].tolist() == [1, 2]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "deck.inp"
    lines = [*PLAIN, "*NSET, NSET=Fläche", "1", "*NSET, NSET=Flöche", "2"]
    path.write_bytes("\r\n".join([*lines, ""]).encode(encoding))
    mesh = fs.read_mesh(path)
    assert mesh.numbers[mesh.nodes("Fläche")].tolist() == [1] and mesh.numbers[mesh.nodes("Flöche")].tolist() == [2]
    assert encoding != "utf-8-sig" or path.read_bytes().startswith(codecs.BOM_UTF8)


@pytest.mark.parametrize(("lines", "text"), [
    (["*NSET, NSET=a, GENERATE", "24, 21, -1"], "*NSET a, GENERATE has a line from 24 to 21 in steps of -1; it must be"),
    (["*NSET, NSET=a, GENERATE", "1, 4, -1"], "GENERATE has a line from 1 to 4 in steps of -1"),
    (["*NSET, NSET=a, GENERATE", "1"], "GENERATE has a line from 1 to 0 in steps of 1;"),
    (["*NSET, NSET=a, ELSET=none"], "*NSET a names the set 'none', which is not above it"),
    (["*ELSET, ELSET=a", "none"], "*ELSET a names 'none', which is neither a number nor a set above it"),
    (["*NSET", "1"], "a *NSET without a name"),
    (['*NSET, NSET="Top"', "1", '*NSET, NSET="TOP"', "2"], "sets 'Top' and 'TOP', which differ only in upper and lower case"),
    (["*ELEMENT, TYPE=C3D8", CELL_LINES[3]], "gives 1 elements more than once, the first is element 11"),
    (["*ELEMENT, TYPE=MASS", "11, 1"], "gives 1 elements more than once, the first is element 11"),
    (["*ELEMENT, TYPE=C3D8", "51, 1, 2, 12, 11, 101, 102, 112", "52, 2, 3, 13, 12, 102, 103, 113, 112, 9"],
     "element 2 begins within a line"),
    (["*ELEMENT, TYPE=COH3D8", "51, 1, 2, 12, 11, 101, 102, 112, 111"], "elements of type COH3D8 cannot be read"),
    (["*NODE", "0, 1., 1., 1."], "the numbers of nodes must be whole and positive, not 0.0"),
    (["*NODE", "900, 1. 1., 1."], "4 numbers in 3 fields: is a comma missing?"),
    (["*NODE", "900, 1.", "901, 1."], "each line must be number, x, y, z"),
    (["*NSET, NSET=a", "1, -1"], "the nodes of *NSET a must be whole and positive, not -1"),
    (["*NSET, NSET=c", "1", "*NSET, NSET=a", "c, --1"], "*NSET a names '--1', which is neither a number nor a set above it"),
    (["*NSET, NSET=c", "1", "*NSET, NSET=a", f"c, {2**63}"], "*NSET a: its data hold a number beyond all limits"),
    (["*NSET, NSET=c", "1", "*NSET, NSET=a", f"c, {2**64 + 1}"], "*NSET a: its data hold a number beyond all limits"),
    (["*NSET, NSET=c", "1", "*NSET, NSET=a", "c, \u0663"], "*NSET a names '\u0663', which is neither a number nor a set"),
    (["*NSET, NSET=c", "1", "*NFILL", f"c, c, 2, {2**63}"], "number of intervals and step hold a number beyond all limits"),
    (["*NODE, INPUT=none.inp"], "includes 'none.inp', which is not a file beside it"),
    (["*ELGEN", "77, 3"], "*ELGEN copies element 77, which is not above it"),
    (["*ELGEN", "1, 99999, 1, 1, 99999"], "makes 99999 x 99999 x 1 elements, which is none or too many"),
    (["*ELCOPY, OLD SET=all, SHIFT NODES=1"], "*ELCOPY needs ELEMENT SHIFT=..., a whole number"),
    (["*NGEN", "1, 4, 2"], "*NGEN: 4 is not reached from 1 in steps of 2"),
    (["*NGEN, LINE=P", "1, 4, 1, 2"], "*NGEN, LINE=P is not read"),
    (["*NFILL, BIAS=2", "all, all, 3"], "*NFILL, BIAS=2 is not read"),
    (["*NCOPY, OLD SET=all, CHANGE NUMBER=500, POLE", "0,0,0"], "*NCOPY, POLE is not read"),
    (["*NMAP, NSET=n, TYPE=SPHERICAL", "0,0,0,1,0,0"], "*NMAP names the set 'n', which is not above it"),
    (["*NSET, NSET=n", "1", "*NMAP, NSET=n, TYPE=SPHERICAL", "0,0,0,1,0,0"], "*NMAP, TYPE=SPHERICAL is not read"),
    (["*IMPERFECTION, FILE=x, STEP=1", "1, 0.1"], "has *IMPERFECTION, which changes the mesh in a way that femsub does not"),
    (["*STEP", "*MODEL CHANGE, REMOVE", "all"], "has *MODEL CHANGE, which changes the mesh"),
    (["*ELEMENTS, TYPE=C3D8", CELL_LINES[3]], "has the unknown keyword *ELEMENTS; did you mean *ELEMENT?"),
])
def test_what_is_refused(lines: list[str], text: str, tmp_path: Path) -> None:
    with pytest.raises(fs.InputError, match=re.escape(text)) as caught:
        deck(tmp_path, PLAIN + lines)
    assert "deck.inp" in str(caught.value) and "\n" not in str(caught.value)


def test_a_set_before_its_elements(tmp_path: Path) -> None:
    mesh = deck(tmp_path, ["*ELSET, ELSET=a, GENERATE", "1, 3", "*NSET, NSET=n, ELSET=a", "*ELSET, ELSET=b", "1, 2", *PLAIN])
    assert len(mesh.groups["a"]) == 3 and len(mesh.groups["b"]) == 2 and len(mesh.nodes("n")) == 16


@pytest.mark.parametrize("tail", ["*EL", "*NSET, NSET=a\n1, 2", "*NGEN\n1, 4", "*INCL"])
def test_a_last_line_that_may_be_cut(tail: str, tmp_path: Path) -> None:
    path = tmp_path / "deck.inp"
    path.write_text("\n".join([*PLAIN, tail]))
    with pytest.raises(fs.InputError, match="ends within a line of"):
        fs.read_mesh(path)
    path.write_text("\n".join([*PLAIN, "*STEP", "*END STEP"]))
    assert_nine(fs.read_mesh(path))


def test_keywords_that_look_alike_are_let_pass(tmp_path: Path) -> None:
    rest = ["*Node Output", "U", "*Element Output", "S", "*Node File", "U", "*El Print, Elset=all", "S",
            "*Nodal Thickness", "1, 1.",
            "*User Element, nodes=2, type=U1", "1, 2",
            "*Model Change, type=contact pair, remove", "a, b", "*System"]
    assert_nine(deck(tmp_path, PLAIN + rest))


def test_a_comma_at_the_end_of_a_keyword_costs_no_member(tmp_path: Path) -> None:
    """It was taken for a sign that the keyword goes on, and the first line of 16 members with it."""
    first, rest = (", ".join(map(str, part)) for part in (list(NODES)[:16], list(NODES)[16:]))
    tail = ["*NSET, NSET=a,", first, rest, "*NSET, NSET=b, GENERATE,", "1, 4", "11, 14", "*NSET, NSET=c,", "a, b",
            "*NSET, NSET=d,", "GENERATE", "1, 3", "*NSET, NSET=e", f"{first},", rest]
    mesh = deck(tmp_path, PLAIN + tail)
    assert {name: len(rows) for name, rows in mesh.sets.items()} == {"all": 32, "a": 32, "b": 8, "c": 32, "d": 3, "e": 32}


@pytest.mark.parametrize("cells", [[f"{line}, 9, 10," for line in CELL_LINES], [CELL_LINES[0] + ", 7", *CELL_LINES[1:]]])
def test_more_nodes_on_a_line_than_the_element_has(cells: list[str], tmp_path: Path) -> None:
    mesh = deck(tmp_path, ["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", *cells])
    assert sorted(map(tuple, mesh.numbers[mesh.cells].tolist())) == sorted(map(tuple, CELLS.values()))
    many = "2 nodes" if cells[1].endswith(",") else "1 node"
    assert len(mesh.repairs) == 1 and f" {many} too many on a line" in mesh.repairs[0]


def test_commas_too_many_at_the_end_of_a_line_of_nodes(tmp_path: Path) -> None:
    mesh = fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron20")
    first, rest = (", ".join(map(str, part)) for part in (mesh.cells[0][:15] + 1, mesh.cells[0][15:] + 1))
    nodes = [f"{i + 1}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(mesh.points)]
    back = deck(tmp_path, ["*NODE", *nodes, "*ELEMENT, TYPE=C3D20", f"1, {first},, ", f"   {rest}"])
    assert back.kind == "hexahedron20" and volume(back) == pytest.approx(1.0) and back.repairs == ()


def test_nodes_given_twice_at_the_same_place(tmp_path: Path) -> None:
    mesh = deck(tmp_path, [*PLAIN, "*NODE, NSET=again", *NODE_LINES[:3]])
    assert mesh.repairs == ("3 nodes were given twice at the same place, kept once",) and len(mesh.points) == 32
    assert mesh.numbers[mesh.nodes("again")].tolist() == list(NODES)[:3]


def test_shells_of_three_nodes_that_calculix_calls_us3(tmp_path: Path) -> None:
    mesh = deck(tmp_path, ["*NODE", *NODE_LINES, "*USER ELEMENT, TYPE=US3, NODES=3", "*ELEMENT, TYPE=US3", "1, 1, 2, 11"])
    assert mesh.kind == "triangle" and mesh.numbers[mesh.cells].tolist() == [[1, 2, 11]]


def test_nodes_of_sets_that_are_not_there(tmp_path: Path) -> None:
    """Numbers with gaps: sets by GENERATE run over them."""
    tail = ["*NSET, NSET=all, GENERATE", "1, 99999999999, 1", "*NSET, NSET=few", "4, 29, 11", "*NSET, NSET=none", "29"]
    mesh = deck(tmp_path, ["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", *CELL_LINES, *tail])
    assert {name: len(rows) for name, rows in mesh.sets.items()} == {"all": 32, "few": 2, "none": 0}
    assert "*NSET all names 99999999967 nodes that the file does not give, the first is 5: left out" in mesh.repairs
    assert "*NSET few names 1 nodes that the file does not give, the first is 29: left out" in mesh.repairs


def test_elements_of_sets_that_are_not_there(tmp_path: Path) -> None:
    """CalculiX passes over them, too."""
    tail = ["*ELSET, ELSET=most, GENERATE", "1, 99999999999, 1", "*ELSET, ELSET=few", "1, 77", "*ELSET, ELSET=none", "77"]
    mesh = deck(tmp_path, ["*NODE", *NODE_LINES, "*ELEMENT, TYPE=C3D8", *CELL_LINES, *tail])
    assert {name: len(rows) for name, rows in mesh.groups.items()} == {"most": 9, "few": 1}
    assert mesh.repairs == (
        "*ELSET most names 99999999990 elements that the file does not give, the first is 4: left out",
        "*ELSET few names 1 elements that the file does not give, the first is 77: left out",
        "*ELSET none names 1 elements that the file does not give, the first is 77: left out")


@pytest.mark.parametrize(("lines", "text"), [
    (["*ELEMENT, TYPE=SPRINGA", "1, 1, 2", "*ELEMENT, TYPE=D", "2, 1, 3, 2", "3, 2, 4, 3"],
     "has only elements of types that femsub does not read: 1 of type SPRINGA, 2 of type D"),
    (["*ELEMENT, TYPE=C3D15", "1, 1, 2, 11, 101, 102, 111, 3, 4, 12, 103, 104, 112, 13, 14, 21"], "has 1 wedge15 cells, but"),
    (["*ELEMENT, TYPE=C3D6", "1, 1, 2, 11, 101, 102, 111"], "has 1 wedge cells, but femsub"),
    ([], "has no *ELEMENT data"),
    (["*RESTART, READ", "*STEP"], "has no *ELEMENT data: it continues another run (*RESTART, READ), whose file has the mesh"),
])
def test_elements_that_femsub_has_not_are_named(lines: list[str], text: str, tmp_path: Path) -> None:
    with pytest.raises(fs.InputError, match=re.escape(text)):
        deck(tmp_path, ["*NODE", *NODE_LINES, *lines])


def test_a_decimal_comma_in_a_node_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.inp"
    nodes = ("*NODE\n1, 0., 0., 0.,\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0.5, 1., 0., 0., 1.\n*ELEMENT, TYPE=C3D4\n"
             "1, 1, 2, 3, 4\n")
    path.write_text(nodes)
    assert fs.read_mesh(path).points.shape == (4, 3)
    for cosines in ("1.", "0., 1.", "0.6, 0.8,"):  # Abaqus completes them by 0
        path.write_text(nodes.replace("1., 0., 0., 1.\n", f"1., {cosines}\n"))
        mesh = fs.read_mesh(path)
        assert mesh.points[3].tolist() == [0.0, 0.5, 1.0]
        assert any("1 node has one or two direction cosines" in note and "decimal comma" in note for note in mesh.repairs)
    path.write_text(nodes.replace("2, 1., 0., 0.", "2, 1,5, 0., 2."))
    with pytest.raises(fs.InputError, match=r"write 0\.5, not 0,5"):
        fs.read_mesh(path)
    path.write_text(nodes.replace("2, 1., 0.", "2, 1,5, 0."))
    with pytest.raises(fs.InputError, match=r"write 0\.5, not 0,5"):
        fs.read_mesh(path)


def test_sets_that_name_each_other_again_and_again_do_not_grow(tmp_path: Path) -> None:
    """Each of 60 sets names the one above it twice, and itself: their members were listed 3 to the power of 60 times."""
    lines = ["*NODE", "1, 0., 0., 0.", "2, 1., 0., 0.", "3, 0., 1., 0.", "4, 0., 0., 1.", "*ELEMENT, TYPE=C3D4", "1, 1, 2, 3, 4",
             "*NSET, NSET=s0", "2"]
    for number in range(1, 61):
        lines += [f"*NSET, NSET=s{number}", f"s{number - 1}, s{number - 1}", f"*NSET, NSET=s{number}", f"s{number}, s{number}"]
    (tmp_path / "part.inp").write_text("\n".join(lines) + "\n")
    assert fs.read_mesh(tmp_path / "part.inp").nodes("s60").tolist() == [1]


def test_a_blank_coordinate_before_a_zero_is_zero(tmp_path: Path) -> None:
    """As meshes among CalculiX' own tests have it: '21, 7.5e-1, 1.,  ,0.' is no decimal comma."""
    text = "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.,  ,0.000e+00 \n4, 0., 1.\n*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n"
    path = tmp_path / "a.inp"
    path.write_text(text)
    assert fs.read_mesh(path).points[:, :2].tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    for wrong in ("3, 1., 1.,  ,5 ", "3, 1., 1., 0,0 ", "3, 1., ,  ,0.5, 2."):
        path.write_text(text.replace("3, 1., 1.,  ,0.000e+00 ", wrong))
        with pytest.raises(fs.InputError, match=r"write 0\.5, not 0,5"):
            fs.read_mesh(path)
