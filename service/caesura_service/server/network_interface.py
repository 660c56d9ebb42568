"""The network as the server uses it: `zenoh_network` has it over Zenoh, `memory_network` without a network.

Callbacks run in the network's threads, and only enqueue.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import NamedTuple, Protocol, TypeVar

from caesura_protocol.codec import Encoded
from caesura_protocol.transport.inbox import IncomingQuery, TokenChange
from caesura_protocol.transport.network import Priority

TOKENS = 1 << 16  # changes of tokens that wait; a router fills the channel before it can be polled


class NetworkError(Exception):
    """The network could not be joined, or was left."""


class Payload(Protocol):
    """A received payload; copied by `bytes` only where it is wanted."""

    def __len__(self) -> int: ...

    def __bytes__(self) -> bytes: ...


class Incoming(NamedTuple):
    """A message that was put on a key, or that replies to a query."""

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
    """A subscriber's or a queryable's messages, until it is undeclared; what was received stays."""

    def try_recv(self) -> Received_co | None:
        """Return the oldest message; None where there is none."""


def received(channel: Channel[Received], most: int) -> list[Received]:
    """Take what a channel has received, at most so much: who never stops keeps no other channel waiting."""
    return list(islice(iter(channel.try_recv, None), most))


class Network(Protocol):
    """A session with the network."""

    def close(self) -> None:
        """Leave the network."""

    def declare_publisher(self, key: str, priority: Priority) -> Publisher:
        """Declare a publisher that drops what does not fit."""

    def declare_subscriber(self, key: str, capacity: int) -> Channel[Incoming]:
        """Subscribe to a key expression; where `capacity` messages wait, their senders wait too."""

    def declare_queryable(self, key: str, capacity: int) -> Channel[IncomingQuery]:
        """Receive the queries on a key expression; where `capacity` of them wait, who asks waits too."""

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

        The replies wait behind other messages, and their sender may have to wait.
        """

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of live tokens. Complete only as long as none are watched."""

    def declare_token(self, key: str) -> Declaration:
        """Declare a liveliness token."""

    def watch_liveliness(self, key: str) -> Channel[TokenChange]:
        """Receive every token that is there, comes or goes; where TOKENS wait, their senders wait too."""

    def watch_link(self, report: Callable[[bool], None]) -> Declaration:
        """Report whether a link to a router was restored (True) or lost."""
