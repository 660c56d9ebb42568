"""From an observation to the few numbers that the rules of coaching compare with their limits.

In movement a force is one of these:

- the bias, which `bias` tracks;
- a contact that slides: across the movement, and with Coulomb friction of at most 1 against it;
- a load: downwards, while the fingers hold something, or where the gripper's state is not reported;
- a hand: it drives the movement, and does work on the robot, as nothing passive does for long;
- stray, which is what is left: a cable that pulls, or something that hangs on the tool.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.coaching.bias import DriftState, DriftTracker, Vector

Array = NDArray[np.float64]

MOVING_M_PER_S = 0.05  # slower says little of a direction
FREE_M_PER_S = 0.1  # faster than a person presses or inserts, also where the tip is turned about the flange
DRIFT_TIME_S = 10.0  # in which a bias wanders by its scale
ACROSS = 3  # observations over which a force along the movement is averaged
POSES = 5  # whose fourth difference bounds what the path between two of them may be
BETWEEN = 3.0 / 128.0  # error of the cubic through four poses, midway, by the fourth difference
AHEAD_S = 0.5  # in which a joint reaches the limit that is hinted at
ARM_EVERY = 3  # observations from one look at the joints to the next


@dataclass(frozen=True)
class ArmLimits:
    """What is known of the arm: its joint limits [rad], and its flange Jacobian at joints (n,) [rad]."""

    lower: Array
    upper: Array
    jacobian: Callable[[Array], Array]

    def nearest(self, joints: Array, speeds: Array) -> tuple[int, float]:
        """Which joint is nearest to a limit in AHEAD_S at these speeds [rad/s], and how near then [rad]."""
        later = joints + AHEAD_S * speeds
        low, high = np.minimum(joints, later), np.maximum(joints, later)
        left = np.minimum(low - self.lower, self.upper - high)
        joint = int(left.argmin())
        return joint, float(left[joint])

    def smallest_singular_value(self, joints: Array) -> float:
        """Of the flange's Jacobian [m and rad per rad]."""
        jacobian = self.jacobian(joints)
        gram = jacobian @ jacobian.T if len(jacobian) <= jacobian.shape[1] else jacobian.T @ jacobian
        return math.sqrt(max(float(np.linalg.eigvalsh(gram)[0]), 0.0))


@dataclass(frozen=True)
class CoachingSetup:
    """What a session states, as far as its rules depend on it.

    clean_wrench: the force is declared to be without the hand, and is tared; bias_n [N] scale of what tared
    free space reads; path_tolerance_m [m] of the program's paths; arm: None where it is not stated.
    """

    clean_wrench: bool
    bias_n: float
    path_tolerance_m: float
    arm: ArmLimits | None = None


class ObservedPose(NamedTuple):
    """An observation, as far as it is measured here. Vectors are in the base frame."""

    t: float  # [s]
    position: Vector  # [m] of the flange
    force: Vector  # [N] of the environment on the robot, tared
    holding: float  # 1 the fingers hold something, 0 they do not, nan unknown
    joints: Array | None = None  # (n,) [rad]
    after_gap: bool = False  # samples are missing before it


class ArmMeasures(NamedTuple):
    """What follows from the joints; nan where they are not reported."""

    singular_value: float = math.nan  # the smallest of the flange's Jacobian
    joint: int = 0  # which is nearest to a limit
    joint_left_rad: float = math.nan  # how near it is, or will be in AHEAD_S


NO_ARM = ArmMeasures()


class Measures(NamedTuple):
    """The values that rules compare with their limits; nan where there is none."""

    hand_n: float = math.nan  # force along the movement, mean over ACROSS observations
    stray_n: float = math.nan  # force in free movement that is neither contact, load nor hand
    path_error_m: float = 0.0  # what the poses may miss of the path between them
    bias_n: float = math.nan
    arm: ArmMeasures = NO_ARM


class MotionState(NamedTuple):
    """What the observations so far leave to those that follow."""

    poses: tuple[ObservedPose, ...] = ()  # the newest POSES, oldest first, none across a gap
    along: tuple[float, ...] = (0.0,) * ACROSS  # [N] force along the movement
    drift: DriftState = DriftState()
    arm: ArmMeasures = NO_ARM
    arm_age: int = 0  # observations since the joints were measured


