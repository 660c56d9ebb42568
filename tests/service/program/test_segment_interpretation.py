"""What a segment is taken for beside what came before it, and what the fingers did."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from caesura_protocol.messages import App, ScrewMotion, Segment, Vector
from caesura_protocol.programs.checks.preconditions import order_findings
from caesura_service.program import GripperAction, Moment, Paths, ProgramSegment, task_program
from service.program.test_builder import kinds, moment_at, segment

DRIFT_N = (2.0, -1.5, 3.0)  # of the sensor since it was tared
ACROSS: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}
OFF: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.3), "force_held": None}
GRASP, RELEASE = GripperAction(0.5, "grasp", 0.05), GripperAction(4.5, "release", 0.08)


def drifted(t: float, *, pushed_n: float = 0.0) -> Moment:
    place = moment_at(t)
    x, y, z = DRIFT_N
    return Moment(place.position, place.orientation, place.joints, place.gripper_width, (x, y, z + pushed_n))


def held(push_n: float) -> dict[str, Any]:
    x, y, z = DRIFT_N
    return {"force_held": (x, y, z + push_n)}


def program(*segments: Any, grips: tuple[GripperAction, ...] = (), at: Any = moment_at) -> tuple[App, ...]:
    return task_program([ProgramSegment(i, one, 1.0) for i, one in enumerate(segments)], grips, at)


def forces_of(app: App) -> list[float]:
    """[N] taught: along its path, then in the rests that have a force of their own."""
    rests = [rest.newton_taught for rest in (app.rest_before, app.rest_after) if rest is not None]
    return [math.hypot(*(app.force_taught or ())), *rests]


def test_a_press_is_what_it_adds_to_the_force_that_was_there_before() -> None:
    apps = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, **held(8.0)), at=drifted)
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0))


def test_presses_that_follow_each_other_are_all_measured_from_before_the_first() -> None:
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(18.0)),
        segment("sliding", 3.0, 4.5, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 18.0 if t < 3.0 else 9.0),
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -9.0))
    assert forces_of(apps[1]) == pytest.approx([9.0, 18.0])


@pytest.mark.parametrize(
    ("before", "touching", "becomes"),
    [
        ("steady", "sliding", ["cartesian_motion"]),
        ("motion", "contact", ["cartesian_motion"]),
        ("transport", "sliding", ["transport", "transport"]),
        ("transport", "contact", ["transport", "hold"]),
    ],
)
def test_a_contact_that_begins_without_a_change_of_the_force_goes_on_as_what_came_before(
    before: str, touching: str, becomes: list[str]
) -> None:
    apps = program(segment(before, 0.0, 2.0), segment(touching, 2.0, 4.0, **held(0.5), **ACROSS), at=drifted)
    assert kinds(apps) == becomes


def test_a_contact_was_made_where_the_movement_into_it_was_pushed_back_first() -> None:
    def late(t: float) -> Moment:
        return drifted(t, pushed_n=5.0 if t > 1.7 else 0.0)

    touching, pressing = program(
        segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, **held(8.0)), at=late
    )
    assert touching.target == pytest.approx((0.0, 0.0, 0.175))
    assert pressing.force_taught == pytest.approx((0.0, 0.0, -8.0))


@pytest.mark.parametrize(("kind", "becomes"), [("transport", ["cartesian_motion"]), ("hold", [])])
def test_what_the_fingers_have_let_go_is_not_carried(kind: str, becomes: list[str]) -> None:
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    apps = program(segment(kind, 5.0, 7.0, **load), grips=(GRASP, RELEASE))
    assert kinds(tuple(app for app in apps if app.segments)) == becomes


def test_where_no_gripper_shows_what_weighs_nothing_is_not_carried() -> None:
    light = {"load_kg": 0.07, "load_sd_kg": 0.06}
    heavy = {"load_kg": 0.3, "load_sd_kg": 0.06}
    assert kinds(program(segment("transport", 0.0, 2.0, **light))) == ["cartesian_motion"]
    assert kinds(program(segment("transport", 0.0, 2.0, **heavy))) == ["transport"]


def test_what_the_fingers_hold_is_carried_from_beginning_to_end_however_light() -> None:
    carry = segment("transport", 3.0, 4.0, load_kg=0.15, load_sd_kg=0.05)
    before, after = segment("motion", 1.0, 3.0), segment("motion", 5.0, 6.0)
    apps = [app for app in program(before, carry, after, grips=(GRASP, RELEASE)) if app.segments]
    assert kinds(tuple(apps)) == ["transport", "transport", "cartesian_motion"]
    assert apps[0].load_kg == pytest.approx(0.15)


def test_what_begins_to_weigh_in_the_air_is_not_carried() -> None:
    before, carry = segment("motion", 1.0, 3.0), segment("transport", 3.5, 5.0, load_kg=0.3, load_sd_kg=0.05)
    for between, becomes in (("steady", "cartesian_motion"), ("contact", "transport")):
        touched = segment(between, 3.0, 3.2)  # too short for an app
        assert kinds(program(before, touched, carry))[-1] == becomes


def test_between_fingers_that_are_shut_there_is_nothing() -> None:
    carry = segment("transport", 3.0, 5.0, load_kg=0.3, load_sd_kg=0.05)
    for width, becomes in ((0.001, "cartesian_motion"), (0.04, "transport")):
        (app,) = program(carry, at=lambda t, width=width: replace(moment_at(t), gripper_width=width))
        assert app.kind == becomes


def test_a_rest_after_a_soft_stroke_is_in_contact_though_something_short_was_before_the_stroke() -> None:
    """The stroke after that rest began without a contact, and was said to be 6 N softer than it was."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(13.0)),
        segment("motion", 3.0, 3.1, **ACROSS),
        segment("motion", 3.1, 5.0, **ACROSS),
        segment("steady", 5.0, 6.0, position_start=(0.1, 0.0, 0.2), position_end=(0.1, 0.0, 0.2)),
        segment("sliding", 6.0, 8.0, **held(16.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 13.0 if t < 3.0 else 6.0 if t < 6.0 else 16.0),
    )
    assert math.hypot(*(made[-1].force_taught or ())) == pytest.approx(16.0)


@pytest.mark.parametrize("rest", ["contact", "steady"])
@pytest.mark.parametrize("turns", [False, True])
def test_what_follows_a_contact_and_holds_its_force_is_a_contact(turns: bool, rest: str) -> None:
    """Two strokes of a screw, the tool turned back between them under 6 N: they pressed without a contact."""
    still: dict[str, Any] = {"position_end": (0.0, 0.0, 0.6), **(held(6.0) if rest == "contact" else {})}
    back = segment("motion", 4.0, 6.0, **ACROSS)
    if turns:
        back = back.model_copy(update={"kind": "turning", "position_end": back.position_start})
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(13.0)),
        back,
        segment(rest, 6.0, 7.0, **still),
        segment("contact", 7.0, 9.0, **held(13.0)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 6.0 if 4.0 < t < 7.0 else 13.0),
    )
    assert [(app.kind, app.segments) for app in made] == [
        ("move_to_contact", (0,)),
        ("apply_force", (1, 2, 3)),
        ("apply_force", (4,)),
    ]
    assert forces_of(made[1]) == pytest.approx([6.0, 13.0, 6.0])
    assert forces_of(made[2]) == pytest.approx([13.0])


