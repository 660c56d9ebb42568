"""Reads the journals of other instances in the same directory.

They are read while their owners run, hang or are dead, and are never written. A journal that is damaged or of
another version counts as absent, and is logged once. A journal that the system does not allow to be read
(locked, no permission, a failing disk) is an error for UNREADABLE_S: it may contain acknowledged corrections.
After that it counts as absent, so that one file cannot keep all stations from being served. If the directory
cannot be listed, the existing sessions are unknown, which is an error. Only instances on one machine may
share a directory: SQLite's log does not work over a network file system.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, TypeVar
from urllib.parse import quote

from caesura_protocol.errors import ProtocolError
from caesura_service.journal.applied_edits import AppliedEdit
from caesura_service.journal.journal import (
    Copy,
    JournalDamagedError,
    JournalEmptyError,
    JournalError,
    JournalForeignError,
    Outcome,
    PeerJournalError,
    Record,
    Recordable,
)
from caesura_service.journal.rows import (
    Stored,
    changes_of,
    copies_in,
    edits_of,
    epoch_in,
    last_opened_in,
    outcome_of,
    record_of,
    stations_in,
    verify,
)
from caesura_service.journal.sqlite_database import check
from caesura_service.journal.sqlite_errors import RAISE_LIMIT, TOO_MANY_FILES, map_sqlite_errors
from caesura_service.journal.sqlite_statements import (
    SELECT_BEYOND,
    SELECT_CHANGES,
    SELECT_EDITS,
    SELECT_OUTCOME,
)

logger = logging.getLogger(__name__)

SUFFIX = ".sqlite"
WARNED = 256  # errors that are remembered
BUSY_S = 0.5  # for an owner that is just starting; a journal that stays locked is waited for once
UNREADABLE_S = 30.0  # that stations wait for a journal that cannot be read; a bridge keeps its samples longer
IN_ITS_CONTENT = (JournalDamagedError, JournalEmptyError, JournalForeignError)  # errors that stay
T = TypeVar("T")


class PeerCopy(NamedTuple):
    """A peer's copy of a session."""

    path: Path
    copy: Copy


