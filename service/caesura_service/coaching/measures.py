"""Computes from each observation the few numbers that the coaching rules compare with their limits.

In movement a force is one of these:

- the bias, which `bias_drift_tracker` tracks;
- a contact that slides: across the movement, and with Coulomb friction of at most 1 against it;
- a load: downwards, while the fingers hold something, or where the gripper's state is not reported;
- a hand: it drives the movement and does work on the robot, which no passive object does for long. A load
  does work only while it sinks;
- stray, the remainder: a cable that pulls, or something that hangs on the tool.

An elastic surface also drives the tool, but returns no more work than it stored while it was pressed. So a
driving force is attributed to the surface while its stored work since the touch is above zero. Work against
friction is lost, and not stored. A hand has no such bound. A force as small as a bias is no touch, and stores
no work.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import fmean, pstdev
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.reproduced_path import TOLERANCE_RAD
from caesura_service.coaching.bias_drift_tracker import DriftState, DriftTracker, Vector
from caesura_service.coaching.interpolation_errors import POSES, interpolation_errors
from caesura_service.coaching.observed_pose import ObservedPose
from caesura_service.coaching.unchanged_force import UnchangedForce, advanced, begun
from caesura_service.constants import FREE_M_PER_S, TARED_BIAS_N

Array = NDArray[np.float64]

MOVING_M_PER_S = 0.05  # slower says little of a direction
DRIFT_TIME_S = 10.0  # in which a bias wanders by its scale
FORCE_IN_MOTION_N = 1.0  # by which a force in movement varies, at most
REFERENCE, PUSH_LIMIT = 1.0, 2.0  # of the cumulative sum of a hand's push [standard deviations]
ZERO_COUNT = 5  # observations of free movement that show the zero of a force without a tare: 0.4 s, as a tare
SHAKES = 3  # steps between poses in a row, all of which miss a part of a path that is shaken
NOTHING: Vector = (0.0, 0.0, 0.0)
AHEAD_S = 0.5  # in which a joint reaches the limit that is hinted at
ARM_EVERY = 3  # observations from one look at the Jacobian to the next


@dataclass(frozen=True)
class ArmLimits:
    """The joint limits [rad] of an arm, and its flange Jacobian as a function of joints (n,) [rad]."""

    lower: Array
    upper: Array
    jacobian: Callable[[Array], Array]

    def nearest(self, joints: Array, speeds: Array, slowing: Array) -> tuple[int, float]:
        """Return the joint that will be closest to a limit within AHEAD_S, and its distance [rad] at that
        time.

        speeds: (n,) [rad/s]; slowing: (n,) deceleration [rad/s²], 0 for a joint that does not slow down.
        """
        later = joints + speeds * _seconds_at_speed(speeds, slowing)
        low, high = np.minimum(joints, later), np.maximum(joints, later)
        left = np.minimum(low - self.lower, self.upper - high)
        joint = int(left.argmin())
        return joint, float(left[joint])

    def smallest_singular_value(self, joints: Array) -> float:
        """Return the smallest singular value of the flange's Jacobian [m and rad per rad]."""
        jacobian = self.jacobian(joints)
        gram = jacobian @ jacobian.T if len(jacobian) <= jacobian.shape[1] else jacobian.T @ jacobian
        return math.sqrt(max(float(np.linalg.eigvalsh(gram)[0]), 0.0))


@dataclass(frozen=True)
class CoachingSetup:
    """The statements of a session on which its rules depend.

    clean_wrench: whether the wrench is declared not to contain the hand; bias_n: scale of the force in free
    space [N]; path_tolerance_m: of the program's paths [m]; arm: None if not stated; is_tared: whether the
    force has a tare; path_tolerance_rad: of the turn along the program's paths [rad].
    """

    clean_wrench: bool
    bias_n: float
    path_tolerance_m: float
    arm: ArmLimits | None = None
    is_tared: bool = True
    path_tolerance_rad: float = TOLERANCE_RAD


