"""Messages between two routers, of which some are lost, some come twice, and some come later than the next.

TCP hides all three, so they are done above it: bridges are with one router, the service with the other, and
this is the only way between them. What bridges put, what they are asked and what they answer goes through;
liveliness and commands go through unharmed, but for commands whose answer is lost.
"""

from __future__ import annotations

import json
import random
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import zenoh

from caesura_protocol.keys import service_key, station_key
from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.server.network_join import SETTINGS

COMMANDS_S = 2.0


@dataclass
class Line:
    """How bad it is, and what it has done so far."""

    lost: float = 0.0  # share of messages
    doubled: float = 0.0
    late: float = 0.0  # come after the next one
    counts: dict[str, int] = field(default_factory=lambda: {"passed": 0, "lost": 0, "doubled": 0, "late": 0})


class Relay:
    """Between a near router, where bridges are, and a far one, where the service is."""

    def __init__(self, near: str, far: str, line: Line, seed: int = 0) -> None:
        self.line = line
        self._rng = random.Random(seed)
        self._near, self._far = session(near), session(far)
        self._late: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._tokens: dict[str, Any] = {}
        self._declared: list[Any] = []

    def open(self) -> None:
        near, far = self._near, self._far
        self._declared = [
            near.declare_subscriber(station_key("*", "samples"), direct(self._samples)),
            far.declare_queryable(station_key("*", "replay"), lambda query: self._ask(query, near, 1.0)),
            near.declare_queryable(station_key("*", "control"), lambda query: self._ask(query, far, 0.0)),
            far.liveliness().declare_subscriber(
                service_key("*", "alive"), direct(lambda token: self._mirror(token, near)), history=True
            ),
        ]

    def close(self) -> None:
        for session_ in (self._near, self._far):
            session_.close()

    def _samples(self, sample: zenoh.Sample) -> None:
        key, payload, encoding = str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)
        self._badly(lambda: self._far.put(key, payload, encoding=encoding))

    def _ask(self, query: zenoh.Query, where: zenoh.Session, badness: float) -> None:
        """Ask on the other side, and pass on what is answered."""
        payload = query.payload.to_bytes() if query.payload is not None else None
        encoding = str(query.encoding) if payload is not None else None
        replies = where.get(
            str(query.selector),
            payload=payload,
            encoding=encoding,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=COMMANDS_S,
        )
        with query:
            for reply in replies:
                if reply.ok is not None:
                    self._badly(lambda answer=reply.ok: passed_on(query, answer), badness)
                elif reply.err is not None:
                    query.reply_err(reply.err.payload.to_bytes(), encoding=str(reply.err.encoding))
            self._let_go()

    def _mirror(self, token: zenoh.Sample, where: zenoh.Session) -> None:
        key = str(token.key_expr)
        if token.kind == zenoh.SampleKind.PUT:
            self._tokens[key] = where.liveliness().declare_token(key)
        elif key in self._tokens:
            self._tokens.pop(key).undeclare()

    def _badly(self, send: Callable[[], None], badness: float = 1.0) -> None:
        """Send, or not, or twice, or later."""
        line, counts = self.line, self.line.counts
        with self._lock:
            chance = self._rng.random()
            late, self._late = self._late, []
            if chance < badness * line.lost:
                counts["lost"] += 1
            elif (chance := chance - badness * line.lost) < badness * line.doubled:
                counts["doubled"] += 1
                send()
                send()
            elif chance - badness * line.doubled < badness * line.late:
                counts["late"] += 1
                self._late.append(send)
            else:
                counts["passed"] += 1
                send()
            for one in late:
                one()

    def _let_go(self) -> None:
        """What was kept for later goes: an answer cannot be added to once it has ended."""
        with self._lock:
            late, self._late = self._late, []
            for one in late:
                one()


def passed_on(query: zenoh.Query, answer: zenoh.Sample) -> None:
    query.reply(str(answer.key_expr), answer.payload.to_bytes(), encoding=str(answer.encoding))


def session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    where = {"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": 5000}
    for key, value in {**SETTINGS, **where}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextmanager
def relayed(near: str, far: str, line: Line) -> Iterator[Relay]:
    """A relay that works while the context lasts."""
    with ExitStack() as stack:
        relay = Relay(near, far, line)
        stack.callback(relay.close)
        relay.open()
        yield relay
