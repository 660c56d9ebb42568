"""The interface of a transport; `transport` implements it with Zenoh, `memory` without a network."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Literal, NamedTuple, Protocol

from caesura_protocol.codec import Encoded
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.transport.inbox import Inbox, ReceivedSample

QUERY_TIMEOUT_S = 2.0
Priority = Literal["data_high", "data", "data_low"]


class QueryReplies(NamedTuple):
    """Replies and refusals of a query. Both empty: no queryable is there, the query is forbidden, or all of a
    long answer was lost but its end. Who has nothing to reply says so: see `nothing_found`.
    """

    replies: tuple[ReceivedSample, ...]
    refusals: tuple[ProtocolError, ...]


class IncompleteAnswerError(ProtocolError):
    """The answer to a query, or a part of it, did not arrive: the same query may succeed at once."""


def unanswered(timeout_s: float) -> IncompleteAnswerError:
    """Return the refusal of a query that a queryable received and did not answer in time."""
    return IncompleteAnswerError(
        "overloaded",
        f"no answer in {timeout_s:g} s: who was asked is busy, hangs or is cut off; ask again",
        limit=timeout_s,
    )


NOTHING: ErrorCode = "unknown_session"


def nothing_found(instance: str, replies: int = 0) -> ProtocolError:
    """Return how an instance of the service says that it has nothing of what a query asks for, or nothing
    more than so many replies, some of which a busy network may lose.
    """
    more = f"more than {replies} replies" if replies else "of what was asked for"
    return ProtocolError(NOTHING, f"{instance} has nothing {more}", value=instance, limit=replies)


class Transport(Protocol):
    """A network session. Keys and payloads in, items in an Inbox out; context managers own declarations."""

    @property
    def endpoint(self) -> str:
        """The endpoint to which it is connected, as errors name it."""

    def close(self) -> None:
        """Leave the network; everything declared through this session goes with it."""

    def put(self, key: str, content: Encoded, *, priority: Priority = "data") -> None:
        """Publish, without ever blocking; what a full queue drops is dropped silently."""

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
        """Enqueue a ReceivedSample for everything that is put on the key."""

    def declare_queryable(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue an IncomingQuery for every query on the key."""

    def declare_token(self, key: str) -> AbstractContextManager[None]:
        """Declare a liveliness token on the key."""

    def watch_liveliness(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue a TokenChange for every token that is there, comes or goes."""
