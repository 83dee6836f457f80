"""The names of `femsub.output` with which kinds describe their results."""

from __future__ import annotations

from collections.abc import Callable

from femsub.output import (
    NEVER as NEVER,
    Advice as Advice,
    Chart as Chart,
    Picture as Picture,
    Remark as Remark,
    Result as Result,
    Shown as Shown,
    Table as Table,
    Verdict as Verdict,
    column as column,
    label as label,
    named as named,
    sentence as sentence,
    span as span,
)

Progress = Callable[[str], None]