def _seconds_at_speed(speeds: Array, slowing: Array) -> Array:
    """Return the time [s] in which each joint, at constant speed, covers its way within AHEAD_S.

    The way includes the deceleration, to a stop at most.
    """
    size = np.abs(speeds)
    stops_in = np.divide(size, slowing, out=np.full_like(size, np.inf), where=slowing > 0.0)
    moves_for = np.minimum(stops_in, AHEAD_S)
    lost = np.divide(moves_for, stops_in, out=np.zeros_like(size), where=stops_in > 0.0)
    return moves_for * (1.0 - 0.5 * lost)


class ArmMeasures(NamedTuple):
    """The measures of an arm's joints; nan where joints are not reported."""

    singular_value: float = math.nan  # the smallest of the flange's Jacobian
    joint: int = 0  # which is nearest to a limit
    joint_left_rad: float = math.nan  # the least within AHEAD_S
    left_now_rad: float = math.nan  # the least of all joints now
    joint_now_rad: float = math.nan  # of the joint that is nearest to a limit, now


NO_ARM = ArmMeasures()


class Measures(NamedTuple):
    """The values that rules compare with their limits; nan for a missing one."""

    push: float = math.nan  # cumulative sum of the force that drives the movement [standard deviations]
    driving_n: float = math.nan  # that force, now
    stray_n: float = math.nan  # force in free movement that is neither contact, load nor hand
    path_error_m: float = 0.0  # what the poses miss of the path between them
    turn_error_rad: float = 0.0  # likewise, of the turn
    bias_n: float = math.nan
    arm: ArmMeasures = NO_ARM
    frozen_s: float = 0.0  # in which the force was the same number, and the flange moved
    frozen_n: float = math.nan  # that force


class MotionState(NamedTuple):
    """The state that is carried from one observation to the next."""

    poses: tuple[ObservedPose, ...] = ()  # the newest POSES, oldest first, none across a gap
    shaken: tuple[tuple[float, float], ...] = ()  # [m], [rad] of the newest SHAKES steps between poses
    push: float = 0.0  # as in Measures
    held_j: float = 0.0  # [J] work that what the tool touches took up and did not return
    drift: DriftState = DriftState()
    zero: Vector | None = None  # [N] what the force reads in free movement, where there is no tare
    free: tuple[Vector, ...] = ()  # [N] the forces in free movement, in a row, until the zero is known
    unchanged: UnchangedForce | None = None
    arm: ArmMeasures = NO_ARM
    arm_age: int = 0  # observations since the Jacobian was computed


