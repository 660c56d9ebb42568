"""Reads the own journal and its peers, to find the copy of a session that is furthest along."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from typing import NamedTuple

from caesura_protocol.errors import ProtocolError
from caesura_service.journal import (
    AppliedEdit,
    Changes,
    Copy,
    Journal,
    JournalDamagedError,
    JournalMalformedError,
    Outcome,
    PeerCopy,
    PeerJournals,
    Record,
    Refused,
    last_owned,
    refused_in,
)


class SessionCopies(NamedTuple):
    """The valid copies of a session: the own one and the furthest peer one; at least one of the two."""

    own: Copy | None
    peer: PeerCopy | None  # the furthest one among the peer journals
    refused: Refused | None = None  # what the own copy has that was refused: until that is gone, it is None
    batches: PeerCopy | None = None  # the furthest peer copy of which a change was refused: its batches count

    @property
    def best(self) -> Copy:
        """Return the copy that is furthest along (`Copy.progress`); the own one if the peer's has no more."""
        return max(self._all, key=lambda copy: copy.progress[:-1])

    @property
    def _all(self) -> list[Copy]:
        return [copy for copy in (self.own, self.peer and self.peer.copy) if copy]

    @property
    def edits(self) -> int:
        """The larger number of edits of the two copies."""
        return max(copy.edits for copy in self._all)

    @property
    def described(self) -> int:
        """The larger number of changes of the description and edits of the program, of the two copies."""
        return max(copy.described for copy in self._all)

    @property
    def opened(self) -> float:
        """The time of the first record [s]."""
        return min(copy.opened for copy in self._all)


class JournalSet:
    """Reads the own journal and those of the peers; writes to none of them."""

    def __init__(self, own: Journal, peers: PeerJournals) -> None:
        self._own = own
        self._peers = peers

    @property
    def is_complete(self) -> bool:
        """Whether every journal could be read at the last access."""
        return self._peers.is_complete

    def stations(self) -> frozenset[str]:
        """Return the stations with a session."""
        return self._peers.stations().union(station for station, _ in self._own.sessions())

    def names(self, station: str) -> Set[str]:
        """Return the names of a station's sessions, without a comparison of their copies."""
        copies = [*self._own.copies(station), *(found.copy for found in self._peers.copies(station))]
        return {copy.session for copy in copies}

    def copies_of_station(self, station: str, session: str | None = None) -> Mapping[str, SessionCopies]:
        """Return the copies of a station's sessions, or of one, in the order of their opening."""
        own = {copy.session: copy for copy in self._own.copies(station, session)}
        peers: dict[str, list[PeerCopy]] = {}
        for found in self._peers.copies(station, session):
            peers.setdefault(found.copy.session, []).append(found)
        known = {name: self._that_count(own.get(name), peers.get(name, ())) for name in {**own, **peers}}
        if not peers:
            return known  # in order, whatever the clock did
        return dict(sorted(known.items(), key=lambda item: item[1].opened))

    def _that_count(self, own: Copy | None, peers: Sequence[PeerCopy]) -> SessionCopies:
        copies: list[Copy | PeerCopy] = [*peers] if own is None else [own, *peers]
        last = last_owned(copies, _extent)
        counting: list[PeerCopy] = []
        others: list[PeerCopy] = []
        for peer in peers:
            (others if self._refused_in(peer, last) else counting).append(peer)
        refused = self._refused_in(own, last) if own else None
        return SessionCopies(None if refused else own, _furthest(counting), refused, _furthest(others))

    def _refused_in(self, one: Copy | PeerCopy, last: Copy | PeerCopy) -> Refused | None:
        return refused_in(_extent(one), _extent(last), lambda: (self._changes(one), self._changes(last)))

    def _changes(self, copy: Copy | PeerCopy) -> Changes | None:
        """Return the changes of a copy; None where one is damaged. Raises JournalError."""
        try:
            if isinstance(copy, PeerCopy):
                return Changes.of(self._peers.changes(copy))
            return Changes.of(self._own.changes(*copy.key))
        except (JournalDamagedError, ProtocolError):  # which the replay of the session reports
            return None

    def epoch_of(self, station: str) -> int:
        """Return the highest epoch under which any instance owned the station; -1 if none did."""
        return max(self._own.epoch_of(station), self.peer_epoch_of(station))

    def peer_epoch_of(self, station: str) -> int:
        """Return the highest epoch under which another instance owned the station; -1 if none did."""
        return self._peers.epoch_of(station)

    def readable_peer_epochs_of(self, stations: Iterable[str]) -> Mapping[str, int]:
        """Return the highest epoch of another instance at each station that can be read; -1 if none can."""
        return self._peers.readable_epochs_of(stations)

    def peer_last_opened(self, station: str) -> float | None:
        """Return when another instance last opened a session of the station [s]; None where none did."""
        return self._peers.last_opened(station)

    def outcome(self, copies: SessionCopies) -> Outcome | None:
        """Return the outcome that the best copy has; None without one."""
        if copies.peer is not None and copies.best is copies.peer.copy:
            return self._peers.outcome(copies.peer)
        return self.own_outcome(copies.best)

    def own_outcome(self, copy: Copy) -> Outcome | None:
        """Return the outcome in the own journal; None without one that can be read. Raises JournalError."""
        try:
            return self._own.outcome(*copy.key)
        except JournalMalformedError:
            self._own.check_readable()  # else it could be read again later
        with suppress(JournalMalformedError):
            return self._own.outcome(*copy.key)
        return None

    def own_records(self, copy: Copy) -> Iterator[Record]:
        """Return the own journal's records of a session.

        Raises JournalError or ProtocolError while iterating.
        """
        return self._own.replay(*copy.key)

    def own_edits(self, copy: Copy) -> Sequence[AppliedEdit]:
        """Return the edits among the own journal's records. Raises as `own_records`."""
        return self._own.edits(*copy.key) if copy.edits else ()

    def peer_edits(self, found: PeerCopy) -> Sequence[AppliedEdit]:
        """Return a peer's edits of a session; none where they are damaged. Raises PeerJournalError."""
        return self._peers.edits(found) if found.copy.edits else ()

    def peer_records(self, found: PeerCopy, first_seq: int) -> Iterator[Record]:
        """Return a peer's records of a session without batches before `first_seq`, up to a damaged one.

        Raises PeerJournalError while iterating.
        """
        return self._peers.records(found, first_seq)


def _extent(copy: Copy | PeerCopy) -> Copy:
    return copy.copy if isinstance(copy, PeerCopy) else copy


def _furthest(copies: Sequence[PeerCopy]) -> PeerCopy | None:
    return max(copies, key=lambda found: found.copy.progress, default=None)
