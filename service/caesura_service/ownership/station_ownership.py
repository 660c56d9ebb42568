"""The stations that this instance owns, under which epoch, and those being taken over.

A takeover sets the epoch: the time of day [ms], raised above every epoch under which this instance or one
beside it ever had the station. So the last owner has the highest epoch, whatever the clock did.
"""

from __future__ import annotations

from collections.abc import Set
from contextlib import suppress

from caesura_service.journal import Journal, JournalError
from caesura_service.ownership.session_copies import JournalSet
from caesura_service.publishing.events import Owner


class StationOwnership:
    """Stations by name."""

    def __init__(self, me: Owner, own: Journal, journals: JournalSet) -> None:
        """me: this instance, with the lowest epoch that it publishes under."""
        self.served: Set[str] | None = None  # the stations of this instance; None: all
        self._me = me
        self._own = own
        self._journals = journals
        self._owners: dict[str, Owner] = {}  # ourselves, by station
        self._barred: set[str] = set()

    def owner(self, station: str, now: float) -> Owner:
        """Ourselves at a station, which is taken where it has not been."""
        return self._owners.get(station) or self.acquire(station, now)

    def acquire(self, station: str, now: float) -> Owner:
        """Take a station, perhaps once more, under a higher epoch than any owner had."""
        before = self._owners.get(station, Owner(self._me.instance, self._me.epoch - 1)).epoch
        last = max(before, self._journals.epoch_of(station))
        owner = Owner(self._me.instance, max(int(now * 1000), last + 1))
        self._owners[station] = owner
        with suppress(JournalError):  # which the journal has said already
            self._own.keep_epoch(station, owner.epoch)
        return owner

    def leave(self, station: str) -> None:
        """The station is another's."""
        self._owners.pop(station, None)
        self._barred.discard(station)

    def bar(self, station: str) -> None:
        """The station is about to be taken."""
        self._barred.add(station)

    def unbar(self, station: str) -> None:
        """It is taken, or that was given up."""
        self._barred.discard(station)

    def is_barred(self, station: str) -> bool:
        """Is it just being taken?"""
        return station in self._barred

    def elsewhere(self, station: str) -> str | None:
        """Why the station is not served here and now; None where it is."""
        if self.served is not None and station not in self.served:
            return "another instance serves this station: try again"
        return "the station is being taken over: try again" if station in self._barred else None
