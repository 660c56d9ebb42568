"""The journal's interface. A record is written before it is processed, and never changed.

A record that was refused after it had been written may be set aside (`retract`).

Every message that changes a session is recorded, in the order of processing: the opening, every new batch,
every gap that was declared lost (an `evicted` error), every edit, description and edit of the program, the
close. Repeated messages, and refused ones that changed nothing, are not recorded.

When a record is on disk. Batches may be processed, and their results published, a little earlier: the bridge
still has them, and the same batches give the same results. A message that no bridge can send again, or whose
result would differ the second time, is on disk before it is processed: `append(record, now=True)`. Every
record is on disk before it is acknowledged: `commit`.
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
from caesura_service.journal.applied_edits import AppliedEdit

Recordable = Open | SampleBatch | AppliedEdit | Describe | EditProgram | Error | Close
Key = tuple[str, str]  # station and session


class JournalError(Exception):
    """The journal cannot be read or written; the message has its name, the reason and the remedy."""


class JournalFullError(JournalError):
    """The journal's disk is full, or only the reserve for deletions is left."""


class JournalShareError(JournalError):
    """The open sessions of a station have used their share of the journal."""

    def __init__(self, why: str, taken: int, limit: int) -> None:
        """Store the message, the bytes used and the limit [bytes]."""
        super().__init__(why)
        self.taken, self.limit = taken, limit


class JournalSupersededError(JournalError):
    """Another instance has acquired the station: this one must not record for it until it acquires it
    again.
    """


class JournalBusyError(JournalError):
    """Another process has locked the journal."""


class JournalDamagedError(JournalError):
    """The journal's content differs from what was written; the message names the session and the record."""


class JournalMalformedError(JournalDamagedError):
    """SQLite reports the file as malformed, which can also be a temporary read error."""


class JournalUnreadableError(JournalError):
    """The disk refuses to read a part of the file, perhaps for a moment."""


class JournalEmptyError(JournalError):
    """The file contains no journal yet: its owner is about to create it."""


class JournalForeignError(JournalError):
    """The file is not a journal, or is a journal of a newer version."""


class PeerJournalError(JournalError):
    """The journal of another instance cannot be read now: its records are unknown."""


class Record(NamedTuple):
    """A message that changed a session, with the time of its arrival."""

    station: str
    session: str
    at: float  # [s] the service's clock
    message: Recordable


class EncodedBatch(NamedTuple):
    """A batch with its payload as `encode` returns it."""

    epoch: int
    seq: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of a closed session, from which its queries are answered without a replay."""

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
    owner_epoch: int = -1  # of the last takeover of the station that the journal's instance has completed

    @property
    def key(self) -> Key:
        """(station, session)."""
        return self.station, self.session

    @property
    def progress(self) -> tuple[bool, int, int, int, int]:
        """A sort key that is greater for the copy that is further along: first a closed one."""
        return self.closed, self.last_seq, self.edits, self.described, self.size


class Refused(NamedTuple):
    """Records of a session that were refused: its changes beyond so many, and perhaps its close."""

    edits: int  # that stay
    described: int  # likewise, of the changes of the description and edits of the program
    close: bool  # whether the close was refused


class StoredOutcome(NamedTuple):
    """A session with an outcome."""

    key: Key
    size: int  # [bytes] of its records; 0 while the outcome waits to be written


def is_named(key: Key, station: str | None, session: str | None) -> bool:
    """Return whether a key has these names; None for any."""
    return station in {None, key[0]} and session in {None, key[1]}


class Journal(Protocol):
    """Append-only records of many sessions. One thread appends."""

    def append(self, record: Record, *, now: bool = False) -> None:
        """Append a record; it is on disk soon, or on return with `now`.

        Raises JournalError, and then appends nothing; JournalShareError if the station's open sessions have
        used their share, which does not limit a close.
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

    def changes(self, station: str, session: str) -> tuple[Recordable, ...]:
        """Return the edits, descriptions and program edits of a session, oldest first.

        Raises JournalError, and ProtocolError where one is unreadable.
        """

    def edit_at(
        self, station: str, session: str, kind: type[Edit] | type[EditProgram], revision: int
    ) -> Edit | EditProgram | None:
        """Return the edit of a session, or of its program, after `revision` earlier ones; None without one.

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

    def store_takeover(self, station: str, epoch: int) -> None:
        """Store that all that other instances recorded of the station before this epoch is here.

        Raises JournalError.
        """

    def store_outcome(self, station: str, outcome: Outcome) -> None:
        """Store the outcome of a closed session; one without an outcome is replayed."""

    def outcome(self, station: str, session: str) -> Outcome | None:
        """Return the outcome of a session; None if there is none or it is unreadable.

        Any thread may call this method and `outcomes`; neither waits for a write.
        """

    def outcomes(self, station: str | None = None, session: str | None = None) -> Iterator[StoredOutcome]:
        """Yield the sessions with an outcome, the newest first. Raises JournalError.

        station, session: their names; None for any. The first sessions cost nothing for the later ones.
        Sessions may be deleted meanwhile.
        """

    def release(self, station: str, session: str) -> None:
        """Release a closed session, which is no longer in memory: the journal decides whether to keep it."""

    def check_readable(self) -> None:
        """Read everything once. Raises JournalError if the disk refuses that."""

    def mark_unreadable(self, station: str, session: str, why: str) -> None:
        """List a session as damaged in the report: it cannot be rebuilt, and stays as it is.

        Raises JournalError.
        """

    def quarantine(self, station: str, session: str, why: str) -> str:
        """Rename a damaged session to free its name; return the new one. Raises JournalError."""

    def retract(self, station: str, session: str, refused: Refused, why: str) -> None:
        """Set what was refused aside, as if it had never been recorded, and delete the outcome.

        Raises JournalError.
        """

    def delete(self, station: str, session: str) -> None:
        """Delete a session; an unknown one is no error."""

    def enforce_retention(self, now: float) -> Mapping[Key, str]:
        """Delete sessions past the limits of age and size; return them with the reason. now: [s]."""

    def report(self) -> JournalReport:
        """Return the state of the journal; any thread may call it."""
