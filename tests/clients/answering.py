"""The service's side of questions and results: answers what the test sets, and puts what it is told to."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import Self

from caesura_protocol.codec import Encoded, encode, encode_error
from caesura_protocol.keys import SessionPart, requests_nothing_said, service_key, session_key, station_key
from caesura_protocol.messages import Program, Result, Snapshot
from caesura_protocol.transport.inbox import Inbox, IncomingQuery, ReceivedSample, TokenChange
from caesura_protocol.transport.memory import intersect
from caesura_protocol.transport.transport_interface import Transport, nothing_found
from clients.fake_service import eventually

TICK_S = 0.02


class Answering:
    """`snapshots` go to whoever asks for them; `answers` and `refusals` are by key."""

    def __init__(self, transport: Transport, instance: str = "fake-1") -> None:
        self._instance = instance
        self.snapshots: list[Snapshot] = []
        self.answers: dict[str, Encoded] = {}
        self.refusals: dict[str, Encoded] = {}
        self.refused = 0  # questions
        self.asked: list[str] = []  # their keys
        self.lost = 0  # answers that still come without their first reply
        self.is_silent = False  # are there no words where there is nothing?
        self._transport = transport
        self._inbox = Inbox()
        self._over = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        self._stack.callback(thread.join)
        self._stack.callback(self._over.set)
        for key in (
            session_key("*", "*", "snapshot"),
            session_key("*", "*", "samples"),
            station_key("*", "program"),
            service_key("*", "status"),
        ):
            self._stack.enter_context(self._transport.declare_queryable(key, self._inbox))
        self._stack.enter_context(self._transport.declare_token(service_key(self._instance, "alive")))
        eventually(lambda: self._transport.list_tokens(service_key(self._instance, "alive")) != ())
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def put(self, message: Result, part: SessionPart = "segments") -> None:
        self._transport.put(session_key(message.station, message.session, part), encode(message))

    def program(self, message: Program) -> None:
        self._transport.put(station_key(message.station, "program"), encode(message))

    def relent(self, refusals: int, last: Snapshot) -> None:
        """Refuse so many questions, and then answer with this one."""
        eventually(lambda: self.refused >= refusals)
        self.snapshots, self.refusals = [last], {}

    def _run(self) -> None:
        while not self._over.is_set():
            question = self._inbox.get(TICK_S)
            if question is not None and not isinstance(question, ReceivedSample | TokenChange):
                with question:
                    self._answer(question)

    def _answer(self, question: IncomingQuery) -> None:
        self.asked.append(question.key)
        keys = [session_key(one.status.station, one.status.session, "snapshot") for one in self.snapshots]
        known = [(key, encode(one)) for key, one in zip(keys, self.snapshots, strict=True)]
        found = [(key, answer) for key, answer in known if intersect(question.key, key)]
        found += [(key, answer) for key, answer in self.answers.items() if intersect(question.key, key)]
        refusals = [refusal for key, refusal in self.refusals.items() if intersect(question.key, key)]
        for key, answer in found[1 if self.lost > 0 else 0 :]:
            question.reply(key, answer)
        self.lost -= 1
        for refusal in refusals:
            question.refuse(refusal)
            self.refused += 1
        if not refusals and not self.is_silent and requests_nothing_said(question.parameters):
            question.refuse(encode_error(nothing_found(self._instance, len(found))))
