"""The vocabulary of all rooms: `Array`, `Matrix`, `EPS`, the kinds of evidence, errors and warnings, the checks of arguments.

A message of an error says what was found and what to do next.

Each check returns the value in the type that the code needs, or raises an error that says what was found and what is valid.
No value is converted just because it looks right: '3', True and 2.0 are not whole numbers. NumPy is imported for arrays only,
so that an error in a scene is reported without waiting for it.
"""

from __future__ import annotations

import difflib
import hashlib
import math
import shlex
import shutil
import sys
import sysconfig
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from numbers import Integral, Real
from pathlib import Path
from tempfile import gettempdir
from threading import RLock
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, Self, TypeAlias, TypeVar
from unicodedata import category

if TYPE_CHECKING:
    import numpy as np

Array: TypeAlias = "np.ndarray"
Matrix: TypeAlias = Any  # numpy.ndarray (dense) or scipy.sparse.csr_array (sparse), both float64

EPS = sys.float_info.epsilon
POSITION = 1e-6  # relative to a model's size: mesh files print six to seven digits, so coincident points differ by this
DENSE = 4000  # coordinates up to which a model is dense: each matrix has 128 MB, and all modes take half a minute on one core
EQUAL = 1e-9  # relative difference of results that are equal in exact arithmetic: some 100 roundings, condition number 1e5

#: Evidence that nothing is missing: the number of listed eigenvalues equals an independent count that does not sample.
#: These are the inertia of K - ω²M, the number of all eigenvalues of a pencil, and the discs of `femsub.stability.exclusion`.
CERTIFIED = "certified"
#: The numbers are equal, but the count samples or estimates: for example, a pencil is sampled over a range of its parameter.
CONFIRMED = "confirmed"
#: Nothing was counted, the count is incomplete, or it differs from the number listed.
NOT_CHECKED = "not checked"

#: For each package, the extra of pyproject.toml that installs it; '' for packages of the plain set-up.
EXTRAS = {"numpy": "", "scipy": "", "lazy_loader": "", "threadpoolctl": "", "dolfinx-solver-real": "", "matplotlib": "figures",
          "scikit-fem": "fe", "meshio": "fe", "plotly": "page", "pyyeti": "nastran", "h5py": "matlab",
          "ansys-mapdl-reader": "ansys", "shtab": "completion", "pandas": "frames",
          "pyvista": "window"}

#: classes that Python registers as whole numbers, but that are refused here: truth values and NumPy's time spans
NO_NUMBERS = ("bool", "timedelta64")

T = TypeVar("T")


def printable(text: str, most: int | None = None) -> str:
    """A text that is safe on a terminal: characters that do not print become escape sequences, line breaks stay.

    A text of more than `most` characters loses its middle.
    """
    if most is not None and len(text) > most:
        text = f"{text[:most // 2]} ... {text[-(most // 2):]}"
    return text if text.isprintable() else "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape", "surrogatepass").decode() for sign in text)


def shown(value: Any) -> str:
    """A value in at most 60 characters for a message; for an array its shape and type."""
    if hasattr(value, "dtype") and getattr(value, "shape", None):
        return f"an array of {value.dtype} of shape {value.shape}"
    try:
        text = " ".join(printable(repr(value)).split()) if not isinstance(value, (str, bytes)) else repr(value[:60])
    except Exception:  # an int of more digits than Python prints, or an object whose __repr__ fails
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


class FemsubError(Exception):
    """Root of everything femsub raises on purpose."""

    def __str__(self) -> str:
        return printable(super().__str__(), most=4000)  # a message may quote texts of files and callers


class InputError(FemsubError, ValueError):
    """An argument has a wrong value. The message names it, what was found, and what is valid."""


class InputTypeError(FemsubError, TypeError):
    """An argument has the wrong type."""


class SingularMatrixError(FemsubError, ArithmeticError):
    """A matrix to be factorised is singular, or indefinite where it must be definite."""


class NotConvergedError(FemsubError, ArithmeticError):
    """An iteration stopped before it reached its tolerance. The message reports the error reached and the tolerance."""


class BreakdownError(NotConvergedError):
    """An eigensolver failed within an iteration. It may succeed with another start vector."""


class NoCycleError(InputError):
    """The limit cycle does not exist: no mode grows, there is no simple Hopf point, no amplitude balances, or a signal
    is not periodic.
    """


class MissedModesError(FemsubError, ArithmeticError):
    """Fewer modes were found than an independent count gives."""


class UnstableModelError(FemsubError, ArithmeticError, ValueError):
    """The model is unstable without friction, so there is no critical slope."""


