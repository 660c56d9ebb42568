"""A station whose work takes long, and its neighbours: they do not wait for it, and it keeps its order."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Edit, Insert, Message, Open
from caesura_protocol.token_bucket import Rate
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.cooperative_scheduler import give_way
from caesura_service.publishing.events import PipelineFactory
from caesura_service.segmentation.pipeline_interface import Pipeline
from caesura_service.server import outbound, station_manager
from caesura_service.server.memory_network import in_memory
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.station_send_threads import WAITING, StationSendThreads
from harness.fake_pipeline import FakePipeline, make_fake_pipeline
from harness.peer import DEADLINE_S, MemoryPeer
from harness.processes import eventually
from harness.sessions import batches, closing, opening


class SlowPipeline(FakePipeline):
    """A push lasts until the gate opens."""

    gate: threading.Event
    begun: threading.Event

    def push(self, samples: NDArray[np.float64]) -> bool:
        self.begun.set()
        while not self.gate.wait(0.001):
            give_way()
        return super().push(samples)


def slow(gate: threading.Event, begun: threading.Event) -> PipelineFactory:
    """The fake pipeline, slow for sessions of that name."""

    def made(command: Open, preset: str) -> Pipeline:
        fake = make_fake_pipeline(command, preset)
        if command.session == "slow":
            vars(fake).update(gate=gate, begun=begun)
            fake.__class__ = SlowPipeline
        return fake

    return made


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def begun() -> threading.Event:
    return threading.Event()


@pytest.fixture
def service(
    config: ServiceConfig, network: MemoryNetwork, gate: threading.Event, begun: threading.Event
) -> Iterator[Service]:
    with Service(config, pipeline_factory=slow(gate, begun), join=in_memory(network)) as running:
        yield running
        gate.set()


def test_while_one_stations_batch_takes_long_another_is_taught_from_its_opening_to_its_end(
    service, peer, gate, begun
):
    peer.command(opening("slow"), "cell-1")
    for batch in batches(3, "slow"):
        peer.send(batch, "cell-1")
    assert begun.wait(DEADLINE_S)
    peer.command(opening(), "cell-2")
    for batch in batches(20):
        peer.send(batch, "cell-2")
    assert peer.until_closed(19, "cell-2").next_seq == 20
    assert peer.snapshot("slow", "cell-1").status.batches == 0, "nothing of a batch is shown before its end"
    gate.set()
    ack = peer.command(closing(2, "slow"), "cell-1")  # which waits behind its batches
    assert (ack.state, ack.next_seq) == ("closed", 3)
    status = peer.snapshot("slow", "cell-1").status
    assert (status.batches, status.repeats, status.gaps, status.lost) == (3, 0, (), 0)


def test_while_a_long_session_is_rebuilt_for_a_correction_another_stations_is_corrected(
    config, network, gate, begun, tmp_path
):
    """It waited for every session that the first station had asked for, an hour of each."""
    sessions = {"cell-1": "slow", "cell-2": "s1"}
    kept = replace(config, journal=tmp_path)
    with (
        Service(kept, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        for station, name in sessions.items():
            peer.command(opening(name), station)
            for batch in batches(3, name):
                peer.send(batch, station)
            assert peer.command(closing(2, name), station).state == "closed"
    with (
        Service(kept, pipeline_factory=slow(gate, begun), join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        corrections = {
            station: Edit(session=name, revision=0, author="Ann", action=Insert(t=0.03))
            for station, name in sessions.items()
        }
        for station in sessions:
            with pytest.raises(ProtocolError, match="is being rebuilt"):
                peer.command(corrections[station], station)
        assert begun.wait(DEADLINE_S)
        eventually(lambda: is_made(peer, corrections["cell-2"], "cell-2"))
        assert not is_made(peer, corrections["cell-1"], "cell-1")
        gate.set()
        eventually(lambda: is_made(peer, corrections["cell-1"], "cell-1"))


class Long(FakePipeline):
    """A push takes a moment until the gate opens."""

    gate: threading.Event

    def push(self, samples: NDArray[np.float64]) -> bool:
        self.gate.wait(0.02)
        return super().push(samples)


def test_a_start_does_not_wait_for_the_hours_that_one_station_has_open(
    config, network, gate, tmp_path, monkeypatch
):
    """All stations waited, beyond what their bridges keep: one that sends all day made a restart lossy."""

    def long(command: Open, preset: str) -> Pipeline:
        fake = make_fake_pipeline(command, preset)
        if command.session == "long":
            vars(fake).update(gate=gate)
            fake.__class__ = Long
        return fake

    monkeypatch.setattr(station_manager, "START_S", 0.1)
    kept, sessions = replace(config, journal=tmp_path), {"cell-1": ("long", 300), "cell-2": ("s1", 3)}
    with (
        Service(kept, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        for station, (name, count) in sessions.items():
            peer.command(opening(name), station)
            for batch in batches(count, name):
                peer.send(batch, station)
            assert peer.command(opening(name), station).next_seq == count
        before = peer.snapshot("long", "cell-1")
    with Service(kept, pipeline_factory=long, join=in_memory(network)), MemoryPeer(network) as peer:
        assert peer.command(opening(), "cell-2").next_seq == 3
        for refused in (
            partial(peer.command, opening("long"), "cell-1"),
            partial(peer.snapshot, "long", "cell-1"),
        ):
            with pytest.raises(ProtocolError, match=r"taken over: try again|taking cell-1 over: ask again"):
                refused()
        gate.set()
        eventually(lambda: continues(peer, "long", "cell-1"))
        after = peer.snapshot("long", "cell-1")
        assert (after.segments.segments, after.status.samples) == (
            before.segments.segments,
            before.status.samples,
        )


def test_while_a_long_batch_of_a_takeover_is_replayed_another_station_is_taught(
    config, network, gate, begun, tmp_path, monkeypatch
):
    monkeypatch.setattr(station_manager, "START_S", 0.0)
    kept = replace(config, journal=tmp_path)
    with (
        Service(kept, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        peer.command(opening("slow"), "cell-1")
        peer.send(batches(1, "slow")[0], "cell-1")
        assert peer.command(opening("slow"), "cell-1").next_seq == 1
    with (
        Service(kept, pipeline_factory=slow(gate, begun), join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        assert begun.wait(DEADLINE_S)
        peer.command(opening(), "cell-2")
        for batch in batches(3):
            peer.send(batch, "cell-2")
        assert peer.until_closed(2, "cell-2").next_seq == 3
        assert not continues(peer, "slow", "cell-1")
        gate.set()
        eventually(lambda: continues(peer, "slow", "cell-1"))


def continues(peer: MemoryPeer, session: str, station: str) -> bool:
    try:
        return peer.command(opening(session), station).next_seq > 0
    except ProtocolError:
        return False


def is_made(peer: MemoryPeer, edit: Edit, station: str) -> bool:
    try:
        return peer.command(edit, station).revision == 1
    except ProtocolError:
        return False


class Owing(FakePipeline):
    """Leaves a program after every batch, and writes down what it does when; `first` waits for the gate."""

    due_s = 0.0
    gate: threading.Event
    begun: threading.Event
    done: list[tuple[str, str]]
    session: str

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        self.done.append((self.session, "segments"))
        if self.session == "first":
            self.begun.set()
            self.gate.wait(DEADLINE_S)
        self.has_due_program = True
        return super().push(samples)

    def make_due_program(self) -> None:
        if self.has_due_program:
            self.done.append((self.session, "program"))
        self.has_due_program = False


def test_no_station_waits_for_the_program_of_another(config, network, gate, begun):
    done: list[tuple[str, str]] = []

    def owing(command: Open, preset: str) -> Pipeline:
        fake = make_fake_pipeline(command, preset)
        fake.__class__ = Owing
        vars(fake).update(gate=gate, begun=begun, done=done, session=command.session)
        return fake

    service = Service(config, pipeline_factory=owing, join=in_memory(network))
    names = ("first", "second", "third")
    with service, MemoryPeer(network) as peer:
        for name in names:
            peer.command(opening(name), name)
            peer.send(batches(1, name)[0], name)  # from the second one on they come as blocks
        for name in names:
            peer.send(batches(2, name)[1], name)
            assert begun.wait(DEADLINE_S), "the first one holds the worker"
        eventually(lambda: len(service._edge._queue) == 2)
        gate.set()
        for name in names:
            assert peer.command(closing(1, name), name).next_seq == 2
    assert done[:3] == [(name, "segments") for name in names]
    assert sorted(done[3:]) == [(name, "program") for name in sorted(names)]


WORK = Rate(0.001, 0.0001)


def open_again_and_again(peer: MemoryPeer) -> None:
    for _ in range(100):  # what it took is known after the answer
        peer.command(opening())


def test_a_station_that_has_used_up_its_work_is_refused_with_the_reason_and_another_goes_on(config, network):
    rates = RateLimits(work=WORK)
    with (
        Service(
            replace(config, rates=rates), pipeline_factory=make_fake_pipeline, join=in_memory(network)
        ) as service,
        MemoryPeer(network) as peer,
    ):
        peer.command(opening())
        with pytest.raises(ProtocolError, match=r"of work: .* of 0.0001 s .* 0.001 come back") as no:
            open_again_and_again(peer)
        assert (no.value.code, no.value.limit) == ("overloaded", WORK.burst)
        assert no.value.value > WORK.burst, "what it has used"
        peer.command(opening("s2"), "cell-2")
        peer.send(batches(1)[0])
        status = peer.until_service(
            lambda status: status.dropped > 0 and "cell-1" in str(status.last_refusal)
        )
        assert status.refused["overloaded"] >= 2, "the command, and that batches are dropped for that reason"
        assert "used up its budget of work" in peer.snapshot().status.last_refusal.message
        assert service.registry.station_counters.of_station["cell-1"].work_s > 0.0
        assert not peer.snapshot("s2", "cell-2").status.refused


def test_a_service_that_stops_in_the_middle_of_a_batch_stops_at_once(config, network, gate, begun):
    service = Service(config, pipeline_factory=slow(gate, begun), join=in_memory(network))
    with service, MemoryPeer(network) as peer:
        peer.command(opening("slow"))
        peer.send(batches(1, "slow")[0])
        assert begun.wait(DEADLINE_S)
    assert not [one for one in threading.enumerate() if one.name == "caesura-worker"]


def test_an_answer_that_its_client_does_not_read_holds_up_no_other_station(
    config, network, gate, begun, monkeypatch
):
    """The worker waited in it until Zenoh closed the link, five seconds later."""
    sent = outbound.reply_message

    def blocked(query: IncomingQuery, key: str, message: Message) -> None:
        if "slow" in key:
            begun.set()
            gate.wait(DEADLINE_S)
        sent(query, key, message)

    monkeypatch.setattr(outbound, "reply_message", blocked)
    service = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    with service, MemoryPeer(network) as peer:
        late = threading.Thread(target=peer.command, args=(opening("s1"), "slow"), daemon=True)
        late.start()
        assert begun.wait(DEADLINE_S)
        assert peer.command(opening(), "cell-2").state == "open"
        assert not gate.is_set()
        gate.set()
        late.join(DEADLINE_S)
        assert not late.is_alive(), "and it has its answer in the end"
    gate.set()


def test_of_one_lane_one_job_is_done_after_the_other_and_so_many_wait(gate, begun):
    done: list[int] = []

    def wait() -> None:
        begun.set()
        gate.wait(DEADLINE_S)

    with StationSendThreads() as lanes:
        assert lanes.submit("slow", wait)
        assert begun.wait(DEADLINE_S)
        assert [lanes.submit("slow", partial(done.append, n)) for n in range(WAITING)].count(
            True
        ) == WAITING - 1
        other = threading.Event()
        assert lanes.submit("other", other.set)
        assert other.wait(DEADLINE_S)
        assert done == []
        gate.set()
    assert done == [*range(WAITING - 1)]
