"""The schema of a journal file, and the functions that open it.

Each record is one row. A batch is identified by session, epoch and number, so writing it twice stores it
once. Payloads are the codec's bytes. `application_id` marks a journal among databases, `user_version` states
the version of its schema. Every row has a checksum of its values (`checksums.py`), and a session row has the
number of its records.
"""

from __future__ import annotations

import errno
import os
import sqlite3
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from functools import cache
from pathlib import Path
from urllib.parse import quote

from caesura_protocol.codec import encoding_of
from caesura_protocol.messages import Close, Describe, Edit, EditProgram
from caesura_protocol.number_words import counted
from caesura_service.journal.applied_edits import AppliedEdit
from caesura_service.journal.checksums import checksum
from caesura_service.journal.journal import (
    JournalBusyError,
    JournalDamagedError,
    JournalEmptyError,
    JournalError,
    JournalForeignError,
    JournalFullError,
    JournalMalformedError,
)
from caesura_service.journal.wal_integrity import files_beside

APPLICATION_ID = 0x43616573  # "Caes"
SCHEMA_VERSION = 8  # with version 8 an edit may take back any correction
LOCK_SUFFIX = ".lock"
CLOSE, EDIT, DESCRIBE = encoding_of(Close), encoding_of(AppliedEdit), encoding_of(Describe)
EDIT_PROGRAM = encoding_of(EditProgram)
LOG_KEPT = 16 << 20  # [bytes] of SQLite's log, which has no bound while a reader keeps it from ending
# Debian's SQLite writes zeros over what is deleted by default: that takes the room that it frees.
LEAVES_FREED = "secure_delete = FAST"
GUEST_BUSY_S = 30.0  # of such a process, for a service whose disk is slow
PROBE = 64 << 10  # [bytes] that a disk with room takes
BUSY_S = 2.0  # for another process that writes, such as `caesura sessions delete`

SCHEMA = """
CREATE TABLE sessions (
    id INTEGER PRIMARY KEY,
    station TEXT NOT NULL,
    session TEXT NOT NULL,
    opened REAL NOT NULL,               -- [s] time of day of the first record
    touched REAL NOT NULL,              -- [s] time of day of the last one
    closed INTEGER NOT NULL DEFAULT 0,  -- is there a close?
    size INTEGER NOT NULL DEFAULT 0,    -- [bytes] of its records
    UNIQUE (station, session)
);
CREATE TABLE records (
    place INTEGER PRIMARY KEY,          -- the order of appending
    session_id INTEGER NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    epoch INTEGER,                      -- of a batch
    seq INTEGER,
    at REAL NOT NULL,                   -- [s] the service's clock
    encoding TEXT NOT NULL,
    payload BLOB NOT NULL
);
CREATE INDEX of_session ON records (session_id);
CREATE TABLE outcomes (                 -- of closed sessions, in place of a replay
    session_id INTEGER PRIMARY KEY REFERENCES sessions (id) ON DELETE CASCADE,
    opening BLOB NOT NULL,
    last_seq INTEGER NOT NULL,
    snapshot BLOB NOT NULL
);
CREATE UNIQUE INDEX one_row_a_batch ON records (session_id, epoch, seq) WHERE seq IS NOT NULL;
"""
# What came with version 2, which is all that a journal of version 1 lacks.
SCHEMA_2 = """
CREATE TABLE IF NOT EXISTS stations (
    station TEXT PRIMARY KEY,
    epoch INTEGER NOT NULL              -- the last one under which this instance had it
)"""
# What came with version 3: records may be edits, which are few and have to be counted.
SCHEMA_3 = f"""
CREATE INDEX IF NOT EXISTS edits_of_session ON records (session_id) WHERE encoding = '{EDIT}'"""
# What came with version 5: records may be descriptions.
SCHEMA_5 = f"""
CREATE INDEX IF NOT EXISTS descriptions_of_session ON records (session_id) WHERE encoding = '{DESCRIBE}'"""
# What came with version 6: records may be edits of the program.
SCHEMA_6 = f"""
CREATE INDEX IF NOT EXISTS program_edits_of_session ON records (session_id)
WHERE encoding = '{EDIT_PROGRAM}'"""
# Without it an opening beside another instance costs more with each old session of its station. A reader of a
# journal without it goes through these: so it has no version.
SCHEMA_OPENED = "CREATE INDEX IF NOT EXISTS opened_of_station ON sessions (station, opened)"
# Stored sessions of one station, or of one name, are listed without the others. So it has no version.
SCHEMA_LISTED = """
CREATE INDEX IF NOT EXISTS sessions_of_station ON sessions (station);
CREATE INDEX IF NOT EXISTS sessions_of_name ON sessions (session)"""
# The last epoch under which this instance completed a takeover of a station: all that other instances had
# recorded of it was here. A journal without it is taken for one that completed each: so it has no version.
SCHEMA_TAKEOVERS = """
CREATE TABLE takeovers (station TEXT PRIMARY KEY, epoch INTEGER NOT NULL, crc INTEGER)"""
FILL_TAKEOVERS = "INSERT INTO takeovers SELECT station, epoch, crc FROM stations"
SELECT_NAMES = "SELECT name FROM sqlite_master"
# Overviews of closed sessions, for plots: a cache, made again where it is missing. So it has no version.
SCHEMA_OVERVIEWS = """
CREATE TABLE IF NOT EXISTS overviews (
    session_id INTEGER NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    part INTEGER NOT NULL,
    parts INTEGER NOT NULL,
    payload BLOB NOT NULL,
    crc INTEGER NOT NULL,
    PRIMARY KEY (session_id, part)
)"""
# What came with version 4, at the end of each row: rows of older journals are read without it (`SELECT *`).
COLUMNS_4 = (
    ("sessions", "record_count", "INTEGER"),  # none where some were written before version 4
    ("sessions", "damage", "TEXT"),  # why it is set aside, under a name that no session can have
    ("sessions", "crc", "INTEGER"),
    ("records", "crc", "INTEGER"),
    ("outcomes", "crc", "INTEGER"),
    ("stations", "crc", "INTEGER"),
)
COLUMN_COUNTS = {"sessions": 10, "records": 8, "outcomes": 5, "stations": 3}
HAS_COLUMN = "SELECT 1 FROM pragma_table_info(?) WHERE name = ?"

