"""Token buckets, and what a sender meets that comes too often."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ROOT, session_key, station_key
from caesura_protocol.messages import (
    MAX_BUDGETS,
    Budget,
    Control,
    Edit,
    Insert,
    Preview,
    Program,
    SessionStatus,
)
from caesura_protocol.token_bucket import SENDERS, Rate, RateLimit
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server import query_server
from caesura_service.server.budgets import Budgets
from caesura_service.server.memory_network import in_memory
from caesura_service.server.muted_sources import MUTED_S, MutedSources
from caesura_service.server.rate_limit_settings import RateLimits
from harness.clock import Clock
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import MemoryPeer
from harness.sessions import batches, heartbeat, opening

FEW = Rate(0.001, 20.0)
TIGHT = RateLimits(samples=FEW, commands=FEW)


def limited(rate: Rate, senders: int = 8) -> tuple[RateLimit, Clock]:
    clock = Clock()
    return RateLimit(rate, senders=senders, clock=clock), clock


def test_a_burst_is_let_through_and_then_as_much_as_flows_in():
    limit, clock = limited(Rate(10.0, 5.0))
    assert [limit.allows("a") for _ in range(7)] == [True] * 5 + [False] * 2
    clock.now = 0.25
    assert [limit.allows("a") for _ in range(3)] == [True, True, False]
    clock.now = 1000.0
    assert sum(limit.allows("a") for _ in range(100)) == 5


def test_what_costs_more_than_is_left_takes_nothing():
    limit, _ = limited(Rate(10.0, 5.0))
    assert [limit.allows("a", cost) for cost in (3.0, 3.0, 2.0, 1.0)] == [True, False, True, False]


def test_of_several_rates_each_must_have_enough_and_a_refusal_takes_of_none():
    clock = Clock()
    limit = RateLimit(Rate(1.0, 3.0), Rate(10.0, 10.0), clock=clock)
    sizes = (6.0, 6.0, 4.0, 0.0, 0.0)
    assert [limit.allows("a", 1.0, size) for size in sizes] == [True, False, True, True, False]
    clock.now = 0.5
    assert not limit.allows("a", 1.0, 5.0)
    clock.now = 1.0
    assert limit.allows("a", 1.0, 10.0)


def test_one_sender_takes_nothing_from_another():
    limit, _ = limited(Rate(10.0, 5.0))
    while limit.allows("loud"):
        pass
    assert limit.allows("quiet")


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=200))
def test_never_more_than_the_burst_and_what_flows_in(steps):
    limit, clock = limited(Rate(10.0, 5.0))
    allowed = 0
    for step in steps:
        clock.now += step
        allowed += limit.allows("a")
    assert allowed <= 5.0 + 10.0 * clock.now + 1e-6


def test_new_names_do_not_fill_the_memory_nor_give_new_bursts():
    limit, clock = limited(Rate(10.0, 5.0), senders=3)
    assert [limit.allows(name) for name in "abcd"] == [True, True, True, False]
    clock.now = 0.05  # nobody's bucket is full again
    assert not limit.allows("d")
    clock.now = 0.2  # all are
    assert limit.allows("d")
    assert len(limit._buckets) == 3


@contextmanager
def serving(rates: RateLimits) -> Iterator[MemoryPeer]:
    config = ServiceConfig(instance="test-1", preset="fake", rates=rates)
    network = MemoryNetwork()
    with (
        Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)),
        MemoryPeer(network) as peer,
    ):
        yield peer


@pytest.fixture
def tight() -> Iterator[MemoryPeer]:
    with serving(TIGHT) as peer:
        yield peer


def test_samples_above_the_rate_are_dropped_and_counted_for_their_station_alone(tight, caplog):
    tight.command(opening("s1"))
    tight.command(opening("s2"), "cell-2")
    with tight.listening(session_key("cell-1", "s1", "status")) as received:
        for message in batches(60):
            tight.send(message)
        tight.send(batches(1, "s2")[0], "cell-2")
        received.until(SessionStatus, lambda status: status.dropped > 0)
        assert tight.until_service(lambda status: status.dropped == 40).refused == {}
    assert tight.snapshot("s2", "cell-2").status.dropped == 0
    (line,) = (
        record.getMessage() for record in caplog.records if "budget of messages" in record.getMessage()
    )
    assert "cell-1" in line


def test_a_flood_on_keys_that_name_no_station_is_one_senders_and_breaks_nothing(tight, caplog):
    tight.command(opening("s1"))
    for name in ("..", "A", "a b", "é", "x" * 65):
        for _ in range(10):
            tight.put(f"{ROOT}/station/{name}/samples", b"x", "zenoh/bytes")
            assert not tight.get(f"{ROOT}/station/{name}/control").replies
    assert tight.until_service(lambda status: status.dropped == 30).refused["malformed"] >= 20
    assert tight.command(opening("s1")).state == "open"
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_what_was_above_the_rate_is_asked_for_again():
    sent = batches(60)
    slow = Rate(5.0, 20.0)  # eight seconds pass until 60 messages are within it
    with serving(RateLimits(samples=slow)) as peer, peer.replaying(sent):
        peer.command(opening("s1"))
        for message in sent:
            peer.send(message)
        peer.until_service(lambda status: status.dropped > 0)

        def everything_is_there(_: object) -> bool:
            peer.send(heartbeat(59))
            return peer.snapshot().status.samples == sum(message.n for message in sent)

        peer.until_service(everything_is_there)
        assert peer.snapshot().status.gaps == ()


def test_bytes_above_the_rate_are_dropped_and_counted():
    with serving(RateLimits(bytes=Rate(0.001, 5000.0))) as peer:
        peer.command(opening("s1"))
        for size in (4000, 4000, 1001):
            peer.put(station_key("cell-1", "samples"), bytes(size), "zenoh/bytes")
        peer.until_service(lambda status: status.dropped == 2 and sum(status.refused.values()) == 1)


def test_commands_above_the_rate_are_refused_to_the_station_that_sends_them(tight):
    for _ in range(20):
        tight.command(opening("s1"))
    with pytest.raises(ProtocolError, match="cell-1 has used up its budget of commands: 20 of 20") as refused:
        tight.command(opening("s1"))
    assert refused.value.limit == TIGHT.commands.burst
    assert tight.command(opening("s2"), "cell-2").state == "open"


def test_of_many_commands_above_the_rate_some_are_refused_with_a_reason_and_all_are_counted(monkeypatch):
    monkeypatch.setattr(query_server, "REFUSAL_RATE", Rate(0.001, 5.0))
    with serving(TIGHT) as peer:
        key, (payload, encoding) = station_key("cell-1", "control"), encode(Control(command=opening("s1")))
        replies = [peer.get(key, payload, encoding) for _ in range(100)]
        assert [len(one.replies) for one in replies] == [1] * 20 + [0] * 80
        assert [len(one.refusals) for one in replies] == [0] * 20 + [1] * 5 + [0] * 75
        status = peer.until_service(lambda status: status.refused.get("overloaded") == 80)
        (budgets,) = status.budgets
        assert budgets.commands.refused == 80


def test_a_muted_source_is_dropped_unread_for_a_moment_and_alone():
    clock = Clock()
    muted = MutedSources(clock)
    assert not muted.drops("a")
    muted.mute("a")
    assert [muted.drops(source) for source in ("a", "b", "a")] == [True, False, True]
    assert (muted.pop_drops(), muted.pop_drops()) == ({"a": 2}, {})
    clock.now = MUTED_S
    assert not muted.drops("a")
    for number in range(2 * SENDERS):
        muted.mute(f"source-{number}")
    assert sum(muted.drops(f"source-{number}") for number in range(2 * SENDERS)) == SENDERS


def test_questions_above_the_rate_are_refused():
    with serving(RateLimits(queries=FEW)) as peer:
        for _ in range(20):
            peer.ask(station_key("*", "program"), Program)
        (refusal,) = peer.get(station_key("*", "program")).refusals
        stated = peer.service_status()
    assert "what names no station has used up its budget of queries" in str(refusal)
    assert stated.budgets == ()
    assert (stated.queries.at_once, stated.queries.refused) == (20.0, 1)


def test_a_heartbeat_counts_as_a_message(tight):
    tight.command(opening("s1"))
    for _ in range(25):
        tight.send(heartbeat(-1))
    assert tight.until_service(lambda status: status.dropped == 5).dropped == 5


def test_work_is_paid_for_afterwards_and_comes_back_with_time():
    now = [0.0]
    budget = RateLimit(Rate(0.5, 2.0), clock=lambda: now[0])
    assert not budget.is_spent("a"), "nothing is known of it"
    budget.charge("a", 1.0)
    assert not budget.is_spent("a")
    budget.charge("a", 3.0)
    assert budget.is_spent("a")
    assert not budget.is_spent("b")
    now[0] = 4.1
    assert not budget.is_spent("a")
    now[0] = 1000.0
    budget.charge("a", 1.9)
    assert not budget.is_spent("a"), "never more than the burst, and no less"
    assert budget.used("a") == [pytest.approx(1.9)]


def test_so_many_stations_are_remembered_and_no_more():
    budget = RateLimit(Rate(0.5, 1.0), senders=2)
    for station in ("a", "b", "c"):
        budget.charge(station, 5.0)
    assert [budget.is_spent(station) for station in "abc"] == [False, True, True]


def test_what_a_station_has_used_and_what_was_refused_for_it_is_known_by_budget():
    clock = Clock()
    budgets = Budgets(
        RateLimits(samples=Rate(10.0, 4.0), commands=Rate(1.0, 2.0), work=Rate(0.5, 2.0)), clock=clock
    )
    assert [budgets.reject_put("a", 100) is None for _ in range(6)] == [True] * 4 + [False] * 2
    assert [budgets.reject_command("b") is None for _ in range(3)] == [True, True, False]
    budgets.charge_work("c", 3.0)
    assert budgets.reject_put("c", 1).value == 3.0
    first = budgets.budgets_of("a")
    assert (first.messages, first.bytes.used) == (Budget(per_s=10.0, at_once=4.0, used=4.0, refused=2), 400.0)
    clock.now = 0.1
    assert budgets.budgets_of("a").messages.used == pytest.approx(3.0)
    assert budgets.budgets_of("b").commands == Budget(per_s=1.0, at_once=2.0, used=1.9, refused=1)
    assert (budgets.budgets_of("c").work.used, budgets.budgets_of("c").work.refused) == (
        pytest.approx(2.95),
        1,
    )
    assert [one.station for one in budgets.busiest()] == ["c", "b", "a"], "nearest to a limit first"
    assert budgets.budgets_of("d").work == Budget(per_s=0.5, at_once=2.0, used=0.0, refused=0)


def test_previews_have_a_budget_of_their_own():
    budgets = Budgets(RateLimits(previews=Rate(0.5, 2.0), work=Rate(0.5, 2.0)), clock=Clock())
    assert budgets.reject_preview("a") is None
    budgets.charge_preview("a", 2.5)
    assert (refusal := budgets.reject_preview("a")) is not None
    assert "budget of previews: 2.5 of 2 s of the worker's time" in refusal.message
    assert budgets.reject_command("a") is None
    assert budgets.reject_put("a", 1) is None
    known = budgets.budgets_of("a")
    assert (known.previews, known.work.used) == (Budget(per_s=0.5, at_once=2.0, used=2.5, refused=1), 0.0)


def test_a_station_whose_previews_are_used_up_is_edited_and_taught_as_before(config, network, monkeypatch):
    charged: list[str] = []
    for name in ("charge_work", "charge_preview"):
        charge = getattr(Budgets, name)

        def noted(self, station, seconds, name=name, charge=charge):
            charged.append(name)
            charge(self, station, seconds)

        monkeypatch.setattr(Budgets, name, noted)
    rates = RateLimits(previews=Rate(1e-9, 1e-9))
    fake = {"pipeline_factory": make_fake_pipeline, "join": in_memory(network)}
    with Service(replace(config, rates=rates), **fake), MemoryPeer(network) as peer:
        peer.command(opening("s1"))
        for message in batches(5, "s1"):
            peer.send(message)
        action = Insert(t=0.5)
        asked = Preview(session="s1", revision=0, action=action)
        assert peer.command(asked).effect is not None
        peer.command(opening("s1"))  # the worker has charged what it did before
        done = charged.count("charge_preview")
        with pytest.raises(ProtocolError, match="budget of previews"):
            peer.command(asked)
        assert peer.command(Edit(session="s1", revision=0, author="a", action=action)).revision == 1
        assert charged.count("charge_preview") == done > 0, "a refused one is no preview"
        budgets = peer.snapshot("s1").status.budgets
        assert (budgets.previews.refused, budgets.work.refused, budgets.commands.refused) == (1, 0, 0)


def test_a_list_of_busy_stations_has_a_bound_and_no_names_that_are_none():
    budgets = Budgets(RateLimits(), clock=Clock())
    for number in range(100):
        budgets.reject_put(f"cell-{number}", 10 * number)
    budgets.reject_put("?", 1_000_000)
    listed = budgets.busiest()
    assert len(listed) == MAX_BUDGETS
    assert "?" not in {one.station for one in listed}


def test_the_status_of_service_and_session_say_what_a_station_may_use_and_has_used(tight):
    tight.command(opening("s1"))
    for message in batches(30):
        tight.send(message)
    status = tight.until_service(lambda status: any(one.messages.refused >= 10 for one in status.budgets))
    (station,) = status.budgets
    assert (station.station, station.messages.at_once, station.messages.refused) == ("cell-1", 20.0, 10)
    shown = tight.snapshot("s1").status.budgets
    assert (shown.messages.refused, shown.commands.used) == (10, pytest.approx(1.0, abs=0.1))
