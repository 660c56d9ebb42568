"""How a setpoint moves: rotations, and the path of an app from where the robot is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from tests.harness.programs import DOWN, app, path_from

from caesura_lab.execution.trajectories import BRAKE_M_PER_S2, SLOW_M, app_path, arrival_speed
from caesura_protocol.messages import AppPath, ViaPoint
from caesura_protocol.programs.safety import DEFAULT
from caesura_protocol.reproduced_path import Curve
from caesura_protocol.rotations import matrix_of, quaternion_of, turning_of

CORNER = (0.3, -0.4, 0.3)


def test_rotations_agree_with_scipys() -> None:
    for seed in range(10):
        rotation = Rotation.random(rng=np.random.default_rng(seed))
        assert_allclose(matrix_of(tuple(rotation.as_quat())), rotation.as_matrix(), atol=1e-12)
        assert_allclose(matrix_of(tuple(quaternion_of(rotation.as_matrix()))), rotation.as_matrix())


def test_the_angular_velocity_is_that_of_the_rotation() -> None:
    first, turning, step = Rotation.from_quat(DOWN), np.array([0.3, -0.2, 0.5]), 1e-6
    after = Rotation.from_rotvec(step * turning) * first
    change = (after.as_quat() - first.as_quat()) / step
    assert_allclose(turning_of(first.as_quat(), change, np.zeros(4))[0], turning, atol=1e-5)


def test_the_angular_acceleration_is_that_of_the_angular_velocity() -> None:
    turned = (DOWN, (0.0, 1.0, 0.0, 0.0), (0.3, 0.8, 0.5, 0.1))
    curve = Curve.through([0.0, 0.5, 2.0], [[*CORNER, *one] for one in turned])
    rates = [turning_of(*(part[3:] for part in curve.at(t))) for t in (0.899, 0.9, 0.901)]
    assert_allclose((rates[2][0] - rates[0][0]) / 0.002, rates[1][1], rtol=1e-3, atol=1e-3)


def test_a_path_leads_from_where_the_robot_is_through_its_via_points_in_the_time_of_the_app() -> None:
    start, via = (
        ViaPoint(t=t, position=p, orientation=DOWN) for t, p in ((2.0, (0.3, -0.5, 0.3)), (3.0, CORNER))
    )
    path = AppPath(
        start=start, via=(via,), tn=4.0, length_m=0.2, deviation_m=0.0, deviation_rad=0.0,
        tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    moving = app("cartesian_motion", 2.05, 4.05, (0.4, -0.4, 0.3), path=path)
    near = app_path(moving, np.array([0.304, -0.5, 0.3]), matrix_of(DOWN), 4.0)
    assert near.t[-1] == 4.0
    assert_allclose(near.at(0.0)[0][:3], (0.304, -0.5, 0.3))
    assert_allclose(near.at(4.0)[0][:3], (0.4, -0.4, 0.3), atol=1e-12)
    assert np.linalg.norm(near.sampled(50)[:, :3] - CORNER, axis=1).min() < 1e-3
    far = app_path(moving, np.array([0.3, -0.6, 0.3]), matrix_of(DOWN), 4.0)
    assert np.linalg.norm(far.sampled(50)[:, :3] - start.position, axis=1).min() < 1e-3
    assert far.t[-1] == 4.0


def test_the_way_to_the_start_of_a_turn_takes_its_share_of_the_time_and_no_more() -> None:
    turned = Rotation.from_quat(DOWN) * Rotation.from_euler("z", 90.0, degrees=True)
    path = AppPath(
        start=ViaPoint(t=2.0, position=CORNER, orientation=DOWN), tn=4.0, length_m=0.0, deviation_m=0.0,
        deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    turning = app("cartesian_motion", 2.0, 4.0, CORNER, path=path)
    turning = turning.model_copy(update={"orientation": tuple(turned.as_quat().tolist())})
    beside = app_path(turning, np.add(CORNER, (0.015, 0.0, 0.0)), matrix_of(DOWN), 2.0)
    assert beside.t[1] == pytest.approx(2.0 * 0.015 / (0.015 + 0.1 * np.pi / 2.0))  # it was 60 % of the time
    leaning = Rotation.from_euler("x", 0.3) * Rotation.from_quat(DOWN)
    aside = app_path(turning, np.array(CORNER), leaning.as_matrix(), 2.0)
    assert aside.t[1] == pytest.approx(2.0 * 0.3 / (0.3 + np.pi / 2.0))


def test_towards_a_contact_the_speed_is_the_taught_one_until_it_must_brake() -> None:
    half = ViaPoint(t=3.0, position=(0.3, -0.4, 0.3), orientation=DOWN, velocity=(0.0, 0.01, 0.0))
    near = ViaPoint(t=3.9, position=(0.3, -0.311, 0.3), orientation=DOWN, velocity=(0.0, 0.18, 0.0))
    path = path_from((0.3, -0.5, 0.3), 2.0, 4.0, 0.2, via=(half, near))
    moving = app("cartesian_motion", 2.0, 4.0, (0.3, -0.3, 0.3), path=path)
    arriving = np.array([0.0, 0.03, 0.0])
    curve = app_path(moving, np.array(path.start.position), matrix_of(DOWN), 2.0, arriving)
    seconds = float(curve.t[-1])
    assert 2.0 < seconds < 2.5
    assert_allclose(curve.at(1.0)[0][:3], half.position, atol=2e-4)
    assert_allclose(curve.at(1.0)[1][:3], half.velocity, atol=2e-3)  # the hand hesitated there
    for t in np.linspace(0.0, seconds, 101):
        place, velocity, _ = curve.at(float(t))
        left_m = -0.3 - place[1]
        brakes_m = max(left_m - SLOW_M, 0.0)
        assert velocity[1] <= 1.1 * np.sqrt(0.03**2 + 2.0 * BRAKE_M_PER_S2 * brakes_m) + 1e-9


def test_a_path_goes_on_with_the_velocity_of_its_target_only_where_the_next_app_does() -> None:
    """A robot that moves begins as it moves; one that rests begins at rest, whatever was taught."""
    passing = np.array([0.0, 0.08, 0.0])
    start, there = (0.3, -0.5, 0.3), (0.3, -0.3, 0.3)
    path = path_from(start, 2.0, 4.0, 0.2).model_copy(update={"end_velocity": tuple(passing)})
    path = path.model_copy(update={"start": path.start.model_copy(update={"velocity": (0.0, 0.05, 0.0)})})
    moving = app("cartesian_motion", 2.0, 4.0, there, path=path)
    where = np.array(start), matrix_of(DOWN), 4.0  # twice as slow as it was taught
    alone = app_path(moving, *where)
    assert_allclose([alone.at(t)[1][:3] for t in (0.0, 4.0)], 0.0, atol=1e-12)
    onward = app_path(moving, *where, moving=np.array([0.0, 0.03, 0.0, 0.0, 0.0, 0.0]), passes_on=True)
    assert_allclose(onward.at(0.0)[1][:3], (0.0, 0.03, 0.0), atol=1e-12)
    assert_allclose(onward.at(4.0)[1][:3], passing / 2.0, atol=1e-12)


def test_the_robot_gets_onto_a_path_whose_first_via_point_is_soon_in_position_and_orientation() -> None:
    """The tool turned by what it was off within 25 ms, with three times what a Panda's joints may."""
    start, end = (0.3, -0.5, 0.3), (0.3, -0.3, 0.3)
    soon = ViaPoint(t=0.025, position=(0.3, -0.4998, 0.3), orientation=DOWN, velocity=(0.0, 0.02, 0.0))
    path = path_from(start, 0.0, 1.0, 0.2, via=(soon,))
    moving = app("cartesian_motion", 0.0, 1.0, end, path=path)
    off = np.radians(0.5)
    turned = Rotation.from_euler("x", off) * Rotation.from_matrix(matrix_of(DOWN))
    curve = app_path(moving, np.array(start), turned.as_matrix(), 1.0)
    left = [
        (Rotation.from_quat(curve.at(t)[0][3:]) * Rotation.from_quat(DOWN).inv()).magnitude()
        for t in np.linspace(0.0, 1.0, 101)
    ]
    assert left[0] == pytest.approx(off)
    assert left[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(left).min() > -0.02 * off
    assert curve.peaks()[1] < 2.0 * off / 0.3


def test_a_movement_that_lifts_off_first_meets_a_contact_no_slower_than_one_that_only_comes_down() -> None:
    """Its way up was subtracted from its way down, so it met the contact with 10 mm/s in place of 30 mm/s."""
    start, end = (0.4, -0.1, 0.2), (0.4, 0.1, 0.2)
    over = ViaPoint(t=0.4, position=(0.4, 0.0, 0.26), orientation=DOWN)
    lifts = app("move_to_contact", 0.0, 1.0, end, path=path_from(start, 0.0, 1.0, 0.24, via=(over,)))
    down = np.array([0.0, 0.0, -1.0])
    assert arrival_speed(lifts, down, np.array(start), DEFAULT) == DEFAULT.contact_speed_m_per_s
