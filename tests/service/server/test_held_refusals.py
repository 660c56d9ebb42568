"""A refused list of stored sessions ends late, so that a client which asks again at once is slowed down."""

from __future__ import annotations

import itertools
from dataclasses import replace

from caesura_protocol.codec import Encoded
from caesura_protocol.keys import session_key, station_key
from caesura_protocol.token_bucket import Rate
from caesura_protocol.transport.memory import MemoryQuestion
from caesura_service.app import Service
from caesura_service.server import held_refusals, query_server
from caesura_service.server.held_refusals import HELD, HELD_S, HeldRefusals
from caesura_service.server.memory_network import in_memory
from caesura_service.server.rate_limit_settings import RateLimits
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import DEADLINE_S, MemoryPeer
from harness.sessions import opening
from service.server.test_floods import Clock, ask

KEY = session_key("*", "*", "snapshot")
LISTS, ACCEPTED, EXPLAINED = 200, 40, 20


def ended(queries: list[MemoryQuestion]) -> list[bool]:
    return [one.ended.is_set() for one in queries]


def test_each_query_ends_a_while_after_it_came():
    clock = Clock()
    held, queries = HeldRefusals(clock), [MemoryQuestion(KEY, "", None) for _ in range(3)]
    for clock.now, query in zip((0.0, 0.3, 0.6), queries, strict=True):
        held.hold(query)
        held.end_due()
    assert ended(queries) == [True, False, False]
    clock.now = 0.3 + HELD_S
    held.end_due()
    assert ended(queries) == [True, True, False]
    held.end_all()
    assert ended(queries) == [True, True, True]


def test_of_too_many_the_oldest_ends_and_a_large_one_is_not_kept():
    held, queries = HeldRefusals(Clock()), [MemoryQuestion(KEY, "", None) for _ in range(HELD + 1)]
    large = MemoryQuestion(KEY, "", Encoded(bytes(query_server.QUERY_BYTES + 1), "x"))
    for query in (*queries, large):
        held.hold(query)
    assert ended(queries) == [True, *itertools.repeat(False, HELD)]
    assert large.ended.is_set()


def test_lists_beyond_the_refusals_with_a_reason_are_held_and_end_with_the_service(
    config, network, monkeypatch
):
    """Queries for the program end at once."""
    monkeypatch.setattr(held_refusals, "HELD_S", DEADLINE_S)
    monkeypatch.setattr(query_server, "REFUSAL_RATE", Rate(0.001, EXPLAINED))
    few = replace(config, rates=RateLimits(queries=Rate(0.001, ACCEPTED)))
    with (
        Service(few, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        peer.command(opening(), "cell-1")
        lists = [ask(network, session_key("cell-1", "*", "snapshot"), "stored=16") for _ in range(LISTS)]
        programs = [ask(network, station_key("cell-1", "program")) for _ in range(LISTS)]
        assert all(one.ended.wait(DEADLINE_S) for one in programs)
        refused = lists[ACCEPTED + EXPLAINED :]
        assert not any(one.refusals or one.ended.is_set() for one in refused)
    assert all(ended(lists))
