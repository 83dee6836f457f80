"""Every argument of every public function takes nonsense: an answer, or an error of femsub's own that ends within ten seconds."""

from __future__ import annotations

import inspect
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.arguments import KINDS, attacked, calls

LIMIT = 60.0  # seconds for one call: what takes longer hangs, on a busy machine as well
NONSENSE: dict[str, Any] = {
    "None": None,
    "a word": "x",
    "nothing": "",
    "True": True,
    "-1": -1,
    "0": 0,
    "10**30": 10**30,
    "-1.5": -1.5,
    "1e308": 1e308,
    "NaN": float("nan"),
    "inf": float("inf"),
    "1j": 1j,
    "[]": [],
    "{}": {},
    "[NaN]": [float("nan")],
    "['x']": ["x"],
    "[None]": [None],
    "(3, 1)": (3, 1),
    "(-inf, inf)": (-np.inf, np.inf),
    "too long": list(range(100)),
    "ragged": [[1.0], [1.0, 2.0]],
    "{1: 2}": {1: 2},
    "{'x': None}": {"x": None},
    "empty array": np.zeros((0, 0)),
    "bytes": b"x",
    "an object": object(),
    "a class": dict,
    "NaN array": np.full((3, 3), np.nan),
    "text array": np.array(["a", "b"]),
    "a set": {1, 2},
    "lambda": lambda: None,
}
RESULTS = {
    "Audit",
    "Branch",
    "ComplexModes",
    "CriticalValue",
    "Cut",
    "Estimate",
    "FrequencyBounds",
    "Levels",
    "LimitCycle",
    "NormalModes",
    "ReducedSubstructure",
    "Refined",
    "Rotor",
    "SelfExcitation",
    "ShotCycle",
    "StabilitySweep",
    "Study",
    "System",
    "Tracked",
    "Transient",
}  # made by femsub, not by a caller


class Lateness(BaseException):
    """Not an Exception, which the code under test may catch."""


def _late(_signal: int, _frame: FrameType | None) -> None:
    raise Lateness


@pytest.fixture(scope="module")
def working(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    return calls(tmp_path_factory.mktemp("front-door"))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Files that nonsense names are written to a folder that goes."""
    monkeypatch.chdir(tmp_path)
    before = signal.signal(signal.SIGALRM, _late)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


NAMES = sorted(
    {
        name
        for name in fs.__all__
        if callable(getattr(fs, name))
        and not (isinstance(getattr(fs, name), type) and issubclass(getattr(fs, name), BaseException))
    }
    - RESULTS
    | {"CraigBampton(cutoff)", "CraigBampton(tol)", "complex_modes(band)", "damped(modal)", "damped(ratios)",
       "normal_modes(band)", "reduce(parts)", "transient(alpha)"}
)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name == "study" else name for name in NAMES])
def test_nonsense_is_answered_or_refused(name: str, working: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> None:
    function, right = working[name]
    assert set(right) <= set(inspect.signature(function).parameters)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        function(**right)  # or the table above is stale
        faults = [
            f"{argument}={word}: {fault}"
            for argument in right
            for word, value in NONSENSE.items()
            if not (argument == "progress" and callable(value))  # what a caller's own function raises is the caller's
            and (fault := _fault(function, right | {argument: value}))
        ]
    assert not faults, "\n".join([f"{len(faults)} faults", *faults])


def _fault(function: Callable[..., Any], arguments: dict[str, Any]) -> str:
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        function(**arguments)
    except fs.FemsubError as error:
        return "" if str(error) else "an error without a word"
    except Lateness:
        return f"not done in {LIMIT:g} s"
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {error!s:.90} ({Path(at.filename).name}:{at.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return ""


def test_every_argument_is_in_the_table(working: dict[str, tuple[Callable[..., Any], dict[str, Any]]]) -> None:
    for name in (name for name in NAMES if "(" not in name):
        function = working[name][0]
        covered = {argument for key, (_, right) in working.items() if key.split("(")[0] == name for argument in right}
        assert covered == set(inspect.signature(function).parameters), name


@pytest.mark.parametrize(("kind", "value"), [
    ("mask", np.ma.masked_array(np.eye(2), mask=np.eye(2))), ("10**400", [[10**400, 0], [0, 1]]),
    ("bsr", [sp.bsr_array(np.eye(2))]),
    ("0-d", np.array(1.0)), ("objects", np.array(None))])
def test_odd_matrices_are_refused_by_name(kind: str, value: Any) -> None:
    """A mask was lost; the others were errors of Python's own. `python -m benchmarks attack arguments` has more."""
    for name in "MK":
        with pytest.raises(fs.FemsubError, match=f"^{name} "):
            fs.Pencil(**{"M": np.eye(2), "D": None, "K": np.eye(2)} | {name: value})
    for name, call in (("band", lambda: fs.normal_modes(fs.chain(3), band=value)), ("name", lambda: fs.Substructure(
            np.eye(2), np.eye(2), name=value)), ("n", lambda: fs.chain(value)), ("n", lambda: fs.chain(10**400))):
        with pytest.raises(fs.FemsubError, match=name):
            call()
    for kinds in KINDS:
        assert not attacked(kinds, 0).startswith("wrong")
