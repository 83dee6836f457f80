"""The exceptions and warnings a user can meet. Each message says what was found and what to do next."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class FemsubError(Exception):
    """Root of everything femsub raises on purpose."""


class InputError(FemsubError, ValueError):
    """An argument has the wrong value: the message names it, what was found and what would do."""


class InputTypeError(FemsubError, TypeError):
    """An argument has the wrong type."""


class SingularMatrixError(FemsubError, ArithmeticError):
    """A factorisation met a singular or (where it must not be) indefinite matrix."""


class NotConvergedError(FemsubError, ArithmeticError):
    """An iteration stopped before its tolerance; the message holds both figures."""


class BreakdownError(NotConvergedError):
    """An eigensolver broke off within an iteration. That depends on its start vector: with another one it may succeed."""


class NoCycleError(InputError):
    """There is no limit cycle of the kind that was asked for: no mode grows, no simple Hopf point, no amplitude that balances."""


class MissedModesError(FemsubError, ArithmeticError):
    """Fewer modes were found than an independent count says there are."""


class UnstableModelError(FemsubError, ArithmeticError, ValueError):
    """The model is unstable before the friction acts, so that no border can be sought."""


class NotEnoughMemoryError(FemsubError, MemoryError):
    """What was asked needs more memory than there is; nothing was begun."""


class MissingPackageError(FemsubError, ImportError):
    """An optional package is needed for what was asked."""


class FemsubWarning(UserWarning):
    """Root of femsub's warnings: a figure is less trustworthy than it looks, and the text says by how much."""


class PortWarning(FemsubWarning):
    """A port is poorly represented: its static response by a reduction basis, or its set by the faces or cells it holds."""


class CutoffWarning(FemsubWarning):
    """An answer of a reduced model rests on modes so near to its cut-off that they may be far from the component's."""


class ConditionWarning(FemsubWarning):
    """Rounding has taken so much of a result that it deserves no trust."""


def unknown_name(kind: str, found: object, valid: Iterable[str]) -> InputError:
    """The error for a name that does not exist, with the nearest one that does."""
    names = sorted(valid)
    near = difflib.get_close_matches(str(found), names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? Valid" if near else "valid"
    return InputError(f"unknown {kind} {found!r}; {hint}: {', '.join(names) or 'none'}")
