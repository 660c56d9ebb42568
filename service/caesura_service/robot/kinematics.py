"""Kinematics and dynamics of the Panda, the only module that imports pinocchio.

Rules of the room: plain float64 arrays in and out; frames stand in the names; a quaternion is x y z w; a
wrench is force over moment, and acts on the robot, at the flange, in base axes. Joint positions
are (7,) [rad].

A `Robot` keeps pinocchio's scratch `Data`, so one instance serves one thread; instances share nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from caesura_service.constants import JOINTS

Array = NDArray[np.float64]

FLANGE, HAND_TCP = "panda_flange", "panda_hand_tcp"

# [kg m²] motor inertia seen at the joint, as Franka states it for these drives (published in Drake's model).
REFLECTED_INERTIA = (
    0.605721456,
    0.605721456,
    0.462474144,
    0.462474144,
    0.205544064,
    0.205544064,
    0.205544064,
)

# Joint accelerations [rad/s²] and jerks [rad/s³] that a Panda never exceeds; of its flange [m/s², m/s³].
# Franka's FCI documentation, "Limits for Panda" (https://frankaemika.github.io/docs/control_parameters.html).
ACCELERATION_LIMITS = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
JERK_LIMITS = (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
FLANGE_ACCELERATION_LIMIT, FLANGE_JERK_LIMIT = 13.0, 6500.0

# Singular values of the Jacobian below this are damped: far from singularities the smallest is above 0.1.
SINGULAR_BELOW = 0.05

ALONG_STEPS, ALONG_TOLERANCE = 12, 1e-9  # [m], [rad]
IK_STEPS = 200
IK_TOLERANCE = 1e-6  # [m], [rad]
IK_STEP_LIMIT = 0.3  # [rad] norm of one joint step
IK_DAMPING = 1e-4
IK_CENTRING = 0.02  # pull towards the start posture, in the null space


class ReachError(ValueError):
    """The pose cannot be reached within the joint limits; the message names the distance that is left."""


@dataclass(frozen=True)
class FlangePose:
    """A frame in the base frame: position_base (3,) [m], orientation_base (4,) x y z w."""

    position_base: Array
    orientation_base: Array


@dataclass(frozen=True)
class HandDynamics:
    """What one step of a simulation needs to know at the flange.

    position_base: (3,) [m]; rotation_base: (3, 3) flange to base; jacobian: (6, 7), linear rows first, base
    axes; mass_matrix: (7, 7) [kg m²] with the motors' inertia.
    """

    position_base: Array
    rotation_base: Array
    jacobian: Array
    mass_matrix: Array


class Robot:
    """Seven joints from the base to the flange, with a hand on it. Made by `load_panda`."""

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._data = model.createData()
        self._flange = model.getFrameId(FLANGE)
        self._tcp = model.getFrameId(HAND_TCP)

    @property
    def lower_limits(self) -> Array:
        """Lowest joint positions, (7,) [rad]."""
        return np.array(self._model.lowerPositionLimit)

    @property
    def upper_limits(self) -> Array:
        """Highest joint positions, (7,) [rad]."""
        return np.array(self._model.upperPositionLimit)

    @property
    def velocity_limits(self) -> Array:
        """Joint speeds that the robot never exceeds, (7,) [rad/s]."""
        return np.array(self._model.velocityLimit)

    @property
    def acceleration_limits(self) -> Array:
        """Joint accelerations that the robot never exceeds, (7,) [rad/s²]."""
        return np.array(ACCELERATION_LIMITS)

    @property
    def jerk_limits(self) -> Array:
        """Joint jerks that the robot never exceeds, (7,) [rad/s³]."""
        return np.array(JERK_LIMITS)

    @property
    def torque_limits(self) -> Array:
        """Joint torques that the robot never exceeds, (7,) [Nm]."""
        return np.array(self._model.effortLimit)

    def flange_pose(self, q: ArrayLike) -> FlangePose:
        """Pose of the flange at joint positions q."""
        return self._pose(_joints(q), self._flange)

    def hand_tcp_pose(self, q: ArrayLike) -> FlangePose:
        """Pose of the point between the fingertips at joint positions q."""
        return self._pose(_joints(q), self._tcp)

    def flange_poses(self, q: ArrayLike) -> tuple[Array, Array]:
        """Flange poses of q (n, 7): positions (n, 3) [m] and quaternions (n, 4).

        A quaternion and its negative turn alike; each row takes the sign nearer to the row before it, so that
        the columns are as smooth as the motion.
        """
        return self._poses(q, self._flange)

    def hand_tcp_poses(self, q: ArrayLike) -> tuple[Array, Array]:
        """Poses of the point between the fingertips, as `flange_poses`."""
        return self._poses(q, self._tcp)

    def flange_jacobian(self, q: ArrayLike) -> Array:
        """Twist of the flange per joint velocity, (6, 7): linear rows first, base axes."""
        return self._flange_jacobian(_joints(q))

    def joint_torques_of_wrench(self, q: ArrayLike, wrench_base: ArrayLike) -> Array:
        """Joint torques that a wrench (6,) [N, Nm] on the flange amounts to, Jᵀw, (7,) [Nm]. Thesis 2.2."""
        torques: Array = self.flange_jacobian(q).T @ np.asarray(wrench_base, dtype=np.float64)
        return torques

    def wrench_of_joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Wrench (6,) [N, Nm] on the flange that explains the external joint torques tau (7,) [Nm] best.

        Least squares through Jᵀ. Near a singularity a wrench component leaves no trace in the torques and
        would come out arbitrarily large; it is damped towards 0 instead, more the smaller the singular value
        of J gets below `SINGULAR_BELOW` (Nakamura & Hanafusa 1986). Away from singularities exact.
        """
        wrench: Array = self.wrenches_of_joint_torques(_joints(q)[None], _joints(tau)[None])[0]
        return wrench

    def wrenches_of_joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Wrenches (n, 6) of q (n, 7) and tau (n, 7), as `wrench_of_joint_torques`."""
        q, tau = _rows(q), _rows(tau)
        jacobians = np.array([self._flange_jacobian(row) for row in q]).reshape(-1, 6, JOINTS)
        squares, axes = np.linalg.eigh(jacobians @ jacobians.mT)  # squared singular values of J
        felt = np.matvec(axes.mT, np.matvec(jacobians, tau)) / np.maximum(squares, SINGULAR_BELOW**2)
        wrenches: Array = np.matvec(axes, felt)
        return wrenches

    def gravity_torques(self, q: ArrayLike) -> Array:
        """Joint torques that hold the arm still at q, (7,) [Nm]."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, _joints(q)))

    def potential_energy(self, q: ArrayLike) -> float:
        """Potential energy of arm and hand at q [J], zero at the base's origin."""
        return float(pin.computePotentialEnergy(self._model, self._data, _joints(q)))

    def nonlinear_torques(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Gravity, Coriolis and centrifugal torques at q and joint velocity v [rad/s], (7,) [Nm]."""
        return np.array(pin.nonLinearEffects(self._model, self._data, _joints(q), _joints(v)))

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space inertia with the motors' share, (7, 7) [kg m²]."""
        return np.array(pin.crba(self._model, self._data, _joints(q)))

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Joint acceleration (7,) [rad/s²] under joint torques tau [Nm], gravity acting."""
        return np.array(pin.aba(self._model, self._data, _joints(q), _joints(v), _joints(tau)))

    def hand_dynamics(self, q: Array) -> HandDynamics:
        """Flange pose, Jacobian and mass matrix at q in one pass, for the inner loop of a simulation."""
        model, data = self._model, self._data
        mass = pin.crba(model, data, q)
        pin.computeJointJacobians(model, data, q)
        pose = pin.updateFramePlacement(model, data, self._flange)
        jacobian = pin.getFrameJacobian(model, data, self._flange, pin.LOCAL_WORLD_ALIGNED)
        return HandDynamics(pose.translation.copy(), pose.rotation.copy(), jacobian, mass.copy())

    def inverse_kinematics(
        self, position_base: ArrayLike, orientation_base: ArrayLike, q_start: ArrayLike
    ) -> Array:
        """Joint positions (7,) that bring the flange to a pose, near q_start and within the joint limits.

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
        """As `inverse_kinematics`: joints (7,) as near to the pose as it gets; what is left [m], [rad]."""
        goal = pin.XYZQUATToSE3(np.concatenate([np.asarray(position_base), np.asarray(orientation_base)]))
        home = _joints(q_start)
        q, error = home.copy(), np.full(6, np.inf)
        for _ in range(IK_STEPS):
            error = self._pose_error(q, goal)
            if np.linalg.norm(error) < IK_TOLERANCE:
                break
            q = np.clip(q + self._ik_step(q, error, home), self.lower_limits, self.upper_limits)
        return q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))

    def joints_along(self, poses: ArrayLike, q_start: ArrayLike) -> Array:
        """Joints (n, 7) [rad] along poses (n, 7), position [m] and quaternion, each by the least motion.

        q_start: near the first pose. Joint limits are not looked at. Raises ReachError where a pose is out of
        reach, or where the step to it is too long for `ALONG_STEPS` Newton steps q ← q + J⁺ error.
        """
        q = _joints(q_start).copy()
        found = np.empty((len(rows := _rows(poses)), JOINTS))
        for k, pose in enumerate(rows):
            goal = pin.XYZQUATToSE3(pose)
            for _ in range(ALONG_STEPS):
                error = self._pose_error(q, goal)
                if error @ error < ALONG_TOLERANCE**2:
                    break
                jacobian = self._flange_jacobian(q)
                q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T, error)
            else:
                raise ReachError(
                    f"flange position {np.round(pose[:3], 3).tolist()} m cannot be reached on its way"
                )
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
        null_space = np.eye(JOINTS) - np.linalg.pinv(jacobian) @ jacobian
        step = inverse @ error + IK_CENTRING * null_space @ (home - q)
        limited: Array = step * min(1.0, IK_STEP_LIMIT / max(float(np.linalg.norm(step)), 1e-12))
        return limited

    def _pose(self, q: Array, frame: int) -> FlangePose:
        values = self._placement(q, frame)
        return FlangePose(values[:3], values[3:])

    def _poses(self, q: ArrayLike, frame: int) -> tuple[Array, Array]:
        values = np.array([self._placement(row, frame) for row in _rows(q)]).reshape(-1, 7)
        return values[:, :3], _smooth_signs(values[:, 3:])

    def _placement(self, q: Array, frame: int) -> Array:
        """Position and quaternion, (7,)."""
        pin.forwardKinematics(self._model, self._data, q)
        placement: Array = pin.SE3ToXYZQUAT(pin.updateFramePlacement(self._model, self._data, frame))
        return placement

    def _flange_jacobian(self, q: Array) -> Array:
        jacobian: Array = pin.computeFrameJacobian(
            self._model, self._data, q, self._flange, pin.LOCAL_WORLD_ALIGNED
        )
        return jacobian


def load_panda() -> Robot:
    """Load a Panda with its hand, from the package's own description."""
    model = pin.buildModelFromUrdf(str(Path(__file__).with_name("panda.urdf")))
    model.armature = np.array(REFLECTED_INERTIA)
    return Robot(model)


def _joints(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (JOINTS,):
        raise ValueError(f"joint array has shape {array.shape}, expected ({JOINTS},)")
    return array


def _rows(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != JOINTS:
        raise ValueError(f"joint array has shape {array.shape}, expected (n, {JOINTS})")
    return array


def _smooth_signs(quaternions: Array) -> Array:
    turned = np.vecdot(quaternions[1:], quaternions[:-1]) < 0.0
    if turned.any():
        quaternions[1:] *= np.where(turned, -1.0, 1.0).cumprod()[:, None]
    return quaternions
