"""How a setpoint moves: ends, speeds and rotations."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from caesura_service.execution.motion import PEAK, Glide, Turn, rotation_of, rotation_vector

START, END = np.array([0.1, -0.5, 0.3]), np.array([0.3, -0.4, 0.1])


def test_a_movement_begins_and_ends_where_and_how_fast_it_should() -> None:
    leaving, arriving = np.array([0.02, 0.0, -0.01]), np.array([0.0, 0.01, -0.05])
    glide = Glide(START, END, 1.4, arriving, leaving)
    for t, place, speed in ((0.0, START, leaving), (1.4, END, arriving)):
        position, velocity, acceleration = glide.at(t)
        assert_allclose(position, place, atol=1e-12)
        assert_allclose(velocity, speed, atol=1e-12)
        assert_allclose(acceleration, 0.0, atol=1e-12)
    assert_allclose(glide.at(1.9)[0], END + 0.5 * arriving)


def test_velocity_and_acceleration_are_the_derivatives_of_the_place() -> None:
    glide, step = Glide(START, END, 1.4, np.array([0.0, 0.01, -0.05]), np.array([0.02, 0.0, 0.0])), 1e-5
    for t in np.linspace(0.1, 1.3, 7):
        before, _, _ = glide.at(t - step)
        here, velocity, acceleration = glide.at(t)
        after, _, _ = glide.at(t + step)
        assert_allclose((after - before) / (2 * step), velocity, atol=1e-8)
        assert_allclose((after - 2 * here + before) / step**2, acceleration, atol=1e-4)


def test_from_rest_to_rest_the_peak_is_known() -> None:
    glide = Glide(START, END, 2.0, np.zeros(3))
    speeds = [np.linalg.norm(glide.at(t)[1]) for t in np.linspace(0.0, 2.0, 401)]
    assert_allclose(max(speeds), PEAK * np.linalg.norm(END - START) / 2.0, rtol=1e-6)


def test_rotations_agree_with_scipys() -> None:
    for seed in range(10):
        first, last = Rotation.random(2, rng=np.random.default_rng(seed))
        assert_allclose(rotation_of(tuple(first.as_quat())), first.as_matrix(), atol=1e-12)
        vector = rotation_vector((last * first.inv()).as_matrix())
        assert_allclose(vector, (last * first.inv()).as_rotvec(), atol=1e-6)
        turn = Turn(first.as_matrix(), last.as_matrix(), 1.0)
        assert_allclose(turn.at(1.0), last.as_matrix(), atol=1e-9)
        half = Rotation.from_rotvec(0.5 * vector) * first
        assert_allclose(turn.at(0.5), half.as_matrix(), atol=1e-9)
