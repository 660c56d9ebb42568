"""The clients and the real service, as two processes with Zenoh between them."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_clients.cli.commands import register
from caesura_protocol.errors import NotFound, ProtocolError
from clients.bridging import QUICK
from clients.conftest import free_port
from clients.examples import LiveSource, recording, samples, until_complete
from clients.fake_service import eventually
from harness.processes import start

pytest.importorskip("caesura_service.commands")

BRIDGE = [sys.executable, "-c", "from caesura_clients.cli import main; main()", "bridge"]
SERVE = [
    sys.executable,
    "-c",
    "from caesura_clients.cli import main; main()",
    "serve",
    "--journal",
    "memory",
    "--log-level",
    "warning",
]


@contextmanager
def serving(endpoint: str, end: signal.Signals = signal.SIGTERM) -> Iterator[None]:
    with start([*SERVE, "--listen", endpoint], stdout=subprocess.PIPE) as process:
        try:
            assert "ready" in process.stdout.readline()
            yield
        finally:
            process.send_signal(end)
            try:
                process.wait(60.0)
            finally:
                process.kill()


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    address = f"tcp/127.0.0.1:{free_port()}"
    with serving(address):
        yield address


def test_a_recording_becomes_segments_and_a_program(endpoint):
    with connect(endpoint) as caesura:
        with caesura.bridge("cell-1", FileSource(recording(3000), pace=FAST), settings=QUICK) as bridge:
            assert bridge.run().next_seq == 150
        snapshot = caesura.snapshot("cell-1")
        assert (snapshot.status.samples, snapshot.status.gaps, snapshot.status.state) == (3000, (), "closed")
        assert snapshot.segments.segments
        assert caesura.program("cell-1").complete
        assert [(one.station, one.session) for one in caesura.sessions("cell-1")] == [
            ("cell-1", bridge.session)
        ]


def test_a_reader_that_follows_ends_up_with_what_a_late_one_is_sent(endpoint):
    last = []

    def follow() -> None:
        with connect(endpoint) as watching:
            last.append(until_complete(watching.results("cell-2", silence_s=30.0)))

    reader = threading.Thread(target=follow, daemon=True)
    reader.start()
    with (
        connect(endpoint) as caesura,
        caesura.bridge("cell-2", FileSource(recording(3000), pace=FAST)) as bridge,
    ):
        bridge.run()
        reader.join(60.0)
        snapshot = caesura.snapshot("cell-2")
    assert last[0].segments == snapshot.segments.segments
    assert last[0].changepoints == snapshot.changepoints.changepoints
    assert last[0].program == snapshot.program


def test_a_second_bridge_of_a_session_is_refused_with_the_one_that_has_it_and_takes_nothing_from_it(endpoint):
    with connect(endpoint) as one, connect(endpoint) as other:
        first = Bridge(one.transport, "cell-7", LiveSource(), session="s7", settings=QUICK)
        second = Bridge(
            other.transport, "cell-7", LiveSource([samples(2400, 100.0)]), session="s7", settings=QUICK
        )
        with first:
            first.wait_open(30.0)
            first.send(samples(1000))
            with (
                second,
                pytest.raises(ProtocolError, match="a second one needs a session of its own") as refused,
            ):
                second.run()
            assert str(refused.value.expected) in str(refused.value)
            first.send(samples(1000, 1.0))
            assert first.finish().next_seq == 100
        status = one.snapshot("cell-7").status
        assert (status.samples, status.duplicates, status.lost, status.t < 3.0) == (2000, 0, 0, True)


def test_a_service_that_is_killed_and_comes_back_has_everything():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        connect_once_served(endpoint) as caesura,
        Bridge(caesura.transport, "cell-3", LiveSource(), settings=QUICK) as bridge,
    ):
        with serving(endpoint, signal.SIGKILL):
            bridge.wait_open(30.0)
            for start in range(10):
                bridge.send(samples(100, t0=start / 10))
            eventually(lambda: caesura.snapshot("cell-3").status.samples == 1000)
        bridge.send(samples(500, t0=1.0))
        with serving(endpoint):
            bridge.send(samples(500, t0=1.5))
            assert bridge.finish().next_seq == 100
            status = caesura.snapshot("cell-3").status
            assert (status.samples, status.gaps) == (2000, ())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_bridge_that_is_ended_closes_its_session(endpoint, tmp_path, number):
    recording(20_000).save(tmp_path / "long.npz")
    session = f"ended-{int(number)}"
    options = ["--file", str(tmp_path / "long.npz"), "--session", session, "--connect", endpoint]
    command = [*BRIDGE, "--station", "cell-5", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with connect(endpoint) as caesura, start(command, **pipes) as process:
        try:
            eventually(lambda: taken_of(caesura, "cell-5", session) > 0, 60.0)
            process.send_signal(number)
            said, _ = process.communicate(timeout=60.0)
        finally:
            process.kill()
        assert (process.returncode, f"cell-5/{session} closed" in said) == (0, True)
        assert caesura.snapshot("cell-5", session).status.state == "closed"


def taken_of(caesura: Caesura, station: str, session: str) -> int:
    """Samples, none before there is such a session."""
    with suppress(NotFound):
        return caesura.snapshot(station, session).status.samples
    return 0


@pytest.mark.usefixtures("full_batches")
def test_bridge_reports_that_the_service_refused_every_batch(endpoint, tmp_path):
    # Times in microseconds, declared as seconds: it once said "closed, 5 batches" and ended with 0.
    seconds = recording(100)
    replace(seconds, t=seconds.t * 1e6).save(tmp_path / "micro.npz")
    app = typer.Typer()
    register(app)
    options = ("--station", "cell-4", "--session", "micro", "--pace", "fast", "--connect", endpoint)
    result = CliRunner().invoke(
        app, ["bridge", "--file", str(tmp_path / "micro.npz"), "--time-unit", "s", *options]
    )
    assert result.exit_code == 1
    assert result.stdout == "cell-4/micro closed, 5 batches\n"
    # The last to arrive is any of the five: one that is lost on the way is requested and comes later.
    assert re.search(r"cell-4/micro: 5 refused \(last: batch [0-4] lasts too long", result.stderr)


@contextmanager
def connect_once_served(endpoint: str) -> Iterator:
    """A connection that outlives the service it was made with."""
    with serving(endpoint):
        caesura = connect(endpoint)
    with caesura:
        yield caesura
