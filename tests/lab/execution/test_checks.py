"""The pre-run check: what cannot be run is named by app and reason; what was taught passes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_lab.execution.cell_limits import Cell
from caesura_lab.execution.cell_simulation import CellSimulation
from caesura_lab.execution.checks import DemonstrationQuality, check
from caesura_lab.execution.executor import SimulatedCell, execute
from caesura_lab.teacher.person import THESIS
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.messages import App, AppPath, Gap, ViaPoint
from caesura_protocol.programs.app_time_shifts import earlier
from caesura_protocol.programs.checks.findings import CheckReport, RefusedError
from caesura_protocol.programs.safety import Safety
from caesura_service.robot import Robot, load_panda, load_robot
from harness.programs import app, path_from, pick_and_place, press

Apps = tuple[App, ...]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_panda()


def cell(scenario: str) -> Cell:
    return CellSimulation(SCENARIOS[scenario], 0.25).cell()


def changed(apps: Apps, index: int, **fields: Any) -> Apps:
    return (*apps[:index], apps[index].model_copy(update=fields), *apps[index + 1 :])


def only(report: CheckReport) -> str:
    assert len(report.errors) == 1, [*map(str, report.errors)]
    return str(report.errors[0])


@pytest.mark.parametrize(("apps", "scenario"), [(pick_and_place(), "pick_and_place"), (press(), "dispenser")])
def test_a_program_that_can_be_run_passes_without_a_word(apps: Apps, scenario: str, robot: Robot) -> None:
    assert check(apps, cell(scenario), robot=robot).findings == ()
    assert check(apps, robot=robot).findings == ()  # nor where nobody knows what stands there


def standing_still() -> AppPath:
    """A path whose two points have the same time."""
    start = ViaPoint(t=10.1, position=(-0.02, -0.562, 0.3), orientation=None)
    return AppPath(
        start=start,
        tn=10.1,
        length_m=0.0,
        deviation_m=0.0,
        deviation_rad=0.0,
        tolerance_m=0.002,
        tolerance_rad=0.02,
    )


def without(index: int) -> Callable[[Apps], Apps]:
    return lambda apps: (*apps[:index], *apps[index + 1 :])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda a: changed(a, 5, target=(-0.02, -0.7, 0.7)), r"app 6 \(move\): .*out of reach"),
        (lambda a: changed(a, 5, target=(-0.02, -0.9, 0.3)), r"app 6 .*target y -900 mm .*workspace, -750"),
        (lambda a: changed(a, 5, joints=(4.0, *[0.0] * 6)), r"app 6 .*joint 1 at 4.000 rad, limits -2.897"),
        (
            lambda a: changed(a, 5, joints=(0.0, 0.6, 0.0, -2.2, 0.0, 2.8, 0.0)),
            r"app 6 .*joints put the flange \d+ mm from its target",
        ),
        (
            lambda a: changed(a, 5, target=(-0.02, -0.562, 0.05)),
            r"app 6 .*\d+ mm inside an obstacle",
        ),
        (
            lambda a: changed(a, 5, orientation=(1.0, 1.0, 0.0, 0.0)),
            r"app 6 .*length of the orientation 1.414",
        ),
        (lambda a: changed(a, 5, target=None), r"app 6 .*has no target"),
        (lambda a: changed(a, 2, load_kg=-0.1), r"app 3 \(transport\): load -0.1 kg, expected 0 to 3 kg"),
        (lambda a: changed(a, 1, gripper_width=0.2), r"app 2 \(grasp\): gripper width 200 mm"),
        (lambda a: changed(a, 5, tn=100.0), r"app 6 .*duration 89.9 s, expected 0.1 to 60 s"),
        (lambda a: changed(a, 5, confidence=1.5), r"app 6 .*confidence 1.5"),
        (
            lambda a: changed(a, 1, t0=0.0),
            r"app 2 .*begins at 0.00 s, expected after the start of the app before it",
        ),
        (
            lambda a: changed(a, 5, path=standing_still()),
            r"app 6 .*point at 10.1 s, expected after .* at 10.1 s",
        ),
        (without(4), r"app 2 \(grasp\): grasps an object that is never released"),
        (
            lambda a: (*a[:3], a[1].model_copy(update={"t0": 5.8, "tn": 6.0}), *a[3:]),
            "holds something already",
        ),
    ],
)
def test_what_cannot_be_run_is_refused_by_name(
    spoil: Callable[[Apps], Apps], said: str, robot: Robot
) -> None:
    report = check(spoil(pick_and_place()), cell("pick_and_place"), robot=robot)
    assert any(re.search(said, str(one)) for one in report.errors), [*map(str, report.errors)]


def test_a_finding_has_the_name_that_an_operator_gave_the_app(robot: Robot) -> None:
    """It named the kind, where the page and the program's table had the name."""
    apps = changed(without(2)(pick_and_place()), 1, name="grip the cup")
    report = check(changed(apps, 1, force_taught=(0.0, 0.0, -13.7)), cell("pick_and_place"), robot=robot)
    named = [str(one) for one in report.findings if one.index == 1]
    assert named
    assert all(": app 2 (grip the cup): " in one for one in named)


