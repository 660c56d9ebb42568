"""Hints from the posterior, on a posterior that a test sets."""

from __future__ import annotations

from caesura_protocol.messages import Hint
from caesura_service.coaching import BoundaryCoach
from caesura_service.coaching.boundaries import LAG, LEAST, PAUSE, SHOWN, WINDOW


class FakePosterior:
    """Probabilities of a start, by observation."""

    def __init__(self) -> None:
        self.probabilities: dict[int, float] = {}
        self.count = 0

    def changepoint_probabilities(self, first: int, last: int, *, about: int | None = None) -> list[float]:
        return [self.probabilities.get(s, 0.0) for s in range(first, last + 1)]


def followed(
    changes: dict[int, dict[int, float]], count: int = 120, rest: range = range(0)
) -> tuple[Hint, ...]:
    """changes: after an observation, the probability of others; rest: steps; an observation each 0.1 s."""
    posterior, coach, places = FakePosterior(), BoundaryCoach(), []
    for k in range(count):
        places.append(0.1 * k)
        posterior.count = k + 1
        posterior.probabilities |= changes.get(k, {})
        coach.observe(posterior, 0.1 * k, places, rests=k in rest)
    return coach.log.hints


def test_a_boundary_that_is_sure_or_that_is_none_gives_no_hint():
    assert followed({20: {20: 0.9}, 50: {50: 0.1}}) == ()


def test_an_even_boundary_is_hinted_at_and_cleared_when_it_is_resolved():
    (hint,) = followed({20: {19: 0.2, 20: 0.3}, 30: {19: 0.1, 20: 0.85}})
    assert (hint.kind, hint.t0) == ("uncertain_boundary", 2.0)
    assert hint.since == 0.1 * (20 + LAG + 1)  # at the second observation at which it is unclear
    assert hint.until == 0.1 * (20 + LAG + LEAST)  # resolved before, and shown so long that it can be read


def test_where_the_arm_pauses_for_half_a_second_no_pause_is_advised():
    for rest in (range(20, 25), range(16, 21), range(18, 23)):
        assert followed({20: {20: 0.5}}, count=50, rest=rest) == ()
    for rest in (range(20, 24), range(21, 40), range(10, 20)):
        assert len(followed({20: {20: 0.5}}, count=50, rest=rest)) == 1


def test_a_boundary_that_resolves_with_the_next_observation_gives_no_hint():
    assert followed({20: {20: 0.5}, 20 + LAG + 1: {20: 0.9}}) == ()


def test_a_boundary_that_is_decided_in_the_end_asks_for_nothing():
    (hint,) = followed({20: {20: 0.5}, 40: {20: 0.25}})
    assert hint.kind == "uncertain_boundary"
    assert hint.until == 0.1 * (20 + WINDOW)  # three to one is no reason to show a part again


def test_each_unclear_boundary_has_a_hint_of_its_own():
    first, second = followed({20: {20: 0.5}, 50: {50: 0.5}, 70: {50: 0.9}}, count=80)
    assert second.t0 == 5.0
    assert second.until == 0.1 * 75
    assert first.advice == "Teach the part from 0.0 to 6.0 s again.", "the first one is followed on"
    assert first.until is None


def test_a_hint_stays_so_long_that_it_can_be_read():
    hints = followed({20: {20: 0.5}, 30: {20: 0.9}, 20 + LEAST: {20 + LEAST: 0.5}})
    assert [one.t0 for one in hints] == [2.0]


def test_a_boundary_that_stays_unclear_asks_for_its_part_from_the_last_sure_one():
    pause, *_ = followed({20: {20: 0.95}, 50: {50: 0.5}}, count=50 + WINDOW)
    (again,) = followed({20: {20: 0.95}, 50: {50: 0.5}}, count=200)
    out = 0.1 * (50 + WINDOW)  # when it leaves the window
    assert (pause.advice, again.advice) == (PAUSE, f"Teach the part from 2.0 to {out:.1f} s again.")
    assert (again.kind, again.since) == (pause.kind, pause.since), "one cause, one hint"
    assert (again.t0, again.tn, again.until) == (2.0, out, 0.1 * (50 + WINDOW + SHOWN))


def test_of_two_parts_that_are_to_be_shown_again_the_newer_one_is_asked_for():
    first, second = followed({20: {20: 0.5}, 50: {50: 0.5}}, count=50 + WINDOW + 1)
    assert (first.until, second.until) == (0.1 * (50 + WINDOW), None)
    assert "again" in second.advice