def test_what_holds_the_force_of_a_contact_is_one_after_less_than_the_minimum_time_in_between() -> None:
    """A screwdriver was turned back under 6 N, and the first 0.1 s of that were a segment of their own."""
    back = segment("motion", 4.1, 6.0, **ACROSS)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(13.0)),
        segment("motion", 4.0, 4.1),
        back.model_copy(update={"kind": "turning", "position_end": back.position_start}),
        segment("contact", 6.0, 9.0, position_end=(0.0, 0.0, 0.6), **held(13.0)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 6.0 if 4.0 < t < 6.0 else 13.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "apply_force"]


TO_TABLE, TO_WALL = (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        pytest.param([("contact", 3.0, 2.0, TO_TABLE)], [[15.0, 2.0]], id="a rest that is hardly pressed"),
        pytest.param(
            [("contact", 1.0, 40.0, TO_TABLE), ("contact", 1.5, 8.0, TO_TABLE)],
            [[15.0, 40.0], [8.0]],
            id="a hard press, then a soft one",
        ),
        pytest.param(
            [("contact", 3.0, 25.0, TO_TABLE), ("sliding", 0.6, 15.0, TO_TABLE)],
            [[15.0, 25.0], [15.0]],
            id="a hard press before a short slide",
        ),
        pytest.param([("sliding", 2.0, 25.0, TO_WALL)], [[15.0], [25.0]], id="a short slide along a wall"),
        pytest.param(
            [("contact", 3.0, 25.0, TO_WALL), ("sliding", 0.6, 15.0, TO_TABLE)],
            [[15.0], [25.0], [15.0]],
            id="a press against a wall, and a short slide",
        ),
        pytest.param([("sliding", 0.6, 15.0, TO_TABLE)], [[15.0]], id="a short slide that goes on"),
    ],
)
def test_no_force_beside_a_stroke_is_lost_or_spread_over_it(
    after: list[tuple[str, float, float, tuple[float, float, float]]], expected: list[list[float]]
) -> None:
    """After a stroke of 15 N."""
    t, end, pressed = 4.0, (0.1, 0.0, 0.2), [(2.0, 15.0, TO_TABLE)]
    made = [segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **ACROSS, force_held=(0.0, 0.0, 15.0))]
    for kind, seconds, newtons, towards in after:
        begin, end = end, (0.1, 0.018, 0.2) if kind == "sliding" else end
        felt = tuple(-newtons * part for part in towards)
        made.append(
            segment(kind, t, t + seconds, position_start=begin, position_end=end, force_held=felt),
        )
        pressed.append((t, newtons, towards))
        t += seconds

    def at(time: float) -> Moment:
        newtons, towards = next(
            ((newtons, towards) for since, newtons, towards in reversed(pressed) if time >= since),
            (0.0, TO_TABLE),
        )
        x, y, z = (-newtons * part for part in towards)
        return replace(moment_at(time), force=(x, y, z))

    presses = [app for app in program(*made, at=at) if app.kind == "apply_force"]
    assert [forces_of(app) for app in presses] == [pytest.approx(one) for one in expected]


def test_a_stroke_in_the_air_between_two_contacts_is_no_press() -> None:
    """Of a sensor that drifts sideways; it became a press of 0.8 N, which the check refuses.

    The short press after it is no end of a stroke.
    """
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(13.0)),
        segment("sliding", 3.0, 5.0, **held(0.8), **ACROSS),
        segment("contact", 5.0, 5.4, **held(13.0)),
        at=drifted,
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "move_to_contact", "apply_force"]


def test_a_stroke_under_friction_is_a_contact_though_the_force_is_tilted() -> None:
    x, y, z = DRIFT_N
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, force_held=(x + 1.5, y, z + 10.0)),
        segment("motion", 3.0, 5.0, **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 8.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force"]
    assert made[1].segments == (1, 2)


@pytest.mark.parametrize(("pressed_until", "becomes"), [(3.8, []), (3.1, ["cartesian_motion"])])
def test_a_way_in_the_air_after_a_contact_is_a_movement(pressed_until: float, becomes: list[str]) -> None:
    """Lifting off by 13 mm was left out, as if it were the contact's force that decays."""
    off = {"position_start": (0.0, 0.0, 0.300), "position_end": (0.0, 0.0, 0.313)}
    fading = {"force_start": (0.0, 0.0, 13.0), "force_end": (0.0, 0.0, 3.0)}

    def lifted(t: float) -> Moment:
        pressed = drifted(t, pushed_n=10.0 if 2.0 < t < pressed_until else 0.0)
        return replace(pressed, position=(0.0, 0.0, 0.300 + 0.013 * min(max((t - 3.0) / 0.9, 0.0), 1.0)))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.300)),
        segment("motion", 3.0, 3.9, **off, **fading),
        at=lifted,
    )
    assert kinds(made) == ["move_to_contact", "apply_force", *becomes]


def test_what_springs_back_after_a_press_takes_the_hand_along() -> None:
    """A pump came up by 16 mm of 25, and the next movement led through it: the check refused that."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.325)),
        segment(
            "motion", 3.0, 3.4, position_start=(0.0, 0.0, 0.3), position_end=(0.0, 0.0, 0.316),
            force_start=(0.0, 0.0, 13.0), force_end=(0.0, 0.0, 3.0),
        ),
        at=lambda t: replace(
            drifted(t, pushed_n=10.0 if 2.0 < t < 3.1 else 0.0),
            position=(0.0, 0.0, 0.325 if t < 2.1 else 0.3),
        ),
    )  # fmt: skip
    assert kinds(made) == ["move_to_contact", "apply_force"]


def test_a_contact_that_begins_on_the_way_down_is_left_from_where_it_was_touched() -> None:
    """Its segment began 13 mm above the surface, so lifting off by 12 mm seemed to stay within it."""

    def at(t: float) -> Moment:
        height = 0.313 if t < 2.1 else 0.3 if t < 3.0 else 0.3 + 0.012 * min((t - 3.0) / 0.6, 1.0)
        return replace(drifted(t, pushed_n=10.0 if 2.1 < t < 3.0 else 0.0), position=(0.0, 0.0, height))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.313)),
        segment(
            "motion", 3.0, 3.6, position_start=(0.0, 0.0, 0.3), position_end=(0.0, 0.0, 0.312),
            force_start=(0.0, 0.0, 13.0), force_end=(0.0, 0.0, 3.0),
        ),
        at=at,
    )  # fmt: skip
    assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]


@pytest.mark.parametrize(("seconds", "lasts"), [(0.4, False), (1.5, True)])
@pytest.mark.parametrize("push_n", [4.0, 9.0, 14.0])
def test_a_rest_at_the_end_of_a_stroke_is_its_end_and_has_a_force_of_its_own_where_it_lasts(
    seconds: float, lasts: bool, push_n: float
) -> None:
    """A press beside a stroke was an app of its own where their forces differed by 4.6 N, and a part else."""
    until = 4.0 + seconds
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, until, **held(push_n)),
        segment("motion", until, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=0.0 if not 2.0 < t < until else 9.0 if t < 4.0 else push_n),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]
    assert (made[1].t0, made[1].tn) == (2.0, until)
    assert forces_of(made[1]) == pytest.approx([9.0, push_n] if lasts else [9.0])


@pytest.mark.parametrize("parts", [(2.0, 3.6), (2.0, 2.3, 3.0, 3.6)])
def test_the_force_of_a_rest_is_the_same_however_it_is_divided(parts: tuple[float, ...]) -> None:
    rests = [segment("contact", t0, tn, **held(9.0)) for t0, tn in pairwise(parts)]
    made = program(
        segment("motion", 0.0, 2.0),
        *rests,
        segment("sliding", 3.6, 5.0, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 4.0 if t < 2.5 else 12.0 if t < 3.6 else 9.0),
    )
    assert forces_of(made[1]) == pytest.approx([9.0, 12.0])


def test_a_touch_in_which_the_force_rises_is_no_press_of_its_own() -> None:
    """Its median is 5 N less than what the rest after it is pressed with."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.5, **held(9.0)),
        segment("contact", 2.5, 3.5, **held(11.0)),
        segment("sliding", 3.5, 5.0, **held(12.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else min(4.0 + 10.0 * (t - 2.05), 11.0)),
    )
    assert [app.segments for app in made] == [(0,), (1, 2, 3)]
    assert forces_of(made[1]) == pytest.approx([11.0, 11.0])


