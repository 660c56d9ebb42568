"""A journal on disk: SQLite in WAL mode, one file per instance, many records per commit.

`writer_thread` writes it. This module opens it, reads it and enforces its limits.

Closed sessions are deleted, oldest first, when they are too old or the journal is too large. Open sessions
are never deleted for their size (`station_quota` bounds it), and for their age only after so long a time
without a record.
"""

from __future__ import annotations

import logging
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, closing, suppress
from itertools import accumulate, chain
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar, cast

from caesura_protocol.messages import Edit, EditProgram, JournalReport
from caesura_service.journal.applied_edits import AppliedEdit
from caesura_service.journal.damaged_file import (
    integrity_error,
    move_aside,
    open_damaged,
    read_through,
    repair_indices,
)
from caesura_service.journal.damaged_sessions import NOT_STORED, DamageReport, beside
from caesura_service.journal.deletion import mark_deleted
from caesura_service.journal.journal import (
    Copy,
    JournalDamagedError,
    JournalError,
    JournalUnreadableError,
    Key,
    Outcome,
    Record,
    Recordable,
    Refused,
    StoredOutcome,
    is_named,
)
from caesura_service.journal.peer_journals import open_for_reading
from caesura_service.journal.retention import (
    DAY_S,
    JournalSettings,
    StationUsage,
    excess,
    expiry,
    open_part,
)
from caesura_service.journal.retraction import retract
from caesura_service.journal.rows import (
    UNREADABLE_OUTCOME,
    SessionRow,
    Stored,
    changes_of,
    copies_in,
    edits_of,
    epoch_in,
    outcome_of,
    pages_of,
    record_of,
    verified_outcome,
    verify,
)
from caesura_service.journal.salvage import copy_intact_sessions
from caesura_service.journal.sqlite_database import (
    BUSY_S,
    GUEST_BUSY_S,
    acquire_lock,
    open_database,
    transaction,
)
from caesura_service.journal.sqlite_errors import map_sqlite_errors
from caesura_service.journal.sqlite_statements import (
    SELECT_ASIDE,
    SELECT_CHANGES,
    SELECT_CLOSED,
    SELECT_DAYS,
    SELECT_EDIT_AT,
    SELECT_EDITS,
    SELECT_EXTENT,
    SELECT_HAS_OUTCOME,
    SELECT_KEYS,
    SELECT_NEWEST,
    SELECT_OLD,
    SELECT_OLDEST_CLOSED,
    SELECT_OPEN,
    SELECT_OPENED,
    SELECT_OUTCOME,
    SELECT_ROWS,
    SELECT_SESSIONS,
    SELECT_USAGE,
    SET_ASIDE,
    select_outcomes,
)
from caesura_service.journal.wal_integrity import log_integrity_error
from caesura_service.journal.writer_thread import SqliteWriter

logger = logging.getLogger(__name__)

T = TypeVar("T")

MAX_ID = (1 << 63) - 1  # of a row
UNREADABLE = (JournalDamagedError, JournalUnreadableError)  # errors of one session: others can be read
PATIENCE = 10  # times that tidying may be put off
DROPS = 512  # sessions at one look, some milliseconds: more than a station opens and closes in between
LONG_LOOK_S, LOOKS_SHARE = 0.02, 0.02  # a look that takes longer [s] is followed by a pause: its share


