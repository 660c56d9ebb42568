"""What a session remembers of its observations."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from caesura_service.changepoint.constant_models import HoldingStates
from caesura_service.program import Moment
from caesura_service.segmentation.observation_store import PRESS_OBSERVATIONS, ObservationStore
from caesura_service.segmentation.overflow_file import BLOCK
from caesura_service.signals import Observation
from service.sessions.observing import observation


def history_of(down: np.ndarray) -> ObservationStore:
    history = ObservationStore()
    for i, newton in enumerate(down):
        history.append(observation(i, newton))
    return history


def test_a_press_is_measured_without_touching_and_letting_go() -> None:
    down = np.concatenate([[0.5, 4.0, 9.0], np.full(20, 15.0), [10.0, 3.0, 0.2]])
    assert history_of(down).press(0, len(down)) == pytest.approx((0.0, 0.0, 15.0))


def test_a_spike_when_a_surface_is_hit_is_not_the_press() -> None:
    down = np.concatenate([[35.0], np.full(30, 12.0)])
    assert history_of(down).press(0, len(down))[2] == pytest.approx(12.0)


@pytest.mark.parametrize("first", [13.5, 40.0])
def test_nor_is_it_in_a_short_press(first: float) -> None:
    down = np.array([first, 6.1, 6.0, 6.2, 7.2, 6.1, 3.0])
    assert history_of(down).press(0, len(down))[2] == pytest.approx(6.15)


def test_one_observation_is_its_own_press() -> None:
    assert history_of(np.array([1.0, 7.0])).press(1, 2) == (0.0, 0.0, 7.0)


def test_a_long_press_is_looked_at_here_and_there() -> None:
    down = np.full(3 * PRESS_OBSERVATIONS + 1, 8.0)
    assert history_of(down).press(0, len(down)) == pytest.approx((0.0, 0.0, 8.0))


def noted(index: int) -> Observation:
    """One of which every number is another one, with the gripper open and nothing missing before it."""
    seen = observation(index, 0.1 * index)
    numbers = np.random.default_rng(index).standard_normal(20)
    return replace(
        seen,
        position_base=numbers[:3],
        force_base=numbers[3:6],
        orientation=numbers[6:10] if index % 3 else None,
        joints=numbers[10:17] if index % 5 else None,
        gripper_width=float(numbers[17]) if index % 7 else None,
        gripper_closed=False,
        after_gap=index % 11 == 0,
    )


def moment_of(seen: Observation) -> Moment:
    orientation, joints = seen.orientation, seen.joints
    return Moment(
        position=tuple(seen.position_base.tolist()),
        orientation=None if orientation is None else tuple(orientation.tolist()),
        joints=None if joints is None else tuple(joints.tolist()),
        gripper_width=seen.gripper_width,
        force=tuple(seen.force_base.tolist()),
    )


@pytest.fixture(scope="module")
def long() -> tuple[list[Observation], ObservationStore]:
    """Most of which is not in memory any more."""
    every, history = [noted(i) for i in range(3000)], ObservationStore()
    for seen in every:
        history.append(seen)
    return every, history


def test_an_observation_is_what_it_was_to_the_last_bit(
    long: tuple[list[Observation], ObservationStore],
) -> None:
    every, history = long
    for seen in every:
        observed = history.observed(seen.index)
        assert np.array_equal(observed.position, seen.position_base)
        assert np.array_equal(observed.force, seen.force_base)
        assert (history.t(seen.index), history.after_gap(seen.index)) == (seen.t, seen.after_gap)
        assert history.moment_at(seen.index) == moment_of(seen)


def test_the_moment_of_any_time_is_that_of_the_nearest_observation(
    long: tuple[list[Observation], ObservationStore],
) -> None:
    every, history = long
    for t in (-1.0, 0.04, 0.06, 77.77, 150.0, 299.84, 299.86, 1000.0):
        nearest = min(every, key=lambda seen: abs(seen.t - t))
        assert history.moment(t) == moment_of(nearest)


def test_the_vertical_force_of_any_span_is_its_mean_and_variance(
    long: tuple[list[Observation], ObservationStore],
) -> None:
    every, history = long
    for start, end in ((0, 3000), (5, 6), (100, 2900), (2990, 3000)):
        down = [seen.force_base[2] for seen in every[start:end]]
        assert history.vertical_force(start, end) == pytest.approx((np.mean(down), np.var(down)))


@pytest.mark.parametrize(("start", "end"), [(0, 3000), (17, 2017), (17, 600), (2500, 3000)])
def test_a_press_of_any_length_is_looked_at_where_it_was(
    long: tuple[list[Observation], ObservationStore], start: int, end: int
) -> None:
    every, history = long
    looks = ObservationStore()
    for seen in every[start : end : -(-(end - start) // PRESS_OBSERVATIONS)]:
        looks.append(seen)
    assert history.press(start, end) == looks.press(0, len(looks))


def test_the_states_of_a_gripper_in_any_span_are_those_that_are_known_in_it() -> None:
    states = np.random.default_rng(3).choice([0.0, 1.0, np.nan], 60, p=[0.2, 0.2, 0.6])
    history = ObservationStore()
    for index, state in enumerate(states):
        closed = None if np.isnan(state) else bool(state)
        history.append(replace(observation(index, 0.0), gripper_closed=closed))
    for start in range(60):
        for end in range(start + 1, 61):
            known = [state for state in states[start:end] if not np.isnan(state)]
            changes = int(np.count_nonzero(np.diff(known)))
            expected = HoldingStates(known[0], len(known) - 1 - changes, changes) if known else None
            assert history.holding_states(start, end) == expected


def test_memory_does_not_grow_with_what_is_remembered() -> None:
    every = [noted(i) for i in range(500)]
    tracemalloc.start()
    try:
        history = ObservationStore()
        sizes = []
        for _ in range(10):
            for seen in every:
                history.append(seen)
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert max(sizes[1:]) < 4 * BLOCK
