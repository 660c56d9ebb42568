"""The findings of the doctor: one line for each check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Grade = Literal["ok", "warn", "bad"]

MARKS: Mapping[Grade, str] = {"ok": "✓", "warn": "!", "bad": "✗"}


@dataclass(frozen=True)
class CheckResult:
    """One check. remedy: what to do, empty where nothing is to be done."""

    grade: Grade
    check: str
    found: str
    remedy: str = ""
    station: str | None = None  # None: it concerns all


def ok(check: str, found: str, *, station: str | None = None) -> CheckResult:
    """As it should be."""
    return CheckResult("ok", check, found, station=station)


def warn(check: str, found: str, remedy: str, *, station: str | None = None) -> CheckResult:
    """Make a warning: the check passes, with a limitation."""
    return CheckResult("warn", check, found, remedy, station)


def warn_if(limited: bool, check: str, found: str, remedy: str) -> CheckResult:
    """Make a warning where a limitation applies, else a passed check without the remedy."""
    return warn(check, found, remedy) if limited else ok(check, found)


def bad(check: str, found: str, remedy: str, *, station: str | None = None) -> CheckResult:
    """Make an error: an action is required."""
    return CheckResult("bad", check, found, remedy, station)
