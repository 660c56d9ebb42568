"""What is put is handed over in order, before a command that came after it, and whatever becomes of one."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing

import pytest

from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.server.channel_poller import CHANNEL, ChannelPoller
from caesura_service.server.memory_network import MemorySession
from caesura_service.server.network_interface import Incoming, Network
from caesura_service.server.network_join import NetworkSettings, join
from harness.peer import Client, MemoryPeer, Peer
from harness.processes import eventually

KEY, COMMANDS, BAD = "some/key", "some/commands", b"bad"


class PolledNetwork:
    """A network with somebody to put, and what was handed over."""

    def __init__(self, network: Network, peer: Client) -> None:
        self.network, self.peer = network, peer
        self.taken: list[bytes] = []
        self.poller = ChannelPoller(self._take)
        self.poller.subscribe(network, KEY)

    def put(self, *payloads: bytes) -> None:
        for payload in payloads:
            self.peer.put(KEY, payload, "zenoh/bytes")

    def _take(self, sample: Incoming) -> None:
        if (payload := bytes(sample.payload)) == BAD:
            raise RuntimeError(payload)
        self.taken.append(payload)


@pytest.fixture(params=["zenoh", "memory"])
def floor(request: pytest.FixtureRequest) -> Iterator[PolledNetwork]:
    """Both networks of the server: one contract."""
    if request.param == "memory":
        memory = MemoryNetwork()
        yield PolledNetwork(MemorySession(memory), MemoryPeer(memory))
        return
    network, endpoint = join(NetworkSettings("tcp/127.0.0.1:0"), threading.Event())
    with closing(network), Peer(endpoint) as peer:
        yield PolledNetwork(network, peer)


def numbers(count: int) -> list[bytes]:
    return [b"%d" % number for number in range(count)]


def test_what_is_put_is_handed_over_in_order(floor):
    with floor.poller:
        floor.put(*numbers(3 * CHANNEL))
        eventually(lambda: len(floor.taken) == 3 * CHANNEL)
    assert floor.taken == numbers(3 * CHANNEL)


def test_one_that_breaks_takes_nothing_else_along(floor):
    with floor.poller:
        floor.put(b"before", BAD, b"after")
        eventually(lambda: floor.taken == [b"before", b"after"])


def test_a_command_finds_all_that_was_put_before_it(floor):
    found: list[int] = []

    def command(query: IncomingQuery) -> None:
        with query:
            found.append(len(floor.taken))

    commands = floor.poller.declare_queryable(floor.network, COMMANDS, command)
    with floor.poller:
        for count in range(1, 101):
            floor.put(b"sample")
            floor.peer.get(COMMANDS)
            assert found[-1] == count
    commands.undeclare()


def test_a_query_that_breaks_takes_no_other_along(floor):
    def command(query: IncomingQuery) -> None:
        with query:
            if query.content is None:
                raise RuntimeError
            query.reply(COMMANDS, query.content)

    commands = floor.poller.declare_queryable(floor.network, COMMANDS, command)
    with floor.poller:
        assert not floor.peer.get(COMMANDS).replies
        assert [one.payload for one in floor.peer.get(COMMANDS, b"fine", "zenoh/bytes").replies] == [b"fine"]
    commands.undeclare()


def test_what_was_put_before_the_end_is_handed_over(floor):
    floor.put(*numbers(5))
    # An answer from behind the messages: they have arrived.
    commands = floor.poller.declare_queryable(floor.network, COMMANDS, lambda query: query.drop())
    with floor.poller:
        floor.peer.get(COMMANDS)
    commands.undeclare()
    floor.poller.unsubscribe(KEY)
    assert floor.taken == numbers(5)
    floor.put(b"later")
    floor.poller.poll()
    assert floor.taken == numbers(5)
