"""The components of the folder `web` as NiceGUI elements: they receive payloads and emit events.

A browser acknowledges payloads. One that is UNSEEN payloads behind receives nothing until it has caught up,
and then one payload. Each payload is the difference from the last one sent, so a pause loses nothing, and
nothing queues for a tablet that sleeps.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.drawing_updates import beginning, correction_rows, delta
from caesura_clients.dashboard.program_timeline import changes
from caesura_clients.dashboard.station_summary import session_clock
from caesura_clients.session_state_reader import Update

UNSEEN = 3  # payloads that a browser may be behind
LAGS = 4096  # measured, of all browsers together

WEB, PACKAGE = Path(__file__).parent / "web", "caesura-dashboard"  # the modules, and their name in a browser
lags: deque[float] = deque(maxlen=LAGS)  # [s] from sending a payload to its acknowledgement by the browser


class LiveElement(Element, esm={PACKAGE: str(WEB)}):
    """A component whose content the server sends. initial: payload shown before the connection is open."""

    def __init__(self, initial: dict[str, Any] | None = None) -> None:
        super().__init__()
        if initial is not None:
            self._props["initial"] = initial
        self._last: dict[str, Any] | None = initial
        self._ready = False
        self.was_seen = False  # the browser has acknowledged a payload since it is connected
        self._sent: dict[int, float] = {}  # by number of payload, when; those that were not seen yet
        self._number = 0
        self.on("ready", self._begin)
        self.on("seen", self._saw)

    @property
    def is_free(self) -> bool:
        """Whether the browser is connected and has fewer than UNSEEN unacknowledged payloads."""
        return self._ready and len(self._sent) < UNSEEN

    def show(self, payload: dict[str, Any]) -> None:
        """Send a payload as the new content, unless it equals the last one or the browser is not free."""
        if self.is_free and payload != self._last:
            self._last = payload
            self.send(payload)

    def send(self, payload: dict[str, Any]) -> None:
        """Send a payload, also if it equals the last one."""
        self._number += 1
        self._sent[self._number] = time.monotonic()
        self.run_method("take", self._number, payload)

    def set_editable(self, *, editable: bool, why: str = "") -> None:
        """Make the component editable or read-only. why: a sentence on the reason for read-only."""
        if (self._props.get("editable"), self._props.get("why", "")) != (editable, why):
            self._props |= {"editable": editable, "why": why}
            self.update()

    def _begin(self) -> None:
        """Mark the component as ready in the browser, for the first time or after a reconnection."""
        self._ready, self._last, self.was_seen = True, None, False
        self._sent.clear()

    def _saw(self, event: GenericEventArguments) -> None:
        began = self._sent.pop(int(event.args), None)
        if began is not None:
            self.was_seen = True
            lags.append(time.monotonic() - began)


class Overview(LiveElement, component="web/overview.js"):
    """Cards of all stations: {stations, summary}."""


class Tables(LiveElement, component="web/tables.js"):
    """Tables and warnings: {warnings, tables}."""


class StartStop(LiveElement, component="web/start_stop.js"):
    """Buttons Start and Stop of a station (`demonstration_requests.controls`).

    on_ask: called with each request.
    """

    def __init__(self, initial: dict[str, Any], on_ask: Callable[[GenericEventArguments], Any]) -> None:
        super().__init__(initial)
        self.on("ask", on_ask)

    def answered(self, command: str, message: str, *, failed: bool) -> None:
        """Show the outcome of a command, `start` or `stop`."""
        self.run_method("answered", command, message, failed)


class HintBanner(LiveElement, component="web/hints.js"):
    """Hints to the teacher (`hint_banner.banner_of`)."""


class DescriptionForm(LiveElement, component="web/description.js"):
    """Form that describes a session (`demonstration_requests.description_of`). on_ask: as in StartStop."""

    def __init__(
        self,
        initial: dict[str, Any],
        on_ask: Callable[[GenericEventArguments], Any],
        *,
        editable: bool,
        live: bool,
    ) -> None:
        super().__init__(initial)
        self._props |= {"editable": editable, "live": live}
        self.on("ask", on_ask)

    def answered(self, message: str, *, failed: bool, found: dict[str, Any] | None = None) -> None:
        """Show the outcome of a change. found: values that another operator has set meanwhile.

        The next call of `show` sends its description also if it equals the last one: another operator may
        have reverted the change before the browser was sent it.
        """
        self.run_method("answered", message, failed, found)
        self._last = None


class RecordingDrop(LiveElement, component="web/recordings.js"):
    """Drop area and list of played recordings: {plays}. on_ask: called with each request."""

    def __init__(
        self, initial: dict[str, Any], on_ask: Callable[[GenericEventArguments], Any], **known: Any
    ) -> None:
        super().__init__(initial)
        self._props |= known
        self.on("ask", on_ask)

    def show_questions(self, found: dict[str, Any]) -> None:
        """Show the open questions of a recording."""
        self.run_method("looked", found)

    def answered(self, message: str, *, failed: bool) -> None:
        """Show the outcome of playing a recording."""
        self.run_method("answered", message, failed)


class SessionList(LiveElement, component="web/session_list.js"):
    """Sessions with search, filters and order: {warning, answers, damaged, sessions}.

    on_older: called to load older sessions. on_ask: called with {station, request} to delete or restore one.
    """

    def __init__(
        self,
        initial: dict[str, Any],
        on_older: Callable[[GenericEventArguments], Any],
        on_ask: Callable[[GenericEventArguments], Any],
        *,
        editable: bool,
    ) -> None:
        super().__init__(initial)
        self._props["editable"] = editable
        self.on("older", on_older)
        self.on("ask", on_ask)

    def answered(self, message: str, *, failed: bool) -> None:
        """Show the outcome of loading older sessions."""
        self.run_method("answered", message, failed)

    def described(self, message: str, *, failed: bool) -> None:
        """Show the outcome of a deletion or of its undo."""
        self.run_method("described", message, failed)


class ProgramTimeline(LiveElement, component="web/program.js"):
    """Timeline of a task program (`program_timeline.Timeline`). on_edit: called with an `EditProgram`.

    The browser's event holds the edit as plain values.
    """

    def __init__(
        self,
        on_edit: Callable[[GenericEventArguments], Any],
        on_simulate: Callable[[GenericEventArguments], Any],
        on_cancel: Callable[[], Any],
        on_compare: Callable[[GenericEventArguments], Any],
        on_part: Callable[[GenericEventArguments], Any],
        *,
        editable: bool,
        speeds: Sequence[str],
    ) -> None:
        """on_simulate: called with one of `speeds`.

        Empty `speeds` disable the simulation. on_cancel: ends it. on_compare: called with the numbers of the
        last edits of two versions. on_part: called with the number of the last app to list; None: the newest.
        """
        super().__init__()
        self._props |= {"editable": editable, "speeds": list(speeds)}
        self._known: dict[str, Any] = {}
        self.on("edit", on_edit)
        self.on("simulate", on_simulate)
        self.on("cancel", on_cancel)
        self.on("compare", on_compare)
        self.on("part", on_part)

    def follow(self, timeline: dict[str, Any]) -> None:
        """Send the changes of a timeline. If the browser is not free, the next call sends them."""
        if self.is_free and (payload := changes(self._known, timeline)):
            self._known = timeline
            self.send(payload)

    def forget(self) -> None:
        """Show no program, because its session no longer exists."""
        if self.is_free and self._known:
            self._known = {}
            self.send({"gone": True})

    def set_answered(self, *, answers: bool) -> None:
        """State whether the service answers: without it, no program does not mean that nothing was taught."""
        if self._props.get("answers", True) != answers:
            self._props["answers"] = answers
            self.update()

    def _begin(self) -> None:
        super()._begin()
        self._known = {}

    def compared(self, found: dict[str, Any]) -> None:
        """Show how two versions differ (`program_differences.compared_versions`)."""
        self.run_method("compared", found)

    def simulated(self, found: dict[str, Any]) -> None:
        """Show the outcome of a simulation (`Simulator.run`)."""
        self.run_method("simulated", found)

    def answered(
        self, message: str, *, failed: bool, found: dict[str, Any] | None = None, revision: int | None = None
    ) -> None:
        """Show the outcome of an edit.

        found: values that another operator has set meanwhile. revision: of the program's edits, to which a
        refusal applies.
        """
        self.run_method("answered", message, failed, found, revision)


class SessionView(LiveElement, component="web/session_view.js"):
    """Signals, segments and tools. on_edit: called with an operator's request, as the browser sends it."""

    def __init__(
        self,
        station: str,
        update: Update | None,
        *,
        editable: bool,
        replay: bool,
        on_edit: Callable[[GenericEventArguments], Any],
        on_preview: Callable[[GenericEventArguments], Any],
        linked: bool = False,
    ) -> None:
        """update: the session's state when the page is built.

        on_preview: called as on_edit, to request the effect only. linked: scrolls and zooms with the page's
        other view.
        """
        self._at_first, initial = beginning(update)
        super().__init__(initial)
        self._props |= {"station": station, "editable": editable, "replay": replay, "linked": linked}
        self._known = self._at_first
        self._stands: dict[str, Any] = {}
        self.shows_run_lengths = False
        self.on("edit", on_edit)
        self.on("preview", on_preview)
        self.on("run-lengths", self._want)

    def follow(self, update: Update | None, more: dict[str, Any]) -> None:
        """Send the changes of a session. If the browser is not free, the next call sends them.

        more: added to the payload; dropped if the browser is not free.
        """
        if not self.is_free:
            return
        known, payload = delta(self._known, update)
        if payload or more:
            self.send(payload | more)
        self._known = known

    def changed_edit_state(self, update: Update) -> dict[str, Any]:
        """Return those of revision, undo, redo and corrections that changed since the last call."""
        stands: dict[str, Any] = {
            name: getattr(update.status, name) for name in ("session", "revision", "undoable", "redoable")
        }
        clock = session_clock(update)
        stands["corrections"] = update.program.corrections, clock
        known = self._stands if self._stands.get("session") == update.session else {}
        self._stands = stands
        changed = {name: value for name, value in stands.items() if known.get(name) != value}
        if "corrections" in changed:
            changed["corrections"] = correction_rows(update.program.corrections, clock)
        return changed

    def answered(self, message: str, *, failed: bool, revision: int | None = None, doubt: str = "") -> None:
        """Show the outcome of a correction.

        revision: of the session, to which a refusal applies. doubt: why the correction may make no sense.
        """
        self.run_method("answered", message, failed, revision, doubt)

    def previewed(self, found: dict[str, Any]) -> None:
        """Show the effect that a correction would have (`correction_requests.preview`)."""
        self.run_method("previewed", found)

    def _begin(self) -> None:
        super()._begin()
        self._known, self._stands = self._at_first, {}
        self.shows_run_lengths = False

    def _want(self, event: GenericEventArguments) -> None:
        self.shows_run_lengths = bool(event.args)
