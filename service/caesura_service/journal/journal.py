"""The journal's interface. A record is written before it is processed, and never changed.

What changes a session is recorded in the order in which it was taken: the opening, every batch that was
news, every hole that was given up (an `evicted` error), every edit, description and edit of the program, the
close. What came twice, and what was refused without touching the session, is not.

When a record is safe. Batches may be processed, and their results published, a little before: the bridge
still has them, and the same batches give the same results. What no bridge can send again, or what would
come out differently the second time, is safe before it is processed: `append(record, now=True)`. And so is
everything before it is acknowledged: `commit`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from caesura_protocol.messages import (
    Close,
    Describe,
    Edit,
    EditProgram,
    Error,
    JournalReport,
    Open,
    SampleBatch,
    Snapshot,
)
from caesura_service.journal.edits import AppliedEdit

Recordable = Open | SampleBatch | AppliedEdit | Describe | EditProgram | Error | Close
Key = tuple[str, str]  # station and session


class JournalError(Exception):
    """The journal cannot be read or written; the message has its name, the reason and the remedy."""


class JournalFullError(JournalError):
    """The journal's disk is full, or has no more room than the reserve for deletions."""


class JournalShareError(JournalError):
    """The open sessions of a station have taken their share of the journal."""

    def __init__(self, why: str, taken: int, limit: int) -> None:
        """Store the message, the bytes taken and the limit [bytes]."""
        super().__init__(why)
        self.taken, self.limit = taken, limit


class JournalSupersededError(JournalError):
    """Another instance has acquired the station: this one may record nothing of it until it has again."""


class JournalBusyError(JournalError):
    """Another process has the journal."""


class JournalDamagedError(JournalError):
    """The journal's content is not what was written; the message names the session and the record."""


class JournalMalformedError(JournalDamagedError):
    """SQLite calls the file malformed, as it also calls one that could not be read just then."""


class JournalEmptyError(JournalError):
    """There is no journal in the file yet: its owner is about to create it."""


class JournalForeignError(JournalError):
    """The file is no journal, or is one of a newer version."""


class PeerJournalError(JournalError):
    """The journal of another instance cannot be read just now: what it has recorded is unknown."""


class Record(NamedTuple):
    """A message that changed a session, with the time at which it came."""

    station: str
    session: str
    at: float  # [s] the service's clock
    message: Recordable


class EncodedBatch(NamedTuple):
    """A batch with its payload, which is as `encode` makes it."""

    epoch: int
    seq: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of a closed session, which answer its queries without a replay."""

    opening: Open  # the last one
    last_seq: int  # of its batches; -1 without one
    snapshot: Snapshot


class Copy(NamedTuple):
    """The extent of one journal's records of a session."""

    station: str
    session: str
    opened: float  # [s] time of day of its first record
    touched: float  # [s] time of day of its last one
    closed: bool
    last_seq: int  # the highest number of a batch; -1 without one
    size: int  # [bytes]
    edits: int = 0
    described: int = 0  # changes of the description and edits of the program: they alter no result

    @property
    def key(self) -> Key:
        """(station, session)."""
        return self.station, self.session

    @property
    def progress(self) -> tuple[bool, int, int, int, int]:
        """A key that is greater for the copy that is further along."""
        return self.closed, self.last_seq, self.edits, self.described, self.size


class StoredOutcome(NamedTuple):
    """A session with an outcome."""

    key: Key
    size: int  # [bytes] of its records; 0 while the outcome waits to be written


class Journal(Protocol):
    """Append-only records of many sessions. One thread appends."""

    def append(self, record: Record, *, now: bool = False) -> None:
        """Append a record; it is on disk soon, or on return with `now`.

        Raises JournalError, and has not appended it then; JournalShareError at the share of the station's
        open sessions, which a close always passes.
        """

    def append_batch(self, station: str, session: str, at: float, batch: EncodedBatch) -> None:
        """Append a batch as `append` does, without packing it again. at: [s] the service's clock."""

    def commit(self) -> None:
        """Write every appended record to disk. Raises JournalError."""

    def flush(self) -> None:
        """Write every appended record and outcome to disk. Raises JournalError."""

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """Return the records of a session in the order of their appending; none for an unknown one."""

    def edits(self, station: str, session: str) -> tuple[AppliedEdit, ...]:
        """Return the edits of a session, oldest first."""

    def edit_at(
        self, station: str, session: str, kind: type[Edit] | type[EditProgram], revision: int
    ) -> Edit | EditProgram | None:
        """Return the edit of a session, or of its program, that so many came before; None without one.

        Raises JournalError.
        """

    def sessions(self) -> tuple[Key, ...]:
        """Return (station, session) of every session, in the order of their first record."""

    def closed(self) -> Set[Key]:
        """Return the sessions with a close among their records."""

    def copies(self, station: str | None = None, session: str | None = None) -> tuple[Copy, ...]:
        """Return the extent of every session, of a station's, or of one; oldest first."""

    def epoch_of(self, station: str) -> int:
        """Return the last epoch under which this instance owned the station; -1 without one."""

    def store_epoch(self, station: str, epoch: int) -> None:
        """Store the epoch under which this instance owns the station. Raises JournalError."""

    def store_outcome(self, station: str, outcome: Outcome) -> None:
        """Store the outcome of a closed session; one without an outcome is replayed."""

    def outcome(self, station: str, session: str) -> Outcome | None:
        """Return the outcome of a session; None where there is none or it is unreadable.

        Any thread may call it, as `outcomes`; neither waits for a write.
        """

    def outcomes(self) -> tuple[StoredOutcome, ...]:
        """Return the sessions with an outcome, the newest first."""

    def release(self, station: str, session: str) -> None:
        """Release a closed session: from now on the journal decides whether it is kept."""

    def check_readable(self) -> None:
        """Read everything once. Raises JournalError where the disk refuses that."""

    def quarantine(self, station: str, session: str, why: str) -> str:
        """Rename a damaged session to free its name; return the new one. Raises JournalError."""

    def delete(self, station: str, session: str) -> None:
        """Delete a session; an unknown one is no error."""

    def enforce_retention(self, now: float) -> Mapping[Key, str]:
        """Delete sessions past the limits of age and size; return them with the reason. now: [s]."""

    def report(self) -> JournalReport:
        """Return the state of the journal; any thread may call it."""
