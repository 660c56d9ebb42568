"""The limit of stations per instance: which stations are released to make room for another."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from caesura_protocol.errors import ProtocolError
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session

Stations = Mapping[str, Mapping[str, Session]]  # the sessions by name, by station


class StationLimit:
    """The last message times of stations, and the stations to release beyond the limit.

    is_busy: returns whether work on a station is in progress; such a station is not released.
    """

    def __init__(self, limits: Limits, is_busy: Callable[[str], bool]) -> None:
        self._limits, self._is_busy = limits, is_busy
        self._received_s: dict[str, float] = {}  # [s]

    def received(self, station: str, now: float) -> None:
        """Record that a station has sent a message. now: [s]."""
        self._received_s[station] = now

    def began(self, station: str, now: float) -> None:
        """Record that a station is held from now on, unless it was before. now: [s]."""
        self._received_s.setdefault(station, now)

    def forget(self, station: str) -> None:
        """Remove a station that is no longer held."""
        self._received_s.pop(station, None)

    def check_has_room(self, stations: Stations, station: str, now: float) -> None:
        """Raise ProtocolError `overloaded` for a new station if no other can be released for it."""
        most = self._limits.stations
        if station in stations or len(stations) < most or self._in_order(stations, now):
            return
        silent_s = self._limits.silent_s
        why = f"{most} stations have an open session and sent something within {silent_s:g} s: try again"
        raise ProtocolError("overloaded", why, value=station, limit=most)

    def beyond(self, stations: Stations, now: float) -> list[str]:
        """Return the stations to release: those beyond the limit, or fewer if not enough can be released."""
        excess = len(stations) - self._limits.stations
        return self._in_order(stations, now)[:excess] if excess > 0 else []

    def _in_order(self, stations: Stations, now: float) -> list[str]:
        """Return the stations that can be released, in the order of release.

        First those without an open session, by the opening of their last one. Then those without a message
        for `silent_s` or longer, by their last message: a connected bridge sends heartbeats.
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
    """Return the time [s] at which the last of the sessions was opened; 0 if it is unknown."""
    return max((session.state.opened or 0.0 for session in sessions.values()), default=0.0)
