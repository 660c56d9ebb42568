"""Records and outcomes as rows of a journal file; reading reports a damaged row by name."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from caesura_protocol.codec import encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_WHOLE_BYTES,
    Close,
    Describe,
    Error,
    Open,
    SampleBatch,
    Snapshot,
)
from caesura_protocol.number_words import counted
from caesura_service.journal.applied_edits import AppliedEdit, AppliedProgramEdit
from caesura_service.journal.checksums import checksum, is_intact
from caesura_service.journal.journal import (
    Copy,
    EncodedBatch,
    JournalDamagedError,
    Key,
    Outcome,
    Record,
    Recordable,
)
from caesura_service.journal.sqlite_statements import (
    EPOCHS,
    SELECT_EPOCH,
    SELECT_LAST_OPENED,
    SELECT_NAMES,
    SELECT_PAGE,
    SELECT_STATIONS,
    TAKEOVERS,
    select_copies,
)
from caesura_service.journal.stored_texts import decode_stored

logger = logging.getLogger(__name__)

PAGE = 500  # records read at once
ROW_BYTES = 100  # of a record beside its payload
UNREADABLE_OUTCOME = (
    "the outcome of %s cannot be read, %s: a session that the service holds is rebuilt from its records; of "
    "an older one, `caesura sessions export` writes the samples"
)
_RECORDABLE: tuple[type[Recordable], ...] = (
    Open,
    SampleBatch,
    AppliedEdit,
    Describe,
    AppliedProgramEdit,
    Error,
    Close,
)


class RecordRow(NamedTuple):
    """A record in the form of a database row."""

    station: str
    session: str
    epoch: int | None
    seq: int | None
    at: float
    encoding: str
    payload: bytes
    crc: int

    @property
    def key(self) -> tuple[str, str]:
        """The key (station, session)."""
        return self.station, self.session

    @property
    def size(self) -> int:
        """The size with overhead [bytes]."""
        return len(self.payload) + ROW_BYTES


def row_of(record: Record) -> RecordRow:
    """Encode a record as a row. Raises ProtocolError if it is too large."""
    message = record.message
    epoch, seq = (message.epoch, message.seq) if isinstance(message, SampleBatch) else (None, None)
    payload, encoding = encode(message)
    crc = checksum(epoch, seq, record.at, encoding, payload)
    return RecordRow(record.station, record.session, epoch, seq, record.at, encoding, payload, crc)


def batch_row(station: str, session: str, at: float, batch: EncodedBatch) -> RecordRow:
    """Return the row of a batch, equal to that of `row_of`."""
    encoding = encoding_of(SampleBatch)
    crc = checksum(batch.epoch, batch.seq, at, encoding, batch.payload)
    return RecordRow(station, session, batch.epoch, batch.seq, at, encoding, batch.payload, crc)


class Stored(NamedTuple):
    """A row of the table of records."""

    place: int
    session_id: int
    epoch: int | None
    seq: int | None
    at: float
    encoding: str
    payload: bytes
    crc: int | None = None

    def copy_row(self, key: Key) -> RecordRow:
        """Return the row for another file, with a new checksum."""
        crc = checksum(self.epoch, self.seq, self.at, self.encoding, self.payload)
        return RecordRow(*key, self.epoch, self.seq, self.at, self.encoding, self.payload, crc)


def verify(key: Key, row: Stored) -> Stored:
    """Return the row after a check of its checksum. Raises JournalDamagedError."""
    if not is_intact(row.crc, *row[2:-1]):
        raise JournalDamagedError(
            f"record {row.place} of {'/'.join(key)} is damaged: its checksum is not {row.crc}"
        )
    return row


def record_of(key: Key, row: Stored) -> Record:
    """Decode a row. Raises ProtocolError if it cannot be read."""
    return Record(*key, row.at, decode_stored(row.payload, row.encoding, *_RECORDABLE))


def edits_of(key: Key, rows: Iterable[tuple[Any, ...]]) -> tuple[AppliedEdit, ...]:
    """Decode the edits among rows. Raises JournalDamagedError, or ProtocolError where one is unreadable."""
    return tuple(message for message in changes_of(key, rows) if isinstance(message, AppliedEdit))


def changes_of(key: Key, rows: Iterable[tuple[Any, ...]]) -> tuple[Recordable, ...]:
    """Decode rows of changes. Raises as `edits_of`."""
    return tuple(record_of(key, verify(key, Stored(*row))).message for row in rows)


class SessionRow(NamedTuple):
    """A row of the table of sessions."""

    id: int
    station: str
    session: str
    opened: float
    touched: float
    closed: int
    size: int
    record_count: int | None = None
    damage: str | None = None
    crc: int | None = None

    @property
    def key(self) -> Key:
        """The key (station, session)."""
        return self.station, self.session

    @property
    def is_intact(self) -> bool:
        """Whether the row matches its checksum, or has none."""
        return is_intact(self.crc, *self[:8])


def pages_of(database: sqlite3.Connection, session: SessionRow, last: int) -> Iterator[list[Stored]]:
    """Yield a session's rows up to the place `last`, a page at a time.

    Raises JournalDamagedError at a damaged row, and at the end if rows are missing.
    """
    place, count = -1, 0
    while rows := database.execute(SELECT_PAGE, (session.id, place, last, PAGE)).fetchall():
        page = [verify(session.key, Stored(*row)) for row in rows]
        if any(row.session_id != session.id for row in page):
            raise JournalDamagedError(f"a record of {'/'.join(session.key)} is under another session")
        yield page
        place, count = page[-1].place, count + len(page)
    if session.record_count not in {None, count}:
        raise JournalDamagedError(
            f"{'/'.join(session.key)} has {counted(count, 'record')}, expected {session.record_count}"
        )


def outcome_of(key: Key, row: Sequence[Any]) -> Outcome:
    """Decode a row of the table of outcomes. Raises JournalDamagedError where it cannot be read."""
    _, opening, last_seq, snapshot = verified_outcome(key, row)[:4]
    try:
        return Outcome(
            decode_stored(opening, encoding_of(Open), Open),
            last_seq,
            decode_stored(snapshot, encoding_of(Snapshot), Snapshot, limit=MAX_WHOLE_BYTES),
        )
    except ProtocolError as error:
        raise JournalDamagedError("its results are in the format of another version") from error


def verified_outcome(key: Key, row: Sequence[Any]) -> Sequence[Any]:
    """Return a row of the table of outcomes after a check of its checksum. Raises JournalDamagedError."""
    if not is_intact((*row[4:], None)[0], *key, *row[1:4]):
        raise JournalDamagedError("its results are damaged")
    return row


def copies_in(database: sqlite3.Connection, *key: str | None) -> tuple[Copy, ...]:
    """Return the extent of every session, of a station's, or of one; oldest first."""
    given = [name for name in key if name is not None]
    names = {name for (name,) in database.execute(SELECT_NAMES)}
    rows = database.execute(select_copies(len(given), names), given)
    table = TAKEOVERS if TAKEOVERS in names else EPOCHS
    owner_epochs: dict[str, int] = {}  # by station
    copies = []
    for last_seq, edits, described, *values in rows:
        row = SessionRow(*values)
        if row.station not in owner_epochs:
            owner_epochs[row.station] = epoch_in(database, row.station, table) if table in names else -1
        if row.is_intact:
            extent = bool(row.closed), last_seq, row.size, edits, described
            copies.append(Copy(*row[1:5], *extent, owner_epochs[row.station]))
    return tuple(copies)


def epoch_in(database: sqlite3.Connection, station: str, table: str = EPOCHS) -> int:
    """Return the last epoch of a station in a journal, or of its last completed takeover; -1 without one."""
    row = database.execute(SELECT_EPOCH[table], (station,)).fetchone()
    if row is None:
        return -1
    epoch, crc = (*row[1:], None)[:2]
    if not is_intact(crc, station, epoch):
        logger.warning("the epoch of station %s is damaged: the next one is taken from the clock", station)
        return -1
    return int(epoch)


def last_opened_in(database: sqlite3.Connection, station: str) -> float | None:
    """Return the time [s] at which the last session of a station was opened, by a journal.

    None without one.
    """
    row = database.execute(SELECT_LAST_OPENED, (station,)).fetchone()
    return None if row is None else float(row[0])


def stations_in(database: sqlite3.Connection) -> list[str]:
    """Return the stations with a session in a journal."""
    return [station for (station,) in database.execute(SELECT_STATIONS)]
