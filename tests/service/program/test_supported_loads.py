"""What is set down where no gripper is known: the weight that the support takes over is no press."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from caesura_protocol.messages import App
from caesura_service.constants import GRAVITY
from caesura_service.program import GripperAction, Moment
from service.program.segments import UPRIGHT, drifted, held, kinds, program, segment

KG = 2.0
WEIGHT_N = KG * GRAVITY
HIGH, LOW = (0.1, 0.0, 0.3), (0.1, 0.0, 0.1)
DOWN = {"position_start": HIGH, "position_end": LOW}
STILL = {"position_start": LOW, "position_end": LOW}
UP = {"position_start": LOW, "position_end": HIGH}
LOAD = {"load_kg": KG, "load_sd_kg": 0.02}


def set_down(
    support: Callable[[float], float],
    *,
    begins: float = 0.0,
    lifted: bool = False,
    ends: bool = False,
    grips: tuple[GripperAction, ...] = (),
) -> tuple[App, ...]:
    """A carry until 4 s, a contact until 5 s, and a movement away from it; begins: of the carry [s].

    support: the force [N] of the support in the contact, by the time since the touch; lifted: whether the
    load is carried on afterwards; ends: whether the demonstration ends with the contact.
    """

    def at(t: float) -> Moment:
        borne = 0.0 if t < 4.0 else support(t - 4.0) if t < 5.0 else 0.0 if lifted else WEIGHT_N
        z = 0.3 - 0.05 * min(t, 4.0) + 0.1 * max(t - 5.0, 0.0)
        return drifted(t, pushed_n=borne - WEIGHT_N, at=lambda _: Moment((0.1, 0.0, z), UPRIGHT, None, None))

    middle = np.median([support(0.05 + 0.1 * k) for k in range(10)])
    away = segment("transport", 5.0, 7.0, **LOAD, **UP) if lifted else segment("motion", 5.0, 7.0, **UP)
    steps = [
        segment("transport", begins, 4.0, **LOAD, **DOWN),
        segment("contact", 4.0, 5.0, **held(middle - WEIGHT_N), **STILL),
        away,
    ]
    return program(*steps[: 2 if ends else 3], at=at, grips=grips)


def newtons(apps: tuple[App, ...]) -> list[float]:
    return [math.hypot(*app.force) for app in apps if app.force is not None]


@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize("seconds", [0.2, 0.5, 0.9])
def test_a_load_whose_weight_goes_over_to_a_support_is_set_down_without_a_press(
    seconds: float, ends: bool
) -> None:
    """A carry of 2 kg that was put down was a carry and a press of 4 to 20 N, which was not taught."""
    apps = set_down(lambda t: WEIGHT_N * min(t / seconds, 1.0), ends=ends)
    assert kinds(apps) == ["transport", "hold", *["cartesian_motion"] * (not ends)]
    assert [app.load_kg for app in apps[:2]] == pytest.approx([KG, KG])


def test_an_impact_as_a_load_is_set_down_is_no_press() -> None:
    apps = set_down(lambda t: 45.0 if 0.2 < t < 0.3 else WEIGHT_N * min(t / 0.3, 1.0))
    assert newtons(apps) == []


@pytest.mark.parametrize("press_n", [8.0, 25.0])
def test_what_is_pressed_beyond_the_weight_of_what_is_set_down_is_a_press(press_n: float) -> None:
    """It was a press of 27.6 N: the weight and what was pressed."""
    apps = set_down(lambda t: WEIGHT_N * min(t / 0.3, 1.0) + (press_n if t > 0.4 else 0.0))
    assert kinds(apps) == ["transport", "hold", "apply_force", "cartesian_motion"]
    assert newtons(apps) == pytest.approx([press_n])
    assert apps[2].t0 == pytest.approx(4.4)


def test_a_contact_of_a_load_that_is_carried_on_is_a_press() -> None:
    apps = set_down(lambda t: 12.0, lifted=True)
    assert newtons(apps) == pytest.approx([12.0])


def test_a_support_that_bears_less_than_half_of_the_weight_at_the_end_is_a_press() -> None:
    """The demonstration ends with the load still in the hand: nothing shows that it was set down."""
    assert newtons(set_down(lambda t: 6.0, ends=True)) == pytest.approx([6.0])


def test_fingers_that_hold_something_show_a_set_down_themselves() -> None:
    apps = set_down(lambda t: 12.0, grips=(GripperAction(-1.0, "grasp", 0.03),))
    assert newtons(apps) == pytest.approx([12.0])


def test_a_pull_that_lasts_until_the_tool_leaves_was_not_set_down() -> None:
    """Its force went on in the movement away: with negated forces it became a press of 16 N."""
    assert newtons(set_down(lambda t: -6.0)) == pytest.approx([6.0])


def test_a_carry_that_is_too_short_to_be_weighed_may_be_a_pull() -> None:
    (press_n,) = newtons(set_down(lambda t: WEIGHT_N, begins=3.4))
    assert press_n == pytest.approx(WEIGHT_N)
