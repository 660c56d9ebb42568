"""A journal on disk: SQLite in WAL mode, one file an instance, many records a commit.

Records wait in memory, in order, and are written together: at most `commit_s` after the first of them,
by a thread of the journal's own, or at once where a caller needs them on disk. A killed process loses
what waited; a killed machine no more, for every commit reaches the disk (synchronous FULL).

When writing fails, what waits is kept and tried again, and until it is written every further append is
refused with the reason: a session that is not journalled does not go on.

Closed sessions stay until they are too old or too much, oldest first. Open ones are never dropped for
their size, and for their age only once they were not written to for so long.
"""

from __future__ import annotations

import logging
import shutil
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, closing, suppress
from itertools import accumulate
from pathlib import Path
from types import TracebackType
from typing import Self

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_WHOLE_BYTES, JournalReport
from caesura_service.journal.checksums import checksum
from caesura_service.journal.deletion import delete_batch, mark_deleted
from caesura_service.journal.edits import AppliedEdit
from caesura_service.journal.integrity import integrity_error, move_aside, open_damaged, repair_indices
from caesura_service.journal.journal import (
    Copy,
    EncodedBatch,
    JournalError,
    JournalFullError,
    Key,
    Outcome,
    Record,
    StoredOutcome,
)
from caesura_service.journal.peer_journals import open_for_reading
from caesura_service.journal.reserve import SIZE, Reserve
from caesura_service.journal.retention import DAY_S, GB, JournalSettings, StationUsage, excess
from caesura_service.journal.row_writer import portions, write_rows
from caesura_service.journal.rows import (
    RecordRow,
    SessionRow,
    batch_row,
    copies_in,
    edits_of,
    epoch_in,
    outcome_of,
    pages_of,
    record_of,
    row_of,
)
from caesura_service.journal.salvage import copy_intact_sessions
from caesura_service.journal.schema import (
    BUSY_S,
    GUEST_BUSY_S,
    INSERT_EPOCH,
    INSERT_OUTCOME,
    INSERT_OVERVIEW,
    REMEDIES,
    SELECT_CLOSED,
    SELECT_EDITS,
    SELECT_EXTENT,
    SELECT_KEYS,
    SELECT_OLD,
    SELECT_OLDEST_CLOSED,
    SELECT_OUTCOME,
    SELECT_OUTCOMES,
    SELECT_ROWS,
    SELECT_SESSIONS,
    SELECT_USAGE,
    SET_ASIDE,
    acquire_lock,
    again,
    free_bytes,
    map_sqlite_errors,
    open_database,
    touch,
    transaction,
)
from caesura_service.journal.wal import log_integrity_error

logger = logging.getLogger(__name__)

RETRY_S = 0.5  # after a commit that failed
PATIENCE = 10  # times that tidying may be put off
DROPS = 32  # sessions at one look
LONG_LOOK_S, LOOKS_SHARE = 0.02, 0.02  # a look that takes longer [s] is followed by a pause: its share
PAUSE_S = 0.02  # between two portions of what is dropped, where a service may want to write
OUTCOMES = 64  # that wait to be written; with one more, the worker writes them itself
FREED = 256 << 10  # [bytes] of the file, on a full disk, that deletions have freed beside what is written
OVERVIEW_PART = 1 << 19  # [bytes] of an overview in one transaction, some milliseconds