class NotEnoughMemoryError(FemsubError, MemoryError):
    """A computation would need more memory than is available. It was not started."""


class WorkerError(FemsubError):
    """A worker process died or ran out of memory. `part` names its part; `done` has the results of the other parts, by name."""

    def __init__(self, message: str = "", part: str = "", done: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.part, self.done = part, dict(done or {})


class MissingPackageError(FemsubError, ImportError):
    """An optional package is needed, but not installed. The message says how to install it."""


class FemsubWarning(UserWarning):
    """Root of femsub's warnings: a result is less accurate than it looks. The message says by how much."""


class PortWarning(FemsubWarning):
    """A port is poorly represented: its static response by a reduction basis, or its set of nodes by faces or cells."""


class CutoffWarning(FemsubWarning):
    """A result of a reduced model depends on modes near its cut-off, which may be inaccurate."""


class ConditionWarning(FemsubWarning):
    """A result is inaccurate because of rounding."""


def warn(message: str | Warning, category: type[Warning] = FemsubWarning) -> None:
    """Issues a warning that shows the line of the first caller outside this package, however deep the call."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(("femsub.", "functools")):
        frame, level = frame.f_back, level + 1
    warnings.warn(printable(message) if isinstance(message, str) else message, category, stacklevel=level)


def empty_dofs_error(count: int, names: Iterable[str], model: str = "") -> SingularMatrixError:
    """The error for DOF that no matrix of a model acts on; it names the first three."""
    return SingularMatrixError((f"{model!r}: " if model else "") + empty_dofs_text(count, names) + ". Leave them out: "
                               "read_component(..., drop_empty=True), or M, D and K without their rows and columns")


def empty_dofs_text(count: int, names: Iterable[str]) -> str:
    """'5 DOF have neither mass nor stiffness: rx at node 1, ry at node 1, rz at node 1 and 2 more'."""
    first = list(islice(names, 3))
    more = f" and {count - len(first)} more" if count > len(first) else ""
    return f"{count} DOF {'have' if count > 1 else 'has'} neither mass nor stiffness: {', '.join(first)}{more}"


def no_room_error(folder: Path, what: str, need: float, why: object,
                  remedy: str = "Set TMPDIR to a folder with more room") -> NotEnoughMemoryError:
    """The error for a folder whose disk or memory is too full for `what`, which needs `need` bytes (0: only a few)."""
    free = ""
    with suppress(OSError):
        free = f"; {shutil.disk_usage(folder).free / 1e6:.3g} MB are free there"
    size = f", {need / 1e6:.3g} MB" if need else ""
    return NotEnoughMemoryError(f"the folder {folder} cannot take {what}{size} ({why}){free}. {remedy}")


def unknown_name(kind: str, found: object, valid: Iterable[str], *more: object) -> InputError:
    """The error for an unknown name, and for `more` unknown names of this kind. It suggests the nearest valid name of each."""
    names, text = sorted(valid), ""
    for one in (found, *more):
        near = difflib.get_close_matches(str(one)[:60], names, n=1, cutoff=0.5)
        text += f"unknown {kind} {shown(one)}; " + (f"did you mean {near[0]!r}? " if near else "")
    return InputError(f"{text}{'Valid' if text.endswith('? ') else 'valid'}: {', '.join(names) or 'none'}")


def first_few(names: Sequence[str], kind: str = "", most: int = 5) -> str:
    """'a, b, c, d, e and 2 more': at most `most` names, so that a sentence stays short. `kind` is a noun after 'more'."""
    more = f" and {len(names) - most} more {kind}".rstrip() if len(names) > most else ""
    return ", ".join(names[:most]) + more


@dataclass(frozen=True)
class Tally:
    """The number of eigenvalues that a result lists, beside an independent count: whether the list is complete.

    Only this class says that a result is certified (tests/test_house.py).

    Parameters
    ----------
    listed : int
        Number of listed modes or eigenvalues, or of losses of stability minus regains.
    counted : int, optional
        The same number by a count that does not use the list. None: nothing was counted.
    sampled : bool
        Whether the count samples or estimates.

    Examples
    --------
    >>> from femsub.checks import Tally
    >>> Tally(4, 4).evidence, Tally(4, 4, sampled=True).evidence, Tally(3, 4).evidence, Tally(4).evidence
    ('certified', 'confirmed', 'not checked', 'not checked')
    """

    listed: int
    counted: int | None = None
    sampled: bool = False

    @property
    def evidence(self) -> str:
        """'certified', 'confirmed' or 'not checked'."""
        if self.counted is None or self.listed != self.counted:
            return NOT_CHECKED
        return CONFIRMED if self.sampled else CERTIFIED


def until(cutoff: float) -> str:
    """Words for the end of a result's range: ' up to the cut-off 12 rad/time', '' for inf, 'not known' for NaN."""
    if math.isnan(cutoff):
        return " (the cut-off of its basis is not known)"
    return "" if math.isinf(cutoff) else f" up to the cut-off {cutoff:.4g} rad/time"


def limit_of(cutoff: float) -> str:
    """Words for the cut-off of a model: ', cut-off 12 rad/time', '' for inf, 'not known' for NaN."""
    return "" if math.isinf(cutoff) else ", cut-off not known" if math.isnan(cutoff) else f", cut-off {cutoff:.4g} rad/time"


def package(module: str, why: str, *names: str, otherwise: str = "") -> Any:
    """Imports a module of an optional package. The error says what needs it (`why`), and at its end how to install `names`."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingPackageError(f"{why}{otherwise}: {installed_by(*names)}") from error
    except Exception as error:  # for example numba, where it finds no writable folder for its cache
        raise MissingPackageError(f"{why}{otherwise}, which is installed, but cannot be imported: {error}") from error


def set_up_by() -> str:
    """The path of the `scripts/setup` that created this interpreter's environment, quoted for a shell; '' if none did."""
    stamp = Path(sys.prefix) / ".setup" / "root"
    command = Path(stamp.read_text(encoding="utf-8").strip()) / "scripts" / "setup" if stamp.is_file() else None
    return shlex.quote(str(command)) if command and command.is_file() else ""


def installed_by(*names: str, numpy_below: int = 0) -> str:
    """The command that installs packages for this interpreter. It keeps NumPy below a major version, as petsc4py needs.

    The command is `scripts/setup EXTRA` if that script created the environment. Otherwise it runs pip by this interpreter, since
    `pip` in the user's shell may belong to another one. Where the system's Python refuses pip (PEP 668), the command first
    creates a virtual environment that includes the system's packages. The default of `numpy_below` is one above the installed.
    """
    from importlib import metadata  # 30 ms

    extras = sorted({EXTRAS[name] for name in names if name in EXTRAS})
    if extras and (setup := set_up_by()):
        return " && ".join(f"{setup} {extra}".strip() for extra in extras)
    python, make, kept = shlex.quote(sys.executable or "python3"), "", [name for name in names if name == "numpy"]
    with suppress(metadata.PackageNotFoundError):
        kept = [f'"numpy<{numpy_below or int(metadata.version("numpy").split(".")[0]) + 1}"']
    if sys.prefix == sys.base_prefix and (Path(sysconfig.get_path("stdlib")) / "EXTERNALLY-MANAGED").is_file():
        make, python = f"{python} -m venv --system-site-packages ~/femsub-venv && ", "~/femsub-venv/bin/python"
    return f"{make}{python} -m pip install {' '.join([*kept, *(name for name in names if name != 'numpy')])}"


def finite_number(name: str, value: Any) -> float:
    """A finite real number."""
    if type(value).__name__ in NO_NUMBERS or not isinstance(value, Real):
        raise InputTypeError(f"{name} must be a number, not {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{name} must be a finite number, not {shown(value)}")
    return number


@contextmanager
def naming(argument: str) -> Iterator[None]:
    """Context manager: an error about part of an argument's value, such as an unknown set, begins with the argument's name."""
    try:
        yield
    except (InputError, InputTypeError) as error:
        if argument not in str(error):
            error.args = (f"{argument}: {error}",)
        raise


def positive_number(name: str, value: Any) -> float:
    """A finite number above 0."""
    number = finite_number(name, value)
    if number <= 0:
        raise InputError(f"{name} must be positive, but is {shown(value)}")
    return number


def whole_number(name: str, value: Any, least: int | None = None, most: int | None = None) -> int:
    """An int from `least` to `most`, where these limits are given."""
    if type(value).__name__ in NO_NUMBERS or not isinstance(value, Integral):
        raise InputTypeError(f"{name} must be a whole number, not {shown(value)}")
    number = int(value)
    if abs(number) > sys.maxsize:
        raise InputError(f"{name} must be a whole number of at most {sys.maxsize}, but is {shown(number)}")
    if (least is not None and number < least) or (most is not None and number > most):
        limits = [f"at least {least}"] * (least is not None) + [f"at most {most}"] * (most is not None)
        raise InputError(f"{name} must be {' and '.join(limits)}, but is {shown(number)}")
    return number


def truth(name: str, value: Any) -> bool:
    """True or False."""
    if type(value).__name__ not in ("bool", "bool_"):  # bool_ is NumPy's
        raise InputTypeError(f"{name} must be True or False, not {shown(value)}")
    return bool(value)


def choice(name: str, value: Any, valid: Iterable[str]) -> str:
    """One of the `valid` words."""
    names = list(valid)
    if not isinstance(value, str) or value not in names:
        raise unknown_name(name, value, names)
    return value


def word(name: str, value: Any) -> str:
    """A string, such as a name. It is printed, so control and format characters, which a terminal may obey, are refused."""
    if not isinstance(value, str):
        raise InputTypeError(f"{name} must be a string, not {shown(value)}")
    if as_word(value) != value:
        raise InputError(f"{name} must have printable characters only, but is {shown(value)}")
    return value


def as_word(text: str) -> str:
    """A text of a file as a name: characters that `word` refuses (control, format, surrogates) become escape sequences."""
    return "".join(sign.encode("unicode_escape", "surrogatepass").decode() if category(sign) in ("Cc", "Cf", "Cs") else sign
                   for sign in text)


def csv_cell(text: str) -> str:
    """A text for a CSV file. An apostrophe is put before a text that begins like a formula, or a spreadsheet would run it.

    A text that begins with apostrophes and then like a formula gets one more. So a reader that removes one recovers the text.
    """
    text = printable(text).replace("\n", " ")
    return f"'{text}" if text.lstrip("'").startswith(("=", "+", "-", "@")) else text


def instance(name: str, value: Any, kind: type[T], hint: str = "") -> T:
    """An object of a class."""
    if not isinstance(value, kind):
        raise InputTypeError(f"{name} must be a {kind.__name__}{hint and f' ({hint})'}, not {shown(value)}")
    return value


def items(name: str, value: Any, of: str) -> list[Any]:
    """The elements of a list, tuple, array or other collection `of` something; a string or a mapping is refused."""
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable) or isinstance(value, type):
        raise InputTypeError(f"{name} must be a list of {of}, not {shown(value)}")
    refuse_masked(name, value)
    try:
        return list(value)
    except (NotImplementedError, TypeError):  # an array of no dimension, or a sparse matrix that does not iterate
        raise InputTypeError(f"{name} must be a list of {of}, not {shown(value)}") from None


