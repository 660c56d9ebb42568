"""A transport within one process, with the interface and behaviour of the real one, for tests and examples.

A MemoryNetwork replaces Zenoh's router; each MemoryTransport is one session with it. `lose` makes the network
drop matching messages, like DROP with a full queue, without an error for the sender.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self

from caesura_protocol.codec import Encoded, decode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import expression_matches
from caesura_protocol.transport.inbox import ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S, Priority, QueryReplies, unanswered


def intersect(one: str, other: str) -> bool:
    """Return whether two key expressions intersect. A `*` stands for one part of a key.

    >>> intersect("caesura/v1/station/*/alive", "caesura/v1/station/cell-1/alive")
    True
    """
    own, others = one.split("/"), other.split("/")
    pairs = zip(own, others, strict=False)
    return len(own) == len(others) and all("*" in pair or pair[0] == pair[1] for pair in pairs)


class Offered(Protocol):
    """Receiver of items: an Inbox, or a CallbackInbox."""

    def offer(self, item: Any) -> object:
        """Receive an item."""


class CallbackInbox(NamedTuple):
    """Passes each item to a callback, in the thread that publishes or queries."""

    offer: Callable[[Any], object]


class MemoryNetwork:
    """A network in memory: the declarations of all its transports."""

    def __init__(self) -> None:
        self.subscribers: list[tuple[str, Offered]] = []
        self.queryables: list[tuple[str, Offered]] = []
        self.watchers: list[tuple[str, Offered]] = []
        self.tokens: list[str] = []
        self.lose: Callable[[ReceivedSample], bool] = lambda delivery: False
        self.lock = threading.RLock()

    def transport(self) -> MemoryTransport:
        """Return a new session with this network."""
        return MemoryTransport(self)


class MemoryTransport:
    """A session with a MemoryNetwork; implements Transport."""

    endpoint: str = "memory"
    has_router: bool = True

    def __init__(self, network: MemoryNetwork) -> None:
        self._network = network

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Return at once: declarations end with their context managers."""

    def put(self, key: str, content: Encoded, *, priority: Priority = "data") -> None:
        """Deliver a message to every subscriber of the key."""
        del priority  # one process, one order
        delivery = ReceivedSample(key, *content)
        if not self._network.lose(delivery):
            self._offer(self._network.subscribers, key, delivery)

    def query(
        self,
        key: str,
        content: Encoded | None = None,
        *,
        parameters: str = "",
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> QueryReplies:
        """Query every queryable of the key and wait until each has ended its query."""
        with self._network.lock:
            asked = [inbox for known, inbox in self._network.queryables if intersect(known, key)]
        questions = [MemoryQuestion(key, parameters, content) for _ in asked]
        for inbox, question in zip(asked, questions, strict=True):
            inbox.offer(question)
        late = [question for question in questions if not question.ended.wait(timeout_s)]
        refusals = [refusal for question in questions for refusal in question.refusals]
        return QueryReplies(
            tuple(reply for question in questions for reply in question.replies),
            (*refusals, *(unanswered(timeout_s) for _ in late)),
        )

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of the tokens that exist now, sorted."""
        with self._network.lock:
            return tuple(sorted({token for token in self._network.tokens if intersect(key, token)}))

    @contextmanager
    def subscribe(self, key: str, inbox: Offered) -> Iterator[None]:
        """Enqueue a ReceivedSample for every message on the key."""
        with self._declared(self._network.subscribers, key, inbox):
            yield

    @contextmanager
    def declare_queryable(self, key: str, inbox: Offered) -> Iterator[None]:
        """Enqueue an IncomingQuery for every query on the key."""
        with self._declared(self._network.queryables, key, inbox):
            yield

    @contextmanager
    def declare_token(self, key: str) -> Iterator[None]:
        """Declare a liveliness token on the key."""
        with self._network.lock:
            self._network.tokens.append(key)
            self._offer(self._network.watchers, key, TokenChange(key, alive=True))
        try:
            yield
        finally:
            with self._network.lock:
                self._network.tokens.remove(key)
                self._offer(self._network.watchers, key, TokenChange(key, alive=False))

    @contextmanager
    def watch_liveliness(self, key: str, inbox: Offered) -> Iterator[None]:
        """Enqueue a TokenChange for every token that exists, appears or disappears."""
        with self._declared(self._network.watchers, key, inbox):
            for token in self.list_tokens(key):
                inbox.offer(TokenChange(token, alive=True))
            yield

    def _offer(
        self, declared: list[tuple[str, Offered]], key: str, item: ReceivedSample | TokenChange
    ) -> None:
        with self._network.lock:
            inboxes = [inbox for known, inbox in declared if intersect(known, key)]
        for inbox in inboxes:
            inbox.offer(item)

    @contextmanager
    def _declared(self, declared: list[tuple[str, Offered]], key: str, inbox: Offered) -> Iterator[None]:
        with self._network.lock:
            declared.append((key, inbox))
        try:
            yield
        finally:
            with self._network.lock:
                declared.remove((key, inbox))


class MemoryQuestion:
    """A query within the process; collects its replies until it is ended."""

    def __init__(self, key: str, parameters: str, content: Encoded | None) -> None:
        self.key = key
        self.parameters = parameters
        self.content = content
        self.size = len(parameters) + (0 if content is None else len(content.payload))
        self.replies: list[ReceivedSample] = []
        self.refusals: list[ProtocolError] = []
        self.ended = threading.Event()

    def reply(self, key: str, answer: Encoded) -> None:
        """Send one reply."""
        self.replies.append(ReceivedSample(key, *answer))

    def refuse(self, error: Encoded) -> None:
        """Send a refusal."""
        self.refusals.append(decode_error(*error))

    def matches(self, key: str) -> bool:
        """Return whether the key of the query includes a key, or with `*` any of the keys."""
        return expression_matches(self.key, key)

    def drop(self) -> None:
        """End the query for the client."""
        self.ended.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.drop()
