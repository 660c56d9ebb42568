"""Takeovers in turns: the one that has taken least time is continued."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from types import SimpleNamespace
from typing import Any, cast

import pytest

from caesura_service.cooperative_scheduler import SLICE_S, Slices, give_way
from caesura_service.ownership.takeovers_in_turns import TakeoversInTurns
from caesura_service.server.station_manager import StationManager
from caesura_service.server.worker import Worker
from harness.clock import Clock


def lasting(clock: Clock, *records_s: float) -> Iterator[list[object]]:
    for record_s in records_s:
        clock.now += record_s
        yield []


def test_a_short_takeover_is_done_while_a_long_one_that_began_before_goes_on():
    clock = Clock()
    turns = TakeoversInTurns(clock)
    turns.begin("long", lasting(clock, *100 * [1.0]))
    turns.begin("short", lasting(clock, 0.1, 0.1, 0.1))
    while "short" in turns.stations:
        turns.step(turns.next_station())
    assert clock.now == pytest.approx(1.3)
    assert "long" in turns.stations


def test_of_two_that_are_as_long_neither_takes_more_than_a_record_more():
    clock = Clock()
    turns = TakeoversInTurns(clock)
    for station in ("dense", "usual"):
        turns.begin(station, lasting(clock, *(10 * [1.0] if station == "dense" else 100 * [0.1])))
    while len(turns.stations) == 2:
        turns.step(turns.next_station())
    assert clock.now > 18.0


def test_one_that_fails_ends_and_the_others_go_on():
    def failing() -> Iterator[list[object]]:
        raise OSError("no disk")
        yield []

    clock = Clock()
    turns = TakeoversInTurns(clock)
    turns.begin("a", failing())
    turns.begin("b", lasting(clock, 1.0))
    with pytest.raises(OSError, match="no disk"):
        turns.step("a")
    assert [*turns.stations] == ["b"]
    assert turns.step("b") == []
    assert turns.step("b") is None
    assert not turns


def test_what_is_not_complete_in_its_time_goes_on_later():
    clock = Clock()
    turns = TakeoversInTurns(clock)
    turns.begin("long", lasting(clock, *100 * [1.0]))
    turns.begin("short", lasting(clock, 0.1))
    assert turns.complete(5.0) == []
    assert ([*turns.stations], clock.now) == (["long"], pytest.approx(5.1))
    assert turns.complete() == []
    assert (bool(turns), clock.now) == (False, pytest.approx(100.1))


def test_one_that_is_given_up_is_closed():
    clock, closed = Clock(), []

    def closing() -> Iterator[list[object]]:
        try:
            yield []
            yield []
        finally:
            closed.append(True)

    turns = TakeoversInTurns(clock)
    turns.begin("a", closing())
    turns.step("a")
    turns.cancel("c")
    turns.cancel("a")
    assert (closed, bool(turns)) == ([True], False)


# --- within a record

LONG_S = 40 * SLICE_S


def slow_takeover(log: list[str], name: str, records: int, lasts_s: float = 0.0) -> Iterator[list[str]]:
    """One whose records each last so long, and give way within."""
    try:
        for _ in range(records):
            until = perf_counter() + lasts_s
            while perf_counter() < until:
                give_way()
            log.append(name)
            yield [name]
    finally:
        log.append(f"{name} ends")


def run_all(turns: TakeoversInTurns) -> list[str]:
    given = []
    while turns:
        given += turns.step(turns.next_station()) or []
    return given


def test_a_long_record_of_one_station_gives_way_to_the_takeovers_of_others():
    turns, log = TakeoversInTurns(), []
    turns.begin("long", slow_takeover(log, "long", 1, LONG_S))
    turns.begin("short", slow_takeover(log, "short", 20))
    assert sorted(run_all(turns)) == ["long"] + 20 * ["short"]
    assert log.index("short ends") < log.index("long")


def test_a_step_lasts_for_a_slice_and_not_for_a_record():
    turns, log = TakeoversInTurns(), []
    turns.begin("long", slow_takeover(log, "long", 1, LONG_S))
    assert turns.step("long") == []
    assert (log, [*turns.stations]) == ([], ["long"])


def test_a_takeover_that_is_given_up_within_a_record_ends_with_it():
    turns, log = TakeoversInTurns(), []
    turns.begin("long", slow_takeover(log, "long", 1, LONG_S))
    turns.step("long")
    turns.cancel("long")
    assert (log, bool(turns)) == (["long", "long ends"], False)
    turns.begin("long", slow_takeover(log, "long", 1))
    assert run_all(turns) == ["long"]


def test_what_a_long_record_raises_ends_its_takeover_alone():
    def failing() -> Iterator[list[str]]:
        until = perf_counter() + LONG_S
        while perf_counter() < until:
            give_way()
        raise OSError("unreadable")
        yield []

    turns, log = TakeoversInTurns(), []
    turns.begin("bad", failing())
    turns.begin("good", slow_takeover(log, "good", 3))
    with pytest.raises(OSError, match="unreadable"):
        run_all(turns)
    assert run_all(turns) == []
    assert log.count("good") == 3


def test_all_are_completed_at_once_also_one_that_is_within_a_record():
    turns, log = TakeoversInTurns(), []
    turns.begin("long", slow_takeover(log, "long", 2, LONG_S))
    turns.begin("short", slow_takeover(log, "short", 3))
    turns.step("long")
    assert turns.complete() == []
    assert (log.count("long"), log.count("short"), bool(turns)) == (2, 3, False)


def test_a_service_that_ends_within_a_record_abandons_it():
    """What a record had open stayed open: its stack belonged to a thread that had ended."""
    turns, slices, log = TakeoversInTurns(), Slices(), []
    turns.begin("long", slow_takeover(log, "long", 1, LONG_S))
    turns.begin("next", slow_takeover(log, "next", 2))
    turns.step("next")
    assert slices.begin("/taking", lambda: turns.step("long"))  # as the worker runs it
    manager = StationManager(cast("Any", None), "i1", lambda _: None, perf_counter)
    manager._takeovers = turns
    registry, queue = SimpleNamespace(slices=slices), SimpleNamespace(wake=lambda: None)
    unused: Any = None
    worker = Worker(cast("Any", registry), manager, cast("Any", queue), unused, unused, perf_counter)
    worker._stopped.set()
    worker._run()
    assert (log, bool(turns)) == (["next", "long ends", "next ends"], False)