def test_the_force_of_a_stroke_is_measured_in_the_axes_of_a_tool_that_turns() -> None:
    """It is 10 N along the tool, which turns from -40 to 40 degrees: its median in the base frame is less."""

    def at(t: float) -> Moment:
        angle = math.radians(-40.0 + 40.0 * (t - 2.0)) if t > 2.0 else math.radians(-40.0)
        x, y, z = DRIFT_N
        push = 10.0 if t > 2.0 else 0.0
        along = (x + push * math.sin(angle), y, z + push * math.cos(angle))
        turned = (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle))
        return replace(moment_at(t), force=along, orientation=turned)

    made = program(segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS), at=at)
    assert forces_of(made[1]) == pytest.approx([10.0])


def test_a_rest_between_two_strokes_ends_the_first_while_the_force_rises() -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(6.0), **ACROSS),
        segment("contact", 4.0, 5.0, **held(10.0)),
        segment("sliding", 5.0, 7.0, **held(15.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 10.0),
    )
    assert [(app.t0, app.tn, app.segments) for app in made[1:]] == [(2.0, 5.0, (1, 2)), (5.0, 7.0, (3,))]


def test_what_a_touch_pushes_in_before_a_stroke_is_its_beginning() -> None:
    into = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.195)}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 2.7, **held(8.0), **into),
        segment("contact", 2.7, 3.3, **held(10.0)),
        segment("sliding", 3.3, 5.0, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 9.0),
    )
    assert [(app.kind, app.segments) for app in made] == [
        ("move_to_contact", (0,)),
        ("apply_force", (1, 2, 3)),
    ]


def turned(axis: tuple[float, float, float], t0: float, tn: float) -> Segment:
    """A turn in contact by 0.3 rad about an axis."""
    x, y, z = axis
    place = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.11, 0.0, 0.2)}
    made = segment("sliding", t0, tn, **held(9.0), **place)
    return made.model_copy(update={"kind": "turning", "turn": (0.3 * x, 0.3 * y, 0.3 * z)})


UPRIGHT = (1.0, 0.0, 0.0, 0.0)  # the tool points down


@pytest.mark.parametrize(
    ("axis", "strokes"),
    [((1.0, 0.0, 0.0), [(1, 2, 3)]), ((0.0, 0.0, -1.0), [(1, 2), (3,)])],
)
def test_a_tilt_in_contact_is_the_end_of_the_stroke_before_it_and_a_turn_about_the_tool_is_not(
    axis: tuple[float, float, float], strokes: list[tuple[int, ...]]
) -> None:
    """A person tilted a peg at the end of a stroke, and the robot that did the same was found to turn."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.3, **held(9.0)),
        turned(axis, 4.3, 5.0),
        segment("motion", 5.0, 7.0, **OFF),
        at=lambda t: replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=UPRIGHT),
    )
    pressed = [app for app in made if app.kind == "apply_force"]
    assert [app.segments for app in pressed] == strokes
    assert (pressed[0].t0, pressed[-1].tn) == (2.0, 5.0)
    assert pressed[0].target == pytest.approx((0.11, 0.0, 0.2) if len(strokes) == 1 else (0.1, 0.0, 0.2))


@pytest.mark.parametrize(
    ("torque_nm", "strokes"), [(0.3, [(1, 2, 3)]), (2.0, [(1, 2), (3,)])], ids=["the tip's", "a lever's"]
)
def test_a_tilt_against_more_than_its_force_at_a_hands_breadth_is_no_end_of_a_stroke(
    torque_nm: float, strokes: list[tuple[int, ...]]
) -> None:
    """A stroke does not end at a torque, so that of a lever would be lost. The peg's rim makes one too."""
    tilt = turned((1.0, 0.0, 0.0), 4.3, 5.0)
    screw = ScrewMotion(
        axis=(1.0, 0.0, 0.0), point=(0.1, 0.0, 0.1), angle=0.3, pitch_m=0.0, pitch_sd_m=0.001,
        torque=(-torque_nm, 0.0, 0.0),
    )  # fmt: skip
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.3, **held(9.0)),
        tilt.model_copy(update={"screw": screw}),
        segment("motion", 5.0, 7.0, **OFF),
        at=lambda t: replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=UPRIGHT),
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