# A session of no station is one that is being dropped (`deletion.py`), which no query finds any more; one
# whose name has a dot is damaged and set aside.
KNOWN = "station != '' AND session NOT LIKE '%.%'"
SELECT_STATIONS = f"SELECT DISTINCT station FROM sessions WHERE {KNOWN}"
SELECT_SESSIONS = f"SELECT station, session FROM sessions WHERE {KNOWN} ORDER BY id"
SELECT_LAST_OPENED = f"""
SELECT opened FROM sessions WHERE {KNOWN} AND station = ? ORDER BY opened DESC LIMIT 1"""
SELECT_CLOSED = f"SELECT station, session FROM sessions WHERE {KNOWN} AND closed"
SELECT_ROWS = "SELECT * FROM sessions WHERE station != ''"
# What each station takes: summed up by SQLite, without the interpreter, because there may be many sessions.
SELECT_USAGE = """
SELECT station, sum(size), count(*), sum(closed != 0), min(touched)
FROM sessions WHERE station != '' GROUP BY station"""
SELECT_OPEN = "SELECT station, session, size FROM sessions WHERE station != '' AND NOT closed"
SELECT_OLD = """
SELECT station, session, touched FROM sessions
WHERE station != '' AND touched < ? ORDER BY closed = 0, touched LIMIT ?"""
# The first and the last time of each day on which a session was touched, the newest day first.
SELECT_DAYS = """
SELECT max(touched), min(touched) FROM sessions WHERE station != '' AND touched <= ?
GROUP BY CAST(touched / 86400 AS INTEGER) ORDER BY 1 DESC"""
SELECT_OLDEST_CLOSED = """
SELECT session, size FROM sessions WHERE station = ? AND closed ORDER BY touched LIMIT ?"""
SELECT_NEWEST = "SELECT coalesce(max(touched), 0) FROM sessions WHERE station != ''"
SELECT_KEYS = "SELECT station, session FROM sessions WHERE station != ''"
SELECT_LAST = "SELECT coalesce(max(place), 0) FROM records"
# `at` is that of the last place: a bare column beside the only max(). Without an index, which would be gone
# through from its beginning: what is new is found by its place.
UPDATE_SESSIONS = f"""
UPDATE sessions SET size = size + more, touched = last, closed = max(closed, closes > 0),
    record_count = record_count + additional,
    crc = checksum(
        id, station, session, opened, last, max(closed, closes > 0), size + more, record_count + additional
    )
FROM (
    SELECT session_id, max(place), at AS last, count(*) AS additional,
        sum(length(payload) + ?) AS more, sum(encoding = '{CLOSE}') AS closes
    FROM records NOT INDEXED WHERE place > ? GROUP BY session_id
)
WHERE id = session_id"""
SELECT_PAGE = """
SELECT * FROM records WHERE session_id = ? AND place > ? AND place <= ? ORDER BY place LIMIT ?"""
SELECT_EXTENT = """
SELECT *, (SELECT coalesce(max(place), -1) FROM records WHERE session_id = id) FROM sessions
WHERE station = ? AND session = ?"""
_SELECT_ALL = {
    kind: f"""
SELECT * FROM records WHERE encoding = '{encoding}' AND session_id = (
    SELECT id FROM sessions WHERE station = ?1 AND session = ?2
)"""
    for kind, encoding in ((Edit, EDIT), (EditProgram, EDIT_PROGRAM), (Describe, DESCRIBE))
}
SELECT_EDITS = f"{_SELECT_ALL[Edit]} ORDER BY place"
SELECT_EDIT_AT = {
    kind: f"{_SELECT_ALL[kind]} ORDER BY place LIMIT 1 OFFSET ?3" for kind in (Edit, EditProgram)
}
SELECT_CHANGES = f"{' UNION ALL '.join(_SELECT_ALL.values())} ORDER BY place"
SELECT_BEYOND = """
SELECT * FROM records
WHERE session_id = (SELECT id FROM sessions WHERE station = :station AND session = :session)
    AND place > :place AND (seq IS NULL OR seq >= :first_seq)
ORDER BY place LIMIT 200"""
INSERT_OUTCOME = """
INSERT OR REPLACE INTO outcomes (session_id, opening, last_seq, snapshot, crc)
SELECT id, ?, ?, ?, ? FROM sessions WHERE station = ? AND session = ?"""
SELECT_OUTCOME = """
SELECT outcomes.* FROM outcomes JOIN sessions ON id = session_id WHERE station = ? AND session = ?"""
OUTCOMES_PAGE = 100  # rows of `select_outcomes`