def turned(seconds: float) -> Apps:
    """A program of version 1: two places and a turn by 90° between them, about the tool."""
    there, half = (-0.02, -0.56, 0.3), (0.0, 1.0, 0.0, 0.0)
    first = app("cartesian_motion", 0.0, 2.0, there)
    return first, app("cartesian_motion", 2.0, 2.0 + seconds, there, orientation=half)


def slid(seconds: float) -> Apps:
    """A press of version 1 that turns by 90° while it presses."""
    touch, pressed, leave = press()
    turning = pressed.model_copy(update={"tn": pressed.t0 + seconds, "orientation": (0.0, 1.0, 0.0, 0.0)})
    return touch, turning, leave.model_copy(update={"t0": turning.tn, "tn": turning.tn + 2.0})


@pytest.mark.parametrize(
    ("apps", "said"),
    [
        (
            changed(pick_and_place(), 5, tn=10.5),
            r"app 6 .*0.40 s, 0.54 m/s are allowed, 0.9 .*: it is slowed",
        ),
        (
            turned(1.0),
            r"app 2 .*: reaches \d.\d\d rad/s in its 1.00 s, 2.25 rad/s .* slowed down to 1.\d\d s",
        ),
        (slid(1.0), r"app 2 \(apply force\): reaches \d.\d\d rad/s in its 1.00 s, 2.25 rad/s are allowed"),
    ],
)
def test_what_was_taught_faster_than_the_limits_is_said_to_be_slowed(
    apps: Apps, said: str, robot: Robot
) -> None:
    report = check(apps, robot=robot)
    assert report.passed
    (warning,) = report.warnings
    assert re.search(said, str(warning)), str(warning)
    assert warning.value is not None
    assert warning.limit is not None
    assert warning.value > warning.limit


def test_a_joint_that_would_be_too_fast_is_named() -> None:
    """A turn about the tool is within the limit of the flange, and not within that of joint 7."""
    report = check(turned(1.5), robot=load_robot("iiwa14"))
    assert report.passed
    (warning,) = report.warnings
    said = r"app 2 .*: reaches 2.\d\d rad/s at joint 7 in its 1.50 s, 2.00 rad/s are allowed, 0.85 of the"
    assert re.search(said, str(warning)), str(warning)
    assert warning.limit == pytest.approx(0.85 * np.radians(135.0), abs=1e-3)


def test_a_movement_that_is_slowed_down_by_less_than_a_hundredth_is_not_named(robot: Robot) -> None:
    slowed = check(turned(1.38), robot=robot).warnings
    assert [str(one) for one in slowed] == []


