"""A peer: puts, asks and listens as a bridge or a reader would, without their code; by Zenoh or in memory."""

from __future__ import annotations

import json
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from queue import Empty, SimpleQueue
from typing import Self, TypeVar

import zenoh

from caesura_protocol import messages
from caesura_protocol.codec import Encoded, decode, decode_error, encode, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange, parse_replay_parameters, service_key, session_key, station_key
from caesura_protocol.messages import (
    Ack,
    Close,
    Control,
    Heartbeat,
    Message,
    Open,
    Program,
    SampleBatch,
    ServiceStatus,
    SessionStatus,
    Snapshot,
)
from caesura_protocol.transport.inbox import IncomingQuery, ReceivedSample
from caesura_protocol.transport.memory import CallbackInbox, MemoryNetwork
from caesura_protocol.transport.transport_interface import NOTHING, QueryReplies
from caesura_protocol.transport.zenoh_transport import ZenohQuestion, direct
from caesura_service.server.network_join import SETTINGS

DEADLINE_S = 30.0
M = TypeVar("M", bound=Message)
STREAMS = {
    "changepoints": messages.Changepoints,
    "segments": messages.Segments,
    "posterior": messages.Posterior,
    "status": SessionStatus,
    "program": Program,
}


class Received:
    """What was put on some keys since the subscription, in order of arrival."""

    def __init__(self) -> None:
        self.queue: SimpleQueue[ReceivedSample] = SimpleQueue()
        self.all: list[Message] = []

    def until(self, kind: type[M], wanted: Callable[[M], bool] = lambda _: True) -> M:
        """The first message of a kind that is as wanted; fails after the deadline."""
        deadline = time.monotonic() + DEADLINE_S
        while True:
            try:
                key, payload, encoding = self.queue.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise AssertionError(f"no such {kind.__name__} among {self.all}") from None
            message = decode(payload, encoding, _model_of(key))
            self.all.append(message)
            if isinstance(message, kind) and wanted(message):
                return message


def _model_of(key: str) -> type[Message]:
    return ServiceStatus if "/service/" in key else STREAMS[key.rpartition("/")[2]]


class Client(ABC):
    """A client of a network. Its declarations reach the service before what it asks afterwards."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None: ...

    @abstractmethod
    def put(self, key: str, payload: bytes, encoding: str) -> None: ...

    @abstractmethod
    def get(self, key: str, payload: bytes | None = None, encoding: str | None = None) -> QueryReplies: ...

    @abstractmethod
    def subscribed(
        self, key: str, take: Callable[[ReceivedSample], None]
    ) -> AbstractContextManager[None]: ...

    @abstractmethod
    def answering(
        self, key: str, answer: Callable[[IncomingQuery], None]
    ) -> AbstractContextManager[None]: ...

    def send(self, message: SampleBatch | Heartbeat, station: str = "cell-1") -> None:
        self.put(station_key(station, "samples"), *encode(message))

    def command(self, command: Open | Close, station: str = "cell-1") -> Ack:
        """The Ack. Raises the refusal."""
        return self.control(*encode(Control(command=command)), station)

    def control(self, payload: bytes | None, encoding: str | None, station: str = "cell-1") -> Ack:
        replies, refusals = self.get(station_key(station, "control"), payload, encoding)
        for refusal in refusals:
            raise refusal
        (reply,) = replies
        return decode(reply.payload, reply.encoding, Ack)

    def ask(self, key: str, kind: type[M]) -> dict[str, M]:
        """Every reply, by its key. That an instance has nothing is no refusal."""
        replies, refusals = self.get(key)
        for refusal in refusals:
            if refusal.code != NOTHING:
                raise refusal
        return {reply.key: decode(reply.payload, reply.encoding, kind) for reply in replies}

    def snapshot(self, session: str = "s1", station: str = "cell-1") -> Snapshot:
        key = session_key(station, session, "snapshot")
        return self.ask(key, Snapshot)[key]

    def service_status(self, instance: str = "test-1") -> ServiceStatus:
        key = service_key(instance, "status")
        return self.ask(key, ServiceStatus)[key]

    def until_service(self, wanted: Callable[[ServiceStatus], bool]) -> ServiceStatus:
        """The service's status once it is as wanted; fails after the deadline.

        It asks 200 times a second, for more than 2000 questions are refused.
        """
        deadline, again = time.monotonic() + DEADLINE_S, threading.Event()
        while not wanted(status := self.service_status()):
            assert time.monotonic() < deadline, status
            again.wait(0.005)
        return status

    def until_closed(self, last_seq: int, station: str = "cell-1") -> Ack:
        """Close as a bridge does: again and again while batches are missing."""
        deadline, again = time.monotonic() + DEADLINE_S, threading.Event()
        while True:
            try:
                return self.command(Close(session="s1", last_seq=last_seq), station)
            except ProtocolError as refusal:
                if refusal.code != "conflict" or time.monotonic() > deadline:
                    raise
            again.wait(0.001)

    @contextmanager
    def listening(self, *keys: str) -> Iterator[Received]:
        """Hear what is put on the keys; by default everything of every session and station."""
        received = Received()
        keys = keys or (
            f"{session_key('*', '*', 'status').rpartition('/')[0]}/*",
            station_key("*", "program"),
        )
        with ExitStack() as stack:
            for key in keys:
                stack.enter_context(self.subscribed(key, received.queue.put))
            yield received

    @contextmanager
    def replaying(
        self, batches: list[SampleBatch], *, oldest: int = 0, station: str = "cell-1"
    ) -> Iterator[list[ReplayRange]]:
        """Answer the station's replay from a ring; yields the ranges that were asked for."""
        ranges: list[ReplayRange] = []

        def reply(query: IncomingQuery) -> None:
            with query:
                wanted = parse_replay_parameters(query.parameters)
                ranges.append(wanted)
                if wanted.first < oldest:
                    refusal = ProtocolError("evicted", "gone", value=wanted.first, limit=oldest)
                    query.refuse(encode_error(refusal))
                    return
                for batch in batches[wanted.first : wanted.last + 1][: wanted.limit]:
                    query.reply(station_key(station, "replay"), encode(batch))

        with self.answering(station_key(station, "replay"), reply):
            yield ranges


