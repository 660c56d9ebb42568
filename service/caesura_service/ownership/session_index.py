"""An immutable index of the sessions of this instance, for other threads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from caesura_service.publishing.session_state import SessionState
from caesura_service.sessions.session import Session


@dataclass(frozen=True)
class SessionIndex:
    """The sessions since one was last added or removed; their states are always the current ones."""

    sessions: Mapping[str, tuple[Session, ...]]  # by station, newest last

    def of_station(self, station: str) -> SessionIndex:
        """Return the index of one station's sessions alone."""
        return SessionIndex({station: held} if (held := self.sessions.get(station)) else {})

    def all_states(self) -> tuple[SessionState, ...]:
        """Return the state of every session."""
        return tuple(session.state for sessions in self.sessions.values() for session in sessions)

    def newest_states(self) -> tuple[SessionState, ...]:
        """Return the state of every station's newest session."""
        return tuple(sessions[-1].state for sessions in self.sessions.values())
