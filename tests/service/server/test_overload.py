"""A worker that is held and a flood: who is told what before anything is dropped, and what is lost of it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key
from caesura_protocol.messages import Ack, Open, ServiceStatus, SessionStatus
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView
from caesura_service.server.memory_network import in_memory
from caesura_service.server.work_queue import QueueSettings
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import MemoryPeer
from harness.processes import eventually
from harness.sessions import batches, closing, opening

QUEUE = QueueSettings(capacity=128, shares=4)  # 32 of a station, pressed at 20
SENT = batches(90)


class GatedPipeline:
    """The fake pipeline, which sets `held` and waits for `gate` before every push."""

    def __init__(self, pipeline: Pipeline, gate: threading.Event, held: threading.Event) -> None:
        self._pipeline = pipeline
        self._gate, self._held = gate, held

    @property
    def due_s(self) -> float:
        return self._pipeline.due_s

    def push(self, samples: NDArray[np.float64]) -> bool:
        self._held.set()
        assert self._gate.wait(30.0)
        return self._pipeline.push(samples)

    has_due_program = False

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        return self.push(samples)

    def make_due_program(self) -> None:
        """None is left."""

    @property
    def view(self) -> PipelineView:
        return self._pipeline.view

    def declare_gap(self) -> None:
        self._pipeline.declare_gap()

    def finish(self) -> None:
        self._pipeline.finish()


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def held() -> threading.Event:
    """Set once the worker holds a batch."""
    return threading.Event()


@pytest.fixture
def service(
    config: ServiceConfig, network: MemoryNetwork, gate: threading.Event, held: threading.Event
) -> Iterator[Service]:
    def waiting(command: Open, preset: str) -> Pipeline:
        return GatedPipeline(make_fake_pipeline(command, preset), gate, held)

    limits = Limits(replay_batches=8)
    config = replace(config, queue=QUEUE, limits=limits)
    with Service(config, pipeline_factory=waiting, join=in_memory(network)) as running:
        yield running
        gate.set()


def send(peer: MemoryPeer, sent: list[Any], total: int, station: str = "cell-1") -> ServiceStatus:
    """Send, and wait until everything has arrived, `total` messages in all."""
    for made in sent:
        peer.send(made, station)
    return peer.until_service(lambda status: status.queue + status.messages + status.dropped >= total)


def flood(peer: MemoryPeer, station: str = "cell-1", *, others: int = 0) -> int:
    """Send all of SENT, the most of it once the overload is announced; returns how much was dropped."""
    with peer.listening(service_key("test-1", "status")) as received:
        send(peer, SENT[:25], others + 26, station)  # after the opening
        begins = received.until(ServiceStatus)
        assert (begins.overloaded, begins.dropped) == (True, 0)
        dropped = send(peer, SENT[25:], others + 91, station).dropped
        assert 0 < dropped <= 90 - 32  # the station's share, and perhaps one in work
        assert received.until(ServiceStatus, lambda status: status.dropped > 0).overloaded
    return dropped


def test_overload_is_reported_before_anything_is_dropped_and_everything_is_recovered(
    peer, network, gate, caplog
):
    caplog.set_level(logging.WARNING, "caesura_service.server.overload_monitor")
    with peer.replaying(SENT), peer.listening() as sessions, MemoryPeer(network) as operator:
        peer.command(opening())
        dropped = flood(peer)
        assert operator.snapshot().status.overloaded
        with operator.listening(service_key("test-1", "status")) as received:
            gate.set()
            assert peer.until_closed(89).next_seq == 90
            assert received.until(ServiceStatus, lambda status: not status.overloaded).dropped == dropped
        assert sessions.until(SessionStatus, lambda status: status.overloaded).state == "open"
        ended = sessions.until(SessionStatus, lambda status: status.batches == 90 and not status.overloaded)
        assert (ended.dropped, ended.lost, ended.gaps) == (dropped, 0, ())
    eventually(lambda: len(caplog.records) >= 2)  # logged after the status is published
    words = [record.message.partition(":")[0].partition(";")[0] for record in caplog.records]
    assert words == ["overloaded by station cell-1", "no longer overloaded"]


def test_while_it_lasts_new_sessions_are_refused_at_once_and_with_the_reason(service, peer, gate):
    peer.command(opening())
    flood(peer)
    with pytest.raises(
        ProtocolError, match="accepts no new session until that is over: try again"
    ) as refused:
        peer.command(opening("s2"))
    assert (refused.value.code, refused.value.limit) == ("overloaded", QUEUE.overloaded_at)
    assert refused.value.value >= 1.0
    assert peer.service_status().refused == {"overloaded": 1}
    gate.set()
    peer.until_service(lambda status: not status.overloaded)
    assert peer.command(opening("s2")) == Ack(session="s2", next_seq=0, state="open")


def test_a_station_that_floods_takes_nothing_from_another(service, peer, gate):
    with peer.replaying(SENT, station="cell-9"):
        peer.command(opening(), "cell-1")
        peer.command(opening(), "cell-9")
        dropped = flood(peer, "cell-9", others=1)
        assert send(peer, SENT[:15], 107).dropped == dropped
        assert not peer.snapshot(station="cell-1").status.overloaded
        gate.set()
        peer.until_closed(89, "cell-9")
    peer.until_closed(14)
    quiet, loud = (peer.snapshot(station=station).status for station in ("cell-1", "cell-9"))
    assert (quiet.batches, quiet.dropped, quiet.duplicates) == (15, 0, 0)
    assert (loud.batches, loud.dropped, loud.gaps) == (90, dropped, ())


def test_under_pressure_commands_of_known_sessions_go_their_way(service, peer, gate):
    peer.command(opening())
    send(peer, SENT[:25], 26)
    answered: list[Ack] = []
    asking = threading.Thread(target=lambda: answered.append(peer.command(opening())), daemon=True)
    asking.start()
    peer.until_service(lambda status: status.queue + status.messages >= 27)
    gate.set()
    asking.join(30.0)
    assert answered == [Ack(session="s1", next_seq=25, state="open")]
    assert peer.command(closing(24)).state == "closed"


def test_rubbish_under_pressure_is_refused_as_ever(service, peer, gate):
    peer.command(opening())
    send(peer, SENT[:25], 26)
    answered: list[str] = []

    def ask() -> None:
        with pytest.raises(ProtocolError) as refused:
            peer.control(b"\xc1", "application/msgpack;caesura.Control.v1")
        answered.append(refused.value.code)

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    peer.until_service(lambda status: status.queue + status.messages >= 27)
    gate.set()
    asking.join(30.0)
    assert answered == ["malformed"]


def test_what_was_dropped_and_is_lost_for_good_is_a_gap(service, peer, gate):
    peer.command(opening())
    with peer.replaying(SENT, oldest=90):
        dropped = flood(peer)
        gate.set()
        peer.until_closed(89)
    status = peer.snapshot().status
    assert (status.batches, status.lost, status.dropped) == (90 - dropped, dropped, dropped)
    assert [gap.reason for gap in status.gaps] == ["evicted"]


def test_a_key_that_names_no_station_overloads_and_hurts_no_other(service, peer, gate, held, caplog):
    caplog.set_level(logging.WARNING, "caesura_service.server.overload_monitor")
    peer.command(opening())
    peer.send(SENT[0])
    assert held.wait(30.0), "else the worker may take what names no station first"
    for _ in range(60):
        peer.put("caesura/v1/station/No Such Name!/samples", b"\xc1", "text/plain")
    # All 62 have come but the one that the worker holds, which is neither waiting nor done.
    peer.until_service(
        lambda status: status.overloaded and status.queue + status.messages + status.dropped >= 61
    )
    eventually(lambda: "overloaded by station ?" in caplog.text)
    gate.set()
    peer.until_service(lambda status: not status.overloaded and status.queue == 0)
    for made in SENT[1:15]:
        peer.send(made)
    assert peer.until_closed(14).next_seq == 15