@pytest.mark.parametrize(
    ("tip_moves_m", "strokes"), [(0.0, [(1, 2)]), (0.027, [(1,), (2,)])], ids=["a tilt", "a slide"]
)
def test_a_slide_in_which_the_tool_only_turns_about_its_tip_is_the_end_of_the_stroke_before_it(
    tip_moves_m: float, strokes: list[tuple[int, ...]]
) -> None:
    """It moves the flange by 27 mm, far more than the end of a stroke. Named a turn or a slide, it is one."""
    rad, tool_m, start = 0.23, 0.12, np.array([0.1, 0.0, 0.2])

    def tool(angle: float) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Its axis, and its orientation, once it is tilted about x."""
        axis = np.array([0.0, -math.sin(angle), -math.cos(angle)])
        return axis, (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))

    (upright, _), (tilted, _) = tool(0.0), tool(rad)
    end = start + tool_m * (upright - tilted) + np.array([tip_moves_m, 0.0, 0.0])
    tilt = segment(
        "sliding", 4.0, 5.0, **held(9.0), position_start=tuple(start), position_end=tuple(end)
    ).model_copy(update={"turn": (rad, 0.0, 0.0)})

    def at(t: float) -> Moment:
        share = min(max(t - 4.0, 0.0), 1.0)
        x, y, z, w = tool(share * rad)[1]
        return replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=(x, y, z, w))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        tilt,
        segment("motion", 5.0, 7.0, **OFF),
        at=at,
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


@pytest.mark.parametrize(("rad", "apps"), [(0.004, [(0,), (1, 2)]), (0.3, [(0,), (1,), (2,)])])
def test_a_turn_by_next_to_nothing_after_a_screw_is_a_rest(rad: float, apps: list[tuple[int, ...]]) -> None:
    """While the force on a screw fell, the tool turned by 0.2 degrees, and that was an app."""
    after = turned((0.0, 0.0, -1.0), 4.0, 4.5).model_copy(
        update={"turn": (0.0, 0.0, -rad), "position_start": (0.11, 0.0, 0.2)}
    )
    made = program(
        segment("motion", 0.0, 2.0),
        turned((0.0, 0.0, -1.0), 2.0, 4.0),
        after,
        at=lambda t: replace(drifted(t, pushed_n=0.0 if t < 2.0 else 9.0), orientation=UPRIGHT),
    )
    assert [app.segments for app in made] == apps


def test_a_tilt_after_a_screw_is_an_app_of_its_own() -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        turned((0.0, 0.0, -1.0), 2.0, 4.0),
        turned((1.0, 0.0, 0.0), 4.0, 5.0),
        at=lambda t: replace(drifted(t, pushed_n=0.0 if t < 2.0 else 9.0), orientation=UPRIGHT),
    )
    assert [app.segments for app in made] == [(0,), (1,), (2,)]


def test_a_contact_was_made_where_its_rest_pushes_back_though_the_stroke_leans_to_another_side() -> None:
    """Over a bend the force leans by 59 degrees from rest to stroke: the touch was found 24 mm later."""
    x, y, z = DRIFT_N

    def at(t: float) -> Moment:
        leaning = (x, y - 4.0 * (t > 2.0), z + 3.0 * (t > 2.0)) if t < 3.0 else (x, y + 1.0, z + 9.0)
        return replace(drifted(t), force=leaning, position=(t, 0.0, 0.2))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, force_held=(x, y - 4.0, z + 3.0)),
        segment("sliding", 3.0, 5.0, force_held=(x, y + 1.0, z + 9.0), **ACROSS),
        at=at,
    )
    assert [app.segments for app in made] == [(0,), (1, 2)]
    assert made[0].target == pytest.approx((2.05, 0.0, 0.2))


SHORT: dict[str, Any] = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.013, 0.2)}
LONG: dict[str, Any] = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.03, 0.2)}


@pytest.mark.parametrize(("slide", "strokes"), [(SHORT, [(1, 2, 3)]), (LONG, [(1, 2), (3,)])])
def test_a_short_slide_after_a_stroke_is_its_end(
    slide: dict[str, Any], strokes: list[tuple[int, ...]]
) -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.6, **held(9.0)),
        segment("sliding", 4.6, 5.2, **held(9.0), **slide),
        segment("motion", 5.2, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < 5.2 else 0.0),
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


def test_a_short_slide_before_a_stroke_is_its_beginning_with_one_path() -> None:
    """The hand slid on by 13 mm as it touched, and the robot that did the same stood there."""
    slide = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.013, 0.0, 0.2)}
    stroke = {"position_start": (0.013, 0.0, 0.2), "position_end": (0.2, 0.0, 0.2)}
    t = np.linspace(2.0, 6.0, 41)
    poses = np.column_stack(
        [np.interp(t, [2.0, 2.5, 3.0, 6.0], [0.0, 0.013, 0.013, 0.2]), 0.0 * t, 0.0 * t + 0.2]
    )

    def between(t0: float, tn: float) -> tuple[np.ndarray, np.ndarray]:
        inside = (t >= t0 - 1e-9) & (t <= tn + 1e-9)
        return t[inside], poses[inside]

    made = task_program(
        [
            ProgramSegment(0, segment("motion", 0.0, 2.0), 1.0),
            ProgramSegment(1, segment("sliding", 2.0, 2.5, **held(9.0), **slide), 1.0),
            ProgramSegment(2, segment("contact", 2.5, 3.0, **held(9.0)), 1.0),
            ProgramSegment(3, segment("sliding", 3.0, 6.0, **held(9.0), **stroke), 1.0),
        ],
        (),
        lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 9.0),
        paths=Paths(between),
    )
    (pressed,) = (app for app in made if app.kind == "apply_force")
    assert pressed.path is not None
    assert (pressed.segments, pressed.path.start.t, pressed.path.tn) == ((1, 2, 3), 2.0, 6.0)
    assert pressed.target == pytest.approx((0.2, 0.0, 0.2))


def carried(at_n: float) -> tuple[App, ...]:
    """A load of 4 N is carried, rests and is moved on, under a force of its own from 2 to 5 s."""
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    still = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}

    def at(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, at_n if 2.0 < t < 5.0 else -4.0))

    return program(
        segment("transport", 0.0, 2.0, **load),
        segment("hold", 2.0, 3.5, **load, **still),
        segment("motion", 3.5, 4.2, **ACROSS),
        segment("steady", 4.2, 5.0, **still),
        segment("transport", 5.0, 7.0, **load),
        grips=(GripperAction(-1.0, "grasp", 0.03),),
        at=at,
    )


def test_a_load_that_weighs_something_else_is_set_down() -> None:
    """A peg that rests on a table with 3 N had 1 N more than nothing, and was said to be carried."""
    assert kinds(carried(1.5)) == ["grasp", "transport", "apply_force", "transport"]
    assert carried(1.5)[2].segments == (1, 2, 3)
    assert kinds(carried(-1.0)) == ["grasp", "transport", "hold", "transport", "hold", "transport"]


@pytest.mark.parametrize(
    ("rest_n", "parts"), [(5.0, [(2.0, 6.0), (6.0, 8.0)]), (19.0, [(2.0, 4.0), (4.0, 8.0)])]
)
def test_a_rest_between_two_strokes_belongs_to_the_one_that_is_pressed_as_it_is(
    rest_n: float, parts: list[tuple[float, float]]
) -> None:
    """The end of a soft stroke was said to be pressed with the force of the hard one that followed."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(4.0), **ACROSS),
        segment("contact", 4.0, 6.0, **held(rest_n)),
        segment("sliding", 6.0, 8.0, **held(20.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 4.0 if t < 4.0 else rest_n if t < 6.0 else 20.0),
    )
    assert [(app.t0, app.tn) for app in made[1:]] == parts
    soft, hard = made[1:]
    rest = soft.rest_after if rest_n < 10.0 else hard.rest_before
    assert rest is not None
    assert rest.newton_taught == pytest.approx(rest_n)
    assert (hard.rest_before if rest_n < 10.0 else soft.rest_after) is None