class Peer(Client):
    """A client session with a router. It waits where the router does not keep up: nothing is dropped."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        where = {"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": 30_000}
        for key, value in {**SETTINGS, **where}.items():
            config.insert_json5(key, json.dumps(value))
        self.endpoint, self.network = endpoint, zenoh.open(config)

    def close(self) -> None:
        self.network.close()

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        self.network.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)

    def get(self, key: str, payload: bytes | None = None, encoding: str | None = None) -> QueryReplies:
        replies = list(self.network.get(key, payload=payload, encoding=encoding, timeout=DEADLINE_S))
        return QueryReplies(
            tuple(_received(reply.ok) for reply in replies if reply.ok is not None),
            tuple(
                decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding))
                for reply in replies
                if reply.err is not None
            ),
        )

    @contextmanager
    def subscribed(self, key: str, take: Callable[[ReceivedSample], None]) -> Iterator[None]:
        subscriber = self.network.declare_subscriber(key, direct(lambda sample: take(_received(sample))))
        yield
        subscriber.undeclare()

    @contextmanager
    def answering(self, key: str, answer: Callable[[IncomingQuery], None]) -> Iterator[None]:
        queryable = self.network.declare_queryable(key, lambda query: answer(ZenohQuestion(query)))
        yield
        queryable.undeclare()


class MemoryPeer(Client):
    """A client in the process of the service."""

    def __init__(self, network: MemoryNetwork) -> None:
        self.transport = network.transport()

    def close(self) -> None:
        self.transport.close()

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        self.transport.put(key, Encoded(payload, encoding))

    def get(self, key: str, payload: bytes | None = None, encoding: str | None = None) -> QueryReplies:
        content = None if payload is None else Encoded(payload, encoding or "")
        return self.transport.query(key, content, timeout_s=DEADLINE_S)

    def subscribed(self, key: str, take: Callable[[ReceivedSample], None]) -> AbstractContextManager[None]:
        return self.transport.subscribe(key, CallbackInbox(take))

    def answering(self, key: str, answer: Callable[[IncomingQuery], None]) -> AbstractContextManager[None]:
        return self.transport.declare_queryable(key, CallbackInbox(answer))


def _received(sample: zenoh.Sample) -> ReceivedSample:
    return ReceivedSample(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding))
