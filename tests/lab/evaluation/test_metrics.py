"""Boundaries, covering, classes and delays, on cases small enough to count by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_lab.evaluation.scoring.metrics import (
    Labelled,
    TimedEstimate,
    confusion,
    covering,
    f1,
    match,
    paired_since,
    segments_with_events,
    withdrawn,
)

WINDOW = (0.0, 10.0)
# Points at least 1 s apart, so that a tolerance of 0.2 s never reaches two of them.
apart = st.lists(st.integers(1, 30), min_size=1, max_size=12, unique=True).map(
    lambda seconds: np.sort(np.array(seconds, dtype=float))
)


def counts(points, found, *, tolerance=0.2, optional=None):
    points = np.asarray(points, dtype=float)
    optional = np.zeros(points.size, dtype=bool) if optional is None else optional
    matching = match(points, np.full(points.size, tolerance), optional, found)
    return matching.hits.size, matching.false_alarms.size, matching.misses.size


def test_each_point_takes_one_changepoint_only():
    assert counts([5.0], [4.9, 5.1]) == (1, 1, 0)
    assert counts([5.0, 5.1], [5.05]) == (1, 0, 1)


def test_pairing_finds_all_where_the_nearest_first_would_not():
    # Nearest first takes 5.1 for 5.15, and 5.0 is left without one.
    assert counts([5.0, 5.15], [5.1, 5.3]) == (2, 0, 0)


def test_each_point_has_its_own_tolerance_inclusive():
    matching = match([1.0, 2.0], [0.1, 0.3], [False, False], [1.2, 2.3])
    assert (matching.hits.tolist(), matching.misses.tolist(), matching.false_alarms.tolist()) == (
        [1],
        [0],
        [0],
    )


def test_optional_points_are_neither_missed_nor_do_they_let_alarms_count():
    optional = np.array([False, True])
    assert counts([1.0, 5.0], [1.0], optional=optional) == (1, 0, 0)
    assert counts([1.0, 5.0], [1.0, 5.1], optional=optional) == (1, 0, 0)
    assert counts([1.0, 5.0], [5.1], optional=optional) == (0, 0, 1)


def test_a_point_that_must_be_found_comes_before_an_optional_one_nearer_by():
    assert counts([5.0, 5.1], [5.1], optional=np.array([False, True])) == (1, 0, 0)


@pytest.mark.parametrize(
    ("points", "found", "expected"),
    [([], [], (0, 0, 0)), ([], [1.0], (0, 1, 0)), ([1.0], [], (0, 0, 1))],
)
def test_nothing_to_find_and_nothing_found(points, found, expected):
    assert counts(points, found) == expected


def test_f1_of_nothing_at_all_is_perfect():
    assert f1(0, 0, 0) == 1.0
    assert f1(0, 1, 0) == 0.0
    assert f1(3, 1, 0) == pytest.approx(6 / 7)


@given(apart)
def test_perfect_is_one(points):
    hits, alarms, misses = counts(points, points)
    assert f1(hits, alarms, misses) == 1.0
    assert covering(points, points, (0.0, 31.0)) == pytest.approx(1.0)


@given(apart, st.floats(-0.199, 0.199))
def test_a_shift_within_tolerance_changes_no_count(points, shift):
    assert counts(points, points + shift) == counts(points, points)


@given(apart, st.data())
def test_a_false_alarm_costs_precision_only(points, data):
    found = np.array(data.draw(st.lists(st.sampled_from(points), unique=True)))
    hits, alarms, misses = counts(points, found)
    assert counts(points, [*found, 40.0]) == (hits, alarms + 1, misses)


@given(st.lists(st.floats(0, 10), max_size=8), st.lists(st.floats(0, 10), max_size=8), st.randoms())
def test_order_does_not_matter(points, found, random):
    shuffled = random.sample(points, len(points)), random.sample(found, len(found))
    assert counts(points, found) == counts(*shuffled)


@given(st.lists(st.floats(0, 10), max_size=5), st.lists(st.floats(0, 10), max_size=5))
def test_no_pairing_finds_more(points, found):
    assert counts(points, found, tolerance=1.0)[0] == most_pairs(points, list(found))


def most_pairs(points, found):
    """By trying everything."""
    if not points:
        return 0
    best = most_pairs(points[1:], found)
    for i, time in enumerate(found):
        if abs(time - points[0]) <= 1.0 + 1e-9:
            best = max(best, 1 + most_pairs(points[1:], found[:i] + found[i + 1 :]))
    return best


def test_covering_by_hand():
    assert covering([5.0], [], WINDOW) == pytest.approx(0.5)
    assert covering([], [5.0], WINDOW) == pytest.approx(0.5)
    assert covering([4.0], [5.0], WINDOW) == pytest.approx(0.4 * 4 / 5 + 0.6 * 5 / 6)
    assert covering([], [], WINDOW) == 1.0


@given(st.lists(st.floats(0, 10), max_size=8), st.lists(st.floats(0, 10), max_size=8))
def test_covering_is_a_share(truth, found):
    assert 0.0 < covering(truth, found, WINDOW) <= 1.0 + 1e-12


def test_a_stretch_is_cut_once_however_often():
    assert segments_with_events([5.0], [1.0, 2.0], WINDOW) == (1, 2)
    assert segments_with_events([5.0], [], WINDOW) == (0, 2)
    assert segments_with_events([], [1.0], WINDOW) == (1, 1)


def test_classes_are_compared_second_by_second():
    truth = [Labelled(0, 4, "motion"), Labelled(6, 10, "steady")]
    found = [Labelled(0, 3, "motion"), Labelled(3, 9, "steady")]
    assert confusion(truth, found) == {
        ("motion", "motion"): 3.0,
        ("motion", "steady"): 1.0,
        ("steady", "steady"): 3.0,
        ("steady", "none"): 1.0,
    }


def test_a_changepoint_stands_since_it_was_last_absent():
    timed_estimates = [
        TimedEstimate(1.0, (), ()),
        TimedEstimate(1.1, (0.9,), (False,)),
        TimedEstimate(1.2, (), ()),
        TimedEstimate(1.3, (0.5, 1.1), (True, False)),
        TimedEstimate(1.8, (0.5, 0.95), (True, True)),
    ]

    def since(t, tolerance, *, final=False, estimates=timed_estimates):
        return paired_since(estimates, [t], [tolerance], [False], final=final)

    assert since(1.0, 0.15) == [1.3]
    assert since(1.0, 0.15, final=True) == [1.8]
    assert since(1.0, 0.05) == [1.8]
    assert since(5.0, 0.15) == [None]
    assert since(5.0, 0.15, estimates=[]) == [None]


def test_a_changepoint_is_present_for_one_of_two_points_only():
    """The changepoint of the first point counted as present for the second, before that had happened."""
    estimates = [TimedEstimate(1.1, (1.0,), (True,)), TimedEstimate(1.6, (1.0, 1.3), (True, False))]
    points = [1.0, 1.3], [0.35, 0.35], [False, False]
    assert paired_since(estimates, *points, final=False) == [1.1, 1.6]
    assert paired_since(estimates, *points, final=True) == [1.1, None]


def test_a_shown_changepoint_is_withdrawn_unless_one_close_by_takes_its_place():
    shown = [(), (1.0,), (1.25, 2.0), (1.25,), (1.6, 3.0), (3.0,)]
    estimates = [TimedEstimate(i, times, (False,) * len(times)) for i, times in enumerate(shown)]
    assert withdrawn(estimates, 0.3) == ([2.0, 1.25, 1.6], [3.0])
    assert withdrawn([], 0.3) == ([], [])


@given(st.lists(st.lists(st.floats(0, 10), max_size=6, unique=True).map(sorted), max_size=6))
def test_what_is_shown_to_the_end_is_not_withdrawn(shown):
    estimates = [TimedEstimate(i, tuple(times), (False,) * len(times)) for i, times in enumerate(shown)]
    gone, stayed = withdrawn(estimates, 0.3)
    assert stayed == (shown[-1] if shown else [])
    assert len(gone) + len(stayed) <= sum(map(len, shown))
    assert withdrawn([*estimates, *estimates[-1:]], 0.3) == (gone, stayed)
