"""The findings of the doctor: one line for each check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Grade = Literal["ok", "warn", "bad"]
Fault = tuple[object, Grade, str]  # whether it applies, how bad it is, what to do

MARKS: Mapping[Grade, str] = {"ok": "✓", "warn": "!", "bad": "✗"}


@dataclass(frozen=True)
class CheckResult:
    """One check. remedy: what to do, empty where nothing is to be done."""

    grade: Grade
    check: str
    found: str
    remedy: str = ""
    station: str | None = None  # None: it concerns all


def graded(check: str, found: str, *faults: Fault) -> CheckResult:
    """Grade a finding by the first of the faults that applies; it is ok where none does."""
    for applies, grade, remedy in faults:
        if applies:
            return CheckResult(grade, check, found, remedy)
    return CheckResult("ok", check, found)


def ok(check: str, found: str) -> CheckResult:
    """As it should be."""
    return CheckResult("ok", check, found)


def warn(check: str, found: str, remedy: str) -> CheckResult:
    """Make a warning: the check passes, with a limitation."""
    return CheckResult("warn", check, found, remedy)


def bad(check: str, found: str, remedy: str, *, station: str | None = None) -> CheckResult:
    """Make an error: an action is required."""
    return CheckResult("bad", check, found, remedy, station)
