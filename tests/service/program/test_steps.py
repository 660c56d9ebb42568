"""What a segment is taken for beside what came before it, and what the fingers did."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.messages import App
from caesura_service.program import Grip, Moment, ProgramSegment, task_program
from service.program.test_apps import kinds, moment_at, segment

DRIFT_N = (2.0, -1.5, 3.0)  # of the sensor since it was tared
ACROSS: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}
GRASP, RELEASE = Grip(0.5, "grasp", 0.05), Grip(4.5, "release", 0.08)


def drifted(t: float, *, pushed_n: float = 0.0) -> Moment:
    place = moment_at(t)
    x, y, z = DRIFT_N
    return Moment(place.position, place.orientation, place.joints, place.gripper_width, (x, y, z + pushed_n))


def held(push_n: float) -> dict[str, Any]:
    x, y, z = DRIFT_N
    return {"force_held": (x, y, z + push_n)}


def program(*segments: Any, grips: tuple[Grip, ...] = (), at: Any = moment_at) -> tuple[App, ...]:
    return task_program([ProgramSegment(i, one, 1.0) for i, one in enumerate(segments)], grips, at)


def test_a_press_is_what_it_adds_to_the_force_that_was_there_before() -> None:
    apps = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, **held(8.0)), at=drifted)
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0))


def test_presses_that_follow_each_other_are_all_measured_from_before_the_first() -> None:
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(8.0)),
        segment("sliding", 3.0, 4.5, **held(9.0), **ACROSS),
        at=drifted,
    )
    assert apps[2].force_taught == pytest.approx((0.0, 0.0, -9.0))


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


def test_where_no_gripper_tells_what_weighs_nothing_is_not_carried() -> None:
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
    assert kinds(program(before, carry)) == ["cartesian_motion", "transport"]


@pytest.mark.parametrize(
    ("seconds", "becomes"), [(0.6, ["transport"] * 2), (1.5, ["transport", "hold", "transport"])]
)
def test_a_load_that_rests_for_a_moment_is_on_its_way(seconds: float, becomes: list[str]) -> None:
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    rest, onward = 2.0 + seconds, 4.0 + seconds
    carry = segment("transport", 0.0, 2.0, **load), segment("hold", 2.0, rest, **load)
    assert kinds(program(*carry, segment("transport", rest, onward, **load))) == becomes


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
    made = program(segment(before, 1.0, 2.0), said, grips=(GRASP, Grip(1.5, "release", 0.08)), at=drifted)
    expected = {"sliding": "apply_force", "contact": "apply_force", "motion": "cartesian_motion"}
    assert made[-1].kind == expected.get(named, named)
