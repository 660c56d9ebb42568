"""What two programs of one task differ in, in words, as the page of two sessions shows it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
import pytest

from caesura_protocol.messages import App
from caesura_protocol.programs.comparison import ALONE, FAR_M, REPETITION, compared
from clients.examples import example

APP = example(App)


def move(**changes: object) -> App:
    plain = {"kind": "cartesian_motion", "target": (0.4, 0.0, 0.3), "force": None, "load_kg": None}
    return APP.model_copy(update={**plain, "gripper_width": None, "t0": 1.0, "tn": 2.0, **changes})


def test_programs_of_one_task_are_alike():
    (one,) = compared([move()], [move(target=(0.401, 0.0, 0.3), tn=2.1)], REPETITION)
    assert one == (0, 0, ())


def test_differences_are_named_with_their_values():
    changed = move(target=(0.43, 0.04, 0.3), force=(0.0, 0.0, -12.0), gripper_width=0.04, tn=3.5)
    (one,) = compared([move(force=(0.0, 0.0, -5.0))], [changed], REPETITION, " and ")
    assert one.words == (
        "target 50.0 mm away",
        "force 5 N and 12 N",
        "duration 1 s and 2.5 s",
        "gripper width not given and 40 mm",
    )


@pytest.mark.parametrize(("width_m", "words"), [(0.050, ("gripper width 45 mm and 50 mm",)), (0.046, ())])
def test_gripper_widths_of_one_task_repeat_to_the_millimetre(width_m, words):
    """They were alike within 15 %, as forces are."""
    (one,) = compared([move(gripper_width=0.045)], [move(gripper_width=width_m)], REPETITION, " and ")
    assert one.words == words


def test_names_of_positions_are_compared():
    (one,) = compared([move(target_name="above the tray")], [move()], REPETITION, " and ")
    assert one.words == ("position name 'above the tray' and none",)


def test_an_app_that_only_one_has_is_named_and_the_rest_stays_paired():
    press = move(kind="apply_force")
    pairs = compared([move(), press, move()], [move(), move()], REPETITION)
    assert pairs == [(0, 0, ()), (1, None, ()), (2, 1, ())]


@pytest.mark.parametrize("place", [0, 4])
def test_of_pairs_that_are_equally_far_apart_those_at_like_places_correspond(place):
    """The first app of another task corresponded to the last one of its kind."""
    far = [move(kind=kind, target=(9.0, 0.0, 0.3)) for kind in ["cartesian_motion", "grasp"] * 2]
    far.append(move(target=(9.0, 0.0, 0.3)))
    one = [move(kind="apply_force")] * 4
    one.insert(place, move())
    pairs = [(one, other) for one, other, _ in compared(one, far) if one is not None and other is not None]
    assert pairs == [(place, place)]


@pytest.mark.parametrize("count", range(21))  # sums of 0.7 differ by their order from the sixth on
def test_a_program_without_apps_is_compared_with_any(count):
    apps = [move() for _ in range(count)]
    assert compared(apps, []) == [(index, None, ()) for index in range(count)]
    assert compared([], apps) == [(None, index, ()) for index in range(count)]


@pytest.mark.parametrize("seed", range(20))
def test_pairs_cost_as_little_as_any(seed):
    rng = np.random.default_rng(seed)
    programs = [[some(rng) for _ in range(rng.integers(0, 5))] for _ in range(2)]
    found = [(one, other) for one, other, _ in compared(*programs)]
    assert cost(found, *programs) == pytest.approx(min(cost(one, *programs) for one in pairings(*programs)))


def some(rng: np.random.Generator) -> App:
    target = tuple(0.06 * rng.random(3)) if rng.random() < 0.8 else None
    return move(kind=str(rng.choice(["cartesian_motion", "apply_force"])), target=target)


def pairings(apps: Sequence[App], others: Sequence[App]) -> Iterator[list[tuple[int | None, int | None]]]:
    """Every way of pairing some apps in order."""
    for count in range(min(len(apps), len(others)) + 1):
        for first, second in product(
            combinations(range(len(apps)), count), combinations(range(len(others)), count)
        ):
            alone = [(i, None) for i in range(len(apps)) if i not in first]
            rest = [(None, j) for j in range(len(others)) if j not in second]
            yield [*zip(first, second, strict=True), *alone, *rest]


def cost(pairs: Sequence[tuple[int | None, int | None]], apps: Sequence[App], others: Sequence[App]) -> float:
    return sum(ALONE if i is None or j is None else apart(apps[i], others[j]) for i, j in pairs)


def apart(one: App, other: App) -> float:
    if one.kind != other.kind:
        return math.inf
    if one.target is None or other.target is None:
        return float(one.target is not other.target)
    return min(1.0, math.dist(one.target, other.target) / FAR_M)
