"""Whoever says nothing is asked about: soon, and then less and less often."""

from __future__ import annotations

from itertools import pairwise

from caesura_clients.silent_session_refresh import LONGEST_PAUSE_S, LONGEST_S, RefreshBackoff, TimeShares
from harness.clock import Clock


def times_asked(until: float, *, answers: bool) -> list[float]:
    """When somebody is asked who said something at 0 s and never again."""
    clock, asked = Clock(), []
    silence: RefreshBackoff[str] = RefreshBackoff(2.0, clock)
    silence.reset("a")
    while clock.now < until:
        clock.now += 0.5
        for key in silence.due():
            asked.append(clock.now)
            (silence.back_off if answers else silence.retry_after_silence)(key)
    return asked


def test_who_answers_is_asked_ever_less_often():
    asked = times_asked(400.0, answers=True)
    assert asked[:5] == [2.0, 6.0, 14.0, 30.0, 62.0]
    assert {late - early for early, late in pairwise(asked[5:])} == {LONGEST_S}


def test_who_does_not_answer_is_asked_again_as_soon_as_at_first():
    assert times_asked(10.0, answers=False) == [2.0, 4.0, 6.0, 8.0, 10.0]


def test_what_was_received_is_waited_for_anew_and_who_has_ended_not_at_all():
    clock = Clock()
    silence: RefreshBackoff[str] = RefreshBackoff(2.0, clock)
    for key in "ab":
        silence.reset(key)
    clock.now = 1.5
    silence.reset("a")
    silence.remove("b")
    clock.now = 3.0
    assert silence.due() == []
    clock.now = 3.5
    assert silence.due() == ["a"]


def test_queries_of_one_key_take_a_share_of_the_time_and_hold_up_no_other():
    clock = Clock()
    shares: TimeShares[str] = TimeShares(0.2, clock)
    spent_s = 0.0
    while clock.now < 100.0:
        if shares.allows("a"):
            with shares.charged("a"):
                clock.now += 0.1
                spent_s += 0.1
            assert shares.allows("b")
        clock.now += 0.02
    assert 0.15 * clock.now < spent_s <= 0.2 * clock.now


def test_a_query_that_no_service_answered_does_not_keep_its_key_waiting():
    clock = Clock()
    shares: TimeShares[str] = TimeShares(0.2, clock)
    with shares.charged("a"):
        clock.now += 6.0
    assert not shares.allows("a")
    clock.now += LONGEST_PAUSE_S
    assert shares.allows("a")
