"""Prints one line per station when a terminal has no room for the segments of all stations."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from caesura_clients.cli.result_tables import MARK_OF_CERTAINTY, PLAIN
from caesura_clients.session_state_reader import Update
from caesura_protocol.session_time_display import clock_of

HEADING_LINES = 4  # of the table: an empty line, the heading, its rule, an empty line
MOST_HINTS = 5


def station_lines(updates: Sequence[Update], height: int) -> RenderableType:
    """Return the stations and their hints in at most `height` lines; stations without room are counted."""
    hints = [hint for one in updates for hint in _hints(one)][-MOST_HINTS:]
    room = max(1, height - HEADING_LINES - len(hints))
    shown = updates if len(updates) <= room else updates[: max(1, room - 1)]
    table = Table("station", "session", "state", "t \\[s]", "segments", "kind", **PLAIN)
    for column in table.columns:
        column.no_wrap = True
    for one in shown:
        t = clock_of(one.segments).shown(one.t, 1)
        row = one.station, one.session, one.status.state, t, str(len(one.segments)), _kind(one)
        table.add_row(*map(escape, row))
    hidden = len(updates) - len(shown)
    more = [Text(f"{hidden} more: --station shows one", style="dim")] if hidden else []
    return Group(table, *hints, *more)


def _kind(update: Update) -> str:
    """Return the kind of the newest segment with its probability."""
    if not update.segments:
        return ""
    last = update.segments[-1]
    return f"{MARK_OF_CERTAINTY[last.certainty]}{last.kind} {last.probability:.2f}"


def _hints(update: Update) -> list[Text]:
    """Return the advice of a station's active hints, one line of text each."""
    clock = clock_of(update.segments)
    advices = [clock.text(hint.advice) for hint in update.hints if hint.until is None]
    return [
        Text(f"! {update.station}: {advice}", "bold yellow", no_wrap=True, overflow="ellipsis")
        for advice in advices
    ]
