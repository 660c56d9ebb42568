"""Inserts rows of records, many at a time, and updates the sums in the table of sessions."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TypeVar

from caesura_service.journal.journal import Key
from caesura_service.journal.rows import ROW_BYTES, RecordRow
from caesura_service.journal.sqlite_statements import (
    SELECT_LAST,
    UPDATE_SESSIONS,
    insert_records,
    insert_sessions,
)

T = TypeVar("T")

_AT_ONCE = (64, 8, 1)  # rows that one statement writes: each size is one more statement to keep

COMMIT_PART = 1 << 20  # [bytes] of records in one transaction: as much room, and more, it needs on the disk


def portions(rows: Sequence[RecordRow]) -> Iterator[Sequence[RecordRow]]:
    """Split rows, in order, into portions of COMMIT_PART; yield at least one portion, empty without rows."""
    first, size = 0, 0
    for place, row in enumerate(rows):
        if size >= COMMIT_PART:
            yield rows[first:place]
            first, size = place, 0
        size += row.size
    yield rows[first:]


def write_rows(database: sqlite3.Connection, rows: Sequence[RecordRow]) -> None:
    """Insert rows in the caller's transaction; an existing row is skipped and counts once."""
    opened: dict[Key, float] = {}
    for row in rows:
        opened.setdefault(row[:2], row.at)
    for sessions in _chunks([(*key, at, at) for key, at in opened.items()]):
        database.execute(insert_sessions(len(sessions)), [*chain.from_iterable(sessions)])
    (before,) = database.execute(SELECT_LAST).fetchone()
    for some in _chunks(rows):
        database.execute(insert_records(len(some)), [*chain.from_iterable(some)])
    database.execute(UPDATE_SESSIONS, (ROW_BYTES, before))


def _chunks(rows: Sequence[T]) -> Iterator[Sequence[T]]:
    """Split rows into as few chunks as the prepared statements allow."""
    first = 0
    for size in _AT_ONCE:
        while len(rows) - first >= size:
            yield rows[first : first + size]
            first += size
