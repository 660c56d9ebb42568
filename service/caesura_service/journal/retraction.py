"""Moves what was refused from a session to one that is set aside, which no query by name finds any more."""

from __future__ import annotations

import sqlite3

from caesura_service.journal.journal import Key, Refused
from caesura_service.journal.rows import ROW_BYTES, SessionRow
from caesura_service.journal.sqlite_statements import (
    COUNT_MOVED,
    DELETE_RESULTS,
    INSERT_ASIDE,
    MOVE_RECORD,
    SELECT_EXTENT,
    SELECT_REFUSED,
)


def retract(database: sqlite3.Connection, key: Key, refused: Refused, why: str) -> str | None:
    """Move what was refused in a transaction of the caller; return the name of the session that has it now.

    None where another process has deleted the session. Its stored results are deleted: they may have it too.
    """
    found = database.execute(SELECT_EXTENT, key).fetchone()
    if found is None:
        return None
    session = SessionRow(*found[:-1])
    moved = database.execute(SELECT_REFUSED, {"id": session.id, **refused._asdict()}).fetchall()
    first = min((place for place, _ in moved), default=0)
    aside = database.execute(INSERT_ASIDE, (first, why, session.id)).lastrowid
    database.executemany(MOVE_RECORD, [(aside, place) for place, _ in moved])
    size, closed = sum(size + ROW_BYTES for _, size in moved), not refused.close
    for one, sign, is_closed in ((session.id, -1, closed), (aside, 1, True)):
        counts = {"id": one, "size": sign * size, "count": sign * len(moved), "closed": is_closed}
        database.execute(COUNT_MOVED, counts)
    for statement in DELETE_RESULTS:
        database.execute(statement, (session.id,))
    ((name,),) = database.execute("SELECT session FROM sessions WHERE id = ?", (aside,)).fetchall()
    return str(name)
