"""What is carried, lifted or set down."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from caesura_service.constants import GRAVITY
from caesura_service.program import GripperAction, Moment
from service.program.segments import (
    GRASP,
    RELEASE,
    carried,
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


def test_a_step_too_short_to_be_weighed_well_has_the_load_of_the_others() -> None:
    """A plug that was pulled out with 15 N weighed 1.73 kg on its first 30 mm, and 0.16 kg then."""
    made = program(
        segment("transport", 1.0, 1.7, load_kg=1.73, load_sd_kg=0.02, position_end=(0.3, 0.0, 0.3)),
        segment("transport", 1.7, 3.7, load_kg=0.2, load_sd_kg=0.02),
        grips=(GRASP,),
        at=stopping_at,
    )
    assert [app.load_kg for app in made if app.kind == "transport"] == [0.2, 0.2]


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
