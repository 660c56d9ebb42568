"""The session history: the sessions that the service holds, and stored ones that were read, newest first."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from caesura_clients.damaged_session_words import damage_words, damaged_in, unlisted_words
from caesura_clients.dashboard.station_summary import DashboardState, gaps, lasted
from caesura_clients.session_state_reader import Update
from caesura_protocol.messages import DamagedSession
from caesura_protocol.session_time_display import local_moment


def sessions(world: DashboardState) -> list[dict[str, Any]]:
    """Return a row per session, the newest first; `href` links to its replay.

    held: the service holds it, so its description can be changed.
    """
    newest = newest_first({**world.stored, **world.updates}.values())
    return [
        {
            **_row(update),
            "leftOpen": world.is_left_open(update),
            "held": (update.station, update.session) in world.updates,
        }
        for update in newest
    ]


def newest_first(updates: Iterable[Update]) -> list[Update]:
    """Return sessions by their time of day, or if it is unknown by their names, which sort by time too."""
    return sorted(updates, key=lambda one: (one.status.opened or 0.0, one.session, one.station), reverse=True)


def damaged(world: DashboardState) -> list[str]:
    """Return a line for each session that has no row because its results cannot be read."""
    lines = [
        f"{one.station}/{one.session}{_opened(one)}: {damage_words(one)}"
        for _, one in damaged_in(world.services)
    ]
    return [*lines, *filter(None, [unlisted_words(world.services)])]


def _opened(one: DamagedSession) -> str:
    return "" if one.opened is None else f", taught {local_moment(one.opened)}"


def _row(update: Update) -> dict[str, Any]:
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
        "length": round(lasted(update), 1),
        "segments": len(update.segments),
        "apps": len(update.program.apps),
        "gaps": gaps(update),
        "version": update.program.version,
        "author": update.program.author or "",
        "edited": update.program.edited,
        "instance": status.instance,
    }
