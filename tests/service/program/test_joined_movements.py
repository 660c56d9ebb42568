"""Movements in the air that are one, and the velocity with which one goes on in the next."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.messages import App
from caesura_service.program import GripperAction, Moment, MomentAt, Paths, ProgramSegment, task_program
from service.program.segments import kinds, program, segment

SPEED_M_PER_S = 0.1
BOUNDARY_S = 2.0
GRASP = GripperAction(-1.0, "grasp", 0.03)


def bent_at(t: float, *, turn_deg: float = 0.0, slower: float = 1.0) -> tuple[float, float, float]:
    """Along x until 2 s, then turned to y; within 0.25 s of that at a share of the speed."""
    slow_s = 0.25
    passed = t - (1.0 - slower) * min(max(t - BOUNDARY_S + slow_s, 0.0), 2.0 * slow_s)
    corner = BOUNDARY_S - (1.0 - slower) * slow_s
    along, after = SPEED_M_PER_S * min(passed, corner), SPEED_M_PER_S * max(passed - corner, 0.0)
    turn = math.radians(turn_deg)
    return along + after * math.cos(turn), after * math.sin(turn), 0.3


def moving(**way: float) -> MomentAt:
    return lambda t: Moment(bent_at(t, **way), (0.0, 0.0, 0.0, 1.0), None, 0.04)


def paths_of(at: MomentAt) -> Paths:
    """Observed ten times a second, at 0.05, 0.15 … s."""

    def between(t0: float, tn: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        first, last = round((t0 - 0.05) / 0.1), round((tn - 0.05) / 0.1)
        times = 0.05 + 0.1 * np.arange(max(first, 0), last + 1)
        return times, np.array([at(t).position for t in times])

    return Paths(between)


def taught(
    at: MomentAt, kind: str = "motion", onward: str = "motion", t0: float = BOUNDARY_S, *, apart: bool = False
) -> tuple[App, ...]:
    """Two segments; apart: an operator has stated that the second one begins there."""
    first = segment(kind, 0.0, BOUNDARY_S, position_end=at(BOUNDARY_S + 0.05).position)
    steps = [
        ProgramSegment(0, first, 0.9),
        ProgramSegment(1, segment(onward, t0, 4.0), 0.9, is_set_apart=apart),
    ]
    grips = (GRASP,) if kind == "transport" else ()
    return tuple(app for app in task_program(steps, grips, at, paths=paths_of(at)) if app.segments)


@pytest.mark.parametrize(
    ("way", "apps"),
    [
        ({}, [(0, 1)]),
        ({"turn_deg": 30.0}, [(0, 1)]),
        ({"turn_deg": 30.0, "slower": 0.95}, [(0, 1)]),
        ({"turn_deg": 90.0}, [(0, 1)]),
        ({"turn_deg": 90.0, "slower": 0.95}, [(0, 1)]),
        ({"turn_deg": 90.0, "slower": 0.5}, [(0,), (1,)]),
        ({"turn_deg": 30.0, "slower": 0.3}, [(0, 1)]),
        ({"turn_deg": 30.0, "slower": 0.1}, [(0,), (1,)]),
    ],
)
@pytest.mark.parametrize("kind", ["motion", "transport"])
def test_a_movement_that_neither_stops_nor_turns_and_slows_goes_on(
    way: dict[str, float], apps: list[tuple[int, ...]], kind: str
) -> None:
    """Two circles in a row became three moves, and the robot stopped twice on its way."""
    made = taught(moving(**way), kind, kind)
    assert [app.segments for app in made] == apps
    assert [app.path and round(app.path.length_m, 2) for app in made] == (
        [pytest.approx(0.4, abs=0.05)] if len(apps) == 1 else [pytest.approx(0.2, abs=0.05)] * 2
    )


def test_what_is_missing_between_two_movements_may_have_been_a_rest() -> None:
    assert [app.segments for app in taught(moving(), t0=2.4)] == [(0,), (1,)]


def test_a_movement_that_an_operator_names_stays_one() -> None:
    named = segment("motion", BOUNDARY_S, 4.0).model_copy(update={"corrected": True})
    made = program(segment("motion", 0.0, BOUNDARY_S), named, at=moving())
    assert [app.segments for app in made] == [(0,), (1,)]


@pytest.mark.parametrize("kind", ["motion", "transport"])
def test_a_movement_that_an_operator_divides_stays_divided(kind: str) -> None:
    assert [app.segments for app in taught(moving(), kind, kind, apart=True)] == [(0,), (1,)]


def test_a_corner_is_passed_with_the_velocity_of_the_hand() -> None:
    """A path ended at rest: the robot stopped where the hand went on."""
    way = {"turn_deg": 80.0, "slower": 0.5}
    first, second = taught(moving(**way))
    assert first.path is not None
    assert second.path is not None
    before, after = (np.array(bent_at(first.path.tn + dt, **way)) for dt in (-0.1, 0.1))
    assert first.path.end_velocity == pytest.approx((after - before) / 0.2)
    assert second.path.start.velocity == first.path.end_velocity
    assert (first.path.start.velocity, second.path.end_velocity) == (None, None)


@pytest.mark.parametrize(
    ("kind", "onward", "t0"),
    [("motion", "motion", 2.4), ("motion", "contact", 2.0), ("transport", "transport", 2.4)],
)
def test_before_a_pause_or_a_contact_a_path_ends_at_rest(kind: str, onward: str, t0: float) -> None:
    def at(t: float) -> Moment:
        return replace(moving(slower=0.5)(t), force=(0.0, 0.0, 9.0 if t > BOUNDARY_S else 0.0))

    first, *_ = taught(at, kind, onward, t0)
    assert first.path is not None
    assert first.path.end_velocity is None


def test_a_carry_goes_on_in_a_hold() -> None:
    made = taught(moving(slower=0.5), "transport", "hold")
    assert kinds(made) == ["transport", "hold"]
    assert made[0].path is not None
    assert made[0].path.end_velocity is not None


@pytest.mark.parametrize(
    ("way_m", "turn_deg", "moves"), [(0.0015, 0.5, 2), (0.0025, 0.5, 3), (0.0015, 1.5, 3)]
)
def test_a_movement_that_leads_nowhere_is_a_rest(way_m: float, turn_deg: float, moves: int) -> None:
    """A hand stood for 0.3 s and trembled. What is within the tolerance of a path is no app."""

    def standing(t: float) -> Moment:
        """Half a metre a second until 2 s and from 2.5 s on; between them a little way, and a little turn."""
        share = min(max((t - 2.1) / 0.3, 0.0), 1.0)
        half = 0.5 * share * math.radians(turn_deg)
        x = 0.5 * (min(t - 2.0, 0.0) + max(t - 2.5, 0.0)) + share * way_m
        return Moment((x, 0.0, 0.3), (0.0, 0.0, math.sin(half), math.cos(half)), None, 0.04)

    ends = [(t, standing(t).position) for t in (0.0, 2.0, 2.5, 4.0)]
    parts = [
        segment("motion", t0, tn, position_start=start, position_end=end)
        for (t0, start), (tn, end) in pairwise(ends)
    ]
    assert kinds(program(*parts, at=standing)) == ["cartesian_motion"] * moves


@pytest.mark.parametrize(
    ("way_m_per_s", "rad_per_s", "stated"),
    [(0.0, 0.0, (None, None)), (0.02, 0.1, (None, None)), (0.2, 0.0, (0.2, None)), (0.0, 0.6, (None, 0.6))],
)
def test_fingers_that_act_in_motion_state_how_fast_it_was(
    way_m_per_s: float, rad_per_s: float, stated: tuple[float | None, float | None]
) -> None:
    """What was let go in motion is let go at a stop, and nothing said so."""

    def at(t: float) -> Moment:
        half = 0.5 * rad_per_s * t
        return Moment((way_m_per_s * t, 0.0, 0.3), (0.0, 0.0, math.sin(half), math.cos(half)), None, 0.04)

    def between(t0: float, tn: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        times = 0.05 + 0.1 * np.arange(round((t0 - 0.05) / 0.1), round((tn - 0.05) / 0.1) + 1)
        return times, np.array([(*at(t).position, *(at(t).orientation or ())) for t in times])

    steps = [ProgramSegment(0, segment("motion", 0.0, 4.0), 0.9)]
    let_go = GripperAction(1.45, "release", 0.08)
    made = task_program(steps, (let_go,), at, paths=Paths(between))
    (app,) = (app for app in made if app.kind == "gripper_move")
    expected = tuple(None if one is None else pytest.approx(one, rel=0.01) for one in stated)
    assert (app.moved_m_per_s, app.turned_rad_per_s) == expected


@pytest.mark.parametrize(("kind", "t"), [("grasp", 2.65), ("release", 2.05)])
def test_fingers_that_begin_or_settle_at_rest_state_how_the_flange_moved_meanwhile(
    kind: Any, t: float
) -> None:
    """A hand scooped: its fingers closed over 50 mm, had settled at rest, and nothing said so."""

    def at(t: float) -> Moment:
        x = float(np.interp(t, [2.15, 2.45], [0.0, 0.06]))
        width = float(np.interp(t, [2.05, 2.65], [0.08, 0.03]))
        return Moment((x, 0.0, 0.3), None, None, width if kind == "grasp" else 0.11 - width)

    def between(t0: float, tn: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        times = 0.05 + 0.1 * np.arange(round((t0 - 0.05) / 0.1), round((tn - 0.05) / 0.1) + 1)
        return times, np.array([at(t).position for t in times])

    steps = [ProgramSegment(0, segment("steady", 0.0, 4.0), 0.9)]
    made = task_program(steps, (GripperAction(t, kind, 0.03),), at, paths=Paths(between))
    (app,) = (one for one in made if one.kind in {"grasp", "gripper_move"})
    assert app.moved_m_per_s == pytest.approx(0.2, rel=0.01)
