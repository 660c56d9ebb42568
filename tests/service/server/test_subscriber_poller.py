"""What is put is handed over in order, before a command that came after it, and whatever becomes of one."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from queue import SimpleQueue

import pytest

from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.server.memory_network import MemorySession
from caesura_service.server.network import NetworkSettings, join
from caesura_service.server.subscriber_poller import CHANNEL, SubscriberPoller
from caesura_service.server.transport import Incoming, Network
from harness.peer import DEADLINE_S, Client, MemoryPeer, Peer
from harness.processes import eventually

KEY, COMMANDS, BAD = "some/key", "some/commands", b"bad"


class Floor:
    """A network with somebody to put, and what was handed over."""

    def __init__(self, network: Network, peer: Client) -> None:
        self.network, self.peer = network, peer
        self.taken: list[bytes] = []
        self.gathering = SubscriberPoller(self._take)
        self.gathering.declare(network, KEY)

    def put(self, *payloads: bytes) -> None:
        for payload in payloads:
            self.peer.put(KEY, payload, "zenoh/bytes")

    def _take(self, sample: Incoming) -> None:
        if (payload := bytes(sample.payload)) == BAD:
            raise RuntimeError(payload)
        self.taken.append(payload)


@pytest.fixture(params=["zenoh", "memory"])
def floor(request: pytest.FixtureRequest) -> Iterator[Floor]:
    """Both networks of the server: one contract."""
    if request.param == "memory":
        memory = MemoryNetwork()
        yield Floor(MemorySession(memory), MemoryPeer(memory))
        return
    network, endpoint = join(NetworkSettings("tcp/127.0.0.1:0"), threading.Event())
    with closing(network), Peer(endpoint) as peer:
        yield Floor(network, peer)


def numbers(count: int) -> list[bytes]:
    return [b"%d" % number for number in range(count)]


def test_what_is_put_is_handed_over_in_order(floor):
    with floor.gathering:
        floor.put(*numbers(3 * CHANNEL))
        eventually(lambda: len(floor.taken) == 3 * CHANNEL)
    assert floor.taken == numbers(3 * CHANNEL)


def test_one_that_breaks_takes_nothing_else_along(floor):
    with floor.gathering:
        floor.put(b"before", BAD, b"after")
        eventually(lambda: floor.taken == [b"before", b"after"])


def test_a_command_finds_all_that_was_put_before_it(floor):
    found: SimpleQueue[int] = SimpleQueue()

    def command(query: IncomingQuery) -> None:
        floor.gathering.drain()
        with query:
            found.put(len(floor.taken))

    commands = floor.network.declare_queryable(COMMANDS, command)
    for count in range(1, 101):
        floor.put(b"sample")
        floor.peer.get(COMMANDS)
        assert found.get(timeout=DEADLINE_S) == count  # nobody looks beside: the thread does not run
    commands.undeclare()


def test_what_was_put_before_the_end_is_handed_over(floor):
    floor.put(*numbers(5))
    # An answer from behind the messages: they have arrived.
    commands = floor.network.declare_queryable(COMMANDS, lambda query: query.drop())
    floor.peer.get(COMMANDS)
    commands.undeclare()
    floor.gathering.undeclare(KEY)
    assert floor.taken == numbers(5)
    floor.put(b"later")
    floor.gathering.drain()
    assert floor.taken == numbers(5)
