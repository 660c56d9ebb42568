"""Each rule on signals: what raises its hint, what does not, and that it is raised once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.messages import Hint
from caesura_service.coaching import ArmLimits, CoachingSetup, ObservedPose, SignalCoach
from caesura_service.coaching.bias_drift_tracker import DriftState, DriftTracker
from caesura_service.coaching.hint_log import CLEARED_KEPT, HintLog
from caesura_service.coaching.interpolation_errors import (
    InterpolationErrors,
    deviation_between_poses,
    interpolation_errors,
    path_error,
    turn_error,
)
from caesura_service.coaching.measures import ArmMeasures, Measures
from caesura_service.coaching.rules import RULES
from caesura_service.constants import TARED_BIAS_N
from caesura_service.robot import load_panda

STEP_S = 0.1
AT_REST, STILL = (0.4, 0.0, 0.3), (0.0, 0.0, 0.0)
Vector = tuple[float, float, float]


def coached(
    positions: Sequence[Vector],
    forces: Iterable[Vector] = (),
    *,
    velocities: Sequence[Vector] | None = None,
    holding: float = 0.0,
    joints: Iterable[np.ndarray] = (),
    clean: bool = True,
    arm: ArmLimits | None = None,
    is_tared: bool = True,
) -> tuple[Hint, ...]:
    """Every hint of a demonstration; a force or joints that are not given are zero or absent."""
    coach = SignalCoach(CoachingSetup(clean, TARED_BIAS_N, 0.002, arm, is_tared))
    forces, joints = [*forces], [*joints]
    velocities = (
        np.gradient(np.array(positions), STEP_S, axis=0).tolist() if velocities is None else velocities
    )
    for k, (position, velocity) in enumerate(zip(positions, velocities, strict=True)):
        force = forces[k] if k < len(forces) else STILL
        state = joints[k] if joints else None
        coach.observe(ObservedPose(STEP_S * k, position, velocity, force, holding, state))
    return coach.log.hints


def kinds(hints: Iterable[Hint]) -> list[str]:
    return [hint.kind for hint in hints]


def along_x(count: int, speed: float = 0.2) -> list[Vector]:
    return [(0.4 + STEP_S * speed * k, 0.0, 0.3) for k in range(count)]


def after(count: int, force: Vector, total: int = 30) -> list[Vector]:
    return [(0.0, 0.0, 0.0)] * count + [force] * (total - count)


def test_free_movement_raises_no_hint():
    assert coached(along_x(30)) == ()


@pytest.mark.parametrize(
    ("speed", "same", "found"), [(0.2, 7, True), (0.2, 5, False), (0.005, 30, False), (0.03, 7, True)]
)
def test_a_frozen_force_is_found_by_its_time_and_the_movement_in_it(speed: float, same: int, found: bool):
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for k, place in enumerate(along_x(20, speed)):
        measured = 3.0 if 2 <= k < 2 + same else 3.0 + 0.01 * (k + 1)
        coach.observe(ObservedPose(STEP_S * k, place, (speed, 0.0, 0.0), STILL, 0.0, measured_n=measured))
    assert kinds(coach.log.hints) == ["frozen_force"] * found


def test_a_sensor_with_steps_is_not_frozen():
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for k, place in enumerate(along_x(40)):
        measured = 3.0 if k < 10 else 3.2 if k < 13 else 3.0
        coach.observe(ObservedPose(STEP_S * k, place, (0.2, 0.0, 0.0), STILL, 0.0, measured_n=measured))
    assert coach.log.hints == ()


def test_a_force_that_never_changed_is_frozen_after_two_seconds():
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for k, place in enumerate(along_x(30)):
        coach.observe(ObservedPose(STEP_S * k, place, (0.2, 0.0, 0.0), STILL, 0.0, measured_n=0.0))
    (hint,) = coach.log.hints
    assert hint.since == pytest.approx(2.1)


def test_a_gap_begins_the_time_of_an_unchanged_force_anew():
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for k, place in enumerate(along_x(12)):
        pose = ObservedPose(
            STEP_S * k, place, (0.2, 0.0, 0.0), STILL, 0.0, measured_n=3.0, after_gap=k % 5 == 0
        )
        coach.observe(pose)
    assert coach.log.hints == ()


def test_a_force_that_drives_the_movement_is_a_hand_within_half_a_second():
    (hint,) = coached(along_x(30), after(10, (12.0, 0.0, 0.0)))
    assert hint.kind == "hand_in_wrench"
    assert hint.since - 1.0 <= 0.4
    assert "12 N" in hint.text


def test_a_hand_that_pushes_with_little_more_than_a_bias_is_found_once_it_has_pushed_twice():
    (hint,) = coached(along_x(30), after(10, (2.8, 0.0, 0.0)))
    assert hint.kind == "hand_in_wrench"
    assert hint.since == pytest.approx(1.1)


def test_a_bias_that_was_there_before_is_no_hand():
    constant = [(0.06 * k, 0.0, 0.0) for k in range(50)]
    assert coached(along_x(50), constant) == ()


def test_where_the_hand_is_declared_to_be_in_the_wrench_no_force_gives_a_hint():
    assert coached(along_x(30), after(10, (12.0, 0.0, 0.0)), clean=False) == ()


def test_without_a_tare_a_bias_that_drives_is_no_hand():
    assert coached(along_x(30), [(12.0, 0.0, 0.0)] * 30, is_tared=False) == ()


@pytest.mark.parametrize("bias", [0.0, 12.0])
def test_without_a_tare_free_movement_shows_the_zero_from_which_a_hand_and_a_drift_count(bias: float):
    pushed = [(bias + push, 0.0, 0.0) for push, _, _ in after(10, (12.0, 0.0, 0.0))]
    (hint,) = coached(along_x(30), pushed, is_tared=False)
    assert (hint.kind, "12 N" in hint.text) == ("hand_in_wrench", True)
    drift = [(bias, min(0.1 * k, 11.0), 0.0) for k in range(140)]
    (hint,) = coached(along_x(140, speed=0.12), drift, is_tared=False)
    assert hint.kind == "bias_drift"
    assert hint.since == pytest.approx(3.37 * TARED_BIAS_N / 1.0, abs=0.7)


def test_without_a_tare_a_force_that_varies_shows_no_zero():
    uneven = [(12.0 * (k % 2), 0.0, 0.0) for k in range(20)]
    assert coached(along_x(40), [*uneven, *[(12.0, 0.0, 0.0)] * 3], is_tared=False) == ()


def test_a_load_that_sinks_in_closed_fingers_is_no_hand():
    sinking = [(0.4, 0.0, 0.9 - 0.02 * k) for k in range(30)]
    assert coached(sinking, after(5, (0.0, 0.0, -9.8)), holding=1.0) == ()
    assert "hand_in_wrench" in kinds(coached(sinking, after(5, (0.0, 0.0, -9.8)), holding=0.0))


@pytest.mark.parametrize("holding", [0.0, 1.0, math.nan])
def test_a_hand_that_lifts_the_tool_is_a_hand_whatever_the_fingers_hold(holding: float):
    rising = [(0.4, 0.0, 0.3 + 0.02 * k) for k in range(30)]
    assert "hand_in_wrench" in kinds(coached(rising, after(5, (0.0, 0.0, 9.8)), holding=holding))


def pressed_and_let_go(back_n: float) -> tuple[Hint, ...]:
    """A tool presses 40 mm against 10 N, and comes back with a force that drives it."""
    heights = [0.3 - 0.01 * k for k in range(6)] + [0.24 - 0.01 * k for k in range(4)]
    heights += [heights[-1] + 0.006 * k for k in range(1, 7)]
    forces = [(0.0, 0.0, 0.0)] * 6 + [(0.0, 0.0, 10.0)] * 4 + [(0.0, 0.0, back_n)] * 6
    return coached([(0.4, 0.0, height) for height in heights], forces)


def test_a_surface_that_springs_back_is_no_hand_and_one_that_returns_more_work_than_it_took_up_is():
    assert pressed_and_let_go(back_n=7.0) == ()
    assert kinds(pressed_and_let_go(back_n=20.0)) == ["hand_in_wrench"]


def test_work_against_friction_is_not_returned_so_a_hand_after_a_slide_is_found():
    slid = after(3, (-5.0, 0.0, 10.0), total=20)
    assert "hand_in_wrench" in kinds(coached(along_x(26), [*slid, *[(8.0, 0.0, 0.0)] * 6]))


def test_a_surface_along_which_the_tool_slides_gives_no_hint():
    assert coached(along_x(30), after(5, (-6.0, 0.0, 20.0))) == ()


@pytest.mark.parametrize(
    ("force", "holding", "expected"),
    [
        ((-12.0, 0.0, 0.0), 0.0, ["unexplained_force"]),  # a cable
        ((0.0, 0.0, -12.0), 0.0, ["unexplained_force"]),  # a weight on open fingers
        ((0.0, 0.0, -12.0), 1.0, []),  # a weight in closed ones
        ((0.0, 0.0, -12.0), math.nan, []),  # or where that is not reported
    ],
)
def test_what_pulls_in_free_movement(force: Vector, holding: float, expected: list[str]):
    assert kinds(coached(along_x(30), after(10, force), holding=holding)) == expected


def test_an_impact_is_too_short_for_a_hint():
    forces = [*after(10, (-30.0, 0.0, 0.0), total=12), *[(0.0, 0.0, 0.0)] * 20]
    assert coached(along_x(30), forces) == ()


def test_a_zero_that_drifts_is_found_and_a_contact_is_not():
    drift = [(0.0, min(0.1 * k, 11.0), 0.0) for k in range(140)]
    (hint,) = coached(along_x(140, speed=0.12), drift)
    assert hint.kind == "bias_drift"
    true_at = 3.37 * TARED_BIAS_N / 1.0
    assert true_at - 0.2 <= hint.since <= true_at + 0.5
    assert coached(along_x(60), after(20, (-6.0, 0.0, 20.0), total=60)) == ()


def test_what_the_fingers_hold_is_neither_a_drift_nor_a_cable_as_it_is_lifted():
    """Its 12 N are even for so long that they were taken for a bias."""
    up = [(0.4, 0.0, 0.3 + STEP_S * 0.15 * k) for k in range(30)]
    assert coached(up, after(5, (0.0, 0.0, -12.0)), holding=1.0) == ()
    assert kinds(coached(up, after(5, (0.0, 0.0, -12.0)), holding=0.0)) == ["unexplained_force"]


def test_what_the_fingers_hold_is_no_drift_as_it_is_carried():
    weight = [(0.0, 0.0, -min(2.5 * max(k - 5, 0), 10.0)) for k in range(60)]
    assert coached(along_x(60), weight, holding=1.0) == ()


def test_a_drift_across_the_weight_of_what_the_fingers_hold_is_found():
    drift = [(0.0, min(0.1 * k, 11.0), -12.0) for k in range(140)]
    assert kinds(coached(along_x(140, speed=0.12), drift, holding=1.0)) == ["bias_drift"]


def test_a_contact_leaves_the_tracked_bias_as_it_is():
    tracker, state = DriftTracker(0.5), DriftState()
    for _ in range(20):
        state = tracker.advance(state, (0.0, 0.5, 0.0), 0.1)
    assert state.mean[1] == pytest.approx(0.5, abs=0.05)
    for _ in range(20):
        state = tracker.advance(state, (0.0, 0.5, 15.0), 0.1)
    assert state.mean[2] == pytest.approx(0.0, abs=0.5)


def test_a_contact_that_was_taken_for_bias_does_not_hide_the_bias_for_good():
    tracker, state = DriftTracker(TARED_BIAS_N**2 / 10.0, most_n2=TARED_BIAS_N**2), DriftState()
    for k in range(20):  # a drift in free movement
        state = tracker.advance(state, (0.0, 0.0, -0.2 * k), 0.1)
    for _ in range(10):  # at rest
        state = tracker.wait(state, 0.1)
    for force in (0.0, 1.9, 4.4):  # the tool comes off a surface
        state = tracker.advance(state, (0.0, 0.0, force), 0.1)
    for _ in range(15):
        state = tracker.wait(state, 0.1)
    for k in range(5):
        state = tracker.advance(state, (0.0, 0.0, -6.0 - 0.1 * k), 0.1)
    assert state.mean[2] == pytest.approx(-6.4, abs=0.5)


def shaken(rate_hz: float, count: int = 20) -> tuple[list[Vector], list[Vector]]:
    """Positions and velocities of a hand that goes 0.1 m to and fro."""
    t, turns = STEP_S * np.arange(count), 2.0 * math.pi * rate_hz
    x, v = 0.4 + 0.1 * np.sin(turns * t), 0.1 * turns * np.cos(turns * t)
    return [(float(one), 0.0, 0.3) for one in x], [(float(one), 0.0, 0.0) for one in v]


def test_quick_reversals_are_too_fast_and_slow_ones_are_not():
    positions, velocities = shaken(2.0)
    assert kinds(coached(positions, velocities=velocities)) == ["too_fast"]
    positions, velocities = shaken(0.5)
    assert coached(positions, velocities=velocities) == ()


def test_what_the_poses_miss_is_measured_between_them():
    t = STEP_S * np.arange(4) - 1.5 * STEP_S
    poses = tuple(
        ObservedPose(float(one), (float(one**4), 0.0, 0.0), (float(4.0 * one**3), 0.0, 0.0), STILL, 0.0)
        for one in t
    )
    cubic = np.polyval(np.polyfit(t, t**4, 3), 0.0)  # through four poses, midway; the path is at 0 there
    hermite = -((STEP_S / 2.0) ** 4)  # error of the cubic with two velocities
    assert path_error(poses) == pytest.approx(abs(cubic - hermite))


@pytest.mark.parametrize("beside", [0.0, 0.02])
def test_a_straight_movement_that_stops_at_once_misses_nothing_of_its_path(beside: float):
    """Of its 5 mm, all are a difference of time: the program leads along the same straight line."""
    places, speeds = (0.0, 0.12, 0.2, 0.2), (1.2, 1.2, 0.0, 0.0)
    poses = tuple(
        ObservedPose(STEP_S * k, (x, beside * (k % 2), 0.0), (v, 0.0, 0.0), STILL, 0.0)
        for k, (x, v) in enumerate(zip(places, speeds, strict=True))
    )
    assert (path_error(poses) > 1e-9) == (beside > 0.0)


def test_what_the_poses_miss_beside_the_middle_counts_too():
    """A path with equal slopes beyond the cubic's, which the two cross midway."""
    poses = tuple(
        ObservedPose(STEP_S * k, (0.0, 0.0, 0.0), (v, 0.0, 0.0), STILL, 0.0)
        for k, v in enumerate((0.0, 0.3, 0.3, 0.0))
    )
    s = np.linspace(0.0, 1.0, 1001)
    missed = 0.3 * STEP_S * (s * (1.0 - s) ** 2 - s**2 * (1.0 - s))  # Hermite's, with those two slopes
    assert missed[500] == pytest.approx(0.0, abs=1e-12)
    assert path_error(poses) == pytest.approx(np.abs(missed).max(), rel=0.03)


