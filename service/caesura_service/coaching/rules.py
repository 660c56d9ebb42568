"""The rules on signals as a table: the measure, its limit, and the advice to the teacher.

No limit is tuned. Each follows from another definition of the system:

- A force is beyond the bias where tared free space reads less with probability 0.99: 2.33 scales along a
  direction, 3.37 scales in size (χ with three degrees of freedom).
- A hand's push is a cumulative sum with reference 1 and limit 2: one observation of three standard
  deviations, or two of two. The force must also drive if the tracked bias is not subtracted, by the scale of
  a bias.
- A path is recorded to within the tolerance of the program's paths.
- Below a singular value of 0.05 the estimate of the wrench is damped (`robot.robot_model`).
- A force is frozen as in a file (`wrench_faults`): it is the same for FROZEN_S while the flange moves by
  MOVED_M.
- `caesura check` refuses postures nearer than 0.05 rad to a joint's end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from caesura_protocol.wrench_faults import FROZEN_S
from caesura_service.coaching.hint_log import LOUD, Trigger, Words
from caesura_service.coaching.measures import AHEAD_S, PUSH_LIMIT, CoachingSetup, Measures

ALONG_SCALES, SIZE_SCALES = 2.33, 3.37  # that 99 % stay below, of one component and of three
SINGULAR_BELOW = 0.05
JOINT_MARGIN_RAD = 0.05
STRAY_CONFIRM = 3  # observations: an impact is shorter
LIMIT_CONFIRM = 2  # observations: at the fastest point of a movement no joint slows down yet


@dataclass(frozen=True)
class SignalRule:
    """A rule on signals, with functions for its level and for the text of a new hint.

    level: 1 and more if the limit is reached, nan without a measurement.
    """

    trigger: Trigger
    level: Callable[[Measures, CoachingSetup], float]
    words: Callable[[Measures, CoachingSetup], Words]


def _hand_level(m: Measures, setup: CoachingSetup) -> float:
    """Return the level of a hand's push; 0 where a bias of this scale may drive the movement instead.

    That holds for a driving force within the scale, and without a tare, where the bias is unknown.
    """
    return m.push / PUSH_LIMIT if setup.is_tared and m.driving_n > setup.bias_n else 0.0


def _joint_level(m: Measures, _setup: CoachingSetup) -> float:
    """Return the level of the joint that comes closest to a limit: 1 at the margin, 2 at the limit.

    0 is two margins away. If a joint is within the margin now, the level is at least LOUD.
    """
    ahead = 2.0 - m.arm.joint_left_rad / JOINT_MARGIN_RAD
    return max(ahead, LOUD) if m.arm.left_now_rad <= JOINT_MARGIN_RAD else ahead


def _near_limit(m: Measures) -> str:
    """Return as text how far the joint is from its limit, and what is left of that as it moves on."""
    left_rad = (m.arm.joint_now_rad, m.arm.joint_left_rad)
    now, later = (f"{max(math.degrees(left), 0.0):.0f}°" for left in left_rad)
    joint = f"Joint {m.arm.joint + 1} is"
    if now == "0°":
        return f"{joint} at its limit."
    if later == "0°":
        return f"{joint} {now} from its limit, and reaches it within {AHEAD_S:g} s as it moves now."
    if later == now:
        return f"{joint} {now} from its limit (margin {math.degrees(JOINT_MARGIN_RAD):.0f}°)."
    return f"{joint} {now} from its limit, and {later} within {AHEAD_S:g} s as it moves now."


def _path_levels(m: Measures, setup: CoachingSetup) -> tuple[float, float]:
    """Return the levels of what the poses miss: of the path and of the turn along it."""
    return m.path_error_m / setup.path_tolerance_m, m.turn_error_rad / setup.path_tolerance_rad


def _missed_part(m: Measures, setup: CoachingSetup) -> str:
    """Return as text what the poses miss of the path, or of the turn if that is further beyond its limit."""
    of_path, of_turn = _path_levels(m, setup)
    if of_path >= of_turn:
        limit_mm = 1000 * setup.path_tolerance_m
        return f"the recorded path is off by up to {1000 * m.path_error_m:.0f} mm (limit {limit_mm:g} mm)"
    missed, limit = math.degrees(m.turn_error_rad), math.degrees(setup.path_tolerance_rad)
    return f"the recorded turn is off by up to {missed:.0f}° (limit {limit:.3g}°)"


def _singular_level(m: Measures, _setup: CoachingSetup) -> float:
    return math.inf if m.arm.singular_value == 0.0 else SINGULAR_BELOW / m.arm.singular_value


RULES: tuple[SignalRule, ...] = (
    SignalRule(
        Trigger("hand_in_wrench", confirm=1),
        _hand_level,
        lambda m, _setup: (
            f"The sensor measures the hand: {m.driving_n:.0f} N along the movement. If the hand has to hold "
            "the tool, state the wrench source flange_sensor_with_hand.",
            "Hold the arm itself, not the tool.",
        ),
    ),
    SignalRule(
        Trigger("unexplained_force", confirm=STRAY_CONFIRM),
        lambda m, setup: m.stray_n / (ALONG_SCALES * setup.bias_n),
        lambda m, setup: (
            f"{m.stray_n:.0f} N in free movement, without a contact or a grasped load "
            f"(limit {ALONG_SCALES * setup.bias_n:.1f} N).",
            "Check for a cable that pulls, or an object on the tool.",
        ),
    ),
    SignalRule(
        Trigger("too_fast", confirm=1),
        lambda m, setup: max(_path_levels(m, setup)),
        lambda m, setup: (
            f"Too fast: {_missed_part(m, setup)}.",
            "Move more slowly where the path turns.",
        ),
    ),
    SignalRule(
        Trigger("singularity", confirm=1),
        _singular_level,
        lambda m, _setup: (
            f"The arm is near a singularity: least singular value {m.arm.singular_value:.3f} "
            f"(limit {SINGULAR_BELOW}).",
            "Bend the elbow or turn the wrist away.",
        ),
    ),
    SignalRule(
        Trigger("joint_limit", confirm=LIMIT_CONFIRM),
        _joint_level,
        lambda m, _setup: (
            _near_limit(m),
            f"Turn joint {m.arm.joint + 1} back, away from its limit.",
        ),
    ),
    SignalRule(
        Trigger("bias_drift", confirm=1),
        lambda m, setup: m.bias_n / (SIZE_SCALES * setup.bias_n),
        lambda m, setup: (
            f"The zero of the force has drifted by {m.bias_n:.0f} N "
            f"(limit {SIZE_SCALES * setup.bias_n:.1f} N).",
            "Stop, let go, and start again: the start tares the sensor.",
        ),
    ),
    SignalRule(
        Trigger("frozen_force", confirm=1),
        lambda m, _setup: m.frozen_s / FROZEN_S,
        lambda m, _setup: (
            f"The force stays at exactly {m.frozen_n:.1f} N while the robot moves (limit {FROZEN_S:g} s).",
            "Check the sensor and its driver: contacts and loads are not detected.",
        ),
    ),
)
