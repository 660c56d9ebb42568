"""Results are put in order, once, and without waiting for a router that accepts no declaration."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from caesura_protocol.codec import Encoded, decode
from caesura_protocol.keys import session_key, station_key
from caesura_protocol.messages import Heartbeat, SessionStatus
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_protocol.transport.transport_interface import Priority
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server import key_publishers
from caesura_service.server.key_publishers import KeyPublishers
from caesura_service.server.memory_network import MemoryPublisher, MemorySession
from caesura_service.server.station_send_threads import StationSendThreads
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import MemoryPeer, Received
from harness.processes import eventually
from harness.sessions import batches, opening

MESSAGES = 100


class HeldRouter(MemorySession):
    """Declares a publisher of a session once it is released; puts on a station's keys wait too."""

    def __init__(self, network: MemoryNetwork, held_station: str = "") -> None:
        self.released, self._held = threading.Event(), held_station
        super().__init__(network)

    def declare_publisher(self, key: str, priority: Priority) -> MemoryPublisher:
        if "/service/" not in key:
            self.released.wait()
        return super().declare_publisher(key, priority)

    def put(self, key: str, content: Encoded, priority: Priority) -> None:
        if self._held and f"/{self._held}/" in key:
            self.released.wait()
        super().put(key, content, priority)


@pytest.fixture
def held(network: MemoryNetwork) -> Iterator[HeldRouter]:
    router = HeldRouter(network, "hostile")
    yield router
    router.released.set()


@pytest.fixture
def service(config: ServiceConfig, held: HeldRouter) -> Iterator[Service]:
    with Service(config, pipeline_factory=make_fake_pipeline, join=lambda *_: (held, "memory")) as running:
        yield running
        held.released.set()


def test_sessions_begin_and_are_followed_while_the_router_accepts_no_declaration(service, peer, held):
    """The worker declared publishers: no station's messages were processed until the router accepted them."""
    received = {station: Received() for station in ("cell-1", "cell-2")}
    with (
        peer.subscribed(session_key("cell-1", "*", "status"), received["cell-1"].queue.put),
        peer.subscribed(session_key("cell-2", "*", "status"), received["cell-2"].queue.put),
    ):
        peer.command(opening(), "hostile")  # whose results the router holds as well
        for station, results in received.items():
            peer.command(opening(), station)
            for batch in batches(20):
                peer.send(batch, station)
            peer.until_closed(19, station)
            results.until(SessionStatus, lambda status: status.state == "closed")
            numbers = [status.seq for status in results.all]
            assert numbers == list(range(len(numbers))), "each once, in order"
        assert not held.released.is_set()


class SlowNetwork:
    """Keeps what is put; a put without a publisher takes a moment, and so does a declaration."""

    def __init__(self) -> None:
        self.put_by_key: dict[str, list[int]] = {}
        self.ways: set[str] = set()
        self.declared: list[str] = []
        self.undeclared: list[str] = []

    def declare_publisher(self, key: str, priority: Priority) -> SlowPublisher:
        del priority
        threading.Event().wait(0.002)
        self.declared.append(key)
        return SlowPublisher(self, key)

    def put(self, key: str, content: Encoded, priority: Priority) -> None:
        del priority
        threading.Event().wait(0.001)
        self.keep(key, content, "without a publisher")

    def keep(self, key: str, content: Encoded, way: str) -> None:
        self.ways.add(way)
        self.put_by_key.setdefault(key, []).append(decode(*content, Heartbeat).seq)


class SlowPublisher:
    """Of one key."""

    def __init__(self, network: SlowNetwork, key: str) -> None:
        self._network, self._key = network, key

    def put(self, content: Encoded) -> None:
        self._network.keep(self._key, content, "by a publisher")

    def undeclare(self) -> None:
        self._network.undeclared.append(self._key)


def beat(seq: int) -> Heartbeat:
    return Heartbeat(session="s1", epoch=0, seq=seq)


@pytest.mark.parametrize("publishers", [2, 64])
def test_messages_keep_their_order_while_publishers_are_declared_and_let_go(monkeypatch, publishers):
    monkeypatch.setattr(key_publishers, "PUBLISHERS", publishers)
    network, keys = SlowNetwork(), [session_key("cell-1", f"s{number}", "status") for number in range(3)]
    pause = threading.Event()
    with StationSendThreads() as lanes:
        results = KeyPublishers(network, lanes)  # type: ignore[arg-type]
        for seq in range(MESSAGES):
            for key in keys:
                results.put(key, key, "data_high", beat(seq))
            pause.wait(0.002)
    assert network.put_by_key == {key: list(range(MESSAGES)) for key in keys}
    if publishers == 64:
        assert network.ways == {"without a publisher", "by a publisher"}
        assert sorted(network.declared) == keys
    else:
        assert len(network.declared) - len(network.undeclared) <= publishers + 1


def test_more_keys_than_may_be_declared_are_published_while_the_router_accepts_no_declaration(monkeypatch):
    monkeypatch.setattr(key_publishers, "PUBLISHERS", 4)
    network = MemoryNetwork()
    held, came = HeldRouter(network), []
    with (
        MemoryPeer(network) as peer,
        peer.subscribed(station_key("*", "program"), lambda sample: came.append(sample.key)),
    ):
        try:
            with StationSendThreads() as lanes:
                results = KeyPublishers(held, lanes)
                keys = [station_key(f"cell-{number}", "program") for number in range(300)]
                for key in keys:
                    results.put(key, key, "data_high", beat(0))
                eventually(lambda: len(came) == len(keys))
                held.released.set()
        finally:
            held.released.set()
    assert sorted(came) == sorted(keys)
