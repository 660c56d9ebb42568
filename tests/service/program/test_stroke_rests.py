"""Which rests belong to a stroke, and how hard both are pressed."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from caesura_service.program import GripperAction, Moment
from service.program.segments import (
    ACROSS,
    DRIFT_N,
    OFF,
    drifted,
    forces_of,
    held,
    kinds,
    moment_at,
    program,
    segment,
)

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


@pytest.mark.parametrize(("begins_s", "ends_s"), [(0.1, 0.2), (0.2, 0.1)])
def test_a_rest_beside_a_stroke_is_part_of_it_though_it_is_shorter_than_a_segment(
    begins_s: float, ends_s: float
) -> None:
    """It was left out: a robot let go of the surface that much too early, and before the end of the way."""
    begin, end = 2.2 - begins_s, 4.0 + ends_s
    crept = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.103, 0.0, 0.2)}
    made = program(
        segment("motion", 0.0, begin),
        segment("contact", begin, 2.2, **held(9.0)),
        segment("sliding", 2.2, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, end, **held(7.0), **crept, probability=0.4),
        segment("motion", end, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=0.0 if not begin < t < end else 9.0 if t < 4.0 else 7.0),
    )
    assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]
    assert (made[1].t0, made[1].tn, made[1].target) == (begin, end, (0.103, 0.0, 0.2))
    assert made[1].confidence == 0.9
    assert forces_of(made[1]) == pytest.approx([9.0])


@pytest.mark.parametrize(("seconds", "is_path"), [(0.4, True), (0.6, False)])
def test_a_rest_after_a_stroke_is_the_end_of_its_path_unless_it_has_a_force_of_its_own(
    seconds: float, is_path: bool
) -> None:
    until = 4.0 + seconds
    crept = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.103, 0.0, 0.2)}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, until, **held(9.0), **crept),
        segment("motion", until, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < until else 0.0),
    )
    assert made[1].tn == until
    assert made[1].target == ((0.103, 0.0, 0.2) if is_path else (0.1, 0.0, 0.2))


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


@pytest.mark.parametrize(
    ("touched_s", "parts"),
    [
        pytest.param(2.1, [(0,), (1, 2, 3)], id="8 mm from the touch on"),
        pytest.param(1.9, [(0,), (1, 2), (3,)], id="12 mm in contact"),
    ],
)
def test_the_way_to_a_touch_is_no_part_of_a_slide_that_only_pushes_in(
    touched_s: float, parts: list[tuple[int, ...]]
) -> None:
    """A hand skids 12 mm, and touches on the last 8 mm. A robot skids from the touch on.

    So the rest after it was a press of its own in the program, and none in the program of its run.
    """
    skid = {"position_start": (0.0, 0.0, 0.212), "position_end": (0.007, 0.0, 0.202)}
    still = {"position_start": (0.007, 0.0, 0.202), "position_end": (0.007, 0.0, 0.202)}

    def at(t: float) -> Moment:
        way = min(max((t - 2.0) / 0.5, 0.0), 1.0)
        place = (0.007 * way, 0.0, 0.212 - 0.01 * way)
        return replace(
            drifted(t, pushed_n=0.0 if t < touched_s else 7.0 if t < 3.5 else 14.0), position=place
        )

    made = program(
        segment("motion", 0.0, 2.0, position_end=(0.0, 0.0, 0.212)),
        segment("sliding", 2.0, 2.5, **held(7.0), **skid),
        segment("contact", 2.5, 3.5, **held(7.0), **still),
        segment("sliding", 3.5, 5.0, **held(14.0), **ACROSS),
        at=at,
    )
    assert [app.segments for app in made] == parts


@pytest.mark.parametrize(
    ("until", "way_m", "parts"),
    [
        pytest.param(2.5, 0.012, [(0,), (1, 2, 3)], id="a landing"),
        pytest.param(2.5, 0.018, [(0,), (1, 2, 3)], id="a landing with a longer skid"),
        pytest.param(2.5, 0.03, [(0,), (1, 2), (3,)], id="a stroke"),
        pytest.param(2.8, 0.012, [(0,), (1, 2), (3,)], id="it lasts"),
    ],
)
def test_a_skid_at_the_end_of_a_landing_is_part_of_the_rest_in_which_it_ends(
    until: float, way_m: float, parts: list[tuple[int, ...]]
) -> None:
    """A hand skids 12 mm with 6 N, comes to rest and presses with 11 N. Its robot skids 9 mm.

    The program pressed with 11 N as an app of its own, and that of its run in a rest of the stroke.
    """
    skid = {"position_start": (0.0, 0.0, 0.21), "position_end": (way_m, 0.0, 0.2)}
    still = {"position_start": (way_m, 0.0, 0.2), "position_end": (way_m, 0.0, 0.2)}

    def at(t: float) -> Moment:
        push_n = 0.0 if t < 2.1 else 6.0 if t < until else 11.0 if t < 3.8 else 16.0
        way = min(max((t - 2.05) / (until - 2.05), 0.0), 1.0)
        return replace(drifted(t, pushed_n=push_n), position=(way_m * way, 0.0, 0.202 - 0.002 * way))

    made = program(
        segment("motion", 0.0, 2.0, position_end=(0.0, 0.0, 0.21)),
        segment("sliding", 2.0, until, **held(6.0), **skid),
        segment("contact", until, 3.8, **held(11.0), **still),
        segment("sliding", 3.8, 5.0, **held(16.0), **ACROSS),
        at=at,
    )
    assert [app.segments for app in made] == parts


@pytest.mark.parametrize(
    ("landed_m_per_s", "parts"),
    [
        pytest.param(0.06, [(0,), (1, 2, 3)], id="it brakes"),
        pytest.param(0.01, [(0,), (1, 2), (3,)], id="it speeds up"),
    ],
)
def test_a_hand_that_only_brakes_as_it_lands_skids_however_long_that_takes(
    landed_m_per_s: float, parts: list[tuple[int, ...]]
) -> None:
    """A hand that came down at 60 mm/s skidded 14 mm in 0.7 s: that was a press of its own in the program."""
    skid = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.014, 0.0, 0.2)}
    still = {"position_start": (0.014, 0.0, 0.2), "position_end": (0.014, 0.0, 0.2)}

    def at(t: float) -> Moment:
        push_n = 0.0 if t < 2.0 else 6.0 if t < 2.7 else 11.0 if t < 3.8 else 16.0
        slid_m = 0.02 * min(max(t - 2.0, 0.0), 0.7)
        return replace(
            drifted(t, pushed_n=push_n), position=(slid_m, 0.0, 0.2 + landed_m_per_s * max(2.0 - t, 0.0))
        )

    made = program(
        segment("motion", 0.0, 2.0, position_end=(0.0, 0.0, 0.2)),
        segment("sliding", 2.0, 2.7, **held(6.0), **skid),
        segment("contact", 2.7, 3.8, **held(11.0), **still),
        segment("sliding", 3.8, 5.0, **held(16.0), **ACROSS),
        at=at,
    )
    assert [app.segments for app in made] == parts


def test_a_skid_that_leads_into_a_stroke_without_a_rest_keeps_its_way() -> None:
    """It was a rest of the stroke, and 18 mm of its way were lost."""
    skid = {"position_start": (0.0, 0.0, 0.21), "position_end": (0.018, 0.0, 0.2)}

    def at(t: float) -> Moment:
        way = min(max((t - 2.05) / 0.45, 0.0), 1.0)
        push_n = 0.0 if t < 2.1 else 6.0 if t < 2.5 else 16.0
        return replace(drifted(t, pushed_n=push_n), position=(0.018 * way, 0.0, 0.202 - 0.002 * way))

    made = program(
        segment("motion", 0.0, 2.0, position_end=(0.0, 0.0, 0.21)),
        segment("sliding", 2.0, 2.5, **held(6.0), **skid),
        segment("sliding", 2.5, 4.0, **held(16.0), **ACROSS),
        at=at,
    )
    assert [app.segments for app in made] == [(0,), (1,), (2,)]


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


def test_a_rest_that_is_hardly_pressed_has_the_least_force_that_a_robot_holds() -> None:
    """A peg touched its hole, hovered over it and slid on: 0.26 N, and the check refused the program."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(10.0)),
        segment("sliding", 4.0, 6.0, **held(10.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 0.3 if t < 4.0 else 10.0),
    )
    (rest,) = (app.rest_before for app in made if app.rest_before is not None)
    assert (rest.newton, rest.newton_taught) == (1.0, pytest.approx(0.3))


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


def test_an_impact_at_the_touch_is_not_the_force_of_a_short_stroke():
    """Of seven observations the first one has twice the force of the others."""
    felt = dict(enumerate((13.5, 6.1, 6.1, 8.3, 7.2, 6.1, 4.5), start=20))

    def at(t: float) -> Moment:
        return drifted(t, pushed_n=felt.get(round(10 * t), 0.0))

    apps = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 1.95, 2.65, **held(10.9), **ACROSS),
        segment("motion", 2.65, 4.0, **OFF),
        at=at,
    )
    assert kinds(apps)[:2] == ["move_to_contact", "apply_force"]
    assert forces_of(apps[1]) == pytest.approx([6.65])
