"""The pages of a session: `/station/{station}` live, `/sessions/{station}/{session}` from the history."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from nicegui import background_tasks, run, ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.correction_requests import EditRefused, correct, preview
from caesura_clients.dashboard.demonstration_requests import controls, description_of
from caesura_clients.dashboard.drawing_updates import run_lengths
from caesura_clients.dashboard.edit_conflicts import EditConflict
from caesura_clients.dashboard.hint_banner import banner_of
from caesura_clients.dashboard.network_follower import STATIONS
from caesura_clients.dashboard.pages.absent_session import AbsentSession
from caesura_clients.dashboard.pages.layout import TICK_S, Banner, Site, page, text
from caesura_clients.dashboard.pages.stored_session import StoredSession
from caesura_clients.dashboard.program_differences import compared_versions
from caesura_clients.dashboard.program_edits import ProgramDesk
from caesura_clients.dashboard.program_simulation import SPEEDS, Simulation, SimulatorBusyError
from caesura_clients.dashboard.program_timeline import Timeline
from caesura_clients.dashboard.replacement_sessions import ReplacementSessions
from caesura_clients.dashboard.station_summary import (
    DashboardState,
    StationSummary,
    glance,
    length_words,
    session_clock,
    warning_of,
)
from caesura_clients.dashboard.web_components import (
    DescriptionForm,
    HintBanner,
    ProgramTimeline,
    SessionView,
    StartStop,
)
from caesura_clients.dashboard.wrench_source_words import wrench_words
from caesura_clients.session_state_reader import Update
from caesura_protocol import messages as wire
from caesura_protocol.number_words import counted
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock, clock_of

ONLY_READ = (
    "Newer sessions have taken the place of this one in the service: it can be read, exported and replayed, "
    "and cannot be changed."
)
LEFT_OPEN = "not ended: its bridge is gone, and the station's next bridge in standby closes it"
GONE = "The service no longer holds this session, and it cannot be changed."
# The threads of `run.io_bound` may all wait for a service.
BUILDERS = ThreadPoolExecutor(2, "program")
PRESSES = ThreadPoolExecutor(STATIONS, "press")  # each waits for its bridge


class SessionPage:
    """One browser's view of one session. session: None follows the station's current session."""

    def __init__(self, site: Site, station: str, session: str | None, *, was_read: bool = False) -> None:
        """was_read: the service was asked for the stored session, and has answered."""
        self._gateway, self._corrector, self._desk = site.gateway, site.corrector, site.desk
        self._station, self._session = station, session
        self._simulator = site.simulator
        self._simulation: Simulation | None = None  # the one of this page that is under way
        self._program_desk = None if site.desk is None else ProgramDesk(site.gateway.transport)
        title = f"Station {station}" if session is None else f"{station} · {session}"
        is_live = session is None
        with page(title, "/" if is_live else "/sessions") as self._title:
            self._absent = None if session is None else AbsentSession(station, session)
            self._workspace = Element("div").classes("workspace")
        with self._workspace:
            with Element("div").classes("work"):
                self._line = text("p", "").classes("state-line")
                self._start_stop = StartStop(self._controls(), self._press) if is_live else None
                self._form = DescriptionForm(
                    self._description(), self._describe, editable=site.desk is not None, live=is_live
                )
                self._view = SessionView(
                    station,
                    site.gateway.world.update(station, session),
                    editable=self._corrector is not None,
                    replay=not is_live,
                    on_edit=self._edit,
                    on_preview=self._preview,
                )
                with Element("div").classes("dock"):  # at the lower edge of the window: it moves nothing
                    self._banner = Banner()
                    self._hints = HintBanner(banner_of(None)) if is_live else None
            self._program = ProgramTimeline(
                self._edit_program,
                self._simulate,
                self._cancel,
                self._compare,
                self._list,
                editable=self._program_desk is not None,
                speeds=() if site.simulator is None else SPEEDS,
            )
        self._clock = NO_OFFSET  # of the session that is shown
        self._is_known = False  # was it ever shown?
        self._stored = (
            None if session is None else StoredSession(site.gateway, station, session, was_read=was_read)
        )
        self._timeline_of: wire.Program | None = None
        self._timeline_how: tuple[SessionClock, int | None] = (NO_OFFSET, None)
        self._timeline = Timeline()
        self._is_building = False
        self._last: int | None = None  # number of the last app that is listed; None: the newest
        self._shown: dict[str, Any] = {}
        self._parts = ReplacementSessions()
        self._columns_from = -1.0  # [s] run lengths up to there were sent; negative: none
        self._columns_of = ""  # which session
        self._tick()
        self._view.on("ready", self._tick)  # the segments need not wait for the next tick
        ui.timer(TICK_S, self._tick)
        ui.context.client.on_delete(self._cancel)

    def _tick(self) -> None:
        gateway = self._gateway
        world, received = gateway.world, gateway.received.get(self._station)
        update = world.update(self._station, self._session)
        seen = glance(world, self._station, received, gateway.clock(), gateway.began)
        self._clock = NO_OFFSET if update is None else session_clock(update)
        if self._stored is not None and self._absent is not None:
            self._stored.follow(update)
            is_absent = update is None and self._stored.is_missing and not world.trouble
            self._absent.show(world.sessions(self._station) if is_absent else None)
            self._workspace.set_visibility(not is_absent)
        self._offer_tools(update)
        live = self._session is None
        self._banner.say(warning_of(seen, world) if live else world.trouble)
        line = line_of(seen, update) if live else line_of_past(update, world)
        if line != self._line.text:
            self._line.set_text(line)
        if self._session is not None:
            task = update.status.description.task if update else None
            self._title.say(f"{self._station} · {task or self._session}", self._session if task else "")
        if self._hints is not None:
            self._hints.show(banner_of(update))
        if self._start_stop is not None:
            state = {"t": round(seen.t), "seen": seen.state, "said": seen.said}
            self._start_stop.show(self._controls() | state)
        self._form.show(self._description())
        self._view.follow(update, self._more(update))
        self._program.set_answered(answers=world.answers)
        if update is None:
            self._program.forget()
        else:
            self._show_program(update.program)

    def _offer_tools(self, update: Update | None) -> None:
        """Enable the tools that change a session, unless the service no longer holds it."""
        world, named = self._gateway.world, (self._station, self._session or "")
        self._is_known = self._is_known or update is not None
        is_stored = named in world.stored
        may = self._session is None or named in world.updates or not (is_stored or self._is_known)
        why = "" if may else ONLY_READ if is_stored else GONE
        tools = {self._view: self._corrector, self._form: self._desk, self._program: self._program_desk}
        for element, desk in tools.items():
            if desk is not None:
                element.set_editable(editable=may, why=why)

    def _controls(self) -> dict[str, Any]:
        return controls(self._gateway.world, self._station, may_operate=self._desk is not None)

    def _description(self) -> dict[str, Any]:
        return description_of(self._gateway.world, self._station, self._session)

    async def _press(self, event: GenericEventArguments) -> None:
        """Start or stop, without blocking other pages."""
        if self._desk is None or self._start_stop is None or not isinstance(event.args, dict):
            return
        command, loop = str(event.args.get("type")), asyncio.get_running_loop()
        try:
            await loop.run_in_executor(PRESSES, self._desk.carry_out, self._station, event.args)
        except EditRefused as refused:
            self._start_stop.answered(command, str(refused), failed=True)
        else:
            self._start_stop.answered(command, "", failed=False)

    async def _describe(self, event: GenericEventArguments) -> None:
        """Change the description, without blocking other pages."""
        if self._desk is None or not isinstance(event.args, dict):
            return
        try:
            said = await run.io_bound(self._desk.carry_out, self._station, event.args)
        except EditConflict as conflict:
            self._form.answered(str(conflict), failed=True, found=conflict.found)
        except EditRefused as refused:
            self._form.answered(str(refused), failed=True)
        else:
            self._form.answered(said or "", failed=False)

    def _show_program(self, program: wire.Program) -> None:
        """Show the program as a timeline, which is built anew only after a change.

        A long one takes a tenth of a second. It is built after the segments have arrived in the browser, in a
        thread of its own, so that neither the page nor samples and segments come later.
        """
        if not (self._program.is_free and self._view.was_seen):
            return
        known, how = self._timeline_of, (self._clock, self._last)
        if known is not None and program.session != known.session:
            how = (self._clock, None)
            self._last = None
        if (program is not known or how != self._timeline_how) and not self._is_building:
            self._is_building = True
            background_tasks.create(self._build(program, how))
        if self._shown.get("session") != program.session:
            self._program.forget()  # that of the session before
            return
        is_edited = self._program_desk is not None
        parts = (
            self._parts.of(self._gateway.world, self._station, self._shown["session"]) if is_edited else []
        )
        elsewhere = self._simulator is not None and self._simulator.is_busy and self._simulation is None
        self._program.follow({**self._shown, "sessions": parts, "elsewhere": elsewhere})

    async def _build(self, program: wire.Program, how: tuple[SessionClock, int | None]) -> None:
        """Build the timeline of a program in a thread of its own."""
        loop = asyncio.get_running_loop()
        try:
            shown = await loop.run_in_executor(BUILDERS, self._timeline.of, program, *how)
        finally:
            self._is_building = False
        self._timeline_of, self._timeline_how, self._shown = program, how, shown

    def _more(self, update: Update | None) -> dict[str, Any]:
        """Return the payload beside the drawing: state of corrections, and run lengths if they are shown.

        Empty while the browser has too many unacknowledged payloads.
        """
        if update is None or not self._view.is_free:
            return {}
        more = self._view.changed_edit_state(update)
        if self._view.shows_run_lengths:
            more |= self._run_lengths(update)
        else:
            self._columns_from = -1.0
        return more

    def _run_lengths(self, update: Update) -> dict[str, Any]:
        if update.session != self._columns_of:
            self._columns_of, self._columns_from = update.session, -1.0
        held = self._gateway.posteriors(self._station, update.session)
        fresh = [one for one in held if one.t > self._columns_from]
        if not fresh:
            return {}
        first, self._columns_from = self._columns_from < 0.0, fresh[-1].t
        return {"columns" if first else "newColumns": run_lengths(fresh)}

    async def _edit(self, event: GenericEventArguments) -> None:
        """Send a correction, without blocking other pages."""
        if self._corrector is None or not isinstance(event.args, dict):
            return
        try:
            done = await run.io_bound(correct, self._corrector, self._station, event.args, self._clock)
        except EditRefused as refused:
            self._view.answered(str(refused), failed=True, revision=refused.revision)
        else:
            words, doubt = done or ("", "")  # none: the dashboard is ending
            self._view.answered(words, failed=False, doubt=doubt)

    async def _preview(self, event: GenericEventArguments) -> None:
        """Query the effect of a correction, without blocking other pages."""
        if self._corrector is None or not isinstance(event.args, dict):
            return
        found = await run.io_bound(preview, self._corrector, self._station, event.args, self._clock)
        if found is not None and not self._view.is_deleted:  # else the dashboard, or the page, is ending
            self._view.previewed(found)

    async def _edit_program(self, event: GenericEventArguments) -> None:
        """Send an edit of the program, without blocking other pages."""
        if self._program_desk is None or not isinstance(event.args, dict):
            return
        try:
            carry_out, clock = self._program_desk.carry_out, self._clock
            shown, others = self._timeline_of, self._gateway.world.other_programs(self._timeline_of)
            said = await run.io_bound(carry_out, self._station, event.args, clock, shown, others)
        except EditConflict as conflict:
            self._program.answered(str(conflict), failed=True, found=conflict.found)
        except EditRefused as refused:
            self._program.answered(str(refused), failed=True, revision=refused.revision)
        else:
            self._program.answered(said or "", failed=False)

    async def _compare(self, event: GenericEventArguments) -> None:
        """Compare two versions of the shown program, without blocking other pages."""
        program = self._timeline_of
        if program is None or not isinstance(event.args, dict):
            return
        transport, named = self._gateway.transport, (program.station, program.session)
        found: dict[str, Any] | None
        try:
            found = await run.io_bound(compared_versions, transport, *named, event.args)
        except EditRefused as refused:
            found = {"said": str(refused), "failed": True, "rows": []}
        if found is not None and not self._program.is_deleted:  # else the dashboard, or the page, is ending
            self._program.compared(found)

    def _list(self, event: GenericEventArguments) -> None:
        """List another part of the program."""
        last = event.args
        self._last = last if isinstance(last, int) and last > 0 else None

    async def _simulate(self, event: GenericEventArguments) -> None:
        """Run the shown program on the simulated robot, without blocking other pages."""
        program = self._timeline_of
        if self._simulator is None or program is None or self._simulation is not None:
            return
        mine = self._simulation = Simulation()
        try:
            found = await run.io_bound(self._simulator.run, program, str(event.args), mine)
        except SimulatorBusyError:
            found = {"said": "", "stopped": False, "points": []}  # as long as it lasts, the page states it
        except EditRefused as refused:
            found = {"said": self._clock.text(str(refused)), "stopped": not mine.is_ended, "points": []}
        finally:
            self._simulation = None
        if found is not None and not self._program.is_deleted:  # else the dashboard, or the page, is ending
            self._program.simulated(found)

    def _cancel(self) -> None:
        """End the simulation of this page, if one is running."""
        if self._simulation is not None:
            self._simulation.end()


def line_of(seen: StationSummary, update: Update | None) -> str:
    """Return the line on a station's session: its gaps, its wrench, its last sample and its times.

    The station's state is shown beside Start and Stop. Without a session there is nothing else to state.
    """
    if update is None:
        return ""
    parts = [f"session {update.session}", _gaps(seen.gaps), wrench_words(update.status.wrench)]
    if update.closed:
        parts.insert(1, length_words(update))
    if seen.age_s is not None and seen.age_s >= 1.0:
        parts.append(f"last sample {seen.age_s:.0f} s ago")
    if seen.overloaded:
        parts.append("overloaded")
    return " · ".join([*parts, *_times(update)])


def line_of_past(update: Update | None, world: DashboardState) -> str:
    """Return the line on a session that was requested by its name; None: the service does not hold it.

    Why the service cannot be asked, the page's banner states.
    """
    if update is None:
        return "" if world.trouble else "The service is asked for this session."
    open_words = LEFT_OPEN if world.is_left_open(update) else "being taught"
    state = "closed" if update.closed else open_words
    gaps = len(update.status.gaps) + update.status.gaps_before
    segments = counted(len(update.segments), "segment")
    parts = [state, length_words(update), segments, _gaps(gaps), wrench_words(update.status.wrench)]
    return " · ".join([*parts, *_times(update)])


def _times(update: Update) -> list[str]:
    """Return text on the session time that the page displays as 0; none if it is 0."""
    words = clock_of(update.segments).words
    return [words] if words else []


def _gaps(count: int) -> str:
    return "no gaps" if count == 0 else counted(count, "gap")