class Meter:
    """Measures the observations of a session, one by one."""

    def __init__(self, setup: CoachingSetup) -> None:
        self._setup, self._zeroed = setup, replace(setup, bias_n=TARED_BIAS_N, is_tared=True)
        self._tracker, self._zeroed_tracker = _tracker(setup.bias_n), _tracker(TARED_BIAS_N)

    def setup_of(self, state: MotionState) -> CoachingSetup:
        """Return the setup for a state: that of a tared force once the zero is estimated."""
        return self._setup if state.zero is None else self._zeroed

    def advance(self, state: MotionState, pose: ObservedPose) -> tuple[MotionState, Measures]:
        """Process one observation; return the next state, and the measures."""
        arm, arm_age = state.arm, state.arm_age + 1
        before = None if pose.after_gap or not state.poses else state.poses[-1]
        if self._setup.arm is not None:
            poses = state.poses if before else ()
            if before is None or arm_age >= ARM_EVERY:
                arm, arm_age = _singular(self._setup.arm, pose), 0
            arm = _near_limit(self._setup.arm, arm, [*poses[-2:], pose])
        if before is None:
            unchanged = begun(state.unchanged, pose.measured_n, pose.t, pose.position)
            state = state._replace(
                poses=(pose,), shaken=(), push=0.0, held_j=0.0, free=(), unchanged=unchanged
            )
            state = state._replace(arm=arm, arm_age=0)
            return state, Measures(arm=arm)
        unchanged, frozen_s = advanced(state.unchanged, pose.measured_n, pose.t, pose.position)
        poses = (*state.poses[1 - POSES :], pose)
        setup = self._setup
        missed = interpolation_errors(poses, setup.path_tolerance_m, setup.path_tolerance_rad)
        shaken = (*state.shaken[1 - SHAKES :], (missed.shaken_m, missed.shaken_rad))
        state = state._replace(poses=poses, shaken=shaken, unchanged=unchanged, arm=arm, arm_age=arm_age)
        shaken_m, shaken_rad = map(min, zip(*shaken, strict=True)) if len(shaken) == SHAKES else (0.0, 0.0)
        measured = Measures(
            path_error_m=max(missed.path_m, shaken_m),
            turn_error_rad=max(missed.turn_rad, shaken_rad),
            arm=arm,
        )
        if unchanged is not None:
            measured = measured._replace(frozen_s=frozen_s, frozen_n=unchanged.measured_n)
        if not self._setup.clean_wrench:
            return state, measured
        state = self._with_zero(state, pose)
        state = state._replace(held_j=self._held(state, before, pose))
        drift, push, driving_n, stray_n = self._of_force(state, pose, pose.t - before.t)
        x, y, z = drift.mean
        bias_n = math.sqrt(x * x + y * y + z * z)
        measured = measured._replace(push=push, driving_n=driving_n, stray_n=stray_n, bias_n=bias_n)
        return state._replace(push=push, drift=drift), measured

    def _with_zero(self, state: MotionState, pose: ObservedPose) -> MotionState:
        """Return the state with the zero of an untared force, once forces of free movement vary little."""
        if self._setup.is_tared or state.zero is not None:
            return state
        free = (*state.free, pose.force)[-ZERO_COUNT:] if _moves_freely(pose) else ()
        if len(free) < ZERO_COUNT or max(map(pstdev, zip(*free, strict=True))) > FORCE_IN_MOTION_N:
            return state._replace(free=free)
        x, y, z = map(fmean, zip(*free, strict=True))
        return state._replace(zero=(x, y, z), free=(), push=0.0, drift=DriftState())

    def _held(self, state: MotionState, before: ObservedPose, pose: ObservedPose) -> float:
        """Return the work [J] that the touched object stores after a pose: taken up and not returned."""
        bias = _sum(state.zero or NOTHING, state.drift.mean)
        now, earlier = _difference(pose.force, bias), _difference(before.force, bias)
        if math.hypot(*now) <= self.setup_of(state).bias_n:
            return 0.0
        x, y, z = (0.5 * (a + b) for a, b in zip(earlier, now, strict=True))
        return state.held_j + _stored((x, y, z), _difference(pose.position, before.position))

    def _of_force(
        self, state: MotionState, pose: ObservedPose, dt: float
    ) -> tuple[DriftState, float, float, float]:
        """Return the bias state after a force, the hand's push, and the driving and stray force [N].

        The push is the cumulative sum (Page 1954) of the driving force beyond the predicted bias.
        """
        x, y, z = pose.velocity
        speed = math.sqrt(x * x + y * y + z * z)
        tracker = self._tracker if state.zero is None else self._zeroed_tracker
        predicted = tracker.wait(state.drift, dt)
        if speed < MOVING_M_PER_S:
            return predicted, 0.0, 0.0, 0.0
        heading = x / speed, y / speed, z / speed
        force = _difference(pose.force, state.zero or NOTHING)
        driving_n, stray_n = _driving_and_stray(force, heading, pose.holding)
        driving, stray = _driving_and_stray(_difference(force, predicted.mean), heading, pose.holding)
        if state.held_j > 0.0:
            driving_n, driving = min(driving_n, 0.0), min(driving, 0.0)
        deviation = math.sqrt(_along(predicted.variance, heading) + FORCE_IN_MOTION_N * FORCE_IN_MOTION_N)
        push = min(max(state.push + driving / deviation - REFERENCE, 0.0), 2.0 * PUSH_LIMIT)
        drift = tracker.advance(state.drift, force, dt, laden=pose.holding == 1.0)
        # A tracked bias may be wrong, and so may that of the tare: what is stray, both show.
        return drift, push, driving_n, min(stray_n, stray) if speed >= FREE_M_PER_S else 0.0


