"""Fingers that stop on something, on nothing, and open again."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_service.signals import Conditioner, ConditioningOutput, GripperParameters, SampleLayout
from service.signals.samples import POSITION, along, times, together

Array = NDArray[np.float64]

LAYOUT = SampleLayout(("t", *POSITION, "gripper"), wrench_source="none")
FINGER_SPEED = 0.08 / 0.56  # [m/s] a Panda's full travel takes 0.56 s
LATE_S = 0.03  # a still window may begin a little before the fingers have quite stopped


def follow(width: Array, t: Array, *, until: float = np.inf) -> ConditioningOutput:
    samples = np.column_stack([t, along((0.1, 0.0, 0.0), t), width])[t < until]
    return together(Conditioner(LAYOUT), [samples])


def travelling(
    t: Array, *moves: tuple[float, float], start: float = 0.08, speed: float = FINGER_SPEED
) -> Array:
    """Width over time: at each (time, goal) the fingers begin to travel to the goal."""
    width = np.full_like(t, start)
    for begin, goal in moves:
        level = np.interp(begin, t, width)
        travelled = np.minimum(speed * np.clip(t - begin, 0.0, None), abs(goal - level))
        width = np.where(t >= begin, level + np.sign(goal - level) * travelled, width)
    return width


def measured(width: Array, t: Array, *, noise_m: float = 2e-4) -> Array:
    """As a Panda publishes it: 30 readings a second, held in between, with noise."""
    reading = np.floor(t * 30.0) / 30.0
    noisy = np.interp(reading, t, width) + np.random.default_rng(0).normal(0, noise_m, len(t))
    return noisy[np.searchsorted(t, reading)]


def kinds(result: ConditioningOutput) -> list[str]:
    return [event.kind for event in result.gripper_events]


T = times(500.0, 6.0)


def test_a_grasp_is_when_the_fingers_have_settled_and_a_release_when_they_begin() -> None:
    grasp, release = follow(travelling(T, (1.0, 0.04), (4.0, 0.08)), T).gripper_events
    assert (grasp.kind, release.kind) == ("grasp", "release")
    assert grasp.t == pytest.approx(1.0 + 0.04 / FINGER_SPEED, abs=LATE_S)
    assert grasp.width == pytest.approx(0.04, abs=1e-3)
    assert release.t == pytest.approx(4.0, abs=LATE_S)
    assert release.width == pytest.approx(0.08, abs=1e-3)


def test_fingers_that_meet_nothing_close_and_open() -> None:
    close, opened = follow(travelling(T, (1.0, 0.0), (4.0, 0.06)), T).gripper_events
    assert (close.kind, opened.kind) == ("close", "open")
    assert close.t == pytest.approx(1.56, abs=LATE_S)
    assert opened.t == pytest.approx(4.0, abs=LATE_S)


@pytest.mark.parametrize("noise_m", [0.0, 1e-4, 2e-4, 3e-4])
@pytest.mark.parametrize("speed", [0.02, 0.05, FINGER_SPEED])
def test_events_survive_noise_and_a_slow_publisher(noise_m: float, speed: float) -> None:
    width = travelling(T, (1.0, 0.05), (4.0, 0.08), speed=speed)
    grasp, release = follow(measured(width, T, noise_m=noise_m), T).gripper_events
    assert (grasp.kind, release.kind) == ("grasp", "release")
    unseen_s = GripperParameters().still_range_m / speed + 0.04  # and a reading that is 33 ms old
    assert grasp.t == pytest.approx(1.0 + 0.03 / speed, abs=unseen_s)
    assert release.t == pytest.approx(4.0, abs=unseen_s)


def test_an_object_that_slips_away_leaves_the_fingers_closed() -> None:
    assert kinds(follow(travelling(T, (1.0, 0.03), (3.0, 0.0), (5.0, 0.08)), T)) == ["grasp", "close", "open"]


def test_a_knock_on_the_fingers_is_no_event() -> None:
    knocked = travelling(T, (1.0, 0.03)) + 0.004 * np.exp(-(((T - 3.0) / 0.02) ** 2))
    assert kinds(follow(knocked, T)) == ["grasp"]


def test_resting_fingers_make_no_events() -> None:
    for start in (0.08, 0.04, 0.0):
        assert kinds(follow(np.full_like(T, start), T)) == []


def test_a_closed_flag_grasps_and_releases() -> None:
    flag = ((T >= 1.0) & (T < 3.0)).astype(float)
    result = follow(flag, T)
    assert [(e.kind, e.width) for e in result.gripper_events] == [("grasp", None), ("release", None)]
    grasp, release = result.gripper_events
    assert grasp.t == pytest.approx(1.0, abs=0.011)
    assert release.t == pytest.approx(3.0, abs=0.011)
    assert {o.gripper_width for o in result.observations} == {None}


def test_a_flag_that_chatters_for_a_moment_is_no_event() -> None:
    assert kinds(follow(((T >= 1.0) & ~((T > 2.0) & (T < 2.1))).astype(float), T)) == ["grasp"]


def test_a_flag_that_begins_closed_releases() -> None:
    assert kinds(follow((T < 2.0).astype(float), T)) == ["release"]


def test_a_column_of_zeros_has_not_said_what_it_is() -> None:
    observations = follow((T >= 2.0).astype(float), T).observations
    assert [o.gripper_closed for o in observations[:19]] == [None] * 19
    assert [o.gripper_closed for o in observations[23:]] == [True] * len(observations[23:])


def test_a_gripper_that_begins_closed_opens() -> None:
    (opened,) = follow(travelling(T, (2.0, 0.05), start=0.0), T).gripper_events
    assert (opened.kind, opened.t) == ("open", pytest.approx(2.0, abs=LATE_S))


def test_observations_know_whether_the_gripper_is_closed() -> None:
    result = follow(travelling(T, (1.0, 0.04), (4.0, 0.08)), T)
    closed = {round(o.t, 1): o.gripper_closed for o in result.observations}
    expected = {0.1: None, 0.5: False, 1.1: False, 1.5: True, 3.9: True, 4.1: False, 5.0: False}
    assert {t: closed[t] for t in expected} == expected
    widths = {round(o.t, 1): o.gripper_width for o in result.observations}
    assert widths[0.5] == 0.08
    assert widths[3.0] == pytest.approx(0.04, abs=1e-12)


def test_without_a_gripper_nothing_is_known_of_it() -> None:
    samples = np.column_stack([T, along((0.1, 0.0, 0.0), T)])
    result = together(Conditioner(SampleLayout(LAYOUT.columns[:-1], "none")), [samples])
    assert {(o.gripper_closed, o.gripper_width) for o in result.observations} == {(None, None)}


def test_a_release_is_not_lost_when_the_demonstration_ends_with_it() -> None:
    *_, release = follow(travelling(T, (1.0, 0.04), (4.0, 0.08)), T, until=4.2).gripper_events
    assert (release.kind, release.t) == ("release", pytest.approx(4.0, abs=LATE_S))


def test_what_happened_during_a_gap_is_seen_after_it() -> None:
    width = travelling(T, (1.0, 0.04), (3.0, 0.08))
    seen = (T < 2.8) | (T > 4.0)
    grasp, release = follow(width[seen], T[seen]).gripper_events
    assert (grasp.kind, release.kind) == ("grasp", "release")
    assert release.t == pytest.approx(2.79, abs=0.02)


def test_an_object_held_through_a_gap_is_still_held() -> None:
    seen = (T < 2.0) | (T > 3.0)
    assert kinds(follow(travelling(T, (1.0, 0.04))[seen], T[seen])) == ["grasp"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"still_window_s": 0.0}, "still_window_s is 0.0, expected a number above 0"),
        ({"travel_m": 0.001}, "travel_m is 0.001, expected a length above still_range_m = 0.002"),
    ],
)
def test_thresholds_that_contradict_each_other_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GripperParameters(**options)


def excursions(width: Array, cuts: int = 1) -> list[tuple[float, ...]]:
    conditioner = Conditioner(LAYOUT)
    samples = np.column_stack([T, along((0.1, 0.0, 0.0), T), width])
    together(conditioner, np.array_split(samples, cuts))
    return [tuple(one) for one in conditioner.finger_excursions]


@pytest.mark.parametrize("cuts", [1, 30, 3000])
@pytest.mark.parametrize("seconds", [0.1, 0.15])
def test_fingers_that_open_for_a_moment_and_close_again_have_an_excursion_and_no_event(
    seconds: float, cuts: int
) -> None:
    opened = (seconds + 2.0) <= T
    width = np.where((T >= 2.0) & ~opened, 0.07, 0.03)
    assert kinds(follow(width, T)) == []
    (found,) = excursions(width, cuts)
    assert found == pytest.approx((2.0, 2.0 + seconds, 0.03, 0.07), abs=0.021)


def test_fingers_that_rest_elsewhere_a_wrong_reading_and_a_part_that_gives_way_have_no_excursion() -> None:
    assert excursions(travelling(T, (1.0, 0.04), (4.0, 0.08))) == []
    assert excursions(np.where(np.abs(T - 2.0) < 0.001, 0.07, 0.03)) == []
    assert excursions(np.where((T > 2.0) & (T < 2.1), 0.034, 0.03)) == []


def test_a_flag_has_excursions_without_an_opening() -> None:
    ((began, ended, *openings),) = excursions(np.where((T > 2.0) & (T < 2.1), 0.0, 1.0))
    assert (began, ended) == pytest.approx((2.0, 2.1), abs=0.021)
    assert np.isnan(openings).all()
