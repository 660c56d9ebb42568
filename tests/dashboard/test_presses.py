"""Each press of Start and Stop is carried out, or the page states why it was not."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Self

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from caesura_clients.demonstration_control import CONTROL_TIMEOUT_S
from caesura_protocol.codec import decode, encode, encode_error
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import BridgeAck, BridgeControl, BridgeStatus, Start, Stop
from caesura_protocol.messages.field_types import BridgeState
from caesura_protocol.transport.inbox import Inbox, IncomingQuery, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import Transport
from dashboard.browser import CLICK, DESK, LOOK_MS, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.demonstrations import guided
from harness.processes import DEADLINE_S

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
STATION = "cell-1"
REPEATED_S = 0.2  # the status of a bridge
SOON_MS = 200  # within half a second a second click counts as a double click
UNANSWERED_S = CONTROL_TIMEOUT_S / 2  # in which no command without an answer is given up
AT_ONCE = 40  # presses; more than the 32 threads that Python offers at most
DISCONNECT = "() => { window.socket.emit = () => {}; }"  # as a connection that is lost, and never comes back
# The component of an element sends a request so often.
ASK = """(element, [request, count]) => {
  const component = getElement(Number(element.id.replace("c", "")));
  for (let i = 0; i < count; i += 1) component.$emit("ask", request);
}"""


class Asked:
    """A command that a bridge has received, until it is answered."""

    def __init__(self, command: Start | Stop, query: IncomingQuery) -> None:
        self.command, self._query = command, query

    def done(self, session: str, state: BridgeState) -> None:
        """The bridge, which is in this state now, acknowledges it."""
        with self._query:
            key = station_key(STATION, "bridge_control")
            self._query.reply(key, encode(BridgeAck(session=session, state=state)))

    def refuse(self, code: ErrorCode, why: str) -> None:
        with self._query:
            self._query.refuse(encode_error(ProtocolError(code, why)))


class ScriptedBridge:
    """A bridge of cell-1 in standby whose states and answers the test sets."""

    def __init__(self, transport: Transport) -> None:
        self._transport, self._inbox = transport, Inbox()
        self._status = BridgeStatus(station=STATION, bridge="scripted", state="ready", source="scripted")
        self._over, self._stack = threading.Event(), ExitStack()
        self._connected, self._is_silent = ExitStack(), True

    def __enter__(self) -> Self:
        beat = threading.Thread(target=self._repeat, daemon=True)
        beat.start()
        self._stack.callback(beat.join)
        self._stack.callback(self._over.set)
        control = station_key(STATION, "bridge_control")
        self._stack.enter_context(self._transport.declare_queryable(control, self._inbox))
        self._stack.callback(self.disconnects)
        self.connects()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def connects(self) -> None:
        """It is there, again."""
        self._connected.enter_context(self._transport.declare_token(station_key(STATION, "alive")))
        self._is_silent = False

    def disconnects(self) -> None:
        """The connection to it is lost."""
        self._is_silent = True
        self._connected.close()

    def states(self, state: BridgeState, session: str | None = None) -> None:
        """Publish another state."""
        self._status = self._status.model_copy(update={"state": state, "session": session})
        self._publish()

    def asked(self, kind: type[Start | Stop], within_s: float = DEADLINE_S) -> Asked:
        """The next command, which is of this kind."""
        query = self._inbox.get(within_s)
        assert query is not None, "nothing was asked"
        assert not isinstance(query, ReceivedSample | TokenChange)
        assert query.content is not None
        command = decode(*query.content, BridgeControl).command
        assert isinstance(command, kind)
        return Asked(command, query)

    def _publish(self) -> None:
        self._transport.put(station_key(STATION, "bridge_status"), encode(self._status))

    def _repeat(self) -> None:
        while not self._over.wait(REPEATED_S):
            if not self._is_silent:
                self._publish()


@pytest.fixture
def bridge(stage: Stage) -> Iterator[ScriptedBridge]:
    with stage.reader() as caesura, ScriptedBridge(caesura.transport) as bridge:
        yield bridge


@pytest.fixture
def page(stage: Stage, bridge: ScriptedBridge, opened: Visitor) -> Iterator[Page]:
    opened.begin_again(DESK)
    opened.page.goto(f"{stage.dashboard.url}/station/{STATION}")
    expect(opened.page.locator(".desk-state")).to_have_text("Ready")
    yield opened.page
    assert opened.errors == []


def start(page: Page, bridge: ScriptedBridge, session: str) -> None:
    """Start a demonstration, which is taught from then on."""
    page.locator(".desk .task").press("Enter")
    asked = bridge.asked(Start)
    bridge.states("teaching", session)
    asked.done(session, "teaching")
    expect(page.locator("button.stop")).to_be_enabled()


def stops(page: Page, bridge: ScriptedBridge, session: str) -> None:
    """The bridge is asked to stop this demonstration, and stops it."""
    asked = bridge.asked(Stop)
    assert asked.command.session == session
    bridge.states("ready")
    asked.done(session, "ready")
    expect(page.locator(".desk-state")).to_have_text("Ready")


def test_a_stop_soon_after_the_last_one_is_carried_out(page: Page, bridge: ScriptedBridge):
    """It passed for a double click: the bridge taught on, and the page said nothing."""
    stop = page.locator("button.stop")
    start(page, bridge, "first")
    at = stop.evaluate(CLICK)
    stops(page, bridge, "first")
    start(page, bridge, "second")
    stop.evaluate(CLICK, at + SOON_MS)
    stops(page, bridge, "second")


def test_a_refused_start_is_stated_until_another_demonstration(page: Page, bridge: ScriptedBridge):
    """The state of the bridge came and went with the start, and took the reason along within 0.1 s."""
    task, why = page.locator(".desk .task"), page.locator("#desk-why")
    task.fill("wipe")
    task.press("Enter")
    asked = bridge.asked(Start)
    bridge.states("starting", "first")
    expect(page.locator(".desk-state")).to_have_text("Starting …")
    asked.refuse("overloaded", "nothing was taught, try again: the journal is full")
    expect(why).to_contain_text("the journal is full")
    bridge.states("ready")
    expect(page.locator(".desk-state")).to_have_text("Ready")
    expect(why).to_contain_text("the journal is full")
    expect(task, "what is typed stays").to_have_value("wipe")
    bridge.states("teaching", "of-another")
    expect(page.locator(".desk-state")).to_contain_text("Teaching")
    expect(why).to_contain_text("Stop ends this demonstration")


def test_a_start_beside_the_demonstration_of_another_operator_says_so(page: Page, bridge: ScriptedBridge):
    """The page went from Ready to Teaching as after a start of its own."""
    why = page.locator("#desk-why")
    page.locator(".desk .task").press("Enter")
    asked = bridge.asked(Start)
    asked.refuse("conflict", "cell-1 has demonstration first, which was started by Bo: stop it first")
    expect(why).to_contain_text("was started by Bo")
    bridge.states("teaching", "first")
    expect(page.locator(".desk-state")).to_contain_text("Teaching")
    expect(why).to_contain_text("was started by Bo")
    page.locator("button.stop").click()
    stops(page, bridge, "first")
    expect(why).to_have_text("")


def test_a_stop_of_a_page_that_is_behind_states_that_another_demonstration_goes_on(
    page: Page, bridge: ScriptedBridge
):
    """The bridge acknowledged the stop of one that was over, and taught on; the page said nothing."""
    start(page, bridge, "first")
    page.locator("button.stop").click()
    asked = bridge.asked(Stop)  # another operator has stopped it, and started the next one
    bridge.states("teaching", "second")
    why = page.locator("#desk-why")
    while asked.command.session == "first":  # until the page has the state of the bridge
        asked.done("first", "teaching")
        expect(why).to_contain_text(
            "first is over, and cell-1 teaches another demonstration: press Stop again"
        )
        page.locator("button.stop").click()
        asked = bridge.asked(Stop)
    bridge.states("ready")
    asked.done("second", "ready")
    expect(page.locator(".desk-state")).to_have_text("Ready")
    expect(why).to_have_text("")


def test_stop_waits_for_no_answer_to_start(page: Page, bridge: ScriptedBridge):
    """It could not be pressed for 15 s where that answer was lost."""
    page.locator(".desk .task").press("Enter")
    started = bridge.asked(Start)
    bridge.states("teaching", "first")
    expect(page.locator(".desk-state")).to_contain_text("Teaching")
    expect(page.locator("button.stop")).to_be_enabled(timeout=1000 * UNANSWERED_S)
    page.locator("button.stop").click()
    expect(page.locator("#desk-why")).to_have_text("Stopping …")
    stops(page, bridge, "first")
    expect(page.locator("button.start")).to_be_disabled()
    started.refuse("overloaded", "first is still being opened: try again")
    expect(page.locator("button.start")).to_be_enabled()
    expect(page.locator("#desk-why"), "it was opened, and stopped").to_have_text("")


@pytest.mark.parametrize("name", ["Start", "Stop"])
def test_a_press_that_is_lost_with_the_bridge_is_stated_once_it_is_back(
    page: Page, bridge: ScriptedBridge, name: str
):
    """A service that hung took the command with it, and was the router: the page forgot why meanwhile."""
    why = page.locator("#desk-why")
    if name == "Start":
        page.locator(".desk .task").press("Enter")
        asked = bridge.asked(Start)
    else:
        start(page, bridge, "first")
        page.locator("button.stop").click()
        asked = bridge.asked(Stop)
    asked.refuse("overloaded", "the connection is lost")
    expect(why).to_contain_text("the connection is lost")
    bridge.disconnects()
    expect(why).to_contain_text("No bridge is connected at cell-1")
    bridge.connects()
    expect(why).to_contain_text("the connection is lost")
    expect(page.get_by_role("button", name=name)).to_be_enabled()


def test_a_command_without_an_answer_may_still_be_executed(page: Page, bridge: ScriptedBridge):
    """The page stated *Not done*, and a bridge that had hung stopped later."""
    start(page, bridge, "first")
    page.locator("button.stop").click()
    asked = bridge.asked(Stop)
    why = page.locator("#desk-why")
    expect(why).to_contain_text("The bridge of cell-1 has not answered in 15 s, and may still stop.")
    expect(page.locator("button.stop")).to_be_enabled()
    bridge.states("ready")
    asked.done("first", "ready")
    expect(why).to_have_text("")


def test_no_press_waits_for_those_at_other_stations(page: Page, bridge: ScriptedBridge):
    """Six threads carried out all that waits for a bridge or a service: the seventh Stop came 12 s later."""
    start(page, bridge, "first")
    page.locator(".desk").evaluate(ASK, [{"type": "stop", "session": "first"}, AT_ONCE])
    waiting = [bridge.asked(Stop, UNANSWERED_S) for _ in range(AT_ONCE)]
    bridge.states("ready")
    for asked in waiting:
        asked.done("first", "ready")


def test_a_page_without_its_dashboard_states_that_what_it_shows_is_old(page: Page, bridge: ScriptedBridge):
    """It taught on in green, however long ago the connection was lost."""
    state, why = page.locator(".desk-state"), page.locator("#desk-why")
    start(page, bridge, "first")
    expect(state).to_contain_text("Teaching")
    page.evaluate("() => window.socket.disconnect()")
    expect(state).to_have_text("Stale")
    expect(page.locator(".desk")).to_have_class("desk desk-stale")
    expect(why).to_have_text("The connection to the dashboard is lost: what is shown is old.")
    page.evaluate("() => window.socket.connect()")
    expect(state).to_contain_text("Teaching")


def test_the_list_of_stations_without_its_dashboard_states_that_it_is_old(
    stage: Stage, page: Page, bridge: ScriptedBridge
):
    badge, summary = page.locator(".card .badge-said").first, page.locator(".summary")
    page.goto(stage.dashboard.url)
    expect(badge).to_be_visible()
    expect(badge).not_to_have_text("stale")
    page.wait_for_function("() => window.did_handshake", polling=LOOK_MS)
    page.evaluate("() => window.socket.disconnect()")
    expect(badge).to_have_text("stale")
    expect(summary).to_have_text("The connection to the dashboard is lost: what is shown is old.")


def test_a_page_that_its_dashboard_never_answers_states_that_what_it_shows_is_old(
    stage: Stage, page: Page, bridge: ScriptedBridge
):
    """It showed what it was loaded with, for ever, as if that held."""
    with closing(page.context.new_page()) as alone:
        alone.route("**/socket.io/**", lambda request: request.abort())
        alone.route_web_socket(re.compile("socket.io"), lambda socket: socket.close())
        alone.goto(stage.dashboard.url)
        expect(alone.locator(".card .badge-said").first).to_have_text("stale")
        expect(alone.locator(".summary")).to_contain_text("what is shown is old")


@pytest.mark.parametrize("name", ["Start", "Stop"])
def test_a_press_that_is_lost_with_the_connection_is_stated(page: Page, bridge: ScriptedBridge, name: str):
    """The page loaded itself again, and showed the station as if nothing had been pressed."""
    why, button = page.locator("#desk-why"), page.get_by_role("button", name=name)
    if name == "Stop":
        start(page, bridge, "first")
    page.evaluate(DISCONNECT)
    button.click()
    page.reload()
    expect(why).to_contain_text(f"{name} was pressed before this page was loaded again")
    button.click()
    if name == "Stop":
        stops(page, bridge, "first")
    else:
        asked = bridge.asked(Start)
        bridge.states("teaching", "first")
        asked.done("first", "teaching")
        expect(page.locator(".desk-state")).to_contain_text("Teaching")
    expect(why).not_to_contain_text("was pressed")
    page.reload()
    expect(page.locator("button.start")).to_be_visible()
    expect(why, "it is answered").not_to_contain_text("was pressed")


def test_a_task_that_is_typed_for_the_next_demonstration_stays_at_stop(
    stage: Stage, page: Page, bridge: ScriptedBridge
):
    """That of the last demonstration took its place."""
    task = page.locator(".desk .task")
    stage.teach(STATION, guided(), session="last", pace="fast")
    stage.wait(STATION)
    with stage.reader() as caesura:
        caesura.describe(STATION, "last", author="Ann", task="wipe")
    expect(task, "as a suggestion").to_have_value("wipe")
    start(page, bridge, "first")
    task.fill("polish")
    page.locator("button.stop").click()
    stops(page, bridge, "first")
    expect(page.locator("button.start")).to_be_enabled()
    expect(task).to_have_value("polish")


def test_a_held_stop_ends_the_demonstration_on_which_it_was_pressed(page: Page, bridge: ScriptedBridge):
    """It ended the one that had begun before the button was released."""
    stop, why = page.locator("button.stop"), page.locator("#desk-why")
    stop.hover(force=True)  # it is disabled
    page.mouse.down()
    start(page, bridge, "first")
    page.mouse.up()
    page.mouse.down()
    bridge.states("ready")
    expect(stop).to_be_disabled()
    bridge.states("teaching", "second")
    expect(stop).to_be_enabled()
    page.mouse.up()
    asked = bridge.asked(Stop)
    assert asked.command.session == "first"
    asked.done("first", "teaching")
    expect(why).to_contain_text("first is over, and cell-1 teaches another demonstration: press Stop again")
    stop.click()
    stops(page, bridge, "second")


def test_the_space_bar_stops_when_it_is_pressed(page: Page, bridge: ScriptedBridge):
    """It stopped when it was released, and not at all where the button was disabled meanwhile."""
    start(page, bridge, "first")
    page.locator("button.stop").focus()
    page.keyboard.down("Space")
    stops(page, bridge, "first")
    start(page, bridge, "second")
    page.keyboard.up("Space")
    page.locator("button.stop").press("Space")
    stops(page, bridge, "second")
