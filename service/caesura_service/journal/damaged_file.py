"""Sets a damaged journal file aside, so that a service starts again without an operator.

Nothing is deleted. Sessions without a damaged record are copied into the new file. If only an index is
damaged, SQLite rebuilds it from the records. Other content can be recovered by `sqlite3 FILE .recover`.
Batches that the rings of the bridges still have are requested again, and the results have gaps for the rest.
"""

from __future__ import annotations

import logging
import re
import sqlite3
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from caesura_service.journal.wal_integrity import files_beside, log_of

logger = logging.getLogger(__name__)

NAMED = 20  # damages
OF_INDEX = re.compile(r"^(row \d+ missing from|wrong # of entries in|non-unique entry in) index \w+$")
CHUNK_BYTES = 1 << 20
CHECKED_BYTES = 1 << 30  # a larger file is not looked through at every start: that takes seconds a gigabyte


def integrity_error(database: sqlite3.Connection, path: Path) -> str | None:
    """Return the damage that SQLite finds in the pages of a file.

    None if it finds none, or the file is too large. Raises sqlite3.OperationalError or OSError if the file
    cannot be read now, which is not damage.
    """
    if path.stat().st_size > CHECKED_BYTES or _found_in(database) is None:
        return None
    read_through(path)
    return _found_in(database)  # once more: SQLite lists some pages that could not be read as damaged


def _found_in(database: sqlite3.Connection) -> str | None:
    try:
        found = [str(row) for (row,) in database.execute(f"PRAGMA integrity_check({NAMED})")]
    except sqlite3.OperationalError:
        raise
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        return str(error)
    return None if found == ["ok"] else " ".join("; ".join(found).split())


def read_through(path: Path) -> None:
    """Read a file and its log to their ends. Raises OSError if that fails; a missing file is no error."""
    for part in (path, log_of(path)):
        with suppress(FileNotFoundError), part.open("rb") as file:
            while file.read(CHUNK_BYTES):
                pass


def repair_indices(database: sqlite3.Connection, path: Path, damage: str) -> bool:
    """Rebuild damaged indices; return False if other content is damaged."""
    if not all(OF_INDEX.search(one) for one in damage.split("; ")):
        return False
    try:
        database.execute("REINDEX")
        (found,) = database.execute("PRAGMA integrity_check(1)").fetchone()
    except sqlite3.DatabaseError:
        return False
    logger.warning("indices of journal %s were damaged (%s) and are made again", path, damage)
    return bool(found == "ok")


def open_damaged(aside: Path) -> sqlite3.Connection:
    """Open a file that was moved aside, read-only."""
    has_log = log_of(aside).exists()
    how = "mode=ro" if has_log else "immutable=1"
    return sqlite3.connect(f"file:{quote(str(aside))}?{how}", uri=True, isolation_level=None)


def move_aside(path: Path) -> Path:
    """Rename the file and its log, which no process may have open; return the new path."""
    aside = path.with_name(f"{path.name}.damaged-{time.strftime('%Y%m%d-%H%M%S')}")
    for part, moved in zip((*files_beside(path), path), (*files_beside(aside), aside), strict=True):
        if part.exists():
            part.rename(moved)
    return aside
