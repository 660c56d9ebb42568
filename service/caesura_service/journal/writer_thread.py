"""The thread that writes a journal: records are queued in memory, in order, and written together.

They are written at most `commit_s` after the first of them, or at once if a caller needs them on disk. A
killed process loses the queued records. A power failure loses no more, because every commit reaches the disk
(synchronous FULL).

If writing fails, the queued records are kept and retried. Until they are written every further append is
refused with the reason: a session that cannot be recorded must not continue.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_WHOLE_BYTES
from caesura_service.journal.bulk_insert import portions, write_rows
from caesura_service.journal.checksums import checksum
from caesura_service.journal.damaged_sessions import UnreadableResults
from caesura_service.journal.deletion import delete_batch
from caesura_service.journal.file_identity import JournalFileIdentity
from caesura_service.journal.journal import (
    EncodedBatch,
    JournalDamagedError,
    JournalError,
    JournalFullError,
    Key,
    Outcome,
    Record,
)
from caesura_service.journal.reserve import SIZE, Reserve
from caesura_service.journal.retention import JournalSettings
from caesura_service.journal.rows import (
    RecordRow,
    batch_row,
    row_of,
)
from caesura_service.journal.sqlite_database import free_bytes, touch, transaction
from caesura_service.journal.sqlite_errors import REMEDIES, again, map_sqlite_errors
from caesura_service.journal.sqlite_statements import (
    CLOSE,
    EPOCHS,
    INSERT_EPOCH,
    INSERT_OUTCOME,
    INSERT_OVERVIEW,
    TAKEOVERS,
)
from caesura_service.journal.station_quota import StationQuota

logger = logging.getLogger(__name__)

RETRY_S = 0.5  # after a commit that failed
PAUSE_S = 0.02  # between two portions of what is dropped, where a service may want to write
OUTCOMES = 64  # that wait to be written; with one more, the worker writes them itself
FREED = 256 << 10  # [bytes] of the file, on a full disk, that deletions have freed beside what is written
OVERVIEW_PART = 1 << 19  # [bytes] of an overview in one transaction, some milliseconds


class SqliteWriter:
    """The queue of records for the disk, and the thread that writes them."""

    _database: sqlite3.Connection

    def __init__(self, path: Path, settings: JournalSettings | None = None, *, alone: bool = True) -> None:
        self.path = path
        self.settings = settings or JournalSettings()
        self._alone = alone
        self._waiting: list[RecordRow] = []
        self._waiting_bytes = 0
        self._outcomes: dict[Key, Outcome] = {}  # of sessions that have ended, to be written
        self._guard = threading.Lock()  # of what waits; never held while the disk works
        self._writing = threading.RLock()  # of the database
        self._error: JournalError | None = None
        self._quota = StationQuota()
        self._unreadable = UnreadableResults()
        self._known: set[Key] = set()  # sessions, at the last look and since
        self._reserve = Reserve(path)
        self._files = JournalFileIdentity(path)
        self._makes_room = False  # do deletions go on, which on a full disk come before what waits?
        self._has_deleted = False  # has anything been dropped by this one?
        self._wake, self._stopped = threading.Event(), threading.Event()

    def append(self, record: Record, *, now: bool = False) -> None:
        """Append a record.

        Raises JournalError if earlier records could not be written; JournalShareError if the station's open
        sessions have used their share.
        """
        self._append_row(row_of(record), now=now)

    def append_batch(self, station: str, session: str, at: float, batch: EncodedBatch) -> None:
        """Append a batch as `append` does, without packing it again."""
        self._append_row(batch_row(station, session, at, batch))

    def commit(self) -> None:
        """Write the queued records, in portions that need little space. Raises JournalError."""
        with self._writing:
            with self._guard:
                rows = self._waiting[:]
            if not rows and self._error is None:
                return
            for portion in portions(rows):
                try:
                    self._files.check()
                    self._leave_room(sum(row.size for row in portion))
                    with map_sqlite_errors(self.path), transaction(self._database):
                        write_rows(self._database, portion)
                        if not portion:  # nothing waits: is the disk written again?
                            touch(self._database)
                except JournalError as error:
                    raise self._fail(error) from error.__cause__
                except Exception as error:
                    why = f"journal {self.path} cannot be written: {type(error).__name__}: {error}"
                    raise self._fail(JournalError(why)) from error
                self._forget(portion)
            self._succeed()

    def store_epoch(self, station: str, epoch: int) -> None:
        """Store the epoch of a station. Raises JournalError."""
        self._store_epoch(EPOCHS, station, epoch)

    def store_takeover(self, station: str, epoch: int) -> None:
        """Store the epoch of a completed takeover. Raises JournalError."""
        self._store_epoch(TAKEOVERS, station, epoch)

    def _store_epoch(self, table: str, station: str, epoch: int) -> None:
        with self._writing, map_sqlite_errors(self.path), transaction(self._database):
            self._database.execute(INSERT_EPOCH[table], (station, epoch, checksum(station, epoch)))

    def store_outcome(self, station: str, outcome: Outcome) -> None:
        """Queue an outcome, which the journal's thread writes: the results of an hour have megabytes.

        A session whose outcome is not written, as after a crash, is replayed from its records.
        """
        with self._guard:
            self._outcomes[station, outcome.opening.session] = outcome
            is_full = len(self._outcomes) > OUTCOMES
        if is_full:
            self.flush()
        self._wake.set()

    def flush(self) -> None:
        """Write the queued records, then the outcomes one by one, with further records in between.

        Raises JournalError. An outcome that the disk refuses is kept and retried, like a record; beyond
        OUTCOMES the oldest is dropped, and its session is replayed at the next start.
        """
        self.commit()
        while True:
            with self._guard:
                key, outcome = next(iter(self._outcomes.items()), (None, None))
            if key is None or outcome is None:
                return
            may_wait = 0
            try:
                self._write_outcome(key, outcome)
            except JournalDamagedError as damage:  # of what it replaces: the disk refuses it at every attempt
                logger.error("the outcome of %s is not kept, it will be replayed: %s", "/".join(key), damage)
            except JournalError:
                may_wait = OUTCOMES
                raise
            finally:
                self._forget_outcome(key, outcome, past=may_wait)

    def _forget_outcome(self, key: Key, outcome: Outcome, *, past: int) -> None:
        """Drop a queued outcome if no newer one replaced it and more than `past` are queued."""
        with self._guard:
            if self._outcomes.get(key) is outcome and len(self._outcomes) > past:
                del self._outcomes[key]

    def keep_overview(self, key: Key, session_id: int, content: bytes) -> None:
        """Write an overview of a session; records are written between its parts. Raises JournalError."""
        parts = [content[at : at + OVERVIEW_PART] for at in range(0, len(content), OVERVIEW_PART)]
        for part, payload in enumerate(parts):
            crc = checksum(session_id, part, len(parts), payload)
            row = (part, len(parts), payload, crc, session_id, *key)
            with self._writing:
                self._leave_room(len(payload))
                with map_sqlite_errors(self.path), transaction(self._database):
                    self._database.execute(INSERT_OVERVIEW, row)

    def _append_row(self, row: RecordRow, *, now: bool = False) -> None:
        with self._guard:
            self._quota.check(row, self.settings.size_bytes, self.path)
        if now or not self.settings.commit_s:
            self._append_now(row)
        else:
            self._append(row)
            if not self._wake.is_set():
                self._wake.set()

    def _append(self, row: RecordRow) -> None:
        size = row.size
        with self._guard:
            if self._error is not None:
                raise again(self._error)
            if self._waiting_bytes + size > self.settings.waiting_bytes:
                raise JournalError(
                    f"journal {self.path} is written too slowly, {self._waiting_bytes} bytes wait: "
                    "put it on a faster disk"
                )
            self._waiting.append(row)
            self._waiting_bytes += size
            self._quota.add(row)

    def _append_now(self, row: RecordRow) -> None:
        """Append a row and write it to disk; remove it again on an error."""
        with self._writing:
            self._append(row)
            try:
                self.commit()
            except JournalError:
                with self._guard:
                    if not any(row is waiting for waiting in self._waiting):
                        return  # it was written, and a later one was not
                    self._waiting = [waiting for waiting in self._waiting if waiting is not row]
                    self._waiting_bytes -= row.size
                    self._quota.remove(row)
                raise

    def _write_outcome(self, key: Key, outcome: Outcome) -> None:
        """Write an outcome; one that is too large is skipped, and its session replayed."""
        opening = encode(outcome.opening).payload
        try:
            snapshot = encode(outcome.snapshot, limit=MAX_WHOLE_BYTES).payload
        except ProtocolError as error:
            logger.warning("the outcome of %s is not kept, it will be replayed: %s", "/".join(key), error)
            return
        crc = checksum(*key, opening, outcome.last_seq, snapshot)
        with self._writing:
            self.commit()
            if self._outcomes.get(key) is not outcome:
                return  # dropped meanwhile, or corrected
            self._leave_room(len(snapshot))
            with map_sqlite_errors(self.path), transaction(self._database):
                self._database.execute(INSERT_OUTCOME, (opening, outcome.last_seq, snapshot, crc, *key))
        self._unreadable.remove(key)

    def _leave_room(self, size: int) -> None:
        """Raise JournalFullError if the rest of the disk is reserved for deletions, which have freed too
        little.

        size: [bytes] to be written. Rows in freed pages need space only in the log, which already has that
        length, so the space for further deletions stays. The free space of a disk may exceed a quota: during
        deletions only they use it.
        """
        for_deletions = self._makes_room and isinstance(self._error, JournalFullError)
        if not for_deletions and not self._reserve.is_spent():
            return
        with map_sqlite_errors(self.path):
            is_freed = free_bytes(self._database) >= 2 * size + FREED
        if not is_freed:
            why = f"the last {SIZE >> 20} MB are for deletions"
            raise JournalFullError(f"journal {self.path} {REMEDIES['SQLITE_FULL']} ({why})")

    def _fail(self, error: JournalError) -> JournalError:
        if self._error is None:
            logger.error("%s", error)
        self._error = error
        self._wake.set()
        return error

    def _forget(self, rows: Sequence[RecordRow]) -> None:
        """Remove the first rows from the queue: they are on disk."""
        size, keys = sum(row.size for row in rows), {row[:2] for row in rows}
        with self._guard:  # for which the worker waits
            del self._waiting[: len(rows)]
            self._waiting_bytes -= size
            self._known |= keys
            for row in rows:
                if row.encoding == CLOSE:
                    self._quota.close(row.key)

    def _succeed(self) -> None:
        with self._guard:
            if self._error is not None:
                logger.warning("journal %s is written again", self.path)
            self._error = None

    def _start_thread(self, stack: ExitStack) -> None:
        """Start the writing thread; the stack ends it, and then writes the queued records."""
        self._files.remember()
        stack.callback(self.flush)
        if not self._alone:
            stack.callback(self._delete_rest)
        thread = threading.Thread(target=self._run, name="caesura-journal", daemon=True)
        thread.start()
        stack.callback(thread.join)
        stack.callback(self._wake.set)
        stack.callback(self._stopped.set)

    def _run(self) -> None:
        """Write queued records in a loop; after an error at longer intervals.

        On a full disk deletions come first: otherwise the queued records would use the space that deletions
        need.
        """
        while not self._stopped.is_set():
            self._wake.wait()
            self._wake.clear()
            self._stopped.wait(self._pause_s())
            try:
                more = self._makes_room = self._delete_batch()
            except JournalError as error:  # another process is writing, or the disk is full
                more, self._makes_room = True, self._reserve.release(error)
                if not self._makes_room:
                    self._stopped.wait(RETRY_S)
            try:
                self.flush()
            except JournalError:  # said when it began, where records wait
                more = True
                self._stopped.wait(0.0 if self._error else RETRY_S)  # an outcome that was refused
            if more:
                self._wake.set()
            elif self._alone and self._error is None:
                self._reserve.keep()
        self._makes_room = False

    def _pause_s(self) -> float:
        if self._error is None:
            return self.settings.commit_s
        return PAUSE_S if self._makes_room else RETRY_S

    def _delete_batch(self) -> bool:
        """Continue deletions of this process or another; return whether records are left to delete."""
        with self._writing, map_sqlite_errors(self.path):
            return delete_batch(self._database)

    def _delete_rest(self) -> None:
        """Delete the remaining records if no service does, with pauses for other writers."""
        with suppress(JournalError):
            while self._has_deleted and self._delete_batch():
                threading.Event().wait(PAUSE_S)
