"""Every arm that ships: kinematics against the maker's table, dynamics against differences, its figures.

Frames and tables are written here a second time, as the makers print them, and multiplied out with numpy.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from caesura_protocol.robots import robot_names
from caesura_protocol.robots.description import SHIPPED
from caesura_service.robot import ReachError, Robot, load_robot

Array = NDArray[np.float64]
Rows = tuple[tuple[float, float, float], ...]

H = np.pi / 2
# Rows of a [m], d [m], alpha [rad]. Modified (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d); last row: flange.
FRANKA: Rows = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -H),
    (0.0, 0.316, H),
    (0.0825, 0.0, H),
    (-0.0825, 0.384, -H),
    (0.0, 0.0, H),
    (0.088, 0.0, H),
    (0.0, 0.107, 0.0),
)
XARM7: Rows = (
    (0.0, 0.267, 0.0),
    (0.0, 0.0, -H),
    (0.0, 0.293, H),
    (0.0525, 0.0, H),
    (0.0775, 0.3425, H),
    (0.0, 0.0, H),
    (0.076, 0.097, -H),
    (0.0, 0.0, 0.0),
)
# Standard: Rz(theta) Tz(d) Tx(a) Rx(alpha).
UR5E: Rows = (
    (0.0, 0.1625, H),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, H),
    (0.0, 0.0997, -H),
    (0.0, 0.0996, 0.0),
)
UR10E: Rows = (
    (0.0, 0.1807, H),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, H),
    (0.0, 0.11985, -H),
    (0.0, 0.11655, 0.0),
)
IIWA14: Rows = (
    (0.0, 0.360, -H),
    (0.0, 0.0, H),
    (0.0, 0.420, H),
    (0.0, 0.0, -H),
    (0.0, 0.400, -H),
    (0.0, 0.0, H),
    (0.0, 0.126, 0.0),
)
MODIFIED = {"panda": FRANKA, "fr3": FRANKA, "xarm7": XARM7}
STANDARD = {"ur5e": UR5E, "ur10e": UR10E, "iiwa14": IIWA14}
ARMS = sorted({**MODIFIED, **STANDARD})


def rotation_x(angle: float, x: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, x], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def rotation_z(angle: float, z: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, z], [0, 0, 0, 1.0]])


def flange(name: str, q: Array) -> Array:
    """Flange in the base frame as a (4, 4) transform, by the maker's table."""
    transform = np.eye(4)
    if name in MODIFIED:
        for (a, d, alpha), theta in zip(MODIFIED[name], [*q, 0.0], strict=True):
            transform = transform @ rotation_x(alpha, a) @ rotation_z(theta, d)
        return transform
    for (a, d, alpha), theta in zip(STANDARD[name], q, strict=True):
        transform = transform @ rotation_z(theta, d) @ rotation_x(alpha, a)
    return transform


@cache
def arm(name: str) -> Robot:
    return load_robot(name)


