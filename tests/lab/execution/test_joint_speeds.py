"""Speeds of the joints on a path, beside an independent derivation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import sqrtm

from caesura_lab.execution.joint_speeds import JOINT_SHARE, fastest_joint
from caesura_protocol.reproduced_path import Curve
from caesura_service.robot import load_robot

SECONDS = 1.0


def lifted(name: str, metres: float = 0.2) -> tuple[float, ...]:
    """(n,) [rad/s] of every joint at the start of a path straight up: by least motion and by least energy."""
    robot = load_robot(name)
    q = robot.postures[0]
    arm = robot.hand_dynamics(q)
    twist = np.array([0.0, 0.0, metres / SECONDS, 0.0, 0.0, 0.0])
    root = np.linalg.inv(np.real(sqrtm(arm.mass_matrix)))
    by_motion = np.linalg.pinv(arm.jacobian) @ twist
    by_energy = root @ np.linalg.pinv(arm.jacobian @ root) @ twist
    return tuple(np.maximum(np.abs(by_motion), np.abs(by_energy)))


@pytest.mark.parametrize("name", ["panda", "iiwa14", "ur5e"])
def test_the_fastest_joint_is_that_of_the_least_motion_or_of_the_least_energy(name: str) -> None:
    """On a path so short that the arm stays as it is; the square Jacobian of a UR has one inverse."""
    robot, metres = load_robot(name), 1e-4
    q = robot.postures[0]
    place = robot.flange_pose(q).position_base
    up = np.array([0.0, 0.0, metres])
    steady = np.tile([*up / SECONDS, 0.0, 0.0, 0.0], (2, 1))
    path = Curve.through([0.0, SECONDS], [place, place + up], passing=steady)
    speeds = np.array(lifted(name, metres))
    expected = int(np.argmax(speeds / robot.velocity_limits))
    found = fastest_joint(robot, path, q)
    assert found.number == expected + 1
    assert_allclose(found.rad_per_s, speeds[expected], rtol=1e-3)
    assert found.limit_rad_per_s == robot.velocity_limits[expected]


def test_a_path_is_slowed_where_a_joint_is_beyond_its_share() -> None:
    robot = load_robot("panda")
    q = robot.postures[0]
    place = robot.flange_pose(q).position_base
    path = Curve.through([0.0, 0.1], [place, place + np.array([0.0, 0.0, 0.1])])
    found = fastest_joint(robot, path, q)
    assert found.share > JOINT_SHARE
    assert found.slower == pytest.approx(found.share / JOINT_SHARE)
    slow = fastest_joint(robot, Curve.through([0.0, 10.0], path.values), q)
    assert slow.slower == 1.0
    assert slow.rad_per_s == pytest.approx(found.rad_per_s / 100.0, rel=0.05)
