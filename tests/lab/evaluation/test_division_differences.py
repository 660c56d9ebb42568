"""One movement that two programs divide otherwise: the same where the motion is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from caesura_lab.evaluation.programs.division_differences import (
    BothMotions,
    Difference,
    Division,
    differences,
    movements_of,
    speeds_at,
)
from caesura_lab.evaluation.programs.program_round_trip import RoundTripCase, compare_programs
from caesura_protocol.messages import App
from caesura_protocol.recording import Recording
from harness.programs import app, move, pick_and_place

CASE = RoundTripCase("pick_and_place", 1)
CORNER = (-0.018, -0.624, 0.156)


def undivided(**changes: Any) -> tuple[App, ...]:
    """The carry in one part."""
    reach, grasp, _, carry, *others = pick_and_place()
    return (reach, grasp, carry.model_copy(update={"t0": 4.0} | changes), *others)


def held(seconds: float, **changes: Any) -> tuple[App, ...]:
    """The carry with a hold at its corner."""
    reach, grasp, lift, carry, *others = pick_and_place()
    hold = app("hold", 5.7, 5.7 + seconds, CORNER, load_kg=0.25, load_sd_kg=0.01)
    return (reach, grasp, lift, hold, carry.model_copy(update={"t0": hold.tn} | changes), *others)


def alike(_: Difference) -> None:
    return None


@pytest.mark.parametrize("again", [undivided(), held(0.4)])
def test_a_carry_that_only_one_program_divides_is_the_same_where_the_motion_is(
    again: tuple[App, ...],
) -> None:
    for pair in ((pick_and_place(), again), (again, pick_and_place())):
        trip = compare_programs(CASE, *pair, alike)
        assert trip.why is None
        assert trip.taught != trip.executed
        differs = compare_programs(CASE, *pair, lambda only: f"at {only.division.t:.1f} s")
        assert differs.why is not None
        assert differs.why.endswith(" s")
        assert compare_programs(CASE, *pair).why is not None


def test_a_movement_that_returns_to_a_place_pairs_the_divisions_that_rest_alike() -> None:
    """A circle began and ended within 1 cm: its start was taken for the rest at its end."""
    there, home = (0.57, 0.02, 0.28), (0.53, -0.08, 0.34)
    circle, whole = (app("cartesian_motion", t0, 3.3, there) for t0 in (1.2, 0.6))
    to, back = app("cartesian_motion", 0.6, 1.2, there), app("cartesian_motion", 4.7, 5.2, home)
    parted, joined = movements_of((to, circle, back))[0], movements_of((whole, back))[0]
    for pair in ((parted, joined), (joined, parted)):
        assert [only.division.rest_s for only in differences(*pair, 0.01)] == [0.0]


@pytest.mark.parametrize(
    ("again", "why"),
    [
        (undivided(load_kg=None), None),
        (undivided(target=(-0.021, -0.475, 0.118)), "target of app 4 (transport) is 11.0 mm off"),
        (undivided(kind="cartesian_motion"), "app 3 (move) was taught as transport"),
        (undivided()[:-1], "app 4 (move gripper) was taught as transport"),
        (held(0.4, load_kg=0.5), "app 4 (hold) was taught as transport"),
    ],
)
def test_ends_kinds_and_loads_of_movements_are_compared(again: tuple[App, ...], why: str | None) -> None:
    assert compare_programs(CASE, pick_and_place(), again, alike).why == why


def test_a_division_elsewhere_is_a_difference_of_either_program() -> None:
    reach, grasp, lift, *others = pick_and_place()
    lower = (reach, grasp, lift.model_copy(update={"target": (-0.018, -0.624, 0.140)}), *others)
    assert compare_programs(CASE, pick_and_place(), lower, alike).why is None
    carries = [movements_of(apps)[2] for apps in (pick_and_place(), lower)]
    assert [only.is_taught for only in differences(carries[0], carries[1], 0.01)] == [True, False]
    assert differences(carries[0], carries[1], 0.02) == []


def test_a_contact_ends_a_movement() -> None:
    away, on = move(0.0, (0.0, 0.0, 0.1), (0.0, 0.0, 0.2)), move(1.0, (0.0, 0.0, 0.2), (0.1, 0.0, 0.2))
    down = on.model_copy(update={"kind": "move_to_contact"})
    assert [one.kind for one in movements_of((away, down))] == ["move_to_contact"]
    assert [one.kind for one in movements_of((down, away))] == ["move_to_contact", "cartesian_motion"]


def passing(slowest: float, seconds: float = 4.0) -> Recording:
    """A straight movement at 0.2 m/s, which slows down to a share of that in the middle of its time."""
    t = np.arange(0.0, seconds, 0.001)
    speed = 0.2 * (1.0 - (1.0 - slowest) * np.exp(-(((t - 0.5 * seconds) / 0.2) ** 2)))
    position = np.zeros((t.size, 3))
    position[:, 0] = np.cumsum(speed) * 0.001
    return Recording(t, {"pos": position, "quat": np.tile([1.0, 0.0, 0.0, 0.0], (t.size, 1))})


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_least_speed_is_found_and_the_one_beside_it(share: float) -> None:
    assert speeds_at(passing(share), 1.95) == pytest.approx((0.2 * share, 0.2), abs=0.012)


def test_a_turn_in_place_has_a_speed_and_a_rest_has_none() -> None:
    turning = passing(1.0)
    half = 0.5 * turning.t
    zero = np.zeros_like(half)
    turning.signals["quat"][:] = np.column_stack([np.sin(half), zero, zero, np.cos(half)])
    turning.signals["pos"][:] = 0.0
    assert speeds_at(turning, 2.0) == pytest.approx((0.1, 0.1))
    turning.signals["quat"][:] = (1.0, 0.0, 0.0, 0.0)
    assert speeds_at(turning, 2.0) == (0.0, 0.0)


@pytest.mark.parametrize("is_taught", [True, False])
def test_a_robot_that_stops_where_the_hand_passed_moves_differently(is_taught: bool) -> None:
    passes, slows, stops = passing(0.5), passing(0.45), passing(0.0, seconds=8.0)
    t = 2.0 if is_taught else 4.0
    only = Difference(Division(t, CORNER, 0.0, held=False), is_taught)
    spans = [(0.0, 4.0)], [(0.0, 8.0)]
    assert BothMotions(passes, stops, *spans).difference_at(only) is not None
    assert BothMotions(passes, stops, *spans, retimed=True).difference_at(only) is None
    here = Difference(Division(2.0, CORNER, 0.0, held=False), is_taught)
    assert BothMotions(passes, slows, spans[0], spans[0]).difference_at(here) is None


def test_a_long_rest_that_only_one_program_states_is_a_difference() -> None:
    passes = passing(0.0)
    only = Difference(Division(2.0, CORNER, 0.6, held=True), is_taught=True)
    motions = BothMotions(passes, passes, [(0.0, 4.0)], [(0.0, 4.0)], retimed=True)
    assert motions.difference_at(only) == "a rest of 0.6 s"
