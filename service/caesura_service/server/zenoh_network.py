"""The network of the server over Zenoh; besides `network_join`, the only module here that imports zenoh.

Samples and queries wait in channels until they are polled. Callbacks run directly in the network's thread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh

from caesura_protocol.codec import Encoded
from caesura_protocol.transport.inbox import IncomingQuery, TokenChange
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S, Priority
from caesura_protocol.transport.zenoh_transport import (
    MAX_TEXT,
    PRIORITIES,
    ZenohQuestion,
    direct,
    encoding_of,
    reason,
    token_change,
)
from caesura_service.server.network_interface import TOKENS, Channel, Declaration, Incoming, NetworkError

Raw = TypeVar("Raw")
Received = TypeVar("Received")


class ZenohNetwork:
    """The server's session with Zenoh."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session

    def close(self) -> None:
        """Leave the network: an open session would block the interpreter's exit."""
        self._session.close()  # type: ignore[no-untyped-call]

    def declare_publisher(self, key: str, priority: Priority) -> ZenohPublisher:
        """Declare a publisher; it sends nothing without a subscriber. Raises NetworkError."""
        drop = zenoh.CongestionControl.DROP
        try:
            declared = self._session.declare_publisher(
                key, congestion_control=drop, priority=PRIORITIES[priority]
            )
        except zenoh.ZError as error:
            raise NetworkError(reason(error)) from error
        return ZenohPublisher(declared)

    def put(self, key: str, content: Encoded, priority: Priority) -> None:
        """Put a message without a publisher. Raises NetworkError."""
        try:
            self._session.put(
                key,
                content.payload,
                encoding=encoding_of(content.encoding),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=PRIORITIES[priority],
            )
        except zenoh.ZError as error:
            raise NetworkError(reason(error)) from error

    def declare_subscriber(self, key: str, capacity: int) -> Channel[Incoming]:
        """Subscribe to a key expression; Zenoh fills the channel without the interpreter."""
        declared = self._session.declare_subscriber(key, zenoh.handlers.FifoChannel(capacity))
        return ZenohChannel(declared, declared.handler.try_recv, _incoming)

    def declare_queryable(self, key: str, capacity: int) -> Channel[IncomingQuery]:
        """Receive the queries on a key expression; Zenoh fills the channel without the interpreter."""
        declared = self._session.declare_queryable(key, zenoh.handlers.FifoChannel(capacity))
        return ZenohChannel(declared, declared.handler.try_recv, ZenohQuestion)

    def request(
        self,
        key: str,
        parameters: str,
        *,
        received: Callable[[Incoming], None],
        refused: Callable[[Encoded], None],
        ended: Callable[[], None],
    ) -> None:
        """Query the key; the replies may block (BLOCK), with lower priority than live samples (DATA_LOW)."""

        def pass_on(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                received(_incoming(reply.ok))
            elif reply.err is not None:
                refused(Encoded(reply.err.payload.to_bytes(), str(reply.err.encoding)[:MAX_TEXT]))

        handler: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(
            pass_on, ended, indirect=False
        )
        self._session.get(
            f"{key}?{parameters}",
            handler,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
            timeout=QUERY_TIMEOUT_S,
        )

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of live tokens. Once tokens are watched, the answer may be partial."""
        waiting: zenoh.handlers.FifoChannel[zenoh.Reply]
        waiting = zenoh.handlers.FifoChannel(TOKENS)  # a router fills it before it is read
        replies = self._session.liveliness().get(key, waiting, timeout=QUERY_TIMEOUT_S)
        return tuple(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def declare_token(self, key: str) -> Declaration:
        """Declare a liveliness token."""
        return self._session.liveliness().declare_token(key)

    def watch_liveliness(self, key: str) -> Channel[TokenChange]:
        """Receive every token that exists, appears or disappears; filled as in `declare_subscriber`."""
        waiting: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(TOKENS)
        declared = self._session.liveliness().declare_subscriber(key, waiting, history=True)
        return ZenohChannel(declared, declared.handler.try_recv, token_change)

    def watch_link(self, report: Callable[[bool], None]) -> Declaration:
        """Report whether the link to the router was restored (True) or lost."""
        handler = direct(lambda event: report(event.kind == zenoh.SampleKind.PUT))
        return self._session.info.declare_transport_events_listener(handler)


class ZenohPublisher:
    """A publisher of one key."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, content: Encoded) -> None:
        """Put a message; never waits. Raises NetworkError."""
        try:
            self._publisher.put(content.payload, encoding=encoding_of(content.encoding))
        except zenoh.ZError as error:
            raise NetworkError(reason(error)) from error

    def undeclare(self) -> None:
        """End the declaration."""
        self._publisher.undeclare()  # type: ignore[no-untyped-call]


class ZenohChannel(Generic[Raw, Received]):
    """The channel of a subscriber or a queryable."""

    def __init__(
        self, declared: Declaration, try_recv: Callable[[], Raw | None], read: Callable[[Raw], Received]
    ) -> None:
        self._declared, self._try_recv, self._read = declared, try_recv, read

    def try_recv(self) -> Received | None:
        """Return the oldest message; None if there is none."""
        try:
            raw = self._try_recv()
        except zenoh.ZError:  # empty, and no longer declared
            return None
        return None if raw is None else self._read(raw)

    def undeclare(self) -> None:
        """End the declaration; received messages can still be read."""
        self._declared.undeclare()


def _incoming(sample: zenoh.Sample) -> Incoming:
    return Incoming(str(sample.key_expr), sample.payload, str(sample.encoding))
