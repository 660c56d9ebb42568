"""The page `/compare`: two sessions on one time axis, and the differences of their programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import run, ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.pages.layout import TICK_S, Banner, Site, page, text
from caesura_clients.dashboard.pages.session import line_of_past
from caesura_clients.dashboard.pages.stored_session import StoredSession
from caesura_clients.dashboard.station_summary import DashboardState
from caesura_clients.dashboard.web_components import SessionView, Tables
from caesura_clients.session_state_reader import Update
from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.messages import App, Program
from caesura_protocol.number_words import counted
from caesura_protocol.programs.comparison import REPETITION, AppPair, compared

ALIKE = "alike"
COLUMNS = (("first", "first"), ("second", "second"), ("words", "difference"))
TOGETHER = """(event) => {
  const on = event.target.getAttribute("aria-pressed") !== "true";
  event.target.setAttribute("aria-pressed", String(on));
  window.dispatchEvent(new CustomEvent("caesura-together", { detail: on }));
}"""
HELP = "Switch it off to move one alone; switched on again, it keeps the offset."
Named = tuple[str, str]  # station and session


class ComparePage:
    """One browser's view of two sessions."""

    def __init__(self, site: Site, first: Named, second: Named) -> None:
        self._gateway, self._named = site.gateway, (first, second)
        self._compared: tuple[Program, ...] = ()
        with page("Compare", "/sessions"):
            self._banner = Banner()
            with Element("p").classes("together"):
                button = text("button", "Move together").props('type="button" aria-pressed="true"')
                button.on("click", js_handler=TOGETHER)
                text("span", HELP).classes("help")
            with Element("div").classes("pair"):
                self._halves = [_Half(site, *named) for named in self._named]
            self._shown: dict[str, Any] = {"warnings": [], "tables": []}
            self._tables = Tables(self._shown)
        self._tick()
        ui.timer(TICK_S, self._tick)
        ui.timer(TICK_S, self._compare)

    def _tick(self) -> None:
        world = self._gateway.world
        self._banner.say(world.trouble)
        updates = [world.update(*named) for named in self._named]
        for half, update in zip(self._halves, updates, strict=True):
            half.show(update, world)

    async def _compare(self) -> None:
        """Compare the programs if one has changed, without blocking other pages."""
        updates = [self._gateway.world.update(*named) for named in self._named]
        programs = tuple(update.program for update in updates if update is not None)
        if len(programs) == 2 and programs != self._compared:
            found = await run.io_bound(_tables, *programs)
            if found is None or self._tables.is_deleted:  # the dashboard, or the page, is ending
                return
            self._compared, self._shown = programs, found
        self._tables.show(self._shown)


class _Half:
    """One of the two sessions."""

    def __init__(self, site: Site, station: str, session: str) -> None:
        with Element("section").props(f'aria-label="{station}/{session}"'):
            with Element("h2"):
                self._link = text("a", session).props(f'href="/sessions/{station}/{session}"')
            self._line = text("p", "").classes("state-line")
            self._view = SessionView(
                station,
                site.gateway.world.update(station, session),
                editable=False,
                replay=True,
                on_edit=_ignore,
                on_preview=_ignore,
                linked=True,
            )
        self._station, self._session = station, session
        self._stored = StoredSession(site.gateway, station, session)

    def show(self, update: Update | None, world: DashboardState) -> None:
        """Send the changes of the session to the browser."""
        self._stored.follow(update)
        task = update.status.description.task if update else None
        name = f"{self._station} · {task or self._session}"
        if name != self._link.text:
            self._link.set_text(name)
        past = line_of_past(update, world)
        line = f"session {self._session} · {past}" if task else past  # two may have the same task
        if line != self._line.text:
            self._line.set_text(line)
        self._view.follow(update, {})


def _ignore(_event: GenericEventArguments) -> None:
    """Ignore a correction: this page makes none."""


def _tables(first: Program, second: Program) -> dict[str, Any]:
    pairs = compared(first.apps, second.apps, REPETITION, " and ")
    rows = []
    for i, j, words in pairs:
        alone = "only in the second" if i is None else "only in the first" if j is None else ""
        row = {"first": _named(first.apps, i), "second": _named(second.apps, j)}
        rows.append({**row, "words": alone or "; ".join(words) or ALIKE})
    table = {"title": "Programs", "columns": COLUMNS, "rows": rows, "empty": "Neither has an app."}
    return {"warnings": [], "tables": [table | {"words": _outcome(pairs) if rows else ""}]}


def _outcome(pairs: Sequence[AppPair]) -> str:
    """Return the number of apps of each program, and how many of them correspond.

    >>> _outcome([AppPair(0, 0), AppPair(1, 1, ("duration 1 s and 2 s",)), AppPair(None, 2)])
    'The first has 2 apps, the second 3. 2 correspond, of which 1 differs. 1 is only in the second.'
    """
    first = sum(pair.one is not None for pair in pairs)
    second = sum(pair.other is not None for pair in pairs)
    both = [pair for pair in pairs if pair.one is not None and pair.other is not None]
    unlike = sum(bool(pair.words) for pair in both)
    said = [f"The first has {counted(first, 'app')}, the second {second}."]
    differing = f"{unlike or 'none'} {'differs' if unlike == 1 else 'differ'}"
    said += [f"{len(both)} correspond, of which {differing}." if both else "None correspond."]
    for count, which in ((first - len(both), "first"), (second - len(both), "second")):
        said += [f"{count} {'is' if count == 1 else 'are'} only in the {which}."] if count else []
    return " ".join(said)


def _named(apps: Sequence[App], index: int | None) -> str:
    if index is None:
        return ""
    return f"{app_number(index)} · {apps[index].name or app_title(apps[index].kind)}"