def mapping(name: str, value: Any, of: str) -> Mapping[Any, Any]:
    """A dict or another mapping."""
    if not isinstance(value, Mapping) or hasattr(value, "shape"):  # SciPy's dok_array is a dict
        raise InputTypeError(f"{name} must be a dict of {of}, not {shown(value)}")
    return value


def interval(name: str, value: Any, positive: bool = False) -> tuple[float, float]:
    """(lo, hi) with lo < hi, both finite; with `positive` also lo ≥ 0."""
    if isinstance(value, set) or len(pair := items(name, value, "two numbers (lo, hi)")) != 2:
        raise InputTypeError(f"{name} must be a pair (lo, hi), not {shown(value)}")
    lo, hi = (finite_number(name, edge) for edge in pair)
    if lo >= hi or (positive and lo < 0):
        raise InputError(f"{name} must be (lo, hi) with {'0 <= ' * positive}lo < hi, but is ({lo:g}, {hi:g})")
    return lo, hi


def check_band(band: object) -> tuple[float, float]:
    """A band (lo, hi) with 0 ≤ lo < hi, in radians per unit of time."""
    return interval("band", band, positive=True)


def real_array(name: str, value: Any, finite: bool = True) -> np.ndarray:
    """An array of float64, copied only if the type differs; with `finite`, NaN and Inf are refused."""
    import numpy as np

    raw = rows(name, value)
    if raw.dtype.kind not in "iuf":
        raise InputTypeError(f"{name} must be real numbers, not {shown(value) if raw.ndim == 0 else raw.dtype}")
    array = raw.astype(np.float64, copy=False)
    if finite and not np.isfinite(array).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name} holds a NaN or Inf, first at index {at[0] if len(at) == 1 else at}")
    return array


