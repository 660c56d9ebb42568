"""The facade against the published DH table, finite differences, virtual work and Newton's law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from caesura_service.constants import JOINTS
from caesura_service.robot import ReachError, Robot, load_panda
from caesura_service.robot.robot_model import SINGULAR_BELOW

Array = NDArray[np.float64]

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
TOOL_DOWN = np.array([1.0, 0.0, 0.0, 0.0])

# Modified Denavit-Hartenberg table of the FCI documentation: a [m], d [m], alpha [rad]; last row: flange.
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_panda()


@pytest.fixture(scope="module")
def postures(robot: Robot) -> Array:
    rng = np.random.default_rng(7)
    return rng.uniform(robot.lower_limits, robot.upper_limits, size=(20, JOINTS))


def dh_flange(q: Array) -> Array:
    """Flange pose as a (4, 4) transform, by the rule of Craig's convention."""
    transform = np.eye(4)
    for (a, d, alpha), theta in zip(DH, [*q, 0.0], strict=True):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        link = [
            [ct, -st, 0, a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
        transform = transform @ np.array(link)
    return transform


def rotation(quaternion: Array) -> Array:
    x, y, z, w = quaternion
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def numeric(function: Callable[[Array], Array | float], q: Array, h: float = 1e-6) -> Array:
    steps = h * np.eye(JOINTS)
    return np.stack([(function(q + s) - np.asarray(function(q - s))) / (2 * h) for s in steps], axis=-1)


def test_ready_pose_is_the_published_one(robot: Robot) -> None:
    tcp = robot.hand_tcp_pose(READY)
    assert_allclose(tcp.position_base, [0.3069, 0.0, 0.4869], atol=1e-4)
    assert_allclose(np.abs(tcp.orientation_base), TOOL_DOWN, atol=1e-9)
    assert_allclose(robot.flange_pose(READY).position_base, [0.3069, 0.0, 0.5903], atol=1e-4)


def test_flange_agrees_with_the_denavit_hartenberg_table(robot: Robot, postures: Array) -> None:
    for q in postures:
        pose, expected = robot.flange_pose(q), dh_flange(q)
        assert_allclose(pose.position_base, expected[:3, 3], atol=1e-12)
        assert_allclose(rotation(pose.orientation_base), expected[:3, :3], atol=1e-12)


def test_hand_is_turned_by_45_degrees_and_its_tip_lies_103_mm_ahead(robot: Robot, postures: Array) -> None:
    for q in postures:
        flange, tcp = robot.flange_pose(q), robot.hand_tcp_pose(q)
        turn = rotation(flange.orientation_base).T @ rotation(tcp.orientation_base)
        half = np.sqrt(0.5)
        assert_allclose(turn, [[half, half, 0], [-half, half, 0], [0, 0, 1]], atol=1e-12)
        ahead = rotation(flange.orientation_base).T @ (tcp.position_base - flange.position_base)
        assert_allclose(ahead, [0, 0, 0.1034], atol=1e-12)


def test_jacobian_is_the_derivative_of_the_pose(robot: Robot, postures: Array) -> None:
    for q in postures[:6]:
        jacobian = robot.flange_jacobian(q)
        assert_allclose(jacobian[:3], numeric(lambda p: robot.flange_pose(p).position_base, q), atol=1e-8)
        turned = numeric(lambda p: rotation(robot.flange_pose(p).orientation_base), q)
        spin = np.einsum("ijk,lj->ilk", turned, rotation(robot.flange_pose(q).orientation_base))
        assert_allclose(jacobian[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_joints_that_turn_evenly_accelerate_the_flange_by_the_change_of_the_jacobian(
    robot: Robot, postures: Array
) -> None:
    step = 1e-5
    for q, v in zip(postures[:6], postures[6:12], strict=True):
        before, after = (robot.flange_jacobian(q + share * step * v) for share in (-1.0, 1.0))
        expected = (after - before) @ v / (2.0 * step)
        assert_allclose(robot.velocity_product_acceleration(q, v), expected, rtol=1e-6, atol=1e-6)


def test_wrench_and_joint_torques_do_the_same_virtual_work(robot: Robot, postures: Array) -> None:
    rng = np.random.default_rng(1)
    for q in postures:
        wrench, dq = rng.normal(size=6), 1e-7 * rng.normal(size=JOINTS)
        moved = robot.flange_pose(q + dq).position_base - robot.flange_pose(q - dq).position_base
        force_only = np.concatenate([wrench[:3], np.zeros(3)])
        work = robot.joint_torques_of_wrench(q, force_only) @ dq
        assert work == pytest.approx(wrench[:3] @ moved / 2, abs=1e-13)


def test_wrench_comes_back_from_its_joint_torques(robot: Robot) -> None:
    wrench = np.array([1.0, -2.0, 15.0, 0.3, -0.1, 0.2])
    tau = robot.joint_torques_of_wrench(READY, wrench)
    assert_allclose(robot.wrench_of_joint_torques(READY, tau), wrench, atol=1e-10)


def test_wrench_stays_bounded_where_the_arm_is_stretched(robot: Robot) -> None:
    stretched = np.array([0.0, 0.0, 0.0, -0.0698, 0.0, 1.5, 0.0])
    assert np.linalg.svd(robot.flange_jacobian(stretched))[1][-1] < 0.05
    wrench = robot.wrench_of_joint_torques(stretched, np.full(JOINTS, 1.0))
    assert np.linalg.norm(wrench) < np.sqrt(JOINTS) / 0.05


def test_a_wrench_is_damped_as_its_singular_values_say(robot: Robot, postures: Array) -> None:
    stretched = np.outer([0.0, 0.01, 0.1, 0.5], np.array([0.3, 0.0, -0.2, -0.0698, 0.1, 1.5, 0.0]))
    q = np.concatenate([postures, stretched])
    tau = np.random.default_rng(4).normal(size=q.shape)
    u, s, vt = np.linalg.svd([robot.flange_jacobian(each) for each in q], full_matrices=False)
    assert (s.min(axis=1) < SINGULAR_BELOW).any()
    assert (s.min(axis=1) > SINGULAR_BELOW).any()
    damping = np.maximum(0.0, SINGULAR_BELOW**2 - s**2)
    expected = np.einsum("nij,nj,njk,nk->ni", u, s / (s**2 + damping), vt, tau)
    assert_allclose(robot.wrenches_of_joint_torques(q, tau), expected, rtol=1e-9, atol=1e-9)


def test_batches_equal_single_calls(robot: Robot, postures: Array) -> None:
    positions, quaternions = robot.flange_poses(postures)
    tips, _ = robot.hand_tcp_poses(postures)
    tau = np.random.default_rng(2).normal(size=postures.shape)
    wrenches = robot.wrenches_of_joint_torques(postures, tau)
    for i, q in enumerate(postures):
        pose = robot.flange_pose(q)
        assert_allclose(positions[i], pose.position_base, atol=1e-14)
        assert_allclose(tips[i], robot.hand_tcp_pose(q).position_base, atol=1e-14)
        assert abs(quaternions[i] @ pose.orientation_base) == pytest.approx(1.0)
        assert_allclose(wrenches[i], robot.wrench_of_joint_torques(q, tau[i]), atol=1e-12)


def test_a_row_has_the_same_bits_in_every_batch(robot: Robot, postures: Array) -> None:
    tau = np.random.default_rng(3).normal(size=postures.shape)
    positions, wrenches = robot.flange_poses(postures)[0], robot.wrenches_of_joint_torques(postures, tau)
    for row in np.split(np.arange(len(postures)), [1, 3, 8]):
        assert_array_equal(robot.flange_poses(postures[row])[0], positions[row])
        assert_array_equal(robot.wrenches_of_joint_torques(postures[row], tau[row]), wrenches[row])


def test_quaternions_of_a_motion_do_not_jump(robot: Robot) -> None:
    # With the tool pointing down the scalar part is about 0 and its sign is rounding.
    wobble = 0.05 * np.sin(np.linspace(0, 20, 200))[:, None] * np.ones(JOINTS)
    _, quaternions = robot.flange_poses(READY + wobble)
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.05


def test_gravity_torques_are_the_slope_of_potential_energy(robot: Robot, postures: Array) -> None:
    for q in postures[:6]:
        assert_allclose(robot.gravity_torques(q), numeric(robot.potential_energy, q), atol=1e-5)


def test_motion_obeys_mass_times_acceleration_plus_the_rest(robot: Robot, postures: Array) -> None:
    rng = np.random.default_rng(3)
    for q in postures:
        v, tau = rng.normal(size=JOINTS), rng.normal(scale=10, size=JOINTS)
        acceleration = robot.forward_dynamics(q, v, tau)
        mass = robot.mass_matrix(q)
        assert_allclose(mass @ acceleration + robot.nonlinear_torques(q, v), tau, atol=1e-9)
        assert_allclose(mass, mass.T, atol=1e-14)
        assert np.linalg.eigvalsh(mass)[0] > 0


def test_hand_dynamics_collects_what_the_single_calls_say(robot: Robot, postures: Array) -> None:
    for q in postures:
        hand, pose = robot.hand_dynamics(q), robot.flange_pose(q)
        assert_allclose(hand.position_base, pose.position_base, atol=1e-14)
        assert_allclose(hand.rotation_base, rotation(pose.orientation_base), atol=1e-12)
        assert_allclose(hand.jacobian, robot.flange_jacobian(q), atol=1e-14)
        assert_allclose(hand.mass_matrix, robot.mass_matrix(q), atol=1e-14)


def test_instances_share_nothing(postures: Array) -> None:
    first, second = load_panda(), load_panda()
    held = first.hand_dynamics(postures[0])
    second.hand_dynamics(postures[1])
    first.hand_dynamics(postures[1])
    assert_allclose(held.mass_matrix, load_panda().mass_matrix(postures[0]), atol=1e-14)


def test_inverse_kinematics_reaches_a_pose_near_where_it_started(robot: Robot) -> None:
    goal = np.array([0.4, 0.15, 0.3])
    q = robot.inverse_kinematics(goal, TOOL_DOWN, READY)
    assert_allclose(robot.flange_pose(q).position_base, goal, atol=1e-5)
    assert abs(robot.flange_pose(q).orientation_base @ TOOL_DOWN) == pytest.approx(1.0)
    assert np.all((robot.lower_limits <= q) & (q <= robot.upper_limits))
    assert np.abs(q - READY).max() < 1.0


def test_joints_along_a_way_reach_each_of_its_poses(robot: Robot) -> None:
    start = np.array(robot.postures[0])
    (place,), (turn,) = robot.flange_poses(start[None])
    poses = np.tile(np.concatenate([place, turn]), (50, 1))
    poses[:, 1] += np.linspace(0.0, 0.2, len(poses))
    places, turns = robot.flange_poses(robot.joints_along(poses, start))
    assert_allclose(places, poses[:, :3], atol=2e-9)
    assert_allclose(np.abs(np.vecdot(turns, poses[:, 3:])), 1.0, atol=1e-15)


def test_a_way_from_a_stretched_arm_names_the_pose(robot: Robot) -> None:
    """It was called a singular matrix."""
    stretched = np.zeros(JOINTS)
    (place,), (turn,) = robot.flange_poses(stretched[None])
    with pytest.raises(ReachError, match="cannot be reached from the one before it"):
        robot.joints_along([[*place[:2], place[2] - 1e-3, *turn]], stretched)


def test_inverse_kinematics_says_how_far_an_unreachable_pose_is(robot: Robot) -> None:
    with pytest.raises(ReachError, match=r"\[1.5, 0.0, 0.3\] m: [0-9.]+ mm .* left"):
        robot.inverse_kinematics([1.5, 0.0, 0.3], TOOL_DOWN, READY)


@pytest.mark.parametrize("wrong", [np.zeros(6), np.zeros((7, 7)), 0.0])
def test_wrong_shapes_are_named(robot: Robot, wrong: Array) -> None:
    with pytest.raises(ValueError, match="expected"):
        robot.flange_pose(wrong)
    with pytest.raises(ValueError, match="expected"):
        robot.flange_poses(np.zeros((3, 6)))


def test_limits_are_the_published_ones(robot: Robot) -> None:
    assert_allclose(robot.lower_limits[[3, 5]], [-3.0718, -0.0175])
    assert_allclose(robot.upper_limits[[3, 5]], [-0.0698, 3.7525])
    assert_allclose(robot.torque_limits, [87] * 4 + [12] * 3)
    assert_allclose(robot.velocity_limits, [2.175] * 4 + [2.61] * 3)
