"""A journal whose file is damaged is set aside, so that a service comes up again at night without its owner.

Nothing is deleted, and nothing is mended: what can be read of a damaged file is for `sqlite3 FILE .recover`.
The rings of the bridges give what they still have, and the results gaps for the rest.
"""

from __future__ import annotations

import sqlite3
import time
from pathlib import Path

CHECKED_BYTES = 1 << 30  # a larger file is not looked through at every start: that takes seconds a gigabyte


def damage_of(database: sqlite3.Connection, path: Path) -> str | None:
    """What SQLite finds wrong with the pages of a file; None where it is whole, or too large to look at."""
    if path.stat().st_size > CHECKED_BYTES:
        return None
    try:
        (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.DatabaseError as error:
        return str(error)
    return None if found == "ok" else " ".join(str(found).split())


def set_aside(path: Path) -> Path:
    """Give the file, and its log, another name; nobody may have it open."""
    aside = path.with_name(f"{path.name}.damaged-{time.strftime('%Y%m%d-%H%M%S')}")
    for suffix in ("-wal", "-shm", ""):
        part = path.with_name(path.name + suffix)
        if part.exists():
            part.rename(aside.with_name(aside.name + suffix))
    return aside
