"""An immutable index of the sessions of this instance, for other threads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from caesura_service.publishing.session_state import SessionState
from caesura_service.sessions.session import Session


@dataclass(frozen=True)
class SessionIndex:
    """The sessions as they were when one last came or went; each standing is always current."""

    sessions: Mapping[str, tuple[Session, ...]]  # by station, newest last

    def standings(self) -> tuple[SessionState, ...]:
        """Of every session."""
        return tuple(session.standing for sessions in self.sessions.values() for session in sessions)

    def current(self) -> tuple[SessionState, ...]:
        """Of every station's newest session."""
        return tuple(sessions[-1].standing for sessions in self.sessions.values())
