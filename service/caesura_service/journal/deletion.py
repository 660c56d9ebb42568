"""Deletion of sessions: hidden at once, their records deleted in portions.

An hour of a station is 180,000 records, and deleting them takes seconds. A commit waits for the current
write, and all stations wait for the commit. So a write deletes at most a portion.
"""

from __future__ import annotations

import sqlite3

from caesura_service.journal.journal import Key
from caesura_service.journal.sqlite_database import transaction

BATCH = 400  # records, some milliseconds
SESSIONS = 16  # of few records, in one portion: a station opens and closes hundreds a second

# Their station is empty, so that no query by name finds them; listings skip them.
MARK_DELETED = "UPDATE sessions SET station = '', session = id WHERE station = ? AND session = ?"
SELECT_DELETED = f"SELECT id FROM sessions WHERE station = '' LIMIT {SESSIONS}"
DELETE_SOME = "DELETE FROM records WHERE place IN (SELECT place FROM records WHERE session_id = ? LIMIT ?)"
DELETE_SESSION = "DELETE FROM sessions WHERE id = ?"


def mark_deleted(database: sqlite3.Connection, key: Key) -> None:
    """Hide a session from queries; an unknown session is no error."""
    database.execute(MARK_DELETED, key)


def delete_batch(database: sqlite3.Connection) -> bool:
    """Delete the next records of hidden sessions, in a transaction; return whether more may be left."""
    found = database.execute(SELECT_DELETED).fetchall()
    if not found:
        return False
    left = BATCH
    with transaction(database):
        for session in found:
            left -= database.execute(DELETE_SOME, (*session, left)).rowcount
            if not left:
                break
            database.execute(DELETE_SESSION, session)
    return True
