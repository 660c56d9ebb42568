"""The findings of the doctor: one line for each check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Grade = Literal["ok", "warn", "bad"]
Fault = tuple[object, Grade, str]  # whether it applies, how bad it is, what to do
Case = tuple[object, Grade, str, str]  # whether it applies, how bad it is, what was found, what to do

MARKS: Mapping[Grade, str] = {"ok": "✓", "warn": "!", "bad": "✗"}


@dataclass(frozen=True)
class CheckResult:
    """Result of one check. remedy: what to do; empty if nothing is to be done."""

    grade: Grade
    check: str
    found: str
    remedy: str = ""
    station: str | None = None  # None: it concerns all


def graded(check: str, found: str, *faults: Fault) -> CheckResult:
    """Return the result of the first case that applies; ok if none does."""
    cases = [(applies, grade, found, remedy) for applies, grade, remedy in faults]
    return first_of(check, *cases, (True, "ok", found, ""))


def first_of(check: str, *cases: Case) -> CheckResult:
    """Return the result of the first case that applies; the last case always applies."""
    return next(
        CheckResult(grade, check, found, remedy) for applies, grade, found, remedy in cases if applies
    )
