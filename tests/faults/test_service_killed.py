"""The service is killed in the middle of a demonstration and started again: nothing is lost, nothing comes
twice, and the results are those of an undisturbed run, field by field. Real processes, real Zenoh.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.errors import CaesuraError
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Segment, Snapshot
from caesura_service.recordings import segment_recording
from caesura_service.session.view import View
from clients.conftest import free_port
from harness.demonstrations import guided

DEADLINE_S = 30.0
PACE = 6.0  # times as fast as the hand: a demonstration takes a second
QUICK = BridgeSettings(heartbeat_s=0.05, retry_s=0.05, close_timeout_s=DEADLINE_S)
RECORDING = guided()
SAMPLES = len(RECORDING.t)


class Service:
    """`caesura serve` on a journal, which can be killed and started again at the same endpoint."""

    def __init__(self, journal: Path, *options: str) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.journal = journal
        command = [sys.executable, "-m", "caesura_service", "serve", "--log-level", "warning"]
        self._command = [*command, "--listen", self.endpoint, "--journal", str(journal), *options]
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert "ready" in self._process.stdout.readline()

    def kill(self) -> None:
        self._process.kill()  # −9
        self._process.communicate(timeout=DEADLINE_S)


@contextmanager
def serving(journal: Path, *options: str) -> Iterator[Service]:
    service = Service(journal, *options)
    try:
        yield service
    finally:
        service.kill()


@contextmanager
def teaching(caesura: Caesura, station: str) -> Iterator[Future[Ack]]:
    """A bridge that plays the recording in a thread of its own; the acknowledgement of its end."""
    source = FileSource(RECORDING, pace=PACE)
    with (
        Bridge(caesura.transport, station, source, session="s1", settings=QUICK) as bridge,
        ThreadPoolExecutor(1) as pool,
    ):
        yield pool.submit(bridge.run)


def eventually(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def snapshot(caesura: Caesura, station: str) -> Snapshot | None:
    try:
        return caesura.snapshot(station, "s1")
    except (CaesuraError, ProtocolError):
        return None  # not yet, or not now


def reaches(caesura: Caesura, station: str, samples: int) -> Snapshot:
    """The first snapshot that is known with so many samples."""
    found: list[Snapshot] = []

    def there() -> bool:
        now = snapshot(caesura, station)
        found[:] = [now] if now else []
        return now is not None and now.status.samples >= samples

    eventually(there)
    return found[0]


@pytest.fixture(scope="module")
def undisturbed() -> View:
    """What the same samples give without a network, a service or a journal."""
    return segment_recording(RECORDING)


def assert_equal(found: Snapshot, expected: View) -> None:
    status = found.status
    assert status.state == "closed"
    assert (status.samples, status.repeats, status.gaps) == (SAMPLES, 0, ()), "lost or duplicated"
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


@pytest.mark.parametrize("commit_s", ["0.05", "5"])
def test_killed_at_three_moments_of_a_demonstration(tmp_path, undisturbed, commit_s):
    with serving(tmp_path, "--journal-commit-s", commit_s) as service, ExitStack() as stack:
        caesura = stack.enter_context(connect(service.endpoint, timeout_s=DEADLINE_S))
        end = stack.enter_context(teaching(caesura, "cell-1"))
        for share in (0.2, 0.5, 0.8):
            told = reaches(caesura, "cell-1", round(share * SAMPLES))
            service.kill()
            service.start()
            assert_kept(finals(told), reaches(caesura, "cell-1", told.status.samples))
        assert end.result(DEADLINE_S).state == "closed"
        assert_equal(reaches(caesura, "cell-1", SAMPLES), undisturbed)


def test_several_stations_survive_together_and_what_was_acknowledged_needs_no_bridge(tmp_path, undisturbed):
    stations = ("cell-1", "cell-2", "cell-3")
    with serving(tmp_path, "--journal-commit-s", "5") as service:
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura, ExitStack() as stack:
            ends = [stack.enter_context(teaching(caesura, station)) for station in stations]
            reaches(caesura, "cell-2", SAMPLES // 2)
            service.kill()
            service.start()
            assert all(end.result(DEADLINE_S).state == "closed" for end in ends)
            service.kill()
        service.start()
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura:
            for station in stations:
                assert_equal(reaches(caesura, station, SAMPLES), undisturbed)


def truncate(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-3000])


def corrupt(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-4096] + b"\xff" * 4096)


@pytest.mark.parametrize("damage", [truncate, corrupt])
def test_killed_with_a_damaged_tail_of_the_log(tmp_path, undisturbed, damage):
    with serving(tmp_path) as service, ExitStack() as stack:
        caesura = stack.enter_context(connect(service.endpoint, timeout_s=DEADLINE_S))
        end = stack.enter_context(teaching(caesura, "cell-1"))
        reaches(caesura, "cell-1", SAMPLES // 2)
        service.kill()
        damage(tmp_path / "caesura-1.sqlite-wal")
        service.start()
        assert end.result(DEADLINE_S).state == "closed"
        assert_equal(reaches(caesura, "cell-1", SAMPLES), undisturbed)
