"""The path of a program as the page draws it in three dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_clients.dashboard.program_path import COLOURS, PARTS, program_path
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.paths import curve_of
from clients.examples import example
from harness.programs import app, pick_and_place, press


def test_every_kind_of_app_has_a_colour():
    assert set(COLOURS) == set(APP_KINDS)


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


def test_apps_run_one_after_the_other_at_the_speeds_that_people_set():
    first, second = (
        app("cartesian_motion", 1.0, 2.0, (0.1, 0.0, 0.0)),
        app("cartesian_motion", 3.0, 5.0, (0.2, 0.0, 0.0)),
    )
    spans = lambda apps: [(row["points"][0][0], row["points"][-1][0]) for row in program_path(apps)]  # noqa: E731
    assert spans([first, second]) == [(1.0, 2.0), (3.0, 5.0)]
    assert spans([first.model_copy(update={"speed": 0.5}), second]) == [(1.0, 3.0), (4.0, 6.0)]
    assert spans([second, first]) == [(3.0, 5.0), (5.0, 6.0)]  # exchanged: no pause lies between them


def test_an_app_without_a_place_has_no_row():
    closing = app("gripper_move", 0.0, 1.0, gripper_width=0.0)
    assert program_path([closing]) == []
    assert [row["number"] for row in program_path([*press(), closing])] == [1, 2, 3, 4]
    assert program_path([]) == []


def test_the_newest_apps_begin_where_those_before_them_end():
    rows = program_path(press(), first=2)
    assert [row["number"] for row in rows] == [3]
    assert rows[0]["points"][0] == [4.2, -20.0, -520.0, 165.0]
