"""The interface of a transport; `zenoh_transport` implements it with Zenoh, `memory` without a network."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Literal, NamedTuple, Protocol

from caesura_protocol.codec import Encoded
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.transport.inbox import Inbox, ReceivedSample

QUERY_TIMEOUT_S = 2.0
Priority = Literal["data_high", "data", "data_low"]


class QueryReplies(NamedTuple):
    """Replies and refusals of a query.

    Both are empty if there is no queryable, the query is forbidden, or all of a long answer except its end
    was lost. A queryable without content states that: see `nothing_found`.
    """

    replies: tuple[ReceivedSample, ...]
    refusals: tuple[ProtocolError, ...]


class IncompleteAnswerError(ProtocolError):
    """The answer to a query, or a part of it, was not received: the same query may succeed at once."""


def unanswered(timeout_s: float) -> IncompleteAnswerError:
    """Return the refusal of a query that a queryable received and did not answer in time."""
    return IncompleteAnswerError(
        "overloaded",
        f"no answer in {timeout_s:g} s: the queried service or bridge is busy or cut off; query again",
        limit=timeout_s,
    )


NOTHING: ErrorCode = "unknown_session"


def nothing_found(instance: str, replies: int = 0) -> ProtocolError:
    """Return the reply of an instance that has no matching content, or no more than `replies` replies.

    A reader compares this number with the received replies, some of which a congested network may lose.
    """
    more = f"more than {replies} replies" if replies else "that matches the query"
    return ProtocolError(NOTHING, f"{instance} has nothing {more}", value=instance, limit=replies)


class Transport(Protocol):
    """A network session: publishes payloads, and puts received items into an Inbox.

    Context managers own the declarations.
    """

    @property
    def endpoint(self) -> str:
        """The connected endpoint, as named in errors."""

    @property
    def has_router(self) -> bool:
        """Whether the link to the router is up; of one that hangs it ends within some seconds."""

    def close(self) -> None:
        """Leave the network; all declarations of this session end."""

    def put(self, key: str, content: Encoded, *, priority: Priority = "data") -> None:
        """Publish without blocking; messages that do not fit into a queue are dropped silently."""

    def query(
        self,
        key: str,
        content: Encoded | None = None,
        *,
        parameters: str = "",
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> QueryReplies:
        """Query the key; wait for every answer or the timeout, which is a refusal: see `unanswered`."""

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of the liveliness tokens that exist now, sorted."""

    def subscribe(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue a ReceivedSample for every message on the key."""

    def declare_queryable(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue an IncomingQuery for every query on the key."""

    def declare_token(self, key: str) -> AbstractContextManager[None]:
        """Declare a liveliness token on the key."""

    def watch_liveliness(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue a TokenChange for every token that exists, appears or disappears."""