def test_a_turn_that_the_robot_can_do_passes_without_a_word(robot: Robot) -> None:
    assert check(turned(1.7), robot=robot).findings == ()  # at most 2 rad/s


@pytest.mark.parametrize(("aside", "passes"), [(0.13, True), (0.10, False)])
def test_the_fingertips_of_a_tilted_tool_decide_what_is_free(
    aside: float, passes: bool, robot: Robot
) -> None:
    """Over the flank of a barrel the flange may be lower than with fingers down."""
    tilt = math.radians(35.0)
    tip = np.array((0.46, -aside, 0.2 * math.cos(tilt) + 0.26 - 0.1034 - 0.2))  # on the barrel at 0.115
    tool = Rotation.from_rotvec((tilt, 0.0, 0.0)) * Rotation.from_quat((1.0, 0.0, 0.0, 0.0))
    flange = tip - 0.1034 * tool.as_matrix()[:, 2]
    high = flange - 0.05 * tool.as_matrix()[:, 2]
    x, y, z, w = tool.as_quat().tolist()
    apps = [
        app("cartesian_motion", 2.0 * k, 2.0 * k + 2.0, tuple(place.tolist()), orientation=(x, y, z, w))
        for k, place in enumerate((high, flange))
    ]
    report = check(apps, CellSimulation(SCENARIOS["contour"], 0.25).cell(), robot=robot)
    assert report.passed == passes, [*map(str, report.errors)]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize(
    "field", ["t0", "tn", "target", "orientation", "joints", "force", "load_kg", "confidence"]
)
def test_no_number_and_absurd_numbers_are_refused_wherever_they_stand(
    field: str, value: float, robot: Robot
) -> None:
    widths = {"target": 3, "orientation": 4, "joints": 7, "force": 3}
    spoilt = (value, *[0.1] * (widths[field] - 1)) if field in widths else value
    report = check(changed(press(), 1, **{field: spoilt}), cell("dispenser"), robot=robot)
    assert any(one.index == 1 for one in report.errors)


def test_a_press_needs_a_contact_before_it_and_pushes_within_the_limit(robot: Robot) -> None:
    here = cell("dispenser")
    assert "app 1 (apply force): presses without a contact" in str(
        check(press()[1:], here, robot=robot).errors[0]
    )
    strong, limited = changed(press(), 1, force=(0.0, 0.0, -12.0)), Safety(force_n=10.0)
    assert check(strong, here, robot=robot).findings == ()  # no limit is set
    refused = check(strong, replace(here, safety=limited), robot=robot)
    assert only(refused) == "error: app 2 (apply force): force 12 N, expected 1 to 10 N"
    assert (refused.errors[0].value, refused.errors[0].limit) == (12.0, limited.force_n)
    stronger = changed(press(), 1, force=(0.0, 0.0, -29.0))
    said = "app 2 (apply force): force 29.0 N is above 28.5 N: the robot is stopped at 30 N (felt_force_n)"
    (warned,) = check(stronger, here, robot=robot).findings
    assert str(warned).startswith(f"warning: {said}")
    with pytest.raises(RefusedError, match=re.escape(f"error: {said}")):
        execute(stronger, SimulatedCell(SCENARIOS["dispenser"], THESIS, 1))
    assert "pulls on the touched surface" in only(
        check(changed(press(), 1, force=(0.0, 0.0, 8.0)), here, robot=robot)
    )
    deep = changed(press(), 1, target=(-0.02, -0.52, 0.12))
    assert "presses 70 mm deep, at most 40 mm" in str(check(deep, here, robot=robot).errors[0])


@pytest.mark.parametrize(("deep_m", "refused"), [(0.035, False), (0.05, True)])
def test_a_contact_may_be_as_far_from_where_it_was_taught_as_the_arm_searches(
    deep_m: float, refused: bool, robot: Robot
) -> None:
    """It was an error where the touch was taught 3 mm too deep, though the arm stops at the touch."""
    touch, grasp, *rest = pick_and_place()
    assert touch.target is not None
    x, y, z = touch.target
    deep = changed((touch, grasp, *rest), 0, target=(x, y, z - deep_m))
    found = check(deep, cell("pick_and_place"), robot=robot).errors
    assert any("inside an obstacle" in str(one) for one in found) == refused


