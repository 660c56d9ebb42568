"""Recovers a damaged journal: copies its undamaged sessions, each completely or not at all."""

from __future__ import annotations

import logging
import sqlite3
from contextlib import suppress
from pathlib import Path

from caesura_service.journal.bulk_insert import write_rows
from caesura_service.journal.checksums import checksum
from caesura_service.journal.journal import JournalDamagedError, JournalError
from caesura_service.journal.rows import SessionRow, epoch_in, pages_of, stations_in
from caesura_service.journal.sqlite_database import transaction
from caesura_service.journal.sqlite_errors import map_sqlite_errors
from caesura_service.journal.sqlite_statements import (
    EPOCHS,
    HAS_TABLE,
    INSERT_EPOCH,
    INSERT_OUTCOME,
    KEEP_ASIDE,
    SELECT_OUTCOME,
    SELECT_ROWS,
    TAKEOVERS,
)

logger = logging.getLogger(__name__)

MAX_PLACE = (1 << 63) - 1


def copy_intact_sessions(damaged: sqlite3.Connection, path: Path, database: sqlite3.Connection) -> None:
    """Copy the undamaged sessions of another database, and the epochs of its stations and takeovers.

    path: of the damaged file. Logs each session that is not copied. Raises JournalError if none can be read.
    """
    with map_sqlite_errors(path):
        takeovers = TAKEOVERS if damaged.execute(HAS_TABLE, (TAKEOVERS,)).fetchone() else EPOCHS
        for station in stations_in(damaged):
            for table, source in ((EPOCHS, EPOCHS), (TAKEOVERS, takeovers)):
                if (epoch := epoch_in(damaged, station, source)) >= 0:
                    with transaction(database):
                        database.execute(INSERT_EPOCH[table], (station, epoch, checksum(station, epoch)))
        rows = damaged.execute(SELECT_ROWS).fetchall()
    for row in rows:
        session = SessionRow(*row)
        try:
            with map_sqlite_errors(path), transaction(database):
                _copy(damaged, session, database)
        except JournalError as error:
            logger.error("%s is not kept: %s", "/".join(session.key), error)


def _copy(damaged: sqlite3.Connection, session: SessionRow, database: sqlite3.Connection) -> None:
    """Copy a session. Raises JournalDamagedError."""
    if session.record_count is None or not session.is_intact:
        raise JournalDamagedError("whether it is whole cannot be known")
    for page in pages_of(damaged, session, MAX_PLACE):
        write_rows(database, [row.copy_row(session.key) for row in page])
    if session.damage is not None:
        database.execute(KEEP_ASIDE, session._asdict())
    outcome = None
    with suppress(sqlite3.DatabaseError):  # without it the session is reported, and its samples are kept
        outcome = damaged.execute(SELECT_OUTCOME, session.key).fetchone()
    if outcome is not None:
        database.execute(INSERT_OUTCOME, (*outcome[1:], *session.key))
