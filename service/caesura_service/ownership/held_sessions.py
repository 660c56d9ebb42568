"""The sessions in memory, by station and name, and which of them have a status to publish later."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain

from caesura_protocol.errors import ProtocolError
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.publishing.events import Output
from caesura_service.sessions.session import Session

NO_SESSIONS: Mapping[str, Session] = {}


class HeldSessions:
    """One thread changes the sessions; any thread may read `index`, which every change replaces.

    The sessions of a station are in the order in which they were opened or taken over, the newest one last.
    """

    def __init__(self) -> None:
        self._by_station: dict[str, dict[str, Session]] = {}  # of which no station's is ever changed
        self._throttled: set[Session] = set()  # whose next status about refusals waits
        self.index = SessionIndex({})

    @property
    def by_station(self) -> Mapping[str, Mapping[str, Session]]:
        """The sessions by name, by station."""
        return self._by_station

    def of(self, station: str) -> Mapping[str, Session]:
        """Return the sessions of a station by name; none where it has none."""
        return self._by_station.get(station, NO_SESSIONS)

    def all(self) -> Iterable[Session]:
        """Return the sessions of every station."""
        return chain.from_iterable(sessions.values() for sessions in self._by_station.values())

    def find(self, station: str | None, name: str | None) -> Session | None:
        """Return a session; None if it is not in memory."""
        return self.of(station or "").get(name or "")

    def newest(self, station: str | None) -> Session | None:
        """Return the newest session of a station; None where it has none."""
        sessions = tuple(self.of(station or "").values())
        return sessions[-1] if sessions else None

    def require(self, station: str, name: str) -> Session:
        """Return a session. Raises ProtocolError `forbidden` or `unknown_session`."""
        session = self.find(station, name)
        if session is not None:
            return session
        if any(name in sessions for sessions in self._by_station.values()):
            raise ProtocolError("forbidden", "only another station has a session of that name", value=name)
        raise ProtocolError(
            "unknown_session",
            "no such session at this station",
            value=name,
            expected=list(self.of(station)) or None,
        )

    def add(self, station: str, session: Session) -> None:
        """Add the newest session of a station."""
        self.replace(station, {**self.of(station), session.name: session})

    def remove(self, station: str, name: str) -> None:
        """Remove a session, if it is in memory."""
        if name not in self.of(station):
            return  # as most of what the journal deletes
        self.replace(station, {other: one for other, one in self.of(station).items() if other != name})

    def replace(self, station: str, sessions: Mapping[str, Session]) -> None:
        """Replace the sessions of a station; an empty mapping removes it."""
        self._throttled -= {*self.of(station).values()} - {*sessions.values()}
        shown = {**self.index.sessions, station: tuple(sessions.values())}
        self._by_station[station] = dict(sessions)
        if not sessions:
            del self._by_station[station], shown[station]
        self.index = SessionIndex(shown)

    def track(self, session: Session, outputs: list[Output]) -> list[Output]:
        """Return the outputs of a session; record it if its next status is postponed."""
        if session.status_throttled:
            self._throttled.add(session)
        return outputs

    def flush_statuses(self, now: float) -> list[Output]:
        """Publish the statuses that are due. now: [s]."""
        outputs = [output for session in self._throttled for output in session.flush_status(now)]
        self._throttled = {session for session in self._throttled if session.status_throttled}
        return outputs
