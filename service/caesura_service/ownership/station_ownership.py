"""The stations that this instance owns, under which epoch, and those being taken over.

A takeover sets the epoch: the time of day [ms], or more, so that it exceeds every epoch under which this or
another instance ever owned the station. So the last owner has the highest epoch, also after a change of the
clock.
"""

from __future__ import annotations

from collections.abc import Set
from contextlib import suppress

from caesura_service.journal import Journal, JournalError, JournalSupersededError
from caesura_service.ownership.session_copies import JournalSet
from caesura_service.publishing.events import Owner

IN_TAKEOVER = "the station is being taken over"
SERVED_ELSEWHERE = "another instance has served the station meanwhile: try again"
STORED_LATE = "the journal could not store the station's owner until now: try again"


class StationOwnership:
    """The owned stations by name, with their epochs."""

    def __init__(self, me: Owner, own: Journal, journals: JournalSet) -> None:
        """me: this instance, with the lowest epoch under which it publishes."""
        self.served: Set[str] | None = None  # the stations of this instance; None: all
        self._instance = me
        self._own = own
        self._journals = journals
        self._owners: dict[str, Owner] = {}  # this instance with its epoch, by station
        self._taking_over: set[str] = set()
        self._behind: dict[str, str] = {}  # stations of which records are missing here, and why
        self._unstored: set[str] = set()  # stations whose epoch is not in the journal
        self._unmarked: set[str] = set()  # stations whose last completed takeover is not in the journal
        self.is_unlinked = False  # from the loss of the own link until the stations are assigned again
        self.is_settling = False  # from the start or a change of instances until all has been taken over
        self.superseded: set[str] = set()  # stations to take over again: another instance has served them

    def owner(self, station: str, now: float) -> Owner:
        """Return this instance with its epoch at a station; acquire a station that it does not own."""
        return self._owners.get(station) or self.acquire(station, now)

    def acquire(self, station: str, now: float) -> Owner:
        """Acquire a station under a higher epoch than any owner had. now: time of day [s]."""
        before = self._owners.get(station, Owner(self._instance.instance, self._instance.epoch - 1)).epoch
        last = max(before, self._journals.epoch_of(station))
        owner = Owner(self._instance.instance, max(int(now * 1000), last + 1))
        self._owners[station] = owner
        self._unstored.add(station)
        self._unmarked.discard(station)
        with suppress(JournalError):  # which the journal has logged already
            self._store_epochs(station)
        return owner

    def _store_epochs(self, station: str) -> None:
        """Store the station's epoch, and that of its last takeover, if an earlier attempt failed.

        Raises JournalError.
        """
        for unstored, store in (
            (self._unstored, self._own.store_epoch),
            (self._unmarked, self._own.store_takeover),
        ):
            if station in unstored:
                store(station, self._owners[station].epoch)
                unstored.discard(station)

    def is_superseded(self, station: str) -> bool:
        """Return whether another instance has acquired the station since this one did.

        Raises JournalError.
        """
        mine = self._owners.get(station)
        return mine is not None and self._journals.peer_epoch_of(station) > mine.epoch

    def check_current(self, station: str) -> None:
        """Raise JournalSupersededError if another instance has acquired the station since this one did.

        Called before any record except a batch is written, and again before it is acknowledged. The acquiring
        instance reads the journals after it has stored its epoch, so one of the two instances detects the
        other. An instance that was frozen has not noticed the loss of its stations, and its records would
        count as much as those of the owner. A journal that cannot be read is ignored. Raises JournalError if
        the own epoch, which the other instance must find, cannot be stored; JournalSupersededError if it is
        stored only now, as the last owner may have acknowledged more since the journals were read.
        """
        is_late = station in self._unstored
        self._store_epochs(station)
        if is_late or self._superseded_among({station}):
            self.superseded.add(station)
            raise JournalSupersededError(STORED_LATE if is_late else SERVED_ELSEWHERE)

    def release(self, station: str) -> None:
        """Release a station to another instance."""
        self._owners.pop(station, None)
        self.superseded.discard(station)
        self._taking_over.discard(station)
        self._unstored.discard(station)
        self._unmarked.discard(station)
        self._behind.pop(station, None)

    def fall_behind(self, station: str, why: str) -> None:
        """Reject messages of the station until `catch_up`, and request another takeover."""
        self._behind[station] = why
        self.superseded.add(station)

    def is_behind(self, station: str) -> bool:
        """Whether this instance lacks records of the station."""
        return station in self._behind

    def catch_up(self, station: str) -> None:
        """Record that this instance has all records of the station by other instances.

        From now on its own records count where those of an earlier owner differ. Not so without an epoch in
        the journal: the last owner goes on until it finds one, and `check_current` requests another takeover.
        """
        self._behind.pop(station, None)
        if station in self._unstored:
            return
        self._unmarked.add(station)
        with suppress(JournalError):  # it is stored before anything is recorded
            self._store_epochs(station)

    def may_be_behind(self, stations: Set[str]) -> Set[str]:
        """Return the stations that another instance may have served since; any thread may call it.

        This instance then does not answer queries for them: acknowledged corrections could be missing.
        """
        is_uncertain = self.is_unlinked or self.is_settling
        asked = stations if is_uncertain else stations & {*self._taking_over}
        behind = stations & {*self._behind}
        return behind | self._superseded_among(asked - behind)

    def _superseded_among(self, stations: Set[str]) -> Set[str]:
        """Return those that another instance has acquired since, according to the readable journals."""
        mine = {name: owner.epoch for name in stations if (owner := self._owners.get(name)) is not None}
        if not mine:
            return frozenset()
        try:
            last = self._journals.readable_peer_epochs_of(mine)
        except JournalError:
            return frozenset()
        return {name for name, epoch in mine.items() if last[name] > epoch}

    def begin_takeover(self, station: str) -> None:
        """Reject messages of the station until `end_takeover`."""
        self._taking_over.add(station)

    def begin_catching_up(self, station: str) -> None:
        """Reject messages of a station that another instance has acquired until `catch_up`."""
        if self.is_superseded(station):
            self._behind[station] = IN_TAKEOVER

    def end_takeover(self, station: str) -> None:
        """Accept messages of the station again."""
        self._taking_over.discard(station)

    def in_takeover(self, station: str) -> bool:
        """Whether the station is being taken over."""
        return station in self._taking_over or station in self._behind

    def stations_in_takeover(self) -> tuple[str, ...]:
        """Return the stations that are being taken over; any thread may call it."""
        return (*self._taking_over, *self._behind)

    def serves(self, station: str) -> bool:
        """Whether messages of the station are accepted now; any thread may call it."""
        return self.rejection_reason(station) is None

    def rejection_reason(self, station: str) -> str | None:
        """Return why messages of the station are rejected now; None if they are accepted."""
        if self.served is not None and station not in self.served:
            return "another instance serves this station: try again"
        if (why := self._behind.get(station)) is not None:
            return f"{why}: try again"
        return f"{IN_TAKEOVER}: try again" if station in self._taking_over else None
