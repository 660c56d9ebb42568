"""Writes a session's records and outcome to the journal; writes nothing during a replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from caesura_protocol.messages import Edit, EditProgram, SampleBatch
from caesura_service.journal import EncodedBatch, Journal, JournalError, Outcome, Record, Recordable
from caesura_service.sessions.same_layout_batches import BatchBlock


class SessionJournal:
    """The journal's records of one session."""

    def __init__(
        self, station: str, session: str, journal: Journal, check_current: Callable[[], None]
    ) -> None:
        """check_current: raises JournalError if another instance owns the station now."""
        self._station, self._session = station, session
        self._journal: Journal | None = journal
        self._check_current = check_current
        self._is_copying = False
        self._missed = False

    @contextmanager
    def copying(self) -> Iterator[None]:
        """Record another instance's records during the context, without a check of the station's owner."""
        self._is_copying = True
        try:
            yield
        finally:
            self._is_copying = False

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Suspend recording while the context lasts, as during a replay."""
        journal, self._journal = self._journal, None
        try:
            yield
        finally:
            self._journal = journal

    def exist(self, edits: int, neutral_changes: int) -> bool:
        """Whether the journal has the records of a closed session, with at least these numbers of changes.

        neutral_changes: descriptions and edits of the program. An incomplete copy of a peer's records has
        fewer: a record appended to it would take the place of a missing one.
        """
        if self._journal is None:
            return True
        return any(
            copy.closed and copy.edits >= edits and copy.described >= neutral_changes
            for copy in self._journal.copies(self._station, self._session)
        )

    def edit_at(self, kind: type[Edit] | type[EditProgram], revision: int) -> Edit | EditProgram | None:
        """Return the edit of the session, or of its program, at a revision. Raises JournalError."""
        if self._journal is None:
            return None
        return self._journal.edit_at(self._station, self._session, kind, revision)

    def append(self, message: Recordable, now: float) -> None:
        """Append a message; all except batches are on disk on return.

        Raises JournalError and then changes nothing. Any instance may record batches, which are equal; other
        messages are refused if another instance owns the station.
        """
        if self._journal is None:
            return
        is_batch = isinstance(message, SampleBatch)
        if not is_batch and not self._is_copying:
            self._check_current()
        try:
            self._journal.append(Record(self._station, self._session, now, message), now=not is_batch)
        except JournalError:
            self._missed |= is_batch
            raise

    def append_batches(self, block: BatchBlock, count: int, now: float) -> int:
        """Append the first batches of a block, `count` at most; return their number.

        Raises JournalError if the first one cannot be appended.
        """
        if self._journal is None:
            return count
        epoch = block.layout.message.epoch
        for number, payload in enumerate(block.payloads[:count]):
            try:
                self._journal.append_batch(
                    self._station, self._session, now, EncodedBatch(epoch, block.first + number, payload)
                )
            except JournalError:
                if number:
                    return number
                self._missed = True
                raise
        return count

    def has_missed_batches(self) -> bool:
        """Return whether a batch could not be recorded since the last call."""
        missed, self._missed = self._missed, False
        return missed

    def commit(self) -> None:
        """Write all records to disk. Raises JournalError."""
        if self._journal is not None:
            self._journal.commit()

    def store_outcome(self, outcome: Outcome) -> None:
        """Store the outcome of a closed session; one without an outcome is replayed."""
        if self._journal is not None:
            with suppress(JournalError):
                self._journal.store_outcome(self._station, outcome)
