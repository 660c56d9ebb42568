"""The limit of stations that an instance holds: which of them make room for another."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from caesura_protocol.errors import ProtocolError
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session

Stations = Mapping[str, Mapping[str, Session]]  # the sessions by name, by station


class StationLimit:
    """The times at which stations last sent something, and the stations to release beyond the limit.

    is_busy: whether work on a station is under way, which keeps it.
    """

    def __init__(self, limits: Limits, is_busy: Callable[[str], bool]) -> None:
        self._limits, self._is_busy = limits, is_busy
        self._received_s: dict[str, float] = {}  # [s]

    def received(self, station: str, now: float) -> None:
        """A station has sent something."""
        self._received_s[station] = now

    def began(self, station: str, now: float) -> None:
        """A station is held from now on, unless it has been before."""
        self._received_s.setdefault(station, now)

    def forget(self, station: str) -> None:
        """A station is no longer held."""
        self._received_s.pop(station, None)

    def check_has_room(self, stations: Stations, station: str, now: float) -> None:
        """Raise ProtocolError `overloaded` for a new station where no other can be released for it."""
        most = self._limits.stations
        if station in stations or len(stations) < most or self._in_order(stations, now):
            return
        silent_s = self._limits.silent_s
        why = f"{most} stations have an open session and sent something within {silent_s:g} s: try again"
        raise ProtocolError("overloaded", why, value=station, limit=most)

    def beyond(self, stations: Stations, now: float) -> list[str]:
        """Return the stations to release, as many as there are beyond the limit where so many can be."""
        excess = len(stations) - self._limits.stations
        return self._in_order(stations, now)[:excess] if excess > 0 else []

    def _in_order(self, stations: Stations, now: float) -> list[str]:
        """Return the stations that make room for another, the first one first.

        Those without an open session, by the opening of their last one; then those that are silent for
        `silent_s` or longer: a bridge that is there sends heartbeats.
        """
        idle = [station for station in stations if not self._is_busy(station)]
        has_open = {name: any(one.is_open for one in stations[name].values()) for name in idle}
        before = now - self._limits.silent_s
        ended = [name for name in idle if not has_open[name]]
        silent = [name for name in idle if has_open[name] and self._received_s.get(name, now) <= before]
        return sorted(ended, key=lambda name: last_opened(stations[name])) + sorted(
            silent, key=self._received_s.__getitem__
        )


def last_opened(sessions: Mapping[str, Session]) -> float:
    """Return when the last of the sessions was opened [s]; 0 where that is not known."""
    return max((session.state.opened or 0.0 for session in sessions.values()), default=0.0)
