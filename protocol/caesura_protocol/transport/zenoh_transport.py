"""The transport over Zenoh; the only module of the clients that imports zenoh.

Reasons of the settings (measured, see ARCHITECTURE.md): multicast and gossip are off, because a factory
network names its routers. Shared memory is off, because it raised the 99th percentile from 0.15 to 53 ms. The
lease is 2 s, because a frozen peer is otherwise detected after 9.5 s. Everything uses DROP, because BLOCK
stalls a robot's loop for 5 s and then loses the data nevertheless. The transport retransmits nothing:
sequence numbers and the bridge's ring are for that.
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import zenoh

from caesura_protocol.codec import MESSAGE_TYPES, Encoded, decode_error
from caesura_protocol.errors import CaesuraError, ProtocolError, Unreachable
from caesura_protocol.keys import expression_matches
from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT, endpoint_error
from caesura_protocol.transport.diagnosis import diagnose_connection, listener_certificate_end
from caesura_protocol.transport.inbox import Inbox, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import (
    QUERY_TIMEOUT_S,
    Priority,
    QueryReplies,
    unanswered,
)

SETTINGS: Mapping[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 2000,
    "queries_default_timeout": int(QUERY_TIMEOUT_S * 1000),
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
}
# One attempt to connect. `connect/timeout_ms: -1` retries for ever as well, but inside the library, where
# neither Ctrl-C nor a deadline ends it. Once connected, a session reconnects for ever either way.
ATTEMPT_MS = 500
TIMEOUT = b"Timeout"  # what zenoh 1.10 replies where a queryable is there and does not answer in time
MAX_TEXT = 1001  # characters of an encoding, or of a query's parameters; those of Caesura are shorter

# Keys and encodings in use, read once: of a thousand sessions, and of every type of message.
expression_of = lru_cache(4096)(zenoh.KeyExpr)
encoding_of = lru_cache(len(MESSAGE_TYPES))(zenoh.Encoding)

_QUOTED_REASON = re.compile(r'\b(?:msg|message): "((?:[^"\\]|\\.)*)')
_OS_REASON = re.compile(r"([^:\[\]]+) \(os error \d+\)")

PRIORITIES: Mapping[Priority, zenoh.Priority] = {
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data_low": zenoh.Priority.DATA_LOW,
}


class ZenohTransport:
    """A client session with a Zenoh router. Close it: an open session blocks the interpreter's exit.

    endpoint: `tcp/host:port` or `tls/host:port`, None for that of the config_file or DEFAULT_ENDPOINT;
    config_file: zenoh json5 with the router, and certificates or a password; timeout_s: time after which
    Unreachable is raised, None for no limit.
    """

    def __init__(
        self,
        endpoint: str | None = None,
        *,
        config_file: Path | None = None,
        timeout_s: float | None = None,
    ) -> None:
        self._config = _config(endpoint, config_file)
        self.endpoint: str = _endpoints(self._config)[0]
        self._session = _open(self._config, self.endpoint, timeout_s)
        self._looker: zenoh.Session | None = None  # see alive
        self._looking = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def has_router(self) -> bool:
        """Whether the link to the router is up; of one that hangs it ends within some seconds."""
        return bool(self._session.info.routers_zid())

    def close(self) -> None:
        """Leave the network; all declarations of this session end."""
        for session in (self._session, self._looker):
            if session is not None:
                session.close()  # type: ignore[no-untyped-call]

    def put(self, key: str, content: Encoded, *, priority: Priority = "data") -> None:
        """Publish, without ever blocking."""
        with _map_zenoh_errors(self.endpoint):
            self._session.put(
                expression_of(key),
                content.payload,
                encoding=encoding_of(content.encoding),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=PRIORITIES[priority],
            )

    def query(
        self,
        key: str,
        content: Encoded | None = None,
        *,
        parameters: str = "",
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> QueryReplies:
        """Query the key; wait for every answer or the timeout. Consolidation is off: every answer counts."""
        payload, encoding = content or (None, None)
        with _map_zenoh_errors(self.endpoint):
            replies = self._session.get(
                f"{key}?{parameters}" if parameters else key,
                target=zenoh.QueryTarget.ALL if "*" in key else zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout_s,
                payload=payload,
                encoding=encoding,
            )
            return _split_replies(replies, timeout_s)

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of the liveliness tokens that exist now, sorted.

        Raises Unreachable without a router.

        It uses a separate session. In a session that watches tokens, a query ends before its replies are
        received in 3 % of all cases (zenoh 1.10.2, busy machine); in one that never does, in 0 of 41,700.
        """
        with _map_zenoh_errors(self.endpoint), self._looking:
            if self._looker is None:
                self._looker = _open(self._config, self.endpoint, QUERY_TIMEOUT_S)
            replies = self._looker.liveliness().get(key, timeout=QUERY_TIMEOUT_S)
            return tuple(sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None}))

    @contextmanager
    def subscribe(self, key: str, inbox: Inbox) -> Iterator[None]:
        """Enqueue a ReceivedSample for every message on the key."""
        with _map_zenoh_errors(self.endpoint):
            handler = direct(lambda sample: inbox.offer(_delivery(sample)))
            declared = self._session.declare_subscriber(key, handler)
        with _undeclared(declared.undeclare):
            yield

    @contextmanager
    def declare_queryable(self, key: str, inbox: Inbox) -> Iterator[None]:
        """Enqueue an IncomingQuery for every query on the key."""
        with _map_zenoh_errors(self.endpoint):
            handler = direct(lambda query: inbox.offer(ZenohQuestion(query)))
            declared = self._session.declare_queryable(key, handler)
        with _undeclared(declared.undeclare):
            yield

    @contextmanager
    def declare_token(self, key: str) -> Iterator[None]:
        """Declare a liveliness token on the key."""
        with _map_zenoh_errors(self.endpoint):
            declared = self._session.liveliness().declare_token(key)
        with _undeclared(declared.undeclare):
            yield

    @contextmanager
    def watch_liveliness(self, key: str, inbox: Inbox) -> Iterator[None]:
        """Enqueue a TokenChange for every token that exists, appears or disappears."""
        with _map_zenoh_errors(self.endpoint):
            handler = direct(lambda sample: inbox.offer(token_change(sample)))
            declared = self._session.liveliness().declare_subscriber(key, handler, history=True)
        with _undeclared(declared.undeclare):
            yield