def select_outcomes(*columns: str) -> str:
    """Return the query for the next closed sessions with an outcome below an id, the newest first.

    columns: names of the key that are given. Each query reads no session that it does not return, except for
    those without an outcome.
    """
    given = "".join(f" AND {column} = :{column}" for column in columns)
    return f"""
SELECT id, station, session, size FROM sessions CROSS JOIN outcomes ON session_id = id
WHERE {KNOWN} AND closed AND id < :below{given} ORDER BY id DESC LIMIT {OUTCOMES_PAGE}"""


_SELECT_COPIES = f"""
SELECT
    coalesce((
        SELECT max(seq) FROM records WHERE session_id = known.id AND seq IS NOT NULL AND epoch = (
            SELECT max(epoch) FROM records WHERE session_id = known.id AND seq IS NOT NULL
        )
    ), -1),
    (SELECT count(*) FROM records WHERE session_id = known.id AND encoding = '{EDIT}'),
    {{described}},
    known.*
FROM sessions AS known WHERE {{which}} ORDER BY id"""
_COUNTS_OF = {  # by the index that a journal has which may have such records
    index: f"(SELECT count(*) FROM records WHERE session_id = known.id AND encoding = '{encoding}')"
    for index, encoding in (
        ("descriptions_of_session", DESCRIBE),
        ("program_edits_of_session", EDIT_PROGRAM),
    )
}
_WHICH = (
    KNOWN,
    f"{KNOWN} AND station = ?",
    "station = ? AND session = ?",
)
SELECT_REFUSED = f"""
SELECT * FROM (
    SELECT place, length(payload) FROM records WHERE session_id = :id AND encoding = '{EDIT}'
    ORDER BY place LIMIT -1 OFFSET :edits
) UNION ALL SELECT * FROM (
    SELECT place, length(payload) FROM records
    WHERE session_id = :id AND encoding IN ('{DESCRIBE}', '{EDIT_PROGRAM}')
    ORDER BY place LIMIT -1 OFFSET :described
) UNION ALL
SELECT place, length(payload) FROM records WHERE session_id = :id AND encoding = '{CLOSE}' AND :close"""
INSERT_ASIDE = """
INSERT INTO sessions (station, session, opened, touched, closed, size, record_count, damage)
SELECT station, session || '.refused-' || ?, opened, touched, 1, 0, 0, ? FROM sessions WHERE id = ?"""
MOVE_RECORD = "UPDATE records SET session_id = ? WHERE place = ?"
COUNT_MOVED = """
UPDATE sessions SET size = size + :size, record_count = record_count + :count, closed = closed AND :closed,
    crc = checksum(
        id, station, session, opened, touched, closed AND :closed, size + :size, record_count + :count
    )
WHERE id = :id"""
DELETE_RESULTS = [f"DELETE FROM {table} WHERE session_id = ?" for table in ("outcomes", "overviews")]
SET_ASIDE = """
UPDATE sessions SET session = session || '.damaged-' || id, damage = ?, closed = 1,
    crc = checksum(
        id, station, session || '.damaged-' || id, opened, touched, 1, size, record_count
    )
WHERE id = ? RETURNING session"""
KEEP_ASIDE = """
UPDATE sessions SET opened = :opened, touched = :touched, closed = 1, damage = :damage,
    crc = checksum(id, station, session, :opened, :touched, 1, size, record_count)
WHERE station = :station AND session = :session"""
INSERT_OVERVIEW = """
INSERT OR REPLACE INTO overviews (session_id, part, parts, payload, crc)
SELECT id, ?, ?, ?, ? FROM sessions WHERE id = ? AND station = ? AND session = ?"""
SELECT_OVERVIEW = "SELECT part, parts, payload, crc FROM overviews WHERE session_id = ? ORDER BY part"
HAS_TABLE = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?"
EPOCHS, TAKEOVERS = "stations", "takeovers"  # the tables with an epoch of each station
SELECT_EPOCH = {table: f"SELECT * FROM {table} WHERE station = ?" for table in (EPOCHS, TAKEOVERS)}
INSERT_EPOCH = {
    table: f"INSERT OR REPLACE INTO {table} (station, epoch, crc) VALUES (?, ?, ?)"
    for table in (EPOCHS, TAKEOVERS)
}


