"""What is put is handed over in order, before a command that came after it, and whatever becomes of one."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from queue import SimpleQueue

import pytest
import zenoh

from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.server.network import NetworkSettings, join
from caesura_service.server.subscriber_poller import CHANNEL, SubscriberPoller
from harness.peer import DEADLINE_S, Peer
from harness.processes import eventually

KEY, COMMANDS, BAD = "some/key", "some/commands", b"bad"


class Floor:
    """A network with somebody to put, and what was handed over."""

    def __init__(self, network: zenoh.Session, peer: Peer) -> None:
        self.network, self.peer = network, peer
        self.taken: list[bytes] = []
        self.gathering = SubscriberPoller(self._take)
        self.gathering.declare(network, KEY)

    def put(self, *payloads: bytes) -> None:
        for payload in payloads:
            self.peer.put(KEY, payload, "zenoh/bytes")

    def _take(self, sample: zenoh.Sample) -> None:
        if (payload := sample.payload.to_bytes()) == BAD:
            raise RuntimeError(payload)
        self.taken.append(payload)


@pytest.fixture
def floor() -> Iterator[Floor]:
    network, endpoint = join(NetworkSettings("tcp/127.0.0.1:0"), threading.Event())
    with network, Peer(endpoint) as peer:
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

    def command(query: zenoh.Query) -> None:
        floor.gathering.drain()
        with query:
            found.put(len(floor.taken))

    commands = floor.network.declare_queryable(COMMANDS, direct(command))
    for count in range(1, 101):
        floor.put(b"sample")
        list(floor.peer.network.get(COMMANDS, timeout=DEADLINE_S))
        assert found.get(timeout=DEADLINE_S) == count  # nobody looks beside: the thread does not run
    commands.undeclare()


def test_what_was_put_before_the_end_is_handed_over(floor):
    floor.put(*numbers(5))
    # An answer from behind the messages: they have arrived.
    commands = floor.network.declare_queryable(COMMANDS, direct(lambda query: query.drop()))
    list(floor.peer.network.get(COMMANDS, timeout=DEADLINE_S))
    commands.undeclare()
    floor.gathering.undeclare(KEY)
    assert floor.taken == numbers(5)
    floor.put(b"later")
    floor.gathering.drain()
    assert floor.taken == numbers(5)
