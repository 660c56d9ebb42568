"""From samples to observations: signals whose conditioned form is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from caesura_service.signals import Conditioner, ConditioningParameters, SampleLayout
from caesura_service.signals.backend import REFERENCE, Backend, best
from service.signals.samples import (
    FORCE,
    JOINTS,
    POSITION,
    QUATERNION,
    TAU,
    along,
    column,
    condition,
    positions_only,
    times,
    together,
)

Array = NDArray[np.float64]

POSE = SampleLayout(("t", *POSITION), wrench_source="none")


def test_a_flange_at_rest_stays_where_it_is() -> None:
    observations = positions_only(times(1000.0, 2.0), lambda t: np.full_like(t, 0.4))
    assert_allclose(column(observations, "position_base"), [[0.4, 0.0, 0.0]] * len(observations), atol=1e-15)
    assert_allclose(column(observations, "speed"), 0.0, atol=1e-12)


@pytest.mark.parametrize("rate_hz", [60.0, 100.0, 700.0, 1000.0])
def test_a_steady_motion_passes_exactly_and_undelayed(rate_hz: float) -> None:
    observations = positions_only(times(rate_hz, 3.0, start_s=7.0), lambda t: 0.2 * t)
    assert_allclose(column(observations, "position_base")[:, 0], 0.2 * column(observations, "t"), atol=1e-12)
    assert_allclose(column(observations, "speed"), 0.2, atol=1e-10)


def test_observations_stand_on_the_segmentation_grid_and_count_up() -> None:
    observations = positions_only(times(333.0, 2.0, start_s=3.21), np.sin)
    assert_allclose(column(observations, "t"), 3.21 + 0.1 * np.arange(1, len(observations) + 1), atol=1e-12)
    assert [o.index for o in observations] == list(range(len(observations)))
    assert len(observations) == 19


@pytest.mark.parametrize("frequency_hz", [0.5, 2.0, 4.0])
def test_a_sine_keeps_its_phase_and_loses_what_cell_and_filter_take(frequency_hz: float) -> None:
    observations = positions_only(times(1000.0, 4.0), lambda t: np.sin(2 * np.pi * frequency_hz * t))
    parameters = ConditioningParameters()
    window = np.exp(2j * np.pi * frequency_hz * np.arange(-5, 6) / 100.0)
    gain = np.sinc(frequency_hz / 100.0) * (parameters.filter.taps[0] @ window.real)
    expected = gain * np.sin(2 * np.pi * frequency_hz * column(observations, "t"))
    assert_allclose(column(observations, "position_base")[:, 0], expected, atol=5e-6 * frequency_hz**2)


def test_the_delay_is_the_declared_one() -> None:
    conditioner = Conditioner(POSE)
    late = [
        sample[0, 0] - observation.t
        for sample in np.split(np.column_stack([times(1000.0, 2.0), np.zeros((2001, 3))]), 2001)
        for observation in conditioner.push(sample).observations
    ]
    assert conditioner.delay_s == pytest.approx(0.055)
    assert len(late) == 19
    assert min(late) >= conditioner.delay_s - 1e-9
    assert max(late) <= conditioner.delay_s + 0.001 + 1e-9


def test_moving_the_origin_moves_observations_and_nothing_else() -> None:
    t = times(1000.0, 3.0)
    near = positions_only(t, lambda t: 0.3 * np.sin(t))
    far = positions_only(t, lambda t: 1.0 + 0.3 * np.sin(t))
    moved = column(far, "position_base") - column(near, "position_base")
    assert_allclose(moved, [[1.0, 0.0, 0.0]] * len(near), atol=1e-12)
    assert_allclose(column(far, "speed"), column(near, "speed"), atol=1e-12)


@pytest.mark.parametrize("metres_per_unit", [0.01, 0.001])
def test_the_unit_of_the_input_changes_nothing(metres_per_unit: float) -> None:
    t = times(500.0, 2.0)
    path = along((0.1, 0.2, -0.3), np.sin(t))
    layout = SampleLayout(POSE.columns, wrench_source="none", metres_per_unit=metres_per_unit)
    in_units, in_metres = condition(layout, t, path / metres_per_unit), condition(POSE, t, path)
    expected = column(in_metres, "position_base")
    assert_allclose(column(in_units, "position_base"), expected, atol=1e-14)


def pose_of_joints(q: Array) -> tuple[Array, Array]:
    return 0.1 * q[:, :3], np.tile([0.0, 0.0, -0.6, -0.8], (len(q), 1))


def test_joints_give_the_pose_that_the_robot_says() -> None:
    t = times(200.0, 2.0)
    q = np.stack([np.sin((i + 1) * t) for i in range(7)], axis=1)
    layout = SampleLayout(("t", *JOINTS), wrench_source="none", pose_of_joints=pose_of_joints)
    by_joints, by_pose = condition(layout, t, q), condition(POSE, t, 0.1 * q[:, :3])
    assert_allclose(column(by_joints, "position_base"), column(by_pose, "position_base"), atol=1e-15)
    assert_allclose(np.abs(column(by_joints, "orientation")), [[0.0, 0.0, 0.6, 0.8]] * len(by_pose))
    assert_allclose(column(by_joints, "joints")[:, 0], np.sin(column(by_joints, "t")), atol=1e-3)


def test_a_measured_position_goes_before_the_one_from_joints() -> None:
    t = times(200.0, 1.0)
    layout = SampleLayout(("t", *POSITION, *JOINTS), wrench_source="none", pose_of_joints=pose_of_joints)
    observations = condition(layout, t, along((0.0, 0.0, 0.5), np.ones_like(t)), np.full((len(t), 7), 2.0))
    assert_allclose(column(observations, "position_base"), [[0.0, 0.0, 0.5]] * len(observations), atol=1e-15)
    assert_allclose(column(observations, "joints"), 2.0, atol=1e-14)


def test_the_robot_is_asked_on_the_grid_only() -> None:
    asked: list[int] = []

    def counting(q: Array) -> tuple[Array, Array]:
        asked.append(len(q))
        return pose_of_joints(q)

    t = times(1000.0, 1.0)
    condition(SampleLayout(("t", *JOINTS), "none", pose_of_joints=counting), t, np.zeros((len(t), 7)))
    assert asked == [95, 4]  # up to the last observation that is complete, and at the end


def test_joint_torques_become_a_force() -> None:
    t = times(200.0, 2.0)
    layout = SampleLayout(
        ("t", *JOINTS, *TAU),
        wrench_source="joint_torque_estimate",
        pose_of_joints=pose_of_joints,
        wrench_of_joint_torques=lambda q, tau: 2.0 * tau[:, :6],
    )
    tau = along((1.0, 0.0, 0.0), (t > 1.0).astype(float)) @ np.eye(3, 7)
    observations = condition(layout, t, np.zeros((len(t), 7)), tau)
    assert_allclose(observations[-1].force_base, [2.0, 0.0, 0.0], atol=1e-12)


def test_an_orientation_is_of_unit_length_and_continuous() -> None:
    t = times(1000.0, 3.0)
    half = 1.5 * t
    turning = np.stack([0 * t, 0 * t, np.sin(half), np.cos(half)], axis=1)
    turning[::7] *= -1.0
    observations = condition(
        SampleLayout(("t", *POSITION, *QUATERNION), "none"), t, np.zeros((len(t), 3)), turning
    )
    orientation = column(observations, "orientation")
    assert_allclose(np.linalg.norm(orientation, axis=1), 1.0, atol=1e-15)
    angle = 1.5 * column(observations, "t")
    expected = -np.stack([0 * angle, 0 * angle, np.sin(angle), np.cos(angle)], axis=1)
    assert_allclose(orientation, expected, atol=1e-12)


def test_a_gap_is_reported_and_marks_the_observation_after_it() -> None:
    t = np.concatenate([times(100.0, 1.0), times(100.0, 1.0, start_s=2.04)])
    result = together(Conditioner(POSE), [np.column_stack([t, along((1.0, 0.0, 0.0), t)])])
    assert result.gaps == ((1.0, 2.04),)
    at = column(result.observations, "t")
    assert_allclose(at, [*np.arange(1, 10) / 10, *np.arange(21, 30) / 10], atol=1e-12)
    assert [o.t for o in result.observations if o.after_gap] == [pytest.approx(2.1)]
    assert_allclose(column(result.observations, "position_base")[:, 0], at, atol=1e-12)


@pytest.mark.parametrize("arithmetic", [REFERENCE, best()], ids=["reference", "best"])
def test_joints_that_are_held_with_a_pose_are_interpolated_with_it(arithmetic: Backend) -> None:
    """They stayed behind by up to a reading: an app's joints were 9 mm from its target."""
    t = times(200.0, 2.0)
    read_at = np.floor(t / 0.08 + 1e-9) * 0.08
    samples = np.column_stack([t, *[0.2 * read_at] * 3, *[0.5 * read_at] * 7])
    layout = SampleLayout(("t", *POSITION, *JOINTS), wrench_source="none")
    observations = together(Conditioner(layout, arithmetic=arithmetic), [samples]).observations[:18]
    joints = np.array([one.joints for one in observations])
    assert_allclose(joints[:, 0], 0.5 * column(observations, "t"), atol=1e-12)
    assert_allclose(column(observations, "position_base")[:, 0], 0.4 * joints[:, 0], atol=1e-12)