class SqliteJournal:
    """The journal in one file, while the context lasts.

    Raises JournalError on entry where the file is no journal, a newer one, or cannot be written; and, when
    `alone`, where another process has it. Not alone it is for looking into that of a service that runs.
    """

    def __init__(self, path: Path, settings: JournalSettings | None = None, *, alone: bool = True) -> None:
        self.path = path
        self.settings = settings or JournalSettings()
        self._alone = alone
        self._waiting: list[RecordRow] = []
        self._waiting_bytes = 0
        self._outcomes: dict[Key, Outcome] = {}  # of sessions that have ended, to be written
        self._guard = threading.Lock()  # of what waits; never held while the disk works
        self._writing = threading.RLock()  # of the database
        self._reading = threading.Lock()  # of the connection that only reads; it waits for no write
        self._error: JournalError | None = None
        self._size = 0  # [bytes] as of the last look
        self._open_bytes: Counter[str] = (
            Counter()
        )  # [bytes] of each station's open sessions, since the last look
        self._known: set[Key] = set()  # sessions, at the last look and since
        self._version = -1  # of the file, as far as other processes have changed it
        self._next_look_s = 0.0  # [s]
        self._skipped_looks = 0  # looks, since the last one
        self._reserve = Reserve(path)
        self._makes_room = False  # do deletions go on, which on a full disk come before what waits?
        self._has_deleted = False  # has anything been dropped by this one?
        self._wake, self._stopped = threading.Event(), threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            with map_sqlite_errors(self.path):
                log_damage = log_integrity_error(self.path) if self._alone else None
            self._database = stack.enter_context(closing(self._open()))
            if self._alone:
                stack.enter_context(closing(acquire_lock(self.path)))
                if log_damage:
                    why = "what was written after that is not known here, bridges send what they still have"
                    logger.error("journal %s: %s; %s", self.path, log_damage, why)
                with map_sqlite_errors(self.path):
                    damage = integrity_error(self._database, self.path)
                if damage and not repair_indices(self._database, self.path, damage):
                    self._start_new_file(stack, damage)
                self._quarantine_damaged()
            self._reader = stack.enter_context(open_for_reading(self.path))
            stack.callback(self.flush)
            if not self._alone:
                stack.callback(self._delete_rest)
            thread = threading.Thread(target=self._run, name="caesura-journal", daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(self._wake.set)
            stack.callback(self._stopped.set)
            self._read_usage()
            self._deleted_elsewhere()
            self._wake.set()  # to finish deletions that were begun
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what waits and close the file. Raises JournalError where that fails."""
        self._stack.close()

    def _open(self) -> sqlite3.Connection:
        """Open the database, on a full disk by a part of the reserve."""
        busy_s = BUSY_S if self._alone else GUEST_BUSY_S
        try:
            return open_database(self.path, busy_s)
        except JournalError as error:
            if not self._reserve.lend(error):
                raise
        return open_database(self.path, busy_s)

    def append(self, record: Record, *, now: bool = False) -> None:
        """Append a record.

        Raises JournalError where earlier records could not be written, or at its station's limit for batches.
        """
        self._append_row(row_of(record), now=now)

    def append_batch(self, station: str, session: str, at: float, batch: EncodedBatch) -> None:
        """Append a batch as `append` does, without packing it again."""
        self._append_row(batch_row(station, session, at, batch))

    def _append_row(self, row: RecordRow, *, now: bool = False) -> None:
        if row.seq is not None:
            self._check_station_share(row.station)
        if now or not self.settings.commit_s:
            self._append_now(row)
        else:
            self._append(row)
            if not self._wake.is_set():
                self._wake.set()

    def commit(self) -> None:
        """Write the waiting records, in portions that fit in little room. Raises JournalError."""
        with self._writing:
            with self._guard:
                rows = self._waiting[:]
            if not rows and self._error is None:
                return
            for portion in portions(rows):
                try:
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

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """Return the records of a session as they are now. Raises JournalError, perhaps on the way."""
        self.commit()
        with self._writing, map_sqlite_errors(self.path):
            found = self._database.execute(SELECT_EXTENT, (station, session)).fetchone()
        return iter(()) if found is None else self._pages(SessionRow(*found[:-1]), found[-1])

    def edits(self, station: str, session: str) -> tuple[AppliedEdit, ...]:
        """Return the edits of a session, oldest first. Raises JournalError."""
        self.commit()
        with self._writing, map_sqlite_errors(self.path):
            rows = self._database.execute(SELECT_EDITS, (station, session)).fetchall()
            return edits_of((station, session), rows)

    def sessions(self) -> tuple[Key, ...]:
        """Return (station, session) of every session, oldest first."""
        self.commit()
        with self._writing, map_sqlite_errors(self.path):
            return tuple(self._database.execute(SELECT_SESSIONS))

    def closed(self) -> Set[Key]:
        """Return the sessions with a close."""
        self.commit()
        with self._writing, map_sqlite_errors(self.path):
            return set(self._database.execute(SELECT_CLOSED))

    def copies(self, station: str | None = None, session: str | None = None) -> tuple[Copy, ...]:
        """Return the extent of every session, of a station's, or of one, oldest first.

        Without what cannot be written.
        """
        with suppress(JournalError):
            self.commit()
        with self._writing, map_sqlite_errors(self.path):
            return copies_in(self._database, station, session)

    def epoch_of(self, station: str) -> int:
        """Return the last epoch of a station; -1 without one."""
        with self._writing, map_sqlite_errors(self.path):
            return epoch_in(self._database, station)

    def store_epoch(self, station: str, epoch: int) -> None:
        """Store the epoch of a station. Raises JournalError."""
        with self._writing, map_sqlite_errors(self.path), transaction(self._database):
            self._database.execute(INSERT_EPOCH, (station, epoch, checksum(station, epoch)))

    def store_outcome(self, station: str, outcome: Outcome) -> None:
        """Store an outcome, which the journal's thread writes: an hour of results is megabytes.

        A session whose outcome is not written, as after a crash, is replayed from its records.
        """
        with self._guard:
            self._outcomes[station, outcome.opening.session] = outcome
            is_full = len(self._outcomes) > OUTCOMES
        if is_full:
            self.flush()
        self._wake.set()

    def flush(self) -> None:
        """Write the waiting records, then the outcomes one by one: records are written in between."""
        self.commit()
        while True:
            with self._guard:
                key, outcome = next(iter(self._outcomes.items()), (None, None))
            if key is None or outcome is None:
                return
            try:
                self._write_outcome(key, outcome)
            finally:
                with self._guard:
                    if self._outcomes.get(key) is outcome:
                        del self._outcomes[key]

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

    def outcome(self, station: str, session: str) -> Outcome | None:
        """Return the outcome of a session; None without one or for an older form."""
        with self._guard:
            waiting = self._outcomes.get((station, session))
        if waiting is not None:
            return waiting
        with self._reading, map_sqlite_errors(self.path):
            found = self._reader.execute(SELECT_OUTCOME, (station, session)).fetchone()
        return None if found is None else outcome_of((station, session), *found)

    def outcomes(self) -> tuple[StoredOutcome, ...]:
        """Return the sessions with an outcome, the newest first."""
        with self._guard:
            sizes = dict.fromkeys(reversed(self._outcomes), 0)
        with self._reading, map_sqlite_errors(self.path):
            sizes |= {
                (station, session): size for station, session, size in self._reader.execute(SELECT_OUTCOMES)
            }
        return tuple(StoredOutcome(key, size) for key, size in sizes.items())

    def keep_overview(self, key: Key, session_id: int, content: bytes) -> None:
        """Keep an overview of a session; records are written between its parts. Raises JournalError."""
        parts = [content[at : at + OVERVIEW_PART] for at in range(0, len(content), OVERVIEW_PART)]
        for part, payload in enumerate(parts):
            crc = checksum(session_id, part, len(parts), payload)
            row = (part, len(parts), payload, crc, session_id, *key)
            with self._writing:
                self._leave_room(len(payload))
                with map_sqlite_errors(self.path), transaction(self._database):
                    self._database.execute(INSERT_OVERVIEW, row)

    def release(self, station: str, session: str) -> None:
        """Do nothing: the session stays until retention deletes it."""

    def quarantine(self, station: str, session: str, why: str) -> str:
        """Rename a session to a name that no other can have; return it."""
        self.commit()
        with self._writing, map_sqlite_errors(self.path):
            row = self._database.execute(SELECT_EXTENT, (station, session)).fetchone()
            return session if row is None else self._quarantine(SessionRow(*row[:-1]), why)

    def _quarantine(self, row: SessionRow, why: str) -> str:
        with transaction(self._database):
            ((aside,),) = self._database.execute(SET_ASIDE, (why, row.id)).fetchall()
        self._known.discard(row.key)
        with self._guard:
            self._outcomes.pop(row.key, None)
        logger.error("journal %s: %s; the session is set aside as %s/%s", self.path, why, row.station, aside)
        return str(aside)

    def delete(self, station: str, session: str) -> None:
        """Delete a session; most of its records are deleted later, in portions.

        Also where the disk is full: a deletion may make room.
        """
        self._delete({(station, session)})

    def _delete(self, keys: Set[Key]) -> None:
        """Delete these sessions in one transaction, which waits for the disk."""
        with self._writing:
            with suppress(JournalError):
                self.commit()
            try:
                self._mark_deleted(keys)
            except JournalError as error:
                self._mark_deleted(keys, error)
            with self._guard:
                for key in keys:
                    self._outcomes.pop(key, None)
                self._waiting = [row for row in self._waiting if row.key not in keys]
                self._waiting_bytes = sum(row.size for row in self._waiting)
        self._known -= keys
        self._has_deleted = True
        self._wake.set()

    def _mark_deleted(self, keys: Set[Key], refused: JournalError | None = None) -> None:
        """Hide sessions; where a full disk refused that, from its reserve, while no other process writes."""
        with map_sqlite_errors(self.path), transaction(self._database):
            if refused and not self._reserve.release(refused):
                raise refused
            for key in keys:
                mark_deleted(self._database, key)

    def enforce_retention(self, now: float) -> Mapping[Key, str]:
        """Delete some sessions past the limits; return them and those that another process deleted.

        The worker calls it, and does not wait for the disk: nothing is done while something is being written,
        except at every PATIENCE-th call. A look that takes long is followed by a pause.
        """
        if time.monotonic() < self._next_look_s:
            return {}
        self._skipped_looks += 1
        if not self._writing.acquire(blocking=self._skipped_looks >= PATIENCE):
            return {}
        began = time.thread_time()
        try:
            self._skipped_looks = 0
            usages = self._read_usage()
            gone = dict.fromkeys(self._deleted_elsewhere(), "deleted by another process")
            doomed = self._sessions_to_delete(usages, now)
        finally:
            self._writing.release()
        took_s = time.thread_time() - began
        if took_s > LONG_LOOK_S:
            self._next_look_s = time.monotonic() + took_s / LOOKS_SHARE
        if doomed:
            with suppress(JournalError):  # it is tried again at the next look
                self._delete(doomed.keys())
                gone |= doomed
        return gone

    def _sessions_to_delete(self, usages: Sequence[StationUsage], now: float) -> dict[Key, str]:
        """Return the sessions to delete with the reason: too old, closed ones first, then too large."""
        keep_s = self.settings.age_s
        with map_sqlite_errors(self.path):
            old = []
            if any(now - usage.touched > keep_s for usage in usages):
                old = self._database.execute(SELECT_OLD, (now - keep_s, DROPS)).fetchall()
            if old:
                days = f"days, kept are {keep_s / DAY_S:g}"
                return {
                    (station, session): f"not touched for {(now - touched) / DAY_S:.1f} {days}"
                    for station, session, touched in old
                }
            if (too_much := excess(usages, self.settings)) is None:
                return {}
            oldest = self._database.execute(SELECT_OLDEST_CLOSED, (too_much.station, DROPS)).fetchall()
        sizes = [0, *accumulate(size for _, size in oldest)]
        return {
            (too_much.station, session): too_much.why
            for number, (session, _) in enumerate(oldest)
            if number < too_much.sessions or sizes[number] < too_much.size
        }

    def _deleted_elsewhere(self) -> Set[Key]:
        """Return the sessions that another process has deleted since the last call."""
        with self._writing, map_sqlite_errors(self.path):
            (version,) = self._database.execute("PRAGMA data_version").fetchone()
            if version == self._version:
                return frozenset()
            self._version = version
            known = set(self._database.execute(SELECT_KEYS))
        gone, self._known = self._known - known, known
        return gone

    def report(self) -> JournalReport:
        """Return the state of the journal, with the size of the last look."""
        return JournalReport(
            kind="sqlite",
            commit_s=self.settings.commit_s,
            size=self._size,
            size_limit=self.settings.size_bytes,
            waiting=self._waiting_bytes,
            disk_free=_disk_free(self.path),
            trouble=str(self._error) if self._error else None,
        )

    def _start_new_file(self, stack: ExitStack, damage: str) -> None:
        self._database.close()
        aside = move_aside(self.path)
        logger.error(
            "journal %s is damaged (%s): it is now %s, and of its sessions those are kept that are whole; "
            "of the others bridges send what they still have",
            self.path,
            damage,
            aside.name,
        )
        self._database = stack.enter_context(closing(open_database(self.path)))
        try:
            with closing(open_damaged(aside)) as damaged:
                copy_intact_sessions(damaged, aside, self._database)
        except JournalError as error:
            logger.error("nothing more can be read: %s", error)

    def _quarantine_damaged(self) -> None:
        """Quarantine the sessions whose row in the table of sessions is damaged."""
        with map_sqlite_errors(self.path):
            for row in [SessionRow(*row) for row in self._database.execute(SELECT_ROWS)]:
                if not row.is_intact:
                    self._quarantine(row, f"the entry of {'/'.join(row.key)} is damaged")

    # --- writing ----------------------------------------------------------------------------------------

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
            self._open_bytes[row.station] += size

    def _check_station_share(self, station: str) -> None:
        taken, limit = self._open_bytes[station], self.settings.open_bytes
        if taken >= limit:
            raise JournalError(
                f"journal {self.path}: open sessions of station {station} take {taken / GB:.3g} GB, those of "
                f"one station may take {limit / GB:.3g}: close them, or raise --journal-gb"
            )

    def _append_now(self, row: RecordRow) -> None:
        """Append a row and write it to disk; on an error it is removed again."""
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
                raise

    def _fail(self, error: JournalError) -> JournalError:
        if self._error is None:
            logger.error("%s", error)
        self._error = error
        self._wake.set()
        return error

    def _leave_room(self, size: int) -> None:
        """Raise JournalFullError where the rest of the disk is for deletions, which have freed too little.

        size: [bytes] to be written. What goes into freed pages takes no room but in the log, which is as long
        already: so further deletions find the room that these found.
        """
        for_deletions = self._makes_room and isinstance(self._error, JournalFullError)
        if not for_deletions and not self._reserve.is_spent():
            return
        with map_sqlite_errors(self.path):
            is_freed = free_bytes(self._database) >= 2 * size + FREED
        if not is_freed:
            why = f"the last {SIZE >> 20} MB are for deletions"
            raise JournalFullError(f"journal {self.path} {REMEDIES['SQLITE_FULL']} ({why})")

    def _forget(self, rows: Sequence[RecordRow]) -> None:
        """Take the first rows, which are on disk, from those that wait."""
        size, keys = sum(row.size for row in rows), {row[:2] for row in rows}
        with self._guard:  # for which the worker waits
            del self._waiting[: len(rows)]
            self._waiting_bytes -= size
            self._known |= keys

    def _succeed(self) -> None:
        with self._guard:
            if self._error is not None:
                logger.warning("journal %s is written again", self.path)
            self._error = None

    def _run(self) -> None:
        """Write what waits in a loop; after an error at longer intervals.

        On a full disk deletions come first: otherwise what waits takes the room that they need.
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
            with suppress(JournalError):  # said when it began; it has woken this thread for another attempt
                self.flush()
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
        """Continue deletions, of this process or of another."""
        with self._writing, map_sqlite_errors(self.path):
            return delete_batch(self._database)

    def _delete_rest(self) -> None:
        """Delete what is left where no service does it, with pauses for other writers."""
        with suppress(JournalError):
            while self._has_deleted and self._delete_batch():
                threading.Event().wait(PAUSE_S)

    # --- keeping ----------------------------------------------------------------------------------------

    def _read_usage(self) -> list[StationUsage]:
        """Return the usage of each station."""
        with self._writing, map_sqlite_errors(self.path):
            usages = [StationUsage(*row) for row in self._database.execute(SELECT_USAGE)]
        self._size = sum(usage.size for usage in usages)
        self._open_bytes = Counter({usage.station: usage.open_size for usage in usages if usage.open_size})
        return usages

    # --- reading ----------------------------------------------------------------------------------------

    def _pages(self, session: SessionRow, last: int) -> Iterator[Record]:
        pages = pages_of(self._database, session, last)
        while True:
            with self._writing, map_sqlite_errors(self.path):
                page = next(pages, None)
            if page is None:
                return
            for row in page:
                yield record_of(session.key, row)


def _disk_free(path: Path) -> int | None:
    """What the disk of a file has left [bytes]; None where that is not known."""
    try:
        return shutil.disk_usage(path.parent).free
    except OSError:
        return None
