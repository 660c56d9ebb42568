"""The journals of other instances in the same directory, read as they are on disk.

They are read while their owners run, hang or are dead, and nothing is written to them. One that is damaged,
locked or of another version counts as not there, with one line in the log. Only instances on one machine may
share a directory: SQLite's log does not work over a network file system.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple, TypeVar
from urllib.parse import quote

from caesura_protocol.errors import ProtocolError
from caesura_service.journal.edits import Edit
from caesura_service.journal.journal import Copy, JournalError, Outcome, Record
from caesura_service.journal.rows import (
    Stored,
    copies_in,
    edits_of,
    epoch_in,
    outcome_of,
    record_of,
    stations_in,
    verified,
)
from caesura_service.journal.schema import (
    SELECT_BEYOND,
    SELECT_EDITS,
    SELECT_OUTCOME,
    check,
    translated,
)

logger = logging.getLogger(__name__)

BUSY_S = 0.5  # for an owner that is just starting
T = TypeVar("T")


class PeerCopy(NamedTuple):
    """A sibling's copy of a session."""

    path: Path
    copy: Copy


class PeerJournals:
    """Every journal in the directory of `own` except that one; none if `own` is None."""

    def __init__(self, own: Path | None) -> None:
        self._own = own
        self._said: set[str] = set()

    def copies(self, station: str | None = None, session: str | None = None) -> list[PeerCopy]:
        """What they have of every session, of those of one station, or of one."""
        return [
            PeerCopy(path, copy)
            for path in self._paths()
            for copy in self._ask(path, lambda kept: copies_in(kept, station, session)) or ()
        ]

    def stations(self) -> frozenset[str]:
        """Those that one of them has a session of."""
        asked = (self._ask(path, stations_in) for path in self._paths())
        return frozenset(station for known in asked for station in known or ())

    def epoch_of(self, station: str) -> int:
        """The highest epoch under which one of them had the station; -1 if none had."""
        asked = (self._ask(path, lambda kept: epoch_in(kept, station)) for path in self._paths())
        return max((epoch for epoch in asked if epoch is not None), default=-1)

    def outcome(self, found: PeerCopy) -> Outcome | None:
        """How a session ended, where that was kept and can be read."""
        row = self._ask(found.path, lambda kept: kept.execute(SELECT_OUTCOME, found.copy.key).fetchone())
        return outcome_of(found.copy.key, *row) if row else None

    def edits(self, found: PeerCopy) -> tuple[Edit, ...]:
        """Those of the copy, oldest first; none where they cannot be read."""
        try:
            rows = self._ask(found.path, lambda kept: kept.execute(SELECT_EDITS, found.copy.key).fetchall())
            return edits_of(found.copy.key, rows or ())
        except (JournalError, ProtocolError) as error:
            self._say(error)
            return ()

    def records(self, found: PeerCopy, first_seq: int = 0) -> Iterator[Record]:
        """What the copy has but batches before `first_seq`, with what is appended meanwhile.

        Ends early where the journal cannot be read.
        """
        wanted = {"station": found.copy.station, "session": found.copy.session, "first_seq": first_seq}
        place = -1
        try:
            with opened_for_reading(found.path) as kept:
                while page := kept.execute(SELECT_BEYOND, {**wanted, "place": place}).fetchall():
                    for row in page:
                        yield record_of(found.copy.key, verified(found.copy.key, Stored(*row)))
                    place = page[-1][0]
        except (JournalError, ProtocolError) as error:
            self._say(error)

    def _paths(self) -> list[Path]:
        own = self._own
        return [] if own is None else sorted(path for path in own.parent.glob("*.sqlite") if path != own)

    def _ask(self, path: Path, question: Callable[[sqlite3.Connection], T]) -> T | None:
        try:
            with opened_for_reading(path) as kept:
                return question(kept)
        except JournalError as error:
            self._say(error)
            return None

    def _say(self, error: Exception) -> None:
        """Once: it is looked at again and again."""
        if str(error) not in self._said:
            logger.warning("passed over: %s", error)
            self._said.add(str(error))


@contextmanager
def opened_for_reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A journal for reading, which is not made where there is none. Raises JournalError."""
    with translated(path):
        where = (
            f"file:{quote(str(path))}?mode=rw"  # a reader shares the log with the writer, if only to read it
        )
        kept = sqlite3.connect(where, uri=True, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
        with closing(kept):
            check(kept, path)
            kept.execute("PRAGMA query_only = ON")
            yield kept
