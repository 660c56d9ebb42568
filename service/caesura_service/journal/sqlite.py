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
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, closing, suppress
from itertools import accumulate, chain
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_WHOLE_BYTES, JournalReport
from caesura_service.journal.checksums import checksum
from caesura_service.journal.deletion import drop_some, hide
from caesura_service.journal.edits import Edit
from caesura_service.journal.integrity import damage_of, mended, readable, set_aside
from caesura_service.journal.journal import Copy, JournalDamagedError, JournalError, Key, Outcome, Record
from caesura_service.journal.retention import DAY_S, GB, JournalSettings, StationUsage, excess
from caesura_service.journal.rows import (
    ROW_BYTES,
    RecordRow,
    SessionRow,
    copies_in,
    edits_of,
    epoch_in,
    outcome_of,
    pages_of,
    record_of,
    row_of,
    stations_in,
)
from caesura_service.journal.schema import (
    INSERT_EPOCH,
    INSERT_OUTCOME,
    INSERT_OVERVIEW,
    SELECT_CLOSED,
    SELECT_EDITS,
    SELECT_EXTENT,
    SELECT_KEYS,
    SELECT_LAST,
    SELECT_OLD,
    SELECT_OLDEST_CLOSED,
    SELECT_OUTCOME,
    SELECT_ROWS,
    SELECT_SESSIONS,
    SELECT_SHARES,
    SET_ASIDE,
    UPDATE_SESSIONS,
    insert_records,
    insert_sessions,
    locked,
    opened,
    transaction,
    translated,
)
from caesura_service.journal.wal import damage_of_log

logger = logging.getLogger(__name__)
T = TypeVar("T")