def whole_numbers(name: str, value: Any) -> np.ndarray:
    """A flat array of integers from a list or an array; it may be empty."""
    import numpy as np

    raw = rows(name, value if isinstance(value, np.ndarray) else items(name, value, "whole numbers"))
    if raw.ndim != 1 or (raw.size and raw.dtype.kind not in "iu"):
        raise InputTypeError(f"{name} must be a flat list of whole numbers, not {shown(value)}")
    return raw if raw.size else raw.astype(np.intp)


def refuse_masked(name: str, value: Any) -> None:
    """Refuses an array with masked entries, and a list of such arrays: NumPy would use the values below the mask."""
    import numpy as np

    if any(isinstance(one, np.ma.MaskedArray) and np.ma.is_masked(one)
           for one in (value, *(value if isinstance(value, (list, tuple)) else ()))):
        raise InputError(f"{name} has masked entries, which are no numbers: replace them by .filled(...), or leave them out")


def rows(name: str, value: Any) -> np.ndarray:
    """An array of any type; nested lists must have rows of equal length."""
    import numpy as np

    refuse_masked(name, value)
    try:
        return np.asarray(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be rows of the same length, not {shown(value)}") from None


def path_of(name: str, value: Any) -> Path:
    """A path from a str or a Path."""
    if not isinstance(value, (str, Path)):
        raise InputTypeError(f"{name} must be a path (str or Path), not {shown(value)}")
    if "\0" in str(value):
        raise InputError(f"{name} holds a NUL character: {shown(str(value))}")
    try:
        str(value).encode("utf-8", "surrogateescape")  # as Python encodes file names
    except UnicodeEncodeError:
        raise InputError(f"{name} holds a character that no file name has: {shown(str(value))}") from None
    return Path(value)


def resolved(path: str | Path) -> Path:
    """The absolute path of a file or folder, with symbolic links resolved; links that form a loop stay unresolved."""
    try:
        return Path(path).resolve()
    except RuntimeError:  # Python before 3.13
        return Path(path).absolute()


def is_there(path: Path) -> bool:
    """Whether a path exists; a symbolic link to nothing does. False for an invalid name, and where access is denied."""
    try:
        path.lstat()
    except (OSError, ValueError):
        return False
    return True


def is_file(path: Path) -> bool:
    """Whether a path is a file, or a symbolic link to one. False for an invalid name, and where access is denied."""
    with suppress(OSError):
        return path.is_file()
    return False


def listener(name: str, value: Any) -> Callable[[str], None]:
    """A function that reports progress; for None, a function that does nothing."""
    if value is None:
        return lambda _: None
    if not callable(value):
        raise InputTypeError(f"{name} must be a function of one string, or None, not {shown(value)}")
    return value


def temporary() -> Path:
    """The folder for temporary files, which the environment variable TMPDIR names.

    Raises
    ------
    NotEnoughMemoryError
        No folder for temporary files is writable.
    """
    try:
        return Path(gettempdir())
    except OSError as error:
        raise NotEnoughMemoryError(f"no folder takes temporary files ({error.strerror or error}). Set TMPDIR to a folder with "
                                   "free space") from None


def content_hash(file: BinaryIO) -> str:
    """SHA-256 of the whole content of an open file, read in blocks."""
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return content_hash(file)


def unlike(path: Path, known: str, size: int | None = None, raising: bool = False) -> str:
    """How a file differs from the SHA-256 `known`, and from `size` in bytes where it is given, in words; '' if it does not.

    With `raising`, an OSError of reading is raised, not returned as a difference.
    """
    try:
        if not path.is_file():
            return "there is no such file"
        if size is not None and path.stat().st_size != size:
            return f"it has {path.stat().st_size} bytes, and had {size}"
        return "" if hash_of(path) == known else "its content has changed"
    except OSError as error:
        if raising:
            raise
        return f"it cannot be read: {error.strerror or error}"


class Parser:
    """The lock by which one thread at a time uses Python's parser."""

    lock: ClassVar[Any] = RLock()

    @classmethod
    def renew(cls) -> None:
        """A new lock for a forked child: if a thread of the parent held the old lock, the child would wait for ever."""
        cls.lock = RLock()


@contextmanager
def parsing() -> Iterator[None]:
    """Context manager: no other thread of femsub uses Python's parser meanwhile, as NumPy does to read headers of .npy files.

    Python 3.11 up to 3.11.7 has one recursion counter for the syntax trees of all threads. It raises SystemError where two
    threads build a tree at once (python/cpython#106905).
    """
    with Parser.lock:
        yield


class Interruptible:
    """Ctrl-C ends the block but not the program: results so far are kept, and `complete` is False.

    with Interruptible() as work:
        for model in models:
            kept.append(run(model))
    if not work.complete: ...                                   # report it; the command then ends with a status that is not 0
    """

    complete = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        stopped = kind is not None and issubclass(kind, KeyboardInterrupt)
        self.complete = self.complete and not stopped
        return stopped
