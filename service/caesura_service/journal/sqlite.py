"""A journal on disk: SQLite in WAL mode, one file an instance, many records a commit.

Records wait in memory, in order, and are written together: at most `commit_s` after the first of them,
by a thread of the journal's own, or at once where somebody must know them safe. A killed process loses
what waited; a killed machine no more, for every commit reaches the disk (synchronous FULL).

When writing fails, what waits is kept and tried again, and until it is written every further append is
refused with the reason: a session that is not journalled does not go on.

Closed sessions stay until they are too old or too much, oldest first. Open ones are never dropped for
their size, and for their age only once nobody has touched them for so long.
"""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, closing, suppress
from itertools import chain, islice
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_WHOLE_BYTES, JournalReport
from caesura_service.journal.checksums import checksum
from caesura_service.journal.damage import damage_of, mended, readable, set_aside
from caesura_service.journal.dropping import drop_some, hide
from caesura_service.journal.edits import Edit
from caesura_service.journal.journal import Copy, JournalDamagedError, JournalError, Key, Outcome, Record
from caesura_service.journal.keeping import GB, JournalSettings, Kept, overdue, sizes_of
from caesura_service.journal.rows import (
    ROW_BYTES,
    Row,
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
    SELECT_CLOSED,
    SELECT_EDITS,
    SELECT_EXTENT,
    SELECT_KEPT,
    SELECT_LAST,
    SELECT_OUTCOME,
    SELECT_ROWS,
    SELECT_SESSIONS,
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
PAUSE_S = 0.02  # between two portions of what is dropped, where a service may want to write
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
        self._waiting: list[Row] = []
        self._waiting_bytes = 0
        self._guard = threading.Lock()  # of what waits; never held while the disk works
        self._writing = threading.RLock()  # of the database
        self._trouble: JournalError | None = None
        self._size = 0  # [bytes] as of the last look
        self._open: Counter[str] = Counter()  # [bytes] of each station's open sessions, since the last look
        self._seen: set[Key] = set()  # at the last look
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
            stack.callback(self.commit)
            if not self._alone:
                stack.callback(self._drop_the_rest)
            thread = threading.Thread(target=self._run, name="caesura-journal", daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(self._wake.set)
            stack.callback(self._over.set)
            self._seen = {row.key for row in self._look()}
            self._wake.set()  # for what somebody began to drop
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
        """Keep how a session ended; what is too large to be asked for is replayed instead."""
        key = (station, outcome.opening.session)
        opening = encode(outcome.opening).payload
        try:
            snapshot = encode(outcome.snapshot, limit=MAX_WHOLE_BYTES).payload
        except ProtocolError as error:
            logger.warning("the outcome of %s is not kept, it will be replayed: %s", "/".join(key), error)
            return
        self.commit()
        with self._writing, translated(self.path), transaction(self._database):
            crc = checksum(*key, opening, outcome.last_seq, snapshot)
            self._database.execute(INSERT_OUTCOME, (opening, outcome.last_seq, snapshot, crc, *key))

    def outcome(self, station: str, session: str) -> Outcome | None:
        """How a session ended; None where an older version wrote it in another form."""
        with self._writing, translated(self.path):
            found = self._database.execute(SELECT_OUTCOME, (station, session)).fetchone()
        return None if found is None else outcome_of((station, session), *found)

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
        logger.error("journal %s: %s; the session is set aside as %s/%s", self.path, why, row.station, aside)
        return str(aside)

    def forget(self, station: str, session: str) -> None:
        """Drop a session; most of its records are deleted by and by.

        Also where nothing can be written that needs room: dropping may make it.
        """
        key = station, session
        with self._writing:
            with suppress(JournalError):
                self.commit()
            with translated(self.path), transaction(self._database):
                hide(self._database, key)
            with self._guard:
                self._waiting = [row for row in self._waiting if row.key != key]
                self._waiting_bytes = sum(row.size for row in self._waiting)
        self._seen.discard(key)
        self._has_dropped = True
        self._wake.set()

    def tidy(self, now: float) -> Mapping[Key, str]:
        """Drop at most one session, and tell of those that somebody else has dropped.

        Whoever asks works, and does not wait for the disk: nothing is done while something is being written,
        but for every PATIENCE-th time.
        """
        self._put_off += 1
        if not self._writing.acquire(blocking=self._put_off >= PATIENCE):
            return {}
        try:
            self._put_off = 0
            known = self._look()
        finally:
            self._writing.release()
        gone = dict.fromkeys(self._seen - {row.key for row in known}, "deleted by somebody")
        self._seen = {row.key for row in known}
        for row, why in islice(overdue(known, self.settings, now), 1):
            with suppress(JournalError):  # it is tried again at the next look
                self.forget(*row.key)
                gone[row.key] = why
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

    def _append(self, row: Row) -> None:
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

    def _append_now(self, row: Row) -> None:
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

    def _write(self, rows: Sequence[Row]) -> None:
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

    def _succeed(self, rows: list[Row]) -> None:
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
            with suppress(JournalError):  # said when it began; it has woken this thread for another attempt
                self.commit()
            try:
                more = self._drop_some()
            except JournalError:  # somebody else is writing
                more = True
                self._over.wait(RETRY_S)
            if more:
                self._wake.set()

    def _drop_some(self) -> bool:
        """Go on with what is dropped, by whomever."""
        with self._writing, translated(self.path):
            return drop_some(self._database)

    def _drop_the_rest(self) -> None:
        """No service may be there to do it; one that is can write in between."""
        with suppress(JournalError):
            while self._has_dropped and self._drop_some():
                threading.Event().wait(PAUSE_S)

    # --- keeping ----------------------------------------------------------------------------------------

    def _look(self) -> list[Kept]:
        """Every session, the one that was touched longest ago first."""
        with self._writing, translated(self.path):
            known = [Kept(*row) for row in self._database.execute(SELECT_KEPT)]
        self._size = sum(row.size for row in known)
        self._open = sizes_of([row for row in known if not row.closed])
        return known

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
