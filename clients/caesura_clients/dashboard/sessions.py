"""The history: every session that the service still holds, the newest first."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from caesura_clients.dashboard.station_summary import DashboardState, gaps, reached
from caesura_clients.results import Update


def sessions(world: DashboardState) -> list[dict[str, Any]]:
    """A row each; `href` leads to its replay."""
    newest = sorted(world.updates.items(), key=lambda item: (item[0][1], item[0][0]), reverse=True)
    return [_row(update) for _, update in newest]


def _row(update: Update) -> dict[str, Any]:
    status = update.status
    return {
        "station": update.station,
        "session": update.session,
        "href": f"/sessions/{update.station}/{update.session}",
        "state": status.state,
        "length": f"{reached(update):.1f} s",
        "segments": str(len(update.segments)),
        "apps": str(len(update.program.apps)),
        "gaps": str(gaps(update)),
        "version": f"version {update.program.version}",
        "edited": edited(update),
        "instance": status.instance,
    }


def edited(update: Update) -> str:
    """Who corrected it last, and when."""
    author, at = update.program.author, update.program.edited
    if author is None:
        return "–"
    return author if at is None else f"{author}, {datetime.fromtimestamp(at):%H:%M}"
