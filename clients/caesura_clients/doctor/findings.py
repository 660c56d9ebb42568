"""What the doctor says: one line a check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Grade = Literal["ok", "warn", "bad"]

MARKS: Mapping[Grade, str] = {"ok": "✓", "warn": "!", "bad": "✗"}


@dataclass(frozen=True)
class Finding:
    """One check. remedy: what to do, empty where nothing is to be done."""

    grade: Grade
    check: str
    found: str
    remedy: str = ""
    station: str | None = None  # None: it concerns all


def ok(check: str, found: str, *, station: str | None = None) -> Finding:
    """As it should be."""
    return Finding("ok", check, found, station=station)


def warn(check: str, found: str, remedy: str, *, station: str | None = None) -> Finding:
    """Make a warning: the check passes, with a limitation."""
    return Finding("warn", check, found, remedy, station)


def bad(check: str, found: str, remedy: str, *, station: str | None = None) -> Finding:
    """Make an error: an action is required."""
    return Finding("bad", check, found, remedy, station)
