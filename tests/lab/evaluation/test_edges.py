"""What counts near the window's edges, and points with two accepted times."""

from __future__ import annotations

import math

import pytest

from caesura_lab.evaluation.scoring.metrics import TimedEstimate, match
from caesura_lab.evaluation.scoring.score import FoundSegment, FoundSegmentation, Score, score
from caesura_lab.ground_truth import ToleranceOptions, TrueChangepoint, TrueSegment, Truth

WINDOW = (0.0, 10.0)
RELEASE = TrueChangepoint(6.0, 0.1, kind="contact_off", t_alt=5.5)


def judged(points: list[TrueChangepoint], times: list[float], **also: object) -> Score:
    return score("mine", Truth("one", WINDOW, tuple(points)), FoundSegmentation(tuple(times), **also))  # type: ignore[arg-type]


def counts(points: list[TrueChangepoint], times: list[float]) -> tuple[int, int, int]:
    one = judged(points, times)
    return one.hits, one.false_alarms, one.misses


@pytest.mark.parametrize(("t", "alarms"), [(0.1, 0), (0.29, 0), (0.3, 1), (9.7, 1), (9.71, 0), (9.95, 0)])
def test_a_changepoint_at_the_windows_edge_is_excused_within_the_margin_only(t: float, alarms: int):
    assert counts([], [t]) == (0, alarms, 0)


@pytest.mark.parametrize("t", [0.1, 9.9])
def test_a_true_point_at_the_windows_edge_is_neither_missed_nor_found(t: float):
    assert counts([TrueChangepoint(t, 0.15)], []) == (0, 0, 0)
    assert counts([TrueChangepoint(t, 0.15)], [t]) == (0, 0, 0)


def test_a_true_point_at_the_margin_must_be_found():
    assert counts([TrueChangepoint(0.3, 0.15)], []) == (0, 0, 1)
    assert counts([TrueChangepoint(0.3, 0.15)], [0.4]) == (1, 0, 0)


def test_a_changepoint_in_the_margin_still_finds_a_point_that_counts():
    assert counts([TrueChangepoint(0.35, 0.15)], [0.25]) == (1, 0, 0)


def test_a_true_point_in_the_margin_excuses_a_changepoint_within_its_tolerance_outside_of_it():
    assert counts([TrueChangepoint(0.25, 0.15)], [0.38]) == (0, 0, 0)
    assert counts([TrueChangepoint(0.25, 0.15)], [0.45]) == (0, 1, 0)


def test_slack_lets_a_changepoint_outside_of_the_window_find_a_point_inside_of_it():
    truth = ToleranceOptions(slack_s=0.2).apply_to(Truth("one", WINDOW, (TrueChangepoint(0.31, 0.15),)))
    assert score("mine", truth, FoundSegmentation((-0.02,))).hits == 1
    assert score("mine", truth, FoundSegmentation((-0.1,))).false_alarms == 0


@pytest.mark.parametrize(("t", "offset_s"), [(6.05, 0.05), (5.95, -0.05), (5.42, -0.08), (5.59, 0.09)])
def test_either_end_of_an_edge_is_accepted_and_the_nearer_gives_the_offset(t: float, offset_s: float):
    one = judged([RELEASE], [t])
    assert (one.hits, one.false_alarms, one.misses) == (1, 0, 0)
    assert one.found[0].offset_s == pytest.approx(offset_s)


def test_between_the_ends_further_than_the_tolerance_from_both_nothing_is_accepted():
    assert counts([RELEASE], [5.75]) == (0, 1, 1)


def test_a_point_with_two_times_takes_one_changepoint():
    assert counts([RELEASE], [5.5, 6.0]) == (1, 1, 0)


def test_pairing_takes_the_nearer_end_of_every_point():
    matching = match([6.0, 7.0], [0.3, 0.3], [False, False], [5.5, 6.2], [5.5, math.nan])
    assert matching.partner.tolist() == [0, -1]
    matching = match([6.0, 6.3], [0.3, 0.3], [False, False], [5.5, 6.1], [5.5, math.nan])
    assert matching.partner.tolist() == [0, 1]


def test_delays_and_intervals_are_from_the_nearer_end():
    timed_estimates = (TimedEstimate(5.9, (5.52,), (False,)), TimedEstimate(7.0, (5.52,), (True,)))
    one = judged([RELEASE], [5.52], timed_estimates=timed_estimates, intervals={5.52: (5.4, 5.6)})
    assert one.provisional_s == pytest.approx([0.4])
    assert one.final_s == pytest.approx([1.5])
    assert one.intervals == (pytest.approx((0.2, True)),)


def test_a_changepoint_that_moves_from_one_end_to_the_other_stands_all_the_while():
    timed_estimates = (TimedEstimate(6.0, (5.5,), (False,)), TimedEstimate(6.4, (6.0,), (False,)))
    assert judged([RELEASE], [6.0], timed_estimates=timed_estimates).provisional_s == pytest.approx([0.0])


def test_no_class_is_scored_between_the_ends_of_an_edge():
    spans = (TrueSegment(0, 6, "contact"), TrueSegment(6, 10, "motion"))
    parts = (FoundSegment(0, 5.5, "contact"), FoundSegment(5.5, 10, "motion"))
    one = score("mine", Truth("one", WINDOW, (RELEASE,), spans), FoundSegmentation((5.5,), parts))
    assert dict(one.confusion) == {("contact", "contact"): 5.5, ("motion", "motion"): 4.0}
    assert sum(one.confusion_inside.values()) == pytest.approx(5.4 + 3.9)


def test_a_perfect_answer_at_the_other_end_covers_all():
    assert judged([RELEASE], [5.5]).covering == pytest.approx(1.0)
