"""The functions that open a journal file, prepare it, and lock it.

`application_id` marks a journal among databases, `user_version` states the version of its schema.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from caesura_protocol.number_words import counted
from caesura_service.journal.checksums import checksum
from caesura_service.journal.journal import (
    JournalBusyError,
    JournalDamagedError,
    JournalEmptyError,
    JournalError,
    JournalForeignError,
)
from caesura_service.journal.sqlite_errors import REMEDIES, map_sqlite_errors
from caesura_service.journal.sqlite_statements import (
    APPLICATION_ID,
    COLUMN_COUNTS,
    COLUMNS_4,
    FILL_TAKEOVERS,
    HAS_COLUMN,
    HAS_TABLE,
    SCHEMA,
    SCHEMA_2,
    SCHEMA_3,
    SCHEMA_5,
    SCHEMA_6,
    SCHEMA_LISTED,
    SCHEMA_OPENED,
    SCHEMA_OVERVIEWS,
    SCHEMA_TAKEOVERS,
    SCHEMA_VERSION,
    TAKEOVERS,
)
from caesura_service.journal.wal_integrity import files_beside, lock_file_of

LOG_KEPT = 16 << 20  # [bytes] of SQLite's log, which has no bound while a reader keeps it from ending
# Debian's SQLite writes zeros over what is deleted by default: that takes the room that it frees.
LEAVES_FREED = "secure_delete = FAST"
GUEST_BUSY_S = 30.0  # of such a process, for a service whose disk is slow
BUSY_S = 2.0  # for another process that writes, such as `caesura sessions delete`


@contextmanager
def transaction(database: sqlite3.Connection) -> Iterator[None]:
    """Write everything in the context, or nothing."""
    database.execute("BEGIN IMMEDIATE")
    try:
        yield
        database.execute("COMMIT")
    finally:
        if database.in_transaction:
            database.execute("ROLLBACK")


def touch(database: sqlite3.Connection) -> None:
    """Write a page without changing it: an empty transaction would succeed on a full disk."""
    database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def free_bytes(database: sqlite3.Connection) -> int:
    """Return the size [bytes] of pages in the file that deletions have freed and that are unused since."""
    return _number(database, "freelist_count") * _number(database, "page_size")


def open_database(path: Path, busy_s: float = BUSY_S) -> sqlite3.Connection:
    """Open the database of a journal, or create it. Raises JournalError.

    busy_s: how long to wait for another process that writes.
    """
    try:
        _create_private(path)
    except OSError as error:
        raise JournalError(
            f"journal {path} cannot be made: {error.strerror}; name a --journal that this user can write"
        ) from error
    with map_sqlite_errors(path):
        database = sqlite3.connect(path, timeout=busy_s, isolation_level=None, check_same_thread=False)
        database.create_function("checksum", -1, checksum, deterministic=True)
        try:
            _prepare(database, path)
            _make_private(path)
        except BaseException:
            database.close()
            raise
    return database


def _create_private(path: Path) -> None:
    """Create a file with mode 0600 and its directory with 0700, whatever the umask. Raises OSError."""
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.parent.chmod(0o700)
    with suppress(FileExistsError):
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        path.chmod(0o600)


def _make_private(path: Path) -> None:
    """Set mode 0600 on a journal's files: older versions left it to the umask, and new logs inherit it."""
    for part in (path, *files_beside(path)):
        with suppress(FileNotFoundError, PermissionError):
            part.chmod(0o600)


def acquire_lock(path: Path) -> sqlite3.Connection:
    """Acquire the lock of a journal, which ends with the process. Raises JournalError while it is held."""
    where = lock_file_of(path)
    with suppress(OSError):
        _create_private(where)
    with map_sqlite_errors(path):
        lock = sqlite3.connect(where, timeout=0.0, isolation_level=None, check_same_thread=False)
    try:
        with map_sqlite_errors(path):
            lock.execute("PRAGMA journal_mode = MEMORY")  # a lock needs no room on a full disk
            lock.execute("BEGIN EXCLUSIVE")
    except JournalForeignError as error:  # the journal itself may be whole
        lock.close()
        raise JournalError(f"journal {path} cannot be locked, {where.name} is no lock: remove it") from error
    except JournalError:
        lock.close()
        raise
    return lock