def turned(angles: Sequence[float], rates: Sequence[float], flip: int = -1) -> tuple[ObservedPose, ...]:
    """Four poses about z by angles [rad] with rates [rad/s]; the quaternion of one has the other sign."""
    poses = []
    for k, (angle, rate) in enumerate(zip(angles, rates, strict=True)):
        sine, cosine, sign = math.sin(0.5 * angle), math.cos(0.5 * angle), -1.0 if k == flip else 1.0
        quaternion = (0.0, 0.0, sign * sine, sign * cosine)
        turning = (0.0, 0.0, sign * 0.5 * rate * cosine, -sign * 0.5 * rate * sine)
        poses.append(
            ObservedPose(STEP_S * k, AT_REST, STILL, STILL, 0.0, None, False, None, quaternion, turning)
        )
    return tuple(poses)


@pytest.mark.parametrize("flip", [-1, 0, 1, 2, 3])
def test_a_turn_that_goes_back_between_two_poses_is_missed(flip: int):
    """Shaking by 20° five times a second, seen where it passes the middle, was in no app and in no note."""
    turns = 2.0 * math.pi * 5.0
    rates = [0.35 * turns * (-1) ** k for k in range(4)]
    missed = turn_error(turned((0.0,) * 4, rates, flip))
    assert missed == pytest.approx(0.25 * 0.35 * turns * STEP_S, rel=0.01)


