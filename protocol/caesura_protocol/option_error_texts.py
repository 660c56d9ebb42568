"""Texts for refused option values: the typed value, the expected one, and both limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer


@contextmanager
def values_named() -> Iterator[None]:
    """Name the value and both limits if typer refuses a value; pydantic's text has only one limit."""
    try:
        yield
    except typer.BadParameter as refusal:
        if findings := getattr(refusal.__cause__, "errors", None):
            low, high = (getattr(refusal.param, end, None) for end in ("min", "max"))
            refusal.message = _in_words(findings()[0], low, high)
        raise


def check_finite(context: typer.Context) -> None:
    """Refuse an infinite number or nan for an option with limits. Raises typer.BadParameter."""
    for param in context.command.params:
        ends = [getattr(param, end, None) for end in ("min", "max")]
        value = context.params.get(param.name or "")
        if isinstance(value, float) and not math.isfinite(value) and any(end is not None for end in ends):
            message = f"'{value:g}', expected a finite number{limits(*ends)}"
            raise typer.BadParameter(message, context, param_hint=f"'{param.opts[0]}'")


def _in_words(finding: dict[str, Any], low: float | None, high: float | None) -> str:
    """Return text on pydantic's finding about a typed value."""
    kind, _, why = str(finding["type"]).partition("_")
    if kind == "value":
        return str(finding["msg"]).removeprefix("Value error, ")
    if kind in {"greater", "less"} or why.startswith("parsing"):
        number = "an integer" if kind == "int" else "a number"
        return f"{finding['input']!r:.80}, expected {number}{limits(low, high)}"
    return f"{finding['input']!r:.80}: {finding['msg']}"


def limits(low: float | None, high: float | None) -> str:
    """Return text on the limits of a number, to follow its noun.

    >>> limits(1, 65535), limits(0.1, None), limits(None, 5), limits(None, None)
    (' from 1 to 65535', ' of 0.1 or more', ' of 5 or less', '')
    """
    if low is not None and high is not None:
        return f" from {low:.10g} to {high:.10g}"
    if low is not None:
        return f" of {low:.10g} or more"
    return "" if high is None else f" of {high:.10g} or less"