def drawn(robot: Robot, count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(robot.lower_limits, robot.upper_limits, size=(count, robot.joints))


def test_six_arms_ship() -> None:
    assert set(ARMS) <= set(robot_names())


def test_every_urdf_that_ships_is_in_the_notice_with_its_licence() -> None:
    notice = (Path(__file__).parents[3] / "NOTICE").read_text("utf-8")
    arms = {urdf.stem for urdf in SHIPPED.glob("*/*.urdf")}
    assert arms == set(ARMS)
    for arm_name in arms:
        (entry,) = [part for part in notice.split("\n\n") if re.search(rf"\([^)]*\b{arm_name}\b", part)]
        assert "License" in entry


@pytest.mark.parametrize("name", ARMS)
def test_flange_agrees_with_the_makers_table(name: str) -> None:
    robot = arm(name)
    for q in drawn(robot, 50, seed=1):
        expected, found = flange(name, q), robot.hand_dynamics(q)
        assert_allclose(found.position_base, expected[:3, 3], rtol=0.0, atol=1e-9)
        assert_allclose(found.rotation_base, expected[:3, :3], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e", "ur10e"])
def test_a_ur_arm_at_zero_points_against_x_of_its_controllers_base(name: str) -> None:
    robot = arm(name)
    assert robot.flange_pose(np.zeros(6)).position_base[0] < -0.8  # `base_link` of ROS would have it at +x


@pytest.mark.parametrize("name", ARMS)
def test_mass_matrix_is_positive_definite_and_gravity_is_the_slope_of_the_energy(name: str) -> None:
    robot, h = arm(name), 1e-6
    for q in drawn(robot, 20, seed=2):
        mass = robot.mass_matrix(q)
        assert_allclose(mass, mass.T, atol=1e-12)
        assert np.linalg.eigvalsh(mass)[0] > 0.0
        steps = h * np.eye(robot.joints)
        slope = [(robot.potential_energy(q + s) - robot.potential_energy(q - s)) / (2.0 * h) for s in steps]
        assert_allclose(robot.gravity_torques(q), slope, atol=1e-5)


@pytest.mark.parametrize("name", ARMS)
def test_every_link_has_a_mass_and_a_positive_tensor(name: str) -> None:
    for inertia in arm(name)._model.inertias[1:]:
        assert inertia.mass > 0.0
        assert np.linalg.eigvalsh(inertia.inertia)[0] > 0.0


@pytest.mark.parametrize("name", ARMS)
def test_limits_and_lists_have_a_figure_for_every_joint(name: str) -> None:
    robot = arm(name)
    lists = (robot.lower_limits, robot.upper_limits, robot.velocity_limits, robot.torque_limits)
    lists += (robot.acceleration_limits, robot.jerk_limits, robot.friction_nm)
    assert {values.shape for values in lists} == {(robot.joints,)}
    assert np.all(robot.lower_limits < robot.upper_limits)
    for values in lists[2:]:
        assert np.all((values > 0.0) & np.isfinite(values))
    for posture in robot.postures:
        assert np.all((robot.lower_limits <= posture) & (posture <= robot.upper_limits))
    assert {"kinematics", "limits", "inertia", "friction_nm"} <= set(robot.description.sources)


@pytest.mark.parametrize("name", ARMS)
def test_the_first_posture_points_the_flange_down_over_x(name: str) -> None:
    robot = arm(name)
    found = robot.hand_dynamics(robot.postures[0])
    assert_allclose(found.rotation_base[:, 2], [0.0, 0.0, -1.0], atol=1e-5)
    assert found.position_base[0] > 0.4
    assert abs(found.position_base[1]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_ninety_nine_of_a_hundred_reachable_poses_are_found(name: str) -> None:
    # tests/bench/ik_rate.py has 1,000 poses an arm.
    robot, missed = arm(name), 0
    poses = drawn(robot, 100, seed=11)
    for q in poses:
        goal = robot.flange_pose(q)
        try:
            found = robot.find_joints(goal.position_base, goal.orientation_base)
        except ReachError:
            missed += 1
            continue
        assert np.all((robot.lower_limits <= found) & (found <= robot.upper_limits))
        at = robot.flange_pose(found)
        assert np.linalg.norm(at.position_base - goal.position_base) < 1e-4
        assert abs(at.orientation_base @ goal.orientation_base) > 1.0 - 1e-7
    assert missed <= 0.01 * len(poses)


def test_the_same_pose_has_the_same_joints_in_every_instance() -> None:
    goal = arm("ur5e").flange_pose(drawn(arm("ur5e"), 1, seed=3)[0])
    found = [load_robot("ur5e").find_joints(goal.position_base, goal.orientation_base) for _ in range(2)]
    assert found[0].tolist() == found[1].tolist()


def test_a_pose_out_of_reach_is_refused_with_what_is_left() -> None:
    with pytest.raises(ReachError, match=r"\[2.0, 0.0, 0.3\] m: [0-9.]+ mm .* are left from 23 postures"):
        arm("ur5e").find_joints([2.0, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0])


def test_a_franka_research_3_keeps_to_the_speeds_that_its_position_allows() -> None:
    """Franka's law of the speed limit near the end of a joint, at the ends of the stated rectangle."""
    robot = arm("fr3")
    offset = np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35])
    slope = np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0])
    top = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
    bottom = np.array([2.7501, 1.7918, 2.9065, 3.0481, 2.8101, -0.54092, 3.0196])
    upward = np.sqrt(slope * (top - robot.upper_limits)) - offset
    downward = np.sqrt(slope * (bottom + robot.lower_limits)) - offset
    assert np.all(robot.velocity_limits <= 1.001 * np.minimum(upward, downward))
