"""`caesura foxglove` beside a real service: a viewer receives what the service got and what it found."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.viewer.feed import StationFeed
from caesura_clients.viewer.foxglove_server import FoxgloveServer
from caesura_protocol.codec import decode
from caesura_protocol.messages import Ack, Heartbeat, SampleBatch
from caesura_protocol.transport.inbox import Inbox, Item, ReceivedSample
from caesura_protocol.transport.transport_interface import Transport
from clients.fake_service import eventually
from harness.commands import application
from harness.foxglove import Viewer, viewing
from harness.processes import RECORDING, SESSION, serving, start, teaching

STATION = "cell-1"


@contextmanager
def taught_to(viewer: Viewer, caesura: Caesura) -> Iterator[Future[Ack]]:
    """A demonstration that begins once the viewer has subscribed."""
    assert viewer.subscribed.wait(30.0)
    with teaching(caesura, STATION) as taught:
        yield taught


class LossyTransport:
    """Another transport, whose subscribers miss some batches of samples."""

    def __init__(self, transport: Transport, lost: Callable[[int], bool]) -> None:
        self._transport = transport
        self._lost = lost

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def subscribe(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        return self._transport.subscribe(key, _LossyInbox(inbox, self._lost))


class _LossyInbox(Inbox):
    def __init__(self, inbox: Inbox, lost: Callable[[int], bool]) -> None:
        super().__init__()
        self._inbox = inbox
        self._lost = lost

    def offer(self, item: Item) -> None:
        if isinstance(item, ReceivedSample) and item.key.endswith("/samples"):
            batch = decode(item.payload, item.encoding, SampleBatch, Heartbeat)
            if isinstance(batch, SampleBatch) and self._lost(batch.seq):
                return
        self._inbox.offer(item)


def test_samples_that_the_network_dropped_come_from_the_journal_in_order(tmp_path):
    """The first two batches, one in five, a second in the middle, and the last three."""
    last = len(RECORDING.t) // 20
    gone = {0, 1, *range(7, last, 5), *range(20, 26), last - 2, last - 1, last}
    with serving(tmp_path) as service, connect(service.endpoint) as caesura:
        server = FoxgloveServer("caesura test", "127.0.0.1", 0)
        feed = StationFeed(
            LossyTransport(caesura.transport, gone.__contains__), STATION, server, refresh_s=0.2
        )
        server.on_subscribe = feed.subscribed
        with server, feed, viewing(server.port) as viewer:
            assert feed.wait_until_following(30.0)
            with taught_to(viewer, caesura) as taught:
                taught.result(60.0)
            eventually(lambda: viewer.count("/state") >= RECORDING.t.size)
            states, wrenches = viewer.of("/state"), viewer.of("/wrench")
    assert [one["t"] for one in states] == RECORDING.t.tolist()
    assert [one["pos"] for one in states] == RECORDING.signals["pos"].tolist()
    assert [one["force"] for one in wrenches] == RECORDING.signals["force"].tolist()
    assert not [status for status in viewer.statuses if "not received" in status]


@pytest.mark.slow
def test_a_viewer_receives_a_session_as_it_is_taught_and_the_end_of_the_command_harms_nothing(tmp_path):
    command = [sys.executable, "-c", "from caesura_clients.cli import main; main()", "foxglove"]
    with serving(tmp_path) as service, connect(service.endpoint) as caesura:
        options = ("--station", STATION, "--port", "0", "--connect", service.endpoint)
        with start([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                said = process.stdout.readline()
                port = int(re.fullmatch(rf"{STATION}: ws://127.0.0.1:(\d+); Ctrl-C ends it\n", said)[1])
                with viewing(port) as viewer, taught_to(viewer, caesura) as taught:
                    taught.result(60.0)
                    eventually(lambda: any(one["complete"] for one in viewer.of("/program")))
                    eventually(lambda: viewer.count("/state") == RECORDING.t.size)
                    found = caesura.snapshot(STATION, SESSION)
                    newest = {one["t0"]: one["kind"] for one in viewer.of("/segments")}
                    for segment in found.segments.segments:
                        assert newest[segment.t0] == segment.kind
                    assert len(viewer.of("/program")[-1]["apps"]) == len(found.program.apps)
                    assert viewer.of("/wrench")[7]["force"] == RECORDING.signals["force"][7].tolist()
                process.send_signal(signal.SIGTERM)
                _, complaints = process.communicate(timeout=30.0)
            finally:
                process.kill()
        why = f"there is no station {STATION} yet; stations: none, waiting for {STATION}\n"
        assert (process.returncode, complaints) == (0, why)
        with teaching(caesura, "cell-2") as taught:
            taught.result(60.0)


def foxglove(*arguments: str):
    return CliRunner().invoke(application(), ["foxglove", *arguments])


def test_the_layout_is_written_without_a_service(tmp_path):
    out = tmp_path / "layout.json"
    done = foxglove("--layout", str(out))
    assert (done.exit_code, done.stdout) == (0, f"{out}: in Foxglove, Layouts, Import from file\n")
    assert "StateTransitions!caesura" in json.loads(out.read_text())["configById"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--host", "0.0.0.0"), "--host 0.0.0.0: other machines reach it, and a viewer needs no password"),
        (("--station", "no such"), "'no such'"),
    ],
)
def test_what_cannot_be_served_is_one_line(arguments, words):
    done = foxglove(*arguments)
    assert (done.exit_code, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert words in line


def test_without_its_extra_it_names_it(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "foxglove"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "caesura_clients.viewer.foxglove_server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    done = foxglove("--station", STATION)
    assert done.stderr == (
        "error: caesura foxglove needs foxglove: pip install '.[foxglove]' in a clone of Caesura\n"
    )
