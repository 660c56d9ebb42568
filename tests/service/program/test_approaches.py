"""Where a contact is made, and what belongs to the movement into it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from caesura_service.program import GripperAction, Moment, Paths, ProgramSegment, task_program
from service.program.segments import (
    ACROSS,
    DRIFT_N,
    UPRIGHT,
    drifted,
    held,
    kinds,
    moment_at,
    program,
    segment,
    stopping_at,
)


def test_a_contact_was_made_where_the_movement_into_it_was_pushed_back_first() -> None:
    def late(t: float) -> Moment:
        return drifted(t, pushed_n=5.0 if t > 1.7 else 0.0)

    touching, pressing = program(
        segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, **held(8.0)), at=late
    )
    assert touching.target == pytest.approx((0.0, 0.0, 0.175))
    assert pressing.force_taught == pytest.approx((0.0, 0.0, -8.0))


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


@pytest.mark.parametrize("ends", [False, True], ids=["a stroke", "with a short slide at its end"])
def test_a_stroke_that_begins_in_the_air_has_its_path_from_the_touch_on(ends: bool) -> None:
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
    if ends:
        end = {"position_start": (0.2, 0.0, 0.1), "position_end": (0.2, 0.013, 0.1)}
        steps.append(ProgramSegment(2, segment("sliding", 5.0, 5.4, **held(8.0), **end), 1.0))
    _, stroke = task_program(steps, (), down_then_across, paths=Paths(poses))
    assert stroke.path is not None
    assert stroke.segments == ((1, 2) if ends else (1,))
    assert stroke.path.start.position == pytest.approx((0.0, 0.0, 0.1), abs=0.006)
    assert stroke.t0 == stroke.path.start.t == pytest.approx(3.05)


def test_a_way_down_that_ends_in_a_press_is_one_move_to_contact() -> None:
    down = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.2), "force_held": (0.0, 0.0, 9.0)}
    made = program(segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **down))
    assert kinds(made) == ["cartesian_motion", "move_to_contact", "apply_force"]
    tilted = ACROSS | {"force_held": (-6.0, 0.0, 8.0)}
    stroke = program(segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, **tilted))
    assert kinds(stroke) == ["move_to_contact", "apply_force"]


@pytest.mark.parametrize(
    ("touched_s", "presses"),
    [(2.9, [(2, 3)]), (2.3, [(1, 2), (3,)])],
    ids=["it touches at its end", "it presses for 0.7 s"],
)
def test_a_rest_after_a_way_down_into_a_contact_begins_the_stroke(
    touched_s: float, presses: list[tuple[int, ...]]
) -> None:
    """Of five like strokes one was a press and a stroke: the way down to it was in contact as a whole."""
    down = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.2)}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 3.0, **held(9.0), **down),
        segment("contact", 3.0, 3.6, **held(9.0)),
        segment("sliding", 3.6, 5.0, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=9.0 if t > touched_s else 0.0),
    )
    assert kinds(made)[:2] == ["cartesian_motion", "move_to_contact"]
    assert [app.segments for app in made if app.kind == "apply_force"] == presses
    assert all(app.tn <= following.t0 for app, following in pairwise(made)), "a press begins at its touch"


def test_a_way_down_that_goes_on_in_a_stroke_is_no_press() -> None:
    down = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.2)}
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 3.0, **held(9.0), **down),
        segment("sliding", 3.0, 5.0, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=9.0 if t > 2.9 else 0.0),
    )
    assert kinds(made) == ["cartesian_motion", "move_to_contact", "apply_force"]


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
        at=lambda t: drifted(t, pushed_n=0.0 if t < 3.0 else 9.0, at=stopping_at),
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
        at=lambda t: drifted(t, pushed_n=0.0 if t < 3.0 else 9.0, at=stopping_at),
    )
    assert [app.kind for app in made] == [
        "cartesian_motion",
        "gripper_move",
        "move_to_contact",
        "apply_force",
    ]
    assert [app.segments for app in made if app.segments] == [(0, 1), (1,), (2,)]


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
        at=stopping_at,
    )
    assert [app.segments for app in made] == made_of


@pytest.mark.parametrize("pushed_s", [2.0, 3.0], ids=["from its start", "later"])
def test_a_contact_that_pushes_back_from_its_start_has_no_approach(pushed_s: float) -> None:
    """Its Move To Contact had one place and no duration, and the program's own check refused that path."""

    def at(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, 9.0 if t > pushed_s else 0.0))

    def poses(t0: float, tn: float) -> tuple[Any, Any]:
        times = np.arange(t0, tn + 1e-9, 0.1)
        return times, np.array([moment_at(t).position for t in times])

    down = {"position_start": (0.0, 0.0, 0.3), "position_end": (0.0, 0.0, 0.2)}
    parts = (segment("motion", 0.0, 2.0), segment("sliding", 2.0, 4.0, force_held=(0.0, 0.0, 9.0), **down))
    steps = [ProgramSegment(index, one, 1.0) for index, one in enumerate(parts)]
    made = task_program(steps, (), at, paths=Paths(poses))
    approach = ["cartesian_motion", "move_to_contact"] if pushed_s > 2.0 else ["move_to_contact"]
    assert kinds(made) == [*approach, "apply_force"]
    paths = [app.path for app in made if app.path is not None]
    assert all(path.tn > path.start.t for path in paths)


