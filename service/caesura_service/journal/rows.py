"""Records and outcomes as rows of a journal's file, and back."""

from __future__ import annotations

import sqlite3
from typing import NamedTuple

from caesura_protocol.codec import decode, encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_WHOLE_BYTES,
    Close,
    Edit,
    Error,
    Open,
    SampleBatch,
    Snapshot,
)
from caesura_service.journal.journal import Copy, Outcome, Record, Recordable
from caesura_service.journal.schema import SELECT_COPIES, SELECT_EPOCH, SELECT_STATIONS

ROW_BYTES = 100  # of a record beside its payload
_RECORDABLE: tuple[type[Recordable], ...] = (Open, SampleBatch, Edit, Error, Close)


class Row(NamedTuple):
    """A record, ready to be written."""

    station: str
    session: str
    epoch: int | None
    seq: int | None
    at: float
    encoding: str
    payload: bytes

    @property
    def key(self) -> tuple[str, str]:
        """Station and session."""
        return self.station, self.session

    @property
    def size(self) -> int:
        """What it takes [bytes]."""
        return len(self.payload) + ROW_BYTES


def row_of(record: Record) -> Row:
    """A record as it is written. Raises ProtocolError where it is too large."""
    message = record.message
    epoch, seq = (message.epoch, message.seq) if isinstance(message, SampleBatch) else (None, None)
    payload, encoding = encode(message)
    return Row(record.station, record.session, epoch, seq, record.at, encoding, payload)


def record_of(station: str, session: str, at: float, encoding: str, payload: bytes) -> Record:
    """A row as it was appended. Raises ProtocolError where it cannot be read."""
    return Record(station, session, at, decode(payload, encoding, *_RECORDABLE))


def outcome_of(opening: bytes, last_seq: int, snapshot: bytes) -> Outcome | None:
    """A row as it was concluded; None where an older version wrote it in another form."""
    try:
        return Outcome(
            decode(opening, encoding_of(Open), Open),
            last_seq,
            decode(snapshot, encoding_of(Snapshot), Snapshot, limit=MAX_WHOLE_BYTES),
        )
    except ProtocolError:
        return None


def copies_in(database: sqlite3.Connection, station: str | None) -> tuple[Copy, ...]:
    """What a journal has of every session, or of those of one station, oldest first."""
    rows = database.execute(SELECT_COPIES, {"station": station})
    return tuple(
        Copy(name, session, opened, touched, bool(closed), last_seq, size, edits)
        for name, session, opened, touched, closed, last_seq, size, edits in rows
    )


def epoch_in(database: sqlite3.Connection, station: str) -> int:
    """The last epoch under which a journal's instance had a station; -1 without one."""
    (epoch,) = database.execute(SELECT_EPOCH, (station,)).fetchone()
    return int(epoch)


def stations_in(database: sqlite3.Connection) -> list[str]:
    """Those that a journal has a session of."""
    return [station for (station,) in database.execute(SELECT_STATIONS)]
