"""The schema of a journal file, and the statements that read and write it.

Each record is one row. A batch is identified by session, epoch and number, so writing it twice stores it
once. Payloads are the codec's bytes. Every row has a checksum of its values (`checksums.py`), and a session
row has the number of its records.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

from caesura_protocol.codec import encoding_of
from caesura_protocol.messages import Close, Describe, Edit, EditProgram
from caesura_service.journal.applied_edits import AppliedEdit

APPLICATION_ID = 0x43616573  # "Caes"
SCHEMA_VERSION = 8  # with version 8 an edit may take back any correction
CLOSE, EDIT, DESCRIBE = encoding_of(Close), encoding_of(AppliedEdit), encoding_of(Describe)
EDIT_PROGRAM = encoding_of(EditProgram)

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
SELECT_ASIDE = """
SELECT station, session, opened, damage FROM sessions
WHERE station != '' AND damage IS NOT NULL AND session LIKE '%.damaged-%'"""
SELECT_OPENED = "SELECT opened FROM sessions WHERE station = ? AND session = ?"
SELECT_HAS_OUTCOME = f"""
SELECT station, session, session_id IS NOT NULL FROM sessions LEFT JOIN outcomes ON session_id = id
WHERE {KNOWN} AND closed ORDER BY id DESC"""
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
