"""Faults that the suite of hints injects into the sensor and joint values of a demonstration.

A fault is injected at a random time. The time of its cause is determined from the samples at 1 kHz, not from
the observations on which hints are based.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.cases.sensor_conditions import rows_of
from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_protocol.messages import Hint, HintKind
from caesura_protocol.recording import Recording
from caesura_service.constants import FREE_M_PER_S, GRAVITY, TARED_BIAS_N
from caesura_service.offline_segmentation import views
from caesura_service.program import TOLERANCE_M
from caesura_service.robot import Robot

Array = NDArray[np.float64]

FIRST_S = 1.5  # from the start of a demonstration, without a fault
MOVING_M_PER_S = 0.05
SMOOTH_ROWS = 50  # at 1 kHz, of a speed
RISE_S = 0.1
SINGULAR, JOINT_MARGIN_RAD = 0.05, 0.05  # below and within which the arm is in trouble
DRIFT_N = 3.37 * TARED_BIAS_N  # 99 % of tared free space reads less
HAND_N = 2.33 * TARED_BIAS_N  # along a direction
# A corner turns by more than 45° through a dip below 0.6 (docs/annotation.md). Near both it is neither.
TURN_DEG = (40.0, 50.0)
DEPTHS = (0.4, 0.8)  # of a dip, as a share of the speed
DIP_S = 0.3
EVEN = (0.4, 0.6)  # probability of a boundary, odds of three to two, either way
TRIES, HALVINGS = 12, 6
LOOK_AHEAD_S = 0.5  # five observations, after which the models' weight of a corner is settled
PUBLISHED_S = 0.16  # an observation is published so long after its time, at most
NEAR_TRUTH_S = 0.3  # of a hint to a changepoint that may or may not count
FAULTS = 50  # that are judged


class NotInjectableError(Exception):
    """The demonstration has no time at which the fault can be injected."""


@dataclass(frozen=True)
class Fault:
    """A recording with a fault: its kind, and the time from which it can certainly be detected [s].

    begins: start of the fault [s]; from then on a hint is correct. place: the time that a hint must name [s],
    if any.
    """

    kind: HintKind
    recording: Recording
    cause: float
    begins: float
    place: float | None = None

    def is_named_by(self, hint: Hint) -> bool:
        """Return whether a hint has this fault's kind and, if the fault has a place, is near it."""
        if hint.kind != self.kind:
            return False
        return self.place is None or (hint.t0 is not None and abs(hint.t0 - self.place) <= NEAR_TRUTH_S)


@dataclass(frozen=True)
class CleanDemonstration:
    """A demonstration with its truth, and, made on request, the same one with the hand in the wrench."""

    recording: Recording
    truth: Mapping[str, Any]
    with_hand: Callable[[], Recording]
    robot: Robot

    @property
    def velocity(self) -> Array:
        """(n, 3) [m/s] of the flange, smoothed over 50 ms."""
        kernel = np.ones(SMOOTH_ROWS) / SMOOTH_ROWS
        moved = np.gradient(self.recording.signals["pos"], self.recording.t, axis=0)
        return np.column_stack([np.convolve(column, kernel, mode="same") for column in moved.T])

    def free_runs(self, least_m_per_s: float, least_s: float) -> list[tuple[int, int]]:
        """Return first and last (exclusive) row of each long and fast run in free space.

        A run is faster than least_m_per_s for at least least_s [s].
        """
        t, speed = self.recording.t, np.linalg.norm(self.velocity, axis=1)
        fast = (speed > least_m_per_s) & self._is_free(t)
        edges = np.flatnonzero(np.diff(np.r_[0, fast.astype(int), 0]))
        runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        late = [(a, b) for a, b in runs if t[a] > FIRST_S and t[b - 1] < t[-1] - 0.5]
        return [(a, b) for a, b in late if t[b - 1] - t[a] >= least_s]

    def _is_free(self, t: Array) -> NDArray[np.bool_]:
        free = np.zeros(len(t), dtype=np.bool_)
        for segment in self.truth["segments"]:
            if segment["cls"] == "motion":
                free |= (t >= segment["t0"]) & (t <= segment["t1"])
        return free


def _run(
    taught: CleanDemonstration, rng: np.random.Generator, least_m_per_s: float, least_s: float
) -> tuple[int, int]:
    runs = taught.free_runs(least_m_per_s, least_s)
    if not runs:
        raise NotInjectableError
    return runs[rng.integers(len(runs))]


