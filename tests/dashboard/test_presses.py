"""Each press of Start and Stop is carried out, or the page states why it was not."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from queue import SimpleQueue
from typing import Self

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from caesura_clients.bridge.query_responder import QueryThread
from caesura_protocol.codec import decode, encode, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import BridgeAck, BridgeControl, BridgeStatus, Start, Stop
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.transport_interface import Transport
from dashboard.browser import DESK, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness.processes import DEADLINE_S

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
STATION = "cell-1"
SOON_MS = 200  # within half a second a second click counts as a double click
# A click of the mouse at a time of the page's clock [ms]; the first one is now.
CLICK = """(button, at) => {
  const { x: clientX, y: clientY } = button.getBoundingClientRect();
  const click = new MouseEvent("click", { clientX, clientY, bubbles: true, cancelable: true, detail: 1 });
  Object.defineProperty(click, "timeStamp", { value: at ?? click.timeStamp });
  button.dispatchEvent(click);
  return click.timeStamp;
}"""
REPEATED_S = 0.2  # the status of a bridge
Answer = BridgeAck | ProtocolError | None


class ScriptedBridge:
    """A bridge in standby whose status and answers the test sets."""

    def __init__(self, transport: Transport, station: str = STATION) -> None:
        self.asked: SimpleQueue[Start | Stop] = SimpleQueue()
        self.answers: SimpleQueue[Answer] = SimpleQueue()
        self._transport, self._station = transport, station
        self._status = BridgeStatus(station=station, bridge="scripted", state="ready", source="scripted")
        self._over, self._stack = threading.Event(), ExitStack()

    def __enter__(self) -> Self:
        beat = threading.Thread(target=self._repeat, daemon=True)
        beat.start()
        self._stack.callback(beat.join)
        self._stack.callback(self._over.set)
        self._stack.callback(self.answers.put, None)
        alive = self._transport.declare_token(station_key(self._station, "alive"))
        self._stack.enter_context(alive)
        key = station_key(self._station, "bridge_control")
        self._stack.enter_context(QueryThread(self._transport, key, self._take))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def states(self, state: str, session: str | None = None, **more: object) -> None:
        """Publish a status."""
        self._status = self._status.model_copy(update={"state": state, "session": session, **more})
        self._publish()

    def _publish(self) -> None:
        self._transport.put(station_key(self._station, "bridge_status"), encode(self._status))

    def _repeat(self) -> None:
        while not self._over.wait(REPEATED_S):
            self._publish()

    def _take(self, asked: IncomingQuery) -> None:
        assert asked.content is not None
        self.asked.put(decode(*asked.content, BridgeControl).command)
        answer = self.answers.get(timeout=DEADLINE_S)
        if isinstance(answer, ProtocolError):
            asked.refuse(encode_error(answer))
        elif answer is not None:
            asked.reply(station_key(self._station, "bridge_control"), encode(answer))


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


def teach(page: Page, bridge: ScriptedBridge, session: str) -> None:
    """Start a demonstration, which is taught from then on."""
    page.locator(".desk .task").press("Enter")
    assert isinstance(bridge.asked.get(timeout=DEADLINE_S), Start)
    bridge.states("teaching", session)
    bridge.answers.put(BridgeAck(session=session, state="teaching"))
    expect(page.locator("button.stop")).to_be_enabled()


def stopped(bridge: ScriptedBridge) -> str | None:
    """The session that the bridge is asked to stop, and then stops."""
    command = bridge.asked.get(timeout=DEADLINE_S)
    assert isinstance(command, Stop)
    bridge.states("ready", last_session=command.session, outcome="is stored")
    bridge.answers.put(BridgeAck(session=command.session or "", state="ready"))
    return command.session


def test_a_stop_soon_after_the_last_one_is_carried_out(page: Page, bridge: ScriptedBridge):
    """It passed for a double click: the bridge taught on, and the page said nothing."""
    stop = page.locator("button.stop")
    teach(page, bridge, "first")
    at = stop.evaluate(CLICK)
    assert stopped(bridge) == "first"
    expect(page.locator(".desk-state")).to_have_text("Ready")
    teach(page, bridge, "second")
    stop.evaluate(CLICK, at + SOON_MS)
    assert stopped(bridge) == "second"
    expect(page.locator(".desk-state")).to_have_text("Ready")