class SqliteJournal(SqliteWriter):
    """The journal in one file, while the context lasts.

    Raises JournalError on entry if the file is not a journal, is of a newer version, or cannot be written;
    with `alone`, also if another process has locked it. Without `alone`, it may be the journal of a running
    service, to read it or to delete sessions.
    """

    def __init__(self, path: Path, settings: JournalSettings | None = None, *, alone: bool = True) -> None:
        super().__init__(path, settings, alone=alone)
        self._reading = threading.Lock()  # of the connection that only reads; it waits for no write
        self._size = 0  # [bytes] as of the last look
        self._version = -1  # of the file, as far as other processes have changed it
        self._next_look_s = 0.0  # [s]
        self._skipped_looks = 0  # looks, since the last one
        self._has_compared_clock = False
        self._damage = DamageReport()  # as of the last look
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            with map_sqlite_errors(self.path):
                log_damage = log_integrity_error(self.path) if self._alone else None
                is_new = self._alone and not self.path.exists()
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
            self._start_thread(stack)
            self._read_usage()
            self._deleted_elsewhere()
            if self._alone:
                stack.enter_context(beside(self._check_outcomes(), "caesura-outcomes"))
            self._wake.set()  # to finish deletions that were begun
            if is_new:
                hint = "no earlier session is known; if it has a disk of its own, that is not mounted"
                logger.info("journal %s did not exist and begins empty: %s", self.path, hint)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write the queued records and close the file. Raises JournalError if that fails."""
        self._stack.close()

    def _open(self) -> sqlite3.Connection:
        """Open the database; on a full disk, free a part of the reserve for that."""
        busy_s = BUSY_S if self._alone else GUEST_BUSY_S
        try:
            return open_database(self.path, busy_s)
        except JournalError as error:
            if not self._reserve.lend(error):
                raise
        return open_database(self.path, busy_s)

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """Return the current records of a session. Raises JournalError, also during the iteration."""
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

    def changes(self, station: str, session: str) -> tuple[Recordable, ...]:
        """Return the edits, descriptions and program edits of a session, oldest first.

        Without what cannot be written. Raises JournalError, and ProtocolError where one is unreadable.
        """
        with suppress(JournalError):
            self.commit()
        with self._writing, map_sqlite_errors(self.path):
            rows = self._database.execute(SELECT_CHANGES, (station, session)).fetchall()
            return changes_of((station, session), rows)

    def edit_at(
        self, station: str, session: str, kind: type[Edit] | type[EditProgram], revision: int
    ) -> Edit | EditProgram | None:
        """Return the edit of a session, or of its program, after `revision` earlier ones; None without one.

        Raises JournalError.
        """
        self.commit()
        key = (station, session)
        with self._writing, map_sqlite_errors(self.path):
            row = self._database.execute(SELECT_EDIT_AT[kind], (*key, revision)).fetchone()
            message = record_of(key, verify(key, Stored(*row))).message if row else None
        return message if isinstance(message, kind) else None

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

        Queued records that cannot be written are not included.
        """
        with suppress(JournalError):
            self.commit()
        with self._writing, map_sqlite_errors(self.path):
            return copies_in(self._database, station, session)

    def epoch_of(self, station: str) -> int:
        """Return the last epoch of a station; -1 without one."""
        with self._writing, map_sqlite_errors(self.path):
            return epoch_in(self._database, station)

    def outcome(self, station: str, session: str) -> Outcome | None:
        """Return the outcome of a session; None without one or for one in an older format."""
        with self._guard:
            waiting = self._outcomes.get((station, session))
        if waiting is not None:
            return waiting
        return self._read_results((station, session), outcome_of)

    def _read_results(self, key: Key, read: Callable[[Key, Sequence[Any]], T]) -> T | None:
        """Return what `read` makes of the stored outcome; None without one, or if it cannot be read.

        That is recorded and logged once. Raises JournalError.
        """
        with suppress(*UNREADABLE):
            results = self._read_outcome(key, read)
            if self._unreadable.has(key):
                self._unreadable.remove(key)
            return results
        with self._unreadable.lock:
            try:
                return self._read_outcome(key, read)
            except UNREADABLE as refusal:
                self._add_unreadable(key, str(refusal))
                if type(refusal) is not JournalDamagedError:  # it may be readable again
                    raise
        return None

    def _read_outcome(self, key: Key, read: Callable[[Key, Sequence[Any]], T]) -> T | None:
        with self._reading, map_sqlite_errors(self.path):
            found = self._reader.execute(SELECT_OUTCOME, key).fetchone()
        return None if found is None else read(key, found)

    def mark_unreadable(self, station: str, session: str, why: str) -> None:
        """List a session as damaged in the report: it cannot be rebuilt, and stays as it is.

        Raises JournalError.
        """
        key = (station, session)
        with self._unreadable.lock:
            if (opened := self._opened(key)) is not None:
                self._unreadable.add(key, opened, why)

    def _opened(self, key: Key) -> float | None:
        """Return the time of day at which a session was opened [s]; None if the file has no such session."""
        with self._reading, map_sqlite_errors(self.path):
            found = self._reader.execute(SELECT_OPENED, key).fetchone()
        return None if found is None else float(found[0])

    def _add_unreadable(self, key: Key, why: str, level: int = logging.WARNING) -> None:
        if (opened := self._opened(key)) is None:
            return
        if not self._unreadable.has(key):  # logged before a client can learn of it
            logger.log(level, UNREADABLE_OUTCOME, "/".join(key), why)
        self._unreadable.add(key, opened, why)

    def _check_outcomes(self) -> Generator[None, None, None]:
        """Check that the outcome of each closed session can be read, one a step. Raises JournalError."""
        with open_for_reading(self.path) as database:
            with map_sqlite_errors(self.path):
                closed = database.execute(SELECT_HAS_OUTCOME).fetchall()
            for *key, has_outcome in closed:
                with suppress(*UNREADABLE):
                    self._check_outcome(database, cast(Key, tuple(key)), has_outcome)
                yield

    def _check_outcome(self, database: sqlite3.Connection, key: Key, has_outcome: int) -> None:
        if not has_outcome:
            with self._unreadable.lock:
                if self._read_outcome(key, verified_outcome) is None:  # a session in memory is rebuilt soon
                    self._add_unreadable(key, NOT_STORED, logging.INFO)
            return
        try:
            with map_sqlite_errors(self.path):
                found = database.execute(SELECT_OUTCOME, key).fetchone()
            if found is not None:
                verified_outcome(key, found)
        except UNREADABLE:
            self._read_results(key, verified_outcome)

    def outcomes(self, station: str | None = None, session: str | None = None) -> Iterator[StoredOutcome]:
        """Yield the sessions with an outcome, the newest first; they are read a page at a time.

        Without those whose outcome is known to be unreadable: they would count as skipped, and a page would
        repeat sessions of the page before.
        """
        with self._guard:
            waiting = [key for key in reversed(self._outcomes) if is_named(key, station, session)]
        yield from (StoredOutcome(key, 0) for key in waiting)
        given = {"station": station, "session": session}
        query = select_outcomes(*(column for column, name in given.items() if name is not None))
        below = MAX_ID
        while True:
            with self._reading, map_sqlite_errors(self.path):
                page = self._reader.execute(query, {**given, "below": below}).fetchall()
            if not page:
                return
            below = page[-1][0]
            for _, *key, size in page:
                if (known := tuple(key)) not in waiting and not self._unreadable.has(known):
                    yield StoredOutcome(known, size)

    def _pages(self, session: SessionRow, last: int) -> Iterator[Record]:
        pages = pages_of(self._database, session, last)
        while True:
            with self._writing, map_sqlite_errors(self.path):
                page = next(pages, None)
            if page is None:
                return
            for row in page:
                yield record_of(session.key, row)

    def release(self, station: str, session: str) -> None:
        """Return at once: a released session stays on disk until retention deletes it."""

    def check_readable(self) -> None:
        """Read the file and its log once. Raises JournalError if the disk refuses that."""
        with map_sqlite_errors(self.path):
            read_through(self.path)

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
            self._quota.close(row.key)
        logger.error("journal %s: %s; the session is set aside as %s/%s", self.path, why, row.station, aside)
        return str(aside)

    def retract(self, station: str, session: str, refused: Refused, why: str) -> None:
        """Move what was refused to a session that is set aside. Raises JournalError."""
        self.commit()
        key = (station, session)
        with self._writing, map_sqlite_errors(self.path):
            with transaction(self._database):
                aside = retract(self._database, key, refused, why)
            with self._guard:
                self._outcomes.pop(key, None)
        if aside is not None:
            logger.warning("journal %s: %s; it is set aside as %s/%s", self.path, why, station, aside)

    def delete(self, station: str, session: str) -> None:
        """Delete a session; most of its records are deleted later, in portions.

        It works on a full disk too: a deletion may free space.
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
                    self._quota.close(key)
                self._waiting = [row for row in self._waiting if row.key not in keys]
                self._waiting_bytes = sum(row.size for row in self._waiting)
        self._known -= keys
        self._has_deleted = True
        self._wake.set()

    def _mark_deleted(self, keys: Set[Key], refused: JournalError | None = None) -> None:
        """Hide sessions; on a full disk with space of the reserve, while no other process writes."""
        with map_sqlite_errors(self.path), transaction(self._database):
            if refused and not self._reserve.release(refused):
                raise refused
            for key in keys:
                mark_deleted(self._database, key)

    def enforce_retention(self, now: float) -> Mapping[Key, str]:
        """Delete some sessions past the limits; return them and those that another process deleted.

        The worker calls it and must not wait for the disk: during a write it does nothing, except at every
        PATIENCE-th call. After a long call it pauses.
        """
        if time.monotonic() < self._next_look_s:
            return {}
        self._skipped_looks += 1
        if not self._writing.acquire(blocking=self._skipped_looks >= PATIENCE):
            return {}
        began = time.thread_time()
        try:
            self._skipped_looks = 0
            self._compare_clock(now)
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

    def _compare_clock(self, now: float) -> None:
        """Log once if the journal's times are ahead of the clock: new records then expire too early."""
        if self._has_compared_clock:
            return
        with map_sqlite_errors(self.path):
            (newest,) = self._database.execute(SELECT_NEWEST).fetchone()
        self._has_compared_clock = True
        if newest - now > DAY_S:
            logger.warning(
                "journal %s: its newest record is %.0f days ahead of this machine's clock: set the clock and "
                "restart the service, else what is recorded now has a wrong time and expires too soon",
                self.path,
                (newest - now) / DAY_S,
            )

    def _sessions_to_delete(self, usages: Sequence[StationUsage], now: float) -> dict[Key, str]:
        """Return the sessions to delete with the reason: too old, closed ones first, then too large."""
        keep_s = self.settings.age_s
        with map_sqlite_errors(self.path):
            old = []
            if any(now - usage.touched > keep_s for usage in usages):
                used = chain.from_iterable(self._database.execute(SELECT_DAYS, (now,)))
                old = self._database.execute(SELECT_OLD, (expiry(used, now, keep_s), DROPS)).fetchall()
            if old:
                days = f"days; the limit is {keep_s / DAY_S:g}"
                return {
                    (station, session): f"unchanged for {(now - touched) / DAY_S:.1f} {days}"
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
        """Return the state of the journal, with the size from the last check."""
        return JournalReport(
            kind="sqlite",
            commit_s=self.settings.commit_s,
            size=self._size,
            size_limit=self.settings.size_bytes,
            waiting=self._waiting_bytes,
            disk_free=_disk_free(self.path),
            trouble=str(self._error) if self._error else None,
            damaged=self._damage.listed,
            damaged_before=self._damage.before,
        )

    def _start_new_file(self, stack: ExitStack, damage: str) -> None:
        self._database.close()
        aside = move_aside(self.path)
        logger.error(
            "journal %s is damaged (%s): it is now %s. Its undamaged sessions are kept; "
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

    def _read_usage(self) -> list[StationUsage]:
        """Return the usage of each station on disk; recount the open sessions and the damaged ones."""
        with self._writing, map_sqlite_errors(self.path):
            usages = [StationUsage(*row) for row in self._database.execute(SELECT_USAGE)]
            open_sizes = {
                (station, session): size for station, session, size in self._database.execute(SELECT_OPEN)
            }
            aside = self._database.execute(SELECT_ASIDE).fetchall()
            part = open_part(usages, self.settings)
            with self._guard:  # while this thread holds the database, what waits is not on disk
                self._quota.renew(open_sizes, self._waiting, part)
        self._size = sum(usage.size for usage in usages)
        self._damage = self._unreadable.report(aside, self._known)
        return usages


def _disk_free(path: Path) -> int | None:
    """Return the free space [bytes] on the disk of a file; None if it cannot be read."""
    try:
        return shutil.disk_usage(path.parent).free
    except OSError:
        return None