def test_what_is_touched_at_the_end_of_an_approach_is_no_bias() -> None:
    """A hand pushed a pump in for half a second of the movement towards it: its force became the bias."""

    def pushed(t: float) -> Moment:
        return drifted(t, pushed_n=8.0 if 1.5 <= t < 4.0 else 0.0)

    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(8.0)),
        segment("motion", 4.0, 6.0),
        at=pushed,
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0), abs=0.3)


def test_the_bias_of_a_sensor_is_read_on_both_sides_of_a_contact() -> None:
    """It wandered by 3 N over a stroke, whose force was said to be 1.5 N too large."""

    def wandering(t: float) -> Moment:
        pushed_n = 10.0 if 2.0 < t < 6.0 else 0.0
        return drifted(t, pushed_n=pushed_n + min(max(0.75 * (t - 2.0), 0.0), 3.0))

    stroke, rest = (
        segment("sliding", 2.0, 5.0, **held(11.1), **ACROSS),
        segment("contact", 5.0, 6.0, **held(12.6)),
    )
    off = segment("motion", 6.0, 8.0, **OFF)
    apps = program(segment("motion", 0.0, 2.0), stroke, rest, off, at=wandering)
    assert forces_of(apps[1]) == pytest.approx([10.0, 10.0], abs=0.5)
    held_until = program(segment("motion", 0.0, 2.0), stroke, rest, at=wandering)  # not yet let go
    assert forces_of(held_until[1]) == pytest.approx([11.1, 12.6], abs=0.1)


@pytest.mark.parametrize("grips", [(), (GripperAction(5.2, "open", 0.08),)])
def test_what_is_in_the_air_after_a_contact_is_no_bias_where_it_is_more_than_that(
    grips: tuple[GripperAction, ...],
) -> None:
    left_n = 2.0 if grips else 9.0
    stroke, off = segment("sliding", 2.0, 5.0, **held(20.0), **ACROSS), segment("motion", 5.0, 8.0, **OFF)
    at = lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 20.0 if t < 5.0 else left_n)  # noqa: E731
    apps = program(segment("motion", 0.0, 2.0), stroke, off, at=at, grips=grips)
    assert forces_of(apps[1]) == pytest.approx([20.0], abs=1e-6)


def test_a_stroke_that_begins_in_the_air_has_its_path_from_the_touch_on() -> None:
    """Its segment began on the way down: the path of a stroke began 9 mm above the surface."""

    def down_then_across(t: float) -> Moment:
        x, z = (0.0, 0.1 + 0.05 * (3.0 - t)) if t < 3.0 else (0.1 * (t - 3.0), 0.1)
        return replace(drifted(t, pushed_n=8.0 if t > 3.0 else 0.0), position=(x, 0.0, z))

    def poses(t0: float, tn: float) -> tuple[Any, Any]:
        times = np.arange(t0, tn + 1e-9, 0.05)
        return times, np.array([down_then_across(t).position for t in times])

    begun = {"position_start": (0.0, 0.0, 0.12), "position_end": (0.2, 0.0, 0.1)}
    steps = [
        ProgramSegment(0, segment("motion", 0.0, 2.6), 1.0),
        ProgramSegment(1, segment("sliding", 2.6, 5.0, **held(8.0), **begun), 1.0),
    ]
    _, stroke = task_program(steps, (), down_then_across, paths=Paths(poses))
    assert stroke.path is not None
    assert stroke.path.start.position == pytest.approx((0.0, 0.0, 0.1), abs=0.006)
    assert stroke.t0 == stroke.path.start.t == pytest.approx(3.05)


@pytest.mark.parametrize(("way_m", "becomes"), [(0.003, "hold"), (0.008, "hold"), (0.02, "transport")])
def test_a_carry_that_leads_nowhere_is_a_hold(way_m: float, becomes: str) -> None:
    """A load was held over 3 mm by the person, and carried over 3 mm by the robot."""

    def there_and_back(t: float) -> Moment:
        x = way_m * (1.0 - abs(t - 2.5) / 0.5) if 2.0 < t < 3.0 else 0.0
        return replace(moment_at(0.0), position=(x, 0.0, 0.0))

    here: dict[str, Any] = {"position_start": (0.0, 0.0, 0.0), "position_end": (0.0, 0.0, 0.0)}
    load = {"load_kg": 0.3, "load_sd_kg": 0.01}
    made = program(
        segment("transport", 0.0, 2.0, **load, **ACROSS),
        segment("transport", 2.0, 3.0, **load, **here),
        segment("transport", 3.0, 5.0, **load, **ACROSS),
        grips=(GripperAction(-1.0, "grasp", 0.05),),
        at=lambda t: there_and_back(t) if 2.0 < t < 3.0 else replace(moment_at(t), position=(t, 0.0, 0.0)),
    )
    assert [app.kind for app in made if app.segments] == ["transport", becomes, "transport"]


@pytest.mark.parametrize(
    ("way_m", "goes_on", "made_of"),
    [(0.006, False, [(0, 1)]), (0.02, False, [(0,), (1,)]), (0.006, True, [(0,), (1,), (2,)])],
)
def test_the_last_way_to_a_rest_is_part_of_the_movement_that_it_goes_on_from(
    way_m: float, goes_on: bool, made_of: list[tuple[int, ...]]
) -> None:
    """A hand crept by 4 to 8 mm before it rested: an app that the robot's run did not have."""
    place, crept, there = (0.1, 0.0, 0.2), (0.1 + way_m, 0.0, 0.2), (0.3, 0.0, 0.2)
    rest = segment("steady", 2.6, 4.0, position_start=crept, position_end=crept)
    onward = segment("motion", 2.6, 4.0, position_start=crept, position_end=there)
    made = program(
        segment("motion", 0.0, 2.0, position_start=(0.0, 0.0, 0.2), position_end=place),
        segment("motion", 2.0, 2.6, position_start=place, position_end=crept),
        onward if goes_on else rest,
    )
    assert [app.segments for app in made] == made_of


@pytest.mark.parametrize(("left_m", "aside_m", "moves"), [(0.02, 0.0, 1), (0.03, 0.0, 2), (0.02, 0.05, 2)])
def test_what_does_not_leave_what_was_pressed_in_is_part_of_the_movement(
    left_m: float, aside_m: float, moves: int
) -> None:
    """A movement out of a pump was divided inside of it. The robot's was not."""

    def pumped(t: float) -> Moment:
        z = 0.2 - 0.025 * np.clip(t - 2.0, 0.0, 1.0) + 0.1 * max(t - 3.4, 0.0)
        return replace(drifted(t, pushed_n=9.0 if 2.0 < t < 3.4 else 0.0), position=(0.0, 0.0, float(z)))

    below, divided = (0.0, 0.0, 0.175), (aside_m, 0.0, 0.175 + left_m)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 3.0, **held(9.0), position_start=(0.0, 0.0, 0.2), position_end=below),
        segment("contact", 3.0, 3.4, **held(9.0), position_start=below, position_end=below),
        segment("motion", 3.4, 3.8, position_start=below, position_end=divided),
        segment("motion", 3.8, 5.0, position_start=divided, position_end=(0.1, 0.0, 0.4)),
        at=pumped,
    )
    assert kinds(made)[2:] == ["cartesian_motion"] * moves