@pytest.mark.parametrize(
    ("slid_m", "hit_s", "ends_m"),
    [(0.012, 0.1, 0.0), (0.03, 0.1, 0.03), (0.012, 0.2, 0.012)],
    ids=["it bounces", "it knocks", "it drags"],
)
def test_a_way_to_a_contact_ends_where_the_tool_hits_and_bounces(
    slid_m: float, hit_s: float, ends_m: float
) -> None:
    """A peg touched, bounced 12 mm on, and was pressed: its robot stopped where it touched, 11 mm before."""

    def at(t: float) -> Moment:
        pushed_n = 8.0 if t >= 2.0 or 1.6 < t < 1.6 + hit_s else 0.0
        way = (slid_m * min(max((t - 1.65) / 0.35, 0.0), 1.0), 0.0, 0.1 * max(1.65 - t, 0.0))
        return replace(drifted(t, pushed_n=pushed_n), position=way)

    there = {"position_start": (slid_m, 0.0, 0.0), "position_end": (slid_m, 0.0, 0.0)}
    made = program(
        segment("motion", 0.0, 2.0, position_end=(slid_m, 0.0, 0.0)),
        segment("contact", 2.0, 4.0, **held(8.0), **there),
        at=at,
    )
    assert made[0].kind == "move_to_contact"
    assert made[0].target == pytest.approx((ends_m, 0.0, 0.0), abs=1e-6)


def test_a_touch_after_the_last_look_at_an_approach_is_at_its_end() -> None:
    """A hit of one observation lay between two looks: the way to it had no length, and was refused."""
    high, low, far = (0.0, 0.0, 0.2), (0.0, 0.0, 0.14), (0.1, 0.0, 0.14)

    def at(t: float) -> Moment:
        x, z = float(np.interp(t, [4.6, 5.9], [0.0, 0.1])), float(np.interp(t, [3.2, 3.9], [0.2, 0.14]))
        return Moment((x, 0.0, z), UPRIGHT, None, None, (0.0, 0.0, 12.0 if t > 3.9 else 0.0))

    made = program(
        segment("motion", 2.0, 3.2, position_start=(-0.1, 0.0, 0.15), position_end=high),
        segment("sliding", 3.2, 3.95, force_held=(0.0, 0.0, 27.0), position_start=high, position_end=low),
        segment("contact", 3.95, 4.6, force_held=(0.0, 0.0, 12.0), position_start=low, position_end=low),
        segment("sliding", 4.6, 5.95, force_held=(0.0, 0.0, 12.0), position_start=low, position_end=far),
        at=at,
    )
    assert kinds(made) == ["cartesian_motion", "move_to_contact", "apply_force"]
    assert made[1].target == pytest.approx(low, abs=1e-3)
