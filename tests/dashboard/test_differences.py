"""What two programs differ in, in words."""

from __future__ import annotations

from caesura_clients.dashboard.differences import differences
from caesura_protocol.messages import App, Program
from clients.examples import example

APP = example(App)


def program(*apps: App) -> Program:
    return example(Program).model_copy(update={"apps": apps})


def move(**changes: object) -> App:
    plain = {
        "kind": "cartesian_motion",
        "target": (0.4, 0.0, 0.3),
        "force": None,
        "load_kg": None,
        "gripper_width": None,
    }
    return APP.model_copy(update={**plain, "t0": 1.0, "tn": 2.0, **changes})


def test_programs_of_one_task_are_alike():
    first, second = program(move()), program(move(target=(0.401, 0.0, 0.3), tn=2.1))
    assert [one.words for one in differences(first, second)] == ["alike"]


def test_differences_are_named_with_their_values():
    changed = move(target=(0.43, 0.04, 0.3), force=(0.0, 0.0, -12.0), gripper_width=0.04, tn=3.5)
    (one,) = differences(program(move(force=(0.0, 0.0, -5.0))), program(changed))
    assert one.first == one.second == "1 · move"
    words = "target 50 mm away; force 5.0 N and 12.0 N; gripper none and 40 mm; takes 1.0 s and 2.5 s"
    assert one.words == words


def test_an_app_that_only_one_has_is_named_and_the_rest_stays_paired():
    press = move(kind="apply_force")
    rows = differences(program(move(), press, move()), program(move(), move()))
    assert [one.words for one in rows] == ["alike", "only in the first", "alike"]
    assert rows[1].second == ""
    assert rows[2] == ("3 · move", "2 · move", "alike")
