"""The list of sessions as text, with uncut names and dates.

A column that is empty in every session is not shown. If a terminal is too narrow, columns are left out, and a
line states which; output to a pipe has no width limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from caesura_clients.cli.result_tables import PLAIN, RESULTS
from caesura_clients.query import SessionInfo
from caesura_protocol.session_time_display import is_of_day, local_moment

LEFT_OUT_FIRST = ("instance", "segments", "t [s]", "success")  # without room, in this order
LEAST_TASK = 10  # [characters] of a line of a task's name
UNLIMITED = 10_000  # [characters], more than any table has


def print_sessions(infos: Sequence[SessionInfo], console: Console | None = None) -> None:
    """Print all sessions; a pipe has no width, and a terminal that is too narrow for names wraps lines."""
    console = console or Console()
    view = sessions_view(infos, console.width if console.is_terminal else None)
    unlimited = Console(width=UNLIMITED)
    needed = Measurement.get(unlimited, unlimited.options, view)
    console.width = max(console.width, needed.minimum) if console.is_terminal else needed.maximum
    console.print(view)


def sessions_view(infos: Sequence[SessionInfo], width: int | None = None) -> RenderableType:
    """Return all sessions, one per line, with uncut names.

    width: of the terminal [characters]; columns that do not fit are left out, which a line states. None: no
    limit.
    """
    shown = _columns_of(infos)
    hidden: list[str] = []
    table = _sessions_table(shown)
    for heading in LEFT_OUT_FIRST:
        if width is None or _least_width(table) <= width:
            break
        if heading in shown:
            del shown[heading]
            hidden.append(heading)
            table = _sessions_table(shown)
    below = [Text(f"{info.station}/{info.session}: {info.damage}") for info in infos if info.damage]
    if hidden:
        below.append(Text(f"no room for {', '.join(hidden)}: --json has all", style="dim"))
    return Group(table, *below) if below else table


def _columns_of(infos: Sequence[SessionInfo]) -> dict[str, list[str]]:
    """Return the cells by heading, without the columns that are empty in every session."""
    columns = {
        "station": [info.station for info in infos],
        "session": [info.session for info in infos],
        "opened": ["–" if info.opened is None else local_moment(info.opened) for info in infos],
        "task": [info.task or "–" for info in infos],
        "success": [RESULTS[info.success] for info in infos],
        "state": ["deleted" if info.deleted else info.state for info in infos],
        "t [s]": [_last_time(info) for info in infos],
        "segments": ["–" if info.damage else str(info.segments) for info in infos],
        "instance": [info.instance for info in infos],
    }
    nothing = {name for name in ("task", "success") if set(columns[name]) == {"–"}}
    if len(set(columns["instance"])) == 1:
        nothing.add("instance")
    return {name: cells for name, cells in columns.items() if name not in nothing}


def _last_time(info: SessionInfo) -> str:
    if info.damage:
        return "–"
    return local_moment(info.t) if is_of_day(info.t) else f"{info.t:.1f}"


def _sessions_table(columns: Mapping[str, Sequence[str]]) -> Table:
    table = Table(**PLAIN)
    for name, cells in columns.items():
        widest = max(len(name), *map(len, cells)) if cells else len(name)
        least = min(widest, LEAST_TASK) if name == "task" else widest
        table.add_column(Text(name), min_width=least, no_wrap=name != "task")
    for row in zip(*columns.values(), strict=True):
        table.add_row(*map(Text, row))
    return table


def _least_width(table: Table) -> int:
    """Return the width [characters] that a table needs at its narrowest columns."""
    unlimited = Console(width=UNLIMITED)
    return Measurement.get(unlimited, unlimited.options, table).minimum