def test_a_quick_turn_that_stops_at_once_misses_nothing():
    assert turn_error(turned((0.0, 0.3, 0.5, 0.5), (3.0, 3.0, 0.0, 0.0))) < math.radians(0.5)


def test_a_hint_on_a_turn_that_is_too_fast_says_so():
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for pose in turned((0.0,) * 4, [0.35 * 10.0 * math.pi * (-1) ** k for k in range(4)]):
        coach.observe(pose)
    (hint,) = coach.log.hints
    assert (hint.kind, hint.text) == (
        "too_fast",
        "Too fast: the recorded turn is off by up to 16° (limit 1°).",
    )


def test_the_first_hint_of_a_kind_is_known_after_many_others():
    """Of cleared hints the newest are kept: a note on the first one named a later time."""
    log = HintLog()
    for k in range(2 * CLEARED_KEPT):
        log.raise_hint(Hint(kind="too_fast", since=float(k), text="Too fast.", advice="Slower."))
        log.clear("too_fast", k + 0.5)
    assert log.first == {"too_fast": 0.0}


@pytest.fixture(scope="module")
def panda() -> ArmLimits:
    robot = load_panda()
    return ArmLimits(robot.lower_limits, robot.upper_limits, robot.flange_jacobian)


def led(joint: int, to: float, count: int = 40) -> list[np.ndarray]:
    home = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    rows = np.repeat(home[None], count, axis=0)
    rows[:, joint] = np.linspace(home[joint], to, count)
    return [*rows]