def select_copies(names: int, indexes: Collection[str]) -> str:
    """Return the query for all sessions, a station's, or one, by the number of given names of the key.

    indexes: those of the journal; an older version lacks the newer ones.

    Each query uses the index over both names, so its cost does not grow with the number of other sessions.
    """
    described = " + ".join(count for index, count in _COUNTS_OF.items() if index in indexes) or "0"
    return _SELECT_COPIES.format(which=_WHICH[names], described=described)


@cache
def insert_sessions(count: int) -> str:
    """Return the statement that inserts `count` rows at once: each statement waits for the interpreter
    lock.
    """
    return f"""
INSERT INTO sessions (station, session, opened, touched, record_count)
VALUES {", ".join(["(?, ?, ?, ?, 0)"] * count)}
ON CONFLICT (station, session) DO NOTHING"""


@cache
def insert_records(count: int) -> str:
    """Return the statement that inserts `count` rows at once."""
    row = "((SELECT id FROM sessions WHERE station = ? AND session = ?), ?, ?, ?, ?, ?, ?)"
    return f"""
INSERT INTO records (session_id, epoch, seq, at, encoding, payload, crc) VALUES {", ".join([row] * count)}
ON CONFLICT (session_id, epoch, seq) WHERE seq IS NOT NULL DO NOTHING"""


TOO_MANY_FILES = frozenset({errno.EMFILE, errno.ENFILE})
RAISE_LIMIT = "too many files are open: raise the limit (ulimit -n, LimitNOFILE), or end what has them open"
# What SQLite calls it, or a quota → what it means, and what to do.
REMEDIES: Mapping[str, str] = {
    "SQLITE_FULL": "cannot be written, there is no room left: free some, or name another --journal",
    "QUOTA_FULL": "cannot be written, this user's quota is used up: free some, or name another --journal",
    "SQLITE_READONLY": "cannot be written: let this user write it, or name another --journal",
    "SQLITE_CANTOPEN": "cannot be opened: let this user read and write it, or name another --journal",
    "SQLITE_PERM": "cannot be opened: let this user read and write it, or name another --journal",
    "SQLITE_BUSY": "is in use by another process: end that one, or name another --instance or --journal",
    "SQLITE_NOTADB": "is no journal: move it away, or name another --journal",
    "SQLITE_CORRUPT": "is damaged, or its disk fails: look after the disk and start the service again",
    "SQLITE_IOERR_SHMSIZE": "cannot be opened, there is no room left: free some, or name another --journal",
    "TOO_MANY_FILES": f"cannot be opened, {RAISE_LIMIT}",
    "SQLITE_IOERR": "cannot be read or written, the disk fails or is full: free some room, or look after it",
}
KINDS = {
    "SQLITE_FULL": JournalFullError,
    "QUOTA_FULL": JournalFullError,
    "SQLITE_IOERR_SHMSIZE": JournalFullError,
    "SQLITE_BUSY": JournalBusyError,
    "SQLITE_CORRUPT": JournalMalformedError,
    "SQLITE_NOTADB": JournalForeignError,
}


