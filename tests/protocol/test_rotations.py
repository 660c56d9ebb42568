"""Rotations: the bits of numpy without its wrappers, and rates of quaternions."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from caesura_protocol.rotations import (
    angular_velocities,
    cross,
    matrices_of,
    quaternion_rates,
    quaternions_of_roll_pitch_yaw,
    quaternions_of_vectors,
    roll_pitch_yaw,
    rotation_vectors,
)


def test_the_cross_product_has_the_bits_of_numpy() -> None:
    pairs = (
        np.random.default_rng(0).standard_normal((200, 2, 3)) * 10.0 ** np.arange(-100, 100)[:, None, None]
    )
    pairs[0, 0] = 0.0
    for one, other in pairs:
        assert cross(one, other).tobytes() == np.cross(one, other).tobytes()


def test_the_rates_of_quaternions_and_angular_velocities_are_each_others_inverse() -> None:
    rng = np.random.default_rng(1)
    rotations, turning, step = Rotation.random(20, rng=rng), rng.normal(size=(20, 3)), 1e-6
    quaternions = rotations.as_quat()
    after = (Rotation.from_rotvec(step * turning) * rotations).as_quat()
    rates = quaternion_rates(quaternions, turning)
    assert_allclose((after - quaternions) / step, rates, atol=1e-5)
    assert_allclose(angular_velocities(3.0 * quaternions, 3.0 * rates), turning, atol=1e-12)


def test_roll_pitch_and_yaw_are_those_of_scipy_and_turn_back_to_the_quaternion() -> None:
    rng = np.random.default_rng(5)
    for rotation in Rotation.random(50, rng=rng):
        quaternion = -2.0 * rotation.as_quat()
        assert_allclose(roll_pitch_yaw(quaternion), rotation.as_euler("xyz"), atol=1e-9)
    for pitch in (0.5 * np.pi, -0.5 * np.pi):
        upright = quaternions_of_roll_pitch_yaw(np.array([[0.4, pitch, 0.3]]))
        found = quaternions_of_roll_pitch_yaw(np.array([roll_pitch_yaw(upright[0])]))
        assert_allclose(matrices_of(found), matrices_of(upright), atol=1e-6)


def test_rotation_vectors_are_those_of_scipy_whatever_sign_and_length_a_quaternion_has() -> None:
    rng = np.random.default_rng(6)
    start, others = Rotation.random(rng=rng), Rotation.random(500, rng=rng)
    tiny = Rotation.from_rotvec(rng.normal(size=(500, 3)) * 10.0 ** rng.uniform(-14.0, 0.0, (500, 1))) * start
    for turned in (others, tiny):
        quaternions = turned.as_quat() * rng.choice([-1.0, 1.0, 0.97], (500, 1))
        first = (-1.03 * start.as_quat()).tolist()
        found = rotation_vectors(quaternions, first)
        assert_allclose(found, (turned * start.inv()).as_rotvec(), atol=1e-12)
        assert (rotation_vectors(quaternions[123:124], first) == found[123]).all(), "alone the same bits"
    assert np.isnan(rotation_vectors(np.zeros((1, 4)), first)).all()


def test_quaternions_of_angles_are_those_of_scipy() -> None:
    rng = np.random.default_rng(4)
    turns = np.vstack([rng.uniform(-3.0, 3.0, (50, 3)), np.zeros((1, 3)), [[np.pi, 0.0, 0.0]]])
    for found, expected in (
        (quaternions_of_vectors(turns), Rotation.from_rotvec(turns)),
        (quaternions_of_roll_pitch_yaw(turns), Rotation.from_euler("xyz", turns)),
    ):
        assert_allclose(matrices_of(found), expected.as_matrix(), atol=1e-12)
        assert (np.einsum("ni,ni->n", found[1:], found[:-1]) >= 0.0).all(), "no leap between signs"