def _with_force(recording: Recording, added: Array) -> Recording:
    signals = {**recording.signals, "force": recording.signals["force"] + added}
    return replace(recording, signals=signals)


def _hand(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """The hand takes hold of the tool, below the sensor, as a movement begins.

    It can be detected once it drives the movement by more than the bias of a tared sensor.
    """
    first, last = _run(taught, rng, MOVING_M_PER_S, 0.6)
    recording, t, velocity = taught.recording, taught.recording.t, taught.velocity
    hand = taught.with_hand().signals["force"] - recording.signals["force"]
    hand *= np.clip((t - t[first]) / RISE_S, 0.0, 1.0)[:, None]
    speed = np.maximum(np.linalg.norm(velocity, axis=1), MOVING_M_PER_S)
    driven = np.convolve(
        (hand * velocity).sum(axis=1) / speed, np.ones(SMOOTH_ROWS) / SMOOTH_ROWS, mode="same"
    )
    start = _lasting(driven[first:last] > HAND_N, RISE_S, t)
    seen = float(t[first + start])
    return Fault("hand_in_wrench", _with_force(recording, hand), seen, begins=float(t[first]))


def _lasting(true: NDArray[np.bool_], seconds: float, t: Array) -> int:
    """Return the first row from which `true` holds for `seconds`. Raises NotInjectableError without one."""
    rows = round(seconds / float(t[1] - t[0]))
    counts = (
        np.convolve(true.astype(int), np.ones(rows, int), mode="valid") if len(true) >= rows else np.zeros(0)
    )
    starts = np.flatnonzero(counts == rows)
    if not starts.size:
        raise NotInjectableError
    return int(starts[0])


def _cable(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """A cable pulls the tool back."""
    first, last = _run(taught, rng, FREE_M_PER_S, 0.6)
    t, velocity = taught.recording.t, taught.velocity
    heading = velocity / np.maximum(np.linalg.norm(velocity, axis=1), MOVING_M_PER_S)[:, None]
    pull = rng.uniform(10.0, 20.0) * np.clip((t - t[first]) / RISE_S, 0.0, 1.0) * (t <= t[last - 1])
    pulled = _with_force(taught.recording, -pull[:, None] * heading)
    return Fault("unexplained_force", pulled, float(t[first]), begins=float(t[first]))


def _weight(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """A weight hangs on the tool, and the fingers are open."""
    runs = taught.free_runs(FREE_M_PER_S, 0.6)
    t, gripper = taught.recording.t, taught.recording.signals["gripper"][:, 0]
    open_runs = [(a, b) for a, b in runs if gripper[a:b].min() > 0.9 * gripper.max()]
    if not open_runs:
        raise NotInjectableError
    first, _ = open_runs[rng.integers(len(open_runs))]
    weight = rng.uniform(0.8, 1.5) * GRAVITY * np.clip((t - t[first]) / RISE_S, 0.0, 1.0)
    down = np.column_stack([0.0 * t, 0.0 * t, -weight])
    laden = _with_force(taught.recording, down)
    return Fault("unexplained_force", laden, float(t[first]), begins=float(t[first]))


def _drift(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """The zero of the sensor drifts. It can be detected once the force exceeds the limit in free movement."""
    t, direction = taught.recording.t, rng.normal(size=3)
    start, reached = FIRST_S, rng.uniform(0.5, 0.7) * t[-1]
    ramp = DRIFT_N * np.clip((t - start) / (reached - start), 0.0, 1.5)
    drifted = _with_force(taught.recording, ramp[:, None] * direction / np.linalg.norm(direction))
    kernel = np.ones(2 * SMOOTH_ROWS) / (2 * SMOOTH_ROWS)
    mean = np.column_stack([np.convolve(one, kernel, mode="same") for one in drifted.signals["force"].T])
    beyond = (np.linalg.norm(mean, axis=1) > DRIFT_N) & (ramp > 0.5 * DRIFT_N)
    for first, last in taught.free_runs(MOVING_M_PER_S, 0.5):
        with suppress(NotInjectableError):
            seen = float(t[first + _lasting(beyond[first:last], 0.3, t)])
            return Fault("bias_drift", drifted, seen, begins=start)
    raise NotInjectableError


def _warped(recording: Recording, t_of_sample: Array) -> Recording:
    """Return the recording at 1 kHz with changed times.

    t_of_sample: (n,) [s] original time of each sample.
    """
    t = np.arange(len(t_of_sample)) * (recording.t[1] - recording.t[0])
    signals = {
        name: np.column_stack([np.interp(t_of_sample, recording.t, column) for column in values.T])
        for name, values in recording.signals.items()
    }
    return replace(recording, t=t, signals=signals)


def _fast(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """A part of the demonstration is played several times as fast."""
    recording, (first, last) = taught.recording, _run(taught, rng, MOVING_M_PER_S, 0.6)
    dt = float(recording.t[1] - recording.t[0])
    factor = rng.uniform(4.0, 6.0)
    inside = np.arange(recording.t[first] - 0.3, recording.t[last - 1] + 0.3, factor * dt)
    outside = recording.t[recording.t < inside[0]], recording.t[recording.t > inside[-1]]
    faster = _warped(recording, np.concatenate([outside[0], inside, outside[1]]))
    cause = first_unrecorded(faster.t, faster.signals["pos"])
    if cause is None:
        raise NotInjectableError
    return Fault("too_fast", faster, cause, begins=float(inside[0]))


def first_unrecorded(t: Array, position: Array) -> float | None:
    """Return the time [s] from which a path (n, 3) leaves the cubic through its poses 0.1 s apart; or None.

    It leaves the cubic by more than the tolerance, for half a step, so that most grids of poses miss it.
    """
    step = round(0.05 / float(t[1] - t[0]))
    a, b, middle, c, d = (position[k * step : len(t) - (6 - k) * step] for k in (0, 2, 3, 4, 6))
    error = np.linalg.norm(middle - (9.0 * (b + c) - a - d) / 16.0, axis=1)
    try:
        return float(t[3 * step + _lasting(error > TOLERANCE_M, 0.05, t)])
    except NotInjectableError:
        return None


def _unclear_corner(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """An ambiguous corner: optional for annotators, with a posterior near one half.

    Its turn and its dip are near the limits of a corner. Bisection finds the dip at which the posterior
    probability is near one half; without such a dip the fault is not injected. The corner can be detected
    LOOK_AHEAD_S after it, when the models' weight of it has settled.
    """
    for _ in range(TRIES):
        first, last = _run(taught, rng, FREE_M_PER_S, 0.8)
        turn = np.radians(rng.uniform(*TURN_DEG))
        deep, shallow = DEPTHS
        if boundary_probability(*_with_corner(taught, first, last, turn, deep)) < 0.5:
            continue
        if boundary_probability(*_with_corner(taught, first, last, turn, shallow)) > 0.5:
            continue
        for _ in range(HALVINGS):
            middle = 0.5 * (deep + shallow)
            recording, corner = _with_corner(taught, first, last, turn, middle)
            probability = boundary_probability(recording, corner)
            if EVEN[0] < probability < EVEN[1]:
                seen = corner + LOOK_AHEAD_S
                return Fault("uncertain_boundary", recording, seen, begins=corner, place=corner)
            deep, shallow = (middle, shallow) if probability > 0.5 else (deep, middle)
    raise NotInjectableError


def _with_corner(
    taught: CleanDemonstration, first: int, last: int, turn: float, depth: float
) -> tuple[Recording, float]:
    """Return a movement with a turn and a dip of the speed in its middle, and the time of the turn.

    turn: its angle [rad]; depth: share of the speed that is left.
    """
    recording = taught.recording
    dt = float(recording.t[1] - recording.t[0])
    down = np.linspace(1.0, depth, round(DIP_S / dt))
    shown = dt * np.cumsum(np.r_[down, down[::-1]])
    inside = 0.5 * (recording.t[first] + recording.t[last - 1] - shown[-1]) + shown
    outside = recording.t[recording.t < inside[0]], recording.t[recording.t > inside[-1]]
    slower = _warped(recording, np.concatenate([outside[0], inside, outside[1]]))
    corner = dt * (len(outside[0]) + len(down))
    angle = 0.5 * turn * (1.0 + np.tanh((slower.t - corner) / 0.04))
    steps = np.diff(slower.signals["pos"], axis=0, prepend=slower.signals["pos"][:1])
    level = (steps[:, 0] + 1j * steps[:, 1]) * np.exp(1j * angle)
    turned = np.cumsum(np.column_stack([level.real, level.imag, steps[:, 2]]), axis=0)
    kept = {name: values for name, values in slower.signals.items() if name not in {"q", "torque"}}
    return replace(slower, signals={**kept, "pos": slower.signals["pos"][:1] + turned}), corner


def boundary_probability(recording: Recording, corner: float) -> float:
    """Return the published probability of a boundary at a corner, after the models' look-ahead."""
    kept = recording.t < corner + LOOK_AHEAD_S + PUBLISHED_S
    *_, newest, _ = views(rows_of(recording, np.flatnonzero(kept)))
    starts = zip(newest.posterior_starts, newest.posterior_probabilities, strict=True)
    return sum(probability for t, probability in starts if abs(t - corner) <= NEAR_TRUTH_S)


def _at_joints(taught: CleanDemonstration, joints: Array) -> Recording:
    """Return the recording with the arm at joints (n, j), and the flange at their pose."""
    positions, quaternions = taught.robot.flange_poses(joints)
    signals = {**taught.recording.signals, "q": joints, "pos": positions, "quat": quaternions}
    return replace(taught.recording, signals=signals)


def _joint_limit(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """One joint is moved gradually to its limit."""
    t, q = taught.recording.t, taught.recording.signals["q"]
    lower, upper = taught.robot.lower_limits, taught.robot.upper_limits
    joint = int(rng.choice([0, 6]))
    start, duration = rng.uniform(FIRST_S, 3.0), rng.uniform(2.0, 4.0)
    goal = (
        upper[joint] - 0.02 - q[:, joint].max()
        if rng.random() < 0.5
        else lower[joint] + 0.02 - q[:, joint].min()
    )
    led = q.copy()
    led[:, joint] += goal * minimum_jerk(np.clip((t - start) / duration, 0.0, 1.0))
    left = np.minimum(led - lower, upper - led).min(axis=1)
    inside = np.flatnonzero(left < JOINT_MARGIN_RAD)
    if not inside.size or t[inside[0]] < start:
        raise NotInjectableError
    return Fault("joint_limit", _at_joints(taught, led), float(t[inside[0]]), begins=start)


def least_singular_value(robot: Robot, joints: Array) -> float:
    """Return the least singular value of the flange's Jacobian at joints (n,) [rad]."""
    return float(np.linalg.svd(robot.flange_jacobian(joints), compute_uv=False)[-1])


def _singularity(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """The elbow is moved gradually towards the stretched arm."""
    t, q = taught.recording.t, taught.recording.signals["q"]
    start, duration = rng.uniform(FIRST_S, 3.0), rng.uniform(3.0, 5.0)
    led = q.copy()
    share = minimum_jerk(np.clip((t - start) / duration, 0.0, 1.0))
    led[:, 3] += share * (-0.15 - q[:, 3])
    every = 10
    values = [least_singular_value(taught.robot, row) for row in led[::every]]
    inside = np.flatnonzero(np.array(values) < SINGULAR)
    if not inside.size or t[every * inside[0]] < start:
        raise NotInjectableError
    return Fault("singularity", _at_joints(taught, led), float(t[every * inside[0]]), begins=start)


def _lost(taught: CleanDemonstration, rng: np.random.Generator) -> Fault:
    """Samples are missing; this can be detected at the next one."""
    recording, t = taught.recording, taught.recording.t
    start, length = rng.uniform(FIRST_S, t[-1] - 2.0), rng.uniform(0.3, 1.0)
    kept = (t < start) | (t > start + length)
    again = float(t[t > start + length][0])
    return Fault("show_again", rows_of(recording, np.flatnonzero(kept)), again, begins=again)


@dataclass(frozen=True)
class InjectedFault:
    """The hint that a fault should raise, the number of judged faults, and the function that injects one."""

    hint: HintKind
    judged: int
    inject: Callable[[CleanDemonstration, np.random.Generator], Fault]


#: By name; FAULTS are judged in all.
INJECTED: Mapping[str, InjectedFault] = MappingProxyType(
    {
        "hand": InjectedFault("hand_in_wrench", 7, _hand),
        "cable": InjectedFault("unexplained_force", 4, _cable),
        "weight": InjectedFault("unexplained_force", 4, _weight),
        "unclear corner": InjectedFault("uncertain_boundary", 6, _unclear_corner),
        "too fast": InjectedFault("too_fast", 6, _fast),
        "singularity": InjectedFault("singularity", 6, _singularity),
        "joint limit": InjectedFault("joint_limit", 6, _joint_limit),
        "drift": InjectedFault("bias_drift", 5, _drift),
        "lost samples": InjectedFault("show_again", 6, _lost),
    }
)