class ZenohQuestion:
    """A Zenoh query, kept until it is answered: dropping it ends the query for the client."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.key = str(query.key_expr)
        parameters = str(query.parameters)
        self.parameters = parameters[:MAX_TEXT]
        attached = (query.payload, query.attachment)
        self.size = len(parameters) + sum(len(one) for one in attached if one is not None)

    @cached_property
    def content(self) -> Encoded | None:
        """The payload of the query, copied only when it is read."""
        payload = self._query.payload
        return None if payload is None else Encoded(payload.to_bytes(), str(self._query.encoding)[:MAX_TEXT])

    def reply(self, key: str, answer: Encoded) -> None:
        """Send one reply."""
        with _map_zenoh_errors(key):
            self._query.reply(key, answer.payload, encoding=answer.encoding)

    def refuse(self, error: Encoded) -> None:
        """Send a refusal."""
        with _map_zenoh_errors(self.key):
            self._query.reply_err(error.payload, encoding=error.encoding)

    def matches(self, key: str) -> bool:
        """Return whether the key of the query includes a key, or with `*` any of the keys."""
        return expression_matches(self.key, key)

    def drop(self) -> None:
        """End the query for the client."""
        self._query.drop()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.drop()


def direct(enqueue: Callable[[Any], None]) -> zenoh.handlers.Callback[Any]:
    """Return a callback that runs in the receiving thread, which keeps the order.

    Enqueuing takes less time than a change of threads.
    """
    return zenoh.handlers.Callback(enqueue, indirect=False)


def _delivery(sample: zenoh.Sample) -> ReceivedSample:
    return ReceivedSample(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)[:MAX_TEXT])


def token_change(sample: zenoh.Sample) -> TokenChange:
    """Return which token appeared or disappeared."""
    return TokenChange(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)


def _split_replies(replies: zenoh.handlers.Handler[zenoh.Reply], timeout_s: float) -> QueryReplies:
    good: list[ReceivedSample] = []
    refusals: list[ProtocolError] = []
    for reply in replies:
        if reply.ok is not None:
            good.append(_delivery(reply.ok))
        elif reply.err is not None:
            refusals.append(_refusal(reply.err, timeout_s))
    return QueryReplies(tuple(good), tuple(refusals))


def _refusal(error: zenoh.ReplyError, timeout_s: float) -> ProtocolError:
    """Return the refusal in an error reply; an error of the library, such as a timeout, is plain text."""
    payload = error.payload.to_bytes()
    if payload == TIMEOUT:
        return unanswered(timeout_s)
    try:
        return decode_error(payload, str(error.encoding))
    except ProtocolError as unreadable:
        return ProtocolError("overloaded", "no readable answer", value=unreadable.value)


def endpoint_of(endpoint: str | None, config_file: Path | None) -> str:
    """Return the endpoint to which a transport with these would connect. Raises CaesuraError."""
    return _endpoints(_config(endpoint, config_file))[0]


def certificate_end_at(endpoint: str | None, config_file: Path | None) -> float | None:
    """Return the time [s since 1970] at which the router's certificate expires; None without TLS.

    Raises CaesuraError.
    """
    config = _config(endpoint, config_file)
    return listener_certificate_end(_endpoints(config)[0], _reader(config))


def _config(endpoint: str | None, config_file: Path | None) -> zenoh.Config:
    try:
        config = zenoh.Config() if config_file is None else zenoh.Config.from_file(config_file)
        where = [endpoint] if endpoint else _endpoints(config) or [DEFAULT_ENDPOINT]
        if (why := next(filter(None, map(endpoint_error, where)), None)) is not None:
            raise CaesuraError(why if config_file is None else f"{config_file}: {why}")
        own = {"mode": "client", "connect/endpoints": where, "connect/timeout_ms": ATTEMPT_MS}
        for key, value in {**SETTINGS, **own}.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        text = [str(config_file)] * (config_file is not None) + [f"endpoint {endpoint!r}"] * bool(endpoint)
        what = f"{' with '.join(text)}: {reason(error)}; expected for example {DEFAULT_ENDPOINT}"
        raise CaesuraError(what) from error
    return config


def _endpoints(config: zenoh.Config) -> list[str]:
    """Return the endpoints of a client's configuration."""
    named = _reader(config)("connect/endpoints") or []
    return list(named.get("client") or []) if isinstance(named, dict) else list(named)


