"""The state of `caesura watch`: for each station the session of its current program.

When a session first appears, the service is asked which session is current. So a second session of the
station, of a bridge that was left running, does not alternate with it. A terminal that is too short shows the
newest rows, because the beginning of a demonstration no longer changes. If it is too short for all stations,
each has one line.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from itertools import takewhile

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.text import Text

from caesura_clients.cli.compact_station_rows import station_lines
from caesura_clients.cli.result_tables import clock_lines, measures_force, segment_line, segments_view
from caesura_clients.cli.service_availability_lines import SAID_OF_SERVICE, availability_text
from caesura_clients.session_follower import Event, ServiceAvailability, SessionRemoved
from caesura_clients.session_state_reader import Update
from caesura_clients.station_name_conflicts import REMEDY, ParallelSessions, in_words
from caesura_protocol.session_time_display import clock_of

LEAST_ROWS = 1


class FinalLines:
    """Final segments as lines of text, each printed once: for a file or a pipe, which cannot be redrawn."""

    def __init__(self) -> None:
        self._written: dict[tuple[str, str], int] = {}

    def lines(self, update: Update) -> list[str]:
        """Return lines for the segments that became final since the last update of the session."""
        key = (update.station, update.session)
        final = sum(1 for _ in takewhile(lambda one: one.certainty == "final", update.segments))
        before = self._written.get(key, 0)
        self._written[key] = max(final, before)
        new = enumerate(update.segments[before:final], start=before)
        measured = measures_force(update.status.wrench)
        return [
            f"{'/'.join(key)} {segment_line(index, segment, measured=measured)}" for index, segment in new
        ]


class LiveView:
    """View of the newest segments of each station; one thread receives events, another draws.

    The content is replaced, never changed. current: returns the session of each station's program, and is
    called when a session is unknown or was removed. has_router: as of `availability_text`.
    """

    def __init__(
        self,
        current: Callable[[], Mapping[str, str]],
        *,
        waiting: str = "waiting",
        has_router: Callable[[], bool] | None = None,
    ) -> None:
        self._has_router = has_router
        self._ask_current = current
        self._waiting = waiting
        self._updates: dict[tuple[str, str], Update] = {}  # by station and session, in the order of meeting
        self._current: Mapping[str, str] = {}
        self._service = ""
        self._parallel = ParallelSessions()
        self._several: dict[str, str] = {}  # what is to be said of stations with several bridges

    def receive(self, event: Event) -> None:
        """Apply an event: an update, a removed session, or a change of the service's availability."""
        match event:
            case Update():
                self._take(event)
            case SessionRemoved():
                gone = (event.station, event.session)
                self._updates = {key: update for key, update in self._updates.items() if key != gone}
                self._current = self._ask_current()
                self._parallel.close(*gone)
                self._count_bridges(event.station)
            case ServiceAvailability("there") if not self._service:
                pass  # it was there before it was watched
            case ServiceAvailability():
                self._service = availability_text(event.state, self._has_router)

    def shown(self) -> list[Update]:
        """Return the newest update of each station's current session, sorted by station."""
        newest: dict[str, Update] = {}
        for (station, _), update in self._updates.items():
            if station not in newest or newest[station].session != self._current.get(station):
                newest[station] = update
        return [newest[station] for station in sorted(newest)]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from self._fitting(console, options)

    def _take(self, update: Update) -> None:
        key = (update.station, update.session)
        if key not in self._updates:
            self._current = self._ask_current()
        self._updates = {**self._updates, key: update}
        self._parallel.observe(update)
        self._count_bridges(update.station)
        if self._service == SAID_OF_SERVICE["there"]:
            self._service = ""

    def _count_bridges(self, station: str) -> None:
        both = self._parallel.at(station)
        others = {name: words for name, words in self._several.items() if name != station}
        self._several = {**others, station: f"! {in_words(station, both)}: {REMEDY}"} if both else others

    def _said(self) -> list[RenderableType]:
        """Return the lines beneath the stations: which have several bridges, and the service's state."""
        said = [Text(words, style="bold yellow") for _, words in sorted(self._several.items())]
        return [*said, Text(self._service)] if self._service else [*said]

    def _fitting(self, console: Console, options: ConsoleOptions) -> list[RenderableType]:
        """Return all rows, or as many of the newest ones as fit into the terminal.

        Several stations that do not fit get a line each.
        """
        updates = self.shown()
        if not updates:
            return [Text(", ".join(filter(None, (self._service.removesuffix(", waiting"), self._waiting))))]
        most = max(LEAST_ROWS, *(min(len(one.segments), console.height) for one in updates))

        def overflows(rows: int) -> bool:
            drawn = console.render_lines(Group(*self._views(updates, rows)), options, pad=False)
            return len(drawn) > console.height

        if len(updates) > 1 and overflows(LEAST_ROWS):
            said = self._said()
            lines = console.render_lines(Group(*said), options, pad=False) if said else []
            return [station_lines(updates, console.height - len(lines)), *said]
        fitting = bisect_left(range(LEAST_ROWS, most + 1), True, key=overflows)
        return self._views(updates, max(LEAST_ROWS, fitting))

    def _views(self, updates: Iterable[Update], rows: int) -> list[RenderableType]:
        """Return tables with the newest rows of each station, and the lines beneath them."""
        views: list[RenderableType] = []
        for one in updates:
            clock = clock_of(one.segments)
            views += clock_lines(clock)
            views.append(segments_view(one.status, one.segments, clock, newest=rows, hints=one.hints))
        return [*views, *self._said()]