def test_a_movement_up_from_the_end_of_a_stroke_has_left_it() -> None:
    """Friction tilts the force of a long stroke: by that, 2 cm up was still below where it was touched."""
    along = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.3, 0.0, 0.2)}
    up, on = (0.3, 0.0, 0.22), (0.3, 0.0, 0.4)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, force_held=(DRIFT_N[0] - 4.0, DRIFT_N[1], DRIFT_N[2] + 9.0), **along),
        segment("motion", 4.0, 4.4, position_start=along["position_end"], position_end=up),
        segment("motion", 4.4, 6.0, position_start=up, position_end=on),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < 4.0 else 0.0),
    )
    assert kinds(made)[-2:] == ["cartesian_motion"] * 2


def turned_at(t: float, stands_s: float) -> float:
    """[rad] 1 rad within a second from 2 s on, a rest, and 1 rad within another second."""
    return min(max(t - 2.0, 0.0), 1.0) + min(max(t - 3.0 - stands_s, 0.0), 1.0)


@pytest.mark.parametrize(
    ("changes", "turns"),
    [
        ({}, [(1, 2)]),
        ({"stands_s": 0.4}, [(1,), (2,)]),
        ({"second_n": 16.0}, [(1,), (2,)]),
        ({"second_turn": (0.0, 1.0, 0.0)}, [(1,), (2,)]),
    ],
)
def test_a_turn_in_contact_that_goes_on_about_its_axis_is_one(
    changes: dict[str, Any], turns: list[tuple[int, ...]]
) -> None:
    """A force that changed divided the turn back of a hand. The robot stopped there."""
    stands_s, second_n = changes.get("stands_s", 0.0), changes.get("second_n", 9.0)

    def at(t: float) -> Moment:
        half = 0.5 * turned_at(t, stands_s)
        pushed_n = 0.0 if t < 2.0 else 9.0 if t < 3.0 + 0.5 * stands_s else second_n
        orientation = (0.0, 0.0, math.sin(half), math.cos(half))
        return replace(drifted(t, pushed_n=pushed_n), position=(0.0, 0.0, 0.2), orientation=orientation)

    here: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    middle, end = 3.0 + 0.5 * stands_s, 4.0 + stands_s
    screw = {"axis": (0.0, 0.0, 1.0), "point": (0.0, 0.0, 0.2), "angle": 1.0, "pitch_sd_m": 0.0}
    tight, loose = (
        ScrewMotion(**screw, pitch_m=m, torque=(0.0, 0.0, nm)) for m, nm in ((0.002, -0.8), (0.001, -0.2))
    )

    def turn(t0: float, tn: float, n: float, about: Vector, screw: ScrewMotion) -> Segment:
        made = segment("sliding", t0, tn, **held(n), **here)
        return made.model_copy(update={"kind": "turning", "turn": about, "screw": screw})

    apps = program(
        segment("motion", 0.0, 2.0, position_start=(0.0, 0.0, 0.4), position_end=(0.0, 0.0, 0.2)),
        turn(2.0, middle, 9.0, (0.0, 0.0, 1.0), tight),
        turn(middle, end, second_n, changes.get("second_turn", (0.0, 0.0, 1.0)), loose),
        at=at,
    )
    assert [app.segments for app in apps[1:]] == turns
    if len(turns) == 1:
        assert apps[1].screw is not None
        assert (apps[1].screw.angle, apps[1].screw.pitch_m) == pytest.approx((2.0, 0.0015))
        assert apps[1].screw.torque == pytest.approx((0.0, 0.0, 0.8)), "as tight as the harder of the two"


def test_holds_that_follow_each_other_are_one() -> None:
    """The robot stood for 0.3 s before and after 6 mm that the person had moved in one hold."""
    load = {"load_kg": 0.3, "load_sd_kg": 0.01}
    here: dict[str, Any] = {"position_start": (0.0, 0.0, 0.0), "position_end": (0.0, 0.0, 0.0)}
    made = program(
        segment("transport", 0.0, 2.0, **load, **ACROSS),
        segment("hold", 2.0, 2.4, **load, **here),
        segment("transport", 2.4, 3.0, **load, **here),
        segment("hold", 3.0, 3.4, **load, **here),
        segment("transport", 3.4, 5.0, **load, **ACROSS),
        grips=(GripperAction(-1.0, "grasp", 0.05),),
        at=lambda t: replace(moment_at(t), position=(0.0 if 2.0 < t < 3.4 else t, 0.0, 0.0)),
    )
    carried = [(app.kind, app.t0, app.tn, app.segments) for app in made if app.segments]
    assert carried == [
        ("transport", 0.0, 2.0, (0,)),
        ("hold", 2.0, 3.4, (1, 2, 3)),
        ("transport", 3.4, 5.0, (4,)),
    ]


@pytest.mark.parametrize(("turned_rad", "becomes"), [(0.01, []), (0.5, ["cartesian_motion"])])
def test_a_turn_in_the_air_by_next_to_nothing_is_a_rest(turned_rad: float, becomes: list[str]) -> None:
    """Beside a turn of 127 degrees stood a movement of 1.5 mm and 0.4 degrees."""

    def turning(t: float) -> Moment:
        half = 0.5 * turned_rad * min(max(t - 2.0, 0.0), 1.0)
        return replace(moment_at(0.0), orientation=(0.0, 0.0, math.sin(half), math.cos(half)))

    turn = segment("motion", 2.0, 3.0, position_start=(0.0, 0.0, 0.2), position_end=(0.0, 0.0, 0.2))
    turn = turn.model_copy(update={"kind": "turning", "turn": (0.0, 0.0, turned_rad)})
    made = program(segment("motion", 0.0, 2.0), turn, segment("motion", 3.0, 5.0), at=turning)
    assert kinds(made) == ["cartesian_motion", *becomes, "cartesian_motion"]


@pytest.mark.parametrize(("resists_n", "becomes"), [(7.0, ["apply_force"]), (2.0, ["move_to_contact"])])
def test_a_movement_that_is_pushed_back_all_the_way_to_a_contact_is_part_of_the_press(
    resists_n: float, becomes: list[str]
) -> None:
    """A pump that sank slowly was a movement in the air, and its bottom the only press."""
    down: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.178)}
    bottom: dict[str, Any] = {"position_start": (0.0, 0.0, 0.178), "position_end": (0.0, 0.0, 0.178)}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 2.2),
        segment("motion", 2.2, 2.8, **down),
        segment("contact", 2.8, 5.0, **bottom, **held(12.0)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.2 else resists_n if t < 2.8 else 12.0),
    )
    assert kinds(made)[1:] == [*([] if resists_n > 3.0 else becomes), "apply_force"]
    assert made[-1].segments == ((2, 3) if resists_n > 3.0 else (3,))