def test_a_joint_is_hinted_at_before_it_reaches_its_limit(panda: ArmLimits):
    joints = led(6, float(panda.upper[6]))
    (hint,) = coached([AT_REST] * 40, joints=joints, arm=panda)
    reached = next(k for k, row in enumerate(joints) if panda.upper[6] - row[6] < 0.05)
    assert hint.kind == "joint_limit"
    assert "Joint 7" in hint.text
    assert STEP_S * reached - 1.0 <= hint.since <= STEP_S * reached


@pytest.mark.parametrize(
    ("now_rad", "left_rad", "words"),
    [
        (0.2, -0.1, "Joint 4 is 11° from its limit, and reaches it within 0.5 s as it moves now."),
        (0.2, 0.04, "Joint 4 is 11° from its limit, and 2° within 0.5 s as it moves now."),
        (0.04, 0.04, "Joint 4 is 2° from its limit (margin 3°)."),
        (-0.01, -0.1, "Joint 4 is at its limit."),
    ],
)
def test_a_hint_at_a_limit_states_how_close_the_joint_is(now_rad, left_rad, words):
    """It stated that 0° would be left."""
    arm = ArmMeasures(joint=3, joint_left_rad=left_rad, left_now_rad=now_rad, joint_now_rad=now_rad)
    (rule,) = [one for one in RULES if one.trigger.kind == "joint_limit"]
    setup = CoachingSetup(clean_wrench=True, bias_n=2.3, path_tolerance_m=0.001)
    assert rule.words(Measures(arm=arm), setup) == (words, "Turn joint 4 back, away from its limit.")