def is_in_use(path: Path) -> bool:
    """Return whether a process holds the lock of a journal. Raises JournalError where that is unknown."""
    where = lock_file_of(path)
    if not where.exists():
        return False
    with map_sqlite_errors(path):
        lock = sqlite3.connect(f"file:{quote(str(where))}?mode=ro", uri=True, timeout=0.0)
    try:
        with map_sqlite_errors(path), closing(lock):
            lock.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except JournalBusyError:
        return True
    except JournalForeignError:  # no process can have locked this
        return False
    return False


def _prepare(database: sqlite3.Connection, path: Path) -> None:
    """Check the version of a file before anything is written to it."""
    if _is_empty(database):
        database.execute("PRAGMA journal_mode = WAL")
        with transaction(database):  # a peer sees all of it or nothing
            if _is_empty(database):
                _create(database)
                _complete(database, path)
    check(database, path)
    kept = f"journal_size_limit = {LOG_KEPT}"
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", kept, LEAVES_FREED):
        database.execute(f"PRAGMA {pragma}")
    with transaction(database):  # a process that cannot write fails here
        _complete(database, path)


def _complete(database: sqlite3.Connection, path: Path) -> None:
    """Add tables and columns that an older version lacks.

    Raises JournalDamagedError for columns of no version.
    """
    indices = (SCHEMA_OPENED, *SCHEMA_LISTED.split(";"))
    for schema in (SCHEMA_2, SCHEMA_3, SCHEMA_5, SCHEMA_6, SCHEMA_OVERVIEWS, *indices):
        database.execute(schema)
    for table, column, kind in COLUMNS_4:
        if not database.execute(HAS_COLUMN, (table, column)).fetchone():
            database.execute(f"ALTER TABLE {table} ADD COLUMN {column} {kind}")
    if not database.execute(HAS_TABLE, (TAKEOVERS,)).fetchone():
        database.execute(SCHEMA_TAKEOVERS)
        database.execute(FILL_TAKEOVERS)
    for table, count in COLUMN_COUNTS.items():
        (found,) = database.execute("SELECT count(*) FROM pragma_table_info(?)", (table,)).fetchone()
        if found != count:
            why = f"its table {table} has {counted(found, 'column')}, expected {count}"
            raise JournalDamagedError(f"journal {path} {REMEDIES['SQLITE_CORRUPT']} ({why})")
    touch(database)


def _is_empty(database: sqlite3.Connection) -> bool:
    (tables,) = database.execute("SELECT count(*) FROM sqlite_master").fetchone()
    return not tables and _number(database, "application_id") == 0


def _create(database: sqlite3.Connection) -> None:
    for statement in SCHEMA.split(";\n"):
        database.execute(statement)
    database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def check(database: sqlite3.Connection, path: Path) -> None:
    """Check that a file is a journal of a readable version. Raises JournalError."""
    if _is_empty(database):
        raise JournalEmptyError(f"journal {path} is empty: start the service that writes it")
    if _number(database, "application_id") != APPLICATION_ID:
        raise JournalForeignError(f"journal {path} is another program's database: name another --journal")
    version = _number(database, "user_version")
    if version > SCHEMA_VERSION:
        raise JournalForeignError(
            f"journal {path} was written by a newer caesura (journal version {version}, this one reads "
            f"{SCHEMA_VERSION}): update caesura, or name another --journal"
        )


def _number(database: sqlite3.Connection, pragma: str) -> int:
    (value,) = database.execute(f"PRAGMA {pragma}").fetchone()
    return int(value)
