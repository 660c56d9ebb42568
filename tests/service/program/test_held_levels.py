"""A press in which one force was held after another: one app for each."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from caesura_protocol.messages import App
from caesura_service.program import GripperAction
from caesura_service.program.forces.held_levels import held_levels
from service.program.segments import ACROSS, OFF, drifted, held, program, segment


def taught(*levels: tuple[float, float]) -> Callable[[float], float]:
    """Forces [N] by the time [s]: from 2 s on each level for some seconds, and none afterwards."""

    def push(t: float) -> float:
        until = 2.0
        for newton, seconds in levels:
            if until <= t < until + seconds:
                return newton
            until += seconds
        return 0.0

    return push


def pressed(push: Callable[[float], float], tn: float, *, kind: str = "contact") -> list[App]:
    """The presses of a contact from 2 s on with these forces, its own the largest one."""
    most = max(push(0.1 * k) for k in range(200))
    made = program(
        segment("motion", 0.0, 2.0),
        segment(kind, 2.0, tn, **held(most), **ACROSS),
        segment("motion", tn, tn + 2.0, **OFF),
        at=lambda t: drifted(t, pushed_n=push(t)),
    )
    return [app for app in made if app.force is not None]


def newtons(apps: list[App]) -> list[float]:
    return [math.hypot(*(app.force or ())) for app in apps]


@pytest.mark.parametrize(
    "levels",
    [
        ((10.2, 3.0), (6.0, 4.0), (10.2, 2.0)),
        ((6.0, 4.0), (10.2, 3.0)),
        ((20.0, 3.0), (16.0, 4.0)),
        ((5.0, 1.0), (15.0, 1.0), (5.0, 1.0), (15.0, 1.0)),
    ],
)
def test_each_force_that_was_held_for_a_second_is_a_press(levels: tuple[tuple[float, float], ...]) -> None:
    """A press of 10.2 N with 6 N for 4 s in its middle was one of 10.2 N, and nothing stated the 6 N."""
    seconds = sum(held_s for _, held_s in levels)
    apps = pressed(taught(*levels), 2.0 + seconds)
    assert newtons(apps) == pytest.approx([newton for newton, _ in levels])
    assert [app.tn - app.t0 for app in apps] == pytest.approx([held_s for _, held_s in levels])
    assert all(app.segments == (1,) for app in apps)
    assert [app.weaker_n for app in apps] == [None] * len(levels)


@pytest.mark.parametrize(
    "push",
    [
        taught((20.0, 3.0), (17.5, 3.0)),  # a robot keeps a force within 15 %
        taught((8.0, 3.0), (6.0, 3.0)),  # and a sensor makes up 2 N
        taught((20.0, 3.0), (10.0, 0.8), (20.0, 2.2)),  # not held
        lambda t: 5.0 + 2.5 * max(t - 2.0, 0.0) if t < 8.0 else 0.0,  # rises all the time
        lambda t: (12.0 + 5.0 * math.sin(3.0 * t)) * (t < 8.0),
    ],
)
def test_a_force_that_was_not_held_at_another_level_is_one_press(push: Callable[[float], float]) -> None:
    assert len(pressed(push, 8.0)) == 1


def test_a_stroke_has_one_force() -> None:
    assert len(pressed(taught((6.0, 4.0), (12.0, 4.0)), 10.0, kind="sliding")) == 1


def test_what_an_operator_has_named_a_press_is_one() -> None:
    push = taught((6.0, 4.0), (12.0, 4.0))
    steps = segment("motion", 0.0, 2.0), segment("contact", 2.0, 10.0, **held(12.0), corrected=True)
    made = program(*steps, at=lambda t: drifted(t, pushed_n=push(t)))
    assert [app.kind for app in made].count("apply_force") == 1


@pytest.mark.parametrize("noise_n", [0.0, 0.2])
@pytest.mark.parametrize("changing", [0, 1, 3])
def test_the_observations_of_a_change_belong_to_the_nearer_level(noise_n: float, changing: int) -> None:
    """changing: observations between the two levels."""
    between = np.linspace(10.0, 6.0, changing + 2)[1:-1]
    sizes = np.concatenate([np.full(20, 10.0), between, np.full(20, 6.0)])
    sizes += np.random.default_rng(1).normal(scale=noise_n, size=len(sizes))
    (first, cut), (again, end) = held_levels(sizes)
    assert (first, again, end) == (0, cut, len(sizes))
    assert abs(cut - (20 + changing / 2)) <= 1.0


def test_a_noise_as_large_as_the_difference_hides_two_levels() -> None:
    sizes = np.concatenate([np.full(30, 10.0), np.full(30, 6.0)])
    sizes += np.random.default_rng(1).normal(scale=2.0, size=len(sizes))
    assert held_levels(sizes) == [(0, 60)]


@pytest.mark.parametrize(
    ("after_n", "rests_s", "ended"),
    [
        (0.0, 0.8, 5.0),  # nothing is pressed any more
        (6.0, 0.8, 5.0),  # the support bears what is held
        (6.0, 0.2, 5.2),  # the hand lets go
        (12.0, 0.8, 5.8),  # more than that: the hand still presses
    ],
)
def test_a_press_ends_where_only_what_is_held_rests_on_its_support(
    after_n: float, rests_s: float, ended: float
) -> None:
    """A peg that stood in its hole for 0.7 s, until the fingers opened, was pressed for as long."""
    push = taught((20.0, 3.0), (after_n, rests_s))
    made = program(
        segment("transport", 0.0, 2.0, load_kg=0.6, load_sd_kg=0.02),
        segment("contact", 2.0, 5.0 + rests_s, **held(20.0)),
        grips=(GripperAction(-1.0, "grasp", 0.03), GripperAction(8.0, "release", 0.08)),
        at=lambda t: drifted(t, pushed_n=push(t)),
    )
    (press,) = (app for app in made if app.force is not None)
    assert (press.t0, press.tn) == pytest.approx((2.0, ended))
    assert newtons([press]) == pytest.approx([20.0])
