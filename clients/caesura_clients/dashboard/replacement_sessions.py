"""The closed sessions whose apps can replace a part of a program, as an operator chooses among them."""

from __future__ import annotations

from caesura_clients.dashboard.session_list_rows import newest_first
from caesura_clients.dashboard.station_summary import DashboardState
from caesura_clients.session_state_reader import Update
from caesura_protocol.number_words import counted

MAX_CHOICES = 50  # the newest


class ReplacementSessions:
    """Lists them; the list is kept until the number of closed sessions changes."""

    def __init__(self) -> None:
        self._made_of: tuple[str, str, int] | None = None
        self._rows: list[list[str]] = []

    def of(self, world: DashboardState, station: str, session: str) -> list[list[str]]:
        """Return the other closed sessions of a station that have apps, the newest first: (name, text)."""
        made_of = station, session, world.closed
        if made_of != self._made_of:
            self._made_of, self._rows = made_of, _choices(world, station, session)
        return self._rows


def _choices(world: DashboardState, station: str, session: str) -> list[list[str]]:
    known = {**world.stored, **world.updates}
    others = [
        one
        for (where, name), one in known.items()
        if where == station and name != session and one.closed and one.program.apps
    ]
    newest = newest_first(others)[:MAX_CHOICES]
    return [[one.session, _in_words(one)] for one in newest if not one.status.description.deleted]


def _in_words(update: Update) -> str:
    """Return a session as text for an operator's choice."""
    task, count = update.status.description.task, len(update.program.apps)
    return ", ".join(filter(None, [update.session, task, counted(count, "app")]))
