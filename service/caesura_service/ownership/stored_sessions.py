"""Closed sessions that are no longer in memory: their outcomes, read from the journal page by page.

An instance answers for the stations that it serves, from its own journal. A session whose outcome was not
written, is damaged, or is only in another instance's journal, does not count for a page. The report on the
journal lists those without an undamaged outcome (`journal/damaged_sessions.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

from caesura_protocol.keys import StoredPage
from caesura_protocol.messages import Program, Snapshot
from caesura_service.cooperative_scheduler import give_way
from caesura_service.journal import Journal, JournalDamagedError, JournalUnreadableError, Key, Outcome
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.program_edits import at_edit, log_of, with_edits

PASSED = 100  # sessions that are listed between two places to give way
PAGE_BYTES = 1 << 26  # of the records of a page's sessions, beyond the first


class StoredSessions:
    """The outcomes of stored sessions. Any thread may call the methods."""

    def __init__(
        self, journal: Journal, index: Callable[[], SessionIndex], serves: Callable[[str], bool]
    ) -> None:
        """index: the sessions of this instance; serves: returns whether this instance owns a station."""
        self._journal, self._index, self._serves = journal, index, serves

    def answers_for(self, station: str, session: str) -> bool:
        """Whether this instance owns the station, and the session is not in memory.

        Any thread may call it.
        """
        held = self._index().sessions.get(station, ())
        return self._serves(station) and all(one.name != session for one in held)

    def page(
        self,
        matches: Callable[[Key], bool],
        wanted: StoredPage,
        station: str | None = None,
        session: str | None = None,
    ) -> Iterator[Snapshot | None]:
        """Yield the outcomes of a page, the newest session first; at most PAGE_BYTES. Raises JournalError.

        station, session: names of all that match, so that others cost nothing; None: any. Yields None after
        every PASSED sessions, so that the caller can give way.
        """
        skipped, size, left = 0, 0, wanted.limit
        for passed, one in enumerate(self._journal.outcomes(station, session), 1):
            if passed % PASSED == 0:
                yield None
            if not (matches(one.key) and self.answers_for(*one.key)):
                continue
            if skipped < wanted.skip:
                skipped += 1
                continue
            size += one.size
            if size > max(PAGE_BYTES, one.size):
                return
            outcome = None
            with suppress(JournalUnreadableError):  # which the journal reports
                outcome = self._outcome(*one.key)
            if outcome is not None:
                yield _edited(outcome.snapshot, wanted.edits)
                left -= 1
            if not left:
                return

    def has(self, station: str, session: str) -> bool:
        """Whether the journal has the outcome of a session that is not in memory. Raises JournalError."""
        return self.answers_for(station, session) and self._outcome(station, session) is not None

    def program(self, station: str, session: str) -> Program | None:
        """Return the program of an outcome, with its edits; None without one. Raises JournalError."""
        outcome = self._outcome(station, session)
        return None if outcome is None else _edited(outcome.snapshot).program

    def _outcome(self, station: str, session: str) -> Outcome | None:
        """Return an outcome; None without one that can be read, which the journal reports."""
        with suppress(JournalDamagedError):
            return self._journal.outcome(station, session)
        return None


def _edited(snapshot: Snapshot, number: int | None = None) -> Snapshot:
    """Return the snapshot of an outcome with its program edits applied to the inferred program.

    An outcome has the inferred program and the list of its edits. number: the last edit to apply; None: all.
    """
    inferred, log = snapshot.program, log_of(snapshot.program)
    if number is None:
        program = with_edits(inferred, log, pause=give_way)
    else:
        program = at_edit(inferred, log, number, pause=give_way)
    return snapshot.model_copy(update={"program": program})