@pytest.mark.parametrize(("aside_m", "refused"), [(0.0, False), (0.035, True)])
def test_what_springs_back_is_left_in_as_many_movements_as_were_taught(
    aside_m: float, refused: bool, robot: Robot
) -> None:
    """A pump follows the hand: at the end of the first movement the fingers were still below its top."""
    touch, pressing, leave = press()
    rising = app("cartesian_motion", 4.2, 4.6, (-0.02, -0.52, 0.18))
    aside = leave.model_copy(update={"t0": 4.6, "target": (-0.02 + aside_m, -0.52, 0.182)})
    up = leave.model_copy(update={"t0": 5.7, "tn": 7.0})
    found = check((touch, pressing, rising, aside, up), cell("dispenser"), robot=robot).errors
    assert any("inside an obstacle" in str(one) for one in found) == refused


def test_a_contact_that_was_left_is_none(robot: Robot) -> None:
    lifted, pressed = press()[2], press()[1].model_copy(update={"t0": 6.0, "tn": 7.0})
    report = check((*press(), pressed), cell("dispenser"), robot=robot)
    assert lifted.kind == "cartesian_motion"
    assert "app 4 (apply force): presses without a contact" in str(report.errors[0])


def test_fingers_may_open_before_they_grip_but_not_let_go_of_nothing(robot: Robot) -> None:
    opened = app("gripper_move", 0.1, 0.2, gripper_width=0.08)
    assert check((opened, *pick_and_place()), robot=robot).passed
    assert "releases an object that was never grasped" in only(check((opened, *press()), robot=robot))


def test_what_should_be_looked_at_is_a_warning_and_no_error(robot: Robot) -> None:
    taught = DemonstrationQuality((Gap(t0=3.0, tn=3.2, reason="evicted"),))
    report = check(changed(press(), 2, confidence=0.3), cell("dispenser"), taught, robot)
    assert report.passed
    said = [str(one) for one in report.warnings if one.index is not None]
    assert (
        said[0]
        == "warning: app 2 (apply force): was not observed at 3.00–3.20 s: check its motion before a run"
    )
    assert said[1].startswith("warning: app 3 (move): confidence 30 % is below 50 %")


def test_a_confidence_that_reads_as_the_least_is_not_named(robot: Robot) -> None:
    """Of 0.498 it said "confidence 50 % is below 50 %"."""
    assert check(changed(press(), 2, confidence=0.498), cell("dispenser"), robot=robot).warnings == ()
    assert len(check(changed(press(), 2, confidence=0.494), cell("dispenser"), robot=robot).warnings) == 1


def test_a_program_without_apps_is_none() -> None:
    assert only(check(())) == "error: program: has no apps, there is nothing to run"


def test_a_target_is_reached_by_joints_that_lead_there(robot: Robot) -> None:
    rng = np.random.default_rng(4)
    low, high = robot.lower_limits, robot.upper_limits
    for _ in range(20):
        q = np.clip(np.array([0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.7]) + rng.normal(scale=0.3, size=7), low, high)
        pose = robot.flange_pose(q)
        found, left, turn = robot.nearest_joints(
            pose.position_base, pose.orientation_base, np.zeros(7) + q * 0.8
        )
        reached = robot.flange_pose(found)
        assert np.linalg.norm(reached.position_base - pose.position_base) == pytest.approx(left, abs=1e-9)
        assert left < 1e-3
        assert turn < 1e-2


