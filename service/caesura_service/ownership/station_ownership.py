"""The stations that this instance owns, under which epoch, and those being taken over.

A takeover sets the epoch: the time of day [ms], raised above every epoch under which this instance or one
beside it ever owned the station. So the last owner has the highest epoch, whatever the clock did.
"""

from __future__ import annotations

from collections.abc import Set
from contextlib import suppress

from caesura_service.journal import Journal, JournalError, JournalSupersededError
from caesura_service.ownership.session_copies import JournalSet
from caesura_service.publishing.events import Owner


class StationOwnership:
    """The owned stations by name, with their epochs."""

    def __init__(self, me: Owner, own: Journal, journals: JournalSet) -> None:
        """me: this instance, with the lowest epoch that it publishes under."""
        self.served: Set[str] | None = None  # the stations of this instance; None: all
        self._instance = me
        self._own = own
        self._journals = journals
        self._owners: dict[str, Owner] = {}  # this instance with its epoch, by station
        self._taking_over: set[str] = set()
        self.superseded: set[str] = set()  # stations that another instance was found to have acquired since

    def owner(self, station: str, now: float) -> Owner:
        """Return this instance with its epoch at a station, which is acquired where it is not owned."""
        return self._owners.get(station) or self.acquire(station, now)

    def acquire(self, station: str, now: float) -> Owner:
        """Own a station under a higher epoch than any owner had. now: [s] time of day."""
        before = self._owners.get(station, Owner(self._instance.instance, self._instance.epoch - 1)).epoch
        last = max(before, self._journals.epoch_of(station))
        owner = Owner(self._instance.instance, max(int(now * 1000), last + 1))
        self._owners[station] = owner
        with suppress(JournalError):  # which the journal has logged already
            self._own.store_epoch(station, owner.epoch)
        return owner

    def is_superseded(self, station: str) -> bool:
        """Whether another instance has acquired the station since this one did. Raises JournalError."""
        mine = self._owners.get(station)
        return mine is not None and self._journals.peer_epoch_of(station) > mine.epoch

    def check_current(self, station: str) -> None:
        """Raise JournalSupersededError where another instance has acquired the station since.

        An instance that was frozen does not know that it lost its stations. What it recorded then would
        count as much as what their owner has acknowledged. A directory that cannot be read says nothing.
        """
        if self._is_known_superseded(station):
            self.superseded.add(station)
            raise JournalSupersededError("another instance has served the station meanwhile: try again")

    def _is_known_superseded(self, station: str) -> bool:
        try:
            return self.is_superseded(station)
        except JournalError:
            return False

    def release(self, station: str) -> None:
        """Release a station to another instance."""
        self._owners.pop(station, None)
        self.superseded.discard(station)
        self._taking_over.discard(station)

    def begin_takeover(self, station: str) -> None:
        """Reject messages of the station until `end_takeover`."""
        self._taking_over.add(station)

    def end_takeover(self, station: str) -> None:
        """Accept messages of the station again."""
        self._taking_over.discard(station)

    def in_takeover(self, station: str) -> bool:
        """Whether the station is being taken over."""
        return station in self._taking_over

    def stations_in_takeover(self) -> tuple[str, ...]:
        """Return the stations that are being taken over; any thread may ask."""
        return tuple(self._taking_over)

    def serves(self, station: str) -> bool:
        """Whether messages of the station are accepted now; any thread may ask."""
        return self.rejection_reason(station) is None

    def rejection_reason(self, station: str) -> str | None:
        """Return why messages of the station are rejected now; None where they are accepted."""
        if self.served is not None and station not in self.served:
            return "another instance serves this station: try again"
        return "the station is being taken over: try again" if station in self._taking_over else None
