"""A part that was taught again has to meet its neighbours; where it does not, a check finds it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from caesura_protocol.messages import App, AppChange, Gap, Program, Vector
from caesura_protocol.programs.checks import document_findings
from caesura_protocol.programs.document import document
from harness.programs import DOWN, app, move

AGAIN = (AppChange(field="taught_again", author="Ann", edit=1),)
A, B, C, D = ((0.1, 0.2, 0.3), (0.2, 0.2, 0.3), (0.3, 0.2, 0.3), (0.4, 0.2, 0.3))


def again(t0: float, start: Vector, target: Vector, **changes: Any) -> App:
    return move(t0, start, target, changes=AGAIN, added=1, **changes)


def program(*apps: App, gaps: tuple[Gap, ...] = ()) -> Program:
    fields = {"station": "cell-1", "session": "s1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return Program(**fields, complete=True, apps=apps, gaps=gaps, robot="panda")


def found(*apps: App, gaps: tuple[Gap, ...] = ()) -> list[tuple[int | None, str]]:
    return [(one.index, one.reason) for one in document_findings(document(program(*apps, gaps=gaps)))]


def beside(point: Vector, off_m: float) -> Vector:
    return point[0], point[1] + off_m, point[2]


def test_a_part_that_meets_its_neighbours_within_the_tolerance_has_no_finding():
    assert found(move(0.0, A, B), again(1.0, beside(B, 0.0015), C), move(2.0, beside(C, -0.0015), D)) == []


def test_a_part_that_does_not_meet_its_neighbours_is_found_at_both_ends_with_the_distance():
    shown = found(move(0.0, A, B), again(1.0, beside(B, 0.004), C), move(2.0, beside(C, 0.0125), D))
    assert [(index, reason.split(",")[0]) for index, reason in shown] == [
        (1, "begins 4.0 mm from the end of the app before it"),
        (2, "begins 12.5 mm from the end of the app before it"),
    ]


def test_a_part_without_a_pose_of_its_own_is_passed_over_to_the_next_app_that_has_one():
    opening = app("gripper_move", 1.0, 1.0, gripper_width=0.08, changes=AGAIN, added=1)
    shown = found(move(0.0, A, B), opening, again(1.0, beside(B, 0.02), C))
    assert [index for index, reason in shown if "20.0 mm" in reason] == [2]


def test_a_part_that_begins_turned_is_found():
    angle = math.radians(135.0) + 0.1
    turned = (math.cos(angle), math.sin(angle), 0.0, 0.0)
    shown = found(move(0.0, A, B), again(1.0, B, C, orientation=turned), move(2.0, C, D, turned))
    assert ["begins turned by" in reason for _, reason in shown] == [True]


def test_a_gap_of_the_replaced_part_is_none_of_the_new_one():
    gap = (Gap(t0=1.2, tn=1.5, reason="evicted"),)
    assert "was not observed" in found(move(0.0, A, B), move(1.0, B, C), gaps=gap)[0][1]
    assert found(move(0.0, A, B), again(1.0, B, C), gaps=gap) == []


def test_a_finding_of_a_part_states_which_move_closes_the_step():
    apart = (move(0.0, A, B), again(1.0, beside(B, 0.0125), C))
    ((_, reason),) = found(*apart)
    assert reason.endswith("insert a move to (200, 213, 300) mm before it, or teach it again from there")
    closing = app("cartesian_motion", 1.0, 2.0, beside(B, 0.0125), orientation=DOWN, added=2)
    assert found(apart[0], closing, apart[1]) == []


@pytest.mark.parametrize(("off_m", "severity"), [(0.03, "warning"), (0.05, "error")])
def test_fingers_that_close_where_the_object_is_not_are_an_error(off_m: float, severity: str):
    grasp = app("grasp", 1.0, 2.0, beside(B, off_m), gripper_width=0.05, changes=AGAIN, added=1)
    opening = app("gripper_move", 3.0, 4.0, beside(B, off_m), gripper_width=0.08, changes=AGAIN, added=1)
    report = document_findings(document(program(move(0.0, A, B), grasp, opening)))
    about_place = [one for one in report if "opens the fingers" not in one.reason]
    assert [(one.severity, one.index) for one in about_place] == [(severity, 1)]
    assert f"insert a move to (200, {1000 * (0.2 + off_m):.0f}, 300) mm before it" in about_place[0].reason
