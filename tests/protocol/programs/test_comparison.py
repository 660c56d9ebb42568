"""What two programs of one task differ in, in words, as the page of two sessions shows it."""

from __future__ import annotations

from caesura_protocol.messages import App
from caesura_protocol.programs.comparison import REPETITION, compared
from clients.examples import example

APP = example(App)


def move(**changes: object) -> App:
    plain = {"kind": "cartesian_motion", "target": (0.4, 0.0, 0.3), "force": None, "load_kg": None}
    return APP.model_copy(update={**plain, "gripper_width": None, "t0": 1.0, "tn": 2.0, **changes})


def test_programs_of_one_task_are_alike():
    (one,) = compared([move()], [move(target=(0.401, 0.0, 0.3), tn=2.1)], REPETITION)
    assert one == (0, 0, ())


def test_differences_are_named_with_their_values():
    changed = move(target=(0.43, 0.04, 0.3), force=(0.0, 0.0, -12.0), gripper_width=0.04, tn=3.5)
    (one,) = compared([move(force=(0.0, 0.0, -5.0))], [changed], REPETITION, " and ")
    assert one.words == (
        "target 50.0 mm away",
        "force 5 N and 12 N",
        "duration 1 s and 2.5 s",
        "gripper width not given and 40 mm",
    )


def test_names_of_positions_are_compared():
    (one,) = compared([move(target_name="above the tray")], [move()], REPETITION, " and ")
    assert one.words == ("position name 'above the tray' and none",)


def test_an_app_that_only_one_has_is_named_and_the_rest_stays_paired():
    press = move(kind="apply_force")
    pairs = compared([move(), press, move()], [move(), move()], REPETITION)
    assert pairs == [(0, 0, ()), (1, None, ()), (2, 1, ())]
