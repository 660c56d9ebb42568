"""Grippers as data: those that ship, what a robot or a program states, and what the check says of them."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from caesura_lab.execution.cell_limits import Cell
from caesura_lab.execution.checks import check
from caesura_protocol.programs.checks import document_findings, gripper_findings
from caesura_protocol.programs.document import read_document
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.program_gripper import gripper_of, with_gripper, within_gripper
from caesura_protocol.programs.safety import Safety
from caesura_protocol.robots import GripperDescription, GripperError, gripper, grippers, robot_description
from harness.programs import app, as_file, pick_and_place, press

NO_ROBOT = "reach was not checked"
OPEN = "no app opens the fingers before this one"


def found(name: str, safety: Safety | None = None) -> list[str]:
    report = check(pick_and_place(), Cell(safety or Safety()), gripper=gripper(name))
    said = map(str, report.findings)
    return [one for one in said if NO_ROBOT not in one and OPEN not in one]


def test_fingers_that_no_app_opens_before_they_close_are_named():
    # Nothing said that a program which begins with closed fingers ends at its first contact.
    report = check(pick_and_place(), Cell(Safety()), gripper=gripper("franka_hand"))
    (said,) = [str(one) for one in report.findings if OPEN in str(one)]
    assert said == f"warning: app 2 (grasp): {OPEN}: open them by more than 50 mm before the program starts"
    opened = (app("gripper_move", 0.0, 0.2, gripper_width=0.08), *pick_and_place())
    assert not [one for one in gripper_findings(opened, Safety(), gripper("franka_hand")) if OPEN in str(one)]
    assert not [
        one for one in gripper_findings(pick_and_place(), Safety(), gripper("suction")) if OPEN in str(one)
    ]


def test_every_gripper_states_where_its_figures_come_from():
    for name, one in grippers().items():
        stated = {"opening_m", "force_n", "speed_m_per_s", "counts", "output"} & one.model_fields_set
        assert stated <= set(one.sources), name


def test_a_robot_names_its_gripper_and_a_program_may_name_another():
    panda = as_file(pick_and_place()).model_copy(update={"robot": "panda"})
    assert gripper_of(panda) is robot_description("panda").gripper
    assert gripper_of(with_gripper(panda, "robotiq_2f_140")) == gripper("robotiq_2f_140")
    assert with_gripper(panda, None) is panda
    assert gripper_of(as_file(pick_and_place())) is None
    with pytest.raises(GripperError, match="'claw' is not known, expected one of franka_hand, robotiq_2f_85"):
        with_gripper(panda, "claw")


def test_a_program_keeps_its_gripper_in_its_file(tmp_path):
    file = tmp_path / "p.json"
    file.write_text(with_gripper(as_file(pick_and_place()), "suction").as_json())
    assert read_document(file).gripper == "suction"


def test_counts_lie_on_the_line_between_open_and_shut():
    robotiq = gripper("robotiq_2f_85")
    assert [robotiq.count(width) for width in (0.085, 0.0425, 0.0, 0.2, -1.0)] == [3, 116, 230, 3, 230]
    with pytest.raises(GripperError, match="has no counts"):
        gripper("franka_hand").count(0.04)


@pytest.mark.parametrize(
    ("name", "asked", "given"),
    [("robotiq_hand_e", (20.0, 0.05), (60.0, 0.05)), ("franka_hand", (90.0, 1.0), (70.0, 0.1))],
)
def test_limits_are_those_that_the_gripper_has(name, asked, given):
    safety = within_gripper(Safety(grasp_force_n=asked[0], gripper_m_per_s=asked[1]), gripper(name))
    assert (safety.grasp_force_n, safety.gripper_m_per_s) == given
    assert safety.gripper_width_m == gripper(name).opening_m


def test_the_check_compares_widths_with_the_gripper():
    assert found("franka_hand") == []
    assert found("robotiq_2f_140") == []
    (tight,) = found("robotiq_hand_e", Safety(grasp_force_n=80.0))
    assert "app 5 (move gripper): gripper width 80 mm, expected 0 to 5" in tight


def test_the_check_warns_of_a_gripper_that_does_not_say_whether_it_holds_anything():
    said = "app 2 (grasp): a Suction cup at digital output 0 does not report whether it holds an object"
    assert any(said in one for one in found("suction"))
    assert not any("does not report" in one for one in found("xarm_vacuum"))


def test_the_check_names_what_is_assumed_where_no_width_is_stated():
    """An inserted `move gripper` opened the fingers as far as they go, and the check found nothing."""
    unstated = [
        app.model_copy(update={"gripper_width": None}) if app.kind in {"grasp", "gripper_move"} else app
        for app in pick_and_place()
    ]
    words = {
        name: " ".join(map(str, check(unstated, Cell(Safety()), gripper=gripper(name)).findings))
        for name in ("franka_hand", "suction")
    }
    words["not known"] = " ".join(map(str, document_findings(as_file(unstated))))
    assert "app 2 (grasp): no gripper width is stated: 0 mm is assumed, and the" in words["franka_hand"]
    for name in ("franka_hand", "not known"):  # it was assumed in silence where no gripper was stated
        assert "is stated: the fingers open to their limit, 80 mm; change its" in words[name]
    assert "no gripper width" not in words["suction"]


def test_the_check_names_a_force_that_the_gripper_does_not_have():
    (strong,) = found("franka_hand", Safety(grasp_force_n=90.0))
    assert strong.startswith("error: program: the fingers' force 90 N: a Franka Hand has at most 70 N")
    weak = found("robotiq_hand_e")[0]
    assert weak.startswith("warning: program: the fingers' force 20 N: a Robotiq Hand-E has at least 60 N")


def test_a_suction_cup_has_no_width():
    widths = [one for one in found("suction") if "has no width" in one]
    assert [one.partition(":")[0] for one in widths] == ["warning", "warning"]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (
            {"kind": "fingers", "interface": "franka"},
            "a gripper of kind fingers with interface franka needs opening_m, force_n",
        ),
        ({"kind": "suction", "interface": "digital_output"}, "needs output"),
        ({"opening_m": 0.1, "force_n": 1.0, "least_force_n": 2.0}, "force_n is 1.0, expected at least"),
        ({"opening_m": -0.1, "force_n": 1.0}, "greater than 0"),
    ],
)
def test_a_gripper_that_cannot_be_is_refused(fields, said):
    with pytest.raises(ValidationError, match=said):
        GripperDescription.model_validate({"title": "G"} | fields)


@pytest.mark.parametrize("name", ["robotiq_2f_85", "suction", "xarm_vacuum"])
def test_a_franky_script_moves_no_fingers_for_another_gripper(name: str):
    # It was written, and commanded a Franka Hand in place of the stated gripper.
    program = with_gripper(as_file(pick_and_place()), name)
    title = gripper(name).title
    with pytest.raises(
        ValueError, match=rf"app 2 \(grasp\): franky does not drive a {title}, expected .*hand"
    ):
        franky_script(program)
    assert franky_script(with_gripper(program, "franka_hand"))
    assert franky_script(with_gripper(as_file(press()), name)), "no app moves its fingers"


@pytest.mark.parametrize(
    ("robot", "title"),
    [("fr3", "Franka Research 3"), ("panda", "Franka Emika Panda"), (None, "Franka Panda")],
)
def test_a_franky_script_names_the_arm_that_it_is_for(robot: str | None, title: str):
    text = franky_script(as_file(press()).model_copy(update={"robot": robot}))
    assert f"for franky-control 2 on a {title}." in text.splitlines()[1]