class PeerJournals:
    """Every journal in the directory of `own` except that one; none if `own` is None.

    Every method that looks for journals raises JournalError if the directory cannot be listed, and
    PeerJournalError while a journal cannot be read.
    """

    def __init__(self, own: Path | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._own = own
        self._clock = clock
        self._unreadable: dict[Path, tuple[float, float]] = {}  # since when, and at the last look [s]
        self._warned: set[str] = set()

    @property
    def is_complete(self) -> bool:
        """Whether every existing journal could be read at the last access."""
        return all(map(_is_gone, tuple(self._unreadable)))

    def copies(self, station: str | None = None, session: str | None = None) -> list[PeerCopy]:
        """Return the peers' copies of every session, of a station's, or of one."""
        return [
            PeerCopy(path, copy)
            for path in self._paths()
            for copy in self._query(path, lambda kept: copies_in(kept, station, session)) or ()
        ]

    def stations(self) -> frozenset[str]:
        """Return the stations with a session in a peer journal that can be read."""
        known: set[str] = set()
        for path in self._paths():
            with suppress(PeerJournalError):
                known.update(self._query(path, stations_in) or ())
        return frozenset(known)

    def epoch_of(self, station: str) -> int:
        """Return the highest epoch of a station in the peer journals; -1 without one."""
        asked = (self._query(path, lambda kept: epoch_in(kept, station)) for path in self._paths())
        return max((epoch for epoch in asked if epoch is not None), default=-1)

    def readable_epochs_of(self, stations: Iterable[str]) -> Mapping[str, int]:
        """Return the highest epoch of each station in the peer journals that can be read; -1 without one."""
        highest = dict.fromkeys(stations, -1)
        for path in self._paths():
            with suppress(PeerJournalError):
                found = self._query(path, lambda kept: {name: epoch_in(kept, name) for name in highest})
                for name, epoch in (found or {}).items():
                    highest[name] = max(highest[name], epoch)
        return highest

    def last_opened(self, station: str) -> float | None:
        """Return the time [s] at which a peer last opened a session of a station; None without one."""
        asked = (self._query(path, lambda kept: last_opened_in(kept, station)) for path in self._paths())
        return max((opened for opened in asked if opened is not None), default=None)

    def outcome(self, found: PeerCopy) -> Outcome | None:
        """Return the outcome of a session; None if there is none or it is unreadable."""
        row = self._query(found.path, lambda kept: kept.execute(SELECT_OUTCOME, found.copy.key).fetchone())
        try:
            return outcome_of(found.copy.key, row) if row else None
        except JournalDamagedError as damage:
            self._warn_once(JournalDamagedError(f"{found.path}: {'/'.join(found.copy.key)}: {damage}"))
            return None

    def edits(self, found: PeerCopy) -> tuple[AppliedEdit, ...]:
        """Return the edits of a copy, oldest first; none if they cannot be read."""
        try:
            rows = self._query(found.path, lambda kept: kept.execute(SELECT_EDITS, found.copy.key).fetchall())
            return edits_of(found.copy.key, rows or ())
        except (JournalDamagedError, ProtocolError) as error:
            self._warn_once(error)
            return ()

    def changes(self, found: PeerCopy) -> tuple[Recordable, ...]:
        """Return the edits, descriptions and program edits of a copy, oldest first.

        Raises JournalError, and ProtocolError where one is unreadable.
        """
        key = found.copy.key
        rows = self._query(found.path, lambda kept: kept.execute(SELECT_CHANGES, key).fetchall())
        return changes_of(key, rows or ())

    def records(self, found: PeerCopy, first_seq: int = 0) -> Iterator[Record]:
        """Yield a copy's records without batches before `first_seq`, with those appended meanwhile.

        Ends early if the journal is damaged.
        """
        wanted = {"station": found.copy.station, "session": found.copy.session, "first_seq": first_seq}
        place = -1
        try:
            with open_for_reading(found.path) as kept:
                while page := kept.execute(SELECT_BEYOND, {**wanted, "place": place}).fetchall():
                    for row in page:
                        yield record_of(found.copy.key, verify(found.copy.key, Stored(*row)))
                    place = page[-1][0]
        except ProtocolError as error:
            self._warn_once(error)
        except JournalError as error:
            self._pass_over(found.path, error)

    def _paths(self) -> list[Path]:
        own = self._own
        return [] if own is None else [path for path in journals_in(own.parent) if path != own]

    def _query(self, path: Path, question: Callable[[sqlite3.Connection], T]) -> T | None:
        try:
            with open_for_reading(path, 0.0 if path in self._unreadable else BUSY_S) as kept:
                answer = question(kept)
        except JournalError as error:
            self._pass_over(path, error)
            return None
        self._unreadable.pop(path, None)
        return answer

    def _pass_over(self, path: Path, error: JournalError) -> None:
        """Log that a journal counts as absent.

        Raises PeerJournalError if it is unreadable for less than UNREADABLE_S.
        """
        self._warn_once(error)
        if isinstance(error, IN_ITS_CONTENT) or _is_gone(path):
            self._unreadable.pop(path, None)
            return
        now = self._clock()
        since, last = self._unreadable.get(path, (now, now))
        if now - last > UNREADABLE_S:  # there was no look in between
            since = now
        self._unreadable[path] = since, now
        if now - since < UNREADABLE_S:
            raise PeerJournalError(str(error)) from error
        if last - since < UNREADABLE_S:  # this is the first look after that time
            logger.error(
                "journal %s could not be read for %g s and counts as absent from now on: stations are served "
                "without the corrections that only it has",
                path,
                UNREADABLE_S,
            )

    def _warn_once(self, error: Exception) -> None:
        """Log each error once: the journals are polled.

        A journal that its owner is about to create is no error.
        """
        if not isinstance(error, JournalEmptyError) and str(error) not in self._warned:
            logger.warning("skipped: %s", error)
            if len(self._warned) >= WARNED:
                self._warned.clear()
            self._warned.add(str(error))


def journals_in(directory: Path) -> list[Path]:
    """Return the journals in a directory; none if the directory does not exist. Raises JournalError.

    `Path.glob` would treat a directory that this user may not list as empty.
    """
    try:
        return sorted(directory / name for name in os.listdir(directory) if name.endswith(SUFFIX))
    except FileNotFoundError:
        return []
    except OSError as error:
        is_limit = error.errno in TOO_MANY_FILES
        remedy = RAISE_LIMIT if is_limit else f"let this user read it, or look after its disk ({error})"
        raise JournalError(f"journal directory {directory} cannot be listed: {remedy}") from error


def _is_gone(path: Path) -> bool:
    try:
        path.stat()
    except FileNotFoundError:
        return True
    except OSError:
        pass
    return False


@contextmanager
def open_for_reading(path: Path, busy_s: float = BUSY_S) -> Iterator[sqlite3.Connection]:
    """Open an existing journal for reading. Raises JournalError.

    busy_s: how long it waits for another process that has locked it.
    """
    with map_sqlite_errors(path):
        where = (
            f"file:{quote(str(path))}?mode=rw"  # a reader shares the log with the writer, if only to read it
        )
        kept = sqlite3.connect(where, uri=True, timeout=busy_s, isolation_level=None, check_same_thread=False)
        with closing(kept):
            check(kept, path)
            kept.execute("PRAGMA query_only = ON")
            yield kept