@pytest.mark.parametrize("arithmetic", [REFERENCE, best()], ids=["reference", "best"])
def test_joints_that_go_on_while_a_pose_is_held_stay_as_they_are(arithmetic: Backend) -> None:
    t = times(200.0, 2.0)
    held = along((1.0, 1.0, 1.0), 0.2 * np.floor(t / 0.08 + 1e-9) * 0.08)
    joints = np.tile(np.sin(9.0 * t)[:, None], 7)
    layout = SampleLayout(("t", *POSITION, *JOINTS), wrench_source="none")
    of_held, of_moved = (
        together(
            Conditioner(layout, arithmetic=arithmetic), [np.column_stack([t, pose, joints])]
        ).observations
        for pose in (held, along((1.0, 1.0, 1.0), 0.2 * t))
    )
    assert_array_equal([one.joints for one in of_held[:18]], [one.joints for one in of_moved[:18]])


def test_a_declared_gap_is_reported_with_the_sample_that_ends_it() -> None:
    conditioner = Conditioner(POSE)
    samples = np.column_stack([times(100.0, 2.0), np.zeros((201, 3))])
    conditioner.push(samples[:100])
    conditioner.declare_gap()
    assert conditioner.push(samples[80:81]).gaps == ()
    result = conditioner.push(samples[100:])
    assert result.gaps == ((0.99, 1.0),)
    assert result.observations[0].after_gap
    assert result.observations[0].t == pytest.approx(1.1)


