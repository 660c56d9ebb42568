"""A journal on disk: SQLite in WAL mode, one file an instance, many records a commit.

Records wait in memory, in order, and are written together: at most `commit_s` after the first of them,
by a thread of the journal's own, or at once where somebody must know them safe. A killed process loses
what waited; a killed machine no more, for every commit reaches the disk (synchronous FULL).

When writing fails, what waits is kept and tried again, and until it is written every further append is
refused with the reason: a session that is not journalled does not go on.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from caesura_protocol.codec import decode, encode
from caesura_protocol.messages import Close, Error, Open, SampleBatch
from caesura_service.journal.journal import JournalError, Key, Record, Recordable
from caesura_service.journal.schema import opened, transaction, translated

logger = logging.getLogger(__name__)

RETRY_S = 0.5  # after a commit that failed
_PAGE = 500  # records read at once
_ROW_BYTES = 100  # of a record beside its payload
_LOCK_SUFFIX = ".lock"
_RECORDABLE: tuple[type[Recordable], ...] = (Open, SampleBatch, Error, Close)

_INSERT_SESSION = """
INSERT INTO sessions (station, session, opened, touched) VALUES (?, ?, ?, ?)
ON CONFLICT (station, session) DO NOTHING"""
_INSERT_RECORD = """
INSERT INTO records (session_id, epoch, seq, at, encoding, payload)
VALUES ((SELECT id FROM sessions WHERE station = ? AND session = ?), ?, ?, ?, ?, ?)
ON CONFLICT (session_id, epoch, seq) WHERE seq IS NOT NULL DO NOTHING"""
_UPDATE_SESSION = """
UPDATE sessions SET size = size + ?, touched = ?, closed = max(closed, ?) WHERE station = ? AND session = ?"""
_SELECT_PAGE = """
SELECT place, at, encoding, payload FROM records
WHERE session_id = ? AND place > ? AND place <= ? ORDER BY place LIMIT ?"""


@dataclass(frozen=True)
class JournalSettings:
    """How long a record may wait to be written, and how many bytes may."""

    commit_s: float = 0.05  # 0: each is written at once
    waiting_bytes: int = 1 << 26  # past that, appends are refused


class _Row(NamedTuple):
    station: str
    session: str
    epoch: int | None
    seq: int | None
    at: float
    encoding: str
    payload: bytes
    closing: bool

    @property
    def size(self) -> int:
        return len(self.payload) + _ROW_BYTES


class SqliteJournal:
    """The journal in one file. Use it as a context manager, or close it.

    Raises JournalError where the file is no journal, a newer one, or cannot be written; and, when `alone`,
    where another process has it. Not alone it is for looking into the journal of a service that runs.
    """

    def __init__(self, path: Path, settings: JournalSettings | None = None, *, alone: bool = True) -> None:
        self.path = path
        self.settings = settings or JournalSettings()
        self._database = opened(path)
        try:
            self._lock = _locked(path) if alone else None
        except BaseException:
            self._database.close()
            raise
        self._waiting: list[_Row] = []
        self._waiting_bytes = 0
        self._guard = threading.Lock()  # of what waits; never held while the disk works
        self._writing = threading.RLock()  # of the database
        self._trouble: JournalError | None = None
        self._wake, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="caesura-journal", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Write what waits, and let go of the file. Raises JournalError where it could not be written."""
        self._end()
        try:
            self.commit()
        finally:
            self._let_go()

    def append(self, record: Record, *, now: bool = False) -> None:
        """Keep a record. Raises JournalError where what came before it could not be written."""
        row = _row_of(record)
        if now or not self.settings.commit_s:
            self._append_now(row)
        else:
            self._append(row)
            self._wake.set()

    def commit(self) -> None:
        """Write what waits."""
        with self._writing:
            with self._guard:
                rows = self._waiting[:]
            if not rows and self._trouble is None:
                return
            try:
                with translated(self.path), transaction(self._database):
                    self._write(rows)
            except JournalError as error:
                self._fail(error)
                raise
            self._succeed(rows)

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """The records of a session as they are now. Raises JournalError, perhaps on the way."""
        self.commit()
        with self._writing, translated(self.path):
            found = self._database.execute(
                "SELECT id, (SELECT max(place) FROM records WHERE session_id = id) FROM sessions"
                " WHERE station = ? AND session = ?",
                (station, session),
            ).fetchone()
        return iter(()) if found is None else self._pages(station, session, *found)

    def sessions(self) -> tuple[Key, ...]:
        """(station, session) of every session, oldest first."""
        self.commit()
        with self._writing, translated(self.path):
            return tuple(self._database.execute("SELECT station, session FROM sessions ORDER BY id"))

    def forget(self, station: str, session: str) -> None:
        """Drop the records of a session."""
        self.commit()
        with self._writing, translated(self.path), transaction(self._database):
            self._database.execute(
                "DELETE FROM sessions WHERE station = ? AND session = ?", (station, session)
            )

    # --- writing ----------------------------------------------------------------------------------------

    def _append(self, row: _Row) -> None:
        with self._guard:
            if self._trouble is not None:
                raise self._trouble
            if self._waiting_bytes + row.size > self.settings.waiting_bytes:
                raise JournalError(
                    f"journal {self.path} is written too slowly, {self._waiting_bytes} bytes wait: "
                    "put it on a faster disk"
                )
            self._waiting.append(row)
            self._waiting_bytes += row.size

    def _append_now(self, row: _Row) -> None:
        """Either it is safe, or it is not kept: nobody else writes until that is known."""
        with self._writing:
            self._append(row)
            try:
                self.commit()
            except JournalError:
                with self._guard:
                    self._waiting.pop()
                    self._waiting_bytes -= row.size
                raise

    def _write(self, rows: Iterable[_Row]) -> None:
        execute = self._database.execute
        known: set[Key] = set()
        for row in rows:
            key = (row.station, row.session)
            if key not in known:
                execute(_INSERT_SESSION, (*key, row.at, row.at))
                known.add(key)
            written = execute(_INSERT_RECORD, row[:-1]).rowcount
            execute(_UPDATE_SESSION, (written * row.size, row.at, row.closing, *key))

    def _fail(self, error: JournalError) -> None:
        if self._trouble is None:
            logger.error("%s", error)
        self._trouble = error
        self._wake.set()

    def _succeed(self, rows: list[_Row]) -> None:
        with self._guard:
            del self._waiting[: len(rows)]
            self._waiting_bytes -= sum(row.size for row in rows)
            if self._trouble is not None:
                logger.warning("journal %s is written again", self.path)
            self._trouble = None

    def _run(self) -> None:
        """Write what waits, again and again; after an error less often."""
        while not self._over.is_set():
            self._wake.wait()
            self._wake.clear()
            self._over.wait(self.settings.commit_s if self._trouble is None else RETRY_S)
            try:
                self.commit()
            except JournalError:
                continue  # said when it began; it has woken this thread for another attempt

    def _end(self) -> None:
        self._over.set()
        self._wake.set()
        self._thread.join()

    def _let_go(self) -> None:
        for database in (self._database, self._lock):
            if database is not None:
                database.close()

    # --- reading ----------------------------------------------------------------------------------------

    def _pages(self, station: str, session: str, session_id: int, last: int) -> Iterator[Record]:
        place = -1
        while True:
            with self._writing, translated(self.path):
                page = self._database.execute(_SELECT_PAGE, (session_id, place, last, _PAGE)).fetchall()
            if not page:
                return
            for _, at, encoding, payload in page:
                yield Record(station, session, at, decode(payload, encoding, *_RECORDABLE))
            place = page[-1][0]


def _row_of(record: Record) -> _Row:
    message = record.message
    epoch, seq = (message.epoch, message.seq) if isinstance(message, SampleBatch) else (None, None)
    payload, encoding = encode(message)
    closing = isinstance(message, Close)
    return _Row(record.station, record.session, epoch, seq, record.at, encoding, payload, closing)


def _locked(path: Path) -> sqlite3.Connection:
    """A lock that ends with the process, however it ends. Raises JournalError while another has it."""
    lock = sqlite3.connect(
        path.with_name(path.name + _LOCK_SUFFIX), timeout=0.0, isolation_level=None, check_same_thread=False
    )
    try:
        with translated(path):
            lock.execute("BEGIN EXCLUSIVE")
    except JournalError:
        lock.close()
        raise
    return lock
