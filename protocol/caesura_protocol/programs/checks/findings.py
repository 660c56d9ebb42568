"""Findings of a check of a program: errors, which forbid running it, and warnings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from caesura_protocol.app_kinds import app_name
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.messages import App, Vector
from caesura_protocol.number_words import fixed

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """Finding on one app; index and kind are None if it concerns the whole program.

    value, limit: the numbers in the reason, if any. name: that an operator gave the app. on_page: the reason
    on a page of the dashboard, where an operator has other means than at the command line.
    """

    severity: Severity
    index: int | None
    kind: str | None
    reason: str
    value: float | None = None
    limit: float | None = None
    name: str | None = None
    on_page: str | None = None

    def __str__(self) -> str:
        where = "program" if self.index is None else app_name(self.index, self.kind or "?", self.name)
        return f"{self.severity}: {where}: {self.reason}"


class Remedy(NamedTuple):
    """Advice on a finding, with the punctuation before it: at the command line, and on a page."""

    command: str
    page: str

    def of(self, found: Finding) -> Finding:
        """Return a finding, whose reason has the facts alone, with this advice."""
        return replace(found, reason=found.reason + self.command, on_page=found.reason + self.page)


def of_note(note: str) -> Finding:
    """Return a note on a program as a finding."""
    return Finding("warning", None, None, at_command_line(note), on_page=note)


def with_names(findings: Iterable[Finding], apps: Sequence[App]) -> Iterator[Finding]:
    """Yield the findings with the names of their apps."""
    for one in findings:
        yield one if one.index is None else replace(one, name=apps[one.index].name)


def in_mm(place: Vector) -> str:
    """Return a position [m] as text in millimetres."""
    return f"({', '.join(fixed(1000 * x, 0) for x in place)}) mm"


@dataclass(frozen=True)
class CheckReport:
    """All findings, in the order of the apps."""

    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that forbid running the program."""
        return tuple(one for one in self.findings if one.severity == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """The findings that the operator should read before a run."""
        return tuple(one for one in self.findings if one.severity == "warning")

    @property
    def passed(self) -> bool:
        """Whether the program may be run."""
        return not self.errors


class RefusedError(ValueError):
    """The program must not be run; the message names every app and reason."""

    def __init__(self, report: CheckReport) -> None:
        super().__init__("; ".join(map(str, report.errors)))
        self.report = report
