"""What is taken for a contact."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from caesura_service.program import GripperAction, Moment
from service.program.segments import (
    ACROSS,
    DRIFT_N,
    GRASP,
    OFF,
    RELEASE,
    drifted,
    forces_of,
    held,
    kinds,
    program,
    segment,
    stopping_at,
)


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
    steps = segment(before, 0.0, 2.0), segment(touching, 2.0, 4.0, **held(0.5), **ACROSS)
    apps = program(*steps, at=lambda t: drifted(t, at=stopping_at))
    assert kinds(apps) == becomes


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


@pytest.mark.parametrize(("down_n", "becomes"), [(9.0, "contact"), (4.0, "air")])
def test_a_contact_whose_force_turns_at_one_place_goes_on(down_n: float, becomes: str) -> None:
    """After a press to the side a turn pressed down: it was in the air, and the way out pressed with 9 N.

    A smaller force may be the drift of the sensor.
    """
    place = (0.0, 0.0, 0.2)
    still: dict[str, Any] = {"position_start": place, "position_end": place}
    x, y, z = DRIFT_N

    def at(t: float) -> Moment:
        aside, down = 10.0 * (2.0 <= t < 4.0), down_n * (4.0 <= t < 6.0)
        return replace(drifted(t), position=place, force=(x + aside, y, z + down))

    turn = segment("motion", 4.0, 6.0, **still).model_copy(
        update={"kind": "turning", "turn": (0.0, 0.0, 1.0)}
    )
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, force_held=(x + 10.0, y, z), **still),
        turn,
        segment("motion", 6.0, 8.0, position_start=place, position_end=(0.0, 0.0, 0.4)),
        at=at,
    )
    assert kinds(made)[0] == "move_to_contact"
    assert made[-1].kind == "cartesian_motion"
    assert made[-1].force_taught is None
    pressed = {index for app in made if app.force is not None for index in app.segments}
    assert (2 in pressed) == (becomes == "contact")


def test_a_load_that_a_hand_pulls_and_takes_is_no_press() -> None:
    """Without the weight of 8.5 N the rest after the pull differed from it, and the way back pressed."""
    place = (0.0, 0.0, 0.3)
    still: dict[str, Any] = {"position_start": place, "position_end": place}

    def at(t: float) -> Moment:
        weight_n, pull_n = -8.5 * (1.0 <= t < 5.0), 8.5 * (4.0 <= t < 5.0)
        return replace(drifted(t), position=place, force=(pull_n, 0.0, weight_n))

    made = program(
        segment("transport", 1.0, 4.0, load_kg=0.87, load_sd_kg=0.02, position_end=place),
        segment("contact", 4.0, 5.0, force_held=(8.5, 0.0, -8.5), **still),
        segment("hold", 5.0, 6.0, load_kg=0.0, load_sd_kg=0.02, **still),
        segment("motion", 6.0, 8.0, position_start=place, position_end=(0.2, 0.0, 0.3)),
        grips=(GRASP, GripperAction(5.2, "release", 0.08)),
        at=at,
    )
    assert made[-1].kind == "cartesian_motion"
    assert made[-1].force_taught is None


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


@pytest.mark.parametrize(
    ("kind", "first_n", "seconds", "weaker_n"),
    [
        ("sliding", 12.0, 2.0, 12.0),
        ("sliding", 12.0, 0.8, None),
        ("contact", 12.0, 0.8, None),
        ("sliding", 22.0, 2.0, None),
        ("contact", 22.0, 2.0, None),
        ("sliding", 2.0, 2.0, None),
        ("contact", 2.0, 2.0, None),
    ],
)
def test_a_stroke_states_a_weaker_force_that_was_held_in_it(
    kind: str, first_n: float, seconds: float, weaker_n: float | None
) -> None:
    """A press of 12 N, of 25 N and of 12 N again was one of 25 N all the time, without a finding."""

    def pressed(t: float) -> Moment:
        push = 0.0 if t < 2.0 else first_n if t < 2.0 + seconds else 25.0
        return drifted(t, pushed_n=push)

    made = program(
        segment("motion", 0.0, 2.0),
        segment(kind, 2.0, 6.0, **held(25.0), **ACROSS),
        at=pressed,
    )
    (press,) = (app for app in made if app.force is not None)
    assert press.weaker_n == (None if weaker_n is None else pytest.approx(weaker_n))


@pytest.mark.parametrize(
    ("first_s", "last_s", "most_n", "stronger_n", "impact_n"),
    [
        (4.0, 4.2, 25.0, 25.0, None),
        (4.0, 4.1, 34.0, None, 34.0),
        (2.0, 2.1, 25.0, None, 25.0),
        (4.0, 4.2, 14.0, None, None),
    ],
)
@pytest.mark.parametrize("kind", ["contact", "sliding"])
def test_a_press_states_a_force_of_two_tenths_of_a_second_as_stronger_and_a_shorter_one_as_an_impact(
    kind: str, first_s: float, last_s: float, most_n: float, stronger_n: float | None, impact_n: float | None
) -> None:
    """Every third simulated press was said to be stronger for a moment: most were the impact of the touch."""

    def pressed(t: float) -> Moment:
        push = 0.0 if t < 2.0 else most_n if first_s <= t < last_s else 10.0
        return drifted(t, pushed_n=push)

    made = program(segment("motion", 0.0, 2.0), segment(kind, 2.0, 6.0, **held(10.0), **ACROSS), at=pressed)
    (press,) = (app for app in made if app.force is not None)
    assert (press.stronger_n, press.impact_n) == pytest.approx((stronger_n, impact_n))


def test_an_impact_beside_a_stronger_force_is_stated_if_it_is_stronger_still() -> None:
    def pressed(t: float) -> Moment:
        push = 0.0 if t < 2.0 else 40.0 if t < 2.1 else 20.0 if 4.0 <= t < 4.5 else 10.0
        return drifted(t, pushed_n=push)

    made = program(
        segment("motion", 0.0, 2.0), segment("contact", 2.0, 6.0, **held(10.0), **ACROSS), at=pressed
    )
    assert (made[1].stronger_n, made[1].impact_n) == pytest.approx((20.0, 40.0))


@pytest.mark.parametrize(("peak_n", "stronger_n"), [(20.0, None), (29.0, 29.0)])
def test_a_stronger_force_in_a_rest_beside_a_stroke_is_compared_with_that_of_the_rest(
    peak_n: float, stronger_n: float | None
) -> None:
    def pressed(t: float) -> Moment:
        push = 0.0 if t < 2.0 else peak_n if 2.4 <= t < 2.6 else 18.0 if t < 3.0 else 10.0
        return drifted(t, pushed_n=push)

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(18.0)),
        segment("sliding", 3.0, 6.0, **held(10.0), **ACROSS),
        at=pressed,
    )
    (stroke,) = (app for app in made if app.rest_before is not None)
    assert stroke.stronger_n == (None if stronger_n is None else pytest.approx(stronger_n))


@pytest.mark.parametrize(
    ("push", "weaker_n"),
    [
        (lambda t: min(max(5.5 * (t - 2.0), 0.0), 25.0), 12.1),  # it was held for a second at 4 N
        (lambda t: 20.0 + 5.0 * math.sin(6.0 * t), 17.2),  # nothing was stated
        (lambda t: 12.0 if 4.0 < t < 4.8 or 6.0 < t < 6.8 else 25.0, 12.0),  # nor for this
        (lambda t: 20.0 if t % 0.8 < 0.4 else 25.0, 20.0),  # and for these 5 N
        (lambda t: 12.0 if 4.0 < t < 4.2 else 25.0, None),
        (lambda t: 22.0 if t % 0.8 < 0.4 else 25.0, None),
        (lambda t: 12.0 if t > 4.0 and t % 2.0 < 0.8 else 25.0, 12.0),
        (lambda t: min(max(30.0 * (t - 2.0), 0.0), 25.0), None),
    ],
)
def test_a_force_that_varies_in_a_press_is_stated_if_it_is_weaker_between_two_stronger_ones(
    push: Callable[[float], float], weaker_n: float | None
) -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 12.0, **held(25.0)),
        at=lambda t: drifted(t, pushed_n=push(t) if t >= 2.0 else 0.0),
    )
    (press,) = (app for app in made if app.force is not None)
    assert press.weaker_n == (None if weaker_n is None else pytest.approx(weaker_n, abs=0.3))


@pytest.mark.parametrize(
    ("aside", "seconds", "aslant"),
    [(20.0, 0.6, True), (20.0, 0.8, True), (20.0, 0.3, False), (4.0, 2.0, False), (-20.0, 0.8, True)],
)
def test_a_force_that_was_held_in_another_direction_is_stated(
    aside: float, seconds: float, aslant: bool
) -> None:
    """A press down and then to the side was one press to the side, and nothing said so."""

    def at(t: float) -> Moment:
        pushed = drifted(t, pushed_n=15.0 if t >= 2.0 else 0.0)
        x, y, z = pushed.force or (0.0, 0.0, 0.0)
        return replace(pushed, force=(x + (aside if 4.0 <= t < 4.0 + seconds else 0.0), y, z))

    made = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 9.0, **held(15.0)), at=at)
    (press,) = (app for app in made if app.force is not None)
    expected = pytest.approx((-aside, 0.0, press.force[2]), abs=0.5)
    assert press.aslant == (expected if aslant else None)


@pytest.mark.parametrize(
    ("aside_n", "seconds", "stated"), [(8.0, 2.0, True), (8.0, 1.0, False), (4.0, 4.0, False)]
)
def test_a_force_that_is_pushed_to_and_fro_is_stated(aside_n: float, seconds: float, stated: bool) -> None:
    """A press of 15 N with 8 N to either side once a second was a press down, and nothing stated the 8 N."""

    def at(t: float) -> Moment:
        pushed = drifted(t, pushed_n=15.0 if t >= 2.0 else 0.0)
        x, y, z = pushed.force or (0.0, 0.0, 0.0)
        swing = aside_n * math.sin(2.0 * math.pi * t) if 4.0 <= t < 4.0 + seconds else 0.0
        return replace(pushed, force=(x + swing, y, z))

    made = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 9.0, **held(15.0)), at=at)
    (press,) = (app for app in made if app.force is not None)
    if not stated:
        assert press.aslant is None
        return
    assert press.aslant is not None
    assert abs(press.aslant[0]) == pytest.approx(7.0, abs=1.0)
    assert press.aslant[1:] == pytest.approx((0.0, -15.0), abs=0.1)


@pytest.mark.parametrize(
    ("begins", "turns", "aslant"), [(9.5, False, None), (6.2, False, (-12.0, 0.0, -12.0)), (6.2, True, None)]
)
def test_a_force_in_another_direction_that_was_held_beside_a_stroke_is_stated(
    begins: float, turns: bool, aslant: tuple[float, float, float] | None
) -> None:
    """After a stroke the hand pressed to the side for three seconds: the size alone was in the program.

    turns: whether the tool turns with the force, as along a surface.
    """

    def at(t: float) -> Moment:
        leans = t >= begins
        x, y, z = DRIFT_N
        pushed = (12.0 * leans, 0.0, 12.0) if t >= 2.0 else (0.0, 0.0, 0.0)
        half = math.pi / 8 if leans and turns else 0.0
        orientation = (0.0, math.sin(half), 0.0, math.cos(half))
        force = (x + pushed[0], y + pushed[1], z + pushed[2])
        return replace(drifted(t), orientation=orientation, force=force)

    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 6.0, **held(12.0), **ACROSS),
        segment("contact", 6.0, 9.5, **held(12.0)),
        at=at,
    )
    (stroke,) = (app for app in made if app.force is not None)
    assert stroke.aslant == (None if aslant is None else pytest.approx(aslant, abs=0.1))


def test_a_press_of_an_hour_is_compared_at_a_bounded_number_of_times() -> None:
    """Every look at a growing press read each of its observations."""
    times: set[float] = set()

    def counted(t: float) -> Moment:
        times.add(t)
        return drifted(t, pushed_n=0.0 if t < 2.0 else 12.0 if t < 1802.0 else 25.0)

    made = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 3602.0, **held(25.0)), at=counted)
    assert [math.hypot(*app.force) for app in made if app.force is not None] == pytest.approx([12.0, 25.0])
    assert len(times) < 5000


def test_a_force_before_a_gap_in_a_press_was_not_held_through_it() -> None:
    """A gap of two seconds showed the last force before it for one second, which no sample shows."""

    def pressed(t: float) -> Moment:
        return drifted(t, pushed_n=0.0 if t < 2.0 else 12.0 if t < 3.4 else 25.0)

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.4, **held(12.0)),
        segment("contact", 4.4, 6.0, **held(25.0)),
        at=pressed,
    )
    (press,) = (app for app in made if app.force is not None)
    assert press.segments == (1, 2)
    assert press.weaker_n is None


@pytest.mark.parametrize(("pushed_n", "rest_n"), [(4.0, 4.0), (2.0, None)])
def test_a_rest_before_a_stroke_is_pressed_where_its_force_adds_to_the_one_before(
    pushed_n: float, rest_n: float | None
) -> None:
    """A robot touched with 5.5 N and a bias of -3 N: the rest was in the air, and the bias of the stroke."""

    def at(t: float) -> Moment:
        return drifted(t, pushed_n=10.0 if t >= 2.7 else pushed_n if t >= 2.0 else 0.0)

    here = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 2.7, **here),
        segment("sliding", 2.7, 4.0, **held(10.0), **ACROSS),
        at=at,
    )
    rest = apps[-1].rest_before
    assert (None if rest is None else rest.newton_taught) == pytest.approx(rest_n)


@pytest.mark.parametrize("fall_s", [0.1, 0.4])
@pytest.mark.parametrize("opened_at", [3.0, 2.95])
def test_an_object_that_falls_out_of_the_fingers_touches_nothing(opened_at: float, fall_s: float) -> None:
    """Fingers let go of 1 kg in the air: the robot pressed down with 9.6 N on its way from there."""
    load, still = {"load_kg": 1.0, "load_sd_kg": 0.02}, {"position_end": (0.0, 0.0, 0.3)}
    gone = 3.0 + fall_s
    made = program(
        segment("transport", 1.0, 2.0, **load),
        segment("hold", 2.0, 3.0, **load, position_start=(0.0, 0.0, 0.3), **still),
        segment("contact", 3.0, gone, force_held=(0.0, 0.0, -2.0), **still),
        segment("steady", gone, 4.0, position_start=(0.0, 0.0, 0.3), **still),
        segment("motion", 4.0, 5.0, position_start=(0.0, 0.0, 0.3), position_end=(0.2, 0.0, 0.3)),
        grips=(GRASP, replace(RELEASE, t=opened_at)),
        at=lambda t: replace(stopping_at(t), force=(0.0, 0.0, -9.8 if t < 3.0 else 0.0)),
    )
    assert kinds(made) == ["grasp", "transport", "hold", "gripper_move", "cartesian_motion"]
    assert all(app.force_taught is None for app in made)


def test_an_object_that_its_support_carries_as_the_fingers_open_was_set_down() -> None:
    load, place = {"load_kg": 1.0, "load_sd_kg": 0.02}, (0.0, 0.0, 0.3)
    made = program(
        segment("transport", 1.0, 3.0, **load),
        segment("contact", 3.0, 3.4, force_held=(0.0, 0.0, 0.0), position_start=place, position_end=place),
        segment("steady", 3.4, 4.4, position_start=place, position_end=place),
        grips=(GRASP, replace(RELEASE, t=3.6)),
        at=lambda t: replace(stopping_at(t), force=(0.0, 0.0, -9.8 if t < 3.0 else 0.0)),
    )
    assert [(app.kind, app.t0, app.tn) for app in made[1:]] == [
        ("transport", 1.0, 3.0),
        ("gripper_move", 3.0, 4.4),
    ]
    assert made[-1].force_taught == pytest.approx((0.0, 0.0, -9.8), abs=0.1)


def test_open_fingers_that_move_aside_of_what_they_have_set_down_press_nothing() -> None:
    """The force before the contact was the weight of 1 kg, and its loss was a press of 9.8 N on the way."""
    load, place, aside = {"load_kg": 1.0, "load_sd_kg": 0.02}, (0.0, 0.0, 0.3), (0.06, 0.0, 0.3)
    made = program(
        segment("transport", 1.0, 3.0, **load),
        segment("contact", 3.0, 4.4, force_held=(0.0, 0.0, 0.0), position_start=place, position_end=place),
        segment("motion", 4.4, 5.4, position_start=place, position_end=aside),
        segment("steady", 5.4, 6.0, position_start=aside, position_end=aside),
        grips=(GRASP, replace(RELEASE, t=3.8)),
        at=lambda t: replace(stopping_at(t), force=(0.0, 0.0, -9.8 if t < 3.0 else 0.0)),
    )
    assert kinds(made) == ["grasp", "transport", "gripper_move", "cartesian_motion"]


def test_what_pushes_back_on_the_last_way_to_a_contact_is_no_bias_of_the_sensor() -> None:
    """A hand skidded 10 mm with 4 N, which was inferred as a movement in the air, and pressed with 9 N.

    The program pressed with 5 N.
    """

    def at(t: float) -> Moment:
        skidded = 0.01 * min(max((t - 2.0) / 0.4, 0.0), 1.0)
        push_n = 0.0 if t < 2.0 or t > 4.0 else 4.0 if t < 2.4 else 9.0
        return replace(drifted(t, pushed_n=push_n), position=(skidded, 0.0, 0.1 * max(2.0 - t, t - 4.0, 0.0)))

    made = program(
        segment("motion", 0.0, 2.0, position_start=(0.0, 0.0, 0.2), position_end=(0.0, 0.0, 0.0)),
        segment("motion", 2.0, 2.4, position_start=(0.0, 0.0, 0.0), position_end=(0.01, 0.0, 0.0)),
        segment(
            "contact", 2.4, 4.0, **held(9.0), position_start=(0.01, 0.0, 0.0), position_end=(0.01, 0.0, 0.0)
        ),
        segment("motion", 4.0, 6.0, **OFF),
        at=at,
    )
    press = next(app for app in made if app.kind == "apply_force")
    assert forces_of(press) == pytest.approx([9.0], abs=0.5)
