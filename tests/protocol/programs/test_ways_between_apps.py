"""Scripts of an app that begins elsewhere than the app before it ends: the robot goes there first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.checks import document_findings
from caesura_protocol.programs.franky_script import POINTS_S
from caesura_protocol.programs.ways_between_apps import ways_to_paths
from harness.programs import DOWN, app, as_file, move, path_from, wiped

from . import fake_franky
from .franky_runs import flanges, motions, over_surface, passed, run
from .ur_runs import on_ur, places, played
from .xarm_runs import on_xarm
from .xarm_runs import run as run_xarm

BEGINS, ENDS = (0.3, -0.3, 0.3), (0.3, -0.3, 0.4)
LATER, LAST = (0.35, -0.3, 0.4), (0.35, -0.5, 0.4)
AROUND = [BEGINS, ENDS, LATER, LAST]
TURNED = (0.0, 1.0, 0.0, 0.0)  # by 90° from DOWN


def astray(later: Vector = LATER) -> tuple[App, App]:
    """Two movements of one second: the second was taught from elsewhere than where the first one ends."""
    return move(0.0, BEGINS, ENDS), move(1.0, later, LAST)


def test_a_ur_arm_goes_to_where_the_next_path_begins() -> None:
    assert np.array(places(played(on_ur(astray()))))[-4:, :3] == pytest.approx(np.array(AROUND))


def test_an_xarm_goes_to_where_the_next_path_begins() -> None:
    assert run_xarm(on_xarm(astray())).moves()[:, :3] / 1000 == pytest.approx(np.array(AROUND))


def test_a_franka_arm_goes_to_where_the_next_path_begins() -> None:
    *_, first, second = motions(run(as_file(astray())))
    assert passed(first)[-1][1].pose.translation.tolist() == list(ENDS)
    (later_s, later), *_, (last_s, last) = passed(second)
    assert later.pose.translation.tolist() == list(LATER)
    assert later.velocity.linear.tolist() == [0.0, 0.0, 0.0]
    assert last.pose.translation.tolist() == list(LAST)
    assert (later_s, last_s) == pytest.approx((0.25, 1.25))  # at 0.2 m/s


def test_the_check_and_the_scripts_agree_on_a_way_that_is_in_no_app() -> None:
    (found,) = (str(one) for one in document_findings(as_file(astray())))
    assert "50 mm of motion" in found
    assert "the robot moves straight to the start of this app" in found


def test_a_path_that_begins_nearby_is_joined_at_its_first_point() -> None:
    near = (0.309, -0.3, 0.4)
    assert list(ways_to_paths(astray(near))) == [None, None]
    (joined_s, joined), *_ = passed(motions(run(as_file(astray(near))))[-1])
    assert joined_s == pytest.approx(POINTS_S)
    assert math.dist(joined.pose.translation, near) > 0.005


def test_the_check_says_that_a_path_which_begins_nearby_is_joined_after_its_start() -> None:
    # It said that the robot moves to the start, and no robot does within 10 mm.
    rested = move(2.0, (0.309, -0.3, 0.4), LAST)
    (found,) = (str(one) for one in document_findings(as_file((move(0.0, BEGINS, ENDS), rested))))
    assert "9 mm of motion" in found
    assert "are in no app: the robot joins the path of this app after its start" in found


def test_a_turn_to_where_a_path_begins_is_a_way_in_the_air_and_none_in_contact() -> None:
    turned = move(2.0, ENDS, LAST, TURNED)
    (_, way) = ways_to_paths((move(0.0, BEGINS, ENDS), turned))
    assert way is not None
    assert way.radians == pytest.approx(math.pi / 2)
    pressed = app("apply_force", 1.0, 2.0, ENDS, force=(0.0, 0.0, -5.0))
    touch = app("move_to_contact", 0.0, 1.0, ENDS)
    assert list(ways_to_paths((touch, pressed, turned))) == [None, None, None]


def test_fingers_move_where_the_app_before_ends_and_the_robot_leaves_from_there() -> None:
    leaves = path_from((0.3, -0.28, 0.4), 2.0, 3.0, 0.1)
    grasp = app("grasp", 1.0, 2.0, (0.3, -0.28, 0.4), gripper_width=0.05)
    lift = app("transport", 2.0, 3.0, (0.3, -0.28, 0.5), path=leaves)
    *_, way = ways_to_paths((move(0.0, BEGINS, ENDS), grasp, lift))
    assert way is not None
    assert way.metres == pytest.approx(0.02)


def test_a_contact_is_not_passed_on_the_way_to_a_path_that_begins_behind_it() -> None:
    # It begins nearer to the contact than the robot approaches it: there is no way to it in the air.
    first, over = move(0.0, BEGINS, (0.3, -0.3, 0.33)), (0.35, -0.3, 0.305)
    path = path_from(over, 1.0, 2.0, 0.005)
    touch = app("move_to_contact", 1.0, 2.0, (0.35, -0.3, 0.3), path=path)
    assert np.array(places(played(on_ur((first, touch)), table_m=0.302)))[1:, 2].min() >= 0.32 - 1e-6
    waypoints = motions(run(as_file((first, touch))))[-1].waypoints
    assert [round(point.target.pose.translation[2], 6) for point in waypoints] == [0.32]


def beside(off_m: float) -> tuple[App, ...]:
    """A stroke along x that was taught beside the place where its contact was made."""
    touch, stroke = wiped()
    assert stroke.path is not None
    x, y, z = stroke.path.start.position
    start = stroke.path.start.model_copy(update={"position": (x, y + off_m, z)})
    path = stroke.path.model_copy(update={"start": start})
    return touch, stroke.model_copy(update={"path": path, "target": (0.08, y + off_m, z)})


@pytest.mark.parametrize("off_m", [0.008, 0.03])
def test_a_franka_arm_slides_to_where_a_stroke_begins(off_m: float, monkeypatch: pytest.MonkeyPatch) -> None:
    made, runner = over_surface(monkeypatch, as_file(beside(off_m)), lambda x, y: 0.19)
    runner.run(made.APPS)
    pressed = next(
        m for m in motions(fake_franky.calls) if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion)
    )
    way = np.array([pose.translation[:2] for pose in flanges(pressed)])
    late_s = max(off_m / made.CONTACT_SPEED_M_PER_S - 0.8, 0.0)  # it rests for 0.8 s before its path
    begun = 1 + round((late_s + 0.8) / made.PERIOD_S)
    assert way[0] == pytest.approx([-0.02, -0.52], abs=1e-9)
    assert way[begun] == pytest.approx([-0.02, -0.52 + off_m], abs=1e-3)
    assert way[-1] == pytest.approx([0.08, -0.52 + off_m], abs=1e-6)
    assert len(way) - 1 == round((late_s + 2.3) / made.PERIOD_S)
    aside = np.abs(np.diff(way[:begun], axis=0)).max()
    assert aside <= made.CONTACT_SPEED_M_PER_S * made.PERIOD_S + 1e-9


def test_a_ur_arm_slides_to_where_a_stroke_begins() -> None:
    led = [call["pose"][:2] for call in played(on_ur(beside(0.03)), table_m=0.2).named("movep", "movel")]
    assert np.array(led[-2:]) == pytest.approx(np.array([[-0.02, -0.49], [0.08, -0.49]]))


def test_orientation_is_that_of_the_path_where_it_begins() -> None:
    turned = move(2.0, LATER, LAST, TURNED)
    *_, motion = motions(run(as_file((move(0.0, BEGINS, ENDS, DOWN), turned))))
    assert motion.waypoints[0].target.pose.quaternion.tolist() == list(TURNED)
