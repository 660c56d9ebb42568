"""The journal's interface. A record is written before it is processed, and never changed.

What changes a session is recorded in the order in which it was taken: the opening, every batch that was
news, every hole that was given up (an `evicted` error), the close. What came twice, and what was refused
without touching the session, is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from caesura_protocol.messages import Close, Error, Open, SampleBatch

Recordable = Open | SampleBatch | Error | Close


@dataclass(frozen=True, slots=True)
class Record:
    """A message that changed a session, with the time at which it came."""

    station: str
    session: str
    at: float  # [s] the service's clock
    message: Recordable


class Journal(Protocol):
    """Append-only records of many sessions. One thread writes."""

    def append(self, record: Record) -> None:
        """Keep a record; it is safe when this returns."""

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """The records of a session in the order in which they were appended; none for an unknown one."""

    def sessions(self) -> tuple[tuple[str, str], ...]:
        """(station, session) of every session with a record, in the order of their first one."""

    def forget(self, station: str, session: str) -> None:
        """Drop a session that is no longer kept; an unknown one is no error."""