@pytest.mark.parametrize("seconds", [0.4, 1.5])
def test_what_is_pushed_in_after_a_stroke_is_a_press_of_its_own(seconds: float) -> None:
    into = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.0, 0.188)}
    until = 4.0 + seconds
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(5.0), **ACROSS),
        segment("sliding", 4.0, until, **held(30.0), **into),
        segment("motion", until, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=0.0 if not 2.0 < t < until else 5.0 if t < 4.0 else 30.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "apply_force", "cartesian_motion"]
    assert made[2].force_taught == pytest.approx((0.0, 0.0, -30.0))


def test_a_rest_that_presses_to_another_side_than_the_stroke_before_it_is_a_press_of_its_own() -> None:
    x, y, z = DRIFT_N
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(10.0), **ACROSS),
        segment("contact", 4.0, 6.0, force_held=(x - 10.0, y, z)),
        segment("motion", 6.0, 7.0, **OFF),
        at=lambda t: replace(
            drifted(t, pushed_n=10.0 if 2.0 < t < 4.0 else 0.0),
            **({"force": (x - 10.0, y, z)} if 4.0 < t < 6.0 else {}),
        ),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "apply_force", "cartesian_motion"]
    assert made[2].force_taught == pytest.approx((10.0, 0.0, 0.0))


@pytest.mark.parametrize(("lifted_m", "strokes"), [(0.015, [(1,), (3,)]), (0.002, [(1, 3)])])
def test_a_press_that_was_left_before_a_stroke_is_no_part_of_it(
    lifted_m: float, strokes: list[tuple[int, ...]]
) -> None:
    here, there = (0.0, 0.0, 0.2), (lifted_m, 0.0, 0.2)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(9.0), position_start=here, position_end=here),
        segment("motion", 4.0, 4.2, position_start=here, position_end=there),
        segment("sliding", 4.2, 6.0, **held(9.0), position_start=there, position_end=(0.12, 0.0, 0.2)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 9.0),
    )
    assert [app.segments for app in made[1:]] == strokes


def test_a_rest_in_which_the_fingers_move_is_no_end_of_a_stroke() -> None:
    made = program(
        segment("transport", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 5.0, **held(9.0)),
        grips=(GripperAction(-1.0, "grasp", 0.03), GripperAction(4.5, "release", 0.08)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 9.0),
    )
    assert kinds(made)[-2:] == ["apply_force", "gripper_move"]
    assert made[-1].segments == (2,)


def test_three_observations_are_long_enough_whatever_their_times_are_rounded_to() -> None:
    """A contact from 2.95 to 3.25 s was too short for 0.3 s, and one from 2.45 to 2.75 s was not."""
    for t in (2.45, 2.95):
        made = program(
            segment("motion", 0.0, t),
            segment("contact", t, t + 0.3, **held(9.0)),
            segment("motion", t + 0.3, 6.0),
            at=drifted,
        )
        assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]


def test_a_way_down_that_ends_in_a_press_is_one_move_to_contact() -> None:
    down = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.2), "force_held": (0.0, 0.0, 9.0)}
    made = program(segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **down))
    assert kinds(made) == ["cartesian_motion", "move_to_contact", "apply_force"]
    tilted = ACROSS | {"force_held": (-6.0, 0.0, 8.0)}
    stroke = program(segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **tilted))
    assert kinds(stroke) == ["move_to_contact", "apply_force"]


def test_a_rest_with_something_between_the_fingers_is_a_hold_whatever_it_weighs() -> None:
    carry = segment("motion", 1.0, 2.0), segment("steady", 2.0, 3.5), segment("motion", 3.5, 4.2)
    assert kinds(program(*carry, grips=(GRASP,)))[1:] == ["transport", "hold", "transport"]


@pytest.mark.parametrize(
    ("seconds", "becomes"), [(0.2, ["transport"] * 2), (0.6, ["transport", "hold", "transport"])]
)
def test_a_load_that_rests_is_held_there(seconds: float, becomes: list[str]) -> None:
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    rest, onward = 2.0 + seconds, 4.0 + seconds
    carry = segment("transport", 0.0, 2.0, **load), segment("hold", 2.0, rest, **load)
    assert kinds(program(*carry, segment("transport", rest, onward, **load))) == becomes


@pytest.mark.parametrize(
    ("lifted_m", "seconds", "becomes"),
    [
        (0.002, 0.6, ["transport"]),
        (0.02, 0.6, ["hold", "transport"]),
        (0.002, 5.0, ["hold", "transport"]),
    ],
)
def test_a_load_that_stands_where_it_was_gripped_is_not_held_yet(
    lifted_m: float, seconds: float, becomes: list[str]
) -> None:
    here, above = (0.0, 0.0, 0.2), (0.0, 0.0, 0.2 + lifted_m)
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(10.0), position_start=here, position_end=here),
        segment("hold", 4.0, 4.0 + seconds, **load, position_start=above, position_end=above),
        segment("transport", 4.0 + seconds, 6.0 + seconds, **load),
        grips=(replace(GRASP, t=3.0),),
    )
    assert kinds(made) == ["move_to_contact", "grasp", *becomes]


def test_the_rests_around_a_turn_in_contact_are_part_of_it() -> None:
    turn = segment("sliding", 3.0, 5.0, **held(9.0)).model_copy(update={"kind": "turning"})
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(9.0)),
        turn,
        segment("contact", 5.0, 5.7, **held(9.0)),
        segment("motion", 5.7, 7.0, **ACROSS),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < 5.7 else 0.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]
    assert (made[1].t0, made[1].tn, made[1].segments) == (2.0, 5.7, (1, 2, 3))


