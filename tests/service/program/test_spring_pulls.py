"""A handle that is pulled up against a spring, beside a load that is lifted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.messages import App, Segment
from caesura_service.constants import GRAVITY
from caesura_service.program import GripperAction, Moment
from service.program.segments import kinds, program, segment

LOW_M, HIGH_M, MOST_N = 0.2, 0.3, 17.0
KNOTS_S = [0.0, 1.0, 2.5, 4.0, 5.5, 9.0]


def height(t: float) -> float:
    return float(np.interp(t, KNOTS_S, [LOW_M, LOW_M, HIGH_M, HIGH_M, LOW_M, LOW_M]))


def as_spring(up_m: float) -> float:
    return MOST_N * up_m / (HIGH_M - LOW_M)


def as_load(up_m: float) -> float:
    """What lies on a support is lifted off it within 5 mm."""
    return MOST_N * min(up_m / 0.005, 1.0)


def lifted(weight_n: Callable[[float], float]) -> tuple[App, ...]:
    """The fingers close, move up, hold, move down, and open."""
    load = {"load_kg": MOST_N / GRAVITY, "load_sd_kg": 0.02}

    def at(t: float) -> Moment:
        up_m = height(t) - LOW_M
        return Moment((0.0, 0.0, height(t)), None, None, 0.03, (0.1, 0.0, 0.2 - weight_n(up_m)))

    def step(kind: str, t0: float, tn: float, **fields: float) -> Segment:
        places = {"position_start": at(t0).position, "position_end": at(tn).position}
        forces = {"force_start": at(t0).force, "force_end": at(tn).force}
        return segment(kind, t0, tn, **places, **forces, **fields)

    return program(
        step("steady", 0.0, 1.0),
        step("transport", 1.0, 2.5, **load),
        step("hold", 2.5, 4.0, **load),
        step("transport", 4.0, 5.5, **load),
        step("hold", 5.5, 7.0, **load),
        grips=(GripperAction(0.5, "grasp", 0.03), GripperAction(7.0, "release", 0.08)),
        at=at,
    )


def test_a_spring_that_is_pulled_up_is_no_load() -> None:
    """A robot that sets the load of a program would push up with its weight, and drop it at its set-down."""
    made = lifted(as_spring)
    assert kinds(made) == ["grasp", "transport", "hold", "transport", "hold", "gripper_move"]
    carries = made[1:5]
    assert [app.load_kg for app in carries] == pytest.approx([0.0] * 4, abs=0.4)
    assert [is_resisted(app) for app in carries] == [True, False, True, False]
    most_n = [app.force_taught[2] for app in carries if app.force_taught]
    assert most_n == pytest.approx([MOST_N] * 2, rel=0.15), "of the last three observations of the way"


def test_a_load_that_is_lifted_stays_one() -> None:
    made = lifted(as_load)
    carries = [app for app in made if app.kind == "transport"]
    assert [app.load_kg for app in carries] == pytest.approx([MOST_N / GRAVITY] * len(carries), abs=0.01)
    assert not any(map(is_resisted, made))
