"""What becomes of segments and gripper events in a task program (thesis 4.2.5)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_protocol.messages import App, AppReference, ChangeApp, ProgramEdit, Segment
from caesura_service.program import GripperAction, Moment, ProgramSegment, task_program
from caesura_service.program_edits.program_with_edits import apply
from service.program.segments import drifted, held, kinds, moment_at, program, segment, stopping_at


def test_pick_and_place_becomes_the_apps_that_the_thesis_executed():
    apps = program(
        segment("motion", 0.0, 1.8),
        segment("contact", 1.8, 3.5, force_end=(0.0, 0.0, 15.0)),
        segment("transport", 4.2, 5.7, load_kg=0.257, load_sd_kg=0.01),
        segment("transport", 5.7, 7.5, load_kg=0.293, load_sd_kg=0.02),
        segment("contact", 7.5, 9.8, force_end=(0.0, 0.0, 9.9)),
        segment("motion", 10.8, 12.8),
        grips=(GripperAction(3.0, "grasp", 0.05), GripperAction(9.2, "release", 0.08)),
        at=stopping_at,
    )
    assert kinds(apps) == [
        "move_to_contact",
        "grasp",
        "transport",
        "transport",
        "gripper_move",
        "cartesian_motion",
    ]
    assert apps[1].gripper_width == 0.05


def test_the_load_of_a_carry_is_the_average_weighted_by_time():
    apps = program(
        segment("transport", 4.2, 5.7, load_kg=0.257, load_sd_kg=0.01),
        segment("transport", 5.7, 7.5, load_kg=0.293, load_sd_kg=0.01),
        at=stopping_at,
    )
    assert [app.load_kg for app in apps] == [pytest.approx(0.2766, abs=1e-4)] * 2


def test_a_force_is_what_the_robot_exerts_scaled_to_the_limit():
    (app,) = program(segment("contact", 0.0, 1.0, force_end=(3.0, 0.0, 20.0)), force_limit_n=10.0)
    assert app.kind == "apply_force"
    assert app.force_taught == (-3.0, 0.0, -20.0)
    assert np.linalg.norm(app.force) == pytest.approx(10.0)
    np.testing.assert_allclose(np.cross(app.force, app.force_taught), 0.0, atol=1e-12)


def test_without_a_limit_a_force_is_as_it_was_taught():
    (app,) = program(segment("contact", 0.0, 1.0, force_end=(0.0, 0.0, 20.7)))
    assert app.force == app.force_taught == (0.0, 0.0, -20.7)


def test_a_force_below_the_limit_stays_as_it_was_taught():
    (app,) = program(segment("contact", 0.0, 1.0, force_end=(0.0, 0.0, 4.0)), force_limit_n=10.0)
    assert app.force == app.force_taught == (0.0, 0.0, -4.0)


def test_contacts_that_follow_each_other_are_one_app_with_the_strongest_force():
    apps = program(
        segment("contact", 0.0, 0.5, force_end=(0.0, 0.0, 7.0)),
        segment("contact", 0.5, 2.0, force_end=(0.0, 0.0, 9.0)),
        segment("contact", 2.0, 2.4, force_end=(0.0, 0.0, 2.5)),
    )
    assert kinds(apps) == ["apply_force"]
    assert apps[0].force == (0.0, 0.0, -9.0)
    assert apps[0].segments == (0, 1, 2)


def test_rests_decays_and_moments_are_left_out():
    apps = program(
        segment("steady", 0.0, 1.0),
        segment("contact", 1.0, 2.0, force_end=(0.0, 0.0, 9.0)),
        segment(
            "motion",
            2.0,
            2.5,
            position_start=(0.0, 0.0, 0.2),
            position_end=(0.0, 0.0, 0.201),
            force_start=(0.0, 0.0, 9.0),
            force_end=(0.0, 0.0, 1.0),
        ),
        segment("motion", 2.5, 2.6),
        least_s=0.3,
    )
    assert kinds(apps) == ["apply_force"]


def test_a_movement_below_the_minimum_time_is_part_of_the_one_beside_it():
    apps = program(
        segment("steady", 0.0, 1.0),
        segment("motion", 1.0, 1.2),
        segment("motion", 1.2, 2.0),
        segment("motion", 2.0, 2.1),
        segment("steady", 2.1, 3.0),
        segment("transport", 3.0, 3.2, load_kg=0.3, load_sd_kg=0.01),
        segment("motion", 3.2, 4.0),
        segment("motion", 4.1, 4.3),
        grips=(GripperAction(2.5, "grasp", 0.05), GripperAction(3.2, "release", 0.08)),
        least_s=0.3,
    )
    assert [(app.kind, app.t0, app.tn, app.segments) for app in apps if "motion" in app.kind] == [
        ("cartesian_motion", 1.0, 2.1, (1, 2, 3)),
        ("cartesian_motion", 3.2, 4.0, (6,)),  # the next one comes after a gap
    ]
    assert apps[0].target == pytest.approx((0.0, 0.0, 0.21))


def test_every_short_movement_in_a_row_is_part_of_the_one_beside_them():
    """The second of three was in no app: its confidence was not asked either."""
    unsure = segment("motion", 1.2, 1.3, probability=0.4)
    apps = program(
        segment("steady", 0.0, 1.0),
        segment("motion", 1.0, 1.2),
        unsure,
        segment("motion", 1.3, 1.5),
        segment("motion", 1.5, 2.5),
        least_s=0.3,
    )
    assert [(app.t0, app.segments, app.confidence) for app in apps] == [(1.0, (1, 2, 3, 4), 0.4)]


def test_a_short_movement_is_taken_for_what_the_fingers_make_of_it():
    """A light load looks like free space: 20 mm of its carry were lost."""
    grasp = GripperAction(1.5, "grasp", 0.05)
    apps = program(
        segment("contact", 1.0, 2.0, force_end=(0.0, 0.0, 9.0)),
        segment("motion", 2.0, 2.2),
        segment("transport", 2.2, 3.0, load_kg=0.3, load_sd_kg=0.01),
        segment("motion", 3.0, 3.2),
        grips=(grasp,),
        least_s=0.3,
    )
    assert [(app.kind, app.t0, app.tn, app.segments) for app in apps] == [
        ("grasp", 1.0, 2.0, (0,)),
        ("transport", 2.0, 3.2, (1, 2, 3)),
    ]


def test_what_was_not_picked_up_is_not_carried_for_a_moment_either():
    apps = program(
        segment("motion", 0.0, 1.0), segment("transport", 1.0, 1.2, load_kg=0.3, load_sd_kg=0.01), least_s=0.3
    )
    assert [(app.kind, app.tn, app.segments) for app in apps] == [("cartesian_motion", 1.2, (0, 1))]


def test_a_short_end_of_a_carry_has_the_load_of_the_carry():
    """A load of 0.1 s became that of the whole carry."""
    apps = program(
        segment("contact", 0.0, 1.0, force_end=(0.0, 0.0, 9.0)),
        segment("transport", 1.0, 2.9, load_kg=0.5, load_sd_kg=0.01),
        segment("transport", 2.9, 3.0, load_kg=1.5, load_sd_kg=0.41),
        least_s=0.3,
    )
    assert [app.load_kg for app in apps] == [None, pytest.approx(0.55)]
    assert [app.load_sd_kg for app in apps] == [None, pytest.approx(0.03)]


def test_a_short_movement_between_two_is_part_of_the_second():
    parts = (segment("motion", 0.0, 1.0), segment("motion", 1.0, 1.2), segment("motion", 1.2, 2.0))
    apps = program(*parts, at=stopping_at, least_s=0.3)
    assert [(app.t0, app.tn) for app in apps] == [(0.0, 1.0), (1.0, 2.0)]


def test_a_short_movement_that_an_operator_names_is_no_part_of_another():
    named = segment("motion", 1.0, 1.2).model_copy(update={"corrected": True})
    apps = program(segment("motion", 0.0, 1.0), named, least_s=0.3)
    assert [(app.t0, app.tn) for app in apps] == [(0.0, 1.0)]


def test_only_the_last_movement_before_a_contact_moves_to_it():
    apps = program(
        segment("motion", 0.0, 1.0),
        segment("motion", 1.0, 2.0),
        segment("contact", 2.0, 3.0, force_end=(0.0, 0.0, 5.0)),
        at=stopping_at,
    )
    assert kinds(apps) == ["cartesian_motion", "move_to_contact", "apply_force"]


@pytest.mark.parametrize("first", [1.8, 0.75])
def test_fingers_that_move_twice_in_a_contact_are_two_apps_one_after_the_other(first: float):
    """Both once had the time of the contact: an edit of the first one changed the second one."""
    apps = program(
        segment("motion", 0.0, 1.0),
        segment("contact", 1.0, 3.5, force_end=(0.0, 0.0, 15.0)),
        grips=(GripperAction(first, "open", 0.04), GripperAction(first + 0.2, "open", 0.08)),
    )
    one, other = apps[1:]
    assert (one.kind, other.kind, one.tn) == ("gripper_move", "gripper_move", other.t0)
    assert (one.t0, one.tn, other.tn) == pytest.approx((min(first, 1.0), first + 0.1, 3.5))
    named = AppReference(kind=one.kind, t0=one.t0, tn=one.tn)
    action = ChangeApp(app=named, name="half open")
    edit = ProgramEdit(number=1, author="Ann", at=0.0, action=action, state="applied")
    assert [app.name for app in apply(apps, [edit]).apps] == [None, "half open", None]


def test_a_grip_in_free_space_is_an_app_in_its_place():
    apps = program(
        segment("motion", 0.0, 1.0),
        segment("steady", 1.0, 2.0),
        segment("motion", 2.0, 3.0),
        grips=(GripperAction(1.5, "open", 0.08),),
    )
    assert kinds(apps) == ["cartesian_motion", "gripper_move", "cartesian_motion"]


def test_sliding_presses_on_its_way_to_a_target_and_holding_is_part_of_a_carry():
    across: dict[str, Any] = {"position_start": (0.0, 0.0, 0.1), "position_end": (0.1, 0.0, 0.1)}
    apps = program(
        segment("sliding", 0.0, 1.0, force_end=(0.0, 0.0, 8.0), **across),
        segment("hold", 2.0, 3.0, load_kg=0.3, load_sd_kg=0.1),
        segment("transport", 3.0, 4.0, load_kg=0.5, load_sd_kg=0.1),
    )
    assert kinds(apps) == ["apply_force", "hold", "transport"]
    assert apps[0].target == (0.1, 0.0, 0.1)
    assert apps[1].load_kg == apps[2].load_kg == pytest.approx(0.4)


def test_targets_carry_the_orientation_of_their_time():
    (app,) = program(segment("motion", 0.0, 2.0))
    assert app.target == (0.0, 0.0, 0.2)
    assert app.orientation == (0.0, 0.0, 0.0, 1.0)
    assert app.confidence == 0.9


@pytest.mark.parametrize("kind", ["motion", "transport"])
def test_what_a_contact_ends_has_its_target_where_the_contact_was_made(kind: str) -> None:
    load = {"load_kg": 0.3, "load_sd_kg": 0.01} if kind == "transport" else {}
    pressed = segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 8.0))
    touching, *_ = program(segment(kind, 0.0, 2.0, **load), pressed)
    assert touching.target == pytest.approx((0.0, 0.0, 0.205))
    parting, *_ = program(segment(kind, 0.0, 2.0, **load), segment("steady", 2.0, 3.0))
    assert parting.target == pytest.approx((0.0, 0.0, 0.2))


def test_pushing_in_what_gives_way_is_one_press_with_the_force_that_was_held() -> None:
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 2.5, force_held=(0.5, 0.0, 34.0)),
        segment("contact", 2.5, 4.0, force_held=(0.0, 0.0, 21.0)),
    )
    assert kinds(apps) == ["move_to_contact", "apply_force"]
    assert apps[1].segments == (1, 2)
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -21.0))


def test_a_stroke_along_a_surface_stays_a_stroke() -> None:
    across: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 8.0)),
        segment("sliding", 3.0, 4.5, force_held=(2.0, 0.0, 9.0), **across),
    )
    assert kinds(apps) == ["move_to_contact", "apply_force"]
    assert (apps[1].t0, apps[1].tn, apps[1].target) == (2.0, 4.5, (0.1, 0.0, 0.2))


def test_a_movement_with_something_that_hangs_on_the_robot_is_a_carry() -> None:
    apps = program(
        segment("sliding", 0.0, 2.0, force_held=(-0.5, 0.9, -6.0)),
        segment("sliding", 2.0, 4.0, force_held=(-0.5, 0.9, 6.0)),
    )
    assert kinds(apps)[0] == "transport"
    assert apps[0].load_kg == pytest.approx(6.0 / 9.81)
    assert "transport" not in kinds(apps)[1:]


def test_a_movement_that_ends_in_a_press_without_a_pause_is_a_movement_and_a_press() -> None:
    apps = program(
        segment("sliding", 0.0, 2.0, force_held=(0.0, 0.0, 6.0), position_end=(0.0, 0.0, -0.1)),
        segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 9.0)),
    )
    assert kinds(apps) == ["move_to_contact", "apply_force"]
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -9.0))


def test_a_contact_was_made_where_something_pushed_back_not_where_its_segment_begins() -> None:
    def pushed(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, 5.0 if t > 2.3 else 0.5))

    steps = [segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 8.0))]
    touching, _ = task_program([ProgramSegment(i, one, 1.0) for i, one in enumerate(steps)], (), pushed)
    assert touching.target == pytest.approx((0.0, 0.0, 0.235))


def test_a_movement_far_out_of_a_press_is_a_movement() -> None:
    out: dict[str, Any] = {"position_start": (0.0, 0.0, 0.16), "position_end": (0.01, 0.0, 0.29)}
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 8.0)),
        segment("sliding", 3.0, 4.5, force_held=(1.0, 0.0, 6.0), **out),
    )
    assert kinds(apps) == ["move_to_contact", "apply_force", "cartesian_motion"]


def test_a_press_has_its_target_where_it_was_last_pressed() -> None:
    def pushed(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, 8.0 if 2.0 < t < 2.6 else 1.0))

    steps = [segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, force_held=(0.0, 0.0, 8.0))]
    _, pressed = task_program([ProgramSegment(i, one, 1.0) for i, one in enumerate(steps)], (), pushed)
    assert pressed.target == pytest.approx((0.0, 0.0, 0.255))


def plugged(depth_m: float, released_s: float, newton: float = 20.0) -> list[App]:
    """A plug is carried down, pushed in from 4 to 5 s, held in until 5.5 s, and let go."""

    def at(t: float) -> Moment:
        z = float(np.interp(t, [2.0, 4.0, 5.0], [0.4, 0.2, 0.2 - depth_m]))
        force = float(np.interp(t, [4.0, 4.1, 5.5, 5.6], [0.0, newton, newton, 0.0]))
        return replace(moment_at(0.0), position=(0.0, 0.0, z), force=(0.0, 0.0, force))

    def part(kind: str, t0: float, tn: float, **fields: Any) -> Segment:
        return segment(kind, t0, tn, position_start=at(t0).position, position_end=at(tn).position, **fields)

    made = program(
        part("transport", 2.0, 4.0, load_kg=0.0, load_sd_kg=0.05),
        part("contact", 4.0, 5.6, force_held=(0.0, 0.0, newton)),
        part("steady", 5.6, 7.0),
        grips=(GripperAction(1.0, "grasp", 0.02), GripperAction(released_s, "release", 0.08)),
        at=at,
    )
    return [one for one in made if one.kind != "grasp"]


@pytest.mark.parametrize("released_s", [5.3, 5.5, 5.8])
def test_what_is_pushed_in_before_the_fingers_let_go_is_a_press_and_then_a_release(released_s: float) -> None:
    """A plug that was pushed in by 14 mm with 30 N was only let go, 14 mm above its place."""
    made = plugged(0.014, released_s)
    assert kinds(made) == ["transport", "apply_force", "gripper_move"]
    _, press, release = made
    assert press.force == pytest.approx((0.0, 0.0, -20.0))
    assert press.target == pytest.approx((0.0, 0.0, 0.186), abs=5e-4)
    assert press.tn <= max(release.t0, 5.6)
    assert release.t0 == pytest.approx(released_s, abs=0.05)


def test_what_is_set_down_and_let_go_is_not_pushed_in() -> None:
    made = plugged(0.008, 5.3)
    assert kinds(made) == ["transport", "gripper_move"]
    assert made[1].force_taught == pytest.approx((0.0, 0.0, -20.0))


def test_a_grasp_that_comes_later_does_not_divide_a_press() -> None:
    """A button went in by 14 mm: with a grasp half a minute later, its press was two."""
    here, there = (0.0, 0.0, 0.2), (0.0, 0.0, 0.186)
    made = program(
        segment("motion", 2.0, 4.0, position_start=(0.0, 0.0, 0.4), position_end=here),
        segment("sliding", 4.0, 5.0, position_start=here, position_end=there, **held(10.0)),
        segment("contact", 5.0, 7.0, position_start=there, position_end=there, **held(10.0)),
        segment("motion", 7.0, 8.0, position_start=there, position_end=(0.0, 0.0, 0.4)),
        grips=(GripperAction(40.0, "grasp", 0.02),),
        at=drifted,
    )
    assert kinds(made)[:2] == ["move_to_contact", "apply_force"]
    assert [(app.t0, app.tn) for app in made if app.kind == "apply_force"] == [(4.0, 7.0)]


def test_what_holds_a_peg_in_its_hole_is_no_part_of_the_press_that_pushed_it_in() -> None:
    """A robot that pushed with the 9 N that held the peg, in place of 15 N, did not push it in."""

    def at(t: float) -> Moment:
        z = float(np.interp(t, [2.0, 4.0, 5.5], [0.4, 0.2, 0.176]))
        return replace(moment_at(0.0), position=(0.0, 0.0, z), force=(0.0, 0.0, 0.0 if t < 4.0 else 15.0))

    ends = {"position_start": at(5.5).position, "position_end": at(5.5).position}
    made = program(
        segment("transport", 2.0, 4.0, load_kg=0.0, load_sd_kg=0.05),
        segment(
            "sliding",
            4.0,
            5.5,
            force_held=(0.0, 0.0, 15.0),
            position_start=at(4.0).position,
            position_end=at(5.5).position,
        ),
        segment("contact", 5.5, 7.0, force_held=(0.0, 0.0, 9.0), **ends),
        segment("steady", 7.0, 8.0),
        grips=(GripperAction(1.0, "grasp", 0.02), GripperAction(6.9, "release", 0.08)),
        at=at,
    )
    press, release = made[-2:]
    assert (press.kind, release.kind) == ("apply_force", "gripper_move")
    assert press.force == pytest.approx((0.0, 0.0, -15.0))
    assert (press.tn, release.t0) == (5.5, 5.5)


def test_what_a_surface_bears_is_not_pushed_in() -> None:
    """A load of 1 kg was set down over 30 mm, and the robot then pressed with its weight."""

    def at(t: float) -> Moment:
        z = float(np.interp(t, [2.0, 4.0, 5.5], [0.4, 0.23, 0.2]))
        borne = float(np.interp(t, [4.0, 5.5], [0.0, 1.0]))
        return replace(moment_at(0.0), position=(0.0, 0.0, z), force=(0.0, 0.0, -9.8 * (1.0 - borne)))

    def part(kind: str, t0: float, tn: float, **fields: Any) -> Segment:
        return segment(kind, t0, tn, position_start=at(t0).position, position_end=at(tn).position, **fields)

    made = program(
        part("transport", 2.0, 4.0, load_kg=1.0, load_sd_kg=0.05),
        part("contact", 4.0, 7.0, force_held=(0.0, 0.0, 0.0)),
        part("steady", 7.0, 8.0),
        grips=(GripperAction(1.0, "grasp", 0.02), GripperAction(6.9, "release", 0.08)),
        at=at,
    )
    assert "apply_force" not in kinds(made)