def _reader(config: zenoh.Config) -> Callable[[str], Any]:
    """Return a function that looks up a path of the configuration; it returns None for a missing one."""

    def read(path: str) -> Any:
        try:
            return json.loads(config.get_json(path))
        except zenoh.ZError:
            return None

    return read


def _open(config: zenoh.Config, endpoint: str, timeout_s: float | None) -> zenoh.Session:
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if deadline is not None and time.monotonic() >= deadline:
                raise diagnose_connection(endpoint, _reader(config), for_s=timeout_s) from error


@contextmanager
def _map_zenoh_errors(where: str) -> Iterator[None]:
    try:
        yield
    except zenoh.ZError as error:
        raise Unreachable(f"{where}: {reason(error)}") from error


@contextmanager
def _undeclared(undeclare: Callable[[], object]) -> Iterator[None]:
    try:
        yield
    finally:
        undeclare()


def reason(error: Exception) -> str:
    """Return zenoh's error text on one line, without the place in zenoh's sources and a file's content.

    >>> reason(ValueError('Json5Err(Message { msg: "no such thing" }) at /root/.cargo/zenoh/src/lib.rs:7.'))
    'no such thing'
    >>> reason(ValueError("No link: [[::]:1: Address already in use (os error 98) at /x.rs:61.] at /y.rs:3."))
    'Address already in use'
    >>> reason(ValueError('TOML error: Error { message: "no such key", input: Some("pin = 7") }'))
    'no such key'
    """
    text = str(error).partition(" at /")[0]
    quoted = _QUOTED_REASON.search(text) or _OS_REASON.search(text)
    lines = text.split("\n")
    text = quoted[1] if quoted else f"{lines[0]} {lines[-1]}" if len(lines) > 1 else text
    return " ".join(text.split()) or type(error).__name__
