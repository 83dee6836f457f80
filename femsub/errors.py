"""The exceptions and warnings a user can meet. Each message says what was found and what to do next."""

from __future__ import annotations

import difflib
import shutil
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any


def printable(text: str, most: int | None = None) -> str:
    """A text for a terminal: signs that it would obey as escapes, and without its middle if it has more than `most`."""
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
    except Exception:  # a whole number of more digits than Python prints, an object whose own code fails
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


class FemsubError(Exception):
    """Root of everything femsub raises on purpose."""

    def __str__(self) -> str:
        return printable(super().__str__(), most=4000)  # texts of files and callers are in it


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
    """There is no such limit cycle: no mode grows, there is no simple Hopf point, no amplitude balances, or a signal
    is not periodic.
    """


class MissedModesError(FemsubError, ArithmeticError):
    """Fewer modes were found than an independent count gives."""


class UnstableModelError(FemsubError, ArithmeticError, ValueError):
    """The model is unstable without friction, so there is no critical slope."""


class NotEnoughMemoryError(FemsubError, MemoryError):
    """A computation would need more memory than is available. It was not started."""


class WorkerError(FemsubError):
    """A worker process died or ran out of memory. `part` names what it had; `done` has the results of the others, by name."""

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
    """Warn where the first caller outside this package stands, by whatever way it came here."""
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
    """The error for a folder that cannot take `what`, of so many bytes (0: a few), since its disk or its memory is full."""
    free = ""
    with suppress(OSError):
        free = f"; {shutil.disk_usage(folder).free / 1e6:.3g} MB are free there"
    size = f", {need / 1e6:.3g} MB" if need else ""
    return NotEnoughMemoryError(f"the folder {folder} cannot take {what}{size} ({why}){free}. {remedy}")


def unknown_name(kind: str, found: object, valid: Iterable[str], *more: object) -> InputError:
    """The error for a name that does not exist, and for `more` of the kind, with the nearest ones that do."""
    names, text = sorted(valid), ""
    for one in (found, *more):
        near = difflib.get_close_matches(str(one)[:60], names, n=1, cutoff=0.5)
        text += f"unknown {kind} {shown(one)}; " + (f"did you mean {near[0]!r}? " if near else "")
    return InputError(f"{text}{'Valid' if text.endswith('? ') else 'valid'}: {', '.join(names) or 'none'}")


def first_few(names: Sequence[str], kind: str = "", most: int = 5) -> str:
    """'a, b, c, d, e and 2 more', so that a sentence stays one; `kind` is what they are."""
    more = f" and {len(names) - most} more {kind}".rstrip() if len(names) > most else ""
    return ", ".join(names[:most]) + more
