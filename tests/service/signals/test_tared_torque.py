"""The torque of an observation: tared, in base axes, and there only where it says something."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from caesura_service.signals import Conditioner, SampleLayout
from service.signals.samples import FORCE, POSITION, QUATERNION, TORQUE, column, condition, times, together

COLUMNS = ("t", *POSITION, *QUATERNION, *FORCE, *TORQUE)
STATIC_N, STATIC_NM = np.array([4.0, -6.0, -180.0]), np.array([0.4, -2.0, 0.7])
WRENCH = np.array([2.0, -1.0, 12.0, 0.1, -0.2, 0.9])  # on the robot, base axes, from 1 s on


def turned_by(t: np.ndarray, axis: tuple[float, float, float]) -> Rotation:
    """At rest for 1 s, then 0.8 rad/s about an axis."""
    lean = Rotation.from_rotvec([0.3, 0.1, 0.0])
    return Rotation.from_rotvec(np.outer(0.8 * np.maximum(t - 1.0, 0.0), axis)) * lean


@pytest.mark.parametrize("frame", ["base", "flange"])
def test_a_large_static_wrench_is_taken_off_however_the_sensor_turns(frame: str) -> None:
    """The sensor's own torque turns with the flange, its force of 180 N is the weight of what hangs there."""
    t = times(200.0, 4.0)
    turn = turned_by(t, (0.0, 0.0, 1.0))
    felt = np.where(t[:, None] > 1.0, WRENCH, 0.0)
    force, torque = felt[:, :3] + STATIC_N, felt[:, 3:] + turn.apply(STATIC_NM)
    if frame == "flange":
        force, torque = turn.inv().apply(force), turn.inv().apply(torque)
    layout = SampleLayout(COLUMNS, wrench_source="flange_sensor", force_frame=frame)
    rest = np.tile([0.4, 0.0, 0.3], (len(t), 1))
    observations = condition(layout, t, rest, turn.as_quat(), force, torque)
    late = [one for one in observations if one.t > 1.2]
    assert_allclose(column(late, "force_base"), [WRENCH[:3]] * len(late), atol=2e-3)
    assert_allclose(column(late, "torque_base"), [WRENCH[3:]] * len(late), atol=2e-3)


def test_the_note_names_what_is_taken_off() -> None:
    conditioner = Conditioner(SampleLayout(COLUMNS, wrench_source="flange_sensor"))
    t = times(200.0, 2.0)
    ones = np.ones((len(t), 1))
    flat = [0.0, 0.0, 0.0, 1.0]
    together(conditioner, [np.hstack([t[:, None], ones * [[0.4, 0, 0.3, *flat, *STATIC_N, *STATIC_NM]]])])
    assert "(4.00, -6.00, -180.00) N and (0.40, -2.00, 0.70) Nm are subtracted" in conditioner.tare_note


def test_a_start_in_motion_leaves_no_torque_because_its_bias_is_not_known() -> None:
    t = times(200.0, 2.0)
    moving = np.column_stack([0.4 * t, 0.0 * t, 0.0 * t])
    ones = np.ones((len(t), 1))
    layout = SampleLayout(COLUMNS, wrench_source="flange_sensor")
    observations = condition(layout, t, moving, ones * [0, 0, 0, 1.0], ones * STATIC_N, ones * STATIC_NM)
    assert {one.torque_base for one in observations} == {None}


@pytest.mark.parametrize(
    ("columns", "source", "expected"),
    [
        (COLUMNS, "flange_sensor", True),
        (COLUMNS, "flange_sensor_with_hand", False),
        (COLUMNS, "none", False),
        (COLUMNS, None, False),
        (COLUMNS[:-3], "flange_sensor", False),
    ],
)
def test_a_torque_is_looked_at_where_it_is_of_the_environment_alone(
    columns: tuple[str, ...],
    source: str | None,
    expected: bool,
) -> None:
    assert SampleLayout(columns, wrench_source=source).has_torque is expected


def test_other_numbers_do_not_depend_on_whether_there_is_a_torque() -> None:
    rng = np.random.default_rng(0)
    t = times(200.0, 2.0)
    pose = np.hstack(
        [
            np.cumsum(rng.normal(0, 1e-4, (len(t), 3)), axis=0),
            Rotation.random(1, rng=rng).as_quat() * np.ones((len(t), 1)),
        ]
    )
    force, torque = rng.normal(0, 0.1, (2, len(t), 3))
    one = condition(SampleLayout(COLUMNS, wrench_source="flange_sensor"), t, pose, force, torque)
    other = condition(SampleLayout(COLUMNS[:-3], wrench_source="flange_sensor"), t, pose, force)
    for name in ("t", "position_base", "force_base", "orientation", "rotation", "speed"):
        np.testing.assert_array_equal(column(one, name), column(other, name))
