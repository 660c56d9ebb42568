"""Writes a session's records and outcome to the journal; writes nothing during a replay."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from caesura_protocol.messages import SampleBatch
from caesura_service.journal import Journal, JournalError, Outcome, Record, Recordable


class SessionJournal:
    """Those of one session."""

    def __init__(self, station: str, session: str, journal: Journal) -> None:
        self._station, self._session = station, session
        self._journal: Journal | None = journal
        self._missed = False

    @contextmanager
    def withheld(self) -> Iterator[None]:
        """While the context lasts nothing is recorded: it comes from the records."""
        journal, self._journal = self._journal, None
        try:
            yield
        finally:
            self._journal = journal

    @property
    def are_kept(self) -> bool:
        """Of a closed session: does the journal still have them?"""
        if self._journal is None:
            return True
        return any(copy.closed for copy in self._journal.copies(self._station, self._session))

    def append(self, message: Recordable, now: float) -> None:
        """A batch is safe soon, everything else at once. Raises JournalError; nothing has changed then."""
        if self._journal is None:
            return
        is_batch = isinstance(message, SampleBatch)
        try:
            self._journal.append(Record(self._station, self._session, now, message), now=not is_batch)
        except JournalError:
            self._missed |= is_batch
            raise

    def has_missed_batches(self) -> bool:
        """Did a batch come since this was last asked that could not be recorded?"""
        missed, self._missed = self._missed, False
        return missed

    def commit(self) -> None:
        """All of it is safe behind this. Raises JournalError."""
        if self._journal is not None:
            self._journal.commit()

    def conclude(self, outcome: Outcome) -> None:
        """Let the journal keep how it ended; without that it is replayed."""
        if self._journal is not None:
            with suppress(JournalError):
                self._journal.conclude(self._station, outcome)