def _tracker(scale_n: float) -> DriftTracker:
    """Return a tracker of a bias with this scale [N]."""
    return DriftTracker(scale_n**2 / DRIFT_TIME_S, most_n2=scale_n**2)


def _moves_freely(pose: ObservedPose) -> bool:
    """Return whether the force counts as bias: fast movement, without a known load."""
    return math.hypot(*pose.velocity) >= FREE_M_PER_S and pose.holding != 1.0


def _stored(force: Vector, way: Vector) -> float:
    """Return the work [J] of a force [N] along a displacement [m] that a spring can store.

    It is negative where the spring returns energy. Friction is at most the force across the way, and stores
    nothing.
    """
    (x, y, z), (dx, dy, dz) = force, way
    returned = x * dx + y * dy + z * dz
    if returned >= 0.0:
        return -returned
    size2, way2 = x * x + y * y + z * z, dx * dx + dy * dy + dz * dz
    rubbed = math.sqrt(max(size2 * way2 - returned * returned, 0.0))
    return max(-returned - rubbed, 0.0)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _difference(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _along(variance: Vector, heading: Vector) -> float:
    """Return the variance [N²] of a force along a heading; variance: of its axes."""
    (x, y, z), (hx, hy, hz) = variance, heading
    return x * hx * hx + y * hy * hy + z * hz * hz


def _singular(arm: ArmLimits, pose: ObservedPose) -> ArmMeasures:
    """Return the arm's measures with the smallest singular value at an observation's joints."""
    return NO_ARM if pose.joints is None else ArmMeasures(arm.smallest_singular_value(pose.joints))


def _near_limit(arm: ArmLimits, measured: ArmMeasures, poses: Sequence[ObservedPose]) -> ArmMeasures:
    """Return the measures with the joints' distance to a limit [rad].

    poses: up to three in a row without a gap, the newest last.
    """
    joints = poses[-1].joints
    if joints is None:
        return NO_ARM
    joint, left_rad = arm.nearest(joints, *_joint_speeds(poses))
    now = np.minimum(joints - arm.lower, arm.upper - joints)
    return measured._replace(
        joint=joint,
        joint_left_rad=left_rad,
        left_now_rad=float(now.min()),
        joint_now_rad=float(now[joint]),
    )


def _joint_speeds(poses: Sequence[ObservedPose]) -> tuple[Array, Array]:
    """Return joint speeds (n,) [rad/s] at the end of up to three poses, and their slowing (n,) [rad/s²]."""
    known = [(one.t, one.joints) for one in poses if one.joints is not None]
    steps = [((q - before) / (t - earlier), t - earlier) for (earlier, before), (t, q) in pairwise(known)]
    if len(steps) < 2:
        nothing = np.zeros_like(known[-1][1])
        return (steps[0][0] if steps else nothing), nothing
    (before, _), (speeds, dt) = steps
    return speeds, np.maximum(np.abs(before) - np.abs(speeds), 0.0) / dt


def _driving_and_stray(force: Vector, heading: Vector, holding: float) -> tuple[float, float]:
    """Return the force [N] that drives along the heading, and the remainder that no friction or load
    explains.

    holding: 1: the fingers hold something; 0: nothing; otherwise unknown. Unless it is 0, a downward force
    does not drive a downward movement. If it is 1, a downward force is the weight.
    """
    (x, y, z), (hx, hy, hz) = force, heading
    level = x * hx + y * hy
    sinks = holding != 0.0 and z < 0.0 and hz < 0.0
    driving = level if sinks else level + z * hz
    if holding == 1.0:
        z = max(z, 0.0)
    along = level + z * hz
    across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    weight = -z if holding == 0.0 and along < across else 0.0
    return driving, max(-along - across, weight, 0.0)