MAX_PLACE = (1 << 63) - 1
RETRY_S = 0.5  # after a commit that failed
PATIENCE = 10  # times that tidying may be put off
DROPS = 32  # sessions at one look
LONG_LOOK_S, LOOKS_SHARE = 0.02, 0.02  # a look that takes longer [s] is followed by a pause: its share
PAUSE_S = 0.02  # between two portions of what is dropped, where a service may want to write
OUTCOMES = 64  # that wait to be written; with one more, the worker writes them itself
OVERVIEW_PART = 1 << 19  # [bytes] of an overview in one transaction, some milliseconds
_AT_ONCE = (64, 8, 1)  # rows that one statement writes: each size is one more statement to keep


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
        self._trouble: JournalError | None = None
        self._size = 0  # [bytes] as of the last look
        self._open: Counter[str] = Counter()  # [bytes] of each station's open sessions, since the last look
        self._seen: set[Key] = set()  # sessions, at the last look and since
        self._version = -1  # of the file, as far as other processes have changed it
        self._rests_until = 0.0  # [s]
        self._put_off = 0  # looks, since the last one
        self._has_dropped = False  # has anything been dropped by this one?
        self._wake, self._over = threading.Event(), threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            with translated(self.path):
                log_damage = damage_of_log(self.path) if self._alone else None
            self._database = stack.enter_context(closing(opened(self.path)))
            if self._alone:
                stack.enter_context(closing(locked(self.path)))
                if log_damage:
                    why = "what was written after that is not known here, bridges send what they still have"
                    logger.error("journal %s: %s; %s", self.path, log_damage, why)
                with translated(self.path):
                    damage = damage_of(self._database, self.path)
                if damage and not mended(self._database, self.path, damage):
                    self._begin_anew(stack, damage)
                self._set_damaged_aside()
            stack.callback(self.flush)
            if not self._alone:
                stack.callback(self._drop_the_rest)
            thread = threading.Thread(target=self._run, name="caesura-journal", daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(self._wake.set)
            stack.callback(self._over.set)
            self._look()
            self._seen_since_last_look()
            self._wake.set()  # to finish deletions that were begun
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what waits, and let go of the file. Raises JournalError where it could not be written."""
        self._stack.close()

    def append(self, record: Record, *, now: bool = False) -> None:
        """Keep a record. Raises JournalError where what came before it could not be written, or a batch is
        more than its station's part.
        """
        row = row_of(record)
        if row.seq is not None:
            self._check_part(row.station)
        if now or not self.settings.commit_s:
            self._append_now(row)
        else:
            self._append(row)
            if not self._wake.is_set():
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
            except Exception as error:
                why = f"journal {self.path} cannot be written: {type(error).__name__}: {error}"
                failure = error if isinstance(error, JournalError) else JournalError(why)
                self._fail(failure)
                raise failure from error
            self._succeed(rows)

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """The records of a session as they are now. Raises JournalError, perhaps on the way."""
        self.commit()
        with self._writing, translated(self.path):
            found = self._database.execute(SELECT_EXTENT, (station, session)).fetchone()
        return iter(()) if found is None else self._pages(SessionRow(*found[:-1]), found[-1])

    def edits(self, station: str, session: str) -> tuple[Edit, ...]:
        """Those of a session, oldest first. Raises JournalError."""
        self.commit()
        with self._writing, translated(self.path):
            rows = self._database.execute(SELECT_EDITS, (station, session)).fetchall()
            return edits_of((station, session), rows)

    def sessions(self) -> tuple[Key, ...]:
        """(station, session) of every session, oldest first."""
        self.commit()
        with self._writing, translated(self.path):
            return tuple(self._database.execute(SELECT_SESSIONS))

    def closed(self) -> Set[Key]:
        """Those with a close."""
        self.commit()
        with self._writing, translated(self.path):
            return set(self._database.execute(SELECT_CLOSED))

    def copies(self, station: str | None = None, session: str | None = None) -> tuple[Copy, ...]:
        """What it has of every session, of those of one station, or of one, oldest first.

        Without what cannot be written: one can still look.
        """
        with suppress(JournalError):
            self.commit()
        with self._writing, translated(self.path):
            return copies_in(self._database, station, session)

    def epoch_of(self, station: str) -> int:
        """The last epoch of a station; -1 without one."""
        with self._writing, translated(self.path):
            return epoch_in(self._database, station)

    def keep_epoch(self, station: str, epoch: int) -> None:
        """Remember it. Raises JournalError."""
        with self._writing, translated(self.path), transaction(self._database):
            self._database.execute(INSERT_EPOCH, (station, epoch, checksum(station, epoch)))

    def conclude(self, station: str, outcome: Outcome) -> None:
        """Keep how a session ended. Written by the journal's thread: an hour of results is megabytes.

        A session whose outcome is not written, as after a crash, is replayed from its records.
        """
        with self._guard:
            self._outcomes[station, outcome.opening.session] = outcome
            is_full = len(self._outcomes) > OUTCOMES
        if is_full:
            self.flush()
        self._wake.set()

    def flush(self) -> None:
        """Write what waits, then how sessions ended, one by one: records are written in between."""
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
        """What is too large to be asked for is replayed instead."""
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
            with translated(self.path), transaction(self._database):
                self._database.execute(INSERT_OUTCOME, (opening, outcome.last_seq, snapshot, crc, *key))

    def outcome(self, station: str, session: str) -> Outcome | None:
        """How a session ended; None where an older version wrote it in another form."""
        with self._guard:
            waiting = self._outcomes.get((station, session))
        if waiting is not None:
            return waiting
        with self._writing, translated(self.path):
            found = self._database.execute(SELECT_OUTCOME, (station, session)).fetchone()
        return None if found is None else outcome_of((station, session), *found)

    def keep_overview(self, key: Key, session_id: int, content: bytes) -> None:
        """Keep an overview of a session; records are written between its parts. Raises JournalError."""
        parts = [content[at : at + OVERVIEW_PART] for at in range(0, len(content), OVERVIEW_PART)]
        for part, payload in enumerate(parts):
            crc = checksum(session_id, part, len(parts), payload)
            with self._writing, translated(self.path), transaction(self._database):
                self._database.execute(INSERT_OVERVIEW, (part, len(parts), payload, crc, session_id, *key))

    def release(self, station: str, session: str) -> None:
        """It stays until it is too old or too much."""

    def set_aside(self, station: str, session: str, why: str) -> str:
        """Keep a session under a name that no other can have."""
        self.commit()
        with self._writing, translated(self.path):
            row = self._database.execute(SELECT_EXTENT, (station, session)).fetchone()
            return session if row is None else self._set_aside(SessionRow(*row[:-1]), why)

    def _set_aside(self, row: SessionRow, why: str) -> str:
        with transaction(self._database):
            ((aside,),) = self._database.execute(SET_ASIDE, (why, row.id)).fetchall()
        self._seen.discard(row.key)
        with self._guard:
            self._outcomes.pop(row.key, None)
        logger.error("journal %s: %s; the session is set aside as %s/%s", self.path, why, row.station, aside)
        return str(aside)

    def forget(self, station: str, session: str) -> None:
        """Drop a session; most of its records are deleted by and by.

        Also where nothing can be written that needs room: dropping may make it.
        """
        self._forget({(station, session)})

    def _forget(self, keys: Set[Key]) -> None:
        """All of these at once, for each transaction waits for the disk."""
        with self._writing:
            with suppress(JournalError):
                self.commit()
            with translated(self.path), transaction(self._database):
                for key in keys:
                    hide(self._database, key)
            with self._guard:
                for key in keys:
                    self._outcomes.pop(key, None)
                self._waiting = [row for row in self._waiting if row.key not in keys]
                self._waiting_bytes = sum(row.size for row in self._waiting)
        self._seen -= keys
        self._has_dropped = True
        self._wake.set()

    def tidy(self, now: float) -> Mapping[Key, str]:
        """Drop some of the sessions that have to go, and return those that another process has dropped.

        The worker calls it, and does not wait for the disk: nothing is done while something is being written,
        except at every PATIENCE-th call. A look that takes long is followed by a pause.
        """
        if time.monotonic() < self._rests_until:
            return {}
        self._put_off += 1
        if not self._writing.acquire(blocking=self._put_off >= PATIENCE):
            return {}
        began = time.thread_time()
        try:
            self._put_off = 0
            shares = self._look()
            gone = dict.fromkeys(self._seen_since_last_look(), "deleted by another process")
            overdue = self._overdue(shares, now)
        finally:
            self._writing.release()
        took_s = time.thread_time() - began
        if took_s > LONG_LOOK_S:
            self._rests_until = time.monotonic() + took_s / LOOKS_SHARE
        if overdue:
            with suppress(JournalError):  # it is tried again at the next look
                self._forget(overdue.keys())
                gone |= overdue
        return gone

    def _overdue(self, shares: Sequence[StationUsage], now: float) -> dict[Key, str]:
        """What has to go now, and why: what is too old, closed sessions first, then what is too much."""
        keep_s = self.settings.age_s
        with translated(self.path):
            old = []
            if any(now - share.touched > keep_s for share in shares):
                old = self._database.execute(SELECT_OLD, (now - keep_s, DROPS)).fetchall()
            if old:
                days = f"days, kept are {keep_s / DAY_S:g}"
                return {
                    (station, session): f"not touched for {(now - touched) / DAY_S:.1f} {days}"
                    for station, session, touched in old
                }
            if (too_much := excess(shares, self.settings)) is None:
                return {}
            oldest = self._database.execute(SELECT_OLDEST_CLOSED, (too_much.station, DROPS)).fetchall()
        sizes = [0, *accumulate(size for _, size in oldest)]
        return {
            (too_much.station, session): too_much.why
            for number, (session, _) in enumerate(oldest)
            if number < too_much.sessions or sizes[number] < too_much.size
        }

    def _seen_since_last_look(self) -> Set[Key]:
        """Sessions that are no longer there. Each is looked at only where another process has written."""
        with self._writing, translated(self.path):
            (version,) = self._database.execute("PRAGMA data_version").fetchone()
            if version == self._version:
                return frozenset()
            self._version = version
            known = set(self._database.execute(SELECT_KEYS))
        gone, self._seen = self._seen - known, known
        return gone

    def report(self) -> JournalReport:
        """How it is doing, the size as of the last look."""
        return JournalReport(
            kind="sqlite",
            commit_s=self.settings.commit_s,
            size=self._size,
            size_limit=self.settings.size_bytes,
            waiting=self._waiting_bytes,
            trouble=str(self._trouble) if self._trouble else None,
        )

    def _begin_anew(self, stack: ExitStack, damage: str) -> None:
        self._database.close()
        aside = set_aside(self.path)
        logger.error(
            "journal %s is damaged (%s): it is now %s, and of its sessions those are kept that are whole; "
            "of the others bridges send what they still have",
            self.path,
            damage,
            aside.name,
        )
        self._database = stack.enter_context(closing(opened(self.path)))
        try:
            with closing(readable(aside)) as damaged, translated(aside):
                self._salvage(damaged, aside)
        except JournalError as error:
            logger.error("nothing more can be read: %s", error)

    def _salvage(self, damaged: sqlite3.Connection, aside: Path) -> None:
        """Take over the sessions of another file that are as they were written, each wholly or not at all."""
        for station in stations_in(damaged):
            if (epoch := epoch_in(damaged, station)) >= 0:
                self.keep_epoch(station, epoch)
        for row in damaged.execute(SELECT_ROWS).fetchall():
            session = SessionRow(*row)
            try:
                with translated(aside), transaction(self._database):
                    self._salvage_one(damaged, session)
            except JournalError as error:
                logger.error("%s is not kept: %s", "/".join(session.key), error)

    def _salvage_one(self, damaged: sqlite3.Connection, session: SessionRow) -> None:
        if session.record_count is None or not session.is_intact:
            raise JournalDamagedError("whether it is whole cannot be known")
        for page in pages_of(damaged, session, MAX_PLACE):
            self._write([row.again(session.key) for row in page])
        if (outcome := damaged.execute(SELECT_OUTCOME, session.key).fetchone()) is not None:
            self._database.execute(INSERT_OUTCOME, (*outcome[1:], *session.key))

    def _set_damaged_aside(self) -> None:
        """Sessions of which not even the row in the table of sessions is as it was written."""
        with translated(self.path):
            for row in [SessionRow(*row) for row in self._database.execute(SELECT_ROWS)]:
                if not row.is_intact:
                    self._set_aside(row, f"the entry of {'/'.join(row.key)} is damaged")

    # --- writing ----------------------------------------------------------------------------------------

    def _append(self, row: RecordRow) -> None:
        size = row.size
        with self._guard:
            if self._trouble is not None:
                raise self._trouble
            if self._waiting_bytes + size > self.settings.waiting_bytes:
                raise JournalError(
                    f"journal {self.path} is written too slowly, {self._waiting_bytes} bytes wait: "
                    "put it on a faster disk"
                )
            self._waiting.append(row)
            self._waiting_bytes += size
            self._open[row.station] += size

    def _check_part(self, station: str) -> None:
        taken, limit = self._open[station], self.settings.open_bytes
        if taken >= limit:
            raise JournalError(
                f"journal {self.path}: open sessions of station {station} take {taken / GB:.3g} GB, those of "
                f"one station may take {limit / GB:.3g}: close them, or raise --journal-gb"
            )

    def _append_now(self, row: RecordRow) -> None:
        """Either it is safe, or it is not kept: no other thread writes until that is decided."""
        with self._writing:
            self._append(row)
            try:
                self.commit()
            except JournalError:
                with self._guard:
                    self._waiting.pop()
                    self._waiting_bytes -= row.size
                raise

    def _write(self, rows: Sequence[RecordRow]) -> None:
        """What is there already is not written again, and counts once."""
        execute = self._database.execute
        opened: dict[Key, tuple[str, str, float, float]] = {}
        for row in rows:
            opened.setdefault(row.key, (*row.key, row.at, row.at))
        for sessions in _parts([*opened.values()]):
            execute(insert_sessions(len(sessions)), [*chain.from_iterable(sessions)])
        (before,) = execute(SELECT_LAST).fetchone()
        for some in _parts(rows):
            execute(insert_records(len(some)), [*chain.from_iterable(some)])
        execute(UPDATE_SESSIONS, (ROW_BYTES, before))

    def _fail(self, error: JournalError) -> None:
        if self._trouble is None:
            logger.error("%s", error)
        self._trouble = error
        self._wake.set()

    def _succeed(self, rows: list[RecordRow]) -> None:
        with self._guard:
            del self._waiting[: len(rows)]
            self._waiting_bytes -= sum(row.size for row in rows)
            self._seen |= {row.key for row in rows}
            if self._trouble is not None:
                logger.warning("journal %s is written again", self.path)
            self._trouble = None

    def _run(self) -> None:
        """Write what waits, again and again; after an error less often."""
        while not self._over.is_set():
            self._wake.wait()
            self._wake.clear()
            self._over.wait(self.settings.commit_s if self._trouble is None else RETRY_S)
            with suppress(JournalError):  # said when it began; it has woken this thread for another attempt
                self.flush()
            try:
                more = self._drop_some()
            except JournalError:  # another process is writing
                more = True
                self._over.wait(RETRY_S)
            if more:
                self._wake.set()

    def _drop_some(self) -> bool:
        """Continue deletions, of this process or of another."""
        with self._writing, translated(self.path):
            return drop_some(self._database)

    def _drop_the_rest(self) -> None:
        """No service may be there to do it; one that is can write in between."""
        with suppress(JournalError):
            while self._has_dropped and self._drop_some():
                threading.Event().wait(PAUSE_S)

    # --- keeping ----------------------------------------------------------------------------------------

    def _look(self) -> list[StationUsage]:
        """What each station takes."""
        with self._writing, translated(self.path):
            shares = [StationUsage(*row) for row in self._database.execute(SELECT_SHARES)]
        self._size = sum(share.size for share in shares)
        self._open = Counter({share.station: share.open_size for share in shares if share.open_size})
        return shares

    # --- reading ----------------------------------------------------------------------------------------

    def _pages(self, session: SessionRow, last: int) -> Iterator[Record]:
        pages = pages_of(self._database, session, last)
        while True:
            with self._writing, translated(self.path):
                page = next(pages, None)
            if page is None:
                return
            for row in page:
                yield record_of(session.key, row)


def _parts(rows: Sequence[T]) -> Iterator[Sequence[T]]:
    """As few as there are statements for."""
    first = 0
    for size in _AT_ONCE:
        while len(rows) - first >= size:
            yield rows[first : first + size]
            first += size
