"""Which turns are one, and which are rests."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from caesura_protocol.messages import ScrewMotion, Segment, Vector
from caesura_service.program import Moment
from service.program.segments import (
    ACROSS,
    UPRIGHT,
    drifted,
    held,
    kinds,
    moment_at,
    program,
    segment,
    turned,
)


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


@pytest.mark.parametrize(
    ("changes", "turns"),
    [
        ({}, [(1, 2)]),
        ({"stands_s": 0.4}, [(1,), (2,)]),
        ({"second_turn": (0.0, 1.0, 0.0)}, [(1,), (2,)]),
    ],
)
def test_a_turn_in_the_air_that_goes_on_about_its_axis_is_one(
    changes: dict[str, Any], turns: list[tuple[int, ...]]
) -> None:
    """A hand poured and turned back; the last part of the turn back was a segment of its own."""
    stands_s = changes.get("stands_s", 0.0)

    def at(t: float) -> Moment:
        half = 0.5 * turned_at(t, stands_s)
        return Moment((0.0, 0.0, 0.2), (0.0, 0.0, math.sin(half), math.cos(half)), None, None)

    def turn(t0: float, tn: float, about: Vector) -> Segment:
        here: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
        return segment("motion", t0, tn, **here).model_copy(update={"kind": "turning", "turn": about})

    middle, end = 3.0 + 0.5 * stands_s, 4.0 + stands_s
    about = changes.get("second_turn", (0.0, 0.0, 1.0))
    apps = program(
        segment("motion", 0.0, 2.0, position_start=(0.0, 0.0, 0.4), position_end=(0.0, 0.0, 0.2)),
        turn(2.0, middle, (0.0, 0.0, 1.0)),
        turn(middle, end, about),
        at=at,
    )
    assert [app.segments for app in apps[1:]] == turns


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
