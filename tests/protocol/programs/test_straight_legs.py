"""Straight legs of scripts: orientations, rates of turn and durations of what was taught."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import App, Quaternion, ViaPoint
from caesura_protocol.programs.planned_apps import PlannedApp, planned_apps
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.ur_script import ur_script
from harness.programs import DOWN, app, as_file, move, path_from, pick_and_place, press

from .fake_ur_controller import Controller

PLACE = (0.4, 0.3, 0.3)


def turned(degrees: float, orientation: Quaternion = DOWN) -> Quaternion:
    """The orientation after a turn about z of the base."""
    both = Rotation.from_euler("z", degrees, degrees=True) * Rotation.from_quat(orientation)
    x, y, z, w = both.as_quat().tolist()
    return x, y, z, w


def planned(*apps: App) -> list[PlannedApp]:
    return list(planned_apps(as_file(apps), 1.2))


def driven(degrees: float, advance_m: float, seconds: float) -> App:
    """A screw that is driven along z by an advance."""
    touched = press()[0]
    x, y, z = touched.target or PLACE
    begun, shares = touched.tn, np.linspace(0.0, 1.0, 7)
    start, *via, end = (
        ViaPoint(
            t=begun + share * seconds,
            position=(x, y, z - share * advance_m),
            orientation=turned(-share * degrees),
        )
        for share in shares.tolist()
    )
    path = path_from(start.position, begun, end.t, advance_m, via=tuple(via))
    stated = {"path": path, "orientation": end.orientation, "force": (0.0, 0.0, -8.0)}
    return app("apply_force", begun, end.t, end.position, **stated)


def test_a_turn_in_place_without_a_path_is_made():
    way, turn = move(0.0, (0.3, 0.3, 0.3), PLACE), app("cartesian_motion", 2.0, 4.0, PLACE)
    (leg,) = planned(way, turn.model_copy(update={"orientation": turned(90.0)}))[1].legs
    assert leg.orientation == pytest.approx(turned(90.0))
    assert leg.turn_rad == pytest.approx(math.radians(90.0))
    assert leg.seconds == pytest.approx(2.0)


@pytest.mark.parametrize("has_path", [True, False])
def test_no_leg_turns_faster_than_the_limit(has_path: bool):
    safety, start, end = Safety(), (0.4, 0.25, 0.3), PLACE
    path = path_from(start, 2.0, 2.3, math.dist(start, end))
    way = app("cartesian_motion", 2.0, 2.3, end, orientation=turned(60.0), path=path if has_path else None)
    (leg,) = planned(move(0.0, (0.3, 0.3, 0.3), start), way)[1].legs
    assert leg.speed_m_per_s is not None
    assert leg.turn_rad == pytest.approx(math.radians(60.0))
    assert leg.turn_rad * leg.speed_m_per_s / math.dist(start, end) <= safety.turn_rad_per_s + 1e-9


@pytest.mark.parametrize(("degrees", "advance_m"), [(90.0, 0.0006), (60.0, 0.0007), (140.0, 0.0006)])
def test_a_screw_with_a_small_advance_turns_at_the_taught_rate(degrees: float, advance_m: float):
    screw = driven(degrees, advance_m, 4.0)
    legs = planned(press()[0], screw)[1].legs
    assert sum(leg.seconds for leg in legs) == pytest.approx(4.0, rel=0.05)
    rates = [math.degrees(leg.turn_rad) / leg.seconds for leg in legs]
    assert max(rates) < 2.0 * degrees / 4.0


def test_a_hold_with_a_rounded_orientation_lasts_as_long_as_it_was_taught():
    """Its quaternion of another length than 1 was a turn, in which nothing turned."""
    touch, grasp, carry, *_ = pick_and_place()
    rounded = (-0.7, 0.7, 0.0, 0.0)
    held = app("hold", carry.tn, carry.tn + 2.5, carry.target, load_kg=0.25, orientation=rounded)
    hold = planned(touch, grasp, carry, held)[3]
    assert not hold.legs
    assert hold.hold_s == pytest.approx(2.5)


@pytest.mark.parametrize("metres", [0.000133, 0.00024, 0.0003, 0.00056, 0.0011])
def test_short_legs_have_a_speed_and_blends_that_do_not_overlap(metres: float):
    """Blends were rounded up to 0.1 mm, and a path of legs below 0.5 mm was left out."""
    corners = [(0.4 + metres * index, 0.3 + metres * (index % 2), 0.3) for index in range(7)]
    points = [ViaPoint(t=1.0 + index, position=at, orientation=None) for index, at in enumerate(corners)]
    path = path_from(corners[0], 1.0, 7.0, 6.0 * metres, via=tuple(points[1:-1]))
    path = path.model_copy(update={"start": points[0], "tolerance_m": 1e-5})
    way = app("cartesian_motion", 1.0, 7.0, corners[-1], orientation=None, path=path)
    controller = Controller()
    controller.play(ur_script(as_file((way,)).model_copy(update={"robot": "ur5e"})))
    moves = controller.named("movel")
    assert len(moves) > 6
    assert {move["t"] for move in moves} == {0}
    for one, other in itertools.pairwise(moves):
        length_m = math.dist(one["pose"][:3], other["pose"][:3])
        assert one["r"] + other["r"] <= length_m