def test_losing_samples_before_the_first_one_is_no_gap() -> None:
    conditioner = Conditioner(POSE)
    conditioner.declare_gap()
    assert conditioner.push(np.column_stack([times(100.0, 1.0), np.zeros((101, 3))])).gaps == ()


def test_samples_repeats_and_observations_are_counted() -> None:
    conditioner = Conditioner(POSE)
    samples = np.column_stack([times(100.0, 1.0), np.zeros((101, 3))])
    first, second = conditioner.push(samples), conditioner.push(samples[80:])
    assert (first.samples, first.repeats, second.repeats) == (101, 0, 21)
    assert (conditioner.samples, conditioner.repeats, conditioner.observations) == (122, 21, 9)


def test_an_observation_cannot_be_written_to() -> None:
    observation = positions_only(times(100.0, 1.0), np.sin)[0]
    with pytest.raises(ValueError, match="read-only"):
        observation.position_base[0] = 1.0


def test_nothing_follows_the_end() -> None:
    conditioner = Conditioner(POSE)
    conditioner.finish()
    assert conditioner.finish().observations == ()
    with pytest.raises(RuntimeError, match="push after finish"):
        conditioner.push(np.zeros((1, 4)))


BAD_SAMPLES = {
    "wrong column count": (np.zeros((5, 3)), r"shape \(5, 3\), expected \(n, 9\)"),
    "not a matrix": (np.zeros(9), r"shape \(9,\), expected \(n, 9\)"),
    "not finite": (np.full((1, 9), np.nan), "sample 0: t is nan, expected a finite number"),
    "no quaternion": (
        np.zeros((2, 9)),
        "sample 0: quaternion has norm 0, expected 1 ± 0.1: samples without an orientation",
    ),
    "angles for a quaternion": (
        np.array([[0, 0, 0, 0, 180.0, 0, 90.0, 0, 0]]),
        r"sample 0: quaternion has norm 201\.\d+, expected 1 ± 0.1: is it a rotation vector, or angles\?",
    ),
    "impossible time": (np.full((1, 9), 1e11), "t is 100000000000.0, expected a time"),
    "gripper in millimetres": (
        np.array([[0, 0, 0, 0, 0, 0, 0, 1, 80.0]]),
        "gripper is 80.0, expected an opening",
    ),
}


