"""Surfaces that are more than level, touched by a point."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest
from numpy.testing import assert_allclose

from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.shaped_surface_contact import (
    ContactWrench,
    Hole,
    HorizontalCylinder,
    Screw,
    ShapedContact,
)

STILL, DT = (0.0, 0.0, 0.0), 1e-3
SCREW = Screw(0.1, radius_m=0.01)
HOLE = Hole(0.1, radius_m=0.01)
BARREL = HorizontalCylinder(0.3, center_m=(0.0, 0.1), radius_m=0.2)


def turned(touch: ShapedContact, turns: float, rate: float, z: float) -> ContactWrench:
    """The last of what is felt over some turns at a rate [rad/s]."""
    felt = [
        touch.wrench_at((0.0, 0.0, z), STILL, rate, DT, 0.0)
        for _ in range(round(turns * 2 * pi / abs(rate) / DT))
    ]
    return felt[-1]


def test_a_screw_that_is_driven_by_two_turns_is_two_pitches_lower() -> None:
    touch, z = ShapedContact([SCREW]), 0.1 - 0.004
    before = touch.wrench_at((0.0, 0.0, z), STILL, 0.0, DT, 0.0).normal_n
    after = turned(touch, 2.0, 2.0, z)
    assert (before - after.normal_n) / SCREW.stiffness_n_per_m == pytest.approx(2 * SCREW.pitch_m, rel=0.01)
    assert after.torque_nm == pytest.approx(-SCREW.torque_nm - SCREW.torque_nm_per_rad * 4 * pi, rel=0.02)


def test_a_screw_lets_a_tool_turn_back_freely_and_does_not_come_out() -> None:
    touch, z = ShapedContact([SCREW]), 0.1 - 0.002
    turned(touch, 0.5, 2.0, z)
    low = touch.wrench_at((0.0, 0.0, z), STILL, 0.0, DT, 0.0).normal_n
    back = turned(touch, 0.5, -2.0, z)
    assert 0.0 < back.torque_nm < 0.05
    assert back.normal_n == pytest.approx(low)


def test_a_tool_in_the_air_feels_no_screw() -> None:
    assert_allclose(ShapedContact([SCREW]).wrench_at((0.0, 0.0, 0.101), STILL, 2.0, DT, 0.0).force, 0.0)


def test_a_hole_gives_way_above_its_resistance_only_down_to_its_floor() -> None:
    touch = ShapedContact([HOLE, Surface(0.1)])
    weak = HOLE.depth_for(0.9 * HOLE.resistance_n)
    assert touch.wrench_at((0.0, 0.0, 0.1 - weak), STILL, 0.0, DT, 0.0).normal_n == pytest.approx(9.0)
    for depth in np.linspace(weak, HOLE.floor_m, 2500):
        at_floor = touch.wrench_at((0.0, 0.0, 0.1 - depth), STILL, 0.0, DT, 0.0)
    most = HOLE.resistance_n + HOLE.resistance_n_per_m * HOLE.floor_m
    assert at_floor.normal_n == pytest.approx(most, rel=0.05)
    for _ in range(2):
        beyond = touch.wrench_at((0.0, 0.0, 0.1 - HOLE.floor_m - 0.002), STILL, 0.0, DT, 0.0)
    assert beyond.normal_n == pytest.approx(0.002 * HOLE.stiffness_n_per_m, rel=0.05)


def test_the_walls_of_a_hole_push_a_peg_back_and_leave_empty_fingers_alone() -> None:
    touch = ShapedContact([HOLE, Surface(0.1)])
    for _ in range(100):
        touch.wrench_at((0.0, 0.0, 0.1 - 0.02), STILL, 0.0, DT, 2.0)
    assert touch.wrench_at((0.003, 0.0, 0.08), STILL, 0.0, DT, 2.0).force[0] < -5.0
    assert touch.wrench_at((0.003, 0.0, 0.08), STILL, 0.0, DT, 0.0).force[0] == 0.0
    assert (
        touch.wrench_at((0.02, 0.0, 0.085), STILL, 0.0, DT, 0.0).normal_n == 0.0
    )  # below the rim, round the peg


@pytest.mark.parametrize("lean", [-0.6, 0.0, 0.5])
def test_a_barrel_pushes_along_its_normal(lean: float) -> None:
    y, z = 0.1 + 0.199 * sin(lean), 0.3 - 0.2 + 0.199 * cos(lean)
    felt = ShapedContact([BARREL]).wrench_at((0.0, y, z), STILL, 0.0, DT, 0.0)
    assert_allclose(felt.force, felt.normal_n * np.array([0.0, sin(lean), cos(lean)]), atol=1e-9)
    assert felt.normal_n == pytest.approx(BARREL.static_force(0.001))


def test_friction_on_a_barrel_is_along_it_and_never_more_than_its_share() -> None:
    touch, lean = ShapedContact([BARREL]), 0.5
    along = (0.0, 0.1 * cos(lean), -0.1 * sin(lean))
    place = (0.0, 0.1 + 0.199 * sin(lean), 0.1 + 0.199 * cos(lean))
    for _ in range(50):
        felt = touch.wrench_at(place, along, 0.0, DT, 0.0)
    friction = np.array(felt.force) - felt.normal_n * np.array([0.0, sin(lean), cos(lean)])
    assert_allclose(friction, -BARREL.friction * felt.normal_n * (0.0 * friction + along) / 0.1, atol=1e-6)