@pytest.mark.parametrize(("seconds", "forces"), [(0.4, [16.0]), (0.7, [16.0, 7.5])])
def test_a_press_between_a_touch_and_a_stroke_is_its_beginning(seconds: float, forces: list[float]) -> None:
    """Where it is short its force still rises."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.0 + seconds, **held(7.5)),
        segment("sliding", 2.0 + seconds, 4.0, **held(16.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 7.5 if t < 2.0 + seconds else 16.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force"]
    assert forces_of(made[-1]) == pytest.approx(forces)


DOWN: dict[str, Any] = {"position_start": (0.0, 0.0, 0.4), "position_end": (0.0, 0.0, 0.21)}


@pytest.mark.parametrize(
    ("begins", "length_m", "segments"),
    [
        (2.0, 0.01, [(0, 1), (2,)]),
        (2.2, 0.01, [(0, 1), (2,)]),
        (2.4, 0.01, [(0,), (1,), (2,)]),
        (2.0, 0.03, [(0,), (1,), (2,)]),
    ],
)
def test_the_last_centimetre_before_a_contact_is_part_of_the_movement(
    begins: float, length_m: float, segments: list[tuple[int, ...]]
) -> None:
    """A robot slows down there, and what was one movement of a hand was two of its own."""
    last = {"position_start": (0.0, 0.0, 0.21), "position_end": (0.0, 0.0, 0.21 - length_m)}
    made = program(
        segment("motion", 0.0, 2.0, **DOWN),
        segment("motion", begins, 3.0, **last),
        segment("contact", 3.0, 4.0, **held(9.0)),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 3.0 else 9.0),
    )
    assert [app.segments for app in made] == segments
    assert kinds(made)[-2:] == ["move_to_contact", "apply_force"]
    assert made[0].t0 == 0.0


def test_a_last_centimetre_before_which_the_fingers_move_is_a_movement_of_its_own() -> None:
    last = {"position_start": (0.0, 0.0, 0.21), "position_end": (0.0, 0.0, 0.2)}
    made = program(
        segment("motion", 0.0, 2.0, **DOWN),
        segment("motion", 2.0, 3.0, **last),
        segment("contact", 3.0, 4.0, **held(9.0)),
        grips=(GripperAction(2.1, "open", 0.08),),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 3.0 else 9.0),
    )
    assert [app.segments for app in made if app.segments] == [(0,), (1,), (2,)]


def test_a_press_that_follows_a_rest_was_touched_by_the_movement_before_it() -> None:
    """The program pressed without a contact, so its own check refused it."""
    made = program(
        segment("motion", 0.0, 2.0), segment("steady", 2.0, 2.6), segment("contact", 2.6, 4.0, **held(9.0))
    )
    assert kinds(made) == ["move_to_contact", "apply_force"]


def test_a_press_after_a_rest_in_which_the_fingers_move_was_touched_after_they_moved() -> None:
    """No app made its contact, so the program's own check refused the press."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 4.0),
        segment("contact", 4.0, 6.0, **held(9.0)),
        grips=(GripperAction(2.8, "open", 0.08),),
        at=lambda t: drifted(t, pushed_n=9.0 if t > 4.0 else 0.0),
    )
    assert kinds(made) == ["cartesian_motion", "gripper_move", "move_to_contact", "apply_force"]
    assert made[2].target == pytest.approx((0.0, 0.0, 0.405))
    assert made[1].tn < made[2].t0 < made[2].tn <= made[3].t0
    assert not [one for one in order_findings(made) if one.kind == "apply_force"]


def test_the_path_to_a_contact_ends_before_the_rest_that_follows() -> None:
    """The rest was a pause after the contact, and its three seconds were in the path of 2 s too."""

    def poses(t0: float, tn: float) -> Any:
        t = np.linspace(t0, tn, 60)
        return t, np.column_stack([0.0 * t, 0.0 * t, 0.1 * np.minimum(t, 2.0)])

    parts = (
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 5.0),
        segment("contact", 5.0, 7.0, **held(9.0)),
    )
    steps = [ProgramSegment(i, one, 1.0) for i, one in enumerate(parts)]
    touching, pressing = task_program(steps, (), moment_at, paths=Paths(poses))
    assert touching.path is not None
    assert (touching.path.tn, touching.tn, pressing.t0) == (2.0, 2.0, 5.0)


@pytest.mark.parametrize(("released_s", "becomes"), [(3.0, "cartesian_motion"), (4.9, "move_to_contact")])
def test_fingers_that_open_in_a_rest_open_before_what_is_pressed_after_it(
    released_s: float, becomes: str
) -> None:
    """The movement went to where the press began 2 s later, and the fingers opened there."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 5.0),
        segment("contact", 5.0, 7.0, **held(9.0)),
        grips=(replace(RELEASE, t=released_s),),
    )
    assert made[0].kind == becomes
    assert "gripper_move" in kinds(made)
    if becomes == "cartesian_motion":
        assert kinds(made)[1:] == ["gripper_move", "move_to_contact", "apply_force"]
        assert made[0].target == pytest.approx(moment_at(2.0).position)


def test_what_is_gripped_while_it_is_touched_before_a_turn_was_touched_by_the_movement_before_it() -> None:
    turn = segment("sliding", 2.4, 4.0, **held(9.0)).model_copy(update={"kind": "turning"})
    touched = segment("contact", 2.0, 2.4, **held(9.0))
    made = program(segment("motion", 0.0, 2.0), touched, turn, grips=(replace(GRASP, t=2.05),))
    assert kinds(made) == ["move_to_contact", "grasp", "apply_force"]


def test_a_turn_in_the_second_of_two_rests_before_a_press_comes_before_the_contact() -> None:
    """Between the rests lies a movement that is too short for an app."""

    def poses(t0: float, tn: float) -> Any:
        t = np.linspace(t0, tn, 60)
        half = 0.5 * np.clip((t - 3.0) / 0.5, 0.0, 1.0)
        zero = np.zeros_like(t)
        return t, np.column_stack([zero, zero, zero + 0.2, zero, zero, np.sin(half), np.cos(half)])

    made = task_program(
        [
            ProgramSegment(i, one, 1.0)
            for i, one in enumerate(
                (
                    segment("motion", 0.0, 2.0),
                    segment("steady", 2.0, 2.6),
                    segment("motion", 2.6, 2.8),
                    segment("steady", 2.8, 4.0),
                    segment("contact", 4.0, 5.0, **held(9.0)),
                )
            )
        ],
        (),
        moment_at,
        paths=Paths(poses),
    )
    assert kinds(made) == ["cartesian_motion", "cartesian_motion", "apply_force"]


def test_a_contact_lasts_through_the_noise_of_its_force() -> None:
    """5 N with 2 N of noise: a single observation below 3 N ended the contact."""

    def at(t: float) -> Moment:
        noise = 2.0 if round(t / 0.1) % 2 else -2.5
        return drifted(t, pushed_n=0.0 if t < 2.0 else 5.0 + (noise if 3.0 < t < 5.0 else 0.0))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(5.0)),
        segment("motion", 3.0, 5.0, **ACROSS),
        segment("contact", 5.0, 6.0, **held(5.0)),
        at=at,
    )
    assert kinds(made) == ["move_to_contact", "apply_force"]
    assert made[1].segments == (1, 2, 3)


def test_a_rest_under_a_load_is_a_hold_where_the_fingers_hold_something() -> None:
    rest = segment("contact", 2.0, 3.5, force_held=(-0.2, 0.1, -4.6))
    carry = segment("transport", 1.0, 2.0, load_kg=0.5, load_sd_kg=0.05)
    assert kinds(program(carry, rest, grips=(GRASP,)))[1:] == ["transport", "hold"]
    assert kinds(program(carry, rest)) == ["transport", "apply_force"]


@pytest.mark.parametrize(
    ("before", "named"),
    [("motion", "sliding"), ("motion", "contact"), ("contact", "transport"), ("transport", "motion")],
)
def test_what_an_operator_has_named_is_what_it_is(before: str, named: str) -> None:
    said = segment(named, 2.0, 4.0, **held(-4.0), **ACROSS, corrected=True)
    made = program(
        segment(before, 1.0, 2.0), said, grips=(GRASP, GripperAction(1.5, "release", 0.08)), at=drifted
    )
    expected = {"sliding": "apply_force", "contact": "apply_force", "motion": "cartesian_motion"}
    assert made[-1].kind == expected.get(named, named)
