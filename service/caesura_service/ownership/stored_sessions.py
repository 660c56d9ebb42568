"""Closed sessions that are no longer in memory: their outcomes, read from the journal page by page.

An instance answers for the stations that it serves, from its own journal. A session whose outcome was not
written, or is only in another instance's journal, is not listed and does not count for a page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice

from caesura_protocol.keys import StoredPage
from caesura_protocol.messages import Program, Snapshot
from caesura_service.cooperative_scheduler import give_way
from caesura_service.journal import Journal, Key
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.program_edits import at_edit, log_of, with_edits

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
        self, matches: Callable[[Key], bool], wanted: StoredPage, station: str | None = None
    ) -> Iterator[Snapshot]:
        """Yield the outcomes of a page, the newest session first; at most PAGE_BYTES. Raises JournalError.

        station: the one whose sessions match, so that those of others cost nothing; None: of any.
        """
        outcomes = self._journal.outcomes(station)
        asked = (one for one in outcomes if matches(one.key) and self.answers_for(*one.key))
        size, left = 0, wanted.limit
        for one in islice(asked, wanted.skip, None):
            size += one.size
            if not left or size > max(PAGE_BYTES, one.size):
                return
            if (outcome := self._journal.outcome(*one.key)) is not None:
                left -= 1
                yield _edited(outcome.snapshot, wanted.edits)

    def has(self, station: str, session: str) -> bool:
        """Whether the journal has the outcome of a session that is not in memory. Raises JournalError."""
        return self.answers_for(station, session) and self._journal.outcome(station, session) is not None

    def program(self, station: str, session: str) -> Program | None:
        """Return the program of an outcome, with its edits; None without one. Raises JournalError."""
        outcome = self._journal.outcome(station, session)
        return None if outcome is None else _edited(outcome.snapshot).program


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
