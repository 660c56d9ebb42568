"""The own journal and those of other instances, to find the copy of a session that is furthest along."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from caesura_service.journal import Copy, Edit, Journal, Outcome, PeerCopy, PeerJournals, Record


class SessionCopies(NamedTuple):
    """What there is of one session; at least one of the two."""

    own: Copy | None
    furthest: PeerCopy | None  # among the siblings

    @property
    def best(self) -> Copy:
        """Return the copy that is furthest along; the local one if it has the same batches and edits."""
        return max(self._all, key=lambda copy: (copy.closed, copy.last_seq, copy.edits))

    @property
    def _all(self) -> list[Copy]:
        return [copy for copy in (self.own, self.furthest and self.furthest.copy) if copy]

    @property
    def opened(self) -> float:
        """[s]"""
        return min(copy.opened for copy in self._all)


class JournalSet:
    """Reads all, writes to the own one alone."""

    def __init__(self, own: Journal, siblings: PeerJournals) -> None:
        self._own = own
        self._siblings = siblings

    def stations(self) -> frozenset[str]:
        """Those with a session."""
        return self._siblings.stations().union(station for station, _ in self._own.sessions())

    def of(self, station: str, session: str | None = None) -> Mapping[str, SessionCopies]:
        """Every session of a station, or the one, in the order in which they were opened."""
        known = {copy.session: SessionCopies(copy, None) for copy in self._own.copies(station, session)}
        siblings = self._siblings.copies(station, session)
        for found in siblings:
            own, furthest = known.get(found.copy.session, SessionCopies(None, None))
            if furthest is None or found.copy.progress > furthest.copy.progress:
                known[found.copy.session] = SessionCopies(own, found)
        if not siblings:
            return known  # in order, whatever the clock did
        return dict(sorted(known.items(), key=lambda item: item[1].opened))

    def epoch_of(self, station: str) -> int:
        """Return the highest epoch under which any instance had the station; -1 if none had."""
        return max(self._own.epoch_of(station), self._siblings.epoch_of(station))

    def outcome(self, copies: SessionCopies) -> Outcome | None:
        """How the session ended, where the best copy has kept that."""
        if copies.furthest is not None and copies.best is copies.furthest.copy:
            return self._siblings.outcome(copies.furthest)
        return self._own.outcome(*copies.best.key)

    def own_records(self, copy: Copy) -> Iterator[Record]:
        """All that the own journal has of a session. Raises JournalError or ProtocolError on the way."""
        return self._own.replay(*copy.key)

    def own_edits(self, copy: Copy) -> Sequence[Edit]:
        """Those among them. Raises as `own_records`."""
        return self._own.edits(*copy.key) if copy.edits else ()

    def siblings_edits(self, found: PeerCopy) -> Sequence[Edit]:
        """Those that a sibling has of a session; none where they cannot be read."""
        return self._siblings.edits(found) if found.copy.edits else ()

    def siblings_records(self, found: PeerCopy, first_seq: int) -> Iterator[Record]:
        """What a sibling has of a session but batches before `first_seq`, as far as it can be read."""
        return self._siblings.records(found, first_seq)
