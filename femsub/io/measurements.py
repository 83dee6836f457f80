"""`read_response` and `read_modes`: what a test bench has measured (universal files), or another program has computed (Ansys)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from femsub.checks import Array, InputError, choice, path_of, warn
from femsub.io.damage import existing, unreadable_refused
from femsub.io.mesh_text import as_numbers, whole
from femsub.io.universal import NUMBERS, OF_MESHES, DataSet, Sets, apart, data_sets, nodes_of, origin_of
from femsub.modes import FrequencyResponse, ModeSet

HEADS = {Sets.FUNCTION: 11, Sets.DATA_AT_NODES: 8, Sets.ANALYSIS_DATA: 13}  # lines before the numbers of a data set
FORCES = (13, 9)  # data types of the denominator: excitation force, reaction force
QUANTITIES = {"displacement": 8, "velocity": 11, "acceleration": 12}  # data types of the numerator
FREQUENCY = 18  # data type of the abscissa
ORDERS = {8: 0, 11: 1, 12: 2}  # by data type, how often the displacement is differentiated
SILENT = {0: "unknown", 1: "general"}  # data types that do not name a quantity
RECORD = {"f4": 6, "f8": 4}  # numbers on a full line of text, by precision
DIRECTIONS = ("s", "ux", "uy", "uz", "rx", "ry", "rz")  # by number; scalar first
WIDTHS = {2: 3, 3: 6}  # values of a node, by the kind of data: translations in the global frame, and rotations


class Analysis(IntEnum):
    """The analysis types of the data sets 55 and 2414 that are modes."""

    NORMAL_MODE = 2
    COMPLEX_FIRST_ORDER = 3
    COMPLEX_SECOND_ORDER = 7


@unreadable_refused
def read_response(path: str | Path, *, level: float | None = None, quantity: str | None = None,
                  over: str | None = None) -> FrequencyResponse:
    """The receptances of a part from a universal file: all frequency response functions in it, as a matrix.

    ===================  =======================================================================================
    it reads             data set 58 of function type 4, text and binary: displacement, velocity or acceleration
                         over force, converted to displacement over force; other data sets are passed over. Zeros may fill
                         the last line of text behind the announced values
    it refuses           a pair of response and load that is missing, different frequencies, other quantities, an abscissa that
                         is no frequency, real values, NaN, a data set without an end, fewer or more values than it says
    it cannot know       the units of the numbers: they must be the units of the other parts. The directions are those of each
                         node's own frame. What data of the types 0 (unknown) and 1 (general) are: state it
    ===================  =======================================================================================

    A response or load is named by node and direction, '12:uz'; directions against an axis are turned. A frequency of 0 is left
    out: velocity and acceleration determine no displacement there. Of a pair that is there several times, each is a repeated
    measurement.

    Parameters
    ----------
    path : str or Path
    level : float, optional
        The stated noise, relative to each entry; see `FrequencyResponse.measured`.
    quantity : {'displacement', 'velocity', 'acceleration'}, optional
        What the responses are where the file has the data type 0 (unknown) or 1 (general). A file that names another quantity
        is refused.
    over : {'force'}, optional
        States that the loads are forces where the file has the data type 0 or 1.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        See the table.

    Examples
    --------
    >>> import femsub as fs
    >>> part = fs.read_response("hammer.uff", level=0.01)  # doctest: +SKIP
    >>> joined = fs.couple_responses({"part": part, "rest": rest}, [(("part", "3:uz"), ("rest", "DOF 7"))])  # doctest: +SKIP
    """
    file = existing(path_of("path", path))
    stated = (None if quantity is None else choice("quantity", quantity, QUANTITIES),
              None if over is None else choice("over", over, ("force",)))
    sets = list(data_sets(file))
    functions = [one for one in sets if one.kind == Sets.FUNCTION]
    if short := [one for one in functions if len(one.lines) < HEADS[Sets.FUNCTION]]:
        raise InputError(f"{file}: a data set 58 has {len(short[0].lines)} lines, but its head alone has {HEADS[Sets.FUNCTION]}")
    types = whole(file, "the sixth line of a data set 58, which begins with the type of the function (is a line above it lost?),",
                  [one.lines[5][:5].strip() for one in functions])
    for one in functions:
        whole(file, "the sixth line of a data set 58, which has whole numbers in its columns 6 to 30,",
              "".join(f"{one.lines[5][start:stop]} " for start, stop in ((5, 15), (15, 20), (20, 30))).split())
        if one.lines[5][80:].strip():
            raise InputError(f"{file}: the sixth line of a data set 58, {one.lines[5].strip()[:40]!r}, is longer than its 80 "
                             "columns: lines or bytes are lost")
    found = [one for one, kind in zip(functions, types, strict=True) if kind == 4]  # frequency response functions
    if not found:
        raise InputError(f"{file} holds no frequency response function (data set 58 of function type 4); its data sets "
                         f"are {', '.join(map(str, sorted({one.kind for one in sets})))}")
    for one in sets:  # without this warning, a response with a damaged number of its data set or type would be lost
        if len(one.lines) > HEADS[Sets.FUNCTION] and not any(one is other for other in found):
            kind, top, bottom = (one.lines[line][:10].strip() for line in (6, 8, 9))
            if kind in ("5", "6") and top in map(str, ORDERS) and bottom in map(str, FORCES):  # complex, as NUMBERS has them
                warn(f"{file}: a data set {one.kind} with function type {one.lines[5][:5].strip():.5} is left out, although it "
                     "has complex values of a motion over a force, as a frequency response function has (data set 58 of "
                     "function type 4). Is a number damaged?")
    pairs: dict[tuple[str, str], list[Array]] = {}
    at: Array | None = None
    for one in found:
        pair, x, h = _receptance(file, one, *stated)
        at = x if at is None else at
        if x.shape != at.shape or not np.allclose(x, at, rtol=1e-6, atol=0):  # text has six digits
            raise InputError(f"{file}: the response from {pair[1]} to {pair[0]} has other frequencies than the first one")
        pairs.setdefault(pair, []).append(h)
    responses, loads = (tuple(dict.fromkeys(pair[side] for pair in pairs)) for side in (0, 1))
    counts = {len(many) for many in pairs.values()}
    missing = [(row, column) for row in responses for column in loads if (row, column) not in pairs]
    if missing or len(counts) > 1:
        what = (f"from {missing[0][1]} to {missing[0][0]} is missing" if missing else
                f"is there {min(counts)} times for some pairs and {max(counts)} times for others")
        raise InputError(f"{file}: the response {what}. Each pair of the {len(responses)} responses and {len(loads)} loads is "
                         "needed equally often")
    assert at is not None
    for pair, many in pairs.items():
        mean = np.mean(many, axis=0)
        far = max(float(np.linalg.norm(one - mean)) for one in many)
        if far > 0.5 * np.linalg.norm(mean):  # the noise of measurements that are repeated is far below half of their size
            warn(f"{file}: the {len(many)} responses from {pair[1]} to {pair[0]} are taken as one measurement that was repeated, "
                 f"but differ from their mean by {far / np.linalg.norm(mean):.0%}. Are they of other nodes or directions?")
    h = np.array([[pairs[row, column] for column in loads] for row in responses])  # (nr, nl, ns, nf)
    moving = at > 0
    h = h.transpose(2, 3, 0, 1)[:, moving]
    return FrequencyResponse.measured(2 * np.pi * at[moving], h if len(h) > 1 else h[0], responses, loads, level=level)


def _receptance(file: Path, one: DataSet, quantity: str | None, over: str | None) -> tuple[tuple[str, str], Array, Array]:
    """The names of response and load, the frequencies [Hz], and displacement over force there."""
    # response and load: node and direction, against an axis if negative
    names, sign, dofs = [], 1.0, one.lines[5]
    for end, start in (("response", 41), ("load", 66)):
        ends = [dofs[start:start + 10].strip(), dofs[start + 10:start + 14].strip()]
        node, direction = whole(file, f"the {end} of a data set 58", ends)
        if abs(direction) >= len(DIRECTIONS):
            raise InputError(f"{file}: node {node} has the direction {direction}, but -6 to 6 are known")
        names.append(f"{node}:{DIRECTIONS[abs(direction)]}")
        sign = -sign if direction < 0 else sign
    where = f"{file}: the response from {names[1]} to {names[0]}"
    # quantities, by the file or as stated
    along, = whole(file, where, [one.lines[7][:10].strip() or "0"])
    if along not in (*SILENT, FREQUENCY):
        raise InputError(f"{where} is listed over the data type {along}, but frequency ({FREQUENCY}) in Hz is needed")
    top, bottom = (whole(file, where, [one.lines[line][:10].strip()])[0] for line in (8, 9))
    if (quantity and top not in (*SILENT, QUANTITIES[quantity])) or (over and bottom not in (*SILENT, *FORCES)):
        raise InputError(f"{where} has the data types {top} over {bottom}, which are not those of {quantity or 'the response'} "
                         f"over {over or 'the load'}, as stated. State only what the file leaves open (data types 0 and 1)")
    top = QUANTITIES[quantity] if quantity and top in SILENT else top
    bottom = FORCES[0] if over and bottom in SILENT else bottom
    if top not in ORDERS or bottom not in FORCES:
        named = " over ".join(f"{kind} ({SILENT[kind]})" if kind in SILENT else f"{kind}" for kind in (top, bottom))
        usable = top in (*ORDERS, *SILENT) and bottom in (*FORCES, *SILENT)
        said = " and ".join(["quantity='displacement', 'velocity' or 'acceleration'"] * (top in SILENT) +
                            ["over='force'"] * (bottom in SILENT))
        raise InputError(f"{where} has the data types {named}, but displacement (8), velocity (11) or acceleration (12) over "
                         f"force (13 or 9) is needed{f'. If it is that, state it by {said}' * usable}")
    # frequencies, evenly spaced or listed, and complex values
    kind, count, even = whole(file, where, [one.lines[6][at:at + 10].strip() for at in (0, 10, 20)])
    if kind not in NUMBERS or NUMBERS[kind][1] < 2:
        raise InputError(f"{where} has values of the type {kind}; complex ones (5, 6) are needed")
    form, width = NUMBERS[kind][0], NUMBERS[kind][1] + (even == 0)
    announced = count * width
    if one.values is not None:  # bytes, behind which blanks or NUL may fill the end
        size = int(form[1])
        stop = announced * size if announced >= 0 else 0
        fill = one.values[stop:]
        if fill.strip(b" \t\r\n\0") or len(fill) >= 2 * size or len(one.values) < stop:
            raise InputError(f"{where} announces {stop} bytes of values, but has {len(one.values)}; it is damaged")
        values = np.frombuffer(one.values[:stop], f"{one.order}{form}").astype(float)
    else:  # text, whose last line zeros may fill
        lines = [apart(line) for line in one.lines[HEADS[Sets.FUNCTION]:] if line.strip()]
        values = as_numbers(f"{where}: its values", " ".join(lines), float)
        if len(values) > announced and not values[announced:].any():
            longest = max(RECORD[form], *(len(line.split()) for line in lines[:-1]), 0)
            if len(values) - announced < len(lines[-1].split()) <= longest:
                values = values[:announced]
    if len(values) != announced:
        raise InputError(f"{where} announces {count} values, but has {len(values) / width:g}; it is damaged")
    table = values.reshape(count, width)
    x, h = table[:, 0], table[:, -2] + 1j * table[:, -1]
    if even:
        places = as_numbers(f"{where}: its frequencies", apart(one.lines[6][30:56]), float)
        if len(places) < 2:
            raise InputError(f"{where} must have the first frequency and the step on its line 7, columns 31 to 56; it is damaged")
        x = places[0] + places[1] * np.arange(count)
    if not (np.isfinite(x).all() and np.isfinite(h).all() and len(x) and x.min() >= 0 and np.any(x > 0)):
        raise InputError(f"{where} holds a NaN, an infinite number or no positive frequency")
    rate = (2j * np.pi * np.where(x > 0, x, 1.0)) ** ORDERS[top]
    return (names[0], names[1]), x, sign * h / rate


@unreadable_refused
def read_modes(path: str | Path) -> ModeSet:
    """Modes of a test bench or of another program: frequencies, damping and shapes at the nodes of its file.

    ===================  =======================================================================================
    it reads             universal files: data at nodes (55, 2414) of normal modes and of complex ones, real or complex
                         shapes of three or six global motions, with places from 15 or 2411; Ansys' .rst files of a modal
                         analysis (needs ansys-mapdl-reader): see `femsub.io.ansys.read_rst`
    it leaves out        motions that are 0 in every mode: they were not measured, or are held; other data sets and analyses
    it refuses           nodes that another mode of data sets 2414 does not have, the same node twice, NaN, a data set without
                         an end, values missing
    it cannot know       units; whether modes are missing; how the program scaled its shapes
    ===================  =======================================================================================

    Frequencies in Hz become radians per second. The damping ratio is the viscous one; where that is 0, half the loss factor.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    ModeSet
        By ascending frequency.

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        .rst without ansys-mapdl-reader.

    Examples
    --------
    >>> import femsub as fs
    >>> known = fs.read_modes("test.uff")  # doctest: +SKIP
    >>> pairs = known.compare(part, fs.normal_modes(part, count=20), tol=5.0)  # doctest: +SKIP
    """
    file = existing(path_of("path", path))
    if file.suffix.lower() == ".rst":
        from femsub.io.ansys import read_rst

        return ModeSet.of(*read_rst(file))
    sets = list(data_sets(file))
    read = [(one, _mode(file, one) if one.kind in (Sets.DATA_AT_NODES, Sets.ANALYSIS_DATA) else None) for one in sets]
    found = [mode for _, mode in read if mode is not None]
    left = Counter(one.kind for one, mode in read if mode is None and one.kind not in OF_MESHES)
    notes = [f"data set {kind} left out{f' ({count} times)' * (count > 1)}: no modes, or of a kind that is not read"
             for kind, count in left.items()]
    if not found:
        raise InputError(f"{file} holds no modes (data sets 55 and 2414 of normal or complex modes, motions of nodes); its "
                         f"data sets are {', '.join(map(str, sorted({one.kind for one in sets})))}")
    nodes = sorted({node for mode in found for node in mode.values})
    if short := [mode for mode in found if not mode.old and len(mode.values) < len(nodes)]:
        missing = next(node for node in nodes if node not in short[0].values)
        raise InputError(f"{file}: the mode of {abs(short[0].eigenvalue) / 2 / np.pi:g} Hz does not say how node {missing} "
                         "moves, as another mode does")
    width = max(len(value) for mode in found for value in mode.values.values())
    table = np.zeros((len(nodes), width, len(found)), dtype=complex)
    for column, mode in enumerate(found):
        for row, node in enumerate(nodes):  # where a node is missing in a data set 55, it does not move
            value = mode.values.get(node, np.zeros(0))
            table[row, :len(value), column] = value
    shapes = table.reshape(len(nodes) * width, len(found))
    numbers, places = nodes_of(file, sets)
    at = dict(zip(numbers.tolist(), places, strict=True))
    points = np.repeat([at[node] for node in nodes], width, axis=0) if set(nodes) <= at.keys() else None
    if points is None:
        lost = next(node for node in nodes if node not in at)
        notes.append(f"the file does not give the place of node {lost}, so that the modes have no places")
    if fewer := sum(len(mode.values) < len(nodes) for mode in found):
        notes.append(f"{fewer} mode{'s do' if fewer > 1 else ' does'} not list all nodes: motions of the others are taken as 0")
    return ModeSet.of(np.array([mode.eigenvalue for mode in found]), shapes if shapes.imag.any() else shapes.real,
                      np.repeat(nodes, width), np.tile(np.arange(width), len(nodes)), points, [*origin_of(sets), *notes])


class _Mode(NamedTuple):
    eigenvalue: complex
    values: Mapping[int, Array]
    old: bool  # of data set 55, where a node without motion need not be listed


def _mode(file: Path, one: DataSet) -> _Mode | None:
    """The mode in a data set, or None if it holds another analysis or other data."""
    old, begin = one.kind == Sets.DATA_AT_NODES, HEADS[Sets(one.kind)]
    head, real = (5, 7) if old else (8, 11)  # the line of the types, and that of the real parameters
    if len(one.lines) < begin:
        raise InputError(f"{file}: a data set {one.kind} has {len(one.lines)} lines, which is less than its head")
    types = whole(file, f"the head of a data set {one.kind}", one.lines[head].split())
    if len(types) != 6:
        raise InputError(f"{file}: {one.lines[head].strip()!r:.60} should be six numbers (data set {one.kind})")
    _, analysis, kind, _, data, width = types
    located = old or one.lines[2].split() == ["1"]  # data at nodes
    if analysis not in [*Analysis] or kind not in WIDTHS or data not in NUMBERS or not located:
        return None
    where = f"{file}: a mode (data set {one.kind})"
    if width != WIDTHS[kind]:
        raise InputError(f"{where} announces {width} values for each node, but has motions of {WIDTHS[kind]}")
    numbers = as_numbers(where, apart(" ".join(one.lines[real:begin])), float)
    announced = whole(file, where, one.lines[real - 1].split()[1:2]) if old else [12]
    need = (4 if old else 6) if analysis == Analysis.NORMAL_MODE else (2 if old else 8)
    if announced and len(numbers) > announced[0] >= need:  # some programs announce 1, whatever follows
        raise InputError(f"{where} has {len(numbers)} real parameters, where {announced[0]} belong: is a number in two pieces?")
    # λ: of frequency [Hz] and ratios of damping of a normal mode, or as listed of a complex one
    if analysis == Analysis.NORMAL_MODE:
        at = (0, 2, 3) if old else (1, 4, 5)
        if len(numbers) < need:
            raise InputError(f"{where} has {len(numbers)} real parameters, but frequency and damping need {need}")
        omega, viscous, structural = 2 * np.pi * numbers[at[0]], numbers[at[1]], numbers[at[2]]
        ratio = viscous or structural / 2  # some programs give the same damping in both ways
        if not (np.isfinite(omega) and omega >= 0 and -1 < ratio < 1):
            raise InputError(f"{where} has the frequency {numbers[at[0]]:g} Hz and the damping ratio {ratio:g}")
        eigenvalue = complex(-ratio * omega, omega * np.sqrt(1 - ratio**2))
    else:
        first = 0 if old else 6
        eigenvalue = complex(*numbers[first:first + 2]) if len(numbers) > first + 1 else complex(np.nan)
        if not np.isfinite(eigenvalue):
            raise InputError(f"{where} does not give its complex eigenvalue")
        eigenvalue = complex(eigenvalue.real, abs(eigenvalue.imag))
    # motions by node: its number on a line, then real or complex values, six on a line
    lines, parts = one.lines[begin:], NUMBERS[data][1]
    step = 1 + -(-width * parts // 6)
    if len(lines) % step:
        raise InputError(f"{where} has {len(lines)} lines, but {step} for each node")
    nodes = whole(file, where, [line.strip() for line in lines[::step]])
    values = as_numbers(where, apart(" ".join(line for row, line in enumerate(lines) if row % step)), float)
    filled = values.reshape(-1, 6 * (step - 1)) if len(values) == len(nodes) * 6 * (step - 1) else np.ones((0, 0))
    if filled.size and not filled[:, width * parts:].any():  # zeros may fill the last line of a node
        values = filled[:, :width * parts].ravel()
    if len(set(nodes)) < len(nodes) or len(values) != len(nodes) * width * parts:
        raise InputError(f"{where} gives a node twice, or {len(values)} numbers for {len(nodes)} nodes of {width * parts}")
    if not np.isfinite(values).all() or not nodes:
        raise InputError(f"{where} holds a NaN, an infinite number or no node")
    table = values.reshape(len(nodes), width * parts)
    return _Mode(eigenvalue, dict(zip(nodes, table[:, ::2] + 1j * table[:, 1::2] if parts == 2 else table, strict=True)), old)