def test_a_joint_that_slows_down_before_its_limit_gives_no_hint(panda: ArmLimits):
    """From 1 rad/s it stops within 1 s, 0.15 rad before: at its speed it would be within the margin."""
    joints = led(6, 0.0)
    for k, row in enumerate(joints):
        seconds = STEP_S * k
        row[6] = panda.upper[6] - 0.65 + min(seconds - 1.0, 0.0)
        if seconds > 1.0:
            row[6] += 0.5 * (1.0 - (2.0 - min(seconds, 2.0)) ** 2)
    assert panda.upper[6] - joints[-1][6] == pytest.approx(0.15)
    assert coached([AT_REST] * 40, joints=joints, arm=panda) == ()


def test_a_joint_that_is_within_the_margin_for_a_moment_is_hinted_at(panda: ArmLimits):
    for reached in range(20, 23):  # for two observations; one in three was looked at
        joints = led(6, 0.0)
        for row in joints:
            row[6] = panda.upper[6] - 0.2
        for row in joints[reached : reached + 2]:
            row[6] = panda.upper[6] - 0.04
        assert kinds(coached([AT_REST] * 40, joints=joints, arm=panda)) == ["joint_limit"]


def test_a_joint_that_is_within_its_margin_is_hinted_at_soon_after_another_hint(panda: ArmLimits):
    """The first hint saw it coming, and was cleared as the joint slowed down: then its kind was silent."""
    joints = led(6, 0.0)
    for k, row in enumerate(joints):
        row[6] = panda.upper[6] - (0.7 - 0.1 * min(k, 4) if k < 25 else 0.04)
    hints = coached([AT_REST] * 40, joints=joints, arm=panda)
    assert [round(hint.since, 1) for hint in hints] == [0.3, 2.6]


