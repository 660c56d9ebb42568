"""What no script can run is refused by name when a script is written."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from caesura_protocol.messages import App, RestForce
from caesura_protocol.programs.behaviour_tree import behaviour_tree
from caesura_protocol.programs.checks import precondition_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import as_file, curved, pick_and_place, press, wiped


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
@pytest.mark.parametrize(
    ("index", "field", "said"),
    [
        (0, "target", "app 1 .move to contact. has no target"),
        (1, "force", "app 2 .apply force. has no force"),
    ],
)
def test_an_app_without_what_it_needs_is_refused(
    write: Callable[[ProgramFile], str], index: int, field: str, said: str
):
    apps = list(press())
    apps[index] = apps[index].model_copy(update={field: None})
    with pytest.raises(ValueError, match=said):
        write(as_file(tuple(apps)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_program_without_an_app_is_refused(write: Callable[[ProgramFile], str]):
    """URScript and the script for the xArm were refused with an error of the exporter itself."""
    with pytest.raises(ValueError, match="it has no app, so a robot would do nothing"):
        write(as_file(()))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_press_without_a_direction_is_refused(write: Callable[[ProgramFile], str]):
    touch, pressed, away = press()
    with pytest.raises(ValueError, match=r"app 2 .apply force.: force 0 N, expected one with a direction"):
        write(as_file((touch, pressed.model_copy(update={"force": (0.0, 0.0, 0.0)}), away)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_press_with_a_force_that_no_app_can_have_is_refused(write: Callable[[ProgramFile], str]):
    # Without a limit of the cell, scripts were written with MAX_FORCE_N = 1e9.
    touch, pressed, away = press()
    said = r"app 2 .apply force.: force is .*, expected 3 numbers, finite and below 1e\+06"
    with pytest.raises(ValueError, match=said):
        write(as_file((touch, pressed.model_copy(update={"force": (0.0, 0.0, -1e9)}), away)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_rest_of_a_stroke_with_a_force_that_no_app_can_have_is_refused(write: Callable[[ProgramFile], str]):
    touch, stroke = wiped()
    rest = RestForce(newton=1e9, newton_taught=1e9)
    said = "app 2 .apply force.: rest_before.newton is 1000000000.0, expected a number, finite and below 1e"
    with pytest.raises(ValueError, match=said):
        write(as_file((touch, stroke.model_copy(update={"rest_before": rest}))))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script, behaviour_tree])
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tn": -1e5}, "duration -1e.05 s, expected 0 to inf s"),
        ({"gripper_width": -1.0}, "gripper width -1000 mm, expected 0 to inf mm"),
        ({"load_kg": -1.0}, "load -1 kg, expected 0 to inf kg"),
        ({"orientation": (0.0, 0.0, 0.0, 0.0)}, "length of the orientation 0, expected 0.95 to 1.05"),
        ({"target": (0.0, 0.0, 1e300)}, "target is .*, expected 3 numbers, finite and below 1e.06"),
    ],
)
def test_a_number_that_an_app_has_in_no_cell_is_refused(
    write: Callable[[ProgramFile], str], changes: dict[str, object], said: str
):
    """Each was written, and read as another one by the robot, or stopped it in the middle of a program."""
    touch, pressed, away = press()
    with pytest.raises(ValueError, match=f"app 3 .move.: {said}"):
        write(as_file((touch, pressed, away.model_copy(update=changes))))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script, behaviour_tree])
@pytest.mark.parametrize(
    ("t", "said"),
    [
        (1.0, "its path has a point at 1 s, expected after the point before it at 1.8 s"),
        (1e300, "path.via.1.t is 1e.300, expected a number, finite and below 1e.10"),
    ],
)
def test_a_path_whose_times_go_back_or_are_absurd_is_refused(
    write: Callable[[ProgramFile], str], t: float, said: str
):
    """A time of 1e300 s ended an exporter with an OverflowError, and one that goes back was written."""
    touch, *rest = curved()
    assert touch.path is not None
    first, last = touch.path.via
    path = touch.path.model_copy(update={"via": (first, last.model_copy(update={"t": t}))})
    with pytest.raises(ValueError, match=f"app 1 .move to contact.: {said}"):
        write(as_file((touch.model_copy(update={"path": path}), *rest)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_press_so_light_that_a_script_would_state_no_force_is_refused(write: Callable[[ProgramFile], str]):
    touch, pressed, away = press()
    said = r"app 2 .apply force.: force 0.0004 N, expected one with a direction, at least 0.001 N"
    with pytest.raises(ValueError, match=said):
        write(as_file((touch, pressed.model_copy(update={"force": (0.0, 0.0, -0.0004)}), away)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_path_without_a_target_is_refused(write: Callable[[ProgramFile], str]):
    touch, stroke = wiped()
    with pytest.raises(ValueError, match=r"app 2 .apply force. has a path, but no target"):
        write(as_file((touch, stroke.model_copy(update={"target": None}))))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_press_without_a_contact_before_it_is_refused(write: Callable[[ProgramFile], str]):
    # It was a comment: the stroke was done from wherever the arm was, also out of the workspace.
    touch, stroke = wiped()
    elsewhere = touch.model_copy(update={"kind": "cartesian_motion", "target": (0.74, 0.2, 0.3)})
    said = "presses without a contact: an app 'move to contact' must come before it"
    with pytest.raises(ValueError, match=rf"app 2 .apply force.: {said}"):
        write(as_file((elsewhere, stroke)))
    with pytest.raises(ValueError, match=rf"app 1 .apply force.: {said}"):
        write(as_file((stroke,)))


def test_a_program_that_begins_in_contact_is_named_once_with_its_cause_and_what_to_do():
    # Each of four strokes was an error, none of which said that the recording had begun in contact.
    _, stroke = wiped()
    later = stroke.model_copy(update={"t0": stroke.t0 + 5.0, "tn": stroke.tn + 5.0, "path": None})
    (found,) = precondition_findings((stroke, later))
    assert found.index == 0
    cause = "The recording began in contact, or an edit removed the motion there"
    assert (
        f"{cause}: teach it again from free space, or insert such an app with target (-20, -520, 190) mm"
        in (found.reason)
    )
    touch, *_ = press()
    lifted = touch.model_copy(update={"kind": "cartesian_motion"})
    (found,) = precondition_findings((lifted, stroke))
    assert "began in contact" not in found.reason


def begun_at_the_object() -> tuple[App, ...]:
    """`pick_and_place` of a recording that begins at the grasp."""
    return pick_and_place()[1:]


def test_a_program_that_begins_with_a_grasp_says_where_the_arm_must_stand():
    said = "grasps before anything moves: bring the arm to (-14, -673, 107) mm (flange) first"
    (found,) = precondition_findings(begun_at_the_object())
    assert (found.severity, found.index) == ("warning", 0)
    assert found.reason.startswith(said)
    assert not precondition_findings(pick_and_place())
    driven = {franky_script: "franka_hand", ur_script: "robotiq_2f_85", xarm_script: "robotiq_2f_85"}
    for write, gripper in driven.items():
        program = as_file(begun_at_the_object()).model_copy(update={"gripper": gripper})
        assert f"# warning: {said}" in write(program)


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_press_that_pulls_is_refused(write: Callable[[ProgramFile], str]):
    # The scripts were written, without a word: the arm was to pull away with the force of the press.
    touch, pressed, away = press()
    up = pressed.model_copy(update={"force": (0.0, 0.0, 9.0)})
    with pytest.raises(
        ValueError, match=r"app 2 .apply force.: pulls on the touched surface: its force points"
    ):
        write(as_file((touch, up, away)))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
@pytest.mark.parametrize("away_n", [-0.5, 0.0, 0.5])
def test_a_push_across_the_tool_is_none_that_pulls(write: Callable[[ProgramFile], str], away_n: float):
    """The noise of its force decided: half of the programs that pushed something aside had no script."""
    touch, pressed, away = press()
    aside = pressed.model_copy(update={"force": (0.0, 9.0, away_n)})
    assert not precondition_findings((touch, aside, away))
    assert write(as_file((touch, aside, away)))


def test_why_a_press_may_pull_is_said_once():
    touch, pressed, away = press()
    up = pressed.model_copy(update={"force": (0.0, 0.0, 9.0)})
    first, second = (one.reason for one in precondition_findings((touch, up, up, away)))
    assert second == "pulls on the touched surface: its force points away from the tool"
    assert first.startswith(f"{second}. Was the force recorded in the base frame")


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_carry_of_what_was_never_grasped_is_refused(write: Callable[[ProgramFile], str]):
    # It was a comment: the robot counted on a load of 1.8 kg, and would have pushed upwards with its weight.
    touch, _, carry, *_ = pick_and_place()
    above = touch.model_copy(update={"kind": "cartesian_motion"})
    with pytest.raises(ValueError, match=r"app 2 .transport.: carries, but nothing was grasped"):
        write(as_file((above, carry)))