class Meter:
    """Measures the observations of a session, one by one."""

    def __init__(self, setup: CoachingSetup) -> None:
        self._setup = setup
        variance = setup.bias_n**2
        self._tracker = DriftTracker(variance / DRIFT_TIME_S, most_n2=variance)

    def advance(self, state: MotionState, pose: ObservedPose) -> tuple[MotionState, Measures]:
        """Take one observation."""
        arm, arm_age = state.arm, state.arm_age + 1
        before = None if pose.after_gap or not state.poses else state.poses[-1]
        if self._setup.arm is not None and (before is None or arm_age >= ARM_EVERY):
            arm, arm_age = _of_arm(self._setup.arm, pose, before), 0
        if before is None:
            state = MotionState((pose,), drift=state.drift, arm=arm)
            return state, Measures(arm=arm)
        poses = (*state.poses[1 - POSES :], pose)
        path_error_m = _path_error(poses)
        if not self._setup.clean_wrench:
            return MotionState(poses, arm=arm, arm_age=arm_age), Measures(path_error_m=path_error_m, arm=arm)
        drift, along, stray_n = self._of_force(state.drift, pose, before)
        forces = (*state.along[1:], along)
        x, y, z = drift.mean
        bias_n = math.sqrt(x * x + y * y + z * z)
        measured = Measures(sum(forces) / ACROSS, stray_n, path_error_m, bias_n, arm)
        return MotionState(poses, forces, drift, arm, arm_age), measured

    def _of_force(
        self, drift: DriftState, pose: ObservedPose, before: ObservedPose
    ) -> tuple[DriftState, float, float]:
        """The bias after a force, and how much of it is a hand's, and stray [N]."""
        dt = pose.t - before.t
        (x, y, z), (x0, y0, z0) = pose.position, before.position
        dx, dy, dz = x - x0, y - y0, z - z0
        way = math.sqrt(dx * dx + dy * dy + dz * dz)
        if way < MOVING_M_PER_S * dt:
            return self._tracker.wait(drift, dt), 0.0, 0.0
        drift = self._tracker.advance(drift, pose.force, dt)
        heading, is_open = (dx / way, dy / way, dz / way), pose.holding == 0.0
        along, stray_n = _hand_and_stray(pose.force, heading, is_open)
        if way < FREE_M_PER_S * dt:
            return drift, along, 0.0
        # A tracked bias may be wrong, and so may that of the tare: what is stray, both show.
        (fx, fy, fz), (mx, my, mz) = pose.force, drift.mean
        return drift, along, min(stray_n, _hand_and_stray((fx - mx, fy - my, fz - mz), heading, is_open)[1])


def _of_arm(arm: ArmLimits, pose: ObservedPose, before: ObservedPose | None) -> ArmMeasures:
    """Measure the joints of an observation."""
    joints = pose.joints
    if joints is None:
        return NO_ARM
    speeds = np.zeros_like(joints)
    if before is not None and before.joints is not None:
        speeds = (joints - before.joints) / (pose.t - before.t)
    return ArmMeasures(arm.smallest_singular_value(joints), *arm.nearest(joints, speeds))


def _hand_and_stray(force: Vector, heading: Vector, is_open: bool) -> tuple[float, float]:
    """[N] of a force along the heading, and what neither friction nor a load explains of it.

    is_open: the fingers hold nothing. Where they may, a sinking weight does work: the level part counts too.
    """
    (x, y, z), (hx, hy, hz) = force, heading
    level = x * hx + y * hy
    along = level + z * hz
    across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    weight = -z if is_open and along < across else 0.0
    return (along if is_open else min(along, level)), max(-along - across, weight, 0.0)


def _path_error(poses: tuple[ObservedPose, ...]) -> float:
    """[m] what the cubic through four poses misses in its middle; 0 before there are POSES in a row."""
    if len(poses) < POSES:
        return 0.0
    (a, b, c), (d, e, f), (g, h, i), (j, k, m), (n, o, p) = (pose.position for pose in poses)
    x = a - 4.0 * d + 6.0 * g - 4.0 * j + n
    y = b - 4.0 * e + 6.0 * h - 4.0 * k + o
    z = c - 4.0 * f + 6.0 * i - 4.0 * m + p
    return BETWEEN * math.sqrt(x * x + y * y + z * z)
