"""The path of a program as the page draws it in three dimensions."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from caesura_clients.dashboard.program_edits import checked
from caesura_clients.dashboard.program_path import PARTS, program_path
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, AppChange, Program
from caesura_protocol.messages.field_types import Kind
from caesura_protocol.programs.document import document
from caesura_protocol.reproduced_path import curve_of
from clients.examples import example
from harness.programs import app, pick_and_place, press


def program(*apps: App) -> Program:
    return example(Program).model_copy(update={"apps": apps, "edits": (), "gaps": (), "complete": True})


def test_every_kind_of_app_has_the_colours_of_kinds_of_segments():
    assert {kind for facts in APP_KINDS.values() for kind in facts.drawn_as} <= set(get_args(Kind))


def test_points_lie_on_the_curve_that_the_robot_follows():
    one = example(App).model_copy(update={"speed": None})
    (row,) = program_path([one])
    curve = curve_of(one)
    assert len(row["points"]) == PARTS * (len(curve.t) - 1) + 1
    for t, *place in row["points"]:
        assert place == pytest.approx(1000.0 * curve.at(t)[0][:3], abs=6.0)  # times are rounded to 0.01 s
    times = np.array(row["points"])[::PARTS, 0]
    assert times == pytest.approx(curve.t, abs=0.005)
    assert [place for _, *place in row["via"]] == (1000.0 * curve.values[1:-1, :3]).round(1).tolist()


def test_a_program_as_taught_has_the_times_of_its_teaching():
    rows = program_path(pick_and_place())
    assert [(row["points"][0][0], row["points"][-1][0]) for row in rows] == [
        (one.t0, one.tn) for one in pick_and_place()
    ]


def test_what_stays_has_its_place_and_what_travels_without_a_path_leads_straight_to_its_target():
    rows = program_path(press())
    approach, pressed, retract = rows
    assert approach["points"] == [
        [0.8, -20.0, -520.0, 190.0],
        [2.6, -20.0, -520.0, 190.0],
    ]  # from where is open
    assert pressed["points"] == [[2.6, -20.0, -520.0, 165.0], [4.2, -20.0, -520.0, 165.0]]
    assert retract["points"] == [[4.2, -20.0, -520.0, 165.0], [5.7, -20.0, -530.0, 290.0]]
    assert (pressed["kind"], pressed["force"]) == ("contact", [0.0, 0.0, -10.0])


def test_times_are_those_of_the_document_where_order_or_speed_were_changed():
    first, second = (
        app("cartesian_motion", t0, tn, (x, 0.0, 0.0)) for t0, tn, x in ((1.0, 2.0, 0.1), (3.0, 5.0, 0.2))
    )
    slow = first.model_copy(update={"speed": 0.5})
    moved = second.model_copy(update={"changes": (AppChange(field="place", author="Ann", edit=1),)})
    for apps in ([first, second], [slow, second], [moved, first]):
        edited = program(*apps)
        rows = program_path(checked(edited).apps)
        spans = [(row["points"][0][0], row["points"][-1][0]) for row in rows]
        assert spans == [
            (pytest.approx(one.t0, abs=0.01), pytest.approx(one.tn, abs=0.01))
            for one in document(edited).apps
        ]


def test_an_app_without_a_place_has_no_row():
    closing = app("gripper_move", 0.0, 1.0, gripper_width=0.0)
    assert program_path([closing]) == []
    assert [row["number"] for row in program_path([*press(), closing])] == [1, 2, 3, 4]
    assert program_path([]) == []


def test_the_newest_apps_begin_where_those_before_them_end():
    rows = program_path(press(), first=2)
    assert [row["number"] for row in rows] == [3]
    assert rows[0]["points"][0] == [4.2, -20.0, -520.0, 165.0]