def test_joints_of_another_arm_are_one_finding_that_asks_for_it(robot: Robot) -> None:
    # Each app of a recording of an iiwa read "one of them is wrong", on the Panda that was assumed.
    elsewhere = (0.0, 0.6, 0.0, -2.2, 0.0, 2.8, 0.0)
    apps = tuple(one.model_copy(update={"joints": elsewhere}) for one in pick_and_place() if one.target)
    report = check(apps, robot=robot)
    on_joints = [one for one in report.findings if "joints" in one.reason]
    assert [(one.severity, one.index) for one in on_joints] == [("error", None)]
    assert (
        f"the joints of {len(apps)} of {len(apps)} apps are not those of the arm panda" in on_joints[0].reason
    )
    assert re.search(r"such as app 1: its joints put the flange \d+ mm from its target", on_joints[0].reason)
    assert "State it with --robot" in on_joints[0].reason


def test_six_joints_on_an_arm_of_seven_are_one_finding(robot: Robot) -> None:
    apps = tuple(one.model_copy(update={"joints": (0.0,) * 6}) for one in pick_and_place() if one.target)
    (found,) = [one for one in check(apps, robot=robot).errors if "joints" in one.reason]
    assert "has 6 joints, and its robot panda has 7" in found.reason
    assert found.index is None


@pytest.mark.parametrize("name", ["panda", None])
def test_a_target_in_millimetres_is_named_as_such(name: str | None):
    """Without a robot too: a script writer refuses it there."""
    robot = None if name is None else load_robot(name)
    report = check([app("cartesian_motion", 0.0, 1.0, (400.0, 0.0, 300.0))], robot=robot)
    assert not report.passed
    assert "target x 400.000 m is outside of the workspace" in str(report.errors[0])
    assert "it is probably in mm" in str(report.errors[0])


def test_a_program_of_a_session_with_the_time_of_day_is_checked_as_any_other(robot: Robot) -> None:
    """A rosbag2 has such times. Each app was an error: "t0 is 1764172800.25, expected … below 1e+06"."""
    taught = pick_and_place()
    of_day = tuple(earlier(one, -1764172800.25) for one in taught)
    expected, found = (check(apps, cell("pick_and_place"), robot=robot) for apps in (taught, of_day))
    assert [*map(str, found.findings)] == [*map(str, expected.findings)]
    assert found.passed


def test_without_a_robot_a_warning_says_that_reach_was_not_checked() -> None:
    (finding,) = check(pick_and_place(), cell("pick_and_place")).findings
    assert str(finding).startswith("warning: program: reach was not checked: the program states no robot")


def led_through(**fields: Any) -> Apps:
    """A program of one movement, by a via point with these fields."""
    begin, end = (-0.02, -0.56, 0.3), (-0.02, -0.45, 0.3)
    point: dict[str, Any] = {"t": 1.0, "position": (-0.02, -0.5, 0.3), "orientation": (1.0, 0.0, 0.0, 0.0)}
    via = ViaPoint.model_validate(point | fields)
    path = path_from(begin, 0.0, 2.0, 0.11, orientation=(1.0, 0.0, 0.0, 0.0), via=(via,))
    return (app("cartesian_motion", 0.0, 2.0, end, orientation=(1.0, 0.0, 0.0, 0.0), path=path),)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"position": (math.nan, 0.0, 0.3)}, "path.via.0.position is (nan, 0.0, 0.3), expected 3 numbers"),
        ({"velocity": (0.0, math.inf, 0.0)}, "path.via.0.velocity is (0.0, inf, 0.0), expected 3 numbers"),
        ({"orientation": (0.0, 0.0, 0.0, 0.0)}, "length of path.via.0.orientation 0, expected 0.95 to 1.05"),
        ({"position": (0.7, -0.7, 0.3)}, "which is out of reach or at a joint's limit"),
    ],
)
def test_the_path_of_the_first_app_is_checked_as_any_other(
    fields: dict[str, Any], said: str, robot: Robot
) -> None:
    # Each of these could be run: only the times of a path were checked, and no way of a first app.
    assert check(led_through(), robot=robot).findings == ()
    assert said in only(check(led_through(**fields), robot=robot))
