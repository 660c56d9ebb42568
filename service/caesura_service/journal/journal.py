"""The journal's interface. A record is written before it is processed, and never changed.

What changes a session is recorded in the order in which it was taken: the opening, every batch that was
news, every hole that was given up (an `evicted` error), every edit, the close. What came twice, and what was
refused without touching the session, is not.

When a record is safe. Batches may be processed, and their results published, a little before: the bridge
still has them, and the same batches give the same results. What no bridge can send again, or what would
come out differently the second time, is safe before it is processed: `append(record, now=True)`. And so is
everything before it is acknowledged: `commit`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from caesura_protocol.messages import Close, Error, JournalReport, Open, SampleBatch, Snapshot
from caesura_service.journal.edits import Edit

Recordable = Open | SampleBatch | Edit | Error | Close
Key = tuple[str, str]  # station and session


class JournalError(Exception):
    """The journal cannot be read or written; the message names it, the reason, and what to do."""


class JournalBusyError(JournalError):
    """Another process has the journal."""


class JournalDamagedError(JournalError):
    """What the journal has is not what was written; the message names the session and the record."""


class Record(NamedTuple):
    """A message that changed a session, with the time at which it came."""

    station: str
    session: str
    at: float  # [s] the service's clock
    message: Recordable


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a session ended: all that can be asked of a closed one, so that it need not be replayed."""

    opening: Open  # the last one
    last_seq: int  # of its batches; -1 without one
    snapshot: Snapshot


class Copy(NamedTuple):
    """What one journal has of a session."""

    station: str
    session: str
    opened: float  # [s] time of day of its first record
    touched: float  # [s] time of day of its last one
    closed: bool
    last_seq: int  # the highest number of a batch; -1 without one
    size: int  # [bytes]
    edits: int = 0

    @property
    def key(self) -> Key:
        """(station, session)."""
        return self.station, self.session

    @property
    def progress(self) -> tuple[bool, int, int, int]:
        """Of two copies the greater is further along."""
        return self.closed, self.last_seq, self.edits, self.size


class Journal(Protocol):
    """Append-only records of many sessions. One thread appends."""

    def append(self, record: Record, *, now: bool = False) -> None:
        """Keep a record; it is safe soon, or when this returns if it shall be `now`.

        Raises JournalError, and has not kept it then.
        """

    def commit(self) -> None:
        """Everything that was appended is safe when this returns. Raises JournalError."""

    def flush(self) -> None:
        """As `commit`, and how sessions ended is kept too. Raises JournalError."""

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """The records of a session in the order in which they were appended; none for an unknown one."""

    def edits(self, station: str, session: str) -> tuple[Edit, ...]:
        """The edits of a session in the order in which they were made."""

    def sessions(self) -> tuple[Key, ...]:
        """(station, session) of every session with a record, in the order of their first one."""

    def closed(self) -> Set[Key]:
        """Those of the sessions that have a close among their records."""

    def copies(self, station: str | None = None, session: str | None = None) -> tuple[Copy, ...]:
        """What it has of every session, of those of a station, or of one; oldest first."""

    def epoch_of(self, station: str) -> int:
        """The last epoch under which this instance had the station; -1 if it never had."""

    def keep_epoch(self, station: str, epoch: int) -> None:
        """Remember under which epoch this instance has the station. Raises JournalError."""

    def conclude(self, station: str, outcome: Outcome) -> None:
        """Keep how a closed session ended. What can be replayed may do without."""

    def outcome(self, station: str, session: str) -> Outcome | None:
        """How a session ended, where that was kept and can be read."""

    def release(self, station: str, session: str) -> None:
        """Release a closed session: from now on the journal decides whether it is kept."""

    def set_aside(self, station: str, session: str, why: str) -> str:
        """Keep a damaged session under another name, and free its own; the new name. Raises JournalError."""

    def forget(self, station: str, session: str) -> None:
        """Drop a session; an unknown one is no error."""

    def tidy(self, now: float) -> Mapping[Key, str]:
        """Drop what age and size no longer allow [s, as in the records]; returns what has gone, and why."""

    def report(self) -> JournalReport:
        """How it is doing; may be asked from any thread."""
