"""The reproduced path: its ends, derivatives and peaks, and that it does not overshoot."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from caesura_protocol.paths import Curve

START, END = np.array([0.1, -0.5, 0.3]), np.array([0.3, -0.4, 0.1])
PEAK = 1.875  # of a minimum-jerk movement over its mean


def test_it_begins_and_ends_where_and_how_fast_it_should() -> None:
    leaving, arriving = np.array([0.02, 0.0, -0.01]), np.array([0.0, 0.01, -0.05])
    curve = Curve.through([0.0, 1.4], [START, END], leaving=leaving, arriving=arriving)
    for t, place, speed in ((0.0, START, leaving), (1.4, END, arriving)):
        position, velocity, acceleration = curve.at(t)
        assert_allclose(position, place, atol=1e-12)
        assert_allclose(velocity, speed, atol=1e-12)
        assert_allclose(acceleration, 0.0, atol=1e-12)
    assert_allclose(curve.at(1.9)[0], END + 0.5 * arriving)


def test_velocity_and_acceleration_are_the_derivatives_of_the_place() -> None:
    knots = [START, END, START + 0.1, END - 0.05]
    curve, step = Curve.through([0.0, 1.4, 2.0, 3.0], knots, arriving=(0.0, 0.01, -0.05)), 1e-5
    for t in np.linspace(0.1, 2.9, 7):
        before, _, _ = curve.at(t - step)
        here, velocity, acceleration = curve.at(t)
        after, _, _ = curve.at(t + step)
        assert_allclose((after - before) / (2 * step), velocity, atol=1e-8)
        assert_allclose((after - 2 * here + before) / step**2, acceleration, atol=1e-4)


def test_without_via_points_it_is_the_straight_line_of_minimum_jerk() -> None:
    curve = Curve.through([0.0, 2.0], [START, END])
    places = np.array([curve.at(t)[0] for t in np.linspace(0.0, 2.0, 21)])
    way = (END - START) / np.linalg.norm(END - START)
    assert_allclose(np.linalg.norm(np.cross(places - START, way), axis=1), 0.0, atol=1e-12)
    assert_allclose(curve.peaks()[0], PEAK * np.linalg.norm(END - START) / 2.0, rtol=1e-9)


def test_the_rate_of_a_turn_is_that_of_its_quaternions() -> None:
    angles = np.array([0.0, 0.5, 1.4, 2.0])
    poses = np.column_stack([*np.zeros((5, 4)), np.sin(angles / 2), np.cos(angles / 2)])
    curve = Curve.through(np.linspace(0.0, 3.0, 4), poses)
    seen = 2.0 * np.arcsin(curve.sampled(1000)[:, 5])
    assert curve.peaks()[0] == 0.0
    assert_allclose(curve.peaks()[1], np.diff(seen).max() / 1e-3, rtol=0.01)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_what_stops_on_its_way_does_not_overshoot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.1, 1.0, 5.0], 6))
    line = np.cumsum(rng.choice([0.0, 0.001, 0.1], 6))
    places = Curve.through(times, np.outer(line, (1.0, 0.0, 0.0))).sampled(50)[:, 0]
    assert np.diff(places).min() > -1e-12
