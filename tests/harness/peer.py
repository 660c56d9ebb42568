"""A peer on a real network: puts, asks and listens as a bridge or a reader would, without their code."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import zenoh

from caesura_protocol import messages
from caesura_protocol.codec import decode, decode_error, encode, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_replay_parameters, service_key, session_key, station_key
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
from caesura_service.server.network import SETTINGS

DEADLINE_S = 30.0
M = TypeVar("M", bound=Message)
STREAMS = {
    "changepoints": messages.Changepoints,
    "segments": messages.Segments,
    "posterior": messages.Posterior,
    "status": SessionStatus,
    "program": Program,
}


class Heard:
    """What was put on some keys since the subscription, in order of arrival."""

    def __init__(self) -> None:
        self.queue: SimpleQueue[zenoh.Sample] = SimpleQueue()
        self.all: list[Message] = []

    def until(self, kind: type[M], wanted: Callable[[M], bool] = lambda _: True) -> M:
        """The first message of a kind that is as wanted; fails after the deadline."""
        deadline = time.monotonic() + DEADLINE_S
        while True:
            try:
                sample = self.queue.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise AssertionError(f"no such {kind.__name__} among {self.all}") from None
            model = _model_of(str(sample.key_expr))
            message = decode(sample.payload.to_bytes(), str(sample.encoding), model)
            self.all.append(message)
            if isinstance(message, kind) and wanted(message):
                return message


def _model_of(key: str) -> type[Message]:
    return ServiceStatus if "/service/" in key else STREAMS[key.rpartition("/")[2]]


class Peer:
    """A client session. Its declarations reach the router before anything that it asks afterwards."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        where = {"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": 5000}
        for key, value in {**SETTINGS, **where}.items():
            config.insert_json5(key, json.dumps(value))
        self.network = zenoh.open(config)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self.network.close()

    def send(self, message: SampleBatch | Heartbeat, station: str = "cell-1") -> None:
        self.put(station_key(station, "samples"), *encode(message))

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        self.network.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)

    def command(self, command: Open | Close, station: str = "cell-1") -> Ack:
        """The Ack. Raises the refusal."""
        return self.control(*encode(Control(command=command)), station)

    def control(self, payload: bytes | None, encoding: str | None, station: str = "cell-1") -> Ack:
        (reply,) = self.network.get(
            station_key(station, "control"), payload=payload, encoding=encoding, timeout=DEADLINE_S
        )
        if reply.ok is None:
            raise decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding))
        return decode(reply.ok.payload.to_bytes(), str(reply.ok.encoding), Ack)

    def ask(self, key: str, kind: type[M]) -> dict[str, M]:
        """Every reply, by its key."""
        replies = list(self.network.get(key, timeout=DEADLINE_S))
        for reply in replies:
            if reply.ok is None:
                raise decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding))
        return {
            str(reply.ok.key_expr): decode(reply.ok.payload.to_bytes(), str(reply.ok.encoding), kind)
            for reply in replies
        }

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

    @contextmanager
    def listening(self, *keys: str) -> Iterator[Heard]:
        """Hear what is put on the keys; by default everything of every session and station."""
        heard = Heard()
        keys = keys or (
            f"{session_key('*', '*', 'status').rpartition('/')[0]}/*",
            station_key("*", "program"),
        )
        subscribers = [
            self.network.declare_subscriber(key, zenoh.handlers.Callback(heard.queue.put, indirect=False))
            for key in keys
        ]
        yield heard
        for subscriber in subscribers:
            subscriber.undeclare()

    @contextmanager
    def replaying(
        self, batches: list[SampleBatch], *, oldest: int = 0, station: str = "cell-1"
    ) -> Iterator[list[Any]]:
        """Answer the station's replay from a ring; yields the ranges that were asked for."""
        ranges: list[Any] = []

        def reply(query: zenoh.Query) -> None:
            with query:
                wanted = parse_replay_parameters(str(query.parameters))
                ranges.append(wanted)
                if wanted.first < oldest:
                    refusal = ProtocolError("evicted", "gone", value=wanted.first, limit=oldest)
                    payload, encoding = encode_error(refusal)
                    query.reply_err(payload, encoding=encoding)
                    return
                for batch in batches[wanted.first : wanted.last + 1][: wanted.limit]:
                    payload, encoding = encode(batch)
                    query.reply(station_key(station, "replay"), payload, encoding=encoding)

        queryable = self.network.declare_queryable(station_key(station, "replay"), reply)
        yield ranges
        queryable.undeclare()
