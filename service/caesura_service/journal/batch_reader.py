"""Reads the batches of a session from the journal, concurrently with the service's work.

Files are read on separate connections, which write nothing and do not wait for the journal's lock. Records of
the last `commit_s` may not be on disk yet.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

import msgpack  # type: ignore[import-untyped]

from caesura_protocol.codec import decode, encoding_of
from caesura_protocol.messages import Error, Open, SampleBatch
from caesura_service.journal.checksums import is_intact
from caesura_service.journal.journal import Journal, JournalDamagedError, JournalError, Key
from caesura_service.journal.peer_journals import journals_in, open_for_reading
from caesura_service.journal.rows import SessionRow, Stored, copies_in, verify
from caesura_service.journal.sqlite_journal import SqliteJournal
from caesura_service.journal.sqlite_statements import HAS_TABLE, SELECT_EXTENT, SELECT_OVERVIEW, SELECT_PAGE
from caesura_service.journal.stored_texts import decode_stored

PAGE = 250  # records read at once
_BATCH, _ERROR = encoding_of(SampleBatch), encoding_of(Error)


class BatchRow(NamedTuple):
    """A recorded batch, which is not validated again."""

    place: int  # its record's, ascending in the order of recording
    seq: int
    n: int
    columns: tuple[str, ...]
    t0: float  # [s]
    samples: bytes


class Lost(NamedTuple):
    """A record that the missing batches before number `seq` will never be recorded."""

    seq: int


class SessionExtent(NamedTuple):
    """The identity of one copy of a session, its opening, and the place of its last record."""

    identity: tuple[object, ...]  # of this copy of the session, and of no other
    opening: Open
    last: int  # place of the last record


class BatchSource(Protocol):
    """A source of recorded batches; any thread may read."""

    def find(self, key: Key) -> SessionExtent | None:
        """Return the copy of a session that is furthest along; None without one. Raises JournalError."""

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[BatchRow | Lost]]:
        """Yield a copy's batches after place `beyond`, up to `last`. Raises JournalError or ProtocolError."""

    def overview(self, extent: SessionExtent) -> bytes | None:
        """Return the stored overview of a copy, complete and undamaged; None without one."""

    def keep_overview(self, key: Key, extent: SessionExtent, content: bytes) -> None:
        """Store the overview of a copy, if this source can. Raises JournalError."""


class FileBatches:
    """Batches from every journal in a directory. own: this instance's journal, which also stores
    overviews.
    """

    def __init__(self, directory: Path, own: SqliteJournal | None = None) -> None:
        self._directory, self._own = directory, own

    def find(self, key: Key) -> SessionExtent | None:
        """Return the copy in any journal that is furthest along.

        Without one, an unreadable journal raises JournalError.
        """
        found, failure = [], None
        for path in journals_in(self._directory):
            try:
                with open_for_reading(path) as kept:
                    found += [(copy.progress, path) for copy in copies_in(kept, *key)]
            except JournalError as error:
                failure = error
        if found:
            return self._extent(max(found)[1], key)
        if failure is not None:
            raise failure
        return None

    def _extent(self, path: Path, key: Key) -> SessionExtent | None:
        with open_for_reading(path) as kept:
            row = kept.execute(SELECT_EXTENT, key).fetchone()
            if row is None:
                return None
            session, last = SessionRow(*row[:-1]), row[-1]
            for first in kept.execute(SELECT_PAGE, (session.id, -1, last, 1)):
                stored = verify(key, Stored(*first))
                opening = decode_stored(stored.payload, stored.encoding, Open)
                return SessionExtent((path, session.id, session.opened), opening, last)
        return None

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[BatchRow | Lost]]:
        """Yield the copy's batches from the file that holds it, as `BatchSource.pages`."""
        path, session_id, _ = extent.identity
        assert isinstance(path, Path)
        with open_for_reading(path) as kept:
            while rows := kept.execute(SELECT_PAGE, (session_id, beyond, last, PAGE)).fetchall():
                stored = [verify(key, Stored(*row)) for row in rows]
                yield [one for row in stored for one in _read(row.place, row.encoding, row.payload)]
                beyond = stored[-1].place

    def overview(self, extent: SessionExtent) -> bytes | None:
        """Return the overview from the copy's file; None without one, or if a part is missing or damaged."""
        path, session_id, _ = extent.identity
        assert isinstance(path, Path)
        assert isinstance(session_id, int)
        with open_for_reading(path) as kept:
            if not kept.execute(HAS_TABLE, ("overviews",)).fetchone():
                return None
            rows = kept.execute(SELECT_OVERVIEW, (session_id,)).fetchall()
        payloads = [
            payload
            for number, (part, parts, payload, crc) in enumerate(rows)
            if (number, len(rows)) == (part, parts) and is_intact(crc, session_id, part, parts, payload)
        ]
        return b"".join(payloads) if payloads and len(payloads) == len(rows) else None

    def keep_overview(self, key: Key, extent: SessionExtent, content: bytes) -> None:
        """Store an overview in this instance's journal; one for a copy in another journal is dropped."""
        path, session_id, _ = extent.identity
        if self._own is not None and path == self._own.path and isinstance(session_id, int):
            self._own.keep_overview(key, session_id, content)


class JournalBatches:
    """Batches from a journal of this process, such as one in memory."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def find(self, key: Key) -> SessionExtent | None:
        """Return the extent of the session in this journal; None if it has no opening there."""
        records = list(self._journal.replay(*key))
        if not records or not isinstance(records[0].message, Open):
            return None
        return SessionExtent((records[0].at,), records[0].message, len(records) - 1)

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[BatchRow | Lost]]:
        """Yield the session's batches after the place `beyond`, up to `last`, PAGE records at a time."""
        del extent
        records = list(self._journal.replay(*key))[: last + 1]
        for first in range(beyond + 1, len(records), PAGE):
            page: list[BatchRow | Lost] = []
            for place, record in enumerate(records[first : first + PAGE], first):
                match record.message:
                    case SampleBatch() as batch:
                        page.append(
                            BatchRow(place, batch.seq, batch.n, batch.columns, batch.t0, batch.samples)
                        )
                    case Error(limit=int() as target) if record.message.code == "evicted":
                        page.append(Lost(target))
            yield page

    def overview(self, extent: SessionExtent) -> bytes | None:
        """Return None: a journal in memory needs no overview."""

    def keep_overview(self, key: Key, extent: SessionExtent, content: bytes) -> None:
        """Drop the overview: a journal in memory needs none."""


def _read(place: int, encoding: str, payload: bytes) -> Iterator[BatchRow | Lost]:
    """Yield the batch of a record, not validated again, or the loss that it records.

    Nothing for other records.
    """
    if encoding == _BATCH:
        fields = msgpack.unpackb(payload, use_list=False)
        try:
            yield BatchRow(place, *(fields[name] for name in BatchRow._fields[1:]))
        except KeyError as error:
            raise JournalDamagedError(f"record {place} lacks the field {error} of a batch") from error
    elif encoding == _ERROR:
        lost = decode(payload, encoding, Error)
        if lost.code == "evicted" and isinstance(lost.limit, int):
            yield Lost(lost.limit)