def test_a_straight_elbow_is_near_a_singularity(panda: ArmLimits):
    hints = coached([AT_REST] * 40, joints=led(3, -0.1), arm=panda)
    assert "singularity" in kinds(hints)
    assert coached([AT_REST] * 40, joints=led(3, -2.0), arm=panda) == ()


def test_a_hint_is_raised_once_cleared_when_over_and_not_again_for_a_while():
    def twice(calm: int) -> tuple[Hint, ...]:
        """Shaken twice, turning back between poses: beyond the limit, and not beyond twice the limit."""
        turns = 2.0 * math.pi * STEP_S * (np.arange(18) + 0.5) / 0.6
        x, v = 0.4 + 0.11 * (np.cos(turns[0]) - np.cos(turns)), 0.22 * math.pi / 0.6 * np.sin(turns)
        positions = [(float(one), 0.0, 0.3) for one in x]
        velocities = [(float(one), 0.0, 0.0) for one in v]
        path = [*positions, *[AT_REST] * calm, *positions]
        return coached(path, velocities=[*velocities, *[STILL] * calm, *velocities])

    (hint,) = twice(calm=20)
    assert hint.until is not None
    assert hint.since < hint.until <= 3.0
    assert kinds(twice(calm=80)) == ["too_fast", "too_fast"]


def test_a_level_of_twice_the_limit_is_not_silenced():
    forces = [*after(10, (4.0, 0.0, 0.0), total=12), *[STILL] * 14, *[(40.0, 0.0, 0.0)] * 10]
    first, second = coached(along_x(36), forces)
    assert first.kind == second.kind == "hand_in_wrench"
    assert first.until is not None
    assert second.since < first.until + 5.0


def test_a_gap_asks_for_its_part_until_some_time_has_passed():
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    coach.report_gap(2.0, 2.5)
    (hint,) = coach.log.hints
    assert (hint.kind, hint.since, hint.t0, hint.tn, hint.until) == ("show_again", 2.5, 2.0, 2.5, None)
    coach.observe(ObservedPose(20.0, AT_REST, STILL, STILL, math.nan, after_gap=True))
    assert coach.log.hints[0].until == 20.0


Array = NDArray[np.float64]
Places = Callable[[Array], Array]  # places (n, c) at times (n,) [s]


def with_between(places: Places, count: int) -> tuple[ObservedPose, ...]:
    """Poses ten times a second, each with nine places since the one before; a place may have a quaternion."""
    looks = np.arange(1, 10) / 10.0 * STEP_S - STEP_S
    poses = []
    for t in STEP_S * np.arange(count):
        x, y, z, *turn = places(np.array([t]))[0].tolist()
        pose = ObservedPose(float(t), (x, y, z), STILL, STILL, 0.0, orientation=turn or None)
        poses.append(pose._replace(between=places(t + looks)))
    return tuple(poses)


