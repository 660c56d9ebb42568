"""The network of the server within one process: a session of a MemoryNetwork, like those of its clients.

`Service(config, join=in_memory(network))` is reached by the transports of that network.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from queue import Empty, Queue
from typing import Generic, TypeVar

from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.transport.inbox import IncomingQuery, TokenChange
from caesura_protocol.transport.memory import CallbackInbox, MemoryNetwork, MemoryTransport
from caesura_protocol.transport.transport_interface import Priority
from caesura_service.server.network_interface import TOKENS, Channel, Incoming
from caesura_service.server.network_join import NetworkSettings

Received = TypeVar("Received")


def in_memory(
    network: MemoryNetwork,
) -> Callable[[NetworkSettings, threading.Event], tuple[MemorySession, str]]:
    """Return a function that joins this network, to replace `network_join.join`."""
    return lambda settings, stop: (MemorySession(network), "memory")


class MemorySession:
    """The server's session with a MemoryNetwork. Callbacks run in the thread that puts or queries."""

    def __init__(self, network: MemoryNetwork) -> None:
        self._transport = network.transport()

    def close(self) -> None:
        """Leave the network; all declarations must have ended before."""
        self._transport.close()

    def declare_publisher(self, key: str, priority: Priority) -> MemoryPublisher:
        """Return a publisher; nothing is declared in memory."""
        del priority  # one process, one order
        return MemoryPublisher(self._transport, key)

    def put(self, key: str, content: Encoded, priority: Priority) -> None:
        """Deliver a message to every subscriber of the key."""
        self._transport.put(key, content, priority=priority)

    def declare_subscriber(self, key: str, capacity: int) -> Channel[Incoming]:
        """Subscribe to a key expression; a sender blocks while `capacity` messages are queued."""
        channel: Queue[Incoming] = Queue(capacity)
        inbox = CallbackInbox(lambda sample: channel.put(Incoming(*sample)))
        return MemoryChannel(channel, self._transport.subscribe(key, inbox))

    def declare_queryable(self, key: str, capacity: int) -> Channel[IncomingQuery]:
        """Receive the queries on a key expression; a client blocks while `capacity` queries are queued."""
        channel: Queue[IncomingQuery] = Queue(capacity)
        return MemoryChannel(channel, self._transport.declare_queryable(key, CallbackInbox(channel.put)))

    def request(
        self,
        key: str,
        parameters: str,
        *,
        received: Callable[[Incoming], None],
        refused: Callable[[Encoded], None],
        ended: Callable[[], None],
    ) -> None:
        """Query the key, in a separate thread."""

        def wait() -> None:
            try:
                replies, refusals = self._transport.query(key, parameters=parameters)
                for reply in replies:
                    received(Incoming(*reply))
                for error in refusals:
                    refused(encode_error(error))
            finally:
                ended()

        threading.Thread(target=wait, name="memory-request", daemon=True).start()

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of live tokens."""
        return self._transport.list_tokens(key)

    def declare_token(self, key: str) -> Declared:
        """Declare a liveliness token."""
        return Declared(self._transport.declare_token(key))

    def watch_liveliness(self, key: str) -> Channel[TokenChange]:
        """Receive every token that exists, appears or disappears; a sender blocks while TOKENS are queued."""
        channel: Queue[TokenChange] = Queue(TOKENS)
        return MemoryChannel(channel, self._transport.watch_liveliness(key, CallbackInbox(channel.put)))

    def watch_link(self, report: Callable[[bool], None]) -> Declared:
        """Report nothing, because there is no router."""
        return Declared(nullcontext())


class Declared:
    """A declaration that lasts until it is undeclared."""

    def __init__(self, declaration: AbstractContextManager[None]) -> None:
        self._stack = ExitStack()
        self._stack.enter_context(declaration)

    def undeclare(self) -> None:
        """End the declaration."""
        self._stack.close()


class MemoryPublisher:
    """A publisher of one key."""

    def __init__(self, transport: MemoryTransport, key: str) -> None:
        self._transport, self._key = transport, key

    def put(self, content: Encoded) -> None:
        """Deliver a message to every subscriber of the key."""
        self._transport.put(self._key, content)

    def undeclare(self) -> None:
        """Return at once, because nothing was declared."""


class MemoryChannel(Declared, Generic[Received]):
    """The channel of a subscriber or a queryable."""

    def __init__(self, channel: Queue[Received], declaration: AbstractContextManager[None]) -> None:
        self._channel = channel
        super().__init__(declaration)

    def try_recv(self) -> Received | None:
        """Return the oldest message; None if there is none."""
        try:
            return self._channel.get_nowait()
        except Empty:
            return None
