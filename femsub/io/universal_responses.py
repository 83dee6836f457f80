"""`read_response`: measured receptances from universal files (UFF, dataset 58), as test benches write them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, package, path_of
from femsub.errors import InputError
from femsub.modes import FrequencyResponse

RESPONSE = 4  # function type of dataset 58
FORCE = 13  # data type of the denominator
ORDERS = {8: 0, 11: 1, 12: 2}  # of the numerator: displacement, velocity, acceleration
DIRECTIONS = ("s", "ux", "uy", "uz", "rx", "ry", "rz")  # by number; scalar first
SAME = 1e-6  # relative difference of frequencies that count as equal: text has six digits


def read_response(path: str | Path, *, level: float | None = None) -> FrequencyResponse:
    """The receptances of a part from a universal file: all frequency response functions in it, as a matrix.

    ===================  =======================================================================================
    it reads             dataset 58 of function type 4, text and binary: displacement, velocity or acceleration
                         over force, converted to displacement over force; other datasets are passed over
    it refuses           a pair of response and load that is missing, different frequencies, other quantities,
                         NaN, a dataset without an end, fewer values than it says, what pyuff cannot read
    it cannot know       the units of the numbers: they must be those of the other parts
    ===================  =======================================================================================

    A response or load is named by node and direction, '12:uz'; directions against an axis are turned. A frequency of 0 is left
    out, where velocity and acceleration tell nothing. Of a pair that is there several times, each is a repeated measurement.

    Parameters
    ----------
    path : str or Path
    level : float, optional
        The stated noise, relative to each entry; see `FrequencyResponse.measured`.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        pyuff is not installed.

    Examples
    --------
    >>> import femsub as fs
    >>> part = fs.read_response("hammer.uff", level=0.01)  # doctest: +SKIP
    >>> joined = fs.couple_responses({"part": part, "rest": rest}, [(("part", "3:uz"), ("rest", "DOF 7"))])  # doctest: +SKIP
    """
    file = path_of("path", path)
    uff = package("pyuff", "universal files need pyuff", "pyuff")
    if not file.is_file():
        raise InputError(f"there is no file {file}")
    if len(re.findall(rb"(?m)^ {4}-1\s*$", file.read_bytes())) % 2:  # pyuff passes over a dataset without an end
        raise InputError(f"{file} is cut short or damaged: its last dataset has no end")
    try:
        content = uff.UFF(str(file))
        kinds = np.asarray(content.get_set_types())
        sets = [content.read_sets(int(at)) for at in np.flatnonzero(kinds == 58)]
    except Exception as error:  # pyuff raises nothing more special
        raise InputError(f"{file} is no universal file that pyuff can read: {str(error) or type(error).__name__:.100}") from None
    found = [one for one in sets if one.get("func_type") == RESPONSE]
    if not found:
        raise InputError(f"{file} holds no frequency response function (dataset 58 of function type {RESPONSE}); its datasets "
                         f"are {', '.join(map(str, np.unique(kinds))) or 'none'}")
    pairs: dict[tuple[str, str], list[Array]] = {}
    at = np.array(found[0]["x"], dtype=float)
    for one in found:
        pair, h = _receptance(file, one, at)
        pairs.setdefault(pair, []).append(h)
    responses, loads = (tuple(dict.fromkeys(pair[side] for pair in pairs)) for side in (0, 1))
    counts = {len(many) for many in pairs.values()}
    missing = [(row, column) for row in responses for column in loads if (row, column) not in pairs]
    if missing or len(counts) > 1:
        what = (f"from {missing[0][1]} to {missing[0][0]} is missing" if missing else
                f"is there {min(counts)} times for some pairs and {max(counts)} times for others")
        raise InputError(f"{file}: the response {what}. Each pair of the {len(responses)} responses and {len(loads)} loads is "
                         "needed equally often")
    h = np.array([[pairs[row, column] for column in loads] for row in responses])  # (nr, nl, ns, nf)
    moving = at > 0
    h = h.transpose(2, 3, 0, 1)[:, moving]
    return FrequencyResponse.measured(2 * np.pi * at[moving], h if len(h) > 1 else h[0], responses, loads, level=level)


def _receptance(file: Path, one: dict[str, Any], at: Array) -> tuple[tuple[str, str], Array]:
    """The names of response and load, and displacement over force at these frequencies [Hz]."""
    names, sign = [], 1.0
    for end in ("rsp", "ref"):
        node, direction = int(one[f"{end}_node"]), int(one[f"{end}_dir"])
        if abs(direction) >= len(DIRECTIONS):
            raise InputError(f"{file}: node {node} has the direction {direction}, but -6 to 6 are known")
        names.append(f"{node}:{DIRECTIONS[abs(direction)]}")
        sign = -sign if direction < 0 else sign
    where = f"{file}: the response from {names[1]} to {names[0]}"
    top, bottom = int(one.get("ordinate_spec_data_type", 0)), int(one.get("orddenom_spec_data_type", 0))
    if top not in ORDERS or bottom != FORCE:
        raise InputError(f"{where} has the data types {top} over {bottom}, but displacement (8), velocity (11) or acceleration "
                         f"(12) over force ({FORCE}) is needed")
    x, h = np.asarray(one["x"], dtype=float), np.asarray(one["data"])
    if len(h) != int(one["num_pts"]):
        raise InputError(f"{where} announces {one['num_pts']} values, but has {len(h)}; it is damaged")
    if x.shape != at.shape or not np.allclose(x, at, rtol=SAME, atol=0) or h.shape != x.shape:
        raise InputError(f"{where} has other frequencies than the first one")
    if not (np.isfinite(x).all() and np.isfinite(h).all() and len(x) and x.min() >= 0 and np.any(x > 0)):
        raise InputError(f"{where} holds a NaN, an infinite number or no positive frequency")
    rate = (2j * np.pi * np.where(x > 0, x, 1.0)) ** ORDERS[top]
    return (names[0], names[1]), sign * h / rate
