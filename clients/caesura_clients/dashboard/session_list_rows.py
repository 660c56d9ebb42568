"""The session history: the sessions that the service holds, and stored ones that were read, newest first."""

from __future__ import annotations

from typing import Any

from caesura_clients.damaged_session_words import damage_words, damaged_in, unlisted_words
from caesura_clients.dashboard.station_summary import DashboardState, gaps, lasted
from caesura_clients.session_state_reader import Update
from caesura_protocol.messages import DamagedSession
from caesura_protocol.number_words import counted
from caesura_protocol.session_time_display import local_moment


def sessions(world: DashboardState) -> list[dict[str, Any]]:
    """Return a row per session, the newest first; `href` links to its replay."""
    known = {**world.stored, **world.updates}
    newest = sorted(known.values(), key=_age, reverse=True)
    return [_row(update, is_left_open=world.is_left_open(update)) for update in newest]


def damaged(world: DashboardState) -> list[str]:
    """Return a line for each session that has no row because its results cannot be read."""
    lines = [
        f"{one.station}/{one.session}{_opened(one)}: {damage_words(one)}"
        for _, one in damaged_in(world.services)
    ]
    return [*lines, *filter(None, [unlisted_words(world.services)])]


def _opened(one: DamagedSession) -> str:
    return "" if one.opened is None else f", taught {local_moment(one.opened)}"


OFFERED = 50  # sessions that may take the place of a part


class PartChoice:
    """The sessions that can replace a part of a program; rebuilt only after one of them changed."""

    def __init__(self) -> None:
        self._made_of: tuple[str, str, int] | None = None
        self._rows: list[list[str]] = []

    def of(self, world: DashboardState, station: str, session: str) -> list[list[str]]:
        """Return the other closed sessions of a station that have apps, the newest first: (name, text)."""
        made_of = station, session, world.closed
        if made_of != self._made_of:
            self._made_of, self._rows = made_of, _taught_again(world, station, session)
        return self._rows


def _taught_again(world: DashboardState, station: str, session: str) -> list[list[str]]:
    known = {**world.stored, **world.updates}
    others = [
        one
        for (where, name), one in known.items()
        if where == station and name != session and one.closed and one.program.apps
    ]
    newest = sorted(others, key=_age, reverse=True)
    return [[one.session, _in_words(one)] for one in newest[:OFFERED] if not one.status.description.deleted]


def _in_words(update: Update) -> str:
    """Return a session as text for an operator's choice."""
    task, count = update.status.description.task, len(update.program.apps)
    return ", ".join(filter(None, [update.session, task, counted(count, "app")]))


def _age(update: Update) -> tuple[float, str, str]:
    """Return the sort key of a session: its time of day (0 if unknown), then its names.

    Names of sessions sort by time too.
    """
    return update.status.opened or 0.0, update.session, update.station


def _row(update: Update, *, is_left_open: bool) -> dict[str, Any]:
    status, stated = update.status, update.status.description
    return {
        "station": update.station,
        "session": update.session,
        "href": f"/sessions/{update.station}/{update.session}",
        "task": stated.task or "",
        "operator": stated.operator or "",
        "note": stated.note or "",
        "tags": list(stated.tags),
        "success": stated.success,
        "deleted": stated.deleted,
        "opened": status.opened,
        "closed": update.closed,
        "leftOpen": is_left_open,
        "length": round(lasted(update), 1),
        "segments": len(update.segments),
        "apps": len(update.program.apps),
        "gaps": gaps(update),
        "version": update.program.version,
        "author": update.program.author or "",
        "edited": update.program.edited,
        "instance": status.instance,
    }