def moving_along_x(x: Callable[[Array], Array]) -> Places:
    return lambda t: np.column_stack([x(t), 0.0 * t, 0.0 * t])


def hints_of(poses: Iterable[ObservedPose]) -> list[str]:
    coach = SignalCoach(CoachingSetup(False, TARED_BIAS_N, 0.002))
    for pose in poses:
        coach.observe(pose)
    return kinds(coach.log.hints)


@pytest.mark.parametrize("rate_hz", [8.0, 10.0, 12.0])
@pytest.mark.parametrize(("amplitude_m", "found"), [(0.005, ["too_fast"]), (0.001, [])])
def test_shaking_between_the_poses_is_too_fast(rate_hz: float, amplitude_m: float, found: list[str]):
    """A hand that shook the tool by 5 mm ten times a second stood still in ten poses a second."""
    shaking = moving_along_x(lambda t: amplitude_m * np.sin(2.0 * np.pi * rate_hz * t))
    assert hints_of(with_between(shaking, 20)) == found


@pytest.mark.parametrize(
    "x", [lambda t: 0.01 * np.exp(-(((t - 0.95) / 0.014) ** 2)), lambda t: 0.5 * np.minimum(t, 0.95)]
)
def test_a_knock_and_a_sudden_stop_are_no_shaking(x: Callable[[Array], Array]):
    """They are over before three steps between poses are."""
    assert hints_of(with_between(moving_along_x(x), 20)) == []


def test_what_lies_on_the_cubic_is_not_off_it_whatever_the_sign_of_a_quaternion_is():
    def turning(t: Array) -> Array:
        return np.column_stack([t**3, t**2, t, 0.0 * t, 0.0 * t, np.sin(0.5 * t), np.cos(0.5 * t)])

    first, before, after, last = with_between(turning, 4)
    before = before._replace(orientation=[-one for one in before.orientation or ()])
    assert deviation_between_poses((first, before, after, last)) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert after.between is not None
    shaken = after.between.copy()
    shaken[4, 3] += 0.01
    assert deviation_between_poses((first, before, after._replace(between=shaken), last))[1] == pytest.approx(
        0.02, rel=0.02
    )
    assert deviation_between_poses((first, before, after)) == (0.0, 0.0)


@pytest.mark.parametrize("parts", ["turns and between", "turns", "between", "neither"])
@pytest.mark.parametrize("size", [0.3, 3.0, 30.0])
def test_errors_are_left_out_only_where_all_of_them_are_within_their_tolerances(parts: str, size: float):
    """The bound that spares them is compared with the errors, of poses at random about a tolerance."""
    rng, tolerance_m, tolerance_rad = np.random.default_rng(0), 0.002, math.radians(1.0)
    scales = size * np.array([tolerance_m] * 3 + [0.5 * tolerance_rad] * 4)
    width, count = (7 if "turns" in parts else 3), 9 if "between" in parts else 0
    spared = 0
    for _ in range(200):
        middle = np.array([0.4, 0.0, 0.3, *rng.standard_normal(4)])
        rows = middle + 0.1 * scales * rng.standard_normal((4 + count, 7))
        rates = scales * rng.standard_normal((4, 7))
        poses = tuple(
            ObservedPose(STEP_S * k, row[:3], rate[:3], STILL, 0.0)._replace(
                orientation=row[3:width] or None, turning=rate[3:width] or None
            )
            for k, (row, rate) in enumerate(zip(rows[:4].tolist(), rates.tolist(), strict=True))
        )
        between = rows[4:, :width] if count else None
        poses = (*poses[:2], poses[2]._replace(between=between), poses[3])
        errors = InterpolationErrors(path_error(poses), turn_error(poses), *deviation_between_poses(poses))
        found = interpolation_errors(poses, tolerance_m, tolerance_rad)
        if found == InterpolationErrors():
            spared += 1
            assert max(errors.path_m, errors.shaken_m) < tolerance_m
            assert max(errors.turn_rad, errors.shaken_rad) < tolerance_rad
        else:
            assert found == errors
    assert size == 3.0 or (spared == 200 if size < 3.0 else spared < 100)
