"""Kinematics and dynamics of a robot arm, the only module that imports pinocchio.

Rules of the room: plain float64 arrays in and out; frames stand in the names; a quaternion is x y z w; a
wrench is force over moment, and acts on the robot, at the flange, in base axes. Joint positions
are (n,) [rad], n the number of joints.

A `Robot` keeps pinocchio's scratch `Data`, so one instance serves one thread; instances share nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dposv

from caesura_protocol.robots import RobotDescription, RobotError, robot_description

Array = NDArray[np.float64]

# Singular values of the Jacobian below this are damped: far from singularities the smallest is above 0.1.
SINGULAR_BELOW = 0.05

ALONG_STEPS, ALONG_TOLERANCE = 12, 1e-9  # [m], [rad]
ALONG_LAST = 1e-5  # [m], [rad] from which one more step, whose error is squared, is within the tolerance
IK_STEPS = 200
IK_TOLERANCE = 1e-6  # [m], [rad]
IK_STEP_LIMIT = 0.3  # [rad] norm of one joint step
IK_DAMPING = 1e-4
IK_CENTRING = 0.02  # pull towards the start posture, in the null space
FOUND_M, FOUND_RAD = 1e-5, 1e-4  # left of a pose that `find_joints` has found
START_POSTURES, START_SEED = 1000, 0  # drawn within the joint limits, from which `find_joints` may start
STARTS_TRIED, START_STEPS = 20, 40  # the nearest of them; steps from each
METRES_PER_RAD = 0.3  # of turn, where the nearest is sought

REVOLUTE = {"JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned"}  # with limits
SLACK_RAD = 1e-3  # by which a posture may be beyond a limit: it is written with few digits


class ReachError(ValueError):
    """The pose cannot be reached within the joint limits; the message names the distance that is left."""


@dataclass(frozen=True)
class FlangePose:
    """A frame in the base frame: position_base (3,) [m], orientation_base (4,) x y z w."""

    position_base: Array
    orientation_base: Array


class HandDynamics(NamedTuple):
    """The quantities at the flange for one step of a simulation.

    position_base: (3,) [m]; rotation_base: (3, 3) flange to base; jacobian: (6, n), linear rows first, base
    axes; mass_matrix: (n, n) [kg m²] with the motors' inertia.
    """

    position_base: Array
    rotation_base: Array
    jacobian: Array
    mass_matrix: Array


class Robot:
    """An arm of n joints from the base to the flange, with what is mounted on it. Made by `load_robot`."""

    def __init__(self, model: pin.Model, description: RobotDescription) -> None:
        self.description = description
        self._model = model
        self._data = model.createData()
        self._flange = model.getFrameId(description.flange)
        self._tcp = self._flange if description.tool is None else model.getFrameId(description.tool)

    @property
    def joints(self) -> int:
        """The number of joints."""
        return int(self._model.nq)

    @property
    def postures(self) -> tuple[Array, ...]:
        """Joint positions from which an inverse kinematics may start, (n,) [rad] each."""
        return tuple(np.array(posture) for posture in self.description.postures)

    @property
    def friction_nm(self) -> Array:
        """Coulomb friction of the joints, (n,) [Nm]."""
        return np.array(self.description.friction_nm)

    @property
    def lower_limits(self) -> Array:
        """Lowest joint positions, (n,) [rad]."""
        return np.array(self._model.lowerPositionLimit)

    @property
    def upper_limits(self) -> Array:
        """Highest joint positions, (n,) [rad]."""
        return np.array(self._model.upperPositionLimit)

    @property
    def velocity_limits(self) -> Array:
        """Joint speeds that the robot never exceeds, (n,) [rad/s]."""
        return np.array(self._model.velocityLimit)

    @property
    def acceleration_limits(self) -> Array:
        """Joint accelerations that the robot never exceeds, (n,) [rad/s²]."""
        return np.array(self.description.acceleration_limits)

    @property
    def jerk_limits(self) -> Array:
        """Joint jerks that the robot never exceeds, (n,) [rad/s³]."""
        return np.array(self.description.jerk_limits)

    @property
    def torque_limits(self) -> Array:
        """Joint torques that the robot never exceeds, (n,) [Nm]."""
        return np.array(self._model.effortLimit)

    def flange_pose(self, q: ArrayLike) -> FlangePose:
        """Pose of the flange at joint positions q."""
        return self._pose(self._checked(q), self._flange)

    def hand_tcp_pose(self, q: ArrayLike) -> FlangePose:
        """Pose of the point between the fingertips at joint positions q."""
        return self._pose(self._checked(q), self._tcp)

    def flange_poses(self, q: ArrayLike) -> tuple[Array, Array]:
        """Flange poses of q (m, n): positions (m, 3) [m] and quaternions (m, 4).

        A quaternion and its negative turn alike; each row takes the sign nearer to the row before it, so that
        the columns are as smooth as the motion.
        """
        return self._poses(q, self._flange)

    def hand_tcp_poses(self, q: ArrayLike) -> tuple[Array, Array]:
        """Poses of the point between the fingertips, as `flange_poses`."""
        return self._poses(q, self._tcp)

    def flange_jacobian(self, q: ArrayLike) -> Array:
        """Twist of the flange per joint velocity, (6, n): linear rows first, base axes."""
        return self._flange_jacobian(self._checked(q))

    def joint_torques_of_wrench(self, q: ArrayLike, wrench_base: ArrayLike) -> Array:
        """Return the joint torques of a wrench (6,) [N, Nm] on the flange, Jᵀw, (n,) [Nm]. Thesis 2.2."""
        torques: Array = self.flange_jacobian(q).T @ np.asarray(wrench_base, dtype=np.float64)
        return torques

    def wrench_of_joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Wrench (6,) [N, Nm] on the flange that explains the external joint torques tau (n,) [Nm] best.

        Least squares through Jᵀ. Near a singularity a wrench component leaves no trace in the torques and
        would come out arbitrarily large; it is damped towards 0 instead, more the smaller the singular value
        of J gets below `SINGULAR_BELOW` (Nakamura & Hanafusa 1986). Away from singularities exact.
        """
        wrench: Array = self.wrenches_of_joint_torques(self._checked(q)[None], self._checked(tau)[None])[0]
        return wrench

    def wrenches_of_joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Return wrenches (m, 6) [N, Nm] of q (m, n) [rad], tau (m, n) [Nm], as `wrench_of_joint_torques`."""
        q, tau = self._checked_rows(q), self._checked_rows(tau)
        jacobians = np.array([self._flange_jacobian(row) for row in q]).reshape(-1, 6, self.joints)
        squares, axes = np.linalg.eigh(jacobians @ jacobians.mT)  # squared singular values of J
        felt = np.matvec(axes.mT, np.matvec(jacobians, tau)) / np.maximum(squares, SINGULAR_BELOW**2)
        wrenches: Array = np.matvec(axes, felt)
        return wrenches

    def gravity_torques(self, q: ArrayLike) -> Array:
        """Joint torques that hold the arm still at q, (n,) [Nm]."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, self._checked(q)))

    def potential_energy(self, q: ArrayLike) -> float:
        """Potential energy of arm and hand at q [J], zero at the base's origin."""
        return float(pin.computePotentialEnergy(self._model, self._data, self._checked(q)))

    def nonlinear_torques(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Gravity, Coriolis and centrifugal torques at q and joint velocity v [rad/s], (n,) [Nm]."""
        return np.array(pin.nonLinearEffects(self._model, self._data, self._checked(q), self._checked(v)))

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space inertia with the motors' share, (n, n) [kg m²]."""
        return np.array(pin.crba(self._model, self._data, self._checked(q)))

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Joint acceleration (n,) [rad/s²] under joint torques tau [Nm], gravity acting."""
        return np.array(
            pin.aba(self._model, self._data, self._checked(q), self._checked(v), self._checked(tau))
        )

    def hand_dynamics(self, q: Array) -> HandDynamics:
        """Flange pose, Jacobian and mass matrix at q in one pass, for the inner loop of a simulation."""
        model, data = self._model, self._data
        mass = pin.crba(model, data, q)
        pin.computeJointJacobians(model, data, q)
        pose = pin.updateFramePlacement(model, data, self._flange)
        jacobian = pin.getFrameJacobian(model, data, self._flange, pin.LOCAL_WORLD_ALIGNED)
        return HandDynamics(pose.translation.copy(), pose.rotation.copy(), jacobian, mass)

    def velocity_product_acceleration(self, q: Array, v: Array) -> Array:
        """Acceleration (6,) of the flange at joint velocity v while no joint accelerates, J̇ v; base axes."""
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q, v, np.zeros(self.joints))
        motion = pin.getFrameClassicalAcceleration(model, data, self._flange, pin.LOCAL_WORLD_ALIGNED)
        return np.array(motion.vector)

    def inverse_kinematics(
        self, position_base: ArrayLike, orientation_base: ArrayLike, q_start: ArrayLike
    ) -> Array:
        """Joint positions (n,) that bring the flange to a pose, near q_start and within the joint limits.

        position_base: (3,) [m]; orientation_base: (4,) x y z w. Damped least squares with the redundant
        degree of freedom pulled towards q_start. Raises ReachError with the distance that is left.
        """
        q, left, turn = self.nearest_joints(position_base, orientation_base, q_start)
        if np.hypot(left, turn) < IK_TOLERANCE:
            return q
        raise ReachError(
            f"flange position {np.round(np.asarray(position_base), 3).tolist()} m: {1000 * left:.1f} mm and "
            f"{turn:.3f} rad are left after {IK_STEPS} steps, expected less than {IK_TOLERANCE:g}"
        )

    def nearest_joints(
        self, position_base: ArrayLike, orientation_base: ArrayLike, q_start: ArrayLike
    ) -> tuple[Array, float, float]:
        """Return joints (n,) [rad] as near to a pose as IK_STEPS steps get, and the error [m], [rad].

        The arguments are those of `inverse_kinematics`.
        """
        goal = pin.XYZQUATToSE3(np.concatenate([np.asarray(position_base), np.asarray(orientation_base)]))
        home = self._checked(q_start)
        q, error = home.copy(), np.full(6, np.inf)
        for _ in range(IK_STEPS):
            error = self._pose_error(q, goal)
            if np.linalg.norm(error) < IK_TOLERANCE:
                break
            q = np.clip(q + self._ik_step(q, error, home), self.lower_limits, self.upper_limits)
        return q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))

    def find_joints(self, position_base: ArrayLike, orientation_base: ArrayLike) -> Array:
        """Joint positions (n,) [rad] that bring the flange to a pose, from any posture; within the limits.

        position_base: (3,) [m]; orientation_base: (4,) x y z w. Starts at the described postures, then at
        those of a seeded draw whose flanges are nearest to the pose. A step leaves out joints that it would
        push beyond a limit. The same pose gives the same joints. Raises ReachError with what is left.
        """
        place, turned = np.asarray(position_base, dtype=np.float64), np.asarray(orientation_base, np.float64)
        starts, positions, quaternions = self._start_postures
        angles = 2.0 * np.arccos(np.clip(np.abs(quaternions @ turned), 0.0, 1.0))
        distances = np.linalg.norm(positions - place, axis=1) + METRES_PER_RAD * angles
        nearest = starts[np.argsort(distances, kind="stable")[:STARTS_TRIED]]
        goal, best = pin.XYZQUATToSE3(np.concatenate([place, turned])), np.full(2, np.inf)
        for start in (*self.postures, *nearest):
            q, left, turn = self._bounded_joints(goal, start)
            if left < FOUND_M and turn < FOUND_RAD:
                return q
            best = min(best, np.array([left, turn]), key=lambda pair: float(pair.sum()))
        raise ReachError(
            f"flange position {np.round(place, 3).tolist()} m: {1000 * best[0]:.1f} mm and {best[1]:.3f} rad "
            f"are left from {len(self.postures) + STARTS_TRIED} postures, "
            f"expected less than {1000 * FOUND_M:g} mm and {FOUND_RAD:g} rad"
        )

    def joints_along(self, poses: ArrayLike, q_start: ArrayLike) -> Array:
        """Return joints (m, n) [rad] along poses (m, 7), each by the least motion.

        poses: position [m] and quaternion; q_start: near the first pose. Joint limits are not checked. Raises
        ReachError if a pose is out of reach, or the step to it is too long for `ALONG_STEPS` Newton steps
        q ← q + J⁺ error.
        """
        q = self._checked(q_start).copy()
        goals = np.asarray(poses, dtype=np.float64)
        found = np.empty((len(goals), self.joints))
        for k, pose in enumerate(goals):
            goal = pin.XYZQUATToSE3(pose)
            for _ in range(ALONG_STEPS):
                error = self._pose_error(q, goal)
                left = error @ error
                if left < ALONG_TOLERANCE**2:
                    break
                jacobian = self._flange_jacobian(q)
                _, multipliers, singular = dposv(jacobian @ jacobian.T, error)
                if singular:
                    raise _unreachable(pose)
                q = q + jacobian.T @ multipliers
                if left < ALONG_LAST**2:
                    break
            else:
                raise _unreachable(pose)
            found[k] = q
        return found

    def _pose_error(self, q: Array, goal: pin.SE3) -> Array:
        pin.forwardKinematics(self._model, self._data, q)
        pose = pin.updateFramePlacement(self._model, self._data, self._flange)
        turn = pin.log3(goal.rotation @ pose.rotation.T)
        return np.concatenate([goal.translation - pose.translation, turn])

    def _ik_step(self, q: Array, error: Array, home: Array) -> Array:
        jacobian = self.flange_jacobian(q)
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + IK_DAMPING * np.eye(6))
        null_space = np.eye(self.joints) - np.linalg.pinv(jacobian) @ jacobian
        step = inverse @ error + IK_CENTRING * null_space @ (home - q)
        limited: Array = step * min(1.0, IK_STEP_LIMIT / max(float(np.linalg.norm(step)), 1e-12))
        return limited

    @cached_property
    def _start_postures(self) -> tuple[Array, Array, Array]:
        """Postures (m, n) within the limits, and their flange poses: (m, 3) and (m, 4)."""
        rng = np.random.default_rng(START_SEED)
        size = (START_POSTURES, self.joints)
        postures: Array = rng.uniform(self.lower_limits, self.upper_limits, size=size)
        return (postures, *self._poses(postures, self._flange))

    def _bounded_joints(self, goal: pin.SE3, start: Array) -> tuple[Array, float, float]:
        """Return joints (n,) near a pose, and the error [m], [rad]; joints at a limit are not pushed on."""
        low, high = self.lower_limits, self.upper_limits
        q, error = np.clip(start, low, high), np.full(6, np.inf)
        for _ in range(START_STEPS):
            error = self._pose_error(q, goal)
            if np.linalg.norm(error) < IK_TOLERANCE:
                break
            jacobian, step = self._flange_jacobian(q), np.zeros(self.joints)
            free = np.ones(self.joints, dtype=bool)
            for _ in range(self.joints):
                movable = jacobian * free
                step = movable.T @ np.linalg.solve(movable @ movable.T + IK_DAMPING * np.eye(6), error)
                pushed = free & (((q <= low) & (step < 0.0)) | ((q >= high) & (step > 0.0)))
                if not pushed.any():
                    break
                free &= ~pushed
            step *= min(1.0, IK_STEP_LIMIT / max(float(np.linalg.norm(step)), 1e-12))
            q = np.clip(q + step, low, high)
        return q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))

    def _checked(self, values: ArrayLike) -> Array:
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (self.joints,):
            raise ValueError(f"joint array has shape {array.shape}, expected ({self.joints},)")
        return array

    def _checked_rows(self, values: ArrayLike) -> Array:
        array = np.asarray(values, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != self.joints:
            raise ValueError(f"joint array has shape {array.shape}, expected (n, {self.joints})")
        return array

    def _pose(self, q: Array, frame: int) -> FlangePose:
        values = self._placement(q, frame)
        return FlangePose(values[:3], values[3:])

    def _poses(self, q: ArrayLike, frame: int) -> tuple[Array, Array]:
        values = np.array([self._placement(row, frame) for row in self._checked_rows(q)]).reshape(-1, 7)
        return values[:, :3], _smooth_signs(values[:, 3:])

    def _placement(self, q: Array, frame: int) -> Array:
        """Return position [m] and quaternion x y z w of a frame, (7,)."""
        pin.forwardKinematics(self._model, self._data, q)
        placement: Array = pin.SE3ToXYZQUAT(pin.updateFramePlacement(self._model, self._data, frame))
        return placement

    def _flange_jacobian(self, q: Array) -> Array:
        jacobian: Array = pin.computeFrameJacobian(
            self._model, self._data, q, self._flange, pin.LOCAL_WORLD_ALIGNED
        )
        return jacobian


def _unreachable(pose: Array) -> ReachError:
    return ReachError(
        f"flange position {np.round(pose[:3], 3).tolist()} m cannot be reached from the one before it"
    )


def load_robot(robot: str | RobotDescription) -> Robot:
    """Load a robot by its description, its name or the path of its `robot.json`.

    Raises RobotError where it is not known, or where its URDF does not have the joints and frames stated.
    """
    description = robot_description(robot) if isinstance(robot, str) else robot
    path = description.urdf_path
    try:
        model = pin.buildModelFromUrdf(str(path))
    except ValueError as error:
        raise RobotError(f"{path}: not a valid URDF: {error}") from error
    joints = tuple(model.names)[1:]  # the first is pinocchio's own, of the world
    if joints != description.joints:
        stated = (
            f"{description.name} states {', '.join(description.joints)}: expected the same in the same "
            "order. Make other joints, such as a gripper's, fixed in the URDF"
        )
        raise RobotError(f"{path}: movable joints are {', '.join(joints) or 'none'}, but {stated}")
    for name, joint in zip(joints, tuple(model.joints)[1:], strict=True):
        if (kind := joint.shortname()) not in REVOLUTE:
            raise RobotError(
                f"{path}: joint {name} is {kind.removeprefix('JointModel')}, expected revolute with "
                "limits; fixed where it is no joint of the arm"
            )
    for frame in filter(None, (description.flange, description.tool)):
        if not model.existFrame(frame):
            raise RobotError(f"{path}: has no frame {frame!r}, which {description.name} states")
    _check_postures(model, description)
    if description.motor_inertia:
        model.armature = np.array(description.motor_inertia)
    return Robot(model, description)


def _check_postures(model: pin.Model, description: RobotDescription) -> None:
    """Raise RobotError for a posture that the joints cannot reach."""
    for joint, name in enumerate(description.joints):
        lowest, highest = model.lowerPositionLimit[joint], model.upperPositionLimit[joint]
        for number, posture in enumerate(description.postures):
            if not lowest - SLACK_RAD <= posture[joint] <= highest + SLACK_RAD:
                raise RobotError(
                    f"{description.folder}: postures[{number}] has {posture[joint]:g} rad for joint {name}, "
                    f"expected {lowest:.4g} to {highest:.4g}: are they degrees?"
                )


def load_panda() -> Robot:
    """Load a Panda with its hand."""
    return load_robot("panda")


def _smooth_signs(quaternions: Array) -> Array:
    turned = np.vecdot(quaternions[1:], quaternions[:-1]) < 0.0
    if turned.any():
        quaternions[1:] *= np.where(turned, -1.0, 1.0).cumprod()[:, None]
    return quaternions
