"""A station that asks without end, or whose token comes and goes: the others do not notice it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key, session_key, station_key, with_nothing_said
from caesura_protocol.messages import Message, Program, ServiceStatus
from caesura_protocol.token_bucket import Rate
from caesura_protocol.transport.inbox import IncomingQuery, TokenChange
from caesura_protocol.transport.memory import MemoryNetwork, MemoryQuestion, intersect
from caesura_protocol.transport.transport_interface import NOTHING
from caesura_service.app import Service
from caesura_service.server import query_server
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import Arrival, LivelinessChanged
from caesura_service.server.live_tokens import TokenChanges
from caesura_service.server.memory_network import in_memory
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.station_manager import StationManager
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from harness.attacker import until_accepted
from harness.clock import Clock
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import DEADLINE_S, MemoryPeer
from harness.sessions import opening

HOSTILE = "hostile"
SLOW_S = 0.25  # that an answer to the hostile station takes
TOGGLES = 5000
OWN = (station_key(HOSTILE, "program"), session_key(HOSTILE, "*", "snapshot"))
OTHERS = (
    station_key("cell-1", "program"),
    session_key("cell-1", "s1", "snapshot"),
    station_key("*", "program"),
    service_key("test-1", "status"),
)


def ask(network: MemoryNetwork, key: str, parameters: str = "") -> MemoryQuestion:
    """A query whose answer is not waited for."""
    question = MemoryQuestion(key, parameters, None)
    (inbox,) = [inbox for known, inbox in network.queryables if intersect(known, key)]
    inbox.offer(question)
    return question


@pytest.fixture
def slow_answers(monkeypatch) -> Iterator[list[str]]:
    """Answers to the hostile station take SLOW_S; the keys of those that were sent."""
    sent: list[str] = []
    over = threading.Event()
    reply_message = query_server.reply_message

    def reply(query: IncomingQuery, key: str, message: Message) -> None:
        if HOSTILE in query.key:
            over.wait(SLOW_S)
        sent.append(query.key)
        return reply_message(query, key, message)

    monkeypatch.setattr(query_server, "reply_message", reply)
    yield sent
    over.set()


@pytest.mark.parametrize("flood", OWN)
def test_a_flood_of_one_stations_queries_keeps_no_other_query_from_its_answer(
    service, network, peer, slow_answers, flood
):
    peer.command(opening(), HOSTILE)
    peer.command(opening(), "cell-1")
    asked = [ask(network, flood) for _ in range(1500)]
    for key in OTHERS:
        question = ask(network, key)
        assert question.ended.wait(DEADLINE_S)
        assert question.replies, (key, question.refusals)
    assert slow_answers.count(flood) <= 2 * len(OTHERS), "they take turns"
    refused = [one for one in asked if one.refusals]
    assert "too many queries of hostile are waiting" in str(refused[0].refusals[0])
    assert peer.command(opening(), "cell-1").state == "open"


def test_stored_sessions_are_asked_for_in_lanes_too(service, network, peer, monkeypatch):
    begun, gate = threading.Event(), threading.Event()
    page = service.registry.stored.page

    def slow(*given):
        begun.set()
        gate.wait(DEADLINE_S)
        return page(*given)

    monkeypatch.setattr(service.registry.stored, "page", slow)
    for _ in range(200):
        ask(network, session_key(HOSTILE, "*", "snapshot"), "stored=16")
    assert begun.wait(DEADLINE_S)
    other = ask(network, session_key("cell-1", "*", "snapshot"), with_nothing_said("stored=16"))
    after = ask(network, session_key("cell-1", "*", "snapshot"))
    assert after.ended.wait(DEADLINE_S), "the queries before it are enqueued or refused"
    gate.set()
    assert other.ended.wait(DEADLINE_S)
    assert [refusal.code for refusal in other.refusals] == [NOTHING]


def test_the_queries_of_each_station_have_a_rate_of_their_own(config, network):
    rates = RateLimits(queries=Rate(0.001, 20.0))
    with serving(replace(config, rates=rates), network) as peer:
        peer.command(opening(), HOSTILE)
        peer.command(opening(), "cell-1")
        for _ in range(20):
            peer.ask(station_key(HOSTILE, "program"), Program)
        with pytest.raises(ProtocolError, match="hostile has used up its budget of queries: 20 of 20"):
            peer.ask(station_key(HOSTILE, "program"), Program)
        assert peer.ask(station_key("cell-1", "program"), Program)
        assert peer.ask(station_key("*", "program"), Program).keys() >= {station_key("cell-1", "program")}
        used = {one.station: one.queries for one in peer.service_status().budgets}
        assert (used[HOSTILE].refused, used["cell-1"].refused) == (1, 0)
        assert used["cell-1"].used == pytest.approx(1.0, abs=0.1)


@contextmanager
def serving(config, network: MemoryNetwork) -> Iterator[MemoryPeer]:
    with (
        Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        yield peer


def refused(status: ServiceStatus) -> int:
    """Tokens of the hostile station."""
    return sum(one.tokens.refused for one in status.budgets if one.station == HOSTILE)


def test_a_token_that_comes_and_goes_delays_no_other_station_and_its_last_state_holds(
    config, network, monkeypatch
):
    begun, gate, handled = threading.Event(), threading.Event(), []
    handle = StationManager.handle_event

    def slow(self, event):
        if isinstance(event, LivelinessChanged) and event.name == HOSTILE and self._me == "test-1":
            begun.set()
            gate.wait(DEADLINE_S)
            handled.append(event.alive)
        handle(self, event)

    monkeypatch.setattr(StationManager, "handle_event", slow)
    config = replace(config, rates=RateLimits(tokens=Rate(1.0, 4.0)))
    with serving(config, network) as peer, serving(replace(config, instance="test-2"), network):
        for _ in range(TOGGLES):
            with peer.transport.declare_token(station_key(HOSTILE, "alive")):
                pass
        with peer.transport.declare_token(station_key(HOSTILE, "alive")):
            assert begun.wait(DEADLINE_S)
            gate.set()
            with peer.transport.declare_token(station_key("cell-1", "alive")):
                until_accepted(lambda: peer.command(opening(), "cell-1"))
            # others are counted, by the status that is published next
            status = peer.until_service(
                lambda status: handled[-1:] == [True] and refused(status) > TOGGLES / 5
            )
            assert len(handled) < 100, "only its last state is processed"
        assert not status.overloaded
        peer.until_service(lambda _: handled[-1] is False)


def test_an_instance_that_is_alone_watches_no_tokens_of_stations(config, network):
    def watched() -> bool:
        return station_key("*", "alive") in {key for key, _ in network.watchers}

    with serving(config, network) as peer:
        assert not watched()
        with serving(replace(config, instance="test-2"), network):
            assert watched()
        peer.until_service(lambda _: not watched())


class Given:
    """A network whose changes of tokens are given."""

    def __init__(self) -> None:
        self.changes: deque[TokenChange] = deque()

    def watch_liveliness(self, key: str) -> Given:
        return self

    def try_recv(self) -> TokenChange | None:
        return self.changes.popleft() if self.changes else None

    def undeclare(self) -> None: ...

    def toggle(self, *states: bool, station: str = HOSTILE) -> None:
        self.changes += [TokenChange(station_key(station, "alive"), alive) for alive in states]


def changes(rate: Rate, settings: QueueSettings | None = None):
    clock, given = Clock(), Given()
    queue: WorkQueue[Arrival] = WorkQueue(settings or QueueSettings())
    budgets = Budgets(RateLimits(tokens=rate), clock=clock)
    held = TokenChanges(queue, budgets)
    held.watch(given, station_key("*", "alive"))
    return held, given, queue, budgets, clock


def test_of_a_token_beyond_its_budget_the_last_state_waits_for_it():
    held, given, queue, budgets, clock = changes(Rate(1.0, 2.0))
    for alive in (True, False, True, False, True):
        given.toggle(alive)
        held.poll()
    given.toggle(False, True)
    given.toggle(True, station="cell-1")
    held.poll()
    assert [queue.get(0.0) for _ in range(4)] == [
        LivelinessChanged("station", HOSTILE, True),
        LivelinessChanged("station", "cell-1", True),
        LivelinessChanged("station", HOSTILE, False),
        None,
    ]
    assert budgets.budgets_of(HOSTILE).tokens.refused == 4
    clock.now = 1.5
    held.poll()
    assert queue.get(0.0) == LivelinessChanged("station", HOSTILE, True)
    clock.now = 100.0
    held.poll()
    assert queue.get(0.0) is None


def test_a_token_waits_where_the_queue_has_no_room_and_is_not_lost():
    held, given, queue, _, _ = changes(Rate(1.0, 20.0), QueueSettings(commands=1))
    assert queue.put_command(LivelinessChanged("station", HOSTILE, True), HOSTILE)
    given.toggle(True, False)
    held.poll()
    queue.get(0.0)
    assert queue.get(0.0) is None
    held.poll()
    assert queue.get(0.0) == LivelinessChanged("station", HOSTILE, False)


def test_a_token_that_is_lost_and_back_between_two_looks_costs_its_station_nothing():
    held, given, queue, budgets, _ = changes(Rate(1.0, 20.0))
    given.toggle(False, True, station="cell-1")
    held.poll()
    assert (queue.get(0.0), queue.get(0.0)) == (LivelinessChanged("station", "cell-1", True), None)
    assert budgets.budgets_of("cell-1").tokens.refused == 0
