"""Rests of what the fingers hold: which are holds, where they begin and end, and which are one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_service.program import GripperAction, Moment
from service.program.segments import (
    ACROSS,
    GRASP,
    RELEASE,
    drifted,
    held,
    kinds,
    moment_at,
    program,
    segment,
    stopping_at,
)


def test_what_the_fingers_hold_is_carried_from_beginning_to_end_however_light() -> None:
    carry = segment("transport", 3.0, 4.0, load_kg=0.15, load_sd_kg=0.05)
    before, after = segment("motion", 1.0, 3.0), segment("motion", 5.0, 6.0)
    made = program(before, carry, after, grips=(GRASP, RELEASE), at=stopping_at)
    apps = [app for app in made if app.segments]
    assert kinds(tuple(apps)) == ["transport", "transport", "cartesian_motion"]
    assert apps[0].load_kg == pytest.approx(0.15)


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
