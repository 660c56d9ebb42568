"""A program and the robot that it is for."""

from __future__ import annotations

from pathlib import Path

import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.programs import document
from caesura_protocol.programs.document import ProgramFile, document_of_apps, on_robot
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.robots import RobotDescription, robot_description
from harness.programs import app

JOINTS = (0.0, 0.6, 0.0, -2.2, 0.0, 2.8, 0.0)


@pytest.fixture
def taught() -> ProgramFile:
    """On a Panda, one movement with its joints."""
    made = document_of_apps((app("cartesian_motion", 0.0, 1.0, (0.4, 0.0, 0.3), joints=JOINTS),), "taught")
    return on_robot(made, "panda")


@pytest.fixture
def other(monkeypatch: pytest.MonkeyPatch) -> str:
    """Another maker's arm."""
    described = robot_description("panda").model_copy(update={"name": "other", "script": None})

    def find(name: str) -> RobotDescription:
        return described if name == "other" else robot_description(name)

    monkeypatch.setattr(document, "robot_description", find)
    monkeypatch.setattr("caesura_protocol.programs.script_templates.robot_description", find)
    return "other"


def test_a_program_for_another_robot_is_refused_by_name(taught: ProgramFile, other: str) -> None:
    with pytest.raises(CaesuraError, match="was taught on panda, not on other: --retarget keeps its poses"):
        on_robot(taught, other)
    assert on_robot(taught, None) is taught
    assert on_robot(taught, "panda") == taught


def test_re_targeting_keeps_poses_leaves_joints_out_and_says_so(taught: ProgramFile, other: str) -> None:
    (before,) = taught.apps
    moved = on_robot(taught, other, retarget=True)
    (after,) = moved.apps
    assert before.joints == JOINTS
    assert after == before.model_copy(update={"joints": None})
    assert moved.robot == "other"
    (note,) = moved.notes
    assert note.startswith("Taught on panda, re-targeted to other: its poses stay, its joints are left out.")
    assert note.endswith("the tool needs the length and the orientation of the taught one.")


def test_joints_of_another_arm_are_refused_where_no_robot_was_stated(taught: ProgramFile) -> None:
    # A UR5e's script asked for the inverse kinematics near seven joints.
    unstated = taught.model_copy(update={"robot": None})
    with pytest.raises(
        CaesuraError, match=r"app 1 \(move\) was taught with 7 joints, and ur5e has 6: --retarget"
    ):
        on_robot(unstated, "ur5e")
    with pytest.raises(ValueError, match="taught with 7 joints, and an arm of Universal Robots has 6"):
        WRITERS["urscript"].write(unstated)
    moved = on_robot(unstated, "ur5e", retarget=True)
    assert [app.joints for app in moved.apps] == [None]
    (note,) = moved.notes
    assert note.startswith(
        "Taught on a robot that was not stated, re-targeted to ur5e: its poses stay, its joints"
    )
    assert "get_actual_joint_positions()" in WRITERS["urscript"].write(moved)


def test_the_robot_is_in_the_file_and_a_file_without_one_is_read(taught: ProgramFile, tmp_path: Path) -> None:
    path = tmp_path / "program.json"
    path.write_text(taught.as_json())
    assert document.read_document(path).robot == "panda"
    path.write_text(taught.model_copy(update={"robot": None, "version": 1}).as_json())
    assert document.read_document(path).robot is None


def test_a_franky_script_is_for_franka_arms(taught: ProgramFile, other: str) -> None:
    assert "APPS = " in WRITERS["franky"].write(taught)
    with pytest.raises(ValueError, match="is for a Franka arm, and the program's robot is other"):
        WRITERS["franky"].write(on_robot(taught, other, retarget=True))