@pytest.mark.parametrize("arithmetic", [REFERENCE, best()], ids=["reference", "best"])
@pytest.mark.parametrize(("samples", "message"), BAD_SAMPLES.values(), ids=BAD_SAMPLES)
def test_impossible_samples_are_refused_and_change_nothing(
    samples: Array, message: str, arithmetic: Backend
) -> None:
    layout = SampleLayout(("t", *POSITION, *QUATERNION, "gripper"), "none")
    conditioner = Conditioner(layout, arithmetic=arithmetic)
    with pytest.raises(ValueError, match=message):
        conditioner.push(samples)
    assert conditioner.samples == 0


def test_a_failing_robot_changes_nothing() -> None:
    def failing(q: Array) -> tuple[Array, Array]:
        raise ValueError(f"no pose for {len(q)} rows")

    conditioner = Conditioner(SampleLayout(("t", *JOINTS), "none", pose_of_joints=failing))
    with pytest.raises(ValueError, match="no pose for 95 rows"):
        conditioner.push(np.column_stack([times(100.0, 1.0), np.zeros((101, 7))]))
    assert (conditioner.samples, conditioner.repeats) == (0, 0)


BAD_LAYOUTS = {
    "unknown column": ({"columns": ("t", *POSITION, "wx")}, "unknown column 'wx', known"),
    "time not first": ({"columns": (*POSITION, "t")}, "first column is .*px.*, expected t"),
    "half a signal": ({"columns": ("t", "px", "py")}, r"'px' is there but pz of"),
    "a column twice": ({"columns": ("t", *POSITION, "px")}, r"columns \['px'\] stand more than once"),
    "no position": ({"columns": ("t", *FORCE)}, "expected position .* or joints"),
    "joints without a robot": ({"columns": ("t", *JOINTS)}, "7 joints and no position, expected a robot"),
    "unknown source": ({"wrench_source": "magic"}, "wrench_source is 'magic', expected one of"),
    "unknown frame": ({"force_frame": "tool"}, "force_frame is 'tool', expected one of"),
    "no length": ({"metres_per_unit": 0.0}, "metres_per_unit is 0.0, expected"),
    "no force": ({"wrench_source": "flange_sensor"}, "'flange_sensor' without force"),
    "no torques": ({"wrench_source": "joint_torque_estimate"}, "expected force .* or tau1"),
    "no orientation": (
        {"columns": ("t", *POSITION, *FORCE), "wrench_source": "flange_sensor", "force_frame": "flange"},
        "force_frame is 'flange' without orientation, expected qx qy qz qw, or joints",
    ),
}


@pytest.mark.parametrize(("options", "message"), BAD_LAYOUTS.values(), ids=BAD_LAYOUTS)
def test_a_layout_that_cannot_be_segmented_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SampleLayout(**({"columns": ("t", *POSITION), "wrench_source": "none"} | options))  # type: ignore[arg-type]


BAD_PARAMETERS = {
    "even window": ({"savgol_window": 10}, "window is 10, expected an odd number"),
    "window shorter than order": ({"savgol_window": 3, "savgol_order": 3}, "order is 3, expected 1 to 2"),
    "no divisor": ({"segmentation_hz": 30.0}, "segmentation_hz is 30, expected a divisor of grid_hz = 100"),
    "no time": ({"gap_limit_s": 0.0}, "gap_limit_s is 0.0, expected a finite number above 0"),
    "short tare": ({"tare_window_s": 0.05}, "tare_window_s is 0.05, expected more than 0.06"),
}


@pytest.mark.parametrize(("options", "message"), BAD_PARAMETERS.values(), ids=BAD_PARAMETERS)
def test_parameters_that_make_no_conditioning_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ConditioningParameters(**options)  # type: ignore[arg-type]


def test_times_are_exact_to_the_end_of_a_long_session() -> None:
    t = times(100.0, 1.0, start_s=36_000.0)
    observations = positions_only(t, lambda t: 0.1 * (t - 36_000.0))
    assert_array_equal(column(observations, "t"), 36_000.0 + np.arange(10, 100, 10) / 100.0)
    assert_allclose(column(observations, "position_base")[:, 0], np.arange(1, 10) / 100.0, atol=1e-11)
