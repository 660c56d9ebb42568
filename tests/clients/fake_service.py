"""A service small enough to be right: takes batches in order, asks for holes, acknowledges."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

from caesura_protocol.codec import decode, encode, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange, parse_station_key, replay_parameters, service_key, station_key
from caesura_protocol.messages import Ack, Close, Control, Heartbeat, Open, SampleBatch
from caesura_protocol.transport.inbox import Inbox, IncomingQuery, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import Transport

TICK_S = 0.02
DEADLINE_S = 30.0


def eventually(what: Callable[[], bool], within_s: float = DEADLINE_S) -> None:
    """Wait until something holds; fails the test where it never does. Who is overloaded is asked again."""
    pause, deadline = threading.Event(), time.monotonic() + within_s
    while True:
        try:
            if what():
                return
        except ProtocolError as error:
            if error.code != "overloaded":
                raise
        assert time.monotonic() < deadline, "it never came to hold"
        pause.wait(0.005)


class FakeService:
    """Serves every station. `hold` keeps batches unprocessed; `refuse` answers commands with an error."""

    def __init__(self, transport: Transport, instance: str = "fake-1") -> None:
        self.batches: list[SampleBatch] = []
        self.openings: list[Open] = []
        self.beats: list[Heartbeat] = []
        self.state = "open"
        self.lost = 0  # batches, of which a close tells
        self.hold = False
        self.asks = True  # for what it misses
        self.reads_up = True  # False: it ignores which way is up, as an older service
        self.refuse: ProtocolError | None = None
        self.duplicates = 0
        self.refusals: list[ProtocolError] = []
        self._transport = transport
        self._instance = instance
        self._held: dict[int, SampleBatch] = {}
        self._newest = -1
        self._inbox = Inbox()
        self._over = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> FakeService:
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        self._stack.callback(thread.join)
        self._stack.callback(self._over.set)
        self._stack.enter_context(self._transport.subscribe(station_key("*", "samples"), self._inbox))
        self._stack.enter_context(self._transport.declare_queryable(station_key("*", "control"), self._inbox))
        self._stack.enter_context(self._transport.declare_token(service_key(self._instance, "alive")))
        eventually(lambda: self._transport.list_tokens(service_key(self._instance, "alive")) != ())
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def next_seq(self) -> int:
        return len(self.batches)

    def rows(self) -> int:
        return sum(batch.n for batch in self.batches)

    def _run(self) -> None:
        while not self._over.is_set():
            item = self._inbox.get(TICK_S)
            if isinstance(item, ReceivedSample):
                self._take(item.key, decode(item.payload, item.encoding, SampleBatch, Heartbeat))
            elif item is not None and not isinstance(item, TokenChange):
                with item:
                    self._command(item)
            self._drain()

    def _take(self, key: str, message: SampleBatch | Heartbeat) -> None:
        self._newest = max(self._newest, message.seq)
        if isinstance(message, Heartbeat):
            self.beats.append(message)
        elif message.seq < self.next_seq or message.seq in self._held:
            self.duplicates += 1
        else:
            self._held[message.seq] = message
        self._drain()
        if self.asks and not self.hold and self.openings and self.next_seq <= self._newest:
            self._ask(parse_station_key(key)[0])

    def _ask(self, station: str) -> None:
        wanted = ReplayRange(self.next_seq, self._newest, 100)
        answers = self._transport.query(station_key(station, "replay"), parameters=replay_parameters(wanted))
        self.refusals += answers.refusals
        for reply in answers.replies:
            batch = decode(reply.payload, reply.encoding, SampleBatch)
            self._held.setdefault(batch.seq, batch)
        self._drain()

    def _drain(self) -> None:
        while not self.hold and self.next_seq in self._held:
            self.batches.append(self._held.pop(self.next_seq))

    def _command(self, question: IncomingQuery) -> None:
        command = decode(*question.content, Control).command
        station = parse_station_key(question.key)[0]
        refusal = self.refuse
        if isinstance(command, Open) and refusal is None:
            self.openings.append(command)
        if isinstance(command, Close) and refusal is None:
            refusal = self._close(station, command)
        if refusal is not None:
            question.refuse(encode_error(refusal))
            return
        up = self.openings[-1].up if self.openings and self.reads_up else None
        ack = Ack(session=command.session, next_seq=self.next_seq, state=self.state, up=up, lost=self.lost)
        question.reply(question.key, encode(ack))

    def _close(self, station: str, close: Close) -> ProtocolError | None:
        if not self.openings:
            return ProtocolError("unknown_session", "not open here", value=close.session)
        self._newest = max(self._newest, close.last_seq)
        if self.next_seq <= close.last_seq:
            return ProtocolError("conflict", "batches are missing", value=self.next_seq, limit=close.last_seq)
        self.state = "closed"
        return None
