"""What a check states of the motion between two apps: taught where their neighbourhood was, else a step."""

from __future__ import annotations

import math
from typing import Any

import pytest

from caesura_protocol.messages import (
    App,
    AppChange,
    AppReference,
    DeleteApp,
    Gap,
    Program,
    ProgramEdit,
    RestForce,
    ScrewMotion,
    Vector,
    ViaPoint,
)
from caesura_protocol.programs.checks import DemonstrationQuality, document_findings, fidelity_findings
from caesura_protocol.programs.document import document
from caesura_protocol.programs.safety import DEFAULT
from harness.programs import app, move, pick_and_place, press, pressed_harder_before

MOVED = (AppChange(field="place", author="Ann", edit=1),)


def program(*apps: App, edits: tuple[ProgramEdit, ...] = ()) -> Program:
    fields = {"station": "cell-1", "session": "s1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return Program(**fields, complete=True, apps=apps, edits=edits, robot="panda")


def found(*apps: App, edits: tuple[ProgramEdit, ...] = ()) -> list[tuple[int | None, str]]:
    return [(one.index, one.reason) for one in document_findings(document(program(*apps, edits=edits)))]


def changed(app: App, *changes: AppChange) -> App:
    return app.model_copy(update={"changes": changes})


def there(x: float) -> Vector:
    return x, 0.2, 0.3


# Between the first and the second one a hand moved on by 50 mm, which is in no app.
FIRST = move(0.0, there(0.1), there(0.2))
SECOND = move(1.5, there(0.25), there(0.4))
THIRD = move(2.5, there(0.4), there(0.6))
STRAIGHT = "are in no app: the robot moves straight to the start of this app"
TAUGHT = f"50 mm of motion taught at 1.0–1.5 s {STRAIGHT}"


def test_motion_that_was_taught_between_two_neighbours_is_found_with_its_time():
    assert found(FIRST, SECOND, THIRD) == [(1, TAUGHT)]


def test_the_time_of_lost_motion_begins_where_the_target_was_reached_and_not_where_its_app_ends():
    rests = FIRST.model_copy(update={"tn": 1.4})  # its path has ended at 1.0 s
    assert found(rests, SECOND, THIRD) == [(1, TAUGHT)]
    press = app("apply_force", 1.0, 1.4, there(0.2), force=(0.0, 0.0, -8.0), force_taught=(0.0, 0.0, -8.0))
    met = FIRST.model_copy(update={"kind": "move_to_contact"})
    assert [reason for index, reason in found(met, press, SECOND, THIRD) if index == 2] == [TAUGHT]


@pytest.mark.parametrize(("degrees", "said"), [(1.9, []), (2.04, []), (2.2, ["2.2"]), (2.9, ["2.9"])])
def test_a_turn_between_two_apps_is_named_from_the_angle_on_that_a_path_may_be_off(
    degrees: float, said: list[str]
):
    # Below 3° nothing was said, and an executed path is within 2°.
    half = math.radians(0.5 * degrees)
    before, after = (0.0, 0.0, 0.0, 1.0), (math.sin(half), 0.0, 0.0, math.cos(half))
    second = move(1.5, there(0.2), there(0.4), orientation=after)
    reasons = [reason for _, reason in found(move(0.0, there(0.1), there(0.2), before), second)]
    assert reasons == [f"rotation of {one}° taught at 1.0–1.5 s is in no app" for one in said]


@pytest.mark.parametrize(("off_m", "said"), [(None, []), (0.0048, []), (0.0073, ["7.3"])])
def test_a_press_that_was_taught_off_the_straight_push_is_warned_of(off_m: float | None, said: list[str]):
    # A real one wound 7 mm off it: the robot was to push straight, in silence.
    force = {"force": (0.0, 0.0, -8.0), "force_taught": (0.0, 0.0, -8.0)}
    met = FIRST.model_copy(update={"kind": "move_to_contact"})
    press = app("apply_force", 1.0, 1.4, there(0.2), off_straight_m=off_m, **force)
    shown = [reason for _, reason in found(met, press) if "off the straight line" in reason]
    assert [reason.split(" mm")[0].removeprefix("was taught up to ") for reason in shown] == said


@pytest.mark.parametrize(
    ("deviation_m", "tolerance_m", "warned"),
    [
        (
            0.0020039,
            0.002,
            False,
        ),  # of a program at optimal speed: "by up to 2.0 mm, the tolerance is 2.0 mm"
        (0.001951, 0.001949, False),
        (0.0021, 0.002, True),
    ],
)
def test_a_deviation_is_warned_of_where_the_numbers_shown_differ(deviation_m, tolerance_m, warned):
    assert FIRST.path is not None
    path = FIRST.path.model_copy(update={"deviation_m": deviation_m, "tolerance_m": tolerance_m})
    shown = found(FIRST.model_copy(update={"path": path}))
    assert [reason.split(" mm")[0] for _, reason in shown] == ["deviates by up to 2.1"] * warned


def test_a_step_of_no_length_has_one_time():
    # A warning had "taught at 1.0–1.0 s".
    stepped = move(1.0, there(0.25), there(0.4))
    assert found(FIRST, stepped) == [(1, f"50 mm of motion taught at 1.0 s {STRAIGHT}")]


def test_between_apps_in_another_order_nothing_is_said_to_be_taught():
    shown = found(changed(THIRD, *MOVED), FIRST, SECOND)
    assert [(index, reason.split(",")[0].split(" are ")[0]) for index, reason in shown] == [
        (1, "begins 500.0 mm from the end of the app before it"),
        (2, "50 mm of motion taught at 2.0–2.5 s"),  # neighbours still, at their new times
    ]


def test_an_app_that_was_moved_and_moved_back_has_its_neighbours_again():
    assert [(index, "taught at" in reason) for index, reason in found(FIRST, changed(SECOND, *MOVED))] == [
        (1, True)
    ]


def test_over_a_deleted_app_nothing_is_said_to_be_taught():
    gone = AppReference(kind="cartesian_motion", t0=SECOND.t0, tn=SECOND.tn)
    edit = ProgramEdit(number=1, author="Ann", at=0.0, action=DeleteApp(app=gone), state="applied")
    ((index, reason),) = found(FIRST, THIRD, edits=(edit,))
    assert index == 1
    assert reason.startswith("begins 200.0 mm from the end of the app before it, because the way between")


def test_an_app_without_a_pose_does_not_hide_that_another_one_came_between():
    opening = app("gripper_move", 1.0, 1.0, gripper_width=0.08)
    shown = found(changed(THIRD, *MOVED), opening, move(1.0, there(0.2), there(0.4)))
    assert [reason.split(",")[0] for index, reason in shown if index == 2] == [
        "begins 400.0 mm from the end of the app before it"
    ]


def test_where_a_target_was_edited_nothing_is_said_to_be_taught():
    target = AppChange(field="target", author="Ann", edit=1, inferred=there(0.25))
    begun = move(0.0, there(0.1), there(0.2))
    shown = found(changed(begun, target), move(1.0, there(0.25), there(0.4)))
    assert [reason.split(",")[0] for index, reason in shown if index == 1] == [
        "begins 50.0 mm from the end of the app before it"
    ]


def test_findings_are_short_whatever_numbers_a_file_states():
    huge = FIRST.path.model_copy(
        update={
            "start": ViaPoint(t=1e308, position=(1e305, 1e305, 1e305), orientation=None),
            "tn": 1.1e308,
            "deviation_m": 1e305,
            "deviation_rad": 1e300,
        }
    )
    spoilt = SECOND.model_copy(update={"path": huge})
    gap = (Gap(t0=-1e308, tn=1e308, reason="source"),)
    screw = ScrewMotion(
        axis=(0.0, 0.0, 1.0), point=(0.0, 0.0, 0.0), angle=1e300, pitch_m=1e300, pitch_sd_m=1e300
    )
    press: dict[str, Any] = {"force": (0.0, 0.0, -1e100), "force_taught": (0.0, 0.0, -1e101), "screw": screw}
    others = (
        app("apply_force", 1e300, 1.1e300, there(0.2), **press),
        app("grasp", 1e300, 1.1e300, there(0.2), gripper_width=0.05, force_taught=(0.0, 0.0, -1e100)),
        app("transport", 1e300, 1.1e300, there(0.3), load_kg=1e290, load_sd_kg=1e300),
    )
    for apps in ((FIRST, spoilt), (FIRST, changed(THIRD, *MOVED), spoilt), *((FIRST, one) for one in others)):
        shown = fidelity_findings(apps, DemonstrationQuality(gap), DEFAULT)
        steps = document_findings(document(program(*apps)))
        assert len(shown) > 3
        assert max(len(one.reason) for one in (*shown, *steps)) < 250


def test_a_rest_whose_force_was_cut_is_a_force_that_was_limited():
    reasons = [reason for _, reason in found(*pressed_harder_before()) if "force" in reason]
    assert reasons == ["force limited: 10.0 N (12.0 N of 18.0 N taught before, 5.0 N after)"]


def test_a_rest_that_was_hardly_pressed_is_named_where_a_robot_presses_harder():
    touch, stroke = pressed_harder_before()
    hardly = stroke.model_copy(update={"rest_before": RestForce(newton=1.0, newton_taught=0.26)})
    harder = "presses harder than taught: 10.0 N (1.0 N of 0.3 N taught before, 5.0 N after)"
    assert harder in reasons((touch, hardly))
    assert not any("harder" in reason for reason in reasons((touch, stroke)))


def test_the_force_of_a_rest_that_has_no_time_is_named():
    # Without a path nothing says how long a rest lasted: one force was pressed over all of it, in silence.
    touch, stroke = pressed_harder_before()
    assert reasons((touch, stroke)) == reasons((touch, stroke.model_copy(update={"rest_before": None})))
    said = reasons((touch, stroke.model_copy(update={"path": None})))
    assert said == [
        "was taught with 12.0 N before its path, and presses with 10.0 N there: "
        "without a path the duration of that force is unknown",
        "was taught with 5.0 N after its path, and presses with 10.0 N there: "
        "without a path the duration of that force is unknown",
    ]
    nearly = RestForce(newton=11.4, newton_taught=11.4)  # within 15 %
    even = stroke.model_copy(update={"path": None, "rest_before": nearly, "rest_after": None})
    assert reasons((touch, even)) == []


def reasons(apps: tuple[App, ...]) -> list[str]:
    return [one.reason for one in fidelity_findings(apps, None, DEFAULT) if "limited" not in one.reason]


def test_a_load_that_was_not_measured_is_named_once_a_grasp():
    # Scripts stated 0 kg to the controller, and nothing said so.
    apps = (
        move(0.0, there(0.1), there(0.2)),
        app("grasp", 1.0, 2.0, there(0.2), gripper_width=0.05),
        app("transport", 2.0, 3.0, there(0.3)),
        app("transport", 3.0, 4.0, there(0.4)),
        app("gripper_move", 4.0, 5.0, there(0.4), gripper_width=0.08),
    )
    unknown = "carries a load that was not measured, 0 kg are assumed: enter load_kg in the JSON file"
    assert [one for one in found(*apps) if "load" in one[1]] == [(2, unknown)]
    weighed = [one.model_copy(update={"load_kg": 0.2}) if one.kind == "transport" else one for one in apps]
    assert [one for one in found(*weighed) if "load" in one[1]] == []
    half = (*weighed[:3], apps[3], apps[4])  # the load of what is held is known from the first carry
    assert [one for one in found(*half) if "load" in one[1]] == []


@pytest.mark.parametrize(("off_m", "warned"), [(0.004, False), (0.008, True), (0.025, True)])
def test_a_drift_to_where_the_fingers_close_is_motion_in_no_app(off_m: float, warned: bool):
    # A hand drifted by 25 mm before it grasped: scripts close the fingers 25 mm away, and nothing said so.
    apps = (
        move(0.0, there(0.1), there(0.2)),
        app("grasp", 4.0, 6.0, there(0.2 + off_m), gripper_width=0.05),
    )
    where = "in no app: the robot does not move before this app"
    said = f"{1000 * off_m:.0f} mm of motion taught at 1.0–6.0 s are {where}"
    assert [reason for index, reason in found(*apps) if "in no app" in reason] == [said] * warned


@pytest.mark.parametrize(("rest_s", "warned"), [(0.3, False), (4.0, True)])
def test_a_drift_in_a_rest_in_the_air_is_motion_in_no_app(rest_s: float, warned: bool):
    # A hand that was pulled aside by 8 mm within a rest of four seconds was in no app, without a word.
    apps = (move(0.0, there(0.1), there(0.2)), move(1.0 + rest_s, there(0.208), there(0.3)))
    said = (
        f"8 mm of motion taught at 1.0–{1.0 + rest_s} s are in no app: the robot joins the path of this app "
        "after its start"
    )
    assert [reason for _, reason in found(*apps) if "in no app" in reason] == [said] * warned


@pytest.mark.parametrize(
    ("force", "warned"),
    [((0.0, 0.0, -8.2), False), ((0.0, 0.0, -12.0), True), ((8.2, 0.0, 0.0), True)],
)
def test_the_weight_of_what_is_set_down_is_no_press_that_was_lost(force: Vector, warned: bool):
    apps = (
        app("grasp", 0.0, 1.0, there(0.2), gripper_width=0.05),
        app("transport", 1.0, 2.0, there(0.4), load_kg=0.82, load_sd_kg=0.02),
        app("gripper_move", 2.0, 3.0, there(0.4), gripper_width=0.08, force_taught=force),
    )
    lost = [one for one in reasons(apps) if "does not reproduce" in one]
    assert lost == (
        [f"was taught with a press of {max(map(abs, force))} N, which it does not reproduce"] * warned
    )


@pytest.mark.parametrize(("newton", "warned"), [(-20.0, False), (-10.0, True)])
def test_a_press_that_goes_on_until_the_fingers_open_is_not_lost(newton: float, warned: bool):
    apps = (
        app("grasp", 0.0, 1.0, there(0.2), gripper_width=0.05),
        app("transport", 1.0, 2.0, there(0.4), load_kg=0.5, load_sd_kg=0.02),
        app("apply_force", 2.0, 3.0, there(0.4), force=(0.0, 0.0, newton)),
        app("gripper_move", 3.0, 4.0, there(0.4), gripper_width=0.08, force_taught=(0.0, 0.0, -20.0)),
    )
    assert any("does not reproduce" in one for one in reasons(apps)) == warned


def test_the_force_of_what_is_pushed_is_not_controlled():
    pushed = move(0.0, there(0.1), there(0.2)).model_copy(update={"force_taught": (8.0, 0.0, 0.0)})
    said = [one for one in reasons((pushed,)) if "8.0 N" in one]
    assert said == ["was taught against 8.0 N: the robot follows the path, and controls no force"]


def test_the_force_of_a_push_is_named_after_a_stronger_press_too():
    """A push with 8 N after a press with 20 N had no finding."""
    press = app("apply_force", 0.0, 1.0, there(0.2), force=(0.0, 0.0, -20.0), force_taught=(0.0, 0.0, -20.0))
    push = app("cartesian_motion", 1.0, 3.0, there(0.4), force_taught=(8.0, 0.0, 0.0))
    assert any(one.startswith("was taught against 8.0 N") for one in reasons((press, push)))


def test_what_is_lost_is_found_beside_an_error_of_another_app():
    # One number above the robot's limit hid every warning: of check, and in a behaviour tree.
    touch = app("move_to_contact", 3.0, 4.0, there(0.6))
    hard = app("apply_force", 4.0, 5.0, there(0.6), force=(0.0, 0.0, -4.0), load_kg=9.0)
    assert (1, TAUGHT) in found(FIRST, SECOND, touch, hard)
    assert any("load 9 kg, expected" in reason for _, reason in found(FIRST, SECOND, touch, hard))
    nowhere = FIRST.model_copy(update={"target": (float("nan"), 0.2, 0.3)})
    assert not any("no app" in reason for _, reason in found(nowhere, SECOND, touch, hard))


def test_what_people_set_of_an_app_is_named_with_their_names():
    # A force above the taught one, a speed and an app that was added passed as what was taught.
    touch, pressed, leave = press()
    harder = pressed.model_copy(update={"force_taught": (0.0, 0.0, -6.0)})
    slow = changed(SECOND.model_copy(update={"speed": 0.5}), AppChange(field="speed", author="Ann", edit=1))
    added = changed(
        leave, AppChange(field="added", author="Bo", edit=2), AppChange(field="name", author="Cy", edit=3)
    )
    assert reasons((touch, harder)) == ["presses harder than taught: 10.0 N of 6.0 N taught"]
    assert "differs from the demonstration: speed 50 % of the taught one by Ann" in reasons((FIRST, slow))
    assert reasons((touch, pressed, added)) == ["differs from the demonstration: added by Bo"]


@pytest.mark.parametrize(
    ("field", "named"),
    [("speed", "speed"), ("gripper_width", "gripper width"), ("tolerance_m", "tolerance")],
)
def test_a_value_that_a_document_marks_and_lacks_is_named_without_a_number(field: Any, named: str):
    """A check of a document with the mark of a speed and without the speed ended with a TypeError."""
    lacking = SECOND.model_copy(update={"path": None, "speed": None, "gripper_width": None})
    marked = changed(lacking, AppChange(field=field, author="Ann", edit=1))
    assert f"differs from the demonstration: {named} by Ann" in reasons((FIRST, marked))


@pytest.mark.parametrize(("weaker_n", "warned"), [(None, False), (9.5, False), (6.0, True)])
def test_a_weaker_force_that_was_held_in_a_press_is_named(weaker_n: float | None, warned: bool):
    touch, pressed, _ = press()
    said = "presses with 10.0 N at 2.6–4.2 s, and was taught with 6.0 N for a part of it"
    found = reasons((touch, pressed.model_copy(update={"weaker_n": weaker_n})))
    assert [one for one in found if "was taught with" in one] == (
        [f"{said}: teach each force as a separate press"] * warned
    )


@pytest.mark.parametrize(("stronger_n", "warned"), [(None, False), (11.0, False), (25.0, True)])
def test_a_stronger_force_in_a_press_is_named_unless_the_robot_exerts_it(
    stronger_n: float | None, warned: bool
):
    touch, pressed, _ = press()
    peaked = pressed.model_copy(update={"stronger_n": stronger_n})
    said = "presses with less than the 25.0 N that were taught for at least 0.2 s"
    assert [one for one in reasons((touch, peaked)) if "taught for at least" in one] == (
        [f"{said}: if the task needs that force, teach it as a separate press"] * warned
    )
    edited = peaked.model_copy(update={"force": (0.0, 0.0, -25.0)})
    assert not [one for one in reasons((touch, edited)) if "25.0 N" in one]


def test_impacts_are_named_once_for_the_program_the_hardest_first():
    touch, pressed, _ = press()
    hits = [pressed.model_copy(update={"impact_n": newton}) for newton in (20.0, 11.0, 31.0, 25.0, 24.0)]
    said = "31.0 N in app 4 (apply force), 25.0 N in app 5 (apply force), 24.0 N in app 6 (apply force)"
    assert [one for one in reasons((touch, *hits)) if "impacts" in one] == [
        f"impacts shorter than 0.2 s, as at a touch, are not reproduced: {said}, and 1 weaker"
    ]
    assert not [one for one in reasons((touch, hits[1])) if "impacts" in one]


@pytest.mark.parametrize(
    ("speed", "turn", "said"),
    [
        (None, None, []),
        (
            0.234,
            None,
            ["at 7.5–9.8 s the flange moved with 234 mm/s while the fingers moved: the robot stops for them"],
        ),
        (
            0.1,
            1.0,
            [
                "at 7.5–9.8 s the flange moved with 100 mm/s and turned with 57°/s while the fingers moved: "
                "the robot stops for them"
            ],
        ),
    ],
)
def test_fingers_that_acted_in_motion_are_named(speed: float | None, turn: float | None, said: list[str]):
    apps = list(pick_and_place())
    apps[4] = apps[4].model_copy(update={"moved_m_per_s": speed, "turned_rad_per_s": turn})
    assert [one for one in reasons(tuple(apps)) if "the fingers moved" in one] == said


@pytest.mark.parametrize(
    ("aslant", "leans"),
    [(None, None), ((0.0, 0.0, 0.0), None), ((8.0, 0.0, -6.0), 53), ((0.0, 9.0, 0.0), 90)],
)
def test_a_force_in_another_direction_that_was_held_in_a_press_is_named(
    aslant: Vector | None, leans: int | None
):
    touch, pressed, _ = press()
    found = reasons((touch, pressed.model_copy(update={"aslant": aslant})))
    named = [one for one in found if f" N at {leans}° to it for at least half a second: teach" in one]
    assert len(named) == (leans is not None)


def test_a_load_that_was_never_carried_is_named_because_it_may_be_a_pull():
    # What the fingers held was fixed, and pulled up with 12 N: the program was a hold of 1.23 kg.
    grasp = app("grasp", 0.0, 1.0, there(0.2), gripper_width=0.02)
    hold = app("hold", 1.0, 2.0, there(0.2), load_kg=1.23, load_sd_kg=0.1)
    released = app("gripper_move", 2.0, 3.0, there(0.2), gripper_width=0.08)
    pull = (
        "load 1.23 kg was felt at rest, and never carried: if the fingers held something fixed, this was a "
        "pull of 12.1 N, which no app exerts"
    )

    def pulls(*apps: App) -> list[str]:
        return [one for one in reasons(apps) if "felt at rest" in one]

    assert pulls(grasp, hold, hold, released) == [pull]
    carried = app("transport", 2.0, 3.0, there(0.3), load_kg=1.23, load_sd_kg=0.1)
    assert pulls(grasp, hold, carried, released) == []
    assert pulls(grasp, carried, released, grasp, hold) == [pull]
    light = hold.model_copy(update={"load_kg": 0.4})  # a hand that holds lightly drifts by as much
    assert pulls(grasp, light, released) == []
    against = carried.model_copy(update={"force_taught": (0.0, 0.0, 12.0)})  # a spring, which weighs nothing
    assert pulls(grasp, against, hold, released) == [pull]


@pytest.mark.parametrize(("second_kg", "named_at"), [(0.01, [2]), (0.02, [2, 3]), (0.5, [2])])
def test_a_load_below_its_uncertainty_is_named_once_a_carry(second_kg: float, named_at: list[int]):
    # A brush that was carried on eight legs had eight warnings.
    carried = [
        app("transport", t, t + 1.0, there(0.1 * t), load_kg=kg, load_sd_kg=0.05)
        for t, kg in ((2.0, 0.01), (3.0, second_kg))
    ]
    grasp = app("grasp", 1.0, 2.0, there(0.2), gripper_width=0.05)
    apps = (move(0.0, there(0.1), there(0.2)), grasp, *carried)
    said = [index for index, reason in found(*apps) if "is below what can be measured, 0.10 kg" in reason]
    assert said == named_at


@pytest.mark.parametrize(("load_kg", "named"), [(0.25, False), (0.26, False), (0.8, True)])
def test_a_load_that_changes_in_the_hand_is_named(load_kg: float, named: bool):
    apps = list(pick_and_place())
    apps[3] = apps[3].model_copy(update={"load_kg": load_kg})
    said = "carries 0.80 kg, and the app before 0.25 kg: the held object must change as when taught"
    assert (said in reasons(tuple(apps))) == named


def test_an_orientation_that_was_not_recorded_is_named():
    # A script then kept whatever orientation the arm had, and a check said "0 warnings: can be run".
    apps = [one.model_copy(update={"orientation": None, "path": None}) for one in (FIRST, SECOND)]
    unknown = "the taught orientation is unknown: the robot keeps its current one"
    assert (None, f"{unknown}; send qx qy qz qw, or the joints and --robot") in found(*apps)
    assert (1, unknown) in found(FIRST, apps[1])
    assert not any(unknown in reason for _, reason in found(FIRST, SECOND))
