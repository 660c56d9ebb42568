"""The interface of the network for the server: `zenoh_network` implements it over Zenoh, `memory_network` in
memory.

Callbacks run in the network's threads, and only enqueue.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import NamedTuple, Protocol, TypeVar

from caesura_protocol.codec import Encoded
from caesura_protocol.transport.inbox import IncomingQuery, TokenChange
from caesura_protocol.transport.transport_interface import Priority

TOKENS = 1 << 16  # changes of tokens that wait; a router fills the channel before it can be polled


class NetworkError(Exception):
    """The network could not be joined, or the session was closed."""


class Payload(Protocol):
    """A received payload, which is copied only by `bytes`."""

    def __len__(self) -> int: ...

    def __bytes__(self) -> bytes: ...


class Incoming(NamedTuple):
    """A message on a subscribed key, or in a reply to a query."""

    key: str
    payload: Payload
    encoding: str


class Declaration(Protocol):
    """A declaration that lasts until it is undeclared."""

    def undeclare(self) -> object:
        """End the declaration."""


class Publisher(Declaration, Protocol):
    """A publisher of one key."""

    def put(self, content: Encoded) -> None:
        """Put a message; never waits. Raises NetworkError."""


Received = TypeVar("Received")
Received_co = TypeVar("Received_co", covariant=True)


class Channel(Declaration, Protocol[Received_co]):
    """The messages of a subscriber or queryable until it is undeclared; received ones stay afterwards."""

    def try_recv(self) -> Received_co | None:
        """Return the oldest message; None if there is none."""


def received(channel: Channel[Received], most: int) -> list[Received]:
    """Return the received messages of a channel, `most` at most, so that a flood does not block other
    channels.
    """
    return list(islice(iter(channel.try_recv, None), most))


class Network(Protocol):
    """A session with the network."""

    def close(self) -> None:
        """Leave the network."""

    def declare_publisher(self, key: str, priority: Priority) -> Publisher:
        """Declare a publisher that drops messages under congestion."""

    def put(self, key: str, content: Encoded, priority: Priority) -> None:
        """Put a message without a publisher; dropped under congestion. Raises NetworkError.

        The messages of one key and priority keep their order, with and without a publisher.
        """

    def declare_subscriber(self, key: str, capacity: int) -> Channel[Incoming]:
        """Subscribe to a key expression; a sender blocks while `capacity` messages are queued."""

    def declare_queryable(self, key: str, capacity: int) -> Channel[IncomingQuery]:
        """Receive the queries on a key expression; a client blocks while `capacity` queries are queued."""

    def request(
        self,
        key: str,
        parameters: str,
        *,
        received: Callable[[Incoming], None],
        refused: Callable[[Encoded], None],
        ended: Callable[[], None],
    ) -> None:
        """Query the key; callbacks get each reply, each refusal, and the end after QUERY_TIMEOUT_S at most.

        The replies have low priority, and block their sender under congestion.
        """

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of live tokens. Complete only as long as none are watched."""

    def declare_token(self, key: str) -> Declaration:
        """Declare a liveliness token."""

    def watch_liveliness(self, key: str) -> Channel[TokenChange]:
        """Receive every token that exists, appears or disappears; a sender blocks while TOKENS are queued."""

    def watch_link(self, report: Callable[[bool], None]) -> Declaration:
        """Report whether a link to a router was restored (True) or lost."""
