"""Batches of a session as the journal has them, read beside the service's work.

Files are read on connections of their own, which write nothing and wait for no lock of the journal's. What is
written within the next `commit_s` is not yet there.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

import msgpack  # type: ignore[import-untyped]

from caesura_protocol.codec import decode, encoding_of
from caesura_protocol.messages import Error, Open, SampleBatch
from caesura_service.journal.journal import Journal, JournalDamagedError, JournalError, Key
from caesura_service.journal.rows import SessionRow, Stored, copies_in, verified
from caesura_service.journal.schema import SELECT_EXTENT, SELECT_PAGE
from caesura_service.journal.siblings import opened_for_reading

PAGE = 250  # records read at once
_BATCH, _ERROR = encoding_of(SampleBatch), encoding_of(Error)


class StoredBatch(NamedTuple):
    """A batch, not validated again."""

    place: int  # its record's, ascending in the order of recording
    seq: int
    n: int
    columns: tuple[str, ...]
    t0: float  # [s]
    samples: bytes


class Lost(NamedTuple):
    """Batches before number `seq` that have not been recorded never will be."""

    seq: int


class SessionExtent(NamedTuple):
    """Where the records of a session are, and how far they reach."""

    identity: tuple[object, ...]  # of this copy of the session, and of no other
    opening: Open
    last: int  # place of the last record


class BatchSource(Protocol):
    """Where batches are read; any thread may read."""

    def find(self, key: Key) -> SessionExtent | None:
        """The copy of a session that is furthest along; None without one. Raises JournalError."""

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[StoredBatch | Lost]]:
        """Its batches behind the place `beyond`, up to `last`. Raises JournalError or ProtocolError."""


class FileBatches:
    """Batches from every journal in a directory."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def find(self, key: Key) -> SessionExtent | None:
        """As BatchSource. A journal that cannot be read is passed over where another has the session."""
        found, failure = [], None
        for path in sorted(self._directory.glob("*.sqlite")):
            try:
                with opened_for_reading(path) as kept:
                    found += [(copy.progress, path) for copy in copies_in(kept, *key)]
            except JournalError as error:
                failure = error
        if found:
            return self._extent(max(found)[1], key)
        if failure is not None:
            raise failure
        return None

    def _extent(self, path: Path, key: Key) -> SessionExtent | None:
        with opened_for_reading(path) as kept:
            row = kept.execute(SELECT_EXTENT, key).fetchone()
            if row is None:
                return None
            session, last = SessionRow(*row[:-1]), row[-1]
            for first in kept.execute(SELECT_PAGE, (session.id, -1, last, 1)):
                stored = verified(key, Stored(*first))
                opening = decode(stored.payload, stored.encoding, Open)
                return SessionExtent((path, session.id, session.opened), opening, last)
        return None

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[StoredBatch | Lost]]:
        """As BatchSource."""
        path, session_id, _ = extent.identity
        assert isinstance(path, Path)
        with opened_for_reading(path) as kept:
            while rows := kept.execute(SELECT_PAGE, (session_id, beyond, last, PAGE)).fetchall():
                stored = [verified(key, Stored(*row)) for row in rows]
                yield [one for row in stored for one in _read(row.place, row.encoding, row.payload)]
                beyond = stored[-1].place


class JournalBatches:
    """Batches from the journal of this process, as one in memory."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def find(self, key: Key) -> SessionExtent | None:
        """As BatchSource."""
        records = list(self._journal.replay(*key))
        if not records or not isinstance(records[0].message, Open):
            return None
        return SessionExtent((records[0].at,), records[0].message, len(records) - 1)

    def pages(
        self, key: Key, extent: SessionExtent, beyond: int, last: int
    ) -> Iterator[list[StoredBatch | Lost]]:
        """As BatchSource."""
        del extent
        records = list(self._journal.replay(*key))[: last + 1]
        for first in range(beyond + 1, len(records), PAGE):
            page: list[StoredBatch | Lost] = []
            for place, record in enumerate(records[first : first + PAGE], first):
                match record.message:
                    case SampleBatch() as batch:
                        page.append(
                            StoredBatch(place, batch.seq, batch.n, batch.columns, batch.t0, batch.samples)
                        )
                    case Error(limit=int() as target) if record.message.code == "evicted":
                        page.append(Lost(target))
            yield page


def _read(place: int, encoding: str, payload: bytes) -> Iterator[StoredBatch | Lost]:
    """A record that is a batch or gives batches up. What was recorded has the codec's form."""
    if encoding == _BATCH:
        fields = msgpack.unpackb(payload, use_list=False)
        try:
            yield StoredBatch(place, *(fields[name] for name in StoredBatch._fields[1:]))
        except KeyError as error:
            raise JournalDamagedError(f"record {place} lacks the field {error} of a batch") from error
    elif encoding == _ERROR:
        lost = decode(payload, encoding, Error)
        if lost.code == "evicted" and isinstance(lost.limit, int):
            yield Lost(lost.limit)
