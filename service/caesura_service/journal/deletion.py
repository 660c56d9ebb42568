"""Deletion of sessions: hidden at once, their records deleted in portions.

An hour of a station is 180,000 records, and deleting them takes seconds. A commit waits for a write,
and every station for the commit: so no write takes longer than a portion.
"""

from __future__ import annotations

import sqlite3

from caesura_service.journal.journal import Key
from caesura_service.journal.schema import transaction

PORTION = 400  # records, some milliseconds

# Their station is empty, so that no query by name finds them; listings skip them.
HIDE = "UPDATE sessions SET station = '', session = id WHERE station = ? AND session = ?"
NEXT = "SELECT id FROM sessions WHERE station = '' LIMIT 1"
DELETE_SOME = "DELETE FROM records WHERE place IN (SELECT place FROM records WHERE session_id = ? LIMIT ?)"
DELETE_SESSION = "DELETE FROM sessions WHERE id = ?"


def hide(database: sqlite3.Connection, key: Key) -> None:
    """Hide a session from queries; an unknown one is no error."""
    database.execute(HIDE, key)


def drop_some(database: sqlite3.Connection) -> bool:
    """Delete the next records of what is hidden, in a transaction. May there be more of that?"""
    found = database.execute(NEXT).fetchone()
    if found is None:
        return False
    with transaction(database):
        if database.execute(DELETE_SOME, (*found, PORTION)).rowcount < PORTION:
            database.execute(DELETE_SESSION, found)
    return True