LACKS_OF_ROOM: Mapping[int, str] = {errno.ENOSPC: "SQLITE_FULL", errno.EDQUOT: "QUOTA_FULL"}
UNEXPLAINED = frozenset({"SQLITE_CANTOPEN", "SQLITE_READONLY", "SQLITE_IOERR"})


@contextmanager
def map_sqlite_errors(path: Path) -> Iterator[None]:
    """Raise SQLite's errors as a JournalError that names the file and the remedy."""
    try:
        yield
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:  # the last: a message about damage, damaged
        name = getattr(error, "sqlite_errorname", "")
        if name not in REMEDIES:
            name = "_".join(name.split("_")[:2])
        if not isinstance(error, sqlite3.Error):
            name = _name_of(error) if isinstance(error, OSError) else "SQLITE_CORRUPT"
        refusal = _refused_write(path) if name in UNEXPLAINED else 0
        if name == "SQLITE_IOERR":
            name = LACKS_OF_ROOM.get(refusal, name)
        remedy = (
            _remedy_of_disk(path, name, refusal)
            or _remedy_of_neighbour(path, name)
            or REMEDIES.get(name, "cannot be used")
        )
        kind = KINDS.get(name, JournalError)
        raise kind(f"journal {path} {remedy} ({error})") from error


def _name_of(error: OSError) -> str:
    """Return SQLite's name for an error of the operating system."""
    if error.errno in TOO_MANY_FILES:
        return "TOO_MANY_FILES"
    return "SQLITE_PERM" if isinstance(error, PermissionError) else "SQLITE_IOERR"


def _refused_write(path: Path) -> int:
    """Return the error number with which the disk refuses a further file, or 0.

    SQLite has no name for a full quota, and the system may list a disk as writable that it made read-only.
    """
    try:
        with tempfile.TemporaryFile(dir=path.parent, buffering=0) as probe:
            probe.write(bytes(PROBE))
            os.fsync(probe.fileno())
    except OSError as error:
        return error.errno or 0
    return 0


def _remedy_of_disk(path: Path, name: str, refusal: int) -> str | None:
    """Return the remedy from the disk's own error if SQLite only reports that it cannot open or write the
    file. refusal: as of `_refused_write`.
    """
    if name not in UNEXPLAINED:
        return None
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        if error.errno in TOO_MANY_FILES:
            return REMEDIES["TOO_MANY_FILES"]
    try:
        disk = os.statvfs(path.parent)
    except OSError:
        return None
    if refusal == errno.EROFS:
        return "cannot be written, its disk is read-only: mount it for writing, or name another --journal"
    if disk.f_files and not disk.f_favail:
        return "cannot be opened, its disk holds no further file: delete some, or name another --journal"
    return None


def _remedy_of_neighbour(path: Path, name: str) -> str | None:
    """Return a remedy that names a file beside the journal with another owner, such as root.

    None without one.
    """
    for beside in (*files_beside(path), _lock_of(path)) if name in UNEXPLAINED else ():
        with suppress(OSError):  # a disk that fails allows nothing, and is no matter of users
            if beside.stat().st_uid != os.geteuid() and not os.access(beside, os.R_OK | os.W_OK):
                found = "cannot be opened: let this user read and write"
                return f"{found} {beside.name}, or name another --journal"
    return None


def again(error: JournalError) -> JournalError:
    """Return a copy of an error to raise again: one object would keep every frame that it passed."""
    once_more = type(error)(*error.args)
    once_more.__cause__ = error.__cause__
    return once_more


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


def _lock_of(path: Path) -> Path:
    return path.with_name(path.name + LOCK_SUFFIX)


def acquire_lock(path: Path) -> sqlite3.Connection:
    """Acquire the lock of a journal, which ends with the process. Raises JournalError while it is held."""
    where = _lock_of(path)
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
    where = _lock_of(path)
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
