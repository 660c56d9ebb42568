"""Detects several open sessions of one station that grow alternately.

Each has a bridge of its own, and one of these bridges has the wrong station name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from caesura_clients.session_state_reader import Update

PARTED_S = 3.0  # session time that others grow by meanwhile: what has not grown since has lost its bridge
REMEDY = "give one of them another --station"


@dataclass
class _Growth:
    """Growth of one open session. in_turn: it grew after another session had grown since its last growth."""

    t: float  # [s] session time
    others_s: float = 0.0  # [s] by which the others have grown since
    in_turn: bool = False


class ParallelSessions:
    """The sessions of each station that are recorded at once, detected by the times that they reach.

    A session that a new one replaces grows no more. Two sessions that each grow after the other are both in
    progress.
    """

    def __init__(self) -> None:
        self._open: dict[str, dict[str, _Growth]] = {}  # by station and session

    def reach(self, station: str, session: str, t: float) -> None:
        """Record the time [s] that an open session has reached."""
        known = self._open.setdefault(station, {})
        before = known.setdefault(session, _Growth(t))
        if (step_s := t - before.t) <= 0.0:
            return
        known[session] = _Growth(t, in_turn=before.in_turn or before.others_s > 0.0)
        for name, other in known.items():
            if name != session:
                other.others_s += step_s
                other.in_turn &= other.others_s < PARTED_S

    def observe(self, update: Update) -> None:
        """Apply the state of a session: the time that it has reached, or its close."""
        if update.closed:
            self.close(update.station, update.session)
        else:
            self.reach(update.station, update.session, update.t)

    def close(self, station: str, session: str) -> None:
        """Remove a session that is closed or deleted."""
        self._open.get(station, {}).pop(session, None)

    def at(self, station: str) -> tuple[str, ...]:
        """Return the names of the sessions that are recorded at once; empty if it is one."""
        found = sorted(name for name, one in self._open.get(station, {}).items() if one.in_turn)
        return tuple(found) if len(found) > 1 else ()


def in_words(station: str, sessions: Sequence[str]) -> str:
    """Return a warning that several bridges teach at a station."""
    count = "two" if len(sessions) == 2 else len(sessions)
    return f"{count} bridges teach at {station}: {' and '.join(sessions)}"
