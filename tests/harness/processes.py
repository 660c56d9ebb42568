"""Real processes for tests of what goes wrong: a router, services to be killed or frozen, bridges that teach.

Everything is over loopback. Nothing waits by sleeping: `eventually` looks again until its deadline.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, TypeVar

from caesura_clients import Caesura
from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import Ack, Segment, SessionStatus, Snapshot
from caesura_protocol.recording import Recording
from caesura_service.segmentation.pipeline_interface import PipelineView
from clients.conftest import free_port
from harness.demonstrations import guided
from harness.forked import CAN_FORK, Forked

PYTEST = "PYTEST_CURRENT_TEST"
CAESURA = (sys.executable, "-c", "from caesura_clients.cli import main; main()")
DEADLINE_S = 60.0
PACE = 6.0  # times as fast as the hand: a demonstration takes a second
QUICK = BridgeSettings(heartbeat_s=0.05, retry_s=0.05, close_timeout_s=DEADLINE_S)
RECORDING = guided()
SAMPLES = len(RECORDING.t)
SESSION = "s1"

_ROUTER = """
import json, sys, threading, zenoh
from caesura_service.server.network_join import SETTINGS
config = zenoh.Config()
for key, value in {**SETTINGS, "mode": "router", "listen/endpoints": [sys.argv[1]]}.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config):
    print("ready", flush=True)
    threading.Event().wait()
"""


def start(
    command: Sequence[str], *, imports: Sequence[str] = (), **options: Any
) -> subprocess.Popen[str] | Forked:
    """A process; of a test a forked one, else, for what is measured, one as a user has it."""
    if PYTEST in os.environ and CAN_FORK:
        return Forked(command, imports=imports, **options)
    return subprocess.Popen(command, text=True, **options)


@contextmanager
def started(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[str] | Forked]:
    """As `start`; what still runs in the end is killed, so that no test waits for it for ever."""
    with start(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def environment() -> dict[str, str]:
    """Ours, without the name of a test, by which NiceGUI would take itself for a test of its own."""
    return {name: value for name, value in os.environ.items() if name != PYTEST}


class Process:
    """A process that prints a line once it is ready, and can be killed, frozen and started again."""

    imports: tuple[str, ...] = ()  # what others of its class need too

    def __init__(self, command: Sequence[str]) -> None:
        self.command = list(command)
        self._process: subprocess.Popen[str] | Forked | None = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        """Returns once it is ready."""
        self.begin()
        self.ready()

    def begin(self) -> None:
        """Do not wait until it is ready."""
        self._process = start(self.command, imports=self.imports, stdout=subprocess.PIPE, env=environment())

    def ready(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert "ready" in line, f"{self.command} said {line!r}"

    def kill(self) -> None:
        """−9, also where it is frozen; one that has ended is no error."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate(timeout=DEADLINE_S)

    def end(self) -> int:
        """SIGTERM; the exit code."""
        assert self._process is not None
        self._process.terminate()
        self._process.communicate(timeout=DEADLINE_S)
        return self._process.returncode

    def freeze(self) -> None:
        """It keeps everything and does nothing, like a machine that hangs."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """It goes on where it was."""
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)


class Router(Process):
    """A Zenoh router of its own."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        super().__init__([sys.executable, "-c", _ROUTER, self.endpoint])


class ServiceProcess(Process):
    """`caesura serve` on a journal: a router itself, by tcp or tls, or client of `router`, an endpoint."""

    def __init__(
        self, journal: Path, *options: str, router: str | None = None, protocol: str = "tcp"
    ) -> None:
        self.endpoint = router or f"{protocol}/127.0.0.1:{free_port()}"
        self.journal = journal
        where = ("--listen" if router is None else "--connect", self.endpoint)
        command = [sys.executable, "-m", "caesura_service", "serve", "--log-level", "warning", *where]
        super().__init__([*command, "--journal", str(journal), *options])


P = TypeVar("P", bound=Process)


@contextmanager
def running(process: P) -> Iterator[P]:
    """Started, and killed in the end."""
    try:
        process.start()
        yield process
    finally:
        process.kill()


def serving(
    journal: Path, *options: str, router: str | None = None
) -> AbstractContextManager[ServiceProcess]:
    """A service that runs while the context lasts."""
    return running(ServiceProcess(journal, *options, router=router))


@contextmanager
def teaching(
    caesura: Caesura, station: str, *, recording: Recording = RECORDING, pace: float = PACE
) -> Iterator[Future[Ack]]:
    """A bridge that plays the recording in a thread of its own; the acknowledgement of its end."""
    source = FileSource(recording, pace=pace)
    with (
        Bridge(caesura.transport, station, source, session=SESSION, settings=QUICK) as bridge,
        ThreadPoolExecutor(1) as pool,
    ):
        yield pool.submit(bridge.run)


def eventually(true: Callable[[], bool], deadline_s: float = DEADLINE_S) -> None:
    deadline = time.monotonic() + deadline_s
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def snapshot(caesura: Caesura, station: str) -> Snapshot | None:
    try:
        return caesura.snapshot(station, SESSION)
    except (CaesuraError, ProtocolError):
        return None  # not yet, or not now


def first_snapshot(caesura: Caesura, station: str, holds: Callable[[SessionStatus], bool]) -> Snapshot:
    """The first snapshot that is known whose status holds."""
    found: list[Snapshot] = []

    def there() -> bool:
        now = snapshot(caesura, station)
        found[:] = [now] if now else []
        return now is not None and holds(now.status)

    eventually(there)
    return found[0]


def reaches(caesura: Caesura, station: str, samples: int) -> Snapshot:
    """The first snapshot that is known with so many samples."""
    return first_snapshot(caesura, station, lambda status: status.samples >= samples)


def closed(caesura: Caesura, station: str) -> Snapshot:
    """The first snapshot of the closed session.

    The instance that takes a station over has the last batches for an instant before it has the close.
    """
    return first_snapshot(caesura, station, lambda status: status.state == "closed")


def assert_equal(found: Snapshot, expected: PipelineView, samples: int = SAMPLES) -> None:
    """Closed, with nothing lost or doubled, and equal to an undisturbed run in every field."""
    status = found.status
    assert status.state == "closed"
    assert (status.samples, status.repeats, status.gaps) == (samples, 0, ()), "lost or duplicated"
    assert (status.observations, status.t) == (expected.observations, expected.t)
    assert status.refused == {}, status.last_refusal
    assert found.segments.segments == expected.segments
    assert found.changepoints.changepoints == expected.changepoints
    assert found.program.complete
    assert found.program.apps == expected.apps
    assert found.program.notes == expected.notes


def finals(found: Snapshot) -> list[Segment]:
    """What was promised never to be revised."""
    return [segment for segment in found.segments.segments if segment.certainty == "final"]


def assert_kept(promised: list[Segment], found: Snapshot) -> None:
    assert list(found.segments.segments[: len(promised)]) == promised
