"""What is carried, held or set down."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_service.constants import GRAVITY
from caesura_service.program import GripperAction, Moment
from service.program.segments import (
    ACROSS,
    GRASP,
    RELEASE,
    carried,
    drifted,
    held,
    kinds,
    moment_at,
    program,
    segment,
    stopping_at,
)


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
    made = program(before, carry, after, grips=(GRASP, RELEASE), at=stopping_at)
    apps = [app for app in made if app.segments]
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


def test_a_load_that_weighs_something_else_is_set_down() -> None:
    """A peg that rests on a table with 3 N had 1 N more than nothing, and was said to be carried."""
    assert kinds(carried(1.5)) == ["grasp", "transport", "apply_force", "transport"]
    assert carried(1.5)[2].segments == (1, 2, 3)
    assert kinds(carried(-1.0)) == ["grasp", "transport", "hold", "transport", "hold", "transport"]


@pytest.mark.parametrize(
    ("force", "becomes"),
    [((0.0, 0.0, -5.0), "transport"), ((2.0, 0.0, -5.0), "transport"), ((4.0, 0.0, -4.0), "apply_force")],
)
def test_what_weighs_more_has_been_lifted(force: tuple[float, float, float], becomes: str) -> None:
    """What stood on a table weighed nothing; lifted, it pulled at what it touched, and no robot ran that."""
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}

    def lifted(t: float) -> Moment:
        return replace(moment_at(t), force=force if t > 2.0 else (0.0, 0.0, 0.0))

    made = program(
        segment("hold", 0.0, 2.0, load_kg=0.0, load_sd_kg=0.05),
        segment("transport", 2.0, 4.0, **load),
        grips=(GripperAction(-1.0, "grasp", 0.03),),
        at=lifted,
    )
    assert kinds(made)[-1] == becomes


@pytest.mark.parametrize(
    ("grips", "becomes"), [((GripperAction(-1.0, "grasp", 0.03),), "transport"), ((), "cartesian_motion")]
)
def test_what_the_fingers_hold_and_weighs_more_has_been_lifted_after_a_touch_of_one_observation(
    grips: tuple[GripperAction, ...], becomes: str
) -> None:
    """It pulled at what it touched in that observation, for as long as it was carried: no robot ran that.

    Where nothing is known of the fingers, the robot only moves against that force.
    """
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}

    def lifted(t: float) -> Moment:
        return replace(moment_at(t), force=(0.1, -0.9, -4.0) if t > 2.0 else (0.0, 0.0, 0.0))

    made = program(
        segment("hold", 0.0, 2.0, load_kg=0.2, load_sd_kg=0.05),
        segment("contact", 2.0, 2.1, force_held=(0.1, -1.9, -2.9)),
        segment("transport", 2.1, 4.0, **load),
        grips=grips,
        at=lifted,
    )
    assert kinds(made)[-1] == becomes


def test_a_carry_that_begins_at_the_last_observation_has_a_load() -> None:
    """It has no duration yet: the program of a session could not be made (division by zero)."""
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    ends = dict.fromkeys(("position_start", "position_end"), (0.0, 0.0, 0.2))
    made = program(
        segment("motion", 0.0, 2.0),
        segment("transport", 2.0, 2.0, **load, **ends),
        grips=(GripperAction(1.0, "grasp", 0.03),),
    )
    assert kinds(made) == ["cartesian_motion", "grasp", "transport"]


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
    ("lifted_m", "seconds", "held_kg", "becomes"),
    [
        (0.002, 0.6, 0.4, ["transport"]),
        (0.02, 0.6, 0.4, ["hold", "transport"]),
        (0.02, 0.6, 0.15, ["transport"]),
        (0.002, 5.0, 0.4, ["hold", "transport"]),
    ],
)
def test_a_load_that_stands_where_it_was_gripped_is_not_held_yet(
    lifted_m: float, seconds: float, held_kg: float, becomes: list[str]
) -> None:
    """A hand dragged it by 5.4 mm while it took its weight over, which was a hold of a fifth of the load."""
    here, above = (0.0, 0.0, 0.2), (0.0, 0.0, 0.2 + lifted_m)
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(10.0), position_start=here, position_end=here),
        segment(
            "hold",
            4.0,
            4.0 + seconds,
            load_kg=held_kg,
            load_sd_kg=0.05,
            position_start=above,
            position_end=above,
        ),
        segment("transport", 4.0 + seconds, 6.0 + seconds, **load),
        grips=(replace(GRASP, t=3.0),),
    )
    assert kinds(made) == ["move_to_contact", "grasp", *becomes]


def test_a_rest_under_a_load_is_a_hold_where_the_fingers_hold_something() -> None:
    here = (0.0, 0.0, 0.2)
    rest = segment("contact", 2.0, 3.5, force_held=(-0.2, 0.1, -4.6), position_start=here, position_end=here)
    carry = segment("transport", 1.0, 2.0, load_kg=0.5, load_sd_kg=0.05)
    assert kinds(program(carry, rest, grips=(GRASP,)))[1:] == ["transport", "hold"]
    assert kinds(program(carry, rest)) == ["transport", "apply_force"]


@pytest.mark.parametrize(("way_m", "becomes"), [(0.006, "hold"), (0.02, "transport")])
def test_what_is_carried_to_a_contact_in_the_end_is_no_hold(way_m: float, becomes: str) -> None:
    """A peg bounced, stood for 0.4 s, and was carried on by 13 mm: a hold had that way as its path."""
    still = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    load = {"load_kg": 0.4, "load_sd_kg": 0.02}

    def at(t: float) -> Moment:
        pushed_n = 9.0 if t > 4.5 else 0.0
        place = (0.0, 0.0, 0.4 - 0.1 * t) if t < 2.0 else (way_m * float(t > 4.5), 0.0, 0.2)
        return replace(moment_at(t), position=place, force=(0.0, 0.0, pushed_n - 4.0))

    made = program(
        segment("transport", 0.0, 2.0, **load, position_start=(0.0, 0.0, 0.4), position_end=(0.0, 0.0, 0.2)),
        segment("hold", 2.0, 4.0, **load, **still),
        segment("sliding", 4.0, 6.0, force_held=(0.0, 0.0, 5.0), position_start=(0.0, 0.0, 0.2),
                position_end=(0.1, 0.0, 0.2)),
        grips=(replace(GRASP, t=-1.0),),
        at=at,
    )  # fmt: skip
    assert kinds(made) == ["grasp", "transport", becomes, "apply_force"]


@pytest.mark.parametrize(
    ("rested_s", "becomes"),
    [
        (0.5, [("grasp", 2.8, 2.8), ("transport", 3.3, 5.3)]),
        (2.0, [("grasp", 2.8, 2.8), ("hold", 2.8, 4.8), ("transport", 4.8, 6.8)]),
    ],
)
def test_what_is_grasped_in_a_rest_is_held_from_the_grasp_on(
    rested_s: float, becomes: list[tuple[str, float, float]]
) -> None:
    """The hold began with the rest: it came before its grasp, and no robot ran that."""
    lifted = 2.8 + rested_s
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, lifted, position_start=(0.0, 0.0, 0.2), position_end=(0.0, 0.0, 0.2)),
        segment("transport", lifted, lifted + 2.0, load_kg=0.8, load_sd_kg=0.05),
        grips=(replace(GRASP, t=2.8),),
        at=lambda t: replace(moment_at(t), position=(0.0, 0.0, 0.2)) if 2.0 < t < lifted else moment_at(t),
    )
    assert [(app.kind, app.t0, app.tn) for app in made[1:]] == becomes


def test_a_hold_ends_where_the_fingers_let_go() -> None:
    load = {"load_kg": 0.8, "load_sd_kg": 0.05}
    made = program(
        segment("transport", 0.0, 2.0, **load),
        segment("hold", 2.0, 5.0, **load),
        grips=(replace(GRASP, t=-1.0), replace(RELEASE, t=4.0)),
    )
    whole = [(app.kind, app.t0, app.tn) for app in made if app.t0 >= 0.0]
    assert whole == [("transport", 0.0, 2.0), ("hold", 2.0, 4.0), ("gripper_move", 4.0, 4.0)]


@pytest.mark.parametrize(
    ("grips", "becomes"),
    [
        ((replace(GRASP, t=1.0),), ["cartesian_motion", "grasp", "transport"]),
        (
            (replace(GRASP, t=-1.0), replace(RELEASE, t=1.0)),
            ["transport", "gripper_move", "cartesian_motion"],
        ),
        ((GripperAction(1.0, "open", 0.08),), ["cartesian_motion", "gripper_move", "cartesian_motion"]),
    ],
)
def test_the_fingers_act_on_a_way_where_they_were_taught_to(
    grips: tuple[GripperAction, ...], becomes: list[str]
) -> None:
    """What was let go on the way was carried to its end, as the release followed the whole movement."""
    made = [app for app in program(segment("motion", 0.0, 3.0), grips=grips) if app.t0 >= 0.0]
    assert kinds(tuple(made)) == becomes
    assert [(app.t0, app.tn) for app in made] == [(0.0, 1.0), (1.0, 1.0), (1.0, 3.0)]
    assert [app.target for app in made] == [moment_at(t).position for t in (1.0, 1.0, 3.0)]


def test_a_grip_that_tightens_divides_the_hold() -> None:
    """A robot tightened its grip after the whole hold, and then held for the rest of it again."""
    still = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    made = program(
        segment("transport", 0.6, 2.0, load_kg=0.5, load_sd_kg=0.02),
        segment("hold", 2.0, 5.0, load_kg=0.5, load_sd_kg=0.02, **still),
        grips=(GRASP, GripperAction(3.0, "grasp", 0.04)),
        at=stopping_at,
    )
    assert [(app.kind, app.t0, app.tn) for app in made[2:]] == [
        ("hold", 2.0, 3.0),
        ("grasp", 3.0, 3.0),
        ("hold", 3.0, 5.0),
    ]


@pytest.mark.parametrize(("opened", "acts"), [(4.1, 4.0), (4.29, 4.0), (4.35, 4.35)])
def test_fingers_that_open_as_a_movement_begins_act_before_it(opened: float, acts: float) -> None:
    """An object was set down and let go at once: the robot moved off with it, and let go at the end."""
    load = {"load_kg": 0.8, "load_sd_kg": 0.02}
    weight, there = (0.0, 0.0, -8.0), (0.0, 0.0, 0.3)
    apps = program(
        segment("transport", 1.0, 3.0, **load),
        segment("contact", 3.0, 4.0, force_held=weight, position_start=there, position_end=there),
        segment("motion", 4.0, 6.0, position_start=there),
        grips=(GRASP, replace(RELEASE, t=opened)),
        at=lambda t: replace(moment_at(t), force=weight if t < 4.0 else (0.0, 0.0, 0.0)),
    )
    (release,) = [app for app in apps if app.kind == "gripper_move"]
    assert (release.t0, release.tn) == (acts, acts)
    assert apps[apps.index(release) + 1].kind == "cartesian_motion"


def test_fingers_that_open_at_the_end_of_a_short_hold_act_after_it() -> None:
    """The robot let go of the object first, and then held it for a third of a second."""
    still = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.3)}
    made = program(
        segment("transport", 1.0, 3.0, load_kg=0.4, load_sd_kg=0.02),
        segment("contact", 3.0, 3.33, force_held=(0.0, 0.0, -4.0), **still),
        segment("motion", 4.0, 6.0),
        grips=(GRASP, replace(RELEASE, t=3.28)),
        at=stopping_at,
    )
    assert [(app.kind, app.t0) for app in made[2:]] == [
        ("hold", 3.0),
        ("gripper_move", 3.28),
        ("cartesian_motion", 4.0),
    ]


def test_fingers_that_act_at_a_contact_divide_no_movement() -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(10.0)),
        segment("transport", 4.0, 6.0, load_kg=0.8, load_sd_kg=0.05),
        grips=(replace(GRASP, t=4.2),),
    )
    assert [(app.kind, app.t0, app.tn) for app in made[1:]] == [("grasp", 2.0, 4.0), ("transport", 4.0, 6.0)]


@pytest.mark.parametrize(
    ("kg", "seconds", "loads"),
    [(0.3, 2.0, [1.0, 0.3]), (0.9, 2.0, [0.95, 0.95]), (0.3, 0.8, [1.0, 1.0])],
)
def test_a_load_that_changes_on_the_way_is_that_of_its_part(
    kg: float, seconds: float, loads: list[float]
) -> None:
    """A cup that was emptied was carried with the mean of full and empty, as if that had been measured."""
    made = program(
        segment("transport", 1.0, 3.0, load_kg=1.0, load_sd_kg=0.02, position_end=(0.3, 0.0, 0.3)),
        segment("transport", 3.0, 3.0 + seconds, load_kg=kg, load_sd_kg=0.02),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert [app.load_kg for app in made if app.kind == "transport"] == pytest.approx(loads, abs=0.01)


@pytest.mark.parametrize(
    ("lifted_kg", "becomes"),
    [(0.35, ["hold", "hold", "transport"]), (1.0, ["transport", "apply_force", "transport"])],
)
def test_a_load_that_stays_lighter_as_it_is_moved_off_was_not_set_down(
    lifted_kg: float, becomes: list[str]
) -> None:
    """A cup of 1 kg was emptied: the robot pushed up with 6.4 N, and then carried 0.87 kg."""
    still = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.3)}
    hung = (0.0, 0.0, -9.8)

    def at(t: float) -> Moment:
        kg = 1.0 if t < 4.0 else 0.35 if t < 6.0 else lifted_kg
        return replace(stopping_at(t), force=(0.0, 0.0, -9.81 * kg))

    made = program(
        segment("transport", 0.6, 2.0, load_kg=1.0, load_sd_kg=0.02),
        segment("contact", 2.0, 4.0, force_held=hung, **still),
        segment("hold", 4.0, 6.0, load_kg=0.35, load_sd_kg=0.02, **still),
        segment("transport", 6.0, 8.0, load_kg=lifted_kg, load_sd_kg=0.02, position_end=(0.0, 0.0, 0.4)),
        grips=(GRASP,),
        at=at,
    )
    assert kinds(made[2:]) == becomes
    if becomes[1] == "hold":
        assert [app.load_kg for app in made[1:]] == pytest.approx([1.0, 1.0, 0.35, 0.35], abs=0.01)


def test_a_short_press_with_a_load_has_the_force_beyond_its_weight() -> None:
    """A part of 0.66 kg was tapped on a surface with 9.6 N: the sensor felt 3 N, and the program had 5.4 N.

    The observations of the touch and the release have the whole weight, so they seemed to be the press.
    """
    low, high = (0.0, 0.0, 0.2), (0.0, 0.0, 0.4)
    load = {"load_kg": 0.66, "load_sd_kg": 0.02}
    pushed = {4.1: 2.4, 4.2: 9.6, 4.3: 9.6, 4.4: 2.4}

    def at(t: float) -> Moment:
        z = float(np.interp(t, [1.0, 2.0, 3.0, 4.0, 4.5, 5.5], [0.2, 0.4, 0.4, 0.2, 0.2, 0.4]))
        force = -GRAVITY * 0.66 * (t >= 1.0) + pushed.get(round(t, 1), 0.0)
        return Moment((0.0, 0.0, z), None, None, 0.05, (0.0, 0.0, force))

    made = program(
        segment("steady", 0.0, 1.0, position_start=low, position_end=low),
        segment("transport", 1.0, 3.0, position_start=low, position_end=high, **load),
        segment("transport", 3.0, 4.0, position_start=high, position_end=low, **load),
        segment("contact", 4.0, 4.5, position_start=low, position_end=low, force_held=(0.0, 0.0, -1.1)),
        segment("transport", 4.5, 5.5, position_start=low, position_end=high, **load),
        grips=(GRASP,),
        at=at,
    )
    (press,) = (app for app in made if app.force is not None)
    assert press.force_taught == pytest.approx((0.0, 0.0, -9.6), abs=0.1)


def test_where_no_gripper_is_known_a_load_is_no_press() -> None:
    """A part of 0.8 kg was lifted and set down: the robot pulled with 8 N, and pressed with 8 N then."""
    low, high = (0.0, 0.0, 0.2), (0.0, 0.0, 0.4)
    load, hung = {"load_kg": 0.8, "load_sd_kg": 0.02}, {"force_held": (0.0, 0.0, -7.8)}

    def at(t: float) -> Moment:
        z = float(np.interp(t, [1.5, 2.5, 3.5, 4.5, 6.0, 7.0], [0.2, 0.4, 0.4, 0.2, 0.2, 0.4]))
        return Moment((0.0, 0.0, z), None, None, None, (0.0, 0.0, -7.8 if 1.1 < t < 4.8 else 0.0))

    made = program(
        segment("motion", 0.0, 1.0, position_start=high, position_end=low),
        segment("contact", 1.0, 1.5, position_start=low, position_end=low, **hung),
        segment("sliding", 1.5, 2.5, position_start=low, position_end=high, **hung),
        segment("hold", 2.5, 3.5, position_start=high, position_end=high, **load),
        segment("transport", 3.5, 4.5, position_start=high, position_end=low, **load),
        segment("contact", 4.5, 5.0, position_start=low, position_end=low, **hung),
        segment("steady", 5.0, 6.0, position_start=low, position_end=low),
        segment("motion", 6.0, 7.0, position_start=low, position_end=high),
        at=at,
    )
    assert [(app.kind, app.t0) for app in made] == [
        ("cartesian_motion", 0.0),
        ("hold", 1.0),
        ("transport", 1.5),
        ("hold", 2.5),
        ("transport", 3.5),
        ("hold", 4.5),
        ("cartesian_motion", 6.0),
    ]
    assert all(app.force_taught is None for app in made)


def test_where_no_gripper_is_known_a_light_load_that_is_held_up_is_no_pull() -> None:
    """0.4 kg were moved on as free movements, and the robot pulled with 4 N in the rest between them."""
    low, high = (0.0, 0.0, 0.2), (0.0, 0.0, 0.4)

    def at(t: float) -> Moment:
        z = float(np.interp(t, [1.3, 2.3, 3.3, 4.3], [0.2, 0.4, 0.4, 0.2]))
        return Moment((0.0, 0.0, z), None, None, None, (0.0, 0.0, -4.0 if t > 1.1 else 0.0))

    hung = {"force_start": (0.0, 0.0, -4.0), "force_end": (0.0, 0.0, -4.0)}
    made = program(
        segment("motion", 0.0, 1.0, position_start=high, position_end=low),
        segment("contact", 1.0, 1.3, position_start=low, position_end=low, force_held=(0.0, 0.0, -4.0)),
        segment("motion", 1.3, 2.3, position_start=low, position_end=high, **hung),
        segment("steady", 2.3, 3.3, position_start=high, position_end=high, **hung),
        segment("motion", 3.3, 4.3, position_start=high, position_end=low, **hung),
        at=at,
    )
    assert [app.t0 for app in made if app.kind == "apply_force" and app.t0 > 1.0] == []


def test_where_no_gripper_is_known_a_pull_that_ends_is_no_load() -> None:
    low, high = (0.0, 0.0, 0.2), (0.0, 0.0, 0.4)
    hung = {"force_held": (0.0, 0.0, -7.8)}

    def at(t: float) -> Moment:
        z = float(np.interp(t, [1.5, 2.5], [0.2, 0.4]))
        return Moment((0.0, 0.0, z), None, None, None, (0.0, 0.0, -7.8 if 1.0 < t < 2.5 else 0.0))

    made = program(
        segment("motion", 0.0, 1.0, position_start=high, position_end=low),
        segment("contact", 1.0, 1.5, position_start=low, position_end=low, **hung),
        segment("sliding", 1.5, 2.5, position_start=low, position_end=high, **hung),
        segment("steady", 2.5, 3.5, position_start=high, position_end=high),
        at=at,
    )
    pull = made[-1]
    assert (pull.kind, pull.tn, pull.load_kg) == ("cartesian_motion", 2.5, None)
    assert pull.force_taught == pytest.approx((0.0, 0.0, 7.8))


def test_holds_of_two_loads_are_two() -> None:
    """A cup that was emptied in the air weighed 0.62 kg before and after, the average of full and empty."""
    still = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.3)}
    made = program(
        segment("transport", 0.6, 1.2, load_kg=1.0, load_sd_kg=0.02, position_end=(0.0, 0.0, 0.3)),
        segment("hold", 1.2, 3.2, load_kg=1.0, load_sd_kg=0.02, **still),
        segment("hold", 3.2, 5.2, load_kg=0.3, load_sd_kg=0.02, **still),
        segment("transport", 5.2, 5.8, load_kg=0.3, load_sd_kg=0.02),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert [(app.kind, app.load_kg) for app in made if app.load_kg is not None] == [
        ("transport", pytest.approx(1.0)),
        ("hold", pytest.approx(1.0)),
        ("hold", pytest.approx(0.3)),
        ("transport", pytest.approx(0.3)),
    ]


@pytest.mark.parametrize(("second_kg", "loads"), [(0.78, [0.5, 0.5, 0.78, 0.78]), (0.55, [0.52, 0.52, 0.52])])
def test_a_load_that_changes_after_a_short_hold_is_another_one(second_kg: float, loads: list[float]) -> None:
    """Beside a hold of 0.9 s a load of 0.5 kg grew to 0.78 kg: all of the carry had 0.64 kg."""
    still = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.3), "load_sd_kg": 0.01}
    made = program(
        segment("transport", 0.6, 2.2, load_kg=0.5, load_sd_kg=0.01, position_end=(0.0, 0.0, 0.3)),
        segment("hold", 2.2, 3.1, load_kg=0.5, **still),
        segment("hold", 3.1, 4.3, load_kg=second_kg, **still),
        segment("transport", 4.3, 5.9, load_kg=second_kg, load_sd_kg=0.01),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert [app.load_kg for app in made if app.load_kg is not None] == pytest.approx(loads, abs=0.03)


def test_a_fast_lift_that_the_filter_finds_as_a_rest_in_contact_is_a_transport() -> None:
    """A robot lifted a load by 52 mm in 0.3 s: its hold on the table ended there, without a transport."""
    here, above = (0.0, 0.0, 0.2), (0.0, 0.0, 0.25)
    load, hung = {"load_kg": 0.4, "load_sd_kg": 0.02}, (0.0, 0.0, -6.0)
    made = program(
        segment("hold", 1.0, 2.5, **load, position_start=here, position_end=here),
        segment("contact", 2.5, 2.8, force_held=hung, position_start=here, position_end=above),
        segment("transport", 2.8, 4.0, **load, position_start=above, position_end=(0.3, 0.0, 0.25)),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert kinds(made) == ["grasp", "hold", "transport", "transport"]


def test_a_step_too_short_to_be_weighed_well_has_the_load_of_the_others() -> None:
    """A plug that was pulled out with 15 N weighed 1.73 kg on its first 30 mm, and 0.16 kg then."""
    made = program(
        segment("transport", 1.0, 1.7, load_kg=1.73, load_sd_kg=0.02, position_end=(0.3, 0.0, 0.3)),
        segment("transport", 1.7, 3.7, load_kg=0.2, load_sd_kg=0.02),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert [app.load_kg for app in made if app.kind == "transport"] == [0.2, 0.2]


@pytest.mark.parametrize(
    ("pushed_n", "following", "made"),
    [
        (4.0, "sliding", ["transport", "apply_force"]),
        (2.0, "sliding", ["transport", "hold", "apply_force"]),
        (4.0, "transport", ["transport", "hold", "transport"]),
    ],
)
def test_a_rest_before_a_stroke_touches_with_as_little_force_as_one_after_it(
    pushed_n: float, following: str, made: list[str]
) -> None:
    """A robot that pressed as lightly as it was taught held its load before the stroke, as it seemed."""

    place = (0.0, 0.0, 0.2)
    still = {"position_start": place, "position_end": place}

    def at(t: float) -> Moment:
        push = 0.0 if t < 2.0 else pushed_n if t < 3.0 or following == "transport" else 9.0
        return replace(
            drifted(t, pushed_n=push), position=(0.1 * max(t - 3.0, 0.0), 0.0, 0.2 * min(t / 2.0, 1.0))
        )

    stroke = segment(following, 3.0, 4.0, **ACROSS, **(held(9.0) if following == "sliding" else {}))
    apps = program(
        segment("transport", 1.0, 2.0), segment("hold", 2.0, 3.0, **still), stroke, grips=(GRASP,), at=at
    )
    assert kinds(apps)[-len(made) :] == made


def test_a_touch_whose_boundary_lies_in_the_carry_before_it_is_a_press() -> None:
    """The end of a carry was inferred as a contact, and pulled straight down: it was read as a carry.

    It still counted as the contact before the search of a hole. The direction in which that must push back
    was then the noise of its weight, and the search was a carry.
    """
    begins, touches, rests = (0.05, 0.0, 0.158), (0.07, 0.0, 0.158), (0.12, 0.0, 0.158)

    def at(t: float) -> Moment:
        x = float(np.interp(t, [3.0, 3.5, 4.0, 6.0], [0.03, 0.05, 0.07, 0.12]))
        z = float(np.interp(t, [1.0, 2.0, 3.5], [0.16, 0.25, 0.158]))
        force = (0.0, 0.1 * (t > 3.5), -GRAVITY * 0.8 + 11.0 * (t >= 3.9))
        return Moment((x, 0.0, z), None, None, 0.05, force)

    made = program(
        segment("transport", 1.0, 3.5, load_kg=0.8, load_sd_kg=0.02),
        segment(
            "sliding",
            3.5,
            4.0,
            force_held=(0.0, 0.1, -GRAVITY * 0.8),
            position_start=begins,
            position_end=touches,
        ),
        segment("motion", 4.0, 6.0, position_start=touches, position_end=rests),
        grips=(GRASP,),
        at=at,
    )
    (press,) = (app for app in made if app.kind == "apply_force")
    assert press.segments == (2,)
    assert math.hypot(*(press.force_taught or ())) == pytest.approx(11.0, abs=0.5)


def test_a_fast_lift_hangs_by_the_mean_of_its_force() -> None:
    """Inertia made the median of a lift of 0.4 s lean by 32°: a run had a press of 5.5 N."""
    forces = {3.1: (0.0, -0.6, -6.7), 3.2: (-0.9, -2.6, -5.2), 3.3: (-0.1, 2.0, -2.5), 3.4: (-0.9, 2.4, -3.5)}

    def at(t: float) -> Moment:
        place = (
            0.0,
            float(np.interp(t, [3.0, 3.4], [0.0, 0.04])),
            float(np.interp(t, [3.0, 3.4], [0.1, 0.15])),
        )
        force = forces.get(round(t, 1), (0.0, 0.0, 10.0 if t < 3.0 else -4.6))
        return Moment(place, None, None, 0.05, force)

    lift = {"position_start": (0.0, 0.0, 0.1), "position_end": (0.0, 0.04, 0.15)}
    made = program(
        segment(
            "contact",
            1.0,
            3.05,
            force_held=(0.0, 0.0, 10.0),
            position_start=(0.0, 0.0, 0.1),
            position_end=(0.0, 0.0, 0.1),
        ),
        segment("sliding", 3.05, 3.45, force_held=(-0.9, 2.2, -3.5), **lift),
        segment("transport", 3.45, 5.0, load_kg=0.47, load_sd_kg=0.1, position_start=(0.0, 0.04, 0.15)),
        grips=(GripperAction(2.0, "grasp", 0.03),),
        at=at,
    )
    assert kinds(made) == ["grasp", "transport", "transport"]
    assert made[1].load_kg == pytest.approx(0.47, abs=0.02)


@pytest.mark.parametrize(("bias_n", "becomes"), [(2.5, "hold"), (6.0, "apply_force")])
def test_a_rest_with_the_force_of_the_next_way_down_hangs_beside_a_bias(bias_n: float, becomes: str) -> None:
    """A bias of 2.7 N aside and the force of a fast carry made a rest of 0.5 s a press of 3.4 N."""
    high = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.3)}

    def at(t: float) -> Moment:
        z = float(np.interp(t, [1.0, 3.0, 3.5, 5.0], [0.1, 0.3, 0.3, 0.18]))
        fast = -2.0 if 1.6 < t < 3.0 else 0.0
        return Moment((0.0, 0.0, z), None, None, 0.05, (-bias_n * (3.0 < t < 3.5), 1.6, -3.1 + fast))

    made = program(
        segment("transport", 1.0, 3.0, load_kg=0.4, load_sd_kg=0.1, position_end=(0.0, 0.0, 0.3)),
        segment("contact", 3.0, 3.5, force_held=(-bias_n, 1.6, -3.1), **high),
        segment(
            "transport",
            3.5,
            5.0,
            load_kg=0.35,
            load_sd_kg=0.1,
            position_start=(0.0, 0.0, 0.3),
            position_end=(0.0, 0.0, 0.18),
        ),
        grips=(GRASP,),
        at=at,
    )
    assert kinds(made[1:]) == ["transport", becomes, "transport"]
